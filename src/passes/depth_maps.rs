//! depth_maps: the nearest triangle of each texel, for views around light vertices in `fast`.
//!
//! Reads the geometry, lists in the scratch, and materials with holes. Writes the view's depth map.

use crate::gpu::{Compute, Gpu, rows};
use crate::gpu_scene::GpuScene;
use crate::view::{ViewBuffers, ViewScratch};

/// The pass.
pub struct DepthMaps(Compute);

impl DepthMaps {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "depth_maps", "depth_maps", &[flags, &["FAST"]].concat()))
    }

    /// Records the pass for one view.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        view: &ViewBuffers,
        scratch: &ViewScratch,
    ) {
        let bindings = scene.with(&[
            ("view", view.view.as_entire_binding()),
            ("lists", view.listed_in(scratch).as_entire_binding()),
            ("map", view.lists.as_entire_binding()),
        ]);
        self.0.record(gpu, encoder, rows(view.texels.count() as u32), &bindings);
    }
}
