//! The table of a sheen's albedo (shaders/lib/surface/sheen.wesl): the integral of its lobe times the cosine.

use std::f64::consts::PI;
use std::sync::LazyLock;

use rayon::prelude::*;

use crate::render::layouts::sheen_size::SHEEN_SIDE;
use crate::scene::Sheen;

/// Steps of the quadrature in the cosine and in the azimuth.
const STEPS: [usize; 2] = [160, 64];

/// Returns the albedo at the middles of the table's cells: square roots of cosines along a row, and one row for
/// each roughness.
pub(super) fn albedos() -> Vec<f32> {
    static TABLE: LazyLock<Vec<f32>> = LazyLock::new(|| {
        let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(SHEEN_SIDE);
        let least = f64::from(Sheen::MIN_ROUGHNESS);
        let cells = (0..SHEEN_SIDE * SHEEN_SIDE).into_par_iter();
        cells
            .map(|i| albedo(middle(i % SHEEN_SIDE).powi(2), middle(i / SHEEN_SIDE).max(least).powi(2)) as f32)
            .collect()
    });
    TABLE.clone()
}

/// Returns the share of light along a cosine that a lobe of a width reflects. The lobe is D / (4 cos_o) G2, times
/// the cosine; the squares of the midpoints are the cosines, which makes the steps small at grazing angles.
fn albedo(cos_o: f64, alpha: f64) -> f64 {
    let sin_o = (1.0 - cos_o * cos_o).sqrt();
    let lambda_o = lambda(cos_o, alpha);
    let [rows, columns] = STEPS;
    let row = |i: usize| {
        let x = (i as f64 + 0.5) / rows as f64;
        let (cos_i, width) = (x * x, 2.0 * x / rows as f64);
        let sin_i = (1.0 - cos_i * cos_i).sqrt();
        let g2 = 1.0 / (1.0 + lambda_o + lambda(cos_i, alpha));
        let d = |j: usize| {
            let phi = PI * (j as f64 + 0.5) / columns as f64;
            let across = (sin_i * phi.cos() + sin_o).powi(2) + (sin_i * phi.sin()).powi(2);
            let sin2_h = across / (across + (cos_i + cos_o).powi(2));
            (2.0 + 1.0 / alpha) * sin2_h.powf(0.5 / alpha) / (2.0 * PI)
        };
        (0..columns).map(d).sum::<f64>() / columns as f64 * 2.0 * PI * g2 * width
    };
    ((0..rows).map(row).sum::<f64>() / (4.0 * cos_o)).min(1.0)
}

/// Smith's Lambda, as fitted by Conty Estevez and Kulla 2017 (table 1).
fn lambda(cos: f64, alpha: f64) -> f64 {
    let t = (1.0 - alpha).powi(2);
    let mix = |smooth: f64, rough: f64| rough + (smooth - rough) * t;
    let [a, b, c, d, e] = [
        mix(25.3245, 21.5473),
        mix(3.32435, 3.82987),
        mix(0.16801, 0.19823),
        mix(-1.27393, -1.97760),
        mix(-4.85967, -4.32054),
    ];
    let l = |x: f64| a / (1.0 + b * x.powf(c)) + d * x + e;
    if cos < 0.5 { l(cos).exp() } else { (2.0 * l(0.5) - l(1.0 - cos)).exp() }
}
