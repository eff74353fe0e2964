//! Tests of the glTF loader with real files, malformed files, and small files made here.

use crate::common;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use base64::Engine as _;
use common::shared;
use glam::{Vec2, Vec3, Vec4};
use lightsheaf::scene::load::files::Disk;
use lightsheaf::scene::{self, Boundary, Bsdf, Geometry, Light, Opacity, Projection, Scalar, Scene, Sides};
use serde_json::{Value, json};

/// Time limit for one file.
const TIME_LIMIT: Duration = Duration::from_secs(5);

/// Returns the rows of a tab-separated table by column name.
fn table(path: &Path) -> Vec<std::collections::HashMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split('\t').collect();
    let row = |line: &str| head.iter().zip(line.split('\t')).map(|(k, v)| ((*k).to_owned(), v.to_owned())).collect();
    lines.map(row).collect()
}

/// Returns the extensions that a file requires and that the loader does not support.
fn unsupported(path: &Path) -> Vec<String> {
    let bytes = std::fs::read(path).unwrap_or_default();
    let text = if bytes.starts_with(b"glTF") && bytes.len() >= 20 {
        let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
        bytes.get(20..20 + length).unwrap_or_default()
    } else {
        &bytes
    };
    let value: Value = serde_json::from_slice(text).unwrap_or_default();
    let required = value["extensionsRequired"].as_array().cloned().unwrap_or_default();
    let names = required.iter().filter_map(|e| e.as_str());
    names.filter(|e| !scene::load::gltf::SUPPORTED.contains(e)).map(str::to_owned).collect()
}

pub fn load_in_time(path: &Path) -> Result<Scene, scene::LoadError> {
    let start = Instant::now();
    let result = scene::load(path.to_str().unwrap());
    assert!(start.elapsed() < TIME_LIMIT, "{} took {:?}", path.display(), start.elapsed());
    result
}

#[test]
fn real_files_load_with_their_triangles() {
    let Some(shared) = shared() else { return };
    let (mut loaded, mut rejected, mut wrong) = (0, 0, Vec::new());
    for row in table(&shared.join("scenes/MANIFEST.tsv")) {
        if !row["path"].starts_with("gltf/") {
            continue;
        }
        let path = shared.join("scenes").join(&row["path"]);
        let unsupported = unsupported(&path);
        match load_in_time(&path) {
            Ok(scene) => {
                loaded += 1;
                // The table counts each mesh once, independent of the number of nodes.
                let triangles: usize = scene.meshes.iter().map(|m| m.triangles.len()).sum();
                if !row["triangles"].is_empty() && row["triangles"] != triangles.to_string() {
                    wrong.push(format!("{}: {triangles} triangles instead of {}", row["path"], row["triangles"]));
                }
                if !unsupported.is_empty() {
                    wrong.push(format!("{}: loaded in spite of {unsupported:?}", row["path"]));
                }
                assert!(!Geometry::new(&scene).triangles.is_empty(), "{} is empty", row["path"]);
            }
            Err(error) => {
                rejected += 1;
                if !unsupported.iter().any(|e| error.to_string().contains(e)) {
                    wrong.push(format!("{}: {error}", row["path"]));
                }
            }
        }
    }
    println!("{loaded} loaded, {rejected} rejected");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(loaded >= 52 && rejected == 0, "the table has shrunk: {loaded} loaded, {rejected} rejected");
}

#[test]
fn wrong_files_are_errors_and_odd_ones_load() {
    let Some(shared) = shared() else { return };
    let (mut count, mut loaded, mut wrong) = ([0; 3], [0; 3], Vec::new());
    for row in table(&shared.join("invalid/MANIFEST.tsv")) {
        let path = shared.join("invalid").join(&row["path"]);
        let class = ["valid-edge", "warn", "invalid"].iter().position(|c| *c == row["class"]).unwrap();
        count[class] += 1;
        match load_in_time(&path) {
            Ok(scene) => {
                loaded[class] += 1;
                let _ = Geometry::new(&scene);
            }
            Err(error) => {
                let text = error.to_string();
                let name = path.file_name().unwrap().to_str().unwrap();
                if !text.contains(name) {
                    wrong.push(format!("{}: the error does not name the file: {text}", row["path"]));
                }
                let unsupported = unsupported(&path);
                let explained = unsupported.iter().any(|e| text.contains(e));
                if class == 0 && !explained {
                    wrong.push(text);
                }
            }
        }
    }
    println!("valid-edge, warn, invalid: loaded {loaded:?} of {count:?}");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count[0] > 100 && count[1] > 50 && count[2] > 200, "the table has shrunk: {count:?}");
    // Many of these only break rules that readers do not depend on, such as empty arrays or missing bounds.
    assert!(count[2] - loaded[2] >= 90, "wrong files load: {loaded:?} of {count:?}");
}

/// A file under construction: JSON, and one buffer that becomes a data URI or the binary chunk.
pub struct Draft {
    pub json: Value,
    pub data: Vec<u8>,
}

impl Draft {
    /// The file has one node with one mesh of one primitive; its arrays are empty.
    fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": {} }] }],
            "accessors": [],
            "bufferViews": [],
        });
        Self { json, data: Vec::new() }
    }

    /// Returns the triangle (0,0,0), (1,0,0), (0,1,0), which faces +Z.
    pub fn triangle() -> Self {
        let mut draft = Self::new();
        draft.attribute("POSITION", "VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        draft
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len() });
        self.data.extend(bytes);
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        self.push("bufferViews", view)
    }

    pub fn push(&mut self, array: &str, value: Value) -> usize {
        if self.json[array].is_null() {
            self.json[array] = json!([]);
        }
        let array = self.json[array].as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    pub fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let value = json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
        self.push("accessors", value)
    }

    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let lanes = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            _ => 16,
        };
        self.accessor(kind, 5126, values.len() / lanes, &bytes)
    }

    pub fn attribute(&mut self, name: &str, kind: &str, values: &[f32]) {
        let accessor = self.floats(kind, values);
        self.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    pub fn indices(&mut self, indices: &[u16]) {
        let bytes: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
        let accessor = self.accessor("SCALAR", 5123, indices.len(), &bytes);
        self.json["meshes"][0]["primitives"][0]["indices"] = json!(accessor);
    }

    pub fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn path(name: &str) -> PathBuf {
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
    }

    /// Writes the file as .gltf or .glb, by the name's extension.
    fn write(&self, name: &str) -> PathBuf {
        let path = Self::path(name);
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.data.len() }]);
        if name.ends_with(".glb") {
            let mut text = json.to_string().into_bytes();
            text.resize(text.len().next_multiple_of(4), b' ');
            let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
            let body = [chunk(b"JSON", &text), chunk(b"BIN\0", &self.data)].concat();
            let head = [&b"glTF"[..], &2_u32.to_le_bytes(), &(body.len() as u32 + 12).to_le_bytes()].concat();
            std::fs::write(&path, [head, body].concat()).unwrap();
        } else {
            let data = base64::engine::general_purpose::STANDARD.encode(&self.data);
            json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
            std::fs::write(&path, json.to_string()).unwrap();
        }
        path
    }

    pub fn load(&self, name: &str) -> Scene {
        load_in_time(&self.write(name)).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Loads a file that has to be refused, with an error that names the file, the place and the cause.
    pub fn refused(&self, name: &str, place: &str, cause: &str) {
        let error = load_in_time(&self.write(name)).expect_err(name).to_string();
        for part in [name, place, cause] {
            assert!(error.contains(part), "{error:?} does not say {part:?}");
        }
    }
}

