//! Mixes of BSDFs: Mitsuba's `blendbsdf`, and `mixturebsdf` of 0.5. What is one material of the model becomes one.

use glam::Vec3;

use super::Loader;
use super::bsdfs::Surface;
use super::values::{Plugin, numbers};
use super::xml::Element;
use crate::scene::{Bsdf, LoadError, Material, Mix, Opacity, Scalar, Sides};

impl<'a> Loader<'a> {
    /// Converts a blend of two BSDFs, of which the weight is the share of the second one.
    pub(super) fn blend(&mut self, plugin: &Plugin<'a>, depth: usize) -> Result<Surface, LoadError> {
        let nested = plugin.nested("bsdf");
        let &[first, second] = nested.as_slice() else {
            return Err(plugin.element.error(format!("`blendbsdf` needs two bsdfs inside, not {}", nested.len())));
        };
        let weight = self.scalar_parameter(plugin, "weight")?.unwrap_or(0.5.into());
        let parts = [self.surface_at(first, depth + 1)?, self.surface_at(second, depth + 1)?];
        Ok(self.mixed(weight, parts, plugin.element))
    }

    /// Converts a sum of weighted BSDFs; weights of more than 1 in all are scaled down to 1, and what is missing to 1 is
    /// absorbed.
    pub(super) fn mixture(&mut self, plugin: &Plugin<'a>, depth: usize) -> Result<Surface, LoadError> {
        plugin.ignore(&["ensure_energy_conservation"]);
        let (element, nested) = (plugin.element, plugin.nested("bsdf"));
        let weights = plugin.string("weights")?.map(|text| numbers(element, text)).transpose()?.unwrap_or_default();
        if weights.len() != nested.len() || weights.is_empty() {
            let (weights, parts) = (weights.len(), nested.len());
            return Err(element.error(format!("`mixturebsdf` has {weights} weights for {parts} bsdfs")));
        }
        let weights: Vec<f32> = weights.iter().map(|weight| weight.max(0.0) as f32).collect();
        let black = Material { sides: Sides::One, ..Material::diffuse("", Vec3::ZERO) };
        let mut mixed = Surface { material: black, basis: None, bump: false };
        let mut sum = (1.0 - weights.iter().sum::<f32>()).max(0.0);
        for (part, weight) in nested.into_iter().zip(weights) {
            let part = self.surface_at(part, depth + 1)?;
            sum += weight;
            if weight > 0.0 {
                mixed = self.mixed((weight / sum).into(), [mixed, part], element);
            }
        }
        Ok(mixed)
    }

    /// Mixes two surfaces.
    fn mixed(&mut self, mut weight: Scalar, [mut first, mut second]: [Surface; 2], element: &Element) -> Surface {
        match sole(&weight) {
            Some(0) => return first,
            Some(_) => return second,
            None => {}
        }
        let mut opacity = None;
        if first.material.opacity.is_some() || second.material.opacity.is_some() {
            let presence = [&first, &second].map(|part| presence(&part.material));
            (first.material.opacity, second.material.opacity) = (None, None);
            match (weight.texture, presence) {
                // Of a `null` nothing is left to mix.
                (_, [Some(0.0), Some(1.0)]) => {
                    second.material.opacity = Some(Opacity::Blended { value: weight });
                    return second;
                }
                (None, [Some(a), Some(b)]) => {
                    let sum = a + (b - a) * weight.factor;
                    opacity = Some(Opacity::Blended { value: sum.into() });
                    weight.factor *= b / sum.max(f32::MIN_POSITIVE);
                    if let Some(part) = sole(&weight) {
                        let Surface { material, basis, bump } = if part == 0 { first } else { second };
                        return Surface { material: Material { opacity, ..material }, basis, bump };
                    }
                }
                _ => self.warn(format!("{}: masks with textures inside a blend are left out", element.title())),
            }
        }
        if first.basis.is_some() && second.basis.is_some() && (first.basis, first.bump) != (second.basis, second.bump) {
            self.warn(format!("{}: of unlike normal and bump maps only the first counts", element.title()));
            second.material.change_plain(&mut |part| part.normal_map = None);
            second.basis = None;
        }
        let (basis, bump) = if first.basis.is_some() { (first.basis, first.bump) } else { (second.basis, second.bump) };
        let material = Material { opacity, ..one_of(weight, [first.material, second.material]) };
        Surface { material, basis, bump }
    }
}

/// Returns the only part of a mix that counts, if the weight says so everywhere.
fn sole(weight: &Scalar) -> Option<usize> {
    match weight.factor {
        _ if weight.texture.is_some() => None,
        ..=0.0 => Some(0),
        1.0.. => Some(1),
        _ => None,
    }
}

/// Returns the probability that a surface stops a ray; none if it has a texture.
fn presence(material: &Material) -> Option<f32> {
    match &material.opacity {
        None => Some(1.0),
        Some(opacity) if opacity.value().texture.is_some() => None,
        Some(Opacity::Blended { value }) => Some(value.factor.clamp(0.0, 1.0)),
        Some(Opacity::CutOut { value, cutoff }) => Some(f32::from(value.factor >= *cutoff)),
    }
}

/// Returns a mix as one material: two diffuse ones without textures are one.
fn one_of(weight: Scalar, parts: [Material; 2]) -> Material {
    if let [Bsdf::Diffuse { reflectance: a }, Bsdf::Diffuse { reflectance: b }] = parts.each_ref().map(|part| part.bsdf)
        && weight.texture.is_none()
        && a.texture.is_none()
        && b.texture.is_none()
    {
        let bsdf = Bsdf::Diffuse { reflectance: a.factor.lerp(b.factor, weight.factor).into() };
        let alike = parts.each_ref().map(|part| Material { name: String::new(), bsdf, ..part.clone() });
        if alike[0] == alike[1] && alike[0].mix.is_none() {
            return Material { bsdf, ..parts.into_iter().next().unwrap_or_else(|| Material::diffuse("", Vec3::ONE)) };
        }
    }
    let two_sided = parts.iter().any(|part| part.sides == Sides::Two);
    let boundary = parts.iter().find(|part| part.transmits()).unwrap_or(&parts[0]).boundary;
    Material {
        sides: if two_sided { Sides::Two } else { Sides::One },
        boundary,
        mix: Some(Mix { weight, parts: Box::new(parts) }),
        ..Material::diffuse("", Vec3::ONE)
    }
}
