//! An analytic clear sky with its sun.
//!
//! The sky is the model of Hosek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance"
//! (SIGGRAPH 2012), baked into a map without the sun. The sun is a light of its own: a black body seen
//! through an atmosphere after Preetham, Shirley and Smits, "A Practical Analytic Model for Daylight"
//! (SIGGRAPH 1999), appendix A.1. Its optical depths are fitted to the sun of Hosek and Wilkie ("Adding a
//! Solar-Radiance Function to the Hosek-Wilkie Skylight Model", IEEE CG&A 2013): within 2 % on average and 7
//! % at worst above 10 degrees of elevation and up to turbidity 8. Limb darkening is omitted.
//!
//! Units: a radiance of 1 is 1 W m^-2 sr^-1 nm^-1, weighted by the luminosity function, and an irradiance of
//! 1 is 1 W m^-2 nm^-1, as in Mitsuba 3. So skies lie near 0.1 and a high sun near 1.5; times 683 lm/W times
//! 106.9 nm they are candelas per square metre and lux.

use std::f32::consts::{FRAC_PI_2, PI, TAU};

use glam::Vec3;
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};

use crate::scene::load::mitsuba::spectra;
use crate::scene::{EnvironmentMap, Light, Rows};

/// A sky over a horizontal plane, with +Y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClearSky {
    /// Unit direction towards the sun.
    pub towards_sun: Vec3,
    /// Haze: 1 (none) to 10; 3 is a clear day in a temperate climate.
    pub turbidity: f32,
    /// Reflectance of the ground, which brightens the sky, in [0, 1].
    pub albedo: Vec3,
    /// True if this ground, lit by sky and sun, fills the lower hemisphere; otherwise it is black, as in
    /// Mitsuba.
    pub ground: bool,
    /// Multiplies the sky's radiance.
    pub sky_scale: f32,
    /// Multiplies the sun's irradiance.
    pub sun_scale: f32,
    /// Angular radius of the sun, radians.
    pub sun_angle: f32,
}

impl Default for ClearSky {
    fn default() -> Self {
        Self {
            towards_sun: Vec3::Y,
            turbidity: 3.0,
            albedo: Vec3::splat(0.3),
            ground: true,
            sky_scale: 1.0,
            sun_scale: 1.0,
            sun_angle: SUN_ANGLE,
        }
    }
}

/// Mean angular radius of the sun: 0.2666 degrees.
pub const SUN_ANGLE: f32 = 0.2666 * PI / 180.0;

/// Texels of the baked map. The aureole around the sun, where the gradient is largest, is several degrees
/// wide.
const SIZE: [u32; 2] = [512, 256];

/// Integral of the observer's y over wavelength, nm. Division by it normalizes a constant spectrum of 1 to
/// luminance 1.
const OBSERVER: f32 = 106.856_895;

impl ClearSky {
    /// Bakes the sky without its sun; the map is black if the sun is below the horizon.
    #[must_use]
    pub fn map(&self) -> EnvironmentMap {
        let [width, height] = SIZE;
        let sun = self.towards_sun;
        let params = SkyParams {
            elevation: sun.y.clamp(0.0, 1.0).asin().min(FRAC_PI_2),
            turbidity: self.turbidity.clamp(1.0, 10.0),
            albedo: self.albedo.clamp(Vec3::ZERO, Vec3::ONE).to_array(),
        };
        // The constructor fails for values out of range and for NaN.
        let state = SkyState::new(&params).ok().filter(|_| sun.y >= 0.0);
        let texel = |i: u32| {
            let theta = PI * ((i / width) as f32 + 0.5) / height as f32;
            let phi = TAU * ((i % width) as f32 + 0.5) / width as f32;
            let towards = Vec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin());
            match &state {
                Some(state) if theta < FRAC_PI_2 => {
                    // This form of the angle between unit vectors is accurate for small angles too.
                    let gamma = 2.0 * (0.5 * towards.distance(sun)).min(1.0).asin();
                    [Channel::R, Channel::G, Channel::B]
                        .map(|c| (state.radiance(theta, gamma, c) * (self.sky_scale / OBSERVER)).max(0.0))
                }
                _ => [0.0; 3],
            }
        };
        let mut texels: Vec<[f32; 3]> = (0..width * height).map(texel).collect();
        if self.ground && state.is_some() {
            let below = (self.albedo * self.ground_irradiance(&texels) / PI).to_array();
            texels[(width * height / 2) as usize..].fill(below);
        }
        EnvironmentMap { width, height, texels, rows: Rows::Centred }
    }

    /// Returns the irradiance of the ground under the map's upper half and the sun.
    fn ground_irradiance(&self, texels: &[[f32; 3]]) -> Vec3 {
        let [width, height] = SIZE;
        let upper = texels.chunks_exact(width as usize).take(height as usize / 2).enumerate();
        let of_sky: Vec3 = upper
            .map(|(row, texels)| {
                let theta = PI * (row as f32 + 0.5) / height as f32;
                let weight = theta.sin() * theta.cos() * (PI / height as f32) * (TAU / width as f32);
                texels.iter().map(|texel| Vec3::from(*texel) * weight).sum::<Vec3>()
            })
            .sum();
        let sine = self.towards_sun.y;
        of_sky + sun_irradiance(sine, self.turbidity) * (self.sun_scale * sine.max(0.0))
    }

    /// Returns the sun as a light.
    #[must_use]
    pub fn sun(&self) -> Light {
        let irradiance = sun_irradiance(self.towards_sun.y, self.turbidity) * self.sun_scale;
        Light::Sun { direction: -self.towards_sun, irradiance, angle: self.sun_angle, of_sky: true }
    }
}

