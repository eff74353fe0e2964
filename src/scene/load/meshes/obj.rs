//! OBJ meshes: positions, vertex colours, normals, texture coordinates, polygons and the names of their materials.
//!
//! This is not a crate's parser, so that every error names its line and corners may omit attributes that
//! others have.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3, Vec4};

use crate::scene::load::{far, strokes};
use crate::scene::{LoadError, Mesh};

/// Position, texture coordinate and normal index of a corner.
type Corner = [Option<u32>; 3];

/// What an OBJ file holds.
pub(in crate::scene) struct Parsed {
    /// All of its triangles, relative to `origin`.
    pub mesh: Mesh,
    /// A place near them, if they are far from the file's own origin; else zero.
    pub origin: DVec3,
    /// Names of materials, each with its first triangle; a material extends to the next one's first triangle.
    pub materials: Vec<(String, usize)>,
    /// Names of material files.
    pub libraries: Vec<String>,
    /// What is wrong with the file and left out.
    pub warnings: Vec<String>,
}

/// Returns the triangles of each material by its name, which is empty for those before the first one.
pub(in crate::scene) fn parts<'m>(mesh: &Mesh, materials: &'m [(String, usize)]) -> Vec<(&'m str, Vec<[u32; 3]>)> {
    let first = materials.first().map_or(mesh.triangles.len(), |m| m.1);
    let ends = materials.iter().skip(1).map(|m| m.1).chain([mesh.triangles.len()]);
    let ranges = materials.iter().zip(ends).map(|((name, start), end)| (name.as_str(), *start..end));
    let mut parts: Vec<(&str, Vec<[u32; 3]>)> = Vec::new();
    for (name, range) in std::iter::once(("", 0..first)).chain(ranges).filter(|(_, range)| !range.is_empty()) {
        let triangles = &mesh.triangles[range];
        match parts.iter_mut().find(|(other, _)| *other == name) {
            Some((_, part)) => part.extend(triangles),
            None => parts.push((name, triangles.to_vec())),
        }
    }
    parts
}

