//! The render thread: it owns its own device and renders the newest [`Request`] in short batches until
//! another one arrives.
//!
//! The window never waits for this thread. Requests arrive through a channel, of which only the last counts,
//! and results are left in an [`Outbox`], of which only the newest count. A change restarts accumulation. A
//! lost device is opened again.
//!
//! Meshes that are tessellated adaptively by pixel size are refined for the picture's camera once that camera
//! rests. While it moves, the tessellation stays as it is, so that surfaces do not pop and no frame waits for
//! them.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::Vec3;

use super::engine::Engine;
use super::outbox::{Note, Outbox, SharedOutbox};
use super::pace::Pace;
use super::preview;
use super::request::{Command, Layer, Machine, Picture, Request, SceneInfo};
use crate::exposure::{Backdrop, auto_exposure, grey_card};
use crate::film::{Film, has_extension};
use crate::gpu::{Gpu, GpuError};
use crate::metrics;
use crate::reference::{Features, Reference, ReferenceSettings, Rounds};
use crate::render::renderer::{RenderError, RenderStats};
use crate::scene::model::stats::triangles_vary;
use crate::scene::{Camera, Geometry, Scene, Viewpoint};
use crate::settings::Settings;
use crate::staging;
use crate::tonemap::Grade;

/// Samples per pixel after which rendering stops.
pub const ENOUGH: u64 = 1 << 16;
/// Samples per pixel of the reference that errors are measured against.
const TRUTH: u32 = 4096;
/// Target duration of a batch, seconds.
const BATCH: f64 = 0.06;
/// Least time between two pictures of the same request.
const BETWEEN: Duration = Duration::from_millis(80);
/// Least time between two pictures that are compared with the reference, which takes longer.
const BETWEEN_ERRORS: Duration = Duration::from_millis(700);
/// Increment of the thread's `nice` value: it then receives about a sixth of a processor that the window
/// needs as well.
#[cfg(target_os = "linux")]
const NICE: i32 = 8;
/// Side of the square of pixels that is interleaved while the picture moves, and frames of temporal history.
const SQUARE: u32 = 2;
const FRAMES: u32 = 16;
/// Projected VPLs that are kept.
const VPLS: usize = 512;
/// Largest number of panes.
pub const PANES: usize = 2;

/// A device, if there is one, and a description of the machine.
pub type Opened = (Option<Gpu>, Machine);

/// Opens the best device, with ray queries if it supports them.
#[must_use]
pub fn open() -> Opened {
    let (gpu, no_rays) = match Gpu::with_ray_queries() {
        Ok(gpu) => (Ok(gpu), None),
        Err(error) => (Gpu::new(), Some(error.to_string())),
    };
    match gpu {
        Ok(gpu) => {
            gpu.timings.measure(true);
            let device = gpu.capabilities.adapter.clone();
            (Some(gpu), Machine { device, no_device: None, no_rays })
        }
        Err(error) => {
            let reason = error.to_string();
            let machine = Machine { device: "none".to_owned(), no_device: Some(reason.clone()), no_rays: Some(reason) };
            (None, machine)
        }
    }
}

/// Handle of the render thread, which ends when the handle is dropped.
pub struct RenderThread {
    commands: Option<Sender<Command>>,
    outbox: Arc<SharedOutbox>,
    thread: Option<JoinHandle<()>>,
}

impl RenderThread {
    /// Starts the thread. `open` opens a device, and is called again after a device loss; `wake` is called
    /// when the outbox has new results.
    #[must_use]
    pub fn new(open: impl Fn() -> Opened + Send + 'static, wake: impl Fn() + Send + Sync + 'static) -> Self {
        let (commands, receiver) = mpsc::channel();
        let outbox = Arc::new(SharedOutbox::new(wake));
        let worker = Worker {
            commands: receiver,
            outbox: Arc::clone(&outbox),
            loaded: None,
            posed_scenes: 0,
            request: None,
            shown: Default::default(),
            refused: None,
        };
        let thread = std::thread::Builder::new().name("render".to_owned()).spawn(move || {
            yield_to_others();
            worker.run(&open);
        });
        // Without a thread no picture is ever shown; the note makes the window say so.
        let thread = thread.inspect_err(|e| outbox.say(Note::Wrong(format!("no thread to render in: {e}")))).ok();
        Self { commands: Some(commands), outbox, thread }
    }

