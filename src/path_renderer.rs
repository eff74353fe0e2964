//! Renders a scene with ray queries: path tracing, or bidirectional path tracing (Veach 1997; Sun 2020) with every strategy (s, t),
//! s >= 0 and t >= 1.
//!
//! A sample is one eye subpath per pixel and, bidirectionally, as many light subpaths. Light subpaths are traced first, joined to the
//! camera and stored; eye subpaths are joined to lights and to the vertices stored for their pixel. Pixels come in groups, so that
//! what is stored fits the device. Unbiased, but that media know only the one that a path entered last.

use std::time::Instant;

use crate::film::{self, Film};
use crate::gpu::{Gpu, GpuError, read_back};
use crate::gpu_scene::GpuScene;
use crate::iteration::describe_camera;
use crate::layouts;
use crate::light_table::{LightTable, Met};
use crate::light_tree::LightTree;
use crate::passes::eye_paths::EyePaths;
use crate::passes::light_paths::LightPaths;
use crate::passes::reservoirs::Reservoirs;
use crate::passes::resolve::Resolve;
use crate::path_plan::PathPlan;
use crate::posing::Posing;
use crate::renderer::{BatchSize, Progressive, RenderError, RenderStats, camera_of, check_size, clear, read_film};
use crate::scene::{Camera, Geometry, Projection, Scene, SceneStats};
use crate::settings::{LightSampling, Method, OnlyStrategy, RestirBias, Settings};
use crate::tiles::{self, Settled};

/// Most samples between looks at the log.
const BATCH: u64 = 8;

/// `Paths.only_s` where all strategies count.
const ANY: u32 = u32::MAX;

/// Buffers of what a sample shares (shaders/lib/paths.wesl).
struct Shared {
    frame: wgpu::Buffer,
    paths: wgpu::Buffer,
    light_nodes: Option<wgpu::Buffer>,
}

/// Buffers per pixel.
struct Pixels {
    radiance: wgpu::Buffer,
    film: wgpu::Buffer,
    log: wgpu::Buffer,
    /// Light subpaths and splats.
    light: Option<(wgpu::Buffer, wgpu::Buffer)>,
    /// Where tiles may settle.
    settled: Option<Settled>,
}

/// What of a scene does not need the device.
struct Prepared {
    geometry: Geometry,
    camera: Camera,
    plan: PathPlan,
    table: LightTable,
    light_nodes: Option<Vec<layouts::LightNode>>,
    constants: layouts::Paths,
}

impl Prepared {
    fn new(gpu: &Gpu, scene: &Scene, geometry: Geometry, settings: &Settings) -> Result<Self, RenderError> {
        settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
        let camera = camera_of(scene, settings)?;
        let limit = gpu.capabilities.max_storage_bytes;
        check_size(gpu, settings, limit / 64)?;
        let stats = SceneStats::new(scene, &geometry);
        let both_sides = settings.method == Method::RayQuery;
        let plan = PathPlan::new(scene, &stats, settings, &gpu.capabilities);
        let mut table = LightTable::new(scene, &geometry, if both_sides { Met::All } else { Met::ButConstantSky });
        let mut light_nodes = None;
        if plan.light_sampling == LightSampling::Uniform {
            table = table.even();
        }
        if plan.light_sampling.has_tree() {
            let tree = LightTree::new(&table, scene, &geometry);
            table.records.iter_mut().zip(&tree.trails).for_each(|(record, trail)| record.trail = *trail);
            check_binding(gpu, "the tree over its lights", size_of_val(tree.nodes.as_slice()))?;
            light_nodes = Some(tree.nodes);
        }
        let [lens_radius, focus] = lens_of(&camera);
        let constants = layouts::Paths {
            seed: settings.seed,
            bounces: plan.bounces,
            lens_radius,
            focus,
            only_s: ANY,
            only_t: ANY,
            splat_scale: splat_scale(table.power, geometry.sphere().1),
            tree_lights: table.finite as u32,
            tree_share: table.finite_share(),
            biased_reuse: u32::from(settings.restir_bias == RestirBias::Biased),
            memory: settings.restir_memory,
            ..Default::default()
        };
        Ok(Self { geometry, camera, plan, table, light_nodes, constants })
    }
}

