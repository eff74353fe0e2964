//! light_subpath: the VPL y1 or y2 of the iteration, and the view around it (section 4.1).
//!
//! Reads: the map around the vertex before. Writes: a light vertex and the next view. Skipped when: there are
//! no lights, or the strategies need no VPL.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// The pass.
pub struct LightSubpath {
    y1: Compute,
    y2: Compute,
}

/// The inputs and outputs of a VPL.
pub struct LightSubpathInputs<'a> {
    /// The light point y0.
    pub y0: wgpu::BindingResource<'a>,
    /// The reflective shadow map of y0, if its light has one.
    pub rsm: Option<&'a wgpu::Buffer>,
    /// Places where light of the sky comes in.
    pub guide: Option<&'a wgpu::TextureView>,
    /// The map around the vertex before.
    pub from: &'a ViewBuffers,
    /// The VPLs y1 and y2 of each class.
    pub light_vertices: &'a wgpu::Buffer,
    /// The view around the new vertex.
    pub next: &'a ViewBuffers,
}

impl LightSubpath {
    /// Builds the pipelines of y1 and y2 from the flags of either.
    #[must_use]
    pub fn new(gpu: &Gpu, y1: &[Flag], y2: &[Flag]) -> Self {
        Self {
            y1: Compute::new(gpu, "shared/light/light_subpath", &[y1, &[Flag::Y1]].concat()),
            y2: Compute::new(gpu, "shared/light/light_subpath", y2),
        }
    }

    /// Records the pass for y1 (`vertex` 1, from y0) or y2 (from y1). `band` holds the uniform of the class.
    pub fn record(&self, recording: &mut Recording, band: &Band, vertex: u32, inputs: &LightSubpathInputs) {
        let buffers = [
            ("y0", inputs.y0.clone()),
            ("light_vertices", inputs.light_vertices.as_entire_binding()),
            ("next_view", inputs.next.view.as_entire_binding()),
        ];
        let rsm: Vec<_> = inputs.rsm.iter().map(|table| ("rsm", table.as_entire_binding())).collect();
        let guide: Vec<_> =
            inputs.guide.map(|guide| ("sky_guide", wgpu::BindingResource::TextureView(guide))).into_iter().collect();
        let pass = if vertex == 1 { &self.y1 } else { &self.y2 };
        recording.run(pass, [1, 1], &[&inputs.from.bindings(), &band.bindings(), &buffers, &rsm, &guide]);
    }
}
