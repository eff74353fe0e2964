//! Scenes that need no file: the Cornell boxes of the reference images, scenes with a known answer, and a displaced room.
//!
//! A name may carry a number after a colon where [`names`] says so. All scenes are deterministic.

mod cornell;
mod spikes;

use std::path::PathBuf;

use glam::{Affine3A, Vec3};

use super::shapes::smooth_normals;
use super::{Camera, FovAxis, Instance, LoadError, Mesh, Projection, Scene};

/// A scene's name and its maker, which gets the number after the colon.
struct Entry {
    name: &'static str,
    about: &'static str,
    make: fn() -> Scene,
}

const SCENES: &[Entry] = &[
    Entry { name: "cornell_point", about: "Cornell box, point light under the ceiling", make: cornell::point },
    Entry { name: "cornell_area", about: "Cornell box with its area light", make: cornell::area },
    Entry {
        name: "cornell_glossy",
        about: "Cornell box with a sphere and a block of rough metal, point light",
        make: cornell::glossy,
    },
    Entry {
        name: "cornell_env",
        about: "Cornell box without ceiling and front under a sky with a small sun",
        make: cornell::env,
    },
    Entry {
        name: "corner_spikes",
        about: "point light 2 cm from a wall in a corner with small objects",
        make: spikes::scene,
    },
];

/// Name and one-line description of every scene.
pub fn names() -> impl Iterator<Item = (&'static str, &'static str)> {
    SCENES.iter().map(|e| (e.name, e.about))
}

/// Makes a scene by its name, without `builtin:`.
///
/// # Errors
/// A name that is not in [`names`].
pub fn load(name: &str) -> Result<Scene, LoadError> {
    let path = PathBuf::from(format!("builtin:{name}"));
    let Some(entry) = SCENES.iter().find(|e| e.name == name) else {
        let known: Vec<&str> = names().map(|(name, _)| name).collect();
        return Err(LoadError::new(path, format!("is not a built-in scene; there are {}", known.join(", "))));
    };
    Ok(Scene { name: path.display().to_string(), ..(entry.make)() })
}

/// Four corners, counter-clockwise seen from the front, in two triangles that share the first and the third.
fn quad(corners: [Vec3; 4]) -> Mesh {
    Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

/// A block from y = `bottom` to `top` over four corners of its floor plan, each face with its own vertices.
fn block(plan: [[f64; 2]; 4], bottom: f64, top: f64, closed: bool) -> Mesh {
    let at = |i: usize, y: f64| vec3(plan[i % 4][0], y, plan[i % 4][1]);
    let mut mesh = quad([at(0, top), at(1, top), at(2, top), at(3, top)]);
    let mut inward = |corners: [Vec3; 4]| {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners);
        mesh.triangles.extend([[0, 2, 1], [0, 3, 2]].map(|t: [u32; 3]| t.map(|i| first + i)));
    };
    for i in 0..4 {
        inward([at(i, top), at(i + 1, top), at(i + 1, bottom), at(i, bottom)]);
    }
    if closed {
        inward([at(0, bottom), at(1, bottom), at(2, bottom), at(3, bottom)]);
    }
    mesh
}

fn vec3(x: f64, y: f64, z: f64) -> Vec3 {
    glam::DVec3::new(x, y, z).as_vec3()
}

/// Adds a mesh at its place, with smooth normals if it has none.
fn add(scene: &mut Scene, name: &str, material: usize, mut mesh: Mesh) {
    if mesh.normals.is_empty() {
        mesh.normals = smooth_normals(&mesh.positions, &mesh.triangles);
    }
    name.clone_into(&mut mesh.name);
    mesh.material = material;
    scene.instances.push(Instance { mesh: scene.meshes.len(), world_from_local: Affine3A::IDENTITY });
    scene.meshes.push(mesh);
}

/// A pinhole that looks from one point to another with +Y up; `fov` in degrees across.
fn camera(eye: [f64; 3], target: [f64; 3], fov: f64) -> Camera {
    let [eye, target] = [eye, target].map(glam::DVec3::from);
    let back = (eye - target).normalize();
    let right = glam::DVec3::Y.cross(back).normalize();
    let [x, y, z, w] = [right, back.cross(right), back, eye].map(|v| v.as_vec3a());
    Camera {
        name: "camera".to_owned(),
        world_from_camera: Affine3A::from_cols(x, y, z, w),
        projection: Projection::Perspective { fov: fov.to_radians() as f32, axis: FovAxis::X },
        film_size: Some((512, 512)),
    }
}
