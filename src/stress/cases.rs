//! The stress tests.

use std::f32::consts::PI;
use std::path::Path;

use glam::{Affine3A, Vec3};

use super::scenes::{apart, cornell, ground, mean, noon, noon_ground, parallel, pinhole, placed, point, range, sky};
use super::{Case, Seen, Stage};
use crate::film::Film;
use crate::gpu::Gpu;
use crate::reference::{Reference, ReferenceSettings};
use crate::render;
use crate::scene::model::shapes::{add, quad, room};
use crate::scene::{
    Bsdf, Environment, EnvironmentMap, Filter, Geometry, Image, Instance, Light, Material, Mesh, Rows, Scene,
    SpotFalloff, Texture, TextureRef, Wrap, check,
};
use crate::settings::{Settings, Technique};

/// All methods that need a device.
const ALL: &[Technique] = &[Technique::RASTER, Technique::TWIN, Technique::PATH, Technique::RAY_QUERY];
/// Methods whose direct light of one light has no noise.
const QUIET: &[Technique] = &[Technique::RASTER, Technique::TWIN, Technique::PATH];
/// The method of cases about rasterized lists, and of cases that do not depend on the method.
const RASTER: &[Technique] = &[Technique::RASTER];

const fn case(name: &'static str, right: &'static str, methods: &'static [Technique], run: fn(&Stage) -> Seen) -> Case {
    Case { name, right, methods, long: false, run }
}

/// All cases.
pub const CASES: &[Case] = &[
    case("scale 1e-6", SCALED, ALL, |stage| scaled(stage, 1e-6)),
    case("scale 1e-3", SCALED, ALL, |stage| scaled(stage, 1e-3)),
    case("scale 1e3", SCALED, ALL, |stage| scaled(stage, 1e3)),
    case("scale 1e6", SCALED, ALL, |stage| scaled(stage, 1e6)),
    case("offset 1e2 m", "the picture of a box of 2 m does not change: mean within 0.5 %", ALL, |stage| {
        moved(stage, 1e2, 0.005)
    }),
    case("offset 1e4 m", "the same within 2 %: f32 coordinates are 1 mm apart", ALL, |stage| moved(stage, 1e4, 0.02)),
    case("offset 1e6 m", "the same within 25 %: f32 coordinates are 6 cm apart", ALL, |stage| moved(stage, 1e6, 0.25)),
    case("slivers", "500 slivers of a micron's width do not change the picture: mean within 0.5 %", ALL, slivers),
    case("zero-area triangles", "they do not change the picture, bit for bit", ALL, zero_area),
    case("vertices not finite", "an error that names the mesh and the vertex", RASTER, wrong_vertices),
    case("zero and denormal normals", "the triangle's normal replaces them: picture within 1e-5", ALL, odd_normals),
    case("normals not finite", "they are replaced, with a warning: picture within 1e-5", ALL, wrong_normals),
    case("scale of zero", "an instance without extent does not change the picture, bit for bit", ALL, |stage| {
        rescaled(stage, Vec3::ZERO)
    }),
    case("scale of zero on one axis", "its flat picture is finite", ALL, flattened),
    case("mirrored scale", "a mirrored instance equals mirrored vertices: within 1e-4", ALL, mirrored),
    case("roughness 0", ROUGH, ALL, |stage| rough(stage, 0.0)),
    case("roughness 1e-4", ROUGH, ALL, |stage| rough(stage, 1e-4)),
    case("roughness 0.01", ROUGH, ALL, |stage| rough(stage, 0.01)),
    case("roughness 0.1", ROUGH, ALL, |stage| rough(stage, 0.1)),
    case("roughness 0.5", ROUGH, ALL, |stage| rough(stage, 0.5)),
    case("roughness 1", ROUGH, ALL, |stage| rough(stage, 1.0)),
    case(
        "grazing camera",
        "white ground under vertical light is 1, seen at 0.06 degrees: within 1e-4 (ray-query: mean within 2 %)",
        ALL,
        grazing_camera,
    ),
    case("grazing light", "ground under light at 0.006 degrees elevation is 1e-4: within 1 %", ALL, grazing_light),
    case("coplanar faces", "duplicated faces do not change the picture: mean within 0.01 %", ALL, coplanar),
    case("wall of 1 mm in a room of 10 m", WALL, ALL, wall),
    case("wall of 1 mm, fast", WALL, &[Technique::FAST], wall),
    case(
        "vpl on the shaded point",
        "finite and not black, in a box where f32 coordinates are 25 cm apart",
        ALL,
        vpl_on_the_point,
    ),
    case("narrow spot", "ground in beams of 1e-3 to 1e-5 radians is I albedo / (pi d^2): within 1 %", ALL, narrow_spot),
    case(
        "light in a corner",
        "a light a micron off two walls: direct light within 1 % of the reference",
        ALL,
        light_in_a_corner,
    ),
    case("intensity 1e-8", DIMMED, ALL, |stage| lit(stage, 1e-8)),
    case("intensity 1e8", DIMMED, ALL, |stage| lit(stage, 1e8)),
    case("hdr texels of 65504", HDR, ALL, |stage| bright_sky(stage, 65504.0)),
    case("hdr texels of 1e9", HDR, ALL, |stage| bright_sky(stage, 1e9)),
    case("camera inside a box", "lit by a light inside, and at most 1e-9 of that by a light outside", ALL, inside),
    case("camera on a surface", "its picture is finite", ALL, on_a_surface),
    case("one pixel", "white ground under vertical light is 1: within 1e-5 (ray-query: 2 %)", ALL, |stage| {
        sized(stage, 1, 1)
    }),
    case("16384 pixels wide", WIDE, ALL, |stage| sized(stage, 16_384, 2)),
    case("16384 pixels high", WIDE, ALL, |stage| sized(stage, 2, 16_384)),
    case("empty scene", "the sky alone, within 1e-6", ALL, empty),
    case("one triangle", "under vertical light it is 1, and the background is black", ALL, one_triangle),
    case("10,000 meshes", "ground of 10,000 pieces is 1: within 1e-4 (ray-query: mean within 2 %)", ALL, meshes),
    case("5,000 textures", "each piece of the ground has its own colour: within 1e-2", QUIET, textures),
    case("lists without room", "they grow and no node is lost: picture within 1e-5", RASTER, overflow),
    Case {
        long: true,
        ..case("1e9 pixel-samples", "white ground under vertical light is 1: within 1e-5", RASTER, long_run)
    },
    case("lost device", "an error that says so, and a new device renders", RASTER, lost_device),
];

