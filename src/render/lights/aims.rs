//! Surfaces that light paths of caustics are aimed at: mirrors and clear glass (shaders/lib/lights/aims.wesl).
//!
//! Paths in directions of a light's own seldom meet the small glass whose caustic they could make, and the few that do
//! carry all of its light. So half of the paths start towards points of smooth surfaces, as projection maps let photons
//! do (Jensen 1996). Points are uniform over the surface of a material, so that their density is a number for each
//! material; a material is chosen by the square root of its area, so that a wall of mirrors leaves some to a lens.

use glam::Vec3;
use rayon::prelude::*;

use crate::scene::model::stats::{LEAST_SMOOTH, smooth_share};
use crate::scene::{Geometry, Material, Scene};

/// Weight of a smooth coat over another material, which reflects a few percent.
const COAT: f64 = 0.1;

/// Triangles are chosen by fractions of 2^32.
const STEPS: f64 = (1_u64 << 32) as f64;

/// What light paths are aimed at.
#[derive(Clone, Default)]
pub struct Aims {
    /// For each triangle: the probability of all up to it, as a fraction of 2^32, and its index.
    pub triangles: Vec<[u32; 2]>,
    /// Density of points on each material, per square metre.
    pub densities: Vec<f32>,
}

impl Aims {
    /// Collects the triangles of a scene's smooth materials. Tessellated triangles, whose number varies with the view, are
    /// no aims, nor are others of their materials.
    #[must_use]
    pub fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let (plain, tessellated) = geometry.materials.split_at(geometry.triangles.len() - geometry.tessellated);
        let mut used = vec![false; scene.materials.len()];
        plain.iter().for_each(|&material| used[material as usize] = true);
        tessellated.iter().for_each(|&material| used[material as usize] = false);
        let share = |(material, used)| if used { smooth_share(material, scene) } else { 0.0 };
        let shares: Vec<_> = scene.materials.iter().zip(used).map(share).collect();

        let aimed: Vec<_> = (0..plain.len()).filter(|&t| shares[plain[t] as usize] >= LEAST_SMOOTH).collect();
        let area = |&t: &usize| {
            let [a, b, c] = geometry.positions(t).map(Vec3::as_dvec3);
            0.5 * (b - a).cross(c - a).length()
        };
        let areas: Vec<_> = aimed.par_iter().map(area).collect();
        let mut of_material = vec![0.0_f64; shares.len()];
        aimed.iter().zip(&areas).for_each(|(&t, area)| of_material[plain[t] as usize] += area);
        let strength = |material: &Material| if material.is_specular() { 1.0 } else { COAT };
        let weights: Vec<_> = (of_material.iter().zip(shares).zip(&scene.materials))
            .map(|((area, share), material)| area.sqrt() * f64::from(share) * strength(material))
            .collect();
        let all: f64 = weights.iter().sum();
        if !(all > 0.0 && all.is_finite()) {
            return Self::default();
        }
        let density = |(weight, area): (f64, f64)| if area > 0.0 { weight / (all * area) } else { 0.0 };
        let densities: Vec<_> = weights.into_iter().zip(of_material).map(density).collect();
        let mut sum = 0.0;
        let up_to = |(&t, area): (&usize, f64)| {
            sum += area * densities[plain[t] as usize];
            [(sum * STEPS).min(STEPS - 1.0) as u32, t as u32]
        };
        let triangles = aimed.iter().zip(areas).map(up_to).collect();
        Self { triangles, densities: densities.into_iter().map(|density| density as f32).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;

    fn aims_of(name: &str) -> (Scene, Geometry, Aims) {
        let scene = scene::load(name).unwrap();
        let geometry = Geometry::new(&scene);
        let aims = Aims::new(&scene, &geometry);
        (scene, geometry, aims)
    }

    #[test]
    fn densities_integrate_to_1_over_smooth_surfaces() {
        let (scene, geometry, aims) = aims_of("builtin:cornell_spheres");
        let area = |t: usize| {
            let [a, b, c] = geometry.positions(t);
            0.5 * f64::from((b - a).cross(c - a).length())
        };
        let density = |t: usize| f64::from(aims.densities[geometry.materials[t] as usize]);
        let all: f64 = (0..geometry.triangles.len()).map(|t| area(t) * density(t)).sum();
        assert!((all - 1.0).abs() < 1e-5, "{all}");
        let mut before = 0;
        for [sum, triangle] in &aims.triangles {
            let t = *triangle as usize;
            assert!(smooth_share(&scene.materials[geometry.materials[t] as usize], &scene) == 1.0);
            let share = f64::from(sum - before) / STEPS;
            assert!((share - area(t) * density(t)).abs() < 1e-7, "{share}");
            before = *sum;
        }
        assert!(before > u32::MAX - 256, "{before}");
        assert!(aims.densities.iter().filter(|&&density| density > 0.0).count() < scene.materials.len());
    }

    /// Diffuse surfaces are no aims, nor is water whose triangles vary with the view.
    #[test]
    fn what_is_not_smooth_or_varies_is_no_aim() {
        for name in ["builtin:cornell_point", "builtin:sea"] {
            let (_, _, aims) = aims_of(name);
            assert!(aims.triangles.is_empty() && aims.densities.is_empty(), "{name}");
        }
    }
}
