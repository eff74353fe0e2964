//! Tests of mesh files that are opened as scenes: OBJ with its materials, PLY, and STL.

use std::path::Path;

use crate::common;

use glam::{Vec2, Vec3};
use lightsheaf::scene::model::shapes;
use lightsheaf::scene::{self, Boundary, Bsdf, Material, Opacity, Scene, Sides};
use lightsheaf::staging::{self, Staging};

const QUAD: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

fn obj(mtl: &str, body: &str, files: &[(&str, Vec<u8>)]) -> Scene {
    let text = format!("mtllib box.mtl\n{QUAD}{body}");
    let resolver = |name: &str| match name {
        "box.mtl" => Some(mtl.as_bytes().to_vec()),
        _ => files.iter().find(|(n, _)| *n == name).map(|(_, bytes)| bytes.clone()),
    };
    scene::load_bytes("box.obj", text.as_bytes(), &resolver).unwrap_or_else(|e| panic!("{e}"))
}

fn material(mtl: &str) -> Material {
    obj(&format!("newmtl m\n{mtl}\n"), "usemtl m\nf 1/1 2/2 3/3 4/4\n", &[]).materials.remove(0)
}

/// Returns the bytes of a PNG file.
fn png(image: &image::RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    image.write_to(&mut std::io::Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
    bytes
}

#[test]
fn material_files_become_the_model() {
    let wall = material("Kd 0.7 0.5 0.3\nKs 0 0 0\nNs 10\nillum 2");
    assert!(matches!(wall.bsdf, Bsdf::Diffuse { reflectance } if reflectance == Vec3::new(0.7, 0.5, 0.3).into()));
    assert_eq!((wall.sides, wall.opacity, wall.emission), (Sides::Two, None, None));
    let lamp = material("Kd 0.78 0.78 0.78\nKe 10 9 8");
    assert_eq!(lamp.emission.map(|e| (e.radiance.factor, e.two_sided)), Some((Vec3::new(10.0, 9.0, 8.0), true)));
    // alpha^2 = 2 / (30 + 2), so that alpha is 1/4 and the roughness 1/2.
    let paint = material("Kd 0.1 0.2 0.3\nKs 0.5 0.5 0.5\nNs 30\nillum 2");
    let Bsdf::MetallicRoughness { metallic, roughness, .. } = paint.bsdf else { panic!("{paint:?}") };
    assert!(metallic == 0.0.into() && (roughness.factor - 0.5).abs() < 1e-6, "{paint:?}");
    let mirror = material("Kd 0.01 0.01 0.01\nKs 0.95 0.9 0.8\nNs 1000\nillum 5");
    let Bsdf::MetallicRoughness { base_color, metallic, roughness, .. } = mirror.bsdf else { panic!("{mirror:?}") };
    assert_eq!((base_color, metallic, roughness), (Vec3::new(0.95, 0.9, 0.8).into(), 1.0.into(), 0.0.into()));
    let steel = material("Kd 0.5 0.5 0.5\nPm 1\nPr 0.3");
    let Bsdf::MetallicRoughness { metallic, roughness, .. } = steel.bsdf else { panic!("{steel:?}") };
    assert_eq!((metallic, roughness), (1.0.into(), 0.3.into()));
    let glass = material("Kd 0 0 0\nNi 1.5\nTf 0.9 1 1\nd 0.1\nillum 7");
    assert!(matches!(glass.bsdf, Bsdf::Dielectric { eta: 1.5, transmission, .. } if transmission.factor.x == 0.9));
    assert!(matches!(glass.boundary, Boundary::Volume { .. }) && glass.opacity.is_none());
    for thin in ["d 0.25", "Tr 0.75"] {
        assert_eq!(material(thin).opacity, Some(Opacity::Blended { value: 0.25.into() }), "{thin}");
    }
}

/// A file that would show nothing at all is drawn; where something else is seen, what is invisible stays so.
#[test]
fn files_of_invisible_materials_are_drawn() {
    let faces = "usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n";
    let none = obj("newmtl a\nKd 1 1 1\nd 0\nnewmtl b\nTr 1\n", faces, &[]);
    assert!(none.materials.iter().all(|m| m.opacity.is_none()), "{:?}", none.materials);
    assert!(none.warnings.iter().any(|w| w.contains("opacity 0")), "{:?}", none.warnings);
    let some = obj("newmtl a\nKd 1 1 1\nd 0\nnewmtl b\nKd 1 1 1\n", faces, &[]);
    // Light passes what is invisible as it passes a hole.
    let opacities = some.materials.iter().map(|m| m.opacity).collect::<Vec<_>>();
    assert_eq!(opacities, [Some(Opacity::CutOut { value: 0.0.into(), cutoff: 0.5 }), None]);
}

/// A texture keeps its rows: v points up in the file. What is not there is a warning, and grey.
#[test]
fn textures_and_what_is_missing() {
    let png = png(&image::RgbImage::from_fn(1, 2, |_, y| image::Rgb([255 * (1 - y as u8), 0, 0])));
    let mtl = "newmtl a\nKd 1 1 1\nmap_Kd -clamp on wood.png\nnewmtl b\nKd 0.2 0.2 0.2\nmap_Kd none.png\n";
    let body = "f 1 2 3\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1 2 3\nusemtl a\nf 1/1 3/3 4/4\nusemtl c\nf 1 2 3\n";
    let scene = obj(mtl, body, &[("wood.png", png)]);
    let triangles: Vec<_> = scene.meshes.iter().map(|mesh| (mesh.name.as_str(), mesh.triangles.len())).collect();
    assert_eq!(triangles, [("", 1), ("a", 2), ("b", 1), ("c", 1)]);
    let Bsdf::Diffuse { reflectance } = scene.materials[scene.meshes[1].material].bsdf else { panic!("not diffuse") };
    let image = &scene.images[scene.textures[reflectance.texture.unwrap().texture].image];
    assert_eq!((image.texels[0][0], scene.meshes[1].uvs[0][0].y), (255, 1.0), "the file's v is 0 at the last row");
    assert!(
        matches!(scene.materials[scene.meshes[2].material].bsdf, Bsdf::Diffuse { reflectance } if reflectance.texture.is_none())
    );
    assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("none.png"), "{:?}", scene.warnings);
    let bare = scene::load_bytes("box.obj", format!("mtllib gone.mtl\n{QUAD}f 1 2 3\n").as_bytes(), &|_| None).unwrap();
    assert!(bare.warnings[0].contains("gone.mtl"), "{:?}", bare.warnings);
    let error = scene::load_bytes("box.obj", b"v 0 0 x\n", &|_| None).unwrap_err().to_string();
    assert!(error.contains("line 1") && error.contains("`x` is not a number"), "{error}");
}

