//! Tests of the program: its output, its files and its exit codes.

use std::path::Path;
use std::process::{Command, Output};

use common::folder::Folder;
use lightsheaf::film::Film;
use lightsheaf::metrics::compare;
use lightsheaf::tonemap::{Grade, Tonemap};
use serde_json::Value;

mod common;

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lightsheaf")).args(arguments).env_remove("RUST_LOG").output().unwrap()
}

fn stdout(output: &Output) -> &str {
    std::str::from_utf8(&output.stdout).unwrap()
}

fn stderr(output: &Output) -> &str {
    std::str::from_utf8(&output.stderr).unwrap()
}

/// Runs the program, which has to succeed, and returns its stdout.
fn succeed(arguments: &[&str]) -> String {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", stderr(&output));
    stdout(&output).to_owned()
}

/// Runs the program, which has to print one error that contains `what`, nothing on stdout, and to exit with
/// code 2.
fn fail(arguments: &[&str], what: &str) {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
    let text = stderr(&output);
    assert_eq!(text.matches("error: ").count(), 1, "{arguments:?}: {text}");
    assert!(text.contains(what), "{arguments:?}: `{what}` is not in: {text}");
    assert!(!text.contains("panicked"), "{text}");
    assert_eq!(stdout(&output), "", "{arguments:?}");
}

/// Renders 64x64 pixels with 4 samples.
fn render(output: &str, more: &[&str]) -> Output {
    let small = ["render", "builtin:cornell_point", "-o", output, "--size", "64x64", "--samples", "4"];
    run(&[&small, more].concat())
}

fn rendered(output: &str, more: &[&str]) -> Film {
    let result = render(output, more);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    assert_eq!(stdout(&result), "");
    // Files say how long the render took, so their bytes differ.
    Film::load(output).unwrap()
}

#[test]
fn help_and_version() {
    let help = succeed(&["--help"]);
    for command in ["render", "view", "merge", "denoise", "compare", "bench", "plan", "stress", "scenes"] {
        assert!(help.lines().any(|line| line.trim_start().starts_with(command)), "{command} is not in: {help}");
        assert!(succeed(&[command, "--help"]).contains("Usage: lightsheaf"));
    }
    assert_eq!(succeed(&["--version"]).trim(), format!("lightsheaf {}", env!("CARGO_PKG_VERSION")));
}

/// The README shows only options that exist. Commands of cargo and of scripts are left out.
#[test]
fn readme_shows_real_options() {
    let readme = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md")).unwrap();
    let others = |span: &&str| span.starts_with("cargo ") || span.starts_with("scripts/");
    let readme: Vec<&str> = readme.split('`').filter(|span| !others(span)).collect();
    let readme = readme.join("`");
    let help: String = ["render", "view", "merge", "denoise", "compare", "bench", "plan", "stress", "scenes"]
        .map(|command| succeed(&[command, "--help"]))
        .concat();
    let known = |option: &str| help.split([' ', ',', '\n', '`']).any(|word| word == option);
    let is_option = |word: &&str| word.starts_with("--") && word.len() > 2;
    let shown: Vec<&str> = readme.split([' ', ',', '\n', '`', '[', ']', '=']).filter(is_option).collect();
    assert!(shown.len() > 15, "{shown:?}");
    let unknown: Vec<_> = shown.into_iter().filter(|option| !known(option)).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
    assert!(!known("--no-such-option"));
}

