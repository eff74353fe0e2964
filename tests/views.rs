//! Tests of crops, of several cameras in one run, and of turntables.

use std::process::{Command, Output};

use clap::Parser as _;
use common::folder::Folder;
use lightsheaf::crop::Crop;
use lightsheaf::film::exr::{Picture, Window};
use lightsheaf::film::{Film, record::SampleRange};
use lightsheaf::metrics::compare;
use lightsheaf::render;
use lightsheaf::scene;
use lightsheaf::settings::Settings;

mod common;

/// Scenes and options, and whether tiles outside a crop are left out.
const CASES: [(&str, &str, bool); 17] = [
    ("builtin:cornell_glossy", "--interleave 1", true),
    ("builtin:cornell_area", "--interleave 1 --band-pixels 1000", true),
    ("builtin:cornell_mirrors", "--interleave 1", true),
    ("builtin:cornell_point", "--visibility fast --interleave 1", true),
    ("builtin:cornell_area", "--method twin --interleave 1", true),
    // The camera is moved inside, so that the sky's guide is that of the whole view.
    ("builtin:cornell_env", "--interleave 1", true),
    ("builtin:point_hall:40", "--interleave 1", true),
    ("builtin:point_hall:9", "--light-sampling ris --interleave 1", true),
    ("builtin:point_hall:9", "--light-sampling restir --interleave 1", false),
    ("builtin:cornell_glossy", "--interleave 3", false),
    ("builtin:cornell_area", "--interleave 2 --upsample 2 --history 2", false),
    ("builtin:cornell_glossy", "--method bdpt", true),
    ("builtin:cornell_area", "--method bdpt --visibility ray-query", true),
    ("builtin:cornell_water", "--method bdpt", true),
    ("builtin:cornell_glossy", "--method path", true),
    ("builtin:point_hall:9", "--method path --light-sampling ris", true),
    ("builtin:point_hall:9", "--method path --light-sampling restir", false),
];

const SIZE: [u32; 2] = [53, 50];

/// It touches four of the sixteen tiles, none of them wholly inside.
const CROP: Crop = Crop { x: 17, y: 13, width: 12, height: 9 };

#[derive(clap::Parser)]
#[command(no_binary_name = true)]
struct Options {
    #[command(flatten)]
    settings: Settings,
}

fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    let Output { status, stderr, .. } = command.args(arguments).env_remove("RUST_LOG").output().unwrap();
    (status.code(), String::from_utf8(stderr).unwrap())
}

fn succeed(arguments: &[&str]) {
    let (code, text) = run(arguments);
    assert_eq!(code, Some(0), "{arguments:?}: {text}");
}

fn fail(arguments: &[&str], what: &str) {
    let (code, text) = run(arguments);
    assert_eq!(code, Some(2), "{arguments:?}: {text}");
    assert!(text.matches("error: ").count() == 1 && text.contains(what), "{arguments:?}: `{what}` is not in: {text}");
}

/// Rays of a crop pass blended surfaces where those of the whole picture do.
#[test]
fn a_crop_decides_at_blended_surfaces_as_the_whole() {
    let Some(gpu) = common::gpu() else { return };
    let mut scene = scene::load("builtin:cornell_point").unwrap();
    for material in &mut scene.materials {
        material.opacity = Some(scene::Opacity::Blended { value: 0.5.into() });
    }
    for options in ["--visibility-from lists", "--visibility-from grid", "--visibility fast", "--method bdpt"] {
        let options = options.split_whitespace().chain(["--interleave", "1"]);
        let settings = Options::try_parse_from(options).unwrap().settings;
        let film = |crop| {
            let settings = Settings { crop, width: SIZE[0], height: SIZE[1], ..settings.clone() };
            let mut renderer = render::open(gpu, &scene, &settings).unwrap();
            renderer.render(3, &mut |_| true).unwrap();
            renderer.film().unwrap()
        };
        let whole = film(None);
        assert!(whole.pixels.iter().flatten().any(|&value| value > 0.0), "{settings:?}: is black");
        assert!(film(Some(CROP)) == whole.cropped(Some(CROP)), "{settings:?}");
    }
}

