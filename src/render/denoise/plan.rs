//! Decides which passes turn the layers of a frame into a picture.

use crate::render::interleave::Grid;
use crate::render::layouts;
use crate::render::planned_pass::PlannedPass;

/// The plan of the denoiser: a pure value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DenoisePlan {
    /// The division of the image.
    pub grid: Grid,
    /// Frames that indirect light is averaged over; 0 for none.
    pub history: u32,
    /// True if a filter averages the pixels of a square.
    pub filtered: bool,
    /// True if one more picture, which is filtered twice, measures the bias of the filter.
    pub measures_bias: bool,
    /// True if fireflies are clamped to the brightness of their neighbours.
    pub clamps_fireflies: bool,
    /// True if surfaces have lobes beside the diffuse one.
    pub glossy: bool,
    /// True if surfaces are mixes of materials.
    pub mixes: bool,
}

impl DenoisePlan {
    /// True if a frame measures how much the light has changed since the one before.
    #[must_use]
    pub fn has_gradients(&self) -> bool {
        self.history > 1 && self.grid.side > 1
    }

    /// True if what the filter takes away is averaged over the frames, so that the picture gets it back where it is
    /// no noise. Averages over time and coarser layers have it not, and what the firefly clamp takes stays away.
    #[must_use]
    pub fn keeps_residual(&self) -> bool {
        self.filtered && self.history == 0 && self.grid.scale == 1 && !self.clamps_fireflies
    }

    /// Returns the runs of the filter in a frame: over a square; over squares, along rows and columns, if the picture gets
    /// back what that takes away; and these two once more to measure the bias.
    fn filters(&self) -> u32 {
        u32::from(self.filtered) + 2 * (u32::from(self.keeps_residual()) + u32::from(self.measures_bias))
    }

    /// Returns the bytes of layers, guides, histories and pictures.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let [image, layer] = [self.grid.size, self.grid.layer()].map(|[w, h]| u64::from(w) * u64::from(h));
        let guide = size_of::<layouts::Guide>() as u64;
        let mut per_image_pixel = 2 * (guide + 16) + 16 + 32;
        per_image_pixel +=
            if self.measures_bias { 16 + 32 } else { 0 } + if self.keeps_residual() { 2 * 16 } else { 0 };
        let mut per_layer_pixel = 2 * 32;
        per_layer_pixel += if self.grid.scale > 1 { 2 * guide } else { 0 };
        per_layer_pixel += 32 * u64::from(self.filters());
        per_layer_pixel += if self.clamps_fireflies { 32 } else { 0 };
        per_layer_pixel += if self.history > 0 { 2 * 32 } else { 0 };
        let squares: u64 = self.grid.squares().iter().map(|&side| u64::from(side)).product();
        image * per_image_pixel + layer * per_layer_pixel + if self.has_gradients() { 8 * squares } else { 0 }
    }

    /// Returns one row per pass, in the order in which passes run.
    #[must_use]
    pub fn rows(&self) -> Vec<PlannedPass> {
        let Grid { side, scale, layered, .. } = self.grid;
        let row = |name, runs: bool, why: String, why_not: &str| {
            let why_not = if layered { why_not } else { "iterations are summed, not denoised" };
            let runs = match name {
                _ if !runs => 0,
                "filter" => self.filters(),
                // One more picture is composed.
                "compose" | "antialias" if self.measures_bias => 2,
                _ => 1,
            };
            PlannedPass { name, runs, reason: if runs > 0 { why } else { why_not.to_owned() } }
        };
        let squares = side * side;
        let upsampled = format!("upsamples the layers {scale} times and adds them up");
        vec![
            row(
                "gradient",
                self.has_gradients(),
                format!("changes of light, from one pixel in {squares} that repeats its random numbers"),
                "needs --interleave, and --history of several frames",
            ),
            row(
                "temporal",
                self.history > 0,
                format!("averages indirect light over up to {} frames", self.history),
                "no --history",
            ),
            row(
                "filter",
                self.filtered,
                format!(
                    "averages the {squares} light subpaths of a square{}",
                    if self.keeps_residual() { ", then squares" } else { "" }
                ),
                if side > 1 { "--unfiltered" } else { "no --interleave" },
            ),
            row("firefly_clamp", self.clamps_fireflies, "as asked for".to_owned(), "not asked for"),
            row("compose", layered, if scale > 1 { upsampled } else { "adds up the layers".to_owned() }, ""),
            row("antialias", layered, "averages frames".to_owned(), ""),
        ]
    }
}
