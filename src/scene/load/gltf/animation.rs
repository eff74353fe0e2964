//! Animations: channels of nodes, and KHR_animation_pointer for lights, cameras and factors of materials.

use std::collections::HashMap;

use ::gltf::json::{self, Index};
use glam::Vec3;
use serde::Deserialize;

use super::Loader;
use super::accessor::Accessor;
use super::file::File;
use crate::scene::LoadError;
use crate::scene::animation::{Animation, Curve, Factor, Interpolation, Target};

/// Maximum total of numbers in all curves of one file.
const MAX_NUMBERS: usize = 1 << 27;

/// The animations of a file, unchecked.
#[derive(Default, Deserialize)]
pub(super) struct Parsed {
    #[serde(default)]
    animations: Vec<ParsedAnimation>,
}

#[derive(Deserialize)]
struct ParsedAnimation {
    name: Option<String>,
    channels: Vec<Channel>,
    samplers: Vec<Sampler>,
}

#[derive(Deserialize)]
struct Channel {
    sampler: usize,
    target: ParsedTarget,
}

#[derive(Deserialize)]
struct ParsedTarget {
    node: Option<usize>,
    path: String,
    extensions: Option<Extensions>,
}

#[derive(Deserialize)]
struct Extensions {
    #[serde(rename = "KHR_animation_pointer")]
    pointer: Option<Pointer>,
}

#[derive(Deserialize)]
struct Pointer {
    pointer: String,
}

#[derive(Deserialize)]
struct Sampler {
    input: u32,
    output: u32,
    interpolation: Option<String>,
}

/// The target of a channel.
enum ChannelTarget {
    Value(Target),
    /// Emissive strength of a material, which multiplies its emissive colour.
    EmissiveStrength(usize),
}

impl Parsed {
    /// Returns the nodes whose morph weights are animated.
    pub fn weighted_nodes(&self) -> impl Iterator<Item = usize> {
        let channels = self.animations.iter().flat_map(|a| &a.channels);
        channels.filter_map(|c| match parse_target(&c.target) {
            Some(ChannelTarget::Value(Target::Weights(node))) => Some(node),
            _ => None,
        })
    }

    /// Returns true if nothing is animated.
    pub fn is_empty(&self) -> bool {
        self.animations.iter().all(|a| a.channels.is_empty())
    }
}

/// Parses a channel's target without checking that it exists.
fn parse_target(target: &ParsedTarget) -> Option<ChannelTarget> {
    if let Some(pointer) = target.extensions.as_ref().and_then(|e| e.pointer.as_ref()) {
        return parse_pointer(&pointer.pointer);
    }
    node_target(target.node?, &target.path).map(ChannelTarget::Value)
}

fn node_target(node: usize, path: &str) -> Option<Target> {
    Some(match path {
        "translation" => Target::Translation(node),
        "rotation" => Target::Rotation(node),
        "scale" => Target::Scale(node),
        "weights" => Target::Weights(node),
        _ => return None,
    })
}

/// Parses a JSON pointer.
fn parse_pointer(pointer: &str) -> Option<ChannelTarget> {
    let parts: Vec<&str> = pointer.strip_prefix('/')?.split('/').collect();
    let at = |index: &str| index.parse::<usize>().ok();
    Some(ChannelTarget::Value(match parts.as_slice() {
        ["nodes", node, path] => node_target(at(node)?, path)?,
        ["cameras", camera, "perspective", "yfov"] => Target::FieldOfView(at(camera)?),
        ["extensions", "KHR_lights_punctual", "lights", light, "color"] => Target::LightColor(at(light)?),
        ["extensions", "KHR_lights_punctual", "lights", light, "intensity"] => Target::LightIntensity(at(light)?),
        ["materials", material, "pbrMetallicRoughness", factor] => {
            let factor = match *factor {
                "baseColorFactor" => Factor::BaseColor,
                "metallicFactor" => Factor::Metallic,
                "roughnessFactor" => Factor::Roughness,
                _ => return None,
            };
            Target::Material(at(material)?, factor)
        }
        ["materials", material, "emissiveFactor"] => Target::Material(at(material)?, Factor::Emissive),
        ["materials", material, "extensions", "KHR_materials_emissive_strength", "emissiveStrength"] => {
            return Some(ChannelTarget::EmissiveStrength(at(material)?));
        }
        _ => return None,
    }))
}

