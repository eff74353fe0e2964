//! Command `merge`: joins pictures of parts of a sequence of samples.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use crate::film::Film;
use crate::film::exr::{Channel, Picture};
use crate::film::filtered::FilteredFilm;
use crate::film::record::{Record, SampleRange};
use crate::render::fingerprint;

use super::aov::{INDIRECT, NOISY};
use super::output;

#[derive(clap::Args)]
pub struct MergeArgs {
    /// Pictures of parts of the samples, .exr of `render --sample-range` or of `merge`
    #[arg(required = true, value_name = "PART.exr")]
    parts: Vec<PathBuf>,
    /// File of the picture of all samples
    #[arg(short, long, value_name = "OUT.exr")]
    output: PathBuf,
    /// Join parts between which samples are missing, too
    #[arg(long)]
    allow_gaps: bool,
    /// Do not print the closing line
    #[arg(short, long)]
    quiet: bool,
}

/// A part with its file and its record.
struct Part {
    path: PathBuf,
    picture: Picture,
    record: Record,
}

/// Joins the parts and writes the picture.
pub fn run(args: &MergeArgs) -> Result<()> {
    output::check(&args.output, &["exr"])?;
    let parts: Vec<Part> = args.parts.iter().map(|path| load(path)).collect::<Result<_>>()?;
    let [first, others @ ..] = parts.as_slice() else { bail!("there is no part to merge") };
    others.iter().try_for_each(|other| check(first, other))?;
    let ranges = join(&parts, args.allow_gaps)?;
    let merged = merge(&parts, ranges);
    merged.save(&args.output)?;
    if let (false, Some(record)) = (args.quiet, &merged.record) {
        let count = parts.len();
        eprintln!(
            "{}: {} samples of {count} {}, {:.2} s of rendering in all",
            args.output.display(),
            record.samples,
            if count == 1 { "part" } else { "parts" },
            record.seconds
        );
    }
    Ok(())
}

/// Loads a part, which has to have a record.
fn load(path: &Path) -> Result<Part> {
    let picture = Picture::load(path)?;
    let Some(record) = picture.record.clone() else {
        bail!("{}: does not say which samples it has; merge files that `lightsheaf render` wrote", path.display());
    };
    if picture.channel(NOISY[0]).is_some() {
        bail!("{}: is denoised; merge the originals, and denoise the result", path.display());
    }
    if record.samples != record.ranges.iter().map(SampleRange::count).sum::<u64>() {
        bail!("{}: its numbers of samples contradict each other; render the part again", path.display());
    }
    Ok(Part { path: path.to_owned(), picture, record })
}

/// Checks that two parts are of one scene, one set of settings and one version.
fn check(first: &Part, other: &Part) -> Result<()> {
    let (a, b) = (&first.record, &other.record);
    let shown = format!("{} and {}", first.path.display(), other.path.display());
    if a.settings_hash != b.settings_hash {
        let differences = fingerprint::differences(&a.settings, &b.settings);
        bail!(
            "{shown}: have other settings: {}; render the part again with those of the others",
            differences.join(", ")
        );
    }
    if a.scene_hash != b.scene_hash {
        bail!("{shown}: show other scenes, {} and {}, or another pose; render one of them again", a.scene, b.scene);
    }
    if a.version != b.version {
        bail!("{shown}: are of the versions {} and {}; render the older one again", a.version, b.version);
    }
    let is_filtered = |part: &Part| FilteredFilm::of(&part.picture, part.record.samples).is_some();
    if let Some(lacks) = [first, other].into_iter().find(|part| !is_filtered(part))
        && (is_filtered(first) || is_filtered(other))
    {
        bail!(
            "{}: is filtered, and does not say what the filter took away; render it again with --sample-range",
            lacks.path.display()
        );
    }
    let size = |picture: &Picture| ([picture.film.width, picture.film.height], picture.window);
    let channels = |picture: &Picture| picture.channels.iter().map(|channel| channel.name.clone()).collect::<Vec<_>>();
    if size(&first.picture) != size(&other.picture) || channels(&first.picture) != channels(&other.picture) {
        bail!("{shown}: have other sizes, crops or channels; render one of them again");
    }
    Ok(())
}

