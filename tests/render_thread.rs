//! Tests of the viewer's render thread without a window: every request is answered, changes restart
//! accumulation, and a lost device is opened again.
#![cfg(feature = "viewer")]

mod common;

use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use glam::Vec3;
use lightsheaf::exposure::Exposure;
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::render::renderer::Renderer;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Geometry, Light, Scene, Viewpoint, builtin};
use lightsheaf::settings::{OnlyStrategy, Settings, Technique};
use lightsheaf::staging::OrbitCamera;
use lightsheaf::staging::Staging;
use lightsheaf::tonemap::{Grade, Tonemap};
use lightsheaf::viewer::outbox::{Note, Outbox};
use lightsheaf::viewer::render_thread::{RenderThread, open, show_lengths};
use lightsheaf::viewer::request::{Command, Edits, Layer, Machine, Pane, Picture, Request, SceneInfo, Source};
use lightsheaf::viewer::state::{Launch, State};

/// Longest that anything here takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// A render thread and its results.
struct Harness {
    render_thread: RenderThread,
    woken: Receiver<()>,
    seen: Outbox,
    number: u64,
}

impl Harness {
    fn new(open: impl Fn() -> (Option<Gpu>, Machine) + Send + 'static) -> Self {
        let (wake, woken) = channel();
        let render_thread = RenderThread::new(open, move || _ = wake.send(()));
        Self { render_thread, woken, seen: Outbox::default(), number: 0 }
    }

    fn show(&mut self, request: Request) -> u64 {
        self.number += 1;
        self.render_thread.send(Command::Show(Box::new(Request { number: self.number, ..request })));
        self.number
    }

    /// Waits until the outbox has what is looked for.
    fn until<T>(&mut self, what: &str, look: impl Fn(&Outbox) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            let outbox = self.render_thread.take();
            self.seen.machine = outbox.machine.or(self.seen.machine.take());
            self.seen.scene_info = outbox.scene_info.or(self.seen.scene_info.take());
            for (there, new) in self.seen.pictures.iter_mut().zip(outbox.pictures) {
                *there = new.or(there.take());
            }
            self.seen.notes.extend(outbox.notes);
            if let Some(found) = look(&self.seen) {
                return found;
            }
            assert!(began.elapsed() < PATIENCE, "{what} does not come: {:?}", self.seen.notes);
            let _ = self.woken.recv_timeout(Duration::from_millis(200));
        }
    }

    /// Waits for a picture of a request at full resolution, with at least `samples` samples.
    fn picture(&mut self, request: u64, samples: u64) -> Picture {
        let sharp = move |p: &&Picture| p.request == request && p.stats.samples >= samples && p.coarseness == 1;
        self.until("a picture", |outbox| outbox.pictures[0].as_ref().filter(sharp).cloned())
    }

    fn note(&mut self, part: &str) -> Note {
        let text = |note: &Note| match note {
            Note::Done(text) | Note::Wrong(text) | Note::NotLoaded(text) => text.clone(),
        };
        self.until(part, |outbox| outbox.notes.iter().find(|note| text(note).contains(part)).cloned())
    }
}

fn settings(technique: Technique) -> Settings {
    Settings { technique, width: 48, height: 27, ..Settings::plain() }
}

fn request(technique: Technique) -> Request {
    Request {
        number: 0,
        source: Source { spec: "builtin:cornell_point".to_owned(), staging: Staging::default() },
        pose: None,
        camera: None,
        edits: Edits::default(),
        panes: vec![Pane { settings: settings(technique), layer: Layer::Light }],
        moving: false,
    }
}

/// Renders a scene without the thread.
fn rendered(gpu: &Gpu, scene: &Scene, samples: u64) -> Film {
    let mut renderer = SharedRenderer::new(gpu, scene, &settings(Technique::RASTER)).unwrap();
    renderer.render(samples, &mut |_| true).unwrap();
    renderer.film().unwrap()
}

/// The same picture but for rounding of sums that are added up in other batches.
fn same(a: &Film, b: &Film) -> bool {
    compare(a, b).unwrap().rel_mse < 1e-9
}

