//! Tests of `--json-progress` and `--preview`.

use std::collections::BTreeMap;
use std::io::Read as _;
use std::net::TcpListener;
use std::process::{Command, Output};
use std::thread;

use common::folder::Folder;
use lightsheaf::film::Film;
use serde_json::Value;

mod common;

fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    let Output { status, stdout, stderr } = command.args(arguments).env_remove("RUST_LOG").output().unwrap();
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

/// Runs a render that prints JSON, and returns its lines.
fn lines(arguments: &[&str]) -> Vec<Value> {
    let (code, stdout, stderr) = run(&[arguments, &["--json-progress"]].concat());
    assert_eq!(code, Some(0), "{stderr}");
    stdout.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{line}: {e}"))).collect()
}

/// A software driver whose cache is empty compiles every shader. Programs are told, and a budget does not pay for it.
#[test]
fn compiling_shaders_is_seen_and_takes_nothing_from_a_budget() {
    if common::gpu().is_none_or(|gpu| !gpu.capabilities.compiles_late) {
        return;
    }
    let folder = Folder::new("compile");
    let [out, json] = ["a.exr", "a.json"].map(|name| folder.path(name));
    let base = ["render", "builtin:cornell_point", "--size", "32x32", "--budget", "0.5", "--json-progress"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    command.args(base).args(["-o", &out, "--stats", &json]).env("MESA_SHADER_CACHE_DIR", folder.path("cache"));
    let Output { status, stdout, .. } = command.output().unwrap();
    assert!(status.success());
    let stats: Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let seconds = |phase: &str| stats["seconds"][phase].as_f64().unwrap();
    let passes = stats["passes"].as_object().unwrap();
    let on_device: f64 = passes.values().map(|pass| pass["gpu_millis"].as_f64().unwrap()).sum();
    assert!(seconds("compile") > 0.5 && seconds("render") < 0.5 + seconds("compile"), "{stats}");
    assert!(on_device < 1e3 * seconds("render"), "{passes:?}");
    let stdout = String::from_utf8(stdout).unwrap();
    let compiled = stdout.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let compiled = compiled.filter(|line| line["event"] == "compile").map(|line| line["shader"].to_string());
    let compiled: Vec<String> = compiled.collect();
    assert!(compiled.len() >= passes.len() && compiled.contains(&"\"extend\"".to_owned()), "{compiled:?}");
}

#[test]
fn programs_read_the_progress() {
    let folder = Folder::new("json");
    let [out, png] = ["a.exr", "a.png"].map(|name| folder.path(name));
    let base = ["render", "builtin:cornell_area", "--size", "64x48", "--method", "reference"];
    let all = lines(&[&base[..], &["-o", &out, "-o", &png, "--samples", "40"]].concat());
    let (end, before) = all.split_last().unwrap();
    assert!(!before.is_empty() && before.iter().all(|line| line["event"] == "progress"), "{all:?}");
    assert!(before.windows(2).all(|pair| pair[0]["samples"].as_u64() < pair[1]["samples"].as_u64()), "{all:?}");
    for line in &all {
        assert_eq!(
            (&line["samples_end"], &line["files"][1], &line["target_error"]),
            (&40.into(), &png.clone().into(), &Value::Null)
        );
        assert!(line["seconds"].as_f64().unwrap() > 0.0 && line["seconds_left"].as_f64().unwrap() >= 0.0, "{line}");
    }
    assert_eq!((&end["event"], &end["samples"], &end["ended_by"]), (&"end".into(), &40.into(), &"samples".into()));
    assert!(end["estimated_error"].as_f64().is_some_and(|error| error > 1e-6 && error < 1.0), "{end}");

    let end = lines(&[&base[..], &["-o", &out, "--target-error", "0.02"]].concat()).pop().unwrap();
    assert!(end["ended_by"] == "target-error" && end["estimated_error"].as_f64().unwrap() <= 0.02, "{end}");
    assert_eq!((&end["target_error"], &end["samples_end"]), (&0.02.into(), &Value::Null));
    let all = lines(&[&base[..], &["-o", &out, "--budget", "1.5"]].concat());
    let left: Vec<f64> = all.iter().map(|line| line["seconds_left"].as_f64().unwrap()).collect();
    // The last sample may end after the budget, of which nothing is left then.
    let falls = |pair: &[f64]| pair[0] > pair[1] || pair == [0.0, 0.0];
    assert!(left.len() > 2 && left[0] < 1.5 && left[1] > 0.0 && left.windows(2).all(falls), "{left:?}");

    // Every picture of several has its lines, and nothing else is on stdout.
    let all = lines(&[&base[..], &["-o", &out, "--samples", "1", "--turntable", "2"]].concat());
    let ends: Vec<&Value> = all.iter().filter(|line| line["event"] == "end").map(|line| &line["files"][0]).collect();
    assert_eq!(ends, [&Value::from(folder.path("a_0000.exr")), &Value::from(folder.path("a_0001.exr"))]);
    // The estimate changes nothing.
    let quiet = folder.path("quiet.exr");
    lines(&[&base[..], &["-o", &out, "--samples", "40"]].concat());
    let (code, stdout, _) = run(&[&base[..], &["-o", &quiet, "--samples", "40", "-q"]].concat());
    assert_eq!((code, stdout.as_str()), (Some(0), ""));
    assert!(Film::load(&out).unwrap() == Film::load(&quiet).unwrap());
}

/// A viewer that receives images by the protocol of tev.
fn view(listener: &TcpListener) -> BTreeMap<String, Film> {
    let (mut stream, _) = listener.accept().unwrap();
    let mut images = BTreeMap::new();
    let mut length = [0; 4];
    while stream.read_exact(&mut length).is_ok() {
        let mut packet = vec![0; u32::from_le_bytes(length) as usize - 4];
        stream.read_exact(&mut packet).unwrap();
        let mut packet = packet.as_slice();
        let (kind, _focus) = (byte(&mut packet), byte(&mut packet));
        let name = text(&mut packet);
        let channels = |packet: &mut &[u8]| {
            let count = number(packet);
            (0..count).map(|_| text(packet)).collect::<Vec<_>>()
        };
        match kind {
            4 => {
                let (width, height) = (number(&mut packet), number(&mut packet));
                assert_eq!(channels(&mut packet), ["R", "G", "B"]);
                images.insert(name, Film::new(width, height));
            }
            6 => {
                assert_eq!(channels(&mut packet), ["R", "G", "B"]);
                let [x, y, width, height] = [0; 4].map(|_| number(&mut packet));
                let [offsets, strides] = [0; 2].map(|_| [0; 3].map(|_| long(&mut packet) as usize));
                let values: Vec<f32> =
                    packet.chunks_exact(4).map(|v| f32::from_le_bytes(v.try_into().unwrap())).collect();
                let count = (width * height) as usize;
                assert_eq!(values.len(), (0..3).map(|c| offsets[c] + (count - 1) * strides[c] + 1).max().unwrap());
                let film = images.get_mut(&name).expect("an image is created before it is updated");
                for pixel in 0..count {
                    let (row, column) = (y as usize + pixel / width as usize, x as usize + pixel % width as usize);
                    film.pixels[row * film.width as usize + column] =
                        std::array::from_fn(|c| values[offsets[c] + pixel * strides[c]]);
                }
                packet = &[];
            }
            other => panic!("a packet of kind {other}"),
        }
        assert!(packet.is_empty(), "{} bytes are left in a packet", packet.len());
    }
    images
}

fn byte(packet: &mut &[u8]) -> u8 {
    let (&first, rest) = packet.split_first().unwrap();
    *packet = rest;
    first
}

fn number(packet: &mut &[u8]) -> u32 {
    let (bytes, rest) = packet.split_at(4);
    *packet = rest;
    u32::from_le_bytes(bytes.try_into().unwrap())
}

fn long(packet: &mut &[u8]) -> i64 {
    let (bytes, rest) = packet.split_at(8);
    *packet = rest;
    i64::from_le_bytes(bytes.try_into().unwrap())
}

fn text(packet: &mut &[u8]) -> String {
    let end = packet.iter().position(|&byte| byte == 0).unwrap();
    let text = String::from_utf8(packet[..end].to_vec()).unwrap();
    *packet = &packet[end + 1..];
    text
}

/// The viewer has the picture that is written, and gets it while it is rendered.
#[test]
fn a_viewer_sees_the_picture() {
    let folder = Folder::new("preview");
    let out = folder.path("seen.exr");
    let mut cases: Vec<&[&str]> = vec![&["--method", "reference", "--crop", "20,30,150,140"]];
    if common::gpu().is_some() {
        cases.push(&["--interleave", "2"]);
    }
    for case in cases {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let viewer = thread::spawn(move || view(&listener));
        let base = ["render", "builtin:cornell_area", "-o", &out, "--size", "200x180", "--budget", "2.5", "-q"];
        let (code, _, text) = run(&[&base[..], case, &["--preview", &address]].concat());
        assert!(code == Some(0) && !text.contains("note: --preview"), "{text}");
        let images = viewer.join().unwrap();
        assert_eq!(images.keys().collect::<Vec<_>>(), ["seen.exr"]);
        assert!(images["seen.exr"] == Film::load(&out).unwrap(), "{case:?}");
    }
}

/// Without a viewer, and with one that hangs up, the render goes on.
#[test]
fn a_missing_viewer_stops_nothing() {
    let folder = Folder::new("alone");
    let out = folder.path("a.exr");
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let base = ["render", "builtin:cornell_area", "-o", &out, "--size", "40x30", "--method", "reference", "-q"];
    let hangs_up = thread::spawn(move || drop(listener.accept().unwrap()));
    let (code, _, text) = run(&[&base[..], &["--budget", "2.5", "--preview", &address]].concat());
    assert!(code == Some(0) && text.matches("note: --preview").count() <= 1, "{text}");
    hangs_up.join().unwrap();
    std::fs::remove_file(&out).unwrap();
    let (code, _, text) = run(&[&base[..], &["--samples", "2", "--preview", &address]].concat());
    assert!(code == Some(0) && text.matches("note: --preview").count() == 1, "{text}");
    assert!(text.contains("the render goes on without it") && Film::load(&out).is_ok(), "{text}");
    let (code, _, text) = run(&[&base[..], &["--preview", "localhost"]].concat());
    assert!(code == Some(2) && text.contains("an address is HOST:PORT"), "{text}");
}
