//! Command `bench`: measures error against run time of our methods and of other programs.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::Parser as _;
use indicatif::{ProgressBar, ProgressStyle};

use crate::bench::contender::{device, ours};
use crate::bench::report::{FILES, Machine, Report};
use crate::bench::{Contender, Entry, Peer, PeerCommand, Schedule, Truth, race, truth};
use crate::film::Film;
use crate::gpu::{Gpu, GpuError};
use crate::render::adapt::adapted;
use crate::scene::{Scene, Viewpoint};
use crate::settings::{BUDGETS, Settings, Technique, UNLIMITED, parse_bounces};
use crate::staging::{self, Staging};

use super::output;

/// Default scenes: a point light, an area light, and a light that paths from the camera rarely find.
const SCENES: [&str; 3] = ["builtin:cornell_point", "builtin:cornell_area", "builtin:corner_spikes"];

#[derive(clap::Args)]
pub struct BenchArgs {
    /// Scene files or builtin:NAME, see `lightsheaf scenes` [default: builtin:cornell_point,
    /// cornell_area and corner_spikes]
    scenes: Vec<String>,
    /// Folder for report.html, report.json, report.csv and report.md. It is created if it does not exist
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Methods to measure, separated by commas: raster, twin, ray-query, path, reference [default: raster,
    /// twin, ray-query and path; without ray queries raster and reference]
    #[arg(long, value_name = "METHODS", value_delimiter = ',')]
    methods: Vec<Technique>,
    /// Further method with its own options of render, such as `fast=--method shared --visibility fast`. May
    /// be repeated
    #[arg(long = "variant", value_name = "NAME=OPTIONS")]
    variants: Vec<String>,
    /// Other program, such as `mitsuba=target/peers/mitsuba/bin/python benches/peers/peer_mitsuba.py` (see
    /// benches/peers). Needs Mitsuba .xml scenes. May be repeated
    #[arg(long = "peer", value_name = "NAME=COMMAND")]
    peers: Vec<PeerCommand>,
    /// Time of rendering for each method, scene and repeat in seconds, 0.001 to 604800
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, default_value_t = 20.0)]
    budget: f64,
    /// Number of pictures of a repeat that are compared, 2 to 64, at log-spaced times from a hundredth of the
    /// budget on
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 9)]
    checkpoints: usize,
    /// Number of repeats, 1 to 100, each with a separate seed
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = 3)]
    repeats: u32,
    /// Seed of the first repeat. The other repeats use the following numbers
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Settings::default().seed)]
    seed: u32,
    /// Errors for which the table lists the time, above 0, separated by commas
    #[arg(long, value_name = "REL_MSE", value_delimiter = ',', allow_hyphen_values = true, default_values_t = [0.01, 0.003, 0.001])]
    targets: Vec<f64>,
    /// Width and height of the pictures in pixels, 1 to 16384 each [default: the camera's film size if the
    /// scene has one, otherwise 512x512]
    #[arg(long, value_name = "WxH", value_parser = super::view::parse_size)]
    size: Option<(u32, u32)>,
    /// Number of indirect bounces, 0 to 64, those on glass and mirrors included. 0 is direct light only. path,
    /// reference and peers also accept `unlimited`
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_bounces, default_value_t = Settings::default().bounces)]
    bounces: u32,
    /// Reference image for each scene, separated by commas. auto renders references once and stores them in
    /// --cache
    #[arg(long, value_name = "FILE|auto", value_delimiter = ',', default_value = "auto")]
    reference: Vec<String>,
    /// Known rel_mse of each image of --reference, above 0, separated by commas. It is subtracted from the
    /// results
    #[arg(long, value_name = "REL_MSE", value_delimiter = ',', requires = "reference")]
    reference_error: Vec<f64>,
    /// Method that renders references: reference, path or ray-query [default: path on a GPU with ray queries,
    /// otherwise reference]
    #[arg(long, value_name = "METHOD")]
    reference_method: Option<Technique>,
    /// Time for rendering a reference in seconds, 0.001 to 604800 [default: ten times the budget]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    reference_budget: Option<f64>,
    /// Folder of references that were rendered [default: lightsheaf/references in the user's cache folder]
    #[arg(long, value_name = "DIR")]
    cache: Option<PathBuf>,
    /// Print neither progress nor the closing line. Warnings and errors are still printed
    #[arg(short, long)]
    quiet: bool,
}

/// Method of ours with its settings.
#[derive(Clone)]
struct Variant {
    name: String,
    settings: Settings,
}

/// Options of a variant, which are options of `render`.
#[derive(clap::Parser)]
#[command(no_binary_name = true)]
struct Options {
    #[command(flatten)]
    settings: Settings,
}