    /// Sends a command.
    pub fn send(&self, command: Command) {
        if let Some(commands) = &self.commands {
            // Sending fails only after the thread has ended, which has reported its reason.
            let _ = commands.send(command);
        }
    }

    /// Returns the results since the last call.
    #[must_use]
    pub fn take(&self) -> Outbox {
        self.outbox.take()
    }
}

impl Drop for RenderThread {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Lowers the priority of this thread, and of the threads that it and a software driver start, below the
/// window's.
fn yield_to_others() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(NICE) {
        log::info!("the render thread keeps its priority: {error}");
    }
}

/// The scene, posed and edited as a request describes it.
struct PosedScene {
    number: u64,
    pose: Option<(usize, f32)>,
    edits: super::request::Edits,
    /// Camera that the tessellation is refined for; none if the scene has no adaptively tessellated meshes.
    refined_for: Option<Eye>,
    scene: Scene,
    /// Luminance of the scene's [`grey_card`].
    grey_card: f32,
}

/// Camera whose pixels decide the tessellation: the settings' camera or its replacement, and the size of the
/// whole picture.
#[derive(Clone, Debug, PartialEq)]
struct Eye {
    instead: Option<Camera>,
    camera: usize,
    size: [u32; 2],
}

impl Eye {
    fn of(request: &Request) -> Option<Self> {
        let Settings { width, height, camera, .. } = request.panes.first()?.settings;
        Some(Self { instead: request.camera.clone(), camera, size: [width, height] })
    }

    /// Makes this camera the scene's viewpoint for adaptive tessellation.
    fn open(&self, scene: &mut Scene) {
        // The replacement is appended, so that the indices in settings stay valid.
        let camera = if self.instead.is_some() { scene.cameras.len() } else { self.camera };
        scene.cameras.extend(self.instead.clone());
        scene.viewpoint = Some(Viewpoint { camera, size: self.size });
    }
}

/// A renderer that is ready for pictures with these settings, and the scene and camera that it is prepared
/// for.
struct CachedRenderer<'gpu> {
    settings: Settings,
    posed_scene: u64,
    camera: Camera,
    engine: Engine<'gpu>,
    /// What the camera sees of the environment.
    backdrop: Option<Backdrop>,
    /// True if the renderer has not run yet: the first run is slower and is not used to choose the
    /// resolution.
    fresh: bool,
}

/// State of a pane's rendering.
#[derive(Default)]
struct PaneState<'gpu> {
    /// Renderers of the picture at rest and of the moving picture.
    cached: [Option<CachedRenderer<'gpu>>; 2],
    pace: Pace,
    /// Seconds per sample.
    each: f64,
    shown: Option<Instant>,
    /// Positions in the picture of the latest samples' VPLs.
    vpls: VecDeque<[f32; 2]>,
    /// Number of the request that could not be rendered.
    refused: Option<u64>,
    /// Posed scene, camera, settings and layer of the features that are shown.
    features: Option<(u64, Camera, Settings, Layer)>,
}

/// The reference renderer of a posed scene, created on first use.
struct ReferenceCache<'s> {
    scene: &'s Scene,
    reference: Option<Reference<'s>>,
    /// The picture that errors are measured against.
    truth: Option<(Camera, ReferenceSettings, Rounds)>,
}

impl<'s> ReferenceCache<'s> {
    fn with_camera(&mut self, camera: &Camera) -> &Reference<'s> {
        let reference = self.reference.get_or_insert_with(|| Reference::new(self.scene));
        reference.look(camera.clone());
        reference
    }

    /// Adds one sample to the truth, which restarts if camera or settings have changed.
    fn add_truth_sample(&mut self, camera: &Camera, settings: &Settings) -> &Rounds {
        // The seed differs from that of a pane that the reference itself renders, so that their errors are
        // independent.
        let wanted = ReferenceSettings { samples: 0, seed: u32::MAX, ..ReferenceSettings::of(settings) };
        self.with_camera(camera);
        if self.truth.as_ref().is_none_or(|(c, s, _)| (c, s) != (camera, &wanted)) {
            self.truth = None;
        }
        let (.., rounds) = self.truth.get_or_insert_with(|| (camera.clone(), wanted, Rounds::new(wanted)));
        if let Some(reference) = self.reference.as_ref().filter(|_| rounds.samples() < TRUTH) {
            rounds.add(reference, 1, &|_, _| ());
        }
        rounds
    }
}

