//! Transmission of a rough dielectric coat over a diffuse base, as Mitsuba's `roughplastic` tabulates it.

use glam::{Vec2, Vec3};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use super::microfacet::{self as ggx, Shape, Width, fresnel_dielectric};
use crate::scene::{Distribution, Scalar};

/// Cosines of the table: equal steps from 0 to 1.
const COLUMNS: usize = 64;

/// Widths of the table, where a texture changes them: squares of equal steps, times the widest.
const ROWS: usize = 16;

/// Least width of facets.
const LEAST: f32 = 1e-4;

/// Least cosine, in place of 0.
const GRAZING: f32 = 1e-6;

/// Points of the quadrature, and the step of the second random number: a lattice of Fibonacci numbers, which sees the
/// critical angle from all sides. A grid of 32 x 32 points is 1 % off.
const LATTICE: [usize; 2] = [1597, 987];

/// What a coat of one index and distribution lets pass.
#[derive(Clone, Debug, PartialEq)]
pub struct RoughCoat {
    widest: f32,
    /// One for each width: a single one without a texture.
    rows: Vec<Row>,
}

/// A coat of one width.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    /// Light from outside that facets let in, by its cosine.
    transmittances: [f32; COLUMNS],
    /// Reflectance for diffuse light from inside.
    inner: f32,
}

impl RoughCoat {
    /// Integrates over the facets of a coat whose index of refraction is `eta` relative to the outside.
    #[must_use]
    pub fn new(eta: f32, distribution: Distribution, alpha: &Scalar) -> Self {
        let count = if alpha.texture.is_some() { ROWS } else { 1 };
        let row = |i: usize| {
            let alpha = if count == 1 { alpha.factor } else { alpha.factor * (i as f32 / (ROWS - 1) as f32).powi(2) };
            let shape = Shape { distribution, ..Shape::ROUND };
            Row::new(eta, Width { alpha: alpha.max(LEAST), shape })
        };
        Self { widest: alpha.factor, rows: (0..count).into_par_iter().map(row).collect() }
    }

    /// Returns the share of light from outside, at a cosine, that facets of a width let in.
    #[must_use]
    pub fn transmittance(&self, alpha: f32, cos: f32) -> f32 {
        self.look_up(alpha, |row| row.transmittance(cos))
    }

    /// Returns the reflectance for diffuse light from inside.
    #[must_use]
    pub fn inner(&self, alpha: f32) -> f32 {
        self.look_up(alpha, |row| row.inner)
    }

    fn look_up(&self, alpha: f32, value: impl Fn(&Row) -> f32) -> f32 {
        let [row] = self.rows.as_slice() else {
            let at = (alpha / self.widest).clamp(0.0, 1.0).sqrt() * (ROWS - 1) as f32;
            let low = (at as usize).min(ROWS - 2);
            let part = at - low as f32;
            return value(&self.rows[low]) * (1.0 - part) + value(&self.rows[low + 1]) * part;
        };
        value(row)
    }
}

impl Row {
    fn new(eta: f32, width: Width) -> Self {
        let cosine = |i: usize| i as f32 / (COLUMNS - 1) as f32;
        // Mitsuba's sum counts both ends in full: with its 64 cosines it is about 1.5 % less than the integral.
        let inner = |i| 2.0 * cosine(i) * reflectance(cosine(i), 1.0 / eta, width) / COLUMNS as f32;
        Self {
            transmittances: std::array::from_fn(|i| transmittance(cosine(i), eta, width)),
            inner: (0..COLUMNS).map(inner).sum(),
        }
    }

    fn transmittance(&self, cos: f32) -> f32 {
        let at = cos.clamp(0.0, 1.0) * (COLUMNS - 1) as f32;
        let low = (at as usize).min(COLUMNS - 2);
        let part = at - low as f32;
        self.transmittances[low] * (1.0 - part) + self.transmittances[low + 1] * part
    }
}

/// Returns the mean over the facets that a direction sees, by a lattice in the square of random numbers.
fn mean(cos: f32, width: Width, value: impl Fn(Vec3, Vec3) -> f32) -> f32 {
    let cos = cos.max(GRAZING);
    let wo = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let [count, step] = LATTICE;
    let at = |i: usize| Vec2::new(i as f32 + 0.5, (i * step % count) as f32 + 0.5) / count as f32;
    let sum: f32 = (0..count).map(|i| value(wo, ggx::sample_visible_normal(wo, width, at(i)))).sum();
    sum / count as f32
}

