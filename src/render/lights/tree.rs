//! A tree over the local lights, by which a surface chooses a light with a probability near its contribution
//! (shaders/lib/lights/light_tree.wesl; Conty Estevez and Kulla, "Importance sampling of many lights with
//! adaptive tree splitting", HPG 2018).
//!
//! Each node bounds the positions, the total intensity and the emission directions of its lights. Nodes are
//! split where the cost is least: intensity times surface area times orientation measure, the surface area
//! orientation heuristic (section 4.4).

use std::f32::consts::{FRAC_PI_2, PI};

use glam::Vec3;

use crate::render::layouts::light_kind::{AREA, SPOT};
use crate::render::layouts::light_node::{LEAF, MIRRORED};
use crate::render::layouts::{LightNode, LightRecord};
use crate::render::lights::octahedral::octahedral;
use crate::render::lights::table::LightTable;
use crate::scene::{Geometry, Scene, angle_of_versine};

/// Bins along an axis; a node may be split between two bins.
const BINS: usize = 12;
/// Most levels of a tree, since the path to a light has one bit per level.
const LEVELS: u32 = 32;
/// Radians that widen cones, so that rounding excludes no light.
const SLACK: f32 = 1e-3;

/// The tree.
pub struct LightTree {
    /// Nodes, root first; siblings are adjacent. Without local lights one node with zero strength.
    pub nodes: Vec<LightNode>,
    /// The path from the root to each local light of the table, one bit per level, the first level in the
    /// lowest bit.
    pub trails: Vec<u32>,
}

/// Bounds of a group of lights: positions, intensity and emission directions.
#[derive(Clone, Copy)]
struct Bounds {
    low: Vec3,
    high: Vec3,
    /// Upper bound of the luminance of radiant intensity, W/sr.
    strength: f32,
    axis: Vec3,
    /// Half angle of the cone that bounds axes or normals around `axis`, radians.
    normals: f32,
    /// Angle from an axis or normal within which light is emitted, radians.
    falloff: f32,
    /// True if the opposite directions emit as well.
    two_sided: bool,
}

impl LightTree {
    /// Builds the tree of a table's local lights, which are its first.
    #[must_use]
    pub fn new(table: &LightTable, scene: &Scene, geometry: &Geometry) -> Self {
        let finite = table.records.iter().zip(&table.powers).take(table.finite);
        let lights: Vec<Bounds> = finite.map(|(record, power)| bounds(record, *power, scene, geometry)).collect();
        let mut nodes = vec![LightNode::default()];
        let mut trails = vec![0; lights.len()];
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        // Each entry holds a node, its range in the order of lights, its level, and the path to it.
        let mut open = vec![(0, 0, order.len(), 0, 0)];
        while let Some((node, from, to, level, trail)) = open.pop() {
            let part = &mut order[from..to];
            let Some(all) = part.iter().map(|&l| lights[l as usize]).reduce(Bounds::and) else { break };
            let child = if let [light] = *part {
                trails[light as usize] = trail;
                LEAF | light
            } else {
                let middle = split(part, &lights, &all, level);
                let first = nodes.len();
                nodes.extend([LightNode::default(); 2]);
                let below = level + 1;
                open.push((first, from, from + middle, below, trail));
                open.push((first + 1, from + middle, to, below, trail | 1 << level));
                first as u32
            };
            nodes[node] = LightNode {
                center: all.center().to_array(),
                // The factor covers rounding.
                radius2: (0.25 * all.low.distance_squared(all.high)) * (1.0 + 1e-5),
                strength: all.strength,
                child: child | if all.two_sided { MIRRORED } else { 0 },
                axis: packed(all.axis),
                cosines: snorm(all.normals.cos(), f32::floor)
                    | snorm((all.falloff + SLACK).min(PI).cos(), f32::floor) << 16,
            };
        }
        Self { nodes, trails }
    }
}

/// Converts a number in [-1, 1] to 16-bit signed normalized form.
fn snorm(v: f32, round: fn(f32) -> f32) -> u32 {
    u32::from(round(v.clamp(-1.0, 1.0) * 32_767.0) as i16 as u16)
}

/// Encodes a unit vector as two 16-bit numbers.
fn packed(w: Vec3) -> u32 {
    let p = octahedral(w);
    snorm(p.x, f32::round) | snorm(p.y, f32::round) << 16
}

