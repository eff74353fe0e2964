//! Lights that only light sampling can find: rays cannot hit them, even if they have a radius.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};

use crate::scene::Pattern;

/// Returns 1 - cos of an angle in radians, without cancellation.
#[must_use]
pub fn versine(angle: f32) -> f32 {
    2.0 * (0.5 * angle).sin().powi(2)
}

/// Returns the angle in radians, at most pi, for a value of 1 - cos.
#[must_use]
pub fn angle_of_versine(versine: f32) -> f32 {
    2.0 * (0.5 * versine).sqrt().min(1.0).asin()
}

/// The falloff of a spot light between its inner and outer cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpotFalloff {
    /// glTF's recommendation: the square of a linear ramp in the cosine.
    CosineSquared,
    /// Mitsuba: a linear ramp in the angle.
    AngleLinear,
}

/// A light that only light sampling can find. Emissive surfaces are materials, the sky is the environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// An isotropic point light.
    Point {
        /// Metres, world space.
        position: Vec3,
        /// Radiant intensity, W/sr (1 cd is read as 1 W/sr).
        intensity: Vec3,
    },
    /// A spot light: a point light restricted to a cone.
    Spot {
        /// Metres, world space.
        position: Vec3,
        /// Unit axis of the cone, away from the light.
        direction: Vec3,
        /// Radiant intensity on the axis, W/sr.
        intensity: Vec3,
        /// Half angle in radians inside which the intensity is full.
        inner_angle: f32,
        /// Half angle in radians outside which the intensity is zero.
        outer_angle: f32,
        /// Falloff between the two angles.
        falloff: SpotFalloff,
    },
    /// A directional light at infinity.
    Directional {
        /// Unit direction in which light travels.
        direction: Vec3,
        /// Irradiance on a surface that faces it, W/m^2 (1 lx is read as 1 W/m^2).
        irradiance: Vec3,
    },
    /// A point or spot light with a radius or a pattern.
    Lamp(Lamp),
    /// A uniformly bright disc at infinity. Rays cannot hit it: neither the camera nor mirrors see the disc.
    Sun {
        /// Unit direction in which light from the disc's centre travels.
        direction: Vec3,
        /// Irradiance on a surface that faces it, W/m^2.
        irradiance: Vec3,
        /// Half the angle that the disc spans, radians, above 0 and at most pi / 2.
        angle: f32,
        /// True if the sun belongs to the environment and is rotated, scaled and replaced together with it.
        of_sky: bool,
    },
}

impl Light {
    /// Returns true if all light comes from one point or one direction, so that shadows are sharp.
    #[must_use]
    pub fn is_sharp(&self) -> bool {
        match self {
            Self::Point { .. } | Self::Spot { .. } | Self::Directional { .. } => true,
            Self::Lamp(lamp) => lamp.radius <= 0.0,
            Self::Sun { .. } => false,
        }
    }

    /// Returns the world-space position in metres, or `None` for an infinite light.
    #[must_use]
    pub fn position(&self) -> Option<Vec3> {
        match self {
            Self::Point { position, .. } | Self::Spot { position, .. } => Some(*position),
            Self::Lamp(lamp) => Some(lamp.position),
            Self::Directional { .. } | Self::Sun { .. } => None,
        }
    }

    /// Returns true if the light emits nothing.
    #[must_use]
    pub fn is_black(&self, patterns: &[Pattern]) -> bool {
        match self {
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => *intensity == Vec3::ZERO,
            Self::Directional { irradiance, .. } | Self::Sun { irradiance, .. } => *irradiance == Vec3::ZERO,
            Self::Lamp(lamp) => lamp.power(patterns) == Vec3::ZERO,
        }
    }
}

/// A local light of any radius and with any pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Centre, metres, world space.
    pub position: Vec3,
    /// Rotation from the lamp's own space, in which it emits along -Z and +Y is up, to the world.
    pub world_from_lamp: Mat3,
    /// Radius in metres. Light leaves a random point of a ball, whose projection from far away is a uniformly
    /// bright disc: the density of points at distance r from the centre is proportional to
    /// 1 / sqrt(radius^2 - r^2). Rays cannot hit the ball.
    pub radius: f32,
    /// Radiant intensity, W/sr, for directions in which cone and pattern are 1.
    pub intensity: Vec3,
    /// Cone that bounds the emission, if any.
    pub cone: Option<Cone>,
    /// Index into the scene's patterns, whose factors multiply the intensity.
    pub pattern: Option<usize>,
}

/// The emission cone of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Half angle in radians inside which the intensity is full.
    pub inner_angle: f32,
    /// Half angle in radians outside which the intensity is zero.
    pub outer_angle: f32,
    /// Falloff between the two angles.
    pub falloff: SpotFalloff,
}

impl Cone {
    /// Returns the relative intensity at an angle from the axis in radians.
    #[must_use]
    pub fn strength(&self, angle: f32) -> f32 {
        let ramp = |inner: f32, outer: f32, at: f32| ((at - outer) / (inner - outer)).clamp(0.0, 1.0);
        match self.falloff {
            _ if angle <= self.inner_angle => 1.0,
            _ if angle >= self.outer_angle => 0.0,
            SpotFalloff::AngleLinear => ramp(self.inner_angle, self.outer_angle, angle),
            SpotFalloff::CosineSquared => {
                ramp(versine(self.inner_angle), versine(self.outer_angle), versine(angle)).powi(2)
            }
        }
    }

    /// Returns the mean of [`Self::strength`] over the directions between two angles from the axis in
    /// radians, `from` < `to`.
    fn mean_strength(&self, from: f32, to: f32) -> f32 {
        const STEPS: u16 = 8;
        let reach = [from, to.min(self.outer_angle)];
        if reach[0] >= reach[1] {
            return 0.0;
        }
        // The steps are uniform in the cosine over the lit part of the interval.
        let [low, high] = reach.map(versine);
        let at = |i: u16| low + (high - low) * (f32::from(i) + 0.5) / f32::from(STEPS);
        let sum = (0..STEPS).map(|i| self.strength(angle_of_versine(at(i)))).sum::<f32>();
        sum / f32::from(STEPS) * ((high - low) / (versine(to) - low))
    }
}

impl Lamp {
    /// Returns the unit direction of emission.
    #[must_use]
    pub fn direction(&self) -> Vec3 {
        -self.world_from_lamp.z_axis
    }

    /// Returns the half angle in radians outside which cone or pattern are zero.
    #[must_use]
    pub fn outer_angle(&self, patterns: &[Pattern]) -> f32 {
        let cone = self.cone.map_or(PI, |c| c.outer_angle);
        self.pattern.map_or(cone, |p| cone.min(patterns[p].outer_angle()))
    }

    /// Returns the power in watts per channel.
    #[must_use]
    pub fn power(&self, patterns: &[Pattern]) -> Vec3 {
        let strength = |from: f32, to: f32| self.cone.map_or(1.0, |c| c.mean_strength(from, to));
        match self.pattern {
            Some(pattern) => self.intensity * patterns[pattern].flux(strength),
            None => self.intensity * (2.0 * PI * versine(self.outer_angle(patterns))),
        }
    }
}
