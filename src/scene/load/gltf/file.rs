//! The container: JSON or GLB, buffers, URIs. Every access by an index is checked here.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

use ::gltf::json::mesh::Semantic;
use ::gltf::json::validation::{Checked, Validate as _};
use ::gltf::json::{self, Index, root::Get};
use base64::Engine as _;
use serde::Deserialize;

use super::animation::Parsed;
use super::compression::Compression;
use super::extensions::NormalTexture;
use super::instances::Instancing;
use super::lights::Profiles;
use crate::scene::LoadError;
use crate::scene::load::files::{Files, find};

/// A parsed file and the buffers that it refers to.
pub(super) struct File<'a> {
    /// Where the file and those that it refers to are.
    files: &'a dyn Files,
    /// Path of the file; relative URIs start from its folder.
    pub path: PathBuf,
    /// The JSON, syntactically valid and otherwise unchecked.
    pub root: json::Root,
    /// Normal maps by material, with the texture transforms that the parser's own types omit.
    pub normal_maps: HashMap<usize, NormalTexture>,
    /// Light profiles, which the parser's own types omit too.
    pub profiles: Profiles,
    /// Instances of nodes, which the parser's own types omit too.
    pub instancing: Instancing,
    /// Animations; the parser's own types only support those of nodes.
    pub animations: Parsed,
    /// Compressed data that is not decoded yet.
    compression: Compression,
    /// The binary chunk of a GLB.
    chunk: Option<Vec<u8>>,
    /// Bytes of each buffer; `None` if the file has no data for it.
    buffers: Vec<Option<Vec<u8>>>,
}

impl<'a> File<'a> {
    /// Reads and parses the file itself without the files that it refers to.
    pub fn open(path: &Path, files: &'a dyn Files) -> Result<Self, LoadError> {
        let bytes = files.read(path)?;
        let (text, chunk) = if bytes.starts_with(b"glTF") {
            split_glb(&bytes).map_err(|(place, cause)| LoadError::at(path, place, cause))?
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb")) {
            return Err(LoadError::at(path, "byte 0", "not a GLB file: it does not start with `glTF`"));
        } else {
            (&*bytes, None)
        };
        let invalid = |e: serde_json::Error| {
            // The message ends with the position, which moves to the error's own place.
            let cause = e.to_string();
            let cause = cause.split(" at line ").next().unwrap_or(&cause);
            LoadError::at(path, format!("line {} column {}", e.line(), e.column()), format!("not valid glTF: {cause}"))
        };
        let mut root = parse(text).map_err(|e| {
            if is_of_version_one(text) {
                return LoadError::new(path, "glTF version 1.0 is not supported: convert the file to glTF 2.0");
            }
            invalid(e)
        })?;
        let normal_maps = parse_normal_maps(text).map_err(invalid)?;
        let profiles = Profiles::parse(text).map_err(invalid)?;
        let instancing = Instancing::parse(text).map_err(invalid)?;
        let animations = serde_json::from_slice(text).map_err(invalid)?;
        let compression: Compression = serde_json::from_slice(text).map_err(invalid)?;
        compression.select_images(&mut root);
        drop_dangling_images(&mut root);
        share_images(&mut root);
        let version = root.asset.version.as_str();
        if version.split('.').next() != Some("2") {
            let cause = format!("glTF version {version:?} is not supported: convert the file to glTF 2.0");
            return Err(LoadError::at(path, "asset.version", cause));
        }
        let chunk = chunk.map(<[u8]>::to_vec);
        Ok(Self {
            files,
            path: path.to_owned(),
            root,
            normal_maps,
            profiles,
            instancing,
            animations,
            compression,
            chunk,
            buffers: Vec::new(),
        })
    }

