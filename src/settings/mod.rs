//! Settings of a render, in one struct that the command line, the viewer and the benchmarks edit.
//!
//! The command line derives its options from [`Settings`]: the doc comment of a field is the help text of its
//! option. [`Settings::check`] checks the ranges.

mod check;
mod choices;

#[cfg(feature = "cli")]
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::crop::Crop;

pub use check::{APERTURES, BETAS, BOUNCES, BUDGETS, FOCUSES, OutOfRange, RESOLUTIONS, SAMPLES, SIDES, TARGETS};
pub use choices::{LightSampling, Method, OnlyStrategy, RestirBias, Strategies, Technique, Visibility, VisibilityFrom};

/// Value of `bounces` for paths of unlimited length, in `path` and the reference.
pub const UNLIMITED: u32 = u32::MAX;

/// Samples per lobe in the paper.
const CLAMP: f32 = 16.0;

/// Samples per lobe of highlights that light other surfaces, where surfaces draw directions of their own. Sponza,
/// 256x256, 4 samples, three seeds: rel_mse 0.0043 without, 0.0007 with 1, 4 or 16 samples; mean -0.8, -1.4 and
/// -1.7 %.
const INDIRECT_CLAMP: f32 = 1.0;

/// Samples per lobe that widen nothing.
const UNCLAMPED: f32 = 1e-12;

/// Side of the squares of interleaved sampling. With none the plan selects it
/// ([`crate::render::shared::plan::FramePlan::interleave`]).
pub type Interleave = Option<u32>;

/// Word of the command line for a value that the plan selects.
#[cfg(feature = "cli")]
const AUTO: &str = "auto";

/// Estimated rel_mse at which a render ends if neither samples nor a budget nor an error are given. At this
/// error little noise is visible.
pub const DEFAULT_TARGET_ERROR: f64 = 0.003;

/// Seconds after which such a render ends at the latest.
pub const DEFAULT_BUDGET: f64 = 300.0;

