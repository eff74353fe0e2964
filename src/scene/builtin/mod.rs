//! Scenes without a file: the Cornell boxes of the reference images, others with mirrors, glass and water,
//! scenes with an analytic solution, a displaced room, halls of many lights, and tessellated and displaced
//! surfaces.
//!
//! A name may carry a number after a colon; [`names`] documents it. All scenes are deterministic.

mod analytic;
mod cornell;
mod displaced_room;
mod many_lights;
mod refined;
mod spikes;

use std::path::PathBuf;

use glam::{Affine3A, Vec2, Vec3};

use crate::scene::model::normals::smooth_normals;
use crate::scene::{Camera, FovAxis, Instance, LoadError, Mesh, Projection, Scene};

/// The analytic radiance of a pixel, from the number of indirect bounces (none: all) and the image position.
type Answer = fn(Option<u32>, Vec2) -> f64;

struct Entry {
    name: &'static str,
    about: &'static str,
    make: Make,
    answer: Option<Answer>,
}

enum Make {
    Plain(fn() -> Scene),
    /// Takes a number after a colon; the second field is its default.
    Counted(fn(u32) -> Scene, u32),
}

const fn plain(name: &'static str, about: &'static str, make: fn() -> Scene) -> Entry {
    Entry { name, about, make: Make::Plain(make), answer: None }
}

const fn known(name: &'static str, about: &'static str, make: fn() -> Scene, answer: Answer) -> Entry {
    Entry { name, about, make: Make::Plain(make), answer: Some(answer) }
}

const SCENES: &[Entry] = &[
    plain("cornell_point", "Cornell box, point light under the ceiling", cornell::point),
    plain("cornell_area", "Cornell box with its area light", cornell::area),
    plain("cornell_glossy", "Cornell box with a sphere and a block of rough metal, point light", cornell::glossy),
    plain("cornell_env", "Cornell box without ceiling and front wall under a sky with a small sun", cornell::env),
    plain("cornell_spheres", "Cornell box with a mirror and a glass sphere, its area light", cornell::spheres),
    plain(
        "cornell_mirrors",
        "Cornell box with a mirror sphere and a mirror as back wall, its area light",
        cornell::mirrors,
    ),
    plain("cornell_water", "Cornell box with water that throws a lamp's caustic on the back wall", cornell::water),
    plain("corner_spikes", "point light 2 cm from a wall in a corner with small objects", spikes::scene),
    known("furnace", "box that emits 1/2 and reflects 1/2", analytic::furnace, analytic::furnace_answer),
    known(
        "furnace_sphere",
        "sphere that emits 1/2 and reflects 1/2, from inside",
        analytic::furnace_sphere,
        analytic::furnace_answer,
    ),
    known(
        "integrating_sphere",
        "sphere of albedo 1/2 around a point light, from inside",
        analytic::integrating_sphere,
        analytic::integrating_sphere_answer,
    ),
    known(
        "white_furnace",
        "white sphere under a sky of radiance 1: invisible",
        analytic::white_furnace,
        analytic::white_furnace_answer,
    ),
    known(
        "glossy_furnace",
        "rough mirror (GGX, alpha 1/2) under a sky of radiance 1",
        analytic::glossy_furnace,
        analytic::glossy_furnace_answer,
    ),
    known("occluder", "point light, black square and its shadow", analytic::occluder, analytic::occluder_answer),
    known(
        "shading_normals",
        "floor with leaning shading normals in sunlight",
        analytic::shading_normals,
        analytic::shading_normals_answer,
    ),
    known(
        "single_triangle",
        "one triangle and a point light",
        analytic::single_triangle,
        analytic::single_triangle_answer,
    ),
    plain("phong_sphere", "sphere of 96 triangles as it is, and rounded by Phong tessellation", refined::phong_sphere),
    plain("sea", "sea with a jetty in sunlight, displaced by waves that move (--at, --frames)", refined::sea),
    plain("terrain", "hills in sunlight, displaced by noise, finer towards the camera", refined::terrain),
    Entry {
        name: "displaced_room",
        about: "closed room with rough walls; displaced_room:N has about N triangles, else 60000",
        make: Make::Counted(displaced_room::scene, 60_000),
        answer: None,
    },
    Entry {
        name: "emitter_hall",
        about: "hall with partitions and emissive triangles; emitter_hall:N has N, else 10000, of the same total power",
        make: Make::Counted(many_lights::emitters, 10_000),
        answer: None,
    },
    Entry {
        name: "point_hall",
        about: "the same hall with point lights; point_hall:N has N, else 100000, of the same total power",
        make: Make::Counted(many_lights::points, 100_000),
        answer: None,
    },
];

