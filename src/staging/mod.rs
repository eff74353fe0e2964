//! Completes a scene with a camera and light if its file has none, and moves a camera around it.
//!
//! [`load`] reads a file ([`crate::scene::load_with`]) and completes it. [`camera`] chooses the camera;
//! [`light`] chooses light for scenes without any, or without any that illuminates the camera's view. Both
//! use the CPU reference with about ten thousand rays. A scene that has both is not changed.

pub mod camera;
mod ground;
pub mod light;
mod orbit_camera;

use glam::Vec3;

use crate::reference::Reference;
use crate::scene::{self, Camera, EnvironmentChange, Geometry, LoadError, Scene};

use self::camera::Subject;
use self::light::Added;

pub use orbit_camera::OrbitCamera;

/// Options for completing a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Staging {
    /// Variant of the file's materials; without a name, the file's own choice.
    pub variant: Option<String>,
    /// Environment in place of the file's own.
    pub environment: EnvironmentChange,
    /// Camera that will be used: the automatic one or one of the file's; the first if the chosen one does not
    /// exist.
    pub camera: CameraChoice,
    /// Position and target that the camera is moved to, metres.
    pub eye_and_target: Option<[Vec3; 2]>,
    /// Columns and rows of the image, whose shape determines the framing of an automatic camera.
    pub size: [u32; 2],
}

impl Default for Staging {
    fn default() -> Self {
        let environment = EnvironmentChange::default();
        Self { variant: None, environment, camera: CameraChoice::default(), eye_and_target: None, size: [1, 1] }
    }
}

/// Choice of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum CameraChoice {
    /// The file's first camera, or an automatic one if it has none.
    #[default]
    First,
    /// The file's camera of this name or index.
    Named(String),
    /// An automatic camera, even if the file has cameras.
    Auto,
}

impl CameraChoice {
    /// Returns the index of the camera in a scene that [`complete`] has processed; none if there is no such
    /// camera.
    #[must_use]
    pub fn index(&self, cameras: &[Camera]) -> Option<usize> {
        match self {
            Self::First => Some(0),
            Self::Auto => cameras.len().checked_sub(1),
            Self::Named(name) => {
                let numbered = || name.parse().ok().filter(|&i: &usize| i < cameras.len());
                cameras.iter().position(|c| c.name == *name).or_else(numbered)
            }
        }
    }
}

/// Loads and completes a scene: the result has a camera and, unless the options exclude it, light.
///
/// # Errors
/// Returns an error under the conditions of [`scene::load_with`].
pub fn load(spec: &str, staging: &Staging) -> Result<Scene, LoadError> {
    let mut scene = scene::load_with(spec, staging.variant.as_deref(), &staging.environment)?;
    complete(&mut scene, staging)?;
    Ok(scene)
}

/// Adds the missing camera and light, with a note for each. An automatic camera is the last one of the scene.
///
/// # Errors
/// Returns an error if an environment cannot be loaded, which does not occur for scenes that were loaded.
pub fn complete(scene: &mut Scene, staging: &Staging) -> Result<(), LoadError> {
    let chooses = scene.cameras.is_empty() || staging.camera == CameraChoice::Auto;
    let lights = !staging.environment.is_none();
    if !chooses && (!lights || scene.environment.is_some()) {
        return Ok(());
    }
    let mut reference = Reference::new(scene);
    let chosen = chooses.then(|| camera::choose(&reference, &posed(scene, reference.geometry()), staging.size));
    let emits_light = light::emits_light(scene);
    let added =
        chosen.as_ref().map(|(camera, _)| camera).or_else(|| scene.cameras.get(staging.camera.index(&scene.cameras)?));
    let added = added.or(scene.cameras.first()).filter(|_| lights).and_then(|camera| {
        let moved = staging.eye_and_target.and_then(|[eye, target]| camera.clone().looking(eye, target));
        let camera = moved.as_ref().unwrap_or(camera);
        light::lacks(scene, &mut reference, camera).then(|| light::choose(&reference, camera))
    });
    if let Some((camera, subject)) = chosen {
        let why = if scene.cameras.is_empty() { "the scene has no camera: one" } else { "a camera" };
        let how = match subject {
            Subject::Empty => "is added; there is nothing to see",
            Subject::Object => "is added that frames it",
            Subject::Flat => "is added that looks at its front",
            Subject::Stage => "is added that looks into it",
            Subject::Room => "is added inside the room",
        };
        scene.note(format!("{why} {how}"));
        scene.cameras.push(camera);
    }
    if let Some(added) = added {
        let why =
            if emits_light { "the lights of the scene hardly illuminate the view" } else { "the scene has no light" };
        let what = match &added {
            Added::Environment { source, rotate: 0.0 } => format!("--env {source}"),
            Added::Environment { source, rotate } => format!("--env {source} --env-rotate {rotate}"),
            Added::Lamp(_) => "a lamp in the room".to_owned(),
        };
        scene.note(format!("{why}: {what} is added; --env none leaves it out"));
        added.apply(scene)?;
    }
    Ok(())
}

/// Number of poses of an animation that are framed, and the largest number of their vertices.
const POSES: usize = 12;
const MOST_POINTS: usize = 4_000_000;

/// Returns the positions of what a picture is about during the first animation. `rest` is the rest pose.
fn posed(scene: &Scene, rest: &Geometry) -> Vec<Vec3> {
    let mut points = Vec::new();
    let animation = scene.rig.as_ref().and_then(|rig| rig.animations.first());
    let Some(seconds) = animation.map(scene::animation::Animation::seconds) else { return points };
    let poses = POSES.min(MOST_POINTS / rest.vertices.len().max(1));
    for pose in 0..poses {
        // A pose that cannot be evaluated is reported when it is rendered.
        if let Ok(posed) = scene.at(0, seconds * (pose as f32 + 0.5) / poses as f32) {
            points.extend(camera::subject_points(&Geometry::new(&posed)));
        }
    }
    points
}
