//! The trait of all renderers on the GPU, their errors and statistics, and helpers that they share.

use std::collections::BTreeMap;
use std::time::Duration;

use async_trait::async_trait;
use glam::Vec3;

use crate::film::filtered::FilteredFilm;
use crate::film::{self, Film};
use crate::gpu::{Gpu, GpuError, PassTime, read_back_async};
use crate::render::adaptive_sampling::ConvergedTiles;
use crate::render::convergence::BiasFilms;
use crate::render::state::RenderState;
use crate::scene::{Camera, Scene};
use crate::settings::{OnlyStrategy, Settings};

/// Seconds that a batch should take: a render can be stopped between two batches.
const BATCH_SECONDS: f64 = 0.5;

/// Chooses the size of the next batch from the time that the last one took.
#[derive(Clone, Copy, Debug, Default)]
pub struct BatchSize {
    samples: u64,
    seconds: f64,
}

impl BatchSize {
    /// Returns the samples that take half a second at the rate of the last batch: at least 1, at most `most`
    /// and twice the last batch.
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

/// The reasons for which a picture cannot be rendered.
#[derive(Clone, Debug, thiserror::Error)]
pub enum RenderError {
    /// The device fails, or lacks what the method needs.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The scene or the device does not support a setting.
    #[error("{0}")]
    Setting(String),
}

impl RenderError {
    /// Returns the error of a renderer that makes one picture only.
    fn one_picture() -> Self {
        Self::Setting("this renderer makes one picture; open another renderer".to_owned())
    }

    /// Returns the error of a state that does not fit.
    #[must_use]
    pub fn foreign_state() -> Self {
        Self::Setting("the state is that of another picture; begin it anew".to_owned())
    }

    /// Returns the error of methods of the device when `reference` is asked for.
    pub(crate) fn on_cpu() -> Self {
        Self::Setting("--method reference renders on the CPU, without a device and without a plan".to_owned())
    }
}

/// The largest requests of a view in an iteration.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct ViewRequests {
    /// Name of the view.
    pub view: String,
    /// Texels along a side.
    pub resolution: u32,
    /// Draw items.
    pub items: u32,
    /// List nodes.
    pub nodes: u32,
}

/// Counts and times of a render.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct RenderStats {
    /// Iterations or samples per pixel in the picture.
    pub samples: u64,
    /// Values that were not finite.
    pub non_finite: u64,
    /// Nodes missing from the picture; always 0, since iterations that lose any are redone.
    pub lost_nodes: u64,
    /// Iterations that were redone with more capacity.
    pub redone: u64,
    /// Bytes on the device beside the scene.
    pub bytes: u64,
    /// Bytes of the scene on the device.
    pub scene_bytes: u64,
    /// Bytes of the grid or hierarchy that rays are traced through.
    pub tracer_bytes: u64,
    /// The largest requests of each view.
    pub requests: Vec<ViewRequests>,
    /// Device time and runs per pass.
    pub passes: BTreeMap<&'static str, PassTime>,
}

