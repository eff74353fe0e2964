//! Textures: bitmaps, checkerboards baked to four texels, and 0.5's `scale` around them.
//!
//! Row 0 of an image is at v = 0 both in Mitsuba and here, so coordinates are unchanged; meshes whose file
//! has v up (OBJ) are flipped on reading.

use glam::{Affine2, DMat4, Mat2, Vec2, Vec3};

use super::Loader;
use super::spectra::Use;
use super::values::Plugin;
use super::xml::Element;
use crate::scene::model::texture::linear_from_srgb;
use crate::scene::{Color, EnvironmentMap, Filter, Image, LoadError, Scalar, Texture, TextureRef, Wrap};

/// Maximum nesting depth of textures in `scale`.
const MAX_NESTING: usize = 16;

impl<'a> Loader<'a> {
    /// Returns a parameter that is a colour or a texture.
    pub(super) fn color_parameter(&mut self, plugin: &Plugin<'a>, name: &str) -> Result<Option<Color>, LoadError> {
        match plugin.get(name) {
            None => Ok(None),
            Some(element) if is_texture(element) => self.color_texture(element, Use::Reflectance).map(Some),
            Some(_) => Ok(plugin.color(name, Use::Reflectance, &self.search)?.map(Color::from)),
        }
    }

    /// Returns a parameter that is a number or a texture.
    pub(super) fn scalar_parameter(&mut self, plugin: &Plugin<'a>, name: &str) -> Result<Option<Scalar>, LoadError> {
        match plugin.get(name) {
            None => Ok(None),
            Some(element) if is_texture(element) => self.scalar_texture(element).map(Some),
            Some(element) if matches!(element.tag.as_str(), "rgb" | "srgb" | "spectrum") => {
                Ok(plugin.color(name, Use::Unbounded, &self.search)?.map(|c| Scalar::from(luminance(c.to_array()))))
            }
            Some(_) => Ok(plugin.float(name)?.map(Scalar::from)),
        }
    }

    /// Converts a texture to a colour.
    pub(super) fn color_texture(&mut self, element: &'a Element, use_: Use) -> Result<Color, LoadError> {
        self.color_texture_at(element, use_, 0)
    }

    fn color_texture_at(&mut self, element: &'a Element, use_: Use, depth: usize) -> Result<Color, LoadError> {
        if depth > MAX_NESTING {
            return Err(element.error("textures are nested too deep; does one contain itself?"));
        }
        let plugin = self.plugin(element)?;
        let color = match element.plugin() {
            "bitmap" => {
                let Some(image) = self.bitmap_image(&plugin)? else { return Ok(Color::from(Vec3::splat(0.5))) };
                let srgb = !self.is_raw(&plugin)?;
                let texture = self.sampled(&plugin, image, srgb)?;
                plugin.ignore(&["channel"]);
                Color { factor: Vec3::ONE, texture: Some(texture) }
            }
            "checkerboard" => {
                let mut side = |name: &str, missing: f32| -> Result<Vec3, LoadError> {
                    match plugin.get(name) {
                        Some(nested) if is_texture(nested) => {
                            self.warn(
                                "checkerboards of textures are not supported; such a square is drawn in a plain colour",
                            );
                            Ok(Vec3::splat(missing))
                        }
                        _ => Ok(plugin.color(name, use_, &self.search)?.unwrap_or(Vec3::splat(missing))),
                    }
                };
                let colors = [side("color0", 0.4)?, side("color1", 0.2)?];
                let factor = colors[0].max(colors[1]);
                let encode = |color: Vec3| {
                    let ratio = color / factor.max(Vec3::splat(f32::MIN_POSITIVE));
                    let [r, g, b] = ratio.to_array().map(encode_srgb);
                    [r, g, b, 255]
                };
                let [a, b] = colors.map(encode);
                let name = format!("checkerboard, {}", element.place());
                self.scene.images.push(Image { name, width: 2, height: 2, texels: vec![a, b, b, a] });
                let transform = uv_transform(&plugin)?;
                let image = self.scene.images.len() - 1;
                let texture =
                    self.texture(Texture { image, wrap: [Wrap::Repeat; 2], filter: Filter::Nearest, srgb: true });
                Color { factor, texture: Some(TextureRef { transform, ..texture }) }
            }
            // One that is referred to has no name of its own here; it is taken for a diffuse colour.
            "mesh_attribute"
                if plugin.string("name")? == Some("vertex_color")
                    && matches!(
                        element.attribute("name"),
                        None | Some("reflectance" | "diffuse_reflectance" | "base_color")
                    ) =>
            {
                self.has_vertex_colors = true;
                Color::from(Vec3::ONE)
            }
            "scale" => {
                let nested = plugin.nested("texture");
                let Some(nested) = nested.first() else {
                    return Err(element.error("a `scale` texture needs a texture inside"));
                };
                let scale = match plugin.color("scale", Use::Unbounded, &self.search)? {
                    Some(scale) => scale,
                    None => plugin.color("value", Use::Unbounded, &self.search)?.unwrap_or(Vec3::ONE),
                };
                let color = self.color_texture_at(nested, use_, depth + 1)?;
                Color { factor: color.factor * scale, ..color }
            }
            kind => {
                self.warn(format!("textures of type `{kind}` are not supported; grey 0.5 is drawn instead"));
                return Ok(Color::from(Vec3::splat(0.5)));
            }
        };
        self.finish(&plugin);
        Ok(color)
    }

