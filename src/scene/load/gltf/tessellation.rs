//! Tessellation and displacement, an extension of the format: `lightsheaf_tessellation` in the `extras` of a
//! mesh or primitive.

use ::gltf::json::{self, Index};
use glam::{Vec2, Vec3};
use serde::Deserialize;

use super::material::{read_image, wrap_modes};
use super::{Loader, NO_IMAGE};
use crate::scene::model::tessellation::PHONG;
use crate::scene::{Displacement, EdgeFactor, Height, HeightMap, LoadError, Mesh, Tessellation, Wave};

/// Custom data of a mesh or primitive; other entries are ignored.
#[derive(Deserialize)]
struct Extras {
    lightsheaf_tessellation: Option<serde_json::Value>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Parsed {
    /// Number of parts of each edge.
    edges: Option<u32>,
    /// Alternative to `edges`: length of a part in pixels.
    pixels: Option<f32>,
    phong: Option<f32>,
    displacement: Option<ParsedDisplacement>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParsedDisplacement {
    texture: Option<ParsedTexture>,
    noise: Option<ParsedNoise>,
    waves: Option<Vec<ParsedWave>>,
    scale: Option<f32>,
    #[serde(default)]
    bias: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParsedTexture {
    index: u32,
    #[serde(default, rename = "texCoord")]
    uv_set: u32,
    #[serde(default)]
    drift: [f32; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParsedNoise {
    frequency: f32,
    octaves: Option<u32>,
    #[serde(default)]
    seed: u32,
    #[serde(default)]
    drift: [f32; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ParsedWave {
    direction: [f32; 3],
    length: f32,
    amplitude: f32,
    /// Speed in metres per second; if none, that of deep water.
    speed: Option<f32>,
    #[serde(default)]
    phase: f32,
}

/// The known properties, for messages.
const KNOWN: &str =
    "it takes `edges` or `pixels`, `phong` and `displacement` (`texture`, `noise` or `waves`, `scale`, `bias`)";

impl Loader<'_> {
    /// Reads the tessellation of a primitive, whose own `extras` override those of its mesh.
    pub(super) fn tessellation(
        &mut self,
        mesh: &json::Mesh,
        primitive: &json::mesh::Primitive,
        place: &str,
    ) -> Result<Option<Tessellation>, LoadError> {
        let read = |extras: &json::Extras| {
            let text = extras.as_deref().map(|extras| extras.get()).filter(|text| text.trim_start().starts_with('{'));
            text.and_then(|text| serde_json::from_str::<Extras>(text).ok()?.lightsheaf_tessellation)
        };
        let Some(value) = read(&primitive.extras).or_else(|| read(&mesh.extras)) else { return Ok(None) };
        let place = format!("{place}: lightsheaf_tessellation");
        let file = self.file;
        let parsed: Parsed = serde_json::from_value(value).map_err(|e| file.error(&place, format!("{e}; {KNOWN}")))?;
        let factor = match (parsed.edges, parsed.pixels) {
            (Some(parts), None) => EdgeFactor::Fixed(parts),
            (None, Some(pixels)) => EdgeFactor::Pixels(pixels),
            _ => {
                return Err(
                    file.error(place, "needs either `edges`, into how many parts edges are cut, or `pixels` of a part")
                );
            }
        };
        let displacement = parsed.displacement.map(|d| self.displacement(d, &place)).transpose()?;
        let tessellation = Tessellation { factor, phong: parsed.phong.unwrap_or(PHONG), displacement };
        tessellation.check().map_err(|cause| file.error(place, cause))?;
        Ok(Some(tessellation))
    }

    fn displacement(&mut self, parsed: ParsedDisplacement, place: &str) -> Result<Displacement, LoadError> {
        let height = match (parsed.texture, parsed.noise, parsed.waves) {
            (Some(texture), None, None) => {
                if texture.uv_set > 1 {
                    let cause = format!("texCoord {} is not read: 0 and 1 are", texture.uv_set);
                    return Err(self.file.error(place, cause));
                }
                let map = self.height_map(Index::new(texture.index), place)?;
                Height::Map { map, uv_set: texture.uv_set, drift: Vec2::from(texture.drift) }
            }
            (None, Some(noise), None) => Height::Noise {
                frequency: noise.frequency,
                octaves: noise.octaves.unwrap_or(6),
                seed: noise.seed,
                drift: Vec3::from(noise.drift),
            },
            (None, None, Some(waves)) => Height::Waves(waves.iter().map(ParsedWave::wave).collect()),
            _ => {
                let cause = "the displacement needs one of `texture`, `noise` and `waves`";
                return Err(self.file.error(place, cause));
            }
        };
        let scale = match (&height, parsed.scale) {
            (_, Some(scale)) => scale,
            (Height::Waves(_), None) => 1.0,
            _ => return Err(self.file.error(place, "the displacement needs `scale`, the metres of the height 1")),
        };
        Ok(Displacement { height, scale, bias: parsed.bias })
    }

    fn height_map(&mut self, index: Index<json::Texture>, place: &str) -> Result<usize, LoadError> {
        if let Some(&known) = self.heights.get(&index.value()) {
            return Ok(known);
        }
        let texture = self.file.get(index, place, "textures")?;
        let place = format!("textures[{}]", index.value());
        if texture.source.value() == NO_IMAGE as usize {
            return Err(self.file.error(
                place,
                "has no image in a supported format (PNG, JPEG, WebP, KTX2), which a displacement needs",
            ));
        }
        let (wrap, _) = wrap_modes(self.file, texture, &place)?;
        let map = read_image(self.file, texture.source, |bytes, name| HeightMap::decode(bytes, name, wrap))?;
        self.scene.height_maps.push(map);
        self.heights.insert(index.value(), self.scene.height_maps.len() - 1);
        Ok(self.scene.height_maps.len() - 1)
    }
}

impl ParsedWave {
    fn wave(&self) -> Wave {
        let wave = Wave::on_water(Vec3::from(self.direction), self.length, self.amplitude);
        Wave { hertz: self.speed.map_or(wave.hertz, |speed| speed / self.length), phase: self.phase, ..wave }
    }
}

/// Returns an error message if a mesh lacks an attribute that the displacement needs.
pub(super) fn lacks(mesh: &Mesh, tessellation: &Tessellation) -> Option<String> {
    match tessellation.displacement.as_ref().map(|d| &d.height) {
        Some(Height::Map { uv_set, .. }) if mesh.uvs[*uv_set as usize].is_empty() => {
            Some(format!("has no TEXCOORD_{uv_set}, by which its displacement is looked up"))
        }
        _ => None,
    }
}
