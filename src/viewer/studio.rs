//! The thread that renders: it owns a device of its own and works on the newest order, in short batches, until another one comes.
//!
//! The window never waits for it: orders go in through a channel, of which only the last counts, and what is finished lies on a
//! [`Desk`], of which only the newest counts. Whatever changed begins anew; a lost device is opened again.
//!
//! Meshes that are refined by pixels are refined for the camera that the picture is taken with, once it rests: while it moves, surfaces stay
//! what they are, so that nothing pops and no frame waits for it.

use std::collections::VecDeque;
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::Vec3;

use super::engine::{Engine, judge_settings};
use super::order::{Card, Command, Layer, Machine, Order, Picture};
use super::pace::Pace;
use crate::film::Film;
use crate::gpu::{Gpu, GpuError};
use crate::metrics;
use crate::reference::{Features, Reference, ReferenceSettings, Rounds};
use crate::renderer::RenderError;
use crate::scene::stats::triangles_vary;
use crate::scene::{Camera, Geometry, Scene, Viewpoint};
use crate::settings::{Method, Settings};
use crate::staging;
use crate::tonemap::{self, Grade};

/// Samples after which a picture is left as it is.
pub const ENOUGH: u64 = 1 << 16;
/// Samples of the reference that errors are counted against.
const TRUTH: u32 = 4096;
/// Seconds of a batch.
const BATCH: f64 = 0.06;
/// Between pictures of the same thing.
const BETWEEN: Duration = Duration::from_millis(80);
/// The same where each is compared with the reference, which takes longer.
const BETWEEN_ERRORS: Duration = Duration::from_millis(700);
/// How far the studio steps back, in steps of `nice`: about a sixth of a processor that the window wants, too.
#[cfg(target_os = "linux")]
const NICE: i32 = 8;
/// While things move: pixels along a side of a square whose pixels have light subpaths of their own, and frames that are remembered.
const SQUARE: u32 = 2;
const FRAMES: u32 = 16;
/// VPLs that are remembered.
const VPLS: usize = 512;
/// Most panes.
pub const PANES: usize = 2;

/// What the studio has to say.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note {
    /// Something was done.
    Done(String),
    /// Something went wrong, with what to do.
    Wrong(String),
    /// The scene could not be loaded; the one before stays.
    NotLoaded(String),
}

/// What the studio has left for the window.
#[derive(Debug, Default)]
pub struct Desk {
    /// Of the machine, once it is known.
    pub machine: Option<Machine>,
    /// Of a scene that was loaded.
    pub card: Option<Card>,
    /// The newest of each pane.
    pub pictures: [Option<Picture>; PANES],
    /// In order.
    pub notes: Vec<Note>,
    /// Pictures since the studio began.
    pub count: u64,
}

/// A device, where there is one, and what is known of the machine.
pub type Opened = (Option<Gpu>, Machine);

