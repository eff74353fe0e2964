//! Primitives to meshes: attributes, topology, morph targets, skins.

use std::collections::HashMap;

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Affine3A, Mat3A, Mat4, Vec2, Vec3, Vec3A, Vec4};

use super::accessor::Accessor;
use super::file::File;
use crate::scene::{LoadError, Mesh};

/// Most triangle corners of one file; beyond it the file is refused rather than expanded.
const MAX_CORNERS: usize = 1 << 27;

/// The joints of a skin in the pose that the nodes have.
pub(super) struct Skin {
    /// World from bind pose, one for each joint.
    matrices: Vec<Mat4>,
}

impl Skin {
    /// Joint matrices: placement of the joint's node times its inverse bind matrix.
    pub fn new(file: &File, skin: &json::Skin, place: &str, world: &[Affine3A]) -> Result<Self, LoadError> {
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
        let mut matrices = Vec::with_capacity(skin.joints.len());
        for (i, &joint) in skin.joints.iter().enumerate() {
            file.get(joint, place, "nodes")?;
            let bind = inverse.as_ref().map_or(Mat4::IDENTITY, |a| Mat4::from_cols_array(&a.floats(i, 0.0)));
            matrices.push(Mat4::from(world[joint.value()]) * bind);
        }
        Ok(Self { matrices })
    }
}

/// What turns a primitive's vertices into the ones that are shown.
#[derive(Clone, Copy)]
pub(super) struct Pose<'a> {
    /// Weights of the morph targets; missing ones are zero.
    pub weights: &'a [f32],
    /// The skin, which takes vertices to the world.
    pub skin: Option<&'a Skin>,
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

/// Loads a primitive in a pose; none where it has no triangles, with the reason among the warnings.
pub(super) fn load(
    file: &File,
    primitive: &Primitive,
    place: &str,
    pose: Pose<'_>,
    budget: &mut Budget,
    warnings: &mut Vec<String>,
) -> Result<Option<Mesh>, LoadError> {
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

    // Pose.
    for (t, (target, &weight)) in primitive.targets.iter().flatten().zip(pose.weights).enumerate() {
        if weight == 0.0 {
            continue;
        }
        let place = format!("{place}.targets[{t}]");
        let delta = |index: Option<Index<json::Accessor>>| -> Result<Option<Accessor<'_>>, LoadError> {
            let accessor = index.map(|index| Accessor::open(file, index, &place, &[3])).transpose()?;
            accessor.as_ref().map(&same_count).transpose()?;
            Ok(accessor)
        };
        let at = |a: &Accessor, v: u32| weight * Vec3::from(a.floats::<3>(v as usize, 0.0));
        if let Some(a) = delta(target.positions)? {
            mesh.positions.iter_mut().zip(&vertices).for_each(|(p, &v)| *p += at(&a, v));
        }
        if let Some(a) = delta(target.normals)? {
            mesh.normals.iter_mut().zip(&vertices).for_each(|(n, &v)| *n += at(&a, v));
        }
        if let Some(a) = delta(target.tangents)? {
            mesh.tangents.iter_mut().zip(&vertices).for_each(|(t, &v)| *t += at(&a, v).extend(0.0));
        }
    }
    if let Some(skin) = pose.skin {
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
        skin_mesh(file, &mut mesh, &vertices, &sets, skin)?;
    }
    for normal in &mut mesh.normals {
        *normal = normal.normalize_or_zero();
    }
    for tangent in &mut mesh.tangents {
        *tangent = tangent.truncate().normalize_or_zero().extend(if tangent.w < 0.0 { -1.0 } else { 1.0 });
    }
    Ok(Some(mesh))
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

/// Blends each vertex by its joints' matrices, which takes it to the world.
fn skin_mesh(
    file: &File,
    mesh: &mut Mesh,
    vertices: &[u32],
    sets: &[(Accessor<'_>, Accessor<'_>)],
    skin: &Skin,
) -> Result<(), LoadError> {
    let mut mirrored = vec![false; mesh.positions.len()];
    for (i, &vertex) in vertices.iter().enumerate() {
        let (mut blend, mut total) = (Mat4::ZERO, 0.0);
        for (joints, weights) in sets {
            let weights: [f32; 4] = weights.floats(vertex as usize, 0.0);
            for (lane, weight) in weights.into_iter().enumerate().filter(|&(_, w)| w != 0.0) {
                let joint = joints.integer(vertex as usize, lane) as usize;
                let matrix = skin.matrices.get(joint).ok_or_else(|| {
                    let cause = format!("vertex {vertex} follows joint {joint} of {}", skin.matrices.len());
                    file.error(&joints.place, cause)
                })?;
                blend += *matrix * weight;
                total += weight;
            }
        }
        // A vertex that follows no joint stays in its bind pose.
        let blend = if total == 0.0 { Mat4::IDENTITY } else { blend * (1.0 / total) };
        mesh.positions[i] = blend.transform_point3(mesh.positions[i]);
        let linear = Mat3A::from_mat4(blend);
        mirrored[i] = linear.determinant() < 0.0;
        if let Some(normal) = mesh.normals.get_mut(i) {
            let cofactor = Mat3A::from_cols(
                linear.y_axis.cross(linear.z_axis),
                linear.z_axis.cross(linear.x_axis),
                linear.x_axis.cross(linear.y_axis),
            );
            *normal = Vec3::from(cofactor * Vec3A::from(*normal)) * if mirrored[i] { -1.0 } else { 1.0 };
        }
        if let Some(tangent) = mesh.tangents.get_mut(i) {
            let w = if mirrored[i] { -tangent.w } else { tangent.w };
            *tangent = Vec3::from(linear * Vec3A::from(tangent.truncate())).extend(w);
        }
    }
    for triangle in &mut mesh.triangles {
        if mirrored[triangle[0] as usize] {
            triangle.swap(1, 2);
        }
    }
    Ok(())
}
