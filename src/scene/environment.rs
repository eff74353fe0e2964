//! Radiance from infinitely far away.

use std::path::Path;

use glam::{Mat3, Vec3};

use super::sky::ClearSky;
use super::texture::linear_from_srgb;
use super::{Light, LoadError, Scene, studio};

/// Where the first and the last row of an equirectangular map lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Row r spans polar angles pi r / H to pi (r + 1) / H; its value is met at the middle.
    Centred,
    /// Row 0 is met at the upper pole and row H - 1 at the lower one (Mitsuba's `envmap`).
    AtPoles,
}

/// An equirectangular map, row 0 on top (+Y), bilinear, wrapping in u and clamped in v.
///
/// A direction d in the map's own space has u = atan2(d.x, -d.z) / (2 pi) mod 1 and v = acos(d.y) / pi;
/// in u, texel centres lie at (i + 0.5) / W.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Linear radiance, W m^-2 sr^-1, row-major.
    pub texels: Vec<[f32; 3]>,
    /// Where rows are met.
    pub rows: Rows,
}

/// A constant or mapped sky.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Multiplies the map, or is the radiance itself where there is none.
    pub radiance: Vec3,
    /// The map, if not constant.
    pub map: Option<EnvironmentMap>,
    /// Rotation from the map's space to the world.
    pub world_from_environment: Mat3,
}

/// What becomes of a scene's environment when it is loaded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnvironmentChange {
    /// In place of the scene's own: an image as [`EnvironmentMap::load`] reads it; `sky:ELEVATION[,TURBIDITY]`, a [`ClearSky`]
    /// whose sun stands so many degrees above the horizon in the direction of +Z; `studio`, a photographer's studio for a camera that
    /// looks along -Z ([`studio`]); or `none`.
    pub source: Option<String>,
    /// Multiplies the radiance.
    pub scale: Option<f32>,
    /// Turns it about +Y, radians.
    pub rotate: Option<f32>,
}

impl EnvironmentChange {
    /// Says whether no environment is asked for, nor light in its place.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.source.as_deref() == Some("none")
    }

    /// Changes the environment, and the sun that belongs to it.
    ///
    /// # Errors
    /// An image that cannot be read; no sky in `sky:`; a scene without environment, where nothing replaces it.
    pub fn apply(&self, scene: &mut Scene) -> Result<(), LoadError> {
        if let Some(source) = &self.source {
            scene.lights.retain(|light| !matches!(light, Light::Sun { of_sky: true, .. }));
            let (map, sun) = match (source.as_str(), source.strip_prefix("sky:")) {
                ("none", _) => (None, None),
                ("studio", _) => (Some(studio::map()), None),
                (_, Some(text)) => {
                    let sky = parse_sky(text).ok_or_else(|| {
                        LoadError::new(
                            source,
                            "is no sky: write sky:ELEVATION or sky:ELEVATION,TURBIDITY with the sun 0 to 90 degrees above the \
                             horizon and a turbidity of 1 to 10, such as sky:30,3",
                        )
                    })?;
                    (Some(sky.map()), Some(sky.sun()))
                }
                _ => (Some(EnvironmentMap::load(Path::new(source))?), None),
            };
            scene.lights.extend(sun);
            scene.environment = map.map(|map| Environment {
                radiance: Vec3::ONE,
                map: Some(map),
                world_from_environment: Mat3::IDENTITY,
            });
        }
        let (scale, turn) = (self.scale.unwrap_or(1.0), Mat3::from_rotation_y(self.rotate.unwrap_or(0.0)));
        match &mut scene.environment {
            Some(environment) => {
                environment.radiance *= scale;
                environment.world_from_environment = turn * environment.world_from_environment;
            }
            None if self.scale.is_some() || self.rotate.is_some() => {
                let cause = "has no environment to be scaled or rotated; `--env FILE` gives it one";
                return Err(LoadError::new(&scene.name, cause));
            }
            None => {}
        }
        for light in &mut scene.lights {
            if let Light::Sun { direction, irradiance, of_sky: true, .. } = light {
                *irradiance *= scale;
                *direction = turn * *direction;
            }
        }
        Ok(())
    }
}

/// `ELEVATION[,TURBIDITY]`.
fn parse_sky(text: &str) -> Option<ClearSky> {
    let (elevation, turbidity) = text.split_once(',').unwrap_or((text, "3"));
    let [elevation, turbidity] = [elevation, turbidity].map(|number| number.trim().parse::<f32>().ok());
    let elevation = elevation.filter(|e| (0.0..=90.0).contains(e))?.to_radians();
    let turbidity = turbidity.filter(|t| (1.0..=10.0).contains(t))?;
    let towards_sun = Vec3::new(0.0, elevation.sin(), elevation.cos());
    Some(ClearSky { towards_sun, turbidity, ..ClearSky::default() })
}

impl EnvironmentMap {
    /// Most texels that a map may have; more is refused rather than allocated.
    pub const MAX_TEXELS: u64 = 1 << 28;

