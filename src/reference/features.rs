//! What the middle of each pixel sees, without light: distance, normal, albedo.

use glam::{Vec2, Vec3};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use super::sampler::Sampler;
use super::{Reference, ReferenceSettings};
use crate::film::Film;

/// Images of one sample per pixel; where nothing is seen, all of them are 0.
pub struct Features {
    /// Metres from the camera, the same in all channels.
    pub distance: Film,
    /// Shading normal on the camera's side, world space; each component from -1 to 1.
    pub normal: Film,
    /// Light that comes back or passes for light of 1 that arrives from the camera.
    pub albedo: Film,
}

impl Reference<'_> {
    /// Looks once through the middle of each pixel; of a lens, through one point of it.
    ///
    /// # Panics
    /// If the scene has no camera of that index.
    #[must_use]
    pub fn features(&self, settings: &ReferenceSettings) -> Features {
        let ReferenceSettings { width, height, seed, .. } = *settings;
        let rays = self.rays(settings);
        let look = |pixel: u32| {
            let at = Vec2::new((pixel % width) as f32, (pixel / width) as f32) + 0.5;
            let (origin, direction) = rays.ray(at, &mut Sampler::new(seed, pixel, 0));
            let Some(hit) = self.first_hit(origin, direction) else { return [[0.0; 3]; 3] };
            let surface = self.surfaces.at(&hit, direction);
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
        let settings = ReferenceSettings { width: 8, height: 8, samples: 1, bounces: None, seed: 1, camera: 0 };
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
