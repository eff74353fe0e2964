//! Emissive triangles, subdivided where a texture makes the radiance vary, so that light sampling can prefer
//! bright parts.
//!
//! A triangle with n parts along a side has n^2 congruent parts. Rows have a constant first weight; within a
//! row, upright and inverted parts alternate.

use glam::Vec3;

use crate::scene::model::texture::linear_from_srgb;
use crate::scene::{Geometry, LUMINANCE, Scene, TextureRef, Wrap};

/// An emissive triangle.
#[derive(Clone, Debug, PartialEq)]
pub struct Emitter {
    /// Index into the geometry's triangles.
    pub triangle: u32,
    /// Parts along a side, at least 1.
    pub parts: u32,
    /// Power of each part: luminance, in watts, of all emitting sides together. It is positive for every part
    /// that may emit.
    pub powers: Vec<f32>,
}

/// A part of a triangle, by the weights of the triangle's second and third corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// One of its corners.
    pub corner: [f32; 2],
    /// Extent of each weight, measured from the corner; negative for inverted parts.
    pub size: f32,
}

/// Target length of a part's longest side in texels.
const TEXELS_PER_PART: f32 = 2.0;
/// Maximum number of parts along a side.
const MAX_PARTS: u32 = 32;
/// Maximum number of parts in a scene.
const MAX_SCENE_PARTS: usize = 1 << 18;
/// Maximum number of texture lookups along a side of a part.
const MAX_LOOKUPS: u32 = 16;
/// Lower bound on a part's power, relative to the triangle's mean. It covers texels between the lookups, over
/// which filtering spreads light.
const MIN_RELATIVE_POWER: f32 = 0.05;

/// Returns the index of the part that contains the weights of the second and third corner.
#[must_use]
pub fn part_of(parts: u32, [b, c]: [f32; 2]) -> u32 {
    let (b, c) = (b.max(0.0) * parts as f32, c.max(0.0) * parts as f32);
    let row = (b as u32).min(parts - 1);
    let column = (c as u32).min(parts - 1 - row);
    let upside_down = column + row + 1 < parts && b - row as f32 + c - column as f32 > 1.0;
    row * (2 * parts - row) + 2 * column + u32::from(upside_down)
}

/// Returns a part by its index.
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

/// Returns all emissive triangles with non-zero area, in order.
#[must_use]
pub fn emitters(scene: &Scene, geometry: &Geometry) -> Vec<Emitter> {
    let emissive = |&(_, &material): &(usize, &u32)| scene.materials[material as usize].emission.is_some();
    let triangles: Vec<usize> =
        geometry.materials.iter().enumerate().filter(emissive).map(|(triangle, _)| triangle).collect();
    let textured = |triangle: usize| {
        let emission = scene.materials[geometry.materials[triangle] as usize].emission;
        emission.and_then(|e| e.radiance.texture)
    };
    let mut most = MAX_PARTS;
    let parts = |triangle: usize, most: u32| {
        textured(triangle).map_or(1, |t| {
            ((longest_side_texels(scene, geometry, triangle, &t) / TEXELS_PER_PART) as u32).clamp(1, most)
        })
    };
    while most > 1 && triangles.iter().map(|&t| parts(t, most).pow(2) as usize).sum::<usize>() > MAX_SCENE_PARTS {
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
        let points = (longest_side_texels(scene, geometry, triangle, &texture) / parts as f32).ceil();
        let points = if points.is_finite() { (points as u32).clamp(2, MAX_LOOKUPS) } else { 2 };
        let means: Vec<f32> = (0..parts * parts)
            .map(|index| {
                let part = part(parts, index);
                let sum: f32 = (0..points * points)
                    .map(|i| {
                        let [u, v] = sub_part_centroid(points, i).map(|w| w * part.size);
                        let weights = [part.corner[0] + u, part.corner[1] + v];
                        texel(scene, geometry, triangle, &texture, weights, decode).dot(factor * LUMINANCE)
                    })
                    .sum();
                sum / (points * points) as f32
            })
            .collect();
        let mut mean = means.iter().sum::<f32>() / means.len() as f32;
        if mean == 0.0 {
            mean =
                MIN_RELATIVE_POWER * mean_radiance(scene, geometry, triangle, &texture, decode).dot(factor * LUMINANCE);
        }
        let (low, high) = means.iter().fold((f32::INFINITY, 0.0_f32), |(l, h), &m| (l.min(m), h.max(m)));
        // Subdividing a triangle of nearly uniform radiance is not worth the extra records.
        (out.parts, out.powers) = if high <= 1.5 * low {
            (1, vec![power * mean])
        } else {
            let area = 1.0 / means.len() as f32;
            (parts, means.iter().map(|m| power * area * m.max(MIN_RELATIVE_POWER * mean)).collect())
        };
    }
    // NaN powers are kept so that the error becomes visible.
    out.powers.iter().any(|p| *p != 0.0).then_some(out)
}

