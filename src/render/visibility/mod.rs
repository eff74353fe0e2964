//! The data structures of visibility queries: lists and depth maps of views, and what rays are traced through.

pub mod acceleration;
pub mod bvh;
pub mod grid;
pub mod tracer;
pub mod view;
