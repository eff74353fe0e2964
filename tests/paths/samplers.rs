//! Every sampler draws according to its density: chi-square tests over a million draws each.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Mat3, Vec3};
use lightsheaf::gpu::{Compute, Gpu};
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{
    Boundary, Cone, Emission, Environment, Fresnel, Lamp, Light, Material, Mesh, Rows, Scene, SpotFalloff,
};
use lightsheaf::settings::{LightSampling, Settings, Technique};

use crate::common::gpu_with_ray_queries;
use crate::common::harness::answer;
use crate::common::random::Random;
use crate::common::scenes::{add, floor, pinhole, sphere};
use crate::common::shaders::{self, DrawAnswer, DrawQuestion};
use crate::common::statistics::p_value;
use crate::{scenes, settings};

/// Draws of a test.
const DRAWS: u32 = 1 << 20;
/// Significance of a test, Sidak-corrected for the number of tests.
const SIGNIFICANCE: f64 = 0.01;
/// Bins in the cosine and the azimuth.
const BINS: [usize; 2] = [32, 16];
/// Points along a side of a bin at which the density is taken.
const POINTS: usize = 32;

const DRAW_SCATTER: u32 = 0;
const PDF_SCATTER: u32 = 1;
const DRAW_SKY: u32 = 2;
const PDF_SKY: u32 = 3;
const DRAW_LIGHT: u32 = 4;
const CHOOSE_LIGHT: u32 = 5;
const PDF_RATIO: u32 = 6;

/// The samplers of a scene.
struct Oracle<'a> {
    gpu: &'a Gpu,
    renderer: PathRenderer<'a>,
    pass: Compute,
}

impl<'a> Oracle<'a> {
    fn new(gpu: &'a Gpu, scene: &Scene) -> Self {
        Self::with(gpu, scene, None)
    }

    fn with(gpu: &'a Gpu, scene: &Scene, light_sampling: Option<LightSampling>) -> Self {
        let settings = Settings { light_sampling, ..settings(Technique::RAY_QUERY, 4, 1, 1) };
        let renderer = PathRenderer::new(gpu, scene, &settings).unwrap();
        let pass = Compute::from_source(gpu, "draws", &shaders::DRAWS, &renderer.plan().flags);
        Self { gpu, renderer, pass }
    }

    fn ask(&self, questions: &[DrawQuestion]) -> Vec<DrawAnswer> {
        self.renderer.describe(0, 0, 1);
        let names = ["draw_questions", "draw_answers"];
        answer(self.gpu, &self.pass, &self.renderer.bindings(), names, questions)
    }
}

fn direction(z: f64, phi: f64) -> Vec3 {
    let r = (1.0 - z * z).max(0.0).sqrt();
    // Directions are around +Y, the floor's normal.
    Vec3::new((r * phi.cos()) as f32, z as f32, (r * phi.sin()) as f32)
}

fn bin_of(w: Vec3) -> usize {
    let row = ((f64::from(w.y) * 0.5 + 0.5) * BINS[0] as f64) as usize;
    let turn = f64::from(w.z).atan2(f64::from(w.x)).rem_euclid(TAU) / TAU;
    row.min(BINS[0] - 1) * BINS[1] + ((turn * BINS[1] as f64) as usize).min(BINS[1] - 1)
}

