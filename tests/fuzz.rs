//! Ten thousand mutated files make no loader panic, hang, or allocate more memory than the file explains, nor
//! flattening more than the triangles of all instances.
//!
//! The generator is seeded, so that every run loads the same files. A failure names the round and leaves the
//! file where it was loaded from. `FUZZ_ROUNDS` sets another number, `FUZZ_SEED` other files.

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use base64::Engine as _;
use common::random::Random;
use lightsheaf::scene::{self, Geometry};
use lightsheaf::staging::{self, Staging};
use serde_json::json;

/// Files that are loaded: of both formats together, and of compressed files.
const ROUNDS: u64 = 10_000;
/// Time limit for one file.
const TIME_LIMIT: Duration = Duration::from_secs(5);
/// Memory beside four times the file, for stacks, the allocator and threads.
const MEMORY_FLOOR: u64 = 32 << 20;
/// Triangles of scenes that are completed, and of scenes that are flattened. Each fourth of the former is completed, since
/// lighting and viewing scenes took most of the time.
const COMPLETED: usize = 10_000;
const COMPLETED_ROUNDS: u64 = 4;
const FLATTENED: usize = 200_000;
/// Memory of a flattened triangle and its vertices, twice, for growing lists.
const TRIANGLE_BYTES: u64 = 1024;

