//! The Cornell box by its measured data (Cornell University Program of Computer Graphics), in millimetres,
//! rotated and scaled to be two units high and centred on the origin. Mirrors, glass and water follow the
//! scenes of Sun, "A real-time caustics and global illumination rendering framework with RTX technology"
//! (2020), section 5.1.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Mat3, Vec3};

use super::{add, block, camera, quad, vec3};
use crate::scene::model::shapes::icosphere;
use crate::scene::{
    Boundary, Bsdf, Color, Emission, Environment, EnvironmentMap, Fresnel, Light, Material, Mesh, Rows, Scene, Sides,
};

/// Millimetres per unit: half the height of 548.8 mm.
const MILLIMETRES: f64 = 274.4;
const WHITE: usize = 0;
const RED: usize = 1;
const GREEN: usize = 2;

/// Converts the box's own axes, x from right to left and z into the box.
fn plan([x, z]: [f64; 2]) -> [f64; 2] {
    [(278.0 - x) / MILLIMETRES, (279.6 - z) / MILLIMETRES]
}

fn at([x, y, z]: [f64; 3]) -> Vec3 {
    let [x, z] = plan([x, z]);
    vec3(x, y / MILLIMETRES, z)
}

/// Returns walls and camera. The left wall's corners do not lie in one plane; they were measured so.
fn walls(ceiling: bool) -> Scene {
    let mut scene = Scene {
        materials: vec![
            Material::diffuse("white", Vec3::new(0.725, 0.71, 0.68)),
            Material::diffuse("red", Vec3::new(0.63, 0.065, 0.05)),
            Material::diffuse("green", Vec3::new(0.14, 0.45, 0.091)),
        ],
        cameras: vec![camera(
            [0.0, 273.0 / MILLIMETRES, 1079.6 / MILLIMETRES],
            [0.0, 273.0 / MILLIMETRES, 0.0],
            39.307_648_1,
        )],
        ..Scene::default()
    };
    let wall = |corners: [[f64; 3]; 4]| quad(corners.map(at));
    add(&mut scene, "floor", WHITE, wall([[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]]));
    if ceiling {
        let corners = [[556.0, 548.8, 0.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2], [0.0, 548.8, 0.0]];
        add(&mut scene, "ceiling", WHITE, wall(corners));
    }
    add(
        &mut scene,
        "back",
        WHITE,
        wall([[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]]),
    );
    add(&mut scene, "right", GREEN, wall([[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]]));
    add(
        &mut scene,
        "left",
        RED,
        wall([[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]]),
    );
    scene
}

fn short_block(scene: &mut Scene) {
    let corners = [[130.0, 65.0], [82.0, 225.0], [240.0, 272.0], [290.0, 114.0]];
    add(scene, "short_block", WHITE, block(corners.map(plan), 0.0, 165.0 / MILLIMETRES, false));
}

fn tall_block(scene: &mut Scene, material: usize) {
    let corners = [[423.0, 247.0], [265.0, 296.0], [314.0, 456.0], [472.0, 406.0]];
    add(scene, "tall_block", material, block(corners.map(plan), 0.0, 330.0 / MILLIMETRES, false));
}

const POINT_LIGHT: Light = Light::Point { position: Vec3::new(0.0, 1.5, 0.0), intensity: Vec3::splat(4.0) };

/// Returns the Cornell box with a point light.
pub(super) fn point() -> Scene {
    let mut scene = walls(true);
    short_block(&mut scene);
    tall_block(&mut scene, WHITE);
    scene.lights.push(POINT_LIGHT);
    scene
}

/// Returns the Cornell box with its area light.
pub(super) fn area() -> Scene {
    let mut scene = walls(true);
    short_block(&mut scene);
    tall_block(&mut scene, WHITE);
    ceiling_light(&mut scene, 1.0);
    scene
}

fn light(scene: &mut Scene, radiance: Vec3, corners: [Vec3; 4]) {
    let mut black = Material::diffuse("light", Vec3::ZERO);
    black.emission = Some(Emission { radiance: Color::from(radiance), two_sided: false });
    scene.materials.push(black);
    let material = scene.materials.len() - 1;
    add(scene, "light", material, quad(corners));
}

fn ceiling_light(scene: &mut Scene, strength: f32) {
    let corners = [[343.0, 548.3, 227.0], [343.0, 548.3, 332.0], [213.0, 548.3, 332.0], [213.0, 548.3, 227.0]];
    light(scene, strength * Vec3::new(17.0, 12.0, 4.0), corners.map(at));
}

