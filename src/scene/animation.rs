//! What moves: a tree of nodes, tracks over time, skins and morph targets, and the pose that all of it has at a time.
//!
//! A file that animates something leaves a [`Rig`] on its [`Scene`], which itself stands in the file's rest pose. [`Scene::at`]
//! bakes the pose of a time into a scene without a rig, so that whoever renders it sees a scene like any other: instances,
//! cameras and lights where their nodes are, meshes morphed, then skinned (glTF 2.0, 3.7.2.2 and 3.7.3).

use std::sync::Arc;

use glam::{Affine3A, Mat3A, Mat4, Quat, Vec3, Vec3A, Vec4};

use super::geometry::cofactor;
use super::{Bsdf, Light, LoadError, Mesh, Projection, Scene, load};

/// How values between two keys come about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// On the straight line; of rotations on the shorter arc.
    Linear,
    /// The earlier key's value.
    Step,
    /// Cubic Hermite splines; each key has an in-tangent, a value and an out-tangent.
    CubicSpline,
}

/// Values over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    times: Vec<f32>,
    values: Vec<f32>,
    width: usize,
    interpolation: Interpolation,
}

impl Curve {
    /// A curve of `width` numbers through keys at `times` (seconds, ascending). `values` holds `width` numbers a key, of cubic
    /// splines three times as many: in-tangent, value, out-tangent.
    ///
    /// # Errors
    /// What is wrong: no keys, times that are not finite or descend, values that are not finite or not as many as keys.
    pub fn new(times: Vec<f32>, values: Vec<f32>, width: usize, interpolation: Interpolation) -> Result<Self, String> {
        if times.is_empty() {
            return Err("there are no keys".to_owned());
        }
        if let Some(i) = times.iter().position(|t| !t.is_finite()) {
            return Err(format!("the time of key {i} is {}", times[i]));
        }
        if let Some(i) = times.windows(2).position(|pair| pair[1] < pair[0]) {
            return Err(format!("times have to ascend, but key {} at {} s is before key {i}", i + 1, times[i + 1]));
        }
        let each = if interpolation == Interpolation::CubicSpline { 3 * width } else { width };
        if times.len().checked_mul(each) != Some(values.len()) {
            return Err(format!("{} numbers for {} keys of {each}", values.len(), times.len()));
        }
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(format!("number {i} is {}", values[i]));
        }
        Ok(Self { times, values, width, interpolation })
    }

    /// Numbers of a value.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Seconds of the last key.
    #[must_use]
    pub fn end(&self) -> f32 {
        self.times.last().copied().unwrap_or_default()
    }

    /// The value at a time; before the first and after the last key, theirs (glTF 2.0, 3.11).
    #[must_use]
    pub fn at(&self, seconds: f32) -> Vec<f32> {
        self.between(seconds, |from, to, share| from.iter().zip(to).map(|(a, b)| a + (b - a) * share).collect())
    }

    /// The same of rotations: a unit quaternion, x, y, z, w.
    #[must_use]
    pub fn rotation_at(&self, seconds: f32) -> Quat {
        let of = |q: &[f32]| {
            let q = Vec4::new(q[0], q[1], q[2], q[3]);
            q.try_normalize().map_or(Quat::IDENTITY, Quat::from_vec4)
        };
        of(&self.between(seconds, |from, to, share| of(from).slerp(of(to), share).to_array().to_vec()))
    }

    /// The value at a time, where `mix` says what lies between two keys on no spline.
    fn between(&self, seconds: f32, mix: impl Fn(&[f32], &[f32], f32) -> Vec<f32>) -> Vec<f32> {
        // In-tangent, value and out-tangent of a key; on no spline, the value alone.
        let cubic = self.interpolation == Interpolation::CubicSpline;
        let part = |key: usize, part: usize| {
            let first = if cubic { 3 * key + part } else { key } * self.width;
            &self.values[first..first + self.width]
        };
        let next = self.times.partition_point(|&t| t <= seconds);
        if next == 0 || next == self.times.len() || self.interpolation == Interpolation::Step {
            return part(next.max(1) - 1, 1).to_vec();
        }
        let key = next - 1;
        let span = self.times[next] - self.times[key];
        let t = (seconds - self.times[key]) / span;
        if !cubic {
            return mix(part(key, 1), part(next, 1), t);
        }
        // glTF 2.0, appendix C.5.
        let (t2, t3) = (t * t, t * t * t);
        let weights = [2.0 * t3 - 3.0 * t2 + 1.0, span * (t3 - 2.0 * t2 + t), 3.0 * t2 - 2.0 * t3, span * (t3 - t2)];
        let parts = [part(key, 1), part(key, 2), part(next, 1), part(next, 0)];
        (0..self.width).map(|i| weights.iter().zip(parts).map(|(weight, part)| weight * part[i]).sum()).collect()
    }
}

