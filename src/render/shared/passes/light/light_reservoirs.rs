//! light_reservoirs: direct light, (1, 2), resampled from the light candidates of this iteration and the
//! reservoirs of the last one, of the same pixel and its neighbours (ReSTIR DI; Bitterli et al. 2020).
//!
//! Reads: the eye vertices z1, the candidates of both iterations with their maps, and the reservoirs of the
//! last iteration. Writes: the iteration's image. Skipped when: `--light-sampling` is not `restir`.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::layouts;
use crate::render::layouts::light_pool::MOST_LIGHT_POINTS;
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// The passes, and the reservoirs of the image's pixels.
pub struct LightReservoirs {
    select: Compute,
    test: Compute,
    reuse: wgpu::Buffer,
    biased: bool,
    /// The reservoirs of this iteration, which pass light_candidates writes.
    pub reservoirs: wgpu::Buffer,
    past_reservoirs: wgpu::Buffer,
    /// A copy of the light points of the last iteration, a uniform.
    past_points: wgpu::Buffer,
}

impl LightReservoirs {
    /// Builds the pipelines for `pixels` of the image. `select` and `test` are
    /// the flags of either shader.
    #[must_use]
    pub fn new(gpu: &Gpu, select: &[Flag], test: &[Flag], pixels: u64, biased: bool) -> Self {
        let reservoirs = || gpu.storage("pixel_reservoirs", pixels * size_of::<layouts::PixelReservoir>() as u64);
        let shader = "shared/light/light_reservoirs";
        let test = [test, &[Flag::Reuse]].concat();
        Self {
            select: Compute::new(gpu, shader, &[select, &[Flag::Choose, Flag::Reuse]].concat()),
            test: Compute::labelled(gpu, "light_reservoirs_test", shader, &test),
            reuse: gpu.uniform::<layouts::Reuse>("reuse"),
            biased,
            reservoirs: reservoirs(),
            past_reservoirs: reservoirs(),
            past_points: gpu
                .storage("light_points", u64::from(MOST_LIGHT_POINTS) * size_of::<layouts::LightPoint>() as u64),
        }
    }

    /// Begins an iteration: its reservoirs and light points become those of the last one. `has_past` is false
    /// for the first.
    pub fn swap_history(&mut self, gpu: &Gpu, has_past: bool, light_points: &wgpu::Buffer) {
        std::mem::swap(&mut self.reservoirs, &mut self.past_reservoirs);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(light_points, 0, &self.past_points, 0, light_points.size());
        gpu.queue.submit([encoder.finish()]);
        let reuse = layouts::Reuse { has_past: u32::from(has_past), biased: u32::from(self.biased) };
        gpu.queue.write_buffer(&self.reuse, 0, bytemuck::bytes_of(&reuse));
    }

    /// Records the selection of every pixel, which replaces that of the candidates in `selected_lights`.
    pub fn select(
        &self,
        recording: &mut Recording,
        band: &Band,
        strategy: wgpu::BindingResource,
        light_points: wgpu::BindingResource,
        selected_lights: &wgpu::Buffer,
    ) {
        let buffers = [
            ("selected_lights", selected_lights.as_entire_binding()),
            ("strategy", strategy),
            ("light_points", light_points),
            ("past_light_points", self.past_points.as_entire_binding()),
            ("pixel_reservoirs", self.reservoirs.as_entire_binding()),
            ("past_reservoirs", self.past_reservoirs.as_entire_binding()),
            ("reuse", self.reuse.as_entire_binding()),
        ];
        recording.run(&self.select, band.size, &[&band.bindings(), &buffers]);
    }

    /// Records the visibility test of pixels that selected the light point `index`, by the map around it.
    /// Indices of this iteration come before those of the last one.
    pub fn test(
        &self,
        recording: &mut Recording,
        band: &Band,
        index: &wgpu::Buffer,
        map: &ViewBuffers,
        selected_lights: &wgpu::Buffer,
    ) {
        let buffers = [
            ("selected_lights", selected_lights.as_entire_binding()),
            ("past_reservoirs", self.past_reservoirs.as_entire_binding()),
            ("pool_index", index.as_entire_binding()),
        ];
        recording.run(&self.test, band.size, &[&map.bindings(), &band.bindings(), &buffers]);
    }

    /// Returns the bytes of the reservoirs.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.reservoirs.size() + self.past_reservoirs.size()
    }
}
