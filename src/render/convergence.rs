//! Estimates the rel_mse of a picture while it is rendered, from pictures of its first samples
//! (`--target-error`).
//!
//! E(n) is the error of the mean of n samples, and D(a, b) the squared difference of the means of a and of b
//! samples. For independent samples the expectation of D(a, b) is E(a) - E(b), and E(n) falls as 1 / n.
//! Samples of a scrambled sequence, which raster and the reference use, converge faster: as n^-p, with p =
//! 1.3 in the mean over the measured scenes. Each pair of pictures then gives the estimate
//!
//!   E(n) = D(a, b) / ((n / a)^p - (n / b)^p).
//!
//! A single pair may err by a factor of three if all pixels share their light subpaths. The estimate is
//! therefore the geometric mean over the pairs of the latest checkpoints. It does not contain errors that are
//! common to all samples of a picture, such as a bias.
//!
//! The bias of the filter of interleaved pictures is estimated separately. F is the mean of the filtered samples, U
//! that of the same samples unfiltered, and T that of samples filtered twice. The expectation of F - U is the bias b, and
//! its noise is that of U. The noises of two disjoint sets of samples are nearly independent, so the product
//! of their two differences F - U estimates b^2, but is noisy. The change by the second filter, T - F,
//! resembles b with little noise, and is smaller, since F is already smooth. The estimate of b^2 is the
//! product, clamped to between n and 3/4 n^2 times (T - F)^2, with n the side of the filter's square
//! (measured with n = 2 and 4 in seven scenes). The picture has a known share of the bias left in each pixel.

use std::collections::VecDeque;

use crate::crop::Crop;
use crate::film::Film;
use crate::metrics::{CompareError, DARK, rel_mse_of_tiles};
use crate::render::adaptive_sampling::{TILE, Tiles};

/// The exponent p by which errors fall with samples. Measured with raster in seven scenes: 1.0 to 1.5.
const EXPONENT: f64 = 1.3;

/// Samples of the first checkpoint.
const FIRST: f64 = 4.0;

/// Least number of samples of a picture with an estimate.
const FIRST_ESTIMATE: u64 = 16;

/// Ratio of the samples of a checkpoint to those of the one before.
const STEP: f64 = std::f64::consts::SQRT_2;

/// Least ratio between the samples of the two pictures of a pair.
const LEAST_STEP: f64 = 1.2;

/// Checkpoints whose pairs count. Each has two pairs: with the picture of one and of two checkpoints before.
const CHECKPOINTS: usize = 5;

/// Earlier checkpoints whose unfiltered pictures are multiplied with the latest one.
const PRODUCTS: usize = 4;

/// The films from which the bias of the filter of interleaved pictures is estimated.
#[derive(Clone, Debug)]
pub struct BiasFilms {
    /// Pixels along a side of the filter's square.
    pub side: u32,
    /// The mean of the picture's samples, filtered.
    pub filtered: Film,
    /// The same unfiltered.
    pub unfiltered: Film,
    /// The same filtered twice.
    pub twice: Film,
    /// Share of the filter's bias that the picture has ([`crate::film::filtered`]), pixel by pixel.
    pub left: Vec<f32>,
}

impl BiasFilms {
    /// Returns the films multiplied by a factor.
    #[must_use]
    pub fn scaled(&self, factor: f32) -> Self {
        let [filtered, unfiltered, twice] =
            [&self.filtered, &self.unfiltered, &self.twice].map(|film| film.scaled(factor));
        Self { side: self.side, filtered, unfiltered, twice, left: self.left.clone() }
    }

    /// Returns the pixels of a crop; without one, the films.
    #[must_use]
    pub fn cropped(self, crop: Option<Crop>) -> Self {
        let left = crop.map_or(self.left.clone(), |crop| {
            crop.pixels(self.filtered.width).map(|pixel| self.left[pixel as usize]).collect()
        });
        let [filtered, unfiltered, twice] = [self.filtered, self.unfiltered, self.twice].map(|film| film.cropped(crop));
        Self { side: self.side, filtered, unfiltered, twice, left }
    }
}

/// Two pictures of a sequence: the samples of either, and the squared difference in each tile.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
struct Pair {
    samples: [u64; 2],
    differences: Vec<f64>,
}

/// Returns E(n) / D(a, b).
fn error_of_difference([a, b]: [u64; 2], n: u64) -> f64 {
    let error = |samples: u64| (n as f64 / samples as f64).powf(EXPONENT);
    1.0 / (error(a) - error(b))
}

/// The error estimate of a picture.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Convergence {
    tiles: Tiles,
    /// Samples and pictures of the latest checkpoints, in order.
    films: VecDeque<(u64, Film)>,
    pairs: VecDeque<Pair>,
    /// Samples and values of F - U of the latest checkpoints.
    filtered: VecDeque<(u64, Vec<f64>)>,
    /// Checkpoints so far.
    checkpoints: u32,
    /// Samples of the picture at the last update of the tiles' errors.
    tiles_updated: u64,
    error: Option<f64>,
}

