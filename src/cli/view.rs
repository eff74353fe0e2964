//! Options of `render`, `view` and `plan`: scene, camera, environment, animation and settings.

use std::borrow::Cow;
use std::sync::Arc;

use anyhow::{Result, anyhow, bail};
use glam::{Affine3A, Vec3};

use crate::exposure::Exposure;
use crate::render::adapt::{adapted, warnings};
use crate::scene::{self, Camera, EnvironmentChange, FovAxis, Projection, Scene, Viewpoint};
use crate::settings::Settings;
use crate::staging::{self, CameraChoice, Staging};
use crate::tonemap::Tonemap;

/// Arguments that select the scene, its camera and light, and the settings.
#[derive(Clone, clap::Args)]
pub struct ViewArgs {
    /// Scene file or builtin:NAME; `lightsheaf scenes` lists both
    pub scene: String,
    /// Width and height of the image in pixels, 1 to 16384 each [default: the camera's film size if the scene
    /// has one, otherwise 512x512]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<(u32, u32)>,
    #[command(flatten)]
    pub settings: Settings,
    /// Camera of the scene, by its name or its index from 0. `auto` places a camera, as for scenes without
    /// one. `render` takes several, each by an option of its own, if the outputs have {camera} in their names
    /// [default: the first camera]
    #[arg(long, value_name = "NAME-OR-INDEX", help_heading = CAMERA)]
    pub camera: Vec<String>,
    /// Position of the camera in metres, +Y up
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "target", help_heading = CAMERA)]
    pub eye: Option<Vec3>,
    /// Point that the camera at --eye looks at, in metres, +Y up
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "eye", help_heading = CAMERA)]
    pub target: Option<Vec3>,
    /// Full angle of view along the image's shorter side in degrees, 0.01 to less than 180 [default: the
    /// camera's own]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, help_heading = CAMERA)]
    pub fov: Option<f32>,
    /// Time of the animation in seconds, 0 to 1000000. Before the first and after the last key the scene
    /// stands still [default: the rest pose]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, help_heading = ANIMATION)]
    pub at: Option<f64>,
    /// Animation for --at and --frames, by its name or its index from 0 [default: the first]
    #[arg(long, value_name = "NAME-OR-INDEX", help_heading = ANIMATION)]
    pub animation: Option<String>,
    /// Variant of the materials of a glTF file (KHR_materials_variants) [default: the file's own materials]
    #[arg(long, value_name = "NAME", help_heading = SCENE)]
    pub variant: Option<String>,
    /// Environment in place of the scene's own: an equirectangular image (.hdr, .exr);
    /// sky:ELEVATION[,TURBIDITY], a clear sky over grey ground with the sun in the direction of +Z, ELEVATION
    /// in degrees above the horizon, TURBIDITY 1 to 10, default 3; studio, soft light from three sides; or
    /// none [default: if the scene has no sufficient light, studio, or sky and sun]
    #[arg(long, value_name = "FILE", allow_hyphen_values = true, help_heading = ENVIRONMENT)]
    pub env: Option<String>,
    /// Factor of the environment's radiance, 0 to 1000000, for the scene's own or that of --env, including a
    /// sky's sun
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, help_heading = ENVIRONMENT)]
    pub env_scale: Option<f32>,
    /// Rotation of the environment about +Y in degrees, -360 to 360, counter-clockwise seen from above,
    /// including a sky's sun
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, help_heading = ENVIRONMENT)]
    pub env_rotate: Option<f32>,
    /// The scene's file in memory, if it was loaded before.
    #[arg(skip)]
    pub loaded: Option<Arc<LoadedFile>>,
}

/// A scene as its file describes it, without the camera and the light that are added to it.
pub struct LoadedFile {
    pub scene: Scene,
    /// What it was loaded by.
    source: Source,
}

/// What the contents of a scene's file depend on: its name, the variant of its materials and its environment.
type Source = (String, Option<String>, EnvironmentChange);

/// Display options of `render` and `view`.
#[derive(Clone, clap::Args)]
pub struct GradeArgs {
    /// Exposure of the .png and the window in stops, -32 to 32: values are multiplied by 2^STOPS. `auto` maps
    /// the log-average luminance to middle grey, 0.18 [default: auto]
    #[arg(long, value_name = "auto|STOPS", allow_negative_numbers = true)]
    pub exposure: Option<Exposure>,
    /// Tone curve of the .png and the window. An .exr stays linear [default: agx]
    #[arg(long, value_name = "CURVE")]
    pub tonemap: Option<Tonemap>,
}

