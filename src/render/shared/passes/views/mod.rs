//! Views: lists of triangles and depth maps.

pub mod list_lengths;
pub mod rasterize_view;
