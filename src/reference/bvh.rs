//! Closest hits and occlusion: a four-wide bounding volume hierarchy with leaves of four triangles.
//!
//! obvhs builds a binary tree (PLOC with reinsertion, Meister et al.), which is collapsed into nodes of four
//! boxes that are tested together in SSE lanes. Four triangles at a time are tested by the watertight
//! intersection of Woop, Benthin and Wald (JCGT 2013) with inclusive edges on both sides, so that no ray
//! passes between the triangles of a closed mesh. Boxes are enlarged by the rounding error, so that none is
//! missed that contains a hit.

use glam::{BVec4A, Vec3, Vec3A, Vec4};
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::triangle::Triangle;

use crate::scene::Geometry;

/// Index of no triangle.
pub const NONE: u32 = u32::MAX;

/// Flag of a child index that refers to a leaf.
const LEAF: u32 = 1 << 31;

/// Deepest traversal stack that is kept on the thread's stack; deeper trees allocate.
const STACK: usize = 96;

/// A hit of a ray with a triangle at (1 - u - v) p0 + u p1 + v p2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into [`Geometry::triangles`].
    pub triangle: u32,
    /// Distance in units of the length of the ray's direction.
    pub t: f32,
    /// Barycentric weights of the second and the third corner.
    pub bary: [f32; 2],
}

impl Hit {
    /// Interpolates attributes of the triangle's corners.
    #[inline(always)]
    pub fn mix<T: std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>>(&self, [a, b, c]: [T; 3]) -> T {
        let [u, v] = self.bary;
        a * (1.0 - u - v) + b * u + c * v
    }
}

/// Four boxes: `bounds[0]` are the minima and `bounds[1]` the maxima by axis; an empty slot is inverted.
struct Node {
    bounds: [[Vec4; 3]; 2],
    children: [u32; 4],
}

/// Up to four triangles; `corners[axis][corner]` has a lane for each. Unused lanes are degenerate and never
/// hit.
struct Packet {
    corners: [[Vec4; 3]; 3],
    ids: [u32; 4],
    /// Bit mask of the lanes whose hits a query's filter has to confirm.
    filtered: u32,
}

/// The hierarchy over all triangles of a scene.
pub struct Bvh {
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    root: Option<u32>,
    stack: usize,
}

/// A ray prepared for box and triangle tests.
struct Ray {
    origin: Vec3,
    inverse: Vec3,
    /// Index of the nearer bound (0 minimum, 1 maximum) by axis.
    near: [usize; 3],
    /// Axes of the sheared space; the last is the direction's largest component.
    axes: [usize; 3],
    shear: Vec3,
}

impl Ray {
    fn new(origin: Vec3, direction: Vec3) -> Self {
        // Zero components get a huge inverse: inside the slab the interval is the whole ray, outside it is
        // empty.
        let inverse = |d: f32| if d.abs() < 1e-18 { 1e18_f32.copysign(d) } else { 1.0 / d };
        let size = direction.abs();
        let z = if size.x > size.y && size.x > size.z {
            0
        } else if size.y > size.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        let inverse_z = 1.0 / direction[z];
        Self {
            origin,
            inverse: Vec3::new(inverse(direction.x), inverse(direction.y), inverse(direction.z)),
            near: [0, 1, 2].map(|axis| usize::from(direction[axis].is_sign_negative())),
            axes: [x, y, z],
            shear: Vec3::new(direction[x] * inverse_z, direction[y] * inverse_z, inverse_z),
        }
    }

    /// Returns the entry distances of four boxes and the mask of those that are entered before `t_max`.
    #[inline(always)]
    fn boxes(&self, node: &Node, t_max: f32) -> (Vec4, u32) {
        let slab = |axis: usize, side: usize| {
            (node.bounds[side][axis] - Vec4::splat(self.origin[axis])) * Vec4::splat(self.inverse[axis])
        };
        let [x, y, z] = self.near;
        let enter = slab(0, x).max(slab(1, y)).max(slab(2, z)).max(Vec4::ZERO);
        let leave = slab(0, 1 - x).min(slab(1, 1 - y)).min(slab(2, 1 - z)).min(Vec4::splat(t_max));
        (enter, enter.cmple(leave).bitmask())
    }

    /// Returns the distances and barycentric weights of four triangles and the mask of those that are hit
    /// between 0 and `t_max`.
    #[inline(always)]
    fn triangles(&self, packet: &Packet, t_max: f32) -> (Vec4, [Vec4; 2], u32) {
        let [kx, ky, kz] = self.axes;
        let [ox, oy, oz] = [kx, ky, kz].map(|k| Vec4::splat(self.origin[k]));
        let [sx, sy, sz] = [self.shear.x, self.shear.y, self.shear.z].map(Vec4::splat);
        let corner = |i: usize| {
            let z = packet.corners[kz][i] - oz;
            ((packet.corners[kx][i] - ox) - sx * z, (packet.corners[ky][i] - oy) - sy * z, z)
        };
        let (ax, ay, az) = corner(0);
        let (bx, by, bz) = corner(1);
        let (cx, cy, cz) = corner(2);
        let u = cx * by - cy * bx;
        let v = ax * cy - ay * cx;
        let w = bx * ay - by * ax;
        let inside = u.min(v).min(w).cmpge(Vec4::ZERO) | u.max(v).max(w).cmple(Vec4::ZERO);
        let det = u + v + w;
        let hit: BVec4A = inside & det.cmpne(Vec4::ZERO);
        if !hit.any() {
            return (Vec4::ZERO, [Vec4::ZERO; 2], 0);
        }
        let scale = det.recip();
        let t = (u * az + v * bz + w * cz) * sz * scale;
        let hit = hit & t.cmpgt(Vec4::ZERO) & t.cmplt(Vec4::splat(t_max));
        (t, [v * scale, w * scale], hit.bitmask())
    }
}

