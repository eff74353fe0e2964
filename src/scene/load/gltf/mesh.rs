//! Primitives to meshes: attributes, topology, morph targets, skins.

use std::collections::HashMap;

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Mat4, Vec2, Vec3, Vec4};

use super::accessor::Accessor;
use super::file::File;
use crate::scene::animation::{Deformation, MorphTarget, Skin};
use crate::scene::check::MAX_TRIANGLES;
use crate::scene::load::meshes::{face_along_normals, faces_against_normals};
use crate::scene::load::strokes;
use crate::scene::{LoadError, Mesh};

/// Maximum number of triangle corners of one file. A larger file is an error, so that a small file cannot
/// allocate arbitrary memory.
pub(super) const MAX_CORNERS: usize = 1 << 27;

/// Maximum number of instances of one file.
pub(super) const MAX_INSTANCES: usize = 1 << 22;

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

/// The parts of a primitive's deformation to read.
#[derive(Clone, Copy)]
pub(super) struct Wanted<'a> {
    /// Morph weights at rest: targets of weight 0 are skipped; without weights, all targets are read.
    pub weights: Option<&'a [f32]>,
    /// Number of joints of the skin, if there is one.
    pub joints: Option<usize>,
}

/// Total of the data that a file expands to, over all of its meshes and instances.
#[derive(Default)]
pub(super) struct Budget {
    corners: usize,
    instances: usize,
    triangles: usize,
    /// True if the file has points and lines alone.
    strokes: Option<bool>,
}

impl Budget {
    /// True if points and lines are drawn: the file has nothing else, and these neither move nor are compressed.
    fn draws_strokes(&mut self, file: &File, primitive: &Primitive, wanted: Wanted<'_>) -> bool {
        let moves = wanted.joints.is_some() || primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty());
        let positions = attribute(primitive, Semantic::Positions).and_then(|i| file.root.accessors.get(i.value()));
        let is_there = positions.is_some_and(|accessor| accessor.buffer_view.is_some() || accessor.sparse.is_some());
        let alone = || {
            let mut primitives = file.root.meshes.iter().flat_map(|mesh| &mesh.primitives);
            primitives.all(|primitive| matches!(primitive.mode, Checked::Valid(mode) if is_stroke(mode)))
        };
        !moves && is_there && *self.strokes.get_or_insert_with(alone)
    }

    /// Counts instances of some triangles; more than the file may have are an error, whose cause is returned.
    pub fn instantiate(&mut self, triangles: usize, instances: usize) -> Result<(), String> {
        self.instances = self.instances.saturating_add(instances);
        self.triangles = self.triangles.saturating_add(triangles.saturating_mul(instances));
        match (self.instances, self.triangles) {
            (count, _) if count > MAX_INSTANCES => {
                Err(format!("the file has more than {MAX_INSTANCES} instances: show fewer of them"))
            }
            (_, count) if count > MAX_TRIANGLES => {
                Err(format!("the file's instances have more than {MAX_TRIANGLES} triangles: show fewer of them"))
            }
            _ => Ok(()),
        }
    }
}

/// Returns the accessor of a primitive's attribute.
pub(super) fn attribute(primitive: &Primitive, semantic: Semantic) -> Option<Index<json::Accessor>> {
    primitive.attributes.get(&Checked::Valid(semantic)).copied()
}

/// A primitive's POSITION accessor and the vertices to read, which all its attributes share.
struct Source<'a> {
    file: &'a File<'a>,
    primitive: &'a Primitive,
    place: &'a str,
    positions: Accessor<'a>,
    vertices: Vec<u32>,
}

/// Opens the accessor of a primitive's attribute, if there is one.
fn open<'a>(
    file: &'a File,
    primitive: &Primitive,
    place: &str,
    semantic: Semantic,
    lanes: &[usize],
) -> Result<Option<Accessor<'a>>, LoadError> {
    let name = semantic.to_string();
    attribute(primitive, semantic)
        .map(|index| Accessor::open(file, index, &format!("{place}.attributes.{name}"), lanes))
        .transpose()
}

/// Counts the corners of a mesh by what its accessors say, before any is read; too many in the file are an error. What cannot be
/// read, or is too large alone, has an error of its own.
pub(super) fn count_corners(
    file: &File,
    mesh: &json::Mesh,
    index: usize,
    budget: &mut Budget,
) -> Result<(), LoadError> {
    for (p, primitive) in mesh.primitives.iter().enumerate() {
        let per_element = match primitive.mode {
            Checked::Valid(Mode::Triangles) => 1,
            Checked::Valid(Mode::TriangleStrip | Mode::TriangleFan) => 3,
            _ => continue,
        };
        let Some(positions) = attribute(primitive, Semantic::Positions) else { continue };
        let accessor = file.root.accessors.get(primitive.indices.unwrap_or(positions).value());
        let count = accessor.map_or(0, |a| a.count.0 as usize);
        budget.corners += if count > MAX_CORNERS { 0 } else { count.max(1) * per_element };
        if budget.corners > MAX_CORNERS {
            let cause = format!("the file expands to more than {MAX_CORNERS} triangle corners");
            return Err(file.error(format!("meshes[{index}].primitives[{p}]"), cause));
        }
    }
    Ok(())
}

