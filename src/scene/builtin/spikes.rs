//! A closed room with a point light 2 cm from a wall and small objects beside it: few paths carry most of the
//! light.

use glam::Vec3;

use super::{add, block, camera, quad, vec3};
use crate::scene::{Light, Material, Mesh, Scene};

/// Returns a block over a rectangle, rotated by `degrees` about +Y.
fn boxed(center: [f64; 2], half: [f64; 2], degrees: f64, bottom: f64, top: f64, closed: bool) -> Mesh {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let corner = |x: f64, z: f64| {
        let [x, z] = [x * half[0], z * half[1]];
        [center[0] + x * cos + z * sin, center[1] - x * sin + z * cos]
    };
    block([corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)], bottom, top, closed)
}

/// Returns the scene `corner_spikes` of the reference images.
pub(super) fn scene() -> Scene {
    let colors = [
        ("grey", [0.7, 0.7, 0.7]),
        ("blue", [0.4, 0.5, 0.75]),
        ("orange", [0.75, 0.5, 0.3]),
        ("wood", [0.6, 0.45, 0.3]),
        ("green", [0.25, 0.6, 0.2]),
        ("red", [0.7, 0.1, 0.1]),
    ];
    let mut scene = Scene {
        materials: colors.map(|(name, color)| Material::diffuse(name, Vec3::from(color))).to_vec(),
        lights: vec![Light::Point { position: Vec3::new(-0.98, 0.6, -0.86), intensity: Vec3::splat(2.0) }],
        cameras: vec![camera([0.75, 1.3, 0.9], [-0.6, 0.7, -0.8], 55.0)],
        ..Scene::default()
    };
    let corner = |x: f64, y: f64, z: f64| vec3(x, y, z);
    // The room [-1, 1] x [0, 2] x [-1, 1], seen from inside.
    let low = [corner(-1.0, 0.0, -1.0), corner(1.0, 0.0, -1.0), corner(1.0, 0.0, 1.0), corner(-1.0, 0.0, 1.0)];
    let high = low.map(|p| p + 2.0 * Vec3::Y);
    add(&mut scene, "floor", 0, quad([low[0], low[3], low[2], low[1]]));
    add(&mut scene, "ceiling", 0, quad(high));
    add(&mut scene, "back", 1, quad([low[0], low[1], high[1], high[0]]));
    add(&mut scene, "front", 0, quad([low[3], high[3], high[2], low[2]]));
    add(&mut scene, "left", 2, quad([low[0], high[0], high[3], low[3]]));
    add(&mut scene, "right", 0, quad([low[1], low[2], high[2], high[1]]));
    add(&mut scene, "shelf", 3, boxed([-0.86, -0.86], [0.16, 0.16], 0.0, 0.365, 0.395, true));
    add(&mut scene, "cube_small", 4, boxed([-0.82, -0.78], [0.05, 0.05], 30.0, 0.395, 0.495, false));
    add(&mut scene, "post", 5, boxed([-0.93, -0.94], [0.015, 0.015], 15.0, 0.395, 0.645, false));
    add(&mut scene, "cube_big", 0, boxed([0.1, -0.3], [0.25, 0.25], 20.0, 0.0, 0.5, false));
    add(&mut scene, "bar", 3, boxed([-0.55, -0.55], [0.3, 0.06], -35.0, 0.0, 0.12, false));
    scene
}
