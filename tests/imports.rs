//! The import rules of the architecture, read off the sources. Needs no GPU.
//!
//! A file imports another one if it names something that the other one defines. Names that a `mod.rs`
//! re-exports belong to the file that defines them; `mod` and `pub use` lines import nothing.
//!
//! - A file imports its own part or lower layers ([`LAYERS`]). Parts of one layer never import each other.
//! - `scene`, `gpu`, `settings` and `film` import only themselves and `crop`; `metrics` and `tonemap` import `film`,
//!   `exposure` also `scene` and `crop`.
//! - `reference` imports only `crop`, `scene` and `film`, since it judges the GPU side; `staging` imports `scene` and
//!   `reference`.
//! - Passes below render/shared/passes never import each other.
//! - No circle of imports leads through files of different folders.
//! - At most 8 files lie directly in src/.
//! - A shader imports `package::lib`, and a pass also `package::visibility`, never another pass.
//! - Numbers in shaders are no denormal ones, which devices may take for zero.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Parts of the program by layer, the lowest first; a file belongs to the longest prefix of its module path.
/// `render` is render/mod.rs alone, which opens a renderer of either method.
const LAYERS: &[&[&str]] = &[
    &["crop"],
    &["scene", "gpu", "settings", "film"],
    &["metrics", "exposure", "tonemap", "reference"],
    &["staging"],
    &[BASE],
    &["render::lights", "render::visibility"],
    &["render::upload"],
    &["render::frame_uniform", "render::recording"],
    &["render::denoise"],
    &["render::shared", "render::subpaths"],
    &["render"],
    &["bench", "stress", "viewer"],
    &["bench::report"],
    &["cli"],
    &["main"],
];

/// The part of all other files directly in src/render.
const BASE: &str = "render::base";

/// Parts that import less than their layer lets them.
const ONLY: &[(&str, &[&str])] = &[
    ("metrics", &["film"]),
    ("exposure", &["crop", "film", "scene"]),
    ("tonemap", &["film"]),
    ("reference", &["crop", "scene", "film"]),
    ("staging", &["scene", "reference"]),
];

const PASSES: &str = "render::shared::passes::";

/// Returns all files below a folder that end in `extension`, with their paths relative to it, `/` between
/// parts.
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

/// Returns the source without comments.
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

type Segments = Vec<String>;

fn segments(path: &str) -> Segments {
    path.split("::").map(|s| s.trim().to_owned()).filter(|s| !s.is_empty()).collect()
}

