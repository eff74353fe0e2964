//! Squares of a picture that take no more samples where they are as near to the truth as asked for (`--target-error`).
//!
//! What a tile lacks is told by the picture's first half ([`crate::convergence`]). One look may be luck,
//! above all where pixels share their random numbers, and light that is seldom found is found next door
//! sooner or later; so a tile's error is the larger of what it shows and half of what it showed when the
//! picture had half as many samples, and a tile settles where that of its neighbours is at most the picture's
//! target, too. It stays settled, and counts for the picture with that error.

use crate::gpu::Gpu;
use crate::renderer::RenderError;

/// Pixels along a side (shaders/lib/tiles.wesl).
pub const TILE: u32 = 16;

/// Columns and rows of tiles.
#[must_use]
pub fn grid(width: u32, height: u32) -> [u32; 2] {
    [width, height].map(|side| side.div_ceil(TILE))
}

/// What is known of a picture's tiles.
#[derive(Clone, Debug)]
pub struct Tiles {
    grid: [u32; 2],
    /// Pixels of each, row by row.
    pixels: Vec<u32>,
    /// What each showed last.
    shown: Vec<f64>,
    /// The larger of that and half of what it showed before.
    errors: Vec<f64>,
    settled: Vec<bool>,
}

impl Tiles {
    /// Of a picture of which nothing is known yet.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        let grid = grid(width, height);
        let along = |tile: u32, side: u32| TILE.min(side - tile * TILE);
        let rows = (0..grid[1]).map(|row| along(row, height));
        let pixels: Vec<_> =
            rows.flat_map(|rows| (0..grid[0]).map(move |column| along(column, width) * rows)).collect();
        let unknown = vec![f64::INFINITY; pixels.len()];
        Self { grid, shown: unknown.clone(), errors: unknown, settled: vec![false; pixels.len()], pixels }
    }

    /// Learns what the tiles of a picture lack that has twice the samples of the last one.
    pub fn learn(&mut self, shown: &[f64]) {
        for tile in (0..shown.len()).filter(|&tile| !self.settled[tile]) {
            let before = self.shown[tile];
            // Not a number, where anything of it is not.
            self.errors[tile] = if before / 2.0 > shown[tile] { before / 2.0 } else { shown[tile] };
            self.shown[tile] = shown[tile];
        }
    }

    /// Mean over the pixels that take samples of what their tiles have; 0 where there are none.
    #[must_use]
    pub fn mean_of_running(&self, of_tiles: &[f64]) -> f64 {
        let running = of_tiles.iter().zip(&self.pixels).zip(&self.settled).filter(|(_, settled)| !**settled);
        let sum: f64 = running.map(|((value, &pixels), _)| value * f64::from(pixels)).sum();
        sum / self.running_pixels().max(1) as f64
    }

    /// The picture's error where the pixels that take samples have one of `running`.
    #[must_use]
    pub fn error(&self, running: f64) -> f64 {
        let settled = self.errors.iter().zip(&self.pixels).zip(&self.settled).filter(|(_, settled)| **settled);
        let settled: f64 = settled.map(|((error, &pixels), _)| error * f64::from(pixels)).sum();
        let all: f64 = self.pixels.iter().copied().map(f64::from).sum();
        // None of them is none, whatever nothing lacks.
        let pixels = self.running_pixels() as f64;
        (settled + if pixels > 0.0 { running * pixels } else { 0.0 }) / all
    }

    /// Lets tiles settle in a picture that is to have an error of `target`. All of them have only where that is reached.
    pub fn settle(&mut self, target: f64) {
        let [columns, rows] = self.grid.map(|side| side as usize);
        let calm: Vec<bool> = self.errors.iter().map(|&error| error <= target).collect();
        for (tile, settled) in self.settled.iter_mut().enumerate() {
            let around = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
            let mut near = around(tile / columns, rows)
                .flat_map(|row| around(tile % columns, columns).map(move |column| row * columns + column));
            *settled = *settled || near.all(|near| calm[near]);
        }
    }

    /// Which have settled, row by row.
    #[must_use]
    pub fn settled(&self) -> &[bool] {
        &self.settled
    }

    /// Tiles that take samples.
    #[must_use]
    pub fn running(&self) -> usize {
        self.settled.iter().filter(|settled| !**settled).count()
    }

    /// Their pixels.
    #[must_use]
    pub fn running_pixels(&self) -> u64 {
        self.pixels
            .iter()
            .zip(&self.settled)
            .filter(|(_, settled)| !**settled)
            .map(|(&pixels, _)| u64::from(pixels))
            .sum()
    }
}

/// Which tiles have settled, for shaders, and how many samples each has taken.
pub struct Settled {
    grid: [u32; 2],
    words: wgpu::Buffer,
    settled: Vec<bool>,
    /// Up to when it was last said which have settled.
    taken: Vec<u64>,
    /// The picture's samples then.
    since: u64,
}

impl Settled {
    /// None has.
    #[must_use]
    pub fn new(gpu: &Gpu, width: u32, height: u32) -> Self {
        let grid = grid(width, height);
        let count = grid[0] as usize * grid[1] as usize;
        let words = gpu.storage("settled", bytes(width, height));
        Self { grid, words, settled: vec![false; count], taken: vec![0; count], since: 0 }
    }

