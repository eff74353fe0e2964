//! Tests of the layers of an .exr: coverage, AOVs, identifiers, and the denoised picture.

use std::process::{Command, Output};

use common::folder::Folder;
use glam::Vec3;
use lightsheaf::film::Film;
use lightsheaf::film::cryptomatte::identifier;
use lightsheaf::film::exr::Picture;
use lightsheaf::film::oidn::{self, DenoiseError};
use lightsheaf::metrics::compare;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::scene::{self, Light};

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

const ALL: &str = "albedo,normal,depth,position,motion,id";

/// Layers that sum to the picture.
const LIGHT: [&str; 3] = ["emission", "direct", "indirect"];

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
    let settings =
        ReferenceSettings { width: 32, height: 24, samples: 1, bounces: None, specular_bounces: 0, seed: 1, camera: 0 };
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
        assert!(["X", "Y"].iter().all(|axis| {
            let motion = picture.channel(&format!("motion.{axis}")).unwrap();
            motion.iter().all(|&pixels| pixels == 0.0)
        }));
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
    fail(&[&base[..], &["--aov", "motions"]].concat(), "albedo, normal, depth, position, motion, emission, direct");
    let exr = folder.path("a.exr");
    let history = ["render", "builtin:cornell_area", "-o", &exr, "--history", "4", "--aov", "direct"];
    fail(&history, "leave it out");
    let filtered =
        ["render", "builtin:cornell_point", "-o", &exr, "--turntable", "3", "--samples", "1", "--size", "32x24"];
    fail(&[&filtered[..], &["--interleave", "2", "--aov", "direct"]].concat(), "give --interleave 1");
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

/// Returns a layer of light.
fn light(picture: &Picture, layer: &str) -> Film {
    let names = ["R", "G", "B"].map(|axis| format!("{layer}.{axis}"));
    let pixels = (0..picture.film.pixels.len())
        .map(|pixel| vector(picture, names.each_ref().map(String::as_str), pixel).to_array())
        .collect();
    Film { pixels, ..picture.film }
}

/// Emission, direct and indirect light sum to the picture, which is the one without layers, in every method.
#[test]
fn the_parts_of_light_are_the_picture() {
    if common::gpu().is_none() || common::gpu_with_ray_queries().is_none() {
        return;
    }
    let folder = Folder::new("light");
    let resampled: [&[&str]; 2] = [
        &["--method", "path", "--light-sampling", "ris"],
        &["--method", "path", "--bounces", "unlimited", "--light-sampling", "restir"],
    ];
    let vpls: &[&str] = &["--method", "shared", "--light-sampling", "restir"];
    let layers = ["--aov", "emission,direct,indirect,depth"];
    for (scene, method) in METHODS
        .into_iter()
        .chain(resampled)
        .chain([vpls])
        .flat_map(|method| [("builtin:cornell_area", method), ("builtin:cornell_mirrors", method)])
    {
        let plain = rendered(&folder, scene, method);
        let with = rendered(&folder, scene, &[method, &layers].concat());
        assert!(plain.film == with.film, "{scene} {method:?}: layers change the picture");
        let parts = LIGHT.map(|layer| light(&with, layer));
        let most = with.film.pixels.iter().flatten().copied().fold(0.0, f32::max);
        for (pixel, value) in with.film.pixels.iter().enumerate() {
            let sum: [f32; 3] = std::array::from_fn(|c| parts.iter().map(|part| part.pixels[pixel][c]).sum());
            let near = |c: usize| (sum[c] - value[c]).abs() <= 1e-6 * (most + value[c].abs());
            assert!((0..3).all(near), "{scene} {method:?}: {sum:?} is not {value:?}");
        }
        let lit = |part: &Film| part.pixels.iter().filter(|pixel| pixel[1].abs() > 1e-4).count();
        let [lamp, direct, indirect] = [0, 1, 2].map(|n| lit(&parts[n]));
        assert!(lamp > 2 && lamp < 200 && direct > 200 && indirect > 200, "{method:?}: {lamp} {direct} {indirect}");
        // The parts have the random numbers of the picture, so that they are parts of each sample.
        let least = parts.iter().flat_map(|part| part.pixels.iter().flatten()).copied().fold(0.0, f32::min);
        assert!(least >= -1e-5 * most, "{scene} {method:?}: {least}");
    }
}

