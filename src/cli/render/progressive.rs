//! A render that grows sample by sample until its end, and is kept meanwhile.

use std::time::{Duration, Instant};

use anyhow::Result;

use super::clock::{Clock, Stopwatch};
use super::job::{Job, save};
use super::stats::{Ending, device_name};
use crate::cli::checkpoint::{self, Identity, Saved};
use crate::cli::progress::{Progress, Reporter};
use crate::crop::Crop;
use crate::film::Film;
use crate::film::exr::Picture;
use crate::gpu::Gpu;
use crate::render::convergence::Convergence;
use crate::render::{RenderError, Renderer};
use crate::settings::{SAMPLES, Settings};

/// State of a progressive render.
pub(super) struct ProgressiveRender<'a> {
    job: &'a Job<'a>,
    pub(super) renderer: &'a mut dyn Renderer,
    pub(super) reporter: Reporter,
    /// Since the start of the first sample.
    stopwatch: Stopwatch<'a>,
    pub(super) clock: Option<Clock>,
    /// Number of samples at which the render ends at the latest.
    end: u64,
    /// Samples that the renderer had before: a filtered frame continues the previous one.
    first: u64,
    /// Samples of this picture.
    pub(super) samples: u64,
    /// Samples of all pixels together, without those of converged tiles.
    pub(super) taken: u64,
    /// Error at which the render ends.
    pub(super) target: Option<f64>,
    /// Estimate of the error, if the render ends by it or somebody sees it.
    pub(super) convergence: Option<Convergence>,
    /// Factor of the radiance in the estimate of the error, from the first picture.
    error_scale: Option<f32>,
    /// True if converged tiles take no more samples.
    adaptive: bool,
    /// Time of rendering before this process.
    before: Duration,
    keeper: Keeper,
}

impl<'a> ProgressiveRender<'a> {
    /// Begins a render, or goes on with a saved one.
    pub(super) fn new(
        job: &'a Job<'a>,
        renderer: &'a mut dyn Renderer,
        (keeper, reporter): (Keeper, Reporter),
        saved: Option<Saved>,
        gpu: Option<&'a Gpu>,
    ) -> Result<Self, RenderError> {
        let Settings { samples, target_error, budget, .. } = *job.settings;
        let Crop { width, height, .. } = job.settings.region();
        let limited = target_error.is_some() || budget.is_some();
        let estimates = target_error.is_some() || reporter.is_shown();
        let mut this = Self {
            stopwatch: Stopwatch::start(gpu),
            reporter,
            adaptive: renderer.is_adaptive() && job.args.strategy_images.is_none(),
            clock: budget.map(Clock::new),
            end: u64::from(if limited { *SAMPLES.end() } else { samples }),
            target: target_error,
            convergence: estimates.then(|| Convergence::new(width, height)),
            first: renderer.samples(),
            samples: 0,
            taken: 0,
            error_scale: None,
            before: Duration::ZERO,
            keeper,
            job,
            renderer,
        };
        if let Some(saved) = saved {
            this.renderer.restore(&saved.state)?;
            (this.samples, this.taken) = (saved.samples, saved.taken);
            this.before = Duration::from_secs_f64(saved.seconds.max(0.0));
            this.error_scale = saved.error_scale;
            if let Some(saved) = saved.convergence {
                this.convergence = Some(saved);
            }
        }
        Ok(this)
    }

    /// Returns the time of rendering.
    fn used(&self) -> Duration {
        self.before + self.stopwatch.elapsed()
    }

    /// Returns the seconds of rendering.
    pub(super) fn seconds(&self) -> f64 {
        self.used().as_secs_f64()
    }

    /// Saves the render, and writes the picture and the checkpoint if these are asked for.
    fn save(&mut self) -> Result<(), RenderError> {
        let saved = Saved {
            samples: self.samples,
            taken: self.taken,
            seconds: self.seconds(),
            error_scale: self.error_scale,
            convergence: self.convergence.clone().filter(|_| self.target.is_some()),
            state: self.renderer.state()?,
        };
        if self.job.args.checkpoint.is_some() {
            let film = self.renderer.film()?;
            if let Err(error) = self.keeper.write(self.job, &saved, &film, &self.renderer.plan_json()) {
                // The render goes on: what it has is in memory, and the disk may be free again later.
                eprintln!("warning: no checkpoint was written: {error:#}");
            }
        }
        *self.job.kept.saved.borrow_mut() = Some(saved);
        self.keeper.kept = Instant::now();
        Ok(())
    }

    /// Writes the last checkpoint of an interrupted render.
    pub(super) fn close(&mut self, ended_by: Ending) -> Result<()> {
        if ended_by == Ending::Interrupt && self.job.args.checkpoint.is_some() {
            self.save()?;
        }
        Ok(())
    }

