//! Reflectance of a thin film (Belcour and Barla 2017, in the form of KHR_materials_iridescence): the spectrum of its
//! interference is integrated in Fourier space.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec3};

use super::microfacet::{refracted_cos, schlick_weight};
use super::surface::Surface;
use super::texture::Textures;
use crate::scene;

/// A thin film after texture look-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Blend between the reflectances without (0) and with the film (1).
    pub strength: f32,
    /// Index of refraction.
    pub ior: f32,
    /// Thickness in nanometres.
    pub thickness: f32,
}

impl Film {
    /// Evaluates a film's textures at a surface.
    #[must_use]
    pub fn new(film: &scene::Film, textures: &Textures, surface: &Surface) -> Self {
        let [least, most] = film.thickness;
        let texel = |(texture, channel): (scene::TextureRef, u32)| {
            textures.scalar(&scene::Scalar { factor: 1.0, texture: Some((texture, channel)) }, surface.uvs)
        };
        let thickness = film.thickness_texture.map_or(most, |texture| least + (most - least) * texel(texture));
        Self { strength: textures.scalar(&film.strength, surface.uvs), ior: film.ior, thickness }
    }

    /// Returns the reflectance at a cosine over a surface with reflectance f0 at normal incidence, blended with
    /// that without the film.
    #[must_use]
    pub fn tint(&self, bare: Vec3, f0: Vec3, cos: f32) -> Vec3 {
        bare.lerp(self.reflectance(f0, cos), self.strength)
    }

    fn reflectance(&self, f0: Vec3, cos: f32) -> Vec3 {
        let inside = refracted_cos(cos, self.ior);
        if inside == 0.0 {
            return Vec3::ONE;
        }
        // The base's index follows from its reflectance against air.
        let base = f0.map(|f| {
            let root = (f.min(0.9998) + 1e-4).sqrt();
            (1.0 + root) / (1.0 - root)
        });
        let fresnel = |from: f32, to: f32, cos: f32| {
            let f0 = ((to - from) / (to + from)).powi(2);
            f0 + (1.0 - f0) * schlick_weight(cos)
        };
        let outer = fresnel(1.0, self.ior, cos);
        let inner = base.map(|base| fresnel(self.ior, base, inside));
        let shift = base.map(|base| (if self.ior < 1.0 { 0.0 } else { PI }) + if base < self.ior { PI } else { 0.0 });
        let path = 2.0 * self.ior * self.thickness * inside;
        let passed = 1.0 - outer;
        let both = (outer * inner).clamp(Vec3::splat(1e-5), Vec3::splat(0.9999));
        let series = passed * passed * inner / (1.0 - both);
        let mut sum = outer + series;
        let mut amplitude = series - passed;
        for order in [1.0, 2.0] {
            amplitude *= both.map(f32::sqrt);
            sum += 2.0 * amplitude * interference(order * path, order * shift);
        }
        sum.clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Mean, amplitude and variance of the Gaussians that represent the observer in Fourier space: x, y, z, and the
/// second lobe of x.
const OBSERVER: [[f32; 3]; 4] = [
    [1.6810e6, 5.4856e-13, 4.3278e9],
    [1.7953e6, 4.4201e-13, 9.3046e9],
    [2.2084e6, 5.2481e-13, 6.6121e9],
    [2.2399e6, 9.7470e-14, 4.5282e9],
];

/// Returns the colour of interference at an optical path difference in nanometres, with a phase shift.
fn interference(path: f32, shift: Vec3) -> Vec3 {
    let phase = TAU * path * 1e-9;
    let lobe = |lobe: usize, shift: f32| {
        let [mean, amplitude, variance] = OBSERVER[lobe];
        amplitude * (TAU * variance).sqrt() * (mean * phase + shift).cos() * (-phase * phase * variance).exp()
    };
    let xyz = Vec3::new(lobe(0, shift.x) + lobe(3, shift.x), lobe(1, shift.y), lobe(2, shift.z)) / 1.0685e-7;
    let rgb_from_xyz = Mat3::from_cols_array(&[
        3.240_454_2,
        -0.969_266,
        0.055_643_4,
        -1.537_138_5,
        1.876_010_8,
        -0.204_025_9,
        -0.498_531_4,
        0.041_556,
        1.057_225_2,
    ]);
    rgb_from_xyz * xyz
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A film of the outside's index is not there, and one of the base's index neither reflects nor delays.
    #[test]
    fn films_that_are_not_there_change_nothing() {
        for (ior, thickness) in [(1.0, 400.0), (1.5, 400.0), (1.5, 0.0)] {
            // At grazing angles, Schlick's term lets even equal indices reflect.
            for cos in [1.0, 0.9, 0.8] {
                let bare = 0.04 + 0.96 * schlick_weight(cos);
                let film = Film { strength: 1.0, ior, thickness };
                let tinted = film.tint(Vec3::ZERO, Vec3::splat(0.04), cos);
                assert!((tinted - bare).abs().max_element() < 0.015, "{film:?} {cos}: {tinted} is not {bare}");
            }
        }
    }

    /// At normal incidence, a film whose path difference is half a green wavelength reflects the least green, and
    /// one of a whole wavelength the most: (r1 - r2)^2 and (r1 + r2)^2 in terms of the amplitudes.
    #[test]
    fn films_cancel_and_amplify_wavelengths() {
        let green = |path: f32| {
            let film = Film { strength: 1.0, ior: 1.3, thickness: path / 2.6 };
            film.tint(Vec3::ZERO, Vec3::splat(0.25), 1.0).y
        };
        // The base of index 3 reflects in phase with the film's front.
        assert!(green(275.0) < 0.7 * green(550.0), "{} {}", green(275.0), green(550.0));
    }
}
