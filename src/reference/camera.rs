//! Generates camera rays.

use glam::{Affine3A, Vec2, Vec3};

use super::sampler::{Sampler, concentric_disk};
use crate::scene::{Camera, Lens, Projection};

/// A camera with the size of its image.
pub struct Rays {
    world_from_camera: Affine3A,
    half_extent: Vec2,
    size: Vec2,
    parallel: bool,
    lens: Option<Lens>,
}

impl Rays {
    /// Prepares a camera for an image.
    #[must_use]
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        Self {
            world_from_camera: camera.world_from_camera,
            half_extent: camera.half_extent(width, height),
            size: Vec2::new(width as f32, height as f32),
            parallel: matches!(camera.projection, Projection::Orthographic { .. }),
            lens: camera.lens.filter(|lens| lens.radius > 0.0),
        }
    }

    /// Returns origin and unit direction of the ray through the centre of the lens, and the unit direction of
    /// the view.
    #[must_use]
    pub fn central(&self, pixel: Vec2) -> (Vec3, Vec3, Vec3) {
        let pinhole = Self { lens: None, ..*self };
        let (origin, direction) = pinhole.ray(pixel, &mut Sampler::new(0, 0, 0));
        (origin, direction, self.world_from_camera.transform_vector3(Vec3::NEG_Z).normalize())
    }

    /// Returns origin and unit direction in world space for a point in pixels from the upper left corner. A
    /// thin lens samples a point on its aperture and aims at the point in which the pinhole ray intersects
    /// the plane of focus (pbrt-v4, section 5.2.3).
    #[must_use]
    pub fn ray(&self, pixel: Vec2, sampler: &mut Sampler) -> (Vec3, Vec3) {
        let ndc = pixel / self.size * 2.0 - 1.0;
        let plane = Vec2::new(ndc.x, -ndc.y) * self.half_extent;
        let (origin, direction) = match self.lens {
            _ if self.parallel => (plane.extend(0.0), Vec3::NEG_Z),
            None => (Vec3::ZERO, plane.extend(-1.0)),
            Some(Lens { radius, focus }) => {
                let start = concentric_disk(sampler.pair()) * radius;
                (start.extend(0.0), (plane * focus - start).extend(-focus))
            }
        };
        (
            self.world_from_camera.transform_point3(origin),
            self.world_from_camera.transform_vector3(direction).normalize(),
        )
    }
}