/// Returns each path of a `use` tree with the name that it introduces; a glob's path ends in `*`.
fn use_tree(tree: &str) -> Vec<(Segments, String)> {
    if let Some(at) = tree.find('{') {
        let before = segments(&tree[..at]);
        let list = &tree[at + 1..tree.rfind('}').unwrap_or(tree.len())];
        return split_list(list)
            .iter()
            .flat_map(|part| use_tree(part))
            .map(|(path, name)| {
                if path == ["self"] {
                    let last = before.last().cloned().unwrap_or_default();
                    return (before.clone(), if name == "self" { last } else { name });
                }
                ([before.clone(), path].concat(), name)
            })
            .collect();
    }
    let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
    let path = segments(path);
    let name = if alias.is_empty() { path.last().cloned().unwrap_or_default() } else { alias.trim().to_owned() };
    vec![(path, name)]
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Splits code into its `use` trees, each with true if it is public, and the rest.
fn take_uses(code: &str) -> (Vec<(bool, String)>, String) {
    let (mut uses, mut rest) = (Vec::new(), String::new());
    let mut from = 0;
    for (at, _) in code.match_indices("use ") {
        if at < from || code[..at].ends_with(is_name) {
            continue;
        }
        let end = code[at..].find(';').map_or(code.len(), |end| at + end);
        let line = code[..at].rfind('\n').map_or(0, |newline| newline + 1);
        let before = code[line..at].trim();
        if !(before.is_empty() || before.starts_with("pub") || before.ends_with([']', '{'])) {
            continue;
        }
        uses.push((before.starts_with("pub"), code[at + 4..end].split_whitespace().collect::<Vec<_>>().join(" ")));
        rest.push_str(&code[from..at]);
        from = end;
    }
    rest.push_str(&code[from..]);
    (uses, rest)
}

/// Returns the module path of a file: `scene/load/mod.rs` is scene, load.
fn module_of(file: &str) -> Segments {
    let path = file.trim_end_matches(".rs").trim_end_matches("/mod");
    if path == "lib" { vec![] } else { path.split('/').map(str::to_owned).collect() }
}

/// A program's sources as modules.
struct Crate {
    /// Files by module.
    files: BTreeMap<Segments, String>,
    /// Re-exports of each module: name and path from the crate's root. A glob has the name `*`.
    exports: BTreeMap<Segments, Vec<(String, Segments)>>,
    sources: Vec<(String, String)>,
}

impl Crate {
    fn new(sources: Vec<(String, String)>) -> Self {
        let files: BTreeMap<_, _> = sources.iter().map(|(file, _)| (module_of(file), file.clone())).collect();
        let mut out = Self { files, exports: BTreeMap::new(), sources };
        for (file, source) in &out.sources {
            let module = module_of(file);
            let public = take_uses(&code(source)).0.into_iter().filter(|(public, _)| *public);
            let exports: Vec<_> = public
                .flat_map(|(_, tree)| use_tree(&tree))
                .filter_map(|(path, name)| Some((name, out.absolute(&module, &path)?)))
                .collect();
            out.exports.insert(module, exports);
        }
        out
    }

    /// Returns a path from the crate's root, or none for paths of other crates.
    fn absolute(&self, module: &Segments, path: &[String]) -> Option<Segments> {
        let first = path.first()?;
        let child = [module.as_slice(), std::slice::from_ref(first)].concat();
        match first.as_str() {
            "crate" | "lightsheaf" => Some(path[1..].to_vec()),
            "self" => Some([module, &path[1..]].concat()),
            "super" => {
                let up = path.iter().take_while(|s| *s == "super").count();
                Some([&module[..module.len().saturating_sub(up)], &path[up..]].concat())
            }
            _ if self.files.contains_key(&child) => Some([module, path].concat()),
            _ => None,
        }
    }

    /// Returns the file that defines a path from the root, and true if the path is a module.
    fn resolve(&self, path: &[String]) -> Option<(&str, bool)> {
        let mut at = 0;
        while at < path.len() && self.files.contains_key(&path[..=at]) {
            at += 1;
        }
        let file = self.files.get(&path[..at]).map(String::as_str);
        let Some(name) = path.get(at) else { return Some((file?, true)) };
        let exports = self.exports.get(&path[..at]).map_or(&[][..], Vec::as_slice);
        if let Some((_, target)) = exports.iter().find(|(export, _)| export == name) {
            let next = [target, &path[at + 1..]].concat();
            return if next == path { Some((file?, false)) } else { self.resolve(&next) };
        }
        // A glob may export the name if the module itself does not define it.
        let globs = exports.iter().filter(|(export, _)| export == "*");
        let mut through = globs.filter_map(|(_, target)| {
            let next = [&target[..target.len() - 1], &path[at..]].concat();
            let (found, module) = self.resolve(&next)?;
            let defines = |source: &str| source.contains(&format!(" {name}"));
            self.sources.iter().any(|(file, source)| file == found && defines(source)).then_some((found, module))
        });
        through.next_back().or(Some((file?, false)))
    }

    /// Returns the paths from the root that a module's code names.
    fn named(&self, module: &Segments, code: &str) -> Vec<Segments> {
        let (uses, rest) = take_uses(code);
        let mut out = Vec::new();
        let mut modules: BTreeMap<String, Segments> = BTreeMap::new();
        for (public, tree) in uses {
            for (path, name) in use_tree(&tree) {
                let Some(path) = self.absolute(module, &path).filter(|_| !public) else { continue };
                let path = path.strip_suffix(&["*".to_owned()]).map_or(path.clone(), <[String]>::to_vec);
                // A module's name only abbreviates the paths below it.
                match self.files.contains_key(&path) {
                    true => drop(modules.insert(name, path)),
                    false => out.push(path),
                }
            }
        }
        let mut from = 0;
        while let Some(at) = rest[from..].find("::").map(|at| from + at) {
            let start = rest[..at].rfind(|c| !is_name(c)).map_or(0, |before| before + 1);
            let mut end = at;
            while let Some(next) = rest[end..].strip_prefix("::").filter(|next| next.starts_with(is_name)) {
                end += 2 + next.find(|c| !is_name(c)).unwrap_or(next.len());
            }
            from = end.max(at + 2);
            if start == at || rest[..start].ends_with("::") {
                continue;
            }
            let path = segments(&rest[start..end]);
            match modules.get(&path[0]) {
                Some(target) => out.push([target, &path[1..]].concat()),
                None => out.extend(self.absolute(module, &path)),
            }
        }
        out
    }

    /// Returns the files that each file imports.
    fn imports(&self) -> BTreeMap<&str, BTreeSet<&str>> {
        let mut out: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        for (file, source) in &self.sources {
            let (module, source) = (module_of(file), code(source));
            let (before, tests) = source.split_once("\nmod tests {").unwrap_or((&source, ""));
            let inner = [module.as_slice(), &["tests".to_owned()]].concat();
            let named = [self.named(&module, before), self.named(&inner, tests)].concat();
            let found = named.iter().filter_map(|path| self.resolve(path)).map(|(found, _)| found);
            out.entry(file).or_default().extend(found.filter(|found| found != file));
        }
        out
    }
}

/// Returns the part of [`LAYERS`] that a file belongs to, and its layer.
fn part(file: &str) -> Option<(&'static str, usize)> {
    let module = module_of(file).join("::");
    let parts = LAYERS.iter().enumerate().flat_map(|(layer, parts)| parts.iter().map(move |part| (*part, layer)));
    let of = |part: &str| module == part || module.starts_with(&format!("{part}::"));
    let (found, layer) = parts.clone().filter(|(part, _)| of(part)).max_by_key(|(part, _)| part.len())?;
    if found == "render" && module != "render" {
        return parts.clone().find(|(part, _)| *part == BASE);
    }
    Some((found, layer))
}

/// Returns the rule that an import breaks, if any.
fn broken_rule(from: &str, to: &str) -> Option<String> {
    let says = |rule: &str| Some(format!("{from} imports {to}: {rule}"));
    let (Some((importer, upper)), Some((imported, lower))) = (part(from), part(to)) else {
        let lib = |file: &str| file == "lib.rs";
        return if lib(from) || lib(to) { None } else { says("one of them is in no layer") };
    };
    if importer == imported {
        let passes = [from, to].map(|file| module_of(file).join("::")).map(|m| m.starts_with(PASSES));
        return if passes == [true; 2] { says("passes never import each other") } else { None };
    }
    if lower > upper {
        return says("a lower layer imports a higher one");
    }
    if lower == upper {
        return says("parts of one layer never import each other");
    }
    let only = ONLY.iter().find(|(part, _)| *part == importer);
    if only.is_some_and(|(_, allowed)| !allowed.contains(&imported)) {
        return says("it imports less than that");
    }
    None
}

/// Returns the folder of a file.
fn folder(file: &str) -> &str {
    file.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Returns the imports between files of different folders from whose target a chain of imports leads back.
fn circles<'a>(imports: &BTreeMap<&'a str, BTreeSet<&'a str>>) -> Vec<(&'a str, &'a str)> {
    let reached = |start: &'a str| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![start]);
        while let Some(file) = open.pop() {
            open.extend(imports.get(file).into_iter().flatten().copied().filter(|next| seen.insert(*next)));
        }
        seen
    };
    let reached: BTreeMap<&str, BTreeSet<&str>> = imports.keys().map(|file| (*file, reached(file))).collect();
    let edges = imports.iter().flat_map(|(from, targets)| targets.iter().map(move |to| (*from, *to)));
    edges
        .filter(|(from, to)| folder(from) != folder(to) && reached.get(to).is_some_and(|back| back.contains(from)))
        .collect()
}