const SCALED: &str = "the picture of the box does not change: mean within 0.5 %, every pixel within 5 % of the mean";
const ROUGH: &str = "rough metal under a constant sky: mean within 1 % of the reference";
const WALL: &str = "at most 0.1 % of the light leaks through the wall";
const WIDE: &str = "every pixel is 1 within 1e-5 (ray-query: mean within 2 %), or an error names the limit";
const DIMMED: &str = "the picture is proportional to the light: within 1e-4";
const HDR: &str = "under a constant sky white ground is proportional to its radiance: within 1e-4";

fn small(samples: u32) -> Settings {
    Settings { width: 16, height: 16, samples, ..Settings::plain() }
}

fn within(what: &str, value: f64, limit: f64) -> Seen {
    let text = format!("{what} {value:.2e}");
    if value <= limit { Ok(text) } else { Err(format!("{text}, above {limit:.0e}")) }
}

/// Combines observed results; wrong if one of them is.
fn all(seen: impl IntoIterator<Item = Seen>) -> Seen {
    let (mut texts, mut right) = (Vec::new(), true);
    for one in seen {
        right &= one.is_ok();
        texts.push(one.unwrap_or_else(|e| e));
    }
    if right { Ok(texts.join(", ")) } else { Err(texts.join(", ")) }
}

/// Largest relative difference between the values of a picture and a number.
fn even(film: &Film, expected: f32) -> f64 {
    let [low, high] = range(film);
    f64::from((high - expected).max(expected - low) / expected)
}

