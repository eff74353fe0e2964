//! The microfacet distributions GGX (Trowbridge and Reitz 1975; Walter et al. 2007) and Beckmann (`beckmann.rs`)
//! in a frame whose z is the shading normal, and Fresnel terms. A lobe may be wider along x than along y.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::beckmann;
use crate::scene::Distribution;

/// What facets of a lobe are like, beside their width.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Width along x over that along y.
    pub stretch: f32,
    /// Distribution of the normals.
    pub distribution: Distribution,
}

impl Shape {
    /// GGX facets of a lobe that is round.
    pub const ROUND: Self = Self { stretch: 1.0, distribution: Distribution::Ggx };
}

/// Widths of a lobe.
#[derive(Clone, Copy, Debug)]
pub struct Width {
    /// Width along y.
    pub alpha: f32,
    /// Stretch and distribution.
    pub shape: Shape,
}

impl From<f32> for Width {
    fn from(alpha: f32) -> Self {
        Self { alpha, shape: Shape::ROUND }
    }
}

/// Normal distribution function D of a half vector with z > 0. It is written in x and y, which keep their
/// precision where z rounds to 1.
#[must_use]
pub fn d(h: Vec3, width: impl Into<Width>) -> f32 {
    let Width { alpha, shape: Shape { stretch, distribution } } = width.into();
    let a2 = alpha * alpha;
    let x = h.x / stretch;
    let slope2 = (x * x + h.y * h.y) / a2;
    match distribution {
        Distribution::Ggx => 1.0 / (PI * a2 * stretch * (slope2 + h.z * h.z).powi(2)),
        Distribution::Beckmann => (-slope2 / (h.z * h.z)).exp() / (PI * a2 * stretch * h.z.powi(4)),
    }
}

/// Smith's Lambda of a direction on either side.
fn lambda(w: Vec3, width: impl Into<Width>) -> f32 {
    let Width { alpha, shape: Shape { stretch, distribution } } = width.into();
    let x = w.x * stretch;
    let tan2 = (x * x + w.y * w.y) / (w.z * w.z);
    match distribution {
        Distribution::Ggx => 0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0),
        Distribution::Beckmann => beckmann::lambda(alpha * tan2.sqrt()),
    }
}

/// Smith's masking function G1 of one direction.
#[must_use]
pub fn g1(w: Vec3, width: impl Into<Width>) -> f32 {
    1.0 / (1.0 + lambda(w, width))
}

/// Smith's height-correlated masking-shadowing function G2 (Heitz 2014, eq. 99).
#[must_use]
pub fn g2(wo: Vec3, wi: Vec3, width: impl Into<Width>) -> f32 {
    let width = width.into();
    1.0 / (1.0 + lambda(wo, width) + lambda(wi, width))
}

/// Density per solid angle of reflection off a visible normal: G1 D / (4 cos_o) (Heitz 2018, eq. 17).
#[must_use]
pub fn reflection_pdf_w(wo: Vec3, h: Vec3, width: impl Into<Width>) -> f32 {
    let width = width.into();
    g1(wo, width) * d(h, width) / (4.0 * wo.z)
}

/// Samples a visible normal, of GGX by spherical caps (Dupuy and Benyoub 2023).
#[must_use]
pub fn sample_visible_normal(wo: Vec3, width: impl Into<Width>, u: Vec2) -> Vec3 {
    let Width { alpha, shape: Shape { stretch, distribution } } = width.into();
    let along = alpha * stretch;
    let stretched = Vec3::new(wo.x * along, wo.y * alpha, wo.z).normalize();
    if distribution == Distribution::Beckmann {
        let slopes = beckmann::sample_visible_slopes(stretched, u);
        return Vec3::new(-slopes.x * along, -slopes.y * alpha, 1.0).normalize();
    }
    let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.x).sin_cos();
    let h = Vec3::new(r * cos, r * sin, z) + stretched;
    Vec3::new(h.x * along, h.y * alpha, h.z.max(0.0)).normalize()
}

/// Returns the cosine of the refracted direction, where the far side's index of refraction is `eta` relative
/// to this side; 0 for total internal reflection.
#[must_use]
pub fn refracted_cos(cos: f32, eta: f32) -> f32 {
    (1.0 - (1.0 - cos * cos) / (eta * eta)).max(0.0).sqrt()
}

/// Returns the direction on the far side of a facet from which light is refracted towards `wo` (Snell's law).
#[must_use]
pub fn refract(wo: Vec3, h: Vec3, eta: f32) -> Vec3 {
    let cos = wo.dot(h);
    h * (cos / eta - refracted_cos(cos, eta)) - wo / eta
}

/// Returns (1 - cos)^5 of Schlick's approximation.
#[must_use]
pub fn schlick_weight(cos: f32) -> f32 {
    let c = (1.0 - cos).clamp(0.0, 1.0);
    c * c * c * c * c
}

