//! Upload: a scene's geometry, materials, textures and lights as the buffers of group 0 (shaders/lib/scene.wesl).

use std::collections::BTreeMap;

use glam::{Vec2, Vec3, Vec4};

use crate::acceleration::Acceleration;
use crate::gpu::{Gpu, GpuError};
use crate::layouts;
use crate::light_table::LightTable;
use crate::scene::stats::{triangles_vary, with_room};
use crate::scene::{
    Boundary, Bsdf, Color, EnvironmentMap, Filter, Fresnel, Geometry, Image, Material, Scalar, Scene, Sides,
    TextureRef, Wrap,
};
use crate::view::OUTLINE_BYTES;

const NONE: u32 = u32::MAX;

// Bits of Material.flags and values of Material.model, as in lib/scene.wesl.
const TWO_SIDED: u32 = 1;
const EMITS_TWO_SIDED: u32 = 2;
const CULLED: u32 = 4;
const MASKED: u32 = 8;
const NONLINEAR: u32 = 16;
const FRESNEL_NONE: u32 = 32;
const SHEET: u32 = 64;
const TRANSMITS: u32 = 128;
/// Where a texture slot holds its channel, as in lib/texture.wesl.
const CHANNEL_SHIFT: u32 = 24;

/// Vertices and triangles as shaders read them, with room for more of them where their numbers change from frame to frame: triangles
/// without area, which nothing meets. An empty scene has one of these.
struct Corners {
    positions: Vec<[f32; 4]>,
    /// As bytes, since their layout depends on whether there are textures.
    attributes: Vec<u8>,
    triangles: Vec<layouts::Triangle>,
}

impl Corners {
    fn new(geometry: &Geometry, room: Room, textured: bool) -> Self {
        let bytes = layouts::Attributes::bytes(textured);
        if geometry.triangles.is_empty() {
            return Self {
                positions: vec![[0.0; 4]; 3],
                attributes: vec![0; 3 * bytes],
                triangles: vec![layouts::Triangle { vertices: [0, 1, 2], material: 0 }],
            };
        }
        let mut attributes = Vec::with_capacity(room.vertices * bytes);
        for v in &geometry.vertices {
            let all = layouts::Attributes {
                normal: v.normal.to_array(),
                color: packed(v.color),
                tangent: v.tangent.to_array(),
                uv: [v.uvs[0].x, v.uvs[0].y, v.uvs[1].x, v.uvs[1].y],
            };
            attributes.extend_from_slice(&bytemuck::bytes_of(&all)[..bytes]);
        }
        attributes.resize(room.vertices * bytes, 0);
        let mut out = Self {
            positions: geometry.vertices.iter().map(|v| v.position.extend(0.0).to_array()).collect(),
            attributes,
            triangles: triangles(geometry, room.triangles),
        };
        out.positions.resize(room.vertices, [0.0; 4]);
        out
    }
}

/// Vertices and triangles that buffers have room for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Room {
    vertices: usize,
    triangles: usize,
    /// Whether there may be fewer of them.
    varies: bool,
}

impl Room {
    fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let varies = triangles_vary(scene);
        let room = |count: usize| if varies { with_room(count) } else { count };
        Self { vertices: room(geometry.vertices.len()), triangles: room(geometry.triangles.len()), varies }
    }

    /// Whether these have their place there, and do not leave most of it empty.
    fn holds(self, geometry: &Geometry) -> bool {
        let holds =
            |room: usize, count: usize| if self.varies { (room / 4..=room).contains(&count) } else { room == count };
        holds(self.vertices, geometry.vertices.len()) && holds(self.triangles, geometry.triangles.len())
    }
}

fn triangles_of(geometry: &Geometry) -> impl Iterator<Item = layouts::Triangle> {
    let triangles = geometry.triangles.iter().zip(&geometry.materials);
    triangles.map(|(&vertices, &material)| layouts::Triangle { vertices, material })
}

