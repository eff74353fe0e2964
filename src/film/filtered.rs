//! A filtered picture, what the filter took away, and how much of it the picture gets back.
//!
//! The filter of interleaved pictures averages neighbours, over a square and then over squares around it. Either removes
//! noise, and detail with it. The residual d of a pixel is the mean of its frames before the filter minus that after it.
//! Its expectation is minus the filter's bias; the variance v of the mean is known, since each frame has a residual. The
//! picture is F + s d + s' d', with the filtered mean F, the residuals of both filters and, in a square of pixels around
//! each one,
//!
//!   s = max(1 - c sum (v / t) / sum (d^2 / t), 0),
//!
//! the positive-part estimator of James and Stein 1961 with c = 1. So a pixel keeps what is detail and loses what may
//! be noise, and since v falls with the number of frames the picture converges to the truth. Noise goes with brightness: t is
//! the deviation that v has around each pixel, so that the shadow beside a bright wall is not judged by the wall's noise.
//!
//! Pixels of a class share light subpaths, so that their residuals err together: a square has as many independent errors
//! as classes, a few, and sum d^2 may be some times its expectation. What then comes back is a pattern that repeats with
//! the classes. Detail hardly ever does, so that the means of a square's classes tell the pattern from it, and c is as large as
//! the pattern asks for, within bounds. Means of squares have no such pattern, and c is 1.
//!
//! A wide square may reach from a window to the dark frame around it, where a small share of what it brings is still too
//! much. Where more light leaks in than the pixel has, and not by chance, it gets all back.

use rayon::prelude::*;

use crate::crop::Crop;
use crate::film::Film;
use crate::film::exr::{Channel, Picture};

/// Pixels on either side of the middle of a square over which sums are taken (docs/journal.md, "Few samples").
const REACH: usize = 2;

/// The same of the larger square that patterns of classes are looked for in, too: it has more pixels of each class.
const REACH_OF_PATTERNS: usize = 3;

/// Pixels on either side of the middle of a square over which variances are averaged for the deviation that sums are over.
const REACH_OF_NOISE: usize = 1;

/// Share of the picture's mean deviation that is added to each, so that places without noise do not count alone.
const LEAST_NOISE: f64 = 1e-3;

/// Bounds of c of the filter of a square (docs/journal.md, "Few samples"). Of a pattern of 3x3 classes after 4 frames (the
/// test below) more comes back with 4.
const LEAST_MARGIN: f64 = 1.25;
const MOST_MARGIN: f64 = 5.0;

/// c of the filter of squares.
const COARSE_MARGIN: f64 = 1.0;

/// Light that leaks into a pixel, over its own, from which on all of it comes back if d^2 is this many times v. With half
/// of either the noise of few frames leaves dark dots (docs/journal.md, "Few samples").
const MOST_LEAK: f64 = 2.0;
const LEAST_EVIDENCE: f64 = 4.0;

/// Least number of frames from which a variance is estimated.
const LEAST_FRAMES: u64 = 3;

/// What a filter has taken away from a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Mean of the frames' residuals, radiance.
    pub mean: Film,
    /// Mean of the square of a frame's residual, summed over R, G and B before.
    pub square: Vec<f32>,
}

/// A filtered picture, with what the filter took away.
#[derive(Clone, Debug, PartialEq)]
pub struct FilteredFilm {
    /// Mean of the frames, filtered by both.
    pub film: Film,
    /// What the filter of a square took away.
    pub fine: Residual,
    /// What that of squares then took away.
    pub coarse: Residual,
    /// Number of frames.
    pub frames: u64,
    /// Side of the squares in which pixels have classes: those at the same place of any square share light subpaths.
    pub side: u32,
}

impl Residual {
    fn of(picture: &Picture, name: &str) -> Option<Self> {
        let square = picture.channel(&format!("{name}.square"))?.to_vec();
        Some(Self { mean: film_of(picture, name)?, square })
    }

    fn cropped(self, crop: Option<Crop>) -> Self {
        let Some(region) = crop else { return self };
        let square = region.pixels(self.mean.width).map(|pixel| self.square[pixel as usize]).collect();
        Self { mean: self.mean.cropped(crop), square }
    }

