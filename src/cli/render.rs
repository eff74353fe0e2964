//! `render`: a scene to an image, for a number of samples or for a time.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use lightsheaf::film::Film;
use lightsheaf::gpu::{Gpu, PassTime};
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::reference::{Reference, ReferenceSettings, Rounds};
use lightsheaf::renderer::{Progressive, RenderError, RenderStats, Renderer};
use lightsheaf::scene::Scene;
use lightsheaf::settings::{Method, OnlyStrategy, SAMPLES, Settings, UNLIMITED};
use lightsheaf::tiles::Tiles;
use lightsheaf::tonemap::{Exposure, Grade, Tonemap};

use super::output;
use super::view::{self, ANIMATION, GradeArgs, View, ViewArgs};

/// Most samples between two looks at the clock.
const ROUND: u64 = 8;

/// Samples of the first picture that another is held against.
const FIRST_HALF: u64 = 8;

#[derive(clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// The image: .exr (linear 32-bit float) or .png (8-bit sRGB by --exposure and --tonemap)
    #[arg(short, long, value_name = "OUT.exr|.png")]
    output: PathBuf,
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
    fn is_png(&self) -> bool {
        self.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"))
    }
}

/// How a picture came as near to the truth as asked for, or as its budget allowed.
struct Convergence {
    /// Its rel_mse, estimated; none where nothing can be said.
    error: Option<f64>,
    /// Share of all pixels' samples that was taken.
    taken: f64,
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
    /// With `--target-error`: rel_mse as the picture's first half tells it.
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
pub fn run(args: &RenderArgs) -> Result<()> {
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
        let job = Job { args, grade: &grade, load, began, scene, settings, animations, frame: None, all: 1 };
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
        if n > 0 {
            let posing = Instant::now();
            scene = args.view.complete(args.view.at("--frames", &loaded, frame.seconds)?, &mut settings)?;
            load = posing.elapsed().as_secs_f64();
            began = Instant::now();
        }
        let (scene, settings, animations) = (&scene, &settings, &animations);
        let job = Job { args, grade: &grade, load, began, scene, settings, animations, frame: Some(frame), all };
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
    output::check(&args.output, &["exr", "png"])?;
    if args.check_values && args.view.settings.method == Method::Reference {
        bail!("--check-values: the reference has no passes; use any other method");
    }
    if let Some(stats) = &args.stats {
        output::check(stats, &["json"])?;
    }
    let GradeArgs { exposure, tonemap } = &args.grade;
    for (option, given) in [("--exposure", exposure.is_some()), ("--tonemap", tonemap.is_some())] {
        if given && !args.is_png() {
            bail!("{option}: {} keeps linear radiance; write a .png, or leave it out", args.output.display());
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
        let (film, stats) = self.progressive(gpu, renderer)?;
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
            renderer.render(samples, &mut |_| true)?;
            renderer.film()
        })
    }

    fn paths(&self, gpu: &Gpu, renderer: &mut PathRenderer) -> Result<()> {
        let (film, stats) = self.progressive(gpu, renderer)?;
        let stats = Stats { plan: Some(serde_json::to_value(renderer.plan())?), ..stats };
        let samples = stats.samples;
        self.finish(&film, stats)?;
        self.strategy_images(&mut |only| {
            renderer.count_only(Some(only));
            renderer.render(samples, &mut |_| true)?;
            renderer.film()
        })
    }

