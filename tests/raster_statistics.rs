//! `raster` in the mean against the reference: every strategy set, depth and kind of light.
//!
//! All pixels of an iteration share their random numbers, so a picture is one observation: the spread is taken over
//! pictures of different seeds (12 or more), and means are held against each other by Welch's t-test at a significance of 0.1 %
//! over all values of a comparison. Seeds are fixed. Errors that are planted have to be found by the very same comparison.

mod common;

use std::f32::consts::PI;
use std::sync::OnceLock;

use common::scenes::{add, inverted, pinhole, quad, sphere};
use common::statistics::{Look, Verdict, check_distribution, compare, compare_pixels};
use common::{gpu, gpu_with_ray_queries, raster, reference};
use glam::{Mat3, Vec3};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::renderer::Progressive as _;
use lightsheaf::scene::{Bsdf, Emission, Environment, Fresnel, Light, Material, Scene, SpotFalloff, builtin};
use lightsheaf::settings::{LightSampling, Method, RestirBias, Settings, Strategies};

/// Pictures of `raster` in a comparison.
const SEEDS: u32 = 12;
/// Iterations of each.
const ITERATIONS: u32 = 64;
/// Paths per pixel in each of the reference's eight pictures.
const REFERENCE_SAMPLES: u32 = 128;

/// Small pictures: all pixels share their random numbers, so more of them say little more.
fn settings(bounces: u32) -> Settings {
    Settings { width: 32, height: 32, samples: ITERATIONS, bounces, ..Settings::plain() }
}

/// Pictures by `raster`, one per seed.
fn pictures(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Vec<Film> {
    (1..=SEEDS)
        .map(|seed| {
            let (film, stats) = raster(gpu, scene, &Settings { seed, ..settings.clone() });
            assert_eq!(stats.non_finite, 0);
            film
        })
        .collect()
}

/// Pictures by the reference, quieter than those of [`pictures`] together.
fn references(scene: &Scene, settings: &Settings) -> Vec<Film> {
    (0..8).map(|seed| reference(scene, settings, REFERENCE_SAMPLES, 1000 + seed)).collect()
}

#[track_caller]
fn agree(name: &str, verdict: &Verdict) {
    println!("{name}: {verdict:?}");
    assert!(verdict.agrees(), "{name}: {verdict:?}");
}

#[track_caller]
fn differ(name: &str, verdict: &Verdict) {
    println!("{name}: {verdict:?}");
    assert!(!verdict.agrees(), "{name} was not noticed: {verdict:?}");
}

fn cornell_point() -> Scene {
    builtin::load("cornell_point").unwrap()
}

/// The Cornell box after one bounce by the reference, which several tests look at.
fn cornell_after_one_bounce() -> &'static [Film] {
    static FILMS: OnceLock<Vec<Film>> = OnceLock::new();
    FILMS.get_or_init(|| references(&cornell_point(), &settings(1)))
}

#[test]
fn the_distribution_of_t_is_right() {
    check_distribution();
}

#[test]
fn exact_agrees_with_the_reference_on_the_cornell_box() {
    let Some(gpu) = gpu() else { return };
    for bounces in [0, 1, 2] {
        let settings = Settings { width: 64, height: 64, ..settings(bounces) };
        let films = pictures(gpu, &cornell_point(), &settings);
        let expected = references(&cornell_point(), &settings);
        agree(&format!("{bounces} bounces"), &compare(&films, &expected, Look::Blocks));
    }
}

