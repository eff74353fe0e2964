//! One path from the camera: light met by chance and light sampled at every vertex, weighted by the power heuristic.
//!
//! Vertex 0 is what the camera sees. Light that a ray runs into at vertex i has bounced i - 1 times, light sampled at vertex i
//! has bounced i times. Where the shading normal differs from the triangle's, light passes only if each direction is on the same
//! side of both.
//!
//! A path remembers which medium it entered last, and a surface's back says which medium lies before it; so nested volumes lose
//! what the outer one absorbs only between an inner one's exit and something that is not a volume.

use glam::{Vec2, Vec3};

use super::Reference;
use super::bsdf::Bsdf;
use super::bvh::{Hit, NONE};
use super::lights::{Group, LightSample, Target};
use super::sampler::Sampler;
use super::surface::Surface;
use crate::scene::Sides;

/// Vertices before Russian roulette begins.
const ROULETTE_FROM: u32 = 3;

/// What one path brought back.
pub struct Path {
    /// Radiance towards the camera.
    pub radiance: Vec3,
    /// Rays traced.
    pub rays: u32,
}

/// A vertex of a path, as light arrives there.
struct Vertex<'v> {
    surface: &'v Surface<'v>,
    hit: &'v Hit,
    bsdf: &'v Bsdf,
    wo: Vec3,
    /// What is absorbed per metre on the viewer's side and beyond.
    media: [Vec3; 2],
}

/// Beer's law over a distance, which may be infinite.
fn transmittance(absorption: Vec3, distance: f32) -> Vec3 {
    if absorption == Vec3::ZERO { Vec3::ONE } else { (-absorption * distance.min(f32::MAX)).exp() }
}

/// Veach's power heuristic with exponent 2, for densities of the same path by two techniques.
fn power_heuristic(taken: f32, other: f32) -> f32 {
    if taken.is_infinite() {
        return 1.0;
    }
    let ratio = other / taken;
    1.0 / (1.0 + ratio * ratio)
}