/// Most triangles of a leaf.
const LEAF_TRIANGLES: u32 = 4;

/// Builds the binary tree, as `build_bvh2_from_tris` of obvhs does; that one reads a clock, which browsers lack.
fn binary(triangles: &[Triangle]) -> Bvh2 {
    let BvhBuildParams {
        ploc_search_distance,
        search_depth_threshold,
        reinsertion_batch_ratio,
        post_collapse_reinsertion_batch_ratio_multiplier,
        sort_precision,
        collapse_traversal_cost,
        ..
    } = BvhBuildParams::medium_build();
    let indices = (0..triangles.len() as u32).collect();
    let mut binary = PlocBuilder::with_capacity(triangles.len()).build(
        ploc_search_distance,
        triangles,
        indices,
        sort_precision,
        search_depth_threshold,
    );
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut binary, reinsertion_batch_ratio, None);
    collapse(&mut binary, LEAF_TRIANGLES, collapse_traversal_cost);
    let again = reinsertion_batch_ratio * post_collapse_reinsertion_batch_ratio_multiplier;
    optimizer.run(&mut binary, again, None);
    binary
}

impl Bvh {
    /// Builds the hierarchy. Hits of triangles for which `filtered` returns true are passed to the filter of
    /// each query.
    #[must_use]
    pub fn new(geometry: &Geometry, filtered: impl Fn(u32) -> bool) -> Self {
        let triangles: Vec<Triangle> = (0..geometry.triangles.len())
            .map(|i| {
                let [v0, v1, v2] = geometry.positions(i).map(Vec3A::from);
                Triangle { v0, v1, v2 }
            })
            .collect();
        let mut bvh = Self { nodes: Vec::new(), packets: Vec::new(), root: None, stack: 0 };
        if triangles.is_empty() {
            return bvh;
        }
        let binary = binary(&triangles);
        let size = geometry.bounds.iter().fold(0.0_f32, |size, p| size.max(p.abs().max_element()));
        let mut folder = Folder {
            counts: vec![0; binary.nodes.len()],
            binary: &binary,
            triangles: &triangles,
            filtered: &filtered,
            margin: size * f32::EPSILON * 8.0,
            bvh: &mut bvh,
        };
        folder.count(0);
        let (root, depth) = folder.fold(0);
        bvh.root = Some(root);
        bvh.stack = 3 * depth + 1;
        bvh
    }

    /// Returns the closest hit before `t_max`, ignoring one triangle.
    #[inline]
    pub fn closest(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        exclude: u32,
        filter: impl Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        let ray = Ray::new(origin, direction);
        let mut nearest = Hit { triangle: NONE, t: t_max, bary: [0.0; 2] };
        self.traverse(&ray, &mut nearest, |packet, nearest| {
            let (t, [u, v], mut lanes) = ray.triangles(packet, nearest.t);
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let hit = Hit { triangle: packet.ids[lane], t: t[lane], bary: [u[lane], v[lane]] };
                if hit.t < nearest.t && hit.triangle != exclude && (packet.filtered >> lane & 1 == 0 || filter(&hit)) {
                    *nearest = hit;
                }
            }
            false
        });
        (nearest.triangle != NONE).then_some(nearest)
    }

    /// Returns true if any triangle but two ignored ones is hit between 0 and `t_max`.
    #[inline]
    pub fn any(
        &self,
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
        exclude: [u32; 2],
        filter: impl Fn(&Hit) -> bool,
    ) -> bool {
        let ray = Ray::new(origin, direction);
        let mut limit = Hit { triangle: NONE, t: t_max, bary: [0.0; 2] };
        self.traverse(&ray, &mut limit, |packet, _| {
            let (t, [u, v], mut lanes) = ray.triangles(packet, t_max);
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let hit = Hit { triangle: packet.ids[lane], t: t[lane], bary: [u[lane], v[lane]] };
                if !exclude.contains(&hit.triangle) && (packet.filtered >> lane & 1 == 0 || filter(&hit)) {
                    return true;
                }
            }
            false
        })
    }

    /// Visits the leaves along a ray front to back until `leaf` returns true; `nearest.t` culls farther
    /// nodes.
    #[inline(always)]
    fn traverse(&self, ray: &Ray, nearest: &mut Hit, leaf: impl FnMut(&Packet, &mut Hit) -> bool) -> bool {
        if self.stack <= STACK {
            self.traverse_with(&mut [(0.0, 0); STACK], ray, nearest, leaf)
        } else {
            self.traverse_with(&mut vec![(0.0, 0); self.stack], ray, nearest, leaf)
        }
    }

    #[inline(always)]
    fn traverse_with(
        &self,
        stack: &mut [(f32, u32)],
        ray: &Ray,
        nearest: &mut Hit,
        mut leaf: impl FnMut(&Packet, &mut Hit) -> bool,
    ) -> bool {
        let Some(mut child) = self.root else { return false };
        let mut top = 0;
        loop {
            if child & LEAF != 0 {
                if leaf(&self.packets[(child & !LEAF) as usize], nearest) {
                    return true;
                }
            } else {
                let node = &self.nodes[child as usize];
                let (enter, mut lanes) = ray.boxes(node, nearest.t);
                // Children are inserted in sorted order, so that the nearest is on top of the stack.
                let floor = top;
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize;
                    lanes &= lanes - 1;
                    let entry = (enter[lane], node.children[lane]);
                    let mut slot = top;
                    while slot > floor && stack[slot - 1].0 < entry.0 {
                        stack[slot] = stack[slot - 1];
                        slot -= 1;
                    }
                    stack[slot] = entry;
                    top += 1;
                }
            }
            loop {
                if top == 0 {
                    return false;
                }
                top -= 1;
                if stack[top].0 <= nearest.t {
                    child = stack[top].1;
                    break;
                }
            }
        }
    }
}

