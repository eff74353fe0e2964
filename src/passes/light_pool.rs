//! light_pool: direct light, (1, 2), from a pool of light points; every pixel asks the map around one of them.
//!
//! Reads the eye vertices z1, the light points and, one after the other, their maps. Adds to the iteration's image, or, where the last
//! iteration's are used again (pass light_reuse), writes what each pixel keeps. Skipped where one light point is enough.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;
use crate::view::ViewBuffers;

/// The pass.
pub struct LightPool {
    choose: Compute,
    test: Compute,
    /// What each pixel of a band has chosen.
    pub choices: wgpu::Buffer,
    /// The numbers 0, 1, 2, ..., one in each.
    pub indices: Vec<wgpu::Buffer>,
}

impl LightPool {
    /// Builds the pipelines. `choosing`: flags of what depends on the light; `visibility`: of the tests; `count`: of light
    /// points that have a map; `choice_bytes`: of all that are kept.
    #[must_use]
    pub fn new(gpu: &Gpu, choosing: &[&str], visibility: &[&str], count: u32, choice_bytes: u64) -> Self {
        let index = |n: u32| {
            let uniform = gpu.uniform::<u32>("pool_index");
            gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&n));
            uniform
        };
        Self {
            choose: Compute::new(gpu, "light_pool", "light_pool", &[choosing, &["CHOOSE"]].concat()),
            test: Compute::new(gpu, "light_pool_test", "light_pool", visibility),
            choices: gpu.storage("choices", choice_bytes),
            indices: (0..count).map(index).collect(),
        }
    }

    /// Records every pixel's choice; `sites`: where it is kept.
    pub fn choose(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        strategy: &wgpu::Buffer,
        light_points: &wgpu::Buffer,
        sites: Option<&wgpu::Buffer>,
    ) {
        let mut bindings = scene.with(&band.bindings());
        bindings.extend(sites.map(|sites| ("pool_sites", sites.as_entire_binding())));
        bindings.extend([
            ("choices", self.choices.as_entire_binding()),
            ("strategy", strategy.as_entire_binding()),
            ("light_points", light_points.as_entire_binding()),
        ]);
        self.choose.record(gpu, encoder, band.size, &bindings);
    }

    /// Records the test of those that chose the n-th light point, by the map around it.
    pub fn test(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        n: usize,
        view: &ViewBuffers,
        sites: Option<&wgpu::Buffer>,
    ) {
        let mut bindings = scene.with(&view.bindings());
        bindings.extend(band.bindings());
        bindings.extend(sites.map(|sites| ("pool_sites", sites.as_entire_binding())));
        bindings.extend([
            ("choices", self.choices.as_entire_binding()),
            ("pool_index", self.indices[n].as_entire_binding()),
        ]);
        self.test.record(gpu, encoder, band.size, &bindings);
    }

    /// Bytes of what is kept per pixel.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.choices.size()
    }
}
