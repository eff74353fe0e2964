//! A battery of odd scenes, sizes and values: what a user runs on a driver of their own, and what holds this program to it.
//!
//! A case is data: its name, what is right, and a function that renders and says what was seen. Around each one the device is
//! asked for errors, every pass is watched for values that are not finite ([`crate::gpu::NonFinite`]), and what validation layers
//! say is heard ([`messages`]). A case that panics has failed, and the others go on.

mod cases;
pub mod messages;
mod scenes;

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

use crate::film::Film;
use crate::gpu::{Gpu, GpuError};
use crate::path_renderer::PathRenderer;
use crate::renderer::{Progressive, RenderStats, Renderer};
use crate::scene::Scene;
use crate::settings::{Method, Settings};

pub use cases::CASES;

/// What was seen: right, or wrong; in either case in words, with the numbers.
pub type Seen = Result<String, String>;

/// A case of the battery.
#[derive(Clone, Copy)]
pub struct Case {
    /// What is odd about it.
    pub name: &'static str,
    /// What is right.
    pub right: &'static str,
    /// Methods that it concerns; the first alone is the short form.
    pub methods: &'static [Method],
    /// Whether it is left out of the short form.
    pub long: bool,
    /// Renders, and says what was seen.
    pub run: fn(&Stage) -> Seen,
}

/// Where a case renders.
pub struct Stage<'a> {
    /// The device, with every pass watched.
    pub gpu: &'a Gpu,
    /// By which method.
    pub method: Method,
}

impl Stage<'_> {
    /// A picture in which every value is finite, and how it was made. `settings.method` is the stage's.
    ///
    /// # Errors
    /// Why there is none, in words.
    pub fn render(&self, scene: &Scene, settings: &Settings) -> Result<(Film, RenderStats), String> {
        let settings = Settings { method: self.method, ..settings.clone() };
        self.gpu.non_finite.watch(self.gpu, true);
        let (film, stats) = picture(self.gpu, scene, &settings)?;
        let counts = self.gpu.non_finite.counts(self.gpu).map_err(|e| e.to_string())?;
        self.gpu.non_finite.watch(self.gpu, false);
        if let Some((pass, count)) = counts.iter().find(|(_, count)| *count > 0) {
            return Err(format!("{count} values that are not finite, first seen after the pass {pass}"));
        }
        // The film has a counter of its own.
        match film.non_finite() + stats.non_finite {
            0 => Ok((film, stats)),
            count => Err(format!("{count} values of the film are not finite")),
        }
    }
}

fn picture(gpu: &Gpu, scene: &Scene, settings: &Settings) -> Result<(Film, RenderStats), String> {
    let render = |renderer: &mut dyn Progressive| {
        renderer.render(u64::from(settings.samples), &mut |_| true)?;
        Ok((renderer.film()?, renderer.stats()))
    };
    if settings.method.shares_subpaths() {
        Renderer::new(gpu, scene, settings).and_then(|mut r| render(&mut r))
    } else {
        PathRenderer::new(gpu, scene, settings).and_then(|mut r| render(&mut r))
    }
    .map_err(|e| e.to_string())
}

/// A case by one method, as it went.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Row {
    /// The case.
    pub name: &'static str,
    /// How it was rendered.
    pub method: Method,
    /// What would be right.
    pub right: &'static str,
    /// What was seen.
    pub seen: String,
    /// Whether that is right.
    pub passed: bool,
    /// Seconds that it took.
    pub seconds: f64,
}

/// The whole battery, as it went.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// Version of this program.
    pub version: &'static str,
    /// The device and its driver.
    pub device: String,
    /// Cases by method, in order.
    pub rows: Vec<Row>,
    /// How many are wrong.
    pub failed: usize,
}

/// Which cases by which methods: in short form each by its first and without the long ones, otherwise all that the device can do.
#[must_use]
pub fn select<'a>(cases: &'a [Case], short: bool, ray_queries: bool) -> Vec<(&'a Case, Method)> {
    let of = |case: &'a Case| {
        let methods = case.methods.iter().filter(move |m| ray_queries || !m.traces_rays());
        methods.take(if short { 1 } else { usize::MAX }).map(move |&method| (case, method))
    };
    cases.iter().filter(|case| !(short && case.long)).flat_map(of).collect()
}

/// Runs cases one after the other; `progress` is told which one begins.
///
/// # Errors
/// [`GpuError`] where no device can be had. What goes wrong with one is in the report.
pub fn run(selected: &[(&Case, Method)], progress: &dyn Fn(usize, &Case, Method)) -> Result<Report, GpuError> {
    let rays = selected.iter().any(|(_, method)| method.traces_rays());
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
        let seen = judge(seen, gpu.check(), messages::take());
        rows.push(Row {
            name: case.name,
            method,
            right: case.right,
            passed: seen.is_ok(),
            // One line, whatever a driver says.
            seen: seen.unwrap_or_else(|e| e).split_whitespace().collect::<Vec<_>>().join(" "),
            seconds: began.elapsed().as_secs_f64(),
        });
        // A device that has reported an error goes on reporting it.
        if gpu.check().is_err() {
            gpu = Gpu::validated(rays)?;
        }
    }
    let failed = rows.iter().filter(|row| !row.passed).count();
    Ok(Report { version: env!("CARGO_PKG_VERSION"), device, rows, failed })
}

/// Errors of the device and messages of the validation layers make any case wrong.
fn judge(seen: Seen, device: Result<(), GpuError>, messages: Vec<String>) -> Seen {
    let mut faults: Vec<String> = seen.as_ref().err().cloned().into_iter().collect();
    // The case itself may have ended with the device's own words.
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
