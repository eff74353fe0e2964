//! Adaptive sampling: tiles of a picture take no more samples once they have converged (`--target-error`).
//!
//! The error of a tile is estimated from pictures of fewer samples ([`crate::render::convergence`]). One
//! estimate may be too low by chance, in particular if pixels share random numbers, and rare paths may not
//! have been sampled yet. Therefore the error of a tile is the larger of its estimate and half of the
//! estimate at half the samples, and a tile converges only if the errors of its eight neighbours are at most
//! the target as well. A converged tile stays converged, and contributes this error to that of the picture.

use crate::gpu::Gpu;
use crate::render::renderer::RenderError;
use crate::render::state::TileState;
use crate::settings::Settings;

/// Pixels along a side of a tile (shaders/lib/pixels/converged.wesl).
pub const TILE: u32 = crate::render::layouts::tile::TILE_SIDE;

/// Returns the columns and rows of tiles.
#[must_use]
pub fn grid(width: u32, height: u32) -> [u32; 2] {
    [width, height].map(|side| side.div_ceil(TILE))
}

/// The error estimates of a picture's tiles.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Tiles {
    grid: [u32; 2],
    /// Pixels of each tile, row by row.
    pixels: Vec<u32>,
    /// The latest estimate of each tile.
    estimates: Vec<f64>,
    /// The larger of the latest estimate and half of the one before.
    errors: Vec<f64>,
    converged: Vec<bool>,
}

impl Tiles {
    /// Creates the tiles of a picture without estimates; none has converged.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        let grid = grid(width, height);
        let along = |tile: u32, side: u32| TILE.min(side - tile * TILE);
        let rows = (0..grid[1]).map(|row| along(row, height));
        let pixels: Vec<_> =
            rows.flat_map(|rows| (0..grid[0]).map(move |column| along(column, width) * rows)).collect();
        let unknown = vec![f64::INFINITY; pixels.len()];
        Self { grid, estimates: unknown.clone(), errors: unknown, converged: vec![false; pixels.len()], pixels }
    }

    /// Updates the errors with the estimates of a picture that has at least twice the samples of the last
    /// one.
    pub fn update_errors(&mut self, estimates: &[f64]) {
        for tile in (0..estimates.len()).filter(|&tile| !self.converged[tile]) {
            let before = self.estimates[tile];
            // An estimate that is NaN stays NaN, since the comparison is false.
            self.errors[tile] = if before / 2.0 > estimates[tile] { before / 2.0 } else { estimates[tile] };
            self.estimates[tile] = estimates[tile];
        }
    }

    /// Returns the mean of a value per tile over the pixels of active tiles; 0 if all tiles have converged.
    #[must_use]
    pub fn mean_of_active(&self, of_tiles: &[f64]) -> f64 {
        let active = of_tiles.iter().zip(&self.pixels).zip(&self.converged).filter(|(_, converged)| !**converged);
        let sum: f64 = active.map(|((value, &pixels), _)| value * f64::from(pixels)).sum();
        sum / self.active_pixels().max(1) as f64
    }

    /// Returns the error of the picture if the mean error of active pixels is `active`.
    #[must_use]
    pub fn error(&self, active: f64) -> f64 {
        let converged = self.errors.iter().zip(&self.pixels).zip(&self.converged).filter(|(_, converged)| **converged);
        let converged: f64 = converged.map(|((error, &pixels), _)| error * f64::from(pixels)).sum();
        let all: f64 = self.pixels.iter().copied().map(f64::from).sum();
        // Without active pixels, `active` may be NaN.
        let pixels = self.active_pixels() as f64;
        (converged + if pixels > 0.0 { active * pixels } else { 0.0 }) / all
    }

    /// Marks the tiles whose error and whose neighbours' errors are at most `target`. All tiles have
    /// converged only if the error of the picture is at most `target`.
    pub fn mark_converged(&mut self, target: f64) {
        let [columns, rows] = self.grid.map(|side| side as usize);
        let below_target: Vec<bool> = self.errors.iter().map(|&error| error <= target).collect();
        for (tile, converged) in self.converged.iter_mut().enumerate() {
            let around = |at: usize, side: usize| at.saturating_sub(1)..(at + 2).min(side);
            let mut near = around(tile / columns, rows)
                .flat_map(|row| around(tile % columns, columns).map(move |column| row * columns + column));
            *converged = *converged || near.all(|near| below_target[near]);
        }
    }

    /// Returns true for each tile that has converged, row by row.
    #[must_use]
    pub fn converged(&self) -> &[bool] {
        &self.converged
    }

    /// Returns the number of active tiles: those that have not converged.
    #[must_use]
    pub fn active(&self) -> usize {
        self.converged.iter().filter(|converged| !**converged).count()
    }

    /// Returns the number of pixels of active tiles.
    #[must_use]
    pub fn active_pixels(&self) -> u64 {
        self.pixels
            .iter()
            .zip(&self.converged)
            .filter(|(_, converged)| !**converged)
            .map(|(&pixels, _)| u64::from(pixels))
            .sum()
    }
}