/// Direct light of every method is that of the reference.
#[test]
fn direct_light_is_that_of_the_reference() {
    if common::gpu().is_none() || common::gpu_with_ray_queries().is_none() {
        return;
    }
    let folder = Folder::new("direct");
    let picture = |method: &[&str], samples: &str| {
        let out = folder.path("a.exr");
        let base = ["render", "builtin:cornell_area", "-o", &out, "--size", "32x24", "-q", "--samples", samples];
        let (code, text) = run(&[&base, method, &["--aov", "emission,direct,indirect"]].concat());
        assert_eq!(code, Some(0), "{method:?}: {text}");
        Picture::load(&out).unwrap()
    };
    let mean = |film: &Film| film.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (32.0 * 24.0 * 3.0);
    let truth = picture(&["--method", "reference"], "512");
    let truths = LIGHT.map(|layer| light(&truth, layer));
    // The lamp is a matter of a few pixels, and emission outshines all other light.
    for method in METHODS {
        let parts = LIGHT.map(|layer| light(&picture(method, "64"), layer));
        for (n, tolerance) in [(0, 0.05), (1, 0.02), (2, 0.06)] {
            let (own, expected) = (mean(&parts[n]), mean(&truths[n]));
            println!("{method:?} {}: {own} of {expected}", LIGHT[n]);
            assert!((own / expected - 1.0).abs() < tolerance, "{method:?} {}: {own}, not {expected}", LIGHT[n]);
        }
        let error = |n: usize| compare(&parts[n], &truths[1]).unwrap().rel_mse;
        println!("{method:?}: rel_mse {} of direct light, {} of indirect light against it", error(1), error(2));
        assert!(error(1) < 0.02 && error(2) > 0.08, "{method:?}: {} and {}", error(1), error(2));
    }
}

/// Without the sky behind the scene, the parts sum to what is left.
#[test]
fn the_parts_of_light_leave_the_environment_out() {
    let folder = Folder::new("sky");
    let camera = ["--eye", "1,1,9", "--target", "0,1,0", "--fov", "60"];
    let layers = ["--method", "reference", "--env", "studio", "--aov", "emission,direct,indirect"];
    for transparent in [false, true] {
        let more = [&layers[..], &camera, if transparent { &["--transparent"] } else { &[] }].concat();
        let picture = rendered(&folder, "builtin:single_triangle", &more);
        let parts = LIGHT.map(|layer| light(&picture, layer));
        let (alpha, mut sky) = (picture.channel("A").unwrap(), 0);
        for (pixel, value) in picture.film.pixels.iter().enumerate() {
            let sum: f32 = parts.iter().map(|part| part.pixels[pixel][1]).sum();
            assert!((sum - value[1]).abs() < 1e-4, "{sum} is not {}", value[1]);
            // At edges, rays of the coverage and samples of the picture differ.
            sky += usize::from((alpha[pixel] == 0.0 || alpha[pixel] == 1.0) && parts[0].pixels[pixel][1] > 0.01);
        }
        assert!(if transparent { sky == 0 } else { sky > 50 }, "{transparent}: {sky} pixels show the sky");
    }
}

