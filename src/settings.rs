//! Settings of a render, in one struct that the command line, the viewer and the benchmarks edit.
//!
//! The command line derives its options from [`Settings`]: the doc comment of a field is the help text of its
//! option. [`Settings::check`] checks the ranges.

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

#[cfg(feature = "cli")]
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::crop::Crop;

/// Value of `bounces` for paths of unlimited length, in `path` and the reference.
pub const UNLIMITED: u32 = u32::MAX;

/// Pixels along a side of an image. The film sizes of scene files have the same limit.
pub const SIDES: RangeInclusive<u32> = 1..=16_384;

/// Number of samples. Beyond 2^24, adding 1 to an f32 count has no effect.
pub const SAMPLES: RangeInclusive<u32> = 1..=1 << 24;

/// Number of indirect bounces if it is limited. In `shared` each bounce needs a ray-bundle.
pub const BOUNCES: RangeInclusive<u32> = 0..=64;

/// Texels along a side of a rasterized view (ray-bundle, or face of a map).
pub const RESOLUTIONS: RangeInclusive<u32> = 16..=2048;

/// Number of light candidates per iteration.
const POOLS: RangeInclusive<u32> = 1..=256;

/// Share of the scene's diagonal at which the paper's geometry term is bounded.
const PAPER_CLAMPS: RangeInclusive<f32> = 0.0..=1.0;

/// Samples per lobe of the roughness clamp (m' of section 5.2).
const CLAMP_SAMPLES: RangeInclusive<f32> = 0.01..=1000.0;

/// Samples per lobe in the paper.
const CLAMP: f32 = 16.0;

/// Samples per lobe of highlights that light other surfaces, where surfaces draw directions of their own. Sponza,
/// 256x256, 4 samples, three seeds: rel_mse 0.0043 without, 0.0007 with 1, 4 or 16 samples; mean -0.8, -1.4 and
/// -1.7 %.
const INDIRECT_CLAMP: f32 = 1.0;

/// Samples per lobe that widen nothing.
const UNCLAMPED: f32 = 1e-12;

/// Initial capacity for list nodes, as a multiple of the estimate.
const LIST_CAPACITIES: RangeInclusive<f32> = 0.001..=16.0;

/// Pixels per band.
const BAND_PIXELS: RangeInclusive<u32> = 1..=1 << 22;

/// Samples that a reservoir represents at most.
const RESTIR_MEMORIES: RangeInclusive<f32> = 0.0..=100.0;

/// Pixels along a side of the squares of interleaved sampling.
const SIDES_OF_SQUARES: RangeInclusive<u32> = 1..=8;

/// Image pixels along a side of a pixel of a layer that is upsampled.
const SCALES: RangeInclusive<u32> = 1..=16;

/// Side of the squares of interleaved sampling. With none the plan selects it
/// ([`crate::render::shared::plan::FramePlan::interleave`]).
pub type Interleave = Option<u32>;

/// Word of the command line for a value that the plan selects.
#[cfg(feature = "cli")]
const AUTO: &str = "auto";

/// Number of previous frames in the temporal average of a pixel.
const HISTORIES: RangeInclusive<u32> = 0..=1024;

/// Exponent of the MIS heuristic. Beyond this range, powers of pdf ratios overflow f32.
pub const BETAS: RangeInclusive<f32> = 0.25..=4.0;

/// Radius of a thin lens in metres; 0 is a pinhole.
pub const APERTURES: RangeInclusive<f32> = 0.0..=1000.0;

/// Distance to the plane of focus in metres.
pub const FOCUSES: RangeInclusive<f32> = 1e-3..=1e6;

/// Target of the estimated rel_mse. Images in f32 cannot resolve smaller errors.
pub const TARGETS: RangeInclusive<f64> = 1e-8..=1.0;

/// Time budget in seconds, up to a week.
pub const BUDGETS: RangeInclusive<f64> = 0.001..=604_800.0;

/// Estimated rel_mse at which a render ends if neither samples nor a budget nor an error are given. At this
/// error little noise is visible.
pub const DEFAULT_TARGET_ERROR: f64 = 0.003;

/// Seconds after which such a render ends at the latest.
pub const DEFAULT_BUDGET: f64 = 300.0;

