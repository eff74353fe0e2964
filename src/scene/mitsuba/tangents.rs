//! Tangents for meshes with a normal map, so that its axes lie as in Mitsuba.

use glam::{Vec2, Vec3};

use crate::scene::Mesh;

/// Where a normal map's Y axis points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frame {
    /// Along normal x tangent, Mitsuba's shading frame.
    RightHanded,
    /// Up the image, which is against the derivative by v.
    ImageUp,
}

/// Per-vertex derivatives by u, weighted by area, orthogonal to the normals. Needs normals and uv; without, does nothing.
pub(super) fn derive(mesh: &mut Mesh, frame: Frame) {
    let count = mesh.positions.len();
    if mesh.normals.len() != count || mesh.uvs[0].len() != count {
        return;
    }
    let mut by_u = vec![Vec3::ZERO; count];
    let mut handedness = vec![0.0_f32; count];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| i as usize);
        let (e1, e2) = (mesh.positions[b] - mesh.positions[a], mesh.positions[c] - mesh.positions[a]);
        let (d1, d2) = (mesh.uvs[0][b] - mesh.uvs[0][a], mesh.uvs[0][c] - mesh.uvs[0][a]);
        let determinant = d1.perp_dot(d2);
        // The derivative times the area in uv, whose sign it must not have.
        let du = (e1 * d2.y - e2 * d1.y) * determinant.signum();
        for i in [a, b, c] {
            by_u[i] += du;
            // dp/du x dp/dv points along the face's normal where the determinant is positive.
            handedness[i] += determinant.signum() * e1.cross(e2).length();
        }
    }
    let tangent = |i: usize| {
        let normal = mesh.normals[i];
        let tangent = by_u[i].reject_from(normal).try_normalize().unwrap_or_else(|| normal.any_orthonormal_vector());
        let w = if frame == Frame::ImageUp && handedness[i] >= 0.0 { -1.0 } else { 1.0 };
        tangent.extend(w)
    };
    mesh.tangents = (0..count).map(tangent).collect();
}

/// Metres that a unit of uv spans: the root of the areas' ratio.
pub(super) fn metres_per_uv(mesh: &Mesh, to_world: &glam::Affine3A) -> Option<f32> {
    let uvs: &[Vec2] = &mesh.uvs[0];
    if uvs.len() != mesh.positions.len() {
        return None;
    }
    let (mut metres, mut uv) = (0.0_f64, 0.0_f64);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| i as usize);
        let edge = |i: usize| to_world.transform_vector3(mesh.positions[i] - mesh.positions[a]);
        metres += f64::from(edge(b).cross(edge(c)).length());
        uv += f64::from((uvs[b] - uvs[a]).perp_dot(uvs[c] - uvs[a]).abs());
    }
    (metres > 0.0 && uv > 0.0).then(|| (metres / uv).sqrt() as f32)
}
