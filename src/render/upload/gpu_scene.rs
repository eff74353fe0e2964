//! Uploads a scene's geometry, materials, textures and lights to the buffers of group 0
//! (shaders/lib/scene/scene.wesl).

use glam::Vec3;

use crate::gpu::{Flag, Gpu, GpuError};
use crate::render::layouts;
use crate::render::layouts::material_flags::CLEAR_SHEET;
use crate::render::lights::table::LightTable;
use crate::render::upload::materials::records;
use crate::render::upload::rough_coat::RoughCoats;
use crate::render::upload::sheen;
use crate::render::upload::tables::{Table, TableData, Tables};
use crate::render::upload::textures::{Atlas, as_array, texture, upload_map};
use crate::render::upload::vertices::{Capacity, VertexData, triangles, triangles_of};
use crate::render::visibility::tracer::{TracedScene, Tracer, Tracing};
use crate::render::visibility::view::PROJECTED_TRIANGLE_BYTES;
use crate::scene::{Geometry, Material, Scene};

/// The scene on the device.
pub struct GpuScene {
    /// Number of triangles, including the degenerate ones that fill the capacity.
    pub triangles: u32,
    capacity: Capacity,
    /// Bounding box, metres.
    pub bounds: [Vec3; 2],
    /// Bytes of buffers and textures.
    pub bytes: u64,
    /// The scene's materials, to compare with those of another pose.
    source: Vec<Material>,
    /// Positions of vertices, 16 bytes each, for raster passes and for building acceleration structures.
    pub positions: wgpu::Buffer,
    /// The data structure of rays, if built by [`Self::trace_with`].
    tracer: Option<Tracer>,
    /// Attributes of vertices other than positions.
    pub attributes: wgpu::Buffer,
    /// Triangles, materials and lights.
    tables: Tables,
    texels: Option<wgpu::TextureView>,
    /// True if vertices have tangents and texture coordinates.
    textured: bool,
    environment_map: Option<wgpu::TextureView>,
    sphere: (Vec3, f32),
    lighting: wgpu::Buffer,
}

