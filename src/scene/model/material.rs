//! Materials. Every value is linear.

use glam::Vec3;

use crate::scene::TextureRef;

/// A colour: a factor times an optional texture. The vertex colour multiplies a material's diffuse colour,
/// which in glTF's model is the metal's F0 too.
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

/// Dependence of a conductor's reflectance on the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fresnel {
    /// No dependence: the reflectance is 1 at any angle (Mitsuba's material `none`).
    None,
    /// Complex index of refraction, per channel, relative to the outside.
    Conductor {
        /// Real part.
        eta: Vec3,
        /// Imaginary part.
        k: Vec3,
    },
}

/// Reflection models, all isotropic. `alpha` is the GGX width; 0 denotes a mirror, which the raster method
/// approximates.
///
/// Microfacet lobes are D G2 F / (4 cos cos) with the GGX D and the height-correlated Smith term G2, unless
/// stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a scene has few materials, and no list of bare models")]
pub enum Bsdf {
    /// Lambertian: reflectance / pi.
    Diffuse {
        /// Reflected share of the light.
        reflectance: Color,
    },
    /// glTF 2.0, appendix B, with KHR_materials_specular and KHR_materials_ior; alpha = roughness^2.
    MetallicRoughness {
        /// Diffuse colour of the dielectric and F0 of the metal.
        base_color: Color,
        /// Blend between dielectric (0) and metal (1).
        metallic: Scalar,
        /// Perceptual roughness.
        roughness: Scalar,
        /// Index of refraction of the dielectric.
        ior: f32,
        /// KHR_materials_specular's specularFactor.
        specular: Scalar,
        /// KHR_materials_specular's specularColorFactor.
        specular_color: Color,
        /// KHR_materials_transmission: share of the base that transmits, tinted by the base colour, instead
        /// of reflecting diffusely. A [`Boundary::Volume`] refracts by `ior`; a sheet transmits without
        /// bending.
        transmission: Scalar,
    },
    /// A metal: one GGX lobe, uncorrelated Smith G1 G1 as in Mitsuba.
    Conductor {
        /// GGX width.
        alpha: Scalar,
        /// Fresnel term.
        fresnel: Fresnel,
        /// Multiplies the lobe.
        specular: Color,
    },
    /// A diffuse base under a dielectric coat (Mitsuba's plastic and roughplastic), G1 G1 as in Mitsuba.
    ///
    /// f = specular F D G / (4 cos cos) + diffuse / pi T(cos_i) T(cos_o) / (eta^2 (1 - r F_in)), T the light that
    /// the coat's facets let in, without what they mask, F_in the coat's internal diffuse reflectance, r the diffuse
    /// colour if `nonlinear` and 1 otherwise. T is 1 - F where the coat is smooth.
    Plastic {
        /// GGX width of the coat.
        alpha: Scalar,
        /// Colour of the base.
        diffuse: Color,
        /// Multiplies the coat's reflection.
        specular: Color,
        /// Index of refraction of the coat relative to the outside.
        eta: f32,
        /// True if internal reflections shift the colour.
        nonlinear: bool,
    },
    /// Glass that reflects and refracts (Walter et al. 2007), G1 G1 as in Mitsuba; perfectly smooth if
    /// `alpha` is below [`SMOOTH`].
    Dielectric {
        /// GGX width.
        alpha: Scalar,
        /// Index of refraction behind the surface (against the geometric normal) relative to that in front of
        /// it.
        eta: f32,
        /// Multiplies the reflected light.
        reflection: Color,
        /// Multiplies the transmitted light.
        transmission: Color,
    },
}

impl Bsdf {
    /// Returns a diffuse base under highlights of any colour at normal incidence: a dielectric whose index of 0 reflects
    /// everything (KHR_materials_ior), so that `reflectance` alone remains.
    #[must_use]
    pub fn highlighted(base_color: Color, reflectance: Color, roughness: Scalar) -> Self {
        Self::MetallicRoughness {
            base_color,
            metallic: 0.0.into(),
            roughness,
            ior: 0.0,
            specular: 1.0.into(),
            specular_color: reflectance,
            transmission: 0.0.into(),
        }
    }

