//! The shaders that only tests run, tests/shaders/*.wesl, and the structs that the host shares with them.

use bytemuck::{Pod, Zeroable};
use glam::Vec4;
use lightsheaf::gpu::Source;

/// Declares a module of tests/shaders.
macro_rules! module {
    ($name:literal) => {
        Source::Text($name, include_str!(concat!("../shaders/", $name, ".wesl")))
    };
}

/// Aims of light paths, and their densities.
pub const AIM_DRAWS: Source<'static> = module!("aim_draws");
/// Samplers, many draws at once, and their densities.
pub const DRAWS: Source<'static> = module!("draws");
/// Rays from the iteration's light, and their densities.
pub const LIGHT_DRAWS: Source<'static> = module!("light_draws");
/// MIS weights of the path methods.
pub const MIS_SUMS: Source<'static> = module!("mis_sums");
/// MIS weights of the shared method.
pub const PATH_WEIGHTS: Source<'static> = module!("path_weights");
/// Visibility queries to a view.
pub const QUERIES: Source<'static> = module!("queries");
/// Visibility queries to the acceleration structure.
pub const RAY_QUERIES: Source<'static> = module!("ray_queries");
/// Directions and lines by the sky's guide, and their densities.
pub const SKY_DRAWS: Source<'static> = module!("sky_draws");
/// Surfaces, textures, environments and lights at given points.
pub const TWINS: Source<'static> = module!("twins");

/// All of them, sorted by name.
pub const ALL: [Source<'static>; 9] =
    [AIM_DRAWS, DRAWS, LIGHT_DRAWS, MIS_SUMS, PATH_WEIGHTS, QUERIES, RAY_QUERIES, SKY_DRAWS, TWINS];

/// Returns the tests' module of that name, if there is one.
pub fn find(name: &str) -> Option<Source<'static>> {
    ALL.into_iter().find(|module| module.name() == name)
}

/// A struct's name, a module that holds it, its size, and its fields with their offsets, as in
/// `lightsheaf::render::layouts`.
pub type Described = (&'static str, &'static str, usize, Vec<(&'static str, usize)>);

macro_rules! structs {
    ($($(#[$doc:meta])* struct $name:ident in $module:literal { $($field:ident: $type:ty,)* })*) => {
        $(
            $(#[$doc])*
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
            pub struct $name { $(pub $field: $type,)* }
        )*

        /// Describes each struct; tests/layouts.rs compares them with the linked shaders.
        pub fn structs() -> Vec<Described> {
            vec![$((
                stringify!($name),
                $module,
                size_of::<$name>(),
                vec![$((stringify!($field), std::mem::offset_of!($name, $field)),)*],
            )),*]
        }
    };
}

structs! {
    /// A query to a view.
    struct Query in "queries" {
        position: [f32; 3],
        triangle: u32,
    }

    /// A query to the acceleration structure.
    struct RayQuestion in "ray_queries" {
        position: [f32; 3],
        own: u32,
        towards: [f32; 3],
        end: u32,
        kind: u32,
        pad0: u32,
        pad1: u32,
        pad2: u32,
    }

    /// A query to samplers.
    struct DrawQuestion in "draws" {
        given: [f32; 3],
        triangle: u32,
        w: [f32; 3],
        kind: u32,
    }

    /// The sampler's result.
    struct DrawAnswer in "draws" {
        w: [f32; 3],
        pdf_w: f32,
        extra: [f32; 3],
        index: u32,
    }

    /// An aim of a light path, or the density of aims on a triangle.
    struct AimDraw in "aim_draws" {
        position: [f32; 3],
        triangle: u32,
        pdf_a: f32,
        asked: u32,
        pad0: u32,
        pad1: u32,
    }

    /// A ray from a light, drawn or given.
    struct LightDraw in "light_draws" {
        w: [f32; 3],
        pdf: f32,
        offset: [f32; 3],
        asked: u32,
    }

    /// A direction to the sky or a line along it, drawn or given.
    struct SkyDraw in "sky_draws" {
        w: [f32; 3],
        pdf: f32,
        offset: [f32; 3],
        asked: u32,
    }

    /// Parameters of the weights of random paths.
    struct PathWeights in "path_weights" {
        sample_counts: [f32; 4],
        beta: f32,
        kind: u32,
        pad0: u32,
        pad1: u32,
    }

    /// A query to functions that have a twin in the reference.
    struct TwinQuestion in "twins" {
        wo: [f32; 3],
        index: u32,
        wi: [f32; 3],
        kind: u32,
        at: [f32; 4],
    }

    /// The function's value; surfaces also have emission and normals.
    struct TwinAnswer in "twins" {
        value: Vec4,
        emission: Vec4,
        ng: Vec4,
        ns: Vec4,
    }
}
