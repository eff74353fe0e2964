//! `raster` against `twin`: the same estimator with the same random numbers, so that what differs is visibility alone. And what both
//! share: a lens, and images of single strategies.

mod common;

use common::scenes::pinhole;
use common::statistics::{Look, compare as same_mean};
use common::{gpu_with_ray_queries, raster, reference};
use glam::Vec3;
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::scene::{Bsdf, Camera, Lens, Light, Scene, builtin};
use lightsheaf::settings::{LightSampling, Method, OnlyStrategy, RestirBias, Settings, Strategies, Visibility};

fn settings(method: Method, samples: u32) -> Settings {
    Settings { method, width: 48, height: 48, samples, ..Settings::plain() }
}

/// Both methods on one device.
fn both(gpu: &Gpu, scene: &Scene, base: &Settings) -> [Film; 2] {
    [Method::Raster, Method::Twin].map(|method| {
        let (film, stats) = raster(gpu, scene, &Settings { method, ..base.clone() });
        assert_eq!(stats.non_finite, 0);
        film
    })
}

/// Every built-in scene, of which some have textures, holes, lights of all kinds and triangles of all sizes.
#[test]
fn raster_is_its_twin() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut seen = 0;
    for (name, _) in builtin::names() {
        let scene = builtin::load(name).unwrap().without_glass();
        let [ours, twin] = both(gpu, &scene, &settings(Method::Raster, 6));
        let apart = compare(&ours, &twin).unwrap();
        println!("{name}: rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
        assert!(apart.rel_mse <= 1e-4 && apart.mean_bias.abs() <= 1e-3, "{name}: {apart:?}");
        seen += 1;
    }
    assert!(seen >= 8);
}

/// Light points of two iterations, each asked about places of two.
#[test]
fn reuse_has_its_twin() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    for name in ["point_hall:40", "emitter_hall:300", "cornell_env"] {
        let scene = builtin::load(name).unwrap();
        let of = |restir_bias| {
            let light_sampling = Some(LightSampling::Restir);
            let settings = Settings { light_sampling, restir_bias, light_pool: Some(6), ..settings(Method::Raster, 6) };
            let [ours, twin] = both(gpu, &scene, &settings);
            let apart = compare(&ours, &twin).unwrap();
            println!("{name}, {restir_bias}: rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
            assert!(apart.rel_mse <= 1e-4 && apart.mean_bias.abs() <= 1e-3, "{name}, {restir_bias}: {apart:?}");
            ours
        };
        let apart = compare(&of(RestirBias::Biased), &of(RestirBias::Unbiased)).unwrap();
        assert!(apart.rel_mse > 1e-4, "{name}: {apart:?}");
    }
}

/// The comparison finds what is wrong: depth maps and centres instead of exact lists, another seed, other strategies.
#[test]
fn what_is_no_twin_is_noticed() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let base = settings(Method::Twin, 6);
    let twin = raster(gpu, &scene, &base).0;
    let ours = Settings { method: Method::Raster, ..base };
    for other in [
        Settings { visibility: Visibility::Fast, ..ours.clone() },
        Settings { seed: 2, ..ours.clone() },
        Settings { strategies: Strategies::Vpl, ..ours },
    ] {
        let apart = compare(&raster(gpu, &scene, &other).0, &twin).unwrap();
        println!("rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
        assert!(apart.rel_mse > 1e-4, "{apart:?}");
    }
}

/// Triangles a sixth of a pixel wide: neighbours far away must neither hide a point on the border between them nor leave a gap.
#[test]
fn small_triangles_far_away_hide_nothing() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("integrating_sphere").unwrap();
    let base = Settings { width: 16, height: 16, bounces: 0, ..settings(Method::Raster, 64) };
    let [ours, twin] = both(gpu, &scene, &base);
    let apart = compare(&ours, &twin).unwrap();
    println!("rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
    assert!(apart.mean_bias.abs() <= 1e-5, "{apart:?}");
}

/// A sun through a roof, and a spot: views of other kinds than those of points.
#[test]
fn parallel_and_conical_light_have_twins() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = builtin::load("cornell_env").unwrap();
    let sun = Light::Directional { direction: Vec3::new(0.3, -1.0, -0.2).normalize(), irradiance: Vec3::splat(3.0) };
    scene.lights = vec![sun];
    let [ours, twin] = both(gpu, &scene, &settings(Method::Raster, 8));
    let apart = compare(&ours, &twin).unwrap();
    assert!(apart.rel_mse <= 1e-4 && apart.mean_bias.abs() <= 1e-3, "{apart:?}");
}

