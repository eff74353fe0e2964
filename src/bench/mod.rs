//! Measures error against run time. Contenders render one scene progressively, in turns, and their pictures
//! are compared with a reference at log-spaced times.
//!
//! The measured time is the wall-clock time of the calls that render. Start-up (device, upload, pipelines,
//! and a first sample, which triggers compilation in drivers), reading back the picture, and comparing it are
//! not counted. The contender that has used the least time renders next, for a small part of the budget, so
//! that other work on the machine slows all contenders down equally. A contender that accumulates samples
//! refines one picture. A contender that renders each picture from scratch ([`Contender::grows`]) doubles the
//! samples from picture to picture, and a point of its curve is the time of that picture alone. Each repeat
//! has a separate seed.
//!
//! Errors are rel_mse ([`crate::metrics`]) minus that of the reference.

pub mod contender;
pub mod curve;
pub mod peer;
pub mod truth;

pub mod report;

use std::time::Instant;

use serde::Serialize;

use crate::film::{Film, FilmError};
use crate::gpu::GpuError;
use crate::metrics::{self, CompareError, Comparison};
use crate::render::renderer::RenderError;

pub use contender::{Contender, Details, Rendered};
pub use curve::{Point, Reached, Spread};
pub use peer::{Peer, PeerCommand};
pub use truth::Truth;

/// Least number of turns into which a budget is divided.
const TURNS: f64 = 32.0;

/// Larger numbers of samples of a turn are rounded down to a multiple of this.
const BATCH: u64 = 8;

/// Intended time of the last picture from scratch as a multiple of the budget, so that the curve reaches the
/// budget.
const BEYOND: f64 = 1.05;

/// Limit of the time of all pictures of a repeat, as a multiple of the budget, for contenders that render
/// from scratch. Doubling takes three budgets.
const PATIENCE: f64 = 8.0;

/// Least error that is reported, as a fraction of the reference's own error. Smaller errors are not
/// significant.
const LEAST_ERROR: f64 = 0.25;

/// Error of a benchmark.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// Error of one of our renderers.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Error of the device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Error of an image file.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// Picture that cannot be compared with the reference.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// Error of the reference.
    #[error("the reference: {0}")]
    Truth(String),
    /// Error of the report.
    #[error("{0}")]
    Report(String),
    /// Error of another program.
    #[error("peer {name}: {cause}")]
    Peer {
        /// Name on the command line.
        name: String,
        /// Cause, and a remedy.
        cause: String,
    },
}

/// Budget, checkpoints and repeats of a benchmark.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Seconds of rendering for each contender, scene and repeat.
    pub budget: f64,
    /// Seconds at which pictures are compared with the reference, in ascending order. The last one is the
    /// budget.
    pub checkpoints: Vec<f64>,
    /// Seeds, one for each repeat.
    pub seeds: Vec<u32>,
}

impl Schedule {
    /// Creates a schedule with log-spaced checkpoints from a hundredth of the budget to the budget.
    #[must_use]
    pub fn new(budget: f64, checkpoints: usize, seeds: Vec<u32>) -> Self {
        Self { budget, checkpoints: curve::log_spaced(budget / 100.0, budget, checkpoints), seeds }
    }
}

/// Comparison of a picture with the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Checkpoint {
    /// Seconds of rendering.
    pub seconds: f64,
    /// Samples per pixel.
    pub samples: u64,
    /// rel_mse minus that of the reference, at least a quarter of the latter. Curves and tables show this
    /// value.
    pub error: f64,
    /// All metrics, with nothing subtracted.
    pub comparison: Comparison,
}

/// Repeat of a contender.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Seed of the repeat.
    pub seed: u32,
    /// Checkpoints in the order of time.
    pub checkpoints: Vec<Checkpoint>,
}

