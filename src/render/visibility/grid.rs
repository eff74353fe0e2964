//! A deep raster of the scene, once per pose: a grid of triangle lists that answers rays in any direction
//! (shaders/visibility/grid.wesl; docs/method.md, section 4).
//!
//! Triangles are counted in the cells that they touch; cells with many are divided; triangles are counted in
//! sub-cells; lists are reserved, each exactly as long as it needs to be, and written. Two totals are read
//! back between the steps, since they are the sizes of buffers.

use glam::Vec3;

use crate::gpu::{Binding, Capabilities, Compute, Flag, Gpu, GpuError, read_back_async, rows};
use crate::render::layouts;
use crate::render::visibility::tracer::TracedScene;
use crate::render::visibility::view::capacity_for;

/// Share of the box's longest side by which the box is enlarged.
const MARGIN: f32 = 1e-3;

/// Triangles of a cell that is not divided, and sub-cells of a divided one for each of its triangles.
const LISTED: u32 = 12;
const SUB_CELLS: f32 = 2.0;

/// How often these are doubled and halved, at most, where lists would be longer than a buffer. A grid of 2,000,000
/// triangles fits into WebGPU's 128 MiB that way.
const COARSEST: u32 = 5;

/// Words that entries of lists can be addressed with.
const MOST_WORDS: u64 = 1 << 26;

/// The grid on the device.
pub struct Grid {
    passes: Passes,
    grid: wgpu::Buffer,
    /// One uniform for each axis along which distances are found.
    axes: [wgpu::Buffer; 3],
    /// Triangles, then the words of cells and lists.
    rows: wgpu::Buffer,
    /// Byte at which words begin.
    words_at: u64,
    counts: wgpu::Buffer,
    distances: [wgpu::Buffer; 2],
    /// Sub-cells, and entries of lists.
    totals: wgpu::Buffer,
    /// How often cells are divided less, 0 to [`COARSEST`].
    coarseness: u32,
}

/// Returns the cells along the longest side of the box of a number of triangles.
///
/// On a surface of n^2 cells there are about triangles / n^2 in each. A GPU marches faster where lists are shorter
/// (H100, paths of two bounces: 0.82 of the time in `displaced_room` of 60,000 triangles, 0.93 in Sponza); a
/// software driver does not, and takes 1.4 to 1.8 times as long to make such a grid.
fn cells_along(triangles: u32, capabilities: &Capabilities) -> u32 {
    let (factor, most) = if capabilities.software { (4.0, 64) } else { (6.0, 96) };
    let cells = factor * f64::from(triangles.max(1)).powf(0.25);
    (cells as u32).clamp(8, most)
}

/// Commands of one submission over the scene's triangles.
struct Recording<'a> {
    gpu: &'a Gpu,
    scene: &'a TracedScene<'a>,
    encoder: wgpu::CommandEncoder,
}

impl<'a> Recording<'a> {
    fn new(gpu: &'a Gpu, scene: &'a TracedScene<'a>, label: &str) -> Self {
        let encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) });
        Self { gpu, scene, encoder }
    }

    /// Replaces a buffer that is shorter than a number of words by one with room for an eighth more, since the
    /// next pose may need more; the first `kept` words stay.
    fn lengthen(&mut self, buffer: &mut wgpu::Buffer, name: &str, words: u64, kept: u64) {
        if buffer.size() >= 4 * words {
            return;
        }
        let longer = self.gpu.storage(name, (4 * capacity_for(words)).min(self.gpu.capabilities.max_storage_bytes));
        if kept > 0 {
            self.encoder.copy_buffer_to_buffer(buffer, 0, &longer, 0, 4 * kept);
        }
        *buffer = longer;
    }

    fn run(&mut self, pass: &Compute, threads: [u32; 2], inputs: &[Binding]) {
        let bindings = [self.scene.bindings.as_slice(), inputs].concat();
        pass.record(self.gpu, &mut self.encoder, threads, &bindings);
    }

    fn submit(self) {
        self.gpu.queue.submit([self.encoder.finish()]);
    }
}

/// The passes that build a grid.
struct Passes {
    count_cells: Compute,
    divide: Compute,
    count_lists: Compute,
    reserve: Compute,
    mark: Compute,
    write: Compute,
    distances: Compute,
}

