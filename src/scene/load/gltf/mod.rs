//! glTF 2.0 and GLB (Khronos specification 2.0.1) with the extensions in [`SUPPORTED`].
//!
//! Files load as authored: nodes have the file's transforms, meshes have their default morph weights, and
//! skins are applied in the pose of the joints' nodes. A file without animations is posed once, here; one
//! with animations keeps its animated parts in the scene's rig.
//!
//! Every index, count and offset is checked before use, so a bad file is a [`LoadError`] that names the
//! place. Each unsupported feature that a file uses without requiring it is one warning.

mod accessor;
mod animation;
mod codec;
mod compression;
mod extensions;
mod file;
mod instances;
mod lights;
mod material;
mod mesh;
mod tessellation;

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use ::gltf::json::camera::Type as CameraType;
use ::gltf::json::mesh::Semantic;
use ::gltf::json::validation::Checked;
use ::gltf::json::{self, Index};
use glam::{Affine3A, Mat4, Quat, Vec2, Vec3};

use self::file::File;
use self::material::Materials;
use self::mesh::{Budget, Wanted};
use crate::scene::animation::{AttachedLight, Deformation, Local, Rig, Shape, Tree};
use crate::scene::load::far;
use crate::scene::load::files::Files;
use crate::scene::model::tangents;
use crate::scene::model::transform::rigid;
use crate::scene::{Camera, FovAxis, Instance, LoadError, Material, Mesh, Projection, Scene};

/// Index that the parser has for a texture without an image.
const NO_IMAGE: u32 = u32::MAX;

/// Supported extensions.
pub const SUPPORTED: [&str; 25] = [
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Describes the substitute for an extension that a file uses without requiring it.
fn substitute(extension: &str) -> &'static str {
    match extension {
        "EXT_texture_avif" => "the image in another format is read",
        "KHR_materials_diffuse_transmission" => "surfaces are rendered opaque",
        "KHR_node_visibility" => "all nodes are visible",
        "EXT_lights_image_based" => {
            "its prefiltered cube map is left out; `--env FILE` takes the image that it was made of"
        }
        _ => "it is ignored",
    }
}

/// Loads a .gltf or .glb file, and what it refers to, in one of its variants or with its own choice of materials.
///
/// # Errors
/// A file that is missing, truncated or invalid, or that lacks the variant, is an error.
pub fn load(path: &Path, variant: Option<&str>, files: &dyn Files) -> Result<Scene, LoadError> {
    let mut file = File::open(path, files)?;
    let mut scene = Scene { name: path.display().to_string(), ..Scene::default() };
    warn_of_extensions(&file, &mut scene);
    file.check_references()?;
    let variant = pick_variant(&file, &mut scene, variant)?;
    file.load_buffers()?;
    let tree = node_tree(&file)?;
    let shows = |node: &json::Node| node.mesh.is_some();
    let places = tree.rest().into_iter().zip(&file.root.nodes).filter(|(_, node)| shows(node));
    let origin = far::origin(places.map(|(world, _)| world.translation.as_dvec3()));
    scene.notes.extend(far::said(origin));
    let tree = tree.around(origin);
    let world = tree.rest();
    if let Some(i) = world.iter().position(|w| !w.is_finite()) {
        return Err(file.error(format!("nodes[{i}]"), "the transform is not finite"));
    }
    Loader {
        world,
        file: &file,
        scene,
        variant,
        budget: Budget::default(),
        rig: (!file.animations.is_empty()).then(|| Rig { tree, ..Rig::default() }),
        weighted: file.animations.weighted_nodes().collect(),
        skins: HashMap::new(),
        meshes: HashMap::new(),
        profiles: HashMap::new(),
        heights: HashMap::new(),
    }
    .run()
}

/// Warns of extensions that are not read. A file that requires one is drawn without it: many such say nothing of how
/// things look, and what is seen of the others is more than an error shows.
fn warn_of_extensions(file: &File, scene: &mut Scene) {
    let required = &file.root.extensions_required;
    let used = file.root.extensions_used.iter().filter(|&extension| !required.contains(extension));
    let unknown = |extension: &&String| !SUPPORTED.contains(&extension.as_str());
    for extension in required.iter().filter(unknown) {
        scene.warn(format!("{extension} is required, but it is not supported: the picture lacks what it describes"));
    }
    for extension in used.filter(unknown) {
        scene.warn(format!("{extension} is not supported: {}", substitute(extension)));
    }
}

