//! Extensions of materials that the parser's own types omit.

use ::gltf::json::extensions::texture::TextureTransform;
use ::gltf::json::material::Material;
use ::gltf::json::texture::Info;
use ::gltf::json::{Index, Texture};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::file::File;
use crate::scene::LoadError;

/// An extension of a material.
pub(super) trait Extension: DeserializeOwned {
    /// Its name.
    const NAME: &str;
}

/// Returns an extension of a material and its place in the file, if the material has it.
pub(super) fn of<E: Extension>(
    file: &File,
    place: &str,
    material: &Material,
) -> Result<Option<(String, E)>, LoadError> {
    let value = material.extensions.as_ref().and_then(|extensions| extensions.others.get(E::NAME));
    let Some(value) = value else { return Ok(None) };
    let place = format!("{place}.{}", E::NAME);
    match E::deserialize(value) {
        Ok(extension) => Ok(Some((place, extension))),
        Err(cause) => Err(file.error(place, cause.to_string())),
    }
}

fn one() -> f32 {
    1.0
}

/// KHR_materials_clearcoat.
#[derive(Deserialize)]
pub(super) struct Clearcoat {
    #[serde(default, rename = "clearcoatFactor")]
    pub factor: f32,
    #[serde(rename = "clearcoatTexture")]
    pub texture: Option<Info>,
    #[serde(default, rename = "clearcoatRoughnessFactor")]
    pub roughness: f32,
    #[serde(rename = "clearcoatRoughnessTexture")]
    pub roughness_texture: Option<Info>,
    #[serde(rename = "clearcoatNormalTexture")]
    pub normal_texture: Option<NormalTexture>,
}

impl Extension for Clearcoat {
    const NAME: &str = "KHR_materials_clearcoat";
}

/// KHR_materials_diffuse_transmission.
#[derive(Deserialize)]
pub(super) struct DiffuseTransmission {
    #[serde(default, rename = "diffuseTransmissionFactor")]
    pub factor: f32,
    #[serde(rename = "diffuseTransmissionTexture")]
    pub texture: Option<Info>,
    #[serde(default = "white", rename = "diffuseTransmissionColorFactor")]
    pub color: [f32; 3],
    #[serde(rename = "diffuseTransmissionColorTexture")]
    pub color_texture: Option<Info>,
}

impl Extension for DiffuseTransmission {
    const NAME: &str = "KHR_materials_diffuse_transmission";
}

/// KHR_materials_dispersion.
#[derive(Deserialize)]
pub(super) struct Dispersion {
    #[serde(default)]
    pub dispersion: f32,
}

impl Extension for Dispersion {
    const NAME: &str = "KHR_materials_dispersion";
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

/// KHR_materials_sheen.
#[derive(Deserialize)]
pub(super) struct Sheen {
    #[serde(default, rename = "sheenColorFactor")]
    pub color: [f32; 3],
    #[serde(rename = "sheenColorTexture")]
    pub color_texture: Option<Info>,
    #[serde(default, rename = "sheenRoughnessFactor")]
    pub roughness: f32,
    #[serde(rename = "sheenRoughnessTexture")]
    pub roughness_texture: Option<Info>,
}

impl Extension for Sheen {
    const NAME: &str = "KHR_materials_sheen";
}

/// KHR_materials_anisotropy.
#[derive(Deserialize)]
pub(super) struct Anisotropy {
    #[serde(default, rename = "anisotropyStrength")]
    pub strength: f32,
    #[serde(default, rename = "anisotropyRotation")]
    pub rotation: f32,
    #[serde(rename = "anisotropyTexture")]
    pub texture: Option<Info>,
}

impl Extension for Anisotropy {
    const NAME: &str = "KHR_materials_anisotropy";
}

/// KHR_materials_iridescence.
#[derive(Deserialize)]
pub(super) struct Iridescence {
    #[serde(default, rename = "iridescenceFactor")]
    pub factor: f32,
    #[serde(rename = "iridescenceTexture")]
    pub texture: Option<Info>,
    #[serde(default = "film_ior", rename = "iridescenceIor")]
    pub ior: f32,
    #[serde(default = "least_thickness", rename = "iridescenceThicknessMinimum")]
    pub least: f32,
    #[serde(default = "greatest_thickness", rename = "iridescenceThicknessMaximum")]
    pub most: f32,
    #[serde(rename = "iridescenceThicknessTexture")]
    pub thickness_texture: Option<Info>,
}

impl Extension for Iridescence {
    const NAME: &str = "KHR_materials_iridescence";
}

fn film_ior() -> f32 {
    1.3
}

fn least_thickness() -> f32 {
    100.0
}

fn greatest_thickness() -> f32 {
    400.0
}

/// A normal map with the texture transform that the parser's own type omits.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct NormalTexture {
    pub index: Index<Texture>,
    #[serde(default)]
    pub tex_coord: u32,
    #[serde(default = "one")]
    pub scale: f32,
    extensions: Option<TextureExtensions>,
}

impl NormalTexture {
    /// Returns the texture transform, if there is one.
    pub fn transform(&self) -> Option<&TextureTransform> {
        self.extensions.as_ref()?.transform.as_ref()
    }
}

#[derive(Deserialize)]
struct TextureExtensions {
    #[serde(rename = "KHR_texture_transform")]
    transform: Option<TextureTransform>,
}
