//! Tangents for normal maps by MikkTSpace, the convention that glTF prescribes for files without tangents.

use std::collections::HashMap;

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Affine2, Vec2, Vec3, Vec4};

use crate::scene::Mesh;

/// Generates the tangents for one set of texture coordinates after a texture transform.
///
/// A mesh without normals gets flat ones. Vertices are split where neighbouring triangles need different
/// tangents. The bitangent, cross(normal, tangent) times w, points up the image. Returns the old index of
/// each vertex, or `None` for a mesh without these texture coordinates, which stays unchanged.
pub fn generate(mesh: &mut Mesh, uv_set: usize, transform: Affine2) -> Option<Vec<u32>> {
    if mesh.uvs[uv_set].is_empty() || mesh.triangles.is_empty() || !mesh.positions.iter().all(|p| p.is_finite()) {
        return None;
    }
    let corners = mesh.normals.is_empty().then(|| flatten(mesh));
    let mut faces = Faces { mesh, uv_set, transform, tangents: vec![Vec4::ZERO; mesh.triangles.len() * 3] };
    // The error type has no values: generating tangents cannot fail.
    let Ok(()) = generate_tangents(&mut faces) else {
        return corners;
    };
    let tangents = faces.tangents;

    // Corners that share a vertex and a tangent are welded.
    let mut vertices = Vec::with_capacity(mesh.positions.len());
    let mut welded = HashMap::with_capacity(mesh.positions.len());
    let mut out = Vec::with_capacity(mesh.positions.len());
    for (corner, index) in mesh.triangles.iter_mut().flatten().enumerate() {
        let tangent = tangents[corner];
        *index = *welded.entry((*index, tangent.to_array().map(f32::to_bits))).or_insert_with(|| {
            vertices.push(*index);
            out.push(tangent);
            vertices.len() as u32 - 1
        });
    }
    select(mesh, &vertices);
    mesh.tangents = out;
    Some(match corners {
        Some(corners) => vertices.iter().map(|&v| corners[v as usize]).collect(),
        None => vertices,
    })
}

/// Unshares all vertices and sets the geometric normals; returns the old index of each vertex.
fn flatten(mesh: &mut Mesh) -> Vec<u32> {
    let corners: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    select(mesh, &corners);
    mesh.triangles = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let flat = |p: &[Vec3]| [(p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero(); 3];
    mesh.normals = mesh.positions.chunks_exact(3).flat_map(flat).collect();
    corners
}

/// Reorders the vertices so that new vertex i is old vertex `vertices[i]`; triangles stay unchanged.
pub(in crate::scene) fn select(mesh: &mut Mesh, vertices: &[u32]) {
    fn pick<T: Copy>(values: &mut Vec<T>, vertices: &[u32]) {
        if !values.is_empty() {
            *values = vertices.iter().map(|&v| values[v as usize]).collect();
        }
    }
    pick(&mut mesh.positions, vertices);
    pick(&mut mesh.normals, vertices);
    pick(&mut mesh.tangents, vertices);
    pick(&mut mesh.uvs[0], vertices);
    pick(&mut mesh.uvs[1], vertices);
    pick(&mut mesh.colors, vertices);
}

struct Faces<'a> {
    mesh: &'a Mesh,
    uv_set: usize,
    transform: Affine2,
    tangents: Vec<Vec4>,
}

impl Faces<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.triangles[face][corner] as usize
    }
}

impl Geometry for Faces<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)].to_array()
    }

    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.vertex(face, corner)].normalize_or(Vec3::Z).to_array()
    }

    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        let uv = self.transform.transform_point2(self.mesh.uvs[self.uv_set][self.vertex(face, corner)]);
        // v runs down the image, the bitangent points up.
        if uv.is_finite() { [uv.x, 1.0 - uv.y] } else { Vec2::ZERO.to_array() }
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, corner: usize) {
        let tangent = space.map(|s| Vec4::from(s.tangent_encoded())).filter(|t| t.is_finite());
        self.tangents[face * 3 + corner] = tangent.unwrap_or_else(|| {
            let normal = self.mesh.normals[self.vertex(face, corner)].normalize_or(Vec3::Z);
            normal.any_orthonormal_vector().extend(1.0)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a square facing +Z with u to the right and v down: tangent +X, bitangent +Y, so w = +1.
    fn square() -> Mesh {
        let corners = [Vec2::new(0.0, 0.0), Vec2::new(1.0, 0.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 1.0)];
        Mesh {
            positions: corners.iter().map(|c| c.extend(0.0)).collect(),
            uvs: [corners.iter().map(|c| Vec2::new(c.x, 1.0 - c.y)).collect(), Vec::new()],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn bitangent_points_up_the_image() {
        let mut mesh = square();
        mesh.normals = vec![Vec3::Z; 4];
        generate(&mut mesh, 0, Affine2::IDENTITY);
        assert_eq!(mesh.positions.len(), 4, "no vertex needed splitting");
        for tangent in &mesh.tangents {
            assert!(tangent.abs_diff_eq(Vec4::new(1.0, 0.0, 0.0, 1.0), 1e-5), "{tangent}");
        }
    }

    #[test]
    fn mirrored_coordinates_flip_the_sign_and_split_vertices() {
        let mut mesh = square();
        // The second triangle is mapped with u mirrored about the diagonal, whose corners (0,0) and (1,1)
        // keep their uv.
        mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
        mesh.normals = vec![Vec3::Z; 4];
        mesh.uvs[0][3] = mesh.uvs[0][1];
        generate(&mut mesh, 0, Affine2::IDENTITY);
        assert_eq!(mesh.tangents.len(), mesh.positions.len());
        assert!(mesh.positions.len() > 4, "the seam has two tangents");
        assert_eq!(mesh.tangents[mesh.triangles[0][1] as usize].w, 1.0);
        assert_eq!(mesh.tangents[mesh.triangles[1][2] as usize].w, -1.0);
    }

    #[test]
    fn a_mesh_without_normals_gets_flat_ones() {
        let mut mesh = square();
        generate(&mut mesh, 0, Affine2::from_angle(std::f32::consts::FRAC_PI_2));
        assert_eq!(mesh.normals, vec![Vec3::Z; mesh.positions.len()]);
        assert!(!mesh.tangents.is_empty());
        for tangent in &mesh.tangents {
            assert!(tangent.truncate().dot(Vec3::Z).abs() < 1e-5 && (tangent.truncate().length() - 1.0).abs() < 1e-5);
        }
    }
}