/// A file that loads, with the files beside it; the first one is loaded.
type Seed = Vec<(&'static str, Vec<u8>)>;

/// Returns a PNG of 2 x 2 pixels.
fn png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_fn(2, 2, |x, y| image::Rgba([200 * x as u8, 90 * y as u8, 30, 255]));
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Returns a scene that uses every feature that the loader reads: the JSON without its buffer, and the
/// buffer.
fn gltf_parts() -> (serde_json::Value, Vec<u8>) {
    let mut data = Vec::new();
    let mut views = Vec::new();
    let mut view = |bytes: Vec<u8>| {
        views.push(json!({ "buffer": 0, "byteOffset": data.len(), "byteLength": bytes.len() }));
        data.extend(bytes);
        data.resize(data.len().next_multiple_of(4), 0);
        views.len() - 1
    };
    let positions = view(floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0., 1., 1., 0.]));
    let normals = view(floats(&[0., 0., 1.].repeat(4)));
    let tangents = view(floats(&[1., 0., 0., 1.].repeat(4)));
    let uvs = view(floats(&[0., 0., 1., 0., 0., 1., 1., 1.]));
    let colors = view([255, 128, 0, 255].repeat(4));
    let indices = view([0_u16, 1, 2, 2, 1, 3].iter().flat_map(|i| i.to_le_bytes()).collect());
    let sparse_indices = view(vec![1, 3]);
    let sparse_values = view(floats(&[5., 0., 0., 5., 5., 0.]));
    let image = view(png());
    let accessor = |view: usize, component: u32, count: u32, kind: &str| json!({ "bufferView": view, "componentType": component, "count": count, "type": kind });
    let mut sparse = accessor(positions, 5126, 4, "VEC3");
    sparse["sparse"] = json!({ "count": 2, "indices": { "bufferView": sparse_indices, "componentType": 5121 }, "values": { "bufferView": sparse_values } });
    let mut color = accessor(colors, 5121, 4, "VEC4");
    color["normalized"] = json!(true);
    let texture = |i: u32| json!({ "index": i, "texCoord": 0 });
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2, 4] }],
        "nodes": [
            { "mesh": 0, "translation": [0.0, 1.0, 2.0], "rotation": [0.0, 0.0, 0.0, 1.0], "scale": [1.0, -2.0, 1.0], "children": [3] },
            { "camera": 0, "matrix": [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 5.0, 1.0] },
            { "extensions": { "KHR_lights_punctual": { "light": 0 } } },
            { "mesh": 1, "extensions": { "KHR_lights_punctual": { "light": 1 } } },
            { "camera": 1 },
        ],
        "meshes": [
            { "primitives": [{ "attributes": { "POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3, "COLOR_0": 4 }, "indices": 5, "material": 0 }] },
            { "primitives": [{ "attributes": { "POSITION": 6 }, "mode": 5, "material": 1 }] },
        ],
        "materials": [
            {
                "name": "painted", "alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": true,
                "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.5, 0.25, 1.0], "baseColorTexture": texture(0), "metallicRoughnessTexture": texture(1), "roughnessFactor": 0.4 },
                "normalTexture": { "index": 1, "scale": 0.5 },
                "emissiveFactor": [1.0, 1.0, 0.0],
                "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 3.0 }, "KHR_materials_ior": { "ior": 1.4 }, "KHR_materials_specular": { "specularFactor": 0.5 } },
            },
            { "extensions": { "KHR_materials_transmission": { "transmissionFactor": 0.9 }, "KHR_materials_volume": { "thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": [0.5, 0.5, 1.0] } } },
        ],
        "textures": [{ "source": 0, "sampler": 0 }, { "source": 1 }],
        "samplers": [{ "wrapS": 33071, "wrapT": 33648, "magFilter": 9728 }],
        "images": [
            { "bufferView": image, "mimeType": "image/png" },
            { "uri": format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(png())) },
        ],
        "cameras": [
            { "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } },
            { "type": "orthographic", "orthographic": { "xmag": 1.0, "ymag": 1.0, "zfar": 10.0, "znear": 0.1 } },
        ],
        "extensions": { "KHR_lights_punctual": { "lights": [
            { "type": "point", "color": [1.0, 0.9, 0.8], "intensity": 5.0 },
            { "type": "spot", "spot": { "innerConeAngle": 0.2, "outerConeAngle": 0.6 } },
        ] } },
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_transmission"],
        "accessors": [
            accessor(positions, 5126, 4, "VEC3"), accessor(normals, 5126, 4, "VEC3"), accessor(tangents, 5126, 4, "VEC4"),
            accessor(uvs, 5126, 4, "VEC2"), color, accessor(indices, 5123, 6, "SCALAR"), sparse,
        ],
        "bufferViews": views,
    });
    (json, data)
}

/// Returns the same scene as text and as a binary file.
fn gltf_seeds() -> Vec<Seed> {
    let (mut json, data) = gltf_parts();
    let encoded = base64::engine::general_purpose::STANDARD.encode(&data);
    let mut text = json.clone();
    text["buffers"] =
        json!([{ "byteLength": data.len(), "uri": format!("data:application/octet-stream;base64,{encoded}") }]);
    let mut beside = json.clone();
    beside["buffers"] = json!([{ "byteLength": data.len(), "uri": "data.bin" }]);
    json["buffers"] = json!([{ "byteLength": data.len() }]);
    let mut head = json.to_string().into_bytes();
    head.resize(head.len().next_multiple_of(4), b' ');
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
    let body = [chunk(b"JSON", &head), chunk(b"BIN\0", &data)].concat();
    let binary = [&b"glTF"[..], &2_u32.to_le_bytes(), &(body.len() as u32 + 12).to_le_bytes(), &body].concat();
    vec![
        vec![("scene.gltf", text.to_string().into_bytes())],
        vec![("scene.glb", binary)],
        vec![("scene.gltf", serde_json::to_vec_pretty(&beside).unwrap()), ("data.bin", data)],
    ]
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
    property list uchar int vertex_indices\nend_header\n";

fn mitsuba_seeds() -> Vec<Seed> {
    let xml = br##"<scene version="3.0.0">
<default name="size" value="2"/>
<integrator type="path"><integer name="max_depth" value="5"/></integrator>
<sensor type="thinlens"><float name="fov" value="40"/><string name="fov_axis" value="smaller"/><float name="aperture_radius" value="0.1"/><float name="focus_distance" value="5"/>
<transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="$size"/></film></sensor>
<texture type="checkerboard" id="squares"><rgb name="color0" value="0.5"/><transform name="to_uv"><scale value="$size"/></transform></texture>
<texture type="bitmap" id="image"><string name="filename" value="image.png"/><string name="filter_type" value="nearest"/></texture>
<bsdf type="twosided" id="paint"><bsdf type="diffuse"><ref name="reflectance" id="squares"/></bsdf></bsdf>
<bsdf type="bumpmap" id="bumpy"><ref id="squares"/><bsdf type="roughplastic"><float name="alpha" value="0.2"/><ref name="diffuse_reflectance" id="image"/></bsdf></bsdf>
<bsdf type="mask" id="holes"><ref name="opacity" id="image"/><bsdf type="roughconductor"><string name="material" value="Au"/></bsdf></bsdf>
<bsdf type="dielectric" id="glass"><string name="int_ior" value="bk7"/></bsdf>
<bsdf type="principled" id="disney"><rgb name="base_color" value="#8090ff"/><float name="roughness" value="0.3"/></bsdf>
<shape type="ply"><string name="filename" value="a.ply"/><ref id="paint"/></shape>
<shape type="ply"><string name="filename" value="b.ply"/><ref id="bumpy"/></shape>
<shape type="obj"><string name="filename" value="c.obj"/><emitter type="area"><spectrum name="radiance" value="400:1, 700:2"/></emitter></shape>
<shape type="serialized"><string name="filename" value="d.serialized"/><integer name="shape_index" value="0"/><ref id="holes"/></shape>
<shape type="shapegroup" id="group"><shape type="rectangle"><ref id="disney"/></shape></shape>
<shape type="instance"><ref id="group"/><transform name="to_world"><translate x="1"/><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/></transform></shape>
<shape type="sphere"><point name="center" x="0" y="1" z="2"/><float name="radius" value="0.5"/><ref id="glass"/></shape>
<shape type="cylinder"><point name="p0" x="0" y="0" z="0"/><point name="p1" x="0" y="0" z="1"/></shape>
<shape type="cube"><transform name="to_world"><rotate x="1" angle="30"/><scale x="2"/></transform><ref id="bumpy"/></shape>
<emitter type="spot"><rgb name="intensity" value="1, 2, 3"/><float name="cutoff_angle" value="30"/></emitter>
<emitter type="constant"><rgb name="radiance" value="0.1"/></emitter>
</scene>"##
        .to_vec();
    let ascii = (PLY.to_owned() + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").into_bytes();
    let mut binary = PLY.replace("ascii", "binary_little_endian").into_bytes();
    binary.extend(floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]));
    binary.push(3);
    binary.extend([0_i32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 -3\n".to_vec();
    // Spheres that are placed more often than their triangles are stored, which flattening multiplies.
    let place = |n: u32| {
        format!(
            "<shape type=\"instance\"><ref id=\"group\"/><transform name=\"to_world\"><translate x=\"{n}\"/></transform></shape>\n"
        )
    };
    let placed: String = (0..30).map(place).collect();
    let many = format!(
        "<scene version=\"3.0.0\">\n<shape type=\"shapegroup\" id=\"group\"><shape type=\"sphere\"/><shape type=\"cube\"/></shape>\n{placed}</scene>"
    );
    vec![
        vec![
            ("scene.xml", xml),
            ("a.ply", ascii),
            ("b.ply", binary),
            ("c.obj", obj),
            ("d.serialized", serialized()),
            ("image.png", png()),
        ],
        vec![("many.xml", many.into_bytes())],
    ]
}

/// Returns Mitsuba's own format, version 4: a triangle in single precision, compressed, then the dictionary
/// of one shape.
fn mesh_seeds() -> Vec<Seed> {
    let obj = "mtllib box.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1 2 3\nusemtl wood\n\
        f 1/1/1 2/2/1 3/1/1 4/2/1\nusemtl glass\nf -1 -2 -3\n";
    let mtl = "newmtl wood\nKd 0.5 0.4 0.3\nKs 0.2 0.2 0.2\nNs 40\nillum 2\nmap_Kd -s 1 1 1 wood.png\nmap_d wood.png\nd 0.5\n\
        newmtl glass\nKd 0 0 0\nKe 1 2 3\nmap_Ke wood.png\nNi 1.5\nTf 0.9 0.9 1\nillum 7\nPr 0.5\nPm 1\n";
    let stl = "solid part\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
        endsolid part\n";
    let mut bytes = vec![0; 80];
    bytes.extend(1_u32.to_le_bytes());
    bytes.extend(floats(&[0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0.]));
    bytes.extend([0; 2]);
    vec![
        vec![("box.obj", obj.into()), ("box.mtl", mtl.into()), ("wood.png", png())],
        vec![("scan.ply", format!("{PLY}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").into())],
        vec![("strip.ply", format!("{}0 0 0\n1 0 0\n0 1 0\n4 0 1 2 -1\n", PLY.replace("face", "tristrips")).into())],
        vec![("text.stl", stl.into())],
        vec![("bytes.stl", bytes)],
    ]
}

fn serialized() -> Vec<u8> {
    let mut body = Vec::new();
    body.extend(0x1000_u32.to_le_bytes());
    body.extend(b"shape\0");
    body.extend(3_u64.to_le_bytes());
    body.extend(1_u64.to_le_bytes());
    body.extend(floats(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]));
    body.extend([0_u32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut encoder, &body).unwrap();
    let mut out = vec![0x1c, 0x04, 4, 0];
    out.extend(encoder.finish().unwrap());
    out.extend(0_u64.to_le_bytes());
    out.extend(1_u32.to_le_bytes());
    out
}

/// Returns files of each kind of compression, and one with compressed images.
/// Skies by the compressions of OpenEXR, and a Radiance file.
fn sky_seeds() -> Vec<Seed> {
    use exr::prelude::{
        Compression, Encoding, Image, Layer, LayerAttributes, SpecificChannels, Vec2, WritableImage, f16,
    };
    let exr = |compression| {
        let pixel = |Vec2(x, y): Vec2<usize>| {
            let value = |c: usize| f16::from_f32(((x * 7 + y * 13 + c * 5) % 31) as f32 * 0.1);
            (value(0), value(1), value(2))
        };
        let encoding = Encoding { compression, ..Encoding::FAST_LOSSLESS };
        let channels = SpecificChannels::rgb(pixel);
        let layer = Layer::new((40, 36), LayerAttributes::default(), encoding, channels);
        let mut bytes = Vec::new();
        Image::from_layer(layer).write().to_buffered(std::io::Cursor::new(&mut bytes)).unwrap();
        bytes
    };
    let mut hdr = Vec::new();
    image::codecs::hdr::HdrEncoder::new(&mut hdr).encode(&[image::Rgb([0.5, 1.0, 20.0]); 40 * 20], 40, 20).unwrap();
    let compressions =
        [Compression::DWAA(None), Compression::DWAB(None), Compression::PIZ, Compression::ZIP16, Compression::RLE];
    let skies = compressions.map(|compression| ("sky.exr", exr(compression))).into_iter().chain([("sky.hdr", hdr)]);
    let scene = |name: &str| {
        let text = format!(
            "<scene version=\"3.0.0\"><sensor type=\"perspective\"/><shape type=\"rectangle\"/>\
             <emitter type=\"envmap\"><string name=\"filename\" value=\"{name}\"/></emitter></scene>"
        );
        text.into_bytes()
    };
    skies.map(|(name, bytes)| vec![("scene.xml", scene(name)), (name, bytes)]).collect()
}

fn compressed_seeds() -> Vec<Seed> {
    let read = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
        std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
    };
    let mut seeds: Vec<Seed> = vec![
        vec![("meshopt_ext.gltf", read("meshopt_ext.gltf")), ("meshopt_ext.bin", read("meshopt_ext.bin"))],
        vec![("meshopt_khr.gltf", read("meshopt_khr.gltf")), ("meshopt_khr.bin", read("meshopt_khr.bin"))],
    ];
    for names in [
        ["draco_edgebreaker.gltf", "draco_edgebreaker.bin", "draco_edgebreaker.fallback.bin"],
        ["draco_sequential.gltf", "draco_sequential.bin", "draco_sequential.fallback.bin"],
    ] {
        seeds.push(names.map(|name| (name, read(name))).into());
    }
    let mut webp = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_fn(16, 16, |x, y| image::Rgba([15 * x as u8, 15 * y as u8, 30, 255]));
    image.write_to(&mut webp, image::ImageFormat::WebP).unwrap();
    let images = ["tile.etc1s.ktx2", "tile.uastc.ktx2", "tile.uastc.zstd.ktx2", "tile.webp"];
    let (mut json, data) = gltf_parts();
    json["buffers"] = json!([{ "byteLength": data.len(), "uri": "data.bin" }]);
    json["images"] = images.iter().map(|uri| json!({ "uri": uri })).collect();
    let texture = |i: usize, extension: &str| json!({ "extensions": { extension: { "source": i } } });
    json["textures"] = json!([
        texture(0, "KHR_texture_basisu"),
        texture(1, "KHR_texture_basisu"),
        texture(2, "KHR_texture_basisu"),
        texture(3, "EXT_texture_webp"),
    ]);
    json["materials"][1]["pbrMetallicRoughness"] =
        json!({ "baseColorTexture": { "index": 2 }, "metallicRoughnessTexture": { "index": 3 } });
    let mut seed = vec![("scene.gltf", json.to_string().into_bytes()), ("data.bin", data)];
    seed.extend(images[..3].iter().map(|name| (*name, read(name))));
    seed.push((images[3], webp.into_inner()));
    seeds.push(seed);
    seeds
}

/// Texts that parsers tend to fail on.
const SPICE: &[&str] =
    &["\"", "<", ">", "$", "$size", "[", "]", "{", "}", "null", "true", "\\u0000", "/", "\n", "..", "\u{ff}", "-1"];
/// Numbers that are not valid as counts, indices or coordinates.
const NUMBERS: &[&str] = &[
    "-1",
    "0",
    "1",
    "2",
    "0.5",
    "7",
    "33",
    "255",
    "65535",
    "nan",
    "inf",
    "1e39",
    "1e30",
    "-1e-46",
    "99999999999",
    "4294967295",
    "2147483648",
    "18446744073709551615",
];
const WORDS: &[u32] =
    &[0, 1, 0x7f, 0xff, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7f80_0000, 0x7fc0_0000, 0x0001_0000, 4096];

/// Replaces numbers of texts by odd ones; less often, and always in binary data, changes, removes, doubles,
/// moves or inserts a few bytes.
fn mutate(random: &mut Random, bytes: &mut Vec<u8>) {
    let is_text = bytes.starts_with(b"glTF") || std::str::from_utf8(bytes).is_ok();
    for _ in 0..=random.below(2) {
        if bytes.is_empty() {
            bytes.push(b' ');
        }
        let at = random.below(bytes.len() as u64);
        let end = (at + 1 + random.below(24)).min(bytes.len());
        match if is_text { random.below(20) } else { 13 + random.below(7) } {
            0..=9 => {
                // The whole of the next number is replaced.
                let is_part = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'-');
                let Some(from) = bytes[at..].iter().position(u8::is_ascii_digit).map(|i| at + i) else { continue };
                let to = bytes[from..].iter().position(|b| !is_part(b)).map_or(bytes.len(), |i| from + i);
                drop(bytes.splice(from..to, NUMBERS[random.below(NUMBERS.len() as u64)].bytes()));
            }
            10..=12 => {
                let Some(digit) = bytes[at..].iter().position(u8::is_ascii_digit) else { continue };
                bytes[at + digit] = b'0' + random.below(10) as u8;
            }
            13 if bytes.len() >= 4 => {
                let at = at.min(bytes.len() - 4);
                bytes[at..at + 4].copy_from_slice(&WORDS[random.below(WORDS.len() as u64)].to_le_bytes());
            }
            14 => bytes[at] = random.below(256) as u8,
            15 => bytes[at] ^= 1 << random.below(8),
            16 => drop(bytes.drain(at..end)),
            17 => {
                let piece = bytes[at..end].to_vec();
                let to = random.below(bytes.len() as u64);
                drop(bytes.splice(to..to, piece));
            }
            18 => drop(bytes.splice(at..at, SPICE[random.below(SPICE.len() as u64)].bytes())),
            _ => bytes.truncate(at.max(1)),
        }
    }
}

/// Peak of resident memory in bytes since the last [`Peak::begin`]; none if the system does not report it.
struct Peak;

impl Peak {
    /// Resets the peak and returns the present value.
    fn begin() -> Option<u64> {
        std::fs::write("/proc/self/clear_refs", "5").ok()?;
        Self::most()
    }

    fn most() -> Option<u64> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
        line.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
    }
}

