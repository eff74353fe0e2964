//! Structs that shaders read have the same names, offsets and sizes in Rust. Needs no GPU.

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use common::shaders::{self, Described};
use lightsheaf::gpu::{Flag, Source, link_source};
use lightsheaf::render::layouts;

/// Fields of which the host knows only place and size: name of the struct and of the field.
const OPAQUE: &[(&str, &str)] = &[("LightVertex", "bsdf")];

/// Structs of the library's shaders and of the tests' own.
fn all() -> Vec<Described> {
    [layouts::all(), shaders::structs()].concat()
}

fn parse(shader: &str, flags: &[Flag]) -> naga::Module {
    let module = shaders::find(shader).unwrap_or(Source::Embedded(shader));
    let source = link_source(&module, flags).unwrap();
    naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{shader}: {}", e.emit_to_string(&source)))
}

/// Returns the differences between a struct here and in a shader.
fn differences(described: &Described, module: &naga::Module) -> Vec<String> {
    let (name, _, size, fields) = described;
    let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
    let Some((handle, ty)) = found else { return vec![format!("{name}: not in the shader")] };
    let naga::TypeInner::Struct { members, span } = &ty.inner else { return vec![format!("{name}: no struct")] };
    let mut out = Vec::new();
    // WGSL rounds the size of an array's element up to its alignment, and so must the host.
    let mut layouter = naga::proc::Layouter::default();
    layouter.update(module.to_ctx()).unwrap();
    let stride = layouter[handle].to_stride() as usize;
    if *size != stride || *span as usize != stride {
        out.push(format!("{name}: {size} bytes here, {span} in the shader, {stride} in an array"));
    }
    let theirs: Vec<(&str, usize)> =
        members.iter().map(|m| (m.name.as_deref().unwrap_or_default(), m.offset as usize)).collect();
    if theirs != *fields {
        out.push(format!("{name}: fields are {fields:?} here and {theirs:?} in the shader"));
    }
    // A field ends where the next one begins; padding between them has to be declared.
    let ends = fields.iter().skip(1).map(|f| f.1).chain([*size]);
    for (member, end) in members.iter().zip(ends) {
        let field = member.name.as_deref().unwrap_or_default();
        let bytes = layouter[member.ty].size as usize;
        if member.offset as usize + bytes != end && !OPAQUE.contains(&(name, field)) {
            out.push(format!("{name}.{field}: {bytes} bytes at {}, but the next field is at {end}", member.offset));
        }
    }
    out
}

#[test]
fn structs_agree_with_the_shaders() {
    let all = all();
    assert!(all.len() >= 40, "{}", all.len());
    let mut modules = BTreeMap::new();
    for described in &all {
        let module = modules.entry(described.1).or_insert_with(|| {
            let flags =
                [Flag::Textures, Flag::Glossy, Flag::Masks, Flag::LightTree, Flag::Skins, Flag::Morphs, Flag::Waves];
            // The pass links only with reuse.
            let own: &[Flag] = match described.1 {
                "shared/light/light_reservoirs" => &[Flag::Choose, Flag::Reuse],
                "subpaths/eye_paths" => &Flag::LAYERS,
                _ => &[],
            };
            parse(described.1, &[&flags, own].concat())
        });
        assert!(!described.3.is_empty());
        let differences = differences(described, module);
        assert!(differences.is_empty(), "{differences:#?}");
    }
}

/// Structs with conditional fields have the sizes that the host computes for them.
#[test]
fn sizes_follow_the_flags() {
    let optional = [&[Flag::Glossy, Flag::Specular, Flag::Transmission][..], &Flag::LAYERS].concat();
    for on in 0..=optional.len() {
        let flags = [&[Flag::Rays, Flag::Bvh, Flag::Textures], &optional[..on]].concat();
        let module = parse("shared/paths/connect", &flags);
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let size = |name: &str| {
            let (handle, _) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
            u64::from(layouter[handle].to_stride())
        };
        assert_eq!(size("Shading"), layouts::Shading::bytes(&flags), "Shading with {flags:?}");
        let transmits = flags.contains(&Flag::Transmission);
        let vertex = layouts::EyeVertex::bytes(false, transmits, false) + layouts::Shading::bytes(&flags);
        assert_eq!(size("SurfaceVertex"), vertex, "SurfaceVertex with {flags:?}");
        assert_eq!(size("LightVertex"), layouts::LightVertex::bytes(&flags) as u64, "LightVertex with {flags:?}");
    }
}