/// Returns the rule that a shader's import breaks, if any.
fn broken_shader_rule(from: &str, to: &str) -> Option<String> {
    let allowed =
        to.starts_with("package::lib::") || (to.starts_with("package::visibility::") && !from.starts_with("lib/"));
    (!allowed).then(|| format!("shaders/{from} imports {to}: shaders import lib, and passes visibility, never a pass"))
}

#[test]
fn sources_keep_the_rules() {
    let program = Crate::new(files("src", "rs"));
    assert!(program.sources.len() > 100, "{}", program.sources.len());
    let imports = program.imports();
    let edges: Vec<_> = imports.iter().flat_map(|(from, to)| to.iter().map(move |to| (*from, *to))).collect();
    assert!(edges.len() > 300, "{}", edges.len());
    let broken: Vec<_> = edges.iter().filter_map(|(from, to)| broken_rule(from, to)).collect();
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn no_circle_leads_through_folders() {
    let program = Crate::new(files("src", "rs"));
    let circles = circles(&program.imports());
    let text: Vec<_> = circles.iter().map(|(from, to)| format!("{from} -> {to}")).collect();
    assert!(text.is_empty(), "these imports are parts of circles: {text:#?}");
}

#[test]
fn few_files_lie_in_the_root() {
    let root: Vec<_> = files("src", "rs").into_iter().map(|(file, _)| file).filter(|f| !f.contains('/')).collect();
    assert!((1..=8).contains(&root.len()), "{root:?}");
}

#[test]
fn shaders_keep_the_rules() {
    let (mut broken, mut checked) = (Vec::new(), 0);
    for (file, source) in files("shaders", "wesl").into_iter().chain(files("tests/shaders", "wesl")) {
        for import in code(&source).split("import ").skip(1).filter_map(|rest| rest.split(';').next()) {
            checked += 1;
            broken.extend(broken_shader_rule(&file, import));
        }
    }
    assert!(checked > 20, "{checked}");
    assert!(broken.is_empty(), "{broken:#?}");
}

/// gpu's ledger counts calls of wgpu that create or record something, so that no other module makes them. The
/// viewer's window is an exception, since its device draws the interface with egui's pipelines.
#[test]
fn only_gpu_calls_wgpu() {
    let calls = [
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
            let made: Vec<_> = calls.iter().filter(|call| code(&source).contains(&format!(".{call}"))).collect();
            made.into_iter().map(|call| format!("{file} calls {call}")).collect::<Vec<_>>()
        })
    };
    assert!(found(true).count() >= calls.len(), "the ledger's own calls are found");
    let others: Vec<_> = found(false).filter(|call| !call.starts_with("viewer/screen.rs")).collect();
    assert!(others.is_empty(), "{others:#?}: use the functions of Gpu, Compute and Raster");
}

