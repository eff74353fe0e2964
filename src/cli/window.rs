//! Command `view`: shows a scene in a window.

use anyhow::Result;

use super::view::{GradeArgs, ViewArgs};

#[derive(clap::Args)]
pub struct WindowArgs {
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    grade: GradeArgs,
}

/// Opens the window and shows the scene until it is closed.
#[cfg(feature = "viewer")]
pub fn run(WindowArgs { view: args, grade }: &WindowArgs) -> Result<()> {
    use crate::staging::OrbitCamera;
    use crate::viewer::state::Launch;
    use crate::viewer::window;

    /// Default size of the window in pixels.
    const SIZE: (u32, u32) = (1280, 720);

    args.settings.check()?;
    let (exposure, tonemap) = grade.chosen();
    let launch = Launch {
        spec: args.scene.clone(),
        staging: args.staging(args.size.unwrap_or(SIZE).into())?,
        settings: args.settings.clone(),
        orbit_camera: args.eye.zip(args.target).map(|(eye, target)| OrbitCamera { eye, target }),
        fov: args.fov,
        animation: args.animation.clone(),
        at: args.at.map(|seconds| seconds as f32),
        exposure,
        tonemap,
    };
    let (width, height) = args.size.unwrap_or(SIZE);
    Ok(window::run(launch, [width, height])?)
}

/// Fails, since the viewer is not compiled in.
#[cfg(not(feature = "viewer"))]
pub fn run(_: &WindowArgs) -> Result<()> {
    anyhow::bail!("this program was built without the viewer; build it with `cargo build --features viewer`")
}
