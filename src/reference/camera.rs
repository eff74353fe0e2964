//! Rays from a camera through points of its image.

use glam::{Affine3A, Vec2, Vec3};

use super::sampler::{Sampler, concentric_disk};
use crate::scene::{Camera, Lens, Projection};

/// A camera at one image size.
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

    /// Origin and unit direction in the world, for a point in pixels from the upper left corner; through a lens, from a random
    /// point of it towards what the pinhole's ray meets on the plane of focus.
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
