//! `path` and `ray-query` against the reference, in the mean and pixel by pixel, and against themselves.

mod blended;
mod caustics;
#[path = "../common/mod.rs"]
mod common;
mod samplers;
mod scenes;
mod tracers;
mod weights;

use std::path::PathBuf;

use common::gpu_with_ray_queries;
use common::statistics::{Look, compare, compare_pixels, pixels_against};
use glam::{Vec2, Vec3};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::render::open;
use lightsheaf::render::renderer::{RenderStats, Renderer as _};
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Boundary, Light, Material, Scene, builtin};
use lightsheaf::settings::{LightSampling, OnlyStrategy, RestirBias, Settings, Technique};
use lightsheaf::staging::{self, Staging};

const METHODS: [Technique; 2] = [Technique::PATH, Technique::RAY_QUERY];

/// Pictures of a method in a comparison, each with a seed of its own.
const PICTURES: u32 = 8;

/// Pixels along a side of most pictures: three by three blocks.
const SIDE: u32 = 24;

fn settings(technique: Technique, side: u32, samples: u32, bounces: u32) -> Settings {
    Settings { technique, width: side, height: side, samples, bounces, ..Settings::plain() }
}

fn picture(gpu: &Gpu, scene: &Scene, settings: &Settings) -> (Film, RenderStats) {
    let mut renderer = PathRenderer::new(gpu, scene, settings).unwrap();
    renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
    gpu.check().unwrap();
    let (film, stats) = (renderer.film().unwrap(), renderer.stats());
    assert_eq!((stats.samples, stats.non_finite), (u64::from(settings.samples), 0));
    (film, stats)
}