/// A scene being rendered with ray queries.
pub struct PathRenderer<'gpu> {
    gpu: &'gpu Gpu,
    scene: GpuScene,
    settings: Settings,
    constants: layouts::Paths,
    plan: PathPlan,
    light_paths: Option<LightPaths>,
    reservoirs: Option<Reservoirs>,
    eye_paths: EyePaths,
    resolve: Resolve,
    shared: Shared,
    pixels: Pixels,
    posing: Posing,
    samples: u64,
    batch_size: BatchSize,
    stats: RenderStats,
}

impl<'gpu> PathRenderer<'gpu> {
    /// Uploads the scene, builds its acceleration structures and pipelines. The method is `path` or `ray-query`.
    ///
    /// # Errors
    /// [`RenderError::Setting`] for a value out of its range, an image that the device cannot hold or a camera that is not there;
    /// [`RenderError::Gpu`], also where the device was opened without ray queries.
    pub fn new(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        let (geometry, sources) = Geometry::with_sources(scene);
        let Prepared { geometry, camera, plan, table, light_nodes, constants } =
            Prepared::new(gpu, scene, geometry, settings)?;
        let both_sides = settings.method == Method::RayQuery;
        // Its shaders always ask how many lights there are.
        let flags = [plan.flags.as_slice(), &["PUNCTUAL"]].concat();
        let mut gpu_scene = GpuScene::new(gpu, scene, &geometry, &table, &flags)?;
        let mut posing = Posing::default();
        posing.refine(gpu, &gpu_scene, scene, &geometry, &sources)?;
        gpu_scene.accelerate(gpu, scene, &geometry)?;
        posing.keep(geometry, sources);
        let frame = gpu.uniform::<layouts::Frame>("frame");
        gpu.queue.write_buffer(&frame, 0, bytemuck::bytes_of(&describe_camera(&camera, settings)));
        let light_nodes = light_nodes.map(|nodes| gpu.upload("light_nodes", &nodes));
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        let mut this = Self {
            light_paths: both_sides.then(|| LightPaths::new(gpu, &plan.flags)),
            reservoirs: plan
                .light_sampling
                .resamples()
                .then(|| Reservoirs::new(gpu, &plan.flags, pixels, plan.light_sampling == LightSampling::Restir)),
            eye_paths: EyePaths::new(gpu, &plan.flags),
            resolve: Resolve::new(gpu, &plan.flags),
            shared: Shared { frame, paths: gpu.uniform::<layouts::Paths>("paths"), light_nodes },
            pixels: Pixels {
                radiance: gpu.storage("radiance", pixels * 16),
                film: gpu.storage("film", pixels * film::DEVICE_BYTES),
                log: gpu.storage("log", 16),
                light: both_sides
                    .then(|| (gpu.storage("path_vertices", plan.vertex_bytes), gpu.storage("splats", pixels * 24))),
                settled: settings.settles().then(|| Settled::new(gpu, settings.width, settings.height)),
            },
            gpu,
            stats: RenderStats { scene_bytes: gpu_scene.bytes + posing.bytes(), ..Default::default() },
            scene: gpu_scene,
            settings: settings.clone(),
            constants,
            plan,
            posing,
            samples: 0,
            batch_size: BatchSize::default(),
        };
        this.count_only(settings.only);
        gpu.check()?;
        Ok(this)
    }

