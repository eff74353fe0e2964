//! The BSDFs of [`crate::scene::Bsdf`] at one point: evaluation, sampling and density.
//!
//! Directions are in a frame whose z is the shading normal on the viewer's side. Both point away from the
//! surface: wo has z > 0, and wi has z < 0 for transmission. Values are f |cos_i|. The sampling density is a
//! mixture of microfacets, sampled by visible normals, and a cosine lobe, in proportion to their expected
//! contributions; reflection and transmission by a facet are chosen likewise. Lobes with a GGX width below
//! [`SMOOTH`] are specular: they are sampled alone and have neither value nor density.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::disney::Disney;
use super::environment::LUMINANCE;
use super::film::Film;
use super::microfacet::{
    self as ggx, Shape, Width, fresnel_conductor, fresnel_dielectric, internal_diffuse_reflectance, schlick_weight,
};
use super::rough_coat::RoughCoat;
use super::sampler::concentric_disk;
use super::surface::Surface;
use super::texture::Textures;
use crate::scene::{self, Boundary, Fresnel, Material, SMOOTH};

/// A BSDF after texture look-up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf<'s> {
    /// Lambertian reflection.
    Diffuse {
        /// Reflectance.
        albedo: Vec3,
    },
    /// glTF's metallic-roughness model.
    MetallicRoughness {
        /// Base colour.
        base: Vec3,
        /// Weight of the metal.
        metallic: f32,
        /// GGX width.
        alpha: f32,
        /// Dielectric reflectance at normal incidence.
        f0: Vec3,
        /// Dielectric reflectance at grazing angles.
        f90: f32,
        /// Fraction of the dielectric's base that transmits.
        transmission: f32,
        /// Index of refraction on the far side relative to the viewer's; 1 transmits without refraction.
        bend: f32,
        /// Share of the diffuse base that passes light, and the colour of that light.
        diffuse_transmission: (f32, Vec3),
        /// Thin film that tints reflections.
        film: Option<Film>,
        /// True if rays pass it by what it transmits in every colour.
        clear: bool,
        /// Sheen and flatness of the diffuse base.
        disney: Option<Disney>,
    },
    /// A rough or smooth conductor.
    Conductor {
        /// GGX width.
        alpha: f32,
        /// Index of refraction that determines the Fresnel term.
        fresnel: Fresnel,
        /// Factor of the reflectance.
        specular: Vec3,
    },
    /// A dielectric coat over a diffuse base.
    Plastic {
        /// GGX width.
        alpha: f32,
        /// Diffuse base including internal reflection: diffuse / (eta^2 (1 - r F_in)).
        base: Vec3,
        /// Factor of the coat's reflectance.
        specular: Vec3,
        /// Index of refraction of the coat.
        eta: f32,
        /// What a rough coat lets pass; none for a smooth one.
        rough: Option<&'s RoughCoat>,
    },
    /// A rough or smooth dielectric.
    Dielectric {
        /// GGX width.
        alpha: f32,
        /// Index of refraction on the far side relative to the viewer's; for a sheet, the sheet's own.
        eta: f32,
        /// True for a thin sheet, which transmits without refraction.
        sheet: bool,
        /// Factor of the reflectance.
        reflection: Vec3,
        /// Factor of the transmittance.
        transmission: Vec3,
        /// True if rays pass it by what it transmits in every colour.
        clear: bool,
    },
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Unit direction towards the light.
    pub wi: Vec3,
    /// f |cos_i| / pdf_w; for a specular lobe, its albedo over the probability of its choice.
    pub weight: Vec3,
    /// Density per solid angle; none for a specular lobe, which no other technique can sample.
    pub pdf_w: Option<f32>,
    /// Index of refraction on the light's side relative to the viewer's.
    pub eta: f32,
}

/// Reflectance and transmittance of a facet at one angle, per channel.
struct Shares {
    reflected: Vec3,
    passed: Vec3,
    /// Albedo of the diffuse base, attenuated by the facet.
    diffuse: Vec3,
    /// Share that the diffuse base passes, attenuated likewise.
    behind: Vec3,
}

impl Shares {
    /// Returns the probability of sampling a facet instead of a cosine lobe.
    fn of_facets(&self) -> f32 {
        share(self.reflected + self.passed, self.diffuse + self.behind)
    }

    /// Returns the probability that a sampled cosine lobe is the one behind the surface.
    fn of_behind(&self) -> f32 {
        if self.behind == Vec3::ZERO { 0.0 } else { share(self.behind, self.diffuse) }
    }