/// Returns the bounds of one light.
fn bounds(record: &LightRecord, power: f32, scene: &Scene, geometry: &Geometry) -> Bounds {
    let position = Vec3::from(record.position);
    let all_around = Bounds {
        low: position - record.radius,
        high: position + record.radius,
        strength: power / (4.0 * PI),
        axis: Vec3::Z,
        normals: PI,
        falloff: FRAC_PI_2,
        two_sided: false,
    };
    match record.kind {
        AREA => {
            // Corners of the light's part of the triangle.
            let [o, right, up] = geometry.positions(record.triangle as usize);
            let [b, c, size] = record.position;
            let at = |b: f32, c: f32| o + (right - o) * b + (up - o) * c;
            let [a, b, c] = [at(b, c), at(b + size, c), at(b, c + size)];
            let normal = (b - a).cross(c - a);
            let material = &scene.materials[geometry.materials[record.triangle as usize] as usize];
            let two_sided = material.emission.is_some_and(|e| e.two_sided);
            Bounds {
                low: a.min(b).min(c),
                high: a.max(b).max(c),
                strength: power / if two_sided { 2.0 * PI } else { PI },
                // A triangle without area has no power and therefore no record.
                axis: (normal / normal.abs().max_element().max(f32::MIN_POSITIVE)).normalize_or(Vec3::Z),
                normals: 0.0,
                two_sided,
                ..all_around
            }
        }
        SPOT => Bounds {
            strength: power / (2.0 * PI * record.outer_versine.max(f32::MIN_POSITIVE)),
            axis: Vec3::from(record.direction),
            normals: angle_of_versine(record.outer_versine),
            falloff: 0.0,
            ..all_around
        },
        _ => all_around,
    }
}

impl Bounds {
    /// Returns the bounds of both groups.
    fn and(self, other: Self) -> Self {
        let (axis, normals) = cone([self.axis, other.axis], [self.normals, other.normals]);
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            strength: self.strength + other.strength,
            axis,
            normals,
            falloff: self.falloff.max(other.falloff),
            two_sided: self.two_sided || other.two_sided,
        }
    }

    fn center(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    /// Returns the cost of a node: intensity times surface area times orientation measure (section 4.4).
    fn cost(&self) -> f32 {
        let d = self.high - self.low;
        let area = 2.0 * (d.x * d.y + d.y * d.z + d.z * d.x);
        let (o, w) = (self.normals, (self.normals + self.falloff).min(PI));
        let (sin, cos) = o.sin_cos();
        // Integral over the directions beyond the cone of the cosine of the angle to it (section 4.4).
        let beyond = FRAC_PI_2 * (2.0 * w * sin - (o - 2.0 * w).cos() - 2.0 * o * sin + cos);
        self.strength * area * (2.0 * PI * (1.0 - cos) + beyond)
    }
}

/// Returns the axis and half angle of the narrowest cone that contains two cones.
fn cone(axes: [Vec3; 2], angles: [f32; 2]) -> (Vec3, f32) {
    let between = axes[0].dot(axes[1]).clamp(-1.0, 1.0).acos();
    for i in 0..2 {
        if (between + angles[1 - i]).min(PI) <= angles[i] {
            return (axes[i], angles[i]);
        }
    }
    let angle = 0.5 * (angles[0] + between + angles[1]);
    let across = (axes[1] - axes[0] * axes[0].dot(axes[1])).normalize_or_zero();
    if angle >= PI || across == Vec3::ZERO {
        return (axes[0], PI);
    }
    let (sin, cos) = (angle - angles[0]).sin_cos();
    ((axes[0] * cos + across * sin).normalize(), (angle + 1e-5).min(PI))
}

/// The bins of a node's lights along each axis, by the centers of their bounds.
struct Bins {
    low: Vec3,
    extent: Vec3,
}

impl Bins {
    fn new(centers: impl Iterator<Item = Vec3>) -> Self {
        let (low, high) = centers
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), center| (low.min(center), high.max(center)));
        Self { low, extent: high - low }
    }

    fn index(&self, center: Vec3, axis: usize) -> usize {
        (((center[axis] - self.low[axis]) / self.extent[axis] * BINS as f32) as usize).min(BINS - 1)
    }
}

/// Returns the axis and the last bin of the first group of the split with the least cost. None if no axis can
/// be split.
fn best_split(part: &[u32], lights: &[Bounds], all: &Bounds, bins: &Bins) -> Option<(usize, usize)> {
    let size = all.high - all.low;
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| bins.extent[axis] > 0.0 && bins.extent[axis].is_finite()) {
        let mut bounds = [None::<Bounds>; BINS];
        for &light in part {
            let own = lights[light as usize];
            let bin = &mut bounds[bins.index(own.center(), axis)];
            *bin = Some(bin.map_or(own, |b| b.and(own)));
        }
        let join = |a: Option<Bounds>, b: Option<Bounds>| [a, b].into_iter().flatten().reduce(Bounds::and);
        let mut above = [None; BINS];
        for i in (1..BINS).rev() {
            above[i - 1] = join(bounds[i], above[i]);
        }
        let mut below = None;
        for i in 0..BINS - 1 {
            below = join(below, bounds[i]);
            let (Some(below), Some(above)) = (below, above[i]) else { continue };
            // The ratio penalizes thin slices of a long node.
            let cost = (below.cost() + above.cost()) * size.max_element() / size[axis];
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, i));
            }
        }
    }
    best.map(|(_, axis, last)| (axis, last))
}

