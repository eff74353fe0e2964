//! STL meshes, ASCII and binary: triangles without materials, normals or texture coordinates.
//!
//! This is not a crate's parser: `stl_io` 0.11.0 takes binary files whose header begins with `solid` for ASCII ones, stops
//! at the first of several solids, and its errors name no line.

use std::collections::HashMap;
use std::path::Path;

use glam::Vec3;

use crate::scene::{LoadError, Mesh};

/// Bytes before the triangles of a binary file, of which the last four count them, and bytes of each.
const HEADER: usize = 84;
const FACET: usize = 50;

/// Parses a mesh. The normals that the file has for its triangles are left out, since they follow from the corners.
///
/// Errors name the line of an ASCII file, and the triangle of a binary one.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh, LoadError> {
    let mut triangles = Triangles::default();
    if is_binary(bytes) {
        binary(path, bytes, &mut triangles)?
    } else {
        ascii(path, bytes, &mut triangles)?
    }
    Ok(triangles.mesh)
}

/// Tells binary files by their length, or by what no text begins with.
fn is_binary(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start();
    let says_solid = start.len() >= 5 && start[..5].eq_ignore_ascii_case(b"solid");
    promised(bytes) == Some(bytes.len()) || !says_solid || bytes.iter().take(512).any(|&b| b == 0)
}

/// Returns the length that the header of a binary file tells.
fn promised(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER - 4..HEADER)?.try_into().ok()?;
    (u32::from_le_bytes(count) as usize).checked_mul(FACET)?.checked_add(HEADER)
}

fn binary(path: &Path, bytes: &[u8], triangles: &mut Triangles) -> Result<(), LoadError> {
    let Some(facets) = promised(bytes).and_then(|end| bytes.get(HEADER..end)) else {
        let cause = match promised(bytes) {
            Some(end) => format!("is truncated: its header promises {} triangles", (end - HEADER) / FACET),
            None => "is neither an ASCII STL file, which begins with `solid`, nor a binary one".to_owned(),
        };
        return Err(LoadError::new(path, cause));
    };
    for (i, facet) in facets.chunks_exact(FACET).enumerate() {
        let number = |n: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| facet[4 * n + byte]));
        // The first three numbers are the normal.
        let corners = [3, 6, 9].map(|n| Vec3::new(number(n), number(n + 1), number(n + 2)));
        triangles.add(corners).map_err(|cause| LoadError::at(path, format!("triangle {i}"), cause))?;
    }
    Ok(())
}

fn ascii(path: &Path, bytes: &[u8], triangles: &mut Triangles) -> Result<(), LoadError> {
    let mut corners: Vec<Vec3> = Vec::new();
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let error = |cause: String| LoadError::at(path, format!("line {}", number + 1), cause);
        // Names may be in any encoding; numbers are ASCII.
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_whitespace();
        match words.next().unwrap_or_default().to_ascii_lowercase().as_str() {
            "vertex" => {
                let numbers: Vec<f32> = words
                    .map(|word| word.parse().map_err(|_| error(format!("`{word}` is not a number"))))
                    .collect::<Result<_, _>>()?;
                let &[x, y, z] = numbers.as_slice() else {
                    return Err(error(format!("3 numbers are expected, not {}", numbers.len())));
                };
                corners.push(Vec3::new(x, y, z));
            }
            "endfacet" => {
                let of_three = corners.as_slice().try_into();
                let of_three = of_three.map_err(|_| error(format!("a facet with {} corners", corners.len())))?;
                triangles.add(of_three).map_err(error)?;
                corners.clear();
            }
            "" | "solid" | "endsolid" | "facet" | "outer" | "endloop" => {}
            word => return Err(error(format!("`{word}` is no part of an STL file"))),
        }
    }
    if !corners.is_empty() {
        return Err(LoadError::new(path, "is truncated: its last facet does not end"));
    }
    Ok(())
}

/// A mesh that grows, with the vertex of each position.
#[derive(Default)]
struct Triangles {
    mesh: Mesh,
    vertices: HashMap<[u32; 3], u32>,
}

impl Triangles {
    fn add(&mut self, corners: [Vec3; 3]) -> Result<(), String> {
        if let Some(corner) = corners.iter().find(|corner| !corner.is_finite()) {
            return Err(format!("{corner} is not finite"));
        }
        if self.mesh.positions.len() > u32::MAX as usize - 3 {
            return Err("the mesh has more corners than 32 bits can count".to_owned());
        }
        let triangle = corners.map(|corner| {
            let next = self.mesh.positions.len() as u32;
            // Zeros of both signs are the same place.
            let index = *self.vertices.entry((corner + 0.0).to_array().map(f32::to_bits)).or_insert(next);
            if index == next {
                self.mesh.positions.push(corner);
            }
            index
        });
        self.mesh.triangles.push(triangle);
        Ok(())
    }
}
