//! Growth of lists: an iteration whose lists overflowed is redone with the capacity that it requested.

use crate::gpu::Gpu;
use crate::render::renderer::RenderError;
use crate::render::shared::frame::Frame;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::views::Views;
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::visibility::view::{Answers, ViewBuffers, ViewScratch, capacity_for};

impl Views {
    /// Grows items and lists to what a batch requested; `requests` holds items and nodes of each view. All
    /// maps are invalidated.
    ///
    /// # Errors
    /// [`RenderError::Setting`] if the device cannot bind the lists, with the options that make them shorter.
    pub fn grow(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        plan: &FramePlan,
        requests: &[[u32; 2]],
    ) -> Result<(), RenderError> {
        check_bindable(gpu, plan, requests)?;
        let Some(scratch) = &mut self.scratch else { return Ok(()) };
        let (mut item_capacity, mut list_words) = (scratch.item_capacity, scratch.list_words);
        for (view, &[items, nodes]) in self.all.iter_mut().zip(requests) {
            let (items, nodes) = (u64::from(items), u64::from(nodes));
            if items > item_capacity {
                item_capacity = capacity_for(items);
            }
            let buffers = &mut view.buffers;
            if nodes <= buffers.node_capacity {
                continue;
            }
            view.map_of = None;
            if buffers.answers == Answers::DepthMap {
                buffers.node_capacity = capacity_for(nodes);
                list_words = list_words.max(plan.list_words(buffers.texels, buffers.node_capacity));
            } else {
                let projected = plan.projected_triangles(view.role, u64::from(scene.triangles));
                *buffers = ViewBuffers::new(gpu, projected, buffers.texels, capacity_for(nodes), buffers.answers);
            }
        }
        if [item_capacity, list_words] != [scratch.item_capacity, scratch.list_words] {
            *scratch = ViewScratch::new(gpu, item_capacity, list_words);
        }
        self.invalidate_maps();
        self.write_capacities(gpu);
        Ok(())
    }
}

impl Frame {
    /// Grows the lists of all views ([`Views::grow`]).
    ///
    /// # Errors
    /// As [`Views::grow`].
    pub fn grow(&mut self, gpu: &Gpu, scene: &GpuScene, requests: &[[u32; 2]]) -> Result<(), RenderError> {
        self.rsm_of = None;
        self.views.grow(gpu, scene, &self.plan, requests)
    }
}

/// Checks that the device can bind lists of the requested lengths.
fn check_bindable(gpu: &Gpu, plan: &FramePlan, requests: &[[u32; 2]]) -> Result<(), RenderError> {
    let limit = gpu.capabilities.max_storage_bytes;
    for (&[_, nodes], view) in requests.iter().zip(plan.views()) {
        if 4 * plan.list_words(view.texels, capacity_for(u64::from(nodes))) > limit {
            let resolution = view.texels.resolution;
            return Err(RenderError::Setting(format!(
                "a view of {resolution}^2 texels needs {nodes} list nodes, more than this device can bind; choose a smaller \
                 --bundle-resolution, --light-resolution or --vpl-resolution"
            )));
        }
    }
    Ok(())
}