/// Loads a primitive and its deformation; returns `None`, with a warning, for a primitive without triangles.
pub(super) fn load(
    file: &File,
    primitive: &Primitive,
    place: &str,
    wanted: Wanted<'_>,
    budget: &mut Budget,
    warnings: &mut Vec<String>,
) -> Result<Option<(Mesh, Deformation)>, LoadError> {
    let Checked::Valid(mode) = primitive.mode else {
        return Err(file.error(place, "unknown mode"));
    };
    let is_stroke = is_stroke(mode);
    if is_stroke && !budget.draws_strokes(file, primitive, wanted) {
        warnings.push("points and lines have no surface: they are left out".to_owned());
        return Ok(None);
    }
    let Some(positions) = open(file, primitive, place, Semantic::Positions, &[3])? else {
        warnings.push(format!("{place} has no POSITION: it is left out"));
        return Ok(None);
    };
    if is_stroke {
        let mesh = strokes(file, primitive, mode, place, &positions, budget, warnings)?;
        return Ok(mesh.map(|mesh| (mesh, Deformation::default())));
    }
    let mut triangles = read_triangles(file, primitive, mode, place, positions.count, warnings)?;
    if triangles.is_empty() {
        warnings.push(format!("{place} has no complete triangle: it is left out"));
        return Ok(None);
    }
    let vertices = used_vertices(&mut triangles, positions.count);
    let source = Source { file, primitive, place, positions, vertices };
    let mut mesh = source.mesh(triangles)?;
    // Of a skin, joints may mirror the mesh.
    if wanted.joints.is_none() && faces_against_normals(&mesh) {
        face_along_normals(&mut mesh);
        warnings.push(format!("all triangles of {place} face against their normals: they are turned"));
    }
    let deformation = source.deformation(wanted, budget)?;
    Ok(Some((mesh, deformation)))
}

/// True for points and lines.
fn is_stroke(mode: Mode) -> bool {
    matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip)
}

/// Returns a primitive's points as balls and its lines as tubes; none if it has none.
fn strokes(
    file: &File,
    primitive: &Primitive,
    mode: Mode,
    place: &str,
    positions: &Accessor,
    budget: &mut Budget,
    warnings: &mut Vec<String>,
) -> Result<Option<Mesh>, LoadError> {
    budget.corners = budget.corners.saturating_add(positions.count);
    if budget.corners > MAX_CORNERS {
        return Err(file.error(place, format!("the file has more than {MAX_CORNERS} points")));
    }
    let places = match primitive.indices {
        Some(index) => read_indices(file, index, place, positions.count)?,
        None => (0..positions.count as u32).collect(),
    };
    let points: Vec<Vec3> = places.iter().map(|&v| positions.floats::<3>(v as usize, 0.0).into()).collect();
    let colors = match open(file, primitive, place, Semantic::Colors(0), &[3, 4])? {
        Some(colors) if colors.count == positions.count => {
            places.iter().map(|&v| colors.floats::<4>(v as usize, 1.0).into()).collect()
        }
        _ => Vec::new(),
    };
    let count = points.len() as u32;
    let lines: Vec<[u32; 2]> = match mode {
        Mode::Lines => (0..count / 2).map(|i| [2 * i, 2 * i + 1]).collect(),
        Mode::LineStrip => (1..count).map(|i| [i - 1, i]).collect(),
        Mode::LineLoop => (0..count).map(|i| [i, (i + 1) % count]).collect(),
        _ => Vec::new(),
    };
    let (mesh, said) = match mode {
        Mode::Points => strokes::balls(&points, &colors),
        _ => strokes::tubes(&points, &lines, &colors),
    };
    budget.corners += 3 * mesh.triangles.len();
    if mesh.triangles.is_empty() {
        return Ok(None);
    }
    warnings.push(said);
    Ok(Some(mesh))
}

/// Reads a primitive's triangles: its indices, if any, in the topology of its mode.
fn read_triangles(
    file: &File,
    primitive: &Primitive,
    mode: Mode,
    place: &str,
    vertices: usize,
    warnings: &mut Vec<String>,
) -> Result<Vec<[u32; 3]>, LoadError> {
    let indices = match primitive.indices {
        Some(index) => Some(read_indices(file, index, place, vertices)?),
        None => None,
    };
    let corners = indices.as_ref().map_or(vertices, Vec::len);
    let index = |i: usize| indices.as_ref().map_or(i as u32, |list| list[i]);
    let triangles = match mode {
        Mode::TriangleStrip => {
            (2..corners).map(|i| if i % 2 == 0 { [i - 2, i - 1, i] } else { [i - 1, i - 2, i] }.map(index)).collect()
        }
        Mode::TriangleFan => (2..corners).map(|i| [i - 1, i, 0].map(index)).collect(),
        _ => (0..corners / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2].map(index)).collect(),
    };
    if mode == Mode::Triangles && !corners.is_multiple_of(3) {
        warnings.push(format!("{place} ends with an incomplete triangle: it is left out"));
    }
    Ok(triangles)
}

