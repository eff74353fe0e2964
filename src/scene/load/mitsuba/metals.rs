//! Indices of refraction by name: Mitsuba's conductors and dielectrics.

use glam::Vec3;

use crate::scene::Fresnel;

/// Complex indices of refraction, real and imaginary parts in linear RGB: the spectra that Mitsuba 3 carries, most of them
/// from E. D. Palik's Handbook of Optical Constants of Solids, as its RGB mode integrates them. White is even energy there,
/// so that a spectrum that is nearly constant is reddish.
const CONDUCTORS: [(&str, [f32; 3], [f32; 3]); 40] = [
    ("a-C", [2.944, 2.227, 1.968], [0.8875, 0.7993, 0.8153]),
    ("Ag", [0.1553, 0.1167, 0.1384], [4.828, 3.122, 2.147]),
    ("Al", [1.657, 0.8804, 0.5212], [9.224, 6.269, 4.837]),
    ("AlAs", [3.605, 3.233, 2.216], [0.0007, 0.0, 0.0075]),
    ("AlSb", [0.0, 4.139, 4.669], [0.0, 0.094, 1.301]),
    ("Au", [0.143, 0.3753, 1.442], [3.983, 2.386, 1.603]),
    ("Be", [4.185, 3.185, 2.784], [3.836, 3.01, 2.869]),
    ("Cr", [4.37, 2.917, 1.655], [5.207, 4.231, 3.755]),
    ("CsI", [2.145, 1.702, 1.662], [0.0, 0.0, 0.0]),
    ("Cu", [0.201, 0.9237, 1.102], [3.913, 2.453, 2.142]),
    ("Cu2O", [3.552, 2.95, 2.752], [0.1142, 0.1939, 0.6061]),
    ("CuO", [3.248, 2.448, 2.21], [0.5211, 0.57, 0.7222]),
    ("d-C", [2.709, 2.319, 2.229], [0.0, 0.0, 0.0]),
    ("Hg", [2.399, 1.44, 0.9096], [6.328, 4.372, 3.422]),
    ("HgTe", [4.779, 3.231, 2.66], [1.632, 1.581, 1.729]),
    ("Ir", [3.086, 2.082, 1.618], [5.592, 4.067, 3.267]),
    ("K", [0.064, 0.0464, 0.0382], [2.104, 1.349, 0.9131]),
    ("Li", [0.2658, 0.1956, 0.2209], [3.54, 2.311, 1.669]),
    ("MgO", [2.09, 1.651, 1.595], [0.0, 0.0, 0.0]),
    ("Mo", [4.484, 3.525, 2.776], [4.111, 3.421, 3.151]),
    ("Na", [0.0603, 0.0561, 0.062], [3.179, 2.112, 1.579]),
    ("Nb", [3.42, 2.79, 2.396], [3.441, 2.738, 2.58]),
    ("Ni", [2.367, 1.663, 1.467], [4.499, 3.05, 2.345]),
    ("Rh", [2.586, 1.86, 1.554], [6.782, 4.703, 3.976]),
    ("Se", [4.058, 2.843, 2.821], [0.754, 0.6384, 0.5218]),
    ("Se-e", [5.723, 4.166, 4.081], [0.8711, 1.105, 1.565]),
    ("SiC", [3.172, 2.526, 2.479], [0.0, 0.0, 0.0]),
    ("SnTe", [4.524, 1.982, 1.282], [0.0, 0.0, 0.0]),
    ("Ta", [2.063, 2.393, 2.628], [2.408, 1.742, 1.947]),
    ("Te", [7.39, 4.482, 2.637], [3.256, 3.527, 3.292]),
    ("Te-e", [7.509, 4.296, 2.37], [5.584, 4.947, 3.998]),
    ("ThF4", [1.831, 1.442, 1.388], [0.0, 0.0, 0.0]),
    ("TiC", [3.7, 2.837, 2.582], [3.266, 2.352, 2.173]),
    ("TiN", [1.648, 1.151, 1.38], [3.368, 1.944, 1.102]),
    ("TiO2", [3.457, 2.802, 2.905], [0.0001, 0.0, 0.0007]),
    ("TiO2-e", [3.107, 2.513, 2.582], [0.0, 0.0, 0.0002]),
    ("V", [4.278, 3.513, 2.761], [3.491, 2.889, 3.111]),
    ("VC", [3.658, 2.753, 2.533], [3.068, 2.199, 1.963]),
    ("VN", [2.866, 2.119, 1.94], [3.032, 2.056, 1.616]),
    ("W", [4.371, 3.3, 2.998], [3.501, 2.605, 2.273]),
];

/// Returns a conductor by Mitsuba's name, with or without `_palik`; `none` reflects everything.
pub(super) fn metal(name: &str) -> Option<Fresnel> {
    if name == "none" {
        return Some(Fresnel::None);
    }
    let name = name.strip_suffix("_palik").unwrap_or(name);
    let &(_, eta, k) = CONDUCTORS.iter().find(|(other, ..)| *other == name)?;
    Some(Fresnel::Conductor { eta: Vec3::from(eta), k: Vec3::from(k) })
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
            ("Cr", [0.69, 0.65, 0.69]),
            ("a-C", [0.24, 0.19, 0.17]),
        ] {
            let ours = reflectance(name);
            assert!((ours - Vec3::from(expected)).abs().max_element() < 0.08, "{name}: {ours}");
        }
        assert_eq!(metal("Ni_palik"), metal("Ni"));
        assert_eq!(metal("none"), Some(Fresnel::None));
        assert_eq!(metal("Unobtainium"), None);
    }
}
