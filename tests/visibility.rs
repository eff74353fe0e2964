//! What lists of triangles, and ray queries, say about visibility against the CPU's hierarchy: nearest hits along bundles,
//! nearest hits from a point, and edges, on random points of scenes.
//!
//! Two nearest hits are the same if they name the same triangle or lie within 1e-4 of the scene's radius of each other. Every
//! difference gets a class by a look at it in double precision. The long table:
//!
//!     cargo test --test visibility -- --ignored --nocapture

mod common;

use std::collections::BTreeMap;
use std::time::Instant;

use common::random::Random;
use glam::{DVec3, Vec2, Vec3};
use lightsheaf::acceleration::Acceleration;
use lightsheaf::gpu::{Gpu, read_back};
use lightsheaf::gpu_scene::GpuScene;
use lightsheaf::layouts;
use lightsheaf::light_table::{LightTable, Met};
use lightsheaf::passes::depth_maps::DepthMaps;
use lightsheaf::passes::queries::Queries;
use lightsheaf::passes::ray_queries::RayQueries;
use lightsheaf::passes::view_lists::ViewLists;
use lightsheaf::passes::view_setup::ViewSetup;
use lightsheaf::plan::FramePlan;
use lightsheaf::reference::Reference;
use lightsheaf::sampler::uniform_sphere;
use lightsheaf::scene::{
    self, AlphaMask, Filter, Geometry, Image, Instance, Material, Mesh, Scalar, Scene, SceneStats, Texture, TextureRef,
    Wrap,
};
use lightsheaf::settings::{Settings, Visibility};
use lightsheaf::staging::{self, Staging};
use lightsheaf::view::{Answers, Texels, ViewBuffers, ViewScratch, parallel};
use rayon::iter::{IntoParallelIterator as _, IntoParallelRefIterator as _, ParallelIterator as _};

/// Share of answers that may differ in exact mode.
const TOLERATED: f64 = 0.0005;
/// Distance over the scene's radius within which two hits are one.
const SAME: f32 = 1e-4;
const NONE: u32 = u32::MAX;
const TOP_BIT: u32 = 1 << 31;

/// All directions from a point of a scene of a given radius.
fn perspective(origin: Vec3, radius: f32) -> layouts::View {
    layouts::View {
        origin: origin.to_array(),
        kind: layouts::View::PERSPECTIVE,
        scale: 1.0 / radius,
        exclude: u32::MAX,
        ..Default::default()
    }
}

/// A point on a triangle.
#[derive(Clone, Copy)]
struct Point {
    position: Vec3,
    triangle: u32,
}

/// Points spread evenly over a scene's surface.
struct Points<'a> {
    geometry: &'a Geometry,
    cumulative: Vec<f64>,
}

impl<'a> Points<'a> {
    fn new(geometry: &'a Geometry) -> Self {
        let mut sum = 0.0;
        let area = |i| {
            let [a, b, c] = geometry.positions(i).map(Vec3::as_dvec3);
            sum += (b - a).cross(c - a).length();
            sum
        };
        let cumulative = (0..geometry.triangles.len()).map(area).collect();
        Self { geometry, cumulative }
    }

    fn draw(&self, random: &mut Random) -> Point {
        let u = (random.bits() >> 11) as f64 / (1_u64 << 53) as f64 * self.cumulative.last().unwrap();
        let triangle = self.cumulative.partition_point(|&c| c <= u).min(self.cumulative.len() - 1);
        let [mut u, mut v] = random.pair();
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let [a, b, c] = self.geometry.positions(triangle);
        Point { position: a * (1.0 - u - v) + b * u + c * v, triangle: triangle as u32 }
    }
}

/// A scene on both sides.
struct World<'a> {
    gpu: &'a Gpu,
    scene: GpuScene,
    materials: &'a [Material],
    reference: Reference<'a>,
    plan: FramePlan,
    radius: f32,
    /// To views that have lists, and to those with depth maps.
    queries: [Queries; 2],
    setup: ViewSetup,
    lists: ViewLists,
    maps: DepthMaps,
}

impl<'a> World<'a> {
    fn new(gpu: &'a Gpu, scene: &'a Scene, fast: bool) -> Self {
        let reference = Reference::new(scene);
        let geometry = reference.geometry();
        let stats = SceneStats::new(scene, geometry);
        let visibility = if fast { Visibility::Fast } else { Visibility::Exact };
        let settings = Settings { visibility, ..Settings::plain() };
        let plan = FramePlan::new(&stats, &settings, &gpu.capabilities);
        let mut flags = plan.surface_flags.clone();
        if fast {
            flags.push("FAST");
        }
        Self {
            gpu,
            scene: GpuScene::new(gpu, scene, geometry, &LightTable::new(scene, geometry, Met::All), &flags).unwrap(),
            materials: &scene.materials,
            radius: stats.radius,
            queries: [Queries::new(gpu, &flags), Queries::new(gpu, &[flags.as_slice(), &["MAP"]].concat())],
            maps: DepthMaps::new(gpu, &plan.surface_flags),
            setup: ViewSetup::new(gpu, fast),
            lists: ViewLists::new(gpu, fast),
            plan,
            reference,
        }
    }

