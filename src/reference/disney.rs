//! Sheen and flatness of Disney's BSDF (Burley 2012, 2015) on a diffuse base, in the form of Mitsuba's `principled`.

use std::f32::consts::PI;

use glam::Vec3;

use super::environment::LUMINANCE;
use super::microfacet::schlick_weight;
use super::surface::Surface;
use super::texture::Textures;
use crate::scene;

/// Sheen and flatness after texture look-up. Albedos are pi times BSDFs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disney {
    /// Colour of the sheen.
    pub sheen: Vec3,
    /// Blend between the base and flat subsurface scattering.
    pub flatness: f32,
    /// Albedo of the latter.
    pub flat: Vec3,
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
        Self { sheen: Vec3::ONE.lerp(hue, disney.sheen_tint) * sheen, flatness: disney.flatness, flat: base * kept }
    }

    /// Returns the albedo of a base for a pair of directions by their cosines with the normal and with the half vector.
    #[must_use]
    pub fn albedo_of_pair(&self, base: Vec3, [cos_o, cos_i]: [f32; 2], cos_d: f32, alpha: f32) -> Vec3 {
        self.flattened(base, [cos_o, cos_i], cos_d, alpha) + self.sheen * (PI * schlick_weight(cos_d))
    }

    /// Returns an estimate of the albedo along a direction.
    #[must_use]
    pub fn albedo(&self, base: Vec3, cos: f32, alpha: f32) -> Vec3 {
        self.flattened(base, [cos, cos], cos, alpha) + self.sheen * sheen_albedo(cos)
    }

    fn flattened(&self, base: Vec3, cosines: [f32; 2], cos_d: f32, alpha: f32) -> Vec3 {
        if self.flatness == 0.0 {
            return base;
        }
        base.lerp(self.flat * subsurface(cosines, cos_d, alpha.sqrt()), self.flatness)
    }
}

/// Flat scattering below the surface, after Hanrahan and Krueger 1993, relative to an even one.
fn subsurface([cos_o, cos_i]: [f32; 2], cos_d: f32, roughness: f32) -> f32 {
    let grazing = roughness * cos_d * cos_d;
    let bent = |cos: f32| 1.0 + (grazing - 1.0) * schlick_weight(cos);
    1.25 * (bent(cos_o) * bent(cos_i) * ((cos_o + cos_i).max(1e-4).recip() - 0.5) + 0.5)
}

/// Returns nearly the integral of (1 - cos_d)^5 cos_i over the directions of light.
fn sheen_albedo(cos: f32) -> f32 {
    3e-4 + 0.09 * (1.0 - cos).powf(2.6)
}
