//! Scene loading: selects the loader by name and checks the result.

use std::path::Path;

use crate::scene::builtin;
use crate::scene::check::finish;
use crate::scene::load::environment::EnvironmentChange;
use crate::scene::load::files::{Disk, Files, InMemory, Resolver};
use crate::scene::model::error::LoadError;
use crate::scene::model::scene::Scene;

pub mod environment;
mod far;
pub mod files;
pub mod gltf;
pub mod ies;
pub mod meshes;
pub mod mitsuba;
pub mod sky;
mod strokes;
pub mod studio;

/// A kind of scene file.
pub struct Format {
    /// Endings of its files, lower case, without the dot.
    pub endings: &'static [&'static str],
    /// One line for `lightsheaf scenes`.
    pub about: &'static str,
    load: fn(&Path, Option<&str>, &dyn Files) -> Result<Scene, LoadError>,
}

/// All kinds of scene files.
pub const FORMATS: [Format; 5] = [
    Format {
        endings: &["gltf", "glb", "vrm"],
        about: "glTF 2.0, data embedded or in files beside it; avatars of VRM",
        load: gltf::load,
    },
    Format {
        endings: &["xml"],
        about: "Mitsuba 0.5, 0.6, 2 and 3",
        load: |path, variant, files| no_variants(path, variant).and_then(|()| mitsuba::load(path, files)),
    },
    Format {
        endings: &["obj"],
        about: "Wavefront OBJ with its materials and vertex colours",
        load: |path, variant, files| no_variants(path, variant).and_then(|()| meshes::load_obj(path, files)),
    },
    Format {
        endings: &["ply"],
        about: "PLY with its vertex colours; clouds of points",
        load: |path, variant, files| no_variants(path, variant).and_then(|()| meshes::load_ply(path, files)),
    },
    Format {
        endings: &["stl"],
        about: "STL, ASCII and binary",
        load: |path, variant, files| no_variants(path, variant).and_then(|()| meshes::load_stl(path, files)),
    },
];

/// Returns the endings of all scene files: `.gltf, .glb, .vrm, .xml, .obj, .ply, .stl`.
#[must_use]
pub fn endings() -> String {
    let endings = FORMATS.iter().flat_map(|format| format.endings);
    endings.map(|ending| format!(".{ending}")).collect::<Vec<_>>().join(", ")
}

/// Loads a scene from a file of one of the [`FORMATS`], or a built-in one as `builtin:NAME`.
///
/// Indices of the result are in range and positions finite. [`crate::staging`] adds a camera and a light if
/// the file has none.
///
/// # Errors
/// Any defect of the file is an error; the message names the place and the cause.
pub fn load(spec: &str) -> Result<Scene, LoadError> {
    load_with(spec, None, &EnvironmentChange::default())
}

/// Loads a scene like [`load()`] in one of its variants (KHR_materials_variants), and changes its environment.
///
/// # Errors
/// The errors of [`load()`] and of [`EnvironmentChange::apply`] are returned. A variant that does not exist is
/// an error that lists those that do.
pub fn load_with(spec: &str, variant: Option<&str>, change: &EnvironmentChange) -> Result<Scene, LoadError> {
    let path = Path::new(spec);
    let scene = match spec.strip_prefix("builtin:") {
        Some(name) => no_variants(path, variant).and_then(|()| builtin::load(name))?,
        None => read(path, variant, &Disk)?,
    };
    checked(scene, spec, change)
}

/// Loads a scene like [`load()`] from a file in memory. `name` is its path or mere name, whose ending says what it
/// is; `resolver` returns the files that it refers to.
///
/// # Errors
/// As [`load()`]. A file that the resolver does not know is an error with its path.
pub fn load_bytes(name: &str, bytes: &[u8], resolver: &Resolver) -> Result<Scene, LoadError> {
    let path = Path::new(name);
    let scene = read(path, None, &InMemory { path, bytes, resolver })?;
    checked(scene, name, &EnvironmentChange::default())
}

/// Loads a file by the loader of its ending.
fn read(path: &Path, variant: Option<&str>, files: &dyn Files) -> Result<Scene, LoadError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let format = FORMATS.iter().find(|format| format.endings.contains(&extension.as_str()));
    let cause = || {
        format!("not a scene: expected {} or builtin:NAME; Blender and others convert most files to .glb", endings())
    };
    (format.ok_or_else(|| LoadError::new(path, cause()))?.load)(path, variant, files)
}

/// Names a scene, changes its environment and checks it.
fn checked(mut scene: Scene, name: &str, change: &EnvironmentChange) -> Result<Scene, LoadError> {
    scene.name = name.to_owned();
    change.apply(&mut scene)?;
    finish(&mut scene, Path::new(name))?;
    Ok(scene)
}

/// Refuses a variant of a scene that has none.
fn no_variants(path: &Path, variant: Option<&str>) -> Result<(), LoadError> {
    variant
        .map_or(Ok(()), |name| Err(LoadError::new(path, format!("there is no variant `{name}`: the scene has none"))))
}