    /// Returns GGX width and reflectance at normal incidence of a material's specular lobe. None without a
    /// lobe, or with a roughness texture.
    #[must_use]
    pub fn lobe(&self) -> Option<(f32, f32)> {
        let dielectric = |eta: f32| ((eta - 1.0) / (eta + 1.0)).powi(2);
        let (width, alpha, fresnel) = match self {
            Self::Diffuse { .. } | Self::Dielectric { .. } => return None,
            Self::Conductor { alpha, .. } => (alpha, alpha.factor, 1.0),
            Self::Plastic { alpha, eta, .. } => (alpha, alpha.factor, dielectric(*eta)),
            Self::MetallicRoughness { roughness, metallic, ior, .. } => {
                let metal = metallic.texture.is_none() && metallic.factor > 0.5;
                (roughness, roughness.factor * roughness.factor, if metal { 1.0 } else { dielectric(*ior) })
            }
        };
        width.texture.is_none().then_some((alpha, fresnel))
    }

    /// Returns index of refraction and width of a rough coat over a diffuse base.
    #[must_use]
    pub fn rough_coat(&self) -> Option<(f32, Scalar)> {
        match self {
            Self::Plastic { alpha, eta, .. } if alpha.factor >= SMOOTH => Some((*eta, *alpha)),
            _ => None,
        }
    }

    /// Returns true if facets transmit light anywhere.
    #[must_use]
    pub fn transmits(&self) -> bool {
        match self {
            Self::MetallicRoughness { transmission, .. } => transmission.factor > 0.0,
            Self::Dielectric { .. } => true,
            _ => false,
        }
    }
}

/// Distribution of the normals of facets, all of one width.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distribution {
    /// Trowbridge and Reitz 1975, as GGX by Walter et al. 2007.
    #[default]
    Ggx,
    /// Beckmann and Spizzichino 1963, in the form of Walter et al. 2007.
    Beckmann,
}

/// GGX width below which a lobe is treated as perfectly specular by methods that trace specular paths.
pub const SMOOTH: f32 = 1e-3;

/// The medium behind a transmitting surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Boundary {
    /// A thin sheet: the medium behind it is the one in front. Light is not bent, and a rough lobe is the
    /// mirrored reflection lobe. Internal reflections of a smooth [`Bsdf::Dielectric`] are summed.
    Sheet,
    /// A homogeneous absorbing medium: the transmittance is exp(-absorption d) over d metres
    /// (KHR_materials_volume).
    Volume {
        /// Absorption coefficient per metre and channel.
        absorption: Vec3,
    },
}

/// Emitted light of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Radiance, W m^-2 sr^-1.
    pub radiance: Color,
    /// True if the back emits too.
    pub two_sided: bool,
}

/// A tangent-space normal map: rgb * 2 - 1, xy times `scale`, Y up the image as in glTF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalMap {
    /// Linear RGB texture.
    pub texture: TextureRef,
    /// Multiplies x and y.
    pub scale: f32,
}

/// A layer of clear varnish on top of a surface, base and normal map included (KHR_materials_clearcoat): a
/// dielectric of index 1.5 with a GGX lobe of its own.
///
/// f = w F D G2 / (4 cos cos) + min(1 - w F(cos_i), 1 - w F(cos_o)) f_below, with Schlick's F and w the weight. The
/// extension scales what lies below by the outgoing direction alone; the smaller of both factors is
/// reciprocal, as the scaling of KHR_materials_sheen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Share of the surface that is coated.
    pub weight: Scalar,
    /// Perceptual roughness, the square root of the GGX width.
    pub roughness: Scalar,
    /// Perturbation of the coat's own normal; without it, the coat follows the mesh's normals.
    pub normal_map: Option<NormalMap>,
}

impl Coat {
    /// Reflectance at normal incidence, of the index 1.5.
    pub const F0: f32 = 0.04;
}

