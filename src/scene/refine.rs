//! The finer surface of meshes with a [`Tessellation`]: which new vertices and triangles there are, and where they lie.
//!
//! Which there are is decided here, once a frame: a triangle becomes a triangular grid of as many parts as its finest edge has, and
//! the vertices on a coarser edge move to the parts of that edge, so that some triangles vanish and none overlap. What stays on an
//! edge depends on that edge alone. A new vertex is a [`Blend`] of control vertices; on an edge these come in an order that both sides
//! know, so that a closed mesh stays closed to the last bit. Where vertices at one place differ (seams of texture coordinates, hard
//! edges), they keep one place, the normal that they have together and one height, which the first of them gives.
//!
//! Where they lie is computed twice: here, for bounds, lights and the reference, and in compute (shaders/tessellate.wesl), in the same
//! order of operations. From pose to pose they stay which they are while the [`Topology`] is the same, and only their places are found anew.

use std::collections::HashMap;
use std::ops::{Add, Mul};

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use super::geometry::{Geometry, Placed, Vertex};
use super::height::HeightMap;
use super::tessellation::{Displacement, EdgeFactor, Scale, Tessellation};
use super::{Mesh, Scene};

/// Triangles that all meshes of a scene may become together. Where factors would make more, all of them are halved until it is
/// enough.
pub const MAX_TRIANGLES: u64 = 1 << 24;

/// A new vertex: weights 1 - y - z, y and z of three control vertices. On an edge z is 0, at a control vertex y too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend {
    /// Control vertices.
    pub corners: [u32; 3],
    /// Weight of the second.
    pub y: f32,
    /// Control vertices whose coordinates the height is looked up by: the same, or on a seam those of the first side.
    pub heights: [u32; 3],
    /// Weight of the third.
    pub z: f32,
}

/// Where a control vertex comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlOrigin {
    /// Index into the scene's instances.
    pub instance: u32,
    /// Index into the vertices of the instance's mesh.
    pub vertex: u32,
    /// The first vertex of that mesh at the same place at rest.
    pub place: u32,
}

/// How the finer surfaces of a scene come about: the last of its geometry's vertices and triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refined {
    /// Control vertices of all refined instances.
    pub controls: Vec<ControlOrigin>,
    /// New vertices.
    pub blends: Vec<Blend>,
    /// For each of them the first new vertex at the same place; its normal is that of the triangles around all of these.
    pub welds: Vec<u32>,
    /// Why there are these and no others.
    pub topology: Topology,
}

/// What decides which new vertices and triangles there are.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Topology {
    /// The geometry's first new vertex.
    pub first_vertex: u32,
    /// The geometry's first new triangle.
    pub first_triangle: u32,
    /// Of each refined instance.
    cuts: Vec<Cut>,
}

/// How an instance is cut.
#[derive(Clone, Debug, PartialEq)]
struct Cut {
    instance: usize,
    /// For each vertex of the mesh the first one at the same place at rest.
    welds: Vec<u32>,
    /// Corners in the mesh, counter-clockwise seen from the front; no two of them at one place.
    patches: Vec<[u32; 3]>,
    /// Of each patch, the edges from the first, second and third corner to the next.
    factors: Vec<[u32; 3]>,
}

impl Topology {
    /// Whether surfaces become the same vertices and triangles behind so many others.
    pub(super) fn is_of(&self, surfaces: &[Surface], vertices: usize, triangles: usize) -> bool {
        [self.first_vertex as usize, self.first_triangle as usize] == [vertices, triangles]
            && self.cuts.iter().eq(surfaces.iter().map(|s| &s.cut))
    }
}

/// A control vertex in its pose.
#[derive(Clone, Copy, Debug)]
struct Control {
    vertex: Vertex,
    /// Where all vertices at this place are, metres.
    place: Vec3,
    /// Their normal together, of unit length or zero.
    direction: Vec3,
    /// Metres, in the mesh's own space, before it is posed.
    rest: Vec3,
}

