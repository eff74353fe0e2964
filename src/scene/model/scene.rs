//! A scene as plain data: meshes, instances, materials, lights and cameras.

use std::sync::Arc;

use crate::scene::animation::{Pose, Rig};
use crate::scene::model::camera::Camera;
use crate::scene::model::environment::Environment;
use crate::scene::model::height::HeightMap;
use crate::scene::model::light::Light;
use crate::scene::model::light_groups::LightGroups;
use crate::scene::model::material::{Bsdf, Material};
use crate::scene::model::mesh::{Instance, Mesh};
use crate::scene::model::pattern::Pattern;
use crate::scene::model::tessellation::{Tessellation, Viewpoint};
use crate::scene::model::texture::{Image, Texture};

/// Luminance weights of linear Rec. 709.
pub const LUMINANCE: glam::Vec3 = glam::Vec3::new(0.2126, 0.7152, 0.0722);

/// A scene as the renderers see it.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Source of the scene: a path or `builtin:NAME`.
    pub name: String,
    /// Meshes in their own space, one material each.
    pub meshes: Vec<Mesh>,
    /// Placements of meshes in the world.
    pub instances: Vec<Instance>,
    /// Materials that meshes index.
    pub materials: Vec<Material>,
    /// Image and sampler pairs that [`TextureRef`](super::texture::TextureRef)s index.
    pub textures: Vec<Texture>,
    /// Pixels that textures index.
    pub images: Vec<Image>,
    /// Height maps of displaced surfaces.
    pub height_maps: Vec<HeightMap>,
    /// Local and infinite lights without surfaces. Emissive surfaces are materials with emission.
    pub lights: Vec<Light>,
    /// Groups of lights, for layers of their own.
    pub light_groups: LightGroups,
    /// Directional patterns that lamps index.
    pub patterns: Vec<Pattern>,
    /// Environment light, if any.
    pub environment: Option<Environment>,
    /// True if its format says all the light that there is, as Mitsuba's does. Viewers of glTF light what has little.
    pub says_its_light: bool,
    /// Cameras. There is at least one after staging; the first is the default.
    pub cameras: Vec<Camera>,
    /// Animated parts, if the file has animations; the scene itself is in its rest pose.
    pub rig: Option<Arc<Rig>>,
    /// Deformation state of the meshes in a posed scene.
    pub pose: Option<Pose>,
    /// Time in seconds of procedural motion, such as waves.
    pub seconds: f32,
    /// View that pixel-based tessellation refers to; if none, the image of the first camera.
    pub viewpoint: Option<Viewpoint>,
    /// One sentence per unsupported or repaired feature: the feature and its substitute.
    pub warnings: Vec<String>,
    /// One sentence per addition for something that the file leaves out.
    pub notes: Vec<String>,
}

impl Scene {
    /// Returns true if [`Scene::at`] depends on the time.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.rig.is_some() || self.meshes.iter().filter_map(Mesh::refinement).any(Tessellation::moves)
    }

    /// Adds a warning unless the same sentence is present.
    pub fn warn(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// Adds a note about an addition.
    pub fn note(&mut self, note: impl Into<String>) {
        self.notes.push(note.into());
    }

    /// Returns a mesh before morphing and skinning.
    #[must_use]
    pub fn at_rest(&self, mesh: usize) -> &Mesh {
        let rig = self.rig.as_ref().or(self.pose.as_ref().map(|pose| &pose.rig));
        let shape = rig.and_then(|rig| rig.shapes.iter().find(|shape| shape.mesh == mesh));
        shape.map_or(&self.meshes[mesh], |shape| &shape.base)
    }

    /// Returns whether a visible surface transmits light.
    #[must_use]
    pub fn transmits(&self) -> bool {
        self.instances.iter().any(|i| self.materials[self.meshes[i.mesh].material].transmits())
    }

    /// Removes glass and makes glTF's transmission opaque, for methods that cannot trace light through
    /// surfaces. Light passes removed surfaces unbent. One warning for each of the two names the materials.
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
        let methods = "`--method ray-query` and `reference` render transmission";
        let is_mixed = |m: &Material| m.mix.is_some() && m.any(&glass);
        let [left_out, mixed] = [shown(&glass), shown(&is_mixed)];
        let opaque = shown(&|m| !glass(m) && !is_mixed(m) && m.transmits());
        if !left_out.is_empty() {
            self.warn(format!("surfaces of glass are left out: {left_out}; {methods}"));
        }
        if !mixed.is_empty() {
            self.warn(format!("glass in mixes is left out: {mixed}; {methods}"));
        }
        if !opaque.is_empty() {
            self.warn(format!("transmission is rendered opaque: {opaque}; {methods}"));
        }
        self.materials.iter_mut().for_each(Material::unmix_glass);
        let (meshes, materials) = (&self.meshes, &self.materials);
        self.instances.retain(|i| !glass(&materials[meshes[i.mesh].material]));
        for material in &mut self.materials {
            material.change_plain(&mut |part| {
                if let Bsdf::MetallicRoughness { transmission, .. } = &mut part.bsdf {
                    *transmission = 0.0.into();
                }
                part.diffuse_transmission = None;
            });
        }
        self
    }
}
