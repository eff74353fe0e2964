//! `raster` in the mean against the reference: every strategy set, depth and kind of light.
//!
//! All pixels of an iteration share their random numbers, so a picture is one observation: the spread is taken over
//! pictures of different seeds (12 or more), and means are held against each other by Welch's t-test at a significance of 0.1 %
//! over all values of a comparison. Seeds are fixed. Errors that are planted have to be found by the very same comparison.

mod common;

use std::f32::consts::PI;
use std::sync::OnceLock;

use common::scenes::{add, pinhole, quad};
use common::statistics::{Look, Verdict, check_distribution, compare};
use common::{gpu, raster, reference};
use glam::{Mat3, Vec3};
use lightsheaf::film::Film;
use lightsheaf::gpu::Gpu;
use lightsheaf::scene::{Bsdf, Emission, Environment, Light, Material, Scene, SpotFalloff, builtin};
use lightsheaf::settings::{Settings, Strategies};

/// Pictures of `raster` in a comparison.
const SEEDS: u32 = 12;
/// Iterations of each.
const ITERATIONS: u32 = 64;

fn settings(bounces: u32) -> Settings {
    Settings { width: 64, height: 64, samples: ITERATIONS, bounces, ..Settings::default() }
}

/// Pictures by `raster`, one per seed.
fn pictures(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Vec<Film> {
    (1..=SEEDS)
        .map(|seed| {
            let (film, stats) = raster(gpu, scene, &Settings { seed, ..settings.clone() });
            assert_eq!(stats.non_finite, 0);
            film
        })
        .collect()
}

/// Pictures by the reference, quieter than those of [`pictures`] together.
fn references(scene: &Scene, settings: &Settings) -> Vec<Film> {
    (0..8).map(|seed| reference(scene, settings, 64, 1000 + seed)).collect()
}

#[track_caller]
fn agree(name: &str, verdict: &Verdict) {
    println!("{name}: {verdict:?}");
    assert!(verdict.agrees(), "{name}: {verdict:?}");
}

#[track_caller]
fn differ(name: &str, verdict: &Verdict) {
    println!("{name}: {verdict:?}");
    assert!(!verdict.agrees(), "{name} was not noticed: {verdict:?}");
}

fn cornell_point() -> Scene {
    builtin::load("cornell_point").unwrap()
}

/// The Cornell box after one bounce by the reference, which several tests look at.
fn cornell_after_one_bounce() -> &'static [Film] {
    static FILMS: OnceLock<Vec<Film>> = OnceLock::new();
    FILMS.get_or_init(|| references(&cornell_point(), &settings(1)))
}

#[test]
fn the_distribution_of_t_is_right() {
    check_distribution();
}

#[test]
fn exact_agrees_with_the_reference_on_the_cornell_box() {
    let Some(gpu) = gpu() else { return };
    for bounces in [0, 1, 2] {
        let films = pictures(gpu, &cornell_point(), &settings(bounces));
        let own;
        let expected = if bounces == 1 {
            cornell_after_one_bounce()
        } else {
            own = references(&cornell_point(), &settings(bounces));
            &own
        };
        agree(&format!("{bounces} bounces"), &compare(&films, expected, Look::Blocks));
    }
}
