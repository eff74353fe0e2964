//! Next-event estimation: lights form three groups, within which one light is chosen by power.
//!
//! The groups are delta lights (and lights with a size that BSDF sampling cannot hit), parts of emissive
//! triangles (weighted by area times mean emission), and a mapped sky. At the camera's vertex each group has
//! a sample of its own. Later vertices choose one group, half by power and half uniformly, because a sun or a
//! lamp may be strong elsewhere and dark here. If there are few lights in the first group, they are chosen by
//! their unoccluded contribution at the receiver. A constant sky is in no group: BSDF sampling finds it
//! without the variance of choosing a group.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::bvh::NONE;
use super::distribution::Table;
use super::environment::{LUMINANCE, Sky};
use super::surface::Frame;
use crate::scene::model::emitter::{self, Part};
use crate::scene::{Cone, Geometry, Lamp, Light, Mapping, Pattern, Scene, SpotFalloff, angle_of_versine, versine};

/// Largest number of delta lights that are chosen by their contribution at the receiver.
const FEW: usize = 16;

/// A group of lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Lights that BSDF sampling cannot hit.
    Delta,
    /// Emissive triangles.
    Triangles,
    /// The sky.
    Sky,
}

/// All lights that can be sampled.
pub struct Lights<'s> {
    delta: &'s [Light],
    patterns: &'s [Pattern],
    delta_table: Table,
    /// Parts of emissive triangles; those of one triangle are consecutive.
    parts: Vec<(u32, Part)>,
    part_table: Table,
    /// First part, number of parts along a side and area of a part, per triangle; empty if no triangle emits.
    emitters: Vec<(u32, u32, f32)>,
    /// Groups that are not empty.
    groups: Vec<Group>,
    group_table: Table,
}

/// Endpoint of a light sample.
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
    /// A point at infinity.
    Infinity,
}

/// A sampled direction towards a light.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Unit direction from the receiver.
    pub direction: Vec3,
    /// Endpoint of the shadow ray.
    pub target: Target,
    /// For a light that BSDF sampling cannot hit: irradiance on a surface that faces it, divided by the
    /// probability of its choice. For one that it can hit: 1 / `pdf_w`, to be multiplied by the radiance at
    /// the endpoint.
    pub weight: Vec3,
    /// Density per solid angle within the group; none for lights that BSDF sampling cannot hit.
    pub pdf_w: Option<f32>,
}

impl<'s> Lights<'s> {
    /// Collects the lights of a scene.
    #[must_use]
    pub fn new(scene: &'s Scene, geometry: &Geometry, sky: Option<&Sky>) -> Self {
        let radius = 0.5 * geometry.bounds[0].distance(geometry.bounds[1]);
        let cross_section = PI * radius * radius;
        let power = |light: &Light| match *light {
            Light::Point { intensity, .. } => 2.0 * TAU * intensity.dot(LUMINANCE),
            Light::Spot { intensity, inner_angle, outer_angle, .. } => {
                TAU * versine(0.5 * (inner_angle + outer_angle)) * intensity.dot(LUMINANCE)
            }
            Light::Directional { irradiance, .. } | Light::Sun { irradiance, .. } => {
                cross_section * irradiance.dot(LUMINANCE)
            }
            Light::Lamp(lamp) => lamp.power(&scene.patterns).dot(LUMINANCE),
        };
        let delta_table = table(scene.lights.iter().map(power));

        let (mut parts, mut powers, mut emitters) = (Vec::new(), Vec::new(), Vec::new());
        for emitter in emitter::emitters(scene, geometry) {
            emitters.resize(geometry.triangles.len(), (0, 0, 0.0));
            let of_all = (emitter.parts * emitter.parts) as f32;
            emitters[emitter.triangle as usize] =
                (parts.len() as u32, emitter.parts, area(geometry, emitter.triangle) / of_all);
            let of_triangle = 0..emitter.powers.len() as u32;
            parts.extend(of_triangle.map(|index| (emitter.triangle, emitter::part(emitter.parts, index))));
            powers.extend(emitter.powers);
        }
        let part_table = table(powers.into_iter());

        let sky_power = sky.map_or(0.0, |sky| cross_section * sky.power());
        let (groups, powers): (Vec<Group>, Vec<f32>) =
            [(Group::Delta, delta_table.total()), (Group::Triangles, part_table.total()), (Group::Sky, sky_power)]
                .into_iter()
                .filter(|(_, power)| *power > 0.0)
                .unzip();
        let even = powers.iter().sum::<f32>() / powers.len().max(1) as f32;
        let group_table = table(powers.iter().map(|p| p + even));
        let (delta, patterns) = (&scene.lights[..], &scene.patterns[..]);
        Self { delta, patterns, delta_table, parts, part_table, emitters, groups, group_table }
    }

