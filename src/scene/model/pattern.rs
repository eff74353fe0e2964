//! Directional patterns of lamps: measured profiles and projected images, both stored as a table of factors.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

/// The directions of the table's entries in the lamp's own space, where -Z is the axis and +Y is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mapping {
    /// Row r at the angle pi r / (height - 1) from the axis, column c at the azimuth 2 pi c / width from +X
    /// towards +Y.
    Sphere,
    /// An image across the axis at distance 1, row 0 on top, which spans `half_extent` to either side and is
    /// black outside. Texel centres lie at half texels.
    Image {
        /// Half width and half height.
        half_extent: Vec2,
    },
    /// An image as above whose factors multiply the irradiance on that plane, so that the intensity has
    /// another 1 / cos^3 of the angle from the axis.
    Projection {
        /// Half width and half height.
        half_extent: Vec2,
    },
}

/// Factors of a lamp's intensity, bilinear between entries.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    /// Path of the profile or image.
    pub name: String,
    /// Directions of the entries.
    pub mapping: Mapping,
    /// Columns.
    pub width: u32,
    /// Rows; at least 2 for a sphere.
    pub height: u32,
    /// Row-major, neither negative nor infinite.
    pub texels: Vec<[f32; 3]>,
}

impl Pattern {
    /// Returns the half angle in radians outside which all factors are 0.
    #[must_use]
    pub fn outer_angle(&self) -> f32 {
        match self.mapping {
            Mapping::Sphere => {
                let rows = self.texels.chunks_exact(self.width as usize);
                let last = rows.clone().rposition(|row| row.iter().flatten().any(|&v| v > 0.0)).unwrap_or(0);
                // Interpolation reaches 0 one row after the last positive one.
                PI * ((last + 1) as f32 / (self.height - 1) as f32).min(1.0)
            }
            Mapping::Image { half_extent } | Mapping::Projection { half_extent } => half_extent.length().atan(),
        }
    }

    /// Integrates the factors over all directions, weighted by a strength that depends on the angle from the
    /// axis; `strength` returns its mean between two angles in radians.
    ///
    /// The result is exact to rounding for a constant strength of 1; otherwise each cell uses the strength of
    /// the ring around the axis that it spans.
    #[must_use]
    pub fn flux(&self, strength: impl Fn(f32, f32) -> f32) -> Vec3 {
        let (width, height) = (self.width as usize, self.height as usize);
        let texel = |row: usize, column: usize| Vec3::from(self.texels[row * width + column % width]).as_dvec3();
        let mut sum = glam::DVec3::ZERO;
        match self.mapping {
            Mapping::Sphere => {
                let angle = |row: usize| f64::from(PI) * row as f64 / (height - 1) as f64;
                for row in 0..height - 1 {
                    // A linear function from a to b over the band is weighted by the sine: these are the
                    // integrals of theta sin theta.
                    let (t0, t1) = (angle(row), angle(row + 1));
                    let all = t0.cos() - t1.cos();
                    let lower = ((t1.sin() - t1 * t1.cos()) - (t0.sin() - t0 * t0.cos()) - t0 * all) / (t1 - t0);
                    let weight = f64::from(strength(t0 as f32, t1 as f32)) * f64::from(TAU) / width as f64;
                    for column in 0..width {
                        let (a, b) = (
                            texel(row, column) + texel(row, column + 1),
                            texel(row + 1, column) + texel(row + 1, column + 1),
                        );
                        sum += 0.5 * weight * (a * (all - lower) + b * lower);
                    }
                }
            }
            Mapping::Image { half_extent } | Mapping::Projection { half_extent } => {
                let projection = matches!(self.mapping, Mapping::Projection { .. });
                let size = half_extent / Vec2::new(self.width as f32, self.height as f32);
                let across = 2.0 * size.length();
                for (row, column) in (0..height).flat_map(|row| (0..width).map(move |column| (row, column))) {
                    let at = (Vec2::new(column as f32, row as f32) * 2.0 + 1.0) * size - half_extent;
                    let cos = 1.0 / (1.0 + at.length_squared()).sqrt();
                    let [near, far] = [-0.5, 0.5].map(|half| (at.length() + half * across).max(0.0).atan());
                    let solid = if projection { 1.0 } else { cos.powi(3) } * strength(near, far);
                    sum += texel(row, column) * f64::from(4.0 * size.x * size.y * solid);
                }
            }
        }
        sum.as_vec3()
    }
}
