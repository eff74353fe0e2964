//! Malformed files give an error with file, place and cause, and never a panic, a hang or exhausted memory.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use lightsheaf::scene::load::files::Disk;
use lightsheaf::scene::load::mitsuba;
use lightsheaf::scene::{Geometry, LoadError, Scene};

/// Time limit for one file.
const TIME_LIMIT: Duration = Duration::from_secs(5);

fn folder() -> PathBuf {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let name = format!("malformed-{}", COUNT.fetch_add(1, Ordering::Relaxed));
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    drop(std::fs::remove_dir_all(&path));
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Loads a scene whose body starts in line 2, with other files beside it.
fn load(body: &str, files: &[(&str, &[u8])]) -> Result<Scene, LoadError> {
    let folder = folder();
    for (name, bytes) in files {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
    let path = folder.join("scene.xml");
    std::fs::write(&path, format!("<scene version=\"3.0.0\">\n{body}\n</scene>")).unwrap();
    let start = Instant::now();
    let result = mitsuba::load(&path, &Disk);
    assert!(start.elapsed() < TIME_LIMIT, "{body:.200} took {:?}", start.elapsed());
    result
}

/// Returns the error of such a scene.
fn error(body: &str, files: &[(&str, &[u8])]) -> LoadError {
    match load(body, files) {
        Ok(_) => panic!("no error: {body:.300}"),
        Err(error) => error,
    }
}

/// Checks that an error names the file, the place and part of the cause.
fn check(error: &LoadError, file: &str, place: &str, cause: &str) {
    assert!(error.path.ends_with(file), "{error}: not in {file}");
    assert_eq!(error.place.as_deref().unwrap_or_default(), place, "{error}");
    assert!(error.cause.contains(cause), "{error}: nothing about `{cause}`");
}

#[test]
fn wrong_xml_is_an_error_with_its_line() {
    let cases = [
        ("<shape type=\"cube\">", "line 3", "XML"),
        ("<!DOCTYPE a [<!ENTITY b \"c\">]>", "line 2", "XML"),
        ("\n<ref id=\"nothing\"/>", "line 3", "nothing has the id `nothing`"),
        ("<shape type=\"cube\"><ref/></shape>", "line 2", "`id`"),
        ("<bsdf type=\"diffuse\" id=\"a\"/>\n<bsdf type=\"diffuse\" id=\"a\"/>", "line 3", "already taken"),
        (
            "<shape type=\"cube\"><boolean name=\"flip_normals\" value=\"maybe\"/></shape>",
            "line 2",
            "neither true nor false",
        ),
        ("<shape type=\"cube\"><float name=\"flip_normals\" value=\"1\"/></shape>", "line 2", "has to be a <boolean>"),
        (
            "<sensor type=\"perspective\"><float name=\"fov\" value=\"wide\"/></sensor>",
            "line 2",
            "`wide` is not a number",
        ),
        ("<sensor type=\"perspective\"><float name=\"fov\" value=\"nan\"/></sensor>", "line 2", "not a finite number"),
        ("<sensor type=\"perspective\"><float name=\"fov\" value=\"1e99\"/></sensor>", "line 2", "not a finite number"),
        ("<sensor type=\"perspective\"><float name=\"fov\" value=\"180\"/></sensor>", "line 2", "between 0 and 180"),
        ("<sensor type=\"perspective\"><string name=\"fov_axis\" value=\"z\"/></sensor>", "line 2", "fov_axis"),
        ("<sensor type=\"perspective\"><string name=\"focal_length\" value=\"-5mm\"/></sensor>", "line 2", "50mm"),
        (
            "<sensor type=\"perspective\">\n<film type=\"hdrfilm\"><integer name=\"width\" value=\"100000\"/></film></sensor>",
            "line 3",
            "1 to 16384",
        ),
        (
            "<sensor type=\"perspective\"><transform name=\"to_world\">\n<lookat origin=\"1,1,1\" target=\"1,1,1\"/></transform></sensor>",
            "line 3",
            "same point",
        ),
        (
            "<sensor type=\"perspective\"><transform name=\"to_world\"><scale value=\"0\"/></transform></sensor>",
            "line 2",
            "singular",
        ),
        (
            "<shape type=\"cube\"><transform name=\"to_world\"><rotate angle=\"3\"/></transform></shape>",
            "line 2",
            "axis is zero",
        ),
        (
            "<shape type=\"cube\"><transform name=\"to_world\"><matrix value=\"1 2 3\"/></transform></shape>",
            "line 2",
            "9 or 16 numbers, not 3",
        ),
        (
            "<shape type=\"cube\"><transform name=\"to_world\"><matrix value=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1\"/></transform></shape>",
            "line 2",
            "affine",
        ),
        (
            "<shape type=\"cube\"><transform name=\"to_world\"><scale value=\"1e30\"/><scale value=\"1e30\"/></transform></shape>",
            "line 2",
            "overflows",
        ),
        ("<shape type=\"cube\"><transform name=\"to_world\"><shear/></transform></shape>", "line 2", "not a step"),
        ("<shape type=\"cube\"><bsdf type=\"twosided\"/></shape>", "line 2", "needs a bsdf inside"),
        (
            "<shape type=\"cube\"><bsdf type=\"diffuse\"/><bsdf type=\"diffuse\"/></shape>",
            "line 2",
            "more than one <bsdf>",
        ),
        (
            "<shape type=\"cube\"><bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"1, 2\"/></bsdf></shape>",
            "line 2",
            "one or three numbers",
        ),
        (
            "<shape type=\"cube\"><bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"2\"/></bsdf></shape>",
            "line 2",
            "does not lie in [0, 1]",
        ),
        (
            "<shape type=\"cube\"><bsdf type=\"diffuse\"><srgb name=\"reflectance\" value=\"#12345g\"/></bsdf></shape>",
            "line 2",
            "#rrggbb",
        ),
        (
            "<shape type=\"cube\"><bsdf type=\"diffuse\"><spectrum name=\"reflectance\" value=\"500:1, 400:1\"/></bsdf></shape>",
            "line 2",
            "do not increase",
        ),
        (
            "<shape type=\"cube\"><bsdf type=\"plastic\"><string name=\"int_ior\" value=\"butter\"/></bsdf></shape>",
            "line 2",
            "`butter`",
        ),
        ("<emitter type=\"area\"/>", "line 2", "inside a shape"),
        ("<emitter type=\"envmap\"/>", "line 2", "needs a `filename`"),
        ("<emitter type=\"point\"><rgb name=\"intensity\" value=\"-1\"/></emitter>", "line 2", "negative"),
        (
            "<emitter type=\"directional\"><vector name=\"direction\" value=\"0\"/></emitter>",
            "line 2",
            "direction is zero",
        ),
        ("<shape type=\"obj\"/>", "line 2", "needs a `filename`"),
        (
            "<shape type=\"obj\"><string name=\"filename\" value=\"no.obj\"/></shape>",
            "line 2",
            "`no.obj` does not exist",
        ),
        ("<shape type=\"instance\"/>", "line 2", "needs a shapegroup"),
        ("<include filename=\"no.xml\"/>", "line 2", "`no.xml` does not exist"),
        ("<float name=\"a\" value=\"$b\"/>", "line 2", "`$b` has no value"),
        ("<default value=\"1\"/>", "line 2", "`name`"),
        ("<alias id=\"a\" as=\"b\"/>", "line 2", "nothing has the id `a`"),
    ];
    for (body, place, cause) in cases {
        check(&error(body, &[]), "scene.xml", place, cause);
    }
}

#[test]
fn a_missing_scene_or_one_that_is_no_scene_is_an_error() {
    let folder = folder();
    check(&mitsuba::load(&folder.join("none.xml"), &Disk).unwrap_err(), "none.xml", "", "cannot be read");
    check(&mitsuba::load(&folder, &Disk).unwrap_err(), folder.to_str().unwrap(), "", "cannot be read");
    for (text, place, cause) in [
        (&b""[..], "line 1", "XML"),
        (b"hello", "line 1", "XML"),
        (b"\xff\xfe", "line 1", "UTF-8"),
        (b"<scene>\n\xe4</scene>", "line 2", "UTF-8"),
        (b"<svg/>", "line 1", "<svg>"),
    ] {
        std::fs::write(folder.join("a.xml"), text).unwrap();
        check(&mitsuba::load(&folder.join("a.xml"), &Disk).unwrap_err(), "a.xml", place, cause);
    }
}

#[test]
fn cycles_and_depth_are_errors() {
    let own = b"<scene version=\"3.0.0\"><include filename=\"again.xml\"/><include filename=\"again.xml\"/></scene>";
    check(&error("<include filename=\"again.xml\"/>", &[("again.xml", own)]), "again.xml", "line 1", "include itself");
    let deep = "<bsdf type=\"twosided\">".repeat(100_000) + &"</bsdf>".repeat(100_000);
    check(&error(&deep, &[]), "scene.xml", "line 2", "nested deeper");
    let cycle = "<bsdf type=\"twosided\" id=\"a\"><ref id=\"b\"/></bsdf>\n<bsdf type=\"twosided\" id=\"b\"><ref id=\"a\"/></bsdf>\n\
                 <shape type=\"cube\"><ref id=\"a\"/></shape>";
    let cyclic = error(cycle, &[]);
    assert!(cyclic.cause.contains("contain itself"), "{cyclic}");
    let texture = "<texture type=\"scale\" id=\"t\"><ref id=\"t\"/></texture>\
                   <shape type=\"cube\"><bsdf type=\"diffuse\"><ref name=\"reflectance\" id=\"t\"/></bsdf></shape>";
    check(&error(texture, &[]), "scene.xml", "line 2", "contain itself");
    let group = "<shape type=\"shapegroup\" id=\"g\"><shape type=\"instance\"><ref id=\"g\"/></shape></shape>\
                 <shape type=\"instance\"><ref id=\"g\"/></shape>";
    check(&error(group, &[]), "scene.xml", "line 2", "cannot contain");
    // The text doubles one byte forty times.
    let doubling = |i: usize| format!("<default name=\"p{i:02}\" value=\"$p{:02}$p{:02}\"/>", i - 1, i - 1);
    let bomb = "<default name=\"p00\" value=\"x\"/>".to_owned() + &(1..40).map(doubling).collect::<String>();
    check(&error(&bomb, &[]), "scene.xml", "line 2", "grows beyond");
    // A thousand instances of fifty meshes have eight thousand triangles each.
    let spheres = "<shape type=\"sphere\"/>".repeat(50);
    let instances = "<shape type=\"instance\"><ref id=\"g\"/></shape>".repeat(1000);
    let many = format!("<shape type=\"shapegroup\" id=\"g\">{spheres}</shape>{instances}");
    check(&error(&many, &[]), "scene.xml", "line 2", "more than 268435456 triangles");
}

const PLY_HEAD: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                        element face 1\nproperty list uchar int vertex_indices\nend_header\n";

#[test]
fn wrong_ply_files_are_errors_with_their_place() {
    let body = "<shape type=\"ply\"><string name=\"filename\" value=\"m.ply\"/></shape>";
    let cases = [
        (String::new(), "", "magic"),
        ("solid".to_owned(), "line 1", "magic"),
        (PLY_HEAD.replace("ascii", "utf"), "line 2", "parse"),
        (PLY_HEAD.replace("end_header\n", ""), "line 9", "end of file"),
        (PLY_HEAD.to_owned(), "line 10", "end of file"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 11", "found nothing"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 0 0\n0 1 0\n", "line 13", "end of file"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n", "line 11", "parse"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n", "vertex 1", "not finite"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 1e99 0\n0 1 0\n3 0 1 2\n", "vertex 1", "not finite"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "face 0", "refers to vertex 3 of 3"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "face 0", "negative"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "face 0", "2 corners"),
        (PLY_HEAD.to_owned() + "0 0 0\n1 0 0\n0 1 0\n255 0 1 2\n", "line 13", ""),
        (PLY_HEAD.replace("vertex 3", "vertex 99999999999999999999") + "0 0 0\n", "line 3", ""),
        (PLY_HEAD.replace("vertex 3", "vertex 4000000000") + "0 0 0\n", "", "truncated"),
        (PLY_HEAD.replace("property float z\n", "") + "0 0\n1 0\n0 1\n3 0 1 2\n", "", "x, y and z"),
        (PLY_HEAD.replace("vertex_indices", "corners") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "", "vertex_indices"),
        ("ply\nformat binary_little_endian 1.0\nelement nothing 4000000000\nend_header\n".to_owned(), "", "truncated"),
    ];
    for (text, place, cause) in cases {
        let error = error(body, &[("m.ply", text.as_bytes())]);
        assert!(
            error.cause.to_lowercase().contains(&cause.to_lowercase()),
            "{error}: nothing about `{cause}` in {text}"
        );
        check(&error, "m.ply", place, "");
    }
    // A binary list claims two thousand million corners.
    let mut list = PLY_HEAD.replace("ascii", "binary_little_endian").replace("uchar int", "uint int").into_bytes();
    list.extend([0; 36]);
    list.extend(2_000_000_000_u32.to_le_bytes());
    check(&error(body, &[("m.ply", &list)]), "m.ply", "", "");
}

#[test]
fn wrong_obj_files_are_errors_with_their_line() {
    let body = "<shape type=\"obj\"><string name=\"filename\" value=\"m.obj\"/></shape>";
    for (text, place, cause) in [
        ("v 0 0 0\nv 1 0\n", "line 2", "3 numbers are expected, not 2"),
        ("v 0 0 zero\n", "line 1", "`zero` is not a number"),
        ("v 0 0 NaN\n", "line 1", "not finite"),
        ("vn 0 inf 0\n", "line 1", "not finite"),
        ("vt\n", "line 1", "1 numbers are expected"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4", "refers to vertex 4 of 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "line 4", "refers to vertex 0 of 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", "line 4", "refers to vertex -4 of 3"),
        ("v 0 0 0\nf 1 1 99999999999999999999\n", "line 2", "is not a corner"),
        ("v 0 0 0\nf 1 1 -9223372036854775808\n", "line 2", "refers to vertex"),
        ("v 0 0 0\nf 1 1 1/1/1/1\n", "line 2", ""),
    ] {
        check(&error(body, &[("m.obj", text.as_bytes())]), "m.obj", place, cause);
    }
}

/// What other programs leave out, too, is named: the rest of the mesh is drawn.
#[test]
fn what_obj_files_lack_is_a_warning() {
    let body = "<shape type=\"obj\"><string name=\"filename\" value=\"m.obj\"/></shape>";
    for (faces, warning) in [
        ("f 1/1 2 3\n", "texture coordinates or normals that corners refer to are not in the file: 1"),
        ("f 1//1 2 3\n", "texture coordinates or normals that corners refer to are not in the file: 1"),
        ("f 1 2\nf 1 2 3\n", "faces of less than three corners are left out: 1"),
    ] {
        let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}");
        let scene = load(body, &[("m.obj", text.as_bytes())]).unwrap();
        assert_eq!(Geometry::new(&scene).triangles.len(), 1);
        assert!(scene.warnings.iter().any(|w| w.contains("`m.obj`") && w.contains(warning)), "{:?}", scene.warnings);
    }
}

#[test]
fn wrong_serialized_files_are_errors() {
    let body = |index: i32| {
        format!(
            "<shape type=\"serialized\"><string name=\"filename\" value=\"m.serialized\"/>\
             <integer name=\"shape_index\" value=\"{index}\"/></shape>"
        )
    };
    let head = [0x1c, 0x04, 0x04, 0x00];
    let file = |rest: &[u8]| [&head[..], rest].concat();
    check(&error(&body(-1), &[("m.serialized", &file(&[]))]), "scene.xml", "line 2", "negative");
    check(&error(&body(0), &[("m.serialized", b"ply")]), "m.serialized", "", "version 3 or 4");
    check(&error(&body(0), &[("m.serialized", &head)]), "m.serialized", "mesh 0", "outside the file");
    check(&error(&body(0), &[("m.serialized", &file(b"not zlib at all"))]), "m.serialized", "mesh 0", "damaged");
    check(&error(&body(3), &[("m.serialized", &file(&[0, 1, 0, 0, 0]))]), "m.serialized", "mesh 3", "has 1 meshes");
    check(&error(&body(3), &[("m.serialized", &file(&[0xff; 8]))]), "m.serialized", "mesh 3", "truncated");
}

#[test]
fn wrong_pictures_and_skies_are_errors() {
    let body = |name: &str| {
        format!(
            "<shape type=\"cube\"><bsdf type=\"diffuse\"><texture name=\"reflectance\" type=\"bitmap\">\
             <string name=\"filename\" value=\"{name}\"/></texture></bsdf></shape>"
        )
    };
    check(&error(&body("p.png"), &[("p.png", b"\x89PNG\r\n\x1a\n")]), "p.png", "", "cannot be decoded");
    check(&error(&body("p.exr"), &[("p.exr", b"\x76\x2f\x31\x01")]), "p.exr", "", "");
    let sky = |name: &str| format!("<emitter type=\"envmap\"><string name=\"filename\" value=\"{name}\"/></emitter>");
    check(&error(&sky("s.hdr"), &[("s.hdr", b"#?RADIANCE\n")]), "s.hdr", "", "cannot be decoded");
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2000000000 +X 2000000000\n";
    check(&error(&sky("s.hdr"), &[("s.hdr", huge)]), "s.hdr", "", "cannot be decoded");
}

/// Generator of test numbers: PCG-XSH-RR 64/32 (O'Neill 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let word = (((self.0 >> 18) ^ self.0) >> 27) as u32;
        word.rotate_right((self.0 >> 59) as u32) as usize % end
    }

    /// Changes, removes, doubles or inserts a few bytes.
    fn mutate(&mut self, bytes: &mut Vec<u8>) {
        const SPICE: &[&[u8]] =
            &[b"-1", b"nan", b"1e39", b"99999999999", b"\"", b"<", b">", b"$", b"0", b"\xff", b"/", b"\n"];
        for _ in 0..=self.below(2) {
            let at = self.below(bytes.len());
            let end = (at + 1 + self.below(12)).min(bytes.len());
            match self.below(10) {
                0..=4 if bytes[at].is_ascii_digit() => bytes[at] = b'0' + self.below(10) as u8,
                0..=4 => bytes[at] = self.below(256) as u8,
                5 => drop(bytes.drain(at..end)),
                6 => {
                    let piece = bytes[at..end].to_vec();
                    drop(bytes.splice(at..at, piece));
                }
                7 | 8 => drop(bytes.splice(at..at, SPICE[self.below(SPICE.len())].iter().copied())),
                _ => bytes.truncate(at.max(1)),
            }
        }
    }
}