    fn geometry(&self) -> &Geometry {
        self.reference.geometry()
    }

    /// The lists of a view, with all the room that they want, and how many nodes they have.
    fn fill(&self, look: &layouts::View, resolution: u32) -> (ViewBuffers, u32) {
        let slabs = self.plan.bundle_slabs;
        let texels = match look.kind {
            layouts::View::PARALLEL => Texels { resolution, faces: 1, slabs },
            _ => Texels::around(resolution),
        };
        self.fill_texels(look, texels)
    }

    /// The same, of any texels.
    fn fill_texels(&self, look: &layouts::View, texels: Texels) -> (ViewBuffers, u32) {
        let limit = self.gpu.capabilities.max_storage_bytes;
        let triangles = u64::from(self.scene.triangles);
        let answers = match texels.faces {
            6 if self.plan.fast => Answers::DepthMap,
            _ => Answers::Lists { node_words: self.plan.node_words() },
        };
        let mut items = self.plan.item_room(triangles, limit);
        let mut room = self.plan.node_room(triangles, texels, limit);
        loop {
            let words = if answers == Answers::DepthMap { self.plan.list_words(texels, room) } else { 0 };
            let scratch = ViewScratch::new(self.gpu, items, words);
            let view = ViewBuffers::new(self.gpu, triangles, texels, room, answers);
            view.look(self.gpu, look);
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            view.reset(&mut encoder, &scratch);
            self.setup.record(self.gpu, &mut encoder, &self.scene, &view, &scratch);
            self.lists.record(self.gpu, &mut encoder, &self.scene, &view, &scratch);
            if answers == Answers::DepthMap {
                self.maps.record(self.gpu, &mut encoder, &self.scene, &view, &scratch);
            }
            self.gpu.queue.submit([encoder.finish()]);
            let tally: Vec<u32> = read_back(self.gpu, &scratch.tally, ViewScratch::WANTED as usize).unwrap();
            let [wanted, nodes] = [tally[0], tally[1]].map(u64::from);
            if wanted <= items && nodes <= room {
                return (view, tally[1]);
            }
            (items, room) = (items.max(wanted), room.max(nodes));
        }
    }

    /// Seconds that a view takes to answer; the first time does not count.
    fn seconds(&self, view: &ViewBuffers, questions: &[layouts::Query]) -> f64 {
        let count = questions.len();
        let asked = self.gpu.upload("questions", questions);
        let answers = self.gpu.storage("answers", count as u64 * 8);
        let queries = &self.queries[usize::from(view.answers == Answers::DepthMap)];
        let mut began = Instant::now();
        for n in 0..3 {
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            queries.record(self.gpu, &mut encoder, &self.scene, view, count as u32, &asked, &answers);
            self.gpu.queue.submit([encoder.finish()]);
            self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            if n == 0 {
                began = Instant::now();
            }
        }
        began.elapsed().as_secs_f64() / 2.0
    }

    /// Asks a view many questions: the position and the own triangle, with its top bit as `shaders/queries.wesl` says.
    fn ask(&self, view: &ViewBuffers, questions: &[layouts::Query]) -> Vec<[u32; 2]> {
        let count = questions.len();
        let asked = self.gpu.upload("questions", questions);
        let answers = self.gpu.storage("answers", count as u64 * 8);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let queries = &self.queries[usize::from(view.answers == Answers::DepthMap)];
        queries.record(self.gpu, &mut encoder, &self.scene, view, count as u32, &asked, &answers);
        self.gpu.queue.submit([encoder.finish()]);
        read_back(self.gpu, &answers, count).unwrap()
    }
}

fn query(position: Vec3, triangle: u32, top_bit: bool) -> layouts::Query {
    layouts::Query { position: position.to_array(), triangle: triangle & !TOP_BIT | if top_bit { TOP_BIT } else { 0 } }
}

/// How a ray meets a triangle, in double precision.
struct Meeting {
    /// Metres along the ray.
    distance: f64,
    /// Metres between the hit and the nearest edge, across the ray; negative outside.
    margin: f64,
    /// Of the angle between ray and triangle.
    cos: f64,
    /// Metres, across the ray, by which single precision may displace an edge: a product of coordinates is rounded by a few
    /// times 2^-24 of itself, and the smaller the triangle, the further that moves its edges.
    rounding: f64,
}

/// Why two answers differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    /// The ray passes an edge of the triangle within what rounding displaces it by.
    Edge,
    /// What one side met lies in the plane of the triangle that the ray starts or ends on.
    Coplanar,
    /// What one side met lies within rounding of an end of the ray; the flatter the angle, the more that is.
    End,
    /// Triangle and ray are parallel within 1e-3.
    Grazing,
    /// What one side met has holes: the texel at its border is a matter of rounding.
    Mask,
    /// Fast: lists hold what covers the texel's centre, not what the ray meets.
    Centre,
    /// Fast: what lies within the offset of the start may count as the own surface.
    Offset,
    /// None of these.
    Unexplained,
}

