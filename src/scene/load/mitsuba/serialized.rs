//! Mitsuba's own `serialized` meshes, versions 3 and 4: consecutive zlib streams with a table of offsets at
//! the end.
//!
//! The layout follows Mitsuba 3's documentation of the plugin.

use std::io::{BufReader, Read};
use std::path::Path;

use glam::{Vec2, Vec3};

use crate::scene::{LoadError, Mesh};

/// Maximum number of vertices and of triangles of a mesh; a small compressed file can expand to more than
/// fits in memory.
const MAX_COUNT: u64 = 1 << 26;
/// Maximum number of bytes of a name.
const MAX_NAME: usize = 1 << 16;
const HAS_NORMALS: u32 = 0x1;
const HAS_TEXCOORDS: u32 = 0x2;
const HAS_COLORS: u32 = 0x8;
const FACE_NORMALS: u32 = 0x10;
const DOUBLE: u32 = 0x2000;

/// Parses the mesh at an index; the second value is true for flat shading. Texture coordinates stay
/// unchanged.
pub(super) fn parse(path: &Path, bytes: &[u8], index: usize) -> Result<(Mesh, bool), LoadError> {
    let error = |cause: String| LoadError::at(path, format!("mesh {index}"), cause);
    let word = |at: usize| bytes.get(at..at.checked_add(2)?).map(|b| u16::from_le_bytes([b[0], b[1]]));
    let (Some(0x041c), Some(version @ (3 | 4))) = (word(0), word(2)) else {
        return Err(LoadError::new(path, "is not a serialized mesh of version 3 or 4"));
    };
    let start = offset(bytes, version, index).map_err(error)?;
    let stream = bytes
        .get(start..)
        .filter(|b| b.len() > 4)
        .ok_or_else(|| error("its offset lies outside the file".to_owned()))?;
    let mut reader = BufReader::new(flate2::read::ZlibDecoder::new(&stream[4..]));
    read_mesh(&mut reader, version).map_err(error)
}

/// Returns the offset of a mesh from the table at the file's end.
fn offset(bytes: &[u8], version: u16, index: usize) -> Result<usize, String> {
    if index == 0 {
        return Ok(0);
    }
    let truncated = || "the table of offsets is truncated".to_owned();
    let tail = |back: usize, size: usize| {
        let at = bytes.len().checked_sub(back)?;
        let mut out = [0_u8; 8];
        out[..size].copy_from_slice(bytes.get(at..at + size)?);
        usize::try_from(u64::from_le_bytes(out)).ok()
    };
    let count = tail(4, 4).ok_or_else(truncated)?;
    if index >= count {
        return Err(format!("the file has {count} meshes, counted from 0"));
    }
    let size = if version == 4 { 8 } else { 4 };
    let back = (count - index).checked_mul(size).and_then(|b| b.checked_add(4)).ok_or_else(truncated)?;
    tail(back, size).ok_or_else(truncated)
}

fn read_mesh(reader: &mut impl Read, version: u16) -> Result<(Mesh, bool), String> {
    let flags = u32::from_le_bytes(take(reader)?);
    let mut name = Vec::new();
    if version == 4 {
        loop {
            let [byte] = take(reader)?;
            match byte {
                0 => break,
                _ if name.len() > MAX_NAME => return Err(format!("its name is longer than {MAX_NAME} bytes")),
                _ => name.push(byte),
            }
        }
    }
    let vertices = u64::from_le_bytes(take(reader)?);
    let triangles = u64::from_le_bytes(take(reader)?);
    if vertices.max(triangles) > MAX_COUNT {
        return Err(format!("{vertices} vertices and {triangles} triangles are more than {MAX_COUNT}"));
    }
    let double = flags & DOUBLE != 0;
    let mut vectors = |present: bool| -> Result<Vec<Vec3>, String> {
        let count = if present { vertices } else { 0 };
        grow(count, || Ok(Vec3::from(floats::<3>(reader, double)?)))
    };
    let positions = vectors(true)?;
    let mut normals = vectors(flags & HAS_NORMALS != 0)?;
    normals.iter_mut().for_each(|n| *n = n.normalize_or_zero());
    let uv_count = if flags & HAS_TEXCOORDS != 0 { vertices } else { 0 };
    let uvs = grow(uv_count, || Ok(Vec2::from(floats::<2>(reader, double)?)))?;
    let color_count = if flags & HAS_COLORS != 0 { vertices } else { 0 };
    let colors = grow(color_count, || Ok(Vec3::from(floats::<3>(reader, double)?).extend(1.0)))?;
    let triangles = grow(triangles, || {
        let mut corners = [0_u32; 3];
        for corner in &mut corners {
            *corner = u32::from_le_bytes(take(reader)?);
            if u64::from(*corner) >= vertices {
                return Err(format!("a triangle refers to vertex {corner} of {vertices}"));
            }
        }
        Ok(corners)
    })?;
    let mesh = Mesh {
        name: String::from_utf8_lossy(&name).into_owned(),
        positions,
        normals,
        uvs: [uvs, Vec::new()],
        colors,
        triangles,
        ..Mesh::default()
    };
    Ok((mesh, flags & FACE_NORMALS != 0))
}

/// Reads items one by one, so that a count from the file allocates nothing in advance.
fn grow<T>(count: u64, mut read: impl FnMut() -> Result<T, String>) -> Result<Vec<T>, String> {
    let mut out = Vec::new();
    for _ in 0..count {
        out.push(read()?);
    }
    Ok(out)
}

fn take<const N: usize>(reader: &mut impl Read) -> Result<[u8; N], String> {
    let mut out = [0; N];
    reader.read_exact(&mut out).map_err(|e| format!("is truncated or damaged: {e}"))?;
    Ok(out)
}

fn floats<const N: usize>(reader: &mut impl Read, double: bool) -> Result<[f32; N], String> {
    let mut out = [0.0; N];
    for value in &mut out {
        *value = if double { f64::from_le_bytes(take(reader)?) as f32 } else { f32::from_le_bytes(take(reader)?) };
        if !value.is_finite() {
            return Err("has a number that is not finite".to_owned());
        }
    }
    Ok(out)
}