    /// Returns the groups that are not empty.
    #[must_use]
    pub fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Returns true if a sample of a group needs random numbers.
    #[must_use]
    pub fn random(&self, group: Group) -> bool {
        group != Group::Delta || self.delta.len() > 1 || self.delta.iter().any(has_size)
    }

    /// Chooses a group. Returns it with its probability and a rescaled random number.
    #[must_use]
    pub fn choose_group(&self, u: f32) -> (Group, f32, f32) {
        let (index, probability, rest) = self.group_table.sample(u);
        (self.groups[index], probability, rest)
    }

    /// Returns the probability with which [`Self::choose_group`] chooses a group.
    #[must_use]
    pub fn group_probability(&self, group: Group) -> f32 {
        self.groups.iter().position(|&g| g == group).map_or(0.0, |at| self.group_table.probability(at))
    }

    /// Returns the density per solid angle, within the group of triangles, with which a receiver samples a
    /// point of a triangle at `distance` and at cosine `cos` to its normal; `bary` are the weights of its
    /// second and third corner.
    #[must_use]
    pub fn triangle_pdf_w(&self, triangle: u32, bary: [f32; 2], distance: f32, cos: f32) -> f32 {
        match self.emitters.get(triangle as usize) {
            Some(&(first, parts, area)) if parts > 0 => {
                let part = first + emitter::part_of(parts, bary);
                self.part_table.probability(part as usize) / area * distance * distance / cos
            }
            _ => 0.0,
        }
    }

    /// Samples a direction from a receiver towards a light of a group; none if the light does not reach it.
    /// `facing` is the shading normal of a receiver that is lit from one side only.
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
                let (index, probability, x) = self.choose_delta(from, facing, u.x)?;
                let (direction, target, irradiance) = self.delta(&self.delta[index], from, Vec2::new(x, u.y))?;
                Some(LightSample { direction, target, weight: irradiance / probability, pdf_w: None })
            }
            Group::Triangles => {
                let (index, probability, x) = self.part_table.sample(u.x);
                let (triangle, Part { corner, size }) = self.parts[index];
                let corners = geometry.positions(triangle as usize);
                let [b, c] = uniform_triangle(Vec2::new(x, u.y));
                let bary = [corner[0] + size * b, corner[1] + size * c];
                let position = corners[0] * (1.0 - bary[0] - bary[1]) + corners[1] * bary[0] + corners[2] * bary[1];
                let to = position - from;
                let distance = to.length();
                let direction = to / distance;
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
                let cos = normal.dot(direction).abs() / normal.length();
                let target = Target::Point { position, triangle, bary };
                let area = self.emitters[triangle as usize].2;
                extended(direction, target, probability / area * distance * distance / cos)
            }
            Group::Sky => {
                let (direction, pdf_w) = sky?.sample(u)?;
                extended(direction, Target::Infinity, pdf_w)
            }
        }
    }
}

