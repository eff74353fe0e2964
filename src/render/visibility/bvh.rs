//! A compressed wide bounding volume hierarchy (Ylitie, Karras and Laine, HPG 2017), built on the CPU by obvhs
//! and traversed in compute (shaders/visibility/bvh.wesl).

use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::cwbvh::{BRANCHING, CwBvh};
use obvhs::ploc::PlocBuilder;
use web_time::Instant;

use crate::gpu::{Binding, Gpu, GpuError, read_back_async};
use crate::render::visibility::tracer::TracedScene;
use crate::scene::{Geometry, Scene, Sides};

/// Levels that the shader's stack has room for.
const MOST_LEVELS: usize = 32;

/// Triangles of a leaf, which are three bits of a node.
const LEAF: u32 = 3;

/// A triangle on the device: corners, the first with 1 if hits have to be confirmed, the second with the index.
type Triangle = [[u32; 4]; 3];

/// The hierarchy on the device: nodes, then triangles.
pub struct Bvh(wgpu::Buffer);

impl Bvh {
    /// Builds the hierarchy from the positions on the device, which other passes read, too.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails or cannot bind the hierarchy, or if that is too deep.
    pub async fn new(
        gpu: &Gpu,
        on_device: &TracedScene<'_>,
        scene: &Scene,
        geometry: &Geometry,
    ) -> Result<Self, GpuError> {
        let began = Instant::now();
        let positions: Vec<[f32; 4]> = read_back_async(gpu, on_device.positions, geometry.vertices.len()).await?;
        let corners = |triangle: u32| {
            geometry.triangles[triangle as usize].map(|vertex| {
                let [x, y, z, _] = positions[vertex as usize];
                Vec3A::new(x, y, z)
            })
        };
        let count = geometry.triangles.len() as u32;
        let CwBvh { mut nodes, primitive_indices, .. } = build((0..count).map(corners));
        let levels = levels(&nodes);
        if levels > MOST_LEVELS {
            return Err(GpuError::Device(format!(
                "the hierarchy of the scene's triangles has {levels} levels, of which the shader traverses {MOST_LEVELS}; use \
                 --visibility ray-query or exact"
            )));
        }

        let confirmed: Vec<bool> =
            scene.materials.iter().map(|m| m.may_be_passed() || m.sides == Sides::OneCulled).collect();
        let mut triangles: Vec<Triangle> = primitive_indices
            .iter()
            .map(|&index| {
                let [a, b, c] = corners(index).map(|p| p.to_array().map(f32::to_bits));
                let flag = confirmed.get(geometry.materials[index as usize] as usize).copied().unwrap_or_default();
                let flag = f32::from(u8::from(flag)).to_bits();
                [[a[0], a[1], a[2], flag], [b[0], b[1], b[2], index], [c[0], c[1], c[2], 0]]
            })
            .collect();
        // A node without children is never left for another one.
        if nodes.is_empty() {
            (nodes, triangles) = (vec![CwBvhNode::default()], vec![Triangle::default()]);
        }
        // Triangles begin at a multiple of their size.
        let before = size_of_val(&*nodes).div_ceil(size_of::<Triangle>());
        nodes.iter_mut().for_each(|node| node.primitive_base_idx += before as u32);
        let mut contents = bytemuck::cast_slice::<_, u8>(&nodes).to_vec();
        contents.resize(before * size_of::<Triangle>(), 0);
        contents.extend_from_slice(bytemuck::cast_slice(&triangles));
        let bytes = contents.len() as u64;
        let limit = gpu.capabilities.max_storage_bytes;
        if bytes > limit {
            return Err(GpuError::Device(format!(
                "the hierarchy of the scene's {count} triangles needs a binding of {bytes} bytes; the adapter's limit is {limit}; \
                 simplify the scene, or use --visibility ray-query or exact"
            )));
        }
        let this = Self(gpu.upload("bvh", &contents));
        let millis = began.elapsed().as_secs_f64() * 1e3;
        log::debug!("bvh: {} nodes on {levels} levels over {count} triangles in {millis:.1} ms", nodes.len());
        Ok(this)
    }

    /// Returns the bindings of shaders/visibility/bvh.wesl.
    #[must_use]
    pub fn bindings(&self) -> [Binding<'_>; 1] {
        [("bvh", self.0.as_entire_binding())]
    }

    /// Returns the bytes of the buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.0.size()
    }
}

/// Builds the hierarchy over triangles.
///
/// Boxes are enlarged by 8 units of rounding, which also covers the rounding of their quantization.
fn build(triangles: impl ExactSizeIterator<Item = [Vec3A; 3]>) -> CwBvh {
    let indices: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut boxes: Vec<Aabb> = triangles.map(|[a, b, c]| Aabb::new(a.min(b).min(c), a.max(b).max(c))).collect();
    let size = boxes.iter().fold(0.0, |size: f32, b| size.max(b.min.abs().max(b.max.abs()).max_element()));
    let margin = Vec3A::splat(size * f32::EPSILON * 8.0);
    for b in &mut boxes {
        *b = Aabb::new(b.min - margin, b.max + margin);
    }
    let parameters = BvhBuildParams::medium_build();
    let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
        parameters.ploc_search_distance,
        &boxes,
        indices,
        parameters.sort_precision,
        parameters.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut binary, parameters.reinsertion_batch_ratio, None);
    bvh2_to_cwbvh(&binary, LEAF, true, false)
}

/// Returns the number of levels of nodes.
fn levels(nodes: &[CwBvhNode]) -> usize {
    // Children come after their parents.
    let mut levels = vec![1; nodes.len()];
    for (at, node) in nodes.iter().enumerate() {
        for child in (0..BRANCHING).filter(|&child| !node.is_leaf(child)) {
            levels[node.child_node_index(child) as usize] = levels[at] + 1;
        }
    }
    levels.into_iter().max().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_count_the_longest_path() {
        let none: [[Vec3A; 3]; 0] = [];
        assert_eq!(levels(&build(none.into_iter()).nodes), 0);
        let row = |count: usize| (0..count).map(|n| [Vec3A::X, Vec3A::Y, Vec3A::Z].map(|p| p + n as f32 * 2.0));
        assert_eq!(levels(&build(row(1)).nodes), 1);
        assert_eq!(levels(&build(row(LEAF as usize * BRANCHING + 1)).nodes), 2);
        let all = build(row(1000));
        assert!((3..=8).contains(&levels(&all.nodes)), "{}", levels(&all.nodes));
        let mut seen = all.primitive_indices;
        seen.sort_unstable();
        assert!(seen.into_iter().eq(0..1000), "a triangle is missing");
    }
}