impl World<'_> {
    /// Metres that single precision cannot tell apart: `ROUNDING` of the shader, on coordinates of the scene's size.
    fn rounding(&self) -> f64 {
        let [low, high] = self.scene.bounds;
        f64::from(low.abs().max(high.abs()).max_element()) * 5e-6
    }

    /// `reach` is the size of the coordinates that edge functions are made of.
    fn meet(&self, triangle: u32, from: DVec3, direction: DVec3, reach: f64) -> Option<Meeting> {
        let [a, b, c] = self.geometry().positions(triangle as usize).map(Vec3::as_dvec3);
        let n = (b - a).cross(c - a);
        let cos = n.dot(direction) / n.length();
        if cos == 0.0 {
            return None;
        }
        let distance = n.dot(a - from) / n.dot(direction);
        let x = from + direction * distance;
        let edges = [(a, b), (b, c), (c, a)];
        let margin = edges
            .iter()
            .map(|(p, q)| (q - p).cross(x - p).dot(n) / n.length() / p.distance(*q))
            .fold(f64::INFINITY, f64::min)
            * cos.abs();
        // Twice the area over the longest edge: the least height.
        let height = n.length() / edges.iter().map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
        let rounding = self.rounding() + reach * reach / height * 2.0_f64.powi(-20);
        Some(Meeting { distance, margin, cos: cos.abs(), rounding })
    }

    fn masked(&self, triangle: u32) -> bool {
        self.materials[self.geometry().materials[triangle as usize] as usize].alpha_mask.is_some()
    }

    fn coplanar(&self, triangle: u32, other: u32) -> bool {
        if other == NONE {
            return false;
        }
        let [a, b, c] = self.geometry().positions(other as usize).map(Vec3::as_dvec3);
        let n = (b - a).cross(c - a).normalize();
        self.geometry().positions(triangle as usize).iter().all(|p| n.dot(p.as_dvec3() - a).abs() < self.rounding())
    }

    /// The class of a triangle that one side met and the other did not, on a ray of a given length.
    fn classify(&self, met: u32, from: DVec3, direction: DVec3, length: f64, reach: f64, ends: [u32; 2]) -> Class {
        let Some(meeting) = self.meet(met, from, direction, reach) else { return Class::Grazing };
        let end = meeting.rounding / meeting.cos;
        if ends.iter().any(|&e| self.coplanar(met, e)) {
            Class::Coplanar
        } else if meeting.distance.abs() < end || (meeting.distance - length).abs() < end {
            Class::End
        } else if meeting.margin.abs() < meeting.rounding {
            Class::Edge
        } else if meeting.cos < 1e-3 {
            Class::Grazing
        } else if self.masked(met) {
            Class::Mask
        } else {
            Class::Unexplained
        }
    }

    /// The class of an edge about which the sides disagree: that of the triangle that comes closest to deciding it.
    fn classify_edge(&self, from: Vec3, to: Vec3, ends: [u32; 2]) -> Class {
        let (from, to) = (from.as_dvec3(), to.as_dvec3());
        let (direction, length) = ((to - from).normalize(), from.distance(to));
        let candidates = (0..self.scene.triangles).into_par_iter().filter(|t| !ends.contains(t)).filter_map(|t| {
            let reach = from.distance(self.geometry().positions(t as usize)[0].as_dvec3());
            let m = self.meet(t, from, direction, reach)?;
            let end = m.rounding / m.cos;
            let near = m.margin > -m.rounding && m.distance > -end && m.distance < length + end;
            near.then(|| self.classify(t, from, direction, length, reach, ends))
        });
        // A blocker that nothing explains away would be the worst; none at all is as bad.
        candidates.max().unwrap_or(Class::Unexplained)
    }
}

/// What was asked and how often the sides differed.
#[derive(Clone, Debug, Default)]
struct Tally {
    asked: usize,
    /// Raster met something nearer (or something hid the point) and the CPU did not.
    too_near: usize,
    /// The other way round.
    too_far: usize,
    classes: BTreeMap<Class, usize>,
    /// Sums of exp(-distance / radius) on both sides: what an error does to gathered light.
    gathered: [f64; 2],
    examples: Vec<String>,
}

impl Tally {
    fn differ(&self) -> usize {
        self.too_near + self.too_far
    }

    fn share(&self) -> f64 {
        self.differ() as f64 / self.asked.max(1) as f64
    }

    fn count(&mut self, raster_nearer: bool, class: Class, example: impl FnOnce() -> String) {
        if raster_nearer {
            self.too_near += 1
        } else {
            self.too_far += 1
        }
        *self.classes.entry(class).or_default() += 1;
        if class == Class::Unexplained && self.examples.len() < 5 {
            self.examples.push(example());
        }
    }

    /// A row of a Markdown table.
    fn row(&self, scene: &str, what: &str) -> String {
        let classes: Vec<_> = self.classes.iter().map(|(class, n)| format!("{class:?} {n}").to_lowercase()).collect();
        let bias = if self.gathered[1] > 0.0 {
            format!("{:+.4} %", 100.0 * (self.gathered[0] / self.gathered[1] - 1.0))
        } else {
            String::new()
        };
        format!(
            "| {scene} | {what} | {} | {} | {:.4} % | {} | {} | {bias} | {} |",
            self.asked,
            self.differ(),
            100.0 * self.share(),
            self.too_near,
            self.too_far,
            classes.join(", "),
        )
    }
}

