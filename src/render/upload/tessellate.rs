//! tessellate: evaluates tessellated meshes once per frame, by three shaders. `controls` evaluates control
//! vertices in the pose, `tessellate` evaluates the new vertices, and `displaced_normals` averages triangle
//! normals at the vertices of displaced surfaces.
//!
//! Reads: the rest pose and its deformation ([`RestMesh`]), the new vertices as blends of control vertices
//! ([`Refined`]), and height maps. Writes: positions, attributes and normals of the new vertices, which are
//! the scene's last. Skipped when: no mesh is tessellated; `displaced_normals` also when no surface is
//! displaced.

use crate::gpu::{Compute, Flag, Gpu, GpuError, rows};
use crate::render::layouts::height_kind::{HEIGHT_OF_MAP, HEIGHT_OF_NOISE, HEIGHT_OF_WAVES};
use crate::render::layouts::{self, Blend, Control, ControlOrigin, NewVertices, Refinement};
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::upload::rest_mesh::RestMesh;
use crate::render::upload::vertices::packed;
use crate::scene::tessellation::refine::{self, Refined, Topology};
use crate::scene::{Geometry, Height, Scene, Wrap};

/// The passes and their inputs.
pub struct Tessellate {
    pose: Compute,
    place: Compute,
    normals: Option<Compute>,
    control_origins: wgpu::Buffer,
    members: wgpu::Buffer,
    controls: wgpu::Buffer,
    refinements: wgpu::Buffer,
    waves: Option<wgpu::Buffer>,
    heights: Option<wgpu::Buffer>,
    new_vertices: wgpu::Buffer,
    blends: wgpu::Buffer,
    /// The range of each new vertex's adjacent triangles, and the lists of triangles.
    rings: Option<(wgpu::Buffer, wgpu::Buffer)>,
    /// The topology of the blends that are on the device.
    topology: Option<Topology>,
}

/// Constants of each surface at the scene's time, and the waves of all surfaces.
struct Constants {
    refinements: Vec<Refinement>,
    waves: Vec<layouts::Wave>,
}

/// Returns the instances with control vertices, in order.
fn surfaces(refined: &Refined) -> Vec<u32> {
    let mut instances: Vec<u32> = refined.controls.iter().map(|c| c.instance).collect();
    instances.dedup();
    instances
}

/// Returns the index of each map's first texel among the texels of all height maps.
fn first_heights(scene: &Scene) -> Vec<u32> {
    let lengths = scene.height_maps.iter().map(|map| map.texels.len() as u32);
    lengths.scan(0, |end, length| Some(std::mem::replace(end, *end + length))).collect()
}

impl Constants {
    fn new(scene: &Scene, refined: &Refined) -> Self {
        let mut out = Self { refinements: Vec::new(), waves: Vec::new() };
        let firsts = first_heights(scene);
        for instance in surfaces(refined) {
            let mesh = &scene.meshes[scene.instances[instance as usize].mesh];
            let tessellation = mesh.tessellation.clone().unwrap_or_default();
            let shape = tessellation.phong;
            let Some(displacement) = tessellation.displacement.map(|d| d.at(scene.seconds)) else {
                out.refinements.push(Refinement { shape, ..Default::default() });
                continue;
            };
            let common = Refinement { shape, scale: displacement.scale, bias: displacement.bias, ..Default::default() };
            out.refinements.push(match displacement.height {
                Height::Map { map, uv_set, drift } => {
                    let heights = &scene.height_maps[map];
                    Refinement {
                        kind: HEIGHT_OF_MAP,
                        drift: [drift.x, drift.y, 0.0],
                        first: firsts[map],
                        uv_set,
                        size: [heights.width as i32, heights.height as i32],
                        wrap: heights.wrap.map(|wrap| match wrap {
                            Wrap::Repeat => 0,
                            Wrap::Mirror => 1,
                            Wrap::Clamp => 2,
                        }),
                        ..common
                    }
                }
                Height::Noise { frequency, octaves, seed, drift } => Refinement {
                    kind: HEIGHT_OF_NOISE,
                    drift: drift.to_array(),
                    frequency,
                    count: octaves,
                    seed,
                    ..common
                },
                Height::Waves(waves) => {
                    let (first, count) = (out.waves.len() as u32, waves.len() as u32);
                    out.waves.extend(waves.iter().map(|w| layouts::Wave {
                        cycles: w.cycles.to_array(),
                        amplitude: w.amplitude,
                        phase: w.phase,
                        ..Default::default()
                    }));
                    Refinement { kind: HEIGHT_OF_WAVES, first, count, ..common }
                }
            });
        }
        out
    }

    fn has(&self, kind: u32) -> bool {
        self.refinements.iter().any(|r| r.kind == kind)
    }

    fn flags(&self) -> Vec<Flag> {
        let flags = [(Flag::HeightMaps, 1), (Flag::Noise, 2), (Flag::Waves, 3)];
        flags.into_iter().filter(|(_, kind)| self.has(*kind)).map(|(flag, _)| flag).collect()
    }
}

