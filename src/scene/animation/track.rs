//! Animation tracks: their targets and curves.

use crate::scene::animation::curve::Curve;

/// The target of a track. Node indices are the rig's, camera and light indices the file's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Translation of a node in metres.
    Translation(usize),
    /// Rotation of a node.
    Rotation(usize),
    /// Scale of a node.
    Scale(usize),
    /// Morph target weights of the mesh at a node.
    Weights(usize),
    /// Linear RGB of a light.
    LightColor(usize),
    /// Intensity of a light in W/sr or W/m^2 for a colour of 1.
    LightIntensity(usize),
    /// Vertical angle of view of a camera, radians.
    FieldOfView(usize),
    /// A factor of a material.
    Material(usize, Factor),
}

/// A factor of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Factor {
    /// Linear RGB, and the factor of the opacity, which opaque materials ignore.
    BaseColor,
    /// 0 to 1.
    Metallic,
    /// 0 to 1.
    Roughness,
    /// Linear RGB, times the strength given by the file.
    Emissive,
}

impl Target {
    /// Returns the number of components of a value, or `None` if the mesh decides.
    #[must_use]
    pub fn width(self) -> Option<usize> {
        match self {
            Self::Weights(_) => None,
            Self::Rotation(_) | Self::Material(_, Factor::BaseColor) => Some(4),
            Self::Translation(_) | Self::Scale(_) | Self::LightColor(_) | Self::Material(_, Factor::Emissive) => {
                Some(3)
            }
            Self::LightIntensity(_) | Self::FieldOfView(_) | Self::Material(..) => Some(1),
        }
    }
}

/// A named set of tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    /// Its name in the file, or its JSON path if it has none.
    pub name: String,
    /// Each target with the index of its curve.
    pub tracks: Vec<(Target, usize)>,
    /// Curves of the tracks.
    pub curves: Vec<Curve>,
}

impl Animation {
    /// Returns the time of the last key in seconds.
    #[must_use]
    pub fn seconds(&self) -> f32 {
        self.tracks.iter().map(|&(_, curve)| self.curves[curve].end()).fold(0.0, f32::max)
    }
}
