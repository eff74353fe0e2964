//! `render`: a scene to an image, for a number of samples or for a time.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use lightsheaf::convergence::Convergence;
use lightsheaf::film::Film;
use lightsheaf::gpu::{Gpu, PassTime};
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::reference::{Reference, ReferenceSettings, Rounds};
use lightsheaf::renderer::{BatchSize, Progressive, RenderError, RenderStats, Renderer};
use lightsheaf::scene::Scene;
use lightsheaf::settings::{DEFAULT_BUDGET, DEFAULT_TARGET_ERROR, Method, OnlyStrategy, SAMPLES, Settings, UNLIMITED};
use lightsheaf::tonemap::{Exposure, Grade, Tonemap, auto_exposure};

use super::interrupt::{self, Interrupt};
use super::output;
use super::view::{self, ANIMATION, GradeArgs, View, ViewArgs};

/// Most samples between two looks at the clock.
const ROUND: u64 = 8;

#[derive(clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub view: ViewArgs,
    /// The image: .exr (linear 32-bit float) or .png (8-bit sRGB by --exposure and --tonemap); may be given once for each
    #[arg(short, long, value_name = "OUT.exr|.png", required = true)]
    output: Vec<PathBuf>,
    #[command(flatten)]
    grade: GradeArgs,
    /// Write what each strategy (s, t) gives, with its weight by MIS (sS_tT.exr; their sum is the image) and without
    /// (sS_tT_unweighted.exr), into this folder; needs a number of bounces; the reference has none
    #[arg(long, value_name = "DIR")]
    strategy_images: Option<PathBuf>,
    /// Write counts, times, settings and the plan as JSON
    #[arg(long, value_name = "OUT.json")]
    stats: Option<PathBuf>,
    /// After each pass, count values that are not finite, and say which pass was the first; slower; the reference has no passes
    #[arg(long)]
    check_values: bool,
    /// Render frames A to B, B included, at --fps, each into a file of its own: OUT.exr becomes OUT_0000.exr and so on, and so does
    /// the file of --stats
    #[arg(long, value_name = "A..B", value_parser = parse_frames, requires = "fps", conflicts_with_all = ["at", "strategy_images"], help_heading = ANIMATION)]
    frames: Option<(u32, u32)>,
    /// Frames a second; frame N is at N / FPS seconds
    #[arg(long, value_name = "N", allow_negative_numbers = true, requires = "frames", help_heading = ANIMATION)]
    fps: Option<f64>,
    /// Neither progress nor closing line; warnings and errors stay
    #[arg(short, long)]
    quiet: bool,
}

