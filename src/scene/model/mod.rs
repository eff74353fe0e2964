//! The data of a scene.

pub mod camera;
pub mod emitter;
pub mod environment;
pub mod error;
pub mod geometry;
pub mod height;
mod ktx2;
pub mod light;
pub mod light_groups;
pub mod material;
pub(in crate::scene) mod memory;
pub mod mesh;
pub mod normals;
pub mod pattern;
pub mod scene;
pub mod shapes;
pub mod stats;
pub mod tangents;
pub mod tessellation;
pub mod texture;
pub mod transform;
