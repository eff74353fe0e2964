//! Connections of an iteration: with one light vertex, with a point of each light, or with light candidates.

use crate::gpu::Gpu;
use crate::render::layouts::light_kind::SKY;
use crate::render::layouts::{self, LightRecord};
use crate::render::lights::table::LightTable;
use crate::render::recording::Recording;
use crate::render::shared::build::ConnectionPass;
use crate::render::shared::film_buffer::Band;
use crate::render::shared::frame::Frame;
use crate::render::shared::passes::light::light_candidates::LightCandidates;
use crate::render::shared::passes::light::light_point::LightPoint;
use crate::render::shared::passes::paths::connect::{Connect, ConnectInputs};
use crate::render::shared::plan::views::ViewRole;

impl Frame {
    /// Connects z_j of a band with the light vertex of a strategy. Does nothing without lights.
    pub(super) fn connect(&self, recording: &mut Recording, band: &Band, connection: &ConnectionPass) {
        let Some(light_point) = self.passes.light_point.as_ref().filter(|_| !self.light_points.is_empty()) else {
            return;
        };
        match (&connection.pass, &self.passes.light_candidates) {
            (Some(pass), _) => self.connect_points(recording, band, connection, pass, light_point),
            (None, Some(candidates)) => {
                self.direct_light_from_candidates(recording, band, &connection.strategies[0], light_point, candidates);
            }
            (None, None) => {}
        }
    }

    /// Connects with a VPL or with the point of each light, one after the other.
    fn connect_points(
        &self,
        recording: &mut Recording,
        band: &Band,
        ConnectionPass { connection, strategies, .. }: &ConnectionPass,
        pass: &Connect,
        light_point: &LightPoint,
    ) {
        let count = self.plan.points_connected(connection) as usize;
        for (n, start) in self.light_points.iter().enumerate().take(count) {
            let vertex = ViewRole::LightVertex(connection.s - 1);
            let map = if connection.s == 1 { self.plan.light_view(start.light) } else { vertex };
            if connection.s == 1 && self.plan.sky_points > 1 {
                light_point.write_view(&mut recording.encoder, n, self.views.get(map));
            }
            let inputs = ConnectInputs {
                strategy: if strategies.len() > 1 { &strategies[start.light as usize] } else { &strategies[0] },
                view: self.views.get(map),
                y0: light_point.point(&mut recording.encoder, n),
                light_vertices: &self.light_vertices,
                rsm: self.passes.rsm.as_ref().map(|rsm| &rsm.table),
                guide: self.passes.guide(),
            };
            pass.record(recording, band, &inputs);
        }
    }

    /// Adds direct light from candidates: each pixel selects one, then the maps test visibility one after the
    /// other. With reuse the maps exist already, and each pixel's selection competes with the reservoirs of
    /// the last iteration.
    fn direct_light_from_candidates(
        &self,
        recording: &mut Recording,
        band: &Band,
        strategy: &wgpu::Buffer,
        light_point: &LightPoint,
        candidates: &LightCandidates,
    ) {
        let (roles, reuse) = (self.plan.candidate_views(), self.passes.light_reservoirs.as_ref());
        let reservoirs = reuse.map(|reuse| &reuse.reservoirs);
        candidates.select(recording, band, strategy, &light_point.points, reservoirs);
        for (n, &role) in roles.iter().enumerate().take(self.light_points.len()) {
            if n > 0 && reuse.is_none() {
                self.rasterize_candidate(recording, n);
            }
            candidates.test(recording, band, n, self.views.get(role), reservoirs);
        }
        let Some(reuse) = reuse else { return };
        reuse.select(recording, band, strategy, &light_point.points, &candidates.selected_lights);
        for (index, &role) in candidates.indices.iter().zip(&roles) {
            reuse.test(recording, band, index, self.views.get(role), &candidates.selected_lights);
        }
    }

    /// Writes the sample counts for MIS: with one sample per light, strategy s = 1 counts as 1 / p(light)
    /// samples.
    pub(super) fn write_sample_counts(&self, gpu: &Gpu, lights: &LightTable) {
        let write = |strategy: &wgpu::Buffer, samples: [u32; 4], light: &LightRecord| {
            let at = std::mem::offset_of!(layouts::Strategy, sample_counts) + size_of::<f32>();
            let points = if light.kind == SKY { self.plan.sky_points } else { 1 };
            let count = (points * samples[1]) as f32 / light.probability;
            gpu.queue.write_buffer(strategy, at as u64, bytemuck::bytes_of(&count));
        };
        for ConnectionPass { connection, strategies, .. } in &self.passes.connections {
            if connection.is_direct() {
                let of_lights = strategies.iter().zip(&lights.records);
                of_lights.for_each(|(strategy, light)| write(strategy, connection.samples, light));
            }
        }
        // The only emitter that a first extension can hit is the sky.
        if let (Some((strategy, _)), Some(sky)) = (self.passes.extensions.first(), lights.sky()) {
            write(strategy, self.plan.extensions[0].samples, sky);
        }
    }
}
