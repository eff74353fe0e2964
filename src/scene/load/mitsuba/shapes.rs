//! Shapes: mesh files and simple bodies, placed by `to_world`, with their BSDF and area light.
//!
//! A mesh file without normals gets smooth ones unless `face_normals` is set, as in Mitsuba. Spheres become
//! triangles with exact normals. A mirroring `to_world` keeps the outside of a body, and turns a mesh without
//! normals inside out, as in Mitsuba, which determines the front by the winding in world space.

use glam::{Affine2, Affine3A, DMat4, DVec3, Mat3A, Vec3};

use super::bsdfs::{NormalMapBasis, Surface};
use super::values::Plugin;
use super::xml::Element;
use super::{Loader, serialized};
use crate::scene::load::meshes::{face_along_normals, obj, ply, subset};
use crate::scene::model::normals::smooth_normals;
use crate::scene::model::shapes::{cube, cylinder, disk, rectangle, sphere};
use crate::scene::model::tangents;
use crate::scene::{Bsdf, Color, Instance, LoadError, Material, Mesh, NormalMap, Sides};

/// Maximum number of world-space triangles of a scene; a file of a few lines could request more than fits in
/// memory.
const MAX_TRIANGLES: usize = 1 << 28;

/// A surface in the scene's list; a bump-mapped one is copied for each mesh.
#[derive(Clone, Debug)]
pub(super) enum ShapeMaterial {
    Ready(usize, Option<NormalMapBasis>),
    Bumped(Box<Surface>),
}

/// Returns a mesh whose positions are relative to a place.
fn at(origin: DVec3, mesh: Mesh) -> Mesh {
    let positions = mesh.positions.iter().map(|position| (position.as_dvec3() + origin).as_vec3()).collect();
    Mesh { positions, ..mesh }
}

/// A mesh, and the names of its materials with the triangles at which each begins.
type Named = (Mesh, Vec<(String, usize)>);

impl<'a> Loader<'a> {
    /// Adds a shape of the scene.
    pub(super) fn shape(&mut self, element: &'a Element) -> Result<(), LoadError> {
        match element.plugin() {
            // A shape group is added by the instances that refer to it.
            "shapegroup" => Ok(()),
            "instance" => self.instance(element),
            _ => {
                let instances = self.shape_instances(element)?;
                self.place(element, instances)
            }
        }
    }

    fn place(&mut self, element: &Element, instances: Vec<Instance>) -> Result<(), LoadError> {
        let triangles: usize = instances.iter().map(|i| self.scene.meshes[i.mesh].triangles.len()).sum();
        self.triangles = self.triangles.saturating_add(triangles);
        if self.triangles > MAX_TRIANGLES || self.scene.instances.len() + instances.len() > MAX_TRIANGLES {
            return Err(element.error(format!("the scene has more than {MAX_TRIANGLES} triangles")));
        }
        self.scene.instances.extend(instances);
        Ok(())
    }

    fn instance(&mut self, element: &'a Element) -> Result<(), LoadError> {
        let plugin = self.plugin(element)?;
        let Some(group) = plugin.only("shape")?.filter(|e| e.plugin() == "shapegroup") else {
            return Err(element.error("an instance needs a shapegroup inside"));
        };
        if !self.groups.contains_key(&std::ptr::from_ref(group)) {
            let parts = self.plugin(group)?;
            let mut instances = Vec::new();
            for part in parts.nested("shape") {
                if matches!(part.plugin(), "shapegroup" | "instance") {
                    return Err(part.error("a shapegroup cannot contain a shapegroup or an instance"));
                }
                instances.extend(self.shape_instances(part)?);
            }
            self.groups.insert(group, instances);
        }
        let world_from_group = affine(element, plugin.transform("to_world")?)?;
        self.finish(&plugin);
        let place = |i: &Instance| Instance { mesh: i.mesh, world_from_local: world_from_group * i.world_from_local };
        let instances = self.groups[&std::ptr::from_ref(group)].iter().map(place).collect();
        self.place(element, instances)
    }

