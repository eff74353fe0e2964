//! Scenes with every light, material and camera that the path methods support.

use glam::{Affine2, Mat3, Vec2, Vec3};
use lightsheaf::scene::{
    Anisotropy, Boundary, Bsdf, Coat, Color, DiffuseTransmission, Disney, Distribution, Emission, Environment, Film,
    Filter, Fresnel, Image, Lamp, Lens, Light, Mapping, Material, Mesh, Mix, NormalMap, Opacity, Pattern, Scalar,
    Scene, Sheen, Sides, SpotFalloff, Texture, TextureRef, Wrap, builtin,
};

use crate::common::scenes::{add, emitter, floor, inverted, parallel, pinhole, quad, room, sphere};

pub fn cornell(name: &str) -> Scene {
    builtin::load(&format!("cornell_{name}")).unwrap()
}

fn material(bsdf: Bsdf) -> Material {
    Material { bsdf, ..Material::diffuse("", Vec3::ONE) }
}

pub fn conductor(alpha: f32, fresnel: Fresnel) -> Material {
    material(Bsdf::Conductor { alpha: alpha.into(), fresnel, specular: Vec3::new(0.9, 0.8, 0.7).into() })
}

pub fn plastic(alpha: f32) -> Material {
    material(Bsdf::Plastic {
        alpha: alpha.into(),
        diffuse: Vec3::new(0.2, 0.5, 0.7).into(),
        specular: Vec3::ONE.into(),
        eta: 1.5,
        nonlinear: true,
    })
}

pub fn glass(alpha: f32, eta: f32, boundary: Boundary) -> Material {
    let [reflection, transmission] = [Vec3::new(1.0, 0.9, 0.8), Vec3::new(0.8, 0.9, 1.0)].map(Color::from);
    Material { boundary, ..material(Bsdf::Dielectric { alpha: alpha.into(), eta, reflection, transmission }) }
}

/// Returns glTF's material: half metal if `metallic` is 0.5, and transmitting.
pub fn gltf(roughness: f32, metallic: f32, transmission: f32, boundary: Boundary) -> Material {
    let bsdf = Bsdf::MetallicRoughness {
        base_color: Vec3::new(0.9, 0.7, 0.5).into(),
        metallic: metallic.into(),
        roughness: roughness.into(),
        ior: 1.45,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: transmission.into(),
    };
    Material { boundary, ..material(bsdf) }
}

pub fn ball(center: Vec3, radius: f32, subdivisions: u32, smooth: bool) -> Mesh {
    let mut mesh = sphere(subdivisions);
    if smooth {
        mesh.normals = mesh.positions.clone();
    }
    mesh.positions.iter_mut().for_each(|p| *p = center + *p * radius);
    mesh
}

/// Returns smooth balls in a gray room, whose shading normals differ from the geometric ones.
fn balls(materials: [Material; 4]) -> Scene {
    let mut scene = Scene {
        cameras: vec![pinhole(Vec3::new(0.0, 0.2, 0.95), Vec3::new(0.0, -0.25, -1.0), 1.3)],
        ..Scene::default()
    };
    add(&mut scene, room(), Material::diffuse("room", Vec3::new(0.6, 0.5, 0.4)));
    let places = [(-0.5, -0.65, -0.5), (0.15, -0.65, -0.6), (-0.2, -0.7, 0.1), (0.55, -0.7, -0.05)];
    for ((x, y, z), material) in places.into_iter().zip(materials) {
        add(&mut scene, ball(Vec3::new(x, y, z), 1.0 + y - 0.02, 2, true), material);
    }
    scene
}

fn lamp(scene: &mut Scene, strength: f32, two_sided: bool) {
    let emission = Some(Emission { radiance: (Vec3::new(1.0, 0.9, 0.7) * strength).into(), two_sided });
    let shape = quad(Vec3::new(-0.3, 0.9, -0.3), Vec3::X * 0.6, Vec3::Z * 0.6);
    add(scene, shape, Material { emission, sides: Sides::One, ..Material::diffuse("lamp", Vec3::splat(0.3)) });
}

