//! BSDFs: conversion of Mitsuba's plugins to the data model, with substitutes for unsupported ones.
//!
//! A plain BSDF reflects on its front only (`Sides::One`). `twosided` around it makes both sides reflect;
//! `mask`, `bumpmap` and `normalmap` add an alpha test or a normal map. Dielectrics are the same with or
//! without `twosided`; `null` is cut out by an alpha test, so that light passes.

use glam::Vec3;

use super::Loader;
use super::spectra::Use;
use super::values::Plugin;
use super::xml::Element;
use super::{metals, textures};
use crate::scene::{
    Anisotropy, Boundary, Bsdf, Coat, Color, DiffuseTransmission, Distribution, Fresnel, Image, LoadError, Material,
    NormalMap, Opacity, Scalar, Sides, Texture, TextureRef,
};

/// Maximum nesting depth of BSDFs.
const MAX_NESTING: usize = 16;

/// The Y axis of a normal map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NormalMapBasis {
    /// Y is normal x tangent for any mapping of the mesh, as in Mitsuba.
    RightHanded,
    /// Y points up the image.
    ImageUp,
}

/// A material before its assignment to a mesh.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub material: Material,
    /// Axes of the normal map, if there is one.
    pub basis: Option<NormalMapBasis>,
    /// True for a bump map: its slopes are per unit of uv, so its scale has to be divided by the metres per
    /// unit of uv.
    pub bump: bool,
}

impl<'a> Loader<'a> {
    /// Converts a `bsdf` element.
    pub(super) fn surface(&mut self, element: &'a Element) -> Result<Surface, LoadError> {
        self.surface_at(element, 0)
    }

    pub(super) fn surface_at(&mut self, element: &'a Element, depth: usize) -> Result<Surface, LoadError> {
        if depth > MAX_NESTING {
            return Err(element.error("bsdfs are nested too deep; does one contain itself?"));
        }
        let plugin = self.plugin(element)?;
        let kind = element.plugin();
        let mut surface = match kind {
            "twosided" | "mask" | "bumpmap" | "normalmap" | "coating" | "roughcoating" => {
                self.wrapper(&plugin, kind, depth)?
            }
            "blendbsdf" => self.blend(&plugin, depth)?,
            "mixturebsdf" => self.mixture(&plugin, depth)?,
            _ => {
                let name = element.attribute("id").unwrap_or(kind).to_owned();
                let material = match kind {
                    "principled" | "principledthin" => self.principled(&plugin, kind == "principledthin")?,
                    "difftrans" => self.diffuse_transmitter(&plugin)?,
                    _ => {
                        let plain = Material::diffuse("", Vec3::ONE);
                        let bsdf = self.plain(&plugin, kind)?;
                        let distribution = self.distribution(&plugin)?;
                        let opacity = self.passed(&plugin, kind, &bsdf)?;
                        let boundary = if kind == "thindielectric" { Boundary::Sheet } else { plain.boundary };
                        let anisotropy = self.anisotropy(&plugin)?;
                        Material { bsdf, distribution, anisotropy, opacity, boundary, sides: Sides::One, ..plain }
                    }
                };
                Surface { material: Material { name, ..material }, basis: None, bump: false }
            }
        };
        self.finish(&plugin);
        if let Some(id) = element.attribute("id") {
            id.clone_into(&mut surface.material.name);
        }
        Ok(surface)
    }

