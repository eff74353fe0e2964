//! Renderers on the GPU, which [`open_async`] creates.
//!
//! Layers, from the bottom: [`layouts`], [`sampler`], [`interleave`] and [`frame_uniform`] are values.
//! [`upload`], [`lights`], [`visibility`] and [`denoise`] hold the scene, the sampling of lights, the data
//! structures of visibility queries, and the denoiser. [`shared`] and [`subpaths`] are the two estimators,
//! which are independent of each other.

pub mod adapt;
pub mod adaptive_sampling;
pub mod convergence;
pub mod denoise;
pub mod fingerprint;
pub mod frame_uniform;
pub mod interleave;
pub mod layouts;
pub mod lights;
pub mod planned_pass;
pub mod recording;
mod reference_settings;
pub mod renderer;
pub mod sampler;
mod scene_flags;
pub mod shared;
pub mod state;
pub mod subpaths;
pub mod upload;
pub mod visibility;

use crate::gpu::Gpu;
#[cfg(not(target_family = "wasm"))]
use crate::gpu::GpuError;
use crate::scene::{Geometry, Scene, SceneStats};
#[cfg(not(target_family = "wasm"))]
use crate::settings::Technique;
use crate::settings::{Method, Settings};

use adapt::adapted;
use shared::SharedRenderer;
use shared::plan::FramePlan;
use subpaths::PathRenderer;
use subpaths::plan::PathPlan;

pub use renderer::{RenderError, RenderStats, Renderer};

/// Opens the best adapter with the features that a technique needs.
///
/// # Errors
/// As [`Gpu::new_async`] or [`Gpu::with_ray_queries`].
#[cfg(not(target_family = "wasm"))]
pub fn open_device(technique: Technique) -> Result<Gpu, GpuError> {
    if technique.needs_ray_queries() { Gpu::with_ray_queries() } else { Gpu::new() }
}

/// Opens a renderer of a scene on a device.
///
/// The scene is adapted to the settings first ([`adapt`]): the lens is applied, and glass is removed for
/// methods without transmission, which [`Renderer::warnings`] reports. [`Renderer::render_async`] then adds
/// samples, and [`Renderer::film_async`] reads the picture.
///
/// # Errors
/// [`RenderError::Setting`] for settings out of range, for a combination of method and visibility that does
/// not exist, for a scene without the camera, for an image that the device cannot hold, and for
/// [`Method::Reference`], which renders on the CPU ([`crate::reference::Reference`]); [`RenderError::Gpu`] if
/// the device fails or lacks ray queries.
pub async fn open_async<'gpu>(
    gpu: &'gpu Gpu,
    scene: &Scene,
    settings: &Settings,
) -> Result<Box<dyn Renderer + 'gpu>, RenderError> {
    Ok(match settings.method() {
        Method::Shared => Box::new(SharedRenderer::new_async(gpu, scene, settings).await?),
        Method::Bdpt | Method::Path => Box::new(PathRenderer::new_async(gpu, scene, settings).await?),
        Method::Reference => return Err(RenderError::on_cpu()),
    })
}

/// Waits for [`open_async`].
///
/// # Errors
/// As [`open_async`].
#[cfg(not(target_family = "wasm"))]
pub fn open<'gpu>(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Box<dyn Renderer + 'gpu>, RenderError> {
    pollster::block_on(open_async(gpu, scene, settings))
}

/// Returns the plan of a renderer as text and as JSON, without opening the renderer.
///
/// # Errors
/// [`RenderError::Setting`] as [`open_async`].
pub fn plan(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Result<(String, serde_json::Value), RenderError> {
    settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
    let scene = adapted(scene, settings)?;
    let stats = SceneStats::new(&scene, &Geometry::new(&scene));
    let json = |plan: serde_json::Result<serde_json::Value>| plan.unwrap_or_default();
    Ok(match settings.method() {
        Method::Shared => {
            let plan = FramePlan::new(&stats, settings, &gpu.capabilities);
            (plan.to_string(), json(serde_json::to_value(&plan)))
        }
        Method::Bdpt | Method::Path => {
            let plan = PathPlan::new(&scene, &stats, settings, &gpu.capabilities);
            (plan.to_string(), json(serde_json::to_value(&plan)))
        }
        Method::Reference => return Err(RenderError::on_cpu()),
    })
}