/// All triangles, and as many without area as there is room for.
fn triangles(geometry: &Geometry, room: usize) -> Vec<layouts::Triangle> {
    let mut out: Vec<_> = triangles_of(geometry).collect();
    out.resize(room, layouts::Triangle::default());
    out
}

/// A linear colour in 8 bits a channel, as shaders unpack it.
pub(crate) fn packed(color: Vec4) -> u32 {
    u32::from_le_bytes(color.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
}

/// The scene on the device.
pub struct GpuScene {
    /// Number of triangles, with those without area that keep their place for others.
    pub triangles: u32,
    room: Room,
    /// Bounding box, metres.
    pub bounds: [Vec3; 2],
    /// Bytes of buffers and textures.
    pub bytes: u64,
    /// Its materials as the scene has them.
    source: Vec<Material>,
    /// Of vertices, 16 bytes each: what raster passes read and acceleration structures are built from.
    pub positions: wgpu::Buffer,
    /// Where ray queries answer (see [`Self::accelerate`]).
    acceleration: Option<Acceleration>,
    /// Of vertices, beside their positions.
    pub attributes: wgpu::Buffer,
    triangle_buffer: wgpu::Buffer,
    materials: wgpu::Buffer,
    textures: Option<Textures>,
    /// Whether vertices have what textures need.
    textured: bool,
    environment_map: Option<wgpu::TextureView>,
    sphere: (Vec3, f32),
    lighting: wgpu::Buffer,
    /// By the shaders' name; what a scene has none of is not there.
    tables: Vec<(&'static str, wgpu::Buffer)>,
}

/// What materials look up, where any does.
struct Textures {
    uses: wgpu::Buffer,
    texels: wgpu::TextureView,
    texels_srgb: wgpu::TextureView,
    bilinear: wgpu::Sampler,
}

/// Tables that only some scenes have.
const TABLES: [&str; 5] = ["lights", "light_sums", "emitters", "patterns", "sky_table"];

impl GpuScene {
    /// Uploads what shaders with these flags ask for. An empty scene becomes one triangle without area, which nothing meets. What it has
    /// none of, and they ask for, is there in the least size: black maps, lights that never shine.
    ///
    /// # Errors
    /// [`GpuError::Device`] where the scene exceeds what the adapter can hold, with the numbers.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        geometry: &Geometry,
        lights: &LightTable,
        flags: &[&str],
    ) -> Result<Self, GpuError> {
        let textured = flags.contains(&"TEXTURES");
        let limit = gpu.capabilities.max_storage_bytes;
        let room = Room::new(scene, geometry);
        let largest =
            (room.vertices * layouts::Attributes::bytes(textured)).max(room.triangles * OUTLINE_BYTES as usize) as u64;
        if largest > limit {
            return Err(GpuError::Device(format!(
                "the scene has {} triangles and {} vertices, which need a binding of {largest} bytes; the adapter's limit is \
                 {limit}: simplify the scene or use --method reference",
                geometry.triangles.len(),
                geometry.vertices.len()
            )));
        }
        let largest = size_of_val(lights.records.as_slice()) as u64;
        if largest > limit {
            return Err(GpuError::Device(format!(
                "the scene has {} lights, which need a binding of {largest} bytes; the adapter's limit is {limit}: use fewer or \
                 --method reference",
                lights.count()
            )));
        }
        let Corners { positions, attributes, triangles } = Corners::new(geometry, room, textured);
        let mut atlas = Atlas::new(gpu, scene)?;
        let mut materials: Vec<_> = scene.materials.iter().map(|m| material(m, scene, &mut atlas)).collect();
        if materials.is_empty() {
            materials.push(layouts::Material::default());
        }
        let lighting = gpu.uniform::<layouts::Lighting>("lighting");
        gpu.queue.write_buffer(&lighting, 0, bytemuck::bytes_of(&lights.lighting));
        let map = scene.environment.as_ref().and_then(|e| e.map.as_ref());
        let environment_map = map.map(|map| upload_map(gpu, map)).transpose()?;
        let attributes = gpu.upload("attributes", &attributes);
        let triangle_buffer = gpu.upload("triangles", &triangles);
        let materials = gpu.upload("materials", &materials);
        let tables: Vec<_> = tables_of(lights).map(|(name, data)| (name, gpu.upload(name, data))).collect();
        let positions = upload_positions(gpu, &positions);
        let mut bytes =
            [&positions, &attributes, &triangle_buffer, &materials, &lighting].map(|b| b.size()).iter().sum();
        bytes += tables.iter().map(|(_, table)| table.size()).sum::<u64>();
        bytes += map.map_or(0, |m| 16 * u64::from(m.width) * u64::from(m.height));
        let textures = atlas.finish(gpu);
        bytes += textures.as_ref().map_or(0, |t| t.uses.size() + atlas.bytes);
        let mut this = Self {
            triangles: triangles.len() as u32,
            room,
            source: scene.materials.clone(),
            bounds: geometry.bounds,
            sphere: geometry.sphere(),
            bytes,
            positions,
            acceleration: None,
            attributes,
            triangle_buffer,
            materials,
            textures,
            environment_map,
            lighting,
            tables,
            textured,
        };
        this.stand_in(gpu, flags);
        Ok(this)
    }

    fn stand_in(&mut self, gpu: &Gpu, flags: &[&str]) {
        for name in TABLES {
            let asked = match name {
                "emitters" => flags.contains(&"EMISSION"),
                "patterns" => flags.contains(&"PATTERNS"),
                "sky_table" => flags.contains(&"ENVIRONMENT_MAP"),
                _ => ["PUNCTUAL", "EMISSION", "ENVIRONMENT"].iter().any(|flag| flags.contains(flag)),
            };
            if asked && !self.tables.iter().any(|(there, _)| *there == name) {
                self.tables.push((name, gpu.storage(name, 256)));
            }
        }
        if flags.contains(&"ENVIRONMENT_MAP") {
            self.environment_map.get_or_insert_with(|| {
                let texel = texture(gpu, "environment_map", wgpu::TextureFormat::Rgba32Float, [1, 1, 1]);
                texel.create_view(&Default::default())
            });
        }
        if flags.contains(&"TEXTURES") && self.textures.is_none() {
            let texels = texture(gpu, "texels", wgpu::TextureFormat::Rgba8Unorm, [1, 1, 1]);
            self.textures = Some(Textures::new(gpu, &texels, &[layouts::TextureUse::default()]));
        }
    }

    /// Flags of shaders that write vertices.
    #[must_use]
    pub fn vertex_flags(&self) -> &'static [&'static str] {
        if self.textured { &["TEXTURES"] } else { &[] }
    }

    /// The bindings of group 0 and of ray queries, followed by a pass's own.
    #[must_use]
    pub fn with<'a>(
        &'a self,
        own: &[(&'a str, wgpu::BindingResource<'a>)],
    ) -> Vec<(&'a str, wgpu::BindingResource<'a>)> {
        let mut all = vec![
            ("positions", self.positions.as_entire_binding()),
            ("attributes", self.attributes.as_entire_binding()),
            ("triangles", self.triangle_buffer.as_entire_binding()),
            ("materials", self.materials.as_entire_binding()),
            ("lighting", self.lighting.as_entire_binding()),
        ];
        if let Some(textures) = &self.textures {
            all.extend([
                ("texture_uses", textures.uses.as_entire_binding()),
                ("texels", wgpu::BindingResource::TextureView(&textures.texels)),
                ("texels_srgb", wgpu::BindingResource::TextureView(&textures.texels_srgb)),
                ("bilinear", wgpu::BindingResource::Sampler(&textures.bilinear)),
            ]);
        }
        all.extend(self.environment_map.iter().map(|m| ("environment_map", wgpu::BindingResource::TextureView(m))));
        all.extend(self.tables.iter().map(|(name, table)| (*name, table.as_entire_binding())));
        all.extend(self.acceleration.iter().flat_map(Acceleration::bindings));
        all.extend_from_slice(own);
        all
    }

    /// Whether another pose of the same scene has its place in these buffers: as many vertices, triangles and lights, or
    /// up to as many where they vary, and the same materials.
    #[must_use]
    pub fn fits(&self, scene: &Scene, geometry: &Geometry, lights: &LightTable) -> bool {
        let as_long =
            |buffer: &wgpu::Buffer, bytes: usize| buffer.size() == (bytes as u64).next_multiple_of(16).max(16);
        let wanted: Vec<_> = tables_of(lights).collect();
        scene.materials == self.source
            && self.room.holds(geometry)
            && self.tables.len() == wanted.len()
            && self.tables.iter().zip(wanted).all(|((name, table), (n, data))| *name == n && as_long(table, data.len()))
    }

    /// Uploads what another pose changes beside the vertices; it has to [fit](Self::fits). `refined`: whether refining makes other
    /// triangles. Acceleration structures stay what they were.
    pub fn pose(&mut self, gpu: &Gpu, geometry: &Geometry, refined: bool, lights: &LightTable) {
        let plain = geometry.triangles.len() - geometry.tessellated;
        let triangles = if refined {
            triangles(geometry, self.room.triangles)
        } else {
            triangles_of(geometry).take(plain).collect()
        };
        gpu.queue.write_buffer(&self.triangle_buffer, 0, bytemuck::cast_slice(&triangles));
        self.relight(gpu, lights);
        (self.bounds, self.sphere) = (geometry.bounds, geometry.sphere());
    }

    /// Uploads other places and probabilities of the same lights.
    pub fn relight(&self, gpu: &Gpu, lights: &LightTable) {
        gpu.queue.write_buffer(&self.lighting, 0, bytemuck::bytes_of(&lights.lighting));
        for (name, data) in tables_of(lights) {
            for (_, table) in self.tables.iter().filter(|(there, _)| *there == name) {
                gpu.queue.write_buffer(table, 0, data);
            }
        }
    }

    /// Builds what ray queries need.
    ///
    /// # Errors
    /// [`GpuError::Device`] where the device was opened without ray queries.
    pub fn accelerate(&mut self, gpu: &Gpu, scene: &Scene, geometry: &Geometry) -> Result<(), GpuError> {
        if !gpu.capabilities.ray_queries {
            return Err(GpuError::Device("it was opened without ray queries".to_owned()));
        }
        self.acceleration = Some(Acceleration::new(gpu, self, scene, geometry));
        Ok(())
    }

    /// Middle and radius of the sphere that holds the scene, metres.
    #[must_use]
    pub fn sphere(&self) -> (Vec3, f32) {
        self.sphere
    }
}