impl Lights<'_> {
    /// Chooses a delta light. Returns its index, its probability and the rescaled random number.
    fn choose_delta(&self, from: Vec3, facing: Option<Vec3>, u: f32) -> Option<(usize, f32, f32)> {
        let count = self.delta.len();
        if count == 1 {
            return Some((0, 1.0, u));
        }
        if count > FEW {
            return Some(self.delta_table.sample(u));
        }
        let mut contributions = [0.0; FEW];
        let mut total = 0.0;
        for (contribution, light) in contributions.iter_mut().zip(self.delta) {
            let expected = self.expected(light, from, facing);
            // A light whose contribution is not finite keeps a chance, so that the error shows up in the
            // image.
            *contribution = if expected.is_finite() { expected } else { 1.0 };
            total += *contribution;
        }
        let mut left = u * total;
        let mut chosen = None;
        for (index, &contribution) in
            contributions[..count].iter().enumerate().filter(|(_, contribution)| **contribution > 0.0)
        {
            chosen = Some((index, contribution / total, (left / contribution).clamp(0.0, 1.0 - f32::EPSILON / 2.0)));
            left -= contribution;
            if left < 0.0 {
                break;
            }
        }
        chosen
    }

    /// Returns the luminance of a light's unoccluded contribution at a receiver. For a lamp with a radius it
    /// is the contribution of its centre, at a distance of at least the radius.
    fn expected(&self, light: &Light, from: Vec3, facing: Option<Vec3>) -> f32 {
        match light {
            Light::Sun { irradiance, .. } => irradiance.dot(LUMINANCE),
            Light::Lamp(lamp) if lamp.radius > 0.0 => {
                lamp.intensity.dot(LUMINANCE) / lamp.position.distance_squared(from).max(lamp.radius * lamp.radius)
            }
            _ => self.delta(light, from, Vec2::ZERO).map_or(0.0, |(direction, _, irradiance)| {
                irradiance.dot(LUMINANCE) * facing.map_or(1.0, |normal| direction.dot(normal).max(0.0))
            }),
        }
    }

    /// Returns the direction to a point of a delta light, the endpoint of the shadow ray, and the irradiance
    /// on a surface that faces the light.
    fn delta(&self, light: &Light, from: Vec3, u: Vec2) -> Option<(Vec3, Target, Vec3)> {
        let towards = |position: Vec3| {
            let to = position - from;
            let squared = to.length_squared();
            (squared > 0.0).then(|| {
                (to / squared.sqrt(), Target::Point { position, triangle: NONE, bary: [0.0; 2] }, 1.0 / squared)
            })
        };
        match *light {
            Light::Point { position, intensity } => {
                let (direction, target, falloff) = towards(position)?;
                Some((direction, target, intensity * falloff))
            }
            Light::Spot { position, direction: axis, intensity, inner_angle, outer_angle, falloff: shape } => {
                let (direction, target, falloff) = towards(position)?;
                let strength = spot_strength(axis, -direction, inner_angle, outer_angle, shape);
                (strength > 0.0).then(|| (direction, target, intensity * (strength * falloff)))
            }
            Light::Directional { direction, irradiance } => Some((-direction, Target::Infinity, irradiance)),
            Light::Lamp(lamp) => {
                let (direction, target, falloff) = towards(lamp.position + point_of_ball(u) * lamp.radius)?;
                let intensity = self.intensity(&lamp, -direction);
                (intensity != Vec3::ZERO).then(|| (direction, target, intensity * falloff))
            }
            Light::Sun { direction, irradiance, angle, .. } => {
                // Directions are uniform over the cone, whose radiance is constant.
                let height = u.x * versine(angle);
                let (r, phi) = ((height * (2.0 - height)).sqrt(), TAU * u.y);
                let w = Frame::new(-direction).world(Vec3::new(r * phi.cos(), r * phi.sin(), 1.0 - height));
                // With E = L pi sin^2 for radiance L, L over the density 1 / (2 pi (1 - cos)) is 2 E / (1 +
                // cos).
                Some((w, Target::Infinity, irradiance * (2.0 / (1.0 + angle.cos()))))
            }
        }
    }

    /// Returns the intensity of a lamp towards a unit direction.
    fn intensity(&self, lamp: &Lamp, w: Vec3) -> Vec3 {
        let local = lamp.world_from_lamp.transpose() * w;
        let cone = lamp.cone.map_or(1.0, |Cone { inner_angle, outer_angle, falloff }| {
            spot_strength(lamp.direction(), w, inner_angle, outer_angle, falloff)
        });
        lamp.pattern.map_or(Vec3::ONE, |p| pattern_factor(&self.patterns[p], local)) * lamp.intensity * cone
    }
}

/// Returns true if a light is more than a point or a direction.
fn has_size(light: &Light) -> bool {
    matches!(light, Light::Sun { .. }) || matches!(light, Light::Lamp(lamp) if lamp.radius > 0.0)
}

/// Samples a point of the unit ball with density proportional to 1 / sqrt(1 - r^2), which is the orthogonal
/// projection of a uniform point of the unit 3-sphere in four dimensions. The last digits of `u` supply the
/// third random number.
fn point_of_ball(u: Vec2) -> Vec3 {
    let (a, b) = (TAU * u.y, TAU * (u.y * 4096.0).fract());
    let r = u.x.sqrt();
    Vec3::new(r * a.cos(), r * a.sin(), (1.0 - u.x).max(0.0).sqrt() * b.cos())
}