/// Returns the scene of [`reflecting`] with balls of few triangles, at whose silhouettes shading normals face away from the camera.
pub fn coarse() -> Scene {
    let mut scene = reflecting();
    for mesh in scene.meshes.iter_mut().filter(|mesh| !mesh.normals.is_empty()) {
        let center = mesh.positions.iter().sum::<Vec3>() / mesh.positions.len() as f32;
        *mesh = ball(center, mesh.positions[0].distance(center), 0, true);
    }
    scene
}

/// Returns rough plastic and metal and glTF's mixture, with a spot, a point light and a two-sided emitter.
pub fn reflecting() -> Scene {
    let gold = Fresnel::Conductor { eta: Vec3::new(0.2, 0.4, 1.4), k: Vec3::new(3.9, 2.4, 1.6) };
    let mut scene = balls([
        conductor(0.15, gold),
        plastic(0.1),
        gltf(0.5, 0.5, 0.0, Boundary::Sheet),
        gltf(0.3, 0.0, 0.0, Boundary::Sheet),
    ]);
    lamp(&mut scene, 1.0, true);
    let position = Vec3::new(-0.8, 0.8, 0.5);
    let (direction, intensity) = ((Vec3::new(0.2, -0.7, -0.3) - position).normalize(), Vec3::new(2.0, 1.0, 0.5));
    let (inner_angle, outer_angle, falloff) = (0.3, 0.5, SpotFalloff::AngleLinear);
    scene.lights.push(Light::Spot { position, direction, intensity, inner_angle, outer_angle, falloff });
    scene.lights.push(Light::Point { position: Vec3::new(0.7, 0.2, -0.7), intensity: Vec3::splat(0.2) });
    scene
}

