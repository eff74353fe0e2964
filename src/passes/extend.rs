//! extend: from z_j of every pixel along one ray-bundle to z_(j+1) (eq. (1)), and the light met there: strategies (0, j + 2).
//!
//! Reads the bundle's lists. Replaces the eye vertices; adds to the iteration's image. Skipped beyond the last vertex that
//! anything joins.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;
use crate::view::ViewBuffers;

/// Rows of pixels that dispatches cover a multiple of: those of a workgroup times `SPREAD` of the shader.
const ROWS: u32 = 8 * 8;

/// The pass.
pub struct Extend(Compute);

impl Extend {
    /// Builds the pipeline. `last`: only light that is met counts, no vertex is made.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str], last: bool) -> Self {
        let mut flags = flags.to_vec();
        if last {
            flags.push("LAST");
        }
        Self(Compute::new(gpu, "extend", "extend", &flags))
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        strategy: &wgpu::Buffer,
        bundle: &ViewBuffers,
    ) {
        let mut bindings = scene.with(&bundle.bindings());
        bindings.extend(band.bindings());
        bindings.push(("strategy", strategy.as_entire_binding()));
        let [columns, rows] = band.size;
        self.0.record(gpu, encoder, [columns, rows.next_multiple_of(ROWS)], &bindings);
    }
}
