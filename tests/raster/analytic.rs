//! `raster` against scenes whose answer is derived in a comment, within 1 % of the mean unless said
//! otherwise.

use crate::common;

use std::f32::consts::{FRAC_PI_2, PI};

use common::scenes::{add, emitter, floor, inverted, parallel, pinhole, quad, room, sphere};
use common::{gpu, raster};
use glam::{Affine2, Mat3, Vec3};
use lightsheaf::film::Film;
use lightsheaf::scene::model::tangents;
use lightsheaf::scene::{
    Bsdf, Camera, Environment, EnvironmentMap, Filter, Fresnel, Image, Light, Material, NormalMap, Opacity, Rows,
    Scalar, Scene, Sides, SpotFalloff, Texture, TextureRef, Wrap,
};
use lightsheaf::settings::{Settings, Strategies};

/// Relative tolerance of sampled values.
const TOLERANCE: f64 = 0.01;
/// Relative tolerance of values computed without sampling.
const EXACT: f64 = 1e-4;

fn scene(camera: Camera) -> Scene {
    Scene { cameras: vec![camera], ..Scene::default() }
}

/// Returns settings of a small square picture.
fn settings(side: u32, samples: u32, bounces: u32) -> Settings {
    Settings { width: side, height: side, samples, bounces, ..Settings::plain() }
}

/// Renders a picture without device errors and non-finite values; none without a device.
fn picture(scene: &Scene, settings: &Settings) -> Option<Film> {
    let (film, stats) = raster(gpu()?, scene, settings);
    assert_eq!(stats.non_finite, 0);
    Some(film)
}

/// Returns its mean per channel.
fn mean(scene: &Scene, settings: &Settings) -> Option<[f64; 3]> {
    let film = picture(scene, settings)?;
    Some([0, 1, 2].map(|c| film.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / film.pixels.len() as f64))
}

#[track_caller]
fn close(what: &str, actual: f64, expected: f64, tolerance: f64) {
    println!("{what}: {actual} for {expected}, {:+.4} %", (actual / expected - 1.0) * 100.0);
    assert!((actual - expected).abs() <= tolerance * expected.abs(), "{what}: {actual} is not {expected}");
}

/// In walls that emit and reflect 1/2 everywhere, light of at most D - 1 bounces adds up to 1 - 2^-D.
#[test]
fn emitting_room_gives_one_minus_two_to_the_minus_depth() {
    let mut scene = scene(pinhole(Vec3::new(0.2, -0.1, 0.3), Vec3::new(0.5, 0.3, -1.0), 1.5));
    add(&mut scene, room(), emitter(0.5, Vec3::splat(0.5), false));
    for (bounces, depth) in [(0, 2), (1, 3), (3, 5)] {
        let Some(actual) = mean(&scene, &settings(16, 256, bounces)) else { return };
        close(&format!("{bounces} bounces"), actual[1], 1.0 - 0.5_f64.powi(depth), TOLERANCE);
    }
    // Canary: an albedo of 0.52 adds 0.02 * 0.5 to 0.75.
    scene.materials[0] = emitter(0.52, Vec3::splat(0.5), false);
    let Some(actual) = mean(&scene, &settings(16, 256, 0)) else { return };
    assert!(actual[1] > 0.75 * (1.0 + TOLERANCE), "{actual:?}");
}

/// Under a sky of radiance 1 a convex white Lambertian body is invisible, for any representation of the sky
/// and any BSDF model.
#[test]
fn white_furnace() {
    let map = EnvironmentMap { width: 8, height: 4, texels: vec![[1.0; 3]; 32], rows: Rows::Centred };
    let gltf = Bsdf::MetallicRoughness {
        base_color: Vec3::ONE.into(),
        metallic: 0.0.into(),
        roughness: 0.4.into(),
        ior: 1.5,
        specular: 0.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 0.0.into(),
    };
    let diffuse = Material::diffuse("white", Vec3::ONE);
    let cases = [
        ("constant", None, diffuse.clone()),
        ("map", Some(map), diffuse.clone()),
        ("glTF without specular", None, Material { bsdf: gltf, ..diffuse }),
    ];
    for (name, map, material) in cases {
        let mut scene = scene(pinhole(Vec3::Z * 4.0, Vec3::NEG_Z, 0.8));
        add(&mut scene, sphere(2), material);
        scene.environment = Some(Environment { radiance: Vec3::ONE, map, world_from_environment: Mat3::IDENTITY });
        let Some(actual) = mean(&scene, &settings(32, 256, 1)) else { return };
        close(name, actual[0], 1.0, TOLERANCE);
    }
}

