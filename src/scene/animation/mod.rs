//! Animation: a tree of nodes, keyframe tracks, skins and morph targets, and their evaluation at a time.
//!
//! A file with animations leaves a [`Rig`] on its [`Scene`](crate::scene::Scene), which itself is in the
//! file's rest pose. [`Scene::at`](crate::scene::Scene::at) bakes the pose of a time into a scene without a
//! rig, which renderers treat like any other: instances, cameras and lights are placed at their nodes, meshes
//! are morphed, then skinned.

pub mod curve;
pub mod deformation;
pub mod pose;
pub mod rig;
pub mod track;
pub mod tree;

pub use curve::{Curve, Interpolation};
pub use deformation::{Deformation, MorphTarget};
pub use rig::{AttachedLight, Pose, Rig, Shape};
pub use track::{Animation, Factor, Target};
pub use tree::{Local, Skin, Tree};
