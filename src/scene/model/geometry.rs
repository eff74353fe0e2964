//! World-space triangles of a scene, in the order of its instances and their meshes' triangles; those of
//! refined meshes come last.

use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A, Vec4};

use crate::scene::model::mesh::Mesh;
use crate::scene::model::scene::Scene;
use crate::scene::model::transform::cofactor;

/// One corner of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertex {
    /// World space, metres.
    pub position: Vec3,
    /// Unit shading normal, world space.
    pub normal: Vec3,
    /// Unit tangent, with the bitangent's sign in w; zero if the mesh has none.
    pub tangent: Vec4,
    /// Two sets of texture coordinates.
    pub uvs: [Vec2; 2],
    /// Linear colour with alpha; white if the mesh has none.
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
    /// Number of triangles made by tessellation; they come last.
    pub tessellated: usize,
    /// Corners of the bounding box; zero for an empty scene.
    pub bounds: [Vec3; 2],
}

/// The source of a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    /// Index into the scene's instances.
    pub instance: u32,
    /// Index into the vertices of the instance's mesh.
    pub vertex: u32,
    /// Corners, in that mesh and counter-clockwise seen from the front, of the triangle that supplies the
    /// normal of a vertex without one.
    pub corners: Option<[u32; 3]>,
}

/// A mesh with its placement in the world.
pub(in crate::scene) struct Placed<'a> {
    /// The mesh.
    pub mesh: &'a Mesh,
    /// True if the placement mirrors, so that the winding has to be swapped.
    pub mirrored: bool,
    world_from_local: Affine3A,
    cofactor: Mat3A,
}

impl<'a> Placed<'a> {
    /// Pairs an instance's mesh with its transform.
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

    /// Returns the world-space position of a vertex.
    pub fn position(&self, index: usize) -> Vec3 {
        self.world_from_local.transform_point3(self.mesh.positions[index])
    }

    /// Returns a world-space vertex; its normal is zero if the mesh has none for it.
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
    /// Returns the centre of the bounding box and half its diagonal in metres; the latter is positive even
    /// for an empty scene.
    #[must_use]
    pub fn sphere(&self) -> (Vec3, f32) {
        let radius = 0.5 * self.bounds[0].distance(self.bounds[1]);
        (0.5 * (self.bounds[0] + self.bounds[1]), if radius > 0.0 { radius } else { 1.0 })
    }

    /// Returns the world-space corners of a triangle.
    #[must_use]
    pub fn positions(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize].position)
    }
}
