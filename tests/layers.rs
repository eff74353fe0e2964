//! Tests of the layers of an .exr: coverage, AOVs, identifiers, and the denoised picture.

use std::process::{Command, Output};

use common::folder::Folder;
use glam::Vec3;
use lightsheaf::film::cryptomatte::identifier;
use lightsheaf::film::exr::Picture;
use lightsheaf::film::oidn::{self, DenoiseError};
use lightsheaf::metrics::compare;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::scene;

mod common;

/// Methods that write the layers.
const METHODS: [&[&str]; 7] = [
    &["--method", "reference"],
    &["--method", "shared", "--interleave", "1"],
    &["--method", "shared", "--interleave", "2"],
    &["--method", "shared", "--visibility", "fast"],
    &["--method", "twin"],
    &["--method", "bdpt"],
    &["--method", "path"],
];

const ALL: &str = "albedo,normal,depth,position,emission,id";

fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    let Output { status, stderr, .. } = command.args(arguments).env_remove("RUST_LOG").output().unwrap();
    (status.code(), String::from_utf8(stderr).unwrap())
}

fn fail(arguments: &[&str], what: &str) {
    let (code, text) = run(arguments);
    assert_eq!(code, Some(2), "{arguments:?}: {text}");
    assert!(text.matches("error: ").count() == 1 && text.contains(what), "{arguments:?}: `{what}` is not in: {text}");
}

/// Renders 32x24 pixels of a scene with 2 samples.
fn rendered(folder: &Folder, scene: &str, more: &[&str]) -> Picture {
    let out = folder.path("a.exr");
    let base = ["render", scene, "-o", &out, "--size", "32x24", "--samples", "2", "-q"];
    let (code, text) = run(&[&base, more].concat());
    assert_eq!(code, Some(0), "{more:?}: {text}");
    Picture::load(&out).unwrap()
}

fn vector(picture: &Picture, names: [&str; 3], pixel: usize) -> Vec3 {
    Vec3::from(names.map(|name| picture.channel(name).unwrap_or_else(|| panic!("{name} is missing"))[pixel]))
}

#[test]
fn all_methods_write_what_the_reference_sees() {
    if common::gpu().is_none() || common::gpu_with_ray_queries().is_none() {
        return;
    }
    let folder = Folder::new("layers");
    let spec = "builtin:cornell_area";
    let scene = scene::load(spec).unwrap();
    let reference = Reference::new(&scene);
    let settings = ReferenceSettings { width: 32, height: 24, samples: 1, bounces: None, seed: 1, camera: 0 };
    let truth = reference.features(&settings);
    let eye = Vec3::from(scene.cameras[0].world_from_camera.translation);
    let mut first: Option<Picture> = None;
    for method in METHODS {
        let picture = rendered(&folder, spec, &[method, &["--aov", ALL]].concat());
        let whole = |pixel: &usize| {
            let names = ["CryptoMaterial00.G", "CryptoObject00.G"].map(|name| picture.channel(name).unwrap()[*pixel]);
            let [n, w] = [vector(&picture, ["normal.X", "normal.Y", "normal.Z"], *pixel).length(), names[0]];
            picture.channel("A").unwrap()[*pixel] == 1.0 && n > 0.9999 && w == 1.0 && names[1] == 1.0
        };
        let inside: Vec<usize> = (0..32 * 24).filter(whole).collect();
        assert!(inside.len() > 300, "{method:?}: {} pixels show one surface", inside.len());
        for &pixel in &inside {
            let near = |a: Vec3, b: [f32; 3]| a.distance(b.into()) < 1e-4;
            let normal = vector(&picture, ["normal.X", "normal.Y", "normal.Z"], pixel);
            assert!(near(normal, truth.normal.pixels[pixel]), "{method:?}: {normal}");
            let albedo = vector(&picture, ["albedo.R", "albedo.G", "albedo.B"], pixel);
            assert!(near(albedo, truth.albedo.pixels[pixel]), "{method:?}: {albedo}");
            let position = vector(&picture, ["position.X", "position.Y", "position.Z"], pixel);
            assert!((position.distance(eye) - truth.distance.pixels[pixel][0]).abs() < 1e-4, "{method:?}: {position}");
            let view = scene.cameras[0].world_from_camera.inverse().transform_point3(position);
            assert!((picture.channel("depth.Z").unwrap()[pixel] + view.z).abs() < 1e-4, "{method:?}");
        }
        let lamp = picture.channel("emission.R").unwrap().iter().filter(|&&value| value > 1.0).count();
        assert!(lamp > 2 && lamp < 200, "{method:?}: {lamp} pixels show the lamp");
        // Light differs from method to method; layers do not.
        if let Some(first) = &first {
            assert_eq!((&first.channels, &first.attributes), (&picture.channels, &picture.attributes), "{method:?}");
            assert_ne!(first.film, picture.film, "canary");
        }
        first.get_or_insert(picture);
    }
    let first = first.unwrap();
    let attribute = |end: &str| first.attributes.iter().filter(|(name, _)| name.ends_with(end)).count();
    assert_eq!([attribute("/name"), attribute("/hash"), attribute("/conversion"), attribute("/manifest")], [2; 4]);
    let known: Vec<f32> =
        (0..scene.materials.len()).map(|n| identifier(&format!("{}.{n}", scene.materials[n].name))).collect();
    assert!(first.channel("CryptoMaterial00.R").unwrap().iter().all(|id| *id == 0.0 || known.contains(id)));
}