/// A ball on a floor below two point lights, a panel and the sky, or below some of these.
fn grouped(lights: &[&str]) -> String {
    let all = [
        (
            "key",
            r#"<emitter type="point" id="key"><point name="position" x="2" y="3" z="2"/><rgb name="intensity" value="9,8,6"/></emitter>"#,
        ),
        (
            "fill",
            r#"<emitter type="point" id="fill.001"><point name="position" x="-2" y="2" z="2"/><rgb name="intensity" value="4,6,9"/></emitter>"#,
        ),
        (
            "panel",
            r#"<shape type="rectangle" id="panel"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate y="2.5"/></transform><emitter type="area"><rgb name="radiance" value="6,6,6"/></emitter></shape>"#,
        ),
        ("sky", r#"<emitter type="constant"><rgb name="radiance" value="0.2,0.2,0.3"/></emitter>"#),
    ];
    let lights: String = all.iter().filter(|(name, _)| lights.contains(name)).map(|(_, text)| *text).collect();
    format!(
        r#"<scene version="3.0.0">
        <sensor type="perspective"><float name="fov" value="60"/><transform name="to_world"><lookat origin="0,1,4" target="0,0.7,0" up="0,1,0"/></transform></sensor>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/></transform></shape>
        <shape type="sphere"><point name="center" x="0" y="0.5" z="0"/><float name="radius" value="0.5"/></shape>
        {lights}</scene>"#
    )
}

/// Light groups sum to the picture in every method, and each is the picture by its light alone.
#[test]
fn light_groups_are_the_picture() {
    let folder = Folder::new("groups");
    let file = |name: &str, lights: &[&str]| {
        let path = folder.path(name);
        std::fs::write(&path, grouped(lights)).unwrap();
        path
    };
    let (all, key) = (file("all.xml", &["key", "fill", "panel", "sky"]), file("key.xml", &["key"]));
    let out = folder.path("a.exr");
    let picture = |scene: &str, more: &[&str]| {
        let base = ["render", scene, "-o", &out, "--size", "32x24", "--samples", "32", "-q"];
        let (code, text) = run(&[&base, more].concat());
        assert_eq!(code, Some(0), "{more:?}: {text}");
        Picture::load(&out).unwrap()
    };
    let layers = ["light_fill_001", "light_key", "light_environment", "light_rest"];
    let wanted = ["--light-groups", "key,environment,fill.001"];
    let methods = METHODS.into_iter().filter(|method| method[1] != "twin" || common::gpu_with_ray_queries().is_some());
    for method in methods.filter(|method| method[1] == "reference" || common::gpu().is_some()) {
        let with = picture(&all, &[method, &wanted].concat());
        let parts = layers.map(|layer| light(&with, layer));
        let mut sum = Film::new(32, 24);
        let sums = sum.pixels.iter_mut().flatten().enumerate();
        sums.for_each(|(n, value)| *value = parts.iter().map(|part| part.pixels[n / 3][n % 3]).sum());
        let error = compare(&sum, &with.film).unwrap();
        println!("{method:?}: rel_mse {} of the sum, mean {:+}", error.rel_mse, error.mean_bias);
        // Pixels of `shared` have much of their noise in common. The weakest group has a twentieth of the light.
        assert!(error.rel_mse < 0.003 && error.mean_bias.abs() < 0.03, "{method:?}: {error:?}");
        for (layer, part) in layers.iter().zip(&parts) {
            let error = compare(part, &with.film).unwrap();
            assert!(error.mean_bias < -0.05 && error.mean_bias > -0.99, "canary: {layer}: {error:?}");
        }
        if ["reference", "path"].contains(&method[1]) {
            let alone = picture(&key, &[method, &["--env", "none"]].concat());
            assert!(alone.film == parts[1], "{method:?}: the layer is that of a file with this light alone");
            let none = picture(&all, method);
            assert!(none.film == with.film && none.channels.is_empty(), "{method:?}: layers change the picture");
        }
    }
    fail(&["render", &all, "-o", &out, "--light-groups", "keys"], "has `environment`, `fill.001`, `key`, `panel`");
    fail(&["render", &all, "-o", &folder.path("a.png"), "--light-groups", "key"], "layers are written to an .exr");
}

/// The sky behind the scene is left out of its group, too.
#[test]
fn light_groups_leave_the_environment_out() {
    let folder = Folder::new("groups-sky");
    let camera = ["--eye", "1,1,9", "--target", "0,1,0", "--fov", "60"];
    let layers = ["--method", "reference", "--env", "studio", "--transparent", "--light-groups", "environment"];
    let picture = rendered(&folder, "builtin:single_triangle", &[&layers[..], &camera].concat());
    let (sky, alpha) = (light(&picture, "light_environment"), picture.channel("A").unwrap());
    let outside: Vec<usize> = (0..alpha.len()).filter(|&pixel| alpha[pixel] == 0.0).collect();
    assert!(outside.len() > 50);
    assert!(outside.iter().all(|&pixel| sky.pixels[pixel].iter().all(|value| value.abs() < 1e-4)));
}

/// Groups share out all lights, whichever lights are left out.
#[test]
fn groups_share_out_all_lights() {
    let mut scene = scene::load("builtin:cornell_area").unwrap();
    let point = |x| Light::Point { position: Vec3::splat(x), intensity: Vec3::ONE };
    scene.lights = vec![point(0.1), point(0.2), point(0.3)];
    scene.group_lights(1, Some("fill"));
    scene.lights.push(point(0.4));
    let emitter = scene.materials.iter().position(|material| material.emission.is_some()).unwrap();
    scene.light_groups.materials.insert(emitter, "key".to_owned());
    assert_eq!(scene.light_group_names(), ["", "fill", "key"]);
    let fill = scene.lit_by(&|group| group == "fill");
    assert_eq!(fill.lights, [point(0.2), point(0.3)]);
    assert_eq!(fill.light_group_names(), ["fill"], "names follow their lights");
    let key = scene.lit_by(&|group| group == "key");
    assert!(key.lights.is_empty() && key.materials[emitter].emission.is_some());
    assert_eq!(scene.lit_by(&str::is_empty).lights, [point(0.1), point(0.4)]);
}

/// A group is that of the extras of the node, of the light or of the material, or else the name.
#[test]
fn gltf_files_name_light_groups() {
    let group = |name: &str| format!(r#""extras": {{"lightsheaf_light_group": "{name}"}}"#);
    let [key, fill, screen] = ["key", "fill", "screen"].map(group);
    let positions: Vec<u8> =
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let text = format!(
        r#"{{"asset": {{"version": "2.0"}}, "extensionsUsed": ["KHR_lights_punctual"], "scenes": [{{"nodes": [0, 1, 2, 3, 4]}}],
        "extensions": {{"KHR_lights_punctual": {{"lights": [
            {{"type": "point", "name": "bulb"}}, {{"type": "point", {fill}}}]}}}},
        "nodes": [
            {{"name": "lamp", "extensions": {{"KHR_lights_punctual": {{"light": 0}}}}}},
            {{"name": "lamp.001", {key}, "extensions": {{"KHR_lights_punctual": {{"light": 1}}}}}},
            {{"name": "lamp.002", "extensions": {{"KHR_lights_punctual": {{"light": 1}}}}}},
            {{"extensions": {{"KHR_lights_punctual": {{"light": 0}}}}}},
            {{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "material": 0}}, {{"attributes": {{"POSITION": 0}}, "material": 1}}]}}],
        "materials": [{{"name": "glow", "emissiveFactor": [1, 1, 1]}}, {{"name": "tv", "emissiveFactor": [1, 1, 1], {screen}}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}], "buffers": [{{"uri": "a.bin", "byteLength": 36}}]}}"#
    );
    let scene = scene::load_bytes("a.gltf", text.as_bytes(), &|_| Some(positions.clone())).unwrap();
    assert_eq!(scene.light_group_names(), ["bulb", "fill", "glow", "key", "lamp", "screen"]);
    assert_eq!(scene.light_groups.lights, ["lamp", "key", "fill", "bulb"]);
}

