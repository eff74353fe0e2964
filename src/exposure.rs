//! The exposure of a picture: a number of stops, or what suits the picture.
//!
//! [`auto_exposure`] maps the log-average luminance to middle grey, [`KEY`] = 0.18 (Reinhard et al. 2002, *Photographic
//! Tone Reproduction for Digital Images*, eq. 1 and 2). The selection of the pixels that count is ours, and so is what
//! counts in place of the environment: a studio's curtain says nothing of the light in front of it, so that its pixels
//! count as a grey card there would, as a photographer measures light that falls on things.

use std::fmt;
use std::str::FromStr;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::crop::Crop;
use crate::film::Film;
use crate::scene::{Camera, LUMINANCE, Scene};

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

/// Stops by which a grey card may be brighter or darker than the surfaces beside it: a factor of 4 either way, for
/// reflectances of 0.045 to 0.72 under the light of the card's 0.18. Lamps light things but not the environment.
pub const CARD_STOPS: f64 = 2.0;
/// Share of a channel by which pixels of the environment may differ from its radiance at their middle.
const SAME: f32 = 0.1;

/// Leading bits of the mantissa that index a histogram.
const MANTISSA: u32 = 8;
/// Bins of a histogram per stop.
const STEPS: u32 = 1 << MANTISSA;
/// Trailing bits of the mantissa.
const BELOW: u32 = 23 - MANTISSA;

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
    /// Returns the exposure of a picture in stops. `backdrop`: see [`auto_exposure`]; it is asked for only if it counts.
    #[must_use]
    pub fn stops(self, film: &Film, backdrop: impl FnOnce() -> Option<Backdrop>) -> f32 {
        match self {
            Self::Auto => auto_exposure(film, backdrop().as_ref()),
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

/// What a camera sees of a scene's environment where no surface is in front of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Backdrop {
    /// Radiance of the environment along the ray through the middle of each pixel.
    film: Film,
    /// Luminance of [`grey_card`].
    card: f32,
}

/// Returns the luminance of a card of 18 % reflectance that a scene's environment alone lights from all sides, 0 if it has
/// none. All texels of the environment count, so that it is for callers to keep while only cameras change.
#[must_use]
pub fn grey_card(scene: &Scene) -> f32 {
    scene.environment.as_ref().map_or(0.0, |environment| KEY * environment.mean().dot(LUMINANCE))
}

impl Backdrop {
    /// Returns the backdrop of a picture of `width` columns and `height` rows, or of a crop of it; none if the scene has
    /// no environment, or a black one.
    #[must_use]
    pub fn new(scene: &Scene, camera: &Camera, size: [u32; 2], crop: Option<Crop>) -> Option<Self> {
        Self::with_card(scene, grey_card(scene), camera, size, crop)
    }

    /// As [`Self::new`], with the scene's [`grey_card`].
    #[must_use]
    pub fn with_card(
        scene: &Scene,
        card: f32,
        camera: &Camera,
        [width, height]: [u32; 2],
        crop: Option<Crop>,
    ) -> Option<Self> {
        let environment = scene.environment.as_ref().filter(|_| card > 0.0)?;
        let crop = crop.unwrap_or(Crop::whole(width, height));
        let middle = |pixel: u32| Vec2::new((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
        let size = Vec2::new(width as f32, height as f32);
        let seen = |pixel| environment.seen(camera.direction(middle(pixel) / size, width, height)).to_array();
        let pixels: Vec<_> = crop.pixels(width).collect();
        let film = Film { width: crop.width, height: crop.height, pixels: pixels.into_par_iter().map(seen).collect() };
        Some(Self { film, card })
    }

    /// True if a pixel shows nothing else.
    fn is_shown(&self, at: usize, pixel: Vec3) -> bool {
        self.film.pixels.get(at).is_some_and(|&own| {
            let own = Vec3::from_array(own);
            (pixel - own).abs().max_element() <= SAME * own.max_element()
        })
    }
}

/// Returns the exposure that maps the log-average luminance of a picture to [`KEY`], in stops. It is rounded
/// to hundredths, so that the printed value reproduces the picture.
///
/// Pixels are ignored if they are black or not finite; of the others, if they are more than [`EMPTY_STOPS`]
/// below the [`BRIGHTEST`] tenth; and of the remaining ones, the brightest and the [`DARKEST`] tenth. If no
/// pixel is left, the exposure is 0.
///
/// Pixels that show the `backdrop` alone count as a grey card in its light, at most [`CARD_STOPS`] from the others.
#[must_use]
pub fn auto_exposure(film: &Film, backdrop: Option<&Backdrop>) -> f32 {
    let mut histogram = Histogram::default();
    let mut cards = 0;
    for (at, &pixel) in film.pixels.iter().enumerate() {
        let pixel = Vec3::from_array(pixel);
        match backdrop {
            Some(backdrop) if backdrop.is_shown(at, pixel) => cards += 1,
            _ => histogram.add(pixel.dot(LUMINANCE), 1),
        }
    }
    if let Some(&Backdrop { card, .. }) = backdrop {
        let beside = histogram.log_average();
        let card = beside.map_or(card, |beside| {
            (f64::from(card.log2())).clamp(beside - CARD_STOPS, beside + CARD_STOPS).exp2() as f32
        });
        histogram.add(card, cards);
    }
    let Some(log_average) = histogram.log_average() else { return 0.0 }; // eq. 1, in stops
    let stops = f64::from(KEY).log2() - log_average; // eq. 2
    let stops = stops.clamp((*STOPS.start()).into(), (*STOPS.end()).into());
    // Adding 0 turns -0 into 0.
    ((stops * 100.0).round() / 100.0) as f32 + 0.0
}

/// Pixels by luminance. The leading bits of a positive f32 index bins of its logarithm: a factor of 2 is exactly
/// [`STEPS`] bins.
struct Histogram(Vec<u32>);

impl Default for Histogram {
    fn default() -> Self {
        Self(vec![0; 1 << (8 + MANTISSA)])
    }
}

impl Histogram {
    /// Adds pixels of a luminance; none if it is 0, negative or not finite.
    fn add(&mut self, luminance: f32, pixels: u32) {
        if luminance.is_finite() && luminance >= f32::MIN_POSITIVE {
            self.0[(luminance.to_bits() >> BELOW) as usize] += pixels;
        }
    }

    /// Returns the mean logarithm of the luminance, in stops, of the pixels that count; none if there are none.
    fn log_average(&self) -> Option<f64> {
        let filled = self.0.iter().enumerate().rev().filter(|&(_, &n)| n > 0);
        let mut bins: Vec<(usize, f64)> = filled.map(|(bin, &n)| (bin, f64::from(n))).collect();
        let mut brightest = bins.clone();
        trim(&mut brightest, BRIGHTEST * count(&bins));
        let &(brightest, _) = brightest.first()?;
        bins.retain(|(bin, _)| bin + (EMPTY_STOPS * STEPS) as usize >= brightest);
        let [lamps, shadows] = [BRIGHTEST, DARKEST].map(|share| share * count(&bins));
        trim(&mut bins, lamps);
        bins.reverse();
        trim(&mut bins, shadows);
        // A bin is represented by the logarithm of its centre.
        let log2 = |bin: usize| f64::from(f32::from_bits(((bin as u32) << BELOW) | (1 << (BELOW - 1)))).log2();
        let log_average = bins.iter().map(|&(bin, n)| n * log2(bin)).sum::<f64>() / count(&bins);
        log_average.is_finite().then_some(log_average)
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Environment;

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
            assert!(
                (auto_exposure(&grey(value), None) - stops).abs() < 0.011,
                "{value}: {}",
                auto_exposure(&grey(value), None)
            );
        }
        for value in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(auto_exposure(&grey(value), None), 0.0, "{value}");
        }
        assert_eq!(auto_exposure(&Film::default(), None), 0.0);
        assert_eq!(auto_exposure(&grey(1e-30), None), *STOPS.end());
        assert_eq!(auto_exposure(&grey(1e30), None), *STOPS.start());
    }

    #[test]
    fn auto_exposure_is_repeated_by_its_number_and_follows_the_light() {
        let mut film = room();
        let stops = auto_exposure(&film, None);
        assert_eq!(format!("{stops:.2}").parse(), Ok(stops), "hundredths");
        for power in [-9, 3, 7] {
            film.pixels.iter_mut().flatten().for_each(|v| *v *= 2_f32.powi(power));
            let darker = auto_exposure(&film, None);
            assert!((darker + power as f32 - stops).abs() < 1e-4, "{power}: {darker} of {stops}");
            film = room();
        }
    }

    #[test]
    fn auto_exposure_does_not_look_at_lights_noise_and_emptiness() {
        let stops = auto_exposure(&room(), None);
        let with = |change: &dyn Fn(usize, &mut [f32; 3])| {
            let mut film = room();
            film.pixels.iter_mut().enumerate().for_each(|(i, pixel)| change(i, pixel));
            auto_exposure(&film, None)
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

    /// A scene without anything, before a sky of one colour, and the camera that looks at it.
    fn sky(radiance: f32) -> (Scene, Camera) {
        let environment =
            Environment { radiance: Vec3::splat(radiance), map: None, world_from_environment: glam::Mat3::IDENTITY };
        let camera = Camera {
            name: String::new(),
            world_from_camera: glam::Affine3A::IDENTITY,
            projection: crate::scene::Projection::Perspective { fov: 1.0, axis: crate::scene::FovAxis::X },
            lens: None,
            film_size: None,
        };
        (Scene { environment: Some(environment), ..Scene::default() }, camera)
    }

    /// A picture of a thing of `thing` luminance that covers a share of a backdrop of `behind`.
    fn before(behind: f32, thing: f32, share: f32) -> Film {
        let pixel = |i: u32| [if i < (10_000.0 * share) as u32 { thing } else { behind }; 3];
        Film { width: 100, height: 100, pixels: (0..10_000).map(pixel).collect() }
    }

    #[test]
    fn a_backdrop_counts_as_a_grey_card_in_its_light() {
        // A dark curtain of 1/100 opposite of a bright lamp: a map of two columns and rows.
        let (mut scene, camera) = sky(1.0);
        let map = crate::scene::EnvironmentMap {
            width: 2,
            height: 1,
            texels: vec![[0.01; 3], [0.01; 3]],
            rows: crate::scene::Rows::Centred,
        };
        scene.environment.as_mut().unwrap().map = Some(map);
        let curtain = Backdrop::new(&scene, &camera, [100, 100], None).unwrap();
        let lit = Backdrop { card: KEY * 2.0, ..curtain.clone() };
        for share in [0.1, 0.5, 0.9] {
            let film = before(0.01, 1.2, share);
            let stops = auto_exposure(&film, Some(&lit));
            assert!((-2.8..-0.9).contains(&stops), "{share}: {stops}");
            let alone = auto_exposure(&film, None);
            assert!(share > 0.5 || alone > stops + 1.0, "canary: {share}: {alone}, {stops}");
        }
        // Lamps light the thing and not the curtain.
        let dim = auto_exposure(&before(0.01, 1.2, 0.2), Some(&curtain));
        let alone = auto_exposure(&before(0.0, 1.2, 0.2), None);
        assert!(dim - alone > 1.0 && dim - alone < 2.01, "{dim}, {alone}");
        // Nothing but the environment.
        assert_eq!(auto_exposure(&before(0.01, 0.01, 0.5), Some(&lit)), -1.0);
    }

    #[test]
    fn a_backdrop_is_where_the_camera_looks() {
        let (mut scene, camera) = sky(1.0);
        let texels = (0..64 * 32).map(|i| [(i % 64) as f32, (i / 64) as f32, 1.0]).collect();
        let map = crate::scene::EnvironmentMap { width: 64, height: 32, texels, rows: crate::scene::Rows::Centred };
        let world_from_environment = glam::Mat3::from_rotation_y(std::f32::consts::PI);
        scene.environment = Some(Environment { radiance: Vec3::ONE, map: Some(map), world_from_environment });
        let whole = Backdrop::new(&scene, &camera, [40, 20], None).unwrap();
        let crop = Crop { x: 30, y: 5, width: 10, height: 3 };
        let part = Backdrop::new(&scene, &camera, [40, 20], Some(crop)).unwrap();
        assert_eq!(part.film, whole.film.clone().cropped(Some(crop)));
        // The map's middle is straight ahead, and its texels are their own coordinates.
        for (at, pixel) in [(0, Vec2::new(0.5, 0.5)), (39, Vec2::new(39.5, 0.5)), (799, Vec2::new(39.5, 19.5))] {
            let slope = 0.5_f32.tan() / 20.0;
            let [x, y] = [(pixel.x - 20.0) * slope, (10.0 - pixel.y) * slope];
            let u = 0.5 + x.atan() / std::f32::consts::TAU;
            let v = 0.5 - (y / (1.0 + x * x + y * y).sqrt()).asin() / std::f32::consts::PI;
            let expected = Vec3::new(64.0 * u - 0.5, 32.0 * v - 0.5, 1.0);
            assert!((Vec3::from(whole.film.pixels[at]) - expected).abs().max_element() < 1e-3, "{at}: {expected}");
        }
        for none in [None, sky(0.0).0.environment] {
            scene.environment = none;
            assert_eq!(Backdrop::new(&scene, &camera, [40, 20], None), None);
        }
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
