//! Scene statistics that decide which passes run.

use std::collections::HashSet;

use glam::Vec3;
use rayon::prelude::*;

use crate::scene::model::material::SMOOTH;
use crate::scene::{Bsdf, Distribution, EdgeFactor, Geometry, Instance, Light, Material, Mesh, Scalar, Scene};

/// Counts and extremes of a scene.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SceneStats {
    /// Triangles after flattening.
    pub triangles: usize,
    /// Vertices after flattening.
    pub vertices: usize,
    /// Materials.
    pub materials: usize,
    /// Point, spot, directional and sun lights, without those of zero power.
    pub lights: usize,
    /// Lights without extent, for which direct light needs no sampling of a point on the light.
    pub sharp_lights: usize,
    /// Point and spot lights with non-zero radius.
    pub sized_local_lights: usize,
    /// True if any light has a pattern.
    pub patterns: bool,
    /// Light clusters: occupied cells of an 8 x 8 x 8 grid over the scene's bounding box, plus one for each
    /// infinite light. An emissive mesh of many triangles is one cluster or a few.
    pub light_places: usize,
    /// Lights, and instances of emissive meshes.
    pub light_sources: usize,
    /// True if there is a local light: a light with a position or an emissive triangle.
    pub local_lights: bool,
    /// True if there is an infinite light or an environment.
    pub infinite_lights: bool,
    /// Triangles with an emissive material.
    pub emissive_triangles: usize,
    /// True if there is an environment.
    pub environment: bool,
    /// True if the environment has a map.
    pub environment_map: bool,
    /// Triangles with a lobe besides the diffuse one.
    pub glossy_triangles: usize,
    /// Largest share of a material's surface whose lobe is perfectly smooth, by its texels: 1 for mirrors and
    /// clear glass.
    pub smooth_share: f32,
    /// True if any surface is glass or a perfect mirror ([`Material::is_specular`]).
    pub specular: bool,
    /// True if no surface reflects or transmits light, as where all materials are unlit.
    pub unlit: bool,
    /// True if any surface transmits light.
    pub transmits: bool,
    /// True if any medium disperses light.
    pub disperses: bool,
    /// True if the diffuse base of any surface passes light.
    pub diffuse_transmission: bool,
    /// True if any surface has a thin film.
    pub films: bool,
    /// True if any surface has a stretched lobe.
    pub anisotropic: bool,
    /// True if any surface has Disney's base.
    pub disney: bool,
    /// True if any surface has a sheen.
    pub sheens: bool,
    /// True if any surface has a coat.
    pub coats: bool,
    /// True if any surface is a [`Bsdf::Conductor`].
    pub conductors: bool,
    /// True if any surface is a [`Bsdf::Plastic`].
    pub plastics: bool,
    /// True if any diffuse base lies under a rough coat.
    pub rough_plastic: bool,
    /// True if any lobe has Beckmann facets.
    pub beckmann: bool,
    /// True if any surface is a mix of materials.
    pub mixes: bool,
    /// True if a metal's lobe is narrower than the widest one that the denoiser filters in full
    /// (shaders/denoise/filter.wesl).
    pub narrow_metals: bool,
    /// Triangles that rays may pass: with an alpha test, blended, or thin sheets.
    pub masked_triangles: usize,
    /// Those of them that rays pass by chance: blended, or clear sheets.
    pub blended_triangles: usize,
    /// Texels of the images that materials use.
    pub texels: u64,
    /// Triangles made by tessellation.
    pub tessellated_triangles: usize,
    /// True if the number of triangles depends on the view.
    pub triangles_vary: bool,
    /// True if an animation moves vertices.
    pub deforms: bool,
    /// True if any vertex has a colour.
    pub vertex_colors: bool,
    /// True if a camera has a lens.
    pub lens: bool,
    /// True if a camera is inside the bounding box, as in a room.
    pub camera_inside: bool,
    /// Half the diagonal of the bounding box, metres.
    pub radius: f32,
    /// Mean square root of the triangles' areas, relative to `radius`: a measure of geometric detail.
    pub mean_triangle_size: f32,
}

