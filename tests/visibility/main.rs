//! Answers of triangle lists and of ray queries against the CPU's hierarchy: nearest hits along bundles,
//! nearest hits from a point, and edges, on random points of scenes.
//!
//! Two nearest hits are the same if they name the same triangle or lie within 1e-4 of the scene's radius of
//! each other. Every difference is classified in double precision. The long table:
//!
//!     cargo test --test visibility -- --ignored --nocapture

mod agreement;
#[path = "../common/mod.rs"]
mod common;
mod lists;
mod rays;
mod speed;
mod tables;

use common::random::Random;
use glam::{Vec2, Vec3};
use lightsheaf::scene::{Filter, Image, Instance, Material, Mesh, Opacity, Scalar, Scene, Texture, TextureRef, Wrap};
use lightsheaf::staging::{self, Staging};

fn cornell() -> Scene {
    staging::load("builtin:cornell_point", &Staging::default()).unwrap()
}

/// Returns a box whose walls are displaced by smooth noise: about `triangles` triangles of all orientations,
/// closed.
fn displaced_room(triangles: u32) -> Scene {
    let n = (f64::from(triangles) / 12.0).sqrt().round() as u32;
    let hash = |x: i32, y: i32, z: i32| {
        let key = (x as u32).wrapping_mul(0x8da6_b343)
            ^ (y as u32).wrapping_mul(0xd816_3841)
            ^ (z as u32).wrapping_mul(0xcb1a_b31f);
        Random(u64::from(key)).unit()
    };
    let noise = |p: Vec3| {
        let (cell, f) = (p.floor(), p - p.floor());
        let f = f * f * (3.0 - 2.0 * f);
        let at = |dx: i32, dy: i32, dz: i32| hash(cell.x as i32 + dx, cell.y as i32 + dy, cell.z as i32 + dz);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let row = |dy, dz| mix(at(0, dy, dz), at(1, dy, dz), f.x);
        mix(mix(row(0, 0), row(1, 0), f.y), mix(row(0, 1), row(1, 1), f.y), f.z)
    };
    let mut mesh = Mesh { name: "room".to_owned(), ..Mesh::default() };
    for face in 0..6 {
        let base = mesh.positions.len() as u32;
        for j in 0..=n {
            for i in 0..=n {
                let (u, v) = (2.0 * i as f32 / n as f32 - 1.0, 2.0 * j as f32 / n as f32 - 1.0);
                let axis = face / 2;
                let mut p = Vec3::ZERO;
                p[axis] = if face % 2 == 0 { -1.0 } else { 1.0 };
                p[(axis + 1) % 3] = u;
                p[(axis + 2) % 3] = v;
                // The height depends on the position alone, so that faces fit at their common edges.
                let height = noise(p * 4.0 + 17.0) + 0.5 * noise(p * 11.0 + 31.0);
                mesh.positions.push(p * (1.0 - 0.2 * height));
            }
        }
        for j in 0..n {
            for i in 0..n {
                let at = |di, dj| base + (j + dj) * (n + 1) + i + di;
                mesh.triangles.push([at(0, 0), at(1, 0), at(1, 1)]);
                mesh.triangles.push([at(0, 0), at(1, 1), at(0, 1)]);
            }
        }
    }
    Scene {
        name: "displaced room".to_owned(),
        meshes: vec![mesh],
        instances: vec![Instance { mesh: 0, world_from_local: glam::Affine3A::IDENTITY }],
        materials: vec![Material::diffuse("wall", Vec3::splat(0.7))],
        ..Scene::default()
    }
}

/// Returns a room with holes in a checker pattern on some walls.
fn masked_room() -> Scene {
    let mut scene = displaced_room(6_000);
    let checker = |i: u32| if (i ^ (i >> 4)) & 1 == 1 { [255; 4] } else { [255, 255, 255, 0] };
    scene.images =
        vec![Image { name: "checker".to_owned(), width: 16, height: 16, texels: (0..256).map(checker).collect() }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Nearest, srgb: false }];
    let texture = TextureRef { texture: 0, uv_set: 0, transform: glam::Affine2::IDENTITY };
    let value = Scalar { factor: 1.0, texture: Some((texture, 3)) };
    let wall = scene.materials[0].clone();
    scene.materials.push(Material { opacity: Some(Opacity::CutOut { value, cutoff: 0.5 }), ..wall });
    let mesh = &mut scene.meshes[0];
    mesh.uvs[0] = mesh.positions.iter().map(|p| Vec2::new(p.x, p.y + p.z) * 3.0).collect();
    // Two walls have holes: the first and the fourth, so that geometries alternate.
    let per_face = mesh.triangles.len() / 6;
    let mesh = scene.meshes.remove(0);
    for face in 0..6 {
        let triangles = mesh.triangles[face * per_face..(face + 1) * per_face].to_vec();
        scene.meshes.push(Mesh { triangles, material: usize::from(face % 3 == 0), ..mesh.clone() });
    }
    scene.instances = (0..6).map(|mesh| Instance { mesh, world_from_local: glam::Affine3A::IDENTITY }).collect();
    scene
}
