//! accumulate: adds the iteration's image to the film unless a list overflowed; counts what is not finite.
//!
//! Reads the iteration's image and the views' demands. Writes the film and the batch's log.

use crate::gpu::{Compute, Gpu};

/// The pass.
pub struct Accumulate(Compute);

impl Accumulate {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu) -> Self {
        Self(Compute::new(gpu, "accumulate", "accumulate", &[]))
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        frame: &wgpu::Buffer,
        size: [u32; 2],
        radiance: &wgpu::Buffer,
        demands: &wgpu::Buffer,
        film: &wgpu::Buffer,
        log: &wgpu::Buffer,
    ) {
        let bindings = [
            ("frame", frame.as_entire_binding()),
            ("radiance", radiance.as_entire_binding()),
            ("demands", demands.as_entire_binding()),
            ("film", film.as_entire_binding()),
            ("log", log.as_entire_binding()),
        ];
        self.0.record(gpu, encoder, size, &bindings);
    }
}
