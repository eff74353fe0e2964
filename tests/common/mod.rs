//! What several tests need: the device, and the files beside the repository.
#![allow(dead_code, reason = "each test uses its share")]

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use lightsheaf::gpu::Gpu;

/// The device, opened once per test binary. Without one, says so and gives none; where `REQUIRE_GPU` is 1, fails instead.
pub fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| match Gpu::new() {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "REQUIRE_GPU is 1, but {error}");
            println!("skipped: no Vulkan device ({error})");
            None
        }
    })
    .as_ref()
}

/// The folder of scenes and reference images beside the repository. Without it, says so and gives none.
pub fn shared() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: {} is not there", path.display());
    None
}
