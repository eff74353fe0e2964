//! The adapter, the device, and what they can do.

use std::sync::{Arc, Mutex};

use super::pass::Pipelines;
use super::{Ledger, NonFinite, Timings};

/// Why no device could be had, or what it said.
#[derive(Clone, Debug, thiserror::Error)]
pub enum GpuError {
    /// No adapter, with what to install.
    #[error(
        "no Vulkan, Metal or Direct3D 12 device was found: {0}; run scripts/setup.sh, which installs Mesa's software driver, \
         or use --method reference"
    )]
    NoAdapter(String),
    /// The adapter refused a device.
    #[error("the adapter {adapter} gave no device: {cause}")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// What it said.
        cause: String,
    },
    /// The adapter has no ray queries.
    #[error(
        "the adapter {adapter} has no ray queries (the feature {feature} is missing); use --method raster, which needs none"
    )]
    NoRayQueries {
        /// Its name and driver.
        adapter: String,
        /// What it lacks, as wgpu calls it.
        feature: String,
    },
    /// A validation, memory or driver error during work.
    #[error("the graphics device reported: {0}")]
    Device(String),
}

/// What ray-query methods need of an adapter.
const RAY_QUERIES: wgpu::Features = wgpu::Features::EXPERIMENTAL_RAY_QUERY;

