//! Display of linear radiance in 8-bit sRGB: exposure, tone curve, transfer function.
//!
//! `render` and the viewer display pictures through the same [`Grade`]. EXR files store linear radiance
//! without one.
//!
//! | curve | applied to | source | display value of 0.18 in sRGB, 0 to 1 |
//! |---|---|---|---|
//! | `clip` | channel | IEC 61966-2-1 | 0.46 |
//! | `reinhard` | channel | Reinhard et al. 2002, eq. 3 | 0.43 |
//! | `aces` | colour | Stephen Hill's fit of the ACES 1.0 RRT and sRGB ODT | 0.50 |
//! | `agx` | colour | Troy Sobotka's AgX, its outset after Benjamin Wrensch | 0.50 |

use std::fmt;
use std::path::Path;
use std::sync::LazyLock;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use crate::film::{Film, FilmError, srgb_from_linear};

/// Leading bits of the mantissa that index tables.
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
}
