//! PLY meshes, ASCII and binary, by `ply-rs-bw`: positions, normals, texture coordinates of vertices or of faces' corners,
//! colours, polygons and triangle strips.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use glam::{DVec3, Vec2, Vec3, Vec4};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};

use crate::scene::load::{far, strokes};
use crate::scene::model::tangents;
use crate::scene::{LoadError, Mesh};

/// What a PLY file holds.
pub(in crate::scene) struct Parsed {
    /// Relative to `origin`.
    pub mesh: Mesh,
    /// A place near the vertices, if they are far from the file's own origin; else zero.
    pub origin: DVec3,
    /// Name of its texture, which MeshLab and others write as a comment.
    pub texture: Option<String>,
    /// What is left out, or not drawn as it is.
    pub warnings: Vec<String>,
}

/// Parses a mesh. Texture coordinates stay unchanged.
///
/// Polygons are split into fans. Points of a file without faces are balls, of clouds of Gaussian splats those that are mostly
/// opaque (Kerbl et al. 2023). Errors name the line of an ASCII file, and the vertex or face of a binary
/// one.
pub(in crate::scene) fn parse(path: &Path, bytes: &[u8]) -> Result<Parsed, LoadError> {
    let at_line = |e: ParseError| match e.line() {
        Some(line) => LoadError::at(path, format!("line {line}"), tidy(&e.to_string())),
        None => LoadError::new(path, tidy(&e.to_string())),
    };
    let bytes = &*tidied(bytes);
    let mut reader = Reader::new(bytes);
    let header = Parser::<Vertex>::new().read_header(&mut reader).map_err(at_line)?;
    let error = |e: ParseError| match header.encoding {
        Encoding::Ascii => at_line(e),
        // For binary files the parser's line numbers count elements.
        _ => LoadError::new(path, tidy(&e.to_string())),
    };
    // An element takes at least this many bytes, so a header cannot announce more than the file holds.
    let mut promised = 0_u128;
    for (name, element) in &header.elements {
        let least = smallest(element, header.encoding).max(1);
        promised += element.count as u128 * least as u128;
        if promised > bytes.len() as u128 + 1 {
            return Err(LoadError::new(
                path,
                format!("is truncated: the header promises {} of `{name}`, more than the file can hold", element.count),
            ));
        }
    }
    let mut vertices: Vec<Vertex> = Vec::new();
    let mut faces: Vec<Face> = Vec::new();
    let mut strips: Vec<Strips> = Vec::new();
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                vertices = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(error)?
            }
            "face" => faces = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(error)?,
            "tristrips" => {
                strips = Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(error)?
            }
            _ => drop(Parser::<Skipped>::new().read_payload_for_element(&mut reader, element, &header).map_err(error)?),
        }
    }
    let has = |element: &str, names: &[&str]| {
        header.elements.get(element).is_some_and(|e| names.iter().all(|n| e.properties.contains_key(*n)))
    };
    if has("vertex", &["packed_position"]) {
        return Err(LoadError::new(
            path,
            "holds Gaussian splats in PlayCanvas' packed form: export them as a plain PLY",
        ));
    }
    if !has("vertex", &["x", "y", "z"]) {
        return Err(LoadError::new(path, "has no vertices with x, y and z"));
    }
    if !faces.is_empty() && !has("face", &["vertex_indices"]) && !has("face", &["vertex_index"]) {
        return Err(LoadError::new(path, "its faces have no vertex_indices"));
    }
    if vertices.len() > u32::MAX as usize {
        return Err(LoadError::new(path, "has more vertices than 32 bits can count"));
    }
    let mut warnings = Vec::new();
    let is_cloud = faces.is_empty() && strips.is_empty();
    if is_cloud {
        // Scanners write `nan` where they see nothing.
        let all = vertices.len();
        vertices.retain(Vertex::is_finite);
        if vertices.len() < all {
            warnings.push(format!("points that are not finite are left out: {}", all - vertices.len()));
        }
        if has("vertex", &SPLAT_COLOR) {
            vertices.retain(|vertex| vertex.opacity > 0.0);
        }
    } else if let Some(i) = vertices.iter().position(|vertex| !vertex.is_finite()) {
        return Err(LoadError::at(path, format!("vertex {i}"), "has a number that is not finite"));
    }
    let origin = far::origin(vertices.iter().map(|v| v.position));
    let positions = vertices.iter().map(|v| (v.position - origin).as_vec3()).collect();
    let mut mesh = Mesh { positions, ..Mesh::default() };
    if has("vertex", &["nx", "ny", "nz"]) {
        mesh.normals = vertices.iter().map(|v| v.normal.normalize_or_zero()).collect();
    }
    if UV_NAMES.iter().any(|names| has("vertex", names)) {
        mesh.uvs[0] = vertices.iter().map(|v| v.uv).collect();
    }
    if COLOR_NAMES.iter().any(|names| has("vertex", names)) {
        mesh.colors = vertices.iter().map(|v| v.color).collect();
    }
    mesh.triangles = triangulate(path, &faces, vertices.len())?;
    for strip in strips.iter().flat_map(|strips| strips.corners.split(|&corner| corner < 0)) {
        add_strip(strip, vertices.len(), &mut mesh.triangles)
            .map_err(|cause| LoadError::at(path, "tristrips", cause))?;
    }
    if faces.iter().any(|face| !face.uvs.is_empty()) {
        give_uvs_to_corners(&faces, &mut mesh);
    }
    if is_cloud && !mesh.positions.is_empty() {
        let (balls, said) = strokes::balls(&mesh.positions, &mesh.colors);
        mesh = balls;
        warnings.push(said);
    }
    let texture = |comment: &String| Some(comment.trim().strip_prefix("TextureFile")?.trim().to_owned());
    Ok(Parsed { mesh, origin, texture: header.comments.iter().find_map(texture), warnings })
}

