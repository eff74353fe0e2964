//! Traces one camera path: BSDF sampling and next-event estimation at every vertex, combined by the power
//! heuristic.
//!
//! Vertex 0 is the first hit of the camera ray. Emission that BSDF sampling hits at vertex i has bounced i -
//! 1 times; light sampled at vertex i has bounced i times. Where shading and geometric normal differ, a
//! direction contributes only if it is on the same side of both.
//!
//! A path stores only the medium that it entered last, and a surface's back side names the medium in front of
//! it. Nested volumes therefore lose the outer volume's absorption only between the exit from an inner one
//! and the next surface that is not a volume boundary.
//!
//! Media that disperse light refract all of a path by the index of one colour channel, which is chosen for the path.
//! From the first vertex on at which the path is inside such a medium, it holds three times this channel alone.

use std::cell::Cell;

use glam::{Vec2, Vec3};

use super::bvh::{Hit, NONE};
use super::environment::Sky;
use super::layers::Layered;
use super::lights::{Group, LightSample, Target};
use super::sampler::{Sampler, hash};
use super::surface::Surface;
use super::{Reference, ReferenceSettings};
use crate::scene::Sides;

/// Number of vertices before Russian roulette starts.
const ROULETTE_FROM: u32 = 3;

/// Result of one path.
pub struct Path {
    /// Radiance towards the camera.
    pub radiance: Vec3,
    /// Number of rays traced.
    pub rays: u32,
}

/// The lengths of paths that count.
///
/// A path of n vertices between camera and light has n - 1 bounces, less one for each vertex on glass or a perfect mirror,
/// but the one next to the light.
#[derive(Clone, Copy)]
pub struct Length {
    /// Most bounces; none leaves lengths to Russian roulette.
    bounces: Option<u32>,
    /// Number of vertices on glass and mirrors that count as no bounce, at most.
    specular: u32,
}

impl Length {
    /// Returns the lengths of the settings.
    pub fn of(settings: &ReferenceSettings) -> Self {
        Self { bounces: settings.bounces, specular: settings.specular_bounces }
    }

    /// True if a path of a number of vertices, of which a number are on glass and mirrors, may have another one.
    fn continues(self, vertices: u32, specular: u32) -> bool {
        self.bounces.is_none_or(|bounces| vertices <= bounces.saturating_add(specular.min(self.specular)))
    }
}

/// A vertex of a path, for direct lighting.
struct Vertex<'v> {
    surface: &'v Surface<'v>,
    hit: &'v Hit,
    bsdf: &'v Layered<'v>,
    wo: Vec3,
    /// Absorption coefficients on the viewer's side and on the far side, 1/m.
    media: [Vec3; 2],
    /// True if the path holds one channel alone before this vertex.
    dispersed: bool,
}

impl Vertex<'_> {
    /// Returns the factor of a path that goes on from a vertex, by the cosine of its direction to the shading normal,
    /// and whether it holds one channel alone from there on.
    fn dispersion(&self, wi_z: f32) -> (Vec3, bool) {
        if self.dispersed || !self.surface.disperses(wi_z) {
            return (Vec3::ONE, self.dispersed);
        }
        (Vec3::AXES[self.surface.channel] * 3.0, true)
    }
}

/// Transmittance by Beer's law over a distance, which may be infinite.
fn transmittance(absorption: Vec3, distance: f32) -> Vec3 {
    if absorption == Vec3::ZERO { Vec3::ONE } else { (-absorption * distance.min(f32::MAX)).exp() }
}

/// Power heuristic with exponent 2 for the densities of the same path by two techniques (Veach 1997, section
/// 9.2).
fn power_heuristic(taken: f32, other: f32) -> f32 {
    if taken.is_infinite() {
        return 1.0;
    }
    let ratio = other / taken;
    1.0 / (1.0 + ratio * ratio)
}

