//! What an iteration keeps per pixel, and the uniform that all of its passes read.

use crate::gpu::Gpu;
use crate::layouts;

/// Buffers per pixel. `eye_vertices` starts them; `connect` and `extend` go on.
pub struct PixelBuffers {
    /// Columns and rows.
    pub size: [u32; 2],
    /// What the iteration shares: a `Frame`.
    pub frame: wgpu::Buffer,
    /// z_j: an `EyeVertex` each.
    pub eye_vertices: wgpu::Buffer,
    /// The surface at z_j: a `Shading` each.
    pub shadings: wgpu::Buffer,
    /// The iteration's image.
    pub radiance: wgpu::Buffer,
    /// Densities of the bundles' directions, where they are not even.
    bundle_pdfs: wgpu::Buffer,
}

impl PixelBuffers {
    /// Allocates for an image.
    #[must_use]
    pub fn new(gpu: &Gpu, size: [u32; 2], glossy: bool, bundle_pdfs: &[f32]) -> Self {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        Self {
            size,
            frame: gpu.uniform::<layouts::Frame>("frame"),
            eye_vertices: gpu.storage("eye_vertices", pixels * size_of::<layouts::EyeVertex>() as u64),
            shadings: gpu.storage("shadings", pixels * layouts::Shading::bytes(glossy)),
            radiance: gpu.storage("radiance", pixels * 16),
            bundle_pdfs: gpu.upload("bundle_pdfs", bundle_pdfs),
        }
    }

    /// The bindings that passes over pixels share.
    #[must_use]
    pub fn bindings(&self) -> [(&str, wgpu::BindingResource<'_>); 5] {
        [
            ("frame", self.frame.as_entire_binding()),
            ("eye_vertices", self.eye_vertices.as_entire_binding()),
            ("shadings", self.shadings.as_entire_binding()),
            ("radiance", self.radiance.as_entire_binding()),
            ("bundle_pdfs", self.bundle_pdfs.as_entire_binding()),
        ]
    }

    /// Bytes of the buffers per pixel.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.eye_vertices.size() + self.shadings.size() + self.radiance.size() + self.bundle_pdfs.size()
    }
}
