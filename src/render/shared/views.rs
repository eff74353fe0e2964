//! The views of a light subpath on the device: buffers by role, and the requests that they log.
//!
//! A view that is filled logs how many draw items and list nodes it requested. Requests have a slot for each
//! fill: one for each view but those of candidates, then one for each light candidate beside y0, even where
//! candidates take turns in one view.

use crate::gpu::Gpu;
use crate::render::layouts;
use crate::render::recording::Recording;
use crate::render::shared::passes::views::rasterize_view::RasterizeView;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::views::ViewRole;
use crate::render::visibility::view::{Answers, ViewBuffers, ViewScratch};

/// A view, and the light that its map was made for.
pub struct View {
    /// The purpose.
    pub role: ViewRole,
    /// Buffers.
    pub buffers: ViewBuffers,
    /// The light without extent whose map this is, while the map can be reused.
    pub map_of: Option<u32>,
}

/// All views.
pub struct Views {
    /// In the order of [`FramePlan::views`].
    pub all: Vec<View>,
    /// None if rays answer all views, or if there are no views.
    pub rasterize: Option<RasterizeView>,
    /// Items and lists that are needed only while a view is filled.
    pub scratch: Option<ViewScratch>,
    /// Requests and capacities by slot.
    pub requests: wgpu::Buffer,
    /// Views that are not those of candidates: the first slots.
    own_slots: usize,
    slots: usize,
    /// True if there are light candidates.
    has_candidates: bool,
    /// True if maps of candidates are kept for the next iteration.
    reuses: bool,
}

impl Views {
    /// Allocates the views of a plan.
    #[must_use]
    pub fn new(gpu: &Gpu, triangles: u64, plan: &FramePlan) -> Self {
        let limit = gpu.capabilities.max_storage_bytes;
        let view = |role, texels| {
            let capacity = plan.node_capacity(triangles, texels, limit);
            let projected = plan.projected_triangles(role, triangles);
            let buffers = ViewBuffers::new(gpu, projected, texels, capacity, plan.answers(role));
            View { role, buffers, map_of: None }
        };
        let all: Vec<_> = plan.views().into_iter().map(|planned| view(planned.role, planned.texels)).collect();
        let rasterized = plan.rasterizes_views();
        let own_slots = all.iter().filter(|view| !matches!(view.role, ViewRole::Candidate(_))).count();
        let slots =
            if plan.has_candidates() { own_slots + plan.light_candidates as usize - 1 } else { own_slots }.max(1);
        let out = Self {
            rasterize: rasterized
                .then(|| RasterizeView::new(gpu, plan.fast, plan.has_depth_maps(), &plan.surface_flags)),
            scratch: rasterized.then(|| {
                ViewScratch::new(gpu, plan.item_capacity(triangles, limit), plan.scratch_words(triangles, limit))
            }),
            requests: gpu.storage("requests", (slots * size_of::<layouts::ListRequest>()) as u64),
            all,
            own_slots,
            slots,
            has_candidates: plan.has_candidates(),
            reuses: plan.reuses(),
        };
        out.write_capacities(gpu);
        out
    }

    /// Returns the index of a view.
    #[expect(clippy::panic, reason = "only views of the plan are requested")]
    fn index(&self, role: ViewRole) -> usize {
        self.all.iter().position(|view| view.role == role).unwrap_or_else(|| panic!("there is no view {role:?}"))
    }

    /// Returns the buffers of a view.
    #[must_use]
    pub fn get(&self, role: ViewRole) -> &ViewBuffers {
        &self.all[self.index(role)].buffers
    }

    /// Returns the light that a view's map can be reused for.
    pub fn map_of(&mut self, role: ViewRole) -> &mut Option<u32> {
        let index = self.index(role);
        &mut self.all[index].map_of
    }

    /// Returns the bundles with their indices.
    pub fn bundles(&self) -> impl Iterator<Item = (u32, &View)> {
        self.all.iter().filter_map(|view| match view.role {
            ViewRole::Bundle(n) => Some((n, view)),
            _ => None,
        })
    }

