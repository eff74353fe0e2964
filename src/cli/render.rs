//! Command `render`: renders a scene to image files until a number of samples, an error or a time is reached.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use lightsheaf::film::Film;
use lightsheaf::gpu::{Gpu, PassTime};
use lightsheaf::reference::{Reference, ReferenceSettings, Rounds};
use lightsheaf::render::convergence::Convergence;
use lightsheaf::render::renderer::{BatchSize, ViewRequests};
use lightsheaf::render::{self, RenderError, RenderStats, Renderer};
use lightsheaf::scene::Scene;
use lightsheaf::settings::{DEFAULT_BUDGET, DEFAULT_TARGET_ERROR, Method, OnlyStrategy, SAMPLES, Settings, UNLIMITED};
use lightsheaf::tonemap::{Exposure, Grade, Tonemap, auto_exposure};

use super::interrupt::{self, Interrupt};
use super::output;
use super::view::{self, ANIMATION, GradeArgs, View, ViewArgs};

/// Most samples between two checks of the budget.
const ROUND: u64 = 8;

#[derive(clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub view: ViewArgs,
    /// Image file: .exr (linear 32-bit float) or .png (8-bit sRGB after --exposure and --tonemap). May be
    /// given once for each format
    #[arg(short, long, value_name = "OUT.exr|.png", required = true)]
    output: Vec<PathBuf>,
    #[command(flatten)]
    grade: GradeArgs,
    /// Write the contribution of each strategy (s, t) to this folder: weighted by MIS (sS_tT.exr; their sum
    /// is the image) and unweighted (sS_tT_unweighted.exr). Needs a limited number of bounces. Not available
    /// with reference
    #[arg(long, value_name = "DIR")]
    strategy_images: Option<PathBuf>,
    /// Write statistics as JSON: counts, times, settings and the plan
    #[arg(long, value_name = "OUT.json")]
    stats: Option<PathBuf>,
    /// Count values that are not finite after each pass, and name the first pass that wrote any. Slower. Not
    /// available with reference
    #[arg(long)]
    check_values: bool,
    /// Write the linked WGSL of every pass to this folder, for debugging shaders. Not available with
    /// reference
    #[arg(long, value_name = "DIR")]
    dump_shaders: Option<PathBuf>,
    /// Render frames A to B, including B, at --fps, each to a separate file: OUT.exr becomes OUT_0000.exr and
    /// so on, as does the file of --stats
    #[arg(long, value_name = "A..B", value_parser = parse_frames, requires = "fps", conflicts_with_all = ["at", "strategy_images"], help_heading = ANIMATION)]
    frames: Option<(u32, u32)>,
    /// Frames per second, 0.001 to 10000. Frame N is at N / FPS seconds
    #[arg(long, value_name = "N", allow_negative_numbers = true, requires = "frames", help_heading = ANIMATION)]
    fps: Option<f64>,
    /// Print neither progress nor the closing line. Warnings and errors are still printed
    #[arg(short, long)]
    quiet: bool,
}

