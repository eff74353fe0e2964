//! Deforms and tessellates meshes on the device, before any pass reads the vertices. Buffers and pipelines
//! are kept between frames.

use crate::gpu::{Gpu, GpuError};
use crate::render::upload::deform::Deform;
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::upload::rest_mesh::RestMesh;
use crate::render::upload::tessellate::Tessellate;
use crate::scene::model::geometry::Origin;
use crate::scene::tessellation::flatten::Sources;
use crate::scene::tessellation::refine::Refined;
use crate::scene::{Geometry, Scene};

/// The passes deform and tessellate with their buffers, which are created when a scene first needs them.
#[derive(Default)]
pub struct Deformer {
    rest: Option<RestMesh>,
    deform: Option<Deform>,
    tessellate: Option<Tessellate>,
    /// The geometry of the last pose and its sources, if any mesh is tessellated.
    last: (Geometry, Sources),
}

impl Deformer {
    /// Returns the geometry of a pose and its sources. The third value is true if tessellation has the same
    /// vertices and triangles as in the pose that was [kept](Self::keep).
    pub fn flatten(&mut self, scene: &Scene) -> (Geometry, Sources, bool) {
        let (mut geometry, mut sources) = std::mem::take(&mut self.last);
        let same = geometry.follow(&mut sources, scene);
        (geometry, sources, same)
    }

    /// Keeps the geometry of the pose that is on the device, which [`Self::flatten`] updates for the next
    /// pose.
    pub fn keep(&mut self, geometry: Geometry, sources: Sources) {
        if geometry.tessellated > 0 {
            self.last = (geometry, sources);
        }
    }

    /// Evaluates tessellated vertices for the first picture of a scene, whose other vertices are uploaded in
    /// their pose.
    ///
    /// # Errors
    /// [`GpuError::Device`] if a buffer exceeds the adapter's limit for bindings.
    pub fn refine(
        &mut self,
        gpu: &Gpu,
        gpu_scene: &GpuScene,
        scene: &Scene,
        geometry: &Geometry,
        sources: &Sources,
    ) -> Result<(), GpuError> {
        if sources.refined.blends.is_empty() {
            return Ok(());
        }
        self.evaluate(gpu, gpu_scene, scene, geometry, (&[], &sources.refined))
    }

    /// Evaluates the tessellated vertices of the next pose in the current pose, for reprojection.
    pub fn look_back(
        &mut self,
        gpu: &Gpu,
        gpu_scene: &GpuScene,
        scene: &Scene,
        geometry: &Geometry,
        sources: &Sources,
    ) {
        let Some(tessellate) = &mut self.tessellate else { return };
        let mut encoder =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("last pose") });
        tessellate.record_in_last_pose(gpu, &mut encoder, gpu_scene, scene, geometry, &sources.refined);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Returns the bytes of the tessellation's buffers, which count as the scene's.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let Some(tessellate) = &self.tessellate else { return 0 };
        tessellate.bytes() + self.rest.as_ref().map_or(0, RestMesh::bytes)
    }

    /// Evaluates all vertices in a pose of the scene. The number of vertices that are not tessellated is
    /// always the same.
    ///
    /// # Errors
    /// As [`Self::refine`].
    pub fn run(
        &mut self,
        gpu: &Gpu,
        gpu_scene: &GpuScene,
        scene: &Scene,
        geometry: &Geometry,
        sources: &Sources,
    ) -> Result<(), GpuError> {
        self.evaluate(gpu, gpu_scene, scene, geometry, (&sources.origins, &sources.refined))
    }

    /// Records and submits pass deform for `origins`, and pass tessellate for `refined`.
    fn evaluate(
        &mut self,
        gpu: &Gpu,
        gpu_scene: &GpuScene,
        scene: &Scene,
        geometry: &Geometry,
        (origins, refined): (&[Origin], &Refined),
    ) -> Result<(), GpuError> {
        let rest = match &mut self.rest {
            Some(rest) => rest,
            None => self.rest.insert(RestMesh::new(gpu, scene)?),
        };
        rest.pose(gpu, scene);
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("pose") });
        if !origins.is_empty() {
            let deform = self.deform.get_or_insert_with(|| Deform::new(gpu, gpu_scene, rest, origins));
            deform.record(gpu, &mut encoder, gpu_scene, rest, origins);
        }
        if !refined.blends.is_empty() {
            let tessellate = match &mut self.tessellate {
                Some(tessellate) => tessellate,
                None => self.tessellate.insert(Tessellate::new(gpu, gpu_scene, scene, rest, refined)?),
            };
            tessellate.record(gpu, &mut encoder, gpu_scene, rest, scene, geometry, refined);
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }
}
