//! Every shader, the library's and the tests' own, links and validates with the sets of flags that can occur.
//! Needs no GPU.

mod common;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};
use std::path::Path;

use common::browser::{Browser, Site};
use common::shaders;
use lightsheaf::gpu::{Flag, Source, flag_names, link, link_source, module_names};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};

const CONNECT: &str = "shared/paths/connect";
const EXTEND: &str = "shared/paths/extend";
const LIST_LENGTHS: &str = "shared/views/list_lengths";
const LIGHT_CANDIDATES: &str = "shared/light/light_candidates";
const LIGHT_RESERVOIRS: &str = "shared/light/light_reservoirs";
const EYE_PATHS: &str = "subpaths/eye_paths";
const LIGHT_PATHS: &str = "subpaths/light_paths";
const RESERVOIRS: &str = "subpaths/reservoirs";
const CAUSTICS: &str = "shared/light/caustics";

/// Returns the text of a module, as it lies in the repository.
fn text(name: &str) -> String {
    let folder = if shaders::find(name).is_some() { "tests/shaders" } else { "shaders" };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join(name).with_extension("wesl");
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Links a module of the library or of the tests.
fn link_any(name: &str, flags: &[Flag]) -> Result<String, String> {
    link_source(&shaders::find(name).unwrap_or(Source::Embedded(name)), flags)
}

/// Returns the names in the `@if(...)` of a text.
fn conditions_in(text: &str) -> BTreeSet<String> {
    let conditions = text.split("@if(").skip(1).filter_map(|rest| rest.split(')').next());
    conditions.flat_map(|c| c.split(['!', '&', '|', ' ', '(']).filter(|f| !f.is_empty()).map(str::to_owned)).collect()
}

/// Returns the flags in the `@if(...)` of a module.
fn flags_in(name: &str) -> BTreeSet<Flag> {
    let flag = |condition: String| {
        let found = Flag::ALL.iter().copied().find(|flag| flag.name() == condition);
        found.unwrap_or_else(|| panic!("{name}: @if({condition}) is not a Flag"))
    };
    conditions_in(&text(name)).into_iter().map(flag).collect()
}

/// Returns the modules that a text imports from, conditionally or not.
fn imports_in(text: &str) -> Vec<String> {
    let paths = text.split("import package::").skip(1);
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

/// Returns the flags of a module and of all that it imports.
fn flags_of(name: &str) -> BTreeSet<Flag> {
    let mut seen = BTreeSet::new();
    let mut flags = BTreeSet::new();
    let mut open = vec![name.to_owned()];
    while let Some(module) = open.pop() {
        flags.extend(flags_in(&module));
        open.extend(imports_in(&text(&module)).into_iter().filter(|import| seen.insert(import.clone())));
    }
    flags
}

/// True if the program can link the pass with this set of flags.
fn sensible(pass: &str, set: &[Flag]) -> bool {
    let has = |flag| set.contains(&flag);
    // A map is part of an environment.
    (!has(Flag::EnvironmentMap) || has(Flag::Environment))
        // Bundle directions follow a map.
        && (!has(Flag::SkyBundles) || pass != EXTEND || has(Flag::EnvironmentMap))
        // Either rays or lists answer visibility, and a pass that selects light points tests none.
        && !(has(Flag::Fast) && has(Flag::Rays))
        && !(has(Flag::Choose) && (has(Flag::Fast) || has(Flag::Rays)))
        // The lists of a grid are written after its cells are divided.
        && !(has(Flag::Cells) && has(Flag::Lists))
        // Patterns and the reflective shadow map belong to punctual lights; the map is read where y0 is
        // connected.
        && (!has(Flag::Patterns) || has(Flag::Punctual))
        && (!has(Flag::Rsm) || has(Flag::Punctual))
        && (!has(Flag::Rsm) || has(Flag::Light) || pass != CONNECT)
        // Only VPLs are clamped.
        && !(has(Flag::Clamped) && has(Flag::Light))
        // Methods that follow mirrors do so wherever anything is glossy; transmission is glossy too.
        && has(Flag::Specular) == (has(Flag::Glossy) && follows_mirrors(pass))
        && (!has(Flag::Transmission) || has(Flag::Specular))
        // Reservoirs resample lights of the tree, and only where no light subpaths are traced.
        && (!has(Flag::Reservoirs) || (has(Flag::LightTree) && !has(Flag::LightPaths)))
        && (pass != RESERVOIRS || has(Flag::LightTree))
        // Denoised frames do not reuse light points.
        && !(has(Flag::Reuse) && has(Flag::Layered))
        && (pass != LIGHT_RESERVOIRS || has(Flag::Reuse))
        // Rays reach infinity without a flag, and VPLs are local.
        && !(has(Flag::Infinite) && (has(Flag::Rays) || has(Flag::Choose)))
        && (!has(Flag::Infinite) || has(Flag::Light) || pass != CONNECT)
        // Only one pass reads the count of list entries.
        && has(Flag::Walked) == (pass == LIST_LENGTHS)
        // Along rows the filter averages squares, and keeps nothing.
        && (!has(Flag::Across) || (has(Flag::Coarse) && !has(Flag::Residual)))
        // Layers are not summed and have no converged tiles.
        && !(has(Flag::Adaptive) && has(Flag::Layered))
        // Rays find what the camera sees exactly.
        && !(has(Flag::Borders) && has(Flag::Rays))
        // Rays look through several places of a pixel, for light that is a layer.
        && (!has(Flag::LightBorders)
            || (has(Flag::Rays) && has(Flag::Layered) && (has(Flag::Emission) || has(Flag::Environment))))
        // The last extension only finds light.
        && (!has(Flag::Last) || has(Flag::Emission) || has(Flag::Environment))
}

/// True if a pass follows mirrors and glass.
fn follows_mirrors(pass: &str) -> bool {
    [EYE_PATHS, LIGHT_PATHS, RESERVOIRS, CAUSTICS, "mis_sums", "draws"].contains(&pass)
}

/// Passes with code for caustics where mirrors are not followed.
const HAS_CAUSTICS: [&str; 2] = ["shared/camera/eye_vertices", "shared/film/accumulate"];

/// Passes that follow the guide of the sky.
const HAS_GUIDE: [&str; 5] = ["shared/light/light_point", "shared/light/light_subpath", CONNECT, EXTEND, "sky_draws"];

/// Passes that have the sky's map with its guide alone.
const SEES_A_GUIDED_SKY: [&str; 2] = ["shared/light/light_subpath", CONNECT];

/// Passes that write lists.
const WRITES_LISTS: [&str; 2] = ["shared/views/view_setup", "shared/views/view_lists"];

/// Passes that query views around light vertices, which may be infinite.
const QUERIES_LIGHTS: [&str; 4] = [CONNECT, LIGHT_CANDIDATES, LIGHT_RESERVOIRS, "queries"];

/// Returns all sensible subsets.
fn sets(pass: &str, flags: &BTreeSet<Flag>) -> Vec<Vec<Flag>> {
    // These flags are reached by imports alone, so that no set with them is sensible. SPECULAR comes with
    // GLOSSY.
    let mirrors = follows_mirrors(pass);
    assert!(!mirrors || flags.contains(&Flag::Specular), "{pass}");
    let all_flags = flags;
    let flags: Vec<_> = flags
        .iter()
        .copied()
        .filter(|f| *f != Flag::Specular && (mirrors || *f != Flag::Transmission))
        .filter(|f| pass == LIST_LENGTHS || *f != Flag::Walked)
        .filter(|f| WRITES_LISTS.contains(&pass) || *f != Flag::PerTexel)
        .filter(|f| HAS_CAUSTICS.contains(&pass) || *f != Flag::Caustics)
        .filter(|f| {
            ![Flag::SkyGuide, Flag::Swizzled, Flag::Roulette, Flag::TexelTables, Flag::SpecularBounces].contains(f)
        })
        .filter(|f| !SEES_A_GUIDED_SKY.contains(&pass) || *f != Flag::EnvironmentMap)
        .filter(|f| !TRACERS.contains(f) && !like_layers().any(|layer| layer == *f))
        .filter(|f| *f != Flag::Projected && (QUERIES_LIGHTS.contains(&pass) || *f != Flag::Infinite))
        .collect();
    let layers: Vec<_> = like_layers().filter(|layer| all_flags.contains(layer)).collect();
    assert!(flags.len() <= 14, "too many sets of {flags:?}: `sensible` has to exclude some");
    let mut sets: Vec<Vec<Flag>> = (0..1_u32 << flags.len())
        .map(|bits| (0..flags.len()).filter(|i| bits >> i & 1 == 1).map(|i| flags[i]).collect::<Vec<_>>())
        .map(|mut set| {
            set.extend(set.contains(&Flag::Glossy).then_some(Flag::Specular).filter(|_| mirrors));
            let along = [EXTEND, LIST_LENGTHS, "queries"].contains(&pass) && !set.contains(&Flag::Rays);
            set.extend(along.then_some(Flag::Projected));
            // The order of threads changes nothing else, so that half of the sets have each.
            let swizzled = pass == EXTEND && set.contains(&Flag::Rays);
            set.extend(swizzled.then_some(Flag::Swizzled));
            set
        })
        .filter(|set| sensible(pass, set))
        .flat_map(|set| {
            let tracers: &[Flag] = if traces_rays(pass, &set) { &TRACERS } else { &[] };
            let traced = |tracer| [set.as_slice(), &[tracer]].concat();
            let others: Vec<_> = tracers.iter().copied().map(traced).collect();
            std::iter::once(set).chain(others)
        })
        .flat_map(|set| {
            // Surfaces with layers are glossy. They have one of the layers or all.
            let glossy = set.contains(&Flag::Glossy) && !layers.is_empty();
            let all = glossy.then(|| [&set, layers.as_slice()].concat());
            let single = if glossy && layers.len() > 1 { layers.as_slice() } else { &[] };
            let one: Vec<_> = single.iter().map(|&layer| [&set, &[layer][..]].concat()).collect();
            // Mixes may be of diffuse materials alone.
            let diffuse = !set.contains(&Flag::Glossy) && all_flags.contains(&Flag::Mixes);
            let mixed = diffuse.then(|| [&set, &[Flag::Mixes][..]].concat());
            std::iter::once(set).chain(all).chain(one).chain(mixed)
        })
        .flat_map(|set| {
            // Rays test what the sky lights where it has a guide.
            let rays = set.contains(&Flag::Rays) || ["shared/light/light_point", "sky_draws"].contains(&pass);
            let from_sky = if pass == CONNECT { set.contains(&Flag::Light) } else { set.contains(&Flag::Environment) };
            let guided = HAS_GUIDE.contains(&pass) && rays && from_sky;
            let guided = guided.then(|| [&set, &[Flag::SkyGuide][..]].concat());
            let mapped = guided.as_ref().filter(|_| SEES_A_GUIDED_SKY.contains(&pass));
            let mapped = mapped.map(|set| [set, &[Flag::EnvironmentMap][..]].concat());
            std::iter::once(set).chain(mapped).chain(guided)
        })
        // Vertices have tangents with textures.
        .filter(|set| !set.contains(&Flag::Anisotropy) || set.contains(&Flag::Textures))
        .collect();
    // The last extension counts no vertices.
    if all_flags.contains(&Flag::SpecularBounces) {
        let counting = |set: &&Vec<Flag>| set.contains(&Flag::Specular) && !set.contains(&Flag::Last);
        let few = covering(&sets.iter().filter(counting).cloned().collect::<Vec<_>>(), 2);
        sets.extend(few.into_iter().map(|set| [set.as_slice(), &[Flag::SpecularBounces]].concat()));
    }
    // Interleaved pictures have layers, but not all that have layers are interleaved.
    if all_flags.contains(&Flag::Roulette) {
        let layered = |set: &&Vec<Flag>| set.contains(&Flag::Layered);
        let few = covering(&sets.iter().filter(layered).cloned().collect::<Vec<_>>(), 2);
        sets.extend(few.into_iter().map(|set| [set.as_slice(), &[Flag::Roulette]].concat()));
    }
    // What rows of tables are read from changes nothing else, so that few sets with every flag have texels.
    if all_flags.contains(&Flag::TexelTables) {
        let few = covering(&sets, 1);
        sets.extend(few.into_iter().map(|set| [set.as_slice(), &[Flag::TexelTables]].concat()));
    }
    sets
}

/// Returns the flags that are tested as those of layers are.
fn like_layers() -> impl Iterator<Item = Flag> {
    Flag::LAYERS.into_iter().chain([
        Flag::Conductors,
        Flag::Plastics,
        Flag::RoughPlastic,
        Flag::Beckmann,
        Flag::Mixes,
        Flag::Disperses,
    ])
}

/// Calls a function with the states of each `strength` flags of the first `flags` ones, after those of a prefix that has a
/// number already: a number for the states of all but the last, and the last ones that are on and off. Each bit of a set is a
/// flag of `all`.
fn each_state(
    set: u64,
    all: usize,
    flags: usize,
    strength: u32,
    prefix: usize,
    call: &mut impl FnMut(usize, [u64; 2]),
) {
    if strength == 1 {
        let first = (1 << flags) - 1;
        return call(prefix, [set & first, !set & first]);
    }
    for n in 0..flags {
        let state = (prefix * all + n) << 1 | (set >> n & 1) as usize;
        each_state(set, all, n, strength - 1, state, call);
    }
}

/// Returns few of some sets that have each `strength` flags in all the states that the sets have them in (a covering
/// array): the set that adds most states is taken until none adds any.
fn covering(sets: &[Vec<Flag>], strength: u32) -> Vec<Vec<Flag>> {
    let flags: Vec<Flag> = sets.iter().flatten().copied().collect::<BTreeSet<_>>().into_iter().collect();
    // There are always as many flags as are chosen; those that are not there are off.
    let count = flags.len().max(strength as usize);
    assert!(count < 64);
    let bits = |set: &Vec<Flag>| (0..flags.len()).filter(|&n| set.contains(&flags[n])).fold(0, |all, n| all | 1 << n);
    let bits: Vec<u64> = sets.iter().map(bits).collect();
    let mut covered = vec![[0_u64; 2]; (2 * count).pow(strength - 1)];
    // What a set adds becomes less with each that is taken: one that adds most by an old count is counted anew.
    let mut queue: BinaryHeap<(u32, Reverse<usize>)> = (0..sets.len()).map(|n| (u32::MAX, Reverse(n))).collect();
    let mut taken = Vec::new();
    while let Some((before, Reverse(n))) = queue.pop() {
        let mut adds = 0;
        each_state(bits[n], count, count, strength, 0, &mut |state, [on, off]| {
            let [on_before, off_before] = covered[state];
            adds += (on & !on_before).count_ones() + (off & !off_before).count_ones();
        });
        if adds == before {
            each_state(bits[n], count, count, strength, 0, &mut |state, [on, off]| {
                let [on_before, off_before] = covered[state];
                covered[state] = [on_before | on, off_before | off];
            });
            taken.push(sets[n].clone());
        } else if adds > 0 {
            queue.push((adds, Reverse(n)));
        }
    }
    taken
}

/// Every run of the tests has each three flags in all their states: a condition names two flags at most, and code under it
/// may need code under another. Few pairs of conditions name four.
const STRENGTH: u32 = 3;

/// Flags of algorithms that trace rays in place of ray queries; each set with rays occurs with each of them.
const TRACERS: [Flag; 2] = [Flag::Grid, Flag::Bvh];

/// Parses and validates WGSL with the capabilities that every adapter has.
fn validate(wgsl: &str) -> Result<naga::Module, String> {
    validate_with(wgsl, naga::valid::Capabilities::default()).map(|(module, _)| module)
}

fn validate_with(
    wgsl: &str,
    capabilities: naga::valid::Capabilities,
) -> Result<(naga::Module, naga::valid::ModuleInfo), String> {
    let module = naga::front::wgsl::parse_str(wgsl).map_err(|e| e.emit_to_string(wgsl))?;
    let info = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), capabilities)
        .validate(&module)
        .map_err(|e| e.emit_to_string(wgsl))?;
    Ok((module, info))
}

