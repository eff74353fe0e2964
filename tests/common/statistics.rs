//! Statistical tests of pictures: Welch's t-test of the means of two sets of independent pictures, and the
//! chi-square test of samplers.
//!
//! A t-test misses a bias that is small beside the spread of its pictures. [`Verdict::detectable`] is the
//! relative bias of a picture's mean that a comparison finds with a probability of 95 % at its number of
//! pictures and its significance: (t_a + t_b) times the standard error of the difference, t_a being the
//! quantile of the significance after Sidak's correction and t_b that of 95 %. Tests assert that it is at
//! most [`MISSED`]. Smaller biases are found where planted errors show it, such as a light 0.75 % too bright.

use lightsheaf::film::Film;

/// Probability with which two equal methods are called different, over all values that are compared.
pub const SIGNIFICANCE: f64 = 0.001;
/// Largest relative bias of a picture's mean that a comparison may miss with a probability of more than 5 %.
pub const MISSED: f64 = 0.1;
/// Probability with which a bias of [`Verdict::detectable`] is found.
const POWER: f64 = 0.95;
/// Pixels along a side of a block.
const BLOCK: usize = 8;

/// Relative error of a mean of up to some thousand f32 samples.
const ROUNDING: f64 = 1e-6;

/// Values that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// The mean of each channel.
    Image,
    /// The mean of each channel, and of all channels in each block of 8 x 8 pixels.
    Blocks,
}

/// The result of a comparison: its least probable value.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// Channel or block of the value.
    pub place: String,
    /// Relative difference of its means.
    pub difference: f64,
    /// Standard error of that difference.
    pub error: f64,
    /// Probability of a difference this large or larger between equals, as the largest of all values.
    pub p: f64,
    /// Relative difference and standard error of the whole image's mean.
    pub image: [f64; 2],
    /// Relative bias of the image's mean, in the worst of its channels, that is found with a probability of
    /// 95 %.
    pub detectable: f64,
}

impl Verdict {
    /// True if the two may have the same mean.
    pub fn agrees(&self) -> bool {
        self.p >= SIGNIFICANCE
    }

    /// True if a bias of the image's mean above [`MISSED`] would have been found.
    pub fn is_sharp(&self) -> bool {
        self.detectable <= MISSED
    }
}

/// Compares each value by Welch's t-test, each picture being one observation, with Sidak's correction for the
/// number of values.
pub fn compare(a: &[Film], b: &[Film], look: Look) -> Verdict {
    assert!(a.len() >= 8 && b.len() >= 8, "a spread needs 8 pictures at least");
    let values: Vec<Vec<Vec<f64>>> = [a, b].map(|films| films.iter().map(|f| values(f, look)).collect()).into();
    let count = values[0][0].len();
    // Each value is tested at 1 - (1 - a)^(1 / m).
    let each = -((-SIGNIFICANCE).ln_1p() / count as f64).exp_m1();
    let mut detectable = 0.0_f64;
    let mut verdicts: Vec<Verdict> = (0..count)
        .map(|i| {
            let [(mean_a, variance_a), (mean_b, variance_b)] = [0, 1].map(|side| moments(&values[side], i));
            let difference = mean_a - mean_b;
            // Sums in f32 have an error of their own, which matters if nothing else varies.
            let variance = variance_a + variance_b + (ROUNDING * mean_b).powi(2);
            let error = variance.sqrt();
            let dof = (variance_a + variance_b).powi(2)
                / (variance_a.powi(2) / (a.len() - 1) as f64 + variance_b.powi(2) / (b.len() - 1) as f64);
            // Rounding the degrees of freedom down errs on the side of agreement.
            let dof = dof.max(1.0) as u32;
            let p = if difference == 0.0 { 1.0 } else { two_sided(difference / error, dof) };
            let place = match i {
                0..3 => format!("channel {i}"),
                _ => {
                    let columns = (a[0].width as usize).div_ceil(BLOCK);
                    format!("block ({}, {})", (i - 3) % columns, (i - 3) / columns)
                }
            };
            let scale = mean_b.abs().max(1e-30);
            if i < 3 && mean_b != 0.0 {
                let least = (quantile(each, dof) + quantile(2.0 * (1.0 - POWER), dof)) * error / scale;
                detectable = detectable.max(least);
            }
            let [difference, error] = [difference, error].map(|v| v / scale);
            Verdict { place, difference, error, p, image: [0.0; 2], detectable: 0.0 }
        })
        .collect();
    let image = [verdicts[1].difference, verdicts[1].error];
    verdicts.sort_by(|x, y| x.p.total_cmp(&y.p));
    let mut worst = verdicts.swap_remove(0);
    // 1 - (1 - p)^m, exactly for small p too.
    worst.p = -(count as f64 * (-worst.p).ln_1p()).exp_m1();
    (worst.image, worst.detectable) = (image, detectable);
    worst
}

