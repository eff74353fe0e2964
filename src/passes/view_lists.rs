//! view_lists: rasterizes a view's draw items into per-texel linked lists.
//!
//! Reads records and items. Writes lists and node count. Skipped for the light's view while the light stays the same.

use crate::gpu::{Gpu, Raster, RasterTargets};
use crate::view::ViewBuffers;

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

/// The pass, with the target that gives rasterization its size and receives nothing.
pub struct ViewLists {
    raster: Raster,
    target: wgpu::TextureView,
    side: [u32; 2],
}

impl ViewLists {
    /// Builds the pipeline for views of at most `largest` pixels.
    #[must_use]
    pub fn new(gpu: &Gpu, fast: bool, largest: [u32; 2]) -> Self {
        let flags: &[&str] = if fast { &["FAST"] } else { &[] };
        let side = largest.map(|s| s.max(1));
        Self {
            raster: Raster::new(gpu, "view_lists", "view_lists", flags, FORMAT, false, None),
            target: gpu.target("view_lists", side, FORMAT, wgpu::TextureUsages::empty()),
            side,
        }
    }

    /// Records the pass for one view.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, view: &ViewBuffers) {
        let atlas = view.atlas();
        debug_assert!(atlas[0] <= self.side[0] && atlas[1] <= self.side[1], "the target was made for smaller views");
        let targets = RasterTargets { color: &self.target, clear: wgpu::Color::BLACK, depth: None };
        let bindings = [
            ("view", view.view.as_entire_binding()),
            ("records", view.records.as_entire_binding()),
            ("items", view.items.as_entire_binding()),
            ("lists", view.lists.as_entire_binding()),
            ("node_count", view.node_count.as_entire_binding()),
        ];
        self.raster.record(gpu, encoder, &targets, atlas, &bindings, |pass| pass.draw_indirect(&view.draw, 0));
    }
}