/// True if a pass uses ray queries.
fn queries_rays(pass: &str, set: &[Flag]) -> bool {
    traces_rays(pass, set) && !set.iter().any(|flag| TRACERS.contains(flag))
}

/// True if a pass traces rays.
fn traces_rays(pass: &str, set: &[Flag]) -> bool {
    [
        "ray_queries",
        "mis_sums",
        EYE_PATHS,
        LIGHT_PATHS,
        RESERVOIRS,
        CAUSTICS,
        "shared/light/sky_guide",
        "shared/camera/seen_light",
    ]
    .contains(&pass)
        || set.contains(&Flag::Rays)
}

/// Returns the modules with an entry point.
fn passes() -> Vec<&'static str> {
    let tests: [&'static str; shaders::ALL.len()] = shaders::ALL.map(|module| match module {
        Source::Embedded(name) | Source::Text(name, _) => name,
    });
    let all = module_names().chain(tests);
    all.filter(|name| ["@compute", "@vertex", "@fragment"].iter().any(|e| text(name).contains(e))).collect()
}

#[test]
fn every_pass_links_and_validates_with_every_three_flags() {
    link_and_validate(STRENGTH);
}

#[test]
#[ignore = "the test above has each three flags in all states; each four take minutes"]
fn every_pass_links_and_validates_with_every_four_flags() {
    link_and_validate(STRENGTH + 1);
}

