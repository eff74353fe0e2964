//! Text of the report: numbers, tables, CSV and Markdown.

use std::fmt::Write as _;

use crate::bench::Spread;

use super::{EntryReport, Report, SceneReport};

/// Formats a positive number with two significant digits, or three from 10 on.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let exponent = value.abs().log10().floor();
    match exponent as i32 {
        ..-5 => format!("{value:.1e}"),
        exponent @ ..1 => format!("{value:.*}", (1 - exponent) as usize),
        1 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

/// Formats middle and range: `0.0012 (0.0011 to 0.0014)`.
pub fn spread(spread: Option<Spread>) -> String {
    let Some(Spread { middle, low, high, at_most }) = spread else { return "-".to_owned() };
    let most = if at_most { "<= " } else { "" };
    match high {
        Some(high) if high == low => format!("{most}{}", short(middle)),
        Some(high) => format!("{most}{} ({} to {})", short(middle), short(low), short(high)),
        None => format!("{most}{} ({} to never)", short(middle), short(low)),
    }
}

/// Returns the table of a scene: the header, then a row for each contender.
pub fn table(report: &Report, scene: &SceneReport) -> Vec<Vec<String>> {
    let mut heads = vec!["method".to_owned()];
    heads.extend(report.targets.iter().map(|target| format!("s to rel_mse {}", short(*target))));
    heads.extend(report.times.iter().map(|time| format!("rel_mse at {} s", short(*time))));
    heads.extend(["mean_bias", "samples per repeat", "start-up s", "MB on the device"].map(str::to_owned));
    let mut rows = vec![heads];
    rows.extend(scene.entries.iter().map(row));
    rows
}

fn row(entry: &EntryReport) -> Vec<String> {
    let mut cells = vec![entry.name.clone()];
    cells.extend(entry.time_to.iter().chain(&entry.error_at).map(|s| spread(*s)));
    cells.push(entry.mean_bias().map_or_else(|| "-".to_owned(), |bias| format!("{:+.2} %", 100.0 * bias)));
    cells.push((entry.samples() / entry.runs.len().max(1) as u64).to_string());
    cells.push(short(entry.startup_seconds));
    cells.push(entry.details.bytes.map_or_else(|| "-".to_owned(), |bytes| short(bytes as f64 / 1e6)));
    cells
}

/// Returns the table of device time in milliseconds per sample: a row for each pass, a column for each
/// contender that measures passes.
pub fn pass_table(scene: &SceneReport) -> Vec<Vec<String>> {
    let entries: Vec<_> =
        scene.entries.iter().filter(|e| e.details.passes.values().any(|p| p.gpu_millis > 0.0)).collect();
    let mut passes: Vec<&str> = entries.iter().flat_map(|e| e.details.passes.keys().copied()).collect();
    passes.sort_unstable();
    passes.dedup();
    if passes.is_empty() {
        return Vec::new();
    }
    let mut rows = vec![std::iter::once("pass".to_owned()).chain(entries.iter().map(|e| e.name.clone())).collect()];
    let millis = |entry: &EntryReport, pass: &str| {
        let time = entry.details.passes.get(pass)?.gpu_millis / entry.samples().max(1) as f64;
        Some(time)
    };
    let show = |time: Option<f64>| time.map_or_else(|| "-".to_owned(), short);
    for pass in passes {
        rows.push(std::iter::once(pass.to_owned()).chain(entries.iter().map(|e| show(millis(e, pass)))).collect());
    }
    let all = |entry: &EntryReport| entry.details.passes.keys().filter_map(|pass| millis(entry, pass)).sum();
    rows.push(std::iter::once("all".to_owned()).chain(entries.iter().map(|e| show(Some(all(e))))).collect());
    rows
}

/// Describes the reference in one sentence.
pub fn reference(scene: &SceneReport) -> String {
    let origin = &scene.reference;
    let made = match origin.samples {
        0 => String::new(),
        samples => format!(", {samples} samples in {} s", short(origin.seconds)),
    };
    let own = match origin.own_rel_mse {
        Some(own) => format!("its own rel_mse, {}, is subtracted", short(own)),
        None => "its own error is unknown and not subtracted".to_owned(),
    };
    format!("Reference: {}{made}; {own}.", origin.how)
}

/// Describes the method of measurement and its bias between contenders.
pub fn method(report: &Report) -> Vec<String> {
    let schedule = &report.schedule;
    let bounces = report.bounces.map_or_else(|| "unlimited bounces".to_owned(), |n| format!("{n} indirect bounces"));
    vec![
        format!(
            "{} s for each method, scene and repeat; {} repeats with separate seeds; {bounces}. Methods render in turns on the \
             same machine: the method that has used the least time renders next.",
            short(schedule.budget),
            schedule.seeds.len()
        ),
        "Time is the wall-clock time of rendering calls. Start-up (loading, device, pipelines, a first sample), reading back \
         pictures and comparing them are not counted."
            .to_owned(),
        "rel_mse is the mean of (x - r)^2 / (r^2 + 0.01). The time to a target is the median over the repeats of the time from \
         which on the error stays at or below the target. Errors are means over the repeats. The range over the repeats is in \
         parentheses."
            .to_owned(),
        "Other programs render each picture from scratch with the number of samples known in advance, which favours them: a \
         point of their curve is the time of that picture alone, and their sampling patterns are not truncated. Scenes are \
         translated for programs that do not read Mitsuba files. On a software driver, methods for GPUs run on the CPU."
            .to_owned(),
    ]
}

fn cell(text: &str) -> String {
    text.replace('|', "\\|")
}

fn markdown_table(rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.iter().map(|c| cell(c)).collect::<Vec<_>>().join(" | "));
    let Some((heads, rows)) = rows.split_first() else { return String::new() };
    let rule = format!("|{}\n", "---|".repeat(heads.len()));
    line(heads) + &rule + &rows.iter().map(|row| line(row)).collect::<String>()
}

