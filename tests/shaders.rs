//! Every shader links and validates with the sets of flags that can occur. Needs no GPU.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use lightsheaf::gpu::{link, module_names};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use wgpu::naga;

/// Source of a module, as it lies in the repository.
fn source(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders").join(name).with_extension("wesl");
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Flags that `@if(...)` asks about in a source.
fn flags_in(source: &str) -> BTreeSet<String> {
    let conditions = source.split("@if(").skip(1).filter_map(|rest| rest.split(')').next());
    conditions.flat_map(|c| c.split(['!', '&', '|', ' ', '(']).filter(|f| !f.is_empty()).map(str::to_owned)).collect()
}

/// Modules that a source imports from, conditionally or not.
fn imports_in(source: &str) -> Vec<String> {
    let paths = source.split("import package::").skip(1);
    paths
        .map(|rest| rest.split(';').next().unwrap_or_default())
        .map(|path| {
            let module = path.split("::{").next().unwrap_or(path);
            let module =
                if path.contains("::{") { module } else { module.rsplit_once("::").map_or(module, |(m, _)| m) };
            module.replace("::", "/")
        })
        .collect()
}

/// Flags of a module and of all that it imports.
fn flags_of(name: &str) -> BTreeSet<String> {
    let mut seen = BTreeSet::new();
    let mut flags = BTreeSet::new();
    let mut open = vec![name.to_owned()];
    while let Some(module) = open.pop() {
        let source = source(&module);
        flags.extend(flags_in(&source));
        open.extend(imports_in(&source).into_iter().filter(|import| seen.insert(import.clone())));
    }
    flags
}

/// Whether the program can ask for this set of flags.
fn sensible(pass: &str, set: &[&str]) -> bool {
    let has = |flag| set.contains(&flag);
    // A map is an environment; only VPLs are clamped; the last extension exists only to meet light.
    (!has("ENVIRONMENT_MAP") || has("ENVIRONMENT"))
        // Bundles follow a map, and nothing else than rays or lists answers; a light's table is asked for light alone.
        && (!has("SKY_BUNDLES") || pass != "extend" || has("ENVIRONMENT_MAP"))
        && !(has("FAST") && has("RAY_QUERY"))
        // Who chooses asks for no visibility.
        && !(has("CHOOSE") && (has("FAST") || has("RAY_QUERY")))
        // Patterns and tables are of lights that have to be sampled.
        && (!has("PATTERNS") || has("PUNCTUAL"))
        && (!has("RSM") || has("PUNCTUAL"))
        && (!has("RSM") || has("LIGHT") || pass != "connect")
        && !(has("CLAMPED") && has("LIGHT"))
        // Those who follow mirrors do wherever anything is glossy, and what lets light pass is glossy too.
        && has("SPECULAR") == (has("GLOSSY") && follows_mirrors(pass))
        // What is resampled comes down the tree, and only where paths start at the camera alone.
        && (!has("RESERVOIRS") || (has("LIGHT_TREE") && !has("LIGHT_PATHS")))
        && (pass != "reservoirs" || has("LIGHT_TREE"))
        // Frames that are filtered keep no light points.
        && !(has("REUSE") && has("LAYERED"))
        && (pass != "light_reuse" || has("REUSE"))
        && (!has("TRANSMISSION") || has("SPECULAR"))
        // Rays go anywhere, VPLs are somewhere.
        && !(has("AFAR") && (has("RAY_QUERY") || has("CHOOSE")))
        && (!has("AFAR") || has("LIGHT") || pass != "connect")
        // Entries are counted where somebody reads the count.
        && has("WALKED") == (pass == "list_lengths")
        // Layers are not summed, and have no tiles that settle.
        && !(has("SETTLES") && has("LAYERED"))
        && (!has("LAST") || has("EMISSION") || has("ENVIRONMENT"))
}

/// Whether a pass goes on behind mirrors and through glass.
fn follows_mirrors(pass: &str) -> bool {
    matches!(pass, "eye_paths" | "light_paths" | "mis_sums" | "draws" | "reservoirs")
}

/// Flags that are on, or off, while all others are not, in sets that every run of the tests links. A condition of ours asks about two
/// flags at most, and needs one more for another.
const FEW: u32 = 3;

/// Passes that ask views around light vertices which are infinitely far away, or may be.
const ASKS_LIGHTS: [&str; 4] = ["connect", "light_pool", "light_reuse", "queries"];

/// All sensible subsets, or those of them with few flags on, or few off.
fn sets<'a>(pass: &str, flags: &[&'a str], every: bool) -> Vec<Vec<&'a str>> {
    // Reached by imports alone; no set with it is sensible. SPECULAR comes with GLOSSY.
    let mirrors = follows_mirrors(pass);
    assert!(!mirrors || flags.contains(&"SPECULAR"), "{pass}");
    let flags: Vec<_> = flags
        .iter()
        .copied()
        .filter(|f| *f != "SPECULAR" && (mirrors || *f != "TRANSMISSION"))
        .filter(|f| pass == "list_lengths" || *f != "WALKED")
        .filter(|f| *f != "OUTLINES" && (ASKS_LIGHTS.contains(&pass) || *f != "AFAR"))
        .collect();
    assert!(flags.len() <= 14, "too many sets of {flags:?}: say which are not sensible together");
    let few = |bits: &u32| bits.count_ones().min(flags.len() as u32 - bits.count_ones()) <= FEW;
    (0..1_u32 << flags.len())
        .filter(|bits| every || few(bits))
        .map(|bits| (0..flags.len()).filter(|i| bits >> i & 1 == 1).map(|i| flags[i]).collect::<Vec<_>>())
        .map(|mut set| {
            set.extend(set.contains(&"GLOSSY").then_some("SPECULAR").filter(|_| mirrors));
            let along = matches!(pass, "extend" | "list_lengths" | "queries") && !set.contains(&"RAY_QUERY");
            set.extend(along.then_some("OUTLINES"));
            set
        })
        .filter(|set| sensible(pass, set))
        .collect()
}