/// Estimator of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Bidirectional path tracing; all pixels share light subpaths and directions (short names: raster, twin)
    #[cfg_attr(feature = "cli", value(aliases = ["raster", "twin"]))]
    Shared,
    /// Bidirectional path tracing per pixel with all strategies, including light tracing (short name:
    /// ray-query)
    #[cfg_attr(feature = "cli", value(alias = "ray-query"))]
    Bdpt,
    /// Path tracing from the camera with next-event estimation
    Path,
    /// CPU path tracer that serves as the reference of all other methods
    Reference,
}

/// Algorithm that answers visibility between two points and finds the nearest hit along a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Visibility {
    /// Rasterized lists of all triangles that touch a texel or a cell, with exact intersection
    Exact,
    /// Rasterized depth maps and centre-sampled lists, as in Tokuyoshi and Ogaki 2012
    Fast,
    /// Ray queries of the GPU
    RayQuery,
    /// Rays through a bounding volume hierarchy, built on the CPU and traversed in compute
    Bvh,
}

/// Estimator together with its visibility algorithm.
#[derive(Clone, Copy, Debug, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Technique {
    /// Estimator of the picture
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Method::Shared))]
    pub method: Method,
    /// Algorithm that answers visibility [default: exact; ray-query for the short names twin and ray-query]
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_ifs([("method", "twin", "ray-query"), ("method", "ray-query", "ray-query")])))]
    pub visibility: Option<Visibility>,
}

impl Technique {
    /// `raster`: shared subpaths with exact visibility by rasterization.
    pub const RASTER: Self = Self { method: Method::Shared, visibility: None };
    /// Shared subpaths with rasterized depth maps.
    pub const FAST: Self = Self { method: Method::Shared, visibility: Some(Visibility::Fast) };
    /// `twin`: shared subpaths and the random numbers of [`Self::RASTER`] with ray queries.
    pub const TWIN: Self = Self { method: Method::Shared, visibility: Some(Visibility::RayQuery) };
    /// `ray-query`: bidirectional path tracing per pixel with ray queries.
    pub const RAY_QUERY: Self = Self { method: Method::Bdpt, visibility: Some(Visibility::RayQuery) };
    /// Bidirectional path tracing per pixel with exact visibility by rasterization.
    pub const BDPT: Self = Self { method: Method::Bdpt, visibility: None };
    /// Path tracing with exact visibility by rasterization.
    pub const PATH: Self = Self { method: Method::Path, visibility: None };
    /// CPU reference.
    pub const REFERENCE: Self = Self { method: Method::Reference, visibility: None };

    /// Techniques with a short name.
    pub const NAMED: [(&str, Self); 6] = [
        ("raster", Self::RASTER),
        ("twin", Self::TWIN),
        ("ray-query", Self::RAY_QUERY),
        ("bdpt", Self::BDPT),
        ("path", Self::PATH),
        ("reference", Self::REFERENCE),
    ];

    /// Returns the visibility; exact by default.
    #[must_use]
    pub fn visibility(self) -> Visibility {
        self.visibility.unwrap_or(Visibility::Exact)
    }

    /// True if the device must support ray queries.
    #[must_use]
    pub fn needs_ray_queries(self) -> bool {
        self.method != Method::Reference && self.visibility() == Visibility::RayQuery
    }

    /// True if the method samples paths with s light vertices and t eye vertices. `path` connects to light
    /// points only; `shared` connects to light points and two VPLs, and caustics alone to the camera. The
    /// reference does not separate strategies.
    #[must_use]
    pub fn has_strategy(self, s: u32, t: u32) -> bool {
        match self.method {
            Method::Shared => (s <= 3 && t > 1) || (s > 2 && t == 1),
            Method::Bdpt => t > 0,
            Method::Path => s <= 1 && t > 1,
            Method::Reference => false,
        }
    }

    /// True if pixels share light subpaths and directions.
    #[must_use]
    pub fn shares_subpaths(self) -> bool {
        self.method == Method::Shared
    }

    /// True if visibility lists and maps are rasterized.
    #[must_use]
    pub fn rasterizes(self) -> bool {
        self.shares_subpaths() && matches!(self.visibility(), Visibility::Exact | Visibility::Fast)
    }

