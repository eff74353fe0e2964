//! Mirrors, glass, absorbing volumes and lenses of the reference, each against a derivation in its comment.

use std::f32::consts::PI;

use glam::{Mat3, Vec3};
use lightsheaf::reference::bsdf;
use lightsheaf::scene::{
    Boundary, Bsdf, Coat, Environment, EnvironmentMap, Fresnel, Lens, Light, Material, Mesh, Rows, Scene, Sides,
};

use super::common::scenes::*;

fn scene(camera: lightsheaf::scene::Camera) -> Scene {
    Scene { cameras: vec![camera], ..Scene::default() }
}

fn white_sky(mapped: bool) -> Option<Environment> {
    let map = EnvironmentMap { width: 8, height: 4, texels: vec![[1.0; 3]; 32], rows: Rows::Centred };
    Some(Environment { radiance: Vec3::ONE, map: mapped.then_some(map), world_from_environment: Mat3::IDENTITY })
}

fn glass(alpha: f32, eta: f32, boundary: Boundary) -> Material {
    let white = lightsheaf::scene::Color::from(Vec3::ONE);
    let bsdf = Bsdf::Dielectric { alpha: alpha.into(), eta, reflection: white, transmission: white };
    // Glass counts on both sides even if the material is one-sided.
    Material { bsdf, boundary, sides: Sides::One, ..Material::diffuse("glass", Vec3::ONE) }
}

fn gltf(roughness: f32, base: Vec3, boundary: Boundary) -> Material {
    let bsdf = Bsdf::MetallicRoughness {
        base_color: base.into(),
        metallic: 0.0.into(),
        roughness: roughness.into(),
        ior: 1.5,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 1.0.into(),
    };
    Material { bsdf, boundary, sides: Sides::OneCulled, ..Material::diffuse("glass", Vec3::ONE) }
}

const CLEAR: Boundary = Boundary::Volume { absorption: Vec3::ZERO };

/// Returns a wide slab between z = -depth and 0, fronts outwards.
fn slab(depth: f32) -> Mesh {
    let mut mesh = quad(Vec3::new(-50.0, -50.0, 0.0), Vec3::X * 100.0, Vec3::Y * 100.0);
    let back = quad(Vec3::new(50.0, -50.0, -depth), Vec3::X * -100.0, Vec3::Y * 100.0);
    mesh.triangles.extend(back.triangles.iter().map(|t| t.map(|i| i + 4)));
    mesh.positions.extend(back.positions);
    mesh.uvs = Default::default();
    mesh
}

/// Returns a wall at a depth behind z = 0 that emits towards +Z.
fn shining_wall(depth: f32, radiance: Vec3) -> (Mesh, Material) {
    (quad(Vec3::new(-90.0, -90.0, -depth), Vec3::X * 180.0, Vec3::Y * 180.0), emitter(0.0, radiance, false))
}

/// A perfect mirror shows exactly the radiance of its mirror image: light that is hit after a mirror counts
/// in full.
#[test]
fn a_mirror_shows_an_emitter_as_it_is() {
    let radiance = Vec3::new(1.0, 2.0, 3.0);
    for (fresnel, expected) in [
        (Fresnel::None, radiance * 0.5),
        // The reflectance at normal incidence is ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2).
        (Fresnel::Conductor { eta: Vec3::splat(0.5), k: Vec3::splat(2.0) }, radiance * 0.5 * (4.25 / 6.25)),
    ] {
        let mut scene = scene(parallel(Vec3::Y, Vec3::NEG_Y, 0.1));
        let bsdf = Bsdf::Conductor { alpha: 0.0.into(), fresnel, specular: Vec3::splat(0.5).into() };
        add(&mut scene, floor(1.0, 0.0), Material { bsdf, ..Material::diffuse("mirror", Vec3::ONE) });
        add(&mut scene, inverted(floor(1.0, 2.0)), emitter(0.0, radiance, false));
        for p in &render(&scene, 4, 4, Some(0)).film.pixels {
            assert!((Vec3::from(*p) - expected).abs().max_element() < 1e-5, "{p:?}, not {expected}");
        }
    }
}

