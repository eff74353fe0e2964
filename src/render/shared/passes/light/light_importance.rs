//! light_importance: the contribution of each light to the picture without occlusion, so that lights are
//! chosen for the view.
//!
//! Reads: the eye vertices z1 and the lights. Writes: a number for each light. Skipped when: lights are few.
//! Runs once a view.

use crate::gpu::{Compute, Flag, Gpu, GpuError, read_back_async, rows};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;

/// The pass.
pub struct LightImportance {
    compute: Compute,
    importance: wgpu::Buffer,
    count: u32,
}

impl LightImportance {
    /// Builds the pipeline for a number of lights.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], count: u32) -> Self {
        let compute = Compute::new(gpu, "shared/light/light_importance", flags);
        Self { compute, importance: gpu.storage("light_importance", u64::from(count) * 4), count }
    }

    /// Records the pass.
    pub fn record(&self, recording: &mut Recording, band: &Band, strategy: wgpu::BindingResource) {
        let buffers = [("strategy", strategy), ("light_importance", self.importance.as_entire_binding())];
        recording.run(&self.compute, rows(self.count), &[&band.bindings(), &buffers]);
    }

    /// Reads the importance of each light, in any unit, once the pass has run.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn read(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        read_back_async(gpu, &self.importance, self.count as usize).await
    }
}
