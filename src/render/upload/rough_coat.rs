//! The table of rough coats (shaders/lib/surface/rough_coat.wesl): what facets of a dielectric let in from outside, and
//! what they reflect from inside.

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::render::layouts;
use crate::render::layouts::coat_size::{COAT_COLUMNS, COAT_ROWS, COAT_STRIDE};
use crate::scene::{Distribution, Material};

/// Steps of the quadrature in the steepness of facets and in their azimuth.
const STEPS: [usize; 2] = [64, 48];

/// Least width of facets.
const LEAST: f64 = 1e-4;

/// Least cosine, in place of 0.
const GRAZING: f64 = 1e-6;

/// The coats of a scene.
#[derive(Default)]
pub(super) struct RoughCoats {
    coats: Vec<Coat>,
}

/// A coat with one row of the table, or several for the widths of a texture.
#[derive(Clone, Copy, PartialEq)]
struct Coat {
    eta: f32,
    distribution: Distribution,
    widest: f32,
    rows: u32,
}

impl RoughCoats {
    /// Adds the coat of a material, if it has one, and writes its place into the record.
    pub(super) fn add(&mut self, material: &Material, record: &mut layouts::Material) {
        let Some((eta, alpha)) = material.bsdf.rough_coat() else { return };
        let rows = if alpha.texture.is_some() { COAT_ROWS } else { 1 };
        let coat = Coat { eta, distribution: material.distribution, widest: alpha.factor, rows };
        let place = self.coats.iter().position(|other| *other == coat).unwrap_or_else(|| {
            self.coats.push(coat);
            self.coats.len() - 1
        });
        let first: u32 = self.coats[..place].iter().map(|coat| coat.rows).sum();
        record.eta = [eta, (1 + first) as f32, if rows > 1 { 1.0 / alpha.factor } else { 0.0 }];
    }

    /// Returns the numbers of the table.
    pub(super) fn numbers(&self) -> Vec<f32> {
        let rows = self.coats.iter().flat_map(|coat| (0..coat.rows).map(move |row| (coat, row)));
        rows.collect::<Vec<_>>().into_par_iter().flat_map_iter(|(coat, row)| coat.row(row)).collect()
    }
}

impl Coat {
    /// Returns a row: transmittances, then the reflectance from inside, which is the sum that Mitsuba takes, with both
    /// ends in full.
    fn row(&self, row: u32) -> Vec<f32> {
        let steps = if self.rows == 1 { 1.0 } else { f64::from(row) / f64::from(COAT_ROWS - 1) };
        let facets = Facets::new(self.distribution, (f64::from(self.widest) * steps * steps).max(LEAST));
        let eta = f64::from(self.eta);
        let cosines = (0..COAT_COLUMNS).map(|i| f64::from(i) / f64::from(COAT_COLUMNS - 1));
        let inner: f64 = cosines.clone().map(|cos| 2.0 * cos * facets.reflectance(cos, 1.0 / eta)).sum();
        let transmittances = cosines.map(|cos| facets.transmittance(cos, eta) as f32);
        let mut numbers: Vec<f32> = transmittances.chain([(inner / f64::from(COAT_COLUMNS)) as f32]).collect();
        numbers.resize(COAT_STRIDE as usize, 0.0);
        numbers
    }
}

/// Facets of one width.
struct Facets {
    distribution: Distribution,
    alpha: f64,
    /// Slopes along the plane of the viewer and across it, with their shares.
    slopes: Vec<([f64; 2], f64)>,
}

impl Facets {
    /// Slopes steeper than r have the share v^2, so that v is even: r^2 = -2 alpha^2 ln v of Beckmann's, and
    /// alpha^2 (1 / v^2 - 1) of GGX.
    fn new(distribution: Distribution, alpha: f64) -> Self {
        let [rows, columns] = STEPS;
        let slope = |i: usize| {
            let v = ((i / columns) as f64 + 0.5) / rows as f64;
            let phi = PI * ((i % columns) as f64 + 0.5) / columns as f64;
            let r = match distribution {
                Distribution::Ggx => alpha * (1.0 / (v * v) - 1.0).sqrt(),
                Distribution::Beckmann => alpha * (-2.0 * v.ln()).sqrt(),
            };
            ([r * phi.cos(), r * phi.sin()], v)
        };
        Self { distribution, alpha, slopes: (0..rows * columns).map(slope).collect() }
    }

    /// Returns the mean over visible facets, of their normal and its cosine with the viewer.
    fn mean(&self, cos: f64, value: impl Fn([f64; 3], f64) -> f64) -> f64 {
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (mut sum, mut weights) = (0.0, 0.0);
        for &([x, y], share) in &self.slopes {
            let length = (1.0 + x * x + y * y).sqrt();
            let seen = cos - sin * x;
            if seen > 0.0 {
                weights += share * seen;
                sum += share * seen * value([-x / length, -y / length, 1.0 / length], (seen / length).min(1.0));
            }
        }
        sum / weights
    }

    /// Returns the share of light at a cosine that facets reflect.
    fn reflectance(&self, cos: f64, eta: f64) -> f64 {
        let cos = cos.max(GRAZING);
        self.mean(cos, |h, c| {
            let z = 2.0 * c * h[2] - cos;
            if z > 0.0 { fresnel(c, eta) * self.unmasked(z) } else { 0.0 }
        })
    }

    /// Returns the share of light at a cosine that facets refract.
    fn transmittance(&self, cos: f64, eta: f64) -> f64 {
        let cos = cos.max(GRAZING);
        self.mean(cos, |h, c| {
            // Snell's law: w = h (c / eta - c') - o / eta.
            let refracted = (1.0 - (1.0 - c * c) / (eta * eta)).max(0.0).sqrt();
            let z = h[2] * (c / eta - refracted) - cos / eta;
            if z < 0.0 { (1.0 - fresnel(c, eta)) * self.unmasked(-z) } else { 0.0 }
        })
    }

    /// Smith's G1 of a cosine.
    fn unmasked(&self, cos: f64) -> f64 {
        let tan = self.alpha * (1.0 - cos * cos).max(0.0).sqrt() / cos;
        match self.distribution {
            Distribution::Ggx => 2.0 / (1.0 + (1.0 + tan * tan).sqrt()),
            Distribution::Beckmann if tan < 1e-6 => 1.0,
            Distribution::Beckmann => {
                let a = 1.0 / tan;
                2.0 / (2.0 - erfc(a) + (-a * a).exp() * tan / PI.sqrt())
            }
        }
    }
}

/// Complementary error function of x >= 0 within 1.5e-7 (Abramowitz and Stegun, 7.1.26).
fn erfc(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let series =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    series * (-x * x).exp()
}

/// Reflectance of a smooth dielectric, whose other side has the relative index `eta`.
fn fresnel(cos: f64, eta: f64) -> f64 {
    let sin2 = (1.0 - cos * cos) / (eta * eta);
    if sin2 >= 1.0 {
        return 1.0;
    }
    let refracted = (1.0 - sin2).sqrt();
    let parallel = (eta * cos - refracted) / (eta * cos + refracted);
    let perpendicular = (cos - eta * refracted) / (cos + eta * refracted);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}
