//! Colours: linear RGB as written, sRGB decoded, and spectra integrated against the CIE 1931 observer.
//!
//! A reflectance's spectrum is lit by D65, so that a constant spectrum is grey. A light's spectrum is
//! integrated directly and scaled so that a constant spectrum of 1 has luminance 1, as in Mitsuba's RGB mode.
//! The observer is the fit of Wyman, Sloan and Shirley, "Simple Analytic Approximations to the CIE XYZ Color
//! Matching Functions" (JCGT 2013), multi-lobe, within 1 %.

use glam::{DMat3, DVec3, Vec3};

use super::values::{number, numbers};
use super::xml::{Element, Search};
use crate::scene::LoadError;
use crate::scene::model::texture::linear_from_srgb;

/// The meaning of a colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::scene) enum Use {
    /// A reflectance in [0, 1], seen under white light.
    Reflectance,
    /// A radiance.
    Radiance,
    /// Another spectral value, such as an index of refraction.
    Unbounded,
}

/// Returns the colour of a `float`, `rgb`, `srgb`, `spectrum` or `blackbody` element.
pub(super) fn color(element: &Element, use_: Use, search: &Search) -> Result<Vec3, LoadError> {
    let color = match (element.tag.as_str(), element.plugin()) {
        ("float" | "integer", _) => Vec3::splat(number(element)?),
        ("rgb" | "color", _) => rgb(element)?,
        ("srgb", _) => srgb(element)?,
        ("spectrum", "") => spectrum(element, use_, search)?,
        ("spectrum" | "texture", plugin) => spectrum_plugin(element, plugin, use_)?,
        ("blackbody", _) => blackbody(element)?,
        (tag, _) => return Err(element.error(format!("<{tag}> is not a colour"))),
    };
    // A rounding error above 1 is accepted. Versions before 2 scale larger reflectances down.
    match use_ {
        Use::Reflectance if element.legacy && color.min_element() >= 0.0 => Ok(color / color.max_element().max(1.0)),
        Use::Reflectance if color.min_element() < 0.0 || color.max_element() > 1.001 => {
            Err(element.error(format!("the reflectance {color} does not lie in [0, 1]")))
        }
        Use::Reflectance => Ok(color.min(Vec3::ONE)),
        Use::Radiance if color.min_element() < 0.0 => {
            Err(element.error(format!("the light's colour {color} is negative")))
        }
        Use::Radiance | Use::Unbounded => Ok(color),
    }
}

fn triple(element: &Element) -> Result<Vec3, LoadError> {
    match numbers(element, element.required("value")?)?[..] {
        [v] => Ok(Vec3::splat(v as f32)),
        [r, g, b] => Ok(DVec3::new(r, g, b).as_vec3()),
        ref v => Err(element.error(format!("a colour has one or three numbers, not {}", v.len()))),
    }
}

fn rgb(element: &Element) -> Result<Vec3, LoadError> {
    if element.required("value")?.trim().starts_with('#') { srgb(element) } else { triple(element) }
}

/// Parses `#rrggbb` or numbers in [0, 1], both sRGB-encoded.
fn srgb(element: &Element) -> Result<Vec3, LoadError> {
    let text = element.required("value")?.trim();
    let encoded = match text.strip_prefix('#') {
        None => triple(element)?,
        Some(hex) if hex.len() == 6 && hex.bytes().all(|b| b.is_ascii_hexdigit()) => {
            let bits = u32::from_str_radix(hex, 16).unwrap_or_default();
            Vec3::new((bits >> 16) as f32, (bits >> 8 & 255) as f32, (bits & 255) as f32) / 255.0
        }
        Some(_) => return Err(element.error(format!("`{text}` is not of the form #rrggbb"))),
    };
    Ok(Vec3::from_array(encoded.to_array().map(linear_from_srgb)))
}

/// Reads one number, a list such as `400:0.3, 500:0.5`, or a file with a wavelength and a value per line.
fn spectrum(element: &Element, use_: Use, search: &Search) -> Result<Vec3, LoadError> {
    let text = match element.attribute("filename") {
        Some(name) => {
            let (path, bytes) = search.read(element, name)?;
            let text = std::str::from_utf8(&bytes).map_err(|_| LoadError::new(path, "is not UTF-8 text"))?;
            text.lines().filter(|line| !line.trim_start().starts_with('#')).collect::<Vec<_>>().join("\n")
        }
        None => element.required("value")?.to_owned(),
    };
    let values = numbers(element, &text.replace(':', " "))?;
    if let ([v], None) = (&values[..], element.attribute("filename")) {
        // A light of equal energy at all wavelengths is reddish to Mitsuba 3, as a list is; to the versions before 2 it was white.
        let reddish = use_ == Use::Radiance && !element.legacy;
        return Ok(if reddish { integrate(&[[360.0, *v], [830.0, *v]], use_) } else { Vec3::splat(*v as f32) });
    }
    if !text.contains(':') && element.attribute("filename").is_none() {
        return triple(element);
    }
    if values.is_empty() || values.len() % 2 == 1 {
        return Err(element.error("a spectrum is one number or pairs of wavelength and value"));
    }
    let pairs: Vec<[f64; 2]> = values.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    if pairs.windows(2).any(|w| w[0][0] >= w[1][0]) {
        return Err(element.error("the spectrum's wavelengths do not increase"));
    }
    Ok(integrate(&pairs, use_))
}