/// A white conductor keeps int D G1 G1 / (4 cos_o cos_i) cos_i dw, here by quadrature over directions uniform
/// in cosine and azimuth. The roughness clamp widens the lobe at first and opens as samples grow, hence 1 %.
#[test]
fn glossy_furnace() {
    for (alpha, cos_o) in [(0.6_f64, 0.8_f64), (0.4, 0.5)] {
        let wo = [(1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o];
        let (mut expected, n) = (0.0, 1000);
        for i in 0..n {
            for j in 0..n {
                let (z, phi) =
                    ((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n) * std::f64::consts::TAU);
                let s = (1.0 - z * z).sqrt();
                let h = [wo[0] + s * phi.cos(), wo[1] + s * phi.sin(), wo[2] + z];
                let cos_h = h[2] / (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
                let a2 = alpha * alpha;
                let d = a2 / (std::f64::consts::PI * (cos_h * cos_h * (a2 - 1.0) + 1.0).powi(2));
                let g1 = |c: f64| 2.0 * c / (c + (a2 + (1.0 - a2) * c * c).sqrt());
                expected += d * g1(cos_o) * g1(z) / (4.0 * cos_o) * std::f64::consts::TAU / f64::from(n * n);
            }
        }
        let along = Vec3::new(-wo[0] as f32, -wo[2] as f32, 0.0);
        let mut scene = scene(parallel(-3.0 * along, along, 0.1));
        let bsdf = Bsdf::Conductor { alpha: (alpha as f32).into(), fresnel: Fresnel::None, specular: Vec3::ONE.into() };
        add(&mut scene, floor(10.0, 0.0), Material { bsdf, ..Material::diffuse("metal", Vec3::ONE) });
        scene.environment =
            Some(Environment { radiance: Vec3::ONE, map: None, world_from_environment: Mat3::IDENTITY });
        let Some(actual) = mean(&scene, &settings(2, 2048, 0)) else { return };
        close(&format!("alpha {alpha}"), actual[0], expected, TOLERANCE);
    }
}

/// A Lambertian floor under a light without extent has L = albedo / pi * E, with E = I cos / d^2 for a point,
/// E cos for parallel light, times the falloff for a spot.
#[test]
fn lights_without_extent() {
    let albedo = Vec3::new(0.2, 0.5, 0.8);
    let position = Vec3::new(0.5, 2.0, -0.3);
    let x = Vec3::new(-0.4, 0.0, 0.6);
    let to = position - x;
    let cos = to.y / to.length();
    let point = 3.0 * cos / to.length_squared();
    let axis = Vec3::new(0.2, -1.0, 0.1).normalize();
    let angle = axis.dot(-to.normalize()).acos();
    let (inner_angle, outer_angle) = (angle - 0.1, angle + 0.3);
    let intensity = Vec3::splat(3.0);
    let spot = |falloff| Light::Spot { position, direction: axis, intensity, inner_angle, outer_angle, falloff };
    let ramp = (angle.cos() - outer_angle.cos()) / (inner_angle.cos() - outer_angle.cos());
    let cases = [
        ("point", Light::Point { position, intensity }, point),
        ("spot, linear", spot(SpotFalloff::AngleLinear), point * 0.75),
        ("spot, squared", spot(SpotFalloff::CosineSquared), point * ramp * ramp),
        ("directional", Light::Directional { direction: -to.normalize(), irradiance: Vec3::splat(2.0) }, 2.0 * cos),
    ];
    for (name, light, irradiance) in cases {
        let mut scene = scene(parallel(x + Vec3::Y, Vec3::NEG_Y, 1e-3));
        add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", albedo));
        scene.lights = vec![light];
        let Some(actual) = mean(&scene, &settings(2, 4, 2)) else { return };
        for c in 0..3 {
            // The camera sees a square millimetre or four.
            close(name, actual[c], f64::from(albedo[c] / PI * irradiance), 1e-3);
        }
        // From below, the floor is in its own shadow.
        scene.cameras = vec![parallel(x - Vec3::Y, Vec3::Y, 1e-3)];
        assert_eq!(mean(&scene, &settings(2, 4, 2)), Some([0.0; 3]), "{name}");
    }
}

/// Several lights at once add up, though each iteration draws one of them.
#[test]
fn lights_add_up() {
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    let mut irradiance = 0.7;
    for (height, intensity) in [(1.0, 1.0), (2.0, 0.3), (4.0, 20.0)] {
        scene.lights.push(Light::Point { position: Vec3::Y * height, intensity: Vec3::splat(intensity) });
        irradiance += intensity / (height * height);
    }
    scene.lights.push(Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(0.7) });
    let Some(actual) = mean(&scene, &settings(2, 1024, 0)) else { return };
    close("four lights", actual[0], f64::from(irradiance / PI), TOLERANCE);
}

/// Returns the irradiance of a Lambertian polygon on a facing plane (Lambert's formula): E = L / 2 sum_i
/// angle_i (n . normal_i).
fn polygon_irradiance(x: Vec3, normal: Vec3, corners: &[Vec3]) -> f32 {
    let directions: Vec<Vec3> = corners.iter().map(|c| (*c - x).normalize()).collect();
    let edge = |i: usize| {
        let (a, b) = (directions[i], directions[(i + 1) % directions.len()]);
        a.dot(b).acos() * a.cross(b).normalize().dot(normal)
    };
    0.5 * (0..directions.len()).map(edge).sum::<f32>().abs()
}

/// A wide lamp above a floor is visible whole, or half behind a screen whose edge runs through its middle as
/// seen from the point; one of its sides is dark, or half of it is black by a texture.
#[test]
fn shining_square_with_and_without_an_occluder() {
    let lamp = quad(Vec3::new(-1.5, 1.0, -1.5), Vec3::X * 3.0, Vec3::Z * 3.0);
    let whole = polygon_irradiance(Vec3::ZERO, Vec3::Y, &lamp.positions);
    let half = [(-1.5, -1.5), (0.0, -1.5), (0.0, 1.5), (-1.5, 1.5)].map(|(x, z)| Vec3::new(x, 1.0, z));
    let half = polygon_irradiance(Vec3::ZERO, Vec3::Y, &half);
    assert!((half / whole - 0.5).abs() < 1e-4);
    let screen = quad(Vec3::new(0.0, 0.5, -2.0), Vec3::X * 5.0, Vec3::Z * 4.0);
    for (occluded, two_sided, textured) in
        [(false, false, false), (true, false, false), (false, true, false), (false, false, true)]
    {
        // The camera looks from the side that the screen leaves free.
        let along = Vec3::new(1.0, -1.0, 0.0);
        let mut scene = scene(parallel(-0.1 * along, along, 1e-3));
        add(&mut scene, floor(4.0, 0.0), Material::diffuse("floor", Vec3::splat(0.5)));
        let mut material = emitter(0.0, Vec3::splat(4.0), two_sided);
        if textured {
            material.emission.as_mut().unwrap().radiance.texture = Some(TextureRef::new(0));
            let texels = vec![[255; 4], [0, 0, 0, 255]];
            scene.images = vec![Image { name: String::new(), width: 2, height: 1, texels }];
            scene.textures = vec![Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: true }];
        }
        add(&mut scene, lamp.clone(), material);
        if occluded {
            add(&mut scene, screen.clone(), Material::diffuse("screen", Vec3::ZERO));
        }
        let expected = 0.5 / PI * 4.0 * if occluded || textured { half } else { whole };
        let settings = Settings { bundle_resolution: Some(32), ..settings(2, 1024, 0) };
        let Some(actual) = mean(&scene, &settings) else { return };
        let what = format!("occluded {occluded}, two-sided {two_sided}, textured {textured}");
        close(&what, actual[1], f64::from(expected), TOLERANCE);
    }
    // The other side of the lamp is dark.
    let mut scene = scene(parallel(Vec3::Y * 0.1, Vec3::NEG_Y, 1e-3));
    add(&mut scene, floor(4.0, 0.0), Material::diffuse("floor", Vec3::splat(0.5)));
    add(&mut scene, inverted(lamp), emitter(0.0, Vec3::splat(4.0), false));
    let Some(actual) = mean(&scene, &settings(2, 16, 2)) else { return };
    assert_eq!(actual, [0.0; 3]);
}

