//! Buffers of a view: its projection, its projected triangles, and its lists or depth map
//! (shaders/lib/views/view.wesl).

use glam::Vec3;

use crate::gpu::Gpu;
use crate::render::layouts;

/// Bytes of a projected triangle (`ProjectedTriangle` of the shaders).
pub const PROJECTED_TRIANGLE_BYTES: u64 = 40;

/// Returns the capacity that is allocated for a request: an eighth more.
#[must_use]
pub const fn capacity_for(requested: u64) -> u64 {
    requested + requested / 8
}

/// The resolution of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Texels {
    /// Texels along a side of a face.
    pub resolution: u32,
    /// Number of faces: 6 around a point, 1 for a bundle.
    pub faces: u32,
    /// Depth slabs of a bundle's texel, each with a list; 1 for other views.
    pub slabs: u32,
}

impl Texels {
    /// Returns the resolution of a view around a point.
    #[must_use]
    pub const fn around(resolution: u32) -> Self {
        Self { resolution, faces: 6, slabs: 1 }
    }

    /// Returns the number of texels of all faces.
    #[must_use]
    pub fn count(self) -> u64 {
        u64::from(self.resolution) * u64::from(self.resolution) * u64::from(self.faces)
    }

    /// Returns the number of lists.
    #[must_use]
    pub fn lists(self) -> u64 {
        self.count() * u64::from(self.slabs)
    }
}

/// The data structure that answers queries to a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answers {
    /// Lists of triangles.
    Lists {
        /// 32-bit words of a node.
        node_words: u64,
    },
    /// A depth map: the nearest triangle of each texel, or all one bits without a triangle
    /// (shaders/shared/views/depth_maps.wesl).
    DepthMap,
    /// Ray queries, which need only the position and direction of the view.
    Rays,
}

impl Answers {
    /// Returns the 32-bit words of a view's lists or depth map; lists have `node_capacity` nodes.
    #[must_use]
    pub fn words(self, texels: Texels, node_capacity: u64) -> u64 {
        match self {
            Self::Lists { node_words } => texels.lists() + node_words * node_capacity,
            Self::DepthMap => texels.count(),
            Self::Rays => 0,
        }
    }
}

/// Buffers that are needed only while a view is rasterized, shared by all views.
pub struct ViewScratch {
    /// Capacity for draw items.
    pub item_capacity: u64,
    /// 32-bit words of the lists.
    pub list_words: u64,
    /// Draw items (shaders/lib/views/items.wesl).
    pub items: wgpu::Buffer,
    /// Numbers of requested items and nodes.
    pub tally: wgpu::Buffer,
    /// Lists that are reduced to a depth map.
    lists: wgpu::Buffer,
}

impl ViewScratch {
    /// Words of the tally: items and nodes.
    pub const REQUESTED: u64 = 2;

    /// Allocates the buffers for a number of items and of list words.
    #[must_use]
    pub fn new(gpu: &Gpu, item_capacity: u64, list_words: u64) -> Self {
        Self {
            item_capacity,
            list_words,
            items: gpu.storage("items", item_capacity * 16),
            tally: gpu.storage("tally", 4 * Self::REQUESTED),
            lists: gpu.storage("scratch lists", 4 * list_words),
        }
    }

    /// Returns the bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.items.size() + self.tally.size() + self.lists.size()
    }
}

/// Buffers of one view. Pass rasterize_view writes them after [`ViewBuffers::reset`].
pub struct ViewBuffers {
    /// Resolution.
    pub texels: Texels,
    /// Data structure that answers queries.
    pub answers: Answers,
    /// Capacity for list nodes.
    pub node_capacity: u64,
    /// Projection of the view: a `View`.
    pub view: wgpu::Buffer,
    /// Projected triangles, if the view is a parallel projection.
    pub projected_triangles: wgpu::Buffer,
    /// Heads of lists, then nodes; or the depth map.
    pub lists: wgpu::Buffer,
}