/// Parses a mesh; v points up as in the file. Polygons are split into fans. A `\` at the end of a line continues it.
///
/// If only some corners have a normal, the mesh has none; a missing texture coordinate is zero, and a missing colour, or one
/// that is no number, white. Those that a corner refers to and that the file does not have are missing, too. Faces of less
/// than three corners show nothing. Without faces, lines are tubes, and without these points are balls.
pub(in crate::scene) fn parse(path: &Path, bytes: &[u8]) -> Result<Parsed, LoadError> {
    let (mut positions, mut uvs, mut normals) = (Vec::<DVec3>::new(), Vec::<Vec2>::new(), Vec::<Vec3>::new());
    // Of positions, as many as the last one that has a colour needs.
    let mut colors: Vec<Vec4> = Vec::new();
    let mut corners: Vec<Corner> = Vec::new();
    let mut vertices: HashMap<Corner, u32> = HashMap::new();
    let mut mesh = Mesh::default();
    let mut polygon: Vec<u32> = Vec::new();
    let (mut materials, mut libraries) = (Vec::new(), Vec::new());
    let (mut lost, mut edges, mut colorless) = (0_usize, 0_usize, 0_usize);
    let mut segments: Vec<[u32; 2]> = Vec::new();
    let mut lines = bytes.split(|&b| b == b'\n').map(statement).enumerate();
    while let Some((number, mut line)) = lines.next() {
        let error = |cause: String| LoadError::at(path, format!("line {}", number + 1), cause);
        while let Some(begun) = line.strip_suffix('\\')
            && let Some((_, rest)) = lines.next()
        {
            line = format!("{begun} {rest}").into();
        }
        let mut words = line.split_whitespace();
        let numbers = |words: std::str::SplitWhitespace, finite: bool| -> Result<[f64; 3], LoadError> {
            let mut out = [0.0_f64; 3];
            let mut count = 0;
            for (slot, word) in out.iter_mut().zip(words) {
                *slot = word.parse().map_err(|_| error(format!("`{word}` is not a number")))?;
                if finite && !(*slot as f32).is_finite() {
                    return Err(error(format!("`{word}` is not finite")));
                }
                count += 1;
            }
            let needed = if line.trim_start().starts_with("vt") { 1 } else { 3 };
            if count < needed { Err(error(format!("{needed} numbers are expected, not {count}"))) } else { Ok(out) }
        };
        let floats = |words| Ok::<_, LoadError>(numbers(words, true)?.map(|value| value as f32));
        match words.next() {
            Some("v") => {
                // A colour may follow the position; a fourth number alone is a weight.
                let colored = words.clone().nth(5).is_some();
                if colored {
                    let mut color = words.clone();
                    color.nth(2);
                    colors.resize(positions.len(), Vec4::ONE);
                    // Some files have `nan` where no colour is known.
                    let color = DVec3::from(numbers(color, false)?).as_vec3();
                    colorless += usize::from(!color.is_finite());
                    colors.push(if color.is_finite() { color.extend(1.0) } else { Vec4::ONE });
                }
                positions.push(numbers(words, true)?.into());
            }
            Some("vn") => normals.push(Vec3::from(floats(words)?).normalize_or_zero()),
            Some("vt") => {
                let [u, v, _] = floats(words)?;
                uvs.push(Vec2::new(u, v));
            }
            Some("f") => {
                polygon.clear();
                for word in words {
                    let counts = [positions.len(), uvs.len(), normals.len()];
                    let corner = corner(word, counts, &mut lost).map_err(&error)?;
                    let next = corners.len() as u32;
                    let index = *vertices.entry(corner).or_insert(next);
                    if index == next {
                        if next == u32::MAX {
                            return Err(error("the mesh has more corners than 32 bits can count".to_owned()));
                        }
                        corners.push(corner);
                    }
                    polygon.push(index);
                }
                edges += usize::from(polygon.len() < 3);
                let pairs = polygon.get(1..).unwrap_or_default().windows(2);
                mesh.triangles.extend(pairs.map(|pair| [polygon[0], pair[0], pair[1]]));
            }
            Some("l") => {
                let counts = [positions.len(), uvs.len(), normals.len()];
                let ends: Result<Vec<_>, _> = words.map(|word| corner(word, counts, &mut lost)).collect();
                let ends: Vec<u32> = ends.map_err(&error)?.iter().filter_map(|corner| corner[0]).collect();
                segments.extend(ends.windows(2).map(|pair| [pair[0], pair[1]]));
            }
            Some("usemtl") => materials.push((words.collect::<Vec<_>>().join(" "), mesh.triangles.len())),
            Some("mtllib") => libraries.push(words.collect::<Vec<_>>().join(" ")),
            _ => {}
        }
    }
    let origin = far::origin(positions.iter().copied());
    let positions: Vec<Vec3> = positions.into_iter().map(|position| (position - origin).as_vec3()).collect();
    let position = |c: &Corner| c[0].map_or(Vec3::ZERO, |i| positions[i as usize]);
    mesh.positions = corners.iter().map(position).collect();
    if !colors.is_empty() {
        let color = |c: &Corner| c[0].and_then(|i| colors.get(i as usize)).copied().unwrap_or(Vec4::ONE);
        mesh.colors = corners.iter().map(color).collect();
    }
    if corners.iter().any(|c| c[1].is_some()) {
        mesh.uvs[0] = corners.iter().map(|c| c[1].map_or(Vec2::ZERO, |i| uvs[i as usize])).collect();
    }
    if !corners.is_empty() && corners.iter().all(|c| c[2].is_some()) {
        mesh.normals = corners.iter().filter_map(|c| c[2].map(|i| normals[i as usize])).collect();
    }
    let mut warnings = Vec::new();
    if mesh.triangles.is_empty() && edges == 0 && !positions.is_empty() {
        if !colors.is_empty() {
            colors.resize(positions.len(), Vec4::ONE);
        }
        let (strokes, said) = match segments.is_empty() {
            true => strokes::balls(&positions, &colors),
            false => strokes::tubes(&positions, &segments, &colors),
        };
        mesh = strokes;
        warnings.push(said);
    }
    if lost > 0 {
        warnings.push(format!(
            "texture coordinates or normals that corners refer to are not in the file: {lost} are left out"
        ));
    }
    if colorless > 0 {
        warnings.push(format!("colours of vertices that are no numbers are white: {colorless}"));
    }
    if edges > 0 {
        warnings.push(format!("faces of less than three corners are left out: {edges}"));
    }
    Ok(Parsed { mesh, origin, materials, libraries, warnings })
}

/// Returns a line without its comment. Names may be in any encoding; numbers are ASCII.
pub(super) fn statement(line: &[u8]) -> Cow<'_, str> {
    let line = line.split(|&b| b == b'#').next().unwrap_or_default();
    String::from_utf8_lossy(line.trim_ascii_end())
}

/// Parses `position/uv/normal` with one-based indices, of which negative ones count back from the latest. Counts texture
/// coordinates and normals that are not there.
fn corner(word: &str, counts: [usize; 3], lost: &mut usize) -> Result<Corner, String> {
    let mut corner = [None; 3];
    let mut parts = word.split('/');
    for (kind, (slot, count)) in corner.iter_mut().zip(counts).enumerate() {
        let Some(part) = parts.next() else { break };
        if part.is_empty() {
            continue;
        }
        let index: i64 = part.parse().map_err(|_| format!("`{word}` is not a corner"))?;
        let from_zero = if index < 0 { count as i64 + index } else { index - 1 };
        if (0..count.min(u32::MAX as usize) as i64).contains(&from_zero) {
            *slot = Some(from_zero as u32);
        } else if kind == 0 {
            return Err(format!("refers to vertex {index} of {count}"));
        } else {
            *lost += 1;
        }
    }
    if corner[0].is_none() || parts.next().is_some() {
        return Err(format!("`{word}` is not a corner"));
    }
    Ok(corner)
}
