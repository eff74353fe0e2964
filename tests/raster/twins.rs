//! Functions of the shaders against the reference's on random inputs: BSDFs, surfaces, textures,
//! environments, lights.
//!
//! Values agree within 1e-3 of the larger one (and 1e-5 absolutely), unit vectors within 1e-4. Some
//! tolerances are wider:
//! - plastic, 4e-3: the shader uses Mitsuba's fit of a smooth coat's internal reflectance, the reference integrates it; a
//!   rough coat is integrated by two quadratures, which differ most at grazing angles;
//! - lobes narrower than 0.01, 8e-3: a normal's rounding is 1e-4 of such a lobe, and D grows with its fourth
//!   power.

use crate::common;

use common::harness::answer;
use common::random::Random;
use common::shaders::{self, TwinAnswer, TwinQuestion};
use glam::{Affine2, Affine3A, Mat3, Quat, Vec2, Vec3, Vec4};
use lightsheaf::gpu::{Compute, Flag, Gpu};
use lightsheaf::reference::bvh::Hit;
use lightsheaf::reference::environment::Sky;
use lightsheaf::reference::lights::{Group, Lights as ReferenceLights};
use lightsheaf::reference::surface::Surfaces;
use lightsheaf::reference::texture::Textures;
use lightsheaf::render::lights::table::{Hittable, LightTable};
use lightsheaf::render::upload::gpu_scene::GpuScene;
use lightsheaf::scene::*;

const TOLERANCE: f32 = 1e-3;
const PLASTIC: f32 = 4e-3;
const NARROW: f32 = 8e-3;
const TINY: f32 = 1e-5;
const SURFACE: u32 = 0;
const TEXTURE: u32 = 1;
const ENVIRONMENT: u32 = 2;
const HOLE: u32 = 3;
const LIGHT: u32 = 4;

/// Runs the twins on the device.
fn ask(gpu: &Gpu, scene: &Scene, flags: &[Flag], questions: &[TwinQuestion]) -> Vec<TwinAnswer> {
    let geometry = Geometry::new(scene);
    let lights = LightTable::new(scene, &geometry, Hittable::All);
    let uploaded = GpuScene::new(gpu, scene, &geometry, &lights, flags).unwrap();
    let pass = Compute::from_source(gpu, "twins", &shaders::TWINS, flags);
    answer(gpu, &pass, &uploaded.with(&[]), ["twin_questions", "twin_answers"], questions)
}

/// True if two values agree.
fn agree(a: Vec3, b: Vec3, tolerance: f32) -> bool {
    let size = a.abs().max_element().max(b.abs().max_element());
    a.is_finite() && b.is_finite() && (a - b).abs().max_element() <= tolerance * size + TINY
}

/// Fails with the worst pairs that disagree. As a canary, values off by twice the tolerance must disagree.
fn compare(what: &str, tolerance: f32, pairs: &[(Vec3, Vec3, String)]) {
    assert!(pairs.len() >= 500, "{what}: only {} pairs", pairs.len());
    let bright = pairs.iter().filter(|(_, b, _)| b.max_element() > 0.1);
    assert!(bright.clone().count() * 10 > pairs.len(), "{what}: too little light to compare");
    let noticed = |b: Vec3| {
        let off = 1.0 + 2.0 * tolerance + 2e-4;
        !agree(b * off, b, tolerance) && !agree(b / off, b, tolerance)
    };
    assert!(bright.clone().all(|(_, b, _)| noticed(*b)));
    let mut wrong: Vec<_> = pairs.iter().filter(|(a, b, _)| !agree(*a, *b, tolerance)).collect();
    let error = |(a, b, _): &(Vec3, Vec3, String)| {
        let size = a.abs().max_element().max(b.abs().max_element());
        (*a - *b).abs().max_element() / (size + 0.01)
    };
    wrong.sort_by(|a, b| error(b).total_cmp(&error(a)));
    let text: Vec<_> = wrong
        .iter()
        .take(8)
        .map(|p| format!("shader {} reference {} (off by {:.4}): {}", p.0, p.1, error(p), p.2))
        .collect();
    assert!(wrong.is_empty(), "{what}: {} of {} differ\n{}", wrong.len(), pairs.len(), text.join("\n"));
}

/// Fails if at most a quarter of the pairs disagree, the shader being linked without the feature.
fn assert_noticed(what: &str, tolerance: f32, without: &[(Vec3, Vec3, String)]) {
    let off = without.iter().filter(|(a, b, _)| !agree(*a, *b, tolerance)).count();
    assert!(off * 4 > without.len(), "{what} do nothing: {off}");
}

