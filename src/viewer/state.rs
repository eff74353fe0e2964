//! The user's choices and the newest results: all state of the viewer that does not depend on a window.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::outbox::{Note, Outbox};
use super::render_thread::PANES;
use super::request::{Edits, Layer, Machine, Pane, Picture, Request, SceneInfo, Source};
use super::setting_controls::Chosen;
use crate::exposure::Exposure;
use crate::scene::{Camera, EnvironmentChange, FovAxis, Projection};
use crate::settings::{Method, SIDES, Settings, Technique};
use crate::staging::camera::AUTO;
use crate::staging::{OrbitCamera, Staging};
use crate::tonemap::{Grade, Tonemap};

/// Time after the last change for which the picture counts as moving.
const SETTLES: Duration = Duration::from_millis(300);
/// Fraction of the difference in exposure that each new picture of a moving view applies.
const FOLLOWS: f32 = 0.1;
/// Largest number of messages that are kept.
const NOTES: usize = 20;

/// Options of the command line that opens the viewer.
#[derive(Clone, Debug)]
pub struct Launch {
    /// A path or `builtin:NAME`.
    pub spec: String,
    /// Replacements for the scene's own camera and lights.
    pub staging: Staging,
    /// Settings of both sides at the start.
    pub settings: Settings,
    /// Camera position and target in place of the scene's.
    pub orbit_camera: Option<OrbitCamera>,
    /// Angle of view along the shorter side, degrees.
    pub fov: Option<f32>,
    /// Name or index of an animation.
    pub animation: Option<String>,
    /// Time in the animation, seconds.
    pub at: Option<f32>,
    /// Exposure of displayed pictures.
    pub exposure: Exposure,
    /// Tone curve of displayed pictures.
    pub tonemap: Tonemap,
}

/// The animation that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// Index of the animation.
    pub index: usize,
    /// Time in the animation, seconds.
    pub seconds: f32,
    /// True if time advances.
    pub playing: bool,
}

/// One side of the comparison. Without a comparison only the first is shown.
#[derive(Clone, Debug)]
pub struct Side {
    /// Values of the setting controls, valid or not.
    pub chosen: Chosen,
    /// Settings of the latest valid values.
    pub settings: Settings,
    /// Error message if the values are invalid.
    pub wrong: Option<String>,
    /// Layer of the picture that is shown.
    pub layer: Layer,
    /// Newest picture.
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

    /// Updates the settings from the controls, or stores the error message if they are invalid.
    pub fn validate(&mut self) {
        match self.chosen.settings() {
            Ok(settings) => {
                self.settings = settings;
                self.wrong = None;
            }
            Err(cause) => self.wrong = Some(cause),
        }
        if !self.layer.is_of(self.settings.technique) {
            self.layer = Layer::Light;
        }
    }

    /// Switches to another method. Options that the method does not have return to their defaults.
    pub fn use_method(&mut self, technique: Technique) {
        let Technique { method, visibility } = technique;
        let method = (method != Technique::default().method).then(|| method.to_string());
        for (name, value) in [("method", method), ("visibility", visibility.map(|v| v.to_string()))] {
            match value {
                Some(value) => self.chosen.0.insert(name.to_owned(), value),
                None => self.chosen.0.remove(name),
            };
        }
        self.chosen.remove_invalid();
        self.validate();
    }
}