/// Returns the p-value of draws of directions against a density over the sphere; draws without a direction
/// have a bin of their own.
fn test_directions(oracle: &Oracle, draw: DrawQuestion, pdf: DrawQuestion) -> f64 {
    let drawn = oracle.ask(&vec![draw; DRAWS as usize]);
    let bins = BINS[0] * BINS[1];
    let mut counts = vec![0_u64; bins + 1];
    for answer in &drawn {
        let w = Vec3::from(answer.w);
        counts[if w == Vec3::ZERO { bins } else { bin_of(w) }] += 1;
    }
    let per_bin = POINTS * POINTS;
    let questions: Vec<_> = (0..bins * per_bin)
        .map(|i| {
            let (bin, point) = (i / per_bin, i % per_bin);
            let at = |index: usize, sub: usize, bins: usize| {
                (index as f64 + (sub as f64 + 0.5) / POINTS as f64) / bins as f64
            };
            let z = at(bin / BINS[1], point / POINTS, BINS[0]) * 2.0 - 1.0;
            let phi = at(bin % BINS[1], point % POINTS, BINS[1]) * TAU;
            DrawQuestion { w: direction(z, phi).to_array(), ..pdf }
        })
        .collect();
    let densities = oracle.ask(&questions);
    let solid_angle = 2.0 * TAU / (bins * per_bin) as f64;
    let mut expected: Vec<f64> = densities
        .chunks_exact(per_bin)
        .map(|bin| bin.iter().map(|a| f64::from(a.pdf_w)).sum::<f64>() * solid_angle * f64::from(DRAWS))
        .collect();
    let mass: f64 = expected.iter().sum();
    expected.push((f64::from(DRAWS) - mass).max(0.0));
    assert!(mass <= 1.001 * f64::from(DRAWS), "the density integrates to {}", mass / f64::from(DRAWS));
    p_value(&counts, &expected)
}

fn plate(material: Material) -> Scene {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::Y, Vec3::NEG_Y, 1.0)], ..Scene::default() };
    let floor = floor(1.0, 0.0);
    let tangents = vec![glam::Vec4::new(1.0, 0.0, 0.0, 1.0); floor.positions.len()];
    add(&mut scene, Mesh { tangents, ..floor }, material);
    scene
}

/// `given` is the outgoing direction, also from behind if light passes. A million draws are made of each.
#[test]
fn bsdfs_are_drawn_as_their_density_says() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let clear = Boundary::Volume { absorption: Vec3::ZERO };
    let [above, grazing] = [Vec3::new(0.3, 0.9, 0.2), Vec3::new(0.9, 0.3, -0.2)].map(Vec3::normalize);
    let materials = [
        ("diffuse", Material::diffuse("", Vec3::splat(0.7))),
        ("metal", scenes::conductor(0.4, Fresnel::None)),
        ("plastic", scenes::plastic(0.3)),
        ("glTF", scenes::gltf(0.6, 0.3, 0.0, Boundary::Sheet)),
        ("coated metal", scenes::coated(0.4, scenes::conductor(0.3, Fresnel::None))),
        ("coated plastic", scenes::coated(0.6, scenes::plastic(0.3))),
        ("coated glass", scenes::coated(0.4, scenes::glass(0.4, 1.5, clear))),
        ("sheen on metal", scenes::velvet(0.4, scenes::conductor(0.3, Fresnel::None))),
        ("sheen under a coat", scenes::coated(0.5, scenes::velvet(0.6, scenes::plastic(0.3)))),
        ("cloth", scenes::cloth(2.0, 0.7, scenes::gltf(0.5, 0.2, 0.0, Boundary::Sheet))),
        ("cloth on a volume", scenes::cloth(2.0, 0.3, scenes::gltf(0.5, 0.1, 0.6, clear))),
        (
            "translucent cloth under a coat",
            scenes::coated(
                0.5,
                scenes::translucent(0.5, scenes::cloth(2.0, 0.5, scenes::gltf(0.5, 0.0, 0.3, Boundary::Sheet))),
            ),
        ),
        ("brushed metal", scenes::stretched(0.7, scenes::conductor(0.3, Fresnel::None))),
        ("brushed glass under a coat", scenes::coated(0.6, scenes::stretched(0.6, scenes::glass(0.3, 1.5, clear)))),
        ("Beckmann metal", scenes::beckmann(scenes::conductor(0.4, Fresnel::None))),
        ("brushed Beckmann metal", scenes::beckmann(scenes::stretched(0.6, scenes::conductor(0.2, Fresnel::None)))),
        ("Beckmann plastic under a coat", scenes::coated(0.6, scenes::beckmann(scenes::plastic(0.3)))),
        ("Beckmann glass", scenes::beckmann(scenes::glass(0.4, 1.5, clear))),
        ("Beckmann sheet", scenes::beckmann(scenes::glass(0.3, 1.5, Boundary::Sheet))),
        ("film on glTF", scenes::filmed(300.0, scenes::gltf(0.6, 0.3, 0.0, Boundary::Sheet))),
        ("leaf", scenes::translucent(0.6, scenes::gltf(0.6, 0.1, 0.3, Boundary::Sheet))),
        (
            "leaf under a coat",
            scenes::coated(0.5, scenes::translucent(0.8, scenes::gltf(0.5, 0.0, 0.0, Boundary::Sheet))),
        ),
        ("glTF volume", scenes::gltf(0.6, 0.1, 0.7, clear)),
        ("glTF sheet", scenes::gltf(0.6, 0.1, 0.7, Boundary::Sheet)),
        ("glass", scenes::glass(0.4, 1.5, clear)),
        ("sheet", scenes::glass(0.4, 1.5, Boundary::Sheet)),
    ];
    let transmits = |m: &Material| m.transmits();
    let cases: Vec<_> = materials
        .iter()
        .flat_map(|(name, material)| {
            let behind = if transmits(material) { vec![-above, -grazing] } else { vec![] };
            [above, grazing].into_iter().chain(behind).map(move |given| (*name, material, given))
        })
        .collect();
    assert!(cases.len() >= 20);
    let limit = 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / cases.len() as f64);
    for (name, material, given) in &cases {
        let oracle = Oracle::new(gpu, &plate((*material).clone()));
        let question = |kind| DrawQuestion { given: given.to_array(), kind, ..Default::default() };
        let p = test_directions(&oracle, question(DRAW_SCATTER), question(PDF_SCATTER));
        println!("{name} from {given}: p {p:.4}");
        assert!(p >= limit, "{name} from {given}: {p}");
    }
    // The density of another direction differs.
    let oracle = Oracle::new(gpu, &plate(scenes::conductor(0.4, Fresnel::None)));
    let question = |kind, given: Vec3| DrawQuestion { given: given.to_array(), kind, ..Default::default() };
    let turned = (above + Vec3::X * 0.02).normalize();
    let p = test_directions(&oracle, question(DRAW_SCATTER, above), question(PDF_SCATTER, turned));
    assert!(p < 1e-6, "a canary passes: {p}");
}

