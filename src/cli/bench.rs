//! `bench`: error against run time, ours and others'.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::Parser as _;
use indicatif::{ProgressBar, ProgressStyle};

use lightsheaf::bench::contender::{device, ours};
use lightsheaf::bench::{Contender, Entry, Peer, PeerCommand, Schedule, Truth, race, truth};
use lightsheaf::gpu::{Gpu, GpuError};
use lightsheaf::report::{FILES, Machine, Report};
use lightsheaf::scene::{Scene, Viewpoint};
use lightsheaf::settings::{BUDGETS, Method, Settings, UNLIMITED, parse_bounces};
use lightsheaf::staging::{self, Staging};

use super::output;

/// Scenes where none are given: a light without extent, one with extent, and one that paths from the camera hardly find.
const SCENES: [&str; 3] = ["builtin:cornell_point", "builtin:cornell_area", "builtin:corner_spikes"];

#[derive(clap::Args)]
pub struct BenchArgs {
    /// .gltf, .glb or Mitsuba .xml files, or builtin:NAME [default: builtin:cornell_point, cornell_area and corner_spikes]
    scenes: Vec<String>,
    /// The folder for report.html, report.json, report.csv and report.md; made where there is none
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Methods that take part, by commas [default: raster, and where there are ray queries twin, ray-query and path]
    #[arg(long, value_name = "METHODS", value_enum, value_delimiter = ',')]
    methods: Vec<Method>,
    /// One more of our methods with options of its own: `fast=--method raster --visibility fast`; may be repeated
    #[arg(long = "variant", value_name = "NAME=OPTIONS")]
    variants: Vec<String>,
    /// A program of others: `mitsuba=target/peers/mitsuba/bin/python benches/peers/peer_mitsuba.py`, see benches/peers; needs Mitsuba .xml
    /// scenes; may be repeated
    #[arg(long = "peer", value_name = "NAME=COMMAND")]
    peers: Vec<PeerCommand>,
    /// Seconds of rendering for each method, scene and repeat
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value_t = 20.0)]
    budget: f64,
    /// Pictures of a repeat that are compared, at log-spaced times from a hundredth of the budget on, 2 to 64
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 9)]
    checkpoints: usize,
    /// Repeats, each with a seed of its own, 1 to 100
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 3)]
    repeats: u32,
    /// The first repeat's seed; the others follow
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Settings::default().seed)]
    seed: u32,
    /// Errors whose time is in the table, by commas
    #[arg(long, value_name = "REL_MSE", value_delimiter = ',', allow_hyphen_values = true, default_values_t = [0.01, 0.003, 0.001])]
    targets: Vec<f64>,
    /// Columns and rows of the pictures [default: what the scene's camera asks for, otherwise 512x512]
    #[arg(long, value_name = "WxH", value_parser = super::view::parse_size)]
    size: Option<(u32, u32)>,
    /// Indirect bounces: 0 is direct light only; `unlimited` for path, the reference and peers
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_bounces, default_value_t = Settings::default().bounces)]
    bounces: u32,
    /// What pictures are held against: an image for each scene, by commas, or auto: rendered once and kept, see --cache
    #[arg(long, value_name = "FILE|auto", value_delimiter = ',', default_value = "auto")]
    reference: Vec<String>,
    /// What is known of the own rel_mse of the images of --reference, by commas; it is subtracted
    #[arg(long, value_name = "REL_MSE", value_delimiter = ',', requires = "reference")]
    reference_error: Vec<f64>,
    /// Who makes references: reference, path or ray-query [default: path on a GPU with ray queries, otherwise reference]
    #[arg(long, value_name = "METHOD", value_enum)]
    reference_method: Option<Method>,
    /// Seconds for a reference [default: ten times the budget]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    reference_budget: Option<f64>,
    /// Where references are kept [default: lightsheaf/references in the user's cache folder]
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// No progress, no closing line
    #[arg(short, long)]
    quiet: bool,
}

/// One of our methods with its settings.
#[derive(Clone)]
struct Variant {
    name: String,
    settings: Settings,
}