/// wgpu's consent to an interface that is not yet final.
#[expect(
    unsafe_code,
    reason = "wgpu offers ray queries only to those who sign that its own code may still be unsound; ours adds nothing to it"
)]
fn ray_query_token() -> wgpu::ExperimentalFeatures {
    // SAFETY: the contract asks for knowledge of this and for reports of errors found.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}

/// What the adapter offers beyond what every adapter has.
#[derive(Clone, Debug)]
pub struct Capabilities {
    /// Adapter name and driver.
    pub adapter: String,
    /// Whether it is a software driver.
    pub software: bool,
    /// Whether passes can be timed.
    pub timestamps: bool,
    /// Whether the device was opened with ray queries.
    pub ray_queries: bool,
    /// Largest storage buffer that can be bound whole, in bytes.
    pub max_storage_bytes: u64,
    /// Largest side of a 2-D texture in texels.
    pub max_texture_side: u32,
    /// Most layers of a texture array.
    pub max_texture_layers: u32,
}

/// A device with its queue.
pub struct Gpu {
    /// Creates things.
    pub device: wgpu::Device,
    /// Runs things.
    pub queue: wgpu::Queue,
    /// What it can do.
    pub capabilities: Capabilities,
    /// Time per pass.
    pub timings: Timings,
    /// What the device was asked for.
    pub ledger: Ledger,
    /// Where values that are not finite come from.
    pub non_finite: NonFinite,
    pub(super) pipelines: Pipelines,
    first_error: Arc<Mutex<Option<String>>>,
}

impl Gpu {
    /// Opens the best adapter (environment variables of wgpu choose another: WGPU_BACKEND, WGPU_ADAPTER_NAME), asking for no
    /// ray-tracing feature.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] or [`GpuError::NoDevice`].
    pub fn new() -> Result<Self, GpuError> {
        Self::open(false, false)
    }

    /// The same, with ray queries.
    ///
    /// # Errors
    /// [`GpuError::NoRayQueries`] where the adapter has none; otherwise as [`Self::new`].
    pub fn with_ray_queries() -> Result<Self, GpuError> {
        Self::open(true, false)
    }

    /// Either of the two, with the driver's validation layers where they are installed; what they say is logged by `wgpu_hal`.
    ///
    /// # Errors
    /// As [`Self::new`] or [`Self::with_ray_queries`].
    pub fn validated(ray_queries: bool) -> Result<Self, GpuError> {
        Self::open(ray_queries, true)
    }

    fn open(ray_queries: bool, validated: bool) -> Result<Self, GpuError> {
        let descriptor = wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        };
        let mut descriptor = descriptor.with_env();
        if validated {
            descriptor.flags |= wgpu::InstanceFlags::VALIDATION;
        }
        let instance = wgpu::Instance::new(descriptor);
        let options = wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        };
        let adapter =
            pollster::block_on(instance.request_adapter(&options)).map_err(|e| GpuError::NoAdapter(e.to_string()))?;
        let info = adapter.get_info();
        let name = format!("{} ({})", info.name, info.driver_info);
        let limits = adapter.limits();
        let mut features = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
        if ray_queries {
            let missing = RAY_QUERIES - adapter.features();
            if !missing.is_empty() {
                let feature = missing.iter_names().map(|(name, _)| name).collect::<Vec<_>>().join(", ");
                return Err(GpuError::NoRayQueries { adapter: name, feature });
            }
            features |= RAY_QUERIES;
        }
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("lightsheaf"),
            required_features: features,
            required_limits: limits.clone(),
            experimental_features: if ray_queries { ray_query_token() } else { wgpu::ExperimentalFeatures::disabled() },
            ..Default::default()
        }))
        .map_err(|e| GpuError::NoDevice { adapter: info.name.clone(), cause: e.to_string() })?;
        let first_error = Arc::new(Mutex::new(None));
        let sink = Arc::clone(&first_error);
        device.set_device_lost_callback(move |reason, message| {
            // Whatever else it reports comes from this.
            if let Ok(mut first) = sink.lock() {
                *first = Some(format!("it was lost ({reason:?}): {message}"));
            }
        });
        let sink = Arc::clone(&first_error);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            log::error!("graphics device: {error}");
            if let Ok(mut first) = sink.lock() {
                first.get_or_insert_with(|| error.to_string());
            }
        }));
        let timestamps = features.contains(wgpu::Features::TIMESTAMP_QUERY);
        let ledger = Ledger::default();
        let timings = Timings::new(&device, &queue, &ledger, timestamps);
        Ok(Self {
            capabilities: Capabilities {
                adapter: name,
                software: info.device_type == wgpu::DeviceType::Cpu,
                timestamps,
                ray_queries,
                max_storage_bytes: limits.max_storage_buffer_binding_size.min(limits.max_buffer_size),
                max_texture_side: limits.max_texture_dimension_2d,
                max_texture_layers: limits.max_texture_array_layers,
            },
            device,
            queue,
            timings,
            ledger,
            non_finite: NonFinite::default(),
            pipelines: Pipelines::default(),
            first_error,
        })
    }

    /// The first error that the device reported since it was opened, if any.
    ///
    /// # Errors
    /// [`GpuError::Device`].
    pub fn check(&self) -> Result<(), GpuError> {
        match self.first_error.lock().ok().and_then(|e| e.clone()) {
            Some(message) => Err(GpuError::Device(message)),
            None => Ok(()),
        }
    }

    /// A buffer, entered in the ledger.
    #[must_use]
    pub fn buffer(&self, descriptor: &wgpu::BufferDescriptor) -> wgpu::Buffer {
        self.ledger.buffer(&self.device, descriptor)
    }

    /// A texture, entered in the ledger.
    #[must_use]
    pub fn texture(&self, descriptor: &wgpu::TextureDescriptor) -> wgpu::Texture {
        self.ledger.texture(&self.device, descriptor)
    }

    /// The lower level of an acceleration structure, entered in the ledger. The device must have ray queries.
    #[must_use]
    pub fn blas(
        &self,
        descriptor: &wgpu::CreateBlasDescriptor,
        sizes: wgpu::BlasGeometrySizeDescriptors,
    ) -> wgpu::Blas {
        self.ledger.acceleration_structure(descriptor.label);
        self.device.create_blas(descriptor, sizes)
    }

    /// The upper level of an acceleration structure, entered in the ledger. The device must have ray queries.
    #[must_use]
    pub fn tlas(&self, descriptor: &wgpu::CreateTlasDescriptor) -> wgpu::Tlas {
        self.ledger.acceleration_structure(descriptor.label);
        self.device.create_tlas(descriptor)
    }

    /// A buffer that shaders read and write, zeroed; at least 16 bytes. What all threads read alike
    /// they bind as a uniform: software Vulkan gathers from storage thread by thread.
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

    /// A storage buffer with contents.
    #[must_use]
    pub fn upload<T: bytemuck::NoUninit>(&self, label: &str, data: &[T]) -> wgpu::Buffer {
        let bytes: &[u8] = bytemuck::cast_slice(data);
        let buffer = self.storage(label, bytes.len() as u64);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// A buffer with contents that acceleration structures can be built from. The device must have ray queries.
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

    /// What a raster pass draws into: a 2-D texture of one level.
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

    /// A uniform buffer for a `T`.
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
