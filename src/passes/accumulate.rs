//! accumulate: adds the iteration's image to the film unless a list overflowed; counts what is not finite.
//!
//! Reads the iteration's image and the views' demands. Writes the film and the batch's log.

use crate::gpu::{Compute, Gpu};
use crate::pixels::Band;

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
        band: &Band,
        demands: &wgpu::Buffer,
        log: &wgpu::Buffer,
    ) {
        let mut bindings = band.bindings().to_vec();
        bindings.extend([
            ("demands", demands.as_entire_binding()),
            ("film", band.film.as_entire_binding()),
            ("log", log.as_entire_binding()),
        ]);
        self.0.record(gpu, encoder, band.size, &bindings);
    }
}
