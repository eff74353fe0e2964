//! temporal: indirect light averaged with that of frames before.
//!
//! Reads guides of both frames, indirect light, gradients and the history. Writes the new history. Skipped without one.

use crate::gpu::{Bindings, Compute, Gpu};

/// The pass.
pub struct Temporal(Compute);

impl Temporal {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu) -> Self {
        Self(Compute::new(gpu, "temporal", "temporal", &[]))
    }

    /// Records the pass for so many columns and rows.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], bindings: Bindings) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
