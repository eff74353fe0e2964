//! Instances of a node's mesh: EXT_mesh_gpu_instancing.

use std::collections::{BTreeMap, HashMap};

use ::gltf::json::{self, Index};
use glam::{Affine3A, Quat, Vec3};
use serde::Deserialize;

use super::Loader;
use super::accessor::Accessor;
use super::mesh::MAX_INSTANCES;
use crate::scene::LoadError;

/// The attributes of the instances of each node that has some.
#[derive(Default)]
pub(super) struct Instancing {
    nodes: HashMap<usize, BTreeMap<String, Index<json::Accessor>>>,
}

impl Instancing {
    /// Reads the extension from a file's JSON.
    pub fn parse(text: &[u8]) -> Result<Self, serde_json::Error> {
        #[derive(Deserialize)]
        struct Root {
            #[serde(default)]
            nodes: Vec<Node>,
        }
        #[derive(Deserialize)]
        struct Node {
            extensions: Option<Extensions>,
        }
        #[derive(Deserialize)]
        struct Extensions {
            #[serde(rename = "EXT_mesh_gpu_instancing")]
            instancing: Option<Attributes>,
        }
        #[derive(Deserialize)]
        struct Attributes {
            attributes: BTreeMap<String, Index<json::Accessor>>,
        }
        let root: Root = serde_json::from_slice(text)?;
        let attributes = root.nodes.into_iter().map(|node| Some(node.extensions?.instancing?.attributes));
        Ok(Self { nodes: attributes.enumerate().filter_map(|(i, attributes)| Some((i, attributes?))).collect() })
    }
}

impl Loader<'_> {
    /// Returns the transforms of the instances of a node's mesh below the node; a node without the extension
    /// has one.
    pub(super) fn instances(&mut self, node: usize, is_skinned: bool) -> Result<Vec<Affine3A>, LoadError> {
        let file = self.file;
        let Some(attributes) = file.instancing.nodes.get(&node) else { return Ok(vec![Affine3A::IDENTITY]) };
        let place = format!("nodes[{node}]");
        if is_skinned {
            // A skin places the mesh in the world, so that instances would all lie at one place.
            self.scene.warn(format!("{place} has instances of a skinned mesh: one is shown"));
            return Ok(vec![Affine3A::IDENTITY]);
        }
        let open = |name: &str, lanes: usize| {
            let place = format!("{place}.EXT_mesh_gpu_instancing.{name}");
            attributes.get(name).map(|&index| Accessor::open(file, index, &place, &[lanes])).transpose()
        };
        let (translations, rotations, scales) = (open("TRANSLATION", 3)?, open("ROTATION", 4)?, open("SCALE", 3)?);
        let mut counts = [&translations, &rotations, &scales].into_iter().flatten().map(|accessor| accessor.count);
        let Some(count) = counts.next() else {
            self.scene.warn(format!("{place} has instances without transforms: one is shown"));
            return Ok(vec![Affine3A::IDENTITY]);
        };
        if let Some(other) = counts.find(|&other| other != count) {
            let cause = format!("the attributes of its instances have {count} and {other} elements: export them again");
            return Err(file.error(place, cause));
        }
        if count > MAX_INSTANCES {
            return Err(file.error(place, format!("{count} instances are more than {MAX_INSTANCES}: show fewer")));
        }
        let vector = |accessor: &Option<Accessor<'_>>, i: usize, default: Vec3| {
            accessor.as_ref().map_or(default, |a| Vec3::from(a.floats::<3>(i, 0.0)))
        };
        let mut transforms = Vec::with_capacity(count);
        for i in 0..count {
            let rotation = rotations.as_ref().map_or(Quat::IDENTITY, |a| Quat::from_array(a.floats(i, 0.0)));
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { Quat::IDENTITY };
            let (scale, translation) = (vector(&scales, i, Vec3::ONE), vector(&translations, i, Vec3::ZERO));
            let transform = Affine3A::from_scale_rotation_translation(scale, rotation, translation);
            if !transform.is_finite() {
                return Err(file.error(place, format!("the transform of instance {i} is not finite")));
            }
            transforms.push(transform);
        }
        Ok(transforms)
    }
}