impl Reference<'_> {
    /// Follows a path that leaves the camera along a unit direction.
    pub(super) fn path(&self, origin: Vec3, direction: Vec3, bounces: Option<u32>, sampler: &mut Sampler) -> Path {
        let mut path = Path { radiance: Vec3::ZERO, rays: 0 };
        let mut throughput = Vec3::ONE;
        let mut medium = Vec3::ZERO;
        let (mut origin, mut direction, mut exclude) = (origin, direction, NONE);
        // Density of the last direction, once there is a technique that it competes with, and the vertex where it was drawn.
        let mut pdf_w = None;
        // Light samples of a group that a vertex takes, on average.
        let light_samples = |vertex: u32, group| if vertex == 0 { 1.0 } else { self.lights.group_probability(group) };
        for vertex in 0.. {
            path.rays += 1;
            let start = self.step_off(origin, direction, exclude);
            let Some(hit) =
                self.bvh.closest(start, direction, f32::INFINITY, exclude, |hit| self.visible(hit, direction, vertex))
            else {
                if let Some(sky) = &self.sky {
                    let weight = pdf_w.map_or(1.0, |pdf| {
                        power_heuristic(pdf, light_samples(vertex - 1, Group::Sky) * sky.pdf_w(direction))
                    });
                    path.radiance += throughput * sky.radiance(direction) * weight;
                }
                break;
            };
            let surface = self.surfaces.at(&hit, direction);
            let [here, beyond] = surface.media(medium);
            throughput *= transmittance(here, hit.t);

            // Light that the ray ran into.
            let emitted = self.surfaces.emitted(&hit, surface.front);
            if emitted != Vec3::ZERO {
                let weight = pdf_w.map_or(1.0, |pdf| {
                    let cos = surface.normal.dot(direction).abs();
                    let distance = surface.position.distance(origin);
                    let light_pdf_w = self.lights.triangle_pdf_w(hit.triangle, hit.bary, distance, cos);
                    power_heuristic(pdf, light_samples(vertex - 1, Group::Triangles) * light_pdf_w)
                });
                path.radiance += throughput * emitted * weight;
            }
            if bounces.is_some_and(|bounces| vertex > bounces) {
                break;
            }
            let Some(bsdf) = self.surfaces.bsdf(&surface) else { break };
            let wo = surface.frame.local(-direction);
            if wo.z <= 0.0 {
                break;
            }

            // Light that is looked for.
            let mut look = |group, chance, u| {
                let vertex = Vertex { surface: &surface, hit: &hit, bsdf: &bsdf, wo, media: [here, beyond] };
                path.radiance += throughput * self.direct(&vertex, (group, chance, u), &mut path.rays);
            };
            match *self.lights.groups() {
                [] => (),
                _ if bsdf.smooth(wo) => (),
                [group] => look(group, 1.0, if self.lights.random(group) { sampler.pair() } else { Vec2::ZERO }),
                ref groups if vertex == 0 => {
                    groups.iter().for_each(|&group| look(group, 1.0, sampler.pair()));
                }
                _ => {
                    let u = sampler.pair();
                    let (group, chance, x) = self.lights.choose_group(u.x);
                    look(group, chance, Vec2::new(x, u.y));
                }
            }
            if bounces == Some(vertex) && !self.emitters_can_be_hit {
                break;
            }

            // The way on.
            let u = sampler.pair();
            let fork = if bsdf.transmits() { sampler.pair().x } else { 0.0 };
            let Some(sample) = bsdf.sample(wo, u, fork) else { break };
            let wi = surface.frame.world(sample.wi);
            if wi.dot(surface.normal) * sample.wi.z <= 0.0 {
                break;
            }
            throughput *= sample.weight;
            if vertex >= ROULETTE_FROM {
                // Radiance that is only denser or thinner in the other medium is not lost.
                let kept = sample.weight.max_element() * sample.eta * sample.eta;
                let survival = kept.min(0.95);
                if sampler.pair().x >= survival {
                    break;
                }
                throughput /= survival;
            }
            if throughput == Vec3::ZERO {
                break;
            }
            (origin, direction, exclude) = (surface.position, wi, hit.triangle);
            pdf_w = sample.pdf_w;
            medium = if sample.wi.z > 0.0 { here } else { beyond };
        }
        path
    }

    /// Whether a path's ray stops at a hit: not in the holes of a mask, and the camera sees through culled backs, except of glass.
    pub(super) fn visible(&self, hit: &Hit, direction: Vec3, vertex: u32) -> bool {
        let material = self.surfaces.material(hit.triangle);
        let culled = vertex == 0
            && material.sides == Sides::OneCulled
            && !material.bsdf.transmits()
            && self.surfaces.normals[hit.triangle as usize].dot(direction) >= 0.0;
        !culled && self.surfaces.solid(hit)
    }

    /// One light sample at a vertex, of a group that was chosen with a probability.
    fn direct(&self, vertex: &Vertex, (group, chance, u): (Group, f32, Vec2), rays: &mut u32) -> Vec3 {
        let &Vertex { surface, hit, bsdf, wo, media: [here, beyond] } = vertex;
        let (geometry, sky) = (&self.surfaces.geometry, self.sky.as_ref());
        let facing = (!bsdf.transmits()).then_some(surface.frame.z);
        let Some(sample) = self.lights.sample(group, surface.position, facing, u, geometry, sky) else {
            return Vec3::ZERO;
        };
        let wi = surface.frame.local(sample.direction);
        if sample.direction.dot(surface.normal) * wi.z <= 0.0 {
            return Vec3::ZERO;
        }
        let (value, pdf_w) = bsdf.evaluate(wo, wi);
        if value == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let arriving = sample.weight * self.radiance_of(&sample);
        if arriving == Vec3::ZERO {
            return Vec3::ZERO;
        }
        *rays += 1;
        let (blocked, distance) = match sample.target {
            Target::Point { position, triangle, .. } => {
                let end = (triangle != NONE).then_some(triangle);
                let blocked = self.occluded(surface.position, position, Some(hit.triangle), end);
                (blocked, surface.position.distance(position))
            }
            Target::Infinity => {
                let start = self.step_off(surface.position, sample.direction, hit.triangle);
                let solid = |hit: &Hit| self.surfaces.solid(hit);
                (self.bvh.any(start, sample.direction, f32::INFINITY, [hit.triangle, NONE], solid), f32::INFINITY)
            }
        };
        if blocked {
            return Vec3::ZERO;
        }
        value
            * arriving
            * transmittance(if wi.z > 0.0 { here } else { beyond }, distance)
            * (sample.pdf_w.map_or(1.0, |light_pdf_w| power_heuristic(chance * light_pdf_w, pdf_w)) / chance)
    }

    /// What a light with extent sends from the sampled point; 1 for the others, whose weight says all.
    fn radiance_of(&self, sample: &LightSample) -> Vec3 {
        match (sample.pdf_w, sample.target) {
            (None, _) => Vec3::ONE,
            (Some(_), Target::Infinity) => self.sky.as_ref().map_or(Vec3::ZERO, |sky| sky.radiance(sample.direction)),
            (Some(_), Target::Point { triangle, bary, .. }) => {
                let hit = Hit { triangle, t: 0.0, bary };
                let front = self.surfaces.normals[triangle as usize].dot(sample.direction) < 0.0;
                if self.surfaces.solid(&hit) { self.surfaces.emitted(&hit, front) } else { Vec3::ZERO }
            }
        }
    }
}