    fn shape_instances(&mut self, element: &'a Element) -> Result<Vec<Instance>, LoadError> {
        let plugin = self.plugin(element)?;
        let mut to_world = plugin.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
        let flip = plugin.boolean("flip_normals")?.unwrap_or(false);
        let mut materials = Vec::new();
        let mut mesh = match element.plugin() {
            kind @ ("obj" | "ply" | "serialized") => {
                let mirrored = to_world.determinant() < 0.0;
                let Some((mesh, named)) = self.mesh_file(&plugin, kind, mirrored)? else { return Ok(Vec::new()) };
                materials = named;
                mesh
            }
            "rectangle" => rectangle(),
            "disk" => disk(64),
            "cube" => cube(),
            "sphere" => {
                self.warn("spheres are drawn as 8064 triangles with smooth normals");
                let center = plugin.vector("center")?.unwrap_or(Vec3::ZERO).as_dvec3();
                let radius = plugin.float("radius")?.unwrap_or(1.0);
                to_world =
                    to_world * DMat4::from_translation(center) * DMat4::from_scale(DVec3::splat(f64::from(radius)));
                sphere(64, 64)
            }
            "cylinder" => {
                self.warn("cylinders are drawn as 256 triangles with smooth normals");
                let p0 = plugin.vector("p0")?.unwrap_or(Vec3::ZERO).as_dvec3();
                let p1 = plugin.vector("p1")?.unwrap_or(Vec3::Z).as_dvec3();
                let radius = f64::from(plugin.float("radius")?.unwrap_or(1.0));
                let Some(axis) = (p1 - p0).try_normalize() else {
                    return Err(element.error("the cylinder's ends are the same point"));
                };
                let (s, t) = axis.any_orthonormal_pair();
                let columns =
                    [(s * radius).extend(0.0), (t * radius).extend(0.0), (p1 - p0).extend(0.0), p0.extend(1.0)];
                to_world *= DMat4::from_cols(columns[0], columns[1], columns[2], columns[3]);
                cylinder(128)
            }
            kind => {
                self.warn(format!("{}: shapes of type `{kind}` are not supported; it is left out", element.title()));
                return Ok(Vec::new());
            }
        };
        if flip {
            turn_inside_out(&mut mesh);
        }
        if let Some(id) = element.attribute("id") {
            id.clone_into(&mut mesh.name);
        }
        self.tessellation(&plugin, &mut mesh)?;
        let world_from_local = affine(element, Some(to_world))?;
        let emitter = plugin.only("emitter")?;
        plugin.ignore(&["silhouette_sampling_weight"]);
        let [bounds_medium, scatters] = ["medium", "subsurface"].map(|tag| !plugin.nested(tag).is_empty());
        // Before version 2 such a border is as the BSDF `null`, and others without a BSDF are grey.
        if element.legacy && bounds_medium && !scatters && emitter.is_none() && plugin.nested("bsdf").is_empty() {
            self.warn(format!(
                "{}: a border of a participating medium alone, which is not supported; it is left out",
                element.title()
            ));
            self.finish(&plugin);
            return Ok(Vec::new());
        }
        if bounds_medium || scatters {
            self.warn(format!("{}: participating media are not supported; only its surface is drawn", element.title()));
        }
        let first = self.scene.meshes.len();
        for (bsdf, mut part) in self.parts(&plugin, mesh, &materials)? {
            self.shape_material(bsdf, emitter, &mut part, &world_from_local)?;
            self.scene.meshes.push(part);
        }
        self.finish(&plugin);
        Ok((first..self.scene.meshes.len()).map(|mesh| Instance { mesh, world_from_local }).collect())
    }

