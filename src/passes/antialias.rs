//! antialias: the mean of the frames.
//!
//! Reads the frame's picture, guides and the picture before. Writes the picture.

use crate::gpu::{Bindings, Compute, Gpu};

/// The pass.
pub struct Antialias(Compute);

impl Antialias {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu) -> Self {
        Self(Compute::new(gpu, "antialias", "antialias", &[]))
    }

    /// Records the pass for so many columns and rows.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], bindings: Bindings) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
