//! Converts vertices and triangles to the layout of shaders.

use glam::Vec4;

use crate::render::layouts;
use crate::scene::model::stats::{triangles_vary, with_room};
use crate::scene::{Geometry, Scene};

/// Vertices and triangles in the layout of shaders. Degenerate triangles, which rays cannot hit, fill the
/// capacity if their number changes from frame to frame. An empty scene has one degenerate triangle.
pub(super) struct VertexData {
    pub(super) positions: Vec<[f32; 4]>,
    /// Attributes as bytes, since their layout depends on the presence of textures.
    pub(super) attributes: Vec<u8>,
    pub(super) triangles: Vec<layouts::Triangle>,
}

impl VertexData {
    pub(super) fn new(geometry: &Geometry, capacity: Capacity, textured: bool) -> Self {
        let bytes = layouts::Attributes::bytes(textured);
        if geometry.triangles.is_empty() {
            return Self {
                positions: vec![[0.0; 4]; 3],
                attributes: vec![0; 3 * bytes],
                triangles: vec![layouts::Triangle { vertices: [0, 1, 2], material: 0 }],
            };
        }
        let mut attributes = Vec::with_capacity(capacity.vertices * bytes);
        for v in &geometry.vertices {
            let all = layouts::Attributes {
                normal: v.normal.to_array(),
                color: packed(v.color),
                tangent: v.tangent.to_array(),
                uv: [v.uvs[0].x, v.uvs[0].y, v.uvs[1].x, v.uvs[1].y],
            };
            attributes.extend_from_slice(&bytemuck::bytes_of(&all)[..bytes]);
        }
        attributes.resize(capacity.vertices * bytes, 0);
        let mut out = Self {
            positions: geometry.vertices.iter().map(|v| v.position.extend(0.0).to_array()).collect(),
            attributes,
            triangles: triangles(geometry, capacity.triangles),
        };
        out.positions.resize(capacity.vertices, [0.0; 4]);
        out
    }
}

/// The capacity of buffers for vertices and triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Capacity {
    pub(super) vertices: usize,
    pub(super) triangles: usize,
    /// True if the numbers change from frame to frame.
    pub(super) varies: bool,
}

impl Capacity {
    pub(super) fn new(scene: &Scene, geometry: &Geometry) -> Self {
        let varies = triangles_vary(scene);
        let capacity = |count: usize| if varies { with_room(count) } else { count };
        Self { vertices: capacity(geometry.vertices.len()), triangles: capacity(geometry.triangles.len()), varies }
    }

    /// True if a geometry fits: the numbers are equal, or, if they vary, at least a quarter of the capacity
    /// is used.
    pub(super) fn holds(self, geometry: &Geometry) -> bool {
        let holds = |capacity: usize, count: usize| {
            if self.varies { (capacity / 4..=capacity).contains(&count) } else { capacity == count }
        };
        holds(self.vertices, geometry.vertices.len()) && holds(self.triangles, geometry.triangles.len())
    }
}

/// Returns the triangles of a geometry.
pub(super) fn triangles_of(geometry: &Geometry) -> impl Iterator<Item = layouts::Triangle> {
    let triangles = geometry.triangles.iter().zip(&geometry.materials);
    triangles.map(|(&vertices, &material)| layouts::Triangle { vertices, material })
}

/// Returns the triangles of a geometry, followed by degenerate ones up to the capacity.
pub(super) fn triangles(geometry: &Geometry, capacity: usize) -> Vec<layouts::Triangle> {
    let mut out: Vec<_> = triangles_of(geometry).collect();
    out.resize(capacity, layouts::Triangle::default());
    out
}

/// Packs a linear colour to 8 bits per channel.
pub(super) fn packed(color: Vec4) -> u32 {
    u32::from_le_bytes(color.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
}