/// The pixels of a crop are those of the whole picture, bit for bit, in every method on a device.
#[test]
fn a_crop_has_the_pixels_of_the_whole() {
    let Some(gpu) = common::gpu() else { return };
    let Some(tracing) = common::gpu_with_ray_queries() else { return };
    for (spec, options, skips) in CASES {
        let settings = Options::try_parse_from(options.split_whitespace()).unwrap().settings;
        let settings = Settings { width: SIZE[0], height: SIZE[1], ..settings };
        let gpu = if settings.technique.needs_ray_queries() { tracing } else { gpu };
        let mut scene = scene::load(spec).unwrap();
        if scene.environment.is_some() {
            let [low, high] = scene::Geometry::new(&scene).bounds;
            let middle = 0.5 * (low + high);
            scene.cameras[0] = scene.cameras[0].clone().looking(middle.with_z(high.z), middle).unwrap();
            assert!(scene::SceneStats::new(&scene, &scene::Geometry::new(&scene)).camera_inside);
        }
        let film = |crop| {
            let settings = Settings { crop, ..settings.clone() };
            assert_eq!(settings.skips_tiles(), skips && crop.is_some(), "{spec} {options}");
            let mut renderer = render::open(gpu, &scene, &settings).unwrap();
            renderer.render(3, &mut |_| true).unwrap();
            let first = renderer.film().unwrap();
            if skips {
                renderer.restart(settings.seed);
                renderer.render(3, &mut |_| true).unwrap();
                assert!(renderer.film().unwrap() == first, "{spec} {options}: a restart is the same picture");
            }
            first
        };
        let (whole, part) = (film(None), film(Some(CROP)));
        assert!(part.pixels.iter().flatten().any(|&value| value > 0.0), "{spec} {options}: is black");
        assert!(
            part == whole.clone().cropped(Some(CROP)),
            "{spec} {options}: {:?}",
            compare(&part, &whole.clone().cropped(Some(CROP)))
        );
        let moved = whole.cropped(Some(Crop { x: 18, ..CROP }));
        assert!(part != moved, "{spec} {options}: canary");
    }
}

/// Files of crops say where they lie, and parts of a crop merge.
#[test]
fn the_program_writes_crops() {
    let folder = Folder::new("crop");
    let [whole, part, a, b, merged] = ["whole.exr", "part.exr", "a.exr", "b.exr", "merged.exr"].map(|n| folder.path(n));
    let base =
        ["render", "builtin:cornell_area", "--size", "40x30", "--method", "reference", "-q", "--aov", "albedo,depth"];
    let crop = ["--crop", "7,3,20,11"];
    succeed(&[&base[..], &["-o", &whole, "--samples", "4"]].concat());
    succeed(&[&base[..], &crop, &["-o", &part, "--samples", "4"]].concat());
    succeed(&[&base[..], &crop, &["-o", &a, "--sample-range", "1..3"]].concat());
    succeed(&[&base[..], &crop, &["-o", &b, "--sample-range", "4..4"]].concat());
    succeed(&["merge", &a, &b, "-o", &merged, "-q"]);
    let crop = Crop { x: 7, y: 3, width: 20, height: 11 };
    let [whole, part, merged] = [whole, part, merged].map(|path| Picture::load(path).unwrap());
    assert_eq!((whole.window, part.window), (None, Some(Window { crop, size: [40, 30] })));
    assert!(part.film == whole.film.clone().cropped(Some(crop)));
    for channel in &part.channels {
        let values: Vec<f32> = crop.pixels(40).map(|at| whole.channel(&channel.name).unwrap()[at as usize]).collect();
        assert!(channel.values == values, "{}", channel.name);
    }
    assert_eq!((merged.window, merged.channels == part.channels), (part.window, true));
    assert!(compare(&merged.film, &part.film).unwrap().rel_mse <= 1e-10);
    assert_eq!(merged.record.unwrap().ranges, [SampleRange { first: 1, last: 4 }]);

    let other = folder.path("other.exr");
    succeed(&[&base[..], &["--crop", "7,4,20,11", "-o", &other, "--sample-range", "4..4"]].concat());
    fail(&["merge", &a, &other, "-o", &b], "have other settings: crop");
    let bad = |crop: &str, what: &str| fail(&[&base[..6], &["-o", &other, "--crop", crop]].concat(), what);
    bad("30,0,20,11", "--crop 30,0,20,11: has to have a pixel and lie in the image of 40x30");
    bad("0,0,0,1", "has to have a pixel");
    bad("1,2,3", "a crop is X,Y,W,H in pixels");
}