impl Convergence {
    /// Begins the estimate of a picture without samples.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        let tiles = Tiles::new(width, height);
        let (films, pairs, filtered) = (VecDeque::new(), VecDeque::new(), VecDeque::new());
        Self { tiles, films, pairs, filtered, checkpoints: 0, tiles_updated: 0, error: None }
    }

    /// Returns the number of samples of the next checkpoint.
    #[must_use]
    pub fn next_checkpoint(&self) -> u64 {
        (FIRST * STEP.powi(self.checkpoints as i32)).round() as u64
    }

    /// Returns the samples at which the estimate will reach a target, by the rate at which errors fall.
    #[must_use]
    pub fn samples_to(&self, target: f64) -> Option<f64> {
        let (samples, _) = self.films.back()?;
        Some(*samples as f64 * (self.error? / target).max(1.0).powf(1.0 / EXPONENT))
    }

    /// Updates the estimate with the picture of `samples` samples and returns its rel_mse. None if there are
    /// too few pictures, or if values are not finite. The last picture of a render may have fewer samples
    /// than [`Self::next_checkpoint`]. `bias` are the films of
    /// [`crate::render::renderer::Renderer::bias_films`].
    pub fn update(&mut self, samples: u64, film: &Film, bias: Option<&BiasFilms>) -> Option<f64> {
        let last = self.films.back().map_or(0, |(samples, _)| *samples);
        if samples <= last {
            return self.error;
        }
        while self.next_checkpoint() <= samples {
            self.checkpoints += 1;
        }
        let bias = bias.map_or(0.0, |bias| self.bias(samples, bias));
        if self.update_pairs(samples, film, bias).is_err() {
            // Values that are not finite stay in the picture.
            self.error = None;
        }
        self.films.push_back((samples, film.clone()));
        if self.films.len() > 2 {
            self.films.pop_front();
        }
        self.error
    }

    /// Adds the pairs of a picture with the latest ones, and updates the estimate from all pairs.
    fn update_pairs(&mut self, samples: u64, film: &Film, bias: f64) -> Result<(), CompareError> {
        // The last checkpoint of a render may follow soon after the one before; such a pair is too noisy.
        let apart = |before: u64| samples as f64 > LEAST_STEP * before as f64;
        for (before, older) in self.films.iter().rev().filter(|(before, _)| apart(*before)) {
            let differences = rel_mse_of_tiles(older, film, TILE)?;
            self.pairs.push_back(Pair { samples: [*before, samples], differences });
        }
        while self.pairs.len() > 2 * CHECKPOINTS {
            self.pairs.pop_front();
        }
        let Some(latest) = self.pairs.back().filter(|_| samples >= FIRST_ESTIMATE) else { return Ok(()) };
        let scale = error_of_difference(latest.samples, samples);
        let errors: Vec<f64> = latest.differences.iter().map(|difference| scale * difference).collect();
        // Tiles compare two estimates, whose samples should overlap little.
        if samples >= 2 * self.tiles_updated {
            self.tiles.update_errors(&errors);
            self.tiles_updated = samples;
        }
        self.error = Some(self.tiles.error(self.active_error(samples)) + bias);
        Ok(())
    }

    /// Estimates the rel_mse that the filter of a picture causes: its squared bias.
    fn bias(&mut self, samples: u64, bias: &BiasFilms) -> f64 {
        let values = |film: &Film| film.pixels.iter().flatten().map(|&value| f64::from(value)).collect::<Vec<_>>();
        let [film, unfiltered, twice] = [&bias.filtered, &bias.unfiltered, &bias.twice].map(values);
        // Bright light that leaks into dark pixels is an error relative to what the picture has there.
        let weight = |((filtered, unfiltered), left): ((&f64, &f64), f64)| {
            let shown = unfiltered + left * (filtered - unfiltered);
            left.powi(2) / (filtered.min(shown.max(0.0)).powi(2) + DARK)
        };
        let left = bias.left.iter().flat_map(|&left| [f64::from(left); 3]);
        let weights: Vec<f64> = film.iter().zip(&unfiltered).zip(left).map(weight).collect();
        let count = weights.len().max(1) as f64;
        let squares = weights.iter().zip(film.iter().zip(&twice)).map(|(w, (once, twice))| w * (once - twice).powi(2));
        let again = squares.sum::<f64>() / count;
        let now: Vec<f64> = film.iter().zip(&unfiltered).map(|(filtered, unfiltered)| filtered - unfiltered).collect();
        let n = samples as f64;
        let product = |(before, then): &(u64, Vec<f64>)| {
            let m = *before as f64;
            // F - U of the samples since that checkpoint, which are disjoint from its own.
            let since = |now: f64, then: f64| (n * now - m * then) / (n - m);
            let all = weights.iter().zip(then.iter().zip(&now)).map(|(w, (&then, &now))| w * then * since(now, then));
            all.sum::<f64>() / count
        };
        let apart = self.filtered.iter().filter(|(before, _)| n > LEAST_STEP * *before as f64);
        let products: Vec<f64> = apart.map(product).collect();
        let mean = products.iter().sum::<f64>() / products.len().max(1) as f64;
        self.filtered.push_back((samples, now));
        if self.filtered.len() > PRODUCTS {
            self.filtered.pop_front();
        }
        let side = f64::from(bias.side);
        mean.max(side * again).min(0.75 * side * side * again)
    }

    /// Estimates the rel_mse of the pixels that still take samples.
    fn active_error(&self, samples: u64) -> f64 {
        let errors = self.pairs.iter().map(|pair| {
            let difference = self.tiles.mean_of_active(&pair.differences);
            difference * error_of_difference(pair.samples, samples)
        });
        // The bound keeps the logarithm of equal pictures finite; the product keeps NaN.
        let logarithms: f64 = errors.map(|error| error.max(f64::MIN_POSITIVE).ln() + 0.0 * error).sum();
        (logarithms / self.pairs.len() as f64).exp()
    }

    /// Returns the rel_mse at the last checkpoint.
    #[must_use]
    pub fn error(&self) -> Option<f64> {
        self.error
    }

    /// Marks the tiles that have converged to an error of `target`, if the tiles' errors are those of the
    /// last picture.
    pub fn mark_converged(&mut self, target: f64) {
        if self.films.back().is_some_and(|(samples, _)| *samples == self.tiles_updated) {
            self.tiles.mark_converged(target);
        }
    }

    /// Returns the picture's tiles.
    #[must_use]
    pub fn tiles(&self) -> &Tiles {
        &self.tiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a picture with an error of its own in each value; the true value is 1.
    fn film(error: impl Fn(usize) -> f64) -> Film {
        let mut film = Film::new(64, 64);
        for (at, value) in film.pixels.iter_mut().flatten().enumerate() {
            *value = (1.0 + error(at)) as f32;
        }
        film
    }

    /// Returns noise of mean 0 and variance 1.
    fn noise(at: usize, sample: u64) -> f64 {
        let mut x = (at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ sample.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12.0_f64.sqrt()
    }

    #[test]
    fn checkpoints_follow_at_ratios_of_sqrt_2() {
        let mut convergence = Convergence::new(64, 64);
        let mut checkpoints = Vec::new();
        while convergence.next_checkpoint() < 100 {
            checkpoints.push(convergence.next_checkpoint());
            convergence.update(convergence.next_checkpoint(), &film(|_| 0.0), None);
        }
        assert_eq!(checkpoints, [4, 6, 8, 11, 16, 23, 32, 45, 64, 91]);
    }

    /// Independent samples are the worst case: a pair at n / 2 and n samples estimates 1 / (2^p - 1) = 0.68
    /// of the true error.
    #[test]
    fn independent_samples_are_estimated_within_a_factor() {
        let mut convergence = Convergence::new(64, 64);
        let (mut sums, mut samples) = (vec![0.0; 3 * 64 * 64], 0_u64);
        let mut seen = 0;
        while convergence.next_checkpoint() <= 256 {
            while samples < convergence.next_checkpoint() {
                sums.iter_mut().enumerate().for_each(|(at, sum)| *sum += 0.3 * noise(at, samples));
                samples += 1;
            }
            let picture = film(|at| sums[at] / samples as f64);
            let Some(error) = convergence.update(samples, &picture, None) else { continue };
            let truth = 0.09 / samples as f64 / 1.01;
            assert!((0.5..1.2).contains(&(error / truth)), "{samples} samples: {error} where {truth} is true");
            seen += 1;
        }
        assert_eq!(seen, 9);
        // An update without new samples keeps the estimate. A picture with values that are not finite has
        // none.
        let error = convergence.error();
        assert!(error.is_some() && convergence.update(samples, &film(|_| 9.0), None) == error);
        let holes = convergence.update(2 * samples, &film(|_| f64::NAN), None);
        assert!(holes.is_none_or(f64::is_nan), "{holes:?}");
    }

    /// The filter makes a picture too bright by 0.1, which its unfiltered samples reveal.
    #[test]
    fn bias_of_the_filter_is_estimated() {
        let estimate = |twice: f64, noisy: f64| {
            let mut convergence = Convergence::new(64, 64);
            while convergence.next_checkpoint() <= 64 {
                let samples = convergence.next_checkpoint();
                let noise = |at: usize| noisy * (0..samples).map(|n| noise(at, n)).sum::<f64>() / samples as f64;
                let (filtered, left) = (film(|_| 0.1), vec![1.0; 64 * 64]);
                let films = BiasFilms { side: 4, filtered, unfiltered: film(noise), twice: film(|_| twice), left };
                convergence.update(samples, &film(|_| 0.1), Some(&films));
            }
            convergence.error().unwrap()
        };
        let truth = 0.01 / 1.01;
        // The second filter adds a third of the bias.
        let seen = [estimate(0.1333, 0.0), estimate(0.1333, 0.3)];
        assert!(seen.iter().all(|error| (0.5..2.0).contains(&(error / truth))), "{seen:?} where {truth} is true");
        assert!(estimate(0.1, 0.0) < 1e-6, "a filter that changes nothing any more has no bias");
    }
}