/// Returns a scene with a triangle for each material, with bent normals, tangents, two sets of coordinates
/// and colours.
fn scene_of(materials: Vec<Material>, colors: bool, random: &mut Random) -> Scene {
    let mut scene = Scene { materials, ..Scene::default() };
    for material in 0..scene.materials.len() {
        let positions = [0; 3].map(|_| random.direction() * random.between(0.5, 2.0));
        let flat = (positions[1] - positions[0]).cross(positions[2] - positions[0]).normalize();
        let normals = [0; 3].map(|_| (flat + random.direction() * 0.3).normalize());
        let along = (positions[1] - positions[0]).normalize();
        let sign = if random.bits() & 1 == 0 { 1.0 } else { -1.0 };
        // Multiples of 1 / 255 are uploaded without rounding.
        let mut color = || Vec4::from_array([0; 4].map(|_| random.below(256) as f32 / 255.0));
        let colors = if colors { [0; 3].map(|_| color()).to_vec() } else { Vec::new() };
        scene.meshes.push(Mesh {
            tangents: normals.map(|n| along.reject_from(n).normalize().extend(sign)).to_vec(),
            uvs: [[0; 3].map(|_| random.uv()).to_vec(), [0; 3].map(|_| random.uv()).to_vec()],
            positions: positions.to_vec(),
            normals: normals.to_vec(),
            colors,
            triangles: vec![[0, 1, 2]],
            material,
            ..Mesh::default()
        });
        // Some are mirrored and stretched.
        let scale = if random.bits() & 1 == 0 { Vec3::ONE } else { Vec3::new(-1.0, 1.5, 0.7) };
        scene.instances.push(Instance { mesh: material, world_from_local: Affine3A::from_scale(scale) });
    }
    scene
}

fn barycentrics(random: &mut Random) -> [f32; 3] {
    let (mut u, mut v) = (random.unit(), random.unit());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    [1.0 - u - v, u, v]
}

/// Evaluates both sides at random points and directions of a scene in which each triangle has its own
/// material.
fn surfaces(
    gpu: &Gpu,
    scene: &Scene,
    flags: &[Flag],
    least_cos: f32,
    random: &mut Random,
) -> [Vec<(Vec3, Vec3, String)>; 4] {
    let reference = Surfaces::new(scene);
    let mut questions = Vec::new();
    let mut expected = Vec::new();
    for triangle in 0..reference.geometry.triangles.len() as u32 {
        let material = reference.material(triangle);
        for i in 0..60 {
            let at = barycentrics(random);
            let hit = Hit { triangle, t: 1.0, bary: [at[1], at[2]] };
            let wo = random.direction();
            let surface = reference.at(&hit, -wo, 0);
            // Points whose side depends on rounding are left out.
            if surface.normal.dot(wo) < 1e-3 {
                continue;
            }
            let ns = surface.frame.z;
            // Half of the pairs are near the mirror direction, relative to the lobe's width.
            let width = match &material.bsdf {
                Bsdf::Diffuse { .. } => 1.0,
                Bsdf::MetallicRoughness { roughness, .. } => roughness.factor * roughness.factor,
                Bsdf::Conductor { alpha, .. } | Bsdf::Plastic { alpha, .. } | Bsdf::Dielectric { alpha, .. } => {
                    alpha.factor
                }
            };
            let wi = if i % 2 == 0 {
                let h = (ns + random.direction() * width.clamp(1e-3, 1.0)).normalize();
                (h * (2.0 * wo.dot(h)) - wo).normalize()
            } else {
                random.direction()
            };
            let (local_o, local_i) = (surface.frame.local(wo), surface.frame.local(wi));
            // Grazing directions are left out: G1 / cos has no digits left there, and a bent normal may face
            // away.
            if local_o.z.abs() < least_cos || local_i.z.abs() < least_cos {
                continue;
            }
            let value = reference
                .bsdf(&surface)
                .map_or(Vec3::ZERO, |bsdf| bsdf.evaluate(local_o, local_i).0 / local_i.z.max(1e-2));
            let emission = reference.emitted(&hit, surface.front);
            questions.push(TwinQuestion {
                wo: wo.to_array(),
                index: triangle,
                wi: wi.to_array(),
                kind: SURFACE,
                at: [at[0], at[1], at[2], 0.0],
            });
            expected.push((
                value,
                emission,
                surface.normal,
                ns,
                format!("{:?} wo.z {} wi.z {}", material.bsdf, local_o.z, local_i.z),
            ));
        }
    }
    // Which models a scene has is no question of these tests.
    let models: &[Flag] = if flags.contains(&Flag::Glossy) { &[Flag::Conductors, Flag::Plastics] } else { &[] };
    let answers = ask(gpu, scene, &[flags, models].concat(), &questions);
    let mut out = [const { Vec::new() }; 4];
    for (a, (value, emission, ng, ns, text)) in answers.iter().zip(expected) {
        out[0].push((a.value.truncate(), value, text));
        out[1].push((a.emission.truncate(), emission, String::new()));
        out[2].push((a.ng.truncate(), ng, String::new()));
        out[3].push((a.ns.truncate(), ns, String::new()));
    }
    out
}

/// Moves pairs of values whose error is absolute up by one.
fn from_one(pairs: &[(Vec3, Vec3, String)]) -> Vec<(Vec3, Vec3, String)> {
    pairs.iter().map(|(a, b, text)| (*a + 1.0, *b + 1.0, text.clone())).collect()
}

