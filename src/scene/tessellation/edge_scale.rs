//! The number of parts of an edge, from its length in pixels.

use glam::Vec3;

use crate::scene::model::camera::{Camera, Projection};
use crate::scene::model::scene::Scene;
use crate::scene::model::tessellation::MAX_FACTOR;

/// Image resolution as a function of distance.
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) struct Scale {
    eye: Vec3,
    /// Pixels per metre at a distance of 1 m; for a parallel camera, at any distance.
    pixels: f32,
    parallel: bool,
}

impl Scale {
    /// Evaluates a scene's viewpoint, or the first camera's own image if the scene has none. Returns `None`
    /// without a camera.
    pub fn new(scene: &Scene) -> Option<Self> {
        let camera = scene.cameras.get(scene.viewpoint.map_or(0, |v| v.camera))?;
        let (width, height) = camera.film_size.unwrap_or((512, 512));
        Some(Self::of(camera, scene.viewpoint.map_or([width, height], |v| v.size)))
    }

    fn of(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let half = camera.half_extent(width.max(1), height.max(1));
        Self {
            eye: camera.world_from_camera.translation.into(),
            pixels: 0.5 * width.max(1) as f32 / half.x,
            parallel: matches!(camera.projection, Projection::Orthographic { .. }),
        }
    }

    /// Returns the number of parts of about `pixels` pixels each. The edge counts as perpendicular to the
    /// view and at the distance of its midpoint, so that surfaces outside the view, visible in mirrors or by
    /// their shadows, are equally fine. The result is symmetric in the ends.
    pub fn parts(&self, pixels: f32, a: Vec3, b: Vec3) -> u32 {
        let length = a.distance(b);
        let away = if self.parallel { 1.0 } else { self.eye.distance(0.5 * (a + b)).max(0.5 * length) };
        let parts = (length * self.pixels / (away * pixels)).ceil();
        // The cast turns NaN into 0.
        (parts as u32).clamp(1, MAX_FACTOR)
    }
}