/// Returns the mean over observations and the variance of that mean.
fn moments(observations: &[Vec<f64>], value: usize) -> (f64, f64) {
    let n = observations.len() as f64;
    let mean = observations.iter().map(|o| o[value]).sum::<f64>() / n;
    let square = observations.iter().map(|o| (o[value] - mean).powi(2)).sum::<f64>();
    (mean, square / (n - 1.0) / n)
}

fn values(film: &Film, look: Look) -> Vec<f64> {
    assert_eq!(film.non_finite(), 0);
    let (width, height) = (film.width as usize, film.height as usize);
    let mean = |pixels: &mut dyn Iterator<Item = f64>| {
        let (n, sum) = pixels.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
        sum / n
    };
    let mut out: Vec<f64> = (0..3).map(|c| mean(&mut film.pixels.iter().map(|p| f64::from(p[c])))).collect();
    if look == Look::Blocks {
        for (top, left) in (0..height).step_by(BLOCK).flat_map(|y| (0..width).step_by(BLOCK).map(move |x| (y, x))) {
            let block = (top..height.min(top + BLOCK))
                .flat_map(|y| (left..width.min(left + BLOCK)).map(move |x| film.pixels[y * width + x]));
            out.push(mean(&mut block.flat_map(|p| p.map(f64::from))));
        }
    }
    out
}

/// Returns the probability that |t| is at least this large (Abramowitz and Stegun 26.7.3 and 26.7.4).
fn two_sided(t: f64, dof: u32) -> f64 {
    let theta = (t.abs() / f64::from(dof).sqrt()).atan();
    let (sin, cos) = theta.sin_cos();
    let even = dof.is_multiple_of(2);
    let (mut term, mut sum) = (if even { 1.0 } else { cos }, 0.0);
    for k in (2 + dof % 2..=dof).step_by(2) {
        sum += term;
        term *= f64::from(k - 1) / f64::from(k) * cos * cos;
    }
    let inside = if even { sin * sum } else { (theta + sin * sum) * std::f64::consts::FRAC_2_PI };
    (1.0 - inside).max(0.0)
}

/// Returns the |t| beyond which lies the probability p.
fn quantile(p: f64, dof: u32) -> f64 {
    let (mut low, mut high) = (0.0, 1e6);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if two_sided(middle, dof) > p { low = middle } else { high = middle }
    }
    high
}

/// Tables say that 5 % of |t| lie beyond 2.228 at 10 degrees of freedom and 0.1 % beyond 5.408 at 7.
pub fn check_distribution() {
    for (t, dof, p) in [(2.228, 10, 0.05), (5.408, 7, 0.001), (12.706, 1, 0.05), (3.460, 29, 0.0017), (0.0, 5, 1.0)] {
        let actual = two_sided(t, dof);
        assert!((actual / p - 1.0).abs() < 0.02, "{t} at {dof}: {actual} is not {p}");
        assert!((quantile(p, dof) - t).abs() < 0.01 * (1.0 + t), "{p} at {dof}: {} is not {t}", quantile(p, dof));
    }
}

/// The result of a comparison pixel by pixel.
#[derive(Clone, Debug)]
pub struct PixelVerdict {
    /// Share of pixels that may have the same mean at 0.01, Sidak-corrected for their number.
    pub share: f64,
    /// The most conspicuous pixel, with its relative difference and standard error.
    pub worst: (usize, f64, f64),
}

impl PixelVerdict {
    /// True if as many pixels pass as between equal methods.
    pub fn agrees(&self) -> bool {
        self.share >= 0.9975
    }
}

/// Compares the sum of channels of every pixel by Welch's t-test; each picture is one observation.
pub fn compare_pixels(a: &[Film], b: &[Film]) -> PixelVerdict {
    assert!(a.len() >= 8 && b.len() >= 8, "a spread needs 8 pictures at least");
    let [a_means, b_means] = [a, b].map(pixel_moments);
    pixel_verdict(a_means.iter().zip(&b_means).map(|(&x, &y)| {
        let of = |variance: f64, count: usize| variance.powi(2) / (count - 1) as f64;
        (x, y, (x.1 + y.1).powi(2) / (of(x.1, a.len()) + of(y.1, b.len())))
    }))
}