/// Measures all scenes, and writes the report after each scene.
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
    let reference_maker = ReferenceMaker::new(args)?;

    let seeds = (0..args.repeats).map(|n| args.seed.wrapping_add(n)).collect();
    let schedule = Schedule::new(args.budget, args.checkpoints, seeds);
    let bounces = Some(args.bounces).filter(|&b| b != UNLIMITED);
    let mut report = Report::new(output::command_line(), machine, schedule, bounces, args.targets.clone());
    let staging = Staging { size: args.size.unwrap_or((1, 1)).into(), ..Staging::default() };
    for (spec, (reference, own)) in scenes.iter().zip(&references) {
        let mut scene = staging::load(spec, &staging)?;
        scene.viewpoint = args.size.map(|(width, height)| Viewpoint { camera: 0, size: [width, height] });
        for warning in &scene.warnings {
            eprintln!("warning: {spec}: {warning}");
        }
        bench(args, &scene, spec, &variants, &reference_maker, (reference, *own), &mut report)
            .with_context(|| spec.clone())?;
        report.write(&args.output)?;
    }
    if !args.quiet {
        eprintln!("{}", args.output.join(FILES[0]).display());
    }
    Ok(())
}

/// Measures all contenders on one scene and adds the results to the report.
fn bench(
    args: &BenchArgs,
    scene: &Scene,
    spec: &str,
    variants: &[Variant],
    reference_maker: &ReferenceMaker,
    (reference, own): (&str, Option<f64>),
    report: &mut Report,
) -> Result<()> {
    let film_size = args.size.or(scene.cameras[0].film_size);
    let sized = |settings: &Settings| {
        let (width, height) = film_size.unwrap_or((settings.width, settings.height));
        // Other programs count every vertex.
        let (bounces, specular_bounces, seed) = (args.bounces, 0, args.seed);
        Settings { width, height, bounces, specular_bounces, seed, ..settings.clone() }
    };
    let settings = sized(&Settings::default());
    let truth = match reference {
        "auto" => reference_maker.truth(args, scene, spec, &settings)?,
        file => Truth::from_file(Path::new(file), own)?,
    };
    check_reference_size(&truth, reference, &settings)?;
    warn_about_variants(scene, spec, variants)?;

    let bar = bar(args, "{prefix}: starting {msg}");
    bar.set_prefix(spec.to_owned());
    let devices = open_devices(variants)?;
    let mut entries = Vec::new();
    for (variant, (gpu, opening)) in variants.iter().zip(&devices) {
        bar.set_message(variant.name.clone());
        let began = Instant::now();
        let contender = ours(gpu.as_ref(), scene, &sized(&variant.settings))?;
        let mut entry = Entry::new(variant.name.clone(), contender, began)?;
        entry.startup += opening;
        entries.push(entry);
    }
    let (peers, refusals) = start_peers(args, spec, &settings, &bar);
    entries.extend(peers);
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

/// Checks that the reference has the size of the pictures.
fn check_reference_size(truth: &Truth, reference: &str, settings: &Settings) -> Result<()> {
    let Film { width, height, .. } = truth.film;
    if (width, height) != (settings.width, settings.height) {
        bail!(
            "the reference {reference} is {width}x{height}, but the pictures are {}x{}; give --size {width}x{height}",
            settings.width,
            settings.height
        );
    }
    Ok(())
}

/// Prints the warnings that the scene has with the settings of the variants only, each once.
fn warn_about_variants(scene: &Scene, spec: &str, variants: &[Variant]) -> Result<()> {
    let mut warned = scene.warnings.clone();
    for variant in variants {
        for warning in &adapted(scene, &variant.settings)?.warnings {
            if !warned.contains(warning) {
                eprintln!("warning: {spec}: {}: {warning}", variant.name);
                warned.push(warning.clone());
            }
        }
    }
    Ok(())
}

/// Opens a separate device for each variant, which keeps the times of its passes separate. Returns the
/// devices and the seconds that opening took.
fn open_devices(variants: &[Variant]) -> Result<Vec<(Option<Gpu>, f64)>> {
    let mut devices = Vec::new();
    for variant in variants {
        let began = Instant::now();
        devices.push((device(variant.settings.technique)?, began.elapsed().as_secs_f64()));
    }
    Ok(devices)
}

/// Starts the other programs. Returns their entries, and name and reason of each program that refuses the
/// scene.
fn start_peers(
    args: &BenchArgs,
    spec: &str,
    settings: &Settings,
    bar: &ProgressBar,
) -> (Vec<Entry<'static>>, Vec<(String, String)>) {
    let (mut entries, mut refusals) = (Vec::new(), Vec::new());
    let patience = Duration::from_secs_f64(20.0 * args.budget + 120.0);
    for peer in &args.peers {
        bar.set_message(peer.name.clone());
        let began = Instant::now();
        let started = Peer::start(peer, spec, settings, &args.output, patience)
            .and_then(|p| Entry::new(peer.name.clone(), Box::new(p) as Box<dyn Contender>, began));
        match started {
            Ok(entry) => entries.push(entry),
            Err(e) => {
                eprintln!("warning: {spec}: {e}");
                refusals.push((peer.name.clone(), e.to_string()));
            }
        }
    }
    (entries, refusals)
}

/// Renderer of reference images.
struct ReferenceMaker {
    technique: Technique,
    gpu: Option<Gpu>,
    cache: PathBuf,
    seconds: f64,
}

impl ReferenceMaker {
    fn new(args: &BenchArgs) -> Result<Self> {
        let (method, gpu) = match args.reference_method {
            None if args.reference.iter().all(|r| r != "auto") => (Technique::REFERENCE, None),
            None => truth::best_method(),
            Some(method) => (method, device(method)?),
        };
        let cache = args.cache.clone().unwrap_or_else(truth::default_cache);
        let seconds = args.reference_budget.unwrap_or(10.0 * args.budget);
        Ok(Self { technique: method, gpu, cache, seconds })
    }

    /// Returns the stored reference of a scene, or renders it.
    fn truth(&self, args: &BenchArgs, scene: &Scene, spec: &str, settings: &Settings) -> Result<Truth> {
        let settings = Settings { technique: self.technique, seed: Settings::default().seed, ..settings.clone() };
        settings.check()?;
        let bar = bar(args, "{prefix}: {bar:40} {percent} % of the reference, {elapsed}");
        bar.set_prefix(spec.to_owned());
        let progress = |done: f64| bar.set_position((1000.0 * done) as u64);
        let truth = Truth::cached(self.gpu.as_ref(), scene, &settings, self.seconds, &self.cache, &progress)?;
        bar.finish_and_clear();
        Ok(truth)
    }
}

/// Checks the arguments before anything is loaded.
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
        bail!("{scene}: peer {} reads Mitsuba .xml scenes only; omit the scene or the peer", peer.name);
    }
    if let ([], [peer, ..]) = (args.scenes.as_slice(), args.peers.as_slice()) {
        bail!("peer {} reads Mitsuba .xml scenes only; name some", peer.name);
    }
    Ok(())
}