    /// Begins a picture of another pose of the same scene ([`Scene::at`]): the one that a new renderer would make. Pipelines and
    /// buffers are kept where plan, materials and numbers of triangles, vertices and lights are what they were.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn pose(&mut self, scene: &Scene) -> Result<(), RenderError> {
        let (geometry, sources, same) = self.posing.flatten(scene);
        let prepared = Prepared::new(self.gpu, scene, geometry, &self.settings)?;
        if prepared.plan != self.plan || !self.scene.fits(scene, &prepared.geometry, &prepared.table) {
            *self = Self::new(self.gpu, scene, &self.settings)?;
            return Ok(());
        }
        let Prepared { geometry, camera, table, light_nodes, constants, .. } = prepared;
        self.scene.pose(self.gpu, &geometry, !same, &table);
        self.posing.run(self.gpu, &self.scene, scene, &geometry, &sources)?;
        self.scene.accelerate(self.gpu, scene, &geometry)?;
        self.posing.keep(geometry, sources);
        let described = describe_camera(&camera, &self.settings);
        self.gpu.queue.write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&described));
        self.shared.light_nodes = light_nodes.map(|nodes| self.gpu.upload("light_nodes", &nodes));
        self.constants = constants;
        self.stats = RenderStats { scene_bytes: self.scene.bytes + self.posing.bytes(), ..Default::default() };
        self.count_only(self.settings.only);
        Ok(self.gpu.check()?)
    }

    /// Begins a picture of the same scene from elsewhere: the one that a new renderer would make. Nothing is built or uploaded.
    pub fn look(&mut self, camera: &Camera) {
        let described = describe_camera(camera, &self.settings);
        self.gpu.queue.write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&described));
        [self.constants.lens_radius, self.constants.focus] = lens_of(camera);
        self.stats = RenderStats { scene_bytes: self.scene.bytes + self.posing.bytes(), ..Default::default() };
        self.restart(self.constants.seed);
    }

    /// Begins anew, with one strategy that counts or with all.
    pub fn count_only(&mut self, only: Option<OnlyStrategy>) {
        self.constants.only_s = only.map_or(ANY, |o| o.s);
        self.constants.only_t = only.map_or(ANY, |o| o.t);
        self.constants.unweighted = u32::from(only.is_some_and(|o| !o.weighted));
        self.restart(self.constants.seed);
    }

    /// Everything that passes over paths read and write; names that a shader does not use are ignored.
    #[must_use]
    pub fn bindings(&self) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        let mut bindings = self.scene.with(&[]);
        bindings.extend([
            ("frame", self.shared.frame.as_entire_binding()),
            ("paths", self.shared.paths.as_entire_binding()),
            ("radiance", self.pixels.radiance.as_entire_binding()),
            ("film", self.pixels.film.as_entire_binding()),
            ("log", self.pixels.log.as_entire_binding()),
        ]);
        bindings.extend(self.shared.light_nodes.as_ref().map(|nodes| ("light_nodes", nodes.as_entire_binding())));
        bindings.extend(self.pixels.settled.iter().map(Settled::binding));
        if let Some((vertices, splats)) = &self.pixels.light {
            bindings.extend([("path_vertices", vertices.as_entire_binding()), ("splats", splats.as_entire_binding())]);
        }
        bindings
    }

    /// What each sample does.
    #[must_use]
    pub fn plan(&self) -> &PathPlan {
        &self.plan
    }

    /// Writes what a dispatch over some pixels of a sample reads.
    pub fn describe(&self, number: u64, first: u32, count: u32) {
        let constants = layouts::Paths { number: number as u32, first, count, ..self.constants };
        self.gpu.queue.write_buffer(&self.shared.paths, 0, bytemuck::bytes_of(&constants));
    }

    /// One sample of every pixel.
    fn sample(&self, number: u64) {
        let pixels = self.settings.width * self.settings.height;
        let mut bindings = self.bindings();
        bindings.extend(self.reservoirs.iter().flat_map(|r| r.bindings(number)));
        for first in (0..pixels).step_by(self.plan.group as usize) {
            let count = self.plan.group.min(pixels - first);
            self.describe(number, first, count);
            let mut encoder =
                self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("sample") });
            if let Some(light_paths) = &self.light_paths {
                light_paths.record(self.gpu, &mut encoder, count, &bindings);
            }
            if let Some(reservoirs) = &self.reservoirs {
                reservoirs.record(self.gpu, &mut encoder, count, &bindings);
            }
            self.eye_paths.record(self.gpu, &mut encoder, count, &bindings);
            if first + count == pixels {
                let size = [self.settings.width, self.settings.height];
                self.resolve.record(self.gpu, &mut encoder, size, &bindings);
            }
            self.gpu.queue.submit([encoder.finish()]);
        }
    }
}