impl RenderArgs {
    fn writes_png(&self) -> bool {
        self.output.iter().any(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")))
    }
}

/// Why a picture has no more samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
enum Ending {
    Samples,
    TargetError,
    Budget,
    Interrupt,
}

/// The file that `--stats` writes.
#[derive(serde::Serialize)]
struct Stats<'a> {
    version: &'static str,
    scene: &'a str,
    device: String,
    method: Method,
    size: [u32; 2],
    /// Samples in the picture: with a budget, as many as there was time for.
    samples: u64,
    /// Of a .png: what it was brightened by, by `--exposure auto` too, and its tone curve.
    exposure_stops: Option<f32>,
    tonemap: Option<Tonemap>,
    ended_by: Ending,
    /// With `--target-error`, also by default: the picture's estimated rel_mse.
    estimated_error: Option<f64>,
    /// With `--target-error`: share of all pixels' samples that was taken; settled tiles take no more.
    taken: Option<f64>,
    seconds: Seconds,
    /// With --frames, since the first one.
    passes: BTreeMap<&'static str, PassTime>,
    /// Bytes on the device beside the scene.
    bytes: u64,
    scene_bytes: u64,
    non_finite: u64,
    /// With `--check-values`: what passes left, in the order in which they first ran.
    non_finite_after: Vec<(&'static str, u64)>,
    lost_nodes: u64,
    /// Iterations that were redone with more room.
    redone: u64,
    demands: Vec<Demand>,
    /// Rays that the reference traced.
    rays: u64,
    plan: Option<serde_json::Value>,
    /// Where the picture is one of several, its time in seconds.
    frame: Option<Frame>,
    /// What the file has: index, name, length.
    animations: &'a [String],
    warnings: &'a [String],
    /// What was added to the scene.
    notes: &'a [String],
    settings: &'a Settings,
}

#[derive(Clone, Copy, Default, serde::Serialize)]
struct Seconds {
    load: f64,
    /// Device, upload and pipelines; the hierarchy of the reference.
    setup: f64,
    render: f64,
}

/// A picture of several.
#[derive(Clone, Copy, serde::Serialize)]
struct Frame {
    number: u32,
    /// Since the beginning of the animation.
    seconds: f64,
}

/// The most that a view wanted in an iteration.
#[derive(serde::Serialize)]
struct Demand {
    view: String,
    resolution: u32,
    items: u32,
    nodes: u32,
}

/// Renders and writes what was asked for.
pub fn run(args: &RenderArgs) -> Result<ExitCode> {
    let interrupt = Interrupt::install(args.quiet)?;
    render(args, &interrupt)?;
    Ok(if interrupt.requested() { ExitCode::from(interrupt::EXIT_CODE) } else { ExitCode::SUCCESS })
}

fn render(args: &RenderArgs, interrupt: &Interrupt) -> Result<()> {
    let method = args.view.settings.method;
    check_outputs(args)?;
    let (grade, frames) = (OnceCell::new(), frames(args)?);
    let began = Instant::now();
    if frames.is_empty() {
        let View { scene, mut settings, animations } = args.view.load()?;
        if let Some(folder) = &args.strategy_images {
            check_strategy_images(folder, &settings)?;
            // They add up to the picture, which a filter would change.
            settings.interleave.get_or_insert(1);
        }
        let load = began.elapsed().as_secs_f64();
        let began = Instant::now();
        let gpu = open(method, args.check_values)?;
        let (scene, settings, animations) = (&scene, &settings, &animations);
        let job = Job { args, interrupt, grade: &grade, load, began, scene, settings, animations, frame: None, all: 1 };
        return job.run(gpu.as_ref(), &mut None);
    }
    let (loaded, mut settings) = args.view.open()?;
    let animations = view::animations(&loaded);
    // What the first frame lacks is said before a device is opened; the setup of that frame is the device's, too.
    let first = args.view.complete(args.view.at("--frames", &loaded, frames[0].seconds)?, &mut settings)?;
    view::warn(&first);
    let mut load = began.elapsed().as_secs_f64();
    let mut began = Instant::now();
    let gpu = open(method, args.check_values)?;
    let (mut engine, mut scene, all) = (None, first, frames.len());
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
        job.run(gpu.as_ref(), &mut engine)?;
    }
    Ok(())
}

/// The device of a method; the reference needs none.
fn open(method: Method, check_values: bool) -> Result<Option<Gpu>> {
    let gpu = (method != Method::Reference).then(|| super::open(method)).transpose()?;
    if let Some(gpu) = &gpu {
        gpu.non_finite.watch(gpu, check_values);
    }
    Ok(gpu)
}

/// The frames to render; none where a single picture is asked for.
fn frames(args: &RenderArgs) -> Result<Vec<Frame>> {
    let (Some((first, last)), Some(fps)) = (args.frames, args.fps) else { return Ok(Vec::new()) };
    if !(1e-3..=1e4).contains(&fps) {
        bail!("--fps {fps}: has to be 0.001 to 10000 frames a second");
    }
    Ok((first..=last).map(|number| Frame { number, seconds: f64::from(number) / fps }).collect())
}

fn parse_frames(text: &str) -> Result<(u32, u32), &'static str> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let frames = first.parse().ok().zip(last.parse().ok()).filter(|(first, last)| first <= last && *last < 1_000_000);
    frames.ok_or("frames are two numbers below a million, the later one second, such as 0..47")
}

