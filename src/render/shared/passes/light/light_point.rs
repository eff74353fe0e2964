//! light_point: the light points of an iteration, y0 first, and the views around them.
//!
//! Reads: the lights. Writes: light points and views. Skipped when: the only light has no extent and stays
//! the same.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::layouts;
use crate::render::layouts::light_points::MOST_LIGHT_POINTS;
use crate::render::recording::Recording;
use crate::render::visibility::view::ViewBuffers;

const POINT_BYTES: u64 = size_of::<layouts::LightPoint>() as u64;

/// The pass.
pub struct LightPoint {
    compute: Compute,
    count: u32,
    starts: wgpu::Buffer,
    views: wgpu::Buffer,
    /// The light points of each class, the first is y0.
    pub points: wgpu::Buffer,
    /// Light points for which each class has room.
    room: u32,
    /// A copy of one of the others, for passes that take it as a uniform.
    copy: Option<wgpu::Buffer>,
}

impl LightPoint {
    /// Builds the pipeline for `count` light points of each class, which has room for `room`, and for views of a resolution. With `one_by_one`, passes take light points beside y0
    /// as uniforms.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], [count, room]: [u32; 2], resolution: u32, one_by_one: bool) -> Self {
        let view = layouts::View { resolution, slabs: 1, ..Default::default() };
        Self {
            compute: Compute::new(gpu, "shared/light/light_point", flags),
            count,
            starts: gpu.storage("light_starts", u64::from(count) * size_of::<layouts::LightStart>() as u64),
            views: gpu.upload("light_views", &vec![view; count as usize]),
            points: gpu.storage("light_points", u64::from(room.max(MOST_LIGHT_POINTS)) * POINT_BYTES),
            room,
            copy: one_by_one.then(|| gpu.storage("light_point", POINT_BYTES)),
        }
    }

    /// Records the pass for a class, which is the n-th, `slot`, of those that are rendered together.
    pub fn record(
        &self,
        recording: &mut Recording,
        slot: u64,
        starts: &[layouts::LightStart],
        guide: Option<&wgpu::TextureView>,
    ) {
        recording.gpu.queue.write_buffer(&self.starts, 0, bytemuck::cast_slice(starts));
        let buffers = [
            ("light_starts", self.starts.as_entire_binding()),
            ("light_points", self.from(slot, self.count)),
            ("light_views", self.views.as_entire_binding()),
        ];
        let guide: Vec<_> =
            guide.map(|guide| ("sky_guide", wgpu::BindingResource::TextureView(guide))).into_iter().collect();
        recording.run(&self.compute, [self.count, 1], &[&buffers, &guide]);
    }

    /// Returns the light points of the first class without the room behind them, for passes that ask for their number.
    pub fn all(&self) -> wgpu::BindingResource<'_> {
        self.from(0, self.count)
    }

    /// Returns y0 of a class.
    pub fn y0(&self, slot: u64) -> wgpu::BindingResource<'_> {
        self.from(slot, 1)
    }

    fn from(&self, slot: u64, count: u32) -> wgpu::BindingResource<'_> {
        let [offset, size] = [slot * u64::from(self.room), u64::from(count)].map(|points| points * POINT_BYTES);
        let size = wgpu::BufferSize::new(size);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.points, offset, size })
    }

    /// Returns the n-th light point as a uniform, valid until the next call.
    pub fn point(&self, encoder: &mut wgpu::CommandEncoder, n: usize) -> &wgpu::Buffer {
        let Some(copy) = self.copy.as_ref().filter(|_| n > 0) else { return &self.points };
        encoder.copy_buffer_to_buffer(&self.points, n as u64 * POINT_BYTES, copy, 0, POINT_BYTES);
        copy
    }

    /// Sets a view to that of the n-th light point: all directions around it, or one direction from infinity.
    pub fn write_view(&self, encoder: &mut wgpu::CommandEncoder, n: usize, view: &ViewBuffers) {
        let size = size_of::<layouts::View>() as u64;
        encoder.copy_buffer_to_buffer(&self.views, n as u64 * size, &view.view, 0, size);
    }
}
