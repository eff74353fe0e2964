//! Buffers per pixel of an iteration, and the uniform that all of its passes read.
//!
//! The image is rendered region by region ([`crate::render::interleave`]). Most buffers have the size of one
//! region, and all regions share them; each region has its own uniform and film.

use crate::film;
use crate::gpu::Gpu;
use crate::render::adaptive_sampling::ConvergedTiles;
use crate::render::interleave::Region;
use crate::render::layouts;
use crate::render::layouts::bundle_size::{BUNDLE_COLUMNS, BUNDLE_ROWS};
use crate::render::shared::plan::FramePlan;
use crate::render::upload::textures::upload_numbers;
use crate::settings::Settings;

/// Buffers per pixel that all regions share, and the buffers of each region.
pub struct PixelBuffers {
    classes: Vec<Vec<RegionBuffers>>,
    eye_vertices: wgpu::Buffer,
    radiance: wgpu::Buffer,
    /// Densities of bundle directions; empty if they are uniform.
    /// Densities of bundle directions, if these follow the environment map.
    bundle_pdfs: Option<wgpu::TextureView>,
    /// Converged tiles, if sampling is adaptive.
    pub converged: Option<ConvergedTiles>,
}

/// The buffers of one region.
struct RegionBuffers {
    region: Region,
    frame: wgpu::Buffer,
    /// Film of the region; None if frames have layers.
    film: Option<wgpu::Buffer>,
}

/// A region of the image, with the buffers that passes over its pixels bind.
pub struct Band<'a> {
    /// Position and size within the image.
    pub region: &'a Region,
    /// Columns and rows.
    pub size: [u32; 2],
    /// Uniform of the iteration: a `FrameUniform`.
    pub frame: &'a wgpu::Buffer,
    /// Sum and compensation per pixel, of all iterations; None if frames have layers.
    pub film: Option<&'a wgpu::Buffer>,
    pixels: &'a PixelBuffers,
}

impl PixelBuffers {
    /// Allocates the buffers of a plan.
    #[must_use]
    pub fn new(gpu: &Gpu, plan: &FramePlan, settings: &Settings, bundle_pdfs: Option<&[f32]>) -> Self {
        let (grid, glossy, transmits) = (&plan.grid, plan.glossy(), plan.transmits());
        let own = |region: Region| RegionBuffers {
            region,
            frame: gpu.uniform::<layouts::FrameUniform>("frame"),
            film: (!grid.layered).then(|| gpu.storage("film", region.pixels() * film::DEVICE_BYTES)),
        };
        let pixels = grid.largest();
        Self {
            classes: grid.classes().into_iter().map(|regions| regions.into_iter().map(own).collect()).collect(),
            eye_vertices: gpu.storage(
                "eye_vertices",
                pixels
                    * (layouts::EyeVertex::bytes(grid.layered && glossy, transmits, plan.caustics)
                        + layouts::Shading::bytes(&plan.surface_flags)),
            ),
            radiance: gpu.storage("radiance", pixels * if grid.layered { 48 } else { 16 }),
            bundle_pdfs: bundle_pdfs
                .map(|pdfs| upload_numbers(gpu, "bundle_pdfs", [BUNDLE_COLUMNS, BUNDLE_ROWS], pdfs)),
            converged: plan.skips_tiles.then(|| ConvergedTiles::new(gpu, settings)),
        }
    }

    /// Returns the bands of a class of pixels, from top to bottom.
    pub fn bands(&self, class: usize) -> impl Iterator<Item = Band<'_>> {
        self.classes[class].iter().map(|own| self.band(own))
    }

    /// Returns the topmost band of a class, for passes that run once per class.
    #[must_use]
    pub fn first(&self, class: usize) -> Band<'_> {
        self.band(&self.classes[class][0])
    }

    /// Returns the films of all bands, if there are any.
    pub fn films(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.classes.iter().flatten().filter_map(|own| own.film.as_ref())
    }

    fn band<'a>(&'a self, own: &'a RegionBuffers) -> Band<'a> {
        let RegionBuffers { region, frame, film } = own;
        Band { region, size: region.size, frame, film: film.as_ref(), pixels: self }
    }

    /// Writes the uniform of all bands of a class.
    pub fn write_uniform(&self, gpu: &Gpu, class: usize, frame: &layouts::FrameUniform) {
        for RegionBuffers { region, frame: uniform, .. } in &self.classes[class] {
            let Region { first, size: [columns, rows], stride, scale, layers } = *region;
            let frame = layouts::FrameUniform { first, columns, rows, stride, scale, layers, ..*frame };
            gpu.queue.write_buffer(uniform, 0, bytemuck::bytes_of(&frame));
        }
    }

    /// Returns the bytes of the buffers per pixel.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let films: u64 = self.films().map(wgpu::Buffer::size).sum();
        let converged = self.converged.as_ref().map_or(0, |converged| converged.words().size());
        films
            + converged
            + self.eye_vertices.size()
            + self.radiance.size()
            + self.bundle_pdfs.as_ref().map_or(0, |_| 4 * u64::from(BUNDLE_ROWS * BUNDLE_COLUMNS))
    }
}

impl Band<'_> {
    /// Returns the bindings that passes over pixels share.
    #[must_use]
    pub fn bindings(&self) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        let mut bindings = vec![
            ("frame", self.frame.as_entire_binding()),
            ("eye_vertices", self.pixels.eye_vertices.as_entire_binding()),
            ("radiance", self.pixels.radiance.as_entire_binding()),
        ];
        let pdfs = self.pixels.bundle_pdfs.iter();
        bindings.extend(pdfs.map(|pdfs| ("bundle_pdfs", wgpu::BindingResource::TextureView(pdfs))));
        bindings.extend(self.pixels.converged.iter().map(ConvergedTiles::binding));
        bindings
    }
}