#[test]
fn few_sets_have_all_states_of_three_flags() {
    let flags = &Flag::ALL[..9];
    let set = |bits: usize| flags.iter().enumerate().filter(|(n, _)| bits >> n & 1 == 1).map(|(_, &f)| f).collect();
    let all: Vec<Vec<Flag>> = (0..512).map(set).filter(|set: &Vec<Flag>| !set.ends_with(&flags[7..])).collect();
    let few = covering(&all, 3);
    assert!((8..=30).contains(&few.len()), "{} sets", few.len());
    let states = |sets: &[Vec<Flag>]| {
        let mut found = BTreeSet::new();
        for set in sets {
            for (a, &one) in flags.iter().enumerate() {
                for (b, &two) in flags[..a].iter().enumerate() {
                    found.extend(flags[..b].iter().map(|&f| [one, two, f].map(|f| (f, set.contains(&f)))));
                }
            }
        }
        found
    };
    assert_eq!(states(&few), states(&all));
    assert_ne!(states(&few[1..]), states(&all), "a set that adds nothing was taken");
}

/// A pass and the flags that it is linked with.
type Case = (&'static str, Vec<Flag>);

/// Returns sensible sets of passes that have each `strength` flags in all states.
fn cases(passes: &[&'static str], strength: u32) -> Vec<Case> {
    let of_pass =
        |&pass: &&'static str| covering(&sets(pass, &flags_of(pass)), strength).into_iter().map(move |set| (pass, set));
    let cases: Vec<_> = passes.par_iter().flat_map_iter(of_pass).collect();
    assert!(cases.len() > 100, "only {} cases", cases.len());
    cases
}

/// Links all cases.
fn link_all(cases: &[Case]) -> Vec<String> {
    let linked =
        |(pass, set): &Case| link_any(pass, set).unwrap_or_else(|e| panic!("{pass} with {set:?} does not link: {e}"));
    cases.par_iter().map(linked).collect()
}

fn link_and_validate(strength: u32) {
    let passes = passes();
    assert!(passes.len() >= 30 && shaders::ALL.iter().all(|m| passes.contains(&m.name())), "{passes:?}");
    let cases = cases(&passes, strength);

    // Sets that link to the same text are validated once.
    let linked = link_all(&cases);
    let distinct: BTreeMap<&String, &(&str, Vec<Flag>)> = linked.iter().zip(&cases).collect();
    let distinct: Vec<_> = distinct.into_iter().collect();
    let validated = distinct.par_iter().map(|(wgsl, (pass, set))| {
        // A pass without ray queries needs no capability; one with them is refused without the capability.
        let traces = queries_rays(pass, set);
        let ray_query = naga::valid::Capabilities::RAY_QUERY;
        let capabilities = naga::valid::Capabilities::default() | if traces { ray_query } else { Default::default() };
        let (module, info) = validate_with(wgsl, capabilities).unwrap_or_else(|e| panic!("{pass} with {set:?}: {e}"));
        assert!(!module.entry_points.is_empty(), "{pass} with {set:?} has no entry point");
        assert!(!traces || validate(wgsl).is_err(), "{pass} with {set:?} traces no rays");
        let (counts, names) = bound(&module, &info);
        (*pass, traces, (counts, names, set.as_slice()))
    });
    let validated: Vec<_> = validated.collect();
    assert!(validated.iter().filter(|(_, traces, _)| *traces).count() > 2);
    let raster = validated.into_iter().filter(|(pass, traces, _)| !traces && shaders::find(pass).is_none());
    check_limits(raster.map(|(pass, _, bound)| (pass, bound)));
    println!("{} sets of flags over {} passes, {} distinct shaders", cases.len(), passes.len(), distinct.len());

    // Every flag that a shader names is in some set, and changes the text of some pass.
    let everywhere: BTreeSet<Flag> = module_names().chain(passes.iter().copied()).flat_map(flags_in).collect();
    let covered: BTreeSet<Flag> = cases.iter().flat_map(|(_, set)| set.iter().copied()).collect();
    assert_eq!(everywhere, covered);
    assert_eq!(everywhere, Flag::ALL.iter().copied().collect(), "no shader names some flag");
    for flag in &everywhere {
        let matters = cases.iter().zip(&linked).any(|((pass, set), text)| {
            set.contains(flag) && {
                let without: Vec<Flag> = set.iter().copied().filter(|f| f != flag).collect();
                link_any(pass, &without).is_ok_and(|other| other != *text)
            }
        });
        assert!(matters, "{} changes no shader", flag_names(&[*flag]));
    }
}

/// A page that has the browser compile `shader_0.wgsl` to `shader_COUNT.wgsl` and posts what it says against them.
const COMPILING: &str = r#"<!doctype html>
<script type="module">
  const post = (body, headers) => fetch("/done", { method: "POST", headers, body });
  try {
    const adapter = await navigator.gpu.requestAdapter();
    const device = await adapter.requestDevice();
    const compiled = async n => {
      const code = await (await fetch(`shader_${n}.wgsl`)).text();
      const { messages } = await device.createShaderModule({ code }).getCompilationInfo();
      return messages.filter(m => m.type === "error").map(m => [n, `line ${m.lineNum}: ${m.message}`]);
    };
    const wrong = [];
    for (let n = 0; n < COUNT; n++) wrong.push(...await compiled(n));
    await post(JSON.stringify(wrong));
  } catch (error) {
    await post(String(error), { "X-Error": "1" });
  }
</script>
"#;

/// Shaders that a page compiles. Each takes the browser some hundredths of a second.
const OF_A_PAGE: usize = 400;

/// What browsers compile with is another compiler than naga: Tint in those that come from Chromium. A share of
/// each pass' sets is compiled, and the first.
#[test]
fn shaders_compile_in_a_browser() {
    compile_in_a_browser(OF_A_PAGE);
}

#[test]
#[ignore = "the test above has a share of the sets; all take minutes"]
fn every_shader_compiles_in_a_browser() {
    compile_in_a_browser(usize::MAX);
}

fn compile_in_a_browser(about: usize) {
    let Some(browser) = Browser::find() else { return };
    let passes: Vec<_> = passes().into_iter().filter(|pass| shaders::find(pass).is_none()).collect();
    let cases: Vec<_> = cases(&passes, STRENGTH).into_iter().filter(|(pass, set)| !queries_rays(pass, set)).collect();
    let step = cases.len().div_ceil(about) | 1;
    let kept = |at: usize| at.is_multiple_of(step) || cases[at - 1].0 != cases[at].0;
    let cases: Vec<_> = cases.iter().enumerate().filter(|(at, _)| kept(*at)).map(|(_, case)| case.clone()).collect();
    let linked: Vec<_> = link_all(&cases).into_iter().zip(cases).collect();
    let distinct: Vec<_> = BTreeMap::from_iter(linked).into_iter().collect();
    println!("{} shaders of {} passes", distinct.len(), passes.len());
    for page in distinct.chunks(OF_A_PAGE) {
        let planted = "fn f() -> u32 { return 1.5; }".to_owned();
        let texts = page.iter().map(|(text, _)| text).chain([&planted]);
        let shader = |(n, text): (usize, &String)| (format!("shader_{n}.wgsl"), text.clone().into_bytes());
        let mut site: Site = texts.enumerate().map(shader).collect();
        let compiling = COMPILING.replace("COUNT", &(page.len() + 1).to_string());
        site.insert("index.html".to_owned(), compiling.into_bytes());
        let wrong: Vec<(usize, String)> = serde_json::from_slice(&browser.visit(&site, "index.html", 1)[0]).unwrap();
        assert_eq!(wrong.iter().filter(|(n, _)| *n == page.len()).count(), 1, "it compiles everything: {wrong:?}");
        let wrong: Vec<_> = wrong.iter().filter_map(|(n, message)| Some((&page.get(*n)?.1, message))).collect();
        assert!(wrong.is_empty(), "{wrong:?}");
    }
}

/// WebGPU's limits of a stage (`maxStorageBuffersPerShaderStage` and so on) and of a pipeline.
const LIMITS: [(&str, usize); 5] =
    [("storage buffers", 8), ("uniform buffers", 12), ("sampled textures", 16), ("samplers", 16), ("bind groups", 4)];

/// Returns what the entry points of a module bind, each at most, in the order of [`LIMITS`], and the names of the
/// storage buffers.
fn bound(module: &naga::Module, info: &naga::valid::ModuleInfo) -> ([usize; 5], Vec<String>) {
    let mut most = [0; 5];
    let mut names = Vec::new();
    for entry in 0..module.entry_points.len() {
        let mut counts = [0; 5];
        let mut storage = Vec::new();
        for (handle, variable) in module.global_variables.iter() {
            let Some(binding) = variable.binding.filter(|_| !info.get_entry_point(entry)[handle].is_empty()) else {
                continue;
            };
            counts[4] = counts[4].max(binding.group as usize + 1);
            let kind = match (variable.space, &module.types[variable.ty].inner) {
                (naga::AddressSpace::Storage { .. }, _) => 0,
                (naga::AddressSpace::Uniform, _) => 1,
                (_, naga::TypeInner::Image { .. }) => 2,
                (_, naga::TypeInner::Sampler { .. }) => 3,
                _ => continue,
            };
            counts[kind] += 1;
            storage.extend(variable.name.clone().filter(|_| kind == 0));
        }
        if counts[0] >= most[0] {
            names = storage;
        }
        most = std::array::from_fn(|kind| most[kind].max(counts[kind]));
    }
    (most, names)
}

/// What a pass binds at most, of each kind, and its storage buffers where they are most, with their flags.
type Bound<'a> = ([usize; 5], Vec<String>, &'a [Flag]);

/// Fails if a pass of the raster methods binds more than WebGPU allows. Ray queries are no part of WebGPU.
fn check_limits<'a>(all: impl Iterator<Item = (&'a str, Bound<'a>)>) {
    let mut worst: BTreeMap<&str, Bound> = BTreeMap::new();
    for (pass, (counts, names, set)) in all {
        let of_pass = worst.entry(pass).or_insert_with(|| (counts, names.clone(), set));
        if counts[0] > of_pass.0[0] {
            (of_pass.1, of_pass.2) = (names, set);
        }
        of_pass.0 = std::array::from_fn(|kind| of_pass.0[kind].max(counts[kind]));
    }
    for (pass, (counts, names, set)) in &worst {
        println!("{pass}: {counts:?}: {} with {}", names.join(" "), flag_names(set));
    }
    assert!(worst.len() >= 25 && worst.values().any(|(counts, ..)| counts[0] == LIMITS[0].1), "{}", worst.len());
    for (kind, (what, limit)) in LIMITS.into_iter().enumerate() {
        let over: Vec<_> = worst.iter().filter(|(_, (counts, ..))| counts[kind] > limit).collect();
        assert!(over.is_empty(), "more than {limit} {what}: {over:?}");
    }
}

