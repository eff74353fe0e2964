//! The scene as one list of world-space triangles, in the order of instances and their meshes' triangles, those of refined meshes last.

use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A, Vec4};
use rayon::prelude::*;

use super::refine::{self, Refined};
use super::{Mesh, Scene};

/// One corner of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// World space, metres.
    pub position: Vec3,
    /// Unit shading normal, world space.
    pub normal: Vec3,
    /// Unit tangent and the bitangent's sign; zero where there is none.
    pub tangent: Vec4,
    /// Two sets of texture coordinates.
    pub uvs: [Vec2; 2],
    /// Linear colour with alpha; white where there is none.
    pub color: Vec4,
}

/// All triangles of a scene in world space.
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Corner indices; counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Material of each triangle.
    pub materials: Vec<u32>,
    /// Triangles that tessellation made, the last ones.
    pub tessellated: usize,
    /// Corners of the bounding box; zero for an empty scene.
    pub bounds: [Vec3; 2],
}

/// Where a vertex comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Index into the scene's instances.
    pub instance: u32,
    /// Index into the vertices of the instance's mesh.
    pub vertex: u32,
    /// Corners in that mesh, counter-clockwise seen from the front, of the triangle whose normal is the vertex's where it has none.
    pub corners: Option<[u32; 3]>,
}

/// Where all vertices come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sources {
    /// Of meshes that are not refined: the first vertices.
    pub origins: Vec<Origin>,
    /// All others.
    pub refined: Refined,
}

/// What normals go with where points go with `linear`; it also stands up to a singular transform.
pub(super) fn cofactor(linear: Mat3A) -> Mat3A {
    Mat3A::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    )
}

/// A mesh in the world.
pub(super) struct Placed<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// Whether triangles turn their other side to the front.
    pub mirrored: bool,
    world_from_local: Affine3A,
    cofactor: Mat3A,
}

impl<'a> Placed<'a> {
    /// An instance of a scene.
    pub fn new(scene: &'a Scene, instance: usize) -> Self {
        let instance = &scene.instances[instance];
        let linear = instance.world_from_local.matrix3;
        Self {
            mesh: &scene.meshes[instance.mesh],
            mirrored: linear.determinant() < 0.0,
            world_from_local: instance.world_from_local,
            cofactor: cofactor(linear),
        }
    }

    /// A vertex's place.
    pub fn position(&self, index: usize) -> Vec3 {
        self.world_from_local.transform_point3(self.mesh.positions[index])
    }

    /// A vertex; its normal is zero where the mesh has none for it.
    pub fn vertex(&self, index: usize) -> Vertex {
        let mesh = self.mesh;
        Vertex {
            position: self.position(index),
            normal: mesh.normals.get(index).map_or(Vec3::ZERO, |&n| {
                let world = Vec3::from(self.cofactor * Vec3A::from(n)) * if self.mirrored { -1.0 } else { 1.0 };
                world.normalize_or_zero()
            }),
            tangent: mesh.tangents.get(index).map_or(Vec4::ZERO, |t| {
                let linear = self.world_from_local.matrix3;
                let world = Vec3::from(linear * Vec3A::from(t.truncate())).normalize_or_zero();
                world.extend(if self.mirrored { -t.w } else { t.w })
            }),
            uvs: [0, 1].map(|set: usize| mesh.uvs[set].get(index).copied().unwrap_or_default()),
            color: mesh.colors.get(index).copied().unwrap_or(Vec4::ONE),
        }
    }
}

