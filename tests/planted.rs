//! Errors that are planted are found, and nothing is found where there is none: each in ten runs of its own seeds.
//!
//! A run is eight pictures against the reference, as tests/raster_statistics.rs and tests/paths compare them, where CI has some of
//! these errors. Light adds up, so that a picture with an error in one strategy is put together from the strategies' images. The table:
//!
//!     cargo test --test planted -- --ignored --nocapture

mod common;

use common::statistics::{Look, compare};
use common::{gpu_with_ray_queries, reference};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::path_renderer::PathRenderer;
use lightsheaf::renderer::{Progressive, Renderer};
use lightsheaf::scene::{Bsdf, Scene, builtin};
use lightsheaf::settings::{Method, OnlyStrategy, Settings};

/// Runs of each error.
const RUNS: u32 = 10;
/// Pictures in a run.
const PICTURES: u32 = 8;

fn picture(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Film {
    let draw = |renderer: &mut dyn Progressive| {
        renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
        renderer.film().unwrap()
    };
    if settings.method.shares_subpaths() {
        draw(&mut Renderer::new(gpu, scene, settings).unwrap())
    } else {
        draw(&mut PathRenderer::new(gpu, scene, settings).unwrap())
    }
}

/// Sum of the pictures times a factor of picture and pixel.
fn sum(parts: &[Film], factor: impl Fn(usize, usize) -> f32) -> Film {
    let mut out = parts[0].clone();
    for (i, pixel) in out.pixels.iter_mut().enumerate() {
        *pixel = [0, 1, 2].map(|c| parts.iter().enumerate().map(|(n, p)| factor(n, i) * p.pixels[i][c]).sum());
    }
    out
}

/// A scene with what the reference makes of it.
struct Case {
    scene: Scene,
    settings: Settings,
    expected: Vec<Film>,
}

impl Case {
    fn new(name: &str, method: Method, samples: u32, bounces: u32) -> Self {
        let scene = builtin::load(name).unwrap();
        let settings = Settings { method, width: 16, height: 16, samples, bounces, ..Settings::default() };
        let expected = (0..8).map(|seed| reference(&scene, &settings, 1024, 5000 + seed)).collect();
        Self { scene, settings, expected }
    }

    fn settings(&self, run: u32, picture: u32) -> Settings {
        Settings { seed: 1 + 100 * run + picture, ..self.settings.clone() }
    }

    fn pictures(&self, gpu: &Gpu, scene: &Scene, run: u32) -> Vec<Film> {
        (0..PICTURES).map(|n| picture(gpu, scene, &self.settings(run, n))).collect()
    }

    /// Whether the comparison says that the pictures are wrong.
    fn caught(&self, films: &[Film]) -> bool {
        !compare(films, &self.expected, Look::Blocks).agrees()
    }
}

/// What was caught, by name of the error.
fn run(gpu: &Gpu, method: Method, [even, direct, boxed]: &[Case; 3], run: u32) -> Vec<(&'static str, bool)> {
    let right = even.pictures(gpu, &even.scene, run);
    let brighter: Vec<_> = right.iter().map(|f| sum(std::slice::from_ref(f), |_, _| 1.0075)).collect();
    let mut out = vec![("nothing", even.caught(&right)), ("light 0.75 % too bright", even.caught(&brighter))];

    // A diffuse surface of reflectance pi R reflects R of direct light per steradian.
    let mut without_pi = direct.scene.clone();
    for material in &mut without_pi.materials {
        let Bsdf::Diffuse { reflectance } = &mut material.bsdf else { continue };
        reflectance.factor *= std::f32::consts::PI;
    }
    out.push(("1 / pi missing", direct.caught(&direct.pictures(gpu, &without_pi, run))));

    let strategies: Vec<_> = OnlyStrategy::all(boxed.settings.bounces, true)
        .filter(|only| only.s > 0 && method.has_strategy(only.s, only.t))
        .collect();
    let parts: Vec<Vec<Film>> = (0..PICTURES)
        .map(|n| {
            let settings = boxed.settings(run, n);
            let one = |&only| picture(gpu, &boxed.scene, &Settings { only: Some(only), ..settings.clone() });
            strategies.iter().map(one).collect()
        })
        .collect();
    let all = |factor: &dyn Fn(&OnlyStrategy, usize) -> f32| -> Vec<Film> {
        parts.iter().map(|parts| sum(parts, |n, pixel| factor(&strategies[n], pixel))).collect()
    };
    let whole = all(&|_, _| 1.0);
    out.push(("nothing, sum of strategies", boxed.caught(&whole)));
    out.push(("seed not advanced", boxed.caught(&vec![whole[0].clone(); whole.len()])));
    let of_length = |only: &OnlyStrategy| strategies.iter().filter(|o| o.s + o.t == only.s + only.t).count();
    if method != Method::Path {
        let dropped = all(&|only, _| if (only.s, only.t) == (2, 2) { 0.0 } else { 1.0 });
        out.push(("strategy (2, 2) dropped", boxed.caught(&dropped)));
        let divided = all(&|only, _| 1.0 / of_length(only) as f32);
        out.push(("weights over number of strategies", boxed.caught(&divided)));
    }
    if method == Method::RayQuery {
        // On every second pixel, one of two splats overwrites the other.
        let lost = all(&|only, pixel| if only.t == 1 && pixel % 2 == 1 { 0.5 } else { 1.0 });
        out.push(("splats lost to a race", boxed.caught(&lost)));
    }
    out
}

#[test]
#[ignore = "a quarter of an hour: the table"]
fn planted_errors_are_caught_in_nine_runs_of_ten() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    println!("| method | planted | caught of {RUNS} |\n|---|---|---|");
    let mut failed = Vec::new();
    for method in [Method::Raster, Method::RayQuery, Method::Path] {
        let shares = method.shares_subpaths();
        // Even light shows the smallest change of the whole; in the box every strategy matters.
        let cases = [
            Case::new("integrating_sphere", method, if shares { 256 } else { 64 }, 2),
            Case::new("cornell_point", method, 16, 0),
            Case::new("cornell_point", method, if shares { 128 } else { 64 }, 1),
        ];
        let runs: Vec<_> = (0..RUNS).map(|n| run(gpu, method, &cases, n)).collect();
        for i in 0..runs[0].len() {
            let name = runs[0][i].0;
            let caught = runs.iter().filter(|r| r[i].1).count() as u32;
            println!("| {method} | {name} | {caught} |");
            let good = if name.starts_with("nothing") { caught == 0 } else { 10 * caught >= 9 * RUNS };
            if !good {
                failed.push(format!("{method}, {name}: {caught}"));
            }
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}