    fn channels(&self, name: &str) -> impl Iterator<Item = Channel> {
        let square = Channel { name: format!("{name}.square"), values: self.square.clone() };
        channels_of(&self.mean, name).chain([square])
    }

    /// Returns the sums over R, G and B of each pixel's mean, and their variances.
    fn statistics(&self, frames: u64) -> [Vec<f64>; 2] {
        let sums: Vec<_> = self.mean.pixels.iter().map(sum).collect();
        let variance = |(&square, sum): (&f32, &f64)| (f64::from(square) - sum * sum).max(0.0) / (frames - 1) as f64;
        let variances = self.square.iter().zip(&sums).map(variance).collect();
        [sums, variances]
    }

    /// Returns the share of the residual that each pixel gets back. `side`: see [`FilteredFilm::side`]; 1 if the pixels
    /// have no light subpaths in common. `least_margin`: the least c.
    fn shares(&self, frames: u64, side: u32, least_margin: f64) -> Vec<f32> {
        if frames < LEAST_FRAMES {
            return vec![0.0; self.square.len()];
        }
        let [sums, variances] = self.statistics(frames);
        let size = [self.mean.width as usize, self.mean.height as usize];
        let weights = weights(&variances, size);
        let scaled: Vec<_> = sums.iter().zip(&weights).map(|(sum, weight)| sum * weight.sqrt()).collect();
        let variances: Vec<_> = variances.iter().zip(&weights).map(|(variance, weight)| variance * weight).collect();
        let squares_of = [REACH, REACH_OF_PATTERNS].map(|reach| Squares::new(&scaled, &variances, size, reach, side));
        let share = |at: usize| {
            let [square, variance] = squares_of[0].sums(at);
            if square <= least_margin * variance {
                return 0.0;
            }
            let margin =
                squares_of.iter().map(|squares| squares.pattern(at)).fold(least_margin, f64::max).min(MOST_MARGIN);
            (1.0 - margin * variance / square).max(0.0) as f32
        };
        (0..sums.len()).into_par_iter().map(share).collect()
    }

    /// Returns whether each pixel of a picture without the filter is much darker than with it, and not by chance.
    fn leaks<'a>(&self, frames: u64, unfiltered: &'a Film) -> impl Iterator<Item = bool> + use<'a> {
        let [sums, variances] = if frames < LEAST_FRAMES { [vec![], vec![]] } else { self.statistics(frames) };
        let leaks = |((taken, variance), own): ((f64, f64), &[f32; 3])| {
            -taken > MOST_LEAK * sum(own).max(0.0) && taken * taken > LEAST_EVIDENCE * variance
        };
        sums.into_iter().zip(variances).zip(&unfiltered.pixels).map(leaks)
    }
}

impl FilteredFilm {
    /// Reads the channels of a picture of `frames` samples; none if it has no such channels.
    #[must_use]
    pub fn of(picture: &Picture, frames: u64) -> Option<Self> {
        let side = picture.channel("residual.side")?.first().map_or(1, |&side| side as u32);
        let [fine, coarse] = ["residual", "residual.coarse"].map(|name| Residual::of(picture, name));
        Some(Self { film: film_of(picture, "filtered")?, fine: fine?, coarse: coarse?, frames, side })
    }

    /// Returns the pixels of a crop; without one, all of them. Near the border of a crop shares differ, since squares
    /// end there.
    #[must_use]
    pub fn cropped(self, crop: Option<Crop>) -> Self {
        let Self { film, fine, coarse, .. } = self;
        Self { film: film.cropped(crop), fine: fine.cropped(crop), coarse: coarse.cropped(crop), ..self }
    }

    /// Returns the channels by which pictures of parts of the samples are merged.
    #[must_use]
    pub fn channels(&self) -> Vec<Channel> {
        let side = Channel { name: "residual.side".to_owned(), values: vec![self.side as f32; self.fine.square.len()] };
        let residuals = self.fine.channels("residual").chain(self.coarse.channels("residual.coarse"));
        channels_of(&self.film, "filtered").chain(residuals).chain([side]).collect()
    }

    /// Returns the picture.
    #[must_use]
    pub fn picture(&self) -> Film {
        let [fine, coarse] = self.shares();
        added(&added(&self.film, &self.coarse.mean, &coarse), &self.fine.mean, &fine)
    }

