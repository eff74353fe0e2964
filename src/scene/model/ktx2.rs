//! Images in KTX2 (Khronos KTX File Format Specification 2.0): Basis Universal (ETC1S and UASTC), and plain
//! 8-bit RGB and RGBA, with or without supercompression.
//!
//! The first mip level of a single two-dimensional image is decoded. Its transfer function is left to the
//! texture that uses it, as for images in other formats.

use std::borrow::Cow;
use std::io::Read;

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use image::{DynamicImage, RgbImage, RgbaImage};

use crate::scene::Image;
use crate::scene::model::memory::Reservation;
use crate::scene::model::texture::reserve;

/// The first bytes of every file.
const MAGIC: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// The cause of an error in a file that is shorter than it says.
const TRUNCATED: &str = "the KTX2 file is truncated: save it again";

/// The cause of an error in a file whose first level is shorter than its size demands.
const TOO_LITTLE: &str = "the KTX2 file has too little data for its pixels";

/// Returns true for the bytes of a KTX2 file.
pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(&MAGIC)
}

/// Decodes an image, with its memory and `more` bytes per pixel reserved; an error is the cause.
pub(super) fn decode(bytes: &[u8], more: u64) -> Result<(DynamicImage, Reservation), String> {
    let file = File::parse(bytes)?;
    let [width, height] = file.size;
    let pixels = u64::from(width) * u64::from(height);
    if pixels > Image::MAX_PIXELS {
        return Err(format!("{width} x {height} pixels are more than {}: save a smaller image", Image::MAX_PIXELS));
    }
    let reserved = reserve(file.size, 4 * pixels, more)?;
    let decoded = match file.format {
        Format::Etc1s | Format::Uastc => {
            RgbaImage::from_raw(width, height, file.decode_basis(bytes)?).map(DynamicImage::from)
        }
        Format::Rgba => RgbaImage::from_raw(width, height, file.decode_plain(4 * pixels)?).map(DynamicImage::from),
        Format::Rgb => RgbImage::from_raw(width, height, file.decode_plain(3 * pixels)?).map(DynamicImage::from),
    };
    Ok((decoded.ok_or_else(|| TOO_LITTLE.to_owned())?, reserved))
}

/// A supported format of texels.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Etc1s,
    Uastc,
    Rgb,
    Rgba,
}

/// The parts of a file that are read.
struct File<'a> {
    format: Format,
    size: [u32; 2],
    supercompression: u32,
    /// Bytes of the first mip level as stored, and their number without supercompression.
    level: &'a [u8],
    level_size: u64,
}

/// Reads the 32-bit integer at an offset.
fn word(bytes: &[u8], at: usize) -> Result<u32, String> {
    let word = bytes.get(at..).and_then(|rest| rest.first_chunk());
    Ok(u32::from_le_bytes(*word.ok_or(TRUNCATED)?))
}

/// Reads the 64-bit integer at an offset.
fn long_word(bytes: &[u8], at: usize) -> Result<u64, String> {
    Ok(u64::from(word(bytes, at)?) | u64::from(word(bytes, at + 4)?) << 32)
}

/// Returns some bytes of a file.
fn slice(bytes: &[u8], offset: u64, length: u64) -> Result<&[u8], String> {
    let range = usize::try_from(offset).ok().zip(usize::try_from(length).ok());
    let slice = range.and_then(|(offset, length)| bytes.get(offset..offset.checked_add(length)?));
    slice.ok_or_else(|| TRUNCATED.to_owned())
}

