//! sky_guide: lines along which light of the sky reaches what the picture shows by way of another surface, and
//! the density over places that light subpaths from the sky follow.
//!
//! Reads: the eye vertices z1. Writes: the guide. Skipped when: there is no sky or no VPL, lists or depth
//! maps answer visibility, or the camera is outside the scene. Runs once a view.

use crate::gpu::{Compute, Flag, Gpu, GpuError, read_back_async, rows};
use crate::render::layouts::FoundLine;
use crate::render::lights::sky_guide::{EXTENT, HEIGHT, SIDE, densities};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::upload::textures::{texture, write_texture};

/// Paths that look for light.
const PATHS: u32 = 1 << 14;

/// Lines that they find at most.
const LINES: u32 = 2 * PATHS;

/// The pass and the guide.
pub struct SkyGuide {
    compute: Compute,
    found: wgpu::Buffer,
    texels: wgpu::Texture,
    /// The guide.
    pub view: wgpu::TextureView,
}

impl SkyGuide {
    /// Bytes of the lines and of the guide.
    pub const BYTES: u64 = LINES as u64 * size_of::<FoundLine>() as u64 + SIDE as u64 * HEIGHT as u64 * 4;

    /// Builds the pipeline and the guide.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag]) -> Self {
        let texels = texture(gpu, "sky_guide", wgpu::TextureFormat::R32Float, [SIDE, HEIGHT, 1]);
        Self {
            compute: Compute::new(gpu, "shared/light/sky_guide", flags),
            found: gpu.storage("found", u64::from(LINES) * size_of::<FoundLine>() as u64),
            view: texels.create_view(&Default::default()),
            texels,
        }
    }

    /// Forgets what was found.
    pub fn clear(&self, recording: &mut Recording) {
        recording.encoder.clear_buffer(&self.found, 0, None);
    }

    /// Records the pass for the paths that start in a band.
    pub fn record(&self, recording: &mut Recording, band: &Band) {
        let found = [("found", self.found.as_entire_binding())];
        recording.run(&self.compute, rows(PATHS), &[&band.bindings(), &found]);
    }

    /// Makes the guide of what was found, once the pass has run.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn update(&self, gpu: &Gpu, scene: &GpuScene) -> Result<(), GpuError> {
        let found: Vec<FoundLine> = read_back_async(gpu, &self.found, LINES as usize).await?;
        let half = 0.5 * (scene.bounds[1] - scene.bounds[0]) / (EXTENT * scene.sphere().1);
        let densities = densities(&found, half);
        write_texture(gpu, &self.texels, [0, 0, 0], [SIDE, HEIGHT], 4, bytemuck::cast_slice(&densities));
        Ok(())
    }
}