/// Renders pictures of different seeds by one renderer that begins anew for each.
fn pictures(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Vec<Film> {
    let mut renderer = open(gpu, scene, settings).unwrap();
    (1..=PICTURES)
        .map(|seed| {
            renderer.restart(seed);
            renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
            gpu.check().unwrap();
            assert_eq!(renderer.stats().non_finite, 0);
            renderer.film().unwrap()
        })
        .collect()
}

fn references(scene: &Scene, settings: &Settings, samples: u32) -> Vec<Film> {
    let reference = Reference::new(scene);
    (1..=PICTURES)
        .map(|seed| {
            let settings = ReferenceSettings { samples, seed: 1000 + seed, ..ReferenceSettings::of(settings) };
            reference.render(&settings, &|_, _| ()).film
        })
        .collect()
}

/// Compares both techniques with the reference.
fn agrees(name: &str, scene: &Scene, bounces: u32) {
    all_agree(&METHODS, name, scene, 32, bounces);
}

/// Compares techniques with the reference, pixel by pixel and block by block.
fn all_agree(techniques: &[Technique], name: &str, scene: &Scene, samples: u32, bounces: u32) {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let expected = references(scene, &settings(Technique::PATH, SIDE, 1, bounces), 64);
    for &technique in techniques {
        let films = pictures(gpu, scene, &settings(technique, SIDE, samples, bounces));
        let (pixels, blocks) = (compare_pixels(&films, &expected), compare(&films, &expected, Look::Blocks));
        println!("{name}, {technique}: {pixels:?} {blocks:?}");
        assert!(pixels.agrees(), "{name}, {technique}: {pixels:?}");
        assert!(blocks.agrees() && blocks.is_sharp(), "{name}, {technique}: {blocks:?}");
    }
}

/// Compares materials by `bdpt`, whose shaders are those of `path` with light subpaths, and by `shared`, after a bounce less.
fn materials_agree(name: &str, scene: &Scene, bounces: u32) {
    all_agree(&[Technique::RAY_QUERY], name, scene, 16, bounces);
    shared_agrees(name, scene, bounces - 1);
}

/// Compares `shared`, which widens no lobe here, with the reference.
fn shared_agrees(name: &str, scene: &Scene, bounces: u32) {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let settings = settings(Technique::RASTER, SIDE, 64, bounces);
    let films = pictures(gpu, scene, &settings);
    let verdict = compare(&films, &references(scene, &settings, 64), Look::Blocks);
    println!("{name}, shared: {verdict:?}");
    assert!(verdict.agrees() && verdict.is_sharp(), "{name}, shared: {verdict:?}");
}

#[test]
fn cornell_boxes_agree_with_the_reference() {
    for name in ["point", "area", "env"] {
        agrees(name, &scenes::cornell(name), 3);
    }
}

#[test]
fn reflection_agrees_with_the_reference() {
    agrees("reflecting", &scenes::reflecting(), 3);
    agrees("mirrors", &scenes::mirrors(), 3);
}

#[test]
fn layers_agree_with_the_reference() {
    materials_agree("coats", &scenes::coats(), 3);
    materials_agree("sheens", &scenes::sheens(), 3);
    materials_agree("brushed", &scenes::brushed(), 3);
}

#[test]
fn cloth_agrees_with_the_reference() {
    materials_agree("cloths", &scenes::cloths(), 3);
}

#[test]
fn mixes_agree_with_the_reference() {
    materials_agree("mixes", &scenes::mixes(), 3);
}

/// A mix of diffuse materials is the diffuse material of the mean reflectance.
#[test]
fn a_mix_is_the_mean_of_its_parts() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let [dark, bright] = [Vec3::new(0.1, 0.4, 0.2), Vec3::new(0.9, 0.3, 0.7)].map(|color| Material::diffuse("", color));
    let mean = Material::diffuse("", Vec3::new(0.58, 0.34, 0.5));
    let with = |material: &Material| {
        let mut scene = scenes::cornell("area");
        scene.materials[0] = Material { emission: scene.materials[0].emission, ..material.clone() };
        scene
    };
    let (mixed, mean) = (with(&scenes::mixed(0.6, [dark.clone(), bright])), with(&mean));
    let expected = references(&mean, &settings(Technique::PATH, SIDE, 1, 2), 64);
    let verdict = |films: &[Film]| compare(films, &expected, Look::Blocks);
    let of_reference = verdict(&references(&mixed, &settings(Technique::PATH, SIDE, 1, 2), 64));
    assert!(of_reference.agrees(), "reference: {of_reference:?}");
    for technique in METHODS {
        let settings = settings(technique, SIDE, 32, 2);
        let verdict_of = |scene| verdict(&pictures(gpu, scene, &settings));
        let agreement = verdict_of(&mixed);
        assert!(agreement.agrees(), "{technique}: {agreement:?}");
        let off = verdict_of(&with(&dark));
        assert!(!off.agrees(), "a canary passes: {off:?}");
    }
    shared_agrees("mixed walls", &mixed, 2);
}

#[test]
fn beckmann_facets_agree_with_the_reference() {
    materials_agree("Beckmann facets", &scenes::beckmann_facets(), 3);
}

#[test]
fn films_agree_with_the_reference() {
    materials_agree("films", &scenes::films(), 3);
}

#[test]
fn diffuse_transmission_agrees_with_the_reference() {
    materials_agree("leaves", &scenes::leaves(), 3);
}

#[test]
fn transmission_agrees_with_the_reference() {
    agrees("transmitting", &scenes::transmitting(), 5);
}

/// Vertices on glass and mirrors count as no bounces, up to a number: a shell of glass shows the sky with few of them, and is
/// dark without.
#[test]
fn glass_takes_no_bounces() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::shells();
    for technique in [Technique::PATH, Technique::RAY_QUERY, Technique::RASTER] {
        let mean = |bounces, specular_bounces| {
            let settings = Settings { specular_bounces, ..settings(technique, SIDE, 64, bounces) };
            let film = common::picture(&mut *open(gpu, &scene, &settings).unwrap(), 64);
            film.pixels.iter().map(|p| f64::from(p[0])).sum::<f64>() / film.pixels.len() as f64
        };
        let (dark, bright) = (mean(1, 0), mean(1, 24));
        println!("{technique}: {dark} {bright}");
        assert!((bright - 1.0).abs() < 0.01 && dark < 0.5, "{technique}: {dark} {bright}");
    }
}

