//! The Cornell box by its measured data (Cornell University Program of Computer Graphics), in millimetres, turned and scaled
//! to be two units high and centred on the origin.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Mat3, Vec3};

use super::{add, block, camera, quad, vec3};
use crate::scene::shapes::icosphere;
use crate::scene::{Bsdf, Color, Emission, Environment, EnvironmentMap, Fresnel, Light, Material, Rows, Scene};

/// Half the height of 548.8 mm is one unit.
const MILLIMETRES: f64 = 274.4;
const WHITE: usize = 0;
const RED: usize = 1;
const GREEN: usize = 2;

/// The box's own axes: x from right to left, z into the box.
fn plan([x, z]: [f64; 2]) -> [f64; 2] {
    [(278.0 - x) / MILLIMETRES, (279.6 - z) / MILLIMETRES]
}

fn at([x, y, z]: [f64; 3]) -> Vec3 {
    let [x, z] = plan([x, z]);
    vec3(x, y / MILLIMETRES, z)
}

/// Walls and camera. The left wall's corners do not lie in one plane; they were measured so.
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

/// Cornell box with a point light.
pub(super) fn point() -> Scene {
    let mut scene = walls(true);
    short_block(&mut scene);
    tall_block(&mut scene, WHITE);
    scene.lights.push(POINT_LIGHT);
    scene
}

/// Cornell box with its area light.
pub(super) fn area() -> Scene {
    let mut scene = walls(true);
    short_block(&mut scene);
    tall_block(&mut scene, WHITE);
    let mut black = Material::diffuse("light", Vec3::ZERO);
    black.emission = Some(Emission { radiance: Color::from(Vec3::new(17.0, 12.0, 4.0)), two_sided: false });
    scene.materials.push(black);
    let corners = [[343.0, 548.3, 227.0], [343.0, 548.3, 332.0], [213.0, 548.3, 332.0], [213.0, 548.3, 227.0]];
    let light = scene.materials.len() - 1;
    add(&mut scene, "light", light, quad(corners.map(at)));
    scene
}

/// Cornell box with a sphere of gold colour (alpha 0.2) and a block of silver colour (alpha 0.1), point light.
pub(super) fn glossy() -> Scene {
    let mut scene = walls(true);
    for (name, alpha, color) in
        [("metal_sphere", 0.2, Vec3::new(0.9, 0.7, 0.4)), ("metal_block", 0.1, Vec3::new(0.8, 0.8, 0.85))]
    {
        let bsdf = Bsdf::Conductor { alpha: alpha.into(), fresnel: Fresnel::None, specular: color.into() };
        scene.materials.push(Material { bsdf, ..Material::diffuse(name, color) });
    }
    let mut sphere = icosphere(5);
    let [x, z] = plan([186.0, 169.0]);
    let center = DVec3::new(x, 0.32, z);
    sphere.positions = sphere.normals.iter().map(|n| (center + 0.32 * n.as_dvec3()).as_vec3()).collect();
    add(&mut scene, "sphere", 3, sphere);
    tall_block(&mut scene, 4);
    scene.lights.push(POINT_LIGHT);
    scene
}

/// Cornell box without ceiling and front wall under [`sky`].
pub(super) fn env() -> Scene {
    let mut scene = walls(false);
    short_block(&mut scene);
    tall_block(&mut scene, WHITE);
    scene.environment =
        Some(Environment { radiance: Vec3::ONE, map: Some(sky()), world_from_environment: Mat3::IDENTITY });
    scene
}

/// A gradient with a sun of 21 texels; rows are computed at their middles and met at the poles, as in the reference.
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
