//! The rest pose on the device: vertices, joint matrices, weights of morph targets and transforms of
//! instances.
//!
//! Vertices are uploaded once; a pose changes the other three. The passes [`crate::render::upload::deform`]
//! and [`crate::render::upload::tessellate`] read them (shaders/lib/scene/pose.wesl).

use glam::{Mat4, Vec3, Vec4};

use crate::gpu::{Flag, Gpu, GpuError};
use crate::render::layouts::index::NONE;
use crate::render::layouts::{Joint, MorphOffset, PosedInstance, RestVertex};
use crate::scene::Scene;
use crate::scene::animation::Shape;

/// The vertices of all instances of a scene in the rest pose.
pub struct RestMesh {
    /// Index of the first vertex of each instance.
    first: Vec<u32>,
    instances: Vec<PosedInstance>,
    vertices: wgpu::Buffer,
    posed_instances: wgpu::Buffer,
    /// Joints of vertices, if any mesh is skinned.
    skins: Option<wgpu::Buffer>,
    /// Offsets of vertices, if there are morph targets.
    morphs: Option<wgpu::Buffer>,
    /// Matrices of joints, then weights of morph targets, if there are any.
    pose_rows: Option<wgpu::Buffer>,
}

/// Returns the deformation of a mesh; None if it is rigid.
fn shape_of(scene: &Scene, mesh: usize) -> Option<&Shape> {
    scene.pose.as_ref()?.rig.shapes.iter().find(|shape| shape.mesh == mesh)
}

/// Returns a tangent with handedness 1 or -1 as w; zero without a tangent.
fn tangent(tangent: Option<&Vec4>) -> [f32; 4] {
    tangent.map_or([0.0; 4], |t| t.truncate().extend(if t.w < 0.0 { -1.0 } else { 1.0 }).to_array())
}

/// Joint matrices of all skins and weights of all shapes, with prefix sums of their numbers.
struct PoseData {
    matrices: Vec<[f32; 16]>,
    first_matrices: Vec<u32>,
    weights: Vec<f32>,
    first_weights: Vec<u32>,
}

impl PoseData {
    fn new(scene: &Scene) -> Self {
        let (skins, weights) = scene.pose.as_ref().map_or((&[][..], &[][..]), |pose| (&pose.skins, &pose.weights));
        Self {
            matrices: skins.iter().flatten().map(Mat4::to_cols_array).collect(),
            first_matrices: begins(skins.iter().map(Vec::len)),
            weights: weights.concat(),
            first_weights: begins(weights.iter().map(Vec::len)),
        }
    }
}

/// Returns the exclusive prefix sums of lengths, and their total as the last element.
fn begins(lengths: impl Iterator<Item = usize>) -> Vec<u32> {
    let mut begins = vec![0];
    begins.extend(lengths.scan(0, |end, length| {
        *end += length as u32;
        Some(*end)
    }));
    begins
}

