//! Directions of ray-bundles under a sky with a map: eq. (2) of section 3.3, precomputed (shaders/lib/bundle.wesl).

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::scene::{Environment, EnvironmentMap, LUMINANCE, Rows};

/// Share of the directions that go everywhere alike, for what comes from other surfaces: L_o of eq. (2) as a share of the mean L_e.
const EVEN: f32 = 0.5;
/// Samples along a side of a cell: at least, so that what is interpolated between texels counts where it is, and at most.
const FINENESS: [u32; 2] = [4, 16];

/// A density over cells of the sphere that are alike in area, the same for opposite directions.
pub struct BundleDirections {
    /// Density of a direction or its opposite per steradian, row by row.
    pub pdfs: Vec<f32>,
    /// Cumulative shares of the rows.
    rows: Vec<f32>,
    /// Of each row's cells.
    columns: Vec<f32>,
}

impl BundleDirections {
    /// Rows of cells, by the cosine from +Y.
    pub const ROWS: usize = 128;
    /// Cells of a row, by the angle around +Y.
    pub const COLUMNS: usize = 256;

    /// Follows what the map sends; none where there is no map, or nothing in it.
    #[must_use]
    pub fn new(environment: &Environment) -> Option<Self> {
        let map = environment.map.as_ref()?;
        let finest = (map.width / Self::COLUMNS as u32).clamp(FINENESS[0], FINENESS[1]);
        let environment_from_world = environment.world_from_environment.transpose();
        let sent: Vec<f64> = (0..Self::ROWS * Self::COLUMNS)
            .map(|cell| {
                let within = (0..finest * finest).map(|i| {
                    let at = Vec2::new((i % finest) as f32 + 0.5, (i / finest) as f32 + 0.5) / finest as f32;
                    f64::from(luminance(map, environment_from_world * direction(cell, at)))
                });
                within.sum()
            })
            .collect();
        let cells = sent.len();
        let total: f64 = sent.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let even = 1.0 / f64::from(2.0 * PI);
        let opposite = |cell: usize| {
            let (row, column) = (cell / Self::COLUMNS, cell % Self::COLUMNS);
            (Self::ROWS - 1 - row) * Self::COLUMNS + (column + Self::COLUMNS / 2) % Self::COLUMNS
        };
        let lit = |cell: usize| (sent[cell] + sent[opposite(cell)]) / total * 0.5 * cells as f64;
        let share = f64::from(EVEN);
        let pdfs: Vec<f64> = (0..cells).map(|cell| even * (share + (1.0 - share) * lit(cell))).collect();
        let sums: Vec<f64> = pdfs.chunks_exact(Self::COLUMNS).map(|row| row.iter().sum()).collect();
        Some(Self {
            rows: cumulative(&sums),
            columns: pdfs.chunks_exact(Self::COLUMNS).flat_map(cumulative).collect(),
            pdfs: pdfs.iter().map(|&p| p as f32).collect(),
        })
    }

    /// A unit direction by two numbers in [0, 1).
    #[must_use]
    pub fn draw(&self, [u, v]: [f32; 2]) -> Vec3 {
        let (row, y) = place(&self.rows, v);
        let (column, x) = place(&self.columns[row * Self::COLUMNS..][..Self::COLUMNS], u);
        direction(row * Self::COLUMNS + column, Vec2::new(x, y))
    }
}

/// The direction at a place in [0, 1]^2 of a cell.
fn direction(cell: usize, at: Vec2) -> Vec3 {
    let (row, column) = (cell / BundleDirections::COLUMNS, cell % BundleDirections::COLUMNS);
    let y = 1.0 - 2.0 * (row as f32 + at.y) / BundleDirections::ROWS as f32;
    let (sin, cos) = (TAU * (column as f32 + at.x) / BundleDirections::COLUMNS as f32).sin_cos();
    let radius = (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(radius * cos, y, radius * sin).normalize()
}

/// Luminance in a direction of the map's own space, bilinear as the shaders have it.
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

/// Shares that end at 1.
fn cumulative(weights: &[f64]) -> Vec<f32> {
    let total: f64 = weights.iter().sum();
    let mut sum = 0.0;
    let mut next = |weight: &f64| {
        sum += weight;
        (sum / total) as f32
    };
    weights.iter().map(&mut next).collect()
}

/// Which share a number falls into, and where in it.
fn place(shares: &[f32], u: f32) -> (usize, f32) {
    let index = shares.partition_point(|&share| share <= u).min(shares.len() - 1);
    let below = if index == 0 { 0.0 } else { shares[index - 1] };
    (index, ((u - below) / (shares[index] - below)).clamp(0.0, 1.0))
}
