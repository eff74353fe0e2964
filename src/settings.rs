//! Every knob, in one struct that the command line, the viewer and the benchmarks edit: meaning, unit, default and range.
//!
//! The command line derives its options from [`Settings`], with these very sentences as help; [`Settings::check`] holds the
//! ranges.

use std::fmt;
use std::ops::RangeInclusive;

use clap::builder::{PossibleValuesParser, TypedValueParser};

/// `bounces` without a limit, for `path` and the reference.
pub const UNLIMITED: u32 = u32::MAX;

/// Pixels along a side of an image; the film sizes that scene files may ask for have the same limit.
pub const SIDES: RangeInclusive<u32> = 1..=16_384;

/// Samples: 2^24 is where adding 1 to an f32 count stops.
pub const SAMPLES: RangeInclusive<u32> = 1..=1 << 24;

/// Indirect bounces that are counted; in `raster` each takes a bundle.
pub const BOUNCES: RangeInclusive<u32> = 0..=64;

/// Texels along a side of a view.
pub const RESOLUTIONS: RangeInclusive<u32> = 16..=2048;
/// Light points of a pool.
const POOLS: RangeInclusive<u32> = 1..=256;

/// Layer pixels along a side of a square that shares its samples, and image pixels along a side of a layer's.
const SIDES_OF_SQUARES: RangeInclusive<u32> = 1..=8;
const SCALES: RangeInclusive<u32> = 1..=16;

/// The side of the squares of interleaved sampling. None: the plan chooses ([`crate::plan::FramePlan::interleave`]).
pub type Interleave = Option<u32>;

/// The word for a value that the plan chooses.
const AUTO: &str = "auto";

/// Frames that a pixel remembers.
const HISTORIES: RangeInclusive<u32> = 0..=1024;

/// Exponents of the MIS heuristic; beyond, powers of density ratios leave the range of f32.
pub const BETAS: RangeInclusive<f32> = 0.25..=4.0;

/// Metres of a lens's radius; 0 is a pinhole.
pub const APERTURES: RangeInclusive<f32> = 0.0..=1000.0;

/// Metres to the plane of focus.
pub const FOCUSES: RangeInclusive<f32> = 1e-3..=1e6;

/// Errors that a picture may be asked for: below, f32 pictures do not tell.
pub const TARGETS: RangeInclusive<f64> = 1e-8..=1.0;

/// Seconds of a budget: up to a week.
pub const BUDGETS: RangeInclusive<f64> = 0.001..=604_800.0;

/// Estimated rel_mse at which a render ends that was given no samples, budget or error: little noise is seen
/// at it.
pub const DEFAULT_TARGET_ERROR: f64 = 0.003;

/// Seconds after which such a render ends at the latest.
pub const DEFAULT_BUDGET: f64 = 300.0;

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Bidirectional path tracing by rasterization alone.
    Raster,
    /// The same estimator and random numbers as `raster`, with ray queries for visibility.
    Twin,
    /// Bidirectional path tracing with ray queries: all strategies, light tracing included.
    RayQuery,
    /// Path tracing from the camera with ray queries.
    Path,
    /// The CPU path tracer that judges the others.
    Reference,
}

impl Method {
    /// Whether it needs a device with ray queries.
    #[must_use]
    pub fn traces_rays(self) -> bool {
        matches!(self, Self::Twin | Self::RayQuery | Self::Path)
    }

    /// Whether it can make paths of s light vertices and t eye vertices: `path` joins lights alone, `raster` and `twin` up to the
    /// second VPL and nothing to the camera, the reference does not tell.
    #[must_use]
    pub fn has_strategy(self, s: u32, t: u32) -> bool {
        match self {
            Self::Raster | Self::Twin => s <= 3 && t > 1,
            Self::RayQuery => t > 0,
            Self::Path => s <= 1 && t > 1,
            Self::Reference => false,
        }
    }

    /// Whether it is the raster estimator: light and directions that all pixels share, and surfaces that can be joined.
    #[must_use]
    pub fn shares_subpaths(self) -> bool {
        matches!(self, Self::Raster | Self::Twin)
    }
}

/// The only strategy of bidirectional path tracing that counts in a picture, with the random numbers of a picture of all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct OnlyStrategy {
    /// Vertices that the light's side makes.
    pub s: u32,
    /// Vertices that the camera's side makes.
    pub t: u32,
    /// Whether its share by MIS counts, or all of it.
    pub weighted: bool,
}

