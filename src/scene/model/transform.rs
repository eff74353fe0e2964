//! Parts of affine transforms.

use glam::{Affine3A, Mat3A, Vec3A};

/// Returns the matrix that transforms normals if `linear` transforms points: the cofactor matrix, which
/// exists for singular transforms too.
pub(in crate::scene) fn cofactor(linear: Mat3A) -> Mat3A {
    Mat3A::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    )
}

/// Returns the rigid part of a placement: the position, the direction of -Z, and the component of +Y
/// orthogonal to it.
#[must_use]
pub fn rigid(world: Affine3A) -> Affine3A {
    let back = world.z_axis.normalize_or(Vec3A::Z);
    let x = world.y_axis.cross(back).normalize_or_zero();
    let x = if x == Vec3A::ZERO { back.any_orthonormal_vector() } else { x };
    Affine3A { matrix3: Mat3A::from_cols(x, back.cross(x), back), translation: world.translation }
}
