//! Tests of `--checkpoint` and `--resume`: a render that is killed goes on as if it had never stopped, and what
//! cannot go on is refused without harm.
//!
//! `KILLS=50 cargo test --test checkpoint -- --nocapture` sets the number of renders that are killed.
#![cfg(unix)]

use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use common::folder::Folder;
use lightsheaf::film::Film;
use lightsheaf::film::exr::Picture;

mod common;

/// Renders that are killed; the cases take turns.
const KILLS: u64 = 6;

/// Scenes and options of the renders.
const CASES: [(&str, &str); 6] = [
    ("builtin:cornell_area", "--method reference --samples 6000"),
    ("builtin:cornell_point", "--method shared --interleave 1 --samples 300"),
    ("builtin:cornell_glossy", "--method path --samples 1000"),
    ("builtin:cornell_glossy", "--method shared --interleave 2 --samples 150"),
    // The estimate of the error and converged tiles go on, too.
    ("builtin:cornell_area", "--method path --target-error 0.00005"),
    ("builtin:cornell_point", "--method shared --interleave 1 --target-error 0.00005"),
];

fn lightsheaf(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
    command.args(arguments).env_remove("RUST_LOG");
    command
}

fn run(arguments: &[&str]) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = lightsheaf(arguments).output().unwrap();
    (status.code(), String::from_utf8(stderr).unwrap())
}

/// Runs the program, which has to exit with code 2 and one error that contains `what`.
fn fail(arguments: &[&str], what: &str) {
    let (code, text) = run(arguments);
    assert_eq!(code, Some(2), "{arguments:?}: {text}");
    assert!(text.matches("error: ").count() == 1 && text.contains(what), "{arguments:?}: `{what}` is not in: {text}");
}

/// Returns the files of a folder that a killed process did not leave behind half written.
fn complete(folder: &Folder) -> Vec<String> {
    folder.files().into_iter().filter(|name| !name.ends_with(".part")).collect()
}

#[test]
fn a_killed_render_goes_on_to_the_same_bytes() {
    if common::gpu().is_none() {
        return;
    }
    let count = std::env::var("KILLS").map_or(KILLS, |count| count.parse().unwrap());
    let mut random = 7_u64;
    let (mut resumed, mut attempts) = (0, 0);
    for (n, (scene, options)) in (0..count).zip(CASES.iter().cycle()) {
        let folder = Folder::new("kill");
        let [png, exr, whole, checkpoint] =
            ["a.png", "a.exr", "whole.png", "a.checkpoint"].map(|name| folder.path(name));
        let shared = ["render", scene, "--size", "40x30", "--exposure", "0", "-q"];
        let shared: Vec<&str> = shared.into_iter().chain(options.split(' ')).collect();
        let whole_exr = folder.path("whole.exr");
        assert_eq!(run(&[&shared[..], &["-o", &whole, "-o", &whole_exr]].concat()).0, Some(0));
        let mut kills = 0;
        let (mut code, mut text) = (None, String::new());
        while code.is_none() {
            assert!(kills < 100, "{scene} {options}: it never ends");
            let mut arguments = [&shared[..], &["-o", &png, "-o", &exr, "--checkpoint", "1"]].concat();
            if std::path::Path::new(&checkpoint).exists() {
                arguments.extend(["--resume", &checkpoint]);
                resumed += 1;
            }
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let mut child = lightsheaf(&arguments).stderr(Stdio::piped()).spawn().unwrap();
            // Later attempts get more time, so that a slow machine comes to an end, too.
            let steps = (random >> 33) % 100 + 20 * kills;
            for _ in 0..steps {
                sleep(Duration::from_millis(40));
                if child.try_wait().unwrap().is_some() {
                    break;
                }
            }
            child.kill().unwrap();
            let output = child.wait_with_output().unwrap();
            (code, text) = (output.status.code(), String::from_utf8(output.stderr).unwrap());
            for file in complete(&folder).iter().filter(|name| name.ends_with(".exr")) {
                Film::load(folder.path(file)).unwrap_or_else(|e| panic!("after a kill: {e}"));
            }
            kills += 1;
        }
        attempts += kills;
        assert_eq!(code, Some(0), "{text}");
        println!("render {n}: {} kills, {options}", kills - 1);
        assert!(std::fs::read(&png).unwrap() == std::fs::read(&whole).unwrap(), "{scene} {options}");
        let [one, other] = [&exr, &whole_exr].map(|path| Picture::load(path).unwrap());
        assert!(one.film == other.film, "{scene} {options}: bits of the .exr");
        assert_eq!(one.record.unwrap().ranges, other.record.unwrap().ranges);
        assert_eq!(complete(&folder), ["a.exr", "a.png", "whole.exr", "whole.png"], "the checkpoint is removed");
    }
    println!("{count} renders, {} kills, {resumed} went on from a checkpoint", attempts - count);
    assert!(count < 8 || resumed >= count / 4, "only {resumed} went on from a checkpoint");
}

