//! The light side of an iteration: light points, the maps around them, and VPLs.

use crate::gpu::{Gpu, GpuError};
use crate::render::frame_uniform::frame_uniform;
use crate::render::layouts::{self, FrameUniform, LightStart};
use crate::render::lights::table::LightTable;
use crate::render::recording::Recording;
use crate::render::sampler::{Decision, Sampler};
use crate::render::shared::frame::{Frame, Iteration};
use crate::render::shared::passes::light::light_importance::LightImportance;
use crate::render::shared::passes::light::light_subpath::LightSubpathInputs;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::views::ViewRole;
use crate::render::shared::strategy_uniforms::StrategyUniforms;

impl Frame {
    /// Invalidates all views: something has moved.
    pub fn invalidate_views(&mut self) {
        self.invalidate_maps();
        self.gbuffer_camera = None;
    }

    /// Invalidates the maps around lights, and the reflective shadow map.
    pub fn invalidate_maps(&mut self) {
        self.views.invalidate_maps();
        self.rsm_of = None;
    }

    /// Begins an iteration that reuses the reservoirs of the last one: the maps and light points of its
    /// candidates are kept.
    pub(super) fn swap_history(&mut self, gpu: &Gpu, has_past: bool) {
        let (Some(reservoirs), Some(light_point)) = (&mut self.passes.light_reservoirs, &mut self.passes.light_point)
        else {
            return;
        };
        reservoirs.swap_history(gpu, has_past, &light_point.points);
        self.views.swap_candidates(&self.plan.candidate_views());
        self.rsm_of = None;
    }

    /// Samples y0 and the other light points, and rasterizes the maps around them. The map and the reflective
    /// shadow map of a light without extent are kept while the light stays the same, see
    /// [`FramePlan::keeps_maps`].
    pub(super) fn sample_light_points(
        &mut self,
        recording: &mut Recording,
        class: u32,
        lights: &LightTable,
        sampler: &Sampler,
    ) {
        self.light_points = light_points(lights, sampler, &self.plan);
        let (Some(pass), Some(y0)) = (&self.passes.light_point, self.light_points.first()) else { return };
        let y0_view = self.plan.light_view(y0.light);
        let y0_is_kept = *self.views.map_of(ViewRole::LightVertex(0)) == Some(y0.light);
        let slot = self.pixels.first(class as usize).slot;
        if self.light_points.len() > 1 || !y0_is_kept || slot > 0 {
            pass.record(recording, slot, &self.light_points, self.passes.guide());
        }
        // By rays only the light subpath needs a view, that of y0.
        let with_own_map = if self.plan.ray_views.lights { 1 } else { self.plan.direct_lights.max(1) as usize };
        let with_own_map = with_own_map.min(self.light_points.len());
        for (n, &LightStart { light, .. }) in self.light_points[..with_own_map].iter().enumerate() {
            let role = self.plan.light_view(light);
            if *self.views.map_of(role) != Some(light) {
                pass.write_view(&mut recording.encoder, n, self.views.get(role));
                self.views.rasterize(recording, role);
                let is_kept = lights.records[light as usize].is_fixed() && self.plan.keeps_maps;
                *self.views.map_of(role) = is_kept.then_some(light);
            }
        }
        let y0_is_fixed = lights.records[y0.light as usize].is_fixed();
        if let Some(rsm) = self.passes.rsm.as_ref().filter(|_| y0_is_fixed && self.rsm_of != Some(y0.light)) {
            rsm.record(recording, &pass.points, self.views.get(y0_view));
            self.rsm_of = Some(y0.light);
        }
        if self.plan.direct_lights > 0 {
            self.write_sample_counts(recording.gpu, lights);
        }
        if self.plan.reuses() {
            (1..self.light_points.len()).for_each(|n| self.rasterize_candidate(recording, n));
        }
    }

    /// Traces y1 and y2, and rasterizes the maps around them.
    pub(super) fn trace_light_subpath(&self, recording: &mut Recording, class: u32) {
        let (Some(pass), Some(light_point), Some(y0)) =
            (&self.passes.light_subpath, &self.passes.light_point, self.light_points.first())
        else {
            return;
        };
        let band = self.pixels.first(class as usize);
        let mut from = self.plan.light_view(y0.light);
        for vertex in 1..self.plan.light_vertices {
            let next = ViewRole::LightVertex(vertex);
            let inputs = LightSubpathInputs {
                y0: light_point.y0(band.slot),
                rsm: self.passes.rsm.as_ref().map(|rsm| &rsm.table),
                guide: self.passes.guide(),
                from: self.views.get(from),
                light_vertices: &self.light_vertices,
                next: self.views.get(next),
            };
            pass.record(recording, &band, vertex, &inputs);
            self.views.rasterize(recording, next);
            from = next;
        }
    }

