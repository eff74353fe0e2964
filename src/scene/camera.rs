//! Cameras: pinholes, thin lenses and parallel projections.

use glam::{Affine3A, Vec2, Vec3};

/// Which image axis an angle of view spans (Mitsuba's `fov_axis`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FovAxis {
    /// Left to right.
    X,
    /// Bottom to top, as in glTF.
    Y,
    /// Corner to corner.
    Diagonal,
    /// The shorter side.
    Smaller,
    /// The longer side.
    Larger,
}

/// How a camera maps directions or positions to the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// A pinhole; `fov` in radians, full angle along `axis`.
    Perspective {
        /// Full angle of view in radians.
        fov: f32,
        /// The image axis that it spans.
        axis: FovAxis,
    },
    /// Parallel rays; half extents of the image in metres (glTF's xmag and ymag).
    Orthographic {
        /// Half width and half height in metres.
        half_extent: Vec2,
    },
}

/// A thin lens: rays start on its disc and meet on the plane of focus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture in metres.
    pub radius: f32,
    /// Distance along the axis of the plane that is sharp, in metres.
    pub focus: f32,
}

/// A camera: looks along its own -Z with +Y up, as in glTF.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Its name in the file, for `--camera`.
    pub name: String,
    /// Rigid placement, without scale.
    pub world_from_camera: Affine3A,
    /// Pinhole or parallel.
    pub projection: Projection,
    /// A thin lens instead of a pinhole; perspective cameras only.
    pub lens: Option<Lens>,
    /// Image size that the file asks for, in pixels.
    pub film_size: Option<(u32, u32)>,
}

impl Camera {
    /// Moves the camera to `eye` and turns it towards `target`, with +Y up, or -Z where it looks along Y. Nothing where the two
    /// points are not finite or too close for a direction.
    #[must_use]
    pub fn looking(self, eye: Vec3, target: Vec3) -> Option<Self> {
        let back = (eye - target).try_normalize()?;
        let up = if back.y.abs() < 0.9999 { Vec3::Y } else { Vec3::NEG_Z };
        let right = up.cross(back).try_normalize()?;
        let axes = glam::Mat3::from_cols(right, back.cross(right), back);
        Some(Self { world_from_camera: Affine3A::from_mat3_translation(axes, eye), ..self })
    }

    /// Half extents of the image plane: at distance 1 for a pinhole (tangents), in metres for a parallel camera.
    ///
    /// A parallel camera keeps its half height and takes its half width from the image's aspect.
    #[must_use]
    pub fn half_extent(&self, width: u32, height: u32) -> Vec2 {
        let aspect = width as f32 / height as f32;
        match self.projection {
            Projection::Perspective { fov, axis } => {
                let half = (0.5 * fov).tan();
                match axis {
                    FovAxis::X => Vec2::new(half, half / aspect),
                    FovAxis::Y => Vec2::new(half * aspect, half),
                    FovAxis::Diagonal => {
                        let y = half / (1.0 + aspect * aspect).sqrt();
                        Vec2::new(y * aspect, y)
                    }
                    FovAxis::Smaller if aspect >= 1.0 => Vec2::new(half * aspect, half),
                    FovAxis::Larger if aspect < 1.0 => Vec2::new(half * aspect, half),
                    FovAxis::Smaller | FovAxis::Larger => Vec2::new(half, half / aspect),
                }
            }
            Projection::Orthographic { half_extent } => Vec2::new(half_extent.y * aspect, half_extent.y),
        }
    }
}
