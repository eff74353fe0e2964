//! Sampling of lights and of bundle directions: the light table, the light tree, and densities over the
//! sphere.

pub mod aims;
pub mod bundle_directions;
pub mod local_sky;
pub mod octahedral;
pub mod sky_guide;
pub mod table;
pub mod tree;
