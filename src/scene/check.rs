//! Invariants of every scene, independent of its source: indices in range, positions finite, triangle counts
//! bounded.

use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec3, Vec4};

use crate::scene::animation::track::{Factor, Target};
use crate::scene::model::error::LoadError;
use crate::scene::model::geometry::Vertex;
use crate::scene::model::material::Opacity;
use crate::scene::model::memory::{self, mebibytes};
use crate::scene::model::mesh::{Instance, Mesh};
use crate::scene::model::scene::Scene;
use crate::scene::model::texture::{Filter, TextureRef};
use crate::scene::tessellation::refine;

/// Maximum number of triangles of all instances together: 32 bits have to count the corners, with a margin
/// for acceleration structures.
pub(in crate::scene) const MAX_TRIANGLES: usize = 1 << 28;

/// Checks a loader's result and repairs it where possible.
///
/// # Errors
/// Positions that are not finite, indices out of range and too many triangles are errors.
pub fn finish(scene: &mut Scene, path: &Path) -> Result<(), LoadError> {
    for i in 0..scene.meshes.len() {
        check_mesh(scene, i).map_err(|cause| {
            let name = &scene.meshes[i].name;
            LoadError::at(path, format!("mesh {i} `{name}`"), cause)
        })?;
        let repaired = repair(&mut scene.meshes[i]);
        if repaired > 0 {
            let name = &scene.meshes[i].name;
            scene.warn(format!("mesh `{name}`: {repaired} normals, tangents, texture coordinates or colours are not finite: they are replaced"));
        }
    }
    if let Some(rig) = scene.rig.as_mut().filter(|rig| !rig.shapes.is_empty()) {
        Arc::make_mut(rig).shapes.iter_mut().for_each(|shape| _ = repair(&mut shape.base));
    }
    check_instances(scene).map_err(|(i, cause)| LoadError::at(path, format!("instance {i}"), cause))?;
    check_memory(scene, memory::free()).map_err(|cause| LoadError::new(path, cause))?;
    for (i, texture) in scene.textures.iter().enumerate() {
        if texture.image >= scene.images.len() {
            let cause = format!("image {} of {}", texture.image, scene.images.len());
            return Err(LoadError::at(path, format!("texture {i}"), cause));
        }
    }
    if scene.instances.is_empty() {
        scene.warn("the scene has no surface");
    }
    simplify_opacities(scene);
    let black = scene.lights.iter().filter(|light| light.is_black(&scene.patterns)).count();
    if black > 0 {
        scene.warn(format!("{black} of the scene's {} lights have no power: they are ignored", scene.lights.len()));
    }
    let flat = flat_emitters(scene);
    if flat > 0 {
        scene.warn(format!("{flat} emissive triangles have no area: they are ignored"));
    }
    Ok(())
}

fn check_mesh(scene: &Scene, index: usize) -> Result<(), String> {
    let mesh = &scene.meshes[index];
    let count = mesh.positions.len();
    if let Some(v) = mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(format!("vertex {v} is not finite: {}", mesh.positions[v]));
    }
    let lengths = [
        ("normals", mesh.normals.len()),
        ("tangents", mesh.tangents.len()),
        ("uvs", mesh.uvs[0].len()),
        ("uvs of the second set", mesh.uvs[1].len()),
        ("colours", mesh.colors.len()),
    ];
    if let Some((name, length)) = lengths.into_iter().find(|&(_, length)| length != 0 && length != count) {
        return Err(format!("{length} {name} for {count} vertices"));
    }
    if let Some(t) = mesh.triangles.iter().position(|t| t.iter().any(|&i| i as usize >= count)) {
        return Err(format!("triangle {t} refers to vertices {:?} of {count}", mesh.triangles[t]));
    }
    if let Some(tessellation) = &mesh.tessellation {
        tessellation.check()?;
        let displacement = tessellation.displacement.as_ref();
        let maps = scene.height_maps.len();
        if let Some(map) = displacement.and_then(|d| d.height.map()).filter(|&map| map >= maps) {
            return Err(format!("is displaced by height map {map} of {maps}"));
        }
    }
    if mesh.material >= scene.materials.len() {
        return Err(format!("refers to material {} of {}", mesh.material, scene.materials.len()));
    }
    Ok(())
}

/// Replaces non-finite attributes by neutral ones; returns their number.
fn repair(mesh: &mut Mesh) -> usize {
    let mut repaired = 0;
    let mut neutral = |finite: bool| {
        repaired += usize::from(!finite);
        !finite
    };
    mesh.normals.iter_mut().filter(|n| neutral(n.is_finite())).for_each(|n| *n = Vec3::ZERO);
    mesh.tangents.iter_mut().filter(|t| neutral(t.is_finite())).for_each(|t| *t = Vec4::ZERO);
    mesh.uvs.iter_mut().flatten().filter(|t| neutral(t.is_finite())).for_each(|t| *t = Vec2::ZERO);
    mesh.colors.iter_mut().filter(|c| neutral(c.is_finite())).for_each(|c| *c = Vec4::ONE);
    repaired
}