/// A mesh in its place, to be refined.
pub(super) struct Surface<'a> {
    placed: Placed<'a>,
    tessellation: Tessellation,
    controls: Vec<Control>,
    cut: Cut,
}

/// For each position the first index with the same one.
#[must_use]
pub fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut first = HashMap::with_capacity(positions.len());
    // -0 and 0 are one place.
    let bits = |p: Vec3| (p + Vec3::ZERO).to_array().map(f32::to_bits);
    (0..).zip(positions).map(|(i, &p)| *first.entry(bits(p)).or_insert(i)).collect()
}

impl<'a> Surface<'a> {
    fn new(scene: &'a Scene, instance: usize, scale: Option<Scale>) -> Self {
        let placed = Placed::new(scene, instance);
        let mesh = placed.mesh;
        let tessellation = mesh.tessellation.clone().unwrap_or_default();
        let rest = &scene.at_rest(scene.instances[instance].mesh).positions;
        let welds = weld(rest);
        let vertices: Vec<_> = (0..mesh.positions.len()).into_par_iter().map(|v| placed.vertex(v)).collect();
        let mut directions = vec![Vec3::ZERO; vertices.len()];
        for (vertex, &weld) in vertices.iter().zip(&welds) {
            directions[weld as usize] += vertex.normal;
        }
        let control = |(v, vertex): (usize, &Vertex)| {
            let weld = welds[v] as usize;
            let (place, direction) = (vertices[weld].position, directions[weld].normalize_or_zero());
            Control { vertex: *vertex, place, direction, rest: rest[v] }
        };
        let controls: Vec<_> = vertices.iter().enumerate().map(control).collect();
        let apart = |&[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| welds[v as usize]);
            a != b && b != c && c != a
        };
        let facing = |&[a, b, c]: &[u32; 3]| if placed.mirrored { [a, c, b] } else { [a, b, c] };
        let patches: Vec<_> = mesh.triangles.iter().map(facing).filter(apart).collect();
        let parts = |a: u32, b: u32| match (tessellation.factor, scale) {
            (EdgeFactor::Fixed(parts), _) => parts,
            (EdgeFactor::Pixels(pixels), Some(scale)) => {
                scale.parts(pixels, controls[a as usize].place, controls[b as usize].place)
            }
            (EdgeFactor::Pixels(_), None) => 1,
        };
        let factors = patches.par_iter().map(|&[a, b, c]| [parts(a, b), parts(b, c), parts(c, a)]).collect();
        Self { placed, tessellation, controls, cut: Cut { instance, welds, patches, factors } }
    }

    /// Triangles that there will be at most, where factors are shifted so far to the right.
    fn count(&self, shift: u32) -> u64 {
        let of = |f: &[u32; 3]| u64::from((f.iter().max().unwrap_or(&1) >> shift).max(1)).pow(2);
        self.cut.factors.par_iter().map(of).sum()
    }
}

/// Triangles that a mesh with fixed factors becomes, and others have at least.
#[must_use]
pub fn triangles(mesh: &Mesh) -> u64 {
    let parts = match mesh.refinement().map(|t| t.factor) {
        Some(EdgeFactor::Fixed(parts)) => parts,
        _ => 1,
    };
    mesh.triangles.len() as u64 * u64::from(parts).pow(2)
}

/// The new vertices and triangles of one surface.
struct Grid<'a> {
    surface: &'a Surface<'a>,
    /// Index of the surface's first control vertex, and, among the new vertices, of the one that stands for it.
    first_control: u32,
    first: u32,
    /// Added to an index among the new vertices, for one among the geometry's.
    first_vertex: u32,
    refined: &'a mut Refined,
    triangles: &'a mut Vec<[u32; 3]>,
    /// Of an edge by its ends: its first new vertex.
    edges: HashMap<[u32; 2], u32>,
    /// Of all edges between two places: the ends of the first, and its first new vertex.
    agreed: HashMap<[u32; 2], ([u32; 2], u32)>,
}

