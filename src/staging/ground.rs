//! Finds the ground that everything else in a scene stands on.

use std::collections::HashMap;

use glam::Vec3;

use crate::scene::Geometry;

/// Least extent of a ground on both horizontal axes, relative to all that there is, and its largest height relative to
/// its own smaller extent.
const WIDE: f32 = 0.5;
const HIGH: f32 = 0.1;

/// Largest extent of what stands on a ground, relative to the smaller extent of the ground. Larger things are framed
/// with the ground, such as a town.
const SMALL: f32 = 0.35;

/// Least height of what stands on a ground, relative to its own width, so that it is more than a mark on it.
const RISES: f32 = 0.05;

/// Least share of the triangles in what stands on a ground, so that it is more than a detail of a flat object.
const SHARE_OF_TRIANGLES: f32 = 0.1;

/// Corners of a box.
type Bounds = [Vec3; 2];

const NOTHING: Bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];

fn around([low, high]: Bounds, [other_low, other_high]: Bounds) -> Bounds {
    [low.min(other_low), high.max(other_high)]
}

/// A connected surface.
struct Piece {
    bounds: Bounds,
    triangles: u32,
    is_ground: bool,
}

/// Returns for each vertex if it belongs to a ground: wide, flat, connected surfaces that carry nothing but small things.
///
/// A picture is about what stands on a ground of this kind, such as a model on the plane that a modelling program put
/// below it. A ground may stand on another, such as an island in the sea.
pub fn find(geometry: &Geometry) -> Vec<bool> {
    let roots = roots(geometry);
    let mut pieces = HashMap::new();
    for corners in &geometry.triangles {
        let empty = Piece { bounds: NOTHING, triangles: 0, is_ground: false };
        let piece = pieces.entry(roots[corners[0] as usize]).or_insert(empty);
        piece.triangles += 1;
        piece.bounds =
            corners.iter().fold(piece.bounds, |bounds, &i| around(bounds, [geometry.vertices[i as usize].position; 2]));
    }
    while mark_ground(pieces.values_mut()) {}
    roots.iter().map(|root| pieces.get(root).is_some_and(|piece| piece.is_ground)).collect()
}

/// Marks the pieces that are the ground of all others that are no ground yet. Returns false if there are none.
fn mark_ground<'a>(pieces: impl Iterator<Item = &'a mut Piece>) -> bool {
    fn sum(pieces: &[&mut Piece]) -> (Bounds, u32) {
        pieces.iter().fold((NOTHING, 0), |(bounds, triangles), piece| {
            (around(bounds, piece.bounds), triangles + piece.triangles)
        })
    }
    let rest: Vec<&mut Piece> = pieces.filter(|piece| !piece.is_ground).collect();
    let ([low, high], all_triangles) = sum(&rest);
    let least = WIDE * (high - low);
    let width = |[low, high]: Bounds| (high.x - low.x).min(high.z - low.z);
    let is_ground = |piece: &&mut Piece| {
        let [low, high] = piece.bounds;
        let extent = high - low;
        extent.x >= least.x && extent.z >= least.z && extent.y <= HIGH * width([low, high])
    };
    let (grounds, things): (Vec<_>, Vec<_>) = rest.into_iter().partition(is_ground);
    let ([low, high], triangles) = sum(&things);
    let Some(widest) = grounds.iter().map(|piece| width(piece.bounds)).reduce(f32::max) else { return false };
    let extent = high - low;
    let small = extent.max_element() <= SMALL * widest && extent.y >= RISES * extent.x.max(extent.z);
    if triangles == 0 || !small || (triangles as f32) < SHARE_OF_TRIANGLES * all_triangles as f32 {
        return false;
    }
    grounds.into_iter().for_each(|piece| piece.is_ground = true);
    true
}

/// Returns for each vertex the one that stands for all vertices connected to it by triangles.
fn roots(geometry: &Geometry) -> Vec<u32> {
    let mut parents: Vec<u32> = (0..geometry.vertices.len() as u32).collect();
    // Finds the root of a tree, and halves the way to it for later.
    fn root(parents: &mut [u32], mut at: u32) -> u32 {
        while parents[at as usize] != at {
            parents[at as usize] = parents[parents[at as usize] as usize];
            at = parents[at as usize];
        }
        at
    }
    for corners in &geometry.triangles {
        let ends = corners.map(|corner| root(&mut parents, corner));
        let first = ends.into_iter().fold(u32::MAX, u32::min);
        ends.into_iter().for_each(|end| parents[end as usize] = first);
    }
    (0..parents.len() as u32).map(|at| root(&mut parents, at)).collect()
}
