//! view_setup: every triangle's outline in a parallel view, the lists of what touches few texels, and items of the rest.
//!
//! Reads the geometry and the view. Writes its outlines, lists, items and tally. Skipped for the light's view while the light stays
//! the same.

use crate::gpu::{Compute, Gpu, rows};
use crate::gpu_scene::GpuScene;
use crate::view::{ViewBuffers, ViewScratch};

/// The pass.
pub struct ViewSetup(Compute);

impl ViewSetup {
    /// Builds the pipeline for views whose items are `drawn` (depth maps), or listed, for exact or `fast` visibility.
    #[must_use]
    pub fn new(gpu: &Gpu, drawn: bool, fast: bool) -> Self {
        let flags: &[&str] = match (drawn, fast) {
            (true, _) => &["DRAWN"],
            (false, true) => &["FAST"],
            (false, false) => &[],
        };
        Self(Compute::new(gpu, "view_setup", "view_setup", flags))
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
            ("outlines", view.outlines.as_entire_binding()),
            ("items", scratch.items.as_entire_binding()),
            ("tally", scratch.tally.as_entire_binding()),
            ("lists", view.lists.as_entire_binding()),
        ]);
        self.0.record(gpu, encoder, rows(scene.triangles), &bindings);
    }
}
