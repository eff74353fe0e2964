//! The mean of `raster` against the reference, for every strategy set, depth and kind of light.
//!
//! All pixels of an iteration share their random numbers, so that a picture is one observation. The spread is
//! taken over pictures of 12 seeds, and the means are compared by Welch's t-test at a significance of 0.1 %
//! over all values of a comparison. Seeds are fixed. The same comparison has to find planted errors.

mod common;

use std::f32::consts::PI;
use std::sync::OnceLock;

use common::scenes::{add, inverted, pinhole, quad, room_with_a_window, sphere};
use common::statistics::{Look, MISSED, Verdict, check_distribution, compare, compare_pixels};
use common::{gpu, gpu_with_ray_queries, one_at_a_time, picture, raster, reference};
use glam::{Mat3, Vec3};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics;
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Bsdf, Emission, Environment, Fresnel, Light, Material, Scene, SpotFalloff, builtin};
use lightsheaf::settings::{LightSampling, RestirBias, Settings, Strategies, Technique};

/// Pictures of `raster` in a comparison.
const SEEDS: u32 = 12;
/// Iterations of each picture: where errors are planted, and where methods are only compared.
const ITERATIONS: u32 = 64;
const QUICK_ITERATIONS: u32 = 40;
/// Paths per pixel in each of the reference's eight pictures.
const REFERENCE_SAMPLES: u32 = 128;

/// Returns settings of small pictures: all pixels share their random numbers, so that more pixels add little.
fn settings(bounces: u32) -> Settings {
    Settings { width: 32, height: 32, samples: ITERATIONS, bounces, ..Settings::plain() }
}

/// Returns the same settings with fewer iterations.
fn quick(bounces: u32) -> Settings {
    Settings { samples: QUICK_ITERATIONS, ..settings(bounces) }
}

