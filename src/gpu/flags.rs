//! The conditional-compilation flags of shaders.

macro_rules! flags {
    ($($(#[$doc:meta])* $flag:ident = $name:literal,)*) => {
        /// A condition of a shader (`@if(NAME)`). Flags that are not given are off.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Flag { $($(#[$doc])* $flag,)* }

        impl Flag {
            /// All flags.
            pub const ALL: &[Self] = &[$(Self::$flag,)*];

            /// Flags of layers on top of materials, of stretched lobes and of what changes diffuse bases.
            pub const LAYERS: [Self; 6] =
                [Self::DiffuseTransmission, Self::Film, Self::Anisotropy, Self::Disney, Self::Sheen, Self::Coat];

            /// Returns the name in shaders.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$flag => $name,)* }
            }
        }
    };
}

flags! {
    /// Materials have textures.
    Textures = "TEXTURES",
    /// Vertices have colours.
    VertexColors = "VERTEX_COLORS",
    /// Materials have lobes other than the diffuse one.
    Glossy = "GLOSSY",
    /// Rays may pass surfaces: materials have alpha masks, or are blended.
    Masks = "MASKS",
    /// Paths draw directions of their own from BSDFs, and continue at mirrors.
    Specular = "SPECULAR",
    /// Vertices on glass and mirrors may count as no bounces.
    SpecularBounces = "SPECULAR_BOUNCES",
    /// Paths are refracted by dielectrics.
    Transmission = "TRANSMISSION",
    /// Media disperse light. Needs TRANSMISSION.
    Disperses = "DISPERSES",
    /// Diffuse bases pass light. Needs TRANSMISSION.
    DiffuseTransmission = "DIFFUSE_TRANSMISSION",
    /// Thin films tint reflections.
    Film = "FILM",
    /// Lobes are wider along a tangent than across it. Needs TEXTURES, with which vertices have tangents.
    Anisotropy = "ANISOTROPY",
    /// Some bases are Disney's.
    Disney = "DISNEY",
    /// Surfaces have a sheen.
    Sheen = "SHEEN",
    /// Surfaces have coats.
    Coat = "COAT",
    /// Surfaces are of bare metal (Mitsuba's conductors).
    Conductors = "CONDUCTORS",
    /// Diffuse bases lie under dielectric coats (Mitsuba's plastics).
    Plastics = "PLASTICS",
    /// Some of these coats are rough. Needs PLASTICS.
    RoughPlastic = "ROUGH_PLASTIC",
    /// Facets have Beckmann's distribution.
    Beckmann = "BECKMANN",
    /// Surfaces are mixes of materials.
    Mixes = "MIXES",
    /// Light paths by way of smooth surfaces are connected to the camera.
    Caustics = "CAUSTICS",

    /// Point, spot or directional lights exist.
    Punctual = "PUNCTUAL",
    /// Lights with directional patterns exist.
    Patterns = "PATTERNS",
    /// Emissive surfaces exist.
    Emission = "EMISSION",
    /// An environment exists.
    Environment = "ENVIRONMENT",
    /// The environment is a map.
    EnvironmentMap = "ENVIRONMENT_MAP",
    /// Lights at infinity exist; their views are parallel projections.
    Infinite = "INFINITE",

    /// Depth maps and centre-sampled lists answer visibility.
    Fast = "FAST",
    /// Rays answer visibility in place of lists and depth maps: ray queries, if no other flag says otherwise.
    Rays = "RAYS",
    /// Rays are marched through a grid of triangle lists.
    Grid = "GRID",
    /// Rays traverse a bounding volume hierarchy in compute.
    Bvh = "BVH",
    /// The pass works on the cells of a grid, before they are divided.
    Cells = "CELLS",
    /// The pass writes the lists of a grid.
    Lists = "LISTS",
    /// The view stores the edge functions of all triangles.
    Projected = "PROJECTED",
    /// The list entries that queries walk are counted.
    Walked = "WALKED",

    /// A reflective shadow map proposes directions from y0.
    Rsm = "RSM",
    /// Pixels at the borders of lights that the camera sees have several places.
    LightBorders = "LIGHT_BORDERS",
    /// Light subpaths from the sky follow what the view has found.
    SkyGuide = "SKY_GUIDE",
    /// The light vertex is y0.
    Light = "LIGHT",
    /// The pass samples y1 from y0.
    Y1 = "Y1",
    /// The geometry term is bounded (`--strategies paper`).
    Clamped = "CLAMPED",
    /// The extension is the last one: hits on emitters count, and no vertex is written.
    Last = "LAST",
    /// The threads of a workgroup list a triangle texel by texel, as a GPU needs.
    PerTexel = "PER_TEXEL",
    /// Tables that no pass writes are read as a texture, as Mesa's software driver needs.
    TexelTables = "TEXEL_TABLES",
    /// Threads take pixel rows in turns, as a software driver needs.
    Swizzled = "SWIZZLED",
    /// Bundle directions follow the environment map.
    SkyBundles = "SKY_BUNDLES",
    /// The pass selects a light point and tests no visibility.
    Choose = "CHOOSE",
    /// Selected light points are reused in the next iteration.
    Reuse = "REUSE",
    /// Light is added to layers that are denoised, not to the film.
    Layered = "LAYERED",
    /// Connections that add little are tested now and then.
    Roulette = "ROULETTE",
    /// Sides of triangles are drawn exactly for the camera.
    Borders = "BORDERS",
    /// Converged tiles are skipped.
    Adaptive = "ADAPTIVE",

    /// Light subpaths are traced.
    LightPaths = "LIGHT_PATHS",
    /// Lights are chosen by descending a light tree.
    LightTree = "LIGHT_TREE",
    /// Direct light of first hits comes from reservoirs.
    Reservoirs = "RESERVOIRS",

    /// Meshes are skinned.
    Skins = "SKINS",
    /// Meshes have morph targets.
    Morphs = "MORPHS",
    /// Heights come from maps.
    HeightMaps = "HEIGHT_MAPS",
    /// Heights come from noise.
    Noise = "NOISE",
    /// Heights come from waves.
    Waves = "WAVES",

    /// Layers are coarser than the image.
    Upsample = "UPSAMPLE",
    /// What the filter takes away is averaged over the frames.
    Residual = "RESIDUAL",
    /// The filter averages means of squares, along columns.
    Coarse = "COARSE",
    /// It averages along rows.
    Across = "ACROSS",
    /// The filter fades with the number of frames.
    Fades = "FADES",
}

/// Joins the names of flags with spaces.
#[must_use]
pub fn flag_names(flags: &[Flag]) -> String {
    flags.iter().map(|flag| flag.name()).collect::<Vec<_>>().join(" ")
}

impl serde::Serialize for Flag {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}