#[test]
fn pictures_are_those_of_a_renderer_from_everywhere_and_under_every_light() {
    let Some(gpu) = common::gpu() else { return };
    let mut harness = Harness::new(open);
    let scene = builtin::load("cornell_point").unwrap();
    let first = harness.show(request(Technique::RASTER));
    let picture = harness.picture(first, 4);
    assert!(same(&picture.film, &rendered(gpu, &scene, picture.stats.samples)));
    assert!(picture.plan.contains("gbuffer") && picture.stats.bytes > 0 && picture.stats.scene_bytes > 0);
    let SceneInfo { lights, cameras, triangles, .. } = harness.seen.scene_info.clone().unwrap();
    assert_eq!((lights.len(), cameras.len(), triangles), (1, 1, 30));

    // From elsewhere.
    let orbit_camera = OrbitCamera { eye: Vec3::new(0.3, 1.2, 2.5), target: Vec3::new(0.0, 1.0, 0.0) };
    let mut moved = scene.clone();
    moved.cameras[0] = orbit_camera.camera(&scene.cameras[0]);
    let looking = Request { camera: Some(moved.cameras[0].clone()), ..request(Technique::RASTER) };
    let second = harness.show(looking.clone());
    let picture = harness.picture(second, 4);
    let alone = rendered(gpu, &moved, picture.stats.samples);
    assert!(same(&picture.film, &alone));
    assert!(!same(&alone, &rendered(gpu, &scene, picture.stats.samples)), "canary: it is another picture");

    // Under another light.
    let light = Light::Point { position: Vec3::new(0.4, 1.2, 0.3), intensity: Vec3::new(1.0, 2.0, 3.0) };
    moved.lights[0] = light;
    let edits = Edits { lights: [(0, light), (99, light)].into(), ..Edits::default() };
    let third = harness.show(Request { edits, ..looking.clone() });
    let picture = harness.picture(third, 4);
    assert!(same(&picture.film, &rendered(gpu, &moved, picture.stats.samples)));

    // While it moves it may be coarser, and it is sharp when it rests.
    let moving = harness.show(Request { moving: true, ..looking.clone() });
    let coarse = harness.until("a coarse picture", |outbox| outbox.pictures[0].clone().filter(|p| p.request == moving));
    assert_eq!(coarse.film.width, 48_u32.div_ceil(coarse.coarseness));
    let rested = harness.show(looking);
    assert_eq!(harness.picture(rested, 1).film.width, 48);
}

/// Hills that are refined by pixels are so for the camera that looks, once it rests.
#[test]
fn surfaces_are_refined_for_whoever_looks() {
    let Some(gpu) = common::gpu() else { return };
    let mut scene = builtin::load("terrain").unwrap();
    let source = Source { spec: "builtin:terrain".to_owned(), staging: Staging::default() };
    let home = Request { source, ..request(Technique::RASTER) };
    let mut harness = Harness::new(open);
    let number = harness.show(home.clone());
    let picture = harness.picture(number, 1);
    scene.viewpoint = Some(Viewpoint { camera: 0, size: [48, 27] });
    assert!(same(&picture.film, &rendered(gpu, &scene, picture.stats.samples)));

    // From nearer by there are more triangles.
    let far = OrbitCamera::of(&scene.cameras[0], 4.0);
    let near = OrbitCamera { eye: far.eye.lerp(far.target, 0.7), ..far }.camera(&scene.cameras[0]);
    let mut moved = scene.clone();
    moved.cameras[0] = near.clone();
    let triangles = |scene: &Scene| Geometry::new(scene).triangles.len();
    assert!(triangles(&moved) > triangles(&scene), "scope");
    let looking = Request { camera: Some(near.clone()), ..home };
    let bytes = |picture: &Picture| picture.stats.scene_bytes;
    // While it moves, they are those that were there.
    let moving = harness.show(Request { moving: true, ..looking.clone() });
    let coarse = harness.until("a moving picture", |outbox| outbox.pictures[0].clone().filter(|p| p.request == moving));
    assert_eq!(bytes(&coarse), bytes(&picture));
    let number = harness.show(looking);
    let rested = harness.picture(number, 1);
    assert!(bytes(&rested) > bytes(&picture));
    let film = rendered(gpu, &moved, rested.stats.samples);
    assert!(same(&rested.film, &film));
    // The planted error: seen from there, but refined for elsewhere.
    let mut stale = moved;
    stale.cameras.push(scene.cameras[0].clone());
    stale.viewpoint = Some(Viewpoint { camera: 1, size: [48, 27] });
    assert!(!same(&rendered(gpu, &stale, rested.stats.samples), &film));
}

