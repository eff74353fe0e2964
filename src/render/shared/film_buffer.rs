//! Buffers per pixel of an iteration, and the uniform that all of its passes read.
//!
//! The image is rendered band by band ([`crate::render::interleave`]). Most buffers have the size of one
//! band, and all bands share them; each band has its own uniforms and film.

use crate::film;
use crate::gpu::Gpu;
use crate::render::adaptive_sampling::ConvergedTiles;
use crate::render::interleave::Region;
use crate::render::layouts::bundle_size::{BUNDLE_COLUMNS, BUNDLE_ROWS};
use crate::render::layouts::classes::MOST_TOGETHER;
use crate::render::layouts::{self, FrameUniform};
use crate::render::shared::plan::FramePlan;
use crate::render::upload::textures::upload_numbers;
use crate::settings::Settings;

/// Bytes of a uniform.
const FRAME_BYTES: u64 = size_of::<FrameUniform>() as u64;

// A part of a uniform begins at a multiple of this.
const _: () = assert!(FRAME_BYTES.is_multiple_of(256));

/// Buffers per pixel that all bands share, and the buffers of each band.
pub struct PixelBuffers {
    /// The bands of each group of classes that are rendered together.
    groups: Vec<Vec<BandBuffers>>,
    /// Classes of a group, at most.
    together: usize,
    /// Light points for which each of them has room.
    light_point_room: u32,
    eye_vertices: wgpu::Buffer,
    radiance: wgpu::Buffer,
    /// Densities of bundle directions; empty if they are uniform.
    /// Densities of bundle directions, if these follow the environment map.
    bundle_pdfs: Option<wgpu::TextureView>,
    /// Converged tiles, if sampling is adaptive.
    pub converged: Option<ConvergedTiles>,
}

/// The buffers of one band.
struct BandBuffers {
    /// The region of each class.
    regions: Vec<Region>,
    /// A [`FrameUniform`] for each class.
    frames: wgpu::Buffer,
    /// Film; None if frames have layers.
    film: Option<wgpu::Buffer>,
}

/// Regions of the image, one for each of some classes, with the buffers that passes over their pixels bind.
pub struct Band<'a> {
    /// Columns and rows of the largest region.
    pub size: [u32; 2],
    /// The number of classes.
    pub classes: u32,
    /// The region of the first class.
    pub region: &'a Region,
    /// Sum and compensation per pixel, of all iterations; None if frames have layers.
    pub film: Option<&'a wgpu::Buffer>,
    frames: &'a wgpu::Buffer,
    /// The class of passes that take one alone, among those of the band.
    pub slot: u64,
    pixels: &'a PixelBuffers,
}

impl PixelBuffers {
    /// Allocates the buffers of a plan.
    #[must_use]
    pub fn new(gpu: &Gpu, plan: &FramePlan, settings: &Settings, bundle_pdfs: Option<&[f32]>) -> Self {
        let (grid, glossy, transmits) = (&plan.grid, plan.glossy(), plan.transmits());
        let own = |regions: Vec<Region>| BandBuffers {
            frames: gpu.storage("frames", u64::from(MOST_TOGETHER) * FRAME_BYTES),
            film: (!grid.layered)
                .then(|| gpu.storage("film", regions.iter().map(Region::pixels).sum::<u64>() * film::DEVICE_BYTES)),
            regions,
        };
        let pixels = grid.largest();
        Self {
            groups: grid.bands().into_iter().map(|bands| bands.into_iter().map(own).collect()).collect(),
            together: grid.together as usize,
            light_point_room: plan.light_point_room(),
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

    /// Returns the bands of a group of classes, from top to bottom.
    pub fn bands(&self, group: usize) -> impl Iterator<Item = Band<'_>> {
        self.groups[group].iter().map(|own| self.band(own, 0))
    }

    /// Returns the bands of the first class alone.
    pub fn bands_of_first_class(&self) -> impl Iterator<Item = Band<'_>> {
        self.bands(0).map(|band| Band { classes: 1, ..band })
    }

    /// Returns the topmost band of a class, for passes that take the uniform of a class.
    #[must_use]
    pub fn first(&self, class: usize) -> Band<'_> {
        self.band(&self.groups[class / self.together][0], class % self.together)
    }

    /// Returns the group of light that is not filtered, at the resolution of the image.
    #[must_use]
    pub fn clear(&self) -> usize {
        self.groups.len() - 1
    }

    /// Returns the films of all bands, if there are any.
    pub fn films(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.groups.iter().flatten().filter_map(|own| own.film.as_ref())
    }

    fn band<'a>(&'a self, own: &'a BandBuffers, slot: usize) -> Band<'a> {
        let BandBuffers { regions, frames, film } = own;
        Band {
            size: [0, 1].map(|axis| regions.iter().map(|region| region.size[axis]).max().unwrap_or(0)),
            classes: regions.len() as u32,
            region: &regions[0],
            film: film.as_ref(),
            frames,
            slot: slot as u64,
            pixels: self,
        }
    }

    /// Writes the uniform of all bands of a class.
    pub fn write_uniform(&self, gpu: &Gpu, class: usize, frame: &FrameUniform) {
        self.write_slot(gpu, class / self.together, class % self.together, frame);
    }

    /// Writes the uniform of light that is not filtered.
    pub fn write_clear_uniform(&self, gpu: &Gpu, frame: &FrameUniform) {
        self.write_slot(gpu, self.clear(), 0, frame);
    }

    fn write_slot(&self, gpu: &Gpu, group: usize, slot: usize, frame: &FrameUniform) {
        for BandBuffers { regions, frames, .. } in &self.groups[group] {
            let Region { first, size: [columns, rows], stride, scale, layers } = regions[slot];
            let offset = regions[..slot].iter().map(Region::pixels).sum::<u64>() as u32;
            let at = slot as u64 * FRAME_BYTES;
            let slot = slot as u32;
            let first_light_point = slot * self.light_point_room;
            let place =
                FrameUniform { first, columns, rows, stride, scale, layers, offset, slot, first_light_point, ..*frame };
            gpu.queue.write_buffer(frames, at, bytemuck::bytes_of(&place));
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

impl<'a> Band<'a> {
    /// Returns the uniform of one class, a [`FrameUniform`].
    #[must_use]
    pub fn frame(&self) -> wgpu::BindingResource<'a> {
        let (offset, size) = (self.slot * FRAME_BYTES, wgpu::BufferSize::new(FRAME_BYTES));
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: self.frames, offset, size })
    }

    /// Returns the bindings that passes over pixels share.
    #[must_use]
    pub fn bindings(&self) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        let mut bindings = vec![
            ("frame", self.frame()),
            ("frames", self.frames.as_entire_binding()),
            ("eye_vertices", self.pixels.eye_vertices.as_entire_binding()),
            ("radiance", self.pixels.radiance.as_entire_binding()),
        ];
        let pdfs = self.pixels.bundle_pdfs.iter();
        bindings.extend(pdfs.map(|pdfs| ("bundle_pdfs", wgpu::BindingResource::TextureView(pdfs))));
        bindings.extend(self.pixels.converged.iter().map(ConvergedTiles::binding));
        bindings
    }
}