/// The tables of lights that shaders read, by their name there; those that hold anything.
fn tables_of(lights: &LightTable) -> impl Iterator<Item = (&'static str, &[u8])> {
    let bytes: [&[u8]; 5] = [
        // The table of no light holds one that never shines.
        bytemuck::cast_slice(if lights.count() == 0 { &[] } else { &lights.records }),
        bytemuck::cast_slice(&lights.sums),
        bytemuck::cast_slice(&lights.emitters),
        bytemuck::cast_slice(&lights.patterns),
        bytemuck::cast_slice(&lights.sky_shares),
    ];
    TABLES.into_iter().zip(bytes).filter(|(_, data)| !data.is_empty())
}

/// Acceleration structures are built from the same buffer, where the device has them.
fn upload_positions(gpu: &Gpu, positions: &[[f32; 4]]) -> wgpu::Buffer {
    if !gpu.capabilities.ray_queries {
        return gpu.upload("positions", positions);
    }
    gpu.upload_for_building("positions", positions, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC)
}

/// An environment's map as a texture.
fn upload_map(gpu: &Gpu, map: &EnvironmentMap) -> Result<wgpu::TextureView, GpuError> {
    let [width, height] = [map.width, map.height];
    if width.max(height) > gpu.capabilities.max_texture_side {
        return Err(GpuError::Device(format!(
            "the environment map is {width}x{height}; the adapter's limit is {}: scale it down",
            gpu.capabilities.max_texture_side
        )));
    }
    let rgba: Vec<[f32; 4]> = map.texels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let texels = texture(gpu, "environment_map", wgpu::TextureFormat::Rgba32Float, [width, height, 1]);
    write_texture(gpu, &texels, [0, 0, 0], [width, height], 16, bytemuck::cast_slice(&rgba));
    Ok(texels.create_view(&Default::default()))
}

