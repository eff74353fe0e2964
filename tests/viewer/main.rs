//! The viewer as a user has it: a window on a display of its own, keys, mouse, screenshots.
//!
//! UPDATE_GOLDEN=1 rewrites tests/golden/viewer_*.png. A failure leaves the actual picture in
//! target/golden-failures.
#![cfg(all(feature = "viewer", target_os = "linux"))]

#[path = "../common/mod.rs"]
mod common;
mod display;
mod xdnd;

use std::path::Path;
use std::time::{Duration, Instant};

use common::folder::Folder;
use common::random::Random;
use display::{Display, Viewer};
use image::RgbImage;
use image::imageops::{FilterType, crop_imm, resize};

/// Columns of golden pictures, about.
const WIDTH: u32 = 320;
/// Rows of the line at the bottom, which counts samples.
const LINE: u32 = 26;
/// Mean difference of 8-bit values that other noise, fonts and drivers may make.
const TOLERANCE: f64 = 4.0;

/// Exposure and tone curve of golden pictures, which do not depend on the picture.
const TONEMAP: [&str; 4] = ["--exposure", "0", "--tonemap", "clip"];

/// Opens the display if there is a device to render with.
fn display() -> Option<Display> {
    common::gpu_with_ray_queries()?;
    Display::open()
}

fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let sum: u64 = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.as_raw().len() as f64
}

/// Returns the window without its last line, scaled down.
fn seen(viewer: &Viewer) -> RgbImage {
    let full = viewer.look();
    let (width, height) = full.dimensions();
    let above = crop_imm(&full, 0, 0, width, height - LINE).to_image();
    let shrink = (width / WIDTH).max(1);
    resize(&above, width / shrink, (height - LINE) / shrink, FilterType::Triangle)
}

/// Compares the window with a golden picture until they are alike.
fn check(viewer: &mut Viewer, name: &str) -> RgbImage {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.join(format!("tests/golden/viewer_{name}.png"));
    if common::is_set("UPDATE_GOLDEN") {
        viewer.listen(Duration::from_secs(15));
        let picture = seen(viewer);
        picture.save(&path).unwrap();
        return picture;
    }
    let golden = image::open(&path).unwrap_or_else(|e| panic!("{name}: {e}; UPDATE_GOLDEN=1 writes it")).into_rgb8();
    let began = Instant::now();
    loop {
        viewer.listen(Duration::from_millis(500));
        let actual = seen(viewer);
        let difference = difference(&actual, &golden);
        if difference <= TOLERANCE {
            return actual;
        }
        if began.elapsed() > Duration::from_secs(60) {
            let folder = root.join("target/golden-failures");
            std::fs::create_dir_all(&folder).unwrap();
            let left = folder.join(format!("viewer_{name}.png"));
            actual.save(&left).unwrap();
            panic!("{name}: differs by {difference:.1} of 255; see {} and {}", left.display(), path.display());
        }
    }
}

#[test]
fn a_user_looks_around() {
    let Some(display) = display() else { return };
    let folder = Folder::new("user");
    let mut viewer = display.view(&folder.0, &[&["builtin:cornell_point", "--size", "640x360"][..], &TONEMAP].concat());
    let start = check(&mut viewer, "start");

    // Without the panel, then from elsewhere, then as before.
    viewer.keys(&["h"]);
    let bare = check(&mut viewer, "bare");
    assert!(difference(&start, &bare) > 2.0 * TOLERANCE, "canary: these are two pictures");
    viewer.drag("1", [400, 150], [330, 170]);
    check(&mut viewer, "orbit");
    viewer.keys(&["r"]);
    check(&mut viewer, "bare");

    // Features, and another method beside the first.
    viewer.keys(&["n"]);
    check(&mut viewer, "normals");
    viewer.keys(&["b"]);
    check(&mut viewer, "albedo");
    viewer.keys(&["l", "c", "4"]);
    viewer.keys(&["n"]);
    check(&mut viewer, "compare");
    // The line between them.
    viewer.drag("1", [320, 200], [120, 200]);
    check(&mut viewer, "divider");
    viewer.keys(&["c", "h"]);
    check(&mut viewer, "start");
    if common::is_set("UPDATE_GOLDEN") {
        common::rewritten("UPDATE_GOLDEN", Path::new("tests/golden/viewer_*.png"));
    }

    // Files.
    viewer.keys(&["p", "x"]);
    let began = Instant::now();
    let [png, exr] = ["png", "exr"].map(|extension| folder.0.join(format!("cornell_point_001.{extension}")));
    while !(png.exists() && exr.exists()) {
        assert!(began.elapsed() < Duration::from_secs(30), "no files");
        viewer.listen(Duration::from_millis(100));
    }
    let film = lightsheaf::film::Film::load(&exr).unwrap();
    assert_eq!(image::open(&png).unwrap().into_rgb8().dimensions(), (film.width, film.height));
    viewer.is_well();
}

