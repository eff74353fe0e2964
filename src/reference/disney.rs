//! The base of Disney's BSDF with its sheen (Burley 2012, 2015), in the form of Mitsuba's `principled`.

use std::f32::consts::PI;

use glam::Vec3;

use super::environment::LUMINANCE;
use super::microfacet::schlick_weight;
use super::surface::Surface;
use super::texture::Textures;
use crate::scene;

/// Base and sheen after texture look-up. Albedos are pi times BSDFs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disney {
    /// Colour of the sheen.
    pub sheen: Vec3,
    /// Colour of the base.
    pub base: Vec3,
    /// Blend between a base that is a little brighter against the light and flat subsurface scattering.
    pub flatness: f32,
}

impl Disney {
    /// Evaluates textures at a surface. `base` is the base's colour, `kept` the share of the surface that is neither metal
    /// nor transmits, and `sheened` the share that has a sheen.
    #[must_use]
    pub fn new(
        disney: &scene::Disney,
        textures: &Textures,
        surface: &Surface,
        base: Vec3,
        [kept, sheened]: [f32; 2],
    ) -> Self {
        let luminance = base.dot(LUMINANCE);
        let hue = if luminance > 0.0 { base / luminance } else { Vec3::ONE };
        let sheen = textures.scalar(&disney.sheen, surface.uvs) * sheened;
        Self { sheen: Vec3::ONE.lerp(hue, disney.sheen_tint) * sheen, base: base * kept, flatness: disney.flatness }
    }

    /// Returns the albedo for a pair of directions by their cosines with the normal and with the half vector.
    #[must_use]
    pub fn albedo_of_pair(&self, cosines: [f32; 2], cos_d: f32, alpha: f32) -> Vec3 {
        self.base * base(cosines, cos_d, alpha.sqrt(), self.flatness) + self.sheen * (PI * schlick_weight(cos_d))
    }

    /// Returns an estimate of the albedo along a direction.
    #[must_use]
    pub fn albedo(&self, cos: f32, alpha: f32) -> Vec3 {
        self.base * base([cos; 2], cos, alpha.sqrt(), self.flatness) + self.sheen * sheen_albedo(cos)
    }
}

/// Returns Disney's base relative to an even one: diffuse and retro-reflective, blended with flat scattering below the
/// surface (after Hanrahan and Krueger 1993).
fn base(cosines: [f32; 2], cos_d: f32, roughness: f32, flatness: f32) -> f32 {
    let [o, i] = cosines.map(schlick_weight);
    let retro = 2.0 * roughness * cos_d * cos_d;
    let even = (1.0 - 0.5 * o) * (1.0 - 0.5 * i) + retro * (o + i + o * i * (retro - 1.0));
    let bent = |weight: f32| 1.0 + (0.5 * retro - 1.0) * weight;
    let flat = 1.25 * (bent(o) * bent(i) * ((cosines[0] + cosines[1]).max(1e-4).recip() - 0.5) + 0.5);
    even + (flat - even) * flatness
}

/// Returns nearly the integral of (1 - cos_d)^5 cos_i over the directions of light.
fn sheen_albedo(cos: f32) -> f32 {
    3e-4 + 0.09 * (1.0 - cos).powf(2.6)
}