/// Returns the share of light that facets reflect, without what others mask.
fn reflectance(cos: f32, eta: f32, width: Width) -> f32 {
    mean(cos, width, |wo, h| {
        let wi = h * (2.0 * wo.dot(h)) - wo;
        if wi.z > 0.0 { fresnel_dielectric(wo.dot(h).max(0.0), eta) * ggx::g1(wi, width) } else { 0.0 }
    })
}

/// Returns the share of light that facets refract, likewise.
fn transmittance(cos: f32, eta: f32, width: Width) -> f32 {
    mean(cos, width, |wo, h| {
        let wi = ggx::refract(wo, h, eta);
        if wi.z < 0.0 { (1.0 - fresnel_dielectric(wo.dot(h).max(0.0), eta)) * ggx::g1(wi, width) } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::TextureRef;

    const DISTRIBUTIONS: [Distribution; 2] = [Distribution::Ggx, Distribution::Beckmann];

    /// Narrow facets are a smooth coat, and wide ones let less pass at normal incidence.
    #[test]
    fn narrow_facets_are_smooth() {
        for distribution in DISTRIBUTIONS {
            let coat = |alpha: f32| RoughCoat::new(1.5, distribution, &alpha.into());
            let (smooth, wide) = (coat(1e-3), coat(0.6));
            for i in 6..64 {
                let cos = i as f32 / 63.0;
                let expected = 1.0 - fresnel_dielectric(cos, 1.5);
                let found = smooth.transmittance(1e-3, cos);
                assert!((found - expected).abs() < 2e-3, "{distribution:?} {cos}: {found} is not {expected}");
                assert!(wide.transmittance(0.6, cos) < 0.99);
            }
            assert!(wide.transmittance(0.6, 0.0) > smooth.transmittance(1e-3, 0.0) + 0.2, "{distribution:?}");
        }
    }

    /// What enters comes out as well: the mean transmittance from outside is eta^2 times that from inside, so that no
    /// more leaves the base than the coat's inner side does not reflect.
    #[test]
    fn no_light_is_made() {
        for (distribution, alpha) in DISTRIBUTIONS.into_iter().flat_map(|d| [0.1, 0.3, 0.6, 1.0].map(|a| (d, a))) {
            let eta = 1.5;
            let width = Width { alpha, shape: Shape { distribution, ..Shape::ROUND } };
            let diffuse = |value: &dyn Fn(f32) -> f32| {
                (0..96).map(|i| (i as f32 + 0.5) / 96.0).map(|cos| 2.0 * cos * value(cos) / 96.0).sum::<f32>()
            };
            let outside = diffuse(&|cos| transmittance(cos, eta, width));
            let inside = diffuse(&|cos| transmittance(cos, 1.0 / eta, width));
            assert!(
                (outside / (eta * eta * inside) - 1.0).abs() < 0.01,
                "{distribution:?} {alpha}: {outside} {inside}"
            );
            let coat = RoughCoat::new(eta, distribution, &alpha.into());
            assert!(outside <= eta * eta * (1.0 - coat.inner(alpha)), "{distribution:?} {alpha}");
            let kept = diffuse(&|cos| reflectance(cos, 1.0 / eta, width));
            assert!((coat.inner(alpha) / kept - 1.0).abs() < 0.02, "{distribution:?} {alpha}");
        }
    }

    /// A texture's widths have rows of their own, between which the table interpolates.
    #[test]
    fn widths_by_a_texture() {
        let textured = Scalar { factor: 0.8, texture: Some((TextureRef::new(0), 0)) };
        for distribution in DISTRIBUTIONS {
            let table = RoughCoat::new(1.5, distribution, &textured);
            for alpha in [0.02, 0.1, 0.3, 0.5, 0.8] {
                let own = RoughCoat::new(1.5, distribution, &alpha.into());
                assert!((table.inner(alpha) - own.inner(alpha)).abs() < 2e-3, "{distribution:?} {alpha}");
                for i in 3..64 {
                    let cos = i as f32 / 63.0;
                    let error = table.transmittance(alpha, cos) - own.transmittance(alpha, cos);
                    assert!(error.abs() < 5e-3, "{distribution:?} {alpha} {cos}: {error}");
                }
            }
        }
    }
}
