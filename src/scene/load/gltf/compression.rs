//! Compressed data: KHR_draco_mesh_compression, EXT_meshopt_compression and KHR_meshopt_compression; and the
//! choice of compressed images by KHR_texture_basisu and EXT_texture_webp.
//!
//! A pass between parsing and loading decodes buffer views and primitives into buffers of their own and lets
//! the JSON refer to these, so that the rest of the loader reads a plain file. Compressed data is preferred to
//! an uncompressed fallback, whose buffer is not read.

use std::collections::BTreeMap;

use ::gltf::json::accessor::{ComponentType, GenericComponentType, Type};
use ::gltf::json::buffer::View;
use ::gltf::json::mesh::Mode;
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use serde::Deserialize;

use super::codec::draco::Geometry;
use super::codec::meshopt::{self, Filter};
use super::file::File;
use super::mesh::MAX_CORNERS;
use crate::scene::LoadError;

/// Maximum total of decoded bytes of one file. A small file may describe more, for repeated values compress
/// well.
const MAX_BYTES: u64 = 1 << 31;

/// The part of the JSON that describes compressed data, which the parser's own types omit.
#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Compression {
    #[serde(default)]
    buffers: Vec<Extended<Meshopt<Fallback>>>,
    #[serde(default)]
    buffer_views: Vec<Extended<Meshopt<CompressedView>>>,
    #[serde(default)]
    meshes: Vec<ParsedMesh>,
    #[serde(default)]
    textures: Vec<Extended<Images>>,
}

/// An object with extensions.
#[derive(Deserialize)]
struct Extended<T> {
    extensions: Option<T>,
}

/// The extension of buffers or of buffer views, under either of its names.
#[derive(Deserialize)]
struct Meshopt<T> {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    meshopt: Option<T>,
}

#[derive(Deserialize)]
struct Fallback {
    #[serde(default)]
    fallback: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct CompressedView {
    buffer: Index<json::Buffer>,
    #[serde(default)]
    byte_offset: u64,
    byte_length: u64,
    byte_stride: usize,
    count: usize,
    mode: meshopt::Mode,
    #[serde(default)]
    filter: Filter,
}

#[derive(Deserialize)]
struct ParsedMesh {
    #[serde(default)]
    primitives: Vec<Extended<Draco>>,
}

#[derive(Deserialize)]
struct Draco {
    #[serde(rename = "KHR_draco_mesh_compression")]
    draco: Option<CompressedPrimitive>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct CompressedPrimitive {
    buffer_view: Index<View>,
    /// Unique ids in the compressed data by attribute.
    attributes: BTreeMap<String, u32>,
}

/// The images of a texture in formats beside PNG and JPEG.
#[derive(Deserialize)]
struct Images {
    #[serde(rename = "KHR_texture_basisu")]
    ktx2: Option<ImageSource>,
    #[serde(rename = "EXT_texture_webp")]
    webp: Option<ImageSource>,
}

#[derive(Deserialize)]
struct ImageSource {
    source: Option<Index<json::Image>>,
}

impl Compression {
    /// Lets textures refer to their images in KTX2 or WebP, if they have them.
    pub fn select_images(&self, root: &mut json::Root) {
        let count = root.images.len();
        for (texture, parsed) in root.textures.iter_mut().zip(&self.textures) {
            let images = parsed.extensions.as_ref().map(|e| [&e.ktx2, &e.webp]);
            let mut sources = images.into_iter().flatten().filter_map(|image| image.as_ref()?.source);
            texture.source = sources.find(|source| source.value() < count).unwrap_or(texture.source);
        }
    }

    /// Returns true for a buffer whose data other loaders read in place of compressed data.
    pub fn is_fallback(&self, buffer: usize) -> bool {
        let extension = self.buffers.get(buffer).and_then(|b| b.extensions.as_ref()?.meshopt.as_ref());
        extension.is_some_and(|e| e.fallback)
    }

