//! Commands of one submission: passes are recorded with the scene's bindings and their own.

use crate::gpu::{Binding, Compute, Gpu};
use crate::render::upload::gpu_scene::GpuScene;

/// Commands that are being recorded for a scene.
pub struct Recording<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene.
    pub scene: &'a GpuScene,
    /// The commands so far.
    pub encoder: wgpu::CommandEncoder,
}

impl<'a> Recording<'a> {
    /// Begins a submission; `label` names it in debuggers.
    #[must_use]
    pub fn new(gpu: &'a Gpu, scene: &'a GpuScene, label: &str) -> Self {
        let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        Self { gpu, scene, encoder }
    }

    /// Records a pass over at least `threads` columns and rows, with the scene's bindings and those of
    /// `inputs`. A shader ignores names that it does not declare.
    pub fn run(&mut self, pass: &Compute, threads: [u32; 2], inputs: &[&[Binding]]) {
        let bindings = self.scene.with(&inputs.concat());
        pass.record(self.gpu, &mut self.encoder, threads, &bindings);
    }

    /// Submits the commands.
    pub fn submit(self) {
        self.gpu.queue.submit([self.encoder.finish()]);
    }
}