    /// Checks that every index in the file refers to something, even in nodes outside the scene.
    pub fn check_references(&self) -> Result<(), LoadError> {
        // The parser's own validation reads this one index unchecked.
        for (m, mesh) in self.root.meshes.iter().enumerate() {
            for (p, primitive) in mesh.primitives.iter().enumerate() {
                if let Some(&index) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) {
                    self.get(index, &format!("meshes[{m}].primitives[{p}].attributes.POSITION"), "accessors")?;
                }
            }
        }
        let mut dangling = None;
        // The validation's other findings are ignored here: the code that uses a value checks it.
        self.root.validate(&self.root, json::Path::new, &mut |path, error| {
            if error == json::validation::Error::IndexOutOfBounds && dangling.is_none() {
                dangling = Some(path());
            }
        });
        dangling.map_or(Ok(()), |path| Err(self.error(path.0, "refers to something that does not exist")))
    }

    /// Reads all buffers and decodes the compressed data in them.
    pub fn load_buffers(&mut self) -> Result<(), LoadError> {
        for index in 0..self.root.buffers.len() {
            let place = format!("buffers[{index}]");
            let buffer = &self.root.buffers[index];
            let data = match &buffer.uri {
                _ if self.compression.is_fallback(index) => None,
                Some(uri) => Some(self.fetch(uri, &place)?),
                None if index == 0 => self.chunk.take(),
                None => None,
            };
            if let Some(data) = &data
                && (data.len() as u64) < buffer.byte_length.0
            {
                let cause = format!("truncated: {} of {} bytes are there", data.len(), buffer.byte_length.0);
                return Err(self.error(place, cause));
            }
            self.buffers.push(data);
        }
        std::mem::take(&mut self.compression).decode(self)
    }

    /// Adds a buffer that is not in the file itself.
    pub fn add_buffer(&mut self, data: Vec<u8>) -> Index<json::Buffer> {
        let byte_length = data.len().into();
        self.buffers.push(Some(data));
        self.root.push(json::Buffer {
            byte_length,
            name: None,
            uri: None,
            extensions: None,
            extras: Default::default(),
        })
    }

    /// Adds a buffer view of all bytes of a new buffer.
    pub fn add_view(&mut self, data: Vec<u8>) -> Index<json::buffer::View> {
        let byte_length = data.len().into();
        let buffer = self.add_buffer(data);
        self.root.push(json::buffer::View {
            buffer,
            byte_length,
            byte_offset: None,
            byte_stride: None,
            name: None,
            target: None,
            extensions: None,
            extras: Default::default(),
        })
    }

    /// Creates an error about one place in the file.
    pub fn error(&self, place: impl Into<String>, cause: impl Into<String>) -> LoadError {
        LoadError::at(&self.path, place, cause)
    }

    /// Returns the object at an index; `kind` names the array.
    pub fn get<T>(&self, index: Index<T>, place: &str, kind: &str) -> Result<&T, LoadError>
    where
        json::Root: Get<T>,
    {
        let missing = || self.error(place, format!("refers to {kind}[{}], which does not exist", index.value()));
        Get::get(&self.root, index).ok_or_else(missing)
    }

    /// Returns the bytes of a buffer view.
    pub fn view(&self, index: Index<json::buffer::View>, place: &str) -> Result<&[u8], LoadError> {
        let view = self.get(index, place, "bufferViews")?;
        let place = format!("bufferViews[{}]", index.value());
        self.slice(view.buffer, view.byte_offset.unwrap_or_default().0, view.byte_length.0, &place)
    }

    /// Returns some bytes of a buffer.
    pub fn slice(&self, index: Index<json::Buffer>, offset: u64, length: u64, place: &str) -> Result<&[u8], LoadError> {
        let buffer = self.get(index, place, "buffers")?;
        let data = self.buffers.get(index.value()).and_then(Option::as_deref);
        let data = data.ok_or_else(|| {
            let cause = "has neither a uri nor a binary chunk, but its data is needed";
            self.error(format!("buffers[{}]", index.value()), cause)
        })?;
        let end = offset.checked_add(length).filter(|&end| end <= buffer.byte_length.0);
        let end = end.ok_or_else(|| {
            let size = buffer.byte_length.0;
            self.error(place, format!("{length} bytes from {offset} do not fit into a buffer of {size} bytes"))
        })?;
        Ok(&data[offset as usize..end as usize])
    }

    /// Reads the bytes of a `data:` URI or of a relative path.
    pub fn fetch(&self, uri: &str, place: &str) -> Result<Vec<u8>, LoadError> {
        if let Some(rest) = uri.strip_prefix("data:") {
            let (head, body) =
                rest.split_once(',').ok_or_else(|| self.error(place, "the data URI has no comma before its data"))?;
            if !head.ends_with(";base64") {
                return Ok(percent_decoded(body));
            }
            let config = base64::engine::GeneralPurposeConfig::new()
                .with_decode_padding_mode(base64::engine::DecodePaddingMode::Indifferent)
                .with_decode_allow_trailing_bits(true);
            return base64::engine::GeneralPurpose::new(&base64::alphabet::STANDARD, config)
                .decode(percent_decoded(body))
                .map_err(|e| self.error(place, format!("the data URI is not valid base64: {e}")));
        }
        let path = self.local(uri, place)?;
        let bytes = self.files.read(&path);
        let failed = |e: LoadError| self.error(place, format!("refers to {}, which {}", path.display(), e.cause));
        bytes.map(Cow::into_owned).map_err(failed)
    }

    /// Returns the path of a file by its URI, of the file that is there if one is.
    pub fn local(&self, uri: &str, place: &str) -> Result<PathBuf, LoadError> {
        let name = String::from_utf8(percent_decoded(uri)).map_err(|_| self.error(place, "the uri is not UTF-8"))?;
        if name.contains("://") {
            return Err(self.error(place, format!("`{name}` is not a local file: download it and refer to the copy")));
        }
        let folder = self.path.parent().unwrap_or(Path::new(""));
        Ok(find(self.files, &[folder], &name).unwrap_or_else(|| folder.join(&name)))
    }

    /// True if a URI names a file that is not there.
    pub fn is_missing(&self, uri: &str) -> bool {
        !uri.starts_with("data:") && !self.local(uri, "").is_ok_and(|path| self.files.has(&path))
    }
}

fn percent_decoded(text: &str) -> Vec<u8> {
    percent_encoding::percent_decode_str(text).collect()
}

