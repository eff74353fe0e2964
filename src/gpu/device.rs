//! The adapter, the device and their capabilities.

use std::sync::{Arc, Mutex};

#[cfg(not(target_family = "wasm"))]
use super::compilers::Compilers;
use super::pipelines::Pipelines;
use super::{Compilation, Flag, Ledger, NonFinite, Timings};

/// Errors of opening a device, and of the device itself.
#[derive(Clone, Debug, thiserror::Error)]
pub enum GpuError {
    /// No adapter was found; the message names the driver to install, or the browser to use.
    #[cfg_attr(
        not(target_family = "wasm"),
        error(
            "no Vulkan, Metal or Direct3D 12 device was found: {0}; run scripts/setup.sh, which installs Mesa's software \
             driver, or use --method reference"
        )
    )]
    #[cfg_attr(
        target_family = "wasm",
        error("the browser offers no WebGPU device: {0}; use one that has WebGPU, and let it use the graphics device")
    )]
    NoAdapter(String),
    /// The adapter refused a device.
    #[error("the adapter {adapter} refuses a device: {cause}")]
    NoDevice {
        /// The adapter's name.
        adapter: String,
        /// The driver's message.
        cause: String,
    },
    /// The adapter has no ray queries.
    #[error(
        "the adapter {adapter} has no ray queries (the feature {feature} is missing); use --method raster, which needs none"
    )]
    NoRayQueries {
        /// The adapter's name and driver.
        adapter: String,
        /// The missing feature by wgpu's name.
        feature: String,
    },
    /// A validation, memory or driver error during work.
    #[error("the graphics device reported: {0}")]
    Device(String),
    /// The device was lost. What it held is gone; a new one can be opened.
    #[error("the graphics device was lost: {0}; restart the render, with --checkpoint and --resume nothing is lost")]
    Lost(String),
}

/// The interfaces through which devices are looked for.
#[cfg(not(target_family = "wasm"))]
const BACKENDS: wgpu::Backends = wgpu::Backends::VULKAN.union(wgpu::Backends::METAL).union(wgpu::Backends::DX12);
#[cfg(target_family = "wasm")]
const BACKENDS: wgpu::Backends = wgpu::Backends::BROWSER_WEBGPU;

/// The adapter features that ray-query methods need.
const RAY_QUERIES: wgpu::Features = wgpu::Features::EXPERIMENTAL_RAY_QUERY;

/// Returns the token by which wgpu enables an interface that is not yet final.
#[expect(
    unsafe_code,
    reason = "wgpu enables ray queries only through this unsafe call, since its own code for them may be unsound"
)]
fn ray_query_token() -> wgpu::ExperimentalFeatures {
    // SAFETY: the contract only requires that the caller knows this and reports errors.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}

/// How a device is opened.
#[derive(Default)]
struct Opening {
    /// With ray queries.
    ray_queries: bool,
    /// With the driver's validation layers.
    validated: bool,
    /// With WebGPU's limits and without its optional features.
    webgpu_limits: bool,
}

/// Optional features and limits of the adapter.
#[derive(Clone, Debug)]
pub struct Capabilities {
    /// Adapter name and driver.
    pub adapter: String,
    /// True if the driver runs on the CPU.
    pub software: bool,
    /// True if the driver compiles a shader when it first runs, and keeps it on disk, as Mesa's software driver does.
    pub compiles_late: bool,
    /// True if passes can be timed.
    pub timestamps: bool,
    /// True if the device was opened with ray queries.
    pub ray_queries: bool,
    /// Largest storage buffer that can be bound whole, in bytes.
    pub max_storage_bytes: u64,
    /// Largest side of a 2-D texture, in texels.
    pub max_texture_side: u32,
    /// Most layers of a texture array.
    pub max_texture_layers: u32,
}

impl Capabilities {
    /// Returns the flags of every shader.
    #[must_use]
    pub fn flags(&self) -> &'static [Flag] {
        // Mesa's driver copies a load from a buffer for each of eight threads, with branches, and its compiler's time grows
        // with the square of their number. A texel is one call.
        if self.compiles_late { &[Flag::TexelTables] } else { &[] }
    }
}

