//! Material files of OBJ meshes. They describe Phong's model, and some the parameters of a later one (`Pr`, `Pm`).
//!
//! This is not a crate's parser: `tobj` 4.0.5 panics where a colour has less than three numbers.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::Vec3;

use super::obj::statement;
use super::{add_image, in_utf8, plain, texture_of};
use crate::scene::load::files::{Files, find};
use crate::scene::{Boundary, Bsdf, Color, Emission, LoadError, Material, Opacity, Scalar, Scene, Sides, TextureRef};

/// Reflectance up to which a surface that mirrors has no base.
const DARK: f32 = 0.1;
/// Phong exponent from which a highlight is a mirror's.
const MIRROR: f32 = 1000.0;

/// The materials of an OBJ file that are not in the scene yet.
#[derive(Default)]
pub(super) struct Library {
    /// Reflectance of surfaces whose file says nothing of it.
    plain: Vec3,
    materials: HashMap<String, Statements>,
    images: HashMap<String, Option<usize>>,
    folder: PathBuf,
}

/// The statements of a material: what follows each keyword, which is in lower case.
#[derive(Default)]
struct Statements(HashMap<String, String>);

impl Statements {
    fn text(&self, keyword: &str) -> Option<&str> {
        self.0.get(keyword).map(String::as_str).filter(|text| !text.is_empty())
    }

    /// Returns the numbers at the beginning; those that are not finite end them.
    fn numbers(&self, keyword: &str) -> Vec<f32> {
        let words = self.text(keyword).unwrap_or_default().split_whitespace();
        words.map_while(|word| word.parse().ok()).take_while(|v: &f32| v.is_finite()).collect()
    }

    fn number(&self, keyword: &str) -> Option<f32> {
        self.numbers(keyword).first().copied()
    }

    fn color(&self, keyword: &str) -> Option<Vec3> {
        match self.numbers(keyword)[..] {
            [r, g, b, ..] => Some(Vec3::new(r, g, b).max(Vec3::ZERO)),
            [v, ..] => Some(Vec3::splat(v.max(0.0))),
            [] => None,
        }
    }
}

impl Library {
    pub fn new(plain: Vec3) -> Self {
        Self { plain, ..Self::default() }
    }