/// What renders, kept from frame to frame.
enum Engine<'gpu> {
    Raster(Box<Renderer<'gpu>>),
    Paths(Box<PathRenderer<'gpu>>),
}

/// Everything about the output that can be wrong before there is one.
fn check_outputs(args: &RenderArgs) -> Result<()> {
    for path in &args.output {
        output::check(path, &["exr", "png"])?;
    }
    if args.check_values && args.view.settings.method == Method::Reference {
        bail!("--check-values: the reference has no passes; use any other method");
    }
    if let Some(stats) = &args.stats {
        output::check(stats, &["json"])?;
    }
    let GradeArgs { exposure, tonemap } = &args.grade;
    for (option, given) in [("--exposure", exposure.is_some()), ("--tonemap", tonemap.is_some())] {
        if given && !args.writes_png() {
            bail!("{option}: {} keeps linear radiance; write a .png, or leave it out", args.output[0].display());
        }
    }
    Ok(())
}

/// Makes the folder where there is none.
fn check_strategy_images(folder: &Path, settings: &Settings) -> Result<()> {
    if settings.method == Method::Reference {
        bail!("--strategy-images: the reference has none; use any other method");
    }
    if settings.bounces == UNLIMITED {
        bail!(
            "--strategy-images: as many strategies as unlimited bounces have cannot be written; give --bounces a number"
        );
    }
    std::fs::create_dir_all(folder).with_context(|| format!("--strategy-images {}", folder.display()))
}

struct Job<'a> {
    args: &'a RenderArgs,
    interrupt: &'a Interrupt,
    /// How .png files are written, once the first picture has said its exposure: with --frames, the others keep it.
    grade: &'a OnceCell<Grade>,
    load: f64,
    /// When its setup did.
    began: Instant,
    scene: &'a Scene,
    settings: &'a Settings,
    animations: &'a [String],
    /// Which picture of `all` it is.
    frame: Option<Frame>,
    all: usize,
}

