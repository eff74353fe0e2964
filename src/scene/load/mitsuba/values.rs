//! A plugin's parameters as typed values. Unused parameters are named in a warning at the end.

use std::cell::Cell;
use std::collections::HashMap;

use glam::{DMat3, DMat4, DVec3, Vec3};

use super::spectra;
use super::xml::{Element, Search};
use crate::scene::LoadError;

/// Elements by id.
pub(super) type Ids<'a> = HashMap<&'a str, &'a Element>;

/// A plugin element during the reading of its parameters.
pub(super) struct Plugin<'a> {
    /// The element itself.
    pub element: &'a Element,
    children: Vec<Child<'a>>,
}

/// A child element with its reference resolved.
struct Child<'a> {
    name: Option<String>,
    /// The element in the file: `element` itself or the `ref` to it.
    here: &'a Element,
    target: &'a Element,
    used: Cell<bool>,
}

impl<'a> Plugin<'a> {
    /// Resolves references. Those that refer to nothing, of which [`super::xml::ids`] tells, are left out.
    pub fn new(element: &'a Element, ids: &Ids<'a>) -> Result<Self, LoadError> {
        let child = |here: &'a Element| -> Result<Option<Child<'a>>, LoadError> {
            let target = if here.tag == "ref" { ids.get(here.required("id")?).copied() } else { Some(here) };
            Ok(target.map(|target| Child { name: here.name(), here, target, used: Cell::new(false) }))
        };
        let children = element.children.iter().filter_map(|here| child(here).transpose());
        Ok(Self { element, children: children.collect::<Result<_, _>>()? })
    }

    /// Returns the element of a parameter, with references resolved.
    pub fn get(&self, name: &str) -> Option<&'a Element> {
        let child = self.children.iter().find(|c| c.name.as_deref() == Some(name))?;
        child.used.set(true);
        Some(child.target)
    }

    /// Returns the same, which then still counts as unread.
    pub fn peek(&self, name: &str) -> Option<&'a Element> {
        self.children.iter().find(|c| c.name.as_deref() == Some(name)).map(|child| child.target)
    }

    /// Returns all nested plugins of a kind, such as `bsdf`, with any name.
    pub fn nested(&self, tag: &str) -> Vec<&'a Element> {
        self.named(tag).into_iter().map(|(_, element)| element).collect()
    }

    /// Returns the only nested plugin of a kind.
    pub fn only(&self, tag: &str) -> Result<Option<&'a Element>, LoadError> {
        match self.nested(tag)[..] {
            [] => Ok(None),
            [one] => Ok(Some(one)),
            [..] => Err(self.element.error(format!("{} has more than one <{tag}>", self.element.title()))),
        }
    }

    /// Returns nested plugins of a kind with the names of their parameters as written.
    pub fn named(&self, tag: &str) -> Vec<(Option<&'a str>, &'a Element)> {
        let children = self.children.iter().filter(|c| c.target.tag == tag);
        children.inspect(|c| c.used.set(true)).map(|c| (c.here.attribute("name"), c.target)).collect()
    }

    /// Marks parameters as known to have no effect here.
    pub fn ignore(&self, names: &[&str]) {
        for name in names {
            self.get(name);
        }
    }

    /// Returns the names of parameters that were not read, as written.
    pub fn unused(&self) -> Vec<String> {
        let unused = self.children.iter().filter(|c| !c.used.get());
        unused.map(|c| c.here.attribute("name").unwrap_or(c.target.tag.as_str()).to_owned()).collect()
    }

    /// Returns a number.
    pub fn float(&self, name: &str) -> Result<Option<f32>, LoadError> {
        self.get(name).map(|e| number(typed(e, &["float", "integer"])?)).transpose()
    }

    /// Returns an integer.
    pub fn integer(&self, name: &str) -> Result<Option<i64>, LoadError> {
        let parse = |e: &'a Element| {
            let text = typed(e, &["integer"])?.required("value")?;
            text.trim().parse().map_err(|_| e.error(format!("`{text}` is not a whole number")))
        };
        self.get(name).map(parse).transpose()
    }

    /// Returns a truth value.
    pub fn boolean(&self, name: &str) -> Result<Option<bool>, LoadError> {
        let parse = |e: &'a Element| match typed(e, &["boolean"])?.required("value")?.trim() {
            "true" | "True" => Ok(true),
            "false" | "False" => Ok(false),
            text => Err(e.error(format!("`{text}` is neither true nor false"))),
        };
        self.get(name).map(parse).transpose()
    }

    /// Returns a text.
    pub fn string(&self, name: &str) -> Result<Option<&'a str>, LoadError> {
        self.get(name).map(|e| typed(e, &["string"])?.required("value")).transpose()
    }

    /// Returns a point or a vector.
    pub fn vector(&self, name: &str) -> Result<Option<Vec3>, LoadError> {
        let parse = |e: &'a Element| vector(typed(e, &["point", "vector"])?, 0.0).map(DVec3::as_vec3);
        self.get(name).map(parse).transpose()
    }

    /// Returns an affine transform.
    pub fn transform(&self, name: &str) -> Result<Option<DMat4>, LoadError> {
        self.get(name).map(|e| transform(typed(e, &["transform", "animation"])?)).transpose()
    }

    /// Returns a colour without texture.
    pub fn color(&self, name: &str, use_: spectra::Use, search: &Search) -> Result<Option<Vec3>, LoadError> {
        self.get(name).map(|e| spectra::color(e, use_, search)).transpose()
    }
}