/// Along the normal, where rounding makes the cosine of a direction more than 1, everything is a number.
#[test]
fn directions_along_the_normal_are_numbers() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let normals: Vec<Vec3> = {
        let mesh = sphere(4);
        let corner = |i: u32| mesh.positions[i as usize];
        let normal = |&[a, b, c]: &[u32; 3]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).normalize();
        mesh.triangles.iter().map(normal).collect()
    };
    assert!(normals.iter().filter(|n| n.dot(**n) > 1.0).count() > 100);
    let sheen = scenes::velvet(0.4, scenes::conductor(0.3, Fresnel::None));
    for material in [scenes::gltf(0.6, 0.3, 0.5, Boundary::Sheet), scenes::coated(0.4, sheen), scenes::plastic(0.3)] {
        let mut scene = plate(material.clone());
        scene.meshes.clear();
        scene.materials.clear();
        add(&mut scene, sphere(4), material);
        let oracle = Oracle::new(gpu, &scene);
        let questions = (0..16 * normals.len()).map(|i| {
            let triangle = i % normals.len();
            let given = normals[triangle].to_array();
            let kind = if i < normals.len() { PDF_SCATTER } else { DRAW_SCATTER };
            DrawQuestion { given, triangle: triangle as u32, w: given, kind }
        });
        for answer in oracle.ask(&questions.collect::<Vec<_>>()) {
            let values = [answer.w, answer.extra].concat();
            assert!(answer.pdf_w.is_finite() && values.iter().all(|v| v.is_finite()), "{answer:?}");
        }
    }
}