    /// True if the combination of method and visibility is implemented.
    fn exists(self) -> bool {
        match self.method {
            Method::Shared => true,
            Method::Bdpt | Method::Path => self.visibility() != Visibility::Fast,
            Method::Reference => self.visibility.is_none(),
        }
    }
}

impl Default for Technique {
    fn default() -> Self {
        Self::RASTER
    }
}

impl PartialEq for Technique {
    fn eq(&self, other: &Self) -> bool {
        (self.method, self.visibility()) == (other.method, other.visibility())
    }
}

impl Eq for Technique {}

impl fmt::Display for Technique {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match Self::NAMED.iter().find(|(_, named)| named == self) {
            Some((name, _)) => f.write_str(name),
            None => write!(f, "{} {}", self.method, self.visibility()),
        }
    }
}

impl FromStr for Technique {
    type Err = String;

    /// Parses a short name, or the name of a method with its default visibility.
    fn from_str(text: &str) -> Result<Self, String> {
        let named = Self::NAMED.into_iter().find(|(name, _)| *name == text).map(|(_, technique)| technique);
        let of_method = || Method::ALL.into_iter().find(|method| method.name() == text);
        named.or_else(|| of_method().map(|method| Self { method, visibility: None })).ok_or_else(|| {
            let names: Vec<_> = Self::NAMED.iter().map(|(name, _)| *name).collect();
            format!("`{text}` is none of {} and shared", names.join(", "))
        })
    }
}

/// Single strategy of bidirectional path tracing that contributes to a picture. Its random numbers are those
/// of the picture of all strategies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct OnlyStrategy {
    /// Number of light vertices.
    pub s: u32,
    /// Number of eye vertices.
    pub t: u32,
    /// True if the contribution is multiplied by its MIS weight.
    pub weighted: bool,
}

impl OnlyStrategy {
    /// Returns every strategy (s, t) of paths with at most `bounces` indirect bounces, shortest paths first.
    /// A path has s + t - 1 edges.
    pub fn all(bounces: u32, weighted: bool) -> impl Iterator<Item = Self> {
        (1..=bounces + 2).flat_map(move |edges| (0..=edges).map(move |s| Self { s, t: edges + 1 - s, weighted }))
    }

    /// Returns the name of the strategy's image: `s2_t3` or `s2_t3_unweighted`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("s{}_t{}{}", self.s, self.t, if self.weighted { "" } else { "_unweighted" })
    }
}

/// Data structures that answer the queries of `shared` with exact visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum VisibilityFrom {
    /// The cheaper one for each kind of view, by a model of their times.
    Auto,
    /// Lists of triangles, rasterized into each view of each iteration.
    Lists,
    /// A grid of triangle lists, rasterized once for each pose.
    Grid,
}

/// Set of strategies that contribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Strategies {
    /// All strategies, combined by multiple importance sampling without a bound.
    All,
    /// Instant radiosity: for each path length the strategy with the most light vertices.
    Vpl,
    /// Path tracing through ray-bundles: strategies with one light vertex.
    Bundle,
    /// Set of Tokuyoshi and Ogaki 2012: one bounce by MIS, two bounces by the bounded strategy (2, 3) alone.
    Paper,
}

/// Method that selects a light for direct lighting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum LightSampling {
    /// Uniform selection.
    Uniform,
    /// Selection by power, independent of the surface.
    Power,
    /// Selection by power, distance and orientation, through a light tree.
    Tree,
    /// Resampling at the first hit: of candidates from the tree in `path`, of a pool of light points in
    /// `shared`.
    Ris,
    /// As `ris`, with the reservoirs of the pixel and its neighbours from the previous sample or iteration
    /// (ReSTIR DI).
    Restir,
}

impl LightSampling {
    /// True if lights are selected by a light tree.
    #[must_use]
    pub fn has_tree(self) -> bool {
        matches!(self, Self::Tree | Self::Ris | Self::Restir)
    }

    /// True if reservoirs of the previous sample or iteration are reused.
    #[must_use]
    pub fn reuses(self) -> bool {
        self == Self::Restir
    }

    /// True if direct light at the first hit is resampled.
    #[must_use]
    pub fn resamples(self) -> bool {
        matches!(self, Self::Ris | Self::Restir)
    }
}

/// Weights of reused light samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum RestirBias {
    /// Unbiased: divides by the pixels that could have produced the sample, after testing their visibility.
    Unbiased,
    /// Biased: divides by all pixels that are reused. Faster, but too dark where their visibility differs.
    Biased,
}

