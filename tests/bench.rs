//! Tests of `bench`: its measurements, its files and its refusals, with our methods and with a peer.

mod common;

use std::process::{Command, Output};

use common::folder::Folder;
use lightsheaf::bench::report::FILES;
use serde_json::Value;

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_lightsheaf")).args(arguments).env_remove("RUST_LOG").output().unwrap()
}

fn succeed(arguments: &[&str]) -> String {
    let output = run(arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {stderr}");
    stderr
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// Returns the resources that a page would fetch.
fn fetches(html: &str) -> Vec<&str> {
    let sources = ["src=\"", "href=\"", "url("].into_iter().flat_map(|key| html.split(key).skip(1));
    let mut out: Vec<&str> =
        sources.filter(|s| !s.starts_with("data:")).map(|s| s.split('"').next().unwrap_or_default()).collect();
    out.extend(["<script", "<link", "@import"].into_iter().filter(|tag| html.contains(tag)));
    out
}

#[test]
fn a_benchmark_is_one_whole_report() {
    let (methods, names) = match common::gpu() {
        Some(_) => ("raster,reference", vec!["raster", "reference", "vpl <only>"]),
        None => ("reference", vec!["reference"]),
    };
    let folder = Folder::new("report");
    let (out, cache) = (folder.path("out"), folder.path("cache"));
    let scenes = ["builtin:cornell_area", "builtin:cornell_point"];
    let mut arguments = vec!["bench", scenes[0], scenes[1], "-o", &out, "--cache", &cache, "--methods", methods];
    arguments.extend(
        "--size 32x32 --budget 0.3 --repeats 2 --checkpoints 4 --reference-budget 1 --reference-method reference"
            .split(' '),
    );
    if names.len() > 1 {
        arguments.extend(["--variant", "vpl <only>=--method raster --strategies vpl"]);
    }
    let said = succeed(&arguments);
    assert!(said.trim().ends_with("report.html"), "{said}");
    let [html, json, csv, markdown] = FILES.map(|name| folder.read(&format!("out/{name}")));

    // The page is complete, self-contained and escaped.
    assert!(html.starts_with("<!DOCTYPE html>") && html.trim_end().ends_with("</html>"));
    assert_eq!(fetches(&html), Vec::<&str>::new());
    assert_eq!(fetches("<img src=\"a.png\"><link>"), ["a.png", "<link"], "what is not alone is found");
    assert_eq!(html.matches("<svg").count(), 2 * scenes.len());
    assert_eq!(html.matches("data:image/png").count(), scenes.len() * (1 + 2 * names.len()));
    assert!(!html.contains("vpl <only>") && html.contains("--reference-budget 1"));

    // JSON, CSV and Markdown have the same figures.
    let report: Value = serde_json::from_str(&json).unwrap();
    let mut rows = csv.lines().skip(1);
    assert_eq!(report["scenes"].as_array().unwrap().len(), scenes.len());
    for (scene, name) in report["scenes"].as_array().unwrap().iter().zip(scenes) {
        assert_eq!(scene["name"], name);
        let own = number(&scene["reference"]["own_rel_mse"]);
        assert!(own > 0.0 && own < 0.1, "{own}");
        let entries = scene["entries"].as_array().unwrap();
        assert_eq!(entries.iter().map(|e| e["name"].as_str().unwrap()).collect::<Vec<_>>(), names);
        for entry in entries {
            assert_eq!(entry["failure"], Value::Null, "{entry}");
            assert!(number(&entry["startup_seconds"]) > 0.0);
            let runs = entry["runs"].as_array().unwrap();
            assert_eq!(runs.iter().map(|r| number(&r["seed"])).collect::<Vec<_>>(), [1.0, 2.0]);
            for run in runs {
                let checkpoints = run["checkpoints"].as_array().unwrap();
                assert!((1..=4).contains(&checkpoints.len()));
                assert!(number(&checkpoints.last().unwrap()["seconds"]) >= 0.3);
                for c in checkpoints {
                    let row: Vec<&str> = rows.next().unwrap().split(',').collect();
                    assert_eq!((row[0], row[1], row[3]), (name, "32", entry["name"].as_str().unwrap()));
                    for (column, value) in
                        [(5, &c["samples"]), (6, &c["seconds"]), (7, &c["error"]), (8, &c["comparison"]["rel_mse"])]
                    {
                        let (csv, json) = (row[column].parse::<f64>().unwrap(), number(value));
                        assert!((csv - json).abs() <= 1e-12 * json.abs(), "{row:?}");
                    }
                    let error = (number(&c["comparison"]["rel_mse"]) - own).max(0.25 * own);
                    assert!((number(&c["error"]) / error - 1.0).abs() < 1e-6);
                }
            }
        }
    }
    assert_eq!(rows.next(), None);
    for name in &names {
        assert_eq!(markdown.lines().filter(|line| line.starts_with(&format!("| {name} |"))).count(), scenes.len());
    }

    // References are rendered once.
    assert_eq!(std::fs::read_dir(folder.path("cache")).unwrap().count(), 2 * scenes.len());
    succeed(&arguments);
    let again: Value = serde_json::from_str(&folder.read("out/report.json")).unwrap();
    assert_eq!(std::fs::read_dir(folder.path("cache")).unwrap().count(), 2 * scenes.len());
    let [before, after] = [&report, &again].map(|r| number(&r["scenes"][0]["reference"]["own_rel_mse"]));
    assert!((before / after - 1.0).abs() < 1e-12, "{before} {after}");
}

/// A floor under a point light.
const SCENE: &str = r#"<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
<lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
<shape type="rectangle"/><emitter type="point"><point name="position" value="0, 1, 1"/></emitter></scene>"#;

#[cfg(unix)]
#[test]
fn peers_take_part_or_say_why_not() {
    let folder = Folder::new("peers");
    let (scene, reference, out) = (folder.path("scene.xml"), folder.path("reference.exr"), folder.path("out"));
    std::fs::write(&scene, SCENE).unwrap();
    let render = ["render", &scene, "-o", &reference, "--size", "24x16", "--method", "reference", "--samples", "16"];
    succeed(&render);
    // The peer copies the reference, takes 10 ms a sample, and fails beyond a number of samples.
    let copies = format!(
        "copies=sh -c 'echo ready copies; while read a n seed file; do if [ $n -gt 40 ]; then echo error too many; exit; fi; cp {reference} $file; \
         echo done $n $(awk \"BEGIN {{ print $n / 100 }}\"); done'"
    );
    let arguments = [
        "bench",
        &scene,
        "-o",
        &out,
        "--size",
        "24x16",
        "--methods",
        "reference",
        "--budget",
        "0.3",
        "--repeats",
        "2",
        "--checkpoints",
        "4",
        "--reference",
        &reference,
        "--reference-error",
        "0.0001",
        "--peer",
        &copies,
        "--peer",
        "refuses=sh -c 'echo error no such lobe'",
    ];
    let said = succeed(&arguments);
    assert!(said.contains("refuses: no such lobe"), "{said}");
    let report: Value = serde_json::from_str(&folder.read("out/report.json")).unwrap();
    let scene = &report["scenes"][0];
    assert_eq!(scene["refusals"][0][0], "refuses");
    let peer = &scene["entries"][1];
    assert_eq!((&peer["name"], &peer["about"], &peer["failure"]), (&"copies".into(), &"copies".into(), &Value::Null));
    for run in peer["runs"].as_array().unwrap() {
        let checkpoints = run["checkpoints"].as_array().unwrap();
        let samples: Vec<f64> = checkpoints.iter().map(|c| number(&c["samples"])).collect();
        assert_eq!(samples, [1.0, 2.0, 4.0, 8.0, 16.0, 32.0], "doubled until the budget is reached");
        assert!(checkpoints.iter().all(|c| number(&c["comparison"]["rel_mse"]) == 0.0));
        assert!(checkpoints.iter().all(|c| number(&c["error"]) == 0.25e-4), "the reference's own error is the least");
    }
    assert!(folder.read("out/report.md").contains("refuses did not take part"));
    let left: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), FILES.len(), "pictures of peers are removed: {left:?}");

    // A peer that fails does not end the others.
    let more = arguments.map(|a| if a == "0.3" { "0.6" } else { a });
    assert!(succeed(&more).contains("copies ended early: peer copies: too many"));
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let folder = Folder::new("refused");
    let out = folder.path("out");
    let fail = |arguments: &[&str], what: &str| {
        let output = run(&[&["bench", "-o", &out], arguments].concat());
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
        assert!(stderr.contains(what) && !stderr.contains("panicked"), "{arguments:?}: {stderr}");
    };
    let scene = "builtin:cornell_point";
    fail(&[scene, "--budget", "0"], "--budget 0");
    fail(&[scene, "--repeats", "0"], "--repeats 0");
    fail(&[scene, "--checkpoints", "1"], "--checkpoints 1");
    fail(&[scene, "--targets", "-1,0.1"], "above 0");
    fail(&[scene, "--reference-method", "raster"], "biased");
    fail(&[scene, "--peer", "mitsuba"], "NAME=COMMAND");
    fail(&[scene, "--peer", "mitsuba=python peer.py"], "Mitsuba .xml");
    fail(&["--peer", "mitsuba=python peer.py"], "name some");
    fail(&[scene, "--variant", "fast"], "NAME=OPTIONS");
    fail(&[scene, "--variant", "fast=--visibility faster"], "--variant fast");
    fail(&[scene, "--variant", "long=--samples 7"], "the same for all");
    fail(&[scene, "--variant", "a=--method path --visibility fast"], "does not exist for path yet");
    fail(&[scene, "--methods", "reference,reference"], "two methods of that name");
    fail(&[scene, "--reference", "a.exr,b.exr"], "2 images for 1 scenes");
    fail(&[scene, "--reference", "no.exr", "--methods", "reference"], "no.exr");
    fail(&["builtin:none", "--methods", "reference"], "builtin:none");
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/cornell_point-exact.exr");
    fail(&[scene, "--reference", golden, "--methods", "reference"], "--size 64x64");
}

/// The report of a GPU works in its small form: every render is there, right, and in one page.
#[test]
fn a_gpu_is_reported_by_one_command() {
    if common::gpu().is_none() {
        return;
    }
    let folder = Folder::new("gpu");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/gpu.sh");
    let mut command = Command::new("bash");
    command.args([script, "--small", "-o", &folder.path("")]).env("LIGHTSHEAF", env!("CARGO_BIN_EXE_lightsheaf"));
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_str(&folder.read("report.json")).unwrap();
    assert!(report["small"] == true && report["stress"]["failed"] == 0, "{}", report["stress"]);
    let renders = report["renders"].as_array().unwrap();
    assert!(renders.len() >= 9, "{}", renders.len());
    for render in renders {
        let passes = render["stats"]["passes"].as_object();
        assert!(passes.is_some_and(|passes| !passes.is_empty()), "{}: {}", render["name"], render["error"]);
    }
    let html = folder.read("report.html");
    let data = html.split("application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
    assert_eq!(serde_json::from_str::<Value>(data).unwrap(), report);
}
