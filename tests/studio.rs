//! The viewer's studio, without a window: what is ordered comes, what changes begins anew, what is lost comes back.
#![cfg(feature = "viewer")]

mod common;

use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use glam::Vec3;
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::renderer::{Progressive, Renderer};
use lightsheaf::scene::{Geometry, Light, Scene, Viewpoint, builtin};
use lightsheaf::settings::{Method, OnlyStrategy, Settings};
use lightsheaf::staging::Staging;
use lightsheaf::tonemap::{Exposure, Grade, Tonemap};
use lightsheaf::viewer::order::{Card, Command, Edits, Layer, Machine, Order, Pane, Picture, Source};
use lightsheaf::viewer::stand::Stand;
use lightsheaf::viewer::state::{Launch, State};
use lightsheaf::viewer::studio::{Desk, Note, Studio, open, show_lengths};

/// Longest that anything here takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// A studio and what it said.
struct Bench {
    studio: Studio,
    woken: Receiver<()>,
    seen: Desk,
    number: u64,
}

impl Bench {
    fn new(open: impl Fn() -> (Option<Gpu>, Machine) + Send + 'static) -> Self {
        let (wake, woken) = channel();
        let studio = Studio::new(open, move || _ = wake.send(()));
        Self { studio, woken, seen: Desk::default(), number: 0 }
    }

    fn show(&mut self, order: Order) -> u64 {
        self.number += 1;
        self.studio.send(Command::Show(Box::new(Order { number: self.number, ..order })));
        self.number
    }

    /// Waits until the desk has what is looked for.
    fn until<T>(&mut self, what: &str, look: impl Fn(&Desk) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            let desk = self.studio.take();
            self.seen.machine = desk.machine.or(self.seen.machine.take());
            self.seen.card = desk.card.or(self.seen.card.take());
            for (there, new) in self.seen.pictures.iter_mut().zip(desk.pictures) {
                *there = new.or(there.take());
            }
            self.seen.notes.extend(desk.notes);
            if let Some(found) = look(&self.seen) {
                return found;
            }
            assert!(began.elapsed() < PATIENCE, "{what} does not come: {:?}", self.seen.notes);
            let _ = self.woken.recv_timeout(Duration::from_millis(200));
        }
    }

    /// A picture of an order, with so many samples at least and every pixel.
    fn picture(&mut self, order: u64, samples: u64) -> Picture {
        let sharp = move |p: &&Picture| p.order == order && p.stats.samples >= samples && p.coarseness == 1;
        self.until("a picture", |desk| desk.pictures[0].as_ref().filter(sharp).cloned())
    }

    fn note(&mut self, part: &str) -> Note {
        let text = |note: &Note| match note {
            Note::Done(text) | Note::Wrong(text) | Note::NotLoaded(text) => text.clone(),
        };
        self.until(part, |desk| desk.notes.iter().find(|note| text(note).contains(part)).cloned())
    }
}

fn settings(method: Method) -> Settings {
    Settings { method, width: 48, height: 27, ..Settings::plain() }
}

fn order(method: Method) -> Order {
    Order {
        number: 0,
        source: Source { spec: "builtin:cornell_point".to_owned(), staging: Staging::default() },
        pose: None,
        camera: None,
        edits: Edits::default(),
        panes: vec![Pane { settings: settings(method), layer: Layer::Light }],
        moving: false,
    }
}

