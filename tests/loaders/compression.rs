//! Tests of compressed glTF files: Draco, meshopt, KTX2 and WebP, and of instances of nodes.
//!
//! The compressed files and their uncompressed fallbacks were made by the formats' own reference encoders
//! (tests/fixtures/compress.mjs), so that decoders are compared with independent ones.

use std::path::{Path, PathBuf};

use glam::{Affine3A, DVec3, Quat, Vec3, Vec4};
use lightsheaf::scene::{LoadError, Mesh, Scene};
use serde_json::{Value, json};

use crate::common::folder::Folder;
use crate::common::shared;
use crate::gltf::{Draft, load_in_time, warned};

const FILES: [&str; 4] = ["meshopt_ext", "meshopt_khr", "draco_edgebreaker", "draco_sequential"];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// Loads a fixture after a change of its JSON and its compressed data, without the fallback of meshopt.
fn load_changed(name: &str, change: impl FnOnce(&mut Value, &mut Vec<u8>)) -> Result<Scene, LoadError> {
    let folder = Folder::new(name);
    let mut json: Value = serde_json::from_slice(&std::fs::read(fixture(&format!("{name}.gltf"))).unwrap()).unwrap();
    let mut data = std::fs::read(fixture(&format!("{name}.bin"))).unwrap();
    change(&mut json, &mut data);
    std::fs::write(folder.path(&format!("{name}.bin")), data).unwrap();
    if name.starts_with("draco") || json["buffers"][1]["extensions"].is_null() {
        let fallback = format!("{name}.fallback.bin");
        std::fs::copy(fixture(&fallback), folder.path(&fallback)).unwrap();
    }
    let path = folder.path(&format!("{name}.gltf"));
    std::fs::write(&path, json.to_string()).unwrap();
    load_in_time(Path::new(&path))
}

/// Removes an extension wherever it is.
fn strip(value: &mut Value) {
    match value {
        Value::Object(object) => {
            if let Some(extensions) = object.get_mut("extensions").and_then(Value::as_object_mut) {
                extensions.retain(|name, _| name == "EXT_mesh_gpu_instancing");
            }
            object.retain(|name, value| name != "extensions" || value.as_object().is_none_or(|o| !o.is_empty()));
            object.values_mut().for_each(strip);
        }
        Value::Array(array) => array.iter_mut().for_each(strip),
        _ => {}
    }
}

/// Checks that meshes agree to a step of their quantization, which rounding may go either way.
fn assert_same(a: &Mesh, b: &Mesh) {
    assert_eq!((&a.triangles, a.positions.len()), (&b.triangles, b.positions.len()));
    assert!(a.positions.iter().zip(&b.positions).all(|(a, b)| a.abs_diff_eq(*b, 1e-6)));
    assert_eq!(a.normals.len(), b.normals.len());
    assert!(a.normals.iter().zip(&b.normals).all(|(a, b)| a.abs_diff_eq(*b, 1.001 / 127.0)));
    assert_eq!(a.tangents.len(), b.tangents.len());
    assert!(a.tangents.iter().zip(&b.tangents).all(|(a, b)| a.abs_diff_eq(*b, 1.001 / 127.0)));
    assert_eq!(a.uvs, b.uvs);
    assert_eq!(a.colors.len(), b.colors.len());
    assert!(a.colors.iter().zip(&b.colors).all(|(a, b)| a.abs_diff_eq(*b, 1.001 / 255.0)));
}

