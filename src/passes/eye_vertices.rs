//! eye_vertices: z1 of every pixel, exactly, and the light that the camera sees: strategies (0, 2).
//!
//! Reads the G-buffer and, where tiles settle, which have. Writes the eye vertices, starts the iteration's image, and tells filters
//! what each pixel shows.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;

/// The pass.
pub struct EyeVertices(Compute);

impl EyeVertices {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "eye_vertices", "eye_vertices", flags))
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        gbuffer: &wgpu::TextureView,
        guides: Option<&wgpu::Buffer>,
    ) {
        let mut bindings = scene.with(&[("gbuffer", wgpu::BindingResource::TextureView(gbuffer))]);
        bindings.extend(band.bindings());
        bindings.extend(guides.map(|guides| ("guides", guides.as_entire_binding())));
        self.0.record(gpu, encoder, band.size, &bindings);
    }
}
