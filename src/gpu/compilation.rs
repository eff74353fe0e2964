//! Shaders that a driver compiles when they first run.
//!
//! Software drivers do so, and one shader can take seconds. There a pipeline's first run is one without workgroups, for
//! which the program waits, so that this time is known and part of neither a pass nor a budget. Other drivers compile
//! when a pipeline is built.

use std::sync::Mutex;
use std::time::Duration;

/// Told about a shader before it is compiled: the label of its pass, and how many have been compiled before.
pub type Listener = Box<dyn FnMut(&'static str, u64) + Send>;

/// Time that a driver took to compile shaders when they first ran.
#[derive(Default)]
pub struct Compilation(Mutex<State>);

#[derive(Default)]
struct State {
    time: Duration,
    shaders: u64,
    listener: Option<Listener>,
}

impl Compilation {
    /// Returns the time so far; 0 if the driver compiles when pipelines are built.
    pub fn time(&self) -> Duration {
        self.0.lock().map(|state| state.time).unwrap_or_default()
    }

    /// Sets who is told, in place of whom was told before.
    pub fn tell(&self, listener: Option<Listener>) {
        if let Ok(mut state) = self.0.lock() {
            state.listener = listener;
        }
    }

    /// Begins with a shader.
    #[cfg(not(target_family = "wasm"))]
    fn begin(&self, label: &'static str) {
        if let Ok(mut state) = self.0.lock() {
            let State { shaders, listener, .. } = &mut *state;
            if let Some(listener) = listener {
                listener(label, *shaders);
            }
            *shaders += 1;
        }
    }

    #[cfg(not(target_family = "wasm"))]
    fn end(&self, label: &str, time: Duration) {
        log::debug!("{label} compiled in {:.3} s", time.as_secs_f64());
        if let Ok(mut state) = self.0.lock() {
            state.time += time;
        }
    }
}

/// Has the driver compile a pipeline, with the bind groups of its first run.
#[cfg(not(target_family = "wasm"))]
pub(super) fn compile(gpu: &super::Gpu, label: &'static str, pipeline: &wgpu::ComputePipeline, groups: &[wgpu::BindGroup]) {
    // Errors are those of `Gpu::check`.
    let wait = || gpu.device.poll(wgpu::PollType::wait_indefinitely()).is_ok();
    gpu.compilation.begin(label);
    wait();
    let began = web_time::Instant::now();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(pipeline);
    for (group, bound) in (0..).zip(groups) {
        pass.set_bind_group(group, bound, &[]);
    }
    pass.dispatch_workgroups(0, 0, 0);
    drop(pass);
    gpu.queue.submit([encoder.finish()]);
    wait();
    gpu.compilation.end(label, began.elapsed());
}
