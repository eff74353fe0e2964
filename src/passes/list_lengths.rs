//! list_lengths: how many entries of its list each pixel's look-up along the first ray-bundle walks.
//!
//! Reads the eye vertices z1 and the bundle's lists. Replaces the iteration's image. Skipped unless it is asked for; then nothing else
//! follows the eye subpaths.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;
use crate::view::ViewBuffers;

/// The pass.
pub struct ListLengths(Compute);

impl ListLengths {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "list_lengths", "list_lengths", &[flags, &["WALKED"]].concat()))
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        bundle: &ViewBuffers,
    ) {
        let mut bindings = scene.with(&bundle.bindings());
        bindings.extend(band.bindings());
        self.0.record(gpu, encoder, band.size, &bindings);
    }
}
