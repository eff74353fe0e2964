//! Scenes with an analytic solution: the radiance of every pixel is derived in a comment beside each scene.
//!
//! The functions take the number of indirect bounces (none: all) and the image position, (0, 0) in the upper
//! left corner and (1, 1) in the lower right one.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{Affine3A, Mat3, Vec2, Vec3};

use super::{add_as_is, camera, quad};
use crate::scene::model::shapes::{cube, icosphere};
use crate::scene::{Bsdf, Camera, Emission, Environment, Fresnel, Light, Material, Mesh, Projection, Scene};

/// Albedo of the diffuse surfaces: every bounce halves the light.
const ALBEDO: f32 = 0.5;

/// Returns a parallel camera at `eye` over [-half, half]^2, looking along `ahead` with `up` up.
fn parallel(eye: Vec3, ahead: Vec3, up: Vec3, half: f32) -> Camera {
    let back = -ahead.normalize();
    let right = up.cross(back).normalize();
    Camera {
        name: "camera".to_owned(),
        world_from_camera: Affine3A::from_mat3_translation(Mat3::from_cols(right, back.cross(right), back), eye),
        projection: Projection::Orthographic { half_extent: Vec2::splat(half) },
        lens: None,
        film_size: Some((128, 128)),
    }
}

/// Returns a camera inside the closed convex bodies.
fn inside() -> Camera {
    Camera { film_size: Some((128, 128)), ..camera([0.2, -0.1, 0.3], [-0.5, -0.3, -0.6], 80.0) }
}

/// Returns the same faces with flat normals, facing inwards.
fn inverted(mesh: Mesh) -> Mesh {
    let triangles = mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect();
    Mesh { name: mesh.name, positions: mesh.positions, triangles, ..Mesh::default() }
}

fn floor(half: f32, y: f32) -> Mesh {
    let corner = |x: f32, z: f32| Vec3::new(x * half, y, z * half);
    let mesh = quad([corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0), corner(-1.0, -1.0)]);
    Mesh { name: "floor".to_owned(), ..mesh }
}

fn sky(radiance: f32) -> Option<Environment> {
    Some(Environment { radiance: Vec3::splat(radiance), map: None, world_from_environment: Mat3::IDENTITY })
}

fn emitting(body: Mesh) -> Scene {
    let mut material = Material::diffuse("furnace", Vec3::splat(ALBEDO));
    material.emission = Some(Emission { radiance: Vec3::splat(0.5).into(), two_sided: false });
    let mut scene = Scene { materials: vec![material], cameras: vec![inside()], ..Scene::default() };
    add_as_is(&mut scene, 0, inverted(body));
    scene
}

/// Returns a closed box that emits 1/2 and reflects 1/2 everywhere.
pub(super) fn furnace() -> Scene {
    emitting(cube())
}

/// Returns a closed sphere of 1280 flat triangles that emits 1/2 and reflects 1/2 everywhere.
pub(super) fn furnace_sphere() -> Scene {
    emitting(icosphere(3))
}

/// Returns the radiance of both furnaces. A closed body whose wall has radiance L everywhere receives pi L,
/// so light that has bounced k times has radiance 1/2 (1/2)^k. Emission, direct light and b bounces are k = 0
/// to b + 1, whose sum is 1 - 2^-(b + 2).
pub(super) fn furnace_answer(bounces: Option<u32>, _at: Vec2) -> f64 {
    bounces.map_or(1.0, |b| 1.0 - 0.5_f64.powi(b as i32 + 2))
}

/// Returns a closed sphere of albedo 1/2, of 20480 flat triangles, with a point light in its centre.
pub(super) fn integrating_sphere() -> Scene {
    let intensity = Vec3::splat((PI / f64::from(ALBEDO)) as f32);
    let mut scene = Scene {
        materials: vec![Material::diffuse("wall", Vec3::splat(ALBEDO))],
        lights: vec![Light::Point { position: Vec3::ZERO, intensity }],
        cameras: vec![inside()],
        ..Scene::default()
    };
    add_as_is(&mut scene, 0, inverted(icosphere(5)));
    scene
}

