//! From instances of meshes to world-space triangles: [`refine`] subdivides tessellated meshes, [`flatten`]
//! collects all.

mod edge_scale;
pub mod flatten;
pub mod refine;
