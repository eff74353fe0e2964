//! What the user has chosen and what there is to see: everything of the window that needs no window.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::knobs::Chosen;
use super::order::{Card, Edits, Layer, Machine, Order, Pane, Picture, Source};
use super::stand::Stand;
use super::studio::{Desk, Note, PANES};
use crate::scene::{Camera, EnvironmentChange, FovAxis, Projection};
use crate::settings::{Method, SIDES, Settings};
use crate::staging::Staging;
use crate::staging::camera::AUTO;
use crate::tonemap::{Exposure, Grade, Tonemap};

/// How long after a change the picture counts as moving.
const SETTLES: Duration = Duration::from_millis(300);
/// Share of the way to the exposure of a moving picture that each new one takes.
const FOLLOWS: f32 = 0.1;
/// Notes that are kept.
const NOTES: usize = 20;

/// What the command line opens the viewer with.
#[derive(Clone, Debug)]
pub struct Launch {
    /// A path or `builtin:NAME`.
    pub spec: String,
    /// What is asked for in place of the scene's own camera and light.
    pub staging: Staging,
    /// Of the first pane.
    pub settings: Settings,
    /// Where to stand instead.
    pub stand: Option<Stand>,
    /// Angle of view along the shorter side, degrees.
    pub fov: Option<f32>,
    /// An animation by name or index.
    pub animation: Option<String>,
    /// Its time in seconds.
    pub at: Option<f32>,
    /// How bright pictures are shown.
    pub exposure: Exposure,
    /// By which tone curve.
    pub tonemap: Tonemap,
}

/// An animation being watched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Which one.
    pub index: usize,
    /// Where it is, in seconds.
    pub seconds: f32,
    /// Whether it goes on.
    pub playing: bool,
}

/// One side of the comparison; without one, only the first is there.
#[derive(Clone, Debug)]
pub struct Side {
    /// What its knobs say, right or wrong.
    pub chosen: Chosen,
    /// The last that was right.
    pub settings: Settings,
    /// What is wrong with the knobs.
    pub wrong: Option<String>,
    /// What of the picture is shown.
    pub layer: Layer,
    /// The newest.
    pub picture: Option<Picture>,
}

impl Side {
    fn new(settings: &Settings) -> Self {
        Self {
            chosen: Chosen::of(settings),
            settings: settings.clone(),
            wrong: None,
            layer: Layer::Light,
            picture: None,
        }
    }

    /// Makes settings of the knobs, or says what is wrong with them.
    pub fn settle(&mut self) {
        match self.chosen.settings() {
            Ok(settings) => {
                self.settings = settings;
                self.wrong = None;
            }
            Err(cause) => self.wrong = Some(cause),
        }
        if !self.layer.is_of(self.settings.method) {
            self.layer = Layer::Light;
        }
    }

    /// Switches to another method; options that it does not have go back to their defaults.
    pub fn use_method(&mut self, method: Method) {
        match method {
            _ if method == Settings::default().method => self.chosen.0.remove("method"),
            _ => self.chosen.0.insert("method".to_owned(), method.to_string()),
        };
        self.chosen.settle();
        self.settle();
    }
}

/// All of it.
#[derive(Clone, Debug)]
pub struct State {
    /// The scene.
    pub source: Source,
    /// What is known of it, once it is loaded.
    pub card: Option<Card>,
    /// What is known of the machine.
    pub machine: Machine,
    /// Left and right.
    pub sides: [Side; PANES],
    /// Whether both are shown.
    pub compares: bool,
    /// Where one ends and the other begins, a share of the width.
    pub divider: f32,
    /// Which side the panel is about.
    pub active: usize,
    /// The scene's camera.
    pub camera: usize,
    /// Where the user went instead.
    pub stand: Option<Stand>,
    /// Angle of view along the shorter side, degrees, instead of the camera's.
    pub fov: Option<f32>,
    /// What moves.
    pub playback: Option<Playback>,
    /// What is not as in the file.
    pub edits: Edits,
    /// How bright it is shown.
    pub exposure: Exposure,
    /// By which tone curve.
    pub tonemap: Tonemap,
    /// The exposure of [`Exposure::Auto`], in stops, once there is a picture.
    pub auto_stops: Option<f32>,
    /// Whether VPLs are marked.
    pub marks_vpls: bool,
    /// What the studio said, newest last.
    pub notes: Vec<Note>,
    /// Pictures a second, lately.
    pub pictures_a_second: f64,
    launch: Option<Launch>,
    size: [u32; 2],
    sent: Option<Order>,
    changed: Option<Instant>,
    counted: (Option<Instant>, u64),
}

