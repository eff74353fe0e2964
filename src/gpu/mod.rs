//! A thin layer over wgpu that knows nothing of light: device, linked shaders, pipelines whose bindings go by name, read-back,
//! pass timings, a ledger of what wgpu was asked for, and a look-out for values that are not finite.

mod device;
mod ledger;
mod non_finite;
mod pass;
mod readback;
mod shaders;
mod timing;

pub use device::{Capabilities, Gpu, GpuError};
pub use ledger::{Allocated, Counts, Ledger, Recorded};
pub use non_finite::NonFinite;
pub use pass::{Bindings, Compute, Raster, RasterTargets, rows};
pub use readback::read_back;
pub use shaders::{Flags, link, module_names};
pub use timing::{PassTime, Timings};