impl Geometry {
    /// Flattens a scene. Triangles without area are left out: they can neither be hit nor seen.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let mut out = Self::default();
        let refined = out.add_plain(scene, None);
        let surfaces = refine::surfaces(scene, &refined);
        out.refine(scene, surfaces, true);
        out.bound();
        out
    }

    /// The same, with the origin of each vertex, for the device, which finds the normals of displaced surfaces: here these have those of
    /// the surface before.
    #[must_use]
    pub fn with_sources(scene: &Scene) -> (Self, Sources) {
        let (mut geometry, mut sources) = (Self::default(), Sources::default());
        geometry.follow(&mut sources, scene);
        (geometry, sources)
    }

    /// Goes on to another pose of a scene that it is of, as [`Self::with_sources`] gives it, but for normals and tangents of refined
    /// surfaces, which the device finds. What refining makes is kept where it is the same; says whether it is.
    pub fn follow(&mut self, sources: &mut Sources, scene: &Scene) -> bool {
        let (mut next, mut origins) = (Self::default(), Vec::new());
        let refined = next.add_plain(scene, Some(&mut origins));
        let surfaces = refine::surfaces(scene, &refined);
        let (vertices, triangles) = (next.vertices.len(), next.triangles.len());
        let kept = !surfaces.is_empty() && sources.refined.topology.is_of(&surfaces, vertices, triangles);
        if kept {
            self.vertices.splice(..vertices, next.vertices);
            self.triangles.splice(..triangles, next.triangles);
            self.materials.splice(..triangles, next.materials);
            refine::follow(self, &sources.refined, scene, &surfaces);
        } else {
            sources.refined = next.refine(scene, surfaces, false);
            *self = next;
        }
        sources.origins = origins;
        self.bound();
        kept
    }

    /// Adds all that is not refined; says which instances are.
    fn add_plain(&mut self, scene: &Scene, mut origins: Option<&mut Vec<Origin>>) -> Vec<usize> {
        let is_refined = |i: &usize| scene.meshes[scene.instances[*i].mesh].refinement().is_some();
        let (refined, plain): (Vec<_>, Vec<_>) = (0..scene.instances.len()).partition(is_refined);
        for instance in plain {
            self.add(scene, instance, origins.as_deref_mut());
        }
        refined
    }

    fn refine(&mut self, scene: &Scene, surfaces: Vec<refine::Surface>, normals: bool) -> Refined {
        let refined = refine::add(self, scene, surfaces, normals);
        self.tessellated = self.triangles.len() - refined.topology.first_triangle as usize;
        refined
    }

    fn bound(&mut self) {
        let bounds = (0..self.triangles.len()).into_par_iter().map(|t| {
            let [a, b, c] = self.positions(t);
            [a.min(b).min(c), a.max(b).max(c)]
        });
        self.bounds = bounds.reduce_with(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default();
    }

    /// Adds an instance, and the origins of its vertices where they are asked for.
    fn add(&mut self, scene: &Scene, instance: usize, mut origins: Option<&mut Vec<Origin>>) {
        let placed = Placed::new(scene, instance);
        let mesh = placed.mesh;
        let instance = instance as u32;
        let base = self.vertices.len() as u32;
        let smooth = !mesh.normals.is_empty();
        if smooth {
            self.vertices.extend((0..mesh.positions.len()).map(|v| placed.vertex(v)));
            if let Some(origins) = &mut origins {
                let all = 0..mesh.positions.len() as u32;
                origins.extend(all.map(|vertex| Origin { instance, vertex, corners: None }));
            }
        }
        for &[a, b, c] in &mesh.triangles {
            let corners = if placed.mirrored { [a, c, b] } else { [a, b, c] };
            let p = corners.map(|i| placed.position(i as usize));
            let flat = (p[1] - p[0]).cross(p[2] - p[0]).normalize_or_zero();
            if flat == Vec3::ZERO {
                continue;
            }
            if let Some(origins) = &mut origins {
                if smooth {
                    for c in corners {
                        origins[(base + c) as usize].corners.get_or_insert(corners);
                    }
                } else {
                    origins.extend(corners.map(|vertex| Origin { instance, vertex, corners: Some(corners) }));
                }
            }
            let indices = if smooth {
                for i in corners {
                    let normal = &mut self.vertices[(base + i) as usize].normal;
                    if *normal == Vec3::ZERO {
                        *normal = flat;
                    }
                }
                corners.map(|i| base + i)
            } else {
                let first = self.vertices.len() as u32;
                self.vertices.extend(corners.map(|i| Vertex { normal: flat, ..placed.vertex(i as usize) }));
                [first, first + 1, first + 2]
            };
            self.triangles.push(indices);
            self.materials.push(mesh.material as u32);
        }
    }

    /// Middle of the bounding box and half its diagonal, metres; the latter is positive even for an empty scene.
    #[must_use]
    pub fn sphere(&self) -> (Vec3, f32) {
        let radius = 0.5 * self.bounds[0].distance(self.bounds[1]);
        (0.5 * (self.bounds[0] + self.bounds[1]), if radius > 0.0 { radius } else { 1.0 })
    }

    /// World-space corners of a triangle.
    #[must_use]
    pub fn positions(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize].position)
    }
}
