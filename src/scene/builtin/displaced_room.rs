//! A closed room whose walls are rough: many small triangles of all orientations, for tests of visibility.

use glam::{Vec2, Vec3};

use super::{add_as_is, camera, hash};
use crate::scene::{Light, Material, Mesh, Scene};

/// Maximum inward displacement of a wall in metres.
const DEPTH: f32 = 0.3;

/// Returns the room [-1, 1]^3 with a point light inside and about `triangles` triangles: six walls of n x n
/// squares.
pub(super) fn scene(triangles: u32) -> Scene {
    let n = (triangles as f32 / 12.0).sqrt().round().max(1.0) as u32;
    let colors = [[0.7, 0.2, 0.2], [0.2, 0.6, 0.2], [0.7; 3], [0.75; 3], [0.6, 0.6, 0.75], [0.75, 0.65, 0.5]];
    let mut scene = Scene {
        lights: vec![Light::Point { position: Vec3::new(0.1, 0.55, 0.2), intensity: Vec3::splat(3.0) }],
        cameras: vec![camera([0.4, 0.1, 0.6], [-0.4, -0.2, -0.6], 75.0)],
        ..Scene::default()
    };
    let sides = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
    for (side, (outward, color)) in sides.zip(colors).enumerate() {
        scene.materials.push(Material::diffuse(format!("wall {side}"), Vec3::from(color)));
        add_as_is(&mut scene, side, wall(side as u32, outward, n));
    }
    scene
}

/// Returns a wall that faces inwards. Its edges are not displaced, so that neighbours match exactly.
fn wall(seed: u32, outward: Vec3, n: u32) -> Mesh {
    let along_u = Vec3::new(outward.y, outward.z, outward.x).abs();
    // The cross product of along_u and along_v points inwards.
    let along_v = along_u.cross(outward);
    let at = |i: u32, j: u32| {
        let uv = Vec2::new(i as f32, j as f32) / n as f32;
        let edge = 16.0 * uv.x * (1.0 - uv.x) * uv.y * (1.0 - uv.y);
        // The coordinates are odd about the middle to the last bit, so that a neighbour that counts from the
        // other end has the same corners.
        let centred = |i: u32| (2.0 * i as f32 - n as f32) / n as f32;
        let flat = outward + along_u * centred(i) + along_v * centred(j);
        flat - outward * (DEPTH * edge * bumps(uv, seed))
    };
    let index = |i: u32, j: u32| i * (n + 1) + j;
    let squares = || (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
    Mesh {
        name: format!("wall {seed}"),
        positions: (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))).map(|(i, j)| at(i, j)).collect(),
        triangles: squares()
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect(),
        ..Mesh::default()
    }
}

/// Sums four octaves of value noise to a value in [0, 1].
fn bumps(uv: Vec2, seed: u32) -> f32 {
    let octave = |k: u32| noise(uv * (4 << k) as f32, seed * 4 + k) * 0.5_f32.powi(k as i32 + 1);
    (0..4).map(octave).sum::<f32>() / 0.9375
}

/// Interpolates random values at integer coordinates smoothly.
fn noise(p: Vec2, seed: u32) -> f32 {
    let cell = p.floor();
    let t = p - cell;
    let t = t * t * (Vec2::splat(3.0) - 2.0 * t);
    let value = |dx: u32, dy: u32| {
        let key = (cell.x as u32 + dx) ^ (cell.y as u32 + dy) << 10 ^ seed << 20;
        (hash(key) >> 8) as f32 / (1 << 24) as f32
    };
    let row = |dy: u32| value(0, dy) + (value(1, dy) - value(0, dy)) * t.x;
    row(0) + (row(1) - row(0)) * t.y
}
