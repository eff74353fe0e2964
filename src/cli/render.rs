//! Command `render`: renders a scene to image files until a number of samples, an error or a time is reached.

use std::cell::{OnceCell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

use crate::crop::Crop;
use crate::film::exr::{Picture, Window};
use crate::film::record::{Record, SampleRange};
use crate::film::residual::Residual;
use crate::film::{Film, has_extension};
use crate::gpu::{Gpu, GpuError, PassTime};
use crate::reference::aov::Aovs;
use crate::render::convergence::Convergence;
use crate::render::fingerprint;
use crate::render::renderer::ViewRequests;
use crate::render::{self, RenderError, RenderStats, Renderer};
use crate::scene::{Geometry, Scene};
use crate::settings::{DEFAULT_BUDGET, DEFAULT_TARGET_ERROR, Method, OnlyStrategy, SAMPLES, Settings, UNLIMITED};
use crate::tonemap::{Exposure, Grade, Tonemap, auto_exposure};

use super::aov::{LayerArgs, SplitLight};
use super::checkpoint::{self, Identity, Saved};
use super::interrupt::{self, Interrupt};
use super::light_groups::{self, GroupFilm};
use super::output;
use super::preview::{self, Preview};
use super::progress::{Progress, Reporter};
use super::reference_renderer::ReferenceRenderer;
use super::view::{self, ANIMATION, GradeArgs, Turn, View, ViewArgs};

/// Stands for the camera in names of files.
const CAMERA: &str = "{camera}";

/// Seconds between two checkpoints.
const CHECKPOINTS: RangeInclusive<f64> = 1.0..=604_800.0;

/// Seconds after which a render is saved in memory, so that it can go on if the device is lost.
const SAVE_SECONDS: f64 = 30.0;

/// Times that a device may be lost without further samples.
const MAX_LOSSES: u32 = 3;

#[derive(Clone, clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub view: ViewArgs,
    /// Image file: .exr (linear 32-bit float) or .png (8-bit sRGB after --exposure and --tonemap). May be
    /// given once for each format
    #[arg(short, long, value_name = "OUT.exr|.png", required = true)]
    output: Vec<PathBuf>,
    #[command(flatten)]
    grade: GradeArgs,
    #[command(flatten)]
    layers: LayerArgs,
    /// Render the part of the image whose upper left pixel is X,Y and which has W x H pixels. They are those of
    /// the whole image; the .exr says where they lie in it. Filtered pictures of shared and ReSTIR take the time
    /// of the whole image
    #[arg(long, value_name = "X,Y,W,H")]
    pub crop: Option<Crop>,
    /// Render N views on a circle around the scene, or around --target, each to a separate file: OUT.exr becomes
    /// OUT_0000.exr and so on, as does the file of --stats. The first one is that of the camera, and the camera
    /// goes counter-clockwise seen from above
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=9999), conflicts_with_all = ["frames", "checkpoint", "resume", "strategy_images"], help_heading = ANIMATION)]
    turntable: Option<u32>,
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
    /// Write the picture so far and a checkpoint, OUT.checkpoint, every this many seconds, 1 to 604800, and when
    /// the render is interrupted. --resume goes on from it. The checkpoint is removed when the render has ended
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, conflicts_with_all = ["frames", "strategy_images"])]
    checkpoint: Option<f64>,
    /// Go on from a checkpoint of the same scene, settings and version, bit for bit as if the render had never
    /// stopped. --samples, --budget and the output may differ
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "strategy_images"])]
    resume: Option<PathBuf>,
    /// Render frames A to B, including B, at --fps, each to a separate file: OUT.exr becomes OUT_0000.exr and
    /// so on, as does the file of --stats
    #[arg(long, value_name = "A..B", value_parser = parse_frames, requires = "fps", conflicts_with_all = ["at", "strategy_images"], help_heading = ANIMATION)]
    frames: Option<(u32, u32)>,
    /// Leave out frames and views whose files are complete: of the same scene, settings, layers and version, with all
    /// samples. Needs --samples and an .exr. So an animation that was cut off goes on
    #[arg(long, help_heading = ANIMATION)]
    skip_existing: bool,
    /// Frames per second, 0.001 to 10000. Frame N is at N / FPS seconds
    #[arg(long, value_name = "N", allow_negative_numbers = true, requires = "frames", help_heading = ANIMATION)]
    fps: Option<f64>,
    /// Render samples A to B of the sequence, including B, counted from 1. `lightsheaf merge` joins such parts
    /// to the picture of all of them. Excludes --samples, --budget and --target-error
    #[arg(long, value_name = "A..B", value_parser = SampleRange::parse, conflicts_with_all = ["samples", "budget", "target_error", "strategy_images"])]
    pub sample_range: Option<SampleRange>,
    /// Print progress and the end of each picture to stdout as lines of JSON, for programs, in place of the bar
    #[arg(long)]
    json_progress: bool,
    /// Send the picture to a viewer once a second while it is rendered, by the protocol of tev (port 14158), which
    /// HDRView speaks, too. Without a viewer the render goes on
    #[arg(long, value_name = "HOST:PORT", value_parser = preview::parse_address)]
    preview: Option<String>,
    /// Print neither progress nor the closing line. Warnings and errors are still printed
    #[arg(short, long)]
    quiet: bool,
}

impl RenderArgs {
    /// True if an output file is a .png.
    fn writes_png(&self) -> bool {
        self.output.iter().any(|path| has_extension(path, "png"))
    }

    /// True if the picture keeps its layers: in an .exr, or for the program that asks for it.
    fn keeps_layers(&self) -> bool {
        self.output.is_empty() || self.output.iter().any(|path| has_extension(path, "exr"))
    }

    /// Returns the name of the picture in a viewer.
    fn shown_name(&self) -> String {
        let name = self.output.first().and_then(|path| path.file_name());
        name.map_or_else(|| self.view.scene.clone(), |name| name.to_string_lossy().into_owned())
    }

