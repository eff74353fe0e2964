//! Images and their lookup.

use glam::{Affine2, Vec2};
use image::ImageDecoder as _;

use crate::scene::model::ktx2;
use crate::scene::model::memory::Reservation;

/// Eight-bit pixels, row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Its name or path.
    pub name: String,
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Row-major RGBA.
    pub texels: Vec<[u8; 4]>,
}

/// The wrap mode: the continuation of an image outside [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    /// The image repeats.
    Repeat,
    /// The image repeats mirrored.
    Mirror,
    /// The edge texel repeats.
    Clamp,
}

/// The texture filter. There are no mipmaps: averaging over samples replaces them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// Bilinear between texel centres; sRGB is decoded before filtering.
    Linear,
}

/// An image with its sampler.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Index into the scene's images.
    pub image: usize,
    /// Wrap mode along u and v.
    pub wrap: [Wrap; 2],
    /// Interpolation.
    pub filter: Filter,
    /// True if RGB is sRGB-encoded (alpha never is).
    pub srgb: bool,
}

/// A material's reference to a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into the scene's textures.
    pub texture: usize,
    /// Texture coordinate set, 0 or 1.
    pub uv_set: u32,
    /// KHR_texture_transform or Mitsuba's to_uv, applied to uv.
    pub transform: Affine2,
}

impl TextureRef {
    /// Refers to a texture by the first UV set, without transform.
    #[must_use]
    pub fn new(texture: usize) -> Self {
        Self { texture, uv_set: 0, transform: Affine2::IDENTITY }
    }

    /// Returns the image coordinates for a surface's texture coordinates.
    #[must_use]
    pub fn apply(&self, uvs: [Vec2; 2]) -> Vec2 {
        self.transform.transform_point2(uvs[self.uv_set as usize & 1])
    }
}

impl Image {
    /// Maximum number of pixels. A larger image is an error, so that a small file cannot allocate arbitrary
    /// memory.
    pub const MAX_PIXELS: u64 = 1 << 28;

    /// Decodes PNG, JPEG, WebP, KTX2, BMP, TGA or Radiance HDR (clamped to 1 and sRGB-encoded) by content, or by
    /// the name's extension.
    ///
    /// # Errors
    /// Bytes that are not such an image, or that need more memory than is free, are an error; the message is a
    /// sentence.
    pub fn decode(bytes: &[u8], name: &str) -> Result<Self, String> {
        // The pixels are converted and then copied.
        let (decoded, _reserved) = Self::open(bytes, name, 8)?;
        let rgba = decoded.into_rgba8();
        let (width, height) = rgba.dimensions();
        let texels = rgba.into_raw().chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
        Ok(Self { name: name.to_owned(), width, height, texels })
    }

    /// Decodes an image in the file's own bit depth. The memory that it needs, and `more` bytes per pixel for what
    /// is made of it, is reserved before it is allocated.
    pub(in crate::scene) fn open(
        bytes: &[u8],
        name: &str,
        more: u64,
    ) -> Result<(image::DynamicImage, Reservation), String> {
        if ktx2::is_ktx2(bytes) {
            return ktx2::decode(bytes, more);
        }
        let mut reader =
            image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format().map_err(|e| e.to_string())?;
        if reader.format().is_none()
            && let Ok(format) = image::ImageFormat::from_path(name)
        {
            reader.set_format(format);
        }
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(Self::MAX_PIXELS * 8);
        let failed = |e: image::ImageError| format!("the image cannot be decoded: {e}");
        reader.limits(limits.clone());
        let mut decoder = reader.into_decoder().map_err(failed)?;
        let (width, height) = decoder.dimensions();
        if width == 0 || height == 0 {
            return Err("the image has no pixels".to_owned());
        }
        limits.reserve(decoder.total_bytes()).and_then(|()| decoder.set_limits(limits)).map_err(failed)?;
        let reserved = reserve([width, height], decoder.total_bytes(), more)?;
        Ok((image::DynamicImage::from_decoder(decoder).map_err(failed)?, reserved))
    }
}

/// Reserves the memory of an image, and more per pixel.
pub(in crate::scene) fn reserve([width, height]: [u32; 2], bytes: u64, more: u64) -> Result<Reservation, String> {
    let bytes = bytes.saturating_add(u64::from(width) * u64::from(height) * more);
    let cause = |cause| format!("the image of {width} x {height} pixels {cause}: use smaller images");
    Reservation::new(bytes).map_err(cause)
}

/// Decodes an sRGB-encoded value to a linear one, both in [0, 1] (IEC 61966-2-1).
#[must_use]
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}