/// State of the viewer.
#[derive(Clone, Debug)]
pub struct State {
    /// The requested scene.
    pub source: Source,
    /// Description of the scene, once it is loaded.
    pub scene_info: Option<SceneInfo>,
    /// Description of the machine.
    pub machine: Machine,
    /// Left and right side.
    pub sides: [Side; PANES],
    /// True if both sides are shown.
    pub compares: bool,
    /// Position of the divider between the sides, as a fraction of the width.
    pub divider: f32,
    /// Index of the side that the panel controls.
    pub active: usize,
    /// Index of the scene's camera.
    pub camera: usize,
    /// Camera position and target if the user has moved the camera.
    pub orbit_camera: Option<OrbitCamera>,
    /// Angle of view along the shorter side, degrees, in place of the camera's.
    pub fov: Option<f32>,
    /// The animation that is shown; none shows the rest pose.
    pub playback: Option<Playback>,
    /// Differences from the scene's file.
    pub edits: Edits,
    /// Exposure of displayed pictures.
    pub exposure: Exposure,
    /// Tone curve of displayed pictures.
    pub tonemap: Tonemap,
    /// Exposure that [`Exposure::Auto`] has chosen, in stops; none before the first picture.
    pub auto_stops: Option<f32>,
    /// True if VPLs are drawn over the picture.
    pub marks_vpls: bool,
    /// Messages of the render thread, newest last.
    pub notes: Vec<Note>,
    /// Number of shaders that the driver has compiled so far, while it compiles more.
    pub shaders: Option<usize>,
    /// Pictures per second during about the last second.
    pub pictures_a_second: f64,
    launch: Option<Launch>,
    size: [u32; 2],
    sent: Option<Request>,
    changed: Option<Instant>,
    counted: (Option<Instant>, u64),
}

impl State {
    /// Creates the state from the options of the command line.
    #[must_use]
    pub fn new(launch: Launch) -> Self {
        let side = Side::new(&launch.settings);
        Self {
            source: Source { spec: launch.spec.clone(), staging: launch.staging.clone() },
            scene_info: None,
            machine: Machine::default(),
            sides: [side.clone(), side],
            compares: false,
            divider: 0.5,
            active: 0,
            camera: 0,
            orbit_camera: launch.orbit_camera,
            fov: launch.fov,
            playback: None,
            edits: Edits::default(),
            exposure: launch.exposure,
            tonemap: launch.tonemap,
            auto_stops: None,
            marks_vpls: false,
            notes: Vec::new(),
            shaders: None,
            pictures_a_second: 0.0,
            launch: Some(launch),
            size: [1, 1],
            sent: None,
            changed: None,
            counted: (None, 0),
        }
    }

    /// Opens another scene with its file's camera, pose and lights.
    pub fn open(&mut self, spec: &str) {
        self.source = Source { spec: spec.to_owned(), staging: Staging { size: self.size, ..Staging::default() } };
        self.edits = Edits::default();
        (self.camera, self.orbit_camera, self.fov, self.playback) = (0, None, None, None);
    }

    /// Returns the reason why this machine cannot run a method; none if it can.
    #[must_use]
    pub fn lacks(&self, technique: Technique) -> Option<&str> {
        let Machine { no_device, no_rays, .. } = &self.machine;
        match technique.method {
            Method::Reference => None,
            _ if technique.needs_ray_queries() => no_rays.as_deref(),
            _ => no_device.as_deref(),
        }
    }

    /// Returns the active side.
    fn side(&self) -> &Side {
        &self.sides[self.active]
    }

    /// Returns the scene's camera that the user started from; none if there is no scene or no such camera.
    fn base(&self) -> Option<&Camera> {
        self.scene_info.as_ref()?.cameras.get(self.camera)
    }

    /// Returns the user's camera position and target, or those of the scene's camera.
    #[must_use]
    pub fn current_orbit_camera(&self) -> Option<OrbitCamera> {
        let (scene_info, base) = (self.scene_info.as_ref()?, self.base()?);
        Some(self.orbit_camera.unwrap_or_else(|| OrbitCamera::around(base, scene_info.sphere)))
    }

    /// Changes the camera's position and target.
    pub fn move_camera(&mut self, step: impl FnOnce(&mut OrbitCamera)) {
        if let Some(mut orbit_camera) = self.current_orbit_camera() {
            step(&mut orbit_camera);
            self.orbit_camera = Some(orbit_camera);
        }
    }