#[test]
fn stress_prints_a_table_or_json() {
    if common::gpu().is_none() {
        return;
    }
    let table = succeed(&["stress", "--short", "empty"]);
    assert!(table.contains("empty scene") && table.contains("right") && table.contains("1 of 1 right"), "{table}");
    let report: Value = serde_json::from_str(&succeed(&["stress", "--short", "--json", "one "])).unwrap();
    let rows = report["rows"].as_array().unwrap();
    let names: Vec<_> = rows.iter().map(|row| row["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["scale of zero on one axis", "one pixel", "one triangle"]);
    assert!(rows.iter().all(|row| row["passed"] == true && row["method"] == "raster" && row["right"].is_string()));
    assert!(report["failed"] == 0 && report["device"].is_string() && report["version"] == env!("CARGO_PKG_VERSION"));
    fail(&["stress", "no such case"], "there are: scale 1e-6");
}

#[test]
fn values_are_checked_after_each_pass_where_that_is_asked_for() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("check-values");
    let stats = |more: &[&str]| -> Value {
        let json = folder.path("s.json");
        rendered(&folder.path("a.exr"), &[&["--stats", json.as_str()], more].concat());
        serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap()
    };
    assert_eq!(stats(&[])["non_finite_after"].as_array().unwrap().len(), 0);
    let checked = stats(&["--check-values"]);
    let after = checked["non_finite_after"].as_array().unwrap();
    assert!(after.len() > 5 && after.iter().all(|pass| pass[1] == 0), "{after:?}");
    assert!(checked["passes"]["non_finite"]["runs"].as_u64() > Some(10));
    let out = folder.path("b.exr");
    fail(
        &["render", "builtin:furnace", "-o", out.as_str(), "--method", "reference", "--check-values"],
        "--check-values: the reference",
    );
}

#[test]
fn scenes_lists_scenes_and_kinds_of_files() {
    let list = succeed(&["scenes"]);
    assert!(lightsheaf::scene::builtin::names().count() > 3);
    for (name, about) in lightsheaf::scene::builtin::names() {
        assert!(list.lines().any(|l| l.contains(&format!("builtin:{name}")) && l.contains(about)), "{name}: {list}");
    }
    for kind in [".gltf", ".glb", ".xml"] {
        assert!(list.contains(kind), "{list}");
    }
}

#[test]
fn bad_usage_and_scenes_are_one_error() {
    let folder = Folder::new("scenes");
    let out = folder.path("out.exr");
    fail(&["render"], "--output");
    fail(&["render", "builtin:cornell_point", "-o", &out, "--no-such-option"], "--no-such-option");
    fail(&["render", "builtin:nothing", "-o", &out], "cornell_point");
    fail(&["render", &folder.path("missing.gltf"), "-o", &out], "missing.gltf");
    fail(&["render", "scene.blend", "-o", &out], ".gltf, .glb, .vrm, .xml");
    let broken = folder.path("broken.xml");
    std::fs::write(&broken, "<scene version=\"3.0.0\">\n  <shape type=\"obj\">\n</scene>").unwrap();
    fail(&["render", &broken, "-o", &out], "line 3");
    assert_eq!(folder.files(), ["broken.xml"]);
}

/// An image that does not fit the memory is an error with its size before it is decoded.
#[cfg(target_os = "linux")]
#[test]
fn images_fit_the_memory_or_are_refused() {
    let folder = Folder::new("memory");
    let [scene, image, out] = ["scene.gltf", "image.bmp", "out.exr"].map(|name| folder.path(name));
    // The head of a picture of 16000 x 16000 pixels with 24 bits each, 732 MiB. There are no pixels.
    let word = |value: u32| value.to_le_bytes();
    let head = [word(54), word(40), word(16_000), word(16_000), word(24 << 16 | 1), [0; 4], [0; 4]].concat();
    std::fs::write(&image, [&b"BM"[..], &[0; 8], &head, &[0; 16]].concat()).unwrap();
    let corners = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0_f32];
    std::fs::write(folder.path("scene.bin"), corners.map(f32::to_le_bytes).concat()).unwrap();
    let json = serde_json::json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "buffers": [{ "uri": "scene.bin", "byteLength": 60 }], "bufferViews": [{ "buffer": 0, "byteLength": 60 }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC2" }
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0 }], "images": [{ "uri": "image.bmp" }],
    });
    std::fs::write(&scene, json.to_string()).unwrap();
    let render = |limit: &str| {
        let limited = format!("ulimit -v {limit}; exec \"$0\" \"$@\"");
        let arguments = ["render", &scene, "-o", &out, "--size", "8x8", "--method", "reference", "--samples", "1"];
        let command = [&["-c", &limited, env!("CARGO_BIN_EXE_lightsheaf")], &arguments[..]].concat();
        let output = Command::new("sh").args(command).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{limit}: {}", stderr(&output));
        stderr(&output).to_owned()
    };
    let refused = "the image of 16000 x 16000 pixels needs ";
    let text = render("1000000");
    assert!(text.contains(refused) && text.contains("MiB are free: use smaller images"), "{text}");
    let text = render("unlimited");
    assert!(text.contains("image.bmp") && !text.contains(refused), "canary, on a machine with 2 GiB free: {text}");
    assert!(!std::path::Path::new(&out).exists());
}