/// What a track moves. Indices of nodes are the rig's, those of cameras and lights the file's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Of a node, metres.
    Translation(usize),
    /// Of a node.
    Rotation(usize),
    /// Of a node.
    Scale(usize),
    /// Of the morph targets that a node shows.
    Weights(usize),
    /// Linear RGB.
    LightColor(usize),
    /// W/sr or W/m^2, where the colour is 1.
    LightIntensity(usize),
    /// Vertical angle of view, radians.
    FieldOfView(usize),
    /// A factor of a material.
    Material(usize, Factor),
}

/// A factor of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factor {
    /// Linear RGB with alpha, which is ignored.
    BaseColor,
    /// 0 to 1.
    Metallic,
    /// 0 to 1.
    Roughness,
    /// Linear RGB, times the strength that the file gives.
    Emissive,
}

impl Target {
    /// Numbers of a value; none where the mesh says.
    #[must_use]
    pub fn width(self) -> Option<usize> {
        match self {
            Self::Weights(_) => None,
            Self::Rotation(_) | Self::Material(_, Factor::BaseColor) => Some(4),
            Self::Translation(_) | Self::Scale(_) | Self::LightColor(_) | Self::Material(_, Factor::Emissive) => {
                Some(3)
            }
            Self::LightIntensity(_) | Self::FieldOfView(_) | Self::Material(..) => Some(1),
        }
    }
}

/// What moves together, by a name.
#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// Its name in the file, or its place.
    pub name: String,
    /// What is moved, and the index of the curve that it follows.
    pub tracks: Vec<(Target, usize)>,
    /// What tracks follow.
    pub curves: Vec<Curve>,
}

impl Animation {
    /// Seconds from 0 to the last key.
    #[must_use]
    pub fn seconds(&self) -> f32 {
        self.tracks.iter().map(|&(_, curve)| self.curves[curve].end()).fold(0.0, f32::max)
    }
}

/// A node's own transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// As one matrix, which nothing animates.
    Matrix(Affine3A),
    /// As parts; the rotation has unit length.
    Parts {
        /// Metres.
        translation: Vec3,
        /// Turns.
        rotation: Quat,
        /// Along each axis, before the rotation.
        scale: Vec3,
    },
}

impl Local {
    /// Parent from node.
    #[must_use]
    pub fn matrix(&self) -> Affine3A {
        match *self {
            Self::Matrix(matrix) => matrix,
            Self::Parts { translation, rotation, scale } => {
                Affine3A::from_scale_rotation_translation(scale, rotation, translation)
            }
        }
    }
}

/// Nodes that form trees.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tree {
    nodes: Vec<(Local, Option<usize>)>,
    /// Parents before their children.
    order: Vec<usize>,
}

impl Tree {
    /// Trees of nodes, each with its parent, whose index is in range.
    ///
    /// # Errors
    /// A node that is its own ancestor.
    pub fn new(nodes: Vec<(Local, Option<usize>)>) -> Result<Self, usize> {
        let mut children = vec![Vec::new(); nodes.len()];
        let mut order = Vec::with_capacity(nodes.len());
        for (i, (_, parent)) in nodes.iter().enumerate() {
            match parent {
                Some(parent) => children[*parent].push(i),
                None => order.push(i),
            }
        }
        let mut at = 0;
        while let Some(&node) = order.get(at) {
            order.extend(&children[node]);
            at += 1;
        }
        let mut reached = vec![false; nodes.len()];
        order.iter().for_each(|&node| reached[node] = true);
        reached.iter().position(|reached| !reached).map_or(Ok(Self { nodes, order }), Err)
    }

