//! A view's buffers: where it looks, its triangles' outlines, and its lists or depth map (shaders/lib/view.wesl).

use glam::Vec3;

use crate::gpu::Gpu;
use crate::layouts;

/// Bytes of a triangle's outline (shaders/lib/seen.wesl).
pub const OUTLINE_BYTES: u64 = 40;

/// Room that is made where so much was wanted.
#[must_use]
pub const fn room_for(wanted: u64) -> u64 {
    wanted + wanted / 8
}

/// Texels of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Texels {
    /// Along a side of a face.
    pub resolution: u32,
    /// Faces that there is room for: 6 around a point, 1 for a bundle.
    pub faces: u32,
    /// Slabs of depths that a bundle's texel keeps lists for; 1 for others.
    pub slabs: u32,
}

impl Texels {
    /// Of a view around a point.
    #[must_use]
    pub const fn around(resolution: u32) -> Self {
        Self { resolution, faces: 6, slabs: 1 }
    }

    /// Of all faces.
    #[must_use]
    pub fn count(self) -> u64 {
        u64::from(self.resolution) * u64::from(self.resolution) * u64::from(self.faces)
    }

    /// Lists that there are.
    #[must_use]
    pub fn lists(self) -> u64 {
        self.count() * u64::from(self.slabs)
    }
}

/// What answers for a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answers {
    /// Lists with nodes of this many words.
    Lists {
        /// Words of a node.
        node_words: u64,
    },
    /// A depth map: the nearest triangle of each texel, all ones bits where there is none (shaders/depth_maps.wesl).
    DepthMap,
    /// Ray queries: nothing is kept beside the place and direction.
    Rays,
}

impl Answers {
    /// Words that are kept for a view with room for so many nodes.
    #[must_use]
    pub fn words(self, texels: Texels, node_room: u64) -> u64 {
        match self {
            Self::Lists { node_words } => texels.lists() + node_words * node_room,
            Self::DepthMap => texels.count(),
            Self::Rays => 0,
        }
    }
}

/// What a view leaves behind only while it is filled, shared by all.
pub struct ViewScratch {
    /// Items that fit.
    pub item_room: u64,
    /// Words of the lists.
    pub list_words: u64,
    /// What triangles may touch (shaders/lib/items.wesl).
    pub items: wgpu::Buffer,
    /// How many items and nodes there are.
    pub tally: wgpu::Buffer,
    /// Lists that a depth map is made of.
    lists: wgpu::Buffer,
}

impl ViewScratch {
    /// Words of the tally: items and nodes.
    pub const WANTED: u64 = 2;

    /// Allocates room for so many items, and lists of so many words.
    #[must_use]
    pub fn new(gpu: &Gpu, item_room: u64, list_words: u64) -> Self {
        Self {
            item_room,
            list_words,
            items: gpu.storage("items", item_room * 16),
            tally: gpu.storage("tally", 4 * Self::WANTED),
            lists: gpu.storage("scratch lists", 4 * list_words),
        }
    }

    /// Bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.items.size() + self.tally.size() + self.lists.size()
    }
}

/// Buffers of one view. The passes fill them; [`ViewBuffers::reset`] empties them.
pub struct ViewBuffers {
    /// What it is made of.
    pub texels: Texels,
    /// What answers for it.
    pub answers: Answers,
    /// Nodes that fit.
    pub node_room: u64,
    /// Where it looks: a `View`.
    pub view: wgpu::Buffer,
    /// Corners of each triangle as it sees them, where it may look along one direction.
    pub outlines: wgpu::Buffer,
    /// Heads, then nodes; or the depth map.
    pub lists: wgpu::Buffer,
}

impl ViewBuffers {
    /// Allocates a view with the given room.
    #[must_use]
    pub fn new(gpu: &Gpu, outlines: u64, texels: Texels, node_room: u64, answers: Answers) -> Self {
        let out = Self {
            texels,
            answers,
            node_room,
            view: gpu.storage("view", size_of::<layouts::View>() as u64),
            outlines: gpu.storage("outlines", outlines.max(1) * OUTLINE_BYTES),
            lists: gpu.storage("lists", 4 * answers.words(texels, node_room)),
        };
        out.look(gpu, &layouts::View { kind: layouts::View::EMPTY, exclude: u32::MAX, ..Default::default() });
        out
    }

    /// Points the view somewhere; its resolution and slabs are filled in.
    pub fn look(&self, gpu: &Gpu, view: &layouts::View) {
        let Texels { resolution, slabs, .. } = self.texels;
        let view = layouts::View { resolution, slabs, ..*view };
        gpu.queue.write_buffer(&self.view, 0, bytemuck::bytes_of(&view));
    }

    /// Where its triangles are listed.
    #[must_use]
    pub fn listed_in<'a>(&'a self, scratch: &'a ViewScratch) -> &'a wgpu::Buffer {
        if self.answers == Answers::DepthMap { &scratch.lists } else { &self.lists }
    }

    /// Records that the lists and the tally start empty.
    pub fn reset(&self, encoder: &mut wgpu::CommandEncoder, scratch: &ViewScratch) {
        encoder.clear_buffer(self.listed_in(scratch), 0, Some(4 * self.texels.lists()));
        encoder.clear_buffer(&scratch.tally, 0, None);
    }

    /// Bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        [&self.view, &self.outlines, &self.lists].iter().map(|b| b.size()).sum()
    }

    /// The bindings of group 2 (shaders/visibility/raster.wesl).
    #[must_use]
    pub fn bindings(&self) -> [(&str, wgpu::BindingResource<'_>); 3] {
        [
            ("view", self.view.as_entire_binding()),
            ("lists", self.lists.as_entire_binding()),
            ("outlines", self.outlines.as_entire_binding()),
        ]
    }
}

/// A bundle along unit `forward` through the box `bounds`, turned by `angle`.
///
/// Exact mode has no `shift`: then nothing here depends on the resolution, and look-ups give the same bits at any. Fast mode
/// moves the grid by a share of a texel in [0, 1), and turns it, so that its error averages out over iterations.
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
    // A margin for rounding, and for the shift.
    let margin = if shift.is_some() { 4.0 / resolution as f32 } else { 1.0 / 64.0 };
    let half_extent = if extent > 0.0 { extent * (1.0 + margin) } else { 1.0 };
    let texel = 2.0 * half_extent / resolution as f32;
    let [x, y] = shift.map_or([0.0; 2], |s| s.map(|s| (s - 0.5) * texel));
    let origin = center + right * x + up * y;
    layouts::View {
        origin: origin.to_array(),
        kind: layouts::View::PARALLEL,
        right: right.to_array(),
        exclude: u32::MAX,
        up: up.to_array(),
        scale: 1.0 / half_extent,
        forward: forward.to_array(),
        ..Default::default()
    }
}