/// Checks that a picture is constant. With `ray-query` only its mean is checked, since light subpaths that
/// are connected to the camera cause noise.
fn is_even(stage: &Stage, film: &Film, expected: f32, limit: f64) -> Seen {
    if stage.method == Technique::RAY_QUERY {
        return within("mean off by", (mean(film) / f64::from(expected) - 1.0).abs(), 0.02);
    }
    within("off by", even(film, expected), limit)
}

fn same_bits(film: &Film, expected: &Film) -> Seen {
    let differ =
        film.pixels.iter().flatten().zip(expected.pixels.iter().flatten()).filter(|(a, b)| a.to_bits() != b.to_bits());
    match differ.count() {
        0 => Ok(format!("the same bits, mean {:.3}", mean(film))),
        count => Err(format!("{count} values differ, at most by {:.1e}", apart(film, 1.0, expected)[1])),
    }
}

fn reference(scene: &Scene, settings: &Settings, samples: u32) -> Film {
    let settings = ReferenceSettings { samples, seed: 1, ..ReferenceSettings::of(settings) };
    Reference::new(scene).render(&settings, &|_, _| ()).film
}

fn scaled(stage: &Stage, scale: f32) -> Seen {
    let scene = cornell()?;
    let [film, expected] = [scale, 1.0].map(|scale| stage.render(&placed(&scene, scale, Vec3::ZERO), &small(16)));
    let [mean, worst] = apart(&film?.0, 1.0, &expected?.0);
    all([within("mean off by", mean, 0.005), within("worst pixel", worst, 0.05)])
}

fn moved(stage: &Stage, metres: f32, limit: f64) -> Seen {
    let scene = cornell()?;
    let (film, _) = stage.render(&placed(&scene, 1.0, Vec3::new(metres, -0.5 * metres, 0.7 * metres)), &small(16))?;
    let [mean, worst] = apart(&film, 1.0, &stage.render(&scene, &small(16))?.0);
    all([within("mean off by", mean, limit), Ok(format!("worst pixel {worst:.1e}"))])
}

