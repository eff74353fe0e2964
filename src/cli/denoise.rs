//! Command `denoise`: denoises a picture by Intel Open Image Denoise.

use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::film;
use crate::film::exr::Picture;
use crate::film::oidn::{self, Guides};

use super::aov::{NOISY, three};
use super::output;

#[derive(clap::Args)]
pub struct DenoiseArgs {
    /// Picture, .exr. Its layers `albedo` and `normal` (`render --aov albedo,normal`) keep edges and textures sharp
    #[arg(value_name = "IN.exr")]
    input: PathBuf,
    /// File of the denoised picture. It has all layers of the input, and the original as the layer `noisy`
    #[arg(short, long, value_name = "OUT.exr")]
    output: PathBuf,
    /// Library, or its folder [default: LIGHTSHEAF_OIDN, that of scripts/setup.sh --denoise, or the system's]
    #[arg(long, value_name = "PATH")]
    oidn: Option<PathBuf>,
}

/// Denoises the picture and writes it.
pub fn run(args: &DenoiseArgs) -> Result<()> {
    output::check(&args.output, &["exr"])?;
    let shown = args.input.display();
    if !film::has_extension(&args.input, "exr") {
        bail!("{shown}: is no .exr; give linear radiance, since .png is clipped");
    }
    let mut picture = Picture::load(&args.input)?;
    if picture.channel(NOISY[0]).is_some() {
        bail!("{shown}: is denoised already; give the original");
    }
    let layer = |names: [&str; 3]| -> Option<Vec<[f32; 3]>> {
        let [x, y, z] = names.map(|name| picture.channel(name));
        let (x, y, z) = (x?, y?, z?);
        Some((0..x.len()).map(|at| [x[at], y[at], z[at]]).collect())
    };
    let layers = layer(["albedo.R", "albedo.G", "albedo.B"]).zip(layer(["normal.X", "normal.Y", "normal.Z"]));
    if layers.is_none() {
        eprintln!(
            "note: {shown} has no layers albedo and normal; with `render --aov albedo,normal` edges stay sharper"
        );
    }
    let guides = layers.as_ref().map(|(albedo, normal)| Guides { albedo, normal });
    let denoised = oidn::denoise(&picture.film, guides, args.oidn.as_deref())?;
    let original = std::mem::replace(&mut picture.film, denoised);
    picture.channels.extend(three(NOISY, &original.pixels));
    if let Some(record) = &mut picture.record {
        record.command = format!("{}; {}", record.command, output::command_line());
    }
    Ok(picture.save(&args.output)?)
}
