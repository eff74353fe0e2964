//! Samples discrete and linear densities such that stratified random numbers stay stratified.

/// Number of weights in one block of a table: a cache line of sums.
const BLOCK: usize = 16;

/// A discrete distribution, proportional to weights.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Inclusive prefix sums of the weights; the last is `total`.
    sums: Vec<f32>,
    /// The last sum of each block. It is searched first, so that sampling a large table touches few cache
    /// lines.
    blocks: Vec<f32>,
    total: f32,
}

impl Table {
    /// Sums the weights in f64. None may be negative.
    #[must_use]
    pub fn new(weights: &[f32]) -> Self {
        let mut sum = 0.0_f64;
        let sums: Vec<f32> = weights
            .iter()
            .map(|&w| {
                sum += f64::from(w);
                sum as f32
            })
            .collect();
        let blocks = sums.chunks_exact(BLOCK).map(|block| block[BLOCK - 1]).collect();
        Self { sums, blocks, total: sum as f32 }
    }

    /// Returns the sum of all weights.
    #[must_use]
    pub fn total(&self) -> f32 {
        self.total
    }

    /// Returns the probability of an index.
    #[must_use]
    pub fn probability(&self, index: usize) -> f32 {
        let below = if index == 0 { 0.0 } else { self.sums[index - 1] };
        (self.sums[index] - below) / self.total
    }

    /// Samples an index. Returns it with its probability and the rescaled random number. The total must not
    /// be zero.
    #[must_use]
    pub fn sample(&self, u: f32) -> (usize, f32, f32) {
        let target = u * self.total;
        let last = self.sums.len() - 1;
        let start = self.blocks.partition_point(|&s| s <= target) * BLOCK;
        let end = (start + BLOCK).min(self.sums.len());
        let mut index = (start + self.sums[start..end].partition_point(|&s| s <= target)).min(last);
        while index > 0 && self.probability(index) == 0.0 {
            index -= 1;
        }
        let below = if index == 0 { 0.0 } else { self.sums[index - 1] };
        let rest = ((target - below) / (self.sums[index] - below)).clamp(0.0, 1.0 - f32::EPSILON / 2.0);
        (index, self.probability(index), rest)
    }
}

/// Samples [0, 1] with a density that is linear from `a` to `b` (pbrt-v4, section A.3.1, in its stable form).
#[must_use]
pub fn sample_linear(u: f32, a: f32, b: f32) -> f32 {
    if a + b <= 0.0 {
        return u;
    }
    if u == 0.0 && a == 0.0 {
        return 0.0;
    }
    let x = u * (a + b) / (a + (a * a * (1.0 - u) + b * b * u).sqrt());
    x.min(1.0 - f32::EPSILON / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_come_in_proportion_and_the_rest_is_uniform() {
        let table = Table::new(&[0.0, 1.0, 0.0, 3.0, 0.0]);
        let n = 4000;
        let mut counts = [0; 5];
        let mut rests = 0.0;
        for i in 0..n {
            let (index, probability, rest) = table.sample((i as f32 + 0.5) / n as f32);
            counts[index] += 1;
            rests += rest;
            assert!((probability - table.probability(index)).abs() < 1e-6);
            assert!((0.0..1.0).contains(&rest));
        }
        assert_eq!(counts, [0, 1000, 0, 3000, 0]);
        assert!((rests / n as f32 - 0.5).abs() < 1e-3);
        assert_eq!(table.sample(1.0).0, 3, "rounding up to 1 stays inside");
    }

    #[test]
    fn large_tables_find_every_index() {
        for count in [15, 16, 17, 1000] {
            let weights: Vec<f32> = (0..count).map(|i| (i % 3) as f32).collect();
            let table = Table::new(&weights);
            let mut below = 0.0;
            for (i, &w) in weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                let (index, probability, rest) = table.sample((below + 0.5 * w) / table.total());
                assert_eq!(index, i);
                assert!((probability * table.total() - w).abs() < 1e-3 && (rest - 0.5).abs() < 1e-3);
                below += w;
            }
        }
    }

    #[test]
    fn linear_density() {
        // The distribution function of a + (b - a) x is (a x + (b - a) x^2 / 2) / ((a + b) / 2).
        for (a, b) in [(0.0, 1.0), (1.0, 0.0), (2.0, 2.0), (1.0, 5.0)] {
            for i in 0..16 {
                let u = i as f32 / 16.0;
                let x = sample_linear(u, a, b);
                let back = (a * x + (b - a) * x * x / 2.0) / ((a + b) / 2.0);
                assert!((back - u).abs() < 1e-5, "{a} {b} {u}: {back}");
            }
        }
    }
}
