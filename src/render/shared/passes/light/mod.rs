//! The light subpath, and the light points of direct light.

pub mod caustics;
pub mod light_candidates;
pub mod light_importance;
pub mod light_point;
pub mod light_reservoirs;
pub mod light_subpath;
pub mod rsm;
pub mod sky_guide;
