//! Environment light: its radiance, and importance sampling of its map.
//!
//! The map is bilinear between rows and columns, so it is sampled by cells. A cell lies between four texel
//! centres, or between a pole and the nearest row if rows do not reach the poles. A cell is chosen by mean
//! luminance times solid angle, and a point in it by the bilinear luminance. The density is therefore
//! proportional to the luminance, up to the variation of sin(theta) within a cell.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::distribution::{Table, sample_linear};
use crate::scene::{Environment, EnvironmentMap, Rows};

/// Weights of Rec. 709 luminance.
pub const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// An environment, prepared for look-up and, if it has a map, for sampling.
pub struct Sky<'s> {
    environment: &'s Environment,
    table: Option<SkyTable>,
}

/// A row of the bilinear interpolation: its v coordinate and its index.
type Knot = (f32, u32);

struct SkyTable {
    /// Boundaries of the bands of cells, ascending in v.
    knots: Vec<Knot>,
    rows: Table,
    columns: Vec<Table>,
    /// Integral of luminance times the band's sine over the unit square.
    integral: f32,
    /// Luminance of the mean radiance times 4 pi: the flux through a unit cross-section.
    power: f32,
}

impl<'s> Sky<'s> {
    /// Prepares an environment.
    #[must_use]
    pub fn new(environment: &'s Environment) -> Self {
        let map = environment.map.as_ref();
        let table = map.and_then(|map| SkyTable::new(map, environment.radiance.dot(LUMINANCE)));
        Self { environment, table }
    }

    /// Returns the luminance of the flux through a unit disk from all directions. It is 0 for a constant sky,
    /// for which BSDF sampling alone is optimal.
    #[must_use]
    pub fn power(&self) -> f32 {
        self.table.as_ref().map_or(0.0, |t| t.power)
    }

    /// Returns the radiance that arrives along `-direction`.
    #[must_use]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.environment.seen(direction)
    }

    /// Samples a direction towards the sky. Returns it with its density per solid angle; none if the density
    /// is zero.
    #[must_use]
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let (map, table) = (self.environment.map.as_ref()?, self.table.as_ref()?);
        let (band, _, y) = table.rows.sample(u.y);
        let (cell, _, x) = table.columns[band].sample(u.x);
        let [a, b, c, d] = table.corners(map, band, cell);
        let fy = sample_linear(y, a + b, c + d);
        let fx = sample_linear(x, a + (c - a) * fy, b + (d - b) * fy);
        let (v0, v1) = (table.knots[band].0, table.knots[band + 1].0);
        let v = v0 + (v1 - v0) * fy;
        let phi = TAU * (cell as f32 + 0.5 + fx) / map.width as f32;
        let (sin_theta, cos_theta) = (v * PI).sin_cos();
        let local = Vec3::new(phi.sin() * sin_theta, cos_theta, -phi.cos() * sin_theta);
        let direction = self.environment.world_from_environment * local;
        // The density is evaluated for the final direction. Rounding at a cell's edge then changes radiance
        // and density alike.
        let pdf_w = self.pdf_w(direction);
        (pdf_w > 0.0).then_some((direction, pdf_w))
    }

    /// Returns the density of [`Self::sample`] per solid angle.
    #[must_use]
    pub fn pdf_w(&self, direction: Vec3) -> f32 {
        let (Some(map), Some(table)) = (&self.environment.map, &self.table) else { return 0.0 };
        let at = self.environment.coordinates(direction);
        let sin_theta = (at.y * PI).sin();
        if sin_theta <= 0.0 {
            return 0.0;
        }
        let band = table.knots.partition_point(|k| k.0 <= at.y).clamp(1, table.knots.len() - 1) - 1;
        let (v0, v1) = (table.knots[band].0, table.knots[band + 1].0);
        let x = at.x * map.width as f32 - 0.5;
        let cell = (x.floor() as i64).rem_euclid(i64::from(map.width)) as usize;
        let (fx, fy) = (x - x.floor(), (at.y - v0) / (v1 - v0));
        let [a, b, c, d] = table.corners(map, band, cell);
        let value = (a + (b - a) * fx) * (1.0 - fy) + (c + (d - c) * fx) * fy;
        // du dv = dw / (2 pi^2 sin theta).
        value * table.band_sine(band) / (table.integral * TAU * PI * sin_theta)
    }
}

