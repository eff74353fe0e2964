//! Tests of animation: curves against closed forms, small files posed by hand, malformed files, the compute
//! stage against the CPU's pose, and real files, whose frames agree in `raster`, `twin` and the reference.

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use base64::Engine as _;
use common::scenes::pinhole;
use common::{gpu, gpu_with_ray_queries, matte, picture, reference, shared};
use glam::{Affine3A, Quat, Vec3, Vec4};
use lightsheaf::film::Film;
use lightsheaf::gpu::{Counts, Flag, Gpu, read_back};
use lightsheaf::metrics::compare;
use lightsheaf::render::layouts::Attributes;
use lightsheaf::render::lights::table::{Hittable, LightTable};
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::render::upload::deformation::Deformer;
use lightsheaf::render::upload::gpu_scene::GpuScene;
use lightsheaf::scene::animation::{Curve, Interpolation};
use lightsheaf::scene::{Emission, Geometry, Instance, Light, Material, Mesh, Opacity, Projection, Scene};
use lightsheaf::settings::{Settings, Technique};
use lightsheaf::staging::{self, Staging};
use serde_json::{Value, json};

/// Animated files beside the repository; true if joints or weights deform their triangles.
const FILES: [(&str, bool); 6] = [
    ("AnimatedCube/glTF/AnimatedCube.gltf", false),
    ("AnimatedMorphCube/glTF/AnimatedMorphCube.gltf", true),
    ("AnimatedMorphCube/glTF-Quantized/AnimatedMorphCube.gltf", true),
    ("RiggedSimple/glTF/RiggedSimple.gltf", true),
    ("CesiumMan/glTF-Binary/CesiumMan.glb", true),
    ("Fox/glTF-Binary/Fox.glb", true),
];

/// Frames that are compared, at 30 a second.
const FRAMES: [u32; 3] = [0, 10, 37];

fn seconds(frame: u32) -> f32 {
    frame as f32 / 30.0
}