impl Loader<'_> {
    /// Reads the file's animations. Channels with an unsupported target become warnings.
    pub(super) fn animations(&mut self) -> Result<Vec<Animation>, LoadError> {
        let file = self.file;
        let mut out = Vec::new();
        let mut numbers = 0;
        for (a, parsed) in file.animations.animations.iter().enumerate() {
            let place = format!("animations[{a}]");
            let name = parsed.name.clone().unwrap_or_else(|| place.clone());
            let mut animation = Animation { name, tracks: Vec::new(), curves: Vec::new() };
            let mut known: HashMap<(usize, usize, bool), usize> = HashMap::new();
            for (c, channel) in parsed.channels.iter().enumerate() {
                let place = format!("{place}.channels[{c}]");
                let Some(channel_target) = parse_target(&channel.target) else {
                    let pointer = channel.target.extensions.as_ref().and_then(|e| e.pointer.as_ref());
                    let what = pointer.map_or(&channel.target.path, |p| &p.pointer);
                    self.scene.warn(format!("{place} animates `{what}`, which stays as it is"));
                    continue;
                };
                let Some(sampler) = parsed.samplers.get(channel.sampler) else {
                    let cause = format!("refers to samplers[{}], which does not exist", channel.sampler);
                    return Err(file.error(place, cause));
                };
                let Some((target, width, factor)) = self.check_target(&channel_target, &place)? else { continue };
                let key = (channel.sampler, width, factor.is_some());
                if let (Some(&curve), None) = (known.get(&key), factor) {
                    animation.tracks.push((target, curve));
                    continue;
                }
                let curve = read_curve(file, sampler, width, factor, &place, &mut numbers)?;
                known.insert(key, animation.curves.len());
                animation.tracks.push((target, animation.curves.len()));
                animation.curves.push(curve);
            }
            out.push(animation);
        }
        Ok(out)
    }

    /// Checks a channel's target. Returns the target, the number of components in the file and, for emission,
    /// the factor that turns these into a radiance; or `None`, with a warning, if the target cannot be
    /// animated.
    fn check_target(
        &mut self,
        channel_target: &ChannelTarget,
        place: &str,
    ) -> Result<Option<(Target, usize, Option<Vec3>)>, LoadError> {
        let root = &self.file.root;
        let missing = |kind: &str, index: usize| {
            self.file.error(place, format!("refers to {kind}[{index}], which does not exist: export the file again"))
        };
        let (target, factor) = match *channel_target {
            ChannelTarget::Value(Target::Material(material, Factor::Emissive))
            | ChannelTarget::EmissiveStrength(material) => {
                let found = root.materials.get(material).ok_or_else(|| missing("materials", material))?;
                let extension = found.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
                let factor = match channel_target {
                    ChannelTarget::EmissiveStrength(_) => Vec3::from(found.emissive_factor.0),
                    ChannelTarget::Value(_) => Vec3::splat(extension.map_or(1.0, |e| e.emissive_strength.0)),
                };
                (Target::Material(material, Factor::Emissive), Some(factor))
            }
            ChannelTarget::Value(target) => (target, None),
        };
        let mut width = target.width();
        match target {
            Target::Translation(node) | Target::Rotation(node) | Target::Scale(node) | Target::Weights(node) => {
                let found = root.nodes.get(node).ok_or_else(|| missing("nodes", node))?;
                if found.matrix.is_some() && !matches!(target, Target::Weights(_)) {
                    self.scene.warn(format!(
                        "{place} animates nodes[{node}], whose transform is a matrix: it stays as it is"
                    ));
                    return Ok(None);
                }
                if matches!(target, Target::Weights(_)) {
                    let mesh = found.mesh.and_then(|mesh| root.meshes.get(mesh.value()));
                    let of = |p: &json::mesh::Primitive| p.targets.as_ref().map_or(0, Vec::len);
                    width = mesh.and_then(|mesh| mesh.primitives.iter().map(of).max());
                    if width.is_none_or(|width| width == 0) {
                        self.scene
                            .warn(format!("{place} animates weights of nodes[{node}], which has no morph targets"));
                        return Ok(None);
                    }
                }
            }
            Target::LightColor(light) | Target::LightIntensity(light) => {
                let lights = root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
                if lights.is_none_or(|l| light >= l.lights.len()) {
                    return Err(missing("KHR_lights_punctual.lights", light));
                }
            }
            Target::FieldOfView(camera) if camera >= root.cameras.len() => return Err(missing("cameras", camera)),
            Target::FieldOfView(_) => {}
            Target::Material(material, factor) => {
                let found = root.materials.get(material).ok_or_else(|| missing("materials", material))?;
                let unlit = found.extensions.as_ref().is_some_and(|e| e.unlit.is_some());
                let dark = factor == Factor::Emissive && self.scene.materials[material].emission.is_none();
                if unlit || dark {
                    let why = if unlit { "is unlit" } else { "does not emit at rest" };
                    self.scene.warn(format!("{place} animates materials[{material}], which {why}: it stays as it is"));
                    return Ok(None);
                }
            }
        }
        let width = if matches!(channel_target, ChannelTarget::EmissiveStrength(_)) { Some(1) } else { width };
        Ok(width.map(|width| (target, width, factor)))
    }
}

