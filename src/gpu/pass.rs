//! Pipelines built from a linked shader, with bindings by name.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::{Arc, Mutex};

use wgpu::naga;

use super::non_finite::Floats;
use super::{Flags, Gpu, link};

/// Resources by the name that the shader gives them. Names that a shader does not use are ignored.
pub type Bindings<'a> = &'a [(&'a str, wgpu::BindingResource<'a>)];

/// Where each name is bound: group, binding.
type Slots = BTreeMap<String, (u32, u32)>;

/// Pipelines that the device has: who asks for one again, by shader, flags and targets, gets the same.
#[derive(Default)]
pub(super) struct Pipelines {
    compute: Mutex<HashMap<String, Compute>>,
    raster: Mutex<HashMap<String, Raster>>,
}

/// What is kept under a name, or what is made now; entered in the ledger either way.
fn kept<T: Clone>(
    gpu: &Gpu,
    there: &Mutex<HashMap<String, T>>,
    (label, shader, flags): (&str, &str, Flags),
    more: &str,
    functions: impl Fn(&T) -> Arc<BTreeSet<String>>,
    make: impl FnOnce() -> T,
) -> T {
    let flags: BTreeSet<_> = flags.iter().collect();
    let key = format!("{label} {shader} {flags:?} {more}");
    let found = there.lock().ok().and_then(|there| there.get(&key).cloned());
    let pipeline = found.unwrap_or_else(|| {
        let pipeline = make();
        if let Ok(mut there) = there.lock() {
            there.insert(key, pipeline.clone());
        }
        pipeline
    });
    gpu.ledger.pipeline(label, &functions(&pipeline));
    pipeline
}

/// What naga knows of a shader of ours, and wgpu's module.
struct Linked {
    module: wgpu::ShaderModule,
    slots: Arc<Slots>,
    /// What it may write that holds floats.
    written: Arc<BTreeMap<String, Floats>>,
    functions: Arc<BTreeSet<String>>,
    workgroup: [u32; 3],
}

#[expect(
    clippy::panic,
    reason = "a shader of ours that does not link or parse is a bug that tests catch, not a condition to handle"
)]
fn load(gpu: &Gpu, name: &str, flags: Flags) -> Linked {
    let source = link(name, flags).unwrap_or_else(|e| panic!("shader does not link: {e}"));
    let parsed =
        naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&source)));
    let slots: Slots = parsed
        .global_variables
        .iter()
        .filter_map(|(_, v)| Some((v.name.clone()?, v.binding.map(|b| (b.group, b.binding))?)))
        .collect();
    let writes = |v: &naga::GlobalVariable| matches!(v.space, naga::AddressSpace::Storage { access } if access.contains(naga::StorageAccess::STORE));
    let written: BTreeMap<_, _> = parsed
        .global_variables
        .iter()
        .filter(|(_, v)| writes(v))
        .filter_map(|(_, v)| Some((v.name.clone()?, Floats::of(&parsed, v.ty)?)))
        .collect();
    let functions: BTreeSet<_> = parsed.functions.iter().filter_map(|(_, f)| f.name.clone()).collect();
    let workgroup = parsed.entry_points.first().map_or([1; 3], |e| e.workgroup_size);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    Linked { module, slots: slots.into(), written: written.into(), functions: functions.into(), workgroup }
}

#[expect(clippy::panic, reason = "a missing name is a bug in the pass that forgot it")]
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

/// So many threads as columns and rows of up to 2^16, for [`Compute::record`]: one dimension alone ends at 65535 workgroups.
#[must_use]
pub fn rows(threads: u32) -> [u32; 2] {
    [threads.min(1 << 16), threads.div_ceil(1 << 16)]
}

/// A compute pipeline.
#[derive(Clone)]
pub struct Compute {
    label: &'static str,
    pipeline: wgpu::ComputePipeline,
    slots: Arc<Slots>,
    written: Arc<BTreeMap<String, Floats>>,
    functions: Arc<BTreeSet<String>>,
    workgroup: [u32; 3],
}

impl Compute {
    /// Links `shader` and builds its one compute entry point; `label` names it in timings and debuggers.
    #[must_use]
    pub fn new(gpu: &Gpu, label: &'static str, shader: &str, flags: Flags) -> Self {
        let make = || Self::build(gpu, label, shader, flags);
        kept(gpu, &gpu.pipelines.compute, (label, shader, flags), "", |p| Arc::clone(&p.functions), make)
    }

