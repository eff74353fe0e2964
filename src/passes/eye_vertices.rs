//! eye_vertices: z1 of every pixel, exactly, and the light that the camera sees: strategies (0, 2).
//!
//! Reads the G-buffer. Writes the eye vertices and starts the iteration's image.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;

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
        frame: &wgpu::Buffer,
        size: [u32; 2],
        gbuffer: &wgpu::TextureView,
        eye_vertices: &wgpu::Buffer,
        shadings: &wgpu::Buffer,
        radiance: &wgpu::Buffer,
    ) {
        let bindings = scene.with(&[
            ("frame", frame.as_entire_binding()),
            ("gbuffer", wgpu::BindingResource::TextureView(gbuffer)),
            ("eye_vertices", eye_vertices.as_entire_binding()),
            ("shadings", shadings.as_entire_binding()),
            ("radiance", radiance.as_entire_binding()),
        ]);
        self.0.record(gpu, encoder, size, &bindings);
    }
}
