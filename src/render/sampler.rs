//! Random numbers of an iteration: an Owen-scrambled Sobol sequence with one point per iteration and one
//! dimension per decision.
//!
//! All pixels share the numbers. Decisions of one path, such as the directions of two bounces, take different
//! dimensions of the same point, so that their pairs are stratified; consecutive points of a low-dimensional
//! sequence would not be.

use std::f32::consts::PI;

use glam::Vec3;

/// Number of points after which the sequence is scrambled anew.
const POINTS: u64 = 1 << 16;

/// The decisions of an iteration, with their dimensions of the sequence. Decisions of most variance take the
/// first dimensions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Direction from y0 to y1 (2 dimensions).
    Y1,
    /// Direction of the n-th bundle (2).
    Bundle(u32),
    /// Direction from y1 to y2 (2).
    Y2,
    /// Position within the pixel (2).
    Pixel,
    /// Choice of the light (1).
    Light,
    /// Point on the light of the n-th light candidate (2); the first is y0.
    LightPoint(u32),
    /// Point on the lens (2).
    Lens,
    /// Rotation of the n-th bundle's grid around its direction (1).
    Turn(u32),
    /// Offset of the n-th bundle's grid (2).
    Shift(u32),
}

impl Decision {
    /// Returns the first dimension of a decision.
    fn dimension(self) -> u32 {
        match self {
            Self::Y1 => 0,
            Self::Bundle(0) => 2,
            Self::Y2 => 4,
            Self::Bundle(1) => 6,
            Self::Light => 10,
            Self::LightPoint(0) => 12,
            Self::Lens => 148,
            // Further bundles follow.
            Self::Bundle(n) => 14 + 2 * (n - 2),
            Self::Turn(n) => 150 + 3 * n,
            Self::Shift(n) => 151 + 3 * n,
            // These dimensions lie beyond all others.
            Self::LightPoint(n) => 512 + 2 * n,
            // The first pair of a differently scrambled sequence, whose first two dimensions are stratified
            // best (docs/journal.md, "Cost of an iteration").
            Self::Pixel => 8 * sobol_burley::NUM_DIMENSIONS,
        }
    }
}

/// The numbers of one iteration.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    index: u32,
    seed: u32,
}

impl Sampler {
    /// Creates the sampler of an iteration, for the sequence of a seed.
    #[must_use]
    pub fn new(seed: u32, iteration: u64) -> Self {
        // A hash decorrelates neighbouring seeds and sequences (SplitMix64).
        let mut x = u64::from(seed)
            .wrapping_add((iteration / POINTS).wrapping_mul(0x9e37_79b9_7f4a_7c15))
            .wrapping_add(0x632b_e59b_d9b4_e019);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Self { index: (iteration % POINTS) as u32, seed: (x ^ (x >> 31)) as u32 }
    }

    /// Returns 32 bits that vary with iteration and seed.
    #[must_use]
    pub fn bits(&self) -> u32 {
        (self.index ^ self.seed.rotate_left(16)).wrapping_mul(0x9e37_79b9) ^ self.seed
    }

    /// Returns one number in [0, 1).
    #[must_use]
    pub fn get(&self, decision: Decision) -> f32 {
        self.dimension(decision.dimension())
    }

    /// Returns two numbers in [0, 1).
    #[must_use]
    pub fn get2(&self, decision: Decision) -> [f32; 2] {
        let first = decision.dimension();
        [self.dimension(first), self.dimension(first + 1)]
    }

    fn dimension(&self, dimension: u32) -> f32 {
        let dimensions = sobol_burley::NUM_DIMENSIONS;
        // Dimensions beyond those of the sequence are its dimensions with another scrambling.
        let seed = self.seed.wrapping_add((dimension / dimensions).wrapping_mul(0x9e37_79b9));
        sobol_burley::sample(self.index, dimension % dimensions, seed)
    }
}

/// Returns the unit direction with a given cosine to `axis` and azimuth around it, radians.
fn around(axis: Vec3, cosine: f32, angle: f32) -> Vec3 {
    let (right, up) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    ((right * angle.cos() + up * angle.sin()) * sine + axis * cosine).normalize()
}

/// Samples a unit direction uniformly over the sphere.
#[must_use]
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    around(Vec3::Z, 1.0 - 2.0 * u, 2.0 * PI * v)
}
