//! Every kind of light in every method, against answers that are derived in a comment, and degenerate lights.

use crate::common;

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use common::scenes::{add, emitter, floor, inverted, parallel, pinhole, quad, room_with_a_window, sphere};
use common::{gpu, gpu_with_ray_queries};
use glam::{Mat3, Vec2, Vec3};
use lightsheaf::film::Film;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::render::renderer::Renderer;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{
    Camera, Cone, Filter, Image, Lamp, Light, Mapping, Material, Pattern, Scene, SpotFalloff, Texture, TextureRef, Wrap,
};
use lightsheaf::settings::{Method, Settings, Strategies, Technique, VisibilityFrom};

const METHODS: [Technique; 5] =
    [Technique::REFERENCE, Technique::PATH, Technique::RAY_QUERY, Technique::RASTER, Technique::TWIN];

/// Renders a small square picture by any method, with `samples` for each of 8x8 pixels; also returns how many
/// values are not finite. None without a device.
fn picture(scene: &Scene, technique: Technique, samples: u32, bounces: u32) -> Option<(Film, u64)> {
    let side = 8;
    let settings = Settings { technique, width: side, height: side, samples, bounces, ..Settings::plain() };
    let progressive = |renderer: &mut dyn Renderer, samples: u32| {
        renderer.render(u64::from(samples), &mut |_| true).unwrap();
        (renderer.film().unwrap(), renderer.stats().non_finite)
    };
    Some(match technique.method {
        Method::Reference => {
            let settings = ReferenceSettings {
                width: side,
                height: side,
                samples,
                bounces: Some(bounces),
                specular_bounces: 8,
                seed: 1,
                camera: 0,
            };
            let output = Reference::new(scene).render(&settings, &|_, _| ());
            (output.film, output.non_finite)
        }
        Method::Path | Method::Bdpt => {
            // Pixels have paths of their own: four times the pixels need a quarter of the samples and of the
            // dispatches.
            let (side, samples) = (2 * side, samples.div_ceil(4));
            let settings = Settings { width: side, height: side, samples, ..settings };
            let gpu = gpu_with_ray_queries()?;
            progressive(&mut PathRenderer::new(gpu, scene, &settings).unwrap(), samples)
        }
        Method::Shared => {
            let gpu = if technique.needs_ray_queries() { gpu_with_ray_queries()? } else { gpu()? };
            progressive(&mut SharedRenderer::new(gpu, scene, &settings).unwrap(), samples)
        }
    })
}

fn mean(film: &Film) -> [f64; 3] {
    [0, 1, 2].map(|c| film.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>() / film.pixels.len() as f64)
}

/// Checks the mean of the picture in every method: within half a percent, or one percent if all pixels share
/// their light samples.
fn answers(name: &str, scene: &Scene, bounces: u32, expected: Vec3) {
    METHODS.into_iter().for_each(|technique| {
        answer(name, scene, technique, if technique.shares_subpaths() { 1024 } else { 2048 }, bounces, expected)
    });
}

/// Checks scenes with little noise with few samples: direct light of a light without extent, and its
/// reflection in a sphere. Only light subpaths of `ray-query` are noisy there.
fn steady(name: &str, scene: &Scene, bounces: u32, expected: Vec3) {
    METHODS.into_iter().for_each(|technique| {
        answer(name, scene, technique, if technique == Technique::RAY_QUERY { 2048 } else { 64 }, bounces, expected);
    });
}

fn answer(name: &str, scene: &Scene, technique: Technique, samples: u32, bounces: u32, expected: Vec3) {
    let tolerance = if technique.shares_subpaths() { 0.01 } else { 0.005 };
    let Some((film, non_finite)) = picture(scene, technique, samples, bounces) else { return };
    assert_eq!(non_finite, 0, "{name}, {technique}");
    let actual = mean(&film);
    println!("{name}, {technique}: {actual:.5?} for {expected:.5}");
    for (actual, expected) in actual.into_iter().zip(expected.to_array().map(f64::from)) {
        assert!((actual - expected).abs() <= tolerance * expected, "{name}, {technique}: {actual} is not {expected}");
    }
}

/// Returns a white floor seen at a point.
fn at_floor(x: Vec3) -> Scene {
    let mut scene = Scene { cameras: vec![above(x)], ..Scene::default() };
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    scene
}

fn above(x: Vec3) -> Camera {
    parallel(x + Vec3::Y * 0.1, Vec3::NEG_Y, 1e-3)
}

