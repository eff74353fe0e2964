//! Indices of refraction by name: Mitsuba's metals and dielectrics.
//!
//! A metal's RGB is its measured spectrum integrated against the observer, as in Mitsuba's RGB mode. Silver,
//! gold and copper are P. B. Johnson and R. W. Christy, "Optical constants of the noble metals" (1972), about
//! every second point; aluminium is D. Y. Smith et al. in the CRC Handbook. The other, rarely used metals
//! have one real part, and the imaginary part follows from the reflectance at normal incidence.

use glam::Vec3;

use super::spectra;
use crate::scene::Fresnel;

/// Wavelength in nanometres, real part, imaginary part.
type Measured = &'static [[f64; 3]];

const SILVER: Measured = &[
    [397.4, 0.05, 2.07],
    [413.3, 0.05, 2.275],
    [430.5, 0.04, 2.462],
    [450.9, 0.04, 2.657],
    [471.4, 0.05, 2.869],
    [495.9, 0.05, 3.093],
    [520.9, 0.05, 3.324],
    [548.6, 0.06, 3.586],
    [582.1, 0.05, 3.858],
    [616.8, 0.06, 4.152],
    [659.5, 0.05, 4.483],
    [704.5, 0.04, 4.838],
    [756.0, 0.03, 5.242],
];
const GOLD: Measured = &[
    [397.4, 1.47, 1.952],
    [413.3, 1.46, 1.958],
    [430.5, 1.45, 1.948],
    [450.9, 1.38, 1.914],
    [471.4, 1.31, 1.849],
    [495.9, 1.04, 1.833],
    [520.9, 0.62, 2.081],
    [548.6, 0.43, 2.455],
    [582.1, 0.29, 2.863],
    [616.8, 0.21, 3.272],
    [659.5, 0.14, 3.697],
    [704.5, 0.13, 4.103],
    [756.0, 0.14, 4.542],
];
const COPPER: Measured = &[
    [397.4, 1.32, 2.116],
    [413.3, 1.28, 2.207],
    [430.5, 1.25, 2.305],
    [450.9, 1.24, 2.397],
    [471.4, 1.25, 2.483],
    [495.9, 1.22, 2.564],
    [520.9, 1.18, 2.608],
    [548.6, 1.02, 2.577],
    [582.1, 0.70, 2.704],
    [616.8, 0.30, 3.205],
    [659.5, 0.22, 3.747],
    [704.5, 0.21, 4.205],
    [756.0, 0.24, 4.665],
];
const ALUMINIUM: Measured = &[
    [400.0, 0.490, 4.86],
    [450.0, 0.618, 5.47],
    [500.0, 0.769, 6.08],
    [550.0, 0.958, 6.69],
    [600.0, 1.20, 7.26],
    [650.0, 1.47, 7.79],
    [700.0, 1.83, 8.31],
    [750.0, 2.40, 8.62],
];

/// Real part and linear RGB reflectance at normal incidence.
const OTHERS: [(&str, f32, [f32; 3]); 9] = [
    ("Cr", 3.1, [0.549, 0.556, 0.554]),
    ("W", 3.5, [0.504, 0.498, 0.478]),
    ("Ni", 1.9, [0.649, 0.610, 0.541]),
    ("Ni_palik", 1.9, [0.649, 0.610, 0.541]),
    ("Ti", 2.7, [0.616, 0.582, 0.544]),
    ("Ir", 2.3, [0.755, 0.748, 0.730]),
    ("Rh", 2.0, [0.782, 0.772, 0.757]),
    ("Hg", 1.6, [0.781, 0.780, 0.778]),
    ("V", 3.5, [0.518, 0.516, 0.500]),
];

/// Returns a metal by Mitsuba's name; `none` reflects everything.
pub(super) fn metal(name: &str) -> Option<Fresnel> {
    let measured = match name {
        "none" => return Some(Fresnel::None),
        "Ag" => SILVER,
        "Au" => GOLD,
        "Cu" => COPPER,
        "Al" => ALUMINIUM,
        _ => {
            let (_, n, reflectance) = *OTHERS.iter().find(|(other, ..)| *other == name)?;
            // The equation R = ((n - 1)^2 + k^2) / ((n + 1)^2 + k^2) is solved for k.
            let k2 = |r: f32| (r * (n + 1.0).powi(2) - (n - 1.0).powi(2)) / (1.0 - r);
            let k = Vec3::from_array(reflectance.map(|r| k2(r).max(0.0).sqrt()));
            return Some(Fresnel::Conductor { eta: Vec3::splat(n), k });
        }
    };
    let part = |index: usize| {
        let mut pairs: Vec<[f64; 2]> = measured.iter().map(|row| [row[0], row[index]]).collect();
        // The spectrum is constant beyond the measurements, where the observer's response is close to zero.
        let (first, last) = (pairs[0][1], pairs[pairs.len() - 1][1]);
        pairs.insert(0, [360.0, first]);
        pairs.push([830.0, last]);
        spectra::integrate(&pairs, spectra::Use::Unbounded)
    };
    Some(Fresnel::Conductor { eta: part(1), k: part(2) })
}

/// Returns a dielectric's index of refraction by Mitsuba's name, near 589 nm (Hecht, Optics, 4th edition).
pub(super) fn index_of_refraction(name: &str) -> Option<f32> {
    Some(match name.to_ascii_lowercase().as_str() {
        "vacuum" => 1.0,
        "helium" => 1.000_036,
        "hydrogen" => 1.000_132,
        "air" => 1.000_277,
        "carbon dioxide" => 1.000_45,
        "water" => 1.333,
        "acetone" => 1.36,
        "ethanol" => 1.361,
        "carbon tetrachloride" => 1.461,
        "glycerol" => 1.4729,
        "benzene" => 1.501,
        "silicone oil" => 1.520_45,
        "bromine" => 1.661,
        "water ice" => 1.31,
        "fused quartz" => 1.458,
        "pyrex" => 1.47,
        "acrylic glass" | "polypropylene" => 1.49,
        "bk7" => 1.5046,
        "sodium chloride" => 1.544,
        "amber" => 1.55,
        "pet" => 1.575,
        "diamond" => 2.419,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reflectance(name: &str) -> Vec3 {
        let Some(Fresnel::Conductor { eta, k }) = metal(name) else { panic!("{name} is not in the table") };
        ((eta - 1.0) * (eta - 1.0) + k * k) / ((eta + 1.0) * (eta + 1.0) + k * k)
    }

    /// Reflectances at normal incidence agree with other tables, within the differences between tables.
    #[test]
    fn metals_have_their_colours() {
        for (name, expected) in [
            ("Au", [1.0, 0.78, 0.34]),
            ("Ag", [0.97, 0.96, 0.92]),
            ("Cu", [0.93, 0.62, 0.53]),
            ("Al", [0.91, 0.92, 0.92]),
            ("Cr", [0.549, 0.556, 0.554]),
        ] {
            let ours = reflectance(name);
            assert!((ours - Vec3::from(expected)).abs().max_element() < 0.08, "{name}: {ours}");
        }
        assert_eq!(metal("none"), Some(Fresnel::None));
        assert_eq!(metal("Unobtainium"), None);
    }
}
