//! glTF 2.0 and GLB (Khronos specification 2.0.1) with the extensions in [`SUPPORTED`].
//!
//! Files load as authored: nodes stand where the file puts them, meshes have their default morph weights, and skins are
//! applied in the pose of the joints' nodes. Animations are not sampled; their first keyframe is, in files that animate
//! one, nearly always that pose. Morphing and skinning happen once, here.
//!
//! Every index, count and offset is checked where it is used, so a bad file is a [`LoadError`] that names the place. What
//! the file only uses and we do not read is one warning each.

mod accessor;
mod file;
mod lights;
mod material;
mod mesh;

use std::collections::HashMap;
use std::path::Path;

use ::gltf::json::camera::Type as CameraType;
use ::gltf::json::mesh::Semantic;
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Affine3A, Mat3A, Mat4, Quat, Vec2, Vec3, Vec3A};

use self::file::File;
use self::material::Materials;
use self::mesh::{Budget, Pose, Skin};
use super::{Camera, FovAxis, Instance, LoadError, Projection, Scene, tangents};

/// Extensions that are read.
pub const SUPPORTED: [&str; 10] = [
    "EXT_lights_ies",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// What is done about an extension that a file uses without requiring it.
fn substitute(extension: &str) -> &'static str {
    match extension {
        "KHR_draco_mesh_compression" | "EXT_meshopt_compression" => "the uncompressed fallback is read",
        "KHR_texture_basisu" | "EXT_texture_webp" | "EXT_texture_avif" => "the PNG or JPEG fallback is read",
        "KHR_materials_diffuse_transmission" => "surfaces are rendered opaque",
        "KHR_materials_pbrSpecularGlossiness" => "the metallic-roughness values beside it are read",
        "KHR_materials_clearcoat" => "the base is rendered without its coat",
        "KHR_materials_sheen" => "the base is rendered without its sheen",
        "KHR_materials_iridescence" => "the base is rendered without its film",
        "KHR_materials_anisotropy" => "highlights are rendered isotropic",
        "KHR_materials_dispersion" => "the medium does not disperse",
        "KHR_materials_variants" => "the default variant is read",
        "EXT_mesh_gpu_instancing" => "a single instance is read",
        "KHR_node_visibility" => "all nodes are visible",
        "EXT_lights_image_based" => {
            "its prefiltered cube map is left out; `--env FILE` takes the image that it was made of"
        }
        _ => "it is ignored",
    }
}

/// Loads a .gltf or .glb file.
///
/// # Errors
/// A file that is missing, truncated or wrong, or that requires an extension which is not read.
pub fn load(path: &Path) -> Result<Scene, LoadError> {
    let mut file = File::open(path)?;
    let mut scene = Scene { name: path.display().to_string(), ..Scene::default() };
    check_extensions(&file, &mut scene)?;
    file.check_references()?;
    file.load_buffers()?;
    let world = place_nodes(&file)?;
    let (budget, meshes, profiles) = (Budget::default(), HashMap::new(), HashMap::new());
    Loader { world, file: &file, scene, budget, meshes, profiles }.run()
}

fn check_extensions(file: &File, scene: &mut Scene) -> Result<(), LoadError> {
    let unknown = |e: &&String| !SUPPORTED.contains(&e.as_str());
    if let Some(extension) = file.root.extensions_required.iter().find(unknown) {
        let cause = format!("{extension} is required, but it is not supported: export the file again without it");
        return Err(file.error("extensionsRequired", cause));
    }
    for extension in file.root.extensions_used.iter().filter(unknown) {
        scene.warn(format!("{extension} is not supported: {}", substitute(extension)));
    }
    Ok(())
}

/// A node's own transform.
fn local(node: &json::Node) -> Affine3A {
    if let Some(matrix) = &node.matrix {
        return Affine3A::from_mat4(Mat4::from_cols_array(matrix));
    }
    let rotation = node.rotation.map_or(Quat::IDENTITY, |r| Quat::from_array(r.0));
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { Quat::IDENTITY };
    Affine3A::from_scale_rotation_translation(
        node.scale.map_or(Vec3::ONE, Vec3::from),
        rotation,
        node.translation.map_or(Vec3::ZERO, Vec3::from),
    )
}

