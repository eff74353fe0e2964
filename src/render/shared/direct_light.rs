//! Connections of an iteration: with one light vertex, with a point of each light, or with light candidates.

use crate::gpu::Gpu;
use crate::render::layouts::LightRecord;
use crate::render::layouts::light_kind::SKY;
use crate::render::lights::table::LightTable;
use crate::render::recording::Recording;
use crate::render::shared::build::ConnectionPass;
use crate::render::shared::film_buffer::Band;
use crate::render::shared::frame::Frame;
use crate::render::shared::passes::light::light_candidates::LightCandidates;
use crate::render::shared::passes::light::light_point::LightPoint;
use crate::render::shared::passes::paths::connect::{Connect, ConnectInputs};
use crate::render::shared::plan::views::ViewRole;
use crate::render::shared::strategy_uniforms::StrategyUniforms;

impl Frame {
    /// Connects z_j of a band with the light vertex of a strategy. Does nothing without lights.
    pub(super) fn connect(&self, recording: &mut Recording, band: &Band, connection: &ConnectionPass) {
        let Some(light_point) = self.passes.light_point.as_ref().filter(|_| !self.light_points.is_empty()) else {
            return;
        };
        match (&connection.pass, &self.passes.light_candidates) {
            (Some(pass), _) => self.connect_points(recording, band, connection, pass, light_point),
            (None, Some(candidates)) => {
                self.direct_light_from_candidates(recording, band, &connection.strategies, light_point, candidates);
            }
            (None, None) => {}
        }
    }

    /// Connects with a VPL, or with the light points: by rays all at once, by maps one after the other.
    fn connect_points(
        &self,
        recording: &mut Recording,
        band: &Band,
        ConnectionPass { connection, strategies, .. }: &ConnectionPass,
        pass: &Connect,
        light_point: &LightPoint,
    ) {
        let inputs = |strategy, view, y0| ConnectInputs {
            strategy,
            view,
            y0,
            light_vertices: &self.light_vertices,
            rsm: self.passes.rsm.as_ref().map(|rsm| &rsm.table),
            guide: self.passes.guide(),
        };
        if self.plan.connects_by_rays(connection) {
            pass.record(recording, band, &inputs(strategies.all(), None, light_point.points.as_entire_binding()));
            return;
        }
        let count = self.plan.points_connected(connection) as usize;
        for (n, start) in self.light_points.iter().enumerate().take(count) {
            let vertex = ViewRole::LightVertex(connection.s - 1);
            let map = if connection.s == 1 { self.plan.light_view(start.light) } else { vertex };
            let y0 = light_point.point(&mut recording.encoder, n).as_entire_binding();
            pass.record(recording, band, &inputs(strategies.of(start.light), Some(self.views.get(map)), y0));
        }
    }

    /// Adds direct light from candidates: each pixel selects one, then rays test visibility, or the maps one after the
    /// other. With reuse the maps exist already, and each pixel's selection competes with the reservoirs of
    /// the last iteration.
    fn direct_light_from_candidates(
        &self,
        recording: &mut Recording,
        band: &Band,
        strategies: &StrategyUniforms,
        light_point: &LightPoint,
        candidates: &LightCandidates,
    ) {
        let (roles, reuse) = (self.plan.candidate_views(), self.passes.light_reservoirs.as_ref());
        let reservoirs = reuse.map(|reuse| &reuse.reservoirs);
        let points = || light_point.points.as_entire_binding();
        candidates.select(recording, band, strategies.of(0), points(), reservoirs);
        if self.plan.ray_views.lights {
            candidates.trace(recording, band, points(), reservoirs);
        }
        let with_map = if self.plan.ray_views.lights { 0 } else { self.light_points.len() };
        for (n, &role) in roles.iter().enumerate().take(with_map) {
            if n > 0 && reuse.is_none() {
                self.rasterize_candidate(recording, n);
            }
            candidates.test(recording, band, n, self.views.get(role), reservoirs);
        }
        let Some(reuse) = reuse else { return };
        reuse.select(recording, band, strategies.of(0), light_point.all(), &candidates.selected_lights);
        for (index, &role) in candidates.indices.iter().zip(&roles) {
            reuse.test(recording, band, index, self.views.get(role), &candidates.selected_lights);
        }
    }

    /// Writes the number of light points, and the sample counts for MIS: with one sample per light, strategy s = 1
    /// counts as 1 / p(light) samples.
    pub(super) fn write_sample_counts(&self, gpu: &Gpu, lights: &LightTable) {
        let count = |samples: [u32; 4], light: &LightRecord| {
            let points = if light.kind == SKY { self.plan.sky_points } else { 1 };
            (points * samples[1]) as f32 / light.probability
        };
        for ConnectionPass { connection, strategies, .. } in &self.passes.connections {
            if connection.is_direct() {
                let points = self.plan.points_connected(connection).min(self.light_points.len() as u32);
                strategies.write_light_points(gpu, points);
                for (n, light) in (0..).zip(&lights.records) {
                    strategies.write_light_samples(gpu, n, count(connection.samples, light));
                }
            }
        }
        // The only emitter that a first extension can hit is the sky.
        if let (Some((strategy, _)), Some(sky)) = (self.passes.extensions.first(), lights.sky()) {
            strategy.write_light_samples(gpu, 0, count(self.plan.extensions[0].samples, sky));
        }
    }
}
