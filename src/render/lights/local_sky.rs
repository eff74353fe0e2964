//! The directions in which points of each part of the scene see the sky, from the lines that paths from the view have
//! found (shaders/lib/lights/local_sky.wesl).

use glam::{UVec3, Vec2, Vec3};
use rayon::prelude::*;

use crate::render::layouts::guide_size::{GUIDE_DIRECTIONS, GUIDE_PLACES};
use crate::render::layouts::local_sky_size::{LOCAL_CELLS, LOCAL_DIRECTIONS};
use crate::render::lights::sky_guide::{SIDE, cell_of, middle_of};

/// Directions of a cell.
const DIRECTIONS: usize = (LOCAL_DIRECTIONS * LOCAL_DIRECTIONS) as usize;

/// Cells in a row of the guide.
const TILES: usize = (SIDE / LOCAL_DIRECTIONS) as usize;

/// Cells of the scene's box.
const CELLS: u32 = LOCAL_CELLS * LOCAL_CELLS * LOCAL_CELLS;

/// Rows of the guide that hold the cells.
pub const ROWS: u32 = CELLS / TILES as u32 * LOCAL_DIRECTIONS;

/// Returns the directions of each cell's slots and the slots of each direction, row by row of the guide. `light` is what
/// the lines send through each place, row by row of places, and `of_directions` all of it by direction, for cells that no
/// line passes. Of each direction the line through one point of a cell counts. The scene's box has half the extent
/// `half`, over the half side of the guide's square of places.
#[must_use]
pub fn slots(light: &[f64], of_directions: &[f64], half: Vec3) -> Vec<f32> {
    let axes: Vec<_> = (0..GUIDE_DIRECTIONS * GUIDE_DIRECTIONS)
        .map(|i| {
            let cell = [i % GUIDE_DIRECTIONS, i / GUIDE_DIRECTIONS].map(|x| x as usize);
            (cell, middle_of(cell).any_orthonormal_pair())
        })
        .collect();
    let anywhere = words(&sums(axes.iter().map(|&(cell, _)| cell).zip(of_directions.iter().copied())));
    let cells: Vec<_> = (0..CELLS)
        .into_par_iter()
        .map(|index| {
            let corner = UVec3::new(index, index / LOCAL_CELLS, index / LOCAL_CELLS.pow(2)) % LOCAL_CELLS;
            let through = axes.iter().zip(0..).map(|(&(cell, (right, up)), direction)| {
                let point = ((corner.as_vec3() + jitter(direction)) * (2.0 / LOCAL_CELLS as f32) - 1.0) * half;
                let place = 0.5 + 0.5 * Vec2::new(point.dot(right), point.dot(up));
                (cell, light[texel(cell, cell_of(place, GUIDE_PLACES))])
            });
            let sums = sums(through);
            if sums.iter().any(|&sum| sum > 0.0) { words(&sums) } else { anywhere }
        })
        .collect();
    let mut rows = Vec::with_capacity((SIDE * ROWS) as usize);
    for tiles in cells.chunks(TILES) {
        for row in 0..LOCAL_DIRECTIONS as usize {
            let of_row = row * LOCAL_DIRECTIONS as usize..(row + 1) * LOCAL_DIRECTIONS as usize;
            tiles.iter().for_each(|tile| rows.extend_from_slice(&tile[of_row.clone()]));
        }
    }
    rows
}

/// Returns the texel of a place of a cell of directions.
fn texel(cell: [usize; 2], place: [usize; 2]) -> usize {
    let places = GUIDE_PLACES as usize;
    (cell[1] * places + place[1]) * SIDE as usize + cell[0] * places + place[0]
}

/// Adds up values of the guide's directions in those of a cell, which are larger.
fn sums(values: impl Iterator<Item = ([usize; 2], f64)>) -> [f64; DIRECTIONS] {
    let (larger, side) = ((GUIDE_DIRECTIONS / LOCAL_DIRECTIONS) as usize, LOCAL_DIRECTIONS as usize);
    let mut sums = [0.0; DIRECTIONS];
    values.for_each(|([x, y], value)| sums[y / larger * side + x / larger] += value);
    sums
}

