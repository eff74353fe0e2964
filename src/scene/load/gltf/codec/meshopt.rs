//! The codecs of EXT_meshopt_compression and KHR_meshopt_compression: attributes (versions 0 and 1), triangles,
//! indices, and the filters of attributes.
//!
//! Source: appendices A (bitstream) and B (filters) of both specifications. Sizes that a stream cannot hold are
//! errors before memory is allocated for them; arithmetic wraps where the specification says so.

use serde::Deserialize;

/// The compression mode.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
pub enum Mode {
    Attributes,
    Triangles,
    Indices,
}

/// The function that is applied to decoded attributes.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "UPPERCASE")]
pub enum Filter {
    #[default]
    None,
    Octahedral,
    Quaternion,
    Exponential,
    Color,
}

/// Decodes `count` elements of `stride` bytes; an error is the cause.
pub fn decode(bytes: &[u8], mode: Mode, filter: Filter, count: usize, stride: usize) -> Result<Vec<u8>, String> {
    let strides_fit = match (mode, filter) {
        (Mode::Attributes, Filter::None | Filter::Exponential) => {
            stride.is_multiple_of(4) && (4..=256).contains(&stride)
        }
        (Mode::Attributes, Filter::Octahedral | Filter::Color) => matches!(stride, 4 | 8),
        (Mode::Attributes, Filter::Quaternion) => stride == 8,
        (_, Filter::None) => matches!(stride, 2 | 4),
        (mode, filter) => return Err(format!("the filter {filter:?} does not exist for the mode {mode:?}")),
    };
    if !strides_fit {
        return Err(format!("a byteStride of {stride} is not valid for the mode {mode:?} with the filter {filter:?}"));
    }
    match mode {
        Mode::Attributes => {
            let mut out = decode_attributes(bytes, count, stride)?;
            let size = stride / 4;
            let max = if size == 1 { u8::MAX.into() } else { u16::MAX.into() };
            match filter {
                Filter::None => {}
                Filter::Octahedral => map_quads(&mut out, size, true, |quad| octahedral(quad, max / 2)),
                Filter::Quaternion => map_quads(&mut out, size, true, quaternion),
                Filter::Color => map_quads(&mut out, size, false, |quad| color(quad, max)),
                Filter::Exponential => out.as_chunks_mut().0.iter_mut().for_each(exponential),
            }
            Ok(out)
        }
        Mode::Triangles => Ok(to_bytes(decode_triangles(bytes, count)?.as_flattened(), stride)),
        Mode::Indices => Ok(to_bytes(&decode_indices(bytes, count)?, stride)),
    }
}

/// Returns indices as bytes, of 16-bit ones the lower halves.
fn to_bytes(indices: &[u32], stride: usize) -> Vec<u8> {
    indices.iter().flat_map(|index| index.to_le_bytes().into_iter().take(stride)).collect()
}

/// The cause of an error in a stream that ends early.
const TRUNCATED: &str = "the compressed data is truncated";

/// Takes bytes from the front of a stream.
fn take<'a>(stream: &mut &'a [u8], count: usize) -> Result<&'a [u8], String> {
    let (head, rest) = stream.split_at_checked(count).ok_or(TRUNCATED)?;
    *stream = rest;
    Ok(head)
}

/// Splits a stream with the given first byte into its body and the tail of a known size.
fn split_tail(bytes: &[u8], header: u8, tail: usize) -> Result<(&[u8], &[u8]), String> {
    match bytes.split_first() {
        Some((&first, body)) if first == header => {
            let at = body.len().checked_sub(tail).ok_or(TRUNCATED)?;
            Ok(body.split_at(at))
        }
        Some((first, _)) => Err(format!("the compressed data starts with {first:#04x}, not with {header:#04x}")),
        None => Err(TRUNCATED.to_owned()),
    }
}

/// Returns an error unless the stream was read to its end.
fn check_end(stream: &[u8]) -> Result<(), String> {
    if stream.is_empty() { Ok(()) } else { Err(format!("{} bytes of the compressed data are left over", stream.len())) }
}

// Attributes: every byte of an element is a plane of differences, in groups of 16 elements.

/// Number of elements in a group.
const GROUP: usize = 16;
/// Maximum number of elements in a block.
const BLOCK: usize = 256;