    /// Rasterizes the map around the n-th light candidate, n > 0.
    pub(super) fn rasterize_candidate(&self, recording: &mut Recording, n: usize) {
        let Some(pass) = &self.passes.light_point else { return };
        let role = self.plan.candidate_views()[n];
        pass.write_view(&mut recording.encoder, n, self.views.get(role));
        self.views.rasterize_candidate(recording, role, n);
    }

    /// Finds the borders of lights that the camera sees, if planned.
    pub fn find_light_borders(&self, iteration: &Iteration) {
        let Some(pass) = &self.passes.seen_light else { return };
        self.pixels.write_uniform(iteration.gpu, 0, &uniform_of_view(iteration));
        let mut recording = Recording::new(iteration.gpu, iteration.scene, "seen light");
        pass.record(&mut recording, &self.pixels.first(0));
        recording.submit();
    }

    /// Finds the places where light of the sky comes in, for light subpaths to follow, if planned.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn guide_sky(&mut self, iteration: &Iteration<'_>) -> Result<(), GpuError> {
        if !self.plan.guides_sky {
            return Ok(());
        }
        let &Iteration { gpu, scene, .. } = iteration;
        let uniform = uniform_of_view(iteration);
        self.pixels.write_uniform(gpu, 0, &uniform);
        let mut recording = Recording::new(gpu, scene, "sky guide");
        self.gbuffer_camera = None;
        self.rasterize_gbuffer(&mut recording, uniform.clip_from_world);
        let Some(guide) = &self.passes.sky_guide else { return Ok(()) };
        guide.clear(&mut recording);
        for band in self.pixels.bands_of_first_class() {
            self.begin_eye_subpaths(&mut recording, &band);
            guide.record(&mut recording, &band);
        }
        recording.submit();
        guide.update(gpu, scene).await
    }

    /// Measures the contribution of each light to the picture without occlusion, in any unit.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn light_importance(&mut self, iteration: &Iteration<'_>) -> Result<Vec<f32>, GpuError> {
        let &Iteration { gpu, scene, camera, lights, settings, .. } = iteration;
        let flags = [self.plan.surface_flags.as_slice(), &self.plan.light_flags, self.plan.layer_flags()].concat();
        let pass = LightImportance::new(gpu, &flags, lights.count());
        let uniform = frame_uniform(scene, camera, settings, &Sampler::new(settings.seed, 0), 0, 0);
        self.pixels.write_uniform(gpu, 0, &uniform);
        let direct = layouts::Strategy { sample_counts: [0.0, 1.0, 0.0, 0.0], s: 1, j: 1, ..Default::default() };
        let strategy = StrategyUniforms::new(gpu, &direct, 1);
        let mut recording = Recording::new(gpu, scene, "light importance");
        self.gbuffer_camera = None;
        self.rasterize_gbuffer(&mut recording, uniform.clip_from_world);
        for band in self.pixels.bands_of_first_class() {
            self.begin_eye_subpaths(&mut recording, &band);
            pass.record(&mut recording, &band, strategy.of(0));
        }
        recording.submit();
        pass.read(gpu).await
    }
}

/// Returns the uniform of passes that learn about a view. It is that of all seeds, so that all parts of a picture learn the same.
fn uniform_of_view(iteration: &Iteration) -> FrameUniform {
    let &Iteration { scene, camera, settings, .. } = iteration;
    FrameUniform { seed: 0, ..frame_uniform(scene, camera, settings, &Sampler::new(0, 0), 0, 0) }
}

/// Returns the light points of an iteration; empty without lights. y0's light is chosen by its probability.
/// With one point per light the other lights follow; otherwise the other candidates' lights are chosen at
/// even steps from y0's.
fn light_points(lights: &LightTable, sampler: &Sampler, plan: &FramePlan) -> Vec<LightStart> {
    let first = sampler.get(Decision::Light);
    let start = |n: u32, light: u32| LightStart { light, random: sampler.get2(Decision::LightPoint(n)), pad: 0 };
    let chosen = |n: u32| lights.choose((first + n as f32 / plan.light_candidates as f32).fract());
    let candidates = (0..plan.light_candidates).filter_map(|n| Some(start(n, chosen(n)?)));
    // The contributions of all lights are summed, so their points may share random numbers.
    let emits = |&light: &u32| lights.records[light as usize].probability > 0.0;
    let others = (0..if plan.direct_lights > 0 { lights.count() } else { 0 })
        .filter(|&light| Some(light) != chosen(0))
        .filter(emits);
    let sky = lights.sky().and_then(|_| lights.count().checked_sub(1));
    // Further points on the sky are a lattice with its first one, by Roberts' R2 sequence.
    let more = (1..plan.sky_points).filter_map(|n| {
        let first = start(0, sky?);
        let [x, y] = first.random;
        let random = [(x + 0.754_877_7 * n as f32).fract(), (y + 0.569_840_3 * n as f32).fract()];
        Some(LightStart { random, ..first })
    });
    candidates.chain(others.map(|light| start(0, light))).chain(more).collect()
}
