//! reservoirs: the first hit of each pixel and its direct light by resampled importance sampling, with
//! `restir` also from the reservoirs of the last sample (ReSTIR DI; Bitterli et al. 2020).
//!
//! Reads: the scene, the lights, and the first hits and reservoirs of the last sample. Writes: the first
//! hits, their direct light, and the reservoirs. Skipped when: `--light-sampling` is neither `ris` nor
//! `restir`.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::layouts;

/// The pass, with first hits and their reservoirs of even and of odd samples.
pub struct Reservoirs {
    compute: Compute,
    hits: [wgpu::Buffer; 2],
    reuse: bool,
}

impl Reservoirs {
    /// Builds the pipeline and the buffers. With `reuse`, pixels reuse the reservoirs of the last sample.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], pixels: u64, reuse: bool) -> Self {
        let flags = [flags, if reuse { &[Flag::Reuse] } else { &[] }].concat();
        let pair = |label, bytes| [gpu.storage(label, bytes), gpu.storage(label, if reuse { bytes } else { 16 })];
        Self {
            compute: Compute::new(gpu, "subpaths/reservoirs", &flags),
            hits: pair("first_hits", pixels * size_of::<layouts::FirstHit>() as u64),
            reuse,
        }
    }

    /// Returns the bindings of the sample `number`.
    #[must_use]
    pub fn bindings(&self, number: u64) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        // Without reuse there is one buffer of first hits.
        let now = if self.reuse { number as usize % 2 } else { 0 };
        let past = self.reuse.then(|| ("past_hits", self.hits[1 - now].as_entire_binding()));
        std::iter::once(("first_hits", self.hits[now].as_entire_binding())).chain(past).collect()
    }

    /// Returns all buffers, of even and of odd samples.
    pub fn buffers(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.hits.iter()
    }

    /// Records the pass over `count` pixels.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        count: u32,
        bindings: &[(&str, wgpu::BindingResource)],
    ) {
        self.compute.record(gpu, encoder, [count, 1], bindings);
    }
}