fn lamp(position: Vec3, radius: f32, intensity: Vec3) -> Lamp {
    Lamp { position, world_from_lamp: Mat3::IDENTITY, radius, intensity, cone: None, pattern: None }
}

/// Adds a screen over the half x < 0 of the floor at a height of 1.
fn screen(scene: &mut Scene) {
    add(
        scene,
        quad(Vec3::new(-5.0, 1.0, -5.0), Vec3::X * 5.0, Vec3::Z * 10.0),
        Material::diffuse("screen", Vec3::ZERO),
    );
}

/// Irradiance falls with the square of the distance, so that a spherically symmetric source gives every plane
/// outside the irradiance of a point at its middle, and half of it if a screen divides it in half.
#[test]
fn lamps_with_a_radius() {
    let color = Vec3::new(3.0, 2.0, 1.0);
    let (position, x) = (Vec3::new(0.5, 2.0, -0.3), Vec3::new(-0.4, 0.0, 0.6));
    let to = position - x;
    let whole = color * (to.y / to.length().powi(3) / PI);
    let mut scene = at_floor(x);
    scene.lights = vec![Light::Lamp(lamp(position, 0.5, color))];
    answers("ball", &scene, 0, whole);

    // All of the ball is within the inner cone.
    let cone = Cone { inner_angle: 0.9, outer_angle: 1.2, falloff: SpotFalloff::CosineSquared };
    // The rotation takes -Z towards the point.
    let z = to.normalize();
    let world_from_lamp = Mat3::from_cols(Vec3::Y.cross(z).normalize(), z.cross(Vec3::Y.cross(z).normalize()), z);
    scene.lights = vec![Light::Lamp(Lamp { cone: Some(cone), world_from_lamp, ..lamp(position, 0.3, color) })];
    answers("spot ball", &scene, 0, whole);

    let mut scene = at_floor(Vec3::ZERO);
    scene.lights = vec![Light::Lamp(lamp(Vec3::Y * 2.0, 0.5, color))];
    screen(&mut scene);
    answers("half a ball", &scene, 0, color * (0.5 / (4.0 * PI)));
}

/// A uniform disc above a plane's horizon has the irradiance E cos of its middle, and half of it if it is
/// half hidden.
#[test]
fn suns_with_an_angle() {
    let color = Vec3::new(1.0, 2.0, 3.0);
    let towards = Vec3::new(0.5, 0.7, 0.2).normalize();
    for (name, towards, angle) in [("sun", towards, 0.3), ("wide sun", Vec3::Y, 1.2), ("small sun", towards, 0.005)] {
        let mut scene = at_floor(Vec3::ZERO);
        scene.lights = vec![Light::Sun { direction: -towards, irradiance: color, angle, of_sky: false }];
        answers(name, &scene, 0, color * (towards.y / PI));
    }
    let mut scene = at_floor(Vec3::ZERO);
    scene.lights = vec![Light::Sun { direction: Vec3::NEG_Y, irradiance: color, angle: 0.1, of_sky: false }];
    screen(&mut scene);
    answers("half a sun", &scene, 0, color * (0.5 / PI));
}

/// Returns factors that are linear between the angles of the entries.
fn profile() -> Pattern {
    let (width, height) = (4, 91);
    let texel = |i: u32| {
        let polar = (i / width) as f32 / (height - 1) as f32;
        let around = [1.0, 0.6, 0.2, 0.6][(i % width) as usize];
        // Directions beyond 120 degrees are dark.
        Vec3::new(1.0, around, around).map(|v| v * (1.0 - 1.5 * polar).max(0.0)).to_array()
    };
    let texels = (0..width * height).map(texel).collect();
    Pattern { name: "profile".into(), mapping: Mapping::Sphere, width, height, texels }
}

