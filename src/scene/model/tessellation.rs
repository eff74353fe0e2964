//! Settings of surface refinement: Phong tessellation (Boubekeur and Alexa, "Phong Tessellation", 2008) and
//! displacement.
//!
//! A mesh with a [`Tessellation`] is a control mesh, which [`crate::scene::tessellation::refine`] subdivides
//! when the scene is flattened. Factors belong to edges and depend only on the edge's ends and the scene's
//! [`Viewpoint`], so that neighbouring triangles agree and all methods, from camera and lights alike, see the
//! same surface.

use std::collections::HashMap;

use glam::Vec3;

use crate::scene::model::height::Height;
use crate::scene::model::mesh::Mesh;
use crate::scene::model::normals::smooth_normals;

/// Maximum number of parts of an edge, as in graphics hardware.
pub const MAX_FACTOR: u32 = 64;

/// Maximum displacement in metres.
pub const MAX_METRES: f32 = 1e6;

/// The shape factor of the paper's figures: 3/4 between the flat triangle and its projections.
pub const PHONG: f32 = 0.75;

/// The number of parts of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeFactor {
    /// The same number for each edge, 1 to [`MAX_FACTOR`].
    Fixed(u32),
    /// The number that makes a part about this many pixels long, measured from the scene's [`Viewpoint`] and
    /// independent of the directions of edge and view.
    Pixels(f32),
}

/// Refinement of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Tessellation {
    /// Number of parts of each edge.
    pub factor: EdgeFactor,
    /// Phong tessellation's shape factor, 0 (flat) to 1.
    pub phong: f32,
    /// Displacement along the welded normals: vertices at one position share their normal.
    pub displacement: Option<Displacement>,
}

/// A displacement by scale * height + bias metres of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// Height function; without unit except for waves, which are in metres.
    pub height: Height,
    /// Displacement in metres of the height 1.
    pub scale: f32,
    /// Displacement in metres of the height 0.
    pub bias: f32,
}

/// The image whose pixels measure the length of edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Viewpoint {
    /// Index into the scene's cameras.
    pub camera: usize,
    /// Columns and rows of the image.
    pub size: [u32; 2],
}

impl Default for Tessellation {
    fn default() -> Self {
        Self { factor: EdgeFactor::Fixed(1), phong: PHONG, displacement: None }
    }
}

impl Tessellation {
    /// Sets a mesh's tessellation. A mesh without normals gets smooth ones, welded across vertices at one
    /// position.
    pub fn refine(self, mesh: &mut Mesh) {
        if mesh.normals.is_empty() {
            let welds = weld(&mesh.positions);
            let triangles: Vec<_> = mesh.triangles.iter().map(|t| t.map(|v| welds[v as usize])).collect();
            let normals = smooth_normals(&mesh.positions, &triangles);
            mesh.normals = welds.iter().map(|&v| normals[v as usize]).collect();
        }
        mesh.tessellation = Some(self);
    }

    /// Validates all values.
    ///
    /// A value out of range is an error; the message names the valid range.
    pub fn check(&self) -> Result<(), String> {
        match self.factor {
            EdgeFactor::Fixed(parts) if !(1..=MAX_FACTOR).contains(&parts) => {
                return Err(format!("edges cannot be cut into {parts} parts: 1 to {MAX_FACTOR} are possible"));
            }
            EdgeFactor::Pixels(pixels) if !(0.25..=4096.0).contains(&pixels) => {
                return Err(format!("parts of edges cannot be {pixels} pixels long: 0.25 to 4096 are possible"));
            }
            _ => {}
        }
        if !(0.0..=1.0).contains(&self.phong) {
            return Err(format!("the shape factor of Phong tessellation is {}: it has to be 0 to 1", self.phong));
        }
        let Some(Displacement { height, scale, bias }) = &self.displacement else { return Ok(()) };
        if ![scale, bias].iter().all(|metres| metres.abs() <= MAX_METRES) {
            return Err(format!(
                "the displacement's scale {scale} and bias {bias} have to be at most {MAX_METRES} metres"
            ));
        }
        height.check()
    }

    /// Returns true if the displacement is animated.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.displacement.as_ref().is_some_and(|d| d.height.moves())
    }
}

impl Mesh {
    /// Returns the mesh's tessellation; a mesh without normals is never refined (see
    /// [`Tessellation::refine`]).
    #[must_use]
    pub fn refinement(&self) -> Option<&Tessellation> {
        self.tessellation.as_ref().filter(|_| !self.normals.is_empty())
    }
}

impl Displacement {
    /// Freezes the animation at a time in seconds.
    #[must_use]
    pub fn at(&self, seconds: f32) -> Self {
        Self { height: self.height.at(seconds), ..*self }
    }
}

/// Returns, for each position, the first index with the same position.
#[must_use]
pub fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut first = HashMap::with_capacity(positions.len());
    // Adding zero turns -0 into 0, so that both compare equal.
    let bits = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    (0..).zip(positions).map(|(i, &p)| *first.entry(bits(p)).or_insert(i)).collect()
}