/// A pane's picture as a request describes it, at the resolution that it is rendered at.
pub(super) struct PaneView<'s> {
    /// Number of the request.
    pub(super) request: u64,
    pub(super) pane: usize,
    pub(super) layer: Layer,
    pub(super) moving: bool,
    pub(super) coarseness: u32,
    pub(super) settings: Settings,
    /// Number of the posed scene.
    pub(super) posed_scene: u64,
    pub(super) scene: &'s Scene,
    pub(super) grey_card: f32,
    pub(super) camera: Camera,
}

impl<'s> PaneView<'s> {
    fn new(posed: &'s PosedScene, request: &Request, pane: usize, pace: Pace) -> Result<Self, RenderError> {
        let wanted = &request.panes[pane];
        let layer = wanted.layer;
        let coarseness = if layer.is_feature() { 1 } else { pace.coarseness(request.moving) };
        let [width, height] = Pace::size([wanted.settings.width, wanted.settings.height], coarseness);
        let only = if let Layer::Strategy(only) = layer { Some(only) } else { None };
        let list_lengths = layer == Layer::Lists;
        let settings = Settings { width, height, only, list_lengths, ..wanted.settings.clone() };
        let settings = if request.moving { in_motion(settings) } else { settings };
        let scene = &posed.scene;
        let camera = camera_of(request, scene, &settings)?;
        let (request, moving) = (request.number, request.moving);
        let &PosedScene { number: posed_scene, grey_card, .. } = posed;
        Ok(Self { request, pane, layer, moving, coarseness, settings, posed_scene, scene, grey_card, camera })
    }
}