    /// Returns the arguments of each camera's picture, whose word on the command line replaces `{camera}` in the
    /// names of files.
    fn by_camera(&self) -> Result<Vec<Self>> {
        let files = || self.output.iter().chain(&self.stats);
        let names_camera = |path: &&PathBuf| path.to_string_lossy().contains(CAMERA);
        let cameras = &self.view.camera;
        if cameras.is_empty()
            && let Some(path) = files().find(names_camera)
        {
            bail!("{}: which camera? Give --camera, or leave {CAMERA} out of the name", path.display());
        }
        if cameras.len() < 2 {
            return Ok(vec![self.of_camera(cameras.first().map_or("", String::as_str))]);
        }
        if let Some(path) = files().find(|path| !names_camera(path)) {
            bail!("{}: has to have {CAMERA} in its name, since each camera has a file", path.display());
        }
        for (option, given) in [
            ("--resume", self.resume.is_some()),
            ("--strategy-images", self.strategy_images.is_some()),
            ("--eye", self.view.eye.is_some()),
        ] {
            if given {
                bail!("{option}: is for one camera, and there are {}", cameras.len());
            }
        }
        let all: Vec<Self> = cameras.iter().map(|camera| self.of_camera(camera)).collect();
        let outputs: BTreeSet<_> = all.iter().map(|args| args.output.first()).collect();
        if outputs.len() < all.len() {
            bail!("--camera: two are called alike; give each once");
        }
        Ok(all)
    }

