//! deform: evaluates every vertex in the current pose, by morph targets, skinning and the transforms of
//! instances.
//!
//! Reads: the rest pose, joint matrices, weights of morph targets and transforms of instances ([`RestMesh`]).
//! Writes: positions, normals and tangents of the scene, except those of tessellated meshes (pass
//! tessellate). Skipped when: the scene is static; the picture is the first one, whose vertices are uploaded
//! in their pose.

use crate::gpu::{Compute, Gpu, rows};
use crate::render::layouts::Origin;
use crate::render::layouts::index::NONE;
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::upload::rest_mesh::RestMesh;
use crate::scene::model::geometry;

/// The pass, and the sources of its vertices.
pub struct Deform {
    pipeline: Compute,
    origins: wgpu::Buffer,
}

impl Deform {
    /// Builds the pipeline. `origins` are the sources of the geometry's vertices; only their number is used.
    #[must_use]
    pub fn new(gpu: &Gpu, gpu_scene: &GpuScene, rest: &RestMesh, origins: &[geometry::Origin]) -> Self {
        Self {
            pipeline: Compute::new(gpu, "upload/deform", &[rest.flags().as_slice(), gpu_scene.vertex_flags()].concat()),
            origins: gpu.storage("origins", (origins.len() * size_of::<Origin>()) as u64),
        }
    }

    /// Records the pass for the pose of `rest`. `origins` are the sources of the geometry's vertices; their
    /// number is always the same.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        rest: &RestMesh,
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
