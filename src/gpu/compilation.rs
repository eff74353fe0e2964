//! Time that a driver takes to compile shaders when they first run.
//!
//! Mesa's software driver does so, and one shader can take seconds. There a pipeline's first run is one without
//! workgroups, for which the program waits, so that this time is known and part of neither a pass nor a budget. Other
//! drivers compile when a pipeline is built.

use std::sync::Mutex;
use std::time::Duration;

/// Told about a shader before it is compiled: the label of its pass, and how many shaders there were before it.
pub type Listener = Box<dyn FnMut(&'static str, usize) + Send>;

/// Time that a driver took to compile shaders, and who is told.
#[derive(Default)]
pub struct Compilation(Mutex<State>);

#[derive(Default)]
struct State {
    time: Duration,
    #[cfg(not(target_family = "wasm"))]
    begun: usize,
    listener: Option<Listener>,
}

impl Compilation {
    /// Returns the time so far; 0 if the driver compiles when pipelines are built.
    pub fn time(&self) -> Duration {
        self.0.lock().map(|state| state.time).unwrap_or_default()
    }

    /// Sets who is told, in place of whom was told before.
    pub fn tell(&self, listener: Listener) {
        if let Ok(mut state) = self.0.lock() {
            state.listener = Some(listener);
        }
    }

    /// Tells that a pass's shader is compiled.
    #[cfg(not(target_family = "wasm"))]
    pub(super) fn begin(&self, label: &'static str) {
        let Ok(mut state) = self.0.lock() else { return };
        let State { begun, listener, .. } = &mut *state;
        if let Some(listener) = listener {
            listener(label, *begun);
        }
        *begun += 1;
    }

    /// Adds time in which the program waited for shaders.
    #[cfg(not(target_family = "wasm"))]
    pub(super) fn end(&self, what: &str, time: Duration) {
        log::debug!("{what} compiled in {:.3} s", time.as_secs_f64());
        if let Ok(mut state) = self.0.lock() {
            state.time += time;
        }
    }
}
