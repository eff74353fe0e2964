//! Material files of OBJ meshes, by `tobj`. They describe Phong's model, and some the parameters of a later one (`Pr`, `Pm`).

use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

use glam::{Affine2, Vec3};

use super::{GREY, plain};
use crate::scene::load::files::Files;
use crate::scene::{
    Boundary, Bsdf, Color, Emission, Filter, Image, LoadError, Material, Opacity, Scalar, Scene, Sides, Texture,
    TextureRef, Wrap,
};

/// Reflectance up to which a surface that mirrors has no base.
const DARK: f32 = 0.1;
/// Phong exponent from which a highlight is a mirror's.
const MIRROR: f32 = 1000.0;

/// The materials of an OBJ file, of which those in use are in the scene.
#[derive(Default)]
pub(super) struct Library {
    materials: HashMap<String, tobj::Material>,
    places: HashMap<String, usize>,
    images: HashMap<String, Option<usize>>,
    folder: std::path::PathBuf,
}

impl Library {
    /// Reads a material file beside a mesh file. One that is not there, or malformed, is a warning.
    pub fn read(&mut self, mesh: &Path, name: &str, files: &dyn Files, scene: &mut Scene) -> Result<(), LoadError> {
        self.folder = mesh.parent().unwrap_or(Path::new("")).to_owned();
        let path = self.folder.join(name.replace('\\', "/"));
        if !files.has(&path) {
            scene.warn(format!("the material file `{name}` does not exist beside the mesh: its surfaces are grey"));
            return Ok(());
        }
        let bytes = files.read(&path)?;
        match tobj::load_mtl_buf(&mut Cursor::new(&bytes[..])) {
            Ok((materials, _)) => self.materials.extend(materials.into_iter().map(|m| (m.name.clone(), m))),
            Err(error) => {
                scene.warn(format!("the material file `{name}` is malformed ({error}): its surfaces are grey"))
            }
        }
        Ok(())
    }

    /// Returns the index of a material, which is added to the scene when it is first asked for.
    pub fn material(&mut self, name: &str, files: &dyn Files, scene: &mut Scene) -> usize {
        if let Some(&place) = self.places.get(name) {
            return place;
        }
        let material = match self.materials.remove(name) {
            Some(material) => self.convert(&material, files, scene),
            None => plain(name, Vec3::splat(GREY)),
        };
        scene.materials.push(material);
        self.places.insert(name.to_owned(), scene.materials.len() - 1);
        scene.materials.len() - 1
    }