    /// Converts a BSDF that contains another one.
    fn wrapper(&mut self, plugin: &Plugin<'a>, kind: &str, depth: usize) -> Result<Surface, LoadError> {
        let element = plugin.element;
        let nested = plugin.nested("bsdf");
        let Some(&first) = nested.first() else {
            return Err(element.error(format!("`{kind}` needs a bsdf inside")));
        };
        match kind {
            "twosided" if nested.len() > 1 => {
                self.warn(format!("{}: both sides are drawn with the front's bsdf", element.title()));
            }
            _ if nested.len() > 1 => return Err(element.error(format!("`{kind}` has more than one bsdf inside"))),
            _ => {}
        }
        let mut surface = self.surface_at(first, depth + 1)?;
        match kind {
            "twosided" => {
                surface.material.sides = Sides::Two;
                surface.material.change_plain(&mut |part| part.sides = Sides::Two);
            }
            "mask" => self.mask(plugin, &mut surface)?,
            "normalmap" => self.normal_map(plugin, &mut surface)?,
            "bumpmap" => self.bump_map(plugin, &mut surface)?,
            "coating" | "roughcoating" => {
                let alpha = if kind == "coating" { 0.0.into() } else { self.alpha(plugin)? };
                let coat = Some(self.coat(plugin, alpha)?);
                surface.material.change_plain(&mut |part| part.coat = coat);
            }
            _ => {}
        }
        Ok(surface)
    }

    /// Converts a coating, which reflects as a coat of its index does and neither bends nor absorbs light.
    fn coat(&mut self, plugin: &Plugin<'a>, alpha: Scalar) -> Result<Coat, LoadError> {
        plugin.ignore(&["thickness", "sigma_a", "specular_reflectance"]);
        if plugin.string("distribution")? != Some("ggx") && alpha.factor > 0.0 {
            self.warn("coatings have GGX facets of the same width");
        }
        let eta = self.index(plugin, "int_ior", 1.5046)? / self.index(plugin, "ext_ior", 1.000_277)?;
        self.warn(format!(
            "{}: the coating is drawn as a clear layer that does not bend light",
            plugin.element.title()
        ));
        let normal_incidence = ((eta - 1.0) / (eta + 1.0)).powi(2);
        Ok(Coat {
            weight: (normal_incidence / Coat::F0).min(1.0).into(),
            roughness: alpha.factor.sqrt().into(),
            normal_map: None,
        })
    }

    fn mask(&mut self, plugin: &Plugin<'a>, surface: &mut Surface) -> Result<(), LoadError> {
        let value = self.opacity(plugin)?;
        let value = match surface.material.opacity {
            None => value,
            Some(Opacity::Blended { value: inner }) => match product(inner, value) {
                Some(product) => product,
                None => {
                    let title = plugin.element.title();
                    self.warn(format!("{title}: of textured masks in each other only the innermost counts"));
                    inner
                }
            },
            // Nothing of a `null` is there to be masked.
            Some(Opacity::CutOut { .. }) => return Ok(()),
        };
        surface.material.opacity = Some(Opacity::Blended { value });
        Ok(())
    }

    fn normal_map(&mut self, plugin: &Plugin<'a>, surface: &mut Surface) -> Result<(), LoadError> {
        plugin.ignore(&["flip_invalid_normals", "use_shadowing_function"]);
        let element = match plugin.get("normalmap") {
            Some(element) => element,
            None => {
                *plugin.nested("texture").first().ok_or_else(|| plugin.element.error("a normalmap needs a texture"))?
            }
        };
        let color = self.color_texture(element, Use::Unbounded)?;
        if let Some(texture) = color.texture {
            let sampler = &self.scene.textures[texture.texture];
            if sampler.srgb {
                self.warn(format!(
                    "{}: the texture is read as raw numbers, as a normal map has to be",
                    plugin.element.title()
                ));
            }
            let sampler = Texture { srgb: false, ..self.scene.textures[texture.texture].clone() };
            self.scene.textures.push(sampler);
            let texture = TextureRef { texture: self.scene.textures.len() - 1, ..texture };
            let map = Some(NormalMap { texture, scale: 1.0 });
            surface.material.change_plain(&mut |part| part.normal_map = map);
            surface.basis = Some(NormalMapBasis::RightHanded);
            surface.bump = false;
        }
        Ok(())
    }

