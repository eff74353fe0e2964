//! Lights that only sampling can find: without extent, or with one that nothing meets.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};

use super::Pattern;

/// 1 - cos of an angle in radians, without cancellation.
#[must_use]
pub fn versine(angle: f32) -> f32 {
    2.0 * (0.5 * angle).sin().powi(2)
}

/// The angle in radians, at most pi, whose 1 - cos this is.
#[must_use]
pub fn angle_of_versine(versine: f32) -> f32 {
    2.0 * (0.5 * versine).sqrt().min(1.0).asin()
}

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
    /// A point or spot light with more to it: a radius, a pattern.
    Lamp(Lamp),
    /// Light from an evenly bright disc infinitely far away. Nothing meets it: neither camera nor mirrors see the disc.
    Sun {
        /// Unit direction in which light from its middle travels.
        direction: Vec3,
        /// Irradiance on a surface that faces it, W/m^2.
        irradiance: Vec3,
        /// Half the angle that the disc spans, radians, above 0 and at most pi / 2.
        angle: f32,
        /// Whether it belongs to the environment: it turns, fades and goes with that.
        of_sky: bool,
    },
}

impl Light {
    /// Whether all its light comes from one point or in one direction, so that its shadows are sharp.
    #[must_use]
    pub fn is_sharp(&self) -> bool {
        match self {
            Self::Point { .. } | Self::Spot { .. } | Self::Directional { .. } => true,
            Self::Lamp(lamp) => lamp.radius <= 0.0,
            Self::Sun { .. } => false,
        }
    }

    /// Where it is, metres, world space; nowhere if infinitely far away.
    #[must_use]
    pub fn position(&self) -> Option<Vec3> {
        match self {
            Self::Point { position, .. } | Self::Spot { position, .. } => Some(*position),
            Self::Lamp(lamp) => Some(lamp.position),
            Self::Directional { .. } | Self::Sun { .. } => None,
        }
    }

    /// Whether nothing comes from it.
    #[must_use]
    pub fn is_black(&self, patterns: &[Pattern]) -> bool {
        match self {
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => *intensity == Vec3::ZERO,
            Self::Directional { irradiance, .. } | Self::Sun { irradiance, .. } => *irradiance == Vec3::ZERO,
            Self::Lamp(lamp) => lamp.power(patterns) == Vec3::ZERO,
        }
    }
}

/// A light at a place, of any size and with any pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Its middle, metres, world space.
    pub position: Vec3,
    /// Rotation from its own space, where it shines along -Z and +Y is up, to the world.
    pub world_from_lamp: Mat3,
    /// Metres. Light leaves a random point of the ball, which from afar looks like an evenly bright disc: of the points
    /// of the ball, those at r from the middle have a density in proportion to 1 / sqrt(radius^2 - r^2). Nothing meets it.
    pub radius: f32,
    /// Radiant intensity, W/sr, where cone and pattern are 1.
    pub intensity: Vec3,
    /// Only shines into this, if any.
    pub cone: Option<Cone>,
    /// Index into the scene's patterns, whose factors multiply the intensity.
    pub pattern: Option<usize>,
}

/// Where a lamp shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Half angle in radians inside which it is at full strength.
    pub inner_angle: f32,
    /// Half angle in radians outside which it is dark.
    pub outer_angle: f32,
    /// How it fades in between.
    pub falloff: SpotFalloff,
}

impl Cone {
    /// What is left of the intensity at an angle from the axis, radians.
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

    /// The mean of it over the directions between two angles from the axis, radians, the second one larger.
    fn mean_strength(&self, from: f32, to: f32) -> f32 {
        const STEPS: u16 = 8;
        let reach = [from, to.min(self.outer_angle)];
        if reach[0] >= reach[1] {
            return 0.0;
        }
        // Even in the cosine, of the part that is lit.
        let [low, high] = reach.map(versine);
        let at = |i: u16| low + (high - low) * (f32::from(i) + 0.5) / f32::from(STEPS);
        let sum = (0..STEPS).map(|i| self.strength(angle_of_versine(at(i)))).sum::<f32>();
        sum / f32::from(STEPS) * ((high - low) / (versine(to) - low))
    }
}

impl Lamp {
    /// The unit direction in which it shines.
    #[must_use]
    pub fn direction(&self) -> Vec3 {
        -self.world_from_lamp.z_axis
    }

    /// Half angle in radians outside which it is dark, by its cone or its pattern.
    #[must_use]
    pub fn outer_angle(&self, patterns: &[Pattern]) -> f32 {
        let cone = self.cone.map_or(PI, |c| c.outer_angle);
        self.pattern.map_or(cone, |p| cone.min(patterns[p].outer_angle()))
    }

    /// Power, watts, per channel.
    #[must_use]
    pub fn power(&self, patterns: &[Pattern]) -> Vec3 {
        let strength = |from: f32, to: f32| self.cone.map_or(1.0, |c| c.mean_strength(from, to));
        match self.pattern {
            Some(pattern) => self.intensity * patterns[pattern].flux(strength),
            None => self.intensity * (2.0 * PI * versine(self.outer_angle(patterns))),
        }
    }
}