fn load(path: &Path) -> Scene {
    staging::load(path.to_str().unwrap(), &Staging::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn files() -> Vec<(Scene, bool)> {
    let Some(shared) = shared() else { return Vec::new() };
    FILES.map(|(name, deforms)| (load(&shared.join("scenes/gltf").join(name)), deforms)).into()
}

// --- Curves ---

#[test]
fn cubic_splines_are_the_polynomial_that_their_tangents_say() {
    // The keys sample p(t) = t^3 - 2 t + 1 and q(t) = 2 t^2 at uneven times, with their exact derivatives.
    let (p, dp) = (|t: f32| t.powi(3) - 2.0 * t + 1.0, |t: f32| 3.0 * t * t - 2.0);
    let (q, dq) = (|t: f32| 2.0 * t * t, |t: f32| 4.0 * t);
    let times = vec![0.0, 0.5, 2.0, 3.0];
    let values = times.iter().flat_map(|&t| [dp(t), dq(t), p(t), q(t), dp(t), dq(t)]).collect();
    let curve = Curve::new(times.clone(), values, 2, Interpolation::CubicSpline).unwrap();
    for i in 0..=60 {
        let t = i as f32 * 0.05;
        let found = curve.at(t);
        assert!((found[0] - p(t)).abs() < 1e-4 && (found[1] - q(t)).abs() < 1e-4, "{t}: {found:?}");
    }
    // Linear interpolation of the same keys does not follow the polynomials.
    let flat = times.iter().flat_map(|&t| [0.0, p(t), 0.0]).collect();
    let flat = Curve::new(times, flat, 1, Interpolation::CubicSpline).unwrap();
    assert!((flat.at(1.2)[0] - p(1.2)).abs() > 0.1);
}

#[test]
fn lines_steps_and_what_lies_outside() {
    let curve = |interpolation| Curve::new(vec![1.0, 2.0, 4.0], vec![0.0, 10.0, -10.0], 1, interpolation).unwrap();
    let line = curve(Interpolation::Linear);
    let step = curve(Interpolation::Step);
    for (t, on_line, on_step) in
        [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.5, 5.0, 0.0), (2.0, 10.0, 10.0), (3.0, 0.0, 10.0), (9.0, -10.0, -10.0)]
    {
        assert_eq!((line.at(t)[0], step.at(t)[0]), (on_line, on_step), "{t}");
    }
    assert_eq!((line.end(), line.width()), (4.0, 1));
    // Two keys at one time are a jump; the division by their distance is avoided.
    let jump = Curve::new(vec![0.0, 1.0, 1.0, 2.0], vec![0.0, 1.0, 5.0, 6.0], 1, Interpolation::Linear).unwrap();
    assert_eq!([0.5, 1.0, 1.5].map(|t| jump.at(t)[0]), [0.5, 5.0, 5.5]);
}

#[test]
fn rotations_turn_evenly_and_the_shorter_way() {
    let about_z = |degrees: f32| Quat::from_rotation_z(degrees.to_radians());
    let curve = |to: Quat| {
        let values = [Quat::IDENTITY.to_array(), to.to_array()].concat();
        Curve::new(vec![0.0, 1.0], values, 4, Interpolation::Linear).unwrap()
    };
    // A third of the way through a quarter turn is a third of its angle, unlike linear interpolation of the
    // four numbers.
    let third = curve(about_z(90.0)).rotation_at(1.0 / 3.0);
    assert!(third.angle_between(about_z(30.0)) < 1e-3, "{third}");
    let line = Vec4::from(Quat::IDENTITY).lerp(Vec4::from(about_z(90.0)), 1.0 / 3.0);
    assert!(Quat::from_vec4(line.normalize()).angle_between(about_z(30.0)) > 5e-3);
    // q and -q are the same rotation, so that halfway to either is the same.
    for to in [about_z(40.0), -about_z(40.0)] {
        let half = curve(to).rotation_at(0.5);
        assert!(half.angle_between(about_z(20.0)) < 1e-3, "{half}");
        assert!((half.length() - 1.0).abs() < 1e-5);
    }
    // A cubic spline of quaternions is normalized.
    let flat = [[0.0; 4], Quat::IDENTITY.to_array(), [0.0; 4], [0.0; 4], about_z(90.0).to_array(), [0.0; 4]].concat();
    let spline = Curve::new(vec![0.0, 1.0], flat, 4, Interpolation::CubicSpline).unwrap();
    assert!(spline.rotation_at(0.5).angle_between(about_z(45.0)) < 1e-3);
    assert!((spline.rotation_at(0.3).length() - 1.0).abs() < 1e-5);
}

#[test]
fn curves_that_are_wrong_say_why() {
    let wrong = |times: &[f32], values: &[f32], cause: &str| {
        let error = Curve::new(times.to_vec(), values.to_vec(), 1, Interpolation::Linear).unwrap_err();
        assert!(error.contains(cause), "{error}");
    };
    wrong(&[], &[], "no keys");
    wrong(&[0.0, f32::NAN], &[0.0, 1.0], "key 1 is NaN");
    wrong(&[1.0, 0.5], &[0.0, 1.0], "ascend");
    wrong(&[0.0, 1.0], &[0.0], "1 numbers for 2 keys");
    wrong(&[0.0], &[f32::INFINITY], "number 0 is inf");
}

// --- Small files ---

/// A file under construction: one node with one triangle, and one animation without channels.
struct Draft {
    json: Value,
    data: Vec<u8>,
}

impl Draft {
    fn new(positions: &[f32]) -> Self {
        let json = json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{ "attributes": {} }] }],
            "accessors": [],
            "bufferViews": [],
            "animations": [{ "name": "first", "channels": [], "samplers": [] }],
        });
        let mut draft = Self { json, data: Vec::new() };
        let accessor = draft.floats("VEC3", positions);
        draft.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(accessor);
        draft
    }

    fn push(&mut self, array: &str, value: Value) -> usize {
        let array = self.json[array].as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = json!({ "buffer": 0, "byteOffset": self.data.len(), "byteLength": bytes.len() });
        self.data.extend(bytes);
        self.data.resize(self.data.len().next_multiple_of(4), 0);
        let view = self.push("bufferViews", view);
        self.push("accessors", json!({ "bufferView": view, "componentType": component, "count": count, "type": kind }))
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let lanes = ["SCALAR", "", "VEC3", "VEC4"].iter().position(|k| *k == kind).map_or(16, |i| i + 1);
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(kind, 5126, values.len() / lanes, &bytes)
    }

    /// Adds a sampler and a channel of the first animation.
    fn animate(&mut self, target: Value, times: &[f32], kind: &str, values: &[f32]) {
        let (input, output) = (self.floats("SCALAR", times), self.floats(kind, values));
        let animation = &mut self.json["animations"][0];
        let samplers = animation["samplers"].as_array_mut().unwrap();
        samplers.push(json!({ "input": input, "output": output }));
        let sampler = samplers.len() - 1;
        let channels = animation["channels"].as_array_mut().unwrap();
        channels.push(json!({ "sampler": sampler, "target": target }));
    }

    fn write(&self, name: &str) -> PathBuf {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let mut json = self.json.clone();
        let data = base64::engine::general_purpose::STANDARD.encode(&self.data);
        let uri = format!("data:application/octet-stream;base64,{data}");
        json["buffers"] = json!([{ "byteLength": self.data.len(), "uri": uri }]);
        std::fs::write(&path, json.to_string()).unwrap();
        path
    }

    fn load(&self, name: &str) -> Scene {
        load(&self.write(name))
    }
}

/// Returns the corners in world space.
fn corners(scene: &Scene) -> Vec<Vec3> {
    Geometry::new(scene).vertices.iter().map(|v| v.position).collect()
}

fn near(found: &[Vec3], expected: &[[f32; 3]]) -> bool {
    found.len() == expected.len() && found.iter().zip(expected).all(|(f, &e)| f.distance(Vec3::from(e)) < 1e-5)
}

