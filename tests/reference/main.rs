//! The CPU reference: scenes whose answer is derived in a comment, its BSDFs and its ray queries.

mod bsdf;
#[path = "../common/mod.rs"]
mod common;
mod glass;
mod queries;

use std::f32::consts::{FRAC_PI_2, PI};

use common::scenes::*;
use glam::{Mat3, Vec2, Vec3};
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::scene::{
    Bsdf, Environment, EnvironmentMap, Filter, Fresnel, Image, Light, Material, Opacity, Rows, Scalar, Scene, Sides,
    SpotFalloff, Texture, TextureRef, Wrap,
};

fn scene(camera: lightsheaf::scene::Camera) -> Scene {
    Scene { cameras: vec![camera], ..Scene::default() }
}

/// In walls that emit and reflect 1/2 everywhere, light of at most D - 1 bounces adds up to 1 - 2^-D.
#[test]
fn emitting_room_gives_one_minus_two_to_the_minus_depth() {
    for two_sided in [false, true] {
        let mut scene = scene(pinhole(Vec3::new(0.2, -0.1, 0.3), Vec3::new(0.5, 0.3, -1.0), 1.5));
        add(&mut scene, room(), emitter(0.5, Vec3::splat(0.5), two_sided));
        for (bounces, depth) in [(0, 2), (1, 3), (3, 5)] {
            let output = render(&scene, 16, 64, Some(bounces));
            assert_eq!(output.non_finite, 0);
            // There are 16,384 paths with a standard deviation well below 1 each.
            close(mean(&output)[1], 1.0 - 0.5_f64.powi(depth), 3e-3);
        }
        close(mean(&render(&scene, 16, 64, None))[1], 1.0, 3e-3);
    }
}

/// Canary for the test above: an albedo 1.5 % too high must not pass.
#[test]
fn canary_emitting_room_notices_a_wrong_albedo() {
    let mut scene = scene(pinhole(Vec3::ZERO, Vec3::NEG_Z, 1.5));
    add(&mut scene, room(), emitter(0.5 * 1.015, Vec3::splat(0.5), false));
    let error = mean(&render(&scene, 16, 64, None))[1] - 1.0;
    // The expected value is 0.5 / (1 - 0.5075) = 1.0152.
    assert!(error > 0.012 && error < 0.018, "{error}");
}

/// Under a sky of radiance 1 a convex white Lambertian body is invisible, for any representation of the sky.
#[test]
fn white_furnace() {
    let map = EnvironmentMap { width: 8, height: 4, texels: vec![[1.0; 3]; 32], rows: Rows::Centred };
    for map in [None, Some(map)] {
        let mut scene = scene(pinhole(Vec3::Z * 4.0, Vec3::NEG_Z, 0.8));
        add(&mut scene, sphere(2), Material::diffuse("white", Vec3::ONE));
        let sampled = map.is_some();
        scene.environment = Some(Environment { radiance: Vec3::ONE, map, world_from_environment: Mat3::IDENTITY });
        let output = render(&scene, 32, 64, None);
        if sampled {
            close(mean(&output)[0], 1.0, 2e-3);
        } else {
            for p in &output.film.pixels {
                assert!((p[0] - 1.0).abs() < 1e-4, "{p:?}: a constant sky has no noise here");
            }
        }
    }
}