/// Returns a file as the parser wants it. Lines of headers may end as on an old Macintosh, which Rhinoceros writes, be indented,
/// or go on with the comment above; numbers in ASCII may be infinite or none, for which stand some that are too large.
fn tidied(bytes: &[u8]) -> Cow<'_, [u8]> {
    const END: &[u8] = b"end_header";
    const KEYWORDS: [&str; 7] = ["ply", "format", "comment", "obj_info", "element", "property", "end_header"];
    let Some(end) = bytes.windows(END.len()).position(|word| word == END).filter(|_| bytes.starts_with(b"ply")) else {
        return Cow::Borrowed(bytes);
    };
    let (header, body) = bytes.split_at(end + END.len());
    let header = String::from_utf8_lossy(header);
    let newline = if header.contains("\r\n") { "\r\n" } else { ["\r", "\n"][usize::from(header.contains('\n'))] };
    let is_known = |line: &str| KEYWORDS.contains(&line.split([' ', '\t']).next().unwrap_or_default());
    let is_ascii = header.split(newline).any(|line| line.trim().starts_with("format") && line.contains("ascii"));
    let is_number = |byte: &u8| byte.is_ascii_digit() || byte.is_ascii_whitespace() || b"+-.eE".contains(byte);
    if newline != "\r" && header.split(newline).all(is_known) && (!is_ascii || body.iter().all(is_number)) {
        return Cow::Borrowed(bytes);
    }
    let mut tidy = Vec::with_capacity(bytes.len());
    for line in header.split(newline).map(str::trim) {
        let comment = if is_known(line) { "" } else { "comment " };
        tidy.extend([comment, line, "\n"].iter().flat_map(|text| text.bytes()));
    }
    let spaces = body.iter().take_while(|byte| b" \t".contains(byte)).count();
    let body = body[spaces..].strip_prefix(newline.as_bytes()).unwrap_or(body);
    if is_ascii {
        let is_none = |word: &&str| word.parse().is_ok_and(|value: f32| !value.is_finite());
        for line in String::from_utf8_lossy(body).split(newline) {
            let words = line.split_whitespace().map(|word| if is_none(&word) { "1e99" } else { word });
            tidy.extend(words.flat_map(|word| [word, " "]).chain(["\n"]).flat_map(str::bytes));
        }
    } else {
        tidy.extend_from_slice(body);
    }
    Cow::Owned(tidy)
}

/// Gives corners of triangles the texture coordinates that faces have for them: vertices that have several become several.
/// Those of strips, and of a face that has not two for each corner, are zero.
fn give_uvs_to_corners(faces: &[Face], mesh: &mut Mesh) {
    let mut of_corners = Vec::with_capacity(3 * mesh.triangles.len());
    for face in faces {
        let corners = face.corners.as_ref().map_or(0, Vec::len);
        let whole = face.uvs.len() == 2 * corners && face.uvs.iter().all(|v| v.is_finite());
        let uv = |corner: usize| if whole { [face.uvs[2 * corner], face.uvs[2 * corner + 1]] } else { [0.0; 2] };
        of_corners.extend((2..corners).flat_map(|last| [uv(0), uv(last - 1), uv(last)]));
    }
    let mut vertices: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
    let (mut sources, mut uvs) = (Vec::new(), Vec::new());
    let of_corners = of_corners.into_iter().chain(std::iter::repeat([0.0; 2]));
    for (corner, uv) in mesh.triangles.as_flattened_mut().iter_mut().zip(of_corners) {
        *corner = *vertices.entry((*corner, uv.map(f32::to_bits))).or_insert_with(|| {
            sources.push(*corner);
            uvs.push(Vec2::from(uv));
            sources.len() as u32 - 1
        });
    }
    tangents::select(mesh, &sources);
    mesh.uvs[0] = uvs;
}

/// Splits polygons into fans and checks their indices.
fn triangulate(path: &Path, faces: &[Face], vertices: usize) -> Result<Vec<[u32; 3]>, LoadError> {
    let mut triangles = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        let error = |cause: String| LoadError::at(path, format!("face {i}"), cause);
        let Some(corners) = &face.corners else {
            return Err(error("has an index that is negative or no whole number".to_owned()));
        };
        if let Some(index) = corners.iter().find(|&&v| v as usize >= vertices) {
            return Err(error(format!("refers to vertex {index} of {vertices}")));
        }
        if corners.len() < 3 {
            return Err(error(format!("has {} corners", corners.len())));
        }
        triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
    }
    Ok(triangles)
}

