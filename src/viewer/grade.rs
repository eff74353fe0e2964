//! From radiance to what a screen shows: exposure, a curve, sRGB.

use crate::film::Film;

/// How bright values are brought below 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Curve {
    /// Cut at 1, as PNG files of `render` are.
    #[default]
    Clip,
    /// x / (1 + x) (Reinhard et al. 2002, eq. 3), per channel.
    Reinhard,
    /// A fit of the ACES reference transform (Narkowicz 2015), per channel.
    Aces,
}

impl Curve {
    /// All, each with its name.
    pub const ALL: [(Self, &str); 3] = [(Self::Clip, "clip"), (Self::Reinhard, "Reinhard"), (Self::Aces, "ACES")];

    fn apply(self, x: f32) -> f32 {
        match self {
            Self::Clip => x.min(1.0),
            Self::Reinhard => x / (1.0 + x),
            Self::Aces => ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).min(1.0),
        }
    }
}

/// Exposure and curve.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Grade {
    /// Values are multiplied by 2 to this.
    pub stops: f32,
    /// What follows.
    pub curve: Curve,
}

/// Exponents of the values that a table tells apart; what is below is black, what is above as bright as the last.
const EXPONENTS: std::ops::Range<u32> = 127 - 16..127 + 17;
/// Bits of the mantissa that it looks at: steps of a 256th, finer than 8 bits of sRGB can show.
const MANTISSA: u32 = 8;

/// A grade as a table over the leading bits of a value: a picture takes milliseconds.
pub struct Table(Vec<u8>);

impl Grade {
    /// The table.
    #[must_use]
    pub fn table(&self) -> Table {
        let first = EXPONENTS.start << MANTISSA;
        let entry = |n: u32| {
            // The middle of the values that share these bits.
            let value = f32::from_bits(((first + n) << (23 - MANTISSA)) | (1 << (22 - MANTISSA)));
            self.shown(value)
        };
        Table((0..(EXPONENTS.end - EXPONENTS.start) << MANTISSA).map(entry).collect())
    }

    /// What is shown of a value, 8 bits of sRGB.
    #[must_use]
    pub fn shown(&self, value: f32) -> u8 {
        let x = self.curve.apply((value * self.stops.exp2()).max(0.0));
        let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (encoded * 255.0 + 0.5) as u8
    }

    /// The picture as it is shown: linear values that a PNG file without exposure has it by.
    #[must_use]
    pub fn baked(&self, film: &Film) -> Film {
        let scale = self.stops.exp2();
        let bake = |v: f32| self.curve.apply((v * scale).max(0.0));
        Film { pixels: film.pixels.iter().map(|p| p.map(bake)).collect(), ..*film }
    }
}

impl Table {
    /// What is shown of a value.
    #[must_use]
    pub fn look_up(&self, value: f32) -> u8 {
        let bits = value.to_bits();
        // Negative values and NaN are black, what is too bright, infinity too, as bright as can be.
        if value.is_nan() || value <= 0.0 {
            return 0;
        }
        let index = (bits >> (23 - MANTISSA)).saturating_sub(EXPONENTS.start << MANTISSA) as usize;
        self.0[index.min(self.0.len() - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_grade() {
        for (curve, _) in Curve::ALL {
            for stops in [-3.0, 0.0, 2.5] {
                let grade = Grade { stops, curve };
                let table = grade.table();
                for i in 0..4000 {
                    let value = (i as f32 * 0.005).powi(3);
                    let (exact, looked_up) = (grade.shown(value), table.look_up(value));
                    assert!(exact.abs_diff(looked_up) <= 1, "{curve:?} {stops} {value}: {exact} {looked_up}");
                }
                let odd = [f32::NAN, -1.0, 0.0, f32::INFINITY, f32::MAX].map(|v| table.look_up(v));
                assert_eq!(odd, [0, 0, 0, 255, 255], "{curve:?} {stops}");
            }
        }
    }

    #[test]
    fn clipping_is_what_png_files_hold_and_baking_too() {
        let mut film = Film::new(4, 1);
        film.pixels = vec![[0.0, 0.001, 0.1], [0.5, 0.9, 1.0], [1.5, 7.0, 100.0], [0.214, 0.25, 0.75]];
        let grade = Grade { stops: 0.5, curve: Curve::Clip };
        let shown: Vec<u8> = film.pixels.iter().flatten().map(|&v| grade.shown(v)).collect();
        assert_eq!(shown, film.to_srgb8(0.5_f32.exp2()));
        for (curve, _) in Curve::ALL {
            let grade = Grade { stops: -1.0, curve };
            let shown: Vec<u8> = film.pixels.iter().flatten().map(|&v| grade.shown(v)).collect();
            assert_eq!(shown, grade.baked(&film).to_srgb8(1.0), "{curve:?}");
        }
    }

    #[test]
    fn curves_rise_and_stay_below_one() {
        for (curve, name) in Curve::ALL {
            let values: Vec<f32> = (0..1000).map(|i| curve.apply(i as f32 * 0.05)).collect();
            assert!(values.windows(2).all(|w| w[0] <= w[1] && w[1] <= 1.0), "{name}");
            assert_eq!(values[0], 0.0, "{name}");
        }
    }
}
