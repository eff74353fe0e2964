//! A thin layer over wgpu that knows nothing of light: device, linked shaders, pipelines whose bindings go by name, read-back
//! and pass timings.

mod device;
mod pass;
mod readback;
mod shaders;
mod timing;

pub use device::{Capabilities, Gpu, GpuError};
pub use pass::{Bindings, Compute, Raster, RasterTargets};
pub use readback::read_back;
pub use shaders::{Flags, link, module_names};
pub use timing::{PassTime, Timings};
