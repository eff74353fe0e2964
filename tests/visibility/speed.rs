//! Rays per second of each algorithm, and the milliseconds that its data structure takes to build.
//!
//!     cargo test --test visibility -- --ignored --nocapture rays_a_second
//!
//! `SCENES=Sponza,Cornell` and `TRACERS=Grid,Bvh` restrict the table to names that contain one of these.

use std::f32::consts::TAU;
use std::time::Instant;

use glam::{Vec2, Vec3};
use lightsheaf::render::visibility::tracer::Tracing;
use lightsheaf::scene::{self, Opacity, Scene};
use lightsheaf::staging::{self, Staging};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

use crate::agreement::{Tally, compare_nearest};
use crate::common::harness::{NONE, Point, VisibilityHarness};
use crate::common::random::Random;
use crate::common::shaders::RayQuestion;
use crate::rays::{ASK_EDGE, ASK_NEAREST, compare_edges, ray_question};
use crate::{common, cornell};

/// Rays along each side of the picture, a multiple of [`TILE`].
const SIDE: u32 = 512;
/// Pixels along each side of a tile; a workgroup traces a tile's rays.
const TILE: u32 = 8;
/// Runs that a median is taken of.
const RUNS: usize = 5;

/// A point that a pixel sees.
struct Seen {
    point: Point,
    /// Unit direction that the ray came along, and unit normal against it.
    along: Vec3,
    normal: Vec3,
}

/// Returns the points that pixels see, tile after tile.
fn seen(harness: &VisibilityHarness) -> Vec<Seen> {
    let camera = &harness.source.cameras[0];
    let half = camera.half_extent(SIDE, SIDE);
    let origin = camera.world_from_camera.transform_point3(Vec3::ZERO);
    let of_pixel = |n: &u32| {
        let (tile, within) = (n / (TILE * TILE), n % (TILE * TILE));
        let x = tile % (SIDE / TILE) * TILE + within % TILE;
        let y = tile / (SIDE / TILE) * TILE + within / TILE;
        let ndc = (Vec2::new(x as f32, y as f32) + 0.5) / SIDE as f32 * 2.0 - 1.0;
        let towards = (Vec2::new(ndc.x, -ndc.y) * half).extend(-1.0);
        let along = camera.world_from_camera.transform_vector3(towards).normalize();
        let hit = harness.reference.closest_hit(origin, along, None)?;
        let [a, b, c] = harness.geometry().positions(hit.triangle as usize);
        let normal = (b - a).cross(c - a).normalize();
        let normal = if normal.dot(along) < 0.0 { normal } else { -normal };
        let point = Point { position: hit.mix([a, b, c]), triangle: hit.triangle };
        Some(Seen { point, along, normal })
    };
    (0..SIDE * SIDE).collect::<Vec<_>>().par_iter().filter_map(of_pixel).collect()
}

/// Returns a direction around a unit normal whose density is proportional to its cosine.
fn cosine_distributed(normal: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let (x, y) = normal.any_orthonormal_pair();
    let (sin, cos) = (TAU * v).sin_cos();
    (x * cos + y * sin) * u.sqrt() + normal * (1.0 - u).sqrt()
}

