//! Links WESL shader modules at run time, by name and flags.
//!
//! The modules are embedded in the program. A debug build reads them from the source tree instead, if there
//! is one, so that a changed shader needs no compilation.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use include_dir::{Dir, include_dir};

use super::Flag;

/// Extension of a module's file.
const EXTENSION: &str = ".wesl";

static EMBEDDED: Dir = include_dir!("$CARGO_MANIFEST_DIR/shaders");

/// The main module of a pipeline.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    /// The path of a file below shaders/, without extension.
    Embedded(&'a str),
    /// A unique name, and a text that may import modules below shaders/.
    Text(&'a str, &'a str),
}

impl Source<'_> {
    /// Returns the module's name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Embedded(name) | Self::Text(name, _) => name,
        }
    }
}

/// Returns the names and texts of all modules, sorted by name.
fn modules() -> &'static [(String, Cow<'static, str>)] {
    static MODULES: OnceLock<Vec<(String, Cow<'static, str>)>> = OnceLock::new();
    MODULES.get_or_init(|| {
        let mut modules = Vec::new();
        collect(&EMBEDDED, &mut modules);
        modules.sort();
        modules
    })
}

/// Adds the modules of a folder and of its subfolders.
fn collect(folder: &Dir<'static>, modules: &mut Vec<(String, Cow<'static, str>)>) {
    for file in folder.files() {
        let path = file.path().to_string_lossy().replace('\\', "/");
        if let (Some(name), Some(text)) = (path.strip_suffix(EXTENSION), file.contents_utf8()) {
            let on_disk = source_tree().and_then(|root| std::fs::read_to_string(root.join(&path)).ok());
            modules.push((name.to_owned(), on_disk.map_or(Cow::Borrowed(text), Cow::Owned)));
        }
    }
    folder.dirs().for_each(|folder| collect(folder, modules));
}

/// Returns the folder of the shaders' sources in debug builds, if it exists.
fn source_tree() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    (cfg!(debug_assertions) && root.is_dir()).then_some(root)
}

/// Returns the names of all modules, passes and libraries alike.
pub fn module_names() -> impl Iterator<Item = &'static str> {
    modules().iter().map(|(name, _)| name.as_str())
}

/// Links a module and its imports into WGSL, with the given flags on.
///
/// # Errors
/// The linker's diagnostics if a module does not link. Tests link every module with every set of flags.
pub fn link(name: &str, flags: &[Flag]) -> Result<String, String> {
    link_source(&Source::Embedded(name), flags)
}

/// Links any source as [`link`] does.
///
/// # Errors
/// As [`link`].
pub fn link_source(source: &Source, flags: &[Flag]) -> Result<String, String> {
    let mut resolver = wesl::VirtualResolver::new();
    let path = |name: &str| -> Result<wesl::ModulePath, String> {
        format!("package::{}", name.replace('/', "::")).parse().map_err(|e| format!("{name}: {e:?}"))
    };
    for (module, text) in modules() {
        resolver.add_module(path(module)?, Cow::Borrowed(text.as_ref()));
    }
    if let Source::Text(name, text) = source {
        resolver.add_module(path(name)?, Cow::Borrowed(*text));
    }
    let mut compiler = wesl::Wesl::new("").set_custom_resolver(resolver);
    // Names stay unmangled, so that resources can be bound by name. A clash between modules is a
    // redefinition, which naga rejects.
    compiler.set_mangler(wesl::ManglerKind::None);
    compiler.set_missing_feature_behavior(false);
    for flag in flags {
        compiler.set_feature(flag.name(), true);
    }
    let name = source.name();
    let linked = compiler.compile(&path(name)?).map_err(|e| format!("{name}: {e}"))?;
    Ok(linked.to_string())
}
