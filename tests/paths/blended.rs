//! Which of the camera's rays pass a blended surface is stratified over eight samples, and says nothing of another surface.

use glam::{Mat3, Vec3};
use lightsheaf::render::open;
use lightsheaf::scene::{Environment, Material, Opacity, Scene};
use lightsheaf::settings::{Method, Settings, Technique, Visibility};

use crate::common;
use crate::common::scenes::{add, pinhole, quad};

/// Columns and rows of the pictures.
const SIDE: u32 = 32;

/// Black sheets of opacity 1/4, one behind the other, before a sky of 1. Each shows one of its two triangles.
fn sheets(count: u8) -> Scene {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::Z, Vec3::NEG_Z, 0.5)], ..Scene::default() };
    for i in 0..count {
        let corner = Vec3::new(-50.0, -1.0, -0.1 * f32::from(i));
        let opacity = Some(Opacity::Blended { value: 0.25.into() });
        let black = Material { opacity, ..Material::diffuse(format!("sheet {i}"), Vec3::ZERO) };
        add(&mut scene, quad(corner, Vec3::X * 100.0, Vec3::Y * 100.0), black);
    }
    let world_from_environment = Mat3::IDENTITY;
    scene.environment = Some(Environment { radiance: Vec3::ONE, map: None, world_from_environment });
    scene
}

/// Returns the mean of the pixels and their variance.
fn moments(method: Method, visibility: Visibility, sheet_count: u8, samples: u64) -> [f64; 2] {
    let technique = Technique { method, visibility: Some(visibility) };
    let settings = Settings { technique, width: SIDE, height: SIDE, bounces: 0, ..Settings::plain() };
    let film = common::picture(&mut *open(common::gpu().unwrap(), &sheets(sheet_count), &settings).unwrap(), samples);
    let count = film.pixels.len() as f64;
    let values = || film.pixels.iter().map(|pixel| f64::from(pixel[1]));
    let mean = values().sum::<f64>() / count;
    [mean, values().map(|value| (value - mean).powi(2)).sum::<f64>() / count]
}

#[test]
fn decisions_at_blended_surfaces_are_stratified_and_independent() {
    if common::gpu().is_none() {
        return;
    }
    for (method, visibility) in
        [(Method::Shared, Visibility::Exact), (Method::Shared, Visibility::Bvh), (Method::Path, Visibility::Bvh)]
    {
        // Of eight rays two meet the sheet.
        let [mean, variance] = moments(method, visibility, 1, 8);
        assert!((mean - 0.75).abs() < 1e-6 && variance < 1e-12, "{method} {visibility}: {mean}, {variance}");
        // Of eight rays two meet each, so that the number that meet both is hypergeometric: its variance is 9/28.
        let [mean, variance] = moments(method, visibility, 2, 64);
        let expected = 9.0 / 28.0 / 64.0 / 8.0;
        println!("{method} {visibility}: {mean:.4}, variance over that expected {:.2}", variance / expected);
        assert!((mean - 0.5625).abs() < 4.0 * (expected / 1024.0).sqrt(), "{method} {visibility}: {mean}");
        assert!((0.8..1.2).contains(&(variance / expected)), "{method} {visibility}: {variance}, not {expected}");
    }
}