/// Returns a file with two joints, the second at (0, 1, 0), which rotates by a quarter turn about Z, and with
/// vertices that follow one joint, the other, or both alike.
fn bones() -> Draft {
    let mut draft = Draft::new(&[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, 0.0]);
    let weights = draft.floats("VEC4", &[1., 0., 0., 0., 0., 1., 0., 0., 0.5, 0.5, 0., 0.]);
    let joints = draft.accessor("VEC4", 5121, 3, &[0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0]);
    let mut bind = glam::Mat4::IDENTITY.to_cols_array().to_vec();
    bind.extend(glam::Mat4::from_translation(Vec3::NEG_Y).to_cols_array());
    let bind = draft.floats("MAT4", &bind);
    let attributes = &mut draft.json["meshes"][0]["primitives"][0]["attributes"];
    (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(joints), json!(weights));
    // The transform of a skinned mesh's own node does not count.
    draft.json["nodes"] = json!([
        { "mesh": 0, "skin": 0, "translation": [100, 0, 0] },
        { "children": [2] },
        { "translation": [0, 1, 0] },
    ]);
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    draft.json["skins"] = json!([{ "joints": [1, 2], "inverseBindMatrices": bind }]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    draft.animate(json!({ "node": 2, "path": "rotation" }), &[0.0, 1.0], "VEC4", &[0., 0., 0., 1., 0., 0., half, half]);
    draft
}

#[test]
fn a_skin_of_two_bones() {
    let scene = bones().load("bones.gltf");
    let rest = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 3.0, 0.0]];
    assert!(near(&corners(&scene), &rest), "{:?}", corners(&scene));
    assert!(near(&corners(&scene.at(0, 0.0).unwrap()), &rest));
    // (0, 2, 0) rotates about (0, 1, 0) to (-1, 1, 0), and (0, 3, 0) to (-2, 1, 0), half of the way there.
    let bent = [[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 2.0, 0.0]];
    let posed = scene.at(0, 1.0).unwrap();
    assert!(near(&corners(&posed), &bent), "{:?}", corners(&posed));
    assert!(near(&corners(&scene.at(0, 7.0).unwrap()), &bent), "time stands still after the last key");
    assert!(!near(&corners(&scene.at(0, 0.9).unwrap()), &bent), "a pose of another time is another");
    assert!(posed.rig.is_none() && scene.at(1, 0.0).unwrap_err().to_string().contains("1 animations"));
    // A file without animations that is posed so at rest has the same corners.
    let mut still = bones();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    still.json["nodes"][2]["rotation"] = json!([0.0, 0.0, half, half]);
    still.json.as_object_mut().unwrap().remove("animations");
    let still = still.load("bones_still.gltf");
    assert!(still.rig.is_none() && near(&corners(&still), &bent));
}

#[test]
fn morph_weights_by_hand() {
    let mut draft = Draft::new(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let up = draft.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let wide = draft.floats("VEC3", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    draft.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": up }, { "POSITION": wide }]);
    draft.json["meshes"][0]["weights"] = json!([0.5, 0.0]);
    draft.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 0, "weights": [0.0, 1.0], "translation": [0, 0, -5] }]);
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    draft.animate(json!({ "node": 0, "path": "weights" }), &[0.0, 2.0], "SCALAR", &[0.0, 0.0, 1.0, -1.0]);
    let scene = draft.load("morph.gltf");
    let other = [[0.0, 0.0, -5.0], [3.0, 0.0, -5.0], [0.0, 1.0, -5.0]];
    let rest = [&[[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]][..], &other].concat();
    assert!(near(&corners(&scene), &rest), "{:?}", corners(&scene));
    // The weights are 0.75 and -0.75; the other node keeps its own.
    let posed = scene.at(0, 1.5).unwrap();
    let expected = [&[[0.0, 0.0, 0.75], [-0.5, 0.0, 0.75], [0.0, 1.0, 0.75]][..], &other].concat();
    assert!(near(&corners(&posed), &expected), "{:?}", corners(&posed));
}

