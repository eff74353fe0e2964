//! Tests of the Mitsuba loader with real scenes and small ones made here.

use crate::common;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use common::shared;
use glam::{Affine2, Mat3, Vec2, Vec3};
use lightsheaf::reference::environment::Sky;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::scene::load::files::Disk;
use lightsheaf::scene::load::mitsuba;
use lightsheaf::scene::{
    self, Anisotropy, Boundary, Bsdf, Disney, Distribution, Environment, Filter, FovAxis, Fresnel, Geometry, Lens,
    Light, Opacity, Projection, Rows, Scene, Sides, SpotFalloff, Wrap,
};

/// Creates an empty folder for a test's files.
fn folder() -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let name = format!("loader-{}", COUNT.fetch_add(1, Ordering::Relaxed));
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    drop(std::fs::remove_dir_all(&path));
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Loads a scene of Mitsuba 3's dialect from its elements.
fn scene(body: &str) -> Scene {
    scene_in(&folder(), "3.0.0", body)
}

fn scene_in(folder: &Path, version: &str, body: &str) -> Scene {
    let path = folder.join("scene.xml");
    std::fs::write(&path, format!("<scene version=\"{version}\">{body}</scene>")).unwrap();
    mitsuba::load(&path, &Disk).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns the material of a rectangle with this bsdf.
fn bsdf(body: &str) -> Bsdf {
    scene(&format!("<shape type=\"rectangle\">{body}</shape>")).materials[0].bsdf
}

fn close(a: Vec3, b: Vec3, tolerance: f32) -> bool {
    (a - b).abs().max_element() <= tolerance
}

#[test]
fn real_scenes_load_with_their_triangles() {
    let Some(shared) = shared() else { return };
    let table = std::fs::read_to_string(shared.join("scenes/MANIFEST.tsv")).unwrap();
    let (mut loaded, mut counted) = (0, 0);
    for row in table.lines().map(|line| line.split('\t').collect::<Vec<_>>()) {
        if !row[0].starts_with("mitsuba/") {
            continue;
        }
        let scene = mitsuba::load(&shared.join("scenes").join(row[0]), &Disk).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(scene.cameras.len(), 1, "{}", row[0]);
        assert!(Geometry::new(&scene).vertices.iter().all(|v| v.position.is_finite()), "{}", row[0]);
        loaded += 1;
        if let Ok(expected) = row[7].parse::<usize>() {
            // The table counts the triangles of files, so that spheres are left out.
            let in_files = scene.instances.iter().map(|i| &scene.meshes[i.mesh]).filter(|m| m.triangles.len() != 8064);
            assert_eq!(in_files.map(|m| m.triangles.len()).sum::<usize>(), expected, "{}", row[0]);
            counted += 1;
        }
    }
    assert!(loaded >= 12 && counted >= 9, "{loaded} loaded, {counted} counted");
}

#[test]
fn real_glass_is_there_and_can_be_left_out() {
    let Some(shared) = shared() else { return };
    for (name, kinds) in [("cbox-spheres/scene.xml", 2), ("living-room/scene.xml", 1)] {
        let scene = mitsuba::load(&shared.join("scenes/mitsuba").join(name), &Disk).unwrap_or_else(|e| panic!("{e}"));
        let glass = |scene: &Scene| {
            let of = |i: &&lightsheaf::scene::Instance| {
                matches!(scene.materials[scene.meshes[i.mesh].material].bsdf, Bsdf::Dielectric { .. })
            };
            scene.instances.iter().filter(of).count()
        };
        assert!(glass(&scene) >= kinds, "{name}: {}", glass(&scene));
        assert!(scene.warnings.iter().all(|w| !w.contains("glass")), "{name}: {:?}", scene.warnings);
        let rest = scene.clone().without_glass();
        assert_eq!(rest.instances.len(), scene.instances.len() - glass(&scene), "{name}");
        assert_eq!(rest.warnings.iter().filter(|w| w.contains("glass")).count(), 1, "{name}: {:?}", rest.warnings);
    }
}

#[test]
fn environment_maps_load() {
    let Some(shared) = shared() else { return };
    let load = |name: &str| {
        let path = shared.join("scenes/env").join(name);
        lightsheaf::scene::EnvironmentMap::decode(&std::fs::read(&path).unwrap(), &path)
    };
    let (map, warning) = load("venice_sunset_1k.hdr").unwrap();
    assert_eq!(warning, None);
    assert_eq!((map.width, map.height, map.rows), (1024, 512, Rows::Centred));
    assert!(map.texels.iter().flatten().any(|&v| v > 100.0), "the sun is bright");
    // Lossy compression leaves negative values. Expected values: the OpenEXR library's.
    let (map, warning) = load("lobby_512_dwab.exr").unwrap();
    let warning = warning.unwrap_or_default();
    assert!(warning.contains("lobby_512_dwab.exr") && warning.contains("negative"), "{warning}");
    assert_eq!((map.width, map.height), (512, 256));
    for ([x, y], expected) in [
        ([0, 0], [0.630_859, 0.426_270, 0.214_844]),
        ([400, 128], [0.408_203, 0.332_275, 0.186_646]),
        ([511, 255], [0.770_508, 0.441_162, 0.109_375]),
        ([201, 77], [0.833_984, 0.599_609, 0.387_451]),
    ] {
        let texel = map.texels[y * 512 + x];
        assert!(
            (0..3).all(|c| (texel[c] - expected[c]).abs() < 2e-3 * expected[c]),
            "{x}, {y}: {texel:?}, not {expected:?}"
        );
    }
    assert!(map.texels.iter().flatten().all(|&v| (0.0..=927.5).contains(&v)));
}

#[test]
fn values_of_skies_that_are_no_radiance_are_mended() {
    let pixels = vec![[0.5, -2.0, f32::NAN], [f32::INFINITY, 60_000.0, f32::NEG_INFINITY]];
    let film = lightsheaf::film::Film { width: 2, height: 1, pixels };
    let picture =
        lightsheaf::film::exr::Picture { film, channels: vec![], attributes: vec![], window: None, record: None };
    let bytes = picture.encode().unwrap();
    let (map, warning) = lightsheaf::scene::EnvironmentMap::decode(&bytes, Path::new("sky.exr")).unwrap();
    assert_eq!(map.texels, [[0.5, 0.0, 0.0], [60_000.0, 60_000.0, 0.0]]);
    assert!(warning.unwrap().starts_with("`sky.exr`: 4 of 6 values"));
}

/// Mitsuba 0.6 gives a surface that bounds a medium and has no BSDF the BSDF `null`, and 3 grey paint.
#[test]
fn borders_of_media_alone_are_invisible_in_old_files() {
    let shapes = |version: &str, inside: &str| {
        let text = format!(r#"<shape type="cube"/><shape type="sphere">{inside}</shape>"#);
        scene_in(&folder(), version, &text).instances.len()
    };
    let medium = r#"<medium name="interior" type="homogeneous"/>"#;
    assert_eq!(shapes("0.6.0", medium), 1);
    assert_eq!(shapes("3.0.0", medium), 2);
    for more in [r#"<bsdf type="diffuse"/>"#, r#"<emitter type="area"/>"#] {
        assert_eq!(shapes("0.6.0", &format!("{medium}{more}")), 2, "{more}");
    }
    assert_eq!(shapes("0.6.0", ""), 2);
}

#[test]
fn both_dialects_say_the_same() {
    let new = scene(
        r#"<sensor type="perspective"><float name="fov" value="30"/><string name="fov_axis" value="y"/>
             <transform name="to_world"><lookat origin="1,2,3" target="0, 0, 0" up="0,1,0"/></transform>
             <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="32"/></film></sensor>
           <shape type="sphere"><transform name="to_world"><scale value="2"/></transform><boolean name="flip_normals" value="true"/>
             <bsdf type="roughplastic"><rgb name="diffuse_reflectance" value="0.1, 0.2, 0.3"/><float name="int_ior" value="1.5"/>
               <float name="ext_ior" value="1"/><string name="distribution" value="ggx"/></bsdf></shape>
           <emitter type="spot"><rgb name="intensity" value="1"/><float name="cutoff_angle" value="40"/></emitter>"#,
    );
    let old = scene_in(
        &folder(),
        "0.5.0",
        r#"<sensor type="perspective"><float name="fov" value="30"/><string name="fovAxis" value="y"/>
             <transform name="toWorld"><lookAt origin="1 2 3" target="0 0 0" up="0 1 0"/></transform>
             <film type="ldrfilm"><integer name="width" value="64"/><integer name="height" value="32"/></film></sensor>
           <shape type="sphere"><transform name="toWorld"><scale value="2"/></transform><boolean name="flipNormals" value="true"/>
             <bsdf type="roughplastic"><rgb name="diffuseReflectance" value="0.1 0.2 0.3"/><float name="intIOR" value="1.5"/>
               <float name="extIOR" value="1"/><string name="distribution" value="ggx"/></bsdf></shape>
           <emitter type="spot"><spectrum name="intensity" value="1"/><float name="cutoffAngle" value="40"/></emitter>"#,
    );
    assert_eq!(new.cameras, old.cameras);
    assert_eq!(new.meshes, old.meshes);
    assert_eq!(new.instances, old.instances);
    assert_eq!(new.materials, old.materials);
    assert_eq!(new.lights, old.lights);
    assert_eq!(new.warnings, old.warnings);
    assert_eq!(new.warnings, ["spheres are drawn as 8064 triangles with smooth normals"]);
}

/// Mitsuba 3.9.1, `scalar_rgb`, renders a `constant` emitter of these in the colours asked for.
#[test]
fn light_of_equal_energy_is_reddish_from_version_2_on() {
    let sky = |version: &str, radiance: &str| {
        let scene = scene_in(&folder(), version, &format!(r#"<emitter type="constant">{radiance}</emitter>"#));
        scene.environment.unwrap().radiance
    };
    let reddish = Vec3::new(2.4096, 1.8966, 1.8178);
    let number = r#"<spectrum name="radiance" value="2"/>"#;
    for (version, radiance, expected) in [
        ("3.0.0", number, reddish),
        ("3.0.0", r#"<spectrum name="radiance" value="360:2, 830:2"/>"#, reddish),
        (
            "3.0.0",
            r#"<spectrum type="uniform" name="radiance"><float name="value" value="2"/></spectrum>"#,
            Vec3::splat(2.0),
        ),
        ("3.0.0", r#"<rgb name="radiance" value="2"/>"#, Vec3::splat(2.0)),
        ("0.6.0", number, Vec3::splat(2.0)),
    ] {
        let seen = sky(version, radiance);
        assert!(close(seen, expected, 0.01), "{version} {radiance}: {seen}");
    }
}

#[test]
fn the_camera_looks_where_it_should_and_is_not_mirrored() {
    let scene = scene(
        r#"<sensor type="perspective"><transform name="to_world">
           <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>"#,
    );
    let camera = &scene.cameras[0];
    // Mitsuba's x points left; seen from +Z, the image's right is +X.
    assert!(close(camera.world_from_camera.matrix3.x_axis.into(), Vec3::X, 1e-6));
    assert!(close(camera.world_from_camera.matrix3.y_axis.into(), Vec3::Y, 1e-6));
    assert!(close(camera.world_from_camera.matrix3.z_axis.into(), Vec3::Z, 1e-6));
    assert!(close(camera.world_from_camera.translation.into(), Vec3::new(0.0, 0.0, 5.0), 1e-6));
    assert_eq!(camera.film_size, Some((768, 576)));
    // The lens has 50 mm before 36 x 24 mm, along the diagonal.
    let Projection::Perspective { fov, axis: FovAxis::Diagonal } = camera.projection else { panic!("{camera:?}") };
    assert!((fov.to_degrees() - 46.793).abs() < 1e-2, "{}", fov.to_degrees());
}

#[test]
fn every_fov_axis_is_read() {
    let axis = |name: &str| {
        let text = format!(
            r#"<sensor type="perspective"><string name="fov_axis" value="{name}"/><float name="fov" value="90"/></sensor>"#
        );
        let Projection::Perspective { fov, axis } = scene(&text).cameras[0].projection else { panic!("{name}") };
        assert!((fov - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        axis
    };
    assert_eq!(
        ["x", "y", "diagonal", "smaller", "larger"].map(axis),
        [FovAxis::X, FovAxis::Y, FovAxis::Diagonal, FovAxis::Smaller, FovAxis::Larger]
    );
    // 768 x 576 has the diagonal of a 3-4-5 triangle.
    let text = r#"<sensor type="perspective"><string name="fov_axis" value="diagonal"/><float name="fov" value="90"/></sensor>"#;
    assert!((scene(text).cameras[0].half_extent(768, 576) - Vec2::new(0.8, 0.6)).length() < 1e-6);
    let text = r#"<sensor type="orthographic"><transform name="to_world"><scale value="3"/></transform></sensor>"#;
    assert_eq!(scene(text).cameras[0].half_extent(768, 576), Vec2::new(3.0, 2.25));
}

#[test]
fn a_mirroring_camera_is_put_right_with_a_warning() {
    let scene = scene(r#"<sensor type="perspective"><transform name="to_world"><scale x="-1"/></transform></sensor>"#);
    assert!(scene.cameras[0].world_from_camera.matrix3.determinant() > 0.0);
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
}

#[test]
fn transforms_apply_from_first_to_last() {
    let place = |steps: &str| {
        let scene =
            scene(&format!(r#"<shape type="rectangle"><transform name="to_world">{steps}</transform></shape>"#));
        scene.instances[0].world_from_local.transform_point3(Vec3::X)
    };
    let turned = r#"<rotate z="1" angle="90"/><translate x="1" y="2"/>"#;
    assert!(close(place(turned), Vec3::new(1.0, 3.0, 0.0), 1e-6));
    let moved = r#"<translate value="1, 2, 0"/><rotate value="0, 0, 1" angle="90"/><scale value="2"/>"#;
    assert!(close(place(moved), Vec3::new(-4.0, 4.0, 0.0), 1e-6));
    assert!(close(place(r#"<matrix value="0 -1 0 5  1 0 0 6  0 0 1 7  0 0 0 1"/>"#), Vec3::new(5.0, 7.0, 7.0), 1e-6));
    assert!(close(place(r#"<matrix value="0 -1 0  1 0 0  0 0 1"/>"#), Vec3::Y, 1e-6));
    // Mitsuba's look-at has x to the left of the view.
    let look = r#"<lookat origin="0,0,0" target="0,0,-1" up="0,1,0"/>"#;
    assert!(close(place(look), Vec3::NEG_X, 1e-6));
}

#[test]
fn defaults_references_and_includes_resolve() {
    let folder = folder();
    std::fs::create_dir_all(folder.join("parts")).unwrap();
    std::fs::write(
        folder.join("parts/materials.xml"),
        r#"<scene version="3.0.0">
             <default name="grey" value="0.9"/>
             <bsdf type="diffuse" id="inner"><rgb name="reflectance" value="$grey"/></bsdf>
             <bsdf type="twosided" id="outer"><ref id="inner"/></bsdf>
             <alias id="outer" as="wall"/>
           </scene>"#,
    )
    .unwrap();
    let scene = scene_in(
        &folder,
        "3.0.0",
        r#"<default name="grey" value="0.25"/><default name="gre" value="wrong"/><default name="size" value="2"/>
           <include filename="parts/materials.xml"/>
           <shape type="rectangle"><ref id="wall"/><transform name="to_world"><scale value="$size"/></transform></shape>
           <shape type="rectangle"><ref name="bsdf" id="outer"/></shape>
           <shape type="rectangle"><bsdf type="mask"><float name="opacity" value="1"/><ref id="outer"/></bsdf></shape>"#,
    );
    // The first value of a parameter counts, so that the including file overrides the included one.
    assert_eq!(scene.materials.len(), 2, "the same bsdf is one material");
    assert!(scene.materials.iter().all(|m| m.bsdf == Bsdf::Diffuse { reflectance: Vec3::splat(0.25).into() }));
    assert!(scene.materials.iter().all(|m| m.sides == Sides::Two));
    assert_eq!(scene.materials[0].name, "outer");
    assert_eq!(scene.instances[0].world_from_local.matrix3.x_axis.x, 2.0);
    assert_eq!(scene.warnings, Vec::<String>::new());
}

#[test]
fn instances_share_their_group() {
    let scene = scene(
        r#"<shape type="shapegroup" id="pair"><shape type="cube"/>
             <shape type="rectangle"><transform name="to_world"><translate z="3"/></transform></shape></shape>
           <shape type="instance"><ref id="pair"/></shape>
           <shape type="instance"><ref id="pair"/><transform name="to_world"><translate x="5"/></transform></shape>"#,
    );
    assert_eq!((scene.meshes.len(), scene.instances.len()), (2, 4));
    assert!(close(scene.instances[3].world_from_local.translation.into(), Vec3::new(5.0, 0.0, 3.0), 0.0));
}

#[test]
fn bodies_have_their_area_and_face_outward() {
    use std::f32::consts::PI;
    for (kind, area, closed) in [
        ("rectangle", 4.0, false),
        ("cube", 24.0, true),
        ("sphere", 4.0 * PI, true),
        ("disk", PI, false),
        ("cylinder", 2.0 * PI, false),
    ] {
        let scene = scene(&format!(r#"<shape type="{kind}"/>"#));
        let geometry = Geometry::new(&scene);
        let mut total = 0.0;
        let mut volume = 0.0;
        for t in 0..geometry.triangles.len() {
            let p = geometry.positions(t);
            let flat = (p[1] - p[0]).cross(p[2] - p[0]);
            total += 0.5 * flat.length();
            volume += p[0].dot(flat) / 6.0;
            let normal = geometry.vertices[geometry.triangles[t][0] as usize].normal;
            assert!(flat.normalize().dot(normal) > 0.99, "{kind}: the front is where the normal is");
        }
        assert!((total / area - 1.0).abs() < 1e-4, "{kind}: area {total}, not {area}");
        assert!(!closed || volume > 0.0, "{kind} faces inward");
        if kind == "rectangle" || kind == "disk" {
            assert!(geometry.vertices.iter().all(|v| v.normal == Vec3::Z), "{kind}");
        }
        for mesh in &scene.meshes {
            assert!(mesh.uvs[0].iter().all(|uv| uv.min_element() >= 0.0 && uv.max_element() <= 1.0), "{kind}");
        }
    }
}

#[test]
fn a_sphere_sits_at_its_centre_and_can_face_inward() {
    let scene = scene(
        r#"<shape type="sphere"><point name="center" x="1" y="2" z="3"/><float name="radius" value="0.5"/>
           <boolean name="flip_normals" value="true"/></shape>"#,
    );
    let geometry = Geometry::new(&scene);
    for v in &geometry.vertices {
        let from_center = v.position - Vec3::new(1.0, 2.0, 3.0);
        assert!((from_center.length() - 0.5).abs() < 1e-3);
        assert!(v.normal.dot(from_center) < 0.0);
    }
}

const QUAD_OBJ: &str = "# a quad and a triangle\nv 0 0 0\nv 1 0 0 # corner\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 0.75\nvt 0 1\n\
                        usemtl a\nf 1/1 2/2 3/3 4/4\nusemtl b\nf -4/-4 -3/-3 -2/-2\n";

#[test]
fn obj_files_are_cut_flipped_and_shaded() {
    let folder = folder();
    std::fs::write(folder.join("quad.obj"), QUAD_OBJ).unwrap();
    let load = |extra: &str| {
        let text = format!(r#"<shape type="obj"><string name="filename" value="quad.obj"/>{extra}</shape>"#);
        scene_in(&folder, "3.0.0", &text).meshes
    };
    let mesh = &load("")[0];
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert_eq!(mesh.uvs[0][2], Vec2::new(1.0, 0.25), "v runs down here");
    assert_eq!(mesh.normals, [Vec3::Z; 4], "made, for the file has none");
    let mesh =
        &load(r#"<boolean name="flip_tex_coords" value="false"/><boolean name="face_normals" value="true"/>"#)[0];
    assert_eq!(mesh.uvs[0][2], Vec2::new(1.0, 0.75));
    assert!(mesh.normals.is_empty());
    let mesh = &load(r#"<boolean name="flip_normals" value="true"/>"#)[0];
    assert_eq!((mesh.triangles[0], mesh.normals[0]), ([0, 2, 1], Vec3::NEG_Z));
    // Mitsuba takes a mesh's front from its winding in the world, so that a mirroring inverts it.
    let mirror = r#"<transform name="to_world"><scale x="-1"/></transform>"#;
    let text = format!(r#"<shape type="obj"><string name="filename" value="quad.obj"/>{mirror}</shape>"#);
    let geometry = Geometry::new(&scene_in(&folder, "3.0.0", &text));
    assert_eq!(geometry.vertices[geometry.triangles[0][0] as usize].normal, Vec3::NEG_Z);
    let p = geometry.positions(0);
    assert!((p[1] - p[0]).cross(p[2] - p[0]).z < 0.0);
}

#[test]
fn obj_materials_pick_the_bsdf_of_their_name() {
    let folder = folder();
    std::fs::write(folder.join("quad.obj"), QUAD_OBJ).unwrap();
    let scene = scene_in(
        &folder,
        "0.6.0",
        r#"<shape type="obj"><string name="filename" value="quad.obj"/>
           <bsdf name="b" type="diffuse" id="second"/><bsdf name="a" type="diffuse" id="first"/></shape>"#,
    );
    let parts: Vec<_> = scene
        .meshes
        .iter()
        .map(|m| (scene.materials[m.material].name.as_str(), m.triangles.len(), m.positions.len()))
        .collect();
    assert_eq!(parts, [("first", 2, 4), ("second", 1, 3)]);
}

/// Returns a quad and a triangle as PLY, in ASCII or little-endian binary, with texture coordinates named s
/// and t.
fn ply(binary: bool) -> Vec<u8> {
    let format = if binary { "binary_little_endian" } else { "ascii" };
    let mut out = format!(
        "ply\nformat {format} 1.0\ncomment made here\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face 2\nproperty list uchar int vertex_index\nend_header\n"
    )
    .into_bytes();
    let vertices = [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    for [x, y, z] in vertices {
        if binary {
            for v in [x, y, z, x, y] {
                out.extend(v.to_le_bytes());
            }
            out.extend([255, 0, 51]);
        } else {
            out.extend(format!("{x} {y} {z} {x} {y} 255 0 51\n").bytes());
        }
    }
    for face in [&[0_i32, 1, 2, 3][..], &[0, 1, 2]] {
        if binary {
            out.push(face.len() as u8);
            face.iter().for_each(|i| out.extend(i.to_le_bytes()));
        } else {
            let words: Vec<String> = face.iter().map(ToString::to_string).collect();
            out.extend(format!("{} {}\n", face.len(), words.join(" ")).bytes());
        }
    }
    out
}

#[test]
fn ply_files_of_both_kinds_are_the_same_mesh() {
    let folder = folder();
    std::fs::write(folder.join("ascii.ply"), ply(false)).unwrap();
    std::fs::write(folder.join("binary.ply"), ply(true)).unwrap();
    let load = |name: &str| {
        let text = format!(r#"<shape type="ply" id="m"><string name="filename" value="{name}"/></shape>"#);
        scene_in(&folder, "3.0.0", &text).meshes.remove(0)
    };
    let (ascii, binary) = (load("ascii.ply"), load("binary.ply"));
    assert_eq!(ascii, binary);
    assert_eq!(ascii.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert_eq!(ascii.uvs[0][2], Vec2::new(1.0, 1.0), "coordinates stay as they are");
    assert!(ascii.colors.is_empty(), "Mitsuba uses them only where a texture asks for them");
    assert_eq!(ascii.normals, [Vec3::Z; 4]);
}

#[test]
fn bsdfs_become_the_model() {
    let diffuse = |v: f32| Bsdf::Diffuse { reflectance: Vec3::splat(v).into() };
    assert_eq!(bsdf(r#"<bsdf type="diffuse"/>"#), diffuse(0.5));
    assert_eq!(bsdf(""), diffuse(0.5));
    assert_eq!(bsdf(r#"<emitter type="area"/>"#), diffuse(0.0), "a light without bsdf is black");
    let Bsdf::Conductor { alpha, fresnel, specular } = bsdf(
        r#"<bsdf type="roughconductor"><float name="alpha" value="0.3"/><rgb name="eta" value="1, 2, 3"/>
           <rgb name="k" value="4, 5, 6"/><string name="distribution" value="ggx"/></bsdf>"#,
    ) else {
        panic!("not a conductor")
    };
    assert_eq!((alpha.factor, specular.factor), (0.3, Vec3::ONE));
    assert_eq!(fresnel, Fresnel::Conductor { eta: Vec3::new(1.0, 2.0, 3.0), k: Vec3::new(4.0, 5.0, 6.0) });
    let Bsdf::Conductor { alpha, fresnel: Fresnel::None, .. } = bsdf(r#"<bsdf type="conductor"/>"#) else {
        panic!("not a perfect mirror")
    };
    assert_eq!(alpha.factor, 0.0);
    let Bsdf::Plastic { alpha, diffuse: base, eta, nonlinear, .. } = bsdf(
        r#"<bsdf type="plastic"><string name="int_ior" value="water"/><float name="ext_ior" value="1"/>
           <boolean name="nonlinear" value="true"/></bsdf>"#,
    ) else {
        panic!("not plastic")
    };
    assert_eq!((alpha.factor, base.factor, eta, nonlinear), (0.0, Vec3::splat(0.5), 1.333, true));
    let Bsdf::Plastic { alpha, eta, .. } = bsdf(r#"<bsdf type="roughplastic"/>"#) else { panic!("not plastic") };
    assert_eq!(alpha.factor, 0.1);
    assert!((eta - 1.49 / 1.000_277).abs() < 1e-6);
}

/// The smaller width is the BSDF's, and the stretch leads to the greater one.
#[test]
fn stretched_lobes_become_the_model() {
    let material = |body: &str| scene(&format!("<shape type=\"sphere\">{body}</shape>")).materials.remove(0);
    for (u, v, rotation) in [(0.1, 0.4, std::f32::consts::FRAC_PI_2), (0.4, 0.1, 0.0)] {
        let metal = material(&format!(
            r#"<bsdf type="roughconductor"><float name="alpha_u" value="{u}"/><float name="alpha_v" value="{v}"/></bsdf>"#
        ));
        let (Bsdf::Conductor { alpha, .. }, Some(anisotropy)) = (metal.bsdf, metal.anisotropy) else {
            panic!("{metal:?}")
        };
        assert_eq!((alpha.factor, anisotropy.rotation), (0.1, rotation));
        assert!((Anisotropy::width(anisotropy.strength, 0.1) - 0.4).abs() < 1e-6);
    }
    let equal =
        r#"<bsdf type="roughconductor"><float name="alpha_u" value="0.2"/><float name="alpha_v" value="0.2"/></bsdf>"#;
    assert_eq!(material(equal).anisotropy, None);

    // The widths of `principled` are r^2 / a and r^2 a with a^2 = 1 - 0.9 anisotropic.
    let metal = material(
        r#"<bsdf type="principled"><float name="roughness" value="0.5"/><float name="anisotropic" value="0.8"/></bsdf>"#,
    );
    let (Bsdf::MetallicRoughness { roughness, .. }, Some(anisotropy)) = (metal.bsdf, metal.anisotropy) else {
        panic!("{metal:?}")
    };
    let aspect = 0.28_f32.sqrt();
    assert!((roughness.factor.powi(2) - 0.25 * aspect).abs() < 1e-6, "{roughness:?}");
    assert!((Anisotropy::width(anisotropy.strength, 0.25 * aspect) - 0.25 / aspect).abs() < 1e-6);
}

#[test]
fn principled_becomes_the_model_of_gltf() {
    let scene_with = |body: &str| scene(&format!("<shape type=\"sphere\">{body}</shape>"));
    let car = scene_with(
        r#"<bsdf type="principled"><rgb name="base_color" value="0.2, 0.4, 0.2"/><float name="spec_tint" value="1"/>
        <float name="spec_trans" value="0.3"/><float name="eta" value="1.4"/>
        <float name="sheen" value="0.5"/><float name="sheen_tint" value="0.25"/><float name="flatness" value="0.7"/>
        <float name="clearcoat" value="0.8"/><float name="clearcoat_gloss" value="1"/></bsdf>"#,
    );
    let paint = &car.materials[0];
    let Bsdf::MetallicRoughness { ior, specular_color, transmission, .. } = paint.bsdf else { panic!("{paint:?}") };
    assert_eq!((ior, transmission.factor), (1.4, 0.3));
    // The tint has the base's hue and a luminance of 1.
    let tint = specular_color.factor;
    assert!((tint.y / tint.x - 2.0).abs() < 1e-5 && (tint.dot(Vec3::new(0.2126, 0.7152, 0.0722)) - 1.0).abs() < 1e-3);
    let coat = paint.coat.unwrap();
    assert!((coat.weight.factor - 0.2).abs() < 1e-6 && (coat.roughness.factor.powi(2) - 0.001).abs() < 1e-6);
    assert!(matches!(paint.boundary, Boundary::Volume { .. }) && paint.diffuse_transmission.is_none());
    assert_eq!(paint.disney, Some(Disney { sheen: 0.5.into(), sheen_tint: 0.25, flatness: 0.7 }));
    assert!(!car.warnings.iter().any(|w| w.contains("sheen")), "{:?}", car.warnings);
    let plain = scene_with(r#"<bsdf type="principled"><float name="sheen_tint" value="1"/></bsdf>"#);
    assert_eq!(plain.materials[0].disney, Some(Disney { sheen: 0.0.into(), sheen_tint: 1.0, flatness: 0.0 }));
    for (kind, parameter) in [("principled", "metallic"), ("principledthin", "spec_trans")] {
        let bare = format!(
            r#"<bsdf type="{kind}"><float name="sheen" value="1"/><float name="{parameter}" value="1"/></bsdf>"#
        );
        assert_eq!(scene_with(&bare).materials[0].disney, None, "nothing is left of a base");
    }

    let leaf =
        scene_with(r#"<bsdf type="principledthin"><float name="diff_trans" value="1.2"/></bsdf>"#).materials.remove(0);
    assert_eq!((leaf.boundary, leaf.diffuse_transmission.unwrap().share.factor), (Boundary::Sheet, 0.6));
    let shade =
        scene_with(r#"<bsdf type="difftrans"><rgb name="transmittance" value="0.3"/></bsdf>"#).materials.remove(0);
    assert_eq!(shade.diffuse_transmission.map(|d| (d.share.factor, d.color.factor)), Some((1.0, Vec3::splat(0.3))));
}

#[test]
fn distributions_become_the_model() {
    let distribution = |body: &str| scene(&format!("<shape type=\"sphere\">{body}</shape>")).materials[0].distribution;
    for kind in ["roughconductor", "roughplastic", "roughdielectric"] {
        let with = |name: &str| format!(r#"<bsdf type="{kind}"><string name="distribution" value="{name}"/></bsdf>"#);
        assert_eq!(distribution(&format!("<bsdf type=\"{kind}\"/>")), Distribution::Beckmann, "{kind}");
        assert_eq!(distribution(&with("beckmann")), Distribution::Beckmann, "{kind}");
        assert_eq!(distribution(&with("ggx")), Distribution::Ggx, "{kind}");
    }
    assert_eq!(distribution(r#"<bsdf type="conductor"/>"#), Distribution::Ggx);
}

#[test]
fn blends_become_mixes() {
    let material = |body: &str| scene(&format!("<shape type=\"sphere\">{body}</shape>")).materials.remove(0);
    let blend = |weight: f32, parts: &str| {
        format!(r#"<bsdf type="blendbsdf"><float name="weight" value="{weight}"/>{parts}</bsdf>"#)
    };
    let [red, metal] =
        [r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.2, 0"/></bsdf>"#, r#"<bsdf type="conductor"/>"#];
    let mixed = material(&format!("<bsdf type=\"twosided\">{}</bsdf>", blend(0.3, &format!("{red}{metal}"))));
    let mix = mixed.mix.as_ref().unwrap();
    assert_eq!((mix.weight, mixed.sides), (0.3.into(), Sides::Two));
    assert!(matches!(mix.parts[0].bsdf, Bsdf::Diffuse { .. }) && matches!(mix.parts[1].bsdf, Bsdf::Conductor { .. }));
    assert!(mix.parts.iter().all(|part| part.sides == Sides::Two));

    // A blend of diffuse ones is one, and so is a blend with all of one part.
    let grey = r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.4"/></bsdf>"#;
    let plain = material(&blend(0.25, &format!("{red}{grey}")));
    let reflectance = Vec3::new(0.7, 0.25, 0.1);
    let Bsdf::Diffuse { reflectance: found } = plain.bsdf else { panic!("{plain:?}") };
    assert!(plain.mix.is_none() && found.factor.abs_diff_eq(reflectance, 1e-6), "{found:?}");
    let sole = material(&blend(1.0, &format!("{red}{metal}")));
    assert!(sole.mix.is_none() && matches!(sole.bsdf, Bsdf::Conductor { .. }));

    // Nothing of a `null` is there.
    let thin = material(&blend(0.6, &format!("<bsdf type=\"null\"/>{red}")));
    assert_eq!(thin.opacity, Some(Opacity::Blended { value: 0.6.into() }));
    let mask = format!(r#"<bsdf type="mask"><float name="opacity" value="0.5"/>{metal}</bsdf>"#);
    let half = material(&blend(0.5, &format!("{red}{mask}")));
    assert_eq!(half.opacity, Some(Opacity::Blended { value: 0.75.into() }));
    assert!((half.mix.unwrap().weight.factor - 1.0 / 3.0).abs() < 1e-6);

    // Weights of 0.5's mixtures that sum to less than 1 leave the rest black.
    let sum =
        material(&format!(r#"<bsdf type="mixturebsdf"><string name="weights" value="0.5, 0.25"/>{red}{metal}</bsdf>"#));
    let mix = sum.mix.unwrap();
    assert!((mix.weight.factor - 0.25).abs() < 1e-6, "{:?}", mix.weight);
    let Bsdf::Diffuse { reflectance } = mix.parts[0].bsdf else { panic!("{:?}", mix.parts[0]) };
    assert!(reflectance.factor.abs_diff_eq(Vec3::new(0.8, 0.2, 0.0) * (2.0 / 3.0), 1e-6), "{reflectance:?}");
}

#[test]
fn glass_becomes_the_model() {
    let material = |body: &str| scene(&format!("<shape type=\"sphere\">{body}</shape>")).materials.remove(0);
    let glass = material(r#"<bsdf type="dielectric"/>"#);
    let Bsdf::Dielectric { alpha, eta, reflection, transmission } = glass.bsdf else { panic!("not glass") };
    // This is BK7 in air.
    assert!((eta - 1.5046 / 1.000_277).abs() < 1e-6 && alpha.factor == 0.0);
    assert_eq!((reflection.factor, transmission.factor), (Vec3::ONE, Vec3::ONE));
    assert_eq!(glass.boundary, Boundary::Volume { absorption: Vec3::ZERO });
    assert_eq!(glass.opacity, None);

    let rough = r#"<bsdf type="roughdielectric"><float name="alpha" value="0.3"/><string name="int_ior" value="water"/>
        <float name="ext_ior" value="1"/><rgb name="specular_reflectance" value="0.9, 0.8, 0.7"/>
        <rgb name="specular_transmittance" value="0.1, 0.2, 0.3"/><string name="distribution" value="DISTRIBUTION"/></bsdf>"#;
    let scene = scene(&format!("<shape type=\"rectangle\">{}</shape>", rough.replace("DISTRIBUTION", "ggx")));
    let Bsdf::Dielectric { alpha, eta, reflection, transmission } = scene.materials[0].bsdf else {
        panic!("not glass")
    };
    assert_eq!((alpha.factor, eta), (0.3, 1.333));
    assert_eq!((reflection.factor, transmission.factor), (Vec3::new(0.9, 0.8, 0.7), Vec3::new(0.1, 0.2, 0.3)));
    assert_eq!(scene.warnings, Vec::<String>::new());

    let thin = material(r#"<bsdf type="thindielectric"><float name="int_ior" value="1.8"/></bsdf>"#);
    assert_eq!(thin.boundary, Boundary::Sheet);
    assert!(matches!(thin.bsdf, Bsdf::Dielectric { eta, .. } if (eta - 1.8 / 1.000_277).abs() < 1e-6));
    // Glass has holes only from a mask, unless it is of the index around it; `null` is all hole.
    let air = r#"<string name="int_ior" value="air"/><string name="ext_ior" value="air"/>"#;
    let opacity = |inside: &str| material(&format!(r#"<bsdf type="dielectric">{air}{inside}</bsdf>"#)).opacity;
    assert_eq!(opacity("").map(|o| o.value().factor), Some(0.0));
    assert_eq!(opacity(r#"<rgb name="specular_transmittance" value="0.5"/>"#), None);
    assert_eq!(material(r#"<bsdf type="null"/>"#).opacity.map(|o| o.value().factor), Some(0.0));
    let masked = material(r#"<bsdf type="mask"><float name="opacity" value="1"/><bsdf type="dielectric"/></bsdf>"#);
    assert_eq!(masked.opacity, Some(Opacity::Blended { value: 1.0.into() }));

    let warnings = |distribution: &str| {
        let rough = rough.replace("DISTRIBUTION", distribution);
        self::scene(&format!("<shape type=\"rectangle\">{rough}</shape>")).warnings
    };
    assert_eq!(warnings("beckmann"), Vec::<String>::new());
    assert!(warnings("as")[0].contains("Beckmann"));
}

#[test]
fn thin_lenses_are_read_in_both_dialects() {
    let lens = |version: &str, body: &str| {
        let text = format!(r#"<sensor type="thinlens">{body}</sensor>"#);
        let mut scene = scene_in(&folder(), version, &text);
        assert_eq!(scene.warnings, Vec::<String>::new());
        scene.cameras.remove(0).lens
    };
    let body = r#"<float name="aperture_radius" value="0.1"/><float name="focus_distance" value="3"/>"#;
    assert_eq!(lens("3.0.0", body), Some(Lens { radius: 0.1, focus: 3.0 }));
    let body = r#"<float name="apertureRadius" value="0.1"/><float name="focusDistance" value="3"/>"#;
    assert_eq!(lens("0.6.0", body), Some(Lens { radius: 0.1, focus: 3.0 }));
    // Mitsuba focuses on the far plane by default.
    let body = r#"<float name="aperture_radius" value="0.1"/>"#;
    assert_eq!(lens("3.0.0", body), Some(Lens { radius: 0.1, focus: 1e4 }));
    let far = r#"<float name="far_clip" value="50"/>"#;
    assert_eq!(lens("3.0.0", &format!("{body}{far}")), Some(Lens { radius: 0.1, focus: 50.0 }));
    assert_eq!(lens("3.0.0", r#"<float name="aperture_radius" value="0"/>"#), None);
    assert_eq!(scene(r#"<sensor type="perspective"/>"#).cameras[0].lens, None);
}

#[test]
fn sides_and_emission_belong_to_the_shape() {
    let scene = scene(
        r#"<bsdf type="diffuse" id="one"/><bsdf type="twosided" id="two"><ref id="one"/></bsdf>
           <shape type="rectangle"><ref id="one"/></shape><shape type="rectangle"><ref id="two"/></shape>
           <shape type="rectangle"><ref id="two"/><emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter></shape>"#,
    );
    let sides: Vec<_> = scene.materials.iter().map(|m| (m.sides, m.emission.is_some())).collect();
    assert_eq!(sides, [(Sides::One, false), (Sides::Two, false), (Sides::Two, true)]);
    let emission = scene.materials[2].emission.unwrap();
    assert_eq!((emission.radiance.factor, emission.two_sided), (Vec3::new(1.0, 2.0, 3.0), false));
}

/// Vertex colours count where a texture names them.
#[test]
fn vertex_colours_are_read_by_name() {
    let folder = folder();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        property float r\nproperty float g\nproperty float b\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n";
    std::fs::write(folder.join("red.ply"), format!("{header}0 0 0 1 0 0\n1 0 0 1 0 0\n0 1 0 1 0 0\n3 0 1 2\n"))
        .unwrap();
    let shape = |attribute: &str| {
        let texture = format!(
            r#"<texture name="reflectance" type="mesh_attribute"><string name="name" value="{attribute}"/></texture>"#
        );
        format!(
            r#"<shape type="ply"><string name="filename" value="red.ply"/><bsdf type="diffuse">{texture}</bsdf></shape>"#
        )
    };
    let scene = scene_in(&folder, "3.0.0", &format!("{}{}", shape("vertex_color"), shape("face_color")));
    assert_eq!(scene.meshes[0].colors[0].truncate(), Vec3::X);
    assert!(matches!(scene.materials[0].bsdf, Bsdf::Diffuse { reflectance } if reflectance == Vec3::ONE.into()));
    assert!(scene.meshes[1].colors.is_empty() && scene.warnings.iter().any(|w| w.contains("mesh_attribute")));
}

/// An axis of another length than 1 shears from version 2 on.
#[test]
fn axes_have_the_length_that_they_have() {
    let extent = |version: &str| {
        let body = r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" z="1" angle="15"/></transform></shape>"#;
        let body = if version == "0.6.0" { body.replace("to_world", "toWorld") } else { body.to_owned() };
        scene_in(&folder(), version, &body).instances[0].world_from_local.transform_vector3(Vec3::Y)
    };
    // Mitsuba 3.9.1's matrix.
    assert!(close(extent("3.0.0"), Vec3::new(-0.258_819, 1.0, 0.034_074_2), 1e-5));
    assert!((extent("0.6.0").length() - 1.0).abs() < 1e-5);
}

/// Sides are told by normals, if there are any, and otherwise by the winding.
#[test]
fn fronts_are_where_normals_point() {
    let folder = folder();
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 -1\n";
    std::fs::write(folder.join("normals.obj"), format!("{corners}f 1//1 2//1 3//1\n")).unwrap();
    std::fs::write(folder.join("bare.obj"), format!("{corners}f 1 2 3\n")).unwrap();
    let shape = |name: &str, more: &str| {
        format!(r#"<shape type="obj"><string name="filename" value="{name}.obj"/>{more}</shape>"#)
    };
    for (body, front) in [
        (shape("normals", ""), -1.0),
        (shape("normals", r#"<boolean name="face_normals" value="true"/>"#), 1.0),
        (shape("normals", r#"<boolean name="flip_normals" value="true"/>"#), 1.0),
        (shape("bare", ""), 1.0),
    ] {
        let mesh = &scene_in(&folder, "3.0.0", &body).meshes[0];
        let [a, b, c] = mesh.triangles[0].map(|i| mesh.positions[i as usize]);
        let actual = (b - a).cross(c - a).z;
        assert!((actual - front).abs() < 1e-6, "{actual}, {body}");
    }
}

/// What is not read here needs no value, and what version 0.6 lets pass is scaled.
#[test]
fn files_of_other_programs_load() {
    let scene = scene_in(
        &folder(),
        "0.6.0",
        r#"<integrator type="$integrator"><integer name="maxDepth" value="$depth"/></integrator>
           <sensor type="perspective"><sampler type="independent"><integer name="sampleCount" value="$spp"/></sampler></sensor>
           <shape type="rectangle"><transform name="toWorld"><rotate x="0" y="0" z="0" angle="0"/></transform>
           <bsdf type="diffuse"><rgb name="reflectance" value="255 102 0"/></bsdf></shape>"#,
    );
    let Bsdf::Diffuse { reflectance } = scene.materials[0].bsdf else { panic!("{:?}", scene.materials) };
    assert_eq!((reflectance.factor, scene.warnings.len()), (Vec3::new(1.0, 0.4, 0.0), 0), "{:?}", scene.warnings);
}

/// An area emitter may stand outside, if a shape refers to it.
#[test]
fn shapes_refer_to_emitters() {
    let scene = scene(
        r#"<shape type="rectangle"><ref id="glow"/></shape><shape type="rectangle"/>
           <emitter type="area" id="glow"><rgb name="radiance" value="1, 2, 3"/></emitter>"#,
    );
    let radiance = |i: usize| scene.materials[i].emission.map(|emission| emission.radiance.factor);
    assert_eq!([radiance(0), radiance(1)], [Some(Vec3::new(1.0, 2.0, 3.0)), None]);
    assert_eq!((scene.lights.len(), scene.warnings.len()), (0, 0), "{:?}", scene.warnings);
}

/// Polarizing filters pass half of light that is not polarized; retarders pass all of it.
#[test]
fn polarizers_pass_light() {
    let opacity = |kind: &str, inside: &str| {
        let scene = scene(&format!(r#"<shape type="rectangle"><bsdf type="{kind}">{inside}</bsdf></shape>"#));
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
        scene.materials[0].opacity.map(|opacity| opacity.value().factor)
    };
    let theta = r#"<float name="theta" value="45"/>"#;
    assert_eq!(opacity("polarizer", theta), Some(0.5));
    assert_eq!(opacity("circular", r#"<float name="transmittance" value="0.5"/>"#), Some(0.75));
    assert_eq!(opacity("retarder", theta), Some(0.0));
    assert!(matches!(bsdf(r#"<bsdf type="pplastic"><float name="alpha" value="0.2"/></bsdf>"#), Bsdf::Plastic { .. }));
}

/// Saves a 4 x 2 picture: a ramp of reds along the upper row, a half transparent green lower row.
fn picture(folder: &Path) {
    let texel = |x: u32, y: u32| {
        if y == 0 { image::Rgba([x as u8 * 80, 0, 0, 255]) } else { image::Rgba([0, 200, 0, 128]) }
    };
    image::RgbaImage::from_fn(4, 2, texel).save(folder.join("picture.png")).unwrap();
}

#[test]
fn bitmaps_keep_their_rows_sampler_and_transform() {
    let folder = folder();
    picture(&folder);
    let body = |extra: &str| {
        format!(
            r#"<shape type="rectangle"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">
               <string name="filename" value="picture.png"/>{extra}</texture></bsdf></shape>"#
        )
    };
    let texture = |version: &str, extra: &str| {
        let scene = scene_in(&folder, version, &body(extra));
        let Bsdf::Diffuse { reflectance } = scene.materials[0].bsdf else { panic!("not diffuse") };
        assert_eq!(reflectance.factor, Vec3::ONE);
        assert_eq!(scene.images[0].texels[3], [240, 0, 0, 255], "row 0 on top");
        let reference = reflectance.texture.unwrap();
        (scene.textures[reference.texture].clone(), reference.transform)
    };
    let (sampler, transform) = texture("3.0.0", "");
    assert_eq!((sampler.wrap, sampler.filter, sampler.srgb), ([Wrap::Repeat; 2], Filter::Linear, true));
    assert_eq!(transform, Affine2::IDENTITY);
    let (sampler, transform) = texture(
        "3.0.0",
        r#"<string name="filter_type" value="nearest"/><string name="wrap_mode" value="mirror"/>
           <boolean name="raw" value="true"/><transform name="to_uv"><scale x="2" y="3"/><translate x="0.5"/></transform>"#,
    );
    assert_eq!((sampler.wrap, sampler.filter, sampler.srgb), ([Wrap::Mirror; 2], Filter::Nearest, false));
    assert_eq!(transform.transform_point2(Vec2::ONE), Vec2::new(2.5, 3.0));
    let (sampler, transform) = texture(
        "0.6.0",
        r#"<string name="filterType" value="ewa"/><string name="wrapModeU" value="clamp"/><float name="gamma" value="1"/>
           <float name="uscale" value="2"/><float name="voffset" value="0.25"/>"#,
    );
    assert_eq!((sampler.wrap, sampler.srgb), ([Wrap::Clamp, Wrap::Repeat], false));
    assert_eq!(transform.transform_point2(Vec2::ONE), Vec2::new(2.0, 1.25));
}

#[test]
fn a_checkerboard_becomes_four_texels() {
    let scene = scene(
        r#"<shape type="rectangle"><bsdf type="diffuse"><texture name="reflectance" type="checkerboard">
           <rgb name="color0" value="0.8, 0.4, 0"/><rgb name="color1" value="0.1, 0.4, 0"/></texture></bsdf></shape>"#,
    );
    let Bsdf::Diffuse { reflectance } = scene.materials[0].bsdf else { panic!("not diffuse") };
    assert_eq!(reflectance.factor, Vec3::new(0.8, 0.4, 0.0));
    let sampler = &scene.textures[reflectance.texture.unwrap().texture];
    assert_eq!((sampler.filter, sampler.srgb), (Filter::Nearest, true));
    // 1/8 is 99 in sRGB.
    let [a, b] = [[255, 255, 0, 255], [99, 255, 0, 255]];
    assert_eq!(scene.images[sampler.image].texels, [a, b, b, a]);
}

/// From version 2 on, a checkerboard of numbers begins with its second one, as Mitsuba evaluates it.
#[test]
fn a_checkerboard_of_numbers_begins_with_the_second() {
    let body = r#"<shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/><texture name="opacity" type="checkerboard">
           <float name="color0" value="1"/><float name="color1" value="0"/></texture></bsdf></shape>"#;
    for (version, first) in [("3.0.0", 0), ("2.0.0", 0), ("0.6.0", 255)] {
        let scene = scene_in(&folder(), version, body);
        let Some(Opacity::Blended { value }) = scene.materials[0].opacity else { panic!("{:?}", scene.materials) };
        let (texture, channel) = value.texture.unwrap();
        let cell = (texture.transform.transform_point2(Vec2::splat(0.25)) * 2.0).as_uvec2() % 2;
        let image = &scene.images[scene.textures[texture.texture].image];
        assert_eq!(image.texels[(cell.y * 2 + cell.x) as usize][channel as usize], first, "{version}");
    }
}

/// Coatings are coats over what they cover; their reflectance at normal incidence follows from their index.
#[test]
fn coatings_are_coats() {
    let coated = |kind: &str, parameters: &str| {
        let base = "<bsdf type='diffuse'><rgb name='reflectance' value='0.5 0.4 0.3'/></bsdf>";
        let bsdf = format!("<bsdf type='{kind}'>{parameters}{base}</bsdf>");
        let scene = scene(&format!("<shape type='rectangle'>{bsdf}</shape>"));
        assert!(
            matches!(scene.materials[0].bsdf, Bsdf::Diffuse { .. }) && scene.warnings.len() == 1,
            "{:?}",
            scene.warnings
        );
        scene.materials[0].coat.unwrap()
    };
    let smooth = coated("coating", "<float name='int_ior' value='1.4'/><float name='ext_ior' value='1'/>");
    assert_eq!(smooth.roughness.factor, 0.0);
    assert!((smooth.weight.factor - (0.4_f32 / 2.4).powi(2) / 0.04).abs() < 1e-6, "{}", smooth.weight.factor);
    let parameters = "<float name='alpha' value='0.25'/><string name='distribution' value='ggx'/>";
    let rough = coated("roughcoating", parameters);
    assert_eq!((rough.roughness.factor, rough.weight.factor), (0.5, 1.0));
}

#[test]
fn masks_blend() {
    let folder = folder();
    picture(&folder);
    let scene = scene_in(
        &folder,
        "3.0.0",
        r#"<shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/>
             <texture name="opacity" type="bitmap"><string name="filename" value="picture.png"/></texture></bsdf></shape>
           <shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/><float name="opacity" value="0"/></bsdf></shape>
           <shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/><float name="opacity" value="0.3"/></bsdf></shape>
           <shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/></bsdf></shape>"#,
    );
    let opacities: Vec<_> = scene.materials.iter().map(|material| material.opacity.unwrap()).collect();
    let Opacity::Blended { value } = opacities[0] else { panic!("{opacities:?}") };
    assert_eq!(value.texture.unwrap().1, 3, "the alpha channel, which this image uses");
    assert_eq!(opacities[1], Opacity::Blended { value: 0.0.into() });
    assert_eq!(opacities[2], Opacity::Blended { value: 0.3.into() });
    assert_eq!(opacities[3], Opacity::Blended { value: 0.5.into() }, "Mitsuba's default");
    // The warning is for the channel.
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    // An alpha channel without holes says nothing.
    image::GrayAlphaImage::from_pixel(2, 2, image::LumaA([30, 249])).save(folder.join("grey.png")).unwrap();
    let scene = scene_in(
        &folder,
        "3.0.0",
        r#"<shape type="rectangle"><bsdf type="mask"><bsdf type="diffuse"/>
             <texture name="opacity" type="bitmap"><string name="filename" value="grey.png"/></texture></bsdf></shape>"#,
    );
    let Some(Opacity::Blended { value }) = scene.materials[0].opacity else { panic!("{:?}", scene.materials) };
    assert_eq!((value.texture.unwrap().1, scene.warnings.len()), (0, 0), "{:?}", scene.warnings);
}

/// A ray is stopped by a mask in a mask with the product of both opacities, also through `twosided`.
#[test]
fn masks_in_masks_multiply() {
    let folder = folder();
    picture(&folder);
    let picture = r#"<texture name="opacity" type="bitmap"><string name="filename" value="picture.png"/></texture>"#;
    let number = |value: &str| format!(r#"<float name="opacity" value="{value}"/>"#);
    let nested = |outer: &str, inner: &str| {
        let inner = format!(r#"<bsdf type="mask">{inner}<bsdf type="diffuse"/></bsdf>"#);
        let both = format!(r#"<bsdf type="mask">{outer}<bsdf type="twosided">{inner}</bsdf></bsdf>"#);
        let scene = scene_in(&folder, "3.0.0", &format!(r#"<shape type="rectangle">{both}</shape>"#));
        assert_eq!(scene.materials[0].sides, Sides::Two);
        let lost = scene.warnings.iter().filter(|w| w.contains("innermost")).count();
        let Some(Opacity::Blended { value }) = scene.materials[0].opacity else { panic!("not blended") };
        (value.factor, value.texture.is_some(), lost)
    };
    assert_eq!(nested(&number("0.5"), &number("0.5")), (0.25, false, 0));
    assert_eq!(nested(&number("0.5"), &number("4")), (0.5, false, 0), "opacities are at most 1");
    assert_eq!(nested(&number("0.5"), picture), (0.5, true, 0));
    assert_eq!(nested(picture, &number("0.5")), (0.5, true, 0));
    assert_eq!(nested(picture, picture), (1.0, true, 1));
}

/// Returns the world normal of a mesh's normal map at a texel, at the mesh's first vertex.
fn mapped_normal(scene: &Scene, texel: usize) -> Vec3 {
    let geometry = Geometry::new(scene);
    let map = scene.materials[0].normal_map.unwrap();
    let [r, g, b, _] = scene.images[scene.textures[map.texture.texture].image].texels[texel];
    let decoded = Vec3::new(f32::from(r), f32::from(g), f32::from(b)) / 127.5 - 1.0;
    let vertex = geometry.vertices[geometry.triangles[0][0] as usize];
    let tangent = vertex.tangent.truncate();
    let bitangent = vertex.normal.cross(tangent) * vertex.tangent.w;
    (decoded.x * map.scale * tangent + decoded.y * map.scale * bitangent + decoded.z * vertex.normal).normalize()
}

#[test]
fn a_normal_map_lies_as_in_mitsuba() {
    let folder = folder();
    // The normal leans towards Mitsuba's t = n x s, which on a rectangle is +Y, along which v grows, which is
    // down the image.
    image::RgbImage::from_pixel(2, 2, image::Rgb([128, 218, 218])).save(folder.join("n.png")).unwrap();
    let scene = scene_in(
        &folder,
        "3.0.0",
        r#"<shape type="rectangle"><bsdf type="normalmap"><bsdf type="diffuse"/>
           <texture name="normalmap" type="bitmap"><string name="filename" value="n.png"/><boolean name="raw" value="true"/></texture>
           </bsdf></shape>"#,
    );
    assert!(close(mapped_normal(&scene, 0), (Vec3::Y + Vec3::Z).normalize(), 0.01), "{}", mapped_normal(&scene, 0));
    assert_eq!(scene.warnings, Vec::<String>::new());
}

#[test]
fn a_bump_map_tilts_against_its_slope() {
    let folder = folder();
    // Heights grow with u; along the middle columns the slope is 64 / 255 over 2 of 8 texels.
    let ramp = |x: u32, _| image::Luma([x as u8 * 32]);
    image::GrayImage::from_fn(8, 8, ramp).save(folder.join("u.png")).unwrap();
    image::GrayImage::from_fn(8, 8, |x, y| ramp(y, x)).save(folder.join("v.png")).unwrap();
    let normal = |name: &str, size: f32| {
        let text = format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="{size}"/></transform>
               <bsdf type="bumpmap"><float name="scale" value="0.5"/><bsdf type="diffuse"/><texture type="bitmap">
               <string name="filename" value="{name}"/><boolean name="raw" value="true"/>
               <string name="wrap_mode" value="clamp"/></texture></bsdf></shape>"#
        );
        mapped_normal(&scene_in(&folder, "3.0.0", &text), 3 * 8 + 3)
    };
    // A unit of uv spans two metres times the size.
    let slope = |size: f32| 0.5 * (64.0 / 255.0) / (2.0 / 8.0) / (2.0 * size);
    for size in [1.0, 0.25] {
        let s = slope(size);
        let along_u = normal("u.png", size);
        assert!(close(along_u, Vec3::new(-s, 0.0, 1.0).normalize(), 0.02), "{along_u} at {size}, slope {s}");
        // v grows along +Y on a rectangle.
        let along_v = normal("v.png", size);
        assert!(close(along_v, Vec3::new(0.0, -s, 1.0).normalize(), 0.02), "{along_v} at {size}, slope {s}");
    }
}

#[test]
fn emitters_become_lights() {
    let scene = scene(
        r#"<emitter type="point"><point name="position" x="1" y="2" z="3"/><rgb name="intensity" value="4, 5, 6"/></emitter>
           <emitter type="point"><transform name="to_world"><translate z="7"/></transform></emitter>
           <emitter type="spot"><transform name="to_world"><lookat origin="0,1,0" target="0,0,0" up="1,0,0"/></transform>
             <float name="cutoff_angle" value="40"/></emitter>
           <emitter type="directional"><vector name="direction" x="0" y="-2" z="0"/><rgb name="irradiance" value="3"/></emitter>
           <emitter type="directional"><transform name="to_world"><rotate y="1" angle="90"/></transform></emitter>
           <emitter type="constant"><rgb name="radiance" value="0.5"/></emitter>"#,
    );
    assert_eq!(
        scene.lights[0],
        Light::Point { position: Vec3::new(1.0, 2.0, 3.0), intensity: Vec3::new(4.0, 5.0, 6.0) }
    );
    assert_eq!(scene.lights[1], Light::Point { position: Vec3::new(0.0, 0.0, 7.0), intensity: Vec3::ONE });
    let Light::Spot { position, direction, inner_angle, outer_angle, falloff, .. } = scene.lights[2] else {
        panic!("not a spot")
    };
    assert_eq!((position, direction, falloff), (Vec3::Y, Vec3::NEG_Y, SpotFalloff::AngleLinear));
    assert!((outer_angle.to_degrees() - 40.0).abs() < 1e-4 && (inner_angle.to_degrees() - 30.0).abs() < 1e-4);
    assert_eq!(scene.lights[3], Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(3.0) });
    let Light::Directional { direction, .. } = scene.lights[4] else { panic!("not directional") };
    assert!(close(direction, Vec3::X, 1e-6));
    let sky = Environment { radiance: Vec3::splat(0.5), map: None, world_from_environment: Mat3::IDENTITY };
    assert_eq!(scene.environment, Some(sky));
    assert_eq!(scene.warnings, Vec::<String>::new());
}

/// Returns the radiance of a plane at distance 1 that a light illuminates, seen along the light's axis.
fn projected(folder: &Path, emitter: &str) -> impl Fn(f32, f32) -> Vec3 {
    let text = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="4"/><rotate y="1" angle="180"/><translate z="1"/></transform>
           <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>{emitter}"#
    );
    let scene = scene_in(folder, "3.0.0", &text);
    assert_eq!(scene.warnings, Vec::<String>::new());
    move |x, y| {
        // Cameras look along -Z with +X to the right; this one stands at the light and looks along +Z.
        let rotation = Mat3::from_cols(Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z);
        let place = glam::Affine3A::from_mat3_translation(rotation, Vec3::new(x, y, 0.5));
        let projection = Projection::Orthographic { half_extent: Vec2::splat(1e-3) };
        let camera =
            scene::Camera { name: String::new(), world_from_camera: place, projection, lens: None, film_size: None };
        let scene = Scene { cameras: vec![camera], ..scene.clone() };
        let settings = ReferenceSettings {
            width: 1,
            height: 1,
            samples: 16,
            bounces: Some(0),
            specular_bounces: 8,
            seed: 1,
            camera: 0,
        };
        Vec3::from(Reference::new(&scene).render(&settings, &|_, _| ()).film.pixels[0])
    }
}

/// In Mitsuba a projector's image lies as its camera sees it, with u along -X and v along -Y; a spot's
/// texture has u along +X and v along +Y. The radiance of a white plane is the texel for a projector, and the
/// texel over pi times cos^3 of the angle from the axis for a spot.
#[test]
fn lights_project_images() {
    let folder = folder();
    // The quarters are upper left red, upper right green, lower left blue, lower right dark.
    let texel = |x: u32, y: u32| match (x < 8, y < 8) {
        (true, true) => image::Rgb([255, 0, 0]),
        (false, true) => image::Rgb([0, 255, 0]),
        (true, false) => image::Rgb([0, 0, 255]),
        (false, false) => image::Rgb([0, 0, 0]),
    };
    image::RgbImage::from_fn(16, 16, texel).save(folder.join("quarters.png")).unwrap();
    let texture = |name: &str| {
        format!(
            r#"<texture name="{name}" type="bitmap"><string name="filename" value="quarters.png"/><boolean name="raw" value="true"/></texture>"#
        )
    };
    let projector = format!(
        r#"<emitter type="projector"><float name="fov" value="90"/><float name="scale" value="2"/>{}</emitter>"#,
        texture("irradiance")
    );
    let at = projected(&folder, &projector);
    for (x, y, expected) in [
        (0.4, 0.6, Vec3::X * 2.0),
        (-0.3, 0.7, Vec3::Y * 2.0),
        (0.8, -0.2, Vec3::Z * 2.0),
        (-0.5, -0.5, Vec3::ZERO),
        (1.1, 0.5, Vec3::ZERO),
    ] {
        assert!(close(at(x, y), expected, 1e-3), "projector at {x} {y}: {} is not {expected}", at(x, y));
    }
    let spot = format!(
        r#"<emitter type="spot"><float name="cutoff_angle" value="45"/><float name="beam_width" value="44.9"/>{}</emitter>"#,
        texture("texture")
    );
    let mirrored = spot.replace("</emitter>", r#"<transform name="to_world"><scale x="-1"/></transform></emitter>"#);
    for (emitter, sign) in [(spot, 1.0), (mirrored, -1.0)] {
        let at = projected(&folder, &emitter);
        for (x, y, color) in [(-0.4, -0.5, Vec3::X), (0.3, -0.4, Vec3::Y), (-0.5, 0.2, Vec3::Z), (0.8, 0.8, Vec3::ZERO)]
        {
            let squared: f32 = 1.0 + x * x + y * y;
            let expected = color / (std::f32::consts::PI * squared * squared.sqrt());
            let actual = at(sign * x, y);
            assert!(close(actual, expected, 1e-3), "spot at {x} {y}: {actual} is not {expected}");
        }
    }
    let constant = r#"<emitter type="projector"><float name="fov" value="60"/></emitter>"#;
    let at = projected(&folder, constant);
    assert!(close(at(0.4, -0.4), Vec3::ONE, 1e-3) && at(0.6, 0.0) == Vec3::ZERO);
}

#[test]
fn skies_have_a_sun() {
    let sun = |scene: &Scene| match scene.lights[..] {
        [Light::Sun { direction, irradiance, angle, of_sky: true }] => (direction, irradiance, angle),
        _ => panic!("{:?}", scene.lights),
    };
    let given = |version: &str, kind: &str, more: &str| {
        let text = format!(
            r#"<emitter type="{kind}"><vector name="sun_direction" x="1" y="2" z="2"/>
               <float name="turbidity" value="4"/>{more}</emitter>"#
        );
        scene_in(&folder(), version, &text)
    };
    let scene = given("3.0.0", "sunsky", r#"<float name="sun_scale" value="2"/>"#);
    assert_eq!(scene.warnings, Vec::<String>::new());
    let (direction, irradiance, angle) = sun(&scene);
    assert!(close(direction, -Vec3::new(1.0, 2.0, 2.0) / 3.0, 1e-6) && (angle.to_degrees() - 0.2666).abs() < 1e-4);
    let once = sun(&given("3.0.0", "sunsky", "")).1;
    assert!(close(irradiance, 2.0 * once, 1e-6) && once.x > once.z && once.min_element() > 0.2, "{once}");
    // +Z is up: the sky is brighter towards the sun than away from it, and black below.
    let sky = scene.environment.as_ref().unwrap();
    let value = |towards: Vec3| Sky::new(sky).radiance(towards.normalize());
    let [front, back] = [Vec3::new(1.0, 2.0, 1.9), Vec3::new(-1.0, -2.0, 2.0)].map(value);
    assert!(front.x > 2.0 * back.x && back.z > back.x && value(Vec3::new(1.0, 2.0, -0.1)) == Vec3::ZERO);
    // In version 0.5, +Y is up.
    let old = given("0.5.0", "sunsky", "");
    let sky = old.environment.as_ref().unwrap();
    let value = |towards: Vec3| Sky::new(sky).radiance(towards.normalize());
    assert!(value(Vec3::new(-1.0, 0.1, -2.0)).z > 0.0 && value(Vec3::new(1.0, -0.1, 2.0)) == Vec3::ZERO);

    assert!(given("3.0.0", "sky", "").lights.is_empty());
    assert!(given("0.5.0", "sun", "").environment.is_none());
    let night = scene_in(&folder(), "3.0.0", r#"<emitter type="sunsky"><float name="hour" value="1"/></emitter>"#);
    assert!(night.warnings[0].contains("below the horizon") && sun(&night).1 == Vec3::ZERO, "{:?}", night.warnings);
    // On 10 July 2010 at 15:00 in Tokyo the sun is 46 degrees high at azimuth 264 degrees; +X is south and +Y
    // west.
    let (direction, ..) = sun(&scene_in(&folder(), "3.0.0", r#"<emitter type="sunsky"/>"#));
    let [elevation, azimuth] = [46.0_f32, 264.0].map(f32::to_radians);
    let expected = Vec3::new(-azimuth.cos() * elevation.cos(), -azimuth.sin() * elevation.cos(), elevation.sin());
    assert!(close(-direction, expected, 0.03), "{direction} is not {}", -expected);
}

#[test]
fn an_envmap_turns_with_its_transform() {
    let folder = folder();
    let texels = |x: u32, y: u32| image::Rgb([x as f32, y as f32, 100.0]);
    image::Rgb32FImage::from_fn(8, 4, texels).save(folder.join("sky.hdr")).unwrap();
    let scene = scene_in(
        &folder,
        "3.0.0",
        r#"<emitter type="envmap"><string name="filename" value="sky.hdr"/><float name="scale" value="2"/>
           <transform name="to_world"><rotate y="1" angle="90"/><scale value="3"/></transform></emitter>"#,
    );
    let environment = scene.environment.unwrap();
    assert_eq!(environment.radiance, Vec3::splat(2.0));
    assert!(close(environment.world_from_environment * Vec3::Z, Vec3::X, 1e-6));
    let map = environment.map.unwrap();
    assert_eq!((map.width, map.height, map.rows), (8, 4, Rows::AtPoles));
    assert!(close(map.texels[8 + 5].into(), Vec3::new(5.0, 1.0, 100.0), 0.5));
}

#[test]
fn what_is_not_supported_is_said_once_and_replaced() {
    let scene = scene(
        r#"<integrator type="path"><boolean name="hide_emitters" value="true"/></integrator>
           <sensor type="perspective_rdist"/>
           <sensor type="irradiancemeter"/>
           <medium type="homogeneous"/>
           <emitter type="timed_sunsky"/>
           <emitter type="directionalarea"/>
           <bsdf type="null" id="hole"/>
           <shape type="rectangle"><ref id="hole"/></shape>
           <shape type="cube"><ref id="hole"/></shape>
           <shape type="rectangle"><bsdf type="roughconductor"><string name="material" value="Unobtainium"/>
             <string name="distribution" value="ggx"/></bsdf></shape>
           <shape type="rectangle"><bsdf type="hair"/></shape>
           <shape type="rectangle"><bsdf type="diffuse"><float name="sparkle" value="1"/></bsdf></shape>
           <shape type="rectangle"><bsdf type="diffuse"><texture name="reflectance" type="volume"/></bsdf></shape>
           <shape type="sdfgrid"/>"#,
    );
    for (i, text) in [
        "hide_emitters",
        "without distortion",
        "irradiancemeter",
        "homogeneous",
        "the sun does not move",
        "directionalarea",
        "Unobtainium",
        "hair",
        "sparkle",
        "volume",
        "sdfgrid",
    ]
    .iter()
    .enumerate()
    {
        let count = scene.warnings.iter().filter(|w| w.contains(text)).count();
        assert_eq!(count, 1, "{i}: `{text}` is said {count} times in {:#?}", scene.warnings);
    }
    assert_eq!(scene.warnings.len(), 11, "{:#?}", scene.warnings);
    assert_eq!(scene.materials[0].opacity.map(|o| o.value().factor), Some(0.0), "light passes");
    assert_eq!((scene.cameras.len(), scene.environment.is_some()), (1, true));
}

/// Lobes without Fresnel's equations reflect as much at normal incidence, and the base has what a facet lets in.
#[test]
fn phong_and_ward_keep_their_reflectances() {
    let colors = "<rgb name=\"diffuseReflectance\" value=\"0.3 0.6 0.1\"/><rgb name=\"specularReflectance\" value=\"0.25 0.2 0.1\"/>";
    for (kind, width) in [
        ("phong", "<float name=\"exponent\" value=\"30\"/>"),
        ("ward", "<float name=\"alphaU\" value=\"0.25\"/><float name=\"alphaV\" value=\"0.25\"/>"),
    ] {
        let body = format!("<shape type=\"rectangle\"><bsdf type=\"{kind}\">{colors}{width}</bsdf></shape>");
        let material = scene_in(&folder(), "0.6.0", &body).materials.remove(0);
        let Bsdf::MetallicRoughness { base_color, metallic, roughness, ior, specular_color, .. } = material.bsdf else {
            panic!("{kind}: {material:?}")
        };
        assert!(close(specular_color.factor, Vec3::new(0.25, 0.2, 0.1), 1e-6), "{kind}: {specular_color:?}");
        assert!(close(base_color.factor, Vec3::new(0.4, 0.8, 0.1 / 0.75), 1e-6), "{kind}: {base_color:?}");
        assert_eq!((metallic, ior, material.distribution), (0.0.into(), 0.0, Distribution::Beckmann), "{kind}");
        assert!((roughness.factor - 0.5).abs() < 1e-6, "{kind}: {roughness:?}");
    }
}

/// Names as other systems write them lead to the files: `\\` for `/`, other letters' case, folders of another machine.
/// What is not there is a warning, and the rest of the scene is drawn.
#[test]
fn files_of_other_systems_are_found_and_missing_ones_are_warnings() {
    let folder = folder();
    std::fs::create_dir(folder.join("Models")).unwrap();
    std::fs::write(folder.join("Models/Face.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    image::RgbImage::from_pixel(1, 1, image::Rgb([9, 9, 9])).save(folder.join("Wood.png")).unwrap();
    let file = |tag: &str, name: &str, path: &str, inside: &str| {
        format!(
            "<{tag} name=\"reflectance\" type=\"{name}\"><string name=\"filename\" value=\"{path}\"/>{inside}</{tag}>"
        )
    };
    let diffuse = |path: &str| format!("<bsdf type=\"diffuse\">{}</bsdf>", file("texture", "bitmap", path, ""));
    let body = [
        file("shape", "obj", "models\\face.OBJ", &diffuse("C:\\work\\maps\\wood.PNG")),
        file("shape", "obj", "Models/Face.obj", &diffuse("none.png")),
        file("shape", "ply", "none.ply", ""),
        file("shape", "ply", &"a/".repeat(100_000), ""),
        file("emitter", "envmap", "none.hdr", "<float name=\"scale\" value=\"3\"/>"),
    ];
    let scene = scene_in(&folder, "3.0.0", &body.concat());
    assert_eq!((scene.meshes.len(), scene.images.len()), (2, 1));
    let colors = scene.materials.iter().map(|material| match material.bsdf {
        Bsdf::Diffuse { reflectance } => (reflectance.factor.x, reflectance.texture.is_some()),
        ref other => panic!("{other:?}"),
    });
    assert_eq!(colors.collect::<Vec<_>>(), [(1.0, true), (0.5, false)]);
    let sky = scene.environment.as_ref().unwrap();
    assert_eq!((sky.radiance, sky.map.is_none()), (Vec3::splat(3.0), true));
    let warnings = [
        "the texture `none.png` is not there: grey 0.5 is drawn instead",
        "the mesh file `none.ply` is not there: its shapes are left out",
        "the sky's picture `none.hdr` is not there: an even sky is drawn instead",
    ];
    for warning in warnings {
        assert!(scene.warnings.iter().any(|w| w == warning), "{warning}: {:?}", scene.warnings);
    }
}

/// A part that is not there, such as another program's integrator, and a material that nothing defines leave the rest.
#[test]
fn missing_includes_and_ids_are_warnings() {
    let scene = scene(
        r#"<default name="integrator" value="mlt"/><include filename="integrators/$integrator.xml"/>
           <shape type="shapeGroup" id="group"><shape type="cube"><ref id="gone"/></shape></shape>
           <bsdf type="diffuse" id="here"/><alias id="here" as="there"/>
           <shape type="instance"><ref id="group"/></shape>
           <shape type="cube"><ref id="there"/></shape>"#,
    );
    assert_eq!((scene.instances.len(), scene.materials.len()), (2, 2));
    for [place, cause] in [["line 1", "`integrators/mlt.xml` does not exist"], ["line 2", "nothing has the id `gone`"]]
    {
        let said =
            |warning: &&String| warning.contains(place) && warning.contains(cause) && warning.contains("left out");
        assert_eq!(scene.warnings.iter().filter(said).count(), 1, "{place}, {cause}: {:?}", scene.warnings);
    }
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
}