/// Collapses the binary tree into nodes of four and leaves of up to four triangles.
struct Folder<'a, F> {
    binary: &'a Bvh2,
    triangles: &'a [Triangle],
    filtered: &'a F,
    /// Number of triangles below each binary node.
    counts: Vec<u32>,
    margin: f32,
    bvh: &'a mut Bvh,
}

impl<F: Fn(u32) -> bool> Folder<'_, F> {
    fn count(&mut self, index: usize) -> u32 {
        let node = &self.binary.nodes[index];
        let first = node.first_index as usize;
        let count = if node.is_leaf() { node.prim_count } else { self.count(first) + self.count(first + 1) };
        self.counts[index] = count;
        count
    }

    /// Returns the child index for a binary node, and the height of its subtree.
    fn fold(&mut self, index: usize) -> (u32, usize) {
        if self.counts[index] <= 4 {
            let mut ids = Vec::with_capacity(4);
            self.gather(index, &mut ids);
            return (self.leaf(&ids), 1);
        }
        // The largest box that is not a leaf is opened until there are four.
        let first = self.binary.nodes[index].first_index as usize;
        let mut slots = vec![first, first + 1];
        while slots.len() < 4 {
            let area = |&slot: &usize| self.binary.nodes[slot].aabb().half_area();
            let widest = (0..slots.len())
                .filter(|&i| self.counts[slots[i]] > 4)
                .max_by(|&a, &b| area(&slots[a]).total_cmp(&area(&slots[b])));
            let Some(widest) = widest else { break };
            let first = self.binary.nodes[slots[widest]].first_index as usize;
            slots[widest] = first;
            slots.push(first + 1);
        }
        let mut node = Node {
            bounds: [[Vec4::splat(f32::INFINITY); 3], [Vec4::splat(f32::NEG_INFINITY); 3]],
            children: [LEAF; 4],
        };
        let at = self.bvh.nodes.len();
        for (lane, &slot) in slots.iter().enumerate() {
            let aabb = *self.binary.nodes[slot].aabb();
            for axis in 0..3 {
                node.bounds[0][axis][lane] = aabb.min[axis] - self.margin;
                node.bounds[1][axis][lane] = aabb.max[axis] + self.margin;
            }
        }
        self.bvh.nodes.push(node);
        let mut height = 0;
        for (lane, &slot) in slots.iter().enumerate() {
            let (child, below) = self.fold(slot);
            self.bvh.nodes[at].children[lane] = child;
            height = height.max(below);
        }
        (at as u32, height + 1)
    }

    fn gather(&self, index: usize, ids: &mut Vec<u32>) {
        let node = &self.binary.nodes[index];
        let first = node.first_index as usize;
        if node.is_leaf() {
            ids.extend_from_slice(&self.binary.primitive_indices[first..first + node.prim_count as usize]);
        } else {
            self.gather(first, ids);
            self.gather(first + 1, ids);
        }
    }

    fn leaf(&mut self, ids: &[u32]) -> u32 {
        let mut packet = Packet { corners: [[Vec4::ZERO; 3]; 3], ids: [NONE; 4], filtered: 0 };
        for (lane, &id) in ids.iter().enumerate() {
            let triangle = &self.triangles[id as usize];
            for (corner, position) in [triangle.v0, triangle.v1, triangle.v2].iter().enumerate() {
                for axis in 0..3 {
                    packet.corners[axis][corner][lane] = position[axis];
                }
            }
            packet.ids[lane] = id;
            packet.filtered |= u32::from((self.filtered)(id)) << lane;
        }
        self.bvh.packets.push(packet);
        (self.bvh.packets.len() - 1) as u32 | LEAF
    }
}
