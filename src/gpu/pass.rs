//! Passes: pipelines of a linked shader, with bindings by name.

use std::sync::Arc;

#[cfg(not(target_family = "wasm"))]
use super::compilers::run_nothing;
use super::pipelines::{Built, Pipeline, Slots, request};
use super::{Flag, Gpu, Source};

/// A resource with its name in shaders.
pub type Binding<'a> = (&'a str, wgpu::BindingResource<'a>);

/// Resources by their names in the shader. Names that a shader does not declare are ignored.
pub type Bindings<'a> = &'a [Binding<'a>];

/// Creates the bind groups of a pipeline.
#[expect(clippy::panic, reason = "a missing name is a bug of the pass that binds")]
fn bind_groups(
    gpu: &Gpu,
    label: &str,
    slots: &Slots,
    layout: impl Fn(u32) -> wgpu::BindGroupLayout,
    bindings: Bindings,
) -> Vec<wgpu::BindGroup> {
    let groups = slots.values().map(|(group, _)| group + 1).max().unwrap_or(0);
    (0..groups)
        .map(|group| {
            let entries: Vec<_> = slots
                .iter()
                .filter(|(_, slot)| slot.0 == group)
                .map(|(name, slot)| wgpu::BindGroupEntry {
                    binding: slot.1,
                    resource: bindings
                        .iter()
                        .find(|(given, _)| given == name)
                        .unwrap_or_else(|| panic!("{label}: nothing is bound to {name}"))
                        .1
                        .clone(),
                })
                .collect();
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(label),
                layout: &layout(group),
                entries: &entries,
            })
        })
        .collect()
}

/// Returns the last component of a path.
fn last_part(path: &'static str) -> &'static str {
    path.rsplit('/').next().unwrap_or(path)
}

/// Arranges threads in rows of up to 2^16 for [`Compute::record`], since one dimension has at most 65535
/// workgroups.
#[must_use]
pub fn rows(threads: u32) -> [u32; 2] {
    [threads.min(1 << 16), threads.div_ceil(1 << 16)]
}

/// A compute pipeline.
#[derive(Clone)]
pub struct Compute {
    label: &'static str,
    pipeline: Arc<Pipeline<wgpu::ComputePipeline>>,
}

impl Compute {
    /// Links a shader by its path below shaders/, without extension, and builds its compute entry point. The
    /// last component of the path is its label in timings and debuggers. Threads build the pipeline; its first use
    /// waits for them.
    #[must_use]
    pub fn new(gpu: &Gpu, shader: &'static str, flags: &[Flag]) -> Self {
        Self::labelled(gpu, last_part(shader), shader, flags)
    }

    /// As [`Self::new`] with a label of its own, for shaders that several passes use.
    #[must_use]
    pub fn labelled(gpu: &Gpu, label: &'static str, shader: &'static str, flags: &[Flag]) -> Self {
        Self::from_source(gpu, label, &Source::Embedded(shader), flags)
    }

    /// As [`Self::labelled`] from any source, such as that of a test.
    #[must_use]
    pub fn from_source(gpu: &Gpu, label: &'static str, source: &Source<'static>, flags: &[Flag]) -> Self {
        let create = move |device: &wgpu::Device, module: &wgpu::ShaderModule| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(label),
                layout: None,
                module,
                entry_point: None,
                compilation_options: wgpu::PipelineCompilationOptions {
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            })
        };
        Self { label, pipeline: request(gpu, &gpu.pipelines.compute, (label, source, flags), create) }
    }

    /// Records one dispatch of at least `threads`, rounded up to whole workgroups. Shaders check their
    /// bounds.
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, threads: [u32; 2], bindings: Bindings) {
        self.record_layers(gpu, encoder, threads, 1, bindings);
    }

    /// As [`Self::record`], once for each layer: workgroups have it as z.
    pub fn record_layers(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        threads: [u32; 2],
        layers: u32,
        bindings: Bindings,
    ) {
        let Built { pipeline, slots, written, workgroup, .. } = self.pipeline.built();
        let groups = bind_groups(gpu, self.label, slots, |g| pipeline.get_bind_group_layout(g), bindings);
        #[cfg(not(target_family = "wasm"))]
        if self.pipeline.is_first_run() {
            if !self.pipeline.was_compiled_elsewhere() {
                gpu.compilation.begin(self.label);
            }
            let _ = gpu.device.poll(wgpu::PollType::wait_indefinitely());
            let began = web_time::Instant::now();
            run_nothing(&gpu.device, &gpu.queue, pipeline, &groups);
            gpu.compilation.end(self.label, began.elapsed());
        }
        let writes = gpu.timings.begin(self.label);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(self.label),
            timestamp_writes: writes.as_ref().map(|w| wgpu::ComputePassTimestampWrites {
                query_set: &w.set,
                beginning_of_pass_write_index: Some(w.begin),
                end_of_pass_write_index: Some(w.end),
            }),
        });
        pass.set_pipeline(pipeline);
        for (group, bound) in groups.iter().enumerate() {
            pass.set_bind_group(group as u32, bound, &[]);
        }
        let [columns, rows] = [0, 1].map(|axis| threads[axis].div_ceil(workgroup[axis]));
        gpu.ledger.dispatch(self.label, [columns, rows, layers]);
        pass.dispatch_workgroups(columns, rows, layers);
        drop(pass);
        gpu.non_finite.record(gpu, encoder, self.label, written, bindings);
    }
}