impl OnlyStrategy {
    /// Every strategy (s, t) of paths up to a number of bounces, shortest paths first: s + t - 1 edges each.
    pub fn all(bounces: u32, weighted: bool) -> impl Iterator<Item = Self> {
        (1..=bounces + 2).flat_map(move |edges| (0..=edges).map(move |s| Self { s, t: edges + 1 - s, weighted }))
    }

    /// The name of its image: `s2_t3` or `s2_t3_unweighted`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("s{}_t{}{}", self.s, self.t, if self.weighted { "" } else { "_unweighted" })
    }
}

/// How `raster` tests visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Visibility {
    /// Conservative lists of triangles and exact intersection: no visibility error.
    Exact,
    /// Centre-sampled lists and depth comparison, as in the paper.
    Fast,
}

/// Which strategies take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategies {
    /// All, under multiple importance sampling, nothing clamped.
    All,
    /// For each path length the one with the most light vertices: instant radiosity.
    Vpl,
    /// One light vertex only: path tracing through bundles.
    Bundle,
    /// The set of 2012: one bounce under MIS, two bounces by (2, 3) alone, clamped.
    Paper,
}

/// How a surface chooses the light that it is joined to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightSampling {
    /// All alike.
    Uniform,
    /// By power, wherever the surface is.
    Power,
    /// By power, distance and orientation, through a tree.
    Tree,
    /// Where the camera looks by resampling: what the tree gives, in raster and twin a pool of light points.
    Ris,
    /// With what the pixel and its neighbours kept in the last sample or iteration (ReSTIR DI).
    Restir,
}

impl LightSampling {
    /// Whether lights are chosen down a tree.
    #[must_use]
    pub fn has_tree(self) -> bool {
        matches!(self, Self::Tree | Self::Ris | Self::Restir)
    }

    /// Whether what was kept before is used again.
    #[must_use]
    pub fn reuses(self) -> bool {
        self == Self::Restir
    }

    /// Whether the light of what the camera sees is resampled.
    #[must_use]
    pub fn resamples(self) -> bool {
        matches!(self, Self::Ris | Self::Restir)
    }
}

/// How reused light samples are weighted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RestirBias {
    /// By the pixels that could have kept them, with rays or maps that say whether these see them.
    Unbiased,
    /// By all pixels that were asked: faster, and dark where their visibility differs.
    Biased,
}

/// The name that the command line knows a value by.
fn name(value: &impl clap::ValueEnum) -> String {
    value.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&name(self))
    }
}

impl fmt::Display for Visibility {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&name(self))
    }
}

impl fmt::Display for LightSampling {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&name(self))
    }
}

impl fmt::Display for RestirBias {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&name(self))
    }
}

impl fmt::Display for Strategies {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&name(self))
    }
}

