//! The first vertex of each pixel.

pub mod eye_vertices;
pub mod gbuffer;