    /// Returns the arguments of one camera's picture.
    fn of_camera(&self, camera: &str) -> Self {
        // A name may have characters that file names cannot have.
        let word: String =
            camera.chars().map(|c| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '_' }).collect();
        let named = |path: &PathBuf| PathBuf::from(path.to_string_lossy().replace(CAMERA, &word));
        let mut args = self.clone();
        if !camera.is_empty() {
            args.view.camera = vec![camera.to_owned()];
            args.output = self.output.iter().map(named).collect();
            args.stats = self.stats.as_ref().map(named);
        }
        args
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
    /// Device time and number of runs of each pass, in all frames and cameras so far.
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
    /// Frame, with `--frames` and `--turntable`.
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

/// Frame of an animation, or view of a turntable.
#[derive(Clone, Copy, serde::Serialize)]
struct Frame {
    number: u32,
    /// Time since the beginning of the animation in seconds.
    seconds: f64,
    /// Angle of a turntable in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    degrees: Option<f64>,
}

/// Renders the scene and writes the requested files.
pub fn run(args: &RenderArgs) -> Result<ExitCode> {
    let interrupt = Interrupt::install(args.quiet)?;
    render(args, &interrupt)?;
    Ok(if interrupt.requested() { ExitCode::from(interrupt::EXIT_CODE) } else { ExitCode::SUCCESS })
}

/// Renders a single picture, writes its files if there are any, and returns it.
pub fn picture(args: &RenderArgs, interrupt: &Interrupt) -> Result<Picture> {
    let several = [
        ("--frames", args.frames.is_some()),
        ("--turntable", args.turntable.is_some()),
        ("--camera", args.view.camera.len() > 1),
    ];
    if let Some((option, _)) = several.iter().find(|(_, given)| *given) {
        bail!("{option}: asks for several pictures; render one at a time");
    }
    check_outputs(args)?;
    let picture = render_camera(args, interrupt, &RefCell::default())?;
    picture.context("no picture was rendered")
}

fn render(args: &RenderArgs, interrupt: &Interrupt) -> Result<()> {
    let cameras = args.by_camera()?;
    cameras.iter().try_for_each(check_outputs)?;
    let device = RefCell::default();
    for (n, args) in cameras.iter().enumerate() {
        if n == 0 || !interrupt.requested() {
            render_camera(args, interrupt, &device)?;
        }
    }
    Ok(())
}

/// Renders the pictures of one camera, and returns the last one. The device is opened if there is none, and kept.
fn render_camera(args: &RenderArgs, interrupt: &Interrupt, device: &RefCell<Option<Gpu>>) -> Result<Option<Picture>> {
    let (grade, frames) = (OnceCell::new(), frames(args)?);
    let preview = RefCell::new(args.preview.as_ref().map(|address| Preview::connect(address, args.shown_name())));
    let preview = &preview;
    let began = Instant::now();
    if frames.is_empty() {
        let View { scene, mut settings, animations } = args.view.load()?;
        if let Some(folder) = &args.strategy_images {
            check_strategy_images(folder, &settings)?;
            // Weighted strategy images sum to the unfiltered picture.
            settings.interleave.get_or_insert(1);
        }
        let load = began.elapsed().as_secs_f64();
        let (scene, settings, animations) = (&scene, &settings, &animations);
        let (grade, kept) = (&grade, &Kept::default());
        return go_on_after_losses(&|| kept.saved.borrow().as_ref().map_or(0, |saved| saved.samples), &mut || {
            let began = Instant::now();
            let gpu = device.take().map_or_else(|| open(args), |gpu| Ok(Some(gpu)))?;
            let job = Job {
                args,
                interrupt,
                grade,
                preview,
                load,
                began,
                scene,
                before: None,
                settings,
                animations,
                frame: None,
                all: 1,
                kept,
            };
            let picture = job.run(gpu.as_ref(), &mut Renderers::default())?;
            device.replace(gpu);
            Ok(Some(picture))
        });
    }
    let (loaded, mut settings) = args.view.open()?;
    if args.skip_existing {
        check_skipping(args, &settings)?;
    }
    let animations = view::animations(&loaded);
    let loaded = if args.turntable.is_some() { args.view.pose(loaded)? } else { loaded };
    let about = args.turntable.map(|_| args.view.target.unwrap_or_else(|| centre(&loaded)));
    let complete = |frame: Frame, settings: &mut Settings| {
        let turn = about.zip(frame.degrees).map(|(about, degrees)| Turn { about, degrees });
        let posed = match turn {
            Some(_) => loaded.clone(),
            None => args.view.at("--frames", &loaded, frame.seconds)?,
        };
        args.view.complete(posed, settings, turn)
    };
    // The first frame is loaded before the device is opened, so that its warnings come first. The setup time
    // of the first frame includes that of the device.
    let first = complete(frames[0], &mut settings)?;
    view::warn(&first);
    let mut load = began.elapsed().as_secs_f64();
    let mut began = Instant::now();
    let gpu = device.take().map_or_else(|| open(args), |gpu| Ok(Some(gpu)))?;
    let (mut renderers, mut scene, mut before, all) = (Renderers::default(), first, None, frames.len());
    let mut last = None;
    for (n, &frame) in frames.iter().enumerate() {
        if n > 0 && interrupt.requested() {
            break;
        }
        if n > 0 {
            let posing = Instant::now();
            before = Some(std::mem::replace(&mut scene, complete(frame, &mut settings)?));
            load = posing.elapsed().as_secs_f64();
            began = Instant::now();
        }
        let (scene, before, settings, animations) = (&scene, before.as_ref(), &settings, &animations);
        let (grade, kept, frame) = (&grade, &Kept::default(), Some(frame));
        let job =
            Job { args, interrupt, grade, preview, load, began, scene, before, settings, animations, frame, all, kept };
        if !(args.skip_existing && job.skip()) {
            last = Some(job.run(gpu.as_ref(), &mut renderers)?);
        }
    }
    drop(renderers);
    device.replace(gpu);
    Ok(last)
}

/// Returns the centre of a scene.
fn centre(scene: &Scene) -> glam::Vec3 {
    let [low, high] = Geometry::new(scene).bounds;
    0.5 * (low + high)
}

/// Renders, and opens the device again as often as it is lost after further samples. `samples` returns the
/// samples that are kept.
fn go_on_after_losses<T>(samples: &dyn Fn() -> u64, attempt: &mut dyn FnMut() -> Result<T>) -> Result<T> {
    let mut losses = (0, 0);
    loop {
        let error = match attempt() {
            Err(error) => error,
            done => return done,
        };
        let lost = matches!(error.downcast_ref(), Some(RenderError::Gpu(GpuError::Lost(_))));
        let kept = samples();
        losses = if kept > losses.0 { (kept, 1) } else { (losses.0, losses.1 + 1) };
        if !lost || losses.1 > MAX_LOSSES {
            return Err(error);
        }
        eprintln!("warning: the graphics device was lost; it is opened again, and {kept} samples are kept");
    }
}

/// Returns the name of the device of a render.
fn device_name(gpu: Option<&Gpu>) -> String {
    let cpu = || format!("CPU, {} threads", rayon::current_num_threads());
    gpu.map_or_else(cpu, |gpu| gpu.capabilities.adapter.clone())
}

/// Opens the device of a method; the reference needs none.
fn open(args: &RenderArgs) -> Result<Option<Gpu>> {
    if args.view.settings.method() == Method::Reference {
        return Ok(None);
    }
    let gpu = super::open(args.view.settings.technique)?;
    gpu.non_finite.watch(&gpu, args.check_values);
    gpu.timings.measure(args.stats.is_some());
    if let Some(folder) = &args.dump_shaders {
        gpu.dump_shaders(folder).with_context(|| format!("--dump-shaders {}", folder.display()))?;
    }
    Ok(Some(gpu))
}

/// Returns the frames to render; empty for a single picture.
fn frames(args: &RenderArgs) -> Result<Vec<Frame>> {
    if let Some(views) = args.turntable {
        let seconds = args.view.at.unwrap_or_default();
        let degrees = |number| Some(360.0 * f64::from(number) / f64::from(views));
        return Ok((0..views).map(|number| Frame { number, seconds, degrees: degrees(number) }).collect());
    }
    let (Some((first, last)), Some(fps)) = (args.frames, args.fps) else { return Ok(Vec::new()) };
    if !(1e-3..=1e4).contains(&fps) {
        bail!("--fps {fps}: has to be 0.001 to 10000 frames a second");
    }
    Ok((first..=last).map(|number| Frame { number, seconds: f64::from(number) / fps, degrees: None }).collect())
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
    if args.skip_existing && args.frames.is_none() && args.turntable.is_none() {
        bail!(
            "--skip-existing: is for --frames and --turntable; a single picture goes on by --checkpoint and --resume"
        );
    }
    args.layers.check(args.keeps_layers(), args.writes_png())?;
    if args.layers.renders_light() && args.view.settings.history > 0 {
        bail!("layers of light: frames with --history hold a part of those before; leave it out");
    }
    if let Some(seconds) = args.checkpoint {
        if !CHECKPOINTS.contains(&seconds) {
            bail!("--checkpoint {seconds}: has to be {} to {} seconds", CHECKPOINTS.start(), CHECKPOINTS.end());
        }
        let Some(output) = args.output.first() else {
            bail!("--checkpoint: the checkpoint lies beside the picture; give --output")
        };
        output::check(&checkpoint::path_of(output), &["checkpoint"])?;
    }
    if let Some(range) = args.sample_range.filter(|range| range.last > (*SAMPLES.end()).into()) {
        bail!("--sample-range {range}: the last sample has to be {} at most", SAMPLES.end());
    }
    let GradeArgs { exposure, tonemap } = &args.grade;
    for (option, given) in [("--exposure", exposure.is_some()), ("--tonemap", tonemap.is_some())] {
        if given && !args.writes_png() {
            bail!("{option}: {} holds linear radiance; write a .png, or omit the option", args.shown_name());
        }
    }
    Ok(())
}

/// Checks that files tell which frames are complete.
fn check_skipping(args: &RenderArgs, settings: &Settings) -> Result<()> {
    if !args.output.iter().any(|path| has_extension(path, "exr")) {
        bail!("--skip-existing: only an .exr says how it was made; give one by -o");
    }
    if settings.target_error.is_some() || settings.budget.is_some() {
        bail!("--skip-existing: files do not say whether they reached an error or a time; give --samples");
    }
    if settings.history > 0 {
        bail!("--skip-existing: frames with --history depend on those before; leave one of the two out");
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
    preview: &'a RefCell<Option<Preview>>,
    /// Seconds that loading took.
    load: f64,
    /// Start of the setup.
    began: Instant,
    scene: &'a Scene,
    /// The scene in the frame before, if there is one.
    before: Option<&'a Scene>,
    settings: &'a Settings,
    animations: &'a [String],
    /// Frame of the animation, with `--frames`.
    frame: Option<Frame>,
    /// Number of frames.
    all: usize,
    kept: &'a Kept,
}

/// What a picture has made that outlives a lost device.
#[derive(Default)]
struct Kept {
    /// The render as it was last saved, from which it goes on.
    saved: RefCell<Option<Saved>>,
    scene_hash: OnceCell<String>,
    aovs: OnceCell<Option<Aovs>>,
    light: RefCell<Option<SplitLight>>,
    /// What the filter took away from a picture that may be merged with others.
    residual: RefCell<Option<Residual>>,
    groups: RefCell<Vec<GroupFilm>>,
}

/// The renderers of the pictures of an animation.
#[derive(Default)]
struct Renderers<'gpu> {
    picture: Option<Box<dyn Renderer + 'gpu>>,
    /// Renders light that is scattered at most once, if layers need it.
    light: Option<Box<dyn Renderer + 'gpu>>,
}

impl Job<'_> {
    /// Renders and writes the picture; without a device, by the reference. The renderers are reused from frame to
    /// frame.
    fn run<'gpu>(&self, gpu: Option<&'gpu Gpu>, renderers: &mut Renderers<'gpu>) -> Result<Picture> {
        light_groups::check(self.scene, &self.args.layers.light_groups)?;
        let Some(gpu) = gpu else { return self.reference() };
        let renderer = self.posed(gpu, &mut renderers.picture, self.settings)?;
        if self.frame.is_some() && self.args.layers.renders_light() && renderer.is_denoised() {
            bail!("layers of light: filtered frames hold a part of those before; give --interleave 1");
        }
        let (film, stats, reporter) = self.progressive(Some(gpu), renderer.as_mut())?;
        let (requests, plan) = (renderer.stats().requests, Some(renderer.plan_json()));
        let stats = Stats { requests, plan, ..stats };
        if self.args.sample_range.is_some() || stats.ended_by == Ending::Interrupt {
            *self.kept.residual.borrow_mut() = renderer.residual()?;
        }
        let (samples, end) = (stats.samples, renderer.samples());
        let range = end - samples..end;
        if self.args.layers.splits_light() {
            let settings = renderer.aligned(SplitLight::settings(self.settings));
            let light = self.posed(gpu, &mut renderers.light, &settings)?;
            self.split_light(&range, light.as_mut())?;
        }
        let settings = renderer.aligned(Settings { target_error: None, budget: None, ..self.settings.clone() });
        self.light_groups(&|scene| {
            let mut renderer = render::open(gpu, scene, &settings)?;
            Ok(self.render_samples(&range, renderer.as_mut())?)
        })?;
        let picture = self.finish(&film, stats, reporter)?;
        self.strategy_images(&mut |only| {
            renderer.set_only(Some(only))?;
            renderer.render(samples, &mut |_| !self.interrupt.requested())?;
            renderer.film()
        })?;
        Ok(picture)
    }

    /// Keeps the files of the picture if they are complete, and takes the exposure over. False if they are not.
    fn skip(&self) -> bool {
        let files = self.files();
        let stats = self.args.stats.iter().map(|path| self.named(path));
        if !files.iter().cloned().chain(stats).all(|path| path.exists()) {
            return false;
        }
        let picture = files.iter().find(|path| has_extension(path, "exr")).and_then(|path| Picture::load(path).ok());
        let Some(picture) = picture.filter(|picture| self.is_complete(picture)) else { return false };
        let (exposure, tonemap) = self.args.grade.chosen();
        self.grade.get_or_init(|| Grade { stops: exposure.stops(&picture.film), tonemap });
        if !self.args.quiet {
            eprintln!("{}: complete, and kept", shown_paths(&files));
        }
        self.reporter().end("existing", picture.record.map_or(0, |record| record.samples), 0.0);
        true
    }

    /// True if a picture is the one that this render would write.
    fn is_complete(&self, picture: &Picture) -> bool {
        let Some(record) = &picture.record else { return false };
        let all = u64::from(self.settings.samples);
        let range = self.args.sample_range.unwrap_or(SampleRange { first: 1, last: all });
        record.version == env!("CARGO_PKG_VERSION")
            && record.ranges == [range]
            && fingerprint::is_text_of(&record.settings, self.settings)
            && self.args.layers.are_in(picture)
            && record.scene_hash == self.scene_hash()
    }

    /// Returns the renderer of another frame in this pose, or opens one.
    fn posed<'r, 'gpu>(
        &self,
        gpu: &'gpu Gpu,
        renderer: &'r mut Option<Box<dyn Renderer + 'gpu>>,
        settings: &Settings,
    ) -> Result<&'r mut Box<dyn Renderer + 'gpu>, RenderError> {
        if let Some(renderer) = renderer {
            renderer.pose(self.scene)?;
        }
        match renderer {
            Some(renderer) => Ok(renderer),
            None => Ok(renderer.insert(render::open(gpu, self.scene, settings)?)),
        }
    }

    /// Renders the parts of the light with the samples of the picture, which are numbered from 0. A signal leaves them
    /// out.
    fn split_light(&self, samples: &Range<u64>, renderer: &mut dyn Renderer) -> Result<(), RenderError> {
        let bar = self.reporter();
        bar.count("direct light", 0, 1);
        let light = SplitLight::new(self.settings.technique, &mut |only| {
            renderer.set_only(only)?;
            self.render_samples(samples, renderer)
        })?;
        if light.is_none() {
            eprintln!("note: the layers emission, direct and indirect are left out, since they were interrupted");
        }
        *self.kept.light.borrow_mut() = light;
        Ok(())
    }

    /// Renders the light groups with the samples of the picture. A signal leaves them out.
    fn light_groups(&self, render: &dyn Fn(&Scene) -> Result<Option<Film>>) -> Result<()> {
        let wanted = &self.args.layers.light_groups;
        if wanted.is_empty() {
            return Ok(());
        }
        let (mut bar, mut done) = (self.reporter(), 0);
        let groups = light_groups::render(self.scene, wanted, &mut |scene| {
            bar.count("light groups", done, wanted.len() as u64 + 1);
            done += 1;
            render(scene)
        })?;
        bar.clear(None);
        if groups.is_none() {
            eprintln!("note: the layers of light groups are left out, since they were interrupted");
        }
        *self.kept.groups.borrow_mut() = groups.unwrap_or_default();
        Ok(())
    }

    /// Renders samples of the sequence; none if a signal ends the render before.
    fn render_samples(&self, samples: &Range<u64>, renderer: &mut dyn Renderer) -> Result<Option<Film>, RenderError> {
        if samples.start > 0 {
            renderer.begin_at(samples.start)?;
        }
        renderer.render(samples.end - samples.start, &mut |_| !self.interrupt.requested())?;
        if renderer.samples() < samples.end { Ok(None) } else { renderer.film().map(Some) }
    }

    /// Writes the image of each strategy of the method, with as many samples as the picture. A signal ends
    /// the series.
    fn strategy_images(&self, render: &mut dyn FnMut(OnlyStrategy) -> Result<Film, RenderError>) -> Result<()> {
        let Some(folder) = &self.args.strategy_images else { return Ok(()) };
        let all = [true, false].into_iter().flat_map(|weighted| OnlyStrategy::all(self.settings.bounces, weighted));
        let all: Vec<_> = all.filter(|only| self.settings.technique.has_strategy(only.s, only.t)).collect();
        let mut bar = self.reporter();
        for (n, only) in (0..).zip(&all) {
            if self.interrupt.requested() {
                break;
            }
            bar.count(&only.name(), n, all.len() as u64);
            let film = render(*only)?;
            if !self.interrupt.requested() {
                film.save(folder.join(only.name()).with_extension("exr"))?;
            }
        }
        bar.clear(None);
        Ok(())
    }

    /// Renders until the number of samples, the target error or the end of the budget is reached, or until a
    /// signal.
    fn progressive(&self, gpu: Option<&Gpu>, renderer: &mut dyn Renderer) -> Result<(Film, Stats<'_>, Reporter)> {
        if let Some(range) = self.args.sample_range {
            renderer.begin_at(range.first - 1)?;
        }
        let setup = self.began.elapsed().as_secs_f64();
        self.interrupt.begin();
        let keeper = Keeper::new(self, gpu);
        let saved = self.saved_before(&keeper)?;
        let mut progress = ProgressiveRender::new(self, renderer, keeper, saved)?;
        let (film, ended_by) = loop {
            let ended = progress.render_to_checkpoint()?;
            let film = progress.renderer.film()?;
            if let Some(ending) = progress.ending(&film, ended)? {
                break (film, ending);
            }
        };
        let non_finite_after = gpu.map_or(Ok(Vec::new()), |gpu| gpu.non_finite.counts(gpu))?;
        progress.reporter.clear(progress.convergence.as_ref().and_then(Convergence::error));
        self.preview.borrow_mut().iter_mut().for_each(|preview| preview.show(&film));
        let render = progress.seconds();
        if ended_by == Ending::Budget
            && let Some(seconds) = progress.clock.as_ref().and_then(Clock::slow_start)
        {
            eprintln!(
                "note: {seconds:.0} s of the budget went into the first sample; where a driver compiled shaders in it, which it \
                 keeps, the same command gets further now"
            );
        }
        progress.close(ended_by)?;
        let region = self.settings.region();
        let all = progress.samples * u64::from(region.width) * u64::from(region.height);
        let RenderStats { bytes, scene_bytes, tracer_bytes, non_finite, lost_nodes, redone, passes, .. } =
            progress.renderer.stats();
        let stats = Stats {
            device: device_name(gpu),
            // A filtered frame continues the samples of the one before, which are not its own.
            samples: progress.samples,
            ended_by,
            estimated_error: progress.target.and(progress.convergence.as_ref()).and_then(Convergence::error),
            taken: progress.target.map(|_| progress.taken as f64 / all.max(1) as f64),
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
        Ok((film, stats, progress.reporter))
    }

    /// Returns the factor by which radiance is multiplied before its error is estimated. By default dark
    /// pictures are brightened as for the display, since the 0.01 in rel_mse hides the noise of radiances far
    /// below 0.1.
    fn error_scale(&self, film: &Film) -> f32 {
        let Settings { target_error, budget, .. } = *self.settings;
        let by_default = (target_error, budget) == (Some(DEFAULT_TARGET_ERROR), Some(DEFAULT_BUDGET));
        if by_default { auto_exposure(film).max(0.0).exp2() } else { 1.0 }
    }

    /// Renders by the reference and writes the picture.
    fn reference(&self) -> Result<Picture> {
        let mut renderer = ReferenceRenderer::new(self.scene, self.settings);
        let (film, stats, reporter) = self.progressive(None, &mut renderer)?;
        let stats = Stats { rays: renderer.rounds.rays, ..stats };
        let end = renderer.samples();
        let samples = end - stats.samples..end;
        if self.args.layers.splits_light() {
            self.split_light(&samples, &mut renderer.of_direct_light())?;
        }
        self.light_groups(&|scene| {
            Ok(self.render_samples(&samples, &mut ReferenceRenderer::new(scene, self.settings))?)
        })?;
        self.finish(&film, stats, reporter)
    }

    /// Returns the statistics that are known before the render.
    fn empty_stats(&self) -> Stats<'_> {
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: &self.scene.name,
            device: String::new(),
            method: self.settings.technique.to_string(),
            size: [self.settings.region().width, self.settings.region().height],
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

    /// Returns the name of a file of the frame.
    fn named(&self, path: &Path) -> PathBuf {
        self.frame.map_or_else(|| path.to_owned(), |frame| numbered(path, frame.number))
    }

    /// Returns the files of the picture.
    fn files(&self) -> Vec<PathBuf> {
        self.args.output.iter().map(|path| self.named(path)).collect()
    }

    /// Returns what shows the progress.
    fn reporter(&self) -> Reporter {
        let prefix = self.frame.map(|frame| format!("frame {}, one of {} ", frame.number, self.all));
        Reporter::new(self.args.quiet, prefix.unwrap_or_default(), self.args.json_progress.then(|| self.files()))
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

    /// Writes the image files and the statistics, prints the closing line, and returns the picture.
    fn finish(&self, film: &Film, mut stats: Stats, mut reporter: Reporter) -> Result<Picture> {
        if stats.non_finite > 0 {
            let first = stats.non_finite_after.iter().find(|(_, count)| *count > 0);
            let first = first.map(|(pass, _)| format!(", first after the pass {pass}")).unwrap_or_default();
            eprintln!(
                "warning: {} values are not finite{first}; please report the scene and the settings",
                stats.non_finite
            );
        }
        let paths = self.files();
        let (exposure, tonemap) = self.args.grade.chosen();
        let picture = self.picture(film)?;
        let grade = self.grade.get_or_init(|| Grade { stops: exposure.stops(&picture.film), tonemap });
        // Hashing a large scene takes seconds, and only an .exr holds the record.
        let record = paths
            .iter()
            .any(|path| has_extension(path, "exr"))
            .then(|| self.record(stats.plan.as_ref(), stats.samples, stats.seconds.render, stats.device.clone()));
        let picture = Picture { record, ..picture };
        for path in &paths {
            save(path, &picture, grade)?;
        }
        if self.args.writes_png() {
            (stats.exposure_stops, stats.tonemap) = (Some(grade.stops), Some(grade.tonemap));
        }
        if let Some(path) = &self.args.stats {
            output::write(&self.named(path), &(serde_json::to_string_pretty(&stats)? + "\n"))?;
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
                if paths.is_empty() { self.args.shown_name() } else { shown_paths(&paths) },
                film.width,
                film.height,
                self.outcome(&stats),
                stats.method,
                stats.device
            );
        }
        if stats.ended_by == Ending::Interrupt && !paths.is_empty() {
            eprintln!("{}", self.how_to_go_on(stats.samples));
        } else if self.args.checkpoint.is_some() {
            // The picture is complete. There is no checkpoint if the render ended before the first one.
            let _ = std::fs::remove_file(checkpoint::path_of(&self.args.output[0]));
        }
        reporter.end(stats.ended_by, stats.samples, stats.seconds.render);
        Ok(picture)
    }

    /// True if a viewer should see the picture as it is now.
    fn preview_is_due(&self) -> bool {
        self.preview.borrow().as_ref().is_some_and(Preview::is_due)
    }

    /// Says how an interrupted render goes on.
    fn how_to_go_on(&self, samples: u64) -> String {
        let Settings { samples: all, target_error, budget, history, .. } = *self.settings;
        let first = self.args.sample_range.map_or(1, |range| range.first);
        let has_exr = self.args.output.iter().any(|path| has_extension(path, "exr"));
        // An interrupted picture lacks the parts of the light, and would not merge with the rest.
        let parts = has_exr && history == 0 && !self.args.layers.renders_light();
        if self.args.checkpoint.is_some() {
            let path = checkpoint::path_of(&self.args.output[0]);
            format!("to go on, give the same command with --resume {}", path.display())
        } else if parts && target_error.is_none() && budget.is_none() {
            let rest = SampleRange { first: first + samples, last: first + u64::from(all) - 1 };
            format!("to go on, render --sample-range {rest} to another .exr and join the two by `lightsheaf merge`")
        } else {
            "this render cannot go on; with --checkpoint SECONDS the next one can".to_owned()
        }
    }

    /// Returns the hash of the scene.
    fn scene_hash(&self) -> &str {
        self.kept.scene_hash.get_or_init(|| fingerprint::scene_hash(self.scene))
    }

    /// Returns the picture with its layers.
    fn picture(&self, film: &Film) -> Result<Picture> {
        let aovs = self.kept.aovs.get_or_init(|| self.args.layers.trace(self.scene, self.before, self.settings));
        let (light, groups) = (self.kept.light.borrow(), self.kept.groups.borrow());
        let Settings { width, height, crop, .. } = *self.settings;
        let window = crop.map(|crop| Window { crop, size: [width, height] });
        let mut picture = self.args.layers.picture(film, self.scene, aovs.as_ref(), light.as_ref(), &groups)?;
        picture.channels.extend(self.kept.residual.borrow().iter().flat_map(Residual::channels));
        Ok(Picture { window, ..picture })
    }

    /// Returns the record of a picture.
    fn record(&self, plan: Option<&serde_json::Value>, samples: u64, seconds: f64, device: String) -> Record {
        let mut settings = fingerprint::settings_text(self.settings, plan);
        if self.settings.is_adaptive() {
            // Tiles of such a picture have different numbers of samples.
            settings.insert_str(1, "\"adaptive\":true,");
        }
        let first = self.args.sample_range.map_or(1, |range| range.first);
        Record {
            command: output::command_line(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: self.scene.name.clone(),
            scene_hash: self.scene_hash().to_owned(),
            settings_hash: fingerprint::hash_of_text(&settings),
            settings,
            samples,
            seed: self.settings.seed,
            ranges: vec![SampleRange { first, last: first + samples.max(1) - 1 }],
            device,
            seconds,
        }
    }

    /// Returns what `--resume` goes on with, or what was saved before the device was lost.
    fn saved_before(&self, keeper: &Keeper) -> Result<Option<Saved>> {
        if let Some(saved) = self.kept.saved.borrow().clone() {
            return Ok(Some(saved));
        }
        let Some(path) = &self.args.resume else { return Ok(None) };
        let saved = checkpoint::read(path, &keeper.identity(self))?;
        let shown = path.display();
        let first = self.args.sample_range.map_or(0, |range| range.first - 1);
        if saved.state.first != first {
            bail!(
                "--resume {shown}: it begins with sample {}, not {}; give its --sample-range",
                saved.state.first + 1,
                first + 1
            );
        }
        let Settings { samples, target_error, budget, .. } = *self.settings;
        if target_error.is_none() && budget.is_none() && saved.samples > samples.into() {
            bail!(
                "--resume {shown}: it has {} samples already; give --samples {} or more",
                saved.samples,
                saved.samples
            );
        }
        Ok(Some(saved))
    }
}

/// Writes a picture: .exr with its layers and its record, .png with its exposure and tone curve.
fn save(path: &Path, picture: &Picture, grade: &Grade) -> Result<()> {
    let saved = if has_extension(path, "exr") { picture.save(path) } else { picture.film.save_graded(path, grade) };
    Ok(saved?)
}

/// Keeps what a render has, in memory and in files.
struct Keeper {
    device: String,
    every: Duration,
    /// When the render was last saved.
    kept: Instant,
}

impl Keeper {
    fn new(job: &Job, gpu: Option<&Gpu>) -> Self {
        let every = Duration::from_secs_f64(job.args.checkpoint.unwrap_or(SAVE_SECONDS));
        Self { device: device_name(gpu), every, kept: Instant::now() }
    }

    /// Returns what the picture depends on.
    fn identity(&self, job: &Job) -> Identity {
        Identity::new(job.scene, job.scene_hash(), job.settings, self.device.clone())
    }

    /// True if the render has to be saved.
    fn is_due(&self) -> bool {
        self.kept.elapsed() >= self.every
    }

    /// Writes the checkpoint and the picture.
    fn write(&self, job: &Job, saved: &Saved, film: &Film, plan: &serde_json::Value) -> Result<()> {
        checkpoint::write(&checkpoint::path_of(&job.args.output[0]), &self.identity(job), saved)?;
        let record = job.record(Some(plan), saved.samples, saved.seconds, self.device.clone());
        let (exposure, tonemap) = job.args.grade.chosen();
        let picture = Picture { record: Some(record), ..job.picture(film)? };
        let grade = Grade { stops: exposure.stops(&picture.film), tonemap };
        job.args.output.iter().try_for_each(|path| save(path, &picture, &grade))
    }
}

/// State of a progressive render.
struct ProgressiveRender<'a> {
    job: &'a Job<'a>,
    renderer: &'a mut dyn Renderer,
    reporter: Reporter,
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
    /// Error at which the render ends.
    target: Option<f64>,
    /// Estimate of the error, if the render ends by it or somebody sees it.
    convergence: Option<Convergence>,
    /// Factor of the radiance in the estimate of the error, from the first picture.
    error_scale: Option<f32>,
    /// True if converged tiles take no more samples.
    adaptive: bool,
    /// Seconds of rendering before this process.
    seconds_before: f64,
    keeper: Keeper,
}

