//! Divides the image into classes of pixels that share a light subpath, and into bands that are rendered one
//! after the other.
//!
//! Without interleaved sampling all pixels are one class. With it, a class is every n-th pixel of every n-th
//! row, and each of the n^2 classes has a light subpath and views of its own. A class is divided into bands
//! of whole rows. Where rays answer for every view, the bands of several classes are rendered by the same dispatches.

use std::ops::Range;

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
    /// Most pixels of a band; a band has at least one row of each of its classes.
    pub band_pixels: u32,
    /// Classes that dispatches render together, at most.
    pub together: u32,
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
        Self { size, layered: false, side: 1, scale, band_pixels: 0, together: 1 }
    }

    /// Returns the number of light subpaths of an iteration.
    #[must_use]
    pub fn subpaths(&self) -> u32 {
        self.side * self.side
    }

    /// Returns the classes that are rendered together, group by group; there is one class per light subpath.
    #[must_use]
    pub fn groups(&self) -> Vec<Range<u32>> {
        let classes = 0..self.subpaths();
        let together = self.together;
        classes.clone().step_by(together as usize).map(|first| first..(first + together).min(classes.end)).collect()
    }

    /// Returns the bands of each group, and the regions of a band, one for each class. If layers are coarser than the
    /// image, a last group follows for the light that is not filtered, at the resolution of the image.
    #[must_use]
    pub fn bands(&self) -> Vec<Vec<Vec<Region>>> {
        let Self { side, scale, .. } = *self;
        let both = if scale == 1 { CLEAR | INDIRECT } else { INDIRECT };
        let of = |class: u32| {
            let first = [class % side, class / side].map(|at| at * scale + scale / 2);
            self.class(first, side * scale, scale, both)
        };
        let mut groups: Vec<_> =
            self.groups().into_iter().map(|group| self.divided(&group.map(of).collect::<Vec<_>>())).collect();
        if scale > 1 {
            groups.push(self.divided(&[self.class([0, 0], 1, 1, CLEAR)]));
        }
        groups
    }

    /// Returns all pixels of a class.
    fn class(&self, first: [u32; 2], stride: u32, scale: u32, layers: u32) -> Region {
        let steps = |side: u32, first: u32| side.saturating_sub(first).div_ceil(stride);
        Region { first, size: [0, 1].map(|axis| steps(self.size[axis], first[axis])), stride, scale, layers }
    }

    /// Divides the classes of a group into bands, the same rows of each.
    fn divided(&self, classes: &[Region]) -> Vec<Vec<Region>> {
        let columns: u32 = classes.iter().map(|class| class.size[0]).sum();
        let rows = classes.iter().map(|class| class.size[1]).max().unwrap_or(0);
        let fits = classes.iter().map(Region::pixels).sum::<u64>() <= u64::from(self.band_pixels);
        let most = if fits { rows.max(1) } else { (self.band_pixels / columns.max(1)).max(1) };
        let band = |row: u32| {
            let part = |class: &Region| Region {
                first: [class.first[0], class.first[1] + row * class.stride],
                size: [class.size[0], most.min(class.size[1].saturating_sub(row))],
                ..*class
            };
            classes.iter().map(part).collect()
        };
        (0..rows.max(1)).step_by(most as usize).map(band).collect()
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

    /// Returns the number of pixels of the largest band.
    #[must_use]
    pub fn largest(&self) -> u64 {
        let pixels = |band: &Vec<Region>| band.iter().map(Region::pixels).sum();
        self.bands().iter().flatten().map(pixels).max().unwrap_or(0).max(1)
    }

    /// Returns the numbers of bands with light subpaths and of bands for unfiltered light alone.
    #[must_use]
    pub fn count_bands(&self) -> [u32; 2] {
        let groups = self.bands();
        let (own, clear) = groups.split_at(self.groups().len());
        [own, clear].map(|groups| groups.iter().map(Vec::len).sum::<usize>() as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every pixel of each layer is in one region, and no region is larger than `band_pixels` or one row.
    #[test]
    fn regions_cover_each_layer_once() {
        for (size, side, scale, band_pixels, together) in [
            ([40, 33], 1, 1, 1 << 18, 1),
            ([40, 33], 1, 1, 100, 1),
            ([37, 23], 4, 1, 60, 1),
            ([37, 23], 4, 1, 60, 16),
            ([37, 23], 5, 1, 200, 16),
            ([64, 64], 3, 1, 64 * 64, 16),
            ([64, 48], 2, 4, 1 << 18, 1),
            ([64, 48], 2, 4, 1 << 18, 4),
            ([3, 2], 4, 1, 1, 1),
            ([3, 2], 4, 1, 1, 16),
        ] {
            let grid = Grid { size, layered: side * scale > 1, side, scale, band_pixels, together };
            let mut seen = vec![[0; 2]; (size[0] * size[1]) as usize];
            let pixels = u64::from(size[0] * size[1]);
            assert!(pixels > u64::from(band_pixels) || grid.bands()[0].len() == 1, "one band is enough: {grid:?}");
            for band in grid.bands().iter().flatten() {
                let [pixels, columns] = [|r: &Region| r.pixels(), |r: &Region| u64::from(r.size[0])]
                    .map(|of| band.iter().map(of).sum::<u64>());
                assert!(pixels <= u64::from(band_pixels).max(columns), "{band:?}");
                assert!(band.len() <= together as usize);
            }
            for region in grid.bands().iter().flatten().flatten() {
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