/// In a diffuse sphere of radius 1 around a point light, every point receives I, and reflected light spreads
/// evenly, so that after b bounces L = albedo I / pi (1 + albedo + ... + albedo^b), for every set of
/// strategies.
#[test]
fn point_light_in_a_sphere() {
    let mut scene = scene(pinhole(Vec3::ZERO, Vec3::new(0.3, 0.2, 1.0), 1.2));
    add(&mut scene, inverted(sphere(3)), Material::diffuse("wall", Vec3::splat(0.6)));
    scene.lights = vec![Light::Point { position: Vec3::ZERO, intensity: Vec3::splat(2.0) }];
    let Some(direct) = mean(&scene, &settings(16, 16, 0)) else { return };
    // 1,280 flat triangles are 0.5 % nearer than the sphere on average, so that reflected light is compared
    // with their direct light.
    close("direct light", direct[0], 0.6 * 2.0 / f64::from(PI), TOLERANCE);
    let mut checked = 0;
    for strategies in [Strategies::All, Strategies::Vpl, Strategies::Bundle, Strategies::Paper] {
        for bounces in [1, 2, 6] {
            // The paper's set ends at two bounces, which it clamps.
            if bounces > 1 && strategies == Strategies::Paper || bounces == 6 && strategies != Strategies::All {
                continue;
            }
            let expected = direct[0] * (0..=bounces).map(|k| 0.6_f64.powi(k)).sum::<f64>();
            let samples = if bounces == 6 { 512 } else { 256 };
            let Some(actual) = mean(&scene, &Settings { strategies, ..settings(8, samples, bounces as u32) }) else {
                return;
            };
            close(&format!("{strategies}, {bounces} bounces"), actual[0], expected, TOLERANCE);
            checked += 1;
        }
    }
    assert_eq!(checked, 8);
}