/// Every error that is planted is found by the comparison that the program itself passes.
#[test]
fn planted_errors_are_caught() {
    let Some(gpu) = gpu() else { return };
    // The light 0.75 % too bright, in direct light.
    let brighter = |mut scene: Scene| {
        for light in &mut scene.lights {
            let Light::Point { intensity, .. } = light else { unreachable!() };
            *intensity *= 1.0075;
        }
        scene
    };
    let direct = settings(0);
    let expected = references(&cornell_point(), &direct);
    // A block's spread is that of a few pixels on edges, too far from a normal distribution for twelve pictures.
    agree("direct light", &compare(&pictures(gpu, &cornell_point(), &direct), &expected, Look::Image));
    differ("light x 1.0075", &compare(&pictures(gpu, &brighter(cornell_point()), &direct), &expected, Look::Image));

    // The same with one bounce, in a sphere, where noise is low.
    let one = settings(1);
    let expected = references(&lamp_in_a_sphere(), &one);
    agree("one bounce", &compare(&pictures(gpu, &lamp_in_a_sphere(), &one), &expected, Look::Blocks));
    let films = pictures(gpu, &brighter(lamp_in_a_sphere()), &one);
    differ("light x 1.0075, one bounce", &compare(&films, &expected, Look::Blocks));

    // One seed again and again: no spread, so that its error stands out.
    let film = raster(gpu, &cornell_point(), &Settings { seed: 1, ..one.clone() }).0;
    let same = vec![film; SEEDS as usize];
    differ("a seed that does not advance", &compare(&same, cornell_after_one_bounce(), Look::Image));

    // One material reflects pi times as much: 1 / pi is missing.
    let mut scene = cornell_point();
    let Bsdf::Diffuse { reflectance } = &mut scene.materials[1].bsdf else { unreachable!() };
    reflectance.factor *= PI;
    let films = pictures(gpu, &scene, &one);
    differ("1 / pi missing on one wall", &compare(&films, cornell_after_one_bounce(), Look::Image));

    // Paths of two bounces are dropped.
    let two = settings(2);
    let expected = references(&plates(), &two);
    let films = pictures(gpu, &plates(), &one);
    differ("no second bounce", &compare(&films, &expected, Look::Image));
}

/// A floor and a ceiling with a square in between and a lamp beside it: every strategy has bounded contributions, since no two
/// surfaces touch, and shadows matter.
fn plates() -> Scene {
    let mut scene =
        Scene { cameras: vec![pinhole(Vec3::new(0.0, 0.9, 2.4), Vec3::new(0.0, -0.2, -1.0), 0.9)], ..Scene::default() };
    let (x, z) = (Vec3::X, Vec3::Z);
    add(&mut scene, quad(-x + z, 2.0 * x, -2.0 * z), Material::diffuse("floor", Vec3::new(0.8, 0.7, 0.6)));
    let ceiling = quad(Vec3::Y * 1.6 - x - z, 2.0 * x, 2.0 * z);
    add(&mut scene, ceiling, Material::diffuse("ceiling", Vec3::new(0.5, 0.7, 0.9)));
    let square = quad(Vec3::new(-0.5, 0.6, 0.3), 0.7 * x, -0.6 * z + 0.2 * Vec3::Y);
    add(&mut scene, square, Material::diffuse("square", Vec3::new(0.9, 0.4, 0.3)));
    scene.lights.push(Light::Point { position: Vec3::new(0.4, 1.1, 0.2), intensity: Vec3::splat(2.0) });
    scene
}

/// A lamp off the middle of a diffuse sphere: between two of its points cos cos / d^2 is constant.
fn lamp_in_a_sphere() -> Scene {
    let camera = pinhole(Vec3::new(0.1, 0.0, 0.4), Vec3::new(0.3, 0.2, -1.0), 1.2);
    let mut scene = Scene { cameras: vec![camera], ..Scene::default() };
    add(&mut scene, inverted(sphere(2)), Material::diffuse("wall", Vec3::new(0.6, 0.5, 0.4)));
    scene.lights.push(Light::Point { position: Vec3::new(0.2, 0.1, 0.0), intensity: Vec3::splat(2.0) });
    scene
}

#[test]
fn strategy_sets_agree_where_nothing_is_singular() {
    let Some(gpu) = gpu() else { return };
    for bounces in [1, 2] {
        let expected = references(&plates(), &settings(bounces));
        for strategies in [Strategies::All, Strategies::Vpl, Strategies::Bundle, Strategies::Paper] {
            if strategies == Strategies::Paper && bounces == 2 {
                // Clamped, so not equal.
                continue;
            }
            let films = pictures(gpu, &plates(), &Settings { strategies, ..settings(bounces) });
            agree(&format!("{strategies}, {bounces} bounces"), &compare(&films, &expected, Look::Blocks));
        }
    }
}

/// With the power heuristic too.
#[test]
fn beta_does_not_change_the_mean() {
    let Some(gpu) = gpu() else { return };
    let two = settings(2);
    let expected = references(&plates(), &two);
    let films = pictures(gpu, &plates(), &Settings { beta: Some(2.0), ..two });
    agree("beta 2", &compare(&films, &expected, Look::Blocks));
}

