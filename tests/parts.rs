//! Tests of pictures in parts: ranges of samples that `lightsheaf merge` joins, and states from which a render
//! goes on.

use std::process::{Command, Output};

use clap::Parser as _;
use common::folder::Folder;
use lightsheaf::film::Film;
use lightsheaf::film::exr::Picture;
use lightsheaf::film::filtered::FilteredFilm;
use lightsheaf::film::record::{Record, SampleRange};
use lightsheaf::gpu::{Gpu, GpuError};
use lightsheaf::metrics::compare;
use lightsheaf::render::{self, RenderError, Renderer};
use lightsheaf::scene;
use lightsheaf::settings::Settings;

mod common;

/// Scenes and options of pictures on a device.
const CASES: [(&str, &str); 18] = [
    ("builtin:cornell_glossy", "--interleave 1"),
    ("builtin:cornell_area", "--interleave auto"),
    ("builtin:cornell_glossy", "--interleave 3"),
    ("builtin:cornell_glossy", "--interleave 3 --tame-outliers"),
    ("builtin:cornell_point", "--interleave 2 --unfiltered"),
    ("builtin:cornell_point", "--interleave 2 --upsample 2"),
    ("builtin:cornell_point", "--visibility fast --interleave 1"),
    ("builtin:cornell_area", "--visibility bvh --interleave 1"),
    ("builtin:cornell_area", "--method twin --interleave 1"),
    ("builtin:cornell_mirrors", "--interleave 1"),
    ("builtin:point_hall:9", "--light-sampling ris --interleave 1"),
    ("builtin:point_hall:9", "--light-sampling restir --interleave 1"),
    ("builtin:cornell_area", "--strategies vpl --interleave 1"),
    ("builtin:cornell_glossy", "--method bdpt"),
    ("builtin:cornell_area", "--method bdpt --visibility ray-query"),
    ("builtin:cornell_glossy", "--method path"),
    ("builtin:point_hall:9", "--method path --light-sampling ris"),
    ("builtin:point_hall:9", "--method path --light-sampling restir"),
];

/// Samples of a picture.
const SAMPLES: u64 = 16;

/// Largest rel_mse of a merged picture, which is due to rounding to 32 bits.
const ROUNDING: f64 = 1e-10;

#[derive(clap::Parser)]
#[command(no_binary_name = true)]
struct Options {
    #[command(flatten)]
    settings: Settings,
}

fn settings(options: &str) -> Settings {
    let settings = Options::try_parse_from(options.split_whitespace()).unwrap().settings;
    Settings { width: 24, height: 18, ..settings }
}

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lightsheaf")).args(arguments).env_remove("RUST_LOG").output().unwrap()
}

