//! Adds light to scenes that have none, or none that illuminates the camera's view.
//!
//! A small picture by the reference measures the fraction of the view that the scene's own light illuminates.

use glam::{Mat3, Vec3};

use super::camera::{self, VisiblePoint};
use crate::reference::{Reference, ReferenceSettings};
use crate::scene::{Camera, EnvironmentChange, Instance, LUMINANCE, Lamp, Light, LoadError, Scene};

/// Columns and rows, and samples per pixel, of the small picture.
const SIDE: u32 = 48;
const SAMPLES: u32 = 16;

/// A pixel is lit if its luminance exceeds this fraction of the luminance at this quantile, and this fraction
/// of the brightest emission's luminance.
const LIT: f32 = 0.02;
const BRIGHT: f32 = 0.98;
const OF_EMITTERS: f32 = 1e-4;

/// Largest luminance of emission, in W/(m^2 sr), that may belong to a detail that glows: ten times the white of
/// files whose light has no unit. Brighter emitters are lamps, however small.
const GLOW: f32 = 10.0;

/// Least fraction of the visible surfaces that a scene's own light has to illuminate.
const ENOUGH: f32 = 0.1;

/// Light is added where at least this fraction of the visible surfaces does not glow. Where nearly all do, such as in a
/// room of unlit surfaces, that is the picture.
const REFLECTING: f32 = 0.1;

/// `OF_EMITTERS` and `ENOUGH` for scenes whose only light is what glows, such as the eyes of a toy: beside
/// what is white, 3e-3 of it, which is 10 of 255 in sRGB, looks black.
const OF_GLOW: f32 = 3e-3;
const ENOUGH_GLOW: f32 = 0.5;

/// Least fraction of open directions around the visible points of a room for daylight.
const OPEN: f32 = 0.002;

/// Shorter horizontal side of a large scene, metres, and its largest height relative to it. The second
/// condition excludes objects in centimetres.
const LARGE: f32 = 10.0;
const LOW: f32 = 0.6;

/// Light that is added to a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum Added {
    /// An environment, in the format of the options `--env` and `--env-rotate`.
    Environment {
        /// `studio` or `sky:ELEVATION`.
        source: String,
        /// Rotation about +Y, degrees.
        rotate: f32,
    },
    /// A lamp below the ceiling of a closed room.
    Lamp(Lamp),
}

impl Added {
    /// Adds the light to a scene.
    ///
    /// # Errors
    /// Returns an error if the environment cannot be loaded, which does not occur for this program's own
    /// ones.
    pub fn apply(&self, scene: &mut Scene) -> Result<(), LoadError> {
        match self {
            Self::Environment { source, rotate } => {
                let rotate = Some(*rotate).filter(|&degrees| degrees != 0.0).map(f32::to_radians);
                EnvironmentChange { source: Some(source.clone()), scale: None, rotate }.apply(scene)
            }
            Self::Lamp(lamp) => {
                scene.lights.push(Light::Lamp(*lamp));
                Ok(())
            }
        }
    }
}

/// Returns true if anything in the scene emits light.
pub(super) fn emits_light(scene: &Scene) -> bool {
    scene.environment.is_some()
        || scene.lights.iter().any(|light| !light.is_black(&scene.patterns))
        || emissions(scene).next().is_some()
}

/// Returns the radiance of emissive surfaces; textures are taken to be white.
fn emissions(scene: &Scene) -> impl Iterator<Item = Vec3> {
    let of = |instance: &Instance| scene.materials[scene.meshes[instance.mesh].material].emission;
    scene.instances.iter().filter_map(of).map(|emission| emission.radiance.factor).filter(|&r| r != Vec3::ZERO)
}