/// Statements over several lines, UTF-16, and what a file refers to and does not have: other programs draw such files, too.
#[test]
fn obj_files_as_programs_write_them() {
    let load = |bytes: &[u8]| scene::load_bytes("box.obj", bytes, &|_| None).unwrap_or_else(|e| panic!("{e}"));
    let over_lines = format!("# C:\\ends\\\n{QUAD}f 1 2 \\\n3 \\\r\n4\n");
    let units: Vec<u16> = format!("{QUAD}f 1 2 3 4\n").encode_utf16().collect();
    let utf16 = |mark: [u8; 2], bytes: fn(u16) -> [u8; 2]| {
        mark.into_iter().chain(units.iter().flat_map(|&unit| bytes(unit))).collect::<Vec<_>>()
    };
    for bytes in [
        over_lines.into_bytes(),
        utf16([0xff, 0xfe], u16::to_le_bytes),
        utf16([0xfe, 0xff], u16::to_be_bytes),
        format!("\u{feff}{QUAD}f 1 2 3 4\n").into_bytes(),
    ] {
        let scene = load(&bytes);
        assert_eq!(scene.meshes[0].triangles, [[0, 1, 2], [0, 2, 3]], "{:?}", String::from_utf8_lossy(&bytes));
        assert_eq!(scene.meshes[0].positions[2], Vec3::new(1.0, 1.0, 0.0));
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    }
    let lost = load(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 1 1\nf 1/1/1 2/2/1 3/1/1\nf 1 2\nf 3\n");
    assert_eq!((lost.meshes[0].triangles.len(), lost.meshes[0].uvs[0][1]), (1, Vec2::new(0.0, 1.0)));
    assert_eq!(lost.warnings.len(), 2, "{:?}", lost.warnings);
    assert!(lost.warnings[0].ends_with("4 are left out") && lost.warnings[1].ends_with(": 2"), "{:?}", lost.warnings);
}

/// A texture that a comment names, with coordinates of vertices or of corners; v points up.
#[test]
fn ply_files_have_their_texture() {
    let png = png(&image::RgbImage::from_pixel(1, 1, image::Rgb([255, 0, 0])));
    let resolver = |name: &str| (name == "a skin.png").then(|| png.clone());
    let head = "ply\nformat ascii 1.0\ncomment TextureFile a skin.png\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\n";
    let colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let faces = "element face 2\nproperty list uchar int vertex_indices\n";
    let of_vertices = format!(
        "{head}property float s\nproperty float t\n{faces}end_header\n0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 0.25\n0 1 0 0 1\n\
         3 0 1 2\n3 0 2 3\n"
    );
    // The diagonal has other coordinates on its two sides.
    let of_corners = format!(
        "{head}{colors}{faces}property list uchar float texcoord\nend_header\n0 0 0 9 9 9\n1 0 0 9 9 9\n1 1 0 9 9 9\n0 1 0 9 9 9\n\
         3 0 1 2 6 0 0 1 0 1 0.25\n3 0 2 3 6 0.5 0 1 1 0 1\n"
    );
    for (text, vertices) in [(of_vertices, 4), (of_corners, 6)] {
        let scene = scene::load_bytes("scan.ply", text.as_bytes(), &resolver).unwrap();
        let mesh = &scene.meshes[0];
        assert!(scene.warnings.is_empty() && mesh.colors.is_empty(), "{:?}", scene.warnings);
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (vertices, 2));
        assert_eq!(mesh.uvs[0][mesh.triangles[0][2] as usize], Vec2::new(1.0, 0.75));
        assert!(mesh.normals.iter().all(|n| n.abs_diff_eq(Vec3::Z, 1e-6)), "{:?}", mesh.normals);
        let Bsdf::Diffuse { reflectance } = scene.materials[0].bsdf else { panic!("not diffuse") };
        assert!(reflectance.texture.is_some() && reflectance.factor == Vec3::ONE);
    }
}