impl Passes {
    fn new(gpu: &Gpu) -> Self {
        let triangles = |flags: &[Flag]| Compute::new(gpu, "visibility/grid_build/grid_triangles", flags);
        let cells = |flags: &[Flag]| Compute::new(gpu, "visibility/grid_build/grid_cells", flags);
        Self {
            count_cells: triangles(&[Flag::Cells]),
            divide: cells(&[Flag::Cells]),
            count_lists: triangles(&[]),
            reserve: cells(&[]),
            mark: cells(&[Flag::Lists]),
            write: triangles(&[Flag::Lists]),
            distances: Compute::new(gpu, "visibility/grid_build/grid_distances", &[]),
        }
    }
}

impl Grid {
    /// Rasterizes the scene in its pose.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails or cannot bind the lists.
    pub async fn new(gpu: &Gpu, scene: &TracedScene<'_>) -> Result<Self, GpuError> {
        let axis = |axis: u32| {
            let uniform = gpu.uniform::<layouts::Axis>("along");
            gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&layouts::Axis { axis, ..Default::default() }));
            uniform
        };
        let none = |name| gpu.storage(name, 0);
        let mut this = Self {
            passes: Passes::new(gpu),
            grid: gpu.uniform::<layouts::Grid>("grid"),
            axes: [0, 1, 2].map(axis),
            rows: none("grid_rows"),
            words_at: 0,
            counts: none("counts"),
            distances: [none("distances"), none("distances")],
            totals: gpu.storage("totals", 16),
            coarseness: 0,
        };
        this.rebuild(gpu, scene).await?;
        Ok(this)
    }

    /// Rasterizes the scene in another pose. Buffers are kept where they are long enough, and the grid is as coarse as the
    /// last one had to be.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub async fn rebuild(&mut self, gpu: &Gpu, scene: &TracedScene<'_>) -> Result<(), GpuError> {
        while let Some(words) = self.overflow(gpu, scene).await? {
            if self.coarseness == COARSEST {
                return Err(GpuError::Device(format!(
                    "the grid of the scene's {} triangles needs {words} words; the adapter's limit is {}; simplify the \
                     scene, or use --visibility ray-query or bvh, or --visibility-from lists",
                    scene.triangles,
                    room(gpu, self.words_at / 4)
                )));
            }
            self.coarseness += 1;
        }
        Ok(())
    }

    /// Rasterizes the scene. Returns the words of cells and lists if there is no room for them.
    async fn overflow(&mut self, gpu: &Gpu, scene: &TracedScene<'_>) -> Result<Option<u64>, GpuError> {
        let mut grid = frame_of(scene, &gpu.capabilities);
        grid.listed = LISTED << self.coarseness;
        grid.sub_cells = SUB_CELLS / (1 << self.coarseness) as f32;
        // Parts of a buffer are bound at multiples of this.
        let alignment = u64::from(wgpu::Limits::default().min_storage_buffer_offset_alignment);
        self.words_at = (48 * u64::from(scene.triangles)).next_multiple_of(alignment);
        let words = self.words_at / 4;
        grid.words = words as u32;
        let cells = u64::from(grid.size[0]) * u64::from(grid.size[1]) * u64::from(grid.size[2]);
        let all_triangles = rows(scene.triangles);
        let all_cells = rows(cells as u32);
        let write = |grid: &layouts::Grid, to: &wgpu::Buffer| gpu.queue.write_buffer(to, 0, bytemuck::bytes_of(grid));
        write(&grid, &self.grid);

        let room = room(gpu, words);
        if cells > room {
            return Ok(Some(cells));
        }
        let mut recording = Recording::new(gpu, scene, "grid: cells");
        recording.lengthen(&mut self.counts, "counts", cells, 0);
        recording.lengthen(&mut self.rows, "grid_rows", words + cells, 0);
        self.distances.iter_mut().for_each(|buffer| recording.lengthen(buffer, "distances", cells, 0));
        recording.encoder.clear_buffer(&self.counts, 0, None);
        recording.encoder.clear_buffer(&self.totals, 0, None);
        recording.run(&self.passes.count_cells, all_triangles, &self.inputs());
        recording.run(&self.passes.divide, all_cells, &self.inputs());
        recording.submit();
        let sub_cells = u64::from(read_back_async::<u32>(gpu, &self.totals, 1).await?[0]);
        let lists = cells + sub_cells;
        if lists > room {
            return Ok(Some(lists));
        }
        grid.lists = lists as u32;
        write(&grid, &self.grid);

        let mut recording = Recording::new(gpu, scene, "grid: sub-cells");
        recording.lengthen(&mut self.counts, "counts", lists, cells);
        recording.lengthen(&mut self.rows, "grid_rows", words + lists, words + cells);
        if sub_cells > 0 {
            recording.run(&self.passes.count_lists, all_triangles, &self.inputs());
        }
        recording.run(&self.passes.reserve, rows(lists as u32), &self.inputs());
        recording.submit();
        let entries = u64::from(read_back_async::<u32>(gpu, &self.totals, 2).await?[1]);
        if lists + entries > room {
            return Ok(Some(lists + entries));
        }

        let mut recording = Recording::new(gpu, scene, "grid: lists");
        recording.lengthen(&mut self.rows, "grid_rows", words + lists + entries, words + lists);
        // Triangles are added to entries that hold nothing but the mark of a list's end.
        recording.encoder.clear_buffer(&self.rows, self.words_at + 4 * lists, None);
        recording.run(&self.passes.mark, rows(lists as u32), &self.inputs());
        recording.run(&self.passes.write, all_triangles, &self.inputs());
        for (axis, along) in self.axes.iter().enumerate() {
            let [before, after] = if axis == 1 { [0, 1] } else { [1, 0] }.map(|i: usize| &self.distances[i]);
            let of_axis = [bind("along", along), bind("before", before), bind("after", after)];
            recording.run(&self.passes.distances, all_cells, &[self.inputs().as_slice(), &of_axis].concat());
        }
        recording.submit();
        let size = grid.size;
        log::debug!(
            "grid: {size:?} cells, {sub_cells} sub-cells, {entries} entries of {} triangles, coarseness {}",
            scene.triangles,
            self.coarseness
        );
        Ok(None)
    }

    /// Returns the bindings of the passes that build the grid.
    fn inputs(&self) -> Vec<Binding<'_>> {
        let part =
            |offset, size| wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer: &self.rows, offset, size });
        vec![
            bind("grid", &self.grid),
            ("ray_triangles", part(0, wgpu::BufferSize::new(self.words_at))),
            ("grid_words", part(self.words_at, None)),
            bind("counts", &self.counts),
            bind("totals", &self.totals),
        ]
    }

    /// Returns the bindings of shaders/visibility/grid.wesl.
    #[must_use]
    pub fn bindings(&self) -> [Binding<'_>; 2] {
        [bind("grid", &self.grid), bind("grid_rows", &self.rows)]
    }

    /// Returns the bytes of the buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let Self { rows, counts, distances: [before, after], .. } = self;
        [rows, counts, before, after].map(wgpu::Buffer::size).iter().sum()
    }
}

