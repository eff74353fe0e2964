//! Display of linear radiance in 8-bit sRGB: exposure, tone curve, transfer function.
//!
//! `render` and the viewer display pictures through the same [`Grade`]. EXR files store linear radiance
//! without one.
//!
//! [`auto_exposure`] chooses the exposure from the picture (Reinhard et al. 2002, *Photographic Tone
//! Reproduction for Digital Images*, eq. 1 and 2): it maps the log-average luminance to middle grey, [`KEY`]
//! = 0.18. The selection of the pixels that count is ours.
//!
//! | curve | applied to | source | display value of 0.18 in sRGB, 0 to 1 |
//! |---|---|---|---|
//! | `clip` | channel | IEC 61966-2-1 | 0.46 |
//! | `reinhard` | channel | Reinhard et al. 2002, eq. 3 | 0.43 |
//! | `aces` | colour | Stephen Hill's fit of the ACES 1.0 RRT and sRGB ODT | 0.50 |
//! | `agx` | colour | Troy Sobotka's AgX, its outset after Benjamin Wrensch | 0.50 |

use std::fmt;
use std::path::Path;
use std::str::FromStr;
use std::sync::LazyLock;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::film::{Film, FilmError, srgb_from_linear};
use crate::scene::LUMINANCE;

/// Linear value that the log-average luminance is mapped to: middle grey (Reinhard et al. 2002, section 3).
pub const KEY: f32 = 0.18;

/// Fraction of the brightest pixels that are ignored: emitters, highlights and fireflies.
pub const BRIGHTEST: f64 = 0.1;
/// Fraction of the darkest pixels that are ignored.
pub const DARKEST: f64 = 0.1;
/// Pixels that are more stops than this below the brightest tenth are ignored as empty background: 2^-10 is
/// about 1e-3.
pub const EMPTY_STOPS: u32 = 10;

/// Range of an exposure, stops.
pub const STOPS: std::ops::RangeInclusive<f32> = -32.0..=32.0;

/// Leading bits of the mantissa that index tables and histogram.
const MANTISSA: u32 = 8;
/// Entries of a table per stop.
const STEPS: u32 = 1 << MANTISSA;
/// Trailing bits of the mantissa, which are interpolated.
const BELOW: u32 = 23 - MANTISSA;

/// Tone curves for values above 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Tonemap {
    /// No curve: values above 1 are clipped.
    Clip,
    /// x / (1 + x) for each channel (Reinhard et al. 2002).
    Reinhard,
    /// The film curve of ACES 1.0 in Stephen Hill's fit: strong contrast, saturated colours.
    Aces,
    /// Troy Sobotka's AgX: bright colours desaturate towards white.
    #[default]
    Agx,
}

impl Tonemap {
    /// All tone curves.
    pub const ALL: [Self; 4] = [Self::Clip, Self::Reinhard, Self::Aces, Self::Agx];

    /// Returns the encoded colour, 0 to 1, of an exposed linear colour.
    fn encoded(self, color: Vec3) -> Vec3 {
        let x = color.min(Vec3::splat(LARGEST));
        let per_channel = |x: Vec3, curve: fn(f32) -> f32| Vec3::from_array(x.to_array().map(curve));
        match self {
            Self::Clip => per_channel(x, srgb_from_linear),
            Self::Reinhard => per_channel(x, |x| srgb_from_linear(reinhard(x))),
            Self::Aces => per_channel(*ACES_OUT * per_channel(*ACES_IN * x, aces), srgb_from_linear),
            Self::Agx => (*AGX_OUT * per_channel(*AGX_IN * x, agx)).clamp(Vec3::ZERO, Vec3::ONE),
        }
    }
}

impl fmt::Display for Tonemap {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Clip => "clip",
            Self::Reinhard => "reinhard",
            Self::Aces => "aces",
            Self::Agx => "agx",
        })
    }
}