/// Maximum of the number after a colon.
const MAX_COUNT: u32 = 50_000_000;

/// Returns name and one-line description of every scene.
pub fn names() -> impl Iterator<Item = (&'static str, &'static str)> {
    SCENES.iter().map(|e| (e.name, e.about))
}

/// Makes a scene by its name, without `builtin:`.
///
/// # Errors
/// A name that is not in [`names`], and a number that is out of range or follows a name that takes none, are
/// errors.
pub fn load(name: &str) -> Result<Scene, LoadError> {
    let path = PathBuf::from(format!("builtin:{name}"));
    let (plain, count) = name.split_once(':').map_or((name, None), |(plain, count)| (plain, Some(count)));
    let Some(entry) = SCENES.iter().find(|e| e.name == plain) else {
        let known: Vec<&str> = names().map(|(name, _)| name).collect();
        return Err(LoadError::new(path, format!("is not a built-in scene; there are {}", known.join(", "))));
    };
    let scene = match (&entry.make, count) {
        (Make::Plain(make), None) => make(),
        (Make::Plain(_), Some(_)) => return Err(LoadError::new(path, format!("`{plain}` takes no number"))),
        (Make::Counted(make, missing), None) => make(*missing),
        (Make::Counted(make, _), Some(text)) => match text.parse::<u32>() {
            Ok(count) if (1..=MAX_COUNT).contains(&count) => make(count),
            _ => return Err(LoadError::new(path, format!("`{text}` is not a number from 1 to {MAX_COUNT}"))),
        },
    };
    Ok(Scene { name: path.display().to_string(), ..scene })
}

/// Returns the analytic radiance at an image position, (0, 0) in the upper left corner and (1, 1) in the
/// lower right one.
///
/// `bounces` counts indirect bounces; `None` means all. Returns `None` for a scene without an analytic
/// solution. All channels are equal.
#[must_use]
pub fn answer(name: &str, bounces: Option<u32>, at: Vec2) -> Option<f64> {
    let entry = SCENES.iter().find(|e| e.name == name)?;
    Some(entry.answer?(bounces, at))
}

/// Returns four corners, counter-clockwise seen from the front, as two triangles that share the first and the
/// third.
fn quad(corners: [Vec3; 4]) -> Mesh {
    Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

/// Returns a block from y = `bottom` to `top` over four corners of its floor plan; every face has its own
/// vertices.
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

/// PCG's output function as a hash (Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020).
fn hash(key: u32) -> u32 {
    let state = key.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = (state >> (state >> 28).wrapping_add(4) ^ state).wrapping_mul(277_803_737);
    word >> 22 ^ word
}

fn vec3(x: f64, y: f64, z: f64) -> Vec3 {
    glam::DVec3::new(x, y, z).as_vec3()
}

/// Adds a mesh with an identity transform, and smooth normals if it has none.
fn add(scene: &mut Scene, name: &str, material: usize, mut mesh: Mesh) {
    if mesh.normals.is_empty() {
        mesh.normals = smooth_normals(&mesh.positions, &mesh.triangles);
    }
    name.clone_into(&mut mesh.name);
    add_as_is(scene, material, mesh);
}

/// Adds a mesh with an identity transform, flat-shaded if it has no normals.
fn add_as_is(scene: &mut Scene, material: usize, mut mesh: Mesh) {
    mesh.material = material;
    scene.instances.push(Instance { mesh: scene.meshes.len(), world_from_local: Affine3A::IDENTITY });
    scene.meshes.push(mesh);
}

/// Returns a pinhole camera that looks from one point to another with +Y up; `fov` is the horizontal angle in
/// degrees.
fn camera(eye: [f64; 3], target: [f64; 3], fov: f64) -> Camera {
    let [eye, target] = [eye, target].map(glam::DVec3::from);
    let back = (eye - target).normalize();
    let right = glam::DVec3::Y.cross(back).normalize();
    let [x, y, z, w] = [right, back.cross(right), back, eye].map(|v| v.as_vec3a());
    Camera {
        name: "camera".to_owned(),
        world_from_camera: Affine3A::from_cols(x, y, z, w),
        projection: Projection::Perspective { fov: fov.to_radians() as f32, axis: FovAxis::X },
        lens: None,
        film_size: Some((512, 512)),
    }
}
