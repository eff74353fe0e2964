//! The time of a render, and its budget.

use std::time::{Duration, Instant};

use crate::gpu::Gpu;
use crate::settings::SAMPLES;

/// Measures time without that in which the driver compiled shaders.
pub(super) struct Stopwatch<'a> {
    began: Instant,
    gpu: Option<&'a Gpu>,
    compiled: Duration,
}

impl<'a> Stopwatch<'a> {
    /// Starts at an instant from which on the device, if there is one, has compiled nothing.
    pub(super) fn from(began: Instant, gpu: Option<&'a Gpu>) -> Self {
        Self { began, gpu, compiled: compiled(gpu) }
    }

    /// Starts now.
    pub(super) fn start(gpu: Option<&'a Gpu>) -> Self {
        Self::from(Instant::now(), gpu)
    }

    /// Returns the time since the start in which the driver compiled shaders.
    pub(super) fn compiling(&self) -> Duration {
        compiled(self.gpu) - self.compiled
    }

    /// Returns the time since the start without that.
    pub(super) fn elapsed(&self) -> Duration {
        self.began.elapsed().saturating_sub(self.compiling())
    }
}

fn compiled(gpu: Option<&Gpu>) -> Duration {
    gpu.map_or(Duration::ZERO, |gpu| gpu.compilation.time())
}

/// Divides a time budget into rounds of samples.
pub(super) struct Clock {
    budget: Duration,
    /// Samples and time when the first round of this process was done. Much is done for the first time in it, so that
    /// it tells nothing about the rounds after it.
    first: Option<(u64, Duration)>,
}

impl Clock {
    /// Begins a budget.
    pub(super) fn new(seconds: f64) -> Self {
        Self { budget: Duration::from_secs_f64(seconds.max(0.0)), first: None }
    }

    /// Returns the time that is left after `used`.
    pub(super) fn left(&self, used: Duration) -> Duration {
        self.budget.saturating_sub(used)
    }

    /// Returns the number of samples that fit into the time that is left after `used`, at the rate since the first
    /// round, at most `most`. The first sample is always rendered, and a second one if any time is left. None if the
    /// time is used up.
    pub(super) fn next_round(&mut self, done: u64, most: u64, used: Duration) -> Option<u64> {
        let capacity = u64::from(*SAMPLES.end()).saturating_sub(done);
        if done == 0 {
            return Some(1);
        }
        let left = self.left(used).as_secs_f64();
        let (first, time) = *self.first.get_or_insert((done, used));
        let fit = match done - first {
            0 => u64::from(left > 0.0),
            rendered => (left * rendered as f64 / (used - time).as_secs_f64().max(1e-9)) as u64,
        };
        Some(fit.min(most).min(capacity)).filter(|&round| round > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn seconds(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    #[test]
    fn a_budget_deals_out_rounds_until_it_is_used() {
        let mut clock = Clock::new(1000.0);
        assert_eq!(clock.next_round(0, 8, seconds(0)), Some(1), "one sample at least");
        assert_eq!(clock.next_round(1, 8, seconds(1)), Some(1), "the first one tells nothing");
        assert_eq!(clock.next_round(100, 8, seconds(2)), Some(8));
        assert_eq!(clock.next_round((*SAMPLES.end()).into(), 8, seconds(3)), None, "no more than the range allows");
        let mut used = Clock::new(0.0);
        assert_eq!(used.next_round(0, 8, seconds(0)), Some(1));
        assert_eq!(used.next_round(1, 8, seconds(1)), None);
    }

    /// The rounds after a slow first one use what is left.
    #[test]
    fn a_slow_start_leaves_the_rest_of_the_budget() {
        let mut clock = Clock::new(100.0);
        assert_eq!(clock.next_round(1, 8, seconds(60)), Some(1), "40 s are left");
        assert_eq!(clock.next_round(2, 8, seconds(61)), Some(8), "at one sample a second");
        assert_eq!(clock.next_round(2, 8, seconds(90)), None, "at 30 s a sample");
    }
}