/// Returns 500 triangles of the given width between points of the box.
fn needles(width: f32) -> Mesh {
    let mut mesh = Mesh { name: "needles".to_owned(), ..Mesh::default() };
    for i in 0..500_u16 {
        // The points are on a spiral that fills the box.
        let at = |t: f32| Vec3::new((2.4 * t).cos() * 0.9, 0.1 + 1.7 * (0.37 * t).sin().abs(), (2.4 * t).sin() * 0.9);
        let (a, b) = (at(f32::from(i)), at(f32::from(i) + 0.4));
        let first = mesh.positions.len() as u32;
        mesh.positions.extend([a, b, a + (b - a) * 0.5 + (b - a).any_orthonormal_vector() * width]);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

fn slivers(stage: &Stage) -> Seen {
    let plain = cornell()?;
    let mut scene = plain.clone();
    add(&mut scene, needles(1e-6), Material::diffuse("needles", Vec3::splat(0.5)));
    if Geometry::new(&scene).triangles.len() < 400 {
        return Err("there are no slivers".to_owned());
    }
    // The slivers' size would make the views finer, which would change the VPLs.
    let resolution = (stage.method == Technique::RASTER).then_some(128);
    let settings = Settings {
        bundle_resolution: resolution,
        light_resolution: resolution,
        vpl_resolution: resolution,
        ..small(32)
    };
    let of = |scene: &Scene| stage.render(scene, &settings);
    within("mean off by", apart(&of(&scene)?.0, 1.0, &of(&plain)?.0)[0], 0.005)
}

fn zero_area(stage: &Stage) -> Seen {
    let plain = cornell()?;
    let mut scene = plain.clone();
    let mut mesh = needles(0.0);
    // Some triangles have the same corner twice, others have the same point three times.
    mesh.triangles.iter_mut().step_by(2).for_each(|t| t[2] = t[0]);
    mesh.triangles.iter_mut().step_by(3).for_each(|t| *t = [t[0]; 3]);
    mesh.triangles.retain(|t| t[2] == t[0] || t[1] == t[0]);
    add(&mut scene, mesh, Material::diffuse("needles", Vec3::splat(0.5)));
    same_bits(&stage.render(&scene, &small(8))?.0, &stage.render(&plain, &small(8))?.0)
}

fn wrong_vertices(_: &Stage) -> Seen {
    all([f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(|value| {
        let mut scene = cornell()?;
        scene.meshes[2].positions[1].y = value;
        let name = scene.meshes[2].name.clone();
        match check::finish(&mut scene, Path::new("stress")) {
            Err(e) if e.to_string().contains(&format!("`{name}`")) && e.to_string().contains("vertex 1") => {
                Ok(e.to_string())
            }
            Err(e) => Err(format!("the error does not say where: {e}")),
            Ok(()) => Err(format!("a coordinate of {value} is taken")),
        }
    }))
}

/// Renders the box with the given normal at every vertex, and without vertex normals.
fn with_normals(stage: &Stage, normal: Vec3) -> Result<(Film, Film, Scene), String> {
    let mut plain = cornell()?;
    plain.meshes.iter_mut().for_each(|m| m.normals.clear());
    let mut scene = plain.clone();
    for mesh in &mut scene.meshes {
        // A vertex without a normal takes that of its first triangle, so flat faces need vertices of their
        // own.
        let corners = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]).collect::<Vec<_>>();
        mesh.triangles = (0..corners.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        mesh.normals = vec![normal; corners.len()];
        mesh.positions = corners;
        mesh.uvs = Default::default();
    }
    check::finish(&mut scene, Path::new("stress")).map_err(|e| e.to_string())?;
    Ok((stage.render(&scene, &small(8))?.0, stage.render(&plain, &small(8))?.0, scene))
}

fn odd_normals(stage: &Stage) -> Seen {
    all([("zero", Vec3::ZERO), ("denormal", Vec3::new(1e-40, -1e-42, 1e-41))].map(|(name, normal)| {
        let (film, expected, _) = with_normals(stage, normal)?;
        within(name, apart(&film, 1.0, &expected)[1], 1e-5)
    }))
}

fn wrong_normals(stage: &Stage) -> Seen {
    all([f32::NAN, f32::INFINITY].map(|value| {
        let (film, expected, scene) = with_normals(stage, Vec3::new(0.0, value, 1.0))?;
        let warned = scene.warnings.iter().any(|w| w.contains("not finite"));
        let warned = if warned { Ok("with a warning".to_owned()) } else { Err("without a warning".to_owned()) };
        all([within("picture", apart(&film, 1.0, &expected)[1], 1e-5), warned])
    }))
}

fn rescaled(stage: &Stage, scale: Vec3) -> Seen {
    let plain = cornell()?;
    let mut scene = plain.clone();
    let world_from_local = Affine3A::from_scale(scale);
    scene.instances.push(Instance { mesh: 0, world_from_local });
    same_bits(&stage.render(&scene, &small(8))?.0, &stage.render(&plain, &small(8))?.0)
}

fn flattened(stage: &Stage) -> Seen {
    let mut scene = cornell()?;
    let last = scene.instances.len() - 1;
    scene.instances[last].world_from_local = Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0));
    let seen = mean(&stage.render(&scene, &small(8))?.0);
    if seen > 0.01 { Ok(format!("mean {seen:.3}")) } else { Err(format!("black: mean {seen:.1e}")) }
}