/// Parses the JSON; adds a scene's list of nodes and a channel's node if they are missing, since the parser
/// requires them.
fn parse(text: &[u8]) -> Result<json::Root, serde_json::Error> {
    json::Root::from_slice(text).or_else(|error| {
        let mut value: serde_json::Value = serde_json::from_slice(text)?;
        let mut patched = false;
        for scene in value.get_mut("scenes").and_then(|s| s.as_array_mut()).into_iter().flatten() {
            if let Some(scene) = scene.as_object_mut()
                && !scene.contains_key("nodes")
            {
                scene.insert("nodes".to_owned(), serde_json::Value::Array(Vec::new()));
                patched = true;
            }
        }
        for animation in value.get_mut("animations").and_then(|a| a.as_array_mut()).into_iter().flatten() {
            if let Some(channels) = animation.get_mut("channels").and_then(|c| c.as_array_mut()) {
                let count = channels.len();
                channels.retain(|channel| channel["target"].get("node").is_some());
                patched |= channels.len() < count;
            }
        }
        if patched { serde_json::from_value(value).map_err(|_| error) } else { Err(error) }
    })
}

/// True for glTF 1.0, which names the entries of its lists.
fn is_of_version_one(text: &[u8]) -> bool {
    let root: serde_json::Value = serde_json::from_slice(text).unwrap_or_default();
    root["meshes"].is_object() || root["asset"]["version"].as_str().is_some_and(|version| version.starts_with('1'))
}

/// Leaves textures without an image that refer to one that does not exist, as they are whose file is not there.
fn drop_dangling_images(root: &mut json::Root) {
    let images = root.images.len();
    let dangling = root.textures.iter_mut().filter(|texture| texture.source.value() >= images);
    dangling.for_each(|texture| texture.source = Index::new(super::NO_IMAGE));
}

/// Lets textures whose images have the same data refer to the first of these, so that it is decoded once.
fn share_images(root: &mut json::Root) {
    let mut first: HashMap<(Option<&str>, Option<usize>), u32> = HashMap::new();
    let shared: Vec<_> = root
        .images
        .iter()
        .zip(0..)
        .map(|(image, i)| *first.entry((image.uri.as_deref(), image.buffer_view.map(|v| v.value()))).or_insert(i))
        .collect();
    for texture in &mut root.textures {
        if let Some(&image) = shared.get(texture.source.value()) {
            texture.source = Index::new(image);
        }
    }
}

/// Reads the normal maps of materials.
fn parse_normal_maps(text: &[u8]) -> Result<HashMap<usize, NormalTexture>, serde_json::Error> {
    #[derive(Deserialize)]
    struct Root {
        #[serde(default)]
        materials: Vec<Material>,
    }
    #[derive(Deserialize)]
    #[serde(rename_all = "camelCase")]
    struct Material {
        normal_texture: Option<NormalTexture>,
    }
    let root: Root = serde_json::from_slice(text)?;
    let maps = root.materials.into_iter().map(|m| m.normal_texture);
    Ok(maps.enumerate().filter_map(|(i, map)| Some((i, map?))).collect())
}

/// JSON and binary chunk of a GLB.
type Chunks<'a> = (&'a [u8], Option<&'a [u8]>);

/// Splits a GLB into its chunks; an error holds place and cause.
fn split_glb(bytes: &[u8]) -> Result<Chunks<'_>, (String, String)> {
    let word = |at: usize| {
        let four = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
    };
    let fail = |at: usize, cause: String| Err((format!("byte {at}"), cause));
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return fail(bytes.len(), "truncated within the GLB header".to_owned());
    };
    if version != 2 {
        return fail(4, format!("GLB version {version} is not supported: convert the file to glTF 2.0"));
    }
    let length = length as usize;
    if length > bytes.len() || length < 12 {
        return fail(8, format!("the header says {length} bytes, the file has {}", bytes.len()));
    }
    let (mut json, mut bin) = (None, None);
    let mut at = 12;
    while at < length {
        let (Some(size), Some(kind)) = (word(at), bytes.get(at + 4..at + 8)) else {
            return fail(at, "truncated within a chunk header".to_owned());
        };
        let start = at + 8;
        let Some(end) = start.checked_add(size as usize).filter(|&end| end <= length) else {
            return fail(at, format!("a chunk of {size} bytes runs past the end of the file"));
        };
        match (kind, &json, &bin) {
            (b"JSON", None, None) => json = Some(&bytes[start..end]),
            (b"BIN\0", Some(_), None) => bin = Some(&bytes[start..end]),
            (b"JSON" | b"BIN\0", ..) => {
                return fail(at, "a chunk that is repeated or out of order".to_owned());
            }
            // Chunks of other kinds are to be ignored (glTF 2.0, 4.4.3), except as the first chunk.
            (_, None, _) => return fail(at, "the first chunk is not JSON".to_owned()),
            _ => {}
        }
        at = end;
    }
    match json {
        Some(json) => Ok((json, bin)),
        None => fail(12, "there is no JSON chunk".to_owned()),
    }
}
