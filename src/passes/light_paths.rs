//! light_paths: one light subpath per pixel, joined to the camera and stored for eye_paths.
//!
//! Reads the scene and the lights. Writes the light subpaths; adds to the splats. Skipped in unidirectional path tracing.

use crate::gpu::{Compute, Gpu};

/// The pass.
pub struct LightPaths(Compute);

impl LightPaths {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "light_paths", "light_paths", flags))
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
