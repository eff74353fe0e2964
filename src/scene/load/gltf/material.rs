//! Materials, textures and images.

use std::collections::HashMap;

use ::gltf::json::extensions::material::PbrSpecularGlossiness;
use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::{AlphaMode, Material as JsonMaterial};
use ::gltf::json::texture::{Info, MagFilter, WrappingMode};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Affine2, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::NO_IMAGE;
use super::extensions::{self, NormalTexture};
use super::file::File;
use crate::scene::{
    Anisotropy, Boundary, Bsdf, Coat, Color, DiffuseTransmission, Distribution, Emission, Film, Filter, Image,
    LoadError, Material, NormalMap, Opacity, Scalar, Scene, Sheen, Sides, Texture, TextureRef, Wrap,
};

/// Converts materials and collects the images that they refer to.
#[derive(Default)]
pub(super) struct Materials {
    textures: HashMap<(usize, Option<usize>, bool), usize>,
    images: Vec<Index<json::Image>>,
    /// Textures whose alpha is a glossiness that has to become a roughness, each with its factor.
    glossy: Vec<(usize, f32)>,
}

/// The reflection of a material and its alpha.
struct Base {
    bsdf: Bsdf,
    base_color: Color,
    alpha: Scalar,
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
        let extensions = material.extensions.as_ref();
        let Base { mut bsdf, base_color, alpha } = match extensions.and_then(|e| e.pbr_specular_glossiness.as_ref()) {
            Some(pbr) => self.specular_glossiness(file, scene, &place, pbr)?,
            None => self.metallic_roughness(file, scene, &place, material)?,
        };
        let at = |part: &str| format!("{place}.{part}");
        let emissive = self.plain_texture(file, scene, &at("emissiveTexture"), &material.emissive_texture, true)?;
        let mut transmits = false;
        if let Bsdf::MetallicRoughness { transmission, .. } = &mut bsdf
            && let Some(t) = extensions.and_then(|e| e.transmission.as_ref())
        {
            let place = at("KHR_materials_transmission.transmissionTexture");
            let share = self.plain_texture(file, scene, &place, &t.transmission_texture, false)?;
            let factor = t.transmission_factor.0.clamp(0.0, 1.0);
            *transmission = Scalar { factor, texture: share.map(|t| (t, 0)) };
            transmits = factor > 0.0;
        }
        let boundary = read_boundary(scene, extensions.and_then(|e| e.volume.as_ref()));
        let normal_map = self.normal_map(file, scene, &at("normalTexture"), file.normal_maps.get(&index))?;
        let dispersion = dispersion(file, &place, material)?;
        let diffuse_transmission = self.diffuse_transmission(file, scene, &place, material)?;
        transmits |= diffuse_transmission.is_some();
        let film = self.film(file, scene, &place, material)?;
        let anisotropy = self.anisotropy(file, scene, &place, material)?;
        let sheen = self.sheen(file, scene, &place, material)?;
        let coat = self.coat(file, scene, &place, material)?;