/// All settings of a render.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Settings {
    /// Estimator and its visibility.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(flatten)]
    pub technique: Technique,
    /// Columns of the image.
    #[cfg_attr(feature = "cli", arg(skip = Self::default().width))]
    pub width: u32,
    /// Rows of the image.
    #[cfg_attr(feature = "cli", arg(skip = Self::default().height))]
    pub height: u32,
    /// Number of samples, 1 to 16777216: iterations of shared, paths per pixel of the other methods [default:
    /// until the estimated rel_mse is 0.003, at most five minutes]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Self::default().samples, hide_default_value = true))]
    pub samples: u32,
    /// Render for this time in seconds, 0.001 to 604800. It counts rendering from the first sample on, not
    /// loading, setup, the compilation of shaders and writing files. The render ends with the batch in which the
    /// time is used up; a batch takes half a second, or one sample that takes longer. Excludes --samples
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "SECONDS", conflicts_with = "samples", allow_negative_numbers = true)
    )]
    pub budget: Option<f64>,
    /// Render until the estimated rel_mse is at most this value, 1e-8 to 1. With --budget, the first of the
    /// two ends the render. Excludes --samples
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "REL_MSE", conflicts_with = "samples", allow_negative_numbers = true)
    )]
    pub target_error: Option<f64>,
    /// Number of indirect bounces, 0 to 64. 0 is direct light only. path and reference also accept
    /// `unlimited`
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_bounces, default_value_t = Self::default().bounces))]
    #[serde(serialize_with = "serialize_bounces")]
    pub bounces: u32,
    /// Number of vertices of a path on glass and perfect mirrors that count as no bounce, 0 to 64. The one before the light
    /// always counts
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Self::default().specular_bounces))]
    pub specular_bounces: u32,
    /// Seed of all random numbers. The same seed, settings, device and driver produce the same pixels
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Self::default().seed))]
    pub seed: u32,
    /// Data structures that answer exact visibility in shared: lists rasterized in every iteration, a grid
    /// rasterized once, or the cheaper of the two for each kind of view. The picture is the same
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Self::default().visibility_from, help_heading = SHARED))]
    pub visibility_from: VisibilityFrom,
    /// Strategies of bidirectional path tracing that contribute
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Self::default().strategies, help_heading = SHARED))]
    pub strategies: Strategies,
    /// Exponent of the MIS heuristic, 0.25 to 4. 1 is the balance heuristic (section 4.2 of the 2012 paper),
    /// 2 the power heuristic [default: 1 for shared, 2 for bdpt and path]
    #[cfg_attr(feature = "cli", arg(long, value_name = "B", allow_negative_numbers = true))]
    pub beta: Option<f32>,
    /// Selection of lights for direct lighting. tree is available in bdpt and path, ris and restir in shared
    /// and path [default: tree in bdpt and path if the scene has more than one local light, otherwise power;
    /// in shared, two to four lights each contribute direct light in every iteration]
    #[cfg_attr(feature = "cli", arg(long, value_enum))]
    pub light_sampling: Option<LightSampling>,
    /// Weights of the light samples that `--light-sampling restir` reuses
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Self::default().restir_bias))]
    pub restir_bias: RestirBias,
    /// Number of samples of a pixel that a reservoir of `--light-sampling restir` represents at most, 0 to
    /// 100. With 0 each sample reuses the previous one only
    #[cfg_attr(feature = "cli", arg(long, value_name = "SAMPLES", default_value_t = Self::default().restir_memory, allow_negative_numbers = true, help_heading = PATH))]
    pub restir_memory: f32,
    /// Single strategy that contributes, for images per strategy.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub only: Option<OnlyStrategy>,
    /// True if `raster` shows list lengths in place of light: the number of list entries that look-ups along
    /// the first bundle visit, averaged over directions.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub list_lengths: bool,
    /// Texels along a side of a ray-bundle, 16 to 2048 [default: chosen from the scene]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = LISTS))]
    pub bundle_resolution: Option<u32>,
    /// Texels along a side of each of the six faces of a light's map, 16 to 2048 [default: chosen from the
    /// scene]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = LISTS))]
    pub light_resolution: Option<u32>,
    /// Texels along a side of each of the six faces of a VPL's map, 16 to 2048 [default: chosen from the
    /// scene]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = LISTS))]
    pub vpl_resolution: Option<u32>,
    /// Distance below which the geometry term of (2, 3) is bounded with `--strategies paper`, as a share of
    /// the scene's diagonal, 0 to 1
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().paper_clamp, allow_negative_numbers = true, help_heading = SHARED))]
    pub paper_clamp: f32,
    /// Samples per lobe of the roughness clamp, 0.01 to 1000 (m' of section 5.2 of the 2012 paper). Lobes
    /// that are too narrow for this number are widened, those that the camera sees included. Smaller values
    /// leave highlights sharper and noisier. Without this, surfaces draw directions of their own where they
    /// can, and only highlights that light other surfaces are widened, for 1 sample; 0 leaves these, too
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = SHARED))]
    pub clamp_samples: Option<f32>,
    /// Number of light points per iteration from which each pixel selects its direct light, 1 to 256
    /// [default: chosen from the scene]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = SHARED))]
    pub light_pool: Option<u32>,
    /// Initial capacity for list nodes as a multiple of the estimate, 0.001 to 16. Lists grow if a scene
    /// needs more
    #[cfg_attr(feature = "cli", arg(long, value_name = "FACTOR", default_value_t = Self::default().list_room, allow_negative_numbers = true, help_heading = LISTS))]
    pub list_room: f32,
    /// Number of pixels per band, 1 to 4194304. Bands are processed one after another. Smaller bands need
    /// less memory, but the maps of a light pool are drawn for each band [default: 1048576; on a software
    /// driver 262144, and 131072 for images of more pixels]
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", allow_negative_numbers = true, help_heading = SHARED))]
    pub band_pixels: Option<u32>,
    /// Interleaved sampling: the N x N pixels of each square have separate light subpaths and bundles, and a
    /// filter combines them. With 1 all pixels share one light subpath. auto selects 1 to 6 by a cost model
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value = AUTO, value_parser = sides_of_squares(), allow_negative_numbers = true, help_heading = FEW_SAMPLES))]
    pub interleave: Interleave,
    /// Omit the filter of --interleave. The result is unbiased, and its noise is a pattern of pixels
    #[cfg_attr(feature = "cli", arg(long, help_heading = FEW_SAMPLES))]
    pub unfiltered: bool,
    /// Number of previous frames over which indirect light is averaged, 0 to 1024. Moving surfaces are
    /// tracked, and light that has changed is rejected
    #[cfg_attr(feature = "cli", arg(long, value_name = "FRAMES", default_value_t = Self::default().history, allow_negative_numbers = true, help_heading = FEW_SAMPLES))]
    pub history: u32,
    /// Compute indirect light for every N-th pixel of every N-th row, 1 to 16, and interpolate it between
    /// similar surfaces
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Self::default().upsample, allow_negative_numbers = true, help_heading = FEW_SAMPLES))]
    pub upsample: u32,
    /// Firefly clamp: outliers of indirect light receive the mean brightness of the pixels around them. Less
    /// noise, but darker
    #[cfg_attr(feature = "cli", arg(long, help_heading = FEW_SAMPLES))]
    pub tame_outliers: bool,
    /// Radius of the thin lens in metres, 0 to 1000. 0 is a pinhole [default: the camera's own]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Camera")
    )]
    pub aperture: Option<f32>,
    /// Distance to the plane of focus along the view direction in metres, 0.001 to 1000000 [default: the
    /// camera's own]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Camera")
    )]
    pub focus: Option<f32>,
    /// Index of the camera in the scene.
    #[cfg_attr(feature = "cli", arg(skip = Self::default().camera))]
    pub camera: usize,
    /// Part of the image that is rendered. Its pixels are those of the whole image.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop: Option<Crop>,
}