/// What a renderer makes of a scene by itself.
fn rendered(gpu: &Gpu, scene: &Scene, samples: u64) -> Film {
    let mut renderer = Renderer::new(gpu, scene, &settings(Method::Raster)).unwrap();
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
    let mut bench = Bench::new(open);
    let scene = builtin::load("cornell_point").unwrap();
    let first = bench.show(order(Method::Raster));
    let picture = bench.picture(first, 4);
    assert!(same(&picture.film, &rendered(gpu, &scene, picture.stats.samples)));
    assert!(picture.plan.contains("gbuffer") && picture.stats.bytes > 0 && picture.stats.scene_bytes > 0);
    let Card { lights, cameras, triangles, .. } = bench.seen.card.clone().unwrap();
    assert_eq!((lights.len(), cameras.len(), triangles), (1, 1, 30));

    // From elsewhere.
    let stand = Stand { eye: Vec3::new(0.3, 1.2, 2.5), target: Vec3::new(0.0, 1.0, 0.0) };
    let mut moved = scene.clone();
    moved.cameras[0] = stand.camera(&scene.cameras[0]);
    let looking = Order { camera: Some(moved.cameras[0].clone()), ..order(Method::Raster) };
    let second = bench.show(looking.clone());
    let picture = bench.picture(second, 4);
    let alone = rendered(gpu, &moved, picture.stats.samples);
    assert!(same(&picture.film, &alone));
    assert!(!same(&alone, &rendered(gpu, &scene, picture.stats.samples)), "canary: it is another picture");

    // Under another light.
    let light = Light::Point { position: Vec3::new(0.4, 1.2, 0.3), intensity: Vec3::new(1.0, 2.0, 3.0) };
    moved.lights[0] = light;
    let edits = Edits { lights: [(0, light), (99, light)].into(), ..Edits::default() };
    let third = bench.show(Order { edits, ..looking.clone() });
    let picture = bench.picture(third, 4);
    assert!(same(&picture.film, &rendered(gpu, &moved, picture.stats.samples)));

    // While it moves it may be coarser, and it is sharp when it rests.
    let moving = bench.show(Order { moving: true, ..looking.clone() });
    let coarse = bench.until("a coarse picture", |desk| desk.pictures[0].clone().filter(|p| p.order == moving));
    assert_eq!(coarse.film.width, 48_u32.div_ceil(coarse.coarseness));
    let rested = bench.show(looking);
    assert_eq!(bench.picture(rested, 1).film.width, 48);
}

/// Hills that are refined by pixels are so for the camera that looks, once it rests.
#[test]
fn surfaces_are_refined_for_whoever_looks() {
    let Some(gpu) = common::gpu() else { return };
    let mut scene = builtin::load("terrain").unwrap();
    let source = Source { spec: "builtin:terrain".to_owned(), staging: Staging::default() };
    let home = Order { source, ..order(Method::Raster) };
    let mut bench = Bench::new(open);
    let number = bench.show(home.clone());
    let picture = bench.picture(number, 1);
    scene.viewpoint = Some(Viewpoint { camera: 0, size: [48, 27] });
    assert!(same(&picture.film, &rendered(gpu, &scene, picture.stats.samples)));

    // From nearer by there are more triangles.
    let far = Stand::of(&scene.cameras[0], 4.0);
    let near = Stand { eye: far.eye.lerp(far.target, 0.7), ..far }.camera(&scene.cameras[0]);
    let mut moved = scene.clone();
    moved.cameras[0] = near.clone();
    let triangles = |scene: &Scene| Geometry::new(scene).triangles.len();
    assert!(triangles(&moved) > triangles(&scene), "scope");
    let looking = Order { camera: Some(near.clone()), ..home };
    let bytes = |picture: &Picture| picture.stats.scene_bytes;
    // While it moves, they are those that were there.
    let moving = bench.show(Order { moving: true, ..looking.clone() });
    let coarse = bench.until("a moving picture", |desk| desk.pictures[0].clone().filter(|p| p.order == moving));
    assert_eq!(bytes(&coarse), bytes(&picture));
    let number = bench.show(looking);
    let rested = bench.picture(number, 1);
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
    let stand = Stand::of(&scene.cameras[0], 3.0);
    let elsewhere = Stand { eye: stand.eye + Vec3::new(0.3, 0.2, -0.5), ..stand };
    let camera = elsewhere.camera(&scene.cameras[0]).with_lens(Some(0.02), Some(2.0)).unwrap();
    moved.cameras[0] = camera.clone();
    let film = |renderer: &mut dyn Progressive| {
        renderer.render(3, &mut |_| true).unwrap();
        renderer.film().unwrap()
    };
    let raster = settings(Method::Raster);
    let mut renderer = Renderer::new(plain, &scene, &raster).unwrap();
    assert!(renderer.plan().lights_for_view, "scope");
    let before = film(&mut renderer);
    renderer.look(&camera).unwrap();
    let after = film(&mut renderer);
    assert_eq!(after, film(&mut Renderer::new(plain, &moved, &raster).unwrap()));
    assert_ne!(before, after, "canary");

    let paths = settings(Method::RayQuery);
    let mut renderer = PathRenderer::new(rays, &scene, &paths).unwrap();
    film(&mut renderer);
    renderer.look(&camera);
    assert_eq!(film(&mut renderer), film(&mut PathRenderer::new(rays, &moved, &paths).unwrap()));
}

