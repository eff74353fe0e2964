//! Subdivision of meshes with a [`Tessellation`]: topology and positions of the new vertices.
//!
//! The topology is computed here, once per frame. A triangle becomes a triangular grid with the number of
//! parts of its finest edge. Vertices on a coarser edge snap to the parts of that edge, so that some
//! triangles degenerate and are dropped, and none overlap. The vertices on an edge depend on that edge alone.
//! A new vertex is a [`Blend`] of control vertices; on an edge these are in an order common to both sides, so
//! that a closed mesh stays watertight to the last bit. Vertices at one position with different attributes
//! (seams of texture coordinates, hard edges) keep one position, one welded normal and one height, the first
//! vertex's.
//!
//! Positions are evaluated twice in the same order of operations: here, for bounds, lights and the reference,
//! and in a compute shader (shaders/upload/tessellate.wesl). From pose to pose the vertices are reused while
//! the [`Topology`] is equal, and only their positions are evaluated again.

use std::collections::HashMap;
use std::ops::{Add, Mul};

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::scene::model::geometry::{Geometry, Placed, Vertex};
use crate::scene::model::height::HeightMap;
use crate::scene::model::mesh::Mesh;
use crate::scene::model::scene::Scene;
use crate::scene::model::tessellation::{Displacement, EdgeFactor, Tessellation, weld};
use crate::scene::tessellation::edge_scale::Scale;

/// Maximum number of triangles of all tessellated meshes of a scene. All factors are halved until the number
/// fits.
pub const MAX_TRIANGLES: u64 = 1 << 24;

/// A new vertex: weights 1 - y - z, y and z of three control vertices. On an edge z is 0, at a control vertex
/// y is 0 too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend {
    /// Control vertices.
    pub corners: [u32; 3],
    /// Weight of the second control vertex.
    pub y: f32,
    /// Control vertices whose texture coordinates address the height map: `corners`, or on a seam those of
    /// the side that came first.
    pub heights: [u32; 3],
    /// Weight of the third control vertex.
    pub z: f32,
}

/// The source of a control vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlOrigin {
    /// Index into the scene's instances.
    pub instance: u32,
    /// Index into the vertices of the instance's mesh.
    pub vertex: u32,
    /// The first vertex of that mesh at the same rest position.
    pub place: u32,
}

/// The sources of a scene's refined surfaces, which are the last vertices and triangles of its geometry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Refined {
    /// Control vertices of all refined instances.
    pub controls: Vec<ControlOrigin>,
    /// New vertices.
    pub blends: Vec<Blend>,
    /// For each new vertex the first one at the same position; the triangles around all of these determine
    /// its normal.
    pub welds: Vec<u32>,
    /// State that determines the new vertices and triangles.
    pub topology: Topology,
}

/// The inputs that determine the new vertices and triangles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Topology {
    /// The geometry's first new vertex.
    pub first_vertex: u32,
    /// The geometry's first new triangle.
    pub first_triangle: u32,
    /// Subdivision of each refined instance.
    cuts: Vec<Cut>,
}

/// The subdivision of an instance.
#[derive(Clone, Debug, PartialEq)]
struct Cut {
    instance: usize,
    /// For each vertex of the mesh the first one at the same rest position.
    welds: Vec<u32>,
    /// Corners in the mesh, counter-clockwise seen from the front; no two of them at one position.
    patches: Vec<[u32; 3]>,
    /// For each patch, the factors of the edges from the first, second and third corner to the next.
    factors: Vec<[u32; 3]>,
}

impl Topology {
    /// Returns true if the surfaces have this topology and follow the given numbers of vertices and
    /// triangles.
    pub(in crate::scene) fn is_of(&self, surfaces: &[Surface], vertices: usize, triangles: usize) -> bool {
        [self.first_vertex as usize, self.first_triangle as usize] == [vertices, triangles]
            && self.cuts.iter().eq(surfaces.iter().map(|s| &s.cut))
    }
}

