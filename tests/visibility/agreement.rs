//! Compares answers to visibility queries with the CPU's hierarchy, and classifies each difference.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use rayon::iter::{IntoParallelIterator as _, IntoParallelRefIterator as _, ParallelIterator as _};

use crate::common::harness::{NONE, Point, VisibilityHarness};

/// Share of answers that may differ in exact mode.
pub const TOLERATED: f64 = 0.0005;
/// Distance over the scene's radius within which two hits are one.
pub const SAME: f32 = 1e-4;

/// The intersection of a ray with a triangle's plane, in double precision.
struct Meeting {
    /// Metres along the ray.
    distance: f64,
    /// Metres between the hit and the nearest edge, across the ray; negative outside.
    margin: f64,
    /// |cos| of the angle between the ray and the normal.
    cos: f64,
    /// Metres, across the ray, by which single precision may displace an edge: a product of coordinates is
    /// rounded by a few times 2^-24 of itself, and the smaller the triangle, the further that moves its
    /// edges.
    rounding: f64,
}

/// The reason for a difference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// The ray passes an edge of the triangle within rounding.
    Edge,
    /// The triangle lies in the plane of the triangle on which the ray starts or ends.
    Coplanar,
    /// The hit lies within rounding of an end of the ray, which is more at grazing angles.
    End,
    /// Triangle and ray are parallel within 1e-3.
    Grazing,
    /// The triangle has holes, and rounding decides at a texel's border.
    Mask,
    /// Fast mode: lists hold the triangles that cover the texel's centre.
    Centre,
    /// Fast mode: a hit within the offset of the start may count as the own surface.
    Offset,
    /// None of these.
    Unexplained,
}

impl VisibilityHarness<'_> {
    /// Returns the metres that single precision cannot resolve: `ROUNDING` of the shader, on coordinates of
    /// the scene's size.
    fn rounding(&self) -> f64 {
        let [low, high] = self.scene.bounds;
        f64::from(low.abs().max(high.abs()).max_element()) * 5e-6
    }

    /// Intersects a ray with a triangle's plane. `reach` is the size of the coordinates that edge functions
    /// are made of.
    fn meet(&self, triangle: u32, from: DVec3, direction: DVec3, reach: f64) -> Option<Meeting> {
        let [a, b, c] = self.geometry().positions(triangle as usize).map(Vec3::as_dvec3);
        let n = (b - a).cross(c - a);
        let cos = n.dot(direction) / n.length();
        if cos == 0.0 {
            return None;
        }
        let distance = n.dot(a - from) / n.dot(direction);
        let x = from + direction * distance;
        let edges = [(a, b), (b, c), (c, a)];
        let margin = edges
            .iter()
            .map(|(p, q)| (q - p).cross(x - p).dot(n) / n.length() / p.distance(*q))
            .fold(f64::INFINITY, f64::min)
            * cos.abs();
        // The least height is twice the area over the longest edge.
        let height = n.length() / edges.iter().map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
        let rounding = self.rounding() + reach * reach / height * 2.0_f64.powi(-20);
        Some(Meeting { distance, margin, cos: cos.abs(), rounding })
    }

    fn masked(&self, triangle: u32) -> bool {
        self.source.materials[self.geometry().materials[triangle as usize] as usize].opacity.is_some()
    }

    /// True if a point lies in the plane of a triangle, within rounding.
    fn in_plane(&self, point: Vec3, of: u32) -> bool {
        let [a, b, c] = self.geometry().positions(of as usize).map(Vec3::as_dvec3);
        let n = (b - a).cross(c - a).normalize();
        n.dot(point.as_dvec3() - a).abs() < self.rounding()
    }

    fn coplanar(&self, triangle: u32, other: u32) -> bool {
        other != NONE && self.geometry().positions(triangle as usize).into_iter().all(|p| self.in_plane(p, other))
    }

    /// True if light can pass between two points: neither lies in the plane of the other's triangle.
    pub fn face_each_other(&self, p: Point, q: Point) -> bool {
        !self.in_plane(p.position, q.triangle) && !self.in_plane(q.position, p.triangle)
    }

    /// Returns the class of a triangle that only one side hit, on a ray of a given length.
    pub fn classify(&self, met: u32, from: DVec3, direction: DVec3, length: f64, reach: f64, ends: [u32; 2]) -> Class {
        let Some(meeting) = self.meet(met, from, direction, reach) else { return Class::Grazing };
        let end = meeting.rounding / meeting.cos;
        if ends.iter().any(|&e| self.coplanar(met, e)) {
            Class::Coplanar
        } else if meeting.distance.abs() < end || (meeting.distance - length).abs() < end {
            Class::End
        } else if meeting.margin.abs() < meeting.rounding {
            Class::Edge
        } else if meeting.cos < 1e-3 {
            Class::Grazing
        } else if self.masked(met) {
            Class::Mask
        } else {
            Class::Unexplained
        }
    }

    /// Returns the class of an edge on which the sides disagree: that of the triangle that comes closest to
    /// deciding it.
    pub fn classify_edge(&self, from: Vec3, to: Vec3, ends: [u32; 2]) -> Class {
        let (from, to) = (from.as_dvec3(), to.as_dvec3());
        let (direction, length) = ((to - from).normalize(), from.distance(to));
        let candidates = (0..self.scene.triangles).into_par_iter().filter(|t| !ends.contains(t)).filter_map(|t| {
            let reach = from.distance(self.geometry().positions(t as usize)[0].as_dvec3());
            let m = self.meet(t, from, direction, reach)?;
            let end = m.rounding / m.cos;
            let near = m.margin > -m.rounding && m.distance > -end && m.distance < length + end;
            near.then(|| self.classify(t, from, direction, length, reach, ends))
        });
        // The worst class counts; an edge without any candidate is unexplained.
        candidates.max().unwrap_or(Class::Unexplained)
    }
}