impl<'a> ProgressiveRender<'a> {
    /// Begins a render, or goes on with a saved one.
    fn new(
        job: &'a Job<'a>,
        renderer: &'a mut dyn Renderer,
        keeper: Keeper,
        saved: Option<Saved>,
    ) -> Result<Self, RenderError> {
        let Settings { samples, target_error, budget, .. } = *job.settings;
        let Crop { width, height, .. } = job.settings.region();
        let limited = target_error.is_some() || budget.is_some();
        let reporter = job.reporter();
        let estimates = target_error.is_some() || reporter.is_shown();
        let mut this = Self {
            began: Instant::now(),
            reporter,
            adaptive: renderer.is_adaptive() && job.args.strategy_images.is_none(),
            clock: budget.map(|seconds| Clock::new(seconds, saved.as_ref().map_or(0.0, |saved| saved.seconds))),
            end: u64::from(if limited { *SAMPLES.end() } else { samples }),
            target: target_error,
            convergence: estimates.then(|| Convergence::new(width, height)),
            first: renderer.samples(),
            samples: 0,
            taken: 0,
            error_scale: None,
            seconds_before: 0.0,
            keeper,
            job,
            renderer,
        };
        if let Some(saved) = saved {
            this.renderer.restore(&saved.state)?;
            (this.samples, this.taken, this.seconds_before) = (saved.samples, saved.taken, saved.seconds);
            this.error_scale = saved.error_scale;
            if let Some(saved) = saved.convergence {
                this.convergence = Some(saved);
            }
        }
        Ok(this)
    }