/// Renders pictures of different seeds by one renderer that begins anew for each.
fn pictures(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Vec<Film> {
    let mut renderer = SharedRenderer::new(gpu, scene, settings).unwrap();
    let samples = u64::from(settings.samples);
    (1..=SEEDS)
        .map(|seed| {
            renderer.restart(seed);
            let film = one_at_a_time(|| picture(&mut renderer, samples));
            gpu.check().unwrap();
            assert_eq!(renderer.samples(), samples);
            film
        })
        .collect()
}

/// Renders pictures by the reference with less noise than those of [`pictures`] together.
fn references(scene: &Scene, settings: &Settings) -> Vec<Film> {
    (0..8).map(|seed| reference(scene, settings, REFERENCE_SAMPLES, 1000 + seed)).collect()
}

/// Asserts that a comparison agrees, and that it would have found a bias of more than 10 % in the image's
/// mean ([`MISSED`]).
#[track_caller]
fn agree(name: &str, verdict: &Verdict) {
    agree_roughly(name, verdict);
    assert!(verdict.is_sharp(), "{name}: a bias of {} would be missed, more than {MISSED}", verdict.detectable);
}

/// Asserts only that a comparison agrees.
#[track_caller]
fn agree_roughly(name: &str, verdict: &Verdict) {
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

/// Returns the Cornell box after one bounce by the reference, which several tests use.
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

/// Every planted error is found by the comparison that the program itself passes.
#[test]
fn planted_errors_are_caught() {
    let Some(gpu) = gpu() else { return };
    // The light is 0.75 % too bright in direct light.
    let brighter = |mut scene: Scene| {
        for light in &mut scene.lights {
            let Light::Point { intensity, .. } = light else { unreachable!() };
            *intensity *= 1.0075;
        }
        scene
    };
    let direct = settings(0);
    let expected = references(&cornell_point(), &direct);
    // Blocks are left out: their spread comes from a few pixels on edges, and is too far from a normal
    // distribution for twelve pictures.
    agree("direct light", &compare(&pictures(gpu, &cornell_point(), &direct), &expected, Look::Image));
    differ("light x 1.0075", &compare(&pictures(gpu, &brighter(cornell_point()), &direct), &expected, Look::Image));

    // The light is 0.75 % too bright with one bounce, in a sphere, where noise is low.
    let one = settings(1);
    let expected = references(&lamp_in_a_sphere(), &one);
    agree("one bounce", &compare(&pictures(gpu, &lamp_in_a_sphere(), &one), &expected, Look::Blocks));
    let films = pictures(gpu, &brighter(lamp_in_a_sphere()), &one);
    differ("light x 1.0075, one bounce", &compare(&films, &expected, Look::Blocks));

    // One seed in all pictures leaves no spread, so that its error stands out.
    let film = raster(gpu, &cornell_point(), &Settings { seed: 1, ..one.clone() }).0;
    let same = vec![film; SEEDS as usize];
    differ("a seed that does not advance", &compare(&same, cornell_after_one_bounce(), Look::Image));

    // One material reflects pi times as much, as if 1 / pi were missing.
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

/// Returns a floor and a ceiling with a square in between and a point light. Every strategy has bounded
/// contributions, since no two surfaces touch, and shadows matter.
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

/// Returns a point light off the middle of a diffuse sphere: between two of its points cos cos / d^2 is
/// constant.
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
        let expected = references(&plates(), &quick(bounces));
        for strategies in [Strategies::All, Strategies::Vpl, Strategies::Bundle, Strategies::Paper] {
            if strategies == Strategies::Paper && bounces == 2 {
                // This set is clamped, so that its mean differs.
                continue;
            }
            // Bundles alone find a point light's reflections with more noise: 64 iterations miss a bias of 11 %.
            let samples = if strategies == Strategies::Bundle { 4 * ITERATIONS } else { ITERATIONS };
            let films = pictures(gpu, &plates(), &Settings { strategies, samples, ..settings(bounces) });
            agree(&format!("{strategies}, {bounces} bounces"), &compare(&films, &expected, Look::Blocks));
        }
    }
}

/// The power heuristic has the same mean.
#[test]
fn beta_does_not_change_the_mean() {
    let Some(gpu) = gpu() else { return };
    let two = quick(2);
    let expected = references(&plates(), &two);
    let films = pictures(gpu, &plates(), &Settings { beta: Some(2.0), ..two });
    agree("beta 2", &compare(&films, &expected, Look::Blocks));
}

/// Corners make the variance of instant radiosity infinite in the box, so that only bundles are compared, by
/// the image's mean.
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
        let films = pictures(gpu, &cornell_point(), &quick(bounces));
        let expected = references(&cornell_point(), &quick(bounces));
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
        let films = pictures(gpu, &scene, &quick(2));
        agree(name, &compare(&films, &references(&scene, &quick(2)), Look::Blocks));
    }
}

/// Eye subpaths can hit emitters: a ceiling that emits on both sides or on one, a constant sky, a sky with a
/// sun, and both beside a point light.
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
        let films = pictures(gpu, &scene, &quick(2));
        agree(name, &compare(&films, &references(&scene, &quick(2)), Look::Blocks));
    }
    for name in ["cornell_area", "cornell_env"] {
        let scene = builtin::load(name).unwrap();
        let films = pictures(gpu, &scene, &quick(2));
        let expected = references(&scene, &quick(2));
        agree(name, &compare(&films, &expected, Look::Blocks));
        // In the paper, eye subpaths hit emitters by chance, so rarely that only the image's mean is
        // compared.
        let paper = Settings { strategies: Strategies::Paper, ..settings(2) };
        agree_roughly(&format!("{name}, paper"), &compare(&pictures(gpu, &scene, &paper), &expected, Look::Image));
    }
}

/// Many lights are selected for the view and from pools of any size; missing lights are a planted error.
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

/// Returns the mean squared difference of the pixels' means, less the variance of the means, over the mean
/// square.
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