#[test]
fn lights_settings_and_windows_change() {
    let Some(display) = display() else { return };
    let folder = Folder::new("panel");
    let scene = ["builtin:cornell_point", "--size", "640x360", "--bounces", "1"];
    let mut viewer = display.view(&folder.0, &[&scene[..], &TONEMAP].concat());
    let start = seen(&viewer);
    // The section of lights, and its strength dragged down.
    viewer.click(50, 263);
    viewer.listen(Duration::from_secs(2));
    viewer.drag("1", [70, 284], [10, 284]);
    check(&mut viewer, "lights");
    assert!(difference(&seen(&viewer), &start) > TOLERANCE);
    // Large, minimized and back, and as small as it gets.
    viewer.resize(1280, 720);
    check(&mut viewer, "large");
    viewer.show(false);
    viewer.listen(Duration::from_secs(1));
    viewer.show(true);
    check(&mut viewer, "large");
    viewer.resize(340, 220);
    check(&mut viewer, "small");
    viewer.is_well();
}

/// A file that is dropped takes the place of the scene, and one that is none leaves it there, with the
/// reason.
#[test]
fn files_are_dropped_on_the_window() {
    let Some(display) = display() else { return };
    let folder = Folder::new("drop");
    let scene = folder.0.join("a white ball.xml");
    let ball = r#"<scene version="3.0.0">
        <sensor type="perspective"><transform name="to_world">
            <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
        <shape type="sphere"/>
        <emitter type="point"><point name="position" x="2" y="2" z="4"/><rgb name="intensity" value="40"/></emitter>
    </scene>"#;
    std::fs::write(&scene, ball).unwrap();
    let mut viewer = display.view(&folder.0, &["builtin:cornell_point", "--size", "640x360"]);
    let start = seen(&viewer);
    viewer.drop_file(&scene);
    viewer.wait_for("loaded ");
    // The scene before may still bring pictures.
    let began = Instant::now();
    while !viewer.title().contains("a white ball.xml") {
        assert!(began.elapsed() < Duration::from_secs(60), "{}", viewer.title());
        viewer.listen(Duration::from_millis(100));
    }
    viewer.wait_for("samples by");
    let dropped = seen(&viewer);
    assert!(difference(&start, &dropped) > TOLERANCE);

    let text = folder.0.join("notes.xml");
    std::fs::write(&text, "no scene").unwrap();
    viewer.drop_file(&text);
    viewer.listen(Duration::from_secs(2));
    assert!(viewer.title().contains("a white ball.xml"), "{}", viewer.title());
    let told = seen(&viewer);
    assert!(difference(&dropped, &told) > 0.0, "nobody was told");
    viewer.is_well();
}