impl GradeArgs {
    /// Returns the exposure and the tone curve, or their defaults.
    pub fn chosen(&self) -> (Exposure, Tonemap) {
        (self.exposure.unwrap_or_default(), self.tonemap.unwrap_or_default())
    }
}

const CAMERA: &str = "Camera";
pub const ANIMATION: &str = "Animation";
const ENVIRONMENT: &str = "Environment";
const SCENE: &str = "Scene";

/// Loaded scene with its completed settings.
pub struct View {
    pub scene: Scene,
    pub settings: Settings,
    /// Index, name and length of each animation of the file.
    pub animations: Vec<String>,
}

/// A turn of a camera about a vertical axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Point on the axis.
    pub about: Vec3,
    /// Angle in degrees, counter-clockwise seen from above.
    pub degrees: f64,
}

impl Turn {
    fn apply(self, camera: &mut Camera) {
        let Self { about, degrees } = self;
        // The first view of a turntable is that of the camera, bit for bit.
        if degrees != 0.0 {
            let turn = Affine3A::from_rotation_y(degrees.to_radians() as f32);
            let (there, back) = (Affine3A::from_translation(about), Affine3A::from_translation(-about));
            camera.world_from_camera = there * turn * back * camera.world_from_camera;
        }
    }
}

impl ViewArgs {
    /// Loads, poses and completes the scene, prints its warnings, and completes the settings.
    pub fn load(&self) -> Result<View> {
        let (scene, mut settings) = self.open()?;
        let animations = animations(&scene);
        let scene = self.complete(self.pose(scene)?, &mut settings, None)?;
        warn(&scene);
        Ok(View { scene, settings, animations })
    }

    /// Poses the scene at the time of `--at`, if that is given.
    pub fn pose(&self, scene: Scene) -> Result<Scene> {
        match (self.at, &self.animation) {
            (Some(seconds), _) => self.at("--at", &scene, seconds),
            (None, Some(animation)) => bail!("--animation {animation}: at which time? Give --at SECONDS or --frames"),
            (None, None) => Ok(scene),
        }
    }

    /// Checks the settings and loads the scene in its rest pose.
    pub fn open(&self) -> Result<(Scene, Settings)> {
        let mut settings = self.settings.clone();
        if let Some(size) = self.size {
            (settings.width, settings.height) = size;
        }
        // The check comes first, since loading a large scene takes long. The scene may say the size of the image.
        Settings { crop: settings.crop.filter(|_| self.size.is_some()), ..settings.clone() }.check()?;
        let staging = self.staging([settings.width, settings.height])?;
        let source = self.source()?;
        let mut scene = match &self.loaded {
            Some(loaded) if loaded.source == source => loaded.scene.clone(),
            _ => self.load_file()?.scene,
        };
        staging::complete(&mut scene, &staging)?;
        Ok((scene, settings))
    }

    /// Loads the scene's file.
    pub fn load_file(&self) -> Result<LoadedFile> {
        let source = self.source()?;
        Ok(LoadedFile { scene: scene::load_with(&source.0, source.1.as_deref(), &source.2)?, source })
    }

    /// Returns what the contents of the scene's file depend on.
    fn source(&self) -> Result<Source> {
        Ok((self.scene.clone(), self.variant.clone(), self.environment()?))
    }

    /// Returns the camera and environment that the arguments request in place of the scene's, for an image
    /// size.
    pub fn staging(&self, size: [u32; 2]) -> Result<Staging> {
        let camera = match self.camera.as_slice() {
            [] => CameraChoice::First,
            [name] if name == "auto" => CameraChoice::Auto,
            [name] => CameraChoice::Named(name.clone()),
            [_, ..] => bail!("--camera: several are for `render`; give one"),
        };
        let eye_and_target = self.eye.zip(self.target).map(|(eye, target)| [eye, target]);
        let variant = self.variant.clone();
        Ok(Staging { variant, environment: self.environment()?, camera, eye_and_target, size })
    }

    /// Poses the scene by the selected animation at a time in seconds. Errors name `option`.
    pub fn at(&self, option: &str, scene: &Scene, seconds: f64) -> Result<Scene> {
        if !(0.0..=1e6).contains(&seconds) {
            bail!("{option}: {seconds} s has to be 0 to 1000000 s");
        }
        Ok(scene.at(self.pick_animation(option, scene)?, seconds as f32)?)
    }

