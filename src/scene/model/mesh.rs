//! Meshes and their placements.

use glam::{Affine3A, Vec2, Vec3, Vec4};

use crate::scene::model::tessellation::Tessellation;

/// Triangles with one material in object space. Attribute arrays are empty or as long as `positions`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Its name in the file.
    pub name: String,
    /// Vertex positions in metres.
    pub positions: Vec<Vec3>,
    /// Unit shading normals; if empty, the mesh is flat-shaded.
    pub normals: Vec<Vec3>,
    /// Unit tangents, w the sign of the bitangent (glTF); if empty, normal maps derive them from uv.
    pub tangents: Vec<Vec4>,
    /// Texture coordinates by set, v down the image as in glTF.
    pub uvs: [Vec<Vec2>; 2],
    /// Linear vertex colours with alpha.
    pub colors: Vec<Vec4>,
    /// Counter-clockwise seen from the front; indices in range.
    pub triangles: Vec<[u32; 3]>,
    /// Index into the scene's materials.
    pub material: usize,
    /// Refinement of the surface, if any.
    pub tessellation: Option<Tessellation>,
}

/// A placement of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index into the scene's meshes.
    pub mesh: usize,
    /// Any affine map. A mirroring one swaps the winding, so that the front side stays the one that the
    /// author sees.
    pub world_from_local: Affine3A,
}
