//! The BSDFs of [`crate::scene::Bsdf`] at one point: evaluation, sampling and density.
//!
//! Directions lie in a frame whose z is the shading normal on the viewer's side; both leave the surface, the viewer's with z > 0,
//! the light's with z < 0 where the surface lets light pass. Values are f |cos_i|. The density is that of a mixture: facets by
//! visible normals and a cosine lobe, in proportion to what each is expected to give; a facet reflects or lets pass in
//! proportion, too. Below a width of [`SMOOTH`] all facets lie flat: such lobes are sampled alone and have neither value nor
//! density.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::environment::LUMINANCE;
use super::microfacet::{
    self as ggx, fresnel_conductor, fresnel_dielectric, internal_diffuse_reflectance, schlick_weight,
};
use super::sampler::concentric_disk;
use super::surface::Surface;
use super::texture::Textures;
use crate::scene::{self, Boundary, Fresnel, Material, SMOOTH};

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
        /// Share of the base that passes.
        transmission: f32,
        /// Index of refraction beyond the surface relative to the viewer's side; 1: light goes straight on.
        bend: f32,
    },
    /// Metal.
    Conductor {
        /// GGX width.
        alpha: f32,
        /// Angle dependence.
        fresnel: Fresnel,
        /// Factor.
        specular: Vec3,
    },
    /// Coat over a diffuse base.
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
    /// Glass.
    Dielectric {
        /// GGX width.
        alpha: f32,
        /// Index of refraction beyond the surface relative to the viewer's side; of a sheet, its own.
        eta: f32,
        /// Whether light goes straight on.
        sheet: bool,
        /// Factor of what is reflected.
        reflection: Vec3,
        /// Factor of what passes.
        transmission: Vec3,
    },
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Towards the light.
    pub wi: Vec3,
    /// f |cos_i| / pdf_w; of a smooth lobe, its share over the probability of its choice.
    pub weight: Vec3,
    /// Density per solid angle; none for a smooth lobe, which nothing else can sample.
    pub pdf_w: Option<f32>,
    /// Index of refraction on the light's side relative to the viewer's.
    pub eta: f32,
}

/// What a facet does with the light that meets it, per channel.
struct Shares {
    reflected: Vec3,
    passed: Vec3,
    /// What goes on to the diffuse base and comes back.
    diffuse: Vec3,
}

impl Shares {
    /// Probability of sampling a facet instead of the cosine lobe.
    fn of_facets(&self) -> f32 {
        share(self.reflected + self.passed, self.diffuse)
    }

    /// Probability that a sampled facet reflects.
    fn of_reflection(&self) -> f32 {
        share(self.reflected, self.passed)
    }
}

