//! Images of linear radiance, and reading and writing their files.
//!
//! EXR stores every value as a 32-bit float. PNG stores values clipped to [0, 1] and encoded by the sRGB
//! transfer function (IEC 61966-2-1) in 8 bits; [`crate::tonemap`] writes it with an exposure and a tone
//! curve. Files are written under a temporary name and then renamed, so that no reader sees an incomplete
//! file.

pub mod cryptomatte;
pub mod exr;
pub mod filtered;
#[cfg(not(target_family = "wasm"))]
pub mod oidn;
pub mod record;

use std::path::{Path, PathBuf};

use crate::crop::Crop;

/// Bytes per pixel of a film on the device: a sum and its compensation (shaders/lib/pixels/film.wesl).
pub const DEVICE_BYTES: u64 = 24;

/// Largest number of pixels of an image file. Larger files are refused before memory is allocated.
const MAX_PIXELS: u64 = 1 << 28;

/// An image in linear Rec. 709 RGB, row 0 on top.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Film {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Pixels in row-major order, `width * height` of them.
    pub pixels: Vec<[f32; 3]>,
}

/// An error in reading or writing an image file.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The file extension is unknown.
    #[error("{}: unknown image format; end the name in {expected}", path.display())]
    Format {
        /// Path of the file.
        path: PathBuf,
        /// Known extensions.
        expected: &'static str,
    },
    /// The file could not be read.
    #[error("{}: the image cannot be read: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the failure.
        cause: String,
    },
    /// A picture, or another file, could not be written.
    #[error("{}: cannot be written: {cause}", path.display())]
    Write {
        /// Path of the file.
        path: PathBuf,
        /// Reason of the failure, and what to do.
        cause: String,
    },
}

impl Film {
    /// Returns the pixels of a crop, which has to lie in the film; without one, the film.
    #[must_use]
    pub fn cropped(self, crop: Option<Crop>) -> Self {
        let Some(crop) = crop else { return self };
        let pixels = crop.pixels(self.width).map(|pixel| self.pixels[pixel as usize]).collect();
        Self { width: crop.width, height: crop.height, pixels }
    }

    /// Creates a black image.
    #[must_use]
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, pixels: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// Returns the image multiplied by a factor.
    #[must_use]
    pub fn scaled(&self, factor: f32) -> Self {
        let pixels = self.pixels.iter().map(|pixel| pixel.map(|value| value * factor)).collect();
        Self { width: self.width, height: self.height, pixels }
    }

    /// Returns the number of channel values that are NaN or infinite.
    #[must_use]
    pub fn non_finite(&self) -> u64 {
        self.pixels.iter().flatten().filter(|v| !v.is_finite()).count() as u64
    }

    /// Writes .exr (32-bit float) or .png (exposure 0 stops, clipped, sRGB), by extension.
    ///
    /// # Errors
    /// Returns [`FilmError`] if the extension is unknown or writing fails.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FilmError> {
        self.save_by(path.as_ref(), &|film| film.to_srgb8(1.0))
    }

    /// Writes as [`Film::save`], with another encoding to 8-bit RGB for .png.
    pub(crate) fn save_by(&self, path: &Path, encode: &dyn Fn(&Self) -> Vec<u8>) -> Result<(), FilmError> {
        let png = match extension(path).as_str() {
            "exr" => false,
            "png" => true,
            _ => return Err(FilmError::Format { path: path.to_owned(), expected: ".exr or .png" }),
        };
        let failed = |cause| FilmError::Write { path: path.to_owned(), cause };
        self.check_pixels().map_err(failed)?;
        let bytes = if png { self.encode_png(encode(self)) } else { exr::encode(self, &[], &[], None) };
        let bytes = bytes.map_err(failed)?;
        write(path, &bytes)
    }

    /// Reads .exr (half or float RGB, first layer), .hdr, or .png (decoded from the encoding of
    /// [`Film::save`]), by extension.
    ///
    /// # Errors
    /// Returns [`FilmError`] if the extension is unknown or the file cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, FilmError> {
        let path = path.as_ref();
        match extension(path).as_str() {
            "exr" => return exr::Picture::load(path).map(|picture| picture.film),
            "hdr" => read_raster(path, image::ImageFormat::Hdr),
            "png" => read_raster(path, image::ImageFormat::Png),
            _ => return Err(FilmError::Format { path: path.to_owned(), expected: ".exr, .hdr or .png" }),
        }
        .map_err(|cause| FilmError::Read { path: path.to_owned(), cause })
    }

    /// Returns 8-bit sRGB of the values times `exposure`, clipped. NaN becomes black.
    #[must_use]
    pub fn to_srgb8(&self, exposure: f32) -> Vec<u8> {
        self.pixels.iter().flatten().map(|v| (srgb_from_linear(v * exposure) * 255.0 + 0.5) as u8).collect()
    }

    /// Checks that there is a pixel, and one for each place.
    fn check_pixels(&self) -> Result<(), String> {
        let pixels = u64::from(self.width) * u64::from(self.height);
        if pixels > 0 && self.pixels.len() as u64 == pixels {
            return Ok(());
        }
        Err(format!("{} pixels are not {} x {}", self.pixels.len(), self.width, self.height))
    }

    fn encode_png(&self, encoded: Vec<u8>) -> Result<Vec<u8>, String> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::RgbImage::from_raw(self.width, self.height, encoded).ok_or("too large")?;
        image.write_to(&mut bytes, image::ImageFormat::Png).map_err(|e| e.to_string())?;
        Ok(bytes.into_inner())
    }
}

