//! Error metrics of an image against a reference, on linear RGB. Sums are in f64.
//!
//! With the image x and the reference r, over all values of all channels:
//! - `mse` = mean((x - r)^2)
//! - `rel_mse` = mean((x - r)^2 / (r^2 + 0.01))
//! - `mean_bias` = mean(x) / mean(r) - 1
//! - `p999` = 99.9th percentile of |x - r| / (r + 0.01), linear between ranks
//! - `flip` = mean LDR-FLIP (Andersson et al. 2020, 67 pixels per degree) of the sRGB images at exposure
//!   0.8 / (95th percentile of the reference's luminance), clipped to [0, 1]
//!
//! A non-finite value in the image makes every metric NaN, so that an image with such values passes no
//! threshold.

use serde::{Deserialize, Serialize};

use crate::film::Film;

/// Offset of the denominators, which keeps relative errors of dark values finite.
pub(crate) const DARK: f64 = 0.01;

/// Metrics of one comparison. NaN is `null` in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Columns of both images.
    pub width: u32,
    /// Rows of both images.
    pub height: u32,
    /// Mean squared error.
    #[serde(deserialize_with = "nan_from_null")]
    pub mse: f64,
    /// Mean squared error relative to the reference's square.
    #[serde(deserialize_with = "nan_from_null")]
    pub rel_mse: f64,
    /// Ratio of the means minus one.
    #[serde(deserialize_with = "nan_from_null")]
    pub mean_bias: f64,
    /// 99.9th percentile of the relative error.
    #[serde(deserialize_with = "nan_from_null")]
    pub p999: f64,
    /// Mean FLIP error, 0 to 1; NaN without the feature `flip`.
    #[serde(deserialize_with = "nan_from_null")]
    pub flip: f64,
    /// Number of NaN and infinite values in the image.
    pub non_finite: u64,
}

fn nan_from_null<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// An error that prevents a comparison.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CompareError {
    /// The images differ in size.
    #[error("the image is {}x{}, the reference {}x{}; render one of them at the other's size", image.0, image.1, reference.0, reference.1)]
    Size {
        /// Columns and rows of the image.
        image: (u32, u32),
        /// Columns and rows of the reference.
        reference: (u32, u32),
    },
    /// The images have no pixels.
    #[error("the images have no pixels")]
    Empty,
    /// The reference has values that are not finite.
    #[error("the reference has {0} values that are not finite; nothing can be said about the image")]
    Reference(u64),
}

/// Compares an image with a reference.
///
/// # Errors
/// Returns [`CompareError`] if the sizes differ, there are no pixels or the reference is not finite.
pub fn compare(image: &Film, reference: &Film) -> Result<Comparison, CompareError> {
    check(image, reference)?;
    let values = || image.pixels.iter().flatten().zip(reference.pixels.iter().flatten());
    let count = (image.pixels.len() * 3) as f64;
    let (mut square, mut relative, mut sum_x, mut sum_r) = (0.0, 0.0, 0.0, 0.0);
    for (&x, &r) in values() {
        let (x, r) = (f64::from(x), f64::from(r));
        let d = (x - r) * (x - r);
        square += d;
        relative += d / (r * r + DARK);
        sum_x += x;
        sum_r += r;
    }
    let non_finite = image.non_finite();
    // Infinities could cancel in a difference or vanish in a quotient, so all non-finite values become NaN.
    let hole = if non_finite > 0 { f64::NAN } else { 0.0 };
    let mut errors: Vec<f64> =
        values().map(|(&x, &r)| (f64::from(x) - f64::from(r)).abs() / (f64::from(r) + DARK)).collect();
    Ok(Comparison {
        width: image.width,
        height: image.height,
        mse: square / count + hole,
        rel_mse: relative / count + hole,
        mean_bias: if sum_x == sum_r { 0.0 } else { sum_x / sum_r - 1.0 } + hole,
        p999: percentile(&mut errors, 0.999) + hole,
        flip: flip(image, reference) + hole,
        non_finite,
    })
}

