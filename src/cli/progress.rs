//! Progress of a render: a bar for people, and lines of JSON for programs.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::output;
use crate::gpu::Listener;

/// Least time between two lines of JSON.
const EVERY: Duration = Duration::from_millis(250);

/// Steps of the bar.
const STEPS: u64 = 1000;

/// How far a picture is.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Progress {
    /// Samples of the picture.
    pub samples: u64,
    /// Samples at which the render ends, if their number is what ends it.
    pub samples_end: Option<u64>,
    /// Seconds of rendering.
    pub seconds: f64,
    /// Estimated seconds until the end.
    pub seconds_left: Option<f64>,
    /// Estimated rel_mse.
    pub estimated_error: Option<f64>,
    /// Error at which the render ends.
    pub target_error: Option<f64>,
}

impl Progress {
    /// Returns the share of the time that is over, if the end is known.
    fn share(&self) -> Option<f64> {
        self.seconds_left.map(|left| self.seconds / (self.seconds + left).max(1e-9))
    }
}

impl std::fmt::Display for Progress {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}", self.samples)?;
        if let Some(end) = self.samples_end {
            write!(f, "/{end}")?;
        }
        write!(f, " samples, {}", clock(self.seconds))?;
        if let Some(left) = self.seconds_left {
            write!(f, ", {} left", clock(left))?;
        }
        match self.estimated_error {
            Some(error) => write!(f, ", estimated rel_mse {error:.1e}"),
            None => Ok(()),
        }
    }
}

/// Formats seconds: 1:05, or 2:03:04.
fn clock(seconds: f64) -> String {
    let all = seconds.max(0.0).round() as u64;
    let (hours, minutes, seconds) = (all / 3600, all / 60 % 60, all % 60);
    if hours > 0 { format!("{hours}:{minutes:02}:{seconds:02}") } else { format!("{minutes}:{seconds:02}") }
}

/// A line of JSON.
#[derive(serde::Serialize)]
struct Line<'a> {
    /// `progress`, or `end` after the files are written.
    event: &'static str,
    /// Files of the picture.
    files: &'a [PathBuf],
    /// Reason for the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    ended_by: Option<serde_json::Value>,
    #[serde(flatten)]
    progress: &'a Progress,
}

/// Shows the progress of a picture.
pub struct Reporter {
    bar: ProgressBar,
    /// Files of the picture, if lines of JSON are asked for.
    json: Option<Vec<PathBuf>>,
    written: Option<Instant>,
    last: Progress,
}

impl Reporter {
    /// Creates a bar, which only a terminal shows, with text in front of it; or lines of JSON with the names of
    /// files.
    pub fn new(quiet: bool, prefix: String, json: Option<Vec<PathBuf>>) -> Self {
        let bar = if quiet || json.is_some() { ProgressBar::hidden() } else { ProgressBar::new(STEPS) };
        bar.set_prefix(prefix);
        let style = ProgressStyle::with_template("{prefix}{bar:30} {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        Self { bar, json, written: None, last: Progress::default() }
    }

    /// True if somebody sees the progress.
    pub fn is_shown(&self) -> bool {
        self.json.is_some() || !self.bar.is_hidden()
    }

    /// Shows the progress.
    pub fn show(&mut self, progress: Progress) {
        self.bar.set_position(progress.share().map_or(0, |share| (STEPS as f64 * share) as u64));
        self.bar.set_message(progress.to_string());
        self.last = progress;
        if self.written.is_none_or(|written| written.elapsed() >= EVERY) {
            self.write("progress", None);
        }
    }

    /// Returns what shows the shaders that a driver compiles.
    pub fn on_compilation(&self) -> Listener {
        let (bar, listed) = (self.bar.clone(), self.json.is_some());
        Box::new(move |shader, before| {
            bar.set_message(format!("compiling shaders, which this driver keeps: {shader} ({})", before + 1));
            if listed {
                let _ = output::print(&serde_json::json!({ "event": "compile", "shader": shader }).to_string());
            }
        })
    }

    /// Shows how many of several things are done, and the name of the next one.
    pub fn count(&self, name: &str, done: u64, all: u64) {
        self.bar.set_position(STEPS * done / all.max(1));
        self.bar.set_message(name.to_owned());
    }

    /// Removes the bar. The estimate of the error is the last one.
    pub fn clear(&mut self, estimated_error: Option<f64>) {
        self.last.estimated_error = estimated_error;
        self.bar.finish_and_clear();
    }

    /// Says that the files are written, and why the render ended.
    pub fn end(&mut self, ended_by: impl serde::Serialize, samples: u64, seconds: f64) {
        self.last = Progress { samples, seconds, seconds_left: Some(0.0), ..self.last.clone() };
        self.write("end", serde_json::to_value(ended_by).ok());
    }

    fn write(&mut self, event: &'static str, ended_by: Option<serde_json::Value>) {
        self.written = Some(Instant::now());
        let Some(files) = &self.json else { return };
        let line = Line { event, files, ended_by, progress: &self.last };
        // A program that no longer listens does not stop the render.
        let _ = serde_json::to_string(&line).map(|line| output::print(&line));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_a_sentence() {
        let mut progress = Progress { samples: 7, seconds: 61.2, ..Progress::default() };
        assert_eq!(progress.to_string(), "7 samples, 1:01");
        progress =
            Progress { samples_end: Some(9), seconds_left: Some(7384.0), estimated_error: Some(0.0031), ..progress };
        assert_eq!(progress.to_string(), "7/9 samples, 1:01, 2:03:04 left, estimated rel_mse 3.1e-3");
        assert!(progress.share().is_some_and(|share| (share - 61.2 / 7445.2).abs() < 1e-9));
    }
}