    /// Writes the image of each strategy that the method has.
    fn strategy_images(&self, render: &mut dyn FnMut(OnlyStrategy) -> Result<Film, RenderError>) -> Result<()> {
        let Some(folder) = &self.args.strategy_images else { return Ok(()) };
        let all = [true, false].into_iter().flat_map(|weighted| OnlyStrategy::all(self.settings.bounces, weighted));
        let all: Vec<_> = all.filter(|only| self.settings.method.has_strategy(only.s, only.t)).collect();
        let bar = self.bar(all.len() as u64);
        for only in all {
            bar.set_message(only.name());
            render(only)?.save(folder.join(only.name()).with_extension("exr"))?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Renders as many samples as asked for, or as the budget allows.
    fn progressive(&self, gpu: &Gpu, renderer: &mut dyn Progressive) -> Result<(Film, Stats<'_>), RenderError> {
        let setup = self.began.elapsed().as_secs_f64();
        let began = Instant::now();
        let bar = self.bar(self.settings.samples.into());
        let mut converged = None;
        match (self.settings.target_error, self.settings.budget) {
            (Some(target), _) => converged = Some(self.converge(renderer, target, &bar)?),
            (None, None) => renderer.render(self.settings.samples.into(), &mut |samples| {
                bar.set_position(samples);
                true
            })?,
            (None, Some(seconds)) => {
                let clock = Clock::new(seconds);
                let mut samples = 0;
                while let Some(round) = clock.next_round(samples, ROUND) {
                    renderer.render(round, &mut |_| true)?;
                    samples += round;
                    show_budget(&bar, clock.began, samples);
                }
            }
        }
        let film = renderer.film()?;
        let non_finite_after = gpu.non_finite.counts(gpu)?;
        bar.finish_and_clear();
        let render = began.elapsed().as_secs_f64();
        let RenderStats { samples, bytes, scene_bytes, non_finite, lost_nodes, redone, passes, .. } = renderer.stats();
        let stats = Stats {
            device: gpu.capabilities.adapter.clone(),
            samples,
            estimated_error: converged.as_ref().and_then(|converged| converged.error),
            taken: converged.map(|converged| converged.taken),
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

    /// Doubles the samples until the picture is as near to the truth as asked for, or the budget is used. Tiles that settle take no more samples, but where strategies are to add up to the picture.
    fn converge(
        &self,
        renderer: &mut dyn Progressive,
        target: f64,
        bar: &ProgressBar,
    ) -> Result<Convergence, RenderError> {
        let Settings { width, height, .. } = *self.settings;
        let settles = renderer.settles() && self.args.strategy_images.is_none();
        let clock = self.settings.budget.map(Clock::new);
        let mut tiles = Tiles::new(width, height);
        let (mut samples, mut taken, mut half, mut error) = (0, 0, None, None);
        let mut end = FIRST_HALF;
        'doubling: while end <= (*SAMPLES.end()).into() {
            while samples < end {
                let most = ROUND.min(end - samples);
                let round = clock.as_ref().map_or(Some(most), |clock| clock.next_round(samples, most));
                let Some(round) = round else { break 'doubling };
                renderer.render(round, &mut |_| true)?;
                samples += round;
                taken += round * tiles.running_pixels();
                bar.set_position(samples);
            }
            let whole = renderer.film()?;
            error = half.and_then(|half| tiles.look(&half, &whole).ok());
            if error.is_some_and(|error| error <= target) {
                break;
            }
            if settles {
                tiles.settle(target);
                renderer.settle(tiles.settled())?;
            }
            if let Some(error) = error {
                let running = tiles.running();
                bar.set_message(format!("{error:.2e}, {running} of {} tiles not settled", tiles.settled().len()));
            }
            (half, end) = (Some(whole), 2 * end);
        }
        let all = samples * u64::from(width) * u64::from(height);
        Ok(Convergence { error, taken: taken as f64 / all.max(1) as f64 })
    }

    fn reference(&self) -> Result<()> {
        let reference = Reference::new(self.scene);
        let setup = self.began.elapsed().as_secs_f64();

        let began = Instant::now();
        let Settings { width, height, samples, seed, camera, .. } = *self.settings;
        let bounces = Some(self.settings.bounces).filter(|&b| b != UNLIMITED);
        let settings = ReferenceSettings { width, height, samples, bounces, seed, camera };
        let bar = self.bar(u64::from(width) * u64::from(height));
        let (film, samples, non_finite, rays) = match self.settings.budget {
            None => {
                bar.set_message(format!("{samples} samples per pixel"));
                let output = reference.render(&settings, &|pixels, _| bar.set_position(pixels));
                (output.film, samples.into(), output.non_finite, output.rays)
            }
            Some(seconds) => {
                let rounds = render_rounds(&reference, settings, seconds, &bar);
                (rounds.film(), rounds.samples().into(), rounds.non_finite, rounds.rays)
            }
        };
        bar.finish_and_clear();
        let render = began.elapsed().as_secs_f64();

        let stats = Stats {
            device: format!("CPU, {} threads", rayon::current_num_threads()),
            samples,
            seconds: Seconds { load: self.load, setup, render },
            non_finite,
            rays,
            ..self.empty_stats()
        };
        self.finish(&film, stats)
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
        let (total, template) = match (self.settings.budget, self.settings.method) {
            _ if self.settings.target_error.is_some() => (0, "{prefix}{pos} samples, {elapsed}, rel_mse {msg}"),
            (Some(seconds), _) => ((seconds * 1000.0) as u64, "{prefix}{bar:40} {msg}, {elapsed} of the budget"),
            (None, Method::Raster | Method::Twin | Method::RayQuery | Method::Path) => {
                (total, "{prefix}{bar:40} {pos}/{len} samples, {per_sec}, {eta} left")
            }
            (None, Method::Reference) => (total, "{prefix}{bar:40} {percent} % of the pixels, {msg}, {eta} left"),
        };
        let bar = ProgressBar::new(total);
        if let Some(frame) = self.frame {
            bar.set_prefix(format!("frame {}, one of {} ", frame.number, self.all));
        }
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar
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
        let path = named(&self.args.output);
        let (exposure, tonemap) = self.args.grade.chosen();
        let grade = self.grade.get_or_init(|| Grade { stops: exposure.stops(film), tonemap });
        film.save_graded(&path, grade)?;
        if self.args.is_png() {
            (stats.exposure_stops, stats.tonemap) = (Some(grade.stops), Some(grade.tonemap));
        }
        if let Some(path) = &self.args.stats {
            output::write(&named(path), &(serde_json::to_string_pretty(&stats)? + "\n"))?;
        }
        if !self.args.quiet {
            let Seconds { load, setup, render } = stats.seconds;
            let shown = match exposure {
                _ if !self.args.is_png() => String::new(),
                Exposure::Auto => format!("; exposure {:+.2} stops (auto), {tonemap}", grade.stops),
                Exposure::Stops(stops) => format!("; exposure {stops:+} stops, {tonemap}"),
            };
            eprintln!(
                "{}: {}x{}, {} samples by {} on {}{shown}; load {load:.2} s, setup {setup:.2} s, render {render:.2} s",
                path.display(),
                film.width,
                film.height,
                stats.samples,
                stats.method,
                stats.device
            );
        }
        Ok(())
    }
}

/// The file of a frame: `out.exr` becomes `out_0007.exr`.
fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("_{number:04}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// Rounds of the reference until the time is used.
fn render_rounds(reference: &Reference, settings: ReferenceSettings, seconds: f64, bar: &ProgressBar) -> Rounds {
    let clock = Clock::new(seconds);
    let mut rounds = Rounds::new(settings);
    // Each round at most doubles what there is: early rounds show the rate, and sums of powers of two are stratified well.
    while let Some(round) = clock.next_round(rounds.samples().into(), rounds.samples().max(1).into()) {
        let samples = rounds.samples().into();
        rounds.add(reference, 1 << round.ilog2(), &|_, _| show_budget(bar, clock.began, samples));
    }
    rounds
}

fn show_budget(bar: &ProgressBar, began: Instant, samples: u64) {
    bar.set_position(began.elapsed().as_millis() as u64);
    bar.set_message(format!("{samples} samples"));
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
    fn frames_are_parsed_and_numbered() {
        assert_eq!((parse_frames("0..47"), parse_frames("12")), (Ok((0, 47)), Ok((12, 12))));
        for bad in ["", "..", "3..", "..3", "3..2", "-1..2", "0..1000000", "a..b", "0..=3", "1.5..2"] {
            assert!(parse_frames(bad).is_err(), "{bad}");
        }
        assert_eq!(numbered(Path::new("a.b/c.d.exr"), 7), Path::new("a.b/c.d_0007.exr"));
        assert_eq!(numbered(Path::new("c.png"), 123_456), Path::new("c_123456.png"));
    }
}