/// Returns smooth metal, plastic and glTF's mixture under an area light: the caustics of a light without
/// extent could not be found from the camera.
pub fn mirrors() -> Scene {
    let gold = Fresnel::Conductor { eta: Vec3::new(0.2, 0.4, 1.4), k: Vec3::new(3.9, 2.4, 1.6) };
    let mut scene = balls([
        conductor(0.0, gold),
        plastic(0.0),
        gltf(0.0, 0.5, 0.0, Boundary::Sheet),
        conductor(0.0, Fresnel::None),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a material under a coat.
pub fn coated(roughness: f32, material: Material) -> Material {
    let coat = Coat { weight: 0.9.into(), roughness: roughness.into(), normal_map: None };
    Material { coat: Some(coat), ..material }
}

/// Returns a material under a sheen.
pub fn velvet(roughness: f32, material: Material) -> Material {
    let sheen = Sheen { color: Vec3::new(0.9, 0.5, 0.7).into(), roughness: roughness.into() };
    Material { sheen: Some(sheen), ..material }
}

/// Returns sheens on a diffuse ball, on rough and smooth metal, and under a coat.
pub fn sheens() -> Scene {
    let mut scene = balls([
        velvet(0.3, Material::diffuse("", Vec3::new(0.2, 0.3, 0.8))),
        velvet(0.7, conductor(0.3, Fresnel::None)),
        velvet(0.5, conductor(0.0, Fresnel::None)),
        coated(0.4, velvet(0.6, gltf(0.5, 0.0, 0.0, Boundary::Sheet))),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns glTF's material with Disney's base.
pub fn cloth(sheen: f32, flatness: f32, material: Material) -> Material {
    let disney = Disney { sheen: sheen.into(), sheen_tint: 0.5, flatness };
    Material { disney: Some(disney), ..material }
}

/// Returns cloth on a volume that passes light, smooth, under a coat, and thin, so that it passes light.
pub fn cloths() -> Scene {
    let mut scene = balls([
        cloth(3.0, 0.0, gltf(0.6, 0.0, 0.5, Boundary::Volume { absorption: Vec3::splat(0.5) })),
        cloth(2.0, 0.8, gltf(0.0, 0.3, 0.0, Boundary::Sheet)),
        coated(0.4, cloth(2.0, 1.0, gltf(0.5, 0.0, 0.0, Boundary::Sheet))),
        translucent(0.5, cloth(2.0, 0.5, gltf(0.5, 0.0, 0.3, Boundary::Sheet))),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a material under a thin film.
pub fn filmed(thickness: f32, material: Material) -> Material {
    let film = Film { strength: 1.0.into(), ior: 1.35, thickness: [thickness; 2], thickness_texture: None };
    Material { film: Some(film), ..material }
}

/// Returns thin films on metal and dielectric, rough and smooth, one of which transmits.
pub fn films() -> Scene {
    let mut scene = balls([
        filmed(300.0, gltf(0.4, 1.0, 0.0, Boundary::Sheet)),
        filmed(450.0, gltf(0.0, 0.5, 0.0, Boundary::Sheet)),
        filmed(250.0, gltf(0.5, 0.0, 0.7, Boundary::Volume { absorption: Vec3::splat(0.5) })),
        coated(0.3, filmed(350.0, gltf(0.4, 0.5, 0.0, Boundary::Sheet))),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a material with a stretched lobe.
pub fn stretched(strength: f32, material: Material) -> Material {
    Material { anisotropy: Some(Anisotropy { strength, rotation: 0.4, texture: None }), ..material }
}

/// Returns stretched lobes of metal, plastic and glTF's mixture, one of them under a coat.
pub fn brushed() -> Scene {
    let mut scene = balls([
        stretched(0.9, conductor(0.1, Fresnel::None)),
        stretched(0.7, plastic(0.2)),
        stretched(0.5, gltf(0.0, 1.0, 0.0, Boundary::Sheet)),
        coated(0.4, stretched(0.8, gltf(0.4, 0.5, 0.0, Boundary::Sheet))),
    ]);
    // Tangents go around the balls.
    for mesh in scene.meshes.iter_mut().filter(|mesh| mesh.normals.len() == mesh.positions.len()) {
        mesh.tangents = mesh.normals.iter().map(|n| Vec3::Y.cross(*n).normalize_or_zero().extend(1.0)).collect();
    }
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a material whose lobe has Beckmann facets.
pub fn beckmann(material: Material) -> Material {
    Material { distribution: Distribution::Beckmann, ..material }
}

/// Returns Beckmann facets of metal, plastic and glass, one of them under a coat.
pub fn beckmann_facets() -> Scene {
    let mut scene = balls([
        beckmann(conductor(0.2, Fresnel::None)),
        beckmann(plastic(0.2)),
        beckmann(glass(0.2, 1.4, Boundary::Volume { absorption: Vec3::ZERO })),
        coated(0.4, beckmann(conductor(0.4, Fresnel::None))),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a mix of two materials.
pub fn mixed(weight: f32, parts: [Material; 2]) -> Material {
    let boundary = parts.iter().find(|part| part.transmits()).unwrap_or(&parts[0]).boundary;
    let mix = Some(Mix { weight: weight.into(), parts: Box::new(parts) });
    Material { mix, boundary, ..Material::diffuse("", Vec3::ZERO) }
}

/// Returns mixes of diffuse, rough and smooth surfaces, of glass, and of mixes, one of which emits light.
pub fn mixes() -> Scene {
    let blue = Material::diffuse("", Vec3::new(0.2, 0.3, 0.8));
    let clear = Boundary::Volume { absorption: Vec3::ZERO };
    let nested = mixed(0.3, [plastic(0.2), conductor(0.0, Fresnel::None)]);
    let emission = Some(Emission { radiance: Vec3::new(0.2, 0.1, 0.0).into(), two_sided: false });
    let mut scene = balls([
        mixed(0.4, [blue.clone(), conductor(0.2, Fresnel::None)]),
        mixed(0.5, [nested, beckmann(conductor(0.3, Fresnel::None))]),
        mixed(0.6, [coated(0.3, blue.clone()), glass(0.0, 1.5, clear)]),
        Material { emission, ..mixed(0.5, [blue, gltf(0.4, 1.0, 0.0, Boundary::Sheet)]) },
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns coats, smooth and rough, on rough and smooth metal, on plastic and on a diffuse ball.
pub fn coats() -> Scene {
    let mut scene = balls([
        coated(0.0, conductor(0.3, Fresnel::None)),
        coated(0.4, Material::diffuse("", Vec3::new(0.8, 0.3, 0.2))),
        coated(0.5, conductor(0.0, Fresnel::None)),
        coated(0.0, gltf(0.5, 0.5, 0.0, Boundary::Sheet)),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a material whose diffuse base passes light.
pub fn translucent(share: f32, material: Material) -> Material {
    let color = Vec3::new(0.4, 0.9, 0.3).into();
    let diffuse_transmission = Some(DiffuseTransmission { share: share.into(), color });
    Material { diffuse_transmission, ..material }
}

/// Returns lamp shades, one with a smooth coat, one with facets that pass light, and a leaf before the lamp.
pub fn leaves() -> Scene {
    let mut scene = balls([
        translucent(1.0, gltf(0.0, 0.0, 0.0, Boundary::Sheet)),
        translucent(0.7, gltf(0.4, 0.0, 0.0, Boundary::Sheet)),
        translucent(0.5, gltf(0.5, 0.0, 0.5, Boundary::Volume { absorption: Vec3::splat(0.5) })),
        coated(0.3, translucent(0.6, gltf(0.4, 0.3, 0.0, Boundary::Sheet))),
    ]);
    lamp(&mut scene, 3.0, false);
    let leaf = quad(Vec3::new(-0.9, -0.9, -0.7), Vec3::new(0.7, 0.0, -0.2), Vec3::Y * 1.2);
    add(&mut scene, leaf, translucent(0.8, gltf(0.8, 0.0, 0.0, Boundary::Sheet)));
    scene
}

/// Returns transmission: smooth and rough glass, absorbing glass, glTF's, and sheets.
pub fn transmitting() -> Scene {
    let volume = Boundary::Volume { absorption: Vec3::new(2.0, 0.5, 0.2) };
    let mut scene = balls([
        glass(0.0, 1.5, volume),
        glass(0.2, 1.4, Boundary::Volume { absorption: Vec3::ZERO }),
        gltf(0.4, 0.1, 0.8, volume),
        glass(0.3, 1.5, Boundary::Sheet),
    ]);
    lamp(&mut scene, 2.0, false);
    let sheet = quad(Vec3::new(-0.9, -0.9, -0.7), Vec3::new(0.7, 0.0, -0.2), Vec3::Y * 1.2);
    add(&mut scene, sheet, gltf(0.3, 0.0, 0.7, Boundary::Sheet));
    let sheet = quad(Vec3::new(0.2, -0.9, -0.75), Vec3::new(0.7, 0.0, 0.2), Vec3::Y * 1.2);
    add(&mut scene, sheet, glass(0.0, 1.5, Boundary::Sheet));
    scene
}

/// Returns a ground with a ball below a pane of thin glass, through which a lamp and a parallel light of
/// an irradiance shine.
pub fn below_a_pane(irradiance: f32, tint: Vec3) -> Scene {
    let camera = pinhole(Vec3::new(0.0, 0.6, 2.5), Vec3::new(0.0, -0.25, -1.0), 0.9);
    let mut scene = Scene { cameras: vec![camera], ..Scene::default() };
    add(&mut scene, floor(2.0, 0.0), Material::diffuse("ground", Vec3::new(0.7, 0.6, 0.5)));
    add(&mut scene, ball(Vec3::new(0.3, 0.35, 0.2), 0.35, 2, true), Material::diffuse("ball", Vec3::splat(0.8)));
    let mut pane = gltf(0.0, 0.0, 1.0, Boundary::Sheet);
    let Bsdf::MetallicRoughness { base_color, .. } = &mut pane.bsdf else { unreachable!() };
    base_color.factor = tint;
    add(&mut scene, floor(2.5, 1.0), pane);
    // The lamp is black, since `path` does not find what the pane reflects of the sun.
    add(&mut scene, inverted(floor(1.0, 1.8)), emitter(0.0, Vec3::splat(4.0), false));
    let direction = Vec3::new(0.5, -1.0, -0.3).normalize();
    scene.lights = vec![Light::Directional { direction, irradiance: Vec3::splat(irradiance) }];
    scene
}

/// Returns a material whose medium disperses light far more than any glass does.
pub fn dispersive(material: Material) -> Material {
    Material { dispersion: 12.0, ..material }
}

/// Returns media that disperse light, with smooth and rough facets, absorption, a diffuse base and a coat.
pub fn dispersing() -> Scene {
    let clear = Boundary::Volume { absorption: Vec3::ZERO };
    let tinted = Boundary::Volume { absorption: Vec3::new(2.0, 0.5, 0.2) };
    let mut scene = balls([
        dispersive(gltf(0.0, 0.0, 1.0, clear)),
        dispersive(gltf(0.5, 0.0, 1.0, clear)),
        coated(0.3, dispersive(gltf(0.4, 0.1, 0.7, tinted))),
        dispersive(gltf(0.0, 0.2, 0.6, clear)),
    ]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a slab of thickness 1 that disperses light, seen at 45 degrees, and a strip behind it that emits light, where a
/// ray arrives that rises inside the slab as a function of the channels' indices says.
pub fn strip_behind_slab(rise: impl Fn([f32; 3]) -> f32) -> Scene {
    let along = Vec3::new(0.0, 1.0, -1.0).normalize();
    let mut scene = Scene { cameras: vec![parallel(-along, along, 1e-3)], ..Scene::default() };
    let material = dispersive(gltf(0.0, 0.0, 1.0, Boundary::Volume { absorption: Vec3::ZERO }));
    let height = rise(material.iors().unwrap()) + 1.0;
    add(&mut scene, quad(Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 18.0, Vec3::Y * 18.0), material.clone());
    add(&mut scene, quad(Vec3::new(9.0, -9.0, -1.0), Vec3::X * -18.0, Vec3::Y * 18.0), material);
    let emission = Some(Emission { radiance: Vec3::ONE.into(), two_sided: false });
    let strip = quad(Vec3::new(-1.0, height - 0.01, -2.0), Vec3::X * 2.0, Vec3::Y * 0.02);
    add(&mut scene, strip, Material { emission, ..Material::diffuse("strip", Vec3::ZERO) });
    scene
}

/// Returns two hollow balls of clear glass, one in the other, under a sky of 1, which shows in all of them.
pub fn shells() -> Scene {
    let mut scene = Scene {
        cameras: vec![pinhole(Vec3::new(0.0, 0.0, 3.0), Vec3::NEG_Z, 0.6)],
        environment: Some(Environment { radiance: Vec3::ONE, map: None, world_from_environment: Mat3::IDENTITY }),
        ..Scene::default()
    };
    for (radius, outside) in [(0.95, true), (0.85, false), (0.7, true), (0.6, false)] {
        let mut mesh = ball(Vec3::ZERO, radius, 3, true);
        if !outside {
            // Air is inside.
            mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
            mesh.normals.iter_mut().for_each(|normal| *normal = -*normal);
        }
        let white = || Color::from(Vec3::ONE);
        let bsdf = Bsdf::Dielectric { alpha: 0.0.into(), eta: 1.5, reflection: white(), transmission: white() };
        let boundary = Boundary::Volume { absorption: Vec3::ZERO };
        add(&mut scene, mesh, Material { boundary, ..material(bsdf) });
    }
    scene
}

/// Returns a room with surfaces on which vertices count as no bounces: two mirrors, and a clear and a rough ball of glass,
/// lit by a lamp that is seen in all of them.
pub fn chains() -> Scene {
    let clear = Boundary::Volume { absorption: Vec3::splat(0.3) };
    let mirror = gltf(0.0, 1.0, 0.0, Boundary::Sheet);
    let mut scene = balls([mirror.clone(), glass(0.0, 1.5, clear), glass(0.3, 1.3, clear), mirror]);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a floor that an area light illuminates through a ball.
pub fn behind_glass(material: Material) -> Scene {
    let mut scene = Scene {
        cameras: vec![pinhole(Vec3::new(0.0, 0.15, 0.9), Vec3::new(0.0, -0.9, -0.9), 0.6)],
        ..Scene::default()
    };
    add(&mut scene, floor(1.0, -0.8), Material::diffuse("floor", Vec3::splat(0.7)));
    add(&mut scene, ball(Vec3::new(0.0, 0.3, 0.0), 0.3, 3, true), material);
    lamp(&mut scene, 3.0, false);
    scene
}

/// Returns a spot of constant intensity above a mirror floor, and a wall.
pub fn mirrored_light() -> Scene {
    let mut scene = Scene {
        cameras: vec![parallel(Vec3::new(0.0, 0.6, 1.0), Vec3::NEG_Z, 0.2)],
        lights: vec![Light::Spot {
            position: Vec3::new(0.3, 1.0, 0.0),
            // The light goes by way of the mirror to the middle of the view.
            direction: Vec3::new(-0.3, -1.6, -1.0).normalize(),
            intensity: Vec3::splat(2.0),
            inner_angle: 0.25,
            outer_angle: 0.3,
            falloff: SpotFalloff::CosineSquared,
        }],
        ..Scene::default()
    };
    add(&mut scene, floor(4.0, 0.0), conductor(0.0, Fresnel::None));
    add(
        &mut scene,
        quad(Vec3::new(-2.0, 0.0, -1.0), Vec3::X * 4.0, Vec3::Y * 2.0),
        Material::diffuse("wall", Vec3::splat(0.5)),
    );
    scene
}

fn checker(colors: [[u8; 4]; 2]) -> Image {
    let texels = (0..64).map(|i: u32| colors[((i ^ (i >> 3)) & 1) as usize]).collect();
    Image { name: "checker".to_owned(), width: 8, height: 8, texels }
}

/// Returns textured emission, holes and normal maps under sunlight and a parallel camera.
pub fn textured() -> Scene {
    let mut scene = Scene {
        cameras: vec![parallel(Vec3::new(0.0, 1.5, 2.0), Vec3::new(0.0, -0.8, -1.0), 1.2)],
        ..Scene::default()
    };
    scene.images =
        vec![checker([[255, 180, 90, 255], [40, 60, 200, 0]]), checker([[150, 128, 240, 255], [110, 140, 240, 255]])];
    scene.textures = (0..2)
        .map(|image| Texture {
            image,
            wrap: [Wrap::Repeat; 2],
            filter: if image == 0 { Filter::Nearest } else { Filter::Linear },
            srgb: image == 0,
        })
        .collect();
    let of = |texture| TextureRef { texture, uv_set: 0, transform: Affine2::from_scale(Vec2::splat(1.0)) };
    let bumpy = Some(NormalMap { texture: of(1), scale: 1.0 });
    add(&mut scene, floor(1.5, 0.0), Material { normal_map: bumpy, ..Material::diffuse("floor", Vec3::splat(0.7)) });
    let emission =
        Some(Emission { radiance: Color { factor: Vec3::splat(4.0), texture: Some(of(0)) }, two_sided: true });
    let mask = Opacity::CutOut { value: Scalar { factor: 1.0, texture: Some((of(0), 3)) }, cutoff: 0.5 };
    let shining = Material { emission, opacity: Some(mask), ..Material::diffuse("screen", Vec3::splat(0.5)) };
    add(&mut scene, quad(Vec3::new(-0.6, 0.2, -0.6), Vec3::X * 0.8, Vec3::new(0.0, 0.7, 0.2)), shining);
    let wall = quad(Vec3::new(-1.5, 0.0, -1.5), Vec3::X * 3.0, Vec3::Y * 1.5);
    add(&mut scene, wall, Material { normal_map: bumpy, ..gltf(0.6, 0.0, 0.0, Boundary::Sheet) });
    add(&mut scene, inverted(ball(Vec3::new(0.5, 0.35, 0.2), 0.3, 1, false)), Material::diffuse("ball", Vec3::ONE));
    let direction = Vec3::new(0.4, -1.0, -0.2).normalize();
    scene.lights.push(Light::Directional { direction, irradiance: Vec3::new(0.6, 0.6, 0.5) });
    scene
}

/// Returns the Cornell box through a wide lens.
pub fn lens() -> Scene {
    let mut scene = cornell("area");
    scene.cameras[0].lens = Some(Lens { radius: 0.15, focus: 3.2 });
    scene
}

/// Returns a room with a lamp of some size, a profile, a projector, a sun through the open side, and a
/// textured emitter.
pub fn lamps() -> Scene {
    let mut scene = reflecting();
    let room = &mut scene.meshes[0];
    let positions = &room.positions;
    room.triangles.retain(|t| t.iter().any(|&i| positions[i as usize].z < 0.99));
    assert_eq!(room.triangles.len(), 10, "a side is open");
    let lamp = |position, radius, intensity: f32, pattern| Lamp {
        position,
        world_from_lamp: Mat3::from_rotation_x(-1.3),
        radius,
        intensity: Vec3::splat(intensity),
        cone: None,
        pattern,
    };
    let texel = |i: u32| [1.0 - (i / 8) as f32 / 16.0, 0.5, if i % 8 < 4 { 1.0 } else { 0.1 }];
    let profile = Pattern {
        name: String::new(),
        mapping: Mapping::Sphere,
        width: 8,
        height: 17,
        texels: (0..8 * 17).map(texel).collect(),
    };
    let slide = Pattern {
        name: String::new(),
        mapping: Mapping::Projection { half_extent: Vec2::new(0.5, 0.3) },
        width: 4,
        height: 4,
        texels: (0..16).map(|i| [1.0, (i % 3) as f32, (i % 2) as f32]).collect(),
    };
    scene.patterns = vec![profile, slide];
    scene.lights = vec![
        Light::Lamp(lamp(Vec3::new(-0.5, 0.5, 0.2), 0.15, 0.2, None)),
        Light::Lamp(lamp(Vec3::new(0.6, 0.6, -0.3), 0.0, 0.2, Some(0))),
        Light::Lamp(lamp(Vec3::new(0.0, 0.8, 0.5), 0.05, 0.3, Some(1))),
        Light::Sun {
            direction: Vec3::new(0.2, -0.5, -1.0).normalize(),
            irradiance: Vec3::new(0.6, 0.5, 0.4),
            angle: 0.1,
            of_sky: false,
        },
    ];
    let texel = |i: u32| if i % 37 < 3 { [255, 200, 100, 255] } else { [10, 10, 20, 255] };
    scene.images.push(Image { name: String::new(), width: 32, height: 32, texels: (0..1024).map(texel).collect() });
    let texture =
        Texture { image: scene.images.len() - 1, wrap: [Wrap::Clamp; 2], filter: Filter::Linear, srgb: false };
    scene.textures.push(texture);
    for emission in scene.materials.iter_mut().filter_map(|m| m.emission.as_mut()) {
        emission.radiance.texture = Some(TextureRef::new(scene.textures.len() - 1));
        emission.radiance.factor *= 3.0;
    }
    scene
}