/// Chains of glass and mirrors before, between and after other surfaces end where those of the reference do.
#[test]
fn chains_of_glass_agree_with_the_reference() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::chains();
    for (bounces, specular_bounces) in [(1, 8), (0, 3)] {
        let of = |technique, samples| Settings { specular_bounces, ..settings(technique, SIDE, samples, bounces) };
        let expected = references(&scene, &of(Technique::PATH, 1), 128);
        for technique in [Technique::PATH, Technique::RAY_QUERY, Technique::RASTER] {
            let films = pictures(gpu, &scene, &of(technique, 32));
            let verdict = compare(&films, &expected, Look::Blocks);
            println!("{bounces} and {specular_bounces}, {technique}: {verdict:?}");
            assert!(verdict.agrees(), "{bounces} and {specular_bounces}, {technique}: {verdict:?}");
        }
        // Without them it is another picture.
        let none = Settings { specular_bounces: 0, ..of(Technique::PATH, 32) };
        let verdict = compare(&pictures(gpu, &scene, &none), &expected, Look::Blocks);
        assert!(!verdict.agrees(), "{verdict:?}");
    }
}

/// Shading normals that face away from the camera are bent by all strategies alike, light tracing among them. Without its shading
/// normals the scene is another one.
#[test]
fn silhouettes_of_coarse_meshes_agree_with_the_reference() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::coarse();
    let of = |technique| settings(technique, SIDE, 32, 1);
    let expected = references(&scene, &of(Technique::PATH), 64);
    for technique in [Technique::PATH, Technique::RAY_QUERY, Technique::RASTER] {
        let verdict = compare(&pictures(gpu, &scene, &of(technique)), &expected, Look::Blocks);
        println!("{technique}: {verdict:?}");
        assert!(verdict.agrees(), "{technique}: {verdict:?}");
    }
    let mut flat = scene;
    flat.meshes.iter_mut().for_each(|mesh| mesh.normals.clear());
    let verdict = compare(&pictures(gpu, &flat, &of(Technique::PATH)), &expected, Look::Blocks);
    assert!(!verdict.agrees(), "{verdict:?}");
}

/// Light passes clear sheets straight on, of a tint the share that is in every colour; the rest is sampled, which `path`
/// cannot for a sun. One that is as good as off leaves the shaders as they are.
#[test]
fn clear_sheets_agree_with_the_reference() {
    for (name, scene) in [
        ("a pane and a sun", scenes::below_a_pane(3.0, Vec3::splat(0.8))),
        ("a tinted pane", scenes::below_a_pane(1e-6, Vec3::new(0.9, 0.7, 0.5))),
    ] {
        agrees(name, &scene, 3);
        shared_agrees(name, &scene, 3);
    }
}

#[test]
fn dispersion_agrees_with_the_reference() {
    materials_agree("dispersing", &scenes::dispersing(), 4);
}

/// Reservoirs of the last sample had other channels. As a canary, a lamp that is a tenth brighter is noticed.
#[test]
fn reservoirs_know_their_channels() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::dispersing();
    let settings = Settings { light_sampling: Some(LightSampling::Restir), ..settings(Technique::PATH, SIDE, 32, 2) };
    let expected = references(&scene, &settings, 64);
    let verdict = |scene: &Scene| compare(&pictures(gpu, scene, &settings), &expected, Look::Blocks);
    let mut brighter = scene.clone();
    brighter.materials.iter_mut().filter_map(|m| m.emission.as_mut()).for_each(|e| e.radiance.factor *= 1.1);
    let (right, wrong) = (verdict(&scene), verdict(&brighter));
    println!("reservoirs: {right:?}, a brighter lamp: {wrong:?}");
    assert!(right.agrees() && !wrong.agrees(), "{right:?} {wrong:?}");
}

