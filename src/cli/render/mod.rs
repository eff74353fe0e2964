//! Command `render`: renders a scene to image files until a number of samples, an error or a time is reached.
//!
//! - `args`: the options; `checks`: which go together.
//! - `frames`: the frames of an animation and the views of a turntable.
//! - `job`: one picture; `progressive`: its samples, and what is kept of them; `clock`: its time.
//! - `stats`: what is told about it.

mod args;
mod checks;
mod clock;
mod frames;
mod job;
mod progressive;
mod stats;

use std::cell::{OnceCell, RefCell};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};

use super::interrupt::{self, Interrupt};
use super::preview::Preview;
use super::view::{self, Turn, View};
use crate::film::exr::Picture;
use crate::gpu::{Gpu, GpuError};
use crate::render::RenderError;
use crate::scene::{Geometry, Scene};
use crate::settings::{Method, Settings};

pub use args::RenderArgs;
use frames::{Frame, frames};
use job::{Job, Kept, Renderers};

/// Times that a device may be lost without further samples.
const MAX_LOSSES: u32 = 3;

/// Renders the scene and writes the requested files.
pub fn run(args: &RenderArgs) -> Result<ExitCode> {
    let interrupt = Interrupt::install(args.quiet)?;
    render(args, &interrupt)?;
    Ok(if interrupt.requested() { ExitCode::from(interrupt::EXIT_CODE) } else { ExitCode::SUCCESS })
}

/// Renders a single picture, writes its files if there are any, and returns it.
pub fn picture(args: &RenderArgs, interrupt: &Interrupt) -> Result<Picture> {
    let several = [
        ("--frames", args.frames.is_some()),
        ("--turntable", args.turntable.is_some()),
        ("--camera", args.view.camera.len() > 1),
    ];
    if let Some((option, _)) = several.iter().find(|(_, given)| *given) {
        bail!("{option}: asks for several pictures; render one at a time");
    }
    checks::outputs(args)?;
    let picture = render_camera(args, interrupt, &RefCell::default())?;
    picture.context("no picture was rendered")
}

fn render(args: &RenderArgs, interrupt: &Interrupt) -> Result<()> {
    let cameras = args.by_camera()?;
    cameras.iter().try_for_each(checks::outputs)?;
    let device = RefCell::default();
    for (n, args) in cameras.iter().enumerate() {
        if n == 0 || !interrupt.requested() {
            render_camera(args, interrupt, &device)?;
        }
    }
    Ok(())
}

/// Renders the pictures of one camera, and returns the last one. The device is opened if there is none, and kept.
fn render_camera(args: &RenderArgs, interrupt: &Interrupt, device: &RefCell<Option<Gpu>>) -> Result<Option<Picture>> {
    let frames = frames(args)?;
    let preview = RefCell::new(args.preview.as_ref().map(|address| Preview::connect(address, args.shown_name())));
    if frames.is_empty() {
        render_still(args, interrupt, device, &preview).map(Some)
    } else {
        render_frames(args, &frames, interrupt, device, &preview)
    }
}

/// Renders a single picture.
fn render_still(
    args: &RenderArgs,
    interrupt: &Interrupt,
    device: &RefCell<Option<Gpu>>,
    preview: &RefCell<Option<Preview>>,
) -> Result<Picture> {
    let began = Instant::now();
    let View { scene, mut settings, animations } = args.view.load()?;
    if let Some(folder) = &args.strategy_images {
        checks::strategy_images(folder, &settings)?;
        // Weighted strategy images sum to the unfiltered picture, of paths that are no longer than the bounces.
        settings.interleave.get_or_insert(1);
        settings.specular_bounces = 0;
    }
    let load = began.elapsed().as_secs_f64();
    let (scene, settings, animations) = (&scene, &settings, &animations);
    let (grade, kept) = (&OnceCell::new(), &Kept::default());
    go_on_after_losses(&|| kept.saved.borrow().as_ref().map_or(0, |saved| saved.samples), &mut || {
        let began = Instant::now();
        let gpu = device.take().map_or_else(|| open(args), |gpu| Ok(Some(gpu)))?;
        let (before, frame, all) = (None, None, 1);
        let job =
            Job { args, interrupt, grade, preview, load, began, scene, before, settings, animations, frame, all, kept };
        let picture = job.run(gpu.as_ref(), &mut Renderers::default())?;
        device.replace(gpu);
        Ok(picture)
    })
}