/// Every array in a buffer steps by a multiple of 16 bytes or by its element's size, so that `cast_slice` may
/// fill it.
#[test]
fn arrays_in_buffers_are_dense() {
    let sizes: BTreeMap<&str, usize> = all().iter().map(|d| (d.0, d.2)).collect();
    let mut seen = Vec::new();
    for shader in [
        "shared/paths/connect",
        "shared/paths/extend",
        "shared/camera/eye_vertices",
        "shared/light/light_subpath",
        "shared/film/accumulate",
        "shared/views/view_setup",
        "queries",
    ] {
        let module = parse(shader, &[Flag::Textures, Flag::Glossy, Flag::Masks, Flag::Emission, Flag::Environment]);
        for (_, variable) in module.global_variables.iter() {
            let naga::TypeInner::Array { base, stride, .. } = module.types[variable.ty].inner else { continue };
            let Some(name) = &module.types[base].name else { continue };
            if let Some(&size) = sizes.get(name.as_str()) {
                assert_eq!(stride as usize, size, "{shader}: array<{name}>");
                seen.push(name.clone());
            }
        }
    }
    for name in ["Attributes", "LightVertex", "ListRequest", "Query"] {
        assert!(seen.iter().any(|s| s == name), "no buffer holds an array of {name}");
    }
}

/// Returns the value of `const NAME = VALUE;` in a shader file, if it is a whole number.
fn constant(text: &str, name: &str) -> Option<u32> {
    let (_, rest) = text.split_once(&format!("const {name} = "))?;
    let value = rest.split(';').next()?.trim().strip_suffix('u')?;
    match value.strip_prefix("0x") {
        Some(hexadecimal) => u32::from_str_radix(hexadecimal, 16).ok(),
        None => value.parse().ok(),
    }
}

#[test]
fn constants_agree_with_the_shaders() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let constants = layouts::constants();
    assert!(constants.len() >= 20, "{}", constants.len());
    for (file, name, value) in constants {
        let text = std::fs::read_to_string(root.join(file).with_extension("wesl")).unwrap();
        assert_eq!(constant(&text, name), Some(value), "{name} of {file}");
    }
    assert_eq!(constant("const A = 1u;\n@if(X) const B = 0xffu;", "B"), Some(255));
    assert_eq!(constant("const A = 1u;", "B"), None, "a missing constant is found");
}

#[test]
fn planted_mismatches_are_found() {
    let all = all();
    let module = parse("shared/paths/connect", &[Flag::Textures, Flag::Glossy, Flag::Masks]);
    let material = all.iter().find(|d| d.0 == "Material").unwrap();
    assert_eq!(differences(material, &module), Vec::<String>::new());
    let planted = |change: fn(&mut Described)| {
        let mut copy = material.clone();
        change(&mut copy);
        assert_ne!(copy, *material);
        assert!(!differences(&copy, &module).is_empty(), "{copy:?}");
    };
    planted(|d| d.2 += 16);
    planted(|d| d.3[3].1 += 4);
    planted(|d| d.3[3].0 = "flag");
    planted(|d| d.3.swap(1, 2));
    planted(|d| d.3.truncate(5));
    planted(|d| d.0 = "Materiel");
    let vertex = all.iter().find(|d| d.0 == "LightVertex").unwrap();
    let mut copy = vertex.clone();
    copy.3.last_mut().unwrap().1 += 4;
    assert!(!differences(&copy, &module).is_empty());
}
