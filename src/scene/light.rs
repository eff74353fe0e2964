//! Lights without extent.

use glam::Vec3;

/// How a spot light fades between its inner and outer cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpotFalloff {
    /// glTF's recommendation: the square of a linear ramp in the cosine.
    CosineSquared,
    /// Mitsuba: a linear ramp in the angle.
    AngleLinear,
}

/// A light that only sampling can find. Emissive surfaces are materials, the sky is the environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// Shines alike in all directions.
    Point {
        /// Metres, world space.
        position: Vec3,
        /// Radiant intensity, W/sr (1 cd is read as 1 W/sr).
        intensity: Vec3,
    },
    /// Shines into a cone.
    Spot {
        /// Metres, world space.
        position: Vec3,
        /// Unit axis of the cone, away from the light.
        direction: Vec3,
        /// Radiant intensity on the axis, W/sr.
        intensity: Vec3,
        /// Half angle in radians inside which it is at full strength.
        inner_angle: f32,
        /// Half angle in radians outside which it is dark.
        outer_angle: f32,
        /// How it fades in between.
        falloff: SpotFalloff,
    },
    /// Parallel light from infinitely far away.
    Directional {
        /// Unit direction in which light travels.
        direction: Vec3,
        /// Irradiance on a surface that faces it, W/m^2 (1 lx is read as 1 W/m^2).
        irradiance: Vec3,
    },
}
