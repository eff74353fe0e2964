//! outliers: gives pixels of a layer that stick out the brightness of those around them.
//!
//! Reads guides and filtered indirect light. Writes it again. Skipped unless asked for.

use crate::gpu::{Bindings, Compute, Gpu};

/// The pass.
pub struct Outliers(Compute);

impl Outliers {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu) -> Self {
        Self(Compute::new(gpu, "outliers", "outliers", &[]))
    }

    /// Records the pass for so many columns and rows.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, size: [u32; 2], bindings: Bindings) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
