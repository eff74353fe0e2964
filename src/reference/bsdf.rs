//! The BSDFs of [`crate::scene::Bsdf`] at one point: evaluation, sampling and density.
//!
//! Directions lie in a frame whose z is the shading normal; both leave the surface and both have z > 0, for all lobes reflect.
//! Values are f cos_i. The density is that of a mixture: a GGX lobe by visible normals and a cosine lobe, in proportion to
//! what each is expected to reflect.

use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4};

use glam::{Vec2, Vec3};

use super::environment::LUMINANCE;
use super::microfacet::{
    self as ggx, MIN_ALPHA, fresnel_conductor, fresnel_dielectric, internal_diffuse_reflectance, schlick_weight,
};
use super::texture::Textures;
use crate::scene::{self, Fresnel};

/// A BSDF with its textures looked up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    /// Lambertian.
    Diffuse {
        /// Reflectance.
        albedo: Vec3,
    },
    /// glTF's model.
    MetallicRoughness {
        /// Base colour.
        base: Vec3,
        /// Share of metal.
        metallic: f32,
        /// GGX width.
        alpha: f32,
        /// Dielectric reflectance head on.
        f0: Vec3,
        /// Dielectric reflectance at grazing angles.
        f90: f32,
    },
    /// Rough metal.
    Conductor {
        /// GGX width.
        alpha: f32,
        /// Angle dependence.
        fresnel: Fresnel,
        /// Factor.
        specular: Vec3,
    },
    /// Rough coat over a diffuse base.
    Plastic {
        /// GGX width.
        alpha: f32,
        /// Diffuse base, inner reflections included: diffuse / (eta^2 (1 - r F_in)).
        base: Vec3,
        /// Factor of the coat.
        specular: Vec3,
        /// Index of refraction.
        eta: f32,
    },
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Towards the light.
    pub wi: Vec3,
    /// f cos_i / pdf_w.
    pub weight: Vec3,
    /// Density per solid angle.
    pub pdf_w: f32,
}

/// What a material's BSDF needs once, not at every hit.
#[must_use]
pub fn prepare(bsdf: &scene::Bsdf) -> f32 {
    match bsdf {
        scene::Bsdf::Plastic { eta, .. } => internal_diffuse_reflectance(*eta),
        _ => 0.0,
    }
}

impl Bsdf {
    /// Looks up a material at a point. `prepared` is what [`prepare`] gave; `vertex_color` multiplies the diffuse colour, which in
    /// glTF's model is the metal's too.
    #[must_use]
    pub fn new(bsdf: &scene::Bsdf, prepared: f32, textures: &Textures, uvs: [Vec2; 2], vertex_color: Vec3) -> Self {
        match bsdf {
            scene::Bsdf::Diffuse { reflectance } => {
                Self::Diffuse { albedo: textures.color(reflectance, uvs) * vertex_color }
            }
            scene::Bsdf::MetallicRoughness {
                base_color, metallic, roughness, ior, specular, specular_color, ..
            } => {
                let weight = textures.scalar(specular, uvs);
                let head_on = ((ior - 1.0) / (ior + 1.0)).powi(2);
                Self::MetallicRoughness {
                    base: textures.color(base_color, uvs) * vertex_color,
                    metallic: textures.scalar(metallic, uvs).clamp(0.0, 1.0),
                    alpha: textures.scalar(roughness, uvs).powi(2).max(MIN_ALPHA),
                    f0: (head_on * textures.color(specular_color, uvs)).min(Vec3::ONE) * weight,
                    f90: weight,
                }
            }
            scene::Bsdf::Conductor { alpha, fresnel, specular } => Self::Conductor {
                alpha: textures.scalar(alpha, uvs).max(MIN_ALPHA),
                fresnel: *fresnel,
                specular: textures.color(specular, uvs),
            },
            scene::Bsdf::Plastic { alpha, diffuse, specular, eta, nonlinear } => {
                let diffuse = textures.color(diffuse, uvs) * vertex_color;
                let inner = if *nonlinear { diffuse * prepared } else { Vec3::splat(prepared) };
                Self::Plastic {
                    alpha: textures.scalar(alpha, uvs).max(MIN_ALPHA),
                    base: diffuse / (eta * eta * (1.0 - inner)),
                    specular: textures.color(specular, uvs),
                    eta: *eta,
                }
            }
            scene::Bsdf::Dielectric { .. } => Self::Diffuse { albedo: Vec3::ZERO },
        }
    }

