//! Points and lines of files without faces, as scanners and drawing programs write them: drawn as balls that about touch,
//! and as thin tubes.

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::scene::Mesh;
use crate::scene::model::shapes;

/// Most triangles of a mesh of balls or tubes. Of more points and lines, some are drawn.
const MOST_TRIANGLES: usize = 1_000_000;

/// Points whose distance to their neighbours is measured.
const MEASURED: usize = 256;

/// The neighbour whose median distance tells the radius of balls, and the radius over it: points of a square grid have four
/// next ones, and balls of points that are strewn over a surface cover three quarters of it.
const NEIGHBOUR: usize = 4;
const RADIUS: f32 = 0.6;

/// Radii over the diagonal of the box around all points: of tubes, of balls with less neighbours, and the least of balls,
/// since points may coincide.
const TUBE: f32 = 1.0 / 400.0;
const LONE_BALL: f32 = 1.0 / 40.0;
const LEAST_BALL: f32 = 1.0 / 4000.0;

/// Sides of a tube.
const SIDES: u32 = 6;

/// Returns balls around points, flat-shaded, with what is to be said of them. `colors`: linear, one for each point, or none.
pub(super) fn balls(points: &[Vec3], colors: &[Vec4]) -> (Mesh, String) {
    let ball = [2, 1, 0]
        .map(shapes::icosphere)
        .into_iter()
        .find(|b| b.triangles.len().saturating_mul(points.len()) <= MOST_TRIANGLES);
    let ball = ball.unwrap_or_else(|| shapes::sphere(4, 2)); // an octahedron
    let step = thinned(points.len(), ball.triangles.len());
    let drawn: Vec<Vec3> = points.iter().copied().step_by(step).collect();
    let radius = radius(&drawn);
    let mut mesh = Mesh { name: "points".to_owned(), ..Mesh::default() };
    for (at, &middle) in drawn.iter().enumerate() {
        add(&mut mesh, ball.positions.iter().map(|&p| middle + radius * p), &ball.triangles, colors.get(at * step));
    }
    let which = if step == 1 { "are drawn as balls".to_owned() } else { format!("are drawn as balls, one of {step}") };
    (mesh, format!("the file has {} points and no faces: they {which}", points.len()))
}

/// Returns tubes along lines between pairs of points, flat-shaded and open, with what is to be said of them. `colors`: linear,
/// one for each point, or none.
pub(super) fn tubes(points: &[Vec3], lines: &[[u32; 2]], colors: &[Vec4]) -> (Mesh, String) {
    let step = thinned(lines.len(), 2 * SIDES as usize);
    let radius = TUBE * diagonal(points);
    let side = |i: u32| {
        let next = (i + 1) % SIDES;
        [[2 * i, 2 * next, 2 * next + 1], [2 * i, 2 * next + 1, 2 * i + 1]]
    };
    let triangles: Vec<[u32; 3]> = (0..SIDES).flat_map(side).collect();
    let mut mesh = Mesh { name: "lines".to_owned(), ..Mesh::default() };
    for line in lines.iter().step_by(step) {
        let ends = line.map(|end| points[end as usize]);
        let Some(axis) = (ends[1] - ends[0]).try_normalize() else { continue };
        let (s, t) = axis.any_orthonormal_pair();
        let corner = |i: u32| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / SIDES as f32).sin_cos();
            ends.map(|end| end + radius * (cos * s + sin * t))
        };
        add(&mut mesh, (0..SIDES).flat_map(corner), &triangles, colors.get(line[0] as usize));
    }
    let which = if step == 1 { "are drawn as tubes".to_owned() } else { format!("are drawn as tubes, one of {step}") };
    (mesh, format!("the file has {} lines and no faces: they {which}", lines.len()))
}

/// Adds a body of one colour.
fn add(mesh: &mut Mesh, positions: impl Iterator<Item = Vec3>, triangles: &[[u32; 3]], color: Option<&Vec4>) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(positions);
    if let Some(&color) = color {
        mesh.colors.resize(mesh.positions.len(), color);
    }
    mesh.triangles.extend(triangles.iter().map(|triangle| triangle.map(|corner| first + corner)));
}

/// Returns the step by which so many bodies have at most [`MOST_TRIANGLES`].
fn thinned(count: usize, triangles: usize) -> usize {
    (count * triangles).div_ceil(MOST_TRIANGLES).max(1)
}