pub fn warned(scene: &Scene, part: &str) -> bool {
    scene.warnings.iter().any(|w| w.contains(part))
}

#[test]
fn triangle_in_both_containers() {
    let draft = Draft::triangle();
    let [text, binary] = ["triangle.gltf", "triangle.glb"].map(|name| draft.load(name));
    assert_eq!(text.meshes, binary.meshes);
    assert_eq!(text.meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(text.meshes[0].triangles, [[0, 1, 2]]);
    assert!(text.meshes[0].normals.is_empty());
    assert_eq!(Geometry::new(&text).vertices[0].normal, Vec3::Z);
    // Avatars are GLB files of another name.
    let avatar = Draft::path("triangle.vrm");
    std::fs::copy(Draft::path("triangle.glb"), &avatar).unwrap();
    assert_eq!(load_in_time(&avatar).unwrap().meshes, binary.meshes);
}

#[test]
fn external_buffer_with_a_percent_encoded_name() {
    let mut draft = Draft::triangle();
    std::fs::write(Draft::path("a buffer%.bin"), &draft.data).unwrap();
    draft.json["buffers"] = json!([{ "byteLength": draft.data.len(), "uri": "a%20buffer%25.bin" }]);
    let path = Draft::path("external.gltf");
    std::fs::write(&path, draft.json.to_string()).unwrap();
    assert_eq!(load_in_time(&path).unwrap().meshes[0].positions[1], Vec3::X);

    draft.json["buffers"][0]["uri"] = json!("missing.bin");
    std::fs::write(&path, draft.json.to_string()).unwrap();
    let error = load_in_time(&path).unwrap_err().to_string();
    assert!(error.contains("buffers[0]") && error.contains("missing.bin"), "{error}");
}

/// As in viewers, what has lost its textures is shown without them. Images that are there and malformed are errors.
#[test]
fn missing_textures_are_left_out() {
    let mut draft = Draft::triangle();
    let material = json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 0, 1],
        "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 0 } },
        "normalTexture": { "index": 1 }, "emissiveTexture": { "index": 2 }, "emissiveFactor": [1, 1, 1] });
    draft.json["materials"] = json!([material]);
    draft.json["textures"] = json!([{ "source": 0 }, { "source": 1 }, { "source": 2 }]);
    let images = ["lost/wood%20grain.png", "https://example.org/normal.png", "glow.png"];
    draft.json["images"] = images.map(|uri| json!({ "uri": uri })).into();
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let mut png = Vec::new();
    let pixel = image::RgbImage::from_pixel(1, 1, image::Rgb([255; 3]));
    pixel.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
    std::fs::write(Draft::path("glow.png"), png).unwrap();
    let scene = draft.load("lost_textures.gltf");
    assert_eq!((scene.images.len(), scene.textures.len()), (1, 1), "the one that is there");
    let of = |text: &str| scene.warnings.iter().filter(|warning| warning.contains(text)).count();
    assert_eq!(images.map(of), [1, 1, 0], "{:?}", scene.warnings);
    std::fs::write(Draft::path("glow.png"), b"no image").unwrap();
    draft.refused("lost_textures.gltf", "glow.png", "");
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut draft = Draft::triangle();
    let indices = draft.view(&[2, 0]);
    let values = draft.view(&[0.0_f32, 5.0, 0.0].map(f32::to_le_bytes).concat());
    let sparse = json!({ "count": 1,
        "indices": { "bufferView": indices, "componentType": 5123 }, "values": { "bufferView": values } });
    draft.json["accessors"][0]["sparse"] = sparse.clone();
    assert_eq!(draft.load("sparse.gltf").meshes[0].positions, [Vec3::ZERO, Vec3::X, 5.0 * Vec3::Y]);

    // Without a buffer view the other values are zero.
    draft.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(draft.load("sparse_zero.gltf").meshes[0].positions, [Vec3::ZERO, Vec3::ZERO, 5.0 * Vec3::Y]);

    draft.json["accessors"][0]["count"] = json!(2);
    draft.refused("sparse_past.gltf", "accessors[0].sparse", "index 2 is past the 2 elements");
    draft.json["accessors"][0]["count"] = json!(4_000_000_000_u64);
    draft.refused("sparse_huge.gltf", "accessors[0]", "too many");
}

#[test]
fn interleaved_normalized_and_quantized_attributes() {
    let mut draft = Draft::new();
    // Each vertex has its position as three i16 and padding, and its uv as two normalized u16.
    let mut bytes = Vec::new();
    for (position, uv) in [([0, 0, -2], [0, 65535]), ([300, 0, -2], [65535, 0]), ([0, 300, -2], [13107, 0])] {
        bytes.extend(position.map(i16::to_le_bytes).concat());
        bytes.extend([0, 0]);
        bytes.extend(uv.map(u16::to_le_bytes).concat());
    }
    let view = draft.view(&bytes);
    draft.json["bufferViews"][view]["byteStride"] = json!(12);
    let positions = json!({ "bufferView": view, "componentType": 5122, "count": 3, "type": "VEC3" });
    let uvs = json!({ "bufferView": view, "byteOffset": 8, "componentType": 5123, "normalized": true, "count": 3, "type": "VEC2" });
    let (positions, uvs) = (draft.push("accessors", positions), draft.push("accessors", uvs));
    draft.primitive()["attributes"] = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
    draft.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    draft.json["nodes"][0]["scale"] = json!([0.01, 0.01, 0.01]);
    let scene = draft.load("quantized.gltf");
    let mesh = &scene.meshes[0];
    assert_eq!(mesh.positions[1], Vec3::new(300.0, 0.0, -2.0));
    assert_eq!(mesh.uvs[0], [Vec2::new(0.0, 1.0), Vec2::new(1.0, 0.0), Vec2::new(0.2, 0.0)]);
    assert!(Geometry::new(&scene).positions(0)[1].abs_diff_eq(Vec3::new(3.0, 0.0, -0.02), 1e-6));

    // -128 and -127 are both -1.
    let colors = draft.accessor("VEC4", 5120, 3, &[128, 129, 0, 127, 0, 0, 0, 0, 0, 0, 0, 0]);
    draft.json["accessors"][colors]["normalized"] = json!(true);
    draft.primitive()["attributes"]["COLOR_0"] = json!(colors);
    assert_eq!(draft.load("normalized.gltf").meshes[0].colors[0], Vec4::new(-1.0, -1.0, 0.0, 1.0));
}

