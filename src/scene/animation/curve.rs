//! Keyframe curves (glTF 2.0, 3.11 and appendix C).

use glam::{Quat, Vec4};

/// The interpolation between two keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Linear; spherically linear for rotations.
    Linear,
    /// The earlier key's value.
    Step,
    /// Cubic Hermite splines; each key has an in-tangent, a value and an out-tangent.
    CubicSpline,
}

/// A keyframe curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    times: Vec<f32>,
    values: Vec<f32>,
    width: usize,
    interpolation: Interpolation,
}

impl Curve {
    /// Creates a curve of `width` components through keys at `times` (seconds, ascending). `values` holds
    /// `width` numbers per key, or three times that for cubic splines: in-tangent, value, out-tangent.
    ///
    /// # Errors
    /// An empty list of keys, times that are not finite or descend, and values that are not finite or whose
    /// number does not match the keys are errors.
    pub fn new(times: Vec<f32>, values: Vec<f32>, width: usize, interpolation: Interpolation) -> Result<Self, String> {
        if times.is_empty() {
            return Err("there are no keys".to_owned());
        }
        if let Some(i) = times.iter().position(|t| !t.is_finite()) {
            return Err(format!("the time of key {i} is {}", times[i]));
        }
        if let Some(i) = times.windows(2).position(|pair| pair[1] < pair[0]) {
            return Err(format!("times have to ascend, but key {} at {} s is before key {i}", i + 1, times[i + 1]));
        }
        let each = if interpolation == Interpolation::CubicSpline { 3 * width } else { width };
        if times.len().checked_mul(each) != Some(values.len()) {
            return Err(format!("{} numbers for {} keys of {each}", values.len(), times.len()));
        }
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(format!("number {i} is {}", values[i]));
        }
        Ok(Self { times, values, width, interpolation })
    }

    /// Returns the number of components of a value.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the time of the last key in seconds.
    #[must_use]
    pub fn end(&self) -> f32 {
        self.times.last().copied().unwrap_or_default()
    }

    /// Returns the value at a time, clamped to the first and last key (glTF 2.0, 3.11).
    #[must_use]
    pub fn at(&self, seconds: f32) -> Vec<f32> {
        self.between(seconds, |from, to, share| from.iter().zip(to).map(|(a, b)| a + (b - a) * share).collect())
    }

    /// Returns the rotation at a time as a unit quaternion x, y, z, w.
    #[must_use]
    pub fn rotation_at(&self, seconds: f32) -> Quat {
        let of = |q: &[f32]| {
            let q = Vec4::new(q[0], q[1], q[2], q[3]);
            q.try_normalize().map_or(Quat::IDENTITY, Quat::from_vec4)
        };
        of(&self.between(seconds, |from, to, share| of(from).slerp(of(to), share).to_array().to_vec()))
    }

    /// Interpolates the two keys around a time; `mix` blends the values of curves that are not splines.
    fn between(&self, seconds: f32, mix: impl Fn(&[f32], &[f32], f32) -> Vec<f32>) -> Vec<f32> {
        // The parts of a key are in-tangent, value and out-tangent; a curve that is not a spline has the
        // value alone.
        let cubic = self.interpolation == Interpolation::CubicSpline;
        let part = |key: usize, part: usize| {
            let first = if cubic { 3 * key + part } else { key } * self.width;
            &self.values[first..first + self.width]
        };
        let next = self.times.partition_point(|&t| t <= seconds);
        if next == 0 || next == self.times.len() || self.interpolation == Interpolation::Step {
            return part(next.max(1) - 1, 1).to_vec();
        }
        let key = next - 1;
        let span = self.times[next] - self.times[key];
        let t = (seconds - self.times[key]) / span;
        if !cubic {
            return mix(part(key, 1), part(next, 1), t);
        }
        // glTF 2.0, appendix C.5.
        let (t2, t3) = (t * t, t * t * t);
        let weights = [2.0 * t3 - 3.0 * t2 + 1.0, span * (t3 - 2.0 * t2 + t), 3.0 * t2 - 2.0 * t3, span * (t3 - t2)];
        let parts = [part(key, 1), part(key, 2), part(next, 1), part(next, 0)];
        (0..self.width).map(|i| weights.iter().zip(parts).map(|(weight, part)| weight * part[i]).sum()).collect()
    }
}