/// Returns the weights of the second and third corner at the centroid of a sub-part.
fn sub_part_centroid(parts: u32, index: u32) -> [f32; 2] {
    let Part { corner, size } = part(parts, index);
    corner.map(|w| w + size / 3.0)
}

/// Returns the length of a triangle's longest side in texels.
fn longest_side_texels(scene: &Scene, geometry: &Geometry, triangle: usize, texture: &TextureRef) -> f32 {
    let image = &scene.images[scene.textures[texture.texture].image];
    let size = glam::Vec2::new(image.width as f32, image.height as f32);
    let [a, b, c] = geometry.triangles[triangle].map(|i| texture.apply(geometry.vertices[i as usize].uvs) * size);
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    if longest.is_finite() { longest } else { 0.0 }
}

/// Returns the mean of all texels that filtering on a triangle may read: those of its bounding box in texture
/// space and a border of one texel. It is zero only if the triangle is black.
fn mean_radiance(scene: &Scene, geometry: &Geometry, triangle: usize, texture: &TextureRef, decode: &[f32]) -> Vec3 {
    let sampler = &scene.textures[texture.texture];
    let image = &scene.images[sampler.image];
    let corners = geometry.triangles[triangle].map(|i| texture.apply(geometry.vertices[i as usize].uvs));
    if corners.iter().any(|corner| !corner.is_finite()) {
        return Vec3::ZERO;
    }
    let span = |axis: usize, size: u32, wrap: Wrap| {
        let at = corners.map(|corner| corner[axis] * size as f32);
        let low = (at.iter().fold(f32::INFINITY, |a, &b| a.min(b)) - 1.0).floor() as i64;
        let high = (at.iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b)) + 1.0).ceil() as i64;
        let size = i64::from(size);
        // A mirrored image reads each texel once in each direction, so whole images are enough.
        let indices = low..high.min(low + 2 * size);
        indices.map(move |i| match wrap {
            Wrap::Repeat => i.rem_euclid(size),
            Wrap::Mirror if i.rem_euclid(2 * size) >= size => 2 * size - 1 - i.rem_euclid(2 * size),
            Wrap::Mirror => i.rem_euclid(2 * size),
            Wrap::Clamp => i.clamp(0, size - 1),
        })
    };
    let columns: Vec<usize> = span(0, image.width, sampler.wrap[0]).map(|x| x as usize).collect();
    let rows: Vec<usize> = span(1, image.height, sampler.wrap[1]).map(|y| y as usize).collect();
    let texels = rows.iter().flat_map(|y| columns.iter().map(move |x| y * image.width as usize + x));
    let sum: Vec3 = texels.map(|index| linear(sampler.srgb, image.texels[index], decode)).sum();
    sum / (rows.len() * columns.len()).max(1) as f32
}

/// Returns a texel's linear colour.
fn linear(srgb: bool, [r, g, b, _]: [u8; 4], decode: &[f32]) -> Vec3 {
    let value = |v: u8| if srgb { decode[v as usize] } else { f32::from(v) / 255.0 };
    Vec3::new(value(r), value(g), value(b))
}

/// Returns the linear texel at the weights of the second and third corner.
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
    linear(sampler.srgb, image.texels[y * image.width as usize + x], decode)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every point lies in the part whose index it maps to, and all parts receive equal numbers of points.
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
            let indices: Vec<u32> = (0..parts * parts).map(|i| part_of(parts, sub_part_centroid(parts, i))).collect();
            assert_eq!(indices, (0..parts * parts).collect::<Vec<_>>());
        }
    }

    /// The lookups of a large triangle missed the only bright texel of a texture, and the triangle was no
    /// light that subpaths start from; after the last bounce nothing else finds it.
    #[test]
    fn a_triangle_whose_looked_up_texels_are_black_keeps_its_light() {
        let mut texels = vec![[0, 0, 0, 255]; 4096 * 4];
        texels[4096 + 1601] = [255; 4];
        let emissive = |texels: Vec<[u8; 4]>| {
            let mut scene = crate::scene::builtin::load("single_triangle").unwrap();
            scene.images = vec![crate::scene::Image { name: String::new(), width: 4096, height: 4, texels }];
            scene.textures = vec![crate::scene::Texture {
                image: 0,
                srgb: false,
                wrap: [Wrap::Repeat; 2],
                filter: crate::scene::Filter::Nearest,
            }];
            let texture = TextureRef { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY };
            let radiance = crate::scene::Color { factor: Vec3::ONE, texture: Some(texture) };
            scene.materials[0].emission = Some(crate::scene::Emission { radiance, two_sided: false });
            scene.meshes[0].uvs[0] = vec![glam::Vec2::ZERO, glam::Vec2::X, glam::Vec2::ONE];
            let geometry = Geometry::new(&scene);
            emitters(&scene, &geometry)
        };
        let lit = emissive(texels.clone());
        assert_eq!(lit.len(), 1);
        assert!(lit[0].powers.iter().all(|power| *power > 0.0), "{lit:?}");
        texels[4096 + 1601] = [0, 0, 0, 255];
        assert!(emissive(texels).is_empty(), "black stays black");
    }
}
