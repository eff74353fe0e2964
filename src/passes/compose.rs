//! compose: the frame's picture from its layers.
//!
//! Reads guides, clear and indirect light. Writes radiance per pixel.

use crate::gpu::{Bindings, Compute, Gpu};

/// The pass.
pub struct Compose(Compute);

impl Compose {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "compose", "compose", flags))
    }

    /// Records the pass for so many columns and rows.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], bindings: Bindings) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
