//! ray_queries: asks ray queries about many rays and edges at once; only tests and measurements run it.

use crate::acceleration::Acceleration;
use crate::gpu::{Compute, Gpu, rows};
use crate::gpu_scene::GpuScene;

/// The pass.
pub struct RayQueries(Compute);

impl RayQueries {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "ray_queries", "ray_queries", flags))
    }

    /// Records `count` questions; answers are two words each (see the shader).
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        acceleration: &Acceleration,
        count: u32,
        questions: &wgpu::Buffer,
        answers: &wgpu::Buffer,
    ) {
        let mut bindings = scene.with(&acceleration.bindings());
        bindings.extend([("questions", questions.as_entire_binding()), ("answers", answers.as_entire_binding())]);
        self.0.record(gpu, encoder, rows(count), &bindings);
    }
}