/// A thin film on a [`Bsdf::MetallicRoughness`], whose interference tints reflections
/// (KHR_materials_iridescence). Reflectances are clamped to [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Blend between the reflectances without (0) and with the film (1).
    pub strength: Scalar,
    /// Index of refraction.
    pub ior: f32,
    /// Thickness in nanometres where the texture is 0 and 1; the second without a texture.
    pub thickness: [f32; 2],
    /// Texture of the thickness, and its channel.
    pub thickness_texture: Option<(TextureRef, u32)>,
}

/// Light that the diffuse base of a [`Bsdf::MetallicRoughness`] scatters to its other side, as leaves and lamp shades
/// do (KHR_materials_diffuse_transmission).
///
/// The base reflects 1 - s of what it did, and transmits s color / pi times what the facets above it, which are those
/// of either side, do not reflect. Facets of such a surface do not bend light that they transmit, volume or not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseTransmission {
    /// Share s of the base.
    pub share: Scalar,
    /// Colour of the transmitted light.
    pub color: Color,
}

/// Stretch of a material's GGX lobe along a tangent (KHR_materials_anisotropy): its width there is mix(alpha, 1,
/// strength^2), and alpha across. A mesh without texture coordinates has no tangents and a round lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anisotropy {
    /// Strength, in [0, 1].
    pub strength: f32,
    /// Direction of the greater width, radians from the tangent towards the bitangent.
    pub rotation: f32,
    /// Red and green are the cosine and sine of a further rotation, mapped from [-1, 1], and blue multiplies
    /// the strength.
    pub texture: Option<TextureRef>,
}

impl Anisotropy {
    /// Returns the stretch of a lobe of these widths along tangent and bitangent; none if they are equal. The
    /// lobe's alpha is the smaller one.
    #[must_use]
    pub fn of_widths(along: f32, across: f32) -> Option<Self> {
        let (least, most) = (along.min(across), along.max(across).min(1.0));
        let rotation = if along >= across { 0.0 } else { std::f32::consts::FRAC_PI_2 };
        (most > least).then(|| Self { strength: ((most - least) / (1.0 - least)).sqrt(), rotation, texture: None })
    }

    /// Returns the lobe's width along the direction.
    #[must_use]
    pub fn width(strength: f32, alpha: f32) -> f32 {
        alpha + (1.0 - alpha) * strength * strength
    }
}

/// Fibres on a surface that scatter light at grazing angles, as velvet does, below a coat (KHR_materials_sheen).
///
/// f = color D G2 / (4 cos cos) + min(1 - c E(cos_i), 1 - c E(cos_o)) f_below, with the exponentiated sine as D, the
/// Smith term fitted to it (Conty Estevez and Kulla 2017), the albedo E of the lobe and the largest channel
/// c of the colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheen {
    /// Multiplies the lobe.
    pub color: Color,
    /// Perceptual roughness, the square root of the lobe's width.
    pub roughness: Scalar,
}

impl Sheen {
    /// Least roughness. The lobe of a smaller one reflects more than arrives.
    pub const MIN_ROUGHNESS: f32 = 0.1;
}

/// Disney's base and sheen in place of the diffuse base of a [`Bsdf::MetallicRoughness`] (Burley 2012, 2015; Mitsuba's
/// `principled`): with the weight F(c) = (1 - c)^5 of Schlick, the cosine d of either direction with the half vector,
/// the metallic blend m and the base's colour b,
///
/// f = (1 - m) (b / pi mix(f_d, f_ss, flatness) + sheen mix(1, b / luminance(b), sheen_tint) F(d))
///
/// with f_d = (1 - F(cos_i) / 2) (1 - F(cos_o) / 2) + r (F(cos_i) + F(cos_o) + F(cos_i) F(cos_o) (r - 1)), r = 2 roughness
/// d^2, and f_ss = 1.25 (S(cos_i) S(cos_o) (1 / (cos_i + cos_o) - 0.5) + 0.5), S(c) = mix(1, r / 2, F(c)). What facets
/// reflect does not dim it. Of a surface that transmits the base has its share, and of a thin one the sheen, too. Light that
/// passes the boundary of a volume is tinted by the root of b, and facets reflect their share alone from inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disney {
    /// Weight of the lobe at grazing angles.
    pub sheen: Scalar,
    /// Share of the base's hue in its colour.
    pub sheen_tint: f32,
    /// Blend between f_d (0) and flat subsurface scattering f_ss (1).
    pub flatness: f32,
}