/// Returns the control vertices for shaders, and the lists of control vertices that share a position.
fn control_origins(scene: &Scene, refined: &Refined, rest: &RestMesh) -> (Vec<ControlOrigin>, Vec<u32>) {
    let (mut origins, mut members) = (Vec::with_capacity(refined.controls.len()), Vec::new());
    for (surface, controls) in (0..).zip(refined.controls.chunk_by(|a, b| a.instance == b.instance)) {
        let instance = controls[0].instance;
        let mesh = &scene.meshes[scene.instances[instance as usize].mesh];
        let mut at_place = vec![Vec::new(); controls.len()];
        controls.iter().for_each(|c| at_place[c.place as usize].push(rest.index(instance, c.vertex)));
        let ranges: Vec<_> = at_place
            .iter()
            .map(|of| {
                members.extend(of);
                (members.len() - of.len()) as u32..members.len() as u32
            })
            .collect();
        for control in controls {
            let v = control.vertex as usize;
            let [uv0, uv1] = [0, 1].map(|set: usize| mesh.uvs[set].get(v).copied().unwrap_or_default());
            let range = &ranges[control.place as usize];
            origins.push(ControlOrigin {
                uv: [uv0.x, uv0.y, uv1.x, uv1.y],
                source: rest.index(instance, control.vertex),
                place: rest.index(instance, control.place),
                members_begin: range.start,
                members_end: range.end,
                color: packed(mesh.colors.get(v).copied().unwrap_or(glam::Vec4::ONE)),
                surface,
                ..Default::default()
            });
        }
    }
    (origins, members)
}

/// Returns the triangles adjacent to the position of each new vertex, in order: ranges and lists. Ranges are
/// empty for vertices of surfaces that are not displaced.
fn rings(refined: &Refined, geometry: &Geometry, displaced: impl Fn(usize) -> bool) -> (Vec<[u32; 2]>, Vec<u32>) {
    let count = refined.blends.len();
    let Topology { first_vertex, first_triangle, .. } = refined.topology;
    let triangles = || (first_triangle..).zip(&geometry.triangles[first_triangle as usize..]);
    let weld = |v: u32| refined.welds[(v - first_vertex) as usize] as usize;
    let mut ends = vec![0_u32; count + 1];
    triangles().for_each(|(_, t)| t.iter().for_each(|&v| ends[weld(v) + 1] += 1));
    for i in 0..count {
        ends[i + 1] += ends[i];
    }
    let mut next = ends.clone();
    let mut list = vec![0; ends[count] as usize];
    for (index, triangle) in triangles() {
        for &v in triangle {
            let at = &mut next[weld(v)];
            list[*at as usize] = index;
            *at += 1;
        }
    }
    let ring = |(blend, &weld): (&refine::Blend, &u32)| {
        let weld = weld as usize;
        if displaced(blend.corners[0] as usize) { [ends[weld], ends[weld + 1]] } else { [0; 2] }
    };
    (refined.blends.iter().zip(&refined.welds).map(ring).collect(), list)
}

/// Uploads data to a buffer, which is replaced by a larger one if the data exceeds its capacity.
fn upload<T: bytemuck::NoUninit>(gpu: &Gpu, buffer: &mut wgpu::Buffer, label: &str, data: &[T]) {
    let bytes: &[u8] = bytemuck::cast_slice(data);
    if buffer.size() < bytes.len() as u64 {
        *buffer = gpu.storage(label, bytes.len() as u64 * 5 / 4);
    }
    gpu.queue.write_buffer(buffer, 0, bytes);
}

impl Tessellate {
    /// Builds the pipelines and uploads the data that no pose changes.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the height maps exceed the adapter's limit for bindings.
    pub fn new(
        gpu: &Gpu,
        gpu_scene: &GpuScene,
        scene: &Scene,
        rest: &RestMesh,
        refined: &Refined,
    ) -> Result<Self, GpuError> {
        let vertex_flags = gpu_scene.vertex_flags();
        let constants = Constants::new(scene, refined);
        let (origins, members) = control_origins(scene, refined, rest);
        let limit = gpu.capabilities.max_storage_bytes;
        let heights: u64 = scene.height_maps.iter().map(|map| 4 * map.texels.len() as u64).sum();
        if heights > limit {
            return Err(GpuError::Device(format!(
                "the height maps need a binding of {heights} bytes; the adapter's limit is {limit}; scale them down"
            )));
        }
        let displaced = constants.refinements.iter().any(|r| r.kind != 0);
        let maps: Vec<f32> = scene.height_maps.iter().flat_map(|map| &map.texels).copied().collect();
        Ok(Self {
            pose: Compute::new(gpu, "upload/controls", &rest.flags()),
            place: Compute::new(gpu, "upload/tessellate", &[constants.flags().as_slice(), vertex_flags].concat()),
            normals: displaced.then(|| Compute::new(gpu, "upload/displaced_normals", vertex_flags)),
            controls: gpu.storage("controls", (origins.len() * size_of::<Control>()) as u64),
            control_origins: gpu.upload("control_origins", &origins),
            members: gpu.upload("members", &members),
            refinements: gpu.upload("refinements", &constants.refinements),
            waves: constants.has(HEIGHT_OF_WAVES).then(|| gpu.upload("waves", &constants.waves)),
            heights: constants.has(HEIGHT_OF_MAP).then(|| gpu.upload("heights", &maps)),
            new_vertices: gpu.uniform::<NewVertices>("new_vertices"),
            blends: gpu.storage("blends", 0),
            rings: displaced.then(|| (gpu.storage("rings", 0), gpu.storage("ring_triangles", 0))),
            topology: None,
        })
    }