impl Grid<'_> {
    fn push(&mut self, corners: [u32; 3], heights: [u32; 3], [y, z]: [f32; 2], weld: u32) {
        let control = |v: u32| self.first_control + v;
        self.refined.blends.push(Blend { corners: corners.map(control), y, heights: heights.map(control), z });
        self.refined.welds.push(weld);
    }

    fn next(&self) -> u32 {
        self.refined.blends.len() as u32
    }

    fn corners(&mut self) {
        for v in 0..self.surface.controls.len() as u32 {
            let place = self.surface.cut.welds[v as usize];
            self.push([v; 3], [place; 3], [0.0; 2], self.first + place);
        }
    }

    /// The new vertices between two corners, in order: the first, and the step to the next.
    fn edge(&mut self, a: u32, b: u32, parts: u32) -> (u32, i32) {
        let place = |v: u32| self.surface.cut.welds[v as usize];
        let forward = place(a) < place(b);
        let ends = if forward { [a, b] } else { [b, a] };
        let first = match self.edges.get(&ends) {
            Some(&first) => first,
            None => {
                let first = self.next();
                let (heights, weld) = *self.agreed.entry(ends.map(place)).or_insert((ends, first));
                for part in 1..parts {
                    let y = part as f32 / parts as f32;
                    let third = |[a, b]: [u32; 2]| [a, b, b];
                    self.push(third(ends), third(heights), [y, 0.0], weld + part - 1);
                }
                self.edges.insert(ends, first);
                first
            }
        };
        if forward { (first, 1) } else { (first + parts.saturating_sub(2), -1) }
    }

    /// Cuts a triangle into a grid of as many parts as its finest edge has.
    fn patch(&mut self, corners: [u32; 3], factors: [u32; 3]) {
        let n = factors.into_iter().max().unwrap_or(1);
        let edges: [(u32, i32); 3] = std::array::from_fn(|k| self.edge(corners[k], corners[(k + 1) % 3], factors[k]));
        let first = self.first;
        let corner = |k: usize| first + corners[k % 3];
        // Vertex i of n on an edge moves to a part of the edge, towards its beginning where two are as near. As every corner is one
        // edge's beginning and another's end, no triangle is turned over.
        let on_edge = |k: usize, i: u32| {
            let parts = factors[k];
            match (2 * i * parts + n - 1) / (2 * n) {
                0 => corner(k),
                part if part == parts => corner(k + 1),
                part => edges[k].0.wrapping_add_signed((part as i32 - 1) * edges[k].1),
            }
        };
        // Row j, place i: weights n - i - j, i and j of the corners.
        let inner = self.next();
        let mut inside = inner;
        let mut vertex = |i: u32, j: u32| match () {
            () if j == 0 => on_edge(0, i),
            () if i + j == n => on_edge(1, j),
            () if i == 0 => on_edge(2, n - j),
            () => {
                inside += 1;
                inside - 1
            }
        };
        let mut row: Vec<u32> = (0..=n).map(|i| vertex(i, 0)).collect();
        for j in 1..=n {
            let above: Vec<u32> = (0..=n - j).map(|i| vertex(i, j)).collect();
            for i in 0..=(n - j) as usize {
                add_triangle(self.triangles, self.first_vertex, [row[i], row[i + 1], above[i]]);
                if i > 0 {
                    add_triangle(self.triangles, self.first_vertex, [above[i - 1], row[i], above[i]]);
                }
            }
            row = above;
        }
        for j in 1..n {
            for i in 1..n - j {
                self.push(corners, corners, [i, j].map(|i| i as f32 / n as f32), self.next());
            }
        }
        debug_assert_eq!(self.next(), inside);
    }
}

/// Adds a triangle, unless two of its corners became one.
fn add_triangle(triangles: &mut Vec<[u32; 3]>, first_vertex: u32, [a, b, c]: [u32; 3]) {
    if a != b && b != c && c != a {
        triangles.push([a, b, c].map(|v| first_vertex + v));
    }
}

