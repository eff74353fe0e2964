//! lightsheaf
pub mod film;
pub mod metrics;
pub mod reference;
pub mod scene;