/// Input is on the screen within 100 ms, whatever a sample costs: here, some seconds of all processors.
#[test]
fn input_does_not_wait_for_pictures() {
    let Some(display) = display() else { return };
    let folder = Folder::new("input");
    let scene = ["builtin:displaced_room:100000", "--size", "1280x720", "--bounces", "4"];
    let mut viewer = display.view(&folder.0, &scene);
    let mut waits = Vec::new();
    for turn in 0..20 {
        viewer.listen(Duration::from_millis(if turn % 2 == 0 { 150 } else { 430 }));
        let began = Instant::now();
        viewer.keys(&["h"]);
        let (shown, line) = viewer.wait_for("key shown after");
        let inside: f64 = line.split_whitespace().rev().nth(1).unwrap().parse().unwrap();
        waits.push((inside, (shown - began).as_secs_f64() * 1e3));
    }
    waits.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (median, most) = (waits[waits.len() / 2], waits[waits.len() * 3 / 4]);
    println!("ms from event to screen (with starting xdotool): median {median:.0?}, 75 % {most:.0?}, all {waits:.0?}");
    let costs: Vec<_> = viewer.heard("picture of").cloned().collect();
    println!("{} pictures meanwhile", costs.len());
    // Other programs may be at work on this machine, and a quarter may have had to wait for them.
    assert!(most.0 <= 100.0, "{waits:?}");
    viewer.is_well();
}

/// Random sizes, methods, layers, scenes, cameras and lights: no panic, no message, and no memory lost.
fn soak(time: Duration, seed: u64) {
    let Some(display) = display() else { return };
    let folder = Folder::new("soak");
    let mut viewer = display.view(&folder.0, &["builtin:cornell_point", "--size", "640x360"]);
    let mut random = Random(seed);
    let mut memory = Vec::new();
    let began = Instant::now();
    let mut turns = 0;
    while began.elapsed() < time {
        for _ in 0..12 {
            let mut below = |n: u64| random.below(n);
            match below(8) {
                0 => viewer.resize(340 + below(700) as u32, 220 + below(400) as u32),
                1 => viewer.keys(&[["1", "2", "3", "4", "5"][below(5)]]),
                2 => viewer.keys(&[["l", "z", "n", "b", "v"][below(5)]]),
                3 => viewer.keys(&[["h", "c", "r", "space"][below(4)]]),
                4 => viewer.drag(["1", "2", "3"][below(3)], [300, 100], [300 - below(80) as i32, 150]),
                5 => viewer.drag("1", [70, 100 + 20 * below(10) as i32], [40 + below(60) as i32, 150]),
                6 => viewer.click(20 + below(180) as i32, 10 + below(200) as i32),
                _ => viewer.keys(&[["w", "s", "a", "d", "q", "e"][below(6)]]),
            }
            viewer.listen(Duration::from_millis(100));
            turns += 1;
        }
        viewer.is_well();
        // At rest, in one state, so that figures can be compared.
        viewer.resize(640, 360);
        viewer.keys(&["Escape", "1", "l", "r"]);
        viewer.listen(Duration::from_millis(1500));
        memory.push(viewer.megabytes());
    }
    let inputs = viewer.heard("shown after").count();
    let of = |line: &String| line.split_whitespace().rev().nth(1).and_then(|n| n.parse().ok()).unwrap_or(0.0);
    let longest = viewer.heard("shown after").map(of).fold(0.0, f64::max);
    println!("{turns} turns, {inputs} inputs, the longest wait {longest:.0} ms; megabytes at rest: {memory:.0?}");
    // Open files differ from turn to turn, and allocators keep memory, so peaks are compared:
    // that of the last third with the one before.
    let (warm, rest) = memory.split_at(memory.len() * 2 / 3);
    let peak = |part: &[f64]| part.iter().copied().fold(0.0, f64::max);
    if warm.len() >= 8 {
        println!("the peak grows by {:.1} %", 100.0 * (peak(rest) / peak(warm) - 1.0));
        assert!(peak(rest) <= 1.05 * peak(warm), "{memory:?}");
    }
    viewer.is_well();
}

#[test]
fn soak_for_twenty_seconds() {
    soak(Duration::from_secs(20), 1);
}

#[test]
#[ignore = "takes SOAK_SECONDS, 1800 where it is not set"]
fn soak_for_long() {
    let seconds = std::env::var("SOAK_SECONDS").ok().and_then(|s| s.parse().ok()).unwrap_or(1800);
    soak(Duration::from_secs(seconds), 2);
}

#[test]
fn without_a_display_it_says_so() {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_lightsheaf"))
        .args(["view", "builtin:cornell_point"])
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.starts_with("error: no window can be opened") && said.contains("lightsheaf render"), "{said}");
}