#[test]
fn bad_outputs_are_found_before_the_scene_is_loaded() {
    let folder = Folder::new("outputs");
    // If the scene were loaded first, the error would be about it.
    let scene = folder.path("missing.gltf");
    let [file, jpg] = ["file", "out.jpg"].map(|name| folder.path(name));
    std::fs::write(&file, "").unwrap();
    fail(&["render", &scene, "-o", &jpg], ".exr or .png");
    fail(&["render", &scene, "-o", "noextension"], ".exr or .png");
    fail(&["render", &scene, "-o", &folder.path("none/out.exr")], "does not exist");
    fail(&["render", &scene, "-o", &folder.path("file/out.exr")], "does not exist");
    let out = folder.path("out.exr");
    fail(&["render", &scene, "-o", &out, "--stats", &folder.path("none/out.json")], "does not exist");
    fail(&["render", &scene, "-o", &out, "--stats", &folder.path("out.txt")], ".json");
    fail(&["render", &scene, "-o", &out, "--exposure", "1"], "--exposure");
    fail(&["render", &scene, "-o", &out, "--exposure", "auto"], "--exposure");
    fail(&["render", &scene, "-o", &out, "--tonemap", "agx"], "--tonemap");
    fail(&["render", &scene, "-o", &folder.path("out.png"), "--exposure", "99"], "-32 to 32 stops");
    fail(&["render", &scene, "-o", &folder.path("out.png"), "--tonemap", "film"], "clip, reinhard, aces, agx");
    std::fs::create_dir(folder.path("folder.exr")).unwrap();
    fail(&["render", &scene, "-o", &folder.path("folder.exr")], "is a folder");
    // Nobody can create files in this folder.
    if Path::new("/proc/self").is_dir() {
        fail(&["render", &scene, "-o", "/proc/out.exr"], "cannot be written");
    }
    assert_eq!(folder.files(), ["file", "folder.exr"]);
}

#[test]
fn bad_values_are_named() {
    let folder = Folder::new("values");
    let out = folder.path("out.exr");
    let bad = |options: &[&str], what: &str| {
        fail(&[&["render", "builtin:cornell_point", "-o", &out], options].concat(), what);
    };
    bad(&["--size", "0x64"], "--size 0x64: each side has to be 1 to 16384");
    bad(&["--size", "64"], "640x360");
    bad(&["--size", "99999x2"], "--size 99999x2");
    bad(&["--samples", "0"], "--samples 0: has to be 1 to");
    bad(&["--samples", "-1"], "'--samples <N>'");
    bad(&["--samples", "4", "--budget", "1"], "--budget");
    bad(&["--budget", "-1"], "--budget -1");
    bad(&["--bounces", "65"], "--bounces 65: has to be 0 to 64");
    bad(&["--bounces", "unlimited"], "raster needs a number");
    bad(&["--bounces", "many"], "neither a whole number nor `unlimited`");
    bad(&["--method", "guess"], "shared, bdpt, path, reference");
    bad(&["--bundle-resolution", "8"], "--bundle-resolution 8: has to be 16 to 2048");
    bad(&["--light-resolution", "4096"], "--light-resolution 4096");
    bad(&["--vpl-resolution", "1"], "--vpl-resolution 1");
    bad(&["--beta", "nan"], "--beta NaN");
    bad(&["--camera", "7"], "has 0 `camera`");
    bad(&["--eye", "1,2,3"], "--target");
    bad(&["--eye", "1,2", "--target", "0,0,0"], "three numbers");
    bad(&["--eye", "1,2,3", "--target", "1,2,3"], "distance");
    bad(&["--fov", "180"], "--fov 180");
    bad(&["--aperture", "-1"], "--aperture -1");
    bad(&["--focus", "2"], "--focus: the camera is a pinhole");
    bad(&["--aperture", "0.1"], "--aperture: the camera is a pinhole");
    bad(&["--method", "ray-query", "--visibility", "bvh"], "leave one of them out");
    bad(&["--method", "reference", "--strategies", "vpl"], "is an option of raster");
    bad(&["--method", "ray-query", "--vpl-resolution", "64"], "is an option of raster, not of ray-query");
    bad(&["--method", "reference", "--beta", "2"], "is an option of raster, twin, ray-query and path");
    bad(&["--method", "ray-query", "--bounces", "unlimited"], "ray-query needs a number");
    bad(&["--method", "reference", "--strategy-images", "strategies"], "the reference has none");
    bad(&["--method", "path", "--bounces", "unlimited", "--strategy-images", "strategies"], "give --bounces a number");
    assert!(folder.files().is_empty());
}

