//! Requests from the window to the render thread, and the results that it returns.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;

use crate::film::Film;
use crate::metrics::Comparison;
use crate::render::renderer::RenderStats;
use crate::scene::{Camera, Light, Scene};
use crate::settings::{OnlyStrategy, Settings, Technique};
use crate::staging::Staging;
use crate::tonemap::Grade;

/// A scene to load.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// A path or `builtin:NAME`.
    pub spec: String,
    /// Replacements for the scene's own camera and lights.
    pub staging: Staging,
}

/// Layer of a picture that a pane shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layer {
    /// The rendered picture.
    #[default]
    Light,
    /// Contribution of one strategy.
    Strategy(OnlyStrategy),
    /// Error against the reference's picture, which is rendered at the same time.
    Error,
    /// Distance from the camera, relative to the largest in the picture.
    Distance,
    /// Shading normals, mapped from -1..1 to 0..1.
    Normal,
    /// Albedo of the surfaces.
    Albedo,
    /// Number of list entries that each pixel's look-up along the first bundle direction visits; only for
    /// `raster`.
    Lists,
}

impl Layer {
    /// Returns true if the layer is a geometric or material feature, which needs no light transport.
    #[must_use]
    pub fn is_feature(self) -> bool {
        matches!(self, Self::Distance | Self::Normal | Self::Albedo)
    }

    /// Returns true if a method provides the layer.
    #[must_use]
    pub fn is_of(self, technique: Technique) -> bool {
        match self {
            Self::Strategy(only) => technique.has_strategy(only.s, only.t),
            Self::Lists => technique.rasterizes(),
            _ => true,
        }
    }

    /// Returns true if exposure and tone curve apply to the layer.
    #[must_use]
    pub fn is_radiance(self) -> bool {
        matches!(self, Self::Light | Self::Strategy(_))
    }
}

/// Part of the window, with the picture that it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Pane {
    /// Settings of the renderer, with the size of the whole picture.
    pub settings: Settings,
    /// Layer that is shown.
    pub layer: Layer,
}

/// Lights and emissive materials that differ from the scene's file, by index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    /// Replacements for the scene's lights.
    pub lights: BTreeMap<usize, Light>,
    /// Radiance of emissive materials.
    pub emissions: BTreeMap<usize, Vec3>,
}

impl Edits {
    /// Returns true if the scene is as its file describes it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty() && self.emissions.is_empty()
    }

    /// Applies the edits to a scene. Indices that are out of range are ignored.
    pub fn apply(&self, scene: &mut Scene) {
        for (&index, &light) in &self.lights {
            if let Some(there) = scene.lights.get_mut(index) {
                *there = light;
            }
        }
        for (&index, &radiance) in &self.emissions {
            if let Some(emission) = scene.materials.get_mut(index).and_then(|m| m.emission.as_mut()) {
                emission.radiance.factor = radiance;
            }
        }
    }
}

/// Complete description of the displayed pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Number of the request; pictures carry the number of theirs.
    pub number: u64,
    /// The scene to show.
    pub source: Source,
    /// Index of an animation and time in seconds; none selects the rest pose.
    pub pose: Option<(usize, f32)>,
    /// Camera in place of the one that the settings name.
    pub camera: Option<Camera>,
    /// Differences from the scene's file.
    pub edits: Edits,
    /// One pane, or two for a comparison.
    pub panes: Vec<Pane>,
    /// True if the view is changing, so that latency matters more than resolution.
    pub moving: bool,
}

/// A command to the render thread.
#[derive(Clone, Debug)]
pub enum Command {
    /// Render this request from now on.
    Show(Box<Request>),
    /// Write a pane's picture to a file: .exr stores linear radiance, .png the tone-mapped picture.
    Save {
        /// Index of the pane.
        pane: usize,
        /// Path of the file.
        path: PathBuf,
        /// Exposure and tone curve of a .png.
        tonemap: Grade,
    },
}

/// Description of a loaded scene.
#[derive(Clone, Debug, Default)]
pub struct SceneInfo {
    /// Path or `builtin:NAME` that it was loaded from.
    pub spec: String,
    /// Cameras in the rest pose.
    pub cameras: Vec<Camera>,
    /// Name and duration in seconds of each animation.
    pub animations: Vec<(String, f32)>,
    /// Lights of the scene's file.
    pub lights: Vec<Light>,
    /// Index, name and radiance of emissive materials.
    pub emissions: Vec<(usize, String, Vec3)>,
    /// Warnings of the loader.
    pub warnings: Vec<String>,
    /// Notes on what was added to the scene.
    pub notes: Vec<String>,
    /// Number of triangles of all instances.
    pub triangles: usize,
    /// Centre and radius of the bounding sphere, metres.
    pub sphere: (Vec3, f32),
}

/// Description of the machine.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Machine {
    /// Name and driver of the device, or the reason why there is none.
    pub device: String,
    /// Reason why no GPU method can run; none if some can.
    pub no_device: Option<String>,
    /// Reason why methods that trace rays cannot run; none if they can.
    pub no_rays: Option<String>,
}

/// A pane's picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Number of the request that it answers.
    pub request: u64,
    /// Linear radiance; smaller than requested while the view moves.
    pub film: Arc<Film>,
    /// Layer that it shows.
    pub layer: Layer,
    /// Exposure that [`crate::exposure::auto_exposure`] chooses for it, in stops; none if it is not the whole
    /// picture.
    pub auto_stops: Option<f32>,
    /// Pixels of the pane per pixel of the film, along a side.
    pub coarseness: u32,
    /// Statistics; pass times are those of the last batch.
    pub stats: RenderStats,
    /// Number of samples of the last batch, and its duration in seconds.
    pub batch: (u64, f64),
    /// The renderer's plan: passes with their reasons.
    pub plan: Arc<str>,
    /// Positions of the latest samples' VPLs, as fractions of the picture's width and height from its upper
    /// left corner.
    pub vpls: Vec<[f32; 2]>,
    /// Error against the reference and the reference's number of samples, if the error is shown.
    pub error: Option<(Comparison, u32)>,
    /// True if no more samples will be added.
    pub finished: bool,
}

impl Picture {
    /// True if it stands in for the first picture, while the renderer is set up.
    #[must_use]
    pub fn is_preview(&self) -> bool {
        self.stats.samples == 0
    }
}