/// A ray that arrives at 45 degrees at a slab of thickness 1 rises by tan(asin(sin(45 degrees) / n_c)) inside it. A strip
/// shows where one channel arrives, and nothing of the other two. Both sides transmit 1 - F of it, with Schlick's F,
/// times the base colour.
#[test]
fn a_strip_behind_a_dispersive_slab_shows_one_channel() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let sin = 0.5_f32.sqrt();
    let head_on = (0.45_f32 / 2.45).powi(2);
    let passed = 1.0 - (head_on + (1.0 - head_on) * (1.0 - sin).powi(5));
    for channel in 0..3 {
        let scene = scenes::strip_behind_slab(|iors| {
            let sin = sin / iors[channel];
            sin / (1.0 - sin * sin).sqrt()
        });
        let expected = f64::from((passed * [0.9, 0.7, 0.5][channel]).powi(2));
        for technique in [Technique::PATH, Technique::RAY_QUERY, Technique::RASTER] {
            let settings = settings(technique, 8, 96, 2);
            let film = common::picture(&mut *open(gpu, &scene, &settings).unwrap(), 96);
            let mean = |c: usize| film.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / film.pixels.len() as f64;
            println!("{technique}: {:?}, {expected} in channel {channel}", [mean(0), mean(1), mean(2)]);
            assert!((mean(channel) / expected - 1.0).abs() < 0.04, "{technique}: {} is not {expected}", mean(channel));
            (0..3).filter(|&c| c != channel).for_each(|c| assert_eq!(mean(c), 0.0, "{technique}, channel {c}"));
        }
    }
}

#[test]
fn textures_masks_and_parallel_rays_agree_with_the_reference() {
    agrees("textured", &scenes::textured(), 2);
}

/// Compares halls of many lights with every kind of light sampling. `ray-query` has the tree and uniform
/// choice.
fn halls_agree(lights: u32, side: u32, samples: u32) {
    use LightSampling::{Power, Restir, Ris, Tree, Uniform};
    let Some(gpu) = gpu_with_ray_queries() else { return };
    for hall in ["emitter_hall", "point_hall"] {
        let name = format!("{hall}:{lights}");
        let scene = builtin::load(&name).unwrap();
        let expected = references(&scene, &settings(Technique::PATH, side, 1, 1), 16 * samples);
        let both = [Tree, Uniform].map(|choice| (Technique::RAY_QUERY, choice));
        let alone = [Tree, Power, Uniform, Ris, Restir].map(|choice| (Technique::PATH, choice));
        for (technique, choice) in both.into_iter().chain(alone) {
            // Pictures are independent, though the samples of one with reuse are not.
            let settings = Settings { light_sampling: Some(choice), ..settings(technique, side, samples, 1) };
            let films = pictures(gpu, &scene, &settings);
            let (pixels, blocks) = (compare_pixels(&films, &expected), compare(&films, &expected, Look::Blocks));
            println!("{name}, {technique}, {choice}: {pixels:?} {blocks:?}");
            // By power or uniformly, the lights that dominate a pixel are chosen too rarely for a spread per
            // pixel.
            assert!(pixels.agrees() || !choice.has_tree(), "{name}, {technique}, {choice}: {pixels:?}");
            assert!(blocks.agrees(), "{name}, {technique}, {choice}: {blocks:?}");
        }
    }
}

#[test]
fn halls_of_lights_agree_with_the_reference() {
    halls_agree(300, 16, 32);
}

/// The halls have all their lights here.
#[test]
#[ignore = "long: 10,000 emitters, and as many point lights"]
fn halls_of_many_lights_agree_with_the_reference() {
    halls_agree(10_000, 32, 128);
}

