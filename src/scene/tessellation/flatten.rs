//! Flattens a scene into world-space triangles: plain meshes first, refined ones last.

use glam::Vec3;
use rayon::prelude::*;

use crate::scene::model::geometry::{Geometry, Origin, Placed, Vertex};
use crate::scene::model::scene::Scene;
use crate::scene::tessellation::refine::{self, Refined};

/// The sources of all vertices of a geometry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sources {
    /// Sources of the first vertices, those of meshes without refinement.
    pub origins: Vec<Origin>,
    /// Sources of all other vertices.
    pub refined: Refined,
}

/// Returns the indices of the instances that are refined, in order.
fn refined_instances(scene: &Scene) -> Vec<usize> {
    let is_refined = |i: &usize| scene.meshes[scene.instances[*i].mesh].refinement().is_some();
    (0..scene.instances.len()).filter(is_refined).collect()
}

impl Geometry {
    /// Flattens a scene. Triangles with zero area are dropped, since no ray can hit them.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self::flattened(scene, None)
    }

    /// Flattens a scene as [`Self::new`], and returns the sources of the first vertices, those of meshes without
    /// refinement.
    #[must_use]
    pub fn with_origins(scene: &Scene) -> (Self, Vec<Origin>) {
        let mut origins = Vec::new();
        (Self::flattened(scene, Some(&mut origins)), origins)
    }

    fn flattened(scene: &Scene, origins: Option<&mut Vec<Origin>>) -> Self {
        let mut out = Self::default();
        let refined = out.add_plain(scene, origins);
        let surfaces = refine::surfaces(scene, &refined);
        out.refine(scene, surfaces, true);
        out.bound();
        out
    }

    /// Flattens a scene and returns the source of each vertex, for GPU updates. Normals of displaced surfaces
    /// are those of the undisplaced surface here, because the GPU computes the final ones.
    #[must_use]
    pub fn with_sources(scene: &Scene) -> (Self, Sources) {
        let (mut geometry, mut sources) = (Self::default(), Sources::default());
        geometry.follow(&mut sources, scene);
        (geometry, sources)
    }

    /// Returns the positions of a scene's refined vertices, which are the last ones of [`Self::new`], in another pose
    /// of the scene: each is the same blend of control vertices there, metres, world space.
    #[must_use]
    pub fn refined_positions_in(scene: &Scene, pose: &Scene) -> Vec<Vec3> {
        let (mut geometry, sources) = Self::with_sources(scene);
        let surfaces = refine::surfaces(pose, &refined_instances(pose));
        refine::follow(&mut geometry, &sources.refined, pose, &surfaces);
        let refined = &geometry.vertices[sources.refined.topology.first_vertex as usize..];
        refined.iter().map(|vertex| vertex.position).collect()
    }

    /// Updates to another pose of the same scene, as [`Self::with_sources`] would flatten it, except for
    /// normals and tangents of refined surfaces, which the GPU computes. The refined topology is reused if it
    /// has not changed; returns true in that case.
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

    /// Adds all instances without refinement; returns the indices of the others.
    fn add_plain(&mut self, scene: &Scene, mut origins: Option<&mut Vec<Origin>>) -> Vec<usize> {
        let refined = refined_instances(scene);
        for instance in (0..scene.instances.len()).filter(|instance| refined.binary_search(instance).is_err()) {
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

    /// Adds an instance, and its vertices' origins if `origins` is given.
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
}
