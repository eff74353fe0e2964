//! Next-event estimation: lights in three groups, within which they are chosen by power.
//!
//! The groups are lights without extent, emissive triangles (area times mean emission) and a mapped sky. Where the camera looks,
//! each group gets a sample of its own; further down a path one group is chosen, half by power and half evenly, because a sun or
//! a lamp may be strong elsewhere and dark here. Lights without extent, where they are few, are chosen by what they would give
//! the receiver if nothing stood between. A constant sky is in no group: BSDF sampling alone finds it without noise from the
//! choice.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::bvh::NONE;
use super::distribution::Table;
use super::environment::{LUMINANCE, Sky};
use super::texture::Textures;
use crate::scene::{Emission, Geometry, Light, Scene, SpotFalloff};

/// Up to so many lights without extent are each looked at before one is chosen.
const FEW: usize = 16;

/// A group of lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Lights without extent.
    Delta,
    /// Emissive triangles.
    Triangles,
    /// The sky.
    Sky,
}

/// All that can be sampled.
pub struct Lights {
    delta: Vec<Light>,
    delta_table: Table,
    triangles: Vec<u32>,
    triangle_table: Table,
    /// Density per area of the points of each triangle within its group; empty where none emits.
    pdf_a: Vec<f32>,
    /// Groups that are not empty.
    groups: Vec<Group>,
    group_table: Table,
}

/// Where a light sample lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A point, on a triangle or on [`NONE`].
    Point {
        /// World space.
        position: Vec3,
        /// The triangle that it lies on.
        triangle: u32,
        /// Barycentric weights of its second and third corner.
        bary: [f32; 2],
    },
    /// Infinitely far away.
    Infinity,
}

/// A direction towards a light.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction from the receiver.
    pub direction: Vec3,
    /// What a shadow ray has to reach.
    pub target: Target,
    /// Of a light without extent: irradiance on a surface that faces it over the probability of its choice. Of one with extent:
    /// 1 / `pdf_w`, to be multiplied by the radiance there.
    pub weight: Vec3,
    /// Density per solid angle within the group; none for lights that nothing else can find.
    pub pdf_w: Option<f32>,
}

impl Lights {
    /// Gathers the lights of a scene.
    #[must_use]
    pub fn new(scene: &Scene, geometry: &Geometry, textures: &Textures, sky: Option<&Sky>) -> Self {
        let radius = 0.5 * geometry.bounds[0].distance(geometry.bounds[1]);
        let cross_section = PI * radius * radius;
        let power = |light: &Light| match *light {
            Light::Point { intensity, .. } => 2.0 * TAU * intensity.dot(LUMINANCE),
            Light::Spot { intensity, inner_angle, outer_angle, .. } => {
                TAU * (1.0 - (0.5 * (inner_angle + outer_angle)).cos()) * intensity.dot(LUMINANCE)
            }
            Light::Directional { irradiance, .. } => cross_section * irradiance.dot(LUMINANCE),
        };
        let delta_table = table(scene.lights.iter().map(power));

        let mean = |emission: &Emission| {
            let texture = emission.radiance.texture.map_or(Vec3::ONE, |t| textures.mean(&t));
            (emission.radiance.factor * texture).dot(LUMINANCE) * PI * if emission.two_sided { 2.0 } else { 1.0 }
        };
        let means: Vec<f32> = scene.materials.iter().map(|m| m.emission.as_ref().map_or(0.0, mean)).collect();
        let power = |triangle: u32| means[geometry.materials[triangle as usize] as usize] * area(geometry, triangle);
        let triangles: Vec<u32> = (0..geometry.triangles.len() as u32).filter(|&t| power(t) > 0.0).collect();
        let triangle_table = table(triangles.iter().map(|&t| power(t)));
        let mut pdf_a = vec![0.0; if triangles.is_empty() { 0 } else { geometry.triangles.len() }];
        for (at, &triangle) in triangles.iter().enumerate() {
            pdf_a[triangle as usize] = triangle_table.probability(at) / area(geometry, triangle);
        }

        let sky_power = sky.map_or(0.0, |sky| cross_section * sky.power());
        let (groups, powers): (Vec<Group>, Vec<f32>) =
            [(Group::Delta, delta_table.total()), (Group::Triangles, triangle_table.total()), (Group::Sky, sky_power)]
                .into_iter()
                .filter(|(_, power)| *power > 0.0)
                .unzip();
        let even = powers.iter().sum::<f32>() / powers.len().max(1) as f32;
        let group_table = table(powers.iter().map(|p| p + even));
        Self { delta: scene.lights.clone(), delta_table, triangles, triangle_table, pdf_a, groups, group_table }
    }

