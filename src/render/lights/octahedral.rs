//! The octahedral map between unit vectors and a square (Cigolle et al., "A Survey of Efficient Representations for
//! Independent Unit Vectors", JCGT 2014).

use glam::{Vec2, Vec3, Vec3Swizzles as _};

/// Maps a unit vector to the square [-1, 1]^2.
#[must_use]
pub fn octahedral(w: Vec3) -> Vec2 {
    let p = w / (w.x.abs() + w.y.abs() + w.z.abs());
    if p.z >= 0.0 { p.xy() } else { folded(p.xy()) }
}

/// Maps a point of the square [-1, 1]^2 to a unit vector.
#[must_use]
pub fn from_octahedral(p: Vec2) -> Vec3 {
    let z = 1.0 - p.x.abs() - p.y.abs();
    (if z >= 0.0 { p } else { folded(p) }).extend(z).normalize()
}

/// Folds the corners of the square over its inner diamond, and back.
fn folded(p: Vec2) -> Vec2 {
    let sign = |a: f32| if a >= 0.0 { 1.0 } else { -1.0 };
    Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
}