/// Some of a scene's instances, and how they are cut.
pub(super) fn surfaces<'a>(scene: &'a Scene, instances: &[usize]) -> Vec<Surface<'a>> {
    let scale = Scale::new(scene);
    let mut surfaces: Vec<_> = instances.iter().map(|&i| Surface::new(scene, i, scale)).collect();
    let count = |shift: u32| surfaces.iter().map(|s| s.count(shift)).sum::<u64>();
    let shift = (0..6).find(|&shift| count(shift) <= MAX_TRIANGLES).unwrap_or(6);
    if shift > 0 {
        log::warn!("tessellation would make {} triangles: factors are divided by {}", count(0), 1 << shift);
        let halved = |factors: &mut [u32; 3]| *factors = factors.map(|f| (f >> shift).max(1));
        surfaces.iter_mut().for_each(|s| s.cut.factors.iter_mut().for_each(halved));
    }
    surfaces
}

/// Adds finer surfaces to a scene's geometry; `normals` says whether displaced ones get their own.
pub(super) fn add(geometry: &mut Geometry, scene: &Scene, surfaces: Vec<Surface>, normals: bool) -> Refined {
    let first_vertex = geometry.vertices.len() as u32;
    let first_triangle = geometry.triangles.len() as u32;
    let mut refined =
        Refined { topology: Topology { first_vertex, first_triangle, cuts: Vec::new() }, ..Refined::default() };
    for surface in &surfaces {
        let (first_control, first) = (refined.controls.len(), refined.blends.len());
        let (first_vertex, first_triangle) = (geometry.vertices.len(), geometry.triangles.len());
        let instance = surface.cut.instance as u32;
        let origin = |(vertex, &place): (u32, &u32)| ControlOrigin { instance, vertex, place };
        refined.controls.extend((0..).zip(&surface.cut.welds).map(origin));
        let mut grid = Grid {
            surface,
            first_control: first_control as u32,
            first: first as u32,
            first_vertex: refined.topology.first_vertex,
            refined: &mut refined,
            triangles: &mut geometry.triangles,
            edges: HashMap::new(),
            agreed: HashMap::new(),
        };
        grid.corners();
        for (&corners, &factors) in surface.cut.patches.iter().zip(&surface.cut.factors) {
            grid.patch(corners, factors);
        }
        geometry.materials.resize(geometry.triangles.len(), surface.placed.mesh.material as u32);
        let mould = Mould::new(surface, scene, first_control);
        geometry.vertices.par_extend(refined.blends[first..].par_iter().map(|blend| mould.vertex(blend)));
        if normals && surface.tessellation.displacement.is_some() {
            turn(geometry, &refined.welds[first..], first as u32, first_vertex, first_triangle);
        }
    }
    refined.topology.cuts = surfaces.into_iter().map(|surface| surface.cut).collect();
    refined
}

/// Puts new vertices that are there where surfaces of the same topology have them.
pub(super) fn follow(geometry: &mut Geometry, refined: &Refined, scene: &Scene, surfaces: &[Surface]) {
    let mut vertices = &mut geometry.vertices[refined.topology.first_vertex as usize..];
    let mut blends = &refined.blends[..];
    let mut first_control = 0;
    for surface in surfaces {
        let mould = Mould::new(surface, scene, first_control);
        first_control += surface.controls.len();
        let own = blends.partition_point(|blend| (blend.corners[0] as usize) < first_control);
        let (placed, others) = std::mem::take(&mut vertices).split_at_mut(own);
        let placing = placed.par_iter_mut().zip(&blends[..own]);
        placing.for_each(|(vertex, blend)| vertex.position = mould.position(blend));
        (vertices, blends) = (others, &blends[own..]);
    }
}

