//! `stress`: the battery of odd scenes on this device.

use std::process::ExitCode;

use anyhow::{Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use lightsheaf::gpu::Gpu;
use lightsheaf::stress::{CASES, Case, Report, run as run_cases, select};

use super::output;

#[derive(clap::Args)]
pub struct StressArgs {
    /// Only cases whose name contains this [default: all]
    case: Option<String>,
    /// Each case by raster alone, without the long run: half a minute
    #[arg(long)]
    short: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Runs the battery, prints the report, and answers 0 or, where anything was wrong, 1.
pub fn run(args: &StressArgs) -> Result<ExitCode> {
    let wanted = args.case.as_deref().unwrap_or_default();
    let cases: Vec<Case> = CASES.iter().filter(|case| case.name.contains(wanted)).copied().collect();
    if cases.is_empty() {
        let known: Vec<_> = CASES.iter().map(|case| case.name).collect();
        bail!("no case is called `{wanted}`; there are: {}", known.join("; "));
    }
    let ray_queries = !args.short && Gpu::with_ray_queries().is_ok();
    let selected = select(&cases, args.short, ray_queries);
    let bar = ProgressBar::new(selected.len() as u64);
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {pos}/{len} {msg}").unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let report = run_cases(&selected, &|i, case, method| {
        bar.set_position(i as u64);
        bar.set_message(format!("{} by {method}", case.name));
    })?;
    bar.finish_and_clear();
    output::print(&if args.json { serde_json::to_string_pretty(&report)? } else { report.to_string() })?;
    Ok(verdict(&report))
}

fn verdict(report: &Report) -> ExitCode {
    ExitCode::from(u8::from(report.failed > 0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_case_is_exit_code_1() {
        let report = |failed| Report { version: "", device: String::new(), rows: Vec::new(), failed };
        assert_eq!(verdict(&report(0)), ExitCode::SUCCESS);
        assert_eq!([1, 300].map(|failed| verdict(&report(failed))), [ExitCode::from(1); 2]);
    }
}
