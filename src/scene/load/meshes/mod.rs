//! Meshes, as files of their own and as parts of scenes: Wavefront OBJ with its materials, PLY, and STL.
//!
//! As scenes they have neither cameras nor, mostly, light, which staging adds. Their surfaces have two sides, since programs
//! wind triangles either way.

use std::path::Path;

use glam::{Affine3A, Vec3};

use super::files::Files;
use crate::scene::model::normals::smooth_normals;
use crate::scene::model::tangents;
use crate::scene::model::texture::linear_from_srgb;
use crate::scene::{Instance, LoadError, Material, Mesh, Opacity, Scene, Sides};

mod mtl;
pub(super) mod obj;
pub(super) mod ply;
mod stl;

/// Reflectance of surfaces whose file says nothing of it.
const GREY: f32 = 0.6;

/// Loads an OBJ file with the materials and textures that it refers to. What it refers to and is not there is a warning.
///
/// # Errors
/// A file that is missing or malformed is an error with its line.
pub fn load_obj(path: &Path, files: &dyn Files) -> Result<Scene, LoadError> {
    let obj::Parsed { mut mesh, materials, libraries } = obj::parse(path, &files.read(path)?)?;
    // v points up in the file.
    mesh.uvs[0].iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    face_along_normals(&mut mesh);
    decode_colors(&mut mesh);
    let mut scene = Scene::default();
    let mut library = mtl::Library::new(reflectance_without_material(&mesh));
    for name in &libraries {
        library.read(path, name, files, &mut scene)?;
    }
    for (name, triangles) in obj::parts(&mesh, &materials) {
        let material = library.material(name, files, &mut scene);
        let part = if triangles.len() == mesh.triangles.len() { mesh.clone() } else { subset(&mesh, &triangles) };
        add(&mut scene, Mesh { name: name.to_owned(), material, ..part });
    }
    let invisible = |m: &Material| m.opacity == Some(Opacity::Blended { value: 0.0.into() });
    if !scene.materials.is_empty() && scene.materials.iter().all(invisible) {
        scene.warn("all materials have the opacity 0, as some exporters write it: they are drawn opaque");
        scene.materials.iter_mut().for_each(|material| material.opacity = None);
    }
    Ok(scene)
}

/// Loads a PLY file with its vertex colours. Without normals it is smooth.
///
/// # Errors
/// A file that is missing or malformed is an error with its place.
pub fn load_ply(path: &Path, files: &dyn Files) -> Result<Scene, LoadError> {
    let mut mesh = ply::parse(path, &files.read(path)?)?;
    if mesh.normals.is_empty() {
        mesh.normals = smooth_normals(&mesh.positions, &mesh.triangles);
    }
    face_along_normals(&mut mesh);
    decode_colors(&mut mesh);
    let mut scene = Scene::default();
    if mesh.triangles.is_empty() && !mesh.positions.is_empty() {
        let points = mesh.positions.len();
        scene.warn(format!(
            "the file has {points} points and no faces, so that there is no surface: make a mesh of them"
        ));
    }
    scene.materials.push(plain("mesh", reflectance_without_material(&mesh)));
    add(&mut scene, mesh);
    Ok(scene)
}

/// Loads an STL file, whose surfaces are flat. Its z axis, along which printers build, points up.
///
/// # Errors
/// A file that is missing or malformed is an error with its place.
pub fn load_stl(path: &Path, files: &dyn Files) -> Result<Scene, LoadError> {
    let mut mesh = stl::parse(path, &files.read(path)?)?;
    mesh.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x, p.z, -p.y));
    let mut scene = Scene::default();
    scene.materials.push(plain("mesh", reflectance_without_material(&mesh)));
    add(&mut scene, mesh);
    Ok(scene)
}

/// Decodes vertex colours, which programs write as they are shown.
fn decode_colors(mesh: &mut Mesh) {
    let decode = |v: f32| linear_from_srgb(v.clamp(0.0, 1.0));
    mesh.colors.iter_mut().for_each(|c| *c = c.truncate().map(decode).extend(c.w));
}

/// Returns the reflectance of surfaces without a material: what vertex colours say of it, or grey.
fn reflectance_without_material(mesh: &Mesh) -> Vec3 {
    Vec3::splat(if mesh.colors.is_empty() { GREY } else { 1.0 })
}

fn plain(name: &str, reflectance: Vec3) -> Material {
    Material { sides: Sides::Two, ..Material::diffuse(name, reflectance) }
}

fn add(scene: &mut Scene, mesh: Mesh) {
    if !mesh.triangles.is_empty() {
        scene.meshes.push(mesh);
        scene.instances.push(Instance { mesh: scene.meshes.len() - 1, world_from_local: Affine3A::IDENTITY });
    }
}

/// Winds triangles so that their fronts are where their normals point. A mesh without normals keeps its winding.
pub(super) fn face_along_normals(mesh: &mut Mesh) {
    for i in 0..mesh.triangles.len() {
        if along_normals(mesh, mesh.triangles[i]) < 0.0 {
            mesh.triangles[i].swap(1, 2);
        }
    }
}

/// Returns true if all triangles face against their normals, and none is degenerate.
pub(super) fn faces_against_normals(mesh: &Mesh) -> bool {
    !mesh.normals.is_empty() && mesh.triangles.iter().all(|triangle| along_normals(mesh, *triangle) < 0.0)
}

/// Returns how far a triangle's front points along its normals; below 0 they are on its back.
fn along_normals(mesh: &Mesh, triangle: [u32; 3]) -> f32 {
    if mesh.normals.is_empty() {
        return 0.0;
    }
    let [a, b, c] = triangle.map(|i| mesh.positions[i as usize]);
    let normal: Vec3 = triangle.map(|i| mesh.normals[i as usize]).iter().sum();
    (b - a).cross(c - a).dot(normal)
}

/// Returns some of a mesh's triangles with the vertices that they use.
pub(super) fn subset(mesh: &Mesh, triangles: &[[u32; 3]]) -> Mesh {
    let mut places = vec![u32::MAX; mesh.positions.len()];
    let mut used: Vec<u32> = Vec::new();
    let mut place = |i: u32| {
        let slot = &mut places[i as usize];
        if *slot == u32::MAX {
            *slot = used.len() as u32;
            used.push(i);
        }
        *slot
    };
    let triangles = triangles.iter().map(|t| t.map(&mut place)).collect();
    let mut part = mesh.clone();
    tangents::select(&mut part, &used);
    Mesh { triangles, ..part }
}
