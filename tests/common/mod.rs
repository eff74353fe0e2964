//! What several tests need: the device, and the files beside the repository.
#![allow(dead_code, reason = "each test uses its share")]

pub mod random;
pub mod scenes;
pub mod statistics;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use lightsheaf::film::Film;
use lightsheaf::gpu::{Gpu, GpuError};
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::renderer::{Progressive, RenderStats, Renderer};
use lightsheaf::scene::{Bsdf, Scene};
use lightsheaf::settings::Settings;

/// The device, opened once per test binary. Without one, says so and gives none; where `REQUIRE_GPU` is 1, fails instead.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| required("no Vulkan device", Gpu::new())).as_ref()
}

/// The same device with ray queries.
pub fn gpu_with_ray_queries() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| required("no ray queries", Gpu::with_ray_queries())).as_ref()
}

fn required(lack: &str, opened: Result<Gpu, GpuError>) -> Option<Gpu> {
    opened
        .inspect_err(|error| {
            assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "REQUIRE_GPU is 1, but {error}");
            println!("skipped: {lack} ({error})");
        })
        .ok()
}

/// The folder of scenes and reference images beside the repository. Without it, says so and gives none.
pub fn shared() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}

/// Renders by `raster`, one picture at a time, and asks the device for errors.
pub fn raster(gpu: &Gpu, scene: &Scene, settings: &Settings) -> (Film, RenderStats) {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut renderer = Renderer::new(gpu, scene, settings).unwrap();
    renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
    gpu.check().unwrap();
    let (film, stats) = (renderer.film().unwrap(), renderer.stats());
    assert_eq!((stats.samples, stats.lost_nodes), (u64::from(settings.samples), 0));
    (film, stats)
}

/// Renders by the reference with as many paths per pixel, in the same size and depth.
pub fn reference(scene: &Scene, settings: &Settings, samples: u32, seed: u32) -> Film {
    let Settings { width, height, bounces, camera, .. } = *settings;
    let settings = ReferenceSettings { width, height, samples, bounces: Some(bounces), seed, camera };
    let output = Reference::new(scene).render(&settings, &|_, _| ());
    assert_eq!(output.non_finite, 0);
    output.film
}

/// The picture after so many more samples.
pub fn picture(renderer: &mut dyn Progressive, samples: u64) -> Film {
    renderer.render(samples, &mut |_| true).unwrap();
    let stats = renderer.stats();
    assert_eq!((stats.non_finite, stats.lost_nodes), (0, 0));
    renderer.film().unwrap()
}

/// The scene with all surfaces diffuse: `raster` needs many samples for smooth metal or water under a sky.
pub fn matte(mut scene: Scene) -> Scene {
    for material in &mut scene.materials {
        if let Bsdf::MetallicRoughness { base_color, .. } = material.bsdf {
            material.bsdf = Bsdf::Diffuse { reflectance: base_color };
        }
    }
    scene
}
