//! Tiles that have settled keep their pictures, and no other pixel notices.

mod common;

use common::{gpu, gpu_with_ray_queries, picture};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::renderer::{Progressive, Renderer};
use lightsheaf::scene::{Scene, builtin};
use lightsheaf::settings::{LightSampling, Method, Settings};
use lightsheaf::tiles::{TILE, grid};

/// Some whole tiles, and parts of them.
const WIDTH: u32 = 41;
const HEIGHT: u32 = 35;

/// Samples of a half.
const HALF: u64 = 5;

fn base(method: Method) -> Settings {
    Settings { method, width: WIDTH, height: HEIGHT, target_error: Some(0.01), ..Settings::plain() }
}

fn renderer<'gpu>(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Box<dyn Progressive + 'gpu> {
    if settings.method.shares_subpaths() {
        Box::new(Renderer::new(gpu, scene, settings).unwrap())
    } else {
        Box::new(PathRenderer::new(gpu, scene, settings).unwrap())
    }
}

/// Every other tile.
fn every_other() -> Vec<bool> {
    let [columns, rows] = grid(WIDTH, HEIGHT);
    assert_eq!([columns, rows], [3, 3]);
    (0..columns * rows).map(|tile| tile % 2 == 0).collect()
}

/// Pixels of tiles that have settled from one film, all others from another.
fn joined(settled: &[bool], of_settled: &Film, of_others: &Film) -> Film {
    let across = grid(WIDTH, HEIGHT)[0];
    let pixels = (0..WIDTH * HEIGHT).map(|at| {
        let tile = at / WIDTH / TILE * across + at % WIDTH / TILE;
        let film = if settled[tile as usize] { of_settled } else { of_others };
        film.pixels[at as usize]
    });
    Film { pixels: pixels.collect(), ..*of_others }
}

/// What is rendered so: scene, settings.
fn cases() -> Vec<(&'static str, Settings)> {
    let chosen = |light_sampling| Settings { light_sampling: Some(light_sampling), ..base(Method::Path) };
    vec![
        ("cornell_glossy", base(Method::Raster)),
        // Bands that begin and end within tiles.
        ("cornell_area", Settings { band_pixels: Some(7 * WIDTH), ..base(Method::Raster) }),
        // Direct light from a pool.
        ("point_hall:40", base(Method::Raster)),
        ("cornell_env", base(Method::Twin)),
        ("cornell_glossy", base(Method::RayQuery)),
        ("cornell_area", base(Method::Path)),
        ("point_hall:40", chosen(LightSampling::Ris)),
    ]
}

#[test]
fn settled_tiles_keep_their_picture_and_the_others_go_on() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let settled = every_other();
    for (name, settings) in cases() {
        let gpu = if settings.method.traces_rays() { rays } else { gpu };
        let scene = builtin::load(name).unwrap();
        let even = Settings { target_error: None, ..settings.clone() };
        let mut plain = renderer(gpu, &scene, &even);
        let [half, whole] = [(); 2].map(|()| picture(&mut *plain, HALF));

        let mut renderer = renderer(gpu, &scene, &settings);
        let what = format!("{name}, {}", settings.method);
        assert!(picture(&mut *renderer, HALF) == half, "{what}: nothing has settled yet");
        renderer.settle(&settled).unwrap();
        let picture_of_both = picture(&mut *renderer, HALF);
        assert!(picture_of_both == joined(&settled, &half, &whole), "{what}");
        // The comparison can tell: both halves differ in tiles of either kind.
        let others: Vec<_> = settled.iter().map(|settled| !settled).collect();
        assert!(picture_of_both != whole && picture_of_both != half, "{what}");
        assert!(picture_of_both != joined(&others, &half, &whole), "{what}");

        // Awake again, they have missed what came between.
        renderer.settle(&vec![false; settled.len()]).unwrap();
        let later = picture(&mut *renderer, HALF);
        assert!(later != picture_of_both, "{what}");
        let again = compare(&later, &picture(&mut *plain, HALF)).unwrap();
        assert!(again.mean_bias.abs() < 0.1 && again.rel_mse > 0.0, "{what}: {again:?}");
        // A new picture has none that have settled.
        renderer.settle(&settled).unwrap();
        renderer.restart(even.seed);
        assert!(picture(&mut *renderer, HALF) == half, "{what}");
    }
}

/// Reservoirs of settled tiles are no longer asked, so that pictures beside them differ, but by noise alone.
#[test]
fn pixels_that_settled_lend_nothing() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("point_hall:40").unwrap();
    let settings = Settings { light_sampling: Some(LightSampling::Restir), bounces: 0, ..base(Method::Path) };
    let settled = every_other();
    let mut renderer = renderer(gpu, &scene, &settings);
    let half = picture(&mut *renderer, HALF);
    renderer.settle(&settled).unwrap();
    let joint = picture(&mut *renderer, 600);
    assert!(joint == joined(&settled, &half, &joint), "settled tiles keep their picture");
    renderer.restart(settings.seed);
    let all = picture(&mut *renderer, 600 + HALF);
    let others = joined(&settled, &all, &joint);
    let found = compare(&others, &all).unwrap();
    println!("{found:?}");
    assert!(found.rel_mse > 0.0 && found.rel_mse < 0.02 && found.mean_bias.abs() < 0.01, "{found:?}");
}

/// What lights would give the view is asked of every pixel, whatever settled in the picture before.
#[test]
fn another_view_begins_with_every_tile() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("point_hall:40").unwrap();
    let mut camera = scene.cameras[0].clone();
    camera.world_from_camera.translation.x += 0.2;
    let mut first = Renderer::new(gpu, &scene, &base(Method::Raster)).unwrap();
    assert!(first.plan().lights_for_view);
    picture(&mut first, 2);
    first.settle(&[true; 9]).unwrap();
    first.look(&camera).unwrap();
    let moved = Scene { cameras: vec![camera], ..scene };
    let mut second = Renderer::new(gpu, &moved, &base(Method::Raster)).unwrap();
    assert!(picture(&mut first, 2) == picture(&mut second, 2));
}

#[test]
fn tiles_have_to_be_all_and_asked_for() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let refused = |settings: &Settings, tiles: &[bool]| {
        Renderer::new(gpu, &scene, settings).unwrap().settle(tiles).unwrap_err().to_string()
    };
    let settings = base(Method::Raster);
    assert!(refused(&settings, &[true; 8]).contains("8 tiles of a picture that has 3 x 3"));
    for settings in [Settings { target_error: None, ..settings.clone() }, Settings { history: 4, ..settings }] {
        assert!(refused(&settings, &[true; 9]).contains("--target-error"));
    }
}
