//! Primitives to meshes: attributes, topology, morph targets, skins.

use std::collections::HashMap;

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Mat4, Vec2, Vec3, Vec4};

use super::accessor::Accessor;
use super::file::File;
use crate::scene::animation::{Deformation, MorphTarget, Skin};
use crate::scene::{LoadError, Mesh};

/// Most triangle corners of one file; beyond it the file is refused rather than expanded.
const MAX_CORNERS: usize = 1 << 27;

/// Reads a skin: its joints' nodes and inverse bind matrices.
pub(super) fn skin(file: &File, skin: &json::Skin, place: &str) -> Result<Skin, LoadError> {
    let inverse = match skin.inverse_bind_matrices {
        Some(index) => Some(Accessor::open(file, index, place, &[16])?),
        None => None,
    };
    if let Some(inverse) = &inverse
        && inverse.count < skin.joints.len()
    {
        let cause = format!("{} inverse bind matrices for {} joints", inverse.count, skin.joints.len());
        return Err(file.error(place, cause));
    }
    let mut joints = Vec::with_capacity(skin.joints.len());
    for (i, &joint) in skin.joints.iter().enumerate() {
        file.get(joint, place, "nodes")?;
        let bind = inverse.as_ref().map_or(Mat4::IDENTITY, |a| Mat4::from_cols_array(&a.floats(i, 0.0)));
        joints.push((joint.value(), bind));
    }
    Ok(Skin { joints })
}

/// What of a primitive's deformation is read.
#[derive(Clone, Copy)]
pub(super) struct Wanted<'a> {
    /// Morph targets whose weight is not zero; without weights, all.
    pub weights: Option<&'a [f32]>,
    /// The number of joints that vertices may follow, if they follow any.
    pub joints: Option<usize>,
}

/// Counts what a file expands to, over all of its meshes.
#[derive(Default)]
pub(super) struct Budget {
    corners: usize,
}

/// The attribute of a primitive.
pub(super) fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<Index<json::Accessor>> {
    primitive.attributes.get(&Checked::Valid(semantic)).copied()
}

/// Loads a primitive, and how its vertices move; none where it has no triangles, with the reason among the warnings.
pub(super) fn load(
    file: &File,
    primitive: &Primitive,
    place: &str,
    wanted: Wanted<'_>,
    budget: &mut Budget,
    warnings: &mut Vec<String>,
) -> Result<Option<(Mesh, Deformation)>, LoadError> {
    let open = |semantic: Semantic, lanes: &[usize]| {
        let name = semantic.to_string();
        attribute(primitive, semantic)
            .map(|index| Accessor::open(file, index, &format!("{place}.attributes.{name}"), lanes))
            .transpose()
    };
    let Checked::Valid(mode) = primitive.mode else {
        return Err(file.error(place, "unknown mode"));
    };
    if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
        warnings.push("points and lines have no surface: they are left out".to_owned());
        return Ok(None);
    }
    let Some(positions) = open(Semantic::Positions, &[3])? else {
        warnings.push(format!("{place} has no POSITION: it is left out"));
        return Ok(None);
    };

    // Topology, and which vertices it needs.
    let indices = match primitive.indices {
        Some(index) => Some(read_indices(file, index, place, positions.count)?),
        None => None,
    };
    let corners = indices.as_ref().map_or(positions.count, Vec::len);
    budget.corners += corners.max(1) * if mode == Mode::Triangles { 1 } else { 3 };
    if budget.corners > MAX_CORNERS {
        return Err(file.error(place, format!("the file expands to more than {MAX_CORNERS} triangle corners")));
    }
    let index = |i: usize| indices.as_ref().map_or(i as u32, |list| list[i]);
    let mut triangles: Vec<[u32; 3]> = match mode {
        Mode::TriangleStrip => {
            (2..corners).map(|i| if i % 2 == 0 { [i - 2, i - 1, i] } else { [i - 1, i - 2, i] }.map(index)).collect()
        }
        Mode::TriangleFan => (2..corners).map(|i| [i - 1, i, 0].map(index)).collect(),
        _ => (0..corners / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(index)).collect(),
    };
    if mode == Mode::Triangles && !corners.is_multiple_of(3) {
        warnings.push(format!("{place} ends with an incomplete triangle: it is left out"));
    }
    if triangles.is_empty() {
        warnings.push(format!("{place} has no complete triangle: it is left out"));
        return Ok(None);
    }
    let vertices = used_vertices(&mut triangles, positions.count);

    // Attributes.
    let same_count = |accessor: &Accessor| {
        if accessor.count == positions.count {
            return Ok(());
        }
        let cause = format!("{} elements, but POSITION has {}", accessor.count, positions.count);
        Err(file.error(&accessor.place, format!("{cause} (asked for by {place})")))
    };
    let mut mesh = Mesh { triangles, ..Mesh::default() };
    mesh.positions = vertices.iter().map(|&v| Vec3::from(positions.floats::<3>(v as usize, 0.0))).collect();
    if let Some(normals) = open(Semantic::Normals, &[3])? {
        same_count(&normals)?;
        mesh.normals = vertices.iter().map(|&v| Vec3::from(normals.floats::<3>(v as usize, 0.0))).collect();
        // glTF 2.0, 3.7.2.1: tangents of a file without normals are to be ignored.
        if let Some(tangents) = open(Semantic::Tangents, &[4])? {
            same_count(&tangents)?;
            mesh.tangents = vertices.iter().map(|&v| Vec4::from(tangents.floats::<4>(v as usize, 1.0))).collect();
        }
    }
    for set in 0..2 {
        if let Some(uvs) = open(Semantic::TexCoords(set), &[2])? {
            same_count(&uvs)?;
            mesh.uvs[set as usize] = vertices.iter().map(|&v| Vec2::from(uvs.floats::<2>(v as usize, 0.0))).collect();
        }
    }
    if let Some(colors) = open(Semantic::Colors(0), &[3, 4])? {
        same_count(&colors)?;
        mesh.colors = vertices.iter().map(|&v| Vec4::from(colors.floats::<4>(v as usize, 1.0))).collect();
    }

    // Deformation.
    let mut deformation = Deformation::default();
    for (t, target) in primitive.targets.iter().flatten().enumerate() {
        let place = format!("{place}.targets[{t}]");
        let mut delta = |index: Option<Index<json::Accessor>>| -> Result<Vec<Vec3>, LoadError> {
            let Some(index) = index else { return Ok(Vec::new()) };
            let accessor = Accessor::open(file, index, &place, &[3])?;
            same_count(&accessor)?;
            budget.corners += vertices.len();
            if budget.corners > MAX_CORNERS {
                return Err(
                    file.error(&place, format!("the file's morph targets have more than {MAX_CORNERS} offsets"))
                );
            }
            Ok(vertices.iter().map(|&v| Vec3::from(accessor.floats::<3>(v as usize, 0.0))).collect())
        };
        let counts = wanted.weights.is_none_or(|weights| weights.get(t).is_some_and(|&w| w != 0.0));
        deformation.targets.push(match target {
            target if counts => MorphTarget {
                positions: delta(target.positions)?,
                normals: delta(target.normals)?,
                tangents: delta(target.tangents)?,
            },
            _ => MorphTarget::default(),
        });
    }
    if let Some(joint_count) = wanted.joints {
        let mut sets = Vec::new();
        while let Some(joints) = open(Semantic::Joints(sets.len() as u32), &[4])? {
            let Some(weights) = open(Semantic::Weights(sets.len() as u32), &[4])? else {
                return Err(file.error(place, format!("has JOINTS_{0} without WEIGHTS_{0}", sets.len())));
            };
            same_count(&joints)?;
            same_count(&weights)?;
            if !joints.is_unsigned() {
                return Err(file.error(&joints.place, "joints have to be unsigned integers"));
            }
            sets.push((joints, weights));
        }
        read_joints(file, &mut deformation, &vertices, &sets, joint_count)?;
    }
    Ok(Some((mesh, deformation)))
}