/// A white conductor at normal incidence reflects the energy that single scattering keeps: int D G1 G1 / (4
/// cos_o cos_i) cos_i dw, here by quadrature over half vectors with every term written out anew.
#[test]
fn rough_conductor_keeps_what_single_scattering_keeps() {
    let alpha = 0.6_f64;
    let cos_o = 0.8_f64;
    let wo = [(1.0 - cos_o * cos_o).sqrt(), 0.0, cos_o];
    let (mut expected, n) = (0.0, 1500);
    for i in 0..n {
        for j in 0..n {
            // Directions wi are uniform in cos and azimuth.
            let (z, phi) =
                ((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(n) * std::f64::consts::TAU);
            let s = (1.0 - z * z).sqrt();
            let wi = [s * phi.cos(), s * phi.sin(), z];
            let h = [wo[0] + wi[0], wo[1] + wi[1], wo[2] + wi[2]];
            let cos_h = h[2] / (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
            let a2 = alpha * alpha;
            let d = a2 / (std::f64::consts::PI * (cos_h * cos_h * (a2 - 1.0) + 1.0).powi(2));
            let g1 = |c: f64| 2.0 * c / (c + (a2 + (1.0 - a2) * c * c).sqrt());
            expected += d * g1(cos_o) * g1(z) / (4.0 * cos_o) * std::f64::consts::TAU / f64::from(n * n);
        }
    }
    assert!(expected > 0.5 && expected < 0.99, "{expected}");
    let along = Vec3::new(-wo[0] as f32, -wo[2] as f32, 0.0);
    let mut scene = scene(parallel(-3.0 * along, along, 0.1));
    let bsdf = Bsdf::Conductor { alpha: (alpha as f32).into(), fresnel: Fresnel::None, specular: Vec3::ONE.into() };
    add(&mut scene, floor(10.0, 0.0), Material { bsdf, ..Material::diffuse("metal", Vec3::ONE) });
    let texels = vec![[1.0; 3]; 8];
    for map in [None, Some(EnvironmentMap { width: 4, height: 2, texels, rows: Rows::AtPoles })] {
        scene.environment = Some(Environment { radiance: Vec3::ONE, map, world_from_environment: Mat3::IDENTITY });
        close(mean(&render(&scene, 16, 256, Some(0)))[0], expected, 2e-3);
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
    let spot = |falloff| Light::Spot {
        position,
        direction: axis,
        intensity: Vec3::splat(3.0),
        inner_angle,
        outer_angle,
        falloff,
    };
    let ramp = (angle.cos() - outer_angle.cos()) / (inner_angle.cos() - outer_angle.cos());
    let cases = [
        (Light::Point { position, intensity: Vec3::splat(3.0) }, point),
        (spot(SpotFalloff::AngleLinear), point * 0.75),
        (spot(SpotFalloff::CosineSquared), point * ramp * ramp),
        (Light::Directional { direction: -to.normalize(), irradiance: Vec3::splat(2.0) }, 2.0 * cos),
    ];
    for (light, irradiance) in cases {
        let mut scene = scene(parallel(x + Vec3::Y, Vec3::NEG_Y, 1e-3));
        add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", albedo));
        scene.lights = vec![light];
        let output = render(&scene, 2, 4, Some(0));
        for c in 0..3 {
            close(mean(&output)[c], f64::from(albedo[c] / PI * irradiance), 1e-3);
        }
        // From below, the floor is in its own shadow.
        scene.cameras = vec![parallel(x - Vec3::Y, Vec3::Y, 1e-3)];
        assert_eq!(mean(&render(&scene, 2, 4, Some(0))), [0.0; 3]);
    }
}

/// Several lights at once add up, for any probabilities of drawing them.
#[test]
fn lights_add_up() {
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    let mut irradiance = 0.0;
    for (i, height) in [1.0, 2.0, 4.0].into_iter().enumerate() {
        let intensity = [1.0, 0.3, 20.0][i];
        scene.lights.push(Light::Point { position: Vec3::Y * height, intensity: Vec3::splat(intensity) });
        irradiance += intensity / (height * height);
    }
    scene.lights.push(Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(0.7) });
    close(mean(&render(&scene, 16, 256, Some(0)))[0], f64::from((irradiance + 0.7) / PI), 3e-3);
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

/// A quad light above a floor is visible whole, or half behind a screen whose edge runs through its middle as
/// seen from the point.
#[test]
fn area_light_with_and_without_an_occluder() {
    let lamp = quad(Vec3::new(-0.5, 1.0, -0.4), Vec3::X, Vec3::Z * 0.8);
    let whole = polygon_irradiance(Vec3::ZERO, Vec3::Y, &lamp.positions);
    let half =
        [Vec3::new(-0.5, 1.0, -0.4), Vec3::new(0.0, 1.0, -0.4), Vec3::new(0.0, 1.0, 0.4), Vec3::new(-0.5, 1.0, 0.4)];
    let half = polygon_irradiance(Vec3::ZERO, Vec3::Y, &half);
    close(f64::from(half), 0.5 * f64::from(whole), 1e-4);
    let screen = quad(Vec3::new(0.0, 0.5, -2.0), Vec3::X * 5.0, Vec3::Z * 4.0);
    for (occluded, lamp_two_sided) in [(false, false), (true, false), (false, true)] {
        // The camera looks from the side that the screen leaves free.
        let along = Vec3::new(1.0, -1.0, 0.0);
        let mut scene = scene(parallel(-0.1 * along, along, 1e-3));
        add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::splat(0.5)));
        add(&mut scene, lamp.clone(), emitter(0.0, Vec3::splat(4.0), lamp_two_sided));
        if occluded {
            add(&mut scene, screen.clone(), Material::diffuse("screen", Vec3::ZERO));
        }
        let expected = 0.5 / PI * 4.0 * if occluded { half } else { whole };
        close(mean(&render(&scene, 8, 1024, Some(0)))[1], f64::from(expected), 3e-3);
    }
    // The other side of the lamp is dark.
    let mut scene = scene(parallel(Vec3::Y * 0.1, Vec3::NEG_Y, 1e-3));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::splat(0.5)));
    add(&mut scene, inverted(lamp), emitter(0.0, Vec3::splat(4.0), false));
    assert_eq!(mean(&render(&scene, 8, 16, Some(3))), [0.0; 3]);
}

