//! The first vertex of each pixel.

pub mod borders;
pub mod eye_vertices;
pub mod gbuffer;
pub mod seen_light;
