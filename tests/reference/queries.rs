//! Single rays against brute force in f64; exclusion of triangles; watertightness.

use glam::{DVec3, Vec3};
use lightsheaf::reference::Reference;
use lightsheaf::scene::{Geometry, Material, Mesh, Scene};

use super::common::random::Random;
use super::common::scenes::{add, floor, inverted, room, sphere};

/// Returns a point of the cube from -1 to 1.
fn point(random: &mut Random) -> Vec3 {
    random.color() * 2.0 - 1.0
}

/// Returns triangles of mixed sizes all over the room, and the room.
fn clutter(count: u32) -> Scene {
    let mut random = Random(11);
    let mut mesh = Mesh::default();
    for i in 0..count {
        let size = if i % 10 == 0 { 1.0 } else { 0.1 };
        let centre = point(&mut random);
        mesh.positions.extend((0..3).map(|_| Vec3::ZERO).map(|p| p + centre + point(&mut random) * size));
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let mut scene = Scene::default();
    add(&mut scene, mesh, Material::diffuse("clutter", Vec3::ONE));
    add(&mut scene, room(), Material::diffuse("room", Vec3::ONE));
    scene
}

/// Returns the distance to a triangle by Cramer's rule in f64.
fn meet(geometry: &Geometry, triangle: usize, origin: Vec3, direction: Vec3) -> Option<f64> {
    let [a, b, c] = geometry.positions(triangle).map(Vec3::as_dvec3);
    let (o, d): (DVec3, DVec3) = (origin.as_dvec3(), direction.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let det = e1.dot(p);
    let s = o - a;
    let u = s.dot(p) / det;
    let q = s.cross(e1);
    let v = d.dot(q) / det;
    let t = e2.dot(q) / det;
    (det != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
}

#[test]
fn nearest_hits_and_edges_agree_with_brute_force() {
    // 1, 2 and 5 triangles make trees of one leaf and of one node.
    for (count, queries) in [(1, 300), (2, 300), (5, 1000), (700, 10_000)] {
        let scene = clutter(count);
        let reference = Reference::new(&scene);
        let geometry = reference.geometry();
        let mut random = Random(u64::from(count));
        let mut different = 0;
        for _ in 0..queries {
            let (origin, direction) = (point(&mut random), random.direction());
            let expected = (0..geometry.triangles.len())
                .filter_map(|i| Some((i, meet(geometry, i, origin, direction)?)))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .expect("the room is closed");
            let hit = reference.closest_hit(origin, direction, None).expect("the room is closed");
            if hit.triangle as usize == expected.0 {
                assert!((f64::from(hit.t) - expected.1).abs() < 1e-5, "{hit:?} {expected:?}");
                let [a, b, c] = geometry.positions(expected.0);
                let [u, v] = hit.bary;
                let met = a * (1.0 - u - v) + b * u + c * v;
                assert!(met.distance(origin + direction * hit.t) < 1e-4, "{hit:?}");
            } else {
                different += 1;
            }
            let q = point(&mut random);
            let blocked =
                (0..geometry.triangles.len()).any(|i| meet(geometry, i, origin, q - origin).is_some_and(|t| t < 1.0));
            different += u32::from(reference.occluded(origin, q, None, None) != blocked);
        }
        assert!(different <= queries / 5000, "{count}: {different} of {queries}");
    }
}

#[test]
fn a_closed_mesh_leaks_no_ray() {
    // Rays are aimed at vertices and at points of edges, where a test that is not watertight lets some
    // through.
    let mut scene = Scene::default();
    add(&mut scene, inverted(sphere(3)), Material::diffuse("wall", Vec3::ONE));
    let reference = Reference::new(&scene);
    let geometry = reference.geometry();
    let mut random = Random(5);
    let mut rays = 0;
    for i in 0..geometry.triangles.len() {
        let [a, b, _] = geometry.positions(i);
        for target in [a, (a + b) * 0.5, a.lerp(b, random.unit())] {
            for _ in 0..20 {
                let origin = point(&mut random) * 0.5;
                assert!(reference.closest_hit(origin, target - origin, None).is_some(), "{origin} to {target}");
                rays += 1;
            }
        }
    }
    assert_eq!(rays, 1280 * 60);
}

#[test]
fn triangles_are_excluded_and_their_planes_not_met_again() {
    // Two floors in one plane, one of them reversed, and a ceiling lie far from the origin, where rounding is
    // coarse.
    let far = Vec3::new(1000.0, 500.0, -2000.0);
    let mut scene = Scene::default();
    add(&mut scene, floor(5.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    add(&mut scene, inverted(floor(5.0, 0.0)), Material::diffuse("twin", Vec3::ONE));
    add(&mut scene, inverted(floor(1e4, 3.0)), Material::diffuse("ceiling", Vec3::ONE));
    for mesh in &mut scene.meshes {
        mesh.positions.iter_mut().for_each(|p| *p += far);
    }
    let reference = Reference::new(&scene);
    let geometry = reference.geometry();
    let mut random = Random(9);
    for _ in 0..10_000 {
        let triangle = (random.unit() * 2.0) as usize;
        let [a, b, c] = geometry.positions(triangle);
        let (mut u, mut v) = (random.unit(), random.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let p = a * (1.0 - u - v) + b * u + c * v;
        let mut up = random.direction();
        up.y = up.y.abs().max(0.01);
        let hit = reference.closest_hit(p, up, Some(triangle as u32)).expect("the ceiling is wide");
        assert!(hit.triangle >= 4 && (hit.t * up.y - 3.0).abs() < 0.02, "{hit:?}");
        let above = p + Vec3::new(random.unit(), 1.5, random.unit());
        assert!(!reference.occluded(p, above, Some(triangle as u32), None));
        assert!(!reference.occluded(above, p, None, Some(triangle as u32)));
        let (above, below) = (p + Vec3::Y * 1.5, p - Vec3::Y * 1.5);
        assert!(reference.occluded(below, above, None, None), "both floors are between");
    }
}
