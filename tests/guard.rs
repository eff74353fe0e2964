//! Regression guard that asks no clock: error at fixed samples and seed, and how much work was asked for, scene by scene and method by
//! method, against tests/guard.json.
//!
//! A figure may move by its tolerance, stored in the same file, in either direction: what got better by more should be written down as
//! well. UPDATE_GUARD=1 rewrites the figures, and the change of that file is the summary of what changed.
//!
//! tests/guard/NAME.exr are the references, 64x64, two bounces, by
//! `lightsheaf render builtin:NAME --size 64x64 --method METHOD --samples N --seed 77`: cornell_point and cornell_area by `reference` with
//! 16384 samples, corner_spikes and point_hall_1000 by `ray-query` with 4096, since paths from the camera hardly find their light.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use common::{gpu, gpu_with_ray_queries};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::renderer::{Progressive, Renderer};
use lightsheaf::scene::builtin;
use lightsheaf::settings::{Method, Settings, Visibility};
use serde::{Deserialize, Serialize};

/// Built-in scenes: point light, area light, light that is hard to find, many lights.
const SCENES: [&str; 4] = ["cornell_point", "cornell_area", "corner_spikes", "point_hall:1000"];

/// Figures by name.
type Figures = BTreeMap<String, f64>;

/// tests/guard.json.
#[derive(Serialize, Deserialize)]
struct Guard {
    /// Share of itself by which each figure may move.
    tolerances: Figures,
    /// Figures of each scene and method.
    figures: BTreeMap<String, Figures>,
}

fn methods() -> [(&'static str, Settings); 5] {
    // With room for all lists: what an iteration that has to be redone wanted of later views depends on which nodes were lost.
    let base = Settings { width: 64, height: 64, samples: 32, seed: 1, ..Settings::plain() };
    let raster = Settings { list_room: 4.0, ..base.clone() };
    let of = |method| Settings { method, ..base.clone() };
    [
        ("raster", raster.clone()),
        ("raster fast", Settings { visibility: Visibility::Fast, ..raster }),
        ("twin", of(Method::Twin)),
        ("ray-query", of(Method::RayQuery)),
        ("path", of(Method::Path)),
    ]
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(name)
}

/// Renders on a device of its own, whose ledger nobody else writes.
fn measure(scene: &str, settings: &Settings) -> Figures {
    let reference = Film::load(file("guard").join(scene.replace(':', "_")).with_extension("exr")).unwrap();
    let scene = builtin::load(scene).unwrap();
    let gpu = if settings.method.traces_rays() { Gpu::with_ray_queries() } else { Gpu::new() }.unwrap();
    let mut renderer: Box<dyn Progressive + '_> = if settings.method.shares_subpaths() {
        Box::new(Renderer::new(&gpu, &scene, settings).unwrap())
    } else {
        Box::new(PathRenderer::new(&gpu, &scene, settings).unwrap())
    };
    renderer.render(settings.samples.into(), &mut |_| true).unwrap();
    let (film, stats, counts) = (renderer.film().unwrap(), renderer.stats(), gpu.ledger.counts());
    let (recorded, pipelines) = (counts.recorded(), counts.pipelines.values().sum::<u64>());
    let structures = counts.acceleration_structures.values().sum::<u64>();
    let nodes = stats.demands.iter().map(|[_, nodes]| u64::from(*nodes)).sum::<u64>();
    assert_eq!((stats.non_finite, stats.lost_nodes), (0, 0));
    let counted = [
        ("pipelines", pipelines),
        ("draws", recorded.draws),
        ("dispatches", recorded.dispatches),
        ("workgroups", recorded.workgroups),
        ("acceleration_structures", structures),
        ("bytes", counts.bytes()),
        ("nodes", nodes),
    ];
    let mut figures: Figures = counted.iter().map(|&(name, count)| (name.to_owned(), count as f64)).collect();
    figures.insert("rel_mse".to_owned(), compare(&film, &reference).unwrap().rel_mse);
    figures
}

/// What moved by more than its tolerance, or is on one side only.
fn moved(tolerances: &Figures, stored: &Figures, now: &Figures) -> Vec<String> {
    let names: std::collections::BTreeSet<_> = stored.keys().chain(now.keys()).collect();
    let judge = |name: &String| {
        let (Some(&tolerance), Some(&stored), Some(&now)) = (tolerances.get(name), stored.get(name), now.get(name))
        else {
            return Some(format!("{name}: is missing in the file or among what was measured"));
        };
        // NaN is within nothing.
        let within = (now - stored).abs() <= tolerance * stored;
        (!within).then(|| format!("{name}: {stored} was {now} now, more than {} % apart", 100.0 * tolerance))
    };
    names.into_iter().filter_map(judge).collect()
}

#[test]
fn error_and_work_are_what_they_were() {
    if gpu().is_none() {
        return;
    }
    let path = file("guard.json");
    let mut guard: Guard = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    let (mut changed, mut measured) = (Vec::new(), BTreeMap::new());
    for scene in SCENES {
        for (name, settings) in methods() {
            if settings.method.traces_rays() && gpu_with_ray_queries().is_none() {
                continue;
            }
            let key = format!("{scene}, {name}");
            let figures = measure(scene, &settings);
            let stored = guard.figures.get(&key).cloned().unwrap_or_default();
            changed.extend(moved(&guard.tolerances, &stored, &figures).iter().map(|text| format!("{key}: {text}")));
            measured.insert(key, figures);
        }
    }
    assert!(measured.len() >= 2 * SCENES.len());
    if std::env::var("UPDATE_GUARD").as_deref() == Ok("1") {
        guard.figures = measured;
        std::fs::write(&path, serde_json::to_string_pretty(&guard).unwrap() + "\n").unwrap();
        return;
    }
    assert!(
        changed.is_empty(),
        "{changed:#?}\nIf that is meant, UPDATE_GUARD=1 writes the new figures to {}",
        path.display()
    );
}

#[test]
fn planted_regressions_are_found() {
    let figures = |error: f64, draws: f64| Figures::from([("rel_mse".to_owned(), error), ("draws".to_owned(), draws)]);
    let tolerances = figures(0.1, 0.0);
    let stored = figures(0.01, 96.0);
    assert!(moved(&tolerances, &stored, &stored).is_empty());
    assert!(moved(&tolerances, &stored, &figures(0.0109, 96.0)).is_empty());
    for now in [figures(0.012, 96.0), figures(0.008, 96.0), figures(f64::NAN, 96.0), figures(0.01, 97.0)] {
        assert_eq!(moved(&tolerances, &stored, &now).len(), 1, "{now:?}");
    }
    assert_eq!(moved(&tolerances, &Figures::new(), &stored).len(), 2, "what is new is named");

    // A strategy that is left out, and a sample too few, move what is measured.
    if gpu().is_none() {
        return;
    }
    let guard: Guard = serde_json::from_str(&std::fs::read_to_string(file("guard.json")).unwrap()).unwrap();
    let (_, whole) = &methods()[0];
    let planted = [
        Settings { strategies: lightsheaf::settings::Strategies::Bundle, ..whole.clone() },
        Settings { samples: whole.samples - 1, ..whole.clone() },
    ];
    for settings in planted {
        let now = measure("cornell_point", &settings);
        let found = moved(&guard.tolerances, &guard.figures["cornell_point, raster"], &now);
        assert!(found.iter().any(|f| f.starts_with("draws") || f.starts_with("dispatches")), "{found:?}");
        assert!(!found.is_empty(), "{settings:?}");
    }
}