/// A sky that grows linearly with height over a floor is integrated by quadrature: with L = a + b y, y the
/// cosine of the polar angle, E = int L cos dw = pi a + 2 pi b / 3. The map holds L at its rows, which reach
/// the poles; 64 rows make its interpolation exact to 1e-3.
#[test]
fn mapped_sky_on_a_floor() {
    let (width, height) = (8, 64);
    let (a, b) = (Vec3::new(0.2, 0.5, 1.0), Vec3::new(1.0, 0.7, 0.0));
    let row = |r: u32| (a + b * (PI * r as f32 / (height - 1) as f32).cos().max(0.0)).to_array();
    let texels = (0..height).flat_map(|r| (0..width).map(move |_| r)).map(row).collect();
    let map = EnvironmentMap { width, height, texels, rows: Rows::AtPoles };
    // Sky and floor rotated together by 90 degrees give the same result.
    for turn in [Mat3::IDENTITY, Mat3::from_rotation_z(FRAC_PI_2)] {
        let up = turn * Vec3::Y;
        let mut scene = scene(parallel(up, -up, 1e-3));
        let mut mesh = floor(10.0, 0.0);
        mesh.positions.iter_mut().for_each(|p| *p = turn * *p);
        add(&mut scene, mesh, Material::diffuse("floor", Vec3::splat(0.5)));
        scene.environment =
            Some(Environment { radiance: Vec3::ONE, map: Some(map.clone()), world_from_environment: turn });
        let Some(actual) = mean(&scene, &settings(2, 512, 0)) else { return };
        for c in 0..3 {
            close("sky", actual[c], f64::from(0.5 / PI * (PI * a[c] + 2.0 * PI * b[c] / 3.0)), TOLERANCE);
        }
    }
}