impl RestMesh {
    /// Uploads the rest pose of a scene.
    ///
    /// # Errors
    /// [`GpuError::Device`] if a buffer exceeds the adapter's limit for bindings.
    pub fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let (mut rest, mut joints, mut offsets) = (Vec::new(), Vec::new(), Vec::new());
        let (mut first, mut instances) = (Vec::new(), Vec::new());
        for (i, instance) in scene.instances.iter().enumerate() {
            let shape = shape_of(scene, instance.mesh);
            let mesh = shape.map_or(&scene.meshes[instance.mesh], |shape| &shape.base);
            let targets = shape.map_or(&[][..], |shape| &shape.deformation.targets);
            first.push(rest.len() as u32);
            let morph = offsets.len() as u32;
            let at = |offsets: &[Vec3], v: usize| offsets.get(v).copied().unwrap_or_default().extend(0.0).to_array();
            for target in targets {
                offsets.extend((0..mesh.positions.len()).map(|v| MorphOffset {
                    position: at(&target.positions, v),
                    normal: if mesh.normals.is_empty() { [0.0; 4] } else { at(&target.normals, v) },
                    tangent: if mesh.tangents.is_empty() { [0.0; 4] } else { at(&target.tangents, v) },
                }));
            }
            for (v, position) in mesh.positions.iter().enumerate() {
                let joints_begin = joints.len() as u32;
                if let Some(shape) = shape.filter(|shape| shape.skin.is_some()) {
                    let of = shape.deformation.joints_of(v).iter();
                    joints.extend(of.map(|&(index, weight)| Joint { index, weight }));
                }
                rest.push(RestVertex {
                    position: position.to_array(),
                    instance: i as u32,
                    normal: mesh.normals.get(v).copied().unwrap_or_default().to_array(),
                    joints_begin,
                    tangent: tangent(mesh.tangents.get(v)),
                    joints_end: joints.len() as u32,
                    morph: morph + v as u32,
                    ..Default::default()
                });
            }
            let (targets, vertices) = (targets.len() as u32, mesh.positions.len() as u32);
            instances.push(PosedInstance { targets, vertices, ..Default::default() });
        }
        let PoseData { matrices, weights, .. } = PoseData::new(scene);
        let limit = gpu.capabilities.max_storage_bytes;
        let largest = size_of_val(rest.as_slice()).max(size_of_val(offsets.as_slice())).max(8 * joints.len()) as u64;
        if largest > limit {
            return Err(GpuError::Device(format!(
                "animated meshes have {} vertices and {} offsets of morph targets, which need a binding of {largest} bytes; the \
                 adapter's limit is {limit}; render frames one by one with --at",
                rest.len(),
                offsets.len()
            )));
        }
        let storage = |label, bytes: usize| gpu.storage(label, bytes as u64);
        Ok(Self {
            vertices: gpu.upload("rest", &rest),
            posed_instances: storage("posed_instances", size_of_val(instances.as_slice())),
            skins: (!joints.is_empty()).then(|| gpu.upload("joints", &joints)),
            morphs: (!offsets.is_empty()).then(|| gpu.upload("morph_offsets", &offsets)),
            pose_rows: (!joints.is_empty() || !offsets.is_empty())
                .then(|| storage("pose_rows", size_of_val(matrices.as_slice()) + size_of_val(weights.as_slice()))),
            first,
            instances,
        })
    }

    /// Returns the flags of shaders that evaluate vertices in a pose.
    #[must_use]
    pub fn flags(&self) -> Vec<Flag> {
        let flags = [(Flag::Skins, self.skins.is_some()), (Flag::Morphs, self.morphs.is_some())];
        flags.iter().filter(|(_, on)| *on).map(|(flag, _)| *flag).collect()
    }

    /// Returns the index of a vertex of an instance's mesh among all vertices.
    #[must_use]
    pub fn index(&self, instance: u32, vertex: u32) -> u32 {
        self.first[instance as usize] + vertex
    }

    /// Uploads the matrices, weights and transforms of a pose of the same scene.
    pub fn pose(&mut self, gpu: &Gpu, scene: &Scene) {
        let PoseData { matrices, weights, first_matrices, first_weights } = PoseData::new(scene);
        let shapes = scene.pose.as_ref().map_or(&[][..], |pose| &pose.rig.shapes);
        for (posed, instance) in self.instances.iter_mut().zip(&scene.instances) {
            let world = Mat4::from(instance.world_from_local);
            posed.world_from_local = [0, 1, 2].map(|row| world.row(row).to_array());
            if let Some(s) = shapes.iter().position(|shape| shape.mesh == instance.mesh) {
                posed.matrices = shapes[s].skin.map_or(NONE, |skin| first_matrices[skin]);
                posed.weights = (16 * matrices.len()) as u32 + first_weights[s];
                let weights = first_weights[s + 1] - first_weights[s];
                posed.targets = weights.min(shapes[s].deformation.targets.len() as u32);
            }
        }
        gpu.queue.write_buffer(&self.posed_instances, 0, bytemuck::cast_slice(&self.instances));
        if let Some(rows) = &self.pose_rows {
            gpu.queue.write_buffer(rows, 0, bytemuck::cast_slice(&matrices));
            gpu.queue.write_buffer(rows, size_of_val(matrices.as_slice()) as u64, bytemuck::cast_slice(&weights));
        }
    }

    /// Returns the bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let own = self.skins.iter().chain(&self.morphs).chain(&self.pose_rows).map(wgpu::Buffer::size);
        self.vertices.size() + self.posed_instances.size() + own.sum::<u64>()
    }

    /// Returns the bindings of shaders/lib/scene/pose.wesl.
    #[must_use]
    pub fn bindings(&self) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        let mut all = vec![
            ("rest", self.vertices.as_entire_binding()),
            ("posed_instances", self.posed_instances.as_entire_binding()),
        ];
        let own = [("joints", &self.skins), ("morph_offsets", &self.morphs), ("pose_rows", &self.pose_rows)];
        all.extend(own.into_iter().filter_map(|(name, buffer)| Some((name, buffer.as_ref()?.as_entire_binding()))));
        all
    }
}