/// Corners that have no texture coordinates where others have them are at zero: of strips, and of faces with too few.
#[test]
fn ply_files_may_lack_texture_coordinates_of_some_corners() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 2\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 0 0.5 1 0.5 1 0.5\n3 0 2 3 2 1 1\n3 1 2 3\n";
    let mesh = scene::load_bytes("scan.ply", text.as_bytes(), &|_| None).unwrap().meshes.remove(0);
    let corners: Vec<_> = mesh.triangles.as_flattened().iter().map(|&i| mesh.uvs[0][i as usize].y).collect();
    assert_eq!(corners, [0.5, 0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    let places: Vec<_> = mesh.triangles[2].map(|i| mesh.positions[i as usize].truncate()).to_vec();
    assert_eq!(places, [Vec2::X, Vec2::ONE, Vec2::Y]);
}

/// A box without normals has flat faces and sharp edges, a ball none.
#[test]
fn ply_files_without_normals_keep_sharp_edges() {
    let load = |positions: &[Vec3], triangles: &[[u32; 3]]| {
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar int vertex_indices\nend_header\n",
            positions.len(),
            triangles.len()
        );
        positions.iter().for_each(|p| text.push_str(&format!("{} {} {}\n", p.x, p.y, p.z)));
        triangles.iter().for_each(|[a, b, c]| text.push_str(&format!("3 {a} {b} {c}\n")));
        scene::load_bytes("scan.ply", text.as_bytes(), &|_| None).unwrap().meshes.remove(0)
    };
    let corners: Vec<Vec3> = (0..8).map(|n| Vec3::new((n & 1) as f32, (n >> 1 & 1) as f32, (n >> 2) as f32)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let sides: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let cube = load(&corners, &sides);
    assert_eq!((cube.positions.len(), cube.triangles.len()), (24, 12));
    for triangle in &cube.triangles {
        let [a, b, c] = triangle.map(|i| cube.positions[i as usize]);
        let face = (b - a).cross(c - a).normalize();
        assert!(triangle.iter().all(|&i| cube.normals[i as usize].abs_diff_eq(face, 1e-6)), "{triangle:?}");
    }
    let ball = shapes::icosphere(1);
    let mesh = load(&ball.positions, &ball.triangles);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (ball.positions.len(), ball.triangles.len()));
    assert!(mesh.normals.iter().zip(&mesh.positions).all(|(n, p)| n.dot(p.normalize()) > 0.99), "{:?}", mesh.normals);
    // A vertex of many faces takes no longer than as many vertices.
    let corner = |n: u32| Vec3::new((n as f32 * 3e-5).cos(), (n as f32 * 3e-5).sin(), 0.0);
    let rim: Vec<Vec3> = std::iter::once(Vec3::ZERO).chain((0..=200_000).map(corner)).collect();
    let began = std::time::Instant::now();
    let fan = load(&rim, &(1..=200_000).map(|n| [0, n, n + 1]).collect::<Vec<_>>());
    assert!(began.elapsed().as_secs() < 10, "{:?}", began.elapsed());
    assert!(fan.positions.len() == rim.len() && fan.normals.iter().all(|n| n.abs_diff_eq(Vec3::Z, 1e-3)));
}

