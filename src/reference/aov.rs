//! Renders what a camera sees without lighting: coverage, albedo, normals, depths, positions, motion, and
//! the objects and materials of each pixel.
//!
//! The rays do not depend on the method, the seed or the number of samples of the picture, so that all methods
//! and all parts of a picture have the same images.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3};
use rayon::iter::{IntoParallelIterator as _, ParallelIterator as _};

use super::sampler::Sampler;
use super::{Hit, Reference, ReferenceSettings};
use crate::crop::Crop;
use crate::scene::{Geometry, Scene};

/// Distance where nothing is hit.
pub const FAR: f32 = 1e10;

/// Images of what the camera sees, one value per pixel in row-major order. Those that are called means are
/// means over the rays of a pixel; rays that hit nothing count as zero.
#[derive(Clone, Debug, Default)]
pub struct Aovs {
    /// Share of the rays that hit a surface, 0 to 1.
    pub coverage: Vec<f32>,
    /// Mean directional albedo, 0 to 1.
    pub albedo: Vec<[f32; 3]>,
    /// Mean shading normal on the camera's side, world space; shorter than 1 at edges.
    pub normal: Vec<[f32; 3]>,
    /// Depth along the view direction at the centre of the pixel, metres; [`FAR`] where nothing is hit.
    pub depth: Vec<f32>,
    /// Position at the centre of the pixel, world space, metres; zero where nothing is hit.
    pub position: Vec<[f32; 3]>,
    /// Pixels that what is at the centre of the pixel has moved since the frame before, X to the right and Y up;
    /// zero without a frame before, and where that was behind the camera.
    pub motion: Vec<[f32; 2]>,
    /// Mean radiance of the environment that is seen past all surfaces.
    pub background: Vec<[f32; 3]>,
    /// Instances in each pixel with their coverage, the largest first. [`Aovs::TESSELLATED`] are surfaces whose
    /// triangles were made by tessellation.
    pub objects: Vec<Vec<(u32, f32)>>,
    /// Materials in each pixel with their coverage, the largest first.
    pub materials: Vec<Vec<(u32, f32)>>,
}

impl Aovs {
    /// Instance of surfaces that are tessellated.
    pub const TESSELLATED: u32 = u32::MAX;
}

/// The images' values of a pixel.
#[derive(Default)]
struct Pixel {
    hits: u32,
    albedo: Vec3,
    normal: Vec3,
    background: Vec3,
    depth: f32,
    position: Vec3,
    motion: Vec2,
    objects: BTreeMap<u32, u32>,
    materials: BTreeMap<u32, u32>,
}

/// The scene in the pose of the frame before.
struct Before<'a> {
    scene: &'a Scene,
    /// Positions of the vertices that tessellation makes for this frame in that pose, metres, world space.
    refined: Vec<Vec3>,
}

impl<'a> Before<'a> {
    fn new(reference: &Reference, scene: &'a Scene) -> Self {
        let refines = reference.geometry().tessellated > 0;
        let positions = || Geometry::refined_positions_in(reference.scene, scene);
        Self { scene, refined: if refines { positions() } else { Vec::new() } }
    }
}

