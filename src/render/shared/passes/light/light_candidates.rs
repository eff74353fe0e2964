//! light_candidates: direct light, (1, 2), from light candidates. Every pixel selects one, then its map tests
//! its visibility, or a ray.
//!
//! Reads: the eye vertices z1, the light points and, one after the other, their maps, unless rays test all at once. Writes: the iteration's
//! image, or, with reuse (pass light_reservoirs), the reservoir of each pixel. Skipped when: one light point
//! is enough.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// The passes.
pub struct LightCandidates {
    select: Compute,
    test: Compute,
    /// The candidate that each pixel of a band has selected.
    pub selected_lights: wgpu::Buffer,
    /// Uniforms that hold 0, 1, 2, ...
    pub indices: Vec<wgpu::Buffer>,
}

impl LightCandidates {
    /// Builds the pipelines for `count` light points that have maps. `select` and `test` are the flags of
    /// either shader; `selected_bytes` is the size of all selections of a band.
    #[must_use]
    pub fn new(gpu: &Gpu, select: &[Flag], test: &[Flag], count: u32, selected_bytes: u64) -> Self {
        let index = |n: u32| {
            let uniform = gpu.uniform::<u32>("pool_index");
            gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&n));
            uniform
        };
        Self {
            select: Compute::new(gpu, "shared/light/light_candidates", &[select, &[Flag::Choose]].concat()),
            test: Compute::labelled(gpu, "light_candidates_test", "shared/light/light_candidates", test),
            selected_lights: gpu.storage("selected_lights", selected_bytes),
            indices: (0..count).map(index).collect(),
        }
    }

    /// Records the selection of every pixel. `reservoirs` receives it with reuse.
    pub fn select(
        &self,
        recording: &mut Recording,
        band: &Band,
        strategy: wgpu::BindingResource,
        light_points: wgpu::BindingResource,
        reservoirs: Option<&wgpu::Buffer>,
    ) {
        let buffers = [
            ("selected_lights", self.selected_lights.as_entire_binding()),
            ("strategy", strategy),
            ("light_points", light_points),
        ];
        let reservoirs: Vec<_> = reservoirs.iter().map(|r| ("pixel_reservoirs", r.as_entire_binding())).collect();
        recording.run_layers(&self.select, band.size, band.classes, &[&band.bindings(), &buffers, &reservoirs]);
    }

    /// Records the visibility test of pixels that selected the n-th light point, by the map around it.
    pub fn test(
        &self,
        recording: &mut Recording,
        band: &Band,
        n: usize,
        map: &ViewBuffers,
        reservoirs: Option<&wgpu::Buffer>,
    ) {
        let buffers = [
            ("selected_lights", self.selected_lights.as_entire_binding()),
            ("pool_index", self.indices[n].as_entire_binding()),
        ];
        let reservoirs: Vec<_> = reservoirs.iter().map(|r| ("pixel_reservoirs", r.as_entire_binding())).collect();
        recording.run(&self.test, band.size, &[&map.bindings(), &band.bindings(), &buffers, &reservoirs]);
    }

    /// Records the visibility test of all pixels, by rays.
    pub fn trace(
        &self,
        recording: &mut Recording,
        band: &Band,
        light_points: wgpu::BindingResource,
        reservoirs: Option<&wgpu::Buffer>,
    ) {
        let buffers = [("selected_lights", self.selected_lights.as_entire_binding()), ("light_points", light_points)];
        let reservoirs: Vec<_> = reservoirs.iter().map(|r| ("pixel_reservoirs", r.as_entire_binding())).collect();
        recording.run_layers(&self.test, band.size, band.classes, &[&band.bindings(), &buffers, &reservoirs]);
    }

    /// Returns the bytes of the selections.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.selected_lights.size()
    }
}
