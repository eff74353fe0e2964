//! Devices beside that of a renderer, on which threads have a software driver compile shaders.
//!
//! Mesa's driver compiles a shader when it first runs, in the one thread of a device's queue, and keeps it on disk for all
//! devices. So shaders that it has not got yet first run on several devices at once, without workgroups and with
//! resources of least size.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::thread;
use std::time::{Duration, Instant};

use naga::{AddressSpace, ImageClass, ImageDimension, ScalarKind, TypeInner};

use super::compilation::Compilation;
use super::pipelines::Create;

/// A driver that has a shader is done with it sooner.
const KNOWN: Duration = Duration::from_millis(100);

/// A shader that may have to be compiled.
pub(super) struct Uncompiled<'a> {
    pub(super) label: &'static str,
    pub(super) shader: naga::Module,
    pub(super) create: &'a Create<wgpu::ComputePipeline>,
}

impl Uncompiled<'_> {
    /// True if there are resources of least size for all that it declares.
    pub(super) fn has_resources(&self) -> bool {
        let is_structure = |variable: &naga::GlobalVariable| {
            matches!(self.shader.types[variable.ty].inner, TypeInner::AccelerationStructure { .. })
        };
        !self.shader.global_variables.iter().any(|(_, variable)| is_structure(variable))
    }

    /// Returns a measure of the time that it takes to compile.
    fn size(&self) -> usize {
        self.shader.functions.iter().map(|(_, function)| function.expressions.len()).sum()
    }
}

/// Devices that compile shaders.
pub(super) struct Compilers {
    adapter: wgpu::Adapter,
    descriptor: wgpu::DeviceDescriptor<'static>,
}

impl Compilers {
    /// Opens devices like this one when they are needed.
    pub(super) fn new(adapter: wgpu::Adapter, descriptor: wgpu::DeviceDescriptor<'static>) -> Self {
        Self { adapter, descriptor }
    }

    /// Compiles shaders on all threads, unless the driver has the largest of them. Whatever fails is left to the renderer's
    /// device.
    pub(super) fn compile(&self, mut shaders: Vec<Uncompiled>, compilation: &Compilation) {
        shaders.sort_by_key(|shader| std::cmp::Reverse(shader.size()));
        let Some((largest, others)) = shaders.split_first() else { return };
        let threads = thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let (began, next) = (Instant::now(), AtomicUsize::new(0));
        let compile_others = || {
            let device = self.open();
            while let Some(shader) = others.get(next.fetch_add(1, Ordering::Relaxed)) {
                compilation.begin(shader.label);
                compile_on(&device, shader, || ());
            }
        };
        thread::scope(|scope| {
            let (event, events) = channel();
            let tell = move || event.send(()).unwrap_or_default();
            scope.spawn(move || {
                compile_on(&self.open(), largest, &tell);
                tell();
            });
            // The thread tells before the shader runs, and when it has run; nothing if it cannot.
            let _ = events.recv();
            if events.recv_timeout(KNOWN).is_ok() {
                return;
            }
            compilation.begin(largest.label);
            (1..threads).for_each(|_| drop(scope.spawn(compile_others)));
            let _ = events.recv();
            compile_others();
            compilation.end("all shaders", began.elapsed());
        });
    }

    fn open(&self) -> Device {
        let opened = pollster::block_on(self.adapter.request_device(&self.descriptor)).ok();
        if let Some((device, _)) = &opened {
            device.on_uncaptured_error(std::sync::Arc::new(|error| log::debug!("a shader is compiled later: {error}")));
        }
        opened
    }
}

/// A device, if one could be opened.
type Device = Option<(wgpu::Device, wgpu::Queue)>;

/// Compiles a shader, and tells before it runs.
fn compile_on(device: &Device, shader: &Uncompiled, tell: impl FnOnce()) {
    let Some((device, queue)) = device else { return };
    let source = wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(shader.shader.clone()));
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = (shader.create)(device, &module);
    if let Some(groups) = bind_groups(device, &shader.shader, &pipeline) {
        tell();
        run_nothing(device, queue, &pipeline, &groups);
    }
}

/// Runs a pipeline without workgroups, and waits for it.
pub(super) fn run_nothing(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    pipeline: &wgpu::ComputePipeline,
    groups: &[wgpu::BindGroup],
) {
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(pipeline);
    for (group, bound) in (0..).zip(groups) {
        pass.set_bind_group(group, bound, &[]);
    }
    pass.dispatch_workgroups(0, 0, 0);
    drop(pass);
    queue.submit([encoder.finish()]);
    // Errors are those of the device.
    let _ = device.poll(wgpu::PollType::wait_indefinitely());
}

/// A resource of least size.
enum Resource {
    Buffer(wgpu::Buffer),
    Texture(wgpu::TextureView),
    Sampler(wgpu::Sampler),
}

/// Binds resources of least size to all that a shader declares. None if it declares what has no such resource.
fn bind_groups(
    device: &wgpu::Device,
    shader: &naga::Module,
    pipeline: &wgpu::ComputePipeline,
) -> Option<Vec<wgpu::BindGroup>> {
    let bound = shader.global_variables.iter().filter_map(|(_, variable)| Some((variable, variable.binding?)));
    let resources = bound
        .map(|(variable, binding)| Some((binding, resource(device, shader, variable)?)))
        .collect::<Option<Vec<_>>>()?;
    let groups = resources.iter().map(|(binding, _)| binding.group + 1).max().unwrap_or(0);
    let group = |group| {
        let of_group = resources.iter().filter(|(binding, _)| binding.group == group);
        let entries: Vec<_> = of_group
            .map(|(binding, resource)| wgpu::BindGroupEntry {
                binding: binding.binding,
                resource: match resource {
                    Resource::Buffer(buffer) => buffer.as_entire_binding(),
                    Resource::Texture(view) => wgpu::BindingResource::TextureView(view),
                    Resource::Sampler(sampler) => wgpu::BindingResource::Sampler(sampler),
                },
            })
            .collect();
        let layout = &pipeline.get_bind_group_layout(group);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    };
    Some((0..groups).map(group).collect())
}

fn resource(device: &wgpu::Device, shader: &naga::Module, variable: &naga::GlobalVariable) -> Option<Resource> {
    let inner = &shader.types[variable.ty].inner;
    let buffer = |usage| {
        let size = u64::from(inner.size(shader.to_ctx())).next_multiple_of(16).max(16);
        let descriptor = wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false };
        Some(Resource::Buffer(device.create_buffer(&descriptor)))
    };
    match (variable.space, inner) {
        (AddressSpace::Uniform, _) => buffer(wgpu::BufferUsages::UNIFORM),
        (AddressSpace::Storage { .. }, _) => buffer(wgpu::BufferUsages::STORAGE),
        (AddressSpace::Handle, TypeInner::Sampler { comparison: false }) => {
            Some(Resource::Sampler(device.create_sampler(&Default::default())))
        }
        (AddressSpace::Handle, &TypeInner::Image { dim: ImageDimension::D2, arrayed, class }) => {
            let format = match class {
                ImageClass::Sampled { kind: ScalarKind::Float, multi: false } => wgpu::TextureFormat::Rgba8Unorm,
                ImageClass::Sampled { kind: ScalarKind::Uint, multi: false } => wgpu::TextureFormat::R32Uint,
                _ => return None,
            };
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d::default(),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            let dimension = if arrayed { wgpu::TextureViewDimension::D2Array } else { wgpu::TextureViewDimension::D2 };
            let descriptor = wgpu::TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
            Some(Resource::Texture(texture.create_view(&descriptor)))
        }
        _ => None,
    }
}
