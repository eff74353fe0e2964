//! Renders a scene by rasterization: owns the frame, runs iterations in batches, redoes those that ran out of room.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use glam::Vec3;

use crate::bundle_directions::BundleDirections;
use crate::convergence::BiasFilms;
use crate::film::{self, Film};
use crate::frame::Frame;
use crate::gpu::{Gpu, GpuError, PassTime, read_back};
use crate::gpu_scene::GpuScene;
use crate::layouts::{LightVertex, PoolSite};
use crate::light_table::{LightTable, Met};
use crate::plan::FramePlan;
use crate::posing::Posing;
use crate::scene::{Camera, Geometry, Scene, SceneStats};
use crate::settings::{LightSampling, Settings, Strategies};
use crate::tiles::{self, Settled};
use crate::view::room_for;

/// Most iterations of a batch; the log has 32 bits for them.
const BATCH: u64 = 8;

/// Seconds that a batch should take: a render can be stopped between two batches.
const BATCH_SECONDS: f64 = 0.5;

/// Chooses the size of the next batch from the time that the last one took.
#[derive(Clone, Copy, Debug, Default)]
pub struct BatchSize {
    samples: u64,
    seconds: f64,
}

impl BatchSize {
    /// Samples that take half a second at the rate of the last batch: at least 1, at most `most` and twice
    /// the last batch.
    #[must_use]
    pub fn next(&self, most: u64) -> u64 {
        let fit = BATCH_SECONDS * self.samples as f64 / self.seconds.max(1e-9);
        (fit as u64).clamp(1, 2 * self.samples.max(1)).min(most)
    }

    /// Records a batch.
    pub fn record(&mut self, samples: u64, time: Duration) {
        (self.samples, self.seconds) = (samples, time.as_secs_f64());
    }
}

/// Why a picture could not be rendered.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RenderError {
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A setting that this scene or device cannot have.
    #[error("{0}")]
    Setting(String),
}

/// What a render did beside its picture.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct RenderStats {
    /// Iterations in the picture.
    pub samples: u64,
    /// Values that were not finite.
    pub non_finite: u64,
    /// Nodes missing from the picture; always 0, since iterations that lose any are redone.
    pub lost_nodes: u64,
    /// Iterations that were redone with more room.
    pub redone: u64,
    /// Bytes on the device beside the scene.
    pub bytes: u64,
    /// Bytes of the scene on the device.
    pub scene_bytes: u64,
    /// Largest draw items and nodes that each view wanted.
    pub demands: Vec<[u32; 2]>,
    /// Device time and runs per pass.
    pub passes: BTreeMap<&'static str, PassTime>,
}

/// What renders a picture bit by bit.
pub trait Progressive {
    /// Adds samples to the picture, in batches; `progress` is told how many it has and may stop it by returning false.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] where the device reports an error or cannot hold what the scene needs.
    fn render(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError>;

    /// Begins a new picture with another seed; no tile of it has settled.
    fn restart(&mut self, seed: u32);

    /// Says which tiles of the picture take no more samples, row by row, one for each square of [`tiles::TILE`] pixels, those at the
    /// right and at the bottom perhaps smaller. These keep the pictures they have; the others go on as if all did.
    ///
    /// # Errors
    /// [`RenderError::Setting`] for another number of tiles, and where [`Self::settles`] is false.
    fn settle(&mut self, tiles: &[bool]) -> Result<(), RenderError>;

    /// Whether tiles may settle: not where frames are filtered.
    #[must_use]
    fn settles(&self) -> bool;

    /// The picture so far: the mean of each pixel's samples.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    fn film(&self) -> Result<Film, RenderError>;

    /// Where pictures are filtered and an error is asked for: the picture unfiltered, and filtered twice.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    fn bias_films(&self) -> Result<Option<BiasFilms>, RenderError> {
        Ok(None)
    }

    /// Counts and times so far.
    #[must_use]
    fn stats(&self) -> RenderStats;
}

/// What of a scene does not need the device.
struct Prepared {
    geometry: Geometry,
    camera: Camera,
    plan: FramePlan,
    lights: LightTable,
}

impl Prepared {
    /// Where other facts of the scene are `forced`, these are believed.
    fn new(
        gpu: &Gpu,
        scene: &Scene,
        geometry: Geometry,
        settings: &Settings,
        forced: Option<SceneStats>,
    ) -> Result<Self, RenderError> {
        settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
        let stats = forced.unwrap_or_else(|| SceneStats::new(scene, &geometry));
        let camera = camera_of(scene, settings)?;
        let plan = FramePlan::new(&stats, settings, &gpu.capabilities);
        let most = gpu.capabilities.max_storage_bytes;
        let kept = size_of::<PoolSite>() as u64;
        check_size(gpu, settings, if plan.reuses() { most / kept } else { u64::MAX })?;
        let table = LightTable::new(scene, &geometry, if plan.starts_from_met { Met::All } else { Met::Never });
        let even = settings.light_sampling == Some(LightSampling::Uniform);
        Ok(Self { geometry, camera, plan, lights: if even { table.even() } else { table } })
    }
}