#[test]
fn coverage_leaves_the_environment_out() {
    let folder = Folder::new("coverage");
    let camera = ["--eye", "1,1,9", "--target", "0,1,0", "--fov", "60"];
    let method = [&["--method", "reference", "--env", "studio"][..], &camera].concat();
    let plain = rendered(&folder, "builtin:single_triangle", &method);
    assert!(plain.channels.is_empty());
    let with = rendered(&folder, "builtin:single_triangle", &[&method[..], &["--transparent"]].concat());
    let alpha = with.channel("A").unwrap();
    let count = |test: &dyn Fn(f32) -> bool| alpha.iter().filter(|&&a| test(a)).count();
    let counts = [count(&|a| a == 0.0), count(&|a| a > 0.0 && a < 1.0), count(&|a| a == 1.0)];
    assert!(counts.iter().all(|&n| n > 10), "{counts:?}");
    for (pixel, &alpha) in alpha.iter().enumerate() {
        let [before, after] = [&plain, &with].map(|picture| picture.film.pixels[pixel]);
        if alpha == 0.0 {
            assert!(after == [0.0; 3] && before != [0.0; 3], "{pixel}: {before:?} became {after:?}");
        } else if alpha == 1.0 {
            assert_eq!(before, after, "{pixel}");
        } else {
            assert!((0..3).all(|c| after[c] >= 0.0 && after[c] <= before[c]), "{pixel}: {before:?} became {after:?}");
        }
    }
    let png = folder.path("a.png");
    let base = ["render", "builtin:cornell_area", "-o", &png];
    fail(&[&base[..], &["--transparent"]].concat(), "--transparent: only an .exr");
    fail(&[&base[..], &["--aov", "depth"]].concat(), "--aov: layers are written to an .exr");
    fail(&[&base[..], &["--aov", "motion"]].concat(), "albedo, normal, depth, position, emission, id");
}

/// Layers are kept when parts are merged.
#[test]
fn merged_parts_keep_their_layers() {
    let folder = Folder::new("parts");
    let [a, b, out] = ["a.exr", "b.exr", "out.exr"].map(|name| folder.path(name));
    let part = |path: &str, range: &str| {
        let base = ["render", "builtin:cornell_area", "-o", path, "--size", "32x24", "--method", "reference"];
        assert_eq!(run(&[&base[..], &["--aov", ALL, "--sample-range", range]].concat()).0, Some(0));
    };
    part(&a, "1..2");
    part(&b, "3..5");
    assert_eq!(run(&["merge", &a, &b, "-o", &out]).0, Some(0));
    let [a, out] = [&a, &out].map(|path| Picture::load(path).unwrap());
    assert!(a.channels == out.channels && a.attributes == out.attributes && a.film != out.film);
}

/// Without the library one line says how to get it, before anything is rendered.
#[test]
fn a_missing_denoiser_is_told() {
    let folder = Folder::new("missing");
    let out = folder.path("a.exr");
    let none = folder.path("none.so");
    let base =
        ["render", "builtin:cornell_area", "-o", &out, "--size", "32x24", "--method", "reference", "--samples", "1"];
    fail(&[&base[..], &["--denoise", "--oidn", &none]].concat(), "run `scripts/setup.sh --denoise`");
    assert!(folder.files().is_empty());
    fail(&[&base[..], &["--oidn", &none]].concat(), "--denoise");
    assert_eq!(run(&base).0, Some(0));
    let other = folder.path("b.exr");
    fail(&["denoise", &out, "-o", &other, "--oidn", &none], "run `scripts/setup.sh --denoise`");
    std::fs::write(&none, "no library").unwrap();
    fail(&["denoise", &out, "-o", &other, "--oidn", &none], "cannot be opened");
    assert_eq!(folder.files(), ["a.exr", "none.so"]);
}

#[test]
fn the_denoiser_removes_noise_and_keeps_the_original() {
    let probe = oidn::denoise(&lightsheaf::film::Film::new(4, 4), None, None);
    if let Err(DenoiseError::Library(cause)) = probe {
        eprintln!("skipped: {cause}");
        return;
    }
    let folder = Folder::new("denoise");
    let [out, done, truth, part] = ["a.exr", "b.exr", "truth.exr", "c.exr"].map(|name| folder.path(name));
    let base = ["render", "builtin:cornell_area", "--size", "96x96", "--method", "reference", "-q"];
    let layers = ["--samples", "4", "--aov", "albedo,normal"];
    assert_eq!(run(&[&base[..], &layers, &["-o", &out]].concat()).0, Some(0));
    assert_eq!(run(&[&base[..], &["--samples", "256", "--seed", "9", "-o", &truth]].concat()).0, Some(0));
    assert_eq!(run(&["denoise", &out, "-o", &done]).0, Some(0));
    let [noisy, denoised, truth] = [&out, &done, &truth].map(|path| Picture::load(path).unwrap());
    let error = |picture: &Picture| compare(&picture.film, &truth.film).unwrap().rel_mse;
    println!("rel_mse {} before, {} after", error(&noisy), error(&denoised));
    assert!(error(&denoised) < 0.25 * error(&noisy));
    assert_eq!(noisy.film.pixels[500][1], denoised.channel("noisy.G").unwrap()[500]);
    assert_eq!(noisy.channel("albedo.R"), denoised.channel("albedo.R"));
    fail(&["denoise", &done, "-o", &out], "is denoised already");
    fail(&["merge", &done, "-o", &out], "is denoised; merge the originals");
    // The option of `render` does the same.
    assert_eq!(run(&[&base[..], &layers, &["--denoise", "-o", &part]].concat()).0, Some(0));
    assert_eq!(Picture::load(&part).unwrap().film, denoised.film);
}