/// Gives the vertices of a displaced surface the normals of the triangles around their place, by area. Its places count from `first`.
fn turn(geometry: &mut Geometry, welds: &[u32], first: u32, first_vertex: usize, first_triangle: usize) {
    let mut normals = vec![Vec3::ZERO; welds.len()];
    for triangle in &geometry.triangles[first_triangle..] {
        let [a, b, c] = triangle.map(|v| geometry.vertices[v as usize].position);
        let normal = (b - a).cross(c - a);
        triangle.iter().for_each(|&v| normals[(welds[v as usize - first_vertex] - first) as usize] += normal);
    }
    geometry.vertices[first_vertex..].par_iter_mut().zip(welds).for_each(|(vertex, &weld)| {
        let normal = normals[(weld - first) as usize].normalize_or_zero();
        if normal != Vec3::ZERO {
            vertex.normal = normal;
        }
        vertex.tangent = across(vertex.tangent, vertex.normal);
    });
}

/// A tangent at right angles to a normal.
fn across(tangent: Vec4, normal: Vec3) -> Vec4 {
    let along = tangent.truncate();
    (along - normal * normal.dot(along)).normalize_or_zero().extend(tangent.w)
}

impl Displacement {
    /// As it is at a time, in seconds.
    #[must_use]
    pub fn at(&self, seconds: f32) -> Self {
        Self { height: self.height.at(seconds), ..*self }
    }
}

/// What new vertices of a surface are made of.
struct Mould<'a> {
    controls: &'a [Control],
    /// Index of the surface's first control vertex.
    first: usize,
    shape: f32,
    /// At the scene's time.
    displacement: Option<Displacement>,
    maps: &'a [HeightMap],
}

impl<'a> Mould<'a> {
    fn new(surface: &'a Surface, scene: &'a Scene, first: usize) -> Self {
        Self {
            controls: &surface.controls,
            first,
            shape: surface.tessellation.phong,
            displacement: surface.tessellation.displacement.as_ref().map(|d| d.at(scene.seconds)),
            maps: &scene.height_maps,
        }
    }

    fn controls(&self, of: [u32; 3]) -> [&'a Control; 3] {
        of.map(|control| &self.controls[control as usize - self.first])
    }

    /// Where a new vertex is.
    fn position(&self, new: &Blend) -> Vec3 {
        let [a, b, c] = self.controls(new.corners);
        let w = new.weights();
        // The flat point, and its projections onto the planes through the corners, (2) and (3) of the paper.
        let flat = blend(w, a.place, b.place, c.place);
        let projected = |onto: &Control| flat - (flat - onto.place).dot(onto.direction) * onto.direction;
        let round = blend(w, projected(a), projected(b), projected(c));
        let mut position = flat + self.shape * (round - flat);
        if let Some(Displacement { height, scale, bias }) = &self.displacement {
            let direction = blend(w, a.direction, b.direction, c.direction).normalize_or_zero();
            let [d, e, f] = self.controls(new.heights).map(|control| control.vertex.uvs);
            let uvs = [blend(w, d[0], e[0], f[0]), blend(w, d[1], e[1], f[1])];
            let height = height.height(self.maps, blend(w, a.rest, b.rest, c.rest), uvs);
            position += (scale * height + bias) * direction;
        }
        position
    }

    /// Where and what it is, but for the normal of a displaced surface, which only its triangles say.
    fn vertex(&self, new: &Blend) -> Vertex {
        let w = new.weights();
        let [a, b, c] = self.controls(new.corners).map(|control| control.vertex);
        let normal = blend(w, a.normal, b.normal, c.normal).normalize_or_zero();
        let tangent = blend(w, a.tangent.truncate(), b.tangent.truncate(), c.tangent.truncate());
        Vertex {
            position: self.position(new),
            normal,
            tangent: across(tangent.extend(a.tangent.w), normal),
            uvs: [blend(w, a.uvs[0], b.uvs[0], c.uvs[0]), blend(w, a.uvs[1], b.uvs[1], c.uvs[1])],
            color: blend(w, a.color, b.color, c.color),
        }
    }
}

impl Blend {
    fn weights(&self) -> [f32; 3] {
        [1.0 - self.y - self.z, self.y, self.z]
    }
}

/// A weighted sum.
fn blend<T: Mul<f32, Output = T> + Add<Output = T>>(weights: [f32; 3], a: T, b: T, c: T) -> T {
    a * weights[0] + b * weights[1] + c * weights[2]
}
