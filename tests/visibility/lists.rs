//! Lists of triangles and depth maps: exact answers are the CPU's, and fast ones nearly so.

use glam::Vec3;
use lightsheaf::render::layouts;
use lightsheaf::render::sampler::uniform_sphere;
use lightsheaf::render::visibility::view::{Texels, parallel};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

use crate::agreement::{Class, HEAD, SAME, TOLERATED, Tally, compare_nearest};
use crate::common::harness::{NONE, Point, Points, VisibilityHarness, perspective, query};
use crate::common::random::Random;
use crate::{common, cornell, displaced_room};

/// Compares nearest hits along bundles, in both directions.
fn bundles(harness: &VisibilityHarness, count: usize, views: usize, random: &mut Random) -> Tally {
    let points = Points::new(harness.geometry());
    let mut tally = Tally::default();
    for _ in 0..views {
        let forward = uniform_sphere(random.pair());
        let turn = random.unit() * std::f32::consts::TAU;
        let resolution = harness.plan.bundle_resolution;
        let shift = Some(random.pair()).filter(|_| harness.plan.fast);
        let (view, _) = harness.fill(&parallel(forward, harness.scene.bounds, turn, shift, resolution), resolution);
        let asked: Vec<(Point, bool)> =
            (0..count / views).map(|_| (points.draw(random), random.bits() & 1 == 1)).collect();
        let queries: Vec<_> = asked.iter().map(|(p, against)| query(p.position, p.triangle, *against)).collect();
        let answers = harness.query(&view, &queries);
        let rays: Vec<_> = asked
            .iter()
            .map(|(p, against)| (p.position, if *against { -forward } else { forward }, p.triangle))
            .collect();
        compare_nearest(harness, &mut tally, &rays, &answers, !harness.plan.fast);
    }
    tally
}

/// Returns origins of views: on surfaces, as for VPLs, and in free space, as for lights.
fn origins(harness: &VisibilityHarness, views: usize, random: &mut Random) -> Vec<(layouts::View, u32)> {
    let points = Points::new(harness.geometry());
    let [low, high] = harness.scene.bounds;
    (0..views)
        .map(|i| {
            if i % 2 == 0 {
                let point = points.draw(random);
                let [a, b, c] = harness.geometry().positions(point.triangle as usize);
                let normal = (b - a).cross(c - a).normalize();
                // The view is on the side that most of the scene lies on, since the other side of a wall sees
                // nothing.
                let in_front = (0..64).filter(|_| normal.dot(points.draw(random).position - point.position) > 0.0);
                let normal = if in_front.count() >= 32 { normal } else { -normal };
                let view = layouts::View {
                    exclude: point.triangle,
                    normal: normal.to_array(),
                    ..perspective(point.position, harness.radius)
                };
                (view, point.triangle)
            } else {
                let at = Vec3::new(random.unit(), random.unit(), random.unit());
                (perspective(low + (high - low) * at, harness.radius), NONE)
            }
        })
        .collect()
}