    /// Value f cos_i and density of the pair.
    #[must_use]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let cosine_pdf_w = wi.z * FRAC_1_PI;
        let Some(alpha) = self.alpha() else {
            let Self::Diffuse { albedo } = self else { return (Vec3::ZERO, 0.0) };
            return (*albedo * cosine_pdf_w, cosine_pdf_w);
        };
        let h = (wo + wi).normalize();
        let cos_h = h.dot(wo).max(0.0);
        // D G F / (4 cos_o cos_i), times cos_i.
        let lobe = ggx::d(h, alpha) / (4.0 * wo.z);
        let value = match *self {
            Self::Diffuse { .. } => Vec3::ZERO,
            Self::MetallicRoughness { base, metallic, f0, f90, .. } => {
                let grazing = schlick_weight(cos_h);
                let dielectric = f0 + (f90 - f0) * grazing;
                let metal = base + (1.0 - base) * grazing;
                let specular = dielectric + (metal - dielectric) * metallic;
                let diffuse = base * ((1.0 - metallic) * (1.0 - dielectric.max_element()));
                specular * (lobe * ggx::g2(wo, wi, alpha)) + diffuse * cosine_pdf_w
            }
            Self::Conductor { fresnel, specular, .. } => {
                let reflectance = match fresnel {
                    Fresnel::None => Vec3::ONE,
                    Fresnel::Conductor { eta, k } => fresnel_conductor(cos_h, eta, k),
                };
                specular * reflectance * (lobe * ggx::g1(wo, alpha) * ggx::g1(wi, alpha))
            }
            Self::Plastic { base, specular, eta, .. } => {
                let coat = fresnel_dielectric(cos_h, eta) * lobe * ggx::g1(wo, alpha) * ggx::g1(wi, alpha);
                let through = (1.0 - fresnel_dielectric(wo.z, eta)) * (1.0 - fresnel_dielectric(wi.z, eta));
                specular * coat + base * (through * cosine_pdf_w)
            }
        };
        let p = self.specular_probability(wo);
        (value, p * ggx::reflection_pdf_w(wo, h, alpha) + (1.0 - p) * cosine_pdf_w)
    }

    /// A direction drawn for an observer; none where it would leave below the surface.
    #[must_use]
    pub fn sample(&self, wo: Vec3, mut u: Vec2) -> Option<Sample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = match self.alpha() {
            None => cosine_hemisphere(u),
            Some(alpha) => {
                let p = self.specular_probability(wo);
                // One number chooses the lobe and, stretched, goes on into it.
                if u.x < p {
                    u.x = (u.x / p).min(1.0 - f32::EPSILON / 2.0);
                    let h = ggx::sample_visible_normal(wo, alpha, u);
                    h * (2.0 * wo.dot(h)) - wo
                } else {
                    u.x = ((u.x - p) / (1.0 - p)).min(1.0 - f32::EPSILON / 2.0);
                    cosine_hemisphere(u)
                }
            }
        };
        let (value, pdf_w) = self.evaluate(wo, wi);
        (pdf_w > 0.0).then(|| Sample { wi, weight: value / pdf_w, pdf_w })
    }

    /// The GGX width, where there is such a lobe.
    fn alpha(&self) -> Option<f32> {
        match *self {
            Self::Diffuse { .. } => None,
            Self::MetallicRoughness { alpha, .. } | Self::Conductor { alpha, .. } | Self::Plastic { alpha, .. } => {
                Some(alpha)
            }
        }
    }

    /// Probability of sampling the GGX lobe: its share of what both are expected to reflect.
    fn specular_probability(&self, wo: Vec3) -> f32 {
        let (specular, diffuse) = match *self {
            Self::Diffuse { .. } => return 0.0,
            Self::Conductor { .. } => return 1.0,
            Self::MetallicRoughness { base, metallic, f0, f90, .. } => {
                let grazing = schlick_weight(wo.z);
                let dielectric = f0 + (f90 - f0) * grazing;
                let metal = base + (1.0 - base) * grazing;
                let diffuse = base * ((1.0 - metallic) * (1.0 - dielectric.max_element()));
                (dielectric + (metal - dielectric) * metallic, diffuse)
            }
            Self::Plastic { base, specular, eta, .. } => {
                let coat = fresnel_dielectric(wo.z, eta);
                (specular * coat, base * (1.0 - coat))
            }
        };
        let (specular, diffuse) = (specular.dot(LUMINANCE), diffuse.dot(LUMINANCE));
        if diffuse <= 0.0 {
            1.0
        } else if specular <= 0.0 {
            0.0
        } else {
            specular / (specular + diffuse)
        }
    }
}

/// Cosine-distributed directions about z, by the concentric map of Shirley and Chiu, which keeps strata compact.
fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = 2.0 * u - 1.0;
    let (r, phi) = if p.x.abs() > p.y.abs() {
        (p.x, FRAC_PI_4 * (p.y / p.x))
    } else if p.y != 0.0 {
        (p.y, FRAC_PI_2 - FRAC_PI_4 * (p.x / p.y))
    } else {
        (0.0, 0.0)
    };
    let (sin, cos) = phi.sin_cos();
    Vec3::new(r * cos, r * sin, (1.0 - r * r).max(0.0).sqrt())
}
