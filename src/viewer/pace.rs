//! Chooses the resolution of a moving picture from the duration of its samples.

/// Seconds per sample of a moving picture above which it becomes coarser, and below which it becomes finer.
/// Half the resolution along a side takes at best a quarter of the time, so that the two limits leave a
/// margin against oscillation.
const SLOW: f64 = 0.08;
const FAST: f64 = 0.015;
/// Coarsest resolution: pixels of the window per pixel of the film, along a side.
const COARSEST: u32 = 8;

/// Resolution of one pane's moving pictures.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    coarseness: u32,
}

impl Default for Pace {
    fn default() -> Self {
        Self { coarseness: 2 }
    }
}

impl Pace {
    /// Adapts the resolution to the duration of a sample at a given coarseness.
    pub fn learn(&mut self, coarseness: u32, seconds: f64) {
        if seconds > SLOW && coarseness >= self.coarseness && self.coarseness < COARSEST {
            self.coarseness *= 2;
        } else if seconds < FAST && coarseness <= self.coarseness && self.coarseness > 1 {
            self.coarseness /= 2;
        }
    }

    /// Returns the pixels of the pane per pixel of the film, along a side.
    #[must_use]
    pub fn coarseness(&self, moving: bool) -> u32 {
        if moving { self.coarseness } else { 1 }
    }

    /// Returns the size of the film at a coarseness.
    #[must_use]
    pub fn size([width, height]: [u32; 2], coarseness: u32) -> [u32; 2] {
        [width.div_ceil(coarseness).max(1), height.div_ceil(coarseness).max(1)]
    }

    /// Returns the number of samples of a batch of `seconds`, if a sample takes `each` seconds.
    #[must_use]
    pub fn batch(seconds: f64, each: f64) -> u64 {
        (seconds / each.max(1e-6)).clamp(1.0, 64.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simulates a device whose samples take `fixed` seconds plus `per_million` seconds per million pixels.
    /// Returns the final coarseness and the number of changes.
    fn converged_coarseness(fixed: f64, per_million: f64) -> (u32, usize) {
        let (mut pace, mut changes) = (Pace::default(), 0);
        for _ in 0..100 {
            let coarseness = pace.coarseness(true);
            let [w, h] = Pace::size([1280, 720], coarseness);
            pace.learn(coarseness, fixed + per_million * f64::from(w * h) * 1e-6);
            changes += usize::from(pace.coarseness(true) != coarseness);
        }
        (pace.coarseness(true), changes)
    }

    #[test]
    fn it_converges_where_samples_are_quick_enough() {
        assert_eq!(converged_coarseness(0.001, 0.001).0, 1, "a fast device shows every pixel");
        assert_eq!(converged_coarseness(0.005, 0.3).0, 2);
        assert_eq!(converged_coarseness(0.01, 5.0).0, 8);
        assert_eq!(converged_coarseness(1.0, 1.0).0, COARSEST, "and no coarser where that would not help");
        for cost in [0.001, 0.01, 0.1, 0.5, 1.0, 3.0] {
            assert!(converged_coarseness(0.005, cost).1 <= 3, "{cost}: it does not swing to and fro");
        }
    }

    #[test]
    fn what_stands_still_is_sharp() {
        let mut pace = Pace::default();
        (0..9).for_each(|_| pace.learn(8, 9.0));
        assert_eq!(pace.coarseness(false), 1);
        assert_eq!(Pace::size([3, 2], 8), [1, 1]);
        assert_eq!((Pace::batch(0.06, 0.01), Pace::batch(0.06, 5.0), Pace::batch(0.06, 0.0)), (6, 1, 64));
    }
}