/// The weighted images of all strategies add up to the picture; without weights, the strategies of one length have one mean.
#[test]
fn strategy_images_add_up_to_the_picture() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    // The last has two lights, each with a point of its own.
    for (name, emits) in [("cornell_point", false), ("cornell_area", true), ("cornell_env", true)] {
        let mut scene = builtin::load(name).unwrap();
        if emits {
            scene.lights.push(Light::Point { position: Vec3::new(0.2, 1.2, 0.1), intensity: Vec3::splat(0.5) });
        }
        for method in [Method::Raster, Method::Twin] {
            let base = settings(method, 8);
            let whole = raster(gpu, &scene, &base).0;
            let mut sum = vec![[0.0_f64; 3]; whole.pixels.len()];
            let mut shown = Vec::new();
            for s in 0..=3 {
                for t in 2..=base.bounces + 3 {
                    let only = Some(OnlyStrategy { s, t, weighted: true });
                    let part = raster(gpu, &scene, &Settings { only, ..base.clone() }).0;
                    if part.pixels.iter().any(|p| *p != [0.0; 3]) {
                        shown.push((s, t));
                    }
                    for (sum, pixel) in sum.iter_mut().zip(&part.pixels) {
                        (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
                    }
                }
            }
            let connected = [(1, 2), (1, 3), (1, 4), (2, 2), (2, 3), (3, 2)];
            assert!(connected.iter().all(|st| shown.contains(st)), "{name}: {shown:?}");
            // After the last bounce nothing is met.
            let met = [(0, 2), (0, 3), (0, 4), (0, 5)].map(|st| shown.contains(&st));
            assert_eq!(met, [emits, emits, emits, false], "{name}: {shown:?}");
            for (sum, pixel) in sum.iter().zip(&whole.pixels) {
                for c in 0..3 {
                    let error = (sum[c] - f64::from(pixel[c])).abs();
                    assert!(error <= 1e-5 * f64::from(pixel[c]) + 1e-9, "{name} {method}: {sum:?} is not {pixel:?}");
                }
            }
        }
    }
}

/// What is sharp and what is not is the reference's.
#[test]
fn a_lens_agrees_with_the_reference() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = builtin::load("cornell_point").unwrap();
    let camera = scene.cameras[0].clone();
    scene.cameras[0] = Camera { lens: Some(Lens { radius: 0.15, focus: 3.0 }), ..camera.clone() };
    let base = Settings { width: 32, height: 32, samples: 64, bounces: 0, ..Settings::plain() };
    let films = |scene: &Scene| {
        (1..=12).map(|seed| raster(gpu, scene, &Settings { seed, ..base.clone() }).0).collect::<Vec<_>>()
    };
    let expected: Vec<_> = (0..8).map(|seed| reference(&scene, &base, 128, 1000 + seed)).collect();
    let verdict = same_mean(&films(&scene), &expected, Look::Blocks);
    assert!(verdict.agrees(), "{verdict:?}");
    let pinhole = Scene { cameras: vec![camera], ..scene.clone() };
    let verdict = same_mean(&films(&pinhole), &expected, Look::Blocks);
    assert!(!verdict.agrees(), "a pinhole was not noticed: {verdict:?}");
}

/// A device with ray queries and one without draw the same raster picture, and the twin says what it lacks.
#[test]
fn ray_queries_are_asked_for_only_where_they_are_needed() {
    let Some(with) = gpu_with_ray_queries() else { return };
    let Some(without) = common::gpu() else { return };
    assert!(!without.capabilities.ray_queries);
    let mut scene = builtin::load("cornell_point").unwrap();
    scene.cameras.push(pinhole(Vec3::Y, Vec3::NEG_Z, 1.0));
    assert!(matches!(scene.materials[0].bsdf, Bsdf::Diffuse { .. }));
    let base = settings(Method::Raster, 2);
    assert_eq!(raster(with, &scene, &base).0.pixels, raster(without, &scene, &base).0.pixels);
    let refused = lightsheaf::renderer::Renderer::new(without, &scene, &settings(Method::Twin, 1)).err();
    assert!(refused.is_some_and(|e| e.to_string().contains("ray queries")));
}