const HEAD: &str = "| scene | asked | queries | differ | share | raster nearer or hidden | raster farther or seen | mean of exp(-t) | why |\n\
                    |---|---|---|---|---|---|---|---|---|";

/// Compares answers of nearest hits with the CPU's. `rays`: start, direction and triangle to leave out.
fn compare_nearest(world: &World, tally: &mut Tally, rays: &[(Vec3, Vec3, u32)], answers: &[[u32; 2]], classify: bool) {
    let expected: Vec<_> = rays
        .par_iter()
        .map(|&(from, direction, own)| {
            world.reference.closest_hit(from, direction, (own != NONE).then_some(own)).map(|h| (h.triangle, h.t))
        })
        .collect();
    assert_eq!(answers.len(), expected.len());
    tally.asked += answers.len();
    let reach = f64::from(world.radius);
    for ((&[triangle, bits], expected), &(from, direction, own)) in answers.iter().zip(&expected).zip(rays) {
        let distance = if triangle == NONE { f32::INFINITY } else { f32::from_bits(bits) };
        let (other, other_distance) = expected.unwrap_or((NONE, f32::INFINITY));
        tally.gathered[0] += f64::from((-distance / world.radius).exp());
        tally.gathered[1] += f64::from((-other_distance / world.radius).exp());
        if triangle == other || (distance - other_distance).abs() <= SAME * world.radius {
            continue;
        }
        let nearer = distance < other_distance;
        let met = if nearer { triangle } else { other };
        let class = if classify {
            world.classify(met, from.as_dvec3(), direction.as_dvec3(), f64::INFINITY, reach, [own, NONE])
        } else {
            // OFFSET_TEXELS of visibility/raster.wesl, on a grid that is about as wide as the scene.
            let offset = 1.5 * 2.0 * world.radius / world.plan.bundle_resolution as f32;
            if own != NONE && !nearer && other_distance < offset { Class::Offset } else { Class::Centre }
        };
        tally.count(nearer, class, || {
            format!("{from} {direction} from {own}: raster {triangle} at {distance}, CPU {other} at {other_distance}")
        });
    }
}

/// Nearest hits along bundles, in both directions.
fn bundles(world: &World, count: usize, views: usize, random: &mut Random) -> Tally {
    let points = Points::new(world.geometry());
    let mut tally = Tally::default();
    for _ in 0..views {
        let forward = uniform_sphere(random.pair());
        let turn = random.unit() * std::f32::consts::TAU;
        let resolution = world.plan.bundle_resolution;
        let shift = Some(random.pair()).filter(|_| world.plan.fast);
        let (view, _) = world.fill(&parallel(forward, world.scene.bounds, turn, shift, resolution), resolution);
        let asked: Vec<(Point, bool)> =
            (0..count / views).map(|_| (points.draw(random), random.bits() & 1 == 1)).collect();
        let questions: Vec<_> = asked.iter().map(|(p, against)| query(p.position, p.triangle, *against)).collect();
        let answers = world.ask(&view, &questions);
        let rays: Vec<_> = asked
            .iter()
            .map(|(p, against)| (p.position, if *against { -forward } else { forward }, p.triangle))
            .collect();
        compare_nearest(world, &mut tally, &rays, &answers, !world.plan.fast);
    }
    tally
}

/// Where views look from: on surfaces, as VPLs do, and in free space, as lights do.
fn origins(world: &World, views: usize, random: &mut Random) -> Vec<(layouts::View, u32)> {
    let points = Points::new(world.geometry());
    let [low, high] = world.scene.bounds;
    (0..views)
        .map(|i| {
            if i % 2 == 0 {
                let point = points.draw(random);
                let [a, b, c] = world.geometry().positions(point.triangle as usize);
                let normal = (b - a).cross(c - a).normalize();
                // The side that most of the scene lies on: the other one of a wall sees nothing.
                let in_front = (0..64).filter(|_| normal.dot(points.draw(random).position - point.position) > 0.0);
                let normal = if in_front.count() >= 32 { normal } else { -normal };
                let view = layouts::View {
                    exclude: point.triangle,
                    normal: normal.to_array(),
                    ..perspective(point.position, world.radius)
                };
                (view, point.triangle)
            } else {
                let at = Vec3::new(random.unit(), random.unit(), random.unit());
                (perspective(low + (high - low) * at, world.radius), NONE)
            }
        })
        .collect()
}

