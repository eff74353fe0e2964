//! A thin layer over wgpu that knows nothing of light: device, linked shaders, pipelines whose bindings go by name, read-back,
//! pass timings, and a ledger of what wgpu was asked for.

mod device;
mod ledger;
mod pass;
mod readback;
mod shaders;
mod timing;

pub use device::{Capabilities, Gpu, GpuError};
pub use ledger::{Allocated, Counts, Ledger, Recorded};
pub use pass::{Bindings, Compute, Raster, RasterTargets};
pub use readback::read_back;
pub use shaders::{Flags, link, module_names};
pub use timing::{PassTime, Timings};