    /// Returns the mean of the frames without a filter.
    #[must_use]
    pub fn unfiltered(&self) -> Film {
        added(&self.filtered_once(), &self.fine.mean, &self.all())
    }

    /// Returns the mean of the frames with the filter of a square alone.
    fn filtered_once(&self) -> Film {
        added(&self.film, &self.coarse.mean, &self.all())
    }

    /// Returns the shares of a residual that comes back whole.
    fn all(&self) -> Vec<f32> {
        vec![1.0; self.film.pixels.len()]
    }

    /// Returns the shares of the fine and the coarse residual that each pixel gets back.
    #[must_use]
    pub fn shares(&self) -> [Vec<f32>; 2] {
        let mut coarse = self.coarse.shares(self.frames, 1, COARSE_MARGIN);
        for (share, leaks) in coarse.iter_mut().zip(self.coarse.leaks(self.frames, &self.filtered_once())) {
            if leaks {
                *share = 1.0;
            }
        }
        [self.fine.shares(self.frames, self.side, LEAST_MARGIN), coarse]
    }

    /// Returns the share of the filters' bias that each pixel of the picture has, 0 to 1.
    #[must_use]
    pub fn bias_left(&self) -> Vec<f32> {
        let shares = self.shares();
        let left = |at: usize| {
            let taken = [&self.fine, &self.coarse].map(|residual| sum(&residual.mean.pixels[at]));
            let kept = taken.iter().zip(&shares).map(|(taken, shares)| taken * f64::from(1.0 - shares[at]));
            let all: f64 = taken.iter().sum();
            if all == 0.0 { 1.0 } else { (kept.sum::<f64>() / all).clamp(0.0, 1.0) as f32 }
        };
        (0..self.film.pixels.len()).map(left).collect()
    }
}

/// Returns a film plus shares of another.
fn added(film: &Film, other: &Film, shares: &[f32]) -> Film {
    let add = |(pixel, other): (&[f32; 3], &[f32; 3]), share: f32| -> [f32; 3] {
        std::array::from_fn(|c| if share == 0.0 { pixel[c] } else { pixel[c] + share * other[c] })
    };
    let pixels = film.pixels.iter().zip(&other.pixels).zip(shares).map(|(both, &share)| add(both, share));
    Film { width: film.width, height: film.height, pixels: pixels.collect() }
}

fn sum(pixel: &[f32; 3]) -> f64 {
    pixel.iter().map(|&value| f64::from(value)).sum()
}

/// Returns the names of the channels of a film in a file.
fn names_of(name: &str) -> [String; 3] {
    ["R", "G", "B"].map(|channel| format!("{name}.{channel}"))
}

fn film_of(picture: &Picture, name: &str) -> Option<Film> {
    let [r, g, b] = names_of(name).map(|name| picture.channel(&name));
    let pixels = r?.iter().zip(g?).zip(b?).map(|((&r, &g), &b)| [r, g, b]).collect();
    let Film { width, height, .. } = picture.film;
    Some(Film { width, height, pixels })
}

fn channels_of(film: &Film, name: &str) -> impl Iterator<Item = Channel> {
    let values = |c: usize| film.pixels.iter().map(|pixel| pixel[c]).collect();
    names_of(name)
        .into_iter()
        .enumerate()
        .map(|(c, name)| Channel { name, values: values(c) })
        .collect::<Vec<_>>()
        .into_iter()
}

/// Returns the weight of each pixel in sums: one over the deviation of residuals around it.
fn weights(variances: &[f64], size: [usize; 2]) -> Vec<f64> {
    let [columns, rows] = size;
    let count = |at: usize, end: usize| near(at, end, REACH_OF_NOISE, 0, 1).count();
    let pixels = |at: usize| (count(at % columns, columns) * count(at / columns, rows)) as f64;
    let sums = sums_around(variances, size, REACH_OF_NOISE);
    let deviations: Vec<_> = sums.iter().enumerate().map(|(at, sum)| (sum / pixels(at)).max(0.0).sqrt()).collect();
    let least = LEAST_NOISE * deviations.iter().sum::<f64>() / deviations.len() as f64;
    deviations.into_iter().map(|deviation| 1.0 / (deviation + least).max(f64::MIN_POSITIVE)).collect()
}

