//! view_lists: puts large triangles into a view's per-texel linked lists.
//!
//! Reads the geometry and items. Writes lists and tally. Skipped for the light's view while the light stays the same.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::view::{ViewBuffers, ViewScratch};

/// Most workgroups that share the items: enough for a large device, few enough to cost nothing where there are few items.
const GROUPS: u32 = 1024;

/// The pass.
pub struct ViewLists(Compute);

impl ViewLists {
    /// Builds the pipeline for exact or `fast` visibility.
    #[must_use]
    pub fn new(gpu: &Gpu, fast: bool) -> Self {
        Self(Compute::new(gpu, "view_lists", "view_lists", if fast { &["FAST"] } else { &[] }))
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
            ("items", scratch.items.as_entire_binding()),
            ("tally", scratch.tally.as_entire_binding()),
            ("lists", view.listed_in(scratch).as_entire_binding()),
        ]);
        let groups = scene.triangles.clamp(1, GROUPS);
        self.0.record(gpu, encoder, [64 * groups, 1], &bindings);
    }
}
