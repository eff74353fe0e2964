//! gbuffer: which triangle each pixel sees, with depth test, at the iteration's position within the pixel.
//!
//! Reads the geometry. Writes the triangles' indices.

use crate::gpu::{Gpu, Raster, RasterTargets};
use crate::gpu_scene::GpuScene;

/// The pass and its targets.
pub struct GBuffer {
    raster: Raster,
    size: [u32; 2],
    depth: wgpu::TextureView,
    /// Index of the triangle per pixel; all ones where there is none.
    pub triangles: wgpu::TextureView,
}

impl GBuffer {
    /// Builds the pipeline and the targets.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str], width: u32, height: u32) -> Self {
        let color = wgpu::TextureFormat::R32Uint;
        let depth = wgpu::TextureFormat::Depth32Float;
        Self {
            raster: Raster::new(gpu, "gbuffer", "gbuffer", flags, color, true, Some(depth)),
            size: [width, height],
            depth: gpu.target("gbuffer depth", [width, height], depth, wgpu::TextureUsages::empty()),
            triangles: gpu.target("gbuffer", [width, height], color, wgpu::TextureUsages::TEXTURE_BINDING),
        }
    }

    /// Bytes of the targets.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        8 * u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Records the pass.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, scene: &GpuScene, frame: &wgpu::Buffer) {
        let none = f64::from(u32::MAX);
        let targets = RasterTargets {
            color: &self.triangles,
            clear: wgpu::Color { r: none, g: none, b: none, a: none },
            depth: Some(&self.depth),
        };
        let bindings = scene.with(&[("frame", frame.as_entire_binding())]);
        let vertices = 3 * scene.triangles;
        self.raster.record(gpu, encoder, &targets, self.size, &bindings, |pass| pass.draw(0..vertices, 0..1));
    }
}
