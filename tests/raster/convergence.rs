//! Estimated errors of `--target-error` against the true ones.

use crate::common;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use common::{gpu, raster};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::metrics::compare;
use lightsheaf::render::convergence::{BiasFilms, Convergence};
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::scene::{Scene, builtin};
use lightsheaf::settings::Settings;

/// Errors that are asked for.
const TARGETS: [f64; 2] = [0.02, 0.003];

fn settings(seed: u32, interleave: u32) -> Settings {
    let target_error = (interleave > 1).then_some(TARGETS[0]);
    Settings { width: 48, height: 48, seed, interleave: Some(interleave), target_error, ..Settings::plain() }
}

/// Target, estimate and true error at the end of a render.
struct End {
    target: f64,
    estimated: f64,
    exact: f64,
}

impl End {
    /// True if the estimate is within a factor of two, and the error at most twice the target.
    fn is_right(&self) -> bool {
        let ratio = self.estimated / self.exact;
        (0.5..=2.0).contains(&ratio) && self.exact <= 2.0 * self.target
    }
}

/// Returns a picture of many samples, rendered once.
fn truth(gpu: &Gpu, name: &'static str) -> Arc<Film> {
    static FILMS: Mutex<BTreeMap<&str, Arc<Film>>> = Mutex::new(BTreeMap::new());
    let mut films = FILMS.lock().unwrap_or_else(PoisonError::into_inner);
    let render = || raster(gpu, &builtin::load(name).unwrap(), &Settings { samples: 512, ..settings(77, 1) }).0;
    films.entry(name).or_insert_with(|| Arc::new(render())).clone()
}

/// A picture, and those that measure the bias of its filter.
type Films = (Film, Option<BiasFilms>);

/// Renders until these errors are reached; `shown` changes the pictures that the estimate is made from.
fn ends(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings,
    targets: &[f64],
    truth: &Film,
    shown: &mut dyn FnMut(Films) -> Films,
) -> Vec<End> {
    let seed = settings.seed;
    let mut renderer = SharedRenderer::new(gpu, scene, settings).unwrap();
    let mut convergence = Convergence::new(settings.width, settings.height);
    let (mut samples, mut ends) = (0, Vec::new());
    while ends.len() < targets.len() && samples < 1000 {
        renderer.render(convergence.next_checkpoint() - samples, &mut |_| true).unwrap();
        samples = renderer.stats().samples;
        let film = renderer.film().unwrap();
        let exact = compare(&film, truth).unwrap().rel_mse;
        let (film, bias) = shown((film, renderer.bias_films().unwrap()));
        let Some(estimated) = convergence.update(samples, &film, bias.as_ref()) else { continue };
        while let Some(&target) = targets.get(ends.len()).filter(|target| estimated <= **target) {
            println!("seed {seed}, {target}: {samples} samples, estimated {estimated:.5}, true {exact:.5}");
            ends.push(End { target, estimated, exact });
        }
    }
    ends
}

#[test]
fn estimates_are_within_a_factor_of_two() {
    let Some(gpu) = gpu() else { return };
    for name in ["cornell_point", "corner_spikes"] {
        let scene = builtin::load(name).unwrap();
        let truth = truth(gpu, name);
        for seed in 1..=3 {
            let ends = ends(gpu, &scene, &settings(seed, 1), &TARGETS, &truth, &mut |films| films);
            assert_eq!(ends.len(), TARGETS.len(), "{name}, seed {seed}");
            for end in ends {
                assert!(end.is_right(), "{name}, seed {seed}: {} for {}", end.estimated, end.exact);
                for planted in [0.2, 5.0] {
                    assert!(!End { estimated: planted * end.estimated, ..end }.is_right(), "{planted} is not seen");
                }
            }
        }
        // An estimate from pictures that hide most of their differences is too small, and the test finds
        // that.
        let mut first: Option<Film> = None;
        let mut hides = |(film, bias): Films| {
            let first = first.get_or_insert_with(|| film.clone());
            let mut hidden = film;
            for (value, first) in hidden.pixels.iter_mut().flatten().zip(first.pixels.iter().flatten()) {
                *value = first + 0.2 * (*value - first);
            }
            (hidden, bias)
        };
        let planted = ends(gpu, &scene, &settings(1, 1), &TARGETS, &truth, &mut hides);
        assert!(!planted.is_empty() && planted.iter().any(|end| !end.is_right()), "{name}");
    }
}

/// The filter of interleaved pictures blurs corner_spikes, which is an error that all samples share.
#[test]
fn the_bias_of_the_filter_is_seen() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("corner_spikes").unwrap();
    let truth = truth(gpu, "corner_spikes");
    let targets = &TARGETS[..1];
    let right = ends(gpu, &scene, &settings(1, 4), targets, &truth, &mut |films| films);
    assert!(right.len() == 1 && right[0].is_right());
    let blind = ends(gpu, &scene, &settings(1, 4), targets, &truth, &mut |(film, _)| (film, None));
    assert!(blind.len() == 1 && !blind[0].is_right(), "an estimate without the bias passes");
}
