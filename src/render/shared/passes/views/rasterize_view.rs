//! Rasterizes every triangle into a view (docs/method.md, section "Exact visibility"), in two or three
//! passes:
//!
//! - view_setup: projects each triangle, inserts triangles that touch few texels into lists, and writes draw
//!   items for the others.
//! - view_lists: inserts the large triangles of the items into lists.
//! - depth_maps: reduces the lists around light vertices to the nearest triangle of each texel (`--visibility
//!   fast` only).
//!
//! Reads: the geometry, the view and, for depth maps, materials with holes. Writes: projected triangles,
//! lists or depth map, tally. Skipped when: ray queries answer; a light without extent stays the same, so
//! that the map around it is kept.

use crate::gpu::{Compute, Flag, Gpu, rows};
use crate::render::recording::Recording;
use crate::render::visibility::view::{Answers, ViewBuffers, ViewScratch};

/// Most workgroups that share the items: enough for a large device, few enough to cost nothing for few items.
const GROUPS: u32 = 1024;

/// The passes.
pub struct RasterizeView {
    setup: Compute,
    lists: Compute,
    depth_maps: Option<Compute>,
    /// Random bits of the iteration, which depth maps decide with at blended surfaces.
    noise: Option<wgpu::Buffer>,
}

impl RasterizeView {
    /// Builds the pipelines for exact visibility or, if `fast`, for centre-sampled lists and depth maps.
    /// `surface` holds the flags of shaders that read surfaces.
    #[must_use]
    pub fn new(gpu: &Gpu, fast: bool, depth_maps: bool, surface: &[Flag]) -> Self {
        let per_texel = (!gpu.capabilities.software).then_some(Flag::PerTexel);
        let flags: Vec<Flag> = fast.then_some(Flag::Fast).into_iter().chain(per_texel).collect();
        Self {
            setup: Compute::new(gpu, "shared/views/view_setup", &flags),
            lists: Compute::new(gpu, "shared/views/view_lists", &flags),
            depth_maps: depth_maps
                .then(|| Compute::new(gpu, "shared/views/depth_maps", &[surface, &[Flag::Fast]].concat())),
            noise: (depth_maps && surface.contains(&Flag::Masks)).then(|| gpu.uniform::<u32>("noise")),
        }
    }

    /// Writes the random bits of an iteration.
    pub fn write_noise(&self, gpu: &Gpu, noise: u32) {
        if let Some(buffer) = &self.noise {
            gpu.queue.write_buffer(buffer, 0, bytemuck::bytes_of(&noise));
        }
    }

    /// Records the passes for one view.
    pub fn record(&self, recording: &mut Recording, view: &ViewBuffers, scratch: &ViewScratch) {
        view.reset(&mut recording.encoder, scratch);
        let mut inputs = vec![
            ("view", view.view.as_entire_binding()),
            ("projected_triangles", view.projected_triangles.as_entire_binding()),
            ("items", scratch.items.as_entire_binding()),
            ("tally", scratch.tally.as_entire_binding()),
            ("lists", view.listed_in(scratch).as_entire_binding()),
            ("map", view.lists.as_entire_binding()),
        ];
        inputs.extend(self.noise.iter().map(|noise| ("noise", noise.as_entire_binding())));
        let triangles = recording.scene.triangles;
        recording.run(&self.setup, rows(triangles), &[&inputs]);
        // On a GPU few large triangles are many items.
        let groups = if recording.gpu.capabilities.software { triangles.clamp(1, GROUPS) } else { GROUPS };
        recording.run(&self.lists, [64 * groups, 1], &[&inputs]);
        if let Some(pass) = self.depth_maps.as_ref().filter(|_| view.answers == Answers::DepthMap) {
            recording.run(pass, rows(view.texels.count() as u32), &[&inputs]);
        }
    }
}