fn read_indices(
    file: &File,
    index: Index<json::Accessor>,
    place: &str,
    vertices: usize,
) -> Result<Vec<u32>, LoadError> {
    let accessor = Accessor::open(file, index, &format!("{place}.indices"), &[1])?;
    if !accessor.is_unsigned() {
        return Err(file.error(accessor.place, "indices have to be unsigned integers"));
    }
    if accessor.count > MAX_CORNERS {
        return Err(file.error(accessor.place, format!("more than {MAX_CORNERS} indices")));
    }
    (0..accessor.count)
        .map(|i| match accessor.integer(i, 0) {
            index if (index as usize) < vertices => Ok(index),
            index => {
                let cause = format!("index {index} at position {i} is past the {vertices} vertices of {place}");
                Err(file.error(&accessor.place, cause))
            }
        })
        .collect()
}

/// The vertices to load, in order; where few are used, as when many primitives share one large accessor, only those, with
/// the triangles renumbered.
fn used_vertices(triangles: &mut [[u32; 3]], count: usize) -> Vec<u32> {
    if triangles.len() * 6 >= count {
        return (0..count as u32).collect();
    }
    let mut vertices = Vec::new();
    let mut renumbered = HashMap::new();
    for index in triangles.iter_mut().flatten() {
        *index = *renumbered.entry(*index).or_insert_with(|| {
            vertices.push(*index);
            vertices.len() as u32 - 1
        });
    }
    vertices
}

/// Reads the joints that each vertex follows, with their weights.
fn read_joints(
    file: &File,
    deformation: &mut Deformation,
    vertices: &[u32],
    sets: &[(Accessor<'_>, Accessor<'_>)],
    joint_count: usize,
) -> Result<(), LoadError> {
    for &vertex in vertices {
        for (joints, weights) in sets {
            let weights: [f32; 4] = weights.floats(vertex as usize, 0.0);
            for (lane, weight) in weights.into_iter().enumerate().filter(|&(_, w)| w != 0.0) {
                let joint = joints.integer(vertex as usize, lane);
                if joint as usize >= joint_count {
                    let cause = format!("vertex {vertex} follows joint {joint} of {joint_count}");
                    return Err(file.error(&joints.place, cause));
                }
                deformation.joints.push((joint, weight));
            }
        }
        deformation.joint_ends.push(deformation.joints.len() as u32);
    }
    Ok(())
}
