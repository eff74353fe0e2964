//! Tests of farm/: parts that scripts render merge to the picture of all samples.
#![cfg(unix)]

use std::path::Path;
use std::process::Command;

use common::folder::Folder;
use lightsheaf::film::Film;
use lightsheaf::metrics::compare;

mod common;

/// Runs a script of farm/ with a folder before PATH, and returns exit code and stderr.
fn script(name: &str, path: &str, arguments: &[&str]) -> (Option<i32>, String) {
    let farm = Path::new(env!("CARGO_MANIFEST_DIR")).join("farm").join(name);
    let path = format!("{path}:{}", std::env::var("PATH").unwrap_or_default());
    let mut command = Command::new("bash");
    command.arg(farm).args(arguments).env("LIGHTSHEAF", env!("CARGO_BIN_EXE_lightsheaf")).env("PATH", path);
    let output = command.output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn parts_of_a_farm_are_the_picture() {
    let folder = Folder::new("farm");
    let [parts, out, whole] = ["parts", "out.exr", "whole.exr"].map(|name| folder.path(name));
    let scene = "builtin:cornell_area";
    let small = ["--size", "16x12", "--method", "reference"];
    let part = |n: &str| script("part.sh", "/", &[&[scene, &parts, "10", "3", n][..], &small].concat());
    for n in ["1", "3"] {
        assert_eq!(part(n).0, Some(0), "{}", part(n).1);
    }
    let merge = || script("merge.sh", "/", &[&parts, &out, "10"]);
    let (code, text) = merge();
    assert!(code == Some(2) && text.contains("the samples 4..6 are in no part"), "{text}");
    assert_eq!(part("2").0, Some(0));
    assert!(part("2").1.contains("is there"), "it is not rendered again");
    let (code, text) = merge();
    assert_eq!(code, Some(0), "{text}");
    let render = ["render", scene, "-o", &whole, "--samples", "10"];
    let status = Command::new(env!("CARGO_BIN_EXE_lightsheaf")).args([&render[..], &small].concat()).status().unwrap();
    assert!(status.success());
    let [out_film, whole] = [&out, &whole].map(|path| Film::load(path).unwrap());
    assert!(compare(&out_film, &whole).unwrap().rel_mse <= 1e-10);
    std::fs::remove_file(folder.path("parts/part_0003.exr")).unwrap();
    let (code, text) = merge();
    assert!(code == Some(2) && text.contains("has not 10 samples"), "{text}");
    for (n, what) in [("4", "PART is at most PARTS"), ("0", "whole numbers"), ("x", "whole numbers")] {
        let (code, text) = part(n);
        assert!(code == Some(2) && text.contains(what), "{text}");
    }
}

/// A stand-in for Slurm runs the tasks of each array one after the other.
#[test]
fn slurm_renders_and_merges() {
    let folder = Folder::new("slurm");
    let fake = folder.path("sbatch");
    let text = "#!/usr/bin/env bash\nset -e\nwhile [[ $# -gt 0 ]]; do case $1 in --array=1-*) last=${1#--array=1-};; \
                --wrap) command=$2; shift;; esac; shift; done\nfor ((n = 1; n <= ${last:-1}; n++)); do SLURM_ARRAY_TASK_ID=$n bash -c \
                \"$command\" >&2; done\necho 17\n";
    std::fs::write(&fake, text).unwrap();
    assert!(Command::new("chmod").args(["+x", &fake]).status().unwrap().success());
    let [parts, out] = ["parts of it", "out.exr"].map(|name| folder.path(name));
    let small = ["--size", "16x12", "--method", "reference"];
    let arguments = [&["builtin:cornell_area", &parts, &out, "7", "3"][..], &small].concat();
    let (code, text) = script("slurm.sh", folder.0.to_str().unwrap(), &arguments);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("7 samples of 3 parts") && Film::load(&out).is_ok(), "{text}");
}
