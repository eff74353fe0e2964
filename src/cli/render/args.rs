//! The options of `render`.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Result, bail};

use super::frames::parse_frames;
use crate::cli::aov::LayerArgs;
use crate::cli::preview;
use crate::cli::view::{ANIMATION, GradeArgs, ViewArgs};
use crate::crop::Crop;
use crate::film::has_extension;
use crate::film::record::SampleRange;

/// Stands for the camera in names of files.
const CAMERA: &str = "{camera}";

#[derive(Clone, clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub view: ViewArgs,
    /// Image file: .exr (linear 32-bit float) or .png (8-bit sRGB after --exposure and --tonemap). May be
    /// given once for each format
    #[arg(short, long, value_name = "OUT.exr|.png", required = true)]
    pub(super) output: Vec<PathBuf>,
    #[command(flatten)]
    pub(super) grade: GradeArgs,
    #[command(flatten)]
    pub(super) layers: LayerArgs,
    /// Render the part of the image whose upper left pixel is X,Y and which has W x H pixels. They are those of
    /// the whole image; the .exr says where they lie in it. Filtered pictures of shared and ReSTIR take the time
    /// of the whole image
    #[arg(long, value_name = "X,Y,W,H")]
    pub crop: Option<Crop>,
    /// Render N views on a circle around the scene, or around --target, each to a separate file: OUT.exr becomes
    /// OUT_0000.exr and so on, as does the file of --stats. The first one is that of the camera, and the camera
    /// goes counter-clockwise seen from above
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=9999), conflicts_with_all = ["frames", "checkpoint", "resume", "strategy_images"], help_heading = ANIMATION)]
    pub(super) turntable: Option<u32>,
    /// Write the contribution of each strategy (s, t) to this folder: weighted by MIS (sS_tT.exr; their sum
    /// is the image) and unweighted (sS_tT_unweighted.exr). Needs a limited number of bounces, and sets
    /// --specular-bounces 0. Not available with reference
    #[arg(long, value_name = "DIR")]
    pub(super) strategy_images: Option<PathBuf>,
    /// Write statistics as JSON: counts, times, settings and the plan
    #[arg(long, value_name = "OUT.json")]
    pub(super) stats: Option<PathBuf>,
    /// Count values that are not finite after each pass, and name the first pass that wrote any. Slower. Not
    /// available with reference
    #[arg(long)]
    pub(super) check_values: bool,
    /// Write the linked WGSL of every pass to this folder, for debugging shaders. Not available with
    /// reference
    #[arg(long, value_name = "DIR")]
    pub(super) dump_shaders: Option<PathBuf>,
    /// Write the picture so far and a checkpoint, OUT.checkpoint, every this many seconds, 1 to 604800, and when
    /// the render is interrupted. --resume goes on from it. The checkpoint is removed when the render has ended
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, conflicts_with_all = ["frames", "strategy_images"])]
    pub(super) checkpoint: Option<f64>,
    /// Go on from a checkpoint of the same scene, settings and version, bit for bit as if the render had never
    /// stopped. --samples, --budget and the output may differ
    #[arg(long, value_name = "FILE", conflicts_with_all = ["frames", "strategy_images"])]
    pub(super) resume: Option<PathBuf>,
    /// Render frames A to B, including B, at --fps, each to a separate file: OUT.exr becomes OUT_0000.exr and
    /// so on, as does the file of --stats
    #[arg(long, value_name = "A..B", value_parser = parse_frames, requires = "fps", conflicts_with_all = ["at", "strategy_images"], help_heading = ANIMATION)]
    pub(super) frames: Option<(u32, u32)>,
    /// Leave out frames and views whose files are complete: of the same scene, settings, layers and version, with all
    /// samples. Needs --samples and an .exr. So an animation that was cut off goes on
    #[arg(long, help_heading = ANIMATION)]
    pub(super) skip_existing: bool,
    /// Frames per second, 0.001 to 10000. Frame N is at N / FPS seconds
    #[arg(long, value_name = "N", allow_negative_numbers = true, requires = "frames", help_heading = ANIMATION)]
    pub(super) fps: Option<f64>,
    /// Render samples A to B of the sequence, including B, counted from 1. `lightsheaf merge` joins such parts
    /// to the picture of all of them. Excludes --samples, --budget and --target-error
    #[arg(long, value_name = "A..B", value_parser = SampleRange::parse, conflicts_with_all = ["samples", "budget", "target_error", "strategy_images"])]
    pub sample_range: Option<SampleRange>,
    /// Print progress and the end of each picture to stdout as lines of JSON, for programs, in place of the bar
    #[arg(long)]
    pub(super) json_progress: bool,
    /// Send the picture to a viewer once a second while it is rendered, by the protocol of tev (port 14158), which
    /// HDRView speaks, too. Without a viewer the render goes on
    #[arg(long, value_name = "HOST:PORT", value_parser = preview::parse_address)]
    pub(super) preview: Option<String>,
    /// Print neither progress nor the closing line. Warnings and errors are still printed
    #[arg(short, long)]
    pub(super) quiet: bool,
}

