//! eye_paths: one eye subpath per pixel, joined to lights and, in bidirectional path tracing, to the pixel's light subpath.
//!
//! Reads the scene, the lights and the light subpaths. Writes the sample's image.

use crate::gpu::{Compute, Gpu};

/// The pass.
pub struct EyePaths(Compute);

impl EyePaths {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "eye_paths", "eye_paths", flags))
    }

    /// Records the pass over `count` pixels.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        count: u32,
        bindings: &[(&str, wgpu::BindingResource)],
    ) {
        self.0.record(gpu, encoder, [count, 1], bindings);
    }
}