#[test]
fn compressed_files_equal_their_fallbacks() {
    for name in FILES {
        let plain = load_changed(name, |json, _| strip(json)).unwrap();
        let decoded = load_changed(name, |_, _| ()).unwrap();
        assert!(decoded.warnings.is_empty(), "{name}: {:?}", decoded.warnings);
        let orb = &decoded.meshes[0];
        assert!(orb.triangles.len() >= 120 && orb.positions.len() >= 80, "{name}: {} vertices", orb.positions.len());
        assert!(!orb.normals.is_empty() && !orb.uvs[0].is_empty() && !orb.colors.is_empty(), "{name}");
        assert_eq!(decoded.meshes.len(), plain.meshes.len());
        decoded.meshes.iter().zip(&plain.meshes).for_each(|(a, b)| assert_same(a, b));
        let place = |scene: &Scene| scene.instances.iter().map(|i| (i.mesh, i.world_from_local)).collect::<Vec<_>>();
        assert!(place(&decoded).len() > 2, "{name} has instances");
        for ((mesh, a), (other, b)) in place(&decoded).into_iter().zip(place(&plain)) {
            assert!(mesh == other && a.abs_diff_eq(b, 1e-4), "{name}: {a} and {b}");
        }
        // A step in rotation moves a vertex by as much.
        if name.starts_with("meshopt") {
            let [a, b] = [&decoded, &plain].map(|scene| scene.at(0, 0.725).unwrap().meshes[0].positions.clone());
            assert!(a.iter().zip(&b).all(|(a, b)| a.abs_diff_eq(*b, 1e-4)));
            let moved = a.iter().zip(&decoded.meshes[0].positions).filter(|(a, b)| a.distance(**b) > 0.05).count();
            assert!(moved > 20, "{name}: {moved} vertices move");
        }
        // A different mesh is found.
        let mut other = orb.clone();
        other.positions[7].x += 1e-3;
        assert!(std::panic::catch_unwind(|| assert_same(&other, &plain.meshes[0])).is_err());
    }
}

/// Returns the surface's area and the mean of its points in world space.
fn area_and_centre(scene: &Scene) -> (f32, Vec3) {
    let (mut area, mut moment) = (0.0_f64, DVec3::ZERO);
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        for triangle in &mesh.triangles {
            let corner = |i: u32| instance.world_from_local.transform_point3(mesh.positions[i as usize]).as_dvec3();
            let [a, b, c] = triangle.map(corner);
            let triangle_area = 0.5 * (b - a).cross(c - a).length();
            area += triangle_area;
            moment += triangle_area * (a + b + c) / 3.0;
        }
    }
    (area as f32, (moment / area).as_vec3())
}

#[test]
fn real_compressed_files_equal_their_twins() {
    let Some(shared) = shared() else { return };
    for [compressed, plain] in [
        ["Box/glTF-Draco/Box.gltf", "Box/glTF/Box.gltf"],
        ["BoxMeshopt/BoxMeshopt.glb", "Box/glTF/Box.gltf"],
        ["BoxMeshopt-gltf/BoxMeshopt.gltf", "Box/glTF/Box.gltf"],
        ["Duck/glTF-Draco/Duck.gltf", "Duck/glTF/Duck.gltf"],
        ["dream-apartment/dream-apartment.meshopt.glb", "dream-apartment/dream-apartment.glb"],
    ] {
        let load = |name: &str| load_in_time(&shared.join("scenes/gltf").join(name)).unwrap();
        let [(a, at), (b, bt)] = [compressed, plain].map(|name| area_and_centre(&load(name)));
        assert!((a / b - 1.0).abs() < 1e-3, "{compressed}: an area of {a} instead of {b}");
        assert!(at.distance(bt) < 1e-3 * b.sqrt(), "{compressed}: the centre {at} instead of {bt}");
    }
}

#[test]
fn primitives_may_share_compressed_data() {
    let scene = load_changed("draco_edgebreaker", |json, _| {
        let primitive = json["meshes"][0]["primitives"][0].clone();
        json["meshes"][0]["primitives"] = json!([primitive, primitive]);
    });
    let [first, second, ..] = &scene.unwrap().meshes[..] else { panic!("two meshes") };
    assert_eq!((&first.positions, &first.triangles), (&second.positions, &second.triangles));
}

