//! What the render thread leaves for the window.

use std::sync::{Mutex, PoisonError};

use super::render_thread::PANES;
use super::request::{Machine, Picture, SceneInfo};

/// A message of the render thread.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note {
    /// Something was done.
    Done(String),
    /// Something failed; the text says what to do.
    Wrong(String),
    /// The scene could not be loaded; the previous one stays.
    NotLoaded(String),
}

/// Results for the window.
#[derive(Debug, Default)]
pub struct Outbox {
    /// Description of the machine, once it is known.
    pub machine: Option<Machine>,
    /// Description of a scene that was loaded.
    pub scene_info: Option<SceneInfo>,
    /// First look at a pane's scene, while its renderer is set up.
    pub previews: [Option<Picture>; PANES],
    /// Newest picture of each pane.
    pub pictures: [Option<Picture>; PANES],
    /// Number of shaders that the driver has compiled so far, while it compiles more.
    pub shaders: Option<usize>,
    /// Messages in the order of their occurrence.
    pub notes: Vec<Note>,
    /// Number of pictures since the thread started.
    pub count: u64,
}

/// The outbox that threads share, and what wakes the window.
pub(super) struct SharedOutbox {
    outbox: Mutex<Outbox>,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl SharedOutbox {
    pub(super) fn new(wake: impl Fn() + Send + Sync + 'static) -> Self {
        Self { outbox: Mutex::default(), wake: Box::new(wake) }
    }

    /// Adds results, and wakes the window.
    pub(super) fn add(&self, change: impl FnOnce(&mut Outbox)) {
        change(&mut self.outbox.lock().unwrap_or_else(PoisonError::into_inner));
        (self.wake)();
    }

    /// Adds a message.
    pub(super) fn say(&self, note: Note) {
        self.add(|outbox| outbox.notes.push(note));
    }

    /// Returns the results since the last call.
    pub(super) fn take(&self) -> Outbox {
        let mut outbox = self.outbox.lock().unwrap_or_else(PoisonError::into_inner);
        let count = outbox.count;
        std::mem::replace(&mut *outbox, Outbox { count, ..Outbox::default() })
    }
}