/// Returns the Cornell box with a sphere of gold colour (alpha 0.2), a block of silver colour (alpha 0.1) and
/// a point light.
pub(super) fn glossy() -> Scene {
    let mut scene = walls(true);
    for (name, alpha, color) in
        [("metal_sphere", 0.2, Vec3::new(0.9, 0.7, 0.4)), ("metal_block", 0.1, Vec3::new(0.8, 0.8, 0.85))]
    {
        let bsdf = Bsdf::Conductor { alpha: alpha.into(), fresnel: Fresnel::None, specular: color.into() };
        scene.materials.push(Material { bsdf, ..Material::diffuse(name, color) });
    }
    sphere(&mut scene, 3, [186.0, 169.0], 0.32);
    tall_block(&mut scene, 4);
    scene.lights.push(POINT_LIGHT);
    scene
}

/// Adds a sphere that stands on the floor.
fn sphere(scene: &mut Scene, material: usize, place: [f64; 2], radius: f64) {
    let mut sphere = icosphere(5);
    let [x, z] = plan(place);
    let center = DVec3::new(x, radius, z);
    sphere.positions = sphere.normals.iter().map(|n| (center + radius * n.as_dvec3()).as_vec3()).collect();
    add(scene, "sphere", material, sphere);
}

fn mirror() -> Material {
    let color = Vec3::splat(0.95);
    let bsdf = Bsdf::Conductor { alpha: 0.0.into(), fresnel: Fresnel::None, specular: color.into() };
    Material { bsdf, ..Material::diffuse("mirror", color) }
}

/// Returns a smooth dielectric with a homogeneous absorbing medium behind its front.
fn clear(name: &str, eta: f32, absorption: Vec3) -> Material {
    let white = Color::from(Vec3::ONE);
    let bsdf = Bsdf::Dielectric { alpha: 0.0.into(), eta, reflection: white, transmission: white };
    Material { bsdf, boundary: Boundary::Volume { absorption }, ..Material::diffuse(name, Vec3::ONE) }
}

/// Returns the Cornell box with a mirror sphere and a glass sphere. Both are mirrors in the paper.
pub(super) fn spheres() -> Scene {
    let mut scene = walls(true);
    scene.materials.extend([mirror(), clear("glass", 1.5, Vec3::ZERO)]);
    sphere(&mut scene, 3, [390.0, 370.0], 0.36);
    sphere(&mut scene, 4, [165.0, 180.0], 0.36);
    ceiling_light(&mut scene, 1.0);
    scene
}

/// Returns the Cornell box with a mirror sphere before a mirror as back wall. A front wall, through which the
/// camera looks, closes the box, so that the mirrors reflect a surface.
pub(super) fn mirrors() -> Scene {
    let mut scene = walls(true);
    let front = Material { sides: Sides::OneCulled, ..scene.materials[WHITE].clone() };
    scene.materials.extend([mirror(), front]);
    let corners = [[0.0, 0.0, 0.0], [552.8, 0.0, 0.0], [556.0, 548.8, 0.0], [0.0, 548.8, 0.0]];
    add(&mut scene, "front", 4, quad(corners.map(at)));
    for mesh in scene.meshes.iter_mut().filter(|m| m.name == "back") {
        mesh.material = 3;
    }
    sphere(&mut scene, 3, [278.0, 300.0], 0.42);
    ceiling_light(&mut scene, 1.0);
    scene
}

/// Height of the water level at rest.
const WATER: f64 = 0.3;

