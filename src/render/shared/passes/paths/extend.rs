//! extend: from z_j of every pixel to z_(j+1) (eq. (1)), along one ray-bundle or a direction of its own, and the
//! emission of a hit: strategies (0, j + 2).
//!
//! Reads: the bundle's lists, or what rays are traced through. Writes: the eye vertices, the iteration's image, and the guides of what mirrors
//! show. Skipped when: no connection or emitter needs z_(j+1).

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::layouts::extend::SWIZZLE;
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// The pass.
pub struct Extend {
    pass: Compute,
    /// Dispatches cover a multiple of this number of pixel rows.
    rows: u32,
}

impl Extend {
    /// Builds the pipeline. With `last` only hits on emitters count, and no vertex is made.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], last: bool) -> Self {
        let mut flags = flags.to_vec();
        flags.extend(last.then_some(Flag::Last));
        let swizzled = flags.contains(&Flag::Swizzled);
        Self { pass: Compute::new(gpu, "shared/paths/extend", &flags), rows: 8 * if swizzled { SWIZZLE } else { 1 } }
    }

    /// Records the pass, without a bundle where pixels draw directions of their own. `guides` are those of a frame
    /// that is denoised.
    pub fn record(
        &self,
        recording: &mut Recording,
        band: &Band,
        strategy: wgpu::BindingResource,
        bundle: Option<&ViewBuffers>,
        guides: Option<&wgpu::Buffer>,
        sky_guide: Option<&wgpu::TextureView>,
    ) {
        let strategy = [("strategy", strategy)];
        let bundle: Vec<_> = bundle.into_iter().flat_map(ViewBuffers::bindings).collect();
        let guides: Vec<_> = guides.iter().map(|guides| ("guides", guides.as_entire_binding())).collect();
        let sky_guide: Vec<_> =
            sky_guide.map(|guide| ("sky_guide", wgpu::BindingResource::TextureView(guide))).into_iter().collect();
        let [columns, rows] = band.size;
        let threads = [columns, rows.next_multiple_of(self.rows)];
        recording.run_layers(
            &self.pass,
            threads,
            band.classes,
            &[&bundle, &band.bindings(), &strategy, &guides, &sky_guide],
        );
    }
}