/// Returns the report's tables in Markdown.
pub fn markdown(report: &Report) -> String {
    let machine = &report.machine;
    let mut out = format!(
        "# Run time against error\n\nlightsheaf {}; {}, {} threads; {}{}.\n\n    {}\n\n{}\n",
        report.version,
        machine.cpu,
        machine.threads,
        machine.system,
        machine.load.as_ref().map(|load| format!("; load {load}")).unwrap_or_default(),
        report.command,
        method(report).join("\n\n"),
    );
    for scene in &report.scenes {
        // Writing to a string cannot fail.
        let _ = write!(
            out,
            "\n## {}, {}x{}\n\n{}\n\n{}",
            scene.name,
            scene.width,
            scene.height,
            reference(scene),
            markdown_table(&table(report, scene))
        );
        let about = scene.entries.iter().map(|e| format!("- {}: {}", e.name, e.details.about));
        let failed =
            scene.entries.iter().filter_map(|e| Some(format!("- {} ended early: {}", e.name, e.failure.as_ref()?)));
        let refused = scene.refusals.iter().map(|(name, why)| format!("- {name} did not take part: {why}"));
        let notes: Vec<_> = about.chain(failed).chain(refused).collect();
        let _ = write!(out, "\n{}\n", notes.join("\n"));
        let passes = pass_table(scene);
        if !passes.is_empty() {
            let _ = write!(out, "\nDevice time in milliseconds per sample:\n\n{}", markdown_table(&passes));
        }
    }
    out
}

/// Returns all checkpoints as CSV, one per line.
pub fn csv(report: &Report) -> String {
    let mut out = "scene,width,height,method,seed,samples,seconds,error,rel_mse,reference_rel_mse,mse,mean_bias,p999,flip,non_finite\n"
        .to_owned();
    for scene in &report.scenes {
        for entry in &scene.entries {
            for run in &entry.runs {
                for checkpoint in &run.checkpoints {
                    let c = &checkpoint.comparison;
                    let own = scene.reference.own_rel_mse.map(|own| own.to_string()).unwrap_or_default();
                    let cells = [
                        field(&scene.name),
                        scene.width.to_string(),
                        scene.height.to_string(),
                        field(&entry.name),
                        run.seed.to_string(),
                        checkpoint.samples.to_string(),
                        checkpoint.seconds.to_string(),
                        checkpoint.error.to_string(),
                        c.rel_mse.to_string(),
                        own,
                        c.mse.to_string(),
                        c.mean_bias.to_string(),
                        c.p999.to_string(),
                        c.flip.to_string(),
                        c.non_finite.to_string(),
                    ];
                    out += &(cells.join(",") + "\n");
                }
            }
        }
    }
    out
}

/// Quotes a field of a CSV file if necessary (RFC 4180).
fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_the_digits_that_count() {
        let shown = [0.00123, 0.0555, 0.999, 1.26, 9.96, 12.34, 123.4, 4567.0, 0.000_001_23, 0.0].map(short);
        assert_eq!(shown, ["0.0012", "0.056", "1.00", "1.3", "10.0", "12.3", "123", "4567", "1.2e-6", "0"]);
        assert_eq!(short(f64::NAN), "NaN");
    }

    #[test]
    fn spreads_say_what_they_are() {
        let base = Spread { middle: 2.0, low: 1.0, high: Some(4.0), at_most: false };
        assert_eq!(spread(Some(base)), "2.0 (1.0 to 4.0)");
        assert_eq!(spread(Some(Spread { high: None, ..base })), "2.0 (1.0 to never)");
        assert_eq!(spread(Some(Spread { low: 2.0, high: Some(2.0), at_most: true, ..base })), "<= 2.0");
        assert_eq!(spread(None), "-");
    }

    #[test]
    fn fields_and_cells_are_quoted() {
        assert_eq!(field("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(field("plain"), "plain");
        assert_eq!(markdown_table(&[vec!["a|b".into()], vec!["1".into()]]), "| a\\|b |\n|---|\n| 1 |\n");
    }
}