/// Defines the list of values and their names on the command line.
macro_rules! names {
    ($($type:ident { $($variant:ident = $name:literal),* $(,)? })*) => {
        $(impl $type {
            /// All values.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            /// Returns the name on the command line.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str(self.name())
            }
        })*
    };
}

names! {
    Method { Shared = "shared", Bdpt = "bdpt", Path = "path", Reference = "reference" }
    Visibility { Exact = "exact", Fast = "fast", RayQuery = "ray-query", Bvh = "bvh" }
    VisibilityFrom { Auto = "auto", Lists = "lists", Grid = "grid" }
    Strategies { All = "all", Vpl = "vpl", Bundle = "bundle", Paper = "paper" }
    LightSampling { Uniform = "uniform", Power = "power", Tree = "tree", Ris = "ris", Restir = "restir" }
    RestirBias { Unbiased = "unbiased", Biased = "biased" }
}

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
    /// loading, setup and writing files. The render ends with the batch in which the time is used up; a batch
    /// takes half a second, or one sample that takes longer. Excludes --samples
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
    /// less memory, but the maps of a light pool are drawn for each band [default: 262144; 131072 for images
    /// of more pixels; 1048576 with a light pool]
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
}

/// Setting that is out of its range, or that the method does not have.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{option} {value}: {rule}")]
pub struct OutOfRange {
    /// Option as the command line spells it.
    pub option: &'static str,
    /// Rejected value.
    pub value: String,
    /// Range, or the reason for the rejection.
    pub rule: String,
}

impl Settings {
    /// Checks every value against its range, and against the method.
    ///
    /// # Errors
    /// Returns the first value that is out of its range, or that the method does not have.
    pub fn check(&self) -> Result<(), OutOfRange> {
        self.check_visibility()?;
        self.check_size_and_samples()?;
        self.check_bounces()?;
        self.check_ranges()?;
        self.check_combinations()?;
        self.check_foreign()
    }

    /// Checks that the combination of method and visibility is implemented.
    fn check_visibility(&self) -> Result<(), OutOfRange> {
        if self.technique.exists() {
            return Ok(());
        }
        let method = self.method();
        let rule = match method {
            Method::Reference => "the reference traces its own rays; leave --visibility out".to_owned(),
            _ => format!("does not exist for {method} yet; leave it out, or use --method shared"),
        };
        Err(rejected("--visibility", self.visibility(), rule))
    }

    /// Checks the image's size and the end of the render.
    fn check_size_and_samples(&self) -> Result<(), OutOfRange> {
        let Self { width, height, .. } = *self;
        if !SIDES.contains(&width) || !SIDES.contains(&height) {
            let rule = format!("each side has to be {}", span(&SIDES));
            return Err(rejected("--size", format_args!("{width}x{height}"), rule));
        }
        if let Some(crop) = self.crop.filter(|crop| !crop.fits(width, height)) {
            return Err(rejected(
                "--crop",
                crop,
                format!("has to have a pixel and lie in the image of {width}x{height}"),
            ));
        }
        within("--samples", Some(self.samples), &SAMPLES, "")?;
        within("--budget", self.budget, &BUDGETS, " seconds")?;
        within("--target-error", self.target_error, &TARGETS, "")
    }

    /// Checks the number of bounces. `path` and the reference accept unlimited bounces.
    fn check_bounces(&self) -> Result<(), OutOfRange> {
        let unlimited = matches!(self.method(), Method::Path | Method::Reference);
        match self.bounces {
            UNLIMITED if unlimited => Ok(()),
            UNLIMITED => {
                let rule = format!("{} needs a number, {}", self.technique, span(&BOUNCES));
                Err(rejected("--bounces", "unlimited", rule))
            }
            bounces => within("--bounces", Some(bounces), &BOUNCES, if unlimited { " or `unlimited`" } else { "" }),
        }
    }