#[test]
fn cameras_lights_and_what_pointers_name() {
    let mut draft = Draft::new(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    draft.json["materials"] = json!([{ "emissiveFactor": [1, 1, 1],
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 3 } } }]);
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft.json["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }]);
    draft.json["extensions"] =
        json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 2, "color": [1, 0.5, 0] }] } });
    draft.json["nodes"] = json!([
        { "mesh": 0 },
        { "translation": [1, 2, 3], "children": [2, 3] },
        { "camera": 0 },
        { "extensions": { "KHR_lights_punctual": { "light": 0 } }, "translation": [0, 1, 0] },
    ]);
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    draft.json["extensionsRequired"] = json!(["KHR_animation_pointer"]);
    let pointer = |to: &str| json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": to } } });
    draft.animate(json!({ "node": 1, "path": "translation" }), &[0.0, 1.0], "VEC3", &[1., 2., 3., 5., 2., 3.]);
    let light = "/extensions/KHR_lights_punctual/lights/0/";
    draft.animate(pointer(&format!("{light}intensity")), &[0.0, 1.0], "SCALAR", &[2.0, 6.0]);
    draft.animate(pointer("/cameras/0/perspective/yfov"), &[0.0, 1.0], "SCALAR", &[1.0, 0.5]);
    draft.animate(pointer("/materials/0/emissiveFactor"), &[0.0, 1.0], "VEC3", &[1., 1., 1., 0., 1., 0.]);
    draft.animate(pointer("/materials/0/alphaCutoff"), &[0.0], "SCALAR", &[0.5]);
    let scene = draft.load("pointers.gltf");
    assert!(scene.warnings.iter().any(|w| w.contains("/materials/0/alphaCutoff")), "{:?}", scene.warnings);
    assert_eq!(scene.lights, [Light::Point { position: Vec3::new(1.0, 3.0, 3.0), intensity: Vec3::new(2., 1., 0.) }]);
    let posed = scene.at(0, 0.5).unwrap();
    assert_eq!(posed.lights, [Light::Point { position: Vec3::new(3.0, 3.0, 3.0), intensity: Vec3::new(4., 2., 0.) }]);
    assert_eq!(Vec3::from(posed.cameras[0].world_from_camera.translation), Vec3::new(3.0, 2.0, 3.0));
    assert!(matches!(posed.cameras[0].projection, Projection::Perspective { fov, .. } if (fov - 0.75).abs() < 1e-6));
    assert_eq!(posed.materials[0].emission.unwrap().radiance.factor, Vec3::new(1.5, 3.0, 1.5));
}

