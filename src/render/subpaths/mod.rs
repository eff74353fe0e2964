//! Renders a scene with rays of each pixel's own: path tracing, or bidirectional path tracing (Veach 1997; Sun 2020) with
//! every strategy (s, t), s >= 0 and t >= 1.
//!
//! A sample has one eye subpath per pixel and, in bidirectional path tracing, one light subpath per pixel.
//! Light subpaths are traced first, connected with the camera and stored. Eye subpaths are connected with
//! lights and with the vertices stored for their pixel. Pixels are processed in groups, so that the stored
//! vertices fit a binding. The estimators are unbiased, except that a path tracks only the medium that it
//! entered last (docs/limits.md).

pub mod plan;
pub mod reservoirs;

use async_trait::async_trait;
use web_time::Instant;

use crate::film::{self, Film};
use crate::gpu::{Compute, Flag, Gpu, read_back_async};
use crate::render::adapt::adapted;
use crate::render::adaptive_sampling::{self, ConvergedTiles};
use crate::render::frame_uniform::camera_uniform;
use crate::render::layouts::strategy::ANY;
use crate::render::layouts::{self, FrameUniform};
use crate::render::lights::table::{Hittable, LightTable};
use crate::render::lights::tree::LightTree;
use crate::render::renderer::{
    BatchSize, RenderError, RenderStats, Renderer, camera_of, check_size, clear, read_buffers, read_film, write_buffers,
};
use crate::render::state::RenderState;
use crate::render::subpaths::plan::PathPlan;
use crate::render::subpaths::reservoirs::Reservoirs;
use crate::render::upload::deformation::Deformer;
use crate::render::upload::gpu_scene::GpuScene;
use crate::scene::{Camera, Geometry, Projection, Scene, SceneStats};
use crate::settings::{LightSampling, Method, OnlyStrategy, RestirBias, Settings};

/// Most samples of a batch.
const BATCH: u64 = 64;

/// Buffers that all pixels share (shaders/lib/paths/paths.wesl).
struct Shared {
    frame: wgpu::Buffer,
    paths: wgpu::Buffer,
}

/// Buffers per pixel.
struct Pixels {
    radiance: wgpu::Buffer,
    film: wgpu::Buffer,
    log: wgpu::Buffer,
    /// Vertices of light subpaths, and splats.
    light: Option<(wgpu::Buffer, wgpu::Buffer)>,
    /// Converged tiles, if sampling is adaptive.
    converged: Option<ConvergedTiles>,
}

/// The data of a scene that is computed on the CPU.
struct Prepared {
    geometry: Geometry,
    plan: PathPlan,
    table: LightTable,
    constants: layouts::Paths,
    uniform: FrameUniform,
}

impl Prepared {
    fn new(gpu: &Gpu, scene: &Scene, geometry: Geometry, settings: &Settings) -> Result<Self, RenderError> {
        let camera = camera_of(scene, settings)?;
        let limit = gpu.capabilities.max_storage_bytes;
        check_size(gpu, settings, limit / 64)?;
        let stats = SceneStats::new(scene, &geometry);
        let bidirectional = settings.method() == Method::Bdpt;
        let plan = PathPlan::new(scene, &stats, settings, &gpu.capabilities);
        plan.tracing.check(gpu)?;
        let mut table =
            LightTable::new(scene, &geometry, if bidirectional { Hittable::All } else { Hittable::ButConstantSky });
        if plan.light_sampling == LightSampling::Uniform {
            table = table.uniform_selection();
        }
        if plan.light_sampling.has_tree() {
            let tree = LightTree::new(&table, scene, &geometry);
            table.records.iter_mut().zip(&tree.trails).for_each(|(record, trail)| record.trail = *trail);
            table.nodes = tree.nodes;
        }
        let [lens_radius, focus] = lens_of(&camera);
        let constants = layouts::Paths {
            seed: settings.seed,
            lens_radius,
            focus,
            only_s: ANY,
            only_t: ANY,
            tree_lights: table.finite as u32,
            tree_share: table.finite_share(),
            biased_reuse: u32::from(settings.restir_bias == RestirBias::Biased),
            memory: settings.restir_memory,
            ..Default::default()
        };
        let splat_scale = table.splat_scale(geometry.sphere().1);
        let uniform = FrameUniform { bounces: plan.bounces, splat_scale, ..camera_uniform(&camera, settings) };
        Ok(Self { geometry, plan, table, constants, uniform })
    }
}