    /// Returns the seconds of rendering.
    fn seconds(&self) -> f64 {
        self.seconds_before + self.began.elapsed().as_secs_f64()
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
    fn close(&mut self, ended_by: Ending) -> Result<()> {
        if ended_by == Ending::Interrupt && self.job.args.checkpoint.is_some() {
            self.save()?;
        }
        Ok(())
    }

    /// Renders up to the next checkpoint of the error estimate, or to the end. Returns the reason if the
    /// budget or a signal ends the render.
    fn render_to_checkpoint(&mut self) -> Result<Option<Ending>, RenderError> {
        let convergence = self.convergence.as_ref();
        let goal = convergence.map_or(self.end, |convergence| convergence.next_checkpoint().min(self.end));
        let pixels = convergence.map_or(0, |convergence| convergence.tiles().active_pixels());
        while self.samples < goal {
            let most = goal - self.samples;
            let round = match &mut self.clock {
                Some(clock) => clock.next_round(self.samples, most),
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
                began,
                seconds_before,
                target,
                convergence,
                clock,
                end,
                ..
            } = self;
            let ends = Ends { target: *target, convergence: convergence.as_ref(), clock: clock.as_ref(), end: *end };
            renderer.render(round, &mut |all| {
                *samples = all - *first;
                reporter.show(ends.progress(*samples, *seconds_before + began.elapsed().as_secs_f64()));
                let used_up = ends.clock.is_some_and(Clock::is_used_up);
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
    fn ending(&mut self, film: &Film, ended: Option<Ending>) -> Result<Option<Ending>, RenderError> {
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
    fn progress(&self, samples: u64, seconds: f64) -> Progress {
        let estimated_error = self.convergence.and_then(Convergence::error);
        let by_samples = self.target.is_none() && self.clock.is_none();
        let for_samples = |all: f64| seconds * (all - samples as f64) / samples.max(1) as f64;
        let target = self.target.zip(self.convergence);
        let at_target = target.and_then(|(target, convergence)| convergence.samples_to(target));
        let left = [
            by_samples.then(|| for_samples(self.end as f64)),
            at_target.map(|all| for_samples(all).max(0.0)),
            self.clock.map(|clock| clock.left().as_secs_f64()),
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

/// Formats a number with two significant digits: 0.0028.
fn two_digits(value: f64) -> String {
    if !value.is_finite() || value <= 0.0 {
        return value.to_string();
    }
    let places = (1 - value.log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.places$}")
}

/// Lists files for a line of text.
fn shown_paths(paths: &[PathBuf]) -> String {
    paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// Returns the file name of a frame: `out.exr` becomes `out_0007.exr`.
fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("_{number:04}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// Divides a time budget into rounds of samples.
struct Clock {
    began: Instant,
    budget: Duration,
    /// Samples and time when the first round of this process was done. Drivers compile shaders in it, so that it
    /// tells nothing about the rounds after it.
    first: Option<(u64, Duration)>,
}

impl Clock {
    /// Begins a budget of which `used` seconds are used up.
    fn new(seconds: f64, used: f64) -> Self {
        Self { began: Instant::now(), budget: Duration::from_secs_f64((seconds - used).max(0.0)), first: None }
    }

    /// Returns the seconds of the first round if they are more than half of the budget.
    fn slow_start(&self) -> Option<f64> {
        self.first.map(|(_, time)| time).filter(|time| *time > self.budget / 2).map(|time| time.as_secs_f64())
    }

    /// True if no time is left.
    fn is_used_up(&self) -> bool {
        self.began.elapsed() >= self.budget
    }

    /// Returns the time that is left.
    fn left(&self) -> Duration {
        self.budget.saturating_sub(self.began.elapsed())
    }

    /// Returns the number of samples that fit into the remaining time at the rate since the first round, at most
    /// `most`. The first sample is always rendered, and a second one if any time is left. None if the time is used
    /// up.
    fn next_round(&mut self, done: u64, most: u64) -> Option<u64> {
        let capacity = u64::from(*SAMPLES.end()).saturating_sub(done);
        if done == 0 {
            return Some(1);
        }
        let used = self.began.elapsed();
        let left = self.budget.saturating_sub(used).as_secs_f64();
        let (first, time) = *self.first.get_or_insert((done, used));
        let fit = match done - first {
            0 => u64::from(left > 0.0),
            rendered => (left * rendered as f64 / (used - time).as_secs_f64().max(1e-9)) as u64,
        };
        Some(fit.min(most).min(capacity)).filter(|&round| round > 0)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn a_budget_deals_out_rounds_until_it_is_used() {
        let mut clock = Clock::new(1000.0, 0.0);
        assert_eq!(clock.next_round(0, 8), Some(1), "one sample at least");
        assert_eq!(clock.next_round(1, 8), Some(1), "the first one tells nothing");
        assert_eq!(clock.next_round(100, 8), Some(8));
        assert_eq!(clock.next_round((*SAMPLES.end()).into(), 8), None, "no more than the range allows");
        assert_eq!(clock.slow_start(), None);
        let mut used = Clock::new(0.0, 0.0);
        assert_eq!(used.next_round(0, 8), Some(1));
        assert_eq!(used.next_round(1, 8), None);
    }

    /// Compiling shaders takes most of a first round, and the rounds after it use what is left.
    #[test]
    fn a_slow_start_leaves_the_rest_of_the_budget() {
        let ago = |seconds| Instant::now().checked_sub(Duration::from_secs(seconds)).unwrap();
        let mut clock = Clock { began: ago(60), ..Clock::new(100.0, 0.0) };
        assert_eq!(clock.next_round(1, 8), Some(1), "40 s are left");
        assert!(clock.slow_start().is_some_and(|seconds| (60.0..70.0).contains(&seconds)));
        clock.began = ago(61);
        assert_eq!(clock.next_round(2, 8), Some(8), "at about one sample a second");
        clock.began = ago(90);
        assert_eq!(clock.next_round(2, 8), None, "at 30 s a sample");
    }

    /// A lost device is opened again as long as samples are gained, and four times without any.
    #[test]
    fn a_render_goes_on_after_losses() {
        let lost = || Err(RenderError::Gpu(GpuError::Lost("gone".to_owned())).into());
        let (kept, attempts) = (Cell::new(0), Cell::new(0));
        let attempt = |gains: bool, losses: u32| {
            kept.set(0);
            attempts.set(0);
            go_on_after_losses(&|| kept.get(), &mut || {
                attempts.set(attempts.get() + 1);
                kept.set(kept.get() + u64::from(gains));
                if attempts.get() > losses { Ok(()) } else { lost() }
            })
        };
        assert!(attempt(true, 20).is_ok() && attempts.get() == 21);
        assert!(attempt(false, MAX_LOSSES).is_ok());
        assert!(attempt(false, 20).is_err_and(|error| error.to_string().contains("was lost")));
        assert_eq!(attempts.get(), MAX_LOSSES + 1);
        let other: Result<()> = go_on_after_losses(&|| 0, &mut || {
            attempts.set(0);
            bail!("another error")
        });
        assert!(other.is_err() && attempts.get() == 0);
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