/// All settings of a render.
#[derive(Clone, Debug, PartialEq, clap::Args, serde::Serialize)]
pub struct Settings {
    /// How the picture is made
    #[arg(long, value_enum, default_value_t = Self::default().method)]
    pub method: Method,
    /// Columns of the image.
    #[arg(skip = Self::default().width)]
    pub width: u32,
    /// Rows of the image.
    #[arg(skip = Self::default().height)]
    pub height: u32,
    /// Iterations (raster, twin) or paths per pixel (all others) [default: as many as an estimated rel_mse of
    /// 0.003 takes, or five minutes]
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Self::default().samples, hide_default_value = true)]
    pub samples: u32,
    /// As many samples as this time allows, instead of a number; counted from the first sample on
    #[arg(long, value_name = "SECONDS", conflicts_with = "samples", allow_negative_numbers = true)]
    pub budget: Option<f64>,
    /// As many samples as bring the picture's estimated error down to this rel_mse, or as --budget allows;
    /// 1e-8 to 1
    #[arg(long, value_name = "REL_MSE", conflicts_with = "samples", allow_negative_numbers = true)]
    pub target_error: Option<f64>,
    /// Indirect bounces: 0 is direct light only, at most 64; path and the reference also take `unlimited`
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = parse_bounces, default_value_t = Self::default().bounces)]
    #[serde(serialize_with = "serialize_bounces")]
    pub bounces: u32,
    /// Seed of all random numbers: the same seed, device and driver give the same bytes
    #[arg(long, value_name = "N", allow_negative_numbers = true, default_value_t = Self::default().seed)]
    pub seed: u32,
    /// How raster tests visibility
    #[arg(long, value_enum, default_value_t = Self::default().visibility, help_heading = RASTER)]
    pub visibility: Visibility,
    /// Which strategies of bidirectional path tracing take part
    #[arg(long, value_enum, default_value_t = Self::default().strategies, help_heading = RASTER)]
    pub strategies: Strategies,
    /// Exponent of the MIS heuristic, 0.25 to 4: 1 is the balance heuristic (section 4.2), 2 the power heuristic
    /// [default: 1 for raster and twin, 2 for ray-query and path]
    #[arg(long, value_name = "B", allow_negative_numbers = true)]
    pub beta: Option<f32>,
    /// How a light is chosen; tree is an option of ray-query and path, ris and restir of raster, twin and path [default: power, and direct
    /// light of each in raster and twin where there are two to four; tree for ray-query and path where more than one light is somewhere]
    #[arg(long, value_enum)]
    pub light_sampling: Option<LightSampling>,
    /// How `--light-sampling restir` weights what it reuses
    #[arg(long, value_enum, default_value_t = Self::default().restir_bias)]
    pub restir_bias: RestirBias,
    /// Samples of a pixel that what `--light-sampling restir` keeps stands for at most, 0 to 100; 0: no sample looks back further than
    /// to the one before
    #[arg(long, value_name = "SAMPLES", default_value_t = Self::default().restir_memory, allow_negative_numbers = true, help_heading = RAYS)]
    pub restir_memory: f32,
    /// The one strategy that counts, for images per strategy.
    #[arg(skip)]
    pub only: Option<OnlyStrategy>,
    /// What raster shows in place of light: entries of lists that look-ups along the first bundle walk, a mean over directions.
    #[arg(skip)]
    pub list_lengths: bool,
    /// Texels along a side of a ray-bundle, 16 to 2048 [default: chosen from the scene]
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = RASTER)]
    pub bundle_resolution: Option<u32>,
    /// Texels along a side of each of the six faces around a light, 16 to 2048 [default: chosen from the scene]
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = RASTER)]
    pub light_resolution: Option<u32>,
    /// Texels along a side of each of the six faces around a VPL, 16 to 2048 [default: chosen from the scene]
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = RASTER)]
    pub vpl_resolution: Option<u32>,
    /// With `--strategies paper`: share of the scene's diagonal, 0 to 1, below which the geometry term of (2, 3) stops growing
    #[arg(long, value_name = "SHARE", default_value_t = Self::default().paper_clamp, allow_negative_numbers = true, help_heading = RASTER)]
    pub paper_clamp: f32,
    /// Samples that a highlight should hold, 0.01 to 1000: narrower lobes are widened until enough samples have come (m' of section 5.2);
    /// fewer leave highlights sharper and noisier
    #[arg(long, value_name = "N", default_value_t = Self::default().clamp_samples, allow_negative_numbers = true, help_heading = RASTER)]
    pub clamp_samples: f32,
    /// Light points per iteration that the direct light of each pixel is chosen from, 1 to 256 [default: chosen from the scene]
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = RASTER)]
    pub light_pool: Option<u32>,
    /// Room for list nodes at the start, as a multiple of the usual guess, 0.001 to 16; lists grow where a scene needs more
    #[arg(long, value_name = "FACTOR", default_value_t = Self::default().list_room, allow_negative_numbers = true, help_heading = RASTER)]
    pub list_room: f32,
    /// Pixels that are followed at a time, 1 to 4194304: fewer take less memory, and drawings of the maps of a light pool more often
    /// [default: 262144, with a light pool 1048576]
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = RASTER)]
    pub band_pixels: Option<u32>,
    /// Interleaved sampling: pixels along a side of the squares whose pixels each have a light subpath and bundles of their own, joined by
    /// a filter; 1: all pixels share one; auto: the plan chooses by what views and pixels cost
    #[arg(long, value_name = "N", default_value = AUTO, value_parser = sides_of_squares(), allow_negative_numbers = true, help_heading = LIVE)]
    pub interleave: Interleave,
    /// Leave what --interleave splits unfiltered
    #[arg(long, help_heading = LIVE)]
    pub unfiltered: bool,
    /// Frames that indirect light is averaged over, following what moves and forgetting what has changed, 0 to 1024
    #[arg(long, value_name = "FRAMES", default_value_t = Self::default().history, allow_negative_numbers = true, help_heading = LIVE)]
    pub history: u32,
    /// Indirect light for every n-th pixel of every n-th row alone, 1 to 16, interpolated where surfaces are alike
    #[arg(long, value_name = "N", default_value_t = Self::default().upsample, allow_negative_numbers = true, help_heading = LIVE)]
    pub upsample: u32,
    /// Give pixels of indirect light that stick out the brightness of those around them: less noise, and darker
    #[arg(long, help_heading = LIVE)]
    pub tame_outliers: bool,
    /// Radius of the lens in metres, 0 to 1000: 0 is a pinhole [default: the camera's own]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Camera")]
    pub aperture: Option<f32>,
    /// Distance along the view to the plane that is sharp, in metres, 0.001 to 1000000 [default: the camera's own]
    #[arg(long, value_name = "METRES", allow_negative_numbers = true, help_heading = "Camera")]
    pub focus: Option<f32>,
    /// Index of the camera in the scene.
    #[arg(skip = Self::default().camera)]
    pub camera: usize,
}