/// In an animation, motion is that since the frame before; the first frame has none.
#[test]
fn frames_have_motion() {
    let folder = Folder::new("motion");
    let out = folder.path("a.exr");
    let base = ["render", "builtin:cornell_spheres", "-o", &out, "--size", "32x24", "--samples", "1", "-q"];
    let turn = |method: &[&str]| {
        let (code, text) = run(&[&base[..], method, &["--turntable", "3", "--aov", "motion,direct,indirect"]].concat());
        assert_eq!(code, Some(0), "{text}");
    };
    let frame = |n: u32| Picture::load(folder.path(&format!("a_{n:04}.exr"))).unwrap();
    if common::gpu().is_some() {
        for method in [&["--method", "path"][..], &["--method", "shared", "--interleave", "1"]] {
            turn(method);
            for n in 0..3 {
                let least = light(&frame(n), "indirect").pixels.iter().flatten().copied().fold(0.0, f32::min);
                assert!(least > -1e-5, "{method:?}, frame {n}: the light is that of another frame, {least}");
            }
        }
    }
    turn(&["--method", "reference"]);
    let length = |picture: &Picture| {
        let [x, y] = ["motion.X", "motion.Y"].map(|name| picture.channel(name).unwrap());
        x.iter().zip(y).map(|(x, y)| x.hypot(*y)).fold(0.0, f32::max)
    };
    assert_eq!(length(&frame(0)), 0.0);
    assert!((1..3).all(|n| length(&frame(n)) > 1.0));
    assert!(frame(0).channel("direct.R") != frame(1).channel("direct.R"), "light is that of the frame");
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