impl<'gpu> PaneState<'gpu> {
    /// Takes the cached renderer for these settings, reposed and with the view's camera, or creates one.
    fn take_renderer(&mut self, gpu: Option<&'gpu Gpu>, view: &PaneView) -> Result<CachedRenderer<'gpu>, RenderError> {
        let &PaneView { ref settings, posed_scene, scene, grey_card, ref camera, .. } = view;
        let slot = &mut self.cached[usize::from(view.moving)];
        let backdrop =
            || Backdrop::with_card(scene, grey_card, camera, [settings.width, settings.height], settings.crop);
        match slot.take().filter(|cached| cached.settings == *settings) {
            Some(mut cached) => {
                if cached.posed_scene != posed_scene {
                    cached.engine.pose(scene, settings)?;
                }
                if cached.posed_scene != posed_scene || cached.camera != *camera {
                    cached.engine.set_camera(camera, settings)?;
                    cached.backdrop = backdrop();
                    self.shown = None;
                }
                Ok(CachedRenderer { posed_scene, camera: camera.clone(), ..cached })
            }
            None => {
                self.shown = None;
                let mut engine = Engine::new(gpu, scene, settings)?;
                engine.set_camera(camera, settings)?;
                let (backdrop, settings, camera) = (backdrop(), settings.clone(), camera.clone());
                Ok(CachedRenderer { settings, posed_scene, camera, engine, backdrop, fresh: true })
            }
        }
    }

    /// Renders a batch of about [`BATCH`] seconds, or one sample if it is the first or the picture is moving.
    /// Returns the number of samples and the seconds that they took.
    fn render_batch(
        &mut self,
        gpu: Option<&'gpu Gpu>,
        view: &PaneView,
        cached: &mut CachedRenderer,
        reference_cache: &mut ReferenceCache,
    ) -> Result<(u64, f64), RenderError> {
        let before = cached.engine.stats().samples;
        if let Some(gpu) = gpu {
            gpu.timings.reset();
        }
        let count = if before == 0 || view.moving { 1 } else { Pace::batch(BATCH, self.each).min(ENOUGH - before) };
        let began = Instant::now();
        cached.engine.render(count, || reference_cache.with_camera(&view.camera))?;
        let seconds = began.elapsed().as_secs_f64();
        self.each = seconds / count as f64;
        if before == 0 {
            self.vpls.clear();
        }
        let Settings { width, height, .. } = view.settings;
        for vpl in cached.engine.vpls()? {
            self.vpls.extend(view.camera.project(vpl, width, height).map(|at| at.to_array()));
        }
        let surplus = self.vpls.len().saturating_sub(VPLS);
        self.vpls.drain(..surplus);
        if !std::mem::take(&mut cached.fresh) {
            self.pace.learn(view.coarseness, self.each);
        }
        Ok((count, seconds))
    }

    /// Returns the picture of the samples so far; with the reference's picture in `truth`, its error map.
    fn picture(
        &self,
        view: &PaneView,
        CachedRenderer { engine, backdrop, .. }: &CachedRenderer,
        stats: RenderStats,
        batch: (u64, f64),
        truth: Option<&Rounds>,
    ) -> Result<Picture, RenderError> {
        let film = engine.film()?;
        let plan: Arc<str> = engine.plan().into();
        let finished = stats.samples >= ENOUGH;
        let mut picture = Picture {
            request: view.request,
            film: Arc::new(film),
            layer: Layer::Light,
            auto_stops: None,
            coarseness: view.coarseness,
            stats,
            batch,
            plan,
            vpls: self.vpls.iter().copied().collect(),
            error: None,
            finished,
        };
        if view.layer != Layer::Error {
            picture.layer = view.layer;
        }
        if matches!(view.layer, Layer::Light | Layer::Error) {
            picture.auto_stops = Some(auto_exposure(&picture.film, backdrop.as_ref()));
        }
        if view.layer == Layer::Lists {
            picture.film = Arc::new(show_lengths(&picture.film));
        }
        if let Some(truth) = truth {
            let reference = truth.film();
            let compared = metrics::compare(&picture.film, &reference);
            if let (Ok(error), Ok(map)) = (compared, metrics::heatmap(&picture.film, &reference)) {
                picture.error = Some((error, truth.samples()));
                (picture.film, picture.layer) = (Arc::new(map), view.layer);
            }
        }
        Ok(picture)
    }
}

/// The reason why rendering of a posed scene ends.
enum End {
    /// The window has closed.
    Quit,
    /// The request needs the scene to be posed again.
    Repose,
}

struct Worker {
    commands: Receiver<Command>,
    outbox: Arc<SharedOutbox>,
    loaded: Option<(super::request::Source, Scene)>,
    posed_scenes: u64,
    request: Option<Request>,
    /// Each pane's picture as the window has it, and its layer, which decides if the tone map applies.
    shown: [Option<(Arc<Film>, Layer)>; PANES],
    /// Number of the request that could not be rendered.
    refused: Option<u64>,
}

impl Worker {
    fn run(mut self, open: &dyn Fn() -> Opened) {
        let mut failed = None;
        loop {
            let (gpu, machine) = open();
            self.outbox.add(|outbox| outbox.machine = Some(machine));
            let Err(error) = self.on_device(gpu.as_ref()) else { return };
            log::warn!("the device failed and is opened anew: {error}");
            // A request that fails twice is itself the cause.
            let number = self.request.as_ref().map(|request| request.number);
            if failed == number {
                self.outbox.say(Note::Wrong(format!("{error}; change the settings, or open another scene")));
                self.refused = number;
            } else {
                self.outbox.say(Note::Wrong(format!("{error}; the device is opened anew")));
            }
            failed = number;
        }
    }

    /// Receives commands; if `wait` is true, waits for the first one. Returns false if the window has closed.
    fn receive(&mut self, wait: bool) -> bool {
        let mut next =
            if wait { self.commands.recv().map_err(|_| TryRecvError::Disconnected) } else { self.commands.try_recv() };
        loop {
            match next {
                Ok(Command::Show(request)) => self.request = Some(*request),
                Ok(Command::Save { pane, path, tonemap }) => self.save(pane, &path, tonemap),
                Err(TryRecvError::Empty) => return true,
                Err(TryRecvError::Disconnected) => return false,
            }
            next = self.commands.try_recv();
        }
    }