/// A surface that is opaque at rest fades out.
#[test]
fn alpha_is_animated() {
    let mut draft = Draft::new(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    draft.json["materials"] = json!([{ "alphaMode": "BLEND" }]);
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft.json["extensionsRequired"] = json!(["KHR_animation_pointer"]);
    let to = json!({ "pointer": "/materials/0/pbrMetallicRoughness/baseColorFactor" });
    let pointer = json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": to } });
    draft.animate(pointer, &[0.0, 1.0], "VEC4", &[1., 1., 1., 1., 1., 1., 1., 0.]);
    let scene = draft.load("fading.gltf");
    for (seconds, alpha) in [(0.0, 1.0), (0.25, 0.75), (1.0, 0.0)] {
        let opacity = scene.at(0, seconds).unwrap().materials[0].opacity;
        assert_eq!(opacity, Some(Opacity::Blended { value: alpha.into() }));
    }
}

#[test]
fn wrong_animations_are_refused() {
    let refused = |name: &str, change: &dyn Fn(&mut Draft), place: &str, cause: &str| {
        let mut draft = bones();
        change(&mut draft);
        let error =
            staging::load(draft.write(name).to_str().unwrap(), &Staging::default()).expect_err(name).to_string();
        for part in [name, place, cause] {
            assert!(error.contains(part), "{error:?} does not say {part:?}");
        }
    };
    let channel = |draft: &mut Draft, key: &str, value: Value| draft.json["animations"][0]["channels"][0][key] = value;
    refused("no_sampler.gltf", &|d| channel(d, "sampler", json!(7)), "animations[0]", "does not exist");
    refused("no_node.gltf", &|d| channel(d, "target", json!({ "node": 9, "path": "scale" })), "animations[0]", "exist");
    let sampler = |draft: &mut Draft, key: &str, value: Value| draft.json["animations"][0]["samplers"][0][key] = value;
    refused("no_input.gltf", &|d| sampler(d, "input", json!(99)), "animations[0]", "exist");
    refused("odd.gltf", &|d| sampler(d, "interpolation", json!("BEZIER")), "animations[0].channels[0]", "`BEZIER`");
    // Positions have three components, not four.
    refused("kind.gltf", &|d| sampler(d, "output", json!(0)), "accessors[0]", "3 numbers");
    refused("spline.gltf", &|d| sampler(d, "interpolation", json!("CUBICSPLINE")), "animations[0]", "8 numbers for 2");
    for (name, times, cause) in [("nan.gltf", [0.0, f32::NAN], "NaN"), ("back.gltf", [1.0, 0.0], "ascend")] {
        let change = |d: &mut Draft| {
            let times = d.floats("SCALAR", &times);
            sampler(d, "input", json!(times));
        };
        refused(name, &change, "animations[0].channels[0]", cause);
    }
    let joint = |d: &mut Draft| d.json["skins"][0]["joints"] = json!([1]);
    refused("joint.gltf", &joint, "accessors[", "follows joint 1 of 1");
    refused("cycle.gltf", &|d| d.json["nodes"][2]["children"] = json!([1]), "nodes[1]", "its own ancestor");
    // A scale that overflows is found when the pose is taken.
    let mut huge = bones();
    huge.animate(json!({ "node": 1, "path": "scale" }), &[0.0, 1.0], "VEC3", &[1., 1., 1., 3e38, 3e38, 3e38]);
    let huge = huge.load("huge.gltf");
    assert!(huge.at(0, 0.0).is_ok());
    let error = huge.at(0, 1.0).unwrap_err().to_string();
    assert!(error.contains("huge.gltf") && error.contains("animation 0 at 1 s"), "{error}");
    // A channel without a target and a channel of a matrix move nothing.
    let mut idle = bones();
    idle.json["nodes"][1]["matrix"] = json!(glam::Mat4::IDENTITY.to_cols_array());
    idle.animate(json!({ "node": 1, "path": "translation" }), &[0.0], "VEC3", &[9., 9., 9.]);
    idle.animate(json!({ "path": "translation" }), &[0.0], "VEC3", &[9., 9., 9.]);
    let scene = idle.load("idle.gltf");
    assert!(scene.warnings.iter().any(|w| w.contains("a matrix")), "{:?}", scene.warnings);
    assert!(near(&corners(&scene.at(0, 1.0).unwrap()), &[[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 2.0, 0.0]]));
}

/// Replacing any number of a file gives a scene, which is posed, or an error that names the file, but never a
/// panic.
#[test]
fn no_number_of_a_file_makes_it_panic() {
    fn numbers(value: &Value, path: String, out: &mut Vec<String>) {
        match value {
            Value::Number(_) => out.push(path),
            Value::Array(all) => {
                all.iter().enumerate().for_each(|(i, v)| numbers(v, format!("{path}/{i}"), out));
            }
            Value::Object(all) => all.iter().for_each(|(k, v)| numbers(v, format!("{path}/{k}"), out)),
            _ => {}
        }
    }
    let mut original = bones();
    let offsets = original.floats("VEC3", &[0.0; 9]);
    original.json["meshes"][0]["primitives"][0]["targets"] = json!([{ "POSITION": offsets }]);
    original.animate(json!({ "node": 0, "path": "weights" }), &[0.0, 1.0], "SCALAR", &[0.0, 1.0]);
    let mut places = Vec::new();
    numbers(&original.json, String::new(), &mut places);
    assert!(places.len() > 60, "{}", places.len());
    let (mut refused, mut posed) = (0, 0);
    for place in &places {
        for number in [json!(-1), json!(0), json!(1), json!(2), json!(5), json!(4_000_000_000_u32), json!(-1e38)] {
            let mut changed = Draft { json: original.json.clone(), data: original.data.clone() };
            *changed.json.pointer_mut(place).unwrap() = number;
            let path = changed.write("changed.gltf");
            match staging::load(path.to_str().unwrap(), &Staging::default()).and_then(|scene| scene.at(0, 0.5)) {
                Ok(scene) => posed += usize::from(Geometry::new(&scene).vertices.len() < 100),
                Err(error) => {
                    assert!(error.to_string().contains("changed.gltf"), "{place}: {error}");
                    refused += 1;
                }
            }
        }
    }
    println!("{posed} posed, {refused} refused");
    assert!(posed > 50 && refused > 50, "{posed} {refused}");
}

// --- The compute stage ---

/// Uploads vertices in one pose, deforms them on the device to another, and compares them with the CPU's
/// pose. Returns the largest distance of a position over the scene's size, and of a normal or tangent.
fn deformed(gpu: &Gpu, from: &Scene, to: &Scene, expected: &Scene) -> [f32; 2] {
    let geometry = Geometry::new(from);
    let lights = LightTable::new(from, &geometry, Hittable::Never);
    let on_device = GpuScene::new(gpu, from, &geometry, &lights, &[Flag::Textures]).unwrap();
    let expected = Geometry::new(expected);
    assert_eq!(expected.vertices.len(), geometry.vertices.len());
    let (geometry, sources) = Geometry::with_sources(to);
    Deformer::default().run(gpu, &on_device, to, &geometry, &sources).unwrap();
    let count = expected.vertices.len();
    let positions: Vec<[f32; 4]> = read_back(gpu, &on_device.positions, count).unwrap();
    let attributes: Vec<Attributes> = read_back(gpu, &on_device.attributes, count).unwrap();
    gpu.check().unwrap();
    let size = expected.bounds.map(Vec3::length).into_iter().fold(expected.sphere().1, f32::max);
    let mut worst = [0.0_f32; 2];
    for ((vertex, position), attributes) in expected.vertices.iter().zip(&positions).zip(&attributes) {
        worst[0] = worst[0].max(Vec4::from(*position).truncate().distance(vertex.position) / size);
        let normal = Vec3::from(attributes.normal).distance(vertex.normal);
        let tangent = Vec4::from(attributes.tangent).distance(vertex.tangent);
        worst[1] = worst[1].max(normal).max(tangent);
        assert_eq!(attributes.uv, [vertex.uvs[0].x, vertex.uvs[0].y, vertex.uvs[1].x, vertex.uvs[1].y]);
    }
    worst
}

#[test]
fn the_compute_stage_is_the_pose_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let mut checked = 0;
    for (scene, deforms) in files() {
        let poses = FRAMES.map(|frame| scene.at(0, seconds(frame)).unwrap());
        let rig = scene.rig.as_ref().unwrap();
        assert_eq!(!rig.shapes.is_empty(), deforms, "{}", scene.name);
        for (frame, pose) in FRAMES.iter().zip(&poses) {
            let [position, normal] = deformed(gpu, &poses[1], pose, pose);
            println!("{} frame {frame}: positions {position:.1e} of the size, normals {normal:.1e}", scene.name);
            assert!(position <= 4.0 * f32::EPSILON && normal <= 1e-4, "{} {frame}: {position} {normal}", scene.name);
        }
        // The pose of another time is a planted error.
        let late = scene.at(0, seconds(FRAMES[2]) + 0.05).unwrap();
        let [position, _] = deformed(gpu, &poses[0], &late, &poses[2]);
        assert!(position > 1e-4, "{}: a pose that is 50 ms late was not noticed", scene.name);
        checked += 1;
    }
    println!("{checked} files");
}