#[test]
fn wrong_compressed_data_is_refused() {
    let refused = |name: &str, parts: &[&str], change: &dyn Fn(&mut Value, &mut Vec<u8>)| {
        let error = load_changed(name, change).expect_err(parts[0]).to_string();
        for part in [&format!("{name}.gltf"), parts[0], parts[1]] {
            assert!(error.contains(part), "{error:?} does not say {part:?}");
        }
    };
    // The first compressed view holds the positions: 91 elements of 8 bytes.
    let views: &[(&str, &str, Value)] = &[
        ("count", "90 elements of 8 bytes are not the 728 bytes", json!(90)),
        ("count", "are not the 728 bytes of the view", json!(u64::MAX)),
        ("byteStride", "are not the 728 bytes", json!(6)),
        ("byteLength", "compressed", json!(3)),
        ("byteLength", "do not fit into a buffer", json!(1_000_000)),
        ("byteOffset", "starts with", json!(1)),
        ("byteOffset", "do not fit into a buffer", json!(u64::MAX)),
        ("buffer", "buffers[9], which does not exist", json!(9)),
        ("buffer", "buffers[1]", json!(1)),
        ("mode", "starts with", json!("INDICES")),
        ("filter", "not valid for the mode Attributes with the filter Color", json!("COLOR")),
    ];
    for (key, cause, value) in views {
        let place = if *key == "buffer" && value == 1 { "neither a uri" } else { "bufferViews[0]" };
        refused("meshopt_ext", &[place, cause], &|json, _| {
            let extension = &mut json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"];
            extension[*key] = value.clone();
            if *key == "mode" || *key == "filter" {
                let stride = if *key == "mode" { 4 } else { 28 };
                (extension["byteStride"], extension["count"]) = (json!(stride), json!(728 / stride));
            }
        });
    }
    refused("meshopt_khr", &["line 1 column", "unknown variant `FACES`"], &|json, _| {
        json["bufferViews"][0]["extensions"]["KHR_meshopt_compression"]["mode"] = json!("FACES");
    });
    // A count that the compressed bytes cannot hold is refused before memory is allocated for it.
    for name in ["meshopt_ext", "meshopt_khr"] {
        refused(name, &["bufferViews[0]", "do not fit into"], &|json, _| {
            let count = 100_000_000_u64;
            json["bufferViews"][0]["byteLength"] = json!(8 * count);
            let extensions = json["bufferViews"][0]["extensions"].as_object_mut().unwrap();
            extensions.values_mut().for_each(|e| e["count"] = json!(count));
        });
    }
    refused("meshopt_khr", &["bufferViews[0]", "expands to more than"], &|json, _| {
        json["bufferViews"][0]["byteLength"] = json!(1_u64 << 33);
        json["bufferViews"][0]["extensions"]["KHR_meshopt_compression"]["count"] = json!(1_u64 << 30);
    });
    let place = "meshes[0].primitives[0]";
    let draco =
        |json: &mut Value| json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"].take();
    refused("draco_edgebreaker", &[place, "there is no attribute of id 17"], &|json, _| {
        let mut extension = draco(json);
        extension["attributes"]["POSITION"] = json!(17);
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = extension;
    });
    refused("draco_edgebreaker", &[place, "has 2 numbers per vertex, the accessor needs 3"], &|json, _| {
        let mut extension = draco(json);
        extension["attributes"]["POSITION"] = extension["attributes"]["TEXCOORD_0"].clone();
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = extension;
    });
    refused("draco_edgebreaker", &[place, "bufferViews[99], which does not exist"], &|json, _| {
        let mut extension = draco(json);
        extension["bufferView"] = json!(99);
        json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = extension;
    });
    refused("draco_sequential", &[place, "KHR_draco_mesh_compression"], &|json, _| {
        let view =
            json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["bufferView"].as_u64();
        json["bufferViews"][view.unwrap() as usize]["byteLength"] = json!(200);
    });
    refused("draco_sequential", &[place, "KHR_draco_mesh_compression"], &|_, data| data[0] = b'X');
    // Every cut of the compressed data is refused.
    for (name, view) in [("meshopt_ext", 0), ("meshopt_khr", 0)] {
        for length in 0..40 {
            let cut = load_changed(name, |json, _| {
                let extensions = json["bufferViews"][view]["extensions"].as_object_mut().unwrap();
                extensions.values_mut().for_each(|e| e["byteLength"] = json!(length));
            });
            assert!(cut.is_err(), "{name} cut to {length} bytes loads");
        }
    }
}

/// VkFormat of 8-bit RGBA in sRGB.
const RGBA: u32 = 43;

/// Returns a KTX2 file of one level.
fn ktx2(format: u32, size: [u32; 2], scheme: u32, data: &[u8]) -> Vec<u8> {
    ktx2_with(format, size, scheme, data, "KTXwriter\0tests\0")
}