impl Textures {
    fn new(gpu: &Gpu, array: &wgpu::Texture, uses: &[layouts::TextureUse]) -> Self {
        let view = |format| {
            array.create_view(&wgpu::TextureViewDescriptor {
                format: Some(format),
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            })
        };
        Self {
            uses: gpu.upload("texture_uses", uses),
            texels: view(wgpu::TextureFormat::Rgba8Unorm),
            texels_srgb: view(wgpu::TextureFormat::Rgba8UnormSrgb),
            bilinear: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("bilinear"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }
}

fn texture(gpu: &Gpu, label: &str, format: wgpu::TextureFormat, [width, height, layers]: [u32; 3]) -> wgpu::Texture {
    gpu.texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: if format == wgpu::TextureFormat::Rgba8Unorm {
            &[wgpu::TextureFormat::Rgba8UnormSrgb]
        } else {
            &[]
        },
    })
}

fn write_texture(
    gpu: &Gpu,
    texture: &wgpu::Texture,
    [x, y, z]: [u32; 3],
    [width, height]: [u32; 2],
    texel_bytes: u32,
    data: &[u8],
) {
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x, y, z },
            aspect: wgpu::TextureAspect::All,
        },
        data,
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * texel_bytes), rows_per_image: None },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
}

/// An image with the way in which it is continued.
type Tile = (usize, [Wrap; 2]);