/// Under a uniform environment glass of any shape is invisible; inside it radiance is denser by n^2.
#[test]
fn smooth_glass_is_invisible_in_a_white_furnace() {
    let from = Vec3::new(0.4, 0.3, 3.0);
    for eta in [1.5, 1.0 / 1.5] {
        for (body, boundary) in [(slab(0.5), CLEAR), (sphere(3), CLEAR), (room(), CLEAR), (sphere(2), Boundary::Sheet)]
        {
            let mut scene = scene(pinhole(from, -from, 0.6));
            // The room's fronts point inwards, which is a block seen from outside with an index of 1 / eta.
            add(&mut scene, body, glass(0.0, eta, boundary));
            for mapped in [false, true] {
                scene.environment = white_sky(mapped);
                close(mean(&render(&scene, 24, 64, None))[0], 1.0, 4e-3);
            }
            // Two bounces go straight through and are never ended by Russian roulette, so that pixels are
            // whole or black.
            for p in &render(&scene, 8, 1, Some(0)).film.pixels {
                assert!(p[0].abs() < 1e-5 || (p[0] - 1.0).abs() < 1e-5, "{p:?}");
            }
        }
        // The camera is near the middle of a ball; a cube would trap rays by total reflection at all faces.
        let mut scene = scene(pinhole(Vec3::new(0.1, 0.0, 0.1), Vec3::new(0.2, 0.3, 1.0), 1.0));
        add(&mut scene, sphere(3), glass(0.0, eta, CLEAR));
        scene.environment = white_sky(false);
        close(mean(&render(&scene, 24, 256, None))[0], f64::from(eta * eta), 8e-3);
    }
}

/// Canary: reflecting 1 % more than all is found.
#[test]
fn canary_glass_that_makes_light_is_noticed() {
    let mut scene = scene(pinhole(Vec3::Z * 3.0, Vec3::NEG_Z, 0.6));
    let mut material = glass(0.0, 1.5, CLEAR);
    let Bsdf::Dielectric { transmission, .. } = &mut material.bsdf else { unreachable!() };
    transmission.factor = Vec3::splat(1.01);
    add(&mut scene, sphere(3), material);
    scene.environment = white_sky(false);
    assert!(mean(&render(&scene, 24, 64, None))[0] > 1.006);
}

/// Light sampling and BSDF sampling find the same through rough glass, on both sides of it.
#[test]
fn rough_glass_gets_as_much_from_a_sky_that_is_looked_for() {
    for material in [
        glass(0.2, 1.5, CLEAR),
        glass(0.6, 1.5, CLEAR),
        glass(0.3, 1.5, Boundary::Sheet),
        gltf(0.5, Vec3::new(0.9, 0.8, 0.5), CLEAR),
        Material { dispersion: 8.0, ..gltf(0.5, Vec3::new(0.9, 0.8, 0.5), CLEAR) },
        gltf(0.5, Vec3::new(0.9, 0.8, 0.5), Boundary::Sheet),
    ] {
        let mut scene = scene(pinhole(Vec3::Z * 3.0, Vec3::NEG_Z, 0.5));
        add(&mut scene, sphere(3), material.clone());
        let found = [false, true].map(|mapped| {
            scene.environment = white_sky(mapped);
            mean(&render(&scene, 32, 256, None))
        });
        for c in 0..3 {
            close(found[1][c], found[0][c], 3e-3);
            assert!(found[0][c] > 0.2 && found[0][c] < 1.02, "{:?}: {found:?}", material.bsdf);
        }
    }
}

/// A light without extent behind a rough sheet gives the BSDF's value times the irradiance.
#[test]
fn a_light_behind_a_rough_sheet_shines_through() {
    let (roughness, base) = (0.6_f32, Vec3::new(0.9, 0.6, 0.3));
    let toward_light = Vec3::new(0.3, 0.2, -1.0).normalize();
    let model = bsdf::Bsdf::MetallicRoughness {
        base,
        metallic: 0.0,
        alpha: roughness * roughness,
        f0: Vec3::splat(0.04),
        f90: 1.0,
        transmission: 1.0,
        bend: 1.0,
        diffuse_transmission: (0.0, Vec3::ZERO),
        film: None,
        clear: false,
        disney: None,
    };
    let expected = model.evaluate(Vec3::Z, toward_light).0 * 5.0;
    assert!(expected.min_element() > 0.1);
    for along in [Vec3::NEG_Z, Vec3::Z] {
        let mut scene = scene(parallel(-along, along, 1e-3));
        add(
            &mut scene,
            quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0),
            gltf(roughness, base, Boundary::Sheet),
        );
        let direction = Vec3::new(-toward_light.x, -toward_light.y, toward_light.z * along.z);
        scene.lights = vec![Light::Directional { direction, irradiance: Vec3::splat(5.0) }];
        let found = mean(&render(&scene, 2, 4, Some(0)));
        (0..3).for_each(|c| close(found[c], f64::from(expected[c]), 1e-3));
    }
}