/// Returns a KTX2 file of one level with a key and its value.
fn ktx2_with(format: u32, [width, height]: [u32; 2], scheme: u32, data: &[u8], entry: &str) -> Vec<u8> {
    // A descriptor without samples: colour model RGBSDA, primaries BT.709, transfer function sRGB.
    let descriptor = [28, 0, 2 | 24 << 16, 1 | 1 << 8 | 2 << 16, 0, 4, 0];
    let descriptor: Vec<u8> = descriptor.iter().flat_map(|word: &u32| word.to_le_bytes()).collect();
    let mut metadata = [&(entry.len() as u32).to_le_bytes()[..], entry.as_bytes()].concat();
    metadata.resize(metadata.len().next_multiple_of(4), 0);
    let [a, b] = [descriptor.len() as u32, metadata.len() as u32];
    let mut out = b"\xabKTX 20\xbb\r\n\x1a\n".to_vec();
    let start = 80 + 24;
    let words = [format, 1, width, height, 0, 0, 1, 1, scheme, start, a, start + a, b];
    out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    out.extend([0; 16]);
    let level = [u64::from(start + a + b), data.len() as u64, u64::from(width) * u64::from(height) * 4];
    out.extend(level.iter().flat_map(|number| number.to_le_bytes()));
    [out, descriptor, metadata, data.to_vec()].concat()
}

/// Returns a triangle whose base colour and normal map are textures of the given images.
fn textured(images: &[&[u8]], textures: Value) -> Draft {
    let mut draft = Draft::triangle();
    draft.attribute("TEXCOORD_0", "VEC2", &[0., 0., 1., 0., 0., 1.]);
    for image in images {
        let view = draft.view(image);
        draft.push("images", json!({ "bufferView": view, "mimeType": "image/ktx2" }));
    }
    draft.json["textures"] = textures;
    let base_color = json!({ "baseColorTexture": { "index": 0 } });
    draft.json["materials"] = json!([{ "pbrMetallicRoughness": base_color, "normalTexture": { "index": 1 } }]);
    draft.primitive()["material"] = json!(0);
    draft
}

fn basisu(source: u32) -> Value {
    json!([{ "extensions": { "KHR_texture_basisu": { "source": source } } }, { "source": source }])
}

#[test]
fn ktx2_images_have_their_colours() {
    for name in ["tile.etc1s.ktx2", "tile.uastc.ktx2", "tile.uastc.zstd.ktx2"] {
        let bytes = std::fs::read(fixture(name)).unwrap();
        let mut draft = textured(&[&bytes], basisu(0));
        draft.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
        let scene = draft.load(&format!("{name}.glb"));
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        // One image serves both textures: colour and data.
        assert_eq!((scene.images.len(), scene.textures.len()), (1, 2));
        assert_eq!([scene.textures[0].srgb, scene.textures[1].srgb], [true, false]);
        let image = &scene.images[0];
        assert_eq!([image.width, image.height], [16, 16]);
        for (i, texel) in image.texels.iter().enumerate() {
            let (x, y) = (i % 16, i / 16);
            let color = [[200, 40, 30], [40, 160, 60], [30, 60, 190], [210, 190, 60]][2 * (y / 8) + x / 8];
            let expected = [color[0], color[1], color[2], if x < 8 { 255 } else { 128 }];
            let error = (0..4).map(|c| i32::from(texel[c]).abs_diff(expected[c])).max().unwrap();
            assert!(error <= 16, "{name}: {texel:?} instead of {expected:?} at {x}, {y}");
        }
    }
}

