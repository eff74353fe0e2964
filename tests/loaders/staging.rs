//! Tests of staging: cameras that are chosen and lights that are added. In scenes of every kind that people
//! open, the subject is in the picture, neither black nor overexposed, and the camera is not inside of a
//! thing. Needs no GPU: the reference renders the pictures.

use crate::common;

use common::scenes::inverted;
use glam::{Affine2, Affine3A, Vec3};
use lightsheaf::exposure::{Backdrop, auto_exposure};
use lightsheaf::reference::{Features, Reference, ReferenceSettings};
use lightsheaf::scene::model::shapes;
use lightsheaf::scene::{
    Color, Emission, Filter, Image, Instance, Light, Material, Mesh, Scene, Sides, Texture, TextureRef, Wrap,
};
use lightsheaf::staging::camera::{self, Subject};
use lightsheaf::staging::{self, CameraChoice, Staging};
use lightsheaf::tonemap::{Grade, Tonemap};

const SIDE: u32 = 64;

fn matte(sides: Sides) -> Material {
    Material { sides, ..Material::diffuse("matte", Vec3::new(0.6, 0.5, 0.4)) }
}

/// Adds a mesh, scaled and moved.
fn place(scene: &mut Scene, mesh: Mesh, sides: Sides, scale: Vec3, at: Vec3) {
    shapes::add(scene, mesh, matte(sides));
    let world_from_local = Affine3A::from_translation(at) * Affine3A::from_scale(scale);
    if let Some(instance) = scene.instances.last_mut() {
        instance.world_from_local = world_from_local;
    }
}

/// Returns a block from -1 to 1, fronts outwards, scaled and moved.
fn block(scene: &mut Scene, half: Vec3, at: Vec3) {
    place(scene, shapes::cube(), Sides::OneCulled, half, at);
}

/// Completes a scene for a picture of `SIDE` x `SIDE` pixels.
fn complete(scene: &mut Scene) {
    staging::complete(scene, &Staging { size: [SIDE; 2], ..Staging::default() }).unwrap();
}

fn of(build: impl FnOnce(&mut Scene)) -> Scene {
    let mut scene = Scene::default();
    build(&mut scene);
    scene
}

/// Returns a room of the given half size with things in it; windows are holes in the wall at +X.
fn room(half: Vec3, window: bool) -> Scene {
    of(|scene| {
        let wall = |scene: &mut Scene, half: Vec3, at: Vec3| block(scene, half, at);
        let thick = 0.1;
        for sign in [-1.0, 1.0] {
            wall(
                scene,
                Vec3::new(half.x + 2.0 * thick, thick, half.z + 2.0 * thick),
                Vec3::Y * sign * (half.y + thick),
            );
            wall(scene, Vec3::new(half.x, half.y, thick), Vec3::Z * sign * (half.z + thick));
        }
        wall(scene, Vec3::new(thick, half.y, half.z), Vec3::NEG_X * (half.x + thick));
        if window {
            let [x, part] = [half.x + thick, half.z / 3.0];
            wall(scene, Vec3::new(thick, half.y, part), Vec3::new(x, 0.0, -2.0 * part));
            wall(scene, Vec3::new(thick, half.y, part), Vec3::new(x, 0.0, 2.0 * part));
            wall(scene, Vec3::new(thick, 0.6 * half.y, part), Vec3::new(x, -0.4 * half.y, 0.0));
        } else {
            wall(scene, Vec3::new(thick, half.y, half.z), Vec3::X * (half.x + thick));
        }
        for n in 0..6 {
            let at = Vec3::new((n as f32 * 0.37).fract() - 0.5, 0.0, (n as f32 * 0.61).fract() - 0.5) * half * 1.6;
            wall(scene, Vec3::new(0.2, 0.3, 0.2), at - Vec3::Y * (half.y - 0.3));
        }
    })
}