#[test]
fn strips_and_fans_keep_their_winding() {
    let mut draft = Draft::new();
    draft.attribute("POSITION", "VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0., 0., 2., 0.]);
    draft.primitive()["mode"] = json!(5);
    let strip = draft.load("strip.gltf");
    assert_eq!(strip.meshes[0].triangles, [[0, 1, 2], [2, 1, 3], [2, 3, 4]]);
    assert!(Geometry::new(&strip).vertices.iter().all(|v| v.normal == Vec3::Z));

    draft.indices(&[0, 1, 3, 2]);
    draft.primitive()["mode"] = json!(6);
    let fan = draft.load("fan.gltf");
    assert_eq!(fan.meshes[0].triangles, [[1, 3, 0], [3, 2, 0]]);
    assert!(Geometry::new(&fan).vertices.iter().all(|v| v.normal == Vec3::Z));
}

/// Maps place tiles by the centre of the Earth.
#[test]
fn nodes_far_from_the_origin_are_moved_there() {
    let mut draft = Draft::triangle();
    let far = json!([4_000_000.0, 100.0, 4_900_000.0]);
    draft.json["nodes"] = json!([
        { "translation": far, "children": [1, 2] },
        { "mesh": 0, "translation": [0.125, 0, 0] },
        { "mesh": 0, "translation": [0, 0, 2.0625] },
    ]);
    draft.json["scenes"] = json!([{ "nodes": [0] }]);
    let scene = draft.load("far.gltf");
    let [a, b] = [0, 1].map(|i| Vec3::from(scene.instances[i].world_from_local.translation));
    assert_eq!(b - a, Vec3::new(-0.125, 0.0, 2.0625));
    assert!(
        a.length() < 2.0 && scene.notes.iter().any(|note| note.contains("far from the origin")),
        "{a}, {:?}",
        scene.notes
    );
}

#[test]
fn points_and_lines_are_drawn_where_there_is_nothing_else() {
    let mut draft = Draft::new();
    draft.attribute("POSITION", "VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0., 0., 2., 0.]);
    draft.indices(&[0, 1, 3, 2]);
    for (mode, triangles, said) in
        [(0, 4 * 320, "4 points"), (1, 24, "2 lines"), (2, 48, "4 lines"), (3, 36, "3 lines")]
    {
        draft.primitive()["mode"] = json!(mode);
        let scene = draft.load("strokes.gltf");
        assert_eq!(scene.meshes[0].triangles.len(), triangles, "mode {mode}");
        assert!(warned(&scene, said) && scene.instances.len() == 1, "{:?}", scene.warnings);
    }
    // Beside faces they are left out, and so are those that move.
    let stroke = draft.primitive().clone();
    let mut face = stroke.clone();
    face["mode"] = json!(4);
    draft.json["meshes"][0]["primitives"] = json!([stroke, face]);
    let faces = draft.load("faces.gltf");
    assert!(faces.meshes.len() == 1 && faces.meshes[0].triangles.len() == 1 && warned(&faces, "points and lines"));
    let mut moving = stroke.clone();
    moving["targets"] = json!([{ "POSITION": stroke["attributes"]["POSITION"] }]);
    draft.json["meshes"][0]["primitives"] = json!([moving]);
    let moving = draft.load("moving.gltf");
    assert!(moving.meshes.is_empty() && warned(&moving, "points and lines") && warned(&moving, "no surface"));
}

#[test]
fn negative_scale_keeps_the_front_in_front() {
    let mut draft = Draft::triangle();
    draft.attribute("NORMAL", "VEC3", &[0., 0., 1., 0., 0., 1., 0., 0., 1.]);
    draft.json["nodes"] = json!([{ "children": [1], "scale": [-1, 1, 1] }, { "mesh": 0, "translation": [2, 0, 0] }]);
    let geometry = Geometry::new(&draft.load("mirrored.gltf"));
    let [a, b, c] = geometry.positions(0);
    assert_eq!((b - a).cross(c - a).normalize(), Vec3::Z);
    assert!(geometry.vertices.iter().all(|v| v.normal == Vec3::Z));
    assert_eq!(geometry.bounds, [Vec3::new(-3.0, 0.0, 0.0), Vec3::new(-2.0, 1.0, 0.0)]);
}

#[test]
fn meshes_are_instanced_and_matrices_read_by_columns() {
    let mut draft = Draft::triangle();
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    draft.json["nodes"] =
        json!([{ "mesh": 0 }, { "mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1] }]);
    let scene = draft.load("instances.gltf");
    assert_eq!((scene.meshes.len(), scene.instances.len()), (1, 2));
    assert_eq!(
        Geometry::new(&scene).positions(1),
        [Vec3::new(7., 8., 9.), Vec3::new(7., 9., 9.), Vec3::new(6., 8., 9.)]
    );
}

#[test]
fn few_vertices_of_a_large_accessor() {
    let mut draft = Draft::new();
    let positions: Vec<f32> = (0..3000).map(|i| ((i * i) % 101) as f32).collect();
    draft.attribute("POSITION", "VEC3", &positions);
    draft.indices(&[999, 0, 500]);
    let mesh = &draft.load("few.gltf").meshes[0];
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert_eq!(mesh.positions[2], Vec3::from_slice(&positions[1500..]));
}

#[test]
fn skins_and_morph_targets_are_applied() {
    let mut draft = Draft::triangle();
    let target = draft.floats("VEC3", &[0., 0., 4., 0., 0., 0., 0., 0., 0.]);
    draft.primitive()["targets"] = json!([{ "POSITION": target }]);
    draft.json["meshes"][0]["weights"] = json!([0.25]);
    assert_eq!(draft.load("morph.gltf").meshes[0].positions[0], Vec3::Z);
    draft.json["nodes"][0]["weights"] = json!([0.5]);
    assert_eq!(draft.load("morph_node.gltf").meshes[0].positions[0], 2.0 * Vec3::Z);

    let joints = draft.accessor("VEC4", 5121, 3, &[0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]);
    draft.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    draft.attribute("WEIGHTS_0", "VEC4", &[0.5, 0.5, 0., 0., 1., 0., 0., 0., 1., 0., 0., 0.]);
    let mut bind = [0.0; 32];
    [0, 5, 10, 15, 16, 21, 26, 31].iter().for_each(|&i| bind[i] = 1.0);
    bind[28] = 1.0; // the second joint's inverse bind matrix moves by +X
    let bind = draft.floats("MAT4", &bind);
    draft.json["skins"] = json!([{ "joints": [1, 2], "inverseBindMatrices": bind }]);
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    draft.json["nodes"] = json!([
        { "mesh": 0, "skin": 0, "translation": [100, 0, 0] },
        { "translation": [0, 10, 0], "children": [2] },
        { "translation": [0, 20, 0] },
    ]);
    let scene = draft.load("skin.gltf");
    let expected = [Vec3::new(0.5, 20.0, 1.0), Vec3::new(1.0, 10.0, 0.0), Vec3::new(1.0, 31.0, 0.0)];
    assert_eq!(Geometry::new(&scene).positions(0), expected);

    draft.json["skins"][0]["joints"] = json!([1]);
    draft.refused("skin_joint.gltf", "accessors[", "follows joint 1 of 1");
}

/// Returns a grey picture of one pixel.
fn bmp() -> Vec<u8> {
    let mut bmp = b"BM\x3a\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\x01\0\0\0\x01\0\0\0\x01\0\x18\0".to_vec();
    bmp.resize(0x36, 0);
    bmp.extend([128, 128, 128, 0]);
    bmp
}

/// Blended materials with an alpha of 1 everywhere are opaque, and those without any alpha between 0 and 1
/// are cut out.
#[test]
fn blending_that_nothing_shows_costs_nothing() {
    let mut draft = Draft::triangle();
    draft.attribute("TEXCOORD_0", "VEC2", &[0., 0., 1., 0., 0., 1.]);
    let view = draft.view(&bmp());
    draft.json["images"] = json!([{ "bufferView": view, "mimeType": "image/bmp" }]);
    draft.json["samplers"] = json!([{ "magFilter": 9728 }]);
    draft.json["textures"] = json!([{ "source": 0, "sampler": 0 }]);
    draft.primitive()["material"] = json!(0);
    let of = |draft: &mut Draft, alpha: f32, textured: bool| {
        let mut pbr = json!({ "baseColorFactor": [1, 1, 1, alpha] });
        if textured {
            pbr["baseColorTexture"] = json!({ "index": 0 });
        }
        draft.json["materials"] = json!([{ "pbrMetallicRoughness": pbr, "alphaMode": "BLEND" }]);
        let scene = draft.load("blending.gltf");
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        scene.materials[0].opacity
    };
    // The image has no alpha, which counts as 1.
    for textured in [false, true] {
        assert_eq!(of(&mut draft, 1.0, textured), None);
        assert!(of(&mut draft, 0.5, textured).unwrap().is_blended());
    }
    assert_eq!(of(&mut draft, 0.0, false), Some(Opacity::CutOut { value: 0.0.into(), cutoff: 0.5 }));
    // Vertices with an alpha of their own blend what is opaque otherwise.
    draft.attribute("COLOR_0", "VEC4", &[1.0; 12]);
    assert_eq!(of(&mut draft, 1.0, true), None);
    draft.attribute("COLOR_0", "VEC4", &[1.0, 1.0, 1.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    assert!(of(&mut draft, 1.0, true).unwrap().is_blended());
}

#[test]
fn materials_say_what_the_file_says() {
    let mut draft = Draft::triangle();
    draft.attribute("TEXCOORD_0", "VEC2", &[0., 0., 1., 0., 0., 1.]);
    let view = draft.view(&bmp());
    draft.json["images"] = json!([{ "bufferView": view, "mimeType": "image/bmp" }]);
    draft.json["samplers"] = json!([{ "magFilter": 9728, "wrapS": 33071, "wrapT": 33648 }]);
    draft.json["textures"] = json!([{ "source": 0, "sampler": 0 }]);
    draft.primitive()["material"] = json!(0);
    let transform = json!({ "KHR_texture_transform": { "offset": [0.5, 0.25], "rotation": std::f32::consts::FRAC_PI_2, "scale": [2, 4] } });
    draft.json["materials"] = json!([{
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.1, 0.2, 0.3, 0.9], "metallicFactor": 0.5, "roughnessFactor": 0.25,
            "baseColorTexture": { "index": 0, "extensions": transform },
        },
        "normalTexture": { "index": 0, "scale": 0.5, "extensions": transform },
        "emissiveFactor": [1, 0.5, 0], "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
        "extensions": {
            "KHR_materials_emissive_strength": { "emissiveStrength": 10 }, "KHR_materials_ior": { "ior": 1.8 },
            "KHR_materials_specular": { "specularFactor": 0.7, "specularColorFactor": [1, 2, 3] },
        },
    }]);
    let scene = draft.load("material.gltf");
    assert!(scene.cameras.is_empty() && scene.lights.is_empty() && scene.environment.is_none());
    let material = &scene.materials[0];
    assert_eq!(material.emission.unwrap().radiance.factor, Vec3::new(10.0, 5.0, 0.0));
    assert_eq!(material.sides, Sides::Two);
    assert!(matches!(material.opacity, Some(Opacity::CutOut { cutoff: 0.3, value }) if value.texture.unwrap().1 == 3));
    let Bsdf::MetallicRoughness { base_color, metallic, roughness, ior, specular, specular_color, .. } = material.bsdf
    else {
        panic!("{:?}", material.bsdf);
    };
    assert_eq!((metallic.factor, roughness.factor, ior, specular.factor), (0.5, 0.25, 1.8, 0.7));
    assert_eq!(specular_color.factor, Vec3::new(1.0, 2.0, 3.0));
    let texture = base_color.texture.unwrap();
    // KHR_texture_transform gives u' = 2 u cos + 4 v sin + 0.5, v' = -2 u sin + 4 v cos + 0.25.
    assert!(texture.apply([Vec2::new(0.1, 0.2); 2]).abs_diff_eq(Vec2::new(1.3, 0.05), 1e-6));
    assert_eq!(material.normal_map.unwrap().texture.transform, texture.transform);
    assert_eq!(scene.textures.len(), 2, "colours are sRGB, normals are not");
    assert_eq!(scene.images.len(), 1);
    let sampler = &scene.textures[texture.texture];
    assert_eq!(sampler.wrap, [scene::Wrap::Clamp, scene::Wrap::Mirror]);
    assert_eq!((sampler.filter, sampler.srgb), (scene::Filter::Nearest, true));
    assert_eq!(scene.meshes[0].tangents.len(), 3);

    // A dielectric without reflection is Lambertian, unlit materials emit, and blending keeps alpha.
    draft.json["materials"] = json!([
        { "pbrMetallicRoughness": { "metallicFactor": 0 }, "extensions": { "KHR_materials_specular": { "specularFactor": 0 } } },
        { "pbrMetallicRoughness": { "baseColorFactor": [1, 0, 0, 0.7] }, "alphaMode": "BLEND", "extensions": { "KHR_materials_unlit": {} } },
    ]);
    draft.json["extensionsUsed"] = json!(["KHR_materials_unlit", "KHR_materials_hair"]);
    let scene = draft.load("special.gltf");
    assert!(matches!(scene.materials[0].bsdf, Bsdf::Diffuse { .. }));
    assert_eq!(scene.materials[1].emission.unwrap().radiance.factor, Vec3::X);
    assert_eq!(scene.materials[1].opacity, Some(Opacity::Blended { value: 0.7.into() }));
    for part in ["unlit", "KHR_materials_hair is not supported"] {
        assert!(warned(&scene, part), "{:?} lacks {part}", scene.warnings);
    }
    assert!(!warned(&scene, "KHR_materials_unlit is not supported"));

    let offset = draft.json["bufferViews"][view]["byteOffset"].as_u64().unwrap();
    draft.data[offset as usize] = 0;
    draft.json["materials"][0]["emissiveTexture"] = json!({ "index": 0 });
    draft.refused("image.gltf", "images[0]", "the image");
}

#[test]
fn layers_are_read() {
    let mut draft = Draft::triangle();
    draft.primitive()["material"] = json!(0);
    let view = draft.view(&bmp());
    draft.json["images"] = json!([{ "bufferView": view, "mimeType": "image/bmp" }]);
    draft.json["textures"] = json!([{ "source": 0 }]);
    let transform = json!({ "KHR_texture_transform": { "offset": [0.5, 0.25] } });
    draft.json["materials"] = json!([{ "extensions": { "KHR_materials_clearcoat": {
        "clearcoatFactor": 0.5, "clearcoatTexture": { "index": 0 },
        "clearcoatRoughnessFactor": 2.0, "clearcoatRoughnessTexture": { "index": 0, "texCoord": 1 },
        "clearcoatNormalTexture": { "index": 0, "scale": 0.5, "extensions": transform },
    } } }]);
    draft.json["extensionsUsed"] = json!(["KHR_materials_clearcoat"]);
    let scene = draft.load("coat.gltf");
    let coat = scene.materials[0].coat.unwrap();
    assert_eq!((coat.weight.factor, coat.roughness.factor), (0.5, 1.0));
    let channel = |value: Scalar| value.texture.map(|(texture, channel)| (texture.uv_set, channel));
    assert_eq!((channel(coat.weight), channel(coat.roughness)), (Some((0, 0)), Some((1, 1))));
    let map = coat.normal_map.unwrap();
    assert_eq!((map.scale, map.texture.transform.translation), (0.5, Vec2::new(0.5, 0.25)));
    assert!(warned(&scene, "clearcoatRoughnessFactor: a value of 2"), "{:?}", scene.warnings);
    assert!(!warned(&scene, "not supported"), "{:?}", scene.warnings);

    draft.json["materials"][0]["extensions"]["KHR_materials_sheen"] = json!({
        "sheenColorFactor": [0.1, 0.2, 0.3], "sheenColorTexture": { "index": 0 },
        "sheenRoughnessFactor": 0.5, "sheenRoughnessTexture": { "index": 0 },
    });
    let scene = draft.load("sheen.gltf");
    let sheen = scene.materials[0].sheen.unwrap();
    assert_eq!((sheen.color.factor, sheen.roughness.factor), (Vec3::new(0.1, 0.2, 0.3), 0.5));
    assert!(scene.textures[sheen.color.texture.unwrap().texture].srgb);
    assert_eq!(channel(sheen.roughness), Some((0, 3)));

    draft.json["materials"][0]["extensions"]["KHR_materials_iridescence"] = json!({
        "iridescenceFactor": 0.7, "iridescenceThicknessMaximum": 500, "iridescenceThicknessTexture": { "index": 0 },
    });
    let film = draft.load("film.gltf").materials[0].film.unwrap();
    assert_eq!((film.strength.factor, film.ior, film.thickness), (0.7, 1.3, [100.0, 500.0]));
    assert_eq!(film.thickness_texture.map(|(_, channel)| channel), Some(1));
    draft.json["materials"][0]["extensions"]["KHR_materials_anisotropy"] =
        json!({ "anisotropyStrength": 0.6, "anisotropyRotation": 1.5, "anisotropyTexture": { "index": 0 } });
    let anisotropy = draft.load("brushed.gltf").materials[0].anisotropy.unwrap();
    assert_eq!((anisotropy.strength, anisotropy.rotation, anisotropy.texture.is_some()), (0.6, 1.5, true));

    draft.json["materials"][0]["extensions"]["KHR_materials_diffuse_transmission"] = json!({
        "diffuseTransmissionFactor": 0.4, "diffuseTransmissionTexture": { "index": 0 },
        "diffuseTransmissionColorFactor": [0.5, 0.6, 0.7], "diffuseTransmissionColorTexture": { "index": 0 },
    });
    let scene = draft.load("leaf.gltf");
    let leaf = &scene.materials[0];
    let passing = leaf.diffuse_transmission.unwrap();
    assert_eq!((passing.share.factor, channel(passing.share)), (0.4, Some((0, 3))));
    assert_eq!(passing.color.factor, Vec3::new(0.5, 0.6, 0.7));
    assert!(scene.textures[passing.color.texture.unwrap().texture].srgb);
    assert!(leaf.transmits() && !leaf.bsdf.transmits() && leaf.sides == Sides::Two);
    assert!(!warned(&scene, "not supported"), "{:?}", scene.warnings);

    // A coat without weight is none.
    draft.json["materials"][0]["extensions"]["KHR_materials_clearcoat"]["clearcoatFactor"] = json!(0);
    assert_eq!(draft.load("no_coat.gltf").materials[0].coat, None);
    draft.json["materials"][0]["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"]["index"] = json!(7);
    draft.refused("dangling.gltf", "KHR_materials_clearcoat", "textures[7]");
    draft.json["materials"][0]["extensions"]["KHR_materials_clearcoat"] = json!({ "clearcoatFactor": "much" });
    draft.refused("text.gltf", "materials[0].KHR_materials_clearcoat", "invalid type");
}

#[test]
fn specular_and_glossiness_are_converted() {
    let mut draft = Draft::triangle();
    draft.primitive()["material"] = json!(0);
    let pbr = |textures: bool| {
        let mut pbr = json!({
            "diffuseFactor": [0.1, 0.2, 0.3, 0.5], "specularFactor": [0.9, 0.5, 0.2], "glossinessFactor": 0.75,
        });
        if textures {
            pbr["diffuseTexture"] = json!({ "index": 0 });
            pbr["specularGlossinessTexture"] = json!({ "index": 0 });
        }
        let extensions = json!({ "KHR_materials_pbrSpecularGlossiness": pbr });
        json!([{ "pbrMetallicRoughness": { "metallicFactor": 1 }, "alphaMode": "BLEND", "extensions": extensions }])
    };
    draft.json["extensionsUsed"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
    draft.json["materials"] = pbr(false);
    let scene = draft.load("gloss.gltf");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let Bsdf::MetallicRoughness { base_color, metallic, roughness, ior, specular, specular_color, .. } =
        scene.materials[0].bsdf
    else {
        panic!("{:?}", scene.materials[0].bsdf);
    };
    assert_eq!((base_color.factor, metallic.factor, roughness.factor), (Vec3::new(0.1, 0.2, 0.3), 0.0, 0.25));
    // The reflectance at normal incidence is ((ior - 1) / (ior + 1))^2 times the colour.
    assert_eq!((ior, specular.factor, specular_color.factor), (0.0, 1.0, Vec3::new(0.9, 0.5, 0.2)));
    assert_eq!(scene.materials[0].opacity, Some(Opacity::Blended { value: 0.5.into() }));

    // The image has no alpha, so that its glossiness is 1: the roughness is 1 - 0.75.
    let view = draft.view(&bmp());
    draft.attribute("TEXCOORD_0", "VEC2", &[0., 0., 1., 0., 0., 1.]);
    draft.json["images"] = json!([{ "bufferView": view, "mimeType": "image/bmp" }]);
    draft.json["textures"] = json!([{ "source": 0 }]);
    draft.json["materials"] = pbr(true);
    let scene = draft.load("glossy_texture.gltf");
    let Bsdf::MetallicRoughness { roughness, specular_color, .. } = scene.materials[0].bsdf else { unreachable!() };
    let (texture, channel) = roughness.texture.unwrap();
    assert_eq!((roughness.factor, channel), (1.0, 3));
    let image = |texture: usize| &scene.images[scene.textures[texture].image];
    assert_eq!(image(texture.texture).texels[0], [128, 128, 128, 64]);
    assert_eq!(image(specular_color.texture.unwrap().texture).texels[0], [128, 128, 128, 255]);
}

#[test]
fn variants_pick_materials_by_name() {
    let mut draft = Draft::triangle();
    draft.primitive()["material"] = json!(0);
    draft.json["materials"] = json!([{ "name": "plain" }, { "name": "red" }]);
    draft.json["extensionsUsed"] = json!(["KHR_materials_variants"]);
    draft.json["extensions"] =
        json!({ "KHR_materials_variants": { "variants": [{ "name": "day" }, { "name": "dusk" }] } });
    let mappings = json!([{ "material": 1, "variants": [1] }]);
    draft.primitive()["extensions"] = json!({ "KHR_materials_variants": { "mappings": mappings } });
    let path = draft.write("variants.gltf");
    let material = |name: Option<&str>| {
        let scene = scene::load::gltf::load(&path, name, &Disk).unwrap();
        assert_eq!(scene.notes.iter().any(|note| note.contains("`day`, `dusk`")), name.is_none(), "{:?}", scene.notes);
        scene.materials[scene.meshes[0].material].name.clone()
    };
    assert_eq!(material(None), "plain");
    assert_eq!(material(Some("day")), "plain", "a variant without a mapping leaves the material");
    assert_eq!(material(Some("dusk")), "red");
    let error = |path: &Path| scene::load_with(path.to_str().unwrap(), Some("night"), &Default::default()).unwrap_err();
    assert!(error(&path).to_string().contains("no variant `night`: the file has `day`, `dusk`"), "{}", error(&path));
    let box_error = error(Path::new("builtin:cornell_point"));
    assert!(box_error.to_string().contains("no variant `night`"), "{box_error}");
    draft.primitive()["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] = json!(9);
    let path = draft.write("dangling_variant.gltf");
    let dangling = scene::load::gltf::load(&path, Some("dusk"), &Disk).unwrap_err();
    assert!(dangling.to_string().contains("materials[9]"), "{dangling}");
}

#[test]
fn transmission_and_volumes_are_read() {
    let mut draft = Draft::triangle();
    draft.primitive()["material"] = json!(0);
    draft.json["extensionsUsed"] = json!(["KHR_materials_transmission", "KHR_materials_volume"]);
    draft.json["extensionsRequired"] = json!(["KHR_materials_transmission", "KHR_materials_volume"]);
    let glass =
        |extensions: Value| json!([{ "pbrMetallicRoughness": { "metallicFactor": 0 }, "extensions": extensions }]);
    let transmission = json!({ "transmissionFactor": 0.8, "transmissionTexture": { "index": 0 } });
    let mut volume = json!({ "thicknessFactor": 0.1, "attenuationDistance": 0.5, "attenuationColor": [0.25, 0.5, 1] });
    let all = |volume: &Value| {
        glass(json!({ "KHR_materials_transmission": transmission, "KHR_materials_volume": volume,
                      "KHR_materials_ior": { "ior": 1.33 } }))
    };
    let view = draft.view(&bmp());
    draft.json["images"] = json!([{ "bufferView": view, "mimeType": "image/bmp" }]);
    draft.json["textures"] = json!([{ "source": 0 }]);
    draft.json["materials"] = all(&volume);
    let scene = draft.load("volume.gltf");
    let material = &scene.materials[0];
    let Bsdf::MetallicRoughness { transmission: share, ior, .. } = material.bsdf else { panic!("{material:?}") };
    let (texture, channel) = share.texture.expect("a texture");
    assert_eq!((share.factor, channel, ior, scene.textures[texture.texture].srgb), (0.8, 0, 1.33, false));
    assert!(material.bsdf.transmits() && material.sides == Sides::Two);
    // White turns into the colour over the distance.
    let Boundary::Volume { absorption } = material.boundary else { panic!("{material:?}") };
    assert!((-absorption * 0.5).exp().abs_diff_eq(Vec3::new(0.25, 0.5, 1.0), 1e-6), "{absorption}");
    for part in ["KHR_materials_transmission", "KHR_materials_volume"] {
        assert!(!warned(&scene, part), "{:?}", scene.warnings);
    }

    volume["thicknessTexture"] = json!({ "index": 0 });
    volume["attenuationColor"] = json!([0, 1, 1]);
    draft.json["materials"] = all(&volume);
    let scene = draft.load("thickness.gltf");
    assert!(warned(&scene, "thickness textures"), "{:?}", scene.warnings);
    let Boundary::Volume { absorption } = scene.materials[0].boundary else { panic!("a volume") };
    assert!(absorption.is_finite() && absorption.x > 100.0 && absorption.y == 0.0, "{absorption}");

    volume["attenuationDistance"] = json!(0);
    draft.json["materials"] = all(&volume);
    draft.refused("attenuation.gltf", "materials[0]", "attenuationDistance");
    // Without thickness, or without the extension, the surface is a sheet.
    for volume in [json!({ "attenuationDistance": 1 }), json!({ "thicknessFactor": 0 })] {
        draft.json["materials"] = all(&volume);
        assert_eq!(draft.load("sheet.gltf").materials[0].boundary, Boundary::Sheet);
    }
    draft.json["materials"] = glass(json!({ "KHR_materials_transmission": transmission }));
    let scene = draft.load("thin.gltf");
    assert!(scene.materials[0].boundary == Boundary::Sheet && scene.materials[0].bsdf.transmits());
    draft.json["materials"] = glass(json!({}));
    assert!(!draft.load("opaque.gltf").materials[0].bsdf.transmits());
}

#[test]
fn dispersion_is_read() {
    let mut draft = Draft::triangle();
    draft.primitive()["material"] = json!(0);
    draft.json["extensionsUsed"] = json!(["KHR_materials_transmission", "KHR_materials_dispersion"]);
    draft.json["extensionsRequired"] = draft.json["extensionsUsed"].clone();
    let volume = json!({ "thicknessFactor": 0.1 });
    let glass = |ior: f32, dispersion: Value, volume: &Value| {
        json!([{ "pbrMetallicRoughness": { "metallicFactor": 0 }, "extensions": {
            "KHR_materials_transmission": { "transmissionFactor": 1 }, "KHR_materials_volume": volume,
            "KHR_materials_ior": { "ior": ior }, "KHR_materials_dispersion": { "dispersion": dispersion } } }])
    };
    let mut load = |materials: Value| {
        draft.json["materials"] = materials;
        draft.load("dispersion.gltf")
    };
    // Half of the spread is 0.025 (n - 1) dispersion.
    let scene = load(glass(1.6, json!(2), &volume));
    let [red, green, blue] = scene.materials[0].iors().unwrap();
    assert!((red - 1.57).abs() < 1e-6 && green == 1.6 && (blue - 1.63).abs() < 1e-6, "{red} {green} {blue}");
    assert!(!warned(&scene, "ispersion"), "{:?}", scene.warnings);
    // An index is at least 1.
    assert_eq!(load(glass(1.5, json!(80), &volume)).materials[0].iors(), Some([1.0, 1.5, 2.5]));
    assert_eq!(load(glass(1.5, json!(0), &volume)).materials[0].iors(), None);
    for (ior, volume) in [(1.5, json!({ "thicknessFactor": 0 })), (1.0, volume.clone()), (0.0, volume.clone())] {
        let scene = load(glass(ior, json!(1), &volume));
        assert_eq!(scene.materials[0].iors(), None);
        assert!(warned(&scene, "materials[0] has a dispersion, but"), "{:?}", scene.warnings);
    }
    for (name, dispersion, part) in [
        ("negative", json!(-0.5), "-0.5"),
        ("endless", json!(1e30), "out of range"),
        ("text", json!("much"), "invalid"),
    ] {
        draft.json["materials"] = glass(1.5, dispersion, &volume);
        draft.refused(&format!("{name}_dispersion.gltf"), "materials[0].KHR_materials_dispersion", part);
    }
}

#[test]
fn cameras_and_lights_stand_where_their_nodes_stand() {
    let mut draft = Draft::triangle();
    draft.json["cameras"] = json!([
        { "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } },
        { "type": "orthographic", "orthographic": { "xmag": 2, "ymag": 3, "znear": 0, "zfar": 1 } },
    ]);
    draft.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "color": [1, 0.5, 0.25], "intensity": 8, "range": 3 },
        { "type": "directional", "intensity": 3 },
        { "type": "spot", "intensity": 2, "spot": { "outerConeAngle": 0.6 } },
    ] } });
    draft.json["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    let light = |i: u32| json!({ "KHR_lights_punctual": { "light": i } });
    // A quarter turn about Y takes -Z to -X.
    let turn = json!([0.0, 0.5_f32.sqrt(), 0.0, 0.5_f32.sqrt()]);
    draft.json["nodes"] = json!([
        { "mesh": 0 },
        { "camera": 0, "rotation": turn, "scale": [2, 3, -4], "extensions": light(1), "name": "eye" },
        { "camera": 1, "translation": [0, 0, 5], "extensions": light(0) },
        { "rotation": turn, "translation": [1, 2, 3], "extensions": light(2) },
    ]);
    let scene = draft.load("lights.gltf");
    assert!(warned(&scene, "range"), "{:?}", scene.warnings);
    assert_eq!(scene.cameras[0].name, "eye");
    assert_eq!(scene.cameras[0].projection, Projection::Perspective { fov: 0.5, axis: scene::FovAxis::Y });
    // Scales and mirrorings are removed; the view rotates with its axis.
    let matrix = scene.cameras[0].world_from_camera.matrix3;
    assert!((matrix.determinant() - 1.0).abs() < 1e-5);
    assert!(Vec3::from(-matrix.z_axis).abs_diff_eq(Vec3::X, 1e-5), "{matrix}");
    assert_eq!(scene.cameras[1].projection, Projection::Orthographic { half_extent: Vec2::new(2.0, 3.0) });
    assert_eq!(scene.lights[1], Light::Point { position: Vec3::new(0., 0., 5.), intensity: Vec3::new(8., 4., 2.) });
    let Light::Spot { position, direction, outer_angle, falloff, .. } = scene.lights[2] else { panic!() };
    assert_eq!((position, outer_angle, falloff), (Vec3::new(1., 2., 3.), 0.6, scene::SpotFalloff::CosineSquared));
    assert!(direction.abs_diff_eq(-Vec3::X, 1e-5), "{direction}");
}

#[test]
fn lights_have_a_size_by_their_extras() {
    let mut draft = Draft::triangle();
    let spot = json!({ "outerConeAngle": 0.6 });
    draft.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "intensity": 8, "extras": { "radius": 0.25, "note": "ours" } },
        { "type": "directional", "intensity": 3, "extras": { "angle": 4 } },
        { "type": "spot", "intensity": 2, "spot": spot, "extras": { "radius": 1 } },
        { "type": "point", "extras": ["radius"] },
        { "type": "point", "extras": { "radius": "large" } },
        { "type": "directional", "extras": { "angle": 181 } },
        { "type": "spot", "spot": spot, "extras": { "radius": -1 } },
    ] } });
    draft.json["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4, 5, 6]);
    let node = |i: u32| json!({ "translation": [1, 2, 3], "extensions": { "KHR_lights_punctual": { "light": i } } });
    draft.json["nodes"] = (0..7).map(node).collect();
    let scene = draft.load("sizes.gltf");
    let lamp = scene::Lamp {
        position: Vec3::new(1.0, 2.0, 3.0),
        world_from_lamp: glam::Mat3::IDENTITY,
        radius: 0.25,
        intensity: Vec3::splat(8.0),
        cone: None,
        pattern: None,
    };
    assert_eq!(scene.lights[0], Light::Lamp(lamp));
    let angle = 2.0_f32.to_radians();
    let sun = Light::Sun { direction: Vec3::NEG_Z, irradiance: Vec3::splat(3.0), angle, of_sky: false };
    assert_eq!(scene.lights[1], sun);
    let Light::Lamp(spot) = scene.lights[2] else { panic!() };
    let cone = scene::Cone { inner_angle: 0.0, outer_angle: 0.6, falloff: scene::SpotFalloff::CosineSquared };
    assert_eq!((spot.radius, spot.cone, spot.direction()), (1.0, Some(cone), Vec3::NEG_Z));
    // An invalid size gives a warning; other extras do not.
    assert!(matches!(scene.lights[3], Light::Point { .. }) && matches!(scene.lights[4], Light::Point { .. }));
    assert!(matches!(scene.lights[5], Light::Directional { .. }) && matches!(scene.lights[6], Light::Spot { .. }));
    assert_eq!(scene.warnings.iter().filter(|w| w.contains("extras")).count(), 3, "{:?}", scene.warnings);
}