    /// Returns the mesh with its BSDF or, if several BSDFs are named after an OBJ file's materials, the
    /// triangles of each.
    fn parts(
        &mut self,
        plugin: &Plugin<'a>,
        mesh: Mesh,
        materials: &[(String, usize)],
    ) -> Result<Vec<(Option<&'a Element>, Mesh)>, LoadError> {
        let bsdfs = plugin.named("bsdf");
        if bsdfs.len() < 2 || materials.is_empty() {
            return Ok(vec![(plugin.only("bsdf")?, mesh)]);
        }
        let fallback = bsdfs.iter().find(|(name, _)| name.is_none()).or(bsdfs.first()).map(|&(_, bsdf)| bsdf);
        let mut parts: Vec<(Option<&'a Element>, Vec<[u32; 3]>)> = Vec::new();
        for (name, triangles) in obj::parts(&mesh, materials) {
            let bsdf = match bsdfs.iter().find(|(n, _)| *n == Some(name)) {
                Some(&(_, bsdf)) => Some(bsdf),
                None => {
                    self.warn(format!(
                        "`{}`: no bsdf is named after its material `{name}`; the first one is drawn",
                        mesh.name
                    ));
                    fallback
                }
            };
            match parts.iter_mut().find(|(b, _)| b.map(std::ptr::from_ref) == bsdf.map(std::ptr::from_ref)) {
                Some((_, part)) => part.extend(triangles),
                None => parts.push((bsdf, triangles)),
            }
        }
        Ok(parts.into_iter().map(|(bsdf, triangles)| (bsdf, subset(&mesh, &triangles))).collect())
    }

    /// Reads a mesh file; none, with a warning, if it is not there.
    fn mesh_file(&mut self, plugin: &Plugin<'a>, kind: &str, mirrored: bool) -> Result<Option<Named>, LoadError> {
        let element = plugin.element;
        let name = plugin.string("filename")?.ok_or_else(|| element.error(format!("`{kind}` needs a `filename`")))?;
        let path = match self.search.find(element, name) {
            Ok(path) => path,
            Err(error) => {
                self.warn(format!("the mesh file `{name}` is not there: its shapes are left out"));
                self.missing.get_or_insert(error);
                return Ok(None);
            }
        };
        let bytes = self.search.files.read(&path)?;
        let mut materials = Vec::new();
        let (mut mesh, flat) = match kind {
            "obj" => {
                let parsed = obj::parse(&path, &bytes)?;
                parsed.warnings.iter().for_each(|warning| self.warn(format!("`{name}`: {warning}")));
                materials = parsed.materials;
                (at(parsed.origin, parsed.mesh), false)
            }
            "ply" => {
                let parsed = ply::parse(&path, &bytes)?;
                parsed.warnings.iter().for_each(|warning| self.warn(format!("`{name}`: {warning}")));
                (at(parsed.origin, parsed.mesh), false)
            }
            _ => {
                let index = plugin.integer("shape_index")?.unwrap_or(0);
                let index = usize::try_from(index).map_err(|_| element.error("shape_index is negative"))?;
                serialized::parse(&path, &bytes, index)?
            }
        };
        if mesh.triangles.is_empty() {
            self.warn(format!("`{name}` has no triangles"));
        }
        // OBJ files have v up by default; the other formats have Mitsuba's own v.
        if plugin.boolean("flip_tex_coords")?.unwrap_or(kind == "obj") {
            for uv in &mut mesh.uvs[0] {
                uv.y = 1.0 - uv.y;
            }
        }
        if plugin.float("max_smooth_angle")?.is_some() {
            self.warn("max_smooth_angle is ignored; normals are taken as the file has them");
        }
        plugin.ignore(&["collapse", "srgb", "load_materials"]);
        let face_normals = plugin.boolean("face_normals")?.unwrap_or(flat);
        if face_normals {
            mesh.normals.clear();
        }
        face_along_normals(&mut mesh);
        if mesh.normals.is_empty() {
            if mirrored {
                mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            }
            if !face_normals {
                mesh.normals = smooth_normals(&mesh.positions, &mesh.triangles);
            }
        }
        if mesh.name.is_empty() {
            name.clone_into(&mut mesh.name);
        }
        Ok(Some((mesh, materials)))
    }

    /// Sets the mesh's material and, if that has a normal map, its tangents.
    fn shape_material(
        &mut self,
        bsdf: Option<&'a Element>,
        emitter: Option<&'a Element>,
        mesh: &mut Mesh,
        to_world: &Affine3A,
    ) -> Result<(), LoadError> {
        let key = [bsdf, emitter].map(|e| e.map(std::ptr::from_ref));
        if !self.materials.contains_key(&key) {
            self.has_vertex_colors = false;
            let mut surface = match bsdf {
                Some(bsdf) => self.surface(bsdf)?,
                None => default_surface(emitter.is_some()),
            };
            if let Some(emitter) = emitter {
                surface.material.emission = self.emission(emitter)?;
            }
            let ready = if surface.bump {
                ShapeMaterial::Bumped(Box::new(surface))
            } else {
                self.scene.materials.push(surface.material);
                let index = self.scene.materials.len() - 1;
                if self.has_vertex_colors {
                    self.vertex_colored.insert(index);
                }
                ShapeMaterial::Ready(index, surface.basis)
            };
            self.materials.insert(key, ready);
        }
        let basis = match self.materials[&key].clone() {
            ShapeMaterial::Ready(index, basis) => {
                mesh.material = index;
                basis
            }
            ShapeMaterial::Bumped(surface) => {
                let Surface { mut material, basis, .. } = *surface;
                let metres = metres_per_uv(mesh, to_world);
                let scaled = |map: NormalMap| Some(NormalMap { scale: map.scale / metres?, ..map });
                material.change_plain(&mut |part| part.normal_map = part.normal_map.and_then(scaled));
                self.scene.materials.push(material);
                mesh.material = self.scene.materials.len() - 1;
                basis
            }
        };
        if let Some(emitter) = emitter {
            let name = emitter.attribute("id").unwrap_or(&mesh.name).to_owned();
            self.scene.light_groups.materials.entry(mesh.material).or_insert(name);
        }
        if basis.is_some() && mesh.uvs[0].is_empty() {
            self.warn(format!("`{}` has no texture coordinates, so its normal or bump map is not drawn", mesh.name));
        }
        let map = self.scene.materials[mesh.material].plain().into_iter().find_map(|part| part.normal_map);
        if let (Some(basis), Some(map)) = (basis, map) {
            match basis {
                NormalMapBasis::ImageUp => _ = tangents::generate(mesh, 0, map.texture.transform),
                NormalMapBasis::RightHanded => {
                    tangents::generate(mesh, 0, Affine2::IDENTITY);
                    mesh.tangents.iter_mut().for_each(|t| t.w = 1.0);
                }
            }
        }
        Ok(())
    }
}

/// Returns Mitsuba's default for a shape without BSDF.
fn default_surface(emitter: bool) -> Surface {
    let reflectance = Color::from(Vec3::splat(if emitter { 0.0 } else { 0.5 }));
    let bsdf = Bsdf::Diffuse { reflectance };
    let name = if emitter { "light" } else { "default" }.to_owned();
    let material = Material { bsdf, sides: Sides::One, ..Material::diffuse(name, Vec3::ONE) };
    Surface { material, basis: None, bump: false }
}

fn affine(element: &Element, to_world: Option<DMat4>) -> Result<Affine3A, LoadError> {
    let m = to_world.unwrap_or(DMat4::IDENTITY);
    let [x, y, z, w] = [m.x_axis, m.y_axis, m.z_axis, m.w_axis].map(|c| c.truncate().as_vec3a());
    let affine = Affine3A { matrix3: Mat3A::from_cols(x, y, z), translation: w };
    if affine.is_finite() { Ok(affine) } else { Err(element.error("to_world overflows")) }
}

fn turn_inside_out(mesh: &mut Mesh) {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
}

/// Returns the metres per unit of uv: the square root of the ratio of the areas.
fn metres_per_uv(mesh: &Mesh, to_world: &Affine3A) -> Option<f32> {
    let uvs = &mesh.uvs[0];
    if uvs.is_empty() {
        return None;
    }
    let (mut metres, mut uv) = (0.0_f64, 0.0_f64);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|i| i as usize);
        let edge = |i: usize| to_world.transform_vector3(mesh.positions[i] - mesh.positions[a]);
        metres += f64::from(edge(b).cross(edge(c)).length());
        uv += f64::from((uvs[b] - uvs[a]).perp_dot(uvs[c] - uvs[a]).abs());
    }
    (metres > 0.0 && uv > 0.0).then(|| (metres / uv).sqrt() as f32)
}