/// Options of a variant, as `render` has them.
#[derive(clap::Parser)]
#[command(no_binary_name = true)]
struct Options {
    #[command(flatten)]
    settings: Settings,
}

/// Measures, and writes the report after each scene.
pub fn run(args: &BenchArgs) -> Result<()> {
    let machine = Machine::here();
    check(args)?;
    let scenes = match args.scenes.as_slice() {
        [] => SCENES.map(str::to_owned).to_vec(),
        scenes => scenes.to_vec(),
    };
    let references = references(args, scenes.len())?;
    let variants = variants(args)?;
    std::fs::create_dir_all(&args.output).with_context(|| format!("-o {}", args.output.display()))?;
    for name in FILES {
        let path = args.output.join(name);
        output::check(&path, &[name.rsplit('.').next().unwrap_or_default()])?;
    }
    let judge = Judge::new(args)?;

    let seeds = (0..args.repeats).map(|n| args.seed.wrapping_add(n)).collect();
    let schedule = Schedule::new(args.budget, args.checkpoints, seeds);
    let bounces = Some(args.bounces).filter(|&b| b != UNLIMITED);
    let mut report = Report::new(command_line(), machine, schedule, bounces, args.targets.clone());
    let staging = Staging { size: args.size.unwrap_or((1, 1)).into(), ..Staging::default() };
    for (spec, (reference, own)) in scenes.iter().zip(&references) {
        let mut scene = staging::load(spec, &staging)?;
        scene.viewpoint = args.size.map(|(width, height)| Viewpoint { camera: 0, size: [width, height] });
        for warning in &scene.warnings {
            eprintln!("warning: {spec}: {warning}");
        }
        bench(args, &scene, spec, &variants, &judge, (reference, *own), &mut report).with_context(|| spec.clone())?;
        report.write(&args.output)?;
    }
    if !args.quiet {
        eprintln!("{}", args.output.join(FILES[0]).display());
    }
    Ok(())
}

/// One scene.
fn bench(
    args: &BenchArgs,
    scene: &Scene,
    spec: &str,
    variants: &[Variant],
    judge: &Judge,
    (reference, own): (&str, Option<f64>),
    report: &mut Report,
) -> Result<()> {
    let film_size = args.size.or(scene.cameras[0].film_size);
    let sized = |settings: &Settings| {
        let (width, height) = film_size.unwrap_or((settings.width, settings.height));
        Settings { width, height, bounces: args.bounces, seed: args.seed, ..settings.clone() }
    };
    let truth = match reference {
        "auto" => judge.truth(args, scene, spec, &sized(&Settings::default()))?,
        file => Truth::from_file(Path::new(file), own)?,
    };
    let settings = sized(&Settings::default());
    if (truth.film.width, truth.film.height) != (settings.width, settings.height) {
        bail!(
            "the reference {reference} is {}x{}, pictures would be {}x{}: give --size {0}x{1}",
            truth.film.width,
            truth.film.height,
            settings.width,
            settings.height
        );
    }

    let stripped = variants.iter().any(|v| v.settings.method.shares_subpaths());
    let without_glass = stripped.then(|| scene.clone().without_glass());
    for warning in without_glass.iter().flat_map(|s| &s.warnings).filter(|w| !scene.warnings.contains(w)) {
        eprintln!("warning: {spec}: raster and twin: {warning}");
    }

    // Each on a device of its own, so that times of passes stay apart.
    let bar = bar(args, "{prefix}: starting {msg}");
    bar.set_prefix(spec.to_owned());
    let mut opened = Vec::new();
    for variant in variants {
        let began = Instant::now();
        opened.push((device(variant.settings.method)?, began.elapsed().as_secs_f64()));
    }
    let mut entries = Vec::new();
    for (variant, (gpu, opening)) in variants.iter().zip(&opened) {
        bar.set_message(variant.name.clone());
        let began = Instant::now();
        let scene = without_glass.as_ref().filter(|_| variant.settings.method.shares_subpaths()).unwrap_or(scene);
        let contender = ours(gpu.as_ref(), scene, &sized(&variant.settings))?;
        let mut entry = Entry::new(variant.name.clone(), contender, began)?;
        entry.startup += opening;
        entries.push(entry);
    }
    let mut refusals = Vec::new();
    for peer in &args.peers {
        bar.set_message(peer.name.clone());
        let began = Instant::now();
        let patience = Duration::from_secs_f64(20.0 * args.budget + 120.0);
        let started = Peer::start(peer, spec, &settings, &args.output, patience)
            .and_then(|p| Entry::new(peer.name.clone(), Box::new(p) as Box<dyn Contender>, began));
        match started {
            Ok(entry) => entries.push(entry),
            Err(e) => {
                eprintln!("warning: {spec}: {e}");
                refusals.push((peer.name.clone(), e.to_string()));
            }
        }
    }
    bar.finish_and_clear();

    let bar = self::bar(args, "{prefix}: {bar:40} {percent} %, {msg}, {elapsed}");
    bar.set_prefix(spec.to_owned());
    race(&mut entries, &report.schedule, &truth, &mut |p| {
        bar.set_position((1000.0 * p.done) as u64);
        bar.set_message(format!("repeat {}, {}", p.repeat + 1, p.name));
    });
    bar.finish_and_clear();
    for (name, failure) in entries.iter().filter_map(|e| Some((&e.name, e.failure.as_ref()?))) {
        eprintln!("warning: {spec}: {name} ended early: {failure}");
    }
    report.add(spec.to_owned(), &truth, &entries, refusals);
    Ok(())
}

