//! The pipelines of a device, each built once: shaders are linked and compiled on all threads, while whoever asked
//! for them goes on. A browser has no threads, and compiles by itself in the background.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
#[cfg(not(target_family = "wasm"))]
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, RwLock};

#[cfg(not(target_family = "wasm"))]
use super::compilers::Uncompiled;
use super::non_finite::Floats;
use super::shaders::{self, Source};
use super::{Flag, Gpu, flag_names};

/// Group and binding of each name.
pub(super) type Slots = BTreeMap<String, (u32, u32)>;

/// Names of a shader's functions, once it is linked.
pub(super) type Functions = Arc<OnceLock<BTreeSet<String>>>;

/// Pipelines by shader, flags and targets.
type Cache<P> = Mutex<HashMap<String, Arc<Pipeline<P>>>>;

/// Creates a pipeline from a compiled shader.
pub(super) type Create<P> = dyn Fn(&wgpu::Device, &wgpu::ShaderModule) -> P + Send + Sync;

/// The pipelines that were asked for.
#[derive(Default)]
pub(super) struct Pipelines {
    pub(super) compute: Cache<wgpu::ComputePipeline>,
    pub(super) raster: Cache<wgpu::RenderPipeline>,
    /// Folder that linked shaders are written to.
    dump: Mutex<Option<PathBuf>>,
    /// True once the device is dropped. A thread that builds holds it for reading.
    closed: Arc<RwLock<bool>>,
}

impl Gpu {
    /// Writes the linked WGSL of every pipeline that is asked for from now on to a folder, which is created if
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

    /// Waits until every pipeline that was asked for is built, and compiled by drivers that would do so when it first runs.
    /// Errors are those of [`Self::check`].
    pub fn finish_pipelines(&self) {
        let Pipelines { compute, raster, .. } = &self.pipelines;
        #[cfg_attr(target_family = "wasm", expect(unused_variables, reason = "browsers compile what they build"))]
        let compute = finished(compute);
        finished(raster);
        #[cfg(not(target_family = "wasm"))]
        if let Some(compilers) = &self.compilers {
            let uncompiled = compute.iter().filter_map(|pipeline| pipeline.uncompiled()).collect();
            compilers.compile(uncompiled, &self.compilation);
        }
    }
}

impl Drop for Pipelines {
    /// Waits for threads that build. Those that have not begun find their pipelines gone.
    fn drop(&mut self) {
        if let Ok(mut closed) = self.closed.write() {
            *closed = true;
        }
    }
}

/// Returns the pipelines of a cache, of which it builds those that no thread has begun, and waits for the others.
fn finished<P>(cache: &Cache<P>) -> Vec<Arc<Pipeline<P>>> {
    let pipelines: Vec<_> = cache.lock().map(|all| all.values().cloned().collect()).unwrap_or_default();
    for pipeline in &pipelines {
        pipeline.built();
    }
    pipelines
}

/// Returns the pipeline from the cache, or begins to build it by `create`. The ledger counts either request.
pub(super) fn request<P: wgpu::WasmNotSendSync + 'static>(
    gpu: &Gpu,
    cache: &Cache<P>,
    (label, source, flags): (&'static str, &Source<'static>, &[Flag]),
    create: impl Fn(&wgpu::Device, &wgpu::ShaderModule) -> P + Send + Sync + 'static,
) -> Arc<Pipeline<P>> {
    let flags = &[flags, gpu.capabilities.flags()].concat();
    let sorted: BTreeSet<_> = flags.iter().collect();
    let key = format!("{label} {} {sorted:?}", source.name());
    let found = cache.lock().ok().and_then(|pipelines| pipelines.get(&key).cloned());
    let pipeline = found.unwrap_or_else(|| {
        let pipeline = Arc::new(Pipeline {
            device: gpu.device.clone(),
            source: *source,
            flags: flags.to_vec(),
            dump: dump_file(gpu, label),
            create: Box::new(create),
            functions: Functions::default(),
            built: OnceLock::new(),
            #[cfg(not(target_family = "wasm"))]
            late: gpu.capabilities.compiles_late.then(|| Late {
                label,
                has_run: false.into(),
                elsewhere: false.into(),
            }),
        });
        if let Ok(mut pipelines) = cache.lock() {
            pipelines.insert(key, Arc::clone(&pipeline));
        }
        begin(&pipeline, &gpu.pipelines.closed);
        pipeline
    });
    gpu.ledger.pipeline(label, &pipeline.functions);
    pipeline
}

/// Builds a pipeline on another thread.
#[cfg(not(target_family = "wasm"))]
fn begin<P: Send + Sync + 'static>(pipeline: &Arc<Pipeline<P>>, closed: &Arc<RwLock<bool>>) {
    let (pipeline, closed) = (Arc::downgrade(pipeline), Arc::clone(closed));
    rayon::spawn(move || {
        let Ok(closed) = closed.read() else { return };
        if let Some(pipeline) = pipeline.upgrade().filter(|_| !*closed) {
            // Whoever uses the pipeline builds it again, and has the panic.
            let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                pipeline.built();
            }));
        }
    });
}

/// Builds a pipeline.
#[cfg(target_family = "wasm")]
fn begin<P>(pipeline: &Arc<Pipeline<P>>, _closed: &Arc<RwLock<bool>>) {
    pipeline.built();
}