    /// Returns the unit of camera motion in metres, which is the scene's radius.
    #[must_use]
    pub fn stride(&self) -> f32 {
        self.scene_info.as_ref().map_or(1.0, |scene_info| scene_info.sphere.1)
    }

    /// Returns the camera if it differs from the scene's own.
    fn placed(&self) -> Option<Camera> {
        let base = self.base().filter(|_| self.orbit_camera.is_some() || self.fov.is_some())?;
        let mut camera = self.orbit_camera.map_or_else(|| base.clone(), |orbit_camera| orbit_camera.camera(base));
        if let Some(degrees) = self.fov {
            camera.projection = Projection::Perspective { fov: degrees.to_radians(), axis: FovAxis::Smaller };
        }
        Some(camera)
    }

    /// Applies the results of the render thread.
    pub fn accept(&mut self, outbox: Outbox, now: Instant) {
        if let Some(machine) = outbox.machine {
            self.machine = machine;
        }
        if let Some(scene_info) = outbox.scene_info {
            self.sides.iter_mut().for_each(|side| side.picture = None);
            self.auto_stops = None;
            self.notes.extend(scene_info.warnings.iter().map(|text| Note::Wrong(text.clone())));
            self.notes.extend(scene_info.notes.iter().map(|text| Note::Done(text.clone())));
            self.scene_info = Some(scene_info);
            self.finish_launch();
        }
        for note in outbox.notes {
            if let (Note::NotLoaded(_), Some(scene_info)) = (&note, &self.scene_info) {
                self.source = Source { spec: scene_info.spec.clone(), ..self.source.clone() };
            }
            self.notes.push(note);
        }
        let surplus = self.notes.len().saturating_sub(NOTES);
        self.notes.drain(..surplus);
        self.shaders = outbox.shaders.or(self.shaders.filter(|_| outbox.pictures.iter().all(Option::is_none)));
        for (side, (picture, preview)) in self.sides.iter_mut().zip(outbox.pictures.into_iter().zip(outbox.previews)) {
            side.picture = picture.or(side.picture.take()).or(preview);
        }
        self.expose();
        let (since, count) = self.counted;
        match since {
            Some(since) if now - since > Duration::from_secs(1) => {
                self.pictures_a_second = (outbox.count - count) as f64 / (now - since).as_secs_f64();
                self.counted = (Some(now), outbox.count);
            }
            Some(_) => {}
            None => self.counted = (Some(now), outbox.count),
        }
    }

    /// Returns exposure and tone curve of displayed pictures.
    #[must_use]
    pub fn display_tonemap(&self) -> Grade {
        let stops = match self.exposure {
            Exposure::Auto => self.auto_stops.unwrap_or_default(),
            Exposure::Stops(stops) => stops,
        };
        Grade { stops, tonemap: self.tonemap }
    }

    /// Takes the exposure of the first pane's picture for both panes, so that they can be compared. While the
    /// picture moves, the exposure approaches its new value slowly, which avoids flicker.
    fn expose(&mut self) {
        let exposed = |picture: &Picture| picture.auto_stops.map(|stops| (picture.request, stops));
        let mut pictures = self.sides.iter().filter_map(|side| side.picture.as_ref());
        let Some((request, stops)) = pictures.find_map(exposed) else { return };
        let rests = self.sent.as_ref().is_none_or(|sent| !sent.moving && sent.number == request);
        self.auto_stops = Some(match self.auto_stops {
            Some(before) if !rests => before + FOLLOWS * (stops - before),
            _ => stops,
        });
    }

