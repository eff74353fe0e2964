//! Report of a benchmark: a self-contained HTML file, and its numbers as JSON, CSV and Markdown.

mod chart;
mod html;
mod text;

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;

use crate::bench::curve::{self, Spread};
use crate::bench::truth::Origin;
use crate::bench::{BenchError, Details, Entry, Run, Schedule, Truth};
use crate::film::Film;

/// Names of the files of [`Report::files`].
pub const FILES: [&str; 4] = ["report.html", "report.json", "report.csv", "report.md"];

/// Computer of the measurement.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Name of the processor.
    pub cpu: String,
    /// Threads that this process may use at once.
    pub threads: usize,
    /// Operating system and architecture.
    pub system: String,
    /// Load averages of 1, 5 and 15 minutes at the start of the benchmark, if the system reports them.
    pub load: Option<String>,
}

impl Machine {
    /// Describes this computer and its current load.
    #[must_use]
    pub fn here() -> Self {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let value = |line: &str| Some(line.split_once([':', '='])?.1.trim().trim_matches('"').to_owned());
        let find = |text: &str, key: &str| text.lines().find(|line| line.starts_with(key)).and_then(value);
        let system = find(&read("/etc/os-release"), "PRETTY_NAME").unwrap_or_else(|| std::env::consts::OS.to_owned());
        let load = read("/proc/loadavg").split_whitespace().take(3).collect::<Vec<_>>().join(" ");
        Self {
            cpu: find(&read("/proc/cpuinfo"), "model name").unwrap_or_else(|| "unknown processor".to_owned()),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{system}, {}", std::env::consts::ARCH),
            load: Some(load).filter(|load| !load.is_empty()),
        }
    }
}

/// Measurements of a benchmark, with their conditions.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of this program.
    pub version: &'static str,
    /// Command line, quoted for a shell.
    pub command: String,
    /// Start of the benchmark in seconds since 1970.
    pub unix_seconds: u64,
    /// Computer of the measurement.
    pub machine: Machine,
    /// Budget, checkpoints and repeats.
    pub schedule: Schedule,
    /// Number of indirect bounces. None if unlimited.
    pub bounces: Option<u32>,
    /// Errors for which the tables list the time.
    pub targets: Vec<f64>,
    /// Seconds for which the tables list the error.
    pub times: Vec<f64>,
    /// Results of each scene.
    pub scenes: Vec<SceneReport>,
}

/// Results of a scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneReport {
    /// Name on the command line.
    pub name: String,
    /// Columns of the pictures.
    pub width: u32,
    /// Rows of the pictures.
    pub height: u32,
    /// Origin of the reference.
    pub reference: Origin,
    /// Contenders in the order of the command line.
    pub entries: Vec<EntryReport>,
    /// Names of contenders that could not begin, with the reason.
    pub refusals: Vec<(String, String)>,
    #[serde(skip)]
    truth: Film,
}

/// Results of a contender.
#[derive(Clone, Debug, Serialize)]
pub struct EntryReport {
    /// Name on the command line.
    pub name: String,
    /// Description, times of passes and memory.
    #[serde(flatten)]
    pub details: Details,
    /// Seconds until the first sample was finished, which are not part of any other time.
    pub startup_seconds: f64,
    /// Cause of an early end.
    pub failure: Option<String>,
    /// Median seconds after which the error stays at or below each target.
    pub time_to: Vec<Option<Spread>>,
    /// Mean error at each time.
    pub error_at: Vec<Option<Spread>>,
    /// Repeats.
    pub runs: Vec<Run>,
    #[serde(skip)]
    picture: Option<Film>,
}

impl Report {
    /// Creates an empty report. Tables list the errors at the budget and at a tenth and three tenths of it.
    #[must_use]
    pub fn new(command: String, machine: Machine, schedule: Schedule, bounces: Option<u32>, targets: Vec<f64>) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            command,
            unix_seconds: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
            machine,
            times: [0.1, 0.3, 1.0].map(|part| part * schedule.budget).to_vec(),
            schedule,
            bounces,
            targets,
            scenes: Vec::new(),
        }
    }

    /// Adds the results of a scene.
    pub fn add(&mut self, name: String, truth: &Truth, entries: &[Entry], refusals: Vec<(String, String)>) {
        let entries = entries.iter().map(|entry| self.entry(entry)).collect();
        let Film { width, height, .. } = truth.film;
        let reference = truth.origin.clone();
        self.scenes.push(SceneReport { name, width, height, reference, entries, refusals, truth: truth.film.clone() });
    }

    fn entry(&self, entry: &Entry) -> EntryReport {
        let curves: Vec<_> = entry.runs.iter().map(|run| run.curve(|c| c.error)).collect();
        let time_to =
            |&target: &f64| curve::median_time(&curves.iter().map(|c| curve::time_to(c, target)).collect::<Vec<_>>());
        let error_at =
            |&time: &f64| curve::mean_error(&curves.iter().map(|c| curve::error_at(c, time)).collect::<Vec<_>>());
        EntryReport {
            name: entry.name.clone(),
            details: entry.details(),
            startup_seconds: entry.startup,
            failure: entry.failure.clone(),
            time_to: self.targets.iter().map(time_to).collect(),
            error_at: self.times.iter().map(error_at).collect(),
            runs: entry.runs.clone(),
            picture: entry.picture.clone(),
        }
    }

    /// Returns the contents of [`FILES`], in their order.
    ///
    /// # Errors
    /// Returns [`BenchError::Report`] if a picture or chart cannot be drawn.
    pub fn files(&self) -> Result<[String; 4], BenchError> {
        let json = serde_json::to_string_pretty(self).map_err(|e| drawing(&e))? + "\n";
        Ok([html::page(self)?, json, text::csv(self), text::markdown(self)])
    }

    /// Writes all files into a folder.
    ///
    /// # Errors
    /// Returns [`BenchError::Report`] if a file cannot be drawn or written.
    pub fn write(&self, folder: &Path) -> Result<(), BenchError> {
        for (name, contents) in FILES.iter().zip(self.files()?) {
            let path = folder.join(name);
            std::fs::write(&path, contents)
                .map_err(|e| BenchError::Report(format!("{}: cannot be written: {e}", path.display())))?;
        }
        Ok(())
    }
}

impl EntryReport {
    /// Returns the sum of the samples per pixel of the last pictures of all repeats.
    fn samples(&self) -> u64 {
        self.runs.iter().filter_map(|run| run.checkpoints.last()).map(|c| c.samples).sum()
    }

    /// Returns the mean bias of the last pictures, averaged over repeats.
    fn mean_bias(&self) -> Option<f64> {
        let last: Vec<f64> =
            self.runs.iter().filter_map(|run| run.checkpoints.last()).map(|c| c.comparison.mean_bias).collect();
        (!last.is_empty()).then(|| last.iter().sum::<f64>() / last.len() as f64)
    }
}

/// Converts an error of a drawing library.
fn drawing(cause: &dyn std::fmt::Display) -> BenchError {
    BenchError::Report(format!("the report cannot be drawn: {cause}"))
}