fn decode_attributes(bytes: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, String> {
    let channels = stride / 4;
    let version_1 = bytes.first() == Some(&0xa1);
    let (header, modes_size, min_tail) = if version_1 { (0xa1, channels, 24) } else { (0xa0, 0, 32) };
    let (mut stream, tail) = split_tail(bytes, header, (stride + modes_size).max(min_tail))?;
    let (tail, modes) = tail.split_at(tail.len() - modes_size);
    let block_size = (8192 / stride / GROUP * GROUP).min(BLOCK);
    // Version 1 has at least two bits for each plane of a block, version 0 for each plane of a group.
    let least = if version_1 { count.div_ceil(block_size) * channels } else { count.div_ceil(4 * GROUP) * stride };
    if least > stream.len() {
        let cause = format!("{count} elements of {stride} bytes do not fit into {} compressed bytes", bytes.len());
        return Err(cause);
    }
    let mut previous = tail[tail.len() - stride..].to_vec();
    let mut out = vec![0; count * stride];
    let mut planes = [[0; BLOCK]; 4];
    for block in out.chunks_mut(block_size * stride) {
        let elements = block.len() / stride;
        let controls = if version_1 { take(&mut stream, channels)? } else { &[] };
        for channel in 0..channels {
            for (lane, plane) in planes.iter_mut().enumerate() {
                let groups = &mut plane[..elements.next_multiple_of(GROUP)];
                match controls.get(channel).map(|control| control >> (2 * lane) & 3) {
                    None => read_plane(&mut stream, groups, [0, 2, 4, 8])?,
                    Some(0) => read_plane(&mut stream, groups, [0, 1, 2, 4])?,
                    Some(1) => read_plane(&mut stream, groups, [1, 2, 4, 8])?,
                    Some(2) => groups.fill(0),
                    Some(_) => groups[..elements].copy_from_slice(take(&mut stream, elements)?),
                }
            }
            let mode = Difference::new(modes.get(channel).copied().unwrap_or_default())?;
            let mut last = quad(&previous[4 * channel..]);
            for (element, i) in block.chunks_exact_mut(stride).zip(0..) {
                last = mode.add(last, planes.map(|plane| plane[i]));
                element[4 * channel..4 * channel + 4].copy_from_slice(&last);
            }
            previous[4 * channel..4 * channel + 4].copy_from_slice(&last);
        }
    }
    check_end(stream)?;
    Ok(out)
}

/// Returns the first four bytes.
fn quad(bytes: &[u8]) -> [u8; 4] {
    std::array::from_fn(|i| bytes[i])
}

/// Reads a plane: two bits per group choose its bits per element, then the groups follow.
fn read_plane(stream: &mut &[u8], plane: &mut [u8], widths: [usize; 4]) -> Result<(), String> {
    let groups = plane.len() / GROUP;
    let header = take(stream, groups.div_ceil(4))?;
    for (i, group) in plane.chunks_exact_mut(GROUP).enumerate() {
        match widths[usize::from(header[i / 4] >> (2 * (i % 4)) & 3)] {
            0 => group.fill(0),
            8 => group.copy_from_slice(take(stream, GROUP)?),
            width => read_group(stream, group, width)?,
        }
    }
    Ok(())
}

/// Reads a group of 1, 2 or 4 bits per element; the largest value stands for a whole byte that follows.
fn read_group(stream: &mut &[u8], group: &mut [u8], width: usize) -> Result<(), String> {
    let packed = take(stream, 2 * width)?;
    let per_byte = 8 / width;
    let escape = (1 << width) - 1;
    for (i, value) in group.iter_mut().enumerate() {
        // Single bits start with the lowest one, others with the highest ones.
        let shift = if width == 1 { i % 8 } else { 8 - width * (i % per_byte + 1) };
        *value = packed[i / per_byte] >> shift & escape;
        if *value == escape {
            *value = take(stream, 1)?[0];
        }
    }
    Ok(())
}

/// The way in which four bytes of an element differ from those of the previous one.
#[derive(Clone, Copy)]
enum Difference {
    /// Differences of bytes.
    Bytes,
    /// Differences of 16-bit integers.
    Words,
    /// Exclusive or of 32 bits, rotated.
    Bits(u32),
}

impl Difference {
    fn new(mode: u8) -> Result<Self, String> {
        match (mode & 15, mode >> 4) {
            (0, 0) => Ok(Self::Bytes),
            (1, 0) => Ok(Self::Words),
            (2, rotation) => Ok(Self::Bits(rotation.into())),
            _ => Err(format!("unknown channel mode {mode:#04x} of the compressed data")),
        }
    }

    fn add(self, last: [u8; 4], difference: [u8; 4]) -> [u8; 4] {
        match self {
            Self::Bytes => {
                std::array::from_fn(|i| last[i].wrapping_add(difference[i] >> 1 ^ (difference[i] & 1).wrapping_neg()))
            }
            Self::Words => {
                let word = |bytes: [u8; 4], i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
                let sum = |i| {
                    let d = word(difference, i);
                    word(last, i).wrapping_add(d >> 1 ^ (d & 1).wrapping_neg()).to_le_bytes()
                };
                let ([a, b], [c, d]) = (sum(0), sum(2));
                [a, b, c, d]
            }
            Self::Bits(rotation) => {
                let bits = u32::from_le_bytes(difference).rotate_right(rotation);
                (u32::from_le_bytes(last) ^ bits).to_le_bytes()
            }
        }
    }
}

// Indices.

/// Reads an unsigned integer of at most five bytes with seven bits each, lowest first.
fn read_varint(stream: &mut &[u8]) -> Result<u32, String> {
    let mut value = 0;
    for shift in [0, 7, 14, 21, 28] {
        let byte = take(stream, 1)?[0];
        value |= u32::from(byte & 127) << shift;
        if byte < 128 {
            return Ok(value);
        }
    }
    Err("an index of the compressed data has more than five bytes".to_owned())
}

/// Returns the signed number that an unsigned one encodes: 0, -1, 1, -2, ...
fn zigzag(value: u32) -> u32 {
    value >> 1 ^ (value & 1).wrapping_neg()
}

/// The last 16 items, the most recent one first.
#[derive(Default)]
struct Recent<T> {
    items: [Option<T>; 16],
    next: usize,
}

impl<T: Copy> Recent<T> {
    fn push(&mut self, item: T) {
        self.items[self.next % 16] = Some(item);
        self.next += 1;
    }

    fn get(&self, age: u8) -> Result<T, String> {
        let item = self.items[(self.next + 15 - usize::from(age)) % 16];
        item.ok_or_else(|| "the compressed data refers to a vertex or edge before the first one".to_owned())
    }
}

/// The state of the triangle decoder.
#[derive(Default)]
struct Triangles<'a> {
    stream: &'a [u8],
    /// The lowest vertex that no triangle has used, in a well-ordered mesh.
    next: u32,
    /// The vertex that was last encoded as a difference.
    last: u32,
    edges: Recent<[u32; 2]>,
    vertices: Recent<u32>,
}