/// Edges to points, and nearest hits, from many origins.
fn edges(world: &World, count: usize, views: usize, random: &mut Random) -> [Tally; 2] {
    let points = Points::new(world.geometry());
    let (mut nearest, mut edges) = (Tally::default(), Tally::default());
    for (look, own) in origins(world, views, random) {
        let (origin, normal) = (Vec3::from(look.origin), Vec3::from(look.normal));
        let resolution = if own == NONE { world.plan.light_resolution } else { world.plan.vpl_resolution };
        let (view, _) = world.fill(&look, resolution);
        // Only what lies in front of a surface is asked about, and never a triangle about itself.
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
        let questions: Vec<_> = targets.iter().map(|p| query(p.position, p.triangle, false)).collect();
        let answers = if questions.is_empty() { Vec::new() } else { world.ask(&view, &questions) };
        let hidden: Vec<bool> = targets
            .par_iter()
            .map(|p| world.reference.occluded(origin, p.position, (own != NONE).then_some(own), Some(p.triangle)))
            .collect();
        edges.asked += answers.len();
        for ((answer, &hidden), point) in answers.iter().zip(&hidden).zip(&targets) {
            if (answer[0] == 0) != hidden {
                let ends = [own, point.triangle];
                let class =
                    if world.plan.fast { Class::Centre } else { world.classify_edge(origin, point.position, ends) };
                edges.count(!hidden, class, || {
                    format!("{origin} to {} on {}, from {own}", point.position, point.triangle)
                });
            }
        }

        let directions: Vec<Vec3> = std::iter::repeat_with(|| uniform_sphere(random.pair()))
            .filter(|&d| in_front(d))
            .take(count / views)
            .collect();
        let questions: Vec<_> = directions.iter().map(|&d| query(origin + d, 0, true)).collect();
        let answers = world.ask(&view, &questions);
        // The very direction that the shader sees.
        let rays: Vec<_> = directions.iter().map(|&d| (origin, ((origin + d) - origin).normalize(), own)).collect();
        compare_nearest(world, &mut nearest, &rays, &answers, !world.plan.fast);
    }
    [nearest, edges]
}

/// All three tallies of a scene.
fn tallies(world: &World, count: usize, views: usize, seed: u64) -> [(&'static str, Tally); 3] {
    let mut random = Random(seed);
    let along = bundles(world, count, views, &mut random);
    let [nearest, edges] = edges(world, count, views, &mut random);
    [("nearest along bundles", along), ("nearest from a point", nearest), ("edges", edges)]
}

/// A box whose walls are displaced by smooth noise: about `triangles` triangles of all orientations, closed.
fn displaced_room(triangles: u32) -> Scene {
    let n = (f64::from(triangles) / 12.0).sqrt().round() as u32;
    let hash = |x: i32, y: i32, z: i32| {
        let key = (x as u32).wrapping_mul(0x8da6_b343)
            ^ (y as u32).wrapping_mul(0xd816_3841)
            ^ (z as u32).wrapping_mul(0xcb1a_b31f);
        Random(u64::from(key)).unit()
    };
    let noise = |p: Vec3| {
        let (cell, f) = (p.floor(), p - p.floor());
        let f = f * f * (3.0 - 2.0 * f);
        let at = |dx: i32, dy: i32, dz: i32| hash(cell.x as i32 + dx, cell.y as i32 + dy, cell.z as i32 + dz);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let row = |dy, dz| mix(at(0, dy, dz), at(1, dy, dz), f.x);
        mix(mix(row(0, 0), row(1, 0), f.y), mix(row(0, 1), row(1, 1), f.y), f.z)
    };
    let mut mesh = Mesh { name: "room".to_owned(), ..Mesh::default() };
    for face in 0..6 {
        let base = mesh.positions.len() as u32;
        for j in 0..=n {
            for i in 0..=n {
                let (u, v) = (2.0 * i as f32 / n as f32 - 1.0, 2.0 * j as f32 / n as f32 - 1.0);
                let axis = face / 2;
                let mut p = Vec3::ZERO;
                p[axis] = if face % 2 == 0 { -1.0 } else { 1.0 };
                p[(axis + 1) % 3] = u;
                p[(axis + 2) % 3] = v;
                // By position alone, so that faces meet at their common edges.
                let height = noise(p * 4.0 + 17.0) + 0.5 * noise(p * 11.0 + 31.0);
                mesh.positions.push(p * (1.0 - 0.2 * height));
            }
        }
        for j in 0..n {
            for i in 0..n {
                let at = |di, dj| base + (j + dj) * (n + 1) + i + di;
                mesh.triangles.push([at(0, 0), at(1, 0), at(1, 1)]);
                mesh.triangles.push([at(0, 0), at(1, 1), at(0, 1)]);
            }
        }
    }
    Scene {
        name: "displaced room".to_owned(),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_local: glam::Affine3A::IDENTITY }],
        materials: vec![Material::diffuse("wall", Vec3::splat(0.7))],
        ..Scene::default()
    }
}

/// Kinds of questions in shaders/ray_queries.wesl.
const ASK_NEAREST: u32 = 0;
const ASK_EDGE: u32 = 1;
const ASK_INFINITY: u32 = 2;
const ASK_CAMERA: u32 = 3;

impl World<'_> {
    fn ask_rays(&self, scene: &Scene, questions: &[layouts::RayQuestion]) -> Vec<[u32; 2]> {
        let acceleration = Acceleration::new(self.gpu, &self.scene, scene, self.geometry());
        let pass = RayQueries::new(self.gpu, &self.plan.surface_flags);
        let asked = self.gpu.upload("questions", questions);
        let answers = self.gpu.storage("answers", questions.len() as u64 * 8);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let count = questions.len() as u32;
        pass.record(self.gpu, &mut encoder, &self.scene, &acceleration, count, &asked, &answers);
        self.gpu.queue.submit([encoder.finish()]);
        read_back(self.gpu, &answers, questions.len()).unwrap()
    }
}