#[test]
fn light_profiles_become_patterns() {
    let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 2 3 2 1 2 0 0 0\n1 1 60\n0 90 180\n0 90\n100 50 0\n 100 25 0\n";
    let draft = |change: &dyn Fn(&mut Value)| {
        let mut draft = Draft::triangle();
        let encoded = format!("data:application/octet-stream,{}", ies.replace('\n', "%0A").replace(' ', "%20"));
        draft.json["extensionsUsed"] = json!(["EXT_lights_ies"]);
        draft.json["extensions"] = json!({ "EXT_lights_ies": { "lights": [{ "uri": encoded }] } });
        let used = json!({ "light": 0, "multiplier": 0.5, "color": [1, 0.5, 2] });
        // After half a turn about X the lamp emits along +Z.
        draft.json["nodes"] = json!([
            { "mesh": 0 },
            { "rotation": [1, 0, 0, 0], "scale": [5, 5, 5], "extensions": { "EXT_lights_ies": used } },
            { "extensions": { "EXT_lights_ies": { "light": 0 } } },
        ]);
        draft.json["scenes"][0]["nodes"] = json!([0, 1, 2]);
        change(&mut draft.json);
        draft
    };
    let scene = draft(&|_| ()).load("profile.gltf");
    assert!(!warned(&scene, "EXT_lights_ies"), "{:?}", scene.warnings);
    let [Light::Lamp(turned), Light::Lamp(plain)] = scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert_eq!((scene.patterns.len(), turned.pattern, plain.pattern), (1, Some(0), Some(0)));
    assert!(turned.direction().abs_diff_eq(Vec3::Z, 1e-6) && plain.direction() == Vec3::NEG_Z);
    assert_eq!((turned.intensity, plain.intensity), (Vec3::new(100.0, 50.0, 100.0), Vec3::splat(200.0)));
    let pattern = &scene.patterns[0];
    assert_eq!((pattern.mapping, pattern.width, pattern.height), (scene::Mapping::Sphere, 360, 361));
    assert_eq!([0, 90].map(|column| pattern.texels[180 * 360 + column][0]), [0.5, 0.25]);

    draft(&|json| json["nodes"][2]["extensions"]["EXT_lights_ies"]["light"] = json!(7)).refused(
        "profile_index.gltf",
        "nodes[2]",
        "lights[7], which does not exist",
    );
    draft(&|json| json["nodes"][2]["extensions"]["EXT_lights_ies"]["multiplier"] = json!(-1)).refused(
        "profile_multiplier.gltf",
        "nodes[2]",
        "multiplier",
    );
    draft(&|json| json["extensions"]["EXT_lights_ies"]["lights"][0] = json!({})).refused(
        "profile_empty.gltf",
        "EXT_lights_ies.lights[0]",
        "neither a uri nor a bufferView",
    );
    draft(&|json| json["extensions"]["EXT_lights_ies"]["lights"][0]["uri"] = json!("data:,TILT=NONE%0A1")).refused(
        "profile_short.gltf",
        "line 2",
        "the file ends before",
    );
}