/// Runs the program, which has to succeed.
fn succeed(arguments: &[&str]) -> String {
    let output = run(arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {text}");
    text
}

/// Runs the program, which has to exit with code 2 and one error that contains `what`.
fn fail(arguments: &[&str], what: &str) {
    let output = run(arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(text.matches("error: ").count() == 1 && text.contains(what), "{arguments:?}: `{what}` is not in: {text}");
}

/// Returns `parts` ranges that divide the samples.
fn ranges(parts: u64) -> Vec<SampleRange> {
    let end = |part: u64| part * SAMPLES / parts;
    (0..parts).map(|part| SampleRange { first: end(part) + 1, last: end(part + 1) }).collect()
}

fn add(renderer: &mut dyn Renderer, samples: u64) -> Result<(), RenderError> {
    renderer.render(samples, &mut |_| true)
}

/// Renders each case with a renderer of its own.
fn for_each_case(mut test: impl FnMut(&str, &mut dyn FnMut() -> Box<dyn Renderer + 'static>)) {
    let Some(_) = common::gpu() else { return };
    let Some(_) = common::gpu_with_ray_queries() else { return };
    for (spec, options) in CASES {
        let settings = settings(options);
        let needs = settings.technique.needs_ray_queries();
        let gpu: &'static Gpu = Box::leak(Box::new(if needs { Gpu::with_ray_queries() } else { Gpu::new() }.unwrap()));
        let scene = scene::load(spec).unwrap();
        test(&format!("{spec} {options}"), &mut || render::open(gpu, &scene, &settings).unwrap());
    }
}

/// Merges pictures of ranges by the program. Filtered ones say what the filter took away.
fn merged(folder: &Folder, parts: &[(SampleRange, Film, Option<FilteredFilm>)]) -> Picture {
    let paths: Vec<String> = (0..parts.len()).map(|n| folder.path(&format!("{n}.exr"))).collect();
    for ((range, film, filtered), path) in parts.iter().zip(&paths) {
        let (ranges, seconds) = (vec![*range], 0.5);
        let record = Record { samples: range.count(), ranges, seconds, ..Record::default() };
        let channels = filtered.as_ref().map_or_else(Vec::new, FilteredFilm::channels);
        Picture { film: film.clone(), channels, record: Some(record), ..Picture::default() }.save(path).unwrap();
    }
    let out = folder.path("out.exr");
    let mut arguments = vec!["merge", "-o", &out];
    // The order of the parts is not that of the samples.
    arguments.extend(paths.iter().rev().map(String::as_str));
    succeed(&arguments);
    Picture::load(&out).unwrap()
}

#[test]
fn merged_parts_are_the_picture_of_all_samples() {
    let (mut worst, mut combined) = (0.0_f64, 0);
    for_each_case(|name, open| {
        let folder = Folder::new("parts");
        let mut renderer = open();
        add(renderer.as_mut(), SAMPLES).unwrap();
        let whole = renderer.film().unwrap();
        assert!(whole.pixels.iter().flatten().any(|&value| value > 0.0) && whole.non_finite() == 0, "{name}");
        let mut samples = Vec::new();
        for parts in [2, 3, 8] {
            let mut films = Vec::new();
            for range in ranges(parts) {
                renderer.begin_at(range.first - 1).unwrap();
                add(renderer.as_mut(), range.count()).unwrap();
                assert_eq!((renderer.stats().samples, renderer.samples()), (range.count(), range.last), "{name}");
                films.push((range, renderer.film().unwrap(), renderer.filtered_film().unwrap()));
            }
            let given_back = |part: &FilteredFilm| part.shares().iter().flatten().any(|&share| share > 0.0);
            combined += films.iter().filter(|part| part.2.as_ref().is_some_and(given_back)).count();
            let picture = merged(&folder, &films);
            let record = picture.record.unwrap();
            assert_eq!((record.samples, record.ranges), (SAMPLES, vec![SampleRange { first: 1, last: SAMPLES }]));
            assert_eq!(record.seconds, 0.5 * parts as f64);
            let error = compare(&picture.film, &whole).unwrap().rel_mse;
            println!("{name}: {parts} parts, rel_mse {error:.1e}");
            assert!(error <= ROUNDING, "{name}: {parts} parts differ by {error}");
            worst = worst.max(error);
            samples = films;
        }
        let alike = compare(&samples[0].1, &samples[1].1).unwrap().rel_mse;
        assert!(alike > 1e-6, "{name}: canary: other samples give another picture, {alike}");
        renderer.begin_at(0).unwrap();
        add(renderer.as_mut(), SAMPLES).unwrap();
        assert!(renderer.film().unwrap() == whole, "{name}: a range from the first sample on is the whole");
    });
    assert!(combined > 0, "some parts get back what the filter took away");
    println!("worst rel_mse {worst:.1e}");
}

/// A renderer that takes over a state renders the same bits as one that never stopped.
#[test]
fn a_state_goes_on_bit_for_bit() {
    let goes_on = |name: &str, open: &mut dyn FnMut() -> Box<dyn Renderer>| {
        let mut whole = open();
        add(whole.as_mut(), 9).unwrap();
        let mut first = open();
        add(first.as_mut(), 5).unwrap();
        let state = first.state().unwrap();
        drop(first);
        let mut second = open();
        second.restore(&state).unwrap();
        add(second.as_mut(), 4).unwrap();
        assert!(second.film().unwrap() == whole.film().unwrap(), "{name}");
        assert_eq!((second.samples(), second.stats().samples), (9, 9), "{name}");
        let mut fresh = open();
        add(fresh.as_mut(), 4).unwrap();
        assert!(fresh.film().unwrap() != whole.film().unwrap(), "{name}: canary");
        let mut bad = state;
        bad.buffers[0].pop();
        let refused = fresh.restore(&bad).unwrap_err().to_string();
        assert!(refused.contains("another picture"), "{name}: {refused}");
    };
    for_each_case(goes_on);
    let Some(gpu) = common::gpu() else { return };
    for (spec, options) in [
        ("builtin:cornell_area", "--interleave 2 --history 8"),
        ("builtin:cornell_area", "--interleave 2 --history 8 --upsample 2"),
        ("builtin:point_hall:9", "--method path --light-sampling restir --restir-memory 8"),
    ] {
        let (scene, settings) = (scene::load(spec).unwrap(), settings(options));
        let open = || render::open(gpu, &scene, &settings).unwrap();
        goes_on(options, &mut || open());
        let refused = open().begin_at(3).unwrap_err().to_string();
        assert!(refused.contains("leave it out to render a part"), "{options}: {refused}");
    }
}

/// What was read before a device is lost goes on with another one.
#[test]
fn a_lost_device_is_told_and_another_goes_on() {
    let Some(_) = common::gpu() else { return };
    // A device of its own, since it is destroyed.
    let gpu = Gpu::new().unwrap();
    let (scene, settings) = (scene::load("builtin:cornell_point").unwrap(), settings("--interleave 1"));
    let mut renderer = render::open(&gpu, &scene, &settings).unwrap();
    add(renderer.as_mut(), 3).unwrap();
    let state = renderer.state().unwrap();
    gpu.device.destroy();
    let error = add(renderer.as_mut(), 3).unwrap_err();
    assert!(matches!(error, RenderError::Gpu(GpuError::Lost(_))), "{error:?}");
    let other = Gpu::new().unwrap();
    let mut renderer = render::open(&other, &scene, &settings).unwrap();
    renderer.restore(&state).unwrap();
    add(renderer.as_mut(), 3).unwrap();
    let mut whole = render::open(&other, &scene, &settings).unwrap();
    add(whole.as_mut(), 6).unwrap();
    assert!(renderer.film().unwrap() == whole.film().unwrap());
}

/// Parts by the program: the reference and a device, refusals, and what a file says about itself.
#[test]
fn the_program_renders_and_merges_parts() {
    let folder = Folder::new("program");
    let [a, b, c, out, other] = ["a.exr", "b.exr", "c.exr", "out.exr", "other.exr"].map(|name| folder.path(name));
    let render = |scene: &str, out: &str, more: &[&str]| {
        let base = ["render", scene, "-o", out, "--size", "16x12", "--method", "reference", "-q"];
        succeed(&[&base, more].concat());
    };
    let cornell = "builtin:cornell_area";
    render(cornell, &a, &["--sample-range", "1..4"]);
    render(cornell, &b, &["--sample-range", "5..6"]);
    render(cornell, &c, &["--sample-range", "7..16"]);
    render(cornell, &other, &["--samples", "16"]);
    succeed(&["merge", &a, &b, &c, "-o", &out]);
    let [merged, whole] = [&out, &other].map(|path| Picture::load(path).unwrap());
    assert!(compare(&merged.film, &whole.film).unwrap().rel_mse <= ROUNDING);
    let [merged, whole] = [merged, whole].map(|picture| picture.record.unwrap());
    assert_eq!((merged.samples, &merged.ranges), (16, &whole.ranges));
    assert_eq!((&merged.scene_hash, &merged.settings_hash), (&whole.scene_hash, &whole.settings_hash));
    assert!(merged.command.contains("merge") && whole.command.contains("--samples 16"), "{whole:?}");
    assert_eq!((whole.version.as_str(), whole.seed, whole.scene.as_str()), (env!("CARGO_PKG_VERSION"), 1, cornell));
    assert!(whole.seconds > 0.0 && whole.device.contains("CPU") && whole.scene_hash.len() == 64, "{whole:?}");

    // A merged file is a part, too.
    let both = folder.path("both.exr");
    succeed(&["merge", &a, &b, "-o", &both, "-q"]);
    succeed(&["merge", &both, &c, "-o", &out, "-q"]);
    let before = std::fs::read(&out).unwrap();
    fail(&["merge", &both, &b, "-o", &out], "both have the samples 5..6; leave one out");
    fail(&["merge", &a, &c, "-o", &out], "the samples 5..6 are in no part");
    fail(&["merge", &b, &c, "-o", &out], "the samples 1..4 are in no part");
    render(cornell, &other, &["--sample-range", "5..6", "--seed", "7"]);
    fail(&["merge", &a, &other, "-o", &out], "other settings: seed (1 and 7)");
    render("builtin:cornell_point", &other, &["--sample-range", "5..6"]);
    fail(&["merge", &a, &other, "-o", &out], "show other scenes, builtin:cornell_area and builtin:cornell_point");
    let text = std::fs::read(&a).unwrap();
    std::fs::write(&other, &text[..text.len() / 2]).unwrap();
    fail(&["merge", &b, &other, "-o", &out], "other.exr: the image cannot be read");
    std::fs::write(&other, &text[..200]).unwrap();
    fail(&["merge", &b, &other, "-o", &out], "other.exr: the image cannot be read");
    Film::new(16, 12).save(&other).unwrap();
    fail(&["merge", &a, &other, "-o", &out], "does not say which samples it has");
    fail(&["merge", &a, &b, "-o", "/proc/out.exr"], "cannot be written");
    fail(&["merge", &a, &folder.path("none.exr"), "-o", &out], "none.exr");
    assert!(std::fs::read(&out).unwrap() == before, "what was there is left unchanged");
    succeed(&["merge", &a, &c, "-o", &out, "--allow-gaps", "-q"]);
    let record = Picture::load(&out).unwrap().record.unwrap();
    assert_eq!(record.samples, 14);
    assert_eq!(record.ranges, [SampleRange { first: 1, last: 4 }, SampleRange { first: 7, last: 16 }]);

    let bad = |range: &str, more: &[&str], what: &str| {
        let base = ["render", "builtin:cornell_area", "-o", &out, "--sample-range", range];
        fail(&[&base, more].concat(), what);
    };
    bad("0..4", &[], "two numbers from 1 on");
    bad("1..16777217", &[], "the last sample has to be 16777216 at most");
    bad("1..4", &["--samples", "4"], "cannot be used with");
    bad("1..4", &["--target-error", "0.1"], "cannot be used with");
}
