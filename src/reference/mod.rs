//! The reference: a CPU path tracer that shares no code with the GPU renderers.
//!
//! It traces unidirectional paths with next-event estimation, multiple importance sampling and Russian
//! roulette over every material and light of [`crate::scene`]. GGX widths below [`crate::scene::SMOOTH`] are
//! specular. It is unbiased up to f32 rounding and a ray offset of 1e-6 of a coordinate's magnitude. The same
//! settings give the same image on any number of threads.
//!
//! [`Reference`] is built once per scene. [`Reference::render`] renders images; [`Reference::closest_hit`]
//! and [`Reference::occluded`] trace single rays for tests of other visibility methods.

pub mod aov;
mod beckmann;
pub mod bsdf;
pub mod bvh;
mod camera;
pub mod disney;
mod distribution;
pub mod environment;
mod features;
pub mod film;
pub mod layers;
pub mod lights;
pub mod microfacet;
mod path;
pub mod rough_coat;
mod rounds;
mod sampler;
pub mod sheen;
pub mod surface;
pub mod texture;

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Vec2, Vec3};
use rayon::iter::{IndexedParallelIterator as _, IntoParallelIterator as _, ParallelIterator as _};

use crate::crop::Crop;
use crate::film::Film;
use crate::scene::{Camera, Geometry, Material, Scene, Sides};

use self::bvh::{Bvh, Hit, NONE};
pub use self::features::Features;
pub use self::rounds::Rounds;

use self::camera::Rays;
use self::environment::Sky;
use self::lights::Lights;
use self::path::Length;
use self::sampler::Sampler;
use self::surface::Surfaces;

/// Side of the square tile of pixels that one task renders.
const TILE: u32 = 16;

/// Settings of a reference image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReferenceSettings {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Paths per pixel; powers of two are stratified best.
    pub samples: u32,
    /// Number of indirect bounces, 0 for direct light only; none leaves path lengths to Russian roulette.
    pub bounces: Option<u32>,
    /// Number of vertices on glass and perfect mirrors that count as no bounce.
    pub specular_bounces: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Index into the scene's cameras.
    pub camera: usize,
}

/// Result of rendering.
#[derive(Clone, Debug)]
pub struct ReferenceOutput {
    /// The image.
    pub film: Film,
    /// Number of paths whose radiance was not finite. Their radiance is added to the film unchanged, so that
    /// errors stay visible.
    pub non_finite: u64,
    /// Number of camera, indirect and shadow rays.
    pub rays: u64,
}

/// A scene prepared for ray tracing.
pub struct Reference<'s> {
    scene: &'s Scene,
    /// Camera in place of the scene's own.
    camera: Option<Camera>,
    surfaces: Surfaces<'s>,
    sky: Option<Sky<'s>>,
    lights: Lights<'s>,
    bvh: Bvh,
    /// True if rays can hit emission: emissive surfaces or a sky.
    emitters_can_be_hit: bool,
    /// True if light that was scattered counts.
    scatters: bool,
}

impl<'s> Reference<'s> {
    /// Flattens the scene and builds its bounding volume hierarchy and sampling tables.
    #[must_use]
    pub fn new(scene: &'s Scene) -> Self {
        let surfaces = Surfaces::new(scene);
        let sky = scene.environment.as_ref().map(Sky::new);
        let lights = Lights::new(scene, &surfaces.geometry, sky.as_ref());
        let bvh = Bvh::new(&surfaces.geometry, |triangle| {
            let material = surfaces.material(triangle);
            material.may_be_passed() || material.sides == Sides::OneCulled
        });
        let emits = |&material: &u32| scene.materials[material as usize].emission.is_some();
        let emitters_can_be_hit = sky.is_some() || surfaces.geometry.materials.iter().any(emits);
        Self { scene, camera: None, surfaces, sky, lights, bvh, emitters_can_be_hit, scatters: true }
    }

    /// Replaces the camera, whichever one the settings name.
    pub fn look(&mut self, camera: Camera) {
        self.camera = Some(camera);
    }

    /// Counts light that was scattered, or leaves it out, so that paths show only what the camera sees emit.
    pub fn scatter(&mut self, scatters: bool) {
        self.scatters = scatters;
    }

    /// Returns the camera rays of an image.
    fn rays(&self, settings: &ReferenceSettings) -> Rays {
        let camera = self.camera.as_ref().unwrap_or_else(|| &self.scene.cameras[settings.camera]);
        Rays::new(camera, settings.width, settings.height)
    }

    /// Returns the triangles that all indices refer to.
    #[must_use]
    pub fn geometry(&self) -> &Geometry {
        &self.surfaces.geometry
    }

    /// Renders an image. `progress` receives the numbers of finished and of all pixels, from any thread.
    ///
    /// # Panics
    /// Panics if the scene has no camera of that index.
    #[must_use]
    pub fn render(&self, settings: &ReferenceSettings, progress: &(dyn Fn(u64, u64) + Sync)) -> ReferenceOutput {
        let mut rounds = Rounds::new(*settings);
        rounds.add(self, settings.samples, progress);
        ReferenceOutput { film: rounds.film(), non_finite: rounds.non_finite, rays: rounds.rays }
    }

