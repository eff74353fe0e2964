//! What a user chooses by name: the estimator with its visibility, strategies, and how lights are sampled.

use std::fmt;
use std::str::FromStr;

/// Estimator of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Bidirectional path tracing; all pixels share light subpaths and directions (short names: raster, twin)
    #[cfg_attr(feature = "cli", value(aliases = ["raster", "twin"]))]
    Shared,
    /// Bidirectional path tracing per pixel with all strategies, including light tracing (short name:
    /// ray-query)
    #[cfg_attr(feature = "cli", value(alias = "ray-query"))]
    Bdpt,
    /// Path tracing from the camera with next-event estimation
    Path,
    /// CPU path tracer that serves as the reference of all other methods
    Reference,
}

/// Algorithm that answers visibility between two points and finds the nearest hit along a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Visibility {
    /// Rasterized lists of all triangles that touch a texel or a cell, with exact intersection
    Exact,
    /// Rasterized depth maps and centre-sampled lists, as in Tokuyoshi and Ogaki 2012
    Fast,
    /// Ray queries of the GPU
    RayQuery,
    /// Rays through a bounding volume hierarchy, built on the CPU and traversed in compute
    Bvh,
}

/// Estimator together with its visibility algorithm.
#[derive(Clone, Copy, Debug, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Technique {
    /// Estimator of the picture
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Method::Shared))]
    pub method: Method,
    /// Algorithm that answers visibility [default: exact; ray-query for the short names twin and ray-query]
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_ifs([("method", "twin", "ray-query"), ("method", "ray-query", "ray-query")])))]
    pub visibility: Option<Visibility>,
}

impl Technique {
    /// `raster`: shared subpaths with exact visibility by rasterization.
    pub const RASTER: Self = Self { method: Method::Shared, visibility: None };
    /// Shared subpaths with rasterized depth maps.
    pub const FAST: Self = Self { method: Method::Shared, visibility: Some(Visibility::Fast) };
    /// `twin`: shared subpaths and the random numbers of [`Self::RASTER`] with ray queries.
    pub const TWIN: Self = Self { method: Method::Shared, visibility: Some(Visibility::RayQuery) };
    /// `ray-query`: bidirectional path tracing per pixel with ray queries.
    pub const RAY_QUERY: Self = Self { method: Method::Bdpt, visibility: Some(Visibility::RayQuery) };
    /// Bidirectional path tracing per pixel with exact visibility by rasterization.
    pub const BDPT: Self = Self { method: Method::Bdpt, visibility: None };
    /// Path tracing with exact visibility by rasterization.
    pub const PATH: Self = Self { method: Method::Path, visibility: None };
    /// CPU reference.
    pub const REFERENCE: Self = Self { method: Method::Reference, visibility: None };

    /// Techniques with a short name.
    pub const NAMED: [(&str, Self); 6] = [
        ("raster", Self::RASTER),
        ("twin", Self::TWIN),
        ("ray-query", Self::RAY_QUERY),
        ("bdpt", Self::BDPT),
        ("path", Self::PATH),
        ("reference", Self::REFERENCE),
    ];

    /// Returns the visibility; exact by default.
    #[must_use]
    pub fn visibility(self) -> Visibility {
        self.visibility.unwrap_or(Visibility::Exact)
    }

    /// True if the device must support ray queries.
    #[must_use]
    pub fn needs_ray_queries(self) -> bool {
        self.method != Method::Reference && self.visibility() == Visibility::RayQuery
    }

    /// True if the method samples paths with s light vertices and t eye vertices. `path` connects to light
    /// points only; `shared` connects to light points and two VPLs, and caustics alone to the camera. The
    /// reference does not separate strategies.
    #[must_use]
    pub fn has_strategy(self, s: u32, t: u32) -> bool {
        match self.method {
            Method::Shared => (s <= 3 && t > 1) || (s > 2 && t == 1),
            Method::Bdpt => t > 0,
            Method::Path => s <= 1 && t > 1,
            Method::Reference => false,
        }
    }

    /// True if pixels share light subpaths and directions.
    #[must_use]
    pub fn shares_subpaths(self) -> bool {
        self.method == Method::Shared
    }

    /// True if visibility lists and maps are rasterized.
    #[must_use]
    pub fn rasterizes(self) -> bool {
        self.shares_subpaths() && matches!(self.visibility(), Visibility::Exact | Visibility::Fast)
    }

    /// True if the combination of method and visibility is implemented.
    pub(super) fn exists(self) -> bool {
        match self.method {
            Method::Shared => true,
            Method::Bdpt | Method::Path => self.visibility() != Visibility::Fast,
            Method::Reference => self.visibility.is_none(),
        }
    }
}

impl Default for Technique {
    fn default() -> Self {
        Self::RASTER
    }
}

impl PartialEq for Technique {
    fn eq(&self, other: &Self) -> bool {
        (self.method, self.visibility()) == (other.method, other.visibility())
    }
}

