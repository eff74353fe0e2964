//! The passes of an iteration: one Rust file and one shader file each. They do not import each other.

pub mod camera;
pub mod film;
pub mod light;
pub mod paths;
pub mod views;