impl Triangles<'_> {
    fn new_vertex(&mut self) -> u32 {
        self.next = self.next.wrapping_add(1);
        self.next.wrapping_sub(1)
    }

    fn difference(&mut self) -> Result<u32, String> {
        self.last = self.last.wrapping_add(zigzag(read_varint(&mut self.stream)?));
        Ok(self.last)
    }

    /// Decodes a triangle whose first edge is a recent one.
    fn at_edge(&mut self, edge: u8, code: u8) -> Result<[u32; 3], String> {
        let [a, b] = self.edges.get(edge)?;
        let c = match code {
            0 => self.new_vertex(),
            1..=12 => self.vertices.get(code)?,
            13 | 14 => {
                self.last = if code == 13 { self.last.wrapping_sub(1) } else { self.last.wrapping_add(1) };
                self.last
            }
            _ => self.difference()?,
        };
        self.edges.push([c, b]);
        self.edges.push([a, c]);
        if !(1..=12).contains(&code) {
            self.vertices.push(c);
        }
        Ok([a, b, c])
    }

    /// Decodes a triangle without a recent edge; `pair` has the codes of its last two vertices. Its first one
    /// is new, or a difference.
    fn alone(&mut self, is_new: bool, pair: u8) -> Result<[u32; 3], String> {
        let a = if is_new { self.new_vertex() } else { self.difference()? };
        let codes = [pair >> 4, pair & 15];
        let mut rest = [0; 2];
        for (vertex, code) in rest.iter_mut().zip(codes) {
            *vertex = match code {
                0 => self.new_vertex(),
                15 => self.difference()?,
                _ => self.vertices.get(code - 1)?,
            };
        }
        let [b, c] = rest;
        for edge in [[b, a], [c, b], [a, c]] {
            self.edges.push(edge);
        }
        self.vertices.push(a);
        for (vertex, _) in rest.into_iter().zip(codes).filter(|(_, code)| matches!(code, 0 | 15)) {
            self.vertices.push(vertex);
        }
        Ok([a, b, c])
    }
}

