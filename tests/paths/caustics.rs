//! Caustics of `shared`, whose light paths are splatted: against bidirectional path tracing with rays of each
//! pixel's own, and without them.

use glam::Vec3;
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::render::open;
use lightsheaf::render::renderer::Renderer;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::scene::{Boundary, Geometry, Lens, Light, Scene, SceneStats};
use lightsheaf::settings::{OnlyStrategy, Settings, Technique};

use crate::common::statistics::{Look, compare};
use crate::common::{self, gpu};
use crate::{PICTURES, SIDE, scenes, settings};

fn pictures(gpu: &Gpu, renderer: &mut dyn Renderer, samples: u32) -> Vec<Film> {
    let picture = |seed| {
        renderer.restart(seed);
        let film = common::picture(renderer, u64::from(samples));
        gpu.check().unwrap();
        film
    };
    (1..=PICTURES).map(picture).collect()
}

/// Returns a floor behind a ball of clear glass that absorbs.
fn behind_ball() -> Scene {
    scenes::behind_glass(scenes::glass(0.0, 1.5, Boundary::Volume { absorption: Vec3::splat(0.5) }))
}

/// Returns the same floor behind a ball that disperses light.
fn behind_dispersive_ball() -> Scene {
    let clear = Boundary::Volume { absorption: Vec3::ZERO };
    scenes::behind_glass(scenes::dispersive(scenes::gltf(0.0, 0.0, 1.0, clear)))
}

/// Returns the same with a point light below the lamp, which is out.
fn behind_ball_and_point() -> Scene {
    let mut scene = behind_ball();
    scene.materials.iter_mut().for_each(|material| material.emission = None);
    scene.lights = vec![Light::Point { position: Vec3::new(0.1, 0.85, 0.0), intensity: Vec3::splat(1.0) }];
    scene
}

#[test]
fn shared_finds_the_caustics_of_bdpt() {
    let Some(gpu) = gpu() else { return };
    let mut lens = behind_ball();
    lens.cameras[0].lens = Some(Lens { radius: 0.05, focus: 1.2 });
    let mut absorbing_and_rough = scenes::transmitting();
    absorbing_and_rough.cameras.truncate(1);
    for (name, scene, samples) in [
        ("a lamp through a ball", behind_ball(), [12, 9]),
        ("the same through a lens", lens, [12, 9]),
        ("a lamp through a ball that disperses light", behind_dispersive_ball(), [24, 24]),
        ("a point through a ball", behind_ball_and_point(), [8, 6]),
        ("a spot in a mirror, in a parallel projection", scenes::mirrored_light(), [8, 8]),
        ("glass of all kinds", absorbing_and_rough, [16, 8]),
    ] {
        let of = |technique, samples| {
            let mut renderer = open(gpu, &scene, &settings(technique, 64, 1, 3)).unwrap();
            pictures(gpu, &mut *renderer, samples)
        };
        let shared = of(Technique::RASTER, samples[0]);
        let expected = of(Technique::BDPT, samples[1]);
        let verdict = compare(&shared, &expected, Look::Image);
        println!("{name}: {verdict:?}");
        assert!(verdict.agrees() && verdict.is_sharp(), "{name}: {verdict:?}");
        assert!(compare(&shared, &expected, Look::Blocks).agrees(), "{name}");
    }
}

/// Without light paths a point's light through glass is missing, which the comparison above has to notice; a
/// lamp's is all there, since eye subpaths hit the lamp.
#[test]
fn caustics_of_points_need_light_paths() {
    let Some(gpu) = gpu() else { return };
    let settings = settings(Technique::RASTER, SIDE, 1, 3);
    for (scene, same) in [(behind_ball(), true), (behind_ball_and_point(), false)] {
        let stats = SceneStats { smooth_share: 0.01, ..SceneStats::new(&scene, &Geometry::new(&scene)) };
        let mut with = SharedRenderer::new(gpu, &scene, &settings).unwrap();
        let mut without = SharedRenderer::forced(gpu, &scene, &settings, stats).unwrap();
        assert!(with.plan().caustics && !without.plan().caustics);
        let verdict = compare(&pictures(gpu, &mut with, 16), &pictures(gpu, &mut without, 16), Look::Blocks);
        println!("{same}: {verdict:?}");
        assert_eq!(verdict.agrees(), same, "{verdict:?}");
    }
}

/// The weighted images of all strategies add up to the picture, with those of light paths.
#[test]
fn strategy_images_add_up_with_caustics() {
    let Some(gpu) = gpu() else { return };
    let whole = Settings { specular_bounces: 0, ..settings(Technique::RASTER, SIDE, 8, 2) };
    let mut renderer = SharedRenderer::new(gpu, &behind_ball(), &whole).unwrap();
    let expected = common::picture(&mut renderer, 8);
    let mut sum = vec![[0.0_f32; 3]; expected.pixels.len()];
    let mut thrown = 0.0;
    for only in OnlyStrategy::all(2, true).filter(|only| Technique::RASTER.has_strategy(only.s, only.t)) {
        renderer.set_only(Some(only)).unwrap();
        let film = common::picture(&mut renderer, 8);
        for (sum, pixel) in sum.iter_mut().zip(&film.pixels) {
            (0..3).for_each(|c| sum[c] += pixel[c]);
        }
        thrown += if only.t == 1 { film.pixels.iter().flatten().sum() } else { 0.0 };
    }
    assert!(thrown > 0.0);
    for (sum, pixel) in sum.iter().zip(&expected.pixels) {
        assert!((0..3).all(|c| (sum[c] - pixel[c]).abs() <= 1e-4 * pixel[c].max(0.01)), "{sum:?} is not {pixel:?}");
    }
}

/// The filter spreads single splats over neighbours, and keeps their light.
#[test]
fn splats_are_filtered() {
    let Some(gpu) = gpu() else { return };
    let of = |unfiltered| {
        let sampled = settings(Technique::RASTER, 48, 3, 2);
        let settings = Settings { interleave: Some(3), unfiltered, specular_bounces: 0, ..sampled };
        let mut renderer = SharedRenderer::new(gpu, &behind_ball_and_point(), &settings).unwrap();
        renderer.set_only(Some(OnlyStrategy { s: 4, t: 1, weighted: true })).unwrap();
        common::picture(&mut renderer, 3)
    };
    let [filtered, unfiltered] = [of(false), of(true)];
    let sum = |film: &Film| film.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>();
    let apart = |film: &Film| -> f64 {
        let rows = film.pixels.chunks(film.width as usize);
        rows.flat_map(|row| row.windows(2)).map(|pair| f64::from(pair[0][1] - pair[1][1]).abs()).sum()
    };
    let (kept, rough) = (sum(&filtered) / sum(&unfiltered), apart(&filtered) / apart(&unfiltered));
    println!("light {kept:.3}, differences of neighbours {rough:.3}");
    assert!((kept - 1.0).abs() < 0.05 && rough < 0.6, "{kept} {rough}");
}

/// Splats have one sum in any order.
#[test]
fn the_same_seed_gives_the_same_caustics() {
    let Some(gpu) = gpu() else { return };
    let settings = Settings { seed: 7, ..settings(Technique::RASTER, 40, 4, 3) };
    let film = || common::picture(&mut *open(gpu, &behind_ball(), &settings).unwrap(), 4);
    let first = film();
    assert!((0..3).all(|_| first == film()));
}