#[test]
fn bindings_are_counted() {
    // What a pass does not use is not counted.
    let count = |used: usize| {
        let declared: String =
            (0..9).map(|n| format!("@group(0) @binding({n}) var<storage, read> b{n}: array<u32>;\n")).collect();
        let read: String = (0..used).map(|n| format!("x += b{n}[0];")).collect();
        let wgsl = format!("{declared}@compute @workgroup_size(1) fn main() {{ var x = 0u; {read} }}");
        let (module, info) = validate_with(&wgsl, naga::valid::Capabilities::default()).unwrap();
        bound(&module, &info).0
    };
    assert_eq!([count(8), count(9)], [[8, 0, 0, 0, 1], [9, 0, 0, 0, 1]]);
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
    let good = link(CONNECT, &[]).unwrap();
    validate(&good).unwrap();
    let renamed = good.replace("sees(z.", "sees_nowhere(z.");
    assert_ne!(good, renamed);
    assert!(validate(&renamed).unwrap_err().contains("sees_nowhere"), "an unknown name must not parse");
    let mistyped = good.replacen("0.0", "vec2f(0.0)", 1);
    assert_ne!(good, mistyped);
    assert!(validate(&mistyped).is_err(), "a wrong type must not validate");
    assert!(link("no_such_pass", &[]).is_err(), "an unknown module must not link");
    let unknown = "import package::lib::scene::scene::NOT_THERE;
        @compute @workgroup_size(1) fn main() { let x = NOT_THERE; }";
    let linked = link_source(&Source::Text("planted", unknown), &[]).and_then(|wgsl| validate(&wgsl));
    assert!(linked.is_err(), "an unknown import must not link and validate");
    // A flag that does not occur in a module changes nothing.
    assert_eq!(good, link(CONNECT, &[Flag::Waves]).unwrap());
    // The readers of conditions and imports find all of them.
    assert_eq!(conditions_in("@if(!A) x @if(B && !C) y @else z"), ["A", "B", "C"].map(str::to_owned).into());
    assert_eq!(imports_in("@if(A) import package::lib::a::b;\nimport package::lib::c::{d, e};"), ["lib/a", "lib/c"]);
}