/// Renders a picture progressively. Renderers of [`super::open_async`] have every method; one that is made for a
/// single picture, such as the command line's of the CPU reference, may leave out those that begin another
/// one. Methods with `_async` are those that read from the device ([`crate::gpu`]).
#[async_trait(?Send)]
pub trait Renderer {
    /// Adds samples to the picture, in batches. `progress` is called with the number of samples so far after
    /// each batch, and stops the render by returning false.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device reports an error or cannot hold the lists that the scene needs.
    async fn render_async(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError>;

    /// Waits for [`Self::render_async`].
    ///
    /// # Errors
    /// As [`Self::render_async`].
    #[cfg(not(target_family = "wasm"))]
    fn render(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        pollster::block_on(self.render_async(samples, progress))
    }

    /// Begins a new picture with another seed; no tile of it has converged.
    fn restart(&mut self, seed: u32);

    /// Begins a new picture with the sample `first` of the sequence, from 0, so that pictures of parts of a
    /// sequence can be merged.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if samples depend on those before; [`RenderError::Gpu`] if the device fails.
    fn begin_at(&mut self, first: u64) -> Result<(), RenderError>;

    /// Reads the state of the picture between two batches.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device fails.
    async fn state_async(&self) -> Result<RenderState, RenderError>;

    /// Waits for [`Self::state_async`].
    ///
    /// # Errors
    /// As [`Self::state_async`].
    #[cfg(not(target_family = "wasm"))]
    fn state(&self) -> Result<RenderState, RenderError> {
        pollster::block_on(self.state_async())
    }

    /// Goes on with a picture of the same scene and settings.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if the state is that of another picture; [`RenderError::Gpu`] if the device
    /// fails.
    fn restore(&mut self, state: &RenderState) -> Result<(), RenderError>;

    /// Begins a picture of another pose of the same scene ([`Scene::at`]): the one that a new renderer would
    /// make. Pipelines and buffers are kept if the plan, the materials and the numbers of triangles, vertices
    /// and lights are the same.
    ///
    /// # Errors
    /// As [`super::open_async`].
    async fn pose_async(&mut self, _scene: &Scene) -> Result<(), RenderError> {
        Err(RenderError::one_picture())
    }

    /// Waits for [`Self::pose_async`].
    ///
    /// # Errors
    /// As [`Self::pose_async`].
    #[cfg(not(target_family = "wasm"))]
    fn pose(&mut self, scene: &Scene) -> Result<(), RenderError> {
        pollster::block_on(self.pose_async(scene))
    }

    /// Begins a picture of the same scene with another camera: the one that a new renderer would make.
    /// Nothing is built or uploaded.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device fails.
    async fn set_camera_async(&mut self, _camera: &Camera) -> Result<(), RenderError> {
        Err(RenderError::one_picture())
    }

    /// Waits for [`Self::set_camera_async`].
    ///
    /// # Errors
    /// As [`Self::set_camera_async`].
    #[cfg(not(target_family = "wasm"))]
    fn set_camera(&mut self, camera: &Camera) -> Result<(), RenderError> {
        pollster::block_on(self.set_camera_async(camera))
    }

    /// Begins a picture in which one strategy counts, or all.
    ///
    /// # Errors
    /// As [`super::open_async`].
    async fn set_only_async(&mut self, _only: Option<OnlyStrategy>) -> Result<(), RenderError> {
        Err(RenderError::one_picture())
    }

    /// Waits for [`Self::set_only_async`].
    ///
    /// # Errors
    /// As [`Self::set_only_async`].
    #[cfg(not(target_family = "wasm"))]
    fn set_only(&mut self, only: Option<OnlyStrategy>) -> Result<(), RenderError> {
        pollster::block_on(self.set_only_async(only))
    }

    /// True if frames are denoised: a frame in which anything has moved holds a part of those before.
    #[must_use]
    fn is_denoised(&self) -> bool {
        false
    }

    /// Returns settings with the choices of this plan that say where in a pixel a sample lies, so that the picture of
    /// other bounces has its samples there, too.
    #[must_use]
    fn aligned(&self, settings: Settings) -> Settings {
        settings
    }

    /// Sets the tiles that take no more samples, row by row: one for each square of
    /// [`TILE`](super::adaptive_sampling::TILE) pixels along a side, smaller at the right and bottom borders.
    /// These tiles keep their picture; the others take the same samples as without converged tiles.
    ///
    /// # Errors
    /// [`RenderError::Setting`] for another number of tiles, and if [`Self::is_adaptive`] is false.
    fn mark_converged(&mut self, tiles: &[bool]) -> Result<(), RenderError>;

    /// True if tiles may converge one by one, which requires that frames are not denoised.
    #[must_use]
    fn is_adaptive(&self) -> bool;

    /// Reads the picture so far, or the crop of it: the mean of each pixel's samples, or the denoised frames.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device fails.
    async fn film_async(&self) -> Result<Film, RenderError>;

    /// Waits for [`Self::film_async`].
    ///
    /// # Errors
    /// As [`Self::film_async`].
    #[cfg(not(target_family = "wasm"))]
    fn film(&self) -> Result<Film, RenderError> {
        pollster::block_on(self.film_async())
    }

    /// Reads the filtered picture, or the crop of it, and what the filter took away, if frames are filtered and the
    /// picture may get some of it back.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device fails.
    async fn filtered_film_async(&self) -> Result<Option<FilteredFilm>, RenderError> {
        Ok(None)
    }

    /// Waits for [`Self::filtered_film_async`].
    ///
    /// # Errors
    /// As [`Self::filtered_film_async`].
    #[cfg(not(target_family = "wasm"))]
    fn filtered_film(&self) -> Result<Option<FilteredFilm>, RenderError> {
        pollster::block_on(self.filtered_film_async())
    }

    /// Reads the picture filtered, unfiltered, and filtered twice, if frames are filtered and the settings have
    /// a target error.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device fails.
    async fn bias_films_async(&self) -> Result<Option<BiasFilms>, RenderError> {
        Ok(None)
    }

    /// Waits for [`Self::bias_films_async`].
    ///
    /// # Errors
    /// As [`Self::bias_films_async`].
    #[cfg(not(target_family = "wasm"))]
    fn bias_films(&self) -> Result<Option<BiasFilms>, RenderError> {
        pollster::block_on(self.bias_films_async())
    }

    /// Reads the positions of the last iteration's VPLs, world space; none if pixels do not share any.
    ///
    /// # Errors
    /// [`RenderError::Gpu`] if the device fails.
    async fn vpls_async(&self) -> Result<Vec<Vec3>, RenderError> {
        Ok(Vec::new())
    }

    /// Waits for [`Self::vpls_async`].
    ///
    /// # Errors
    /// As [`Self::vpls_async`].
    #[cfg(not(target_family = "wasm"))]
    fn vpls(&self) -> Result<Vec<Vec3>, RenderError> {
        pollster::block_on(self.vpls_async())
    }

    /// Returns the number of the next sample: that of the samples in the picture, after those before its first.
    #[must_use]
    fn samples(&self) -> u64;

    /// Returns the counts and times so far.
    #[must_use]
    fn stats(&self) -> RenderStats;

    /// Returns the plan as `lightsheaf plan` prints it.
    #[must_use]
    fn plan_text(&self) -> String {
        String::new()
    }

    /// Returns the plan as JSON.
    #[must_use]
    fn plan_json(&self) -> serde_json::Value {
        serde_json::Value::Null
    }

    /// Warnings of the scene as it is rendered: one sentence for each unsupported, repaired or omitted thing.
    #[must_use]
    fn warnings(&self) -> &[String] {
        &[]
    }
}

/// Returns the camera that the settings select.
pub(crate) fn camera_of(scene: &Scene, settings: &Settings) -> Result<Camera, RenderError> {
    let Some(camera) = scene.cameras.get(settings.camera) else {
        let count = scene.cameras.len();
        return Err(RenderError::Setting(format!("there is no camera {}; the scene has {count}", settings.camera)));
    };
    Ok(camera.clone())
}

/// Checks that the device can hold the image, of at most `most` pixels.
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

/// Reads whole buffers.
pub(crate) async fn read_buffers<'a>(
    gpu: &Gpu,
    buffers: impl Iterator<Item = &'a wgpu::Buffer>,
) -> Result<Vec<Vec<u8>>, RenderError> {
    let mut contents = Vec::new();
    for buffer in buffers {
        contents.push(read_back_async(gpu, buffer, buffer.size() as usize).await?);
    }
    Ok(contents)
}

