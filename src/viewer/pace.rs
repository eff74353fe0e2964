//! How coarse a picture is while things move, from how long samples take.

/// Seconds that a moving picture's sample may take before it is made coarser, and below which it is made finer: half as many pixels
/// along a side take at best a quarter of the time.
const SLOW: f64 = 0.08;
const FAST: f64 = 0.015;
/// Coarsest: as many pixels of the window are one of the film, along a side.
const COARSEST: u32 = 8;

/// The choice for one pane.
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
    /// Learns how long a sample took at a coarseness.
    pub fn learn(&mut self, coarseness: u32, seconds: f64) {
        if seconds > SLOW && coarseness >= self.coarseness && self.coarseness < COARSEST {
            self.coarseness *= 2;
        } else if seconds < FAST && coarseness <= self.coarseness && self.coarseness > 1 {
            self.coarseness /= 2;
        }
    }

    /// Pixels of the pane that are one of the film, along a side.
    #[must_use]
    pub fn coarseness(&self, moving: bool) -> u32 {
        if moving { self.coarseness } else { 1 }
    }

    /// A size at a coarseness.
    #[must_use]
    pub fn size([width, height]: [u32; 2], coarseness: u32) -> [u32; 2] {
        [width.div_ceil(coarseness).max(1), height.div_ceil(coarseness).max(1)]
    }

    /// Samples of a batch that takes about as many seconds, where one takes `each`.
    #[must_use]
    pub fn batch(seconds: f64, each: f64) -> u64 {
        (seconds / each.max(1e-6)).clamp(1.0, 64.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device on which a sample takes so long, plus so much for each of a million pixels.
    fn settle(fixed: f64, per_million: f64) -> (u32, usize) {
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
    fn it_settles_where_samples_are_quick_enough() {
        assert_eq!(settle(0.001, 0.001).0, 1, "a fast device shows every pixel");
        assert_eq!(settle(0.005, 0.3).0, 2);
        assert_eq!(settle(0.01, 5.0).0, 8);
        assert_eq!(settle(1.0, 1.0).0, COARSEST, "and no coarser where that would not help");
        for cost in [0.001, 0.01, 0.1, 0.5, 1.0, 3.0] {
            assert!(settle(0.005, cost).1 <= 3, "{cost}: it does not swing to and fro");
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