/// Returns the Cornell box as a basin of water. A lamp before the box, below the image, shines over the rim.
/// The back wall above the water lies behind the lamp's plane, so the lamp's light can only reach it by
/// reflection off the water.
pub(super) fn water() -> Scene {
    let mut scene = walls(true);
    scene.cameras = vec![camera([0.0, 1.5, 3.3], [0.0, 0.91, -0.5], 36.0)];
    // Red light is absorbed most: a third of it over a metre.
    scene.materials.push(clear("water", 1.33, Vec3::new(0.4, 0.07, 0.04)));
    // The basin is dark, so that the lamp's light in it does not outshine the caustic.
    scene.materials.push(Material::diffuse("basin", Vec3::new(0.08, 0.1, 0.12)));
    for mesh in scene.meshes.iter_mut().filter(|m| m.name == "floor") {
        mesh.material = 4;
    }
    let rim = [[560.0, -10.0], [560.0, 11.0], [-6.0, 11.0], [-6.0, -10.0]];
    add(&mut scene, "rim", WHITE, block(rim.map(plan), 0.0, WATER + 0.015, true));
    add(&mut scene, "water", 3, waves());
    let [_, back] = plan([0.0, 559.2]);
    let (middle, waterline) = (DVec3::new(0.0, 0.85, 2.25), DVec3::new(0.0, WATER, back));
    let along = 0.25 * (waterline - middle).normalize();
    let corner = |x: f64, t: f64| (middle + x * DVec3::X + t * along).as_vec3();
    let corners = [corner(-0.4, -1.0), corner(-0.4, 1.0), corner(0.4, 1.0), corner(0.4, -1.0)];
    light(&mut scene, Vec3::new(1300.0, 1200.0, 1000.0), corners);
    ceiling_light(&mut scene, 0.3);
    scene
}

/// Returns the water's surface, front up, from wall to wall and a little into them.
fn waves() -> Mesh {
    // Each wave has an amplitude, a wave vector and a phase.
    let waves = [
        (0.0030, [9.0, 5.0], 0.3),
        (0.0026, [-7.0, 11.0], 1.9),
        (0.0020, [15.0, -4.0], 4.1),
        (0.0014, [3.0, 17.0], 2.6),
        (0.0010, [-19.0, -9.0], 5.2),
    ];
    const STEPS: u32 = 128;
    let ([west, east], [back, front]) = ([-1.012, 1.017], [-1.023, 1.008]);
    let mut mesh = Mesh::default();
    for row in 0..=STEPS {
        for column in 0..=STEPS {
            let [u, v] = [column, row].map(|i| f64::from(i) / f64::from(STEPS));
            let (x, z) = (west + (east - west) * u, front + (back - front) * v);
            let (mut y, mut slope) = (WATER, [0.0; 2]);
            for (amplitude, [kx, kz], phase) in waves {
                let (sin, cos) = (kx * x + kz * z + phase).sin_cos();
                y += amplitude * sin;
                slope[0] += amplitude * kx * cos;
                slope[1] += amplitude * kz * cos;
            }
            mesh.positions.push(vec3(x, y, z));
            mesh.normals.push(DVec3::new(-slope[0], 1.0, -slope[1]).normalize().as_vec3());
        }
    }
    for row in 0..STEPS {
        for column in 0..STEPS {
            let a = row * (STEPS + 1) + column;
            let b = a + STEPS + 1;
            mesh.triangles.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
        }
    }
    mesh
}

/// Returns the Cornell box without ceiling and front wall under [`sky`].
pub(super) fn env() -> Scene {
    let mut scene = walls(false);
    short_block(&mut scene);
    tall_block(&mut scene, WHITE);
    scene.environment =
        Some(Environment { radiance: Vec3::ONE, map: Some(sky()), world_from_environment: Mat3::IDENTITY });
    scene
}

/// Returns a gradient with a sun of 21 texels. Rows are computed at their middles but looked up with the
/// first and last row at the poles, as in the reference.
fn sky() -> EnvironmentMap {
    let (width, height) = (256, 128);
    let sun = DVec3::new(0.449_438_552_495_030_1, 0.799_001_871_102_275_7, 0.399_500_935_551_137_86);
    let texel = |column: u32, row: u32| {
        let phi = TAU * (f64::from(column) + 0.5) / f64::from(width);
        let theta = PI * (f64::from(row) + 0.5) / f64::from(height);
        let direction = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
        let t = direction.y.max(0.0).sqrt();
        let color = if direction.dot(sun) > 2.8_f64.to_radians().cos() {
            DVec3::new(420.0, 370.0, 290.0)
        } else if direction.y > 0.0 {
            (1.0 - t) * 0.8 * DVec3::new(0.9, 0.95, 1.0) + t * 0.8 * DVec3::new(0.15, 0.32, 0.75)
        } else {
            DVec3::new(0.12, 0.11, 0.1)
        };
        color.as_vec3().to_array()
    };
    let texels = (0..height).flat_map(|row| (0..width).map(move |column| texel(column, row))).collect();
    EnvironmentMap { width, height, texels, rows: Rows::AtPoles }
}
