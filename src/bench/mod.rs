//! Error against run time: contenders render one scene progressively, in turns, and their pictures are held against a reference at
//! log-spaced times.
//!
//! What counts is the time of the calls that render, by the clock on the wall. Not counted: start-up (device, upload, pipelines, and
//! a first sample, which makes drivers compile), fetching the picture, and comparing it. Whoever has used the least time goes next,
//! for a small part of the budget, so that other work on the machine slows all down alike. A contender whose samples add up has
//! one growing picture; one that makes each picture anew ([`Contender::grows`]) doubles its samples from picture to picture, and a
//! point of its curve is the time of that one picture. Each repeat has a seed of its own.
//!
//! Errors are rel_mse ([`crate::metrics`]) less the reference's own.

pub mod contender;
pub mod curve;
pub mod peer;
pub mod truth;

use std::time::Instant;

use serde::Serialize;

use crate::film::{Film, FilmError};
use crate::gpu::GpuError;
use crate::metrics::{self, CompareError, Comparison};
use crate::renderer::RenderError;

pub use contender::{Contender, Details, Rendered};
pub use curve::{Point, Reached, Spread};
pub use peer::{Peer, PeerCommand};
pub use truth::Truth;

/// Turns that a budget is cut into, at least.
const TURNS: f64 = 32.0;

/// Samples between two looks at the log of our renderers; more of them at once is as well a multiple of this.
const BATCH: u64 = 8;

/// How much longer than the budget a picture that is made anew is meant to take, so that the curve reaches the budget.
const BEYOND: f64 = 1.05;

/// Budgets that all of a repeat's pictures may take together where each is made anew; three are what doubling takes.
const PATIENCE: f64 = 8.0;

/// Error of a reference's size below which it says nothing: a part of its own.
const BLUR: f64 = 0.25;

/// Why a benchmark stopped.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// One of our renderers.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// An image file.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A picture that cannot be held against the reference.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The reference.
    #[error("the reference: {0}")]
    Truth(String),
    /// The report.
    #[error("{0}")]
    Report(String),
    /// A program of others.
    #[error("peer {name}: {cause}")]
    Peer {
        /// What the command line calls it.
        name: String,
        /// What is wrong and what to do.
        cause: String,
    },
}

/// How long and how often.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Schedule {
    /// Seconds of rendering for each contender, scene and repeat.
    pub budget: f64,
    /// Seconds at which pictures are held against the reference, in order; the last is the budget.
    pub checkpoints: Vec<f64>,
    /// Seeds, one for each repeat.
    pub seeds: Vec<u32>,
}

impl Schedule {
    /// Checkpoints from a hundredth of the budget on.
    #[must_use]
    pub fn new(budget: f64, checkpoints: usize, seeds: Vec<u32>) -> Self {
        Self { budget, checkpoints: curve::log_spaced(budget / 100.0, budget, checkpoints), seeds }
    }
}

/// A picture held against the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Checkpoint {
    /// Seconds of rendering.
    pub seconds: f64,
    /// Samples per pixel.
    pub samples: u64,
    /// rel_mse less the reference's own, at least a quarter of the latter: what curves and tables show.
    pub error: f64,
    /// All figures, nothing subtracted.
    pub comparison: Comparison,
}

/// One repeat of one contender.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Its seed.
    pub seed: u32,
    /// In the order of time.
    pub checkpoints: Vec<Checkpoint>,
}

impl Run {
    /// A figure against time. Of pictures that are made anew, one with fewer samples may have taken longer than one with more: it is
    /// left out.
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

/// A contender with what was measured of it.
pub struct Entry<'a> {
    /// What the report calls it.
    pub name: String,
    contender: Box<dyn Contender + 'a>,
    /// Seconds until the first sample was done.
    pub startup: f64,
    /// Repeats, as far as they came.
    pub runs: Vec<Run>,
    /// Seconds of one sample, from warming up.
    pace: f64,
    /// What ended it early.
    pub failure: Option<String>,
    /// The first repeat's last picture.
    pub picture: Option<Film>,
}

impl<'a> Entry<'a> {
    /// Warms a contender up. `began`: when its start began.
    ///
    /// # Errors
    /// Whatever stops its first sample.
    pub fn new(name: String, mut contender: Box<dyn Contender + 'a>, began: Instant) -> Result<Self, BenchError> {
        let pace = contender.render(1)?.seconds.max(1e-9);
        contender.forget();
        let startup = began.elapsed().as_secs_f64();
        Ok(Self { name, contender, startup, runs: Vec::new(), pace, failure: None, picture: None })
    }

    /// What it is and did.
    #[must_use]
    pub fn details(&self) -> Details {
        self.contender.details()
    }

    fn measure(&mut self, rendered: Rendered, seconds: f64, truth: &Truth) -> Result<(), BenchError> {
        let film = self.contender.film()?;
        let comparison = metrics::compare(&film, &truth.film)?;
        let own = truth.origin.own_rel_mse.unwrap_or(0.0);
        let error = at_least(comparison.rel_mse - own, (BLUR * own).max(f64::MIN_POSITIVE));
        if let [.., run] = self.runs.as_mut_slice() {
            run.checkpoints.push(Checkpoint { seconds, samples: rendered.samples, error, comparison });
        }
        if self.runs.len() == 1 {
            self.picture = Some(film);
        }
        Ok(())
    }
}

