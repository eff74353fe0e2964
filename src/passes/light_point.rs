//! light_point: y0, where the iteration's light subpath starts, and the view from there.
//!
//! Reads the lights. Skipped while a light without extent stays the same.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::layouts;
use crate::view::ViewBuffers;

/// The pass.
pub struct LightPoint {
    compute: Compute,
    /// y0.
    pub y0: wgpu::Buffer,
}

impl LightPoint {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        let y0 = gpu.storage("y0", size_of::<layouts::LightPoint>() as u64);
        Self { compute: Compute::new(gpu, "light_point", "light_point", flags), y0 }
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        frame: &wgpu::Buffer,
        next: &ViewBuffers,
    ) {
        let bindings = scene.with(&[
            ("frame", frame.as_entire_binding()),
            ("y0", self.y0.as_entire_binding()),
            ("next_view", next.view.as_entire_binding()),
        ]);
        self.compute.record(gpu, encoder, [1, 1], &bindings);
    }
}
