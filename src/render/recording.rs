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
    label: &'static str,
}

impl<'a> Recording<'a> {
    /// Begins a submission; `label` names it in debuggers.
    #[must_use]
    pub fn new(gpu: &'a Gpu, scene: &'a GpuScene, label: &'static str) -> Self {
        let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        Self { gpu, scene, encoder, label }
    }

    /// Records a pass over at least `threads` columns and rows, with the scene's bindings and those of
    /// `inputs`. A shader ignores names that it does not declare.
    pub fn run(&mut self, pass: &Compute, threads: [u32; 2], inputs: &[&[Binding]]) {
        self.run_layers(pass, threads, 1, inputs);
    }

    /// As [`Self::run`], once for each layer.
    pub fn run_layers(&mut self, pass: &Compute, threads: [u32; 2], layers: u32, inputs: &[&[Binding]]) {
        let bindings = self.scene.with(&inputs.concat());
        pass.record_layers(self.gpu, &mut self.encoder, threads, layers, &bindings);
    }

    /// Submits the commands so far, so that what they read can be written again.
    pub fn flush(&mut self) {
        let next = Self::new(self.gpu, self.scene, self.label);
        std::mem::replace(self, next).submit();
    }

    /// Submits the commands.
    pub fn submit(self) {
        self.gpu.queue.submit([self.encoder.finish()]);
    }
}
