//! borders: the nearest triangle that each pixel's exact ray hits, among those whose sides are within a pixel.
//!
//! Reads: the geometry. Writes: the triangles' indices. Skipped when: triangles are many for the pixels, or the
//! G-buffer is skipped.

use crate::gpu::{Gpu, Raster, RasterTargets};
use crate::render::recording::Recording;

/// The pass and its target. The depth target is that of the G-buffer.
pub struct Borders {
    raster: Raster,
    size: [u32; 2],
    /// Index of the triangle per pixel; all ones where there is none.
    pub triangles: wgpu::TextureView,
}

impl Borders {
    /// Bytes of the target per pixel.
    pub const BYTES_PER_PIXEL: u64 = 4;

    /// Builds the pipeline and the target.
    #[must_use]
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        Self {
            raster: Raster::new(gpu, "shared/camera/borders", &[]),
            size,
            triangles: gpu.target("borders", size, Raster::COLOR_FORMAT, wgpu::TextureUsages::TEXTURE_BINDING),
        }
    }

    /// Returns the bytes of the target.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        Self::BYTES_PER_PIXEL * u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Records the pass with the camera of a frame's uniform. `depth` is overwritten.
    pub fn record(&self, recording: &mut Recording, frame: wgpu::BindingResource, depth: &wgpu::TextureView) {
        let targets = RasterTargets { color: &self.triangles, depth };
        let bindings = recording.scene.with(&[("frame", frame)]);
        // Two triangles for each of the three sides.
        let vertices = 18 * recording.scene.triangles;
        let draw = |pass: &mut wgpu::RenderPass| pass.draw(0..vertices, 0..1);
        self.raster.record(recording.gpu, &mut recording.encoder, &targets, self.size, &bindings, draw);
    }
}