/// A renderer of one light and one eye subpath per pixel.
pub struct PathRenderer<'gpu> {
    gpu: &'gpu Gpu,
    scene: GpuScene,
    settings: Settings,
    constants: layouts::Paths,
    uniform: FrameUniform,
    plan: PathPlan,
    light_paths: Option<Compute>,
    reservoirs: Option<Reservoirs>,
    eye_paths: Compute,
    resolve: Compute,
    shared: Shared,
    pixels: Pixels,
    deformer: Deformer,
    /// Number of the picture's first sample in the sequence.
    first: u64,
    /// Number of the next sample.
    samples: u64,
    batch_size: BatchSize,
    stats: RenderStats,
    warnings: Vec<String>,
}

impl<'gpu> PathRenderer<'gpu> {
    /// Uploads the scene, and builds the data structure of its rays and the pipelines. The method is `path` or
    /// `bdpt`.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if a value is out of range, the device cannot hold the image, or the camera
    /// does not exist; [`RenderError::Gpu`] if the device fails or was opened without ray queries.
    pub async fn new_async(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
        let scene = &*adapted(scene, settings)?;
        let (geometry, sources) = Geometry::with_sources(scene);
        let Prepared { geometry, plan, table, constants, uniform } = Prepared::new(gpu, scene, geometry, settings)?;
        let bidirectional = settings.method() == Method::Bdpt;
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        // The pipelines are compiled while the scene is uploaded.
        let light_paths = bidirectional.then(|| Compute::new(gpu, "subpaths/light_paths", &plan.flags));
        let reservoirs = plan
            .light_sampling
            .resamples()
            .then(|| Reservoirs::new(gpu, &plan.flags, pixels, plan.light_sampling == LightSampling::Restir));
        let eye_paths = Compute::new(gpu, "subpaths/eye_paths", &plan.flags);
        let resolve = Compute::new(gpu, "subpaths/resolve", &plan.flags);
        // The shaders always read the number of lights.
        let flags = [plan.flags.as_slice(), &[Flag::Punctual]].concat();
        let mut gpu_scene = GpuScene::new(gpu, scene, &geometry, &table, &flags)?;
        let mut deformer = Deformer::default();
        deformer.refine(gpu, &gpu_scene, scene, &geometry, &sources)?;
        gpu_scene.trace_with(gpu, plan.tracing, scene, &geometry).await?;
        deformer.keep(geometry, sources);
        let frame = gpu.uniform::<FrameUniform>("frame");
        gpu.queue.write_buffer(&frame, 0, bytemuck::bytes_of(&uniform));
        let mut this = Self {
            light_paths,
            reservoirs,
            eye_paths,
            resolve,
            shared: Shared { frame, paths: gpu.uniform::<layouts::Paths>("paths") },
            pixels: Pixels {
                radiance: gpu.storage("radiance", pixels * 16),
                film: gpu.storage("film", pixels * film::DEVICE_BYTES),
                log: gpu.storage("log", 16),
                light: bidirectional
                    .then(|| (gpu.storage("path_vertices", plan.vertex_bytes), gpu.storage("splats", pixels * 24))),
                converged: settings.skips_tiles().then(|| ConvergedTiles::new(gpu, settings)),
            },
            gpu,
            stats: RenderStats { scene_bytes: gpu_scene.bytes + deformer.bytes(), ..Default::default() },
            scene: gpu_scene,
            settings: settings.clone(),
            constants,
            uniform,
            plan,
            deformer,
            first: 0,
            samples: 0,
            batch_size: BatchSize::default(),
            warnings: scene.warnings.clone(),
        };
        this.select_strategy(settings.only);
        gpu.finish_pipelines();
        gpu.check()?;
        Ok(this)
    }