#[test]
fn plain_ktx2_images_are_read() {
    let texels: Vec<u8> = (0..16).map(|i| i * 15).collect();
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut encoder, &texels).unwrap();
    let zlib = encoder.finish().unwrap();
    // A Zstandard frame of one block that is not compressed.
    let zstd = [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, 16, 1 | 16 << 3, 0, 0][..], &texels].concat();
    for (scheme, data) in [(0, &texels), (2, &zstd), (3, &zlib)] {
        let scene = textured(&[&ktx2(RGBA, [2, 2], scheme, data)], basisu(0)).load("plain_ktx2.glb");
        assert_eq!(scene.images[0].texels.as_flattened(), texels, "scheme {scheme}");
    }
    let refused = |bytes: &[u8], cause: &str| textured(&[bytes], basisu(0)).refused("ktx2.glb", "images[0]", cause);
    refused(&ktx2(RGBA, [2, 3], 0, &texels), "too little data");
    refused(&ktx2(RGBA, [2, 3], 2, &zstd), "too little data");
    refused(&ktx2(RGBA, [1 << 16, 1 << 16], 0, &texels), "smaller image");
    refused(&ktx2(RGBA, [2, 2], 2, &texels), "damaged");
    refused(&ktx2(109, [1, 1], 0, &texels), "the KTX2 format 109 of colour model 1 is not supported");
    for (entry, cause) in [
        ("KTXorientation\0ru\0", "the KTXorientation of the KTX2 file is not rd"),
        ("KTXswizzle\0rrr1\0", "the KTXswizzle of the KTX2 file is not rgba"),
    ] {
        refused(&ktx2_with(RGBA, [2, 2], 0, &texels, entry), cause);
    }
    let mut premultiplied = ktx2(RGBA, [2, 2], 0, &texels);
    premultiplied[80 + 24 + 15] = 1;
    refused(&premultiplied, "multiplied by alpha");
    let mut layers = ktx2(RGBA, [2, 2], 0, &texels);
    layers[32] = 5;
    refused(&layers, "single image");
    refused(&ktx2(RGBA, [2, 2], 0, &texels)[..90], "truncated");
    let etc1s = std::fs::read(fixture("tile.etc1s.ktx2")).unwrap();
    for length in (12..etc1s.len() - 1).step_by(7) {
        textured(&[&etc1s[..length]], basisu(0)).refused("cut_ktx2.glb", "images[0]", "KTX2");
    }
}

#[test]
fn webp_images_are_read() {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = image::RgbaImage::from_fn(3, 2, |x, y| image::Rgba([80 * x as u8, 90 * y as u8, 30, 200]));
    image.write_to(&mut bytes, image::ImageFormat::WebP).unwrap();
    let webp = json!([{ "extensions": { "EXT_texture_webp": { "source": 0 } } }, { "extensions": { "EXT_texture_webp": {} } }]);
    let mut draft = textured(&[&bytes.into_inner()], webp);
    draft.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    let scene = draft.load("webp.glb");
    assert_eq!(scene.images[0].texels.as_flattened(), image.as_raw().as_slice());
    assert!(warned(&scene, "textures[1] has no image in a supported format"), "{:?}", scene.warnings);
    draft.json["textures"][0]["extensions"]["EXT_texture_webp"]["source"] = json!(4);
    // An image that does not exist is one whose file is not there.
    let scene = draft.load("webp_source.glb");
    assert!(scene.images.is_empty() && warned(&scene, "textures[0] has no image"), "{:?}", scene.warnings);
}

#[test]
fn compressed_images_are_preferred_and_equal_ones_decoded_once() {
    let texels: Vec<u8> = (0..16).collect();
    let bytes = ktx2(RGBA, [2, 2], 0, &texels);
    let both = json!([{ "source": 0, "extensions": { "KHR_texture_basisu": { "source": 1 } } }, { "source": 2 }]);
    let mut draft = textured(&[b"no image", &bytes], both);
    let second = draft.json["images"][1].clone();
    draft.push("images", second);
    let scene = draft.load("preferred.glb");
    assert_eq!((scene.images.len(), scene.textures.len()), (1, 2));
    assert_eq!(scene.images[0].width, 2);
}