/// In the box, corners make instant radiosity's spread infinite: bundles alone, and the image's mean only.
#[test]
fn bundles_alone_agree_on_the_cornell_box() {
    let Some(gpu) = gpu() else { return };
    let one = Settings { strategies: Strategies::Bundle, ..settings(1) };
    let films = pictures(gpu, &cornell_point(), &one);
    agree("bundle, 1 bounce", &compare(&films, cornell_after_one_bounce(), Look::Image));
}

#[test]
fn three_and_five_bounces_agree_with_the_reference() {
    let Some(gpu) = gpu() else { return };
    for bounces in [3, 5] {
        let films = pictures(gpu, &cornell_point(), &settings(bounces));
        let expected = references(&cornell_point(), &settings(bounces));
        agree(&format!("{bounces} bounces"), &compare(&films, &expected, Look::Blocks));
    }
}

#[test]
fn every_kind_of_light_agrees_with_the_reference() {
    let Some(gpu) = gpu() else { return };
    let spot = |falloff| Light::Spot {
        position: Vec3::new(0.4, 1.3, 0.2),
        direction: Vec3::new(-0.3, -1.0, 0.1).normalize(),
        intensity: Vec3::new(3.0, 2.0, 1.0),
        inner_angle: 0.3,
        outer_angle: 0.8,
        falloff,
    };
    let sun =
        Light::Directional { direction: Vec3::new(-0.6, -0.7, -0.3).normalize(), irradiance: Vec3::new(1.0, 1.5, 2.0) };
    let point = Light::Point { position: Vec3::new(-0.3, 1.2, 0.5), intensity: Vec3::new(0.5, 0.5, 1.0) };
    let cases = [
        ("spot, linear", vec![spot(SpotFalloff::AngleLinear)]),
        ("spot, squared", vec![spot(SpotFalloff::CosineSquared)]),
        ("directional", vec![sun]),
        ("point and directional", vec![point, sun]),
        ("point and spot", vec![spot(SpotFalloff::AngleLinear), point]),
    ];
    for (name, lights) in cases {
        let scene = Scene { lights, ..plates() };
        let films = pictures(gpu, &scene, &settings(2));
        agree(name, &compare(&films, &references(&scene, &settings(2)), Look::Blocks));
    }
}

/// What eye subpaths can meet: a ceiling that shines, on both sides or one, a sky, constant or with a sun, and both beside a lamp.
#[test]
fn emitters_that_can_be_met_agree_with_the_reference() {
    let Some(gpu) = gpu() else { return };
    let shining = |two_sided, lamp: bool| {
        let mut scene = plates();
        scene.materials[1].emission = Some(Emission { radiance: Vec3::new(2.0, 1.0, 0.5).into(), two_sided });
        if !lamp {
            scene.lights.clear();
        }
        scene
    };
    let sky = |radiance, scene| Scene {
        environment: Some(Environment { radiance, map: None, world_from_environment: Mat3::IDENTITY }),
        ..scene
    };
    let cases = [
        ("shining ceiling", shining(false, false)),
        ("shining ceiling and lamp", shining(true, true)),
        ("sky", sky(Vec3::new(0.3, 0.5, 0.9), Scene { lights: Vec::new(), ..plates() })),
        ("sky and lamp", sky(Vec3::new(0.3, 0.5, 0.9), plates())),
        ("sky, sun and lamp", {
            let direction = Vec3::new(-0.6, -0.7, -0.3).normalize();
            let sun = Light::Sun { direction, irradiance: Vec3::new(1.0, 1.5, 2.0), angle: 0.1, of_sky: true };
            let mut scene = sky(Vec3::new(0.3, 0.5, 0.9), plates());
            scene.lights.push(sun);
            scene
        }),
        ("sky, shining ceiling and lamp", sky(Vec3::new(0.3, 0.5, 0.9), shining(false, true))),
        ("Cornell box under a constant sky", {
            let mut scene = builtin::load("cornell_env").unwrap();
            scene.environment.as_mut().unwrap().map = None;
            scene
        }),
    ];
    for (name, scene) in cases {
        let films = pictures(gpu, &scene, &settings(2));
        agree(name, &compare(&films, &references(&scene, &settings(2)), Look::Blocks));
    }
    for name in ["cornell_area", "cornell_env"] {
        let scene = builtin::load(name).unwrap();
        let films = pictures(gpu, &scene, &settings(2));
        let expected = references(&scene, &settings(2));
        agree(name, &compare(&films, &expected, Look::Blocks));
        // As in the paper it is met by chance alone, so rarely that only the mean says something, and only little.
        let paper = Settings { strategies: Strategies::Paper, ..settings(2) };
        agree(&format!("{name}, paper"), &compare(&pictures(gpu, &scene, &paper), &expected, Look::Image));
    }
}

