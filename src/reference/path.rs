//! One path from the camera: light met by chance and light sampled at every vertex, weighted by the power heuristic.
//!
//! Vertex 0 is what the camera sees. Light that a ray runs into at vertex i has bounced i - 1 times, light sampled at vertex i
//! has bounced i times. Where the shading normal differs from the triangle's, light passes only if both directions are on the
//! viewer's side of both.

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

            // Light that the ray ran into.
            let emitted = self.surfaces.emitted(&hit, surface.front);
            if emitted != Vec3::ZERO {
                let weight = pdf_w.map_or(1.0, |pdf| {
                    let cos = surface.normal.dot(direction).abs();
                    let light_pdf_w = self.lights.triangle_pdf_w(hit.triangle, surface.position.distance(origin), cos);
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
                let light = self.direct(&surface, &hit, &bsdf, wo, (group, chance, u), &mut path.rays);
                path.radiance += throughput * light;
            };
            match *self.lights.groups() {
                [] => (),
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
            let Some(sample) = bsdf.sample(wo, sampler.pair()) else { break };
            let wi = surface.frame.world(sample.wi);
            if wi.dot(surface.normal) <= 0.0 {
                break;
            }
            throughput *= sample.weight;
            if vertex >= ROULETTE_FROM {
                let survival = sample.weight.max_element().min(0.95);
                if sampler.pair().x >= survival {
                    break;
                }
                throughput /= survival;
            }
            if throughput == Vec3::ZERO {
                break;
            }
            (origin, direction, exclude) = (surface.position, wi, hit.triangle);
            pdf_w = Some(sample.pdf_w);
        }
        path
    }

    /// Whether a path's ray stops at a hit: not in the holes of a mask, and the camera sees through culled backs.
    fn visible(&self, hit: &Hit, direction: Vec3, vertex: u32) -> bool {
        let culled = vertex == 0
            && self.surfaces.material(hit.triangle).sides == Sides::OneCulled
            && self.surfaces.normals[hit.triangle as usize].dot(direction) >= 0.0;
        !culled && self.surfaces.solid(hit)
    }

    /// One light sample at a vertex, of a group that was chosen with a probability.
    fn direct(
        &self,
        surface: &Surface,
        hit: &Hit,
        bsdf: &Bsdf,
        wo: Vec3,
        (group, chance, u): (Group, f32, Vec2),
        rays: &mut u32,
    ) -> Vec3 {
        let (geometry, sky) = (&self.surfaces.geometry, self.sky.as_ref());
        let Some(sample) = self.lights.sample(group, surface.position, surface.frame.z, u, geometry, sky) else {
            return Vec3::ZERO;
        };
        if sample.direction.dot(surface.normal) <= 0.0 {
            return Vec3::ZERO;
        }
        let (value, pdf_w) = bsdf.evaluate(wo, surface.frame.local(sample.direction));
        if value == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let arriving = sample.weight * self.radiance_of(&sample);
        if arriving == Vec3::ZERO {
            return Vec3::ZERO;
        }
        *rays += 1;
        let blocked = match sample.target {
            Target::Point { position, triangle, .. } => {
                let end = (triangle != NONE).then_some(triangle);
                self.occluded(surface.position, position, Some(hit.triangle), end)
            }
            Target::Infinity => {
                let start = self.step_off(surface.position, sample.direction, hit.triangle);
                let solid = |hit: &Hit| self.surfaces.solid(hit);
                self.bvh.any(start, sample.direction, f32::INFINITY, [hit.triangle, NONE], solid)
            }
        };
        if blocked {
            return Vec3::ZERO;
        }
        value
            * arriving
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
