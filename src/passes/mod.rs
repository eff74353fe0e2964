//! The passes: one Rust file and one shader file each. They know nothing of each other; `frame.rs` wires those of
//! raster, `path_renderer.rs` those that trace rays.

pub mod accumulate;
pub mod antialias;
pub mod compose;
pub mod connect;
pub mod deform;
pub mod depth_maps;
pub mod extend;
pub mod eye_paths;
pub mod eye_vertices;
pub mod filter;
pub mod gbuffer;
pub mod gradient;
pub mod light_gifts;
pub mod light_paths;
pub mod light_point;
pub mod light_pool;
pub mod light_reuse;
pub mod light_subpath;
pub mod list_lengths;
pub mod outliers;
pub mod queries;
pub mod ray_queries;
pub mod reservoirs;
pub mod resolve;
pub mod rsm;
pub mod temporal;
pub mod tessellate;
pub mod view_lists;
pub mod view_setup;
