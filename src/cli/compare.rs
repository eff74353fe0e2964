//! Command `compare`: error of an image against a reference.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;

use crate::film::Film;
use crate::metrics::{self, Comparison};

use super::output;

#[derive(clap::Args)]
pub struct CompareArgs {
    /// Image to compare: .exr, .hdr, or .png (the clip tone curve is undone)
    image: PathBuf,
    /// Reference image of the same size, in one of these formats
    reference: PathBuf,
    /// Print the metrics as JSON
    #[arg(long)]
    json: bool,
    /// Write a heat map of the signed relative error: red is too bright, blue is too dark, saturated at 100 %
    #[arg(long, value_name = "OUT.png")]
    heatmap: Option<PathBuf>,
    /// Exit with code 1 if rel_mse is above this threshold
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    max_rel_mse: Option<f64>,
    /// Exit with code 1 if the magnitude of mean_bias is above this threshold (0.01 is 1 %)
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    max_bias: Option<f64>,
}

/// Compares two images and prints the metrics. Returns exit code 1 if a threshold is exceeded.
pub fn run(args: &CompareArgs) -> Result<ExitCode> {
    for (option, limit) in [("--max-rel-mse", args.max_rel_mse), ("--max-bias", args.max_bias)] {
        if let Some(limit) = limit.filter(|&limit| !(0.0..).contains(&limit)) {
            anyhow::bail!("{option} {limit}: has to be a number that is not negative");
        }
    }
    if let Some(path) = &args.heatmap {
        output::check(path, &["png"])?;
    }
    let (image, reference) = (Film::load(&args.image)?, Film::load(&args.reference)?);
    let comparison = metrics::compare(&image, &reference)?;
    if let Some(path) = &args.heatmap {
        metrics::heatmap(&image, &reference)?.save(path)?;
    }
    output::print(&if args.json { serde_json::to_string_pretty(&comparison)? } else { table(&comparison) })?;
    let judged =
        [("rel_mse", comparison.rel_mse, args.max_rel_mse), ("mean_bias", comparison.mean_bias.abs(), args.max_bias)];
    let mut code = ExitCode::SUCCESS;
    for (name, value, limit) in judged {
        // NaN, from pixels that are not finite, exceeds every threshold.
        if let Some(limit) = limit.filter(|limit| !(..=*limit).contains(&value)) {
            eprintln!("exceeded: {name} {value:.6} is not within {limit}");
            code = ExitCode::from(1);
        }
    }
    Ok(code)
}

/// Formats the metrics, one per line.
fn table(c: &Comparison) -> String {
    let line = |name: &str, value: String| format!("{name:<11}{value:>14}");
    [
        line("size", format!("{}x{}", c.width, c.height)),
        line("mse", format!("{:.6e}", c.mse)),
        line("rel_mse", format!("{:.6}", c.rel_mse)),
        line("mean_bias", format!("{:+.4} %", 100.0 * c.mean_bias)),
        line("p999", format!("{:.4}", c.p999)),
        line("flip", format!("{:.5}", c.flip)),
        line("non_finite", c.non_finite.to_string()),
    ]
    .join("\n")
}