impl RenderArgs {
    /// True if an output file is a .png.
    fn writes_png(&self) -> bool {
        self.output.iter().any(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")))
    }
}

/// Reason for the end of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
enum Ending {
    Samples,
    TargetError,
    Budget,
    Interrupt,
}

/// Contents of the file of `--stats`.
#[derive(serde::Serialize)]
struct Stats<'a> {
    version: &'static str,
    scene: &'a str,
    device: String,
    method: String,
    size: [u32; 2],
    /// Number of samples in the picture.
    samples: u64,
    /// Exposure of a .png in stops, also if it was chosen by `--exposure auto`.
    exposure_stops: Option<f32>,
    /// Tone curve of a .png.
    tonemap: Option<Tonemap>,
    ended_by: Ending,
    /// Estimated rel_mse of the picture, with `--target-error` and by default.
    estimated_error: Option<f64>,
    /// With `--target-error`: share of the samples of all pixels that was taken. Converged tiles take no more
    /// samples.
    taken: Option<f64>,
    seconds: Seconds,
    /// Device time and number of runs of each pass; with `--frames`, in all frames so far.
    passes: BTreeMap<&'static str, PassTime>,
    /// Bytes on the device without the scene.
    bytes: u64,
    scene_bytes: u64,
    non_finite: u64,
    /// With `--check-values`: number of non-finite values after each pass, in the order of first execution.
    non_finite_after: Vec<(&'static str, u64)>,
    lost_nodes: u64,
    /// Number of iterations that were repeated with a larger list capacity.
    redone: u64,
    /// Largest list requests of each view.
    requests: Vec<ViewRequests>,
    /// Number of rays that the reference traced.
    rays: u64,
    plan: Option<serde_json::Value>,
    /// Frame, with `--frames`.
    frame: Option<Frame>,
    /// Index, name and length of each animation of the file.
    animations: &'a [String],
    warnings: &'a [String],
    /// Notes about camera and light that were added to the scene.
    notes: &'a [String],
    settings: &'a Settings,
}

#[derive(Clone, Copy, Default, serde::Serialize)]
struct Seconds {
    load: f64,
    /// Time for opening the device, uploading the scene and compiling pipelines; of the reference, for
    /// building the BVH.
    setup: f64,
    render: f64,
}

/// Frame of an animation.
#[derive(Clone, Copy, serde::Serialize)]
struct Frame {
    number: u32,
    /// Time since the beginning of the animation in seconds.
    seconds: f64,
}

/// Renders the scene and writes the requested files.
pub fn run(args: &RenderArgs) -> Result<ExitCode> {
    let interrupt = Interrupt::install(args.quiet)?;
    render(args, &interrupt)?;
    Ok(if interrupt.requested() { ExitCode::from(interrupt::EXIT_CODE) } else { ExitCode::SUCCESS })
}

fn render(args: &RenderArgs, interrupt: &Interrupt) -> Result<()> {
    check_outputs(args)?;
    let (grade, frames) = (OnceCell::new(), frames(args)?);
    let began = Instant::now();
    if frames.is_empty() {
        let View { scene, mut settings, animations } = args.view.load()?;
        if let Some(folder) = &args.strategy_images {
            check_strategy_images(folder, &settings)?;
            // Weighted strategy images sum to the unfiltered picture.
            settings.interleave.get_or_insert(1);
        }
        let load = began.elapsed().as_secs_f64();
        let began = Instant::now();
        let gpu = open(args)?;
        let (scene, settings, animations) = (&scene, &settings, &animations);
        let job = Job { args, interrupt, grade: &grade, load, began, scene, settings, animations, frame: None, all: 1 };
        return job.run(gpu.as_ref(), &mut None);
    }
    let (loaded, mut settings) = args.view.open()?;
    let animations = view::animations(&loaded);
    // The first frame is loaded before the device is opened, so that its warnings come first. The setup time
    // of the first frame includes that of the device.
    let first = args.view.complete(args.view.at("--frames", &loaded, frames[0].seconds)?, &mut settings)?;
    view::warn(&first);
    let mut load = began.elapsed().as_secs_f64();
    let mut began = Instant::now();
    let gpu = open(args)?;
    let (mut renderer, mut scene, all) = (None, first, frames.len());
    for (n, &frame) in frames.iter().enumerate() {
        if n > 0 && interrupt.requested() {
            break;
        }
        if n > 0 {
            let posing = Instant::now();
            scene = args.view.complete(args.view.at("--frames", &loaded, frame.seconds)?, &mut settings)?;
            load = posing.elapsed().as_secs_f64();
            began = Instant::now();
        }
        let (scene, settings, animations) = (&scene, &settings, &animations);
        let job =
            Job { args, interrupt, grade: &grade, load, began, scene, settings, animations, frame: Some(frame), all };
        job.run(gpu.as_ref(), &mut renderer)?;
    }
    Ok(())
}

/// Opens the device of a method; the reference needs none.
fn open(args: &RenderArgs) -> Result<Option<Gpu>> {
    if args.view.settings.method() == Method::Reference {
        return Ok(None);
    }
    let gpu = super::open(args.view.settings.technique)?;
    gpu.non_finite.watch(&gpu, args.check_values);
    if let Some(folder) = &args.dump_shaders {
        gpu.dump_shaders(folder).with_context(|| format!("--dump-shaders {}", folder.display()))?;
    }
    Ok(Some(gpu))
}

/// Returns the frames to render; empty without `--frames`.
fn frames(args: &RenderArgs) -> Result<Vec<Frame>> {
    let (Some((first, last)), Some(fps)) = (args.frames, args.fps) else { return Ok(Vec::new()) };
    if !(1e-3..=1e4).contains(&fps) {
        bail!("--fps {fps}: has to be 0.001 to 10000 frames a second");
    }
    Ok((first..=last).map(|number| Frame { number, seconds: f64::from(number) / fps }).collect())
}

/// Parses `A..B`, or a single frame.
fn parse_frames(text: &str) -> Result<(u32, u32), &'static str> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let frames = first.parse().ok().zip(last.parse().ok()).filter(|(first, last)| first <= last && *last < 1_000_000);
    frames.ok_or("frames are two numbers below a million, the later one second, such as 0..47")
}