/// Exposure of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Exposure {
    /// The exposure that [`auto_exposure`] chooses.
    #[default]
    Auto,
    /// Values are multiplied by 2 to the power of this.
    Stops(f32),
}

impl Exposure {
    /// Returns the exposure of a picture in stops.
    #[must_use]
    pub fn stops(self, film: &Film) -> f32 {
        match self {
            Self::Auto => auto_exposure(film),
            Self::Stops(stops) => stops,
        }
    }
}

impl fmt::Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Stops(stops) => stops.fmt(f),
        }
    }
}

impl FromStr for Exposure {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "auto" => Ok(Self::Auto),
            _ => match text.parse() {
                Ok(stops) if STOPS.contains(&stops) => Ok(Self::Stops(stops)),
                _ => Err("has to be `auto` or -32 to 32 stops"),
            },
        }
    }
}

/// Exposure and tone curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grade {
    /// Values are multiplied by 2 to the power of this.
    pub stops: f32,
    /// Tone curve that follows.
    pub tonemap: Tonemap,
}

impl Grade {
    /// No exposure and no curve: the encoding of [`Film::save`] for PNG files, which [`Film::load`] inverts.
    pub const PLAIN: Self = Self { stops: 0.0, tonemap: Tonemap::Clip };

    /// Returns 8-bit sRGB of a linear colour. NaN and negative channels become 0.
    #[must_use]
    pub fn shown(&self, color: [f32; 3]) -> [u8; 3] {
        bytes(self.tonemap.encoded(exposed(color, self.stops.exp2())))
    }

    /// Returns 8-bit sRGB of a whole picture, row 0 on top. It evaluates [`Grade::shown`] by tables, so that
    /// a value close to a rounding boundary may differ by one.
    #[must_use]
    pub fn picture(&self, film: &Film) -> Vec<u8> {
        let (scale, tables) = (self.stops.exp2(), &TABLES[self.tonemap as usize]);
        let mut out = vec![0; film.pixels.len() * 3];
        out.par_chunks_mut(3 * CHUNK).zip(film.pixels.par_chunks(CHUNK)).for_each(|(out, pixels)| {
            for (out, &pixel) in out.chunks_exact_mut(3).zip(pixels) {
                out.copy_from_slice(&bytes(tables.encoded(exposed(pixel, scale))));
            }
        });
        out
    }
}

impl Film {
    /// Writes as [`Film::save`], with exposure and tone curve for .png; .exr stores linear radiance.
    ///
    /// # Errors
    /// Returns [`FilmError`] if the extension is unknown or writing fails.
    pub fn save_graded(&self, path: impl AsRef<Path>, grade: &Grade) -> Result<(), FilmError> {
        self.save_by(path.as_ref(), &|film| grade.picture(film))
    }
}

/// Returns the exposure that maps the log-average luminance of a picture to [`KEY`], in stops. It is rounded
/// to hundredths, so that the printed value reproduces the picture.
///
/// Pixels are ignored if they are black or not finite; of the others, if they are more than [`EMPTY_STOPS`]
/// below the [`BRIGHTEST`] tenth; and of the remaining ones, the brightest and the [`DARKEST`] tenth. If no
/// pixel is left, the exposure is 0.
#[must_use]
pub fn auto_exposure(film: &Film) -> f32 {
    // The leading bits of a positive f32 index bins of its logarithm: a factor of 2 is exactly STEPS bins.
    let mut bins = vec![0_u32; 1 << (8 + MANTISSA)];
    for &pixel in &film.pixels {
        let luminance = Vec3::from_array(pixel).dot(LUMINANCE);
        if luminance.is_finite() && luminance >= f32::MIN_POSITIVE {
            bins[(luminance.to_bits() >> BELOW) as usize] += 1;
        }
    }
    let mut bins: Vec<(usize, f64)> =
        bins.into_iter().enumerate().filter(|(_, n)| *n > 0).map(|(bin, n)| (bin, f64::from(n))).collect();
    bins.reverse();
    let mut brightest = bins.clone();
    let lamps = BRIGHTEST * count(&bins);
    trim(&mut brightest, lamps);
    let Some(&(brightest, _)) = brightest.first() else { return 0.0 };
    bins.retain(|(bin, _)| bin + (EMPTY_STOPS * STEPS) as usize >= brightest);
    let [lamps, shadows] = [BRIGHTEST, DARKEST].map(|share| share * count(&bins));
    trim(&mut bins, lamps);
    bins.reverse();
    trim(&mut bins, shadows);

    // A bin is represented by the logarithm of its centre.
    let log2 = |bin: usize| f64::from(f32::from_bits(((bin as u32) << BELOW) | (1 << (BELOW - 1)))).log2();
    let log_average = bins.iter().map(|&(bin, n)| n * log2(bin)).sum::<f64>() / count(&bins); // eq. 1, in stops
    let stops = f64::from(KEY).log2() - log_average; // eq. 2
    let stops = stops.clamp((*STOPS.start()).into(), (*STOPS.end()).into());
    if !stops.is_finite() {
        return 0.0;
    }
    // Adding 0 turns -0 into 0.
    ((stops * 100.0).round() / 100.0) as f32 + 0.0
}

