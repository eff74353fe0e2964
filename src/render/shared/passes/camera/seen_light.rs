//! seen_light: how bright the light is that the camera sees emit, at the middle of each pixel.
//!
//! Reads: the scene. Writes: a number per pixel of the image, by which eye_vertices finds the borders of lights. Skipped when: the camera
//! sees no light, pictures are not interleaved, or the G-buffer holds what it sees. Runs once a view.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;

/// The pass.
pub struct SeenLight {
    compute: Compute,
    size: [u32; 2],
    /// A number per pixel of the image.
    pub seen: wgpu::Buffer,
}

impl SeenLight {
    /// Bytes per pixel of the image.
    pub const BYTES: u64 = 4;

    /// Builds the pipeline, for an image of `size` columns and rows.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], size: [u32; 2]) -> Self {
        let pixels: u64 = size.iter().map(|&side| u64::from(side)).product();
        Self {
            compute: Compute::new(gpu, "shared/camera/seen_light", flags),
            size,
            seen: gpu.storage("seen_light", pixels * Self::BYTES),
        }
    }

    /// Records the pass. `band` holds the frame's uniform.
    pub fn record(&self, recording: &mut Recording, band: &Band) {
        let seen = [("seen_light", self.seen.as_entire_binding())];
        recording.run(&self.compute, self.size, &[&band.bindings(), &seen]);
    }
}