#[test]
fn every_method_and_layer_shows_the_box() {
    if common::gpu_with_ray_queries().is_none() {
        return;
    }
    let mut bench = Bench::new(open);
    let mut means = Vec::new();
    for method in [Method::Raster, Method::Twin, Method::RayQuery, Method::Path, Method::Reference] {
        let number = bench.show(order(method));
        let picture = bench.picture(number, 16);
        assert_eq!(picture.film.non_finite(), 0);
        means.push(picture.film.pixels.iter().flatten().sum::<f32>());
    }
    let middle = means[4];
    assert!(means.iter().all(|mean| (mean / middle - 1.0).abs() < 0.15), "{means:?}");

    let with = |layer| Order {
        panes: vec![
            Pane { settings: settings(Method::Raster), layer },
            Pane { settings: settings(Method::Path), layer: Layer::Light },
        ],
        ..order(Method::Raster)
    };
    let only = OnlyStrategy { s: 1, t: 2, weighted: true };
    for layer in [Layer::Distance, Layer::Normal, Layer::Albedo, Layer::Strategy(only), Layer::Error, Layer::Lists] {
        let number = bench.show(with(layer));
        let both = bench.until("both pictures", |desk| {
            let shows = |p: &&Picture| p.order == number && p.layer == layer;
            let beside = desk.pictures[1].as_ref().filter(|p| p.order == number)?;
            Some((desk.pictures[0].as_ref().filter(shows)?.clone(), beside.clone()))
        });
        assert_eq!((both.0.layer, both.1.layer), (layer, Layer::Light));
        let film = &both.0.film;
        assert!(film.pixels.iter().flatten().all(|v| (0.0..1e3).contains(v)), "{layer:?}");
        assert!(film.pixels.iter().flatten().any(|&v| v > 0.05), "{layer:?} shows something");
        assert_eq!(both.0.error.is_some(), layer == Layer::Error);
    }
}

/// Counted by the renderer, in colours by the studio.
#[test]
fn list_lengths_are_those_of_the_bundle_s_lists() {
    let Some(gpu) = common::gpu() else { return };
    let scene = builtin::load("cornell_point").unwrap();
    let counted = |scene: &Scene, texels: u32, samples: u64| {
        let base = settings(Method::Raster);
        let settings = Settings { list_lengths: true, bundle_resolution: Some(texels), bounces: 0, ..base };
        let mut renderer = Renderer::new(gpu, scene, &settings).unwrap();
        let runs = |name| renderer.plan().passes.iter().find(|p| p.name == name).unwrap().runs;
        assert_eq!([runs("list_lengths"), runs("view_lists"), runs("connect"), runs("extend")], [1, 1, 0, 0]);
        renderer.render(samples, &mut |_| true).unwrap();
        renderer.film().unwrap()
    };
    // What a pixel sees touches its texel, nothing is in a list twice, and pixels beside the box see nothing.
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

    let mut bench = Bench::new(open);
    let lists = vec![Pane { settings: settings(Method::Raster), layer: Layer::Lists }];
    let number = bench.show(Order { panes: lists, ..order(Method::Raster) });
    let picture = bench.picture(number, 4);
    let resolution = Renderer::new(gpu, &scene, &settings(Method::Raster)).unwrap().plan().bundle_resolution;
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
    let mut bench = Bench::new(move || {
        let (gpu, machine) = open();
        opened.lock().unwrap().extend(gpu.as_ref().map(|gpu| gpu.device.clone()));
        (gpu, machine)
    });
    let number = bench.show(order(Method::Raster));
    bench.picture(number, 4);
    devices.lock().unwrap()[0].destroy();
    bench.note("opened anew");
    bench.seen.pictures = Default::default();
    let picture = bench.picture(number, 4);
    assert_eq!(devices.lock().unwrap().len(), 2);
    assert!(picture.film.pixels.iter().any(|p| p[0] > 0.1));
}

