//! Handling of Ctrl-C and SIGTERM. After the first signal `render` writes the picture so far; the second
//! signal ends the program at once.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit code of an interrupted program: 128 + SIGINT, as in shells.
pub const EXIT_CODE: u8 = 130;

/// Interval at which the flags are polled for the message.
const POLL: Duration = Duration::from_millis(50);

/// Flags that signal handlers set and renders poll.
#[derive(Clone, Default)]
pub struct Interrupt {
    requested: Arc<AtomicBool>,
    rendering: Arc<AtomicBool>,
}

impl Interrupt {
    /// Installs the signal handlers. A signal before [`Self::begin`] prints a line on stderr, unless `quiet`.
    pub fn install(quiet: bool) -> io::Result<Self> {
        let this = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // Handlers run in the order of registration, so the first signal sets the flag and the second
            // exits.
            flag::register_conditional_shutdown(signal, EXIT_CODE.into(), Arc::clone(&this.requested))?;
            flag::register(signal, Arc::clone(&this.requested))?;
        }
        if !quiet {
            let watched = this.clone();
            thread::spawn(move || watched.announce());
        }
        Ok(this)
    }

    /// Prints a message for a signal during loading or setup.
    fn announce(&self) {
        while !self.rendering.load(Ordering::Relaxed) {
            if self.requested() {
                eprintln!("stopping after the first sample; press Ctrl-C again to end at once");
                return;
            }
            thread::sleep(POLL);
        }
    }

    /// Marks the start of rendering, from which on a signal takes effect after the current batch.
    pub fn begin(&self) {
        self.rendering.store(true, Ordering::Relaxed);
    }

    /// Asks a render to stop, as a signal does.
    pub fn request(&self) {
        self.requested.store(true, Ordering::Relaxed);
    }

    /// True if a signal has arrived.
    pub fn requested(&self) -> bool {
        self.requested.load(Ordering::Relaxed)
    }
}
