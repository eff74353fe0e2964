//! Scenes as plain data, independent of any rendering method.
//!
//! A [`Scene`] is meshes, instances, materials, textures, lights and cameras, in world units of metres and
//! linear Rec. 709 radiometry ([`model`]). [`load()`] reads it from a file, [`builtin`] makes it in code,
//! [`animation`] poses it. [`tessellation`] flattens it into the world-space triangles of a [`Geometry`],
//! which both the GPU upload and the CPU reference read. Nothing here depends on a GPU or on an estimator.

pub mod animation;
pub mod builtin;
pub mod check;
pub mod load;
pub mod model;
pub mod tessellation;

pub use animation::{Pose, Rig};
pub use load::environment::EnvironmentChange;
pub use load::{load, load_bytes, load_with};
pub use model::camera::{Camera, FovAxis, Lens, Projection};
pub use model::emitter::Emitter;
pub use model::environment::{Environment, EnvironmentMap, Rows};
pub use model::error::LoadError;
pub use model::geometry::Geometry;
pub use model::height::{Height, HeightMap, Wave};
pub use model::light::{Cone, Lamp, Light, SpotFalloff, angle_of_versine, versine};
pub use model::material::{
    Anisotropy, Boundary, Bsdf, Coat, Color, DiffuseTransmission, Disney, Distribution, Emission, Film, Fresnel,
    Material, Mix, NormalMap, Opacity, SMOOTH, Scalar, Sheen, Sides,
};
pub use model::mesh::{Instance, Mesh};
pub use model::pattern::{Mapping, Pattern};
pub use model::scene::{LUMINANCE, Scene};
pub use model::stats::SceneStats;
pub use model::tessellation::{Displacement, EdgeFactor, Tessellation, Viewpoint};
pub use model::texture::{Filter, Image, Texture, TextureRef, Wrap};