    /// Decodes all compressed data of a file whose buffers are loaded.
    ///
    /// # Errors
    /// Data that is damaged, that contradicts the JSON, or that expands to too many bytes is an error.
    pub fn decode(&self, file: &mut File) -> Result<(), LoadError> {
        let mut budget = MAX_BYTES;
        for (i, view) in self.buffer_views.iter().enumerate() {
            if let Some(view) = view.extensions.as_ref().and_then(|e| e.meshopt.as_ref()) {
                view.decode(file, i, &mut budget)?;
            }
        }
        for (m, mesh) in self.meshes.iter().enumerate() {
            for (p, primitive) in mesh.primitives.iter().enumerate() {
                if let Some(primitive) = primitive.extensions.as_ref().and_then(|e| e.draco.as_ref()) {
                    primitive.decode(file, [m, p], &mut budget)?;
                }
            }
        }
        Ok(())
    }
}

/// Subtracts from the bytes that a file may expand to.
fn spend(budget: &mut u64, bytes: u64) -> Result<(), String> {
    *budget = budget
        .checked_sub(bytes)
        .ok_or_else(|| format!("the file's compressed data expands to more than {MAX_BYTES} bytes: split the file"))?;
    Ok(())
}

impl CompressedView {
    /// Decodes the data of a buffer view and lets the view refer to the result.
    fn decode(&self, file: &mut File, index: usize, budget: &mut u64) -> Result<(), LoadError> {
        let place = format!("bufferViews[{index}]");
        let failed =
            |cause: String| file.error(&place, format!("meshopt compression: {cause}: compress the file again"));
        let length = file.root.buffer_views[index].byte_length.0;
        let (count, stride) = (self.count as u64, self.byte_stride as u64);
        if count.checked_mul(stride) != Some(length) {
            return Err(failed(format!("{count} elements of {stride} bytes are not the {length} bytes of the view")));
        }
        spend(budget, length).map_err(failed)?;
        let bytes = file.slice(self.buffer, self.byte_offset, self.byte_length, &place)?;
        let decoded = meshopt::decode(bytes, self.mode, self.filter, self.count, self.byte_stride).map_err(failed)?;
        let buffer = file.add_buffer(decoded);
        let view = &mut file.root.buffer_views[index];
        (view.buffer, view.byte_offset) = (buffer, None);
        Ok(())
    }
}

impl CompressedPrimitive {
    /// Decodes a primitive and gives it accessors of its own for its indices and compressed attributes.
    fn decode(&self, file: &mut File, [mesh, primitive]: [usize; 2], budget: &mut u64) -> Result<(), LoadError> {
        let place = format!("meshes[{mesh}].primitives[{primitive}]");
        let failed = |file: &File, cause: String| {
            file.error(&place, format!("KHR_draco_mesh_compression: {cause}: compress the file again"))
        };
        // Compressed points and lines are left out.
        if matches!(
            file.root.meshes[mesh].primitives[primitive].mode,
            Checked::Valid(Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip)
        ) {
            return Ok(());
        }
        let bytes = file.view(self.buffer_view, &place)?;
        let max_faces = (*budget / 12).min(MAX_CORNERS as u64 / 3);
        let geometry = Geometry::decode(bytes, max_faces, *budget).map_err(|cause| failed(file, cause))?;
        let attributes = file.root.meshes[mesh].primitives[primitive].attributes.clone();
        for (semantic, accessor) in attributes {
            let Checked::Valid(name) = &semantic else { continue };
            let Some(&id) = self.attributes.get(&name.to_string()) else { continue };
            let place = format!("{place}.attributes.{}", name.to_string());
            let mut accessor = file.get(accessor, &place, "accessors")?.clone();
            let (Checked::Valid(component), Checked::Valid(kind)) = (&accessor.component_type, &accessor.type_) else {
                return Err(file.error(place, "the accessor's type or componentType is unknown"));
            };
            let decoded = geometry.attribute(id, kind.multiplicity(), component.0);
            let decoded = decoded.map_err(|cause| failed(file, cause))?;
            spend(budget, decoded.len() as u64).map_err(|cause| failed(file, cause))?;
            accessor.buffer_view = Some(file.add_view(decoded));
            accessor.byte_offset = None;
            accessor.count = geometry.vertices().into();
            let accessor = file.root.push(accessor);
            file.root.meshes[mesh].primitives[primitive].attributes.insert(semantic, accessor);
        }
        let indices = geometry.indices();
        spend(budget, indices.len() as u64).map_err(|cause| failed(file, cause))?;
        let accessor = json::Accessor {
            count: (indices.len() / 4).into(),
            component_type: Checked::Valid(GenericComponentType(ComponentType::U32)),
            type_: Checked::Valid(Type::Scalar),
            buffer_view: Some(file.add_view(indices)),
            byte_offset: None,
            normalized: false,
            sparse: None,
            min: None,
            max: None,
            name: None,
            extensions: None,
            extras: Default::default(),
        };
        let accessor = file.root.push(accessor);
        let primitive = &mut file.root.meshes[mesh].primitives[primitive];
        // The decoded indices are those of single triangles, also where the file says that they are a strip.
        (primitive.indices, primitive.mode) = (Some(accessor), Checked::Valid(Mode::Triangles));
        Ok(())
    }
}
