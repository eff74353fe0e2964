//! OpenEXR files: a picture in the channels R, G and B, further channels, and text attributes.

use std::io::Cursor;
use std::path::Path;

use exr::meta::attribute::{AttributeValue, Text};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    ReadChannels as _, ReadLayers as _, Vec2, WritableImage as _,
};

use super::record::Record;
use super::{Film, FilmError, MAX_PIXELS};
use crate::crop::Crop;

/// A channel beside R, G and B.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Its name, such as `A` or `depth.Z`.
    pub name: String,
    /// One value per pixel, in row-major order.
    pub values: Vec<f32>,
}

/// The place of a picture in the image that it is a part of: data window and display window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// The pixels of the picture in the image.
    pub crop: Crop,
    /// Columns and rows of the image.
    pub size: [u32; 2],
}

/// All that an .exr of this program holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// The channels R, G and B.
    pub film: Film,
    /// All other channels.
    pub channels: Vec<Channel>,
    /// Text attributes that are not part of the record, with their names.
    pub attributes: Vec<(String, String)>,
    /// Where the picture lies in a larger image; none if it is whole.
    pub window: Option<Window>,
    /// What made the picture, if that is known.
    pub record: Option<Record>,
}

impl Picture {
    /// Writes an .exr, which replaces an existing file only when it is complete.
    ///
    /// # Errors
    /// Returns [`FilmError`] if a channel has another number of values than the film has pixels, or if writing
    /// fails.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), FilmError> {
        let path = path.as_ref();
        let failed = |cause| FilmError::Write { path: path.to_owned(), cause };
        let bytes = self.encode().map_err(failed)?;
        super::write(path, &bytes)
    }

    /// Returns the bytes of an .exr.
    ///
    /// # Errors
    /// Returns the cause if there are no pixels, or a channel has another number of values than the film has
    /// pixels.
    pub fn encode(&self) -> Result<Vec<u8>, String> {
        self.film.check_pixels()?;
        if let Some(bad) = self.channels.iter().find(|channel| channel.values.len() != self.film.pixels.len()) {
            return Err(format!("the channel {} has {} values", bad.name, bad.values.len()));
        }
        let mut attributes = self.attributes.clone();
        attributes.extend(self.record.iter().flat_map(Record::attributes));
        encode(&self.film, &self.channels, &attributes, self.window)
    }

    /// Reads an .exr (half or float; the first layer that has R, G and B).
    ///
    /// # Errors
    /// Returns [`FilmError::Read`] if the file cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, FilmError> {
        let path = path.as_ref();
        let read = std::fs::read(path).map_err(|e| e.to_string()).and_then(|bytes| Self::decode(&bytes));
        read.map_err(|cause| FilmError::Read { path: path.to_owned(), cause })
    }

    /// Reads the bytes of an .exr as [`Self::load`] does.
    ///
    /// # Errors
    /// Returns the cause if the bytes are not such an .exr.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
        let pixels = meta.headers.iter().map(|h| h.layer_size.area() as u64).max().unwrap_or(0);
        if pixels > MAX_PIXELS {
            return Err(format!("{pixels} pixels are more than {MAX_PIXELS}"));
        }
        let image = exr::prelude::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            .from_buffered(Cursor::new(bytes))
            .map_err(|e| e.to_string())?;
        let position = |layer: &Layer<AnyChannels<FlatSamples>>, name: &str| {
            layer.channel_data.list.iter().position(|channel| channel.name == *name)
        };
        let rgb = |layer: &Layer<AnyChannels<FlatSamples>>| -> Option<[usize; 3]> {
            Some([position(layer, "R")?, position(layer, "G")?, position(layer, "B")?])
        };
        let wanted = "a layer with channels R, G and B is needed";
        let (layer, rgb) = image.layer_data.iter().find_map(|layer| Some((layer, rgb(layer)?))).ok_or(wanted)?;
        let list = &layer.channel_data.list;
        let [r, g, b] = rgb.map(|at| list[at].sample_data.values_as_f32());
        let pixels = r.zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect();
        let others = list.iter().enumerate().filter(|(at, _)| !rgb.contains(at));
        let channels = others
            .map(|(_, c)| Channel { name: c.name.to_string(), values: c.sample_data.values_as_f32().collect() })
            .collect();
        let text = |(name, value): (&Text, &AttributeValue)| match value {
            AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
            _ => None,
        };
        let attributes: Vec<_> =
            image.attributes.other.iter().chain(&layer.attributes.other).filter_map(text).collect();
        let record = Record::from_attributes(&attributes);
        let mut attributes: Vec<_> = attributes.into_iter().filter(|(name, _)| !Record::owns(name)).collect();
        attributes.sort();
        let film = Film { width: layer.size.width() as u32, height: layer.size.height() as u32, pixels };
        let window = window(&image.attributes, &layer.attributes, &film);
        Ok(Self { film, channels, attributes, window, record })
    }

    /// Returns the values of a channel.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|channel| channel.name == name).map(|channel| channel.values.as_slice())
    }
}

