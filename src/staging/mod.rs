//! What a picture needs and a scene file may leave out: a camera and light.
//!
//! [`load`] is the front door: it reads a file ([`crate::scene::load_under`]) and completes it. [`camera`] chooses where to stand,
//! [`light`] what to add where the file brings no light, or none that shows what the camera sees. Both ask the CPU reference, by some
//! ten thousand rays. A scene that has both is left as it is.

pub mod camera;
pub mod light;

use glam::Vec3;

use crate::reference::Reference;
use crate::scene::{self, Camera, EnvironmentChange, Geometry, LoadError, Scene};

use self::camera::Subject;
use self::light::Added;

/// What is asked for beside the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Staging {
    /// In place of the file's own environment.
    pub environment: EnvironmentChange,
    /// The camera that will be used: chosen, or one of the file's, the first where it has not got that one.
    pub camera: CameraChoice,
    /// Where the camera will be moved to and what it will look at, metres, if it is.
    pub stand: Option<[Vec3; 2]>,
    /// Columns and rows of the image; a camera that is chosen fits its shape.
    pub size: [u32; 2],
}

impl Default for Staging {
    fn default() -> Self {
        let environment = EnvironmentChange::default();
        Self { environment, camera: CameraChoice::default(), stand: None, size: [1, 1] }
    }
}

/// Which camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum CameraChoice {
    /// The file's first one; one that is chosen where it has none.
    #[default]
    First,
    /// The file's, by name or index.
    Named(String),
    /// One that is chosen, also where the file has some.
    Auto,
}

impl CameraChoice {
    /// The index of the camera among those of a scene that [`complete`] has been at, if it is there.
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

/// Loads a scene and completes it: the result has a camera and, unless it was asked for none, light.
///
/// # Errors
/// As [`scene::load_under`].
pub fn load(spec: &str, staging: &Staging) -> Result<Scene, LoadError> {
    let mut scene = scene::load_under(spec, &staging.environment)?;
    complete(&mut scene, staging)?;
    Ok(scene)
}

/// Adds what a scene lacks, and a note for each thing that was added. A camera that was chosen is the last one.
///
/// # Errors
/// None that a scene which loaded has.
pub fn complete(scene: &mut Scene, staging: &Staging) -> Result<(), LoadError> {
    let chooses = scene.cameras.is_empty() || staging.camera == CameraChoice::Auto;
    let lights = !staging.environment.is_none();
    if !chooses && (!lights || scene.environment.is_some()) {
        return Ok(());
    }
    let mut reference = Reference::new(scene);
    let chosen = chooses.then(|| camera::choose(&reference, &points(scene, reference.geometry()), staging.size));
    let shines = light::shines(scene);
    let added =
        chosen.as_ref().map(|(camera, _)| camera).or_else(|| scene.cameras.get(staging.camera.index(&scene.cameras)?));
    let added = added.or(scene.cameras.first()).filter(|_| lights).and_then(|camera| {
        let moved = staging.stand.and_then(|[eye, target]| camera.clone().looking(eye, target));
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
        let why = if shines { "what shines in the scene hardly lights it" } else { "the scene has no light" };
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

/// Poses of an animation that are framed, and the most vertices of all of them together.
const POSES: usize = 12;
const MOST_POINTS: usize = 4_000_000;

/// All places where vertices are, at rest and in the first animation.
fn points(scene: &Scene, geometry: &Geometry) -> Vec<Vec3> {
    let of = |geometry: &Geometry| geometry.vertices.iter().map(|v| v.position).collect::<Vec<_>>();
    let mut points = of(geometry);
    let animation = scene.rig.as_ref().and_then(|rig| rig.animations.first());
    let Some(seconds) = animation.map(scene::animation::Animation::seconds) else { return points };
    let poses = POSES.min(MOST_POINTS / points.len().max(1));
    for pose in 0..poses {
        // One that cannot be posed is said when it is rendered.
        if let Ok(posed) = scene.at(0, seconds * (pose as f32 + 0.5) / poses as f32) {
            points.extend(of(&Geometry::new(&posed)));
        }
    }
    points
}