/// In the middle of a diffuse sphere of radius 1, a lamp gives a wall point L = albedo I / pi, and reflected
/// flux reaches every point alike, flux / 4 pi.
#[test]
fn profiles() {
    let turn = Mat3::from_rotation_y(0.4) * Mat3::from_rotation_x(-0.9);
    // The direction is 40 degrees off the axis, 30 degrees from +X towards +Y of the lamp.
    let (polar, around) = (40_f32.to_radians(), 30_f32.to_radians());
    let local = Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), -polar.cos());
    let factor = |around: f32| (1.0 - 1.5 * 40.0 / 180.0) * around;
    let factor = Vec3::new(factor(1.0), factor(1.0 - 0.4 / 3.0), factor(1.0 - 0.4 / 3.0));
    // The integral of (1 - 1.5 theta / pi) sin theta up to 120 degrees is 1 - 1.5 / pi sin 120 degrees.
    let flux = TAU * (1.0 - 1.5 / PI * (TAU / 3.0).sin());
    let flux = Vec3::new(flux, 0.6 * flux, 0.6 * flux);
    let intensity = Vec3::new(2.0, 3.0, 4.0);
    assert!((profile().flux(|_, _| 1.0) - flux).abs().max_element() < 1e-3 * flux.x, "{}", profile().flux(|_, _| 1.0));
    assert!((profile().outer_angle().to_degrees() - 122.0).abs() < 2.1);

    let mut scene = Scene { cameras: vec![pinhole(Vec3::ZERO, turn * local, 0.02)], ..Scene::default() };
    // The 5,120 triangles are at most 0.06 % inside the sphere.
    add(&mut scene, inverted(sphere(4)), Material::diffuse("wall", Vec3::splat(0.5)));
    scene.patterns = vec![profile()];
    let lamp = Lamp { world_from_lamp: turn, pattern: Some(0), ..lamp(Vec3::ZERO, 0.0, intensity) };
    scene.lights = vec![Light::Lamp(lamp)];
    let direct = intensity * factor * (0.5 / PI);
    let bounced = intensity * flux * (0.5 * 0.5 / (4.0 * PI * PI));
    steady("profile", &scene, 0, direct);
    steady("profile, bounced", &scene, 2, direct + bounced * 1.5);

    // A cone with the profile that is symmetric in red is cut by a hard edge.
    let cone = Some(Cone { inner_angle: 0.9, outer_angle: 0.9, falloff: SpotFalloff::AngleLinear });
    scene.lights = vec![Light::Lamp(Lamp { cone, ..lamp })];
    steady("profile in a cone", &scene, 0, direct);
    scene.cameras = vec![pinhole(Vec3::ZERO, turn * Vec3::new(0.8, 0.0, -0.6), 0.02)];
    steady("profile outside its cone", &scene, 0, Vec3::ZERO);
}

/// The axis of a spot gets I / d^2 for any angle of its cone, a point at 3/4 of the angle half of that, since
/// the falloff is linear from 1/2 on, and nothing outside. In a sphere of radius 1 all of its flux,
/// 2 pi I (1 - cos), is reflected: each point of the wall receives albedo flux / (4 pi) from the first
/// bounce, and albedo times as much from each later one, which paths from the camera alone would not find.
#[test]
fn narrow_spots() {
    let color = Vec3::new(3.0, 2.0, 1.0);
    for angle in [1e-4_f32, 1e-5] {
        let name = |what: &str| format!("{what} of {angle}");
        let spot = |position, direction, intensity, inner_angle, falloff| {
            vec![Light::Spot { position, direction, intensity, inner_angle, outer_angle: angle, falloff }]
        };
        // The floor is small, so that its points are exact to a fraction of the beam's width.
        let mut scene = Scene::default();
        add(&mut scene, floor(0.01, 0.0), Material::diffuse("floor", Vec3::ONE));
        let position = Vec3::new(0.75, 1.25, -0.75);
        scene.cameras = vec![parallel(Vec3::Y * 0.1, Vec3::NEG_Y, 0.02 * angle)];
        for falloff in [SpotFalloff::AngleLinear, SpotFalloff::CosineSquared] {
            scene.lights = spot(position, -position.normalize(), color, 0.5 * angle, falloff);
            steady(&name("axis"), &scene, 0, color * (position.y / position.length().powi(3) / PI));
        }
        // The beam points straight down: elsewhere the rounding of 32 bits moves so narrow a beam by a part
        // of its width.
        scene.lights = spot(Vec3::Y * 2.0, Vec3::NEG_Y, color, 0.5 * angle, SpotFalloff::AngleLinear);
        for (at, share) in [(0.75, 0.5), (1.25, 0.0)] {
            let from = Vec3::new(2.0 * angle * at, 0.1, 0.0);
            scene.cameras = vec![parallel(from, Vec3::NEG_Y, 0.002 * angle)];
            steady(&name("slope"), &scene, 0, color * (share / (4.0 * PI)));
        }

        let mut scene = Scene { cameras: vec![pinhole(Vec3::ZERO, Vec3::Z, 0.02)], ..Scene::default() };
        add(&mut scene, inverted(sphere(4)), Material::diffuse("wall", Vec3::splat(0.5)));
        let intensity = color / (TAU * 2.0 * (0.5 * angle).sin().powi(2));
        scene.lights = spot(Vec3::ZERO, Vec3::new(0.6, 0.48, -0.64), intensity, angle, SpotFalloff::AngleLinear);
        for (technique, samples) in [(Technique::RAY_QUERY, 512), (Technique::RASTER, 64), (Technique::TWIN, 64)] {
            answer(&name("flux"), &scene, technique, samples, 2, color * (1.5 * 0.5 * 0.5 / (4.0 * PI * PI)));
        }
    }
}

