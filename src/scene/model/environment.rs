//! Environment lights: constant or mapped radiance from infinity.

use std::f32::consts::{PI, TAU};
use std::path::Path;

use glam::{DVec3, Mat3, Vec2, Vec3};
use image::ImageDecoder as _;
use rayon::prelude::*;

use crate::scene::model::error::LoadError;
use crate::scene::model::texture::{linear_from_srgb, reserve};

/// Placement of the first and the last row of an equirectangular map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rows {
    /// Row r spans polar angles pi r / H to pi (r + 1) / H; its value applies to the middle.
    Centred,
    /// Row 0 lies at the upper pole and row H - 1 at the lower one (Mitsuba's `envmap`).
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
    /// Placement of the rows.
    pub rows: Rows,
}

/// A constant or mapped sky.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Multiplies the map, or is the radiance itself if there is no map.
    pub radiance: Vec3,
    /// The map, if not constant.
    pub map: Option<EnvironmentMap>,
    /// Rotation from the map's space to the world.
    pub world_from_environment: Mat3,
}

impl Environment {
    /// Returns the radiance that arrives along `-direction`, a unit vector in world space.
    #[must_use]
    pub fn seen(&self, direction: Vec3) -> Vec3 {
        let Some(map) = &self.map else { return self.radiance };
        let at = self.coordinates(direction);
        let (height, width) = (i64::from(map.height), i64::from(map.width));
        let y = match map.rows {
            Rows::Centred => at.y * map.height as f32 - 0.5,
            Rows::AtPoles => at.y * (map.height - 1) as f32,
        };
        let x = at.x * map.width as f32 - 0.5;
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let texel = |dx: i64, dy: i64| {
            let column = (x.floor() as i64 + dx).rem_euclid(width);
            let row = (y.floor() as i64 + dy).clamp(0, height - 1);
            Vec3::from(map.texels[(row * width + column) as usize])
        };
        let above = texel(0, 0) * (1.0 - fx) + texel(1, 0) * fx;
        let below = texel(0, 1) * (1.0 - fx) + texel(1, 1) * fx;
        self.radiance * (above * (1.0 - fy) + below * fy)
    }

    /// Returns the u and v coordinates in the map of a unit direction in world space.
    #[must_use]
    pub fn coordinates(&self, direction: Vec3) -> Vec2 {
        let d = self.world_from_environment.transpose() * direction;
        let u = (d.x.atan2(-d.z) / TAU).rem_euclid(1.0);
        Vec2::new(u, d.y.clamp(-1.0, 1.0).acos() / PI)
    }

    /// Returns the mean radiance over all directions, of a map with rows at the poles as if they were centred.
    #[must_use]
    pub fn mean(&self) -> Vec3 {
        let Some(map) = &self.map else { return self.radiance };
        let rows = map.texels.par_chunks(map.width as usize).enumerate();
        let theta = |row: usize| (row as f32 + 0.5) / map.height as f32 * PI;
        let row = |(row, texels): (usize, &[[f32; 3]])| {
            let sine = f64::from(theta(row).sin());
            let sum: DVec3 = texels.iter().map(|&texel| Vec3::from(texel).as_dvec3()).sum();
            (sum * sine, sine * texels.len() as f64)
        };
        let (sum, weight) = rows.map(row).reduce(|| (DVec3::ZERO, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        self.radiance * (sum / weight).as_vec3()
    }
}

impl EnvironmentMap {
    /// Maximum number of texels. A larger map is an error, so that a small file cannot allocate arbitrary
    /// memory.
    pub const MAX_TEXELS: u64 = 1 << 28;

    /// Decodes a Radiance `.hdr` file, an OpenEXR file with red, green and blue, or an eight-bit image read as
    /// sRGB. The path names it in errors. Also returns a warning if there is no such radiance as a texel has:
    /// negative values, which lossy compression and sharp filters leave, and NaN become 0, and infinite ones, as
    /// the sun's in half precision, the largest other value.
    ///
    /// Rows are [`Rows::Centred`]; callers that know better overwrite the field.
    ///
    /// # Errors
    /// A file that is damaged, too large or without colour is an error.
    pub fn decode(bytes: &[u8], path: &Path) -> Result<(Self, Option<String>), LoadError> {
        let mut map = if bytes.starts_with(&EXR_MAGIC) { Self::decode_exr(bytes) } else { Self::decode_image(bytes) }
            .map_err(|cause| LoadError::new(path, cause))?;
        let values = map.texels.as_flattened_mut();
        let is_radiance = |value: f32| value.is_finite() && value >= 0.0;
        let wrong = values.iter().filter(|&&value| !is_radiance(value)).count();
        let warning = (wrong > 0).then(|| {
            let largest = values.iter().copied().filter(|value| value.is_finite()).fold(0.0, f32::max);
            for value in values.iter_mut().filter(|value| !is_radiance(**value)) {
                *value = if *value == f32::INFINITY { largest } else { 0.0 };
            }
            format!(
                "`{}`: {wrong} of {} values of the environment are negative or not finite; negative ones are drawn as 0, \
                 infinite ones as the largest other value",
                path.display(),
                values.len()
            )
        });
        Ok((map, warning))
    }

    fn decode_image(bytes: &[u8]) -> Result<Self, String> {
        let mut reader =
            image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(Self::MAX_TEXELS * 16);
        reader.limits(limits.clone());
        let failed = |e: image::ImageError| format!("the image cannot be decoded: {e}");
        let mut decoder = reader.into_decoder().map_err(failed)?;
        limits.reserve(decoder.total_bytes()).and_then(|()| decoder.set_limits(limits)).map_err(failed)?;
        // The pixels are converted and then copied.
        let _reserved = reserve(decoder.dimensions().into(), decoder.total_bytes(), 24)?;
        let decoded = image::DynamicImage::from_decoder(decoder).map_err(failed)?;
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
        use exr::prelude::{ReadChannels, ReadLayers, Vec2};
        let headers = exr::meta::MetaData::read_from_buffered(bytes, false).map_err(|e| e.to_string())?.headers;
        let Some(header) = headers.first() else { return Err("the file has no image".to_owned()) };
        let pixels = header.layer_size.0 as u64 * header.layer_size.1 as u64;
        if pixels == 0 || pixels > Self::MAX_TEXELS {
            return Err(format!("the image has {pixels} pixels; 1 to {} are supported", Self::MAX_TEXELS));
        }
        let side = |side: usize| u32::try_from(side).map_err(|_| format!("the image has {side} pixels along a side"));
        let size = [side(header.layer_size.0)?, side(header.layer_size.1)?];
        // Tiles and lines are decoded in parallel beside the image.
        let _reserved = reserve(size, 0, 2 * size_of::<[f32; 3]>() as u64)?;
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
