//! Mitsuba's `principled` and `principledthin`, after Disney's BSDF of 2012 and 2015. Metal and transmission are glTF's
//! model, and the clear coat is one of glTF's. Base and sheen are Disney's own.

use glam::Vec3;

use super::Loader;
use super::textures::{is_texture, luminance};
use super::values::Plugin;
use crate::scene::{Anisotropy, Boundary, Bsdf, Coat, DiffuseTransmission, Disney, LoadError, Material, Scalar, Sides};

impl<'a> Loader<'a> {
    /// Converts `principled`, or `principledthin` if `thin`.
    pub(super) fn principled(&mut self, plugin: &Plugin<'a>, thin: bool) -> Result<Material, LoadError> {
        let specular = plugin.float("specular")?;
        // Disney's `specular` is F0 / 0.08, and F0 = ((eta - 1) / (eta + 1))^2.
        let root = (0.08 * specular.unwrap_or(0.5).clamp(0.0, 1.0)).sqrt();
        let missing = if thin { 1.5 } else { (1.0 + root) / (1.0 - root) };
        let ior = plugin.float("eta")?.unwrap_or(missing).max(1.0);
        let base_color = self.color_parameter(plugin, "base_color")?.unwrap_or(Vec3::splat(0.5).into());
        let roughness = self.scalar_parameter(plugin, "roughness")?.unwrap_or(0.5.into());
        let aspect = aspect(plugin, &roughness)?;
        let tint = number(plugin, "spec_tint")?;
        if tint > 0.0 && base_color.texture.is_some() {
            self.warn(format!("{}: reflections have one tint, without the base's texture", plugin.element.title()));
        }
        let specular_color = hue(base_color.factor, tint).into();
        let transmission = self.scalar_parameter(plugin, "spec_trans")?.unwrap_or(0.0.into());
        let metallic = self.scalar_parameter(plugin, "metallic")?.unwrap_or(0.0.into());
        let bsdf = Bsdf::MetallicRoughness {
            base_color,
            metallic,
            // The lobe's width across its direction is aspect * roughness^2.
            roughness: Scalar { factor: roughness.factor * aspect.sqrt(), ..roughness },
            ior,
            // A thin surface reflects as much as it transmits by facets.
            specular: if thin { transmission } else { 1.0.into() },
            specular_color,
            transmission,
        };
        // A metal has no base, and light that all passes a thin surface meets none.
        let has_base = metallic != 1.0.into() && !(thin && transmission == 1.0.into());
        let width = roughness.factor * roughness.factor;
        // Of 2, all light that the base does not reflect passes; 1 is half of it.
        let passing = self.scalar_parameter(plugin, "diff_trans")?.filter(|share| thin && share.factor > 0.0);
        let diffuse_transmission = passing.map(|share| DiffuseTransmission {
            share: Scalar { factor: (0.5 * share.factor).min(1.0), ..share },
            color: base_color,
        });
        Ok(Material {
            bsdf,
            diffuse_transmission,
            anisotropy: Anisotropy::of_widths(width / aspect, width * aspect),
            disney: Some(self.disney(plugin)?).filter(|_| has_base),
            coat: self.disney_coat(plugin)?,
            sides: Sides::One,
            boundary: if thin { Boundary::Sheet } else { Boundary::Volume { absorption: Vec3::ZERO } },
            ..Material::diffuse("", Vec3::ONE)
        })
    }

    /// Converts `sheen`, `sheen_tint` and `flatness`.
    fn disney(&mut self, plugin: &Plugin<'a>) -> Result<Disney, LoadError> {
        let sheen = self.scalar_parameter(plugin, "sheen")?.unwrap_or(0.0.into());
        Ok(Disney { sheen, sheen_tint: number(plugin, "sheen_tint")?, flatness: number(plugin, "flatness")? })
    }

    /// Converts `clearcoat`: a quarter of a coat whose width is 0.1 without gloss, and 0.001 with all of it.
    fn disney_coat(&mut self, plugin: &Plugin<'a>) -> Result<Option<Coat>, LoadError> {
        let Some(weight) = self.scalar_parameter(plugin, "clearcoat")?.filter(|weight| weight.factor > 0.0) else {
            return Ok(None);
        };
        let alpha = 0.1 + (0.001 - 0.1) * number(plugin, "clearcoat_gloss")?;
        Ok(Some(Coat {
            weight: Scalar { factor: (0.25 * weight.factor).min(1.0), ..weight },
            roughness: alpha.sqrt().into(),
            normal_map: None,
        }))
    }
}

/// Returns a share, or 0 for one that is missing. A texture is left unread, which a warning tells.
fn number(plugin: &Plugin, name: &str) -> Result<f32, LoadError> {
    let element = plugin.peek(name).filter(|element| !is_texture(element));
    Ok(element.map_or(Ok(None), |_| plugin.float(name))?.unwrap_or(0.0).clamp(0.0, 1.0))
}

/// Returns the ratio of the lobe's width along v to the round one; 1 for a roughness with a texture.
fn aspect(plugin: &Plugin, roughness: &Scalar) -> Result<f32, LoadError> {
    let anisotropic = match plugin.get("anisotropic") {
        Some(element) if roughness.texture.is_none() && !is_texture(element) => plugin.float("anisotropic")?,
        _ => None,
    };
    Ok((1.0 - 0.9 * anisotropic.unwrap_or(0.0).clamp(0.0, 1.0)).sqrt())
}

/// Returns white mixed with a colour of luminance 1 and the hue of another.
fn hue(color: Vec3, share: f32) -> Vec3 {
    let luminance = luminance(color.to_array());
    if luminance > 0.0 { Vec3::ONE.lerp(color / luminance, share) } else { Vec3::ONE }
}
