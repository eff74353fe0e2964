//! Shaders: WESL modules embedded in the program, linked at run time by name and flags.

use std::borrow::Cow;

/// Feature flags of a shader, such as `GLOSSY`; a flag that is not named is off.
pub type Flags<'a> = &'a [&'a str];

macro_rules! modules {
    ($($name:literal),* $(,)?) => {
        const MODULES: &[(&str, &str)] = &[$(($name, include_str!(concat!("../../shaders/", $name, ".wesl")))),*];
    };
}

modules!(
    "lib/bsdf",
    "lib/bundle",
    "lib/camera",
    "lib/choice",
    "lib/control",
    "lib/emission",
    "lib/eye",
    "lib/film",
    "lib/first_hit",
    "lib/footprint",
    "lib/frame",
    "lib/guide",
    "lib/items",
    "lib/light",
    "lib/light_choice",
    "lib/light_joint",
    "lib/light_tree",
    "lib/light_vertex",
    "lib/lighting",
    "lib/lights",
    "lib/lists",
    "lib/live",
    "lib/mis",
    "lib/mis_subpaths",
    "lib/neighbours",
    "lib/new_vertices",
    "lib/path_vertex",
    "lib/paths",
    "lib/pattern",
    "lib/pool_site",
    "lib/pose",
    "lib/radiance",
    "lib/random",
    "lib/refinement",
    "lib/rsm",
    "lib/sampling",
    "lib/scatter",
    "lib/scene",
    "lib/seen",
    "lib/sky",
    "lib/strategy",
    "lib/surface",
    "lib/texture",
    "lib/tiles",
    "lib/view",
    "visibility/raster",
    "visibility/ray_query",
    "visibility/twin",
    "accumulate",
    "antialias",
    "compose",
    "connect",
    "controls",
    "deform",
    "depth_maps",
    "displaced_normals",
    "draws",
    "extend",
    "eye_paths",
    "eye_vertices",
    "filter",
    "gbuffer",
    "gradient",
    "light_draws",
    "light_gifts",
    "light_paths",
    "light_point",
    "light_pool",
    "light_reuse",
    "light_subpath",
    "list_lengths",
    "mis_sums",
    "non_finite",
    "outliers",
    "path_weights",
    "queries",
    "ray_queries",
    "reservoirs",
    "resolve",
    "rsm",
    "temporal",
    "tessellate",
    "twins",
    "view_lists",
    "view_setup",
);

/// Names of all modules, passes and libraries alike.
pub fn module_names() -> impl Iterator<Item = &'static str> {
    MODULES.iter().map(|(name, _)| *name)
}

/// Links a module and all that it imports into WGSL, with the given flags on.
///
/// # Errors
/// The linker's diagnostics. A shader of ours that fails to link is a bug; tests link every module with every set of flags.
pub fn link(name: &str, flags: Flags) -> Result<String, String> {
    let mut resolver = wesl::VirtualResolver::new();
    let path = |name: &str| -> Result<wesl::ModulePath, String> {
        format!("package::{}", name.replace('/', "::")).parse().map_err(|e| format!("{name}: {e:?}"))
    };
    for (module, source) in MODULES {
        resolver.add_module(path(module)?, Cow::Borrowed(*source));
    }
    let mut compiler = wesl::Wesl::new("").set_custom_resolver(resolver);
    // Names stay as written, so that bindings can go by name; a clash between modules is a redefinition, which naga refuses.
    compiler.set_mangler(wesl::ManglerKind::None);
    compiler.set_missing_feature_behavior(false);
    for flag in flags {
        compiler.set_feature(flag, true);
    }
    let linked = compiler.compile(&path(name)?).map_err(|e| format!("{name}: {e}"))?;
    Ok(linked.to_string())
}
