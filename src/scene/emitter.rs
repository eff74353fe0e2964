//! Emissive triangles, cut into parts where a texture makes them unevenly bright, so that bright parts can be chosen more often.
//!
//! A triangle with n parts along a side has n^2, all of one size: rows of constant first weight, in each the upright ones and those
//! upside down by turns.

use glam::Vec3;

use super::texture::linear_from_srgb;
use super::{Geometry, LUMINANCE, Scene, TextureRef, Wrap};

/// An emissive triangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitter {
    /// Index into the geometry's triangles.
    pub triangle: u32,
    /// Parts along a side, at least 1.
    pub parts: u32,
    /// Power of each part, the luminance of watts; both sides together where both shine. Positive wherever the part may shine.
    pub powers: Vec<f32>,
}

/// A part of a triangle, by the weights of the triangle's second and third corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// One of its corners.
    pub corner: [f32; 2],
    /// How far each weight runs from there; negative where it is upside down.
    pub size: f32,
}

/// Texels that a part spans along its longest side, where there is no end to cutting.
const TEXELS: f32 = 2.0;
/// Most parts along a side.
const MOST_PARTS: u32 = 32;
/// Most parts of a scene.
const MOST_OF_ALL: usize = 1 << 18;
/// Points along a side of a part at which the texture is looked up, at most.
const MOST_POINTS: u32 = 16;
/// Share of a triangle's mean that the darkest part has at least: filters spread light over texels that were not looked up.
const LEAST: f32 = 0.05;

/// Which part the weights of the second and third corner lie in.
#[must_use]
pub fn part_of(parts: u32, [b, c]: [f32; 2]) -> u32 {
    let (b, c) = (b.max(0.0) * parts as f32, c.max(0.0) * parts as f32);
    let row = (b as u32).min(parts - 1);
    let column = (c as u32).min(parts - 1 - row);
    let upside_down = column + row + 1 < parts && b - row as f32 + c - column as f32 > 1.0;
    row * (2 * parts - row) + 2 * column + u32::from(upside_down)
}

/// A part by its index.
#[must_use]
pub fn part(parts: u32, index: u32) -> Part {
    let mut row = 0;
    let mut left = index;
    while left >= 2 * (parts - row) - 1 {
        left -= 2 * (parts - row) - 1;
        row += 1;
    }
    let size = 1.0 / parts as f32;
    let corner = [row as f32 * size, (left / 2) as f32 * size];
    if left.is_multiple_of(2) { Part { corner, size } } else { Part { corner: corner.map(|w| w + size), size: -size } }
}

/// All triangles that shine, in order, except those without area.
#[must_use]
pub fn emitters(scene: &Scene, geometry: &Geometry) -> Vec<Emitter> {
    let emissive = |&(_, &material): &(usize, &u32)| scene.materials[material as usize].emission.is_some();
    let triangles: Vec<usize> =
        geometry.materials.iter().enumerate().filter(emissive).map(|(triangle, _)| triangle).collect();
    let textured = |triangle: usize| {
        let emission = scene.materials[geometry.materials[triangle] as usize].emission;
        emission.and_then(|e| e.radiance.texture)
    };
    let mut most = MOST_PARTS;
    let parts = |triangle: usize, most: u32| {
        textured(triangle).map_or(1, |t| ((span(scene, geometry, triangle, &t) / TEXELS) as u32).clamp(1, most))
    };
    while most > 1 && triangles.iter().map(|&t| parts(t, most).pow(2) as usize).sum::<usize>() > MOST_OF_ALL {
        most /= 2;
    }
    let decode: Vec<f32> = (0..=255_u8).map(|v| linear_from_srgb(f32::from(v) / 255.0)).collect();
    triangles
        .into_iter()
        .filter_map(|triangle| emitter(scene, geometry, triangle, parts(triangle, most), &decode))
        .collect()
}