/// The emission is textured: E is that of two halves, one of them black.
#[test]
fn textured_emission() {
    let lamp = quad(Vec3::new(-0.5, 1.0, -0.4), Vec3::X, Vec3::Z * 0.8);
    let lit =
        [Vec3::new(-0.5, 1.0, -0.4), Vec3::new(0.0, 1.0, -0.4), Vec3::new(0.0, 1.0, 0.4), Vec3::new(-0.5, 1.0, 0.4)];
    let expected = 2.0 / PI * polygon_irradiance(Vec3::ZERO, Vec3::Y, &lit);
    let mut scene = scene(parallel(Vec3::Y * 0.1, Vec3::NEG_Y, 1e-3));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    let mut material = emitter(0.0, Vec3::splat(2.0), false);
    material.emission.as_mut().unwrap().radiance.texture = Some(TextureRef::new(0));
    add(&mut scene, lamp, material);
    scene.images = vec![Image { name: String::new(), width: 2, height: 1, texels: vec![[255; 4], [0, 0, 0, 255]] }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: true }];
    close(mean(&render(&scene, 8, 1024, Some(0)))[1], f64::from(expected), 3e-3);
}

/// In a diffuse sphere of radius 1 around a point light, every point receives I, and reflected light spreads
/// evenly, so that after b bounces L = albedo I / pi (1 + albedo + ... + albedo^b).
#[test]
fn point_light_in_a_sphere() {
    let mut scene = scene(pinhole(Vec3::ZERO, Vec3::new(0.3, 0.2, 1.0), 1.2));
    add(&mut scene, inverted(sphere(5)), Material::diffuse("wall", Vec3::splat(0.6)));
    scene.lights = vec![Light::Point { position: Vec3::ZERO, intensity: Vec3::splat(2.0) }];
    for bounces in [0, 1, 2, 6] {
        let expected: f64 = 0.6 * 2.0 / f64::from(PI) * (0..=bounces).map(|k| 0.6_f64.powi(k)).sum::<f64>();
        // 20,480 flat triangles are 0.03 % nearer than the sphere on average.
        close(mean(&render(&scene, 16, 64, Some(bounces as u32)))[0], expected, 2e-3);
    }
    close(mean(&render(&scene, 16, 256, None))[0], 0.6 * 2.0 / f64::from(PI) / 0.4, 3e-3);
}

