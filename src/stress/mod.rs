//! Stress tests: unusual scenes, sizes and values, which users can run on their own drivers.
//!
//! A case is data: a name, the expected result, and a function that renders and describes the observed
//! result. After each case, the runner checks the device for errors, every pass for values that are not
//! finite ([`crate::gpu::NonFinite`]), and the messages of the validation layers ([`messages`]). A case that
//! panics has failed; the others still run.

mod cases;
pub mod messages;
mod scenes;

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use crate::film::Film;
use crate::gpu::{Gpu, GpuError};
use crate::render::{self, RenderError, RenderStats};
use crate::scene::Scene;
use crate::settings::{Settings, Technique};

pub use cases::CASES;

/// Description of an observed result, with numbers: `Ok` if it is right, `Err` if it is wrong.
pub type Seen = Result<String, String>;

/// A stress test.
#[derive(Clone, Copy)]
pub struct Case {
    /// Short description of the unusual property.
    pub name: &'static str,
    /// Expected result.
    pub right: &'static str,
    /// Methods to test; the short run uses only the first.
    pub methods: &'static [Technique],
    /// True if the short run omits the case.
    pub long: bool,
    /// Renders, and describes the observed result.
    pub run: fn(&Stage) -> Seen,
}

/// Device and method of a case.
pub struct Stage<'a> {
    /// Device, with checks for values that are not finite.
    pub gpu: &'a Gpu,
    /// Technique of the rendering.
    pub method: Technique,
}

impl Stage<'_> {
    /// Renders a picture and checks that all values are finite. Returns it with its statistics.
    /// `settings.method` is replaced by the case's method.
    ///
    /// # Errors
    /// Returns a message if rendering fails or a value is not finite.
    pub fn render(&self, scene: &Scene, settings: &Settings) -> Result<(Film, RenderStats), String> {
        let settings = Settings { technique: self.method, ..settings.clone() };
        self.gpu.non_finite.watch(self.gpu, true);
        let (film, stats) = picture(self.gpu, scene, &settings)?;
        let counts = self.gpu.non_finite.counts(self.gpu).map_err(|e| e.to_string())?;
        self.gpu.non_finite.watch(self.gpu, false);
        if let Some((pass, count)) = counts.iter().find(|(_, count)| *count > 0) {
            return Err(format!("{count} values that are not finite, first seen after the pass {pass}"));
        }
        // The film counts its own values that are not finite.
        match film.non_finite() + stats.non_finite {
            0 => Ok((film, stats)),
            count => Err(format!("{count} values of the film are not finite")),
        }
    }
}

fn picture(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Result<(Film, RenderStats), String> {
    let render = || {
        let mut renderer = render::open(gpu, scene, settings)?;
        renderer.render(u64::from(settings.samples), &mut |_| true)?;
        Ok((renderer.film()?, renderer.stats()))
    };
    render().map_err(|e: RenderError| e.to_string())
}

/// Result of a case by one method.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Row {
    /// Name of the case.
    pub name: &'static str,
    /// Technique of the rendering.
    #[serde(serialize_with = "as_text")]
    pub method: Technique,
    /// Expected result.
    pub right: &'static str,
    /// Observed result.
    pub seen: String,
    /// True if the observed result is right.
    pub passed: bool,
    /// Duration of the case, seconds.
    pub seconds: f64,
}

/// Writes a technique as it is shown.
fn as_text<S: serde::Serializer>(technique: &Technique, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(technique)
}

/// Results of all cases.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// Version of this program.
    pub version: &'static str,
    /// Name and driver of the device.
    pub device: String,
    /// Results by case and method, in the order of the cases.
    pub rows: Vec<Row>,
    /// Number of wrong results.
    pub failed: usize,
}

/// Selects cases and methods. The short run uses the first method of each case and omits long cases;
/// otherwise all methods that the device supports are used.
#[must_use]
pub fn select<'a>(cases: &'a [Case], short: bool, ray_queries: bool) -> Vec<(&'a Case, Technique)> {
    let of = |case: &'a Case| {
        let methods = case.methods.iter().filter(move |m| ray_queries || !m.needs_ray_queries());
        methods.take(if short { 1 } else { usize::MAX }).map(move |&method| (case, method))
    };
    cases.iter().filter(|case| !(short && case.long)).flat_map(of).collect()
}

/// Runs cases in sequence; `progress` is called before each.
///
/// # Errors
/// Returns [`GpuError`] if no device can be opened. Failures of cases are part of the report.
pub fn run(selected: &[(&Case, Technique)], progress: &dyn Fn(usize, &Case, Technique)) -> Result<Report, GpuError> {
    let rays = selected.iter().any(|(_, method)| method.needs_ray_queries());
    let mut gpu = Gpu::validated(rays)?;
    let device = gpu.capabilities.adapter.clone();
    let mut rows = Vec::new();
    for (i, &(case, method)) in selected.iter().enumerate() {
        progress(i, case, method);
        messages::take();
        let began = Instant::now();
        let stage = Stage { gpu: &gpu, method };
        let seen = catch_unwind(AssertUnwindSafe(|| (case.run)(&stage)))
            .unwrap_or_else(|panic| Err(format!("it panicked: {}", words_of(panic.as_ref()))));
        let seen = verdict(seen, gpu.check(), messages::take());
        rows.push(Row {
            name: case.name,
            method,
            right: case.right,
            passed: seen.is_ok(),
            // Messages of drivers are joined into one line.
            seen: seen.unwrap_or_else(|e| e).split_whitespace().collect::<Vec<_>>().join(" "),
            seconds: began.elapsed().as_secs_f64(),
        });
        // A device that has reported an error continues to report it, so another one is opened.
        if gpu.check().is_err() {
            gpu = Gpu::validated(rays)?;
        }
    }
    let failed = rows.iter().filter(|row| !row.passed).count();
    Ok(Report { version: env!("CARGO_PKG_VERSION"), device, rows, failed })
}

/// Errors of the device and messages of the validation layers make any case wrong.
fn verdict(seen: Seen, device: Result<(), GpuError>, messages: Vec<String>) -> Seen {
    let mut faults: Vec<String> = seen.as_ref().err().cloned().into_iter().collect();
    // The case itself may have failed with the device's message.
    faults.extend(device.err().map(|e| e.to_string()).filter(|e| !faults.contains(e)));
    faults.extend(messages);
    if faults.is_empty() { seen } else { Err(faults.join("; ")) }
}

fn words_of(panic: &(dyn std::any::Any + Send)) -> &str {
    panic
        .downcast_ref::<String>()
        .map(String::as_str)
        .or(panic.downcast_ref::<&str>().copied())
        .unwrap_or("without a word")
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let width = self.rows.iter().map(|row| row.name.len()).max().unwrap_or(0);
        writeln!(f, "{:<width$}  {:<9}  {:<5}  {:>7}  seen", "case", "method", "", "seconds")?;
        for row in &self.rows {
            let Row { name, method, seen, seconds, .. } = row;
            let verdict = if row.passed { "right" } else { "WRONG" };
            writeln!(f, "{name:<width$}  {:<9}  {verdict}  {seconds:>7.2}  {seen}", method.to_string())?;
            if !row.passed {
                writeln!(f, "{:width$}  right is: {}", "", row.right)?;
            }
        }
        let right = self.rows.len() - self.failed;
        write!(f, "{right} of {} right on {}", self.rows.len(), self.device)
    }
}