/// Unbiased reuse has the mean of the reference, with and without memory; biased reuse, which counts all
/// queried pixels, has not.
#[test]
fn reuse_is_biased_only_where_asked_to_be() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("emitter_hall:300").unwrap();
    let settings = Settings { light_sampling: Some(LightSampling::Restir), ..settings(Technique::PATH, 24, 64, 0) };
    let expected = references(&scene, &settings, 2048);
    for (restir_bias, restir_memory, wanted) in
        [(RestirBias::Unbiased, 0.0, true), (RestirBias::Unbiased, 8.0, true), (RestirBias::Biased, 8.0, false)]
    {
        let films = pictures(gpu, &scene, &Settings { restir_bias, restir_memory, ..settings.clone() });
        let verdict = compare(&films, &expected, Look::Blocks);
        println!("{restir_bias}, {restir_memory}: {verdict:?}");
        assert_eq!(verdict.agrees(), wanted, "{restir_bias}, {restir_memory}: {verdict:?}");
    }
}

#[test]
fn a_lens_agrees_with_the_reference() {
    agrees("lens", &scenes::lens(), 2);
}

#[test]
fn lamps_suns_patterns_and_textured_emitters_agree_with_the_reference() {
    agrees("lamps", &scenes::lamps(), 2);
}

/// A light that is 0.75 % too bright is found in the mean, and a missing one in the pixels.
#[test]
fn planted_errors_are_caught() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = builtin::load("integrating_sphere").unwrap();
    let mut brighter = scene.clone();
    for light in &mut brighter.lights {
        let Light::Point { intensity, .. } = light else { unreachable!() };
        *intensity *= 1.0075;
    }
    for technique in METHODS {
        let settings = settings(technique, 16, 64, 2);
        let expected = references(&scene, &settings, 256);
        let verdict = |scene: &Scene| compare(&pictures(gpu, scene, &settings), &expected, Look::Blocks);
        assert!(verdict(&scene).agrees(), "{technique}: {:?}", verdict(&scene));
        assert!(!verdict(&brighter).agrees(), "{technique}: {:?}", verdict(&brighter));
    }
    let settings = settings(Technique::RAY_QUERY, 32, 32, 2);
    let reflecting = scenes::reflecting();
    let mut dark = reflecting.clone();
    dark.lights.pop();
    let verdict = compare_pixels(&pictures(gpu, &dark, &settings), &references(&reflecting, &settings, 64));
    assert!(!verdict.agrees(), "{verdict:?}");
}

/// Scenes with a known answer are within half a percent in the mean.
#[test]
fn analytic_scenes() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut checked = 0;
    for (name, bounces) in [
        ("furnace", 0),
        ("furnace", 3),
        ("furnace_sphere", 2),
        ("integrating_sphere", 0),
        ("integrating_sphere", 2),
        ("white_furnace", 1),
        ("glossy_furnace", 1),
        ("occluder", 0),
        ("shading_normals", 0),
        ("single_triangle", 0),
    ] {
        let scene = builtin::load(name).unwrap();
        for technique in METHODS {
            let (film, _) = picture(gpu, &scene, &settings(technique, 32, 128, bounces));
            let at = |i: usize| (Vec2::new((i % 32) as f32, (i / 32) as f32) + 0.5) / 32.0;
            let expected: f64 =
                (0..film.pixels.len()).filter_map(|i| builtin::answer(name, Some(bounces), at(i))).sum();
            let actual: f64 = film.pixels.iter().map(|p| f64::from(p[0])).sum();
            println!("{name}, {bounces} bounces, {technique}: {actual} {expected}");
            assert!(
                (actual / expected - 1.0).abs() < 0.005,
                "{name}, {bounces}, {technique}: {actual} is not {expected}"
            );
            checked += 1;
        }
    }
    assert_eq!(checked, 20);
}

