//! light_gifts: what each light would give the picture if nothing stood between, so that lights are chosen for the view.
//!
//! Reads the eye vertices z1 and the lights. Runs once, and only where there are many lights.

use crate::gpu::{Compute, Gpu, GpuError, read_back, rows};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;

/// The pass.
pub struct LightGifts {
    compute: Compute,
    gifts: wgpu::Buffer,
    count: u32,
}

impl LightGifts {
    /// Builds the pipeline for so many lights.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str], count: u32) -> Self {
        let compute = Compute::new(gpu, "light_gifts", "light_gifts", flags);
        Self { compute, gifts: gpu.storage("light_gifts", u64::from(count) * 4), count }
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        strategy: &wgpu::Buffer,
    ) {
        let mut bindings = scene.with(&band.bindings());
        bindings.extend([("strategy", strategy.as_entire_binding()), ("light_gifts", self.gifts.as_entire_binding())]);
        self.compute.record(gpu, encoder, rows(self.count), &bindings);
    }

    /// What each light gives, in any unit, once the pass has run.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        read_back(gpu, &self.gifts, self.count as usize)
    }
}
