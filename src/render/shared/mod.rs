//! Renders a scene with the shared-subpath estimator: owns the frame, runs iterations in batches, and redoes
//! iterations whose lists overflowed.

pub mod build;
mod direct_light;
pub mod film_buffer;
pub mod frame;
pub mod growth;
mod light_subpath;
pub mod passes;
pub mod plan;
mod strategy_uniforms;
pub mod views;

use async_trait::async_trait;
use glam::Vec3;
use web_time::Instant;

use crate::film::Film;
use crate::film::filtered::FilteredFilm;
use crate::gpu::{Gpu, read_back_async};
use crate::render::adapt::{adapted, warnings};
use crate::render::adaptive_sampling::{self, ConvergedTiles};
use crate::render::convergence::BiasFilms;
use crate::render::denoise::Denoiser;
use crate::render::layouts::{LightVertex, PixelReservoir};
use crate::render::lights::aims::Aims;
use crate::render::lights::bundle_directions::BundleDirections;
use crate::render::lights::table::{Hittable, LightTable};
use crate::render::renderer::{
    BatchSize, RenderError, RenderStats, Renderer, ViewRequests, camera_of, check_size, clear, read_buffers, read_film,
    write_buffers,
};
use crate::render::shared::frame::{Frame, Iteration};
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::views::PlannedView;
use crate::render::state::RenderState;
use crate::render::upload::deformation::Deformer;
use crate::render::upload::gpu_scene::GpuScene;
use crate::scene::{Camera, Geometry, Scene, SceneStats};
use crate::settings::{LightSampling, OnlyStrategy, Settings, Strategies, Visibility, VisibilityFrom};

/// Most iterations of a batch: the log has a bit for each of them.
const BATCH: u64 = 32;

/// The data of a scene that is computed on the CPU.
struct Prepared {
    geometry: Geometry,
    camera: Camera,
    plan: FramePlan,
    lights: LightTable,
    stats: SceneStats,
}

impl Prepared {
    /// Prepares a scene. `forced` replaces the statistics of the scene.
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        geometry: Geometry,
        settings: &Settings,
        forced: Option<SceneStats>,
    ) -> Result<Self, RenderError> {
        let stats = forced.unwrap_or_else(|| SceneStats::new(scene, &geometry));
        let camera = camera_of(scene, settings)?;
        let plan = FramePlan::new(&stats, settings, &gpu.capabilities);
        plan.tracing.map_or(Ok(()), |tracing| tracing.check(gpu))?;
        let most = gpu.capabilities.max_storage_bytes;
        let reservoir = size_of::<PixelReservoir>() as u64;
        check_size(gpu, settings, if plan.reuses() { most / reservoir } else { u64::MAX })?;
        let mut table =
            LightTable::new(scene, &geometry, if plan.starts_from_emitters { Hittable::All } else { Hittable::Never });
        if plan.caustics {
            table.aims = Aims::new(scene, &geometry);
        }
        let uniform = settings.light_sampling == Some(LightSampling::Uniform);
        let lights = if uniform { table.uniform_selection() } else { table };
        Ok(Self { geometry, camera, plan, lights, stats })
    }
}

/// Lists that were too short in a batch.
struct Overflow {
    /// Draw items and list nodes that each view requested.
    requests: Vec<[u32; 2]>,
    /// A bit for each iteration of the batch that was skipped.
    skipped: u32,
}

/// A renderer of light subpaths that pixels share.
pub struct SharedRenderer<'gpu> {
    gpu: &'gpu Gpu,
    scene: GpuScene,
    lights: LightTable,
    /// The lights with probabilities by power alone, if lights are chosen for the view.
    by_power: Option<LightTable>,
    camera: Camera,
    settings: Settings,
    plan: FramePlan,
    frame: Frame,
    deformer: Deformer,
    /// Number of the picture's first sample in the sequence.
    first: u64,
    /// Number of the next sample.
    samples: u64,
    batch_size: BatchSize,
    stats: RenderStats,
    /// The statistics that the plan follows from.
    scene_stats: SceneStats,
    warnings: Vec<String>,
}