/// Returns a small program, in which planted imports have to be found.
fn planted(sources: &[(&str, &str)]) -> Crate {
    Crate::new(sources.iter().map(|(file, source)| ((*file).to_owned(), (*source).to_owned())).collect())
}

#[test]
fn planted_imports_are_found() {
    let program = planted(&[
        ("lib.rs", "pub mod a;\npub mod b;\npub mod c;"),
        (
            "a/mod.rs",
            "mod deep;\npub mod other;\npub use deep::{Deep, Old as New};\npub use other::*;\npub fn here() {}",
        ),
        ("a/deep.rs", "pub struct Deep;\npub struct Old;"),
        ("a/other.rs", "pub struct Other;"),
        ("b.rs", ""),
        ("c/mod.rs", "mod inner;\nfn f() { inner::g() }"),
        ("c/inner.rs", ""),
    ]);
    let found = |file: &str, source: &str| -> Vec<String> {
        let named = program.named(&module_of(file), &code(source));
        named.iter().filter_map(|path| program.resolve(path)).map(|(file, _)| file.to_owned()).collect()
    };
    assert_eq!(found("b.rs", "use crate::a::Deep;"), ["a/deep.rs"]);
    assert_eq!(
        found("b.rs", "use crate::a::{\n    New, Other as O,\n    here,\n};"),
        ["a/deep.rs", "a/other.rs", "a/mod.rs"]
    );
    assert_eq!(found("b.rs", "// use crate::a::Deep;\nfn f() -> crate::a::other::Other {}"), ["a/other.rs"]);
    assert_eq!(found("b.rs", "use crate::a;\nfn f(_: a::Deep) { a::here() }"), ["a/deep.rs", "a/mod.rs"]);
    assert_eq!(
        found("b.rs", "use crate::a::{self as alias, other::{Other}};\ntype T = alias::New;"),
        ["a/other.rs", "a/deep.rs"]
    );
    assert_eq!(found("c/inner.rs", "use super::f;\nuse super::super::a::Deep;"), ["c/mod.rs", "a/deep.rs"]);
    assert_eq!(found("main.rs", "fn main() { lightsheaf::a::here() }"), ["a/mod.rs"]);
    assert_eq!(found("b.rs", "use std::fs;\nfn f() { fs::read(); Vec::<u8>::new(); }"), Vec::<String>::new());
    let imports = program.imports();
    assert_eq!(imports["c/mod.rs"], ["c/inner.rs"].into(), "a child is named without `self`");
    assert!(imports["a/mod.rs"].is_empty(), "re-exports import nothing");
}