fn mirrored(stage: &Stage) -> Seen {
    let plain = cornell()?;
    let mirror = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
    let mut by_instance = plain.clone();
    by_instance.instances.iter_mut().for_each(|i| i.world_from_local = mirror);
    let mut by_corners = plain;
    for mesh in &mut by_corners.meshes {
        mesh.positions.iter_mut().for_each(|p| p.x = -p.x);
        mesh.normals.iter_mut().for_each(|n| n.x = -n.x);
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    // If the front faces were reversed, the black backs would be visible.
    for scene in [&mut by_instance, &mut by_corners] {
        scene.materials.iter_mut().for_each(|m| m.sides = crate::scene::Sides::One);
    }
    let (film, _) = stage.render(&by_instance, &small(8))?;
    let [_, worst] = apart(&film, 1.0, &stage.render(&by_corners, &small(8))?.0);
    within("worst pixel", worst, 1e-4)
}

fn rough(stage: &Stage, roughness: f32) -> Seen {
    let bsdf = Bsdf::MetallicRoughness {
        base_color: Vec3::ONE.into(),
        metallic: 1.0.into(),
        roughness: roughness.into(),
        ior: 1.5,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 0.0.into(),
    };
    let along = Vec3::new(0.6, -0.8, 0.0);
    let mut scene =
        Scene { cameras: vec![parallel(-4.0 * along, along, 0.5)], environment: Some(sky(1.0)), ..Scene::default() };
    add(&mut scene, ground(4.0), Material { bsdf, ..Material::diffuse("metal", Vec3::ONE) });
    let settings = Settings { bounces: 1, ..small(256) };
    let (seen, expected) = (mean(&stage.render(&scene, &settings)?.0), mean(&reference(&scene, &settings, 64)));
    all([Ok(format!("{seen:.4} for {expected:.4}")), within("off by", (seen / expected - 1.0).abs(), 0.01)])
}

fn grazing_camera(stage: &Stage) -> Seen {
    let mut scene = Scene { lights: vec![noon()], ..Scene::default() };
    add(&mut scene, ground(1000.0), Material::diffuse("ground", Vec3::ONE));
    scene.cameras = vec![parallel(Vec3::Y * 0.5, Vec3::new(1.0, -1e-3, 0.0), 0.2)];
    let parallel_seen = is_even(stage, &stage.render(&scene, &Settings { bounces: 0, ..small(4) })?.0, 1.0, 1e-4);
    // The camera is two metres above the ground, and the lower half of the image is ground.
    scene.cameras = vec![pinhole(Vec3::Y * 2.0, Vec3::X, 0.2)];
    let (film, _) = stage.render(&scene, &Settings { bounces: 0, ..small(4) })?;
    let lower = Film { height: 7, pixels: film.pixels[16 * 9..].to_vec(), ..film };
    all([parallel_seen, is_even(stage, &lower, 1.0, 1e-4)])
}

fn grazing_light(stage: &Stage) -> Seen {
    let mut scene = noon_ground();
    let direction = Vec3::new(1.0, -1e-4, 0.0).normalize();
    scene.lights = vec![Light::Directional { direction, irradiance: Vec3::splat(PI) }];
    let (film, _) = stage.render(&scene, &Settings { bounces: 0, ..small(8) })?;
    within("off by", even(&film, 1e-4), 0.01)
}

fn coplanar(stage: &Stage) -> Seen {
    let plain = cornell()?;
    let mut scene = plain.clone();
    scene.instances.extend(plain.instances.clone());
    let [mean, worst] = apart(&stage.render(&scene, &small(64))?.0, 1.0, &stage.render(&plain, &small(64))?.0);
    all([within("mean off by", mean, 1e-4), Ok(format!("worst pixel {worst:.1e}"))])
}

fn divided_room() -> Scene {
    let mut scene = Scene { lights: vec![point(Vec3::new(-2.0, 1.0, 0.5), 100.0)], ..Scene::default() };
    add(&mut scene, room(5.0), Material::diffuse("room", Vec3::splat(0.7)));
    for (x, side) in [(-5e-4, 1.0), (5e-4, -1.0)] {
        let mesh = quad(Vec3::new(x, -5.0, -5.0 * side), Vec3::Z * (10.0 * side), Vec3::Y * 10.0);
        add(&mut scene, mesh, Material::diffuse("wall", Vec3::splat(0.7)));
    }
    scene.cameras = [-4.5, 4.5].map(|x| pinhole(Vec3::new(x, 0.0, 0.0), Vec3::X * -x, 1.2)).to_vec();
    scene
}

fn wall(stage: &Stage) -> Seen {
    let scene = divided_room();
    let side = |camera| stage.render(&scene, &Settings { camera, ..small(64) }).map(|(film, _)| mean(&film));
    let (lit, dark) = (side(0)?, side(1)?);
    if lit < 0.01 {
        return Err(format!("the lit side is dark: {lit:.1e}"));
    }
    within("share of the light", dark / lit, 1e-3)
}

fn vpl_on_the_point(stage: &Stage) -> Seen {
    // At 3,000 km a wall of 2 m has 81 representable positions for thousands of vertices, so that many of
    // them coincide.
    let (film, _) = stage.render(&placed(&cornell()?, 1.0, Vec3::splat(3e6)), &small(32))?;
    let seen = mean(&film);
    if seen > 0.01 { Ok(format!("mean {seen:.3}")) } else { Err(format!("mean {seen:.1e}")) }
}

fn narrow_spot(stage: &Stage) -> Seen {
    let angles = [1e-3_f32, 1e-4, 1e-5];
    all(angles.map(|angle| {
        // The camera sees only points inside the inner cone.
        let mut scene = Scene { cameras: vec![parallel(Vec3::Y, Vec3::NEG_Y, 0.1 * angle)], ..Scene::default() };
        add(&mut scene, ground(1.0), Material::diffuse("ground", Vec3::splat(0.5)));
        scene.lights = vec![Light::Spot {
            position: Vec3::Y * 2.0,
            direction: Vec3::NEG_Y,
            intensity: Vec3::splat(8.0),
            inner_angle: 0.5 * angle,
            outer_angle: angle,
            falloff: SpotFalloff::AngleLinear,
        }];
        let (film, _) = stage.render(&scene, &small(16))?;
        within("off by", even(&film, 8.0 * 0.5 / (PI * 4.0)), 0.01)
    }))
}

fn light_in_a_corner(stage: &Stage) -> Seen {
    // The camera looks away from the light, since only light tracing finds the bright spot next to it.
    let mut scene = Scene { cameras: vec![pinhole(Vec3::splat(-0.5), Vec3::ONE, 1.0)], ..Scene::default() };
    add(&mut scene, room(1.0), Material::diffuse("room", Vec3::splat(0.5)));
    scene.lights = vec![point(Vec3::new(1e-6 - 1.0, 1e-6 - 1.0, 0.0), 1.0)];
    // Most of the indirect light comes from that spot; only its finiteness is checked.
    stage.render(&scene, &small(32))?;
    let settings = Settings { bounces: 0, ..small(256) };
    let (seen, expected) = (mean(&stage.render(&scene, &settings)?.0), mean(&reference(&scene, &settings, 256)));
    all([Ok(format!("{seen:.4} for {expected:.4}")), within("off by", (seen / expected - 1.0).abs(), 0.01)])
}

fn lit(stage: &Stage, factor: f32) -> Seen {
    let plain = cornell()?;
    let mut scene = plain.clone();
    for light in &mut scene.lights {
        if let Light::Point { intensity, .. } = light {
            *intensity *= factor;
        }
    }
    let film = stage.render(&scene, &small(16))?.0;
    let [_, worst] = apart(&film, 1.0 / f64::from(factor), &stage.render(&plain, &small(16))?.0);
    within("worst pixel", worst, 1e-4)
}

fn bright_sky(stage: &Stage, radiance: f32) -> Seen {
    let of = |radiance: f32| {
        let mut scene = noon_ground();
        scene.lights.clear();
        let map = EnvironmentMap { width: 4, height: 2, texels: vec![[radiance; 3]; 8], rows: Rows::Centred };
        scene.environment = Some(Environment { map: Some(map), ..sky(1.0) });
        stage.render(&scene, &small(32))
    };
    let (film, one) = (of(radiance)?.0, of(1.0)?.0);
    all([
        within("worst pixel", apart(&film, 1.0 / f64::from(radiance), &one)[1], 1e-4),
        // The tolerance covers the noise of few samples that all pixels share.
        within("ground against sky", (mean(&one) - 1.0).abs(), 0.3),
    ])
}

fn inside(stage: &Stage) -> Seen {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::ZERO, Vec3::new(0.3, -0.2, -1.0), 1.2)], ..Scene::default() };
    add(&mut scene, room(1.0), Material::diffuse("room", Vec3::splat(0.5)));
    let mut of = |position| {
        scene.lights = vec![point(position, 10.0)];
        stage.render(&scene, &small(16)).map(|(film, _)| mean(&film))
    };
    let (outside, inside) = (of(Vec3::new(0.1, 3.0, 0.2))?, of(Vec3::new(0.5, 0.5, 0.5))?);
    let text = format!("{outside:.1e} with the light outside, {inside:.3} inside");
    if outside <= 1e-9 * inside && inside > 0.1 { Ok(text) } else { Err(text) }
}