    /// Bakes a height field into a normal map of its slopes per unit of uv.
    fn bump_map(&mut self, plugin: &Plugin<'a>, surface: &mut Surface) -> Result<(), LoadError> {
        plugin.ignore(&["flip_invalid_normals", "use_shadowing_function"]);
        let texture =
            *plugin.nested("texture").first().ok_or_else(|| plugin.element.error("a bumpmap needs a texture"))?;
        let scale = plugin.float("scale")?.unwrap_or(1.0);
        let Some(heights) = self.heights(texture)? else { return Ok(()) };
        let (image, steepest) = slopes(&heights);
        if steepest == 0.0 {
            return Ok(());
        }
        self.scene.images.push(image);
        let sampler = Texture {
            image: self.scene.images.len() - 1,
            wrap: heights.wrap,
            filter: crate::scene::Filter::Linear,
            srgb: false,
        };
        self.scene.textures.push(sampler);
        let texture = TextureRef { texture: self.scene.textures.len() - 1, uv_set: 0, transform: heights.transform };
        // The factor converts units of the surface's uv to units of the image's uv.
        let per_uv = heights.transform.matrix2.determinant().abs().sqrt();
        let map = Some(NormalMap { texture, scale: steepest * scale * per_uv });
        surface.material.change_plain(&mut |part| part.normal_map = map);
        surface.basis = Some(NormalMapBasis::ImageUp);
        surface.bump = true;
        self.warn("bump maps are drawn as normal maps, with one scale for each mesh");
        Ok(())
    }

    /// Converts a BSDF that contains no other.
    fn plain(&mut self, plugin: &Plugin<'a>, kind: &str) -> Result<Bsdf, LoadError> {
        match kind {
            "diffuse" | "roughdiffuse" | "lambertian" => {
                if kind == "roughdiffuse" {
                    plugin.ignore(&["alpha", "use_fast_approx"]);
                    self.warn(format!("{}: `{kind}` is drawn as diffuse", plugin.element.title()));
                }
                let color = match self.color_parameter(plugin, "reflectance")? {
                    Some(color) => Some(color),
                    None => self.color_parameter(plugin, "diffuse_reflectance")?,
                };
                Ok(Bsdf::Diffuse { reflectance: color.unwrap_or(grey(0.5)) })
            }
            "conductor" | "roughconductor" => self.conductor(plugin, kind == "roughconductor"),
            "plastic" | "roughplastic" => self.plastic(plugin, kind == "roughplastic"),
            "phong" => {
                // Beckmann facets of alpha^2 = 2 / (n + 2) are nearly as cos^n (Walter et al. 2007, section 5.4).
                let exponent = plugin.float("exponent")?.unwrap_or(30.0).max(0.0);
                self.highlights(plugin, (2.0 / (exponent + 2.0)).sqrt())
            }
            "ward" => {
                plugin.ignore(&["variant"]);
                let alpha = self.alpha(plugin)?.factor;
                self.highlights(plugin, alpha)
            }
            "dielectric" | "thindielectric" => self.dielectric(plugin, 0.0.into()),
            "roughdielectric" => {
                let alpha = self.alpha(plugin)?;
                self.dielectric(plugin, alpha)
            }
            "pplastic" => {
                self.warn(format!("{}: `pplastic` is drawn as rough plastic", plugin.element.title()));
                self.plastic(plugin, true)
            }
            "null" | "polarizer" | "circular" | "retarder" => Ok(Bsdf::Diffuse { reflectance: grey(0.0) }),
            _ => {
                self.warn(format!(
                    "{}: bsdfs of type `{kind}` are not supported; grey 0.5 is drawn instead",
                    plugin.element.title()
                ));
                Ok(Bsdf::Diffuse { reflectance: grey(0.5) })
            }
        }
    }

