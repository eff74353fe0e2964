//! Meshes and their placements.

use glam::{Affine3A, Vec2, Vec3, Vec4};

use super::tessellation::Tessellation;

/// Triangles with one material, in their own space. Attribute arrays are empty or as long as `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Its name in the file.
    pub name: String,
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit shading normals; empty: flat.
    pub normals: Vec<Vec3>,
    /// Unit tangents, w the sign of the bitangent (glTF); empty: derived from uv where a normal map asks for them.
    pub tangents: Vec<Vec4>,
    /// Texture coordinates by set, v down the image as in glTF.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours with alpha.
    pub colors: Vec<Vec4>,
    /// Counter-clockwise seen from the front; indices in range.
    pub triangles: Vec<[u32; 3]>,
    /// Index into the scene's materials.
    pub material: usize,
    /// How its surface is made finer; none: as it is.
    pub tessellation: Option<Tessellation>,
}

/// A placement of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index into the scene's meshes.
    pub mesh: usize,
    /// Any affine map; a mirroring one keeps the front side where the file's author sees it (winding is swapped).
    pub world_from_local: Affine3A,
}