/// A lamp's power is I 2 pi (1 - cos) if its pattern is 1, also with a cone narrower than the pattern's rows;
/// for an image it is approximate, but not 0.
#[test]
fn power_of_patterns_in_narrow_cones() {
    let half_extent = Vec2::ONE;
    for angle in [1.0_f32, 1e-2, 1e-4, 1e-5] {
        let cone = Some(Cone { inner_angle: angle, outer_angle: angle, falloff: SpotFalloff::AngleLinear });
        let expected = TAU * 2.0 * (0.5 * angle).sin().powi(2);
        for (mapping, within) in [(Mapping::Sphere, 1e-3), (Mapping::Image { half_extent }, 0.5)] {
            let (name, texels) = (String::new(), vec![[1.0; 3]; 64 * 64]);
            let patterns = [Pattern { name, mapping, width: 64, height: 64, texels }];
            let power = Lamp { cone, pattern: Some(0), ..lamp(Vec3::ZERO, 0.0, Vec3::ONE) }.power(&patterns).x;
            assert!((power / expected - 1.0).abs() < within, "{mapping:?} in {angle}: {power} is not {expected}");
        }
    }
}

/// A projected image is irradiance: at distance 2 it is a quarter of that at distance 1, everywhere on the
/// plane.
#[test]
fn projectors() {
    let mut scene = Scene { cameras: vec![parallel(Vec3::Y * 3.0, Vec3::NEG_Y, 0.7)], ..Scene::default() };
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::splat(0.5)));
    let half_extent = Vec2::new(0.6, 0.4);
    scene.patterns = vec![Pattern {
        name: String::new(),
        mapping: Mapping::Projection { half_extent },
        width: 3,
        height: 2,
        texels: vec![[1.0, 0.5, 0.25]; 6],
    }];
    assert!((scene.patterns[0].flux(|_, _| 1.0).x - 4.0 * 0.6 * 0.4).abs() < 1e-5);
    let down = Mat3::from_rotation_x(-FRAC_PI_2);
    let lamp = Lamp { world_from_lamp: down, pattern: Some(0), ..lamp(Vec3::Y * 2.0, 0.0, Vec3::splat(2.0 * PI)) };
    scene.lights = vec![Light::Lamp(lamp)];
    answers("projector", &scene, 0, Vec3::new(1.0, 0.5, 0.25) * 0.25);
    // A square of that reach sees all of the image, 2.4 x 1.6 of 9, on the floor from -1.5 to 1.5.
    scene.cameras = vec![parallel(Vec3::Y * 3.0, Vec3::NEG_Y, 1.5)];
    answers("all of a projector", &scene, 0, Vec3::new(1.0, 0.5, 0.25) * (0.25 * 2.4 * 1.6 / 9.0));
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

