//! The raster methods need nothing beyond WebGPU's guarantees: its limits, and no optional feature.

mod common;

use common::{gpu, picture, skip};
use lightsheaf::gpu::Gpu;
use lightsheaf::render;
use lightsheaf::scene::{self, builtin};
use lightsheaf::settings::{Settings, Technique, Visibility};

/// Returns a device with WebGPU's limits.
fn limited() -> Option<Gpu> {
    Gpu::with_webgpu_limits().map_err(|error| skip("REQUIRE_GPU", &error.to_string())).ok()
}

/// Scenes that are rendered by every method, each of which compiles shaders of its own.
const BY_EVERY_METHOD: [&str; 2] = ["cornell_area", "cornell_mirrors"];

/// Every built-in scene renders, and pictures are those of a device with all limits.
#[test]
fn every_builtin_renders_within_the_limits_of_webgpu() {
    let (Some(all), Some(webgpu)) = (gpu(), limited()) else { return };
    assert!(webgpu.capabilities.max_storage_bytes == 128 << 20 && !webgpu.capabilities.timestamps);
    let bvh = Technique { visibility: Some(Visibility::Bvh), ..Technique::PATH };
    let others = [Technique::FAST, Technique::BDPT, Technique::PATH, bvh];
    let names: Vec<_> = builtin::names().map(|(name, _)| name).collect();
    assert!(names.len() > 10, "{names:?}");
    for name in names {
        let scene = scene::load(&format!("builtin:{name}")).unwrap();
        let others = others.iter().filter(|_| BY_EVERY_METHOD.contains(&name)).copied();
        for technique in std::iter::once(Technique::RASTER).chain(others) {
            let settings = Settings { technique, width: 32, height: 24, ..Settings::default() };
            let of = |gpu| {
                let mut renderer = render::open(gpu, &scene, &settings).unwrap();
                let film = picture(renderer.as_mut(), 2);
                gpu.check().unwrap();
                film
            };
            assert!(of(&webgpu) == of(all), "{name} by {technique}");
        }
    }
}