/// Tests draws of a mapped sky, counted per cell of the map. Within a cell, density times the sine of the
/// polar angle is bilinear in the map's coordinates, so that the value in the middle gives the integral.
fn test_map(oracle: &Oracle, sky: &Environment) -> f64 {
    let map = sky.map.as_ref().unwrap();
    let (width, height) = (map.width as usize, map.height as usize);
    let poles = map.rows == Rows::AtPoles;
    let bands = if poles { height - 1 } else { height + 1 };
    let knot = |band: usize| {
        if poles { band as f64 / bands as f64 } else { ((band as f64 - 0.5) / height as f64).clamp(0.0, 1.0) }
    };
    let questions: Vec<_> = (0..bands * width)
        .map(|i| {
            let theta = 0.5 * (knot(i / width) + knot(i / width + 1)) * PI;
            let phi = TAU * ((i % width) as f64 + 1.0) / width as f64;
            let w = DVec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin());
            let w = sky.world_from_environment * w.as_vec3();
            DrawQuestion { kind: PDF_SKY, w: w.to_array(), ..Default::default() }
        })
        .collect();
    let expected: Vec<f64> = oracle
        .ask(&questions)
        .iter()
        .enumerate()
        .map(|(i, answer)| {
            let (v0, v1) = (knot(i / width), knot(i / width + 1));
            let solid_angle = TAU * PI * (0.5 * (v0 + v1) * PI).sin() * (v1 - v0) / width as f64;
            f64::from(answer.pdf_w) * solid_angle * f64::from(DRAWS)
        })
        .collect();
    let mass = expected.iter().sum::<f64>() / f64::from(DRAWS);
    assert!((mass - 1.0).abs() < 1e-4, "the density integrates to {mass}");
    let question = DrawQuestion { kind: DRAW_SKY, ..Default::default() };
    let mut counts = vec![0_u64; expected.len()];
    for answer in oracle.ask(&vec![question; DRAWS as usize]) {
        let d = (sky.world_from_environment.transpose() * Vec3::from(answer.w)).as_dvec3();
        let v = d.y.clamp(-1.0, 1.0).acos() / PI;
        let band = if poles { v * bands as f64 } else { v * height as f64 + 0.5 };
        let x = d.x.atan2(-d.z).rem_euclid(TAU) / TAU * width as f64 - 0.5;
        counts[(band as usize).min(bands - 1) * width + x.rem_euclid(width as f64) as usize % width] += 1;
    }
    p_value(&counts, &expected)
}

#[test]
fn skies_are_drawn_as_their_density_says() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = plate(Material::diffuse("", Vec3::ONE));
    scene.environment = scenes::cornell("env").environment;
    let mut sky = scene.environment.clone().unwrap();
    for rows in [Rows::AtPoles, Rows::Centred] {
        sky.map.as_mut().unwrap().rows = rows;
        scene.environment = Some(sky.clone());
        let p = test_map(&Oracle::new(gpu, &scene), &sky);
        println!("map, {rows:?}: p {p:.4}");
        assert!(p >= SIGNIFICANCE / 3.0, "map, {rows:?}: {p}");
    }

    scene.environment = Some(Environment { map: None, ..sky });
    let question = |kind| DrawQuestion { kind, ..Default::default() };
    let p = test_directions(&Oracle::new(gpu, &scene), question(DRAW_SKY), question(PDF_SKY));
    println!("constant: p {p:.4}");
    assert!(p >= SIGNIFICANCE / 3.0, "constant: {p}");
}