    fn save(&self, pane: usize, path: &std::path::Path, tonemap: Grade) {
        let Some((film, layer)) = self.shown.get(pane).and_then(Option::as_ref) else {
            return self.outbox.say(Note::Wrong("there is no picture yet".to_owned()));
        };
        let linear = has_extension(path, "exr");
        let saved = if linear || !layer.is_radiance() { film.save(path) } else { film.save_graded(path, &tonemap) };
        self.outbox.say(match saved {
            Ok(()) => Note::Done(format!("{} is written", path.display())),
            Err(error) => Note::Wrong(error.to_string()),
        });
    }

    /// Renders until the window closes or the device is lost.
    fn on_device(&mut self, gpu: Option<&Gpu>) -> Result<(), GpuError> {
        let mut pane_states: [PaneState; PANES] = Default::default();
        if let Some(gpu) = gpu {
            let outbox = Arc::clone(&self.outbox);
            gpu.compilation.tell(Box::new(move |_, before| outbox.add(|outbox| outbox.shaders = Some(before))));
        }
        loop {
            let waits = self.request.as_ref().is_none_or(|request| self.refused == Some(request.number));
            if !self.receive(waits) {
                return Ok(());
            }
            let Some(request) = self.request.clone().filter(|request| self.refused != Some(request.number)) else {
                continue;
            };
            if self.loaded.as_ref().is_none_or(|(source, _)| *source != request.source) {
                pane_states = Default::default();
            }
            let posed = match self.pose_scene(&request) {
                Ok(posed) => posed,
                Err(said) => {
                    self.refused = Some(request.number);
                    self.outbox.say(said);
                    continue;
                }
            };
            match self.render_posed_scene(gpu, &posed, &request, &mut pane_states)? {
                End::Quit => return Ok(()),
                End::Repose => {}
            }
        }
    }

    /// Loads the scene if it is another one, poses it and applies the edits.
    fn pose_scene(&mut self, request: &Request) -> Result<PosedScene, Note> {
        if self.loaded.as_ref().is_none_or(|(source, _)| *source != request.source) {
            let scene = staging::load(&request.source.spec, &request.source.staging)
                .map_err(|e| Note::NotLoaded(e.to_string()))?;
            log::info!("loaded {}", request.source.spec);
            let without_glass = request.panes.iter().any(|pane| pane.settings.shares_all_directions());
            let scene_info = scene_info(&scene, without_glass);
            self.shown = Default::default();
            self.loaded = Some((request.source.clone(), scene));
            self.outbox.add(|outbox| outbox.scene_info = Some(scene_info));
        }
        let Some((_, loaded)) = &self.loaded else { return Err(Note::Wrong("no scene is loaded".to_owned())) };
        let mut scene = match request.pose {
            Some((animation, seconds)) => loaded.at(animation, seconds).map_err(|e| Note::Wrong(e.to_string()))?,
            None => loaded.clone(),
        };
        request.edits.apply(&mut scene);
        let refined_for = Eye::of(request).filter(|_| triangles_vary(&scene));
        if let Some(eye) = &refined_for {
            eye.open(&mut scene);
        }
        self.posed_scenes += 1;
        Ok(PosedScene {
            number: self.posed_scenes,
            pose: request.pose,
            edits: request.edits.clone(),
            refined_for,
            grey_card: grey_card(&scene),
            scene,
        })
    }

