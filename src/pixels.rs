//! What an iteration keeps per pixel, and the uniform that all of its passes read.
//!
//! The image is made region by region ([`crate::grid`]): what is kept per pixel is kept for one.

use crate::film;
use crate::gpu::Gpu;
use crate::grid::{Grid, Region};
use crate::layouts;
use crate::tiles::Settled;

/// Buffers per pixel of a region, and those that are each region's own.
pub struct PixelBuffers {
    classes: Vec<Vec<Own>>,
    eye_vertices: wgpu::Buffer,
    shadings: wgpu::Buffer,
    radiance: wgpu::Buffer,
    /// Densities of the bundles' directions, where they are not even.
    bundle_pdfs: wgpu::Buffer,
    /// Where tiles may settle.
    pub settled: Option<Settled>,
}

/// What each region has.
struct Own {
    region: Region,
    frame: wgpu::Buffer,
    /// None where frames have layers.
    film: Option<wgpu::Buffer>,
}

/// A region of the image, as passes see it. `eye_vertices` starts its pixels; `connect` and `extend` go on.
pub struct Band<'a> {
    /// Where it lies.
    pub region: &'a Region,
    /// Columns and rows.
    pub size: [u32; 2],
    /// What the iteration shares: a `Frame`.
    pub frame: &'a wgpu::Buffer,
    /// Sum and compensation per pixel, of all iterations; none where frames have layers.
    pub film: Option<&'a wgpu::Buffer>,
    pixels: &'a PixelBuffers,
}

impl PixelBuffers {
    /// Allocates for an image that is divided so.
    #[must_use]
    pub fn new(gpu: &Gpu, grid: &Grid, glossy: bool, bundle_pdfs: &[f32], settles: bool) -> Self {
        let own = |region: Region| Own {
            region,
            frame: gpu.uniform::<layouts::Frame>("frame"),
            film: (!grid.layered).then(|| gpu.storage("film", region.pixels() * film::DEVICE_BYTES)),
        };
        let pixels = grid.largest();
        Self {
            classes: grid.classes().into_iter().map(|regions| regions.into_iter().map(own).collect()).collect(),
            eye_vertices: gpu.storage("eye_vertices", pixels * layouts::EyeVertex::bytes(grid.layered && glossy)),
            shadings: gpu.storage("shadings", pixels * layouts::Shading::bytes(glossy)),
            radiance: gpu.storage("radiance", pixels * if grid.layered { 48 } else { 16 }),
            bundle_pdfs: gpu.upload("bundle_pdfs", bundle_pdfs),
            settled: settles.then(|| Settled::new(gpu, grid.size[0], grid.size[1])),
        }
    }

    /// The bands of a class of pixels, from the top.
    pub fn bands(&self, class: usize) -> impl Iterator<Item = Band<'_>> {
        self.classes[class].iter().map(|own| self.band(own))
    }

    /// The topmost band of a class, for passes that run once for all.
    #[must_use]
    pub fn first(&self, class: usize) -> Band<'_> {
        self.band(&self.classes[class][0])
    }

    /// The films of all bands from the top, where there are any.
    pub fn films(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.classes.iter().flatten().filter_map(|own| own.film.as_ref())
    }

    fn band<'a>(&'a self, own: &'a Own) -> Band<'a> {
        let Own { region, frame, film } = own;
        Band { region, size: region.size, frame, film: film.as_ref(), pixels: self }
    }

    /// Tells all bands of a class what the iteration shares.
    pub fn describe(&self, gpu: &Gpu, class: usize, frame: &layouts::Frame) {
        for Own { region, frame: uniform, .. } in &self.classes[class] {
            let Region { first, size: [columns, rows], stride, scale, layers } = *region;
            let frame = layouts::Frame { first, columns, rows, stride, scale, layers, ..*frame };
            gpu.queue.write_buffer(uniform, 0, bytemuck::bytes_of(&frame));
        }
    }

    /// Bytes of the buffers per pixel.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let films: u64 = self.films().map(wgpu::Buffer::size).sum();
        let settled = self.settled.as_ref().map_or(0, |settled| settled.words().size());
        films
            + settled
            + self.eye_vertices.size()
            + self.shadings.size()
            + self.radiance.size()
            + self.bundle_pdfs.size()
    }
}

impl Band<'_> {
    /// The bindings that passes over pixels share.
    #[must_use]
    pub fn bindings(&self) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        let mut bindings = vec![
            ("frame", self.frame.as_entire_binding()),
            ("eye_vertices", self.pixels.eye_vertices.as_entire_binding()),
            ("shadings", self.pixels.shadings.as_entire_binding()),
            ("radiance", self.pixels.radiance.as_entire_binding()),
            ("bundle_pdfs", self.pixels.bundle_pdfs.as_entire_binding()),
        ];
        bindings.extend(self.pixels.settled.iter().map(Settled::binding));
        bindings
    }
}
