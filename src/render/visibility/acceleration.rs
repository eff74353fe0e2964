//! Acceleration structures for ray queries, built from the positions that raster passes read.
//!
//! Each run of consecutive triangles that rays may pass (masked or blended), or that they may not, is a
//! geometry, so that the triangle of a hit is the first triangle of its geometry plus the primitive index.
//! The others are opaque: queries commit them without a test by the shader.

use crate::gpu::Gpu;
use crate::scene::{Geometry, Scene};

/// The acceleration structure of a scene's triangles.
pub struct Acceleration {
    tlas: wgpu::Tlas,
    first_triangles: wgpu::Buffer,
}

impl Acceleration {
    /// Builds the structures. The device must have ray queries.
    #[must_use]
    pub fn new(gpu: &Gpu, positions: &wgpu::Buffer, scene: &Scene, geometry: &Geometry) -> Self {
        // Scenes without triangles have one degenerate triangle (see GpuScene).
        let mut triangles = geometry.triangles.clone();
        if triangles.is_empty() {
            triangles.push([0, 1, 2]);
        }
        let indices = gpu.upload_for_building("indices", &triangles, wgpu::BufferUsages::empty());
        let has_holes = |triangle: u32| {
            let material = geometry.materials.get(triangle as usize);
            material.is_some_and(|&m| scene.materials[m as usize].may_be_passed())
        };
        let runs = runs(triangles.len() as u32, has_holes);
        let first_triangles: Vec<u32> = runs.iter().map(|run| run.0).collect();

        let vertices = geometry.vertices.len().max(3) as u32;
        let sizes: Vec<_> = runs
            .iter()
            .map(|&(_, count, holes)| wgpu::BlasTriangleGeometrySizeDescriptor {
                vertex_format: wgpu::VertexFormat::Float32x3,
                vertex_count: vertices,
                index_format: Some(wgpu::IndexFormat::Uint32),
                index_count: Some(3 * count),
                flags: if holes {
                    wgpu::AccelerationStructureGeometryFlags::empty()
                } else {
                    wgpu::AccelerationStructureGeometryFlags::OPAQUE
                },
            })
            .collect();
        let flags = wgpu::AccelerationStructureFlags::PREFER_FAST_TRACE;
        let update_mode = wgpu::AccelerationStructureUpdateMode::Build;
        let blas = gpu.blas(
            &wgpu::CreateBlasDescriptor { label: Some("scene"), flags, update_mode },
            wgpu::BlasGeometrySizeDescriptors::Triangles { descriptors: sizes.clone() },
        );
        let mut tlas =
            gpu.tlas(&wgpu::CreateTlasDescriptor { label: Some("scene"), max_instances: 1, flags, update_mode });
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        tlas[0] = Some(wgpu::TlasInstance::new(&blas, identity, 0, 0xff));

        let geometries = sizes
            .iter()
            .zip(&runs)
            .map(|(size, run)| wgpu::BlasTriangleGeometry {
                size,
                vertex_buffer: positions,
                first_vertex: 0,
                vertex_stride: 16,
                index_buffer: Some(&indices),
                first_index: Some(3 * run.0),
                transform_buffer: None,
                transform_buffer_offset: None,
            })
            .collect();
        let entry =
            wgpu::BlasBuildEntry { blas: &blas, geometry: wgpu::BlasGeometries::TriangleGeometries(geometries) };
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("acceleration") });
        encoder.build_acceleration_structures([&entry], [&tlas]);
        gpu.queue.submit([encoder.finish()]);
        Self { tlas, first_triangles: gpu.upload("first_triangles", &first_triangles) }
    }

    /// Returns the bindings of shaders/visibility/ray_query.wesl.
    #[must_use]
    pub fn bindings(&self) -> [(&str, wgpu::BindingResource<'_>); 2] {
        [("acceleration", self.tlas.as_binding()), ("first_triangles", self.first_triangles.as_entire_binding())]
    }
}

/// Returns first triangle, count and kind of each run of triangles of one kind.
fn runs(count: u32, kind: impl Fn(u32) -> bool) -> Vec<(u32, u32, bool)> {
    let mut runs: Vec<(u32, u32, bool)> = Vec::new();
    for triangle in 0..count {
        match runs.last_mut() {
            Some(run) if run.2 == kind(triangle) => run.1 += 1,
            _ => runs.push((triangle, 1, kind(triangle))),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_keep_the_order() {
        assert_eq!(runs(6, |t| (2..4).contains(&t)), [(0, 2, false), (2, 2, true), (4, 2, false)]);
        assert_eq!(runs(2, |_| true), [(0, 2, true)]);
        assert_eq!(runs(0, |_| true), []);
    }
}