/// A scene being rendered by rasterization.
pub struct Renderer<'gpu> {
    gpu: &'gpu Gpu,
    scene: GpuScene,
    lights: LightTable,
    /// The same by power alone, where they are chosen for the view.
    by_power: Option<LightTable>,
    camera: Camera,
    settings: Settings,
    plan: FramePlan,
    frame: Frame,
    posing: Posing,
    samples: u64,
    batch_size: BatchSize,
    stats: RenderStats,
}

impl<'gpu> Renderer<'gpu> {
    /// Uploads the scene and builds what its plan asks for.
    ///
    /// # Errors
    /// [`RenderError::Setting`] for a value out of its range, an image that the device cannot hold or a camera that is not there;
    /// [`RenderError::Gpu`].
    pub fn new(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        Self::of(gpu, scene, settings, None)
    }

    /// The same for a scene of which other facts are believed: what these say is there has its passes, its code and its buffers,
    /// whether there is any or not. What skipping saves is measured against it.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn forced(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings, facts: SceneStats) -> Result<Self, RenderError> {
        Self::of(gpu, scene, settings, Some(facts))
    }

    fn of(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings, forced: Option<SceneStats>) -> Result<Self, RenderError> {
        let (geometry, sources) = Geometry::with_sources(scene);
        let Prepared { geometry, camera, plan, lights } = Prepared::new(gpu, scene, geometry, settings, forced)?;
        let flags = [plan.surface_flags.as_slice(), &plan.light_flags].concat();
        let mut gpu_scene = GpuScene::new(gpu, scene, &geometry, &lights, &flags)?;
        let mut posing = Posing::default();
        posing.refine(gpu, &gpu_scene, scene, &geometry, &sources)?;
        if plan.rays {
            gpu_scene.accelerate(gpu, scene, &geometry)?;
        }
        posing.keep(geometry, sources);
        let environment = scene.environment.as_ref().filter(|_| plan.sky_bundles);
        let directions = environment.and_then(BundleDirections::new);
        let frame = Frame::new(gpu, &gpu_scene, &plan, settings, directions);
        let mut this = Self {
            gpu,
            stats: RenderStats { scene_bytes: gpu_scene.bytes + posing.bytes(), ..Default::default() },
            scene: gpu_scene,
            by_power: plan.lights_for_view.then(|| lights.clone()),
            lights,
            camera,
            settings: settings.clone(),
            plan,
            frame,
            posing,
            samples: 0,
            batch_size: BatchSize::default(),
        };
        this.favour_lights()?;
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
        let prepared = Prepared::new(self.gpu, scene, geometry, &self.settings, None)?;
        // The clamp of `paper` is a share of the scene's size, which its pipelines' constants hold.
        let kept = prepared.plan.does_as(&self.plan) && self.settings.strategies != Strategies::Paper;
        if !kept || !self.scene.fits(scene, &prepared.geometry, &prepared.lights) {
            *self = Self::new(self.gpu, scene, &self.settings)?;
            return Ok(());
        }
        let Prepared { geometry, camera, lights, .. } = prepared;
        if let Some(live) = &mut self.frame.live {
            self.posing.look_back(self.gpu, &self.scene, scene, &geometry, &sources);
            live.change(self.gpu, &self.scene);
        }
        self.scene.pose(self.gpu, &geometry, !same, &lights);
        self.posing.run(self.gpu, &self.scene, scene, &geometry, &sources)?;
        if self.plan.rays {
            self.scene.accelerate(self.gpu, scene, &geometry)?;
        }
        self.posing.keep(geometry, sources);
        self.frame.forget_looks();
        self.by_power = self.plan.lights_for_view.then(|| lights.clone());
        (self.camera, self.lights) = (camera, lights);
        self.begin()
    }

    /// Begins a picture of the same scene from elsewhere: the one that a new renderer would make. Nothing is built or uploaded.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn look(&mut self, camera: &Camera) -> Result<(), RenderError> {
        self.camera = camera.clone();
        if let Some(by_power) = &self.by_power {
            self.lights = by_power.clone();
            self.scene.relight(self.gpu, &self.lights);
        }
        if let Some(live) = &mut self.frame.live {
            live.look();
        }
        self.begin()
    }

    /// What a new pose and a new camera have in common. A picture that is filtered frame by frame goes on from the last one.
    fn begin(&mut self) -> Result<(), RenderError> {
        self.stats = RenderStats { scene_bytes: self.scene.bytes + self.posing.bytes(), ..Default::default() };
        if self.frame.live.is_none() {
            self.restart(self.settings.seed);
        }
        self.favour_lights()?;
        Ok(self.gpu.check()?)
    }

    /// Has lights chosen for what they give the view, where the plan says so.
    fn favour_lights(&mut self) -> Result<(), RenderError> {
        if self.by_power.is_some() {
            let gifts = self.frame.light_gifts(self.gpu, &self.scene, &self.camera, &self.lights, &self.settings)?;
            self.lights.favour(&gifts);
            self.scene.relight(self.gpu, &self.lights);
        }
        Ok(())
    }

    /// The VPLs of the last iteration, world space.
    ///
    /// # Errors
    /// [`RenderError::Gpu`].
    pub fn vpls(&self) -> Result<Vec<Vec3>, RenderError> {
        let count = self.plan.light_vertices.saturating_sub(1) as usize;
        let vertices: Vec<LightVertex> = read_back(self.gpu, &self.frame.light_vertices, count)?;
        // One that was not made carries nothing.
        let made = vertices.iter().filter(|v| v.throughput != [0.0; 3]);
        Ok(made.map(|v| Vec3::from(v.position)).collect())
    }

    /// What each iteration does.
    #[must_use]
    pub fn plan(&self) -> &FramePlan {
        &self.plan
    }

    /// Runs some iterations until all of them are in the film, in this order: where one ran out of room, the
    /// later ones wait for it, so that the sums round alike however many iterations a batch has.
    fn batch(&mut self, mut iterations: Vec<u64>) -> Result<(), RenderError> {
        loop {
            for (index, &iteration) in iterations.iter().enumerate() {
                self.iterate(iteration, Some(index as u32));
            }
            self.gpu.timings.collect(self.gpu)?;
            let log: Vec<u32> = read_back(self.gpu, &self.frame.log, 2 + 2 * self.frame.fills())?;
            self.gpu.queue.write_buffer(&self.frame.log, 0, &vec![0; log.len() * 4]);
            self.stats.non_finite += u64::from(log[0]);
            let fills: Vec<[u32; 2]> = log[2..].chunks_exact(2).map(|c| [c[0], c[1]]).collect();
            let needed = self.frame.of_views(&fills);
            self.stats.demands.resize(needed.len(), [0; 2]);
            for (most, now) in self.stats.demands.iter_mut().zip(&needed) {
                *most = [most[0].max(now[0]), most[1].max(now[1])];
            }
            let skipped = log[1];
            if skipped == 0 {
                return Ok(());
            }
            let limit = self.gpu.capabilities.max_storage_bytes;
            for (&[_, nodes], texels) in needed.iter().zip(self.plan.views()) {
                let bytes = 4 * self.plan.list_words(texels, room_for(u64::from(nodes)));
                if bytes > limit {
                    let resolution = texels.resolution;
                    return Err(RenderError::Setting(format!(
                        "a view of {resolution}^2 texels needs {nodes} list nodes, more than this device can bind; choose a smaller \
                         --bundle-resolution, --light-resolution or --vpl-resolution"
                    )));
                }
            }
            self.stats.redone += u64::from(skipped.count_ones());
            log::info!("lists ran out of room in {} iterations; redoing them with more", skipped.count_ones());
            self.frame.grow(self.gpu, &self.scene, &needed);
            iterations =
                iterations.iter().enumerate().filter(|(i, _)| skipped >> i & 1 == 1).map(|(_, &n)| n).collect();
            // What the first of them looks back at is gone. It must be the iteration before it and no other, since which iterations
            // run out of room depends on what they would bring.
            if let (true, Some(before)) = (self.plan.reuses(), iterations[0].checked_sub(1)) {
                self.iterate(before, None);
            }
        }
    }

    fn iterate(&mut self, iteration: u64, batch_index: Option<u32>) {
        let Self { frame, gpu, scene, camera, lights, settings, .. } = self;
        frame.iterate(gpu, scene, camera, lights, settings, iteration, batch_index);
    }
}