#[test]
fn mutated_files_never_panic() {
    let xml = br#"<scene version="3.0.0">
<default name="size" value="2"/>
<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="64"/></film></sensor>
<texture type="checkerboard" id="squares"><rgb name="color0" value="0.5"/><transform name="to_uv"><scale value="$size"/></transform></texture>
<bsdf type="twosided" id="paint"><bsdf type="diffuse"><ref name="reflectance" id="squares"/></bsdf></bsdf>
<bsdf type="bumpmap" id="bumpy"><ref id="squares"/><bsdf type="roughplastic"><float name="alpha" value="0.2"/></bsdf></bsdf>
<shape type="ply"><string name="filename" value="a.ply"/><ref id="paint"/></shape>
<shape type="ply"><string name="filename" value="b.ply"/><ref id="bumpy"/></shape>
<shape type="obj"><string name="filename" value="c.obj"/><emitter type="area"><spectrum name="radiance" value="400:1, 700:2"/></emitter></shape>
<shape type="cube"><transform name="to_world"><rotate x="1" angle="30"/><scale x="2"/></transform><ref id="bumpy"/></shape>
<emitter type="spot"><rgb name="intensity" value="1, 2, 3"/><float name="cutoff_angle" value="30"/></emitter>
</scene>"#
        .to_vec();
    let ascii = (PLY_HEAD.to_owned() + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").into_bytes();
    let mut binary = PLY_HEAD.replace("ascii", "binary_little_endian").into_bytes();
    for v in [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        binary.extend(v.to_le_bytes());
    }
    binary.push(3);
    binary.extend([0_i32, 1, 2].iter().flat_map(|i| i.to_le_bytes()));
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 -3\n".to_vec();
    let originals = [("scene.xml", xml), ("a.ply", ascii), ("b.ply", binary), ("c.obj", obj)];
    let folder = folder();
    let write = |(name, bytes): &(&str, Vec<u8>)| std::fs::write(folder.join(name), bytes).unwrap();
    let load = || {
        let start = Instant::now();
        let result = mitsuba::load(&folder.join("scene.xml"), &Disk).map(|scene| Geometry::new(&scene).triangles.len());
        assert!(start.elapsed() < TIME_LIMIT, "took {:?}", start.elapsed());
        result
    };
    originals.iter().for_each(write);
    assert_eq!(load().unwrap(), 1 + 1 + 2 + 12, "the original loads");
    let mut random = Random(2012);
    let (mut loaded, mut refused) = (0, 0);
    for round in 0..800 {
        let mut file = originals[round % 4].clone();
        random.mutate(&mut file.1);
        write(&file);
        let result = load();
        write(&originals[round % 4]);
        match result {
            Ok(_) => loaded += 1,
            Err(error) => {
                refused += 1;
                assert!(!error.cause.is_empty(), "{error}");
            }
        }
    }
    // Some mutations must load and others must be refused.
    assert!(loaded > 50 && refused > 200, "{loaded} loaded, {refused} refused");
}