fn on_a_surface(stage: &Stage) -> Seen {
    let mut scene = Scene { lights: vec![point(Vec3::splat(0.5), 1.0)], ..Scene::default() };
    add(&mut scene, room(1.0), Material::diffuse("room", Vec3::splat(0.5)));
    // The camera is on a wall, in its plane, and in a corner.
    let places =
        [(Vec3::new(0.1, 0.2, 1.0), Vec3::NEG_Z), (Vec3::new(0.1, 0.2, 1.0), Vec3::X), (Vec3::ONE, Vec3::NEG_ONE)];
    let seen = places.map(|(at, along)| {
        scene.cameras = vec![pinhole(at, along, 1.0)];
        stage.render(&scene, &small(8)).map(|(film, _)| format!("{:.3}", mean(&film)))
    });
    all(seen)
}

fn sized(stage: &Stage, width: u32, height: u32) -> Seen {
    let mut scene = noon_ground();
    scene.cameras = vec![parallel(Vec3::Y, Vec3::NEG_Y, 9.0 / (width as f32 / height as f32).max(1.0))];
    match stage.render(&scene, &Settings { width, height, bounces: 0, ..small(2) }) {
        Ok((film, _)) if film.pixels.len() == width as usize * height as usize => is_even(stage, &film, 1.0, 1e-5),
        Ok((film, _)) => Err(format!("{} pixels", film.pixels.len())),
        Err(e)
            if width.max(height) > stage.gpu.capabilities.max_texture_side
                && e.contains("does not fit this device") =>
        {
            Ok(e)
        }
        Err(e) => Err(e),
    }
}