/// Returns a lamp of 64 x 64 texels, few of them bright, seen whole from the floor, and the sum of the
/// texels' radiance.
fn textured_lamp() -> (Scene, f32) {
    let n = 64;
    let bright = |i: u32| [10_u32, 700, 2040, 2041, 3333].contains(&i) || (1000..1016).contains(&i);
    let (corner, x, y) = (Vec3::new(-0.5, 1.0, -0.4), Vec3::X, Vec3::Z * 0.8);
    let irradiance = |i: u32| {
        let at =
            |dx: u32, dy: u32| corner + x * ((i % n + dx) as f32 / n as f32) + y * ((i / n + dy) as f32 / n as f32);
        let quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
        polygon_irradiance(Vec3::ZERO, Vec3::Y, &quad) * if bright(i) { 1.0 } else { 6.0 / 255.0 }
    };
    let expected = (0..n * n).map(irradiance).sum::<f32>() * 2.0 / PI;
    let mut scene = at_floor(Vec3::ZERO);
    let mut material = emitter(0.0, Vec3::splat(2.0), false);
    material.emission.as_mut().unwrap().radiance.texture = Some(TextureRef::new(0));
    let mut lamp = quad(corner, x, y);
    // Each part of the quad has one texel of the image, row 0 at its first side.
    lamp.uvs[0] = vec![Vec2::new(0.0, 0.0), Vec2::new(1.0, 0.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 1.0)];
    add(&mut scene, lamp, material);
    let texels = (0..n * n).map(|i| if bright(i) { [255; 4] } else { [6, 6, 6, 255] }).collect();
    scene.images = vec![Image { name: String::new(), width: n, height: n, texels }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Clamp; 2], filter: Filter::Nearest, srgb: false }];
    (scene, expected)
}

#[test]
fn textured_emission() {
    let (scene, expected) = textured_lamp();
    // A draw varies by 45 %, and all pixels share it in `raster`.
    for (technique, samples) in
        [(Technique::REFERENCE, 2048), (Technique::PATH, 2048), (Technique::RAY_QUERY, 2048), (Technique::RASTER, 8192)]
    {
        answer("textured lamp", &scene, technique, samples, 0, Vec3::splat(expected));
    }
}

/// Renders a white room with a block in its middle by every method: none may hang or make a value that is not
/// finite. Returns the means of the pictures.
fn survives(name: &str, change: &dyn Fn(&mut Scene)) -> Vec<f64> {
    let mut scene = Scene {
        cameras: vec![pinhole(Vec3::new(0.3, 0.2, 0.9), Vec3::new(-0.3, -0.3, -1.0), 1.2)],
        ..Scene::default()
    };
    add(&mut scene, common::scenes::room(), Material::diffuse("room", Vec3::splat(0.5)));
    let mut block = common::scenes::room();
    block.positions.iter_mut().for_each(|p| *p *= 0.3);
    add(&mut scene, inverted(block), Material::diffuse("block", Vec3::splat(0.5)));
    change(&mut scene);
    let seen = METHODS.into_iter().filter_map(|technique| {
        let (film, non_finite) = picture(&scene, technique, 32, 2)?;
        assert_eq!((non_finite, film.non_finite()), (0, 0), "{name}, {technique}");
        Some(mean(&film).iter().sum::<f64>() / 3.0)
    });
    let seen: Vec<f64> = seen.collect();
    println!("{name}: {seen:?}");
    seen
}

fn point(position: Vec3, intensity: f32) -> Light {
    Light::Point { position, intensity: Vec3::splat(intensity) }
}