/// The compute stage handles missing normals, mirrored instances, tangents, and a mesh that two nodes share.
#[test]
fn the_compute_stage_knows_flat_mirrored_and_shared_meshes() {
    let Some(gpu) = gpu() else { return };
    let mut draft = bones();
    draft.json["nodes"]
        .as_array_mut()
        .unwrap()
        .extend([json!({ "mesh": 1, "translation": [0, 0, -3] }), json!({ "mesh": 1, "scale": [-1, 2, 1] })]);
    draft.json["scenes"][0]["nodes"] = json!([0, 1, 3, 4]);
    let positions = draft.floats("VEC3", &[0., 0., 0., 1., 0., 0.2, 0., 1., 0.]);
    let normals = draft.floats("VEC3", &[0., 0., 1., 0.6, 0., 0.8, 0., 0., 0.]);
    let tangents = draft.floats("VEC4", &[1., 0., 0., 1., 0.8, 0., -0.6, -1., 1., 0., 0., 1.]);
    let push = draft.floats("VEC3", &[0., 0.3, 0., 0., 0., 0.5, 0.1, 0., 0.]);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals, "TANGENT": tangents });
    let targets = json!([{ "POSITION": push, "NORMAL": push, "TANGENT": push }]);
    draft.push("meshes", json!({ "primitives": [{ "attributes": attributes, "targets": targets, "material": 0 }] }));
    draft.json["materials"] = json!([{ "normalTexture": { "index": 0 } }]);
    draft.json["textures"] = json!([{ "source": 0 }]);
    let pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
    draft.json["images"] = json!([{ "uri": format!("data:image/png;base64,{pixel}") }]);
    let uvs = draft.accessor("VEC2", 5126, 3, &[0_u8; 24]);
    draft.json["meshes"][1]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
    draft.animate(json!({ "node": 3, "path": "weights" }), &[0.0, 1.0], "SCALAR", &[0.0, 1.0]);
    draft.animate(json!({ "node": 4, "path": "scale" }), &[0.0, 1.0], "VEC3", &[-1., 2., 1., -2., 2., 0.5]);
    let scene = draft.load("flat_and_mirrored.gltf");
    let poses = [0.0, 0.4, 1.0].map(|t| scene.at(0, t).unwrap());
    let tangents = Geometry::new(&poses[1]).vertices.iter().filter(|v| v.tangent != Vec4::ZERO).count();
    assert_eq!((scene.instances.len(), tangents), (3, 6), "{:?}", scene.warnings);
    for pose in &poses {
        let [position, normal] = deformed(gpu, &poses[0], pose, pose);
        assert!(position <= 4.0 * f32::EPSILON && normal <= 1e-5, "{position} {normal}");
    }
}

// --- Pictures ---

/// Returns a file in poses, seen by one camera.
fn posed_pictures(scene: &Scene) -> Vec<Scene> {
    let first = scene.at(0, 0.0).unwrap();
    let (centre, radius) = Geometry::new(&first).sphere();
    let along = Vec3::new(-4.5, -3.0, -5.3).normalize();
    let camera = pinhole(centre - along * (2.2 * radius), along, 0.75);
    FRAMES
        .iter()
        .map(|&frame| {
            let pose = scene.at(0, seconds(frame)).unwrap();
            Scene { cameras: vec![camera.clone()], ..pose }
        })
        .collect()
}