#[test]
fn planted_errors_are_found() {
    let edit = |change: &dyn Fn(&mut Draft)| {
        let mut draft = Draft::triangle();
        change(&mut draft);
        draft
    };
    let nan = edit(&|d| d.data[20..24].copy_from_slice(&f32::NAN.to_le_bytes()));
    nan.refused("nan.gltf", "mesh 0 `meshes[0].primitives[0]`", "vertex 1 is not finite");
    let far = edit(&|d| d.json["nodes"][0]["scale"] = json!([3e38, 1, 1]));
    far.load("far.gltf");
    let farther = edit(&|d| {
        d.json["nodes"] = json!([{ "scale": [3e38, 1, 1], "children": [1] }, { "mesh": 0, "scale": [10, 1, 1] }])
    });
    farther.refused("farther.gltf", "nodes[1]", "not finite");
    edit(&|d| d.indices(&[0, 1, 3])).refused(
        "index.gltf",
        "accessors[1]",
        "index 3 at position 2 is past the 3 vertices",
    );
    edit(&|d| d.json["accessors"][0]["count"] = json!(4)).refused("count.gltf", "accessors[0]", "do not fit");
    edit(&|d| d.json["accessors"][0]["count"] = json!(u64::MAX)).refused("huge.gltf", "accessors[0]", "do not fit");
    edit(&|d| d.json["accessors"][0]["byteOffset"] = json!(u64::MAX)).refused(
        "offset.gltf",
        "accessors[0]",
        "do not fit",
    );
    edit(&|d| d.json["accessors"][0]["type"] = json!("VEC2")).refused(
        "type.gltf",
        "accessors[0]",
        "numbers per element",
    );
    edit(&|d| d.json["accessors"][0]["componentType"] = json!(1)).refused(
        "component.gltf",
        "accessors[0]",
        "componentType",
    );
    edit(&|d| d.json["bufferViews"][0]["byteStride"] = json!(1)).refused("stride.gltf", "accessors[0]", "stride of 1");
    edit(&|d| d.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX)).refused(
        "view.gltf",
        "bufferViews[0]",
        "do not fit",
    );
    edit(&|d| d.json["bufferViews"][0]["buffer"] = json!(7)).refused(
        "buffer.gltf",
        "bufferViews[0].buffer",
        "does not exist",
    );
    edit(&|d| d.json["meshes"][0]["primitives"][0]["material"] = json!(0)).refused(
        "material_index.gltf",
        "material",
        "does not exist",
    );
    edit(&|d| d.json["nodes"][0]["mesh"] = json!(1)).refused("mesh_index.gltf", "nodes[0].mesh", "does not exist");
    edit(&|d| d.json["nodes"][0]["children"] = json!([0])).refused("cycle.gltf", "nodes[0]", "its own ancestor");
    edit(&|d| d.json["nodes"] = json!([{ "children": [2] }, { "children": [2] }, {}])).refused(
        "parents.gltf",
        "nodes[1]",
        "already has a parent",
    );
    edit(&|d| d.json["asset"]["version"] = json!("1.0")).refused("version.gltf", "asset.version", "1.0");
    edit(&|d| d.json["meshes"] = json!({ "mesh": {} })).refused("named.gltf", "glTF version 1.0", "convert the file");
    edit(&|d| d.attribute("NORMAL", "VEC3", &[0., 0., 1.])).refused(
        "normals.gltf",
        "accessors[1]",
        "1 elements, but POSITION has 3",
    );
    edit(&|d| d.json["nodes"] = json!("x")).refused("json.gltf", "line 1 column", "invalid type");

    edit(&|d| d.json["materials"] = json!([{ "emissiveFactor": [1e39, 0, 0] }])).refused(
        "bright.gltf",
        "materials[0]",
        "out of range",
    );
    edit(&|d| d.json["materials"] = json!([{ "pbrMetallicRoughness": { "roughnessFactor": -1 } }])).load("rough.gltf");

    // Every truncation of a binary file is an error, and none panics.
    let path = Draft::triangle().write("whole.glb");
    let bytes = std::fs::read(path).unwrap();
    let cut = Draft::path("cut.glb");
    for length in 0..bytes.len() {
        std::fs::write(&cut, &bytes[..length]).unwrap();
        let error = load_in_time(&cut).expect_err("truncated").to_string();
        assert!(error.contains("cut.glb"), "{error}");
    }
    let error = scene::load("/nowhere/at all.glb").unwrap_err().to_string();
    assert!(error.contains("at all.glb") && error.contains("cannot be read"), "{error}");
    assert!(scene::load(env!("CARGO_TARGET_TMPDIR")).is_err());
}