/// The mask of converged tiles that shaders read, and the samples that each tile has taken. Tiles outside a crop
/// count as converged from the beginning.
pub struct ConvergedTiles {
    grid: [u32; 2],
    /// True for tiles without a pixel of the crop.
    outside: Vec<bool>,
    words: wgpu::Buffer,
    converged: Vec<bool>,
    /// Samples of each tile at the last write of the mask.
    taken: Vec<u64>,
    /// Samples of the picture at that time.
    since: u64,
}

impl ConvergedTiles {
    /// Creates the mask of a picture without samples.
    #[must_use]
    pub fn new(gpu: &Gpu, settings: &Settings) -> Self {
        let Settings { width, height, .. } = *settings;
        let ([columns, rows], crop) = (grid(width, height), settings.region());
        let tiles = (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row]));
        let outside: Vec<bool> = tiles.map(|tile| !crop.touches(tile, TILE)).collect();
        let (words, taken) = (gpu.storage("converged", bytes(width, height)), vec![0; outside.len()]);
        let this = Self { grid: [columns, rows], words, converged: outside.clone(), outside, taken, since: 0 };
        this.upload(gpu);
        this
    }

    /// Writes the mask when the picture has `samples` samples.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if the mask has another number of tiles.
    pub fn write(&mut self, gpu: &Gpu, converged: &[bool], samples: u64) -> Result<(), RenderError> {
        let [columns, rows] = self.grid;
        if converged.len() != self.converged.len() {
            let given = converged.len();
            return Err(RenderError::Setting(format!("{given} tiles of a picture that has {columns} x {rows}")));
        }
        for (taken, converged) in self.taken.iter_mut().zip(&self.converged) {
            *taken += if *converged { 0 } else { samples - self.since };
        }
        (self.converged, self.since) = (converged.to_vec(), samples);
        self.upload(gpu);
        Ok(())
    }

    /// Clears the mask on the device until [`Self::upload`], for a pass that needs all pixels.
    pub fn suspend(&self, gpu: &Gpu) {
        gpu.queue.write_buffer(&self.words, 0, &vec![0; self.words.size() as usize]);
    }

    /// Writes the mask to the device.
    pub fn upload(&self, gpu: &Gpu) {
        let words: Vec<u32> = self.converged.iter().map(|&converged| u32::from(converged)).collect();
        gpu.queue.write_buffer(&self.words, 0, bytemuck::cast_slice(&words));
    }

    /// Returns the mask and the counts.
    #[must_use]
    pub fn state(&self) -> TileState {
        TileState { converged: self.converged.clone(), taken: self.taken.clone(), since: self.since }
    }

    /// Takes over the tiles of a state, if sampling is adaptive.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if the state has another number of tiles, or if only one of the two has tiles.
    pub fn restore(this: Option<&mut Self>, gpu: &Gpu, state: Option<&TileState>) -> Result<(), RenderError> {
        let (this, state) = match (this, state) {
            (Some(this), Some(state)) => (this, state),
            (None, None) => return Ok(()),
            _ => return Err(RenderError::foreign_state()),
        };
        let count = this.converged.len();
        if [state.converged.len(), state.taken.len()] != [count, count] {
            return Err(RenderError::foreign_state());
        }
        (this.converged, this.taken) = (state.converged.clone(), state.taken.clone());
        this.since = state.since;
        this.upload(gpu);
        Ok(())
    }

    /// Clears the mask and the counts for a new picture.
    pub fn restart(&mut self, gpu: &Gpu) {
        self.converged.clone_from(&self.outside);
        self.taken.fill(0);
        self.since = 0;
        self.upload(gpu);
    }

    /// Returns the samples that a pixel has taken when the picture, `width` pixels wide, has `samples`.
    #[must_use]
    pub fn taken(&self, pixel: usize, width: u32, samples: u64) -> u64 {
        let (row, column) = (pixel / width as usize, pixel % width as usize);
        let tile = row / TILE as usize * self.grid[0] as usize + column / TILE as usize;
        self.taken[tile] + if self.converged[tile] { 0 } else { samples - self.since }
    }

    /// Returns the buffer of the mask.
    #[must_use]
    pub fn words(&self) -> &wgpu::Buffer {
        &self.words
    }

    /// Returns the binding of shaders/lib/pixels/converged.wesl.
    #[must_use]
    pub fn binding(&self) -> (&str, wgpu::BindingResource<'_>) {
        ("converged", self.words.as_entire_binding())
    }
}