impl<'a> File<'a> {
    /// Parses the header (section 3 of the specification), the index of the first level, the data format
    /// descriptor, and the metadata.
    fn parse(bytes: &'a [u8]) -> Result<Self, String> {
        let size = [word(bytes, 20)?, word(bytes, 24)?];
        let [depth, layers, faces] = [word(bytes, 28)?, word(bytes, 32)?, word(bytes, 36)?];
        if size.contains(&0) || depth > 1 || layers > 1 || faces != 1 {
            return Err("the KTX2 file is an array, a cube map or a volume: save a single image".to_owned());
        }
        let part = |at| slice(bytes, word(bytes, at)?.into(), word(bytes, at + 4)?.into());
        // The third word of the first descriptor block has the colour model and, in the highest byte, flags.
        let model = word(part(48)?, 12)?;
        if model >> 24 & 1 != 0 {
            return Err("the colours of the KTX2 file are multiplied by alpha: save them without".to_owned());
        }
        check_metadata(part(56)?)?;
        let format = match (word(bytes, 12)?, model & 255) {
            (0, 163) => Format::Etc1s,
            (0, 166) => Format::Uastc,
            // VK_FORMAT_R8G8B8_UNORM and _SRGB, VK_FORMAT_R8G8B8A8_UNORM and _SRGB.
            (23 | 29, _) => Format::Rgb,
            (37 | 43, _) => Format::Rgba,
            (format, model) => {
                let cause = format!("the KTX2 format {format} of colour model {model} is not supported");
                return Err(format!("{cause}: save it as ETC1S, UASTC or R8G8B8A8"));
            }
        };
        let level = slice(bytes, long_word(bytes, 80)?, long_word(bytes, 88)?)?;
        Ok(Self { format, size, supercompression: word(bytes, 44)?, level, level_size: long_word(bytes, 96)? })
    }

    /// Decodes ETC1S and UASTC to RGBA.
    fn decode_basis(&self, bytes: &[u8]) -> Result<Vec<u8>, String> {
        // UASTC has 16 bytes for each block of 4 x 4 pixels. The transcoder allocates as many bytes as the file
        // says. ETC1S has no such bound, for a run of equal blocks takes a few bits.
        let [columns, rows] = self.size.map(|s| u64::from(s.div_ceil(4)));
        if self.format == Format::Uastc && self.level_size != 16 * columns * rows {
            return Err(damaged(format!("{} bytes for {columns} x {rows} blocks", self.level_size)));
        }
        let transcoder = Transcoder::new(bytes).map_err(|e| damaged(format!("{e:?}")))?;
        transcoder.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(|e| damaged(format!("{e:?}")))
    }

    /// Returns the given number of bytes of the first level.
    fn decode_plain(&self, length: u64) -> Result<Vec<u8>, String> {
        let data = match self.supercompression {
            0 => Cow::from(self.level),
            2 => {
                let decoder = ruzstd::StreamingDecoder::new(self.level).map_err(|e| damaged(e.to_string()))?;
                read(decoder, length)?.into()
            }
            3 => read(flate2::read::ZlibDecoder::new(self.level), length)?.into(),
            other => return Err(format!("the supercompression {other} of the KTX2 file is not supported")),
        };
        let data = usize::try_from(length).ok().and_then(|length| data.get(..length));
        data.map(<[u8]>::to_vec).ok_or_else(|| TOO_LITTLE.to_owned())
    }
}

/// Describes damage.
fn damaged(cause: String) -> String {
    format!("the KTX2 file is damaged ({cause}): save it again")
}

/// Reads at most the given number of bytes.
fn read(from: impl Read, length: u64) -> Result<Vec<u8>, String> {
    let mut out = Vec::new();
    from.take(length).read_to_end(&mut out).map_err(|e| damaged(e.to_string()))?;
    Ok(out)
}

/// Checks that texels are stored as other formats store them; KHR_texture_basisu allows nothing else.
fn check_metadata(mut entries: &[u8]) -> Result<(), String> {
    while !entries.is_empty() {
        let length = word(entries, 0)?;
        let entry = slice(entries, 4, length.into())?;
        for (key, value) in [("KTXorientation", "rd"), ("KTXswizzle", "rgba")] {
            let found = entry.strip_prefix(key.as_bytes()).and_then(|rest| rest.strip_prefix(b"\0"));
            if found.is_some_and(|found| !found.starts_with(value.as_bytes())) {
                return Err(format!("the {key} of the KTX2 file is not {value}: save it again"));
            }
        }
        // Entries are padded to four bytes, the last one not always.
        entries = entries.get(4 + entry.len().next_multiple_of(4)..).unwrap_or_default();
    }
    Ok(())
}
