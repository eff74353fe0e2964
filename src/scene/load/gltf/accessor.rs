//! Typed views into buffers, checked once on opening and read element by element.

use std::collections::HashMap;

use ::gltf::json::accessor::{ComponentType, Type};
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};

use super::file::File;
use crate::scene::LoadError;

/// Maximum number of elements of an accessor without a buffer (zero except for its sparse part).
const MAX_VIRTUAL_ELEMENTS: u64 = 1 << 24;

/// An accessor all of whose elements are known to lie inside its buffer.
pub(super) struct Accessor<'a> {
    /// JSON path, such as `accessors[3]`.
    pub place: String,
    /// Number of elements.
    pub count: usize,
    /// Numbers in an element: 1 for SCALAR to 16 for MAT4.
    pub lanes: usize,
    component: ComponentType,
    normalized: bool,
    stride: usize,
    data: Option<&'a [u8]>,
    sparse: HashMap<usize, &'a [u8]>,
}

impl<'a> Accessor<'a> {
    /// Opens an accessor; `place` is the referring element and `lanes` lists the valid numbers of components.
    pub fn open(file: &'a File, index: Index<json::Accessor>, place: &str, lanes: &[usize]) -> Result<Self, LoadError> {
        let accessor = file.get(index, place, "accessors")?;
        let asker = place;
        let place = format!("accessors[{}]", index.value());
        let Checked::Valid(component) = &accessor.component_type else {
            return Err(file.error(place, "unknown componentType"));
        };
        let component = component.0;
        let found = match &accessor.type_ {
            Checked::Valid(Type::Scalar) => 1,
            Checked::Valid(Type::Vec2) => 2,
            Checked::Valid(Type::Vec3) => 3,
            Checked::Valid(Type::Vec4 | Type::Mat2) => 4,
            Checked::Valid(Type::Mat3) => 9,
            Checked::Valid(Type::Mat4) => 16,
            Checked::Invalid => return Err(file.error(place, "unknown type")),
        };
        if !lanes.contains(&found) {
            let cause = format!("has {found} numbers per element, {asker} needs {lanes:?}");
            return Err(file.error(place, cause));
        }
        let element = found * size_of(component);
        let count = accessor.count.0;
        let (data, stride) = match accessor.buffer_view {
            Some(view) => {
                let bytes = file.view(view, &place)?;
                let view = file.get(view, &place, "bufferViews")?;
                let stride = view.byte_stride.map_or(element, |s| s.0);
                let offset = accessor.byte_offset.unwrap_or_default().0;
                if stride < element {
                    return Err(file.error(place, format!("a stride of {stride} bytes is less than an element")));
                }
                let end = count.saturating_sub(1).checked_mul(stride as u64);
                let end =
                    end.and_then(|e| e.checked_add(offset)?.checked_add(if count > 0 { element as u64 } else { 0 }));
                if end.is_none_or(|end| end > bytes.len() as u64) {
                    let cause = format!("{count} elements from byte {offset} do not fit into {} bytes", bytes.len());
                    return Err(file.error(place, cause));
                }
                (Some(&bytes[offset as usize..]), stride)
            }
            None if count > MAX_VIRTUAL_ELEMENTS => {
                return Err(file.error(place, format!("{count} elements without a bufferView are too many")));
            }
            None => (None, element),
        };
        let mut out = Self {
            place,
            count: count as usize,
            lanes: found,
            component,
            normalized: accessor.normalized,
            stride,
            data,
            sparse: HashMap::new(),
        };
        if let Some(sparse) = &accessor.sparse {
            out.open_sparse(file, sparse)?;
        }
        Ok(out)
    }

    fn open_sparse(&mut self, file: &'a File, sparse: &json::accessor::sparse::Sparse) -> Result<(), LoadError> {
        let place = format!("{}.sparse", self.place);
        let Checked::Valid(kind) = &sparse.indices.component_type else {
            return Err(file.error(place, "unknown componentType of the indices"));
        };
        let (kind, element) = (kind.0, self.lanes * size_of(self.component));
        let part = |view, offset: u64, size: usize| {
            let bytes: &'a [u8] = file.view(view, &place)?;
            let end = sparse.count.0.checked_mul(size as u64).and_then(|length| length.checked_add(offset));
            match end.filter(|&end| end <= bytes.len() as u64) {
                Some(end) => Ok(&bytes[offset as usize..end as usize]),
                None => Err(file.error(&place, format!("{} elements do not fit into the buffer view", sparse.count.0))),
            }
        };
        let indices = part(sparse.indices.buffer_view, sparse.indices.byte_offset.0, size_of(kind))?;
        let values = part(sparse.values.buffer_view, sparse.values.byte_offset.0, element)?;
        for (index, value) in indices.chunks_exact(size_of(kind)).zip(values.chunks_exact(element)) {
            let index = integer(kind, index) as usize;
            if index >= self.count {
                return Err(file.error(place, format!("index {index} is past the {} elements", self.count)));
            }
            self.sparse.insert(index, value);
        }
        Ok(())
    }

    /// Returns true if elements are unsigned integers, as indices and joints have to be.
    pub fn is_unsigned(&self) -> bool {
        matches!(self.component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
    }

    fn bytes(&self, element: usize, lane: usize) -> Option<&'a [u8]> {
        let size = size_of(self.component);
        let at = lane * size;
        if !self.sparse.is_empty()
            && let Some(value) = self.sparse.get(&element)
        {
            return Some(&value[at..at + size]);
        }
        let at = at + element * self.stride;
        self.data.map(|data| &data[at..at + size])
    }

    /// Returns one unsigned integer of an element.
    pub fn integer(&self, element: usize, lane: usize) -> u32 {
        self.bytes(element, lane).map_or(0, |bytes| integer(self.component, bytes))
    }

    /// Returns an element as floats, normalized if the file says so; missing components are `fill`.
    pub fn floats<const N: usize>(&self, element: usize, fill: f32) -> [f32; N] {
        std::array::from_fn(|lane| {
            if lane >= self.lanes {
                return fill;
            }
            let Some(b) = self.bytes(element, lane) else {
                return 0.0;
            };
            // glTF 2.0, 3.11, clamps signed integers, so that -128 and -127 both mean -1.
            let (value, scale) = match self.component {
                ComponentType::F32 => return f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
                ComponentType::I8 => (f32::from(b[0] as i8), 127.0),
                ComponentType::I16 => (f32::from(i16::from_le_bytes([b[0], b[1]])), 32767.0),
                ComponentType::U8 => (f32::from(b[0]), 255.0),
                ComponentType::U16 => (f32::from(u16::from_le_bytes([b[0], b[1]])), 65535.0),
                ComponentType::U32 => (integer(ComponentType::U32, b) as f32, 4_294_967_295.0),
            };
            if self.normalized { (value / scale).max(-1.0) } else { value }
        })
    }
}

fn size_of(component: ComponentType) -> usize {
    match component {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

fn integer(component: ComponentType, bytes: &[u8]) -> u32 {
    match (component, bytes) {
        (ComponentType::U8 | ComponentType::I8, [a]) => u32::from(*a),
        (ComponentType::U16 | ComponentType::I16, [a, b]) => u32::from(u16::from_le_bytes([*a, *b])),
        (_, [a, b, c, d]) => u32::from_le_bytes([*a, *b, *c, *d]),
        _ => 0,
    }
}