/// Heading of the options of the shared estimator.
#[cfg(feature = "cli")]
const SHARED: &str = "Options of shared";

/// Heading of the options of rasterized lists and maps.
#[cfg(feature = "cli")]
const LISTS: &str = "Options of shared with visibility exact or fast";

/// Heading of the options for a good picture of few samples, or of moving frames.
#[cfg(feature = "cli")]
const FEW_SAMPLES: &str = "Options of shared for few samples and animation";

/// Heading of the options of path tracing.
#[cfg(feature = "cli")]
const PATH: &str = "Options of path";

impl Default for Settings {
    fn default() -> Self {
        Self {
            technique: Technique::RASTER,
            width: 512,
            height: 512,
            samples: 64,
            budget: None,
            target_error: None,
            bounces: 2,
            specular_bounces: 8,
            seed: 1,
            visibility_from: VisibilityFrom::Auto,
            strategies: Strategies::All,
            beta: None,
            light_sampling: None,
            restir_bias: RestirBias::Unbiased,
            restir_memory: 0.0,
            only: None,
            list_lengths: false,
            bundle_resolution: None,
            light_resolution: None,
            vpl_resolution: None,
            light_pool: None,
            paper_clamp: 0.05,
            clamp_samples: None,
            list_room: 1.0,
            band_pixels: None,
            interleave: None,
            unfiltered: false,
            history: 0,
            upsample: 1,
            tame_outliers: false,
            aperture: None,
            focus: None,
            camera: 0,
            crop: None,
        }
    }
}

impl Settings {
    /// True if the settings override the camera's lens.
    #[must_use]
    pub fn has_lens(&self) -> bool {
        self.aperture.is_some() || self.focus.is_some()
    }

    /// Returns the estimator.
    #[must_use]
    pub fn method(&self) -> Method {
        self.technique.method
    }

    /// Returns the visibility; exact by default.
    #[must_use]
    pub fn visibility(&self) -> Visibility {
        self.technique.visibility()
    }

    /// Returns the settings of the plain estimator, with all else at its default: one light subpath for all
    /// pixels, iterations are averaged without a filter, and no lobe is widened where that is possible.
    #[must_use]
    pub fn plain() -> Self {
        Self { interleave: Some(1), clamp_samples: Some(0.0), ..Self::default() }
    }

    /// Sets the end of a render for which the user names none: [`DEFAULT_TARGET_ERROR`], at most
    /// [`DEFAULT_BUDGET`].
    pub fn end_by_default(&mut self) {
        (self.target_error, self.budget) = (Some(DEFAULT_TARGET_ERROR), Some(DEFAULT_BUDGET));
    }

    /// True if the settings request the denoiser, which filters each frame. With `interleave` unset the plan
    /// decides ([`crate::render::shared::plan::FramePlan::is_layered`]).
    #[must_use]
    pub fn is_denoised(&self) -> bool {
        self.interleaves() || self.history > 0 || self.upsample > 1
    }

    /// True if the settings request interleaved sampling.
    fn interleaves(&self) -> bool {
        self.interleave.is_some_and(|side| side > 1)
    }