impl State {
    /// As the command line has it.
    #[must_use]
    pub fn new(launch: Launch) -> Self {
        let side = Side::new(&launch.settings);
        Self {
            source: Source { spec: launch.spec.clone(), staging: launch.staging.clone() },
            card: None,
            machine: Machine::default(),
            sides: [side.clone(), side],
            compares: false,
            divider: 0.5,
            active: 0,
            camera: 0,
            stand: launch.stand,
            fov: launch.fov,
            playback: None,
            edits: Edits::default(),
            exposure: launch.exposure,
            tonemap: launch.tonemap,
            auto_stops: None,
            marks_vpls: false,
            notes: Vec::new(),
            pictures_a_second: 0.0,
            launch: Some(launch),
            size: [1, 1],
            sent: None,
            changed: None,
            counted: (None, 0),
        }
    }

    /// Opens another scene, as its file has it.
    pub fn open(&mut self, spec: &str) {
        self.source = Source { spec: spec.to_owned(), staging: Staging { size: self.size, ..Staging::default() } };
        self.edits = Edits::default();
        (self.camera, self.stand, self.fov, self.playback) = (0, None, None, None);
    }

    /// Why a method cannot be had, if so.
    #[must_use]
    pub fn lacks(&self, method: Method) -> Option<&str> {
        let Machine { no_device, no_rays, .. } = &self.machine;
        match method {
            Method::Reference => None,
            _ if method.traces_rays() => no_rays.as_deref(),
            _ => no_device.as_deref(),
        }
    }

    /// Whether the active side's picture is part of the command line's.
    fn side(&self) -> &Side {
        &self.sides[self.active]
    }

    /// The camera of the scene that the user left, if it has one of that index.
    fn base(&self) -> Option<&Camera> {
        self.card.as_ref()?.cameras.get(self.camera)
    }

    /// Where the user stands, or the scene's camera does.
    #[must_use]
    pub fn standing(&self) -> Option<Stand> {
        let (card, base) = (self.card.as_ref()?, self.base()?);
        let (middle, radius) = card.sphere;
        let eye = glam::Vec3::from(base.world_from_camera.translation);
        // What is looked at lies about as far as the middle of the scene, or inside it, halfway.
        let distance = if eye.distance(middle) > 0.5 * radius { eye.distance(middle) } else { 0.5 * radius };
        Some(self.stand.unwrap_or_else(|| Stand::of(base, distance.max(1e-3))))
    }

    /// Moves.
    pub fn walk(&mut self, step: impl FnOnce(&mut Stand)) {
        if let Some(mut stand) = self.standing() {
            step(&mut stand);
            self.stand = Some(stand);
        }
    }

    /// Metres that one step is worth: a share of the scene.
    #[must_use]
    pub fn stride(&self) -> f32 {
        self.card.as_ref().map_or(1.0, |card| card.sphere.1)
    }

    /// The camera, where it is not the scene's own.
    fn placed(&self) -> Option<Camera> {
        let base = self.base().filter(|_| self.stand.is_some() || self.fov.is_some())?;
        let mut camera = self.stand.map_or_else(|| base.clone(), |stand| stand.camera(base));
        if let Some(degrees) = self.fov {
            camera.projection = Projection::Perspective { fov: degrees.to_radians(), axis: FovAxis::Smaller };
        }
        Some(camera)
    }

