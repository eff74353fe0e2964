//! gradient: how much the light changed since the frame before, free of noise.
//!
//! Reads guides, clear and indirect light of both frames. Writes change and largest value for each square of pixels. Skipped where
//! nothing is remembered.

use crate::gpu::{Bindings, Compute, Gpu};

/// The pass.
pub struct Gradient(Compute);

impl Gradient {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu) -> Self {
        Self(Compute::new(gpu, "gradient", "gradient", &[]))
    }

    /// Records the pass for so many columns and rows.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], bindings: Bindings) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