/// Two materials that a surface mixes: its BSDF is (1 - w) f_0 + w f_1 (Mitsuba's `blendbsdf`, PBRT's `mix`).
#[derive(Clone, Debug, PartialEq)]
pub struct Mix {
    /// Share w of the second part; below 0 counts as 0, above 1 as 1.
    pub weight: Scalar,
    /// The parts, with BSDFs, normal maps, layers and sides of their own. Emission, opacity and the medium behind the
    /// surface are those of the whole.
    pub parts: Box<[Material; 2]>,
}

/// Partial presence of a surface. Its alpha is factor times the texture's channel (0 red to 3 alpha) times
/// vertex alpha.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Opacity {
    /// An alpha test: the surface exists only where alpha is at least `cutoff`.
    CutOut {
        /// Alpha.
        value: Scalar,
        /// Threshold.
        cutoff: f32,
    },
    /// The surface stops a ray with a probability of alpha; otherwise the ray passes straight on.
    Blended {
        /// Alpha; below 0 counts as 0, above 1 as 1.
        value: Scalar,
    },
}

impl Opacity {
    /// Returns alpha without vertex alpha.
    #[must_use]
    pub fn value(&self) -> &Scalar {
        match self {
            Self::CutOut { value, .. } | Self::Blended { value } => value,
        }
    }

    /// Returns the same, to change it.
    pub fn value_mut(&mut self) -> &mut Scalar {
        match self {
            Self::CutOut { value, .. } | Self::Blended { value } => value,
        }
    }

    /// Returns true if the surface is blended.
    #[must_use]
    pub fn is_blended(&self) -> bool {
        matches!(self, Self::Blended { .. })
    }
}

/// Behaviour of the back side of a surface. All surfaces block light from both sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Both sides reflect.
    Two,
    /// The back is black (Mitsuba without `twosided`).
    One,
    /// The back is black, and camera rays pass through it (glTF without `doubleSided`, whose viewers cull
    /// it).
    OneCulled,
}

/// A material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Its name in the file.
    pub name: String,
    /// Reflection model.
    pub bsdf: Bsdf,
    /// Distribution of the facets of the BSDF's lobe.
    pub distribution: Distribution,
    /// Emitted light, if any.
    pub emission: Option<Emission>,
    /// Perturbation of the shading normal, if any.
    pub normal_map: Option<NormalMap>,
    /// Light that the diffuse base passes, if any.
    pub diffuse_transmission: Option<DiffuseTransmission>,
    /// Thin film on the base, if any.
    pub film: Option<Film>,
    /// Stretch of the BSDF's lobe; none for a round lobe.
    pub anisotropy: Option<Anisotropy>,
    /// Disney's base, if any.
    pub disney: Option<Disney>,
    /// Fibres on top of it, if any.
    pub sheen: Option<Sheen>,
    /// Varnish on top of both, if any.
    pub coat: Option<Coat>,
    /// Materials that are mixed, in place of the BSDF, the normal map and the layers; none for a plain material.
    pub mix: Option<Mix>,
    /// Partial presence; none for a surface without holes.
    pub opacity: Option<Opacity>,
    /// Behaviour of the back side.
    pub sides: Sides,
    /// Medium behind the surface if the BSDF transmits.
    pub boundary: Boundary,
    /// Dispersion of a [`Boundary::Volume`] behind a [`Bsdf::MetallicRoughness`] (KHR_materials_dispersion): 20 over
    /// the Abbe number; 0 for none. [`Material::iors`] says what it does.
    pub dispersion: f32,
}

