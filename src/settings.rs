//! Every knob, in one struct that the command line, the viewer and the benchmarks edit.

use std::fmt;

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Bidirectional path tracing by rasterization alone.
    Raster,
    /// The CPU path tracer that judges the others.
    Reference,
}

/// How `raster` tests visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Visibility {
    /// Conservative lists of triangles and exact intersection: no visibility error.
    Exact,
    /// Centre-sampled lists and depth comparison, as in the paper.
    Fast,
}

/// Which strategies take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Strategies {
    /// All, under multiple importance sampling, nothing clamped.
    All,
    /// For each path length the one with the most light vertices: instant radiosity.
    Vpl,
    /// One light vertex only: path tracing through bundles.
    Bundle,
    /// The set of 2012: one bounce under MIS, two bounces by (2, 3) alone, clamped.
    Paper,
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Raster => "raster",
            Self::Reference => "reference",
        })
    }
}

/// All settings of a render.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// How.
    pub method: Method,
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Iterations (`raster`) or paths per pixel (`reference`).
    pub samples: u32,
    /// Indirect bounces; 0 is direct light only.
    pub bounces: u32,
    /// Seed of all random numbers.
    pub seed: u32,
    /// Visibility of `raster`.
    pub visibility: Visibility,
    /// Strategies of `raster`.
    pub strategies: Strategies,
    /// Exponent of the MIS heuristic; section 4.2 uses 1.
    pub beta: f32,
    /// Texels along a side of a ray-bundle; none: chosen from the scene.
    pub bundle_resolution: Option<u32>,
    /// Texels along a side of each of the six faces around a light; none: chosen from the scene.
    pub light_resolution: Option<u32>,
    /// Texels along a side of each of the six faces around a VPL; none: chosen from the scene.
    pub vpl_resolution: Option<u32>,
    /// `paper`: share of the scene's diagonal below which the geometry term of (2, 3) grows no further.
    pub paper_clamp: f32,
    /// Index of the camera in the scene.
    pub camera: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Raster,
            width: 512,
            height: 512,
            samples: 64,
            bounces: 2,
            seed: 1,
            visibility: Visibility::Exact,
            strategies: Strategies::All,
            beta: 1.0,
            bundle_resolution: None,
            light_resolution: None,
            vpl_resolution: None,
            paper_clamp: 0.05,
            camera: 0,
        }
    }
}
