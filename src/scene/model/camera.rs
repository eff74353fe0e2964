//! Cameras: pinholes, thin lenses and parallel projections.

use glam::{Affine3A, Vec2, Vec3};

/// The image axis that an angle of view spans (Mitsuba's `fov_axis`).
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

/// The mapping from directions or positions to the image.
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

/// A thin lens: rays start on its disc and converge on the plane of focus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture in metres.
    pub radius: f32,
    /// Distance of the plane in focus along the camera's axis, in metres.
    pub focus: f32,
}

/// A camera that looks along its own -Z with +Y up, as in glTF.
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
    /// Image size given by the file, in pixels.
    pub film_size: Option<(u32, u32)>,
}

impl Camera {
    /// Moves the camera to `eye` and points it at `target` with +Y up, or with -Z up if it looks along Y.
    /// Returns `None` if the two points are not finite or too close to define a direction.
    #[must_use]
    pub fn looking(self, eye: Vec3, target: Vec3) -> Option<Self> {
        let back = (eye - target).try_normalize()?;
        let up = if back.y.abs() < 0.9999 { Vec3::Y } else { Vec3::NEG_Z };
        let right = up.cross(back).try_normalize()?;
        let axes = glam::Mat3::from_cols(right, back.cross(right), back);
        Some(Self { world_from_camera: Affine3A::from_mat3_translation(axes, eye), ..self })
    }

    /// Replaces the radius of the aperture and the focus distance, both in metres; `None` keeps the camera's
    /// own value. A radius of 0 makes the camera a pinhole.
    ///
    /// # Errors
    /// An aperture or focus without its counterpart, or a lens on a parallel camera, is an error; the message
    /// names the cause.
    pub fn with_lens(self, radius: Option<f32>, focus: Option<f32>) -> Result<Self, &'static str> {
        let own = self.lens;
        let lens = match (radius.or(own.map(|l| l.radius)), focus.or(own.map(|l| l.focus))) {
            (None, Some(_)) => {
                return Err("the camera is a pinhole, which is sharp everywhere: it needs an aperture, too");
            }
            (None | Some(0.0), _) => None,
            (Some(_), _) if matches!(self.projection, Projection::Orthographic { .. }) => {
                return Err("the camera is parallel and has no lens");
            }
            (Some(_), None) => return Err("the camera is a pinhole without a focus of its own: it needs one, too"),
            (Some(radius), Some(focus)) => Some(Lens { radius, focus }),
        };
        Ok(Self { lens, ..self })
    }

    /// Returns the half extents of the image plane: at distance 1 for a pinhole (tangents), in metres for a
    /// parallel camera.
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

impl Camera {
    /// Projects a world-space point to image coordinates in [0, 1] with the origin in the upper left corner.
    /// Returns `None` for points behind a pinhole and outside the image.
    #[must_use]
    pub fn project(&self, point: Vec3, width: u32, height: u32) -> Option<Vec2> {
        self.project_beyond(point, width, height).filter(|at| at.min_element() >= 0.0 && at.max_element() <= 1.0)
    }

    /// Projects as [`Self::project`], also to places outside the image.
    #[must_use]
    pub fn project_beyond(&self, point: Vec3, width: u32, height: u32) -> Option<Vec2> {
        let p = self.world_from_camera.inverse().transform_point3(point);
        let on_plane = match self.projection {
            Projection::Perspective { .. } if p.z < 0.0 => p.truncate() / -p.z,
            Projection::Perspective { .. } => return None,
            Projection::Orthographic { .. } => p.truncate(),
        };
        let ndc = on_plane / self.half_extent(width, height);
        Some(Vec2::new(0.5 + 0.5 * ndc.x, 0.5 - 0.5 * ndc.y))
    }

    /// Returns the unit direction in world space of the ray, through the middle of the lens, that image coordinates as those
    /// of [`Self::project`] show.
    #[must_use]
    pub fn direction(&self, at: Vec2, width: u32, height: u32) -> Vec3 {
        let ndc = Vec2::new(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y);
        let on_plane = match self.projection {
            Projection::Perspective { .. } => ndc * self.half_extent(width, height),
            Projection::Orthographic { .. } => Vec2::ZERO,
        };
        self.world_from_camera.transform_vector3(on_plane.extend(-1.0)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_projected_to_where_they_are_seen() {
        let camera = |projection| Camera {
            name: String::new(),
            world_from_camera: Affine3A::from_translation(Vec3::new(0.0, 0.0, 5.0)),
            projection,
            lens: None,
            film_size: None,
        };
        let pinhole = camera(Projection::Perspective { fov: std::f32::consts::FRAC_PI_2, axis: FovAxis::Y });
        assert_eq!(pinhole.project(Vec3::ZERO, 20, 10), Some(Vec2::splat(0.5)));
        let corner = pinhole.project(Vec3::new(10.0, 5.0, 0.0), 20, 10).unwrap();
        assert!(corner.distance(Vec2::new(1.0, 0.0)) < 1e-5, "{corner}");
        let ahead = pinhole.direction(corner, 20, 10);
        assert!(ahead.distance(Vec3::new(10.0, 5.0, -5.0).normalize()) < 1e-5, "{ahead}");
        assert_eq!(pinhole.project(Vec3::new(0.0, 5.1, 0.0), 20, 10), None);
        assert_eq!(pinhole.project(Vec3::new(0.0, 0.0, 6.0), 20, 10), None);
        let parallel = camera(Projection::Orthographic { half_extent: Vec2::ONE });
        let left = parallel.project(Vec3::new(-2.0, -1.0, 9.0), 20, 10).unwrap();
        assert!(left.distance(Vec2::new(0.0, 1.0)) < 1e-5, "{left}");
        assert_eq!(parallel.direction(left, 20, 10), Vec3::NEG_Z);
    }

    #[test]
    fn a_lens_is_the_camera_s_own_or_another() {
        let camera = |lens, projection| Camera {
            name: String::new(),
            world_from_camera: Affine3A::IDENTITY,
            projection,
            lens,
            film_size: None,
        };
        let perspective = Projection::Perspective { fov: 1.0, axis: FovAxis::X };
        let pinhole = camera(None, perspective);
        let lens = camera(Some(Lens { radius: 0.1, focus: 2.0 }), perspective);
        let parallel = camera(None, Projection::Orthographic { half_extent: Vec2::ONE });
        let on = |camera: &Camera, radius, focus| {
            camera.clone().with_lens(radius, focus).map(|camera| camera.lens.map(|l| (l.radius, l.focus)))
        };
        assert_eq!(on(&pinhole, None, None), Ok(None));
        assert_eq!(on(&lens, None, None), Ok(Some((0.1, 2.0))));
        assert_eq!(on(&pinhole, Some(0.3), Some(4.0)), Ok(Some((0.3, 4.0))));
        assert_eq!(on(&lens, Some(0.3), None), Ok(Some((0.3, 2.0))));
        assert_eq!(on(&lens, None, Some(4.0)), Ok(Some((0.1, 4.0))));
        for camera in [&pinhole, &lens, &parallel] {
            assert_eq!(on(camera, Some(0.0), None), Ok(None));
        }
        assert_eq!(on(&parallel, None, None), Ok(None));
        assert!(on(&pinhole, None, Some(4.0)).is_err());
        assert!(on(&pinhole, Some(0.3), None).is_err());
        assert!(on(&parallel, Some(0.3), Some(4.0)).is_err());
    }
}