    /// Renders requests for as long as they need the same posed scene.
    fn render_posed_scene<'gpu>(
        &mut self,
        gpu: Option<&'gpu Gpu>,
        posed: &PosedScene,
        first: &Request,
        pane_states: &mut [PaneState<'gpu>; PANES],
    ) -> Result<End, GpuError> {
        let mut reference_cache = ReferenceCache { scene: &posed.scene, reference: None, truth: None };
        let mut request = first.clone();
        let mut unfinished = [true; PANES];
        for turn in 0.. {
            let count = request.panes.len().clamp(1, PANES);
            let pane = turn % count;
            if pane_states[pane].refused != Some(request.number) {
                let pane_state = &mut pane_states[pane];
                let rendered = PaneView::new(posed, &request, pane, pane_state.pace)
                    .and_then(|view| self.render_pane(gpu, &view, &mut reference_cache, pane_state));
                unfinished[pane] = match rendered {
                    Ok(unfinished) => unfinished,
                    Err(RenderError::Gpu(error)) => return Err(error),
                    Err(RenderError::Setting(text)) => {
                        pane_states[pane] = PaneState { refused: Some(request.number), ..PaneState::default() };
                        self.outbox.say(Note::Wrong(text));
                        false
                    }
                };
            }
            // The second pane's renderers are released while only one pane is shown.
            if count == 1 {
                pane_states[1] = PaneState::default();
            }
            if !self.receive(!unfinished[..count].contains(&true)) {
                return Ok(End::Quit);
            }
            let Some(now) = self.request.as_ref().filter(|now| now.number != request.number) else { continue };
            (request, unfinished) = (now.clone(), [true; PANES]);
            let same = self.loaded.as_ref().is_some_and(|(source, _)| *source == request.source);
            let refined = request.moving || posed.refined_for.is_none() || posed.refined_for == Eye::of(&request);
            if !same || !refined || (request.pose, &request.edits) != (posed.pose, &posed.edits) {
                return Ok(End::Repose);
            }
        }
        Ok(End::Repose)
    }

    /// Renders a batch of samples for a pane and publishes a picture if one is due. Returns true if more
    /// samples are to come.
    fn render_pane<'gpu>(
        &mut self,
        gpu: Option<&'gpu Gpu>,
        view: &PaneView,
        reference_cache: &mut ReferenceCache,
        pane_state: &mut PaneState<'gpu>,
    ) -> Result<bool, RenderError> {
        if view.layer.is_feature() {
            self.show_features(view, reference_cache, pane_state);
            return Ok(false);
        }
        pane_state.features = None;
        let mut render = || {
            let mut cached = pane_state.take_renderer(gpu, view)?;
            let unfinished = cached.engine.stats().samples < ENOUGH || view.moving;
            let batch = unfinished.then(|| pane_state.render_batch(gpu, view, &mut cached, reference_cache));
            Ok::<_, RenderError>((cached, batch.transpose()?))
        };
        let (cached, batch) = match self.shown[view.pane] {
            None => preview::meanwhile(&self.outbox, view, render)?,
            Some(_) => render()?,
        };
        if let Some(batch) = batch {
            let stats = cached.engine.stats();
            let compared = view.layer == Layer::Error && !view.moving;
            let interval = if compared { BETWEEN_ERRORS } else { BETWEEN };
            let truth = compared.then(|| reference_cache.add_truth_sample(&view.camera, &view.settings));
            if stats.samples >= ENOUGH || pane_state.shown.is_none_or(|shown| shown.elapsed() >= interval) {
                let picture = pane_state.picture(view, &cached, stats, batch, truth)?;
                self.publish(view.pane, picture);
                pane_state.shown = Some(Instant::now());
            }
        }
        pane_state.cached[usize::from(view.moving)] = Some(cached);
        Ok(batch.is_some())
    }

    /// Publishes the pane's feature layer (distance, normal or albedo), unless it is shown already.
    fn show_features(&mut self, view: &PaneView, reference_cache: &mut ReferenceCache, pane_state: &mut PaneState) {
        let key = (view.posed_scene, view.camera.clone(), view.settings.clone(), view.layer);
        if pane_state.features.as_ref() == Some(&key) {
            return;
        }
        let features = reference_cache.with_camera(&view.camera).features(&ReferenceSettings::of(&view.settings));
        let picture = Picture {
            request: view.request,
            film: Arc::new(show_feature(features, view.layer)),
            layer: view.layer,
            auto_stops: None,
            coarseness: view.coarseness,
            stats: RenderStats { samples: 1, ..Default::default() },
            batch: (1, 0.0),
            plan: "One ray through the middle of each pixel, on the CPU.".into(),
            vpls: Vec::new(),
            error: None,
            finished: true,
        };
        self.publish(view.pane, picture);
        pane_state.features = Some(key);
    }