    /// Converts a texture to a scalar: 0.5's `channel`, or the luminance.
    fn scalar_texture(&mut self, element: &'a Element) -> Result<Scalar, LoadError> {
        let channel = match self.plugin(element)?.string("channel")? {
            None => None,
            Some("r" | "x") => Some(0),
            Some("g" | "y") => Some(1),
            Some("b" | "z") => Some(2),
            Some("a" | "w") => Some(3),
            Some(other) => return Err(element.error(format!("channel is `{other}`; it has to be r, g, b or a"))),
        };
        let color = self.color_texture(element, Use::Unbounded)?;
        let Some(mut texture) = color.texture else { return Ok(Scalar::from(luminance(color.factor.to_array()))) };
        if self.innermost(element)?.plugin() == "checkerboard" && !element.legacy {
            // Where a number is asked for, versions from 2 on (up to 3.9 at least) take color1 where a colour is color0.
            texture.transform = Affine2::from_translation(Vec2::new(0.5, 0.0)) * texture.transform;
        }
        let (texture, channel) = match channel {
            Some(channel) => (texture, channel),
            None => (self.luminance_texture(texture), 0),
        };
        let factor = if channel < 3 { color.factor[channel] } else { 1.0 };
        Ok(Scalar { factor, texture: Some((texture, channel as u32)) })
    }

