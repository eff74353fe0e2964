//! Pictures by rays through a grid and through a hierarchy are those of ray queries at the same seed.

use glam::Vec3;
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::render::open;
use lightsheaf::scene::{Geometry, Material, Opacity, Scene, Sides, builtin};
use lightsheaf::settings::{Method, Settings, Technique, Visibility, VisibilityFrom};
use lightsheaf::staging::{self, Staging};

use crate::common::scenes::{add, pinhole, quad};
use crate::common::{self, gpu_with_ray_queries};
use crate::scenes;

/// rel_mse that two pictures may differ by: their hits differ in the last bits.
const SAME: f64 = 1e-6;

/// Renders the last pose, coming from the first one.
fn picture(gpu: &Gpu, poses: &[Scene], method: Method, visibility: Visibility) -> Film {
    let technique = Technique { method, visibility: Some(visibility) };
    let settings = Settings { technique, width: 64, height: 64, bounces: 3, ..Settings::plain() };
    let mut renderer = open(gpu, &poses[0], &settings).unwrap();
    for pose in &poses[1..] {
        renderer.pose(pose).unwrap();
    }
    common::picture(&mut *renderer, 4)
}

/// Returns two poses of a file that joints deform.
fn moving() -> Option<Vec<Scene>> {
    let file = common::shared()?.join("scenes/gltf").join("Fox/glTF-Binary/Fox.glb");
    let scene = staging::load(file.to_str()?, &Staging::default()).unwrap();
    let (centre, radius) = Geometry::new(&scene.at(0, 0.0).unwrap()).sphere();
    let along = glam::Vec3::new(-4.5, -3.0, -5.3).normalize();
    let camera = pinhole(centre - along * (2.2 * radius), along, 0.75);
    let pose = |seconds| Scene { cameras: vec![camera.clone()], ..scene.at(0, seconds).unwrap() };
    Some(vec![pose(0.0), pose(1.3)])
}

/// Returns the Cornell box with blended white walls: a third of the rays pass.
fn blended() -> Scene {
    let mut scene = scenes::cornell("point");
    let mut changed = 0;
    for material in scene.materials.iter_mut().filter(|material| material.name == "white") {
        material.opacity = Some(Opacity::Blended { value: (2.0 / 3.0).into() });
        changed += 1;
    }
    assert!(changed > 0);
    scene
}

/// `exact` of methods whose pixels have paths of their own is a grid; in `shared` a grid is asked for.
fn others(method: Method) -> Vec<Visibility> {
    if method == Method::Shared { vec![Visibility::Bvh] } else { vec![Visibility::Exact, Visibility::Bvh] }
}

#[test]
fn all_tracers_make_the_same_pictures() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let sea = builtin::load("sea").unwrap();
    let mut all = vec![
        ("Cornell box", Method::Path, vec![scenes::cornell("point")]),
        ("Cornell box", Method::Shared, vec![scenes::cornell("point")]),
        ("glass and a clear sheet", Method::Bdpt, vec![scenes::transmitting()]),
        ("blended walls", Method::Shared, vec![blended()]),
        ("blended walls", Method::Path, vec![blended()]),
        ("holes", Method::Path, vec![scenes::textured()]),
        ("tessellated", Method::Path, vec![sea.at(0, 0.0).unwrap(), sea.at(0, 1.3).unwrap()]),
    ];
    all.extend(moving().map(|poses| ("skinned", Method::Path, poses)));
    for (name, method, poses) in &all {
        let rays = picture(gpu, poses, *method, Visibility::RayQuery);
        for visibility in others(*method) {
            let apart = compare(&picture(gpu, poses, *method, visibility), &rays).unwrap();
            println!(
                "{name} by {method} {visibility}: rel_mse {:.1e}, mean_bias {:+.1e}",
                apart.rel_mse, apart.mean_bias
            );
            assert!(apart.rel_mse <= SAME, "{name} by {method} {visibility}: {apart:?}");
            if poses.len() > 1 {
                let late = compare(&picture(gpu, &poses[..1], *method, visibility), &rays).unwrap();
                assert!(late.rel_mse > 1e3 * SAME, "{name} by {method} {visibility}: the pose is not seen: {late:?}");
            }
        }
    }
}

/// Mirrors, clear and rough glass in `shared`, by a grid, are those of ray queries.
#[test]
fn shared_paths_through_glass_do_not_depend_on_the_tracer() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    for (name, scene) in
        [("mirrors and glass", builtin::load("cornell_spheres").unwrap()), ("rough glass", scenes::transmitting())]
    {
        let [rays, grid] = [Visibility::RayQuery, Visibility::Exact]
            .map(|v| picture(gpu, std::slice::from_ref(&scene), Method::Shared, v));
        let apart = compare(&grid, &rays).unwrap();
        println!("{name}: rel_mse {:.1e}, mean_bias {:+.1e}", apart.rel_mse, apart.mean_bias);
        assert!(apart.rel_mse <= SAME, "{name}: {apart:?}");
    }
}

/// Whether a ray passes a blended surface does not depend on what finds the surface: lists of views, or the grid. Rays of
/// the camera pass the surface, a wall whose back is culled: where two blended triangles meet, the pixels that it rasterizes
/// may hold either.
#[test]
fn lists_and_grid_pass_blended_surfaces_alike() {
    let Some(gpu) = common::gpu() else { return };
    let mut scene = scenes::cornell("area");
    let wall = Material {
        sides: Sides::OneCulled,
        opacity: Some(Opacity::Blended { value: (2.0 / 3.0).into() }),
        ..Material::diffuse("front wall", Vec3::splat(0.7))
    };
    let front = quad(Vec3::new(1.0, 0.0, 0.99), Vec3::NEG_X * 2.0, Vec3::Y * 2.0);
    add(&mut scene, front, wall);
    let [lists, grid] = [VisibilityFrom::Lists, VisibilityFrom::Grid].map(|visibility_from| {
        let settings = Settings { visibility_from, width: 64, height: 64, bounces: 2, ..Settings::plain() };
        common::picture(&mut *open(gpu, &scene, &settings).unwrap(), 4)
    });
    let apart = compare(&grid, &lists).unwrap();
    println!("rel_mse {:.1e}, mean_bias {:+.1e}", apart.rel_mse, apart.mean_bias);
    assert!(apart.rel_mse <= SAME, "{apart:?}");
    // The wall counts: without it, light leaves the box.
    let open_box = Settings { width: 64, height: 64, bounces: 2, ..Settings::plain() };
    let without = common::picture(&mut *open(gpu, &scenes::cornell("area"), &open_box).unwrap(), 4);
    assert!(compare(&without, &lists).unwrap().rel_mse > 1e3 * SAME);
}

/// No method needs a device with ray queries.
#[test]
fn every_method_runs_without_ray_queries() {
    let Some(gpu) = common::gpu() else { return };
    assert!(!gpu.capabilities.ray_queries);
    for method in [Method::Path, Method::Bdpt, Method::Shared] {
        for visibility in [Visibility::Exact, Visibility::Bvh] {
            let film = picture(gpu, &[scenes::transmitting()], method, visibility);
            assert!(film.pixels.iter().flatten().sum::<f32>() > 0.0, "{method} {visibility}");
        }
        let technique = Technique { method, visibility: Some(Visibility::RayQuery) };
        let error = open(gpu, &scenes::transmitting(), &Settings { technique, ..Settings::plain() }).err();
        assert!(error.is_some_and(|e| e.to_string().contains("without ray queries")), "{method}");
    }
}
