//! Layers on top of a BSDF: a sheen ([`super::sheen`]), and a coat on top of it (KHR_materials_clearcoat).
//!
//! Directions are those of [`super::bsdf`]. The coat is a microfacet lobe with a normal of its own, relative to
//! which its cosines are measured. What lies below is scaled by min(1 - E(wo), 1 - E(wi)) with the coat's
//! albedo E, so that no direction gains energy and both get the same factor. A sheen scales the base likewise, and is sampled by
//! the cosine.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::bsdf::{Bsdf, Sample, cosine_hemisphere};
use super::environment::LUMINANCE;
use super::microfacet::{self as ggx, Shape, schlick_weight};
use super::sheen::Sheen;
use super::surface::{Frame, Surface};
use super::texture::Textures;
use crate::scene::{self, SMOOTH};

/// A coat after texture look-up.
#[derive(Clone, Copy, Debug)]
pub struct Coat {
    /// Share of the surface that is coated.
    pub weight: f32,
    /// GGX width.
    pub alpha: f32,
    /// Basis around the coat's normal, in the frame of the base.
    pub frame: Frame,
}

impl Coat {
    /// Evaluates a coat's textures at a surface.
    #[must_use]
    pub fn new(coat: &scene::Coat, textures: &Textures, surface: &Surface) -> Self {
        Self {
            weight: textures.scalar(&coat.weight, surface.uvs),
            alpha: textures.scalar(&coat.roughness, surface.uvs).powi(2),
            frame: Frame::new(surface.frame.local(surface.coat_normal)),
        }
    }

    /// Returns the reflectance at a cosine.
    fn reflectance(&self, cos: f32) -> f32 {
        let f0 = scene::Coat::F0;
        self.weight * (f0 + (1.0 - f0) * schlick_weight(cos))
    }

    /// Returns the albedo along a direction on either side.
    fn albedo(&self, w: Vec3) -> f32 {
        self.reflectance(self.frame.z.dot(w).abs())
    }

    /// Returns the factor of what lies below.
    fn scaling(&self, wo: Vec3, wi: Vec3) -> f32 {
        (1.0 - self.albedo(wo)).min(1.0 - self.albedo(wi))
    }

    /// Returns value and density without those of a smooth lobe, which is sampled alone.
    fn evaluate(&self, wo: Vec3, wi: Vec3) -> (f32, f32) {
        let (wo, wi) = (self.frame.local(wo), self.frame.local(wi));
        if self.alpha < SMOOTH || wo.z <= 0.0 || wi.z <= 0.0 {
            return (0.0, 0.0);
        }
        let h = (wo + wi).normalize();
        let lobe = ggx::d(h, self.alpha) * ggx::g2(wo, wi, self.alpha) / (4.0 * wo.z);
        (self.reflectance(h.dot(wo)) * lobe, ggx::reflection_pdf_w(wo, h, self.alpha))
    }

    /// Samples a direction of the coat, on the right side of its own normal.
    fn sample(&self, wo: Vec3, u: Vec2) -> Option<Vec3> {
        let wo = self.frame.local(wo);
        let h = if self.alpha < SMOOTH { Vec3::Z } else { ggx::sample_visible_normal(wo, self.alpha, u) };
        let wi = h * (2.0 * wo.dot(h)) - wo;
        (wi.z > 0.0).then(|| self.frame.world(wi))
    }
}

/// A BSDF under layers.
#[derive(Clone, Copy, Debug)]
pub struct Layered<'s> {
    /// What lies below.
    pub base: Bsdf<'s>,
    /// Facets of the base's lobe.
    pub shape: Shape,
    /// The sheen, if there is one.
    pub sheen: Option<Sheen>,
    /// The coat on top of both, if there is one.
    pub coat: Option<Coat>,
}

impl<'s> From<Bsdf<'s>> for Layered<'s> {
    fn from(base: Bsdf<'s>) -> Self {
        Self { base, shape: Shape::ROUND, sheen: None, coat: None }
    }
}

/// Probabilities of sampling the layers for one viewer. The base has the rest.
struct Choice {
    coat: f32,
    sheen: f32,
}