/// Returns a room whose walls are pillars and parapets, so that much of the inside is seen from outside, but from each
/// side little of it.
fn house() -> Scene {
    of(|scene| {
        let [half, thick] = [4.0, 0.1];
        for sign in [-1.0, 1.0] {
            block(scene, Vec3::new(half + 2.0 * thick, thick, half + 2.0 * thick), Vec3::Y * sign * (1.5 + thick));
            for (along, across) in [(Vec3::X, Vec3::Z), (Vec3::Z, Vec3::X)] {
                let wall = sign * (half + thick) * across;
                block(scene, half * along + Vec3::Y * 0.6 + thick * across, wall - Vec3::Y * 0.9);
                for n in [-1.0, 0.0, 1.0] {
                    block(scene, along + Vec3::Y * 0.9 + thick * across, wall + 3.2 * n * along + Vec3::Y * 0.6);
                }
            }
        }
        for n in 0..5 {
            let at = Vec3::new((n as f32 * 0.37).fract() - 0.5, 0.0, (n as f32 * 0.61).fract() - 0.5) * 5.0;
            block(scene, Vec3::new(0.3, 0.5, 0.3), at - Vec3::Y);
        }
    })
}

/// Returns a ball on a wide base, of two hollow shells that are open towards the upper front, as balls that show materials
/// are.
fn hollow_ball() -> Scene {
    let opened = |mut mesh: Mesh| {
        let open = Vec3::new(0.6, 0.6, 0.53);
        let towards = |t: &[u32; 3]| t.iter().map(|&v| mesh.positions[v as usize].dot(open)).sum::<f32>() / 3.0;
        mesh.triangles = mesh.triangles.iter().copied().filter(|t| towards(t) < 0.6).collect();
        Mesh { normals: Vec::new(), ..mesh }
    };
    of(|scene| {
        let ball = shapes::icosphere(4);
        for (radius, shell) in
            [(1.0, ball.clone()), (0.95, inverted(ball.clone())), (0.9, ball.clone()), (0.85, inverted(ball))]
        {
            place(scene, opened(shell), Sides::OneCulled, Vec3::splat(radius), Vec3::ZERO);
        }
        block(scene, Vec3::new(1.6, 0.08, 1.6), Vec3::Y * -1.08);
    })
}

/// Returns a scene of metres whose unit is taken for a centimetre.
fn in_centimetres(mut scene: Scene) -> Scene {
    let scale = Affine3A::from_scale(Vec3::splat(100.0));
    scene.instances.iter_mut().for_each(|i: &mut Instance| i.world_from_local = scale * i.world_from_local);
    scene
}

/// Returns a closed ball of this radius, metres, with a space in it.
fn shell(radius: f32) -> Scene {
    of(|scene| {
        let ball = shapes::icosphere(3);
        place(scene, ball.clone(), Sides::OneCulled, Vec3::splat(radius), Vec3::ZERO);
        place(scene, inverted(ball), Sides::OneCulled, Vec3::splat(0.95 * radius), Vec3::ZERO);
    })
}

fn city() -> Scene {
    of(|scene| {
        for n in 0..400_u32 {
            let [x, z] = [n % 20, n / 20].map(|i| 20.0 * i as f32);
            let height = 5.0 + 25.0 * (n as f32 * 0.618_034).fract();
            block(scene, Vec3::new(7.0, height, 7.0), Vec3::new(x, height, z));
        }
        let ground = shapes::quad(Vec3::new(-50.0, 0.0, 450.0), Vec3::X * 500.0, Vec3::NEG_Z * 500.0);
        place(scene, ground, Sides::OneCulled, Vec3::ONE, Vec3::ZERO);
    })
}

/// A scene with the expected result.
struct Expected {
    name: &'static str,
    scene: Scene,
    subject: Subject,
    /// Returns the share of the pixels that show a surface.
    covered: [f32; 2],
    /// The expected part of the note on light.
    light: &'static str,
}