/// A light without extent behind a clear sheet is seen straight through it, which no sample of the sheet's BSDF finds: the
/// ground gets what neither side of a sheet of glass, or the surface of glTF's, reflects.
#[test]
fn a_light_behind_a_clear_sheet_shines_straight_on() {
    let (albedo, irradiance) = (0.5, 3.0);
    for cosine in [1.0_f32, 0.6, 0.2] {
        // Fresnel's equations for an index of 1.5, of one side.
        let beyond = (1.0 - (1.0 - cosine * cosine) / 2.25).sqrt();
        let [across, within] =
            [(cosine, 1.5 * beyond), (1.5 * cosine, beyond)].map(|(a, b)| ((a - b) / (a + b)).powi(2));
        let once = 0.5 * (across + within);
        let schlick = 0.04 + 0.96 * (1.0 - cosine).powi(5);
        for (sheet, passed) in [
            (glass(0.0, 1.5, Boundary::Sheet), (1.0 - once) / (1.0 + once)),
            (gltf(0.0, Vec3::splat(0.8), Boundary::Sheet), 0.8 * (1.0 - schlick)),
        ] {
            let mut scene = scene(parallel(Vec3::Y * 0.5, Vec3::NEG_Y, 0.1));
            add(&mut scene, floor(1.0, 0.0), Material::diffuse("ground", Vec3::splat(albedo)));
            add(&mut scene, floor(20.0, 1.0), sheet);
            let direction = Vec3::new((1.0 - cosine * cosine).sqrt(), -cosine, 0.0);
            scene.lights = vec![Light::Directional { direction, irradiance: Vec3::splat(irradiance) }];
            let expected = albedo / std::f32::consts::PI * irradiance * cosine * passed;
            close(mean(&render(&scene, 2, 16, Some(0)))[0] / f64::from(expected), 1.0, 1e-4);
        }
    }
}

/// Canary: a clear sheet is the sheet whose BSDF is sampled, in every colour. A coat of no weight makes the other one.
#[test]
fn rays_pass_a_clear_sheet_as_its_bsdf_does() {
    for mut sheet in [glass(0.0, 1.5, Boundary::Sheet), gltf(0.0, Vec3::new(0.9, 0.8, 0.6), Boundary::Sheet)] {
        if let Bsdf::Dielectric { transmission, .. } = &mut sheet.bsdf {
            transmission.factor = Vec3::new(0.7, 1.0, 0.9);
        }
        assert!(sheet.is_clear_sheet());
        let none = Coat { weight: 0.0.into(), roughness: 0.0.into(), normal_map: None };
        let sampled = Material { coat: Some(none), ..sheet.clone() };
        assert!(!sampled.is_clear_sheet());
        let found = [sheet, sampled].map(|sheet| {
            let mut scene = scene(pinhole(Vec3::new(0.0, 0.5, 2.0), Vec3::new(0.0, -0.2, -1.0), 1.0));
            add(&mut scene, floor(2.0, 0.0), Material::diffuse("ground", Vec3::splat(0.6)));
            add(&mut scene, floor(3.0, 1.0), sheet);
            add(&mut scene, inverted(floor(3.0, 1.5)), emitter(0.5, Vec3::ONE, true));
            // Rays that pass are no bounces.
            mean(&render(&scene, 32, 512, None))
        });
        (0..3).for_each(|c| close(found[0][c] / found[1][c], 1.0, 4e-3));
    }
}

