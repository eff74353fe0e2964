//! Evaluation of a rig at a time: [`Scene::at`].

use glam::{Affine3A, Quat, Vec3};

use crate::scene::animation::rig::{Pose, Rig, Shape};
use crate::scene::animation::track::{Animation, Factor, Target};
use crate::scene::animation::tree::Local;
use crate::scene::check::check_instances;
use crate::scene::model::camera::Projection;
use crate::scene::model::error::LoadError;
use crate::scene::model::light::Light;
use crate::scene::model::material::Bsdf;
use crate::scene::model::scene::Scene;
use crate::scene::model::transform::rigid;

/// The evaluated tracks at a time: node transforms, morph target weights by node, and other values.
struct Sample {
    world: Vec<Affine3A>,
    weights: Vec<(usize, Vec<f32>)>,
    others: Vec<(Target, Vec<f32>)>,
}

impl Rig {
    fn sample(&self, animation: &Animation, seconds: f32) -> Sample {
        let mut locals: Vec<Local> = self.tree.nodes.iter().map(|(local, _)| *local).collect();
        let (mut weights, mut others) = (Vec::new(), Vec::new());
        for &(target, curve) in &animation.tracks {
            let curve = &animation.curves[curve];
            let mut parts = |node: usize, edit: &dyn Fn(&mut Vec3, &mut Quat, &mut Vec3)| {
                if let Local::Parts { translation, rotation, scale } = &mut locals[node] {
                    edit(translation, rotation, scale);
                }
            };
            let value = curve.at(seconds);
            match target {
                Target::Translation(node) => parts(node, &|t, _, _| *t = Vec3::from_slice(&value)),
                Target::Rotation(node) => parts(node, &|_, r, _| *r = curve.rotation_at(seconds)),
                Target::Scale(node) => parts(node, &|_, _, s| *s = Vec3::from_slice(&value)),
                Target::Weights(node) => weights.push((node, value)),
                other => others.push((other, value)),
            }
        }
        Sample { world: self.tree.place(&locals), weights, others }
    }
}

impl Scene {
    /// Returns the scene in the pose of an animation at a time in seconds, without a rig. In a scene without
    /// a rig only the displacements change.
    ///
    /// # Errors
    /// An animation that does not exist and a pose that is not finite are errors.
    pub fn at(&self, animation: usize, seconds: f32) -> Result<Self, LoadError> {
        let mut out = self.clone();
        out.seconds = seconds;
        let Some(rig) = out.rig.take() else { return Ok(out) };
        let failed = |cause: String| LoadError::at(&self.name, format!("animation {animation} at {seconds} s"), cause);
        let Some(chosen) = rig.animations.get(animation) else {
            return Err(failed(format!("there are {} animations", rig.animations.len())));
        };
        let Sample { world, weights, others } = rig.sample(chosen, seconds);
        if let Some(node) = world.iter().position(|w| !w.is_finite()) {
            return Err(failed(format!("the transform of nodes[{node}] is not finite")));
        }
        for (instance, followed) in out.instances.iter_mut().zip(&rig.instances) {
            if let Some((node, node_from_local)) = followed {
                instance.world_from_local = world[*node] * *node_from_local;
            }
        }
        let skins: Vec<_> = rig.skins.iter().map(|skin| skin.matrices(&world)).collect();
        let animated_weights = |shape: &Shape| weights.iter().rfind(|(node, _)| Some(*node) == shape.node);
        let weights: Vec<_> =
            rig.shapes.iter().map(|shape| animated_weights(shape).map_or(&shape.weights, |(_, w)| w).clone()).collect();
        for (shape, weights) in rig.shapes.iter().zip(&weights) {
            out.meshes[shape.mesh] = shape.pose(weights, &skins);
        }
        for (camera, &(node, _)) in out.cameras.iter_mut().zip(&rig.cameras) {
            camera.world_from_camera = rigid(world[node]);
        }
        for (light, attached) in out.lights.iter_mut().zip(&rig.lights) {
            place_light(light, world[attached.node]);
        }
        out.apply_values(&rig, &others);
        check_instances(&out).map_err(|(i, cause)| failed(format!("instance {i}: {cause}")))?;
        out.pose = Some(Pose { rig, skins, weights });
        Ok(out)
    }

    /// Applies the tracks that target lights, cameras and materials.
    fn apply_values(&mut self, rig: &Rig, values: &[(Target, Vec<f32>)]) {
        for (light, attached) in self.lights.iter_mut().zip(&rig.lights) {
            let (mut color, mut intensity, mut changed) = (attached.color, attached.intensity, false);
            for (target, value) in values {
                match target {
                    Target::LightColor(source) if attached.source == Some(*source) => color = Vec3::from_slice(value),
                    Target::LightIntensity(source) if attached.source == Some(*source) => intensity = value[0],
                    _ => continue,
                }
                changed = true;
            }
            if changed {
                let strength = (color * intensity).max(Vec3::ZERO);
                match light {
                    Light::Point { intensity, .. } | Light::Spot { intensity, .. } => *intensity = strength,
                    Light::Directional { irradiance, .. } | Light::Sun { irradiance, .. } => *irradiance = strength,
                    Light::Lamp(lamp) => lamp.intensity = strength,
                }
            }
        }
        for (target, value) in values {
            match *target {
                Target::FieldOfView(source) => {
                    let attached = self.cameras.iter_mut().zip(&rig.cameras);
                    for (camera, _) in attached.filter(|(_, (_, of))| *of == source) {
                        if let Projection::Perspective { fov, .. } = &mut camera.projection {
                            *fov = value[0].clamp(1e-3, 3.1);
                        }
                    }
                }
                Target::Material(material, factor) => {
                    let material = &mut self.materials[material];
                    if let (Factor::BaseColor, Some(opacity)) = (factor, &mut material.opacity) {
                        opacity.value_mut().factor = value[3].clamp(0.0, 1.0);
                    }
                    match (factor, &mut material.bsdf, &mut material.emission) {
                        (Factor::Emissive, _, Some(emission)) => {
                            emission.radiance.factor = Vec3::from_slice(value).max(Vec3::ZERO);
                        }
                        (Factor::BaseColor, Bsdf::MetallicRoughness { base_color: color, .. }, _)
                        | (Factor::BaseColor, Bsdf::Diffuse { reflectance: color }, _) => {
                            color.factor = Vec3::from_slice(&value[..3]).clamp(Vec3::ZERO, Vec3::ONE);
                        }
                        (Factor::Metallic, Bsdf::MetallicRoughness { metallic: scalar, .. }, _)
                        | (Factor::Roughness, Bsdf::MetallicRoughness { roughness: scalar, .. }, _) => {
                            scalar.factor = value[0].clamp(0.0, 1.0);
                        }
                        _ => {}
                    }
                }
                _ => {}
            }
        }
    }
}

/// Places a light at its node; it emits along the node's -Z.
fn place_light(light: &mut Light, world: Affine3A) {
    let (place, turn) = (Vec3::from(world.translation), rigid(world));
    let axis = -Vec3::from(turn.z_axis);
    match light {
        Light::Point { position, .. } => *position = place,
        Light::Spot { position, direction, .. } => (*position, *direction) = (place, axis),
        Light::Directional { direction, .. } | Light::Sun { direction, .. } => *direction = axis,
        Light::Lamp(lamp) => (lamp.position, lamp.world_from_lamp) = (place, turn.matrix3.into()),
    }
}
