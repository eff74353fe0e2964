//! Ctrl-C and SIGTERM: the first signal asks `render` to write what it has, the second ends the program at
//! once.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit code of an interrupted program: 128 + SIGINT, as in shells.
pub const EXIT_CODE: u8 = 130;

/// Time between two looks at the flags, for the message.
const POLL: Duration = Duration::from_millis(50);

/// Whether a signal has come.
#[derive(Clone, Default)]
pub struct Interrupt {
    requested: Arc<AtomicBool>,
    rendering: Arc<AtomicBool>,
}

impl Interrupt {
    /// Handles signals from here on. One that comes before [`Self::begin`] is answered with a line on stderr,
    /// unless `quiet`.
    pub fn install(quiet: bool) -> io::Result<Self> {
        let this = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // Handlers run in this order, so the first signal sets the flag and the second one finds it set.
            flag::register_conditional_shutdown(signal, EXIT_CODE.into(), Arc::clone(&this.requested))?;
            flag::register(signal, Arc::clone(&this.requested))?;
        }
        if !quiet {
            let watched = this.clone();
            thread::spawn(move || watched.announce());
        }
        Ok(this)
    }

    /// Answers a signal that comes while the scene is loaded or the renderer set up.
    fn announce(&self) {
        while !self.rendering.load(Ordering::Relaxed) {
            if self.requested() {
                eprintln!("stopping after the first sample; press Ctrl-C again to end at once");
                return;
            }
            thread::sleep(POLL);
        }
    }

    /// Notes that samples are being rendered, so that a signal is answered within a batch.
    pub fn begin(&self) {
        self.rendering.store(true, Ordering::Relaxed);
    }

    /// Whether the first signal has come.
    pub fn requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}