    fn build(gpu: &Gpu, label: &'static str, shader: &str, flags: Flags) -> Self {
        let Linked { module, slots, written, functions, workgroup } = load(gpu, shader, flags);
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(label),
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                zero_initialize_workgroup_memory: false,
                ..Default::default()
            },
            cache: None,
        });
        Self { label, pipeline, slots, written, functions, workgroup }
    }

    /// Records one dispatch that covers `threads` (rounded up to whole workgroups; shaders check their bounds).
    pub fn record(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, threads: [u32; 2], bindings: Bindings) {
        let groups = bind_groups(gpu, self.label, &self.slots, |g| self.pipeline.get_bind_group_layout(g), bindings);
        let writes = gpu.timings.begin(self.label);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(self.label),
            timestamp_writes: writes.as_ref().map(|w| wgpu::ComputePassTimestampWrites {
                query_set: &w.set,
                beginning_of_pass_write_index: Some(w.begin),
                end_of_pass_write_index: Some(w.end),
            }),
        });
        pass.set_pipeline(&self.pipeline);
        for (group, bound) in groups.iter().enumerate() {
            pass.set_bind_group(group as u32, bound, &[]);
        }
        let workgroups = [threads[0].div_ceil(self.workgroup[0]), threads[1].div_ceil(self.workgroup[1])];
        gpu.ledger.dispatch(self.label, workgroups);
        pass.dispatch_workgroups(workgroups[0], workgroups[1], 1);
        drop(pass);
        gpu.non_finite.look(gpu, encoder, self.label, &self.written, bindings);
    }
}

/// What a raster pass draws into.
pub struct RasterTargets<'a> {
    /// Cleared to all ones bits or zero as given, or neither written nor cleared where the pipeline has no colour.
    pub color: &'a wgpu::TextureView,
    /// Value that the colour target is cleared to.
    pub clear: wgpu::Color,
    /// Depth target, cleared to 0 (reversed depth).
    pub depth: Option<&'a wgpu::TextureView>,
}

/// A render pipeline of triangles without vertex buffers.
#[derive(Clone)]
pub struct Raster {
    label: &'static str,
    pipeline: wgpu::RenderPipeline,
    slots: Arc<Slots>,
    functions: Arc<BTreeSet<String>>,
}

impl Raster {
    /// Links `shader` with entry points `vertex` and `fragment`. Where `writes_color` is false, the colour target only gives the
    /// size. With `depth`, the test is reversed (greater passes).
    #[must_use]
    pub fn new(
        gpu: &Gpu,
        label: &'static str,
        shader: &str,
        flags: Flags,
        color: wgpu::TextureFormat,
        writes_color: bool,
        depth: Option<wgpu::TextureFormat>,
    ) -> Self {
        let make = || Self::build(gpu, label, shader, flags, (color, writes_color, depth));
        let targets = format!("{color:?} {writes_color} {depth:?}");
        kept(gpu, &gpu.pipelines.raster, (label, shader, flags), &targets, |p| Arc::clone(&p.functions), make)
    }

    fn build(
        gpu: &Gpu,
        label: &'static str,
        shader: &str,
        flags: Flags,
        (color, writes_color, depth): (wgpu::TextureFormat, bool, Option<wgpu::TextureFormat>),
    ) -> Self {
        let Linked { module, slots, functions, .. } = load(gpu, shader, flags);
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(label),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: depth.map(|format| wgpu::DepthStencilState {
                format,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: None,
                compilation_options: Default::default(),
                targets: &[Some(wgpu::ColorTargetState {
                    format: color,
                    blend: None,
                    write_mask: if writes_color { wgpu::ColorWrites::ALL } else { wgpu::ColorWrites::empty() },
                })],
            }),
            multiview_mask: None,
            cache: None,
        });
        Self { label, pipeline, slots, functions }
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
        let groups = bind_groups(gpu, self.label, &self.slots, |g| self.pipeline.get_bind_group_layout(g), bindings);
        let writes = gpu.timings.begin(self.label);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(self.label),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: targets.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(targets.clear), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: targets.depth.map(|view| wgpu::RenderPassDepthStencilAttachment {
                view,
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
        pass.set_pipeline(&self.pipeline);
        for (group, bound) in groups.iter().enumerate() {
            pass.set_bind_group(group as u32, bound, &[]);
        }
        pass.set_viewport(0.0, 0.0, viewport[0] as f32, viewport[1] as f32, 0.0, 1.0);
        gpu.ledger.draw(self.label);
        draw(&mut pass);
    }
}
