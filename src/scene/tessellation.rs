//! What a scene says of finer surfaces: Phong tessellation (Boubekeur and Alexa, "Phong Tessellation", 2008) and displacement.
//!
//! A mesh that has a [`Tessellation`] is a control mesh: [`super::refine`] cuts its triangles when the scene is flattened. Factors belong
//! to edges and depend on nothing but the edge's ends and the scene's [`Viewpoint`], so that neighbours agree and every method, light
//! and camera alike, meets the same surface.

use glam::Vec3;

use super::height::Height;
use super::shapes::smooth_normals;
use super::{Camera, Mesh, Projection, Scene, refine};

/// Parts that an edge may be cut into, as in graphics hardware.
pub const MAX_FACTOR: u32 = 64;

/// Metres by which a height may displace.
pub const MAX_METRES: f32 = 1e6;

/// The shape factor of the paper's figures: 3/4 of the way from the flat triangle to the projections.
pub const PHONG: f32 = 0.75;

/// Into how many parts edges are cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeFactor {
    /// Each into as many, 1 to [`MAX_FACTOR`].
    Fixed(u32),
    /// As many as leave parts of about so many pixels of the scene's [`Viewpoint`], whichever way an edge points or the camera looks.
    Pixels(f32),
}

/// How a mesh is made finer.
#[derive(Clone, Debug, PartialEq)]
pub struct Tessellation {
    /// Parts of edges.
    pub factor: EdgeFactor,
    /// Phong tessellation's shape factor, 0 (flat) to 1.
    pub phong: f32,
    /// What the finer surface is moved by, along the normals that vertices at one place have together.
    pub displacement: Option<Displacement>,
}

/// A surface moves by scale * height + bias metres of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// Which height, without unit but where it says so.
    pub height: Height,
    /// Metres of the height 1.
    pub scale: f32,
    /// Metres of the height 0.
    pub bias: f32,
}

/// Whose pixels edges are measured in.
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
    /// Makes a mesh one that is refined so. Where it has no normals it gets smooth ones, across vertices at one place.
    pub fn refine(self, mesh: &mut Mesh) {
        if mesh.normals.is_empty() {
            let welds = refine::weld(&mesh.positions);
            let triangles: Vec<_> = mesh.triangles.iter().map(|t| t.map(|v| welds[v as usize])).collect();
            let normals = smooth_normals(&mesh.positions, &triangles);
            mesh.normals = welds.iter().map(|&v| normals[v as usize]).collect();
        }
        mesh.tessellation = Some(self);
    }

    /// Whether all values make sense.
    ///
    /// # Errors
    /// What is wrong and which values are right.
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

    /// Whether the surface changes with time while nothing else does.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.displacement.as_ref().is_some_and(|d| d.height.moves())
    }
}

impl Mesh {
    /// How it is refined; a mesh without normals never is (see [`Tessellation::refine`]).
    #[must_use]
    pub fn refinement(&self) -> Option<&Tessellation> {
        self.tessellation.as_ref().filter(|_| !self.normals.is_empty())
    }
}

impl Scene {
    /// Whether [`Scene::at`] gives anything else at another time.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.rig.is_some() || self.meshes.iter().filter_map(Mesh::refinement).any(Tessellation::moves)
    }
}

/// Pixels that a metre spans at a distance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    eye: Vec3,
    /// At a distance of 1 m; of a parallel camera, everywhere.
    pixels: f32,
    parallel: bool,
}

impl Scale {
    /// Of a scene's viewpoint; a scene without one has that of its first camera's own image. None where there is no camera.
    pub fn new(scene: &Scene) -> Option<Self> {
        let camera = scene.cameras.get(scene.viewpoint.map_or(0, |v| v.camera))?;
        let (width, height) = camera.film_size.unwrap_or((512, 512));
        Some(Self::of(camera, scene.viewpoint.map_or([width, height], |v| v.size)))
    }

    fn of(camera: &Camera, [width, height]: [u32; 2]) -> Self {
        let half = camera.half_extent(width.max(1), height.max(1));
        Self {
            eye: camera.world_from_camera.translation.into(),
            pixels: 0.5 * width.max(1) as f32 / half.x,
            parallel: matches!(camera.projection, Projection::Orthographic { .. }),
        }
    }

    /// Parts of about so many pixels that an edge has. The edge is taken as if it were seen from the side, from as far away as its
    /// middle, so that surfaces seen in mirrors or by light alone are as fine as any. Symmetric in the ends.
    pub fn parts(&self, pixels: f32, a: Vec3, b: Vec3) -> u32 {
        let length = a.distance(b);
        let away = if self.parallel { 1.0 } else { self.eye.distance(0.5 * (a + b)).max(0.5 * length) };
        let parts = (length * self.pixels / (away * pixels)).ceil();
        // A number that is none is 0 here.
        (parts as u32).clamp(1, MAX_FACTOR)
    }
}