fn scenes() -> Vec<Expected> {
    let expect = |name, subject, covered, light, scene| Expected { name, scene, subject, covered, light };
    let (thing, full) = ([0.3, 0.95], [0.75, 1.0]);
    let sheet = |u: Vec3, v: Vec3, sides: Sides| {
        of(|scene| place(scene, shapes::quad(-0.5 * (u + v), u, v), sides, Vec3::ONE, Vec3::ZERO))
    };
    let sphere = || shapes::icosphere(3);
    vec![
        expect("box", Subject::Object, thing, "studio", of(|s| block(s, Vec3::ONE, Vec3::ZERO))),
        expect("tiny box", Subject::Object, thing, "studio", of(|s| block(s, Vec3::splat(1e-6), Vec3::ZERO))),
        expect(
            "box in centimetres",
            Subject::Object,
            thing,
            "studio",
            of(|s| block(s, Vec3::splat(80.0), Vec3::Y * 80.0)),
        ),
        expect(
            "box far away",
            Subject::Object,
            thing,
            "studio",
            of(|s| block(s, Vec3::ONE, Vec3::new(4e3, 0.0, -7e3))),
        ),
        expect(
            "box of two sides",
            Subject::Object,
            thing,
            "studio",
            of(|s| {
                place(s, shapes::cube(), Sides::Two, Vec3::ONE, Vec3::ZERO);
            }),
        ),
        expect(
            "sphere",
            Subject::Object,
            thing,
            "studio",
            of(|s| {
                place(s, sphere(), Sides::OneCulled, Vec3::ONE, Vec3::ZERO);
            }),
        ),
        expect(
            "sphere of two sides",
            Subject::Object,
            thing,
            "studio",
            of(|s| {
                place(s, sphere(), Sides::Two, Vec3::ONE, Vec3::ZERO);
            }),
        ),
        expect("sheet that faces +Z", Subject::Flat, thing, "studio", sheet(Vec3::X, Vec3::Y, Sides::OneCulled)),
        expect("sheet that faces -Z", Subject::Flat, thing, "studio", sheet(Vec3::NEG_X, Vec3::Y, Sides::OneCulled)),
        expect("sheet that faces -X", Subject::Flat, thing, "studio", sheet(Vec3::Z, Vec3::Y, Sides::OneCulled)),
        expect("sheet that lies", Subject::Flat, thing, "studio", sheet(Vec3::X, Vec3::NEG_Z, Sides::OneCulled)),
        expect("sheet of two sides", Subject::Flat, thing, "studio", sheet(Vec3::X, Vec3::Y, Sides::Two)),
        // A thin thing fills the frame with its length, not with its area.
        expect(
            "needle",
            Subject::Object,
            [0.005, 0.95],
            "studio",
            of(|s| {
                block(s, Vec3::new(0.03, 1.0, 0.03), Vec3::ZERO);
            }),
        ),
        expect(
            "box and a forgotten one",
            Subject::Object,
            thing,
            "studio",
            of(|s| {
                place(s, sphere(), Sides::OneCulled, Vec3::ONE, Vec3::ZERO);
                place(s, shapes::icosphere(0), Sides::OneCulled, Vec3::splat(0.01), Vec3::X * 500.0);
            }),
        ),
        expect("hollow ball", Subject::Object, [0.2, 0.95], "studio", hollow_ball()),
        expect("corridor", Subject::Room, full, "lamp", room(Vec3::new(1.0, 1.3, 12.0), false)),
        expect("room", Subject::Room, full, "lamp", room(Vec3::new(3.0, 1.4, 4.0), false)),
        expect("room with a window", Subject::Room, full, "sky", room(Vec3::new(3.0, 1.4, 4.0), true)),
        expect(
            "room in centimetres",
            Subject::Room,
            full,
            "lamp",
            in_centimetres(room(Vec3::new(3.0, 1.4, 4.0), false)),
        ),
        expect(
            "room with a window in centimetres",
            Subject::Room,
            full,
            "sky",
            in_centimetres(room(Vec3::new(3.0, 1.4, 4.0), true)),
        ),
        expect("shell", Subject::Object, thing, "studio", shell(0.2)),
        expect(
            "room of one sheet",
            Subject::Room,
            full,
            "lamp",
            of(|s| {
                place(
                    s,
                    Mesh { normals: Vec::new(), ..inverted(shapes::cube()) },
                    Sides::OneCulled,
                    Vec3::new(3.0, 1.4, 4.0),
                    Vec3::ZERO,
                );
                block(s, Vec3::splat(0.4), Vec3::new(0.5, -1.0, -1.0));
            }),
        ),
        expect("nested rooms", Subject::Room, full, "lamp", {
            let mut scene = room(Vec3::new(8.0, 1.5, 8.0), false);
            for (n, at) in [[-4.0, -4.0], [4.0, 4.0]].into_iter().enumerate() {
                for sign in [-1.0, 1.0] {
                    let open = if n == 0 { 0.5 } else { 1.0 };
                    block(&mut scene, Vec3::new(2.0, 1.5, 0.05), Vec3::new(at[0], 0.0, at[1] + 2.0 * sign));
                    block(&mut scene, Vec3::new(0.05, 1.5 * open, 2.0), Vec3::new(at[0] + 2.0 * sign, 0.0, at[1]));
                }
            }
            scene
        }),
        expect(
            "stage",
            Subject::Stage,
            thing,
            "studio",
            of(|s| {
                for (half, at) in [
                    (Vec3::new(1.0, 1.0, 0.05), Vec3::new(0.0, 0.0, 1.0)),
                    (Vec3::new(1.0, 0.05, 1.0), Vec3::new(0.0, 1.0, 0.0)),
                    (Vec3::new(1.0, 0.05, 1.0), Vec3::new(0.0, -1.0, 0.0)),
                    (Vec3::new(0.05, 1.0, 1.0), Vec3::new(1.0, 0.0, 0.0)),
                    (Vec3::new(0.05, 1.0, 1.0), Vec3::new(-1.0, 0.0, 0.0)),
                    (Vec3::splat(0.3), Vec3::new(0.2, -0.7, 0.2)),
                ] {
                    block(s, half, at);
                }
            }),
        ),
        expect("house with large windows", Subject::Room, full, "sky", house()),
        expect("city", Subject::Object, thing, "sky", city()),
    ]
}

