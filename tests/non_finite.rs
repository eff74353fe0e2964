//! The check for values that are not finite names the pass that wrote them, for each pass.

mod common;

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use common::scenes::{add, emitter, floor, parallel, pinhole, room};
use common::{gpu, gpu_with_ray_queries};
use glam::Vec3;
use lightsheaf::gpu::Gpu;
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Light, Material, Scene, builtin};
use lightsheaf::settings::{LightSampling, Settings, Strategies, Technique};

/// Returns the number of values that were not finite, by pass.
fn counts(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Vec<(&'static str, u64)> {
    gpu.non_finite.watch(gpu, true);
    if settings.technique.shares_subpaths() {
        SharedRenderer::new(gpu, scene, settings).unwrap().render(2, &mut |_| true).unwrap();
    } else {
        PathRenderer::new(gpu, scene, settings).unwrap().render(2, &mut |_| true).unwrap();
    }
    let counts = gpu.non_finite.counts(gpu).unwrap();
    gpu.non_finite.watch(gpu, false);
    counts
}

fn settings(technique: Technique) -> Settings {
    Settings { technique, width: 8, height: 8, ..Settings::plain() }
}

fn room_with(light: Option<Light>) -> Scene {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::new(0.2, 0.1, 0.8), Vec3::NEG_Z, 1.0)], ..Scene::default() };
    add(&mut scene, room(), Material::diffuse("room", Vec3::splat(0.5)));
    scene.lights.extend(light);
    scene
}

fn lamp(intensity: f32) -> Light {
    Light::Point { position: Vec3::new(0.1, 0.7, -0.2), intensity: Vec3::new(1.0, intensity, 1.0) }
}

/// Renders that are checked take turns.
static ONE: Mutex<()> = Mutex::new(());

#[test]
fn scenes_that_are_right_have_none() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut passes = BTreeSet::new();
    let mut look = |gpu, name: &str, settings: &Settings| {
        let seen = counts(gpu, &builtin::load(name).unwrap(), settings);
        assert!(!seen.is_empty() && seen.iter().all(|(_, count)| *count == 0), "{name}: {seen:?}");
        passes.extend(seen.into_iter().map(|(pass, _)| pass));
    };
    for name in ["cornell_point", "cornell_glossy", "cornell_env", "point_hall:100"] {
        look(gpu, name, &settings(Technique::RASTER));
        look(rays, name, &settings(Technique::RAY_QUERY));
    }
    look(
        gpu,
        "point_hall:100",
        &Settings { light_sampling: Some(LightSampling::Restir), ..settings(Technique::RASTER) },
    );
    look(rays, "cornell_area", &Settings { light_sampling: Some(LightSampling::Restir), ..settings(Technique::PATH) });
    // These passes write floats.
    let expected = [
        "accumulate",
        "connect_light",
        "connect_y1",
        "connect_y2",
        "extend",
        "eye_paths",
        "eye_vertices",
        "grid_triangles",
        "light_candidates",
        "light_candidates_test",
        "light_importance",
        "light_paths",
        "light_point",
        "light_reservoirs",
        "light_reservoirs_test",
        "light_subpath",
        "reservoirs",
        "resolve",
        "rsm",
        "view_setup",
    ];
    assert_eq!(passes.into_iter().collect::<Vec<_>>(), expected);
}

#[test]
fn nobody_watching_costs_nothing() {
    let Some(gpu) = gpu() else { return };
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let scene = room_with(Some(lamp(1.0)));
    let looks = |watch: bool| {
        gpu.ledger.reset();
        if watch {
            counts(gpu, &scene, &settings(Technique::RASTER));
        } else {
            SharedRenderer::new(gpu, &scene, &settings(Technique::RASTER)).unwrap().render(2, &mut |_| true).unwrap();
            assert!(gpu.non_finite.counts(gpu).unwrap().is_empty());
        }
        let asked = gpu.ledger.counts();
        let buffers = asked.buffers.keys().filter(|label| label.contains("non_finite")).count();
        (asked.pipelines.contains_key("non_finite"), asked.passes.contains_key("non_finite"), buffers > 0)
    };
    assert_eq!(looks(false), (false, false, false));
    assert_eq!(looks(true), (true, true, true));
}

/// A planted value is first reported by the pass that reads it.
#[test]
fn planted_values_are_found_where_they_come_from() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let raster = settings(Technique::RASTER);
    let direct = Settings { bounces: 0, ..raster.clone() };
    let paper = Settings { strategies: Strategies::Paper, ..raster.clone() };
    let ris = Settings { light_sampling: Some(LightSampling::Ris), ..settings(Technique::PATH) };
    let overhead = |mesh, material| {
        let mut scene = Scene { cameras: vec![parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 0.3)], ..Scene::default() };
        add(&mut scene, mesh, material);
        scene
    };
    for value in [f32::NAN, f32::INFINITY] {
        // `then` holds later passes that have to report it too.
        let expect_then = |pass: &str, then: &[&str], scene: &Scene, settings: &Settings| {
            let seen = counts(if settings.technique.needs_ray_queries() { rays } else { gpu }, scene, settings);
            let mut found = seen.iter().filter(|(_, count)| *count > 0).map(|(pass, _)| *pass);
            println!("{pass}, {value}: {seen:?}");
            assert_eq!(found.next(), Some(pass), "{value}: {seen:?}");
            let found: Vec<_> = found.collect();
            assert!(then.iter().all(|pass| found.contains(pass)), "{value}: {seen:?}");
        };
        let expect = |pass: &str, scene: &Scene, settings: &Settings| expect_then(pass, &[], scene, settings);
        let shines = || emitter(0.5, Vec3::new(1.0, value, 1.0), true);
        let lit = room_with(Some(lamp(value)));
        let seen = overhead(floor(1.0, 0.0), shines());
        let mut unseen = room_with(None);
        add(&mut unseen, floor(0.1, 0.9), shines());
        let mut many = room_with(None);
        let places = (0..100_u8).map(|i| (Vec3::new(f32::from(i % 10), f32::from(i / 10), 4.5) - 4.5) * 0.2);
        many.lights = places.map(|p| Light::Point { position: p, intensity: Vec3::new(1.0, value, 1.0) }).collect();
        let many_even = Settings { light_sampling: Some(LightSampling::Power), ..direct.clone() };
        expect_then("light_point", &["light_subpath", "connect_light"], &lit, &raster);
        expect_then("light_point", &["connect_light"], &lit, &direct);
        expect("light_point", &seen, &raster);
        expect("eye_vertices", &seen, &paper);
        expect("extend", &unseen, &paper);
        expect("light_importance", &many, &raster);
        expect_then("light_point", &["light_candidates"], &many, &many_even);
        expect("eye_paths", &lit, &settings(Technique::PATH));
        expect("light_paths", &lit, &settings(Technique::RAY_QUERY));
        // Resampling rejects candidates of infinite weight, so that a later pass reports it.
        expect(if value.is_nan() { "reservoirs" } else { "eye_paths" }, &unseen, &ris);
    }
    // The sum leaves the range of 32 bits, though each iteration's value is within it.
    let bright = overhead(floor(1.0, 0.0), emitter(0.0, Vec3::splat(3e38), true));
    for (pass, settings) in [("accumulate", paper), ("resolve", settings(Technique::PATH))] {
        let seen = counts(if settings.technique.needs_ray_queries() { rays } else { gpu }, &bright, &settings);
        assert_eq!(seen.iter().find(|(_, count)| *count > 0).map(|(pass, _)| *pass), Some(pass), "{seen:?}");
    }
}
