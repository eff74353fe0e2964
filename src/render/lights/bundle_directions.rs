//! Samples directions of ray-bundles for an environment map: the paper's eq. (2) of section 3.3, tabulated
//! (shaders/lib/views/bundle.wesl).

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::scene::{Environment, EnvironmentMap, LUMINANCE, Rows};

/// Weight of the uniform density, for light that other surfaces reflect: L_o of eq. (2) relative to the mean
/// L_e.
const UNIFORM_WEIGHT: f32 = 0.5;
/// Least and largest number of map samples along a side of a cell. The least number resolves the
/// interpolation between texels.
const SAMPLES_PER_SIDE: [u32; 2] = [4, 16];

/// A piecewise constant density over cells of the sphere with equal areas. Opposite directions have the same
/// density.
pub struct BundleDirections {
    /// Density that a direction or its opposite is sampled, per steradian, row by row.
    pub pdfs: Vec<f32>,
    /// Cumulative probabilities of the rows.
    rows: Vec<f32>,
    /// Cumulative probabilities of the cells within each row.
    columns: Vec<f32>,
}

impl BundleDirections {
    /// Number of rows, which divide the cosine to +Y evenly.
    pub const ROWS: usize = 128;
    /// Number of cells in a row, which divide the azimuth around +Y evenly.
    pub const COLUMNS: usize = 256;

    /// Tabulates the density of an environment. None if it has no map, or a black one.
    #[must_use]
    pub fn new(environment: &Environment) -> Option<Self> {
        let map = environment.map.as_ref()?;
        let side = (map.width / Self::COLUMNS as u32).clamp(SAMPLES_PER_SIDE[0], SAMPLES_PER_SIDE[1]);
        let environment_from_world = environment.world_from_environment.transpose();
        let luminances: Vec<f64> = (0..Self::ROWS * Self::COLUMNS)
            .map(|cell| {
                let within = (0..side * side).map(|i| {
                    let at = Vec2::new((i % side) as f32 + 0.5, (i / side) as f32 + 0.5) / side as f32;
                    f64::from(luminance(map, environment_from_world * direction(cell, at)))
                });
                within.sum()
            })
            .collect();
        let cells = luminances.len();
        let total: f64 = luminances.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let uniform = 1.0 / f64::from(2.0 * PI);
        let opposite = |cell: usize| {
            let (row, column) = (cell / Self::COLUMNS, cell % Self::COLUMNS);
            (Self::ROWS - 1 - row) * Self::COLUMNS + (column + Self::COLUMNS / 2) % Self::COLUMNS
        };
        let relative = |cell: usize| (luminances[cell] + luminances[opposite(cell)]) / total * 0.5 * cells as f64;
        let weight = f64::from(UNIFORM_WEIGHT);
        let pdfs: Vec<f64> = (0..cells).map(|cell| uniform * (weight + (1.0 - weight) * relative(cell))).collect();
        let sums: Vec<f64> = pdfs.chunks_exact(Self::COLUMNS).map(|row| row.iter().sum()).collect();
        Some(Self {
            rows: cumulative(&sums),
            columns: pdfs.chunks_exact(Self::COLUMNS).flat_map(cumulative).collect(),
            pdfs: pdfs.iter().map(|&p| p as f32).collect(),
        })
    }

    /// Samples a unit direction with two numbers in [0, 1).
    #[must_use]
    pub fn draw(&self, [u, v]: [f32; 2]) -> Vec3 {
        let (row, y) = invert(&self.rows, v);
        let (column, x) = invert(&self.columns[row * Self::COLUMNS..][..Self::COLUMNS], u);
        direction(row * Self::COLUMNS + column, Vec2::new(x, y))
    }
}

/// Returns the unit direction at a position in [0, 1]^2 within a cell.
fn direction(cell: usize, at: Vec2) -> Vec3 {
    let (row, column) = (cell / BundleDirections::COLUMNS, cell % BundleDirections::COLUMNS);
    let y = 1.0 - 2.0 * (row as f32 + at.y) / BundleDirections::ROWS as f32;
    let (sin, cos) = (TAU * (column as f32 + at.x) / BundleDirections::COLUMNS as f32).sin_cos();
    let radius = (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(radius * cos, y, radius * sin).normalize()
}

/// Returns the luminance in a direction of the map's space, with the shaders' bilinear interpolation.
fn luminance(map: &EnvironmentMap, d: Vec3) -> f32 {
    let (width, height) = (map.width as i64, map.height as i64);
    let u = (d.x.atan2(-d.z) / TAU).rem_euclid(1.0);
    let v = d.y.clamp(-1.0, 1.0).acos() / PI;
    let x = u * map.width as f32 - 0.5;
    let y = match map.rows {
        Rows::Centred => v * map.height as f32 - 0.5,
        Rows::AtPoles => v * (map.height - 1) as f32,
    };
    let texel = |dx: i64, dy: i64| {
        let column = (x.floor() as i64 + dx).rem_euclid(width);
        let row = (y.floor() as i64 + dy).clamp(0, height - 1);
        Vec3::from(map.texels[(row * width + column) as usize]).dot(LUMINANCE)
    };
    let (fx, fy) = (x - x.floor(), y - y.floor());
    let across = |dy| texel(0, dy) * (1.0 - fx) + texel(1, dy) * fx;
    across(0) * (1.0 - fy) + across(1) * fy
}

/// Returns the cumulative probabilities of weights; the last is 1.
fn cumulative(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let mut next = |weight: &f64| {
        sum += weight;
        (sum / total) as f32
    };
    weights.iter().map(&mut next).collect()
}

/// Inverts cumulative probabilities: returns the index of the interval that holds `u`, and the position
/// within it in [0, 1].
fn invert(shares: &[f32], u: f32) -> (usize, f32) {
    let index = shares.partition_point(|&share| share <= u).min(shares.len() - 1);
    let below = if index == 0 { 0.0 } else { shares[index - 1] };
    (index, ((u - below) / (shares[index] - below)).clamp(0.0, 1.0))
}
