//! What a render tells about itself: the file of `--stats`, and numbers of the closing line.

use std::collections::BTreeMap;

use super::frames::Frame;
use crate::gpu::{Gpu, PassTime};
use crate::render::renderer::ViewRequests;
use crate::settings::Settings;
use crate::tonemap::Tonemap;

/// Reason for the end of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Ending {
    Samples,
    TargetError,
    Budget,
    Interrupt,
}

/// Contents of the file of `--stats`.
#[derive(serde::Serialize)]
pub(super) struct Stats<'a> {
    pub(super) version: &'static str,
    pub(super) scene: &'a str,
    pub(super) device: String,
    pub(super) method: String,
    pub(super) size: [u32; 2],
    /// Number of samples in the picture.
    pub(super) samples: u64,
    /// Exposure of a .png in stops, also if it was chosen by `--exposure auto`.
    pub(super) exposure_stops: Option<f32>,
    /// Tone curve of a .png.
    pub(super) tonemap: Option<Tonemap>,
    pub(super) ended_by: Ending,
    /// Estimated rel_mse of the picture, with `--target-error` and by default.
    pub(super) estimated_error: Option<f64>,
    /// With `--target-error`: share of the samples of all pixels that was taken. Converged tiles take no more
    /// samples.
    pub(super) taken: Option<f64>,
    pub(super) seconds: Seconds,
    /// Device time and number of runs of each pass, in all frames and cameras so far.
    pub(super) passes: BTreeMap<&'static str, PassTime>,
    /// Bytes on the device without the scene.
    pub(super) bytes: u64,
    pub(super) scene_bytes: u64,
    pub(super) non_finite: u64,
    /// With `--check-values`: number of non-finite values after each pass, in the order of first execution.
    pub(super) non_finite_after: Vec<(&'static str, u64)>,
    pub(super) lost_nodes: u64,
    /// Number of iterations that were repeated with a larger list capacity.
    pub(super) redone: u64,
    /// Largest list requests of each view.
    pub(super) requests: Vec<ViewRequests>,
    /// Number of rays that the reference traced.
    pub(super) rays: u64,
    pub(super) plan: Option<serde_json::Value>,
    /// Frame, with `--frames` and `--turntable`.
    pub(super) frame: Option<Frame>,
    /// Index, name and length of each animation of the file.
    pub(super) animations: &'a [String],
    pub(super) warnings: &'a [String],
    /// Notes about camera and light that were added to the scene.
    pub(super) notes: &'a [String],
    pub(super) settings: &'a Settings,
}

#[derive(Clone, Copy, Default, serde::Serialize)]
pub(super) struct Seconds {
    pub(super) load: f64,
    /// Time for opening the device, uploading the scene and building pipelines; of the reference, for
    /// building the BVH.
    pub(super) setup: f64,
    /// Time in which a software driver compiled shaders, when they first ran. It is in neither of the others.
    pub(super) compile: f64,
    pub(super) render: f64,
}

/// Returns the name of the device of a render.
pub(super) fn device_name(gpu: Option<&Gpu>) -> String {
    let cpu = || format!("CPU, {} threads", rayon::current_num_threads());
    gpu.map_or_else(cpu, |gpu| gpu.capabilities.adapter.clone())
}

/// Formats a number with two significant digits: 0.0028.
pub(super) fn two_digits(value: f64) -> String {
    if !value.is_finite() || value <= 0.0 {
        return value.to_string();
    }
    let places = (1 - value.log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.places$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_two_digits() {
        for (value, text) in [(0.002_84, "0.0028"), (0.012, "0.012"), (1.0, "1.0"), (34.56, "35"), (0.0, "0")] {
            assert_eq!(two_digits(value), text);
        }
    }
}