    /// Returns the probability that a sampled facet reflects.
    fn of_reflection(&self) -> f32 {
        share(self.reflected, self.passed)
    }
}

/// Returns the first luminance relative to the sum of both; 1 if the second is zero.
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

/// Integrals over angles that a BSDF needs once per material.
pub struct Prepared {
    /// Internal diffuse reflectance of a smooth coat.
    inner: f32,
    rough: Option<RoughCoat>,
}

impl Prepared {
    /// Computes the integrals.
    #[must_use]
    pub fn new(material: &Material) -> Self {
        let inner = match &material.bsdf {
            scene::Bsdf::Plastic { eta, .. } => internal_diffuse_reflectance(*eta),
            _ => 0.0,
        };
        let rough = material.bsdf.rough_coat();
        Self { inner, rough: rough.map(|(eta, alpha)| RoughCoat::new(eta, material.distribution, &alpha)) }
    }
}

impl<'s> Bsdf<'s> {
    /// Evaluates a material's textures at a surface. The vertex colour multiplies the diffuse colour, and in glTF's model
    /// also the metal's.
    #[must_use]
    pub fn new(material: &Material, prepared: &'s Prepared, textures: &Textures, surface: &Surface) -> Self {
        let (uvs, vertex_color) = (surface.uvs, surface.vertex_color);
        let sheet = material.boundary == Boundary::Sheet;
        let clear = surface.is_clear_sheet();
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
                let base = textures.color(base_color, uvs) * vertex_color;
                let metallic = textures.scalar(metallic, uvs).clamp(0.0, 1.0);
                let transmission = textures.scalar(transmission, uvs).clamp(0.0, 1.0);
                let passing = material.diffuse_transmission.map_or((0.0, Vec3::ZERO), |d| {
                    (textures.scalar(&d.share, uvs).clamp(0.0, 1.0), textures.color(&d.color, uvs))
                });
                // An opaque surface has no interior. glTF's indices below 1 request full reflection.
                // One whose base passes light has none that bends light, either.
                let bend = if sheet || !material.bsdf.transmits() || material.diffuse_transmission.is_some() {
                    1.0
                } else {
                    beyond(material.iors().map_or(ior.max(1.0), |iors| iors[surface.channel]))
                };
                let disney = material.disney.as_ref().map(|disney| {
                    let reflecting = (1.0 - metallic) * (1.0 - passing.0);
                    let kept = reflecting * (1.0 - transmission);
                    let shares = [kept, if sheet { kept } else { reflecting }];
                    Disney::new(disney, textures, surface, base, if bend < 1.0 { [0.0; 2] } else { shares })
                });
                Self::MetallicRoughness {
                    base,
                    metallic,
                    alpha: textures.scalar(roughness, uvs).powi(2),
                    f0: (head_on * textures.color(specular_color, uvs)).min(Vec3::ONE) * weight,
                    f90: weight,
                    transmission,
                    bend,
                    diffuse_transmission: passing,
                    film: material.film.as_ref().map(|film| Film::new(film, textures, surface)),
                    clear,
                    disney,
                }
            }
            scene::Bsdf::Conductor { alpha, fresnel, specular } => Self::Conductor {
                alpha: textures.scalar(alpha, uvs),
                fresnel: *fresnel,
                specular: textures.color(specular, uvs),
            },
            scene::Bsdf::Plastic { alpha, diffuse, specular, eta, nonlinear } => {
                let diffuse = textures.color(diffuse, uvs) * vertex_color;
                let alpha = textures.scalar(alpha, uvs);
                let rough = prepared.rough.as_ref();
                let inner = rough.map_or(prepared.inner, |coat| coat.inner(alpha));
                let inner = if *nonlinear { diffuse * inner } else { Vec3::splat(inner) };
                Self::Plastic {
                    alpha,
                    base: diffuse / (eta * eta * (1.0 - inner)),
                    specular: textures.color(specular, uvs),
                    eta: *eta,
                    rough,
                }
            }
            scene::Bsdf::Dielectric { alpha, eta, reflection, transmission } => Self::Dielectric {
                // Between media of nearly equal index facets do not refract, and the half vector is lost in
                // rounding.
                alpha: if (eta - 1.0).abs() < 1e-3 { 0.0 } else { textures.scalar(alpha, uvs) },
                eta: if sheet { *eta } else { beyond(*eta) },
                sheet,
                reflection: textures.color(reflection, uvs),
                transmission: textures.color(transmission, uvs),
                clear,
            },
        }
    }

    /// Returns the directional albedo along `wo`, reflection and transmission, from the reflectances of a
    /// facet at the normal.
    #[must_use]
    pub fn albedo(&self, wo: Vec3) -> Vec3 {
        let Shares { reflected, passed, diffuse, behind } = self.expected(self.all_shares(wo.z), wo.z);
        reflected + passed + diffuse + behind
    }

    /// Returns true if the surface transmits light.
    #[must_use]
    pub fn transmits(&self) -> bool {
        match *self {
            Self::MetallicRoughness { transmission, diffuse_transmission: (share, _), .. } => {
                transmission + share > 0.0
            }
            Self::Dielectric { .. } => true,
            _ => false,
        }
    }

    /// Returns true if all lobes are specular, so that next-event estimation cannot contribute.
    #[must_use]
    pub fn smooth(&self, wo: Vec3) -> bool {
        self.alpha().is_some_and(|alpha| alpha < SMOOTH) && self.expected(self.shares(wo.z), wo.z).of_facets() == 1.0
    }

    /// Returns f |cos_i| and the density per solid angle for a pair of directions, without specular lobes.
    #[must_use]
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        self.evaluate_shaped(wo, wi, Shape::ROUND)
    }

    /// Returns the same for a lobe with facets of another shape.
    #[must_use]
    pub fn evaluate_shaped(&self, wo: Vec3, wi: Vec3, shape: Shape) -> (Vec3, f32) {
        if wo.z <= 0.0 || wi.z == 0.0 || (wi.z < 0.0 && !self.transmits()) {
            return (Vec3::ZERO, 0.0);
        }
        let cosine_pdf_w = wi.z * FRAC_1_PI;
        let Some(alpha) = self.alpha() else {
            let Self::Diffuse { albedo } = self else { return (Vec3::ZERO, 0.0) };
            return (*albedo * cosine_pdf_w, cosine_pdf_w);
        };
        let head_on = self.expected(self.shares(wo.z), wo.z);
        let (p, behind) = (head_on.of_facets(), head_on.of_behind());
        if wi.z < 0.0 {
            let (value, pdf_w) = self.evaluate_passing(wo, wi, Width { alpha, shape });
            // The facets above the base are those that reflect wi, mirrored.
            let h = (wo + wi.with_z(-wi.z)).normalize();
            let diffuse = self.shares(h.dot(wo).max(0.0)).behind * -cosine_pdf_w;
            return (value + diffuse, p * pdf_w + (1.0 - p) * behind * -cosine_pdf_w);
        }
        let h = (wo + wi).normalize();
        let shares = self.shares(h.dot(wo).max(0.0));
        let diffuse = match *self {
            Self::Plastic { base, .. } => base * (self.coat_transmittance(wo.z) * self.coat_transmittance(wi.z)),
            Self::MetallicRoughness { disney: Some(disney), .. } => {
                disney.albedo_of_pair([wo.z, wi.z], h.dot(wo).max(0.0), alpha)
            }
            _ => shares.diffuse,
        };
        let mut value = diffuse * cosine_pdf_w;
        let mut pdf_w = (1.0 - p) * (1.0 - behind) * cosine_pdf_w;
        if alpha >= SMOOTH {
            let width = Width { alpha, shape };
            // D G F / (4 cos_o cos_i), times cos_i.
            value += shares.reflected * (ggx::d(h, width) / (4.0 * wo.z) * self.masking(wo, wi, width));
            pdf_w += p * shares.of_reflection() * ggx::reflection_pdf_w(wo, h, width);
        }
        (value, pdf_w)
    }

    /// Returns value and density of transmission through facets.
    fn evaluate_passing(&self, wo: Vec3, wi: Vec3, width: Width) -> (Vec3, f32) {
        let bend = self.bend();
        if width.alpha < SMOOTH {
            return (Vec3::ZERO, 0.0);
        }
        if bend == 1.0 {
            // Transmission without refraction is the reflection lobe, mirrored at the surface.
            let mirrored = wi.with_z(-wi.z);
            let h = (wo + mirrored).normalize();
            let shares = self.shares(h.dot(wo).max(0.0));
            let lobe = ggx::d(h, width) / (4.0 * wo.z) * self.masking(wo, mirrored, width);
            return (shares.passed * lobe, (1.0 - shares.of_reflection()) * ggx::reflection_pdf_w(wo, h, width));
        }
        // Walter et al. 2007: half vector (eq. 16), Jacobian (eq. 17) and value (eq. 21). The value is
        // divided by bend^2, the scaling of radiance between the media.
        let sum = wo + bend * wi;
        let h = sum.normalize() * 1.0_f32.copysign(sum.z);
        let (cos_o, cos_i) = (h.dot(wo), -h.dot(wi));
        if cos_o <= 0.0 || cos_i <= 0.0 {
            return (Vec3::ZERO, 0.0);
        }
        let shares = self.shares(cos_o);
        let facets = ggx::d(h, width) * cos_o / wo.z * bend * bend * cos_i / sum.length_squared();
        let g1 = ggx::g1(wo, width);
        let value = shares.passed * (facets * g1 * ggx::g1(wi, width) / (bend * bend));
        (value, (1.0 - shares.of_reflection()) * facets * g1)
    }

    /// Samples a direction; none if it is on the wrong side of the surface. `fork` is a third random number
    /// for surfaces that transmit.
    #[must_use]
    pub fn sample(&self, wo: Vec3, u: Vec2, fork: f32) -> Option<Sample> {
        self.sample_shaped(wo, u, fork, Shape::ROUND)
    }

    /// Samples a direction of a lobe with facets of another shape.
    #[must_use]
    pub fn sample_shaped(&self, wo: Vec3, mut u: Vec2, fork: f32, shape: Shape) -> Option<Sample> {
        if wo.z <= 0.0 {
            return None;
        }
        let rough = |wi: Vec3, eta: f32| {
            let (value, pdf_w) = self.evaluate_shaped(wo, wi, shape);
            (pdf_w > 0.0).then(|| Sample { wi, weight: value / pdf_w, pdf_w: Some(pdf_w), eta })
        };
        let Some(alpha) = self.alpha() else { return rough(cosine_hemisphere(u), 1.0) };
        let head_on = self.expected(self.shares(wo.z), wo.z);
        let p = head_on.of_facets();
        // One random number chooses the lobe and, rescaled, samples it.
        if u.x >= p {
            u.x = ((u.x - p) / (1.0 - p)).min(1.0 - f32::EPSILON / 2.0);
            let wi = cosine_hemisphere(u);
            return rough(if fork < head_on.of_behind() { -wi } else { wi }, 1.0);
        }
        u.x = (u.x / p).min(1.0 - f32::EPSILON / 2.0);
        let h = if alpha < SMOOTH { Vec3::Z } else { ggx::sample_visible_normal(wo, Width { alpha, shape }, u) };
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

    /// Returns the GGX width; none for a diffuse surface.
    pub(super) fn alpha(&self) -> Option<f32> {
        match *self {
            Self::Diffuse { .. } => None,
            Self::MetallicRoughness { alpha, .. }
            | Self::Conductor { alpha, .. }
            | Self::Plastic { alpha, .. }
            | Self::Dielectric { alpha, .. } => Some(alpha),
        }
    }

    /// Widens a smooth lobe to the least width of a rough one.
    #[must_use]
    pub(super) fn roughened(mut self) -> Self {
        match &mut self {
            Self::Diffuse { .. } => {}
            Self::MetallicRoughness { alpha, .. }
            | Self::Conductor { alpha, .. }
            | Self::Plastic { alpha, .. }
            | Self::Dielectric { alpha, .. } => *alpha = alpha.max(SMOOTH),
        }
        self
    }

    /// Returns the index of refraction on the far side relative to the viewer's as far as it refracts; 1 for
    /// sheets.
    fn bend(&self) -> f32 {
        match *self {
            Self::MetallicRoughness { bend, .. } => bend,
            Self::Dielectric { eta, sheet: false, .. } => eta,
            _ => 1.0,
        }
    }

    /// Masking-shadowing function of a reflection: height-correlated in glTF's model, separable in the
    /// others.
    fn masking(&self, wo: Vec3, wi: Vec3, width: Width) -> f32 {
        match self {
            Self::MetallicRoughness { .. } => ggx::g2(wo, wi, width),
            _ => ggx::g1(wo, width) * ggx::g1(wi, width),
        }
    }

    /// Returns the share of light at a cosine that a plastic's coat lets in.
    fn coat_transmittance(&self, cos: f32) -> f32 {
        match *self {
            Self::Plastic { alpha, rough: Some(coat), .. } => coat.transmittance(alpha, cos),
            Self::Plastic { eta, .. } => 1.0 - fresnel_dielectric(cos, eta),
            _ => 1.0,
        }
    }

    /// Returns what is expected of all pairs of directions of which one has a cosine, from a facet at the normal.
    fn expected(&self, shares: Shares, cos: f32) -> Shares {
        match *self {
            Self::MetallicRoughness { disney: Some(disney), alpha, .. } => {
                Shares { diffuse: disney.albedo(cos, alpha), ..shares }
            }
            _ => shares,
        }
    }

    /// Returns the share of light that passes a sheet straight on in every colour, at a cosine.
    #[must_use]
    pub fn straight(&self, cos: f32) -> f32 {
        self.all_shares(cos).passed.min_element()
    }

    /// Returns the reflectances of a facet at a cosine. Those of a clear sheet are what is left for the rays that it
    /// stops.
    fn shares(&self, cos: f32) -> Shares {
        let all = self.all_shares(cos);
        let (Self::MetallicRoughness { clear: true, .. } | Self::Dielectric { clear: true, .. }) = self else {
            return all;
        };
        let passed = all.passed.min_element();
        let stopped = (1.0 - passed).max(1e-6);
        Shares { reflected: all.reflected / stopped, passed: (all.passed - passed) / stopped, ..all }
    }

    /// Returns the reflectances of a facet at a cosine.
    fn all_shares(&self, cos: f32) -> Shares {
        let opaque = |reflected, diffuse| Shares { reflected, passed: Vec3::ZERO, diffuse, behind: Vec3::ZERO };
        match *self {
            Self::Diffuse { albedo } => opaque(Vec3::ZERO, albedo),
            Self::MetallicRoughness {
                base,
                metallic,
                f0,
                f90,
                transmission,
                bend,
                diffuse_transmission,
                film,
                disney,
                ..
            } => {
                // Schlick's approximation takes the cosine in the less dense medium.
                let thinner = if bend < 1.0 { ggx::refracted_cos(cos, bend) } else { cos };
                let grazing = schlick_weight(thinner);
                let total = bend < 1.0 && thinner == 0.0;
                let mut dielectric = if total { Vec3::ONE } else { f0 + (f90 - f0) * grazing };
                let mut metal = base + (1.0 - base) * grazing;
                if let Some(film) = film.filter(|_| dielectric != Vec3::ONE) {
                    dielectric = film.tint(dielectric, f0, thinner);
                    metal = film.tint(metal, base, thinner);
                }
                let below = (1.0 - metallic) * (1.0 - dielectric.max_element());
                let (share, color) = diffuse_transmission;
                // From inside, facets that reflect totally would leave too little for a base.
                let kept = if bend < 1.0 { 0.0 } else { 1.0 - transmission };
                let mut shares = Shares {
                    reflected: dielectric + (metal - dielectric) * metallic,
                    passed: base * below * transmission,
                    diffuse: base * below * (kept * (1.0 - share)),
                    behind: color * below * ((1.0 - transmission) * share),
                };
                if disney.is_some() {
                    shares.behind = color * ((1.0 - metallic) * (1.0 - transmission) * share);
                    if bend != 1.0 {
                        shares.passed = base.map(f32::sqrt) * below * transmission;
                    }
                    if bend < 1.0 {
                        shares.reflected *= (1.0 - metallic) * transmission;
                    }
                }
                shares
            }
            Self::Conductor { fresnel, specular, .. } => {
                let reflectance = match fresnel {
                    Fresnel::None => Vec3::ONE,
                    Fresnel::Conductor { eta, k } => fresnel_conductor(cos, eta, k),
                };
                opaque(specular * reflectance, Vec3::ZERO)
            }
            Self::Plastic { base, specular, eta, .. } => {
                opaque(specular * fresnel_dielectric(cos, eta), base * self.coat_transmittance(cos))
            }
            Self::Dielectric { alpha, eta, sheet, reflection, transmission, .. } => {
                let once = fresnel_dielectric(cos, eta);
                // Sum of the interreflections between a sheet's sides: R + T R T + T R R R T + ... = 2 R / (1
                // + R).
                let reflectance = if sheet && alpha < SMOOTH { 2.0 * once / (1.0 + once) } else { once };
                Shares {
                    reflected: reflection * reflectance,
                    passed: transmission * (1.0 - reflectance),
                    diffuse: Vec3::ZERO,
                    behind: Vec3::ZERO,
                }
            }
        }
    }
}

/// Samples a cosine-weighted direction about z.
pub(super) fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = concentric_disk(u);
    p.extend((1.0 - p.length_squared()).max(0.0).sqrt())
}
