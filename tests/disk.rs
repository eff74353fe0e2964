//! Tests of disks on which nothing can be written: each command says so by one error and exit code 2, what was there
//! stays as it was, and nothing else is left behind.
#![cfg(unix)]

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output};

use common::folder::Folder;
use lightsheaf::film::Film;
use lightsheaf::film::oidn;

mod common;

/// Options of a picture that needs no device.
const REFERENCE: [&str; 6] = ["render", "builtin:cornell_area", "--method", "reference", "--size", "200x150"];

fn ended(mut command: Command) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = command.env_remove("RUST_LOG").output().unwrap();
    (status.code(), String::from_utf8(stderr).unwrap())
}

fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    command.args(arguments);
    ended(command)
}

/// Runs the program where files of more than 8 blocks of 512 bytes cannot be written, which stands for a full disk.
fn run_on_a_full_disk(arguments: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new("sh");
    let limited = "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"";
    command.args(["-c", limited, env!("CARGO_BIN_EXE_lightsheaf")]).args(arguments);
    ended(command)
}

/// Checks that a run failed with one error, the last line, that names a file and the cause.
fn check((code, text): (Option<i32>, String), arguments: &[&str], file: &str) {
    assert_eq!(code, Some(2), "{arguments:?}: {text}");
    let last = text.lines().last().unwrap_or_default();
    let one = text.matches("error: ").count() == 1 && last.contains("error: ");
    assert!(one && last.contains(file) && last.contains("cannot be written"), "{arguments:?}: {text}");
}

/// Returns the names and the bytes of all files.
fn contents(folder: &Folder) -> Vec<(String, Vec<u8>)> {
    let read = |name: String| (name.clone(), std::fs::read(folder.0.join(name)).unwrap());
    folder.files().into_iter().map(read).collect()
}

/// Returns a folder with two parts of a picture and files that stand for older results, and what is in it.
fn prepared(name: &str) -> (Folder, Vec<(String, Vec<u8>)>) {
    let folder = Folder::new(name);
    for (name, range) in [("one.exr", "1..2"), ("two.exr", "3..4")] {
        let path = folder.path(name);
        assert_eq!(run(&[&REFERENCE[..], &["-q", "-o", &path, "--sample-range", range]].concat()).0, Some(0));
    }
    for name in ["a.exr", "a.png", "a.checkpoint", "a_0000.exr", "a.json"] {
        std::fs::write(folder.path(name), format!("{name} before")).unwrap();
    }
    let before = contents(&folder);
    (folder, before)
}

/// Returns the commands that write files, each with the name of the file that it cannot write.
fn commands(folder: &Folder) -> Vec<(Vec<String>, &'static str)> {
    let [exr, png, one, two] = ["a.exr", "a.png", "one.exr", "two.exr"].map(|name| folder.path(name));
    let owned = |words: &[&str]| words.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
    let render = |samples: [&str; 2], words: &[&str]| owned(&[&REFERENCE[..], &samples, words].concat());
    let two_samples = ["--samples", "2"];
    let mut all = vec![
        (render(two_samples, &["-o", &exr]), "a.exr"),
        (render(two_samples, &["-o", &png]), "a.png"),
        (render(two_samples, &["-o", &exr, "--aov", "albedo,emission,direct,indirect,id"]), "a.exr"),
        (render(["--sample-range", "3..4"], &["-o", &exr]), "a.exr"),
        (render(two_samples, &["-o", &exr, "--turntable", "2"]), "a_0000.exr"),
        (owned(&["merge", &one, &two, "-o", &exr]), "a.exr"),
    ];
    if let Err(cause) = oidn::denoise(&Film::new(4, 4), None, None) {
        eprintln!("skipped: denoise, since {cause}");
    } else {
        all.push((owned(&["denoise", &one, "-o", &exr]), "a.exr"));
        all.push((render(two_samples, &["-o", &exr, "--denoise"]), "a.exr"));
    }
    all
}

#[test]
fn a_full_disk_harms_nothing() {
    let (folder, before) = prepared("full");
    for (arguments, file) in commands(&folder) {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        check(run_on_a_full_disk(&arguments), &arguments, file);
        assert!(contents(&folder) == before, "{arguments:?}: {:?}", folder.files());
    }
}

/// A checkpoint that cannot be written is a warning, since the render can go on, and the older one stays.
#[test]
fn a_render_goes_on_without_its_checkpoint() {
    let (folder, before) = prepared("checkpoint");
    let out = folder.path("a.exr");
    let arguments = [&REFERENCE[..], &["--budget", "2.5", "--checkpoint", "1", "-o", &out]].concat();
    let (code, text) = run_on_a_full_disk(&arguments);
    let warned = text.contains("warning: no checkpoint was written: ") && text.contains("a.checkpoint");
    assert!(warned, "{text}");
    check((code, text), &arguments, "a.exr");
    assert!(contents(&folder) == before, "{:?}", folder.files());
}

/// A folder in which nothing can be created is told before anything is rendered.
#[test]
fn a_read_only_folder_is_told_first() {
    let (folder, before) = prepared("read-only");
    let allow = |mode| std::fs::set_permissions(&folder.0, std::fs::Permissions::from_mode(mode)).unwrap();
    allow(0o555);
    let probe = folder.path("probe");
    if std::fs::write(&probe, "").is_ok() {
        std::fs::remove_file(&probe).unwrap();
        eprintln!("skipped: permissions, which this user need not respect; /proc stands for the folder");
        if Path::new("/proc/self").is_dir() {
            for (arguments, _) in commands(&folder) {
                let out = folder.path("a.exr");
                let moved = |word: &String| if *word == out { "/proc/a.exr".to_owned() } else { word.clone() };
                let arguments: Vec<String> = arguments.iter().map(moved).collect();
                let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
                if arguments.contains(&"/proc/a.exr") {
                    check(run(&arguments), &arguments, "/proc/a.exr");
                }
            }
        }
    } else {
        for (arguments, _) in commands(&folder) {
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            check(run(&arguments), &arguments, "the folder");
        }
    }
    allow(0o755);
    assert!(contents(&folder) == before, "{:?}", folder.files());
}
