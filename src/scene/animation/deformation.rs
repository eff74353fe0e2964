//! Deformation of meshes by morph targets and joints (glTF 2.0, 3.7.2.2 and 3.7.3).

use glam::{Mat3A, Mat4, Vec3, Vec3A};

use crate::scene::model::mesh::Mesh;
use crate::scene::model::transform::cofactor;

/// Offsets of a mesh's vertices; each array is empty or has one entry per vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MorphTarget {
    /// Offsets of positions in metres.
    pub positions: Vec<Vec3>,
    /// Offsets of normals.
    pub normals: Vec<Vec3>,
    /// Offsets of tangents, without the sign.
    pub tangents: Vec<Vec3>,
}

/// The dependence of a mesh's vertices on morph weights and joints.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deformation {
    /// Morph targets.
    pub targets: Vec<MorphTarget>,
    /// Joints, as indices into the skin, and their weights, vertex after vertex.
    pub joints: Vec<(u32, f32)>,
    /// Index of the end of each vertex's entries in `joints`; empty if no vertex has any.
    pub joint_ends: Vec<u32>,
}

impl Deformation {
    /// Returns the joints of a vertex. A vertex without joints stays in its bind pose.
    #[must_use]
    pub fn joints_of(&self, vertex: usize) -> &[(u32, f32)] {
        let end = |i: usize| self.joint_ends.get(i).map_or(0, |&end| end as usize);
        &self.joints[vertex.checked_sub(1).map_or(0, end)..end(vertex)]
    }

    /// Reorders the vertices so that new vertex i is old vertex `vertices[i]`.
    pub fn select(&mut self, vertices: &[u32]) {
        let pick = |values: &mut Vec<Vec3>| {
            if !values.is_empty() {
                *values = vertices.iter().map(|&v| values[v as usize]).collect();
            }
        };
        for target in &mut self.targets {
            pick(&mut target.positions);
            pick(&mut target.normals);
            pick(&mut target.tangents);
        }
        if !self.joint_ends.is_empty() {
            let (mut joints, mut ends) = (Vec::new(), Vec::new());
            for &vertex in vertices {
                joints.extend_from_slice(self.joints_of(vertex as usize));
                ends.push(joints.len() as u32);
            }
            (self.joints, self.joint_ends) = (joints, ends);
        }
    }

    /// Morphs a mesh by target weights, of which missing ones are 0, then skins it by joint matrices, which
    /// transform it to world space; normals and tangents are normalized.
    pub fn apply(&self, mesh: &mut Mesh, weights: &[f32], matrices: Option<&[Mat4]>) {
        for (target, &weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            mesh.positions.iter_mut().zip(&target.positions).for_each(|(p, d)| *p += weight * *d);
            mesh.normals.iter_mut().zip(&target.normals).for_each(|(n, d)| *n += weight * *d);
            mesh.tangents.iter_mut().zip(&target.tangents).for_each(|(t, d)| *t += (weight * *d).extend(0.0));
        }
        if let Some(matrices) = matrices {
            self.skin(mesh, matrices);
        }
        for normal in &mut mesh.normals {
            *normal = normal.normalize_or_zero();
        }
        for tangent in &mut mesh.tangents {
            *tangent = tangent.truncate().normalize_or_zero().extend(if tangent.w < 0.0 { -1.0 } else { 1.0 });
        }
    }

    /// Blends each vertex by its joints' matrices.
    fn skin(&self, mesh: &mut Mesh, matrices: &[Mat4]) {
        let mut mirrored = vec![false; mesh.positions.len()];
        for (i, mirrored) in mirrored.iter_mut().enumerate() {
            let (mut blend, mut total) = (Mat4::ZERO, 0.0);
            for &(joint, weight) in self.joints_of(i) {
                blend += matrices[joint as usize] * weight;
                total += weight;
            }
            let blend = if total == 0.0 { Mat4::IDENTITY } else { blend * (1.0 / total) };
            mesh.positions[i] = blend.transform_point3(mesh.positions[i]);
            let linear = Mat3A::from_mat4(blend);
            *mirrored = linear.determinant() < 0.0;
            if let Some(normal) = mesh.normals.get_mut(i) {
                *normal = Vec3::from(cofactor(linear) * Vec3A::from(*normal)) * if *mirrored { -1.0 } else { 1.0 };
            }
            if let Some(tangent) = mesh.tangents.get_mut(i) {
                let w = if *mirrored { -tangent.w } else { tangent.w };
                *tangent = Vec3::from(linear * Vec3A::from(tangent.truncate())).extend(w);
            }
        }
        for triangle in &mut mesh.triangles {
            if mirrored[triangle[0] as usize] {
                triangle.swap(1, 2);
            }
        }
    }
}