#[test]
fn odd_lights_are_survived() {
    let corner = Vec3::new(0.5, 0.7, 0.5);
    let of = |light: Light| move |scene: &mut Scene| scene.lights = vec![light];
    // A dark light is alone, and beside one that emits.
    assert!(survives("black", &of(point(corner, 0.0))).iter().all(|m| *m == 0.0));
    let one = survives("one", &of(point(corner, 1.0)));
    assert!(one.iter().all(|m| *m > 0.01), "{one:?}");
    let both = survives("black and one", &|s| s.lights = vec![point(-corner, 0.0), point(corner, 1.0)]);
    assert!(one.iter().zip(&both).all(|(a, b)| (b / a - 1.0).abs() < 0.1), "{both:?}");
    // Weak and strong lights scale the picture.
    for strength in [1e-8, 1e8] {
        let scaled = survives("scaled", &of(point(corner, strength)));
        let ratio = |(a, b): (&f64, &f64)| (b / (a * f64::from(strength)) - 1.0).abs() < 1e-3;
        assert!(one.iter().zip(&scaled).all(ratio), "{strength}: {scaled:?}");
    }
    // The light is inside the block, exactly on a wall, in its plane, and on the block's corner.
    assert!(survives("inside", &of(point(Vec3::ZERO, 1.0))).iter().all(|m| *m < 1e-9));
    survives("on a wall", &of(point(Vec3::new(0.2, 1.0, 0.1), 1.0)));
    survives("on a corner", &of(point(Vec3::splat(0.3), 1.0)));
    survives("ball through a wall", &of(Light::Lamp(lamp(Vec3::new(0.2, 1.0, 0.1), 0.2, Vec3::ONE))));
    survives("ball around all", &of(Light::Lamp(lamp(Vec3::ZERO, 3.0, Vec3::ONE))));
    survives("along a wall", &of(Light::Directional { direction: Vec3::X, irradiance: Vec3::ONE }));
    let sun = |angle| Light::Sun { direction: Vec3::NEG_Y, irradiance: Vec3::ONE, angle, of_sky: false };
    for angle in [1e-6, FRAC_PI_2] {
        survives("sun", &of(sun(angle)));
    }
    let needle = Cone { inner_angle: 0.0, outer_angle: 1e-5, falloff: SpotFalloff::CosineSquared };
    survives("needle", &of(Light::Lamp(Lamp { cone: Some(needle), ..lamp(corner, 0.0, Vec3::ONE) })));
    survives("black pattern", &|scene| {
        scene.patterns = vec![Pattern { texels: vec![[0.0; 3]; 4 * 91], ..profile() }];
        scene.lights = vec![Light::Lamp(Lamp { pattern: Some(0), ..lamp(corner, 0.0, Vec3::ONE) })];
    });
    // A triangle without area is beside another one, and alone; one lies in the plane of a wall.
    let plate = |size: f32, y: f32| {
        move |scene: &mut Scene| {
            let mut mesh = inverted(quad(Vec3::new(-0.2, y, -0.2), Vec3::X * 0.4, Vec3::Z * 0.4));
            mesh.positions[3] = mesh.positions[0] + (mesh.positions[3] - mesh.positions[0]) * size;
            add(scene, mesh, emitter(0.5, Vec3::ONE, true));
        }
    };
    let whole = survives("plate", &plate(1.0, 0.9));
    let half = survives("half of it flat", &plate(0.0, 0.9));
    assert!(whole.iter().zip(&half).all(|(w, h)| *h > 0.0 && h < w), "{half:?}");
    survives("in the wall", &plate(1.0, 1.0));
    survives("flat", &|scene| {
        plate(0.0, 0.9)(scene);
        scene.meshes.last_mut().unwrap().positions[2] = Vec3::new(0.0, 0.9, -0.2);
    });
}

#[test]
fn lights_that_are_ignored_are_named() {
    let mut scene = at_floor(Vec3::ZERO);
    scene.lights = vec![point(Vec3::Y, 0.0), point(Vec3::Y, 1.0)];
    let mut plate = quad(Vec3::Y, Vec3::X, Vec3::Z);
    plate.positions[3] = plate.positions[0];
    add(&mut scene, plate, emitter(0.5, Vec3::ONE, true));
    lightsheaf::scene::check::finish(&mut scene, std::path::Path::new("odd")).unwrap();
    for warning in [
        "1 of the scene's 2 lights have no power: they are ignored",
        "1 emissive triangles have no area: they are ignored",
    ] {
        assert!(scene.warnings.iter().any(|w| w == warning), "{:?}", scene.warnings);
    }
}

/// Asserts that the mean of pictures of several seeds is that of another within the deviation that their own means have.
fn assert_right_in_the_mean(name: &str, films: &[Film], expected: &Film) {
    let means: Vec<f64> = films.iter().map(|film| mean(film)[0] / mean(expected)[0]).collect();
    let count = means.len() as f64;
    let middle = means.iter().sum::<f64>() / count;
    let deviation = (means.iter().map(|m| (m - middle).powi(2)).sum::<f64>() / (count - 1.0) / count).sqrt();
    println!("{name}: guided over reference: {middle:.4} +- {deviation:.4}");
    assert!((middle - 1.0).abs() < 3.0 * deviation && deviation < 0.03, "{name}: {means:?}");
}