#[test]
fn a_deep_hierarchy_does_not_overflow_the_stack() {
    let mut draft = Draft::triangle();
    let depth = 200_000;
    let mut nodes: Vec<Value> = (1..depth).map(|i| json!({ "children": [i] })).collect();
    nodes.push(json!({ "mesh": 0 }));
    draft.json["nodes"] = json!(nodes);
    assert_eq!(draft.load("deep.gltf").instances.len(), 1);
}

#[test]
fn shared_accessors_cannot_ask_for_unbounded_memory() {
    let mut draft = Draft::triangle();
    let view = draft.view(&vec![0; 1 << 20]);
    let indices = draft
        .push("accessors", json!({ "bufferView": view, "componentType": 5121, "count": 1 << 20, "type": "SCALAR" }));
    draft.primitive()["indices"] = json!(indices);
    let primitive = draft.primitive().clone();
    draft.json["meshes"][0]["primitives"] = json!(vec![primitive; 2000]);
    draft.refused("bomb.glb", "meshes[0].primitives[", "triangle corners");
}

/// Exporters that turn a mesh inside out turn its triangles and not its normals. A mesh of which some triangles agree keeps
/// its winding, which alone tells the front in glTF.
#[test]
fn triangles_that_all_face_against_their_normals_are_turned() {
    for (normals, turned) in [([-1.0_f32, -1.0], true), ([1.0, 1.0], false), ([-1.0, 1.0], false)] {
        let quad = |z: f32| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let positions = [quad(0.0), quad(1.0)].concat().concat();
        let normals = normals.map(|z| [0.0, 0.0, z].repeat(3)).concat();
        let bytes: Vec<u8> = positions.iter().chain(&normals).flat_map(|v: &f32| v.to_le_bytes()).collect();
        let data = base64::Engine::encode(&base64::engine::general_purpose::STANDARD, &bytes);
        let view = |start: usize| json!({"buffer": 0, "byteOffset": start, "byteLength": 72});
        let accessor = |view: usize| json!({"bufferView": view, "componentType": 5126, "count": 6, "type": "VEC3"});
        let mut of_positions = accessor(0);
        of_positions["min"] = json!([0, 0, 0]);
        of_positions["max"] = json!([1, 1, 1]);
        let document = json!({
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": 144, "uri": format!("data:application/octet-stream;base64,{data}")}],
            "bufferViews": [view(0), view(72)],
            "accessors": [of_positions, accessor(1)],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}}]}],
            "nodes": [{"mesh": 0}],
            "scenes": [{"nodes": [0]}],
        });
        let scene = scene::load_bytes("a.gltf", document.to_string().as_bytes(), &|_| None).unwrap();
        assert_eq!(scene.meshes[0].triangles[0], if turned { [0, 2, 1] } else { [0, 1, 2] });
        let said = scene.warnings.iter().any(|w| w.contains("face against their normals"));
        assert_eq!(said, turned, "{:?}", scene.warnings);
    }
}
