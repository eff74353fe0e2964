//! Features that are requested of a device: `raster` requests nothing of ray tracing.

use crate::common;

use lightsheaf::gpu::{Gpu, GpuError};
use lightsheaf::metrics::compare;
use lightsheaf::settings::{Settings, Technique, VisibilityFrom};

const RAY_TRACING: wgpu::Features = wgpu::Features::EXPERIMENTAL_RAY_QUERY
    .union(wgpu::Features::EXPERIMENTAL_RAY_HIT_VERTEX_RETURN)
    .union(wgpu::Features::EXPERIMENTAL_RAY_TRACING_PIPELINES);

#[test]
fn raster_runs_on_a_device_without_ray_queries() {
    let Some(gpu) = common::gpu() else { return };
    assert!(!gpu.capabilities.ray_queries);
    assert!(!gpu.device.features().intersects(RAY_TRACING));
    let scene = lightsheaf::scene::load("builtin:cornell_point").unwrap();
    let settings = Settings { width: 16, height: 16, samples: 2, ..Settings::plain() };
    let (film, stats) = common::raster(gpu, &scene, &settings);
    assert_eq!(stats.non_finite, 0);
    assert!(film.pixels.iter().flatten().sum::<f32>() > 1.0);
}

/// What a GPU does otherwise than a software driver does not change pictures: lists texel by texel, large bands, a finer
/// grid, the order of threads.
#[test]
fn gpus_and_software_drivers_make_the_same_pictures() {
    let Some(gpu) = common::gpu() else { return };
    let Ok(mut other) = Gpu::new() else { return };
    other.capabilities.software ^= true;
    let [lists, grid, fast] = [
        (Technique::RASTER, VisibilityFrom::Lists),
        (Technique::RASTER, VisibilityFrom::Grid),
        (Technique::FAST, VisibilityFrom::Auto),
    ];
    for (name, methods) in [
        ("builtin:cornell_point", vec![lists, grid, fast]),
        ("builtin:displaced_room:5000", vec![grid]),
        ("builtin:cornell_area", vec![fast]),
        ("builtin:cornell_glossy", vec![lists]),
    ] {
        let scene = lightsheaf::scene::load(name).unwrap();
        for (technique, visibility_from) in methods {
            let base = Settings { technique, visibility_from, ..Settings::plain() };
            let settings = Settings { width: 48, height: 48, samples: 4, interleave: Some(1), ..base };
            let [(a, seen), (b, _)] = [&other, gpu].map(|gpu| common::raster(gpu, &scene, &settings));
            let difference = compare(&a, &b).unwrap();
            println!("{name}, {technique}, {visibility_from:?}: {}", difference.rel_mse);
            assert!(difference.rel_mse < 1e-8, "{name}, {technique}: {}", difference.rel_mse);
            assert_eq!((seen.lost_nodes, seen.non_finite), (0, 0));
        }
    }
}

/// A grid that would be longer than a buffer is made coarser, and rays through it meet the same triangles. If not even that
/// fits, the error says what does.
#[test]
fn a_grid_is_as_coarse_as_the_device_needs() {
    let Some(gpu) = common::gpu() else { return };
    let Ok(mut small) = Gpu::new() else { return };
    let scene = lightsheaf::scene::load("builtin:displaced_room:60000").unwrap();
    let triangles = lightsheaf::scene::Geometry::new(&scene).triangles.len() as u64;
    let settings =
        Settings { visibility_from: VisibilityFrom::Grid, width: 32, height: 32, samples: 2, ..Settings::plain() };
    let picture = common::raster(gpu, &scene, &settings).0;
    // 48 bytes for each triangle, and about 2.3 MB for lists.
    small.capabilities.max_storage_bytes = 48 * triangles + 2_000_000;
    let difference = compare(&common::raster(&small, &scene, &settings).0, &picture).unwrap();
    assert!(difference.rel_mse < 1e-8, "{}", difference.rel_mse);
    small.capabilities.max_storage_bytes = 48 * triangles + 200_000;
    let refused = lightsheaf::render::shared::SharedRenderer::new(&small, &scene, &settings).err();
    let text = refused.map(|error| error.to_string()).unwrap_or_default();
    assert!(text.contains("--visibility-from lists") && text.contains(&triangles.to_string()), "{text}");
}

/// Runs are counted all the time, and timed when asked for. The device is this test's own.
#[test]
fn passes_are_timed_when_asked_for() {
    let Some(gpu) = common::gpu().and_then(|_| Gpu::new().ok()) else { return };
    let scene = lightsheaf::scene::load("builtin:cornell_point").unwrap();
    let settings = Settings { width: 16, height: 16, samples: 2, ..Settings::plain() };
    let millis = || {
        let (_, stats) = common::raster(&gpu, &scene, &settings);
        assert!(stats.passes.values().all(|pass| pass.runs > 0) && stats.passes.len() > 5, "{:?}", stats.passes);
        stats.passes.values().map(|pass| pass.gpu_millis).sum::<f64>()
    };
    assert_eq!(millis(), 0.0);
    gpu.timings.measure(true);
    assert_eq!(millis() > 0.0, gpu.capabilities.timestamps);
}

#[test]
fn ray_queries_are_there_when_asked_for() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    assert!(gpu.capabilities.ray_queries);
    assert_eq!(gpu.device.features() & RAY_TRACING, wgpu::Features::EXPERIMENTAL_RAY_QUERY);
}

#[test]
fn an_adapter_without_ray_queries_is_named_with_what_to_do() {
    match Gpu::with_ray_queries() {
        Ok(gpu) => assert!(gpu.capabilities.ray_queries),
        Err(error @ GpuError::NoRayQueries { .. }) => println!("this adapter: {error}"),
        Err(error) => println!("skipped: {error}"),
    }
    let error = GpuError::NoRayQueries { adapter: "Old (driver 1)".to_owned(), feature: "RAY".to_owned() };
    let text = error.to_string();
    assert!(["Old (driver 1)", "RAY", "--method raster"].iter().all(|part| text.contains(part)), "{text}");
}