impl<'a> Source<'a> {
    fn open(&self, semantic: Semantic, lanes: &[usize]) -> Result<Option<Accessor<'a>>, LoadError> {
        open(self.file, self.primitive, self.place, semantic, lanes)
    }

    /// Checks that an attribute has one element per vertex.
    fn check_count(&self, accessor: &Accessor<'_>) -> Result<(), LoadError> {
        let (count, place) = (self.positions.count, self.place);
        if accessor.count == count {
            return Ok(());
        }
        let cause = format!("{} elements, but POSITION has {count}", accessor.count);
        Err(self.file.error(&accessor.place, format!("{cause} (referred to by {place})")))
    }

    /// Reads an accessor at the vertices in use.
    fn read<const N: usize, T: From<[f32; N]>>(&self, accessor: &Accessor<'_>, fill: f32) -> Vec<T> {
        self.vertices.iter().map(|&v| T::from(accessor.floats::<N>(v as usize, fill))).collect()
    }

    /// Reads the attributes of the vertices in use.
    fn mesh(&self, triangles: Vec<[u32; 3]>) -> Result<Mesh, LoadError> {
        let mut mesh = Mesh { triangles, ..Mesh::default() };
        mesh.positions = self.read::<3, Vec3>(&self.positions, 0.0);
        if let Some(normals) = self.open(Semantic::Normals, &[3])? {
            self.check_count(&normals)?;
            mesh.normals = self.read::<3, Vec3>(&normals, 0.0);
            // glTF 2.0, 3.7.2.1, ignores tangents without normals.
            if let Some(tangents) = self.open(Semantic::Tangents, &[4])? {
                self.check_count(&tangents)?;
                mesh.tangents = self.read::<4, Vec4>(&tangents, 1.0);
            }
        }
        for set in 0..2 {
            if let Some(uvs) = self.open(Semantic::TexCoords(set), &[2])? {
                self.check_count(&uvs)?;
                mesh.uvs[set as usize] = self.read::<2, Vec2>(&uvs, 0.0);
            }
        }
        if let Some(colors) = self.open(Semantic::Colors(0), &[3, 4])? {
            self.check_count(&colors)?;
            mesh.colors = self.read::<4, Vec4>(&colors, 1.0);
        }
        Ok(mesh)
    }

    /// Reads the morph targets and joints that `wanted` selects.
    fn deformation(&self, wanted: Wanted<'_>, budget: &mut Budget) -> Result<Deformation, LoadError> {
        let mut deformation = Deformation::default();
        for (t, target) in self.primitive.targets.iter().flatten().enumerate() {
            let place = format!("{}.targets[{t}]", self.place);
            let mut delta = |index: Option<Index<json::Accessor>>| self.read_delta(index, &place, budget);
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
            let sets = self.open_joint_sets()?;
            read_joints(self.file, &mut deformation, &self.vertices, &sets, joint_count)?;
        }
        Ok(deformation)
    }

    /// Reads the offsets of one attribute of a morph target; a missing accessor is an empty list.
    fn read_delta(
        &self,
        index: Option<Index<json::Accessor>>,
        place: &str,
        budget: &mut Budget,
    ) -> Result<Vec<Vec3>, LoadError> {
        let Some(index) = index else { return Ok(Vec::new()) };
        let accessor = Accessor::open(self.file, index, place, &[3])?;
        self.check_count(&accessor)?;
        budget.corners += self.vertices.len();
        if budget.corners > MAX_CORNERS {
            let cause = format!("the file's morph targets have more than {MAX_CORNERS} offsets");
            return Err(self.file.error(place, cause));
        }
        Ok(self.read::<3, Vec3>(&accessor, 0.0))
    }

    /// Opens the accessors of all JOINTS_n and WEIGHTS_n attributes.
    fn open_joint_sets(&self) -> Result<Vec<(Accessor<'a>, Accessor<'a>)>, LoadError> {
        let mut sets = Vec::new();
        while let Some(joints) = self.open(Semantic::Joints(sets.len() as u32), &[4])? {
            let Some(weights) = self.open(Semantic::Weights(sets.len() as u32), &[4])? else {
                return Err(self.file.error(self.place, format!("has JOINTS_{0} without WEIGHTS_{0}", sets.len())));
            };
            self.check_count(&joints)?;
            self.check_count(&weights)?;
            if !joints.is_unsigned() {
                return Err(self.file.error(&joints.place, "joints have to be unsigned integers"));
            }
            sets.push((joints, weights));
        }
        Ok(sets)
    }
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

/// Returns the vertices to load, in order. If many primitives share one large accessor, only the vertices in
/// use are loaded and the triangles are renumbered.
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

/// Reads the joints and weights of each vertex.
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
