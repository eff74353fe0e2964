//! Denoised frames: right in the mean, nearer to the truth than as many frames unfiltered, and quick to
//! follow changes.

use crate::common;

use common::scenes::{add, emitter, pinhole};
use common::{gpu, gpu_with_ray_queries, raster};
use glam::{Affine2, Affine3A, Vec3};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::{Comparison, compare};
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::scene::model::shapes;
use lightsheaf::scene::{
    Bsdf, Coat, Color, Filter, Fresnel, Image, Light, Material, Scene, Texture, TextureRef, Wrap, builtin,
};
use lightsheaf::settings::{Settings, VisibilityFrom};

fn settings(interleave: u32, history: u32, samples: u32) -> Settings {
    Settings { width: 64, height: 64, interleave: Some(interleave), history, samples, seed: 5, ..Settings::plain() }
}

fn live() -> Settings {
    settings(4, 32, 1)
}

/// Returns a room with a box on its floor and two lights near the ceiling.
fn room(lamps: [f32; 2], boxed: Vec3) -> Scene {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::new(0.0, 0.0, 0.95), Vec3::NEG_Z, 1.3)], ..Scene::default() };
    add(&mut scene, shapes::room(1.0), Material::diffuse("room", Vec3::new(0.7, 0.6, 0.5)));
    add(&mut scene, shapes::cube(), Material::diffuse("box", Vec3::new(0.3, 0.5, 0.7)));
    scene.instances[1].world_from_local =
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.25), glam::Quat::from_rotation_y(0.4), boxed);
    let place = |n: usize| Vec3::new(0.5 * n as f32 - 0.25, 0.8, 0.1);
    scene.lights = (0..2).map(|n| Light::Point { position: place(n), intensity: Vec3::splat(lamps[n]) }).collect();
    scene
}

const BOXED: Vec3 = Vec3::new(0.3, -0.7, -0.3);

fn truth(gpu: &Gpu, scene: &Scene) -> Film {
    raster(gpu, scene, &settings(1, 0, 256)).0
}

fn against(film: &Film, truth: &Film) -> Comparison {
    compare(film, truth).unwrap()
}

fn mean(film: &Film) -> f64 {
    film.pixels.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / (3 * film.pixels.len()) as f64
}

/// Poses a scene and renders more frames.
fn frames(renderer: &mut SharedRenderer, scene: &Scene, count: u64) -> Film {
    renderer.pose(scene).unwrap();
    renderer.render(count, &mut |_| true).unwrap();
    renderer.film().unwrap()
}

/// A frame of one light subpath that is divided into layers and composed is the undivided picture.
#[test]
fn layers_add_up_to_the_picture() {
    let Some(gpu) = gpu() else { return };
    let names = ["cornell_point", "cornell_glossy", "cornell_area", "cornell_env", "corner_spikes", "point_hall:40"];
    for name in names.into_iter().chain(["cornell_mirrors", "cornell_spheres"]) {
        let scene = builtin::load(name).unwrap();
        let plain = Settings { width: 40, height: 30, samples: 1, ..Settings::plain() };
        let whole = raster(gpu, &scene, &plain).0;
        let apart = raster(gpu, &scene, &Settings { history: 1, ..plain }).0;
        let brightest = whole.pixels.iter().flatten().fold(0.0_f32, |a, &b| a.max(b));
        assert!(brightest > 0.0, "{name}");
        for (a, b) in whole.pixels.iter().flatten().zip(apart.pixels.iter().flatten()) {
            assert!((a - b).abs() <= 1e-4 * a.abs() + 1e-6 * brightest, "{name}: {a} is {b} in layers");
        }
    }
}

/// Each pixel of a square has its own random numbers, and all have the same mean.
#[test]
fn interleaved_classes_are_right_in_the_mean() {
    let Some(gpu) = gpu() else { return };
    let scene = room([5.0, 3.0], BOXED);
    // A mean to 0.5 % takes more samples than the errors of a few frames do.
    let truth = raster(gpu, &scene, &settings(1, 0, 512)).0;
    for visibility_from in [VisibilityFrom::Lists, VisibilityFrom::Grid] {
        let film = raster(gpu, &scene, &Settings { unfiltered: true, visibility_from, ..settings(4, 0, 128) }).0;
        let seen = against(&film, &truth);
        assert!(seen.mean_bias.abs() < 0.005 && seen.rel_mse < 0.01, "{visibility_from:?}: {seen:?}");
    }
}