/// Returns the samples of all parts in order, adjacent ranges as one. Parts must not overlap.
fn join(parts: &[Part], allow_gaps: bool) -> Result<Vec<SampleRange>> {
    let mut all: Vec<(SampleRange, &Path)> =
        parts.iter().flat_map(|part| part.record.ranges.iter().map(|range| (*range, part.path.as_path()))).collect();
    all.sort();
    let mut joined: Vec<SampleRange> = Vec::new();
    let mut before: Option<&Path> = None;
    for (range, path) in all {
        match joined.last_mut() {
            Some(last) if range.first <= last.last => {
                let other = before.unwrap_or(path);
                let (from, to) = (range.first, range.last.min(last.last));
                bail!("{} and {}: both have the samples {from}..{to}; leave one out", other.display(), path.display());
            }
            Some(last) if range.first == last.last + 1 => last.last = range.last,
            last => {
                let missing = last.map_or(1, |last| last.last + 1);
                if range.first > missing && !allow_gaps {
                    let until = range.first - 1;
                    bail!("the samples {missing}..{until} are in no part; render them, or give --allow-gaps");
                }
                joined.push(range);
            }
        }
        before = Some(path);
    }
    Ok(joined)
}

/// Returns the mean of the parts, weighted by their samples. A filtered picture gets back what the filter took away
/// from all samples.
fn merge(parts: &[Part], ranges: Vec<SampleRange>) -> Picture {
    let first = &parts[0].picture;
    let samples: u64 = parts.iter().map(|part| part.record.samples).sum();
    let mean = |value: &dyn Fn(usize) -> f32| {
        let weighted = parts.iter().enumerate().map(|(n, part)| part.record.samples as f64 * f64::from(value(n)));
        (weighted.sum::<f64>() / samples as f64) as f32
    };
    let mean_film = |films: &[&Film]| -> Vec<[f32; 3]> {
        let pixels = 0..first.film.pixels.len();
        pixels.map(|at| std::array::from_fn(|c| mean(&|n| films[n].pixels[at][c]))).collect()
    };
    let channel = |(c, channel): (usize, &Channel)| Channel {
        name: channel.name.clone(),
        // Layers without light are the same in all parts.
        values: if parts.iter().all(|part| part.picture.channels[c] == *channel) {
            channel.values.clone()
        } else {
            (0..channel.values.len()).map(|at| mean(&|n| parts[n].picture.channels[c].values[at])).collect()
        },
    };
    let shown: Vec<_> = parts.iter().map(|part| &part.picture.film).collect();
    let Film { width, height, .. } = first.film;
    let film = Film { width, height, pixels: mean_film(&shown) };
    let channels = first.channels.iter().enumerate().map(channel).collect();
    let mut picture = Picture { film, channels, ..Picture::default() };
    if let Some(filtered) = FilteredFilm::of(&picture, samples) {
        replace(&mut picture, filtered.picture());
    }
    let mut devices: Vec<_> = parts.iter().map(|part| part.record.device.clone()).collect();
    devices.sort();
    devices.dedup();
    let record = Record {
        command: output::command_line(),
        samples,
        ranges,
        device: devices.join("; "),
        seconds: parts.iter().map(|part| part.record.seconds).sum(),
        ..parts[0].record.clone()
    };
    Picture { attributes: first.attributes.clone(), window: first.window, record: Some(record), ..picture }
}

/// Replaces the film of a picture. Indirect light takes the difference, so that the layers of light sum to the film.
fn replace(picture: &mut Picture, film: Film) {
    for (c, name) in INDIRECT.iter().enumerate() {
        if let Some(channel) = picture.channels.iter_mut().find(|channel| channel.name == *name) {
            let pixels = film.pixels.iter().zip(&picture.film.pixels);
            channel.values.iter_mut().zip(pixels).for_each(|(value, (new, old))| *value += new[c] - old[c]);
        }
    }
    picture.film = film;
}
