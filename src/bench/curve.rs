//! Curves of error against time: interpolation between checkpoints, and spread over repeats.
//!
//! Both axes are logarithmic, since Monte Carlo error decreases as a power of time, which is a straight line
//! there.

use serde::Serialize;

/// Extrapolation limit of a curve, as a multiple of the time of its last checkpoint. Beyond the last
/// checkpoint error is assumed to decrease as 1 / time.
const BEYOND: f64 = 1.25;

/// Point of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Seconds, greater than 0.
    pub seconds: f64,
    /// Error, greater than 0.
    pub error: f64,
}

/// Time from which on a curve stays at or below an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reached {
    /// Seconds after which the error is reached.
    At(f64),
    /// Seconds of the first checkpoint, at which the error is reached already; it may have been reached
    /// earlier.
    Before(f64),
    /// The error is not reached by the last checkpoint.
    Never,
}

/// Returns the error at a time, by the power law between the two surrounding checkpoints. None before the
/// first checkpoint and beyond 1.25 times the last. Points are in the order of time.
#[must_use]
pub fn error_at(points: &[Point], seconds: f64) -> Option<f64> {
    let after = points.partition_point(|p| p.seconds < seconds);
    match (after.checked_sub(1).map(|i| points[i]), points.get(after)) {
        (_, Some(p)) if p.seconds == seconds => Some(p.error),
        (Some(a), Some(b)) => Some(power(a.error, b.error, fraction(a.seconds, b.seconds, seconds))),
        (Some(last), None) if seconds <= BEYOND * last.seconds => Some(last.error * last.seconds / seconds),
        _ => None,
    }
}

/// Returns the time at which the curve crosses an error for the last time. Curves are noisy, so a temporary
/// dip does not count.
#[must_use]
pub fn time_to(points: &[Point], error: f64) -> Reached {
    let above = |p: &Point| p.error.is_nan() || p.error > error;
    let Some(last_above) = points.iter().rposition(above) else {
        return points.first().map_or(Reached::Never, |p| Reached::Before(p.seconds));
    };
    let (a, Some(b)) = (points[last_above], points.get(last_above + 1)) else { return Reached::Never };
    // An error that is not a number is above every target.
    let part = if a.error.is_finite() { fraction(a.error, b.error, error) } else { 1.0 };
    Reached::At(power(a.seconds, b.seconds, part))
}

/// Returns the position of x between a and b on a logarithmic axis, 0 to 1.
fn fraction(a: f64, b: f64, x: f64) -> f64 {
    let span = (b / a).ln();
    if span == 0.0 { 1.0 } else { (x / a).ln() / span }
}

/// Interpolates between a and b on a logarithmic axis.
fn power(a: f64, b: f64, part: f64) -> f64 {
    a * (b / a).powf(part)
}

/// Statistics of a quantity over repeats.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean of errors, median of times.
    pub middle: f64,
    /// Minimum.
    pub low: f64,
    /// Maximum. None if a repeat never reached the target.
    pub high: Option<f64>,
    /// True if a repeat reached the target at its first checkpoint, so that `middle` and `low` are upper
    /// bounds.
    pub at_most: bool,
}

/// Returns the mean error of repeats. None if a repeat has no error at that time.
#[must_use]
pub fn mean_error(errors: &[Option<f64>]) -> Option<Spread> {
    let errors: Vec<f64> = errors.iter().copied().collect::<Option<_>>()?;
    let low = errors.iter().copied().min_by(f64::total_cmp)?;
    let high = errors.iter().copied().max_by(f64::total_cmp);
    Some(Spread { middle: errors.iter().sum::<f64>() / errors.len() as f64, low, high, at_most: false })
}

/// Returns the median time of repeats, for an even number the later of the two in the middle. None if half of
/// the repeats or more never reached the target.
#[must_use]
pub fn median_time(times: &[Reached]) -> Option<Spread> {
    let seconds = |time: &Reached| match time {
        Reached::At(seconds) | Reached::Before(seconds) => *seconds,
        Reached::Never => f64::INFINITY,
    };
    let mut sorted: Vec<f64> = times.iter().map(seconds).collect();
    sorted.sort_by(f64::total_cmp);
    let (&low, &high) = (sorted.first()?, sorted.last()?);
    let middle = sorted[sorted.len() / 2];
    let at_most = times.iter().any(|time| matches!(time, Reached::Before(_)));
    middle.is_finite().then(|| Spread { middle, low, high: Some(high).filter(|h| h.is_finite()), at_most })
}