impl SceneStats {
    /// Collects the statistics.
    #[must_use]
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let mut of_material = vec![0; scene.materials.len()];
        geometry.materials.iter().for_each(|&m| of_material[m as usize] += 1);
        let count = |test: &dyn Fn(&crate::scene::Material) -> bool| -> usize {
            scene.materials.iter().zip(&of_material).filter(|(m, _)| test(m)).map(|(_, count)| count).sum()
        };
        let used = scene.materials.iter().zip(&of_material).filter(|(_, count)| **count > 0);
        let smooth_share = used.map(|(m, _)| smooth_share(m, scene)).fold(0.0, f32::max);
        let radius = 0.5 * geometry.bounds[0].distance(geometry.bounds[1]);
        let size = |i: usize| {
            let [a, b, c] = geometry.positions(i);
            f64::from((0.5 * (b - a).cross(c - a).length()).sqrt())
        };
        // Chunks of fixed size make the sum independent of the number of threads.
        let parts: Vec<usize> = (0..geometry.triangles.len()).step_by(1 << 14).collect();
        let part = |&first: &usize| (first..geometry.triangles.len().min(first + (1 << 14))).map(size).sum::<f64>();
        let sizes: f64 = parts.par_iter().map(part).collect::<Vec<_>>().iter().sum();
        let emissive_materials: Vec<bool> = scene.materials.iter().map(is_emissive).collect();
        let emissive_triangles = count(&is_emissive);
        let emits = |instance: &&Instance| emissive_materials[scene.meshes[instance.mesh].material];
        let emissive_instances = scene.instances.iter().filter(emits).count();
        let candidates = if emissive_triangles > 0 { geometry.triangles.len() } else { 0 };
        let emissive = (0..candidates).filter(|&i| emissive_materials[geometry.materials[i] as usize]);
        let centroids = emissive.map(|i| geometry.positions(i).iter().sum::<Vec3>() / 3.0);
        let [low, high] = geometry.bounds;
        let cell = |p: Vec3| {
            let inside = (p - low) / (high - low).max(Vec3::splat(f32::MIN_POSITIVE));
            (inside * 8.0).as_ivec3().clamp(glam::IVec3::ZERO, glam::IVec3::splat(7))
        };
        let local = scene.lights.iter().filter_map(Light::position);
        let cells: HashSet<_> = local.chain(centroids).map(cell).collect();
        let infinite = scene.lights.iter().filter(|l| l.position().is_none()).count();
        Self {
            triangles: geometry.triangles.len(),
            vertices: geometry.vertices.len(),
            materials: scene.materials.len(),
            lights: scene.lights.len(),
            sharp_lights: scene.lights.iter().filter(|l| l.is_sharp()).count(),
            sized_local_lights: scene.lights.iter().filter(|l| !l.is_sharp() && l.position().is_some()).count(),
            patterns: !scene.patterns.is_empty(),
            light_places: cells.len() + infinite + usize::from(scene.environment.is_some()),
            light_sources: scene.lights.len() + emissive_instances,
            local_lights: !cells.is_empty(),
            infinite_lights: infinite > 0 || scene.environment.is_some(),
            emissive_triangles,
            environment: scene.environment.is_some(),
            environment_map: scene.environment.as_ref().is_some_and(|e| e.map.is_some()),
            glossy_triangles: count(&Material::is_glossy),
            smooth_share,
            specular: count(&Material::is_specular) > 0,
            unlit: count(&|m| m.any(&scatters)) == 0,
            transmits: count(&|m| m.transmits()) > 0,
            disperses: count(&|m| m.any(&|m| m.iors().is_some())) > 0,
            diffuse_transmission: count(&|m| m.any(&|m| m.diffuse_transmission.is_some())) > 0,
            films: count(&|m| m.any(&|m| m.film.is_some())) > 0,
            anisotropic: count(&|m| m.any(&|m| m.anisotropy.is_some())) > 0,
            disney: count(&|m| m.any(&|m| m.disney.is_some())) > 0,
            sheens: count(&|m| m.any(&|m| m.sheen.is_some())) > 0,
            coats: count(&|m| m.any(&|m| m.coat.is_some())) > 0,
            conductors: count(&|m| m.any(&|m| matches!(m.bsdf, Bsdf::Conductor { .. }))) > 0,
            plastics: count(&|m| m.any(&|m| matches!(m.bsdf, Bsdf::Plastic { .. }))) > 0,
            rough_plastic: count(&|m| m.any(&|m| m.bsdf.rough_coat().is_some())) > 0,
            beckmann: count(&|m| m.any(&|m| m.distribution == Distribution::Beckmann)) > 0,
            mixes: count(&|m| m.mix.is_some()) > 0,
            narrow_metals: count(&|m| m.any(&is_narrow_metal)) > 0,
            masked_triangles: count(&Material::may_be_passed),
            blended_triangles: count(&|m| m.is_clear_sheet() || m.opacity.is_some_and(|opacity| opacity.is_blended())),
            texels: if scene.textures.is_empty() {
                0
            } else {
                scene.images.iter().map(|i| u64::from(i.width) * u64::from(i.height)).sum()
            },
            tessellated_triangles: geometry.tessellated,
            triangles_vary: triangles_vary(scene),
            deforms: scene.rig.is_some() || scene.pose.is_some(),
            vertex_colors: scene.meshes.iter().any(|m| !m.colors.is_empty()),
            lens: scene.cameras.iter().any(|camera| camera.lens.is_some_and(|lens| lens.radius > 0.0)),
            camera_inside: scene.cameras.iter().any(|camera| {
                let eye = Vec3::from(camera.world_from_camera.translation);
                eye.cmpge(low).all() && eye.cmple(high).all()
            }),
            radius,
            mean_triangle_size: (sizes / geometry.triangles.len().max(1) as f64) as f32 / radius.max(f32::MIN_POSITIVE),
        }
    }
}

