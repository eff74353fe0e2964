//! What the window asks the studio for, and what it gets.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;

use crate::film::Film;
use crate::metrics::Comparison;
use crate::renderer::RenderStats;
use crate::scene::{Camera, Light, Scene};
use crate::settings::{Method, OnlyStrategy, Settings};
use crate::staging::Staging;
use crate::tonemap::Grade;

/// Which scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// A path or `builtin:NAME`.
    pub spec: String,
    /// What is asked for in place of its own camera and light.
    pub staging: Staging,
}

/// What a pane shows of its method's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layer {
    /// The picture.
    #[default]
    Light,
    /// What one strategy gives of it.
    Strategy(OnlyStrategy),
    /// How far it is from the reference's picture, which is rendered beside it.
    Error,
    /// Metres from the camera, in shares of the farthest.
    Distance,
    /// Normals: -1 to 1 as 0 to 1.
    Normal,
    /// What surfaces give back of light.
    Albedo,
    /// How many entries of its list the look-up of each pixel along the first bundle walks; of `raster` alone.
    Lists,
}

impl Layer {
    /// Whether light has no part in it.
    #[must_use]
    pub fn is_feature(self) -> bool {
        matches!(self, Self::Distance | Self::Normal | Self::Albedo)
    }

    /// Whether a method has it.
    #[must_use]
    pub fn is_of(self, method: Method) -> bool {
        match self {
            Self::Strategy(only) => method.has_strategy(only.s, only.t),
            Self::Lists => method == Method::Raster,
            _ => true,
        }
    }

    /// Whether exposure and tone curve apply to it.
    #[must_use]
    pub fn is_radiance(self) -> bool {
        matches!(self, Self::Light | Self::Strategy(_))
    }
}

/// A part of the window and what is in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Pane {
    /// With the size of the whole picture.
    pub settings: Settings,
    /// What of it.
    pub layer: Layer,
}

/// Lights and emissive materials that are not as the file has them, by index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edits {
    /// Of the scene's lights.
    pub lights: BTreeMap<usize, Light>,
    /// Radiance of materials.
    pub emissions: BTreeMap<usize, Vec3>,
}

impl Edits {
    /// Whether the scene is as its file has it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lights.is_empty() && self.emissions.is_empty()
    }

    /// Changes a scene; indices that it does not have are ignored.
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

/// Everything that decides what is seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// Which one it is; pictures say which they are of.
    pub number: u64,
    /// The scene.
    pub source: Source,
    /// An animation's index and seconds; none: the scene at rest.
    pub pose: Option<(usize, f32)>,
    /// In place of the one that the settings name.
    pub camera: Option<Camera>,
    /// What is not as in the file.
    pub edits: Edits,
    /// One, or two to compare.
    pub panes: Vec<Pane>,
    /// Whether it changes right now, so that a picture soon is worth more than a sharp one.
    pub moving: bool,
}

/// What the window may ask for.
#[derive(Clone, Debug)]
pub enum Command {
    /// Show this from now on.
    Show(Box<Order>),
    /// Write the picture of a pane: .exr holds what was computed, .png what the grade makes of it.
    Save {
        /// Which pane.
        pane: usize,
        /// The file.
        path: PathBuf,
        /// How it is shown.
        grade: Grade,
    },
}

/// What of a scene the window needs to know.
#[derive(Clone, Debug, Default)]
pub struct Card {
    /// What it was loaded from.
    pub spec: String,
    /// At rest.
    pub cameras: Vec<Camera>,
    /// Name and seconds of each.
    pub animations: Vec<(String, f32)>,
    /// As the file has them.
    pub lights: Vec<Light>,
    /// Index, name and radiance of materials that shine.
    pub emissions: Vec<(usize, String, Vec3)>,
    /// What the loader said.
    pub warnings: Vec<String>,
    /// What was added to it.
    pub notes: Vec<String>,
    /// Triangles of all instances.
    pub triangles: usize,
    /// Middle and radius of the sphere around it, metres.
    pub sphere: (Vec3, f32),
}

/// What is known of the machine.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Machine {
    /// Name and driver of the device, or why there is none.
    pub device: String,
    /// Why there is no GPU method at all, if so.
    pub no_device: Option<String>,
    /// Why methods that trace rays are not to be had, if so.
    pub no_rays: Option<String>,
}

/// A pane's picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Of which order.
    pub order: u64,
    /// Linear; smaller than asked for while things move.
    pub film: Arc<Film>,
    /// What it shows.
    pub layer: Layer,
    /// The exposure that [`crate::tonemap::auto_exposure`] gives it, in stops; none where it is not the whole picture.
    pub auto_stops: Option<f32>,
    /// How many pixels of the pane are one of the film, along a side.
    pub coarseness: u32,
    /// Counts; the passes are those of the last batch.
    pub stats: RenderStats,
    /// Samples of the last batch, and the seconds that it took.
    pub batch: (u64, f64),
    /// What each sample does and why.
    pub plan: Arc<str>,
    /// Where the VPLs of its latest samples are, shares of the picture's width and height from its upper left corner.
    pub vpls: Vec<[f32; 2]>,
    /// How far it is from the reference and how many samples that has, where it is shown.
    pub error: Option<(Comparison, u32)>,
    /// Whether no more samples will come.
    pub finished: bool,
}
