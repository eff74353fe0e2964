//! Converged tiles keep their pictures, and other pixels are not affected.

use crate::common;

use common::{gpu, gpu_with_ray_queries, picture};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::render::adaptive_sampling::{TILE, grid};
use lightsheaf::render::renderer::Renderer;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Scene, builtin};
use lightsheaf::settings::{LightSampling, Settings, Technique};

/// The size has some whole tiles, and parts of tiles.
const WIDTH: u32 = 41;
const HEIGHT: u32 = 35;

/// Samples of each half.
const HALF: u64 = 5;

fn base(technique: Technique) -> Settings {
    Settings { technique, width: WIDTH, height: HEIGHT, target_error: Some(0.01), ..Settings::plain() }
}

fn renderer<'gpu>(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Box<dyn Renderer + 'gpu> {
    if settings.technique.shares_subpaths() {
        Box::new(SharedRenderer::new(gpu, scene, settings).unwrap())
    } else {
        Box::new(PathRenderer::new(gpu, scene, settings).unwrap())
    }
}

/// Returns a mask with every other tile converged.
fn every_other() -> Vec<bool> {
    let [columns, rows] = grid(WIDTH, HEIGHT);
    assert_eq!([columns, rows], [3, 3]);
    (0..columns * rows).map(|tile| tile % 2 == 0).collect()
}

/// Returns pixels of converged tiles from one film, and all others from another.
fn joined(converged: &[bool], of_settled: &Film, of_others: &Film) -> Film {
    let across = grid(WIDTH, HEIGHT)[0];
    let pixels = (0..WIDTH * HEIGHT).map(|at| {
        let tile = at / WIDTH / TILE * across + at % WIDTH / TILE;
        let film = if converged[tile as usize] { of_settled } else { of_others };
        film.pixels[at as usize]
    });
    Film { pixels: pixels.collect(), ..*of_others }
}

/// Returns the scenes and settings of the test.
fn cases() -> Vec<(&'static str, Settings)> {
    let chosen = |light_sampling| Settings { light_sampling: Some(light_sampling), ..base(Technique::PATH) };
    vec![
        ("cornell_glossy", base(Technique::RASTER)),
        // These bands begin and end within tiles.
        ("cornell_area", Settings { band_pixels: Some(7 * WIDTH), ..base(Technique::RASTER) }),
        // Direct light has candidates here.
        ("point_hall:40", base(Technique::RASTER)),
        ("cornell_env", base(Technique::TWIN)),
        ("cornell_glossy", base(Technique::RAY_QUERY)),
        ("cornell_area", base(Technique::PATH)),
        ("point_hall:40", chosen(LightSampling::Ris)),
    ]
}

#[test]
fn settled_tiles_keep_their_picture_and_the_others_go_on() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let converged = every_other();
    for (name, settings) in cases() {
        let gpu = if settings.technique.needs_ray_queries() { rays } else { gpu };
        let scene = builtin::load(name).unwrap();
        let even = Settings { target_error: None, ..settings.clone() };
        let mut plain = renderer(gpu, &scene, &even);
        let [half, whole] = [(); 2].map(|()| picture(&mut *plain, HALF));

        let mut renderer = renderer(gpu, &scene, &settings);
        let what = format!("{name}, {}", settings.technique);
        assert!(picture(&mut *renderer, HALF) == half, "{what}: nothing has converged yet");
        renderer.mark_converged(&converged).unwrap();
        let picture_of_both = picture(&mut *renderer, HALF);
        assert!(picture_of_both == joined(&converged, &half, &whole), "{what}");
        // The comparison is sensitive: both halves differ in tiles of either kind.
        let others: Vec<_> = converged.iter().map(|converged| !converged).collect();
        assert!(picture_of_both != whole && picture_of_both != half, "{what}");
        assert!(picture_of_both != joined(&others, &half, &whole), "{what}");

        // Tiles that are no longer converged have missed the samples in between.
        renderer.mark_converged(&vec![false; converged.len()]).unwrap();
        let later = picture(&mut *renderer, HALF);
        assert!(later != picture_of_both, "{what}");
        let again = compare(&later, &picture(&mut *plain, HALF)).unwrap();
        assert!(again.mean_bias.abs() < 0.1 && again.rel_mse > 0.0, "{what}: {again:?}");
        // A new picture has no converged tiles.
        renderer.mark_converged(&converged).unwrap();
        renderer.restart(even.seed);
        assert!(picture(&mut *renderer, HALF) == half, "{what}");
    }
}