#[test]
fn ply_files_have_their_colours() {
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n";
    let bytes = format!("{header}0 0 0 255 0 0\n1 0 0 188 0 0\n0 1 0 255 0 0\n3 0 1 2\n");
    let scene = scene::load_bytes("scan.ply", bytes.as_bytes(), &|_| None).unwrap();
    assert_eq!((scene.meshes[0].colors[0].truncate(), scene.meshes[0].normals[0]), (Vec3::X, Vec3::Z));
    // Colours are written as they are shown: 188 of 255 is half the light.
    assert!((scene.meshes[0].colors[1].x - 0.5).abs() < 0.01, "{:?}", scene.meshes[0].colors);
    assert!(matches!(scene.materials[0].bsdf, Bsdf::Diffuse { reflectance } if reflectance == Vec3::ONE.into()));
}

/// A strip of five corners and one of three: of each, every second triangle is wound the other way, so that all look up.
#[test]
fn ply_files_may_have_strips() {
    let header = |vertices, elements: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             {elements}end_header\n"
        )
    };
    let strips = "element tristrips 1\nproperty list int int vertex_indices\n";
    let corners = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n";
    let load = |text: String| scene::load_bytes("scan.ply", text.as_bytes(), &|_| None);
    let scene = load(format!("{}{corners}9 0 1 2 3 4 -1 0 1 2\n", header(5, strips))).unwrap();
    assert_eq!(scene.meshes[0].triangles, [[0, 1, 2], [2, 1, 3], [2, 3, 4], [0, 1, 2]]);
    assert!(scene.meshes[0].normals.iter().all(|n| n.abs_diff_eq(Vec3::Z, 1e-6)), "{:?}", scene.meshes[0].normals);
    let error = load(format!("{}{corners}3 0 1 5\n", header(5, strips))).unwrap_err().to_string();
    assert!(error.contains("vertex 5 of 5"), "{error}");
}