/// Turns blended materials into opaque ones if their alpha is always 1, and into cut-out ones if it is never
/// between 0 and 1. Those whose alpha an animation may change stay as they are.
fn simplify_opacities(scene: &mut Scene) {
    let mut varies = vec![false; scene.materials.len()];
    for mesh in &scene.meshes {
        varies[mesh.material] |= mesh.colors.iter().any(|color| color.w < 1.0);
    }
    let animations = scene.rig.iter().flat_map(|rig| &rig.animations);
    for (target, _) in animations.flat_map(|animation| &animation.tracks) {
        if let Target::Material(material, Factor::BaseColor) = *target {
            varies[material] = true;
        }
    }
    let Scene { materials, textures, images, .. } = scene;
    for (material, varies) in materials.iter_mut().zip(varies) {
        let Some(Opacity::Blended { value }) = material.opacity else { continue };
        if varies {
            continue;
        }
        let texel = |texture: TextureRef, test: &dyn Fn(&[u8; 4]) -> bool| {
            images[textures[texture.texture].image].texels.iter().all(test)
        };
        let is_nearest = |texture: TextureRef| textures[texture.texture].filter == Filter::Nearest;
        let is_opaque =
            value.factor >= 1.0 && value.texture.is_none_or(|(t, c)| texel(t, &|t| t[c as usize & 3] == 255));
        let is_binary = match value.texture {
            None => value.factor <= 0.0,
            Some((t, c)) => value.factor == 1.0 && is_nearest(t) && texel(t, &|t| matches!(t[c as usize & 3], 0 | 255)),
        };
        if is_opaque {
            material.opacity = None;
        } else if is_binary {
            material.opacity = Some(Opacity::CutOut { value, cutoff: 0.5 });
        }
    }
}

/// Counts the triangles of emissive materials with zero area in world space.
fn flat_emitters(scene: &Scene) -> usize {
    let emissive =
        |mesh: &Mesh| scene.materials[mesh.material].emission.is_some_and(|e| e.radiance.factor != Vec3::ZERO);
    let of = |instance: &Instance| {
        let mesh = &scene.meshes[instance.mesh];
        let flat = |t: &&[u32; 3]| {
            let [a, b, c] = t.map(|i| instance.world_from_local.transform_point3(mesh.positions[i as usize]));
            (b - a).cross(c - a).length() == 0.0
        };
        if emissive(mesh) { mesh.triangles.iter().filter(flat).count() } else { 0 }
    };
    scene.instances.iter().map(of).sum()
}

/// Checks that the triangles of all instances fit into the free memory once each has its place in the world.
fn check_memory(scene: &Scene, free: Option<u64>) -> Result<(), String> {
    let meshes = scene.instances.iter().map(|instance| &scene.meshes[instance.mesh]);
    let (vertices, triangles) = meshes.fold((0, 0), |(vertices, triangles), mesh| {
        (vertices + mesh.positions.len(), triangles + mesh.triangles.len())
    });
    let of_triangle = size_of::<[u32; 3]>() + size_of::<u32>();
    let bytes = (vertices * size_of::<Vertex>() + triangles * of_triangle) as u64;
    match free.filter(|&free| bytes > free) {
        None => Ok(()),
        Some(free) => Err(format!(
            "its {} instances have {triangles} triangles together, which need {} MiB of memory; {} MiB are free: show fewer \
                 instances, or simpler ones",
            scene.instances.len(),
            mebibytes(bytes),
            mebibytes(free)
        )),
    }
}

/// Returns the world-space bounds; an error holds the instance at fault and the cause.
pub(in crate::scene) fn check_instances(scene: &Scene) -> Result<[Vec3; 2], (usize, String)> {
    let mut bounds: Option<[Vec3; 2]> = None;
    let (mut triangles, mut refined) = (0_usize, 0_u64);
    for (i, instance) in scene.instances.iter().enumerate() {
        let Some(mesh) = scene.meshes.get(instance.mesh) else {
            return Err((i, format!("refers to mesh {} of {}", instance.mesh, scene.meshes.len())));
        };
        triangles += mesh.triangles.len();
        refined += refine::triangles(mesh);
        if refined > refine::MAX_TRIANGLES && mesh.refinement().is_some() {
            let most = refine::MAX_TRIANGLES;
            return Err((
                i,
                format!(
                    "tessellation would make {refined} triangles of the scene, more than {most}: lower the factors"
                ),
            ));
        }
        if triangles > MAX_TRIANGLES {
            return Err((i, format!("the scene has more than {MAX_TRIANGLES} triangles")));
        }
        for (v, &position) in mesh.positions.iter().enumerate() {
            let p = instance.world_from_local.transform_point3(position);
            if !p.is_finite() {
                return Err((i, format!("vertex {v} of mesh `{}` lies at {p} in the world", mesh.name)));
            }
            bounds = Some(bounds.map_or([p; 2], |[low, high]| [low.min(p), high.max(p)]));
        }
    }
    Ok(bounds.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn instances_that_do_not_fit_are_told_before_they_are_placed() {
        let mut scene = builtin::load("single_triangle").unwrap();
        scene.instances = vec![scene.instances[0]; 1000];
        let bytes = 1000 * (3 * size_of::<Vertex>() as u64 + 16);
        assert_eq!((check_memory(&scene, Some(bytes)), check_memory(&scene, None)), (Ok(()), Ok(())));
        let told = check_memory(&scene, Some(bytes - 1)).unwrap_err();
        assert!(
            told.contains("1000 triangles together, which need 1 MiB") && told.contains("1 MiB are free"),
            "{told}"
        );
    }
}
