//! Materials, textures and images.

use std::collections::HashMap;

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::{AlphaMode, Material as JsonMaterial};
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Affine2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::file::File;
use crate::scene::{
    Boundary, Bsdf, Color, Emission, Filter, Image, LoadError, Material, NormalMap, Opacity, Scalar, Scene, Sides,
    Texture, TextureRef, Wrap,
};

/// Converts materials and collects the images that they refer to.
#[derive(Default)]
pub(super) struct Materials {
    textures: HashMap<(usize, Option<usize>, bool), usize>,
    images: Vec<Index<json::Image>>,
}

/// Returns the material of primitives without one.
pub(super) fn default_material() -> Material {
    Material {
        bsdf: Bsdf::MetallicRoughness {
            base_color: Vec3::ONE.into(),
            metallic: 1.0.into(),
            roughness: 1.0.into(),
            ior: 1.5,
            specular: 1.0.into(),
            specular_color: Vec3::ONE.into(),
            transmission: 0.0.into(),
        },
        sides: Sides::OneCulled,
        ..Material::diffuse("default", Vec3::ONE)
    }
}

impl Materials {
    /// Converts a material; `has_colors` is true if a mesh with vertex colours uses it.
    pub fn convert(
        &mut self,
        file: &File,
        scene: &mut Scene,
        index: usize,
        material: &JsonMaterial,
        has_colors: bool,
    ) -> Result<Material, LoadError> {
        let place = format!("materials[{index}]");
        check_numbers(file, scene, &place, material)?;
        let name = material.name.clone().unwrap_or_else(|| place.clone());
        let pbr = &material.pbr_metallic_roughness;
        let extensions = material.extensions.as_ref();
        let factor = Vec4::from(pbr.base_color_factor.0).clamp(Vec4::ZERO, Vec4::ONE);
        let unit = |value: f32| value.clamp(0.0, 1.0);
        let at = |part: &str| format!("{place}.{part}");
        let mut texture = |info: &Option<Info>, part: &str, srgb: bool| {
            let Some(info) = info else { return Ok(None) };
            let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            self.texture(file, scene, info.index, info.tex_coord, transform, &at(part), srgb)
        };

        let base_color_texture = texture(&pbr.base_color_texture, "pbrMetallicRoughness.baseColorTexture", true)?;
        let base_color = Color { factor: factor.truncate(), texture: base_color_texture };
        let metal_rough =
            texture(&pbr.metallic_roughness_texture, "pbrMetallicRoughness.metallicRoughnessTexture", false)?;
        let emissive = texture(&material.emissive_texture, "emissiveTexture", true)?;
        let mut specular = Scalar::from(1.0);
        let mut specular_color = Color::from(Vec3::ONE);
        if let Some(s) = extensions.and_then(|e| e.specular.as_ref()) {
            let strength = texture(&s.specular_texture, "KHR_materials_specular.specularTexture", false)?;
            specular = Scalar { factor: unit(s.specular_factor.0), texture: strength.map(|t| (t, 3)) };
            let color = texture(&s.specular_color_texture, "KHR_materials_specular.specularColorTexture", true)?;
            specular_color = Color { factor: Vec3::from(s.specular_color_factor.0), texture: color };
        }
        let mut transmission = Scalar::from(0.0);
        if let Some(t) = extensions.and_then(|e| e.transmission.as_ref()) {
            let share = texture(&t.transmission_texture, "KHR_materials_transmission.transmissionTexture", false)?;
            transmission = Scalar { factor: unit(t.transmission_factor.0), texture: share.map(|t| (t, 0)) };
        }
        let boundary = read_boundary(scene, extensions.and_then(|e| e.volume.as_ref()));
        let normal_map = self.normal_map(file, scene, index, material)?;

        let ior = extensions.and_then(|e| e.ior.as_ref()).map_or(1.5, |i| i.ior.0);
        let strength = extensions.and_then(|e| e.emissive_strength.as_ref()).map_or(1.0, |s| s.emissive_strength.0);
        let radiance = Vec3::from(material.emissive_factor.0) * strength;
        let two_sided = material.double_sided;
        let mut out = Material {
            name,
            bsdf: Bsdf::MetallicRoughness {
                base_color,
                metallic: Scalar { factor: unit(pbr.metallic_factor.0), texture: metal_rough.map(|t| (t, 2)) },
                roughness: Scalar { factor: unit(pbr.roughness_factor.0), texture: metal_rough.map(|t| (t, 1)) },
                ior,
                specular,
                specular_color,
                transmission,
            },
            emission: (radiance != Vec3::ZERO)
                .then_some(Emission { radiance: Color { factor: radiance, texture: emissive }, two_sided }),
            normal_map,
            coat: None,
            opacity: opacity(file, &place, material, base_color_texture)?,
            // Transmitted light reaches both sides.
            sides: if two_sided || transmission.factor > 0.0 { Sides::Two } else { Sides::OneCulled },
            boundary,
        };
        // A dielectric without reflection is Lambertian. `Bsdf::Diffuse` does not support vertex colours.
        if specular.factor == 0.0 && pbr.metallic_factor.0 == 0.0 && transmission.factor == 0.0 && !has_colors {
            out.bsdf = Bsdf::Diffuse { reflectance: base_color };
        }
        if extensions.is_some_and(|e| e.unlit.is_some()) {
            make_unlit(scene, &mut out, base_color, has_colors);
        }
        Ok(out)
    }

