//! Facts of a scene that decide which passes it needs.

use std::collections::HashSet;

use glam::Vec3;
use rayon::prelude::*;

use super::{Bsdf, EdgeFactor, Geometry, Light, Material, Mesh, Scene};

/// Counts and extremes, taken once.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SceneStats {
    /// Triangles after flattening.
    pub triangles: usize,
    /// Vertices after flattening.
    pub vertices: usize,
    /// Materials.
    pub materials: usize,
    /// Point, spot and directional lights that shine.
    pub lights: usize,
    /// Those of them that have no extent: direct light is the same for every point on them.
    pub sharp_lights: usize,
    /// Those that are somewhere and have one.
    pub lamps: usize,
    /// Whether any of them has a pattern.
    pub patterns: bool,
    /// Places that light comes from: cells of a grid of 8 x 8 x 8 over the scene's box that hold any, and each direction from infinitely
    /// far away. A lamp of many triangles is one place or a few.
    pub light_places: usize,
    /// Whether light comes from anywhere in the scene, from a light or a triangle.
    pub near_lights: bool,
    /// Whether light comes from infinitely far away, from a light or the environment.
    pub far_lights: bool,
    /// Triangles whose material shines.
    pub emissive_triangles: usize,
    /// Whether light comes from infinitely far away.
    pub environment: bool,
    /// Whether it comes from a map.
    pub environment_map: bool,
    /// Triangles with a lobe beside the diffuse one.
    pub glossy_triangles: usize,
    /// Whether any is of a metal whose lobe is narrower than what the filter of squares joins in full (shaders/filter.wesl).
    pub narrow_metals: bool,
    /// Triangles with holes.
    pub masked_triangles: usize,
    /// Texels of the images that materials use.
    pub texels: u64,
    /// Triangles that tessellation made.
    pub tessellated_triangles: usize,
    /// Whether their number depends on the view.
    pub triangles_vary: bool,
    /// Whether any vertex has a colour.
    pub vertex_colors: bool,
    /// Whether a camera has a lens.
    pub lens: bool,
    /// Half the diagonal of the bounding box, metres.
    pub radius: f32,
    /// Mean of the square roots of the triangles' areas over the radius: how fine the geometry is.
    pub mean_triangle_size: f32,
}

impl SceneStats {
    /// Looks at everything once.
    #[must_use]
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let mut of_material = vec![0; scene.materials.len()];
        geometry.materials.iter().for_each(|&m| of_material[m as usize] += 1);
        let count = |test: &dyn Fn(&super::Material) -> bool| -> usize {
            scene.materials.iter().zip(&of_material).filter(|(m, _)| test(m)).map(|(_, count)| count).sum()
        };
        let radius = 0.5 * geometry.bounds[0].distance(geometry.bounds[1]);
        let size = |i: usize| {
            let [a, b, c] = geometry.positions(i);
            f64::from((0.5 * (b - a).cross(c - a).length()).sqrt())
        };
        // In parts, so that the sum is the same on any number of threads.
        let parts: Vec<usize> = (0..geometry.triangles.len()).step_by(1 << 14).collect();
        let part = |&first: &usize| (first..geometry.triangles.len().min(first + (1 << 14))).map(size).sum::<f64>();
        let sizes: f64 = parts.par_iter().map(part).collect::<Vec<_>>().iter().sum();
        let shines: Vec<bool> = scene.materials.iter().map(shining).collect();
        let emissive_triangles = count(&shining);
        let among = if emissive_triangles > 0 { geometry.triangles.len() } else { 0 };
        let shining_triangles = (0..among).filter(|&i| shines[geometry.materials[i] as usize]);
        let middles = shining_triangles.map(|i| geometry.positions(i).iter().sum::<Vec3>() / 3.0);
        let [low, high] = geometry.bounds;
        let cell = |p: Vec3| {
            let inside = (p - low) / (high - low).max(Vec3::splat(f32::MIN_POSITIVE));
            (inside * 8.0).as_ivec3().clamp(glam::IVec3::ZERO, glam::IVec3::splat(7))
        };
        let near = scene.lights.iter().filter_map(Light::position);
        let cells: HashSet<_> = near.chain(middles).map(cell).collect();
        let far = scene.lights.iter().filter(|l| l.position().is_none()).count();
        Self {
            triangles: geometry.triangles.len(),
            vertices: geometry.vertices.len(),
            materials: scene.materials.len(),
            lights: scene.lights.len(),
            sharp_lights: scene.lights.iter().filter(|l| l.is_sharp()).count(),
            lamps: scene.lights.iter().filter(|l| !l.is_sharp() && l.position().is_some()).count(),
            patterns: !scene.patterns.is_empty(),
            light_places: cells.len() + far + usize::from(scene.environment.is_some()),
            near_lights: !cells.is_empty(),
            far_lights: far > 0 || scene.environment.is_some(),
            emissive_triangles,
            environment: scene.environment.is_some(),
            environment_map: scene.environment.as_ref().is_some_and(|e| e.map.is_some()),
            glossy_triangles: count(&|m| !matches!(m.bsdf, Bsdf::Diffuse { .. })),
            narrow_metals: count(&is_narrow_metal) > 0,
            masked_triangles: count(&|m| m.alpha_mask.is_some()),
            texels: if scene.textures.is_empty() {
                0
            } else {
                scene.images.iter().map(|i| u64::from(i.width) * u64::from(i.height)).sum()
            },
            tessellated_triangles: geometry.tessellated,
            triangles_vary: triangles_vary(scene),
            vertex_colors: scene.meshes.iter().any(|m| !m.colors.is_empty()),
            lens: scene.cameras.iter().any(|camera| camera.lens.is_some_and(|lens| lens.radius > 0.0)),
            radius,
            mean_triangle_size: (sizes / geometry.triangles.len().max(1) as f64) as f32 / radius.max(f32::MIN_POSITIVE),
        }
    }
}

impl SceneStats {
    /// Triangles that there is room for.
    #[must_use]
    pub fn triangle_room(&self) -> usize {
        if self.triangles_vary { with_room(self.triangles) } else { self.triangles }
    }
}

/// Whether the number of triangles depends on the view.
#[must_use]
pub fn triangles_vary(scene: &Scene) -> bool {
    scene.meshes.iter().filter_map(Mesh::refinement).any(|t| matches!(t.factor, EdgeFactor::Pixels(_)))
}

/// A number with room above it, in steps of an eighth to a quarter of it: the same for what differs little.
#[must_use]
pub fn with_room(count: usize) -> usize {
    let step = (count.max(64).next_power_of_two() / 8).max(8);
    (count / step + 1) * step
}

/// Whether a material is a metal with a lobe of alpha below 0.3; textures are taken as white.
fn is_narrow_metal(material: &Material) -> bool {
    const WIDE: f32 = 0.3;
    match &material.bsdf {
        Bsdf::Conductor { alpha, .. } => alpha.factor < WIDE,
        Bsdf::MetallicRoughness { metallic, roughness, .. } => metallic.factor > 0.5 && roughness.factor.powi(2) < WIDE,
        _ => false,
    }
}

/// Whether a material shines.
fn shining(material: &Material) -> bool {
    material.emission.is_some_and(|e| e.radiance.factor != Vec3::ZERO)
}