/// The value of pixels in which nothing was drawn: all ones.
const NO_INDEX: wgpu::Color =
    wgpu::Color { r: u32::MAX as f64, g: u32::MAX as f64, b: u32::MAX as f64, a: u32::MAX as f64 };

/// The targets of a raster pass.
pub struct RasterTargets<'a> {
    /// Colour target in [`Raster::COLOR_FORMAT`], which is cleared to all ones.
    pub color: &'a wgpu::TextureView,
    /// Depth target in [`Raster::DEPTH_FORMAT`], which is cleared to 0 (reversed depth).
    pub depth: &'a wgpu::TextureView,
}

/// A render pipeline that draws triangles without vertex buffers, and keeps an index of the nearest per pixel.
#[derive(Clone)]
pub struct Raster {
    label: &'static str,
    pipeline: Arc<Pipeline<wgpu::RenderPipeline>>,
}

impl Raster {
    /// Format of the colour target.
    pub const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
    /// Format of the depth target.
    pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

    /// Links a shader with a vertex and a fragment entry point, labelled and built as in [`Compute::new`].
    /// Fragments of greater depth pass (reversed depth).
    #[must_use]
    pub fn new(gpu: &Gpu, shader: &'static str, flags: &[Flag]) -> Self {
        let label = last_part(shader);
        let create = move |device: &wgpu::Device, module: &wgpu::ShaderModule| {
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(label),
                layout: None,
                vertex: wgpu::VertexState {
                    module,
                    entry_point: None,
                    compilation_options: Default::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: Self::DEPTH_FORMAT,
                    depth_write_enabled: Some(true),
                    depth_compare: Some(wgpu::CompareFunction::Greater),
                    stencil: Default::default(),
                    bias: Default::default(),
                }),
                multisample: Default::default(),
                fragment: Some(wgpu::FragmentState {
                    module,
                    entry_point: None,
                    compilation_options: Default::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format: Self::COLOR_FORMAT,
                        blend: None,
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        let asked = (label, &Source::Embedded(shader), flags);
        Self { label, pipeline: request(gpu, &gpu.pipelines.raster, asked, create) }
    }

    /// Records one pass with one draw.
    pub fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        targets: &RasterTargets,
        viewport: [u32; 2],
        bindings: Bindings,
        draw: impl FnOnce(&mut wgpu::RenderPass),
    ) {
        let Built { pipeline, slots, .. } = self.pipeline.built();
        let groups = bind_groups(gpu, self.label, slots, |g| pipeline.get_bind_group_layout(g), bindings);
        let writes = gpu.timings.begin(self.label);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(self.label),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: targets.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(NO_INDEX), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: targets.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            timestamp_writes: writes.as_ref().map(|w| wgpu::RenderPassTimestampWrites {
                query_set: &w.set,
                beginning_of_pass_write_index: Some(w.begin),
                end_of_pass_write_index: Some(w.end),
            }),
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(pipeline);
        for (group, bound) in groups.iter().enumerate() {
            pass.set_bind_group(group as u32, bound, &[]);
        }
        pass.set_viewport(0.0, 0.0, viewport[0] as f32, viewport[1] as f32, 0.0, 1.0);
        gpu.ledger.draw(self.label);
        draw(&mut pass);
    }
}