/// Reads a sampler's curve of `width` components per value. With a factor, the result has its three
/// components.
fn read_curve(
    file: &File,
    sampler: &Sampler,
    width: usize,
    factor: Option<Vec3>,
    place: &str,
    numbers: &mut usize,
) -> Result<Curve, LoadError> {
    let times = Accessor::open(file, Index::new(sampler.input), &format!("{place}.input"), &[1])?;
    let output = Accessor::open(file, Index::new(sampler.output), &format!("{place}.output"), &[1, 3, 4])?;
    *numbers = numbers.saturating_add(times.count).saturating_add(3 * output.count.saturating_mul(output.lanes));
    if *numbers > MAX_NUMBERS {
        return Err(file.error(place, format!("the file's animations have more than {MAX_NUMBERS} numbers")));
    }
    let interpolation = match sampler.interpolation.as_deref() {
        None | Some("LINEAR") => Interpolation::Linear,
        Some("STEP") => Interpolation::Step,
        Some("CUBICSPLINE") => Interpolation::CubicSpline,
        Some(other) => return Err(file.error(place, format!("unknown interpolation `{other}`"))),
    };
    let seconds = (0..times.count).map(|i| times.floats::<1>(i, 0.0)[0]).collect();
    let lanes = output.lanes;
    let mut values: Vec<f32> =
        (0..output.count).flat_map(|i| output.floats::<4>(i, 0.0).into_iter().take(lanes)).collect();
    if lanes > 1 && lanes != width {
        let cause = format!("has {lanes} numbers per element, {place} needs {width}");
        return Err(file.error(output.place, cause));
    }
    let mut curve_width = width;
    if let Some(factor) = factor {
        let by = factor.to_array();
        values = match width {
            1 => values.iter().flat_map(|v| by.map(|f| f * v)).collect(),
            _ => values.iter().enumerate().map(|(i, v)| by[i % 3] * v).collect(),
        };
        curve_width = 3;
    }
    Curve::new(seconds, values, curve_width, interpolation).map_err(|cause| {
        let accessors = format!("accessors[{}] and accessors[{}]", sampler.input, sampler.output);
        file.error(place, format!("{accessors}: {cause}: export the animation again"))
    })
}
