//! accumulate: adds the iteration's image to the film, or puts it into the frame's layers, unless a list overflowed; counts what is
//! not finite.
//!
//! Reads the iteration's image, the views' demands and, where tiles settle, which have. Writes the film or the layers, and the batch's log.

use crate::gpu::{Bindings, Compute, Gpu};
use crate::pixels::Band;

/// The pass.
pub struct Accumulate(Compute);

impl Accumulate {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        Self(Compute::new(gpu, "accumulate", "accumulate", flags))
    }

    /// Records the pass; `layers` are those of a frame that is filtered.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        band: &Band,
        demands: &wgpu::Buffer,
        log: &wgpu::Buffer,
        layers: Bindings,
    ) {
        let mut bindings = band.bindings();
        bindings.extend([("demands", demands.as_entire_binding()), ("log", log.as_entire_binding())]);
        bindings.extend(band.film.map(|film| ("film", film.as_entire_binding())));
        bindings.extend_from_slice(layers);
        self.0.record(gpu, encoder, band.size, &bindings);
    }
}