impl Job<'_> {
    /// Renders and writes; without a device, by the reference.
    fn run<'gpu>(&self, gpu: Option<&'gpu Gpu>, engine: &mut Option<Engine<'gpu>>) -> Result<()> {
        let Some(gpu) = gpu else { return self.reference() };
        match engine {
            Some(Engine::Raster(renderer)) => renderer.pose(self.scene)?,
            Some(Engine::Paths(renderer)) => renderer.pose(self.scene)?,
            None if self.settings.method.shares_subpaths() => {
                *engine = Some(Engine::Raster(Box::new(Renderer::new(gpu, self.scene, self.settings)?)));
            }
            None => *engine = Some(Engine::Paths(Box::new(PathRenderer::new(gpu, self.scene, self.settings)?))),
        }
        match engine {
            Some(Engine::Raster(renderer)) => self.raster(gpu, renderer),
            Some(Engine::Paths(renderer)) => self.paths(gpu, renderer),
            None => Ok(()),
        }
    }

    fn raster(&self, gpu: &Gpu, renderer: &mut Renderer) -> Result<()> {
        let (film, stats) = self.progressive(Some(gpu), renderer)?;
        let plan = renderer.plan();
        let wanted = renderer.stats().demands;
        let demands = wanted.iter().zip(plan.views()).enumerate();
        let stats = Stats {
            demands: demands
                .map(|(i, (&[items, nodes], texels))| Demand {
                    view: plan.view_name(i),
                    resolution: texels.resolution,
                    items,
                    nodes,
                })
                .collect(),
            plan: Some(serde_json::to_value(plan)?),
            ..stats
        };
        let samples = stats.samples;
        self.finish(&film, stats)?;
        self.strategy_images(&mut |only| {
            let settings = Settings { only: Some(only), ..self.settings.clone() };
            let mut renderer = Renderer::new(gpu, self.scene, &settings)?;
            renderer.render(samples, &mut |_| !self.interrupt.requested())?;
            renderer.film()
        })
    }

    fn paths(&self, gpu: &Gpu, renderer: &mut PathRenderer) -> Result<()> {
        let (film, stats) = self.progressive(Some(gpu), renderer)?;
        let stats = Stats { plan: Some(serde_json::to_value(renderer.plan())?), ..stats };
        let samples = stats.samples;
        self.finish(&film, stats)?;
        self.strategy_images(&mut |only| {
            renderer.count_only(Some(only));
            renderer.render(samples, &mut |_| !self.interrupt.requested())?;
            renderer.film()
        })
    }

    /// Writes the image of each strategy that the method has, with as many samples as the picture; none after
    /// a signal.
    fn strategy_images(&self, render: &mut dyn FnMut(OnlyStrategy) -> Result<Film, RenderError>) -> Result<()> {
        let Some(folder) = &self.args.strategy_images else { return Ok(()) };
        let all = [true, false].into_iter().flat_map(|weighted| OnlyStrategy::all(self.settings.bounces, weighted));
        let all: Vec<_> = all.filter(|only| self.settings.method.has_strategy(only.s, only.t)).collect();
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

    /// Renders as many samples as asked for, as the budget allows or as the error takes, or until a signal
    /// comes.
    fn progressive(&self, gpu: Option<&Gpu>, renderer: &mut dyn Progressive) -> Result<(Film, Stats<'_>), RenderError> {
        let setup = self.began.elapsed().as_secs_f64();
        self.interrupt.begin();
        let Settings { width, height, target_error, budget, .. } = *self.settings;
        let began = Instant::now();
        let bar = self.bar(self.settings.samples.into());
        let settles = renderer.settles() && self.args.strategy_images.is_none();
        let clock = budget.map(Clock::new);
        let end = match (target_error, &clock) {
            (None, None) => self.settings.samples.into(),
            _ => (*SAMPLES.end()).into(),
        };
        let mut convergence = target_error.map(|target| (target, Convergence::new(width, height)));
        // A picture that is filtered frame by frame goes on from the one before.
        let first = renderer.stats().samples;
        let (mut samples, mut taken) = (0, 0);
        let mut scale = None;
        let (film, ended_by) = loop {
            let goal = convergence.as_ref().map_or(end, |(_, convergence)| convergence.next_look().min(end));
            let mut ended = None;
            while samples < goal && ended.is_none() {
                let most = goal - samples;
                let round = clock.as_ref().map_or(Some(most), |clock| clock.next_round(samples, most.min(ROUND)));
                let Some(round) = round else {
                    ended = Some(Ending::Budget);
                    break;
                };
                let before = samples;
                renderer.render(round, &mut |all| {
                    samples = all - first;
                    self.show_samples(&bar, samples, began);
                    !self.interrupt.requested()
                })?;
                let pixels = convergence.as_ref().map_or(0, |(_, convergence)| convergence.tiles().running_pixels());
                taken += (samples - before) * pixels;
                if samples < end && self.interrupt.requested() {
                    ended = Some(Ending::Interrupt);
                }
            }
            let film = renderer.film()?;
            let mut found = (samples >= end).then_some(Ending::Samples).or(ended);
            if let Some((target, convergence)) = &mut convergence {
                let scale = *scale.get_or_insert_with(|| self.looked_at(&film));
                let bias = renderer.bias_films()?.map(|films| films.scaled(scale));
                let error = convergence.look(samples, &film.scaled(scale), bias.as_ref());
                if error.is_some_and(|error| error <= *target) {
                    found = found.filter(|ending| *ending == Ending::Interrupt).or(Some(Ending::TargetError));
                }
                if let (true, None) = (settles, found) {
                    convergence.settle(*target);
                    renderer.settle(convergence.tiles().settled())?;
                }
                if let Some(error) = error {
                    bar.set_message(format!("{error:.2e}"));
                }
            }
            if let Some(ending) = found {
                break (film, ending);
            }
        };
        let non_finite_after = gpu.map_or(Ok(Vec::new()), |gpu| gpu.non_finite.counts(gpu))?;
        bar.finish_and_clear();
        let render = began.elapsed().as_secs_f64();
        let all = samples * u64::from(width) * u64::from(height);
        let RenderStats { samples, bytes, scene_bytes, non_finite, lost_nodes, redone, passes, .. } = renderer.stats();
        let cpu = || format!("CPU, {} threads", rayon::current_num_threads());
        let stats = Stats {
            device: gpu.map_or_else(cpu, |gpu| gpu.capabilities.adapter.clone()),
            samples,
            ended_by,
            estimated_error: convergence.as_ref().and_then(|(_, convergence)| convergence.error()),
            taken: convergence.map(|_| taken as f64 / all.max(1) as f64),
            seconds: Seconds { load: self.load, setup, render },
            bytes,
            scene_bytes,
            non_finite,
            non_finite_after,
            lost_nodes,
            redone,
            passes,
            ..self.empty_stats()
        };
        Ok((film, stats))
    }

    /// The factor at which errors are estimated. Where nobody asked for one, dark pictures are brightened as for the display first: the
    /// 0.01 in rel_mse hides the noise of a picture whose radiances are far below 0.1.
    fn looked_at(&self, film: &Film) -> f32 {
        let Settings { target_error, budget, .. } = *self.settings;
        let by_default = (target_error, budget) == (Some(DEFAULT_TARGET_ERROR), Some(DEFAULT_BUDGET));
        if by_default { auto_exposure(film).max(0.0).exp2() } else { 1.0 }
    }

    fn show_samples(&self, bar: &ProgressBar, samples: u64, began: Instant) {
        if self.settings.budget.is_some() && self.settings.target_error.is_none() {
            bar.set_position(began.elapsed().as_millis() as u64);
            bar.set_message(format!("{samples} samples"));
        } else {
            bar.set_position(samples);
        }
    }

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

    fn empty_stats(&self) -> Stats<'_> {
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: &self.scene.name,
            device: String::new(),
            method: self.settings.method,
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
            demands: Vec::new(),
            rays: 0,
            plan: None,
            frame: self.frame,
            animations: self.animations,
            warnings: &self.scene.warnings,
            notes: &self.scene.notes,
            settings: self.settings,
        }
    }

    /// A progress bar on a terminal, and nothing elsewhere.
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

    /// Why the picture has the samples that it has, for the closing line.
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

