//! Simple bodies as meshes, in Mitsuba's own frames and texture coordinates, and vertex normals for meshes
//! without any.
//!
//! Round bodies are inscribed polygons or polyhedra, scaled so that their area is exact and an emitter keeps
//! its power.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Vec2, Vec3};

use crate::scene::{Instance, Material, Mesh, Scene};

/// Returns the square [-1, 1]^2 in the plane z = 0, facing +Z; v runs along +Y.
#[must_use]
pub fn rectangle() -> Mesh {
    let uvs = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    Mesh {
        name: "rectangle".to_owned(),
        positions: uvs.map(|uv| (uv * 2.0 - 1.0).extend(0.0)).to_vec(),
        normals: vec![Vec3::Z; 4],
        uvs: [uvs.to_vec(), Vec::new()],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// Returns two triangles with corners a, a + u, a + u + v, a + v; the front is the side from which u turns
/// counter-clockwise into v. uv is (0, 0) at a + v, as for an image seen upright with u to the right and v
/// up.
#[must_use]
pub fn quad(a: Vec3, u: Vec3, v: Vec3) -> Mesh {
    Mesh {
        positions: vec![a, a + u, a + u + v, a + v],
        uvs: [vec![Vec2::new(0.0, 1.0), Vec2::ONE, Vec2::new(1.0, 0.0), Vec2::ZERO], Vec::new()],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    }
}

/// Returns a box from -half to half whose front faces point inwards.
#[must_use]
pub fn room(half: f32) -> Mesh {
    let mut mesh = Mesh::default();
    for (n, u) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for n in [n, -n] {
            // Seen from inside, u turns counter-clockwise into -n x u.
            let v = (-n).cross(u);
            let base = mesh.positions.len() as u32;
            let side = quad(half * (n - u - v), 2.0 * half * u, 2.0 * half * v);
            mesh.positions.extend(side.positions);
            mesh.triangles.extend(side.triangles.iter().map(|t| t.map(|i| i + base)));
        }
    }
    mesh
}

/// Adds a mesh with a material of its own and an identity transform.
pub fn add(scene: &mut Scene, mut mesh: Mesh, material: Material) {
    mesh.material = scene.materials.len();
    scene.materials.push(material);
    scene.instances.push(Instance { mesh: scene.meshes.len(), world_from_local: Affine3A::IDENTITY });
    scene.meshes.push(mesh);
}

/// Returns the cube [-1, 1]^3; every face has its own corners and the whole uv square.
#[must_use]
pub fn cube() -> Mesh {
    let faces = [
        (Vec3::Z, Vec3::X),
        (Vec3::NEG_X, Vec3::NEG_Z),
        (Vec3::Y, Vec3::NEG_Z),
        (Vec3::Y, Vec3::X),
        (Vec3::Y, Vec3::Z),
        (Vec3::NEG_Y, Vec3::X),
    ];
    let mut mesh = Mesh { name: "cube".to_owned(), ..Mesh::default() };
    for (along_u, along_v) in faces {
        let normal = along_v.cross(along_u);
        let first = mesh.positions.len() as u32;
        for uv in [Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO] {
            let Vec2 { x, y } = uv * 2.0 - 1.0;
            mesh.positions.push(normal + x * along_u + y * along_v);
            mesh.normals.push(normal);
            mesh.uvs[0].push(uv);
        }
        mesh.triangles.extend([[0, 1, 2], [3, 0, 2]].map(|t: [u32; 3]| t.map(|i| first + i)));
    }
    mesh
}

/// Returns the unit disk in the plane z = 0, facing +Z; u is the radius, v the angle over 2 pi.
#[must_use]
pub fn disk(segments: u32) -> Mesh {
    let step = TAU / segments as f32;
    // An inscribed polygon has the area n sin(2 pi / n) / 2.
    let radius = (TAU / (segments as f32 * step.sin())).sqrt();
    let mut mesh = Mesh { name: "disk".to_owned(), ..Mesh::default() };
    for i in 0..=segments {
        let v = i as f32 / segments as f32;
        let rim = Vec2::from_angle(step * (i % segments) as f32) * radius;
        mesh.positions.extend([Vec3::ZERO, rim.extend(0.0)]);
        mesh.uvs[0].extend([Vec2::new(0.0, v), Vec2::new(1.0, v)]);
    }
    mesh.normals = vec![Vec3::Z; mesh.positions.len()];
    mesh.triangles = (0..segments).map(|i| [2 * i, 2 * i + 1, 2 * i + 3]).collect();
    mesh
}

/// Returns the side of the unit cylinder around Z from z = 0 to 1, facing outwards; u is the angle over 2 pi,
/// v is z.
#[must_use]
pub fn cylinder(segments: u32) -> Mesh {
    let step = TAU / segments as f32;
    // A chord spans 2 sin(step / 2) of an arc of length step.
    let radius = 0.5 * step / (0.5 * step).sin();
    let mut mesh = Mesh { name: "cylinder".to_owned(), ..Mesh::default() };
    for i in 0..=segments {
        let u = i as f32 / segments as f32;
        let normal = Vec2::from_angle(step * (i % segments) as f32).extend(0.0);
        mesh.positions.extend([normal * radius, normal * radius + Vec3::Z]);
        mesh.normals.extend([normal; 2]);
        mesh.uvs[0].extend([Vec2::new(u, 0.0), Vec2::new(u, 1.0)]);
    }
    mesh.triangles = (0..segments).map(|i| 2 * i).flat_map(|i| [[i, i + 2, i + 1], [i + 1, i + 2, i + 3]]).collect();
    mesh
}

/// Returns the unit sphere with poles at +Z (v = 0) and -Z; u is the longitude from +X over 2 pi. It has 2
/// columns (rows - 1) triangles.
#[must_use]
pub fn sphere(columns: u32, rows: u32) -> Mesh {
    let mut mesh = Mesh { name: "sphere".to_owned(), ..Mesh::default() };
    for row in 0..=rows {
        let v = row as f32 / rows as f32;
        // The poles are set exactly, since sin(pi) is not 0 in floating point.
        let (sin_theta, cos_theta) = match row {
            0 => (0.0, 1.0),
            r if r == rows => (0.0, -1.0),
            _ => (PI * v).sin_cos(),
        };
        for column in 0..=columns {
            let phi = TAU * (column % columns) as f32 / columns as f32;
            mesh.normals.push(Vec3::new(sin_theta * phi.cos(), sin_theta * phi.sin(), cos_theta));
            mesh.uvs[0].push(Vec2::new(column as f32 / columns as f32, v));
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = row * (columns + 1) + column;
            let b = a + columns + 1;
            if row > 0 {
                mesh.triangles.push([a, b, a + 1]);
            }
            if row + 1 < rows {
                mesh.triangles.push([a + 1, b, b + 1]);
            }
        }
    }
    keep_area(&mut mesh);
    mesh
}

/// Returns an icosahedron subdivided `level` times and projected onto the unit sphere: 20 * 4^level triangles
/// with exact normals.
///
/// Unlike the other bodies it is inscribed and not scaled.
#[must_use]
pub fn icosphere(level: u32) -> Mesh {
    let phi = 0.5 * (1.0 + 5.0_f64.sqrt());
    // The points are the corners of three golden rectangles.
    let mut points: Vec<glam::DVec3> = [(1.0, phi), (-1.0, phi), (1.0, -phi), (-1.0, -phi)]
        .into_iter()
        .flat_map(|(a, b)| [glam::DVec3::new(a, b, 0.0), glam::DVec3::new(0.0, a, b), glam::DVec3::new(b, 0.0, a)])
        .map(glam::DVec3::normalize)
        .collect();
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    // Neighbours are 63.4 degrees apart, so the faces are the triples of neighbours, wound outward.
    let near = |a: usize, b: usize| points[a].dot(points[b]) > 0.4;
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(c, a) {
                    let outward = points[a].cross(points[b]).dot(points[c]) > 0.0;
                    triangles.push(if outward { [a, b, c] } else { [a, c, b] }.map(|i| i as u32));
                }
            }
        }
    }
    for _ in 0..level {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        let cut = |&[a, b, c]: &[u32; 3]| {
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        triangles = triangles.iter().flat_map(cut).collect();
    }
    let positions: Vec<Vec3> = points.iter().map(|p| p.as_vec3()).collect();
    Mesh { name: "sphere".to_owned(), normals: positions.clone(), positions, triangles, ..Mesh::default() }
}

/// Scales a unit sphere's vertices along their normals until the mesh has the sphere's area.
fn keep_area(mesh: &mut Mesh) {
    let double_area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.normals[i as usize]);
        f64::from((b - a).cross(c - a).length())
    };
    let area = 0.5 * mesh.triangles.iter().map(double_area).sum::<f64>();
    let radius = (4.0 * std::f64::consts::PI / area).sqrt() as f32;
    mesh.positions = mesh.normals.iter().map(|&n| n * radius).collect();
}
