//! Textures on the device: all images packed into the layers of one array, and the environment map.

use std::collections::BTreeMap;

use glam::Vec2;

use crate::gpu::{Gpu, GpuError};
use crate::render::layouts;
use crate::render::layouts::index::NONE;
use crate::render::layouts::texture_flags::{LINEAR, SECOND_UV, SRGB};
use crate::scene::{Color, EnvironmentMap, Filter, Image, NormalMap, Scalar, Scene, TextureRef, Wrap};

/// Uploads an environment map as a texture.
pub(super) fn upload_map(gpu: &Gpu, map: &EnvironmentMap) -> Result<wgpu::TextureView, GpuError> {
    let [width, height] = [map.width, map.height];
    if width.max(height) > gpu.capabilities.max_texture_side {
        return Err(GpuError::Device(format!(
            "the environment map is {width}x{height}; the adapter's limit is {}; scale it down",
            gpu.capabilities.max_texture_side
        )));
    }
    let rgba: Vec<[f32; 4]> = map.texels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    let texels = texture(gpu, "environment_map", wgpu::TextureFormat::Rgba32Float, [width, height, 1]);
    write_texture(gpu, &texels, [0, 0, 0], [width, height], 16, bytemuck::cast_slice(&rgba));
    Ok(texels.create_view(&Default::default()))
}

/// Returns a view of a texture as an array, also if it has one layer.
pub(super) fn as_array(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}

/// Uploads a table of numbers as a texture.
#[must_use]
pub fn upload_numbers(gpu: &Gpu, label: &str, [width, height]: [u32; 2], numbers: &[f32]) -> wgpu::TextureView {
    let table = texture(gpu, label, wgpu::TextureFormat::R32Float, [width, height, 1]);
    write_texture(gpu, &table, [0, 0, 0], [width, height], 4, bytemuck::cast_slice(numbers));
    table.create_view(&Default::default())
}