impl RenderArgs {
    /// True if an output file is a .png.
    pub(super) fn writes_png(&self) -> bool {
        self.output.iter().any(|path| has_extension(path, "png"))
    }

    /// True if the picture keeps its layers: in an .exr, or for the program that asks for it.
    pub(super) fn keeps_layers(&self) -> bool {
        self.output.is_empty() || self.output.iter().any(|path| has_extension(path, "exr"))
    }

    /// Returns the name of the picture in a viewer.
    pub(super) fn shown_name(&self) -> String {
        let name = self.output.first().and_then(|path| path.file_name());
        name.map_or_else(|| self.view.scene.clone(), |name| name.to_string_lossy().into_owned())
    }

    /// Returns the arguments of each camera's picture, whose word on the command line replaces `{camera}` in the
    /// names of files.
    pub(super) fn by_camera(&self) -> Result<Vec<Self>> {
        let files = || self.output.iter().chain(&self.stats);
        let names_camera = |path: &&PathBuf| path.to_string_lossy().contains(CAMERA);
        let cameras = &self.view.camera;
        if cameras.is_empty()
            && let Some(path) = files().find(names_camera)
        {
            bail!("{}: which camera? Give --camera, or leave {CAMERA} out of the name", path.display());
        }
        if cameras.len() < 2 {
            return Ok(vec![self.of_camera(cameras.first().map_or("", String::as_str))]);
        }
        if let Some(path) = files().find(|path| !names_camera(path)) {
            bail!("{}: has to have {CAMERA} in its name, since each camera has a file", path.display());
        }
        for (option, given) in [
            ("--resume", self.resume.is_some()),
            ("--strategy-images", self.strategy_images.is_some()),
            ("--eye", self.view.eye.is_some()),
        ] {
            if given {
                bail!("{option}: is for one camera, and there are {}", cameras.len());
            }
        }
        let all: Vec<Self> = cameras.iter().map(|camera| self.of_camera(camera)).collect();
        let outputs: BTreeSet<_> = all.iter().map(|args| args.output.first()).collect();
        if outputs.len() < all.len() {
            bail!("--camera: two are called alike; give each once");
        }
        Ok(all)
    }

    /// Returns the arguments of one camera's picture.
    fn of_camera(&self, camera: &str) -> Self {
        // A name may have characters that file names cannot have.
        let word: String =
            camera.chars().map(|c| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '_' }).collect();
        let named = |path: &PathBuf| PathBuf::from(path.to_string_lossy().replace(CAMERA, &word));
        let mut args = self.clone();
        if !camera.is_empty() {
            args.view.camera = vec![camera.to_owned()];
            args.output = self.output.iter().map(named).collect();
            args.stats = self.stats.as_ref().map(named);
        }
        args
    }
}