        let strength = extensions.and_then(|e| e.emissive_strength.as_ref()).map_or(1.0, |s| s.emissive_strength.0);
        let radiance = Vec3::from(material.emissive_factor.0) * strength;
        let two_sided = material.double_sided;
        let mut out = Material {
            name,
            bsdf,
            distribution: Distribution::Ggx,
            emission: (radiance != Vec3::ZERO)
                .then_some(Emission { radiance: Color { factor: radiance, texture: emissive }, two_sided }),
            normal_map,
            diffuse_transmission,
            film,
            anisotropy,
            disney: None,
            sheen,
            coat,
            mix: None,
            opacity: opacity(file, &place, material, alpha)?,
            // Transmitted light reaches both sides.
            sides: if two_sided || transmits { Sides::Two } else { Sides::OneCulled },
            boundary,
            dispersion,
        };
        if dispersion > 0.0 && out.iors().is_none() {
            scene.warn(format!("{place} has a dispersion, but no volume that refracts light: it is left out"));
        }
        // A dielectric without reflection is Lambertian. `Bsdf::Diffuse` does not support vertex colours or films.
        if let Bsdf::MetallicRoughness { specular, metallic, .. } = out.bsdf
            && specular.factor == 0.0
            && metallic.factor == 0.0
            && !transmits
            && !has_colors
            && out.film.is_none()
        {
            out.bsdf = Bsdf::Diffuse { reflectance: base_color };
        }
        if extensions.is_some_and(|e| e.unlit.is_some()) {
            make_unlit(scene, &mut out, base_color, has_colors);
        }
        Ok(out)
    }

    /// Converts the core material with KHR_materials_specular and KHR_materials_ior.
    fn metallic_roughness(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        material: &JsonMaterial,
    ) -> Result<Base, LoadError> {
        let pbr = &material.pbr_metallic_roughness;
        let extensions = material.extensions.as_ref();
        let unit = |value: f32| value.clamp(0.0, 1.0);
        let mut texture = |info: &Option<Info>, part: &str, srgb: bool| {
            self.plain_texture(file, scene, &format!("{place}.{part}"), info, srgb)
        };
        let factor = Vec4::from(pbr.base_color_factor.0).clamp(Vec4::ZERO, Vec4::ONE);
        let texture_of_color = texture(&pbr.base_color_texture, "pbrMetallicRoughness.baseColorTexture", true)?;
        let base_color = Color { factor: factor.truncate(), texture: texture_of_color };
        let metal_rough =
            texture(&pbr.metallic_roughness_texture, "pbrMetallicRoughness.metallicRoughnessTexture", false)?;
        let mut specular = Scalar::from(1.0);
        let mut specular_color = Color::from(Vec3::ONE);
        if let Some(s) = extensions.and_then(|e| e.specular.as_ref()) {
            let strength = texture(&s.specular_texture, "KHR_materials_specular.specularTexture", false)?;
            specular = Scalar { factor: unit(s.specular_factor.0), texture: strength.map(|t| (t, 3)) };
            let color = texture(&s.specular_color_texture, "KHR_materials_specular.specularColorTexture", true)?;
            specular_color = Color { factor: Vec3::from(s.specular_color_factor.0), texture: color };
        }
        let bsdf = Bsdf::MetallicRoughness {
            base_color,
            metallic: Scalar { factor: unit(pbr.metallic_factor.0), texture: metal_rough.map(|t| (t, 2)) },
            roughness: Scalar { factor: unit(pbr.roughness_factor.0), texture: metal_rough.map(|t| (t, 1)) },
            ior: extensions.and_then(|e| e.ior.as_ref()).map_or(1.5, |i| i.ior.0),
            specular,
            specular_color,
            transmission: 0.0.into(),
        };
        Ok(Base { bsdf, base_color, alpha: Scalar { factor: factor.w, texture: base_color.texture.map(|t| (t, 3)) } })
    }

    /// Converts KHR_materials_pbrSpecularGlossiness to a dielectric whose reflectance at normal incidence is
    /// the specular colour.
    fn specular_glossiness(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        pbr: &PbrSpecularGlossiness,
    ) -> Result<Base, LoadError> {
        let place = format!("{place}.KHR_materials_pbrSpecularGlossiness");
        let values = pbr.diffuse_factor.0.iter().chain(&pbr.specular_factor.0).chain([&pbr.glossiness_factor.0]);
        check_units(file, scene, &place, values.copied())?;
        let factor = Vec4::from(pbr.diffuse_factor.0).clamp(Vec4::ZERO, Vec4::ONE);
        let texture = self.plain_texture(file, scene, &place, &pbr.diffuse_texture, true)?;
        let base_color = Color { factor: factor.truncate(), texture };
        let specular = self.plain_texture(file, scene, &place, &pbr.specular_glossiness_texture, true)?;
        let glossiness = pbr.glossiness_factor.0.clamp(0.0, 1.0);
        let roughness = match specular {
            None => Scalar::from(1.0 - glossiness),
            Some(source) => {
                // The alpha channel of a copy will hold the roughness.
                scene.textures.push(Texture { srgb: false, ..scene.textures[source.texture].clone() });
                let texture = TextureRef { texture: scene.textures.len() - 1, ..source };
                self.glossy.push((texture.texture, glossiness));
                Scalar { factor: 1.0, texture: Some((texture, 3)) }
            }
        };
        let reflectance =
            Color { factor: Vec3::from(pbr.specular_factor.0).clamp(Vec3::ZERO, Vec3::ONE), texture: specular };
        let bsdf = Bsdf::highlighted(base_color, reflectance, roughness);
        Ok(Base { bsdf, base_color, alpha: Scalar { factor: factor.w, texture: base_color.texture.map(|t| (t, 3)) } })
    }

    /// Converts KHR_materials_diffuse_transmission.
    fn diffuse_transmission(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        material: &JsonMaterial,
    ) -> Result<Option<DiffuseTransmission>, LoadError> {
        let Some((place, json)) = extensions::of::<extensions::DiffuseTransmission>(file, place, material)? else {
            return Ok(None);
        };
        check_units(file, scene, &format!("{place}.diffuseTransmissionColorFactor"), json.color)?;
        let factor = Vec3::from(json.color).clamp(Vec3::ZERO, Vec3::ONE);
        let color = Color { factor, texture: self.plain_texture(file, scene, &place, &json.color_texture, true)? };
        let factor = ("diffuseTransmissionFactor", json.factor);
        let share = self.scalar(file, scene, &place, factor, &json.texture, 3)?;
        Ok((share.factor > 0.0).then_some(DiffuseTransmission { share, color }))
    }

    /// Converts KHR_materials_iridescence.
    fn film(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        material: &JsonMaterial,
    ) -> Result<Option<Film>, LoadError> {
        let Some((place, json)) = extensions::of::<extensions::Iridescence>(file, place, material)? else {
            return Ok(None);
        };
        if let Some(value) = [json.least, json.most].into_iter().find(|value| !(0.0..1e6).contains(value)) {
            return Err(file.error(place, format!("a thickness of {value} nm is out of range")));
        }
        if !(1.0..=10.0).contains(&json.ior) {
            return Err(file.error(place, format!("an iridescenceIor of {} is out of range", json.ior)));
        }
        let strength = self.scalar(file, scene, &place, ("iridescenceFactor", json.factor), &json.texture, 0)?;
        let texture = self.plain_texture(file, scene, &place, &json.thickness_texture, false)?;
        let thickness_texture = texture.map(|texture| (texture, 1));
        let film = Film { strength, ior: json.ior, thickness: [json.least, json.most], thickness_texture };
        Ok((strength.factor > 0.0).then_some(film))
    }

    /// Converts KHR_materials_anisotropy.
    fn anisotropy(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        material: &JsonMaterial,
    ) -> Result<Option<Anisotropy>, LoadError> {
        let Some((place, json)) = extensions::of::<extensions::Anisotropy>(file, place, material)? else {
            return Ok(None);
        };
        check_units(file, scene, &format!("{place}.anisotropyStrength"), [json.strength])?;
        if !json.rotation.is_finite() {
            return Err(file.error(place, format!("an anisotropyRotation of {} is not a number", json.rotation)));
        }
        let texture = self.plain_texture(file, scene, &place, &json.texture, false)?;
        let strength = json.strength.clamp(0.0, 1.0);
        Ok((strength > 0.0).then_some(Anisotropy { strength, rotation: json.rotation, texture }))
    }

    /// Converts KHR_materials_sheen.
    fn sheen(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        material: &JsonMaterial,
    ) -> Result<Option<Sheen>, LoadError> {
        let Some((place, json)) = extensions::of::<extensions::Sheen>(file, place, material)? else {
            return Ok(None);
        };
        check_units(file, scene, &format!("{place}.sheenColorFactor"), json.color)?;
        let factor = Vec3::from(json.color).clamp(Vec3::ZERO, Vec3::ONE);
        let color = Color { factor, texture: self.plain_texture(file, scene, &place, &json.color_texture, true)? };
        let factor = ("sheenRoughnessFactor", json.roughness);
        let roughness = self.scalar(file, scene, &place, factor, &json.roughness_texture, 3)?;
        Ok((color.factor != Vec3::ZERO).then_some(Sheen { color, roughness }))
    }

    /// Converts KHR_materials_clearcoat.
    fn coat(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        material: &JsonMaterial,
    ) -> Result<Option<Coat>, LoadError> {
        let Some((place, json)) = extensions::of::<extensions::Clearcoat>(file, place, material)? else {
            return Ok(None);
        };
        let weight = self.scalar(file, scene, &place, ("clearcoatFactor", json.factor), &json.texture, 0)?;
        let roughness = (self.scalar(
            file,
            scene,
            &place,
            ("clearcoatRoughnessFactor", json.roughness),
            &json.roughness_texture,
            1,
        ))?;
        let normal_map = self.normal_map(file, scene, &place, json.normal_texture.as_ref())?;
        Ok((weight.factor > 0.0).then_some(Coat { weight, roughness, normal_map }))
    }

    /// Converts a factor in [0, 1] and the texture that multiplies it by one of its channels.
    fn scalar(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        (name, factor): (&str, f32),
        info: &Option<Info>,
        channel: u32,
    ) -> Result<Scalar, LoadError> {
        check_units(file, scene, &format!("{place}.{name}"), [factor])?;
        let texture = self.plain_texture(file, scene, place, info, false)?;
        Ok(Scalar { factor: factor.clamp(0.0, 1.0), texture: texture.map(|texture| (texture, channel)) })
    }

    /// Converts a reference to a texture by an extension.
    fn plain_texture(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        info: &Option<Info>,
        srgb: bool,
    ) -> Result<Option<TextureRef>, LoadError> {
        let Some(info) = info else { return Ok(None) };
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
        self.texture(file, scene, info.index, info.tex_coord, transform, place, srgb)
    }

    /// Converts a normal map, if there is one.
    fn normal_map(
        &mut self,
        file: &File,
        scene: &mut Scene,
        place: &str,
        map: Option<&NormalTexture>,
    ) -> Result<Option<NormalMap>, LoadError> {
        let Some(map) = map else { return Ok(None) };
        if !map.scale.is_finite() {
            return Err(file.error(place, format!("a scale of {} is not a number", map.scale)));
        }
        let texture = self.texture(file, scene, map.index, map.tex_coord, map.transform(), place, false)?;
        Ok(texture.map(|texture| NormalMap { texture, scale: map.scale }))
    }

    /// Returns the scene's texture for a reference, or `None` if its image is not there or has no supported format.
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
        // As for images in AVIF alone.
        if texture.source.value() == NO_IMAGE as usize {
            scene.warn(format!("{place} has no image in a supported format (PNG, JPEG, WebP, KTX2): it is left out"));
            return Ok(None);
        }
        let image = file.get(texture.source, &place, "images")?;
        if let Some(uri) = image.uri.as_deref().filter(|uri| file.is_missing(uri)) {
            scene.warn(format!("{place} refers to {uri}, which is not there: it is left out"));
            return Ok(None);
        }
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

    /// Replaces the images of glossiness by copies whose alpha is the roughness, 1 - factor * glossiness.
    pub fn bake_roughness(&self, scene: &mut Scene) {
        let mut baked: HashMap<(usize, u32), usize> = HashMap::new();
        for &(texture, factor) in &self.glossy {
            let source = scene.textures[texture].image;
            scene.textures[texture].image = *baked.entry((source, factor.to_bits())).or_insert_with(|| {
                let mut image = scene.images[source].clone();
                image.name = format!("{}, roughness", image.name);
                for texel in &mut image.texels {
                    texel[3] = (255.0 - factor * f32::from(texel[3])).round() as u8;
                }
                scene.images.push(image);
                scene.images.len() - 1
            });
        }
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
    *material = Material {
        emission: Some(Emission { radiance: base_color, two_sided: true }),
        opacity: material.opacity.take(),
        boundary: material.boundary,
        ..Material::diffuse(std::mem::take(&mut material.name), Vec3::ZERO)
    };
}