impl Layered<'_> {
    /// Returns the directional albedo along `wo`, as [`Bsdf::albedo`].
    #[must_use]
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        let coat = self.coat.map_or(0.0, |coat| coat.albedo(wo));
        let [sheen, base] = self.below_coat(wo);
        (sheen + base) * (1.0 - coat) + coat
    }

    /// Returns the albedos of the sheen and of the base under it.
    fn below_coat(&self, wo: Vec3) -> [Vec3; 2] {
        let base = self.base.albedo(wo);
        self.sheen.map_or([Vec3::ZERO, base], |sheen| [sheen.albedo(wo), base * sheen.scaling(wo, wo)])
    }

    /// Returns true if the surface transmits light.
    #[must_use]
    pub fn transmits(&self) -> bool {
        self.base.transmits()
    }

    /// Returns true if all lobes are specular, so that next-event estimation cannot contribute.
    #[must_use]
    pub fn smooth(&self, wo: Vec3) -> bool {
        self.base.smooth(wo)
            && self.sheen.is_none_or(|sheen| sheen.color == Vec3::ZERO)
            && self.coat.is_none_or(|coat| coat.alpha < SMOOTH || coat.weight == 0.0)
    }

    /// Returns the probabilities of the layers, in proportion to their albedos; none of a coat that the viewer
    /// does not see.
    fn choice(&self, wo: Vec3) -> Choice {
        let [sheen, base] = self.below_coat(wo).map(|albedo| albedo.dot(LUMINANCE));
        let seen = self.coat.filter(|coat| wo.z > 0.0 && coat.frame.z.dot(wo) > 0.0);
        let reflected = seen.map_or(0.0, |coat| coat.albedo(wo));
        let coat = if reflected > 0.0 { reflected / (reflected + (1.0 - reflected) * (sheen + base)) } else { 0.0 };
        Choice { coat, sheen: if sheen > 0.0 { (1.0 - coat) * sheen / (sheen + base) } else { 0.0 } }
    }

    /// Returns the factor by which the layers scale the base.
    fn scaling(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.sheen.map_or(1.0, |sheen| sheen.scaling(wo, wi)) * self.coat.map_or(1.0, |coat| coat.scaling(wo, wi))
    }

    /// Returns f |cos_i| and the density per solid angle for a pair of directions, without specular lobes.
    #[must_use]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        let choice = self.choice(wo);
        let (base, base_pdf_w) = self.base.evaluate_shaped(wo, wi, self.shape);
        let mut value = base * self.scaling(wo, wi);
        let mut pdf_w = base_pdf_w * (1.0 - choice.coat - choice.sheen);
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return (value, pdf_w);
        }
        if let Some(sheen) = self.sheen {
            value += sheen.evaluate(wo, wi) * self.coat.map_or(1.0, |coat| coat.scaling(wo, wi));
            pdf_w += choice.sheen * wi.z * FRAC_1_PI;
        }
        if let Some(coat) = self.coat.filter(|_| choice.coat > 0.0) {
            let (of_coat, coat_pdf_w) = coat.evaluate(wo, wi);
            value += of_coat;
            pdf_w += choice.coat * coat_pdf_w;
        }
        (value, pdf_w)
    }

    /// Samples a direction; none if it is on the wrong side of the surface. `fork` is a third random number
    /// for surfaces that transmit.
    #[must_use]
    pub fn sample(&self, wo: Vec3, u: Vec2, fork: f32) -> Option<Sample> {
        let rough = |wi: Vec3, eta: f32| {
            let (value, pdf_w) = self.evaluate(wo, wi);
            (pdf_w > 0.0).then(|| Sample { wi, weight: value / pdf_w, pdf_w: Some(pdf_w), eta })
        };
        // One random number chooses the layer and, rescaled, samples it.
        let Choice { coat: of_coat, sheen: of_sheen } = self.choice(wo);
        let rescaled = |from: f32, share: f32| u.with_x(((u.x - from) / share).clamp(0.0, 1.0 - f32::EPSILON / 2.0));
        if let Some(coat) = self.coat.filter(|_| u.x < of_coat) {
            let wi = coat.sample(wo, rescaled(0.0, of_coat)).filter(|wi| wi.z > 0.0)?;
            if coat.alpha < SMOOTH {
                let weight = Vec3::splat(coat.albedo(wo) / of_coat);
                return Some(Sample { wi, weight, pdf_w: None, eta: 1.0 });
            }
            return rough(wi, 1.0);
        }
        if u.x < of_coat + of_sheen {
            return rough(cosine_hemisphere(rescaled(of_coat, of_sheen)), 1.0);
        }
        let of_base = 1.0 - of_coat - of_sheen;
        let sample = self.base.sample_shaped(wo, rescaled(of_coat + of_sheen, of_base), fork, self.shape)?;
        match sample.pdf_w {
            Some(_) => rough(sample.wi, sample.eta),
            None => {
                let weight = sample.weight * (self.scaling(wo, sample.wi) / of_base);
                Some(Sample { weight, ..sample })
            }
        }
    }
}