/// Sums over the square around each pixel.
struct Squares {
    /// Columns and rows of the image.
    size: [usize; 2],
    reach: usize,
    /// Side of the squares in which pixels have classes; 1: none are told apart.
    side: usize,
    /// Sums of the squares of residuals, and of their variances.
    squares: Vec<f64>,
    variances: Vec<f64>,
    /// Sums of residuals along rows, apart for each column of classes.
    across: Vec<f64>,
    /// Columns, and rows, of each place of a class around each column and row.
    counts: [Vec<usize>; 2],
}

impl Squares {
    /// Sums residuals and their variances. Where classes are many for the pixels of a square they are not told apart.
    fn new(residuals: &[f64], variances: &[f64], size: [usize; 2], reach: usize, side: u32) -> Self {
        let squares: Vec<_> = residuals.iter().map(|residual| residual * residual).collect();
        let [squares, variances] = [&squares, variances].map(|values| sums_around(values, size, reach));
        let side = if 2 * (side as usize).pow(2) > (2 * reach + 1).pow(2) { 1 } else { side.max(1) as usize };
        let across = if side > 1 { sums_across(residuals, size[0], reach, side) } else { Vec::new() };
        let counts = |end: usize| {
            let places = (0..end).flat_map(|at| (0..side).map(move |place| (at, place)));
            places.map(|(at, place)| near(at, end, reach, place, side).count()).collect()
        };
        Self { size, reach, side, squares, variances, across, counts: size.map(counts) }
    }

    /// Returns the sums of squares and variances around a pixel.
    fn sums(&self, at: usize) -> [f64; 2] {
        [self.squares[at], self.variances[at]]
    }

    /// Returns what repeats with classes, of the sum of squares around a pixel, over the sum of variances. A share of the
    /// rest, by degrees of freedom, looks as if it repeated. Where classes are many for the pixels this says little, nor is
    /// it needed, since a square has many independent errors then: nothing repeats.
    fn pattern(&self, at: usize) -> f64 {
        let Self { size: [columns, rows], reach, side, .. } = *self;
        if side == 1 {
            return 0.0;
        }
        let (row, column) = (at / columns, at % columns);
        let (mut of_classes, mut all, mut classes, mut pixels) = (0.0, 0.0, 0, 0);
        let [widths, heights] = &self.counts;
        for (y, height) in (0..side).zip(&heights[row * side..]) {
            for (x, width) in (0..side).zip(&widths[column * side..]) {
                let count = width * height;
                if count > 0 {
                    let sums = near(row, rows, reach, y, side).map(|y| self.across[(y * columns + column) * side + x]);
                    let sum: f64 = sums.sum();
                    all += sum;
                    of_classes += sum * sum / count as f64;
                    classes += 1;
                    pixels += count;
                }
            }
        }
        if 2 * classes > pixels {
            return 0.0;
        }
        let of_all = all * all / pixels as f64;
        let chance = (classes - 1) as f64 / (pixels - 1) as f64;
        let pattern = (of_classes - of_all - chance * (self.squares[at] - of_all)) / (1.0 - chance);
        pattern.max(0.0) / self.variances[at].max(f64::MIN_POSITIVE)
    }
}

/// Returns the sum of the values up to `reach` columns and rows from each pixel of an image of `columns` and `rows`.
fn sums_around(values: &[f64], [columns, rows]: [usize; 2], reach: usize) -> Vec<f64> {
    let across = sums_across(values, columns, reach, 1);
    let sum = |at: usize| near(at / columns, rows, reach, 0, 1).map(|y| across[y * columns + at % columns]).sum();
    (0..values.len()).into_par_iter().map(sum).collect()
}

/// Returns the sums of the values up to `reach` columns from each pixel, apart for each column of squares of `side`.
fn sums_across(values: &[f64], columns: usize, reach: usize, side: usize) -> Vec<f64> {
    let mut across = vec![0.0; values.len() * side];
    across.par_chunks_mut((columns * side).max(1)).zip(values.par_chunks(columns.max(1))).for_each(|(sums, line)| {
        for (at, sum) in sums.iter_mut().enumerate() {
            *sum = near(at / side, columns, reach, at % side, side).map(|x| line[x]).sum();
        }
    });
    across
}