/// Lights that the camera sees have smooth borders after a few frames, and are as bright as after many.
#[test]
fn lights_have_smooth_borders() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene { cameras: vec![pinhole(Vec3::ZERO, Vec3::NEG_Z, 1.3)], ..Scene::default() };
    let lamp = shapes::quad(Vec3::new(-0.3, -0.4, -1.0), Vec3::new(0.8, 0.2, 0.0), Vec3::new(-0.2, 0.8, 0.0));
    add(&mut scene, lamp, emitter(0.0, Vec3::splat(5.0), true));
    let film = |interleave, samples| {
        let settings =
            Settings { bounces: 0, visibility_from: VisibilityFrom::Grid, ..settings(interleave, 0, samples) };
        raster(gpu, &scene, &settings).0
    };
    let truth = film(1, 2048);
    let of = |interleave, samples| against(&film(interleave, samples), &truth);
    let [plain, smooth] = [of(1, 3), of(3, 3)];
    assert!(plain.mse > 1e-3 && smooth.mse < plain.mse / 4.0, "{plain:?} {smooth:?}");
    let many = of(3, 128);
    assert!(many.mse < smooth.mse / 100.0 && many.mean_bias.abs() < 1e-3, "{many:?} {smooth:?}");
}

/// With the same number of frames, filtering reduces the error. A coarser resolution of indirect light costs
/// some of it.
#[test]
fn filtered_frames_are_nearer_to_the_truth() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let truth = truth(gpu, &scene);
    let of = |settings: &Settings| against(&raster(gpu, &scene, settings).0, &truth);
    let plain = of(&settings(1, 0, 8));
    let alone = of(&Settings { unfiltered: true, ..settings(4, 0, 8) });
    let filtered = of(&settings(4, 0, 8));
    let remembered = of(&settings(4, 16, 8));
    let coarse = of(&Settings { upsample: 2, ..settings(4, 16, 8) });
    for (name, seen) in [("filtered", &filtered), ("remembered", &remembered)] {
        assert!(seen.rel_mse < plain.rel_mse / 3.0 && seen.flip < plain.flip / 1.5, "{name} {seen:?}, plain {plain:?}");
        assert!(seen.mean_bias.abs() < 0.02, "{name} {seen:?}");
    }
    // All light but direct light has 32 pixels across.
    assert!(coarse.rel_mse < plain.rel_mse / 2.0 && coarse.mean_bias.abs() < 0.04, "{coarse:?}, plain {plain:?}");
    assert!(alone.rel_mse > 3.0 * filtered.rel_mse, "{alone:?} {filtered:?}");
}

/// Returns a room with an area light and a board of a material across it, before the camera.
fn room_with_a_board(material: Material) -> Scene {
    let mut scene = Scene { lights: Vec::new(), ..room([0.0; 2], Vec3::new(0.3, -0.7, 0.3)) };
    let lamp = shapes::quad(Vec3::new(-0.3, 0.95, 0.0), Vec3::X * 0.6, Vec3::Z * 0.6);
    add(&mut scene, lamp, emitter(0.0, Vec3::splat(5.0), false));
    let board = shapes::quad(Vec3::new(-1.0, -1.0, -0.5), Vec3::X * 2.0, Vec3::Y * 2.0);
    add(&mut scene, board, material);
    scene
}

/// Returns the errors of 8 frames with and without the filter.
fn filtered_and_not(gpu: &Gpu, scene: &Scene, truth: &Film) -> [Comparison; 2] {
    [false, true].map(|unfiltered| against(&raster(gpu, scene, &Settings { unfiltered, ..settings(4, 0, 8) }).0, truth))
}

fn conductor(alpha: f32) -> Material {
    let bsdf = Bsdf::Conductor { fresnel: Fresnel::None, specular: Vec3::splat(0.9).into(), alpha: alpha.into() };
    Material { bsdf, ..Material::diffuse("conductor", Vec3::ZERO) }
}