/// Returns the index of a variant by its name. Without a name, a note lists the variants.
fn pick_variant(file: &File, scene: &mut Scene, name: Option<&str>) -> Result<Option<u32>, LoadError> {
    let variants = file.root.extensions.as_ref().and_then(|e| e.khr_materials_variants.as_ref());
    let names: Vec<_> = variants.iter().flat_map(|v| &v.variants).map(|variant| variant.name.as_str()).collect();
    let listed = || names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let Some(name) = name else {
        if !names.is_empty() {
            scene.note(format!("the file has variants of its materials: {}; --variant NAME picks one", listed()));
        }
        return Ok(None);
    };
    let index = names.iter().position(|other| *other == name);
    let index = index.ok_or_else(|| {
        let those =
            if names.is_empty() { "the file has none".to_owned() } else { format!("the file has {}", listed()) };
        LoadError::new(&file.path, format!("there is no variant `{name}`: {those}"))
    })?;
    Ok(Some(index as u32))
}

/// Returns a node's local transform.
fn local(node: &json::Node) -> Local {
    if let Some(matrix) = &node.matrix {
        return Local::Matrix(Affine3A::from_mat4(Mat4::from_cols_array(matrix)));
    }
    let rotation = node.rotation.map_or(Quat::IDENTITY, |r| Quat::from_array(r.0));
    Local::Parts {
        translation: node.translation.map_or(Vec3::ZERO, Vec3::from),
        rotation: if rotation.length_squared() > 0.0 { rotation.normalize() } else { Quat::IDENTITY },
        scale: node.scale.map_or(Vec3::ONE, Vec3::from),
    }
}

/// Returns all nodes after checking that they form trees.
fn node_tree(file: &File) -> Result<Tree, LoadError> {
    let mut nodes: Vec<_> = file.root.nodes.iter().map(|node| (local(node), None)).collect();
    for (i, node) in file.root.nodes.iter().enumerate() {
        for &child in node.children.iter().flatten() {
            let place = format!("nodes[{i}]");
            file.get(child, &place, "nodes")?;
            if nodes[child.value()].1.replace(i).is_some() {
                return Err(file.error(place, format!("nodes[{}] already has a parent", child.value())));
            }
        }
    }
    Tree::new(nodes).map_err(|i| file.error(format!("nodes[{i}]"), "the node is its own ancestor"))
}

/// A mesh at a node: its index, skin, morph weights as bits, and the node itself if these are animated.
type MeshKey = (usize, Option<usize>, Vec<u32>, Option<usize>);

/// A reference from a node to a mesh.
#[derive(Clone, Copy)]
struct Shown<'a> {
    /// The mesh's index.
    mesh: usize,
    /// Index into the rig's skins, if there is a rig, and joint matrices at rest.
    skin: Option<(usize, &'a [Mat4])>,
    /// Morph weights at rest; missing ones are zero.
    weights: &'a [f32],
    /// The node, if its weights are animated.
    weighted: Option<usize>,
}

