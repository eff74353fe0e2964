//! Node trees and the skins that refer to them.

use glam::{Affine3A, DAffine3, DVec3, Mat4, Quat, Vec3};

/// A node's local transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Local {
    /// A single matrix, which cannot be animated.
    Matrix(Affine3A),
    /// Translation, rotation and scale; the rotation has unit length.
    Parts {
        /// Metres.
        translation: Vec3,
        /// Unit quaternion.
        rotation: Quat,
        /// Scale along each axis, applied before the rotation.
        scale: Vec3,
    },
}

impl Local {
    /// Returns the transform from node to parent.
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

/// A forest of nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tree {
    pub(super) nodes: Vec<(Local, Option<usize>)>,
    /// Node indices, parents before their children.
    order: Vec<usize>,
    /// Where the world's origin is in the space of the nodes without parents.
    origin: DVec3,
}

impl Tree {
    /// Builds the forest from nodes with their parents, whose indices are in range.
    ///
    /// # Errors
    /// A node that is its own ancestor is an error, which holds its index.
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
        reached.iter().position(|reached| !reached).map_or(Ok(Self { nodes, order, origin: DVec3::ZERO }), Err)
    }

    /// Moves the world's origin to a place.
    #[must_use]
    pub fn around(self, origin: DVec3) -> Self {
        Self { origin: self.origin + origin, ..self }
    }

    /// Returns the world-from-node transform of each node in the rest pose.
    #[must_use]
    pub fn rest(&self) -> Vec<Affine3A> {
        self.place(&self.nodes.iter().map(|(local, _)| *local).collect::<Vec<_>>())
    }

    /// Returns the world-from-node transform of each node for the given local transforms.
    pub(super) fn place(&self, locals: &[Local]) -> Vec<Affine3A> {
        let mut world = vec![DAffine3::from_translation(-self.origin); locals.len()];
        for &node in &self.order {
            let parent = self.nodes[node].1.map_or(world[node], |parent| world[parent]);
            world[node] = parent * locals[node].matrix().as_daffine3();
        }
        world.iter().map(DAffine3::as_affine3a).collect()
    }
}

/// The joints of a skinned mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    /// Each joint's node and its inverse bind matrix.
    pub joints: Vec<(usize, Mat4)>,
}

impl Skin {
    /// Returns the world-from-bind-pose matrix of each joint for world-from-node transforms.
    #[must_use]
    pub fn matrices(&self, world: &[Affine3A]) -> Vec<Mat4> {
        self.joints.iter().map(|&(node, bind)| Mat4::from(world[node]) * bind).collect()
    }
}