impl Progressive for Renderer<'_> {
    fn render(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        let end = self.samples + samples;
        while self.samples < end {
            // The first iteration alone, so that little has to be redone where the guess of room was too small.
            let alone = self.samples == 0 || self.plan.is_live();
            let count = self.batch_size.next(if alone { 1 } else { BATCH.min(end - self.samples) });
            let began = Instant::now();
            self.batch((self.samples..self.samples + count).collect())?;
            self.batch_size.record(count, began.elapsed());
            self.samples += count;
            self.frame.advance(self.gpu, &self.scene);
            if !progress(self.samples) {
                break;
            }
        }
        self.gpu.timings.collect(self.gpu)?;
        Ok(())
    }

    fn restart(&mut self, seed: u32) {
        self.frame.pixels.films().for_each(|film| clear(self.gpu, film));
        self.frame.pixels.settled.iter_mut().for_each(|settled| settled.restart(self.gpu));
        if let Some(live) = &mut self.frame.live {
            live.restart();
        }
        self.settings.seed = seed;
        self.samples = 0;
    }

    fn settle(&mut self, tiles: &[bool]) -> Result<(), RenderError> {
        self.frame.pixels.settled.as_mut().ok_or_else(tiles::never)?.write(self.gpu, tiles, self.samples)
    }

    fn settles(&self) -> bool {
        self.plan.settles
    }

    fn film(&self) -> Result<Film, RenderError> {
        match &self.frame.live {
            Some(live) => Ok(live.film(self.gpu)?),
            None => {
                let pixels = &self.frame.pixels;
                read_film(self.gpu, pixels.films(), &self.settings, self.samples, pixels.settled.as_ref())
            }
        }
    }

    fn bias_films(&self) -> Result<Option<BiasFilms>, RenderError> {
        Ok(self.frame.live.as_ref().map_or(Ok(None), |live| live.bias_films(self.gpu))?)
    }

    fn stats(&self) -> RenderStats {
        RenderStats {
            samples: self.samples,
            bytes: self.frame.bytes(),
            passes: self.gpu.timings.totals(),
            ..self.stats.clone()
        }
    }
}