/// Adds the triangles of a strip, of which each second one is wound the other way. Those that repeat a corner only lead to
/// the next one.
fn add_strip(corners: &[i64], vertices: usize, triangles: &mut Vec<[u32; 3]>) -> Result<(), String> {
    if let Some(index) = corners.iter().find(|&&v| v as usize >= vertices) {
        return Err(format!("refers to vertex {index} of {vertices}"));
    }
    let three =
        corners.windows(3).enumerate().map(|(i, c)| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[1], c[0], c[2]] });
    let proper = three.filter(|[a, b, c]| a != b && b != c && c != a);
    triangles.extend(proper.map(|triangle| triangle.map(|v| v as u32)));
    Ok(())
}

/// Joins the lines of a parser's message and removes the repeated line number.
fn tidy(message: &str) -> String {
    let text = message.strip_prefix("Line ").and_then(|m| m.split_once(": ")).map_or(message, |(_, rest)| rest);
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns a lower bound on the bytes of one element.
fn smallest(element: &ElementDef, encoding: Encoding) -> usize {
    let size = |scalar: &ScalarType| match (encoding, scalar) {
        // An ASCII number has at least a digit and a space.
        (Encoding::Ascii, _) => 2,
        (_, ScalarType::Char | ScalarType::UChar) => 1,
        (_, ScalarType::Short | ScalarType::UShort) => 2,
        (_, ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        (_, ScalarType::Double) => 8,
    };
    let property = |kind: &PropertyType| match kind {
        PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => size(scalar),
    };
    element.properties.iter().map(|(_, p)| property(&p.data_type)).sum()
}

const UV_NAMES: [[&str; 2]; 3] = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]];
const COLOR_NAMES: [[&str; 3]; 4] =
    [["red", "green", "blue"], ["r", "g", "b"], ["color_0", "color_1", "color_2"], SPLAT_COLOR];

/// Coefficients of the constant spherical harmonic of a Gaussian splat's colour, and that harmonic.
const SPLAT_COLOR: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
const HARMONIC: f32 = 0.282_094_8;

struct Vertex {
    position: DVec3,
    normal: Vec3,
    uv: Vec2,
    color: Vec4,
    /// Of a Gaussian splat, the logarithm of the odds.
    opacity: f32,
}

impl Vertex {
    fn is_finite(&self) -> bool {
        self.position.as_vec3().is_finite() && self.normal.is_finite() && self.uv.is_finite() && self.color.is_finite()
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: DVec3::ZERO, normal: Vec3::ZERO, uv: Vec2::ZERO, color: Vec4::ONE, opacity: f32::INFINITY }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(value) = property.to_f32_lossy() else { return PropertyAccessResult::Ignored };
        // Integer colours are divided by the value of full intensity.
        let full = match property {
            Property::UChar(_) => 255.0,
            Property::UShort(_) => 65535.0,
            _ => 1.0,
        };
        let position = match property {
            Property::Double(position) => position,
            _ => value.into(),
        };
        match name {
            "x" => self.position.x = position,
            "y" => self.position.y = position,
            "z" => self.position.z = position,
            "nx" => self.normal.x = value,
            "ny" => self.normal.y = value,
            "nz" => self.normal.z = value,
            "u" | "s" | "texture_u" => self.uv.x = value,
            "v" | "t" | "texture_v" => self.uv.y = value,
            "red" | "r" | "color_0" => self.color.x = value / full,
            "green" | "g" | "color_1" => self.color.y = value / full,
            "blue" | "b" | "color_2" => self.color.z = value / full,
            "f_dc_0" => self.color.x = 0.5 + HARMONIC * value,
            "f_dc_1" => self.color.y = 0.5 + HARMONIC * value,
            "f_dc_2" => self.color.z = 0.5 + HARMONIC * value,
            "opacity" => self.opacity = value,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

#[derive(Default)]
struct Face {
    /// Corner indices; `None` if an index is negative or not an integer.
    corners: Option<Vec<u32>>,
    /// Texture coordinates of each corner; empty if the vertices have them.
    uvs: Vec<f32>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match (name, property) {
            ("vertex_indices" | "vertex_index", corners) => self.corners = corners.to_u32_list(),
            ("texcoord", Property::ListFloat(uvs)) => self.uvs = uvs,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// Triangle strips, one after the other; a negative number ends each but the last.
#[derive(Default)]
struct Strips {
    corners: Vec<i64>,
}

impl PropertyAccess for Strips {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListInt(corners) => corners.into_iter().map(i64::from).collect(),
            Property::ListShort(corners) => corners.into_iter().map(i64::from).collect(),
            other => other.to_u32_list().unwrap_or_default().into_iter().map(i64::from).collect(),
        };
        PropertyAccessResult::Set
    }
}

/// An element that is not part of the mesh.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
