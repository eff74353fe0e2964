//! Tests of Ctrl-C and SIGTERM: `render` writes the picture that it has and exits with code 130; the second
//! signal ends it at once.
//!
//! `INTERRUPTIONS=50 cargo test --test interrupt` sets the number of renders that are interrupted.
#![cfg(unix)]

use std::io::Read as _;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use common::folder::Folder;
use lightsheaf::film::Film;
use lightsheaf::film::exr::Picture;
use serde_json::Value;

mod common;

/// Renders that are interrupted; the cases take turns.
const INTERRUPTIONS: u64 = 8;

/// Time in which an interrupted render of this size has to end on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// Options of the renders. None of them ends by itself within the test.
const CASES: [&[&str]; 8] = [
    &["builtin:cornell_point", "--method", "raster", "--samples", "16000000"],
    &["builtin:cornell_area", "--method", "reference", "--samples", "16000000"],
    &["builtin:cornell_glossy", "--method", "path", "--budget", "5000"],
    &["builtin:cornell_env", "--method", "twin", "--target-error", "1e-8"],
    &["builtin:cornell_glossy", "--method", "ray-query", "--samples", "16000000"],
    &["builtin:point_hall:40", "--method", "raster", "--target-error", "1e-8", "--budget", "5000"],
    &["builtin:cornell_point", "--method", "raster", "--samples", "16000000", "--interleave", "2"],
    &["builtin:cornell_point", "--method", "reference", "--target-error", "1e-8"],
];

/// Starts a render.
fn start_at_once(arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    command.arg("render").args(arguments).env_remove("RUST_LOG").stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Starts a render and waits until it handles signals.
fn start(arguments: &[&str]) -> Child {
    let child = start_at_once(arguments);
    let status = format!("/proc/{}/status", child.id());
    if !Path::new("/proc/self/status").exists() {
        sleep(Duration::from_millis(500));
        return child;
    }
    // The mask has a bit for each signal with a handler: SIGINT is 2, SIGTERM 15.
    let handles = |text: &str| {
        let mask = text.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or_default();
        u64::from_str_radix(mask.trim(), 16).unwrap_or_default() & 0x4002 == 0x4002
    };
    let began = Instant::now();
    while !handles(&std::fs::read_to_string(&status).unwrap_or_default()) {
        assert!(began.elapsed() < PATIENCE, "signals are not handled");
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(5));
    child
}

fn send(child: &Child, signal: &str) {
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
}

/// Returns the exit status of a render and its stderr. A render that does not end is killed.
fn wait(mut child: Child) -> (ExitStatus, String) {
    let began = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if began.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("it goes on after the signal");
        }
        sleep(Duration::from_millis(10));
    };
    let mut text = String::new();
    child.stderr.take().unwrap().read_to_string(&mut text).unwrap();
    (status, text)
}

/// Checks the picture and the statistics that an interrupted render leaves, and returns the number of
/// samples.
fn check(folder: &Folder, out: &str, text: &str) -> u64 {
    let stats: Value = serde_json::from_str(&std::fs::read_to_string(folder.path("stats.json")).unwrap()).unwrap();
    let samples = stats["samples"].as_u64().unwrap();
    assert!(samples >= 1 && stats["ended_by"] == "interrupt", "{stats}");
    let unit = if samples == 1 { "sample" } else { "samples" };
    let closing = format!("interrupted after {samples} {unit}");
    assert!(text.lines().any(|line| line.contains(&closing)), "{text}");
    let film = Film::load(Path::new(out)).unwrap();
    assert_eq!((film.width, film.height, film.non_finite()), (64, 48, 0));
    assert!(film.pixels.iter().flatten().any(|&value| value > 0.0), "a black picture");
    samples
}

#[test]
fn an_interrupted_render_writes_what_it_has() {
    if common::gpu().is_none() || common::gpu_with_ray_queries().is_none() {
        return;
    }
    let count = std::env::var("INTERRUPTIONS").map_or(INTERRUPTIONS, |count| count.parse().unwrap());
    assert!(count >= CASES.len() as u64);
    // The linear congruential generator gives the same times in every run.
    let mut random = 1_u64;
    let (mut few, mut many) = (0, 0);
    for (n, case) in (0..count).zip(CASES.iter().cycle()) {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        // Signals come during set-up as well as during the first batches.
        let delay = Duration::from_millis((random >> 33) % 2500);
        let folder = Folder::new("render");
        let out = folder.path(if n % 2 == 0 { "out.exr" } else { "out.png" });
        let json = folder.path("stats.json");
        let child = start(&[case, &["-o", &out, "--stats", &json, "--size", "64x48"][..]].concat());
        sleep(delay);
        let sent = Instant::now();
        send(&child, "-INT");
        let (status, text) = wait(child);
        assert_eq!(status.code(), Some(130), "{case:?} after {delay:?}: {text}");
        let samples = check(&folder, &out, &text);
        assert_eq!(folder.files().len(), 2, "nothing else is left: {:?}", folder.files());
        println!("{delay:>8.1?} {samples:>6} samples, ended after {:>8.1?}: {}", sent.elapsed(), case[0..3].join(" "));
        if samples == 1 { few += 1 } else { many += 1 }
    }
    println!("{few} ended after the first sample, {many} later");
}

