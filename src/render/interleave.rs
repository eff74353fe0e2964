//! Divides the image into classes of pixels that share a light subpath, and into bands that are rendered one
//! after the other.
//!
//! Without interleaved sampling all pixels are one class. With it, a class is every n-th pixel of every n-th
//! row, and each of the n^2 classes has a light subpath and views of its own. A class is divided into bands
//! of whole rows.

use crate::render::layouts::layer::{CLEAR, INDIRECT};

/// The division of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Grid {
    /// Columns and rows of the image.
    pub size: [u32; 2],
    /// True if frames have layers, which are denoised, instead of a film.
    pub layered: bool,
    /// Layer pixels along a side of the squares of interleaved sampling; each pixel of a square is of another
    /// class.
    pub side: u32,
    /// Image pixels along a side of a layer pixel.
    pub scale: u32,
    /// Most pixels of a band; a band has at least one row.
    pub band_pixels: u32,
}

/// Every `stride`-th pixel of every `stride`-th row of a part of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First pixel, in pixels of the image.
    pub first: [u32; 2],
    /// Columns and rows of the region.
    pub size: [u32; 2],
    /// Distance of neighbours, in pixels of the image.
    pub stride: u32,
    /// Image pixels along a side of a pixel of the layer that it writes.
    pub scale: u32,
    /// Layers that it writes: [`CLEAR`], [`INDIRECT`] or both.
    pub layers: u32,
}

impl Region {
    /// Returns the number of pixels.
    #[must_use]
    pub fn pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

impl Grid {
    /// Returns the grid of an image whose pixels all share a light subpath.
    #[must_use]
    pub const fn undivided(size: [u32; 2], scale: u32) -> Self {
        Self { size, layered: false, side: 1, scale, band_pixels: 0 }
    }

    /// Returns the number of light subpaths of an iteration.
    #[must_use]
    pub fn subpaths(&self) -> u32 {
        self.side * self.side
    }

    /// Returns the bands of each class, one class per light subpath. If layers are coarser than the image, a
    /// last class follows for the light that is not filtered, at the resolution of the image.
    #[must_use]
    pub fn classes(&self) -> Vec<Vec<Region>> {
        let Self { side, scale, .. } = *self;
        let both = if scale == 1 { CLEAR | INDIRECT } else { INDIRECT };
        let of = |class: u32| [class % side, class / side].map(|at| at * scale + scale / 2);
        let mut classes: Vec<_> =
            (0..self.subpaths()).map(|class| self.class(of(class), side * scale, scale, both)).collect();
        if scale > 1 {
            classes.push(self.class([0, 0], 1, 1, CLEAR));
        }
        classes
    }

    /// Divides a class into bands.
    fn class(&self, first: [u32; 2], stride: u32, scale: u32, layers: u32) -> Vec<Region> {
        let steps = |side: u32, first: u32| side.saturating_sub(first).div_ceil(stride);
        let [columns, rows] = [0, 1].map(|axis| steps(self.size[axis], first[axis]));
        let band = (self.band_pixels / columns.max(1)).max(1);
        let regions = (0..rows.max(1)).step_by(band as usize);
        regions
            .map(|row| Region {
                first: [first[0], first[1] + row * stride],
                size: [columns, band.min(rows - row.min(rows))],
                stride,
                scale,
                layers,
            })
            .collect()
    }

    /// Returns the columns and rows of the layers.
    #[must_use]
    pub fn layer(&self) -> [u32; 2] {
        self.size.map(|side| side.div_ceil(self.scale))
    }

    /// Returns the columns and rows of the squares of interleaved sampling.
    #[must_use]
    pub fn squares(&self) -> [u32; 2] {
        self.layer().map(|side| side.div_ceil(self.side))
    }

    /// Returns the number of pixels of the largest region.
    #[must_use]
    pub fn largest(&self) -> u64 {
        self.classes().iter().flatten().map(Region::pixels).max().unwrap_or(0).max(1)
    }

    /// Returns the numbers of regions with a light subpath and of regions for unfiltered light alone.
    #[must_use]
    pub fn regions(&self) -> [u32; 2] {
        let classes = self.classes();
        let (own, clear) = classes.split_at(self.subpaths() as usize);
        [own, clear].map(|classes| classes.iter().map(Vec::len).sum::<usize>() as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pixel of each layer is in one region, and no region is larger than `band_pixels` or one row.
    #[test]
    fn regions_cover_each_layer_once() {
        for (size, side, scale, band_pixels) in [
            ([40, 33], 1, 1, 1 << 18),
            ([40, 33], 1, 1, 100),
            ([37, 23], 4, 1, 60),
            ([64, 48], 2, 4, 1 << 18),
            ([3, 2], 4, 1, 1),
        ] {
            let grid = Grid { size, layered: side * scale > 1, side, scale, band_pixels };
            let mut seen = vec![[0; 2]; (size[0] * size[1]) as usize];
            for region in grid.classes().iter().flatten() {
                assert!(region.pixels() <= u64::from(band_pixels.max(region.size[0])), "{region:?}");
                for n in 0..region.pixels() as u32 {
                    let [x, y] = [n % region.size[0], n / region.size[0]];
                    let at = [region.first[0] + x * region.stride, region.first[1] + y * region.stride];
                    let seen = &mut seen[(at[1] * size[0] + at[0]) as usize];
                    seen[0] += region.layers & CLEAR;
                    seen[1] += (region.layers & INDIRECT) / INDIRECT;
                }
            }
            assert!(seen.iter().all(|s| s[0] == 1), "{grid:?}");
            let [columns, rows] = grid.size.map(|side| (side - scale / 2).div_ceil(scale));
            assert_eq!(seen.iter().map(|s| s[1]).sum::<u32>(), columns * rows, "{grid:?}");
            assert!(seen.iter().all(|s| s[1] <= 1));
        }
    }
}