impl Reference<'_> {
    /// Traces `settings.samples` rays through each pixel, through points of the lens if there is one, and one
    /// through the centre of the pixel and of the lens. `settings.seed` and `settings.bounces` are not used.
    ///
    /// # Panics
    /// Panics if the scene has no camera of that index.
    #[must_use]
    pub fn aovs(&self, settings: &ReferenceSettings) -> Aovs {
        self.aovs_within(settings, Crop::whole(settings.width, settings.height), None)
    }

    /// Returns the same of a part of the image, with the motion since `before`, the same scene in the pose of the
    /// frame before.
    ///
    /// # Panics
    /// Panics if one of the scenes has no camera of that index.
    #[must_use]
    pub fn aovs_within(&self, settings: &ReferenceSettings, region: Crop, before: Option<&Scene>) -> Aovs {
        let samples = settings.samples;
        let before = before.map(|before| Before::new(self, before));
        let pixels: Vec<u32> = region.pixels(settings.width).collect();
        let pixels: Vec<Pixel> =
            pixels.into_par_iter().map(|pixel| self.aovs_of(settings, pixel, before.as_ref())).collect();
        let mean = |value: &dyn Fn(&Pixel) -> Vec3| -> Vec<[f32; 3]> {
            pixels.iter().map(|pixel| (value(pixel) / samples as f32).to_array()).collect()
        };
        let ranked = |counts: &dyn Fn(&Pixel) -> &BTreeMap<u32, u32>| -> Vec<Vec<(u32, f32)>> {
            let of_pixel = |pixel: &Pixel| {
                let mut all: Vec<_> = counts(pixel).iter().map(|(&id, &count)| (id, count)).collect();
                all.sort_by_key(|&(id, count)| (std::cmp::Reverse(count), id));
                all.into_iter().map(|(id, count)| (id, count as f32 / samples as f32)).collect()
            };
            pixels.iter().map(of_pixel).collect()
        };
        Aovs {
            coverage: pixels.iter().map(|pixel| pixel.hits as f32 / samples as f32).collect(),
            albedo: mean(&|pixel| pixel.albedo),
            normal: mean(&|pixel| pixel.normal),
            depth: pixels.iter().map(|pixel| pixel.depth).collect(),
            position: pixels.iter().map(|pixel| pixel.position.to_array()).collect(),
            motion: pixels.iter().map(|pixel| pixel.motion.to_array()).collect(),
            background: mean(&|pixel| pixel.background),
            objects: ranked(&|pixel| &pixel.objects),
            materials: ranked(&|pixel| &pixel.materials),
        }
    }

    /// Traces the rays of one pixel.
    fn aovs_of(&self, settings: &ReferenceSettings, pixel: u32, before: Option<&Before>) -> Pixel {
        let corner = Vec2::new((pixel % settings.width) as f32, (pixel / settings.width) as f32);
        let rays = self.rays(settings);
        let mut out = Pixel { depth: FAR, ..Pixel::default() };
        for sample in 0..settings.samples {
            let mut sampler = Sampler::new(0, pixel, sample);
            let at = corner + sampler.pair();
            let (origin, direction) = rays.ray(at, &mut sampler);
            let bits = sampler.bits_of_ray(1);
            let Some(hit) = self.seen(origin, direction, bits) else {
                out.background += self.sky.as_ref().map_or(Vec3::ZERO, |sky| sky.radiance(direction));
                continue;
            };
            let surface = self.surfaces.at(&hit, direction, bits);
            let wo = surface.frame.local(-direction);
            out.hits += 1;
            out.albedo +=
                self.surfaces.bsdf(&surface).map_or(Vec3::ZERO, |bsdf| bsdf.albedo(wo)).clamp(Vec3::ZERO, Vec3::ONE);
            out.normal += surface.frame.z;
            *out.objects.entry(self.instance_of(hit.triangle)).or_default() += 1;
            *out.materials.entry(self.geometry().materials[hit.triangle as usize]).or_default() += 1;
        }
        let (origin, direction, forward) = rays.central(corner + 0.5);
        let hit = self.first_hit(origin, direction);
        if let Some(hit) = &hit {
            out.position = self.surfaces.at(hit, direction, 0).position;
            out.depth = hit.t * direction.dot(forward);
        }
        if let Some(before) = before {
            let camera = &before.scene.cameras[settings.camera];
            let place = match &hit {
                Some(hit) => self.position_in(before, hit),
                // What is infinitely far away moves with the direction of the view alone.
                None => Vec3::from(camera.world_from_camera.translation) + direction,
            };
            let size = Vec2::new(settings.width as f32, settings.height as f32);
            let place = camera.project_beyond(place, settings.width, settings.height);
            out.motion = place.map_or(Vec2::ZERO, |place| (corner + 0.5 - place * size) * Vec2::new(1.0, -1.0));
        }
        out
    }

    /// Returns the instance of a triangle.
    fn instance_of(&self, triangle: u32) -> u32 {
        let [vertex, ..] = self.geometry().triangles[triangle as usize];
        self.surfaces.origins.get(vertex as usize).map_or(Aovs::TESSELLATED, |&[instance, _]| instance)
    }

    /// Returns where a hit was in the frame before.
    fn position_in(&self, before: &Before, hit: &Hit) -> Vec3 {
        let (geometry, pose) = (self.geometry(), before.scene);
        let corner = |vertex: u32| match self.surfaces.origins.get(vertex as usize) {
            Some(&[instance, vertex]) => {
                let instance = &pose.instances[instance as usize];
                instance.world_from_local.transform_point3(pose.meshes[instance.mesh].positions[vertex as usize])
            }
            None => before.refined[vertex as usize - self.surfaces.origins.len()],
        };
        hit.mix(geometry.triangles[hit.triangle as usize].map(corner))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3A;

    use super::*;
    use crate::scene::{FovAxis, Projection, builtin};

    #[test]
    fn a_triangle_covers_what_it_covers() {
        let mut scene = builtin::load("single_triangle").unwrap();
        scene.cameras[0].projection = Projection::Perspective { fov: 60.0_f32.to_radians(), axis: FovAxis::Smaller };
        scene.cameras[0] = scene.cameras[0].clone().looking(Vec3::new(0.0, 1.0, 9.0), Vec3::Y).unwrap();
        let reference = Reference::new(&scene);
        let settings = ReferenceSettings {
            width: 24,
            height: 24,
            samples: 64,
            bounces: None,
            specular_bounces: 0,
            seed: 1,
            camera: 0,
        };
        let aovs = reference.aovs(&settings);
        let features = reference.features(&settings);
        let full = |pixel: &usize| aovs.coverage[*pixel] == 1.0;
        let inside: Vec<usize> = (0..24 * 24).filter(full).collect();
        let partly = aovs.coverage.iter().filter(|&&c| c > 0.0 && c < 1.0).count();
        assert!(inside.len() > 20 && partly > 5, "{} pixels inside, {partly} at edges", inside.len());
        // The triangle lies in the plane z = 0 and has an area of 32 square metres. The view, 9 m away, is
        // 18 tan(30 degrees) = 10.392 m wide there: 2.3094 pixels per metre.
        let area: f32 = aovs.coverage.iter().sum();
        assert!((area / (32.0 * 2.3094 * 2.3094) - 1.0).abs() < 0.005, "{area} pixels");
        let camera = &scene.cameras[0];
        let eye = Vec3::from(camera.world_from_camera.translation);
        for &pixel in &inside {
            let close = |a: [f32; 3], b: [f32; 3]| Vec3::from(a).distance(b.into()) < 1e-4;
            assert!(close(aovs.albedo[pixel], features.albedo.pixels[pixel]));
            assert!(close(aovs.normal[pixel], features.normal.pixels[pixel]));
            let position = Vec3::from(aovs.position[pixel]);
            assert!((position.distance(eye) - features.distance.pixels[pixel][0]).abs() < 1e-4);
            assert!((aovs.depth[pixel] - 9.0).abs() < 1e-4 && position.z.abs() < 1e-4);
            let view = camera.world_from_camera.inverse().transform_point3(position);
            assert!((view.z + aovs.depth[pixel]).abs() < 1e-4, "{} and {}", view.z, aovs.depth[pixel]);
            assert_eq!(
                (aovs.objects[pixel].as_slice(), aovs.materials[pixel].as_slice()),
                (&[(0, 1.0)][..], &[(0, 1.0)][..])
            );
        }
        for pixel in (0..24 * 24).filter(|&pixel| aovs.coverage[pixel] == 0.0) {
            assert_eq!((aovs.normal[pixel], aovs.depth[pixel], aovs.objects[pixel].len()), ([0.0; 3], FAR, 0));
        }
        let other = reference.aovs(&ReferenceSettings { seed: 9, ..settings });
        assert_eq!(other.coverage, aovs.coverage, "the seed of the picture does not count");
    }
    /// A triangle and a camera that have moved, and a camera that has turned.
    /// The new vertices of a frame are where the previous pose has them.
    #[test]
    fn tessellated_surfaces_move() {
        let scene = builtin::load("phong_sphere").unwrap();
        let shift = Vec3::new(0.02, 0.01, -0.03);
        let mut before = scene.clone();
        before.instances.iter_mut().for_each(|instance| instance.world_from_local.translation -= Vec3A::from(shift));
        let reference = Reference::new(&scene);
        assert!(reference.geometry().tessellated > 0);
        let settings = ReferenceSettings {
            width: 24,
            height: 24,
            samples: 4,
            bounces: None,
            specular_bounces: 0,
            seed: 1,
            camera: 0,
        };
        let aovs = reference.aovs_within(&settings, Crop::whole(24, 24), Some(&before));
        let tessellated =
            |pixel: &usize| aovs.depth[*pixel] < FAR && aovs.objects[*pixel] == [(Aovs::TESSELLATED, 1.0)];
        let pixels: Vec<usize> = (0..24 * 24).filter(tessellated).collect();
        assert!(pixels.len() > 50, "{} pixels", pixels.len());
        for pixel in pixels {
            let then = Vec3::from(aovs.position[pixel]) - shift;
            let then = scene.cameras[0].project_beyond(then, 24, 24).unwrap() * 24.0;
            let now = Vec2::new((pixel % 24) as f32, (pixel / 24) as f32) + 0.5;
            let motion = Vec2::from(aovs.motion[pixel]);
            assert!(motion.length() > 0.1, "{pixel}: {motion}");
            assert!(motion.distance((now - then) * Vec2::new(1.0, -1.0)) < 1e-3, "{pixel}: {motion}");
        }

        let waves = builtin::load("sea").unwrap();
        let [now, then] = [0.5, 0.4].map(|seconds| waves.at(0, seconds).unwrap());
        let reference = Reference::new(&now);
        let moved = |before: &Scene| {
            let aovs = reference.aovs_within(&settings, Crop::whole(24, 24), Some(before));
            aovs.motion.iter().filter(|motion| Vec2::from(**motion).length() > 1e-3).count()
        };
        assert!(moved(&then) > 50 && moved(&now) == 0, "{} and {} pixels", moved(&then), moved(&now));
    }

    #[test]
    fn motion_is_in_pixels() {
        let mut scene = builtin::load("single_triangle").unwrap();
        scene.cameras[0].projection = Projection::Perspective { fov: 60.0_f32.to_radians(), axis: FovAxis::Smaller };
        let eye = Vec3::new(0.0, 1.0, 9.0);
        scene.cameras[0] = scene.cameras[0].clone().looking(eye, Vec3::Y).unwrap();
        let reference = Reference::new(&scene);
        let settings = ReferenceSettings {
            width: 24,
            height: 24,
            samples: 1,
            bounces: None,
            specular_bounces: 0,
            seed: 1,
            camera: 0,
        };
        let middle = Crop { x: 12, y: 10, width: 1, height: 1 };
        let corner = Crop { x: 0, y: 0, ..middle };
        let since = |before: &Scene, region| {
            let aovs = reference.aovs_within(&settings, region, Some(before));
            (aovs.motion[0], aovs.depth[0] < FAR)
        };
        let close = |(a, seen): ([f32; 2], bool), b: [f32; 2]| seen && Vec2::from(a).distance(b.into()) < 1e-3;
        assert!(close(since(&scene, middle), [0.0; 2]));
        // 2.3094 pixels per metre, as above. The triangle has moved by 0.1 m to the right and 0.2 m down.
        let mut moved = scene.clone();
        moved.instances[0].world_from_local.translation += glam::Vec3A::new(-0.1, 0.2, 0.0);
        assert!(close(since(&moved, middle), [0.230_94, -0.461_88]), "{:?}", since(&moved, middle));
        // The camera has moved by half a metre to the left, so that what it sees has moved to the right.
        let mut beside = scene.clone();
        beside.cameras[0].world_from_camera.translation.x += 0.5;
        assert!(close(since(&beside, middle), [1.1547, 0.0]));
        // Nothing is seen at the corner: it moves with the camera's direction alone.
        let (pixels, seen) = since(&beside, corner);
        assert!(!seen && Vec2::from(pixels).length() < 1e-3, "{pixels:?}");
        let mut turned = scene.clone();
        turned.cameras[0] = turned.cameras[0].clone().looking(eye, Vec3::new(1.0, 1.0, 0.0)).unwrap();
        assert!(since(&turned, corner).0[0] > 2.0);
        turned.cameras[0] = turned.cameras[0].clone().looking(eye, Vec3::new(0.0, 1.0, 18.0)).unwrap();
        assert_eq!(since(&turned, middle).0, [0.0; 2], "it was behind the camera");
        let still = reference.aovs(&settings);
        assert!(still.motion.len() == 24 * 24 && still.motion.iter().all(|pixels| *pixels == [0.0; 2]));
    }
}