/// Parses and validates WGSL as a device does that has nothing beyond what every adapter has.
fn validate(wgsl: &str) -> Result<naga::Module, String> {
    validate_with(wgsl, naga::valid::Capabilities::default())
}

fn validate_with(wgsl: &str, capabilities: naga::valid::Capabilities) -> Result<naga::Module, String> {
    let module = naga::front::wgsl::parse_str(wgsl).map_err(|e| e.emit_to_string(wgsl))?;
    naga::valid::Validator::new(naga::valid::ValidationFlags::all(), capabilities)
        .validate(&module)
        .map_err(|e| e.emit_to_string(wgsl))?;
    Ok(module)
}

/// Whether a pass asks ray queries.
fn traces_rays(pass: &str, set: &[&str]) -> bool {
    matches!(pass, "ray_queries" | "eye_paths" | "light_paths" | "mis_sums" | "reservoirs")
        || set.contains(&"RAY_QUERY")
}

/// Modules with an entry point.
fn passes() -> Vec<&'static str> {
    module_names()
        .filter(|name| ["@compute", "@vertex", "@fragment"].iter().any(|e| source(name).contains(e)))
        .collect()
}

#[test]
fn every_pass_links_and_validates_with_few_flags_on_or_off() {
    link_and_validate(false);
}

#[test]
#[ignore = "the test above has all sets of few flags; all 12,000 take minutes"]
fn every_pass_links_and_validates_with_every_set_of_flags() {
    link_and_validate(true);
}