/// Reservoirs of converged tiles are not reused, so that pictures beside them differ, but by noise alone.
#[test]
fn pixels_that_settled_lend_nothing() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("point_hall:40").unwrap();
    let settings = Settings { light_sampling: Some(LightSampling::Restir), bounces: 0, ..base(Technique::PATH) };
    let converged = every_other();
    let mut renderer = renderer(gpu, &scene, &settings);
    let half = picture(&mut *renderer, HALF);
    renderer.mark_converged(&converged).unwrap();
    let joint = picture(&mut *renderer, 600);
    assert!(joint == joined(&converged, &half, &joint), "converged tiles keep their picture");
    renderer.restart(settings.seed);
    let all = picture(&mut *renderer, 600 + HALF);
    let others = joined(&converged, &all, &joint);
    let found = compare(&others, &all).unwrap();
    println!("{found:?}");
    assert!(found.rel_mse > 0.0 && found.rel_mse < 0.02 && found.mean_bias.abs() < 0.01, "{found:?}");
}

/// Light importance uses every pixel of a new view, independent of the tiles that had converged before.
#[test]
fn another_view_begins_with_every_tile() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("point_hall:40").unwrap();
    let mut camera = scene.cameras[0].clone();
    camera.world_from_camera.translation.x += 0.2;
    let mut first = SharedRenderer::new(gpu, &scene, &base(Technique::RASTER)).unwrap();
    assert!(first.plan().lights_for_view);
    picture(&mut first, 2);
    first.mark_converged(&[true; 9]).unwrap();
    first.set_camera(&camera).unwrap();
    let moved = Scene { cameras: vec![camera], ..scene };
    let mut second = SharedRenderer::new(gpu, &moved, &base(Technique::RASTER)).unwrap();
    assert!(picture(&mut first, 2) == picture(&mut second, 2));
}

/// With one light candidate among many lights, a new camera kept the light point of the old view, with the
/// probability that its light had there.
#[test]
fn a_camera_change_resamples_the_only_light_candidate() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("point_hall:40").unwrap();
    let settings = Settings { light_pool: Some(1), ..base(Technique::RASTER) };
    let mut camera = scene.cameras[0].clone();
    camera.world_from_camera.translation.x += 3.0;
    let mut first = SharedRenderer::new(gpu, &scene, &settings).unwrap();
    assert!(first.plan().lights_for_view && first.plan().light_candidates == 1, "scope");
    picture(&mut first, 1);
    first.set_camera(&camera).unwrap();
    let moved = Scene { cameras: vec![camera], ..scene };
    let mut second = SharedRenderer::new(gpu, &moved, &settings).unwrap();
    assert!(picture(&mut first, 1) == picture(&mut second, 1));
}

#[test]
fn tiles_have_to_be_all_and_asked_for() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let refused = |settings: &Settings, tiles: &[bool]| {
        SharedRenderer::new(gpu, &scene, settings).unwrap().mark_converged(tiles).unwrap_err().to_string()
    };
    let settings = base(Technique::RASTER);
    assert!(refused(&settings, &[true; 8]).contains("8 tiles of a picture that has 3 x 3"));
    for settings in [Settings { target_error: None, ..settings.clone() }, Settings { history: 4, ..settings }] {
        assert!(refused(&settings, &[true; 9]).contains("--target-error"));
    }
}
