//! The side of the pixel squares of interleaved sampling, from the cost model.

use crate::gpu::Capabilities;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::cost::{Cost, Work};
use crate::render::shared::plan::strategies::Extension;
use crate::render::shared::plan::views::{PlannedView, ViewRole};
use crate::scene::SceneStats;
use crate::settings::{Settings, Strategies};

impl FramePlan {
    /// Chooses the side of the squares of interleaved sampling, and returns the reason.
    pub(super) fn choose_side(&self, stats: &SceneStats, settings: &Settings) -> (u32, String) {
        if let Some(side) = settings.interleave {
            return (side, "as asked for".to_owned());
        }
        let noisy = self.connections.iter().any(|c| !self.is_clear(c)) || !self.extensions.is_empty();
        let one = match () {
            () if self.list_lengths => "lengths of lists are not filtered",
            () if settings.only.is_some() => "one strategy alone is not filtered",
            () if settings.strategies != Strategies::All => "only the set of all strategies is filtered by default",
            () if self.reuse.is_some() => "--light-sampling restir reuses pictures that are not filtered",
            () if settings.aperture.map_or(stats.lens, |radius| radius > 0.0) => {
                "a lens needs many iterations, since each samples one point on it"
            }
            () if !noisy => "no light has noise that a filter could reduce",
            () => "",
        };
        if !one.is_empty() {
            return (1, format!("auto: {one}"));
        }
        let Cost { fills, gains, .. } = self.cost;
        let (side, share) = (self.cost.side(), 100.0 * self.cost.share());
        let bound = match side {
            _ if side == gains => "; a larger side gains little, since edges need several iterations",
            _ if side == fills => "; pixels are few for a larger side",
            _ => "",
        };
        (side, format!("auto: by the model a light subpath takes {share:.1} % of the time of all pixels{bound}"))
    }

    /// Returns the work of an iteration for the cost model.
    pub(super) fn work(&self, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> Work {
        // Maps around lights without extent are kept if each light has its own.
        let only_light = stats.lights == 1 && !self.starts_from_emitters;
        let kept = |role: ViewRole| match (role, self.direct_lights) {
            (ViewRole::LightVertex(0), 0) => only_light && stats.sharp_lights == 1,
            (ViewRole::LightVertex(0), _) => stats.sharp_lights > 0,
            (ViewRole::Light(light), _) => (light as usize) < stats.sharp_lights,
            _ => false,
        };
        let other_candidates = if self.has_candidates() { u64::from(self.light_candidates - 1) } else { 0 };
        let fills = |role: ViewRole| if role == ViewRole::Candidate(0) { other_candidates } else { 1 };
        let is_filled = |view: &PlannedView| !self.ray_views.answer(view.role) && !kept(view.role);
        let filled: Vec<_> = self.views().into_iter().filter(is_filled).collect();
        // Few paths are longer than the bounces.
        let usual = self.most_vertices - self.specular_bounces;
        let goes_on = |e: &&Extension| e.j < usual || (e.j == usual && e.hits_emitter);
        let extensions = self.extensions.iter().filter(goes_on).count() as u64;
        let connections = || self.connections.iter().filter(|c| c.j <= usual);
        let traced = |from_lights: bool| -> u64 {
            let by_rays = if from_lights { self.ray_views.lights } else { self.ray_views.vpls };
            let connections = connections().filter(|c| by_rays && (c.s == 1) == from_lights);
            connections.map(|c| u64::from(self.points_connected(c))).sum()
        };
        let traced_to_lights = traced(true) + if self.ray_views.lights { other_candidates } else { 0 };
        Work {
            // Counts that vary with the view are rounded up to an eighth, so that frames of an animation have
            // the same side.
            triangles: stats.triangle_room() as u64,
            views: filled.iter().map(|view| fills(view.role)).sum(),
            texels: filled.iter().map(|&PlannedView { role, texels }| fills(role) * texels.count()).sum(),
            pixels: self.grid.layer().iter().map(|&side| u64::from(side)).product(),
            connections: connections().map(|c| u64::from(self.points_connected(c))).sum::<u64>() + other_candidates,
            extensions,
            traced_connections: traced(false) + traced_to_lights,
            traced_to_infinity: if self.light_extents.infinite { traced_to_lights } else { 0 },
            traced_extensions: if self.ray_views.bundles { extensions } else { 0 },
            traces_camera: self.traces_camera,
            glossy: self.glossy(),
            narrow_metals: stats.narrow_metals && !self.own_directions,
            filtered: !settings.unfiltered,
            software: capabilities.software,
        }
    }
}