/// Compares unit vectors by their distance.
fn compare_normals(what: &str, tolerance: f32, pairs: &[(Vec3, Vec3, String)]) {
    assert!(pairs.len() >= 500, "{what}: only {} pairs", pairs.len());
    let near = |a: Vec3, b: Vec3| a.distance(b) < tolerance;
    let mut off: Vec<f32> =
        pairs.iter().map(|(a, b, _)| a.distance(*b)).filter(|d| d.is_nan() || *d >= tolerance).collect();
    off.sort_by(|a, b| b.total_cmp(a));
    assert!(off.is_empty(), "{what}: {} of {} differ, by {:?}", off.len(), pairs.len(), &off[..off.len().min(8)]);
    assert!(
        pairs
            .iter()
            .all(|(_, b, _)| !near((*b + b.any_orthonormal_vector() * 2.0 * tolerance).normalize(), *b)
                && !near(-*b, *b))
    );
}

/// Returns a random material of model 0 to 3; `width` is its GGX width.
fn material(model: usize, width: f32, random: &mut Random) -> Material {
    let bsdf = match model {
        0 => Bsdf::Diffuse { reflectance: random.color().into() },
        1 => Bsdf::MetallicRoughness {
            base_color: random.color().into(),
            metallic: [0.0, 1.0, random.unit()][random.below(3)].into(),
            roughness: width.sqrt().into(),
            ior: random.between(1.0, 2.5),
            specular: [1.0, random.unit()][random.below(2)].into(),
            specular_color: (random.color() * 2.0).into(),
            transmission: 0.0.into(),
        },
        2 => Bsdf::Conductor {
            alpha: width.into(),
            fresnel: match random.below(3) {
                0 => Fresnel::None,
                _ => Fresnel::Conductor { eta: random.color() * 3.0 + 0.1, k: random.color() * 5.0 },
            },
            specular: random.color().into(),
        },
        _ => Bsdf::Plastic {
            alpha: width.into(),
            diffuse: random.color().into(),
            specular: random.color().into(),
            eta: random.between(1.1, 2.0),
            nonlinear: random.bits() & 1 == 0,
        },
    };
    let sides = [Sides::Two, Sides::One, Sides::OneCulled][random.below(3)];
    Material { bsdf, sides, ..Material::diffuse("", Vec3::ONE) }
}

#[test]
fn reflection() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(1);
    for model in 0..4 {
        for (low, high) in [(0.1, 1.0), (0.01, 0.1), (0.001, 0.01)] {
            let materials =
                (0..100).map(|_| material(model, low * f32::powf(high / low, random.unit()), &mut random)).collect();
            let scene = scene_of(materials, false, &mut random);
            let [values, ..] = surfaces(gpu, &scene, &[Flag::Glossy, Flag::RoughPlastic], 1e-2, &mut random);
            let tolerance = match (model, high <= 0.01) {
                (0, _) => TOLERANCE,
                (_, true) => NARROW,
                (3, _) => PLASTIC,
                _ => TOLERANCE,
            };
            compare(&format!("model {model}, width {low} to {high}"), tolerance, &values);
        }
    }
}

/// Returns a coat of a width, and one that has no weight every now and then.
fn coat(width: f32, random: &mut Random) -> Option<Coat> {
    let weight = [0.0, 1.0, random.unit()][random.below(3)];
    Some(Coat { weight: weight.into(), roughness: width.sqrt().into(), normal_map: None })
}

#[test]
fn coats() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(13);
    let flags = [Flag::Glossy, Flag::RoughPlastic, Flag::Coat];
    for (low, high) in [(0.1, 1.0), (0.01, 0.1)] {
        let materials = (0..200)
            .map(|i| {
                let width = low * f32::powf(high / low, random.unit());
                Material { coat: coat(width, &mut random), ..material(i % 4, width, &mut random) }
            })
            .collect();
        let scene = scene_of(materials, false, &mut random);
        let [values, ..] = surfaces(gpu, &scene, &flags, 1e-2, &mut random);
        compare(&format!("coats, width {low} to {high}"), PLASTIC, &values);
        let [bare, ..] = surfaces(gpu, &scene, &[Flag::Glossy, Flag::RoughPlastic], 1e-2, &mut random);
        assert_noticed("coats", PLASTIC, &bare);
    }

    let (textures, linear) = linear_textures(&mut random);
    let any = |random: &mut Random| one_of(&linear, random);
    let materials = (0..200)
        .map(|i| {
            let mut scalar = |factor: f32| Scalar { factor, texture: Some((any(&mut random), i % 4)) };
            let (weight, roughness) = (scalar(1.0), 0.7.into());
            let map = |random: &mut Random| {
                (random.bits() & 1 == 0).then(|| NormalMap { texture: any(random), scale: random.between(0.1, 0.5) })
            };
            let coat = Some(Coat { weight, roughness, normal_map: map(&mut random) });
            Material { coat, normal_map: map(&mut random), ..material(i as usize % 4, 0.5, &mut random) }
        })
        .collect();
    let mut scene = scene_of(materials, false, &mut random);
    (scene.images, scene.textures) = (textures.images, textures.textures);
    let flags = [Flag::Glossy, Flag::RoughPlastic, Flag::Coat, Flag::Textures];
    let [values, ..] = surfaces(gpu, &scene, &flags, 0.25, &mut random);
    compare("textured coats", TOLERANCE, &from_one(&values));
}