/// Lights are chosen by their probability. Subpaths leave a point light uniformly, a spot uniformly over its
/// cone, and a triangle uniformly over its area and by the cosine.
#[test]
fn lights_are_drawn_as_their_density_says() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = scenes::reflecting();
    scene.lights.push(Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(0.1) });
    let oracle = Oracle::new(gpu, &scene);
    let question = DrawQuestion { kind: DRAW_LIGHT, ..Default::default() };
    let drawn = oracle.ask(&vec![question; DRAWS as usize]);
    let geometry = lightsheaf::scene::Geometry::new(&scene);
    let table = lightsheaf::render::lights::table::LightTable::new(
        &scene,
        &geometry,
        lightsheaf::render::lights::table::Hittable::All,
    );
    assert_eq!(table.records.len(), 5, "spot, point, sun and two triangles");

    let mut counts = vec![0_u64; table.records.len()];
    drawn.iter().for_each(|a| counts[a.index as usize] += 1);
    let expected: Vec<f64> = table.records.iter().map(|r| f64::from(r.probability) * f64::from(DRAWS)).collect();
    let p = p_value(&counts, &expected);
    assert!(p >= SIGNIFICANCE / 8.0, "choice: {p}");

    let mut tested = 0;
    for (index, record) in table.records.iter().enumerate() {
        let of: Vec<_> = drawn.iter().filter(|a| a.index as usize == index).collect();
        // Each draw gives a number that is uniform over [0, 1).
        let (what, evens): (&str, Vec<f64>) = match record.kind {
            0 => ("point", of.iter().map(|a| f64::from(a.w[2]) * 0.5 + 0.5).collect()),
            1 => {
                let axis = Vec3::from(record.direction);
                let even = |a: &&DrawAnswer| (1.0 - axis.dot(Vec3::from(a.w))) / record.outer_versine;
                ("spot", of.iter().map(|a| f64::from(even(a))).collect())
            }
            4 => {
                // For a cosine distribution the square of the cosine is uniform.
                ("triangle", of.iter().map(|a| f64::from(a.w[1] * a.w[1])).collect())
            }
            _ => continue,
        };
        let mut counts = [0_u64; 64];
        evens.iter().for_each(|&e| counts[((e * 64.0) as usize).min(63)] += 1);
        let p = p_value(&counts, &[evens.len() as f64 / 64.0; 64]);
        println!("{what}: {} draws, p {p:.4}", evens.len());
        assert!(p >= SIGNIFICANCE / 8.0, "{what}: {p}");
        tested += 1;
        if record.kind == 4 {
            // For points uniform over the area, the weight w of a corner has a uniform 1 - (1 - w)^2.
            let [a, b, c] = geometry.positions(record.triangle as usize);
            let area = (b - a).cross(c - a);
            let mut counts = [0_u64; 64];
            for answer in &of {
                let x = Vec3::from(answer.extra);
                let weight = f64::from((b - x).cross(c - x).dot(area) / area.length_squared()).clamp(0.0, 1.0);
                counts[(((1.0 - (1.0 - weight).powi(2)) * 64.0) as usize).min(63)] += 1;
            }
            let p = p_value(&counts, &[of.len() as f64 / 64.0; 64]);
            assert!(p >= SIGNIFICANCE / 8.0, "area: {p}");
        }
    }
    assert_eq!(tested, 4);
}

/// Returns the p-value of numbers that should be uniform over [0, 1).
fn uniform_selection(numbers: &[f64]) -> f64 {
    let mut counts = [0_u64; 64];
    numbers.iter().for_each(|&e| counts[((e * 64.0) as usize).min(63)] += 1);
    p_value(&counts, &[numbers.len() as f64 / 64.0; 64])
}

