//! The import rules of the architecture, read off the sources. Needs no GPU.
//!
//! - `scene`, `gpu`, `settings` and `film` import nothing of ours outside themselves; `metrics` compares films and imports
//!   `film` alone.
//! - Passes never import each other; `frame` wires them.
//! - `reference` imports `scene` and `film` only: nothing of the GPU side that it judges.
//! - `staging` imports `scene` and `reference`.
//! - Only `report` and `cli` import `bench`, and only `cli` imports `report`: what is measured does not know it.
//! - Nothing imports `cli` but the program, and nothing `viewer` but `cli`.
//! - A pass shader imports `package::lib` and `package::visibility`, never another pass; these never import a pass.

use std::path::{Path, PathBuf};

/// All files below a folder that end in `extension`, with their paths relative to it, `/` between parts.
fn files(folder: &str, extension: &str) -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut out = Vec::new();
    let mut open: Vec<PathBuf> = vec![root.clone()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == extension) {
                let relative = path.strip_prefix(&root).unwrap();
                let parts: Vec<_> = relative.components().map(|c| c.as_os_str().to_string_lossy()).collect();
                out.push((parts.join("/"), std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    out.sort();
    out
}

/// Source without comments.
fn code(source: &str) -> String {
    source.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// Splits `a, b::{c, d}` at the commas outside of braces.
fn split_list(list: &str) -> Vec<String> {
    let (mut depth, mut out, mut part) = (0, Vec::new(), String::new());
    for c in list.chars() {
        match c {
            ',' if depth == 0 => out.push(std::mem::take(&mut part)),
            _ => {
                depth += i32::from(c == '{') - i32::from(c == '}');
                part.push(c);
            }
        }
    }
    out.push(part);
    out.into_iter().map(|p| p.trim().to_owned()).filter(|p| !p.is_empty()).collect()
}

/// Paths below the crate that a source names: `layouts`, `gpu::Gpu`. `module` is its own path, for `super`.
fn crate_paths(module: &[&str], source: &str) -> Vec<Vec<String>> {
    let source = code(source);
    match source.split_once("\nmod tests {") {
        Some((before, tests)) => {
            [paths_of_module(module, before), paths_of_module(&[module, &["tests"]].concat(), tests)].concat()
        }
        None => paths_of_module(module, &source),
    }
}

fn paths_of_module(module: &[&str], source: &str) -> Vec<Vec<String>> {
    let mut out = Vec::new();
    let mut read = |base: &[&str], rest: &str| {
        let name = |text: &str| {
            let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
            text[..end].to_owned()
        };
        let heads = if let Some(list) = rest.strip_prefix('{') {
            let mut depth = 1;
            let end = list.find(|c| {
                depth += i32::from(c == '{') - i32::from(c == '}');
                depth == 0
            });
            split_list(&list[..end.unwrap_or(list.len())])
        } else {
            vec![rest.to_owned()]
        };
        for head in heads {
            let first = name(&head);
            let mut path: Vec<String> = base.iter().map(|&b| b.to_owned()).collect();
            let after = head[first.len()..].trim_start().strip_prefix("::").map(str::to_owned);
            path.push(first);
            match after {
                Some(list) if list.starts_with('{') => {
                    let inner = list.trim_start_matches('{').split('}').next().unwrap_or_default().to_owned();
                    for item in split_list(&inner) {
                        out.push([path.clone(), vec![name(&item)]].concat());
                    }
                }
                Some(next) => out.push([path, vec![name(&next)]].concat()),
                None => out.push(path),
            }
        }
    };
    for (at, word) in source.match_indices("crate::").chain(source.match_indices("lightsheaf::")) {
        let before = source[..at].chars().next_back();
        if !before.is_some_and(|c| c.is_alphanumeric() || c == '_') {
            read(&[], &source[at + word.len()..]);
        }
    }
    for (at, word) in source.match_indices("super::") {
        if source[..at].ends_with("super::") || source[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let mut rest = &source[at + word.len()..];
        let mut up = 1;
        while let Some(next) = rest.strip_prefix("super::") {
            (rest, up) = (next, up + 1);
        }
        read(&module[..module.len().saturating_sub(up)], rest);
    }
    out
}

/// The rule that an import breaks, if any. `from` is the importing module's path below the crate, `to` what it names.
fn broken_rule(from: &[&str], to: &[String]) -> Option<String> {
    let (Some(&importer), Some(imported)) = (from.first(), to.first()) else { return None };
    let imported = imported.as_str();
    let says = |rule: &str| Some(format!("{} imports {}: {rule}", from.join("::"), to.join("::")));
    if imported == "cli" && !matches!(importer, "cli" | "main") {
        return says("nothing imports cli");
    }
    if imported == "viewer" && !matches!(importer, "viewer" | "cli") {
        return says("only cli imports viewer");
    }
    if imported == "bench" && !matches!(importer, "bench" | "report" | "cli") {
        return says("only report and cli import bench");
    }
    if imported == "report" && !matches!(importer, "report" | "cli") {
        return says("only cli imports report");
    }
    if importer == imported {
        if importer == "passes" && to.len() > 1 && from.len() > 1 && to[1] != from[1] {
            return says("passes never import each other");
        }
        return None;
    }
    match importer {
        "scene" | "gpu" | "settings" | "film" => says("it imports nothing of ours"),
        "metrics" if imported != "film" => says("it imports only film"),
        "staging" if !matches!(imported, "scene" | "reference") => says("it looks at scenes, by the reference's rays"),
        "reference" if !matches!(imported, "scene" | "film") => says("the judge shares nothing with what it judges"),
        _ => None,
    }
}

/// The rule that a shader's import breaks, if any.
fn broken_shader_rule(from: &str, to: &str) -> Option<String> {
    let ours =
        to.starts_with("package::lib::") || (to.starts_with("package::visibility::") && !from.starts_with("lib/"));
    (!ours).then(|| format!("shaders/{from} imports {to}: shaders import lib, and passes visibility, never a pass"))
}

/// Module path of a file: `scene/gltf/mod.rs` is scene, gltf.
fn module_of(file: &str) -> Vec<&str> {
    let path = file.trim_end_matches(".rs").trim_end_matches("/mod");
    if path == "lib" { vec![] } else { path.split('/').collect() }
}

#[test]
fn sources_keep_the_rules() {
    let files = files("src", "rs");
    assert!(files.len() > 40, "{}", files.len());
    let (mut broken, mut checked) = (Vec::new(), 0);
    for (file, source) in &files {
        let module = module_of(file);
        for path in crate_paths(&module, source) {
            checked += 1;
            broken.extend(broken_rule(&module, &path));
        }
    }
    assert!(checked > 100, "{checked}");
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn shaders_keep_the_rules() {
    let (mut broken, mut checked) = (Vec::new(), 0);
    for (file, source) in files("shaders", "wesl") {
        for import in code(&source).split("import ").skip(1).filter_map(|rest| rest.split(';').next()) {
            checked += 1;
            broken.extend(broken_shader_rule(&file, import));
        }
    }
    assert!(checked > 20, "{checked}");
    assert!(broken.is_empty(), "{broken:#?}");
}

/// What is asked of wgpu is counted in `gpu`'s ledger, so nobody else asks; but for the viewer's window, whose device draws the
/// interface by pipelines of egui and renders nothing.
#[test]
fn only_gpu_asks_wgpu_for_things() {
    let asks = [
        "create_buffer(",
        "create_texture(",
        "create_blas(",
        "create_tlas(",
        "create_compute_pipeline(",
        "create_render_pipeline(",
        "begin_compute_pass(",
        "begin_render_pass(",
    ];
    let found = |inside: bool| {
        let files = files("src", "rs").into_iter().filter(move |(file, _)| file.starts_with("gpu/") == inside);
        files.flat_map(|(file, source)| {
            let asked: Vec<_> = asks.iter().filter(|ask| code(&source).contains(&format!(".{ask}"))).collect();
            asked.into_iter().map(|ask| format!("{file} calls {ask}")).collect::<Vec<_>>()
        })
    };
    assert!(found(true).count() >= asks.len(), "the ledger's own calls are found");
    let others: Vec<_> = found(false).filter(|call| !call.starts_with("viewer/screen.rs")).collect();
    assert!(others.is_empty(), "{others:#?}: use the functions of Gpu, Compute and Raster");
}

#[test]
fn planted_imports_are_found() {
    let paths = |module: &[&str], source: &str| -> Vec<String> {
        crate_paths(module, source).iter().map(|p| p.join("::")).collect()
    };
    assert_eq!(paths(&["frame"], "use crate::gpu::Gpu;\nuse crate::layouts;"), ["gpu::Gpu", "layouts"]);
    assert_eq!(paths(&["frame"], "use crate::{gpu::{self, Gpu}, scene};"), ["gpu::self", "gpu::Gpu", "scene"]);
    assert_eq!(paths(&["frame"], "// use crate::gpu::Gpu;\nfn f() -> crate::scene::Scene {}"), ["scene::Scene"]);
    assert_eq!(paths(&["passes", "connect"], "use super::extend::Extend;"), ["passes::extend::Extend"]);
    assert_eq!(paths(&["film"], "\nmod tests {\n    use super::*;\n    use super::Film;\n}"), ["film::", "film::Film"]);
    assert_eq!(paths(&["scene", "gltf", "mesh"], "use super::super::super::gpu::Gpu;"), ["gpu::Gpu"]);
    assert_eq!(paths(&["main"], "use lightsheaf::cli::run;"), ["cli::run"]);

    let broken =
        |from: &[&str], to: &str| broken_rule(from, &to.split("::").map(str::to_owned).collect::<Vec<_>>()).is_some();
    for (from, to) in [
        (&["scene", "mesh"][..], "gpu::Gpu"),
        (&["gpu", "pass"], "scene::Scene"),
        (&["settings"], "scene::Scene"),
        (&["film"], "metrics"),
        (&["metrics"], "scene"),
        (&["passes", "connect"], "passes::extend"),
        (&["reference", "path"], "gpu::Gpu"),
        (&["reference", "path"], "layouts"),
        (&["reference", "path"], "passes::connect"),
        (&["reference", "path"], "frame::Frame"),
        (&["renderer"], "cli"),
        (&["renderer"], "viewer::window"),
        (&["main"], "viewer::window"),
        (&["viewer", "window"], "cli::run"),
        (&["scene"], "cli"),
        (&["renderer"], "bench::race"),
        (&["bench", "contender"], "report::Report"),
    ] {
        assert!(broken(from, to), "{from:?} may not import {to}");
    }
    for (from, to) in [
        (&["scene", "mesh"][..], "scene::Scene"),
        (&["metrics"], "film::Film"),
        (&["passes", "connect"], "gpu::Gpu"),
        (&["passes", "connect"], "view::ViewBuffers"),
        (&["reference", "path"], "reference::bvh"),
        (&["reference", "mod"], "film::Film"),
        (&["frame"], "passes::connect"),
        (&["main"], "cli::run"),
        (&["cli"], "renderer::Renderer"),
        (&["cli", "window"], "viewer::window"),
        (&["viewer", "ui", "panel"], "viewer::state"),
        (&["viewer", "engine"], "renderer::Renderer"),
        (&["report"], "bench::Entry"),
        (&["bench", "truth"], "reference::Rounds"),
    ] {
        assert!(!broken(from, to), "{from:?} may import {to}");
    }
    assert!(broken_shader_rule("extend.wesl", "package::connect::Strategy").is_some());
    assert!(broken_shader_rule("lib/eye.wesl", "package::visibility::raster::sees").is_some());
    assert!(broken_shader_rule("visibility/raster.wesl", "package::extend::main").is_some());
    assert!(broken_shader_rule("extend.wesl", "package::visibility::raster::sees").is_none());
    assert!(broken_shader_rule("extend.wesl", "package::lib::scene::NONE").is_none());
}
