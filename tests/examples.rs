//! The programs in examples/ run, and what they make is a picture.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use common::folder::Folder;

/// Path of an example, which `cargo test` builds beside the program.
fn example(name: &str) -> PathBuf {
    let program = Path::new(env!("CARGO_BIN_EXE_lightsheaf"));
    let path = program.with_file_name("examples").join(name).with_extension(std::env::consts::EXE_EXTENSION);
    assert!(path.is_file(), "{} is not there: run `cargo build --examples`", path.display());
    path
}

/// Runs an example in a folder; returns its output, or nothing without a device.
fn run(folder: &Folder, name: &str, arguments: &[&str]) -> Option<String> {
    common::gpu()?;
    let output = Command::new(example(name)).args(arguments).current_dir(&folder.0).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{name}: {stderr}");
    Some(String::from_utf8(output.stdout).unwrap())
}

/// Mean of a picture's values, 0 to 255.
fn mean(path: &Path) -> f64 {
    let picture = image::open(path).unwrap().into_rgb8();
    picture.as_raw().iter().map(|&v| f64::from(v)).sum::<f64>() / picture.as_raw().len() as f64
}

#[test]
fn pictures_are_neither_black_nor_white() {
    let folder = Folder::new("examples");
    let Some(_) = run(&folder, "render_file", &["builtin:cornell_point", "file.png"]) else { return };
    run(&folder, "scene_in_code", &["code.png"]);
    run(&folder, "animation", &["builtin:sea", "frames"]);
    let frames = (0..4).map(|n| folder.0.join("frames").join(format!("frame_{n:04}.png")));
    let pictures = ["file.png", "code.png"].map(|name| folder.0.join(name)).into_iter().chain(frames);
    let means: Vec<f64> = pictures.map(|path| mean(&path)).collect();
    assert_eq!(means.len(), 6);
    assert!(means.iter().all(|mean| (20.0..235.0).contains(mean)), "{means:?}");
    assert_ne!(means[2], means[5], "the sea moves");
}

#[test]
fn two_methods_agree() {
    let folder = Folder::new("two_methods");
    let Some(text) = run(&folder, "two_methods", &[]) else { return };
    let errors: Vec<f64> = text.lines().map(|line| line.split_whitespace().last().unwrap().parse().unwrap()).collect();
    assert_eq!(errors.len(), 4, "{text}");
    assert!(errors.iter().all(|error| (1e-4..0.3).contains(error)), "{text}");
}
