//! Which pixels of an image share a light subpath and its views, and which of them are followed at a time.
//!
//! One light subpath for all pixels, in bands of whole rows; or, where sampling is interleaved, one for each class of every n-th pixel
//! of every n-th row.

/// Light that needs no filter, and light that does: what a region fills of a frame's layers (shaders/accumulate.wesl).
pub const CLEAR: u32 = 1;
/// See [`CLEAR`].
pub const INDIRECT: u32 = 2;

/// How an image is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Grid {
    /// Columns and rows of the image.
    pub size: [u32; 2],
    /// Whether frames have layers, which are filtered, instead of a film.
    pub layered: bool,
    /// Layer pixels along a side of the squares whose pixels each have a light subpath of their own.
    pub side: u32,
    /// Pixels of the image along a side of a layer's.
    pub scale: u32,
    /// Pixels that are followed at a time, at most, but for a row at least.
    pub band_pixels: u32,
}

/// Every `stride`-th pixel of every `stride`-th row of a part of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Its first pixel in the image.
    pub first: [u32; 2],
    /// Columns and rows.
    pub size: [u32; 2],
    /// Pixels of the image from one to the next.
    pub stride: u32,
    /// Pixels of the image along a side of one of the layer that it fills.
    pub scale: u32,
    /// What it fills: [`CLEAR`], [`INDIRECT`] or both.
    pub layers: u32,
}

impl Region {
    /// Pixels.
    #[must_use]
    pub fn pixels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

impl Grid {
    /// Light subpaths of an iteration.
    #[must_use]
    pub fn subpaths(&self) -> u32 {
        self.side * self.side
    }

    /// Regions by class, one class for each light subpath; then, where layers are coarser than the image, those of its clear light.
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

    /// Columns and rows of the layers.
    #[must_use]
    pub fn layer(&self) -> [u32; 2] {
        self.size.map(|side| side.div_ceil(self.scale))
    }

    /// Columns and rows of the squares whose pixels have light subpaths of their own.
    #[must_use]
    pub fn squares(&self) -> [u32; 2] {
        self.layer().map(|side| side.div_ceil(self.side))
    }

    /// Pixels of the largest region.
    #[must_use]
    pub fn largest(&self) -> u64 {
        self.classes().iter().flatten().map(Region::pixels).max().unwrap_or(0).max(1)
    }

    /// Regions that have a light subpath, and those of clear light alone.
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

    /// Every pixel of each layer is in one region, and no region is larger than asked for.
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
