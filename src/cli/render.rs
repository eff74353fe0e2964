//! `render`: a scene to an image, for a number of samples or for a time.

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

use super::output;
use super::view::ViewArgs;

/// Most samples between two looks at the clock.
const ROUND: u64 = 8;

#[derive(clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    view: ViewArgs,
    /// The image: .exr (linear 32-bit float) or .png (8-bit sRGB, clipped)
    #[arg(short, long, value_name = "OUT.exr|.png")]
    output: PathBuf,
    /// Brighten a .png by this many stops: values are multiplied by 2^STOPS
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    exposure: Option<f32>,
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
    /// Neither progress nor closing line; warnings and errors stay
    #[arg(short, long)]
    quiet: bool,
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
    seconds: Seconds,
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
    warnings: &'a [String],
    settings: &'a Settings,
}

#[derive(Clone, Copy, Default, serde::Serialize)]
struct Seconds {
    load: f64,
    /// Device, upload and pipelines; the hierarchy of the reference.
    setup: f64,
    render: f64,
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
    let exposure = check_outputs(args)?;
    let began = Instant::now();
    let (scene, settings) = args.view.load()?;
    let load = began.elapsed().as_secs_f64();
    if let Some(folder) = &args.strategy_images {
        check_strategy_images(folder, &settings)?;
    }
    let job = Job { args, exposure, load, scene: &scene, settings: &settings };
    match settings.method {
        Method::Raster | Method::Twin => job.raster(),
        Method::RayQuery | Method::Path => job.paths(),
        Method::Reference => job.reference(),
    }
}

/// Everything about the output that can be wrong before there is one; returns the factor of the exposure.
fn check_outputs(args: &RenderArgs) -> Result<f32> {
    output::check(&args.output, &["exr", "png"])?;
    if args.check_values && args.view.settings.method == Method::Reference {
        bail!("--check-values: the reference has no passes; use any other method");
    }
    if let Some(stats) = &args.stats {
        output::check(stats, &["json"])?;
    }
    match args.exposure {
        None => Ok(1.0),
        Some(stops) if !(-32.0..=32.0).contains(&stops) => bail!("--exposure {stops}: has to be -32 to 32 stops"),
        Some(_) if args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) => {
            bail!("--exposure: {} keeps linear radiance; write a .png, or leave it out", args.output.display())
        }
        Some(stops) => Ok(stops.exp2()),
    }
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
    exposure: f32,
    load: f64,
    scene: &'a Scene,
    settings: &'a Settings,
}