/// Unbiased reuse of the last iteration's light points keeps the mean. Biased reuse, which counts all queried
/// places, does not.
#[test]
fn reuse_is_biased_only_where_asked_to_be() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("emitter_hall:300").unwrap();
    let light_sampling = Some(LightSampling::Restir);
    let base = Settings { width: 24, height: 24, light_sampling, light_pool: Some(4), ..settings(0) };
    let expected: Vec<_> = (0..8).map(|seed| reference(&scene, &base, 512, 1000 + seed)).collect();
    let unbiased = pictures(gpu, &scene, &base);
    agree("unbiased", &compare(&unbiased, &expected, Look::Blocks));
    // Both have the same seeds, so that their common noise cancels.
    let biased = pictures(gpu, &scene, &Settings { restir_bias: RestirBias::Biased, ..base });
    let level = |film: &Film| film.pixels.iter().map(|&p| Vec3::from(p).element_sum()).sum::<f32>();
    let darker: Vec<_> = biased.iter().zip(&unbiased).map(|(b, u)| level(b) / level(u) - 1.0).collect();
    let count = darker.len() as f32;
    let mean = darker.iter().sum::<f32>() / count;
    let error = (darker.iter().map(|d| (d - mean).powi(2)).sum::<f32>() / (count - 1.0) / count).sqrt();
    println!("biased: {mean} +- {error} of the unbiased");
    assert!(mean < -4.0 * error, "biased was not noticed: {mean} +- {error}");
}

/// Returns the Cornell box with rough metals after one bounce by the reference.
fn glossy_after_one_bounce() -> &'static [Film] {
    static FILMS: OnceLock<Vec<Film>> = OnceLock::new();
    FILMS.get_or_init(|| references(&builtin::load("cornell_glossy").unwrap(), &settings(1)))
}

/// Rough metals agree with the reference: their lobes draw directions of their own and are not widened.
#[test]
fn rough_metals_agree_with_the_reference() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("cornell_glossy").unwrap();
    let open = settings(1);
    assert!(open.draws_own_directions());
    let verdict = compare(&pictures(gpu, &scene, &open), glossy_after_one_bounce(), Look::Image);
    agree_roughly("rough metals", &verdict);
    // Open lobes are noisier than clamped ones, so that the limit is twice the usual one.
    assert!(verdict.detectable <= 2.0 * MISSED, "{verdict:?}");
    let mut dull = scene;
    for material in &mut dull.materials {
        if let Bsdf::Conductor { specular, .. } = &mut material.bsdf {
            specular.factor *= 0.25;
        }
    }
    let verdict = compare(&pictures(gpu, &dull, &open), glossy_after_one_bounce(), Look::Image);
    differ("metals that reflect a quarter", &verdict);
}

/// The roughness clamp (eq. (9)) widens the lobes of metals while samples are few. The error of the picture
/// beyond its noise has to vanish as samples grow.
#[test]
fn the_roughness_clamp_vanishes() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("cornell_glossy").unwrap();
    let expected = glossy_after_one_bounce();
    let of = |samples| pictures(gpu, &scene, &Settings { samples, clamp_samples: Some(16.0), ..settings(1) });
    let (few, many) = (of(8), of(128));
    let (few_bias, many_bias) = (squared_bias(&few, expected), squared_bias(&many, expected));
    println!("squared relative bias with 8 samples {few_bias:.2e}, with 128 {many_bias:.2e}");
    let [few_mean, many_mean] = [&few, &many].map(|films| compare(films, expected, Look::Image).image[0]);
    println!("mean_bias with 8 samples {few_mean:.4}, with 128 {many_mean:.4}");
    // The clamp leaves a lobe of width alpha alone from about 16 / alpha^2 samples on: 1,600 for the block.
    assert!(many_bias < 0.7 * few_bias, "{few_bias} with 8 samples, {many_bias} with 128");
    assert!(many_mean.abs() < few_mean.abs() && many_mean.abs() < 0.03, "{few_mean}, then {many_mean}");
}

