//! Golden pictures: tests/golden/*.exr against the present pictures.
//!
//! UPDATE_GOLDEN=1 rewrites them and fails. Any other failure leaves the actual picture, the golden one and
//! their signed relative error in target/golden-failures, each as EXR and PNG.

use crate::common;

use std::path::Path;

use common::{gpu, is_set, raster, reference, rewritten};
use lightsheaf::film::Film;
use lightsheaf::metrics::{compare, heatmap};
use lightsheaf::scene::builtin;
use lightsheaf::settings::{Settings, Technique};

/// Largest rel_mse that rounding of other drivers and processors may cause; 1e-4 is 1 % of each value.
const TOLERANCE: f64 = 1e-4;

fn settings(technique: Technique, seed: u32) -> Settings {
    Settings { width: 64, height: 64, samples: 32, technique, seed, ..Settings::plain() }
}

/// Compares a picture with its golden one; the error says where the pictures lie.
fn check(name: &str, film: &Film) -> Result<(), String> {
    check_into("target/golden-failures", name, film)
}

fn check_into(folder: &str, name: &str, film: &Film) -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.join("tests/golden").join(name).with_extension("exr");
    if is_set("UPDATE_GOLDEN") {
        std::fs::create_dir_all(root.join("tests/golden")).map_err(|e| e.to_string())?;
        film.save(&path).map_err(|e| e.to_string())?;
        rewritten("UPDATE_GOLDEN", &path);
    }
    let golden = Film::load(&path).map_err(|e| format!("{e}; UPDATE_GOLDEN=1 writes it"))?;
    let comparison = compare(film, &golden).map_err(|e| e.to_string())?;
    if comparison.rel_mse <= TOLERANCE {
        return Ok(());
    }
    let folder = root.join(folder);
    std::fs::create_dir_all(&folder).map_err(|e| e.to_string())?;
    let error = heatmap(film, &golden).map_err(|e| e.to_string())?;
    for (what, picture) in [("actual", film), ("golden", &golden), ("error", &error)] {
        for extension in ["exr", "png"] {
            picture.save(folder.join(format!("{name}-{what}.{extension}"))).map_err(|e| e.to_string())?;
        }
    }
    Err(format!("{name}: {comparison:?}; see {}/{name}-{{actual,golden,error}}", folder.display()))
}

fn by_raster(technique: Technique, seed: u32) -> Option<Film> {
    Some(raster(gpu()?, &builtin::load("cornell_point").unwrap(), &settings(technique, seed)).0)
}

#[test]
fn raster_exact() {
    let Some(film) = by_raster(Technique::RASTER, 1) else { return };
    check("cornell_point-exact", &film).unwrap();
}

#[test]
fn raster_fast() {
    let Some(film) = by_raster(Technique::FAST, 1) else { return };
    check("cornell_point-fast", &film).unwrap();
}

#[test]
fn by_the_reference() {
    let scene = builtin::load("cornell_point").unwrap();
    check("cornell_point-reference", &reference(&scene, &settings(Technique::RASTER, 1), 32, 1)).unwrap();
}

/// Another seed is another picture: it is rejected, and three pictures are saved.
#[test]
fn canary_another_seed_is_rejected() {
    if is_set("UPDATE_GOLDEN") {
        return;
    }
    let Some(film) = by_raster(Technique::RASTER, 2) else { return };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/golden-canary");
    let error = check_into("target/golden-canary", "cornell_point-exact", &film).unwrap_err();
    println!("{error}");
    for picture in ["actual", "golden", "error"] {
        assert!(Film::load(folder.join(format!("cornell_point-exact-{picture}.exr"))).is_ok(), "{picture}");
    }
    std::fs::remove_dir_all(folder).unwrap();
    let missing = check("no-such-picture", &film).unwrap_err();
    assert!(missing.contains("no-such-picture.exr") && missing.contains("UPDATE_GOLDEN"), "{missing}");
}
