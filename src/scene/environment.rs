//! Radiance from infinitely far away.

use glam::{Mat3, Vec3};

/// Where the first and the last row of an equirectangular map lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Row r spans polar angles pi r / H to pi (r + 1) / H; its value is met at the middle.
    Centred,
    /// Row 0 is met at the upper pole and row H - 1 at the lower one (Mitsuba's `envmap`).
    AtPoles,
}

/// An equirectangular map, row 0 on top (+Y), bilinear, wrapping in u and clamped in v.
///
/// A direction d in the map's own space has u = atan2(d.x, -d.z) / (2 pi) mod 1 and v = acos(d.y) / pi;
/// in u, texel centres lie at (i + 0.5) / W.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear radiance, W m^-2 sr^-1, row-major.
    pub texels: Vec<[f32; 3]>,
    /// Where rows are met.
    pub rows: Rows,
}

/// A constant or mapped sky.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Multiplies the map, or is the radiance itself where there is none.
    pub radiance: Vec3,
    /// The map, if not constant.
    pub map: Option<EnvironmentMap>,
    /// Rotation from the map's space to the world.
    pub world_from_environment: Mat3,
}