/// Also where lights are chosen for what they give the view, and through a lens.
#[test]
fn looking_elsewhere_is_what_a_new_renderer_shows() {
    let (Some(plain), Some(rays)) = (common::gpu(), common::gpu_with_ray_queries()) else { return };
    let scene = builtin::load("point_hall:64").unwrap();
    let mut moved = scene.clone();
    let orbit_camera = OrbitCamera::of(&scene.cameras[0], 3.0);
    let elsewhere = OrbitCamera { eye: orbit_camera.eye + Vec3::new(0.3, 0.2, -0.5), ..orbit_camera };
    let camera = elsewhere.camera(&scene.cameras[0]).with_lens(Some(0.02), Some(2.0)).unwrap();
    moved.cameras[0] = camera.clone();
    let film = |renderer: &mut dyn Renderer| {
        renderer.render(3, &mut |_| true).unwrap();
        renderer.film().unwrap()
    };
    let raster = settings(Technique::RASTER);
    let mut renderer = SharedRenderer::new(plain, &scene, &raster).unwrap();
    assert!(renderer.plan().lights_for_view, "scope");
    let before = film(&mut renderer);
    renderer.set_camera(&camera).unwrap();
    let after = film(&mut renderer);
    assert_eq!(after, film(&mut SharedRenderer::new(plain, &moved, &raster).unwrap()));
    assert_ne!(before, after, "canary");

    let paths = settings(Technique::RAY_QUERY);
    let mut renderer = PathRenderer::new(rays, &scene, &paths).unwrap();
    film(&mut renderer);
    renderer.set_camera(&camera).unwrap();
    assert_eq!(film(&mut renderer), film(&mut PathRenderer::new(rays, &moved, &paths).unwrap()));
}

#[test]
fn every_method_and_layer_shows_the_box() {
    if common::gpu_with_ray_queries().is_none() {
        return;
    }
    let mut harness = Harness::new(open);
    let mut means = Vec::new();
    for method in [Technique::RASTER, Technique::TWIN, Technique::RAY_QUERY, Technique::PATH, Technique::REFERENCE] {
        let number = harness.show(request(method));
        let picture = harness.picture(number, 16);
        assert_eq!(picture.film.non_finite(), 0);
        means.push(picture.film.pixels.iter().flatten().sum::<f32>());
    }
    let middle = means[4];
    assert!(means.iter().all(|mean| (mean / middle - 1.0).abs() < 0.15), "{means:?}");

    let with = |layer| Request {
        panes: vec![
            Pane { settings: settings(Technique::RASTER), layer },
            Pane { settings: settings(Technique::PATH), layer: Layer::Light },
        ],
        ..request(Technique::RASTER)
    };
    let only = OnlyStrategy { s: 1, t: 2, weighted: true };
    for layer in [Layer::Distance, Layer::Normal, Layer::Albedo, Layer::Strategy(only), Layer::Error, Layer::Lists] {
        let number = harness.show(with(layer));
        let both = harness.until("both pictures", |outbox| {
            let shows = |p: &&Picture| p.request == number && p.layer == layer;
            let beside = outbox.pictures[1].as_ref().filter(|p| p.request == number)?;
            Some((outbox.pictures[0].as_ref().filter(shows)?.clone(), beside.clone()))
        });
        assert_eq!((both.0.layer, both.1.layer), (layer, Layer::Light));
        let film = &both.0.film;
        assert!(film.pixels.iter().flatten().all(|v| (0.0..1e3).contains(v)), "{layer:?}");
        assert!(film.pixels.iter().flatten().any(|&v| v > 0.05), "{layer:?} shows something");
        assert_eq!(both.0.error.is_some(), layer == Layer::Error);
    }
}