impl Reference<'_> {
    /// Traces a path that leaves the camera along a unit direction.
    pub(super) fn path(&self, origin: Vec3, direction: Vec3, length: Length, sampler: &mut Sampler) -> Path {
        let mut path = Path { radiance: Vec3::ZERO, rays: 0 };
        let mut throughput = Vec3::ONE;
        let mut medium = Vec3::ZERO;
        let (mut origin, mut direction, mut exclude) = (origin, direction, NONE);
        // Density of the last direction; none for camera rays and smooth lobes, which no other technique
        // samples.
        let mut pdf_w = None;
        let channel = sampler.channel();
        let mut dispersed = false;
        // Vertices on glass and mirrors, and whether the path may have another vertex.
        let (mut specular, mut continues) = (0, true);
        for vertex in 0.. {
            path.rays += 1;
            let bits = sampler.bits_of_ray(path.rays);
            let start = self.step_off(origin, direction, exclude);
            let stops = |hit: &Hit| !self.is_culled(hit, direction, vertex) && self.stops(hit, Some(direction), bits);
            let Some(hit) = self.bvh.closest(start, direction, f32::INFINITY, exclude, stops) else {
                if let Some(sky) = &self.sky {
                    let weight = pdf_w.map_or(1.0, |pdf| self.sky_mis_weight(sky, vertex, pdf, direction));
                    path.radiance += throughput * sky.radiance(direction) * weight;
                }
                break;
            };
            let mut surface = self.surfaces.at(&hit, direction, bits);
            if vertex == 0 {
                surface = surface.seen_along(-direction);
            }
            surface.channel = channel;
            let [here, beyond] = surface.media(medium);
            throughput *= transmittance(here, hit.t);

            // BSDF sampling: adds the emission of the surface that the ray has hit.
            let emitted = self.surfaces.emitted(&hit, surface.front);
            if emitted != Vec3::ZERO {
                let weight = pdf_w.map_or(1.0, |pdf| {
                    let cos = surface.normal.dot(direction).abs();
                    self.emitter_mis_weight(vertex, pdf, &hit, surface.position.distance(origin), cos)
                });
                path.radiance += throughput * emitted * weight;
            }
            if !self.scatters || !continues {
                break;
            }
            specular += u32::from(self.surfaces.is_specular(hit.triangle));
            continues = length.continues(vertex + 1, specular);
            let Some(bsdf) = self.surfaces.bsdf(&surface) else { break };
            let wo = surface.frame.local(-direction);
            if wo.z <= 0.0 {
                break;
            }

            let shaded = Vertex { surface: &surface, hit: &hit, bsdf: &bsdf, wo, media: [here, beyond], dispersed };
            self.add_direct_light(&mut path, &shaded, vertex, throughput, sampler);
            if !continues && !self.emitters_can_be_hit {
                break;
            }

            // BSDF sampling: chooses the next direction.
            let u = sampler.pair();
            let fork = if bsdf.transmits() { sampler.pair().x } else { 0.0 };
            let Some(sample) = bsdf.sample(wo, u, fork) else { break };
            let wi = surface.frame.world(sample.wi);
            if wi.dot(surface.normal) * sample.wi.z <= 0.0 {
                break;
            }
            let (one_channel, from_here) = shaded.dispersion(sample.wi.z);
            throughput *= sample.weight * one_channel;
            dispersed = from_here;
            if vertex >= ROULETTE_FROM {
                // Without eta^2, the change of radiance between media would count as loss of energy.
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

    /// Expected number of light samples that a vertex takes from a group.
    fn light_samples(&self, vertex: u32, group: Group) -> f32 {
        if vertex == 0 { 1.0 } else { self.lights.group_probability(group) }
    }

    /// Returns the MIS weight of BSDF sampling against sampling the sky, for a ray that leaves the scene
    /// before vertex `vertex`.
    fn sky_mis_weight(&self, sky: &Sky, vertex: u32, pdf_w: f32, direction: Vec3) -> f32 {
        power_heuristic(pdf_w, self.light_samples(vertex - 1, Group::Sky) * sky.pdf_w(direction))
    }

    /// Returns the MIS weight of BSDF sampling against sampling the emitter that the ray hits at vertex
    /// `vertex`.
    fn emitter_mis_weight(&self, vertex: u32, pdf_w: f32, hit: &Hit, distance: f32, cos: f32) -> f32 {
        let light_pdf_w = self.lights.triangle_pdf_w(hit.triangle, hit.bary, distance, cos);
        power_heuristic(pdf_w, self.light_samples(vertex - 1, Group::Triangles) * light_pdf_w)
    }

    /// Adds next-event estimation at a vertex. Vertex 0 takes one sample of each group; later vertices choose
    /// one.
    fn add_direct_light(&self, path: &mut Path, shaded: &Vertex, vertex: u32, throughput: Vec3, sampler: &mut Sampler) {
        let mut add = |group, probability, u| {
            path.radiance += throughput * self.direct(shaded, (group, probability, u), &mut path.rays);
        };
        match *self.lights.groups() {
            [] => (),
            _ if shaded.bsdf.smooth(shaded.wo) => (),
            [group] => add(group, 1.0, if self.lights.random(group) { sampler.pair() } else { Vec2::ZERO }),
            ref groups if vertex == 0 => {
                groups.iter().for_each(|&group| add(group, 1.0, sampler.pair()));
            }
            _ => {
                let u = sampler.pair();
                let (group, probability, x) = self.lights.choose_group(u.x);
                add(group, probability, Vec2::new(x, u.y));
            }
        }
    }

    /// Returns true if a hit is a culled back face, which camera rays pass. Those of dielectrics are not
    /// culled.
    pub(super) fn is_culled(&self, hit: &Hit, direction: Vec3, vertex: u32) -> bool {
        let material = self.surfaces.material(hit.triangle);
        vertex == 0
            && material.sides == Sides::OneCulled
            && !material.transmits()
            && self.surfaces.normals[hit.triangle as usize].dot(direction) >= 0.0
    }

    /// Returns true if a hit stops a ray, by its opacity, by the light that a clear sheet reflects, unless no direction is
    /// given, and by random bits of the ray. The decision is a hash, so that it does not depend on the order in which the
    /// hierarchy finds hits.
    fn stops(&self, hit: &Hit, direction: Option<Vec3>, bits: u32) -> bool {
        let opacity = direction.map_or_else(|| self.surfaces.opacity(hit), |along| self.surfaces.stopping(hit, along));
        let chance = || hash(bits ^ hash(hit.triangle)) as f32 / u32::MAX as f32;
        opacity > 0.0 && (opacity >= 1.0 || chance() < opacity)
    }

    /// Returns the closest hit of a camera ray, as paths find it: blended surfaces stop a share of the rays. Clear sheets
    /// stop all of them here.
    pub(super) fn seen(&self, origin: Vec3, direction: Vec3, bits: u32) -> Option<Hit> {
        let stops = |hit: &Hit| !self.is_culled(hit, direction, 0) && self.stops(hit, None, bits);
        self.bvh.closest(origin, direction, f32::INFINITY, NONE, stops)
    }

    /// Returns the share of light that passes all surfaces between 0 and `t_max`, except two triangles.
    fn passing(&self, origin: Vec3, direction: Vec3, t_max: f32, exclude: [u32; 2]) -> f32 {
        let passing = Cell::new(1.0);
        let blocks = |hit: &Hit| {
            passing.set(passing.get() * (1.0 - self.surfaces.stopping(hit, direction)));
            passing.get() == 0.0
        };
        if self.bvh.any(origin, direction, t_max, exclude, blocks) { 0.0 } else { passing.get() }
    }

    /// Returns the contribution of one light sample at a vertex, from a group that was chosen with a
    /// probability.
    fn direct(&self, vertex: &Vertex, (group, probability, u): (Group, f32, Vec2), rays: &mut u32) -> Vec3 {
        let &Vertex { surface, hit, bsdf, wo, media: [here, beyond], .. } = vertex;
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
        let (passing, distance) = match sample.target {
            Target::Point { position, triangle, .. } => {
                let (start, along) = self.segment(surface.position, position, [hit.triangle, triangle]);
                let passing = self.passing(start, along, 1.0, [hit.triangle, triangle]);
                (passing, surface.position.distance(position))
            }
            Target::Infinity => {
                let start = self.step_off(surface.position, sample.direction, hit.triangle);
                (self.passing(start, sample.direction, f32::INFINITY, [hit.triangle, NONE]), f32::INFINITY)
            }
        };
        if passing == 0.0 {
            return Vec3::ZERO;
        }
        value
            * vertex.dispersion(wi.z).0
            * arriving
            * passing
            * transmittance(if wi.z > 0.0 { here } else { beyond }, distance)
            * (sample.pdf_w.map_or(1.0, |light_pdf_w| power_heuristic(probability * light_pdf_w, pdf_w)) / probability)
    }

    /// Returns the radiance that an area light, times its opacity, or the sky emits from the sampled point; 1
    /// for other lights, whose weight includes it.
    fn radiance_of(&self, sample: &LightSample) -> Vec3 {
        match (sample.pdf_w, sample.target) {
            (None, _) => Vec3::ONE,
            (Some(_), Target::Infinity) => self.sky.as_ref().map_or(Vec3::ZERO, |sky| sky.radiance(sample.direction)),
            (Some(_), Target::Point { triangle, bary, .. }) => {
                let hit = Hit { triangle, t: 0.0, bary };
                let front = self.surfaces.normals[triangle as usize].dot(sample.direction) < 0.0;
                self.surfaces.emitted(&hit, front) * self.surfaces.opacity(&hit)
            }
        }
    }
}