/// Checks the options of the output before anything is loaded.
fn check_outputs(args: &RenderArgs) -> Result<()> {
    for path in &args.output {
        output::check(path, &["exr", "png"])?;
    }
    if args.check_values && args.view.settings.method() == Method::Reference {
        bail!("--check-values: the reference has no passes; use another method");
    }
    if let Some(stats) = &args.stats {
        output::check(stats, &["json"])?;
    }
    let GradeArgs { exposure, tonemap } = &args.grade;
    for (option, given) in [("--exposure", exposure.is_some()), ("--tonemap", tonemap.is_some())] {
        if given && !args.writes_png() {
            bail!("{option}: {} holds linear radiance; write a .png, or omit the option", args.output[0].display());
        }
    }
    Ok(())
}

/// Checks that strategy images are available, and creates their folder.
fn check_strategy_images(folder: &Path, settings: &Settings) -> Result<()> {
    if settings.method() == Method::Reference {
        bail!("--strategy-images: the reference has none; use another method");
    }
    if settings.bounces == UNLIMITED {
        bail!("--strategy-images: unlimited bounces have an unlimited number of strategies; give --bounces a number");
    }
    std::fs::create_dir_all(folder).with_context(|| format!("--strategy-images {}", folder.display()))
}

/// Render of a single picture.
struct Job<'a> {
    args: &'a RenderArgs,
    interrupt: &'a Interrupt,
    /// Exposure and tone curve of .png files. With `--frames` all frames use the exposure of the first one.
    grade: &'a OnceCell<Grade>,
    /// Seconds that loading took.
    load: f64,
    /// Start of the setup.
    began: Instant,
    scene: &'a Scene,
    settings: &'a Settings,
    animations: &'a [String],
    /// Frame of the animation, with `--frames`.
    frame: Option<Frame>,
    /// Number of frames.
    all: usize,
}