/// The camera that the settings name.
pub(crate) fn camera_of(scene: &Scene, settings: &Settings) -> Result<Camera, RenderError> {
    let Some(camera) = scene.cameras.get(settings.camera) else {
        let count = scene.cameras.len();
        return Err(RenderError::Setting(format!("there is no camera {}; the scene has {count}", settings.camera)));
    };
    Ok(camera.clone())
}

/// Whether the device can hold an image of so many pixels at most.
pub(crate) fn check_size(gpu: &Gpu, settings: &Settings, most: u64) -> Result<(), RenderError> {
    let Settings { width, height, .. } = *settings;
    let side = gpu.capabilities.max_texture_side;
    let fits = width.max(height) <= side && u64::from(width) * u64::from(height) <= most;
    if width == 0 || height == 0 || !fits {
        let pixels = if most == u64::MAX { String::new() } else { format!(", pixels up to {most}") };
        return Err(RenderError::Setting(format!(
            "an image of {width}x{height} does not fit this device: sides go up to {side}{pixels}; choose a smaller --size"
        )));
    }
    Ok(())
}

/// Empties a film.
pub(crate) fn clear(gpu: &Gpu, film: &wgpu::Buffer) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.clear_buffer(film, 0, None);
    gpu.queue.submit([encoder.finish()]);
}

/// Means of compensated sums of `samples`, or of as many as a tile took, which may lie in several buffers.
pub(crate) fn read_film<'a>(
    gpu: &Gpu,
    films: impl Iterator<Item = &'a wgpu::Buffer>,
    settings: &Settings,
    samples: u64,
    settled: Option<&Settled>,
) -> Result<Film, RenderError> {
    let mut sums: Vec<[[f32; 3]; 2]> = Vec::new();
    for film in films {
        sums.extend(read_back::<[[f32; 3]; 2]>(gpu, film, (film.size() / film::DEVICE_BYTES) as usize)?);
    }
    let pixel = |(pixel, [sum, lost]): (usize, &[[f32; 3]; 2])| {
        let count = settled.map_or(samples, |settled| settled.taken(pixel, settings.width, samples)).max(1);
        [0, 1, 2].map(|c| ((f64::from(sum[c]) - f64::from(lost[c])) / count as f64) as f32)
    };
    Ok(Film { width: settings.width, height: settings.height, pixels: sums.iter().enumerate().map(pixel).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_take_half_a_second() {
        let mut size = BatchSize::default();
        assert_eq!(size.next(8), 1, "nothing is known of the first");
        for (samples, millis, most, next) in [
            (1, 10, 8, 2),
            (2, 20, 8, 4),
            (8, 80, 8, 8),
            (8, 80, 3, 3),
            (8, 2000, 8, 2),
            (2, 9000, 8, 1),
            (64, 0, 999, 128),
        ] {
            size.record(samples, Duration::from_millis(millis));
            assert_eq!(size.next(most), next, "{samples} samples in {millis} ms");
        }
    }
}
