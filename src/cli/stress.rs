//! Command `stress`: renders extreme scenes on this device and checks the results.

use std::process::ExitCode;

use anyhow::{Result, bail};
use indicatif::{ProgressBar, ProgressStyle};

use crate::gpu::Gpu;
use crate::stress::{CASES, Case, Report, run as run_cases, select};

use super::output;

#[derive(clap::Args)]
pub struct StressArgs {
    /// Run only cases whose name contains this text [default: all]
    case: Option<String>,
    /// Run each case with raster only and omit the long run. Takes half a minute
    #[arg(long)]
    short: bool,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the cases and prints the report. Returns exit code 1 if any case is wrong.
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

/// Returns the exit code of a report.
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
