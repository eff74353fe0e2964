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
    /// Builds the pipeline for exact or `fast` visibility.
    #[must_use]
    pub fn new(gpu: &Gpu, fast: bool) -> Self {
        Self(Compute::new(gpu, "view_setup", "view_setup", if fast { &["FAST"] } else { &[] }))
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
            ("lists", view.listed_in(scratch).as_entire_binding()),
        ]);
        self.0.record(gpu, encoder, rows(scene.triangles), &bindings);
    }
}