fn link_and_validate(every: bool) {
    let passes = passes();
    assert!(passes.len() >= 9, "{passes:?}");
    let flags: BTreeMap<&str, BTreeSet<String>> = passes.iter().map(|&p| (p, flags_of(p))).collect();
    let cases: Vec<(&str, Vec<&str>)> = flags
        .iter()
        .flat_map(|(&pass, flags)| {
            let flags: Vec<&str> = flags.iter().map(String::as_str).collect();
            sets(pass, &flags, every).into_iter().map(move |set| (pass, set))
        })
        .collect();
    assert!(cases.len() > 100, "only {} cases", cases.len());

    // The same text need not be validated twice: flags that a set does not reach change nothing.
    let linked: Vec<String> = cases
        .par_iter()
        .map(|(pass, set)| link(pass, set).unwrap_or_else(|e| panic!("{pass} with {set:?} does not link: {e}")))
        .collect();
    let distinct: BTreeMap<&String, &(&str, Vec<&str>)> = linked.iter().zip(&cases).collect();
    let distinct: Vec<_> = distinct.into_iter().collect();
    let tracing = distinct.par_iter().filter(|(wgsl, (pass, set))| {
        // What asks no ray queries needs no capability; what does is refused without the one.
        let traces = traces_rays(pass, set);
        let ray_query = naga::valid::Capabilities::RAY_QUERY;
        let capabilities = naga::valid::Capabilities::default() | if traces { ray_query } else { Default::default() };
        let module = validate_with(wgsl, capabilities).unwrap_or_else(|e| panic!("{pass} with {set:?}: {e}"));
        assert!(!module.entry_points.is_empty(), "{pass} with {set:?} has no entry point");
        assert!(!traces || validate(wgsl).is_err(), "{pass} with {set:?} traces no rays");
        traces
    });
    assert!(tracing.count() > 2);
    println!("{} sets of flags over {} passes, {} distinct shaders", cases.len(), passes.len(), distinct.len());

    // Nothing that any shader asks about is left out, and each flag changes something.
    let everywhere: BTreeSet<String> = module_names().flat_map(|name| flags_in(&source(name))).collect();
    let covered: BTreeSet<String> = cases.iter().flat_map(|(_, set)| set.iter().map(|&f| f.to_owned())).collect();
    assert!(everywhere.len() >= 10, "{everywhere:?}");
    assert_eq!(everywhere, covered);
    for flag in &everywhere {
        let matters = cases.iter().zip(&linked).any(|((pass, set), text)| {
            set.contains(&flag.as_str()) && {
                let without: Vec<&str> = set.iter().copied().filter(|f| f != flag).collect();
                link(pass, &without).is_ok_and(|other| other != *text)
            }
        });
        assert!(matters, "{flag} changes no shader");
    }
}

#[test]
fn every_file_is_embedded() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let mut files = BTreeSet::new();
    let mut open = vec![root.clone()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(&root).unwrap().with_extension("");
                files.insert(name.components().map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/"));
            }
        }
    }
    assert_eq!(files, module_names().map(str::to_owned).collect());
}

#[test]
fn planted_errors_are_caught() {
    let good = link("connect", &[]).unwrap();
    validate(&good).unwrap();
    let renamed = good.replace("sees(z.", "sees_nowhere(z.");
    assert_ne!(good, renamed);
    assert!(validate(&renamed).unwrap_err().contains("sees_nowhere"), "an unknown name must not parse");
    let mistyped = good.replacen("0.0", "vec2f(0.0)", 1);
    assert_ne!(good, mistyped);
    assert!(validate(&mistyped).is_err(), "a wrong type must not validate");
    assert!(link("no_such_pass", &[]).is_err(), "an unknown module must not link");
    // A flag that does not exist is off, and changes nothing.
    assert_eq!(good, link("connect", &["NO_SUCH_FLAG"]).unwrap());
    // The readers of flags and imports see what is there.
    assert_eq!(flags_in("@if(!A) x @if(B && !C) y @else z"), ["A", "B", "C"].map(str::to_owned).into());
    assert_eq!(imports_in("@if(A) import package::lib::a::b;\nimport package::lib::c::{d, e};"), ["lib/a", "lib/c"]);
}