/// At normal incidence, a slab of absorbing glass before a wall of radiance 1 on a black ground transmits T^2
/// A + T^2 R^2 A^3 + ... = T^2 A / (1 - R^2 A^2), with R = 0.04, T = 1 - R and A = exp(-absorption depth).
/// glTF's colour tints each passage.
#[test]
fn beer_s_law_through_a_slab() {
    let absorption = Vec3::new(0.0, 0.7, 2.0);
    let depth = 0.8;
    let base = Vec3::new(1.0, 0.9, 0.5);
    let boundary = Boundary::Volume { absorption };
    for (material, tint) in [(glass(0.0, 1.5, boundary), Vec3::ONE), (gltf(0.0, base, boundary), base)] {
        let mut scene = scene(parallel(Vec3::Z, Vec3::NEG_Z, 0.1));
        add(&mut scene, slab(depth), material);
        let (wall, light) = shining_wall(2.0, Vec3::ONE);
        add(&mut scene, wall, light);
        let found = mean(&render(&scene, 32, 256, None));
        let a = (-absorption * depth).exp();
        let (r, t) = (0.04, 0.96 * tint);
        let expected = t * t * a / (1.0 - r * r * a * a);
        (0..3).for_each(|c| close(found[c], f64::from(expected[c]), 4e-3));
    }
    // At an angle the path is longer: depth / cos of the refracted ray, sin = sin 60 / 1.5.
    let along = Vec3::new(0.0, 0.75_f32.sqrt(), -0.5);
    let mut scene = scene(parallel(-along, along, 0.1));
    add(&mut scene, slab(depth), glass(0.0, 1.5, boundary));
    let (wall, light) = shining_wall(2.0, Vec3::ONE);
    add(&mut scene, wall, light);
    let found = mean(&render(&scene, 32, 256, None));
    let cos_t = (1.0_f32 - 0.75 / 2.25).sqrt();
    let r = lightsheaf::reference::microfacet::fresnel_dielectric(0.5, 1.5);
    for c in 0..3 {
        let a = (-absorption[c] * depth / cos_t).exp();
        close(found[c], f64::from((1.0 - r).powi(2) * a / (1.0 - r * r * a * a)), 4e-3);
    }
}

/// Glass fills z < 0. At a depth of 0.3 lies a white floor, lit from above by a light without extent at a
/// depth of 0.1: the reflected light has lost exp(-absorption (0.2 + 0.3)), and leaves with T / n^2.
#[test]
fn light_that_starts_in_a_volume_is_absorbed_on_its_way() {
    let absorption = Vec3::new(0.0, 0.7, 2.0);
    let mut scene = scene(parallel(Vec3::Z, Vec3::NEG_Z, 1e-3));
    let sheet = |z: f32| quad(Vec3::new(-50.0, -50.0, z), Vec3::X * 100.0, Vec3::Y * 100.0);
    add(&mut scene, sheet(0.0), glass(0.0, 1.5, Boundary::Volume { absorption }));
    add(&mut scene, sheet(-0.3), Material::diffuse("floor", Vec3::splat(PI)));
    scene.lights = vec![Light::Point { position: Vec3::Z * -0.1, intensity: Vec3::ONE }];
    let found = mean(&render(&scene, 16, 256, Some(1)));
    for c in 0..3 {
        let expected = 0.96 / 2.25 / 0.04 * (-absorption[c] * 0.5).exp();
        close(found[c], f64::from(expected), 4e-3);
    }
}

/// An opaque surface has no inside: from behind, where glass would have total reflection, it reflects as from
/// the front.
#[test]
fn an_opaque_back_is_not_the_inside_of_glass() {
    let mut material = gltf(0.5, Vec3::new(0.9, 0.6, 0.3), CLEAR);
    let Bsdf::MetallicRoughness { transmission, .. } = &mut material.bsdf else { unreachable!() };
    *transmission = 0.0.into();
    material.sides = Sides::Two;
    let found = [1.0, -1.0].map(|side| {
        let along = Vec3::new(0.0, 0.6, -0.8 * side);
        let mut scene = scene(parallel(-along, along, 1e-3));
        add(&mut scene, quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0), material.clone());
        let direction = Vec3::new(0.0, -0.8, -0.6 * side);
        scene.lights = vec![Light::Directional { direction, irradiance: Vec3::ONE }];
        mean(&render(&scene, 2, 4, Some(0)))
    });
    assert!(found[0][2] > 0.01);
    (0..3).for_each(|c| close(found[1][c], found[0][c], 1e-4));
}