    /// Converts a material's normal map, if it has one.
    fn normal_map(
        &mut self,
        file: &File,
        scene: &mut Scene,
        index: usize,
        material: &JsonMaterial,
    ) -> Result<Option<NormalMap>, LoadError> {
        let Some(map) = &material.normal_texture else { return Ok(None) };
        // The parser omits the texture transform of normal textures, so it is read from the JSON itself.
        let transform = file.normal_transforms.get(&index);
        let place = format!("materials[{index}].normalTexture");
        let texture = self.texture(file, scene, map.index, map.tex_coord, transform, &place, false)?;
        Ok(texture.map(|texture| NormalMap { texture, scale: map.scale }))
    }

    /// Returns the scene's texture for a reference, or `None` if its image has no supported format.
    fn texture(
        &mut self,
        file: &File,
        scene: &mut Scene,
        index: Index<json::Texture>,
        mut uv_set: u32,
        transform: Option<&TextureTransform>,
        place: &str,
        srgb: bool,
    ) -> Result<Option<TextureRef>, LoadError> {
        let texture = file.get(index, place, "textures")?;
        let referrer = place;
        let place = format!("textures[{}]", index.value());
        // The parser represents a missing source by u32::MAX, as for images in AVIF alone.
        if texture.source.value() == u32::MAX as usize {
            scene.warn(format!("{place} has no image in a supported format (PNG, JPEG, WebP, KTX2): it is left out"));
            return Ok(None);
        }
        file.get(texture.source, &place, "images")?;
        let (wrap, filter) = wrap_modes(file, texture, &place)?;
        let mut out = Texture { image: 0, wrap, filter, srgb };
        let key = (texture.source.value(), texture.sampler.map(|s| s.value()), srgb);
        let texture = match self.textures.get(&key) {
            Some(&known) => known,
            None => {
                out.image = self.images.iter().position(|&i| i == texture.source).unwrap_or_else(|| {
                    self.images.push(texture.source);
                    self.images.len() - 1
                });
                scene.textures.push(out);
                self.textures.insert(key, scene.textures.len() - 1);
                scene.textures.len() - 1
            }
        };
        let mut affine = Affine2::IDENTITY;
        if let Some(t) = transform {
            if ![t.rotation.0].iter().chain(&t.offset.0).chain(&t.scale.0).all(|v| v.is_finite()) {
                return Err(file.error(referrer, "the texture transform is not finite"));
            }
            // KHR_texture_transform is translation * rotation * scale, the rotation counter-clockwise with v
            // down.
            affine = Affine2::from_scale_angle_translation(t.scale.0.into(), -t.rotation.0, Vec2::from(t.offset.0));
            uv_set = t.tex_coord.unwrap_or(uv_set);
        }
        if uv_set > 1 {
            scene.warn(format!("texture coordinates TEXCOORD_{uv_set} are not read: TEXCOORD_0 is used instead"));
            uv_set = 0;
        }
        Ok(Some(TextureRef { texture, uv_set, transform: affine }))
    }

    /// Decodes the images that materials refer to.
    pub fn load_images(&self, file: &File) -> Result<Vec<Image>, LoadError> {
        self.images.par_iter().map(|&index| read_image(file, index, Image::decode)).collect()
    }
}

/// Returns wrap modes and filter of a texture's sampler.
pub(super) fn wrap_modes(file: &File, texture: &json::Texture, place: &str) -> Result<([Wrap; 2], Filter), LoadError> {
    let (mut wraps, mut filter) = ([Wrap::Repeat; 2], Filter::Linear);
    if let Some(sampler) = texture.sampler {
        let s = file.get(sampler, place, "samplers")?;
        let place = format!("samplers[{}]", sampler.value());
        for (wrap, mode) in wraps.iter_mut().zip([&s.wrap_s, &s.wrap_t]) {
            *wrap = match mode {
                Checked::Valid(WrappingMode::Repeat) => Wrap::Repeat,
                Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
                Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
                Checked::Invalid => return Err(file.error(place, "unknown wrapping mode")),
            };
        }
        if matches!(s.mag_filter, Some(Checked::Valid(MagFilter::Nearest))) {
            filter = Filter::Nearest;
        }
    }
    Ok((wraps, filter))
}