fn ray_question(kind: u32, p: Point, towards: Vec3, end: u32) -> layouts::RayQuestion {
    layouts::RayQuestion {
        position: p.position.to_array(),
        own: p.triangle,
        towards: towards.to_array(),
        end,
        kind,
        ..Default::default()
    }
}

/// Nearest hits, edges, and whether points see infinity, by ray queries.
fn ray_tallies(world: &World, scene: &Scene, count: usize, seed: u64) -> [(&'static str, Tally); 3] {
    let points = Points::new(world.geometry());
    let mut random = Random(seed);
    let (mut nearest, mut edges, mut infinity) = (Tally::default(), Tally::default(), Tally::default());
    let rays: Vec<(Point, Vec3)> =
        (0..count).map(|_| (points.draw(&mut random), uniform_sphere(random.pair()))).collect();
    let ask = |kind| {
        let questions: Vec<_> = rays.iter().map(|&(p, w)| ray_question(kind, p, w, NONE)).collect();
        world.ask_rays(scene, &questions)
    };
    let expected: Vec<_> = rays.iter().map(|&(p, w)| (p.position, w, p.triangle)).collect();
    compare_nearest(world, &mut nearest, &expected, &ask(ASK_NEAREST), true);

    let seen: Vec<[u32; 2]> = ask(ASK_INFINITY).iter().map(|a| [if a[0] == 1 { NONE } else { 0 }, 0]).collect();
    infinity.asked = count;
    for (answer, &(from, direction, own)) in seen.iter().zip(&expected) {
        let hit = world.reference.closest_hit(from, direction, Some(own));
        if (answer[0] == NONE) != hit.is_none() {
            let met = hit.map_or(NONE, |h| h.triangle);
            let class = if met == NONE {
                world.classify_edge(from, from + direction * 4.0 * world.radius, [own, NONE])
            } else {
                let reach = f64::from(world.radius);
                world.classify(met, from.as_dvec3(), direction.as_dvec3(), f64::INFINITY, reach, [own, NONE])
            };
            infinity.count(hit.is_none(), class, || format!("{from} {direction} from {own}: CPU met {met}"));
        }
    }

    let ends: Vec<(Point, Point)> = std::iter::repeat_with(|| (points.draw(&mut random), points.draw(&mut random)))
        .filter(|(p, q)| p.triangle != q.triangle)
        .take(count)
        .collect();
    let questions: Vec<_> = ends.iter().map(|(p, q)| ray_question(ASK_EDGE, *p, q.position, q.triangle)).collect();
    edges.asked = count;
    for (answer, (p, q)) in world.ask_rays(scene, &questions).iter().zip(&ends) {
        let hidden = world.reference.occluded(p.position, q.position, Some(p.triangle), Some(q.triangle));
        if (answer[0] == 0) != hidden {
            let class = world.classify_edge(p.position, q.position, [p.triangle, q.triangle]);
            edges.count(!hidden, class, || {
                format!("{} on {} to {} on {}", p.position, p.triangle, q.position, q.triangle)
            });
        }
    }
    [("nearest by ray query", nearest), ("edges by ray query", edges), ("infinity by ray query", infinity)]
}

/// A room whose every other triangle is cut out in a pattern.
fn masked_room() -> Scene {
    let mut scene = displaced_room(6_000);
    let checker = |i: u32| if (i ^ (i >> 4)) & 1 == 1 { [255; 4] } else { [255, 255, 255, 0] };
    scene.images =
        vec![Image { name: "checker".to_owned(), width: 16, height: 16, texels: (0..256).map(checker).collect() }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Nearest, srgb: false }];
    let texture = TextureRef { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY };
    let value = Scalar { factor: 1.0, texture: Some((texture, 3)) };
    let wall = scene.materials[0].clone();
    scene.materials.push(Material { alpha_mask: Some(AlphaMask { value, cutoff: 0.5 }), ..wall });
    let mesh = &mut scene.meshes[0];
    mesh.uvs[0] = mesh.positions.iter().map(|p| Vec2::new(p.x, p.y + p.z) * 3.0).collect();
    // Two walls have holes: the first and the fourth, so that geometries alternate.
    let per_face = mesh.triangles.len() / 6;
    let mesh = scene.meshes.remove(0);
    for face in 0..6 {
        let triangles = mesh.triangles[face * per_face..(face + 1) * per_face].to_vec();
        scene.meshes.push(Mesh { triangles, material: usize::from(face % 3 == 0), ..mesh.clone() });
    }
    scene.instances = (0..6).map(|mesh| Instance { mesh, world_from_local: glam::Affine3A::IDENTITY }).collect();
    scene
}

#[test]
fn ray_queries_answer_as_the_cpu() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    println!("{HEAD}");
    let scenes =
        [("Cornell box", cornell()), ("displaced room", displaced_room(60_000)), ("masked room", masked_room())];
    for (name, scene) in scenes {
        let world = World::new(gpu, &scene, false);
        assert_eq!(scene.materials.len() > 1 && name == "masked room", world.plan.surface_flags.contains(&"MASKS"));
        for (what, tally) in ray_tallies(&world, &scene, 100_000, 1) {
            println!("{}", tally.row(name, what));
            println!(
                "{}",
                tally.examples.join(
                    "
"
                )
            );
            assert_eq!(tally.asked, 100_000);
            assert!(tally.share() <= TOLERATED, "{name}, {what}: {tally:?}");
            assert!(!tally.classes.contains_key(&Class::Unexplained), "{name}, {what}: {tally:?}");
        }
    }
}