/// Returns `count` times from `first` to `last`, evenly spaced on a logarithmic axis. A single time is
/// `last`.
#[must_use]
pub fn log_spaced(first: f64, last: f64, count: usize) -> Vec<f64> {
    let step = |i: usize| if count > 1 { i as f64 / (count - 1) as f64 } else { 1.0 };
    (0..count).map(|i| power(first, last, step(i))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(pairs: &[(f64, f64)]) -> Vec<Point> {
        pairs.iter().map(|&(seconds, error)| Point { seconds, error }).collect()
    }

    fn near(a: f64, b: f64) -> bool {
        (a / b - 1.0).abs() < 1e-12
    }

    #[test]
    fn a_power_law_is_met_exactly_between_its_points() {
        let law = |t: f64| 3.0 * t.powf(-1.2);
        let curve: Vec<Point> = [1.0, 4.0, 9.0].map(|t| Point { seconds: t, error: law(t) }).to_vec();
        for t in [1.0, 1.5, 4.0, 5.0, 9.0] {
            assert!(near(error_at(&curve, t).unwrap(), law(t)), "{t}");
        }
        assert_eq!(error_at(&curve, 0.99), None, "nothing is known of before the first checkpoint");
        assert!(near(error_at(&curve, 10.0).unwrap(), law(9.0) * 0.9), "a little beyond the last: 1 / time");
        assert_eq!(error_at(&curve, 12.0), None);
        assert_eq!(error_at(&[], 1.0), None);
        for t in [1.5, 5.0, 9.0] {
            let Reached::At(reached) = time_to(&curve, law(t)) else { panic!("{t}") };
            assert!(near(reached, t), "{reached} {t}");
        }
        assert_eq!(time_to(&curve, law(1.0)), Reached::Before(1.0));
        assert_eq!(time_to(&curve, law(9.1)), Reached::Never);
        assert_eq!(time_to(&[], 1.0), Reached::Never);
    }

    #[test]
    fn a_dip_that_does_not_last_is_not_reaching_the_target() {
        let curve = points(&[(1.0, 1.0), (2.0, 0.1), (4.0, 1.0), (8.0, 0.25)]);
        let Reached::At(seconds) = time_to(&curve, 0.5) else { panic!() };
        assert!(near(seconds, 4.0 * 2.0_f64.sqrt()), "halfway in log time, {seconds}");
        assert_eq!(time_to(&points(&[(1.0, 0.1), (2.0, 0.6)]), 0.5), Reached::Never);
        let holes = points(&[(1.0, f64::NAN), (2.0, 0.1)]);
        assert_eq!(time_to(&holes, 0.5), Reached::At(2.0));
        assert_eq!(time_to(&points(&[(1.0, 0.1), (2.0, f64::NAN)]), 0.5), Reached::Never);
    }

    #[test]
    fn spreads_say_when_repeats_fail() {
        let spread = mean_error(&[Some(1.0), Some(4.0), Some(1.0)]).unwrap();
        assert_eq!(spread, Spread { middle: 2.0, low: 1.0, high: Some(4.0), at_most: false });
        assert_eq!(mean_error(&[Some(1.0), None]), None);
        assert_eq!(mean_error(&[]), None);
        let times = [Reached::At(3.0), Reached::Never, Reached::At(2.0)];
        assert_eq!(median_time(&times), Some(Spread { middle: 3.0, low: 2.0, high: None, at_most: false }));
        assert_eq!(median_time(&[Reached::At(3.0), Reached::Never]), None);
        assert!(median_time(&[Reached::Before(3.0), Reached::At(4.0)]).unwrap().at_most);
        assert_eq!(median_time(&[]), None);
    }

    #[test]
    fn log_spacing_has_both_ends() {
        let times = log_spaced(0.5, 32.0, 4);
        assert!(times.iter().zip([0.5, 2.0, 8.0, 32.0]).all(|(&a, b)| near(a, b)), "{times:?}");
        assert_eq!(log_spaced(0.5, 32.0, 1), [32.0]);
    }
}