fn emitter(scene: &Scene, geometry: &Geometry, triangle: usize, parts: u32, decode: &[f32]) -> Option<Emitter> {
    let emission = scene.materials[geometry.materials[triangle] as usize].emission?;
    let [a, b, c] = geometry.positions(triangle);
    let sides = if emission.two_sided { 2.0 } else { 1.0 };
    let power = 0.5 * (b - a).cross(c - a).length() * std::f32::consts::PI * sides;
    let factor = emission.radiance.factor;
    let mut out = Emitter { triangle: triangle as u32, parts: 1, powers: vec![power * factor.dot(LUMINANCE)] };
    if let Some(texture) = emission.radiance.texture {
        let points = (span(scene, geometry, triangle, &texture) / parts as f32).ceil();
        let points = if points.is_finite() { (points as u32).clamp(2, MOST_POINTS) } else { 2 };
        let means: Vec<f32> = (0..parts * parts)
            .map(|index| {
                let part = part(parts, index);
                let sum: f32 = (0..points * points)
                    .map(|i| {
                        let [u, v] = middle(points, i).map(|w| w * part.size);
                        let weights = [part.corner[0] + u, part.corner[1] + v];
                        texel(scene, geometry, triangle, &texture, weights, decode).dot(factor * LUMINANCE)
                    })
                    .sum();
                sum / (points * points) as f32
            })
            .collect();
        let mean = means.iter().sum::<f32>() / means.len() as f32;
        let (low, high) = means.iter().fold((f32::INFINITY, 0.0_f32), |(l, h), &m| (l.min(m), h.max(m)));
        // Parts that are nearly alike are not worth their records.
        (out.parts, out.powers) = if high <= 1.5 * low {
            (1, vec![power * mean])
        } else {
            let area = 1.0 / means.len() as f32;
            (parts, means.iter().map(|m| power * area * m.max(LEAST * mean)).collect())
        };
    }
    // What is not a number has to show.
    out.powers.iter().any(|p| *p != 0.0).then_some(out)
}

/// Weights of the second and third corner in the middle of a part of a part.
fn middle(parts: u32, index: u32) -> [f32; 2] {
    let Part { corner, size } = part(parts, index);
    corner.map(|w| w + size / 3.0)
}

/// Texels along the longest side of a triangle.
fn span(scene: &Scene, geometry: &Geometry, triangle: usize, texture: &TextureRef) -> f32 {
    let image = &scene.images[scene.textures[texture.texture].image];
    let size = glam::Vec2::new(image.width as f32, image.height as f32);
    let [a, b, c] = geometry.triangles[triangle].map(|i| texture.apply(geometry.vertices[i as usize].uvs) * size);
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    if longest.is_finite() { longest } else { 0.0 }
}

/// The texel at the weights of the second and third corner, linear.
fn texel(
    scene: &Scene,
    geometry: &Geometry,
    triangle: usize,
    texture: &TextureRef,
    [b, c]: [f32; 2],
    decode: &[f32],
) -> Vec3 {
    let sampler = &scene.textures[texture.texture];
    let image = &scene.images[sampler.image];
    let corners = geometry.triangles[triangle].map(|i| texture.apply(geometry.vertices[i as usize].uvs));
    let at = corners[0] * (1.0 - b - c) + corners[1] * b + corners[2] * c;
    let index = |at: f32, size: u32, wrap: Wrap| {
        let inside = match wrap {
            Wrap::Repeat => at.rem_euclid(1.0),
            Wrap::Mirror => 1.0 - (at.rem_euclid(2.0) - 1.0).abs(),
            Wrap::Clamp => at.clamp(0.0, 1.0),
        };
        ((inside * size as f32) as usize).min(size as usize - 1)
    };
    let (x, y) = (index(at.x, image.width, sampler.wrap[0]), index(at.y, image.height, sampler.wrap[1]));
    let [r, g, b, _] = image.texels[y * image.width as usize + x];
    let value = |v: u8| if sampler.srgb { decode[v as usize] } else { f32::from(v) / 255.0 };
    Vec3::new(value(r), value(g), value(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point lies in the part that claims it, and parts are met evenly.
    #[test]
    fn parts_tile_the_triangle() {
        for parts in [1, 2, 3, 7, 32] {
            let mut counts = vec![0; (parts * parts) as usize];
            let n = 200;
            for (i, j) in (0..n).flat_map(|i| (0..n - i).map(move |j| (i, j))) {
                let at = [i, j].map(|k| (k as f32 + 0.31) / n as f32);
                let index = part_of(parts, at);
                let Part { corner, size } = part(parts, index);
                let inside = [0, 1].map(|k| (at[k] - corner[k]) / size);
                assert!(inside.iter().all(|&w| w > -1e-4) && inside[0] + inside[1] < 1.0 + 1e-4, "{at:?} of {parts}");
                counts[index as usize] += 1;
            }
            let even = 20_100.0 / f64::from(parts * parts);
            let limit = 0.1 * even + 8.0;
            assert!(counts.iter().all(|&c| (f64::from(c) - even).abs() < limit), "{parts}: {counts:?}");
            for corner in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.5], [-1e-7, 1.0 + 1e-7]] {
                assert!(part_of(parts, corner) < parts * parts);
            }
            let indices: Vec<u32> = (0..parts * parts).map(|i| part_of(parts, middle(parts, i))).collect();
            assert_eq!(indices, (0..parts * parts).collect::<Vec<_>>());
        }
    }
}