/// A number with two digits that count: 0.0028.
fn two_digits(value: f64) -> String {
    if !value.is_finite() || value <= 0.0 {
        return value.to_string();
    }
    let places = (1 - value.log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.places$}")
}

/// The file of a frame: `out.exr` becomes `out_0007.exr`.
fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("_{number:04}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// The reference as what renders a picture bit by bit.
struct ReferenceRenderer<'s> {
    reference: Reference<'s>,
    settings: ReferenceSettings,
    rounds: Rounds,
    batch_size: BatchSize,
}

impl Progressive for ReferenceRenderer<'_> {
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

    fn settle(&mut self, _: &[bool]) -> Result<(), RenderError> {
        Err(RenderError::Setting("the reference has no tiles that settle".to_owned()))
    }

    fn settles(&self) -> bool {
        false
    }

    fn film(&self) -> Result<Film, RenderError> {
        Ok(self.rounds.film())
    }

    fn stats(&self) -> RenderStats {
        let non_finite = self.rounds.non_finite;
        RenderStats { samples: self.rounds.samples().into(), non_finite, ..RenderStats::default() }
    }
}

/// Deals out a budget.
struct Clock {
    began: Instant,
    budget: Duration,
}

impl Clock {
    fn new(seconds: f64) -> Self {
        Self { began: Instant::now(), budget: Duration::from_secs_f64(seconds) }
    }

    /// Samples that fit into what is left at the rate so far, at most `most`; the first is free. None: the time is used.
    fn next_round(&self, done: u64, most: u64) -> Option<u64> {
        let room = u64::from(*SAMPLES.end()).saturating_sub(done);
        if done == 0 {
            return Some(1);
        }
        let used = self.began.elapsed();
        let left = self.budget.saturating_sub(used).as_secs_f64();
        let fit = (left * done as f64 / used.as_secs_f64().max(1e-9)) as u64;
        Some(fit.min(most).min(room)).filter(|&round| round > 0)
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
