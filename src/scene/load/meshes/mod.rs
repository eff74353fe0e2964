//! Meshes, as files of their own and as parts of scenes: Wavefront OBJ with its materials, PLY, and STL.
//!
//! As scenes they have neither cameras nor, mostly, light, which staging adds. Their surfaces have two sides, since programs
//! wind triangles either way.

use std::borrow::Cow;
use std::path::Path;

use glam::{Affine2, Affine3A, Vec3};

use super::far;
use super::files::{Files, find};
use crate::scene::model::normals::add_creased_normals;
use crate::scene::model::tangents;
use crate::scene::model::texture::linear_from_srgb;
use crate::scene::{
    Bsdf, Color, Filter, Image, Instance, LoadError, Material, Mesh, Opacity, Scene, Sides, Texture, TextureRef, Wrap,
};

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
    let obj::Parsed { mut mesh, origin, materials, libraries, warnings } =
        obj::parse(path, &in_utf8(files.read(path)?))?;
    // v points up in the file.
    mesh.uvs[0].iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    face_along_normals(&mut mesh);
    decode_colors(&mut mesh);
    let notes = far::said(origin).into_iter().collect();
    let mut scene = Scene { warnings, notes, ..Scene::default() };
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

/// Loads a PLY file with its vertex colours, or with the texture that it names. Without normals it is smooth but for sharp
/// edges.
///
/// # Errors
/// A file that is missing or malformed is an error with its place.
pub fn load_ply(path: &Path, files: &dyn Files) -> Result<Scene, LoadError> {
    let ply::Parsed { mut mesh, origin, texture, warnings } = ply::parse(path, &files.read(path)?)?;
    // v points up in the file.
    mesh.uvs[0].iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    if mesh.normals.is_empty() {
        add_creased_normals(&mut mesh);
    }
    face_along_normals(&mut mesh);
    decode_colors(&mut mesh);
    let notes = far::said(origin).into_iter().collect();
    let mut scene = Scene { warnings, notes, ..Scene::default() };
    let mut material = plain("mesh", reflectance_without_material(&mesh));
    if let Some(name) = texture.filter(|_| !mesh.uvs[0].is_empty())
        && let Some(image) = add_image(&name, path.parent().unwrap_or(Path::new("")), files, &mut scene)
    {
        // Colours of vertices stand for the texture where there is none.
        mesh.colors.clear();
        let texture = Some(texture_of(image, true, &mut scene));
        material.bsdf = Bsdf::Diffuse { reflectance: Color { factor: Vec3::ONE, texture } };
    }
    scene.materials.push(material);
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

/// Returns a text file in UTF-8, without the mark of its encoding: programs of Windows write UTF-16, too.
fn in_utf8(bytes: Cow<'_, [u8]>) -> Cow<'_, [u8]> {
    let decoded = |unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes[2..].as_chunks().0.iter().copied().map(unit).collect();
        Cow::Owned(String::from_utf16_lossy(&units).into_bytes())
    };
    match bytes.get(..3) {
        Some([0xff, 0xfe, _]) => decoded(u16::from_le_bytes),
        Some([0xfe, 0xff, _]) => decoded(u16::from_be_bytes),
        Some([0xef, 0xbb, 0xbf]) => Cow::Owned(bytes[3..].to_vec()),
        _ => bytes,
    }
}

/// Adds an image that a file refers to; none, with a warning, if it is not there or not an image.
fn add_image(name: &str, folder: &Path, files: &dyn Files, scene: &mut Scene) -> Option<usize> {
    let path = find(files, &[folder], name).unwrap_or_else(|| folder.join(name));
    match files.read(&path).map_err(|e| e.cause).and_then(|bytes| Image::decode(&bytes, name)) {
        Ok(image) => {
            scene.images.push(image);
            Some(scene.images.len() - 1)
        }
        Err(cause) => {
            scene.warn(format!("the texture `{name}` is left out: {cause}"));
            None
        }
    }
}

/// Adds a texture that repeats an image.
fn texture_of(image: usize, srgb: bool, scene: &mut Scene) -> TextureRef {
    scene.textures.push(Texture { image, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb });
    TextureRef { texture: scene.textures.len() - 1, uv_set: 0, transform: Affine2::IDENTITY }
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
