//! Tables that are printed on demand: agreement over a million queries, and look-ups a second.

use glam::{Vec2, Vec3};
use lightsheaf::render::sampler::uniform_sphere;
use lightsheaf::render::visibility::view::{Texels, parallel};
use lightsheaf::scene;
use lightsheaf::staging::{self, Staging};

use crate::agreement::{HEAD, TOLERATED};
use crate::common::harness::{VisibilityHarness, query};
use crate::common::random::Random;
use crate::lists::tallies;
use crate::rays::{needles, ray_tallies, small_in_large};
use crate::{common, cornell, displaced_room, speed};

#[test]
#[ignore = "minutes: the long table"]
fn table() {
    let Some(gpu) = common::gpu() else { return };
    let mut scenes = vec![("Cornell box", cornell()), ("displaced room, 60,000", displaced_room(60_000))];
    if let Some(shared) = common::shared() {
        let path = shared.join("scenes/gltf/Sponza/glTF/Sponza.gltf");
        scenes.push(("Sponza", staging::load(&path.display().to_string(), &Staging::default()).unwrap()));
    }
    let count = 1_000_000;
    for fast in [false, true] {
        println!("\n{}\n\n{HEAD}", if fast { "fast" } else { "exact" });
        for (name, scene) in &scenes {
            let harness = VisibilityHarness::new(gpu, scene, fast);
            for (what, tally) in tallies(&harness, count, 20, 11) {
                println!("{}", tally.row(name, what));
                if !fast {
                    for example in &tally.examples {
                        println!("    {example}");
                    }
                    assert!(tally.share() <= TOLERATED, "{name}, {what}");
                }
            }
        }
    }
}

/// Compares a million rays of each kind; edges between points that light can pass between:
///
///     cargo test --test visibility -- --ignored --nocapture a_million_rays
///
/// `SCENES` and `TRACERS` restrict the table, as in `rays_a_second`.
#[test]
#[ignore = "minutes: the long table"]
fn a_million_rays() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    println!("{HEAD}");
    let mut scenes = speed::scenes();
    scenes.extend([("needles", needles()), ("small in large", small_in_large())]);
    scenes.retain(|(name, _)| speed::asked_for("SCENES", name));
    for (name, scene) in &scenes {
        let harness = VisibilityHarness::new(gpu, scene, false);
        for tracing in speed::tracers() {
            for (what, tally) in ray_tallies(&harness, tracing, 1_000_000, 13, |p, q| harness.face_each_other(p, q)) {
                println!("{}", tally.row(name, &format!("{what} by {tracing:?}")));
                println!("{}", tally.examples.join("\n"));
            }
        }
    }
}

/// Measures look-ups of 512x512 points in screen order, nearest hits along bundles, in turns:
///
///     cargo test --test visibility -- --ignored --nocapture look_ups
#[test]
#[ignore = "a matter of the clock"]
fn look_ups_a_second() {
    const SIDE: u32 = 512;
    let Some(gpu) = common::gpu() else { return };
    let mut scenes = vec![
        ("Cornell box", cornell()),
        ("displaced room, 60,000", scene::builtin::load("displaced_room:60000").unwrap()),
    ];
    if let Some(shared) = common::shared() {
        let path = shared.join("scenes/gltf/Sponza/glTF/Sponza.gltf");
        scenes.push(("Sponza", staging::load(&path.display().to_string(), &Staging::default()).unwrap()));
    }
    println!("| scene | texels x slabs | nodes | million a second, median | best |\n|---|---|---|---|---|");
    for (name, scene) in &scenes {
        let harness = VisibilityHarness::new(gpu, scene, false);
        let camera = &scene.cameras[0];
        let half = camera.half_extent(SIDE, SIDE);
        let points: Vec<_> = (0..SIDE * SIDE)
            .filter_map(|n| {
                let ndc = (Vec2::new((n % SIDE) as f32, (n / SIDE) as f32) + 0.5) / SIDE as f32 * 2.0 - 1.0;
                let towards = (Vec2::new(ndc.x, -ndc.y) * half).extend(-1.0);
                let origin = camera.world_from_camera.transform_point3(Vec3::ZERO);
                let direction = camera.world_from_camera.transform_vector3(towards).normalize();
                let hit = harness.reference.closest_hit(origin, direction, None)?;
                Some((origin + direction * hit.t, hit.triangle))
            })
            .collect();
        let mut random = Random(1);
        let forwards = [(); 3].map(|()| uniform_sphere(random.pair()));
        let mut kept = Vec::new();
        for (resolution, slabs) in [(128, 1), (256, 1), (256, 8), (512, 1), (512, 8), (512, 32), (1024, 1)] {
            let texels = Texels { resolution, faces: 1, slabs };
            let looks = forwards.map(|forward| parallel(forward, harness.scene.bounds, 0.4, None, resolution));
            let views = looks.map(|look| harness.fill_texels(&look, texels));
            let nodes = views.iter().map(|(_, nodes)| nodes / 3).sum::<u32>();
            let questions = forwards.map(|forward| {
                let normal = |triangle: u32| {
                    let [a, b, c] = harness.geometry().positions(triangle as usize);
                    (b - a).cross(c - a)
                };
                points.iter().map(|&(p, t)| query(p, t, normal(t).dot(forward) < 0.0)).collect::<Vec<_>>()
            });
            kept.push((texels, views, questions, nodes, Vec::new()));
        }
        for _ in 0..5 {
            for (_, views, questions, _, seconds) in &mut kept {
                let each = views.iter().zip(&*questions).map(|((view, _), questions)| harness.seconds(view, questions));
                seconds.push(each.sum::<f64>() / 3.0);
            }
        }
        for (Texels { resolution, slabs, .. }, _, _, nodes, seconds) in &mut kept {
            seconds.sort_by(f64::total_cmp);
            let [best, median] = [seconds[0], seconds[2]].map(|s| points.len() as f64 / s * 1e-6);
            let chosen = [*resolution, *slabs] == [harness.plan.bundle_resolution, harness.plan.bundle_slabs];
            println!(
                "| {name} | {resolution}^2 x {slabs}{} | {nodes} | {median:.1} | {best:.1} |",
                if chosen { " (chosen)" } else { "" }
            );
        }
    }
}