/// Transmittances are interpolated between integrals by two quadratures.
#[test]
fn rough_coats() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(30);
    let (textures, linear) = linear_textures(&mut random);
    for textured in [false, true] {
        let materials = (0..if textured { 16 } else { 48 })
            .map(|i| {
                let distribution = [Distribution::Ggx, Distribution::Beckmann][i % 2];
                let mut material = Material { distribution, ..material(3, random.between(0.05, 0.9), &mut random) };
                if let (Bsdf::Plastic { alpha, .. }, true) = (&mut material.bsdf, textured) {
                    alpha.texture = Some((one_of(&linear, &mut random), 0));
                }
                material
            })
            .collect();
        let mut scene = scene_of(materials, false, &mut random);
        if textured {
            (scene.images, scene.textures) = (textures.images.clone(), textures.textures.clone());
        }
        let flags = [Flag::Glossy, Flag::Beckmann, Flag::RoughPlastic, Flag::Textures];
        let flags = if textured { &flags[..] } else { &flags[..3] };
        let [values, ..] = surfaces(gpu, &scene, flags, if textured { 0.25 } else { 2e-2 }, &mut random);
        if textured {
            compare("rough coats by textures", PLASTIC, &from_one(&values));
        } else {
            compare("rough coats", PLASTIC, &values);
            let [smooth, ..] = surfaces(gpu, &scene, &flags[..2], 2e-2, &mut random);
            assert_noticed("rough coats", PLASTIC, &smooth);
        }
    }
}

#[test]
fn disney() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(31);
    let (textures, linear) = linear_textures(&mut random);
    let flags = [Flag::Glossy, Flag::Coat, Flag::Disney, Flag::Sheen, Flag::Textures];
    for textured in [false, true] {
        let materials = (0..200)
            .map(|i| {
                let sheen = [0.0, 1.0, random.between(0.0, 3.0)][random.below(3)];
                let texture = textured.then(|| (one_of(&linear, &mut random), 1));
                let disney = Disney {
                    sheen: Scalar { factor: sheen, texture },
                    sheen_tint: random.unit(),
                    flatness: [0.0, 1.0, random.unit()][random.below(3)],
                };
                let coat = if i % 3 == 0 { coat(0.3, &mut random) } else { None };
                let mut material = material(1, random.between(0.1, 1.0), &mut random);
                if let Bsdf::MetallicRoughness { metallic, .. } = &mut material.bsdf {
                    metallic.factor *= 0.5;
                }
                Material { disney: Some(disney), coat, ..material }
            })
            .collect();
        let mut scene = scene_of(materials, textured, &mut random);
        if textured {
            (scene.images, scene.textures) = (textures.images.clone(), textures.textures.clone());
            let flags = [&flags[..], &[Flag::VertexColors]].concat();
            let [values, ..] = surfaces(gpu, &scene, &flags, 0.25, &mut random);
            compare("Disney's sheen by textures", TOLERANCE, &from_one(&values));
        } else {
            let [values, ..] = surfaces(gpu, &scene, &flags[..4], 1e-2, &mut random);
            compare("Disney's sheen", TOLERANCE, &values);
            let [bare, ..] = surfaces(gpu, &scene, &flags[..2], 1e-2, &mut random);
            assert_noticed("Disney's sheen", TOLERANCE, &bare);
        }
    }
}

/// The albedo that scales the base is interpolated between integrals by two quadratures.
#[test]
fn sheens() {
    let Some(gpu) = common::gpu() else { return };
    const QUADRATURE: f32 = 1e-2;
    let mut random = Random(14);
    let flags = [Flag::Glossy, Flag::RoughPlastic, Flag::Sheen, Flag::Coat];
    let materials = (0..300)
        .map(|i| {
            let color = if i % 5 == 0 { Vec3::ZERO } else { random.color() };
            let sheen = Some(Sheen { color: color.into(), roughness: random.unit().into() });
            let coat = if i % 2 == 0 { coat(0.3, &mut random) } else { None };
            Material { sheen, coat, ..material(i % 4, 0.3, &mut random) }
        })
        .collect();
    let scene = scene_of(materials, false, &mut random);
    let [values, ..] = surfaces(gpu, &scene, &flags, 2e-2, &mut random);
    compare("sheens", QUADRATURE, &values);
    let [bare, ..] = surfaces(gpu, &scene, &[Flag::Glossy, Flag::RoughPlastic, Flag::Coat], 2e-2, &mut random);
    assert_noticed("sheens", QUADRATURE, &bare);
}

