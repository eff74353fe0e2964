//! Tests of the code before any renderer: loaders, built-in scenes, staging and image metrics. Needs no GPU.

#[path = "../common/mod.rs"]
mod common;

mod builtin;
mod bytes;
mod compression;
mod gltf;
mod meshes;
mod metrics;
mod mitsuba;
mod staging;