/// Writes whole buffers, the contents of which [`read_buffers`] returned.
pub(crate) fn write_buffers<'a>(
    gpu: &Gpu,
    buffers: impl Iterator<Item = &'a wgpu::Buffer>,
    contents: &[Vec<u8>],
) -> Result<(), RenderError> {
    let buffers: Vec<_> = buffers.collect();
    let fits = |(buffer, bytes): (&&wgpu::Buffer, &Vec<u8>)| buffer.size() == bytes.len() as u64;
    if buffers.len() != contents.len() || !buffers.iter().zip(contents).all(fits) {
        return Err(RenderError::foreign_state());
    }
    for (buffer, bytes) in buffers.iter().zip(contents) {
        gpu.queue.write_buffer(buffer, 0, bytes);
    }
    Ok(gpu.check()?)
}

/// Sets a film to zero.
pub(crate) fn clear(gpu: &Gpu, film: &wgpu::Buffer) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.clear_buffer(film, 0, None);
    gpu.queue.submit([encoder.finish()]);
}

/// Reads a film and divides its compensated sums by `samples`, or by the samples of the pixel's tile. The
/// film may consist of several buffers, one after the other.
pub(crate) async fn read_film<'a>(
    gpu: &Gpu,
    films: impl Iterator<Item = &'a wgpu::Buffer>,
    settings: &Settings,
    samples: u64,
    converged: Option<&ConvergedTiles>,
) -> Result<Film, RenderError> {
    let mut sums: Vec<[[f32; 3]; 2]> = Vec::new();
    for film in films {
        let pixels = (film.size() / film::DEVICE_BYTES) as usize;
        sums.extend(read_back_async::<[[f32; 3]; 2]>(gpu, film, pixels).await?);
    }
    let pixel = |(pixel, [sum, lost]): (usize, &[[f32; 3]; 2])| {
        let count = converged.map_or(samples, |converged| converged.taken(pixel, settings.width, samples)).max(1);
        [0, 1, 2].map(|c| ((f64::from(sum[c]) - f64::from(lost[c])) / count as f64) as f32)
    };
    let pixels = sums.iter().enumerate().map(pixel).collect();
    Ok(Film { width: settings.width, height: settings.height, pixels }.cropped(settings.crop))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_take_half_a_second() {
        let mut size = BatchSize::default();
        assert_eq!(size.next(8), 1, "the first batch has one sample");
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