impl Eq for Technique {}

impl fmt::Display for Technique {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match Self::NAMED.iter().find(|(_, named)| named == self) {
            Some((name, _)) => f.write_str(name),
            None => write!(f, "{} {}", self.method, self.visibility()),
        }
    }
}

impl FromStr for Technique {
    type Err = String;

    /// Parses a short name, or the name of a method with its default visibility.
    fn from_str(text: &str) -> Result<Self, String> {
        let named = Self::NAMED.into_iter().find(|(name, _)| *name == text).map(|(_, technique)| technique);
        let of_method = || Method::ALL.into_iter().find(|method| method.name() == text);
        named.or_else(|| of_method().map(|method| Self { method, visibility: None })).ok_or_else(|| {
            let names: Vec<_> = Self::NAMED.iter().map(|(name, _)| *name).collect();
            format!("`{text}` is none of {} and shared", names.join(", "))
        })
    }
}

/// Single strategy of bidirectional path tracing that contributes to a picture. Its random numbers are those
/// of the picture of all strategies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct OnlyStrategy {
    /// Number of light vertices.
    pub s: u32,
    /// Number of eye vertices.
    pub t: u32,
    /// True if the contribution is multiplied by its MIS weight.
    pub weighted: bool,
}

impl OnlyStrategy {
    /// Returns every strategy (s, t) of paths with at most `bounces` indirect bounces, shortest paths first.
    /// A path has s + t - 1 edges.
    pub fn all(bounces: u32, weighted: bool) -> impl Iterator<Item = Self> {
        (1..=bounces + 2).flat_map(move |edges| (0..=edges).map(move |s| Self { s, t: edges + 1 - s, weighted }))
    }

    /// Returns the name of the strategy's image: `s2_t3` or `s2_t3_unweighted`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("s{}_t{}{}", self.s, self.t, if self.weighted { "" } else { "_unweighted" })
    }
}

/// Data structures that answer the queries of `shared` with exact visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum VisibilityFrom {
    /// The cheaper one for each kind of view, by a model of their times.
    Auto,
    /// Lists of triangles, rasterized into each view of each iteration.
    Lists,
    /// A grid of triangle lists, rasterized once for each pose.
    Grid,
}

/// Set of strategies that contribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Strategies {
    /// All strategies, combined by multiple importance sampling without a bound.
    All,
    /// Instant radiosity: for each path length the strategy with the most light vertices.
    Vpl,
    /// Path tracing through ray-bundles: strategies with one light vertex.
    Bundle,
    /// Set of Tokuyoshi and Ogaki 2012: one bounce by MIS, two bounces by the bounded strategy (2, 3) alone.
    Paper,
}

/// Method that selects a light for direct lighting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum LightSampling {
    /// Uniform selection.
    Uniform,
    /// Selection by power, independent of the surface.
    Power,
    /// Selection by power, distance and orientation, through a light tree.
    Tree,
    /// Resampling at the first hit: of candidates from the tree in `path`, of a pool of light points in
    /// `shared`.
    Ris,
    /// As `ris`, with the reservoirs of the pixel and its neighbours from the previous sample or iteration
    /// (ReSTIR DI).
    Restir,
}

impl LightSampling {
    /// True if lights are selected by a light tree.
    #[must_use]
    pub fn has_tree(self) -> bool {
        matches!(self, Self::Tree | Self::Ris | Self::Restir)
    }

    /// True if reservoirs of the previous sample or iteration are reused.
    #[must_use]
    pub fn reuses(self) -> bool {
        self == Self::Restir
    }

    /// True if direct light at the first hit is resampled.
    #[must_use]
    pub fn resamples(self) -> bool {
        matches!(self, Self::Ris | Self::Restir)
    }
}

/// Weights of reused light samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum RestirBias {
    /// Unbiased: divides by the pixels that could have produced the sample, after testing their visibility.
    Unbiased,
    /// Biased: divides by all pixels that are reused. Faster, but too dark where their visibility differs.
    Biased,
}

/// Defines the list of values and their names on the command line.
macro_rules! names {
    ($($type:ident { $($variant:ident = $name:literal),* $(,)? })*) => {
        $(impl $type {
            /// All values.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            /// Returns the name on the command line.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }
        }

        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str(self.name())
            }
        })*
    };
}

names! {
    Method { Shared = "shared", Bdpt = "bdpt", Path = "path", Reference = "reference" }
    Visibility { Exact = "exact", Fast = "fast", RayQuery = "ray-query", Bvh = "bvh" }
    VisibilityFrom { Auto = "auto", Lists = "lists", Grid = "grid" }
    Strategies { All = "all", Vpl = "vpl", Bundle = "bundle", Paper = "paper" }
    LightSampling { Uniform = "uniform", Power = "power", Tree = "tree", Ris = "ris", Restir = "restir" }
    RestirBias { Unbiased = "unbiased", Biased = "biased" }
}
