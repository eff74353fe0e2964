//! `view`: a scene in a window.

use anyhow::Result;

use super::view::{GradeArgs, ViewArgs};

#[derive(clap::Args)]
pub struct WindowArgs {
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    grade: GradeArgs,
}

#[cfg(feature = "viewer")]
pub fn run(WindowArgs { view: args, grade }: &WindowArgs) -> Result<()> {
    use lightsheaf::viewer::stand::Stand;
    use lightsheaf::viewer::state::Launch;
    use lightsheaf::viewer::window;

    /// Pixels of a window whose size nobody asked for.
    const SIZE: (u32, u32) = (1280, 720);

    args.settings.check()?;
    let (exposure, tonemap) = grade.chosen();
    let launch = Launch {
        spec: args.scene.clone(),
        staging: args.staging(args.size.unwrap_or(SIZE).into())?,
        settings: args.settings.clone(),
        stand: args.eye.zip(args.target).map(|(eye, target)| Stand { eye, target }),
        fov: args.fov,
        animation: args.animation.clone(),
        at: args.at.map(|seconds| seconds as f32),
        exposure,
        tonemap,
    };
    let (width, height) = args.size.unwrap_or(SIZE);
    Ok(window::run(launch, [width, height])?)
}

#[cfg(not(feature = "viewer"))]
pub fn run(_: &WindowArgs) -> Result<()> {
    anyhow::bail!("this program was built without its viewer: build it with `cargo build --features viewer`")
}