/// Returns queries for bounces, mirrored rays and edges.
fn questions(harness: &VisibilityHarness, seen: &[Seen]) -> [(&'static str, Vec<RayQuestion>); 3] {
    let mut random = Random(3);
    let bounce = |s: &Seen, w| ray_question(ASK_NEAREST, s.point, w, NONE);
    let bounces = seen.iter().map(|s| bounce(s, cosine_distributed(s.normal, random.pair()))).collect();
    let mirrored = seen.iter().map(|s| bounce(s, s.along.reflect(s.normal))).collect();
    let mut edge = || loop {
        let [p, q] = [(); 2].map(|()| seen[random.below(seen.len() as u64)].point);
        if harness.face_each_other(p, q) {
            return ray_question(ASK_EDGE, p, q.position, q.triangle);
        }
    };
    let edges = seen.iter().map(|_| edge()).collect();
    [("bounces", bounces), ("mirrored", mirrored), ("edges", edges)]
}

/// Compares answers with the CPU's.
fn differences(harness: &VisibilityHarness, queries: &[RayQuestion], answers: &[[u32; 2]]) -> Tally {
    if queries[0].kind == ASK_EDGE {
        return compare_edges(harness, queries, answers);
    }
    let rays: Vec<_> = queries.iter().map(|q| (Vec3::from(q.position), Vec3::from(q.towards), q.own)).collect();
    let mut tally = Tally::default();
    compare_nearest(harness, &mut tally, &rays, answers, true);
    tally
}

fn median(mut of: Vec<f64>) -> f64 {
    of.sort_by(f64::total_cmp);
    of[of.len() / 2]
}

/// Returns the scenes; those that are not beside the checkout are left out. Blended surfaces are cut out at half, so that
/// the CPU and the device decide alike.
pub fn scenes() -> Vec<(&'static str, Scene)> {
    let staged = |path: String| staging::load(&path, &Staging::default()).unwrap();
    let mut scenes =
        vec![("Cornell box", cornell()), ("displaced room", scene::builtin::load("displaced_room:60000").unwrap())];
    if let Some(shared) = common::shared() {
        let file = |path: &str| staged(shared.join("scenes").join(path).display().to_string());
        scenes.push(("Sponza", file("gltf/Sponza/glTF/Sponza.gltf")));
        scenes.push(("living-room", file("mitsuba/living-room/scene.xml")));
    }
    for material in scenes.iter_mut().flat_map(|(_, scene)| &mut scene.materials) {
        if let Some(Opacity::Blended { value }) = material.opacity.take_if(|o| matches!(o, Opacity::Blended { .. })) {
            material.opacity = Some(Opacity::CutOut { value, cutoff: 0.5 });
        }
    }
    scenes.retain(|(name, _)| asked_for("SCENES", name));
    scenes
}

/// True if an environment variable is not set, or one of the words in it is part of a name.
pub fn asked_for(variable: &str, name: &str) -> bool {
    std::env::var(variable).map_or(true, |words| words.split(',').any(|word| name.contains(word)))
}

/// Returns the algorithms that are asked for.
pub fn tracers() -> Vec<Tracing> {
    let all = [Tracing::RayQuery, Tracing::Grid, Tracing::Bvh];
    all.into_iter().filter(|tracing| asked_for("TRACERS", &format!("{tracing:?}"))).collect()
}

/// Measures nearest hits of cosine-distributed and of mirrored rays from what the camera sees, and edges
/// between two random points of these, by wall time, all algorithms in turns.
#[test]
#[ignore = "a matter of the clock"]
fn rays_a_second() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    println!(
        "| scene | triangles | by | bounces, M/s | mirrored, M/s | edges, M/s | differ: bounces | mirrored | edges | \
         build, ms | MiB |\n|---|---|---|---|---|---|---|---|---|---|---|"
    );
    for (name, scene) in &scenes() {
        let harness = VisibilityHarness::new(gpu, scene, false);
        let seen = seen(&harness);
        let questions = questions(&harness, &seen);
        let tracers = tracers();
        let differ: Vec<_> = tracers
            .iter()
            .map(|&tracing| {
                questions.each_ref().map(|(_, queries)| {
                    let answers = harness.query_rays(tracing, queries);
                    let tally = differences(&harness, queries, &answers);
                    tally.examples.iter().for_each(|example| println!("{example}"));
                    format!("{:.4} % {}", 100.0 * tally.share(), tally.why()).trim_end().to_owned()
                })
            })
            .collect();
        let mut seconds = vec![[const { Vec::new() }; 4]; tracers.len()];
        let mut bytes = vec![0; tracers.len()];
        for _ in 0..RUNS {
            for (n, &tracing) in tracers.iter().enumerate() {
                for (kind, (_, queries)) in questions.iter().enumerate() {
                    seconds[n][kind].push(harness.seconds_of_rays(tracing, queries));
                }
                let began = Instant::now();
                bytes[n] = harness.tracer(tracing).bytes();
                seconds[n][3].push(began.elapsed().as_secs_f64());
            }
        }
        for (((tracing, differ), seconds), bytes) in tracers.iter().zip(differ).zip(seconds).zip(bytes) {
            let [bounces, mirrored, edges, build] = seconds.map(median);
            let speed = [bounces, mirrored, edges].map(|s| format!("{:.2}", seen.len() as f64 / s * 1e-6));
            println!(
                "| {name} | {} | {tracing:?} | {} | {} | {:.1} | {:.1} |",
                harness.geometry().triangles.len(),
                speed.join(" | "),
                differ.join(" | "),
                1e3 * build,
                bytes as f64 / f64::from(1 << 20)
            );
        }
    }
}