/// Points of scanners, some of which are not known, and Gaussian splats, some of which are mostly transparent.
#[test]
fn points_of_ply_files_are_balls() {
    let load = |properties: &[&str], points: &[&[f32]]| {
        let mut file = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", points.len()).into_bytes();
        for property in ["x", "y", "z"].iter().chain(properties) {
            file.extend(format!("property float {property}\n").bytes());
        }
        file.extend(b"end_header\n");
        file.extend(points.iter().copied().flatten().flat_map(|value| value.to_le_bytes()));
        scene::load_bytes("scan.ply", &file, &|_| None).unwrap()
    };
    let unknown = [f32::NAN; 3];
    let plain = load(&[], &[&[0., 0., 0.], &[1., 0., 0.], &[0., 1., 0.], &unknown, &[1., 1., 0.], &[0., 2., 0.]]);
    let [lost, balls] = ["not finite are left out: 1", "5 points and no faces: they are drawn as balls"];
    assert!(plain.warnings[0].contains(lost) && plain.warnings[1].contains(balls), "{:?}", plain.warnings);
    assert_eq!(plain.meshes[0].triangles.len(), 5 * 320);
    let splats = load(
        &["f_dc_0", "f_dc_1", "f_dc_2", "opacity"],
        &[
            &[0., 0., 0., 1.772_453_9, 0., -1.772_453_9, 3.],
            &[1., 0., 0., 0., 0., 0., -3.],
            &[9., 0., 0., 0., 0., 0., 1.],
        ],
    );
    let mesh = &splats.meshes[0];
    assert_eq!(mesh.triangles.len(), 2 * 320);
    let grey = 0.214_041_14; // of 0.5 in sRGB
    assert!(mesh.colors[0].abs_diff_eq(glam::Vec4::new(1.0, grey, 0.0, 1.0), 1e-5), "{}", mesh.colors[0]);
}

