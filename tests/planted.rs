//! Planted errors are found, and no error is found in the unchanged program: ten runs each, with seeds of
//! their own.
//!
//! A run is eight pictures against the reference, compared as in tests/raster_statistics.rs and tests/paths,
//! where CI has some of these errors. Light adds up, so that a picture with an error in one strategy is
//! composed of the strategies' images. The table:
//!
//!     cargo test --test planted -- --ignored --nocapture

mod common;

use common::statistics::{Look, compare};
use common::{gpu_with_ray_queries, reference};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::render::renderer::Renderer;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{Bsdf, Scene, builtin};
use lightsheaf::settings::{OnlyStrategy, Settings, Technique};

/// Runs of each error.
const RUNS: u32 = 10;
/// Pictures in a run.
const PICTURES: u32 = 8;

/// Opens the renderer of a technique.
fn renderer<'gpu>(gpu: &'gpu Gpu, scene: &Scene, settings: &Settings) -> Box<dyn Renderer + 'gpu> {
    if settings.technique.shares_subpaths() {
        Box::new(SharedRenderer::new(gpu, scene, settings).unwrap())
    } else {
        Box::new(PathRenderer::new(gpu, scene, settings).unwrap())
    }
}

/// Returns the pictures of a run.
fn pictures(renderer: &mut dyn Renderer, run: u32, samples: u32) -> Vec<Film> {
    (0..PICTURES)
        .map(|n| {
            renderer.restart(1 + 100 * run + n);
            renderer.render(samples.into(), &mut |_| true).unwrap();
            renderer.film().unwrap()
        })
        .collect()
}

/// Returns the sum of the pictures, each times a factor of picture and pixel.
fn sum(parts: &[Film], factor: impl Fn(usize, usize) -> f32) -> Film {
    let mut out = parts[0].clone();
    for (i, pixel) in out.pixels.iter_mut().enumerate() {
        *pixel = [0, 1, 2].map(|c| parts.iter().enumerate().map(|(n, p)| factor(n, i) * p.pixels[i][c]).sum());
    }
    out
}

/// A scene, its settings, and the reference's pictures.
struct Case {
    scene: Scene,
    settings: Settings,
    expected: Vec<Film>,
}

impl Case {
    fn new(name: &str, technique: Technique, samples: u32, bounces: u32) -> Self {
        let scene = builtin::load(name).unwrap();
        let settings = Settings { technique, width: 16, height: 16, samples, bounces, ..Settings::plain() };
        let expected = (0..8).map(|seed| reference(&scene, &settings, 1024, 5000 + seed)).collect();
        Self { scene, settings, expected }
    }

    /// Pictures of each run.
    fn runs(&self, gpu: &Gpu, scene: &Scene, only: Option<OnlyStrategy>) -> Vec<Vec<Film>> {
        let mut renderer = renderer(gpu, scene, &Settings { only, ..self.settings.clone() });
        (0..RUNS).map(|run| pictures(renderer.as_mut(), run, self.settings.samples)).collect()
    }

    /// Returns the number of runs in which the comparison rejects the pictures.
    fn caught(&self, runs: &[Vec<Film>]) -> usize {
        runs.iter().filter(|films| !compare(films, &self.expected, Look::Blocks).agrees()).count()
    }
}

/// Returns the number of runs in which each error was caught, by its name.
fn caught(gpu: &Gpu, technique: Technique) -> Vec<(&'static str, usize)> {
    let shares = technique.shares_subpaths();
    // Uniform light shows the smallest change of the whole.
    let even = Case::new("integrating_sphere", technique, if shares { 256 } else { 64 }, 2);
    let right = even.runs(gpu, &even.scene, None);
    let brighter: Vec<Vec<_>> =
        right.iter().map(|films| films.iter().map(|f| sum(std::slice::from_ref(f), |_, _| 1.0075)).collect()).collect();
    let mut out = vec![("nothing", even.caught(&right)), ("light 0.75 % too bright", even.caught(&brighter))];

    // A diffuse surface of reflectance pi R reflects R of direct light per steradian.
    let direct = Case::new("cornell_point", technique, 16, 0);
    let mut without_pi = direct.scene.clone();
    for material in &mut without_pi.materials {
        let Bsdf::Diffuse { reflectance } = &mut material.bsdf else { continue };
        reflectance.factor *= std::f32::consts::PI;
    }
    out.push(("1 / pi missing", direct.caught(&direct.runs(gpu, &without_pi, None))));

    // Every strategy matters in the box.
    let boxed = Case::new("cornell_point", technique, 64, 1);
    let strategies: Vec<_> = OnlyStrategy::all(boxed.settings.bounces, true)
        .filter(|only| only.s > 0 && technique.has_strategy(only.s, only.t))
        .collect();
    let parts: Vec<_> = strategies.iter().map(|&only| boxed.runs(gpu, &boxed.scene, Some(only))).collect();
    let all = |factor: &dyn Fn(&OnlyStrategy, usize) -> f32| -> Vec<Vec<Film>> {
        let of = |run: usize, picture: usize| {
            let films: Vec<_> = parts.iter().map(|p| p[run][picture].clone()).collect();
            sum(&films, |n, pixel| factor(&strategies[n], pixel))
        };
        (0..RUNS as usize).map(|run| (0..PICTURES as usize).map(|picture| of(run, picture)).collect()).collect()
    };
    let whole = all(&|_, _| 1.0);
    let same: Vec<_> = whole.iter().map(|films| vec![films[0].clone(); films.len()]).collect();
    out.push(("nothing, sum of strategies", boxed.caught(&whole)));
    out.push(("seed not advanced", boxed.caught(&same)));
    let of_length = |only: &OnlyStrategy| strategies.iter().filter(|o| o.s + o.t == only.s + only.t).count();
    if technique != Technique::PATH {
        let dropped = all(&|only, _| if (only.s, only.t) == (2, 2) { 0.0 } else { 1.0 });
        out.push(("strategy (2, 2) dropped", boxed.caught(&dropped)));
        let divided = all(&|only, _| 1.0 / of_length(only) as f32);
        out.push(("weights over number of strategies", boxed.caught(&divided)));
    }
    if technique == Technique::RAY_QUERY {
        // On every second pixel, one of two splats overwrites the other.
        let lost = all(&|only, pixel| if only.t == 1 && pixel % 2 == 1 { 0.5 } else { 1.0 });
        out.push(("splats lost to a race", boxed.caught(&lost)));
    }
    out
}

#[test]
#[ignore = "minutes: the table"]
fn planted_errors_are_caught_in_nine_runs_of_ten() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    println!("| method | planted | caught of {RUNS} |\n|---|---|---|");
    let mut failed = Vec::new();
    for technique in [Technique::RAY_QUERY, Technique::PATH, Technique::RASTER] {
        for (name, caught) in caught(gpu, technique) {
            println!("| {technique} | {name} | {caught} |");
            let good = if name.starts_with("nothing") { caught == 0 } else { 10 * caught >= 9 * RUNS as usize };
            if !good {
                failed.push(format!("{technique}, {name}: {caught}"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}