/// Interference depends on cosines of large phases, so that the tolerance is wider.
#[test]
fn films() {
    let Some(gpu) = common::gpu() else { return };
    const PHASE: f32 = 5e-3;
    let mut random = Random(16);
    let (textures, linear) = linear_textures(&mut random);
    for textured in [false, true] {
        let materials = (0..300)
            .map(|_| {
                let thickness = [random.between(0.0, 500.0), random.between(0.0, 1000.0)];
                let strength = [0.0, 1.0, random.unit()][random.below(3)];
                let texture = one_of(&linear, &mut random);
                let film = Film {
                    strength: Scalar { factor: strength, texture: textured.then_some((texture, 0)) },
                    ior: random.between(1.0, 2.0),
                    thickness: if textured { [100.0, 300.0] } else { thickness },
                    thickness_texture: textured.then_some((texture, 1)),
                };
                Material { film: Some(film), ..material(1, 0.5, &mut random) }
            })
            .collect();
        let mut scene = scene_of(materials, false, &mut random);
        if textured {
            (scene.images, scene.textures) = (textures.images.clone(), textures.textures.clone());
        }
        let flags: &[Flag] = if textured {
            &[Flag::Glossy, Flag::RoughPlastic, Flag::Film, Flag::Textures]
        } else {
            &[Flag::Glossy, Flag::RoughPlastic, Flag::Film]
        };
        let [values, ..] = surfaces(gpu, &scene, flags, 1e-2, &mut random);
        if textured {
            compare("films by textures", TOLERANCE, &from_one(&values));
        } else {
            compare("films", PHASE, &values);
            let [bare, ..] = surfaces(gpu, &scene, &[Flag::Glossy, Flag::RoughPlastic], 1e-2, &mut random);
            assert_noticed("films", PHASE, &bare);
        }
    }
}

#[test]
fn stretched_lobes() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(15);
    let flags = [Flag::Glossy, Flag::RoughPlastic, Flag::Anisotropy, Flag::Coat, Flag::Textures];
    for tangents in [true, false] {
        let materials = (0..200)
            .map(|i| {
                let strength = [0.0, 1.0, random.unit()][random.below(3)];
                let anisotropy = Some(Anisotropy { strength, rotation: random.between(-4.0, 4.0), texture: None });
                let coat = if i % 3 == 0 { coat(0.3, &mut random) } else { None };
                let width = random.between(0.03, 0.5);
                Material { anisotropy, coat, ..material(1 + i % 3, width, &mut random) }
            })
            .collect();
        let mut scene = scene_of(materials, false, &mut random);
        if !tangents {
            scene.meshes.iter_mut().for_each(|mesh| mesh.tangents.clear());
        }
        let [values, ..] = surfaces(gpu, &scene, &flags, 1e-2, &mut random);
        compare("stretched lobes", PLASTIC, &values);
        let round = [Flag::Glossy, Flag::RoughPlastic, Flag::Coat, Flag::Textures];
        let [round, ..] = surfaces(gpu, &scene, &round, 1e-2, &mut random);
        assert_noticed("stretched lobes", PLASTIC, &round);
    }

    let (textures, linear) = linear_textures(&mut random);
    let materials = (0..200)
        .map(|i| {
            let texture = Some(one_of(&linear, &mut random));
            let anisotropy = Some(Anisotropy { strength: 0.9, rotation: random.between(-4.0, 4.0), texture });
            Material { anisotropy, ..material(1 + i % 3, 0.5, &mut random) }
        })
        .collect();
    let mut scene = scene_of(materials, false, &mut random);
    (scene.images, scene.textures) = (textures.images, textures.textures);
    let [values, ..] = surfaces(gpu, &scene, &flags, 0.25, &mut random);
    compare("stretch by a texture", TOLERANCE, &from_one(&values));
}

#[test]
fn beckmann_facets() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(29);
    for (low, high) in [(0.1, 1.0), (0.01, 0.1)] {
        let materials = (0..200)
            .map(|i| {
                let distribution = Distribution::Beckmann;
                let strength = [0.0, 0.5][random.below(2)];
                let anisotropy = Some(Anisotropy { strength, rotation: random.between(-4.0, 4.0), texture: None });
                let width = low * f32::powf(high / low, random.unit());
                Material { distribution, anisotropy, ..material(1 + i % 3, width, &mut random) }
            })
            .collect();
        let scene = scene_of(materials, false, &mut random);
        let flags = [Flag::Glossy, Flag::RoughPlastic, Flag::Anisotropy, Flag::Textures, Flag::Beckmann];
        let [values, ..] = surfaces(gpu, &scene, &flags, 1e-2, &mut random);
        compare("Beckmann facets", if high <= 0.1 { NARROW } else { PLASTIC }, &values);
        let [ggx, ..] = surfaces(gpu, &scene, &flags[..4], 1e-2, &mut random);
        assert_noticed("Beckmann facets", PLASTIC, &ggx);
    }
}

#[test]
fn vertex_colors() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(2);
    for model in 0..4 {
        let materials = (0..60).map(|_| material(model, 0.3, &mut random)).collect();
        let scene = scene_of(materials, true, &mut random);
        let [values, ..] =
            surfaces(gpu, &scene, &[Flag::Glossy, Flag::RoughPlastic, Flag::VertexColors], 1e-2, &mut random);
        compare(&format!("vertex colours, model {model}"), if model == 3 { PLASTIC } else { TOLERANCE }, &values);
    }
}