    fn convert(&mut self, m: &tobj::Material, files: &dyn Files, scene: &mut Scene) -> Material {
        let numbers = |name: &str| -> Vec<f32> {
            let words = m.unknown_param.get(name).map(|text| text.split_whitespace());
            words.into_iter().flatten().map_while(|word| word.parse().ok()).filter(|v: &f32| v.is_finite()).collect()
        };
        let number = |name: &str| numbers(name).first().copied();
        let triple = |name: &str| match numbers(name)[..] {
            [r, g, b, ..] => Some(Vec3::new(r, g, b)),
            [v] => Some(Vec3::splat(v)),
            _ => None,
        };
        let share = |value: Option<[f32; 3]>, missing: f32| {
            let value = value.map_or(Vec3::splat(missing), Vec3::from);
            if value.is_finite() { value.clamp(Vec3::ZERO, Vec3::ONE) } else { Vec3::splat(missing) }
        };
        let illumination = m.illumination_model.unwrap_or(2);
        let (diffuse, specular) = (share(m.diffuse, GREY), share(m.specular, 0.0));
        let diffuse_map = self.texture(m.diffuse_texture.as_deref(), true, files, scene);
        // A colour of black beside a texture stands for none.
        let factor = if diffuse_map.is_some() && diffuse == Vec3::ZERO { Vec3::ONE } else { diffuse };
        let base_color = Color { factor, texture: diffuse_map };
        let exponent = m.shininess.filter(|n| n.is_finite()).unwrap_or(0.0).max(0.0);
        // Beckmann facets of alpha^2 = 2 / (n + 2) are nearly as cos^n (Walter et al. 2007, section 5.4); alpha is the
        // square of the roughness.
        let phong = if exponent >= MIRROR { 0.0 } else { (2.0 / (exponent + 2.0)).powf(0.25) };
        let roughness = number("Pr").map_or(phong, |r| r.clamp(0.0, 1.0));
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
                eta: m.optical_density.filter(|n| n.is_finite() && *n >= 1.0).unwrap_or(1.5),
                reflection: Vec3::ONE.into(),
                transmission: triple("Tf").unwrap_or(Vec3::ONE).clamp(Vec3::ZERO, Vec3::ONE).into(),
            }
        } else if let Some(metallic) = number("Pm") {
            metal(base_color, metallic.clamp(0.0, 1.0), roughness)
        } else if mirrors {
            metal(specular.into(), 1.0, roughness)
        } else if specular.max_element() > 0.0 && illumination >= 2 || number("Pr").is_some() {
            metal(base_color, 0.0, roughness)
        } else {
            Bsdf::Diffuse { reflectance: base_color }
        };
        let alpha = m.dissolve.or_else(|| number("Tr").map(|t| 1.0 - t)).filter(|d| d.is_finite()).unwrap_or(1.0);
        let holes = self.texture(m.dissolve_texture.as_deref(), false, files, scene).map(|texture| (texture, 0));
        // Files give glass an alpha, too.
        let blended = !refracts && (alpha < 1.0 || holes.is_some());
        let value = Scalar {
            factor: if alpha <= 0.0 && holes.is_some() { 1.0 } else { alpha.clamp(0.0, 1.0) },
            texture: holes,
        };
        let glow = m.emissive.map(Vec3::from).filter(|glow| glow.is_finite() && glow.max_element() > 0.0);
        let glow_map = m.unknown_param.get("map_Ke").map(String::as_str).filter(|_| glow.is_some());
        let glow_map = self.texture(glow_map, true, files, scene);
        let emission = glow.map(|glow| Emission {
            radiance: Color { factor: glow.max(Vec3::ZERO), texture: glow_map },
            two_sided: true,
        });
        if m.normal_texture.is_some() {
            scene.warn("bump and normal maps of material files are not read: such surfaces are smooth");
        }
        Material {
            bsdf,
            opacity: blended.then_some(Opacity::Blended { value }),
            emission,
            boundary: if refracts { Boundary::Volume { absorption: Vec3::ZERO } } else { Boundary::Sheet },
            sides: if refracts { Sides::One } else { Sides::Two },
            ..plain(&m.name, Vec3::ONE)
        }
    }

    /// Returns an image as a texture; none, with a warning, if it is not there or not an image.
    fn texture(&mut self, text: Option<&str>, srgb: bool, files: &dyn Files, scene: &mut Scene) -> Option<TextureRef> {
        // Options come before the name, which may have blanks if there are none.
        let text = text?.trim();
        let name = if text.starts_with('-') { text.split_whitespace().last()? } else { text }.replace('\\', "/");
        let image = *self.images.entry(name.clone()).or_insert_with(|| {
            let path = self.folder.join(&name);
            let decoded = files.read(&path).map_err(|e| e.cause).and_then(|bytes| Image::decode(&bytes, &name));
            match decoded {
                Ok(image) => {
                    scene.images.push(image);
                    Some(scene.images.len() - 1)
                }
                Err(cause) => {
                    scene.warn(format!("the texture `{name}` is left out: {cause}"));
                    None
                }
            }
        });
        scene.textures.push(Texture { image: image?, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb });
        Some(TextureRef { texture: scene.textures.len() - 1, uv_set: 0, transform: Affine2::IDENTITY })
    }
}