/// Returns the error of a renderer without adaptive sampling.
pub(crate) fn not_adaptive() -> RenderError {
    RenderError::Setting("tiles converge only with --target-error, and only if frames are not denoised".to_owned())
}

/// Returns the bytes of the buffer of [`ConvergedTiles`].
#[must_use]
pub fn bytes(width: u32, height: u32) -> u64 {
    4 * grid(width, height).map(u64::from).iter().product::<u64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns 5 x 3 tiles after updates with the estimate `quiet` in all tiles but one, which has
    /// `estimates`.
    fn after(estimates: &[f64], quiet: f64, other: usize) -> Tiles {
        let mut tiles = Tiles::new(5 * TILE, 3 * TILE);
        for &estimate in estimates {
            let mut errors = vec![quiet; 15];
            errors[other] = estimate;
            tiles.update_errors(&errors);
            tiles.mark_converged(1.0);
        }
        tiles
    }

    #[test]
    fn a_tile_converges_if_two_estimates_and_its_neighbours_are_below_the_target() {
        let quiet = 0.25;
        assert_eq!(after(&[quiet], quiet, 7).active(), 15, "one estimate is not enough");
        let two = after(&[quiet, quiet], quiet, 7);
        assert_eq!((two.active(), two.active_pixels()), (0, 0));
        // The neighbours of the middle tile stay active.
        let loud = after(&[4.0, 4.0], quiet, 7);
        let columns = |tiles: &Tiles| (0..5).map(|at| tiles.converged()[10 + at]).collect::<Vec<_>>();
        assert_eq!(columns(&loud), [true, false, false, false, true]);
        assert_eq!((loud.active(), loud.active_pixels()), (9, 9 * 256));
        let corner = after(&[4.0, 4.0], quiet, 0);
        assert_eq!((corner.active(), corner.converged()[0], corner.converged()[6]), (4, false, false));
        // Half of the earlier estimate counts, since the later one may be low by chance.
        assert_eq!(after(&[4.0, 0.0], quiet, 7).active(), 9);
        assert_eq!(after(&[4.0, 0.0, 0.0], quiet, 7).active(), 0);
        assert_eq!(after(&[f64::NAN, f64::NAN, f64::NAN], quiet, 7).active(), 9, "tiles with NaN never converge");
    }

    #[test]
    fn converged_tiles_count_with_their_last_error() {
        let quiet = 0.25;
        let mut tiles = after(&[4.0, 4.0], quiet, 0);
        // Pictures of converged tiles no longer change, so their estimates are 0. Four tiles are active.
        let active = |tiles: &Tiles, error: f64| {
            tiles.converged().iter().map(|&s| if s { 0.0 } else { error }).collect::<Vec<_>>()
        };
        tiles.update_errors(&active(&tiles, 3.0));
        assert!((tiles.error(3.0) - (11.0 * quiet + 4.0 * 3.0) / 15.0).abs() < 1e-12);
        // Converged tiles stay converged, whatever the errors of their neighbours are.
        tiles.mark_converged(1.0);
        assert_eq!(tiles.active(), 4);
        let error = tiles.error(0.0);
        assert!((error - 11.0 * quiet / 15.0).abs() < 1e-12, "{error}");
    }

    /// No picture is continued without active pixels: when the last tile converges, the target is reached.
    #[test]
    fn all_tiles_have_converged_only_if_the_target_is_reached() {
        for estimate in [0.0, 0.5, 1.0, 1.5, 4.0] {
            let tiles = after(&[estimate, estimate, estimate], 1.0, 3);
            let error = tiles.error(estimate);
            assert!(tiles.active() > 0 || error <= 1.0, "{estimate}: {error}");
        }
    }

    #[test]
    fn tiles_cover_the_picture() {
        for [width, height] in [[1, 1], [16, 16], [17, 40], [512, 360]] {
            let tiles = Tiles::new(width, height);
            assert_eq!(tiles.active_pixels(), u64::from(width) * u64::from(height));
            assert_eq!(bytes(width, height), 4 * tiles.active() as u64);
        }
        // The second tile has sixteen pixels, and tiles count by their pixels.
        let tiles = Tiles::new(17, 16);
        assert!((tiles.mean_of_active(&[0.0, 6.25]) - 6.25 / 17.0).abs() < 1e-12);
    }
}