/// The first's share of both; all where there is nothing else.
fn share(first: Vec3, second: Vec3) -> f32 {
    let (first, second) = (first.dot(LUMINANCE), second.dot(LUMINANCE));
    if second <= 0.0 {
        1.0
    } else if first <= 0.0 {
        0.0
    } else {
        first / (first + second)
    }
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
    /// Looks up a material at a point. `prepared` is what [`prepare`] gave. The vertex colour multiplies the diffuse colour, which
    /// in glTF's model is the metal's too.
    #[must_use]
    pub fn new(material: &Material, prepared: f32, textures: &Textures, surface: &Surface) -> Self {
        let (uvs, vertex_color) = (surface.uvs, surface.vertex_color);
        let sheet = material.boundary == Boundary::Sheet;
        let beyond = |index: f32| if surface.front { index } else { 1.0 / index };
        match &material.bsdf {
            scene::Bsdf::Diffuse { reflectance } => {
                Self::Diffuse { albedo: textures.color(reflectance, uvs) * vertex_color }
            }
            scene::Bsdf::MetallicRoughness {
                base_color,
                metallic,
                roughness,
                ior,
                specular,
                specular_color,
                transmission,
            } => {
                let weight = textures.scalar(specular, uvs);
                let head_on = ((ior - 1.0) / (ior + 1.0)).powi(2);
                Self::MetallicRoughness {
                    base: textures.color(base_color, uvs) * vertex_color,
                    metallic: textures.scalar(metallic, uvs).clamp(0.0, 1.0),
                    alpha: textures.scalar(roughness, uvs).powi(2),
                    f0: (head_on * textures.color(specular_color, uvs)).min(Vec3::ONE) * weight,
                    f90: weight,
                    transmission: textures.scalar(transmission, uvs).clamp(0.0, 1.0),
                    // An opaque surface has no inside; glTF's indices below 1 ask for full reflection.
                    bend: if sheet || !material.bsdf.transmits() { 1.0 } else { beyond(ior.max(1.0)) },
                }
            }
            scene::Bsdf::Conductor { alpha, fresnel, specular } => Self::Conductor {
                alpha: textures.scalar(alpha, uvs),
                fresnel: *fresnel,
                specular: textures.color(specular, uvs),
            },
            scene::Bsdf::Plastic { alpha, diffuse, specular, eta, nonlinear } => {
                let diffuse = textures.color(diffuse, uvs) * vertex_color;
                let inner = if *nonlinear { diffuse * prepared } else { Vec3::splat(prepared) };
                Self::Plastic {
                    alpha: textures.scalar(alpha, uvs),
                    base: diffuse / (eta * eta * (1.0 - inner)),
                    specular: textures.color(specular, uvs),
                    eta: *eta,
                }
            }
            scene::Bsdf::Dielectric { alpha, eta, reflection, transmission } => Self::Dielectric {
                // Between media that hardly differ facets bend nothing, and the half vector is lost in rounding.
                alpha: if (eta - 1.0).abs() < 1e-3 { 0.0 } else { textures.scalar(alpha, uvs) },
                eta: if sheet { *eta } else { beyond(*eta) },
                sheet,
                reflection: textures.color(reflection, uvs),
                transmission: textures.color(transmission, uvs),
            },
        }
    }

    /// Light that comes back or passes for light of 1 along `wo`, both in the frame of the normal: what a facet there does.
    #[must_use]
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        let Shares { reflected, passed, diffuse } = self.shares(wo.z);
        reflected + passed + diffuse
    }

    /// Whether light passes.
    #[must_use]
    pub fn transmits(&self) -> bool {
        match *self {
            Self::MetallicRoughness { transmission, .. } => transmission > 0.0,
            Self::Dielectric { .. } => true,
            _ => false,
        }
    }

    /// Whether nothing but smooth lobes is there: no light that is looked for is ever found.
    #[must_use]
    pub fn smooth(&self, wo: Vec3) -> bool {
        self.alpha().is_some_and(|alpha| alpha < SMOOTH) && self.shares(wo.z).of_facets() == 1.0
    }

    /// Value f |cos_i| and density of the pair, smooth lobes left out.
    #[must_use]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        if wo.z <= 0.0 || wi.z == 0.0 || (wi.z < 0.0 && !self.transmits()) {
            return (Vec3::ZERO, 0.0);
        }
        let cosine_pdf_w = wi.z * FRAC_1_PI;
        let Some(alpha) = self.alpha() else {
            let Self::Diffuse { albedo } = self else { return (Vec3::ZERO, 0.0) };
            return (*albedo * cosine_pdf_w, cosine_pdf_w);
        };
        let p = self.shares(wo.z).of_facets();
        if wi.z < 0.0 {
            let (value, pdf_w) = self.evaluate_passing(wo, wi, alpha);
            return (value, p * pdf_w);
        }
        let h = (wo + wi).normalize();
        let shares = self.shares(h.dot(wo).max(0.0));
        let diffuse = match *self {
            Self::Plastic { base, eta, .. } => {
                base * ((1.0 - fresnel_dielectric(wo.z, eta)) * (1.0 - fresnel_dielectric(wi.z, eta)))
            }
            _ => shares.diffuse,
        };
        let mut value = diffuse * cosine_pdf_w;
        let mut pdf_w = (1.0 - p) * cosine_pdf_w;
        if alpha >= SMOOTH {
            // D G F / (4 cos_o cos_i), times cos_i.
            value += shares.reflected * (ggx::d(h, alpha) / (4.0 * wo.z) * self.masking(wo, wi, alpha));
            pdf_w += p * shares.of_reflection() * ggx::reflection_pdf_w(wo, h, alpha);
        }
        (value, pdf_w)
    }

    /// Value and density of the facets where light comes from beyond the surface.
    fn evaluate_passing(&self, wo: Vec3, wi: Vec3, alpha: f32) -> (Vec3, f32) {
        let bend = self.bend();
        if alpha < SMOOTH {
            return (Vec3::ZERO, 0.0);
        }
        if bend == 1.0 {
            // The reflection's lobe, mirrored.
            let mirrored = wi.with_z(-wi.z);
            let h = (wo + mirrored).normalize();
            let shares = self.shares(h.dot(wo).max(0.0));
            let lobe = ggx::d(h, alpha) / (4.0 * wo.z) * self.masking(wo, mirrored, alpha);
            return (shares.passed * lobe, (1.0 - shares.of_reflection()) * ggx::reflection_pdf_w(wo, h, alpha));
        }
        // Walter et al. 2007: the half vector (eq. 16), the Jacobian (eq. 17) and the value (eq. 21) over bend^2, for radiance
        // is denser by that on the far side.
        let sum = wo + bend * wi;
        let h = sum.normalize() * 1.0_f32.copysign(sum.z);
        let (cos_o, cos_i) = (h.dot(wo), -h.dot(wi));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let shares = self.shares(cos_o);
        let facets = ggx::d(h, alpha) * cos_o / wo.z * bend * bend * cos_i / sum.length_squared();
        let g1 = ggx::g1(wo, alpha);
        let value = shares.passed * (facets * g1 * ggx::g1(wi, alpha) / (bend * bend));
        (value, (1.0 - shares.of_reflection()) * facets * g1)
    }

    /// A direction drawn for an observer; none where it would leave on the wrong side. `fork` is a third random number, for
    /// surfaces that let light pass.
    #[must_use]
    pub fn sample(&self, wo: Vec3, mut u: Vec2, fork: f32) -> Option<Sample> {
        if wo.z <= 0.0 {
            return None;
        }
        let rough = |wi: Vec3, eta: f32| {
            let (value, pdf_w) = self.evaluate(wo, wi);
            (pdf_w > 0.0).then(|| Sample { wi, weight: value / pdf_w, pdf_w: Some(pdf_w), eta })
        };
        let Some(alpha) = self.alpha() else { return rough(cosine_hemisphere(u), 1.0) };
        let p = self.shares(wo.z).of_facets();
        // One number chooses the lobe and, stretched, goes on into it.
        if u.x >= p {
            u.x = ((u.x - p) / (1.0 - p)).min(1.0 - f32::EPSILON / 2.0);
            return rough(cosine_hemisphere(u), 1.0);
        }
        u.x = (u.x / p).min(1.0 - f32::EPSILON / 2.0);
        let h = if alpha < SMOOTH { Vec3::Z } else { ggx::sample_visible_normal(wo, alpha, u) };
        let cos = wo.dot(h);
        let shares = self.shares(cos);
        let q = shares.of_reflection();
        let mirrored = h * (2.0 * cos) - wo;
        let (wi, eta, weight) = if fork < q {
            (mirrored, 1.0, shares.reflected / (p * q))
        } else {
            let bend = self.bend();
            let wi = if bend == 1.0 { mirrored.with_z(-mirrored.z) } else { ggx::refract(wo, h, bend) };
            (wi, bend, shares.passed / (p * (1.0 - q) * bend * bend))
        };
        if alpha < SMOOTH {
            return Some(Sample { wi, weight, pdf_w: None, eta });
        }
        if (wi.z > 0.0) == (fork < q) { rough(wi, eta) } else { None }
    }

    /// The GGX width, where there are facets.
    fn alpha(&self) -> Option<f32> {
        match *self {
            Self::Diffuse { .. } => None,
            Self::MetallicRoughness { alpha, .. }
            | Self::Conductor { alpha, .. }
            | Self::Plastic { alpha, .. }
            | Self::Dielectric { alpha, .. } => Some(alpha),
        }
    }

    /// Index of refraction beyond the surface relative to the viewer's side, as far as directions are concerned.
    fn bend(&self) -> f32 {
        match *self {
            Self::MetallicRoughness { bend, .. } => bend,
            Self::Dielectric { eta, sheet: false, .. } => eta,
            _ => 1.0,
        }
    }

    /// Masking and shadowing of a reflection.
    fn masking(&self, wo: Vec3, wi: Vec3, alpha: f32) -> f32 {
        match self {
            Self::MetallicRoughness { .. } => ggx::g2(wo, wi, alpha),
            _ => ggx::g1(wo, alpha) * ggx::g1(wi, alpha),
        }
    }

    /// What a facet does with light at a cosine.
    fn shares(&self, cos: f32) -> Shares {
        let opaque = |reflected, diffuse| Shares { reflected, passed: Vec3::ZERO, diffuse };
        match *self {
            Self::Diffuse { albedo } => opaque(Vec3::ZERO, albedo),
            Self::MetallicRoughness { base, metallic, f0, f90, transmission, bend, .. } => {
                // Schlick's cosine is that in the thinner medium.
                let grazing = schlick_weight(if bend < 1.0 { ggx::refracted_cos(cos, bend) } else { cos });
                let total = bend < 1.0 && ggx::refracted_cos(cos, bend) == 0.0;
                let dielectric = if total { Vec3::ONE } else { f0 + (f90 - f0) * grazing };
                let metal = base + (1.0 - base) * grazing;
                let under = base * ((1.0 - metallic) * (1.0 - dielectric.max_element()));
                Shares {
                    reflected: dielectric + (metal - dielectric) * metallic,
                    passed: under * transmission,
                    diffuse: under * (1.0 - transmission),
                }
            }
            Self::Conductor { fresnel, specular, .. } => {
                let reflectance = match fresnel {
                    Fresnel::None => Vec3::ONE,
                    Fresnel::Conductor { eta, k } => fresnel_conductor(cos, eta, k),
                };
                opaque(specular * reflectance, Vec3::ZERO)
            }
            Self::Plastic { base, specular, eta, .. } => {
                let coat = fresnel_dielectric(cos, eta);
                opaque(specular * coat, base * (1.0 - coat))
            }
            Self::Dielectric { alpha, eta, sheet, reflection, transmission } => {
                let once = fresnel_dielectric(cos, eta);
                // What a sheet's two sides reflect to and fro: R + T R T + T R R R T + ... = 2 R / (1 + R).
                let reflectance = if sheet && alpha < SMOOTH { 2.0 * once / (1.0 + once) } else { once };
                Shares {
                    reflected: reflection * reflectance,
                    passed: transmission * (1.0 - reflectance),
                    diffuse: Vec3::ZERO,
                }
            }
        }
    }
}

/// Cosine-distributed directions about z.
fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = concentric_disk(u);
    p.extend((1.0 - p.length_squared()).max(0.0).sqrt())
}
