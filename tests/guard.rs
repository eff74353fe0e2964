//! Regression guard without a clock: rel_mse at fixed samples and seed, and the work asked of the device, for
//! each scene and method, against tests/guard.json.
//!
//! A figure may change by its tolerance, stored in the same file, in either direction, so that improvements
//! are recorded as well. UPDATE_GUARD=1 rewrites the figures and fails; the difference of that file is the
//! summary of the change.
//!
//! tests/guard/NAME.exr are the references, 64x64, two bounces, by `lightsheaf render builtin:NAME --size
//! 64x64 --method METHOD --samples N --seed 77`: cornell_point and cornell_area by `reference` with 16384
//! samples, corner_spikes and point_hall_1000 by `ray-query` with 4096, since paths from the camera hardly
//! find their light.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use common::{gpu, gpu_with_ray_queries, is_set, rewritten};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::render::renderer::Renderer;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::builtin;
use lightsheaf::settings::{Settings, Technique};
use serde::{Deserialize, Serialize};

/// Built-in scenes with a point light, an area light, light that is hard to find, and many lights.
const SCENES: [&str; 4] = ["cornell_point", "cornell_area", "corner_spikes", "point_hall:1000"];

/// Figures by name.
type Figures = BTreeMap<String, f64>;

/// Contents of tests/guard.json.
#[derive(Serialize, Deserialize)]
struct Guard {
    /// Relative change that each figure may have.
    tolerances: Figures,
    /// Figures of each scene and method.
    figures: BTreeMap<String, Figures>,
}

fn methods() -> [(&'static str, Settings); 5] {
    // Lists have capacity from the start, since the requests of a redone iteration depend on the nodes that
    // were lost.
    let base = Settings { width: 64, height: 64, samples: 32, seed: 1, ..Settings::plain() };
    let raster = Settings { list_room: 4.0, ..base.clone() };
    let of = |technique| Settings { technique, ..base.clone() };
    [
        ("raster", raster.clone()),
        ("raster fast", Settings { technique: Technique::FAST, ..raster }),
        ("twin", of(Technique::TWIN)),
        ("ray-query", of(Technique::RAY_QUERY)),
        ("path", of(Technique::PATH)),
    ]
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(name)
}

/// Renders on a device of its own, so that its ledger counts nothing else.
fn measure(scene: &str, settings: &Settings) -> Figures {
    let reference = Film::load(file("guard").join(scene.replace(':', "_")).with_extension("exr")).unwrap();
    let scene = builtin::load(scene).unwrap();
    let gpu = if settings.technique.needs_ray_queries() { Gpu::with_ray_queries() } else { Gpu::new() }.unwrap();
    let mut renderer: Box<dyn Renderer + '_> = if settings.technique.shares_subpaths() {
        Box::new(SharedRenderer::new(&gpu, &scene, settings).unwrap())
    } else {
        Box::new(PathRenderer::new(&gpu, &scene, settings).unwrap())
    };
    renderer.render(settings.samples.into(), &mut |_| true).unwrap();
    let (film, stats, counts) = (renderer.film().unwrap(), renderer.stats(), gpu.ledger.counts());
    let (recorded, pipelines) = (counts.recorded(), counts.pipelines.values().sum::<u64>());
    let structures = counts.acceleration_structures.values().sum::<u64>();
    let nodes = stats.requests.iter().map(|view| u64::from(view.nodes)).sum::<u64>();
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

/// Returns the figures that changed by more than their tolerance or exist on one side only.
fn moved(tolerances: &Figures, stored: &Figures, now: &Figures) -> Vec<String> {
    let names: std::collections::BTreeSet<_> = stored.keys().chain(now.keys()).collect();
    let judge = |name: &String| {
        let (Some(&tolerance), Some(&stored), Some(&now)) = (tolerances.get(name), stored.get(name), now.get(name))
        else {
            return Some(format!("{name}: is missing in the file or among what was measured"));
        };
        // NaN is within no tolerance.
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
            if settings.technique.needs_ray_queries() && gpu_with_ray_queries().is_none() {
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
    if is_set("UPDATE_GUARD") {
        guard.figures = measured;
        std::fs::write(&path, serde_json::to_string_pretty(&guard).unwrap() + "\n").unwrap();
        rewritten("UPDATE_GUARD", &path);
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

    // A missing strategy and a missing sample change the figures.
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