/// The renderer counts the entries, and the render thread maps the counts to colours.
#[test]
fn list_lengths_are_those_of_the_bundle_s_lists() {
    let Some(gpu) = common::gpu() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let counted = |scene: &Scene, texels: u32, samples: u64| {
        let base = settings(Technique::RASTER);
        let settings = Settings { list_lengths: true, bundle_resolution: Some(texels), bounces: 0, ..base };
        let mut renderer = SharedRenderer::new(gpu, scene, &settings).unwrap();
        let runs = |name| renderer.plan().passes.iter().find(|p| p.name == name).unwrap().runs;
        assert_eq!([runs("list_lengths"), runs("view_lists"), runs("connect"), runs("extend")], [1, 1, 0, 0]);
        renderer.render(samples, &mut |_| true).unwrap();
        renderer.film().unwrap()
    };
    // The triangle that a pixel sees touches its texel, no list holds one twice, and pixels beside the box
    // see nothing.
    let once = counted(&scene, 128, 1);
    let lengths: Vec<f32> = once.pixels.iter().map(|p| p[0]).collect();
    assert!(lengths.iter().all(|&n| n.fract() == 0.0 && (0.0..=30.0).contains(&n)), "{lengths:?}");
    assert!(lengths.iter().filter(|&&n| n >= 1.0).count() > lengths.len() / 2, "{lengths:?}");
    let mean = |film: &Film| film.pixels.iter().map(|p| p[0]).sum::<f32>() / film.pixels.len() as f32;
    // One texel that all of the box is in, or nearly; the finer, the fewer.
    let [coarse, fine] = [16, 512].map(|texels| mean(&counted(&scene, texels, 16)));
    assert!(coarse > 1.3 * fine && fine >= 2.0, "{coarse} {fine}");
    // The same surfaces twice make lists twice as long.
    let mut twice = scene.clone();
    twice.instances.extend(scene.instances.clone());
    let twice = counted(&twice, 128, 1);
    assert!(twice.pixels.iter().zip(&lengths).all(|(p, n)| p[0] == 2.0 * n), "every entry is there twice");
    // Nothing is looked up where nothing is seen.
    let mut away = scene.clone();
    away.cameras[0] = scene.cameras[0].clone().looking(Vec3::splat(100.0), Vec3::splat(200.0)).unwrap();
    assert_eq!(counted(&away, 128, 1), Film::new(48, 27));

    let mut harness = Harness::new(open);
    let lists = vec![Pane { settings: settings(Technique::RASTER), layer: Layer::Lists }];
    let number = harness.show(Request { panes: lists, ..request(Technique::RASTER) });
    let picture = harness.picture(number, 4);
    let resolution = SharedRenderer::new(gpu, &scene, &settings(Technique::RASTER)).unwrap().plan().bundle_resolution;
    let expected = show_lengths(&counted(&scene, resolution, picture.stats.samples));
    assert!(picture.layer == Layer::Lists && same(&picture.film, &expected));
    assert!(expected.pixels.iter().any(|p| *p != expected.pixels[0]), "scope: it is not all one colour");
    let film = |lengths: [f32; 4]| Film { width: 4, height: 1, pixels: lengths.map(|n| [n; 3]).to_vec() };
    let colors = [[0.0; 3], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
    assert_eq!(show_lengths(&film([0.0, 1.0, 8.0, 300.0])).pixels, colors);
}

#[test]
fn a_lost_device_is_opened_again() {
    if common::gpu().is_none() {
        return;
    }
    let devices: Arc<Mutex<Vec<wgpu::Device>>> = Arc::default();
    let opened = Arc::clone(&devices);
    let mut harness = Harness::new(move || {
        let (gpu, machine) = open();
        opened.lock().unwrap().extend(gpu.as_ref().map(|gpu| gpu.device.clone()));
        (gpu, machine)
    });
    let number = harness.show(request(Technique::RASTER));
    harness.picture(number, 4);
    devices.lock().unwrap()[0].destroy();
    harness.note("opened anew");
    harness.seen.pictures = Default::default();
    let picture = harness.picture(number, 4);
    assert_eq!(devices.lock().unwrap().len(), 2);
    assert!(picture.film.pixels.iter().any(|p| p[0] > 0.1));
}

#[test]
fn without_a_device_the_reference_renders_and_the_rest_says_why() {
    let none = || (None, Machine { no_device: Some("nothing here".to_owned()), ..Machine::default() });
    let mut harness = Harness::new(none);
    harness.show(request(Technique::RASTER));
    harness.note("no graphics device");
    let number = harness.show(request(Technique::REFERENCE));
    let picture = harness.picture(number, 2);
    let scene = builtin::load("cornell_point").unwrap();
    let samples = picture.stats.samples as u32;
    let wanted =
        ReferenceSettings { width: 48, height: 27, samples, bounces: Some(2), specular_bounces: 8, seed: 1, camera: 0 };
    assert!(same(&picture.film, &Reference::new(&scene).render(&wanted, &|_, _| ()).film));
}

#[test]
fn what_cannot_be_had_is_said_and_what_was_there_stays() {
    let mut harness = Harness::new(|| (None, Machine::default()));
    let number = harness.show(request(Technique::REFERENCE));
    harness.picture(number, 1);
    let elsewhere = Source { spec: "no-such.glb".to_owned(), staging: Staging::default() };
    harness.show(Request { source: elsewhere, ..request(Technique::REFERENCE) });
    assert!(matches!(harness.note("no-such.glb"), Note::NotLoaded(_)));
    let mut wrong = request(Technique::REFERENCE);
    wrong.panes[0].settings.focus = Some(2.0);
    harness.show(wrong);
    assert!(matches!(harness.note("pinhole"), Note::Wrong(_)));
    let mut nowhere = request(Technique::REFERENCE);
    nowhere.panes[0].settings.camera = 7;
    harness.show(nowhere);
    harness.note("no camera 7");
    let number = harness.show(request(Technique::REFERENCE));
    harness.picture(number, 1);
}

#[test]
fn pictures_are_written_as_they_were_computed_and_as_they_are_shown() {
    let folder = std::env::temp_dir().join(format!("lightsheaf-render-thread-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut harness = Harness::new(|| (None, Machine::default()));
    let tonemap = Grade { stops: -1.0, tonemap: Tonemap::Aces };
    let save = |name: &str| Command::Save { pane: 0, path: folder.join(name), tonemap };
    harness.render_thread.send(save("early.png"));
    harness.note("no picture");
    let mut dark = request(Technique::REFERENCE);
    dark.panes[0].layer = Layer::Albedo;
    harness.show(dark);
    let number = harness.show(request(Technique::REFERENCE));
    harness.picture(number, 1);
    harness.render_thread.send(save("a.exr"));
    harness.render_thread.send(save("a.png"));
    harness.render_thread.send(save("no/a.png"));
    harness.note("a.exr is written");
    harness.note("a.png is written");
    harness.note("does not exist");
    let (linear, shown) = (Film::load(folder.join("a.exr")).unwrap(), Film::load(folder.join("a.png")).unwrap());
    assert_eq!((linear.width, shown.width), (48, 48));
    assert_eq!(shown.to_srgb8(1.0), tonemap.picture(&linear));
    std::fs::remove_dir_all(folder).unwrap();
}

/// The command line that the panel prints renders the same picture.
#[test]
fn the_command_line_renders_what_is_shown() {
    if common::gpu().is_none() {
        return;
    }
    let folder = std::env::temp_dir().join(format!("lightsheaf-command-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let launch = Launch {
        spec: "builtin:cornell_glossy".to_owned(),
        staging: Staging::default(),
        settings: Settings { bounces: 1, seed: 3, ..Settings::plain() },
        orbit_camera: None,
        fov: Some(50.0),
        animation: None,
        at: None,
        exposure: Exposure::Auto,
        tonemap: Tonemap::Aces,
    };
    let mut state = State::new(launch);
    state.resize([48, 27]);
    let mut harness = Harness::new(open);
    harness.show(state.request(Instant::now()).unwrap());
    harness.until("the scene", |outbox| outbox.scene_info.is_some().then_some(()));
    let seen = std::mem::take(&mut harness.seen);
    state.accept(seen, Instant::now());
    state.move_camera(|orbit_camera| orbit_camera.orbit(0.3, 0.1));
    let request = state.request(Instant::now() + Duration::from_secs(9)).unwrap();
    let number = harness.show(Request { moving: false, ..request });
    let picture = harness.picture(number, 3);
    let film = Arc::clone(&picture.film);
    state.sides[0].picture = Some(picture);
    let file = folder.join("again.exr");
    let (line, left_out) = state.command_line(&file);
    assert!(left_out.is_empty());
    let words = shlex::split(&line).unwrap();
    assert_eq!(words[..2], ["lightsheaf", "render"]);
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_lightsheaf")).args(&words[1..]).arg("-q").status();
    assert!(status.unwrap().success(), "{line}");
    assert!(same(&Film::load(&file).unwrap(), &film), "{line}");
    std::fs::remove_dir_all(folder).unwrap();
}