/// What a mirror shows is filtered as if it were seen directly, and what it shows of lights stays sharp.
#[test]
fn filtered_frames_in_a_mirror_are_nearer_to_the_truth() {
    let Some(gpu) = gpu() else { return };
    let scene = room_with_a_board(conductor(0.0));
    let [filtered, alone] = filtered_and_not(gpu, &scene, &truth(gpu, &scene));
    assert!(alone.rel_mse > 3.0 * filtered.rel_mse && filtered.mean_bias.abs() < 0.02, "{alone:?} {filtered:?}");
}

/// A smooth coat leaves the filter to the rough lobe below it.
#[test]
fn filtered_frames_under_a_smooth_coat_are_nearer_to_the_truth() {
    let Some(gpu) = gpu() else { return };
    let coat = Coat { weight: 1.0.into(), roughness: 0.0.into(), normal_map: None };
    let coated = Material { coat: Some(coat), ..conductor(0.3) };
    let scene = room_with_a_board(coated);
    let [filtered, alone] = filtered_and_not(gpu, &scene, &truth(gpu, &scene));
    assert!(alone.rel_mse > 2.0 * filtered.rel_mse && filtered.mean_bias.abs() < 0.02, "{alone:?} {filtered:?}");
}

/// Lobes that reflect nearly the same to a whole square are filtered, however narrow they are.
#[test]
fn filtered_frames_of_polished_metal_are_nearer_to_the_truth() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room_with_a_board(conductor(0.02));
    // Across a square the view direction turns by 0.019 radians.
    scene.cameras = vec![pinhole(Vec3::new(0.0, 0.0, 0.95), Vec3::NEG_Z, 0.3)];
    let [filtered, alone] = filtered_and_not(gpu, &scene, &truth(gpu, &scene));
    assert!(alone.rel_mse > 4.0 * filtered.rel_mse, "{alone:?} {filtered:?}");
    assert!((filtered.mean_bias - alone.mean_bias).abs() < 0.01, "{alone:?} {filtered:?}");
}

/// What polished metal shows of a light is the same without the filter, which averages what rough metal shows of it.
#[test]
fn lights_in_polished_metal_are_not_filtered() {
    let Some(gpu) = gpu() else { return };
    let changed = |alpha| {
        // No light goes from one to the other and on.
        let forward = Vec3::new(0.0, -0.4, -1.0).normalize();
        let mut scene = Scene { cameras: vec![pinhole(Vec3::ZERO, forward, 0.5)], ..Scene::default() };
        let board = shapes::quad(Vec3::new(-1.0, -0.5, -0.2), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        add(&mut scene, board, conductor(alpha));
        let lamp = shapes::quad(Vec3::new(-0.3, 0.0, -1.5), Vec3::X * 0.6, Vec3::Y * 0.3);
        add(&mut scene, lamp, emitter(0.0, Vec3::splat(5.0), false));
        let film = |unfiltered| raster(gpu, &scene, &Settings { unfiltered, ..settings(4, 0, 8) }).0;
        against(&film(false), &film(true)).rel_mse
    };
    let [polished, rough] = [0.05, 0.3].map(changed);
    assert!(polished < 1e-9 && rough > 1e-3, "{polished} {rough}");
}

/// Black texels tell nothing about the light that reaches them: the filter leaves them out around white ones.
#[test]
fn a_black_pattern_does_not_darken_the_white_around_it() {
    let Some(gpu) = gpu() else { return };
    let mut scene = room_with_a_board(Material::diffuse("board", Vec3::ONE));
    let texels = (0..256).map(|i| if (i + i / 16) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] }).collect();
    scene.images.push(Image { name: "checks".to_owned(), width: 16, height: 16, texels });
    scene.textures.push(Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: false });
    let checks = TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY };
    let board = scene.materials.last_mut().unwrap();
    board.bsdf = Bsdf::Diffuse { reflectance: Color { factor: Vec3::ONE, texture: Some(checks) } };
    let truth = truth(gpu, &scene);
    let [filtered, alone] = filtered_and_not(gpu, &scene, &truth);
    assert!((filtered.mean_bias - alone.mean_bias).abs() < 0.01, "{alone:?} {filtered:?}");
    let remembered = against(&raster(gpu, &scene, &settings(4, 16, 8)).0, &truth);
    assert!((remembered.mean_bias - alone.mean_bias).abs() < 0.02, "{alone:?} {remembered:?}");
    assert!(alone.rel_mse > 2.0 * filtered.rel_mse, "{alone:?} {filtered:?}");
}

