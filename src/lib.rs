//! Lightsheaf renders global illumination by rasterization alone: bidirectional path tracing with shared
//! subpaths (after Tokuyoshi and Ogaki 2012) and exact visibility, on any GPU that wgpu reaches, with or
//! without ray tracing. A CPU path tracer judges it.
//!
//! This chapter is the map; [`render::shared::frame`] is the method on one page; after that, any pass is one
//! Rust file and one shader of the same name. `docs/method.md` has the equations, `docs/limits.md` the
//! biases, `docs/contributing.md` the recipes.
//!
//! # A picture
//!
//! ```no_run
//! use lightsheaf::{gpu::Gpu, render, scene, settings::Settings};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let scene = scene::load("builtin:cornell_point")?;
//! let gpu = Gpu::new()?;
//! let mut renderer = render::open(&gpu, &scene, &Settings::default())?;
//! renderer.render(64, &mut |_samples| true)?;
//! renderer.film()?.save("cornell.exr")?;
//! # Ok(())
//! # }
//! ```
//!
//! # In a browser
//!
//! The library compiles for `wasm32-unknown-unknown`, without default features, and renders by WebGPU. A page must not
//! wait, so that all that reads from the device is asynchronous: [`gpu::Gpu::new_async`], [`render::open_async`] and
//! the methods of [`render::Renderer`] whose names end in `_async`. The functions of the same names without this ending
//! wait for them, and exist everywhere else; a render reads nothing in any other way. A page has no files either:
//! [`scene::load_bytes`] takes a scene's bytes and a function that returns those of the files that it refers to, and
//! [`film::exr::Picture::encode`] returns those of a picture. There are no threads, so that rayon runs on one. What
//! needs files, processes or libraries is left out: [`mod@bench`], [`stress`] and [`film::oidn`].
//!
//! # Layers
//!
//! Imports go down this list only, and no circle joins files of different folders (`tests/imports.rs`):
//!
//! | layer | content |
//! |---|---|
//! | [`crop`] | parts of images |
//! | [`scene`], [`gpu`] | scenes as plain data and their loaders; a thin layer over wgpu |
//! | [`settings`], [`film`], [`metrics`], [`exposure`], [`tonemap`] | options; images, their errors and display |
//! | [`mod@reference`] | the CPU path tracer, which shares only scene and film with the renderers |
//! | [`staging`] | the camera and the light that a file leaves out |
//! | [`render::upload`], [`render::lights`] | the scene on the device; light tables and trees |
//! | [`render::visibility`], [`render::denoise`] | lists, depth maps, what rays are traced through; few samples |
//! | [`render::shared`], [`render::subpaths`] | the estimators: shared subpaths; paths and BDPT per pixel |
//! | [`render::open`] | the one door to both |
//! | [`mod@bench`], [`stress`], `viewer`, the command line | programs |
//!
//! # From a file to a picture
//!
//! ```text
//!     file ──load──► Scene ──flatten──► Geometry ─┬─► GpuScene ─┐
//!                      │                          │             ├─► Frame: passes ──► Film ──► EXR, PNG
//!                      └─► SceneStats ─► FramePlan┼─────────────┘                      │
//!                             Settings ─┘         └─► Reference (CPU) ──────────► Film ┴──► Comparison
//! ```
//!
//! [`render::shared::plan::FramePlan`] decides from facts of the scene, the settings and the device which
//! passes run, with the reason, before anything is allocated: a skipped pass has no pipeline and no buffer.
//! Lists that overflow grow, and the iteration is redone, so that a finished picture has lost nothing.
//!
//! # One iteration of the shared estimator
//!
//! One light subpath and one direction per bounce serve every pixel:
//!
//! | vertex | made by | pass |
//! |---|---|---|
//! | z1 | rasterizing from the camera, or rays, at borders of lights several | gbuffer, borders, seen_light, eye_vertices |
//! | y0 | choosing a light by power and contribution; on the sky by what comes in | light_point, light_importance, sky_guide |
//! | y1, y2: VPLs | directions from y0, by its reflective shadow map, and from y1 | rsm, light_subpath |
//! | z2, z3, ... | the nearest triangle along a ray-bundle, or a direction of the pixel's own | extend |
//!
//! Views hold, per texel, a list of every triangle that touches it: ray-bundles are parallel, maps around
//! light vertices have six faces (view_setup, view_lists). The exact ray is intersected with the list, so
//! visibility does not depend on the resolution. Where that is cheaper, and for mirrors, glass and gloss,
//! rays are marched through a grid of such lists instead, which is rasterized once per pose
//! ([`render::visibility`]). Each z is connected with each y (connect, light_candidates, light_reservoirs),
//! hits on emitters are added, and every path is weighted against all other strategies that could have made
//! it (multiple importance sampling). Light that a mirror or glass throws onto a surface comes from light paths
//! of their own, half of which are aimed at mirrors and glass; they are connected to the camera (caustics).
//! accumulate adds the iteration to the film; interleaved iterations go to layers that [`render::denoise`]
//! turns into a picture.
//!
//! # Glossary
//!
//! - **light subpath** y0 y1 y2: y0 on the light. **Eye subpath** z0 z1 z2 ...: z0 the camera.
//! - **strategy (s, t)**: s light vertices and t eye vertices joined by one connection; s = 0: the eye
//!   subpath hits an emitter.
//! - **bounces**: indirect bounces; 0 is direct light only.
//! - **VPL**: virtual point light, a light vertex y1 or y2.
//! - **ray-bundle**: a parallel projection of the scene along one direction; it serves that direction and the
//!   opposite one.
//! - **map**: six perspective faces around a light vertex. Bundles and maps are **views**.
//! - **node**: an entry of a list: a triangle and the next node.
//! - **`pdf_w`, `pdf_a`**: density per solid angle, per area; `pdf_a = pdf_w |cos| / d^2`.
//! - **`a_from_b`**: a transform that takes b to a, such as `world_from_camera`.
//! - **iteration** or **sample** of `shared`: one light subpath and one set of bundles for every pixel, or
//!   for each class of pixels. Of the other methods: one path, or one subpath of either side, for each pixel.
//!
//! # Shaders
//!
//! WESL modules under `shaders/`, in folders named as the Rust modules that record them, linked at run time
//! by [`gpu::link`] with the [flags](gpu::Flag) that the plan chose. Bindings are declared there and bound by
//! name. Structs and constants that both sides read are in [`render::layouts`], and a test compares them with
//! the shaders. Debug builds read shaders from the source tree.

#[cfg(not(target_family = "wasm"))]
pub mod bench;
#[cfg(feature = "cli")]
pub mod cli;
pub mod crop;
pub mod exposure;
pub mod film;
pub mod gpu;
pub mod metrics;
pub mod reference;
pub mod render;
pub mod scene;
pub mod settings;
pub mod staging;
#[cfg(not(target_family = "wasm"))]
pub mod stress;
pub mod tonemap;
#[cfg(feature = "viewer")]
pub mod viewer;