/// Renders the frames of an animation or the views of a turntable, and returns the last picture. With
/// `--skip-existing` there may be none to render.
fn render_frames(
    args: &RenderArgs,
    frames: &[Frame],
    interrupt: &Interrupt,
    device: &RefCell<Option<Gpu>>,
    preview: &RefCell<Option<Preview>>,
) -> Result<Option<Picture>> {
    let (mut began, grade) = (Instant::now(), OnceCell::new());
    let (loaded, mut settings) = args.view.open()?;
    if args.skip_existing {
        checks::skipping(args, &settings)?;
    }
    let animations = view::animations(&loaded);
    let loaded = if args.turntable.is_some() { args.view.pose(loaded)? } else { loaded };
    let about = args.turntable.map(|_| args.view.target.unwrap_or_else(|| centre(&loaded)));
    let complete = |frame: Frame, settings: &mut Settings| {
        let turn = about.zip(frame.degrees).map(|(about, degrees)| Turn { about, degrees });
        let posed = match turn {
            Some(_) => loaded.clone(),
            None => args.view.at("--frames", &loaded, frame.seconds)?,
        };
        args.view.complete(posed, settings, turn)
    };
    // The first frame is loaded before the device is opened, so that its warnings come first. The setup time
    // of the first frame includes that of the device.
    let first = complete(frames[0], &mut settings)?;
    view::warn(&first);
    let mut load = began.elapsed().as_secs_f64();
    began = Instant::now();
    let gpu = device.take().map_or_else(|| open(args), |gpu| Ok(Some(gpu)))?;
    let (mut renderers, mut scene, mut before, all) = (Renderers::default(), first, None, frames.len());
    let mut last = None;
    for (n, &frame) in frames.iter().enumerate() {
        if n > 0 && interrupt.requested() {
            break;
        }
        if n > 0 {
            let posing = Instant::now();
            before = Some(std::mem::replace(&mut scene, complete(frame, &mut settings)?));
            load = posing.elapsed().as_secs_f64();
            began = Instant::now();
        }
        let (scene, before, settings, animations) = (&scene, before.as_ref(), &settings, &animations);
        let (grade, kept, frame) = (&grade, &Kept::default(), Some(frame));
        let job =
            Job { args, interrupt, grade, preview, load, began, scene, before, settings, animations, frame, all, kept };
        if !(args.skip_existing && job.skip()) {
            last = Some(job.run(gpu.as_ref(), &mut renderers)?);
        }
    }
    drop(renderers);
    device.replace(gpu);
    Ok(last)
}

/// Renders, and opens the device again as often as it is lost after further samples. `samples` returns the
/// samples that are kept.
fn go_on_after_losses<T>(samples: &dyn Fn() -> u64, attempt: &mut dyn FnMut() -> Result<T>) -> Result<T> {
    let mut losses = (0, 0);
    loop {
        let error = match attempt() {
            Err(error) => error,
            done => return done,
        };
        let lost = matches!(error.downcast_ref(), Some(RenderError::Gpu(GpuError::Lost(_))));
        let kept = samples();
        losses = if kept > losses.0 { (kept, 1) } else { (losses.0, losses.1 + 1) };
        if !lost || losses.1 > MAX_LOSSES {
            return Err(error);
        }
        eprintln!("warning: the graphics device was lost; it is opened again, and {kept} samples are kept");
    }
}

/// Opens the device of a method; the reference needs none.
fn open(args: &RenderArgs) -> Result<Option<Gpu>> {
    if args.view.settings.method() == Method::Reference {
        return Ok(None);
    }
    let gpu = crate::render::open_device(args.view.settings.technique)?;
    gpu.non_finite.watch(&gpu, args.check_values);
    gpu.timings.measure(args.stats.is_some());
    if let Some(folder) = &args.dump_shaders {
        gpu.dump_shaders(folder).with_context(|| format!("--dump-shaders {}", folder.display()))?;
    }
    Ok(Some(gpu))
}

/// Returns the centre of a scene.
fn centre(scene: &Scene) -> glam::Vec3 {
    let [low, high] = Geometry::new(scene).bounds;
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    /// A lost device is opened again as long as samples are gained, and four times without any.
    #[test]
    fn a_render_goes_on_after_losses() {
        let lost = || Err(RenderError::Gpu(GpuError::Lost("gone".to_owned())).into());
        let (kept, attempts) = (Cell::new(0), Cell::new(0));
        let attempt = |gains: bool, losses: u32| {
            kept.set(0);
            attempts.set(0);
            go_on_after_losses(&|| kept.get(), &mut || {
                attempts.set(attempts.get() + 1);
                kept.set(kept.get() + u64::from(gains));
                if attempts.get() > losses { Ok(()) } else { lost() }
            })
        };
        assert!(attempt(true, 20).is_ok() && attempts.get() == 21);
        assert!(attempt(false, MAX_LOSSES).is_ok());
        assert!(attempt(false, 20).is_err_and(|error| error.to_string().contains("was lost")));
        assert_eq!(attempts.get(), MAX_LOSSES + 1);
        let other: Result<()> = go_on_after_losses(&|| 0, &mut || {
            attempts.set(0);
            bail!("another error")
        });
        assert!(other.is_err() && attempts.get() == 0);
    }
}
