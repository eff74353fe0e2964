//! Converts materials to the layout of shaders.

use crate::render::layouts;
use crate::render::layouts::bsdf_model;
use crate::render::layouts::index::NONE;
use crate::render::layouts::material_flags::{
    BECKMANN_FACETS, BLENDED, CLEAR_SHEET, CULLED, EMITS_TWO_SIDED, FRESNEL_NONE, MASKED, NONLINEAR, SHEET,
    SPECULAR_SURFACE, TRANSMITS, TWO_SIDED,
};
use crate::render::layouts::texture_purpose::{
    OF_ANISOTROPY, OF_BASE, OF_COAT, OF_COAT_NORMAL, OF_COAT_ROUGHNESS, OF_DIFFUSE_TRANSMISSION,
    OF_DIFFUSE_TRANSMISSION_COLOR, OF_EMISSION, OF_FILM, OF_FILM_THICKNESS, OF_METALLIC, OF_NORMAL, OF_OPACITY,
    OF_ROUGHNESS, OF_SHEEN, OF_SHEEN_ROUGHNESS, OF_SPECULAR, OF_SPECULAR_FACTOR, OF_TRANSMISSION,
};
use crate::render::upload::textures::Atlas;
use crate::scene::{Boundary, Bsdf, Distribution, Fresnel, Material, Opacity, Scene, Sides};

/// Returns the records of a material and of the layers on top of it, and adds its textures to the atlas. `parts` are
/// the places of the materials that it mixes.
pub(super) fn records(
    m: &Material,
    parts: Option<[usize; 2]>,
    scene: &Scene,
    atlas: &mut Atlas,
) -> (layouts::Material, layouts::Layers) {
    let (mut material, layers) = (material(m, scene, atlas), layers(m, scene, atlas));
    if let (Some(mix), Some(parts)) = (&m.mix, parts) {
        material.model = bsdf_model::MIX;
        material.metallic = atlas.scalar(scene, &mix.weight, OF_METALLIC).0;
        material.parts = parts.map(|part| part as u32);
    }
    [material.first_use, material.end_use] = atlas.end_material();
    (material, layers)
}

/// Returns the record of a material, and adds its textures to the atlas.
fn material(m: &Material, scene: &Scene, atlas: &mut Atlas) -> layouts::Material {
    let mut out = layouts::Material {
        specular: [1.0; 3],
        eta: [1.5; 3],
        specular_factor: 1.0,
        emission_texture: NONE,
        mask_texture: NONE,
        ..Default::default()
    };
    write_bsdf(&mut out, &m.bsdf, scene, atlas);
    if let Some(iors) = m.iors() {
        out.k = iors;
    }
    if m.distribution == Distribution::Beckmann {
        out.flags |= BECKMANN_FACETS;
    }
    if m.is_glossy() && out.model == bsdf_model::DIFFUSE {
        // A diffuse surface under layers is a dielectric without reflection.
        (out.model, out.roughness, out.specular_factor) = (bsdf_model::METALLIC_ROUGHNESS, 1.0, 0.0);
    }
    if let Some(emission) = &m.emission {
        (out.emission, out.emission_texture) = atlas.color(scene, &emission.radiance, OF_EMISSION);
        if emission.two_sided {
            out.flags |= EMITS_TWO_SIDED;
        }
    }
    if let Some(normal_map) = &m.normal_map {
        atlas.normals(scene, normal_map, OF_NORMAL);
    }
    if m.is_specular() {
        out.flags |= SPECULAR_SURFACE;
    }
    if m.is_clear_sheet() {
        out.flags |= MASKED | CLEAR_SHEET;
        out.mask_value = 1.0;
    }
    if let Some(opacity) = &m.opacity {
        (out.mask_value, out.mask_texture) = atlas.scalar(scene, opacity.value(), OF_OPACITY);
        match opacity {
            Opacity::CutOut { cutoff, .. } => {
                out.flags |= MASKED;
                out.mask_cutoff = *cutoff;
            }
            Opacity::Blended { .. } => out.flags |= MASKED | BLENDED,
        }
    }
    if m.transmits() {
        out.flags |= TRANSMITS;
        match m.boundary {
            Boundary::Sheet => out.flags |= SHEET,
            Boundary::Volume { absorption } => out.absorption = absorption.to_array(),
        }
    }
    out.flags |= match m.sides {
        // Transmissive surfaces have two sides.
        _ if m.transmits() => TWO_SIDED,
        Sides::Two => TWO_SIDED,
        Sides::One => 0,
        Sides::OneCulled => CULLED,
    };
    out
}