fn empty(stage: &Stage) -> Seen {
    let scene =
        Scene { cameras: vec![pinhole(Vec3::ZERO, Vec3::X, 1.0)], environment: Some(sky(0.25)), ..Scene::default() };
    let dark = Scene { environment: None, ..scene.clone() };
    let black = range(&stage.render(&dark, &small(2))?.0);
    all([
        within("sky", even(&stage.render(&scene, &small(2))?.0, 0.25), 1e-6),
        if black == [0.0; 2] { Ok("without one black".to_owned()) } else { Err(format!("without one {black:?}")) },
    ])
}

fn one_triangle(stage: &Stage) -> Seen {
    let mut scene =
        Scene { cameras: vec![parallel(Vec3::Y, Vec3::NEG_Y, 1.0)], lights: vec![noon()], ..Scene::default() };
    // The triangle covers half of the image, seen from above with -Z up.
    let positions = vec![Vec3::new(-1.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0), Vec3::new(-1.0, 0.0, -1.0)];
    add(
        &mut scene,
        Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() },
        Material::diffuse("triangle", Vec3::ONE),
    );
    let (film, _) = stage.render(&scene, &small(16))?;
    let [lit, dark] = [(4, 11), (11, 4)].map(|(x, y): (usize, usize)| film.pixels[16 * y + x][0]);
    let text = format!("{lit} and {dark}, half of the image: {:.3}", mean(&film));
    let right = (lit - 1.0).abs() < if stage.method == Technique::RAY_QUERY { 0.1 } else { 1e-5 }
        && dark == 0.0
        && (mean(&film) - 0.5).abs() < 0.05;
    if right { Ok(text) } else { Err(text) }
}

/// Ground under vertical light, made of n x n pieces with a mesh each.
fn pieces(n: u16, material: impl Fn(&mut Scene, usize) -> Material) -> Scene {
    let mut scene =
        Scene { cameras: vec![parallel(Vec3::Y, Vec3::NEG_Y, 1.0)], lights: vec![noon()], ..Scene::default() };
    let side = 2.0 / f32::from(n);
    for i in 0..n * n {
        let (x, z) = (f32::from(i % n) * side - 1.0, f32::from(i / n) * side - 1.0);
        let material = material(&mut scene, i.into());
        add(&mut scene, quad(Vec3::new(x, 0.0, z + side), Vec3::X * side, Vec3::NEG_Z * side), material);
    }
    scene
}