impl ViewBuffers {
    /// Allocates a view with the given capacities.
    #[must_use]
    pub fn new(gpu: &Gpu, projected_triangles: u64, texels: Texels, node_capacity: u64, answers: Answers) -> Self {
        let out = Self {
            texels,
            answers,
            node_capacity,
            view: gpu.storage("view", size_of::<layouts::View>() as u64),
            projected_triangles: gpu
                .storage("projected_triangles", projected_triangles.max(1) * PROJECTED_TRIANGLE_BYTES),
            lists: gpu.storage("lists", 4 * answers.words(texels, node_capacity)),
        };
        out.write_view(
            gpu,
            &layouts::View { kind: layouts::view_kind::EMPTY, exclude: u32::MAX, ..Default::default() },
        );
        out
    }

    /// Writes the projection of the view; resolution and slabs come from [`Self::texels`].
    pub fn write_view(&self, gpu: &Gpu, view: &layouts::View) {
        let Texels { resolution, slabs, .. } = self.texels;
        let view = layouts::View { resolution, slabs, ..*view };
        gpu.queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&view));
    }

    /// Returns the buffer of the view's lists: the scratch lists if these are reduced to a depth map.
    #[must_use]
    pub fn listed_in<'a>(&'a self, scratch: &'a ViewScratch) -> &'a wgpu::Buffer {
        if self.answers == Answers::DepthMap { &scratch.lists } else { &self.lists }
    }

    /// Records the clearing of list heads and tally.
    pub fn reset(&self, encoder: &mut wgpu::CommandEncoder, scratch: &ViewScratch) {
        encoder.clear_buffer(self.listed_in(scratch), 0, Some(4 * self.texels.lists()));
        encoder.clear_buffer(&scratch.tally, 0, None);
    }

    /// Returns the bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        [&self.view, &self.projected_triangles, &self.lists].iter().map(|b| b.size()).sum()
    }

    /// Returns the bindings of shaders/visibility/raster.wesl.
    #[must_use]
    pub fn bindings(&self) -> [(&str, wgpu::BindingResource<'_>); 3] {
        [
            ("view", self.view.as_entire_binding()),
            ("lists", self.lists.as_entire_binding()),
            ("projected_triangles", self.projected_triangles.as_entire_binding()),
        ]
    }
}

/// Returns the parallel projection of a bundle: along unit `forward`, through the box `bounds`, rotated by
/// `angle` in radians.
///
/// In exact mode `shift` is None; then the projection does not depend on the resolution, and look-ups return
/// the same bits at any resolution. In fast mode the grid is offset by a fraction of a texel in [0, 1)^2, so
/// that its error averages out over iterations.
#[must_use]
pub fn parallel(
    forward: Vec3,
    bounds: [Vec3; 2],
    angle: f32,
    shift: Option<[f32; 2]>,
    resolution: u32,
) -> layouts::View {
    let (right, up) = forward.any_orthonormal_pair();
    let (sin, cos) = angle.sin_cos();
    let (right, up) = (right * cos + up * sin, up * cos - right * sin);
    let center = 0.5 * (bounds[0] + bounds[1]);
    let half = 0.5 * (bounds[1] - bounds[0]);
    let extent = half.dot(right.abs()).max(half.dot(up.abs()));
    // The margin covers rounding, and the offset.
    let margin = if shift.is_some() { 4.0 / resolution as f32 } else { 1.0 / 64.0 };
    let half_extent = if extent > 0.0 { extent * (1.0 + margin) } else { 1.0 };
    let texel = 2.0 * half_extent / resolution as f32;
    let [x, y] = shift.map_or([0.0; 2], |s| s.map(|s| (s - 0.5) * texel));
    let origin = center + right * x + up * y;
    layouts::View {
        origin: origin.to_array(),
        kind: layouts::view_kind::PARALLEL,
        right: right.to_array(),
        exclude: u32::MAX,
        up: up.to_array(),
        scale: 1.0 / half_extent,
        forward: forward.to_array(),
        ..Default::default()
    }
}
