//! Estimates the rel_mse of a picture that grows, from pictures of its first samples (`--target-error`).
//!
//! E(n) is the error of the mean of n samples, D(a, b) the difference between those of a and b. For
//! independent samples D(a, b) is E(a) - E(b) in the mean, and E(n) falls as 1 / n. Samples of a scrambled
//! sequence, as raster and the reference have, do better: as n^-p, with p = 1.3 in the mean of the scenes
//! that were measured. Each pair of pictures then says
//!
//!   E(n) = D(a, b) / ((n / a)^p - (n / b)^p).
//!
//! One pair may be wrong by a factor of three where all pixels share their light subpaths. The estimate is
//! the geometric mean over the pairs of the latest looks. It knows no error that all of a picture's samples
//! share, such as a bias.
//!
//! The bias of the filter of interleaved pictures is estimated apart, with F the picture, U the same samples
//! unfiltered, T filtered twice. F - U has the bias b in the mean and the noise of U. Of two sets of samples
//! these noises have little in common, so that the product of the two F - U is b^2 in the mean, but noisy.
//! What the filter takes away from F, T - F, is like b, with little noise, and smaller, since F is smooth
//! already. b^2 is taken to be the product, but at least n and at most 3/4 n^2 times (T - F)^2, with n the
//! side of the filter's square: measured with 2 and 4 in seven scenes.

use std::collections::VecDeque;

use crate::film::Film;
use crate::metrics::{CompareError, DARK, rel_mse_of_tiles};
use crate::tiles::{TILE, Tiles};

/// p: how errors fall with samples. Measured with raster in seven scenes: 1.0 to 1.5.
const EXPONENT: f64 = 1.3;

/// Samples of the first picture that others are held against.
const FIRST: f64 = 4.0;

/// Samples of the first picture that has an estimate.
const FIRST_ESTIMATE: u64 = 16;

/// Samples from one look to the next, as a factor.
const STEP: f64 = std::f64::consts::SQRT_2;

/// Least factor between the samples of a pair.
const LEAST_STEP: f64 = 1.2;

/// Looks whose pairs count. Each has two: with the picture of one look before, and of two.
const LOOKS: usize = 5;

/// Earlier looks whose unfiltered pictures are held against the latest.
const PRODUCTS: usize = 4;

/// What tells the bias of the filter of interleaved pictures.
#[derive(Clone, Debug)]
pub struct BiasFilms {
    /// Pixels along a side of the filter's square.
    pub side: u32,
    /// The picture's samples, unfiltered.
    pub unfiltered: Film,
    /// The same filtered twice.
    pub twice: Film,
}

impl BiasFilms {
    /// The same in other units.
    #[must_use]
    pub fn scaled(&self, factor: f32) -> Self {
        Self { side: self.side, unfiltered: self.unfiltered.scaled(factor), twice: self.twice.scaled(factor) }
    }
}

/// Two pictures: samples of either, and how far they are apart in each tile.
#[derive(Clone, Debug)]
struct Pair {
    samples: [u64; 2],
    differences: Vec<f64>,
}

/// E(n) / D(a, b).
fn error_of_difference([a, b]: [u64; 2], n: u64) -> f64 {
    let error = |samples: u64| (n as f64 / samples as f64).powf(EXPONENT);
    1.0 / (error(a) - error(b))
}

/// What is known of a picture's error.
#[derive(Clone, Debug)]
pub struct Convergence {
    tiles: Tiles,
    /// Samples and pictures of the latest looks, the last one at the end.
    films: VecDeque<(u64, Film)>,
    pairs: VecDeque<Pair>,
    /// Samples of the latest looks and what the filter has done to the picture: F - U.
    filtered: VecDeque<(u64, Vec<f64>)>,
    /// Looks so far.
    looks: u32,
    /// Samples when tiles were last told what they lack.
    told: u64,
    error: Option<f64>,
}