/// Compares nearest hits from many origins, and edges to points.
fn edges(harness: &VisibilityHarness, count: usize, views: usize, random: &mut Random) -> [Tally; 2] {
    let points = Points::new(harness.geometry());
    let (mut nearest, mut edges) = (Tally::default(), Tally::default());
    for (look, own) in origins(harness, views, random) {
        let (origin, normal) = (Vec3::from(look.origin), Vec3::from(look.normal));
        let resolution = if own == NONE { harness.plan.light_resolution } else { harness.plan.vpl_resolution };
        let (view, _) = harness.fill(&look, resolution);
        // Only points in front of a surface are queried, and never a triangle about itself.
        let in_front = |d: Vec3| own == NONE || normal.dot(d) > 0.0;

        let mut targets = Vec::new();
        for _ in 0..64 * count / views {
            let point = points.draw(random);
            if point.triangle != own && in_front(point.position - origin) {
                targets.push(point);
            }
            if targets.len() == count / views {
                break;
            }
        }
        let queries: Vec<_> = targets.iter().map(|p| query(p.position, p.triangle, false)).collect();
        let answers = if queries.is_empty() { Vec::new() } else { harness.query(&view, &queries) };
        let hidden: Vec<bool> = targets
            .par_iter()
            .map(|p| harness.reference.occluded(origin, p.position, (own != NONE).then_some(own), Some(p.triangle)))
            .collect();
        edges.asked += answers.len();
        for ((answer, &hidden), point) in answers.iter().zip(&hidden).zip(&targets) {
            if (answer[0] == 0) != hidden {
                let ends = [own, point.triangle];
                let class =
                    if harness.plan.fast { Class::Centre } else { harness.classify_edge(origin, point.position, ends) };
                edges.count(!hidden, class, || {
                    format!("{origin} to {} on {}, from {own}", point.position, point.triangle)
                });
            }
        }

        let directions: Vec<Vec3> = std::iter::repeat_with(|| uniform_sphere(random.pair()))
            .filter(|&d| in_front(d))
            .take(count / views)
            .collect();
        let queries: Vec<_> = directions.iter().map(|&d| query(origin + d, 0, true)).collect();
        let answers = harness.query(&view, &queries);
        // The direction is rounded as in the shader.
        let rays: Vec<_> = directions.iter().map(|&d| (origin, ((origin + d) - origin).normalize(), own)).collect();
        compare_nearest(harness, &mut nearest, &rays, &answers, !harness.plan.fast);
    }
    [nearest, edges]
}