fn bind<'a>(name: &'a str, buffer: &'a wgpu::Buffer) -> Binding<'a> {
    (name, buffer.as_entire_binding())
}

/// Returns the number of words that can be bound behind others, and addressed.
fn room(gpu: &Gpu, before: u64) -> u64 {
    (gpu.capabilities.max_storage_bytes / 4).saturating_sub(before).min(MOST_WORDS)
}

/// Returns the box and its division into cubes; the members that depend on the triangles are 0.
#[must_use]
pub fn frame_of(scene: &TracedScene, capabilities: &Capabilities) -> layouts::Grid {
    let longest_side = cells_along(scene.triangles, capabilities) as f32;
    let [low, high] = scene.bounds;
    let extent = (high - low).max(Vec3::ZERO);
    let size = low.abs().max(high.abs()).max_element();
    // Coordinates are not finer than their rounding.
    let longest = extent.max_element().max(size * 1e-6).max(1e-30);
    let margin = longest * MARGIN;
    let (low, extent) = (low - margin, extent + 2.0 * margin);
    let scale = longest_side / (longest + 2.0 * margin);
    let cells = (extent * scale).ceil().clamp(Vec3::ONE, Vec3::splat(longest_side));
    layouts::Grid {
        low: low.to_array(),
        scale,
        size: cells.as_uvec3().to_array(),
        triangles: scene.triangles,
        ..Default::default()
    }
}