/// Reflectance of a smooth dielectric for unpolarized light. `cos` is measured on the side of incidence, and
/// `eta` is the other side's index of refraction relative to it.
#[must_use]
pub fn fresnel_dielectric(cos: f32, eta: f32) -> f32 {
    let cos_t = refracted_cos(cos, eta);
    if cos_t == 0.0 {
        return 1.0;
    }
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Reflectance of a conductor for unpolarized light with index of refraction eta + i k relative to the
/// outside (Born and Wolf, section 14.2, in the form of Lagarde's "Memo on Fresnel equations").
#[must_use]
pub fn fresnel_conductor(cos: f32, eta: Vec3, k: Vec3) -> Vec3 {
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    let (eta2, k2) = (eta * eta, k * k);
    let t0 = eta2 - k2 - sin2;
    let a2_b2 = (t0 * t0 + 4.0 * eta2 * k2).map(f32::sqrt);
    let t1 = a2_b2 + cos2;
    let a = (0.5 * (a2_b2 + t0)).max(Vec3::ZERO).map(f32::sqrt);
    let t2 = 2.0 * a * cos;
    let perpendicular = (t1 - t2) / (t1 + t2);
    let t3 = cos2 * a2_b2 + sin2 * sin2;
    let t4 = t2 * sin2;
    let parallel = perpendicular * (t3 - t4) / (t3 + t4);
    0.5 * (parallel + perpendicular)
}

/// Mean reflectance of a smooth dielectric for diffuse light from inside, where `eta` is the inside's index
/// of refraction relative to the outside: 2 int F(cos, 1 / eta) cos dcos, by the midpoint rule in cos^2.
#[must_use]
pub fn internal_diffuse_reflectance(eta: f32) -> f32 {
    let n = 4096;
    let sum: f64 = (0..n).map(|i| f64::from(fresnel_dielectric(((i as f32 + 0.5) / n as f32).sqrt(), 1.0 / eta))).sum();
    (sum / f64::from(n)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distribution_of_normals_projects_to_one() {
        let shapes =
            [Distribution::Ggx, Distribution::Beckmann].map(|distribution| Shape { stretch: 1.0, distribution });
        for (alpha, shape) in [0.05, 0.3, 1.0].into_iter().flat_map(|alpha| shapes.map(|shape| (alpha, shape))) {
            // Integrates int D cos dw by the midpoint rule in x, with tan(theta) / alpha = x / (1 - x).
            let n = 20_000;
            let mut sum = 0.0_f64;
            for i in 0..n {
                let x = (i as f32 + 0.5) / n as f32;
                let tan = alpha * x / (1.0 - x);
                let cos = 1.0 / (1.0 + tan * tan).sqrt();
                let dtan = alpha / ((1.0 - x) * (1.0 - x)) / n as f32;
                // dw = 2 pi sin dtheta and dtheta = cos^2 dtan.
                let sin = tan * cos;
                sum +=
                    f64::from(d(Vec3::new(sin, 0.0, cos), Width { alpha, shape }) * cos * TAU * sin * cos * cos * dtan);
            }
            assert!((sum - 1.0).abs() < 1e-3, "{alpha} {shape:?}: {sum}");
        }
    }

    #[test]
    fn fresnel_at_known_angles() {
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        assert!((fresnel_dielectric(0.0, 1.5) - 1.0).abs() < 1e-6);
        // At Brewster's angle, tan = eta, F is half the perpendicular part, ((eta^2 - 1) / (eta^2 + 1))^2 /
        // 2.
        let brewster = 1.0 / (1.0_f32 + 2.25).sqrt();
        assert!((fresnel_dielectric(brewster, 1.5) - 0.5 * (1.25_f32 / 3.25).powi(2)).abs() < 1e-6);
        assert_eq!(fresnel_dielectric(0.3, 1.0 / 1.5), 1.0, "beyond the critical angle");
        let gold = fresnel_conductor(1.0, Vec3::splat(0.2), Vec3::splat(3.0)).x;
        // At normal incidence F = ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2).
        assert!((gold - (0.64 + 9.0) / (1.44 + 9.0)).abs() < 1e-5);
        for cos in [0.1, 0.5, 0.9] {
            let as_conductor = fresnel_conductor(cos, Vec3::splat(1.5), Vec3::ZERO).x;
            assert!((as_conductor - fresnel_dielectric(cos, 1.5)).abs() < 1e-5, "k = 0 is a dielectric");
        }
    }

    #[test]
    fn internal_reflectance_follows_from_the_external_one() {
        // Reciprocity requires eta^2 (1 - F_in) = 1 - F_out, with F_out = 2 int F(cos, eta) cos dcos. For eta
        // = 1.5, F_in is about 0.596.
        for eta in [1.2, 1.5, 2.0] {
            let n = 4096;
            let out =
                (0..n).map(|i| f64::from(fresnel_dielectric(((i as f32 + 0.5) / n as f32).sqrt(), eta))).sum::<f64>()
                    / f64::from(n);
            let inside = internal_diffuse_reflectance(eta);
            let expected = 1.0 - (1.0 - out) / f64::from(eta * eta);
            assert!((f64::from(inside) - expected).abs() < 1e-3, "{eta}: {inside} is not {expected}");
        }
        assert!((internal_diffuse_reflectance(1.5) - 0.596).abs() < 2e-3);
        assert_eq!(internal_diffuse_reflectance(1.0), 0.0);
    }
}
