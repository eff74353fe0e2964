//! light_subpath: y1 or y2 of the iteration, and the view from it (section 4.1).
//!
//! Reads the lists around the vertex before. Writes a light vertex and the next view. Skipped without lights, and
//! where the strategies need no VPL.

use crate::gpu::{Compute, Gpu};
use crate::gpu_scene::GpuScene;
use crate::pixels::Band;
use crate::view::ViewBuffers;

/// The pass.
pub struct LightSubpath {
    y1: Compute,
    y2: Compute,
}

impl LightSubpath {
    /// Builds the pipelines.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[&str]) -> Self {
        let with_y1 = [flags, &["Y1"]].concat();
        Self {
            y1: Compute::new(gpu, "light_subpath", "light_subpath", &with_y1),
            y2: Compute::new(gpu, "light_subpath", "light_subpath", flags),
        }
    }

    /// Records the making of y1 (`vertex` 1, from the light) or y2 (from y1) and of the view from it.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        y0: &wgpu::Buffer,
        rsm: Option<&wgpu::Buffer>,
        vertex: u32,
        from: &ViewBuffers,
        light_vertices: &wgpu::Buffer,
        next: &ViewBuffers,
    ) {
        let mut bindings = scene.with(&from.bindings());
        bindings.extend(band.bindings());
        bindings.extend([
            ("y0", y0.as_entire_binding()),
            ("light_vertices", light_vertices.as_entire_binding()),
            ("next_view", next.view.as_entire_binding()),
        ]);
        bindings.extend(rsm.map(|table| ("rsm", table.as_entire_binding())));
        let pass = if vertex == 1 { &self.y1 } else { &self.y2 };
        pass.record(gpu, encoder, [1, 1], &bindings);
    }
}