impl Job<'_> {
    /// Renders and writes the picture; without a device, by the reference. `renderer` is reused from frame to
    /// frame.
    fn run<'gpu>(&self, gpu: Option<&'gpu Gpu>, renderer: &mut Option<Box<dyn Renderer + 'gpu>>) -> Result<()> {
        let Some(gpu) = gpu else { return self.reference() };
        let renderer = match renderer {
            Some(renderer) => {
                renderer.pose(self.scene)?;
                renderer
            }
            None => renderer.insert(render::open(gpu, self.scene, self.settings)?),
        };
        let (film, stats) = self.progressive(Some(gpu), renderer.as_mut())?;
        let (requests, plan) = (renderer.stats().requests, Some(renderer.plan_json()));
        let stats = Stats { requests, plan, ..stats };
        let samples = stats.samples;
        self.finish(&film, stats)?;
        self.strategy_images(&mut |only| {
            renderer.set_only(Some(only))?;
            renderer.render(samples, &mut |_| !self.interrupt.requested())?;
            renderer.film()
        })
    }

    /// Writes the image of each strategy of the method, with as many samples as the picture. A signal ends
    /// the series.
    fn strategy_images(&self, render: &mut dyn FnMut(OnlyStrategy) -> Result<Film, RenderError>) -> Result<()> {
        let Some(folder) = &self.args.strategy_images else { return Ok(()) };
        let all = [true, false].into_iter().flat_map(|weighted| OnlyStrategy::all(self.settings.bounces, weighted));
        let all: Vec<_> = all.filter(|only| self.settings.technique.has_strategy(only.s, only.t)).collect();
        let bar = self.bar(all.len() as u64);
        for only in all {
            if self.interrupt.requested() {
                break;
            }
            bar.set_message(only.name());
            let film = render(only)?;
            if !self.interrupt.requested() {
                film.save(folder.join(only.name()).with_extension("exr"))?;
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Renders until the number of samples, the target error or the end of the budget is reached, or until a
    /// signal.
    fn progressive(&self, gpu: Option<&Gpu>, renderer: &mut dyn Renderer) -> Result<(Film, Stats<'_>), RenderError> {
        let setup = self.began.elapsed().as_secs_f64();
        self.interrupt.begin();
        let mut progress = ProgressiveRender::new(self, renderer);
        let (film, ended_by) = loop {
            let ended = progress.render_to_checkpoint()?;
            let film = progress.renderer.film()?;
            if let Some(ending) = progress.ending(&film, ended)? {
                break (film, ending);
            }
        };
        let non_finite_after = gpu.map_or(Ok(Vec::new()), |gpu| gpu.non_finite.counts(gpu))?;
        progress.bar.finish_and_clear();
        let render = progress.began.elapsed().as_secs_f64();
        let all = progress.samples * u64::from(self.settings.width) * u64::from(self.settings.height);
        let RenderStats { samples, bytes, scene_bytes, tracer_bytes, non_finite, lost_nodes, redone, passes, .. } =
            progress.renderer.stats();
        let cpu = || format!("CPU, {} threads", rayon::current_num_threads());
        let stats = Stats {
            device: gpu.map_or_else(cpu, |gpu| gpu.capabilities.adapter.clone()),
            samples,
            ended_by,
            estimated_error: progress.convergence.as_ref().and_then(|(_, convergence)| convergence.error()),
            taken: progress.convergence.as_ref().map(|_| progress.taken as f64 / all.max(1) as f64),
            seconds: Seconds { load: self.load, setup, render },
            bytes,
            scene_bytes: scene_bytes + tracer_bytes,
            non_finite,
            non_finite_after,
            lost_nodes,
            redone,
            passes,
            ..self.empty_stats()
        };
        Ok((film, stats))
    }

    /// Returns the factor by which radiance is multiplied before its error is estimated. By default dark
    /// pictures are brightened as for the display, since the 0.01 in rel_mse hides the noise of radiances far
    /// below 0.1.
    fn error_scale(&self, film: &Film) -> f32 {
        let Settings { target_error, budget, .. } = *self.settings;
        let by_default = (target_error, budget) == (Some(DEFAULT_TARGET_ERROR), Some(DEFAULT_BUDGET));
        if by_default { auto_exposure(film).max(0.0).exp2() } else { 1.0 }
    }

    /// Shows the progress: time with a budget alone, otherwise the number of samples.
    fn show_samples(&self, bar: &ProgressBar, samples: u64, began: Instant) {
        if self.settings.budget.is_some() && self.settings.target_error.is_none() {
            bar.set_position(began.elapsed().as_millis() as u64);
            bar.set_message(format!("{samples} samples"));
        } else {
            bar.set_position(samples);
        }
    }

    /// Renders by the reference and writes the picture.
    fn reference(&self) -> Result<()> {
        let Settings { width, height, samples, seed, camera, .. } = *self.settings;
        let bounces = Some(self.settings.bounces).filter(|&b| b != UNLIMITED);
        let settings = ReferenceSettings { width, height, samples, bounces, seed, camera };
        let reference = Reference::new(self.scene);
        let rounds = Rounds::new(settings);
        let mut renderer = ReferenceRenderer { reference, settings, rounds, batch_size: BatchSize::default() };
        let (film, stats) = self.progressive(None, &mut renderer)?;
        self.finish(&film, Stats { rays: renderer.rounds.rays, ..stats })
    }

    /// Returns the statistics that are known before the render.
    fn empty_stats(&self) -> Stats<'_> {
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: &self.scene.name,
            device: String::new(),
            method: self.settings.technique.to_string(),
            size: [self.settings.width, self.settings.height],
            samples: 0,
            exposure_stops: None,
            tonemap: None,
            ended_by: Ending::Samples,
            estimated_error: None,
            taken: None,
            seconds: Seconds::default(),
            passes: BTreeMap::new(),
            bytes: 0,
            scene_bytes: 0,
            non_finite: 0,
            non_finite_after: Vec::new(),
            lost_nodes: 0,
            redone: 0,
            requests: Vec::new(),
            rays: 0,
            plan: None,
            frame: self.frame,
            animations: self.animations,
            warnings: &self.scene.warnings,
            notes: &self.scene.notes,
            settings: self.settings,
        }
    }

    /// Creates a progress bar, which is visible on a terminal only.
    fn bar(&self, total: u64) -> ProgressBar {
        if self.args.quiet {
            return ProgressBar::hidden();
        }
        let (total, template) = match self.settings.budget {
            _ if self.settings.target_error.is_some() => {
                (0, "{prefix}{pos} samples, {elapsed}, estimated rel_mse {msg}")
            }
            Some(seconds) => ((seconds * 1000.0) as u64, "{prefix}{bar:40} {msg}, {elapsed} of the budget"),
            None => (total, "{prefix}{bar:40} {pos}/{len} samples, {per_sec}, {eta} left"),
        };
        let bar = ProgressBar::new(total);
        if let Some(frame) = self.frame {
            bar.set_prefix(format!("frame {}, one of {} ", frame.number, self.all));
        }
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar
    }

    /// Describes the number of samples and the end of the render for the closing line.
    fn outcome(&self, stats: &Stats) -> String {
        let samples = format!("{} {}", stats.samples, if stats.samples == 1 { "sample" } else { "samples" });
        let reached = stats.estimated_error.map(|error| format!(" at an estimated rel_mse of {}", two_digits(error)));
        match (stats.ended_by, stats.estimated_error) {
            (Ending::Interrupt, _) => format!("interrupted after {samples}{}", reached.unwrap_or_default()),
            (Ending::TargetError, Some(error)) => format!("estimated rel_mse {} after {samples}", two_digits(error)),
            (Ending::Budget, _) if self.settings.target_error.is_some() => {
                let time = match self.settings.budget {
                    Some(DEFAULT_BUDGET) => "five minutes".to_owned(),
                    seconds => format!("{} s", seconds.unwrap_or_default()),
                };
                let reached = reached.unwrap_or_else(|| " with too few samples for an estimate".to_owned());
                format!("stopped after {time}{reached}, {samples}")
            }
            _ => samples,
        }
    }

    /// Writes the image files and the statistics, and prints the closing line.
    fn finish(&self, film: &Film, mut stats: Stats) -> Result<()> {
        if stats.non_finite > 0 {
            let first = stats.non_finite_after.iter().find(|(_, count)| *count > 0);
            let first = first.map(|(pass, _)| format!(", first after the pass {pass}")).unwrap_or_default();
            eprintln!(
                "warning: {} values are not finite{first}; please report the scene and the settings",
                stats.non_finite
            );
        }
        let named = |path: &Path| self.frame.map_or_else(|| path.to_owned(), |frame| numbered(path, frame.number));
        let paths: Vec<PathBuf> = self.args.output.iter().map(|path| named(path)).collect();
        let (exposure, tonemap) = self.args.grade.chosen();
        let grade = self.grade.get_or_init(|| Grade { stops: exposure.stops(film), tonemap });
        for path in &paths {
            film.save_graded(path, grade)?;
        }
        if self.args.writes_png() {
            (stats.exposure_stops, stats.tonemap) = (Some(grade.stops), Some(grade.tonemap));
        }
        if let Some(path) = &self.args.stats {
            output::write(&named(path), &(serde_json::to_string_pretty(&stats)? + "\n"))?;
        }
        if !self.args.quiet {
            let Seconds { load, setup, render } = stats.seconds;
            let shown = match exposure {
                _ if !self.args.writes_png() => String::new(),
                Exposure::Auto => format!("; exposure {:+.2} stops (auto), {tonemap}", grade.stops),
                Exposure::Stops(stops) => format!("; exposure {stops:+} stops, {tonemap}"),
            };
            eprintln!(
                "{}: {}x{}, {} by {} on {}{shown}; load {load:.2} s, setup {setup:.2} s, render {render:.2} s",
                paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", "),
                film.width,
                film.height,
                self.outcome(&stats),
                stats.method,
                stats.device
            );
        }
        Ok(())
    }
}

