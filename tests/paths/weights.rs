//! The weights of all strategies of a random path sum to 1, and each equals the one from all densities
//! written out.

use lightsheaf::gpu::Compute;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Lens, Light, Scene};
use lightsheaf::settings::{LightSampling, Settings, Technique};

use crate::common::harness::run;
use crate::common::{gpu_with_ray_queries, shaders};
use crate::{scenes, settings};

/// Returns sum, largest deviation of a weight, strategies and surfaces of each path; zeros without a path.
fn sums(scene: &Scene, settings: &Settings, count: u32) -> Option<Vec<[f32; 4]>> {
    let gpu = gpu_with_ray_queries()?;
    let renderer = PathRenderer::new(gpu, scene, settings).unwrap();
    renderer.describe(0, 0, count);
    let pass = Compute::from_source(gpu, "mis_sums", &shaders::MIS_SUMS, &renderer.plan().flags);
    let answers = gpu.storage("answers", u64::from(count) * 16);
    let mut bindings = renderer.bindings();
    bindings.push(("answers", answers.as_entire_binding()));
    Some(run(gpu, &pass, &bindings, [count, 1], (&answers, count as usize)))
}

/// Returns scenes with diffuse, glossy, smooth and transmitting surfaces, and with point, spot, directional,
/// area, constant and mapped lights.
fn all() -> Vec<(&'static str, Scene)> {
    let mut lit = scenes::transmitting();
    lit.lights = scenes::reflecting().lights;
    lit.lights.push(Light::Directional { direction: glam::Vec3::NEG_Y, irradiance: glam::Vec3::ONE });
    lit.cameras[0].lens = Some(Lens { radius: 0.05, focus: 1.0 });
    let mut open = scenes::mirrors();
    open.environment = scenes::cornell("env").environment;
    let mut constant = scenes::textured();
    constant.environment = open.environment.clone();
    if let Some(environment) = &mut constant.environment {
        environment.map = None;
    }
    vec![
        ("Cornell box", scenes::cornell("area")),
        ("all lights, transmission", lit),
        ("mirrors, map", open),
        ("textures, constant sky, parallel camera", constant),
        ("many emitters", lightsheaf::scene::builtin::load("emitter_hall:500").unwrap()),
    ]
}

#[test]
fn weights_sum_to_one() {
    let count = 100_000;
    for (beta, light_sampling) in [(2.0, None), (1.0, None), (2.0, Some(LightSampling::Uniform))] {
        let mut total = 0;
        for (name, scene) in all() {
            let settings = Settings { beta: Some(beta), light_sampling, ..settings(Technique::RAY_QUERY, 64, 1, 6) };
            let Some(answers) = sums(&scene, &settings, count) else { return };
            let paths: Vec<_> = answers.iter().filter(|a| a[3] > 0.0).collect();
            let worst = paths.iter().map(|a| (a[0] - 1.0).abs()).fold(0.0, f32::max);
            let deviation = paths.iter().map(|a| a[1]).fold(0.0, f32::max);
            let most = paths.iter().map(|a| a[2]).fold(0.0, f32::max);
            println!("{name}, beta {beta}: {} paths, sums within {worst:e}, weights within {deviation:e}", paths.len());
            assert!(worst <= 1e-5 && deviation <= 1e-5, "{name}, beta {beta}: {worst} {deviation}");
            assert!(paths.len() > count as usize / 20 && most >= 7.0, "{name}: {} paths, {most}", paths.len());
            total += paths.len();
        }
        assert!(total > 85_000, "{total}");
    }
}
