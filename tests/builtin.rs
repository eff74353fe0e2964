//! Built-in scenes: the reference scenes equal their files, and every scene is sound.

use std::path::{Path, PathBuf};

use lightsheaf::scene::{Geometry, LoadError, Scene, builtin, mitsuba};

/// The folder of reference scenes, or a note that a test is skipped.
fn references() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/references");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: {} is missing", folder.display());
    None
}

/// World-space corners of every triangle with normals and material name, starting at the smallest corner, sorted.
fn triangles(scene: &Scene) -> Vec<(String, [[f32; 6]; 3])> {
    let geometry = Geometry::new(scene);
    let mut out: Vec<(String, [[f32; 6]; 3])> = (0..geometry.triangles.len())
        .map(|t| {
            let mut corners = geometry.triangles[t].map(|i| {
                let v = geometry.vertices[i as usize];
                let [p, n] = [v.position, v.normal];
                [p.x, p.y, p.z, n.x, n.y, n.z]
            });
            let first = (0..3).min_by(|&a, &b| corners[a].partial_cmp(&corners[b]).expect("finite")).expect("three");
            corners.rotate_left(first);
            (format!("{:?}", scene.materials[geometry.materials[t] as usize].bsdf), corners)
        })
        .collect();
    out.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
    out
}

/// The largest difference of two lists of triangles that are the same but for rounding.
fn distance(ours: &Scene, theirs: &Scene) -> f32 {
    let (ours, theirs) = (triangles(ours), triangles(theirs));
    assert_eq!(ours.len(), theirs.len(), "triangles");
    // Sorting by rounded numbers may exchange neighbours, so each triangle looks for its nearest.
    let mut by_material: std::collections::HashMap<&str, Vec<&[[f32; 6]; 3]>> = std::collections::HashMap::new();
    for (material, corners) in &theirs {
        by_material.entry(material).or_default().push(corners);
    }
    let apart = |a: &[[f32; 6]; 3], b: &[[f32; 6]; 3]| {
        let rotated = |turn: usize| {
            (0..3).flat_map(|c| (0..6).map(move |k| (a[c][k] - b[(c + turn) % 3][k]).abs())).fold(0.0, f32::max)
        };
        (0..3).map(rotated).fold(f32::INFINITY, f32::min)
    };
    let nearest = |(material, corners): &(String, [[f32; 6]; 3])| {
        let others = by_material.get(material.as_str()).unwrap_or_else(|| panic!("no such material: {material}"));
        // Sorted by the first coordinate, so only a window has to be searched.
        let from = others.partition_point(|o| o[0][0] < corners[0][0] - 1e-3);
        others[from..]
            .iter()
            .take_while(|o| o[0][0] < corners[0][0] + 1e-3)
            .map(|o| apart(corners, o))
            .fold(f32::INFINITY, f32::min)
    };
    ours.iter().map(nearest).fold(0.0, f32::max)
}

#[test]
fn reference_scenes_equal_their_files() {
    let Some(folder) = references() else { return };
    let mut compared = 0;
    for name in ["cornell_point", "cornell_area", "cornell_glossy", "cornell_env", "corner_spikes"] {
        let ours = builtin::load(name).expect("a built-in scene");
        let theirs = mitsuba::load(&folder.join(format!("{name}.xml"))).expect("a reference scene");
        // Nine digits in the files; the sphere's corners were rounded once more.
        let apart = distance(&ours, &theirs);
        assert!(apart < 1e-6, "{name}: corners or normals are {apart} apart");
        assert_eq!(ours.lights, theirs.lights, "{name}");
        assert_eq!(ours.cameras[0].film_size, theirs.cameras[0].film_size, "{name}");
        assert_eq!(ours.cameras[0].projection, theirs.cameras[0].projection, "{name}");
        assert!(ours.cameras[0].world_from_camera.abs_diff_eq(theirs.cameras[0].world_from_camera, 1e-7), "{name}");
        let emissions = |s: &Scene| -> Vec<_> { s.materials.iter().filter_map(|m| m.emission).collect() };
        assert_eq!(emissions(&ours), emissions(&theirs), "{name}");
        assert!(ours.materials.iter().zip(&theirs.materials).all(|(a, b)| a.sides == b.sides), "{name}");
        assert_eq!(ours.environment.is_some(), theirs.environment.is_some(), "{name}");
        if let (Some(a), Some(b)) = (&ours.environment, &theirs.environment) {
            assert_eq!((a.radiance, a.world_from_environment), (b.radiance, b.world_from_environment));
            let (a, b) = (a.map.as_ref().expect("a map"), b.map.as_ref().expect("a map"));
            assert_eq!((a.width, a.height, a.rows), (b.width, b.height, b.rows));
            let apart = a
                .texels
                .iter()
                .flatten()
                .zip(b.texels.iter().flatten())
                .map(|(a, b)| (a - b).abs() / b)
                .fold(0.0, f32::max);
            assert!(apart < 1e-6, "the sky's texels are {apart} apart");
        }
        assert_eq!(theirs.warnings, Vec::<String>::new(), "{name}");
        compared += 1;
    }
    assert_eq!(compared, 5);
    // The canary: another scene of as many triangles is far away.
    let mut moved = builtin::load("cornell_point").expect("a built-in scene");
    moved.meshes[0].positions[0].y += 1e-4;
    assert!(distance(&moved, &builtin::load("cornell_point").expect("a built-in scene")) > 1e-5);
}

#[test]
fn every_scene_is_sound() {
    assert!(builtin::names().count() >= 5);
    for (name, about) in builtin::names() {
        let scene = builtin::load(name).expect("a built-in scene");
        assert_eq!(scene.name, format!("builtin:{name}"));
        assert!(!about.is_empty() && !scene.cameras.is_empty() && scene.warnings.is_empty(), "{name}");
        let geometry = Geometry::new(&scene);
        assert!(!geometry.triangles.is_empty(), "{name}");
        for mesh in &scene.meshes {
            assert!(mesh.material < scene.materials.len(), "{name}");
            assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.positions.len(), "{name}");
            assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5), "{name}, {}", mesh.name);
            assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.positions.len()), "{name}");
        }
        assert!(geometry.vertices.iter().all(|v| v.position.is_finite() && v.normal.is_finite()), "{name}");
    }
}

#[test]
fn an_unknown_name_is_an_error_that_lists_the_known_ones() {
    let error: LoadError = builtin::load("cornell").expect_err("no such scene");
    let text = error.to_string();
    assert!(text.starts_with("builtin:cornell: ") && text.contains("cornell_point"), "{text}");
}
