//! connect: joins z_j of every pixel to one vertex of the light subpath (eq. (3)-(8)); one run per strategy.
//!
//! Reads the eye vertices, the light vertices and the lists around the one that is joined. Adds to the iteration's image.
//! Skipped without lights.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;
use crate::view::ViewBuffers;

/// The pass, for one number of light vertices.
pub struct Connect(Compute);

impl Connect {
    /// Builds the pipeline for strategies with `s` light vertices. `clamped`: the paper's bounded geometry term.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str], s: u32, clamped: bool) -> Self {
        let label = ["connect_light", "connect_y1", "connect_y2"][s as usize - 1];
        let mut flags = flags.to_vec();
        if s == 1 {
            flags.push("LIGHT");
        }
        if clamped {
            flags.push("CLAMPED");
        }
        Self(Compute::new(gpu, label, "connect", &flags))
    }

    /// Records the pass.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        strategy: &wgpu::Buffer,
        view: &ViewBuffers,
        y0: &wgpu::Buffer,
        light_vertices: &wgpu::Buffer,
        rsm: Option<&wgpu::Buffer>,
    ) {
        let mut bindings = scene.with(&view.bindings());
        bindings.extend(band.bindings());
        bindings.extend([
            ("strategy", strategy.as_entire_binding()),
            ("y0", y0.as_entire_binding()),
            ("light_vertices", light_vertices.as_entire_binding()),
        ]);
        bindings.extend(rsm.map(|table| ("rsm", table.as_entire_binding())));
        self.0.record(gpu, encoder, band.size, &bindings);
    }
}