#[test]
fn without_a_device_the_reference_renders_and_the_rest_says_why() {
    let none = || (None, Machine { no_device: Some("nothing here".to_owned()), ..Machine::default() });
    let mut bench = Bench::new(none);
    bench.show(order(Method::Raster));
    bench.note("no graphics device");
    let number = bench.show(order(Method::Reference));
    let picture = bench.picture(number, 2);
    let scene = builtin::load("cornell_point").unwrap();
    let samples = picture.stats.samples as u32;
    let wanted = ReferenceSettings { width: 48, height: 27, samples, bounces: Some(2), seed: 1, camera: 0 };
    assert!(same(&picture.film, &Reference::new(&scene).render(&wanted, &|_, _| ()).film));
}

#[test]
fn what_cannot_be_had_is_said_and_what_was_there_stays() {
    let mut bench = Bench::new(|| (None, Machine::default()));
    let number = bench.show(order(Method::Reference));
    bench.picture(number, 1);
    let elsewhere = Source { spec: "no-such.glb".to_owned(), staging: Staging::default() };
    bench.show(Order { source: elsewhere, ..order(Method::Reference) });
    assert!(matches!(bench.note("no-such.glb"), Note::NotLoaded(_)));
    let mut wrong = order(Method::Reference);
    wrong.panes[0].settings.focus = Some(2.0);
    bench.show(wrong);
    assert!(matches!(bench.note("pinhole"), Note::Wrong(_)));
    let mut nowhere = order(Method::Reference);
    nowhere.panes[0].settings.camera = 7;
    bench.show(nowhere);
    bench.note("no camera 7");
    let number = bench.show(order(Method::Reference));
    bench.picture(number, 1);
}

#[test]
fn pictures_are_written_as_they_were_computed_and_as_they_are_shown() {
    let folder = std::env::temp_dir().join(format!("lightsheaf-studio-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let mut bench = Bench::new(|| (None, Machine::default()));
    let grade = Grade { stops: -1.0, tonemap: Tonemap::Aces };
    let save = |name: &str| Command::Save { pane: 0, path: folder.join(name), grade };
    bench.studio.send(save("early.png"));
    bench.note("no picture");
    let mut dark = order(Method::Reference);
    dark.panes[0].layer = Layer::Albedo;
    bench.show(dark);
    let number = bench.show(order(Method::Reference));
    bench.picture(number, 1);
    bench.studio.send(save("a.exr"));
    bench.studio.send(save("a.png"));
    bench.studio.send(save("no/a.png"));
    bench.note("a.exr is written");
    bench.note("a.png is written");
    bench.note("does not exist");
    let (linear, shown) = (Film::load(folder.join("a.exr")).unwrap(), Film::load(folder.join("a.png")).unwrap());
    assert_eq!((linear.width, shown.width), (48, 48));
    assert_eq!(shown.to_srgb8(1.0), grade.picture(&linear));
    std::fs::remove_dir_all(folder).unwrap();
}

/// What the panel prints, the program renders: the same picture.
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
        stand: None,
        fov: Some(50.0),
        animation: None,
        at: None,
        exposure: Exposure::Auto,
        tonemap: Tonemap::Aces,
    };
    let mut state = State::new(launch);
    state.resize([48, 27]);
    let mut bench = Bench::new(open);
    bench.show(state.order(Instant::now()).unwrap());
    bench.until("the scene", |desk| desk.card.is_some().then_some(()));
    let seen = std::mem::take(&mut bench.seen);
    state.accept(seen, Instant::now());
    state.walk(|stand| stand.orbit(0.3, 0.1));
    let order = state.order(Instant::now() + Duration::from_secs(9)).unwrap();
    let number = bench.show(Order { moving: false, ..order });
    let picture = bench.picture(number, 3);
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