    /// Returns the texture inside of `scale`s.
    fn innermost(&self, mut element: &'a Element) -> Result<&'a Element, LoadError> {
        while element.plugin() == "scale" {
            let Some(&nested) = self.plugin(element)?.nested("texture").first() else { break };
            element = nested;
        }
        Ok(element)
    }

    /// Returns a mask's opacity: the alpha channel if the image has holes in it, and the luminance otherwise.
    pub(super) fn opacity(&mut self, plugin: &Plugin<'a>) -> Result<Scalar, LoadError> {
        let element = plugin.get("opacity").filter(|e| is_texture(e));
        let Some(element) = element else {
            return Ok(self.scalar_parameter(plugin, "opacity")?.unwrap_or(Scalar::from(0.5)));
        };
        let scalar = self.scalar_texture(element)?;
        if let Some((texture, 0)) = scalar.texture
            && self.plugin(element)?.get("channel").is_none()
        {
            let color = self.color_texture(element, Use::Unbounded)?.texture.unwrap_or(texture);
            let image = &self.scene.images[self.scene.textures[color.texture].image];
            if image.texels.iter().any(|t| t[3] < 192) {
                let warning = format!("the opacity is taken from the alpha channel of `{}`", image.name);
                self.warn(warning);
                return Ok(Scalar { factor: 1.0, texture: Some((color, 3)) });
            }
        }
        Ok(scalar)
    }

    /// Returns the linear values of a texture's image as floats, for height fields, with the texture
    /// transform.
    pub(super) fn heights(&mut self, element: &'a Element) -> Result<Option<Heights>, LoadError> {
        let scalar = self.scalar_texture(element)?;
        let Some((texture, channel)) = scalar.texture else { return Ok(None) };
        let sampler = &self.scene.textures[texture.texture];
        let image = &self.scene.images[sampler.image];
        let decode = |texel: &[u8; 4]| {
            let value = f32::from(texel[channel as usize]) / 255.0;
            scalar.factor * if sampler.srgb && channel < 3 { linear_from_srgb(value) } else { value }
        };
        Ok(Some(Heights {
            width: image.width,
            height: image.height,
            values: image.texels.iter().map(decode).collect(),
            wrap: sampler.wrap,
            transform: texture.transform,
            name: image.name.clone(),
        }))
    }

    /// Returns the image of a bitmap, which is decoded once; none, with a warning, if its file is not there.
    fn bitmap_image(&mut self, plugin: &Plugin<'a>) -> Result<Option<usize>, LoadError> {
        let element = plugin.element;
        let name = plugin.string("filename")?.ok_or_else(|| element.error("a bitmap needs a `filename`"))?;
        let Ok(path) = self.search.find(element, name) else {
            self.warn(format!("the texture `{name}` is not there: grey 0.5 is drawn instead"));
            return Ok(None);
        };
        if let Some(&image) = self.images.get(&path) {
            return Ok(Some(image));
        }
        let bytes = self.search.files.read(&path)?;
        let image = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) {
            self.warn(format!("the texture `{name}` is clamped to [0, 1] and stored with eight bits"));
            let (map, _clamped) = EnvironmentMap::decode(&bytes, &path)?;
            let encode = |t: &[f32; 3]| {
                let [r, g, b] = t.map(encode_srgb);
                [r, g, b, 255]
            };
            Image {
                name: name.to_owned(),
                width: map.width,
                height: map.height,
                texels: map.texels.iter().map(encode).collect(),
            }
        } else {
            Image::decode(&bytes, name).map_err(|cause| LoadError::new(&path, cause))?
        };
        self.scene.images.push(image);
        self.images.insert(path, self.scene.images.len() - 1);
        Ok(Some(self.scene.images.len() - 1))
    }

    /// Returns true if a bitmap's values are linear: Mitsuba 3's `raw`, or 0.5's `gamma` of 1.
    fn is_raw(&mut self, plugin: &Plugin<'a>) -> Result<bool, LoadError> {
        let exr = plugin.string("filename")?.is_some_and(|n| n.to_ascii_lowercase().ends_with(".exr"));
        let gamma = plugin.float("gamma")?.unwrap_or(-1.0);
        if gamma > 0.0 && gamma != 1.0 && (gamma - 2.2).abs() > 0.3 {
            self.warn(format!("{}: gamma {gamma} is drawn as sRGB", plugin.element.title()));
        }
        let raw = plugin.boolean("raw")?.unwrap_or(false);
        // EXR texels were sRGB-encoded when they were read.
        Ok((raw || gamma == 1.0) && !exr)
    }

    /// Adds a bitmap's sampler.
    pub(super) fn sampled(&mut self, plugin: &Plugin<'a>, image: usize, srgb: bool) -> Result<TextureRef, LoadError> {
        plugin.ignore(&["format", "accel", "max_anisotropy", "cache"]);
        let filter = match plugin.string("filter_type")? {
            Some("nearest") => Filter::Nearest,
            None | Some("bilinear" | "trilinear" | "ewa") => Filter::Linear,
            Some(other) => {
                return Err(plugin
                    .element
                    .error(format!("filter_type is `{other}`; it has to be nearest or bilinear")));
            }
        };
        let wrap = self.wrap_modes(plugin)?;
        let transform = uv_transform(plugin)?;
        Ok(TextureRef { transform, ..self.texture(Texture { image, wrap, filter, srgb }) })
    }

