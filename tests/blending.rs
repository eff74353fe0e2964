//! Blended surfaces, which stop a ray with the probability of their opacity, by every method: against values
//! that are derived here, and against the reference.
//!
//! Each comparison is Welch's t-test over pictures of different seeds; the values that are derived count as
//! pictures without noise. Planted errors have to be noticed.

mod common;

use std::f32::consts::PI;

use common::scenes::{add, floor, parallel, pinhole, quad, room, sphere};
use common::statistics::{Look, Verdict, compare};
use common::{gpu, gpu_with_ray_queries, one_at_a_time, picture, reference};
use glam::{Vec2, Vec3};
use lightsheaf::film::Film;
use lightsheaf::render;
use lightsheaf::scene::{
    Camera, Emission, Filter, Image, Light, Material, Opacity, Scalar, Scene, Texture, TextureRef, Wrap,
};
use lightsheaf::settings::{LightSampling, Settings, Technique};

/// Pictures of each side of a comparison.
const PICTURES: u32 = 8;

/// Opacities of the sheets of the derived values, and the share of light that passes all of them.
const OPACITIES: [f32; 2] = [0.3, 0.4];
const PASSING: f32 = 0.7 * 0.6;

fn settings(technique: Technique, samples: u32, bounces: u32) -> Settings {
    // Texels of `fast` decide as one, so that finer ones have less noise.
    let light_resolution = (technique == Technique::FAST).then_some(256);
    Settings { technique, light_resolution, width: 24, height: 24, samples, bounces, ..Settings::plain() }
}

/// Renders pictures of different seeds; none without a device.
fn pictures(scene: &Scene, settings: &Settings) -> Option<Vec<Film>> {
    let seeds = 1..=PICTURES;
    if settings.technique == Technique::REFERENCE {
        return Some(seeds.map(|seed| reference(scene, settings, settings.samples, seed)).collect());
    }
    let gpu = if settings.technique.needs_ray_queries() { gpu_with_ray_queries()? } else { gpu()? };
    let mut renderer = render::open(gpu, scene, settings).unwrap();
    Some(
        seeds
            .map(|seed| {
                renderer.restart(seed);
                let film = one_at_a_time(|| picture(renderer.as_mut(), u64::from(settings.samples)));
                gpu.check().unwrap();
                film
            })
            .collect(),
    )
}

/// Compares the means of pictures with the same value everywhere.
fn against(films: &[Film], value: f32) -> Verdict {
    let expected = Film { pixels: vec![[value; 3]; films[0].pixels.len()], ..films[0].clone() };
    compare(films, &vec![expected; PICTURES as usize], Look::Image)
}

#[track_caller]
fn agree(name: &str, verdict: &Verdict) {
    println!("{name}: {verdict:?}");
    assert!(verdict.agrees() && verdict.is_sharp(), "{name}: {verdict:?}");
}

#[track_caller]
fn differ(name: &str, verdict: &Verdict) {
    println!("{name}: {verdict:?}");
    assert!(!verdict.agrees(), "{name} was not noticed: {verdict:?}");
}

/// Every method; `fast` too, whose views are parallel to the sheets in the scenes of derived values.
const METHODS: [Technique; 6] =
    [Technique::RASTER, Technique::FAST, Technique::TWIN, Technique::RAY_QUERY, Technique::PATH, Technique::REFERENCE];

fn black(opacity: f32) -> Material {
    Material { opacity: Some(Opacity::Blended { value: opacity.into() }), ..Material::diffuse("sheet", Vec3::ZERO) }
}

/// Returns black sheets above a floor, seen from straight above at a height.
fn sheets(floor_material: Material, height: f32) -> Scene {
    let mut scene = Scene { cameras: vec![parallel(Vec3::Y * height, Vec3::NEG_Y, 0.5)], ..Scene::default() };
    add(&mut scene, floor(3.0, 0.0), floor_material);
    for (y, opacity) in (1..).zip(OPACITIES) {
        // No texel's centre lies on the edge that two triangles share: rays would cross both.
        add(&mut scene, quad(Vec3::new(-1.3, y as f32, 1.1), Vec3::X * 3.0, Vec3::NEG_Z * 2.3), black(opacity));
    }
    scene
}

/// Returns the same with light from straight above. The floor's radiance is the share of light that passes.
fn lit_sheets(height: f32) -> Scene {
    let mut scene = sheets(Material::diffuse("floor", Vec3::splat(PI)), height);
    scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE }];
    scene
}

/// A shining floor is as bright as the camera's rays pass the sheets.
#[test]
fn sheets_dim_what_is_behind() {
    let glow = Some(Emission { radiance: Vec3::ONE.into(), two_sided: false });
    let scene = sheets(Material { emission: glow, ..Material::diffuse("floor", Vec3::ZERO) }, 5.0);
    for method in METHODS {
        let Some(films) = pictures(&scene, &settings(method, 64, 0)) else { return };
        agree(&format!("{method}"), &against(&films, PASSING));
        differ("a sheet that is left out", &against(&films, 1.0 - OPACITIES[0]));
    }
}

/// The floor below the sheets lies in their shadow.
#[test]
fn sheets_cast_partial_shadows() {
    let scene = lit_sheets(0.5);
    for method in METHODS {
        let Some(films) = pictures(&scene, &settings(method, 32, 0)) else { return };
        agree(&format!("{method}"), &against(&films, PASSING));
        differ("light x 0.95", &against(&films, 0.95 * PASSING));
    }
}