/// Converts the medium behind a surface; thickness textures are ignored with a warning.
fn read_boundary(scene: &mut Scene, volume: Option<&json::extensions::material::Volume>) -> Boundary {
    let Some(volume) = volume else { return Boundary::Sheet };
    if volume.thickness_texture.is_some() {
        scene.warn("thickness textures of KHR_materials_volume are ignored: light travels as far as the mesh is thick");
    }
    boundary(volume)
}

/// Converts KHR_materials_dispersion.
fn dispersion(file: &File, place: &str, material: &JsonMaterial) -> Result<f32, LoadError> {
    let Some((place, json)) = extensions::of::<extensions::Dispersion>(file, place, material)? else {
        return Ok(0.0);
    };
    // The product with the index has to be finite, too.
    if !(0.0..1e18).contains(&json.dispersion) {
        return Err(file.error(place, format!("a dispersion of {} is out of range", json.dispersion)));
    }
    Ok(json.dispersion)
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

/// Checks that numbers are finite; values outside the unit interval are clamped with a warning.
fn check_units(
    file: &File,
    scene: &mut Scene,
    place: &str,
    values: impl IntoIterator<Item = f32>,
) -> Result<(), LoadError> {
    for value in values {
        if !value.is_finite() {
            return Err(file.error(place, format!("a value of {value} is out of range")));
        }
        if !(0.0..=1.0).contains(&value) {
            scene.warn(format!("{place}: a value of {value} is outside [0, 1]: it is clamped"));
        }
    }
    Ok(())
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

fn opacity(file: &File, place: &str, material: &JsonMaterial, value: Scalar) -> Result<Option<Opacity>, LoadError> {
    match &material.alpha_mode {
        Checked::Valid(AlphaMode::Opaque) => Ok(None),
        Checked::Valid(AlphaMode::Mask) => {
            Ok(Some(Opacity::CutOut { value, cutoff: material.alpha_cutoff.map_or(0.5, |c| c.0) }))
        }
        Checked::Valid(AlphaMode::Blend) => Ok(Some(Opacity::Blended { value })),
        Checked::Invalid => Err(file.error(place, "unknown alphaMode")),
    }
}