#[test]
fn raster_twin_and_reference_agree_on_frames() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let base = Settings { width: 32, height: 32, bounces: 1, ..Settings::plain() };
    let (files, mut moving) = (files(), 0);
    for (scene, _) in &files {
        let poses: Vec<_> = posed_pictures(scene).into_iter().map(matte).collect();
        let [mut raster, mut twin] = [Technique::RASTER, Technique::TWIN].map(|technique| {
            let settings = Settings { technique, ..base.clone() };
            SharedRenderer::new(gpu, &poses[0], &settings).unwrap()
        });
        let mut truths = Vec::new();
        // The first frame is at rest, and the last one far from it.
        for (frame, pose) in FRAMES.iter().zip(&poses).step_by(2) {
            raster.pose(pose).unwrap();
            twin.pose(pose).unwrap();
            let to_twin = compare(&picture(&mut raster, 16), &picture(&mut twin, 16)).unwrap();
            let truth = reference(pose, &base, 128, 1);
            let to_truth = compare(&picture(&mut raster, 112), &truth).unwrap();
            let file = Path::new(&scene.name).file_name().unwrap().display();
            println!(
                "{file} frame {frame}: against twin {:+.4} %, rel_mse {:.1e}; against reference {:+.3} %, rel_mse {:.1e}",
                100.0 * to_twin.mean_bias,
                to_twin.rel_mse,
                100.0 * to_truth.mean_bias,
                to_truth.rel_mse
            );
            assert!(to_twin.mean_bias.abs() <= 1e-3 && to_twin.rel_mse <= 1e-4, "{file} {frame}: {to_twin:?}");
            assert!(to_truth.mean_bias.abs() <= 0.01 && to_truth.rel_mse <= 0.01, "{file} {frame}: {to_truth:?}");
            truths.push(truth);
        }
        let between = compare(&truths[0], &truths[1]).unwrap();
        println!("frame 0 against frame 37: rel_mse {:.1e}", between.rel_mse);
        moving += usize::from(between.rel_mse > 2e-3);
    }
    assert!(moving + 1 >= files.len(), "{moving} of {} are seen to move", files.len());
}

/// Returns the scene with emissive materials in place of its lights, above a floor below the given box.
fn on_a_floor(mut scene: Scene, [low, high]: [Vec3; 2]) -> Scene {
    for material in &mut scene.materials {
        material.emission = Some(Emission { radiance: Vec3::splat(3.0).into(), two_sided: true });
    }
    scene.materials.push(Material::diffuse("floor", Vec3::splat(0.7)));
    let corner = |x: f32, z: f32| Vec3::new(x, low.y - 1.0, z);
    let (x, z) = ((low.x, high.x), (low.z, high.z));
    scene.meshes.push(Mesh {
        positions: vec![corner(x.0, z.0), corner(x.0, z.1), corner(x.1, z.1), corner(x.1, z.0)],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material: scene.materials.len() - 1,
        ..Mesh::default()
    });
    scene.instances.push(Instance { mesh: scene.meshes.len() - 1, world_from_local: Affine3A::IDENTITY });
    (scene.lights, scene.environment) = (Vec::new(), None);
    scene
}

/// A renderer that goes from pose to pose makes the picture that a new renderer makes.
#[test]
fn a_pose_is_what_a_new_renderer_makes_of_it() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let Some(shared) = shared() else { return };
    let poses = posed_pictures(&load(&shared.join("scenes/gltf").join("Fox/glTF-Binary/Fox.glb")));
    // In the second series every triangle is a moving emitter above a floor.
    let shining: Vec<_> = poses.iter().cloned().map(|pose| on_a_floor(pose, Geometry::new(&poses[0]).bounds)).collect();
    let base = Settings { width: 48, height: 48, bounces: 1, ..Settings::plain() };
    let methods = [Technique::RASTER, Technique::TWIN, Technique::PATH, Technique::RAY_QUERY]
        .map(|technique| (technique, &poses));
    for (technique, poses) in
        methods.into_iter().chain([(Technique::RASTER, &shining), (Technique::RAY_QUERY, &shining)])
    {
        let settings = Settings { technique, ..base.clone() };
        let [late, followed, new] = if technique.shares_subpaths() {
            let mut renderer = SharedRenderer::new(gpu, &poses[0], &settings).unwrap();
            let followed = [1, 2].map(|i| {
                renderer.pose(&poses[i]).unwrap();
                picture(&mut renderer, 2)
            });
            let [late, followed] = followed;
            [late, followed, picture(&mut SharedRenderer::new(gpu, &poses[2], &settings).unwrap(), 2)]
        } else {
            let mut renderer = PathRenderer::new(gpu, &poses[0], &settings).unwrap();
            let followed = [1, 2].map(|i| {
                renderer.pose(&poses[i]).unwrap();
                picture(&mut renderer, 2)
            });
            let [late, followed] = followed;
            [late, followed, picture(&mut PathRenderer::new(gpu, &poses[2], &settings).unwrap(), 2)]
        };
        let apart = compare(&followed, &new).unwrap();
        println!(
            "{technique}: rel_mse {:.1e}, mean_bias {:+.1e}, p999 {:.1e}",
            apart.rel_mse, apart.mean_bias, apart.p999
        );
        // Positions differ in their last bits, so that a pixel or two of 2304 may select another light.
        assert!(apart.p999 <= 1e-3 && apart.rel_mse <= 1e-3 && apart.mean_bias.abs() <= 1e-3, "{technique}: {apart:?}");
        let late = compare(&late, &new).unwrap();
        assert!(late.rel_mse > 5e-3, "{technique}: a frame that is late was not noticed: {late:?}");
    }
}