/// Light and camera rays cross the sheets at the same points, and are stopped there independently.
#[test]
fn ways_there_and_back_are_independent() {
    let scene = lit_sheets(5.0);
    for method in METHODS {
        let Some(films) = pictures(&scene, &settings(method, 64, 0)) else { return };
        agree(&format!("{method}"), &against(&films, PASSING * PASSING));
        differ("a decision that both ways share", &against(&films, PASSING));
    }
    // Frames that are interleaved and filtered take their decisions anew, too.
    let denoised = Settings { interleave: Some(2), ..settings(Technique::RASTER, 64, 0) };
    let Some(films) = pictures(&scene, &denoised) else { return };
    agree("denoised frames", &against(&films, PASSING * PASSING));
}

/// In a room whose walls emit 1 with an opacity of 1/2, everything is as bright as 1/2, by light that paths
/// hit and by light that is sampled.
#[test]
fn emitters_emit_as_they_are_hit() {
    let camera = parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 0.1);
    let mut scene = Scene { cameras: vec![camera], ..Scene::default() };
    let emission = Some(Emission { radiance: Vec3::ONE.into(), two_sided: false });
    add(&mut scene, room(), Material { emission, ..black(0.5) });
    add(&mut scene, floor(0.2, 0.0), Material::diffuse("floor", Vec3::ONE));
    for method in METHODS {
        let samples = if method.shares_subpaths() { 64 } else { 16 };
        let Some(films) = pictures(&scene, &settings(method, samples, 0)) else { return };
        agree(&format!("{method}"), &against(&films, 0.5));
    }
}

/// Returns a room with a lamp, a ball, a textured sheet that shades it, and a sheet that emits.
fn furnished(opacity: f32) -> Scene {
    let camera: Camera = pinhole(Vec3::new(0.0, 0.0, 0.95), Vec3::NEG_Z, 1.3);
    let mut scene = Scene { cameras: vec![camera], ..Scene::default() };
    add(&mut scene, room(), Material::diffuse("wall", Vec3::new(0.6, 0.5, 0.4)));
    let mut ball = sphere(1);
    ball.positions.iter_mut().for_each(|p| *p = *p * 0.35 + Vec3::new(0.3, -0.6, -0.3));
    add(&mut scene, ball, Material::diffuse("ball", Vec3::splat(0.7)));
    let texels = [20, 250, 140, 0].map(|alpha| [255, 255, 255, alpha]).to_vec();
    scene.images = vec![Image { name: String::new(), width: 2, height: 2, texels }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb: false }];
    let mut texture = TextureRef::new(0);
    texture.transform = glam::Affine2::from_scale(Vec2::splat(3.0));
    let leaves = Opacity::Blended { value: Scalar { factor: opacity, texture: Some((texture, 3)) } };
    add(
        &mut scene,
        quad(Vec3::new(-0.8, 0.2, 0.5), Vec3::X * 1.2, Vec3::new(0.0, 0.2, -1.2)),
        Material { opacity: Some(leaves), ..Material::diffuse("leaves", Vec3::new(0.2, 0.8, 0.3)) },
    );
    let emission = Some(Emission { radiance: Vec3::new(2.0, 1.0, 0.5).into(), two_sided: true });
    add(
        &mut scene,
        quad(Vec3::new(-0.7, -0.8, -0.5), Vec3::X * 0.6, Vec3::Y * 0.7),
        Material {
            emission,
            ..Material { opacity: black(0.4).opacity, ..Material::diffuse("sign", Vec3::splat(0.5)) }
        },
    );
    scene.lights = vec![Light::Point { position: Vec3::new(0.0, 0.85, 0.0), intensity: Vec3::splat(2.0) }];
    scene
}

#[test]
fn methods_agree_with_the_reference() {
    let scene = furnished(1.0);
    let expected = pictures(&scene, &settings(Technique::REFERENCE, 128, 2)).unwrap();
    let restir = Some(LightSampling::Restir);
    let cases = [
        settings(Technique::RASTER, 64, 2),
        Settings { light_sampling: restir, ..settings(Technique::RASTER, 48, 2) },
        settings(Technique::TWIN, 48, 2),
        settings(Technique::RAY_QUERY, 32, 2),
        settings(Technique::PATH, 32, 2),
        Settings { light_sampling: restir, ..settings(Technique::PATH, 32, 2) },
    ];
    for case in &cases {
        let Some(films) = pictures(&scene, case) else { continue };
        let name = format!("{} {:?}", case.technique, case.light_sampling);
        agree(&name, &compare(&films, &expected, Look::Blocks));
    }
    let Some(films) = pictures(&furnished(0.8), &cases[4]) else { return };
    differ("leaves of 0.8 times their opacity", &compare(&films, &expected, Look::Blocks));
}

/// A blended surface of opacity 1 lets nothing pass, and one of opacity 0 might as well not be there.
#[test]
fn the_ends_of_the_range_are_certain() {
    let glow = Some(Emission { radiance: Vec3::ONE.into(), two_sided: false });
    for (opacity, expected) in [(0.0, 1.0), (1.0, 0.0)] {
        let mut scene = sheets(Material { emission: glow, ..Material::diffuse("floor", Vec3::ZERO) }, 5.0);
        scene.materials[1..].iter_mut().for_each(|sheet| *sheet = black(opacity));
        for method in METHODS {
            let Some(films) = pictures(&scene, &settings(method, 2, 0)) else { return };
            // Light that is traced to the camera leaves noise in every picture of what shines.
            if method == Technique::RAY_QUERY {
                assert!(against(&films, expected).agrees(), "{method}");
                continue;
            }
            let mut values = films.iter().flat_map(|film| film.pixels.as_flattened());
            assert!(values.all(|value| (value - expected).abs() < 1e-5), "{method}");
        }
    }
}
