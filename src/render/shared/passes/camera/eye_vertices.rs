//! eye_vertices: z1 of every pixel, exactly, and the emission that the camera sees: strategies (0, 2).
//!
//! Reads: the G-buffer and the borders, unless rays find the triangles, and the converged tiles. Writes: the eye vertices, the
//! iteration's image, and the guides of the denoiser.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;

/// The pass.
pub struct EyeVertices(Compute);

impl EyeVertices {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag]) -> Self {
        Self(Compute::new(gpu, "shared/camera/eye_vertices", flags))
    }

    /// Records the pass. `rasterized` are the targets of gbuffer and, if it runs, borders. `guides` are those of a frame that is
    /// denoised, `seen_light` is what pass seen_light found.
    pub fn record(
        &self,
        recording: &mut Recording,
        band: &Band,
        rasterized: &[&wgpu::TextureView],
        guides: Option<&wgpu::Buffer>,
        seen_light: Option<&wgpu::Buffer>,
    ) {
        let named = ["gbuffer", "borders"].into_iter().zip(rasterized);
        let rasterized: Vec<_> = named.map(|(name, view)| (name, wgpu::BindingResource::TextureView(view))).collect();
        let guides: Vec<_> = guides.iter().map(|guides| ("guides", guides.as_entire_binding())).collect();
        let seen: Vec<_> = seen_light.iter().map(|seen| ("seen_light", seen.as_entire_binding())).collect();
        recording.run_layers(&self.0, band.size, band.classes, &[&rasterized, &band.bindings(), &guides, &seen]);
    }
}
