//! Adds light to scenes that bring none, or none that shows what the camera sees.
//!
//! A small picture by the reference says how much of what the camera sees the scene's own light reaches.

use glam::{Mat3, Vec3};

use super::camera::{self, Seen};
use crate::reference::{Reference, ReferenceSettings};
use crate::scene::{Camera, EnvironmentChange, Instance, LUMINANCE, Lamp, Light, LoadError, Scene};

/// Columns, rows and samples of the small picture.
const SIDE: u32 = 24;
const SAMPLES: u32 = 32;

/// A pixel is lit that has this share of the luminance of the bright ones, those at this quantile, and this share of that of the
/// brightest emission: the eyes of a toy light nothing, however long one exposes.
const LIT: f32 = 0.02;
const BRIGHT: f32 = 0.98;
const OF_EMITTERS: f32 = 1e-4;

/// Share of what the camera sees that a scene's own light has to reach.
const ENOUGH: f32 = 0.1;

/// Share of the directions around what is seen that have to be open for daylight in a room.
const OPEN: f32 = 0.002;

/// Metres along the shorter horizontal side from which on a scene is large, and the most that it may be high in shares of it: grounds,
/// not things in centimetres.
const LARGE: f32 = 10.0;
const LOW: f32 = 0.6;

/// Light for a scene that lacks some.
#[derive(Clone, Debug, PartialEq)]
pub enum Added {
    /// An environment, as the options `--env` and `--env-rotate` ask for it.
    Environment {
        /// `studio` or `sky:ELEVATION`.
        source: String,
        /// Degrees.
        rotate: f32,
    },
    /// A lamp below the ceiling of a closed room.
    Lamp(Lamp),
}

impl Added {
    /// Adds it to a scene.
    ///
    /// # Errors
    /// None that this program's own environments have.
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

/// Says whether anything in the scene gives light.
pub(super) fn shines(scene: &Scene) -> bool {
    scene.environment.is_some()
        || scene.lights.iter().any(|light| !light.is_black(&scene.patterns))
        || emissions(scene).next().is_some()
}

/// Radiances of the surfaces that emit any; textures are taken to be white.
fn emissions(scene: &Scene) -> impl Iterator<Item = Vec3> {
    let of = |instance: &Instance| scene.materials[scene.meshes[instance.mesh].material].emission;
    scene.instances.iter().filter_map(of).map(|emission| emission.radiance.factor).filter(|&r| r != Vec3::ZERO)
}

/// Says whether a scene lacks light for a camera of it: it has none, or its own reaches less than a tenth of what the camera sees. A
/// scene with an environment lacks none.
#[must_use]
pub fn lacks(scene: &Scene, reference: &mut Reference, camera: &Camera) -> bool {
    if scene.environment.is_some() {
        return false;
    }
    if !shines(scene) {
        return true;
    }
    reference.look(camera.clone());
    let settings =
        ReferenceSettings { width: SIDE, height: SIDE, samples: SAMPLES, bounces: Some(1), seed: 1, camera: 0 };
    let picture = reference.render(&settings, &|_, _| ()).film;
    let rays = camera::rays(camera, [SIDE, SIDE], [SIDE, SIDE]);
    // What each pixel's middle sees: nothing, or whether it emits.
    let emits: Vec<Option<bool>> = rays
        .map(|(origin, direction)| {
            reference.first_hit(origin, direction).map(|hit| reference.emitted(&hit, direction) != Vec3::ZERO)
        })
        .collect();
    let brightest = emissions(scene).map(|radiance| radiance.dot(LUMINANCE)).fold(0.0, f32::max);
    // Pixels beside an emitter may show it, too.
    let beside = |at: usize| {
        let [x, y] = [at as u32 % SIDE, at as u32 / SIDE].map(|at| at.saturating_sub(1)..(at + 2).min(SIDE));
        y.flat_map(|y| x.clone().map(move |x| y * SIDE + x)).any(|at| emits[at as usize] == Some(true))
    };
    let reflecting = (0..emits.len()).filter(|&at| emits[at].is_some() && !beside(at));
    let luminances = reflecting.map(|at| Vec3::from(picture.pixels[at]).dot(LUMINANCE));
    let mut luminances: Vec<f32> = luminances.collect();
    if luminances.is_empty() {
        return false;
    }
    luminances.sort_by(f32::total_cmp);
    let at = |share: f32| luminances[((luminances.len() - 1) as f32 * share) as usize];
    let enough = (LIT * at(BRIGHT)).max(OF_EMITTERS * brightest);
    let lit = luminances.iter().filter(|&&l| l > enough).count();
    (lit as f32) < ENOUGH * luminances.len() as f32
}

/// Chooses light for a camera: a lamp in a closed room, sky and sun in one with openings and for large scenes, a studio for all else.
#[must_use]
pub fn choose(reference: &Reference, camera: &Camera) -> Added {
    let back = Vec3::from(camera.world_from_camera.matrix3.z_axis);
    let facing = back.x.atan2(back.z).to_degrees();
    let [low, high] = reference.geometry().bounds;
    let extent = high - low;
    let side = extent.x.min(extent.z);
    let (source, rotate) = if camera::is_inside(reference, camera) {
        let seen = camera::seen(reference, camera, 16);
        let Some((elevation, azimuth)) = sun_through_openings(reference, &seen) else {
            return Added::Lamp(lamp(reference, camera));
        };
        (format!("sky:{elevation}"), azimuth)
    } else if side > LARGE && extent.y < LOW * side {
        // From the left, and a little from the front.
        ("sky:45".to_owned(), (facing - 60.0).round())
    } else {
        ("studio".to_owned(), facing.round())
    };
    Added::Environment { source, rotate: (rotate + 540.0).rem_euclid(360.0) - 180.0 }
}

/// Elevation and azimuth, degrees, of the sun that reaches most of what is seen; nothing where the room is closed.
fn sun_through_openings(reference: &Reference, seen: &[Seen]) -> Option<(f32, f32)> {
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

/// A lamp below the ceiling, over the middle of what the camera sees.
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
