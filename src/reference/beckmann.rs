//! Beckmann's distribution of facets of width 1: masking, and sampling of visible slopes. Other widths stretch
//! directions.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

/// Returns Smith's Lambda for a direction whose tangent times the width is given: Walter et al. 2007, section 5.2, where
/// G1 = 1 / (1 + Lambda), with the exact error function.
#[must_use]
pub fn lambda(tan: f32) -> f32 {
    if tan <= 0.0 {
        return 0.0;
    }
    let a = tan.recip();
    (0.5 * ((-a * a).exp() * tan / PI.sqrt() - erfc(a))).max(0.0)
}

/// Samples the slopes of the facets that are visible along unit w.
///
/// The slope across the plane of w is normal. That along it has the density (1 - x tan) exp(-x^2) up to x = 1 / tan;
/// its distribution function is inverted in b = erf(x) by Newton's method (Jakob 2014).
#[must_use]
pub fn sample_visible_slopes(w: Vec3, u: Vec2) -> Vec2 {
    let sin = w.truncate().length();
    let tan = sin / w.z.max(1e-6);
    let highest = if tan > 0.0 { 1.0 - erfc(tan.recip()) } else { 1.0 };
    let distribution = |b: f32, x: f32| 1.0 + b + tan / PI.sqrt() * (-x * x).exp();
    let goal = u.x * if tan > 0.0 { distribution(highest, tan.recip()) } else { 2.0 };
    // The function is concave: from the first step on, the iteration climbs to the root from below.
    let mut b = highest - (1.0 + highest) * (1.0 - u.x).powf(1.0 - 0.5 * sin);
    for _ in 0..MOST_STEPS {
        b = b.clamp(-LARGEST, LARGEST.min(highest));
        let x = erf_inv(b);
        let step = (distribution(b, x) - goal) / (1.0 - x * tan).max(1e-6);
        b -= step;
        if step.abs() < 1e-6 {
            break;
        }
    }
    let along = erf_inv(b.clamp(-LARGEST, LARGEST.min(highest)));
    let across = erf_inv((2.0 * u.y - 1.0).clamp(-LARGEST, LARGEST));
    let direction = if sin > 0.0 { w.truncate() / sin } else { Vec2::X };
    direction * along + direction.perp() * across
}

/// Most steps of Newton's method. Next to the highest slope each step halves the error.
const MOST_STEPS: u32 = 16;

/// Largest error function of a slope.
const LARGEST: f32 = 1.0 - f32::EPSILON;

/// Returns the complementary error function of x >= 0 within 1.5e-7 (Abramowitz and Stegun, 7.1.26).
fn erfc(x: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series = t * (0.254_829_6 + t * (-0.284_496_72 + t * (1.421_413_8 + t * (-1.453_152_1 + t * 1.061_405_4))));
    series * (-x * x).exp()
}

/// Returns the inverse of the error function in (-1, 1) (Giles 2010, single precision).
fn erf_inv(y: f32) -> f32 {
    const CENTRAL: [f32; 9] = [
        2.810_226_4e-8,
        3.432_739_4e-7,
        -3.523_387_7e-6,
        -4.391_506_5e-6,
        2.185_808_7e-4,
        -1.253_725_1e-3,
        -4.177_681_6e-3,
        0.246_640_73,
        1.501_409_4,
    ];
    const TAIL: [f32; 9] = [
        -2.002_142_6e-4,
        1.009_505_6e-4,
        1.349_343_2e-3,
        -3.673_428_4e-3,
        5.739_507_7e-3,
        -7.622_461_3e-3,
        9.438_870_5e-3,
        1.001_674,
        2.832_976_8,
    ];
    let w = -((1.0 - y) * (1.0 + y)).ln();
    let (coefficients, w) = if w < 5.0 { (CENTRAL, w - 2.5) } else { (TAIL, w.sqrt() - 3.0) };
    y * coefficients.into_iter().fold(0.0, |sum, c| sum * w + c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_functions_invert_each_other() {
        assert!((1.0 - erfc(1.0) - 0.842_700_8).abs() < 3e-7);
        for i in 0..60 {
            let x = i as f32 * 0.05;
            assert!((erf_inv(1.0 - erfc(x)) - x).abs() < 1e-4 * (x * x).exp().max(1.0), "{x}");
        }
    }

    /// Smith's G1 makes the visible facets' projection that of the surface: cos / G1 is the integral of
    /// max(w . m, 0) D(m) over facets, here over slopes.
    #[test]
    fn masking_conserves_the_projected_area() {
        for tan in [0.3_f64, 1.0, 5.0] {
            // The slope across the plane of w integrates to 1.
            let n = 100_000;
            let sum: f64 = (0..n)
                .map(|i| -6.0 + 12.0 * (f64::from(i) + 0.5) / f64::from(n))
                .map(|x| (1.0 - x * tan).max(0.0) * (-x * x).exp() * 12.0 / f64::from(n))
                .sum();
            let area = sum / std::f64::consts::PI.sqrt();
            assert!((f64::from(1.0 + lambda(tan as f32)) - area).abs() < 1e-5 * area, "{tan}: {area}");
        }
    }
}
