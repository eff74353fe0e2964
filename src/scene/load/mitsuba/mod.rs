//! Mitsuba scenes: XML of the dialects 0.5/0.6 and 2/3.
//!
//! [`load`] reads the XML into one tree (`xml`), then walks the root's children: `sensors`, `shapes` (with
//! the mesh files `ply`, `obj` and `serialized`), `bsdfs` with `textures` and `metals`, `emitters`. Values
//! are read by `values` and `spectra`; unused parameters are named in a warning. The settings of integrator
//! and sampler are ignored, because the command line sets them. A scene without sensor or light is returned
//! unchanged.
//!
//! Source: the plugin documentation of Mitsuba 0.6 and Mitsuba 3.

mod bsdfs;
mod emitters;
mod metals;
mod mixes;
mod principled;
mod sensors;
mod serialized;
mod shapes;
pub(in crate::scene) mod spectra;
mod tessellation;
mod textures;
mod values;
mod xml;

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use crate::scene::load::files::Files;
use crate::scene::{Instance, LoadError, Scene};
use values::{Ids, Plugin};
use xml::{Element, Search, Tree};

/// Loads a scene file and everything that it refers to.
///
/// # Errors
/// A file that is malformed and a value out of range are errors; the message names the file and the line. Ids, includes,
/// meshes, textures and skies that are not there are warnings, unless no surface is left without them.
pub fn load(path: &Path, files: &dyn Files) -> Result<Scene, LoadError> {
    let Tree { root, search, missing } = xml::read(path, files)?;
    let (ids, dangling) = xml::ids(&root)?;
    let mut loader = Loader {
        ids,
        search,
        scene: Scene { name: path.display().to_string(), says_its_light: true, ..Scene::default() },
        materials: HashMap::new(),
        images: HashMap::new(),
        groups: HashMap::new(),
        has_vertex_colors: false,
        vertex_colored: HashSet::new(),
        triangles: 0,
        missing: None,
    };
    for error in missing.into_iter().chain(dangling) {
        loader.warn(format!("{error}: it is left out"));
        loader.missing.get_or_insert(error);
    }
    for element in &root.children {
        loader.top_level(element)?;
    }
    let Loader { mut scene, vertex_colored, missing, .. } = loader;
    if let Some(error) = missing.filter(|_| scene.instances.is_empty()) {
        return Err(error);
    }
    // Materials use vertex colours only if a texture refers to them by name.
    for mesh in scene.meshes.iter_mut().filter(|mesh| !vertex_colored.contains(&mesh.material)) {
        mesh.colors.clear();
    }
    Ok(scene)
}

/// State of the loader. Elements are identified by their address.
struct Loader<'a> {
    ids: Ids<'a>,
    search: Search<'a>,
    scene: Scene,
    /// Materials by BSDF and emitter.
    materials: HashMap<[Option<*const Element>; 2], shapes::ShapeMaterial>,
    images: HashMap<PathBuf, usize>,
    groups: HashMap<*const Element, Vec<Instance>>,
    /// True if the BSDF that is being converted refers to vertex colours.
    has_vertex_colors: bool,
    /// Materials that refer to them.
    vertex_colored: HashSet<usize>,
    /// Number of world-space triangles, counted once per instance.
    triangles: usize,
    /// The first include, reference or mesh that is not there.
    missing: Option<LoadError>,
}

impl<'a> Loader<'a> {
    fn top_level(&mut self, element: &'a Element) -> Result<(), LoadError> {
        match element.tag.as_str() {
            "shape" => self.shape(element),
            "sensor" | "camera" => self.sensor(element),
            // These are read when a shape refers to them.
            "emitter" | "luminaire" if element.plugin() == "area" && element.attribute("id").is_some() => Ok(()),
            "bsdf" | "texture" | "spectrum" | "rgb" | "srgb" => Ok(()),
            "emitter" | "luminaire" => self.emitter(element),
            "integrator" => {
                if self.plugin(element)?.boolean("hide_emitters")? == Some(true) {
                    self.warn("hide_emitters is ignored: the camera sees lights and sky");
                }
                Ok(())
            }
            "sampler" | "film" | "alias" | "ref" | "string" | "integer" | "float" | "boolean" => Ok(()),
            "medium" | "volume" | "phase" | "subsurface" => {
                self.warn(format!("{}: participating media are not supported; it is left out", element.title()));
                Ok(())
            }
            tag => {
                self.warn(format!("<{tag}> ({}) is not known and is left out", element.place()));
                Ok(())
            }
        }
    }

    fn plugin(&self, element: &'a Element) -> Result<Plugin<'a>, LoadError> {
        Plugin::new(element, &self.ids)
    }

    fn warn(&mut self, warning: impl Into<String>) {
        self.scene.warn(warning);
    }

    /// Adds a warning with the unused parameters.
    fn finish(&mut self, plugin: &Plugin) {
        let unused = plugin.unused();
        if !unused.is_empty() {
            let plugin_name = plugin.element.plugin();
            self.warn(format!("`{plugin_name}`: not supported and ignored: {}", unused.join(", ")));
        }
    }
}
