//! What tests that need a GPU share.

use std::sync::OnceLock;

use lightsheaf::gpu::Gpu;

/// The device, opened once; or nothing, with a note that the test is skipped.
///
/// # Panics
/// Where no device is found and REQUIRE_GPU=1 says that there has to be one.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    let gpu = GPU.get_or_init(|| match Gpu::new() {
        Ok(gpu) => Some(gpu),
        Err(e) if std::env::var("REQUIRE_GPU").is_ok_and(|v| v == "1") => panic!("REQUIRE_GPU=1, but {e}"),
        Err(e) => {
            println!("skipped: {e}");
            None
        }
    });
    gpu.as_ref()
}