    /// The groups that are not empty.
    #[must_use]
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Whether a sample of a group needs random numbers at all.
    #[must_use]
    pub fn random(&self, group: Group) -> bool {
        group != Group::Delta || self.delta.len() > 1
    }

    /// A group, its probability, and a number for use within it.
    #[must_use]
    pub fn choose_group(&self, u: f32) -> (Group, f32, f32) {
        let (index, probability, rest) = self.group_table.sample(u);
        (self.groups[index], probability, rest)
    }

    /// Probability with which [`Self::choose_group`] chooses a group.
    #[must_use]
    pub fn group_probability(&self, group: Group) -> f32 {
        self.groups.iter().position(|&g| g == group).map_or(0.0, |at| self.group_table.probability(at))
    }

    /// Density per solid angle, within their group, with which a receiver would have sampled a point of a triangle at `distance`,
    /// seen at `cos`.
    #[must_use]
    pub fn triangle_pdf_w(&self, triangle: u32, distance: f32, cos: f32) -> f32 {
        let pdf_a = self.pdf_a.get(triangle as usize).copied().unwrap_or(0.0);
        if pdf_a > 0.0 { pdf_a * distance * distance / cos } else { 0.0 }
    }

    /// A direction from a receiver towards a light of a group; none where the light does not shine there. `facing` is the shading
    /// normal of a receiver that takes light from one side only.
    #[must_use]
    pub fn sample(
        &self,
        group: Group,
        from: Vec3,
        facing: Option<Vec3>,
        u: Vec2,
        geometry: &Geometry,
        sky: Option<&Sky>,
    ) -> Option<LightSample> {
        let extended = |direction, target, pdf_w: f32| {
            let weight = Vec3::splat(1.0 / pdf_w);
            (pdf_w > 0.0 && pdf_w.is_finite()).then_some(LightSample { direction, target, weight, pdf_w: Some(pdf_w) })
        };
        match group {
            Group::Delta => {
                let (index, probability) = self.choose_delta(from, facing, u.x)?;
                let (direction, target, irradiance) = delta(&self.delta[index], from)?;
                Some(LightSample { direction, target, weight: irradiance / probability, pdf_w: None })
            }
            Group::Triangles => {
                let (index, _, x) = self.triangle_table.sample(u.x);
                let triangle = self.triangles[index];
                let corners = geometry.positions(triangle as usize);
                let bary = uniform_triangle(Vec2::new(x, u.y));
                let position = corners[0] * (1.0 - bary[0] - bary[1]) + corners[1] * bary[0] + corners[2] * bary[1];
                let to = position - from;
                let distance = to.length();
                let direction = to / distance;
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let cos = normal.dot(direction).abs() / normal.length();
                let target = Target::Point { position, triangle, bary };
                extended(direction, target, self.triangle_pdf_w(triangle, distance, cos))
            }
            Group::Sky => {
                let (direction, pdf_w) = sky?.sample(u)?;
                extended(direction, Target::Infinity, pdf_w)
            }
        }
    }
}

impl Lights {
    /// A light without extent and its probability.
    fn choose_delta(&self, from: Vec3, facing: Option<Vec3>, u: f32) -> Option<(usize, f32)> {
        let count = self.delta.len();
        if count == 1 {
            return Some((0, 1.0));
        }
        if count > FEW {
            let (index, probability, _) = self.delta_table.sample(u);
            return Some((index, probability));
        }
        let mut gifts = [0.0; FEW];
        let mut total = 0.0;
        for (gift, light) in gifts.iter_mut().zip(&self.delta) {
            if let Some((direction, _, irradiance)) = delta(light, from) {
                let expected = irradiance.dot(LUMINANCE) * facing.map_or(1.0, |normal| direction.dot(normal).max(0.0));
                // What is not a number must be met sometimes, to be seen.
                *gift = if expected.is_finite() { expected } else { 1.0 };
                total += *gift;
            }
        }
        let mut left = u * total;
        let mut chosen = None;
        for (index, &gift) in gifts[..count].iter().enumerate().filter(|(_, gift)| **gift > 0.0) {
            chosen = Some((index, gift / total));
            left -= gift;
            if left < 0.0 {
                break;
            }
        }
        chosen
    }
}