/// Adds images of odd sizes and textures with every combination of wrap modes, filters and encodings.
fn add_textures(scene: &mut Scene, random: &mut Random) {
    for (width, height) in [(7, 5), (4, 4), (1, 3), (16, 9)] {
        let texels = (0..width * height).map(|_| (random.bits() as u32).to_le_bytes()).collect();
        scene.images.push(Image { name: String::new(), width, height, texels });
    }
    let modes = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
    for bits in 0..36 {
        scene.textures.push(Texture {
            image: random.below(4),
            wrap: [modes[bits % 3], modes[bits / 3 % 3]],
            filter: if bits / 9 % 2 == 0 { Filter::Nearest } else { Filter::Linear },
            srgb: bits / 18 == 1,
        });
    }
}

/// Returns textures of all kinds in a scene of their own, and the linear ones among them.
fn linear_textures(random: &mut Random) -> (Scene, Vec<usize>) {
    let mut scene = Scene::default();
    add_textures(&mut scene, random);
    let linear = (0..scene.textures.len()).filter(|&t| scene.textures[t].filter == Filter::Linear).collect();
    (scene, linear)
}

/// Returns a reference to one of the textures.
fn one_of(textures: &[usize], random: &mut Random) -> TextureRef {
    reference_to(textures[random.below(textures.len() as u64)], random)
}

fn reference_to(texture: usize, random: &mut Random) -> TextureRef {
    let transform = match random.below(2) {
        0 => Affine2::IDENTITY,
        _ => Affine2::from_scale_angle_translation(random.uv(), random.unit() * 6.0, random.uv()),
    };
    TextureRef { texture, uv_set: random.below(2) as u32, transform }
}

#[test]
fn textures() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(3);
    let mut scene = Scene::default();
    add_textures(&mut scene, &mut random);
    // Uses are numbered in the order of the materials.
    let mut uses: Vec<TextureRef> = (0..4 * scene.textures.len()).map(|i| reference_to(i / 4, &mut random)).collect();
    let mut distinct: Vec<TextureRef> = Vec::new();
    uses.retain(|u| {
        !distinct.contains(u) && {
            distinct.push(*u);
            true
        }
    });
    scene.materials = uses
        .iter()
        .map(|&u| Material {
            bsdf: Bsdf::Diffuse { reflectance: Color { factor: Vec3::ONE, texture: Some(u) } },
            ..Material::diffuse("", Vec3::ONE)
        })
        .collect();
    let textures = Textures::new(&scene);
    let mut questions = Vec::new();
    let mut expected = Vec::new();
    for (index, reference) in uses.iter().enumerate() {
        let texture = &scene.textures[reference.texture];
        let image = &scene.images[texture.image];
        for _ in 0..100 {
            let uvs = [random.uv(), random.uv()];
            let p = reference.apply(uvs) * Vec2::new(image.width as f32, image.height as f32);
            // Rounding decides on the border between two texels.
            let off = (p - p.round()).abs().min_element();
            if texture.filter == Filter::Nearest && off < 1e-3 {
                continue;
            }
            questions.push(TwinQuestion {
                index: index as u32,
                kind: TEXTURE,
                at: [uvs[0].x, uvs[0].y, uvs[1].x, uvs[1].y],
                ..TwinQuestion::default()
            });
            expected.push((textures.fetch(reference, uvs), format!("{texture:?} {reference:?} {p}")));
        }
    }
    let answers = ask(gpu, &scene, &[Flag::Textures], &questions);
    let pairs = |pick: fn(Vec4) -> Vec3| -> Vec<_> {
        answers.iter().zip(&expected).map(|(a, (e, text))| (pick(a.value), pick(*e), text.clone())).collect()
    };
    compare("colours", TOLERANCE, &from_one(&pairs(Vec4::truncate)));
    compare("alpha", TOLERANCE, &from_one(&pairs(|v| Vec3::splat(v.w))));
}