/// Returns all three tallies of a scene.
pub fn tallies(harness: &VisibilityHarness, count: usize, views: usize, seed: u64) -> [(&'static str, Tally); 3] {
    let mut random = Random(seed);
    let along = bundles(harness, count, views, &mut random);
    let [nearest, edges] = edges(harness, count, views, &mut random);
    [("nearest along bundles", along), ("nearest from a point", nearest), ("edges", edges)]
}

#[test]
fn exact_answers_are_the_cpus() {
    let Some(gpu) = common::gpu() else { return };
    println!("{HEAD}");
    for (name, scene) in [("Cornell box", cornell()), ("displaced room", displaced_room(60_000))] {
        let harness = VisibilityHarness::new(gpu, &scene, false);
        for (what, tally) in tallies(&harness, 100_000, 8, 1) {
            println!("{}", tally.row(name, what));
            println!("{}", tally.examples.join("\n"));
            assert!(tally.asked >= 90_000, "only {} asked", tally.asked);
            assert!(tally.share() <= TOLERATED, "{name}, {what}: {tally:?}");
            assert!(!tally.classes.contains_key(&Class::Unexplained), "{name}, {what}: {tally:?}");
        }
    }
}

#[test]
fn exact_answers_do_not_depend_on_the_resolution() {
    let Some(gpu) = common::gpu() else { return };
    let scene = displaced_room(6_000);
    let harness = VisibilityHarness::new(gpu, &scene, false);
    let points = Points::new(harness.geometry());
    let mut random = Random(7);
    let asked: Vec<Point> = (0..20_000).map(|_| points.draw(&mut random)).collect();
    let forward = Vec3::new(0.3, -0.5, 0.8).normalize();
    let from = points.draw(&mut random);
    let mut answers = Vec::new();
    let mut nodes = Vec::new();
    for (resolution, slabs) in [(64, 4), (128, 1), (256, 3), (512, 16)] {
        let texels = Texels { resolution, faces: 1, slabs };
        let (bundle, along_bundle) =
            harness.fill_texels(&parallel(forward, harness.scene.bounds, 0.4, None, resolution), texels);
        let (around, around_point) = harness
            .fill(&layouts::View { exclude: from.triangle, ..perspective(from.position, harness.radius) }, resolution);
        let along =
            asked.iter().enumerate().map(|(i, p)| query(p.position, p.triangle, i % 2 == 0)).collect::<Vec<_>>();
        let edges = asked.iter().map(|p| query(p.position, p.triangle, false)).collect::<Vec<_>>();
        let nearest = asked.iter().map(|p| query(p.position, p.triangle, true)).collect::<Vec<_>>();
        answers.push([
            harness.query(&bundle, &along),
            harness.query(&around, &edges),
            harness.query(&around, &nearest),
        ]);
        nodes.push([along_bundle, around_point]);
    }
    assert!(nodes.windows(2).all(|w| w[0][0] < w[1][0] && w[0][1] < w[1][1]), "the grids are the same: {nodes:?}");
    for (kind, what) in ["nearest along a bundle", "edges", "nearest from a point"].iter().enumerate() {
        let mut kinds: Vec<u32> = answers[0][kind].iter().map(|a| a[0]).collect();
        kinds.sort_unstable();
        kinds.dedup();
        assert!(kinds.len() >= 2, "{what}: all answers are the same");
        for other in &answers[1..] {
            let differ = answers[0][kind].iter().zip(&other[kind]).filter(|(a, b)| {
                let near = (f32::from_bits(a[1]) - f32::from_bits(b[1])).abs() <= SAME * harness.radius;
                a[0] != b[0] && !(near && kind != 1)
            });
            let differ = differ.count();
            assert!(differ == 0, "{what}: {differ} of {} differ", asked.len());
        }
    }
}

/// The comparison finds planted errors: rays of another direction, missing answers, fast lists.
#[test]
fn wrong_answers_are_found() {
    let Some(gpu) = common::gpu() else { return };
    let scene = cornell();
    let harness = VisibilityHarness::new(gpu, &scene, false);
    let points = Points::new(harness.geometry());
    let mut random = Random(3);
    let forward = Vec3::new(0.2, 0.9, -0.4).normalize();
    let (view, _) = harness.fill(&parallel(forward, harness.scene.bounds, 0.0, None, 128), 128);
    let asked: Vec<Point> = (0..20_000).map(|_| points.draw(&mut random)).collect();
    let answers = harness.query(&view, &asked.iter().map(|p| query(p.position, p.triangle, false)).collect::<Vec<_>>());
    let differ = |direction: Vec3, answers: &[[u32; 2]]| {
        let rays: Vec<_> = asked.iter().map(|p| (p.position, direction, p.triangle)).collect();
        let mut tally = Tally::default();
        compare_nearest(&harness, &mut tally, &rays, answers, true);
        tally
    };
    assert!(differ(forward, &answers).share() <= TOLERATED);
    let turned = differ((forward + Vec3::X * 0.01).normalize(), &answers);
    assert!(turned.share() > 2.0 * TOLERATED, "{turned:?}");
    // One answer in five hundred is lost.
    let mut lossy = answers.clone();
    lossy.iter_mut().step_by(500).for_each(|a| *a = [NONE, 0]);
    let lossy = differ(forward, &lossy);
    assert!(lossy.share() > TOLERATED && lossy.classes.get(&Class::Unexplained).is_some_and(|&n| n > 15), "{lossy:?}");
    // Centre-sampled lists are not exact.
    let fast = VisibilityHarness::new(gpu, &scene, true);
    let [(_, along), _, (_, edges)] = tallies(&fast, 20_000, 4, 5);
    assert!(along.share() > TOLERATED && edges.share() > TOLERATED, "{along:?} {edges:?}");
    assert!(along.share() < 0.2 && edges.share() < 0.2, "{along:?} {edges:?}");
}

/// In fast mode a ray passes beside triangles that cover its texel's centre, and may never reach the plane of
/// one seen edge-on.
#[test]
fn fast_hits_lie_in_the_scene() {
    let Some(gpu) = common::gpu() else { return };
    let scene = displaced_room(60_000);
    let harness = VisibilityHarness::new(gpu, &scene, true);
    let points = Points::new(harness.geometry());
    let mut random = Random(11);
    let mut hits = 0;
    for _ in 0..16 {
        let look = parallel(uniform_sphere(random.pair()), harness.scene.bounds, 0.0, Some(random.pair()), 128);
        let (view, _) = harness.fill(&look, 128);
        let asked: Vec<Point> = (0..20_000).map(|_| points.draw(&mut random)).collect();
        let queries: Vec<_> = asked.iter().map(|p| query(p.position, p.triangle, false)).collect();
        for answer in harness.query(&view, &queries).iter().filter(|answer| answer[0] != NONE) {
            let distance = f32::from_bits(answer[1]);
            assert!(distance <= 2.0 * harness.radius, "{distance} m away in a scene of radius {}", harness.radius);
            hits += 1;
        }
    }
    assert!(hits > 100_000, "only {hits} hits");
}