/// Who makes references.
struct Judge {
    method: Method,
    gpu: Option<Gpu>,
    cache: PathBuf,
    seconds: f64,
}

impl Judge {
    fn new(args: &BenchArgs) -> Result<Self> {
        let (method, gpu) = match args.reference_method {
            None if args.reference.iter().all(|r| r != "auto") => (Method::Reference, None),
            None => truth::best_method(),
            Some(method) => (method, device(method)?),
        };
        let cache = args.cache.clone().unwrap_or_else(truth::default_cache);
        let seconds = args.reference_budget.unwrap_or(10.0 * args.budget);
        Ok(Self { method, gpu, cache, seconds })
    }

    fn truth(&self, args: &BenchArgs, scene: &Scene, spec: &str, settings: &Settings) -> Result<Truth> {
        let settings = Settings { method: self.method, seed: Settings::default().seed, ..settings.clone() };
        settings.check()?;
        let bar = bar(args, "{prefix}: {bar:40} {percent} % of the reference, {elapsed}");
        bar.set_prefix(spec.to_owned());
        let progress = |done: f64| bar.set_position((1000.0 * done) as u64);
        let truth = Truth::cached(self.gpu.as_ref(), scene, &settings, self.seconds, &self.cache, &progress)?;
        bar.finish_and_clear();
        Ok(truth)
    }
}

/// What can be wrong before anything is loaded.
fn check(args: &BenchArgs) -> Result<()> {
    for (option, seconds) in [("--budget", Some(args.budget)), ("--reference-budget", args.reference_budget)] {
        if let Some(seconds) = seconds.filter(|s| !BUDGETS.contains(s)) {
            bail!("{option} {seconds}: has to be {} to {} seconds", BUDGETS.start(), BUDGETS.end());
        }
    }
    if !(2..=64).contains(&args.checkpoints) {
        bail!("--checkpoints {}: has to be 2 to 64", args.checkpoints);
    }
    if !(1..=100).contains(&args.repeats) {
        bail!("--repeats {}: has to be 1 to 100", args.repeats);
    }
    if let Some(error) = args.targets.iter().chain(&args.reference_error).find(|e| !(**e > 0.0 && e.is_finite())) {
        bail!("{error}: an error has to be a number above 0");
    }
    if let Some(method) = args.reference_method.filter(|m| m.shares_subpaths()) {
        bail!("--reference-method {method}: is biased at any number of samples; use reference, path or ray-query");
    }
    if let (Some(scene), [peer, ..]) = (args.scenes.iter().find(|s| !s.ends_with(".xml")), args.peers.as_slice()) {
        bail!("{scene}: peer {} reads Mitsuba .xml scenes only; leave out one of them", peer.name);
    }
    if let ([], [peer, ..]) = (args.scenes.as_slice(), args.peers.as_slice()) {
        bail!("peer {} reads Mitsuba .xml scenes only: name some", peer.name);
    }
    Ok(())
}