    /// Checks the ranges of all other values.
    fn check_ranges(&self) -> Result<(), OutOfRange> {
        within("--beta", self.beta, &BETAS, "")?;
        within("--clamp-samples", self.clamp_samples.filter(|&samples| samples != 0.0), &CLAMP_SAMPLES, "")?;
        within("--list-room", Some(self.list_room), &LIST_CAPACITIES, "")?;
        within("--band-pixels", self.band_pixels, &BAND_PIXELS, "")?;
        within("--restir-memory", Some(self.restir_memory), &RESTIR_MEMORIES, "")?;
        within("--paper-clamp", Some(self.paper_clamp), &PAPER_CLAMPS, "")?;
        within("--light-pool", self.light_pool, &POOLS, "")?;
        within("--interleave", self.interleave, &SIDES_OF_SQUARES, "")?;
        within("--history", Some(self.history), &HISTORIES, "")?;
        within("--upsample", Some(self.upsample), &SCALES, "")?;
        within("--aperture", self.aperture, &APERTURES, " metres")?;
        within("--focus", self.focus, &FOCUSES, " metres")?;
        self.resolutions().into_iter().try_for_each(|(option, texels)| within(option, texels, &RESOLUTIONS, ""))
    }

    /// Checks options that need or exclude one another.
    fn check_combinations(&self) -> Result<(), OutOfRange> {
        for (option, given, needed, wanted) in [
            ("--unfiltered", self.unfiltered, self.interleaves(), "--interleave of 2 or more"),
            ("--tame-outliers", self.tame_outliers, self.is_denoised(), "--interleave, --history or --upsample"),
        ] {
            if given && !needed {
                return Err(rejected(option, "", format!("needs {wanted}")));
            }
        }
        let shares = self.technique.shares_subpaths();
        if let Some(sampling) = self.light_sampling.filter(|l| shares && l.reuses() && self.is_denoised()) {
            let rule = "reuses reservoirs of the previous iteration of the same picture; with --interleave, --history or \
                        --upsample use ris";
            return Err(rejected("--light-sampling", sampling, rule.to_owned()));
        }
        if shares && self.restir_memory > 0.0 {
            let rule = "is an option of path; raster and twin keep the light points and maps of one iteration only";
            return Err(rejected("--restir-memory", self.restir_memory, rule.to_owned()));
        }
        Ok(())
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

    fn resolutions(&self) -> [(&'static str, Option<u32>); 3] {
        [
            ("--bundle-resolution", self.bundle_resolution),
            ("--light-resolution", self.light_resolution),
            ("--vpl-resolution", self.vpl_resolution),
        ]
    }

    /// Checks that options of other methods have their default values, since ignoring them silently would
    /// mislead.
    fn check_foreign(&self) -> Result<(), OutOfRange> {
        let default = Self::default();
        let shares = self.technique.shares_subpaths();
        let rasterizes = self.technique.rasterizes();
        let reference = self.method() == Method::Reference;
        let strategies = (self.strategies != default.strategies && !shares).then(|| self.strategies.to_string());
        let exact = self.technique.rasterizes() && self.visibility() == Visibility::Exact;
        let from =
            (self.visibility_from != default.visibility_from && !exact).then(|| self.visibility_from.to_string());
        let paper_clamp = (self.paper_clamp != default.paper_clamp && !shares).then(|| self.paper_clamp.to_string());
        let clamp_samples = self.clamp_samples.filter(|&samples| !shares && samples > 0.0).map(|n| n.to_string());
        let capacity = (self.list_room != default.list_room && !rasterizes).then(|| self.list_room.to_string());
        let denoising = |option, value: u32, default: u32| {
            (option, (value != default && !shares).then(|| value.to_string()), "raster and twin")
        };
        let sampling = self.light_sampling.filter(|l| reference || (shares && *l == LightSampling::Tree));
        let resampling = self.light_sampling.filter(|l| l.resamples() && self.method() == Method::Bdpt);
        let reuses =
            (shares || self.method() == Method::Path) && self.light_sampling.is_some_and(LightSampling::reuses);
        let bias = (self.restir_bias != default.restir_bias && !reuses).then(|| self.restir_bias.to_string());
        let memory = (self.restir_memory != default.restir_memory && !reuses).then(|| self.restir_memory.to_string());
        let changed = [
            ("--list-room", capacity, "raster"),
            ("list lengths", (self.list_lengths && !rasterizes).then(|| "true".to_owned()), "raster"),
            ("--strategies", strategies, "raster and twin"),
            ("--visibility-from", from, "raster"),
            ("--band-pixels", self.band_pixels.filter(|_| !shares).map(|n| n.to_string()), "raster and twin"),
            ("--clamp-samples", clamp_samples, "raster and twin"),
            ("--paper-clamp", paper_clamp, "raster and twin"),
            ("--light-pool", self.light_pool.filter(|_| !shares).map(|n| n.to_string()), "raster and twin"),
            ("--beta", self.beta.filter(|_| reference).map(|b| b.to_string()), "raster, twin, ray-query and path"),
            ("--light-sampling", sampling.map(|l| l.to_string()), "ray-query and path"),
            ("--light-sampling", resampling.map(|l| l.to_string()), "raster, twin and path"),
            denoising("--interleave", self.interleave.unwrap_or(1), 1),
            denoising("--history", self.history, default.history),
            denoising("--upsample", self.upsample, default.upsample),
            ("--restir-bias", bias, "raster, twin and path with --light-sampling restir"),
            ("--restir-memory", memory, "path with --light-sampling restir"),
        ];
        let resolutions =
            self.resolutions().map(|(option, r)| (option, r.filter(|_| !rasterizes).map(|r| r.to_string()), "raster"));
        match changed.into_iter().chain(resolutions).find_map(|(option, value, whose)| Some((option, value?, whose))) {
            Some((option, value, whose)) => {
                Err(OutOfRange { option, value, rule: format!("is an option of {whose}, not of {}", self.technique) })
            }
            None => Ok(()),
        }
    }
}

/// Checks a value, if it is set, against its range. `unit` follows the range in the message.
fn within<T: Copy + PartialOrd + fmt::Display>(
    option: &'static str,
    value: Option<T>,
    range: &RangeInclusive<T>,
    unit: &str,
) -> Result<(), OutOfRange> {
    match value {
        Some(value) if !range.contains(&value) => {
            Err(rejected(option, value, format!("has to be {}{unit}", span(range))))
        }
        _ => Ok(()),
    }
}

fn rejected(option: &'static str, value: impl fmt::Display, rule: String) -> OutOfRange {
    OutOfRange { option, value: value.to_string(), rule }
}

/// Formats a range: `1 to 64`.
fn span<T: fmt::Display>(range: &RangeInclusive<T>) -> String {
    format!("{} to {}", range.start(), range.end())
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

    #[test]
    fn each_range_has_two_ends() {
        let base = Settings::default();
        assert_eq!(base.check(), Ok(()));
        let reference = Settings { technique: Technique::REFERENCE, ..base.clone() };
        let good = [
            Settings { width: 1, height: 16_384, ..base.clone() },
            Settings { samples: 1, ..base.clone() },
            Settings { bounces: 0, ..base.clone() },
            Settings { bounces: 64, ..base.clone() },
            Settings { bundle_resolution: Some(16), vpl_resolution: Some(2048), ..base.clone() },
            Settings { budget: Some(0.5), beta: Some(2.0), ..base.clone() },
            Settings { technique: Technique::RAY_QUERY, beta: Some(1.0), ..base.clone() },
            Settings { technique: Technique::TWIN, strategies: Strategies::Paper, paper_clamp: 0.1, ..base.clone() },
            Settings { technique: Technique::PATH, bounces: UNLIMITED, ..base.clone() },
            Settings { bounces: UNLIMITED, ..reference.clone() },
            Settings { aperture: Some(0.0), focus: Some(1e-3), ..base.clone() },
            Settings { technique: Technique::PATH, light_sampling: Some(LightSampling::Tree), ..base.clone() },
            Settings { light_sampling: Some(LightSampling::Ris), interleave: Some(2), ..base.clone() },
            Settings {
                light_sampling: Some(LightSampling::Restir),
                restir_bias: RestirBias::Biased,
                light_pool: Some(1),
                ..base.clone()
            },
        ];
        for settings in good {
            assert_eq!(settings.check(), Ok(()), "{settings:?}");
        }
        let bad = [
            ("--size", Settings { width: 0, ..base.clone() }),
            ("--size", Settings { height: 16_385, ..base.clone() }),
            ("--samples", Settings { samples: 0, ..base.clone() }),
            ("--budget", Settings { budget: Some(0.0), ..base.clone() }),
            ("--budget", Settings { budget: Some(f64::NAN), ..base.clone() }),
            ("--bounces", Settings { bounces: 65, ..base.clone() }),
            ("--bounces", Settings { bounces: 65, ..reference.clone() }),
            ("--bounces", Settings { bounces: UNLIMITED, ..base.clone() }),
            ("--beta", Settings { beta: Some(f32::NAN), ..base.clone() }),
            ("--beta", Settings { beta: Some(-1.0), ..base.clone() }),
            ("--list-room", Settings { list_room: 0.0, ..base.clone() }),
            ("--paper-clamp", Settings { paper_clamp: 1.5, ..base.clone() }),
            ("--light-pool", Settings { light_pool: Some(0), ..base.clone() }),
            ("--band-pixels", Settings { band_pixels: Some(0), ..base.clone() }),
            ("--band-pixels", Settings { technique: Technique::PATH, band_pixels: Some(4), ..base.clone() }),
            ("--light-pool", Settings { technique: Technique::PATH, light_pool: Some(4), ..base.clone() }),
            ("--bundle-resolution", Settings { bundle_resolution: Some(15), ..base.clone() }),
            ("--light-resolution", Settings { light_resolution: Some(2049), ..base.clone() }),
            ("--vpl-resolution", Settings { vpl_resolution: Some(0), ..base.clone() }),
            ("--aperture", Settings { aperture: Some(-0.1), ..base.clone() }),
            ("--aperture", Settings { aperture: Some(f32::NAN), ..base.clone() }),
            ("--focus", Settings { focus: Some(0.0), ..base.clone() }),
            ("--light-sampling", Settings { light_sampling: Some(LightSampling::Tree), ..base.clone() }),
            ("--light-sampling", {
                Settings { technique: Technique::RAY_QUERY, light_sampling: Some(LightSampling::Ris), ..base.clone() }
            }),
            ("--light-sampling", {
                Settings { light_sampling: Some(LightSampling::Restir), history: 4, ..base.clone() }
            }),
            ("--light-sampling", {
                Settings { light_sampling: Some(LightSampling::Restir), interleave: Some(2), ..base.clone() }
            }),
            ("--interleave", Settings { interleave: Some(0), ..base.clone() }),
            ("--interleave", Settings { interleave: Some(9), ..base.clone() }),
            ("--interleave", Settings { technique: Technique::PATH, interleave: Some(2), ..base.clone() }),
            ("--unfiltered", Settings { unfiltered: true, ..base.clone() }),
            ("--tame-outliers", Settings { tame_outliers: true, ..base.clone() }),
            ("--restir-memory", {
                Settings { light_sampling: Some(LightSampling::Restir), restir_memory: 4.0, ..base.clone() }
            }),
            ("--restir-bias", Settings { restir_bias: RestirBias::Biased, ..base.clone() }),
            ("--restir-bias", Settings { technique: Technique::PATH, restir_bias: RestirBias::Biased, ..base.clone() }),
            ("--restir-memory", Settings { restir_memory: f32::NAN, ..base.clone() }),
            ("--restir-memory", Settings { technique: Technique::PATH, restir_memory: 4.0, ..base }),
            ("--bounces", Settings { technique: Technique::RAY_QUERY, bounces: UNLIMITED, ..reference.clone() }),
            ("--beta", Settings { beta: Some(2.0), ..reference.clone() }),
            (
                "--visibility",
                Settings { technique: Technique { method: Method::Path, ..Technique::FAST }, ..reference.clone() },
            ),
            (
                "--vpl-resolution",
                Settings { technique: Technique::TWIN, vpl_resolution: Some(64), ..reference.clone() },
            ),
            (
                "--visibility",
                Settings { technique: Technique { method: Method::Reference, ..Technique::FAST }, ..reference.clone() },
            ),
            (
                "--strategies",
                Settings { technique: Technique::RAY_QUERY, strategies: Strategies::Vpl, ..reference.clone() },
            ),
            (
                "--light-resolution",
                Settings { technique: Technique::PATH, light_resolution: Some(64), ..reference.clone() },
            ),
            ("--strategies", Settings { strategies: Strategies::Vpl, ..reference.clone() }),
            ("--vpl-resolution", Settings { vpl_resolution: Some(64), ..reference }),
        ];
        for (option, settings) in bad {
            assert_eq!(settings.check().map_err(|e| e.option), Err(option), "{settings:?}");
        }
    }
}
