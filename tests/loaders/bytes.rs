//! Tests of scenes whose files are in memory.

use std::path::{Path, PathBuf};

use lightsheaf::render::fingerprint::scene_hash;
use lightsheaf::scene::{self, Scene};

use crate::common::shared;

/// Loads a file from memory by its mere name; what it refers to is read from its folder.
fn by_bytes(path: &Path) -> Result<Scene, scene::LoadError> {
    let bytes = std::fs::read(path).unwrap();
    let folder = path.parent().unwrap();
    let resolver = |name: &str| {
        assert!(!name.starts_with("./"), "{name} starts from the scene's folder anyway");
        std::fs::read(folder.join(name)).ok()
    };
    scene::load_bytes(path.file_name().unwrap().to_str().unwrap(), &bytes, &resolver)
}

/// Returns the scenes of a list in a folder.
fn listed(folder: &Path) -> Vec<PathBuf> {
    let table = std::fs::read_to_string(folder.join("MANIFEST.tsv")).unwrap();
    let names = table.lines().skip(1).map(|line| line.split('\t').next().unwrap().to_owned());
    let scenes = names.filter(|name| [".gltf", ".glb", ".xml"].iter().any(|ending| name.ends_with(ending)));
    scenes.map(|name| folder.join(name)).collect()
}

#[test]
fn scenes_in_memory_are_those_on_disk() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let entries = std::fs::read_dir(fixtures).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = entries.filter(|path| path.extension().is_some_and(|e| e == "gltf")).collect();
    let of_fixtures = paths.len();
    if let Some(shared) = shared() {
        paths.extend(listed(&shared.join("scenes")));
        assert!(paths.len() >= of_fixtures + 60, "the table has shrunk: {}", paths.len());
    }
    for path in paths {
        let on_disk = scene::load(path.to_str().unwrap()).unwrap_or_else(|e| panic!("{e}"));
        let in_memory = by_bytes(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(scene_hash(&in_memory), scene_hash(&on_disk), "{}", path.display());
        assert_eq!([in_memory.warnings, in_memory.notes], [on_disk.warnings, on_disk.notes], "{}", path.display());
    }
}

#[test]
fn errors_are_those_on_disk() {
    let Some(shared) = shared() else { return };
    let mut same = 0;
    for path in listed(&shared.join("invalid")) {
        let (Err(on_disk), Err(in_memory)) = (scene::load(path.to_str().unwrap()), by_bytes(&path)) else { continue };
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(in_memory.to_string().contains(name), "the error does not name the file: {in_memory}");
        if in_memory.cause == on_disk.cause {
            same += 1;
        } else {
            let missing =
                on_disk.cause.contains("which cannot be read") && in_memory.cause.contains("which is missing");
            assert!(missing, "{on_disk}\n{in_memory}");
        }
    }
    assert!(same >= 86, "the table has shrunk: {same}");
}

#[test]
fn missing_files_are_named() {
    let gltf = br#"{"asset": {"version": "2.0"}, "buffers": [{"uri": "parts/a%20b.bin", "byteLength": 4}]}"#;
    let xml =
        br#"<scene version="3.0.0"><shape type="ply"><string name="filename" value="parts/a b.bin"/></shape></scene>"#;
    for (name, bytes) in [("box.gltf", &gltf[..]), ("box.xml", xml)] {
        let error = scene::load_bytes(name, bytes, &|_| None).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("parts/a b.bin"), "{error}");
    }
    let error = scene::load_bytes("box.gltf", gltf, &|_| None).unwrap_err().to_string();
    assert!(error.contains("give it together with"), "{error}");
    // The file is there, but too short.
    let short = |name: &str| (name == "parts/a b.bin").then(|| vec![0; 2]);
    let error = scene::load_bytes("folder/box.gltf", gltf, &short).unwrap_err().to_string();
    assert!(error.contains("truncated: 2 of 4 bytes"), "{error}");
    let error = scene::load_bytes("box.txt", &[], &|_| None).unwrap_err().to_string();
    assert!(error.contains("box.txt: not a scene"), "{error}");
}