/// A posed control vertex.
#[derive(Clone, Copy, Debug)]
struct Control {
    vertex: Vertex,
    /// Common position of all vertices here, metres, world space.
    place: Vec3,
    /// Welded normal of these vertices, of unit length or zero.
    direction: Vec3,
    /// Rest position in object space, metres.
    rest: Vec3,
}

/// A placed mesh that is to be refined.
pub(in crate::scene) struct Surface<'a> {
    placed: Placed<'a>,
    tessellation: Tessellation,
    controls: Vec<Control>,
    cut: Cut,
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
        let is_not_degenerate = |&[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| welds[v as usize]);
            a != b && b != c && c != a
        };
        let facing = |&[a, b, c]: &[u32; 3]| if placed.mirrored { [a, c, b] } else { [a, b, c] };
        let patches: Vec<_> = mesh.triangles.iter().map(facing).filter(is_not_degenerate).collect();
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

    /// Returns an upper bound on the number of triangles if all factors are shifted right by `shift`.
    fn count(&self, shift: u32) -> u64 {
        let of = |f: &[u32; 3]| u64::from((f.iter().max().unwrap_or(&1) >> shift).max(1)).pow(2);
        self.cut.factors.par_iter().map(of).sum()
    }
}

/// Returns the number of triangles of a mesh with fixed factors, and a lower bound for other meshes.
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
    /// Index of the surface's first control vertex, and of its copy among the new vertices.
    first_control: u32,
    first: u32,
    /// Offset from an index among the new vertices to one among the geometry's.
    first_vertex: u32,
    refined: &'a mut Refined,
    triangles: &'a mut Vec<[u32; 3]>,
    /// First new vertex of each edge, by the edge's ends.
    edges: HashMap<[u32; 2], u32>,
    /// For all edges between two positions: the ends and the first new vertex of the edge that came first.
    shared_edges: HashMap<[u32; 2], ([u32; 2], u32)>,
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

    /// Returns the new vertices between two corners in order: the first, and the step to the next.
    fn edge(&mut self, a: u32, b: u32, parts: u32) -> (u32, i32) {
        let place = |v: u32| self.surface.cut.welds[v as usize];
        let forward = place(a) < place(b);
        let ends = if forward { [a, b] } else { [b, a] };
        let first = match self.edges.get(&ends) {
            Some(&first) => first,
            None => {
                let first = self.next();
                let (heights, weld) = *self.shared_edges.entry(ends.map(place)).or_insert((ends, first));
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

    /// Subdivides a triangle into a grid with the number of parts of its finest edge.
    fn patch(&mut self, corners: [u32; 3], factors: [u32; 3]) {
        let n = factors.into_iter().max().unwrap_or(1);
        let edges: [(u32, i32); 3] = std::array::from_fn(|k| self.edge(corners[k], corners[(k + 1) % 3], factors[k]));
        let first = self.first;
        let corner = |k: usize| first + corners[k % 3];
        // Vertex i of n on an edge snaps to the nearest part of the edge, on ties towards the edge's
        // beginning. As every corner is the beginning of one edge and the end of another, no triangle is
        // flipped.
        let on_edge = |k: usize, i: u32| {
            let parts = factors[k];
            match (2 * i * parts + n - 1) / (2 * n) {
                0 => corner(k),
                part if part == parts => corner(k + 1),
                part => edges[k].0.wrapping_add_signed((part as i32 - 1) * edges[k].1),
            }
        };
        // Vertex i of row j has the weights n - i - j, i and j of the corners, over n.
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

/// Adds a triangle unless it has become degenerate.
fn add_triangle(triangles: &mut Vec<[u32; 3]>, first_vertex: u32, [a, b, c]: [u32; 3]) {
    if a != b && b != c && c != a {
        triangles.push([a, b, c].map(|v| first_vertex + v));
    }
}

/// Prepares instances of a scene for refinement, with factors limited by [`MAX_TRIANGLES`].
pub(in crate::scene) fn surfaces<'a>(scene: &'a Scene, instances: &[usize]) -> Vec<Surface<'a>> {
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

/// Adds refined surfaces to a scene's geometry; `normals` selects normals of the displaced surface.
pub(in crate::scene) fn add(geometry: &mut Geometry, scene: &Scene, surfaces: Vec<Surface>, normals: bool) -> Refined {
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
            shared_edges: HashMap::new(),
        };
        grid.corners();
        for (&corners, &factors) in surface.cut.patches.iter().zip(&surface.cut.factors) {
            grid.patch(corners, factors);
        }
        geometry.materials.resize(geometry.triangles.len(), surface.placed.mesh.material as u32);
        let evaluator = VertexEvaluator::new(surface, scene, first_control);
        geometry.vertices.par_extend(refined.blends[first..].par_iter().map(|blend| evaluator.vertex(blend)));
        if normals && surface.tessellation.displacement.is_some() {
            set_displaced_normals(geometry, &refined.welds[first..], first as u32, first_vertex, first_triangle);
        }
    }
    refined.topology.cuts = surfaces.into_iter().map(|surface| surface.cut).collect();
    refined
}

/// Moves existing new vertices to the pose of surfaces with the same topology.
pub(in crate::scene) fn follow(geometry: &mut Geometry, refined: &Refined, scene: &Scene, surfaces: &[Surface]) {
    let mut vertices = &mut geometry.vertices[refined.topology.first_vertex as usize..];
    let mut blends = &refined.blends[..];
    let mut first_control = 0;
    for surface in surfaces {
        let evaluator = VertexEvaluator::new(surface, scene, first_control);
        first_control += surface.controls.len();
        let own = blends.partition_point(|blend| (blend.corners[0] as usize) < first_control);
        let (placed, others) = std::mem::take(&mut vertices).split_at_mut(own);
        let placing = placed.par_iter_mut().zip(&blends[..own]);
        placing.for_each(|(vertex, blend)| vertex.position = evaluator.position(blend));
        (vertices, blends) = (others, &blends[own..]);
    }
}

/// Sets the normals of a displaced surface to the area-weighted normals of the triangles around each
/// position. `welds` counts from `first`.
fn set_displaced_normals(
    geometry: &mut Geometry,
    welds: &[u32],
    first: u32,
    first_vertex: usize,
    first_triangle: usize,
) {
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
        vertex.tangent = orthogonalize(vertex.tangent, vertex.normal);
    });
}