    /// Converts Mitsuba 0.5's models without Fresnel's equations to a dielectric whose reflectance at normal incidence is
    /// the lobe's.
    fn highlights(&mut self, plugin: &Plugin<'a>, alpha: f32) -> Result<Bsdf, LoadError> {
        let kind = plugin.element.plugin();
        self.warn(format!(
            "{}: `{kind}` is drawn with facets of like width and Fresnel's equations",
            plugin.element.title()
        ));
        let diffuse = self.color_parameter(plugin, "diffuse_reflectance")?.unwrap_or(grey(0.5));
        let specular_color = self.color_parameter(plugin, "specular_reflectance")?.unwrap_or(grey(0.2));
        // The dielectric's base has what the facets let in; there both parts add up, to at most 1. Textures stay as they are.
        let most = specular_color.texture.map_or(specular_color.factor.max_element(), |_| 0.0);
        let let_in = (1.0 - most).max(f32::MIN_POSITIVE);
        let base_color = Color { factor: (diffuse.factor / let_in).min(Vec3::ONE), ..diffuse };
        Ok(Bsdf::highlighted(base_color, specular_color, alpha.sqrt().into()))
    }

    /// Returns the opacity of BSDFs that light passes unbent. Polarizing filters pass half of light that is not polarized.
    /// Nothing is seen of glass between media of one index.
    fn passed(&mut self, plugin: &Plugin<'a>, kind: &str, bsdf: &Bsdf) -> Result<Option<Opacity>, LoadError> {
        let nothing = Some(Opacity::CutOut { value: 0.0.into(), cutoff: 0.5 });
        let share = match kind {
            "null" => return Ok(nothing),
            "dielectric" | "roughdielectric" | "thindielectric" if matches!(bsdf, Bsdf::Dielectric { eta: 1.0, transmission, .. } if *transmission == grey(1.0)) =>
            {
                return Ok(nothing);
            }
            "polarizer" | "circular" => 0.5,
            "retarder" => 1.0,
            _ => return Ok(None),
        };
        plugin.ignore(&["theta", "delta", "left_handed", "polarizing"]);
        self.warn(format!("{}: light is not polarized here", plugin.element.title()));
        let transmittance = self.scalar_parameter(plugin, "transmittance")?.unwrap_or(1.0.into());
        if transmittance.texture.is_some() {
            self.warn(format!("{}: of its transmittance only the factor counts", plugin.element.title()));
        }
        Ok(Some(Opacity::Blended { value: (1.0 - share * transmittance.factor).into() }))
    }

    /// Converts Mitsuba 0.5's `difftrans`, whose light all passes to the other side.
    fn diffuse_transmitter(&mut self, plugin: &Plugin<'a>) -> Result<Material, LoadError> {
        let color = self.color_parameter(plugin, "transmittance")?.unwrap_or(grey(0.5));
        let bsdf = Bsdf::MetallicRoughness {
            base_color: grey(0.0),
            metallic: 0.0.into(),
            roughness: 1.0.into(),
            ior: 1.0,
            specular: 0.0.into(),
            specular_color: grey(0.0),
            transmission: 0.0.into(),
        };
        let diffuse_transmission = Some(DiffuseTransmission { share: 1.0.into(), color });
        Ok(Material { bsdf, diffuse_transmission, boundary: Boundary::Sheet, ..Material::diffuse("", Vec3::ONE) })
    }

    fn conductor(&mut self, plugin: &Plugin<'a>, rough: bool) -> Result<Bsdf, LoadError> {
        let fresnel = if plugin.get("eta").is_some() || plugin.get("k").is_some() {
            plugin.ignore(&["material"]);
            let outside = self.outside_index(plugin, "ext_eta")?;
            let part = |name: &str, missing: f32| -> Result<Vec3, LoadError> {
                let value = plugin.color(name, Use::Unbounded, &self.search)?;
                Ok(value.unwrap_or(Vec3::splat(missing)).max(Vec3::ZERO) / outside)
            };
            Fresnel::Conductor { eta: part("eta", 0.0)?, k: part("k", 1.0)? }
        } else {
            plugin.ignore(&["ext_eta"]);
            // The default of Mitsuba 3 is a perfect mirror, that of 0.5 is copper.
            let missing = if plugin.element.legacy { "Cu" } else { "none" };
            let name = plugin.string("material")?.unwrap_or(missing);
            match metals::metal(name) {
                Some(fresnel) => fresnel,
                None => {
                    self.warn(format!(
                        "{}: the metal `{name}` is not in the table; chromium is drawn instead",
                        plugin.element.title()
                    ));
                    metals::metal("Cr").unwrap_or(Fresnel::None)
                }
            }
        };
        let alpha = if rough { self.alpha(plugin)? } else { 0.0.into() };
        let specular = self.color_parameter(plugin, "specular_reflectance")?.unwrap_or(grey(1.0));
        Ok(Bsdf::Conductor { alpha, fresnel, specular })
    }