impl<'gpu> SharedRenderer<'gpu> {
    /// Uploads the scene, and builds the passes and buffers of its plan.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if a value is out of range, the device cannot hold the image, or the camera
    /// does not exist; [`RenderError::Gpu`] if the device fails.
    pub async fn new_async(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        Self::of(gpu, scene, settings, None).await
    }

    /// Waits for [`Self::new_async`].
    ///
    /// # Errors
    /// As [`Self::new_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn new(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        pollster::block_on(Self::new_async(gpu, scene, settings))
    }

    /// As [`Self::new_async`] with other statistics than those of the scene: features that the statistics list have
    /// their passes, code and buffers even if the scene lacks them. Tests measure the gain of skipping
    /// against such a renderer.
    ///
    /// # Errors
    /// As [`Self::new_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn forced(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings, facts: SceneStats) -> Result<Self, RenderError> {
        pollster::block_on(Self::of(gpu, scene, settings, Some(facts)))
    }

    async fn of(
        gpu: &'gpu Gpu,
        scene: &Scene,
        settings: &Settings,
        forced: Option<SceneStats>,
    ) -> Result<Self, RenderError> {
        settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
        let scene = &*adapted(scene, settings)?;
        let (geometry, sources) = Geometry::with_sources(scene);
        let Prepared { geometry, camera, plan, lights, stats } = Prepared::new(gpu, scene, geometry, settings, forced)?;
        let flags = [plan.surface_flags.as_slice(), &plan.light_flags].concat();
        let mut gpu_scene = GpuScene::new(gpu, scene, &geometry, &lights, &flags)?;
        let environment = scene.environment.as_ref().filter(|_| plan.sky_bundles);
        let directions = environment.and_then(BundleDirections::new);
        // Its pipelines are compiled while the scene is refined, and rasterized into a grid.
        let frame = Frame::new(gpu, &gpu_scene, &plan, settings, directions);
        let mut deformer = Deformer::default();
        deformer.refine(gpu, &gpu_scene, scene, &geometry, &sources)?;
        if let Some(tracing) = plan.tracing {
            gpu_scene.trace_with(gpu, tracing, scene, &geometry).await?;
        }
        deformer.keep(geometry, sources);
        let mut this = Self {
            gpu,
            stats: RenderStats { scene_bytes: gpu_scene.bytes + deformer.bytes(), ..Default::default() },
            scene: gpu_scene,
            by_power: plan.lights_for_view.then(|| lights.clone()),
            lights,
            camera,
            settings: settings.clone(),
            plan,
            frame,
            deformer,
            first: 0,
            samples: 0,
            batch_size: BatchSize::default(),
            scene_stats: stats,
            warnings: warnings(scene, settings),
        };
        if gpu.capabilities.compiles_late {
            // One pass after the other would wait for its own shader.
            gpu.finish_pipelines();
        }
        this.learn_view().await?;
        gpu.finish_pipelines();
        gpu.check()?;
        Ok(this)
    }

    /// Begins a picture of a new pose or camera. A denoised picture keeps the history of the last one.
    async fn begin(&mut self) -> Result<(), RenderError> {
        self.stats = RenderStats { scene_bytes: self.scene.bytes + self.deformer.bytes(), ..Default::default() };
        if self.frame.denoiser.is_none() {
            self.restart(self.settings.seed);
        }
        self.learn_view().await?;
        Ok(self.gpu.check()?)
    }

    /// Takes back the probabilities that were set for a view.
    fn choose_lights_by_power(&mut self) {
        if let Some(by_power) = &self.by_power {
            self.lights = by_power.clone();
            self.scene.relight(self.gpu, &self.lights);
        }
    }

    /// Learns where light comes from that the view shows, as planned.
    async fn learn_view(&mut self) -> Result<(), RenderError> {
        // What is learned is that of the whole image, also if a crop is rendered.
        self.frame.pixels.converged.iter().for_each(|converged| converged.suspend(self.gpu));
        self.choose_lights_for_view().await?;
        let Self { frame, gpu, scene, camera, lights, settings, .. } = self;
        let iteration = Iteration { gpu, scene, camera, lights, settings, number: 0, batch_index: None };
        frame.find_light_borders(&iteration);
        frame.guide_sky(&iteration).await?;
        frame.pixels.converged.iter().for_each(|converged| converged.upload(gpu));
        Ok(())
    }

    /// Sets the probabilities of lights by their unoccluded contribution to the view, if planned.
    async fn choose_lights_for_view(&mut self) -> Result<(), RenderError> {
        if self.by_power.is_none() {
            return Ok(());
        }
        let Self { frame, gpu, scene, camera, lights, settings, .. } = self;
        let iteration = Iteration { gpu, scene, camera, lights, settings, number: 0, batch_index: None };
        let importance = frame.light_importance(&iteration).await?;
        self.lights.mix_importance(&importance);
        self.scene.relight(self.gpu, &self.lights);
        // Cached light points hold the probabilities of the view before.
        self.frame.invalidate_maps();
        Ok(())
    }

    /// Returns the plan of an iteration.
    #[must_use]
    pub fn plan(&self) -> &FramePlan {
        &self.plan
    }

    /// Runs iterations until all of them are in the film, in this order. After an overflow the later
    /// iterations are skipped and redone too, so that sums round alike for any size of batches.
    async fn batch(&mut self, mut iterations: Vec<u64>) -> Result<(), RenderError> {
        loop {
            for (index, &iteration) in iterations.iter().enumerate() {
                self.iterate(iteration, Some(index as u32));
            }
            let Some(Overflow { requests, skipped }) = self.read_log().await? else { return Ok(()) };
            self.stats.redone += u64::from(skipped.count_ones());
            log::info!("lists overflowed in {} iterations; redoing them with more capacity", skipped.count_ones());
            self.frame.grow(self.gpu, &self.scene, &requests)?;
            iterations =
                iterations.iter().enumerate().filter(|(i, _)| skipped >> i & 1 == 1).map(|(_, &n)| n).collect();
            // The history of the first of them is lost. It must be that of the iteration before, since the
            // set of iterations that overflow depends on the capacity.
            if let (true, Some(before)) = (self.plan.reuses(), iterations[0].checked_sub(1)) {
                self.iterate(before, None);
            }
        }
    }

    /// Reads the log of a batch. Returns the overflow if iterations were skipped.
    async fn read_log(&mut self) -> Result<Option<Overflow>, RenderError> {
        self.gpu.timings.collect(self.gpu).await?;
        let words = 2 + 2 * self.frame.views.slots();
        let log: Vec<u32> = read_back_async(self.gpu, &self.frame.log, words).await?;
        self.gpu.queue.write_buffer(&self.frame.log, 0, &vec![0; log.len() * 4]);
        self.stats.non_finite += u64::from(log[0]);
        let slots: Vec<[u32; 2]> = log[2..].chunks_exact(2).map(|c| [c[0], c[1]]).collect();
        let requests = self.frame.views.requests_by_view(&slots);
        if self.stats.requests.is_empty() {
            let view = |view: PlannedView| ViewRequests {
                view: view.role.to_string(),
                resolution: view.texels.resolution,
                ..Default::default()
            };
            self.stats.requests = self.plan.views().into_iter().map(view).collect();
        }
        for (most, &[items, nodes]) in self.stats.requests.iter_mut().zip(&requests) {
            (most.items, most.nodes) = (most.items.max(items), most.nodes.max(nodes));
        }
        Ok((log[1] != 0).then_some(Overflow { requests, skipped: log[1] }))
    }

    /// Makes the reservoirs of the iteration before the next one, which reuses them.
    fn remake_reservoirs(&mut self) {
        if let (true, Some(before)) = (self.plan.reuses(), self.samples.checked_sub(1)) {
            self.iterate(before, None);
        }
    }

    /// Runs one iteration.
    fn iterate(&mut self, number: u64, batch_index: Option<u32>) {
        let Self { frame, gpu, scene, camera, lights, settings, .. } = self;
        frame.iterate(&Iteration { gpu, scene, camera, lights, settings, number, batch_index });
    }
}