/// The weighted images of all strategies add up to the picture, and each strategy contributes. A strategy
/// that is alone without its weight has the picture's mean.
#[test]
fn strategy_images_add_up_to_the_picture() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    for (name, scene) in [("reflecting", scenes::reflecting()), ("transmitting", scenes::transmitting())] {
        let bounces = 2;
        let full = Settings { specular_bounces: 0, ..settings(Technique::RAY_QUERY, 24, 16, bounces) };
        let (whole, _) = picture(gpu, &scene, &full);
        let mut renderer = PathRenderer::new(gpu, &scene, &full).unwrap();
        let mut sum = vec![[0.0_f64; 3]; whole.pixels.len()];
        let all: Vec<_> = OnlyStrategy::all(bounces, true).collect();
        assert_eq!(all.len(), 2 + 3 + 4 + 5);
        for only in all {
            renderer.set_only(Some(only)).unwrap();
            renderer.render(16, &mut |_| true).unwrap();
            let film = renderer.film().unwrap();
            let total: f64 = film.pixels.iter().flatten().map(|&v| f64::from(v)).sum();
            println!("{name}: {} {total}", only.name());
            assert!(total > 0.0 || only.s + only.t == 2, "{name}: {} is black", only.name());
            for (sum, pixel) in sum.iter_mut().zip(&film.pixels) {
                (0..3).for_each(|c| sum[c] += f64::from(pixel[c]));
            }
        }
        renderer.set_only(None).unwrap();
        renderer.render(16, &mut |_| true).unwrap();
        assert!(renderer.film().unwrap() == whole, "{name}: beginning anew changes the picture");
        for (sum, pixel) in sum.iter().zip(&whole.pixels) {
            for c in 0..3 {
                let expected = f64::from(pixel[c]);
                assert!((sum[c] - expected).abs() <= 1e-5 * expected.max(0.01), "{name}: {sum:?} is not {pixel:?}");
            }
        }
    }
}

/// Strategies without their weights have the same mean if each of them finds all light.
#[test]
fn unweighted_strategies_have_the_same_mean() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::cornell("area");
    let only = |s, t| Some(OnlyStrategy { s, t, weighted: false });
    let films = |s, t, samples| {
        let settings = Settings { only: only(s, t), ..settings(Technique::RAY_QUERY, 32, samples, 1) };
        pictures(gpu, &scene, &settings)
    };
    // Next-event estimation has the least noise with one bounce.
    let expected = films(1, 3, 16);
    for (s, t, samples) in [(0, 4, 64), (2, 2, 32), (3, 1, 32)] {
        let verdict = compare(&films(s, t, samples), &expected, Look::Image);
        println!("({s}, {t}): {verdict:?}");
        assert!(verdict.agrees(), "({s}, {t}): {verdict:?}");
    }
}

/// Light through glass onto a floor is the same when found from the camera alone and by light subpaths alone,
/// whose throughput is the adjoint's.
#[test]
fn light_through_glass_is_the_same_from_both_ends() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let clear = Boundary::Volume { absorption: Vec3::ZERO };
    for (name, material) in [
        ("smooth", scenes::glass(0.0, 1.5, Boundary::Volume { absorption: Vec3::splat(0.5) })),
        ("rough", scenes::glass(0.3, 1.3, clear)),
        ("glTF", scenes::gltf(0.4, 0.0, 0.8, clear)),
    ] {
        let scene = scenes::behind_glass(material);
        let films = |s, t, samples| {
            let only = Some(OnlyStrategy { s, t, weighted: false });
            pictures(gpu, &scene, &Settings { only, ..settings(Technique::RAY_QUERY, 32, samples, 2) })
        };
        let verdict = compare(&films(0, 5, 48), &films(4, 1, 32), Look::Image);
        println!("{name}: {verdict:?}");
        assert!(verdict.agrees() && verdict.error < 0.03, "{name}: {verdict:?}");
    }
}

