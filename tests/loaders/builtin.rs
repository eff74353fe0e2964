//! Built-in scenes: the reference scenes equal their files, and every scene is valid.

use crate::common;

use common::references;
use glam::{Vec2, Vec3};
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::scene::load::files::Disk;
use lightsheaf::scene::load::mitsuba;
use lightsheaf::scene::{Boundary, Bsdf, Geometry, LoadError, Scene, builtin};

/// Returns the world-space corners of every triangle with normals and material name, starting at the smallest
/// corner, sorted.
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

/// Returns the largest difference of two lists of triangles that differ by rounding only.
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
        // The list is sorted by the first coordinate, so that only a window has to be searched.
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
        let theirs = mitsuba::load(&folder.join(format!("{name}.xml")), &Disk).expect("a reference scene");
        // The files have nine digits, and the sphere's corners were rounded once more.
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
    // Canary: a scene with one vertex moved is far away.
    let mut moved = builtin::load("cornell_point").expect("a built-in scene");
    moved.meshes[0].positions[0].y += 1e-4;
    assert!(distance(&moved, &builtin::load("cornell_point").expect("a built-in scene")) > 1e-5);
}

#[test]
fn every_scene_is_sound() {
    assert!(builtin::names().count() >= 19);
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

#[test]
fn a_number_belongs_to_scenes_that_take_one() {
    let triangles = |name: &str| Geometry::new(&builtin::load(name).expect("a built-in scene")).triangles.len();
    assert_eq!(triangles("displaced_room"), 12 * 71 * 71);
    assert_eq!(triangles("displaced_room:1"), 12);
    assert_eq!(triangles("displaced_room:1000"), 12 * 9 * 9);
    for (name, cause) in [
        ("displaced_room:0", "from 1 to"),
        ("displaced_room:many", "from 1 to"),
        ("displaced_room:4000000000", "from 1 to"),
        ("occluder:3", "takes no number"),
    ] {
        let error = builtin::load(name).expect_err("a wrong number").to_string();
        assert!(error.contains(cause), "{error}");
    }
}

/// Every edge of a closed body belongs to one triangle in each direction, and fronts point to the inside of
/// rooms.
#[test]
fn closed_scenes_are_closed_and_seen_from_inside() {
    for name in ["furnace", "furnace_sphere", "integrating_sphere", "displaced_room", "displaced_room:1"] {
        let geometry = Geometry::new(&builtin::load(name).expect("a built-in scene"));
        let key = |p: Vec3| (p + 0.0).to_array().map(f32::to_bits);
        let mut edges = std::collections::HashMap::new();
        let mut volume = 0.0;
        for t in 0..geometry.triangles.len() {
            let p = geometry.positions(t);
            volume += f64::from(p[0].dot(p[1].cross(p[2]))) / 6.0;
            for k in 0..3 {
                *edges.entry((key(p[k]), key(p[(k + 1) % 3]))).or_insert(0) += 1;
            }
        }
        assert!(edges.iter().all(|(&(a, b), &n)| n == 1 && edges.get(&(b, a)) == Some(&1)), "{name} has a gap");
        assert!(volume < 0.0, "{name} is seen from outside: {volume}");
        let camera = builtin::load(name).expect("a built-in scene").cameras[0].world_from_camera.translation;
        assert!(camera.abs().max_element() < 1.0 && !edges.is_empty(), "{name}");
    }
}

#[test]
fn the_displaced_room_is_rough_and_its_light_is_inside() {
    let scene = builtin::load("displaced_room").expect("a built-in scene");
    let heights: Vec<f32> = scene.meshes[3].positions.iter().map(|p| p.y + 1.0).collect();
    let highest = heights.iter().copied().fold(0.0, f32::max);
    assert!(heights.iter().all(|&h| (0.0..0.3).contains(&h)) && highest > 0.1, "{highest}");
    let geometry = Geometry::new(&scene);
    let steep = (0..geometry.triangles.len()).filter(|&t| geometry.materials[t] == 3).filter(|&t| {
        let p = geometry.positions(t);
        (p[1] - p[0]).cross(p[2] - p[0]).normalize().y < 0.95
    });
    assert!(steep.count() > 1000, "the floor's triangles lean");
}

/// Halls have the requested number of lights, of the same total power, and none of them in a wall.
#[test]
fn halls_have_the_lights_that_were_asked_for() {
    use lightsheaf::scene::Light;
    let mean = |color: Vec3| f64::from(color.element_sum() / 3.0);
    let emitters = |name: &str| {
        let scene = builtin::load(name).expect("a built-in scene");
        let geometry = Geometry::new(&scene);
        let (mut count, mut power) = (0, 0.0);
        for t in 0..geometry.triangles.len() {
            let Some(emission) = scene.materials[geometry.materials[t] as usize].emission else { continue };
            let [a, b, c] = geometry.positions(t);
            assert!([a, b, c].iter().all(|p| p.abs().max_element() < 4.0 && (0.0..3.0).contains(&p.y)), "{a} {b} {c}");
            count += 1;
            let area = f64::from(0.5 * (b - a).cross(c - a).length());
            power += std::f64::consts::PI * area * mean(emission.radiance.factor);
        }
        (count, power, geometry.triangles.len())
    };
    let points = |name: &str| {
        let scene = builtin::load(name).expect("a built-in scene");
        let power = scene.lights.iter().map(|light| match light {
            Light::Point { intensity, .. } => 4.0 * std::f64::consts::PI * mean(*intensity),
            _ => panic!("{light:?}"),
        });
        (scene.lights.len(), power.sum::<f64>())
    };
    for (name, wanted) in [("emitter_hall", 10_000), ("emitter_hall:100", 100), ("emitter_hall:20000", 20_000)] {
        let (count, power, triangles) = emitters(name);
        assert_eq!(count, wanted, "{name}");
        assert!((power / 150.0 - 1.0).abs() < 1e-3, "{name}: {power} W");
        // Fewer lights do not change the geometry.
        assert_eq!(triangles, wanted.max(10_000) + 12 * 12, "{name}");
    }
    for (name, wanted) in [("point_hall", 100_000), ("point_hall:100", 100)] {
        let (count, power) = points(name);
        assert_eq!(count, wanted, "{name}");
        assert!((power / 150.0 - 1.0).abs() < 1e-3, "{name}: {power} W");
    }
}

/// Returns the world-space corners of the triangles of one material.
fn corners(scene: &Scene, material: &str) -> Vec<[Vec3; 3]> {
    let geometry = Geometry::new(scene);
    let of = |&t: &usize| scene.materials[geometry.materials[t] as usize].name == material;
    (0..geometry.triangles.len()).filter(of).map(|t| geometry.positions(t)).collect()
}

#[test]
fn water_lies_still_enough_and_the_lamp_shines_past_the_wall() {
    let scene = builtin::load("cornell_water").expect("a built-in scene");
    let material = scene.materials.iter().find(|m| m.name == "water").expect("water");
    assert!(matches!(material.bsdf, Bsdf::Dielectric { eta: 1.33, .. }));
    assert!(matches!(material.boundary, Boundary::Volume { absorption } if absorption.x > absorption.z));
    let water = corners(&scene, "water");
    assert!(water.len() > 10_000);
    for [a, b, c] in &water {
        // Fronts point up: air is in front, water behind. No wave rises above the rim.
        assert!((b - a).cross(c - a).normalize().y > 0.95 && a.y < 0.315, "{a} {b} {c}");
    }
    // The lamp faces the water, and no part of the back wall above the water lies before it.
    let lamp = corners(&scene, "light");
    let [a, b, c] = lamp[0];
    let normal = (b - a).cross(c - a).normalize();
    let before = |p: Vec3| normal.dot(p - a) > 1e-3;
    assert!(normal.y < -0.9 && before(Vec3::new(0.0, 0.3, 0.5)));
    for y in [0.32, 1.0, 2.0] {
        for x in [-1.0, 0.0, 1.0] {
            assert!(!before(Vec3::new(x, y, -1.019)), "{x} {y}");
        }
    }
}

#[test]
fn glass_is_left_out_where_no_method_follows_it() {
    let scene = builtin::load("cornell_spheres").expect("a built-in scene");
    let count = |scene: &Scene, material: &str| corners(scene, material).len();
    assert_eq!((count(&scene, "glass"), count(&scene, "mirror")), (20_480, 20_480));
    let rest = scene.clone().without_glass();
    assert_eq!((count(&rest, "glass"), count(&rest, "mirror")), (0, 20_480));
    assert_eq!(rest.warnings.len(), 1);
    for part in ["`glass`", "--method ray-query", "reference"] {
        assert!(rest.warnings[0].contains(part), "{:?}", rest.warnings);
    }
    // glTF's transmission becomes opaque; materials that no mesh uses are not named.
    let mut scene = builtin::load("cornell_point").expect("a built-in scene");
    let mut pane = scene.materials[0].clone();
    pane.name = "pane".to_owned();
    pane.bsdf = Bsdf::MetallicRoughness {
        base_color: Vec3::ONE.into(),
        metallic: 0.0.into(),
        roughness: 0.1.into(),
        ior: 1.5,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 1.0.into(),
    };
    scene.materials.push(pane);
    assert!(scene.clone().without_glass().warnings.is_empty());
    scene.meshes[0].material = scene.materials.len() - 1;
    let opaque = scene.clone().without_glass();
    assert!(opaque.warnings.len() == 1 && opaque.warnings[0].contains("opaque: `pane`"), "{:?}", opaque.warnings);
    assert!(opaque.materials.iter().all(|m| !m.transmits()));
    assert_eq!(opaque.instances.len(), scene.instances.len());
}

/// The reference finds the derived answers, pixel by pixel and in the mean.
#[test]
fn known_answers_are_found() {
    let mut known = 0;
    for (name, _) in builtin::names().filter(|(name, _)| builtin::answer(name, None, Vec2::ZERO).is_some()) {
        let scene = builtin::load(name).expect("a built-in scene");
        let reference = Reference::new(&scene);
        for bounces in [Some(0), Some(2), None] {
            // A multiple of 4 pixels puts the shadow's edge between pixels.
            let side = 16;
            let settings = ReferenceSettings {
                width: side,
                height: side,
                samples: 64,
                bounces,
                specular_bounces: 8,
                seed: 7,
                camera: 0,
            };
            let output = reference.render(&settings, &|_, _| ());
            let at = |i: usize| {
                let (x, y) = (i as u32 % side, i as u32 / side);
                (Vec2::new(x as f32, y as f32) + 0.5) / side as f32
            };
            let constant =
                builtin::answer(name, bounces, Vec2::splat(0.1)) == builtin::answer(name, bounces, Vec2::ONE);
            let expected: Vec<f64> = if constant {
                vec![builtin::answer(name, bounces, Vec2::ONE).expect("known"); output.film.pixels.len()]
            } else {
                (0..output.film.pixels.len()).map(|i| builtin::answer(name, bounces, at(i)).expect("known")).collect()
            };
            let [mut sum, mut wanted] = [0.0; 2];
            for (pixel, expected) in output.film.pixels.iter().zip(&expected) {
                // The longest of the 64 paths end by chance.
                assert!(
                    (f64::from(pixel[0]) - expected).abs() <= 0.25 * expected + 1e-9,
                    "{name}: {pixel:?}, not {expected}"
                );
                sum += f64::from(pixel[0]);
                wanted += expected;
            }
            assert!((sum / wanted - 1.0).abs() < 4e-3, "{name}, {bounces:?} bounces: {sum}, not {wanted}");
            // Canary: 0.75 % more light is found.
            assert!((1.0075 * sum / wanted - 1.0).abs() > 3e-3, "{name}");
        }
        known += 1;
    }
    assert_eq!(known, 8);
}