/// A sky with structure over a floor has E = int L cos, by quadrature over the map's own look-up.
#[test]
fn mapped_sky_on_a_floor() {
    let (width, height) = (32, 16);
    let texel = |i: u32| [0.2, 0.3 + 0.1 * (i % 5) as f32, if i == 100 { 50.0 } else { 0.5 }];
    let map = EnvironmentMap { width, height, texels: (0..width * height).map(texel).collect(), rows: Rows::AtPoles };
    let environment =
        Environment { radiance: Vec3::ONE, map: Some(map), world_from_environment: Mat3::from_rotation_z(0.4) };
    let sky = |direction: Vec3| {
        // The sky is seen directly through an empty scene.
        let mut empty = scene(pinhole(Vec3::ZERO, direction, 1e-4));
        empty.environment = Some(environment.clone());
        empty
    };
    // The quadrature has 96 x 384 directions, uniform in cos^2 and azimuth: E = pi times their mean.
    let (mut sum, n) = ([0.0; 3], 96);
    for i in 0..n {
        for j in 0..4 * n {
            let (c2, phi) = ((i as f32 + 0.5) / n as f32, (j as f32 + 0.5) / (4 * n) as f32 * 4.0 * FRAC_PI_2);
            let s = (1.0 - c2).sqrt();
            let p = render(&sky(Vec3::new(s * phi.cos(), c2.sqrt(), s * phi.sin())), 1, 1, Some(0)).film.pixels[0];
            (0..3).for_each(|c| sum[c] += f64::from(p[c]) / f64::from(4 * n * n));
        }
    }
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::splat(0.5)));
    scene.environment = Some(environment.clone());
    let output = render(&scene, 16, 256, Some(0));
    for (actual, irradiance) in mean(&output).into_iter().zip(sum) {
        close(actual, 0.5 * irradiance, 4e-3);
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
        for albedo in [0.5, 1.0] {
            let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
            add(&mut scene, mesh.clone(), Material::diffuse("floor", Vec3::splat(albedo)));
            scene.lights = vec![Light::Directional { direction: -towards, irradiance: Vec3::ONE }];
            let actual = mean(&render(&scene, 2, 4, Some(2)))[0];
            assert!((actual - f64::from(albedo / PI * cos)).abs() < 1e-5, "{towards}: {actual}");
        }
    }
    // Seen from below, both normals flip: the cosine is that of the flipped shading normal.
    let mut below = scene(parallel(Vec3::NEG_Y, Vec3::Y, 1e-3));
    add(&mut below, mesh.clone(), Material::diffuse("floor", Vec3::ONE));
    below.lights = vec![Light::Directional { direction: Vec3::new(0.6, 0.8, 0.0), irradiance: Vec3::ONE }];
    close(mean(&render(&below, 2, 4, Some(0)))[0], f64::from(tilted.dot(Vec3::new(0.6, 0.8, 0.0)) / PI), 1e-3);
    // The camera sees the floor from behind the shading normal, which is bent until it faces the camera.
    let to_camera = Vec3::new(-0.99, 0.14, 0.0).normalize();
    let bent = (tilted + to_camera * (0.01 - tilted.dot(to_camera))).normalize();
    let mut scene = scene(parallel(to_camera, -to_camera, 1e-3));
    add(&mut scene, mesh, Material::diffuse("floor", Vec3::ONE));
    scene.lights = vec![Light::Directional { direction: Vec3::new(-0.6, -0.8, 0.0), irradiance: Vec3::ONE }];
    close(mean(&render(&scene, 2, 4, Some(0)))[0], f64::from(bent.dot(Vec3::new(0.6, 0.8, 0.0)) / PI), 1e-3);
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
    material.normal_map = Some(lightsheaf::scene::NormalMap { texture: TextureRef::new(0), scale: 1.0 });
    add(&mut scene, floor(10.0, 0.0), material);
    scene.images = vec![Image { name: String::new(), width: 1, height: 1, texels: vec![texel] }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb: false }];
    scene.lights = vec![Light::Directional { direction: -towards, irradiance: Vec3::ONE }];
    close(mean(&render(&scene, 2, 4, Some(0)))[0], f64::from(normal.dot(towards) / PI), 1e-3);
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
            let output = render(&scene, 2, 4, Some(0));
            close(mean(&output)[0], expected, 1e-3);
        }
        // The sheet casts a shadow on a floor below, with the light on its culled side.
        let mut scene = scene(parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 1e-3));
        add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
        add(&mut scene, inverted(floor(1.0, 1.0)), Material { sides, ..Material::diffuse("sheet", Vec3::ONE) });
        scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::ONE }];
        assert_eq!(mean(&render(&scene, 2, 4, Some(0))), [0.0; 3], "{sides:?}");
    }
}