/// Returns text as an attribute holds it: characters beyond Latin-1 are escaped.
fn latin1(text: &str) -> Text {
    Text::new_or_none(text).unwrap_or_else(|| {
        let escaped = text.chars().map(|c| if c as u32 > 255 { c.escape_unicode().to_string() } else { c.to_string() });
        Text::from(escaped.collect::<String>().as_str())
    })
}

/// Returns the bytes of an .exr without checks.
pub(super) fn encode(
    film: &Film,
    channels: &[Channel],
    attributes: &[(String, String)],
    window: Option<Window>,
) -> Result<Vec<u8>, String> {
    let of_film = |name: &str, c: usize| {
        AnyChannel::new(name, FlatSamples::F32(film.pixels.iter().map(|pixel| pixel[c]).collect()))
    };
    let mut all = vec![of_film("R", 0), of_film("G", 1), of_film("B", 2)];
    all.extend(channels.iter().map(|c| AnyChannel::new(c.name.as_str(), FlatSamples::F32(c.values.clone()))));
    let layer = Layer::new(
        (film.width as usize, film.height as usize),
        LayerAttributes::default(),
        Encoding::SMALL_FAST_LOSSLESS,
        AnyChannels::sort(all.into()),
    );
    let mut image = Image::from_layer(layer);
    if let Some(Window { crop, size }) = window {
        image.layer_data.attributes.layer_position = Vec2(crop.x as i32, crop.y as i32);
        let size = Vec2(size[0] as usize, size[1] as usize);
        image.attributes.display_window = IntegerBounds::from_dimensions(size);
    }
    let texts = attributes.iter().map(|(name, text)| (latin1(name), AttributeValue::Text(latin1(text))));
    image.attributes.other.extend(texts);
    let mut bytes = Vec::new();
    image.write().to_buffered(Cursor::new(&mut bytes)).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// Returns where a picture lies in its display window; none if it fills the window, or leaves it.
fn window(image: &ImageAttributes, layer: &LayerAttributes, film: &Film) -> Option<Window> {
    let (shown, own) = (image.display_window, layer.layer_position - image.display_window.position);
    let [x, y] = [own.x(), own.y()].map(u32::try_from);
    let crop = Crop { x: x.ok()?, y: y.ok()?, width: film.width, height: film.height };
    let [Ok(width), Ok(height)] = [shown.size.width(), shown.size.height()].map(u32::try_from) else { return None };
    let part = crop != Crop::whole(width, height) && crop.fits(width, height);
    part.then_some(Window { crop, size: [width, height] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_keeps_channels_and_attributes() {
        let folder = std::env::temp_dir().join(format!("lightsheaf-exr-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.exr");
        let mut film = Film::new(3, 2);
        film.pixels[4] = [1.0, -2.5, 1e30];
        let values: Vec<f32> = (0..6).map(|n| n as f32 / 3.0).collect();
        let channels = vec![Channel { name: "depth.Z".to_owned(), values }];
        let attributes = vec![("note".to_owned(), "größer".to_owned())];
        let record = Record { command: "a \u{4e00}".to_owned(), ranges: vec![], ..Record::default() };
        let mut picture = Picture { film, channels, attributes, window: None, record: Some(record) };
        picture.save(&path).unwrap();
        assert_eq!(Picture::load(&path).unwrap().record, None, "a record without a range is none");
        picture.record = Some(Record {
            ranges: vec![crate::film::record::SampleRange { first: 1, last: 3 }],
            ..picture.record.unwrap()
        });
        picture.save(&path).unwrap();
        picture.record.as_mut().unwrap().command = "a \\u{4e00}".to_owned();
        assert_eq!(Picture::load(&path).unwrap(), picture);
        assert_eq!(picture.channel("depth.Z").map(|z| z[3]), Some(1.0));
        picture.window = Some(Window { crop: Crop { x: 4, y: 5, width: 3, height: 2 }, size: [9, 7] });
        picture.save(&path).unwrap();
        assert_eq!(Picture::load(&path).unwrap(), picture);
        let meta = exr::meta::MetaData::read_from_file(&path, false).unwrap();
        let (data, shown) =
            (meta.headers[0].own_attributes.layer_position, meta.headers[0].shared_attributes.display_window);
        assert_eq!((data, shown), (Vec2(4, 5), IntegerBounds::from_dimensions((9, 7))));

        picture.channels[0].values.pop();
        assert!(picture.save(&path).unwrap_err().to_string().contains("depth.Z has 5 values"));
        assert_eq!(Film::load(&path).unwrap(), picture.film, "the file is still there");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
