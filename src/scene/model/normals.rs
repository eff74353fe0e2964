//! Shading normals of meshes that have none.

use glam::Vec3;

use crate::scene::Mesh;
use crate::scene::model::tangents;

/// Cosine of the angle between two faces from which on the edge between them is sharp: 60 degrees.
const CREASE: f32 = 0.5;
/// Faces at a vertex up to which each pair of them is compared.
const MOST_AROUND: usize = 256;

/// Computes unit vertex normals: the faces' normals weighted by their angle at the vertex.
///
/// G. Thuermer and C. Wuethrich, "Computing Vertex Normals from Polygonal Facets" (1998), as in Mitsuba. A
/// vertex whose faces all have zero area gets a zero normal.
#[must_use]
pub fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let p = triangle.map(|i| positions[i as usize]);
        let Some(face) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else { continue };
        for k in 0..3 {
            let [to_next, to_last] = [1, 2].map(|step| p[(k + step) % 3] - p[k]);
            normals[triangle[k] as usize] += face * to_next.angle_between(to_last);
        }
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// Gives a mesh the normals of [`smooth_normals`], but sharp edges where faces meet at 60 degrees or more: a vertex there
/// becomes several. Vertices of no triangle are left out.
pub(in crate::scene) fn add_creased_normals(mesh: &mut Mesh) {
    let positions = &mesh.positions;
    let face =
        |[a, b, c]: [usize; 3]| (positions[b] - positions[a]).cross(positions[c] - positions[a]).normalize_or_zero();
    let faces: Vec<Vec3> = mesh.triangles.iter().map(|t| face(t.map(|i| i as usize))).collect();
    // Corners of each vertex, one after the other.
    let mut corners: Vec<u32> = (0..3 * mesh.triangles.len() as u32).collect();
    let vertex = |corner: u32| mesh.triangles.as_flattened()[corner as usize];
    corners.sort_by_key(|&corner| vertex(corner));
    let angle = |corner: u32| {
        let [triangle, k] = [corner as usize / 3, corner as usize % 3];
        let p = mesh.triangles[triangle].map(|i| positions[i as usize]);
        let [to_next, to_last] = [1, 2].map(|step| p[(k + step) % 3] - p[k]);
        if faces[triangle] == Vec3::ZERO { 0.0 } else { to_next.angle_between(to_last) }
    };
    let mut triangles = mesh.triangles.clone();
    let (mut sources, mut normals) = (Vec::new(), Vec::new());
    for around in corners.chunk_by(|&a, &b| vertex(a) == vertex(b)) {
        let weighted: Vec<(Vec3, f32)> = around.iter().map(|&c| (faces[c as usize / 3], angle(c))).collect();
        let is_smooth = around.len() > MOST_AROUND;
        let first = normals.len();
        for (&corner, &(own, _)) in around.iter().zip(&weighted) {
            let smooth =
                weighted.iter().filter(|(other, _)| is_smooth || own == Vec3::ZERO || own.dot(*other) > CREASE);
            let normal = smooth.map(|(normal, angle)| *normal * *angle).sum::<Vec3>().normalize_or_zero();
            let known = normals[first..].iter().position(|other| *other == normal);
            let place = known.map_or(normals.len(), |n| first + n);
            if known.is_none() {
                sources.push(vertex(corner));
                normals.push(normal);
            }
            triangles.as_flattened_mut()[corner as usize] = place as u32;
        }
    }
    tangents::select(mesh, &sources);
    mesh.triangles = triangles;
    mesh.normals = normals;
}