impl Run {
    /// Returns a metric against time. A picture from scratch is left out if it took longer than one with more
    /// samples.
    #[must_use]
    pub fn curve(&self, figure: impl Fn(&Checkpoint) -> f64) -> Vec<Point> {
        let mut least = f64::INFINITY;
        let mut points: Vec<Point> = Vec::new();
        for checkpoint in self.checkpoints.iter().rev().filter(|c| c.seconds > 0.0) {
            if checkpoint.seconds < least {
                least = checkpoint.seconds;
                points.push(Point { seconds: least, error: figure(checkpoint) });
            }
        }
        points.reverse();
        points
    }
}

/// Contender with its measurements.
pub struct Entry<'a> {
    /// Name in the report.
    pub name: String,
    contender: Box<dyn Contender + 'a>,
    /// Seconds until the first sample was finished.
    pub startup: f64,
    /// Repeats that were begun.
    pub runs: Vec<Run>,
    /// Seconds per sample of the warm-up.
    pace: f64,
    /// Cause of an early end.
    pub failure: Option<String>,
    /// Last picture of the first repeat.
    pub picture: Option<Film>,
}

impl<'a> Entry<'a> {
    /// Warms a contender up by rendering a sample. `began` is the time at which its start-up began.
    ///
    /// # Errors
    /// Returns the error of the first sample.
    pub fn new(name: String, mut contender: Box<dyn Contender + 'a>, began: Instant) -> Result<Self, BenchError> {
        let pace = contender.render(1)?.seconds.max(1e-9);
        contender.forget();
        let startup = began.elapsed().as_secs_f64();
        Ok(Self { name, contender, startup, runs: Vec::new(), pace, failure: None, picture: None })
    }

    /// Returns the contender's description, times of passes and memory.
    #[must_use]
    pub fn details(&self) -> Details {
        self.contender.details()
    }

    /// Compares the current picture with the reference and stores the checkpoint.
    fn measure(&mut self, rendered: Rendered, seconds: f64, truth: &Truth) -> Result<(), BenchError> {
        let film = self.contender.film()?;
        let comparison = metrics::compare(&film, &truth.film)?;
        let own = truth.origin.own_rel_mse.unwrap_or(0.0);
        let error = at_least(comparison.rel_mse - own, (LEAST_ERROR * own).max(f64::MIN_POSITIVE));
        if let [.., run] = self.runs.as_mut_slice() {
            run.checkpoints.push(Checkpoint { seconds, samples: rendered.samples, error, comparison });
        }
        if self.runs.len() == 1 {
            self.picture = Some(film);
        }
        Ok(())
    }
}

/// Returns the maximum of both values, or NaN if `value` is NaN.
fn at_least(value: f64, least: f64) -> f64 {
    if value < least { least } else { value }
}

/// Progress of a benchmark on a scene.
pub struct Progress<'a> {
    /// Contender that rendered last.
    pub name: &'a str,
    /// Index of the repeat.
    pub repeat: usize,
    /// Share of the scene's work that is finished, 0 to 1.
    pub done: f64,
}

/// Position of a contender within a repeat.
#[derive(Clone, Copy, Default)]
struct Position {
    /// Seconds of rendering; for pictures from scratch, those of the last picture.
    seconds: f64,
    samples: u64,
    /// Seconds of all pictures from scratch.
    spent: f64,
    /// Seconds per sample of the fastest picture from scratch.
    pace: Option<f64>,
    next_checkpoint: usize,
    done: bool,
}