/// Returns the radiance of the sphere's wall. The light's irradiance is I / R^2 everywhere, so its radiance
/// after one reflection is (1/2) / pi * 2 pi = 1. As in the furnace each further bounce halves it: 1 + 1/2 +
/// ... + 2^-b = 2 - 2^-b. The triangles lie up to 0.06 % nearer to the light: the direct part of a pixel is
/// right within 0.2 %, its mean within 0.1 %.
pub(super) fn integrating_sphere_answer(bounces: Option<u32>, _at: Vec2) -> f64 {
    bounces.map_or(2.0, |b| 2.0 - 0.5_f64.powi(b as i32))
}

/// Returns a white sphere of 1280 flat triangles in an environment of radiance 1.
pub(super) fn white_furnace() -> Scene {
    let mut scene = Scene {
        materials: vec![Material::diffuse("white", Vec3::ONE)],
        environment: sky(1.0),
        cameras: vec![Camera { film_size: Some((128, 128)), ..camera([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], 45.0) }],
        ..Scene::default()
    };
    add_as_is(&mut scene, 0, Mesh { normals: Vec::new(), ..icosphere(3) });
    scene
}

/// Returns the radiance of sphere and environment. A convex body receives light from the environment alone,
/// and a white one reflects all of it, so the two are indistinguishable.
pub(super) fn white_furnace_answer(_bounces: Option<u32>, _at: Vec2) -> f64 {
    1.0
}

const GLOSSY_ALPHA: f64 = 0.5;
const GLOSSY_COS: f64 = 0.8;

/// Returns a rough mirror without absorption (GGX, alpha 1/2) in an environment of radiance 1, seen at an
/// angle of cosine 0.8.
pub(super) fn glossy_furnace() -> Scene {
    let bsdf =
        Bsdf::Conductor { alpha: (GLOSSY_ALPHA as f32).into(), fresnel: Fresnel::None, specular: Vec3::ONE.into() };
    let back = Vec3::new(0.6, 0.8, 0.0);
    let mut scene = Scene {
        materials: vec![Material { bsdf, ..Material::diffuse("metal", Vec3::ONE) }],
        environment: sky(1.0),
        cameras: vec![parallel(back * 4.0, -back, Vec3::Y, 1.0)],
        ..Scene::default()
    };
    add_as_is(&mut scene, 0, floor(4.0, 0.0));
    scene
}