    fn dielectric(&mut self, plugin: &Plugin<'a>, alpha: Scalar) -> Result<Bsdf, LoadError> {
        let inside = self.index(plugin, "int_ior", 1.5046)?;
        let outside = self.index(plugin, "ext_ior", 1.000_277)?;
        Ok(Bsdf::Dielectric {
            alpha,
            eta: inside / outside,
            reflection: self.color_parameter(plugin, "specular_reflectance")?.unwrap_or(grey(1.0)),
            transmission: self.color_parameter(plugin, "specular_transmittance")?.unwrap_or(grey(1.0)),
        })
    }

    fn plastic(&mut self, plugin: &Plugin<'a>, rough: bool) -> Result<Bsdf, LoadError> {
        let inside = self.index(plugin, "int_ior", 1.49)?;
        let outside = self.index(plugin, "ext_ior", 1.000_277)?;
        Ok(Bsdf::Plastic {
            alpha: if rough { self.alpha(plugin)? } else { 0.0.into() },
            diffuse: self.color_parameter(plugin, "diffuse_reflectance")?.unwrap_or(grey(0.5)),
            specular: self.color_parameter(plugin, "specular_reflectance")?.unwrap_or(grey(1.0)),
            eta: inside / outside,
            nonlinear: plugin.boolean("nonlinear")?.unwrap_or(false),
        })
    }

    /// Returns the width of a microfacet lobe; Mitsuba's default is 0.1.
    fn alpha(&mut self, plugin: &Plugin<'a>) -> Result<Scalar, LoadError> {
        plugin.ignore(&["sample_visible"]);
        let [u, v] = [self.scalar_parameter(plugin, "alpha_u")?, self.scalar_parameter(plugin, "alpha_v")?];
        let alpha = match (u, v) {
            // The stretch of the lobe beyond the smaller width is the material's anisotropy.
            (Some(u), Some(v)) if u.texture.is_none() && v.texture.is_none() => Scalar::from(u.factor.min(v.factor)),
            (Some(u), Some(v)) => {
                if u != v {
                    self.warn(
                        "lobes with a texture of alpha_u or alpha_v are drawn isotropic, as wide as the geometric mean",
                    );
                }
                Scalar { factor: (u.factor * v.factor).max(0.0).sqrt(), texture: u.texture.or(v.texture) }
            }
            (Some(one), None) | (None, Some(one)) => one,
            (None, None) => self.scalar_parameter(plugin, "alpha")?.unwrap_or(0.1.into()),
        };
        if alpha.factor < 0.0 || alpha.factor > 1.0 {
            self.warn(format!("{}: alpha {} is taken as the nearest in [0, 1]", plugin.element.title(), alpha.factor));
        }
        Ok(Scalar { factor: alpha.factor.clamp(0.0, 1.0), ..alpha })
    }

    /// Returns the distribution of a BSDF's facets. Mitsuba's default is Beckmann; lobes of `phong` and `ward` are nearly that.
    fn distribution(&mut self, plugin: &Plugin<'a>) -> Result<Distribution, LoadError> {
        match (plugin.element.plugin(), plugin.string("distribution")?) {
            ("phong" | "ward", _)
            | ("roughconductor" | "roughplastic" | "roughdielectric", None | Some("beckmann")) => {
                Ok(Distribution::Beckmann)
            }
            ("roughconductor" | "roughplastic" | "roughdielectric", Some(other)) if other != "ggx" => {
                self.warn(format!("facets of distribution `{other}` are drawn as Beckmann's of the same width"));
                Ok(Distribution::Beckmann)
            }
            _ => Ok(Distribution::Ggx),
        }
    }