/// Partitions the lights of a node into two groups and returns the number of lights in the first.
fn split(part: &mut [u32], lights: &[Bounds], all: &Bounds, level: u32) -> usize {
    let center = |light: u32| lights[light as usize].center();
    let bins = Bins::new(part.iter().map(|&light| center(light)));
    // The remaining levels must hold all lights, even if one child gets all but one.
    let levels = LEVELS - 1 - level;
    let fits = levels > 0 && part.len() as u64 - 1 <= 1 << (levels - 1).min(62);
    let best = if fits { best_split(part, lights, all, &bins) } else { None };
    if let Some((axis, last)) = best {
        let mut first = 0;
        for i in 0..part.len() {
            if bins.index(center(part[i]), axis) <= last {
                part.swap(first, i);
                first += 1;
            }
        }
        return first;
    }
    // Lights at one position, and nodes of deep levels, are split at the median.
    let middle = part.len() / 2;
    let axis = if bins.extent.max_element() > 0.0 { bins.extent.max_position() } else { 0 };
    part.select_nth_unstable_by(middle, |&a, &b| center(a)[axis].total_cmp(&center(b)[axis]));
    middle
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::render::lights::octahedral::from_octahedral;

    fn tree(records: Vec<LightRecord>) -> LightTree {
        let table =
            LightTable { powers: vec![1.0; records.len()], finite: records.len(), records, ..Default::default() };
        LightTree::new(&table, &Scene::default(), &Geometry::default())
    }

    fn at(position: Vec3) -> LightRecord {
        LightRecord { position: position.to_array(), probability: 0.1, ..Default::default() }
    }

    /// Each path ends at its light, and each node contains the lights below it.
    #[test]
    fn a_tree_holds_every_light_once() {
        let scattered = |i: u32| Vec3::new((i * 7 % 101) as f32, (i * 13 % 37) as f32, (i % 5) as f32);
        for (what, records) in [
            ("scattered", (0..500).map(|i| at(scattered(i))).collect::<Vec<_>>()),
            ("in one place", vec![at(Vec3::ONE); 300]),
            ("each twice as far", (0..60).map(|i| at(Vec3::X * 2_f32.powi(i - 30))).collect()),
            ("one", vec![at(Vec3::X)]),
        ] {
            let count = records.len();
            let tree = tree(records.clone());
            assert_eq!(tree.nodes.len(), 2 * count - 1, "{what}");
            let mut deepest = 0;
            for (light, &trail) in tree.trails.iter().enumerate() {
                let position = Vec3::from(records[light].position);
                let mut node = &tree.nodes[0];
                let mut level = 0;
                loop {
                    let away = Vec3::from(node.center).distance_squared(position);
                    assert!(away <= node.radius2 * (1.0 + 1e-4), "{what}: {node:?} {position}");
                    if node.child & LEAF != 0 {
                        break;
                    }
                    node = &tree.nodes[(node.child + (trail >> level & 1)) as usize];
                    level += 1;
                }
                assert_eq!((node.child & !LEAF) as usize, light, "{what}");
                assert_eq!(node.center, records[light].position, "{what}");
                deepest = deepest.max(level);
            }
            assert!(deepest <= LEVELS, "{what}: {deepest} levels");
            println!("{what}: {deepest} levels");
        }
        assert_eq!(tree(Vec::new()).nodes.len(), 1, "a binding cannot be empty");
    }

    #[test]
    fn axes_and_cosines_survive_packing() {
        let unpacked = |bits: u32| f32::from(bits as u16 as i16) / 32_767.0;
        for v in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Z, Vec3::new(0.3, -0.8, -0.2).normalize()] {
            let bits = packed(v);
            let back = from_octahedral(Vec2::new(unpacked(bits), unpacked(bits >> 16)));
            assert!(back.distance(v) < 0.1 * SLACK, "{v} is {back}");
        }
        for c in [-1.0, -0.3, 0.0, 0.999, 1.0_f32] {
            let back = unpacked(snorm(c, f32::floor));
            assert!(back <= c && back > c - 1e-4, "{c} is {back}");
        }
    }

    /// The cone contains both cones and is no wider than necessary.
    #[test]
    fn cones_contain_both() {
        let mut tested = 0;
        for i in 0..1000_u32 {
            let n = |k: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(k * 40_503) >> 8 & 0xffff) as f32 / 65_536.0;
            let axes = [0, 3].map(|k| (Vec3::new(n(k), n(k + 1), n(k + 2)) - 0.5).normalize_or(Vec3::X));
            let angles = [PI * n(7), PI * n(9)];
            let (axis, angle) = cone(axes, angles);
            for k in 0..2 {
                let away = axis.angle_between(axes[k]);
                assert!((away + angles[k]).min(PI) <= angle + 1e-3, "{axes:?} {angles:?}: {axis} {angle}");
            }
            let least = 0.5 * (angles[0] + angles[1] + axes[0].angle_between(axes[1]));
            assert!(angle <= least.max(angles[0]).max(angles[1]).min(PI) + 1e-3);
            tested += u32::from(angle < PI);
        }
        assert!(tested > 100);
    }
}