/// Vertex normals are tilted by 30 degrees: the cosine is the shading normal's, and light counts only on the
/// viewer's side of both normals.
#[test]
fn shading_normals_that_differ_from_geometric_ones() {
    let tilted = Vec3::new(0.5, 0.75_f32.sqrt(), 0.0);
    let mut mesh = floor(10.0, 0.0);
    mesh.normals = vec![tilted; 4];
    let cases = [
        // Each entry is the direction towards the light and the expected cosine.
        (Vec3::new(0.6, 0.8, 0.0), tilted.dot(Vec3::new(0.6, 0.8, 0.0))),
        // This one is above the shading horizon and below the floor.
        (Vec3::new(0.99, -0.14, 0.0).normalize(), 0.0),
        // This one is above the floor and below the shading horizon.
        (Vec3::new(-0.99, 0.14, 0.0).normalize(), 0.0),
    ];
    for (towards, cos) in cases {
        let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
        add(&mut scene, mesh.clone(), Material::diffuse("floor", Vec3::splat(0.5)));
        scene.lights = vec![Light::Directional { direction: -towards, irradiance: Vec3::ONE }];
        let Some(actual) = mean(&scene, &settings(2, 4, 2)) else { return };
        assert!((actual[0] - f64::from(0.5 / PI * cos)).abs() < 1e-5, "{towards}: {actual:?}");
    }
    // Seen from below, both normals flip: the cosine is that of the flipped shading normal.
    let mut below = scene(parallel(Vec3::NEG_Y, Vec3::Y, 1e-3));
    add(&mut below, mesh.clone(), Material::diffuse("floor", Vec3::ONE));
    below.lights = vec![Light::Directional { direction: Vec3::new(0.6, 0.8, 0.0), irradiance: Vec3::ONE }];
    let Some(actual) = mean(&below, &settings(2, 4, 0)) else { return };
    close("from below", actual[0], f64::from(tilted.dot(Vec3::new(0.6, 0.8, 0.0)) / PI), EXACT);
    // The camera sees the floor from behind the shading normal, which is bent until it faces the camera.
    let to_camera = Vec3::new(-0.99, 0.14, 0.0).normalize();
    let bent = (tilted + to_camera * (0.01 - tilted.dot(to_camera))).normalize();
    let mut scene = scene(parallel(to_camera, -to_camera, 1e-3));
    add(&mut scene, mesh, Material::diffuse("floor", Vec3::ONE));
    scene.lights = vec![Light::Directional { direction: Vec3::new(-0.6, -0.8, 0.0), irradiance: Vec3::ONE }];
    let Some(actual) = mean(&scene, &settings(2, 4, 0)) else { return };
    close("from behind", actual[0], f64::from(bent.dot(Vec3::new(0.6, 0.8, 0.0)) / PI), EXACT);
}

/// A normal map of one texel that leans 30 degrees towards +u gives the same cosine as vertex normals would.
#[test]
fn normal_maps_bend_the_shading_normal() {
    let code = |v: f32| ((v * 0.5 + 0.5) * 255.0).round() as u8;
    let texel = [code(0.5), code(0.0), code(0.75_f32.sqrt()), 255];
    let decoded = Vec3::new(f32::from(texel[0]), f32::from(texel[1]), f32::from(texel[2])) / 255.0 * 2.0 - 1.0;
    // u of a floor runs along +X and the image's up along -Z.
    let normal = Vec3::new(decoded.x, decoded.z, -decoded.y).normalize();
    let towards = Vec3::new(0.6, 0.8, 0.0);
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
    let mut material = Material::diffuse("floor", Vec3::ONE);
    material.normal_map = Some(NormalMap { texture: TextureRef::new(0), scale: 1.0 });
    let mut mesh = floor(10.0, 0.0);
    // Loaders generate tangents for normal maps in the same way.
    tangents::generate(&mut mesh, 0, Affine2::IDENTITY);
    add(&mut scene, mesh, material);
    scene.images = vec![Image { name: String::new(), width: 1, height: 1, texels: vec![texel] }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb: false }];
    scene.lights = vec![Light::Directional { direction: -towards, irradiance: Vec3::ONE }];
    let Some(actual) = mean(&scene, &settings(2, 4, 0)) else { return };
    close("normal map", actual[0], f64::from(normal.dot(towards) / PI), 1e-3);
}

/// Backs reflect, are black, or are culled for the camera; all cast shadows.
#[test]
fn sides() {
    for (sides, front, back) in [(Sides::Two, 1.0, 1.0), (Sides::One, 1.0, 0.0), (Sides::OneCulled, 1.0, 9.0)] {
        for (from, expected) in [(Vec3::Y, front), (Vec3::NEG_Y, back)] {
            let mut scene = scene(parallel(from, -from, 1e-3));
            add(&mut scene, floor(10.0, 0.0), Material { sides, ..Material::diffuse("sheet", Vec3::splat(PI)) });
            // A wall behind the sheet emits 9 towards the camera only, so that the sheet blocks its light for
            // no other point.
            let wall = if from.y > 0.0 { floor(10.0, -2.0) } else { inverted(floor(10.0, 2.0)) };
            add(&mut scene, wall, emitter(0.0, Vec3::splat(9.0), false));
            scene.lights = vec![Light::Directional { direction: -from, irradiance: Vec3::ONE }];
            // As in the paper, emitters start no light subpaths, so that nothing here is random.
            let settings = Settings { strategies: Strategies::Paper, ..settings(2, 4, 0) };
            let Some(actual) = mean(&scene, &settings) else { return };
            close(&format!("{sides:?} from {from}"), actual[0], expected, EXACT);
        }
        // The sheet casts a shadow on a floor below, with the light on its culled side.
        let mut scene = scene(parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 1e-3));
        add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
        add(&mut scene, inverted(floor(1.0, 1.0)), Material { sides, ..Material::diffuse("sheet", Vec3::ONE) });
        scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE }];
        assert_eq!(mean(&scene, &settings(2, 4, 0)), Some([0.0; 3]), "{sides:?}");
    }
}

