//! The sheen of KHR_materials_sheen (Conty Estevez and Kulla 2017) in a frame whose z is the shading normal.

use std::f32::consts::TAU;
use std::sync::LazyLock;

use glam::Vec3;
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use super::surface::Surface;
use super::texture::Textures;
use crate::scene;

/// A sheen after texture look-up.
#[derive(Clone, Copy, Debug)]
pub struct Sheen {
    /// Multiplies the lobe.
    pub color: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
}

impl Sheen {
    /// Evaluates a sheen's textures at a surface.
    #[must_use]
    pub fn new(sheen: &scene::Sheen, textures: &Textures, surface: &Surface) -> Self {
        let roughness = textures.scalar(&sheen.roughness, surface.uvs).max(scene::Sheen::MIN_ROUGHNESS);
        Self { color: textures.color(&sheen.color, surface.uvs), roughness }
    }

    /// Returns f |cos_i|; both directions are above the surface.
    #[must_use]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> Vec3 {
        self.color * (lobe(self.roughness * self.roughness, wo, wi) / (4.0 * wo.z))
    }

    /// Returns the albedo along a direction on either side.
    #[must_use]
    pub fn albedo(&self, w: Vec3) -> Vec3 {
        self.color * look_up(w.z.abs(), self.roughness)
    }

    /// Returns the factor of what lies below.
    #[must_use]
    pub fn scaling(&self, wo: Vec3, wi: Vec3) -> f32 {
        let left = |w: Vec3| 1.0 - self.albedo(w).max_element();
        left(wo).min(left(wi)).max(0.0)
    }
}

/// Returns D G2.
fn lobe(alpha: f32, wo: Vec3, wi: Vec3) -> f32 {
    let h = (wo + wi).normalize();
    let sine = h.truncate().length();
    (2.0 + alpha.recip()) * sine.powf(alpha.recip()) / (TAU * (1.0 + lambda(wo.z, alpha) + lambda(wi.z, alpha)))
}

/// Coefficients a to e of the fit of Lambda's logarithm, for widths 0 and 1.
const FIT: [[f32; 5]; 2] =
    [[25.3245, 3.32435, 0.16801, -1.27393, -4.85967], [21.5473, 3.82987, 0.19823, -1.97760, -4.32054]];

/// Smith's Lambda.
fn lambda(cos: f32, alpha: f32) -> f32 {
    let share = (1.0 - alpha) * (1.0 - alpha);
    let logarithm = |x: f32| {
        let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|i| share * FIT[0][i] + (1.0 - share) * FIT[1][i]);
        a / (1.0 + b * x.powf(c)) + d * x + e
    };
    let exponent = if cos < 0.5 { logarithm(cos) } else { 2.0 * logarithm(0.5) - logarithm(1.0 - cos) };
    exponent.exp()
}

/// Cells along a side of the table of albedos, by the square root of the cosine and by roughness.
const SIDE: usize = 32;

/// Albedos at the middles of the cells, at most 1.
static ALBEDOS: LazyLock<Vec<[f32; SIDE]>> = LazyLock::new(|| {
    let middle = |i: usize| (i as f32 + 0.5) / SIDE as f32;
    let row = |y: usize| {
        let alpha = middle(y).max(scene::Sheen::MIN_ROUGHNESS).powi(2);
        std::array::from_fn(|x| integrate(alpha, middle(x).powi(2)).min(1.0))
    };
    (0..SIDE).into_par_iter().map(row).collect()
});

/// Integrates the lobe over the directions of light by the midpoint rule in the polar angle and the azimuth.
fn integrate(alpha: f32, cos: f32) -> f32 {
    let [polar, azimuths] = [320, 64];
    let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let mut sum = 0.0_f64;
    for i in 0..polar {
        let theta = (i as f32 + 0.5) / polar as f32 * TAU * 0.25;
        for j in 0..azimuths {
            let phi = (j as f32 + 0.5) / azimuths as f32 * TAU * 0.5;
            let wi = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            sum += f64::from(lobe(alpha, wo, wi) * theta.sin());
        }
    }
    let cell = f64::from(TAU * 0.25 * TAU) / f64::from(polar * azimuths);
    (sum * cell / f64::from(4.0 * cos)) as f32
}

/// Returns the albedo by bilinear interpolation.
fn look_up(cos: f32, roughness: f32) -> f32 {
    let place = |v: f32| {
        let v = (v * SIDE as f32 - 0.5).clamp(0.0, (SIDE - 1) as f32);
        (v as usize, (v as usize + 1).min(SIDE - 1), v.fract())
    };
    let (x0, x1, x) = place(cos.sqrt());
    let (y0, y1, y) = place(roughness);
    let row = |y: usize| ALBEDOS[y][x0] * (1.0 - x) + ALBEDOS[y][x1] * x;
    row(y0) * (1.0 - y) + row(y1) * y
}
