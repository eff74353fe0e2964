//! lightsheaf
pub mod film;
pub mod frame;
pub mod gpu;
pub mod gpu_scene;
pub mod layouts;
pub mod lights;
pub mod metrics;
pub mod passes;
pub mod plan;
pub mod reference;
pub mod renderer;
pub mod sampler;
pub mod scene;
pub mod settings;
pub mod view;
