//! The scene on the device: buffers and textures, and the passes that deform and tessellate meshes.

pub mod deform;
pub mod deformation;
pub mod gpu_scene;
mod materials;
pub mod rest_mesh;
mod rough_coat;
mod sheen;
mod tables;
pub mod tessellate;
pub mod textures;
mod vertices;