/// Creates a texture array.
pub fn texture(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    [width, height, layers]: [u32; 3],
) -> wgpu::Texture {
    gpu.texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Uploads texels to a rectangle of one layer.
pub fn write_texture(
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

/// An image with its wrap modes.
type Tile = (usize, [Wrap; 2]);

/// All images that materials use, packed in shelves into the layers of one texture array, each with a border
/// of one texel.
pub(super) struct Atlas {
    /// The array; None without images.
    texture: Option<wgpu::Texture>,
    pub(super) bytes: u64,
    /// Layer, x and y of each tile's image, without its border.
    places: BTreeMap<(usize, [u32; 2]), [u32; 3]>,
    /// Uses of all materials, those of one in a row.
    uses: Vec<layouts::TextureUse>,
    /// The first use of the current material.
    first: usize,
}

impl Atlas {
    pub(super) fn new(gpu: &Gpu, scene: &Scene) -> Result<Self, GpuError> {
        let mut tiles: Vec<Tile> = Vec::new();
        for t in &scene.textures {
            if !tiles.contains(&(t.image, t.wrap)) {
                tiles.push((t.image, t.wrap));
            }
        }
        if tiles.is_empty() {
            return Ok(Self { texture: None, bytes: 0, places: BTreeMap::new(), uses: Vec::new(), first: 0 });
        }
        let size = |tile: &Tile| [scene.images[tile.0].width + 2, scene.images[tile.0].height + 2];
        tiles.sort_by_key(|t| std::cmp::Reverse(size(t)[1]));
        let longest = tiles.iter().flat_map(size).max().unwrap_or(1);
        if longest > gpu.capabilities.max_texture_side {
            return Err(GpuError::Device(format!(
                "a texture has a side of {} texels; the adapter's limit is {}; scale it down",
                longest - 2,
                gpu.capabilities.max_texture_side - 2
            )));
        }
        // Few texels get one small layer; many share layers with sides of at least 2048 texels.
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
                "the textures fill {} layers of {side}x{side} texels; the adapter's limit is {}; scale them down",
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
            first: 0,
        })
    }

    /// Returns what passes bind; None without images.
    pub(super) fn view(&self) -> Option<wgpu::TextureView> {
        self.texture.as_ref().map(as_array)
    }

    /// Returns the uses of textures by materials.
    pub(super) fn uses(&self) -> &[layouts::TextureUse] {
        &self.uses
    }

    /// Ends the uses of a material, and returns the first one and the one after the last.
    pub(super) fn end_material(&mut self) -> [u32; 2] {
        let range = [self.first, self.uses.len()].map(|index| index as u32);
        self.first = self.uses.len();
        range
    }

    /// Adds a use of a texture by the current material and returns its index. `channel` is that of a scalar.
    pub(super) fn add(&mut self, scene: &Scene, reference: &TextureRef, purpose: u32, channel: u32) -> u32 {
        self.add_scaled(scene, reference, purpose, channel, 0.0)
    }

    /// Adds the use of a normal map.
    pub(super) fn normals(&mut self, scene: &Scene, map: &NormalMap, purpose: u32) {
        self.add_scaled(scene, &map.texture, purpose, 0, map.scale);
    }

    pub(super) fn color(&mut self, scene: &Scene, color: &Color, purpose: u32) -> ([f32; 3], u32) {
        (color.factor.to_array(), color.texture.as_ref().map_or(NONE, |t| self.add(scene, t, purpose, 0)))
    }

    pub(super) fn scalar(&mut self, scene: &Scene, scalar: &Scalar, purpose: u32) -> (f32, u32) {
        let texture = scalar.texture.as_ref();
        (scalar.factor, texture.map_or(NONE, |(t, channel)| self.add(scene, t, purpose, *channel)))
    }

    /// Uses of the same texels share one record, so that they are read once.
    fn add_scaled(&mut self, scene: &Scene, reference: &TextureRef, purpose: u32, channel: u32, scale: f32) -> u32 {
        let texture = &scene.textures[reference.texture];
        let image = &scene.images[texture.image];
        let [layer, x, y] = self.places[&(texture.image, texture.wrap.map(wrap_code))];
        let m = reference.transform;
        let row = |f: fn(Vec2) -> f32| [f(m.matrix2.x_axis), f(m.matrix2.y_axis), f(m.translation)];
        let texels = layouts::TextureUse {
            row_u: row(|v| v.x),
            layer,
            row_v: row(|v| v.y),
            flags: wrap_code(texture.wrap[0])
                | wrap_code(texture.wrap[1]) << 2
                | if texture.filter == Filter::Linear { LINEAR } else { 0 }
                | if texture.srgb { SRGB } else { 0 }
                | if reference.uv_set == 1 { SECOND_UV } else { 0 },
            origin: [x as f32, y as f32],
            size: [image.width as f32, image.height as f32],
            scale,
            ..Default::default()
        };
        let same = |u: &layouts::TextureUse| layouts::TextureUse { purposes: 0, channels: 0, ..*u } == texels;
        let index = self.uses[self.first..].iter().position(same).map(|at| self.first + at).unwrap_or_else(|| {
            self.uses.push(texels);
            self.uses.len() - 1
        });
        self.uses[index].purposes |= purpose;
        // Only scalars have a channel, and their purposes come first.
        self.uses[index].channels |= channel.checked_shl(2 * purpose.trailing_zeros()).unwrap_or(0);
        index as u32
    }
}

/// Returns the code of a wrap mode in shaders/lib/surface/texture.wesl.
fn wrap_code(wrap: Wrap) -> u32 {
    match wrap {
        Wrap::Repeat => 0,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    }
}

/// Returns an image with a border of one texel, which its wrap modes determine.
fn with_border(image: &Image, wrap: [Wrap; 2]) -> Vec<[u8; 4]> {
    // Index of the texel for row or column i - 1, which is -1 or n on the border.
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