    /// World from node, of each node as it rests.
    #[must_use]
    pub fn rest(&self) -> Vec<Affine3A> {
        self.place(&self.nodes.iter().map(|(local, _)| *local).collect::<Vec<_>>())
    }

    /// World from node, of each node with another transform of its own.
    fn place(&self, locals: &[Local]) -> Vec<Affine3A> {
        let mut world = vec![Affine3A::IDENTITY; locals.len()];
        for &node in &self.order {
            let own = locals[node].matrix();
            world[node] = self.nodes[node].1.map_or(own, |parent| world[parent] * own);
        }
        world
    }
}

/// Nodes that bend meshes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    /// Each joint's node and its inverse bind matrix.
    pub joints: Vec<(usize, Mat4)>,
}

impl Skin {
    /// World from bind pose of each joint, for nodes placed in the world.
    #[must_use]
    pub fn matrices(&self, world: &[Affine3A]) -> Vec<Mat4> {
        self.joints.iter().map(|&(node, bind)| Mat4::from(world[node]) * bind).collect()
    }
}

/// Offsets of a mesh's vertices; an array is empty or has one for each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MorphTarget {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Of normals.
    pub normals: Vec<Vec3>,
    /// Of tangents, without the sign.
    pub tangents: Vec<Vec3>,
}

/// How the vertices of a mesh follow weights and joints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deformation {
    /// Morph targets.
    pub targets: Vec<MorphTarget>,
    /// Joints with their weights, of one vertex after the other; indices are the skin's.
    pub joints: Vec<(u32, f32)>,
    /// Where each vertex's joints end; empty where no vertex has any.
    pub joint_ends: Vec<u32>,
}

impl Deformation {
    /// The joints of a vertex. One that has none stays in its bind pose.
    #[must_use]
    pub fn joints_of(&self, vertex: usize) -> &[(u32, f32)] {
        let end = |i: usize| self.joint_ends.get(i).map_or(0, |&end| end as usize);
        &self.joints[vertex.checked_sub(1).map_or(0, end)..end(vertex)]
    }

    /// Makes vertex i what vertex `vertices[i]` was.
    pub fn select(&mut self, vertices: &[u32]) {
        let pick = |values: &mut Vec<Vec3>| {
            if !values.is_empty() {
                *values = vertices.iter().map(|&v| values[v as usize]).collect();
            }
        };
        for target in &mut self.targets {
            pick(&mut target.positions);
            pick(&mut target.normals);
            pick(&mut target.tangents);
        }
        if !self.joint_ends.is_empty() {
            let (mut joints, mut ends) = (Vec::new(), Vec::new());
            for &vertex in vertices {
                joints.extend_from_slice(self.joints_of(vertex as usize));
                ends.push(joints.len() as u32);
            }
            (self.joints, self.joint_ends) = (joints, ends);
        }
    }

    /// Morphs a mesh by weights of the targets, missing ones being 0, then skins it by joint matrices, which take it to the world;
    /// normals and tangents get unit length.
    pub fn apply(&self, mesh: &mut Mesh, weights: &[f32], matrices: Option<&[Mat4]>) {
        for (target, &weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            mesh.positions.iter_mut().zip(&target.positions).for_each(|(p, d)| *p += weight * *d);
            mesh.normals.iter_mut().zip(&target.normals).for_each(|(n, d)| *n += weight * *d);
            mesh.tangents.iter_mut().zip(&target.tangents).for_each(|(t, d)| *t += (weight * *d).extend(0.0));
        }
        if let Some(matrices) = matrices {
            self.skin(mesh, matrices);
        }
        for normal in &mut mesh.normals {
            *normal = normal.normalize_or_zero();
        }
        for tangent in &mut mesh.tangents {
            *tangent = tangent.truncate().normalize_or_zero().extend(if tangent.w < 0.0 { -1.0 } else { 1.0 });
        }
    }