    /// Takes what the studio has left.
    pub fn accept(&mut self, desk: Desk, now: Instant) {
        if let Some(machine) = desk.machine {
            self.machine = machine;
        }
        if let Some(card) = desk.card {
            self.sides.iter_mut().for_each(|side| side.picture = None);
            self.auto_stops = None;
            self.notes.extend(card.warnings.iter().map(|text| Note::Wrong(text.clone())));
            self.notes.extend(card.notes.iter().map(|text| Note::Done(text.clone())));
            self.card = Some(card);
            self.finish_launch();
        }
        for note in desk.notes {
            if let (Note::NotLoaded(_), Some(card)) = (&note, &self.card) {
                self.source = Source { spec: card.spec.clone(), ..self.source.clone() };
            }
            self.notes.push(note);
        }
        let surplus = self.notes.len().saturating_sub(NOTES);
        self.notes.drain(..surplus);
        for (side, picture) in self.sides.iter_mut().zip(desk.pictures) {
            side.picture = picture.or(side.picture.take());
        }
        self.expose();
        let (since, count) = self.counted;
        match since {
            Some(since) if now - since > Duration::from_secs(1) => {
                self.pictures_a_second = (desk.count - count) as f64 / (now - since).as_secs_f64();
                self.counted = (Some(now), desk.count);
            }
            Some(_) => {}
            None => self.counted = (Some(now), desk.count),
        }
    }

    /// How pictures are shown.
    #[must_use]
    pub fn grade(&self) -> Grade {
        let stops = match self.exposure {
            Exposure::Auto => self.auto_stops.unwrap_or_default(),
            Exposure::Stops(stops) => stops,
        };
        Grade { stops, tonemap: self.tonemap }
    }

    /// Takes the exposure of the first pane's picture for both panes, so that they can be compared. While things move it
    /// follows slowly, so that it does not flicker.
    fn expose(&mut self) {
        let exposed = |picture: &Picture| picture.auto_stops.map(|stops| (picture.order, stops));
        let mut pictures = self.sides.iter().filter_map(|side| side.picture.as_ref());
        let Some((order, stops)) = pictures.find_map(exposed) else { return };
        let rests = self.sent.as_ref().is_none_or(|sent| !sent.moving && sent.number == order);
        self.auto_stops = Some(match self.auto_stops {
            Some(before) if !rests => before + FOLLOWS * (stops - before),
            _ => stops,
        });
    }

    /// What of the command line waited for the scene: names.
    fn finish_launch(&mut self) {
        let (Some(launch), Some(card)) = (self.launch.take(), &self.card) else { return };
        let index = |wanted: &str, names: &[&str]| {
            let numbered = || wanted.parse().ok().filter(|&i: &usize| i < names.len());
            names.iter().position(|name| *name == wanted).or_else(numbered)
        };
        match launch.staging.camera.index(&card.cameras) {
            Some(found) => self.camera = found,
            None => self.notes.push(Note::Wrong("there is no such camera".to_owned())),
        }
        let names: Vec<&str> = card.animations.iter().map(|(name, _)| name.as_str()).collect();
        let animation = launch.animation.as_deref().map_or(Some(0), |wanted| index(wanted, &names));
        if launch.at.is_some() || launch.animation.is_some() {
            match animation.filter(|&a| a < names.len()) {
                Some(index) => {
                    let seconds = launch.at.unwrap_or_default();
                    self.playback = Some(Playback { index, seconds, playing: false });
                }
                None => self.notes.push(Note::Wrong("there is no such animation".to_owned())),
            }
        }
    }

    /// Lets time pass: an animation that plays goes on, from its end to its beginning.
    pub fn pass(&mut self, seconds: f32) {
        let (Some(playback), Some(card)) = (&mut self.playback, &self.card) else { return };
        if let Some(&(_, length)) = card.animations.get(playback.index).filter(|_| playback.playing) {
            playback.seconds = if length > 0.0 { (playback.seconds + seconds) % length } else { 0.0 };
        }
    }

