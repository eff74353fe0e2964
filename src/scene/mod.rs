//! Scenes as plain data: what a file says, before any method looks at it.
//!
//! A [`Scene`] is meshes, instances, materials, textures, lights and a camera, in world units of metres and linear Rec. 709
//! radiometry. Loaders build it ([`load()`]), [`geometry::Geometry`] flattens it into world-space triangles, and both the GPU
//! upload and the CPU reference read that one flattening. Nothing here knows of a GPU or of an estimator.

use std::sync::Arc;

pub mod animation;
pub mod builtin;
pub mod camera;
pub mod emitter;
pub mod environment;
pub mod error;
pub mod geometry;
pub mod gltf;
pub mod height;
pub mod ies;
pub mod light;
pub mod load;
pub mod material;
pub mod mesh;
pub mod mitsuba;
pub mod pattern;
pub mod refine;
pub mod shapes;
pub mod sky;
pub mod stats;
pub mod studio;
pub mod tangents;
pub mod tessellation;
pub mod texture;

pub use animation::{Pose, Rig};
pub use camera::{Camera, FovAxis, Lens, Projection};
pub use emitter::Emitter;
pub use environment::{Environment, EnvironmentChange, EnvironmentMap, Rows};
pub use error::LoadError;
pub use geometry::Geometry;
pub use height::{Height, HeightMap, Wave};
pub use light::{Cone, Lamp, Light, SpotFalloff, angle_of_versine, versine};
pub use load::{load, load_under};
pub use material::{AlphaMask, Boundary, Bsdf, Color, Emission, Fresnel, Material, NormalMap, SMOOTH, Scalar, Sides};
pub use mesh::{Instance, Mesh};
pub use pattern::{Mapping, Pattern};
pub use stats::SceneStats;
pub use tessellation::{Displacement, EdgeFactor, Tessellation, Viewpoint};
pub use texture::{Filter, Image, Texture, TextureRef, Wrap};

/// Luminance of linear Rec. 709.
pub const LUMINANCE: glam::Vec3 = glam::Vec3::new(0.2126, 0.7152, 0.0722);

/// Everything that a renderer needs to know of a scene file.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Where it came from: the path or `builtin:NAME`.
    pub name: String,
    /// Meshes in their own space, one material each.
    pub meshes: Vec<Mesh>,
    /// Placements of meshes in the world.
    pub instances: Vec<Instance>,
    /// Materials that meshes index.
    pub materials: Vec<Material>,
    /// Image and sampler pairs that [`TextureRef`]s index.
    pub textures: Vec<Texture>,
    /// Pixels that textures index.
    pub images: Vec<Image>,
    /// What surfaces are displaced by.
    pub height_maps: Vec<HeightMap>,
    /// Punctual and directional lights. Emissive surfaces are materials with emission.
    pub lights: Vec<Light>,
    /// Directional patterns that lamps index.
    pub patterns: Vec<Pattern>,
    /// Radiance from infinitely far away, if any.
    pub environment: Option<Environment>,
    /// At least one after loading; the first is the default.
    pub cameras: Vec<Camera>,
    /// What moves, where the file animates anything; the scene is in its rest pose.
    pub rig: Option<Arc<Rig>>,
    /// How the meshes came to be what they are, in a scene that was posed.
    pub pose: Option<Pose>,
    /// Since the beginning of what moves by itself, such as waves.
    pub seconds: f32,
    /// Whose pixels tessellation counts; none: those of the first camera's own image.
    pub viewpoint: Option<Viewpoint>,
    /// One sentence per unsupported or repaired thing: what it is and what was done instead.
    pub warnings: Vec<String>,
    /// One sentence per thing that the file leaves out and that was added.
    pub notes: Vec<String>,
}

impl Scene {
    /// Adds a warning unless the very same sentence is already there.
    pub fn warn(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// Says that something was added.
    pub fn note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    /// A mesh before it was morphed and skinned.
    #[must_use]
    pub fn at_rest(&self, mesh: usize) -> &Mesh {
        let rig = self.rig.as_ref().or(self.pose.as_ref().map(|pose| &pose.rig));
        let shape = rig.and_then(|rig| rig.shapes.iter().find(|shape| shape.mesh == mesh));
        shape.map_or(&self.meshes[mesh], |shape| &shape.base)
    }

    /// The scene for a method that cannot follow light through surfaces: glass is left out, so that light passes unbent, and
    /// glTF's transmission is opaque. One warning for each names the materials.
    #[must_use]
    pub fn without_glass(mut self) -> Self {
        let glass = |material: &Material| matches!(material.bsdf, Bsdf::Dielectric { .. });
        let shown = |test: &dyn Fn(&Material) -> bool| {
            let mut used: Vec<usize> = self.instances.iter().map(|i| self.meshes[i.mesh].material).collect();
            used.sort_unstable();
            used.dedup();
            let used = used.into_iter().map(|m| &self.materials[m]).filter(|m| test(m));
            used.map(|m| format!("`{}`", m.name)).collect::<Vec<_>>().join(", ")
        };
        let methods = "`--method ray-query` and `reference` let light pass";
        let [left_out, opaque] = [shown(&glass), shown(&|m| !glass(m) && m.bsdf.transmits())];
        if !left_out.is_empty() {
            self.warn(format!("surfaces of glass are left out: {left_out}; {methods} as it should"));
        }
        if !opaque.is_empty() {
            self.warn(format!("transmission is rendered opaque: {opaque}; {methods}"));
        }
        let (meshes, materials) = (&self.meshes, &self.materials);
        self.instances.retain(|i| !glass(&materials[meshes[i.mesh].material]));
        for material in &mut self.materials {
            if let Bsdf::MetallicRoughness { transmission, .. } = &mut material.bsdf {
                *transmission = 0.0.into();
            }
        }
        self
    }
}
