//! list_lengths: shows the number of list entries that each pixel's look-up along the first ray-bundle walks.
//!
//! Reads: the eye vertices z1 and the bundle's lists. Writes: the iteration's image. Skipped when: the
//! settings do not show list lengths.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// The pass.
pub struct ListLengths(Compute);

impl ListLengths {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag]) -> Self {
        Self(Compute::new(gpu, "shared/views/list_lengths", &[flags, &[Flag::Walked]].concat()))
    }

    /// Records the pass.
    pub fn record(&self, recording: &mut Recording, band: &Band, bundle: &ViewBuffers) {
        recording.run(&self.0, band.size, &[&bundle.bindings(), &band.bindings()]);
    }
}