    /// The size of the picture, in pixels of the screen.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.size = size.map(|side| side.clamp(*SIDES.start(), *SIDES.end()));
    }

    /// The order, where it is another than the last one.
    pub fn order(&mut self, now: Instant) -> Option<Order> {
        let [width, height] = self.size;
        let pane = |side: &Side| Pane {
            settings: Settings { width, height, camera: self.camera, ..side.settings.clone() },
            layer: side.layer,
        };
        let mut order = Order {
            number: self.sent.as_ref().map_or(0, |order| order.number),
            source: self.source.clone(),
            pose: self.playback.map(|p| (p.index, p.seconds)),
            camera: self.placed(),
            edits: self.edits.clone(),
            panes: self.sides.iter().take(if self.compares { PANES } else { 1 }).map(pane).collect(),
            moving: false,
        };
        if let Some(sent) = self.sent.as_ref().filter(|sent| sent.source == order.source) {
            let places = |order: &Order| order.panes.first().map(|p| [p.settings.width, p.settings.height]);
            let moved = sent.pose != order.pose
                || sent.camera != order.camera
                || sent.edits != order.edits
                || places(sent) != places(&order);
            if moved {
                self.changed = Some(now);
            }
        }
        order.moving = self.changed.is_some_and(|changed| now - changed < SETTLES);
        if self.sent.as_ref() == Some(&order) {
            return None;
        }
        order.number += 1;
        self.sent = Some(order.clone());
        Some(order)
    }

    /// When something happens by itself next: the picture comes to rest.
    #[must_use]
    pub fn rests_at(&self) -> Option<Instant> {
        let moving = self.sent.as_ref().is_some_and(|order| order.moving);
        self.changed.filter(|_| moving).map(|changed| changed + SETTLES)
    }

    /// The command line that renders what the active side shows, and what it leaves out.
    #[must_use]
    pub fn command_line(&self, output: &Path) -> (String, Vec<&'static str>) {
        let side = self.side();
        let mut words = vec!["lightsheaf".to_owned(), "render".to_owned(), self.source.spec.clone(), "-o".to_owned()];
        words.push(output.display().to_string());
        let mut left_out = Vec::new();
        let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
        option("size", format!("{}x{}", self.size[0], self.size[1]));
        let samples = side.picture.as_ref().map_or(1, |p| p.stats.samples.max(1));
        option("samples", samples.to_string());
        // A camera that was chosen for a window of another shape would be another one.
        let chosen = self.base().filter(|camera| camera.name == AUTO);
        if chosen.is_none() && self.camera != 0 {
            option("camera", self.camera.to_string());
        }
        if let Some(Stand { eye, target }) = self.stand.or_else(|| chosen.and_then(|_| self.standing())) {
            let point = |p: glam::Vec3| format!("{},{},{}", p.x, p.y, p.z);
            option("eye", point(eye));
            option("target", point(target));
        }
        let own_fov = chosen.and_then(|camera| match camera.projection {
            Projection::Perspective { fov, .. } => Some(fov.to_degrees()),
            Projection::Orthographic { .. } => None,
        });
        if let Some(degrees) = self.fov.or(own_fov) {
            option("fov", degrees.to_string());
        }
        if let Some(Playback { index, seconds, .. }) = self.playback {
            option("animation", index.to_string());
            option("at", seconds.to_string());
        }
        let EnvironmentChange { source, scale, rotate } = &self.source.staging.environment;
        if let Some(source) = source {
            option("env", source.clone());
        }
        if let Some(scale) = scale {
            option("env-scale", scale.to_string());
        }
        if let Some(radians) = rotate {
            option("env-rotate", radians.to_degrees().to_string());
        }
        if output.extension().is_some_and(|e| e == "png") {
            match self.exposure {
                // The file's own picture would be exposed otherwise than the one that is shown.
                Exposure::Auto if self.active == 0 && side.layer == Layer::Light => {}
                _ => option("exposure", self.grade().stops.to_string()),
            }
            if self.tonemap != Tonemap::default() {
                option("tonemap", self.tonemap.to_string());
            }
        }
        if let Layer::Strategy(_) = side.layer {
            option("strategy-images", "strategies".to_owned());
        }
        words.extend(side.chosen.arguments());
        if !self.edits.is_empty() {
            left_out.push("lights as they were edited");
        }
        if !side.layer.is_radiance() {
            left_out.push("the layer");
        }
        let line: Vec<_> = words.iter().map(|word| quoted(word)).collect();
        (line.join(" "), left_out)
    }

    /// A file of the scene's name that is not there yet, in the current folder.
    #[must_use]
    pub fn free_file(&self, extension: &str) -> PathBuf {
        let spec = self.source.spec.trim_start_matches("builtin:");
        let stem = Path::new(spec).file_stem().map_or_else(|| "view".into(), |s| s.to_string_lossy().into_owned());
        let stem = stem.replace(':', "_");
        let named = |n: u32| PathBuf::from(format!("{stem}_{n:03}.{extension}"));
        (1..1000).map(named).find(|path| !path.exists()).unwrap_or_else(|| named(0))
    }
}

