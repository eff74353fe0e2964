//! The guide of light from the sky: a density over directions, and for each cell of directions one over the places
//! across them, from the light that paths from the view have found (shaders/lib/lights/sky_guide.wesl), and what each part
//! of the scene sees of it ([`local_sky`]).
//!
//! A path finds few lines beside the number of texels. Light comes in through openings, and from near directions, so
//! that each line stands for many: it is turned about points of itself, of which some are near an opening.

use glam::{Vec2, Vec3};

use crate::render::layouts::FoundLine;
use crate::render::layouts::guide_size::{GUIDE_DIRECTIONS, GUIDE_PLACES};
use crate::render::layouts::line_end::AT_LATER;
use crate::render::lights::local_sky;
use crate::render::lights::octahedral::{from_octahedral, octahedral};

/// Texels along a row of the guide.
pub const SIDE: u32 = GUIDE_DIRECTIONS * GUIDE_PLACES;

/// Rows of the guide: places, then directions, then what each part of the scene sees.
pub const HEIGHT: u32 = SIDE + GUIDE_DIRECTIONS + local_sky::ROWS;

/// Half side of the square of places over the radius of the scene's sphere (GUIDE_EXTENT).
pub const EXTENT: f32 = 1.02;

/// Share of a density that stays even, for light that no path has found.
const EVEN: f64 = 0.2;

/// Lines by which what was found and the even density weigh alike.
const FEW: f64 = 8.0;

/// Lines that stand for all that were found, and the most that stand for one of them.
const TURNED: usize = 1 << 19;
const MOST_TURNED: usize = 512;

/// The largest tangent of a turn, along each of two axes.
const TURN: f32 = 0.5;

/// Steps of the additive recurrence in five dimensions: powers of the root of x^6 = x + 1 (Roberts, "The Unreasonable
/// Effectiveness of Quasirandom Sequences", 2018).
const STEPS: [f64; 5] =
    [0.881_271_461_658_7, 0.776_639_389_133_8, 0.684_430_129_549_4, 0.603_168_740_685_7, 0.531_555_397_729_4];

/// Returns the density of each texel over the even one, row by row, and below the slots of each part of the scene. The
/// scene's box has half the extent `half`, over the half side of the guide's square of places.
#[must_use]
pub fn densities(found: &[FoundLine], half: Vec3) -> Vec<f32> {
    let (side, cells, places) = (SIDE as usize, GUIDE_DIRECTIONS as usize, GUIDE_PLACES as usize);
    let found: Vec<_> = found.iter().filter(|line| line.value > 0.0 && line.value.is_finite()).collect();
    let turned = (TURNED / found.len().max(1)).clamp(1, MOST_TURNED);
    let mut of_directions = vec![0.0; cells * cells];
    let mut of_places = vec![0.0; cells * cells];
    let mut light = vec![0.0; side * side];
    let mut seen = vec![0.0; side * side];
    let mut index = 0;
    for line in &found {
        for _ in 0..turned {
            index += 1;
            let u = STEPS.map(|step| (0.5 + f64::from(index) * step).fract() as f32);
            let (cell, place) = texel_near(line, u);
            let value = f64::from(line.value);
            let texel = (cell[1] * places + place[1]) * side + cell[0] * places + place[0];
            of_directions[cell[1] * cells + cell[0]] += value;
            seen[texel] += value;
            if line.vertex == AT_LATER {
                of_places[cell[1] * cells + cell[0]] += value;
                light[texel] += value;
            }
        }
    }
    let later = found.iter().filter(|line| line.vertex == AT_LATER).count();
    let (even, few) = (even_places(), even_share(later));
    let mut densities: Vec<f32> = light
        .iter()
        .enumerate()
        .map(|(texel, value)| {
            let (x, y) = (texel % side, texel / side);
            let even = even[y % places * places + x % places];
            mixed(few, even, value * (places * places) as f64, of_places[y / places * cells + x / places])
        })
        .collect();
    let (all, few) = (of_directions.iter().sum(), even_share(found.len()));
    for row in of_directions.chunks(cells) {
        let row: Vec<f32> = row.iter().map(|value| mixed(few, 1.0, value * (cells * cells) as f64, all)).collect();
        let mean = row.iter().sum::<f32>() / cells as f32;
        densities.extend(row.iter().copied().chain([mean]).chain(std::iter::repeat_n(0.0, side - cells - 1)));
    }
    densities.extend(local_sky::slots(&seen, &of_directions, half));
    densities
}

/// Returns the cell of directions and the place of a line near one that was found, by five numbers in [0, 1): it is
/// turned about a point of the line, and moved within the size of a place.
fn texel_near(line: &FoundLine, [a, b, along, c, d]: [f32; 5]) -> ([usize; 2], [usize; 2]) {
    let (w, offset) = (Vec3::from(line.w), Vec3::from(line.offset));
    // The scene's sphere has a radius just below 1.
    let to_middle = -offset.dot(w);
    let length = to_middle + (to_middle * to_middle + 1.0 - offset.length_squared()).max(0.0).sqrt();
    let point = offset + w * (along * length);
    let (right, up) = w.any_orthonormal_pair();
    let turn = Vec2::new(tent(a), tent(b)) * TURN;
    let w = (w + right * turn.x + up * turn.y).normalize();
    let cell = cell_of(0.5 + 0.5 * octahedral(w), GUIDE_DIRECTIONS);
    let (right, up) = middle_of(cell).any_orthonormal_pair();
    let place = 0.5 + 0.5 * Vec2::new(point.dot(right), point.dot(up));
    (cell, cell_of(place + (Vec2::new(c, d) - 0.5) / GUIDE_PLACES as f32, GUIDE_PLACES))
}

/// Returns the cell of a point of the unit square.
pub(super) fn cell_of(at: Vec2, cells: u32) -> [usize; 2] {
    (at * cells as f32).to_array().map(|x| (x.max(0.0) as usize).min(cells as usize - 1))
}

/// Returns the unit vector in the middle of a cell of directions.
pub(super) fn middle_of(cell: [usize; 2]) -> Vec3 {
    from_octahedral(Vec2::from(cell.map(|x| (2.0 * x as f32 + 1.0) / GUIDE_DIRECTIONS as f32 - 1.0)))
}

/// Maps a number in [0, 1) to one in [-1, 1) whose density falls evenly to both sides.
fn tent(u: f32) -> f32 {
    let v = 2.0 * u - 1.0;
    (1.0 - (1.0 - v.abs()).max(0.0).sqrt()).copysign(v)
}

/// Returns the share of a density that stays even where this many lines were found.
fn even_share(lines: usize) -> f64 {
    EVEN.max(FEW / (FEW + lines as f64))
}

/// Mixes an even density with one of `light` out of `all`, or returns the even one where there is none.
fn mixed(share: f64, even: f64, light: f64, all: f64) -> f32 {
    (if all > 0.0 { share * even + (1.0 - share) * light / all } else { even }) as f32
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
