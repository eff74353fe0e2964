//! Rays by every algorithm: nearest hits, edges and infinity are the CPU's.

use glam::Vec3;
use lightsheaf::gpu::{Flag, Gpu};
use lightsheaf::render::sampler::uniform_sphere;
use lightsheaf::render::visibility::grid::frame_of;
use lightsheaf::render::visibility::tracer::Tracing;
use lightsheaf::scene::{self, Instance, Material, Mesh, Scene};

use crate::agreement::{Class, HEAD, TOLERATED, Tally, compare_nearest};
use crate::common::harness::{NONE, Point, Points, VisibilityHarness};
use crate::common::random::Random;
use crate::common::shaders::RayQuestion;
use crate::{common, cornell, displaced_room, masked_room};

/// Kinds of queries in tests/shaders/ray_queries.wesl.
pub const ASK_NEAREST: u32 = 0;
pub const ASK_EDGE: u32 = 1;
const ASK_INFINITY: u32 = 2;
const ASK_CAMERA: u32 = 3;

pub fn ray_question(kind: u32, p: Point, towards: Vec3, end: u32) -> RayQuestion {
    RayQuestion {
        position: p.position.to_array(),
        own: p.triangle,
        towards: towards.to_array(),
        end,
        kind,
        ..Default::default()
    }
}

/// Returns a device that traces rays in this way.
fn device(tracing: Tracing) -> Option<&'static Gpu> {
    if tracing == Tracing::RayQuery { common::gpu_with_ray_queries() } else { common::gpu() }
}

/// Compares answers to queries of [`ASK_EDGE`] with the CPU's.
pub fn compare_edges(harness: &VisibilityHarness, queries: &[RayQuestion], answers: &[[u32; 2]]) -> Tally {
    let mut tally = Tally::default();
    tally.asked = queries.len();
    for (answer, q) in answers.iter().zip(queries) {
        let [from, to] = [q.position, q.towards].map(Vec3::from);
        let hidden = harness.reference.occluded(from, to, Some(q.own), Some(q.end));
        if (answer[0] == 0) != hidden {
            let class = harness.classify_edge(from, to, [q.own, q.end]);
            tally.count(!hidden, class, || format!("{from} on {} to {to} on {}", q.own, q.end));
        }
    }
    tally
}

/// True for points on two triangles, though they may lie in one plane.
fn on_two(p: Point, q: Point) -> bool {
    p.triangle != q.triangle
}