/// A mask keeps the left half: holes let camera and shadow rays through.
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
    let above = render(&scene, 4, 4, Some(0)).film;
    for row in above.pixels.chunks_exact(4) {
        assert!(row[..2].iter().all(|p| (p[0] - 2.0).abs() < 1e-5), "the sheet: {row:?}");
        assert!(row[2..].iter().all(|p| (p[0] - 1.0).abs() < 1e-5), "the floor, lit through the hole: {row:?}");
    }
    scene.cameras = vec![parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 0.5)];
    let below = render(&scene, 4, 4, Some(0)).film;
    for row in below.pixels.chunks_exact(4) {
        assert!(row[..2].iter().all(|p| p[0] == 0.0) && row[2..].iter().all(|p| (p[0] - 1.0).abs() < 1e-5), "{row:?}");
    }
}

/// Row 0 is on top and column 0 on the left, for both projections; an emitter has its own radiance.
#[test]
fn cameras_see_the_right_way_up() {
    // A patch up and to the right of the axis fills one of four quadrants at distance 2.
    for (camera, half) in
        [(pinhole(Vec3::ZERO, Vec3::NEG_Z, FRAC_PI_2), 2.0), (parallel(Vec3::ZERO, Vec3::NEG_Z, 0.5), 0.5)]
    {
        let mut scene = scene(camera);
        add(
            &mut scene,
            quad(Vec3::NEG_Z * 2.0, Vec3::X * half, Vec3::Y * half),
            emitter(0.0, Vec3::new(1.0, 2.0, 3.0), false),
        );
        let film = render(&scene, 2, 16, Some(0)).film;
        assert_eq!(film.pixels, [[0.0; 3], [1.0, 2.0, 3.0], [0.0; 3], [0.0; 3]]);
    }
}

/// The same settings give the same bytes on one thread or three; another seed gives another image.
#[test]
fn images_do_not_depend_on_threads() {
    let mut scene = scene(pinhole(Vec3::ZERO, Vec3::NEG_Z, 1.5));
    add(&mut scene, room(), emitter(0.5, Vec3::splat(0.5), false));
    let on = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = ReferenceSettings {
            width: 37,
            height: 21,
            samples: 4,
            bounces: None,
            specular_bounces: 0,
            seed,
            camera: 0,
        };
        pool.install(|| Reference::new(&scene).render(&settings, &|_, _| ()))
    };
    let one = on(1, 7);
    let three = on(3, 7);
    assert_eq!(one.film, three.film);
    assert_eq!((one.rays, one.non_finite), (three.rays, 0));
    assert_ne!(one.film, on(1, 8).film);
}

