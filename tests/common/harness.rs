//! Runs passes of tests/shaders on many queries at once; the harness puts visibility queries to views and to
//! the data structures of rays.

use std::sync::OnceLock;
use std::time::Instant;

use bytemuck::Pod;
use glam::Vec3;
use lightsheaf::gpu::{Compute, Flag, Gpu, read_back, rows};
use lightsheaf::reference::Reference;
use lightsheaf::render::layouts;
use lightsheaf::render::lights::table::{Hittable, LightTable};
use lightsheaf::render::recording::Recording;
use lightsheaf::render::shared::passes::views::rasterize_view::RasterizeView;
use lightsheaf::render::shared::plan::FramePlan;
use lightsheaf::render::upload::gpu_scene::GpuScene;
use lightsheaf::render::visibility::tracer::{Tracer, Tracing};
use lightsheaf::render::visibility::view::{Answers, Texels, ViewBuffers, ViewScratch};
use lightsheaf::scene::{Geometry, Scene, SceneStats};
use lightsheaf::settings::{Settings, Technique};

use super::random::Random;
use super::shaders::{self, Query, RayQuestion};

/// The index of no triangle.
pub const NONE: u32 = u32::MAX;
/// The bit of [`Query::triangle`] that asks for the other direction (tests/shaders/queries.wesl).
pub const TOP_BIT: u32 = 1 << 31;