    fn publish(&mut self, pane: usize, picture: Picture) {
        self.shown[pane] = Some((Arc::clone(&picture.film), picture.layer));
        self.outbox.add(|outbox| {
            outbox.pictures[pane] = Some(picture);
            outbox.shaders = None;
            outbox.count += 1;
        });
    }
}

/// Adds interleaved light subpaths and temporal history, which make a usable picture of one sample. Settings
/// that choose interleaving or history themselves, or a single strategy, stay as they are.
fn in_motion(settings: Settings) -> Settings {
    let whole = settings.only.is_none() && !settings.list_lengths;
    let plain = settings.technique.shares_subpaths() && whole && !settings.is_denoised();
    if plain { Settings { interleave: Some(SQUARE), history: FRAMES, ..settings } } else { settings }
}

/// Returns the request's camera, or the scene's camera that the settings name, with the settings' lens.
fn camera_of(request: &Request, scene: &Scene, settings: &Settings) -> Result<Camera, RenderError> {
    let camera = request.camera.as_ref().or_else(|| scene.cameras.get(settings.camera));
    let camera = camera.ok_or_else(|| RenderError::Setting(format!("there is no camera {}", settings.camera)))?;
    camera.clone().with_lens(settings.aperture, settings.focus).map_err(|e| RenderError::Setting(e.to_owned()))
}

/// Maps a feature to colours from 0 to 1.
fn show_feature(features: Features, layer: Layer) -> Film {
    let each = |film: Film, show: &dyn Fn([f32; 3]) -> [f32; 3]| Film {
        pixels: film.pixels.iter().map(|&pixel| show(pixel)).collect(),
        ..film
    };
    match layer {
        Layer::Distance => {
            let farthest = features.distance.pixels.iter().map(|p| p[0]).fold(0.0, f32::max).max(f32::MIN_POSITIVE);
            each(features.distance, &|p| p.map(|metres| metres / farthest))
        }
        Layer::Normal => each(features.normal, &|p| if p == [0.0; 3] { p } else { p.map(|x| 0.5 * x + 0.5) }),
        _ => features.albedo,
    }
}

/// Maps list lengths to colours on a logarithmic scale: 0 is black, 1 blue, 8 green, 64 and more red.
#[must_use]
pub fn show_lengths(film: &Film) -> Film {
    let color = |length: f32| {
        let place = length.max(1.0).log2() / 3.0;
        let green = (1.0 - (place - 1.0).abs()).max(0.0);
        if length > 0.0 { [(place - 1.0).clamp(0.0, 1.0), green, (1.0 - place).max(0.0)] } else { [0.0; 3] }
    };
    Film { pixels: film.pixels.iter().map(|p| color(p[0])).collect(), ..*film }
}

/// Returns the window's description of a scene. If `without_glass` is true, a pane leaves glass out, and the description
/// includes the warnings of that.
fn scene_info(scene: &Scene, without_glass: bool) -> SceneInfo {
    let used = |material: usize| scene.instances.iter().any(|i| scene.meshes[i.mesh].material == material);
    let emissions = scene.materials.iter().enumerate().filter_map(|(index, material)| {
        let radiance = material.emission?.radiance.factor;
        (radiance != Vec3::ZERO && used(index)).then(|| (index, material.name.clone(), radiance))
    });
    let geometry = Geometry::new(scene);
    let warnings = if without_glass && scene.transmits() {
        scene.clone().without_glass().warnings
    } else {
        scene.warnings.clone()
    };
    SceneInfo {
        spec: scene.name.clone(),
        cameras: scene.cameras.clone(),
        animations: scene.rig.iter().flat_map(|rig| &rig.animations).map(|a| (a.name.clone(), a.seconds())).collect(),
        lights: scene.lights.clone(),
        emissions: emissions.collect(),
        warnings,
        notes: scene.notes.clone(),
        triangles: geometry.triangles.len(),
        sphere: geometry.sphere(),
    }
}