impl Convergence {
    /// Of a picture without samples.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        let tiles = Tiles::new(width, height);
        let (films, pairs, filtered) = (VecDeque::new(), VecDeque::new(), VecDeque::new());
        Self { tiles, films, pairs, filtered, looks: 0, told: 0, error: None }
    }

    /// Samples at which to look again.
    #[must_use]
    pub fn next_look(&self) -> u64 {
        (FIRST * STEP.powi(self.looks as i32)).round() as u64
    }

    /// Learns from the picture of so many samples. Returns its rel_mse, estimated; none where too little is
    /// known or its values are not finite. Pictures may also come before [`Self::next_look`], from a render
    /// that is ended. `bias` are [`crate::renderer::Progressive::bias_films`].
    pub fn look(&mut self, samples: u64, film: &Film, bias: Option<&BiasFilms>) -> Option<f64> {
        let last = self.films.back().map_or(0, |(samples, _)| *samples);
        if samples <= last {
            return self.error;
        }
        while self.next_look() <= samples {
            self.looks += 1;
        }
        let bias = bias.map_or(0.0, |bias| self.bias(samples, film, bias));
        if self.learn(samples, film, bias).is_err() {
            // Holes in the picture stay.
            self.error = None;
        }
        self.films.push_back((samples, film.clone()));
        if self.films.len() > 2 {
            self.films.pop_front();
        }
        self.error
    }

    fn learn(&mut self, samples: u64, film: &Film, bias: f64) -> Result<(), CompareError> {
        // Pictures that hardly differ in samples tell nothing; the last look of a render may come soon.
        let apart = |before: u64| samples as f64 > LEAST_STEP * before as f64;
        for (before, older) in self.films.iter().rev().filter(|(before, _)| apart(*before)) {
            let differences = rel_mse_of_tiles(older, film, TILE)?;
            self.pairs.push_back(Pair { samples: [*before, samples], differences });
        }
        while self.pairs.len() > 2 * LOOKS {
            self.pairs.pop_front();
        }
        let Some(latest) = self.pairs.back().filter(|_| samples >= FIRST_ESTIMATE) else { return Ok(()) };
        let scale = error_of_difference(latest.samples, samples);
        let shown: Vec<f64> = latest.differences.iter().map(|difference| scale * difference).collect();
        // Tiles compare what two looks tell, which are to have little in common.
        if samples >= 2 * self.told {
            self.tiles.learn(&shown);
            self.told = samples;
        }
        self.error = Some(self.tiles.error(self.of_running(samples)) + bias);
        Ok(())
    }

    /// Estimated rel_mse that the filter of a picture makes: its squared bias.
    fn bias(&mut self, samples: u64, film: &Film, bias: &BiasFilms) -> f64 {
        let values = |film: &Film| film.pixels.iter().flatten().map(|&value| f64::from(value)).collect::<Vec<_>>();
        let [film, unfiltered, twice] = [film, &bias.unfiltered, &bias.twice].map(values);
        // Bright light that leaks into dark pixels is held against these.
        let weight = |(filtered, unfiltered): (&f64, &f64)| 1.0 / (filtered.min(unfiltered.max(0.0)).powi(2) + DARK);
        let weights: Vec<f64> = film.iter().zip(&unfiltered).map(weight).collect();
        let count = weights.len().max(1) as f64;
        let squares = weights.iter().zip(film.iter().zip(&twice)).map(|(w, (once, twice))| w * (once - twice).powi(2));
        let again = squares.sum::<f64>() / count;
        let now: Vec<f64> = film.iter().zip(&unfiltered).map(|(filtered, unfiltered)| filtered - unfiltered).collect();
        let n = samples as f64;
        let product = |(before, then): &(u64, Vec<f64>)| {
            let m = *before as f64;
            // What the samples since then have.
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

    /// Estimated rel_mse of the pixels that still take samples.
    fn of_running(&self, samples: u64) -> f64 {
        let errors = self.pairs.iter().map(|pair| {
            let difference = self.tiles.mean_of_running(&pair.differences);
            difference * error_of_difference(pair.samples, samples)
        });
        // Equal pictures have a logarithm too.
        let logarithms: f64 = errors.map(|error| error.max(f64::MIN_POSITIVE).ln() + 0.0 * error).sum();
        (logarithms / self.pairs.len() as f64).exp()
    }

    /// The error at the last look.
    #[must_use]
    pub fn error(&self) -> Option<f64> {
        self.error
    }

    /// Lets tiles settle in a picture that is to have an error of `target`.
    pub fn settle(&mut self, target: f64) {
        if self.films.back().is_some_and(|(samples, _)| *samples == self.told) {
            self.tiles.settle(target);
        }
    }

    /// The picture's tiles.
    #[must_use]
    pub fn tiles(&self) -> &Tiles {
        &self.tiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture in which each value is off the truth, 1, by an error of its own.
    fn film(error: impl Fn(usize) -> f64) -> Film {
        let mut film = Film::new(64, 64);
        for (at, value) in film.pixels.iter_mut().flatten().enumerate() {
            *value = (1.0 + error(at)) as f32;
        }
        film
    }

    /// Noise of mean 0 and variance 1.
    fn noise(at: usize, sample: u64) -> f64 {
        let mut x = (at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ sample.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) as f64 / u64::MAX as f64 - 0.5) * 12.0_f64.sqrt()
    }

    #[test]
    fn looks_come_more_often_than_samples_double() {
        let mut convergence = Convergence::new(64, 64);
        let mut looks = Vec::new();
        while convergence.next_look() < 100 {
            looks.push(convergence.next_look());
            convergence.look(convergence.next_look(), &film(|_| 0.0), None);
        }
        assert_eq!(looks, [4, 6, 8, 11, 16, 23, 32, 45, 64, 91]);
    }

    /// Independent samples are the worst case: the estimate is at most 1 / (2^p - 1) and a little lower than
    /// the truth.
    #[test]
    fn independent_samples_are_estimated_within_a_factor() {
        let mut convergence = Convergence::new(64, 64);
        let (mut sums, mut samples) = (vec![0.0; 3 * 64 * 64], 0_u64);
        let mut seen = 0;
        while convergence.next_look() <= 256 {
            while samples < convergence.next_look() {
                sums.iter_mut().enumerate().for_each(|(at, sum)| *sum += 0.3 * noise(at, samples));
                samples += 1;
            }
            let shown = film(|at| sums[at] / samples as f64);
            let Some(error) = convergence.look(samples, &shown, None) else { continue };
            let truth = 0.09 / samples as f64 / 1.01;
            assert!((0.5..1.2).contains(&(error / truth)), "{samples} samples: {error} where {truth} is true");
            seen += 1;
        }
        assert_eq!(seen, 9);
        // Another look at the same picture says the same, one at a picture with holes nothing.
        let error = convergence.error();
        assert!(error.is_some() && convergence.look(samples, &film(|_| 9.0), None) == error);
        let holes = convergence.look(2 * samples, &film(|_| f64::NAN), None);
        assert!(holes.is_none_or(f64::is_nan), "{holes:?}");
    }

    /// A picture that is too bright by 0.1 in all its samples: the filter's work, as its unfiltered samples
    /// show.
    #[test]
    fn what_the_filter_adds_is_an_error() {
        let estimate = |twice: f64, noisy: f64| {
            let mut convergence = Convergence::new(64, 64);
            while convergence.next_look() <= 64 {
                let samples = convergence.next_look();
                // Sums of the first samples.
                let noise = |at: usize| noisy * (0..samples).map(|n| noise(at, n)).sum::<f64>() / samples as f64;
                let films = BiasFilms { side: 4, unfiltered: film(noise), twice: film(|_| twice) };
                convergence.look(samples, &film(|_| 0.1), Some(&films));
            }
            convergence.error().unwrap()
        };
        let truth = 0.01 / 1.01;
        // The second filter adds a third of it.
        let seen = [estimate(0.1333, 0.0), estimate(0.1333, 0.3)];
        assert!(seen.iter().all(|error| (0.5..2.0).contains(&(error / truth))), "{seen:?} where {truth} is true");
        assert!(estimate(0.1, 0.0) < 1e-6, "a filter that changes nothing any more has no bias");
    }
}