/// Rhinoceros ends lines of headers with a carriage return; older exporters of Blender break lines of comments.
#[test]
fn headers_of_ply_files_may_be_untidy() {
    let lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment made",
        "by hand",
        "element vertex 3",
        "property float x",
        "  property float y",
        "property float z",
        "element face 1",
        "property list uchar int vertex_indices",
        "end_header",
    ];
    for newline in ["\r", "\n", "\r\n"] {
        let mut binary = (lines.join(newline) + newline).into_bytes();
        // The first byte of the first number is that of a line's end.
        let first = f32::from_bits(0x3f80_000a);
        let corners: [f32; 9] = [first, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        binary.extend(corners.iter().flat_map(|value| value.to_le_bytes()));
        binary.push(3);
        binary.extend([0_i32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
        let ascii = lines.join(newline).replace("binary_little_endian", "ascii")
            + &["", "1 0 0", " 2 0 0", "0 1 0 ", "3 0 1 2", ""].join(newline);
        for (bytes, x) in [(binary, first), (ascii.into_bytes(), 1.0)] {
            let scene = scene::load_bytes("rhino.ply", &bytes, &|_| None).unwrap();
            assert_eq!(scene.meshes[0].triangles, [[0, 1, 2]], "{newline:?}");
            assert_eq!(scene.meshes[0].positions[0], Vec3::new(x, 0.0, 0.0), "{newline:?}");
        }
    }
    let header =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty double y\nproperty float z\nend_header\n";
    let cloud =
        scene::load_bytes("scan.ply", format!("{header}0 0 0\n-nan nan 1\n1 +inf 0\n").as_bytes(), &|_| None).unwrap();
    assert!(cloud.warnings[0].contains("left out: 2"), "{:?}", cloud.warnings);
}

#[test]
fn files_that_stand_for_others_say_how_to_fetch_them() {
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("pointer.obj");
    std::fs::write(&path, "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n").unwrap();
    let error = scene::load(path.to_str().unwrap()).unwrap_err().to_string();
    assert!(error.contains("git lfs pull"), "{error}");
}

/// Coordinates of surveyors have more digits than 32 bits.
#[test]
fn meshes_far_from_the_origin_keep_their_digits() {
    let [x, y] = [500_000.25, 5_400_000.75];
    let obj = format!("v {x} {y} 300.1\nv {} {y} 300.1\nv {x} {} 300.1\nf 1 2 3\n", x + 0.5, y + 0.5);
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let ply = format!("{header}{x} {y} 300.1\n{} {y} 300.1\n{x} {} 300.1\n3 0 1 2\n", x + 0.5, y + 0.5);
    for (name, text) in [("far.obj", obj), ("far.ply", ply)] {
        let scene = scene::load_bytes(name, text.as_bytes(), &|_| None).unwrap();
        let [a, b, c] = [0, 1, 2].map(|i| scene.meshes[0].positions[i]);
        assert!(
            (b - a).abs_diff_eq(0.5 * Vec3::X, 1e-6) && (c - a).abs_diff_eq(0.5 * Vec3::Y, 1e-6),
            "{name}: {a}, {b}, {c}"
        );
        assert!(a.length() < 1.0, "{name}: {a}");
        assert!(scene.notes.iter().any(|note| note.contains(", -5400001, -300]")), "{name}: {:?}", scene.notes);
    }
    let near = scene::load_bytes("near.obj", b"v 0 0 900\nv 1 0 900\nv 0 1 900\nf 1 2 3\n", &|_| None).unwrap();
    assert!(near.meshes[0].positions[0].z == 900.0 && near.notes.is_empty(), "{:?}", near.notes);
}

#[test]
fn points_and_lines_of_obj_files_without_faces_are_drawn() {
    let drawn = |text: &str| {
        let scene = scene::load_bytes("scan.obj", text.as_bytes(), &|_| None).unwrap();
        (scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum::<usize>(), scene.warnings.join(", "))
    };
    let points = "v 0 0 0\nv 1 0 0 \nv 0 1 0\n";
    let (tubes, said) = drawn(&format!("{points}usemtl a\nl 1 2 -1\n"));
    assert!(tubes == 2 * 12 && said.contains("2 lines and no faces"), "{tubes}, {said}");
    let (balls, said) = drawn(points);
    assert!(balls == 3 * 320 && said.contains("3 points and no faces"), "{balls}, {said}");
    let (faces, said) = drawn(&format!("{points}l 1 2\nf 1 2 3\n"));
    assert!(faces == 1 && !said.contains("no faces"), "{faces}, {said}");
    let (nothing, said) = drawn("# empty\n");
    assert!(nothing == 0 && !said.contains("no faces"), "{said}");
}

#[test]
fn obj_files_have_their_colours() {
    let load = |text: &str| scene::load_bytes("scan.obj", text.as_bytes(), &|_| None).unwrap();
    let unseen = load("v 0 0 0 1 0 0\nv 1 0 0 nan nan nan\nv 0 1 0 1 0 0\nf 1 2 3\n");
    assert_eq!(unseen.meshes[0].colors.iter().map(|c| c.y).collect::<Vec<_>>(), [0.0, 1.0, 0.0]);
    assert!(unseen.warnings.iter().any(|w| w.contains("white: 1")), "{:?}", unseen.warnings);
    let scene = load("v 0 0 0 1 0 0\nv 1 0 0 0.735357 0 0\nv 0 1 0\nf 1 2 3\n");
    let colors: Vec<_> = scene.meshes[0].colors.iter().map(|c| c.truncate()).collect();
    assert!(colors[1].abs_diff_eq(Vec3::X * 0.5, 1e-4) && [colors[0], colors[2]] == [Vec3::X, Vec3::ONE], "{colors:?}");
    assert!(matches!(scene.materials[0].bsdf, Bsdf::Diffuse { reflectance } if reflectance == Vec3::ONE.into()));
    // A fourth number is a weight.
    assert!(load("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n").meshes[0].colors.is_empty());
}

/// The same two triangles as text and as bytes, of which the header begins as text does: z points up, and corners are shared.
#[test]
fn stl_files_of_both_kinds_are_the_same_mesh() {
    let corners = [[0.0, 0.0, 0.0_f32], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]];
    let facets = [[0, 1, 2], [0, 2, 3]];
    let facet = |facet: &[usize; 3]| {
        let lines = facet.map(|i| format!("vertex {} {} {}\n", corners[i][0], corners[i][1], corners[i][2]));
        format!("facet normal 0 -1 0\nouter loop\n{}endloop\nendfacet\n", lines.concat())
    };
    // Files of several solids are a mesh, and names may be missing.
    let solid = |f: &[usize; 3]| format!("solid\n{}endsolid\n", facet(f));
    let ascii = facets.iter().map(solid).collect::<String>();
    let mut binary = b"solid of a program that writes bytes".to_vec();
    binary.resize(80, b' ');
    binary.extend(2_u32.to_le_bytes());
    for facet in &facets {
        binary.extend([0; 12]);
        binary.extend(facet.iter().flat_map(|&i| corners[i]).flat_map(f32::to_le_bytes));
        binary.extend([0; 2]);
    }
    let load = |bytes: &[u8]| scene::load_bytes("part.stl", bytes, &|_| None);
    for bytes in [ascii.as_bytes(), &binary] {
        let scene = load(bytes).unwrap_or_else(|e| panic!("{e}"));
        let mesh = &scene.meshes[0];
        assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NEG_X]);
        assert!(mesh.triangles == facets.map(|f| f.map(|i| i as u32)) && mesh.normals.is_empty());
        assert_eq!(scene.materials[0].sides, Sides::Two);
    }
    for (bytes, cause) in [
        (&binary[..120], "promises 2 triangles"),
        (b"solid a\nfacet normal 0 0 1\nvertex 0 0\n", "line 3: 3 numbers are expected, not 2"),
        (b"solid a\nvertex 0 0 inf\nvertex 0 0 1\nvertex 0 1 0\nendfacet\n", "not finite"),
        (b"solid a\nvertex 0 0 0\nendfacet\n", "a facet with 1 corners"),
        (b"solid a\nvertex 0 0 0\n", "truncated"),
        (b"solid a\nvertices\n", "`vertices` is no part"),
        (b"not a mesh", "begins with `solid`"),
    ] {
        let error = load(bytes).unwrap_err().to_string();
        assert!(error.contains(cause), "{error}");
    }
}

