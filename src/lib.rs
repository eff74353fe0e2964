//! lightsheaf
pub mod film;
pub mod metrics;
pub mod scene;