/// A NaN of a light is counted and stays in the image.
#[test]
fn a_planted_nan_is_counted_not_masked() {
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 0.5));
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    scene.lights = vec![Light::Point { position: Vec3::Y * 2.0, intensity: Vec3::new(1.0, f32::NAN, 1.0) }];
    let output = render(&scene, 4, 8, Some(0));
    assert_eq!(output.non_finite, 4 * 4 * 8);
    assert_eq!(output.film.non_finite(), 4 * 4);
}

/// An empty scene is black, and progress ends at the number of pixels.
#[test]
fn empty_scene_and_progress() {
    let scene = scene(pinhole(Vec3::ZERO, Vec3::NEG_Z, 1.0));
    let last = std::sync::Mutex::new((0, 0));
    let settings =
        ReferenceSettings { width: 20, height: 17, samples: 1, bounces: None, specular_bounces: 0, seed: 0, camera: 0 };
    let output = Reference::new(&scene).render(&settings, &|done, total| {
        let mut last = last.lock().unwrap();
        *last = (last.0.max(done), total);
    });
    assert_eq!(*last.lock().unwrap(), (340, 340));
    assert!(output.film.pixels.iter().all(|p| *p == [0.0; 3]));
}

/// glTF's material with `specular` 0 is Lambertian, so that the furnace has the same answer.
#[test]
fn gltf_without_specular_is_lambertian() {
    let mut scene = scene(pinhole(Vec3::Z * 4.0, Vec3::NEG_Z, 0.8));
    let bsdf = Bsdf::MetallicRoughness {
        base_color: Vec3::ONE.into(),
        metallic: 0.0.into(),
        roughness: 0.4.into(),
        ior: 1.5,
        specular: 0.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 0.0.into(),
    };
    add(&mut scene, sphere(2), Material { bsdf, ..Material::diffuse("white", Vec3::ONE) });
    scene.environment = Some(Environment { radiance: Vec3::ONE, map: None, world_from_environment: Mat3::IDENTITY });
    for p in &render(&scene, 16, 16, None).film.pixels {
        assert!((p[0] - 1.0).abs() < 1e-4, "{p:?}");
    }
}

/// Texture coordinates reach the BSDF through the transform of the reference.
#[test]
fn textured_albedo() {
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 0.5));
    let mut material = Material::diffuse("floor", Vec3::ONE);
    let mut reference = TextureRef::new(0);
    // In the middle of a floor of side 2, a unit square has uv 0.25 to 0.75, which become 0 to 1.
    reference.transform = glam::Affine2::from_scale_angle_translation(Vec2::splat(2.0), 0.0, Vec2::splat(-0.5));
    let Bsdf::Diffuse { reflectance } = &mut material.bsdf else { unreachable!() };
    reflectance.texture = Some(reference);
    add(&mut scene, floor(1.0, 0.0), material);
    let texels = vec![[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255; 4]];
    scene.images = vec![Image { name: String::new(), width: 2, height: 2, texels }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: true }];
    scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(PI) }];
    let film = render(&scene, 2, 4, Some(0)).film;
    let expected = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]];
    for (p, e) in film.pixels.iter().zip(expected) {
        assert!((Vec3::from(*p) - Vec3::from(e)).abs().max_element() < 1e-5, "{:?}", film.pixels);
    }
}

/// Vertex colours multiply the diffuse colour and are interpolated: red to green along X, half of each in the
/// middle.
#[test]
fn vertex_colors() {
    let mut mesh = floor(1.0, 0.0);
    let (red, green) = (glam::Vec4::new(1.0, 0.0, 0.0, 1.0), glam::Vec4::new(0.0, 1.0, 0.0, 1.0));
    mesh.colors = vec![red, green, green, red];
    let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 1e-3));
    add(&mut scene, mesh, Material::diffuse("floor", Vec3::new(0.8, 0.4, 0.4)));
    scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(PI) }];
    let film = render(&scene, 1, 4, Some(0)).film;
    let expected = Vec3::new(0.4, 0.2, 0.0);
    assert!((Vec3::from(film.pixels[0]) - expected).abs().max_element() < 1e-3, "{:?}", film.pixels);
}
