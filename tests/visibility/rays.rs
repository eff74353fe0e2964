//! Ray queries: nearest hits, edges and infinity are the CPU's.

use glam::Vec3;
use lightsheaf::gpu::Flag;
use lightsheaf::render::sampler::uniform_sphere;
use lightsheaf::scene::{self, Instance, Material, Mesh, Scene};

use crate::agreement::{Class, HEAD, TOLERATED, Tally, compare_nearest};
use crate::common::harness::{NONE, Point, Points, VisibilityHarness};
use crate::common::random::Random;
use crate::common::shaders::RayQuestion;
use crate::{common, cornell, displaced_room, masked_room};

/// Kinds of queries in tests/shaders/ray_queries.wesl.
const ASK_NEAREST: u32 = 0;
const ASK_EDGE: u32 = 1;
const ASK_INFINITY: u32 = 2;
const ASK_CAMERA: u32 = 3;

fn ray_question(kind: u32, p: Point, towards: Vec3, end: u32) -> RayQuestion {
    RayQuestion {
        position: p.position.to_array(),
        own: p.triangle,
        towards: towards.to_array(),
        end,
        kind,
        ..Default::default()
    }
}

/// Compares nearest hits, edges, and visibility of infinity by ray queries.
fn ray_tallies(harness: &VisibilityHarness, count: usize, seed: u64) -> [(&'static str, Tally); 3] {
    let points = Points::new(harness.geometry());
    let mut random = Random(seed);
    let (mut nearest, mut edges, mut infinity) = (Tally::default(), Tally::default(), Tally::default());
    let rays: Vec<(Point, Vec3)> =
        (0..count).map(|_| (points.draw(&mut random), uniform_sphere(random.pair()))).collect();
    let ask = |kind| {
        let queries: Vec<_> = rays.iter().map(|&(p, w)| ray_question(kind, p, w, NONE)).collect();
        harness.query_rays(&queries)
    };
    let expected: Vec<_> = rays.iter().map(|&(p, w)| (p.position, w, p.triangle)).collect();
    compare_nearest(harness, &mut nearest, &expected, &ask(ASK_NEAREST), true);

    let seen: Vec<[u32; 2]> = ask(ASK_INFINITY).iter().map(|a| [if a[0] == 1 { NONE } else { 0 }, 0]).collect();
    infinity.asked = count;
    for (answer, &(from, direction, own)) in seen.iter().zip(&expected) {
        let hit = harness.reference.closest_hit(from, direction, Some(own));
        if (answer[0] == NONE) != hit.is_none() {
            let met = hit.map_or(NONE, |h| h.triangle);
            let class = if met == NONE {
                harness.classify_edge(from, from + direction * 4.0 * harness.radius, [own, NONE])
            } else {
                let reach = f64::from(harness.radius);
                harness.classify(met, from.as_dvec3(), direction.as_dvec3(), f64::INFINITY, reach, [own, NONE])
            };
            infinity.count(hit.is_none(), class, || format!("{from} {direction} from {own}: CPU met {met}"));
        }
    }

    let ends: Vec<(Point, Point)> = std::iter::repeat_with(|| (points.draw(&mut random), points.draw(&mut random)))
        .filter(|(p, q)| p.triangle != q.triangle)
        .take(count)
        .collect();
    let queries: Vec<_> = ends.iter().map(|(p, q)| ray_question(ASK_EDGE, *p, q.position, q.triangle)).collect();
    edges.asked = count;
    for (answer, (p, q)) in harness.query_rays(&queries).iter().zip(&ends) {
        let hidden = harness.reference.occluded(p.position, q.position, Some(p.triangle), Some(q.triangle));
        if (answer[0] == 0) != hidden {
            let class = harness.classify_edge(p.position, q.position, [p.triangle, q.triangle]);
            edges.count(!hidden, class, || {
                format!("{} on {} to {} on {}", p.position, p.triangle, q.position, q.triangle)
            });
        }
    }
    [("nearest by ray query", nearest), ("edges by ray query", edges), ("infinity by ray query", infinity)]
}

#[test]
fn ray_queries_answer_as_the_cpu() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    println!("{HEAD}");
    let scenes =
        [("Cornell box", cornell()), ("displaced room", displaced_room(60_000)), ("masked room", masked_room())];
    for (name, scene) in scenes {
        let harness = VisibilityHarness::new(gpu, &scene, false);
        assert_eq!(
            scene.materials.len() > 1 && name == "masked room",
            harness.plan.surface_flags.contains(&Flag::Masks)
        );
        for (what, tally) in ray_tallies(&harness, 100_000, 1) {
            println!("{}", tally.row(name, what));
            println!("{}", tally.examples.join("\n"));
            assert_eq!(tally.asked, 100_000);
            assert!(tally.share() <= TOLERATED, "{name}, {what}: {tally:?}");
            assert!(!tally.classes.contains_key(&Class::Unexplained), "{name}, {what}: {tally:?}");
        }
    }
}