/// Estimates `rel_mse` of a picture in each tile of `side` x `side` pixels, row by row, from the picture of
/// the first half of its samples. Tiles at the right and at the bottom may be smaller. A tile is NaN if
/// values of the picture in it are not finite.
///
/// The expected squared difference between the picture and its first half equals the expected squared error
/// of the picture. The reference radiance in the denominator is estimated by the picture. Light that only one
/// half of the samples has found would make this estimate too large and hide its own error; the estimate is
/// therefore limited to 1.5 times the darker half.
///
/// # Errors
/// Returns [`CompareError`] if the sizes differ, there are no pixels or the picture `whole` is not finite.
pub fn rel_mse_of_tiles(half: &Film, whole: &Film, side: u32) -> Result<Vec<f64>, CompareError> {
    check(half, whole)?;
    let (width, side) = (whole.width as usize, side as usize);
    let columns = width.div_ceil(side);
    let mut sums = vec![(0.0, 0.0); columns * (whole.height as usize).div_ceil(side)];
    for (at, (half, whole)) in half.pixels.iter().zip(&whole.pixels).enumerate() {
        let (sum, count) = &mut sums[at / width / side * columns + at % width / side];
        for (&half, &whole) in half.iter().zip(whole) {
            let (half, whole) = (f64::from(half), f64::from(whole));
            let darker = half.min(2.0 * whole - half).max(0.0);
            let bright = whole.min(1.5 * darker);
            *sum += (half - whole) * (half - whole) / (bright * bright + DARK);
            *count += 1.0;
        }
    }
    // An infinite sum results from values that are not finite and is no valid error.
    Ok(sums.iter().map(|(sum, count)| if f64::is_finite(*sum) { sum / count } else { f64::NAN }).collect())
}

/// Returns the exposure for FLIP: 0.8 / (95th percentile of the reference's luminance), 1 for a black
/// reference.
#[must_use]
pub fn flip_exposure(reference: &Film) -> f64 {
    let mut luminance: Vec<f64> = reference
        .pixels
        .iter()
        .map(|&[r, g, b]| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b))
        .collect();
    let bright = percentile(&mut luminance, 0.95);
    if bright > 0.0 { 0.8 / bright } else { 1.0 }
}

/// Returns the signed relative error of each pixel, the mean over the channels of (x - r) / (r + 0.01). Red
/// marks pixels that are too bright, blue pixels that are too dark, with full saturation from 100 % on; white
/// marks values that are not finite. PNG's transfer function makes small errors visible.
///
/// # Errors
/// Returns [`CompareError`] if the sizes differ, there are no pixels or the reference is not finite.
pub fn heatmap(image: &Film, reference: &Film) -> Result<Film, CompareError> {
    check(image, reference)?;
    let color = |x: &[f32; 3], r: &[f32; 3]| {
        let error = (0..3).map(|c| (x[c] - r[c]) / (r[c] + DARK as f32)).sum::<f32>() / 3.0;
        let strength = error.abs().min(1.0);
        match error {
            e if !e.is_finite() => [1.0; 3],
            e if e > 0.0 => [strength, 0.25 * strength * strength, 0.0],
            _ => [0.0, 0.25 * strength * strength, strength],
        }
    };
    let pixels = image.pixels.iter().zip(&reference.pixels).map(|(x, r)| color(x, r)).collect();
    Ok(Film { width: image.width, height: image.height, pixels })
}

fn check(image: &Film, reference: &Film) -> Result<(), CompareError> {
    let sizes = [image, reference].map(|f| (f.width, f.height));
    if sizes[0] != sizes[1] || image.pixels.len() != reference.pixels.len() {
        return Err(CompareError::Size { image: sizes[0], reference: sizes[1] });
    }
    if image.pixels.is_empty() {
        return Err(CompareError::Empty);
    }
    match reference.non_finite() {
        0 => Ok(()),
        holes => Err(CompareError::Reference(holes)),
    }
}

/// Returns the value below which `fraction` of the values lie, interpolated linearly between ranks. Reorders
/// the values.
fn percentile(values: &mut [f64], fraction: f64) -> f64 {
    let rank = fraction * (values.len() - 1) as f64;
    let (_, &mut low, above) = values.select_nth_unstable_by(rank as usize, f64::total_cmp);
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    low + (high - low) * rank.fract()
}

#[cfg(feature = "flip")]
fn flip(image: &Film, reference: &Film) -> f64 {
    let exposure = flip_exposure(reference) as f32;
    let [x, r] =
        [image, reference].map(|f| nv_flip::FlipImageRgb8::with_data(f.width, f.height, &f.to_srgb8(exposure)));
    let errors = nv_flip::flip(r, x, nv_flip::DEFAULT_PIXELS_PER_DEGREE).to_vec();
    errors.iter().map(|&e| f64::from(e)).sum::<f64>() / errors.len() as f64
}

#[cfg(not(feature = "flip"))]
fn flip(_: &Film, _: &Film) -> f64 {
    f64::NAN
}