/// Where directions of their own find the light in a lobe, nothing is widened. Weights know a lobe's own width, so
/// that they would count what is widened twice.
#[test]
fn lobes_are_not_widened_that_find_a_large_light() {
    let Some(gpu) = gpu() else { return };
    let mut scene = builtin::load("cornell_area").unwrap();
    for material in &mut scene.materials {
        if material.emission.is_none() {
            material.bsdf =
                Bsdf::Conductor { alpha: 0.1.into(), fresnel: Fresnel::None, specular: Vec3::splat(0.7).into() };
        }
    }
    let of = |clamp_samples| {
        pictures(gpu, &scene, &Settings { samples: 4, clamp_samples, interleave: Some(2), ..settings(1) })
    };
    let brighter: Vec<f64> = of(None)
        .iter()
        .zip(of(Some(0.0)))
        .map(|(film, open)| metrics::compare(film, &open).unwrap().mean_bias)
        .collect();
    let mean = brighter.iter().sum::<f64>() / brighter.len() as f64;
    println!("mean_bias against open lobes {mean}: {brighter:?}");
    assert!(mean.abs() < 0.001, "{mean}: {brighter:?}");
}

/// Each candidate of a pool counts as a sample, so that the clamp opens earlier.
#[test]
fn the_roughness_clamp_counts_the_points_of_a_pool() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene { lights: Vec::new(), ..plates() };
    scene.materials[0].bsdf = Bsdf::Conductor { alpha: 0.1.into(), fresnel: Fresnel::None, specular: Vec3::ONE.into() };
    scene.materials[2].emission = Some(Emission { radiance: Vec3::ONE.into(), two_sided: true });
    let direct = settings(0);
    let expected = references(&scene, &direct);
    let of = |points, clamp_samples| {
        let settings = Settings { light_pool: Some(points), clamp_samples: Some(clamp_samples), ..direct.clone() };
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

/// Pictures of different seeds are independent, so that every pixel of diffuse scenes is compared:
///
///     cargo test --test raster_statistics -- --ignored --nocapture pixels
///
/// In the room with a window light of the sky follows a guide that has been learned. `SCENE` chooses a scene.
///
/// Paths from the camera hardly ever find the bright spot of corner_spikes, so that the reference's pictures
/// are dark there. ray-query judges that scene instead; tests/paths compares it with Mitsuba.
#[test]
#[ignore = "minutes: the table"]
fn pixels_agree() {
    const WINDOW: &str = "room with a window";
    let Some(gpu) = gpu_with_ray_queries() else { return };
    println!(
        "| scene | judge | pixels that pass | worst pixel: difference, standard error | mean |\n|---|---|---|---|---|"
    );
    let mut rows = 0;
    for (name, judge) in [
        ("cornell_point", Technique::REFERENCE),
        ("cornell_area", Technique::REFERENCE),
        ("cornell_env", Technique::REFERENCE),
        ("corner_spikes", Technique::RAY_QUERY),
        ("integrating_sphere", Technique::REFERENCE),
        ("displaced_room:5000", Technique::REFERENCE),
        (WINDOW, Technique::REFERENCE),
    ] {
        if std::env::var("SCENE").is_ok_and(|wanted| wanted != name) {
            continue;
        }
        let scene = if name == WINDOW { room_with_a_window() } else { builtin::load(name).unwrap() };
        let base = Settings { width: 128, height: 128, samples: 256, ..Settings::plain() };
        let films = pictures(gpu, &scene, &base);
        let expected: Vec<_> = (1..=10)
            .map(|seed| {
                if judge == Technique::REFERENCE {
                    return reference(&scene, &base, 128, 1000 + seed);
                }
                let settings = Settings { technique: judge, samples: 128, seed, ..base.clone() };
                let mut renderer = PathRenderer::new(gpu, &scene, &settings).unwrap();
                renderer.render(128, &mut |_| true).unwrap();
                renderer.film().unwrap()
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
        rows += 1;
    }
    assert!(rows > 0, "no scene has that name");
}