    /// Loads a Radiance `.hdr` file, an OpenEXR file with red, green and blue, or an eight-bit image read as sRGB.
    ///
    /// Rows are [`Rows::Centred`]; whoever knows better says so.
    ///
    /// # Errors
    /// A file that is missing, damaged, too large, without colour, compressed with DWA, or with a texel that is negative or not
    /// finite.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        let error = |cause: String| LoadError::new(path, cause);
        let bytes = std::fs::read(path).map_err(|e| error(format!("cannot be read: {e}")))?;
        let map = if bytes.starts_with(&EXR_MAGIC) { Self::decode_exr(&bytes) } else { Self::decode_image(&bytes) }
            .map_err(error)?;
        if let Some(i) = map.texels.iter().position(|t| !t.iter().all(|v| v.is_finite() && *v >= 0.0)) {
            let (x, y) = (i % map.width as usize, i / map.width as usize);
            return Err(LoadError::at(path, format!("texel ({x}, {y})"), "is negative or not finite"));
        }
        Ok(map)
    }

    fn decode_image(bytes: &[u8]) -> Result<Self, String> {
        let mut reader =
            image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(Self::MAX_TEXELS * 16);
        reader.limits(limits);
        let decoded = reader.decode().map_err(|e| format!("the image cannot be decoded: {e}"))?;
        let float = matches!(decoded.color(), image::ColorType::Rgb32F | image::ColorType::Rgba32F);
        let rgb = decoded.into_rgb32f();
        let (width, height) = rgb.dimensions();
        if width == 0 || height == 0 {
            return Err("the image has no pixels".to_owned());
        }
        let texel = |p: &[f32]| [p[0], p[1], p[2]].map(|v| if float { v } else { linear_from_srgb(v) });
        let texels = rgb.into_raw().chunks_exact(3).map(texel).collect();
        Ok(Self { width, height, texels, rows: Rows::Centred })
    }

    fn decode_exr(bytes: &[u8]) -> Result<Self, String> {
        use exr::prelude::{Compression, ReadChannels, ReadLayers, Vec2};
        let headers = exr::meta::MetaData::read_from_buffered(bytes, false).map_err(|e| e.to_string())?.headers;
        let Some(header) = headers.first() else { return Err("the file has no image".to_owned()) };
        if matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
            return Err("the file is compressed with DWA, which is not supported; save it with ZIP or PIZ".to_owned());
        }
        let pixels = header.layer_size.0 as u64 * header.layer_size.1 as u64;
        if pixels == 0 || pixels > Self::MAX_TEXELS {
            return Err(format!("the image has {pixels} pixels; 1 to {} are supported", Self::MAX_TEXELS));
        }
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .rgb_channels(
                |size: Vec2<usize>, _| (size.0, vec![[0.0_f32; 3]; size.0 * size.1]),
                |(width, texels), at: Vec2<usize>, (r, g, b): (f32, f32, f32)| texels[at.1 * *width + at.0] = [r, g, b],
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(std::io::Cursor::new(bytes))
            .map_err(|e| format!("the image cannot be decoded: {e}"))?;
        let size = image.layer_data.size;
        let texels = image.layer_data.channel_data.pixels.1;
        Ok(Self { width: size.0 as u32, height: size.1 as u32, texels, rows: Rows::Centred })
    }
}

/// The first bytes of an OpenEXR file.
const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sun_goes_with_its_sky() {
        let sun = |of_sky| Light::Sun { direction: Vec3::NEG_Z, irradiance: Vec3::ONE, angle: 0.1, of_sky };
        let radiance = Vec3::splat(0.5);
        let sky = Environment { radiance, map: None, world_from_environment: Mat3::IDENTITY };
        let scene = Scene { lights: vec![sun(true), sun(false)], environment: Some(sky), ..Scene::default() };

        let mut turned = scene.clone();
        let quarter = Some(std::f32::consts::FRAC_PI_2);
        EnvironmentChange { source: None, scale: Some(3.0), rotate: quarter }.apply(&mut turned).unwrap();
        let Light::Sun { direction, irradiance, .. } = turned.lights[0] else { panic!() };
        // Counter-clockwise from above: -Z comes to -X.
        assert!(direction.abs_diff_eq(Vec3::NEG_X, 1e-6) && irradiance == Vec3::splat(3.0), "{direction}");
        assert_eq!((turned.lights[1], turned.environment.unwrap().radiance), (sun(false), 3.0 * radiance));

        let mut replaced = scene.clone();
        let change = EnvironmentChange { source: Some("sky:30".to_owned()), ..EnvironmentChange::default() };
        change.apply(&mut replaced).unwrap();
        assert_eq!((replaced.lights.len(), replaced.lights[0]), (2, sun(false)));
        let Light::Sun { direction, of_sky: true, .. } = replaced.lights[1] else { panic!() };
        assert!(direction.abs_diff_eq(-Vec3::new(0.0, 0.5, 0.75_f32.sqrt()), 1e-6), "{direction}");
        assert!(replaced.environment.is_some_and(|e| e.map.is_some()));

        let mut same = scene.clone();
        EnvironmentChange::default().apply(&mut same).unwrap();
        assert_eq!((same.lights, same.environment), (scene.lights, scene.environment));
    }
}