/// At normal incidence, a smooth sheet before an emissive wall transmits 1 - 2 R / (1 + R) of it as a
/// dielectric, and 1 - R times its colour in glTF's model, from both sides.
#[test]
fn a_sheet_before_a_shining_wall() {
    let base = Vec3::new(1.0, 0.9, 0.5);
    for (material, expected) in [
        (glass(0.0, 1.5, Boundary::Sheet), Vec3::splat(1.0 - 0.08 / 1.04)),
        (gltf(0.0, base, Boundary::Sheet), base * 0.96),
    ] {
        for turned in [false, true] {
            let mut scene = scene(parallel(Vec3::Z, Vec3::NEG_Z, 0.1));
            let sheet = quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0);
            add(&mut scene, if turned { inverted(sheet) } else { sheet }, material.clone());
            let (wall, light) = shining_wall(1.0, Vec3::ONE);
            add(&mut scene, wall, light);
            let found = mean(&render(&scene, 32, 256, Some(1)));
            (0..3).for_each(|c| close(found[c], f64::from(expected[c]), 2e-3));
        }
    }
}

/// A slanted ray leaves a slab parallel to itself, shifted. At 45 degrees and n = 1.5 the sine inside is
/// 0.4714, so that over a depth of 1 it rises by tan = 0.5345 instead of 1.
#[test]
fn a_slab_shifts_rays_by_snell_s_law() {
    let along = Vec3::new(0.0, 1.0, -1.0).normalize();
    let rise = 0.5345_f32;
    // The ray through the origin leaves the slab at y = rise, z = -1, and reaches the plane z = -2 at y =
    // rise + 1.
    let seen = |height: f32| {
        let mut scene = scene(parallel(-along, along, 1e-3));
        add(&mut scene, slab(1.0), glass(0.0, 1.5, CLEAR));
        let patch = quad(Vec3::new(-1.0, height - 0.01, -2.0), Vec3::X * 2.0, Vec3::Y * 0.02);
        add(&mut scene, patch, emitter(0.0, Vec3::ONE, false));
        mean(&render(&scene, 4, 256, Some(2)))[0]
    };
    assert!(seen(rise + 1.0) > 0.85);
    assert_eq!(seen(rise + 1.03), 0.0);
    assert_eq!(seen(2.0), 0.0, "where it would be without glass");
}

/// As above, with an index for each channel: 1.4, 1.5 and 1.6 for an index of 1.5 and a dispersion of 8. A strip shows
/// where red, green or blue arrives, and nothing of the other two. Both sides transmit 1 - F of it, with Schlick's F
/// at 45 degrees.
#[test]
fn a_dispersive_slab_shifts_each_channel_by_its_own_index() {
    let along = Vec3::new(0.0, 1.0, -1.0).normalize();
    let mut scene = scene(parallel(-along, along, 1e-3));
    add(&mut scene, slab(1.0), Material { dispersion: 8.0, ..gltf(0.0, Vec3::ONE, CLEAR) });
    assert_eq!(scene.materials[0].iors(), Some([1.4, 1.5, 1.6]));
    let reflected = 0.04 + 0.96 * (1.0 - 0.5_f32.sqrt()).powi(5);
    for (channel, ior) in [1.4_f32, 1.5, 1.6].into_iter().enumerate() {
        let sin = 0.5_f32.sqrt() / ior;
        let height = sin / (1.0 - sin * sin).sqrt() + 1.0;
        let mut scene = scene.clone();
        let patch = quad(Vec3::new(-1.0, height - 0.01, -2.0), Vec3::X * 2.0, Vec3::Y * 0.02);
        add(&mut scene, patch, emitter(0.0, Vec3::ONE, false));
        let found = mean(&render(&scene, 8, 192, Some(2)));
        close(found[channel], f64::from((1.0 - reflected).powi(2)), 2e-2);
        (0..3).filter(|&c| c != channel).for_each(|c| assert_eq!(found[c], 0.0, "{found:?}"));
    }
}

