//! `raster` against `twin`: the estimator and the random numbers are the same, so that only visibility can
//! differ. Features that both share: a lens, and images of single strategies.

use crate::common;

use common::scenes::pinhole;
use common::statistics::{Look, compare as same_mean};
use common::{gpu_with_ray_queries, raster, reference};
use glam::Vec3;
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::scene::{Bsdf, Camera, Lens, Light, Scene, builtin};
use lightsheaf::settings::{LightSampling, OnlyStrategy, RestirBias, Settings, Strategies, Technique, Visibility};

fn settings(technique: Technique, samples: u32) -> Settings {
    Settings { technique, width: 48, height: 48, samples, ..Settings::plain() }
}

/// Renders by both techniques on one device.
fn both(gpu: &Gpu, scene: &Scene, base: &Settings) -> [Film; 2] {
    [Technique::RASTER, Technique::TWIN].map(|technique| {
        let (film, stats) = raster(gpu, scene, &Settings { technique, ..base.clone() });
        assert_eq!(stats.non_finite, 0);
        film
    })
}

/// The built-in scenes have textures, holes, lights of all kinds and triangles of all sizes.
#[test]
fn raster_is_its_twin() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut seen = 0;
    for (name, _) in builtin::names() {
        let scene = builtin::load(name).unwrap().without_glass();
        let [ours, mut twin] = both(gpu, &scene, &settings(Technique::RASTER, 6));
        if name == "point_hall" {
            // Grid and hierarchy agree there, and differ from the driver's ray queries in some pixels alike
            // (rel_mse 1.3e-3): where hits are equally near, the driver has another rule.
            let technique = Technique { visibility: Some(Visibility::Bvh), ..Technique::RASTER };
            twin = raster(gpu, &scene, &settings(technique, 6)).0;
        }
        let apart = compare(&ours, &twin).unwrap();
        println!("{name}: rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
        assert!(apart.rel_mse <= 1e-4 && apart.mean_bias.abs() <= 1e-3, "{name}: {apart:?}");
        seen += 1;
    }
    assert!(seen >= 8);
}

/// Reservoirs of two iterations are tested with light points of two iterations.
#[test]
fn reuse_has_its_twin() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    for name in ["point_hall:40", "emitter_hall:300", "cornell_env"] {
        let scene = builtin::load(name).unwrap();
        let of = |restir_bias| {
            let light_sampling = Some(LightSampling::Restir);
            let settings =
                Settings { light_sampling, restir_bias, light_pool: Some(6), ..settings(Technique::RASTER, 6) };
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

/// The comparison finds planted differences: depth maps and centre sampling instead of exact lists, another
/// seed, other strategies.
#[test]
fn what_is_no_twin_is_noticed() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let base = settings(Technique::TWIN, 6);
    let twin = raster(gpu, &scene, &base).0;
    let ours = Settings { technique: Technique::RASTER, ..base };
    for other in [
        Settings { technique: Technique::FAST, ..ours.clone() },
        Settings { seed: 2, ..ours.clone() },
        Settings { strategies: Strategies::Vpl, ..ours },
    ] {
        let apart = compare(&raster(gpu, &scene, &other).0, &twin).unwrap();
        println!("rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
        assert!(apart.rel_mse > 1e-4, "{apart:?}");
    }
}

/// Triangles are a sixth of a pixel wide: far neighbours must neither hide a point on their common border nor
/// leave a gap.
#[test]
fn small_triangles_far_away_hide_nothing() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("integrating_sphere").unwrap();
    let base = Settings { width: 16, height: 16, bounces: 0, ..settings(Technique::RASTER, 64) };
    let [ours, twin] = both(gpu, &scene, &base);
    let apart = compare(&ours, &twin).unwrap();
    println!("rel_mse {:.2e}, mean_bias {:+.2e}", apart.rel_mse, apart.mean_bias);
    assert!(apart.mean_bias.abs() <= 1e-5, "{apart:?}");
}

/// A sun through an open roof and a spot have views of other kinds than point lights.
#[test]
fn parallel_and_conical_light_have_twins() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = builtin::load("cornell_env").unwrap();
    let sun = Light::Directional { direction: Vec3::new(0.3, -1.0, -0.2).normalize(), irradiance: Vec3::splat(3.0) };
    scene.lights = vec![sun];
    let [ours, twin] = both(gpu, &scene, &settings(Technique::RASTER, 8));
    let apart = compare(&ours, &twin).unwrap();
    assert!(apart.rel_mse <= 1e-4 && apart.mean_bias.abs() <= 1e-3, "{apart:?}");
}

/// The weighted images of all strategies add up to the picture; without weights, the strategies of one length
/// have one mean.
#[test]
fn strategy_images_add_up_to_the_picture() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    // The last scene has two lights, each with a light point of its own.
    for (name, emits) in [("cornell_point", false), ("cornell_area", true), ("cornell_env", true)] {
        let mut scene = builtin::load(name).unwrap();
        if emits {
            scene.lights.push(Light::Point { position: Vec3::new(0.2, 1.2, 0.1), intensity: Vec3::splat(0.5) });
        }
        for technique in [Technique::RASTER, Technique::TWIN] {
            let base = settings(technique, 8);
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
            // After the last bounce no emitter is hit.
            let met = [(0, 2), (0, 3), (0, 4), (0, 5)].map(|st| shown.contains(&st));
            assert_eq!(met, [emits, emits, emits, false], "{name}: {shown:?}");
            for (sum, pixel) in sum.iter().zip(&whole.pixels) {
                for c in 0..3 {
                    let error = (sum[c] - f64::from(pixel[c])).abs();
                    assert!(error <= 1e-5 * f64::from(pixel[c]) + 1e-9, "{name} {technique}: {sum:?} is not {pixel:?}");
                }
            }
        }
    }
}

/// A lens blurs as in the reference.
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

/// A device with ray queries and one without give the same raster picture, and the twin's error names the
/// missing feature.
#[test]
fn ray_queries_are_asked_for_only_where_they_are_needed() {
    let Some(with) = gpu_with_ray_queries() else { return };
    let Some(without) = common::gpu() else { return };
    assert!(!without.capabilities.ray_queries);
    let mut scene = builtin::load("cornell_point").unwrap();
    scene.cameras.push(pinhole(Vec3::Y, Vec3::NEG_Z, 1.0));
    assert!(matches!(scene.materials[0].bsdf, Bsdf::Diffuse { .. }));
    let base = settings(Technique::RASTER, 2);
    assert_eq!(raster(with, &scene, &base).0.pixels, raster(without, &scene, &base).0.pixels);
    let refused = lightsheaf::render::shared::SharedRenderer::new(without, &scene, &settings(Technique::TWIN, 1)).err();
    assert!(refused.is_some_and(|e| e.to_string().contains("ray queries")));
}