/// Compares them with means whose variance is known.
pub fn pixels_against(films: &[Film], expected: &[(f64, f64)]) -> PixelVerdict {
    assert!(films.len() >= 8 && films[0].pixels.len() == expected.len());
    let pairs = pixel_moments(films).into_iter().zip(expected);
    pixel_verdict(pairs.map(|(x, &y)| {
        let dof = (x.1 + y.1).powi(2) / (x.1.powi(2) / (films.len() - 1) as f64);
        (x, y, dof.min(200.0))
    }))
}

/// Returns, per pixel, the mean of the sum of channels and the variance of that mean.
fn pixel_moments(films: &[Film]) -> Vec<(f64, f64)> {
    let sums: Vec<Vec<f64>> = films
        .iter()
        .map(|f| {
            assert_eq!(f.non_finite(), 0);
            f.pixels.iter().map(|p| p.iter().map(|&v| f64::from(v)).sum()).collect()
        })
        .collect();
    (0..sums[0].len()).map(|pixel| moments(&sums, pixel)).collect()
}

/// Tests each pixel, given mean and its variance on both sides, and the degrees of freedom.
fn pixel_verdict(pixels: impl ExactSizeIterator<Item = ((f64, f64), (f64, f64), f64)>) -> PixelVerdict {
    let count = pixels.len();
    let significance = -((-0.01_f64).ln_1p() / count as f64).exp_m1();
    let (mut passed, mut worst) = (0, (2.0, (0, 0.0, 0.0)));
    for (pixel, ((mean_a, variance_a), (mean_b, variance_b), dof)) in pixels.enumerate() {
        let error = (variance_a + variance_b + (ROUNDING * mean_b).powi(2)).sqrt();
        let difference = mean_a - mean_b;
        let p = if difference == 0.0 { 1.0 } else { two_sided(difference / error, dof.max(1.0) as u32) };
        passed += usize::from(p >= significance);
        if p < worst.0 {
            let scale = mean_b.abs().max(1e-30);
            worst = (p, (pixel, difference / scale, error / scale));
        }
    }
    PixelVerdict { share: passed as f64 / count as f64, worst: worst.1 }
}

/// Returns the probability that chi-square with `dof` degrees of freedom is at least x (Numerical Recipes,
/// 6.2).
pub fn chi_square_tail(x: f64, dof: f64) -> f64 {
    let (a, x) = (0.5 * dof, 0.5 * x);
    let log_gamma = |z: f64| {
        // Stirling's series follows a shift.
        let shift: f64 = (0..8).map(|i| (z + f64::from(i)).ln()).sum();
        let z = z + 8.0;
        (z - 0.5) * z.ln() - z + 0.5 * std::f64::consts::TAU.ln() + 1.0 / (12.0 * z) - 1.0 / (360.0 * z.powi(3)) - shift
    };
    let front = (a * x.ln() - x - log_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-15 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - sum * front;
    }
    let (mut b, mut c, mut d) = (x + 1.0 - a, 1e300, 1.0 / (x + 1.0 - a));
    let mut h = d;
    for i in 1..10_000 {
        let an = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        h *= d * c;
        if (d * c - 1.0).abs() < 1e-14 {
            break;
        }
    }
    front * h
}

/// Returns the p-value of counts against expected counts by Pearson's test; bins that expect fewer than 5 are
/// pooled.
pub fn p_value(counts: &[u64], expected: &[f64]) -> f64 {
    let (mut statistic, mut dof, mut pool) = (0.0, -1.0, (0.0, 0.0));
    let mut add = |count: f64, expected: f64| {
        statistic += (count - expected).powi(2) / expected;
        dof += 1.0;
    };
    for (&count, &expected) in counts.iter().zip(expected) {
        if expected < 5.0 {
            pool = (pool.0 + count as f64, pool.1 + expected);
        } else {
            add(count as f64, expected);
        }
    }
    if pool.1 >= 5.0 {
        add(pool.0, pool.1);
    } else if pool.0 > 5.0 + 10.0 * pool.1 {
        return 0.0;
    }
    chi_square_tail(statistic, dof)
}