/// Subpaths leave a ball from points that are uniform over the disc seen from any side, and a sun uniformly
/// over its disc; neither depends on the direction of the subpath.
#[test]
fn lights_with_a_size_are_drawn_evenly() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = plate(Material::diffuse("", Vec3::ONE));
    let position = Vec3::new(0.3, 0.5, -0.2);
    let cone = Cone { inner_angle: 0.2, outer_angle: 0.5, falloff: SpotFalloff::AngleLinear };
    let world_from_lamp = Mat3::from_rotation_x(-0.5);
    let lamp = Lamp { position, world_from_lamp, radius: 0.25, intensity: Vec3::ONE, cone: Some(cone), pattern: None };
    let question = DrawQuestion { kind: DRAW_LIGHT, ..Default::default() };
    let limit = SIGNIFICANCE / 8.0;
    let check = |what: &str, numbers: Vec<f64>| {
        let p = uniform_selection(&numbers);
        println!("{what}: p {p:.4}");
        assert!(p >= limit, "{what}: {p}");
    };

    scene.lights = vec![Light::Lamp(lamp)];
    let drawn = Oracle::new(gpu, &scene).ask(&vec![question; DRAWS as usize]);
    let at = |a: &DrawAnswer| ((Vec3::from(a.extra) - position) / 0.25).as_dvec3();
    check("ball from Z", drawn.iter().map(|a| at(a).truncate().length_squared()).collect());
    check("ball from X", drawn.iter().map(|a| at(a).y.powi(2) + at(a).z.powi(2)).collect());
    check("ball around Z", drawn.iter().map(|a| at(a).y.atan2(at(a).x).rem_euclid(TAU) / TAU).collect());
    check("ball around X", drawn.iter().map(|a| at(a).z.atan2(at(a).y).rem_euclid(TAU) / TAU).collect());
    let axis = lamp.direction().as_dvec3();
    let cosine = |a: &DrawAnswer| (1.0 - axis.dot(Vec3::from(a.w).as_dvec3())) / (1.0 - 0.5_f64.cos());
    check("cone", drawn.iter().map(cosine).collect());
    // Each half of the ball emits the same into half of the cone.
    let quarters = drawn.iter().filter(|a| at(a).z > 0.0).map(cosine).collect();
    check("cone of half a ball", quarters);

    let direction = Vec3::new(0.3, -0.8, 0.5).normalize();
    scene.lights = vec![Light::Sun { direction, irradiance: Vec3::ONE, angle: 0.3, of_sky: false }];
    let drawn = Oracle::new(gpu, &scene).ask(&vec![question; DRAWS as usize]);
    let w = |a: &DrawAnswer| Vec3::from(a.w).as_dvec3();
    check("sun", drawn.iter().map(|a| (1.0 - w(a).dot(direction.as_dvec3())) / (1.0 - 0.3_f64.cos())).collect());
    let (x, y) = direction.as_dvec3().any_orthonormal_pair();
    check("around the sun", drawn.iter().map(|a| w(a).dot(y).atan2(w(a).dot(x)).rem_euclid(TAU) / TAU).collect());
}

/// Parts of a triangle with a textured emission are chosen by their probability, and points are uniform in
/// the part.
#[test]
fn parts_of_emitters_are_drawn_as_their_density_says() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let scene = scenes::lamps();
    let geometry = lightsheaf::scene::Geometry::new(&scene);
    let table = lightsheaf::render::lights::table::LightTable::new(
        &scene,
        &geometry,
        lightsheaf::render::lights::table::Hittable::All,
    );
    let question = DrawQuestion { kind: DRAW_LIGHT, ..Default::default() };
    let drawn = Oracle::new(gpu, &scene).ask(&vec![question; DRAWS as usize]);
    let mut counts = vec![0_u64; table.records.len()];
    let (mut checked, mut evens) = (0, Vec::new());
    for answer in &drawn {
        counts[answer.index as usize] += 1;
        let record = &table.records[answer.index as usize];
        if record.kind != 4 {
            continue;
        }
        let [a, b, c] = geometry.positions(record.triangle as usize);
        let (x, normal) = (Vec3::from(answer.extra), (b - a).cross(c - a));
        let weights = [(c - a).cross(a - x), (a - b).cross(b - x)].map(|n| n.dot(normal) / normal.length_squared());
        let [first, parts] = table.emitters[record.triangle as usize];
        // Within the part, weights run from 0 to 1 as in a triangle of its own.
        let inside = [0, 1].map(|k| f64::from((weights[k] - record.position[k]) / record.position[2]));
        assert!(inside.iter().all(|&w| w > -1e-3) && inside[0] + inside[1] < 1.001, "{weights:?} in {record:?}");
        if inside.iter().all(|&w| w > 1e-3) && inside[0] + inside[1] < 0.999 {
            assert_eq!(first + lightsheaf::scene::model::emitter::part_of(parts, weights), answer.index);
            checked += 1;
        }
        if parts > 1 {
            evens.push(1.0 - (1.0 - inside[0].clamp(0.0, 1.0)).powi(2));
        }
    }
    assert!(table.records.len() > 100 && checked > DRAWS / 4, "{} {checked}", table.records.len());
    let expected: Vec<f64> = table.records.iter().map(|r| f64::from(r.probability) * f64::from(DRAWS)).collect();
    let [choice, inside] = [p_value(&counts, &expected), uniform_selection(&evens)];
    println!("choice of {}: p {choice:.4}, inside: p {inside:.4}", counts.len());
    assert!(choice >= SIGNIFICANCE / 2.0 && inside >= SIGNIFICANCE / 2.0, "{choice} {inside}");
}