/// Returns true if a scene has no light, or its own illuminates too little of the camera's view. Scenes with an
/// environment, and those whose format says their light, are not checked.
#[must_use]
pub fn lacks(scene: &Scene, reference: &mut Reference, camera: &Camera) -> bool {
    if scene.environment.is_some() {
        return false;
    }
    if !emits_light(scene) {
        return true;
    }
    if scene.says_its_light {
        return false;
    }
    reference.look(camera.clone());
    // Light of a lamp behind glass has passed two surfaces when it is first reflected.
    let bounces = Some(if scene.materials.iter().any(|m| m.transmits()) { 5 } else { 1 });
    let settings = ReferenceSettings {
        width: SIDE,
        height: SIDE,
        samples: SAMPLES,
        bounces,
        specular_bounces: 0,
        seed: 1,
        camera: 0,
    };
    let picture = reference.render(&settings, &|_, _| ()).film;
    // By the same rays, so that what is seen to glow beside or within a pixel is no part of what it reflects.
    reference.scatter(false);
    let emission = reference.render(&settings, &|_, _| ()).film;
    reference.scatter(true);
    let rays = camera::rays(camera, [SIDE, SIDE], [SIDE, SIDE]);
    let brightest = emissions(scene).map(|radiance| radiance.dot(LUMINANCE)).fold(0.0, f32::max);
    let glows = brightest <= GLOW && scene.lights.iter().all(|light| light.is_black(&scene.patterns));
    let (of_emitters, share) = if glows { (OF_GLOW, ENOUGH_GLOW) } else { (OF_EMITTERS, ENOUGH) };
    let visible = of_emitters * brightest.min(GLOW);
    // Of the surfaces at the pixels' centres, those that emit no more than the noise of a black texture.
    let mut surfaces = 0;
    let mut luminances = Vec::new();
    for ((origin, direction), (&all, &seen)) in rays.zip(picture.pixels.iter().zip(&emission.pixels)) {
        let Some(hit) = reference.first_hit(origin, direction) else { continue };
        surfaces += 1;
        if reference.emitted(&hit, direction).dot(LUMINANCE) <= visible {
            luminances.push((Vec3::from(all) - Vec3::from(seen)).dot(LUMINANCE));
        }
    }
    if luminances.is_empty() || (luminances.len() as f32) < REFLECTING * surfaces as f32 {
        return false;
    }
    luminances.sort_by(f32::total_cmp);
    let at = |share: f32| luminances[((luminances.len() - 1) as f32 * share) as usize];
    let enough = if glows { visible } else { visible.max(LIT * at(BRIGHT)) };
    let lit = luminances.iter().filter(|&&l| l > enough).count();
    log::debug!("light: {lit} of {} visible points are lit; of glow: {glows}", luminances.len());
    (lit as f32) < share * luminances.len() as f32
}

/// Chooses light for a camera: a lamp in a closed room, sky and sun in a room with openings and for large
/// scenes, otherwise a studio.
#[must_use]
pub fn choose(reference: &Reference, camera: &Camera) -> Added {
    let back = Vec3::from(camera.world_from_camera.matrix3.z_axis);
    let facing = back.x.atan2(back.z).to_degrees();
    let [low, high] = reference.geometry().bounds;
    let extent = high - low;
    let side = extent.x.min(extent.z);
    let (source, rotate) = if camera::is_inside(reference, camera) {
        let seen = camera::visible_points(reference, camera, 16);
        let Some((elevation, azimuth)) = sun_through_openings(reference, &seen) else {
            return Added::Lamp(lamp(reference, camera));
        };
        (format!("sky:{elevation}"), azimuth)
    } else if side > LARGE && extent.y < LOW * side {
        // The sun shines from the left and a little from the front.
        ("sky:45".to_owned(), (facing - 60.0).round())
    } else {
        ("studio".to_owned(), facing.round())
    };
    Added::Environment { source, rotate: (rotate + 540.0).rem_euclid(360.0) - 180.0 }
}

/// Returns elevation and azimuth in degrees of the sun that reaches most of the visible points; none if the
/// room is closed.
fn sun_through_openings(reference: &Reference, seen: &[VisiblePoint]) -> Option<(f32, f32)> {
    let open = |direction: Vec3| seen.iter().filter(|point| point.is_open(reference, direction)).count();
    let around: Vec<Vec3> = camera::sphere(64).collect();
    let free: usize = around.iter().map(|&direction| open(direction)).sum();
    if (free as f32) <= OPEN * (seen.len() * around.len()) as f32 {
        return None;
    }
    let suns = [35.0, 50.0, 65.0].into_iter().flat_map(|e| (0..24).map(move |a| (e, 15.0 * a as f32)));
    let reached = suns.map(|(elevation, azimuth)| (open(camera::direction(azimuth, elevation)), (elevation, azimuth)));
    reached.reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, sun)| sun)
}

/// Returns a lamp below the ceiling, above the middle of the camera's view.
fn lamp(reference: &Reference, camera: &Camera) -> Lamp {
    let eye = Vec3::from(camera.world_from_camera.translation);
    let forward = -Vec3::from(camera.world_from_camera.matrix3.z_axis);
    let free = |from: Vec3, direction: Vec3| reference.closest_hit(from, direction, None).map_or(0.0, |hit| hit.t);
    let depth = free(eye, forward);
    let middle = eye + forward * (0.4 * depth);
    let above = free(middle, Vec3::Y);
    let distance = depth.max(above).max(f32::MIN_POSITIVE);
    Lamp {
        position: middle + Vec3::Y * (0.8 * above),
        world_from_lamp: Mat3::IDENTITY,
        radius: 0.1 * above,
        intensity: Vec3::splat(distance * distance),
        cone: None,
        pattern: None,
    }
}
