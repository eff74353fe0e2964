//! extend: from z_j of every pixel along one ray-bundle to z_(j+1) (eq. (1)), and the emission of a hit:
//! strategies (0, j + 2).
//!
//! Reads: the bundle's lists. Writes: the eye vertices, the iteration's image, and the guides of what mirrors
//! show. Skipped when: no connection or emitter needs z_(j+1).

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::layouts::extend::SWIZZLE;
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// Dispatches cover a multiple of this number of pixel rows: the rows of a workgroup times `SWIZZLE` of the
/// shader.
const ROWS: u32 = 8 * SWIZZLE;

/// The pass.
pub struct Extend(Compute);

impl Extend {
    /// Builds the pipeline. With `last` only hits on emitters count, and no vertex is made.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], last: bool) -> Self {
        let mut flags = flags.to_vec();
        if last {
            flags.push(Flag::Last);
        }
        Self(Compute::new(gpu, "shared/paths/extend", &flags))
    }

    /// Records the pass. `guides` are those of a frame that is denoised.
    pub fn record(
        &self,
        recording: &mut Recording,
        band: &Band,
        strategy: &wgpu::Buffer,
        bundle: &ViewBuffers,
        guides: Option<&wgpu::Buffer>,
        sky_guide: Option<&wgpu::TextureView>,
    ) {
        let strategy = [("strategy", strategy.as_entire_binding())];
        let guides: Vec<_> = guides.iter().map(|guides| ("guides", guides.as_entire_binding())).collect();
        let sky_guide: Vec<_> =
            sky_guide.map(|guide| ("sky_guide", wgpu::BindingResource::TextureView(guide))).into_iter().collect();
        let [columns, rows] = band.size;
        let threads = [columns, rows.next_multiple_of(ROWS)];
        recording.run(&self.0, threads, &[&bundle.bindings(), &band.bindings(), &strategy, &guides, &sky_guide]);
    }
}
