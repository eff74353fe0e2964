//! Pictures of the GPU methods: analytic scenes, lights, samplers, stability, golden pictures, frames that
//! are denoised, and the twins of shader functions. One binary, so that all share the devices and their
//! pipelines.

#[path = "../common/mod.rs"]
mod common;

mod analytic;
mod convergence;
mod densities;
mod devices;
mod golden;
mod lights;
mod live;
mod stability;
mod tiles;
mod twin;
mod twins;