#[test]
fn textured_surfaces() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(4);
    let (textures, linear) = linear_textures(&mut random);
    let any = |random: &mut Random| one_of(&linear, random);
    let materials = (0..200)
        .map(|i| {
            let mut m = material(i % 4, 0.5, &mut random);
            let color = |random: &mut Random| Color { factor: random.color(), texture: Some(any(random)) };
            let scalar = |random: &mut Random| Scalar {
                factor: random.between(0.5, 1.0),
                texture: Some((any(random), random.below(4) as u32)),
            };
            match &mut m.bsdf {
                Bsdf::Diffuse { reflectance } => *reflectance = color(&mut random),
                Bsdf::MetallicRoughness { base_color, metallic, specular, specular_color, .. } => {
                    *base_color = color(&mut random);
                    *metallic = scalar(&mut random);
                    *specular = scalar(&mut random);
                    *specular_color = color(&mut random);
                }
                Bsdf::Conductor { specular, .. } => *specular = color(&mut random),
                Bsdf::Plastic { diffuse, specular, .. } => {
                    *diffuse = color(&mut random);
                    *specular = color(&mut random);
                }
                Bsdf::Dielectric { .. } => unreachable!("not drawn"),
            }
            m.emission = Some(Emission { radiance: color(&mut random), two_sided: random.bits() & 1 == 0 });
            if i % 3 > 0 {
                m.normal_map = Some(NormalMap { texture: any(&mut random), scale: random.between(0.2, 1.0) });
            }
            m
        })
        .collect();
    let mut scene = scene_of(materials, false, &mut random);
    (scene.images, scene.textures) = (textures.images, textures.textures);
    let [values, emission, ng, ns] =
        surfaces(gpu, &scene, &[Flag::Glossy, Flag::RoughPlastic, Flag::Textures], 0.25, &mut random);
    compare_normals("geometric normals", 1e-4, &ng);
    compare_normals("shading normals", 0.2, &ns);
    compare("emission", TOLERANCE, &from_one(&emission));
    compare("reflection", TOLERANCE, &from_one(&values));
    let bent = ng.iter().zip(&ns).filter(|(g, s)| g.0.dot(s.0) < 0.9).count();
    assert!(bent > 500, "normal maps do nothing: {bent}");
}

/// A mesh with a normal map and without tangents gets them from its coordinates (scene::Mesh), also on the
/// device.
#[test]
fn normal_maps_without_tangents() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(5);
    let (textures, linear) = linear_textures(&mut random);
    let materials = (0..40)
        .map(|_| {
            let texture = TextureRef::new(linear[random.below(linear.len() as u64)]);
            Material { normal_map: Some(NormalMap { texture, scale: 1.0 }), ..Material::diffuse("", Vec3::splat(0.8)) }
        })
        .collect();
    let mut scene = scene_of(materials, false, &mut random);
    (scene.images, scene.textures) = (textures.images, textures.textures);
    scene.meshes.iter_mut().for_each(|m| m.tangents.clear());
    let [.., ns] = surfaces(gpu, &scene, &[Flag::Textures], 1e-2, &mut random);
    compare_normals("shading normals", 0.2, &ns);
}

#[test]
fn holes() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(6);
    let mut textures = Scene::default();
    add_textures(&mut textures, &mut random);
    let materials = (0..60)
        .map(|i| {
            let texture = (i % 3 > 0).then(|| (reference_to(random.below(36), &mut random), random.below(4) as u32));
            let value = Scalar { factor: random.between(0.5, 1.0), texture };
            let cutoff = random.between(0.1, 0.6);
            let opacity = (i % 5 > 0).then_some(Opacity::CutOut { value, cutoff });
            Material { opacity, ..Material::diffuse("", Vec3::ONE) }
        })
        .collect();
    let mut scene = scene_of(materials, true, &mut random);
    (scene.images, scene.textures) = (textures.images, textures.textures);
    let reference = Surfaces::new(&scene);
    let (mut questions, mut expected) = (Vec::new(), Vec::new());
    for _ in 0..20_000 {
        let (triangle, at) = (random.below(60) as u32, barycentrics(&mut random));
        questions.push(TwinQuestion {
            index: triangle,
            kind: HOLE,
            at: [at[0], at[1], at[2], 0.0],
            ..TwinQuestion::default()
        });
        expected.push(!reference.solid(&Hit { triangle, t: 1.0, bary: [at[1], at[2]] }));
    }
    let flags = [Flag::Textures, Flag::Masks, Flag::VertexColors];
    let answers = ask(gpu, &scene, &flags, &questions);
    let holes = expected.iter().filter(|&&e| e).count();
    assert!(holes > 2000 && holes < 18_000, "{holes}");
    let wrong = answers.iter().zip(&expected).filter(|(a, e)| (a.value.x == 1.0) != **e).count();
    // Rounding decides at the threshold itself.
    assert!(wrong <= 20, "{wrong} of {} differ", expected.len());
    let shifted = answers.iter().zip(expected.iter().skip(1)).filter(|(a, e)| (a.value.x == 1.0) != **e).count();
    assert!(shifted > 1000, "answers to other questions are noticed: {shifted}");
}