/// Returns the number of frames after a light is switched off until 95 % of the change is in the picture and
/// stays there.
fn frames_until_changed(gpu: &Gpu, settings: &Settings) -> u32 {
    let (bright, dim) = (room([5.0, 5.0], BOXED), room([5.0, 0.01], BOXED));
    let [before, after] = [&bright, &dim].map(|scene| mean(&raster(gpu, scene, &self::settings(1, 0, 128)).0));
    let mut renderer = SharedRenderer::new(gpu, &bright, settings).unwrap();
    for _ in 0..32 {
        frames(&mut renderer, &bright, 1);
    }
    let arrived = |film: &Film| (before - mean(film)) / (before - after);
    let late = (1..=24)
        .rev()
        .zip((0..24).map(|_| arrived(&frames(&mut renderer, &dim, 1))).collect::<Vec<_>>().into_iter().rev());
    late.take_while(|(_, arrived)| *arrived >= 0.95).last().map_or(u32::MAX, |(frame, _)| frame)
}

/// A history without gradients is slow, and the test finds that.
#[test]
fn a_lamp_that_goes_out_is_dark_soon() {
    let Some(gpu) = gpu() else { return };
    let noticed = frames_until_changed(gpu, &live());
    assert!(noticed <= 8, "{noticed} frames");
    // Squares of one pixel have no pixel that repeats its random numbers.
    let unnoticed = frames_until_changed(gpu, &settings(1, 32, 1));
    assert!(unnoticed > 8, "{unnoticed} frames");
}

/// Setting the camera gives the picture of a pose in which only the camera has moved.
#[test]
fn looking_elsewhere_goes_on_as_posing_does() {
    // The same holds with acceleration structures.
    for gpu in [gpu(), gpu_with_ray_queries()].into_iter().flatten() {
        looks_as_it_poses(gpu);
    }
}

fn looks_as_it_poses(gpu: &Gpu) {
    let at = |t: f32| {
        let mut scene = room([5.0, 3.0], BOXED);
        scene.cameras[0] = pinhole(Vec3::new(t, 0.0, 0.95), Vec3::NEG_Z, 1.3);
        scene
    };
    let [mut posed, mut looking] = [(); 2].map(|()| SharedRenderer::new(gpu, &at(0.0), &live()).unwrap());
    for frame in 0..4 {
        let scene = at(-0.02 * frame as f32);
        let film = frames(&mut posed, &scene, 1);
        gpu.check().unwrap();
        looking.set_camera(&scene.cameras[0]).unwrap();
        looking.render(1, &mut |_| true).unwrap();
        let seen = against(&looking.film().unwrap(), &film);
        assert!(seen.rel_mse < 1e-6, "frame {frame}: {seen:?}");
    }
}

/// While a box, the camera or a light moves, the history lowers the error and leaves no trail.
#[test]
fn history_follows_what_moves() {
    let Some(gpu) = gpu() else { return };
    let boxed = |t: f32| room([5.0, 3.0], BOXED + Vec3::X * t);
    let camera = |t: f32| {
        let mut scene = room([5.0, 3.0], BOXED);
        scene.cameras[0] = pinhole(Vec3::new(t, 0.0, 0.95), Vec3::NEG_Z, 1.3);
        scene
    };
    let lamp = |t: f32| {
        let mut scene = room([5.0, 3.0], BOXED);
        scene.lights[0] = Light::Point { position: Vec3::new(-0.25 + t, 0.8, 0.1), intensity: Vec3::splat(5.0) };
        scene
    };
    let moves: [(&str, &dyn Fn(f32) -> Scene); 3] = [("box", &boxed), ("camera", &camera), ("lamp", &lamp)];
    for (name, at) in moves {
        let mut renderer = SharedRenderer::new(gpu, &at(0.0), &live()).unwrap();
        let films: Vec<_> = (0..9).map(|frame| frames(&mut renderer, &at(-0.02 * frame as f32), 1)).collect();
        let last = at(-0.16);
        let truth = truth(gpu, &last);
        let followed = against(&films[8], &truth);
        let alone = against(&raster(gpu, &last, &settings(4, 0, 1)).0, &truth);
        assert!(followed.rel_mse < 0.7 * alone.rel_mse, "{name}: {followed:?}, one frame {alone:?}");
        assert!(followed.mean_bias.abs() < 0.03, "{name}: {followed:?}");
    }
}