impl SkyTable {
    /// Creates the table; none if the map is black.
    fn new(map: &EnvironmentMap, scale: f32) -> Option<Self> {
        let (width, height) = (map.width as usize, map.height);
        let mut knots: Vec<Knot> = match map.rows {
            Rows::AtPoles if height > 1 => (0..height).map(|r| (r as f32 / (height - 1) as f32, r)).collect(),
            Rows::AtPoles => vec![(0.0, 0), (1.0, 0)],
            Rows::Centred => (0..height).map(|r| ((r as f32 + 0.5) / height as f32, r)).collect(),
        };
        if map.rows == Rows::Centred {
            knots.insert(0, (0.0, 0));
            knots.push((1.0, height - 1));
        }
        let mut table = Self { knots, rows: Table::default(), columns: Vec::new(), integral: 0.0, power: 0.0 };
        let mut bands = Vec::new();
        for band in 0..table.knots.len() - 1 {
            let cells: Vec<f32> =
                (0..width).map(|cell| table.corners(map, band, cell).iter().sum::<f32>() * 0.25).collect();
            let size = (table.knots[band + 1].0 - table.knots[band].0) / width as f32;
            let columns = Table::new(&cells);
            bands.push(columns.total() * size * table.band_sine(band));
            table.columns.push(columns);
        }
        table.rows = Table::new(&bands);
        table.integral = table.rows.total();
        table.power = table.integral * TAU * PI * scale;
        (table.power > 0.0 && table.power.is_finite()).then_some(table)
    }

    /// Returns the luminance at a cell's corners: upper left, upper right, lower left, lower right.
    fn corners(&self, map: &EnvironmentMap, band: usize, cell: usize) -> [f32; 4] {
        let width = map.width as usize;
        let luminance = |row: u32, column: usize| {
            let texel = map.texels[row as usize * width + column % width];
            Vec3::from(texel).dot(LUMINANCE).max(0.0)
        };
        let (above, below) = (self.knots[band].1, self.knots[band + 1].1);
        [luminance(above, cell), luminance(above, cell + 1), luminance(below, cell), luminance(below, cell + 1)]
    }