#[test]
fn environments() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(7);
    for (width, height, rows) in [
        (8, 4, Some(Rows::Centred)),
        (8, 4, Some(Rows::AtPoles)),
        (5, 7, Some(Rows::Centred)),
        (1, 1, Some(Rows::AtPoles)),
        (0, 0, None),
    ] {
        let texels = (0..width * height).map(|_| (random.color() * 3.0).to_array()).collect();
        let environment = Environment {
            radiance: random.color() + 0.1,
            map: rows.map(|rows| EnvironmentMap { width, height, texels, rows }),
            world_from_environment: Mat3::from_quat(Quat::from_axis_angle(random.direction(), random.unit() * 6.0)),
        };
        let scene = Scene {
            environment: Some(environment),
            ..scene_of(vec![material(0, 1.0, &mut random)], false, &mut random)
        };
        let directions: Vec<Vec3> = (0..4000).map(|_| random.direction()).collect();
        let questions: Vec<_> = directions
            .iter()
            .map(|d| TwinQuestion { wo: d.to_array(), kind: ENVIRONMENT, ..TwinQuestion::default() })
            .collect();
        let flags: &[Flag] =
            if rows.is_some() { &[Flag::Environment, Flag::EnvironmentMap] } else { &[Flag::Environment] };
        let answers = ask(gpu, &scene, flags, &questions);
        let sky = Sky::new(scene.environment.as_ref().unwrap());
        let pairs: Vec<_> = answers
            .iter()
            .zip(&directions)
            .map(|(a, &d)| (a.value.truncate(), sky.radiance(d), format!("{d}")))
            .collect();
        compare(&format!("{width}x{height} {rows:?}"), TOLERANCE, &pairs);
    }
}

#[test]
fn spots() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(8);
    let scene = scene_of(vec![material(0, 1.0, &mut random)], false, &mut random);
    let geometry = Geometry::new(&scene);
    for falloff in [SpotFalloff::CosineSquared, SpotFalloff::AngleLinear] {
        for (inner_angle, outer_angle) in [(0.2, 0.9), (0.0, 0.6), (1.0, 1.4)] {
            let (direction, intensity) = (random.direction(), random.color() + 0.2);
            let light = Light::Spot { position: Vec3::ZERO, direction, intensity, inner_angle, outer_angle, falloff };
            let lit = Scene { lights: vec![light], ..scene.clone() };
            let reference = ReferenceLights::new(&lit, &geometry, None);
            let directions: Vec<Vec3> =
                (0..2000).map(|_| (direction + random.direction() * random.unit()).normalize()).collect();
            let questions: Vec<_> = directions
                .iter()
                .map(|d| TwinQuestion { wo: d.to_array(), kind: LIGHT, ..TwinQuestion::default() })
                .collect();
            let answers = ask(gpu, &lit, &[Flag::Punctual], &questions);
            let pairs: Vec<_> = answers
                .iter()
                .zip(&directions)
                .map(|(a, &d)| {
                    // The irradiance at a metre's distance is the intensity.
                    let sample = reference.sample(Group::Delta, d, Some(-d), Vec2::splat(0.5), &geometry, None);
                    (a.value.truncate(), sample.map_or(Vec3::ZERO, |s| s.weight), format!("{d}"))
                })
                .collect();
            compare(&format!("{falloff:?} {inner_angle} {outer_angle}"), TOLERANCE, &pairs);
        }
    }
}

/// Factors of a pattern agree by direction, for every kind of table.
#[test]
fn patterns() {
    let Some(gpu) = common::gpu() else { return };
    let mut random = Random(12);
    let scene = scene_of(vec![material(0, 1.0, &mut random)], false, &mut random);
    let geometry = Geometry::new(&scene);
    let half_extent = Vec2::new(0.9, 1.3);
    for (mapping, width, height) in [
        (Mapping::Sphere, 1, 19),
        (Mapping::Sphere, 12, 37),
        (Mapping::Image { half_extent }, 5, 4),
        (Mapping::Projection { half_extent }, 7, 1),
    ] {
        let texels = (0..width * height).map(|_| (random.color() + 0.2).to_array()).collect();
        // There are two patterns, so that the second does not begin at 0.
        let pattern = Pattern { name: String::new(), mapping, width, height, texels };
        let patterns = vec![Pattern { width: 2, height: 2, texels: vec![[0.0; 3]; 4], ..pattern.clone() }, pattern];
        let axis = random.direction();
        let right = axis.any_orthonormal_vector();
        let lamp = Lamp {
            position: Vec3::ZERO,
            world_from_lamp: Mat3::from_cols(right, right.cross(axis), -axis),
            radius: 0.0,
            intensity: random.color() + 0.5,
            cone: None,
            pattern: Some(1),
        };
        let lit = Scene { lights: vec![Light::Lamp(lamp)], patterns, ..scene.clone() };
        let reference = ReferenceLights::new(&lit, &geometry, None);
        let near = if mapping == Mapping::Sphere { 10.0 } else { 1.0 };
        let directions: Vec<Vec3> =
            (0..4000).map(|_| (axis + random.direction() * random.unit() * near).normalize()).collect();
        let questions: Vec<_> = directions
            .iter()
            .map(|d| TwinQuestion { wo: d.to_array(), kind: LIGHT, ..TwinQuestion::default() })
            .collect();
        let answers = ask(gpu, &lit, &[Flag::Punctual, Flag::Patterns], &questions);
        let pairs: Vec<_> = answers
            .iter()
            .zip(&directions)
            .map(|(a, &d)| {
                let sample = reference.sample(Group::Delta, d, Some(-d), Vec2::splat(0.5), &geometry, None);
                (a.value.truncate(), sample.map_or(Vec3::ZERO, |s| s.weight), format!("{d}"))
            })
            .collect();
        compare(&format!("{mapping:?}"), TOLERANCE, &pairs);
    }
}