/// All images that materials use, packed in shelves into the layers of one texture array, each with a border of one texel.
struct Atlas {
    /// None without an image.
    texture: Option<wgpu::Texture>,
    bytes: u64,
    /// Per tile: layer, x, y of the image without its border.
    places: BTreeMap<(usize, [u32; 2]), [u32; 3]>,
    uses: Vec<layouts::TextureUse>,
}

impl Atlas {
    fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let mut tiles: Vec<Tile> = Vec::new();
        for t in &scene.textures {
            if !tiles.contains(&(t.image, t.wrap)) {
                tiles.push((t.image, t.wrap));
            }
        }
        if tiles.is_empty() {
            return Ok(Self { texture: None, bytes: 0, places: BTreeMap::new(), uses: Vec::new() });
        }
        let size = |tile: &Tile| [scene.images[tile.0].width + 2, scene.images[tile.0].height + 2];
        tiles.sort_by_key(|t| std::cmp::Reverse(size(t)[1]));
        let longest = tiles.iter().flat_map(size).max().unwrap_or(1);
        if longest > gpu.capabilities.max_texture_side {
            return Err(GpuError::Device(format!(
                "a texture has a side of {} texels; the adapter's limit is {}: scale it down",
                longest - 2,
                gpu.capabilities.max_texture_side - 2
            )));
        }
        // Small sets get a small layer, large ones share layers of at least 2048 texels.
        let area: u64 = tiles.iter().map(size).map(|[w, h]| u64::from(w) * u64::from(h)).sum();
        let fitting = (area.isqrt() as u32).next_power_of_two().min(2048);
        let side = longest.max(fitting).min(gpu.capabilities.max_texture_side);
        let mut places = BTreeMap::new();
        let (mut layer, mut x, mut y, mut shelf) = (0, 0, 0, 0);
        for tile in &tiles {
            let [width, height] = size(tile);
            if x + width > side {
                (x, y, shelf) = (0, y + shelf, 0);
            }
            if y + height > side {
                (layer, x, y, shelf) = (layer + 1, 0, 0, 0);
            }
            places.insert((tile.0, tile.1.map(wrap_code)), [layer, x + 1, y + 1]);
            x += width;
            shelf = shelf.max(height);
        }
        if layer >= gpu.capabilities.max_texture_layers {
            return Err(GpuError::Device(format!(
                "the textures fill {} layers of {side}x{side} texels; the adapter's limit is {}: scale them down",
                layer + 1,
                gpu.capabilities.max_texture_layers
            )));
        }
        let array = texture(gpu, "texels", wgpu::TextureFormat::Rgba8Unorm, [side, side, layer + 1]);
        for tile in &tiles {
            let [layer, x, y] = places[&(tile.0, tile.1.map(wrap_code))];
            let bordered = with_border(&scene.images[tile.0], tile.1);
            write_texture(gpu, &array, [x - 1, y - 1, layer], size(tile), 4, bytemuck::cast_slice(&bordered));
        }
        Ok(Self {
            texture: Some(array),
            bytes: 4 * u64::from(side) * u64::from(side) * u64::from(layer + 1),
            places,
            uses: Vec::new(),
        })
    }

    /// What passes bind: nothing without an image. Uses may be none where no material looks at any.
    fn finish(&self, gpu: &Gpu) -> Option<Textures> {
        let none = [layouts::TextureUse::default()];
        let uses = if self.uses.is_empty() { &none[..] } else { &self.uses };
        self.texture.as_ref().map(|array| Textures::new(gpu, array, uses))
    }

    /// Records a use and gives the slot: its index, with the channel above it.
    fn add(&mut self, scene: &Scene, reference: &TextureRef, channel: u32) -> u32 {
        let texture = &scene.textures[reference.texture];
        let image = &scene.images[texture.image];
        let [layer, x, y] = self.places[&(texture.image, texture.wrap.map(wrap_code))];
        let m = reference.transform;
        let row = |f: fn(Vec2) -> f32| [f(m.matrix2.x_axis), f(m.matrix2.y_axis), f(m.translation)];
        let texture_use = layouts::TextureUse {
            row_u: row(|v| v.x),
            layer,
            row_v: row(|v| v.y),
            flags: wrap_code(texture.wrap[0])
                | wrap_code(texture.wrap[1]) << 2
                | u32::from(texture.filter == Filter::Linear) << 4
                | u32::from(texture.srgb) << 5
                | u32::from(reference.uv_set == 1) << 6,
            origin: [x as f32, y as f32],
            size: [image.width as f32, image.height as f32],
        };
        let index = self.uses.iter().position(|u| *u == texture_use).unwrap_or_else(|| {
            self.uses.push(texture_use);
            self.uses.len() - 1
        });
        index as u32 | channel << CHANNEL_SHIFT
    }

    fn color(&mut self, scene: &Scene, color: &Color) -> ([f32; 3], u32) {
        (color.factor.to_array(), color.texture.as_ref().map_or(NONE, |t| self.add(scene, t, 0)))
    }

    fn scalar(&mut self, scene: &Scene, scalar: &Scalar) -> (f32, u32) {
        (scalar.factor, scalar.texture.as_ref().map_or(NONE, |(t, channel)| self.add(scene, t, *channel)))
    }
}