/// `f64::max`, but for NaN, which stays.
fn at_least(value: f64, least: f64) -> f64 {
    if value < least { least } else { value }
}

/// How far a benchmark is.
pub struct Progress<'a> {
    /// Whose turn it was.
    pub name: &'a str,
    /// Index of the repeat.
    pub repeat: usize,
    /// Share of all of the scene's work that is done, 0 to 1.
    pub done: f64,
}

/// Where a contender stands within a repeat.
#[derive(Clone, Copy, Default)]
struct Position {
    /// Seconds of rendering; where pictures are made anew, of the last one.
    seconds: f64,
    samples: u64,
    /// Where pictures are made anew: seconds of all of them, and of a sample of the fastest.
    spent: f64,
    pace: Option<f64>,
    next_checkpoint: usize,
    done: bool,
}

/// Lets all of them render in turns until each has used its budget in every repeat. What stops one of them ends that one alone.
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
        while let Some(index) = whose_turn(&positions, repeat) {
            let (entry, position) = (&mut entries[index], &mut positions[index]);
            let result = if entry.contender.grows() {
                grow(entry, position, schedule, truth)
            } else {
                anew(entry, position, schedule, truth)
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

/// Who has used the least time; of those with the same, another one first in each repeat.
fn whose_turn(positions: &[Position], repeat: usize) -> Option<usize> {
    let count = positions.len();
    let order = (0..count).map(|i| (i + repeat) % count).filter(|&i| !positions[i].done);
    order.min_by(|&a, &b| positions[a].seconds.total_cmp(&positions[b].seconds))
}

/// A turn of one whose samples add up.
fn grow(entry: &mut Entry, at: &mut Position, schedule: &Schedule, truth: &Truth) -> Result<(), BenchError> {
    let goal = schedule.checkpoints[at.next_checkpoint];
    let turn = (goal - at.seconds).min(schedule.budget / TURNS);
    let pace = if at.samples == 0 { entry.pace } else { at.seconds / at.samples as f64 };
    // Reaching a checkpoint from above a little early would cost another turn of a single sample.
    let fit = (1.02 * turn / pace) as u64;
    let fit = if fit > BATCH { fit / BATCH * BATCH } else { fit.max(1) };
    let rendered = entry.contender.render(fit.min(at.samples.max(1) * 4))?;
    at.seconds += rendered.seconds;
    at.samples = rendered.samples;
    if at.seconds >= goal {
        entry.measure(rendered, at.seconds, truth)?;
        at.next_checkpoint = schedule.checkpoints.partition_point(|&c| c <= at.seconds);
        at.done = at.next_checkpoint == schedule.checkpoints.len();
    }
    Ok(())
}

/// A turn of one that makes each picture anew. How many samples the budget allows is told by the fastest picture, so that a moment
/// in which the machine did something else does not end it.
fn anew(entry: &mut Entry, at: &mut Position, schedule: &Schedule, truth: &Truth) -> Result<(), BenchError> {
    let last = |pace: f64| (BEYOND * schedule.budget / pace).ceil() as u64;
    let samples = match at.pace {
        // A power of two, which most sampling patterns like best.
        None => 1 << ((schedule.checkpoints[0] / entry.pace) as u64).max(1).ilog2(),
        Some(pace) => (2 * at.samples).min(last(pace).max(at.samples + 1)),
    };
    let rendered = entry.contender.render(samples)?;
    (at.seconds, at.samples) = (rendered.seconds, rendered.samples.max(at.samples + 1));
    at.spent += rendered.seconds;
    let pace = (rendered.seconds / rendered.samples as f64).min(at.pace.unwrap_or(f64::INFINITY));
    at.pace = Some(pace);
    entry.measure(rendered, rendered.seconds, truth)?;
    at.done = at.samples >= last(pace) || at.spent >= PATIENCE * schedule.budget;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes `pace` seconds a sample and has rel_mse 1 / samples.
    struct Fake {
        grows: bool,
        pace: f64,
        samples: u64,
        fails_at: u64,
        /// The picture of so many samples takes a hundred times as long.
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
        // The fast one is not done before the slow one has begun its last sample.
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
        // One that stalls for long has to end all the same.
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
        // A hundred samples: 0.01 in all, half of it the reference's.
        assert!((checkpoints[2].error / 0.005 - 1.0).abs() < 0.2, "{checkpoints:?}");
        let mut entries = [entry(true, 0.1, u64::MAX)];
        race(&mut entries, &schedule, &white(Some(1.0)), &mut |_| ());
        assert_eq!(entries[0].runs[0].checkpoints[2].error, 0.25, "below that the reference says nothing");
        assert!(at_least(f64::NAN, 1.0).is_nan());
    }
}
