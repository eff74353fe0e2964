//! What an iteration keeps per pixel, and the uniform that all of its passes read.
//!
//! The image is made band by band: views are filled once for all bands, and what is kept per pixel is kept for one.

use crate::gpu::Gpu;
use crate::layouts;

/// Buffers per pixel of a band, and those that are each band's own.
pub struct PixelBuffers {
    width: u32,
    bands: Vec<Own>,
    eye_vertices: wgpu::Buffer,
    shadings: wgpu::Buffer,
    radiance: wgpu::Buffer,
    /// Densities of the bundles' directions, where they are not even.
    bundle_pdfs: wgpu::Buffer,
}

/// What each band has.
struct Own {
    first_row: u32,
    rows: u32,
    frame: wgpu::Buffer,
    film: wgpu::Buffer,
}

/// Whole rows of the image, as passes see them. `eye_vertices` starts them; `connect` and `extend` go on.
pub struct Band<'a> {
    /// Columns and rows.
    pub size: [u32; 2],
    /// What the iteration shares: a `Frame`.
    pub frame: &'a wgpu::Buffer,
    /// Sum and compensation per pixel, of all iterations.
    pub film: &'a wgpu::Buffer,
    pixels: &'a PixelBuffers,
}

impl PixelBuffers {
    /// Allocates for an image in bands of so many rows.
    #[must_use]
    pub fn new(gpu: &Gpu, [width, height]: [u32; 2], band_rows: u32, glossy: bool, bundle_pdfs: &[f32]) -> Self {
        let (height, band_rows) = (height.max(1), band_rows.clamp(1, height.max(1)));
        let own = |first_row: u32| {
            let rows = band_rows.min(height - first_row);
            let film = gpu.storage("film", u64::from(width) * u64::from(rows) * 32);
            Own { first_row, rows, frame: gpu.uniform::<layouts::Frame>("frame"), film }
        };
        let pixels = u64::from(width) * u64::from(band_rows);
        Self {
            width,
            bands: (0..height).step_by(band_rows as usize).map(own).collect(),
            eye_vertices: gpu.storage("eye_vertices", pixels * size_of::<layouts::EyeVertex>() as u64),
            shadings: gpu.storage("shadings", pixels * layouts::Shading::bytes(glossy)),
            radiance: gpu.storage("radiance", pixels * 16),
            bundle_pdfs: gpu.upload("bundle_pdfs", bundle_pdfs),
        }
    }

    /// The bands from the top; at least one.
    pub fn bands(&self) -> impl Iterator<Item = Band<'_>> {
        self.bands.iter().map(|own| self.band(own))
    }

    /// The topmost, for passes that run once for all.
    #[must_use]
    pub fn first(&self) -> Band<'_> {
        self.band(&self.bands[0])
    }

    fn band<'a>(&'a self, own: &'a Own) -> Band<'a> {
        Band { size: [self.width, own.rows], frame: &own.frame, film: &own.film, pixels: self }
    }

    /// Tells all bands what the iteration shares.
    pub fn describe(&self, gpu: &Gpu, frame: &layouts::Frame) {
        for Own { first_row, rows, frame: uniform, .. } in &self.bands {
            let frame = layouts::Frame { first_row: *first_row, rows: *rows, ..*frame };
            gpu.queue.write_buffer(uniform, 0, bytemuck::bytes_of(&frame));
        }
    }

    /// Bytes of the buffers per pixel.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let films: u64 = self.bands.iter().map(|own| own.film.size()).sum();
        films + self.eye_vertices.size() + self.shadings.size() + self.radiance.size() + self.bundle_pdfs.size()
    }
}

impl Band<'_> {
    /// The bindings that passes over pixels share.
    #[must_use]
    pub fn bindings(&self) -> [(&str, wgpu::BindingResource<'_>); 5] {
        [
            ("frame", self.frame.as_entire_binding()),
            ("eye_vertices", self.pixels.eye_vertices.as_entire_binding()),
            ("shadings", self.pixels.shadings.as_entire_binding()),
            ("radiance", self.pixels.radiance.as_entire_binding()),
            ("bundle_pdfs", self.pixels.bundle_pdfs.as_entire_binding()),
        ]
    }
}