fn meshes(stage: &Stage) -> Seen {
    let scene = pieces(100, |_, _| Material::diffuse("piece", Vec3::ONE));
    let (film, _) = stage.render(&scene, &Settings { bounces: 0, width: 64, height: 64, ..small(4) })?;
    is_even(stage, &film, 1.0, 1e-4)
}

fn textures(stage: &Stage) -> Seen {
    // 71 x 71 = 5041 pieces in 71 x 71 pixels.
    let color = |i: usize| [i % 251, i / 251 * 10 + 1, 255 - i % 13].map(|v| v as u8);
    let scene = pieces(71, |scene, i| {
        let [r, g, b] = color(i);
        scene.images.push(Image { name: String::new(), width: 2, height: 2, texels: vec![[r, g, b, 255]; 4] });
        scene.textures.push(Texture { image: i, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb: false });
        let texture = Some(TextureRef::new(i));
        let reflectance = crate::scene::Color { factor: Vec3::ONE, texture };
        Material { bsdf: Bsdf::Diffuse { reflectance }, ..Material::diffuse("piece", Vec3::ONE) }
    });
    let (film, _) = stage.render(&scene, &Settings { bounces: 0, width: 71, height: 71, ..small(4) })?;
    let off = film.pixels.iter().enumerate().flat_map(|(i, p)| {
        color(i).into_iter().zip(p).map(|(c, v)| f64::from((f32::from(c) / 255.0 - v).abs())).collect::<Vec<_>>()
    });
    within("off by", off.fold(0.0, f64::max), 1e-2)
}

fn overflow(stage: &Stage) -> Seen {
    let scene = cornell()?;
    all([Technique::RASTER, Technique::FAST].map(|method| {
        let stage = Stage { gpu: stage.gpu, method };
        let of = |list_room| stage.render(&scene, &Settings { list_room, ..small(12) });
        let ((tight, stats), (ample, _)) = (of(0.001)?, of(16.0)?);
        if stats.redone == 0 {
            return Err("nothing had to be redone".to_owned());
        }
        let lost = if stats.lost_nodes == 0 {
            Ok(format!("{} redone", stats.redone))
        } else {
            Err("nodes are lost".to_owned())
        };
        all([lost, within("worst pixel", apart(&tight, 1.0, &ample)[1], 1e-5)])
    }))
}

fn long_run(stage: &Stage) -> Seen {
    // 256^2 pixels with 15,259 samples each.
    let settings = Settings { width: 256, height: 256, bounces: 0, samples: 15_259, ..Settings::plain() };
    let film = {
        // Checks after each pass would double the time, and the film counts its own non-finite values.
        let mut renderer = render::open(stage.gpu, &noon_ground(), &settings).map_err(|e| e.to_string())?;
        renderer.render(settings.samples.into(), &mut |_| true).map_err(|e| e.to_string())?;
        renderer.film().map_err(|e| e.to_string())?
    };
    within("off by", even(&film, 1.0), 1e-5)
}

fn lost_device(stage: &Stage) -> Seen {
    let scene = cornell()?;
    let gpu = Gpu::new().map_err(|e| e.to_string())?;
    let settings = Settings { technique: stage.method, ..small(2) };
    let mut renderer = render::open(&gpu, &scene, &settings).map_err(|e| e.to_string())?;
    renderer.render(1, &mut |_| true).map_err(|e| format!("before it was lost: {e}"))?;
    gpu.device.destroy();
    let lost = match renderer.render(1, &mut |_| true).and_then(|()| renderer.film()) {
        Ok(_) => return Err("a lost device goes on rendering".to_owned()),
        Err(e) => e.to_string(),
    };
    if !lost.contains("lost") {
        return Err(format!("the error does not say so: {lost}"));
    }
    let again = Gpu::new().map_err(|e| e.to_string())?;
    let (film, _) = Stage { gpu: &again, method: stage.method }.render(&scene, &small(2))?;
    all([
        Ok(lost.lines().next().unwrap_or_default().to_owned()),
        Ok(format!("a new one renders, mean {:.3}", mean(&film))),
    ])
}