/// Writes the bytes of a file as [`replace`] does.
///
/// # Errors
/// As [`replace`].
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), FilmError> {
    replace(path, &|temporary| std::fs::write(temporary, bytes).map_err(|e| e.to_string()))
}

/// Writes a file by `write` under a temporary name, and then renames it, so that an existing file is only
/// replaced by a complete one.
///
/// # Errors
/// Returns [`FilmError::Write`] with the cause; the temporary file is removed.
pub fn replace(path: &Path, write: &dyn Fn(&Path) -> Result<(), String>) -> Result<(), FilmError> {
    let temporary = part_of(path);
    // The data is on the disk before the name is: a crash of the machine leaves the old file or the new one.
    let sync = || std::fs::File::options().write(true).open(&temporary).and_then(|file| file.sync_all());
    let written = write(&temporary)
        .and_then(|()| sync().and_then(|()| std::fs::rename(&temporary, path)).map_err(|e| e.to_string()));
    written.map_err(|cause| {
        // Removal is a best effort: the first error is the one that is reported.
        let _ = std::fs::remove_file(&temporary);
        let cause = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
                format!("the folder {} does not exist; create it first", folder.display())
            }
            _ => cause,
        };
        FilmError::Write { path: path.to_owned(), cause }
    })
}

/// Returns the temporary name of a file that is being written, in the same folder.
#[must_use]
pub fn part_of(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    path.with_file_name(name)
}

/// Encodes a value by sRGB's transfer function, clipped to [0, 1].
pub(crate) fn srgb_from_linear(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_from_linear`].
fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// True if the name of a file ends in an extension, such as `exr`, in capitals or not.
#[must_use]
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

fn read_raster(path: &Path, format: image::ImageFormat) -> Result<Film, String> {
    let file = std::fs::File::open(path).map_err(|e| e.to_string())?;
    let mut reader = image::ImageReader::with_format(std::io::BufReader::new(file), format);
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_PIXELS * 12);
    reader.limits(limits);
    let decoded = reader.decode().map_err(|e| e.to_string())?;
    let rgb = decoded.into_rgb32f();
    let (width, height) = rgb.dimensions();
    let decode: fn(f32) -> f32 = if format == image::ImageFormat::Png { linear_from_srgb } else { |v| v };
    let pixels = rgb.as_raw().chunks_exact(3).map(|p| [decode(p[0]), decode(p[1]), decode(p[2])]).collect();
    Ok(Film { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crop_is_cut_out() {
        let mut film = Film::new(4, 3);
        film.pixels[9] = [7.0; 3];
        let cut = film.clone().cropped(Some(Crop { x: 1, y: 2, width: 3, height: 1 }));
        assert_eq!((cut.width, cut.height, cut.pixels), (3, 1, vec![[7.0; 3], [0.0; 3], [0.0; 3]]));
        assert_eq!(film.clone().cropped(None), film);
    }

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("lightsheaf-film-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn exr_keeps_every_bit() {
        let folder = folder("exr");
        let mut film = Film::new(5, 3);
        for (i, p) in film.pixels.iter_mut().enumerate() {
            *p = [i as f32 * 0.1, -1e-7, 3.0e8];
        }
        let path = folder.join("a.EXR");
        film.save(&path).unwrap();
        assert_eq!(Film::load(&path).unwrap(), film);
        let left: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(left, ["a.EXR"], "nothing but the image is left behind");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn png_is_clipped_srgb() {
        let folder = folder("png");
        let mut film = Film::new(3, 1);
        film.pixels = vec![[0.0, 1.0, 7.0], [0.214_041_14, 0.002, -1.0], [f32::NAN, f32::INFINITY, 0.5]];
        // 0.21404114 is 0.5 in sRGB; 0.002 is on the linear segment, 12.92 * 0.002 * 255 = 6.6; 0.5 is 0.7354
        // in sRGB.
        assert_eq!(film.to_srgb8(1.0), [0, 255, 255, 128, 7, 0, 0, 255, 188]);
        let path = folder.join("a.png");
        film.save(&path).unwrap();
        let back = Film::load(&path).unwrap();
        assert!((back.pixels[1][0] - 0.2159).abs() < 1e-3, "128 / 255 decoded, {}", back.pixels[1][0]);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn errors_name_the_file_and_leave_nothing() {
        let folder = folder("errors");
        let film = Film::new(2, 2);
        let unknown = film.save(folder.join("a.jpg")).unwrap_err().to_string();
        assert!(unknown.contains("a.jpg") && unknown.contains(".exr or .png"), "{unknown}");
        let missing = film.save(folder.join("no/a.exr")).unwrap_err().to_string();
        assert!(missing.contains("does not exist"), "{missing}");
        assert!(Film::load(folder.join("a.exr")).unwrap_err().to_string().contains("a.exr"));
        std::fs::write(folder.join("cut.exr"), [0x76, 0x2f, 0x31, 0x01, 2]).unwrap();
        assert!(Film::load(folder.join("cut.exr")).is_err());
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "only the file that this test wrote");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn non_finite_values_are_counted() {
        let mut film = Film::new(2, 1);
        assert_eq!(film.non_finite(), 0);
        film.pixels[1] = [f32::NAN, 1.0, f32::NEG_INFINITY];
        assert_eq!(film.non_finite(), 2);
    }
}