    /// Returns the stretch of a lobe whose alpha_u and alpha_v are different numbers.
    fn anisotropy(&mut self, plugin: &Plugin<'a>) -> Result<Option<Anisotropy>, LoadError> {
        let width = |this: &mut Self, name| {
            Ok::<_, LoadError>(this.scalar_parameter(plugin, name)?.filter(|width| width.texture.is_none()))
        };
        let (Some(u), Some(v)) = (width(self, "alpha_u")?, width(self, "alpha_v")?) else { return Ok(None) };
        Ok(Anisotropy::of_widths(u.factor.clamp(0.0, 1.0), v.factor.clamp(0.0, 1.0)))
    }

    /// Returns an index of refraction, given as a number or a name.
    fn index(&mut self, plugin: &Plugin<'a>, name: &str, missing: f32) -> Result<f32, LoadError> {
        let value = match plugin.get(name) {
            None => missing,
            Some(element) if element.tag == "string" => {
                let text = element.required("value")?;
                metals::index_of_refraction(text)
                    .ok_or_else(|| element.error(format!("no material is called `{text}`; give a number")))?
            }
            Some(element) => super::values::number(element)?,
        };
        if value > 0.0 { Ok(value) } else { Err(plugin.element.error(format!("{name} has to be positive"))) }
    }

    fn outside_index(&mut self, plugin: &Plugin<'a>, name: &str) -> Result<f32, LoadError> {
        self.index(plugin, name, 1.0)
    }
}

/// Returns the normal map of a height field, and the steepest slope, by which its xy is divided.
///
/// Slopes are central differences per unit of the image's own uv. A surface at height h has the normal -h_u
/// along u and -h_v along v; v runs down the image and the map's Y runs up, so y is +h_v.
fn slopes(heights: &textures::Heights) -> (Image, f32) {
    let (width, height) = (heights.width as i64, heights.height as i64);
    let wrap = |i: i64, n: i64, mode: crate::scene::Wrap| match mode {
        crate::scene::Wrap::Repeat => i.rem_euclid(n),
        crate::scene::Wrap::Mirror | crate::scene::Wrap::Clamp => i.clamp(0, n - 1),
    };
    let at = |x: i64, y: i64| {
        heights.values[(wrap(y, height, heights.wrap[1]) * width + wrap(x, width, heights.wrap[0])) as usize]
    };
    let slope = |x: i64, y: i64| {
        [-(at(x + 1, y) - at(x - 1, y)) * 0.5 * width as f32, (at(x, y + 1) - at(x, y - 1)) * 0.5 * height as f32]
    };
    let texels = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let steepest = texels().flat_map(|(x, y)| slope(x, y)).fold(0.0_f32, |m, s| m.max(s.abs()));
    let encode = |(x, y): (i64, i64)| {
        let [u, v] = slope(x, y).map(|s| s / steepest.max(f32::MIN_POSITIVE));
        let normal = Vec3::new(u, v, 1.0).normalize();
        let [r, g, b] = (normal * 0.5 + 0.5).to_array().map(|c| (c * 255.0).round() as u8);
        [r, g, b, 255]
    };
    let texels = texels().map(encode).collect();
    (
        Image { name: format!("{}, slopes", heights.name), width: heights.width, height: heights.height, texels },
        steepest,
    )
}

/// Returns the product of two opacities, which are clamped to [0, 1] each; none if one texture cannot hold it.
fn product(a: Scalar, b: Scalar) -> Option<Scalar> {
    let (number, other) = if a.texture.is_none() { (a, b) } else { (b, a) };
    if number.texture.is_some() || (other.texture.is_some() && other.factor > 1.0) {
        return None;
    }
    Some(Scalar { factor: number.factor.clamp(0.0, 1.0) * other.factor.clamp(0.0, 1.0), ..other })
}

fn grey(value: f32) -> Color {
    Color::from(Vec3::splat(value))
}