/// Glass that disperses light is as invisible as other glass where all light is white, and light in it is denser by the
/// square of the channel's index.
#[test]
fn dispersive_glass_is_invisible_in_a_white_furnace() {
    let from = Vec3::new(0.4, 0.3, 3.0);
    let material = Material { dispersion: 8.0, ..gltf(0.0, Vec3::ONE, CLEAR) };
    for body in [slab(0.5), sphere(3)] {
        let mut outside = scene(pinhole(from, -from, 0.6));
        add(&mut outside, body, material.clone());
        outside.environment = white_sky(false);
        let found = mean(&render(&outside, 48, 384, None));
        outside.materials[0].dispersion = 0.0;
        let plain = mean(&render(&outside, 48, 384, None));
        found.into_iter().chain(plain).for_each(|mean| close(mean, 1.0, 4e-3));
    }
    let mut inside = scene(pinhole(Vec3::new(0.1, 0.0, 0.1), Vec3::new(0.2, 0.3, 1.0), 1.0));
    add(&mut inside, sphere(3), material);
    inside.environment = white_sky(false);
    let found = mean(&render(&inside, 48, 384, None));
    (0..3).for_each(|c| close(found[c], [1.96, 2.25, 2.56][c], 1e-2));
}

/// A small emitter before or behind the plane of focus becomes a uniform disc: in the plane of focus its
/// radius is r |focus - distance| / distance, so that its variance along an axis is a quarter of that
/// squared.
#[test]
fn a_lens_blurs_by_the_circle_of_confusion() {
    let side = 64;
    for (radius, focus, distance) in [(0.1, 2.0, 4.0), (0.1, 4.0, 2.5), (0.05, 3.0, 1e3)] {
        let tangent = radius * f32::abs(focus - distance) / distance / focus;
        // The disc fills half of the image.
        let mut camera = pinhole(Vec3::ZERO, Vec3::NEG_Z, 2.0 * (2.0 * tangent).atan());
        camera.lens = Some(Lens { radius, focus });
        let mut scene = scene(camera);
        let half = 0.2 * tangent * distance;
        let patch = quad(Vec3::new(-half, -half, -distance), Vec3::X * (2.0 * half), Vec3::Y * (2.0 * half));
        add(&mut scene, patch, emitter(0.0, Vec3::ONE, false));
        let film = render(&scene, side, 1024, Some(0)).film;
        let (mut weight, mut moments, mut farthest) = (0.0, [0.0; 2], 0.0_f32);
        for (i, p) in film.pixels.iter().enumerate() {
            let at = |i: usize| ((i as f32 + 0.5) / side as f32 * 2.0 - 1.0) * 2.0 * tangent;
            let (x, y) = (at(i % side as usize), at(i / side as usize));
            weight += f64::from(p[0]);
            moments[0] += f64::from(p[0] * x * x);
            moments[1] += f64::from(p[0] * y * y);
            if p[0] > 0.0 {
                farthest = farthest.max(x.hypot(y));
            }
        }
        for moment in moments {
            // The emitter itself has a variance of a third of its half side's square.
            close(moment / weight, f64::from(tangent * tangent) * (0.25 + 0.04 / 3.0), 2e-2);
        }
        assert!(farthest < 1.3 * tangent && farthest > tangent, "{farthest} of {tangent}");
        // The light is that of the pinhole: the emitter's share of the image.
        let share = f64::from((half / distance) / (2.0 * tangent)).powi(2);
        close(weight / f64::from(side * side), share, 2e-2);
    }
}

/// In the plane of focus a lens is as sharp as a pinhole; parallel cameras have no lens.
#[test]
fn a_lens_is_sharp_in_its_plane_of_focus() {
    let patch = quad(Vec3::new(0.0, 0.0, -2.0), Vec3::X * 9.0, Vec3::Y * 9.0);
    for (mut camera, lens) in [
        (pinhole(Vec3::ZERO, Vec3::NEG_Z, PI / 2.0), Lens { radius: 0.5, focus: 2.0 }),
        (parallel(Vec3::ZERO, Vec3::NEG_Z, 1.0), Lens { radius: 0.5, focus: 1.0 }),
    ] {
        camera.lens = Some(lens);
        let mut scene = scene(camera);
        add(&mut scene, patch.clone(), emitter(0.0, Vec3::new(1.0, 2.0, 3.0), false));
        let film = render(&scene, 2, 64, Some(0)).film;
        assert_eq!(film.pixels, [[0.0; 3], [1.0, 2.0, 3.0], [0.0; 3], [0.0; 3]]);
    }
}
