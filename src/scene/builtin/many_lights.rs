//! A hall of many small lights. Partitions and pillars hide most of them from any point, so that nearby
//! lights dominate.

use std::f32::consts::PI;

use glam::Vec3;

use super::{add_as_is, camera, hash};
use crate::scene::{Emission, Light, Material, Mesh, Scene};

/// Total power of all lights in watts per channel, on average and for any number of lights.
const POWER: f32 = 150.0;
/// Half of the hall's sides along x and z, and its height, metres.
const HALF: f32 = 4.0;
const HEIGHT: f32 = 3.0;
/// Position of the camera.
const EYE: Vec3 = Vec3::new(-3.6, 1.7, 3.6);
/// Minimum distance in metres of a light from walls and pillars, which bounds the irradiance by point lights.
const CLEARANCE: f32 = 0.06;
/// Minimum number of flakes, emissive or not, so that the geometry is the same for fewer lights.
const MIN_FLAKES: u32 = 10_000;
/// Number of hues, and of powers of each, which double from one to the next.
const HUES: u32 = 12;
const STRENGTHS: u32 = 6;
/// Number of cells of the hall, and the bit position of a cell's number in a curve index.
const CELLS: u32 = 64;
const CELL_SHIFT: u32 = 24;

/// Returns the hall with flakes, of which `lights` emit on one side, the one that faces away from the camera:
/// images show their light and not their size. The hall is divided into cells of one colour each. Within a
/// cell flakes are in the order of a space-filling curve, because builders of acceleration structures may
/// depend on the order of triangles.
pub(super) fn emitters(lights: u32) -> Scene {
    let mut scene = hall();
    let flakes = lights.max(MIN_FLAKES);
    let spacing = (4.0 * HALF * HALF * HEIGHT / flakes as f32).cbrt();
    let mut random = Random(0x1234_5678);
    let mut places: Vec<Vec3> = (0..flakes).map(|_| random.place(CLEARANCE + 0.3 * spacing)).collect();
    places.sort_unstable_by_key(|&p| curve_index(p));
    let mut meshes = vec![[Mesh::default(), Mesh::default()]; CELLS as usize];
    let mut power = 0.0;
    for (i, center) in (0..).zip(places) {
        let normal = random.direction();
        let normal = if normal.dot(center - EYE) < 0.0 { -normal } else { normal };
        // Areas, and so powers, vary by a factor of 100.
        let right = normal.any_orthonormal_vector() * (0.03 * spacing * 10.0_f32.powf(random.next()));
        let up = normal.cross(right) * 1.2;
        // Emissive flakes are distributed evenly over all flakes.
        let share = |count: u32| u64::from(count) * u64::from(lights) / u64::from(flakes);
        let shines = share(i + 1) > share(i);
        let cell = curve_index(center) >> CELL_SHIFT;
        let mesh = &mut meshes[cell as usize][usize::from(shines)];
        let first = mesh.positions.len() as u32;
        let corners = [center - right * 0.5 - up * 0.3, center + right * 0.5 - up * 0.3, center + up * 0.6];
        mesh.positions.extend(corners);
        mesh.triangles.push([first, first + 1, first + 2]);
        if shines {
            let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
            power += PI * area * color(cell).element_sum() / 3.0;
        }
    }
    for (cell, [dark, shining]) in (0..).zip(meshes) {
        let emission = Emission { radiance: (color(cell) * (POWER / power)).into(), two_sided: false };
        for (mesh, emission) in [(dark, None), (shining, Some(emission))] {
            if mesh.triangles.is_empty() {
                continue;
            }
            let name = format!("flakes {cell}{}", if emission.is_some() { ", shining" } else { "" });
            scene.materials.push(Material { emission, ..Material::diffuse(name.clone(), Vec3::splat(0.3)) });
            let material = scene.materials.len() - 1;
            add_as_is(&mut scene, material, Mesh { name, ..mesh });
        }
    }
    scene
}

/// Returns the hall with point lights in many colours and powers.
pub(super) fn points(lights: u32) -> Scene {
    let mut scene = hall();
    let mut random = Random(0x8765_4321);
    let places: Vec<(Vec3, Vec3)> = (0..lights)
        .map(|_| {
            let place = random.place(CLEARANCE);
            // Powers vary by a factor of 100 within a cell.
            (place, color(curve_index(place) >> CELL_SHIFT) * 100.0_f32.powf(random.next()))
        })
        .collect();
    let power: f32 = places.iter().map(|(_, color)| 4.0 * PI * color.element_sum() / 3.0).sum();
    scene.lights = places
        .into_iter()
        .map(|(position, color)| Light::Point { position, intensity: color * (POWER / power) })
        .collect();
    scene
}

