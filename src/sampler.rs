//! Random numbers of an iteration: an Owen-scrambled Sobol sequence, one point per iteration, one dimension per decision.
//!
//! All pixels share them. Pairs of decisions that multiply (a direction and the next hop's direction) take different
//! dimensions of the same point, so that pairs cover their square; consecutive points of one sequence would not.

use std::f32::consts::PI;

use glam::Vec3;

/// Points after which a scrambled sequence is replaced by another one.
const POINTS: u64 = 1 << 16;

/// Where each decision finds its numbers; the most important ones come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Direction of y1 (2).
    Y1,
    /// Direction of the n-th bundle (2).
    Bundle(u32),
    /// Direction of y2 (2).
    Y2,
    /// Position within the pixel (2).
    Pixel,
    /// Which light (1).
    Light,
    /// Point on the n-th light of the pool (2); the first is y0.
    LightPoint(u32),
    /// Point of the lens (2).
    Lens,
    /// Turn of the n-th bundle's grid (1).
    Turn(u32),
    /// Shift of the n-th bundle's grid (2).
    Shift(u32),
}

impl Decision {
    fn dimension(self) -> u32 {
        match self {
            Self::Y1 => 0,
            Self::Bundle(0) => 2,
            Self::Y2 => 4,
            Self::Bundle(1) => 6,
            Self::Light => 10,
            Self::LightPoint(0) => 12,
            Self::Lens => 148,
            // Further bundles take blocks of their own.
            Self::Bundle(n) => 14 + 2 * (n - 2),
            Self::Turn(n) => 150 + 3 * n,
            Self::Shift(n) => 151 + 3 * n,
            // Beyond what the others take.
            Self::LightPoint(n) => 512 + 2 * n,
            // The first pair of a sequence of its own, which fills its square best (README, "Cost of an iteration").
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
    /// Iteration `iteration` of the sequence that `seed` names.
    #[must_use]
    pub fn new(seed: u32, iteration: u64) -> Self {
        // A hash, so that neighbouring seeds and sequences have nothing in common.
        let mut x = u64::from(seed)
            .wrapping_add((iteration / POINTS).wrapping_mul(0x9e37_79b9_7f4a_7c15))
            .wrapping_add(0x632b_e59b_d9b4_e019);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Self { index: (iteration % POINTS) as u32, seed: (x ^ (x >> 31)) as u32 }
    }

    /// Bits that differ from iteration to iteration and from seed to seed.
    #[must_use]
    pub fn bits(&self) -> u32 {
        (self.index ^ self.seed.rotate_left(16)).wrapping_mul(0x9e37_79b9) ^ self.seed
    }

    /// One number in [0, 1).
    #[must_use]
    pub fn get(&self, decision: Decision) -> f32 {
        self.dimension(decision.dimension())
    }

    /// Two numbers in [0, 1).
    #[must_use]
    pub fn get2(&self, decision: Decision) -> [f32; 2] {
        let first = decision.dimension();
        [self.dimension(first), self.dimension(first + 1)]
    }

    fn dimension(&self, dimension: u32) -> f32 {
        let dimensions = sobol_burley::NUM_DIMENSIONS;
        // Beyond the sequence's dimensions, the same ones under another scrambling.
        let seed = self.seed.wrapping_add((dimension / dimensions).wrapping_mul(0x9e37_79b9));
        sobol_burley::sample(self.index, dimension % dimensions, seed)
    }
}

/// Unit direction at a given cosine and azimuth around `axis`.
fn around(axis: Vec3, cosine: f32, angle: f32) -> Vec3 {
    let (right, up) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    ((right * angle.cos() + up * angle.sin()) * sine + axis * cosine).normalize()
}

/// Uniform direction over the sphere.
#[must_use]
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    around(Vec3::Z, 1.0 - 2.0 * u, 2.0 * PI * v)
}
