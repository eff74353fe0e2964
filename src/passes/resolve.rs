//! resolve: adds a sample's image and its splats to the film, and clears the splats.

use crate::gpu::{Compute, Gpu};

/// The pass.
pub struct Resolve(Compute);

impl Resolve {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "resolve", "resolve", flags))
    }

    /// Records the pass over an image.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        size: [u32; 2],
        bindings: &[(&str, wgpu::BindingResource)],
    ) {
        self.0.record(gpu, encoder, size, bindings);
    }
}