/// World placement of every node, after checking that nodes form trees.
fn place_nodes(file: &File) -> Result<Vec<Affine3A>, LoadError> {
    let nodes = &file.root.nodes;
    let mut has_parent = vec![false; nodes.len()];
    for (i, node) in nodes.iter().enumerate() {
        for &child in node.children.iter().flatten() {
            let place = format!("nodes[{i}]");
            file.get(child, &place, "nodes")?;
            if std::mem::replace(&mut has_parent[child.value()], true) {
                return Err(file.error(place, format!("nodes[{}] already has a parent", child.value())));
            }
        }
    }
    let mut world: Vec<Option<Affine3A>> = vec![None; nodes.len()];
    let mut stack: Vec<(usize, Affine3A)> =
        (0..nodes.len()).filter(|&i| !has_parent[i]).map(|i| (i, Affine3A::IDENTITY)).collect();
    while let Some((i, parent)) = stack.pop() {
        let placement = parent * local(&nodes[i]);
        if !placement.is_finite() {
            return Err(file.error(format!("nodes[{i}]"), "the transform is not finite"));
        }
        world[i] = Some(placement);
        stack.extend(nodes[i].children.iter().flatten().map(|child| (child.value(), placement)));
    }
    let placed = world.into_iter().enumerate();
    placed.map(|(i, w)| w.ok_or_else(|| file.error(format!("nodes[{i}]"), "the node is its own ancestor"))).collect()
}

/// A mesh as a node shows it: its index, skin, and morph weights as bits.
type MeshKey = (usize, Option<usize>, Vec<u32>);

struct Loader<'a> {
    file: &'a File,
    scene: Scene,
    world: Vec<Affine3A>,
    budget: Budget,
    /// The scene's meshes for what nodes show, one for each primitive with triangles.
    meshes: HashMap<MeshKey, Vec<usize>>,
    /// Patterns of the light profiles that nodes show, and what their 1 stands for.
    profiles: HashMap<usize, (usize, f32)>,
}

