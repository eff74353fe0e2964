//! reservoirs: what each pixel sees first, and the light that reaches it, by resampling; with reuse of what pixels kept in the last
//! sample (ReSTIR DI).
//!
//! Reads the scene, the lights and what the last sample kept. Writes the first vertices, their direct light and what is kept for the
//! next sample. Skipped unless `--light-sampling` is `ris` or `restir`.

use crate::gpu::{Compute, Gpu};
use crate::layouts;

/// The pass and what is kept of pixels: that of samples with an even number and of those with an odd one.
pub struct Reservoirs {
    compute: Compute,
    hits: [wgpu::Buffer; 2],
    kept: Option<[wgpu::Buffer; 2]>,
}

impl Reservoirs {
    /// Builds the pipeline and the buffers. `reuse`: with what was kept before.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str], pixels: u64, reuse: bool) -> Self {
        let flags = [flags, if reuse { &["REUSE"] } else { &[] }].concat();
        let room = |label, bytes| [gpu.storage(label, bytes), gpu.storage(label, if reuse { bytes } else { 16 })];
        Self {
            compute: Compute::new(gpu, "reservoirs", "reservoirs", &flags),
            hits: room("first_hits", pixels * size_of::<layouts::FirstHit>() as u64),
            kept: reuse.then(|| room("reservoirs", pixels * size_of::<layouts::Reservoir>() as u64)),
        }
    }

    /// What a sample of a number reads and writes.
    #[must_use]
    pub fn bindings(&self, number: u64) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        // Without reuse there is one of each.
        let now = if self.kept.is_some() { number as usize % 2 } else { 0 };
        let mut bindings = vec![("first_hits", self.hits[now].as_entire_binding())];
        if let Some(kept) = &self.kept {
            bindings.extend([
                ("past_hits", self.hits[1 - now].as_entire_binding()),
                ("reservoirs", kept[now].as_entire_binding()),
                ("past_reservoirs", kept[1 - now].as_entire_binding()),
            ]);
        }
        bindings
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