/// Decodes an image from its bytes and its name.
pub(super) fn read_image<T>(
    file: &File,
    index: Index<json::Image>,
    decode: impl Fn(&[u8], &str) -> Result<T, String>,
) -> Result<T, LoadError> {
    let place = format!("images[{}]", index.value());
    let image = file.get(index, &place, "images")?;
    let external = image.uri.as_deref().filter(|uri| !uri.starts_with("data:"));
    let name = external.map(str::to_owned).or_else(|| image.name.clone()).unwrap_or(place.clone());
    let decode = |bytes: &[u8]| {
        let place = external.map_or(place.clone(), |uri| format!("{place} ({uri})"));
        decode(bytes, &name).map_err(|cause| file.error(place, cause))
    };
    match (&image.uri, image.buffer_view) {
        (Some(uri), _) => decode(&file.fetch(uri, &place)?),
        (None, Some(view)) => decode(file.view(view, &place)?),
        (None, None) => Err(file.error(place, "has neither a uri nor a bufferView")),
    }
}

/// Replaces a material by its unlit form: black, with the base colour as emission.
fn make_unlit(scene: &mut Scene, material: &mut Material, base_color: Color, has_colors: bool) {
    scene.warn(format!(
        "material `{}` is unlit (KHR_materials_unlit): it is black and emits its base colour to both sides{}",
        material.name,
        if has_colors { ", without its vertex colours" } else { "" }
    ));
    material.bsdf = Bsdf::Diffuse { reflectance: Vec3::ZERO.into() };
    material.emission = Some(Emission { radiance: base_color, two_sided: true });
    material.normal_map = None;
    material.sides = Sides::Two;
}

/// Converts the medium behind a surface; thickness textures are ignored with a warning.
fn read_boundary(scene: &mut Scene, volume: Option<&json::extensions::material::Volume>) -> Boundary {
    let Some(volume) = volume else { return Boundary::Sheet };
    if volume.thickness_texture.is_some() {
        scene.warn("thickness textures of KHR_materials_volume are ignored: light travels as far as the mesh is thick");
    }
    boundary(volume)
}

/// Converts KHR_materials_volume: white light is attenuated to the colour over the distance.
fn boundary(volume: &json::extensions::material::Volume) -> Boundary {
    if volume.thickness_factor.0 == 0.0 {
        return Boundary::Sheet;
    }
    // The lower bound keeps the absorption finite.
    let color = Vec3::from(volume.attenuation_color.0).clamp(Vec3::splat(f32::MIN_POSITIVE), Vec3::ONE);
    Boundary::Volume { absorption: (-color.ln() / volume.attenuation_distance.0).min(Vec3::splat(f32::MAX)) }
}

/// Checks that numbers are finite and not negative; values above the unit interval are clamped with a
/// warning.
fn check_numbers(file: &File, scene: &mut Scene, place: &str, material: &JsonMaterial) -> Result<(), LoadError> {
    let pbr = &material.pbr_metallic_roughness;
    let extensions = material.extensions.as_ref();
    let mut units = pbr.base_color_factor.0.to_vec();
    units.extend([pbr.metallic_factor.0, pbr.roughness_factor.0]);
    let mut numbers = material.emissive_factor.0.to_vec();
    if let Some(s) = extensions.and_then(|e| e.specular.as_ref()) {
        units.push(s.specular_factor.0);
        numbers.extend(s.specular_color_factor.0);
    }
    numbers.extend(extensions.and_then(|e| e.ior.as_ref()).map(|i| i.ior.0));
    numbers.extend(extensions.and_then(|e| e.emissive_strength.as_ref()).map(|s| s.emissive_strength.0));
    units.extend(extensions.and_then(|e| e.transmission.as_ref()).map(|t| t.transmission_factor.0));
    if let Some(v) = extensions.and_then(|e| e.volume.as_ref()) {
        numbers.push(v.thickness_factor.0);
        units.extend(v.attenuation_color.0);
        let distance = v.attenuation_distance.0;
        if distance.is_nan() || distance <= 0.0 {
            return Err(file.error(place, format!("an attenuationDistance of {distance} is not positive")));
        }
    }
    numbers.extend(material.normal_texture.as_ref().map(|n| n.scale.abs()));
    // The product with the factor has to be finite, too.
    if let Some(number) = numbers.iter().find(|n| !(0.0..1e18).contains(*n)) {
        return Err(file.error(place, format!("a value of {number} is out of range")));
    }
    if units.iter().any(|u| !(0.0..=1.0).contains(u)) {
        scene.warn(format!("{place} has factors outside [0, 1]: they are clamped"));
    }
    Ok(())
}

fn opacity(
    file: &File,
    place: &str,
    material: &JsonMaterial,
    texture: Option<TextureRef>,
) -> Result<Option<Opacity>, LoadError> {
    let factor = material.pbr_metallic_roughness.base_color_factor.0[3];
    let value = Scalar { factor, texture: texture.map(|t| (t, 3)) };
    match &material.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => Ok(None),
        Checked::Valid(AlphaMode::Mask) => {
            Ok(Some(Opacity::CutOut { value, cutoff: material.alpha_cutoff.map_or(0.5, |c| c.0) }))
        }
        Checked::Valid(AlphaMode::Blend) => Ok(Some(Opacity::Blended { value })),
        Checked::Invalid => Err(file.error(place, "unknown alphaMode")),
    }
}
