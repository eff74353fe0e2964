//! Decoding of KHR_draco_mesh_compression by the crate draco-core.

use ::gltf::json::accessor::ComponentType;
use draco_core::{DataType, DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute, PointIndex};

/// A decoded mesh.
pub struct Geometry(Mesh);

impl Geometry {
    /// Decodes a mesh of at most `max_faces` triangles and `max_bytes` of attributes; an error is the cause.
    pub fn decode(bytes: &[u8], max_faces: u64, max_bytes: u64) -> Result<Self, String> {
        let limits = DecodeLimits::default().with_max_faces(max_faces).with_max_decoded_bytes(max_bytes);
        let mut mesh = Mesh::new();
        let decoded = MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes).with_limits(limits), &mut mesh);
        decoded.map_err(|e| e.to_string())?;
        Ok(Self(mesh))
    }

    /// Returns the number of vertices.
    pub fn vertices(&self) -> usize {
        self.0.num_points()
    }

    /// Returns the corners of all triangles as 32-bit integers.
    pub fn indices(&self) -> Vec<u8> {
        self.0.faces().as_flattened().iter().flat_map(|corner| corner.0.to_le_bytes()).collect()
    }

    /// Returns an attribute by its unique id with `lanes` components per vertex, converted to the type that
    /// the file's accessor declares.
    pub fn attribute(&self, id: u32, lanes: usize, component: ComponentType) -> Result<Vec<u8>, String> {
        let attribute = self.0.attribute_by_unique_id(id).ok_or_else(|| format!("there is no attribute of id {id}"))?;
        let found = usize::from(attribute.num_components());
        if found < lanes {
            return Err(format!("attribute {id} has {found} numbers per vertex, the accessor needs {lanes}"));
        }
        let size = attribute.data_type().byte_length();
        let mut out = Vec::new();
        for vertex in 0..self.vertices() {
            let value = value(attribute, vertex).ok_or_else(|| format!("attribute {id} has no vertex {vertex}"))?;
            for number in value.chunks_exact(size).take(lanes) {
                convert(attribute.data_type(), number, component, &mut out)
                    .ok_or_else(|| format!("a number of attribute {id} does not fit the accessor's componentType"))?;
            }
        }
        Ok(out)
    }
}

/// Returns the bytes of a vertex's value.
fn value(attribute: &PointAttribute, vertex: usize) -> Option<&[u8]> {
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let index = attribute.mapped_index(PointIndex(u32::try_from(vertex).ok()?)).0 as usize;
    let start = index.checked_mul(stride)?;
    attribute.buffer().data().get(start..start.checked_add(stride)?)
}

/// Appends a number in the accessor's type; returns `None` if it has no such number.
fn convert(from: DataType, bytes: &[u8], to: ComponentType, out: &mut Vec<u8>) -> Option<()> {
    if (from, to) == (DataType::Float32, ComponentType::F32) {
        out.extend(bytes);
        return Some(());
    }
    let integer = match (from, bytes) {
        (DataType::Int8, &[a]) => i64::from(a as i8),
        (DataType::Uint8 | DataType::Bool, &[a]) => i64::from(a),
        (DataType::Int16, &[a, b]) => i64::from(i16::from_le_bytes([a, b])),
        (DataType::Uint16, &[a, b]) => i64::from(u16::from_le_bytes([a, b])),
        (DataType::Int32, &[a, b, c, d]) => i64::from(i32::from_le_bytes([a, b, c, d])),
        (DataType::Uint32, &[a, b, c, d]) => i64::from(u32::from_le_bytes([a, b, c, d])),
        _ => return None,
    };
    match to {
        ComponentType::I8 => out.extend(i8::try_from(integer).ok()?.to_le_bytes()),
        ComponentType::U8 => out.extend(u8::try_from(integer).ok()?.to_le_bytes()),
        ComponentType::I16 => out.extend(i16::try_from(integer).ok()?.to_le_bytes()),
        ComponentType::U16 => out.extend(u16::try_from(integer).ok()?.to_le_bytes()),
        ComponentType::U32 => out.extend(u32::try_from(integer).ok()?.to_le_bytes()),
        ComponentType::F32 => out.extend((integer as f32).to_le_bytes()),
    }
    Some(())
}