/// Returns a pattern's factor of the intensity towards a unit direction in the lamp's space.
fn pattern_factor(pattern: &Pattern, d: Vec3) -> Vec3 {
    let [width, height] = [pattern.width, pattern.height].map(|n| n as i64);
    let bilinear = |x: f32, y: f32, wrap: bool| {
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let texel = |dx: i64, dy: i64| {
            let column = x.floor() as i64 + dx;
            let column = if wrap { column.rem_euclid(width) } else { column.clamp(0, width - 1) };
            let row = (y.floor() as i64 + dy).clamp(0, height - 1);
            Vec3::from(pattern.texels[(row * width + column) as usize])
        };
        let [above, below] = [0, 1].map(|row| texel(0, row).lerp(texel(1, row), fx));
        above.lerp(below, fy)
    };
    match pattern.mapping {
        Mapping::Sphere => {
            let polar = d.x.hypot(d.y).atan2(-d.z);
            let turn = (d.y.atan2(d.x) / TAU).rem_euclid(1.0);
            bilinear(turn * width as f32, polar / PI * (height - 1) as f32, true)
        }
        Mapping::Image { half_extent } | Mapping::Projection { half_extent } => {
            if d.z >= 0.0 {
                return Vec3::ZERO;
            }
            let at = Vec2::new(d.x, -d.y) / (-d.z * half_extent);
            if at.abs().max_element() > 1.0 {
                return Vec3::ZERO;
            }
            let at = (at * 0.5 + 0.5) * Vec2::new(width as f32, height as f32) - 0.5;
            let value = bilinear(at.x, at.y, false);
            if matches!(pattern.mapping, Mapping::Projection { .. }) { value / (-d.z).powi(3) } else { value }
        }
    }
}

/// Returns the sampling table of powers. Powers that are not finite, which the tests plant as errors, are
/// replaced by 1, so that such lights are sampled and show up in the image.
fn table(powers: impl Iterator<Item = f32>) -> Table {
    Table::new(&powers.map(|p| if p.is_finite() { p.max(0.0) } else { 1.0 }).collect::<Vec<_>>())
}

/// Returns a spot light's factor of the intensity towards the unit direction `w`.
fn spot_strength(axis: Vec3, w: Vec3, inner: f32, outer: f32, falloff: SpotFalloff) -> f32 {
    // Computes 1 - cos of the angle between the vectors without cancellation.
    let height = 0.5 * axis.distance_squared(w);
    let [full, dark] = [inner, outer].map(versine);
    match falloff {
        _ if height <= full => 1.0,
        _ if height >= dark => 0.0,
        // KHR_lights_punctual: ((cos - cos_outer) / (cos_inner - cos_outer))^2.
        SpotFalloff::CosineSquared => ((dark - height) / (dark - full)).powi(2),
        SpotFalloff::AngleLinear => ((outer - angle_of_versine(height)) / (outer - inner)).clamp(0.0, 1.0),
    }
}

fn area(geometry: &Geometry, triangle: u32) -> f32 {
    let [a, b, c] = geometry.positions(triangle as usize);
    0.5 * (b - a).cross(c - a).length()
}

/// Returns the barycentric weights of the second and third corner, uniform over the triangle (Heitz 2019, "A
/// Low-Distortion Map Between Triangle and Square").
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
        use SpotFalloff::{AngleLinear, CosineSquared};
        let at = |angle: f32, inner: f32, outer: f32, shape: SpotFalloff| {
            spot_strength(Vec3::Y, Vec3::new(0.0, angle.cos(), angle.sin()), inner, outer, shape)
        };
        // These cones are also narrower than the cosine's resolution in 32 bits.
        for scale in [1.0, 1e-3, 1e-5, 1e-7] {
            let (inner, outer) = (0.3 * scale, 0.7 * scale);
            for shape in [CosineSquared, AngleLinear] {
                assert_eq!(at(0.0, inner, outer, shape), 1.0);
                assert!((at(inner, inner, outer, shape) - 1.0).abs() < 1e-5);
                assert!(at(outer, inner, outer, shape) < 1e-5);
                assert_eq!(at(PI, inner, outer, shape), 0.0);
            }
            assert!((at(0.5 * scale, inner, outer, AngleLinear) - 0.5).abs() < 1e-5);
            let middle = angle_of_versine(0.5 * (versine(inner) + versine(outer)));
            assert!((at(middle, inner, outer, CosineSquared) - 0.25).abs() < 1e-5);
            assert_eq!(at(0.6 * scale, 0.7 * scale, 0.7 * scale, AngleLinear), 1.0, "a hard edge");
            assert_eq!(at(0.8 * scale, 0.7 * scale, 0.7 * scale, AngleLinear), 0.0);
        }
    }

    #[test]
    fn points_of_a_triangle_are_uniform() {
        // Mean and second moment of barycentric weights are 1/3 and 1/6.
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