/// Evaluates Mitsuba 3's spectrum plugins.
fn spectrum_plugin(element: &Element, plugin: &str, use_: Use) -> Result<Vec3, LoadError> {
    let child = |name: &str| element.children.iter().find(|c| c.name().as_deref() == Some(name));
    let list = |name: &str| child(name).map(|c| numbers(c, c.required("value")?)).transpose();
    match plugin {
        "uniform" => child("value").map_or(Ok(Vec3::ONE), |c| Ok(Vec3::splat(number(c)?))),
        "d65" => child("scale").map_or(Ok(Vec3::ONE), |c| Ok(Vec3::splat(number(c)?))),
        "rgb" => child("color").map_or(Ok(Vec3::ONE), rgb),
        "srgb" => child("color").map_or(Ok(Vec3::ONE), triple),
        "irregular" | "regular" => {
            let values = list("values")?.unwrap_or_default();
            let wavelengths = match list("wavelengths")? {
                Some(wavelengths) => wavelengths,
                None => {
                    let end = |name: &str, missing: f64| child(name).map_or(Ok(missing), |c| Ok(f64::from(number(c)?)));
                    let (low, high) = (end("wavelength_min", 360.0)?, end("wavelength_max", 830.0)?);
                    let steps = values.len().saturating_sub(1).max(1) as f64;
                    (0..values.len()).map(|i| low + (high - low) * i as f64 / steps).collect()
                }
            };
            if values.is_empty() || wavelengths.len() != values.len() || wavelengths.windows(2).any(|w| w[0] >= w[1]) {
                return Err(element.error("the spectrum needs increasing wavelengths and as many values"));
            }
            let pairs: Vec<[f64; 2]> = wavelengths.into_iter().zip(values).map(|(w, v)| [w, v]).collect();
            Ok(integrate(&pairs, use_))
        }
        "blackbody" => child("temperature")
            .map_or_else(|| Err(element.error("a blackbody needs a temperature")), |c| planck(c, 1.0)),
        _ => Err(element.error(format!("the spectrum type `{plugin}` is not supported; write it as <rgb>"))),
    }
}

/// Evaluates Mitsuba 0.5's `blackbody`: `temperature` in kelvin, optionally with a K, and `scale`.
fn blackbody(element: &Element) -> Result<Vec3, LoadError> {
    let scale = match element.attribute("scale").map(|text| numbers(element, text)).transpose()?.as_deref() {
        None => 1.0,
        Some([scale]) => *scale,
        Some(_) => return Err(element.error("`scale` has to be one number")),
    };
    planck(element, scale)
}

fn planck(element: &Element, scale: f64) -> Result<Vec3, LoadError> {
    let text = element.attribute("temperature").or_else(|| element.attribute("value")).unwrap_or_default();
    let kelvin = match numbers(element, text.trim().trim_end_matches(['k', 'K']))?[..] {
        [kelvin] if kelvin > 0.0 => kelvin,
        _ => return Err(element.error("`temperature` has to be a positive number of kelvin")),
    };
    // This is Planck's law, W m^-2 sr^-1 nm^-1, with CODATA 2018's h, c and k.
    let (h, c, k) = (6.626_070_15e-34, 299_792_458.0, 1.380_649e-23);
    let radiance = |nm: f64| {
        let m = nm * 1e-9;
        scale * 1e-9 * 2.0 * h * c * c / (m.powi(5) * ((h * c / (m * k * kelvin)).exp() - 1.0))
    };
    let pairs: Vec<[f64; 2]> = (36..=83).map(|i| 10.0 * f64::from(i)).map(|nm| [nm, radiance(nm)]).collect();
    Ok(integrate(&pairs, Use::Radiance))
}

