//! What validation layers say: wgpu hears it and logs it, and a [`Listener`] among the loggers keeps it.

use std::sync::{Mutex, PoisonError};

use log::{Level, Log, Metadata, Record};

static HEARD: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// A logger that keeps errors and validation messages of the driver, and hands everything on to another one.
pub struct Listener<L>(pub L);

impl<L: Log> Log for Listener<L> {
    fn enabled(&self, metadata: &Metadata) -> bool {
        concerns(metadata) || self.0.enabled(metadata)
    }

    fn log(&self, record: &Record) {
        let text = record.args().to_string();
        if concerns(record.metadata()) && (record.level() == Level::Error || text.starts_with("VALIDATION")) {
            HEARD.lock().unwrap_or_else(PoisonError::into_inner).push(text);
        }
        if self.0.enabled(record.metadata()) {
            self.0.log(record);
        }
    }

    fn flush(&self) {
        self.0.flush();
    }
}

/// Whether it comes from the layer of wgpu that the driver speaks to.
fn concerns(metadata: &Metadata) -> bool {
    metadata.level() <= Level::Warn && metadata.target().starts_with("wgpu_hal")
}

/// What was heard since the last time; nothing where no [`Listener`] is the program's logger.
pub fn take() -> Vec<String> {
    std::mem::take(&mut HEARD.lock().unwrap_or_else(PoisonError::into_inner))
}
