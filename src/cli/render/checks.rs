//! Checks of options before anything is loaded or rendered.

use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::{Context as _, Result, bail};

use super::RenderArgs;
use crate::cli::view::GradeArgs;
use crate::cli::{checkpoint, output};
use crate::film::has_extension;
use crate::settings::{Method, SAMPLES, Settings, UNLIMITED};

/// Seconds between two checkpoints.
const CHECKPOINTS: RangeInclusive<f64> = 1.0..=604_800.0;

/// Checks the options of the output before anything is loaded.
pub(super) fn outputs(args: &RenderArgs) -> Result<()> {
    for path in &args.output {
        output::check(path, &["exr", "png"])?;
    }
    if args.check_values && args.view.settings.method() == Method::Reference {
        bail!("--check-values: the reference has no passes; use another method");
    }
    if let Some(stats) = &args.stats {
        output::check(stats, &["json"])?;
    }
    if args.skip_existing && args.frames.is_none() && args.turntable.is_none() {
        bail!(
            "--skip-existing: is for --frames and --turntable; a single picture goes on by --checkpoint and --resume"
        );
    }
    args.layers.check(args.keeps_layers(), args.writes_png())?;
    if args.layers.renders_light() && args.view.settings.history > 0 {
        bail!("layers of light: frames with --history hold a part of those before; leave it out");
    }
    if let Some(seconds) = args.checkpoint {
        if !CHECKPOINTS.contains(&seconds) {
            bail!("--checkpoint {seconds}: has to be {} to {} seconds", CHECKPOINTS.start(), CHECKPOINTS.end());
        }
        let Some(output) = args.output.first() else {
            bail!("--checkpoint: the checkpoint lies beside the picture; give --output")
        };
        output::check(&checkpoint::path_of(output), &["checkpoint"])?;
    }
    if let Some(range) = args.sample_range.filter(|range| range.last > (*SAMPLES.end()).into()) {
        bail!("--sample-range {range}: the last sample has to be {} at most", SAMPLES.end());
    }
    let GradeArgs { exposure, tonemap } = &args.grade;
    for (option, given) in [("--exposure", exposure.is_some()), ("--tonemap", tonemap.is_some())] {
        if given && !args.writes_png() {
            bail!("{option}: {} holds linear radiance; write a .png, or omit the option", args.shown_name());
        }
    }
    Ok(())
}

/// Checks that files tell which frames are complete.
pub(super) fn skipping(args: &RenderArgs, settings: &Settings) -> Result<()> {
    if !args.output.iter().any(|path| has_extension(path, "exr")) {
        bail!("--skip-existing: only an .exr says how it was made; give one by -o");
    }
    if settings.target_error.is_some() || settings.budget.is_some() {
        bail!("--skip-existing: files do not say whether they reached an error or a time; give --samples");
    }
    if settings.history > 0 {
        bail!("--skip-existing: frames with --history depend on those before; leave one of the two out");
    }
    Ok(())
}

/// Checks that strategy images are available, and creates their folder.
pub(super) fn strategy_images(folder: &Path, settings: &Settings) -> Result<()> {
    if settings.method() == Method::Reference {
        bail!("--strategy-images: the reference has none; use another method");
    }
    if settings.bounces == UNLIMITED {
        bail!("--strategy-images: unlimited bounces have an unlimited number of strategies; give --bounces a number");
    }
    std::fs::create_dir_all(folder).with_context(|| format!("--strategy-images {}", folder.display()))
}