/// State of a progressive render.
struct ProgressiveRender<'a> {
    job: &'a Job<'a>,
    renderer: &'a mut dyn Renderer,
    bar: ProgressBar,
    /// Start of the first sample.
    began: Instant,
    clock: Option<Clock>,
    /// Number of samples at which the render ends at the latest.
    end: u64,
    /// Samples that the renderer had before: a filtered frame continues the previous one.
    first: u64,
    /// Samples of this picture.
    samples: u64,
    /// Samples of all pixels together, without those of converged tiles.
    taken: u64,
    /// Target and estimate of the error.
    convergence: Option<(f64, Convergence)>,
    /// Factor of the radiance in the estimate of the error, from the first picture.
    error_scale: Option<f32>,
    /// True if converged tiles take no more samples.
    adaptive: bool,
}

impl<'a> ProgressiveRender<'a> {
    fn new(job: &'a Job<'a>, renderer: &'a mut dyn Renderer) -> Self {
        let Settings { width, height, samples, target_error, budget, .. } = *job.settings;
        let limited = target_error.is_some() || budget.is_some();
        Self {
            began: Instant::now(),
            bar: job.bar(samples.into()),
            adaptive: renderer.is_adaptive() && job.args.strategy_images.is_none(),
            clock: budget.map(Clock::new),
            end: u64::from(if limited { *SAMPLES.end() } else { samples }),
            convergence: target_error.map(|target| (target, Convergence::new(width, height))),
            first: renderer.samples(),
            samples: 0,
            taken: 0,
            error_scale: None,
            job,
            renderer,
        }
    }