fn decode_triangles(bytes: &[u8], count: usize) -> Result<Vec<[u32; 3]>, String> {
    if !count.is_multiple_of(3) {
        return Err(format!("{count} indices do not make whole triangles"));
    }
    let (mut stream, pairs) = split_tail(bytes, 0xe1, 16)?;
    let codes = take(&mut stream, count / 3)?;
    let mut state = Triangles { stream, ..Triangles::default() };
    let mut out = Vec::with_capacity(codes.len());
    for code in codes {
        let (edge, code) = (code >> 4, code & 15);
        out.push(match (edge, code) {
            (0..15, _) => state.at_edge(edge, code)?,
            (_, 0..14) => state.alone(true, pairs[usize::from(code)])?,
            _ => {
                let pair = take(&mut state.stream, 1)?[0];
                if pair == 0 {
                    state.next = 0;
                }
                state.alone(code == 14, pair)?
            }
        });
    }
    check_end(state.stream)?;
    Ok(out)
}

fn decode_indices(bytes: &[u8], count: usize) -> Result<Vec<u32>, String> {
    let (mut stream, _) = split_tail(bytes, 0xd1, 4)?;
    if count > stream.len() {
        return Err(format!("{count} indices do not fit into {} compressed bytes", bytes.len()));
    }
    let mut out = Vec::with_capacity(count);
    let mut last = [0_u32; 2];
    for _ in 0..count {
        let value = read_varint(&mut stream)?;
        let last = &mut last[value as usize & 1];
        *last = last.wrapping_add(zigzag(value >> 1));
        out.push(*last);
    }
    check_end(stream)?;
    Ok(out)
}

// Filters.

/// Replaces each element of four integers of one or two bytes.
fn map_quads(bytes: &mut [u8], size: usize, is_signed: bool, f: impl Fn([i32; 4]) -> [i32; 4]) {
    for element in bytes.chunks_exact_mut(4 * size) {
        let integer = |i: usize| match (&element[i * size..(i + 1) * size], is_signed) {
            ([a, b], true) => i16::from_le_bytes([*a, *b]).into(),
            ([a, b], false) => u16::from_le_bytes([*a, *b]).into(),
            ([a, ..], true) => i32::from(*a as i8),
            ([a, ..], false) => i32::from(*a),
            ([], _) => 0,
        };
        let mapped = f(std::array::from_fn(integer));
        for (component, value) in element.chunks_exact_mut(size).zip(mapped) {
            component.copy_from_slice(&value.to_le_bytes()[..size]);
        }
    }
}

/// Decodes a unit vector from an octahedron whose scale is the third component; the fourth one is kept.
fn octahedral([x, y, one, last]: [i32; 4], max: i32) -> [i32; 4] {
    let (mut x, mut y) = (x as f32 / one as f32, y as f32 / one as f32);
    let z = 1.0 - x.abs() - y.abs();
    let fold = z.min(0.0);
    x -= fold.copysign(x);
    y -= fold.copysign(y);
    let scale = max as f32 / (x * x + y * y + z * z).sqrt();
    let [x, y, z] = [x, y, z].map(|v| (v * scale).round() as i32);
    [x, y, z, last]
}

/// Decodes a unit quaternion from its three smaller components; the last integer has their scale and, in its
/// lowest two bits, the position of the largest one.
fn quaternion([x, y, z, last]: [i32; 4]) -> [i32; 4] {
    let scale = std::f32::consts::FRAC_1_SQRT_2 / (last | 3) as f32;
    let [x, y, z] = [x, y, z].map(|v| v as f32 * scale);
    let largest = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    let mut out = [largest, x, y, z].map(|v| (v * 32767.0).round() as i32);
    out.rotate_right((last & 3) as usize);
    out
}

/// Decodes a float from a signed exponent of 8 bits and a signed mantissa of 24 bits.
fn exponential(bytes: &mut [u8; 4]) {
    let bits = i32::from_le_bytes(*bytes);
    let mantissa = (bits << 8 >> 8) as f32;
    // Powers of two are exact by their bits; valid exponents are those from -100 to 100.
    let power = f32::from_bits(((bits >> 24).clamp(-126, 127) + 127).cast_unsigned() << 23);
    *bytes = (mantissa * power).to_le_bytes();
}

/// Decodes RGBA from YCoCg and an alpha whose highest bit gives the number of bits.
fn color([y, orange, green, alpha]: [i32; 4], max: i32) -> [i32; 4] {
    let scale = (1 << (32 - alpha.leading_zeros())) - 1;
    let sign_extended = |v: i32| if v > max / 2 { v - max - 1 } else { v };
    let (orange, green) = (sign_extended(orange), sign_extended(green));
    let half = alpha & (scale >> 1);
    let rgba = [y + orange - green, y + green, y - orange - green, half << 1 | (half & 1)];
    rgba.map(|v| ((v as f32 * max as f32 / scale as f32).round() as i32).clamp(0, max))
}
