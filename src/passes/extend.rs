//! extend: from z_j of every pixel along one ray-bundle to z_(j+1) (eq. (1)), and the light met there: strategies (0, j + 2).
//!
//! Reads the bundle's lists. Replaces the eye vertices; adds to the iteration's image. Skipped beyond the last vertex that
//! anything joins.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;
use crate::view::ViewBuffers;

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
        self.0.record(gpu, encoder, band.size, &bindings);
    }
}