    /// Renders up to the next checkpoint of the error estimate, or to the end. Returns the reason if the
    /// budget or a signal ends the render.
    fn render_to_checkpoint(&mut self) -> Result<Option<Ending>, RenderError> {
        let convergence = self.convergence.as_ref().map(|(_, convergence)| convergence);
        let goal = convergence.map_or(self.end, |convergence| convergence.next_checkpoint().min(self.end));
        while self.samples < goal {
            let most = goal - self.samples;
            let round = match &self.clock {
                Some(clock) => clock.next_round(self.samples, most.min(ROUND)),
                None => Some(most),
            };
            let Some(round) = round else { return Ok(Some(Ending::Budget)) };
            let before = self.samples;
            self.renderer.render(round, &mut |all| {
                self.samples = all - self.first;
                self.job.show_samples(&self.bar, self.samples, self.began);
                !self.job.interrupt.requested()
            })?;
            let pixels = convergence.map_or(0, |convergence| convergence.tiles().active_pixels());
            self.taken += (self.samples - before) * pixels;
            if self.samples < self.end && self.job.interrupt.requested() {
                return Ok(Some(Ending::Interrupt));
            }
        }
        Ok(None)
    }

    /// Updates the error estimate with the picture at a checkpoint and marks converged tiles. Returns the
    /// reason if the render ends here; an interrupt has precedence over the target error.
    fn ending(&mut self, film: &Film, ended: Option<Ending>) -> Result<Option<Ending>, RenderError> {
        let mut ending = (self.samples >= self.end).then_some(Ending::Samples).or(ended);
        let Some((target, convergence)) = &mut self.convergence else { return Ok(ending) };
        let scale = *self.error_scale.get_or_insert_with(|| self.job.error_scale(film));
        let bias = self.renderer.bias_films()?.map(|films| films.scaled(scale));
        let error = convergence.update(self.samples, &film.scaled(scale), bias.as_ref());
        if error.is_some_and(|error| error <= *target) {
            ending = ending.filter(|ending| *ending == Ending::Interrupt).or(Some(Ending::TargetError));
        }
        if self.adaptive && ending.is_none() {
            convergence.mark_converged(*target);
            self.renderer.mark_converged(convergence.tiles().converged())?;
        }
        if let Some(error) = error {
            self.bar.set_message(format!("{error:.2e}"));
        }
        Ok(ending)
    }
}

