//! `compare`: an image against a reference.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;

use lightsheaf::film::Film;
use lightsheaf::metrics::{self, Comparison};

use super::output;

#[derive(clap::Args)]
pub struct CompareArgs {
    /// The image: .exr, .hdr, or .png (its tone map is undone)
    image: PathBuf,
    /// What it should be
    reference: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Write the signed relative error of each pixel: red too bright, blue too dark
    #[arg(long, value_name = "OUT.png")]
    heatmap: Option<PathBuf>,
    /// Exit with 1 if rel_mse is above this
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    max_rel_mse: Option<f64>,
    /// Exit with 1 if mean_bias is further from 0 than this (0.01 is one percent)
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    max_bias: Option<f64>,
}

/// Compares, prints, and answers 0 or, above a threshold, 1.
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
        // NaN, which an image with holes has, is within no limit.
        if let Some(limit) = limit.filter(|limit| !(..=*limit).contains(&value)) {
            eprintln!("exceeded: {name} {value:.6} is not within {limit}");
            code = ExitCode::from(1);
        }
    }
    Ok(code)
}

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