/// A crop goes on from its checkpoint, and from no other one's.
#[cfg(unix)]
#[test]
fn a_crop_goes_on_from_a_checkpoint() {
    let folder = Folder::new("resume");
    let [out, whole] = ["a.exr", "whole.exr"].map(|name| folder.path(name));
    let checkpoint = folder.path("a.checkpoint");
    let base = ["render", "builtin:cornell_area", "--size", "160x120", "--method", "reference", "-q"];
    let crop = ["--crop", "50,40,30,20"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    command.args(base).args(crop).args(["-o", &out, "--samples", "16000000", "--checkpoint", "1"]);
    let mut child = command.spawn().unwrap();
    // The picture is written after the checkpoint.
    while !std::path::Path::new(&out).exists() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let written = Picture::load(&out).unwrap();
    assert_eq!(written.window.map(|window| (window.crop.x, window.size)), Some((50, [160, 120])));
    let more = (written.record.unwrap().samples + 3).to_string();
    let resume = ["-o", &out, "--resume", &checkpoint, "--samples", &more];
    fail(&[&base[..], &["--crop", "50,40,30,21"], &resume].concat(), "it has other settings: crop");
    fail(&[&base[..], &resume].concat(), "it has other settings: crop");
    succeed(&[&base[..], &crop, &resume].concat());
    succeed(&[&base[..], &["-o", &whole, "--samples", &more]].concat());
    let [part, whole] = [out, whole].map(|path| Film::load(path).unwrap());
    assert!(part == whole.cropped(Some(Crop { x: 50, y: 40, width: 30, height: 20 })));
}

/// Each camera's picture is the one of a run of its own.
#[test]
fn several_cameras_have_a_picture_each() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("cameras");
    let [pattern, png, stats, one] =
        ["a_{camera}.exr", "b_{camera}.png", "{camera}.json", "one.exr"].map(|name| folder.path(name));
    for method in ["path", "reference"] {
        let base = ["render", "builtin:cornell_area", "--size", "24x18", "--samples", "2", "--method", method, "-q"];
        let cameras = ["--camera", "0", "--camera", "auto", "-o", &pattern, "-o", &png, "--stats", &stats];
        succeed(&[&base[..], &cameras].concat());
        for camera in ["0", "auto"] {
            succeed(&[&base[..], &["--camera", camera, "-o", &one]].concat());
            let [mut several, one] =
                [folder.path(&format!("a_{camera}.exr")), one.clone()].map(|path| Picture::load(path).unwrap());
            assert!(several.film == one.film, "{method} {camera}");
            several.record.as_mut().unwrap().seconds = 0.0;
            let [several, one] = [several.record.unwrap(), one.record.unwrap()];
            assert_eq!((several.scene_hash, several.settings_hash), (one.scene_hash, one.settings_hash));
            assert!(folder.read(&format!("{camera}.json")).contains("\"samples\": 2"));
        }
        let [first, second] = ["a_0.exr", "a_auto.exr"].map(|name| Film::load(folder.path(name)).unwrap());
        assert!(first != second, "canary");
    }
    let base = ["render", "builtin:cornell_area"];
    fail(&[&base[..], &["-o", &pattern]].concat(), "which camera? Give --camera");
    fail(&[&base[..], &["-o", &one, "--camera", "0", "--camera", "auto"]].concat(), "has to have {camera} in its name");
    fail(&[&base[..], &["-o", &pattern, "--camera", "0", "--camera", "0"]].concat(), "two are called alike");
    fail(&["plan", "builtin:cornell_area", "--camera", "0", "--camera", "auto"], "several are for `render`");
    let all = ["-o", &pattern, "--camera", "0", "--camera", "auto", "--resume", "x"];
    fail(&[&base[..], &all].concat(), "--resume: is for one camera");
}

/// A turntable begins with the camera's view and returns to its side after half a turn.
#[test]
fn a_turntable_goes_round() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("turntable");
    let [out, still, opposite] = ["a.exr", "still.exr", "opposite.exr"].map(|name| folder.path(name));
    for method in ["shared", "path", "reference"] {
        let base = [
            "render",
            "builtin:cornell_area",
            "--size",
            "24x18",
            "--samples",
            "2",
            "--method",
            method,
            "-q",
            "--env",
            "none",
        ];
        let from = |eye: &'static str| ["--eye", eye, "--target", "0,1,0"];
        succeed(&[&base[..], &from("0,1,0.7"), &["-o", &out, "--turntable", "4"]].concat());
        succeed(&[&base[..], &from("0,1,0.7"), &["-o", &still]].concat());
        succeed(&[&base[..], &from("0.7,1,0"), &["-o", &opposite]].concat());
        let view = |n: u32| Film::load(folder.path(&format!("a_{n:04}.exr"))).unwrap();
        let [still, opposite] = [&still, &opposite].map(|path| Film::load(path).unwrap());
        assert!(view(0) == still, "{method}");
        // A quarter turn rounds; the random numbers are the same.
        let error = compare(&view(1), &opposite).unwrap().rel_mse;
        let canary = compare(&view(3), &opposite).unwrap().rel_mse;
        assert!(error < 0.01 && canary > 0.03, "{method}: {error} and {canary}");
        assert!(view(2) != view(0));
    }
    let base = ["render", "builtin:cornell_spheres", "-o", &out];
    fail(&[&base[..], &["--turntable", "1"]].concat(), "2..=9999");
    fail(&[&base[..], &["--turntable", "3", "--checkpoint", "9"]].concat(), "cannot be used with");
}
