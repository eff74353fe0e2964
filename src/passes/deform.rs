//! deform: puts every vertex where the pose has it, into the one buffer that every pass and ray query reads.
//!
//! Reads vertices as they rest, joint matrices, weights of morph targets and placements of instances ([`Rest`]). Writes the scene's
//! positions, normals and tangents, but for those of refined meshes, which are [`super::tessellate`]'s. Skipped in scenes that stand
//! still, and in the first picture, whose vertices are uploaded as they are.

use crate::gpu::{Compute, Gpu, rows};
use crate::gpu_scene::GpuScene;
use crate::layouts::Origin;
use crate::rest::Rest;
use crate::scene::geometry;

const NONE: u32 = u32::MAX;

/// The pass and what it reads.
pub struct Deform {
    pipeline: Compute,
    origins: wgpu::Buffer,
}

impl Deform {
    /// Builds the pipeline; `origins` are the vertices of a scene's geometry.
    #[must_use]
    pub fn new(gpu: &Gpu, gpu_scene: &GpuScene, rest: &Rest, origins: &[geometry::Origin]) -> Self {
        Self {
            pipeline: Compute::new(
                gpu,
                "deform",
                "deform",
                &[rest.flags().as_slice(), gpu_scene.vertex_flags()].concat(),
            ),
            origins: gpu.storage("origins", size_of_val(origins) as u64),
        }
    }

    /// Records the pass for the pose that `rest` has. `origins` are the vertices of its geometry, as many as ever.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        rest: &Rest,
        origins: &[geometry::Origin],
    ) {
        if origins.is_empty() {
            return;
        }
        let origins: Vec<_> = origins
            .iter()
            .map(|o| Origin {
                corners: o.corners.map_or([NONE; 3], |corners| corners.map(|vertex| rest.index(o.instance, vertex))),
                source: rest.index(o.instance, o.vertex),
            })
            .collect();
        gpu.queue.write_buffer(&self.origins, 0, bytemuck::cast_slice(&origins));
        let mut own = rest.bindings();
        own.push(("origins", self.origins.as_entire_binding()));
        self.pipeline.record(gpu, encoder, rows(origins.len() as u32), &gpu_scene.with(&own));
    }
}