/// Returns the linear RGB of a spectrum that is linear between its points and zero outside.
pub(in crate::scene) fn integrate(pairs: &[[f64; 2]], use_: Use) -> Vec3 {
    let value = |nm: f64| match pairs.partition_point(|p| p[0] <= nm) {
        0 => 0.0,
        n if n == pairs.len() => {
            if nm == pairs[n - 1][0] {
                pairs[n - 1][1]
            } else {
                0.0
            }
        }
        n => {
            let ([w0, v0], [w1, v1]) = (pairs[n - 1], pairs[n]);
            v0 + (v1 - v0) * (nm - w0) / (w1 - w0)
        }
    };
    let (mut color, mut white) = (DVec3::ZERO, DVec3::ZERO);
    for nm in (360..=830).map(f64::from) {
        let seen = observer(nm) * if use_ == Use::Reflectance { d65(nm) } else { 1.0 };
        color += seen * value(nm);
        white += seen;
    }
    let rgb = if use_ == Use::Reflectance {
        (XYZ_TO_RGB * color / (XYZ_TO_RGB * white)).min(DVec3::ONE)
    } else {
        XYZ_TO_RGB * color / white.y
    };
    rgb.max(DVec3::ZERO).as_vec3()
}

/// Matrix from XYZ to linear Rec. 709 (IEC 61966-2-1), by columns.
const XYZ_TO_RGB: DMat3 = DMat3::from_cols(
    DVec3::new(3.240_479, -0.969_256, 0.055_648),
    DVec3::new(-1.537_150, 1.875_991, -0.204_043),
    DVec3::new(-0.498_535, 0.041_556, 1.057_311),
);

fn observer(nm: f64) -> DVec3 {
    let lobe = |height: f64, centre: f64, below: f64, above: f64| {
        let t = (nm - centre) / if nm < centre { below } else { above };
        height * (-0.5 * t * t).exp()
    };
    DVec3::new(
        lobe(1.056, 599.8, 37.9, 31.0) + lobe(0.362, 442.0, 16.0, 26.7) + lobe(-0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    )
}

/// Returns CIE standard illuminant D65, every 10 nm from 360 to 780 (ISO/CIE 11664-2), constant beyond.
fn d65(nm: f64) -> f64 {
    const TABLE: [f64; 43] = [
        46.6383, 52.0891, 49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861,
        115.923, 108.811, 109.354, 107.802, 104.790, 107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856,
        90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778, 78.2842, 69.7213, 71.6091, 74.3490,
        61.6040, 69.8856, 75.0870, 63.5927, 46.4182, 66.8054, 63.3828,
    ];
    let t = ((nm - 360.0) / 10.0).clamp(0.0, 41.999);
    let i = t as usize;
    TABLE[i] + (TABLE[i + 1] - TABLE[i]) * (t - i as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_reflectance_is_its_own_grey() {
        let rgb = integrate(&[[360.0, 0.3], [830.0, 0.3]], Use::Reflectance);
        assert!((rgb - 0.3).abs().max_element() < 1e-6, "{rgb}");
    }

    #[test]
    fn a_constant_light_has_its_own_luminance() {
        let rgb = integrate(&[[360.0, 2.0], [830.0, 2.0]], Use::Radiance);
        // The expected value is equal-energy white in linear Rec. 709.
        assert!((rgb - Vec3::new(2.41, 1.897, 1.817)).abs().max_element() < 0.01, "{rgb}");
        assert!((super::super::textures::luminance(rgb.to_array()) - 2.0).abs() < 1e-3);
    }

    #[test]
    fn the_cornell_box_is_as_red_as_in_mitsuba() {
        // The values are the left wall as measured at Cornell, every 20 nm from 400.
        let values =
            [0.04, 0.05, 0.059, 0.062, 0.06, 0.058, 0.057, 0.059, 0.067, 0.09, 0.287, 0.513, 0.609, 0.65, 0.642, 0.642];
        let pairs: Vec<[f64; 2]> = values.iter().enumerate().map(|(i, &v)| [400.0 + 20.0 * i as f64, v]).collect();
        // The expected value is that of Mitsuba's own Cornell box for equal-energy light.
        let expected = Vec3::new(0.570_068, 0.043_013_5, 0.044_370_6);
        let rgb = integrate(&pairs, Use::Unbounded);
        assert!((rgb - expected).abs().max_element() < 0.02, "{rgb}, not {expected}");
        // Under white light the wall is less red.
        assert!(integrate(&pairs, Use::Reflectance).x < rgb.x);
    }

    #[test]
    fn a_black_body_at_6500_kelvin_is_nearly_white() {
        let color = |kelvin: f64| {
            let c2 = 1.438_777e7;
            let radiance = |nm: f64| 1e15 / (nm.powi(5) * ((c2 / (nm * kelvin)).exp() - 1.0));
            let pairs: Vec<[f64; 2]> = (36..=83).map(|i| 10.0 * f64::from(i)).map(|nm| [nm, radiance(nm)]).collect();
            integrate(&pairs, Use::Radiance)
        };
        let white = color(6500.0) / color(6500.0).y;
        assert!((white - 1.0).abs().max_element() < 0.06, "{white}");
        let warm = color(2700.0);
        assert!(warm.x > 2.0 * warm.z, "{warm}");
    }
}
