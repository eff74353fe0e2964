//! view_lists: puts triangles of large boxes into a view's per-texel linked lists.
//!
//! Reads records and items. Writes lists and node count. Skipped for the light's view while the light stays the same.

use crate::gpu::{Compute, Gpu};
use crate::view::ViewBuffers;

/// Workgroups that share the items: enough for a large device, few enough to cost nothing where there are no items.
const GROUPS: u32 = 1024;

/// The pass.
pub struct ViewLists(Compute);

impl ViewLists {
    /// Builds the pipeline for exact or `fast` visibility.
    #[must_use]
    pub fn new(gpu: &Gpu, fast: bool) -> Self {
        let flags: &[&str] = if fast { &["FAST"] } else { &[] };
        Self(Compute::new(gpu, "view_lists", "view_lists", flags))
    }

    /// Records the pass for one view.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, view: &ViewBuffers) {
        let bindings = [
            ("view", view.view.as_entire_binding()),
            ("records", view.records.as_entire_binding()),
            ("items", view.items.as_entire_binding()),
            ("draw", view.draw.as_entire_binding()),
            ("lists", view.lists.as_entire_binding()),
            ("node_count", view.node_count.as_entire_binding()),
        ];
        self.0.record(gpu, encoder, [64 * GROUPS, 1], &bindings);
    }
}
