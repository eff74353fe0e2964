//! The flags of shaders that follow from the scene alone, for every method.

use crate::gpu::Flag;
use crate::scene::SceneStats;

/// Returns the flags of shaders that read surfaces.
pub(super) fn surface_flags(stats: &SceneStats) -> Vec<Flag> {
    chosen([
        // Vertices have tangents with textures.
        (Flag::Textures, stats.texels > 0 || stats.anisotropic),
        (Flag::VertexColors, stats.vertex_colors),
        (Flag::Glossy, stats.glossy_triangles > 0),
        (Flag::Masks, stats.masked_triangles > 0),
        (Flag::Film, stats.films),
        (Flag::Anisotropy, stats.anisotropic),
        (Flag::Disney, stats.disney),
        (Flag::Sheen, stats.sheens),
        (Flag::Coat, stats.coats),
        (Flag::Conductors, stats.conductors),
        (Flag::Plastics, stats.plastics),
        (Flag::RoughPlastic, stats.rough_plastic),
        (Flag::Beckmann, stats.beckmann),
        (Flag::Mixes, stats.mixes),
    ])
}

/// Returns the flags of shaders that sample or hit lights.
pub(super) fn light_flags(stats: &SceneStats) -> Vec<Flag> {
    chosen([
        (Flag::Punctual, stats.lights > 0),
        (Flag::Patterns, stats.patterns),
        (Flag::Emission, stats.emissive_triangles > 0),
        (Flag::Environment, stats.environment),
        (Flag::EnvironmentMap, stats.environment_map),
    ])
}

/// Returns the flags that are on.
pub(super) fn chosen<const N: usize>(flags: [(Flag, bool); N]) -> Vec<Flag> {
    flags.into_iter().filter(|(_, on)| *on).map(|(flag, _)| flag).collect()
}
