//! Tables that passes read and none writes, one after the other in one buffer, since WebGPU binds eight storage
//! buffers to a stage (shaders/lib/scene/scene.wesl). Where loads from buffers are much code, shaders read a texture of the
//! same rows.

use std::borrow::Cow;
use std::ops::Range;

use bytemuck::NoUninit;

use crate::gpu::{Flag, Gpu};
use crate::render::layouts::TableRows;
use crate::render::upload::textures::{texture, write_texture};

/// Bytes of a row.
const ROW: usize = 16;

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
    Aims,
    AimDensities,
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

/// What shaders read tables from.
enum Rows {
    Buffer(wgpu::Buffer),
    /// For [`Flag::TexelTables`]: a texture of 2^shift columns.
    Texels {
        texture: wgpu::Texture,
        view: wgpu::TextureView,
        shift: u32,
    },
}

impl Rows {
    /// Uploads tables.
    fn new(gpu: &Gpu, bytes: &[u8]) -> Self {
        if !gpu.capabilities.flags().contains(&Flag::TexelTables) {
            return Self::Buffer(gpu.upload("tables", bytes));
        }
        let all = (bytes.len() / ROW) as u32;
        let shift = all.isqrt().ilog2();
        let size = [1 << shift, all.div_ceil(1 << shift), 1];
        let texture = texture(gpu, "tables", wgpu::TextureFormat::Rgba32Uint, size);
        let this = Self::Texels { view: texture.create_view(&Default::default()), texture, shift };
        this.write(gpu, 0, bytes);
        this
    }

    /// Writes rows from one on.
    fn write(&self, gpu: &Gpu, first: usize, data: &[u8]) {
        match self {
            Self::Buffer(buffer) => gpu.queue.write_buffer(buffer, (first * ROW) as u64, data),
            Self::Texels { texture, shift, .. } => {
                // What remains of the last row holds no data.
                let mut data = Cow::Borrowed(data);
                if !data.len().is_multiple_of(ROW) {
                    let padded = data.len().next_multiple_of(ROW);
                    data.to_mut().resize(padded, 0);
                }
                let (mut at, columns) = (first as u32, 1 << shift);
                let mut left: &[u8] = &data;
                while !left.is_empty() {
                    // The rest of a line of texels, or all whole lines.
                    let rows = (left.len() / ROW) as u32;
                    let [x, y] = [at % columns, at / columns];
                    let whole = x == 0 && rows >= columns;
                    let size = if whole { [columns, rows / columns] } else { [rows.min(columns - x), 1] };
                    let (now, later) = left.split_at((size[0] * size[1]) as usize * ROW);
                    write_texture(gpu, texture, [x, y, 0], size, ROW as u32, now);
                    (at, left) = (at + size[0] * size[1], later);
                }
            }
        }
    }
}

/// Returns the bytes that a table takes, if there is one.
fn range_of(ranges: &[(Table, Range<usize>)], table: Table) -> Option<&Range<usize>> {
    ranges.iter().find(|(of, _)| *of == table).map(|(_, range)| range)
}

/// Tables on the device.
pub(super) struct Tables {
    rows: Rows,
    pub(super) first_rows: wgpu::Buffer,
    ranges: Vec<(Table, Range<usize>)>,
}

impl Tables {
    pub(super) fn new(gpu: &Gpu, data: TableData, triangles: u32) -> Self {
        let TableData { mut bytes, ranges } = data;
        let zeros = bytes.len();
        bytes.resize(zeros + ZERO_ROWS * ROW, 0);
        let rows = Rows::new(gpu, &bytes);
        let row = |table| (range_of(&ranges, table).map_or(zeros, |range| range.start) / ROW) as u32;
        let table_rows = TableRows {
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
            aims: row(Table::Aims),
            aimed: (range_of(&ranges, Table::Aims).map_or(0, Range::len) / size_of::<[u32; 2]>()) as u32,
            aim_densities: row(Table::AimDensities),
            columns_shift: if let Rows::Texels { shift, .. } = rows { shift } else { 0 },
        };
        let first_rows = gpu.uniform::<TableRows>("table_rows");
        gpu.queue.write_buffer(&first_rows, 0, bytemuck::bytes_of(&table_rows));
        Self { rows, first_rows, ranges }
    }

    /// Returns what shaders read.
    pub(super) fn binding(&self) -> wgpu::BindingResource<'_> {
        match &self.rows {
            Rows::Buffer(buffer) => buffer.as_entire_binding(),
            Rows::Texels { view, .. } => wgpu::BindingResource::TextureView(view),
        }
    }

    /// Returns the bytes of buffers and texture.
    pub(super) fn bytes(&self) -> u64 {
        self.first_rows.size()
            + match &self.rows {
                Rows::Buffer(buffer) => buffer.size(),
                Rows::Texels { texture, .. } => ROW as u64 * u64::from(texture.width()) * u64::from(texture.height()),
            }
    }

    /// Returns the bytes of a table; 0 if there is none.
    pub(super) fn bytes_of(&self, table: Table) -> usize {
        range_of(&self.ranges, table).map_or(0, Range::len)
    }

    /// Writes the first records of a table, if there is one.
    pub(super) fn write<T: NoUninit>(&self, gpu: &Gpu, table: Table, records: &[T]) {
        if let Some(range) = range_of(&self.ranges, table) {
            let data: &[u8] = bytemuck::cast_slice(records);
            self.rows.write(gpu, range.start / ROW, &data[..data.len().min(range.len())]);
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