/// Returns the number of pixels in bins.
fn count(bins: &[(usize, f64)]) -> f64 {
    bins.iter().map(|(_, n)| n).sum()
}

/// Removes a number of pixels, starting at the first bins.
fn trim(bins: &mut Vec<(usize, f64)>, mut pixels: f64) {
    for (_, n) in bins.iter_mut() {
        let taken = pixels.min(*n);
        *n -= taken;
        pixels -= taken;
    }
    bins.retain(|(_, n)| *n > 0.0);
}

/// Number of pixels that a thread processes at once.
const CHUNK: usize = 4096;
/// Exponents that tables cover; smaller values are encoded as 0, larger ones as the largest.
const EXPONENTS: std::ops::Range<i32> = -20..17;
/// Largest covered value; beyond it no curve changes by half a byte.
const LARGEST: f32 = (1 << (EXPONENTS.end - 1)) as f32;

fn exposed(color: [f32; 3], scale: f32) -> Vec3 {
    // max() also maps NaN to 0.
    Vec3::from_array(color.map(|v| (v * scale).max(0.0)))
}

fn bytes(encoded: Vec3) -> [u8; 3] {
    encoded.to_array().map(|v| (v * 255.0 + 0.5) as u8)
}

/// Returns L / (1 + L) (Reinhard et al. 2002, eq. 3). The paper's L is luminance; applied to each channel,
/// the curve does not clip saturated lights.
fn reinhard(x: f32) -> f32 {
    x / (1.0 + x)
}