impl SceneStats {
    /// Returns the capacity of triangle buffers.
    #[must_use]
    pub fn triangle_room(&self) -> usize {
        if self.triangles_vary { with_room(self.triangles) } else { self.triangles }
    }
}

/// Returns true if the number of triangles depends on the view.
#[must_use]
pub fn triangles_vary(scene: &Scene) -> bool {
    scene.meshes.iter().filter_map(Mesh::refinement).any(|t| matches!(t.factor, EdgeFactor::Pixels(_)))
}

/// Rounds a count up to a capacity, in steps of an eighth to a quarter of it, so that similar counts share
/// one capacity.
#[must_use]
pub fn with_room(count: usize) -> usize {
    let step = (count.max(64).next_power_of_two() / 8).max(8);
    (count / step + 1) * step
}

/// Returns true if a material is a metal with a lobe of alpha below 0.3; textures count as white.
fn is_narrow_metal(material: &Material) -> bool {
    const WIDE: f32 = 0.3;
    match &material.bsdf {
        Bsdf::Conductor { alpha, .. } => alpha.factor < WIDE,
        Bsdf::MetallicRoughness { metallic, roughness, .. } => metallic.factor > 0.5 && roughness.factor.powi(2) < WIDE,
        _ => false,
    }
}

/// Least share of a material that is smooth, for light paths of its caustics. Roughness maps have a few smooth
/// texels (Sponza), whose caustics are not worth a light path per pixel.
pub const LEAST_SMOOTH: f32 = 0.05;

/// Returns the share of a material's texels whose lobe, or whose coat, is perfectly smooth; the largest one of a mix.
#[must_use]
pub fn smooth_share(material: &Material, scene: &Scene) -> f32 {
    material.plain().into_iter().map(|material| smooth_share_of_plain(material, scene)).fold(0.0, f32::max)
}

/// Returns the same of a material that is no mix.
fn smooth_share_of_plain(material: &Material, scene: &Scene) -> f32 {
    // `width` is roughness or alpha, and `alpha` the second as a function of the first.
    let share = |width: &Scalar, alpha: fn(f32) -> f32| {
        let is_smooth = |texel: u8| alpha(width.factor * f32::from(texel) / 255.0) < SMOOTH;
        let Some((texture, channel)) = width.texture else { return f32::from(u8::from(is_smooth(255))) };
        let texels = &scene.images[scene.textures[texture.texture].image].texels;
        let smooth = texels.par_iter().filter(|texel| is_smooth(texel[channel as usize])).count();
        smooth as f32 / texels.len().max(1) as f32
    };
    let squared: fn(f32) -> f32 = |roughness| roughness.powi(2);
    let coat = material.coat.as_ref().map_or(0.0, |coat| share(&coat.roughness, squared));
    let lobe = match &material.bsdf {
        Bsdf::Diffuse { .. } => 0.0,
        Bsdf::MetallicRoughness { roughness, .. } => share(roughness, squared),
        Bsdf::Conductor { alpha, .. } | Bsdf::Plastic { alpha, .. } | Bsdf::Dielectric { alpha, .. } => {
            share(alpha, |alpha| alpha)
        }
    };
    lobe.max(coat)
}

/// Returns true if a material that is no mix reflects or transmits light.
fn scatters(material: &Material) -> bool {
    let black = matches!(&material.bsdf, Bsdf::Diffuse { reflectance } if reflectance.factor == Vec3::ZERO);
    !black || material.is_glossy() || material.transmits()
}

/// Returns true if a material is emissive.
fn is_emissive(material: &Material) -> bool {
    material.emission.is_some_and(|e| e.radiance.factor != Vec3::ZERO)
}
