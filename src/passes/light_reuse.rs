//! light_reuse: direct light, (1, 2), from what pixels kept of the iteration's pool of light points and of the last one's (ReSTIR DI).
//!
//! Reads the eye vertices z1, both pools with their maps, and what pixels saw and kept in the last iteration. Adds to the iteration's
//! image. Skipped unless `--light-sampling` is `restir`.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::layouts;
use crate::pixels::Band;
use crate::view::ViewBuffers;

/// The pass, and what is kept of the image's pixels.
pub struct LightReuse {
    choose: Compute,
    test: Compute,
    reuse: wgpu::Buffer,
    biased: bool,
    /// Of the iteration; the pass light_pool writes them.
    pub sites: wgpu::Buffer,
    past_sites: wgpu::Buffer,
    past_points: wgpu::Buffer,
}

impl LightReuse {
    /// Builds the pipelines. `choosing`: flags of what depends on the light; `visibility`: of the tests; `points`: of a pool; `pixels`: of
    /// the image.
    #[must_use]
    pub fn new(gpu: &Gpu, choosing: &[&str], visibility: &[&str], points: u32, pixels: u64, biased: bool) -> Self {
        let sites = || gpu.storage("pool_sites", pixels * size_of::<layouts::PoolSite>() as u64);
        let test = [visibility, &["REUSE"]].concat();
        Self {
            choose: Compute::new(gpu, "light_reuse", "light_reuse", &[choosing, &["CHOOSE", "REUSE"]].concat()),
            test: Compute::new(gpu, "light_reuse_test", "light_reuse", &test),
            reuse: gpu.uniform::<layouts::Reuse>("reuse"),
            biased,
            sites: sites(),
            past_sites: sites(),
            past_points: gpu.storage("light_points", u64::from(points) * size_of::<layouts::LightPoint>() as u64),
        }
    }

    /// Begins an iteration: what were its sites and light points are the last one's. `has_past`: whether there was one.
    pub fn turn(&mut self, gpu: &Gpu, has_past: bool, light_points: &mut wgpu::Buffer) {
        std::mem::swap(&mut self.sites, &mut self.past_sites);
        std::mem::swap(light_points, &mut self.past_points);
        let biased = u32::from(self.biased);
        let reuse = layouts::Reuse { has_past: u32::from(has_past), biased };
        gpu.queue.write_buffer(&self.reuse, 0, bytemuck::bytes_of(&reuse));
    }

    /// Records every pixel's choice, after that of the pool, which it takes the place of in `choices`.
    pub fn choose(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        strategy: &wgpu::Buffer,
        light_points: &wgpu::Buffer,
        choices: &wgpu::Buffer,
    ) {
        let mut bindings = scene.with(&band.bindings());
        bindings.extend([
            ("choices", choices.as_entire_binding()),
            ("strategy", strategy.as_entire_binding()),
            ("light_points", light_points.as_entire_binding()),
            ("past_light_points", self.past_points.as_entire_binding()),
            ("pool_sites", self.sites.as_entire_binding()),
            ("past_sites", self.past_sites.as_entire_binding()),
            ("reuse", self.reuse.as_entire_binding()),
        ]);
        self.choose.record(gpu, encoder, band.size, &bindings);
    }

    /// Records the test of those that chose the light point of number `index`, this iteration's before the last one's, by the map around it.
    pub fn test(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        index: &wgpu::Buffer,
        view: &ViewBuffers,
        choices: &wgpu::Buffer,
    ) {
        let mut bindings = scene.with(&view.bindings());
        bindings.extend(band.bindings());
        bindings.extend([
            ("choices", choices.as_entire_binding()),
            ("past_sites", self.past_sites.as_entire_binding()),
            ("pool_index", index.as_entire_binding()),
        ]);
        self.test.record(gpu, encoder, band.size, &bindings);
    }

    /// Bytes of what is kept of the image.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.sites.size() + self.past_sites.size()
    }
}