/// Returns floor, ceiling, walls, partitions with doorways, and pillars.
fn hall() -> Scene {
    let mut scene =
        Scene { cameras: vec![camera(EYE.as_dvec3().to_array(), [0.4, 0.9, -1.8], 78.0)], ..Scene::default() };
    let colors =
        [[0.75, 0.73, 0.7], [0.75; 3], [0.7, 0.3, 0.25], [0.3, 0.55, 0.35], [0.35, 0.4, 0.65], [0.7, 0.65, 0.5]];
    let room = [Vec3::new(-HALF, 0.0, -HALF), Vec3::new(HALF, HEIGHT, HALF)];
    for (side, color) in colors.into_iter().enumerate() {
        scene.materials.push(Material::diffuse(format!("side {side}"), Vec3::from(color)));
        let mesh = face(room, side, true);
        add_as_is(&mut scene, side, mesh);
    }
    scene.materials.push(Material::diffuse("partitions", Vec3::new(0.6, 0.58, 0.55)));
    let material = scene.materials.len() - 1;
    for corners in obstacles() {
        for side in 0..6 {
            add_as_is(&mut scene, material, face(corners, side, false));
        }
    }
    scene
}

/// Returns the lower and upper corners of partitions and pillars.
fn obstacles() -> Vec<[Vec3; 2]> {
    let block = |x: [f32; 2], z: [f32; 2], top: f32| [Vec3::new(x[0], 0.0, z[0]), Vec3::new(x[1], top, z[1])];
    let mut out = vec![
        block([-4.0, -1.2], [-0.05, 0.05], 2.4),
        block([1.4, 4.0], [-0.05, 0.05], 2.4),
        block([-0.05, 0.05], [-4.0, -1.6], 2.4),
        block([-0.05, 0.05], [1.2, 4.0], 2.4),
    ];
    for (x, z) in [(-2.6, -2.6), (-2.0, 2.2), (2.2, -2.0), (2.6, 2.6), (-1.2, -1.4), (1.3, 1.5), (0.0, 0.0)] {
        out.push(block([x - 0.18, x + 0.18], [z - 0.18, z + 0.18], HEIGHT));
    }
    out
}

/// Returns a side of a box: 0 and 1 are below and above, 2 and 3 across x, 4 and 5 across z. Its front faces
/// outwards, or inwards for a room.
fn face([low, high]: [Vec3; 2], side: usize, inwards: bool) -> Mesh {
    let axis = [1, 0, 2][side / 2];
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let upper = side % 2 == 1;
    let corner = |at: [bool; 2]| {
        let mut p = low;
        p[axis] = if upper { high[axis] } else { low[axis] };
        p[u] = if at[0] { high[u] } else { low[u] };
        p[v] = if at[1] { high[v] } else { low[v] };
        p
    };
    // The cross product of u and v points along the axis.
    let mut corners = [[false, false], [true, false], [true, true], [false, true]].map(corner);
    if upper == inwards {
        corners.reverse();
    }
    super::quad(corners)
}

/// Returns one of many unitless colours and strengths, which the scene's total power scales.
fn color(key: u32) -> Vec3 {
    let kind = hash(key) % (HUES * STRENGTHS);
    let angle = (kind % HUES) as f32 / HUES as f32 * 2.0 * PI;
    let hue = Vec3::new(angle.cos(), (angle - 2.0 * PI / 3.0).cos(), (angle + 2.0 * PI / 3.0).cos());
    (Vec3::splat(1.0) + 0.8 * hue) * 2.0_f32.powi((kind / HUES) as i32)
}

/// Returns the 30-bit index of a point on a space-filling curve through the hall (Morton order).
fn curve_index(p: Vec3) -> u32 {
    let cell = (p / Vec3::new(2.0 * HALF, HEIGHT, 2.0 * HALF) + Vec3::new(0.5, 0.0, 0.5)) * 1024.0;
    let spread = |v: f32| (0..10).fold(0, |bits, i| bits | ((v as u32).min(1023) >> i & 1) << (3 * i));
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

/// A generator of random numbers in [0, 1).
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(1);
        (hash(self.0) >> 8) as f32 / (1 << 24) as f32
    }

    fn direction(&mut self) -> Vec3 {
        let z = 1.0 - 2.0 * self.next();
        let (sin, cos) = (2.0 * PI * self.next()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z)
    }

    /// Returns a random point in the hall with a minimum distance from all walls and obstacles.
    fn place(&mut self, distance: f32) -> Vec3 {
        let [low, high] = [Vec3::new(-HALF, 0.0, -HALF) + distance, Vec3::new(HALF, HEIGHT, HALF) - distance];
        loop {
            let p = low + (high - low) * Vec3::new(self.next(), self.next(), self.next());
            let inside = |[low, high]: [Vec3; 2]| p.cmpge(low - distance).all() && p.cmple(high + distance).all();
            if !obstacles().into_iter().any(inside) {
                return p;
            }
        }
    }
}