#[test]
fn planted_circles_are_found() {
    let circle = |x: &str, y: &str| {
        let program = planted(&[
            ("lib.rs", "pub mod a;\npub mod b;"),
            ("a/mod.rs", "pub mod x;\npub mod z;\npub use x::X;"),
            ("a/x.rs", x),
            ("a/z.rs", "use crate::a::x::X;\npub struct Z;"),
            ("b/mod.rs", "mod y;\npub use y::Y;"),
            ("b/y.rs", y),
        ]);
        circles(&program.imports()).iter().map(|(from, to)| format!("{from} -> {to}")).collect::<Vec<_>>()
    };
    assert_eq!(circle("pub struct X;", "use crate::a::X;\npub struct Y;"), Vec::<String>::new());
    let both = ["a/x.rs -> b/y.rs", "b/y.rs -> a/x.rs"];
    assert_eq!(circle("use crate::b::Y;\npub struct X;", "use crate::a::X;\npub struct Y;"), both);
    let long = ["a/x.rs -> b/y.rs", "b/y.rs -> a/z.rs"];
    assert_eq!(circle("use crate::b::Y;\npub struct X;", "fn f(_: crate::a::z::Z) {}\npub struct Y;"), long);
    assert_eq!(circle("use super::z::Z;\npub struct X;", "pub struct Y;"), Vec::<String>::new(), "one folder");
    let facade = circle("use crate::b::Y;\npub struct X;", "use crate::a;\npub struct Y(a::X);");
    assert_eq!(facade, both, "a module's name does not hide a circle");
}

