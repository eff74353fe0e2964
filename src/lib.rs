//! lightsheaf
pub mod scene;
