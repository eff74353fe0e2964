//! accumulate: adds the iteration's image to the film, or puts it into the layers of a frame that is
//! denoised.
//!
//! Reads: the iteration's image, caustics, the requests of views and the converged tiles. Writes: the film or the
//! layers, and the batch's log, which counts values that are not finite. Skipped when: a list overflowed in
//! the iteration, which is then redone.

use crate::gpu::{Binding, Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;

/// The pass.
pub struct Accumulate(Compute);

/// The inputs and outputs beside the band's pixels.
pub struct AccumulateInputs<'a> {
    /// List requests and capacities of the iteration's views.
    pub requests: &'a wgpu::Buffer,
    /// The batch's log.
    pub log: &'a wgpu::Buffer,
    /// What caustics add to each pixel, if there are any.
    pub splats: Option<&'a wgpu::Buffer>,
    /// The layers of a frame that is denoised; empty if iterations are summed in the film.
    pub layers: &'a [Binding<'a>],
}

impl Accumulate {
    /// Builds the pipeline.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag]) -> Self {
        Self(Compute::new(gpu, "shared/film/accumulate", flags))
    }

    /// Records the pass.
    pub fn record(&self, recording: &mut Recording, band: &Band, inputs: &AccumulateInputs) {
        let buffers = [("requests", inputs.requests.as_entire_binding()), ("log", inputs.log.as_entire_binding())];
        let film: Vec<_> = band.film.iter().map(|film| ("film", film.as_entire_binding())).collect();
        let splats: Vec<_> = inputs.splats.iter().map(|splats| ("splats", splats.as_entire_binding())).collect();
        let inputs = [&band.bindings(), &buffers[..], &film, &splats, inputs.layers];
        recording.run_layers(&self.0, band.size, band.classes, &inputs);
    }
}