/// Ends the process if a file takes too long, since an endless loop cannot be ended otherwise.
struct Watchdog {
    /// Milliseconds since the start at which the file has to be loaded; 0 while none is being loaded.
    deadline: AtomicU64,
    began: Instant,
    file: Mutex<String>,
}

impl Watchdog {
    fn start() -> Arc<Self> {
        let dog = Arc::new(Self { deadline: AtomicU64::new(0), began: Instant::now(), file: Mutex::default() });
        let watching = Arc::downgrade(&dog);
        std::thread::spawn(move || {
            while let Some(dog) = watching.upgrade() {
                let deadline = dog.deadline.load(Ordering::Relaxed);
                if deadline != 0 && dog.began.elapsed().as_millis() as u64 > deadline {
                    eprintln!("{} is still being loaded after {TIME_LIMIT:?}", dog.file.lock().unwrap());
                    std::process::abort();
                }
                drop(dog);
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        dog
    }

    fn watch<T>(&self, file: String, work: impl FnOnce() -> T) -> T {
        *self.file.lock().unwrap() = file;
        self.deadline.store((self.began.elapsed() + TIME_LIMIT).as_millis() as u64, Ordering::Relaxed);
        let out = work();
        self.deadline.store(0, Ordering::Relaxed);
        out
    }
}

/// Result for a file.
#[derive(Debug, PartialEq)]
enum Outcome {
    Loaded,
    Refused,
    Wrong(String),
}

/// Loads and flattens a file of the given size with the given loader.
fn outcome(load: impl FnOnce() -> Result<usize, String>, bytes: u64) -> Outcome {
    let before = Peak::begin();
    let began = Instant::now();
    let result = catch_unwind(AssertUnwindSafe(load));
    let (took, after) = (began.elapsed(), Peak::most());
    let grown = before.zip(after).map_or(0, |(before, after)| after.saturating_sub(before));
    match result {
        Err(_) => Outcome::Wrong("it panicked".to_owned()),
        Ok(_) if took > TIME_LIMIT => Outcome::Wrong(format!("it took {took:?}")),
        Ok(Ok(triangles)) if grown > 4 * bytes + MEMORY_FLOOR + TRIANGLE_BYTES * triangles.min(FLATTENED) as u64 => {
            Outcome::Wrong(format!("{grown} bytes of memory for {bytes} and {triangles} triangles"))
        }
        Ok(Err(_)) if grown > 4 * bytes + MEMORY_FLOOR => {
            Outcome::Wrong(format!("{grown} bytes of memory for {bytes}"))
        }
        Ok(Err(cause)) if cause.is_empty() => Outcome::Wrong("an error without a cause".to_owned()),
        Ok(Err(_)) => Outcome::Refused,
        Ok(Ok(_)) => Outcome::Loaded,
    }
}

/// The peak is that of the whole process, so that loads take turns.
static ONE: Mutex<()> = Mutex::new(());

fn load(path: &Path, completes: bool) -> Result<usize, String> {
    let mut scene = scene::load(path.to_str().unwrap()).map_err(|e| e.to_string())?;
    // A mutated count may describe a large scene, which takes long.
    let triangles: usize = scene.instances.iter().map(|i| scene.meshes[i.mesh].triangles.len()).sum();
    if triangles >= FLATTENED {
        return Ok(triangles);
    }
    if completes && triangles < COMPLETED {
        staging::complete(&mut scene, &Staging::default()).map_err(|e| e.to_string())?;
    }
    Ok(Geometry::new(&scene).triangles.len())
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().map_or(default, |text| text.parse().unwrap_or_else(|e| panic!("{name}={text}: {e}")))
}

fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    drop(std::fs::remove_dir_all(&path));
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Loads mutations of seeds, each with one changed file, and returns how many loaded and how many were
/// refused.
fn fuzz(name: &str, seeds: &[Seed], rounds: u64) -> [u64; 2] {
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let dog = Watchdog::start();
    let mut random = Random(number("FUZZ_SEED", 2012));
    let mut counts = [0; 2];
    let folders: Vec<_> = (0..seeds.len()).map(|i| folder(&format!("fuzz-{name}-{i}"))).collect();
    for (seed, folder) in seeds.iter().zip(&folders) {
        seed.iter().for_each(|(file, bytes)| std::fs::write(folder.join(file), bytes).unwrap());
        let triangles = load(&folder.join(seed[0].0), true).unwrap_or_else(|e| panic!("the original: {e}"));
        assert!(triangles > 0);
    }
    let mut wrong = Vec::new();
    for round in 0..rounds {
        let which = random.below(seeds.len() as u64);
        let (seed, folder) = (&seeds[which], &folders[which]);
        // Half of all mutations change the file that is loaded; the others change one beside it.
        let at = if random.below(2) == 0 { 0 } else { random.below(seed.len() as u64) };
        let (file, original) = &seed[at];
        let mut bytes = original.clone();
        mutate(&mut random, &mut bytes);
        let path = folder.join(file);
        std::fs::write(&path, &bytes).unwrap();
        let all: u64 = seed.iter().map(|(_, bytes)| bytes.len() as u64).sum::<u64>() + bytes.len() as u64;
        let asked = folder.join(seed[0].0);
        let load = || load(&asked, round % COMPLETED_ROUNDS == 0);
        match dog.watch(format!("{} (round {round})", path.display()), || outcome(load, all)) {
            Outcome::Loaded => counts[0] += 1,
            Outcome::Refused => counts[1] += 1,
            Outcome::Wrong(what) => {
                let kept = folder.join(format!("round-{round}-{file}"));
                std::fs::write(&kept, &bytes).unwrap();
                wrong.push(format!("{}: {what}", kept.display()));
            }
        }
        std::fs::write(&path, original).unwrap();
    }
    println!("{name}: {} loaded, {} refused", counts[0], counts[1]);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    counts
}

#[test]
fn mutated_gltf() {
    let rounds = number("FUZZ_ROUNDS", ROUNDS) / 2;
    let [loaded, refused] = fuzz("gltf", &gltf_seeds(), rounds);
    // Some mutations must load and others must be refused.
    assert!(loaded > rounds / 20 && refused > rounds / 4, "{loaded} loaded, {refused} refused");
}

#[test]
fn mutated_mitsuba() {
    let rounds = number("FUZZ_ROUNDS", ROUNDS) / 2;
    let [loaded, refused] = fuzz("mitsuba", &mitsuba_seeds(), rounds);
    assert!(loaded > rounds / 20 && refused > rounds / 4, "{loaded} loaded, {refused} refused");
}

#[test]
fn mutated_meshes() {
    let [loaded, refused] = fuzz("meshes", &mesh_seeds(), number("FUZZ_ROUNDS", ROUNDS / 5));
    assert!(loaded > refused / 20 && refused > loaded / 20, "{loaded} loaded, {refused} refused");
}

#[test]
fn mutated_skies() {
    let rounds = number("FUZZ_ROUNDS", ROUNDS / 5);
    let [loaded, refused] = fuzz("skies", &sky_seeds(), rounds);
    assert!(loaded > rounds / 20 && refused > rounds / 4, "{loaded} loaded, {refused} refused");
}

#[test]
fn mutated_compressed_files() {
    let rounds = number("FUZZ_ROUNDS", ROUNDS);
    let [loaded, refused] = fuzz("compressed", &compressed_seeds(), rounds);
    assert!(loaded > rounds / 20 && refused > rounds / 4, "{loaded} loaded, {refused} refused");
}

/// The checks find a planted panic, an error without a cause, a slow load and a large allocation.
#[test]
fn planted_faults_are_seen() {
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    assert_eq!(outcome(|| Ok(1), 100), Outcome::Loaded);
    assert_eq!(outcome(|| Err("line 1: wrong".to_owned()), 100), Outcome::Refused);
    assert_eq!(outcome(|| Err(String::new()), 100), Outcome::Wrong("an error without a cause".to_owned()));
    assert_eq!(outcome(|| panic!("planted"), 100), Outcome::Wrong("it panicked".to_owned()));
    let slow = outcome(
        || {
            std::thread::sleep(TIME_LIMIT + Duration::from_millis(20));
            Ok(1)
        },
        100,
    );
    assert!(matches!(&slow, Outcome::Wrong(what) if what.contains("took")), "{slow:?}");
    // This allocates and touches as much again as is allowed, and frees it.
    let large = || Ok(vec![1_u8; 2 * MEMORY_FLOOR as usize].iter().map(|b| usize::from(*b)).sum::<usize>().min(1));
    match Peak::begin() {
        Some(_) => assert!(matches!(outcome(large, 100), Outcome::Wrong(what) if what.contains("bytes of memory"))),
        None => println!("skipped: this system does not tell how much memory was used"),
    }
    // Mutation changes files, and changes them in the same way for the same seed.
    let of = |seed| {
        let mut bytes = b"v 0 0 0\nf 1 2 3\n".to_vec();
        mutate(&mut Random(seed), &mut bytes);
        bytes
    };
    assert!((0..50).all(|seed| of(seed) == of(seed)));
    let distinct: std::collections::BTreeSet<_> = (0..50).map(of).collect();
    assert!(distinct.len() > 40, "{}", distinct.len());
}