#[async_trait(?Send)]
impl Renderer for SharedRenderer<'_> {
    async fn render_async(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        let end = self.samples + samples;
        while self.samples < end {
            // The first iteration is a batch of its own, so that little is redone if the initial capacity was
            // too small.
            let alone = self.samples == self.first || self.plan.is_layered();
            let count = self.batch_size.next(if alone { 1 } else { BATCH.min(end - self.samples) });
            let began = Instant::now();
            self.batch((self.samples..self.samples + count).collect()).await?;
            self.batch_size.record(count, began.elapsed());
            self.samples += count;
            self.frame.denoise(self.gpu, &self.scene);
            if !progress(self.samples) {
                break;
            }
        }
        self.gpu.timings.collect(self.gpu).await?;
        Ok(())
    }

    async fn pose_async(&mut self, scene: &Scene) -> Result<(), RenderError> {
        let scene = &*adapted(scene, &self.settings)?;
        let (geometry, sources, same) = self.deformer.flatten(scene);
        let prepared = Prepared::new(self.gpu, scene, geometry, &self.settings, None)?;
        // The bound of the geometry term of `paper` depends on the size of the scene and is a constant of the
        // passes.
        let reusable = prepared.plan.same_pipelines(&self.plan) && self.settings.strategies != Strategies::Paper;
        if !reusable || !self.scene.fits(scene, &prepared.geometry, &prepared.lights) {
            *self = Self::new_async(self.gpu, scene, &self.settings).await?;
            return Ok(());
        }
        let Prepared { geometry, camera, lights, stats, .. } = prepared;
        if let Some(denoiser) = &mut self.frame.denoiser {
            self.deformer.look_back(self.gpu, &self.scene, scene, &geometry, &sources);
            denoiser.scene_moves(self.gpu, &self.scene);
        }
        self.scene.pose(self.gpu, &geometry, !same, &lights);
        self.deformer.run(self.gpu, &self.scene, scene, &geometry, &sources)?;
        if let Some(tracing) = self.plan.tracing {
            self.scene.trace_with(self.gpu, tracing, scene, &geometry).await?;
        }
        self.deformer.keep(geometry, sources);
        self.frame.invalidate_views();
        self.by_power = self.plan.lights_for_view.then(|| lights.clone());
        (self.camera, self.lights, self.scene_stats) = (camera, lights, stats);
        self.warnings = warnings(scene, &self.settings);
        self.begin().await
    }

    async fn set_camera_async(&mut self, camera: &Camera) -> Result<(), RenderError> {
        self.camera = camera.clone();
        self.choose_lights_by_power();
        if let Some(denoiser) = &mut self.frame.denoiser {
            denoiser.camera_moved();
        }
        self.begin().await
    }

    async fn set_only_async(&mut self, only: Option<OnlyStrategy>) -> Result<(), RenderError> {
        self.settings.only = only;
        self.plan = FramePlan::new(&self.scene_stats, &self.settings, &self.gpu.capabilities);
        let directions = self.frame.directions.take();
        self.frame = Frame::new(self.gpu, &self.scene, &self.plan, &self.settings, directions);
        self.choose_lights_by_power();
        self.restart(self.settings.seed);
        self.begin().await
    }

    fn is_denoised(&self) -> bool {
        self.frame.denoiser.is_some()
    }

    fn aligned(&self, settings: Settings) -> Settings {
        let visibility_from = match self.settings.visibility() {
            Visibility::Exact if self.plan.traces_camera => VisibilityFrom::Grid,
            Visibility::Exact => VisibilityFrom::Lists,
            _ => settings.visibility_from,
        };
        Settings { interleave: Some(self.plan.grid.side), visibility_from, ..settings }
    }

    async fn vpls_async(&self) -> Result<Vec<Vec3>, RenderError> {
        let count = self.plan.light_vertices.saturating_sub(1) as usize;
        let stride = LightVertex::bytes(&self.plan.surface_flags);
        let bytes: Vec<u8> = read_back_async(self.gpu, &self.frame.light_vertices, count * stride).await?;
        let vertex = |bytes: &[u8]| bytemuck::pod_read_unaligned::<LightVertex>(&bytes[..size_of::<LightVertex>()]);
        // Vertices of subpaths that ended earlier have zero throughput.
        let traced = bytes.chunks_exact(stride).map(vertex).filter(|v| v.throughput != [0.0; 3]);
        Ok(traced.map(|v| Vec3::from(v.position)).collect())
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
        self.frame.pixels.films().for_each(|film| clear(self.gpu, film));
        self.frame.pixels.converged.iter_mut().for_each(|converged| converged.restart(self.gpu));
        if let Some(denoiser) = &mut self.frame.denoiser {
            denoiser.restart();
        }
        self.settings.seed = seed;
        (self.first, self.samples) = (0, 0);
    }

    fn begin_at(&mut self, first: u64) -> Result<(), RenderError> {
        if self.settings.history > 0 {
            return Err(RenderError::Setting(
                "--history averages each sample with those before; leave it out to render a part of the samples"
                    .to_owned(),
            ));
        }
        self.restart(self.settings.seed);
        (self.first, self.samples) = (first, first);
        if let Some(denoiser) = &mut self.frame.denoiser {
            denoiser.begin_at(first);
        }
        self.remake_reservoirs();
        Ok(())
    }

    async fn state_async(&self) -> Result<RenderState, RenderError> {
        let denoiser = self.frame.denoiser.as_ref();
        let histories = denoiser.into_iter().flat_map(Denoiser::state_buffers);
        Ok(RenderState {
            first: self.first,
            next: self.samples,
            non_finite: self.stats.non_finite,
            tiles: self.frame.pixels.converged.as_ref().map(ConvergedTiles::state),
            frames: denoiser.map(Denoiser::state),
            buffers: read_buffers(self.gpu, self.frame.pixels.films().chain(histories)).await?,
        })
    }

    fn restore(&mut self, state: &RenderState) -> Result<(), RenderError> {
        self.restart(self.settings.seed);
        match (&mut self.frame.denoiser, &state.frames) {
            (Some(denoiser), Some(frames)) => denoiser.restore(frames),
            (None, None) => {}
            _ => return Err(RenderError::foreign_state()),
        }
        ConvergedTiles::restore(self.frame.pixels.converged.as_mut(), self.gpu, state.tiles.as_ref())?;
        let histories = self.frame.denoiser.iter().flat_map(Denoiser::state_buffers);
        write_buffers(self.gpu, self.frame.pixels.films().chain(histories), &state.buffers)?;
        (self.first, self.samples) = (state.first, state.next);
        self.stats.non_finite = state.non_finite;
        self.remake_reservoirs();
        Ok(())
    }

    fn mark_converged(&mut self, tiles: &[bool]) -> Result<(), RenderError> {
        let converged = self.frame.pixels.converged.as_mut().ok_or_else(adaptive_sampling::not_adaptive)?;
        converged.write(self.gpu, tiles, self.samples - self.first)
    }

    fn is_adaptive(&self) -> bool {
        self.plan.adaptive
    }

    async fn film_async(&self) -> Result<Film, RenderError> {
        match &self.frame.denoiser {
            Some(denoiser) => Ok(denoiser.film(self.gpu).await?.cropped(self.settings.crop)),
            None => {
                let pixels = &self.frame.pixels;
                let samples = self.samples - self.first;
                read_film(self.gpu, pixels.films(), &self.settings, samples, pixels.converged.as_ref()).await
            }
        }
    }

    async fn filtered_film_async(&self) -> Result<Option<FilteredFilm>, RenderError> {
        let Some(denoiser) = &self.frame.denoiser else { return Ok(None) };
        let filtered = denoiser.filtered(self.gpu).await?;
        Ok(filtered.map(|filtered| filtered.cropped(self.settings.crop)))
    }

    async fn bias_films_async(&self) -> Result<Option<BiasFilms>, RenderError> {
        let Some(denoiser) = &self.frame.denoiser else { return Ok(None) };
        let films = denoiser.bias_films(self.gpu).await?;
        Ok(films.map(|films| films.cropped(self.settings.crop)))
    }

    fn stats(&self) -> RenderStats {
        RenderStats {
            samples: self.samples - self.first,
            bytes: self.frame.bytes(),
            tracer_bytes: self.scene.tracer_bytes(),
            passes: self.gpu.timings.totals(),
            ..self.stats.clone()
        }
    }
}