/// Many lights, chosen for the view and from pools of any size; and an error planted among them.
#[test]
fn many_lights_agree_with_the_reference() {
    let Some(gpu) = gpu() else { return };
    let lights = |count: u32| -> Vec<Light> {
        let place =
            |i: u32| Vec3::new((i % 7) as f32 / 3.5 - 0.9, 0.5 + (i % 5) as f32 * 0.2, (i % 6) as f32 / 3.0 - 0.8);
        let strength = |i: u32| Vec3::new(0.02, 0.03, 0.05) * (1 + i % 8) as f32;
        (0..count).map(|i| Light::Point { position: place(i), intensity: strength(i) }).collect()
    };
    let mut scene = Scene { lights: lights(40), ..plates() };
    scene.materials[2].emission = Some(Emission { radiance: Vec3::new(0.5, 0.2, 0.1).into(), two_sided: true });
    let expected = references(&scene, &settings(2));
    for light_pool in [None, Some(1), Some(5)] {
        let films = pictures(gpu, &scene, &Settings { light_pool, ..settings(2) });
        agree(&format!("pool {light_pool:?}"), &compare(&films, &expected, Look::Blocks));
    }
    let films = pictures(gpu, &scene, &Settings { light_sampling: Some(LightSampling::Uniform), ..settings(2) });
    agree("uniform choice", &compare(&films, &expected, Look::Blocks));
    scene.lights = lights(37);
    differ("three lights missing", &compare(&pictures(gpu, &scene, &settings(2)), &expected, Look::Blocks));
}

/// Mean squared difference of the means of pixels, less the variance of the means, over the mean square.
fn squared_bias(films: &[Film], expected: &[Film]) -> f32 {
    let value = |f: &Film, i: usize| Vec3::from(f.pixels[i]).element_sum() / 3.0;
    let mean = |films: &[Film], i: usize| films.iter().map(|f| value(f, i)).sum::<f32>() / films.len() as f32;
    let variance = |films: &[Film], i: usize| {
        let (m, n) = (mean(films, i), films.len() as f32);
        films.iter().map(|f| (value(f, i) - m).powi(2)).sum::<f32>() / (n - 1.0) / n
    };
    let excess = |i: usize| (mean(films, i) - mean(expected, i)).powi(2) - variance(films, i) - variance(expected, i);
    let pixels = films[0].pixels.len();
    let (square, level) = (0..pixels).fold((0.0, 0.0), |(s, l), i| (s + excess(i), l + mean(expected, i).powi(2)));
    square / level
}

/// What was kept of the last iteration's light points leaves the mean alone; counting all places that were asked instead does not.
#[test]
fn reuse_is_biased_only_where_asked_to_be() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("emitter_hall:300").unwrap();
    let light_sampling = Some(LightSampling::Restir);
    let base = Settings { width: 24, height: 24, light_sampling, light_pool: Some(4), ..settings(0) };
    let expected: Vec<_> = (0..8).map(|seed| reference(&scene, &base, 512, 1000 + seed)).collect();
    let unbiased = pictures(gpu, &scene, &base);
    agree("unbiased", &compare(&unbiased, &expected, Look::Blocks));
    // Of the same seeds: what both have by chance is not in the difference.
    let biased = pictures(gpu, &scene, &Settings { restir_bias: RestirBias::Biased, ..base });
    let level = |film: &Film| film.pixels.iter().map(|&p| Vec3::from(p).element_sum()).sum::<f32>();
    let darker: Vec<_> = biased.iter().zip(&unbiased).map(|(b, u)| level(b) / level(u) - 1.0).collect();
    let count = darker.len() as f32;
    let mean = darker.iter().sum::<f32>() / count;
    let error = (darker.iter().map(|d| (d - mean).powi(2)).sum::<f32>() / (count - 1.0) / count).sqrt();
    println!("biased: {mean} +- {error} of the unbiased");
    assert!(mean < -4.0 * error, "biased was not noticed: {mean} +- {error}");
}

