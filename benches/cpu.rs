//! Benchmarks of the CPU work before the first sample that is noticeable in large scenes: `cargo bench
//! --profile dev`. The dev profile is the one of the program and is optimized. No GPU is needed.

use std::fmt::Write as _;
use std::hint::black_box;
use std::path::PathBuf;

use base64::Engine as _;
use criterion::{Criterion, criterion_group, criterion_main};
use lightsheaf::gpu::{Capabilities, link};
use lightsheaf::reference::bvh::Bvh;
use lightsheaf::render::lights::table::{Hittable, LightTable};
use lightsheaf::render::lights::tree::LightTree;
use lightsheaf::render::shared::plan::FramePlan;
use lightsheaf::render::subpaths::plan::PathPlan;
use lightsheaf::scene::{self, Geometry, SceneStats, builtin};
use lightsheaf::settings::{Settings, Technique};

/// Squares along a side of the height field in the files, which has 80,000 triangles.
const SIDE: usize = 200;

/// Temporary scene files: a height field as glTF with embedded data, and as Mitsuba XML with a PLY file.
struct Files(PathBuf);

impl Files {
    fn new() -> Self {
        let folder = std::env::temp_dir().join(format!("lightsheaf-cpu-bench-{}", std::process::id()));
        let write = |name: &str, text: &str| {
            let done = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(folder.join(name), text));
            assert!(done.is_ok(), "{} cannot be written: {done:?}", folder.join(name).display());
        };
        let (positions, triangles) = hills();
        write("hills.gltf", &gltf(&positions, &triangles));
        write("hills.ply", &ply(&positions, &triangles));
        let shape = r#"<shape type="ply"><string name="filename" value="hills.ply"/></shape>"#;
        write("hills.xml", &format!("<scene version=\"3.0.0\">{shape}</scene>"));
        Self(folder)
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Returns positions and triangles of the height field.
fn hills() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let at = |i: usize, j: usize| {
        let (x, z) = (i as f32 / SIDE as f32, j as f32 / SIDE as f32);
        [x, 0.1 * (17.0 * x).sin() * (13.0 * z).cos(), z]
    };
    let positions = (0..=SIDE).flat_map(|j| (0..=SIDE).map(move |i| at(i, j))).collect();
    let square = |i: usize, j: usize| {
        let [a, b] = [j, j + 1].map(|row| (row * (SIDE + 1) + i) as u32);
        [[a, b, a + 1], [a + 1, b, b + 1]]
    };
    let triangles = (0..SIDE).flat_map(|j| (0..SIDE).flat_map(move |i| square(i, j))).collect();
    (positions, triangles)
}

fn gltf(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> String {
    let data = [bytemuck::cast_slice::<_, u8>(positions), bytemuck::cast_slice(triangles)].concat();
    let (bytes, split) = (data.len(), size_of_val(positions));
    let data = base64::engine::general_purpose::STANDARD.encode(data);
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [
            {{"bufferView": 0, "componentType": 5126, "count": {}, "type": "VEC3", "min": [0, -0.1, 0], "max": [1, 0.1, 1]}},
            {{"bufferView": 1, "componentType": 5125, "count": {}, "type": "SCALAR"}}],
        "bufferViews": [
            {{"buffer": 0, "byteOffset": 0, "byteLength": {split}}},
            {{"buffer": 0, "byteOffset": {split}, "byteLength": {}}}],
        "buffers": [{{"byteLength": {bytes}, "uri": "data:application/octet-stream;base64,{data}"}}]}}"#,
        positions.len(),
        3 * triangles.len(),
        bytes - split
    )
}

fn ply(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> String {
    let mut out = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        positions.len(),
        triangles.len()
    );
    for [x, y, z] in positions {
        let _ = writeln!(out, "{x} {y} {z}");
    }
    for [a, b, c] in triangles {
        let _ = writeln!(out, "3 {a} {b} {c}");
    }
    out
}

fn loaders(criterion: &mut Criterion) {
    let files = Files::new();
    let mut group = criterion.benchmark_group("load");
    for name in ["hills.gltf", "hills.xml"] {
        let path = files.path(name);
        let loaded = scene::load(&path).map(|scene| Geometry::new(&scene).triangles.len());
        assert_eq!(loaded.ok(), Some(2 * SIDE * SIDE), "{name} has the triangles of the height field");
        group.bench_function(name, |b| b.iter(|| scene::load(black_box(&path))));
    }
    group.finish();
}

fn builds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    let room = builtin::load("displaced_room:60000").unwrap_or_default();
    let geometry = Geometry::new(&room);
    group.bench_function("geometry, 60000 triangles", |b| b.iter(|| Geometry::new(black_box(&room))));
    group.bench_function("bvh, 60000 triangles", |b| b.iter(|| Bvh::new(black_box(&geometry), |_| false)));
    let hall = builtin::load("emitter_hall:10000").unwrap_or_default();
    let geometry = Geometry::new(&hall);
    let table = LightTable::new(&hall, &geometry, Hittable::ButConstantSky);
    assert!(table.count() >= 10_000);
    group.bench_function("light_table, 10000 emissive triangles", |b| {
        b.iter(|| LightTable::new(black_box(&hall), &geometry, Hittable::ButConstantSky));
    });
    group.bench_function("light_tree, 10000 emissive triangles", |b| {
        b.iter(|| LightTree::new(black_box(&table), &hall, &geometry));
    });
    group.finish();
}

fn plans(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("plan");
    let capabilities = Capabilities {
        adapter: "none".to_owned(),
        software: true,
        compiles_late: false,
        ray_queries: true,
        timestamps: false,
        max_storage_bytes: 128 << 20,
        max_texture_side: 8192,
        max_texture_layers: 256,
    };
    let room = builtin::load("displaced_room:60000").unwrap_or_default();
    let geometry = Geometry::new(&room);
    let stats = SceneStats::new(&room, &geometry);
    group.bench_function("scene_stats, 60000 triangles", |b| b.iter(|| SceneStats::new(black_box(&room), &geometry)));
    let raster = Settings::plain();
    group.bench_function("raster", |b| b.iter(|| FramePlan::new(black_box(&stats), &raster, &capabilities)));
    let paths = Settings { technique: Technique::RAY_QUERY, ..Settings::plain() };
    group.bench_function("ray-query", |b| b.iter(|| PathPlan::new(black_box(&room), &stats, &paths, &capabilities)));
    group.bench_function("link shared/paths/extend", |b| b.iter(|| link(black_box("shared/paths/extend"), &[])));
    group.finish();
}

criterion_group!(benches, loaders, builds, plans);
criterion_main!(benches);