/// Returns the albedo of single scattering: the integral of D(h) G1(i) G1(o) / (4 cos_o) over the directions
/// i, by the midpoint rule over cos_i and the azimuth. It is below 1 because the model loses light that would
/// bounce between facets.
pub(super) fn glossy_furnace_answer(_bounces: Option<u32>, _at: Vec2) -> f64 {
    let a2 = GLOSSY_ALPHA * GLOSSY_ALPHA;
    let g1 = |cos: f64| 2.0 / (1.0 + (1.0 + a2 * (1.0 / (cos * cos) - 1.0)).sqrt());
    let sin_o = (1.0 - GLOSSY_COS * GLOSSY_COS).sqrt();
    // The integrand is smooth; doubling the number of steps changes the fifth digit.
    const STEPS: u32 = 400;
    let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(STEPS);
    let mut sum = 0.0;
    for i in 0..STEPS {
        let cos_i = middle(i);
        let sin_i = (1.0 - cos_i * cos_i).sqrt();
        for j in 0..STEPS {
            let phi = PI * middle(j);
            let h = [sin_i * phi.cos() + sin_o, sin_i * phi.sin(), cos_i + GLOSSY_COS];
            let cos_h = h[2] / (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
            let d = a2 / (PI * (cos_h * cos_h * (a2 - 1.0) + 1.0).powi(2));
            sum += d * g1(cos_i) * g1(GLOSSY_COS) / (4.0 * GLOSSY_COS);
        }
    }
    // The integral over half the azimuths is doubled by symmetry.
    sum * TAU / f64::from(STEPS * STEPS)
}

/// Returns a point light at height 2, a black square of half side 1/4 at height 1, and a floor seen from
/// below the square.
pub(super) fn occluder() -> Scene {
    let mut scene = Scene {
        materials: vec![Material::diffuse("floor", Vec3::splat(ALBEDO)), Material::diffuse("black", Vec3::ZERO)],
        lights: vec![Light::Point { position: Vec3::Y * 2.0, intensity: Vec3::splat((8.0 * PI) as f32) }],
        cameras: vec![parallel(Vec3::Y * 0.5, Vec3::NEG_Y, Vec3::NEG_Z, 1.0)],
        ..Scene::default()
    };
    add_as_is(&mut scene, 0, floor(4.0, 0.0));
    add_as_is(&mut scene, 1, Mesh { name: "occluder".to_owned(), ..floor(0.25, 1.0) });
    scene
}

/// Returns the radiance of the floor. The shadow is the square scaled by two. Outside it, the irradiance is I
/// cos / d^2 = I h / (h^2 + r^2)^(3/2) with h = 2, and the radiance is (1/2) / pi times that. There is no
/// indirect light: the floor is flat, the square black.
pub(super) fn occluder_answer(_bounces: Option<u32>, at: Vec2) -> f64 {
    let [x, z] = [at.x, at.y].map(|v| 2.0 * f64::from(v) - 1.0);
    if x.abs().max(z.abs()) < 0.5 {
        return 0.0;
    }
    let intensity = 8.0 * PI;
    f64::from(ALBEDO) / PI * intensity * 2.0 / (4.0 + x * x + z * z).powf(1.5)
}

const TILT: f64 = FRAC_PI_2 / 3.0;
const SUN: f64 = FRAC_PI_2 / 4.5;

/// Returns a flat floor whose shading normals lean 30 degrees towards +X, in sunlight from 20 degrees that
/// way.
pub(super) fn shading_normals() -> Scene {
    let toward_sun = Vec3::new(SUN.sin() as f32, SUN.cos() as f32, 0.0);
    let mut scene = Scene {
        materials: vec![Material::diffuse("floor", Vec3::splat(ALBEDO))],
        lights: vec![Light::Directional { direction: -toward_sun, irradiance: Vec3::splat((2.0 * PI) as f32) }],
        cameras: vec![parallel(Vec3::Y, Vec3::NEG_Y, Vec3::NEG_Z, 1.0)],
        ..Scene::default()
    };
    let normal = Vec3::new(TILT.sin() as f32, TILT.cos() as f32, 0.0);
    add_as_is(&mut scene, 0, Mesh { normals: vec![normal; 4], ..floor(4.0, 0.0) });
    scene
}

/// Returns the radiance of the floor, whose cosine is that of the shading normal:
/// (1/2) / pi * 2 pi * cos(30 - 20 degrees).
pub(super) fn shading_normals_answer(_bounces: Option<u32>, _at: Vec2) -> f64 {
    (TILT - SUN).cos()
}

/// Returns one triangle that fills the image, with a point light at the camera.
pub(super) fn single_triangle() -> Scene {
    let mut scene = Scene {
        materials: vec![Material::diffuse("triangle", Vec3::splat(ALBEDO))],
        lights: vec![Light::Point { position: Vec3::Z * 2.0, intensity: Vec3::splat((8.0 * PI) as f32) }],
        cameras: vec![parallel(Vec3::Z * 2.0, Vec3::NEG_Z, Vec3::Y, 1.0)],
        ..Scene::default()
    };
    let positions = vec![Vec3::new(-4.0, -2.0, 0.0), Vec3::new(4.0, -2.0, 0.0), Vec3::new(0.0, 6.0, 0.0)];
    let mesh = Mesh { name: "triangle".to_owned(), positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    add_as_is(&mut scene, 0, mesh);
    scene
}

/// Returns the radiance of the triangle, derived as for the floor of [`occluder`] outside the shadow.
pub(super) fn single_triangle_answer(_bounces: Option<u32>, at: Vec2) -> f64 {
    let [x, y] = [at.x, at.y].map(|v| 2.0 * f64::from(v) - 1.0);
    8.0 / (4.0 + x * x + y * y).powf(1.5)
}
