//! Shading normals of meshes that have none.

use glam::Vec3;

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