/// Lets all contenders render in turns until each has used its budget in every repeat. An error ends the
/// affected contender only.
pub fn race(entries: &mut [Entry], schedule: &Schedule, truth: &Truth, progress: &mut dyn FnMut(&Progress)) {
    for (repeat, &seed) in schedule.seeds.iter().enumerate() {
        let mut positions = vec![Position::default(); entries.len()];
        for (entry, position) in entries.iter_mut().zip(&mut positions) {
            position.done = entry.failure.is_some();
            if !position.done {
                entry.contender.restart(seed);
                entry.runs.push(Run { seed, checkpoints: Vec::new() });
            }
        }
        while let Some(index) = next_contender(&positions, repeat) {
            let (entry, position) = (&mut entries[index], &mut positions[index]);
            let result = if entry.contender.grows() {
                accumulate(entry, position, schedule, truth)
            } else {
                render_from_scratch(entry, position, schedule, truth)
            };
            if let Err(failure) = result {
                entry.failure = Some(failure.to_string());
                position.done = true;
            }
            let share = |p: &Position| if p.done { 1.0 } else { (p.seconds / schedule.budget).min(1.0) };
            let part = positions.iter().map(share).sum::<f64>() / positions.len() as f64;
            let done = (repeat as f64 + part) / schedule.seeds.len() as f64;
            progress(&Progress { name: &entries[index].name, repeat, done });
        }
    }
}

/// Selects the contender that has used the least time. Ties are resolved in another order in each repeat.
fn next_contender(positions: &[Position], repeat: usize) -> Option<usize> {
    let count = positions.len();
    let order = (0..count).map(|i| (i + repeat) % count).filter(|&i| !positions[i].done);
    order.min_by(|&a, &b| positions[a].seconds.total_cmp(&positions[b].seconds))
}

/// Renders a turn of a contender that accumulates samples.
fn accumulate(
    entry: &mut Entry,
    position: &mut Position,
    schedule: &Schedule,
    truth: &Truth,
) -> Result<(), BenchError> {
    let goal = schedule.checkpoints[position.next_checkpoint];
    let turn = (goal - position.seconds).min(schedule.budget / TURNS);
    let pace = if position.samples == 0 { entry.pace } else { position.seconds / position.samples as f64 };
    // Without the margin of 2 %, a turn that ends slightly before a checkpoint needs another turn of one
    // sample.
    let fit = (1.02 * turn / pace) as u64;
    let fit = if fit > BATCH { fit / BATCH * BATCH } else { fit.max(1) };
    let rendered = entry.contender.render(fit.min(position.samples.max(1) * 4))?;
    position.seconds += rendered.seconds;
    position.samples = rendered.samples;
    if position.seconds >= goal {
        entry.measure(rendered, position.seconds, truth)?;
        position.next_checkpoint = schedule.checkpoints.partition_point(|&c| c <= position.seconds);
        position.done = position.next_checkpoint == schedule.checkpoints.len();
    }
    Ok(())
}

