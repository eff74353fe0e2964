//! Renders features of the first hit without lighting: distance, normal, albedo.

use glam::{Vec2, Vec3};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use super::sampler::Sampler;
use super::{Reference, ReferenceSettings};
use crate::film::Film;

/// Images with one sample per pixel; pixels without a hit are 0 in all of them.
pub struct Features {
    /// Distance from the camera, metres, the same in all channels.
    pub distance: Film,
    /// Shading normal on the camera's side, world space; components from -1 to 1.
    pub normal: Film,
    /// Directional albedo for the direction to the camera, reflection and transmission.
    pub albedo: Film,
}

impl Reference<'_> {
    /// Traces one ray through the centre of each pixel, for a thin lens from one point of it.
    ///
    /// # Panics
    /// Panics if the scene has no camera of that index.
    #[must_use]
    pub fn features(&self, settings: &ReferenceSettings) -> Features {
        let ReferenceSettings { width, height, seed, .. } = *settings;
        let rays = self.rays(settings);
        let look = |pixel: u32| {
            let at = Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5;
            let mut sampler = Sampler::new(seed, pixel, 0);
            let (origin, direction) = rays.ray(at, &mut sampler);
            let Some(hit) = self.first_hit(origin, direction) else { return [[0.0; 3]; 3] };
            let surface = self.surfaces.at(&hit, direction, sampler.bits_of_ray(1));
            let wo = surface.frame.local(-direction);
            let albedo = self.surfaces.bsdf(&surface).map_or(Vec3::ZERO, |bsdf| bsdf.albedo(wo));
            [[hit.t; 3], surface.frame.z.to_array(), albedo.to_array()]
        };
        let seen: Vec<[[f32; 3]; 3]> = (0..width * height).into_par_iter().map(look).collect();
        let [distance, normal, albedo] =
            [0, 1, 2].map(|n| Film { width, height, pixels: seen.iter().map(|pixel| pixel[n]).collect() });
        Features { distance, normal, albedo }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn the_back_wall_of_the_box_is_seen_as_it_is() {
        let scene = builtin::load("cornell_point").unwrap();
        let mut reference = Reference::new(&scene);
        let settings = ReferenceSettings {
            width: 8,
            height: 8,
            samples: 1,
            bounces: None,
            specular_bounces: 0,
            seed: 1,
            camera: 0,
        };
        let Features { distance, normal, albedo } = reference.features(&settings);
        let middle = 3 * 8 + 3;
        assert!(distance.pixels[middle][0] > 0.1 && distance.pixels[middle][0].is_finite());
        let n = Vec3::from(normal.pixels[middle]);
        assert!((n.length() - 1.0).abs() < 1e-4, "{n}");
        assert!(albedo.pixels.iter().flatten().all(|a| (0.0..=1.0).contains(a)));
        assert!(albedo.pixels[middle][0] > 0.1);

        let away = scene.cameras[0].clone().looking(Vec3::splat(100.0), Vec3::splat(200.0)).unwrap();
        reference.look(away);
        let nothing = reference.features(&settings);
        assert_eq!([nothing.distance, nothing.normal, nothing.albedo], [(); 3].map(|()| Film::new(8, 8)));
    }
}