    /// Writes the random bits that an iteration's depth maps decide with at blended surfaces.
    pub fn write_noise(&self, gpu: &Gpu, noise: u32) {
        if let Some(pass) = &self.rasterize {
            pass.write_noise(gpu, noise);
        }
    }

    /// Invalidates all maps.
    pub fn invalidate_maps(&mut self) {
        self.all.iter_mut().for_each(|view| view.map_of = None);
    }

    /// Swaps the maps of this iteration's candidates with those of the last one; `roles` holds the former,
    /// then the latter.
    pub fn swap_candidates(&mut self, roles: &[ViewRole]) {
        let (now, past) = roles.split_at(roles.len() / 2);
        for (&now, &past) in now.iter().zip(past) {
            let (now, past) = (self.index(now), self.index(past));
            self.all.swap(now, past);
            let role = self.all[now].role;
            self.all[now].role = std::mem::replace(&mut self.all[past].role, role);
        }
        self.invalidate_maps();
    }

    /// Records the rasterization of a view and logs its requests. Does nothing if rays answer.
    pub fn rasterize(&self, recording: &mut Recording, role: ViewRole) {
        self.rasterize_into(recording, role, self.index(role));
    }

    /// Records the rasterization of the view of the n-th light candidate, n > 0.
    pub fn rasterize_candidate(&self, recording: &mut Recording, role: ViewRole, n: usize) {
        self.rasterize_into(recording, role, self.own_slots + n - 1);
    }

    fn rasterize_into(&self, recording: &mut Recording, role: ViewRole, slot: usize) {
        let (Some(pass), Some(scratch)) = (&self.rasterize, &self.scratch) else { return };
        let view = self.get(role);
        if view.answers == Answers::Rays {
            return;
        }
        pass.record(recording, view, scratch);
        let at = (slot * size_of::<layouts::ListRequest>()) as u64;
        recording.encoder.copy_buffer_to_buffer(&scratch.tally, 0, &self.requests, at, 4 * ViewScratch::REQUESTED);
    }

    /// Returns the number of request slots, at least 1.
    #[must_use]
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// Returns the largest requests of each view, from those of each slot.
    #[must_use]
    pub fn requests_by_view(&self, slots: &[[u32; 2]]) -> Vec<[u32; 2]> {
        if !self.has_candidates {
            return slots[..self.all.len()].to_vec();
        }
        let (own, candidates) = slots.split_at(self.own_slots);
        // With reuse, y0's view is swapped with one of the last iteration.
        let candidates = candidates.iter().chain(own.first().filter(|_| self.reuses));
        let most = candidates.fold([0; 2], |most, requested| [0, 1].map(|i| most[i].max(requested[i])));
        let mut views = own.to_vec();
        views.resize(self.all.len(), most);
        if self.reuses {
            views[0] = most;
        }
        views
    }

    /// Writes the capacities that requests are compared with.
    pub fn write_capacities(&self, gpu: &Gpu) {
        // If there are candidates, the last view belongs to one of them; their capacities are equal.
        let views = (0..self.slots).map(|slot| self.all.get(slot).or(self.all.last()));
        let capacity = |view: &View| layouts::ListRequest {
            item_capacity: self.scratch.as_ref().map_or(0, |scratch| scratch.item_capacity) as u32,
            node_capacity: view.buffers.node_capacity as u32,
            ..Default::default()
        };
        let capacities: Vec<_> = views.map(|view| view.map(capacity).unwrap_or_default()).collect();
        gpu.queue.write_buffer(&self.requests, 0, bytemuck::cast_slice(&capacities));
    }

    /// Returns the bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let views: u64 = self.all.iter().map(|view| view.buffers.bytes()).sum();
        views + self.scratch.as_ref().map_or(0, ViewScratch::bytes)
    }
}
