//! The guide of light from the sky: a density over directions, and for each cell of directions one over the places
//! across them, from the light that paths from the view have found (shaders/lib/lights/sky_guide.wesl).

use crate::render::layouts::Found;
use crate::render::layouts::found_lines::OF_DIRECTION;
use crate::render::layouts::guide_size::{GUIDE_DIRECTIONS, GUIDE_PLACES};

/// Texels along a row of the guide.
pub const SIDE: u32 = GUIDE_DIRECTIONS * GUIDE_PLACES;

/// Rows of the guide: places, then directions.
pub const HEIGHT: u32 = SIDE + GUIDE_DIRECTIONS;

/// Share of a density that stays even, for light that no path has found.
const EVEN: f64 = 0.2;

/// Shares of light in a cell by which what was found and the even density weigh alike.
const FEW: f64 = 8.0;

/// Returns the density of each texel over the even one, row by row.
#[must_use]
pub fn densities(found: &[Found]) -> Vec<f32> {
    let (side, cells, places) = (SIDE as usize, GUIDE_DIRECTIONS as usize, GUIDE_PLACES as usize);
    let mut light = vec![0.0; side * side];
    let mut of_places = vec![Cell::default(); cells * cells];
    let mut of_directions = of_places.clone();
    let cell_of = |texel: usize| texel / side / places * cells + texel % side / places;
    for found in found.iter().filter(|found| found.value > 0.0 && found.value.is_finite()) {
        let texel = (found.texel & !OF_DIRECTION) as usize;
        of_directions[cell_of(texel)].add(found.value);
        if found.texel & OF_DIRECTION == 0 {
            of_places[cell_of(texel)].add(found.value);
            light[texel] += f64::from(found.value);
        }
    }
    let even = even_places();
    let mut densities: Vec<f32> = light
        .iter()
        .enumerate()
        .map(|(texel, value)| {
            let even = even[texel / side % places * places + texel % places];
            of_places[cell_of(texel)].mixed(even, value * (places * places) as f64)
        })
        .collect();
    let all = of_directions
        .iter()
        .fold(Cell::default(), |sum, cell| Cell { light: sum.light + cell.light, shares: sum.shares + cell.shares });
    for row in of_directions.chunks(cells) {
        let row: Vec<f32> = row.iter().map(|cell| all.mixed(1.0, cell.light * (cells * cells) as f64)).collect();
        let mean = row.iter().sum::<f32>() / cells as f32;
        densities.extend(row.iter().copied().chain([mean]).chain(std::iter::repeat_n(0.0, side - cells - 1)));
    }
    densities
}

/// Light that was found in a cell.
#[derive(Clone, Copy, Default)]
struct Cell {
    light: f64,
    shares: u32,
}

impl Cell {
    fn add(&mut self, value: f32) {
        self.light += f64::from(value);
        self.shares += 1;
    }

    /// Mixes an even density with one of light, for a cell of this much light.
    fn mixed(&self, even: f64, light: f64) -> f32 {
        if self.shares == 0 {
            return even as f32;
        }
        let keeps = EVEN.max(FEW / (FEW + f64::from(self.shares)));
        (keeps * even + (1.0 - keeps) * light / self.light) as f32
    }
}

/// Returns the density of a cell's places, even over those that lines through the scene's sphere have.
fn even_places() -> Vec<f64> {
    let places = GUIDE_PLACES as i32;
    // The distance of a place's nearest corner from the middle along an axis, in places.
    let nearest = |at: i32| f64::from((at - places / 2).abs().min((at + 1 - places / 2).abs()));
    let half = 0.5 * f64::from(places);
    let inside: Vec<bool> =
        (0..places * places).map(|i| nearest(i % places).hypot(nearest(i / places)) < half).collect();
    let share = inside.len() as f64 / inside.iter().filter(|inside| **inside).count() as f64;
    inside.iter().map(|&inside| if inside { share } else { 0.0 }).collect()
}
