//! The passes: one Rust file and one shader file each. They know nothing of each other; `frame.rs` wires them.

pub mod accumulate;
pub mod connect;
pub mod extend;
pub mod eye_vertices;
pub mod gbuffer;
pub mod light_subpath;
pub mod queries;
pub mod ray_queries;
pub mod view_lists;
pub mod view_setup;
