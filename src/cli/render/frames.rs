//! The frames of an animation and the views of a turntable.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};

use super::RenderArgs;

/// Frame of an animation, or view of a turntable.
#[derive(Clone, Copy, serde::Serialize)]
pub(super) struct Frame {
    pub(super) number: u32,
    /// Time since the beginning of the animation in seconds.
    pub(super) seconds: f64,
    /// Angle of a turntable in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) degrees: Option<f64>,
}

/// Returns the frames to render; empty for a single picture.
pub(super) fn frames(args: &RenderArgs) -> Result<Vec<Frame>> {
    if let Some(views) = args.turntable {
        let seconds = args.view.at.unwrap_or_default();
        let degrees = |number| Some(360.0 * f64::from(number) / f64::from(views));
        return Ok((0..views).map(|number| Frame { number, seconds, degrees: degrees(number) }).collect());
    }
    let (Some((first, last)), Some(fps)) = (args.frames, args.fps) else { return Ok(Vec::new()) };
    if !(1e-3..=1e4).contains(&fps) {
        bail!("--fps {fps}: has to be 0.001 to 10000 frames a second");
    }
    Ok((first..=last).map(|number| Frame { number, seconds: f64::from(number) / fps, degrees: None }).collect())
}

/// Returns the file name of a frame: `out.exr` becomes `out_0007.exr`.
pub(super) fn numbered(path: &Path, number: u32) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("_{number:04}."));
    name.push(path.extension().unwrap_or_default());
    path.with_file_name(name)
}

/// Parses `A..B`, or a single frame.
pub(super) fn parse_frames(text: &str) -> Result<(u32, u32), &'static str> {
    let (first, last) = text.split_once("..").unwrap_or((text, text));
    let frames = first.parse().ok().zip(last.parse().ok()).filter(|(first, last)| first <= last && *last < 1_000_000);
    frames.ok_or("frames are two numbers below a million, the later one second, such as 0..47")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_parsed_and_numbered() {
        assert_eq!((parse_frames("0..47"), parse_frames("12")), (Ok((0, 47)), Ok((12, 12))));
        for bad in ["", "..", "3..", "..3", "3..2", "-1..2", "0..1000000", "a..b", "0..=3", "1.5..2"] {
            assert!(parse_frames(bad).is_err(), "{bad}");
        }
        assert_eq!(numbered(Path::new("a.b/c.d.exr"), 7), Path::new("a.b/c.d_0007.exr"));
        assert_eq!(numbered(Path::new("c.png"), 123_456), Path::new("c_123456.png"));
    }
}