/// Creates the file of the next pipeline's linked shader, if a folder is set. Names follow the order of requests.
fn dump_file(gpu: &Gpu, label: &str) -> Option<File> {
    let folder = gpu.pipelines.dump.lock().ok()?.clone()?;
    let numbered = |n: usize| if n == 0 { format!("{label}.wgsl") } else { format!("{label}.{n}.wgsl") };
    let path = (0..1000).map(|n| folder.join(numbered(n))).find(|path| !path.exists())?;
    File::create_new(&path).inspect_err(|error| log::warn!("{}: {error}", path.display())).ok()
}

/// A pipeline that is being built, or is built when it is first used.
pub(super) struct Pipeline<P> {
    device: wgpu::Device,
    source: Source<'static>,
    flags: Vec<Flag>,
    dump: Option<File>,
    create: Box<Create<P>>,
    functions: Functions,
    built: OnceLock<Built<P>>,
    #[cfg(not(target_family = "wasm"))]
    late: Option<Late>,
}

/// State of a pipeline that the driver compiles when it first runs.
#[cfg(not(target_family = "wasm"))]
struct Late {
    label: &'static str,
    has_run: AtomicBool,
    /// True if other devices were asked to compile it.
    elsewhere: AtomicBool,
}

/// A pipeline, and naga's reflection of its shader.
pub(super) struct Built<P> {
    pub(super) pipeline: P,
    /// Parsed, until it is compiled by a driver that does so when it first runs.
    #[cfg(not(target_family = "wasm"))]
    shader: Mutex<Option<naga::Module>>,
    pub(super) slots: Slots,
    /// The storage variables that the shader may write and that hold floats.
    pub(super) written: BTreeMap<String, Floats>,
    pub(super) workgroup: [u32; 3],
}

#[cfg(not(target_family = "wasm"))]
impl Pipeline<wgpu::ComputePipeline> {
    /// Returns what other devices can compile, unless the pipeline has run, or this was asked for before.
    fn uncompiled(&self) -> Option<Uncompiled<'_>> {
        let (late, shader) = (self.late.as_ref()?, self.built().shader.lock().ok()?.take()?);
        let uncompiled = Uncompiled { label: late.label, shader, create: &self.create };
        let compiles = !late.has_run.load(Ordering::Relaxed) && uncompiled.has_resources();
        late.elsewhere.store(compiles, Ordering::Relaxed);
        compiles.then_some(uncompiled)
    }
}

impl<P> Pipeline<P> {
    /// Returns the pipeline: builds it, unless a thread has begun to, which is waited for.
    pub(super) fn built(&self) -> &Built<P> {
        self.built.get_or_init(|| self.build())
    }

    /// True when it is asked for the first time, if the driver compiles the pipeline when it first runs.
    #[cfg(not(target_family = "wasm"))]
    pub(super) fn is_first_run(&self) -> bool {
        self.late.as_ref().is_some_and(|late| !late.has_run.swap(true, Ordering::Relaxed))
    }

    /// True if other devices were asked to compile the pipeline, who told of it.
    #[cfg(not(target_family = "wasm"))]
    pub(super) fn was_compiled_elsewhere(&self) -> bool {
        self.late.as_ref().is_some_and(|late| late.elsewhere.load(Ordering::Relaxed))
    }

    #[expect(
        clippy::panic,
        reason = "a shader that does not link or parse is a bug that tests catch, not a condition to handle"
    )]
    /// Links, parses and compiles the shader.
    fn build(&self) -> Built<P> {
        let name = self.source.name();
        let wgsl =
            shaders::link_source(&self.source, &self.flags).unwrap_or_else(|e| panic!("shader does not link: {e}"));
        if let Some(mut file) = self.dump.as_ref()
            && let Err(error) = file.write_all(format!("// {name} with {}\n{wgsl}", flag_names(&self.flags)).as_bytes())
        {
            log::warn!("linked shader {name}: {error}");
        }
        let parsed =
            naga::front::wgsl::parse_str(&wgsl).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&wgsl)));
        self.functions.get_or_init(|| parsed.functions.iter().filter_map(|(_, f)| f.name.clone()).collect());
        let slots = parsed
            .global_variables
            .iter()
            .filter_map(|(_, v)| Some((v.name.clone()?, v.binding.map(|b| (b.group, b.binding))?)))
            .collect();
        let writes = |v: &naga::GlobalVariable| matches!(v.space, naga::AddressSpace::Storage { access } if access.contains(naga::StorageAccess::STORE));
        let written = parsed
            .global_variables
            .iter()
            .filter(|(_, v)| writes(v))
            .filter_map(|(_, v)| Some((v.name.clone()?, Floats::of(&parsed, v.ty)?)))
            .collect();
        let workgroup = parsed.entry_points.first().map_or([1; 3], |e| e.workgroup_size);
        #[cfg(not(target_family = "wasm"))]
        let shader = Mutex::new(self.late.as_ref().map(|_| parsed.clone()));
        let module = self
            .device
            .create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(name), source: source_of(wgsl, parsed) });
        Built {
            pipeline: (self.create)(&self.device, &module),
            #[cfg(not(target_family = "wasm"))]
            shader,
            slots,
            written,
            workgroup,
        }
    }
}

/// Returns what wgpu compiles: the parsed shader, so that it is parsed once.
#[cfg(not(target_family = "wasm"))]
fn source_of(_wgsl: String, parsed: naga::Module) -> wgpu::ShaderSource<'static> {
    wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(parsed))
}

/// Returns what the browser compiles.
#[cfg(target_family = "wasm")]
fn source_of(wgsl: String, _parsed: naga::Module) -> wgpu::ShaderSource<'static> {
    wgpu::ShaderSource::Wgsl(wgsl.into())
}
