//! What `render`, `view` and `plan` share: which scene, seen from where, with which settings.

use anyhow::{Result, anyhow, bail};
use glam::Vec3;

use lightsheaf::scene::{EnvironmentChange, FovAxis, Projection, Scene, Viewpoint};
use lightsheaf::settings::Settings;
use lightsheaf::staging::{self, CameraChoice, Staging};
use lightsheaf::tonemap::{Exposure, Tonemap};

/// Scene, camera and settings.
#[derive(clap::Args)]
pub struct ViewArgs {
    /// A .gltf, .glb or Mitsuba .xml file, or builtin:NAME (see `lightsheaf scenes`)
    pub scene: String,
    /// Columns and rows of the image [default: the camera's film size if the scene has one, otherwise 512x512]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<(u32, u32)>,
    #[command(flatten)]
    pub settings: Settings,
    /// A camera of the scene by its name or its index from 0, or `auto`: one that is chosen, as for scenes without a camera
    /// [default: the first]
    #[arg(long, value_name = "NAME-OR-INDEX", help_heading = CAMERA)]
    pub camera: Option<String>,
    /// Stand here instead, in metres
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "target", help_heading = CAMERA)]
    pub eye: Option<Vec3>,
    /// Look here from --eye, with +Y up
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "eye", help_heading = CAMERA)]
    pub target: Option<Vec3>,
    /// Full angle of view along the image's shorter side [default: the camera's own]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, help_heading = CAMERA)]
    pub fov: Option<f32>,
    /// Render the scene as an animation has it at this time; before its first and after its last key it stands still [default: the
    /// scene as it rests]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, help_heading = ANIMATION)]
    pub at: Option<f64>,
    /// An animation of the scene by its name or its index from 0, for --at and --frames [default: the first]
    #[arg(long, value_name = "NAME-OR-INDEX", help_heading = ANIMATION)]
    pub animation: Option<String>,
    /// An equirectangular image (.hdr, .exr) in place of the scene's environment; sky:ELEVATION[,TURBIDITY]: a clear sky with
    /// the sun at that many degrees above the horizon of +Z, and turbidity 1 to 10 [default: 3], over a grey ground; studio: soft
    /// light from three sides; or none [default: studio, or sky and sun, where the scene has no light that shows it]
    #[arg(long, value_name = "FILE", allow_hyphen_values = true, help_heading = ENVIRONMENT)]
    pub env: Option<String>,
    /// Multiply the environment's radiance, whether it is the scene's own or --env, and a sky's sun with it
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true, help_heading = ENVIRONMENT)]
    pub env_scale: Option<f32>,
    /// Turn the environment about +Y, counter-clockwise as seen from above, and a sky's sun with it
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, help_heading = ENVIRONMENT)]
    pub env_rotate: Option<f32>,
}

/// How a picture is shown: the options that `render` and `view` share.
#[derive(clap::Args)]
pub struct GradeArgs {
    /// Brighten the .png and the window by this many stops (values times 2^STOPS), or by `auto`: the log-average luminance
    /// becomes middle grey, 0.18 [default: auto]
    #[arg(long, value_name = "auto|STOPS", allow_negative_numbers = true)]
    pub exposure: Option<Exposure>,
    /// Bring values above 1 to the display; a .exr stays linear [default: agx]
    #[arg(long, value_name = "CURVE")]
    pub tonemap: Option<Tonemap>,
}

impl GradeArgs {
    /// What is chosen.
    pub fn chosen(&self) -> (Exposure, Tonemap) {
        (self.exposure.unwrap_or_default(), self.tonemap.unwrap_or_default())
    }
}

const CAMERA: &str = "Camera";
pub const ANIMATION: &str = "Animation";
const ENVIRONMENT: &str = "Environment";

/// What is rendered.
pub struct View {
    pub scene: Scene,
    pub settings: Settings,
    /// Index, name and length of each animation that the file has.
    pub animations: Vec<String>,
}

impl ViewArgs {
    /// Loads the scene, poses and completes it, says its warnings, and completes the settings from it.
    pub fn load(&self) -> Result<View> {
        let (mut scene, mut settings) = self.open()?;
        let animations = animations(&scene);
        match (self.at, &self.animation) {
            (Some(seconds), _) => scene = self.at("--at", &scene, seconds)?,
            (None, Some(animation)) => bail!("--animation {animation}: at which time? Give --at SECONDS or --frames"),
            (None, None) => {}
        }
        let scene = self.complete(scene, &mut settings)?;
        warn(&scene);
        Ok(View { scene, settings, animations })
    }