    /// Waits for [`Self::new_async`].
    ///
    /// # Errors
    /// As [`Self::new_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn new(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        pollster::block_on(Self::new_async(gpu, scene, settings))
    }

    /// Begins a picture in which one strategy counts, or all.
    fn select_strategy(&mut self, only: Option<OnlyStrategy>) {
        self.constants.only_s = only.map_or(ANY, |o| o.s);
        self.constants.only_t = only.map_or(ANY, |o| o.t);
        self.constants.unweighted = u32::from(only.is_some_and(|o| !o.weighted));
        self.restart(self.constants.seed);
    }

    /// Returns the bindings of all passes over paths.
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
        bindings.extend(self.pixels.converged.iter().map(ConvergedTiles::binding));
        if let Some((vertices, splats)) = &self.pixels.light {
            bindings.extend([("path_vertices", vertices.as_entire_binding()), ("splats", splats.as_entire_binding())]);
        }
        bindings
    }

    /// Returns the plan of a sample.
    #[must_use]
    pub fn plan(&self) -> &PathPlan {
        &self.plan
    }

    /// Writes the constants of a dispatch over `count` pixels from `first`, of the sample `number`.
    pub fn describe(&self, number: u64, first: u32, count: u32) {
        let constants = layouts::Paths { number: number as u32, first, count, ..self.constants };
        self.gpu.queue.write_buffer(&self.shared.paths, 0, bytemuck::bytes_of(&constants));
    }

    /// Returns the buffers that the next sample adds to or reuses.
    fn state_buffers(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        let reused = self.reservoirs.iter().filter(|_| self.plan.light_sampling.reuses());
        std::iter::once(&self.pixels.film).chain(reused.flat_map(Reservoirs::buffers))
    }

    /// Records and submits one sample of every pixel.
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
                light_paths.record(self.gpu, &mut encoder, [count, 1], &bindings);
            }
            if let Some(reservoirs) = &self.reservoirs {
                reservoirs.record(self.gpu, &mut encoder, count, &bindings);
            }
            self.eye_paths.record(self.gpu, &mut encoder, [count, 1], &bindings);
            if first + count == pixels {
                let size = [self.settings.width, self.settings.height];
                self.resolve.record(self.gpu, &mut encoder, size, &bindings);
            }
            self.gpu.queue.submit([encoder.finish()]);
        }
    }
}