impl GpuScene {
    /// Uploads the data that shaders with these flags declare. An empty scene becomes one degenerate
    /// triangle, which rays cannot hit. Declared resources that the scene lacks are placeholders of least
    /// size: black maps, and lights without power.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the scene exceeds a limit of the adapter.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        geometry: &Geometry,
        lights: &LightTable,
        flags: &[Flag],
    ) -> Result<Self, GpuError> {
        let textured = flags.contains(&Flag::Textures);
        let limit = gpu.capabilities.max_storage_bytes;
        let capacity = Capacity::new(scene, geometry);
        let largest = (capacity.vertices * layouts::Attributes::bytes(textured))
            .max(capacity.triangles * PROJECTED_TRIANGLE_BYTES as usize) as u64;
        if largest > limit {
            return Err(GpuError::Device(format!(
                "the scene has {} triangles and {} vertices, which need a binding of {largest} bytes; the adapter's limit is \
                 {limit}; simplify the scene or use --method reference",
                geometry.triangles.len(),
                geometry.vertices.len()
            )));
        }
        let VertexData { positions, attributes, triangles } = VertexData::new(geometry, capacity, textured);
        let mut atlas = Atlas::new(gpu, scene)?;
        let parts = Material::with_parts(&scene.materials);
        let (mut materials, layers): (Vec<_>, Vec<_>) =
            parts.iter().map(|&(material, parts)| records(material, parts, scene, &mut atlas)).unzip();
        // What a ray passes is decided by the whole, before its parts are.
        materials.iter_mut().skip(scene.materials.len()).for_each(|part| part.flags &= !CLEAR_SHEET);
        let mut coats = RoughCoats::default();
        if flags.contains(&Flag::RoughPlastic) {
            parts.iter().zip(&mut materials).for_each(|((material, _), record)| coats.add(material, record));
        }
        if materials.is_empty() {
            materials.push(layouts::Material::default());
        }
        let has_layers = Flag::LAYERS.iter().any(|flag| flags.contains(flag));
        let mut data = TableData::default();
        data.add(Table::Triangles, &triangles);
        data.add(Table::Materials, &materials);
        data.add(Table::Layers, if has_layers { &layers } else { &[] });
        data.add(Table::TextureUses, atlas.uses());
        if flags.contains(&Flag::Sheen) {
            data.add(Table::SheenAlbedos, &sheen::albedos());
        }
        data.add(Table::RoughCoats, &coats.numbers());
        for (table, records) in tables_of(lights) {
            data.add(table, records);
        }
        if data.size() > limit {
            return Err(GpuError::Device(format!(
                "the scene's {} triangles and {} lights need a binding of {} bytes; the adapter's limit is {limit}; simplify \
                 the scene, use fewer lights or --method reference",
                geometry.triangles.len(),
                lights.count(),
                data.size()
            )));
        }
        let tables = Tables::new(gpu, data, triangles.len() as u32);
        let lighting = gpu.uniform::<layouts::Lighting>("lighting");
        gpu.queue.write_buffer(&lighting, 0, bytemuck::bytes_of(&lights.lighting));
        let map = scene.environment.as_ref().and_then(|e| e.map.as_ref());
        let environment_map = map.map(|map| upload_map(gpu, map)).transpose()?;
        let attributes = gpu.upload("attributes", &attributes);
        let positions = upload_positions(gpu, &positions);
        let mut bytes =
            tables.bytes() + [&positions, &attributes, &lighting].map(wgpu::Buffer::size).iter().sum::<u64>();
        bytes += map.map_or(0, |m| 16 * u64::from(m.width) * u64::from(m.height));
        let texels = atlas.view();
        bytes += texels.as_ref().map_or(0, |_| atlas.bytes);
        let mut this = Self {
            triangles: triangles.len() as u32,
            capacity,
            source: scene.materials.clone(),
            bounds: geometry.bounds,
            sphere: geometry.sphere(),
            bytes,
            positions,
            tracer: None,
            attributes,
            tables,
            texels,
            environment_map,
            lighting,
            textured,
        };
        this.add_placeholders(gpu, flags);
        Ok(this)
    }

    /// Adds placeholders for resources that shaders with these flags declare and the scene lacks.
    fn add_placeholders(&mut self, gpu: &Gpu, flags: &[Flag]) {
        if flags.contains(&Flag::EnvironmentMap) {
            self.environment_map.get_or_insert_with(|| {
                let texel = texture(gpu, "environment_map", wgpu::TextureFormat::Rgba32Float, [1, 1, 1]);
                texel.create_view(&Default::default())
            });
        }
        if flags.contains(&Flag::Textures) && self.texels.is_none() {
            self.texels = Some(as_array(&texture(gpu, "texels", wgpu::TextureFormat::Rgba8Unorm, [1, 1, 1])));
        }
    }

    /// Returns the flags of shaders that write vertices.
    #[must_use]
    pub fn vertex_flags(&self) -> &'static [Flag] {
        if self.textured { &[Flag::Textures] } else { &[] }
    }

    /// Returns the bindings of group 0 and of rays, followed by those of a pass.
    #[must_use]
    pub fn with<'a>(
        &'a self,
        own: &[(&'a str, wgpu::BindingResource<'a>)],
    ) -> Vec<(&'a str, wgpu::BindingResource<'a>)> {
        let mut all = vec![
            ("positions", self.positions.as_entire_binding()),
            ("attributes", self.attributes.as_entire_binding()),
            ("tables", self.tables.binding()),
            ("table_rows", self.tables.first_rows.as_entire_binding()),
            ("lighting", self.lighting.as_entire_binding()),
        ];
        all.extend(self.texels.iter().map(|t| ("texels", wgpu::BindingResource::TextureView(t))));
        all.extend(self.environment_map.iter().map(|m| ("environment_map", wgpu::BindingResource::TextureView(m))));
        all.extend(self.tracer.iter().flat_map(Tracer::bindings));
        all.extend_from_slice(own);
        all
    }

    /// True if the buffers can hold another pose of the scene: the materials and the numbers of lights are
    /// the same, and vertices and triangles fit the capacity.
    #[must_use]
    pub fn fits(&self, scene: &Scene, geometry: &Geometry, lights: &LightTable) -> bool {
        scene.materials == self.source
            && self.capacity.holds(geometry)
            && tables_of(lights).into_iter().all(|(table, records)| self.tables.bytes_of(table) == records.len())
    }

    /// Uploads the triangles, lights and bounds of another pose that [fits](Self::fits). `refined` is true if
    /// the tessellated triangles differ. Vertices and the data structure of rays are not updated.
    pub fn pose(&mut self, gpu: &Gpu, geometry: &Geometry, refined: bool, lights: &LightTable) {
        let plain = geometry.triangles.len() - geometry.tessellated;
        let triangles = if refined {
            triangles(geometry, self.capacity.triangles)
        } else {
            triangles_of(geometry).take(plain).collect()
        };
        self.tables.write(gpu, Table::Triangles, &triangles);
        self.relight(gpu, lights);
        (self.bounds, self.sphere) = (geometry.bounds, geometry.sphere());
    }

    /// Uploads new positions and probabilities of the same lights.
    pub fn relight(&self, gpu: &Gpu, lights: &LightTable) {
        gpu.queue.write_buffer(&self.lighting, 0, bytemuck::bytes_of(&lights.lighting));
        for (table, records) in tables_of(lights) {
            self.tables.write(gpu, table, records);
        }
    }

    /// Builds the data structure that rays are traced through, for the scene in its pose.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails, lacks ray queries, or cannot bind the structure.
    pub async fn trace_with(
        &mut self,
        gpu: &Gpu,
        tracing: Tracing,
        scene: &Scene,
        geometry: &Geometry,
    ) -> Result<(), GpuError> {
        let previous = self.tracer.take();
        self.tracer = Some(Tracer::new(gpu, tracing, previous, &self.traced(), scene, geometry).await?);
        Ok(())
    }

    /// Returns what data structures of rays are built from.
    #[must_use]
    pub fn traced(&self) -> TracedScene<'_> {
        TracedScene {
            bindings: self.with(&[]),
            positions: &self.positions,
            triangles: self.triangles,
            bounds: self.bounds,
        }
    }

    /// Returns the bytes of the data structure of rays.
    #[must_use]
    pub fn tracer_bytes(&self) -> u64 {
        self.tracer.as_ref().map_or(0, Tracer::bytes)
    }

    /// Returns center and radius of the scene's bounding sphere, in metres.
    #[must_use]
    pub fn sphere(&self) -> (Vec3, f32) {
        self.sphere
    }
}

/// Returns the tables of lights, of which some may be empty.
fn tables_of(lights: &LightTable) -> [(Table, &[u8]); 8] {
    [
        // Without lights the table holds one record that is never chosen.
        (Table::Lights, bytemuck::cast_slice(if lights.count() == 0 { &[] } else { &lights.records })),
        (Table::LightSums, bytemuck::cast_slice(&lights.sums)),
        (Table::Emitters, bytemuck::cast_slice(&lights.emitters)),
        (Table::Patterns, bytemuck::cast_slice(&lights.patterns)),
        (Table::SkyShares, bytemuck::cast_slice(&lights.sky_shares)),
        (Table::LightNodes, bytemuck::cast_slice(&lights.nodes)),
        (Table::Aims, bytemuck::cast_slice(&lights.aims.triangles)),
        (Table::AimDensities, bytemuck::cast_slice(&lights.aims.densities)),
    ]
}

/// Uploads positions, to a buffer that acceleration structures can be built from if the device has ray
/// queries.
fn upload_positions(gpu: &Gpu, positions: &[[f32; 4]]) -> wgpu::Buffer {
    if !gpu.capabilities.ray_queries {
        return gpu.upload("positions", positions);
    }
    gpu.upload_for_building("positions", positions, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)
}