impl Job<'_> {
    fn raster(&self) -> Result<()> {
        let began = Instant::now();
        let gpu = super::open(self.settings.method)?;
        gpu.non_finite.watch(&gpu, self.args.check_values);
        let mut renderer = Renderer::new(&gpu, self.scene, self.settings)?;
        let (film, stats) = self.progressive(&gpu, &mut renderer, began)?;
        let plan = renderer.plan();
        let wanted = renderer.stats().demands;
        let demands = wanted.iter().zip(plan.views()).enumerate();
        let stats = Stats {
            demands: demands
                .map(|(i, (&[items, nodes], (resolution, _)))| Demand {
                    view: view_name(i, plan.light_vertices as usize),
                    resolution,
                    items,
                    nodes,
                })
                .collect(),
            plan: Some(serde_json::to_value(plan)?),
            ..stats
        };
        self.finish(&film, &stats)?;
        self.strategy_images(&mut |only| {
            let settings = Settings { only: Some(only), ..self.settings.clone() };
            let mut renderer = Renderer::new(&gpu, self.scene, &settings)?;
            renderer.render(stats.samples, &mut |_| true)?;
            renderer.film()
        })
    }

    fn paths(&self) -> Result<()> {
        let began = Instant::now();
        let gpu = super::open(self.settings.method)?;
        gpu.non_finite.watch(&gpu, self.args.check_values);
        let mut renderer = PathRenderer::new(&gpu, self.scene, self.settings)?;
        let (film, stats) = self.progressive(&gpu, &mut renderer, began)?;
        let stats = Stats { plan: Some(serde_json::to_value(renderer.plan())?), ..stats };
        self.finish(&film, &stats)?;
        self.strategy_images(&mut |only| {
            renderer.count_only(Some(only));
            renderer.render(stats.samples, &mut |_| true)?;
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

    /// Renders as many samples as asked for, or as the budget allows. `began`: when the setup did.
    fn progressive(
        &self,
        gpu: &Gpu,
        renderer: &mut dyn Progressive,
        began: Instant,
    ) -> Result<(Film, Stats<'_>), RenderError> {
        let setup = began.elapsed().as_secs_f64();
        let began = Instant::now();
        let bar = self.bar(self.settings.samples.into());
        match self.settings.budget {
            None => renderer.render(self.settings.samples.into(), &mut |samples| {
                bar.set_position(samples);
                true
            })?,
            Some(seconds) => {
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

    fn reference(&self) -> Result<()> {
        let began = Instant::now();
        let reference = Reference::new(self.scene);
        let setup = began.elapsed().as_secs_f64();

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
        self.finish(&film, &stats)
    }

    fn empty_stats(&self) -> Stats<'_> {
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: &self.scene.name,
            device: String::new(),
            method: self.settings.method,
            size: [self.settings.width, self.settings.height],
            samples: 0,
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
            warnings: &self.scene.warnings,
            settings: self.settings,
        }
    }

    /// A progress bar on a terminal, and nothing elsewhere.
    fn bar(&self, total: u64) -> ProgressBar {
        if self.args.quiet {
            return ProgressBar::hidden();
        }
        let (total, template) = match (self.settings.budget, self.settings.method) {
            (Some(seconds), _) => ((seconds * 1000.0) as u64, "{bar:40} {msg}, {elapsed} of the budget"),
            (None, Method::Raster | Method::Twin | Method::RayQuery | Method::Path) => {
                (total, "{bar:40} {pos}/{len} samples, {per_sec}, {eta} left")
            }
            (None, Method::Reference) => (total, "{bar:40} {percent} % of the pixels, {msg}, {eta} left"),
        };
        let bar = ProgressBar::new(total);
        bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar
    }

    fn finish(&self, film: &Film, stats: &Stats) -> Result<()> {
        if stats.non_finite > 0 {
            let first = stats.non_finite_after.iter().find(|(_, count)| *count > 0);
            let first = first.map(|(pass, _)| format!(", first after the pass {pass}")).unwrap_or_default();
            eprintln!(
                "warning: {} values are not finite{first}; please report the scene and the settings",
                stats.non_finite
            );
        }
        let path: &Path = &self.args.output;
        film.save_exposed(path, self.exposure)?;
        if let Some(path) = &self.args.stats {
            output::write(path, &(serde_json::to_string_pretty(stats)? + "\n"))?;
        }
        if !self.args.quiet {
            let Seconds { load, setup, render } = stats.seconds;
            eprintln!(
                "{}: {}x{}, {} samples by {} on {}; load {load:.2} s, setup {setup:.2} s, render {render:.2} s",
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

/// Views come around the light, around the VPLs, then the bundles.
fn view_name(index: usize, light_vertices: usize) -> String {
    match index {
        0 if light_vertices > 0 => "light".to_owned(),
        i if i < light_vertices => format!("vpl {i}"),
        i => format!("bundle {}", i - light_vertices + 1),
    }
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
    fn views_are_named_in_the_plan_s_order() {
        let names: Vec<_> = (0..5).map(|i| view_name(i, 3)).collect();
        assert_eq!(names, ["light", "vpl 1", "vpl 2", "bundle 1", "bundle 2"]);
        assert_eq!(view_name(0, 0), "bundle 1");
    }
}
