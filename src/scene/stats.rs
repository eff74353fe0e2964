//! Facts of a scene that decide which passes it needs.

use glam::Vec3;

use super::{Bsdf, Geometry, Scene};

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
    /// Whether any of them has a pattern.
    pub patterns: bool,
    /// Triangles whose material shines.
    pub emissive_triangles: usize,
    /// Whether light comes from infinitely far away.
    pub environment: bool,
    /// Whether it comes from a map.
    pub environment_map: bool,
    /// Triangles with a lobe beside the diffuse one.
    pub glossy_triangles: usize,
    /// Triangles with holes.
    pub masked_triangles: usize,
    /// Texels of the images that materials use.
    pub texels: u64,
    /// Whether any vertex has a colour.
    pub vertex_colors: bool,
    /// Half the diagonal of the bounding box, metres.
    pub radius: f32,
    /// Mean of the square roots of the triangles' areas over the radius: how fine the geometry is.
    pub mean_triangle_size: f32,
}

impl SceneStats {
    /// Looks at everything once.
    #[must_use]
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let count = |test: &dyn Fn(&super::Material) -> bool| {
            let of: Vec<bool> = scene.materials.iter().map(test).collect();
            geometry.materials.iter().filter(|&&m| of[m as usize]).count()
        };
        let radius = 0.5 * geometry.bounds[0].distance(geometry.bounds[1]);
        let sizes: f64 = (0..geometry.triangles.len())
            .map(|i| {
                let [a, b, c] = geometry.positions(i);
                f64::from((0.5 * (b - a).cross(c - a).length()).sqrt())
            })
            .sum();
        Self {
            triangles: geometry.triangles.len(),
            vertices: geometry.vertices.len(),
            materials: scene.materials.len(),
            lights: scene.lights.len(),
            patterns: !scene.patterns.is_empty(),
            emissive_triangles: count(&|m| m.emission.is_some_and(|e| e.radiance.factor != Vec3::ZERO)),
            environment: scene.environment.is_some(),
            environment_map: scene.environment.as_ref().is_some_and(|e| e.map.is_some()),
            glossy_triangles: count(&|m| !matches!(m.bsdf, Bsdf::Diffuse { .. })),
            masked_triangles: count(&|m| m.alpha_mask.is_some()),
            texels: if scene.textures.is_empty() {
                0
            } else {
                scene.images.iter().map(|i| u64::from(i.width) * u64::from(i.height)).sum()
            },
            vertex_colors: scene.meshes.iter().any(|m| !m.colors.is_empty()),
            radius,
            mean_triangle_size: (sizes / geometry.triangles.len().max(1) as f64) as f32 / radius.max(f32::MIN_POSITIVE),
        }
    }
}
