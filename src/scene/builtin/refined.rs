//! Refined surfaces: 96 triangles rounded by Phong tessellation, a sea with animated waves, a terrain.

use glam::{DVec3, Mat3, Vec2, Vec3, Vec3Swizzles as _};

use super::{add, add_as_is, block, camera, hash, vec3};
use crate::scene::model::shapes::{icosphere, room, sphere};
use crate::scene::{
    Bsdf, Displacement, EdgeFactor, Environment, Height, Light, Material, Mesh, Scene, Tessellation, Wave,
};

/// Returns a sphere of 96 triangles, the number in figure 10 of Tokuyoshi and Ogaki (2012), with and without
/// Phong tessellation, in a room with a point light.
pub(super) fn phong_sphere() -> Scene {
    let colors = [("room", [0.7, 0.7, 0.68]), ("as it is", [0.3, 0.45, 0.65]), ("rounded", [0.75, 0.35, 0.2])];
    let mut scene = Scene {
        materials: colors.map(|(name, color)| Material::diffuse(name, Vec3::from(color))).to_vec(),
        lights: vec![Light::Point { position: vec3(0.1, 0.8, 0.5), intensity: Vec3::splat(1.6) }],
        cameras: vec![camera([0.0, -0.1, 0.98], [0.0, -0.35, -0.3], 75.0)],
        ..Scene::default()
    };
    add_as_is(&mut scene, 0, Mesh { name: "room".to_owned(), ..room(1.0) });
    for (material, x) in [(1, -0.46), (2, 0.46)] {
        let mut ball = sphere(8, 7);
        // The rotation moves the poles to +Y and -Y.
        let turned = |v: Vec3| vec3(v.y.into(), v.z.into(), v.x.into());
        ball.positions.iter_mut().for_each(|p| *p = turned(*p) * 0.4 + vec3(x, -0.5, -0.3));
        ball.normals.iter_mut().for_each(|n| *n = turned(*n));
        if material == 2 {
            Tessellation { factor: EdgeFactor::Fixed(8), ..Tessellation::default() }.refine(&mut ball);
        }
        add_as_is(&mut scene, material, ball);
    }
    scene
}

/// Returns a grid of n x n squares with sides of `side` metres in the plane y = 0 around the origin, facing
/// up; u runs along +X, v along +Z.
fn plane(side: f32, n: u32) -> Mesh {
    let corners = (0..=n).flat_map(|j| (0..=n).map(move |i| Vec2::new(i as f32, j as f32) / n as f32));
    let uvs: Vec<Vec2> = corners.collect();
    let index = |i: u32, j: u32| j * (n + 1) + i;
    let squares = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    Mesh {
        positions: uvs.iter().map(|uv| (*uv - 0.5).extend(0.0).xzy() * side).collect(),
        normals: vec![Vec3::Y; uvs.len()],
        triangles: squares
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [index(i, j), index(i, j + 1), index(i + 1, j + 1), index(i + 1, j)];
                // Diagonals alternate, so that no direction is preferred.
                if (i + j) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
            })
            .collect(),
        uvs: [uvs, Vec::new()],
        ..Mesh::default()
    }
}

/// Returns a uniform sky and a sun.
fn daylight(sun: [f64; 3]) -> (Option<Environment>, Vec<Light>) {
    let radiance = Vec3::new(0.45, 0.6, 0.85);
    let sky = Environment { radiance, map: None, world_from_environment: Mat3::IDENTITY };
    let direction = -DVec3::from(sun).normalize().as_vec3();
    (Some(sky), vec![Light::Directional { direction, irradiance: Vec3::new(3.0, 2.7, 2.2) }])
}

/// Returns waves of 0.7 to 9 metres of similar direction and equal steepness.
fn swell() -> Vec<Wave> {
    let random = |key: u32| (hash(key) >> 8) as f32 / (1 << 24) as f32;
    (0..24)
        .map(|i| {
            let length = 9.0 * 0.895_f32.powi(i as i32);
            let turn = 0.6 + 1.5 * (random(2 * i) - 0.5);
            let wave = Wave::on_water(Vec3::new(turn.cos(), 0.0, turn.sin()), length, 0.0095 * length);
            Wave { phase: random(2 * i + 1), ..wave }
        })
        .collect()
}

/// Returns a sea in sunlight with a jetty; the waves are animated.
pub(super) fn sea() -> Scene {
    let (environment, lights) = daylight([-0.5, 0.5, -0.75]);
    let water = Bsdf::MetallicRoughness {
        base_color: Vec3::new(0.02, 0.11, 0.13).into(),
        metallic: 0.0.into(),
        roughness: 0.35.into(),
        ior: 1.33,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 0.0.into(),
    };
    let mut scene = Scene {
        materials: vec![
            Material { bsdf: water, ..Material::diffuse("water", Vec3::ONE) },
            Material::diffuse("wood", Vec3::new(0.45, 0.33, 0.22)),
            Material::diffuse("buoy", Vec3::new(0.75, 0.12, 0.08)),
        ],
        lights,
        environment,
        cameras: vec![camera([0.0, 2.3, 9.0], [0.0, 0.2, 0.0], 60.0)],
        ..Scene::default()
    };
    let mut water = plane(40.0, 20);
    let displacement = Displacement { height: Height::Waves(swell()), scale: 1.0, bias: 0.0 };
    Tessellation { factor: EdgeFactor::Pixels(8.0), phong: 0.0, displacement: Some(displacement) }.refine(&mut water);
    add_as_is(&mut scene, 0, Mesh { name: "water".to_owned(), ..water });
    let deck = [[1.6, 4.0], [3.2, 4.0], [3.2, -6.0], [1.6, -6.0]];
    add(&mut scene, "deck", 1, block(deck, 0.95, 1.1, true));
    for (i, (x, z)) in
        [(1.7, 3.6), (3.0, 3.6), (1.7, -1.0), (3.0, -1.0), (1.7, -5.6), (3.0, -5.6)].into_iter().enumerate()
    {
        let post = [[x, z + 0.2], [x + 0.2, z + 0.2], [x + 0.2, z], [x, z]];
        add(&mut scene, &format!("post {i}"), 1, block(post, -1.0, 1.5, false));
    }
    let mut buoy = icosphere(3);
    buoy.positions.iter_mut().for_each(|p| *p = *p * 0.5 + vec3(-2.6, 0.25, 2.2));
    add(&mut scene, "buoy", 2, buoy);
    scene
}

/// Returns hills in sunlight, 240 m wide, of seven octaves.
pub(super) fn terrain() -> Scene {
    let (environment, lights) = daylight([0.8, 0.35, 0.2]);
    let mut scene = Scene {
        materials: vec![Material::diffuse("hills", Vec3::new(0.42, 0.38, 0.27))],
        lights,
        environment,
        cameras: vec![camera([-20.0, 34.0, 112.0], [10.0, 4.0, 0.0], 55.0)],
        ..Scene::default()
    };
    let mut hills = plane(240.0, 16);
    let height = Height::Noise { frequency: 1.0 / 60.0, octaves: 7, seed: 7, drift: Vec3::ZERO };
    let displacement = Displacement { height, scale: 30.0, bias: 0.0 };
    Tessellation { factor: EdgeFactor::Pixels(6.0), phong: 0.0, displacement: Some(displacement) }.refine(&mut hills);
    add_as_is(&mut scene, 0, Mesh { name: "hills".to_owned(), ..hills });
    scene
}