/// Matrix from linear sRGB to the primaries of the fit, with its scale. The fit alone maps 0.18 to 0.10, for
/// dark cinemas; division by 0.6 maps middle grey to 0.21, as in three.js.
static ACES_IN: LazyLock<Mat3> = LazyLock::new(|| {
    Mat3::from_cols_array_2d(&[[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
        .transpose()
        * (1.0 / 0.6)
});
/// Matrix from the primaries of the fit to linear sRGB.
static ACES_OUT: LazyLock<Mat3> = LazyLock::new(|| {
    Mat3::from_cols_array_2d(&[
        [1.60475, -0.53108, -0.07367],
        [-0.10208, 1.10813, -0.00605],
        [-0.00327, -0.07276, 1.07602],
    ])
    .transpose()
});

/// RRT and ODT of ACES 1.0 in Stephen Hill's fit (BakingLab, ACES.hlsl), between [`ACES_IN`] and
/// [`ACES_OUT`]. Narkowicz's curve (2015) is applied to each channel of sRGB; this one desaturates bright
/// colours, as the transform does that both approximate.
fn aces(x: f32) -> f32 {
    (x * (x + 0.024_578_6) - 0.000_090_537) / (x * (0.983_729 * x + 0.432_951) + 0.238_081)
}

/// Inset of AgX: rows of the matrix of `AgX Log (Kraken)` in config.ocio (Troy Sobotka, AgX, 2022).
const AGX_INSET: [[f32; 3]; 3] = [
    [0.842_479_06, 0.078_433_6, 0.079_223_745],
    [0.042_328_242, 0.878_468_64, 0.079_166_13],
    [0.042_375_655, 0.078_433_6, 0.879_143],
];
static AGX_IN: LazyLock<Mat3> = LazyLock::new(|| Mat3::from_cols_array_2d(&AGX_INSET).transpose());
/// The outset inverts the inset on encoded values (Wrensch 2023, *Minimal AgX Implementation*). Sobotka's
/// configuration of 2022 has none and gives paler colours.
static AGX_OUT: LazyLock<Mat3> = LazyLock::new(|| AGX_IN.inverse());

/// Range of the log encoding in stops, around middle grey: log2(0.18) - 10 and log2(0.18) + 6.5
/// (config.ocio).
const AGX_STOPS: [f32; 2] = [-12.473_93, 4.026_069];

/// Log encoding and contrast curve of AgX. The curve is AgX_Default_Contrast.spi1d in closed form: a line of
/// slope 2 through (10 / 16.5, 0.5), bent to pass through (0, 0) with power 3 and through (1, 1) with power
/// 3.25. The result is a display-encoded value.
fn agx(x: f32) -> f32 {
    const PIVOT: f32 = 10.0 / 16.5;
    let [least, most] = AGX_STOPS;
    let x = ((x.max(f32::MIN_POSITIVE).log2() - least) / (most - least)).clamp(0.0, 1.0);
    let (length, power) = if x < PIVOT { (PIVOT, 3.0) } else { (1.0 - PIVOT, 3.25) };
    let away = 2.0 * (x - PIVOT);
    // The divisor is 1 at the pivot; at the end of the curve it reduces the line from 0.5 + 2 * length to 1.
    let bend = ((4.0 * length).powf(power) - 1.0) / length.powf(power);
    0.5 + away * (1.0 + bend * (x - PIVOT).abs().powf(power)).powf(-1.0 / power)
}

/// A function tabulated over the leading bits of its argument with linear interpolation, accurate to 1e-3 of
/// a byte.
struct Table(Vec<f32>);

impl Table {
    fn new(function: impl Fn(f32) -> f32) -> Self {
        let first = Self::first();
        let count = EXPONENTS.len() as u32 * STEPS;
        let entry = |n| function(if n == 0 { 0.0 } else { f32::from_bits((first + n) << BELOW) });
        Self((0..=count).map(entry).collect())
    }

    fn first() -> u32 {
        ((127 + EXPONENTS.start) as u32) << MANTISSA
    }

    /// Returns the function of a value of at least 0.
    fn look_up(&self, value: f32) -> f32 {
        let bits = value.to_bits();
        let Some(index) = (bits >> BELOW).checked_sub(Self::first()) else { return self.0[0] };
        let index = index as usize;
        match self.0.get(index..=index + 1) {
            Some(&[a, b]) => a + (b - a) * ((bits & ((1 << BELOW) - 1)) as f32 / (1 << BELOW) as f32),
            _ => self.0[self.0.len() - 1],
        }
    }

    fn of(&self, color: Vec3) -> Vec3 {
        Vec3::from_array(color.to_array().map(|v| self.look_up(v)))
    }
}

/// A tone map as tables: a curve for each channel, between two matrices if it mixes channels.
struct Tables {
    curve: Table,
    mixed: Option<(Mat3, Mat3)>,
    /// Transfer function of the display, if the curve does not include it.
    encoding: Option<Table>,
}

/// Tables in the order of [`Tonemap`].
static TABLES: LazyLock<[Tables; 4]> = LazyLock::new(|| {
    Tonemap::ALL.map(|tonemap| match tonemap {
        Tonemap::Clip => Tables { curve: Table::new(srgb_from_linear), mixed: None, encoding: None },
        Tonemap::Reinhard => {
            Tables { curve: Table::new(|x| srgb_from_linear(reinhard(x))), mixed: None, encoding: None }
        }
        Tonemap::Aces => Tables {
            curve: Table::new(aces),
            mixed: Some((*ACES_IN, *ACES_OUT)),
            encoding: Some(Table::new(srgb_from_linear)),
        },
        Tonemap::Agx => Tables { curve: Table::new(agx), mixed: Some((*AGX_IN, *AGX_OUT)), encoding: None },
    })
});

impl Tables {
    fn encoded(&self, color: Vec3) -> Vec3 {
        let color = color.min(Vec3::splat(LARGEST));
        let Some((before, after)) = &self.mixed else { return self.curve.of(color) };
        let mixed = (*after * self.curve.of(*before * color)).max(Vec3::ZERO);
        self.encoding.as_ref().map_or(mixed, |encoding| encoding.of(mixed)).min(Vec3::ONE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Colour, and its 8-bit values without rounding by clip, Reinhard, ACES and AgX.
    type Row = ([f32; 3], [[f32; 3]; 4]);

    /// Computed in f64, independently of this program, from the published definitions: IEC 61966-2-1;
    /// Reinhard et al. 2002, eq. 3; the constants of Hill's ACES.hlsl and a factor of 1 / 0.6; the matrix of
    /// Sobotka's config.ocio, his table AgX_Default_Contrast.spi1d (February 2022, 4096 entries, linear in
    /// between) and Wrensch's outset matrix.
    const PUBLISHED: [Row; 9] = [
        ([0.18; 3], [[117.65; 3], [108.87; 3], [127.24; 3], [127.5; 3]]),
        ([1.0; 3], [[255.0; 3], [187.52; 3], [226.38; 3], [200.82; 3]]),
        ([0.02; 3], [[38.68; 3], [38.25; 3], [20.52; 3], [40.37; 3]]),
        ([16.0; 3], [[255.0; 3], [248.29; 3], [255.0; 3], [254.88; 3]]),
        ([1.0, 0.0, 0.0], [[255.0, 0.0, 0.0], [187.52, 0.0, 0.0], [250.16, 16.34, 20.33], [219.62, 58.54, 58.58]]),
        ([0.0, 1.0, 0.0], [[0.0, 255.0, 0.0], [0.0, 187.52, 0.0], [147.36, 227.84, 88.8], [80.41, 211.87, 80.43]]),
        ([0.0, 0.0, 1.0], [[0.0, 0.0, 255.0], [0.0, 0.0, 187.52], [0.0, 0.0, 227.61], [80.78, 80.77, 211.75]]),
        ([10.0, 0.0, 0.0], [[255.0, 0.0, 0.0], [244.53, 0.0, 0.0], [255.0, 212.92, 155.18], [255.0, 161.01, 161.07]]),
        (
            [4.0, 2.0, 0.5],
            [[255.0, 255.0, 187.52], [231.11, 213.18, 156.19], [251.76, 242.55, 216.68], [242.94, 225.45, 184.85]],
        ),
    ];

    #[test]
    fn curves_have_their_published_values() {
        for (color, rows) in PUBLISHED {
            for (tonemap, expected) in Tonemap::ALL.into_iter().zip(rows) {
                let actual = tonemap.encoded(Vec3::from(color)) * 255.0;
                let away = (actual - Vec3::from(expected)).abs().max_element();
                assert!(away < 0.1, "{tonemap} of {color:?}: {actual}, not {expected:?}");
            }
        }
    }

    /// Entries 0, 410, 1024, 1638, 2048, 2482, 3072, 3686 and 4095 of AgX_Default_Contrast.spi1d
    /// (sobotka/AgX, February 2022).
    #[test]
    fn the_curve_of_agx_is_the_published_table_and_near_the_published_polynomial() {
        let table = [
            (0, 0.0),
            (410, 0.008_137_8),
            (1024, 0.039_030_5),
            (1638, 0.141_617_3),
            (2048, 0.292_896_4),
            (2482, 0.500_088_8),
            (3072, 0.777_692_9),
            (3686, 0.954_666),
            (4095, 1.0),
        ];
        let [least, most] = AGX_STOPS;
        let curve = |x: f32| agx((least + x * (most - least)).exp2());
        for (index, expected) in table {
            let actual = curve(index as f32 / 4095.0);
            assert!((actual - expected).abs() < 1e-5, "{index}: {actual}, not {expected}");
        }
        // Coefficients of Wrensch's polynomial of degree 6.
        let coefficients = [15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232];
        let square = |i: u16| {
            let x = f32::from(i) / 1000.0;
            (coefficients.iter().fold(0.0, |sum, c| sum * x + c) - curve(x)).powi(2)
        };
        let mean = (0..=1000).map(square).sum::<f32>() / 1001.0;
        assert!(mean < 1e-5, "{mean}");
    }

    /// The tables match the curves to a hundredth of a byte, so that only values close to a rounding boundary
    /// may differ.
    #[test]
    fn pictures_are_what_pixels_are() {
        let value = |i: usize| (i as f32 * 0.01).powi(4) * 1e-3;
        let pixels = (0..4000).map(|i| [value(i), value((i * 7) % 4000), value((i * 31) % 1000)]).collect();
        let film = Film { width: 4000, height: 1, pixels };
        for tonemap in Tonemap::ALL {
            let tables = &TABLES[tonemap as usize];
            for &pixel in &film.pixels {
                let exact = tonemap.encoded(Vec3::from(pixel));
                let away = (tables.encoded(Vec3::from(pixel)).clamp(Vec3::ZERO, Vec3::ONE) - exact).abs().max_element();
                assert!(away * 255.0 < 0.01, "{tonemap} of {pixel:?}: {exact}");
            }
            for stops in [-32.0, -3.0, 0.0, 2.5, 32.0] {
                let grade = Grade { stops, tonemap };
                let exact = film.pixels.iter().flat_map(|&pixel| grade.shown(pixel));
                let near = |(a, b): (u8, &u8)| a.abs_diff(*b) <= 1;
                assert!(exact.zip(&grade.picture(&film)).all(near), "{tonemap} {stops}");
            }
        }
        assert_eq!(Grade::PLAIN.shown([0.214_041_14, 0.002, 0.5]).to_vec(), [128, 7, 188]);
    }

    #[test]
    fn what_is_no_colour_is_black_and_what_is_too_bright_white() {
        let pixels = vec![[f32::NAN; 3], [-1.0; 3], [0.0; 3], [f32::INFINITY; 3], [f32::MAX; 3]];
        let film = Film { width: 5, height: 1, pixels };
        for tonemap in Tonemap::ALL {
            for stops in [0.0, 32.0] {
                let grade = Grade { stops, tonemap };
                let expected = [[0; 9].as_slice(), &[255; 6]].concat();
                assert_eq!(grade.picture(&film), expected, "{tonemap} {stops}");
                let shown: Vec<u8> = film.pixels.iter().flat_map(|&pixel| grade.shown(pixel)).collect();
                assert_eq!(shown, expected, "{tonemap} {stops}");
            }
        }
    }

    #[test]
    fn greys_rise() {
        for tonemap in Tonemap::ALL {
            let bytes: Vec<u8> =
                (0..=6000).map(|i| Grade { stops: 0.0, tonemap }.shown([i as f32 * 0.003; 3])[1]).collect();
            assert!(bytes.is_sorted(), "{tonemap}");
        }
    }

    /// A picture with luminances within two stops around 0.1.
    fn room() -> Film {
        let pixel = |i: u32| {
            let value = 0.1 * (((i * 37) % 101) as f32 / 25.0 - 2.0).exp2();
            [1.2 * value, value, 0.7 * value]
        };
        Film { width: 100, height: 100, pixels: (0..10_000).map(pixel).collect() }
    }

    #[test]
    fn auto_exposure_makes_the_average_middle_grey() {
        let grey = |value: f32| Film { width: 8, height: 8, pixels: vec![[value; 3]; 64] };
        for (value, stops) in [(0.18, 0.0), (0.09, 1.0), (0.36, -1.0), (18.0, -6.64), (1e-6, 17.46)] {
            assert!((auto_exposure(&grey(value)) - stops).abs() < 0.011, "{value}: {}", auto_exposure(&grey(value)));
        }
        for value in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(auto_exposure(&grey(value)), 0.0, "{value}");
        }
        assert_eq!(auto_exposure(&Film::default()), 0.0);
        assert_eq!(auto_exposure(&grey(1e-30)), *STOPS.end());
        assert_eq!(auto_exposure(&grey(1e30)), *STOPS.start());
    }

    #[test]
    fn auto_exposure_is_repeated_by_its_number_and_follows_the_light() {
        let mut film = room();
        let stops = auto_exposure(&film);
        assert_eq!(format!("{stops:.2}").parse(), Ok(stops), "hundredths");
        for power in [-9, 3, 7] {
            film.pixels.iter_mut().flatten().for_each(|v| *v *= 2_f32.powi(power));
            let darker = auto_exposure(&film);
            assert!((darker + power as f32 - stops).abs() < 1e-4, "{power}: {darker} of {stops}");
            film = room();
        }
    }

    #[test]
    fn auto_exposure_does_not_look_at_lights_noise_and_emptiness() {
        let stops = auto_exposure(&room());
        let with = |change: &dyn Fn(usize, &mut [f32; 3])| {
            let mut film = room();
            film.pixels.iter_mut().enumerate().for_each(|(i, pixel)| change(i, pixel));
            auto_exposure(&film)
        };
        let emitter = with(&|i, pixel| {
            if i % 100 < 10 && i < 3000 {
                *pixel = [1e4; 3]
            }
        });
        assert!((emitter - stops).abs() < 0.1, "3 % of the picture: {emitter}, not {stops}");
        let noise = with(&|i, pixel| {
            if i % 97 == 0 {
                *pixel = [1e6, 0.0, 0.0]
            }
        });
        assert!((noise - stops).abs() < 0.05, "1 % fireflies: {noise}, not {stops}");
        let black = with(&|i, pixel| {
            if i < 6000 {
                *pixel = [0.0; 3]
            }
        });
        assert!((black - stops).abs() < 0.05, "60 % black: {black}, not {stops}");
        let dim = with(&|i, pixel| {
            if i < 6000 {
                *pixel = [1e-5; 3]
            }
        });
        assert!((dim - stops).abs() < 0.05, "60 % nearly black: {dim}, not {stops}");
        let broken = with(&|i, pixel| {
            if i % 50 == 0 {
                *pixel = [f32::NAN, f32::INFINITY, 1.0]
            }
        });
        assert!((broken - stops).abs() < 0.05, "{broken}, not {stops}");
        let dark = with(&|i, pixel| {
            if i % 2 == 0 {
                *pixel = pixel.map(|v| v / 8.0)
            }
        });
        assert!(dark > stops + 1.0, "canary: half of the room is darker, {dark}, not {stops}");
    }

    #[test]
    fn exposures_are_parsed_and_printed() {
        for (text, exposure) in
            [("auto", Exposure::Auto), ("1.37", Exposure::Stops(1.37)), ("-2", Exposure::Stops(-2.0))]
        {
            assert_eq!((text.parse(), exposure.to_string()), (Ok(exposure), text.to_owned()));
        }
        for bad in ["", "Auto", "33", "-32.5", "nan", "inf", "1,5"] {
            assert!(bad.parse::<Exposure>().is_err(), "{bad}");
        }
    }
}