/// A room with a window, lit by the sky: light subpaths follow what the view has found of the window.
#[test]
fn the_sky_through_a_window() {
    let scene = room_with_a_window();
    let settings = |technique| Settings { technique, samples: 2048, ..Settings::plain() };
    let Some(gpu) = gpu() else { return };
    let of = |settings: Settings, guided: bool| {
        let mut renderer = SharedRenderer::new(gpu, &scene, &settings).unwrap();
        assert_eq!(renderer.plan().guides_sky, guided);
        renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
        assert_eq!(renderer.stats().non_finite, 0);
        renderer.film().unwrap()
    };
    let (expected, _) = picture(&scene, Technique::REFERENCE, 8192, 3).unwrap();
    let small = |s: Settings| Settings { width: 8, height: 8, bounces: 3, ..s };
    // Each seed is off by some 7 %, since all pixels share their light.
    let films: Vec<Film> =
        (0..8).map(|seed| of(Settings { seed, samples: 128, ..small(settings(Technique::RASTER)) }, true)).collect();
    assert_right_in_the_mean("the sky", &films, &expected);
    if let Some(rays) = gpu_with_ray_queries() {
        let mut twin = SharedRenderer::new(rays, &scene, &small(settings(Technique::TWIN))).unwrap();
        twin.render(64, &mut |_| true).unwrap();
        let grid = of(Settings { samples: 64, ..small(settings(Technique::RASTER)) }, true);
        let off = lightsheaf::metrics::compare(&twin.film().unwrap(), &grid).unwrap().rel_mse;
        assert!(off < 1e-6, "the grid against ray queries: {off}");
    }
    // Fewer samples show that it gains.
    let error = |strategies| {
        let few = small(Settings { samples: 64, strategies, ..settings(Technique::RASTER) });
        let films: Vec<Film> =
            (0..16).map(|seed| of(Settings { seed, ..few.clone() }, strategies == Strategies::All)).collect();
        films.iter().map(|film| lightsheaf::metrics::compare(film, &expected).unwrap().rel_mse).sum::<f64>() / 16.0
    };
    let (with, without) = (error(Strategies::All), error(Strategies::Bundle));
    println!("rel_mse of 64 samples: {with:.5} with VPLs, {without:.5} without");
    assert!(with < 0.5 * without, "{with} is not much less than {without}");
}

/// A sun beside the sky of that room: its light subpaths, too, start where the view has found that light comes in, and have
/// the density that MIS asks for.
#[test]
fn a_sun_through_a_window() {
    let Some(gpu) = gpu() else { return };
    for angle in [0.0, 0.05] {
        let mut scene = room_with_a_window();
        let direction = Vec3::new(0.3, -0.5, -0.8).normalize();
        scene.lights = vec![Light::Sun { direction, irradiance: Vec3::splat(30.0), angle, of_sky: false }];
        let (expected, _) = picture(&scene, Technique::REFERENCE, 8192, 3).unwrap();
        let settings = Settings { width: 8, height: 8, bounces: 3, samples: 192, ..Settings::plain() };
        let settings = Settings { technique: Technique::RASTER, ..settings };
        let of = |seed| {
            let mut renderer = SharedRenderer::new(gpu, &scene, &Settings { seed, ..settings.clone() }).unwrap();
            assert!(renderer.plan().guides_sky);
            renderer.render(u64::from(settings.samples), &mut |_| true).unwrap();
            renderer.film().unwrap()
        };
        let films: Vec<Film> = (0..16).map(of).collect();
        assert_right_in_the_mean(&format!("a sun of {angle}"), &films, &expected);
    }
}

/// A sun over a shaft that is much higher than wide: the first surface along its light is the lid, for lists and
/// for rays.
#[test]
fn the_sun_over_a_shaft() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene { cameras: vec![pinhole(Vec3::new(0.0, 20.0, 3.0), Vec3::NEG_Z, 0.5)], ..Scene::default() };
    add(&mut scene, floor(1.0, 0.0), Material::diffuse("floor", Vec3::splat(0.8)));
    add(&mut scene, floor(0.4, 20.0), Material::diffuse("lid", Vec3::splat(0.5)));
    let wall = quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::X * 2.0, Vec3::Y * 40.0);
    add(&mut scene, wall, Material::diffuse("wall", Vec3::splat(0.8)));
    scene.lights =
        vec![Light::Directional { direction: Vec3::new(0.01, -1.0, -0.02).normalize(), irradiance: Vec3::ONE }];
    let of = |visibility_from| {
        let settings =
            Settings { visibility_from, width: 16, height: 16, samples: 16, bounces: 1, ..Settings::plain() };
        let mut renderer = SharedRenderer::new(gpu, &scene, &settings).unwrap();
        renderer.render(16, &mut |_| true).unwrap();
        renderer.film().unwrap()
    };
    let (lists, grid) = (of(VisibilityFrom::Lists), of(VisibilityFrom::Grid));
    let off = lightsheaf::metrics::compare(&grid, &lists).unwrap().rel_mse;
    println!("rays against lists: rel_mse {off:e}");
    assert!(mean(&lists)[0] > 0.0 && off < 1e-6, "{off}");
}