    /// Tells, when a picture has so many samples.
    ///
    /// # Errors
    /// [`RenderError::Setting`] where these are not all tiles.
    pub fn write(&mut self, gpu: &Gpu, settled: &[bool], samples: u64) -> Result<(), RenderError> {
        let [columns, rows] = self.grid;
        if settled.len() != self.settled.len() {
            let given = settled.len();
            return Err(RenderError::Setting(format!("{given} tiles of a picture that has {columns} x {rows}")));
        }
        for (taken, settled) in self.taken.iter_mut().zip(&self.settled) {
            *taken += if *settled { 0 } else { samples - self.since };
        }
        (self.settled, self.since) = (settled.to_vec(), samples);
        let words: Vec<u32> = settled.iter().map(|&settled| u32::from(settled)).collect();
        gpu.queue.write_buffer(&self.words, 0, bytemuck::cast_slice(&words));
        Ok(())
    }

    /// Begins a picture of which no tile has settled.
    pub fn restart(&mut self, gpu: &Gpu) {
        gpu.queue.write_buffer(&self.words, 0, &vec![0; self.words.size() as usize]);
        self.settled.fill(false);
        self.taken.fill(0);
        self.since = 0;
    }

    /// Samples that a pixel of a picture `width` wide has taken, when the picture has so many.
    #[must_use]
    pub fn taken(&self, pixel: usize, width: u32, samples: u64) -> u64 {
        let (row, column) = (pixel / width as usize, pixel % width as usize);
        let tile = row / TILE as usize * self.grid[0] as usize + column / TILE as usize;
        self.taken[tile] + if self.settled[tile] { 0 } else { samples - self.since }
    }

    /// The buffer.
    #[must_use]
    pub fn words(&self) -> &wgpu::Buffer {
        &self.words
    }

    /// The binding of shaders/lib/tiles.wesl.
    #[must_use]
    pub fn binding(&self) -> (&str, wgpu::BindingResource<'_>) {
        ("settled", self.words.as_entire_binding())
    }
}

/// Why a renderer has no tiles that settle.
pub(crate) fn never() -> RenderError {
    RenderError::Setting("tiles settle only where --target-error is given, and frames have no layers".to_owned())
}

/// Bytes of [`Settled`].
#[must_use]
pub fn bytes(width: u32, height: u32) -> u64 {
    4 * grid(width, height).map(u64::from).iter().product::<u64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tiles of 5 x 3 after looks at which all showed `calm`, but for one.
    fn after(looks: &[f64], calm: f64, other: usize) -> Tiles {
        let mut tiles = Tiles::new(5 * TILE, 3 * TILE);
        for &look in looks {
            let mut shown = vec![calm; 15];
            shown[other] = look;
            tiles.learn(&shown);
            tiles.settle(1.0);
        }
        tiles
    }

    #[test]
    fn a_tile_settles_where_two_looks_and_its_neighbours_agree() {
        let quiet = 0.25;
        assert_eq!(after(&[quiet], quiet, 7).running(), 15, "one look is none");
        let two = after(&[quiet, quiet], quiet, 7);
        assert_eq!((two.running(), two.running_pixels()), (0, 0));
        // The middle, and all but the first and the last column beside it.
        let loud = after(&[4.0, 4.0], quiet, 7);
        let columns = |tiles: &Tiles| (0..5).map(|at| tiles.settled()[10 + at]).collect::<Vec<_>>();
        assert_eq!(columns(&loud), [true, false, false, false, true]);
        assert_eq!((loud.running(), loud.running_pixels()), (9, 9 * 256));
        let corner = after(&[4.0, 4.0], quiet, 0);
        assert_eq!((corner.running(), corner.settled()[0], corner.settled()[6]), (4, false, false));
        // What was loud and is quiet may be luck: half of what it was stays believed.
        assert_eq!(after(&[4.0, 0.0], quiet, 7).running(), 9);
        assert_eq!(after(&[4.0, 0.0, 0.0], quiet, 7).running(), 0);
        assert_eq!(after(&[f64::NAN, f64::NAN, f64::NAN], quiet, 7).running(), 9, "holes never settle");
    }

    #[test]
    fn settled_tiles_count_with_the_error_that_they_had() {
        let quiet = 0.25;
        let mut tiles = after(&[4.0, 4.0], quiet, 0);
        // Pictures of settled tiles no longer change, which says nothing; the three beside the corner and itself go on.
        let running = |tiles: &Tiles, error: f64| {
            tiles.settled().iter().map(|&s| if s { 0.0 } else { error }).collect::<Vec<_>>()
        };
        tiles.learn(&running(&tiles, 3.0));
        assert!((tiles.error(3.0) - (11.0 * quiet + 4.0 * 3.0) / 15.0).abs() < 1e-12);
        // Settled they stay, whatever happens beside them.
        tiles.settle(1.0);
        assert_eq!(tiles.running(), 4);
        let error = tiles.error(0.0);
        assert!((error - 11.0 * quiet / 15.0).abs() < 1e-12, "{error}");
    }

    /// Where the last tile settles the target is reached, so that no picture goes on without pixels.
    #[test]
    fn all_tiles_have_settled_only_where_the_target_is_reached() {
        for look in [0.0, 0.5, 1.0, 1.5, 4.0] {
            let tiles = after(&[look, look, look], 1.0, 3);
            let error = tiles.error(look);
            assert!(tiles.running() > 0 || error <= 1.0, "{look}: {error}");
        }
    }

    #[test]
    fn tiles_cover_the_picture() {
        for [width, height] in [[1, 1], [16, 16], [17, 40], [512, 360]] {
            let tiles = Tiles::new(width, height);
            assert_eq!(tiles.running_pixels(), u64::from(width) * u64::from(height));
            assert_eq!(bytes(width, height), 4 * tiles.running() as u64);
        }
        // Sixteen pixels of the second tile: the picture's error is that of all its pixels.
        let tiles = Tiles::new(17, 16);
        assert!((tiles.mean_of_running(&[0.0, 6.25]) - 6.25 / 17.0).abs() < 1e-12);
    }
}