/// Starts a render that does not end, interrupts it after two checkpoints, and returns its stderr.
fn interrupted(arguments: &[&str]) -> String {
    let child = lightsheaf(arguments).stderr(Stdio::piped()).spawn().unwrap();
    sleep(Duration::from_millis(3500));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn what_cannot_go_on_is_refused() {
    let folder = Folder::new("refused");
    let [out, checkpoint, other] = ["a.exr", "a.checkpoint", "b.exr"].map(|name| folder.path(name));
    let base = ["render", "builtin:cornell_area", "--method", "reference", "--size", "40x30"];
    let endless = ["-o", &out, "--samples", "16000000"];
    let text = interrupted(&[&base[..], &endless, &["--checkpoint", "1"]].concat());
    assert!(text.contains("give the same command with --resume") && text.contains("a.checkpoint"), "{text}");
    let picture = Picture::load(&out).unwrap();
    let samples = picture.record.unwrap().samples;
    assert!(samples > 0);
    let resume = |more: &[&str], what: &str| {
        fail(&[&base[..], &["-o", &other, "--resume", &checkpoint], more].concat(), what);
    };
    resume(&["--samples", "16000000", "--bounces", "1"], "other settings: bounces (2 and 1)");
    resume(&["--samples", "16000000", "--seed", "2"], "seed (1 and 2)");
    resume(&["--target-error", "0.1"], "target_error (none and 0.1)");
    resume(&["--samples", "1"], "samples already");
    resume(&["--sample-range", "4..16000000"], "it begins with sample 1, not 4");
    resume(&["--samples", "16000000", "--eye", "0,0,3", "--target", "0,0,0"], "differs, so begin anew");
    let scene = ["render", "builtin:cornell_point", "--method", "reference", "--size", "40x30", "-o", &other];
    fail(&[&scene[..], &["--resume", &checkpoint]].concat(), "target_error (none and 0.003)");
    fail(&[&scene[..], &["--samples", "16000000", "--resume", &checkpoint]].concat(), "builtin:cornell_point differs");
    // It goes on for a few samples more.
    let more = (samples + 5).to_string();
    let (code, text) = run(&[&base[..], &["-o", &other, "--samples", &more, "--resume", &checkpoint]].concat());
    assert_eq!(code, Some(0), "{text}");
    assert_eq!(Picture::load(&other).unwrap().record.unwrap().samples, samples + 5);
    std::fs::remove_file(&other).unwrap();

    let bytes = std::fs::read(&checkpoint).unwrap();
    let damage = |bytes: &[u8], what: &str| {
        std::fs::write(&checkpoint, bytes).unwrap();
        resume(&["--samples", "16000000"], what);
    };
    damage(&bytes[..bytes.len() - 9], "is damaged");
    damage(&[&bytes[..400], &[bytes[400] ^ 4], &bytes[401..]].concat(), "is damaged");
    damage(b"", "is no checkpoint");
    damage(&std::fs::read(&out).unwrap(), "is no checkpoint");
    std::fs::remove_file(&checkpoint).unwrap();
    resume(&["--samples", "16000000"], "cannot be read");
    let bad = |more: &[&str], what: &str| fail(&[&base[..], &["-o", &other], more].concat(), what);
    bad(&["--checkpoint", "0"], "--checkpoint 0: has to be 1 to 604800 seconds");
    bad(&["--checkpoint", "9", "--frames", "0..1", "--fps", "1"], "cannot be used with");
    assert_eq!(folder.files(), ["a.exr"], "nothing else is written");
}

/// An interrupted render without a checkpoint says which samples are left.
#[test]
fn an_interrupted_render_goes_on_as_a_part() {
    let folder = Folder::new("rest");
    let [out, rest, all, whole] = ["a.exr", "b.exr", "all.exr", "whole.exr"].map(|name| folder.path(name));
    let base = ["render", "builtin:cornell_area", "--method", "reference", "--size", "40x30"];
    let text = interrupted(&[&base[..], &["-o", &out, "--samples", "16000000"]].concat());
    let samples = Picture::load(&out).unwrap().record.unwrap().samples;
    assert!(text.contains(&format!("--sample-range {}..16000000", samples + 1)), "{text}");
    let range = format!("{}..{}", samples + 1, samples + 7);
    assert_eq!(run(&[&base[..], &["-o", &rest, "--sample-range", &range]].concat()).0, Some(0));
    assert_eq!(run(&["merge", &out, &rest, "-o", &all]).0, Some(0));
    let number = (samples + 7).to_string();
    assert_eq!(run(&[&base[..], &["-o", &whole, "--samples", &number]].concat()).0, Some(0));
    let [all, whole] = [all, whole].map(|path| Film::load(path).unwrap());
    assert!(lightsheaf::metrics::compare(&all, &whole).unwrap().rel_mse <= 1e-10);
    let text = interrupted(&[&base[..], &["-o", &out, "--target-error", "1e-8"]].concat());
    assert!(text.contains("with --checkpoint SECONDS the next one can"), "{text}");
}
