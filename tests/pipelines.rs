//! Pipelines that threads build: they are there when a renderer is, a device may be dropped meanwhile, and errors reach
//! whoever uses them.

mod common;

use common::folder::Folder;
use common::gpu;
use lightsheaf::gpu::{Compute, Flag, Gpu, Source};
use lightsheaf::render;
use lightsheaf::scene::builtin;
use lightsheaf::settings::{Settings, Technique};

/// Shaders that take long enough to link that threads still build when the next statement runs.
const LONG: [&str; 3] = ["shared/paths/extend", "shared/paths/connect", "shared/camera/eye_vertices"];

fn settings(technique: Technique) -> Settings {
    Settings { technique, width: 16, height: 16, ..Settings::plain() }
}

/// Every pipeline is linked and compiled when `open` returns, and its file is whole.
#[test]
fn a_renderer_opens_with_its_pipelines() {
    let Some(_) = gpu() else { return };
    for technique in [Technique::RASTER, Technique::PATH] {
        // The files are those of a device that has built nothing before.
        let (gpu, folder) = (Gpu::new().unwrap(), Folder::new("dump"));
        gpu.dump_shaders(&folder.0).unwrap();
        let scene = builtin::load("cornell_point").unwrap();
        let renderer = render::open(&gpu, &scene, &settings(technique)).unwrap();
        let counts = gpu.ledger.counts();
        let files = folder.files();
        assert!(files.len() >= counts.pipelines.len() && !counts.pipelines.is_empty(), "{files:?}");
        for (label, requests) in &counts.pipelines {
            let of_label = files.iter().filter(|file| file.split('.').next() == Some(label)).count() as u64;
            assert!((1..=*requests).contains(&of_label), "{label}: {files:?}");
        }
        assert!(counts.functions.values().flatten().count() > 10, "{:?}", counts.functions);
        for file in &files {
            let text = folder.read(file);
            assert!(text.starts_with("// ") && naga::front::wgsl::parse_str(&text).is_ok(), "{file}: {text}");
        }
        drop(renderer);
    }
}

/// The names of dumped files follow the order of requests, not that in which threads end.
#[test]
fn dumped_names_follow_the_order_of_requests() {
    let Some(_) = gpu() else { return };
    let (gpu, folder) = (Gpu::new().unwrap(), Folder::new("order"));
    gpu.dump_shaders(&folder.0).unwrap();
    let sets: [&[Flag]; 4] = [&[Flag::Layered, Flag::Adaptive], &[Flag::Layered], &[Flag::Adaptive], &[]];
    let _pipelines = sets.map(|flags| Compute::new(&gpu, "shared/film/accumulate", flags));
    gpu.finish_pipelines();
    let names = ["accumulate.wgsl", "accumulate.1.wgsl", "accumulate.2.wgsl", "accumulate.3.wgsl"];
    for (name, flags) in names.iter().zip(sets) {
        let head = folder.read(name).lines().next().unwrap_or_default().to_owned();
        for flag in [Flag::Layered, Flag::Adaptive] {
            assert_eq!(head.contains(flag.name()), flags.contains(&flag), "{name}: {head}");
        }
    }
}

/// A device that goes while threads build for it waits for them, and leaves the rest out.
#[test]
fn a_device_is_dropped_while_threads_build() {
    let Some(_) = gpu() else { return };
    for asked in 1..=LONG.len() {
        let gpu = Gpu::new().unwrap();
        let pipelines: Vec<_> = LONG[..asked].iter().map(|shader| Compute::new(&gpu, shader, &[])).collect();
        drop(gpu);
        drop(pipelines);
    }
}

/// A thread that meets a broken shader neither ends the program nor hides the error.
#[test]
#[should_panic(expected = "planted_function")]
fn a_broken_shader_is_an_error_where_it_is_used() {
    const BROKEN: &str = "@compute @workgroup_size(1) fn main() { planted_function(); }";
    let gpu = gpu().unwrap_or_else(|| panic!("skipped, so that planted_function is not compiled"));
    let pass = Compute::from_source(gpu, "broken", &Source::Text("broken", BROKEN), &[]);
    // The thread's turn comes first, or not.
    std::thread::sleep(std::time::Duration::from_millis(300));
    pass.record(gpu, &mut gpu.device.create_command_encoder(&Default::default()), [1, 1], &[]);
}