    /// Blends each vertex by its joints' matrices.
    fn skin(&self, mesh: &mut Mesh, matrices: &[Mat4]) {
        let mut mirrored = vec![false; mesh.positions.len()];
        for (i, mirrored) in mirrored.iter_mut().enumerate() {
            let (mut blend, mut total) = (Mat4::ZERO, 0.0);
            for &(joint, weight) in self.joints_of(i) {
                blend += matrices[joint as usize] * weight;
                total += weight;
            }
            let blend = if total == 0.0 { Mat4::IDENTITY } else { blend * (1.0 / total) };
            mesh.positions[i] = blend.transform_point3(mesh.positions[i]);
            let linear = Mat3A::from_mat4(blend);
            *mirrored = linear.determinant() < 0.0;
            if let Some(normal) = mesh.normals.get_mut(i) {
                *normal = Vec3::from(cofactor(linear) * Vec3A::from(*normal)) * if *mirrored { -1.0 } else { 1.0 };
            }
            if let Some(tangent) = mesh.tangents.get_mut(i) {
                let w = if *mirrored { -tangent.w } else { tangent.w };
                *tangent = Vec3::from(linear * Vec3A::from(tangent.truncate())).extend(w);
            }
        }
        for triangle in &mut mesh.triangles {
            if mirrored[triangle[0] as usize] {
                triangle.swap(1, 2);
            }
        }
    }
}

/// A mesh of the scene that changes its shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Index into the scene's meshes.
    pub mesh: usize,
    /// The mesh before morphing and skinning.
    pub base: Mesh,
    /// How its vertices follow.
    pub deformation: Deformation,
    /// Index into the rig's skins.
    pub skin: Option<usize>,
    /// The node whose weights it has, where they are animated.
    pub node: Option<usize>,
    /// Weights at rest.
    pub weights: Vec<f32>,
}

impl Shape {
    /// The mesh with other weights, by joint matrices of each of the rig's skins.
    #[must_use]
    fn pose(&self, weights: &[f32], skins: &[Vec<Mat4>]) -> Mesh {
        let mut mesh = self.base.clone();
        self.deformation.apply(&mut mesh, weights, self.skin.map(|skin| skins[skin].as_slice()));
        mesh
    }
}

/// A light that hangs on a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HungLight {
    /// Index into the rig's nodes.
    pub node: usize,
    /// The file's index of it, where tracks can name it.
    pub source: Option<usize>,
    /// Linear RGB at rest.
    pub color: Vec3,
    /// W/sr or W/m^2 at rest.
    pub intensity: f32,
}

/// Everything that moves in a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// Nodes of the whole file.
    pub tree: Tree,
    /// Skins.
    pub skins: Vec<Skin>,
    /// Meshes that change their shape.
    pub shapes: Vec<Shape>,
    /// The node of each of the scene's instances, if it follows one.
    pub instances: Vec<Option<usize>>,
    /// Of the scene's first cameras, the node and the file's index.
    pub cameras: Vec<(usize, usize)>,
    /// Of the scene's first lights.
    pub lights: Vec<HungLight>,
    /// At least one.
    pub animations: Vec<Animation>,
}

/// What deforms the meshes of a scene that [`Scene::at`] has posed.
#[derive(Clone, Debug)]
pub struct Pose {
    /// Where the shapes are.
    pub rig: Arc<Rig>,
    /// World from bind pose of each joint of each skin.
    pub skins: Vec<Vec<Mat4>>,
    /// Weights of the morph targets of each shape.
    pub weights: Vec<Vec<f32>>,
}

/// Nodes, weights of morph targets by node, and other values at a time.
struct Moment {
    world: Vec<Affine3A>,
    weights: Vec<(usize, Vec<f32>)>,
    others: Vec<(Target, Vec<f32>)>,
}