/// Heading of the options that only raster has.
const RASTER: &str = "Options of raster";

/// Heading of the options that make a good picture of few samples, frame by frame.
const LIVE: &str = "Real-time options of raster and twin";

/// Heading of the options that only paths of each pixel have.
const RAYS: &str = "Options of ray-query and path";

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Raster,
            width: 512,
            height: 512,
            samples: 64,
            budget: None,
            target_error: None,
            bounces: 2,
            seed: 1,
            visibility: Visibility::Exact,
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
            clamp_samples: 16.0,
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
        }
    }
}

impl Settings {
    /// The plain estimator, all else at its default: one light subpath serves all pixels, and iterations are summed as they are, without a
    /// filter.
    #[must_use]
    pub fn plain() -> Self {
        Self { interleave: Some(1), ..Self::default() }
    }
}

/// A setting out of its range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{option} {value}: {rule}")]
pub struct OutOfRange {
    /// The option as the command line spells it.
    pub option: &'static str,
    /// What it was.
    pub value: String,
    /// What it has to be.
    pub rule: String,
}

impl Settings {
    /// Checks every value against its range.
    ///
    /// # Errors
    /// The first value that is out of its range, or that the method does not have.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let Self { width, height, samples, bounces, paper_clamp, .. } = *self;
        let wrong =
            |option, value: &dyn fmt::Display, rule: String| Err(OutOfRange { option, value: value.to_string(), rule });
        if !SIDES.contains(&width) || !SIDES.contains(&height) {
            return wrong("--size", &format_args!("{width}x{height}"), format!("each side has to be {}", span(&SIDES)));
        }
        if !SAMPLES.contains(&samples) {
            return wrong("--samples", &samples, format!("has to be {}", span(&SAMPLES)));
        }
        if let Some(seconds) = self.budget.filter(|s| !BUDGETS.contains(s)) {
            return wrong("--budget", &seconds, format!("has to be {} seconds", span(&BUDGETS)));
        }
        if let Some(error) = self.target_error.filter(|e| !TARGETS.contains(e)) {
            return wrong("--target-error", &error, format!("has to be {}", span(&TARGETS)));
        }
        let unlimited = matches!(self.method, Method::Path | Method::Reference);
        if bounces == UNLIMITED && !unlimited {
            return wrong("--bounces", &"unlimited", format!("{} needs a number, {}", self.method, span(&BOUNCES)));
        }
        if bounces != UNLIMITED && !BOUNCES.contains(&bounces) {
            let more = if unlimited { " or `unlimited`" } else { "" };
            return wrong("--bounces", &bounces, format!("has to be {}{more}", span(&BOUNCES)));
        }
        if let Some(beta) = self.beta.filter(|b| !BETAS.contains(b)) {
            return wrong("--beta", &beta, format!("has to be {}", span(&BETAS)));
        }
        if !(0.01..=1000.0).contains(&self.clamp_samples) {
            return wrong("--clamp-samples", &self.clamp_samples, "has to be 0.01 to 1000".to_owned());
        }
        if !(0.001..=16.0).contains(&self.list_room) {
            return wrong("--list-room", &self.list_room, "has to be 0.001 to 16".to_owned());
        }
        if let Some(pixels) = self.band_pixels.filter(|pixels| !(1..=1 << 22).contains(pixels)) {
            return wrong("--band-pixels", &pixels, "has to be 1 to 4194304".to_owned());
        }
        if !(0.0..=100.0).contains(&self.restir_memory) {
            return wrong("--restir-memory", &self.restir_memory, "has to be 0 to 100".to_owned());
        }
        if !(0.0..=1.0).contains(&paper_clamp) {
            return wrong("--paper-clamp", &paper_clamp, "has to be 0 to 1".to_owned());
        }
        if let Some(points) = self.light_pool.filter(|n| !POOLS.contains(n)) {
            return wrong("--light-pool", &points, format!("has to be {}", span(&POOLS)));
        }
        for (option, value, range) in [
            ("--interleave", self.interleave.unwrap_or(1), SIDES_OF_SQUARES),
            ("--history", self.history, HISTORIES),
            ("--upsample", self.upsample, SCALES),
        ] {
            if !range.contains(&value) {
                return wrong(option, &value, format!("has to be {}", span(&range)));
            }
        }
        if let Some(metres) = self.aperture.filter(|a| !APERTURES.contains(a)) {
            return wrong("--aperture", &metres, format!("has to be {} metres", span(&APERTURES)));
        }
        if let Some(metres) = self.focus.filter(|f| !FOCUSES.contains(f)) {
            return wrong("--focus", &metres, format!("has to be {} metres", span(&FOCUSES)));
        }
        for (option, resolution) in self.resolutions() {
            if let Some(texels) = resolution.filter(|r| !RESOLUTIONS.contains(r)) {
                return wrong(option, &texels, format!("has to be {}", span(&RESOLUTIONS)));
            }
        }
        for (option, given, needed, wanted) in [
            ("--unfiltered", self.unfiltered, self.interleaves(), "--interleave of 2 or more"),
            ("--tame-outliers", self.tame_outliers, self.is_live(), "--interleave, --history or --upsample"),
        ] {
            if given && !needed {
                return wrong(option, &"", format!("needs {wanted}"));
            }
        }
        let shares = self.method.shares_subpaths();
        if let Some(sampling) = self.light_sampling.filter(|l| shares && l.reuses() && self.is_live()) {
            let rule = "looks back at the last iteration of the same picture; with --interleave, --history or --upsample take ris";
            return wrong("--light-sampling", &sampling, rule.to_owned());
        }
        if shares && self.restir_memory > 0.0 {
            let rule = "is an option of path; raster and twin keep the light points of one iteration and their maps, no older ones";
            return wrong("--restir-memory", &self.restir_memory, rule.to_owned());
        }
        self.check_foreign()
    }

    /// Ends at [`DEFAULT_TARGET_ERROR`], or after [`DEFAULT_BUDGET`]: what the program does where no end is
    /// asked for.
    pub fn end_by_default(&mut self) {
        (self.target_error, self.budget) = (Some(DEFAULT_TARGET_ERROR), Some(DEFAULT_BUDGET));
    }

    /// Whether pictures are asked to be filtered frame by frame rather than only summed. Where it is left to the plan, the plan says
    /// ([`crate::plan::FramePlan::is_live`]).
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.interleaves() || self.history > 0 || self.upsample > 1
    }

    fn interleaves(&self) -> bool {
        self.interleave.is_some_and(|side| side > 1)
    }

    /// Whether tiles of pictures that are not filtered may settle: take no more samples once they are as near to the truth as asked for.
    /// A raster plan that chooses to filter says otherwise ([`crate::plan::FramePlan::settles`]).
    #[must_use]
    pub fn settles(&self) -> bool {
        self.target_error.is_some() && !self.is_live()
    }

    /// Exponent of the MIS heuristic.
    #[must_use]
    pub fn beta(&self) -> f32 {
        self.beta.unwrap_or(if self.method.shares_subpaths() { 1.0 } else { 2.0 })
    }

    fn resolutions(&self) -> [(&'static str, Option<u32>); 3] {
        [
            ("--bundle-resolution", self.bundle_resolution),
            ("--light-resolution", self.light_resolution),
            ("--vpl-resolution", self.vpl_resolution),
        ]
    }

    /// What belongs to other methods has to stay at its default: ignoring it in silence would mislead.
    fn check_foreign(&self) -> Result<(), OutOfRange> {
        let default = Self::default();
        let shares = self.method.shares_subpaths();
        let raster = self.method == Method::Raster;
        let judge = self.method == Method::Reference;
        let visibility = (self.visibility != default.visibility && !raster).then(|| self.visibility.to_string());
        let strategies = (self.strategies != default.strategies && !shares).then(|| self.strategies.to_string());
        let clamp = (self.paper_clamp != default.paper_clamp && !shares).then(|| self.paper_clamp.to_string());
        let lobes = (self.clamp_samples != default.clamp_samples && !shares).then(|| self.clamp_samples.to_string());
        let room = (self.list_room != default.list_room && !raster).then(|| self.list_room.to_string());
        let live = |option, value: u32, default: u32| {
            (option, (value != default && !shares).then(|| value.to_string()), "raster and twin")
        };
        let sampling = self.light_sampling.filter(|l| judge || (shares && *l == LightSampling::Tree));
        let resampling = self.light_sampling.filter(|l| l.resamples() && self.method == Method::RayQuery);
        let reuses = (shares || self.method == Method::Path) && self.light_sampling.is_some_and(LightSampling::reuses);
        let bias = (self.restir_bias != default.restir_bias && !reuses).then(|| self.restir_bias.to_string());
        let memory = (self.restir_memory != default.restir_memory && !reuses).then(|| self.restir_memory.to_string());
        let changed = [
            ("--visibility", visibility, "raster"),
            ("--list-room", room, "raster"),
            ("list lengths", (self.list_lengths && !raster).then(|| "true".to_owned()), "raster"),
            ("--strategies", strategies, "raster and twin"),
            ("--band-pixels", self.band_pixels.filter(|_| !shares).map(|n| n.to_string()), "raster and twin"),
            ("--clamp-samples", lobes, "raster and twin"),
            ("--paper-clamp", clamp, "raster and twin"),
            ("--light-pool", self.light_pool.filter(|_| !shares).map(|n| n.to_string()), "raster and twin"),
            ("--beta", self.beta.filter(|_| judge).map(|b| b.to_string()), "raster, twin, ray-query and path"),
            ("--light-sampling", sampling.map(|l| l.to_string()), "ray-query and path"),
            ("--light-sampling", resampling.map(|l| l.to_string()), "raster, twin and path"),
            live("--interleave", self.interleave.unwrap_or(1), 1),
            live("--history", self.history, default.history),
            live("--upsample", self.upsample, default.upsample),
            ("--restir-bias", bias, "raster, twin and path with --light-sampling restir"),
            ("--restir-memory", memory, "path with --light-sampling restir"),
        ];
        let resolutions =
            self.resolutions().map(|(option, r)| (option, r.filter(|_| !raster).map(|r| r.to_string()), "raster"));
        match changed.into_iter().chain(resolutions).find_map(|(option, value, whose)| Some((option, value?, whose))) {
            Some((option, value, whose)) => {
                Err(OutOfRange { option, value, rule: format!("is an option of {whose}, not of {}", self.method) })
            }
            None => Ok(()),
        }
    }
}