struct Loader<'a> {
    file: &'a File<'a>,
    scene: Scene,
    /// Index of the variant, if one has been picked.
    variant: Option<u32>,
    world: Vec<Affine3A>,
    budget: Budget,
    /// The rig, if the file has animations.
    rig: Option<Rig>,
    /// Nodes whose morph weights are animated.
    weighted: HashSet<usize>,
    /// Index in the rig and joint matrices at rest of each skin in use.
    skins: HashMap<usize, (usize, Vec<Mat4>)>,
    /// The scene's meshes for each mesh key, one for each primitive with triangles.
    meshes: HashMap<MeshKey, Vec<usize>>,
    /// Pattern and candelas of the factor 1 of each light profile in use.
    profiles: HashMap<usize, (usize, f32)>,
    /// Height maps by texture index.
    heights: HashMap<usize, usize>,
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
                self.place_mesh(Index::new(mesh as u32), None, &[], None, &[Affine3A::IDENTITY], "meshes")?;
            }
        }
        self.scene.images = materials.load_images(self.file)?;
        materials.bake_roughness(&mut self.scene);
        let animations = self.animations()?;
        if let Some(rig) = self.rig.take() {
            self.scene.rig = Some(Arc::new(Rig { animations, ..rig }));
        }
        Ok(self.scene)
    }

    fn load_materials(&mut self, materials: &mut Materials) -> Result<(), LoadError> {
        let file = self.file;
        let mut has_colors = vec![false; file.root.materials.len()];
        for primitive in file.root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
            if let Some(slot) = self.material_of(primitive).and_then(|m| has_colors.get_mut(m.value())) {
                *slot |= mesh::attribute(primitive, Semantic::Colors(0)).is_some();
            }
        }
        for (i, material) in file.root.materials.iter().enumerate() {
            let material = materials.convert(file, &mut self.scene, i, material, has_colors[i])?;
            self.scene.materials.push(material);
            if let Some(group) = lights::group(&file.root.materials[i].extras) {
                self.scene.light_groups.materials.insert(self.scene.materials.len() - 1, group);
            }
        }
        Ok(())
    }

    /// Returns the material of a primitive in the variant.
    fn material_of(&self, primitive: &json::mesh::Primitive) -> Option<Index<json::Material>> {
        let variants = primitive.extensions.as_ref().and_then(|e| e.khr_materials_variants.as_ref());
        let mapped = self.variant.and_then(|variant| {
            let mapping = variants?.mappings.iter().find(|mapping| mapping.variants.contains(&variant))?;
            Some(Index::new(mapping.material))
        });
        mapped.or(primitive.material)
    }

    /// Returns the nodes of the default scene, of the first one, or of the whole file, parents first.
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
            let instances = self.instances(index, node.skin.is_some())?;
            let weights = node.weights.as_deref().unwrap_or_default();
            self.place_mesh(mesh, node.skin, weights, Some(index), &instances, &place)?;
        }
        if let Some(camera) = node.camera {
            let source = camera.value();
            let camera = self.camera(camera, node, world, &place)?;
            self.scene.cameras.push(camera);
            self.rig.iter_mut().for_each(|rig| rig.cameras.push((index, source)));
        }
        let (first_light, mut group) = (self.scene.lights.len(), lights::group(&node.extras));
        if let Some(light) = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref()) {
            let source = light.light;
            let light = self.light(source, world, &place)?;
            self.scene.lights.push(light);
            let json = self.file.get(source, &place, "KHR_lights_punctual.lights")?;
            group = group.or_else(|| lights::group(&json.extras)).or_else(|| node.name.clone().or(json.name.clone()));
            let (color, intensity) = (Vec3::from(json.color), json.intensity);
            let attached = AttachedLight { node: index, source: Some(source.value()), color, intensity };
            self.rig.iter_mut().for_each(|rig| rig.lights.push(attached));
        }
        if let Some(profile) = self.file.profiles.nodes.get(&index) {
            let light = self.profile_light(profile, world, &place)?;
            self.scene.lights.push(light);
            let attached = AttachedLight { node: index, source: None, color: Vec3::ONE, intensity: 1.0 };
            self.rig.iter_mut().for_each(|rig| rig.lights.push(attached));
        }
        if self.scene.lights.len() > first_light {
            self.scene.group_lights(first_light, group.as_deref().or(node.name.as_deref()));
        }
        Ok(())
    }

    /// Instantiates a mesh at a node, or at the origin, once for each transform below it.
    fn place_mesh(
        &mut self,
        index: Index<json::Mesh>,
        skin: Option<Index<json::Skin>>,
        weights: &[f32],
        node: Option<usize>,
        instances: &[Affine3A],
        place: &str,
    ) -> Result<(), LoadError> {
        let mesh = self.file.get(index, place, "meshes")?;
        let weights = if weights.is_empty() { mesh.weights.as_deref().unwrap_or_default() } else { weights };
        let bits = weights.iter().map(|w| w.to_bits()).collect();
        let weighted = node.filter(|node| self.weighted.contains(node));
        let key = (index.value(), skin.map(|s| s.value()), bits, weighted);
        if !self.meshes.contains_key(&key) {
            let skin = skin.map(|skin| self.skin(skin)).transpose()?;
            let skin = skin.as_ref().map(|(index, matrices)| (*index, matrices.as_slice()));
            let loaded = self.load_mesh(mesh, Shown { mesh: index.value(), skin, weights, weighted })?;
            self.meshes.insert(key.clone(), loaded);
        }
        // glTF 2.0, 3.7.3.3, ignores the transform of a skinned mesh's own node.
        let node = node.filter(|_| skin.is_none());
        let world_from_local = node.map_or(Affine3A::IDENTITY, |node| self.world[node]);
        let triangles: usize = self.meshes[&key].iter().map(|&mesh| self.scene.meshes[mesh].triangles.len()).sum();
        self.budget.instantiate(triangles, instances.len()).map_err(|cause| self.file.error(place, cause))?;
        for &node_from_local in instances {
            for &mesh in &self.meshes[&key] {
                self.scene.instances.push(Instance { mesh, world_from_local: world_from_local * node_from_local });
                self.rig.iter_mut().for_each(|rig| rig.instances.push(node.map(|node| (node, node_from_local))));
            }
        }
        Ok(())
    }

    /// Returns a skin's index in the rig and its joint matrices at rest.
    fn skin(&mut self, index: Index<json::Skin>) -> Result<(usize, Vec<Mat4>), LoadError> {
        if let Some(known) = self.skins.get(&index.value()) {
            return Ok(known.clone());
        }
        let place = format!("skins[{}]", index.value());
        let skin = mesh::skin(self.file, self.file.get(index, &place, "skins")?, &place)?;
        let matrices = skin.matrices(&self.world);
        let mut in_rig = 0;
        if let Some(rig) = &mut self.rig {
            in_rig = rig.skins.len();
            rig.skins.push(skin);
        }
        self.skins.insert(index.value(), (in_rig, matrices.clone()));
        Ok((in_rig, matrices))
    }

    fn load_mesh(&mut self, mesh: &json::Mesh, shown: Shown<'_>) -> Result<Vec<usize>, LoadError> {
        let Shown { mesh: index, skin, weights, weighted } = shown;
        let matrices = skin.map(|(_, matrices)| matrices);
        let wanted = Wanted { weights: weighted.is_none().then_some(weights), joints: matrices.map(<[Mat4]>::len) };
        mesh::count_corners(self.file, mesh, index, &mut self.budget)?;
        let mut loaded = Vec::new();
        let mut warnings = Vec::new();
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("meshes[{index}].primitives[{p}]");
            let material = match self.material_of(primitive) {
                Some(material) => {
                    self.file.get(material, &place, "materials")?;
                    material.value()
                }
                None => {
                    // The default material follows the file's own; the first primitive without material adds
                    // it.
                    let default = self.file.root.materials.len();
                    self.scene.materials.resize_with(default + 1, material::default_material);
                    default
                }
            };
            let loaded_primitive = mesh::load(self.file, primitive, &place, wanted, &mut self.budget, &mut warnings)?;
            let Some((mut out, mut deformation)) = loaded_primitive else { continue };
            out.material = material;
            out.name = mesh.name.clone().unwrap_or_else(|| place.clone());
            if let Some(tessellation) = self.tessellation(mesh, primitive, &place)? {
                if let Some(cause) = tessellation::lacks(&out, &tessellation) {
                    return Err(self.file.error(place, cause));
                }
                tessellation.refine(&mut out);
            }
            let moves = skin.is_some() || (weighted.is_some() && !deformation.targets.is_empty());
            match self.rig.as_mut().filter(|_| moves) {
                // The vertices have to be the same in every pose, so missing tangents are generated from the
                // undeformed mesh.
                Some(rig) => {
                    add_tangents(&mut out, &mut deformation, &self.scene.materials[material], &place, &mut warnings);
                    let base = out.clone();
                    deformation.apply(&mut out, weights, matrices);
                    rig.shapes.push(Shape {
                        mesh: self.scene.meshes.len(),
                        base,
                        deformation,
                        skin: skin.map(|(index, _)| index),
                        node: weighted,
                        weights: weights.to_vec(),
                    });
                }
                None => {
                    deformation.apply(&mut out, weights, matrices);
                    add_tangents(&mut out, &mut deformation, &self.scene.materials[material], &place, &mut warnings);
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

/// Generates a mesh's tangents if its material needs them and removes them otherwise.
fn add_tangents(
    mesh: &mut Mesh,
    deformation: &mut Deformation,
    material: &Material,
    place: &str,
    warnings: &mut Vec<String>,
) {
    match material.tangent_texture() {
        None => mesh.tangents.clear(),
        Some(_) if !mesh.tangents.is_empty() => {}
        Some(texture) => {
            let uv_set = texture.uv_set as usize;
            if mesh.uvs[uv_set].is_empty() {
                warnings.push(format!(
                    "{place} has no TEXCOORD_{uv_set}: its normal map or the stretch of its highlights has no effect"
                ));
            }
            if let Some(vertices) = tangents::generate(mesh, uv_set, texture.transform) {
                deformation.select(&vertices);
            }
        }
    }
}
