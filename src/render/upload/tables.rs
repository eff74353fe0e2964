//! Tables that passes read and none writes, one after the other in one buffer, since WebGPU binds eight storage
//! buffers to a stage (shaders/lib/scene/scene.wesl).

use std::ops::Range;

use bytemuck::NoUninit;

use crate::gpu::{Flag, Gpu};
use crate::render::layouts::TableRows;
use crate::render::upload::textures::texture;

/// Bytes of a row.
const ROW: usize = 16;

/// Texels of a row of the texture (shaders/lib/scene/scene.wesl).
const TEXELS: u32 = 1 << 11;

/// Rows of zeros behind the tables, at which those that the scene lacks begin: longer than any record.
const ZERO_ROWS: usize = 16;

/// The kinds of tables, in their order in the buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Table {
    Triangles,
    Materials,
    Layers,
    TextureUses,
    SheenAlbedos,
    RoughCoats,
    Lights,
    LightSums,
    Emitters,
    Patterns,
    SkyShares,
    LightNodes,
}

/// Tables on the host.
#[derive(Default)]
pub(super) struct TableData {
    bytes: Vec<u8>,
    ranges: Vec<(Table, Range<usize>)>,
}

impl TableData {
    /// Adds a table, unless it is empty.
    pub(super) fn add<T: NoUninit>(&mut self, table: Table, records: &[T]) {
        let data: &[u8] = bytemuck::cast_slice(records);
        if !data.is_empty() {
            let begin = self.bytes.len();
            self.bytes.extend_from_slice(data);
            self.ranges.push((table, begin..self.bytes.len()));
            self.bytes.resize(self.bytes.len().next_multiple_of(ROW), 0);
        }
    }

    /// Returns the size of the buffer in bytes.
    pub(super) fn size(&self) -> u64 {
        (self.bytes.len() + ZERO_ROWS * ROW) as u64
    }
}

/// Tables on the device.
pub(super) struct Tables {
    pub(super) buffer: wgpu::Buffer,
    /// The same as a texture, for shaders with [`Flag::TexelTables`].
    texels: Option<(wgpu::Texture, wgpu::TextureView)>,
    pub(super) rows: wgpu::Buffer,
    ranges: Vec<(Table, Range<usize>)>,
}

impl Tables {
    pub(super) fn new(gpu: &Gpu, data: TableData, triangles: u32) -> Self {
        let TableData { mut bytes, ranges } = data;
        let zeros = bytes.len();
        bytes.resize(zeros + ZERO_ROWS * ROW, 0);
        let first = |table| ranges.iter().find(|(t, _)| *t == table).map_or(zeros, |(_, range)| range.start);
        let row = |table| (first(table) / ROW) as u32;
        let rows = TableRows {
            triangles,
            materials: row(Table::Materials),
            layers: row(Table::Layers),
            texture_uses: row(Table::TextureUses),
            sheen_albedos: row(Table::SheenAlbedos),
            lights: row(Table::Lights),
            light_sums: row(Table::LightSums),
            emitters: row(Table::Emitters),
            patterns: row(Table::Patterns),
            sky_shares: row(Table::SkyShares),
            light_nodes: row(Table::LightNodes),
            rough_coats: row(Table::RoughCoats),
        };
        let uniform = gpu.uniform::<TableRows>("table_rows");
        gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&rows));
        let texels = gpu.capabilities.flags().contains(&Flag::TexelTables).then(|| {
            bytes.resize(bytes.len().next_multiple_of(ROW * TEXELS as usize), 0);
            let height = (bytes.len() / ROW) as u32 / TEXELS;
            let texture = texture(gpu, "tables", wgpu::TextureFormat::Rgba32Uint, [TEXELS, height, 1]);
            let view = texture.create_view(&Default::default());
            (texture, view)
        });
        let this = Self { buffer: gpu.upload("tables", &bytes), texels, rows: uniform, ranges };
        this.copy(gpu);
        this
    }

    /// Returns what shaders read.
    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        match &self.texels {
            Some((_, view)) => wgpu::BindingResource::TextureView(view),
            None => self.buffer.as_entire_binding(),
        }
    }

    /// Copies the buffer to the texture, if there is one.
    pub(super) fn copy(&self, gpu: &Gpu) {
        let Some((texture, _)) = &self.texels else { return };
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(ROW as u32 * TEXELS), rows_per_image: None };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_texture(
            wgpu::TexelCopyBufferInfo { buffer: &self.buffer, layout },
            texture.as_image_copy(),
            texture.size(),
        );
        gpu.queue.submit([encoder.finish()]);
    }

    /// Returns the bytes of a table; 0 if there is none.
    pub(super) fn bytes_of(&self, table: Table) -> usize {
        self.ranges.iter().find(|(t, _)| *t == table).map_or(0, |(_, range)| range.len())
    }

    /// Writes the first records of a table, if there is one.
    pub(super) fn write<T: NoUninit>(&self, gpu: &Gpu, table: Table, records: &[T]) {
        if let Some((_, range)) = self.ranges.iter().find(|(t, _)| *t == table) {
            let data: &[u8] = bytemuck::cast_slice(records);
            gpu.queue.write_buffer(&self.buffer, range.start as u64, &data[..data.len().min(range.len())]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_begin_at_rows_and_those_without_records_take_none() {
        let mut data = TableData::default();
        data.add(Table::Materials, &[1_u32; 5]);
        let size = data.size();
        data.add::<u32>(Table::Layers, &[]);
        assert_eq!(data.size(), size, "an empty table takes bytes");
        data.add(Table::LightSums, &[0.5_f32; 3]);
        assert_eq!(data.ranges, [(Table::Materials, 0..20), (Table::LightSums, 32..44)]);
        assert_eq!(data.size() as usize, 48 + ZERO_ROWS * ROW);
        assert_eq!(bytemuck::pod_read_unaligned::<f32>(&data.bytes[40..44]), 0.5);
    }
}
