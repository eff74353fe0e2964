//! The rig: all animated parts of a file.

use std::sync::Arc;

use glam::{Affine3A, Mat4, Vec3};

use crate::scene::animation::deformation::Deformation;
use crate::scene::animation::track::Animation;
use crate::scene::animation::tree::{Skin, Tree};
use crate::scene::model::mesh::Mesh;

/// A deformable mesh of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Index into the scene's meshes.
    pub mesh: usize,
    /// The mesh before morphing and skinning.
    pub base: Mesh,
    /// Dependence of the vertices on weights and joints.
    pub deformation: Deformation,
    /// Index into the rig's skins.
    pub skin: Option<usize>,
    /// The node that supplies the weights, if they are animated.
    pub node: Option<usize>,
    /// Weights in the rest pose.
    pub weights: Vec<f32>,
}

impl Shape {
    /// Returns the mesh deformed by the given weights and the joint matrices of each of the rig's skins.
    #[must_use]
    pub(super) fn pose(&self, weights: &[f32], skins: &[Vec<Mat4>]) -> Mesh {
        let mut mesh = self.base.clone();
        self.deformation.apply(&mut mesh, weights, self.skin.map(|skin| skins[skin].as_slice()));
        mesh
    }
}

/// A light attached to a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttachedLight {
    /// Index into the rig's nodes.
    pub node: usize,
    /// The light's index in the file, if tracks can refer to it.
    pub source: Option<usize>,
    /// Linear RGB in the rest pose.
    pub color: Vec3,
    /// W/sr or W/m^2 in the rest pose.
    pub intensity: f32,
}

/// All animated parts of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rig {
    /// Nodes of the whole file.
    pub tree: Tree,
    /// Skins.
    pub skins: Vec<Skin>,
    /// Deformable meshes.
    pub shapes: Vec<Shape>,
    /// The node of each of the scene's instances, if it follows one, and the instance's transform below it.
    pub instances: Vec<Option<(usize, Affine3A)>>,
    /// Node and file index of each of the scene's first cameras.
    pub cameras: Vec<(usize, usize)>,
    /// Nodes and rest values of the scene's first lights.
    pub lights: Vec<AttachedLight>,
    /// Animations, at least one.
    pub animations: Vec<Animation>,
}

/// Deformation state of a scene that [`Scene::at`](crate::scene::Scene::at) has posed.
#[derive(Clone, Debug)]
pub struct Pose {
    /// The rig that holds the shapes.
    pub rig: Arc<Rig>,
    /// World from bind pose of each joint of each skin.
    pub skins: Vec<Vec<Mat4>>,
    /// Weights of the morph targets of each shape.
    pub weights: Vec<Vec<f32>>,
}