/// Returns the radius of balls that about touch.
fn radius(points: &[Vec3]) -> f32 {
    let step = points.len().div_ceil(MEASURED).max(1);
    let measured: Vec<Vec3> = points.iter().copied().step_by(step).collect();
    let mut distances: Vec<f32> = measured.par_iter().filter_map(|&point| to_neighbour(point, points)).collect();
    distances.sort_by(f32::total_cmp);
    let [alone, least] = [LONE_BALL, LEAST_BALL].map(|share| share * diagonal(points));
    let radius = distances.get(distances.len() / 2).map_or(alone, |distance| (RADIUS * distance).max(least));
    if radius > 0.0 { radius } else { 1.0 }
}

/// Returns the distance of a point to the [`NEIGHBOUR`]th of its neighbours; none if there are less.
fn to_neighbour(point: Vec3, points: &[Vec3]) -> Option<f32> {
    let mut nearest = [f32::INFINITY; NEIGHBOUR + 1]; // the point itself is one of them
    for other in points {
        let distance = other.distance_squared(point);
        if distance < nearest[NEIGHBOUR] {
            let at = nearest.partition_point(|&near| near <= distance);
            nearest[at..].rotate_right(1);
            nearest[at] = distance;
        }
    }
    nearest[NEIGHBOUR].is_finite().then(|| nearest[NEIGHBOUR].sqrt())
}

/// Returns the diagonal of the box around points.
fn diagonal(points: &[Vec3]) -> f32 {
    let least = points.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let most = points.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    (most - least).max(Vec3::ZERO).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square grid of points, `side` by `side`, a metre apart.
    fn grid(side: u32) -> Vec<Vec3> {
        (0..side * side).map(|i| Vec3::new((i % side) as f32, 0.0, (i / side) as f32)).collect()
    }

    #[test]
    fn balls_of_a_grid_about_touch() {
        for (side, triangles) in [(5, 320), (100, 80), (200, 20), (300, 8)] {
            let points = grid(side);
            let (mesh, said) = balls(&points, &[]);
            assert_eq!(mesh.triangles.len(), points.len() * triangles, "{side}");
            assert!(said.contains(&format!("{} points", points.len())) && !said.contains("one of"), "{said}");
            let corners = mesh.positions.len() / points.len();
            for (at, middle) in points.iter().enumerate() {
                for corner in &mesh.positions[at * corners..(at + 1) * corners] {
                    assert!((0.55..0.85).contains(&corner.distance(*middle)), "{side}: {corner}, {middle}");
                }
            }
        }
    }

    #[test]
    fn of_many_points_some_are_drawn_larger() {
        let (mesh, said) = balls(&grid(500), &vec![Vec4::ONE; 250_000]);
        assert!(mesh.triangles.len() <= MOST_TRIANGLES && mesh.triangles.len() > MOST_TRIANGLES / 2);
        assert!(said.ends_with("one of 2"), "{said}");
        assert_eq!(mesh.colors.len(), mesh.positions.len());
    }

    #[test]
    fn points_without_neighbours_have_balls() {
        for points in [vec![Vec3::ONE], vec![Vec3::ZERO, Vec3::splat(400.0)], vec![Vec3::ZERO; 9]] {
            let (mesh, _) = balls(&points, &[]);
            let size = diagonal(&mesh.positions[..mesh.positions.len() / points.len()]);
            assert!(size > 0.1 && size < 100.0, "{points:?}: {size}");
        }
    }

    #[test]
    fn tubes_follow_lines() {
        let points = [Vec3::ZERO, 4.0 * Vec3::X, 3.0 * Vec3::Y];
        let colors = [Vec4::ONE, Vec4::W, Vec4::ZERO];
        let (mesh, said) = tubes(&points, &[[0, 1], [1, 2], [2, 2]], &colors);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (24, 24));
        assert_eq!((mesh.colors[0], mesh.colors[12]), (Vec4::ONE, Vec4::W));
        assert!(said.contains("3 lines"), "{said}");
        for position in &mesh.positions[..12] {
            let across = Vec3::new(0.0, position.y, position.z).length();
            assert!((across - 5.0 / 400.0).abs() < 1e-6 && (position.x == 0.0 || position.x == 4.0), "{position}");
        }
        // Outer sides are fronts.
        let [a, b, c] = mesh.triangles[0].map(|i| mesh.positions[i as usize]);
        let middle = (a + b + c) / 3.0;
        assert!((b - a).cross(c - a).dot(Vec3::new(0.0, middle.y, middle.z)) > 0.0);
    }
}
