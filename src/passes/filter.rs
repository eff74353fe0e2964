//! filter: joins what the pixels of a square found.
//!
//! Reads guides and indirect light or its history. Writes filtered indirect light. Skipped without interleaved sampling.

use crate::gpu::{Bindings, Compute, Gpu};

/// The pass.
pub struct Filter(Compute);

impl Filter {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "filter", "filter", flags))
    }

    /// Records the pass for so many columns and rows.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], bindings: Bindings) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
