//! The data structure that rays are traced through (shaders/visibility/rays.wesl).

use glam::Vec3;

use crate::gpu::{Binding, Flag, Gpu, GpuError};
use crate::render::visibility::acceleration::Acceleration;
use crate::render::visibility::bvh::Bvh;
use crate::render::visibility::grid::Grid;
use crate::scene::{Geometry, Scene};
use crate::settings::Visibility;

/// The algorithms that trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tracing {
    /// Ray queries of the GPU.
    RayQuery,
    /// A grid of triangle lists that is rasterized once per pose.
    Grid,
    /// A bounding volume hierarchy, built on the CPU and traversed in compute.
    Bvh,
}

impl Tracing {
    /// Returns the algorithm for rays with a visibility; depth maps do not answer rays, and leave them to a
    /// grid.
    #[must_use]
    pub fn of(visibility: Visibility) -> Self {
        match visibility {
            Visibility::RayQuery => Self::RayQuery,
            Visibility::Bvh => Self::Bvh,
            Visibility::Exact | Visibility::Fast => Self::Grid,
        }
    }

    /// Checks that the device has what the algorithm needs: shaders of other algorithms do not compile there.
    ///
    /// # Errors
    /// [`GpuError::Device`] if it was opened without ray queries that are asked for.
    pub fn check(self, gpu: &Gpu) -> Result<(), GpuError> {
        if self == Self::RayQuery && !gpu.capabilities.ray_queries {
            return Err(GpuError::Device("it was opened without ray queries".to_owned()));
        }
        Ok(())
    }

    /// Returns the flags of shaders that trace rays.
    #[must_use]
    pub fn flags(self) -> &'static [Flag] {
        match self {
            Self::RayQuery => &[],
            Self::Grid => &[Flag::Grid],
            Self::Bvh => &[Flag::Bvh],
        }
    }
}

/// A scene on the device in its pose, as the structures are built from it.
pub struct TracedScene<'a> {
    /// The bindings of group 0.
    pub bindings: Vec<Binding<'a>>,
    /// Positions of vertices, 16 bytes each.
    pub positions: &'a wgpu::Buffer,
    /// Number of triangles.
    pub triangles: u32,
    /// Bounding box, metres.
    pub bounds: [Vec3; 2],
}

/// The data structure of a scene in its pose.
pub enum Tracer {
    /// For [`Tracing::RayQuery`].
    RayQuery(Acceleration),
    /// For [`Tracing::Grid`].
    Grid(Box<Grid>),
    /// For [`Tracing::Bvh`].
    Bvh(Bvh),
}

impl Tracer {
    /// Builds the structure from the scene's positions on the device, in the buffers of the one of the previous
    /// pose where that is possible.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails, or cannot bind the structure.
    pub async fn new(
        gpu: &Gpu,
        tracing: Tracing,
        previous: Option<Self>,
        on_device: &TracedScene<'_>,
        scene: &Scene,
        geometry: &Geometry,
    ) -> Result<Self, GpuError> {
        let kept = match (tracing, previous) {
            (Tracing::Grid, Some(Self::Grid(grid))) => Some(grid),
            // Other structures are freed before they are built anew.
            _ => None,
        };
        Ok(match tracing {
            Tracing::RayQuery => Self::RayQuery(Acceleration::new(gpu, on_device.positions, scene, geometry)),
            Tracing::Grid => match kept {
                Some(mut grid) => {
                    grid.rebuild(gpu, on_device).await?;
                    Self::Grid(grid)
                }
                None => Self::Grid(Box::new(Grid::new(gpu, on_device).await?)),
            },
            Tracing::Bvh => Self::Bvh(Bvh::new(gpu, on_device, scene, geometry).await?),
        })
    }

    /// Returns the bindings of shaders that trace rays.
    #[must_use]
    pub fn bindings(&self) -> Vec<Binding<'_>> {
        match self {
            Self::RayQuery(acceleration) => acceleration.bindings().to_vec(),
            Self::Grid(grid) => grid.bindings().to_vec(),
            Self::Bvh(bvh) => bvh.bindings().to_vec(),
        }
    }

    /// Returns the bytes of the buffers; those of acceleration structures are not known.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        match self {
            Self::RayQuery(_) => 0,
            Self::Grid(grid) => grid.bytes(),
            Self::Bvh(bvh) => bvh.bytes(),
        }
    }
}
