//! light_point: the iteration's light points, y0 among them, and the views from there.
//!
//! Reads the lights. Skipped while the only one is a light without extent that stays the same.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::layouts;
use crate::view::ViewBuffers;

const POINT_BYTES: u64 = size_of::<layouts::LightPoint>() as u64;

/// The pass.
pub struct LightPoint {
    compute: Compute,
    count: u32,
    starts: wgpu::Buffer,
    views: wgpu::Buffer,
    /// The light points; the first is y0.
    pub points: wgpu::Buffer,
    /// One of the others, where a pass needs it alone.
    other: Option<wgpu::Buffer>,
}

impl LightPoint {
    /// Builds the pipeline, for views of a resolution. `alone`: whether a pass needs others than y0 one by one.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str], count: u32, resolution: u32, alone: bool) -> Self {
        let view = layouts::View { resolution, slabs: 1, ..Default::default() };
        Self {
            compute: Compute::new(gpu, "light_point", "light_point", flags),
            count,
            starts: gpu.storage("light_starts", u64::from(count) * size_of::<layouts::LightStart>() as u64),
            views: gpu.upload("light_views", &vec![view; count as usize]),
            points: gpu.storage("light_points", u64::from(count) * POINT_BYTES),
            other: alone.then(|| gpu.storage("light_point", POINT_BYTES)),
        }
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        starts: &[layouts::LightStart],
    ) {
        gpu.queue.write_buffer(&self.starts, 0, bytemuck::cast_slice(starts));
        let bindings = scene.with(&[
            ("light_starts", self.starts.as_entire_binding()),
            ("light_points", self.points.as_entire_binding()),
            ("light_views", self.views.as_entire_binding()),
        ]);
        self.compute.record(gpu, encoder, [self.count, 1], &bindings);
    }

    /// The n-th light point as a uniform, until the next one is asked for.
    pub fn point(&self, encoder: &mut wgpu::CommandEncoder, n: usize) -> &wgpu::Buffer {
        let Some(other) = self.other.as_ref().filter(|_| n > 0) else { return &self.points };
        encoder.copy_buffer_to_buffer(&self.points, n as u64 * POINT_BYTES, other, 0, POINT_BYTES);
        other
    }

    /// Points a view where the n-th light point looks, in all directions or from infinitely far away.
    pub fn look(&self, encoder: &mut wgpu::CommandEncoder, n: u32, view: &ViewBuffers) {
        let size = size_of::<layouts::View>() as u64;
        encoder.copy_buffer_to_buffer(&self.views, u64::from(n) * size, &view.view, 0, size);
    }
}