/// Gives each direction slots in proportion to a sum, and returns the direction of each slot and, above it, the slots of
/// the direction with the same index.
fn words(sums: &[f64; DIRECTIONS]) -> [f32; DIRECTIONS] {
    let all: f64 = sums.iter().sum();
    let mut words = [0; DIRECTIONS];
    let (mut sum, mut first) = (0.0, 0);
    for (direction, value) in sums.iter().enumerate() {
        sum += if all > 0.0 { value / all } else { 1.0 / DIRECTIONS as f64 };
        let end = if direction + 1 == DIRECTIONS { DIRECTIONS } else { (sum * DIRECTIONS as f64).round() as usize };
        words[first..end.max(first)].iter_mut().for_each(|word| *word += direction);
        words[direction] += (end.max(first) - first) * DIRECTIONS;
        first = end.max(first);
    }
    words.map(|word| word as f32)
}

/// Returns a point of the unit cube (Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018).
fn jitter(index: u32) -> Vec3 {
    let step = |root: f64| (0.5 + f64::from(index) * root).fract() as f32;
    Vec3::new(step(0.819_172_513_396_164_4), step(0.671_043_606_703_789_3), step(0.549_700_477_901_970_3))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A direction has as many slots as name it, in proportion to its sum.
    #[test]
    fn slots_follow_the_sums() {
        let mut sums = std::array::from_fn(|i| f64::from(i as u32 % 7) + 0.1);
        sums[3] = 200.0;
        let all: f64 = sums.iter().sum();
        let words = words(&sums).map(|word| word as usize);
        for (direction, sum) in sums.iter().enumerate() {
            let slots = words[direction] / DIRECTIONS;
            assert_eq!(slots, words.iter().filter(|&word| word % DIRECTIONS == direction).count());
            assert!((slots as f64 - sum / all * DIRECTIONS as f64).abs() <= 1.0, "{direction}: {slots}");
        }
        assert_eq!(words.iter().map(|word| word / DIRECTIONS).sum::<usize>(), DIRECTIONS);
    }

    /// Only the cells that lines pass see the sky along them.
    #[test]
    fn cells_see_the_sky_along_the_lines() {
        let (places, middle) = (GUIDE_PLACES as usize, GUIDE_DIRECTIONS as usize / 2);
        let (narrow, wide) = ([middle; 2], [middle, 2]);
        let mut light = vec![0.0; (SIDE * SIDE) as usize];
        let mut of_directions = vec![0.0; (GUIDE_DIRECTIONS * GUIDE_DIRECTIONS) as usize];
        let even = slots(&light, &of_directions, Vec3::splat(0.5));
        assert!(even.iter().all(|&word| word as usize / DIRECTIONS == 1), "without lines all are even");
        // Light along the z axis comes through the four middle places, that along another direction through all.
        (0..4).for_each(|i| light[texel(narrow, [places / 2 - i % 2, places / 2 - i / 2])] = 1.0);
        (0..places * places).for_each(|i| light[texel(wide, [i % places, i / places])] = 1.0);
        of_directions[narrow[1] * 2 * middle + narrow[0]] = 4.0;
        of_directions[wide[1] * 2 * middle + wide[0]] = (places * places) as f64;
        let words = slots(&light, &of_directions, Vec3::splat(0.5));
        assert_eq!(words.len(), (SIDE * ROWS) as usize);
        let sees = |cell: [u32; 3], direction: [usize; 2]| {
            let tile = ((cell[2] * LOCAL_CELLS + cell[1]) * LOCAL_CELLS + cell[0]) as usize;
            let first = [tile % TILES, tile / TILES].map(|at| at * LOCAL_DIRECTIONS as usize);
            words[(first[1] + direction[1] / 2) * SIDE as usize + first[0] + direction[0] / 2] as usize >= DIRECTIONS
        };
        let half = LOCAL_CELLS / 2;
        for z in 0..LOCAL_CELLS {
            assert!(sees([half, half, z], narrow) && sees([half, half, z], wide), "{z}");
            assert!(!sees([0, 0, z], narrow) && sees([0, 0, z], wide), "{z}");
        }
    }
}