    /// Places the camera, turns it, completes the settings from the scene, and adapts the scene to them.
    pub fn complete(&self, mut scene: Scene, settings: &mut Settings, turn: Option<Turn>) -> Result<Scene> {
        settings.camera = self.pick_camera(&scene)?;
        self.place_camera(&mut scene, settings.camera)?;
        if let Some(turn) = turn {
            turn.apply(&mut scene.cameras[settings.camera]);
        }
        if let (None, Some(size)) = (self.size, scene.cameras[settings.camera].film_size) {
            (settings.width, settings.height) = size;
        }
        settings.check()?;
        if let Cow::Owned(adapted) = adapted(&scene, settings)? {
            scene = adapted;
        }
        scene.warnings = warnings(&scene, settings);
        scene.viewpoint = Some(Viewpoint { camera: settings.camera, size: [settings.width, settings.height] });
        Ok(scene)
    }

    /// Returns the change of the environment that the arguments request.
    fn environment(&self) -> Result<EnvironmentChange> {
        if let Some(scale) = self.env_scale.filter(|s| !(0.0..=1e6).contains(s)) {
            bail!("--env-scale {scale}: has to be 0 to 1000000");
        }
        if let Some(degrees) = self.env_rotate.filter(|d| !(-360.0..=360.0).contains(d)) {
            bail!("--env-rotate {degrees}: has to be -360 to 360 degrees");
        }
        Ok(EnvironmentChange {
            source: self.env.clone(),
            scale: self.env_scale,
            rotate: self.env_rotate.map(f32::to_radians),
        })
    }

    /// Returns the index of the selected camera.
    fn pick_camera(&self, scene: &Scene) -> Result<usize> {
        let staging = self.staging([1, 1])?;
        staging.camera.index(&scene.cameras).ok_or_else(|| {
            let known = scene.cameras.iter().enumerate().map(|(i, c)| format!("{i} `{}`", c.name));
            let wanted = self.camera.join(", ");
            anyhow!("--camera {wanted}: is not in the scene, which has {}", known.collect::<Vec<_>>().join(", "))
        })
    }

    /// Returns the index of the selected animation. Errors name `option`.
    fn pick_animation(&self, option: &str, scene: &Scene) -> Result<usize> {
        let Some(rig) = &scene.rig else {
            match &self.animation {
                None if scene.moves() => return Ok(0),
                _ => bail!("{option}: {} has no animation", self.scene),
            }
        };
        let Some(wanted) = &self.animation else { return Ok(0) };
        let named = rig.animations.iter().position(|a| a.name == *wanted);
        let numbered = || wanted.parse().ok().filter(|&i: &usize| i < rig.animations.len());
        named.or_else(numbered).ok_or_else(|| {
            anyhow!("--animation {wanted}: is not in the scene, which has {}", animations(scene).join(", "))
        })
    }

    /// Applies `--eye`, `--target` and `--fov` to a camera.
    fn place_camera(&self, scene: &mut Scene, index: usize) -> Result<()> {
        let camera = &mut scene.cameras[index];
        if let (Some(eye), Some(target)) = (self.eye, self.target) {
            let Some(moved) = camera.clone().looking(eye, target) else {
                bail!("--eye {eye} --target {target}: the distance between them has to be greater than 0");
            };
            *camera = moved;
        }
        if let Some(degrees) = self.fov {
            if !(0.01..180.0).contains(&degrees) {
                bail!("--fov {degrees}: has to be at least 0.01 and below 180 degrees");
            }
            camera.projection = Projection::Perspective { fov: degrees.to_radians(), axis: FovAxis::Smaller };
        }
        Ok(())
    }
}

/// Lists index, name and length of each animation of a scene.
pub fn animations(scene: &Scene) -> Vec<String> {
    let all = scene.rig.iter().flat_map(|rig| &rig.animations).enumerate();
    all.map(|(i, a)| format!("{i} `{}` ({:.2} s)", a.name, a.seconds())).collect()
}

/// Prints a scene's warnings (unsupported content) and notes (added camera and light).
pub fn warn(scene: &Scene) {
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
}

/// Parses `640x360`.
pub fn parse_size(text: &str) -> Result<(u32, u32), &'static str> {
    let size = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    size.ok_or("a size is columns x rows, such as 640x360")
}

/// Parses `X,Y,Z`.
fn parse_point(text: &str) -> Result<Vec3, &'static str> {
    let numbers: Option<Vec<f32>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f32| n.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Vec3::new(x, y, z)),
        _ => Err("a point is three numbers with commas between them, such as 0,1.5,-3"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_points_are_parsed() {
        assert_eq!(parse_size("640x360"), Ok((640, 360)));
        for bad in ["", "640", "640x", "x360", "-1x2", "1.5x2", "640x360x2", "640X360"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_point("0, 1.5,-3e1"), Ok(Vec3::new(0.0, 1.5, -30.0)));
        for bad in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan", "inf,0,0"] {
            assert!(parse_point(bad).is_err(), "{bad}");
        }
    }
}