#[test]
fn the_frame_that_is_begun_is_the_last() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("frames");
    let (out, json) = (folder.path("out.exr"), folder.path("stats.json"));
    let frames = ["--frames", "3..9", "--fps", "10", "--samples", "16000000"];
    let child = start(&[&["builtin:sea", "-o", &out, "--stats", &json, "--size", "64x48"], &frames[..]].concat());
    sleep(Duration::from_millis(1500));
    send(&child, "-TERM");
    let (status, text) = wait(child);
    assert_eq!(status.code(), Some(130), "{text}");
    assert_eq!(folder.files(), ["out_0003.exr", "stats_0003.json"], "{text}");
    std::fs::rename(folder.path("stats_0003.json"), &json).unwrap();
    check(&folder, &folder.path("out_0003.exr"), &text);
}

/// An animation that is killed goes on with the frames that are not complete, to the same pictures.
#[test]
fn an_animation_goes_on() {
    let folder = Folder::new("goes-on");
    let render = |name: &str, more: &[&str]| {
        let (out, png) = (folder.path(&format!("{name}.exr")), folder.path(&format!("{name}.png")));
        let base = ["builtin:sea", "--method", "reference", "--size", "32x24", "--samples", "8", "--bounces", "0"];
        let frames = ["--frames", "0..3", "--fps", "2", "--aov", "motion,direct", "-o", &out, "-o", &png];
        start_at_once(&[&base[..], &frames, more].concat())
    };
    let succeed = |name: &str, more: &[&str]| {
        let (status, text) = wait(render(name, more));
        assert!(status.success(), "{text}");
        text
    };
    let again = ["--skip-existing"];
    let mut child = render("a", &again);
    while !Path::new(&folder.path("a_0001.png")).exists() {
        sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    succeed("whole", &[]);
    // The kill may have come late: the last frame is lost in any case, and another one is damaged.
    let _ = std::fs::remove_file(folder.path("a_0003.exr"));
    let damaged = folder.path("a_0001.exr");
    let bytes = std::fs::read(&damaged).unwrap();
    std::fs::write(&damaged, &bytes[..bytes.len() / 2]).unwrap();
    let text = succeed("a", &again);
    let kept = |text: &str| text.lines().filter(|line| line.contains("complete, and kept")).count();
    assert!((1..=2).contains(&kept(&text)) && text.contains("a_0000.png: complete, and kept"), "{text}");
    assert_eq!(kept(&succeed("a", &again)), 4);
    for frame in 0..4 {
        let read = |name: &str| Picture::load(folder.path(&format!("{name}_{frame:04}.exr"))).unwrap();
        let (one, whole) = (read("a"), read("whole"));
        assert!(one.film == whole.film && one.channels == whole.channels, "frame {frame}");
        let png = |name: &str| std::fs::read(folder.path(&format!("{name}_{frame:04}.png"))).unwrap();
        assert!(png("a") == png("whole"), "frame {frame}: the exposure is that of the first one");
    }
    // Frames that another command made are not kept.
    for more in [["--seed", "7"], ["--env-rotate", "9"], ["--aov", "id"]] {
        succeed("whole", &[]);
        assert_eq!(kept(&succeed("whole", &[&again[..], &more].concat())), 0, "{more:?}");
    }
    let refused = |more: &[&str], what: &str| {
        let out = folder.path("b.exr");
        let base = ["builtin:sea", "-o", &out, "--skip-existing"];
        let (status, text) = wait(start_at_once(&[&base[..], more].concat()));
        assert!(status.code() == Some(2) && text.contains(what), "{text}");
    };
    refused(&["--samples", "1"], "is for --frames and --turntable");
    refused(&["--turntable", "2", "--budget", "1"], "give --samples");
    refused(&["--turntable", "2", "--samples", "1", "--history", "2"], "frames with --history");
    assert!(!folder.files().iter().any(|name| name.starts_with('b')), "{:?}", folder.files());
}

#[test]
fn a_second_signal_ends_at_once() {
    let folder = Folder::new("twice");
    let out = folder.path("out.exr");
    // One sample of this size takes long.
    let size = ["--size", "8000x8000", "--method", "reference", "--samples", "100"];
    let child = start(&[&["builtin:cornell_area", "-o", &out], &size[..]].concat());
    sleep(Duration::from_millis(300));
    send(&child, "-INT");
    sleep(Duration::from_millis(300));
    send(&child, "-TERM");
    let sent = Instant::now();
    let (status, text) = wait(child);
    assert_eq!(status.code(), Some(130), "{text}");
    assert!(sent.elapsed() < Duration::from_secs(20), "{:?}", sent.elapsed());
    assert_eq!(folder.files(), Vec::<String>::new(), "{text}");
}
