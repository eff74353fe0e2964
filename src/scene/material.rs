//! What surfaces are made of. Every value is linear.

use glam::Vec3;

use super::TextureRef;

/// A colour: a factor times a texture, where there is one. The vertex colour multiplies a material's diffuse colour, which in
/// glTF's model is the metal's F0 too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Color {
    /// Linear RGB.
    pub factor: Vec3,
    /// Multiplies the factor by the texture's linear RGB.
    pub texture: Option<TextureRef>,
}

/// A number: a factor times one channel of a texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scalar {
    /// The value without a texture.
    pub factor: f32,
    /// Multiplies the factor by the texture's channel (0 red to 3 alpha).
    pub texture: Option<(TextureRef, u32)>,
}

impl From<Vec3> for Color {
    fn from(factor: Vec3) -> Self {
        Self { factor, texture: None }
    }
}

impl From<f32> for Scalar {
    fn from(factor: f32) -> Self {
        Self { factor, texture: None }
    }
}

/// How a conductor's reflectance depends on the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresnel {
    /// Not at all: 1 at any angle (Mitsuba's material `none`).
    None,
    /// Complex index of refraction, per channel, relative to the outside.
    Conductor {
        /// Real part.
        eta: Vec3,
        /// Imaginary part.
        k: Vec3,
    },
}

/// Reflection models, all isotropic. `alpha` is the GGX width; 0 asks for a mirror, which the raster method approaches.
///
/// Microfacet lobes are D G2 F / (4 cos cos), D of GGX and G2 the height-correlated Smith term, except where said.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a scene has few materials, and no list of bare models")]
pub enum Bsdf {
    /// Lambertian: reflectance / pi.
    Diffuse {
        /// Share of the light that is reflected.
        reflectance: Color,
    },
    /// glTF 2.0, appendix B, with KHR_materials_specular and KHR_materials_ior; alpha = roughness^2.
    MetallicRoughness {
        /// Diffuse colour of the dielectric and F0 of the metal.
        base_color: Color,
        /// 0 dielectric, 1 metal.
        metallic: Scalar,
        /// Perceptual roughness.
        roughness: Scalar,
        /// Index of refraction of the dielectric.
        ior: f32,
        /// KHR_materials_specular's specularFactor.
        specular: Scalar,
        /// KHR_materials_specular's specularColorFactor.
        specular_color: Color,
        /// KHR_materials_transmission: share of the base that passes, tinted by the base colour, instead of being reflected
        /// diffusely. Refracted by `ior` where the material is a [`Boundary::Volume`], straight through where it is a sheet.
        transmission: Scalar,
    },
    /// Metal: one GGX lobe, uncorrelated Smith G1 G1 as in Mitsuba.
    Conductor {
        /// GGX width.
        alpha: Scalar,
        /// Angle dependence.
        fresnel: Fresnel,
        /// Multiplies the lobe.
        specular: Color,
    },
    /// Diffuse base under a dielectric coat (Mitsuba's plastic and roughplastic), G1 G1 as in Mitsuba.
    ///
    /// f = specular F D G / (4 cos cos) + diffuse / pi T(cos_i) T(cos_o) / (eta^2 (1 - r F_in)), T = 1 - F of the smooth coat,
    /// F_in its internal diffuse reflectance, r the diffuse colour if `nonlinear` and 1 otherwise.
    Plastic {
        /// GGX width of the coat.
        alpha: Scalar,
        /// Colour of the base.
        diffuse: Color,
        /// Multiplies the coat's reflection.
        specular: Color,
        /// Index of refraction of the coat relative to the outside.
        eta: f32,
        /// Whether inner reflections shift the colour.
        nonlinear: bool,
    },
    /// Glass: reflects and refracts (Walter et al. 2007; `alpha` below [`SMOOTH`]: perfectly smooth), G1 G1 as in Mitsuba.
    Dielectric {
        /// GGX width.
        alpha: Scalar,
        /// Index of refraction behind the surface (against the geometric normal) relative to that in front of it.
        eta: f32,
        /// Multiplies what is reflected.
        reflection: Color,
        /// Multiplies what passes.
        transmission: Color,
    },
}

impl Bsdf {
    /// Whether light passes anywhere on such a surface. Such a surface counts on both sides, whatever [`Sides`] says.
    #[must_use]
    pub fn transmits(&self) -> bool {
        match self {
            Self::MetallicRoughness { transmission, .. } => transmission.factor > 0.0,
            Self::Dielectric { .. } => true,
            _ => false,
        }
    }
}

/// GGX widths below this are perfect mirrors and windows, wherever a method can follow them.
pub const SMOOTH: f32 = 1e-3;

/// What lies behind a surface that light passes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Boundary {
    /// The same as in front: a thin sheet. Light goes straight on, a rough lobe is the reflection's, mirrored. Inner reflections
    /// of a smooth [`Bsdf::Dielectric`] are summed.
    Sheet,
    /// A homogeneous medium that absorbs: transmittance exp(-absorption d) over d metres (KHR_materials_volume).
    Volume {
        /// Per metre, per channel.
        absorption: Vec3,
    },
}

/// Light that a surface sends out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Radiance, W m^-2 sr^-1.
    pub radiance: Color,
    /// Whether the back shines too.
    pub two_sided: bool,
}

/// Tangent-space normal map: rgb * 2 - 1, xy times `scale`, Y up the image as in glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalMap {
    /// Linear RGB texture.
    pub texture: TextureRef,
    /// Multiplies x and y.
    pub scale: f32,
}

/// A surface exists only where factor times the texture's channel (0 red to 3 alpha) times vertex alpha is at least `cutoff`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlphaMask {
    /// Value that is compared.
    pub value: Scalar,
    /// Threshold.
    pub cutoff: f32,
}

/// What the back of a surface does. All surfaces block light from both sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Both sides reflect.
    Two,
    /// The back is black (Mitsuba without `twosided`).
    One,
    /// The back is black, and camera rays pass through it (glTF without `doubleSided`, whose viewers cull it).
    OneCulled,
}

/// A material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the file.
    pub name: String,
    /// How it reflects.
    pub bsdf: Bsdf,
    /// What it emits.
    pub emission: Option<Emission>,
    /// Bends the shading normal.
    pub normal_map: Option<NormalMap>,
    /// Cuts holes.
    pub alpha_mask: Option<AlphaMask>,
    /// What its back does.
    pub sides: Sides,
    /// Where its BSDF lets light pass: into what.
    pub boundary: Boundary,
}

impl Material {
    /// A two-sided Lambertian material.
    pub fn diffuse(name: impl Into<String>, reflectance: Vec3) -> Self {
        Self {
            name: name.into(),
            bsdf: Bsdf::Diffuse { reflectance: reflectance.into() },
            emission: None,
            normal_map: None,
            alpha_mask: None,
            sides: Sides::Two,
            boundary: Boundary::Volume { absorption: Vec3::ZERO },
        }
    }
}