    /// Returns the bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let always =
            [&self.control_origins, &self.members, &self.controls, &self.refinements, &self.new_vertices, &self.blends];
        let rings = self.rings.iter().flat_map(|(starts, list)| [starts, list]);
        always.into_iter().chain(&self.waves).chain(&self.heights).chain(rings).map(wgpu::Buffer::size).sum()
    }

    /// Records the passes for the pose of `rest`. `refined` is the tessellation of the pose's geometry; its
    /// control vertices are those of the first pose.
    pub fn record(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        rest: &RestMesh,
        scene: &Scene,
        geometry: &Geometry,
        refined: &Refined,
    ) {
        let constants = Constants::new(scene, refined);
        gpu.queue.write_buffer(&self.refinements, 0, bytemuck::cast_slice(&constants.refinements));
        if let Some(waves) = &mut self.waves {
            upload(gpu, waves, "waves", &constants.waves);
        }
        self.upload_topology(gpu, geometry, refined, &constants);
        let mut own = rest.bindings();
        own.extend(self.bindings());
        let bindings = gpu_scene.with(&own);
        self.pose.record(gpu, encoder, rows(refined.controls.len() as u32), &bindings);
        self.place.record(gpu, encoder, rows(refined.blends.len() as u32), &bindings);
        if let Some(normals) = &self.normals {
            normals.record(gpu, encoder, rows(refined.blends.len() as u32), &bindings);
        }
    }

    /// Records the evaluation of the next pose's new vertices in the current pose, for reprojection. Does
    /// nothing if the topology is the same.
    pub fn record_in_last_pose(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        gpu_scene: &GpuScene,
        scene: &Scene,
        geometry: &Geometry,
        refined: &Refined,
    ) {
        if self.upload_topology(gpu, geometry, refined, &Constants::new(scene, refined)) {
            let bindings = gpu_scene.with(&self.bindings());
            self.place.record(gpu, encoder, rows(refined.blends.len() as u32), &bindings);
        }
    }

    fn bindings(&self) -> Vec<(&str, wgpu::BindingResource<'_>)> {
        let mut all = vec![
            ("control_origins", self.control_origins.as_entire_binding()),
            ("members", self.members.as_entire_binding()),
            ("controls", self.controls.as_entire_binding()),
            ("refinements", self.refinements.as_entire_binding()),
            ("new_vertices", self.new_vertices.as_entire_binding()),
            ("blends", self.blends.as_entire_binding()),
        ];
        all.extend(self.waves.as_ref().map(|waves| ("waves", waves.as_entire_binding())));
        all.extend(self.heights.as_ref().map(|heights| ("heights", heights.as_entire_binding())));
        if let Some((rings, triangles)) = &self.rings {
            all.extend([("rings", rings.as_entire_binding()), ("ring_triangles", triangles.as_entire_binding())]);
        }
        all
    }

    /// Uploads the new vertices and their adjacent triangles if the topology differs from the one on the
    /// device. Returns true if it does.
    fn upload_topology(&mut self, gpu: &Gpu, geometry: &Geometry, refined: &Refined, constants: &Constants) -> bool {
        if self.topology.as_ref() == Some(&refined.topology) {
            return false;
        }
        let (first, count) = (refined.topology.first_vertex, refined.blends.len() as u32);
        let first_and_count = NewVertices { first, count, ..Default::default() };
        gpu.queue.write_buffer(&self.new_vertices, 0, bytemuck::bytes_of(&first_and_count));
        let blend = |b: &refine::Blend| Blend { corners: b.corners, y: b.y, heights: b.heights, z: b.z };
        upload(gpu, &mut self.blends, "blends", &refined.blends.iter().map(blend).collect::<Vec<_>>());
        if let Some((starts, list)) = &mut self.rings {
            let surfaces = surfaces(refined);
            let is_displaced: Vec<_> =
                surfaces.iter().zip(&constants.refinements).map(|(&i, r)| (i, r.kind != 0)).collect();
            let displaced = |control: usize| {
                let instance = refined.controls[control].instance;
                is_displaced.binary_search_by_key(&instance, |&(i, _)| i).is_ok_and(|at| is_displaced[at].1)
            };
            let (rings, triangles) = rings(refined, geometry, displaced);
            upload(gpu, starts, "rings", &rings);
            upload(gpu, list, "ring_triangles", &triangles);
        }
        self.topology = Some(refined.topology.clone());
        true
    }
}
