//! depth_maps: the nearest triangle of each texel and its depth, for views around light vertices in `fast`.
//!
//! Reads the geometry, the view's draw items, and materials with holes. Writes the view's depth map.

use crate::gpu::{Gpu, Raster, RasterTargets};
use crate::gpu_scene::GpuScene;
use crate::view::{DepthMap, ViewBuffers, ViewScratch};

/// The pass.
pub struct DepthMaps(Raster);

impl DepthMaps {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        let (color, depth) = (DepthMap::TRIANGLES, Some(DepthMap::DEPTHS));
        Self(Raster::new(gpu, "depth_maps", "depth_maps", flags, color, true, depth))
    }

    /// Records the pass for one view.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        view: &ViewBuffers,
        scratch: &ViewScratch,
        map: &DepthMap,
    ) {
        let none = f64::from(u32::MAX);
        let targets = RasterTargets {
            color: &map.triangles,
            clear: wgpu::Color { r: none, g: none, b: none, a: none },
            depth: Some(&map.depths),
        };
        let bindings =
            scene.with(&[("view", view.view.as_entire_binding()), ("items", scratch.items.as_entire_binding())]);
        self.0.record(gpu, encoder, &targets, view.atlas(), &bindings, |pass| {
            pass.draw_indirect(&scratch.tally, ViewScratch::DRAW)
        });
    }
}
