//! Pipelines that are built from a linked shader, with bindings by name.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::non_finite::Floats;
use super::shaders::{self, Source};
use super::{Flag, Gpu, flag_names};

/// A resource with its name in shaders.
pub type Binding<'a> = (&'a str, wgpu::BindingResource<'a>);

/// Resources by their names in the shader. Names that a shader does not declare are ignored.
pub type Bindings<'a> = &'a [Binding<'a>];

/// Group and binding of each name.
type Slots = BTreeMap<String, (u32, u32)>;

/// Cache of pipelines by shader, flags and targets.
#[derive(Default)]
pub(super) struct Pipelines {
    compute: Mutex<HashMap<String, Compute>>,
    raster: Mutex<HashMap<String, Raster>>,
    /// Folder that linked shaders are written to.
    dump: Mutex<Option<PathBuf>>,
}

impl Gpu {
    /// Writes the linked WGSL of every pipeline that is built from now on to a folder, which is created if
    /// necessary: PASS.wgsl, or PASS.N.wgsl for further sets of flags. The first line names the shader and
    /// its flags.
    ///
    /// # Errors
    /// The error of the file system if the folder cannot be created.
    pub fn dump_shaders(&self, folder: &Path) -> std::io::Result<()> {
        std::fs::create_dir_all(folder)?;
        if let Ok(mut dump) = self.pipelines.dump.lock() {
            *dump = Some(folder.to_owned());
        }
        Ok(())
    }
}

/// Writes a linked shader, if a folder is set.
fn dump(gpu: &Gpu, label: &str, shader: &Source, flags: &[Flag], wgsl: &str) {
    let Some(folder) = gpu.pipelines.dump.lock().ok().and_then(|folder| folder.clone()) else { return };
    let numbered = |n: usize| if n == 0 { format!("{label}.wgsl") } else { format!("{label}.{n}.wgsl") };
    let Some(path) = (0..1000).map(|n| folder.join(numbered(n))).find(|path| !path.exists()) else { return };
    let text = format!("// {} with {}\n{wgsl}", shader.name(), flag_names(flags));
    if let Err(error) = std::fs::write(&path, text) {
        log::warn!("{}: {error}", path.display());
    }
}

/// Returns the cached pipeline, or builds and caches it. The ledger counts either request.
fn cached<T: Clone>(
    gpu: &Gpu,
    cache: &Mutex<HashMap<String, T>>,
    (label, shader, flags): (&str, &Source, &[Flag]),
    more: &str,
    functions: impl Fn(&T) -> Arc<BTreeSet<String>>,
    make: impl FnOnce() -> T,
) -> T {
    let flags: BTreeSet<_> = flags.iter().collect();
    let key = format!("{label} {} {flags:?} {more}", shader.name());
    let found = cache.lock().ok().and_then(|pipelines| pipelines.get(&key).cloned());
    let pipeline = found.unwrap_or_else(|| {
        let pipeline = make();
        if let Ok(mut pipelines) = cache.lock() {
            pipelines.insert(key, pipeline.clone());
        }
        pipeline
    });
    gpu.ledger.pipeline(label, &functions(&pipeline));
    pipeline
}

/// A linked shader: wgpu's module, and naga's reflection of it.
struct Linked {
    module: wgpu::ShaderModule,
    slots: Arc<Slots>,
    /// The storage variables that the shader may write and that hold floats.
    written: Arc<BTreeMap<String, Floats>>,
    functions: Arc<BTreeSet<String>>,
    workgroup: [u32; 3],
}

#[expect(
    clippy::panic,
    reason = "a shader that does not link or parse is a bug that tests catch, not a condition to handle"
)]
/// Links, parses and compiles a shader.
fn load(gpu: &Gpu, label: &str, shader: &Source, flags: &[Flag]) -> Linked {
    let name = shader.name();
    let source = shaders::link_source(shader, flags).unwrap_or_else(|e| panic!("shader does not link: {e}"));
    dump(gpu, label, shader, flags, &source);
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
    pipeline: wgpu::ComputePipeline,
    slots: Arc<Slots>,
    written: Arc<BTreeMap<String, Floats>>,
    functions: Arc<BTreeSet<String>>,
    workgroup: [u32; 3],
}

impl Compute {
    /// Links a shader by its path below shaders/, without extension, and builds its compute entry point. The
    /// last component of the path is its label in timings and debuggers.
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
    pub fn from_source(gpu: &Gpu, label: &'static str, source: &Source, flags: &[Flag]) -> Self {
        let make = || Self::build(gpu, label, source, flags);
        cached(gpu, &gpu.pipelines.compute, (label, source, flags), "", |p| Arc::clone(&p.functions), make)
    }

    fn build(gpu: &Gpu, label: &'static str, shader: &Source, flags: &[Flag]) -> Self {
        let Linked { module, slots, written, functions, workgroup } = load(gpu, label, shader, flags);
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

    /// Records one dispatch of at least `threads`, rounded up to whole workgroups. Shaders check their
    /// bounds.
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
        gpu.non_finite.record(gpu, encoder, self.label, &self.written, bindings);
    }
}

/// The targets of a raster pass.
pub struct RasterTargets<'a> {
    /// Colour target, which is cleared to `clear`.
    pub color: &'a wgpu::TextureView,
    /// Clear value of the colour target.
    pub clear: wgpu::Color,
    /// Depth target, which is cleared to 0 (reversed depth).
    pub depth: Option<&'a wgpu::TextureView>,
}

/// A render pipeline that draws triangles without vertex buffers.
#[derive(Clone)]
pub struct Raster {
    label: &'static str,
    pipeline: wgpu::RenderPipeline,
    slots: Arc<Slots>,
    functions: Arc<BTreeSet<String>>,
}

impl Raster {
    /// Links a shader with a vertex and a fragment entry point, labelled as in [`Compute::new`]. With
    /// `depth`, fragments of greater depth pass (reversed depth).
    #[must_use]
    pub fn new(
        gpu: &Gpu,
        shader: &'static str,
        flags: &[Flag],
        color: wgpu::TextureFormat,
        depth: Option<wgpu::TextureFormat>,
    ) -> Self {
        let (label, source) = (last_part(shader), Source::Embedded(shader));
        let make = || Self::build(gpu, label, &source, flags, (color, depth));
        let targets = format!("{color:?} {depth:?}");
        cached(gpu, &gpu.pipelines.raster, (label, &source, flags), &targets, |p| Arc::clone(&p.functions), make)
    }

    fn build(
        gpu: &Gpu,
        label: &'static str,
        shader: &Source,
        flags: &[Flag],
        (color, depth): (wgpu::TextureFormat, Option<wgpu::TextureFormat>),
    ) -> Self {
        let Linked { module, slots, functions, .. } = load(gpu, label, shader, flags);
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
                    write_mask: wgpu::ColorWrites::ALL,
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