    /// Returns the sine of the polar angle at the centre of a band, used for the whole band.
    fn band_sine(&self, band: usize) -> f32 {
        (0.5 * (self.knots[band].0 + self.knots[band + 1].0) * PI).sin()
    }
}

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;
    use crate::reference::sampler::hash;

    fn sky(rows: Rows) -> Environment {
        let (width, height) = (16, 8);
        let value = |i: u32| match i {
            // The map has a sun, and rows at the poles that differ from their neighbours.
            53 => [90.0, 80.0, 60.0],
            0..16 => [3.0, 1.0, 0.5],
            112..128 => [0.0, 0.1 * (i % 5) as f32, 0.2],
            _ => [0.2 + 0.1 * (hash(i) % 7) as f32, 0.3, 0.4 * (i % 3) as f32],
        };
        let map = EnvironmentMap { width, height, texels: (0..width * height).map(value).collect(), rows };
        Environment {
            radiance: Vec3::new(1.0, 2.0, 0.5),
            map: Some(map),
            world_from_environment: Mat3::from_rotation_y(0.7),
        }
    }

    /// Integrates over the sphere by the midpoint rule in the map's coordinates.
    fn integrate(f: impl Fn(Vec3) -> f32) -> f64 {
        let (nu, nv) = (1024, 512);
        let mut sum = 0.0;
        for j in 0..nv {
            let theta = PI * (j as f32 + 0.5) / nv as f32;
            for i in 0..nu {
                let phi = TAU * (i as f32 + 0.5) / nu as f32;
                let d = Vec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin());
                sum += f64::from(f(d) * theta.sin());
            }
        }
        sum * f64::from(TAU * PI) / f64::from(nu * nv)
    }

    #[test]
    fn rows_are_met_where_they_are_said_to_be() {
        let map = |rows| Environment {
            radiance: Vec3::ONE,
            map: Some(EnvironmentMap { width: 1, height: 3, texels: vec![[0.0; 3], [1.0; 3], [4.0; 3]], rows }),
            world_from_environment: Mat3::IDENTITY,
        };
        let at = |environment: &Environment, v: f32| {
            let d = Vec3::new(0.0, (v * PI).cos(), -(v * PI).sin());
            Sky::new(environment).radiance(d).x
        };
        let poles = map(Rows::AtPoles);
        let centred = map(Rows::Centred);
        for (environment, v, expected) in [
            (&poles, 0.0, 0.0),
            (&poles, 0.25, 0.5),
            (&poles, 0.5, 1.0),
            (&poles, 1.0, 4.0),
            (&centred, 0.0, 0.0),
            (&centred, 1.0 / 6.0, 0.0),
            (&centred, 1.0 / 3.0, 0.5),
            (&centred, 0.5, 1.0),
            (&centred, 0.9, 4.0),
        ] {
            assert!((at(environment, v) - expected).abs() < 1e-5, "v {v}: {} is not {expected}", at(environment, v));
        }
    }

    #[test]
    fn columns_follow_the_stated_azimuth() {
        // u = atan2(x, -z) / 2 pi, so +X is u = 1/4 and +Z is u = 1/2.
        let texels = (0..4).map(|i| [i as f32; 3]).collect();
        let environment = Environment {
            radiance: Vec3::ONE,
            map: Some(EnvironmentMap { width: 4, height: 1, texels, rows: Rows::Centred }),
            world_from_environment: Mat3::IDENTITY,
        };
        let sky = Sky::new(&environment);
        assert!((sky.radiance(Vec3::X).x - 0.5).abs() < 1e-5);
        assert!((sky.radiance(Vec3::Z).x - 1.5).abs() < 1e-5);
        assert!((sky.radiance(Vec3::NEG_X).x - 2.5).abs() < 1e-5);
        assert!((sky.radiance(Vec3::NEG_Z).x - 1.5).abs() < 1e-5, "wraps: between 3 and 0");
    }

    #[test]
    fn the_density_integrates_to_one_and_covers_the_value() {
        for rows in [Rows::AtPoles, Rows::Centred] {
            let environment = sky(rows);
            let sky = Sky::new(&environment);
            let total = integrate(|d| sky.pdf_w(d));
            assert!((total - 1.0).abs() < 3e-3, "{rows:?}: {total}");
            let uncovered = integrate(|d| if sky.pdf_w(d) == 0.0 { sky.radiance(d).x } else { 0.0 });
            assert_eq!(uncovered, 0.0, "{rows:?}");
        }
    }

    #[test]
    fn sampling_gives_the_integral_of_the_radiance() {
        for rows in [Rows::AtPoles, Rows::Centred] {
            let environment = sky(rows);
            let sky = Sky::new(&environment);
            for axis in 0..3 {
                let expected = integrate(|d| sky.radiance(d)[axis]);
                let n = 1 << 16;
                let mut sum = 0.0;
                for i in 0..n {
                    let [x, y, ..] = sobol_burley::sample_4d(i, 0, 5);
                    let Some((d, pdf_w)) = sky.sample(Vec2::new(x, y)) else { continue };
                    assert!((d.length() - 1.0).abs() < 1e-5);
                    sum += f64::from(sky.radiance(d)[axis] / pdf_w);
                }
                let actual = sum / f64::from(n);
                assert!((actual / expected - 1.0).abs() < 3e-3, "{rows:?} {axis}: {actual} is not {expected}");
            }
        }
    }
}