/// A reference for each scene, with what is known of its error.
fn references(args: &BenchArgs, scenes: usize) -> Result<Vec<(String, Option<f64>)>> {
    let references = match args.reference.as_slice() {
        [one] if one == "auto" => vec![one.clone(); scenes],
        all if all.len() == scenes => all.to_vec(),
        all => bail!("--reference: {} images for {scenes} scenes; give one for each, or auto", all.len()),
    };
    if !args.reference_error.is_empty() && args.reference_error.len() != scenes {
        bail!("--reference-error: {} numbers for {scenes} scenes; give one for each", args.reference_error.len());
    }
    let errors = args.reference_error.iter().copied().map(Some).chain(std::iter::repeat(None));
    Ok(references.into_iter().zip(errors).collect())
}

/// Our methods that take part.
fn variants(args: &BenchArgs) -> Result<Vec<Variant>> {
    let plain = |&method: &Method| Variant {
        name: method.to_string(),
        settings: Settings { method, bounces: args.bounces, ..Settings::default() },
    };
    let mut variants: Vec<Variant> = match args.methods.as_slice() {
        [] if args.variants.is_empty() => default_methods()?.iter().map(plain).collect(),
        methods => methods.iter().map(plain).collect(),
    };
    for text in &args.variants {
        let Some((name, options)) = text.split_once('=') else {
            bail!("--variant {text}: has to be NAME=OPTIONS, such as `fast=--method raster --visibility fast`");
        };
        let options = Options::try_parse_from(shlex::Shlex::new(options));
        let mut settings = options.with_context(|| format!("--variant {name}"))?.settings;
        let Settings { samples, budget, bounces, seed, aperture, focus, .. } = Settings::default();
        let ours =
            (settings.samples, settings.budget, settings.bounces, settings.seed, settings.aperture, settings.focus);
        if ours != (samples, budget, bounces, seed, aperture, focus) {
            bail!(
                "--variant {name}: samples, budget, bounces, seed and lens are the same for all; see the options of bench"
            );
        }
        settings.bounces = args.bounces;
        variants.push(Variant { name: name.to_owned(), settings });
    }
    for variant in &variants {
        variant.settings.check().with_context(|| variant.name.clone())?;
    }
    let names: Vec<_> = variants.iter().map(|v| &v.name).chain(args.peers.iter().map(|p| &p.name)).collect();
    if let Some(twice) = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name)) {
        bail!("{}: two methods of that name; give one of them another by --variant or --peer", twice.1);
    }
    Ok(variants)
}

/// All that this device has.
fn default_methods() -> Result<Vec<Method>> {
    match Gpu::with_ray_queries() {
        Ok(_) => Ok(vec![Method::Raster, Method::Twin, Method::RayQuery, Method::Path]),
        Err(GpuError::NoRayQueries { adapter, .. }) => {
            eprintln!("warning: {adapter} has no ray queries: raster and the CPU reference take part");
            Ok(vec![Method::Raster, Method::Reference])
        }
        Err(e) => Err(e.into()),
    }
}

/// The command line, quoted for a shell.
fn command_line() -> String {
    let words: Vec<String> = std::env::args().collect();
    shlex::try_join(words.iter().map(String::as_str)).unwrap_or_else(|_| words.join(" "))
}

/// A progress bar of a thousand steps on a terminal, and nothing elsewhere.
fn bar(args: &BenchArgs, template: &str) -> ProgressBar {
    if args.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}