impl Loader<'_> {
    fn run(mut self) -> Result<Scene, LoadError> {
        let mut materials = Materials::default();
        self.load_materials(&mut materials)?;
        let nodes = self.shown_nodes()?;
        for &node in &nodes {
            self.load_node(node)?;
        }
        if self.file.root.nodes.is_empty() && !self.file.root.meshes.is_empty() {
            self.scene.warn("the file has meshes and no node that shows them: all are placed at the origin");
            for mesh in 0..self.file.root.meshes.len() {
                self.place_mesh(Index::new(mesh as u32), None, &[], Affine3A::IDENTITY, "meshes")?;
            }
        }
        self.scene.images = materials.load_images(self.file)?;
        Ok(self.scene)
    }

    fn load_materials(&mut self, materials: &mut Materials) -> Result<(), LoadError> {
        let file = self.file;
        let mut has_colors = vec![false; file.root.materials.len()];
        for primitive in file.root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
            if let Some(slot) = primitive.material.and_then(|m| has_colors.get_mut(m.value())) {
                *slot |= mesh::attribute(primitive, Semantic::Colors(0)).is_some();
            }
        }
        for (i, material) in file.root.materials.iter().enumerate() {
            let material = materials.convert(file, &mut self.scene, i, material, has_colors[i])?;
            self.scene.materials.push(material);
        }
        Ok(())
    }

    /// The nodes of the default scene, of the first one, or of the whole file, parents first.
    fn shown_nodes(&self) -> Result<Vec<usize>, LoadError> {
        let root = &self.file.root;
        let scene = match root.scene {
            Some(index) => Some((index.value(), self.file.get(index, "scene", "scenes")?)),
            None => root.scenes.first().map(|scene| (0, scene)),
        };
        let Some((index, scene)) = scene else {
            return Ok((0..root.nodes.len()).collect());
        };
        let place = format!("scenes[{index}]");
        let mut shown = vec![false; root.nodes.len()];
        let mut stack: Vec<_> = scene.nodes.iter().rev().copied().collect();
        let mut order = Vec::new();
        while let Some(node) = stack.pop() {
            let children = &self.file.get(node, &place, "nodes")?.children;
            if !std::mem::replace(&mut shown[node.value()], true) {
                order.push(node.value());
                stack.extend(children.iter().flatten().rev());
            }
        }
        Ok(order)
    }

    fn load_node(&mut self, index: usize) -> Result<(), LoadError> {
        let file = self.file;
        let node = &file.root.nodes[index];
        let place = format!("nodes[{index}]");
        let world = self.world[index];
        if let Some(mesh) = node.mesh {
            self.place_mesh(mesh, node.skin, node.weights.as_deref().unwrap_or_default(), world, &place)?;
        }
        if let Some(camera) = node.camera {
            let camera = self.camera(camera, node, world, &place)?;
            self.scene.cameras.push(camera);
        }
        if let Some(light) = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref()) {
            let light = self.light(light.light, world, &place)?;
            self.scene.lights.push(light);
        }
        if let Some(profile) = self.file.profiles.nodes.get(&index) {
            let light = self.profile_light(profile, world, &place)?;
            self.scene.lights.push(light);
        }
        Ok(())
    }

    fn place_mesh(
        &mut self,
        index: Index<json::Mesh>,
        skin: Option<Index<json::Skin>>,
        weights: &[f32],
        world: Affine3A,
        place: &str,
    ) -> Result<(), LoadError> {
        let mesh = self.file.get(index, place, "meshes")?;
        let weights = if weights.is_empty() { mesh.weights.as_deref().unwrap_or_default() } else { weights };
        let bits = weights.iter().map(|w| w.to_bits()).collect();
        let key = (index.value(), skin.map(|s| s.value()), bits);
        if !self.meshes.contains_key(&key) {
            let skin = match skin {
                Some(skin) => {
                    let place = format!("skins[{}]", skin.value());
                    Some(Skin::new(self.file, self.file.get(skin, &place, "skins")?, &place, &self.world)?)
                }
                None => None,
            };
            let loaded = self.load_mesh(index.value(), mesh, Pose { weights, skin: skin.as_ref() })?;
            self.meshes.insert(key.clone(), loaded);
        }
        // glTF 2.0, 3.7.3.3: the transform of a skinned mesh's own node is ignored.
        let world_from_local = if skin.is_some() { Affine3A::IDENTITY } else { world };
        self.scene.instances.extend(self.meshes[&key].iter().map(|&mesh| Instance { mesh, world_from_local }));
        Ok(())
    }

    fn load_mesh(&mut self, index: usize, mesh: &json::Mesh, pose: Pose<'_>) -> Result<Vec<usize>, LoadError> {
        let mut loaded = Vec::new();
        let mut warnings = Vec::new();
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("meshes[{index}].primitives[{p}]");
            let material = match primitive.material {
                Some(material) => {
                    self.file.get(material, &place, "materials")?;
                    material.value()
                }
                None => {
                    // One past the file's own, made when the first primitive asks for it.
                    let default = self.file.root.materials.len();
                    self.scene.materials.resize_with(default + 1, material::default_material);
                    default
                }
            };
            let Some(mut out) = mesh::load(self.file, primitive, &place, pose, &mut self.budget, &mut warnings)? else {
                continue;
            };
            out.material = material;
            out.name = mesh.name.clone().unwrap_or_else(|| place.clone());
            match self.scene.materials[material].normal_map {
                None => out.tangents.clear(),
                Some(_) if !out.tangents.is_empty() => {}
                Some(map) => {
                    let uv_set = map.texture.uv_set as usize;
                    if out.uvs[uv_set].is_empty() {
                        let cause = format!("{place} has no TEXCOORD_{uv_set}: its normal map has no effect");
                        warnings.push(cause);
                    }
                    tangents::generate(&mut out, uv_set, map.texture.transform);
                }
            }
            self.scene.meshes.push(out);
            loaded.push(self.scene.meshes.len() - 1);
        }
        warnings.into_iter().for_each(|warning| self.scene.warn(warning));
        Ok(loaded)
    }

    fn camera(
        &self,
        index: Index<json::Camera>,
        node: &json::Node,
        world: Affine3A,
        place: &str,
    ) -> Result<Camera, LoadError> {
        let camera = self.file.get(index, place, "cameras")?;
        let place = format!("cameras[{}]", index.value());
        let Checked::Valid(kind) = camera.type_ else {
            return Err(self.file.error(place, "unknown type"));
        };
        let projection = match (kind, &camera.perspective, &camera.orthographic) {
            (CameraType::Perspective, Some(p), _) if p.yfov > 0.0 && p.yfov < std::f32::consts::PI => {
                Projection::Perspective { fov: p.yfov, axis: FovAxis::Y }
            }
            (CameraType::Perspective, Some(p), _) => {
                return Err(self.file.error(place, format!("a yfov of {} is not between 0 and pi", p.yfov)));
            }
            (CameraType::Orthographic, _, Some(o)) if o.xmag != 0.0 && o.ymag != 0.0 => {
                Projection::Orthographic { half_extent: Vec2::new(o.xmag, o.ymag).abs() }
            }
            (CameraType::Orthographic, _, Some(_)) => {
                return Err(self.file.error(place, "xmag or ymag is zero"));
            }
            _ => return Err(self.file.error(place, "the values of its type are missing")),
        };
        let name = node.name.clone().or_else(|| camera.name.clone()).unwrap_or_else(|| place.clone());
        Ok(Camera { name, world_from_camera: rigid(world), projection, lens: None, film_size: None })
    }
}

/// The rigid part of a placement: position, direction of -Z, and +Y as far as it is at right angles to it.
fn rigid(world: Affine3A) -> Affine3A {
    let back = world.z_axis.normalize_or(Vec3A::Z);
    let x = world.y_axis.cross(back).normalize_or_zero();
    let x = if x == Vec3A::ZERO { back.any_orthonormal_vector() } else { x };
    Affine3A { matrix3: Mat3A::from_cols(x, back.cross(x), back), translation: world.translation }
}