/// A point light's mirror image lights a wall with albedo / pi I cos / d^2, d being the length by way of the
/// mirror. No path from the camera finds it.
#[test]
fn a_mirror_throws_the_light_of_a_point() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::mirrored_light();
    let only = |s, t| Some(OnlyStrategy { s, t, weighted: true });
    let mean = |only, technique| {
        let settings = Settings { only, ..settings(technique, 64, 256, 1) };
        let film = common::picture(&mut *open(gpu, &scene, &settings).unwrap(), 256);
        film.pixels.iter().map(|p| f64::from(p[0])).sum::<f64>() / film.pixels.len() as f64
    };
    let n = 64;
    let expected = (0..n * n).map(|i| {
        let at = |i: i32| 0.4 * ((f64::from(i) + 0.5) / f64::from(n) - 0.5);
        let d = glam::DVec3::new(at(i % n) - 0.3, 0.6 + at(i / n) + 1.0, -1.0);
        0.9 * 0.5 / std::f64::consts::PI * 2.0 / d.length_squared() / d.length()
    });
    let expected = expected.sum::<f64>() / f64::from(n * n);
    let (thrown, without) = (mean(only(3, 1), Technique::RAY_QUERY), mean(only(2, 2), Technique::RAY_QUERY));
    println!("{thrown} {expected} {without}");
    assert!((thrown / expected - 1.0).abs() < 0.005, "{thrown} is not {expected}");
    assert_eq!(without, 0.0);
    let direct = mean(None, Technique::PATH);
    for technique in [Technique::RAY_QUERY, Technique::RASTER] {
        let whole = mean(None, technique) - direct;
        assert!((whole / expected - 1.0).abs() < 0.005, "{technique}: {whole} is not {expected}");
    }
}

/// The same seed gives the same bytes, splats included, for any grouping of pixels; another seed does not.
#[test]
fn the_same_seed_gives_the_same_bytes() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    for technique in METHODS {
        let settings = settings(technique, 40, 4, 3);
        let film = |seed| picture(gpu, &scenes::transmitting(), &Settings { seed, ..settings.clone() }).0;
        let first = film(1);
        for _ in 0..3 {
            assert!(first == film(1), "{technique}");
        }
        assert!(first != film(2), "{technique}");
    }
}

/// A picture without any light, or without anything at all, is black.
#[test]
fn the_dark_is_black() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut dark = scenes::cornell("point");
    dark.lights.clear();
    let empty = Scene { cameras: dark.cameras.clone(), ..Scene::default() };
    for technique in METHODS {
        for scene in [&dark, &empty] {
            let (film, _) = picture(gpu, scene, &settings(technique, 16, 2, 2));
            assert!(film.pixels.iter().flatten().all(|&v| v == 0.0), "{technique}");
        }
    }
}

/// More lights than can be bound give an error that says so.
#[test]
fn too_many_lights_are_an_error() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = scenes::cornell("point");
    let limit = gpu.capabilities.max_storage_bytes;
    let most = limit / size_of::<lightsheaf::render::layouts::LightRecord>() as u64;
    if most > 4_000_000 {
        println!("skipped: {most} lights fit");
        return;
    }
    scene.lights = vec![scene.lights[0]; most as usize + 1];
    let error = PathRenderer::new(gpu, &scene, &settings(Technique::PATH, 16, 1, 1)).err().unwrap().to_string();
    assert!(error.contains(&format!("{} lights", most + 1)) && error.contains("limit"), "{error}");
}

/// Values that are not finite appear in the film and are counted.
#[test]
fn a_planted_nan_is_counted() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = scenes::cornell("point");
    for light in &mut scene.lights {
        let Light::Point { intensity, .. } = light else { unreachable!() };
        intensity.x = f32::NAN;
    }
    for technique in METHODS {
        let mut renderer = PathRenderer::new(gpu, &scene, &settings(technique, 16, 2, 1)).unwrap();
        renderer.render(2, &mut |_| true).unwrap();
        assert!(renderer.stats().non_finite > 100, "{technique}: {}", renderer.stats().non_finite);
        assert!(renderer.film().unwrap().non_finite() > 50, "{technique}");
    }
}