/// A device with its queue.
pub struct Gpu {
    /// The device, which creates resources.
    pub device: wgpu::Device,
    /// The queue, which runs commands.
    pub queue: wgpu::Queue,
    /// Features and limits of the adapter.
    pub capabilities: Capabilities,
    /// Device time per pass.
    pub timings: Timings,
    /// Time that the driver took to compile shaders when they first ran.
    pub compilation: Compilation,
    /// Counts of all requests to the device.
    pub ledger: Ledger,
    /// Counts of values that are not finite, by pass.
    pub non_finite: NonFinite,
    pub(super) pipelines: Pipelines,
    #[cfg(not(target_family = "wasm"))]
    pub(super) compilers: Option<Compilers>,
    first_error: Arc<Mutex<Option<GpuError>>>,
}

impl Gpu {
    /// Opens the best adapter, without ray queries. The environment variables WGPU_BACKEND and
    /// WGPU_ADAPTER_NAME choose another one.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] if there is no adapter, [`GpuError::NoDevice`] if it refuses a device.
    pub async fn new_async() -> Result<Self, GpuError> {
        Self::open(&Opening::default()).await
    }

    /// Waits for [`Self::new_async`].
    ///
    /// # Errors
    /// As [`Self::new_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn new() -> Result<Self, GpuError> {
        pollster::block_on(Self::new_async())
    }

    /// Opens the best adapter with the limits that WebGPU guarantees and without optional features, as a browser
    /// may have it.
    ///
    /// # Errors
    /// As [`Self::new_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn with_webgpu_limits() -> Result<Self, GpuError> {
        pollster::block_on(Self::open(&Opening { webgpu_limits: true, ..Opening::default() }))
    }

    /// Opens the best adapter with ray queries.
    ///
    /// # Errors
    /// [`GpuError::NoRayQueries`] if the adapter has none; otherwise as [`Self::new_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn with_ray_queries() -> Result<Self, GpuError> {
        pollster::block_on(Self::open(&Opening { ray_queries: true, ..Opening::default() }))
    }

    /// Opens the best adapter with the driver's validation layers, if these are installed. `wgpu_hal` logs
    /// their messages.
    ///
    /// # Errors
    /// As [`Self::new_async`] or [`Self::with_ray_queries`].
    #[cfg(not(target_family = "wasm"))]
    pub fn validated(ray_queries: bool) -> Result<Self, GpuError> {
        pollster::block_on(Self::open(&Opening { ray_queries, validated: true, ..Opening::default() }))
    }

    async fn open(opening: &Opening) -> Result<Self, GpuError> {
        let &Opening { ray_queries, validated, webgpu_limits } = opening;
        let descriptor =
            wgpu::InstanceDescriptor { backends: BACKENDS, ..wgpu::InstanceDescriptor::new_without_display_handle() };
        let mut descriptor = descriptor.with_env();
        if validated {
            descriptor.flags |= wgpu::InstanceFlags::VALIDATION;
        }
        let instance = wgpu::Instance::new(descriptor);
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter = instance.request_adapter(&options).await.map_err(|e| GpuError::NoAdapter(e.to_string()))?;
        let info = adapter.get_info();
        // Browsers may keep the name to themselves.
        let name = match info.name.as_str() {
            "" => "WebGPU".to_owned(),
            name => format!("{name} ({})", info.driver_info),
        };
        let limits = if webgpu_limits { wgpu::Limits::default() } else { adapter.limits() };
        let optional = if webgpu_limits { wgpu::Features::empty() } else { wgpu::Features::TIMESTAMP_QUERY };
        let mut features = adapter.features() & optional;
        if ray_queries {
            let missing = RAY_QUERIES - adapter.features();
            if !missing.is_empty() {
                let feature = missing.iter_names().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
                return Err(GpuError::NoRayQueries { adapter: name, feature });
            }
            features |= RAY_QUERIES;
        }
        let experimental_features =
            if ray_queries { ray_query_token() } else { wgpu::ExperimentalFeatures::disabled() };
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("lightsheaf"),
            required_features: features,
            required_limits: limits.clone(),
            experimental_features,
            ..Default::default()
        };
        let (device, queue) = adapter
            .request_device(&descriptor)
            .await
            .map_err(|e| GpuError::NoDevice { adapter: info.name.clone(), cause: e.to_string() })?;
        let first_error = Arc::new(Mutex::new(None));
        let sink = Arc::clone(&first_error);
        device.set_device_lost_callback(move |reason, message| {
            // A lost device causes all later errors, so this one replaces them.
            if let Ok(mut first) = sink.lock() {
                *first = Some(GpuError::Lost(format!("{reason:?}, {message}")));
            }
        });
        let sink = Arc::clone(&first_error);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            log::error!("graphics device: {error}");
            if let Ok(mut first) = sink.lock() {
                first.get_or_insert_with(|| GpuError::Device(error.to_string()));
            }
        }));
        let compiles_late = info.driver == "llvmpipe";
        let timestamps = features.contains(wgpu::Features::TIMESTAMP_QUERY);
        let ledger = Ledger::default();
        let timings = Timings::new(&device, &queue, timestamps);
        Ok(Self {
            capabilities: Capabilities {
                adapter: name,
                software: info.device_type == wgpu::DeviceType::Cpu,
                compiles_late,
                timestamps,
                ray_queries,
                max_storage_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
                max_texture_side: limits.max_texture_dimension_2d,
                max_texture_layers: limits.max_texture_array_layers,
            },
            device,
            queue,
            timings,
            compilation: Compilation::default(),
            ledger,
            non_finite: NonFinite::default(),
            pipelines: Pipelines::default(),
            #[cfg(not(target_family = "wasm"))]
            compilers: compiles_late.then(|| Compilers::new(adapter, descriptor)),
            first_error,
        })
    }

    /// Checks that the device has reported no error since it was opened.
    ///
    /// # Errors
    /// [`GpuError::Lost`] if the device is lost, otherwise [`GpuError::Device`] with the first error.
    pub fn check(&self) -> Result<(), GpuError> {
        match self.first_error.lock().ok().and_then(|e| e.clone()) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Creates a buffer and counts it in the ledger.
    #[must_use]
    pub fn buffer(&self, descriptor: &wgpu::BufferDescriptor) -> wgpu::Buffer {
        self.ledger.buffer(&self.device, descriptor)
    }

    /// Creates a texture and counts it in the ledger.
    #[must_use]
    pub fn texture(&self, descriptor: &wgpu::TextureDescriptor) -> wgpu::Texture {
        self.ledger.texture(&self.device, descriptor)
    }

    /// Creates a bottom-level acceleration structure and counts it in the ledger. The device must have ray
    /// queries.
    #[must_use]
    pub fn blas(
        &self,
        descriptor: &wgpu::CreateBlasDescriptor,
        sizes: wgpu::BlasGeometrySizeDescriptors,
    ) -> wgpu::Blas {
        self.ledger.acceleration_structure(descriptor.label);
        self.device.create_blas(descriptor, sizes)
    }

    /// Creates a top-level acceleration structure and counts it in the ledger. The device must have ray
    /// queries.
    #[must_use]
    pub fn tlas(&self, descriptor: &wgpu::CreateTlasDescriptor) -> wgpu::Tlas {
        self.ledger.acceleration_structure(descriptor.label);
        self.device.create_tlas(descriptor)
    }

    /// Creates a zeroed storage buffer of at least 16 bytes, which may also be bound as a uniform. Data that
    /// all threads read alike is bound as a uniform, since software Vulkan gathers from storage buffers
    /// thread by thread.
    #[must_use]
    pub fn storage(&self, label: &str, bytes: u64) -> wgpu::Buffer {
        self.buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.next_multiple_of(16).max(16),
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::UNIFORM
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// Creates a storage buffer with the given contents.
    #[must_use]
    pub fn upload<T: bytemuck::NoUninit>(&self, label: &str, data: &[T]) -> wgpu::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.storage(label, bytes.len() as u64);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Creates a buffer with the given contents that acceleration structures can be built from. The device
    /// must have ray queries.
    #[must_use]
    pub fn upload_for_building<T: bytemuck::NoUninit>(
        &self,
        label: &str,
        data: &[T],
        more: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: (bytes.len() as u64).next_multiple_of(16).max(16),
            usage: wgpu::BufferUsages::BLAS_INPUT | wgpu::BufferUsages::COPY_DST | more,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Creates a render target: a 2-D texture of one mip level.
    #[must_use]
    pub fn target(
        &self,
        label: &str,
        [width, height]: [u32; 2],
        format: wgpu::TextureFormat,
        more: wgpu::TextureUsages,
    ) -> wgpu::TextureView {
        self.texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | more,
            view_formats: &[],
        })
        .create_view(&Default::default())
    }

    /// Creates a uniform buffer for a `T`.
    #[must_use]
    pub fn uniform<T: bytemuck::NoUninit>(&self, label: &str) -> wgpu::Buffer {
        self.buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: (size_of::<T>() as u64).next_multiple_of(16),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }
}