/// A table of powers. Those that are not finite are planted errors: they are sampled like any other and show up in the image.
fn table(powers: impl Iterator<Item = f32>) -> Table {
    Table::new(&powers.map(|p| if p.is_finite() { p.max(0.0) } else { 1.0 }).collect::<Vec<_>>())
}

/// Direction to a light without extent, where its shadow ray ends, and irradiance on a surface that faces it.
fn delta(light: &Light, from: Vec3) -> Option<(Vec3, Target, Vec3)> {
    let towards = |position: Vec3| {
        let to = position - from;
        let squared = to.length_squared();
        (squared > 0.0)
            .then(|| (to / squared.sqrt(), Target::Point { position, triangle: NONE, bary: [0.0; 2] }, 1.0 / squared))
    };
    match *light {
        Light::Point { position, intensity } => {
            let (direction, target, falloff) = towards(position)?;
            Some((direction, target, intensity * falloff))
        }
        Light::Spot { position, direction: axis, intensity, inner_angle, outer_angle, falloff: shape } => {
            let (direction, target, falloff) = towards(position)?;
            let cos = -axis.dot(direction);
            let strength = spot_strength(cos, inner_angle, outer_angle, shape);
            (strength > 0.0).then(|| (direction, target, intensity * (strength * falloff)))
        }
        Light::Directional { direction, irradiance } => Some((-direction, Target::Infinity, irradiance)),
    }
}

/// How strongly a spot light shines at an angle from its axis.
fn spot_strength(cos: f32, inner: f32, outer: f32, falloff: SpotFalloff) -> f32 {
    match falloff {
        // KHR_lights_punctual: clamp((cos - cos_outer) / max(0.001, cos_inner - cos_outer))^2.
        SpotFalloff::CosineSquared => {
            let ramp = (cos - outer.cos()) / (inner.cos() - outer.cos()).max(0.001);
            ramp.clamp(0.0, 1.0).powi(2)
        }
        SpotFalloff::AngleLinear => {
            let angle = cos.clamp(-1.0, 1.0).acos();
            if angle <= inner { 1.0 } else { ((outer - angle) / (outer - inner)).clamp(0.0, 1.0) }
        }
    }
}

fn area(geometry: &Geometry, triangle: u32) -> f32 {
    let [a, b, c] = geometry.positions(triangle as usize);
    0.5 * (b - a).cross(c - a).length()
}

/// Weights of the second and third corner, uniform over the triangle (Heitz 2019, a low-distortion map).
fn uniform_triangle(u: Vec2) -> [f32; 2] {
    if u.y > u.x {
        let b = 0.5 * u.x;
        [b, u.y - b]
    } else {
        let b = 0.5 * u.y;
        [u.x - b, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spot_falloffs() {
        let (inner, outer) = (0.3_f32, 0.7_f32);
        for shape in [SpotFalloff::CosineSquared, SpotFalloff::AngleLinear] {
            assert_eq!(spot_strength(1.0, inner, outer, shape), 1.0);
            assert!((spot_strength(inner.cos(), inner, outer, shape) - 1.0).abs() < 1e-5);
            assert!(spot_strength(outer.cos(), inner, outer, shape) < 1e-5);
            assert_eq!(spot_strength(-1.0, inner, outer, shape), 0.0);
        }
        assert!((spot_strength(0.5_f32.cos(), inner, outer, SpotFalloff::AngleLinear) - 0.5).abs() < 1e-5);
        let middle = 0.5 * (inner.cos() + outer.cos());
        assert!((spot_strength(middle, inner, outer, SpotFalloff::CosineSquared) - 0.25).abs() < 1e-5);
        assert_eq!(spot_strength(0.9, 0.7, 0.7, SpotFalloff::AngleLinear), 1.0, "a hard edge is no division by zero");
        assert_eq!(spot_strength(0.1, 0.7, 0.7, SpotFalloff::AngleLinear), 0.0);
    }

    #[test]
    fn points_of_a_triangle_are_uniform() {
        // Mean and second moments of barycentric weights: 1/3 and 1/6.
        let n = 256;
        let mut sums = [0.0_f64; 4];
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let [b, c] = uniform_triangle(u).map(f64::from);
            assert!(b >= 0.0 && c >= 0.0 && b + c <= 1.0 + 1e-6);
            [b, c, b * b, c * c].iter().zip(&mut sums).for_each(|(v, s)| *s += v / f64::from(n * n));
        }
        for (sum, expected) in sums.iter().zip([1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0]) {
            assert!((sum - expected).abs() < 1e-3, "{sums:?}");
        }
    }
}
