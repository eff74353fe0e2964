//! gbuffer: the triangle that each pixel sees, with depth test, at the iteration's position within the pixel.
//!
//! Reads: the geometry. Writes: the triangles' indices. Skipped when: the camera and the position are those
//! of the last iteration.

use crate::gpu::{Flag, Gpu, Raster, RasterTargets};
use crate::render::recording::Recording;

/// The pass and its targets.
pub struct GBuffer {
    raster: Raster,
    size: [u32; 2],
    /// The depth target, which is free after the pass.
    pub depth: wgpu::TextureView,
    /// Index of the triangle per pixel; all ones where there is none.
    pub triangles: wgpu::TextureView,
}

impl GBuffer {
    /// Builds the pipeline and the targets.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], width: u32, height: u32) -> Self {
        Self {
            raster: Raster::new(gpu, "shared/camera/gbuffer", flags),
            size: [width, height],
            depth: gpu.target("gbuffer depth", [width, height], Raster::DEPTH_FORMAT, wgpu::TextureUsages::empty()),
            triangles: gpu.target(
                "gbuffer",
                [width, height],
                Raster::COLOR_FORMAT,
                wgpu::TextureUsages::TEXTURE_BINDING,
            ),
        }
    }

    /// Returns the bytes of the targets.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        8 * u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Records the pass with the camera of a frame's uniform.
    pub fn record(&self, recording: &mut Recording, frame: wgpu::BindingResource) {
        let targets = RasterTargets { color: &self.triangles, depth: &self.depth };
        let bindings = recording.scene.with(&[("frame", frame)]);
        let vertices = 3 * recording.scene.triangles;
        let draw = |pass: &mut wgpu::RenderPass| pass.draw(0..vertices, 0..1);
        self.raster.record(recording.gpu, &mut recording.encoder, &targets, self.size, &bindings, draw);
    }
}