/// Renders a turn of a contender that renders each picture from scratch. The fastest picture determines the
/// number of samples that the budget allows, so that a temporary stall of the machine does not end the
/// repeat.
fn render_from_scratch(
    entry: &mut Entry,
    position: &mut Position,
    schedule: &Schedule,
    truth: &Truth,
) -> Result<(), BenchError> {
    let last = |pace: f64| (BEYOND * schedule.budget / pace).ceil() as u64;
    let samples = match position.pace {
        // Most sampling patterns are best at powers of two.
        None => 1 << ((schedule.checkpoints[0] / entry.pace) as u64).max(1).ilog2(),
        Some(pace) => (2 * position.samples).min(last(pace).max(position.samples + 1)),
    };
    let rendered = entry.contender.render(samples)?;
    (position.seconds, position.samples) = (rendered.seconds, rendered.samples.max(position.samples + 1));
    position.spent += rendered.seconds;
    let pace = (rendered.seconds / rendered.samples as f64).min(position.pace.unwrap_or(f64::INFINITY));
    position.pace = Some(pace);
    entry.measure(rendered, rendered.seconds, truth)?;
    position.done = position.samples >= last(pace) || position.spent >= PATIENCE * schedule.budget;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contender that takes `pace` seconds per sample and has rel_mse 1 / samples.
    struct Fake {
        grows: bool,
        pace: f64,
        samples: u64,
        fails_at: u64,
        /// Number of samples whose picture takes a hundred times as long.
        stalls_at: u64,
    }

    impl Contender for Fake {
        fn grows(&self) -> bool {
            self.grows
        }

        fn restart(&mut self, _: u32) {
            self.samples = 0;
        }

        fn render(&mut self, samples: u64) -> Result<Rendered, BenchError> {
            self.samples = if self.grows { self.samples + samples } else { samples };
            if self.samples >= self.fails_at {
                return Err(BenchError::Truth("planted".to_owned()));
            }
            let slow = if samples == self.stalls_at { 100.0 } else { 1.0 };
            Ok(Rendered { samples: self.samples, seconds: samples as f64 * self.pace * slow })
        }

        fn film(&mut self) -> Result<Film, BenchError> {
            // (x - 1)^2 / 1.01 of a white reference.
            let value = 1.0 + (1.01 / self.samples as f64).sqrt() as f32;
            Ok(Film { width: 16, height: 16, pixels: vec![[value; 3]; 256] })
        }

        fn details(&self) -> Details {
            Details::default()
        }

        fn forget(&mut self) {}
    }

    fn entry(grows: bool, pace: f64, fails_at: u64) -> Entry<'static> {
        entry_of(Fake { grows, pace, samples: 0, fails_at, stalls_at: 0 })
    }

    fn entry_of(fake: Fake) -> Entry<'static> {
        Entry::new(format!("{} {}", fake.grows, fake.pace), Box::new(fake), Instant::now()).unwrap()
    }

    fn white(own_rel_mse: Option<f64>) -> Truth {
        let film = Film { width: 16, height: 16, pixels: vec![[1.0; 3]; 256] };
        Truth { film, origin: truth::Origin { how: String::new(), own_rel_mse, samples: 0, seconds: 0.0 } }
    }

    #[test]
    fn turns_are_shared_and_checkpoints_met() {
        let schedule = Schedule::new(100.0, 5, vec![1, 2]);
        let mut entries = [entry(true, 0.01, u64::MAX), entry(true, 30.0, u64::MAX), entry(false, 0.02, u64::MAX)];
        let (mut turns, mut last) = (Vec::new(), 0.0);
        race(&mut entries, &schedule, &white(None), &mut |p| {
            assert!(p.done >= last - 1e-9 && p.done <= 1.0 + 1e-9, "{} after {last}", p.done);
            last = p.done;
            turns.push((p.repeat, p.name.to_owned()));
        });
        assert!((last - 1.0).abs() < 1e-9, "{last}");
        for (repeat, _) in schedule.seeds.iter().enumerate() {
            let count = |name: &str| turns.iter().filter(|(r, n)| (*r, n.as_str()) == (repeat, name)).count();
            assert!(count("true 0.01") >= 32, "a budget has at least {TURNS} turns: {}", count("true 0.01"));
            assert_eq!(count("true 30"), 4, "one sample a turn");
        }
        // The fast contender ends after the slow one has begun its last sample.
        let last_of = |name: &str| turns.iter().rposition(|(_, n)| n == name).unwrap();
        assert!(last_of("true 0.01").abs_diff(last_of("true 30")) < 6, "{turns:?}");
        for entry in &entries {
            assert_eq!((entry.runs.len(), &entry.failure), (2, &None));
            for run in &entry.runs {
                let seconds: Vec<f64> = run.checkpoints.iter().map(|c| c.seconds).collect();
                assert!(seconds.is_sorted() && *seconds.last().unwrap() >= 100.0, "{seconds:?}");
                assert!(*seconds.last().unwrap() <= 125.0, "{seconds:?}");
                for c in &run.checkpoints {
                    assert!((c.error * c.samples as f64 - 1.0).abs() < 1e-3, "{c:?}");
                }
            }
        }
        let times: Vec<f64> = entries[0].runs[0].checkpoints.iter().map(|c| c.seconds).collect();
        for (time, goal) in times.iter().zip(&schedule.checkpoints) {
            assert!((goal * 0.999..goal * 1.3).contains(time), "{times:?} {:?}", schedule.checkpoints);
        }
        let pictures = entries[2].runs[0].checkpoints.len();
        assert!((7..=9).contains(&pictures), "doubling from a hundredth on: {pictures}");
    }

    #[test]
    fn a_failure_ends_one_and_not_the_others() {
        let schedule = Schedule::new(10.0, 3, vec![1, 2]);
        let mut entries = [entry(true, 0.1, 50), entry(true, 0.1, u64::MAX)];
        race(&mut entries, &schedule, &white(None), &mut |_| ());
        assert!(entries[0].failure.as_ref().is_some_and(|f| f.contains("planted")));
        assert_eq!(entries[0].runs.len(), 1);
        assert_eq!((entries[1].runs.len(), &entries[1].failure), (2, &None));
        let mut wrong_size = white(None);
        wrong_size.film.width = 8;
        race(&mut entries[1..], &schedule, &wrong_size, &mut |_| ());
        assert!(entries[1].failure.as_ref().is_some_and(|f| f.contains("8x16")), "{:?}", entries[1].failure);
    }

    #[test]
    fn a_stall_does_not_end_a_repeat() {
        let schedule = Schedule::new(10.0, 5, vec![1]);
        let fake = |stalls_at| Fake { grows: false, pace: 0.01, samples: 0, fails_at: u64::MAX, stalls_at };
        for stalls_at in [0, 8, 16] {
            let mut entries = [entry_of(fake(stalls_at))];
            race(&mut entries, &schedule, &white(None), &mut |_| ());
            let run = &entries[0].runs[0];
            assert!(run.checkpoints.last().is_some_and(|c| c.samples == 1050), "{stalls_at}: {run:?}");
            let stalled = usize::from(run.checkpoints.iter().any(|c| c.samples == stalls_at));
            assert_eq!(run.curve(|c| c.error).len() + stalled, run.checkpoints.len());
        }
        // A contender that stalls for long ends, too.
        let mut entries = [entry_of(fake(128))];
        race(&mut entries, &schedule, &white(None), &mut |_| ());
        assert_eq!(entries[0].runs[0].checkpoints.last().map(|c| c.samples), Some(128));
    }

    #[test]
    fn curves_go_forward_in_time() {
        let film = Film { width: 16, height: 16, pixels: vec![[1.0; 3]; 256] };
        let comparison = metrics::compare(&film, &film).unwrap();
        let at = |(seconds, error)| Checkpoint { seconds, samples: 1, error, comparison };
        let run = Run { seed: 1, checkpoints: [(0.3, 8.0), (0.5, 4.0), (0.2, 2.0), (0.4, 1.0)].map(at).to_vec() };
        let points: Vec<_> = run.curve(|c| c.error).iter().map(|p| (p.seconds, p.error)).collect();
        assert_eq!(points, [(0.2, 2.0), (0.4, 1.0)]);
    }

    #[test]
    fn the_reference_s_own_error_is_taken_off() {
        let schedule = Schedule::new(10.0, 3, vec![1]);
        let mut entries = [entry(true, 0.1, u64::MAX)];
        race(&mut entries, &schedule, &white(Some(0.005)), &mut |_| ());
        let checkpoints = &entries[0].runs[0].checkpoints;
        assert!((checkpoints[0].error + 0.005 - checkpoints[0].comparison.rel_mse).abs() < 1e-12);
        // A hundred samples have rel_mse 0.01, half of which is the reference's.
        assert!((checkpoints[2].error / 0.005 - 1.0).abs() < 0.2, "{checkpoints:?}");
        let mut entries = [entry(true, 0.1, u64::MAX)];
        race(&mut entries, &schedule, &white(Some(1.0)), &mut |_| ());
        assert_eq!(entries[0].runs[0].checkpoints[2].error, 0.25, "below that the reference says nothing");
        assert!(at_least(f64::NAN, 1.0).is_nan());
    }
}
