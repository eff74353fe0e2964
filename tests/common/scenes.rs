//! Small scenes built by hand, for tests of every method.

use glam::{Affine3A, Mat3, Vec2, Vec3};
use lightsheaf::reference::{Reference, ReferenceOutput, ReferenceSettings};
use lightsheaf::scene::model::shapes;
#[allow(unused_imports, reason = "not every test builds with both")]
pub use lightsheaf::scene::model::shapes::{add, quad};
use lightsheaf::scene::{Camera, Emission, Environment, FovAxis, Material, Mesh, Projection, Scene};

/// Returns a floor at height y, front up, from -half to half.
pub fn floor(half: f32, y: f32) -> Mesh {
    quad(Vec3::new(-half, y, half), Vec3::X * (2.0 * half), Vec3::NEG_Z * (2.0 * half))
}

/// Returns the inside of a box from -1 to 1, fronts inwards.
pub fn room() -> Mesh {
    shapes::room(1.0)
}

/// Returns a room from -1 to 1 whose window in +z lets light of an even sky in, and a camera inside.
pub fn room_with_a_window() -> Scene {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::new(-0.8, 0.1, 0.2), Vec3::X, 1.4)], ..Scene::default() };
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z];
    for (corner, u, v) in [
        (-x - y + z, x * 2.0, z * -2.0),
        (-x + y - z, x * 2.0, z * 2.0),
        (-x - y - z, x * 2.0, y * 2.0),
        (-x - y + z, z * -2.0, y * 2.0),
        (x - y - z, z * 2.0, y * 2.0),
        // The wall with the window.
        (x - y + z, x * -2.0, y * 1.2),
        (x + y * 0.2 + z, x * -1.3, y * 0.8),
    ] {
        add(&mut scene, quad(corner, u, v), Material::diffuse("wall", Vec3::splat(0.7)));
    }
    scene.environment =
        Some(Environment { radiance: Vec3::new(3.0, 2.0, 1.0), map: None, world_from_environment: Mat3::IDENTITY });
    scene
}

/// Returns an icosahedron subdivided onto the unit sphere, fronts outwards, flat.
pub fn sphere(subdivisions: u32) -> Mesh {
    let g = (1.0 + 5.0_f32.sqrt()) / 2.0;
    let mut positions: Vec<Vec3> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        positions.extend([Vec3::new(0.0, a, b), Vec3::new(a, b, 0.0), Vec3::new(b, 0.0, a)].map(Vec3::normalize));
    }
    // An icosahedron of circumradius 1 has edges of 2 / sqrt(1 + g^2); the next distance is g times that.
    let edge = 2.0 / (1.0 + g * g).sqrt() * 1.1;
    let mut triangles = Vec::new();
    for i in 0..12_u32 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let [p, q, r] = [i, j, k].map(|i| positions[i as usize]);
                if p.distance(q) < edge && q.distance(r) < edge && r.distance(p) < edge {
                    triangles.push(if (q - p).cross(r - p).dot(p) > 0.0 { [i, j, k] } else { [i, k, j] });
                }
            }
        }
    }
    assert_eq!(triangles.len(), 20);
    for _ in 0..subdivisions {
        let mut middles = std::collections::HashMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let mut middle = |a: u32, b: u32| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    positions.push((positions[a as usize] + positions[b as usize]).normalize());
                    positions.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    Mesh { positions, triangles, ..Mesh::default() }
}

/// Turns a mesh inside out.
pub fn inverted(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

/// Returns a diffuse material that emits.
pub fn emitter(albedo: f32, radiance: Vec3, two_sided: bool) -> Material {
    Material {
        emission: Some(Emission { radiance: radiance.into(), two_sided }),
        ..Material::diffuse("emitter", Vec3::splat(albedo))
    }
}

/// Returns a parallel camera that looks along a direction at a square of the given half side.
pub fn parallel(at: Vec3, along: Vec3, half: f32) -> Camera {
    Camera {
        name: "parallel".into(),
        world_from_camera: look(at, along),
        projection: Projection::Orthographic { half_extent: Vec2::splat(half) },
        lens: None,
        film_size: None,
    }
}

/// Returns a pinhole with a full angle of view in radians.
pub fn pinhole(at: Vec3, along: Vec3, fov: f32) -> Camera {
    Camera {
        name: "pinhole".into(),
        world_from_camera: look(at, along),
        projection: Projection::Perspective { fov, axis: FovAxis::Y },
        lens: None,
        film_size: None,
    }
}

fn look(at: Vec3, along: Vec3) -> Affine3A {
    let z = -along.normalize();
    let x = if z.y.abs() > 0.99 { Vec3::X } else { Vec3::Y.cross(z).normalize() };
    Affine3A::from_mat3_translation(Mat3::from_cols(x, z.cross(x), z), at)
}

/// Renders a square image by the reference. Vertices on glass and mirrors are bounces as all others are.
pub fn render(scene: &Scene, side: u32, samples: u32, bounces: Option<u32>) -> ReferenceOutput {
    let settings =
        ReferenceSettings { width: side, height: side, samples, bounces, specular_bounces: 0, seed: 1, camera: 0 };
    let output = Reference::new(scene).render(&settings, &|_, _| ());
    assert_eq!(output.film.pixels.len(), (side * side) as usize);
    output
}

/// Returns the mean of an image.
pub fn mean(output: &ReferenceOutput) -> [f64; 3] {
    let pixels = &output.film.pixels;
    [0, 1, 2].map(|c| pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / pixels.len() as f64)
}

/// Asserts that a value is within a relative tolerance of the expected one.
#[track_caller]
pub fn close(actual: f64, expected: f64, tolerance: f64) {
    assert!((actual - expected).abs() <= tolerance * expected.abs(), "{actual} is not {expected} within {tolerance}");
}