fn span<T: fmt::Display>(range: &RangeInclusive<T>) -> String {
    format!("{} to {}", range.start(), range.end())
}

/// `auto` or a side, as the command line takes them.
fn sides_of_squares() -> impl TypedValueParser<Value = Interleave> {
    PossibleValuesParser::new([AUTO, "1", "2", "3", "4", "5", "6", "7", "8"]).map(|text| text.parse().ok())
}

/// `unlimited` or a number, as the command line takes bounces.
///
/// # Errors
/// A sentence where it is neither.
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

    #[test]
    fn each_range_has_two_ends() {
        let base = Settings::default();
        assert_eq!(base.check(), Ok(()));
        let reference = Settings { method: Method::Reference, ..base.clone() };
        let good = [
            Settings { width: 1, height: 16_384, ..base.clone() },
            Settings { samples: 1, ..base.clone() },
            Settings { bounces: 0, ..base.clone() },
            Settings { bounces: 64, ..base.clone() },
            Settings { bundle_resolution: Some(16), vpl_resolution: Some(2048), ..base.clone() },
            Settings { budget: Some(0.5), beta: Some(2.0), ..base.clone() },
            Settings { method: Method::RayQuery, beta: Some(1.0), ..base.clone() },
            Settings { method: Method::Twin, strategies: Strategies::Paper, paper_clamp: 0.1, ..base.clone() },
            Settings { method: Method::Path, bounces: UNLIMITED, ..base.clone() },
            Settings { bounces: UNLIMITED, ..reference.clone() },
            Settings { aperture: Some(0.0), focus: Some(1e-3), ..base.clone() },
            Settings { method: Method::Path, light_sampling: Some(LightSampling::Tree), ..base.clone() },
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
            ("--band-pixels", Settings { method: Method::Path, band_pixels: Some(4), ..base.clone() }),
            ("--light-pool", Settings { method: Method::Path, light_pool: Some(4), ..base.clone() }),
            ("--bundle-resolution", Settings { bundle_resolution: Some(15), ..base.clone() }),
            ("--light-resolution", Settings { light_resolution: Some(2049), ..base.clone() }),
            ("--vpl-resolution", Settings { vpl_resolution: Some(0), ..base.clone() }),
            ("--aperture", Settings { aperture: Some(-0.1), ..base.clone() }),
            ("--aperture", Settings { aperture: Some(f32::NAN), ..base.clone() }),
            ("--focus", Settings { focus: Some(0.0), ..base.clone() }),
            ("--light-sampling", Settings { light_sampling: Some(LightSampling::Tree), ..base.clone() }),
            ("--light-sampling", {
                Settings { method: Method::RayQuery, light_sampling: Some(LightSampling::Ris), ..base.clone() }
            }),
            ("--light-sampling", {
                Settings { light_sampling: Some(LightSampling::Restir), history: 4, ..base.clone() }
            }),
            ("--light-sampling", {
                Settings { light_sampling: Some(LightSampling::Restir), interleave: Some(2), ..base.clone() }
            }),
            ("--interleave", Settings { interleave: Some(0), ..base.clone() }),
            ("--interleave", Settings { interleave: Some(9), ..base.clone() }),
            ("--interleave", Settings { method: Method::Path, interleave: Some(2), ..base.clone() }),
            ("--unfiltered", Settings { unfiltered: true, ..base.clone() }),
            ("--tame-outliers", Settings { tame_outliers: true, ..base.clone() }),
            ("--restir-memory", {
                Settings { light_sampling: Some(LightSampling::Restir), restir_memory: 4.0, ..base.clone() }
            }),
            ("--restir-bias", Settings { restir_bias: RestirBias::Biased, ..base.clone() }),
            ("--restir-bias", Settings { method: Method::Path, restir_bias: RestirBias::Biased, ..base.clone() }),
            ("--restir-memory", Settings { restir_memory: f32::NAN, ..base.clone() }),
            ("--restir-memory", Settings { method: Method::Path, restir_memory: 4.0, ..base }),
            ("--bounces", Settings { method: Method::RayQuery, bounces: UNLIMITED, ..reference.clone() }),
            ("--beta", Settings { beta: Some(2.0), ..reference.clone() }),
            ("--visibility", Settings { method: Method::Twin, visibility: Visibility::Fast, ..reference.clone() }),
            ("--vpl-resolution", Settings { method: Method::Twin, vpl_resolution: Some(64), ..reference.clone() }),
            ("--visibility", Settings { visibility: Visibility::Fast, ..reference.clone() }),
            ("--strategies", Settings { method: Method::RayQuery, strategies: Strategies::Vpl, ..reference.clone() }),
            ("--light-resolution", Settings { method: Method::Path, light_resolution: Some(64), ..reference.clone() }),
            ("--strategies", Settings { strategies: Strategies::Vpl, ..reference.clone() }),
            ("--vpl-resolution", Settings { vpl_resolution: Some(64), ..reference }),
        ];
        for (option, settings) in bad {
            assert_eq!(settings.check().map_err(|e| e.option), Err(option), "{settings:?}");
        }
    }
}