/// A mask keeps the left half: holes let camera, light and bundles through.
#[test]
fn alpha_masks_cut_holes_for_all_rays() {
    let mut scene = scene(parallel(Vec3::Y * 3.0, Vec3::NEG_Y, 0.5));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::splat(PI)));
    let mut material = Material::diffuse("sheet", Vec3::splat(2.0 * PI));
    let value = Scalar { factor: 1.0, texture: Some((TextureRef::new(0), 3)) };
    material.opacity = Some(Opacity::CutOut { value, cutoff: 0.5 });
    add(&mut scene, floor(1.0, 1.0), material);
    scene.images = vec![Image { name: String::new(), width: 2, height: 1, texels: vec![[255; 4], [255, 255, 255, 0]] }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: false }];
    scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE }];
    let Some(above) = picture(&scene, &settings(4, 4, 0)) else { return };
    for row in above.pixels.chunks_exact(4) {
        assert!(row[..2].iter().all(|p| (p[0] - 2.0).abs() < 1e-4), "the sheet: {row:?}");
        assert!(row[2..].iter().all(|p| (p[0] - 1.0).abs() < 1e-4), "the floor, lit through the hole: {row:?}");
    }
    scene.cameras = vec![parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 0.5)];
    let Some(below) = picture(&scene, &settings(4, 4, 0)) else { return };
    for row in below.pixels.chunks_exact(4) {
        assert!(row[..2].iter().all(|p| p[0] == 0.0) && row[2..].iter().all(|p| (p[0] - 1.0).abs() < 1e-4), "{row:?}");
    }
    // A floor under a sheet that is all hole and a sky of 1 is as bright as without the sheet.
    scene.images[0].texels = vec![[255, 255, 255, 0]; 2];
    scene.lights.clear();
    scene.materials[0] = Material::diffuse("floor", Vec3::splat(0.5));
    scene.environment = Some(Environment { radiance: Vec3::ONE, map: None, world_from_environment: Mat3::IDENTITY });
    let Some(actual) = mean(&scene, &settings(4, 256, 0)) else { return };
    close("all hole", actual[0], 0.5, TOLERANCE);
}

/// Row 0 is on top and column 0 on the left, for both projections; an emitter has its own radiance.
#[test]
fn cameras_see_the_right_way_up() {
    // A patch up and to the right of the axis fills one of four quadrants at distance 2.
    for (camera, half) in
        [(pinhole(Vec3::ZERO, Vec3::NEG_Z, FRAC_PI_2), 2.0), (parallel(Vec3::ZERO, Vec3::NEG_Z, 0.5), 0.5)]
    {
        let mut scene = scene(camera);
        let patch = quad(Vec3::NEG_Z * 2.0, Vec3::X * half, Vec3::Y * half);
        add(&mut scene, patch, emitter(0.0, Vec3::new(1.0, 2.0, 3.0), false));
        let Some(film) = picture(&scene, &settings(2, 16, 0)) else { return };
        assert_eq!(film.pixels, [[0.0; 3], [1.0, 2.0, 3.0], [0.0; 3], [0.0; 3]]);
    }
}

/// Each pixel shows a quarter of a texture, in four colours.
#[test]
fn textured_albedo() {
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1.0));
    let mut material = Material::diffuse("floor", Vec3::ONE);
    let Bsdf::Diffuse { reflectance } = &mut material.bsdf else { unreachable!() };
    reflectance.texture = Some(TextureRef::new(0));
    add(&mut scene, floor(1.0, 0.0), material);
    let texels = vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255; 4]];
    scene.images = vec![Image { name: String::new(), width: 2, height: 2, texels }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: true }];
    scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(PI) }];
    let Some(film) = picture(&scene, &settings(2, 4, 0)) else { return };
    let expected = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
    for (p, e) in film.pixels.iter().zip(expected) {
        assert!((Vec3::from(*p) - Vec3::from(e)).abs().max_element() < 1e-4, "{:?}", film.pixels);
    }
}