/// Counts of queries and differences.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    pub asked: usize,
    /// Raster found a nearer hit or an occluder that the CPU did not find.
    too_near: usize,
    /// The CPU found a nearer hit or an occluder that raster did not find.
    too_far: usize,
    pub classes: BTreeMap<Class, usize>,
    /// Sums of exp(-distance / radius) on both sides: the effect of the error on gathered light.
    gathered: [f64; 2],
    pub examples: Vec<String>,
}

impl Tally {
    pub fn differ(&self) -> usize {
        self.too_near + self.too_far
    }

    pub fn share(&self) -> f64 {
        self.differ() as f64 / self.asked.max(1) as f64
    }

    pub fn count(&mut self, raster_nearer: bool, class: Class, example: impl FnOnce() -> String) {
        if raster_nearer {
            self.too_near += 1
        } else {
            self.too_far += 1
        }
        *self.classes.entry(class).or_default() += 1;
        if class == Class::Unexplained && self.examples.len() < 5 {
            self.examples.push(example());
        }
    }

    /// Returns the number of differences of each class.
    pub fn why(&self) -> String {
        let classes: Vec<_> = self.classes.iter().map(|(class, n)| format!("{class:?} {n}").to_lowercase()).collect();
        classes.join(", ")
    }

    /// Returns a row of a Markdown table.
    pub fn row(&self, scene: &str, what: &str) -> String {
        let bias = if self.gathered[1] > 0.0 {
            format!("{:+.4} %", 100.0 * (self.gathered[0] / self.gathered[1] - 1.0))
        } else {
            String::new()
        };
        format!(
            "| {scene} | {what} | {} | {} | {:.4} % | {} | {} | {bias} | {} |",
            self.asked,
            self.differ(),
            100.0 * self.share(),
            self.too_near,
            self.too_far,
            self.why(),
        )
    }
}

pub const HEAD: &str = "| scene | asked | queries | differ | share | raster nearer or hidden | raster farther or seen | mean of exp(-t) | why |\n\
                    |---|---|---|---|---|---|---|---|---|";

/// Compares nearest hits with the CPU's. `rays` holds start, direction and the triangle to leave out.
pub fn compare_nearest(
    harness: &VisibilityHarness,
    tally: &mut Tally,
    rays: &[(Vec3, Vec3, u32)],
    answers: &[[u32; 2]],
    classify: bool,
) {
    let expected: Vec<_> = rays
        .par_iter()
        .map(|&(from, direction, own)| {
            harness.reference.closest_hit(from, direction, (own != NONE).then_some(own)).map(|h| (h.triangle, h.t))
        })
        .collect();
    assert_eq!(answers.len(), expected.len());
    tally.asked += answers.len();
    let reach = f64::from(harness.radius);
    for ((&[triangle, bits], expected), &(from, direction, own)) in answers.iter().zip(&expected).zip(rays) {
        let distance = if triangle == NONE { f32::INFINITY } else { f32::from_bits(bits) };
        let (other, other_distance) = expected.unwrap_or((NONE, f32::INFINITY));
        tally.gathered[0] += f64::from((-distance / harness.radius).exp());
        tally.gathered[1] += f64::from((-other_distance / harness.radius).exp());
        if triangle == other || (distance - other_distance).abs() <= SAME * harness.radius {
            continue;
        }
        let nearer = distance < other_distance;
        let met = if nearer { triangle } else { other };
        let class = if classify {
            harness.classify(met, from.as_dvec3(), direction.as_dvec3(), f64::INFINITY, reach, [own, NONE])
        } else {
            // The offset is OFFSET_TEXELS of visibility/raster.wesl, on a grid about as wide as the scene.
            let offset = 1.5 * 2.0 * harness.radius / harness.plan.bundle_resolution as f32;
            if own != NONE && !nearer && other_distance < offset { Class::Offset } else { Class::Centre }
        };
        tally.count(nearer, class, || {
            format!("{from} {direction} from {own}: raster {triangle} at {distance}, CPU {other} at {other_distance}")
        });
    }
}