/// Holes matter, and a wrong direction is found.
#[test]
fn wrong_ray_queries_are_found() {
    let Some(gpu) = common::gpu_with_ray_queries() else { return };
    let masked = masked_room();
    let filled = Scene { materials: vec![masked.materials[0].clone(); 2], ..masked.clone() };
    let worlds = [&masked, &filled].map(|scene| World::new(gpu, scene, false));
    let points = Points::new(worlds[0].geometry());
    let mut random = Random(5);
    let asked: Vec<_> = (0..20_000).map(|_| (points.draw(&mut random), uniform_sphere(random.pair()))).collect();
    let questions: Vec<_> = asked.iter().map(|&(p, w)| ray_question(ASK_NEAREST, p, w, NONE)).collect();
    let rays: Vec<_> = asked.iter().map(|(p, w)| (p.position, *w, p.triangle)).collect();
    let share = |answers: &[[u32; 2]], turn: f32| {
        let mut tally = Tally::default();
        let rays: Vec<_> = rays.iter().map(|&(p, w, own)| (p, (w + Vec3::X * turn).normalize(), own)).collect();
        compare_nearest(&worlds[0], &mut tally, &rays, answers, true);
        tally.share()
    };
    let right = worlds[0].ask_rays(&masked, &questions);
    assert!(share(&right, 0.0) <= TOLERATED);
    assert!(share(&right, 0.01) > 2.0 * TOLERATED, "turned rays");
    assert!(share(&worlds[1].ask_rays(&filled, &questions), 0.0) > 0.05, "no holes");
}

/// A wall of two sheets in one plane, the nearer one culled: the camera sees the other.
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
    let world = World::new(gpu, &scene, false);
    let from = |z| Point { position: Vec3::new(-0.5, -0.4, z), triangle: NONE };
    let ask = |kind, z: f32| ray_question(kind, from(z), Vec3::Z * -z.signum(), NONE);
    let answers = world.ask_rays(
        &scene,
        &[ask(ASK_CAMERA, 1.0), ask(ASK_CAMERA, -3.0), ray_question(ASK_CAMERA, from(-3.0), Vec3::Z, NONE)],
    );
    assert_eq!(answers[0][0], 1, "the culled back lets the ray pass");
    assert_eq!(f32::from_bits(answers[0][1]), 2.0);
    assert!(answers[1][0] <= 1 && answers[2] == answers[1], "the culled front does not: {answers:?}");
}

fn cornell() -> Scene {
    staging::load("builtin:cornell_point", &Staging::default()).unwrap()
}

#[test]
fn exact_answers_are_the_cpus() {
    let Some(gpu) = common::gpu() else { return };
    println!("{HEAD}");
    for (name, scene) in [("Cornell box", cornell()), ("displaced room", displaced_room(60_000))] {
        let world = World::new(gpu, &scene, false);
        for (what, tally) in tallies(&world, 100_000, 8, 1) {
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
    let world = World::new(gpu, &scene, false);
    let points = Points::new(world.geometry());
    let mut random = Random(7);
    let asked: Vec<Point> = (0..20_000).map(|_| points.draw(&mut random)).collect();
    let forward = Vec3::new(0.3, -0.5, 0.8).normalize();
    let from = points.draw(&mut random);
    let mut answers = Vec::new();
    let mut nodes = Vec::new();
    for (resolution, slabs) in [(64, 4), (128, 1), (256, 3), (512, 16)] {
        let texels = Texels { resolution, faces: 1, slabs };
        let (bundle, along_bundle) =
            world.fill_texels(&parallel(forward, world.scene.bounds, 0.4, None, resolution), texels);
        let (around, around_point) = world
            .fill(&layouts::View { exclude: from.triangle, ..perspective(from.position, world.radius) }, resolution);
        let along =
            asked.iter().enumerate().map(|(i, p)| query(p.position, p.triangle, i % 2 == 0)).collect::<Vec<_>>();
        let edges = asked.iter().map(|p| query(p.position, p.triangle, false)).collect::<Vec<_>>();
        let nearest = asked.iter().map(|p| query(p.position, p.triangle, true)).collect::<Vec<_>>();
        answers.push([world.ask(&bundle, &along), world.ask(&around, &edges), world.ask(&around, &nearest)]);
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
                let near = (f32::from_bits(a[1]) - f32::from_bits(b[1])).abs() <= SAME * world.radius;
                a[0] != b[0] && !(near && kind != 1)
            });
            let differ = differ.count();
            assert!(differ == 0, "{what}: {differ} of {} differ", asked.len());
        }
    }
}

