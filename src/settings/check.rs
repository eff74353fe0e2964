//! The ranges of all settings, and which settings go together.

use std::fmt;
use std::ops::RangeInclusive;

use super::{LightSampling, Method, Settings, UNLIMITED, Visibility};

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

    /// Checks the numbers of bounces. `path` and the reference accept unlimited bounces.
    fn check_bounces(&self) -> Result<(), OutOfRange> {
        within("--specular-bounces", Some(self.specular_bounces), &BOUNCES, "")?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{RestirBias, Strategies, Technique};

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