/// Orthogonalizes a tangent against a normal.
fn orthogonalize(tangent: Vec4, normal: Vec3) -> Vec4 {
    let along = tangent.truncate();
    (along - normal * normal.dot(along)).normalize_or_zero().extend(tangent.w)
}

/// Evaluates the new vertices of a surface.
struct VertexEvaluator<'a> {
    controls: &'a [Control],
    /// Index of the surface's first control vertex.
    first: usize,
    shape: f32,
    /// Displacement at the scene's time.
    displacement: Option<Displacement>,
    maps: &'a [HeightMap],
}

impl<'a> VertexEvaluator<'a> {
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

    /// Evaluates the position of a new vertex.
    fn position(&self, new: &Blend) -> Vec3 {
        let [a, b, c] = self.controls(new.corners);
        let w = new.weights();
        // The flat point is projected onto the tangent planes of the corners, equations (2) and (3) of
        // Boubekeur and Alexa.
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

    /// Evaluates a new vertex; the normal of a displaced surface is set later, from its triangles.
    fn vertex(&self, new: &Blend) -> Vertex {
        let w = new.weights();
        let [a, b, c] = self.controls(new.corners).map(|control| control.vertex);
        let normal = blend(w, a.normal, b.normal, c.normal).normalize_or_zero();
        let tangent = blend(w, a.tangent.truncate(), b.tangent.truncate(), c.tangent.truncate());
        Vertex {
            position: self.position(new),
            normal,
            tangent: orthogonalize(tangent.extend(a.tangent.w), normal),
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

/// Returns a weighted sum.
fn blend<T: Mul<f32, Output = T> + Add<Output = T>>(weights: [f32; 3], a: T, b: T, c: T) -> T {
    a * weights[0] + b * weights[1] + c * weights[2]
}