/// Missing holes and a wrong direction are found.
#[test]
fn wrong_ray_queries_are_found() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    let masked = masked_room();
    let filled = Scene { materials: vec![masked.materials[0].clone(); 2], ..masked.clone() };
    let harnesses = [&masked, &filled].map(|scene| VisibilityHarness::new(gpu, scene, false));
    let points = Points::new(harnesses[0].geometry());
    let mut random = Random(5);
    let asked: Vec<_> = (0..20_000).map(|_| (points.draw(&mut random), uniform_sphere(random.pair()))).collect();
    let queries: Vec<_> = asked.iter().map(|&(p, w)| ray_question(ASK_NEAREST, p, w, NONE)).collect();
    let rays: Vec<_> = asked.iter().map(|(p, w)| (p.position, *w, p.triangle)).collect();
    let share = |answers: &[[u32; 2]], turn: f32| {
        let mut tally = Tally::default();
        let rays: Vec<_> = rays.iter().map(|&(p, w, own)| (p, (w + Vec3::X * turn).normalize(), own)).collect();
        compare_nearest(&harnesses[0], &mut tally, &rays, answers, true);
        tally.share()
    };
    let right = harnesses[0].query_rays(&queries);
    assert!(share(&right, 0.0) <= TOLERATED);
    assert!(share(&right, 0.01) > 2.0 * TOLERATED, "turned rays");
    assert!(share(&harnesses[1].query_rays(&queries), 0.0) > 0.05, "no holes");
}

/// Two sheets lie in one plane, and the nearer one is culled: the camera sees the other one.
#[test]
fn the_camera_sees_through_culled_backs() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    let corners = [Vec3::NEG_ONE, Vec3::new(3.0, -1.0, -1.0), Vec3::new(-1.0, 3.0, -1.0)];
    let sheet = |material, triangle| Mesh {
        positions: corners.to_vec(),
        triangles: vec![triangle],
        material,
        ..Mesh::default()
    };
    let wall = Material::diffuse("wall", Vec3::ONE);
    let scene = Scene {
        materials: vec![Material { sides: scene::Sides::OneCulled, ..wall.clone() }, wall],
        meshes: vec![sheet(0, [0, 2, 1]), sheet(1, [0, 1, 2])],
        instances: (0..2).map(|mesh| Instance { mesh, world_from_local: glam::Affine3A::IDENTITY }).collect(),
        ..Scene::default()
    };
    let harness = VisibilityHarness::new(gpu, &scene, false);
    let from = |z| Point { position: Vec3::new(-0.5, -0.4, z), triangle: NONE };
    let ask = |kind, z: f32| ray_question(kind, from(z), Vec3::Z * -z.signum(), NONE);
    let answers = harness.query_rays(&[
        ask(ASK_CAMERA, 1.0),
        ask(ASK_CAMERA, -3.0),
        ray_question(ASK_CAMERA, from(-3.0), Vec3::Z, NONE),
    ]);
    assert_eq!(answers[0][0], 1, "the culled back lets the ray pass");
    assert_eq!(f32::from_bits(answers[0][1]), 2.0);
    assert!(answers[1][0] <= 1 && answers[2] == answers[1], "the culled front does not: {answers:?}");
}