#[test]
fn instances_multiply_the_mesh_and_nothing_else() {
    let mut draft = Draft::triangle();
    let translations = draft.floats("VEC3", &[1., 0., 0., 0., 2., 0., 0., 0., 3.]);
    let half = (0.5_f32.sqrt() * 127.0).round() as u8;
    let rotations = draft.accessor("VEC4", 5120, 3, &[0, 0, 0, 127, 0, 0, half, half, 0, 0, 0, 0]);
    draft.json["accessors"][rotations]["normalized"] = json!(true);
    let scales = draft.accessor("VEC3", 5121, 3, &[255, 255, 255, 51, 51, 51, 255, 0, 255]);
    draft.json["accessors"][scales]["normalized"] = json!(true);
    draft.json["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }]);
    draft.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    draft.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let attributes = json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales, "_ID": 0 });
    draft.json["nodes"][0] = json!({ "mesh": 0, "camera": 0, "translation": [10, 0, 0],
        "extensions": { "EXT_mesh_gpu_instancing": { "attributes": attributes }, "KHR_lights_punctual": { "light": 0 } } });
    let scene = draft.load("instances.gltf");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_eq!((scene.meshes.len(), scene.cameras.len(), scene.lights.len()), (1, 1, 1));
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let expected = [
        Affine3A::from_translation(Vec3::new(11., 0., 0.)),
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.2), quarter, Vec3::new(10., 2., 0.)),
        Affine3A::from_scale_rotation_translation(Vec3::new(1., 0., 1.), Quat::IDENTITY, Vec3::new(10., 0., 3.)),
    ];
    let found: Vec<_> = scene.instances.iter().map(|i| i.world_from_local).collect();
    assert!(found.len() == 3 && found.iter().zip(expected).all(|(a, b)| a.abs_diff_eq(b, 1e-6)), "{found:?}");

    // Instances follow their node when it moves.
    let times = draft.floats("SCALAR", &[0., 1.]);
    let places = draft.floats("VEC3", &[10., 0., 0., 20., 0., 0.]);
    draft.json["animations"] = json!([{ "samplers": [{ "input": times, "output": places }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }] }]);
    let moved = draft.load("instances_move.gltf").at(0, 0.5).unwrap();
    for (instance, at_rest) in moved.instances.iter().zip(expected) {
        let shift = Affine3A::from_translation(Vec3::new(5., 0., 0.));
        assert!(instance.world_from_local.abs_diff_eq(shift * at_rest, 1e-5));
    }

    let edit = |change: &dyn Fn(&mut Value)| {
        let mut json = draft.json.clone();
        change(&mut json);
        Draft { json, data: draft.data.clone() }
    };
    let counts = edit(&|json| json["accessors"][rotations]["count"] = json!(2));
    counts.refused("instance_counts.gltf", "nodes[0]", "3 and 2 elements");
    let kind = edit(&|json| json["accessors"][scales]["type"] = json!("VEC2"));
    kind.refused("instance_type.gltf", "accessors[3]", "EXT_mesh_gpu_instancing.SCALE needs [3]");
    let missing = edit(&|json| {
        json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(99);
    });
    missing.refused("instance_index.gltf", "nodes[0].EXT_mesh_gpu_instancing.SCALE", "accessors[99]");
    let many = edit(&|json| {
        json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] =
            json!({ "TRANSLATION": translations });
        json["accessors"][translations]["count"] = json!(10_000_000);
        json["accessors"][translations].as_object_mut().unwrap().remove("bufferView");
    });
    many.refused("instance_limit.gltf", "nodes[0]", "10000000 instances");
    let empty = edit(&|json| json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = json!({}));
    assert!(warned(&empty.load("instance_none.gltf"), "instances without transforms"));
}

#[test]
fn the_totals_of_instances_are_limited() {
    // 4,000 instances of 70,000 triangles are more than 2^28 triangles.
    let mut draft = Draft::triangle();
    draft.indices(&[0, 1, 2].repeat(70_000));
    let translations = draft.floats("VEC3", &vec![0.0; 12_000]);
    let instancing = json!({ "attributes": { "TRANSLATION": translations } });
    draft.json["nodes"][0] = json!({ "mesh": 0, "extensions": { "EXT_mesh_gpu_instancing": instancing } });
    draft.refused("instance_triangles.glb", "nodes[0]", "more than 268435456 triangles");
}

#[test]
fn vertex_colours_survive_the_colour_filter() {
    let scene = load_changed("meshopt_khr", |_, _| ()).unwrap();
    let (mesh, least) = (&scene.meshes[0], Vec4::new(0.09, 0.09, 0.09, 0.99));
    assert!(mesh.colors.iter().all(|color| color.cmpge(least).all() && color.cmple(Vec4::splat(1.0)).all()));
    let (low, high) = mesh.colors.iter().fold((Vec4::ONE, Vec4::ZERO), |(l, h), c| (l.min(*c), h.max(*c)));
    assert!((high - low).truncate().min_element() > 0.6, "{low} to {high}");
}