/// Returns the element if its kind is one of `tags`.
fn typed<'a>(element: &'a Element, tags: &[&str]) -> Result<&'a Element, LoadError> {
    if tags.contains(&element.tag.as_str()) {
        return Ok(element);
    }
    let name = element.attribute("name").unwrap_or_default();
    Err(element.error(format!("`{name}` is a <{}>, but has to be a <{}>", element.tag, tags.join("> or <"))))
}

/// Parses finite numbers between spaces or commas.
pub(super) fn numbers(element: &Element, text: &str) -> Result<Vec<f64>, LoadError> {
    let parse = |token: &str| match token.parse::<f64>() {
        Ok(v) if (v as f32).is_finite() => Ok(v),
        Ok(_) => Err(element.error(format!("`{token}` is not a finite number"))),
        Err(_) => Err(element.error(format!("`{token}` is not a number"))),
    };
    text.split(|c: char| c.is_whitespace() || c == ',').filter(|t| !t.is_empty()).map(parse).collect()
}

/// Parses the single number of the attribute `value`.
pub(super) fn number(element: &Element) -> Result<f32, LoadError> {
    match numbers(element, element.required("value")?)?[..] {
        [v] => Ok(v as f32),
        ref v => Err(element.error(format!("one number is expected, not {}", v.len()))),
    }
}

/// Parses `value` with one or three numbers, or `x`, `y` and `z`.
fn vector(element: &Element, missing: f64) -> Result<DVec3, LoadError> {
    if let Some(text) = element.attribute("value") {
        return match numbers(element, text)?[..] {
            [v] => Ok(DVec3::splat(v)),
            [x, y, z] => Ok(DVec3::new(x, y, z)),
            ref v => Err(element.error(format!("one or three numbers are expected, not {}", v.len()))),
        };
    }
    let part = |name: &str| match element.attribute(name).map(|text| numbers(element, text)).transpose()?.as_deref() {
        None => Ok(missing),
        Some([v]) => Ok(*v),
        Some(v) => Err(element.error(format!("`{name}` has to be one number, not {}", v.len()))),
    };
    Ok(DVec3::new(part("x")?, part("y")?, part("z")?))
}

/// Returns the product of a transform's steps, the first applied first. An animation yields its first pose.
fn transform(element: &Element) -> Result<DMat4, LoadError> {
    let mut out = DMat4::IDENTITY;
    for step in &element.children {
        let matrix = match step.tag.as_str() {
            "translate" => DMat4::from_translation(vector(step, 0.0)?),
            "scale" => DMat4::from_scale(vector(step, 1.0)?),
            "rotate" => {
                let [angle] = numbers(step, step.required("angle")?)?[..] else {
                    return Err(step.error("`angle` has to be one number"));
                };
                let axis = vector(step, 0.0)?;
                let unit = axis.normalize_or_zero();
                if unit == DVec3::ZERO && angle != 0.0 {
                    return Err(step.error("the rotation's axis is zero; give x, y or z"));
                }
                rotation(if step.legacy { unit } else { axis }, angle.to_radians())
            }
            "matrix" => matrix(step)?,
            "lookat" => look_at(step)?,
            "transform" if element.tag == "animation" => return transform(step),
            tag => return Err(step.error(format!("<{tag}> is not a step of a transform"))),
        };
        out = matrix * out;
    }
    if !out.to_cols_array().iter().all(|v| (*v as f32).is_finite()) {
        return Err(element.error("the transform overflows"));
    }
    Ok(out)
}

/// Returns a rotation. Of an axis that has not the length 1, from version 2 on, Mitsuba's shear is kept: it applies
/// cos(a) 1 + sin(a) [axis x] + (1 - cos(a)) axis axis^T as it stands.
fn rotation(axis: DVec3, angle: f64) -> DMat4 {
    let (sin, cos) = angle.sin_cos();
    let column = |e: DVec3| e * cos + axis.cross(e) * sin + axis * (axis.dot(e) * (1.0 - cos));
    DMat4::from_mat3(DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z)))
}

fn matrix(element: &Element) -> Result<DMat4, LoadError> {
    let v = numbers(element, element.required("value")?)?;
    let m = match v.len() {
        16 => DMat4::from_cols_array(&std::array::from_fn(|i| v[i])).transpose(),
        9 => DMat4::from_mat3(glam::DMat3::from_cols_array(&std::array::from_fn(|i| v[i])).transpose()),
        n => return Err(element.error(format!("a matrix has 9 or 16 numbers, not {n}"))),
    };
    if (m.row(3) - glam::DVec4::W).abs().max_element() > 1e-6 {
        return Err(element.error("the matrix's last row is not 0 0 0 1: only affine transforms are supported"));
    }
    Ok(m)
}

/// Returns Mitsuba's camera space: +X left, +Y up, +Z forward.
fn look_at(element: &Element) -> Result<DMat4, LoadError> {
    let point = |name: &str, text: &str| match numbers(element, text)?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        ref v => Err(element.error(format!("`{name}` has to be three numbers, not {}", v.len()))),
    };
    let origin = point("origin", element.required("origin")?)?;
    let target = point("target", element.required("target")?)?;
    let Some(ahead) = (target - origin).try_normalize() else {
        return Err(element.error("origin and target are the same point"));
    };
    let up = element.attribute("up").map(|text| point("up", text)).transpose()?.unwrap_or_default();
    let up = if up == DVec3::ZERO { ahead.any_orthonormal_vector() } else { up };
    let Some(left) = up.cross(ahead).try_normalize() else {
        return Err(element.error("`up` points along the view"));
    };
    Ok(DMat4::from_cols(left.extend(0.0), ahead.cross(left).extend(0.0), ahead.extend(0.0), origin.extend(1.0)))
}
