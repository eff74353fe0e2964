//! Lights: KHR_lights_punctual, with a size from `extras` if present, and EXT_lights_ies.

use std::collections::HashMap;

use ::gltf::json::extensions::scene::khr_lights_punctual::Type as LightType;
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Affine3A, Vec3};
use serde::Deserialize;

use super::Loader;
use crate::scene::load::ies;
use crate::scene::model::transform::rigid;
use crate::scene::{Cone, Lamp, Light, LoadError, SpotFalloff};

impl Loader<'_> {
    /// Converts a light of KHR_lights_punctual.
    pub(super) fn light(
        &mut self,
        index: Index<json::extensions::scene::khr_lights_punctual::Light>,
        world: Affine3A,
        place: &str,
    ) -> Result<Light, LoadError> {
        let light = self.file.get(index, place, "KHR_lights_punctual.lights")?;
        let place = format!("KHR_lights_punctual.lights[{}]", index.value());
        let strength = Vec3::from(light.color) * light.intensity;
        if !strength.is_finite() || strength.min_element() < 0.0 {
            return Err(self.file.error(place, "colour times intensity is not a positive number"));
        }
        if light.range.is_some() {
            self.scene
                .warn("the range of KHR_lights_punctual is ignored: light falls off with the square of the distance");
        }
        let extent = Extent::read(light.extras.as_deref().map(|e| e.get())).unwrap_or_else(|cause| {
            self.scene.warn(format!("{place}: {cause}: the light has no size"));
            Extent::default()
        });
        let position = Vec3::from(world.translation);
        let direction = -Vec3::from(rigid(world).z_axis);
        let lamp = |cone| Lamp {
            position,
            world_from_lamp: rigid(world).matrix3.into(),
            radius: extent.radius,
            intensity: strength,
            cone,
            pattern: None,
        };
        match (&light.type_, &light.spot) {
            (Checked::Valid(LightType::Point), _) if extent.radius > 0.0 => Ok(Light::Lamp(lamp(None))),
            (Checked::Valid(LightType::Point), _) => Ok(Light::Point { position, intensity: strength }),
            (Checked::Valid(LightType::Directional), _) if extent.angle > 0.0 => {
                let angle = 0.5 * extent.angle.to_radians();
                Ok(Light::Sun { direction, irradiance: strength, angle, of_sky: false })
            }
            (Checked::Valid(LightType::Directional), _) => Ok(Light::Directional { direction, irradiance: strength }),
            (Checked::Valid(LightType::Spot), Some(spot)) => {
                let (inner_angle, outer_angle) = (spot.inner_cone_angle, spot.outer_cone_angle);
                if !(inner_angle >= 0.0 && inner_angle <= outer_angle && outer_angle <= std::f32::consts::PI) {
                    return Err(self
                        .file
                        .error(place, format!("cone angles {inner_angle} and {outer_angle} make no cone")));
                }
                let falloff = SpotFalloff::CosineSquared;
                if extent.radius > 0.0 {
                    return Ok(Light::Lamp(lamp(Some(Cone { inner_angle, outer_angle, falloff }))));
                }
                Ok(Light::Spot { position, direction, intensity: strength, inner_angle, outer_angle, falloff })
            }
            (Checked::Valid(LightType::Spot), None) => Err(self.file.error(place, "a spot light without `spot`")),
            (Checked::Invalid, _) => Err(self.file.error(place, "unknown type")),
        }
    }

    /// Converts a light of EXT_lights_ies. The profile's candelas are read as W/sr.
    pub(super) fn profile_light(
        &mut self,
        used: &ProfileUse,
        world: Affine3A,
        place: &str,
    ) -> Result<Light, LoadError> {
        let file = self.file;
        let (pattern, candelas) = match self.profiles.get(&used.light) {
            Some(&known) => known,
            None => {
                let place = format!("{place}.extensions.EXT_lights_ies");
                let missing = || file.error(&place, format!("refers to lights[{}], which does not exist", used.light));
                let profile = file.profiles.lights.get(used.light).ok_or_else(missing)?;
                let place = format!("EXT_lights_ies.lights[{}]", used.light);
                let (bytes, path) = match (&profile.uri, profile.buffer_view) {
                    (Some(uri), _) => {
                        let path = if uri.starts_with("data:") { file.path.clone() } else { file.local(uri, &place)? };
                        (file.fetch(uri, &place)?, path)
                    }
                    (None, Some(view)) => (file.view(Index::new(view), &place)?.to_vec(), file.path.clone()),
                    (None, None) => return Err(file.error(place, "has neither a uri nor a bufferView")),
                };
                let (pattern, candelas) = ies::parse(&String::from_utf8_lossy(&bytes), &path)?;
                self.scene.patterns.push(pattern);
                let known = (self.scene.patterns.len() - 1, candelas);
                *self.profiles.entry(used.light).or_insert(known)
            }
        };
        let intensity = Vec3::from(used.color).clamp(Vec3::ZERO, Vec3::ONE) * (used.multiplier * candelas);
        if !intensity.is_finite() || intensity.min_element() < 0.0 {
            return Err(file.error(place, "EXT_lights_ies: the multiplier is not a positive number"));
        }
        Ok(Light::Lamp(Lamp {
            position: Vec3::from(world.translation),
            world_from_lamp: rigid(world).matrix3.into(),
            radius: 0.0,
            intensity,
            cone: None,
            pattern: Some(pattern),
        }))
    }
}