fn shot(scene: &Scene, samples: u32) -> (Features, lightsheaf::film::Film) {
    let mut reference = Reference::new(scene);
    reference.look(scene.cameras[0].clone());
    let settings = ReferenceSettings {
        width: SIDE,
        height: SIDE,
        samples,
        bounces: Some(2),
        specular_bounces: 8,
        seed: 1,
        camera: 0,
    };
    (reference.features(&settings), reference.render(&settings, &|_, _| ()).film)
}

/// Returns the columns and rows that a picture's subject spans, as shares.
fn spans(distance: &[[f32; 3]]) -> [f32; 2] {
    let seen = |n: usize| distance[n][0] > 0.0;
    let side = SIDE as usize;
    let columns = (0..side).filter(|x| (0..side).any(|y| seen(y * side + x))).count();
    let rows = (0..side).filter(|y| (0..side).any(|x| seen(y * side + x))).count();
    [columns, rows].map(|n| n as f32 / SIDE as f32)
}

#[test]
fn every_kind_of_scene_is_in_the_picture() {
    let mut wrong = Vec::new();
    for Expected { name, scene, subject, covered, light } in scenes() {
        let reference = Reference::new(&scene);
        let points: Vec<Vec3> = reference.geometry().vertices.iter().map(|v| v.position).collect();
        let chosen = camera::choose(&reference, &points, [SIDE; 2]).1;
        if chosen != subject {
            wrong.push(format!("{name}: {chosen:?}, not {subject:?}"));
        }
        let mut staged = scene.clone();
        complete(&mut staged);
        if !staged.notes.iter().any(|note| note.contains(light)) {
            wrong.push(format!("{name}: {:?}, not {light}", staged.notes));
        }
        let (features, film) = shot(&staged, 16);
        let seen = features.distance.pixels.iter().filter(|d| d[0] > 0.0).count() as f32 / (SIDE * SIDE) as f32;
        if !(covered[0]..=covered[1]).contains(&seen) {
            wrong.push(format!("{name}: {seen} of the pixels are covered"));
        }
        let span = spans(&features.distance.pixels).into_iter().reduce(f32::max).unwrap();
        if subject != Subject::Room && !(0.7..=0.93).contains(&span) {
            wrong.push(format!("{name}: spans {span} of the frame"));
        }
        // A camera inside of a thing or right behind one has it much nearer than the rest.
        let mut distances: Vec<f32> = features.distance.pixels.iter().map(|d| d[0]).filter(|&d| d > 0.0).collect();
        distances.sort_by(f32::total_cmp);
        let (nearest, usual) = (distances[0], distances[distances.len() / 2]);
        if nearest < if subject == Subject::Room { 0.05 } else { 0.4 } * usual {
            wrong.push(format!("{name}: something is {nearest} m away, most of it {usual} m"));
        }
        let backdrop = Backdrop::new(&staged, &staged.cameras[0], [SIDE, SIDE], None);
        let grade = Grade { stops: auto_exposure(&film, backdrop.as_ref()), tonemap: Tonemap::default() };
        let picture = grade.picture(&film);
        let mut luminances: Vec<f32> = picture
            .chunks_exact(3)
            .map(|p| (0.2126 * f32::from(p[0]) + 0.7152 * f32::from(p[1]) + 0.0722 * f32::from(p[2])) / 255.0)
            .collect();
        luminances.sort_by(f32::total_cmp);
        let median = luminances[luminances.len() / 2];
        if !(0.15..=0.75).contains(&median) {
            wrong.push(format!("{name}: its median luminance is {median}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn a_scene_with_light_and_camera_is_left_alone() {
    let scene = lightsheaf::scene::load("builtin:cornell_point").unwrap();
    let mut staged = scene.clone();
    staging::complete(&mut staged, &Staging::default()).unwrap();
    assert_eq!((staged.lights, staged.environment, staged.cameras.len()), (scene.lights, scene.environment, 1));
    assert_eq!(staged.notes, [""; 0]);
}

#[test]
fn auto_chooses_another_camera_beside_the_file_s() {
    let mut scene = lightsheaf::scene::load("builtin:cornell_point").unwrap();
    let staging = Staging { camera: CameraChoice::Auto, ..Staging::default() };
    staging::complete(&mut scene, &staging).unwrap();
    assert_eq!((scene.cameras.len(), staging.camera.index(&scene.cameras)), (2, Some(1)));
    assert_eq!(scene.cameras[1].name, camera::AUTO);
    assert_eq!(CameraChoice::Named("camera".to_owned()).index(&scene.cameras), Some(0));
    assert_eq!(CameraChoice::Named("7".to_owned()).index(&scene.cameras), None);
}

/// The aspect ratio of the image decides the distance: a wide thing fills a wide image, too.
#[test]
fn the_image_s_shape_is_filled() {
    let scene = of(|s| block(s, Vec3::new(4.0, 1.0, 0.5), Vec3::ZERO));
    for size in [[160, 90], [90, 160], [64, 64]] {
        let mut staged = scene.clone();
        staging::complete(&mut staged, &Staging { size, ..Staging::default() }).unwrap();
        let geometry = lightsheaf::scene::Geometry::new(&staged);
        let at = geometry.vertices.iter().map(|v| staged.cameras[0].project(v.position, size[0], size[1]).unwrap());
        let (low, high) = at.fold((glam::Vec2::MAX, glam::Vec2::MIN), |(low, high), p| (low.min(p), high.max(p)));
        let span = (high - low).max_element();
        assert!((0.75..0.9).contains(&span), "{size:?}: {span}");
    }
}

/// A model on the plane that a modelling program put below it fills the picture, and the plane does not. Where the things
/// are spread over the ground, or are a detail of it, the picture shows all.
#[test]
fn what_stands_on_a_wide_ground_fills_the_picture() {
    let on = |ground: Mesh, balls: &[Vec3]| {
        let mut scene = of(|s| place(s, ground, Sides::OneCulled, Vec3::ONE, Vec3::ZERO));
        balls.iter().for_each(|&at| place(&mut scene, shapes::icosphere(3), Sides::OneCulled, Vec3::ONE, at));
        complete(&mut scene);
        scene
    };
    let span = |scene: &Scene, instances: std::ops::Range<usize>| {
        let only = Scene { instances: scene.instances[instances].to_vec(), ..scene.clone() };
        let vertices = lightsheaf::scene::Geometry::new(&only).vertices;
        let at = vertices.iter().filter_map(|v| scene.cameras[0].project(v.position, SIDE, SIDE));
        let (low, high) = at.fold((glam::Vec2::MAX, glam::Vec2::MIN), |(low, high), p| (low.min(p), high.max(p)));
        (high - low).max_element()
    };
    let plane = || shapes::quad(Vec3::new(-50.0, 0.0, 50.0), Vec3::X * 100.0, Vec3::NEG_Z * 100.0);
    let one = on(plane(), &[Vec3::new(3.0, 1.0, -5.0)]);
    assert!((0.75..0.9).contains(&span(&one, 1..2)), "one: {}", span(&one, 1..2));
    let pair = on(plane(), &[Vec3::new(3.0, 1.0, -5.0), Vec3::new(9.0, 1.0, -5.0)]);
    assert!((0.75..0.9).contains(&span(&pair, 1..3)), "two: {}", span(&pair, 1..3));
    let apart = on(plane(), &[Vec3::new(-30.0, 1.0, -30.0), Vec3::new(30.0, 1.0, 30.0)]);
    assert!((0.75..0.9).contains(&span(&apart, 0..3)), "apart: {}", span(&apart, 0..3));
    let mut plate = Mesh { normals: Vec::new(), ..shapes::disk(20_000) };
    plate.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x, p.z, -p.y) * 50.0);
    let detail = on(plate, &[Vec3::Y]);
    assert!((0.75..0.9).contains(&span(&detail, 0..2)), "a detail: {}", span(&detail, 0..2));
}

/// A lamp's bulb in a room counts as its light; the emissive eyes of a toy do not.
#[test]
fn light_that_shows_nothing_is_not_enough() {
    let with_emitter = |radiance: f32, size: f32| {
        let mut scene = of(|s| block(s, Vec3::ONE, Vec3::ZERO));
        let emission = Some(Emission { radiance: Vec3::splat(radiance).into(), two_sided: true });
        let eye = shapes::quad(Vec3::new(-size, -size, 1.001), Vec3::X * (2.0 * size), Vec3::Y * (2.0 * size));
        shapes::add(&mut scene, eye, Material { emission, ..matte(Sides::Two) });
        complete(&mut scene);
        scene
    };
    assert!(with_emitter(1.0, 0.05).environment.is_some(), "an eye on a toy");
    assert!(with_emitter(1.0, 0.9).environment.is_some(), "a screen that lights nothing else");
    // Narrower than a pixel, and in most of them: what glows there is not what the block reflects.
    let mut striped = of(|s| block(s, Vec3::ONE, Vec3::ZERO));
    let stripe =
        || Material { emission: Some(Emission { radiance: Vec3::ONE.into(), two_sided: false }), ..matte(Sides::Two) };
    for at in (-19..20).map(|n| 0.05 * n as f32) {
        let front = shapes::quad(Vec3::new(at, -1.0, 1.001), Vec3::X * 0.003, Vec3::Y * 2.0);
        let right = shapes::quad(Vec3::new(1.001, -1.0, at), Vec3::Z * -0.003, Vec3::Y * 2.0);
        let top = shapes::quad(Vec3::new(at, 1.001, 1.0), Vec3::X * 0.003, Vec3::Z * -2.0);
        [front, right, top].into_iter().for_each(|mesh| shapes::add(&mut striped, mesh, stripe()));
    }
    complete(&mut striped);
    assert!(striped.environment.is_some(), "stripes on a dark block");
    let mut panelled = room(Vec3::new(3.0, 1.4, 4.0), false);
    let panel = shapes::quad(Vec3::new(-1.0, 1.39, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0);
    shapes::add(&mut panelled, panel, stripe());
    complete(&mut panelled);
    assert_eq!((panelled.lights.len(), panelled.environment), (0, None), "a panel in the ceiling lights a room");
    // A format that says its light means it.
    let mut dim = of(|s| block(s, Vec3::ONE, Vec3::ZERO));
    dim.says_its_light = true;
    let emission = Some(Emission { radiance: Vec3::ONE.into(), two_sided: true });
    let eye = shapes::quad(Vec3::new(-0.05, -0.05, 1.001), Vec3::X * 0.1, Vec3::Y * 0.1);
    shapes::add(&mut dim, eye, Material { emission, ..matte(Sides::Two) });
    complete(&mut dim);
    assert!(dim.environment.is_none());
    // Every surface emits, but what its texture has is black, up to rounding.
    let mut dark = of(|s| block(s, Vec3::ONE, Vec3::ZERO));
    let black = Image { name: "black".to_owned(), width: 1, height: 1, texels: vec![[1, 1, 1, 255]] };
    dark.images.push(black);
    dark.textures.push(Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb: true });
    let texture = Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY });
    dark.materials[0].emission = Some(Emission { radiance: Color { factor: Vec3::ONE, texture }, two_sided: false });
    complete(&mut dark);
    assert!(dark.environment.is_some(), "emission that cannot be seen");
    let mut lit = room(Vec3::new(3.0, 1.4, 4.0), false);
    lit.lights.push(Light::Point { position: Vec3::Y, intensity: Vec3::splat(0.01) });
    complete(&mut lit);
    assert_eq!((lit.lights.len(), lit.environment.is_none(), lit.notes.len()), (1, true, 1), "{:?}", lit.notes);
}

#[test]
fn no_light_is_added_where_none_is_wanted() {
    let mut scene = of(|s| block(s, Vec3::ONE, Vec3::ZERO));
    let mut staging = Staging::default();
    staging.environment.source = Some("none".to_owned());
    staging::complete(&mut scene, &staging).unwrap();
    assert_eq!((scene.environment, scene.lights.len(), scene.cameras.len()), (None, 0, 1));
}

#[test]
fn a_scene_without_surfaces_has_a_camera() {
    let mut scene = Scene::default();
    staging::complete(&mut scene, &Staging::default()).unwrap();
    assert_eq!(scene.cameras.len(), 1);
}
