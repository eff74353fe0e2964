//! Choosing the iteration's light, on the host.

use std::f32::consts::PI;

use glam::Vec3;

use crate::scene::{Cone, Lamp, Light, Pattern, SpotFalloff};

/// A light, as the shaders see it, with what choosing it cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenLight {
    /// Index into the scene's lights.
    pub index: usize,
    /// 0 point, 1 spot, 2 directional, 3 none.
    pub kind: u32,
    /// Metres; a directional light has none.
    pub position: Vec3,
    /// Axis of a spot, direction of travel of a directional light, any of a point.
    pub direction: Vec3,
    /// Intensity (W/sr) or irradiance (W/m^2) over the probability of the choice.
    pub intensity: Vec3,
    /// Cosines of the inner and outer half angle.
    pub cosines: [f32; 2],
    /// 0 squared cosine, 1 linear angle.
    pub falloff: u32,
    /// Uniform density of directions per steradian, or per square metre across a directional light.
    pub pdf: f32,
}

/// The lights of a scene with the probability of each.
pub struct Lights {
    lights: Vec<Light>,
    cumulative: Vec<f32>,
    radius: f32,
    center: Vec3,
}

impl Lights {
    /// Probabilities go with power; a directional light's power is what crosses the scene's sphere.
    #[must_use]
    pub fn new(lights: &[Light], center: Vec3, radius: f32) -> Self {
        let disc = PI * radius * radius;
        let power = |light: &Light| power(light, &[], disc).element_sum();
        // What is not a number stays: it has to show in the picture and in the count of such values.
        let shining: Vec<_> = lights.iter().map(bare).filter(|l| power(l) > 0.0 || power(l).is_nan()).collect();
        let total: f64 = shining.iter().map(|l| f64::from(power(l))).sum();
        let mut sum = 0.0;
        let cumulative = shining
            .iter()
            .map(|l| {
                sum += f64::from(power(l));
                (sum / total) as f32
            })
            .collect();
        Self { lights: shining, cumulative, radius, center }
    }

    /// Number of lights that shine.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lights.len()
    }

    /// Whether none shines.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Chooses a light by a number in [0, 1).
    #[must_use]
    pub fn choose(&self, u: f32) -> Option<ChosenLight> {
        let index = self.cumulative.partition_point(|&c| c <= u).min(self.lights.len().checked_sub(1)?);
        let below = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let probability = self.cumulative[index] - below;
        let chosen = ChosenLight {
            index,
            kind: 0,
            position: Vec3::ZERO,
            direction: Vec3::Z,
            intensity: Vec3::ZERO,
            cosines: [1.0, -1.0],
            falloff: 0,
            pdf: 1.0 / (4.0 * PI),
        };
        Some(match self.lights[index] {
            Light::Point { position, intensity } => {
                ChosenLight { position, intensity: intensity / probability, ..chosen }
            }
            Light::Spot { position, direction, intensity, inner_angle, outer_angle, falloff } => ChosenLight {
                kind: 1,
                position,
                direction,
                intensity: intensity / probability,
                cosines: [inner_angle.min(outer_angle).cos(), outer_angle.cos()],
                falloff: u32::from(falloff == SpotFalloff::AngleLinear),
                pdf: 1.0 / (2.0 * PI * (1.0 - outer_angle.cos()).max(1e-6)),
                ..chosen
            },
            Light::Directional { direction, irradiance } => ChosenLight {
                kind: 2,
                position: self.center,
                direction,
                intensity: irradiance / probability,
                pdf: 1.0 / (PI * self.radius * self.radius),
                ..chosen
            },
            Light::Lamp(_) | Light::Sun { .. } => unreachable!("made bare"),
        })
    }
}

/// A light without its size and pattern.
fn bare(light: &Light) -> Light {
    match *light {
        Light::Sun { direction, irradiance, .. } => Light::Directional { direction, irradiance },
        Light::Lamp(Lamp { position, intensity, cone: None, .. }) => Light::Point { position, intensity },
        Light::Lamp(
            lamp @ Lamp { position, intensity, cone: Some(Cone { inner_angle, outer_angle, falloff }), .. },
        ) => Light::Spot { position, direction: lamp.direction(), intensity, inner_angle, outer_angle, falloff },
        light => light,
    }
}

/// Watts of a light, per channel; of a directional one, what crosses a disc of the given area.
#[must_use]
pub fn power(light: &Light, patterns: &[Pattern], disc: f32) -> Vec3 {
    match *light {
        Light::Point { intensity, .. } => 4.0 * PI * intensity,
        Light::Spot { intensity, outer_angle, .. } => 2.0 * PI * (1.0 - outer_angle.cos()) * intensity,
        Light::Directional { irradiance, .. } | Light::Sun { irradiance, .. } => disc * irradiance,
        Light::Lamp(lamp) => lamp.power(patterns),
    }
}

/// Unit direction at a given cosine and azimuth around `axis`.
#[must_use]
pub fn around(axis: Vec3, cosine: f32, angle: f32) -> Vec3 {
    let (right, up) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    ((right * angle.cos() + up * angle.sin()) * sine + axis * cosine).normalize()
}

/// Uniform direction over the sphere.
#[must_use]
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    around(Vec3::Z, 1.0 - 2.0 * u, 2.0 * PI * v)
}