    /// Resolves the camera and the animation of the command line by name or index, which needs the loaded
    /// scene.
    fn finish_launch(&mut self) {
        let (Some(launch), Some(scene_info)) = (self.launch.take(), &self.scene_info) else { return };
        let index = |wanted: &str, names: &[&str]| {
            let numbered = || wanted.parse().ok().filter(|&i: &usize| i < names.len());
            names.iter().position(|name| *name == wanted).or_else(numbered)
        };
        match launch.staging.camera.index(&scene_info.cameras) {
            Some(found) => self.camera = found,
            None => self.notes.push(Note::Wrong("there is no such camera".to_owned())),
        }
        let names: Vec<&str> = scene_info.animations.iter().map(|(name, _)| name.as_str()).collect();
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

    /// Advances the time of a playing animation, which repeats from its beginning.
    pub fn advance_animation(&mut self, seconds: f32) {
        let (Some(playback), Some(scene_info)) = (&mut self.playback, &self.scene_info) else { return };
        if let Some(&(_, length)) = scene_info.animations.get(playback.index).filter(|_| playback.playing) {
            playback.seconds = if length > 0.0 { (playback.seconds + seconds) % length } else { 0.0 };
        }
    }

    /// Sets the size of the picture in pixels of the screen.
    pub fn resize(&mut self, size: [u32; 2]) {
        self.size = size.map(|side| side.clamp(*SIDES.start(), *SIDES.end()));
    }

    /// Returns the request for the current state if it differs from the last one.
    pub fn request(&mut self, now: Instant) -> Option<Request> {
        let [width, height] = self.size;
        let pane = |side: &Side| Pane {
            settings: Settings { width, height, camera: self.camera, ..side.settings.clone() },
            layer: side.layer,
        };
        let mut request = Request {
            number: self.sent.as_ref().map_or(0, |request| request.number),
            source: self.source.clone(),
            pose: self.playback.map(|p| (p.index, p.seconds)),
            camera: self.placed(),
            edits: self.edits.clone(),
            panes: self.sides.iter().take(if self.compares { PANES } else { 1 }).map(pane).collect(),
            moving: false,
        };
        if let Some(sent) = self.sent.as_ref().filter(|sent| sent.source == request.source) {
            let places = |request: &Request| request.panes.first().map(|p| [p.settings.width, p.settings.height]);
            let moved = sent.pose != request.pose
                || sent.camera != request.camera
                || sent.edits != request.edits
                || places(sent) != places(&request);
            if moved {
                self.changed = Some(now);
            }
        }
        request.moving = self.changed.is_some_and(|changed| now - changed < SETTLES);
        if self.sent.as_ref() == Some(&request) {
            return None;
        }
        request.number += 1;
        self.sent = Some(request.clone());
        Some(request)
    }

    /// Returns the time at which a moving picture comes to rest and needs a new request.
    #[must_use]
    pub fn rests_at(&self) -> Option<Instant> {
        let moving = self.sent.as_ref().is_some_and(|request| request.moving);
        self.changed.filter(|_| moving).map(|changed| changed + SETTLES)
    }

    /// Returns the command line that renders the active side's picture, and the names of what it cannot
    /// express.
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
        // The automatic camera depends on the shape of the window, so its position is written out.
        let chosen = self.base().filter(|camera| camera.name == AUTO);
        if chosen.is_none() && self.camera != 0 {
            option("camera", self.camera.to_string());
        }
        if let Some(OrbitCamera { eye, target }) =
            self.orbit_camera.or_else(|| chosen.and_then(|_| self.current_orbit_camera()))
        {
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
        if crate::film::has_extension(output, "png") {
            match self.exposure {
                // The exposure of the file's own picture would differ from the displayed one.
                Exposure::Auto if self.active == 0 && side.layer == Layer::Light => {}
                _ => option("exposure", self.display_tonemap().stops.to_string()),
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

    /// Returns a file name made from the scene's name that is not in use in the current folder.
    #[must_use]
    pub fn free_file(&self, extension: &str) -> PathBuf {
        let spec = self.source.spec.trim_start_matches("builtin:");
        let stem = Path::new(spec).file_stem().map_or_else(|| "view".into(), |s| s.to_string_lossy().into_owned());
        let stem = stem.replace(':', "_");
        let named = |n: u32| PathBuf::from(format!("{stem}_{n:03}.{extension}"));
        (1..1000).map(named).find(|path| !path.exists()).unwrap_or_else(|| named(0))
    }
}

/// Quotes a word for the shell where that is necessary.
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
            orbit_camera: None,
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
        let scene_info = SceneInfo {
            spec: spec.to_owned(),
            cameras: scene.cameras.clone(),
            animations: vec![("walk".to_owned(), 2.0)],
            lights: scene.lights.clone(),
            sphere: (Vec3::ZERO, 3.0),
            ..SceneInfo::default()
        };
        state.accept(Outbox { scene_info: Some(scene_info), ..Outbox::default() }, Instant::now());
        state
    }

    #[test]
    fn a_request_is_sent_once_and_moves_until_it_rests() {
        let mut state = loaded("builtin:cornell_point");
        state.resize([64, 36]);
        let now = Instant::now();
        let first = state.request(now).unwrap();
        assert_eq!((first.number, first.moving, first.panes.len()), (1, false, 1));
        assert_eq!(first.camera, None, "the scene's own");
        assert!(state.request(now).is_none() && state.rests_at().is_none());

        state.move_camera(|orbit_camera| orbit_camera.orbit(0.1, 0.0));
        let moved = state.request(now).unwrap();
        assert!(moved.moving && moved.camera.is_some() && moved.number == 2);
        assert!(state.request(now + SETTLES / 2).is_none());
        let at = state.rests_at().unwrap();
        let rested = state.request(at).unwrap();
        assert!(!rested.moving && rested.camera == moved.camera);

        state.sides[0].use_method(Technique::PATH);
        assert!(!state.request(at).unwrap().moving, "another method is sharp at once");
        state.compares = true;
        assert_eq!(state.request(at).unwrap().panes.len(), 2);
    }

    #[test]
    fn a_scene_that_cannot_be_loaded_leaves_the_old_one() {
        let mut state = loaded("builtin:cornell_point");
        state.orbit_camera = Some(OrbitCamera { eye: Vec3::ONE, target: Vec3::ZERO });
        state.open("no.glb");
        assert_eq!((state.source.spec.as_str(), state.orbit_camera), ("no.glb", None));
        let notes = vec![Note::NotLoaded("no.glb: is not there".to_owned())];
        state.accept(Outbox { notes, ..Outbox::default() }, Instant::now());
        assert_eq!(state.source.spec, "builtin:cornell_point");
        assert_eq!(state.notes.len(), 1);
    }

    #[test]
    fn animations_go_round() {
        let mut state = loaded("builtin:cornell_point");
        state.advance_animation(1.0);
        assert_eq!(state.playback, None);
        state.playback = Some(Playback { index: 0, seconds: 1.5, playing: false });
        state.advance_animation(1.0);
        assert_eq!(state.playback.unwrap().seconds, 1.5);
        state.playback.as_mut().unwrap().playing = true;
        state.advance_animation(1.0);
        assert!((state.playback.unwrap().seconds - 0.5).abs() < 1e-6);
    }

    #[test]
    fn methods_that_the_machine_lacks_say_why() {
        let mut state = loaded("builtin:cornell_point");
        assert_eq!(state.lacks(Technique::PATH), None);
        state.machine.no_rays = Some("no rays".to_owned());
        assert_eq!((state.lacks(Technique::TWIN), state.lacks(Technique::RASTER)), (Some("no rays"), None));
        state.machine.no_device = Some("no device".to_owned());
        assert_eq!((state.lacks(Technique::RASTER), state.lacks(Technique::REFERENCE)), (Some("no device"), None));
    }

    #[test]
    fn the_command_line_says_all_that_was_chosen() {
        let mut state = loaded("builtin:cornell_point");
        state.resize([640, 360]);
        let (line, left_out) = state.command_line(Path::new("a.png"));
        assert_eq!(line, "lightsheaf render builtin:cornell_point -o a.png --size 640x360 --samples 1");
        assert!(left_out.is_empty());

        state.orbit_camera = Some(OrbitCamera { eye: Vec3::new(0.1, -2.5, 3.0), target: Vec3::ZERO });
        state.fov = Some(50.0);
        (state.exposure, state.tonemap) = (Exposure::Stops(1.5), Tonemap::Clip);
        state.playback = Some(Playback { index: 0, seconds: 0.5, playing: false });
        state.sides[0].chosen.0.insert("bounces".to_owned(), "4".to_owned());
        state.sides[0].validate();
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

    fn picture(request: u64, auto_stops: Option<f32>) -> Picture {
        Picture {
            request,
            film: std::sync::Arc::new(crate::film::Film::new(1, 1)),
            layer: if auto_stops.is_some() { Layer::Light } else { Layer::Normal },
            auto_stops,
            coarseness: 1,
            stats: crate::render::RenderStats { samples: 1, ..Default::default() },
            batch: (1, 0.1),
            plan: "".into(),
            vpls: Vec::new(),
            error: None,
            finished: false,
        }
    }

    #[test]
    fn a_preview_and_its_shaders_give_way_to_the_first_picture() {
        let mut state = loaded("builtin:cornell_point");
        let mut shown = |outbox| {
            state.accept(outbox, Instant::now());
            (state.sides[0].picture.as_ref().is_some_and(Picture::is_preview), state.shaders)
        };
        let preview = || Some(Picture { stats: crate::render::RenderStats::default(), ..picture(1, None) });
        let early = Outbox { previews: [preview(), None], shaders: Some(3), ..Outbox::default() };
        assert_eq!(shown(early), (true, Some(3)));
        assert_eq!(shown(Outbox::default()), (true, Some(3)));
        let first = Outbox { pictures: [Some(picture(1, Some(0.0))), None], ..Outbox::default() };
        assert_eq!(shown(first), (false, None));
        // One that comes late is not shown.
        assert_eq!(shown(Outbox { previews: [preview(), None], ..Outbox::default() }), (false, None));
    }

    #[test]
    fn both_panes_have_the_exposure_of_the_first_and_it_follows_slowly_what_moves() {
        let mut state = loaded("builtin:cornell_point");
        let show = |state: &mut State, pictures| {
            state.accept(Outbox { pictures, ..Outbox::default() }, Instant::now());
            state.display_tonemap().stops
        };
        assert_eq!(state.display_tonemap().stops, 0.0, "no picture yet");
        let now = Instant::now();
        state.compares = true;
        let rest = state.request(now).unwrap().number;
        assert_eq!(show(&mut state, [Some(picture(rest, Some(2.0))), Some(picture(rest, Some(-3.0)))]), 2.0);
        assert_eq!(show(&mut state, [None, Some(picture(rest, Some(-1.0)))]), 2.0);
        let (line, _) = state.command_line(Path::new("a.png"));
        assert!(!line.contains("--exposure"), "it is the picture's own: {line}");
        state.active = 1;
        let (line, _) = state.command_line(Path::new("a.png"));
        assert!(line.contains("--exposure 2"), "that of the other picture: {line}");

        // A pane of normals has no exposure.
        assert_eq!(show(&mut state, [Some(picture(rest, None)), None]), -1.0);
        state.move_camera(|orbit_camera| orbit_camera.orbit(0.1, 0.0));
        let moving = state.request(now).unwrap();
        assert!(moving.moving);
        let moved = show(&mut state, [Some(picture(moving.number, Some(1.0))), None]);
        assert!((moved - -0.8).abs() < 1e-6, "{moved}");
        let rested = state.request(now + SETTLES).unwrap();
        let late = show(&mut state, [Some(picture(moving.number, Some(1.0))), None]);
        assert!(late < 1.0, "a picture of what moved: {late}");
        assert_eq!(show(&mut state, [Some(picture(rested.number, Some(1.25))), None]), 1.25);

        state.exposure = Exposure::Stops(-0.5);
        assert_eq!(state.display_tonemap(), Grade { stops: -0.5, tonemap: Tonemap::default() });
    }
}
