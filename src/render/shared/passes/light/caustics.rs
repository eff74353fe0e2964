//! caustics: light paths by way of mirrors and clear glass, splatted to the pixels that show where they arrive.
//!
//! Reads: the scene and its lights. Writes: splats, which pass accumulate adds. Skipped when: nothing is
//! smooth.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::shared::strategy_uniforms::StrategyUniforms;

/// The pass, and what it adds to each pixel of the image.
pub struct Caustics {
    compute: Compute,
    strategy: StrategyUniforms,
    /// Sums per pixel of the image (shaders/lib/pixels/splats.wesl).
    pub splats: wgpu::Buffer,
}

impl Caustics {
    /// Bytes per pixel of the image.
    pub const BYTES: u64 = 24;

    /// Builds the pipeline, and allocates the sums of an image of a number of pixels. `strategy` says which
    /// strategies (s, 1) count.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], strategy: StrategyUniforms, pixels: u64) -> Self {
        let splats = gpu.storage("splats", pixels * Self::BYTES);
        Self { compute: Compute::new(gpu, "shared/light/caustics", flags), strategy, splats }
    }

    /// Records the pass for an image of `size` columns and rows. `band` holds the frame's uniform. Sums of an
    /// iteration that was not accumulated are lost.
    pub fn record(&self, recording: &mut Recording, band: &Band, size: [u32; 2], log: &wgpu::Buffer) {
        recording.encoder.clear_buffer(&self.splats, 0, None);
        let buffers = [
            ("strategy", self.strategy.of(0)),
            ("splats", self.splats.as_entire_binding()),
            ("log", log.as_entire_binding()),
        ];
        recording.run(&self.compute, size, &[&band.bindings(), &buffers]);
    }
}
