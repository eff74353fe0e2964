//! The time budget of a render.

use std::time::{Duration, Instant};

use crate::settings::SAMPLES;

/// Divides a time budget into rounds of samples.
pub(super) struct Clock {
    began: Instant,
    budget: Duration,
    /// Samples and time when the first round of this process was done. Drivers compile shaders in it, so that it
    /// tells nothing about the rounds after it.
    first: Option<(u64, Duration)>,
}

impl Clock {
    /// Begins a budget of which `used` seconds are used up.
    pub(super) fn new(seconds: f64, used: f64) -> Self {
        Self { began: Instant::now(), budget: Duration::from_secs_f64((seconds - used).max(0.0)), first: None }
    }

    /// Returns the seconds of the first round if they are more than half of the budget.
    pub(super) fn slow_start(&self) -> Option<f64> {
        self.first.map(|(_, time)| time).filter(|time| *time > self.budget / 2).map(|time| time.as_secs_f64())
    }

    /// True if no time is left.
    pub(super) fn is_used_up(&self) -> bool {
        self.began.elapsed() >= self.budget
    }

    /// Returns the time that is left.
    pub(super) fn left(&self) -> Duration {
        self.budget.saturating_sub(self.began.elapsed())
    }

    /// Returns the number of samples that fit into the remaining time at the rate since the first round, at most
    /// `most`. The first sample is always rendered, and a second one if any time is left. None if the time is used
    /// up.
    pub(super) fn next_round(&mut self, done: u64, most: u64) -> Option<u64> {
        let capacity = u64::from(*SAMPLES.end()).saturating_sub(done);
        if done == 0 {
            return Some(1);
        }
        let used = self.began.elapsed();
        let left = self.budget.saturating_sub(used).as_secs_f64();
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

    #[test]
    fn a_budget_deals_out_rounds_until_it_is_used() {
        let mut clock = Clock::new(1000.0, 0.0);
        assert_eq!(clock.next_round(0, 8), Some(1), "one sample at least");
        assert_eq!(clock.next_round(1, 8), Some(1), "the first one tells nothing");
        assert_eq!(clock.next_round(100, 8), Some(8));
        assert_eq!(clock.next_round((*SAMPLES.end()).into(), 8), None, "no more than the range allows");
        assert_eq!(clock.slow_start(), None);
        let mut used = Clock::new(0.0, 0.0);
        assert_eq!(used.next_round(0, 8), Some(1));
        assert_eq!(used.next_round(1, 8), None);
    }

    /// Compiling shaders takes most of a first round, and the rounds after it use what is left.
    #[test]
    fn a_slow_start_leaves_the_rest_of_the_budget() {
        let ago = |seconds| Instant::now().checked_sub(Duration::from_secs(seconds)).unwrap();
        let mut clock = Clock { began: ago(60), ..Clock::new(100.0, 0.0) };
        assert_eq!(clock.next_round(1, 8), Some(1), "40 s are left");
        assert!(clock.slow_start().is_some_and(|seconds| (60.0..70.0).contains(&seconds)));
        clock.began = ago(61);
        assert_eq!(clock.next_round(2, 8), Some(8), "at about one sample a second");
        clock.began = ago(90);
        assert_eq!(clock.next_round(2, 8), None, "at 30 s a sample");
    }
}