/// `--env` replaces the environment, `--env-rotate` rotates it about +Y, and `--env-scale` scales it.
#[test]
fn environments_are_replaced_scaled_and_rotated() {
    let folder = Folder::new("environment");
    let [out, other] = ["out.exr", "other.exr"].map(|name| folder.path(name));
    let mean = |path: &str, arguments: &[&str]| {
        let camera = ["--eye", "0,0,4", "--target", "0,0,0", "--fov", "10", "--size", "16x16", "--samples", "16"];
        let scene = ["render", "builtin:white_furnace", "--method", "reference", "--quiet", "-o", path];
        let output = run(&[&scene[..], &camera, arguments].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let film = Film::load(path).unwrap();
        film.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / 256.0
    };
    let own = mean(&out, &[]);
    assert!((mean(&other, &["--env-scale", "2.5", "--env-rotate", "-30"]) / own - 2.5).abs() < 0.01);

    // The map is red towards +X and dark elsewhere. A camera that looks along -Z sees none of the red until
    // the map is rotated by 90 degrees.
    let map = folder.path("map.hdr");
    let texel = |x: u32, _| image::Rgb([0.0, if (12..20).contains(&x) { 2.0 } else { 0.0 }, 0.0_f32]);
    image::Rgb32FImage::from_fn(64, 32, texel).save(&map).unwrap();
    let up = ["--eye", "0,50,0", "--target", "0,50,-1", "--fov", "10", "--size", "4x4", "--samples", "4"];
    let seen = |more: &[&str]| {
        let scene = ["render", "builtin:white_furnace", "--method", "reference", "--quiet", "-o", &out, "--env", &map];
        let output = run(&[&scene[..], &up, more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        Film::load(&out).unwrap().pixels[5][1]
    };
    assert_eq!(seen(&[]), 0.0);
    // A rotation is counter-clockwise from above: +X comes to -Z.
    assert!((seen(&["--env-rotate", "90", "--env-scale", "0.5"]) - 1.0).abs() < 0.01);
    assert_eq!(seen(&["--env-rotate", "-90"]), 0.0);

    // A clear sky is blue above, its sun casts shadows, and a scene without light needs no other light.
    let sky = mean(&other, &["--env", "sky:40,2.5"]);
    assert!(sky > 0.05 && sky < 2.0, "{sky}");
    let triangle = folder.path("triangle.xml");
    std::fs::write(&triangle, "<scene version=\"3.0.0\"><shape type=\"rectangle\"/></scene>").unwrap();
    let lit = |arguments: &[&str]| {
        let scene = ["render", &triangle, "--method", "reference", "--size", "4x4", "--samples", "1", "-o", &out];
        let output = run(&[&scene[..], arguments].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stderr(&output).to_owned()
    };
    assert!(lit(&[]).contains("no light: --env studio is added"));
    assert!(!lit(&["--env", &map]).contains("no light") && !lit(&["--env", "none"]).contains("no light"));

    let bad = |arguments: &[&str], what: &str| fail(&[&["render", &triangle, "-o", &out], arguments].concat(), what);
    bad(&["--env", "missing.hdr"], "missing.hdr: cannot be read");
    bad(&["--env", "/dev/zero"], "it is not a regular file");
    let pointer = folder.path("pointer.hdr");
    std::fs::write(&pointer, "version https://git-lfs.github.com/spec/v1\n").unwrap();
    bad(&["--env", &pointer], "git lfs pull");
    bad(&["--env", "sky:95"], "sky:95: is no sky: write sky:ELEVATION");
    bad(&["--env", "sky:30,11"], "turbidity of 1 to 10");
    bad(&["--env", "sky:"], "such as sky:30,3");
    bad(&["--env-scale", "-1"], "--env-scale -1: has to be 0 to");
    bad(&["--env-rotate", "720"], "--env-rotate 720: has to be -360 to 360");
    bad(&["--env-scale", "2"], "has no environment to be scaled or rotated; `--env FILE` gives it one");
}

/// `--exposure auto` and its number give the same bytes, and neither changes an .exr.
#[test]
fn the_exposure_that_is_printed_repeats_the_picture() {
    let folder = Folder::new("stops");
    let [png, again, exr, json] = ["a.png", "b.png", "c.exr", "a.json"].map(|name| folder.path(name));
    let render = |path: &str, options: &[&str]| {
        let scene = ["render", "builtin:cornell_point", "--method", "reference", "--size", "32x32", "--samples", "4"];
        let output = run(&[&scene[..], &["-o", path], options].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        stderr(&output).to_owned()
    };
    let said = render(&png, &["--stats", &json]);
    let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let stops = stats["exposure_stops"].as_f64().unwrap();
    assert!(said.contains(&format!("exposure {stops:+.2} stops (auto), agx")), "{said}");
    assert_eq!(stats["tonemap"], "agx");
    let said = render(&again, &["--exposure", &format!("{stops:.2}"), "--tonemap", "agx"]);
    assert!(said.contains("stops, agx"), "{said}");
    assert!(std::fs::read(&png).unwrap() == std::fs::read(&again).unwrap());
    render(&again, &["--tonemap", "clip"]);
    assert!(std::fs::read(&png).unwrap() != std::fs::read(&again).unwrap(), "canary: another curve");

    let said = render(&exr, &[]);
    assert!(!said.contains("exposure"), "radiance has none: {said}");
    let grade = Grade { stops: stops as f32, tonemap: Tonemap::Agx };
    let film = Film::load(&exr).unwrap();
    assert_eq!(film.to_srgb8(1.0).len(), grade.picture(&film).len());
    assert_eq!(Film::load(&png).unwrap().to_srgb8(1.0), grade.picture(&film));
    // Middle tones are neither black nor white.
    let mut bytes = grade.picture(&film);
    bytes.sort_unstable();
    let median = bytes[bytes.len() / 2];
    assert!((38..192).contains(&median), "{median}");
}

/// All frames have the exposure of the first one, so that an animation does not flicker.
#[test]
fn frames_keep_the_exposure_of_the_first() {
    let folder = Folder::new("frames");
    let stops = |name: &str| {
        let stats = std::fs::read_to_string(folder.path(name)).unwrap();
        serde_json::from_str::<Value>(&stats).unwrap()["exposure_stops"].as_f64().unwrap()
    };
    let render = |options: &[&str]| {
        let scene = ["render", "builtin:sea", "--method", "reference", "--size", "16x9", "--samples", "1", "--quiet"];
        let output =
            run(&[&scene[..], &["-o", &folder.path("f.png"), "--stats", &folder.path("f.json")], options].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    };
    render(&["--frames", "0..1", "--fps", "0.3"]);
    assert_eq!(stops("f_0000.json"), stops("f_0001.json"));
    render(&["--at", "3.3333"]);
    assert!(stops("f.json") != stops("f_0001.json"), "canary: alone it has another");
}

#[test]
fn raster_renders_exr_png_and_stats() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("raster");
    let [exr, png, json] = ["out.exr", "out.png", "out.json"].map(|name| folder.path(name));
    rendered(&exr, &["--stats", &json, "--quiet"]);
    rendered(&png, &["--exposure", "-1", "--tonemap", "clip"]);
    assert_eq!(folder.files(), ["out.exr", "out.json", "out.png"], "nothing half-written is left");

    let film = Film::load(&exr).unwrap();
    assert_eq!((film.width, film.height, film.non_finite()), (64, 64, 0));
    let mean = |film: &Film| film.pixels.iter().flatten().sum::<f32>() / (film.pixels.len() * 3) as f32;
    assert!(mean(&film) > 0.01, "{}", mean(&film));
    // The PNG is the picture at half exposure, within half a step of eight bits and with clipping.
    let dark = Film::load(&png).unwrap();
    let expected = Film { pixels: film.pixels.iter().map(|p| p.map(|v| (0.5 * v).min(1.0))).collect(), ..film };
    assert!((mean(&dark) / mean(&expected) - 1.0).abs() < 0.01, "{} {}", mean(&dark), mean(&expected));

    let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(stats["method"], "raster");
    assert_eq!(stats["size"], serde_json::json!([64, 64]));
    assert_eq!(stats["samples"], 4);
    assert!(stats["exposure_stops"].is_null() && stats["tonemap"].is_null(), "an .exr has none");
    assert_eq!(stats["non_finite"], 0);
    assert_eq!(stats["lost_nodes"], 0);
    assert_eq!(stats["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(stats["settings"]["bounces"], 2);
    assert_eq!(stats["scene"], "builtin:cornell_point");
    assert!(stats["device"].as_str().is_some_and(|d| !d.is_empty()));
    assert!(stats["redone"].is_u64() && stats["warnings"].is_array());
    for phase in ["load", "setup", "compile", "render"] {
        assert!(stats["seconds"][phase].as_f64().is_some_and(|s| s >= 0.0), "{phase}");
    }
    assert!(stats["bytes"].as_u64() > Some(64 * 64 * 16) && stats["scene_bytes"].as_u64() > Some(0));
    let requests = stats["requests"].as_array().unwrap();
    assert_eq!(requests[0]["view"], "light");
    assert!(requests.iter().any(|d| d["nodes"].as_u64() > Some(0) && d["items"].as_u64() > Some(0)), "{requests:?}");
    // The passes that the plan runs are those that were timed.
    let planned = stats["plan"]["passes"].as_array().unwrap();
    assert!(planned.len() > 5);
    if common::gpu().is_some_and(|gpu| gpu.capabilities.timestamps) {
        let passes = stats["passes"].as_object().unwrap();
        assert!(passes.values().all(|p| p["runs"].as_u64() > Some(0) && p["gpu_millis"].is_number()), "{passes:?}");
        for pass in planned.iter().filter(|pass| pass["runs"].as_u64() > Some(0)) {
            let name = pass["name"].as_str().unwrap();
            assert!(passes.keys().any(|timed| timed.starts_with(name)), "{name} is not among {passes:?}");
        }
    }
}

#[test]
fn ray_query_methods_render_stats_strategy_images_and_plans() {
    if common::gpu_with_ray_queries().is_none() {
        let output = run(&["render", "builtin:cornell_point", "-o", "out.exr", "--method", "path"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("--method raster"), "{}", stderr(&output));
        return;
    }
    for (method, count) in [("path", 3 + 2), ("ray-query", 2 + 3 + 4)] {
        let folder = Folder::new(method);
        let [exr, json, images] = ["out.exr", "out.json", "strategies"].map(|name| folder.path(name));
        let more = ["--method", method, "--bounces", "1", "--quiet"];
        rendered(&exr, &[&more[..], &["--stats", &json, "--strategy-images", &images]].concat());
        let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        assert_eq!((&stats["method"], &stats["samples"], &stats["non_finite"]), (&method.into(), &4.into(), &0.into()));
        for pass in stats["plan"]["passes"].as_array().unwrap() {
            let name = pass["name"].as_str().unwrap();
            assert_eq!(pass["runs"].as_u64() > Some(0), stats["passes"][name]["runs"].as_u64() > Some(0), "{name}");
        }
        // Each strategy has an image with and without its weight; the weighted images add up to the picture.
        let files: Vec<_> = std::fs::read_dir(&images).unwrap().map(|f| f.unwrap().path()).collect();
        assert_eq!(files.len(), 2 * count, "{files:?}");
        let sum = |film: &Film| film.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>();
        let weighted = files.iter().filter(|f| !f.to_string_lossy().contains("unweighted"));
        let total: f64 = weighted.map(|f| sum(&Film::load(f).unwrap())).sum();
        let whole = sum(&Film::load(&exr).unwrap());
        assert!((total / whole - 1.0).abs() < 1e-5, "{method}: {total} is not {whole}");

        let plan = succeed(&["plan", "builtin:cornell_point", "--method", method]);
        assert!(plan.contains("eye_paths") && plan.contains("memory"), "{plan}");
    }
}

#[test]
fn the_seed_decides_every_byte() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("seed");
    let [a, b, c] = ["a.exr", "b.exr", "c.exr"].map(|name| folder.path(name));
    let first = rendered(&a, &[]);
    assert!(first == rendered(&b, &[]), "the same seed gives other bytes");
    assert!(first != rendered(&c, &["--seed", "2"]), "another seed gives the same bytes");

    // `compare` tells these files apart.
    let same: Value = serde_json::from_str(&succeed(&["compare", &b, &a, "--json", "--max-rel-mse", "0"])).unwrap();
    for figure in ["mse", "rel_mse", "mean_bias", "p999", "flip", "non_finite"] {
        assert_eq!(same[figure].as_f64(), Some(0.0), "{figure}");
    }
    let other = run(&["compare", &c, &a, "--max-rel-mse", "1e-9"]);
    assert_eq!(other.status.code(), Some(1), "{}", stderr(&other));
    assert!(stderr(&other).contains("rel_mse"), "{}", stderr(&other));
}

#[test]
fn closing_line_and_warnings() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("closing");
    let out = folder.path("out.exr");
    let loud = render(&out, &[]);
    let text = stderr(&loud);
    assert_eq!(text.lines().count(), 1, "{text}");
    for part in [out.as_str(), "64x64", "load", "setup", "render"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert_eq!(stderr(&render(&out, &["--quiet"])), "");

    // A quad without camera and light gets both, and each is said once.
    let bare = folder.path("bare.xml");
    std::fs::write(&bare, "<scene version=\"3.0.0\"><shape type=\"rectangle\"/></scene>").unwrap();
    let result = run(&["render", &bare, "-o", &out, "--size", "16x16", "--samples", "1", "--quiet"]);
    assert_eq!(result.status.code(), Some(0), "{}", stderr(&result));
    for what in ["no camera", "no light"] {
        assert_eq!(stderr(&result).matches(what).count(), 1, "{}", stderr(&result));
    }
    assert!(stderr(&result).lines().all(|line| line.starts_with("note: ")), "{}", stderr(&result));
}

/// Samples double until half of them agree with all of them, or until the budget ends.
#[test]
fn an_error_that_is_asked_for_is_reached() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("target-error");
    let [out, json, truth] = ["out.exr", "out.json", "truth.exr"].map(|name| folder.path(name));
    let render = |more: &[&str]| {
        let scene = ["render", "builtin:cornell_point", "--size", "32x32", "-o", &out, "--stats", &json];
        succeed(&[&scene[..], more].concat());
        let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        let taken = stats["taken"].as_f64();
        assert!(taken.is_none_or(|taken| taken > 0.0 && taken <= 1.0), "{taken:?}");
        assert_eq!(taken.is_some(), more[0] == "--target-error");
        (stats["samples"].as_u64().unwrap(), stats["estimated_error"].as_f64())
    };
    let [rough, fine] = ["0.02", "0.002"].map(|error| render(&["--target-error", error]));
    assert!(rough.0 >= 16 && rough.0 < fine.0, "{rough:?} {fine:?}");
    assert!(rough.1.unwrap() <= 0.02 && fine.1.unwrap() <= 0.002, "{rough:?} {fine:?}");
    succeed(&["render", "builtin:cornell_point", "--size", "32x32", "-o", &truth, "--samples", "1024", "--seed", "7"]);
    let error = compare(&Film::load(&out).unwrap(), &Film::load(&truth).unwrap()).unwrap().rel_mse;
    assert!(error < 0.004, "{error} where 0.002 was asked for");
    let (samples, _) = render(&["--target-error", "1e-8", "--budget", "0.5"]);
    assert!(samples < 1 << 20);
    assert_eq!(render(&["--samples", "2"]).1, None);
}

/// Without samples, budget and error the render ends at little visible noise, also with the reference.
#[test]
fn a_render_without_an_end_has_one() {
    let folder = Folder::new("default-end");
    let [out, json] = ["out.exr", "out.json"].map(|name| folder.path(name));
    let methods: &[&str] = if common::gpu().is_some() { &["raster", "reference"] } else { &["reference"] };
    for method in methods {
        let scene = ["render", "builtin:cornell_point", "--size", "32x32", "-o", &out, "--stats", &json];
        let output = run(&[&scene[..], &["--method", method]].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        let (error, samples) = (stats["estimated_error"].as_f64().unwrap(), stats["samples"].as_u64().unwrap());
        assert!(error <= 0.003 && stats["ended_by"] == "target-error", "{method}: {stats}");
        let closing = format!(" after {samples} samples by {method} on ");
        let text = stderr(&output);
        assert!(text.contains("estimated rel_mse 0.00") && text.contains(&closing), "{text}");
    }
    let plan = |more: &[&str]| succeed(&[&["plan", "builtin:cornell_point"], more].concat());
    if common::gpu().is_some() {
        let settles =
            |more: &[&str]| plan(&[&["--interleave", "1"], more].concat()).contains("tiles that have converged");
        assert!(settles(&[]) && !settles(&["--samples", "4"]));
    }
}

#[test]
fn a_budget_ends_the_render() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("budget");
    let [out, json] = ["out.exr", "out.json"].map(|name| folder.path(name));
    for method in ["raster", "reference"] {
        let scene = "builtin:cornell_point";
        succeed(&[
            "render", scene, "-o", &out, "--size", "32x32", "--budget", "0.5", "--method", method, "--stats", &json,
        ]);
        let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
        assert!(stats["samples"].as_u64() >= Some(1) && stats["ended_by"] == "budget", "{method}");
        assert!(stats["seconds"]["render"].as_f64() < Some(20.0), "{method}");
        assert_eq!(Film::load(&out).unwrap().non_finite(), 0);
    }
}

#[test]
fn reference_renders_without_a_gpu() {
    let folder = Folder::new("reference");
    let [exr, same, json] = ["out.exr", "same.exr", "out.json"].map(|name| folder.path(name));
    let reference = ["--method", "reference", "--bounces", "unlimited"];
    let first = rendered(&exr, &[&reference[..], &["--stats", &json]].concat());
    assert!(first == rendered(&same, &reference));
    let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(stats["settings"]["bounces"], "unlimited");
    assert_eq!(stats["non_finite"], 0);
    assert!(stats["rays"].as_u64() > Some(64 * 64 * 4));
    assert!(stats["plan"].is_null());

    // Another camera position gives another picture; the scene's own position as numbers gives the same.
    let moved = ["--eye", "-0.1,1,3", "--target=0,1,0", "--fov", "30"];
    assert!(first != rendered(&same, &[&reference[..], &moved].concat()));
    assert!(first == rendered(&same, &[&reference[..], &["--camera", "camera"]].concat()));
    // A lens blurs, unless its radius is 0.
    assert!(first != rendered(&same, &[&reference[..], &["--aperture", "0.1", "--focus", "3"]].concat()));
    assert!(first == rendered(&same, &[&reference[..], &["--aperture", "0"]].concat()));
}

#[test]
fn compare_tells_images_apart() {
    let folder = Folder::new("compare");
    let [a, b, other_size, map] = ["a.exr", "b.exr", "size.exr", "map.png"].map(|name| folder.path(name));
    // With r = 0.5 and x = 0.51, rel_mse is 1e-4 / 0.26 and the bias 2 %.
    let gray = |width: u32, value: f32| Film { width, height: 16, pixels: vec![[value; 3]; width as usize * 16] };
    gray(16, 0.5).save(&a).unwrap();
    gray(16, 0.51).save(&b).unwrap();
    gray(8, 0.5).save(&other_size).unwrap();

    let table = succeed(&["compare", &a, &a, "--max-rel-mse", "0", "--max-bias", "0"]);
    assert!(table.contains("mean_bias") && table.contains("+0.0000 %"), "{table}");
    let json: Value = serde_json::from_str(&succeed(&["compare", &b, &a, "--json", "--heatmap", &map])).unwrap();
    assert!((json["rel_mse"].as_f64().unwrap() - 1e-4 / 0.26).abs() < 1e-7, "{json}");
    assert!((json["mean_bias"].as_f64().unwrap() - 0.02).abs() < 1e-6, "{json}");
    assert_eq!(Film::load(&map).unwrap().width, 16);

    let limit = |options: &[&str]| run(&[&["compare", &b, &a], options].concat()).status.code();
    assert_eq!(limit(&["--max-rel-mse", "0.0004", "--max-bias", "0.021"]), Some(0));
    assert_eq!(limit(&["--max-rel-mse", "0.0003"]), Some(1));
    assert_eq!(limit(&["--max-bias", "0.019"]), Some(1));
    fail(&["compare", &b, &a, "--max-bias", "-1"], "--max-bias");
    fail(&["compare", &other_size, &a], "render one of them at the other's size");
    fail(&["compare", &folder.path("none.exr"), &a], "none.exr");
    fail(&["compare", &b, &a, "--heatmap", &folder.path("map.exr")], ".png");

    // An image with a value that is not finite passes no threshold.
    let mut hole = gray(16, 0.5);
    hole.pixels[3][1] = f32::NAN;
    hole.save(&b).unwrap();
    assert_eq!(limit(&["--max-rel-mse", "1e9"]), Some(1));
}

#[test]
fn plan_gives_a_reason_for_every_pass() {
    if common::gpu().is_none() {
        return;
    }
    let text = succeed(&["plan", "builtin:cornell_point"]);
    for pass in ["gbuffer", "connect", "extend", "accumulate"] {
        assert!(text.contains(pass), "{text}");
    }
    let json: Value = serde_json::from_str(&succeed(&["plan", "builtin:cornell_point", "--json"])).unwrap();
    let passes = json["passes"].as_array().unwrap();
    assert!(passes.len() > 5);
    assert!(passes.iter().all(|p| p["reason"].as_str().is_some_and(|r| !r.is_empty())), "{passes:?}");
    let direct = succeed(&["plan", "builtin:cornell_point", "--bounces", "0", "--bundle-resolution", "64"]);
    assert!(direct.contains("skip") && direct.contains("bundles 64^2"), "{direct}");
    fail(&["plan", "builtin:cornell_point", "--method", "reference"], "has no plan");
}
