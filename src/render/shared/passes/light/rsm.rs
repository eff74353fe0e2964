//! rsm: the importance of directions from y0, from the reflected light that its map shows (reflective shadow
//! map).
//!
//! Reads: the map around y0. Writes: the table that y1 is sampled from and that MIS evaluates. Skipped when:
//! y0's light is the one that the table was made for, or has an extent.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::layouts::rsm_size::RSM_SIDE;
use crate::render::recording::Recording;
use crate::render::visibility::view::ViewBuffers;

/// The pass and its table.
pub struct Rsm {
    compute: Compute,
    /// Density of each cell over the uniform density.
    pub table: wgpu::Buffer,
}

impl Rsm {
    /// Builds the pipeline and the table.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag]) -> Self {
        let table = gpu.storage("rsm", u64::from(RSM_SIDE) * u64::from(RSM_SIDE) * 4);
        Self { compute: Compute::new(gpu, "shared/light/rsm", flags), table }
    }

    /// Records the pass for the light at `y0`, with the map around it.
    pub fn record(&self, recording: &mut Recording, y0: &wgpu::Buffer, map: &ViewBuffers) {
        let buffers = [("y0", y0.as_entire_binding()), ("table", self.table.as_entire_binding())];
        recording.run(&self.compute, [1, 1], &[&map.bindings(), &buffers]);
    }
}