/// A word as shells read it, as it is where that is safe.
fn quoted(word: &str) -> Cow<'_, str> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-+=:,./@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return Cow::Borrowed(word);
    }
    shlex::try_quote(word).unwrap_or(Cow::Borrowed(word))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn launch(spec: &str) -> Launch {
        Launch {
            spec: spec.to_owned(),
            staging: Staging::default(),
            settings: Settings::default(),
            stand: None,
            fov: None,
            animation: None,
            at: None,
            exposure: Exposure::default(),
            tonemap: Tonemap::default(),
        }
    }

    fn loaded(spec: &str) -> State {
        let mut state = State::new(launch(spec));
        let scene = crate::scene::load(spec).unwrap();
        let card = Card {
            spec: spec.to_owned(),
            cameras: scene.cameras.clone(),
            animations: vec![("walk".to_owned(), 2.0)],
            lights: scene.lights.clone(),
            sphere: (Vec3::ZERO, 3.0),
            ..Card::default()
        };
        state.accept(Desk { card: Some(card), ..Desk::default() }, Instant::now());
        state
    }

    #[test]
    fn an_order_is_given_once_and_moves_until_it_rests() {
        let mut state = loaded("builtin:cornell_point");
        state.resize([64, 36]);
        let now = Instant::now();
        let first = state.order(now).unwrap();
        assert_eq!((first.number, first.moving, first.panes.len()), (1, false, 1));
        assert_eq!(first.camera, None, "the scene's own");
        assert!(state.order(now).is_none() && state.rests_at().is_none());

        state.walk(|stand| stand.orbit(0.1, 0.0));
        let moved = state.order(now).unwrap();
        assert!(moved.moving && moved.camera.is_some() && moved.number == 2);
        assert!(state.order(now + SETTLES / 2).is_none());
        let at = state.rests_at().unwrap();
        let rested = state.order(at).unwrap();
        assert!(!rested.moving && rested.camera == moved.camera);

        state.sides[0].use_method(Method::Path);
        assert!(!state.order(at).unwrap().moving, "another method is sharp at once");
        state.compares = true;
        assert_eq!(state.order(at).unwrap().panes.len(), 2);
    }

    #[test]
    fn a_scene_that_cannot_be_loaded_leaves_the_old_one() {
        let mut state = loaded("builtin:cornell_point");
        state.stand = Some(Stand { eye: Vec3::ONE, target: Vec3::ZERO });
        state.open("no.glb");
        assert_eq!((state.source.spec.as_str(), state.stand), ("no.glb", None));
        let notes = vec![Note::NotLoaded("no.glb: is not there".to_owned())];
        state.accept(Desk { notes, ..Desk::default() }, Instant::now());
        assert_eq!(state.source.spec, "builtin:cornell_point");
        assert_eq!(state.notes.len(), 1);
    }

    #[test]
    fn animations_go_round() {
        let mut state = loaded("builtin:cornell_point");
        state.pass(1.0);
        assert_eq!(state.playback, None);
        state.playback = Some(Playback { index: 0, seconds: 1.5, playing: false });
        state.pass(1.0);
        assert_eq!(state.playback.unwrap().seconds, 1.5);
        state.playback.as_mut().unwrap().playing = true;
        state.pass(1.0);
        assert!((state.playback.unwrap().seconds - 0.5).abs() < 1e-6);
    }

    #[test]
    fn methods_that_the_machine_lacks_say_why() {
        let mut state = loaded("builtin:cornell_point");
        assert_eq!(state.lacks(Method::Path), None);
        state.machine.no_rays = Some("no rays".to_owned());
        assert_eq!((state.lacks(Method::Twin), state.lacks(Method::Raster)), (Some("no rays"), None));
        state.machine.no_device = Some("no device".to_owned());
        assert_eq!((state.lacks(Method::Raster), state.lacks(Method::Reference)), (Some("no device"), None));
    }

    #[test]
    fn the_command_line_says_all_that_was_chosen() {
        let mut state = loaded("builtin:cornell_point");
        state.resize([640, 360]);
        let (line, left_out) = state.command_line(Path::new("a.png"));
        assert_eq!(line, "lightsheaf render builtin:cornell_point -o a.png --size 640x360 --samples 1");
        assert!(left_out.is_empty());

        state.stand = Some(Stand { eye: Vec3::new(0.1, -2.5, 3.0), target: Vec3::ZERO });
        state.fov = Some(50.0);
        (state.exposure, state.tonemap) = (Exposure::Stops(1.5), Tonemap::Clip);
        state.playback = Some(Playback { index: 0, seconds: 0.5, playing: false });
        state.sides[0].chosen.0.insert("bounces".to_owned(), "4".to_owned());
        state.sides[0].settle();
        state.edits.emissions.insert(0, Vec3::ONE);
        let (line, left_out) = state.command_line(Path::new("my a.png"));
        for part in [
            "-o 'my a.png'",
            "--eye 0.1,-2.5,3 --target 0,0,0",
            "--fov 50",
            "--animation 0 --at 0.5",
            "--exposure 1.5 --tonemap clip",
            "--bounces 4",
        ] {
            assert!(line.contains(part), "{part}: {line}");
        }
        assert_eq!(left_out.len(), 1);
        let (linear, _) = state.command_line(Path::new("a.exr"));
        assert!(!linear.contains("--exposure") && !linear.contains("--tonemap"), "{linear}");
    }

    fn picture(order: u64, auto_stops: Option<f32>) -> Picture {
        Picture {
            order,
            film: std::sync::Arc::new(crate::film::Film::new(1, 1)),
            layer: if auto_stops.is_some() { Layer::Light } else { Layer::Normal },
            auto_stops,
            coarseness: 1,
            stats: crate::renderer::RenderStats::default(),
            batch: (1, 0.1),
            plan: "".into(),
            vpls: Vec::new(),
            error: None,
            finished: false,
        }
    }

    #[test]
    fn both_panes_have_the_exposure_of_the_first_and_it_follows_slowly_what_moves() {
        let mut state = loaded("builtin:cornell_point");
        let show = |state: &mut State, pictures| {
            state.accept(Desk { pictures, ..Desk::default() }, Instant::now());
            state.grade().stops
        };
        assert_eq!(state.grade().stops, 0.0, "no picture yet");
        let now = Instant::now();
        state.compares = true;
        let rest = state.order(now).unwrap().number;
        assert_eq!(show(&mut state, [Some(picture(rest, Some(2.0))), Some(picture(rest, Some(-3.0)))]), 2.0);
        assert_eq!(show(&mut state, [None, Some(picture(rest, Some(-1.0)))]), 2.0);
        let (line, _) = state.command_line(Path::new("a.png"));
        assert!(!line.contains("--exposure"), "it is the picture's own: {line}");
        state.active = 1;
        let (line, _) = state.command_line(Path::new("a.png"));
        assert!(line.contains("--exposure 2"), "that of the other picture: {line}");

        // A pane of normals has none.
        assert_eq!(show(&mut state, [Some(picture(rest, None)), None]), -1.0);
        state.walk(|stand| stand.orbit(0.1, 0.0));
        let moving = state.order(now).unwrap();
        assert!(moving.moving);
        let moved = show(&mut state, [Some(picture(moving.number, Some(1.0))), None]);
        assert!((moved - -0.8).abs() < 1e-6, "{moved}");
        let rested = state.order(now + SETTLES).unwrap();
        let late = show(&mut state, [Some(picture(moving.number, Some(1.0))), None]);
        assert!(late < 1.0, "a picture of what moved: {late}");
        assert_eq!(show(&mut state, [Some(picture(rested.number, Some(1.25))), None]), 1.25);

        state.exposure = Exposure::Stops(-0.5);
        assert_eq!(state.grade(), Grade { stops: -0.5, tonemap: Tonemap::default() });
    }
}