#[test]
fn planted_rules_are_broken() {
    for (from, to) in [
        ("scene/model/mesh.rs", "gpu/pass.rs"),
        ("gpu/pass.rs", "scene/model/scene.rs"),
        ("settings.rs", "scene/model/scene.rs"),
        ("film.rs", "metrics.rs"),
        ("metrics.rs", "scene/model/scene.rs"),
        ("tonemap.rs", "gpu/pass.rs"),
        ("render/shared/passes/paths/connect.rs", "render/shared/passes/paths/extend.rs"),
        ("render/shared/passes/paths/connect.rs", "render/shared/passes/views/view_lists.rs"),
        ("reference/path.rs", "gpu/pass.rs"),
        ("reference/path.rs", "render/layouts.rs"),
        ("reference/path.rs", "settings.rs"),
        ("staging/mod.rs", "film.rs"),
        ("render/layouts.rs", "render/upload/gpu_scene.rs"),
        ("render/lights/table.rs", "render/visibility/view.rs"),
        ("render/visibility/view.rs", "render/shared/frame.rs"),
        ("render/denoise/mod.rs", "render/shared/plan/mod.rs"),
        ("render/shared/mod.rs", "render/subpaths/mod.rs"),
        ("render/subpaths/mod.rs", "render/shared/plan/mod.rs"),
        ("render/shared/mod.rs", "render/mod.rs"),
        ("render/renderer.rs", "viewer/window.rs"),
        ("render/renderer.rs", "bench/mod.rs"),
        ("viewer/window.rs", "cli/mod.rs"),
        ("bench/contender.rs", "bench/report/mod.rs"),
        ("stress/mod.rs", "bench/mod.rs"),
        ("film.rs", "unknown.rs"),
    ] {
        assert!(broken_rule(from, to).is_some(), "{from} may not import {to}");
    }
    for (from, to) in [
        ("scene/model/mesh.rs", "scene/model/scene.rs"),
        ("metrics.rs", "film.rs"),
        ("exposure.rs", "scene/model/scene.rs"),
        ("tonemap.rs", "film.rs"),
        ("reference/path.rs", "reference/bvh.rs"),
        ("reference/mod.rs", "film.rs"),
        ("render/layouts.rs", "render/sampler.rs"),
        ("render/upload/gpu_scene.rs", "render/lights/table.rs"),
        ("render/shared/passes/paths/connect.rs", "gpu/pass.rs"),
        ("render/shared/passes/paths/connect.rs", "render/visibility/view.rs"),
        ("render/shared/frame.rs", "render/shared/passes/paths/connect.rs"),
        ("render/mod.rs", "render/shared/mod.rs"),
        ("bench/contender.rs", "render/mod.rs"),
        ("bench/truth.rs", "reference/rounds.rs"),
        ("bench/report/mod.rs", "bench/mod.rs"),
        ("viewer/engine.rs", "render/shared/mod.rs"),
        ("cli/window.rs", "viewer/window.rs"),
        ("main.rs", "cli/mod.rs"),
    ] {
        assert_eq!(broken_rule(from, to), None);
    }
    assert!(broken_shader_rule("shared/paths/extend.wesl", "package::shared::paths::connect::Strategy").is_some());
    assert!(broken_shader_rule("lib/pixels/eye.wesl", "package::visibility::raster::sees").is_some());
    assert!(broken_shader_rule("visibility/raster.wesl", "package::shared::paths::extend::main").is_some());
    assert!(broken_shader_rule("shared/paths/extend.wesl", "package::visibility::raster::sees").is_none());
    assert!(broken_shader_rule("shared/paths/extend.wesl", "package::lib::scene::NONE").is_none());
}

/// Returns the numbers in scientific notation whose size is below the least normal number.
fn denormal_numbers(code: &str) -> Vec<&str> {
    let words = code.split(|c: char| !c.is_ascii_alphanumeric() && c != '.' && c != '-');
    let is_denormal = |word: &&str| {
        let number = word.trim_start_matches('-').parse::<f64>();
        number.is_ok_and(|number| number > 0.0 && number < f64::from(f32::MIN_POSITIVE))
    };
    words.filter(is_denormal).collect()
}

#[test]
fn shaders_have_no_denormal_numbers() {
    assert_eq!(denormal_numbers("max(x, 1e-38) / (2e-39 + 1.2e-38)"), ["1e-38", "2e-39"]);
    let shaders = files("shaders", "wesl");
    assert!(!shaders.is_empty());
    for (name, source) in shaders {
        assert_eq!(denormal_numbers(&source), [""; 0], "{name}");
    }
}