/// Runs a pass once and reads the first `count` elements of a buffer back.
pub fn run<A: Pod>(
    gpu: &Gpu,
    pass: &Compute,
    bindings: &[(&str, wgpu::BindingResource<'_>)],
    threads: [u32; 2],
    (results, count): (&wgpu::Buffer, usize),
) -> Vec<A> {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    pass.record(gpu, &mut encoder, threads, bindings);
    gpu.queue.submit([encoder.finish()]);
    read_back(gpu, results, count).unwrap()
}

/// Uploads queries, runs a pass over them and returns its answers; `names` are those of both buffers in the
/// shader.
pub fn answer<Q: Pod, A: Pod>(
    gpu: &Gpu,
    pass: &Compute,
    bindings: &[(&str, wgpu::BindingResource<'_>)],
    names: [&str; 2],
    queries: &[Q],
) -> Vec<A> {
    let asked = gpu.upload("queries", queries);
    let answers = gpu.storage("answers", (queries.len() * size_of::<A>()) as u64);
    let buffers = [(names[0], asked.as_entire_binding()), (names[1], answers.as_entire_binding())];
    run(gpu, pass, &[bindings, &buffers].concat(), rows(queries.len() as u32), (&answers, queries.len()))
}

/// A point on a triangle.
#[derive(Clone, Copy)]
pub struct Point {
    pub position: Vec3,
    pub triangle: u32,
}

/// Points spread evenly over a scene's surface.
pub struct Points<'a> {
    geometry: &'a Geometry,
    cumulative: Vec<f64>,
}

impl<'a> Points<'a> {
    pub fn new(geometry: &'a Geometry) -> Self {
        let mut sum = 0.0;
        let area = |i| {
            let [a, b, c] = geometry.positions(i).map(Vec3::as_dvec3);
            sum += (b - a).cross(c - a).length();
            sum
        };
        let cumulative = (0..geometry.triangles.len()).map(area).collect();
        Self { geometry, cumulative }
    }

    pub fn draw(&self, random: &mut Random) -> Point {
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

/// Returns a view of all directions from a point of a scene of a given radius.
pub fn perspective(origin: Vec3, radius: f32) -> layouts::View {
    layouts::View {
        origin: origin.to_array(),
        kind: layouts::view_kind::PERSPECTIVE,
        scale: 1.0 / radius,
        exclude: u32::MAX,
        ..Default::default()
    }
}

/// Returns a query at a point; `top_bit` as tests/shaders/queries.wesl says.
pub fn query(position: Vec3, triangle: u32, top_bit: bool) -> Query {
    Query { position: position.to_array(), triangle: triangle & !TOP_BIT | if top_bit { TOP_BIT } else { 0 } }
}

/// A scene on the device and in the reference, with the passes that answer visibility queries.
pub struct VisibilityHarness<'a> {
    pub gpu: &'a Gpu,
    pub source: &'a Scene,
    pub scene: GpuScene,
    pub reference: Reference<'a>,
    pub plan: FramePlan,
    pub radius: f32,
    queries: Compute,
    rasterize: RasterizeView,
    /// By [`Tracing`].
    rays: [OnceLock<(Tracer, Compute)>; 3],
}

impl<'a> VisibilityHarness<'a> {
    /// Builds both sides; `fast` chooses depth maps and centre-sampled lists instead of exact lists.
    pub fn new(gpu: &'a Gpu, scene: &'a Scene, fast: bool) -> Self {
        let reference = Reference::new(scene);
        let geometry = reference.geometry();
        let stats = SceneStats::new(scene, geometry);
        let technique = if fast { Technique::FAST } else { Technique::RASTER };
        let settings = Settings { technique, ..Settings::plain() };
        let plan = FramePlan::new(&stats, &settings, &gpu.capabilities);
        let fast_flag: &[Flag] = if fast { &[Flag::Fast] } else { &[] };
        let flags = [plan.surface_flags.as_slice(), fast_flag].concat();
        let of_queries = [flags.as_slice(), &[Flag::Projected, Flag::Infinite]].concat();
        Self {
            gpu,
            source: scene,
            scene: GpuScene::new(gpu, scene, geometry, &LightTable::new(scene, geometry, Hittable::All), &flags)
                .unwrap(),
            radius: stats.radius,
            queries: Compute::from_source(gpu, "queries", &shaders::QUERIES, &of_queries),
            rasterize: RasterizeView::new(gpu, fast, fast, &plan.surface_flags),
            rays: [const { OnceLock::new() }; 3],
            plan,
            reference,
        }
    }

    pub fn geometry(&self) -> &Geometry {
        self.reference.geometry()
    }

    /// Rasterizes a view with the capacity that its lists need; returns also the number of its nodes.
    pub fn fill(&self, view: &layouts::View, resolution: u32) -> (ViewBuffers, u32) {
        let slabs = self.plan.bundle_slabs;
        let texels = match view.kind {
            layouts::view_kind::PARALLEL => Texels { resolution, faces: 1, slabs },
            _ => Texels::around(resolution),
        };
        self.fill_texels(view, texels)
    }

    /// As [`Self::fill`], with any texels.
    pub fn fill_texels(&self, view: &layouts::View, texels: Texels) -> (ViewBuffers, u32) {
        let limit = self.gpu.capabilities.max_storage_bytes;
        let triangles = u64::from(self.scene.triangles);
        let answers = match texels.faces {
            6 if self.plan.fast => Answers::DepthMap,
            _ => Answers::Lists { node_words: self.plan.node_words() },
        };
        let mut items = self.plan.item_capacity(triangles, limit);
        let mut capacity = self.plan.node_capacity(triangles, texels, limit);
        loop {
            let words = if answers == Answers::DepthMap { self.plan.list_words(texels, capacity) } else { 0 };
            let scratch = ViewScratch::new(self.gpu, items, words);
            let buffers = ViewBuffers::new(self.gpu, triangles, texels, capacity, answers);
            buffers.write_view(self.gpu, view);
            let mut recording = Recording::new(self.gpu, &self.scene, "view");
            self.rasterize.record(&mut recording, &buffers, &scratch);
            recording.submit();
            let tally: Vec<u32> = read_back(self.gpu, &scratch.tally, ViewScratch::REQUESTED as usize).unwrap();
            let [requested, nodes] = [tally[0], tally[1]].map(u64::from);
            if requested <= items && nodes <= capacity {
                return (buffers, tally[1]);
            }
            (items, capacity) = (items.max(requested), capacity.max(nodes));
        }
    }

    /// Answers queries to a view, two words each (tests/shaders/queries.wesl).
    pub fn query(&self, view: &ViewBuffers, queries: &[Query]) -> Vec<[u32; 2]> {
        let bindings = self.scene.with(&view.bindings());
        answer(self.gpu, &self.queries, &bindings, ["questions", "answers"], queries)
    }

    /// Returns the seconds that a view takes to answer, without the first run and without read-back.
    pub fn seconds(&self, view: &ViewBuffers, queries: &[Query]) -> f64 {
        let asked = self.gpu.upload("queries", queries);
        let answers = self.gpu.storage("answers", queries.len() as u64 * 8);
        let mut bindings = self.scene.with(&view.bindings());
        bindings.extend([("questions", asked.as_entire_binding()), ("answers", answers.as_entire_binding())]);
        let mut began = Instant::now();
        for n in 0..3 {
            let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
            self.queries.record(self.gpu, &mut encoder, rows(queries.len() as u32), &bindings);
            self.gpu.queue.submit([encoder.finish()]);
            self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            if n == 0 {
                began = Instant::now();
            }
        }
        began.elapsed().as_secs_f64() / 2.0
    }

    /// Builds the data structure of rays anew and waits for the device.
    pub fn tracer(&self, tracing: Tracing) -> Tracer {
        let tracer = pollster::block_on(Tracer::new(
            self.gpu,
            tracing,
            None,
            &self.scene.traced(),
            self.source,
            self.geometry(),
        ))
        .unwrap();
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        tracer
    }

    fn rays(&self, tracing: Tracing) -> &(Tracer, Compute) {
        self.rays[tracing as usize].get_or_init(|| {
            let flags = [self.plan.surface_flags.as_slice(), tracing.flags()].concat();
            (self.tracer(tracing), Compute::from_source(self.gpu, "ray_queries", &shaders::RAY_QUERIES, &flags))
        })
    }

    /// Answers queries by rays, two words each (tests/shaders/ray_queries.wesl).
    pub fn query_rays(&self, tracing: Tracing, queries: &[RayQuestion]) -> Vec<[u32; 2]> {
        let (tracer, pass) = self.rays(tracing);
        let bindings = self.scene.with(&tracer.bindings());
        answer(self.gpu, pass, &bindings, ["questions", "answers"], queries)
    }

    /// Returns the seconds that one run over the queries takes, without upload and read-back.
    pub fn seconds_of_rays(&self, tracing: Tracing, queries: &[RayQuestion]) -> f64 {
        let (tracer, pass) = self.rays(tracing);
        let asked = self.gpu.upload("queries", queries);
        let answers = self.gpu.storage("answers", queries.len() as u64 * 8);
        let mut bindings = self.scene.with(&tracer.bindings());
        bindings.extend([("questions", asked.as_entire_binding()), ("answers", answers.as_entire_binding())]);
        self.gpu.queue.submit([]);
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let began = Instant::now();
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        pass.record(self.gpu, &mut encoder, rows(queries.len() as u32), &bindings);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        began.elapsed().as_secs_f64()
    }
}