/// Poses reuse pipelines and buffers, and a scene without animation has no such pass.
#[test]
fn poses_keep_pipelines_and_buffers() {
    let Some(_) = gpu() else { return };
    let Some(shared) = shared() else { return };
    // The test counts on the ledger of a device of its own.
    let gpu = Gpu::new().unwrap();
    let poses = posed_pictures(&load(&shared.join("scenes/gltf").join("RiggedSimple/glTF/RiggedSimple.gltf")));
    let settings = Settings { width: 16, height: 16, bounces: 1, ..Settings::plain() };
    let mut renderer = SharedRenderer::new(&gpu, &poses[0], &settings).unwrap();
    picture(&mut renderer, 1);
    let first = gpu.ledger.counts();
    assert!(!first.pipelines.contains_key("deform") && !first.buffers.contains_key("rest"));
    renderer.pose(&poses[1]).unwrap();
    picture(&mut renderer, 1);
    let second = gpu.ledger.counts();
    assert_eq!((second.pipelines["deform"], second.passes["deform"].dispatches), (1, 1));
    assert_eq!(second.pipelines.len(), first.pipelines.len() + 1);
    assert!(!second.buffers.contains_key("morph_offsets"), "nothing is morphed");
    renderer.pose(&poses[2]).unwrap();
    picture(&mut renderer, 1);
    let third = gpu.ledger.counts();
    assert_eq!((&third.pipelines, &third.textures), (&second.pipelines, &second.textures));
    // The grid of another pose may have longer lists.
    let kept = |counts: &Counts| -> u64 {
        let of_grid =
            ["grid_rows", "counts", "distances"].iter().filter_map(|label| counts.buffers.get(*label)).map(|b| b.bytes);
        counts.bytes() - of_grid.sum::<u64>()
    };
    assert_eq!(kept(&third), kept(&second));
    assert_eq!(third.passes["deform"].dispatches, 2);
}

/// On the command line, `--at` and the frame of that time give the same picture, files are numbered, and
/// errors say why.
#[test]
fn frames_from_the_command_line() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("frames");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    let file = bones().write("frames.gltf");
    let run = |arguments: &[&str]| {
        let common = ["--eye", "0,1,-6", "--target", "0,1,0", "--size", "24x24", "--samples", "4", "-q"];
        let mut command = Command::new(env!("CARGO_BIN_EXE_lightsheaf"));
        command.current_dir(&folder).arg("render").arg(&file).args(common).args(arguments);
        command.env_remove("RUST_LOG").output().unwrap()
    };
    let reference = ["--method", "reference"];
    let fine = |arguments: &[&str]| {
        let output = run(&[&reference[..], arguments].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    fine(&["--frames", "9..11", "--fps", "20", "-o", "f.exr", "--stats", "s.json"]);
    fine(&["--at", "0.5", "--animation", "first", "-o", "at.exr"]);
    fine(&["-o", "rest.exr"]);
    let film = |name: &str| Film::load(folder.join(name)).unwrap().pixels;
    assert_eq!(film("f_0010.exr"), film("at.exr"));
    assert_ne!(film("f_0010.exr"), film("f_0009.exr"));
    assert_ne!(film("rest.exr"), film("at.exr"));
    assert!(
        folder.join("f_0011.exr").is_file() && !folder.join("f_0012.exr").exists() && !folder.join("f.exr").exists()
    );
    let stats: Value = serde_json::from_slice(&std::fs::read(folder.join("s_0010.json")).unwrap()).unwrap();
    assert_eq!((&stats["frame"]["number"], &stats["frame"]["seconds"]), (&json!(10), &json!(0.5)));
    assert_eq!(stats["animations"], json!(["0 `first` (1.00 s)"]));
    for (arguments, cause) in [
        (&["--at", "-1"][..], "--at: -1 s"),
        (&["--at", "0", "--animation", "walk"], "--animation walk: is not in the scene, which has 0 `first`"),
        (&["--animation", "0"], "at which time?"),
        (&["--frames", "0..1", "--fps", "0"], "--fps 0"),
        (&["--frames", "0..1"], "--fps"),
        (&["--frames", "2..1", "--fps", "24"], "2..1"),
        (&["--frames", "0..1", "--fps", "24", "--at", "1"], "cannot be used with"),
    ] {
        let output = run(&[&reference[..], &["-o", "x.exr"], arguments].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && said.contains(cause), "{arguments:?}: {said}");
        assert!(!folder.join("x.exr").exists());
    }
    let still = Command::new(env!("CARGO_BIN_EXE_lightsheaf"))
        .args(["render", "builtin:cornell_point", "--at", "1", "-o", "x.exr"])
        .current_dir(&folder)
        .output()
        .unwrap();
    assert!(String::from_utf8_lossy(&still.stderr).contains("has no animation"));
}
