//! queries: asks a view about many points at once; only tests and measurements run it.

use crate::gpu::{Compute, Gpu, rows};
use crate::gpu_scene::GpuScene;
use crate::view::ViewBuffers;

/// The pass.
pub struct Queries(Compute);

impl Queries {
    /// Builds the pipeline, for views that keep outlines.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "queries", "queries", &[flags, &["OUTLINES", "AFAR"]].concat()))
    }

    /// Records `count` questions; answers are two words each (see the shader).
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        view: &ViewBuffers,
        count: u32,
        questions: &wgpu::Buffer,
        answers: &wgpu::Buffer,
    ) {
        let mut bindings = scene.with(&view.bindings());
        bindings.extend([("questions", questions.as_entire_binding()), ("answers", answers.as_entire_binding())]);
        self.0.record(gpu, encoder, rows(count), &bindings);
    }
}