    /// True if sampling is adaptive: tiles of unfiltered pictures take no more samples once their error has
    /// reached the target. A plan of `shared` that selects the filter disables it
    /// ([`crate::render::shared::plan::FramePlan::adaptive`]).
    #[must_use]
    pub fn is_adaptive(&self) -> bool {
        self.target_error.is_some() && self.crop.is_none() && !self.is_denoised()
    }

    /// True if tiles may be left out of samples: those that have converged, or that lie outside the crop. A
    /// filter and the reuse of reservoirs need the pixels around the crop, too; then the whole image is rendered.
    #[must_use]
    pub fn skips_tiles(&self) -> bool {
        let crops =
            self.crop.is_some() && !self.light_sampling.is_some_and(LightSampling::reuses) && !self.is_denoised();
        self.is_adaptive() || crops
    }

    /// Returns the part of the image that is rendered.
    #[must_use]
    pub fn region(&self) -> Crop {
        self.crop.unwrap_or(Crop::whole(self.width, self.height))
    }

    /// True if glossy surfaces draw directions of their own in place of those that pixels share: then no lobe is
    /// widened, and paths follow mirrors and glass. Needs rays in any direction.
    #[must_use]
    pub fn draws_own_directions(&self) -> bool {
        self.technique.shares_subpaths()
            && self.visibility() != Visibility::Fast
            && self.strategies == Strategies::All
            && self.clamp_samples.is_none_or(|samples| samples == 0.0)
    }

    /// True if surfaces know only the directions that pixels share: then lobes are widened, and glass is left out.
    #[must_use]
    pub fn shares_all_directions(&self) -> bool {
        self.technique.shares_subpaths() && !self.draws_own_directions()
    }

    /// Returns the samples that the roughness clamp asks of a lobe; nearly 0 without the clamp. Where surfaces
    /// draw directions of their own, these are lobes that light other surfaces.
    #[must_use]
    pub fn samples_per_lobe(&self) -> f32 {
        match (self.draws_own_directions(), self.clamp_samples) {
            (true, None) => INDIRECT_CLAMP,
            (true, Some(_)) => UNCLAMPED,
            (false, samples) => samples.filter(|&samples| samples > 0.0).unwrap_or(CLAMP),
        }
    }

    /// Returns the same for lobes that the camera sees.
    #[must_use]
    pub fn samples_per_seen_lobe(&self) -> f32 {
        if self.draws_own_directions() { UNCLAMPED } else { self.samples_per_lobe() }
    }

    /// Returns the exponent of the MIS heuristic.
    #[must_use]
    pub fn beta(&self) -> f32 {
        self.beta.unwrap_or(if self.technique.shares_subpaths() { 1.0 } else { 2.0 })
    }
}

/// Parses `auto` or the side of a square.
#[cfg(feature = "cli")]
fn sides_of_squares() -> impl TypedValueParser<Value = Interleave> {
    PossibleValuesParser::new([AUTO, "1", "2", "3", "4", "5", "6", "7", "8"]).map(|text| text.parse().ok())
}

/// Parses a number of bounces, or `unlimited`.
///
/// # Errors
/// Returns a sentence if the text is neither.
pub fn parse_bounces(text: &str) -> Result<u32, String> {
    match text {
        "unlimited" => Ok(UNLIMITED),
        _ => text.parse().map_err(|_| "neither a whole number nor `unlimited`".to_owned()),
    }
}

fn serialize_bounces<S: serde::Serializer>(bounces: &u32, serializer: S) -> Result<S::Ok, S::Error> {
    if *bounces == UNLIMITED { serializer.serialize_str("unlimited") } else { serializer.serialize_u32(*bounces) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By default lobes are widened that light other surfaces, and those that the camera sees are not.
    #[test]
    fn the_clamp_spares_what_the_camera_sees() {
        let asked = |clamp_samples, technique| {
            let settings = Settings { clamp_samples, technique, ..Settings::default() };
            settings.check().unwrap();
            [settings.samples_per_lobe(), settings.samples_per_seen_lobe()]
        };
        let [exact, fast] = [Technique::RASTER, Technique::FAST];
        assert_eq!(asked(None, exact), [INDIRECT_CLAMP, UNCLAMPED]);
        assert_eq!(asked(Some(0.0), exact), [UNCLAMPED; 2]);
        assert_eq!(asked(Some(4.0), exact), [4.0; 2]);
        assert_eq!([asked(None, fast), asked(Some(0.0), fast)], [[CLAMP; 2]; 2]);
    }
}
