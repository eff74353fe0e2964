//! Converts materials to the layout of shaders.

use crate::render::layouts;
use crate::render::layouts::bsdf_model;
use crate::render::layouts::index::NONE;
use crate::render::layouts::material_flags::{
    BLENDED, CULLED, EMITS_TWO_SIDED, FRESNEL_NONE, MASKED, NONLINEAR, SHEET, TRANSMITS, TWO_SIDED,
};
use crate::render::upload::textures::Atlas;
use crate::scene::{Boundary, Bsdf, Fresnel, Material, Opacity, Scene, Sides};

/// Returns the record of a material, and adds its textures to the atlas.
pub(super) fn material(m: &Material, scene: &Scene, atlas: &mut Atlas) -> layouts::Material {
    let mut out = layouts::Material {
        specular: [1.0; 3],
        eta: [1.5; 3],
        specular_factor: 1.0,
        base_texture: NONE,
        roughness_texture: NONE,
        metallic_texture: NONE,
        specular_texture: NONE,
        specular_factor_texture: NONE,
        emission_texture: NONE,
        normal_texture: NONE,
        mask_texture: NONE,
        transmission_texture: NONE,
        ..Default::default()
    };
    write_bsdf(&mut out, &m.bsdf, scene, atlas);
    if m.is_glossy() && out.model == bsdf_model::DIFFUSE {
        // A diffuse surface under layers is a dielectric without reflection.
        (out.model, out.roughness, out.specular_factor) = (bsdf_model::METALLIC_ROUGHNESS, 1.0, 0.0);
    }
    if let Some(emission) = &m.emission {
        (out.emission, out.emission_texture) = atlas.color(scene, &emission.radiance);
        if emission.two_sided {
            out.flags |= EMITS_TWO_SIDED;
        }
    }
    if let Some(normal_map) = &m.normal_map {
        out.normal_texture = atlas.add(scene, &normal_map.texture, 0);
        out.normal_scale = normal_map.scale;
    }
    if let Some(opacity) = &m.opacity {
        (out.mask_value, out.mask_texture) = atlas.scalar(scene, opacity.value());
        match opacity {
            Opacity::CutOut { cutoff, .. } => {
                out.flags |= MASKED;
                out.mask_cutoff = *cutoff;
            }
            Opacity::Blended { .. } => out.flags |= MASKED | BLENDED,
        }
    }
    if m.bsdf.transmits() {
        out.flags |= TRANSMITS;
        match m.boundary {
            Boundary::Sheet => out.flags |= SHEET,
            Boundary::Volume { absorption } => out.absorption = absorption.to_array(),
        }
    }
    out.flags |= match m.sides {
        // Transmissive surfaces have two sides.
        _ if m.bsdf.transmits() => TWO_SIDED,
        Sides::Two => TWO_SIDED,
        Sides::One => 0,
        Sides::OneCulled => CULLED,
    };
    out
}

/// Returns the record of the layers on top of a material, and adds their textures to the atlas.
pub(super) fn layers(m: &Material, scene: &Scene, atlas: &mut Atlas) -> layouts::Layers {
    let mut out = layouts::Layers {
        coat_texture: NONE,
        coat_roughness_texture: NONE,
        coat_normal_texture: NONE,
        sheen_texture: NONE,
        sheen_roughness_texture: NONE,
        anisotropy_texture: NONE,
        film_texture: NONE,
        film_thickness_texture: NONE,
        ..Default::default()
    };
    if let Some(film) = &m.film {
        (out.film, out.film_texture) = atlas.scalar(scene, &film.strength);
        (out.film_ior, out.film_thickness) = (film.ior, film.thickness);
        if let Some((texture, channel)) = &film.thickness_texture {
            out.film_thickness_texture = atlas.add(scene, texture, *channel);
        }
    }
    if let Some(anisotropy) = &m.anisotropy {
        out.anisotropy = anisotropy.strength;
        out.anisotropy_direction = [anisotropy.rotation.cos(), anisotropy.rotation.sin()];
        if let Some(texture) = &anisotropy.texture {
            out.anisotropy_texture = atlas.add(scene, texture, 0);
        }
    }
    if let Some(sheen) = &m.sheen {
        (out.sheen, out.sheen_texture) = atlas.color(scene, &sheen.color);
        (out.sheen_roughness, out.sheen_roughness_texture) = atlas.scalar(scene, &sheen.roughness);
    }
    if let Some(coat) = &m.coat {
        (out.coat, out.coat_texture) = atlas.scalar(scene, &coat.weight);
        (out.coat_roughness, out.coat_roughness_texture) = atlas.scalar(scene, &coat.roughness);
        if let Some(normal_map) = &coat.normal_map {
            out.coat_normal_texture = atlas.add(scene, &normal_map.texture, 0);
            out.coat_normal_scale = normal_map.scale;
        }
    }
    out
}

/// Writes the BSDF's model and parameters.
fn write_bsdf(out: &mut layouts::Material, bsdf: &Bsdf, scene: &Scene, atlas: &mut Atlas) {
    match bsdf {
        Bsdf::Diffuse { reflectance } => (out.base, out.base_texture) = atlas.color(scene, reflectance),
        Bsdf::MetallicRoughness { base_color, metallic, roughness, ior, specular, specular_color, transmission } => {
            out.model = bsdf_model::METALLIC_ROUGHNESS;
            (out.base, out.base_texture) = atlas.color(scene, base_color);
            (out.metallic, out.metallic_texture) = atlas.scalar(scene, metallic);
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, roughness);
            (out.specular_factor, out.specular_factor_texture) = atlas.scalar(scene, specular);
            (out.specular, out.specular_texture) = atlas.color(scene, specular_color);
            out.eta = [*ior; 3];
            (out.transmission, out.transmission_texture) = atlas.scalar(scene, transmission);
        }
        Bsdf::Conductor { alpha, fresnel, specular } => {
            out.model = bsdf_model::CONDUCTOR;
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, alpha);
            (out.specular, out.specular_texture) = atlas.color(scene, specular);
            match fresnel {
                Fresnel::None => out.flags |= FRESNEL_NONE,
                Fresnel::Conductor { eta, k } => (out.eta, out.k) = (eta.to_array(), k.to_array()),
            }
        }
        Bsdf::Plastic { alpha, diffuse, specular, eta, nonlinear } => {
            out.model = bsdf_model::PLASTIC;
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, alpha);
            (out.base, out.base_texture) = atlas.color(scene, diffuse);
            (out.specular, out.specular_texture) = atlas.color(scene, specular);
            out.eta = [*eta; 3];
            if *nonlinear {
                out.flags |= NONLINEAR;
            }
        }
        Bsdf::Dielectric { alpha, eta, reflection, transmission } => {
            out.model = bsdf_model::DIELECTRIC;
            (out.roughness, out.roughness_texture) = atlas.scalar(scene, alpha);
            (out.base, out.base_texture) = atlas.color(scene, reflection);
            (out.specular, out.specular_texture) = atlas.color(scene, transmission);
            out.eta = [*eta; 3];
        }
    }
}