    /// Loads the scene as it rests, and checks the settings.
    pub fn open(&self) -> Result<(Scene, Settings)> {
        let mut settings = self.settings.clone();
        if let Some(size) = self.size {
            (settings.width, settings.height) = size;
        }
        // Before a large scene is loaded for nothing.
        settings.check()?;
        let staging = self.staging([settings.width, settings.height])?;
        Ok((staging::load(&self.scene, &staging)?, settings))
    }

    /// What is asked for in place of the scene's camera and light, for an image of a size.
    pub fn staging(&self, size: [u32; 2]) -> Result<Staging> {
        let camera = match self.camera.as_deref() {
            None => CameraChoice::First,
            Some("auto") => CameraChoice::Auto,
            Some(name) => CameraChoice::Named(name.to_owned()),
        };
        let stand = self.eye.zip(self.target).map(|(eye, target)| [eye, target]);
        Ok(Staging { environment: self.environment()?, camera, stand, size })
    }

    /// The scene in the chosen animation at a time that `option` gave, in seconds.
    pub fn at(&self, option: &str, scene: &Scene, seconds: f64) -> Result<Scene> {
        if !(0.0..=1e6).contains(&seconds) {
            bail!("{option}: {seconds} s has to be 0 to 1000000 s");
        }
        Ok(scene.at(self.pick_animation(option, scene)?, seconds as f32)?)
    }

    /// Leaves out what the method cannot follow, places the camera, and completes the settings from the scene.
    pub fn complete(&self, mut scene: Scene, settings: &mut Settings) -> Result<Scene> {
        if settings.method.shares_subpaths() {
            scene = scene.without_glass();
        }
        settings.camera = self.pick_camera(&scene)?;
        self.place_camera(&mut scene, settings.camera)?;
        if let (None, Some(size)) = (self.size, scene.cameras[settings.camera].film_size) {
            (settings.width, settings.height) = size;
        }
        settings.check()?;
        scene.viewpoint = Some(Viewpoint { camera: settings.camera, size: [settings.width, settings.height] });
        Ok(scene)
    }

    /// What is asked for in place of the scene's environment.
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

    fn pick_camera(&self, scene: &Scene) -> Result<usize> {
        let staging = self.staging([1, 1])?;
        staging.camera.index(&scene.cameras).ok_or_else(|| {
            let known = scene.cameras.iter().enumerate().map(|(i, c)| format!("{i} `{}`", c.name));
            let wanted = self.camera.as_deref().unwrap_or_default();
            anyhow!("--camera {wanted}: is not in the scene, which has {}", known.collect::<Vec<_>>().join(", "))
        })
    }

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

    fn place_camera(&self, scene: &mut Scene, index: usize) -> Result<()> {
        let camera = &mut scene.cameras[index];
        if let (Some(eye), Some(target)) = (self.eye, self.target) {
            let Some(moved) = camera.clone().looking(eye, target) else {
                bail!("--eye {eye} --target {target}: there has to be some distance between them");
            };
            *camera = moved;
        }
        if let Some(degrees) = self.fov {
            if !(0.01..180.0).contains(&degrees) {
                bail!("--fov {degrees}: has to be at least 0.01 and below 180 degrees");
            }
            camera.projection = Projection::Perspective { fov: degrees.to_radians(), axis: FovAxis::Smaller };
        }
        let Settings { aperture, focus, .. } = self.settings;
        *camera = camera.clone().with_lens(aperture, focus).map_err(|cause| {
            let option = if aperture.is_some() { "--aperture" } else { "--focus" };
            anyhow!("{option}: {cause}")
        })?;
        Ok(())
    }
}

/// Index, name and length of each animation that a scene has.
pub fn animations(scene: &Scene) -> Vec<String> {
    let all = scene.rig.iter().flat_map(|rig| &rig.animations).enumerate();
    all.map(|(i, a)| format!("{i} `{}` ({:.2} s)", a.name, a.seconds())).collect()
}

/// Says what a scene is not rendered as it should be, and what was added to it.
pub fn warn(scene: &Scene) {
    for warning in &scene.warnings {
        eprintln!("warning: {warning}");
    }
    for note in &scene.notes {
        eprintln!("note: {note}");
    }
}

pub fn parse_size(text: &str) -> Result<(u32, u32), &'static str> {
    let size = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    size.ok_or("a size is columns x rows, such as 640x360")
}

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