/// Formats a number with two significant digits: 0.0028.
fn two_digits(value: f64) -> String {
    if !value.is_finite() || value <= 0.0 {
        return value.to_string();
    }
    let places = (1 - value.log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.places$}")
}

/// Returns the file name of a frame: `out.exr` becomes `out_0007.exr`.
fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("_{number:04}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// Progressive renderer of the CPU reference.
struct ReferenceRenderer<'s> {
    reference: Reference<'s>,
    settings: ReferenceSettings,
    rounds: Rounds,
    batch_size: BatchSize,
}

impl Renderer for ReferenceRenderer<'_> {
    fn render(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        let end = u64::from(self.rounds.samples()) + samples;
        while u64::from(self.rounds.samples()) < end {
            let count = self.batch_size.next(end - u64::from(self.rounds.samples()));
            let began = Instant::now();
            self.rounds.add(&self.reference, count as u32, &|_, _| ());
            self.batch_size.record(count, began.elapsed());
            if !progress(self.rounds.samples().into()) {
                break;
            }
        }
        Ok(())
    }

    fn restart(&mut self, seed: u32) {
        self.settings.seed = seed;
        self.rounds = Rounds::new(self.settings);
    }

    fn mark_converged(&mut self, _: &[bool]) -> Result<(), RenderError> {
        Err(RenderError::Setting("the reference has no adaptive sampling".to_owned()))
    }

    fn is_adaptive(&self) -> bool {
        false
    }

    fn film(&self) -> Result<Film, RenderError> {
        Ok(self.rounds.film())
    }

    fn samples(&self) -> u64 {
        self.rounds.samples().into()
    }

    fn stats(&self) -> RenderStats {
        let non_finite = self.rounds.non_finite;
        RenderStats { samples: self.rounds.samples().into(), non_finite, ..RenderStats::default() }
    }
}

/// Divides a time budget into rounds of samples.
struct Clock {
    began: Instant,
    budget: Duration,
}

impl Clock {
    fn new(seconds: f64) -> Self {
        Self { began: Instant::now(), budget: Duration::from_secs_f64(seconds) }
    }

    /// Returns the number of samples that fit into the remaining time at the rate so far, at most `most`. The
    /// first sample is always rendered. None if the time is used up.
    fn next_round(&self, done: u64, most: u64) -> Option<u64> {
        let capacity = u64::from(*SAMPLES.end()).saturating_sub(done);
        if done == 0 {
            return Some(1);
        }
        let used = self.began.elapsed();
        let left = self.budget.saturating_sub(used).as_secs_f64();
        let fit = (left * done as f64 / used.as_secs_f64().max(1e-9)) as u64;
        Some(fit.min(most).min(capacity)).filter(|&round| round > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_deals_out_rounds_until_it_is_used() {
        let clock = Clock::new(1000.0);
        assert_eq!(clock.next_round(0, 8), Some(1), "one sample at least");
        assert_eq!(clock.next_round(100, 8), Some(8));
        assert_eq!(clock.next_round((*SAMPLES.end()).into(), 8), None, "no more than the range allows");
        let used = Clock { began: Instant::now(), budget: Duration::ZERO };
        assert_eq!(used.next_round(0, 8), Some(1));
        assert_eq!(used.next_round(1, 8), None);
    }

    #[test]
    fn errors_have_two_digits() {
        for (value, text) in [(0.002_84, "0.0028"), (0.012, "0.012"), (1.0, "1.0"), (34.56, "35"), (0.0, "0")] {
            assert_eq!(two_digits(value), text);
        }
    }

    #[test]
    fn frames_are_parsed_and_numbered() {
        assert_eq!((parse_frames("0..47"), parse_frames("12")), (Ok((0, 47)), Ok((12, 12))));
        for bad in ["", "..", "3..", "..3", "3..2", "-1..2", "0..1000000", "a..b", "0..=3", "1.5..2"] {
            assert!(parse_frames(bad).is_err(), "{bad}");
        }
        assert_eq!(numbered(Path::new("a.b/c.d.exr"), 7), Path::new("a.b/c.d_0007.exr"));
        assert_eq!(numbered(Path::new("c.png"), 123_456), Path::new("c_123456.png"));
    }
}
