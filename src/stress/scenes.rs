//! Scenes of the stress tests, and functions that modify or compare them.

use glam::{Affine3A, Mat3, Vec2, Vec3};

use crate::film::Film;
use crate::scene::model::shapes::{add, quad};
use crate::scene::{Camera, Environment, FovAxis, Light, Material, Mesh, Projection, Scene, builtin};

/// The Cornell box, 2 m wide, with a point light.
pub fn cornell() -> Result<Scene, String> {
    builtin::load("cornell_point").map_err(|e| e.to_string())
}

/// A horizontal square with its front upwards, from -half to half.
pub fn ground(half: f32) -> Mesh {
    quad(Vec3::new(-half, 0.0, half), Vec3::X * (2.0 * half), Vec3::NEG_Z * (2.0 * half))
}

fn look(at: Vec3, along: Vec3) -> Affine3A {
    let z = -along.normalize();
    let x = if z.y.abs() > 0.99 { Vec3::X } else { Vec3::Y.cross(z).normalize() };
    Affine3A::from_mat3_translation(Mat3::from_cols(x, z.cross(x), z), at)
}

fn camera(at: Vec3, along: Vec3, projection: Projection) -> Camera {
    Camera { name: String::new(), world_from_camera: look(at, along), projection, lens: None, film_size: None }
}

/// An orthographic camera over a square of the given half side.
pub fn parallel(at: Vec3, along: Vec3, half: f32) -> Camera {
    camera(at, along, Projection::Orthographic { half_extent: Vec2::splat(half) })
}

/// A pinhole camera with a full angle of view in radians.
pub fn pinhole(at: Vec3, along: Vec3, fov: f32) -> Camera {
    camera(at, along, Projection::Perspective { fov, axis: FovAxis::Y })
}

pub fn point(position: Vec3, intensity: f32) -> Light {
    Light::Point { position, intensity: Vec3::splat(intensity) }
}

/// Vertical directional light with an irradiance of pi, under which white ground has a radiance of 1.
pub fn noon() -> Light {
    Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(std::f32::consts::PI) }
}

/// White ground under [`noon`], seen from above: radiance 1 everywhere.
pub fn noon_ground() -> Scene {
    let mut scene =
        Scene { cameras: vec![parallel(Vec3::Y, Vec3::NEG_Y, 1.0)], lights: vec![noon()], ..Scene::default() };
    add(&mut scene, ground(10.0), Material::diffuse("ground", Vec3::ONE));
    scene
}

pub fn sky(radiance: f32) -> Environment {
    Environment { radiance: Vec3::splat(radiance), map: None, world_from_environment: Mat3::IDENTITY }
}

/// Returns a scene scaled by a factor and then moved, with the light scaled such that its picture does not
/// change.
pub fn placed(scene: &Scene, scale: f32, offset: Vec3) -> Scene {
    let at = |p: Vec3| p * scale + offset;
    let mut out = scene.clone();
    let change = Affine3A::from_scale_rotation_translation(Vec3::splat(scale), glam::Quat::IDENTITY, offset);
    out.instances.iter_mut().for_each(|i| i.world_from_local = change * i.world_from_local);
    for camera in &mut out.cameras {
        let from = &mut camera.world_from_camera;
        from.translation = at(Vec3::from(from.translation)).into();
    }
    for light in &mut out.lights {
        if let Light::Point { position, intensity } = light {
            (*position, *intensity) = (at(*position), *intensity * scale * scale);
        }
    }
    out
}

/// Mean of all values.
pub fn mean(film: &Film) -> f64 {
    film.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * film.pixels.len()) as f64
}

/// Smallest and largest value.
pub fn range(film: &Film) -> [f32; 2] {
    let values = || film.pixels.iter().flatten().copied();
    [values().fold(f32::INFINITY, f32::min), values().fold(f32::NEG_INFINITY, f32::max)]
}

/// Relative differences of a picture, multiplied by `factor`, from another one: of the means, and the largest
/// of any value over the other's mean.
pub fn apart(film: &Film, factor: f64, expected: &Film) -> [f64; 2] {
    let pairs = film.pixels.iter().flatten().zip(expected.pixels.iter().flatten());
    let worst = pairs.map(|(a, b)| (factor * f64::from(*a) - f64::from(*b)).abs()).fold(0.0, f64::max);
    let scale = mean(expected);
    [(factor * mean(film) / scale - 1.0).abs(), worst / scale]
}