/// Opens the best device, with ray queries where it has them.
#[must_use]
pub fn open() -> Opened {
    let (gpu, no_rays) = match Gpu::with_ray_queries() {
        Ok(gpu) => (Ok(gpu), None),
        Err(error) => (Gpu::new(), Some(error.to_string())),
    };
    match gpu {
        Ok(gpu) => {
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

/// The thread, from outside. It ends when this is dropped.
pub struct Studio {
    commands: Option<Sender<Command>>,
    desk: Arc<Mutex<Desk>>,
    thread: Option<JoinHandle<()>>,
}

impl Studio {
    /// Starts it. `open` opens a device, also after one was lost; `wake` is called when something new lies on the desk.
    #[must_use]
    pub fn new(open: impl Fn() -> Opened + Send + 'static, wake: impl Fn() + Send + 'static) -> Self {
        let (commands, receiver) = mpsc::channel();
        let desk = Arc::new(Mutex::new(Desk::default()));
        let worker = Worker {
            commands: receiver,
            desk: Arc::clone(&desk),
            wake: Box::new(wake),
            loaded: None,
            stages: 0,
            order: None,
            shown: Default::default(),
            refused: None,
        };
        let thread = std::thread::Builder::new().name("studio".to_owned()).spawn(move || {
            yield_to_others();
            worker.run(&open);
        });
        // Without a thread nothing is ever shown, and the window says so.
        let thread = thread.inspect_err(|e| note(&desk, Note::Wrong(format!("no thread to render in: {e}")))).ok();
        Self { commands: Some(commands), desk, thread }
    }

    /// Asks for something.
    pub fn send(&self, command: Command) {
        if let Some(commands) = &self.commands {
            // It only fails where the thread has ended, which has said why.
            let _ = commands.send(command);
        }
    }

    /// What has been left since the last time.
    #[must_use]
    pub fn take(&self) -> Desk {
        let mut desk = self.desk.lock().unwrap_or_else(PoisonError::into_inner);
        let count = desk.count;
        std::mem::replace(&mut *desk, Desk { count, ..Desk::default() })
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        self.commands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Has this thread, and those that it and a software driver start from it, step back behind the window's.
fn yield_to_others() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(NICE) {
        log::info!("the studio keeps its priority: {error}");
    }
}

fn note(desk: &Mutex<Desk>, note: Note) {
    desk.lock().unwrap_or_else(PoisonError::into_inner).notes.push(note);
}

/// The scene as an order wants it.
struct Stage {
    number: u64,
    pose: Option<(usize, f32)>,
    edits: super::order::Edits,
    /// What surfaces are refined for, where that matters.
    refined_for: Option<Eye>,
    scene: Scene,
    /// For methods that cannot follow light through surfaces, where there are such surfaces.
    opaque: Option<Scene>,
}

impl Stage {
    fn scene(&self, method: Method) -> &Scene {
        if method.shares_subpaths() { self.opaque.as_ref().unwrap_or(&self.scene) } else { &self.scene }
    }
}

/// Whose pixels count: the settings' camera, or the one in its place, and the size of the whole picture.
#[derive(Clone, Debug, PartialEq)]
struct Eye {
    instead: Option<Camera>,
    camera: usize,
    size: [u32; 2],
}

impl Eye {
    fn of(order: &Order) -> Option<Self> {
        let Settings { width, height, camera, .. } = order.panes.first()?.settings;
        Some(Self { instead: order.camera.clone(), camera, size: [width, height] })
    }

    /// Has a scene refined for it.
    fn open(&self, scene: &mut Scene) {
        // Behind those that settings name.
        let camera = if self.instead.is_some() { scene.cameras.len() } else { self.camera };
        scene.cameras.extend(self.instead.clone());
        scene.viewpoint = Some(Viewpoint { camera, size: self.size });
    }
}

/// A method, ready for pictures of these settings, and what the picture is of.
struct Held<'gpu> {
    settings: Settings,
    stage: u64,
    camera: Camera,
    engine: Engine<'gpu>,
    /// Whether it has not run yet: the first run is slower.
    fresh: bool,
}

/// What works on a pane.
#[derive(Default)]
struct Bench<'gpu> {
    /// For what stands still, and for what moves.
    held: [Option<Held<'gpu>>; 2],
    pace: Pace,
    /// Seconds of a sample.
    each: f64,
    shown: Option<Instant>,
    /// Of the latest samples, where they are in the picture.
    vpls: VecDeque<[f32; 2]>,
    /// The order that it could not follow.
    refused: Option<u64>,
    /// Of the features that are shown.
    features: Option<(u64, Camera, Settings, Layer)>,
}

/// The reference for a stage, made when it is first needed.
struct Judge<'s> {
    scene: &'s Scene,
    reference: Option<Reference<'s>>,
    /// The picture that errors are counted against.
    truth: Option<(Camera, ReferenceSettings, Rounds)>,
}

impl<'s> Judge<'s> {
    fn from(&mut self, camera: &Camera) -> &Reference<'s> {
        let reference = self.reference.get_or_insert_with(|| Reference::new(self.scene));
        reference.look(camera.clone());
        reference
    }

    /// Adds a sample to the truth, which begins anew where the picture is another.
    fn approach(&mut self, camera: &Camera, settings: &Settings) -> &Rounds {
        // Other random numbers than a pane that the reference itself renders.
        let wanted = ReferenceSettings { samples: 0, seed: u32::MAX, ..judge_settings(settings) };
        self.from(camera);
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

/// Why work on a stage ends.
enum End {
    /// The window is gone.
    Quit,
    /// The order wants the scene otherwise.
    Restage,
}

struct Worker {
    commands: Receiver<Command>,
    desk: Arc<Mutex<Desk>>,
    wake: Box<dyn Fn() + Send>,
    loaded: Option<(super::order::Source, Scene)>,
    stages: u64,
    order: Option<Order>,
    /// What the window has been given of each pane, and whether a grade applies.
    shown: [Option<(Arc<Film>, Layer)>; PANES],
    /// The order that could not be had.
    refused: Option<u64>,
}

impl Worker {
    fn run(mut self, open: &dyn Fn() -> Opened) {
        let mut failed = None;
        loop {
            let (gpu, machine) = open();
            self.desk.lock().unwrap_or_else(PoisonError::into_inner).machine = Some(machine);
            (self.wake)();
            let Err(error) = self.on_device(gpu.as_ref()) else { return };
            log::warn!("the device failed and is opened anew: {error}");
            // An order that fails twice is at fault itself.
            let number = self.order.as_ref().map(|order| order.number);
            if failed == number {
                self.say(Note::Wrong(format!("{error}; change the settings, or open another scene")));
                self.refused = number;
            } else {
                self.say(Note::Wrong(format!("{error}; the device is opened anew")));
            }
            failed = number;
        }
    }

    fn say(&self, said: Note) {
        note(&self.desk, said);
        (self.wake)();
    }

    /// Takes commands; waits for one where there is nothing to do. False: the window is gone.
    fn receive(&mut self, wait: bool) -> bool {
        let mut next =
            if wait { self.commands.recv().map_err(|_| TryRecvError::Disconnected) } else { self.commands.try_recv() };
        loop {
            match next {
                Ok(Command::Show(order)) => self.order = Some(*order),
                Ok(Command::Save { pane, path, grade }) => self.save(pane, &path, grade),
                Err(TryRecvError::Empty) => return true,
                Err(TryRecvError::Disconnected) => return false,
            }
            next = self.commands.try_recv();
        }
    }

    fn save(&self, pane: usize, path: &std::path::Path, grade: Grade) {
        let Some((film, layer)) = self.shown.get(pane).and_then(Option::as_ref) else {
            return self.say(Note::Wrong("there is no picture yet".to_owned()));
        };
        let linear = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"));
        let saved = if linear || !layer.is_radiance() { film.save(path) } else { film.save_graded(path, &grade) };
        self.say(match saved {
            Ok(()) => Note::Done(format!("{} is written", path.display())),
            Err(error) => Note::Wrong(error.to_string()),
        });
    }

    /// Works until the window is gone, or the device.
    fn on_device(&mut self, gpu: Option<&Gpu>) -> Result<(), GpuError> {
        let mut benches: [Bench; PANES] = Default::default();
        loop {
            let waits = self.order.as_ref().is_none_or(|order| self.refused == Some(order.number));
            if !self.receive(waits) {
                return Ok(());
            }
            let Some(order) = self.order.clone().filter(|order| self.refused != Some(order.number)) else { continue };
            if self.loaded.as_ref().is_none_or(|(source, _)| *source != order.source) {
                benches = Default::default();
            }
            let stage = match self.stage(&order) {
                Ok(stage) => stage,
                Err(said) => {
                    self.refused = Some(order.number);
                    self.say(said);
                    continue;
                }
            };
            match self.on_stage(gpu, &stage, &order, &mut benches)? {
                End::Quit => return Ok(()),
                End::Restage => {}
            }
        }
    }

    /// Loads, poses and edits.
    fn stage(&mut self, order: &Order) -> Result<Stage, Note> {
        if self.loaded.as_ref().is_none_or(|(source, _)| *source != order.source) {
            let scene =
                staging::load(&order.source.spec, &order.source.staging).map_err(|e| Note::NotLoaded(e.to_string()))?;
            log::info!("loaded {}", order.source.spec);
            let shares = order.panes.iter().any(|pane| pane.settings.method.shares_subpaths());
            self.desk.lock().unwrap_or_else(PoisonError::into_inner).card = Some(card(&scene, shares));
            self.shown = Default::default();
            self.loaded = Some((order.source.clone(), scene));
            (self.wake)();
        }
        let Some((_, loaded)) = &self.loaded else { return Err(Note::Wrong("no scene is loaded".to_owned())) };
        let mut scene = match order.pose {
            Some((animation, seconds)) => loaded.at(animation, seconds).map_err(|e| Note::Wrong(e.to_string()))?,
            None => loaded.clone(),
        };
        order.edits.apply(&mut scene);
        let refined_for = Eye::of(order).filter(|_| triangles_vary(&scene));
        if let Some(eye) = &refined_for {
            eye.open(&mut scene);
        }
        self.stages += 1;
        let clear = scene.materials.iter().any(|m| m.bsdf.transmits());
        let opaque = clear.then(|| scene.clone().without_glass());
        Ok(Stage { number: self.stages, pose: order.pose, edits: order.edits.clone(), refined_for, scene, opaque })
    }

    /// Works on orders as long as they want the scene like this.
    fn on_stage<'gpu>(
        &mut self,
        gpu: Option<&'gpu Gpu>,
        stage: &Stage,
        first: &Order,
        benches: &mut [Bench<'gpu>; PANES],
    ) -> Result<End, GpuError> {
        let mut judge = Judge { scene: &stage.scene, reference: None, truth: None };
        let mut order = first.clone();
        let mut unfinished = [true; PANES];
        for turn in 0.. {
            let count = order.panes.len().clamp(1, PANES);
            let pane = turn % count;
            if benches[pane].refused != Some(order.number) {
                let worked = self.work(gpu, stage, &mut judge, &order, pane, &mut benches[pane]);
                unfinished[pane] = match worked {
                    Ok(unfinished) => unfinished,
                    Err(RenderError::Gpu(error)) => return Err(error),
                    Err(RenderError::Setting(text)) => {
                        benches[pane] = Bench { refused: Some(order.number), ..Bench::default() };
                        self.say(Note::Wrong(text));
                        false
                    }
                };
            }
            // Whoever looks at one pane alone has no use for what the other would need.
            if count == 1 {
                benches[1] = Bench::default();
            }
            if !self.receive(!unfinished[..count].contains(&true)) {
                return Ok(End::Quit);
            }
            let Some(now) = self.order.as_ref().filter(|now| now.number != order.number) else { continue };
            (order, unfinished) = (now.clone(), [true; PANES]);
            let same = self.loaded.as_ref().is_some_and(|(source, _)| *source == order.source);
            let refined = order.moving || stage.refined_for.is_none() || stage.refined_for == Eye::of(&order);
            if !same || !refined || (order.pose, &order.edits) != (stage.pose, &stage.edits) {
                return Ok(End::Restage);
            }
        }
        Ok(End::Restage)
    }

    /// A batch for a pane. Whether there is more to do.
    fn work<'gpu>(
        &mut self,
        gpu: Option<&'gpu Gpu>,
        stage: &Stage,
        judge: &mut Judge,
        order: &Order,
        pane: usize,
        bench: &mut Bench<'gpu>,
    ) -> Result<bool, RenderError> {
        let wanted = &order.panes[pane];
        let layer = wanted.layer;
        let coarseness = if layer.is_feature() { 1 } else { bench.pace.coarseness(order.moving) };
        let [width, height] = Pace::size([wanted.settings.width, wanted.settings.height], coarseness);
        let only = if let Layer::Strategy(only) = layer { Some(only) } else { None };
        let list_lengths = layer == Layer::Lists;
        let settings = Settings { width, height, only, list_lengths, ..wanted.settings.clone() };
        let settings = if order.moving { in_motion(settings) } else { settings };
        let scene = stage.scene(settings.method);
        let camera = camera_of(order, scene, &settings)?;

        if layer.is_feature() {
            let key = (stage.number, camera.clone(), settings.clone(), layer);
            if bench.features.as_ref() != Some(&key) {
                let features = judge.from(&camera).features(&judge_settings(&settings));
                let plan: Arc<str> = "One ray through the middle of each pixel, on the CPU.".into();
                let stats = crate::renderer::RenderStats { samples: 1, ..Default::default() };
                let film = Arc::new(show_feature(features, layer));
                let picture = Picture {
                    order: order.number,
                    film,
                    layer,
                    auto_stops: None,
                    coarseness,
                    stats,
                    batch: (1, 0.0),
                    plan,
                    vpls: Vec::new(),
                    error: None,
                    finished: true,
                };
                self.publish(pane, picture);
                bench.features = Some(key);
            }
            return Ok(false);
        }
        bench.features = None;

        // The method, as it was, looking from elsewhere, posed, or anew.
        let slot = &mut bench.held[usize::from(order.moving)];
        let mut held = match slot.take().filter(|held| held.settings == settings) {
            Some(mut held) => {
                if held.stage != stage.number {
                    held.engine.pose(scene, &settings)?;
                }
                if held.stage != stage.number || held.camera != camera {
                    held.engine.look(&camera, &settings)?;
                    bench.shown = None;
                }
                Held { stage: stage.number, camera: camera.clone(), ..held }
            }
            None => {
                bench.shown = None;
                let mut engine = Engine::new(gpu, scene, &settings)?;
                engine.look(&camera, &settings)?;
                Held { settings: settings.clone(), stage: stage.number, camera: camera.clone(), engine, fresh: true }
            }
        };
        let before = held.engine.stats().samples;
        if before < ENOUGH || order.moving {
            if let Some(gpu) = gpu {
                gpu.timings.reset();
            }
            let count =
                if before == 0 || order.moving { 1 } else { Pace::batch(BATCH, bench.each).min(ENOUGH - before) };
            let began = Instant::now();
            held.engine.render(count, || judge.from(&camera))?;
            let seconds = began.elapsed().as_secs_f64();
            bench.each = seconds / count as f64;
            if before == 0 {
                bench.vpls.clear();
            }
            for vpl in held.engine.vpls()? {
                bench.vpls.extend(camera.project(vpl, width, height).map(|at| at.to_array()));
            }
            let surplus = bench.vpls.len().saturating_sub(VPLS);
            bench.vpls.drain(..surplus);
            if !std::mem::take(&mut held.fresh) {
                bench.pace.learn(coarseness, bench.each);
            }
            let stats = held.engine.stats();
            let finished = stats.samples >= ENOUGH;
            let compared = layer == Layer::Error && !order.moving;
            let rest = if compared { BETWEEN_ERRORS } else { BETWEEN };
            let truth = compared.then(|| judge.approach(&camera, &settings));
            if finished || bench.shown.is_none_or(|shown| shown.elapsed() >= rest) {
                let film = held.engine.film()?;
                let plan: Arc<str> = held.engine.plan().into();
                let mut picture = Picture {
                    order: order.number,
                    film: Arc::new(film),
                    layer: Layer::Light,
                    auto_stops: None,
                    coarseness,
                    stats,
                    batch: (count, seconds),
                    plan,
                    vpls: bench.vpls.iter().copied().collect(),
                    error: None,
                    finished,
                };
                if layer != Layer::Error {
                    picture.layer = layer;
                }
                if matches!(layer, Layer::Light | Layer::Error) {
                    picture.auto_stops = Some(tonemap::auto_exposure(&picture.film));
                }
                if layer == Layer::Lists {
                    picture.film = Arc::new(show_lengths(&picture.film));
                }
                if let Some(truth) = truth {
                    let reference = truth.film();
                    let compared = metrics::compare(&picture.film, &reference);
                    if let (Ok(error), Ok(map)) = (compared, metrics::heatmap(&picture.film, &reference)) {
                        picture.error = Some((error, truth.samples()));
                        (picture.film, picture.layer) = (Arc::new(map), layer);
                    }
                }
                self.publish(pane, picture);
                bench.shown = Some(Instant::now());
            }
        }
        *slot = Some(held);
        Ok(before < ENOUGH || order.moving)
    }

    fn publish(&mut self, pane: usize, picture: Picture) {
        self.shown[pane] = Some((Arc::clone(&picture.film), picture.layer));
        let mut desk = self.desk.lock().unwrap_or_else(PoisonError::into_inner);
        desk.pictures[pane] = Some(picture);
        desk.count += 1;
        drop(desk);
        (self.wake)();
    }
}

/// What makes a good picture of a sample: light subpaths of several kinds, filtered, and what was seen before. Settings that say something
/// of this themselves stay as they are.
fn in_motion(settings: Settings) -> Settings {
    let whole = settings.only.is_none() && !settings.list_lengths;
    let plain = settings.method.shares_subpaths() && whole && !settings.is_live();
    if plain { Settings { interleave: Some(SQUARE), history: FRAMES, ..settings } } else { settings }
}

/// What looks at the scene.
fn camera_of(order: &Order, scene: &Scene, settings: &Settings) -> Result<Camera, RenderError> {
    let camera = order.camera.as_ref().or_else(|| scene.cameras.get(settings.camera));
    let camera = camera.ok_or_else(|| RenderError::Setting(format!("there is no camera {}", settings.camera)))?;
    camera.clone().with_lens(settings.aperture, settings.focus).map_err(|e| RenderError::Setting(e.to_owned()))
}

/// A feature as colours from 0 to 1.
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

/// Lengths of lists as colours: none black, 1 blue, 8 green, 64 and more red, and in between by their logarithm.
#[must_use]
pub fn show_lengths(film: &Film) -> Film {
    let color = |length: f32| {
        let place = length.max(1.0).log2() / 3.0;
        let green = (1.0 - (place - 1.0).abs()).max(0.0);
        if length > 0.0 { [(place - 1.0).clamp(0.0, 1.0), green, (1.0 - place).max(0.0)] } else { [0.0; 3] }
    };
    Film { pixels: film.pixels.iter().map(|p| color(p[0])).collect(), ..*film }
}

/// What the window needs to know; with the warnings of methods that cannot follow light through surfaces, where one `shares` subpaths.
fn card(scene: &Scene, shares: bool) -> Card {
    let used = |material: usize| scene.instances.iter().any(|i| scene.meshes[i.mesh].material == material);
    let emissions = scene.materials.iter().enumerate().filter_map(|(index, material)| {
        let radiance = material.emission?.radiance.factor;
        (radiance != Vec3::ZERO && used(index)).then(|| (index, material.name.clone(), radiance))
    });
    let geometry = Geometry::new(scene);
    let clear = scene.materials.iter().any(|m| m.bsdf.transmits());
    let warnings = if clear && shares { scene.clone().without_glass().warnings } else { scene.warnings.clone() };
    Card {
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
