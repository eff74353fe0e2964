//! A thin layer over wgpu, independent of light transport: device, shader linking, pipelines with bindings by
//! name, read-back, pass timings, counts of all requests to wgpu, and detection of values that are not
//! finite.
//!
//! A function whose name ends in `_async` has a twin without this ending that waits for it. A browser has the former
//! only, since no page may wait.

mod compilation;
#[cfg(not(target_family = "wasm"))]
mod compilers;
mod device;
mod flags;
mod ledger;
mod non_finite;
mod pass;
mod pipelines;
mod readback;
mod shaders;
mod timing;

pub use compilation::{Compilation, Listener};
pub use device::{Capabilities, Gpu, GpuError};
pub use flags::{Flag, flag_names};
pub use ledger::{Allocated, Counts, Ledger, Recorded};
pub use non_finite::NonFinite;
pub use pass::{Binding, Bindings, Compute, Raster, RasterTargets, rows};
#[cfg(not(target_family = "wasm"))]
pub use readback::read_back;
pub use readback::read_back_async;
pub use shaders::{Source, link, link_source, module_names};
pub use timing::{PassTime, Timings};