/// Transmittance independent of turbidity and wavelength; fitted, as are the next two constants.
const GREY: f64 = 0.8868;
/// Optical depth of air at a wavelength of 1 um: Preetham's 0.008735 times 1.129, which includes ozone.
const RAYLEIGH: f64 = 0.009_865;
/// Optical depth of aerosols at 1 um and turbidity 1, 2, ... 10.
const AEROSOL: [f64; 10] = [0.0133, 0.0216, 0.0355, 0.0583, 0.0829, 0.1007, 0.1300, 0.1778, 0.2557, 0.3836];

/// Returns the irradiance on a surface that faces the sun, for the sine of its elevation; zero below the
/// horizon.
fn sun_irradiance(sine: f32, turbidity: f32) -> Vec3 {
    if sine < 0.0 {
        return Vec3::ZERO;
    }
    let sine = f64::from(sine.min(1.0));
    let zenith = sine.acos().to_degrees();
    let mass = 1.0 / (sine + 0.15 * (93.885 - zenith).powf(-1.253));
    let haze = f64::from(turbidity.clamp(1.0, 10.0)) - 1.0;
    let below = (haze as usize).min(AEROSOL.len() - 2);
    let aerosol = AEROSOL[below] + (AEROSOL[below + 1] - AEROSOL[below]) * (haze - below as f64);
    let spectrum = |nm: f64| {
        let um = nm * 1e-3;
        // Planck's law for the photosphere at 5778 K, W m^-2 sr^-1 nm^-1, over the sun's solid angle.
        let radiance = 1.191_042_972e20 / (nm.powi(5) * ((1.438_776_877e7 / (nm * 5778.0)).exp() - 1.0));
        let depth = RAYLEIGH * um.powf(-4.08) + aerosol * um.powf(-0.3);
        GREY * radiance * 6.807e-5 * (-depth * mass).exp()
    };
    let pairs: Vec<[f64; 2]> = (36..=83).map(|i| 10.0 * f64::from(i)).map(|nm| [nm, spectrum(nm)]).collect();
    spectra::integrate(&pairs, spectra::Use::Radiance)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sun loses about a third on its way from the zenith at turbidity 3 and most at the horizon, where
    /// it is red. The sky is blue and has the luminance of clear skies, some thousand candelas per square
    /// metre.
    #[test]
    fn sun_and_sky_have_natural_strength() {
        let luminance = |rgb: Vec3| rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722));
        let lux = |sine: f32| luminance(sun_irradiance(sine, 3.0)) * OBSERVER * 683.0;
        assert!((85e3..110e3).contains(&lux(1.0)), "{} lux from the zenith", lux(1.0));
        assert!(lux(0.5) < lux(1.0) && lux(0.02) < 0.1 * lux(1.0) && lux(-0.01) == 0.0);
        let low = sun_irradiance(0.05, 3.0);
        assert!(low.x > 3.0 * low.z, "{low}");
        // The expected values are Mitsuba 3.9.1's irradiances of a plane that faces the sun at elevations of
        // 10, 30 and 90 degrees.
        for (turbidity, degrees, expected) in [
            (1.0, 30.0_f32, Vec3::new(1.460, 1.154, 0.767)),
            (3.0, 10.0, Vec3::new(0.993, 0.602, 0.215)),
            (3.0, 90.0, Vec3::new(1.520, 1.287, 1.018)),
            (6.0, 30.0, Vec3::new(1.202, 0.931, 0.625)),
        ] {
            let ratio = sun_irradiance(degrees.to_radians().sin(), turbidity) / expected;
            assert!((ratio - 1.0).abs().max_element() < 0.05, "{turbidity} {degrees}: {ratio}");
        }

        let sky = ClearSky { towards_sun: Vec3::new(0.0, 0.6, 0.8), ..ClearSky::default() };
        let map = sky.map();
        assert_eq!((map.width, map.height), (512, 256));
        assert!(map.texels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
        // The sky alone has an illuminance of 8,000 to 20,000 lux at this elevation.
        let irradiance = ClearSky { sun_scale: 0.0, ..sky }.ground_irradiance(&map.texels);
        let ground = luminance(irradiance) * OBSERVER * 683.0;
        assert!((8e3..20e3).contains(&ground), "{ground} lux");
        assert!(irradiance.z > irradiance.x, "{irradiance}");
        // The ground reflects a third of sky and sun diffusely.
        let below = Vec3::from(map.texels[512 * 200]);
        let expected = 0.3 / PI * (irradiance + 0.6 * sun_irradiance(0.6, 3.0));
        assert!((below - expected).abs().max_element() < 1e-5, "{below} is not {expected}");
        assert_eq!(ClearSky { ground: false, ..sky }.map().texels[512 * 200], [0.0; 3]);
        // The map's centre is +Z, where the sun stands: the brightest column.
        let row = &map.texels[96 * 512..97 * 512];
        let brightest = (0..512).max_by(|&a, &b| row[a][1].total_cmp(&row[b][1])).unwrap();
        assert!((254..=257).contains(&brightest), "{brightest}");
        assert!(ClearSky { towards_sun: Vec3::NEG_Y, ..sky }.map().texels.iter().flatten().all(|v| *v == 0.0));
    }
}