    /// Returns the wrap modes of a bitmap.
    pub(super) fn wrap_modes(&mut self, plugin: &Plugin<'a>) -> Result<[Wrap; 2], LoadError> {
        let mut wrap = |name: &str| -> Result<Option<Wrap>, LoadError> {
            Ok(match plugin.string(name)? {
                None => None,
                Some("repeat") => Some(Wrap::Repeat),
                Some("mirror") => Some(Wrap::Mirror),
                Some("clamp") => Some(Wrap::Clamp),
                Some(other) => {
                    self.warn(format!("wrap mode `{other}` is drawn as clamp"));
                    Some(Wrap::Clamp)
                }
            })
        };
        let both = wrap("wrap_mode")?.unwrap_or(Wrap::Repeat);
        Ok([wrap("wrap_mode_u")?.unwrap_or(both), wrap("wrap_mode_v")?.unwrap_or(both)])
    }

    fn texture(&mut self, texture: Texture) -> TextureRef {
        let found = self.scene.textures.iter().position(|t| *t == texture);
        TextureRef::new(found.unwrap_or_else(|| {
            self.scene.textures.push(texture);
            self.scene.textures.len() - 1
        }))
    }

    /// Returns the texture with its image's luminance in red, or unchanged if the image is grey.
    fn luminance_texture(&mut self, texture: TextureRef) -> TextureRef {
        let sampler = self.scene.textures[texture.texture].clone();
        let image = &self.scene.images[sampler.image];
        if image.texels.iter().all(|t| t[0] == t[1] && t[1] == t[2]) {
            return texture;
        }
        let decode = |v: u8| if sampler.srgb { linear_from_srgb(f32::from(v) / 255.0) } else { f32::from(v) / 255.0 };
        let encode = |v: f32| if sampler.srgb { encode_srgb(v) } else { (v * 255.0).round() as u8 };
        let grey = |t: &[u8; 4]| {
            let v = encode(luminance([decode(t[0]), decode(t[1]), decode(t[2])]));
            [v, v, v, t[3]]
        };
        let name = format!("{}, luminance{}", image.name, if sampler.srgb { "" } else { ", linear" });
        let found = self.scene.images.iter().position(|i| i.name == name);
        let image = match found {
            Some(image) => image,
            None => {
                let texels = image.texels.iter().map(grey).collect();
                let grey = Image { name, width: image.width, height: image.height, texels };
                self.scene.images.push(grey);
                self.scene.images.len() - 1
            }
        };
        TextureRef { texture: self.texture(Texture { image, ..sampler }).texture, ..texture }
    }
}

/// A height field to be baked into a normal map.
pub(super) struct Heights {
    pub width: u32,
    pub height: u32,
    pub values: Vec<f32>,
    pub wrap: [Wrap; 2],
    pub transform: Affine2,
    pub name: String,
}

/// Returns true if an element is a texture and not a plain value.
pub(super) fn is_texture(element: &Element) -> bool {
    element.tag == "texture"
}

/// Returns Mitsuba 3's `to_uv`, or 0.5's `uscale`, `vscale`, `uoffset` and `voffset`, scaled first, then
/// translated.
fn uv_transform(plugin: &Plugin) -> Result<Affine2, LoadError> {
    if let Some(m) = plugin.transform("to_uv")? {
        return Ok(affine2(m));
    }
    let part = |name: &str, missing: f32| Ok::<f32, LoadError>(plugin.float(name)?.unwrap_or(missing));
    let both = part("uvscale", 1.0)?;
    let scale = Vec2::new(part("uscale", both)?, part("vscale", both)?);
    Ok(Affine2::from_scale_angle_translation(scale, 0.0, Vec2::new(part("uoffset", 0.0)?, part("voffset", 0.0)?)))
}

fn affine2(m: DMat4) -> Affine2 {
    Affine2::from_mat2_translation(
        Mat2::from_cols(m.x_axis.as_vec4().truncate().truncate(), m.y_axis.as_vec4().truncate().truncate()),
        m.w_axis.as_vec4().truncate().truncate(),
    )
}

/// Returns the Rec. 709 luminance.
pub(super) fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Encodes a linear value as sRGB with eight bits (IEC 61966-2-1).
fn encode_srgb(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}