    /// Reads a material file beside a mesh file. One that is not there is a warning.
    pub fn read(&mut self, mesh: &Path, name: &str, files: &dyn Files, scene: &mut Scene) -> Result<(), LoadError> {
        self.folder = mesh.parent().unwrap_or(Path::new("")).to_owned();
        let Some(path) = find(files, &[&self.folder], name) else {
            scene.warn(format!("the material file `{name}` does not exist beside the mesh: its surfaces are grey"));
            return Ok(());
        };
        let bytes = in_utf8(files.read(&path)?);
        let mut name = None;
        for line in bytes.split(|&b| b == b'\n') {
            let line = statement(line);
            let line = line.trim();
            let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            match (keyword.to_ascii_lowercase().as_str(), &name) {
                ("newmtl", _) => {
                    let new = rest.split_whitespace().collect::<Vec<_>>().join(" ");
                    self.materials.insert(new.clone(), Statements::default());
                    name = Some(new);
                }
                (keyword, Some(name)) => {
                    let statements = self.materials.entry(name.clone()).or_default();
                    statements.0.insert(keyword.to_owned(), rest.trim().to_owned());
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Adds a material to the scene and returns its index. Each is asked for once.
    pub fn material(&mut self, name: &str, files: &dyn Files, scene: &mut Scene) -> usize {
        let material = match self.materials.remove(name) {
            Some(statements) => self.convert(name, &statements, files, scene),
            None => plain(name, self.plain),
        };
        scene.materials.push(material);
        scene.materials.len() - 1
    }

    fn convert(&mut self, name: &str, m: &Statements, files: &dyn Files, scene: &mut Scene) -> Material {
        let share = |keyword: &str, missing: f32| m.color(keyword).unwrap_or(Vec3::splat(missing)).min(Vec3::ONE);
        let illumination = m.number("illum").map_or(2, |n| n as u32);
        let diffuse = m.color("kd").unwrap_or(self.plain).min(Vec3::ONE);
        let specular = share("ks", 0.0);
        let diffuse_map = self.texture(m.text("map_kd"), true, files, scene);
        // A colour of black beside a texture stands for none.
        let factor = if diffuse_map.is_some() && diffuse == Vec3::ZERO { Vec3::ONE } else { diffuse };
        let base_color = Color { factor, texture: diffuse_map };
        let exponent = m.number("ns").unwrap_or(0.0).max(0.0);
        // Beckmann facets of alpha^2 = 2 / (n + 2) are nearly as cos^n (Walter et al. 2007, section 5.4); alpha is the
        // square of the roughness.
        let phong = if exponent >= MIRROR { 0.0 } else { (2.0 / (exponent + 2.0)).powf(0.25) };
        let roughness = m.number("pr").map_or(phong, |r| r.clamp(0.0, 1.0));
        let metal = |base_color: Color, metallic: f32, roughness: f32| Bsdf::MetallicRoughness {
            base_color,
            metallic: metallic.into(),
            roughness: roughness.into(),
            ior: 1.5,
            specular: 1.0.into(),
            specular_color: Vec3::ONE.into(),
            transmission: 0.0.into(),
        };
        let mirrors =
            matches!(illumination, 3 | 5 | 8) && diffuse.max_element() <= DARK && specular.max_element() > DARK;
        let refracts = matches!(illumination, 6 | 7);
        let bsdf = if refracts {
            Bsdf::Dielectric {
                alpha: 0.0.into(),
                eta: m.number("ni").filter(|n| *n >= 1.0).unwrap_or(1.5),
                reflection: Vec3::ONE.into(),
                transmission: share("tf", 1.0).into(),
            }
        } else if let Some(metallic) = m.number("pm") {
            metal(base_color, metallic.clamp(0.0, 1.0), roughness)
        } else if mirrors {
            metal(specular.into(), 1.0, roughness)
        } else if specular.max_element() > 0.0 && illumination >= 2 || m.number("pr").is_some() {
            metal(base_color, 0.0, roughness)
        } else {
            Bsdf::Diffuse { reflectance: base_color }
        };
        let alpha = m.number("d").or_else(|| m.number("tr").map(|t| 1.0 - t)).unwrap_or(1.0);
        let holes = self.texture(m.text("map_d"), false, files, scene).map(|texture| (texture, 0));
        // Files give glass an alpha, too.
        let blended = !refracts && (alpha < 1.0 || holes.is_some());
        let value = Scalar {
            factor: if alpha <= 0.0 && holes.is_some() { 1.0 } else { alpha.clamp(0.0, 1.0) },
            texture: holes,
        };
        let glow = m.color("ke").filter(|&glow| glow != Vec3::ZERO);
        let glow_map = m.text("map_ke").filter(|_| glow.is_some());
        let glow_map = self.texture(glow_map, true, files, scene);
        let emission =
            glow.map(|glow| Emission { radiance: Color { factor: glow, texture: glow_map }, two_sided: true });
        if ["bump", "map_bump", "norm"].iter().any(|keyword| m.text(keyword).is_some()) {
            scene.warn("bump and normal maps of material files are not read: such surfaces are smooth");
        }
        Material {
            bsdf,
            opacity: blended.then_some(Opacity::Blended { value }),
            emission,
            boundary: if refracts { Boundary::Volume { absorption: Vec3::ZERO } } else { Boundary::Sheet },
            sides: if refracts { Sides::One } else { Sides::Two },
            ..plain(name, Vec3::ONE)
        }
    }

    /// Returns an image as a texture; none, with a warning, if it is not there or not an image.
    fn texture(&mut self, text: Option<&str>, srgb: bool, files: &dyn Files, scene: &mut Scene) -> Option<TextureRef> {
        // Options come before the name, which may have blanks if there are none.
        let text = text?.trim();
        let name = if text.starts_with('-') { text.split_whitespace().last()? } else { text };
        let folder = &self.folder;
        let image = *self.images.entry(name.to_owned()).or_insert_with(|| add_image(name, folder, files, scene));
        Some(texture_of(image?, srgb, scene))
    }
}