    /// Renders up to the next checkpoint of the error estimate, or to the end. Returns the reason if the
    /// budget or a signal ends the render.
    pub(super) fn render_to_checkpoint(&mut self) -> Result<Option<Ending>, RenderError> {
        let convergence = self.convergence.as_ref();
        let goal = convergence.map_or(self.end, |convergence| convergence.next_checkpoint().min(self.end));
        let pixels = convergence.map_or(0, |convergence| convergence.tiles().active_pixels());
        while self.samples < goal {
            let most = goal - self.samples;
            let used = self.used();
            let round = match &mut self.clock {
                Some(clock) => clock.next_round(self.samples, most, used),
                None => Some(most),
            };
            let Some(round) = round else { return Ok(Some(Ending::Budget)) };
            let before = self.samples;
            let Self {
                renderer,
                samples,
                first,
                reporter,
                keeper,
                job,
                stopwatch,
                before: time_before,
                target,
                convergence,
                clock,
                end,
                ..
            } = self;
            let ends = Ends { target: *target, convergence: convergence.as_ref(), clock: clock.as_ref(), end: *end };
            renderer.render(round, &mut |all| {
                *samples = all - *first;
                let used = *time_before + stopwatch.elapsed();
                reporter.show(ends.progress(*samples, used));
                let used_up = ends.clock.is_some_and(|clock| clock.left(used).is_zero());
                !used_up && !keeper.is_due() && !job.preview_is_due() && !job.interrupt.requested()
            })?;
            self.taken += (self.samples - before) * pixels;
            if self.samples < self.end && self.job.interrupt.requested() {
                return Ok(Some(Ending::Interrupt));
            }
            if self.samples < goal && self.job.preview_is_due() {
                let film = self.renderer.film()?;
                self.job.preview.borrow_mut().iter_mut().for_each(|preview| preview.show(&film));
            }
            if self.samples < goal && self.keeper.is_due() {
                self.save()?;
            }
        }
        Ok(None)
    }

    /// Updates the error estimate with the picture at a checkpoint and marks converged tiles. Returns the
    /// reason if the render ends here; an interrupt has precedence over the target error.
    pub(super) fn ending(&mut self, film: &Film, ended: Option<Ending>) -> Result<Option<Ending>, RenderError> {
        let mut ending = (self.samples >= self.end).then_some(Ending::Samples).or(ended);
        let Some(convergence) = &mut self.convergence else { return Ok(ending) };
        let scale = *self.error_scale.get_or_insert_with(|| self.job.error_scale(film));
        let bias = self.renderer.bias_films()?.map(|films| films.scaled(scale));
        let error = convergence.update(self.samples, &film.scaled(scale), bias.as_ref());
        let Some(target) = self.target else { return Ok(ending) };
        if error.is_some_and(|error| error <= target) {
            ending = ending.filter(|ending| *ending == Ending::Interrupt).or(Some(Ending::TargetError));
        }
        if self.adaptive && ending.is_none() {
            convergence.mark_converged(target);
            self.renderer.mark_converged(convergence.tiles().converged())?;
        }
        Ok(ending)
    }
}

/// What ends a render.
struct Ends<'a> {
    target: Option<f64>,
    convergence: Option<&'a Convergence>,
    clock: Option<&'a Clock>,
    /// Number of samples at which it ends at the latest.
    end: u64,
}

impl Ends<'_> {
    /// Returns the progress of a picture.
    fn progress(&self, samples: u64, used: Duration) -> Progress {
        let seconds = used.as_secs_f64();
        let estimated_error = self.convergence.and_then(Convergence::error);
        let by_samples = self.target.is_none() && self.clock.is_none();
        let for_samples = |all: f64| seconds * (all - samples as f64) / samples.max(1) as f64;
        let target = self.target.zip(self.convergence);
        let at_target = target.and_then(|(target, convergence)| convergence.samples_to(target));
        let left = [
            by_samples.then(|| for_samples(self.end as f64)),
            at_target.map(|all| for_samples(all).max(0.0)),
            self.clock.map(|clock| clock.left(used).as_secs_f64()),
        ];
        Progress {
            samples,
            samples_end: by_samples.then_some(self.end),
            seconds,
            seconds_left: left.into_iter().flatten().reduce(f64::min),
            estimated_error,
            target_error: self.target,
        }
    }
}

/// Seconds after which a render is saved in memory, so that it can go on if the device is lost.
const SAVE_SECONDS: f64 = 30.0;

/// Keeps what a render has, in memory and in files.
pub(super) struct Keeper {
    device: String,
    every: Duration,
    /// When the render was last saved.
    pub(super) kept: Instant,
}

impl Keeper {
    pub(super) fn new(job: &Job, gpu: Option<&Gpu>) -> Self {
        let every = Duration::from_secs_f64(job.args.checkpoint.unwrap_or(SAVE_SECONDS));
        Self { device: device_name(gpu), every, kept: Instant::now() }
    }

    /// Returns what the picture depends on.
    pub(super) fn identity(&self, job: &Job) -> Identity {
        Identity::new(job.scene, job.scene_hash(), job.settings, self.device.clone())
    }

    /// True if the render has to be saved.
    pub(super) fn is_due(&self) -> bool {
        self.kept.elapsed() >= self.every
    }

    /// Writes the checkpoint and the picture.
    pub(super) fn write(&self, job: &Job, saved: &Saved, film: &Film, plan: &serde_json::Value) -> Result<()> {
        checkpoint::write(&checkpoint::path_of(&job.args.output[0]), &self.identity(job), saved)?;
        let record = job.record(Some(plan), saved.samples, saved.seconds, self.device.clone());
        let picture = Picture { record: Some(record), ..job.picture(film)? };
        let grade = job.grade_of(&picture.film);
        job.args.output.iter().try_for_each(|path| save(path, &picture, &grade))
    }
}