/// Returns the reference of each scene with its known error.
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

/// Returns our methods to measure with their settings.
fn variants(args: &BenchArgs) -> Result<Vec<Variant>> {
    let plain = |&technique: &Technique| Variant {
        name: technique.to_string(),
        settings: Settings { technique, bounces: args.bounces, ..Settings::default() },
    };
    let mut variants: Vec<Variant> = match args.methods.as_slice() {
        [] if args.variants.is_empty() => default_methods()?.iter().map(plain).collect(),
        methods => methods.iter().map(plain).collect(),
    };
    for text in &args.variants {
        let Some((name, options)) = text.split_once('=') else {
            bail!("--variant {text}: has to be NAME=OPTIONS, such as `fast=--method shared --visibility fast`");
        };
        let options = Options::try_parse_from(shlex::Shlex::new(options));
        let mut settings = options.with_context(|| format!("--variant {name}"))?.settings;
        let Settings { samples, budget, bounces, seed, aperture, focus, .. } = Settings::default();
        let ours =
            (settings.samples, settings.budget, settings.bounces, settings.seed, settings.aperture, settings.focus);
        if ours != (samples, budget, bounces, seed, aperture, focus) {
            bail!(
                "--variant {name}: samples, budget, bounces, seed and lens are the same for all methods; see the options of bench"
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
        bail!("{}: there are two methods of that name; rename one by --variant or --peer", twice.1);
    }
    Ok(variants)
}

/// Returns all methods that this device supports.
fn default_methods() -> Result<Vec<Technique>> {
    match Gpu::with_ray_queries() {
        Ok(_) => Ok(vec![Technique::RASTER, Technique::TWIN, Technique::RAY_QUERY, Technique::PATH]),
        Err(GpuError::NoRayQueries { adapter, .. }) => {
            eprintln!("warning: {adapter} has no ray queries; only raster and the CPU reference are measured");
            Ok(vec![Technique::RASTER, Technique::REFERENCE])
        }
        Err(e) => Err(e.into()),
    }
}

/// Creates a progress bar of a thousand steps, which is visible on a terminal only.
fn bar(args: &BenchArgs, template: &str) -> ProgressBar {
    if args.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}
