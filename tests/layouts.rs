//! Structs that shaders read have the same names, offsets and sizes in Rust. Needs no GPU.

use std::collections::BTreeMap;

use lightsheaf::gpu::link;
use lightsheaf::layouts;
use wgpu::naga;

type Described = (&'static str, &'static str, usize, Vec<(&'static str, usize)>);

/// Fields that the host knows only by place and size: name of the struct and of the field.
const OPAQUE: &[(&str, &str)] = &[("LightVertex", "bsdf")];

fn parse(shader: &str, flags: &[&str]) -> naga::Module {
    let source = link(shader, flags).unwrap();
    naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{shader}: {}", e.emit_to_string(&source)))
}

/// What differs between a struct here and in a shader.
fn differences(described: &Described, module: &naga::Module) -> Vec<String> {
    let (name, _, size, fields) = described;
    let found = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name));
    let Some((handle, ty)) = found else { return vec![format!("{name}: not in the shader")] };
    let naga::TypeInner::Struct { members, span } = &ty.inner else { return vec![format!("{name}: no struct")] };
    let mut out = Vec::new();
    // The size of an element: WGSL rounds it up to the alignment, and so must the host.
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
    // A field ends where the next one begins, at the latest; what is left between them must be declared padding.
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
    let all = layouts::all();
    assert!(all.len() >= 11, "{}", all.len());
    let mut modules = BTreeMap::new();
    for described in &all {
        let module = modules.entry(described.1).or_insert_with(|| {
            let flags = ["TEXTURES", "GLOSSY", "MASKS", "LIGHT_TREE", "SKINS", "MORPHS", "WAVES"];
            // What looks back is nowhere without.
            let reuse: &[&str] = if described.1 == "light_reuse" { &["CHOOSE", "REUSE"] } else { &[] };
            parse(described.1, &[&flags, reuse].concat())
        });
        assert!(!described.3.is_empty());
        let differences = differences(described, module);
        assert!(differences.is_empty(), "{differences:#?}");
    }
}

/// Every array in a buffer steps by a multiple of 16 bytes or by its element's size, so that `cast_slice` may fill it.
#[test]
fn arrays_in_buffers_are_dense() {
    let sizes: BTreeMap<&str, usize> = layouts::all().iter().map(|d| (d.0, d.2)).collect();
    let mut seen = Vec::new();
    for shader in ["connect", "extend", "eye_vertices", "light_subpath", "accumulate", "queries", "view_setup"] {
        let module = parse(shader, &["TEXTURES", "GLOSSY", "MASKS", "EMISSION", "ENVIRONMENT"]);
        for (_, variable) in module.global_variables.iter() {
            let naga::TypeInner::Array { base, stride, .. } = module.types[variable.ty].inner else { continue };
            let Some(name) = &module.types[base].name else { continue };
            if let Some(&size) = sizes.get(name.as_str()) {
                assert_eq!(stride as usize, size, "{shader}: array<{name}>");
                seen.push(name.clone());
            }
        }
    }
    for name in ["Attributes", "Triangle", "Material", "TextureUse", "LightVertex", "EyeVertex", "Demand", "Query"] {
        assert!(seen.iter().any(|s| s == name), "no array of {name} was met");
    }
}

#[test]
fn planted_mismatches_are_found() {
    let all = layouts::all();
    let module = parse("connect", &["TEXTURES", "GLOSSY", "MASKS"]);
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
