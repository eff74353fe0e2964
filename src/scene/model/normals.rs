//! Shading normals of meshes that have none.

use glam::Vec3;

use crate::scene::Mesh;
use crate::scene::model::tangents;

/// Cosine of the angle between two faces from which on the edge between them is sharp: 60 degrees.
const CREASE: f32 = 0.5;
/// Faces at a vertex up to which each pair of them is compared. With more it is smooth.
const MOST_AROUND: usize = 256;

/// Computes unit vertex normals: the faces' normals weighted by their angle at the vertex.
///
/// G. Thuermer and C. Wuethrich, "Computing Vertex Normals from Polygonal Facets" (1998), as in Mitsuba. A
/// vertex whose faces all have zero area gets a zero normal.
#[must_use]
pub fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let (_, weighted) = face_normal(positions, *triangle);
        triangle.iter().zip(weighted).for_each(|(&vertex, normal)| normals[vertex as usize] += normal);
    }
    normals.into_iter().map(Vec3::normalize_or_zero).collect()
}

/// Returns a triangle's unit normal, and the same weighted by its angle at each corner; zero without an area.
fn face_normal(positions: &[Vec3], triangle: [u32; 3]) -> (Vec3, [Vec3; 3]) {
    let p = triangle.map(|i| positions[i as usize]);
    let Some(face) = (p[1] - p[0]).cross(p[2] - p[0]).try_normalize() else { return (Vec3::ZERO, [Vec3::ZERO; 3]) };
    let angle = |k: usize| (p[(k + 1) % 3] - p[k]).angle_between(p[(k + 2) % 3] - p[k]);
    (face, [0, 1, 2].map(|k| face * angle(k)))
}

/// Gives a mesh the normals of [`smooth_normals`], but sharp edges where faces meet at 60 degrees or more: a vertex there
/// becomes several. Vertices of no triangle are left out.
pub(in crate::scene) fn add_creased_normals(mesh: &mut Mesh) {
    let (faces, weighted): (Vec<Vec3>, Vec<[Vec3; 3]>) =
        mesh.triangles.iter().map(|triangle| face_normal(&mesh.positions, *triangle)).unzip();
    // Corners of each vertex, one after the other.
    let mut corners: Vec<u32> = (0..3 * mesh.triangles.len() as u32).collect();
    let vertex = |corner: u32| mesh.triangles.as_flattened()[corner as usize];
    corners.sort_by_key(|&corner| vertex(corner));
    let mut triangles = mesh.triangles.clone();
    let (mut sources, mut normals) = (Vec::new(), Vec::new());
    for around in corners.chunk_by(|&a, &b| vertex(a) == vertex(b)) {
        let face = |corner: u32| faces[corner as usize / 3];
        let sum = |joins: &dyn Fn(u32) -> bool| {
            let joined = around.iter().filter(|&&corner| joins(corner));
            joined.map(|&corner| weighted.as_flattened()[corner as usize]).sum::<Vec3>().normalize_or_zero()
        };
        let of_all = (around.len() > MOST_AROUND).then(|| sum(&|_| true));
        let first = normals.len();
        for &corner in around {
            let own = face(corner);
            let normal = of_all.unwrap_or_else(|| sum(&|other| own == Vec3::ZERO || own.dot(face(other)) > CREASE));
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