#[async_trait(?Send)]
impl Renderer for PathRenderer<'_> {
    async fn render_async(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        let end = self.samples + samples;
        while self.samples < end {
            let count = self.batch_size.next(BATCH.min(end - self.samples));
            let (began, next) = (Instant::now(), self.samples + count);
            (self.samples..next).for_each(|number| self.sample(number));
            let non_finite: Vec<u32> = read_back_async(self.gpu, &self.pixels.log, 1).await?;
            self.stats.non_finite += u64::from(non_finite[0]);
            self.gpu.queue.write_buffer(&self.pixels.log, 0, &[0; 4]);
            self.gpu.timings.collect(self.gpu).await?;
            self.batch_size.record(count, began.elapsed());
            self.samples = next;
            if !progress(self.samples) {
                break;
            }
        }
        Ok(())
    }

    async fn pose_async(&mut self, scene: &Scene) -> Result<(), RenderError> {
        let scene = &*adapted(scene, &self.settings)?;
        let (geometry, sources, same) = self.deformer.flatten(scene);
        let prepared = Prepared::new(self.gpu, scene, geometry, &self.settings)?;
        if prepared.plan != self.plan || !self.scene.fits(scene, &prepared.geometry, &prepared.table) {
            *self = Self::new_async(self.gpu, scene, &self.settings).await?;
            return Ok(());
        }
        let Prepared { geometry, table, constants, uniform, .. } = prepared;
        self.scene.pose(self.gpu, &geometry, !same, &table);
        self.deformer.run(self.gpu, &self.scene, scene, &geometry, &sources)?;
        self.scene.trace_with(self.gpu, self.plan.tracing, scene, &geometry).await?;
        self.deformer.keep(geometry, sources);
        self.gpu.queue.write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        self.uniform = uniform;
        self.constants = constants;
        self.stats = RenderStats { scene_bytes: self.scene.bytes + self.deformer.bytes(), ..Default::default() };
        self.select_strategy(self.settings.only);
        Ok(self.gpu.check()?)
    }

    async fn set_camera_async(&mut self, camera: &Camera) -> Result<(), RenderError> {
        let FrameUniform { bounces, splat_scale, .. } = self.uniform;
        self.uniform = FrameUniform { bounces, splat_scale, ..camera_uniform(camera, &self.settings) };
        let uniform = self.uniform;
        self.gpu.queue.write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        [self.constants.lens_radius, self.constants.focus] = lens_of(camera);
        self.stats = RenderStats { scene_bytes: self.scene.bytes + self.deformer.bytes(), ..Default::default() };
        self.restart(self.constants.seed);
        Ok(())
    }

    async fn set_only_async(&mut self, only: Option<OnlyStrategy>) -> Result<(), RenderError> {
        self.settings.only = only;
        self.select_strategy(only);
        Ok(())
    }

    fn samples(&self) -> u64 {
        self.samples
    }

    fn plan_text(&self) -> String {
        self.plan.to_string()
    }

    fn plan_json(&self) -> serde_json::Value {
        serde_json::to_value(&self.plan).unwrap_or_default()
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }

    fn restart(&mut self, seed: u32) {
        clear(self.gpu, &self.pixels.film);
        self.pixels.converged.iter_mut().for_each(|converged| converged.restart(self.gpu));
        self.constants.seed = seed;
        (self.first, self.samples) = (0, 0);
    }

    fn begin_at(&mut self, first: u64) -> Result<(), RenderError> {
        if self.plan.light_sampling.reuses() && self.settings.restir_memory > 0.0 {
            return Err(RenderError::Setting(
                "--restir-memory makes each sample depend on all those before; leave it out to render a part of the samples"
                    .to_owned(),
            ));
        }
        self.restart(self.constants.seed);
        if let Some(reservoirs) = &self.reservoirs {
            reservoirs.buffers().for_each(|buffer| clear(self.gpu, buffer));
            if let Some(before) = first.checked_sub(1).filter(|_| self.plan.light_sampling.reuses()) {
                // Its reservoirs are reused; its light is that of another part.
                self.sample(before);
                clear(self.gpu, &self.pixels.film);
            }
        }
        (self.first, self.samples) = (first, first);
        Ok(())
    }

    async fn state_async(&self) -> Result<RenderState, RenderError> {
        Ok(RenderState {
            first: self.first,
            next: self.samples,
            non_finite: self.stats.non_finite,
            tiles: self.pixels.converged.as_ref().map(ConvergedTiles::state),
            frames: None,
            buffers: read_buffers(self.gpu, self.state_buffers()).await?,
        })
    }

    fn restore(&mut self, state: &RenderState) -> Result<(), RenderError> {
        self.restart(self.constants.seed);
        ConvergedTiles::restore(self.pixels.converged.as_mut(), self.gpu, state.tiles.as_ref())?;
        write_buffers(self.gpu, self.state_buffers(), &state.buffers)?;
        (self.first, self.samples) = (state.first, state.next);
        self.stats.non_finite = state.non_finite;
        Ok(())
    }

    fn mark_converged(&mut self, tiles: &[bool]) -> Result<(), RenderError> {
        let converged = self.pixels.converged.as_mut().ok_or_else(adaptive_sampling::not_adaptive)?;
        converged.write(self.gpu, tiles, self.samples - self.first)
    }

    fn is_adaptive(&self) -> bool {
        self.settings.is_adaptive()
    }

    async fn film_async(&self) -> Result<Film, RenderError> {
        let Pixels { film, converged, .. } = &self.pixels;
        let samples = self.samples - self.first;
        read_film(self.gpu, std::iter::once(film), &self.settings, samples, converged.as_ref()).await
    }

    fn stats(&self) -> RenderStats {
        RenderStats {
            samples: self.samples - self.first,
            bytes: self.plan.bytes,
            tracer_bytes: self.scene.tracer_bytes(),
            passes: self.gpu.timings.totals(),
            ..self.stats.clone()
        }
    }
}

/// Returns the radius of a camera's lens and its focus distance, in metres. The radius of pinhole and
/// orthographic cameras is 0.
fn lens_of(camera: &Camera) -> [f32; 2] {
    let lens = camera.lens.filter(|_| matches!(camera.projection, Projection::Perspective { .. }));
    lens.map_or([0.0, 1.0], |l| [l.radius, l.focus])
}