    /// Adds a range of samples of each pixel's sequence to the sum of the pixels of a region, in sequence order. Returns the
    /// number of samples that were not finite and the number of rays. Panics if the scene has no camera of
    /// that index.
    fn add_range(
        &self,
        settings: &ReferenceSettings,
        region: Crop,
        samples: &Range<u32>,
        sums: &mut [[f64; 3]],
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> [u64; 2] {
        let Crop { width, height, .. } = region;
        let rays = self.rays(settings);
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let total = u64::from(width) * u64::from(height);
        let done = AtomicU64::new(0);
        let before = &*sums;
        let tile = |index: u32| {
            let (x0, y0) = (index % columns * TILE, index / columns * TILE);
            let (x1, y1) = ((x0 + TILE).min(width), (y0 + TILE).min(height));
            let mut tile = Tile { pixels: Vec::with_capacity((TILE * TILE) as usize), non_finite: 0, rays: 0 };
            for y in y0..y1 {
                for x in x0..x1 {
                    let mut sum = before[(y * width + x) as usize];
                    for sample in samples.clone() {
                        let (column, row) = (region.x + x, region.y + y);
                        let mut sampler = Sampler::new(settings.seed, row * settings.width + column, sample);
                        let at = Vec2::new(column as f32, row as f32) + sampler.pair();
                        let (origin, direction) = rays.ray(at, &mut sampler);
                        let path = self.path(origin, direction, Length::of(settings), &mut sampler);
                        tile.non_finite += u64::from(!path.radiance.is_finite());
                        tile.rays += u64::from(path.rays);
                        (0..3).for_each(|c| sum[c] += f64::from(path.radiance[c]));
                    }
                    tile.pixels.push(sum);
                }
            }
            let pixels = tile.pixels.len() as u64;
            progress(done.fetch_add(pixels, Ordering::Relaxed) + pixels, total);
            tile
        };
        let tiles: Vec<Tile> = (0..columns * rows).into_par_iter().with_max_len(1).map(tile).collect();
        let mut counts = [0; 2];
        for (index, tile) in (0..).zip(&tiles) {
            let (x0, y0) = (index % columns * TILE, index / columns * TILE);
            let across = TILE.min(width - x0) as usize;
            for (y, row) in (y0..).zip(tile.pixels.chunks_exact(across)) {
                let start = y as usize * width as usize + x0 as usize;
                sums[start..start + across].copy_from_slice(row);
            }
            counts = [counts[0] + tile.non_finite, counts[1] + tile.rays];
        }
        counts
    }

    /// Returns the closest hit of a ray, ignoring the triangle that it starts on, the holes of alpha masks,
    /// and blended surfaces where their opacity is below 0.5. The direction need not have unit length; `t` is
    /// in units of its length.
    #[must_use]
    pub fn closest_hit(&self, origin: Vec3, direction: Vec3, exclude: Option<u32>) -> Option<Hit> {
        let exclude = exclude.unwrap_or(NONE);
        let origin = self.step_off(origin, direction, exclude);
        self.bvh.closest(origin, direction, f32::INFINITY, exclude, |hit| self.surfaces.solid(hit))
    }

    /// Returns the closest hit of a camera ray: as [`Self::closest_hit`], but culled back faces are
    /// transparent.
    #[must_use]
    pub fn first_hit(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let visible = |hit: &Hit| !self.is_culled(hit, direction, 0) && self.surfaces.solid(hit);
        self.bvh.closest(origin, direction, f32::INFINITY, NONE, visible)
    }

    /// Returns the emitted radiance of a surface against a ray's direction.
    #[must_use]
    pub fn emitted(&self, hit: &Hit, direction: Vec3) -> Vec3 {
        self.surfaces.emitted(hit, self.normal(hit.triangle).dot(direction) < 0.0)
    }

    /// Returns the material of a triangle.
    #[must_use]
    pub fn material(&self, triangle: u32) -> &Material {
        self.surfaces.material(triangle)
    }

    /// Returns the unit normal of a triangle, on the side from which its corners are counter-clockwise.
    #[must_use]
    pub fn normal(&self, triangle: u32) -> Vec3 {
        self.surfaces.normals[triangle as usize]
    }

    /// Returns true if the segment between two points is occluded, ignoring the triangles that they are on,
    /// and what [`Self::closest_hit`] ignores.
    #[must_use]
    pub fn occluded(&self, p: Vec3, q: Vec3, exclude_p: Option<u32>, exclude_q: Option<u32>) -> bool {
        let exclude = [exclude_p, exclude_q].map(|triangle| triangle.unwrap_or(NONE));
        let (start, along) = self.segment(p, q, exclude);
        self.bvh.any(start, along, 1.0, exclude, |hit| self.surfaces.solid(hit))
    }

    /// Returns start and extent of the segment between two points, off the triangles that they are on.
    fn segment(&self, p: Vec3, q: Vec3, triangles: [u32; 2]) -> (Vec3, Vec3) {
        let start = self.step_off(p, q - p, triangles[0]);
        (start, self.step_off(q, p - q, triangles[1]) - start)
    }

    /// Offsets a ray's origin from its triangle to the side that the ray leaves to, by 1e-6 of the
    /// coordinates' magnitude. This exceeds their rounding error, so that coplanar neighbours and coincident
    /// triangles that face the other way are not hit either.
    fn step_off(&self, point: Vec3, direction: Vec3, triangle: u32) -> Vec3 {
        let Some(normal) = self.surfaces.normals.get(triangle as usize) else { return point };
        let size = point.abs().max_element() * (8.0 * f32::EPSILON);
        point + *normal * size.copysign(normal.dot(direction))
    }
}

struct Tile {
    /// Sums of the samples of a tile.
    pixels: Vec<[f64; 3]>,
    non_finite: u64,
    rays: u64,
}