impl Rig {
    fn moment(&self, animation: &Animation, seconds: f32) -> Moment {
        let mut locals: Vec<Local> = self.tree.nodes.iter().map(|(local, _)| *local).collect();
        let (mut weights, mut others) = (Vec::new(), Vec::new());
        for &(target, curve) in &animation.tracks {
            let curve = &animation.curves[curve];
            let mut parts = |node: usize, change: &dyn Fn(&mut Vec3, &mut Quat, &mut Vec3)| {
                if let Local::Parts { translation, rotation, scale } = &mut locals[node] {
                    change(translation, rotation, scale);
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
        Moment { world: self.tree.place(&locals), weights, others }
    }
}

impl Scene {
    /// The scene in the pose of an animation at a time, in seconds, without a rig. A scene without a rig changes by its displacements
    /// alone.
    ///
    /// # Errors
    /// No such animation; a pose that is not finite.
    pub fn at(&self, animation: usize, seconds: f32) -> Result<Self, LoadError> {
        let mut out = self.clone();
        out.seconds = seconds;
        let Some(rig) = out.rig.take() else { return Ok(out) };
        let failed = |cause: String| LoadError::at(&self.name, format!("animation {animation} at {seconds} s"), cause);
        let Some(chosen) = rig.animations.get(animation) else {
            return Err(failed(format!("there are {} animations", rig.animations.len())));
        };
        let Moment { world, weights, others } = rig.moment(chosen, seconds);
        if let Some(node) = world.iter().position(|w| !w.is_finite()) {
            return Err(failed(format!("the transform of nodes[{node}] is not finite")));
        }
        for (instance, node) in out.instances.iter_mut().zip(&rig.instances) {
            if let Some(node) = node {
                instance.world_from_local = world[*node];
            }
        }
        let skins: Vec<_> = rig.skins.iter().map(|skin| skin.matrices(&world)).collect();
        let moved = |shape: &Shape| weights.iter().rfind(|(node, _)| Some(*node) == shape.node);
        let weights: Vec<_> =
            rig.shapes.iter().map(|shape| moved(shape).map_or(&shape.weights, |(_, w)| w).clone()).collect();
        for (shape, weights) in rig.shapes.iter().zip(&weights) {
            out.meshes[shape.mesh] = shape.pose(weights, &skins);
        }
        for (camera, &(node, _)) in out.cameras.iter_mut().zip(&rig.cameras) {
            camera.world_from_camera = rigid(world[node]);
        }
        for (light, hung) in out.lights.iter_mut().zip(&rig.lights) {
            place_light(light, world[hung.node]);
        }
        out.change(&rig, &others);
        load::check_instances(&out).map_err(|(i, cause)| failed(format!("instance {i}: {cause}")))?;
        out.pose = Some(Pose { rig, skins, weights });
        Ok(out)
    }

    /// Sets what tracks beside those of nodes say.
    fn change(&mut self, rig: &Rig, values: &[(Target, Vec<f32>)]) {
        for (light, hung) in self.lights.iter_mut().zip(&rig.lights) {
            let (mut color, mut intensity, mut changed) = (hung.color, hung.intensity, false);
            for (target, value) in values {
                match target {
                    Target::LightColor(source) if hung.source == Some(*source) => color = Vec3::from_slice(value),
                    Target::LightIntensity(source) if hung.source == Some(*source) => intensity = value[0],
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
                    let hung = self.cameras.iter_mut().zip(&rig.cameras);
                    for (camera, _) in hung.filter(|(_, (_, of))| *of == source) {
                        if let Projection::Perspective { fov, .. } = &mut camera.projection {
                            *fov = value[0].clamp(1e-3, 3.1);
                        }
                    }
                }
                Target::Material(material, factor) => {
                    let material = &mut self.materials[material];
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

/// Puts a light where its node is; it shines along the node's -Z.
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

/// The rigid part of a placement: position, direction of -Z, and +Y as far as it is at right angles to it.
#[must_use]
pub fn rigid(world: Affine3A) -> Affine3A {
    let back = world.z_axis.normalize_or(Vec3A::Z);
    let x = world.y_axis.cross(back).normalize_or_zero();
    let x = if x == Vec3A::ZERO { back.any_orthonormal_vector() } else { x };
    Affine3A { matrix3: Mat3A::from_cols(x, back.cross(x), back), translation: world.translation }
}
