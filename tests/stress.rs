//! The short form of the stress battery passes, and planted failures are reported.

mod common;

use std::collections::BTreeSet;
use std::sync::Mutex;

use common::scenes::{add, emitter, floor, parallel};
use glam::Vec3;
use lightsheaf::scene::{Light, Scene};
use lightsheaf::settings::{Settings, Technique};
use lightsheaf::stress::messages::Listener;
use lightsheaf::stress::{CASES, Case, Report, Seen, Stage, run, select};

/// The listener hears the messages of the whole process, so that batteries take turns.
static ONE: Mutex<()> = Mutex::new(());

fn planted(name: &'static str, run: fn(&Stage) -> Seen) -> Case {
    Case { name, right: "nothing is", methods: &[Technique::RASTER], long: false, run }
}

fn run_all(cases: &[Case]) -> Report {
    run(&select(cases, true, false), &|_, _, _| ()).unwrap()
}

#[test]
fn the_short_form_is_right() {
    if common::gpu().is_none() {
        return;
    }
    let _one = ONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let report = run_all(CASES);
    println!("{report}");
    assert_eq!(report.failed, 0, "{report}");
    assert!(report.rows.len() > 40 && report.rows.iter().all(|row| row.passed && !row.seen.is_empty()));
}

#[test]
fn cases_are_told_apart_and_say_what_is_right() {
    let names: BTreeSet<_> = CASES.iter().map(|case| case.name).collect();
    assert_eq!(names.len(), CASES.len());
    assert!(CASES.iter().all(|case| !case.right.is_empty() && !case.methods.is_empty()));
    let long: Vec<_> = CASES.iter().filter(|case| case.long).map(|case| case.name).collect();
    assert_eq!(long, ["1e9 pixel-samples"]);
    let [short, rasters, all] =
        [(true, true), (false, false), (false, true)].map(|(short, ray_queries)| select(CASES, short, ray_queries));
    assert_eq!(short.len(), CASES.len() - 1);
    assert!(short.iter().all(|(_, technique)| technique.rasterizes()));
    assert!(rasters.iter().all(|(_, technique)| !technique.needs_ray_queries()));
    assert!(rasters.len() > CASES.len() && all.len() > rasters.len());
}

/// Any failure of a case is reported in words, and later cases still run.
#[test]
fn planted_failures_are_reported() {
    if common::gpu().is_none() {
        return;
    }
    let _one = ONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    log::set_boxed_logger(Box::new(Listener(env_logger::Builder::new().filter_level(log::LevelFilter::Off).build())))
        .unwrap();
    log::set_max_level(log::LevelFilter::Warn);
    let fine = |_: &Stage| Ok("fine".to_owned());
    let cases = [
        planted("fine", fine),
        planted("wrong", |_| Err("off by one".to_owned())),
        planted("panic", |_| panic!("a planted panic")),
        planted("device", |stage| {
            // A buffer cannot be both mapped and bound.
            let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::STORAGE;
            let descriptor =
                wgpu::BufferDescriptor { label: Some("planted"), size: 16, usage, mapped_at_creation: false };
            drop(stage.gpu.buffer(&descriptor));
            Ok("fine".to_owned())
        }),
        planted("fine again", fine),
        planted("validation", |_| {
            log::warn!(target: "wgpu_hal::vulkan::instance", "VALIDATION [planted]");
            log::warn!(target: "wgpu_hal::vulkan::instance", "GENERAL [harmless]");
            log::error!(target: "elsewhere", "VALIDATION [not a driver's]");
            Ok("fine".to_owned())
        }),
        planted("not finite", |stage| {
            let mut scene = Scene { cameras: vec![parallel(Vec3::Y, Vec3::NEG_Y, 1.0)], ..Scene::default() };
            add(&mut scene, floor(2.0, 0.0), emitter(0.5, Vec3::new(1.0, f32::NAN, 1.0), true));
            scene.lights = vec![Light::Point { position: Vec3::Y, intensity: Vec3::ONE }];
            stage.render(&scene, &Settings { width: 4, height: 4, samples: 1, ..Settings::plain() })?;
            Ok("fine".to_owned())
        }),
        planted("fine to the end", fine),
    ];
    let report = run_all(&cases);
    let seen: Vec<_> = report.rows.iter().map(|row| (row.name, row.passed)).collect();
    let expected = ["fine", "wrong", "panic", "device", "fine again", "validation", "not finite", "fine to the end"];
    assert_eq!(seen, expected.map(|name| (name, name.starts_with("fine"))), "{report}");
    assert_eq!(report.failed, 5);
    let of = |name: &str| &report.rows.iter().find(|row| row.name == name).unwrap().seen;
    for (name, words) in [
        ("wrong", "off by one"),
        ("panic", "a planted panic"),
        ("device", "planted"),
        ("validation", "VALIDATION [planted]"),
        ("not finite", "eye_vertices"),
    ] {
        assert!(of(name).contains(words), "{name}: {}", of(name));
    }
    assert!(!of("validation").contains("harmless") && !of("validation").contains("driver"));
    // The table reports the same.
    let table = report.to_string();
    assert!(
        table.contains("WRONG") && table.contains("right is: nothing is") && table.contains("3 of 8 right"),
        "{table}"
    );
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!((json["failed"].as_u64(), json["rows"][1]["passed"].as_bool()), (Some(5), Some(false)));
}