/// Returns Mitsuba's picture of a scene with two bounces, in blocks of 4 x 4 pixels, with the variance that
/// its own remaining error gives.
fn mitsuba(name: &str) -> Option<Vec<(f64, f64)>> {
    let path = common::references()?.join(format!("{name}_d4"));
    let film = Film::load(path.with_extension("exr")).unwrap();
    let json = std::fs::read_to_string(path.with_extension("json")).unwrap();
    let own = serde_json::from_str::<serde_json::Value>(&json).unwrap()["ref_own_relMSE_est"].as_f64().unwrap();
    let side = film.width as usize / 4;
    let block = |i: usize| {
        let pixels = (0..16).map(|k| film.pixels[(i / side * 4 + k / 4) * film.width as usize + i % side * 4 + k % 4]);
        let mean = pixels.flatten().map(f64::from).sum::<f64>() / 16.0;
        // rel_mse divides by the square of a channel and 0.01; the three channels of a path vary together.
        (mean, 9.0 * own * (mean * mean / 9.0 + 0.01) / 16.0)
    };
    Some((0..side * side).map(block).collect())
}

/// Compares every reference scene, Sun's three, Mitsuba's spheres and a room of rough glass at 128 x 128, pixel by
/// pixel, with `SAMPLES` a picture (32) and four times as many of the reference, and also with Mitsuba's pictures if
/// they are there: paths from the camera hardly ever find the bright spot of corner_spikes, so that the reference's
/// pictures of it are dark, and their spread too small. `SCENE` chooses one.
///
///     cargo test --test paths -- --ignored --nocapture matrix
#[test]
#[ignore = "an hour: the long table"]
fn matrix() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    println!(
        "| scene | method | pixels that pass | worst pixel: difference, standard error | mean | pixels that pass against \
         Mitsuba |\n|---|---|---|---|---|---|"
    );
    let load = |path: PathBuf| staging::load(&path.display().to_string(), &Staging::default()).unwrap();
    let sun = ["spheres", "mirrors", "water"].map(|n| (format!("cornell_{n}"), scenes::cornell(n), 6));
    let shared = common::references().map_or(Vec::new(), |folder| {
        ["cornell_point", "cornell_area", "cornell_glossy", "cornell_env", "corner_spikes"]
            .map(|n| (n.to_owned(), load(folder.join(n).with_extension("xml")), 2))
            .to_vec()
    });
    let spheres = common::shared()
        .map(|folder| ("cbox-spheres".to_owned(), load(folder.join("scenes/mitsuba/cbox-spheres/scene.xml")), 6));
    let rough_glass = ("rough glass".to_owned(), scenes::transmitting(), 5);
    let samples = std::env::var("SAMPLES").ok().and_then(|s| s.parse().ok()).unwrap_or(32);
    let mut failed = Vec::new();
    let mut rows = 0;
    for (name, scene, bounces) in shared.into_iter().chain(sun).chain(spheres).chain([rough_glass]) {
        if std::env::var("SCENE").is_ok_and(|wanted| wanted != name) {
            continue;
        }
        let expected = references(&scene, &settings(Technique::PATH, 128, 1, bounces), 4 * samples);
        let mitsuba = if bounces == 2 { mitsuba(&name) } else { None };
        for technique in [METHODS[0], METHODS[1], Technique::RASTER] {
            let films = pictures(gpu, &scene, &settings(technique, 128, samples, bounces));
            let (pixels, image) = (compare_pixels(&films, &expected), compare(&films, &expected, Look::Image));
            let beside = mitsuba.as_ref().map(|m| pixels_against(&films, m));
            let (_, difference, error) = pixels.worst;
            println!(
                "| {name} | {technique} | {:.3} % | {:+.1} %, {:.1} % | {:+.3} % +- {:.3} % | {} |",
                100.0 * pixels.share,
                100.0 * difference,
                100.0 * error,
                100.0 * image.image[0],
                100.0 * image.image[1],
                beside.as_ref().map_or(String::new(), |b| format!("{:.3} %", 100.0 * b.share)),
            );
            rows += 1;
            if !pixels.agrees() && !beside.is_some_and(|b| b.agrees()) {
                failed.push(format!("{name}, {technique}"));
            }
        }
    }
    assert!(rows >= 2 && failed.is_empty(), "{failed:?}");
}