/// The roughness clamp (eq. (9)) widens the lobes of the metals while samples are few: the picture's error on them, beyond what
/// its spread explains, has to go away as samples come.
#[test]
fn the_roughness_clamp_vanishes() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("cornell_glossy").unwrap();
    let one = settings(1);
    let expected = references(&scene, &one);
    let of = |samples| pictures(gpu, &scene, &Settings { samples, ..one.clone() });
    let (few, many) = (of(8), of(128));
    let (few_bias, many_bias) = (squared_bias(&few, &expected), squared_bias(&many, &expected));
    println!("squared relative bias with 8 samples {few_bias:.2e}, with 128 {many_bias:.2e}");
    let [few_mean, many_mean] = [&few, &many].map(|films| compare(films, &expected, Look::Image).image[0]);
    println!("mean_bias with 8 samples {few_mean:.4}, with 128 {many_mean:.4}");
    // A lobe of width alpha is let alone from about 16 / alpha^2 samples on: 1,600 for the block.
    assert!(many_bias < 0.7 * few_bias, "{few_bias} with 8 samples, {many_bias} with 128");
    assert!(many_mean.abs() < few_mean.abs() && many_mean.abs() < 0.03, "{few_mean}, then {many_mean}");
}

/// A pool of light points brings as many samples an iteration as it has points: the clamp opens by so much earlier.
#[test]
fn the_roughness_clamp_counts_the_points_of_a_pool() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene { lights: Vec::new(), ..plates() };
    scene.materials[0].bsdf = Bsdf::Conductor { alpha: 0.1.into(), fresnel: Fresnel::None, specular: Vec3::ONE.into() };
    scene.materials[2].emission = Some(Emission { radiance: Vec3::ONE.into(), two_sided: true });
    let direct = settings(0);
    let expected = references(&scene, &direct);
    let of = |points, clamp_samples| {
        let settings = Settings { light_pool: Some(points), clamp_samples, ..direct.clone() };
        let bias = squared_bias(&pictures(gpu, &scene, &settings), &expected);
        println!("{points} light points, clamp for {clamp_samples} samples: squared relative bias {bias:.2e}");
        bias
    };
    let (one, sixteen, open) = (of(1, 16.0), of(16, 16.0), of(16, 1.0));
    assert!(sixteen < 0.3 * one, "{one} with one light point, {sixteen} with sixteen");
    assert!(
        open < 0.3 * sixteen,
        "{sixteen} where a highlight should hold sixteen samples, {open} where one is enough"
    );
}

/// Every pixel of diffuse scenes, pictures of different seeds being independent:
///
///     cargo test --test raster_statistics -- --ignored --nocapture pixels
///
/// Paths from the camera hardly ever find the bright spot of corner_spikes, so that its pictures by the reference are dark and say so
/// too rarely; there ray-query judges, which tests/paths holds against Mitsuba.
#[test]
#[ignore = "minutes: the table"]
fn pixels_agree() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    println!(
        "| scene | judge | pixels that pass | worst pixel: difference, standard error | mean |\n|---|---|---|---|---|"
    );
    for (name, judge) in [
        ("cornell_point", Method::Reference),
        ("cornell_area", Method::Reference),
        ("cornell_env", Method::Reference),
        ("corner_spikes", Method::RayQuery),
        ("integrating_sphere", Method::Reference),
        ("displaced_room:5000", Method::Reference),
    ] {
        let scene = builtin::load(name).unwrap();
        let base = Settings { width: 128, height: 128, samples: 256, ..Settings::plain() };
        let films = pictures(gpu, &scene, &base);
        let expected: Vec<_> = (1..=10)
            .map(|seed| match judge {
                Method::Reference => reference(&scene, &base, 128, 1000 + seed),
                _ => {
                    let settings = Settings { method: judge, samples: 128, seed, ..base.clone() };
                    let mut renderer = PathRenderer::new(gpu, &scene, &settings).unwrap();
                    renderer.render(128, &mut |_| true).unwrap();
                    renderer.film().unwrap()
                }
            })
            .collect();
        let (pixels, image) = (compare_pixels(&films, &expected), compare(&films, &expected, Look::Image));
        let (_, difference, error) = pixels.worst;
        println!(
            "| {name} | {judge} | {:.3} % | {:+.2} %, {:.2} % | {:+.3} % +- {:.3} % |",
            100.0 * pixels.share,
            100.0 * difference,
            100.0 * error,
            100.0 * image.image[0],
            100.0 * image.image[1],
        );
        assert!(pixels.agrees(), "{name}: {pixels:?}");
    }
}
