//! A camera controlled by position and target: orbits around the target, or flies.

use glam::{Quat, Vec3};

use crate::scene::Camera;

/// Smallest angle between the view direction and the vertical, radians.
const POLE: f32 = 0.01;
/// Range of the distance between position and target, metres.
const REACH: std::ops::RangeInclusive<f32> = 1e-4..=1e7;

/// Position and target of an upright camera, as in `--eye` and `--target`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrbitCamera {
    /// Position, metres.
    pub eye: Vec3,
    /// Point that the camera looks at and orbits around, metres.
    pub target: Vec3,
}

impl OrbitCamera {
    /// Returns the position of a camera, and a target straight ahead of it at the given distance.
    #[must_use]
    pub fn of(camera: &Camera, distance: f32) -> Self {
        let eye = Vec3::from(camera.world_from_camera.translation);
        let ahead = camera.world_from_camera.transform_vector3(Vec3::NEG_Z).normalize_or(Vec3::NEG_Z);
        Self { eye, target: eye + ahead * distance.clamp(*REACH.start(), *REACH.end()) }
    }

    /// Returns a camera's position, and a target straight ahead of it as far away as the centre of the scene
    /// with this bounding sphere; if the camera is near the centre, half the scene's radius away.
    #[must_use]
    pub fn around(camera: &Camera, (centre, radius): (Vec3, f32)) -> Self {
        let distance = Vec3::from(camera.world_from_camera.translation).distance(centre);
        Self::of(camera, distance.max(0.5 * radius).max(1e-3))
    }

    /// Returns a camera with the projection of another one, at this position and with this target.
    #[must_use]
    pub fn camera(&self, like: &Camera) -> Camera {
        like.clone().looking(self.eye, self.target).unwrap_or_else(|| like.clone())
    }

    /// Returns the distance to the target, metres.
    #[must_use]
    pub fn distance(&self) -> f32 {
        self.eye.distance(self.target)
    }

    /// Returns the camera's unit vectors forward, right and up.
    #[must_use]
    pub fn axes(&self) -> [Vec3; 3] {
        let ahead = (self.target - self.eye).normalize_or(Vec3::NEG_Z);
        let right = ahead.cross(Vec3::Y).normalize_or(Vec3::X);
        [ahead, right, right.cross(ahead)]
    }

    /// Rotates a vector about +Y and about the right vector, radians, and stops short of the poles.
    fn turned(direction: Vec3, yaw: f32, pitch: f32) -> Vec3 {
        let length = direction.length();
        let flat = direction.x.hypot(direction.z);
        let elevation = direction.y.atan2(flat);
        let most = std::f32::consts::FRAC_PI_2 - POLE;
        let raised = (elevation + pitch).clamp(-most, most);
        let heading = if flat > 0.0 { direction.x.atan2(direction.z) } else { 0.0 };
        Quat::from_rotation_y(heading + yaw) * Vec3::new(0.0, raised.sin(), raised.cos()) * length
    }

    /// Orbits around the target; angles in radians.
    pub fn orbit(&mut self, yaw: f32, pitch: f32) {
        self.eye = self.target + Self::turned(self.eye - self.target, yaw, pitch);
    }

    /// Rotates the view direction at a fixed position; angles in radians.
    pub fn turn(&mut self, yaw: f32, pitch: f32) {
        self.target = self.eye + Self::turned(self.target - self.eye, yaw, pitch);
    }

    /// Moves position and target by metres forward, right and up.
    pub fn fly(&mut self, ahead: f32, right: f32, up: f32) {
        let axes = self.axes();
        let step = axes[0] * ahead + axes[1] * right + axes[2] * up;
        if step.is_finite() {
            self.eye += step;
            self.target += step;
        }
    }

    /// Multiplies the distance to the target by a factor.
    pub fn approach(&mut self, share: f32) {
        let distance = (self.distance() * share).clamp(*REACH.start(), *REACH.end());
        self.eye = self.target - self.axes()[0] * distance;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    fn start() -> OrbitCamera {
        OrbitCamera { eye: Vec3::new(1.0, 2.0, 5.0), target: Vec3::new(0.0, 1.0, 0.0) }
    }

    #[test]
    fn a_camera_s_orbit_camera_makes_that_camera() {
        let camera = &builtin::load("cornell_point").unwrap().cameras[0];
        let again = OrbitCamera::of(camera, 2.0).camera(camera);
        let (a, b) = (camera.world_from_camera, again.world_from_camera);
        assert!(a.abs_diff_eq(b, 1e-5), "{a} {b}");
        assert_eq!(again.projection, camera.projection);
    }

    #[test]
    fn orbiting_keeps_the_distance_and_turning_the_place() {
        let mut s = start();
        s.orbit(0.7, -0.3);
        assert!((s.distance() - start().distance()).abs() < 1e-4 && s.target == start().target && s.eye != start().eye);
        s.orbit(-0.7, 0.3);
        assert!(s.eye.distance(start().eye) < 1e-4, "{s:?}");
        s.turn(0.2, 0.1);
        assert!(s.eye.distance(start().eye) < 1e-4 && s.target != start().target);
        s.turn(-0.2, -0.1);
        assert!(s.target.distance(start().target) < 1e-4, "{s:?}");
    }

    #[test]
    fn nothing_goes_over_the_poles_or_to_nowhere() {
        let camera = &builtin::load("cornell_point").unwrap().cameras[0];
        let mut s = start();
        for step in 0..200 {
            s.orbit(0.3, 0.4);
            s.turn(-0.1, if step % 2 == 0 { -3.0 } else { 2.9 });
            s.approach(if step % 3 == 0 { 1e-3 } else { 20.0 });
            s.fly(0.1, f32::NAN, 0.0);
            s.fly(0.1, -0.2, 0.3);
            assert!(s.eye.is_finite() && s.target.is_finite() && s.distance() >= 0.9e-4, "{s:?}");
            assert!(s.axes()[2].y > 0.0, "upright: {s:?}");
            assert!(s.camera(camera).world_from_camera.is_finite());
        }
    }

    #[test]
    fn flying_goes_where_the_camera_looks() {
        let camera = &builtin::load("cornell_point").unwrap().cameras[0];
        let mut s = start();
        let made = s.camera(camera).world_from_camera;
        let [ahead, right, up] = [Vec3::NEG_Z, Vec3::X, Vec3::Y].map(|axis| made.transform_vector3(axis));
        s.fly(2.0, 0.5, -1.0);
        let expected = start().eye + ahead * 2.0 + right * 0.5 - up;
        assert!(s.eye.distance(expected) < 1e-4, "{} {expected}", s.eye);
    }
}