/// The comparison finds what is wrong: rays of another direction, a scene without one of its triangles, fast lists.
#[test]
fn wrong_answers_are_found() {
    let Some(gpu) = common::gpu() else { return };
    let scene = cornell();
    let world = World::new(gpu, &scene, false);
    let points = Points::new(world.geometry());
    let mut random = Random(3);
    let forward = Vec3::new(0.2, 0.9, -0.4).normalize();
    let (view, _) = world.fill(&parallel(forward, world.scene.bounds, 0.0, None, 128), 128);
    let asked: Vec<Point> = (0..20_000).map(|_| points.draw(&mut random)).collect();
    let answers = world.ask(&view, &asked.iter().map(|p| query(p.position, p.triangle, false)).collect::<Vec<_>>());
    let differ = |direction: Vec3, answers: &[[u32; 2]]| {
        let rays: Vec<_> = asked.iter().map(|p| (p.position, direction, p.triangle)).collect();
        let mut tally = Tally::default();
        compare_nearest(&world, &mut tally, &rays, answers, true);
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
    let fast = World::new(gpu, &scene, true);
    let [(_, along), _, (_, edges)] = tallies(&fast, 20_000, 4, 5);
    assert!(along.share() > TOLERATED && edges.share() > TOLERATED, "{along:?} {edges:?}");
    assert!(along.share() < 0.2 && edges.share() < 0.2, "{along:?} {edges:?}");
}

/// A ray passes beside triangles that cover its texel's centre, and may never meet the plane of one that is seen edge-on.
#[test]
fn fast_hits_lie_in_the_scene() {
    let Some(gpu) = common::gpu() else { return };
    let scene = displaced_room(60_000);
    let world = World::new(gpu, &scene, true);
    let points = Points::new(world.geometry());
    let mut random = Random(11);
    let mut hits = 0;
    for _ in 0..16 {
        let look = parallel(uniform_sphere(random.pair()), world.scene.bounds, 0.0, Some(random.pair()), 128);
        let (view, _) = world.fill(&look, 128);
        let asked: Vec<Point> = (0..20_000).map(|_| points.draw(&mut random)).collect();
        let questions: Vec<_> = asked.iter().map(|p| query(p.position, p.triangle, false)).collect();
        for answer in world.ask(&view, &questions).iter().filter(|answer| answer[0] != NONE) {
            let distance = f32::from_bits(answer[1]);
            assert!(distance <= 2.0 * world.radius, "{distance} m away in a scene of radius {}", world.radius);
            hits += 1;
        }
    }
    assert!(hits > 100_000, "only {hits} hits");
}

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
            let world = World::new(gpu, scene, fast);
            for (what, tally) in tallies(&world, count, 20, 11) {
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

/// Look-ups of 512x512 points in screen order, nearest hits along bundles, in turns:
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
        let world = World::new(gpu, scene, false);
        let camera = &scene.cameras[0];
        let half = camera.half_extent(SIDE, SIDE);
        let points: Vec<_> = (0..SIDE * SIDE)
            .filter_map(|n| {
                let ndc = (Vec2::new((n % SIDE) as f32, (n / SIDE) as f32) + 0.5) / SIDE as f32 * 2.0 - 1.0;
                let towards = (Vec2::new(ndc.x, -ndc.y) * half).extend(-1.0);
                let origin = camera.world_from_camera.transform_point3(Vec3::ZERO);
                let direction = camera.world_from_camera.transform_vector3(towards).normalize();
                let hit = world.reference.closest_hit(origin, direction, None)?;
                Some((origin + direction * hit.t, hit.triangle))
            })
            .collect();
        let mut random = Random(1);
        let forwards = [(); 3].map(|()| uniform_sphere(random.pair()));
        let mut kept = Vec::new();
        for (resolution, slabs) in [(128, 1), (256, 1), (256, 8), (512, 1), (512, 8), (512, 32), (1024, 1)] {
            let texels = Texels { resolution, faces: 1, slabs };
            let looks = forwards.map(|forward| parallel(forward, world.scene.bounds, 0.4, None, resolution));
            let views = looks.map(|look| world.fill_texels(&look, texels));
            let nodes = views.iter().map(|(_, nodes)| nodes / 3).sum::<u32>();
            let questions = forwards.map(|forward| {
                let normal = |triangle: u32| {
                    let [a, b, c] = world.geometry().positions(triangle as usize);
                    (b - a).cross(c - a)
                };
                points.iter().map(|&(p, t)| query(p, t, normal(t).dot(forward) < 0.0)).collect::<Vec<_>>()
            });
            kept.push((texels, views, questions, nodes, Vec::new()));
        }
        for _ in 0..5 {
            for (_, views, questions, _, seconds) in &mut kept {
                let each = views.iter().zip(&*questions).map(|((view, _), questions)| world.seconds(view, questions));
                seconds.push(each.sum::<f64>() / 3.0);
            }
        }
        for (Texels { resolution, slabs, .. }, _, _, nodes, seconds) in &mut kept {
            seconds.sort_by(f64::total_cmp);
            let [best, median] = [seconds[0], seconds[2]].map(|s| points.len() as f64 / s * 1e-6);
            let chosen = [*resolution, *slabs] == [world.plan.bundle_resolution, world.plan.bundle_slabs];
            println!(
                "| {name} | {resolution}^2 x {slabs}{} | {nodes} | {median:.1} | {best:.1} |",
                if chosen { " (chosen)" } else { "" }
            );
        }
    }
}