impl Progressive for PathRenderer<'_> {
    fn render(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        let end = self.samples + samples;
        while self.samples < end {
            let count = self.batch_size.next(BATCH.min(end - self.samples));
            let (began, next) = (Instant::now(), self.samples + count);
            (self.samples..next).for_each(|number| self.sample(number));
            let non_finite: Vec<u32> = read_back(self.gpu, &self.pixels.log, 1)?;
            self.stats.non_finite += u64::from(non_finite[0]);
            self.gpu.queue.write_buffer(&self.pixels.log, 0, &[0; 4]);
            self.gpu.timings.collect(self.gpu)?;
            self.batch_size.record(count, began.elapsed());
            self.samples = next;
            if !progress(self.samples) {
                break;
            }
        }
        Ok(())
    }

    fn restart(&mut self, seed: u32) {
        clear(self.gpu, &self.pixels.film);
        self.pixels.settled.iter_mut().for_each(|settled| settled.restart(self.gpu));
        self.constants.seed = seed;
        self.samples = 0;
    }

    fn settle(&mut self, tiles: &[bool]) -> Result<(), RenderError> {
        self.pixels.settled.as_mut().ok_or_else(tiles::never)?.write(self.gpu, tiles, self.samples)
    }

    fn settles(&self) -> bool {
        self.settings.settles()
    }

    fn film(&self) -> Result<Film, RenderError> {
        let Pixels { film, settled, .. } = &self.pixels;
        read_film(self.gpu, std::iter::once(film), &self.settings, self.samples, settled.as_ref())
    }

    fn stats(&self) -> RenderStats {
        RenderStats {
            samples: self.samples,
            bytes: self.plan.bytes,
            passes: self.gpu.timings.totals(),
            ..self.stats.clone()
        }
    }
}

/// Radius and focus of a camera's lens, in metres; radius 0 of a pinhole and of parallel cameras.
fn lens_of(camera: &Camera) -> [f32; 2] {
    let lens = camera.lens.filter(|_| matches!(camera.projection, Projection::Perspective { .. }));
    lens.map_or([0.0, 1.0], |l| [l.radius, l.focus])
}

/// Whether the device can bind so many bytes of what only many lights need.
fn check_binding(gpu: &Gpu, what: &str, bytes: usize) -> Result<(), RenderError> {
    let limit = gpu.capabilities.max_storage_bytes;
    if bytes as u64 <= limit {
        return Ok(());
    }
    let text = format!(
        "the scene's lights: {what} would need a binding of {bytes} bytes; the adapter's limit is {limit}: use \
         --light-sampling power, fewer lights or --method reference"
    );
    Err(GpuError::Device(text).into())
}

/// Units of the splats per unit of radiance: a power of two that gives the scene's mean radiance 32 bits below the point and
/// leaves 31 above it.
fn splat_scale(power: f32, radius: f32) -> f32 {
    let mean = f64::from(power) / (4.0 * std::f64::consts::PI.powi(2) * f64::from(radius).powi(2));
    if mean > 0.0 && mean.is_finite() { (32.0 - mean.log2().round()).clamp(-90.0, 90.0).exp2() as f32 } else { 1.0 }
}