/// Returns the columns, or rows, up to `reach` from one that are at a place in squares of `side`.
fn near(at: usize, end: usize, reach: usize, place: usize, side: usize) -> impl Iterator<Item = usize> {
    let first = at.saturating_sub(reach);
    (first + (place + side - first % side) % side..(at + reach + 1).min(end)).step_by(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 32;

    /// Returns what `frames` frames take away, by column and a number of deviation 1.
    fn residual_of(frames: u64, value: impl Fn(u32, f32) -> f32) -> Residual {
        let noise = |at: u64| {
            let mixed = (at + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let mixed = (mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            (((mixed ^ (mixed >> 32)) >> 40) as f32 / (1 << 24) as f32 - 0.5) * 12.0_f32.sqrt()
        };
        let (mean, square) = (Film::new(SIDE, SIDE), vec![0.0; (SIDE * SIDE) as usize]);
        let mut all = Residual { mean, square };
        for (at, (mean, square)) in all.mean.pixels.iter_mut().zip(&mut all.square).enumerate() {
            for frame in 0..frames {
                let value = value(at as u32 % SIDE, noise(at as u64 * frames + frame)) / 3.0;
                mean.iter_mut().for_each(|mean| *mean += value / frames as f32);
                *square += 9.0 * value * value / frames as f32;
            }
        }
        all
    }

    /// Returns what `frames` frames take away: `bias` in the left half, and noise of deviation 1.
    fn residual(bias: f32, frames: u64) -> Residual {
        residual_of(frames, |column, noise| if column < SIDE / 2 { bias + noise } else { noise })
    }

    /// A line of detail comes back though brighter and noisier pixels lie two columns beside it.
    #[test]
    fn noise_nearby_does_not_hide_detail() {
        let half = SIDE / 2;
        let shares = residual_of(16, |column, noise| match column {
            column if column < half => 100.0 * noise,
            column => noise + if column == half + 1 { 5.0 } else { 0.0 },
        })
        .shares(16, 1, LEAST_MARGIN);
        let mean =
            |column: u32| shares.chunks(SIDE as usize).map(|row| row[column as usize]).sum::<f32>() / SIDE as f32;
        let [noise, detail] = [half / 2, half + 1].map(mean);
        assert!(noise < 0.05 && detail > 0.5, "{noise} {detail}");
    }

    /// Detail comes back, and noise stays away; the more so, the more frames there are.
    #[test]
    fn detail_comes_back_and_noise_does_not() {
        let halves = |bias: f32, frames: u64| {
            let shares = residual(bias, frames).shares(frames, 1, LEAST_MARGIN);
            let half = |right: u32| {
                let middle = |at: u32| at / (SIDE / 2) == right && (at % (SIDE / 2)).abs_diff(SIDE / 4) < 4;
                let all: Vec<_> = shares
                    .chunks(SIDE as usize)
                    .flat_map(|row| (0..SIDE).filter(|&at| middle(at)).map(|at| row[at as usize]))
                    .collect();
                all.iter().sum::<f32>() / all.len() as f32
            };
            [half(0), half(1)]
        };
        let [detail, noise] = halves(2.0, 16);
        assert!(detail > 0.9 && noise < 0.05, "{detail} {noise}");
        let faint = [4, 64, 1024].map(|frames| halves(0.3, frames)[0]);
        assert!(faint[0] < 0.3 && faint[1] > 0.5 && faint[2] > 0.95, "{faint:?}");
        assert!(halves(9.0, LEAST_FRAMES - 1) == [0.0; 2], "too few frames have no variance");
    }

    /// What all pixels of a class have in common stays away, though a square has few independent errors; detail comes back.
    #[test]
    fn a_pattern_of_classes_does_not_come_back() {
        let (side, frames) = (3, 4);
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(0x1405_7b7e_f767_814f);
            (state >> 40) as f32 / (1 << 24) as f32 - 0.5
        };
        let shared = |sides: u32, detail: &dyn Fn(u32) -> f32, random: &mut dyn FnMut() -> f32| {
            let errors: Vec<Vec<f32>> = (0..frames)
                .map(|_| {
                    let errors: Vec<f32> = (0..side * side).map(|_| random()).collect();
                    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
                    errors.into_iter().map(|error| error - mean).collect()
                })
                .collect();
            let mut all = Residual { mean: Film::new(21, 21), square: vec![0.0; 21 * 21] };
            for (at, (mean, square)) in (0..).zip(all.mean.pixels.iter_mut().zip(&mut all.square)) {
                let class = at / 21 % side * side + at % 21 % side;
                for errors in &errors {
                    let value = errors[class as usize] + detail(at);
                    mean[0] += value / frames as f32;
                    *square += value * value / frames as f32;
                }
            }
            let shares = all.shares(frames as u64, sides, LEAST_MARGIN);
            shares[10 * 21 + 10]
        };
        let returned = |sides: u32, random: &mut dyn FnMut() -> f32| {
            (0..200).filter(|_| shared(sides, &|_| 0.0, random) > 0.05).count()
        };
        let (known, unknown) = (returned(side, &mut random), returned(1, &mut random));
        assert!(known <= 4 && unknown >= 20, "{known} and {unknown} of 200");
        let line = |at: u32| if at % 21 == 10 { 3.0 } else { 0.0 };
        let detail = shared(side, &line, &mut random);
        assert!(detail > 0.5, "{detail}");
    }

    /// Returns a filtered picture of one colour with what both filters took away.
    fn filtered(color: [f32; 3], fine: Residual, coarse: Residual, frames: u64) -> FilteredFilm {
        let film = Film { pixels: vec![color; (SIDE * SIDE) as usize], width: SIDE, height: SIDE };
        FilteredFilm { film, fine, coarse, frames, side: 1 }
    }

    /// A line that a window beside it would brighten stays dark, though the window is so noisy that a share of its light
    /// would stay in the line. Where the line itself is bright, or the light may be chance, only a share comes back.
    #[test]
    fn light_does_not_leak_into_the_dark() {
        let line = SIDE / 2;
        let coarse = |leak: f32| {
            residual_of(16, |column, noise| match column {
                column if column + 1 == line => 8.0 + 16.0 * noise,
                column if column == line => leak + noise,
                _ => 0.0,
            })
        };
        let share = |own: f32, leak: f32| {
            let [before, none] = [own - leak / 3.0, 0.0].map(|value| [value; 3]);
            let fine = residual_of(16, |_, _| none[0]);
            let shares = filtered(before, fine, coarse(leak), 16).shares()[1].clone();
            let column = shares.chunks(SIDE as usize).map(|row| f64::from(row[line as usize]));
            column.sum::<f64>() / f64::from(SIDE)
        };
        let [dark, bright, chance] = [share(0.1, -3.0), share(50.0, -3.0), share(0.001, -0.02)];
        assert!(dark == 1.0 && bright < 0.9 && chance < 0.9, "{dark} {bright} {chance}");
    }

    /// The picture, the mean without filters and the bias that is left follow from the shares of both residuals.
    #[test]
    fn residuals_of_both_filters_come_back() {
        let all = filtered([10.0, 20.0, 30.0], residual(1.0, 8), residual(6.0, 8), 8);
        let [fine, coarse] = all.shares();
        assert!(fine != coarse);
        let (picture, unfiltered, left) = (all.picture(), all.unfiltered(), all.bias_left());
        for at in 0..left.len() {
            let [a, b] = [&all.fine, &all.coarse].map(|residual| residual.mean.pixels[at][1]);
            assert!((picture.pixels[at][1] - (20.0 + fine[at] * a + coarse[at] * b)).abs() < 1e-4);
            assert!((unfiltered.pixels[at][1] - (20.0 + a + b)).abs() < 1e-4);
            // What filters take away of one sign leaves a mean of both shares.
            if a > 0.0 && b > 0.0 {
                let kept = ((1.0 - fine[at]) * a + (1.0 - coarse[at]) * b) / (a + b);
                assert!((left[at] - kept).abs() < 1e-4);
            }
        }
    }

    /// A file says all of it.
    #[test]
    fn channels_are_read_back() {
        let all = filtered([0.5, 1.0, 2.0], residual(1.0, 8), residual(2.0, 8), 8);
        let of_file = Picture { film: all.picture(), channels: all.channels(), ..Picture::default() };
        assert_eq!(FilteredFilm::of(&of_file, 8), Some(all));
        assert_eq!(FilteredFilm::of(&Picture { channels: Vec::new(), ..of_file }, 8), None);
    }
}