/// Surfaces choose lights with the probability that MIS uses; it sums to 1, and no light that reaches a
/// surface is left out.
#[test]
fn surfaces_choose_lights_as_their_probability_says() {
    let Some(gpu) = gpu_with_ray_queries() else { return };
    let mut scene = lightsheaf::scene::builtin::load("emitter_hall:150").unwrap();
    for (i, material) in scene.materials.iter_mut().enumerate() {
        material.emission = material.emission.map(|e| Emission { two_sided: i % 2 == 0, ..e });
    }
    scene.lights = scenes::reflecting().lights;
    scene.lights.extend((0..40).map(|i| Light::Point {
        position: Vec3::new((i % 7) as f32 - 3.0, 0.3 + (i % 5) as f32 * 0.5, (i % 6) as f32 - 2.5),
        intensity: Vec3::splat(0.01 + (i % 3) as f32),
    }));
    scene.lights.push(Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(0.1) });
    let mut random = Random(5);
    let receivers: Vec<_> = (0..24)
        .map(|i| {
            let p = Vec3::new(random.between(-4.0, 4.0), random.between(0.0, 3.0), random.between(-4.0, 4.0));
            // Receivers get light from one side, or from both.
            (p, if i % 4 == 3 { Vec3::ZERO } else { random.direction() })
        })
        .collect();
    let mut tested = 0;
    for light_sampling in [LightSampling::Uniform, LightSampling::Power, LightSampling::Tree] {
        let oracle = Oracle::with(gpu, &scene, Some(light_sampling));
        for &(p, n) in &receivers {
            let question =
                DrawQuestion { given: p.to_array(), w: n.to_array(), kind: CHOOSE_LIGHT, ..Default::default() };
            let lights = 150 + 2 + 40 + 1;
            let asked: Vec<_> =
                (0..lights).map(|triangle| DrawQuestion { kind: PDF_RATIO, triangle, ..question }).collect();
            let favours = oracle.ask(&asked);
            let mass: f64 = favours.iter().map(|a| f64::from(a.pdf_w)).sum();
            // The tree chooses nothing if no light reaches the receiver.
            assert!(mass < 1.0 + 1e-4 && (mass > 1.0 - 1e-4 || light_sampling == LightSampling::Tree), "{mass}");
            for (light, answer) in favours.iter().enumerate() {
                let reached = Vec3::from(answer.extra).max_element() > 0.0;
                assert!(!reached || answer.pdf_w > 0.0, "{light_sampling} {p} {n}: light {light} {answer:?}");
            }
            let draws = 1 << 16;
            let mut counts = vec![0_u64; favours.len() + 1];
            for answer in oracle.ask(&vec![question; draws]) {
                counts[(answer.index as usize).min(favours.len())] += 1;
                if let Some(pdf_ratio) = favours.get(answer.index as usize) {
                    assert!((answer.pdf_w / pdf_ratio.pdf_w - 1.0).abs() < 1e-4, "{answer:?} {pdf_ratio:?}");
                }
            }
            let mut expected: Vec<f64> = favours.iter().map(|a| f64::from(a.pdf_w) * draws as f64).collect();
            expected.push((1.0 - mass).max(0.0) * draws as f64);
            let chance = p_value(&counts, &expected);
            assert!(chance >= SIGNIFICANCE / 72.0, "{light_sampling} {p} {n}: {chance}");
            tested += 1;
        }
    }
    assert_eq!(tested, 72);
}