impl Material {
    /// Creates a two-sided Lambertian material.
    pub fn diffuse(name: impl Into<String>, reflectance: Vec3) -> Self {
        Self {
            name: name.into(),
            bsdf: Bsdf::Diffuse { reflectance: reflectance.into() },
            distribution: Distribution::Ggx,
            emission: None,
            normal_map: None,
            diffuse_transmission: None,
            film: None,
            anisotropy: None,
            disney: None,
            sheen: None,
            coat: None,
            mix: None,
            opacity: None,
            sides: Sides::Two,
            boundary: Boundary::Volume { absorption: Vec3::ZERO },
            dispersion: 0.0,
        }
    }

    /// Returns true if a test holds for the material, or for any of those that it mixes.
    pub fn any(&self, test: &dyn Fn(&Self) -> bool) -> bool {
        match &self.mix {
            None => test(self),
            Some(mix) => mix.parts.iter().any(|part| part.any(test)),
        }
    }

    /// Returns the material, or those that it mixes.
    #[must_use]
    pub fn plain(&self) -> Vec<&Self> {
        match &self.mix {
            None => vec![self],
            Some(mix) => mix.parts.iter().flat_map(Self::plain).collect(),
        }
    }

    /// Changes the material, or those that it mixes.
    pub fn change_plain(&mut self, change: &mut dyn FnMut(&mut Self)) {
        match &mut self.mix {
            None => change(self),
            Some(mix) => mix.parts.iter_mut().for_each(|part| part.change_plain(change)),
        }
    }

    /// Replaces a mix of glass and something else by the latter.
    pub(super) fn unmix_glass(&mut self) {
        let Some(mix) = &mut self.mix else { return };
        mix.parts.iter_mut().for_each(Self::unmix_glass);
        let other = mix.parts.iter().find(|part| !matches!(part.bsdf, Bsdf::Dielectric { .. }));
        if mix.parts.iter().any(|part| matches!(part.bsdf, Bsdf::Dielectric { .. })) {
            let part = other.unwrap_or(&mix.parts[0]).clone();
            let (emission, opacity) = (self.emission, self.opacity);
            *self = Self { name: std::mem::take(&mut self.name), emission, opacity, ..part };
        }
    }

    /// Returns materials and, after them, the parts of those that are mixes, each with the places of its own parts in
    /// the list.
    #[must_use]
    pub fn with_parts(materials: &[Self]) -> Vec<(&Self, Option<[usize; 2]>)> {
        let mut all: Vec<(&Self, Option<[usize; 2]>)> = materials.iter().map(|material| (material, None)).collect();
        let mut next = 0;
        while let Some(&(material, _)) = all.get(next) {
            if let Some(mix) = &material.mix {
                all[next].1 = Some([all.len(), all.len() + 1]);
                all.extend(mix.parts.iter().map(|part| (part, None)));
            }
            next += 1;
        }
        all
    }

    /// Returns true if light passes the surface anywhere, by its facets or its diffuse base. Such a surface is
    /// two-sided, independent of [`Sides`].
    #[must_use]
    pub fn transmits(&self) -> bool {
        self.any(&|m| m.bsdf.transmits() || m.diffuse_transmission.is_some())
    }

    /// Returns true if all of the material is glass, or a perfect mirror of metal: what is seen in it, or through it, is seen
    /// along chains of vertices that may count as no bounces (`Settings::specular_bounces`).
    #[must_use]
    pub fn is_specular(&self) -> bool {
        let is_mirror = |alpha: f32| alpha < SMOOTH;
        self.plain().iter().all(|m| match &m.bsdf {
            _ if m.sheen.is_some() || m.diffuse_transmission.is_some() => false,
            Bsdf::Dielectric { .. } => true,
            Bsdf::Conductor { alpha, .. } => is_mirror(alpha.factor),
            Bsdf::MetallicRoughness { metallic, roughness, transmission, .. } => {
                let is_metal = metallic.factor == 1.0 && metallic.texture.is_none();
                transmission.factor > 0.5 || (is_metal && is_mirror(roughness.factor.powi(2)))
            }
            _ => false,
        })
    }

