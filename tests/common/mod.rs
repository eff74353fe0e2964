//! Helpers that several tests share: the device, files, skipping, and pictures by any method.
#![allow(dead_code, reason = "each test uses its share")]

pub mod browser;
pub mod folder;
pub mod harness;
pub mod random;
pub mod scenes;
pub mod shaders;
pub mod statistics;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use lightsheaf::film::Film;
use lightsheaf::gpu::{Gpu, GpuError};
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::render::renderer::{RenderStats, Renderer};
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::scene::{Bsdf, Scene};
use lightsheaf::settings::Settings;

/// Returns the device, opened once per test binary. Without one, the test is skipped.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| opened("no Vulkan device", Gpu::new())).as_ref()
}

/// Returns the same device with ray queries.
pub fn gpu_with_ray_queries() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| opened("no ray queries", Gpu::with_ray_queries())).as_ref()
}

fn opened(lack: &str, opened: Result<Gpu, GpuError>) -> Option<Gpu> {
    opened.map_err(|error| skip("REQUIRE_GPU", &format!("{lack} ({error})"))).ok()
}

/// Returns the folder of scenes and reference images beside the repository. Without it, the test is skipped.
pub fn shared() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if !path.is_dir() {
        skip("REQUIRE_SHARED", &format!("{} is not there", path.display()));
        return None;
    }
    Some(path)
}

/// Returns the folder of Mitsuba's reference images beside the repository. Without it, the test is skipped.
pub fn references() -> Option<PathBuf> {
    let path = shared()?.join("references");
    if !path.is_dir() {
        skip("REQUIRE_SHARED", &format!("{} is not there", path.display()));
        return None;
    }
    Some(path)
}

/// Says that a test is skipped and why. Fails instead if the environment variable `required` is 1.
pub fn skip(required: &str, lack: &str) {
    assert!(!is_set(required), "{required} is 1, but: {lack}");
    println!("skipped: {lack}");
}

/// True if an environment variable is 1.
pub fn is_set(variable: &str) -> bool {
    std::env::var(variable).as_deref() == Ok("1")
}

/// Fails after a run has rewritten what it should have been compared with, so that such a run never counts as
/// a passed test.
pub fn rewritten(variable: &str, file: &Path) -> ! {
    panic!(
        "{variable} is 1: {} has been rewritten. Look at the change, then run the tests without {variable}",
        file.display()
    );
}

/// Renders while no other thread does, since the software device uses all processors for each picture.
pub fn one_at_a_time<T>(render: impl FnOnce() -> T) -> T {
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    render()
}

/// Renders a picture by `raster`, one at a time, and checks the device for errors.
pub fn raster(gpu: &Gpu, scene: &Scene, settings: &Settings) -> (Film, RenderStats) {
    one_at_a_time(|| {
        let mut renderer = SharedRenderer::new(gpu, scene, settings).unwrap();
        renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
        gpu.check().unwrap();
        let (film, stats) = (renderer.film().unwrap(), renderer.stats());
        assert_eq!((stats.samples, stats.lost_nodes), (u64::from(settings.samples), 0));
        (film, stats)
    })
}

/// Renders by the reference in the same size and depth.
pub fn reference(scene: &Scene, settings: &Settings, samples: u32, seed: u32) -> Film {
    let settings = ReferenceSettings { samples, seed, ..ReferenceSettings::of(settings) };
    let output = Reference::new(scene).render(&settings, &|_, _| ());
    assert_eq!(output.non_finite, 0);
    output.film
}

/// Adds samples and returns the picture.
pub fn picture(renderer: &mut dyn Renderer, samples: u64) -> Film {
    renderer.render(samples, &mut |_| true).unwrap();
    let stats = renderer.stats();
    assert_eq!((stats.non_finite, stats.lost_nodes), (0, 0));
    renderer.film().unwrap()
}

/// Makes all surfaces of a scene diffuse, since `raster` needs many samples for smooth metal or water under a
/// sky.
pub fn matte(mut scene: Scene) -> Scene {
    for material in &mut scene.materials {
        if let Bsdf::MetallicRoughness { base_color, .. } = material.bsdf {
            material.bsdf = Bsdf::Diffuse { reflectance: base_color };
        }
    }
    scene
}