/// Returns the light group in the `extras` of a node, a light or a material.
pub(super) fn group(extras: &json::Extras) -> Option<String> {
    #[derive(Deserialize)]
    struct Group {
        lightsheaf_light_group: Option<String>,
    }
    let text = extras.as_deref().map(|extras| extras.get()).filter(|text| text.trim_start().starts_with('{'));
    text.and_then(|text| serde_json::from_str::<Group>(text).ok()?.lightsheaf_light_group)
}

/// Size of a light in its `extras`; other extras are ignored.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Extent {
    /// Radius of a point or spot light, metres.
    radius: f32,
    /// Angular diameter of a directional light, degrees.
    angle: f32,
}

impl Extent {
    fn read(extras: Option<&str>) -> Result<Self, String> {
        // Extras may be any JSON value, such as a list.
        let Some(object) = extras.filter(|text| text.trim_start().starts_with('{')) else { return Ok(Self::default()) };
        let extent: Self = serde_json::from_str(object)
            .map_err(|_| "in extras, `radius` has to be a number of metres and `angle` one of degrees".to_owned())?;
        match extent {
            Self { radius, .. } if !(0.0..f32::INFINITY).contains(&radius) => {
                Err(format!("the radius {radius} in extras is not a number of metres"))
            }
            Self { angle, .. } if !(0.0..=180.0).contains(&angle) => {
                Err(format!("the angle {angle} in extras has to be 0 to 180 degrees"))
            }
            extent => Ok(extent),
        }
    }
}

/// The EXT_lights_ies data of a file.
#[derive(Default)]
pub(super) struct Profiles {
    lights: Vec<Profile>,
    /// Profile uses by node index.
    pub nodes: HashMap<usize, ProfileUse>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Profile {
    uri: Option<String>,
    buffer_view: Option<u32>,
}

/// A node's light profile.
#[derive(Deserialize)]
pub(super) struct ProfileUse {
    light: usize,
    #[serde(default = "one")]
    multiplier: f32,
    #[serde(default = "white")]
    color: [f32; 3],
}

fn one() -> f32 {
    1.0
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

impl Profiles {
    /// Parses the extension from the file's JSON; the parser's own types omit it.
    pub fn parse(text: &[u8]) -> Result<Self, serde_json::Error> {
        #[derive(Deserialize)]
        struct Root {
            #[serde(default)]
            nodes: Vec<Holder<ProfileUse>>,
            extensions: Option<Extensions<Lights>>,
        }
        #[derive(Deserialize)]
        struct Holder<T> {
            extensions: Option<Extensions<T>>,
        }
        #[derive(Deserialize)]
        struct Extensions<T> {
            #[serde(rename = "EXT_lights_ies")]
            ies: Option<T>,
        }
        #[derive(Deserialize)]
        struct Lights {
            lights: Vec<Profile>,
        }
        let root: Root = serde_json::from_slice(text)?;
        let nodes = root.nodes.into_iter().map(|n| n.extensions?.ies);
        Ok(Self {
            lights: root.extensions.and_then(|e| e.ies).map_or_else(Vec::new, |l| l.lights),
            nodes: nodes.enumerate().filter_map(|(i, used)| Some((i, used?))).collect(),
        })
    }
}
