//! What moves and refines vertices on the device, kept from frame to frame: one compute stage before all else reads the vertices.

use crate::gpu::{Gpu, GpuError};
use crate::gpu_scene::GpuScene;
use crate::passes::deform::Deform;
use crate::passes::tessellate::Tessellate;
use crate::rest::Rest;
use crate::scene::geometry::{Origin, Sources};
use crate::scene::refine::Refined;
use crate::scene::{Geometry, Scene};

/// Made when a scene first asks for it.
#[derive(Default)]
pub struct Posing {
    rest: Option<Rest>,
    deform: Option<Deform>,
    tessellate: Option<Tessellate>,
    /// The last pose, flattened, where any of it is refined.
    flat: (Geometry, Sources),
}

impl Posing {
    /// Flattens a pose; says whether refining makes the same vertices and triangles as in the one that was [kept](Self::keep).
    pub fn flatten(&mut self, scene: &Scene) -> (Geometry, Sources, bool) {
        let (mut geometry, mut sources) = std::mem::take(&mut self.flat);
        let same = geometry.follow(&mut sources, scene);
        (geometry, sources, same)
    }

    /// Keeps a pose that is on the device for the next one to go on from.
    pub fn keep(&mut self, geometry: Geometry, sources: Sources) {
        if geometry.tessellated > 0 {
            self.flat = (geometry, sources);
        }
    }

    /// Refines what is refined, for the first picture of a scene, whose other vertices are uploaded where they are.
    ///
    /// # Errors
    /// [`GpuError::Device`] where what is needed exceeds what the adapter can bind, with the numbers.
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
        self.place(gpu, gpu_scene, scene, geometry, (&[], &sources.refined))
    }

    /// Puts the vertices that refining makes for a pose to come where the pose before has them.
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
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("look back") });
        tessellate.look_back(gpu, &mut encoder, gpu_scene, scene, geometry, &sources.refined);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Bytes of what refines; the scene's, as those of its vertices are.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let Some(tessellate) = &self.tessellate else { return 0 };
        tessellate.bytes() + self.rest.as_ref().map_or(0, Rest::bytes)
    }

    /// Puts all vertices where a pose of the scene has them; its geometry has as many of those that are not refined as ever.
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
        self.place(gpu, gpu_scene, scene, geometry, (&sources.origins, &sources.refined))
    }

    fn place(
        &mut self,
        gpu: &Gpu,
        gpu_scene: &GpuScene,
        scene: &Scene,
        geometry: &Geometry,
        (origins, refined): (&[Origin], &Refined),
    ) -> Result<(), GpuError> {
        let rest = match &mut self.rest {
            Some(rest) => rest,
            None => self.rest.insert(Rest::new(gpu, scene)?),
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
