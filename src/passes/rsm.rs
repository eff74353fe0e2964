//! rsm: importance of the directions from the light, by what its map shows.
//!
//! Reads the light's map. Writes the table that y1 is drawn from and MIS asks.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::view::ViewBuffers;

/// The pass and its table.
pub struct Rsm {
    compute: Compute,
    /// Density of each cell over the uniform one.
    pub table: wgpu::Buffer,
}

impl Rsm {
    /// Cells along a side of the table.
    pub const SIDE: u32 = 32;

    /// Builds the pipeline and the table.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        let table = gpu.storage("rsm", u64::from(Self::SIDE) * u64::from(Self::SIDE) * 4);
        Self { compute: Compute::new(gpu, "rsm", "rsm", flags), table }
    }

    /// Records the pass for the light at `y0`, which `map` is around.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        y0: &wgpu::Buffer,
        map: &ViewBuffers,
    ) {
        let mut bindings = scene.with(&map.bindings());
        bindings.extend([("y0", y0.as_entire_binding()), ("table", self.table.as_entire_binding())]);
        self.compute.record(gpu, encoder, [1, 1], &bindings);
    }
}
