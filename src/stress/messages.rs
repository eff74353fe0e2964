//! Captures messages of validation layers, which wgpu logs, by a [`Listener`] among the loggers.

use std::sync::{Mutex, PoisonError};

use log::{Level, Log, Metadata, Record};

static HEARD: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// A logger that stores errors and validation messages of the driver, and forwards all records to another
/// logger.
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

/// Returns true if a record is from wgpu's hardware layer, which calls the driver.
fn concerns(metadata: &Metadata) -> bool {
    metadata.level() <= Level::Warn && metadata.target().starts_with("wgpu_hal")
}

/// Returns the messages since the last call; none if the program's logger is no [`Listener`].
pub fn take() -> Vec<String> {
    std::mem::take(&mut HEARD.lock().unwrap_or_else(PoisonError::into_inner))
}