/// Compares nearest hits, edges, and visibility of infinity. Edges are asked between the points that `joins` accepts.
pub fn ray_tallies(
    harness: &VisibilityHarness,
    tracing: Tracing,
    count: usize,
    seed: u64,
    joins: impl Fn(Point, Point) -> bool,
) -> [(&'static str, Tally); 3] {
    let points = Points::new(harness.geometry());
    let mut random = Random(seed);
    let (mut nearest, mut infinity) = (Tally::default(), Tally::default());
    let rays: Vec<(Point, Vec3)> =
        (0..count).map(|_| (points.draw(&mut random), uniform_sphere(random.pair()))).collect();
    let ask = |kind| {
        let queries: Vec<_> = rays.iter().map(|&(p, w)| ray_question(kind, p, w, NONE)).collect();
        harness.query_rays(tracing, &queries)
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
        .filter(|(p, q)| joins(*p, *q))
        .take(count)
        .collect();
    let queries: Vec<_> = ends.iter().map(|(p, q)| ray_question(ASK_EDGE, *p, q.position, q.triangle)).collect();
    let edges = compare_edges(harness, &queries, &harness.query_rays(tracing, &queries));
    [("nearest", nearest), ("edges", edges), ("infinity", infinity)]
}

fn answers_are_the_cpus(tracing: Tracing) {
    let Some(gpu) = device(tracing) else { return };
    println!("{HEAD}");
    let scenes =
        [("Cornell box", cornell()), ("displaced room", displaced_room(60_000)), ("masked room", masked_room())];
    for (name, scene) in scenes {
        let harness = VisibilityHarness::new(gpu, &scene, false);
        assert_eq!(
            scene.materials.len() > 1 && name == "masked room",
            harness.plan.surface_flags.contains(&Flag::Masks)
        );
        for (what, tally) in ray_tallies(&harness, tracing, 100_000, 1, on_two) {
            let what = format!("{what} by {tracing:?}");
            println!("{}", tally.row(name, &what));
            println!("{}", tally.examples.join("\n"));
            assert_eq!(tally.asked, 100_000);
            assert!(tally.share() <= TOLERATED, "{name}, {what}: {tally:?}");
            assert!(!tally.classes.contains_key(&Class::Unexplained), "{name}, {what}: {tally:?}");
        }
    }
}

#[test]
fn ray_queries_answer_as_the_cpu() {
    answers_are_the_cpus(Tracing::RayQuery);
}

#[test]
fn hierarchies_answer_as_the_cpu() {
    answers_are_the_cpus(Tracing::Bvh);
}

#[test]
fn grids_answer_as_the_cpu() {
    answers_are_the_cpus(Tracing::Grid);
}

/// Returns triangles in a room, each by its corners.
fn soup(triangles: Vec<[Vec3; 3]>) -> Scene {
    let positions = triangles.concat();
    let triangles = (0..triangles.len() as u32).map(|n| [3 * n, 3 * n + 1, 3 * n + 2]).collect();
    Scene {
        materials: vec![Material::diffuse("wall", Vec3::ONE)],
        meshes: vec![Mesh { positions, triangles, ..Mesh::default() }],
        instances: vec![Instance { mesh: 0, world_from_local: glam::Affine3A::IDENTITY }],
        ..Scene::default()
    }
}

/// Returns thin and long triangles in all directions, and some that are points and lines.
pub fn needles() -> Scene {
    let mut random = Random(7);
    let mut needle = || {
        let at = Vec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        let along = uniform_sphere(random.pair()) * (0.1 + 0.9 * random.unit());
        [at, at + along, at + along * 0.5 + uniform_sphere(random.pair()) * 1e-3]
    };
    let flat = [[Vec3::ZERO; 3], [Vec3::ZERO, Vec3::X, Vec3::X * 0.5]];
    soup((0..20_000).map(|_| needle()).chain(flat).collect())
}

/// Returns a ball of 20,000 triangles, 1 cm wide, in a hall of 100 m.
pub fn small_in_large() -> Scene {
    let mut scene = displaced_room(20_000);
    scene.meshes[0].positions.iter_mut().for_each(|p| *p = *p * 5e-3 + Vec3::new(31.0, -7.0, 12.0));
    let side = |axis: usize, end: f32| {
        let corner = |u: f32, v: f32| {
            let mut p = Vec3::ZERO;
            (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (50.0 * end, 50.0 * u, 50.0 * v);
            p
        };
        [
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)],
            [corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        ]
    };
    let hall = soup((0..3).flat_map(|axis| [side(axis, -1.0), side(axis, 1.0)]).flatten().collect());
    scene.meshes.extend(hall.meshes);
    scene.instances.push(Instance { mesh: 1, world_from_local: glam::Affine3A::IDENTITY });
    scene
}

/// Returns a scene in another size.
fn scaled(mut scene: Scene, scale: f32) -> Scene {
    scene
        .instances
        .iter_mut()
        .for_each(|i| i.world_from_local = glam::Affine3A::from_scale(Vec3::splat(scale)) * i.world_from_local);
    scene
}

/// Rays along axes, along borders of cells, in planes of walls and from far outside, in scenes of all sizes and
/// of triangles of very different sizes.
#[test]
fn grids_are_robust() {
    let Some(gpu) = device(Tracing::Grid) else { return };
    println!("{HEAD}");
    let scenes = [
        ("needles", needles()),
        ("small in large", small_in_large()),
        ("a micron", scaled(cornell(), 1e-6)),
        ("a thousand kilometres", scaled(cornell(), 1e6)),
    ];
    for (name, scene) in &scenes {
        let harness = VisibilityHarness::new(gpu, scene, false);
        for (what, tally) in ray_tallies(&harness, Tracing::Grid, 50_000, 2, on_two) {
            println!("{}\n{}", tally.row(name, what), tally.examples.join("\n"));
            assert!(tally.share() <= TOLERATED, "{name}, {what}: {tally:?}");
            assert!(!tally.classes.contains_key(&Class::Unexplained), "{name}, {what}: {tally:?}");
        }
        let [low, high] = harness.scene.bounds;
        let (size, mut random) = (high - low, Random(9));
        // Multiples of a 64th of the box, of which many lie on borders of cells and in planes of walls.
        let mut border = || low + size * Vec3::from([0; 3].map(|_| random.below(65) as f32 / 64.0));
        let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
        let diagonal = Vec3::new(1.0, 1.0, 0.0).normalize();
        let rays: Vec<(Vec3, Vec3, u32)> = (0..30_000)
            .map(|n| match n % 8 {
                axis @ 0..6 => (border(), axes[axis], NONE),
                6 => (border(), diagonal, NONE),
                _ => {
                    let from = low + (border() - low) * 0.5 + Vec3::new(-80.0, 24.0, 36.0) * size.max_element();
                    (from, (border() - from).normalize(), NONE)
                }
            })
            .collect();
        let asked: Vec<_> = rays
            .iter()
            .map(|&(p, w, own)| ray_question(ASK_NEAREST, Point { position: p, triangle: own }, w, NONE))
            .collect();
        let mut tally = Tally::default();
        compare_nearest(&harness, &mut tally, &rays, &harness.query_rays(Tracing::Grid, &asked), true);
        println!("{}\n{}", tally.row(name, "odd rays"), tally.examples.join("\n"));
        assert!(!tally.classes.contains_key(&Class::Unexplained), "{name}, odd rays: {tally:?}");
    }
}

/// Rays that enter a cell on the border of two sub-cells of the one before: two of its planes are met at once, of
/// which one leaves a sub-cell alone.
#[test]
fn grids_miss_nothing_behind_edges_of_cells() {
    let Some(gpu) = device(Tracing::Grid) else { return };
    let scene = displaced_room(60_000);
    let harness = VisibilityHarness::new(gpu, &scene, false);
    let frame = frame_of(&harness.scene.traced(), &gpu.capabilities);
    let (low, scale) = (Vec3::from(frame.low).as_dvec3(), f64::from(frame.scale));
    let (points, mut random) = (Points::new(harness.geometry()), Random(3));
    let mut through_an_edge = |n: usize| {
        let w = uniform_sphere(random.pair());
        // In cells: back from a point of a surface to where the ray entered its cell, and aside to a border of sub-cells.
        let end = (points.draw(&mut random).position.as_dvec3() - low) * scale;
        let (entered, aside) = (n % 3, (n + 1 + n / 3 % 2) % 3);
        let side = (3 + n / 6 % 4) as f64;
        let plane = if w[entered] > 0.0 { end[entered].floor() } else { end[entered].ceil() };
        let mut edge = end - w.as_dvec3() * ((end[entered] - plane) / f64::from(w[entered]));
        edge[aside] = (edge[aside] * side).round() / side;
        let from = edge - w.as_dvec3() * 2.0 * f64::from(random.unit());
        ((low + from / scale).as_vec3(), w, NONE)
    };
    let rays: Vec<_> = (0..200_000).map(&mut through_an_edge).collect();
    let asked: Vec<_> = rays
        .iter()
        .map(|&(position, w, triangle)| ray_question(ASK_NEAREST, Point { position, triangle }, w, NONE))
        .collect();
    let mut tally = Tally::default();
    compare_nearest(&harness, &mut tally, &rays, &harness.query_rays(Tracing::Grid, &asked), true);
    println!("{HEAD}\n{}\n{}", tally.row("displaced room", "through edges"), tally.examples.join("\n"));
    assert!(!tally.classes.contains_key(&Class::Unexplained), "{tally:?}");
}

/// Missing holes and a wrong direction are found.
fn wrong_rays_are_found_by(tracing: Tracing) {
    let Some(gpu) = device(tracing) else { return };
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
    let right = harnesses[0].query_rays(tracing, &queries);
    assert!(share(&right, 0.0) <= TOLERATED);
    assert!(share(&right, 0.01) > 2.0 * TOLERATED, "turned rays");
    assert!(share(&harnesses[1].query_rays(tracing, &queries), 0.0) > 0.05, "no holes");
}

#[test]
fn wrong_ray_queries_are_found() {
    wrong_rays_are_found_by(Tracing::RayQuery);
}

#[test]
fn wrong_hierarchies_are_found() {
    wrong_rays_are_found_by(Tracing::Bvh);
}

#[test]
fn wrong_grids_are_found() {
    wrong_rays_are_found_by(Tracing::Grid);
}

/// Two sheets lie in one plane, and the nearer one is culled: the camera sees the other one.
fn the_camera_sees_through_culled_backs_by(tracing: Tracing) {
    let Some(gpu) = device(tracing) else { return };
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
    let answers = harness.query_rays(
        tracing,
        &[ask(ASK_CAMERA, 1.0), ask(ASK_CAMERA, -3.0), ray_question(ASK_CAMERA, from(-3.0), Vec3::Z, NONE)],
    );
    assert_eq!(answers[0][0], 1, "the culled back lets the ray pass");
    assert_eq!(f32::from_bits(answers[0][1]), 2.0);
    assert!(answers[1][0] <= 1 && answers[2] == answers[1], "the culled front does not: {answers:?}");
}

#[test]
fn the_camera_sees_through_culled_backs() {
    the_camera_sees_through_culled_backs_by(Tracing::RayQuery);
}

#[test]
fn the_camera_sees_through_culled_backs_by_a_grid() {
    the_camera_sees_through_culled_backs_by(Tracing::Grid);
}

#[test]
fn the_camera_sees_through_culled_backs_by_a_hierarchy() {
    the_camera_sees_through_culled_backs_by(Tracing::Bvh);
}