    /// Returns true if the material is a clear sheet: thin, perfectly smooth glass of one colour. Light either passes it
    /// straight on or is mirrored, so that a ray may pass it as it passes a blended surface, with the probability of the
    /// share that passes in every colour. Lights behind a window pane are found that way, which sampling its BSDF finds
    /// by chance only.
    #[must_use]
    pub fn is_clear_sheet(&self) -> bool {
        let smooth = match &self.bsdf {
            Bsdf::MetallicRoughness {
                base_color, metallic, roughness, specular, specular_color, transmission, ..
            } => {
                let plain = [specular, transmission].iter().all(|scalar| scalar.texture.is_none());
                let of_one_color = [base_color, specular_color].iter().all(|color| color.texture.is_none());
                let passes = transmission.factor == 1.0 && metallic.factor == 0.0;
                plain && of_one_color && passes && roughness.factor.powi(2) < SMOOTH
            }
            Bsdf::Dielectric { alpha, reflection, transmission, .. } => {
                alpha.factor < SMOOTH && [reflection, transmission].iter().all(|color| color.texture.is_none())
            }
            _ => false,
        };
        let bare = self.film.is_none() && self.sheen.is_none() && self.coat.is_none() && self.mix.is_none();
        let bare = bare && self.diffuse_transmission.is_none() && self.anisotropy.is_none() && self.disney.is_none();
        smooth && bare && self.boundary == Boundary::Sheet && self.emission.is_none() && self.normal_map.is_none()
    }

    /// Returns true if rays may pass the surface, whatever animations make of its factors.
    #[must_use]
    pub fn may_be_passed(&self) -> bool {
        self.opacity.is_some() || (self.boundary == Boundary::Sheet && self.transmits())
    }

    /// Returns the index by which each channel is refracted, if the medium behind the surface disperses light: in the
    /// form of KHR_materials_dispersion, n - h, n, n + h with h = 0.025 (n - 1) dispersion. Reflectances are those of
    /// n in all channels. A sheet refracts nothing.
    #[must_use]
    pub fn iors(&self) -> Option<[f32; 3]> {
        let Bsdf::MetallicRoughness { ior, .. } = self.bsdf else { return None };
        let refracts = self.bsdf.transmits() && self.boundary != Boundary::Sheet && self.diffuse_transmission.is_none();
        let half_spread = 0.025 * (ior - 1.0) * self.dispersion;
        (refracts && half_spread > 0.0).then(|| [ior - half_spread, ior, ior + half_spread].map(|ior| ior.max(1.0)))
    }

    /// Returns true if the surface does more than reflect diffusely.
    #[must_use]
    pub fn is_glossy(&self) -> bool {
        self.any(&|m| !matches!(m.bsdf, Bsdf::Diffuse { .. }) || m.sheen.is_some() || m.coat.is_some())
    }

    /// Returns the texture whose coordinates define the mesh's tangents, if the material needs tangents.
    #[must_use]
    pub fn tangent_texture(&self) -> Option<TextureRef> {
        let coat = self.coat.as_ref().and_then(|coat| coat.normal_map.as_ref());
        let map = self.normal_map.as_ref().or(coat).map(|map| map.texture);
        // Without any texture the first set of coordinates counts.
        map.or_else(|| self.anisotropy.map(|a| a.texture.unwrap_or(TextureRef::new(0))))
    }

    /// Returns GGX width and reflectance at normal incidence of each specular lobe, without those that have a
    /// roughness texture.
    pub fn lobes(&self) -> impl Iterator<Item = (f32, f32)> {
        let of_coat = |coat: &Coat| (coat.roughness.factor.powi(2), Coat::F0 * coat.weight.factor);
        self.plain().into_iter().flat_map(move |material| {
            let coat = material.coat.as_ref().filter(|coat| coat.roughness.texture.is_none());
            material.bsdf.lobe().into_iter().chain(coat.map(of_coat))
        })
    }
}