/// As in lib/texture.wesl.
fn wrap_code(wrap: Wrap) -> u32 {
    match wrap {
        Wrap::Repeat => 0,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    }
}

/// An image with one more texel on each side, as its wrap modes continue it.
fn with_border(image: &Image, wrap: [Wrap; 2]) -> Vec<[u8; 4]> {
    // Row or column -1 or n: the texel that continues the image there.
    let continued = |i: u32, n: u32, wrap: Wrap| match (i, wrap) {
        (0, Wrap::Repeat) => n - 1,
        (0, _) => 0,
        (i, Wrap::Repeat) if i > n => 0,
        (i, _) => i.min(n) - 1,
    };
    (0..image.height + 2)
        .flat_map(|y| {
            let row = continued(y, image.height, wrap[1]) * image.width;
            (0..image.width + 2).map(move |x| row + continued(x, image.width, wrap[0]))
        })
        .map(|i| image.texels[i as usize])
        .collect()
}

fn material(m: &crate::scene::Material, scene: &Scene, atlas: &mut Atlas) -> layouts::Material {
    let mut out = layouts::Material {
        specular: [1.0; 3],
        eta: [1.5; 3],
        specular_factor: 1.0,
        base_texture: NONE,
        roughness_texture: NONE,
        metallic_texture: NONE,
        specular_texture: NONE,
        specular_factor_texture: NONE,
        emission_texture: NONE,
        normal_texture: NONE,
        mask_texture: NONE,
        transmission_texture: NONE,
        ..Default::default()
    };
    match &m.bsdf {
        Bsdf::Diffuse { reflectance } => (out.base, out.base_texture) = atlas.color(scene, reflectance),
        Bsdf::MetallicRoughness { base_color, metallic, roughness, ior, specular, specular_color, transmission } => {
            out.model = 1;
            (out.base, out.base_texture) = atlas.color(scene, base_color);
            (out.metallic, out.metallic_texture) = atlas.scalar(scene, metallic);
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, roughness);
            (out.specular_factor, out.specular_factor_texture) = atlas.scalar(scene, specular);
            (out.specular, out.specular_texture) = atlas.color(scene, specular_color);
            out.eta = [*ior; 3];
            (out.transmission, out.transmission_texture) = atlas.scalar(scene, transmission);
        }
        Bsdf::Conductor { alpha, fresnel, specular } => {
            out.model = 2;
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, alpha);
            (out.specular, out.specular_texture) = atlas.color(scene, specular);
            match fresnel {
                Fresnel::None => out.flags |= FRESNEL_NONE,
                Fresnel::Conductor { eta, k } => (out.eta, out.k) = (eta.to_array(), k.to_array()),
            }
        }
        Bsdf::Plastic { alpha, diffuse, specular, eta, nonlinear } => {
            out.model = 3;
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, alpha);
            (out.base, out.base_texture) = atlas.color(scene, diffuse);
            (out.specular, out.specular_texture) = atlas.color(scene, specular);
            out.eta = [*eta; 3];
            if *nonlinear {
                out.flags |= NONLINEAR;
            }
        }
        Bsdf::Dielectric { alpha, eta, reflection, transmission } => {
            out.model = 4;
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, alpha);
            (out.base, out.base_texture) = atlas.color(scene, reflection);
            (out.specular, out.specular_texture) = atlas.color(scene, transmission);
            out.eta = [*eta; 3];
        }
    }
    if let Some(emission) = &m.emission {
        (out.emission, out.emission_texture) = atlas.color(scene, &emission.radiance);
        if emission.two_sided {
            out.flags |= EMITS_TWO_SIDED;
        }
    }
    if let Some(normal_map) = &m.normal_map {
        out.normal_texture = atlas.add(scene, &normal_map.texture, 0);
        out.normal_scale = normal_map.scale;
    }
    if let Some(mask) = &m.alpha_mask {
        out.flags |= MASKED;
        (out.mask_value, out.mask_texture) = atlas.scalar(scene, &mask.value);
        out.mask_cutoff = mask.cutoff;
    }
    if m.bsdf.transmits() {
        out.flags |= TRANSMITS;
        match m.boundary {
            Boundary::Sheet => out.flags |= SHEET,
            Boundary::Volume { absorption } => out.absorption = absorption.to_array(),
        }
    }
    out.flags |= match m.sides {
        // What lets light pass does the same on both sides.
        _ if m.bsdf.transmits() => TWO_SIDED,
        Sides::Two => TWO_SIDED,
        Sides::One => 0,
        Sides::OneCulled => CULLED,
    };
    out
}