/// Splats that are packed say which file would open.
#[test]
fn packed_splats_are_an_error_that_says_what_to_do() {
    let file = "ply\nformat ascii 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\nproperty uint packed_position\n\
                end_header\n0\n7\n";
    let error = scene::load_bytes("a.compressed.ply", file.as_bytes(), &|_| None).unwrap_err().to_string();
    assert!(error.contains("a.compressed.ply") && error.contains("export them as a plain PLY"), "{error}");
}

/// A Cornell box of an archive: its own lamp is its light, a sphere mirrors and another one refracts.
#[test]
fn real_boxes_load() {
    let Some(shared) = common::shared() else { return };
    for (name, mirrors) in [("CornellBox-Original", 0), ("CornellBox-Sphere", 1)] {
        let path = shared.join(format!("scenes/obj/CornellBox/{name}.obj"));
        let scene = staging::load(path.to_str().unwrap(), &Staging::default()).unwrap_or_else(|e| panic!("{e}"));
        assert!(scene.environment.is_none() && scene.cameras.len() == 1, "{name}: {:?}", scene.notes);
        assert_eq!(scene.materials.iter().filter(|m| m.emission.is_some()).count(), 1, "{name}");
        assert_eq!(
            scene.materials.iter().filter(|m| matches!(m.bsdf, Bsdf::Dielectric { .. })).count(),
            mirrors,
            "{name}"
        );
        assert!(Path::new(&scene.name).exists() && scene.meshes.len() >= 6, "{name}: {}", scene.meshes.len());
    }
}