/// Returns the record of the layers on top of a material, and adds their textures to the atlas.
fn layers(m: &Material, scene: &Scene, atlas: &mut Atlas) -> layouts::Layers {
    let mut out = layouts::Layers::default();
    if let Some(passing) = &m.diffuse_transmission {
        out.diffuse_transmission = atlas.scalar(scene, &passing.share, OF_DIFFUSE_TRANSMISSION).0;
        out.diffuse_transmission_color = atlas.color(scene, &passing.color, OF_DIFFUSE_TRANSMISSION_COLOR).0;
    }
    if let Some(film) = &m.film {
        out.film = atlas.scalar(scene, &film.strength, OF_FILM).0;
        (out.film_ior, out.film_thickness) = (film.ior, film.thickness);
        if let Some((texture, channel)) = &film.thickness_texture {
            atlas.add(scene, texture, OF_FILM_THICKNESS, *channel);
        }
    }
    if let Some(anisotropy) = &m.anisotropy {
        out.anisotropy = anisotropy.strength;
        out.anisotropy_direction = [anisotropy.rotation.cos(), anisotropy.rotation.sin()];
        if let Some(texture) = &anisotropy.texture {
            atlas.add(scene, texture, OF_ANISOTROPY, 0);
        }
    }
    out.flatness = -1.0;
    if let Some(disney) = &m.disney {
        out.disney_sheen = atlas.scalar(scene, &disney.sheen, OF_SHEEN_ROUGHNESS).0;
        (out.disney_sheen_tint, out.flatness) = (disney.sheen_tint, disney.flatness);
    }
    if let Some(sheen) = &m.sheen {
        out.sheen = atlas.color(scene, &sheen.color, OF_SHEEN).0;
        out.sheen_roughness = atlas.scalar(scene, &sheen.roughness, OF_SHEEN_ROUGHNESS).0;
    }
    if let Some(coat) = &m.coat {
        out.coat = atlas.scalar(scene, &coat.weight, OF_COAT).0;
        out.coat_roughness = atlas.scalar(scene, &coat.roughness, OF_COAT_ROUGHNESS).0;
        if let Some(normal_map) = &coat.normal_map {
            atlas.normals(scene, normal_map, OF_COAT_NORMAL);
        }
    }
    out
}

/// Writes the BSDF's model and parameters.
fn write_bsdf(out: &mut layouts::Material, bsdf: &Bsdf, scene: &Scene, atlas: &mut Atlas) {
    match bsdf {
        Bsdf::Diffuse { reflectance } => out.base = atlas.color(scene, reflectance, OF_BASE).0,
        Bsdf::MetallicRoughness { base_color, metallic, roughness, ior, specular, specular_color, transmission } => {
            out.model = bsdf_model::METALLIC_ROUGHNESS;
            out.base = atlas.color(scene, base_color, OF_BASE).0;
            out.metallic = atlas.scalar(scene, metallic, OF_METALLIC).0;
            out.roughness = atlas.scalar(scene, roughness, OF_ROUGHNESS).0;
            out.specular_factor = atlas.scalar(scene, specular, OF_SPECULAR_FACTOR).0;
            out.specular = atlas.color(scene, specular_color, OF_SPECULAR).0;
            out.eta = [*ior; 3];
            out.transmission = atlas.scalar(scene, transmission, OF_TRANSMISSION).0;
        }
        Bsdf::Conductor { alpha, fresnel, specular } => {
            out.model = bsdf_model::CONDUCTOR;
            out.roughness = atlas.scalar(scene, alpha, OF_ROUGHNESS).0;
            out.specular = atlas.color(scene, specular, OF_SPECULAR).0;
            match fresnel {
                Fresnel::None => out.flags |= FRESNEL_NONE,
                Fresnel::Conductor { eta, k } => (out.eta, out.k) = (eta.to_array(), k.to_array()),
            }
        }
        Bsdf::Plastic { alpha, diffuse, specular, eta, nonlinear } => {
            out.model = bsdf_model::PLASTIC;
            out.roughness = atlas.scalar(scene, alpha, OF_ROUGHNESS).0;
            out.base = atlas.color(scene, diffuse, OF_BASE).0;
            out.specular = atlas.color(scene, specular, OF_SPECULAR).0;
            out.eta = [*eta; 3];
            if *nonlinear {
                out.flags |= NONLINEAR;
            }
        }
        Bsdf::Dielectric { alpha, eta, reflection, transmission } => {
            out.model = bsdf_model::DIELECTRIC;
            out.roughness = atlas.scalar(scene, alpha, OF_ROUGHNESS).0;
            out.base = atlas.color(scene, reflection, OF_BASE).0;
            out.specular = atlas.color(scene, transmission, OF_SPECULAR).0;
            out.eta = [*eta; 3];
        }
    }
}
