//! Lightsheaf renders global illumination by rasterization alone: raster bidirectional path tracing (after Tokuyoshi and
//! Ogaki 2012) with exact visibility, on any GPU that wgpu reaches, with or without ray tracing; and a CPU path tracer
//! judges it. This chapter is the map; [`frame`] is the method on one page; after that, any pass: one Rust file and one
//! shader file of the same name.
//!
//! # The way of the data
//!
//! One direction, no way back:
//!
//! ```text
//!     scene file ──load──► Scene ──flatten──► Geometry ─┬─► GpuScene ─┐
//!                            │                          │             ├─► Frame: passes ──► Film ──► EXR, PNG
//!                            └─► SceneStats ─► FramePlan┼─────────────┘                      │
//!                                   Settings ─┘         └─► Reference (CPU) ──────────► Film ┴──► Comparison
//! ```
//!
//! 1. [`staging::load`] is where a file comes in. [`scene::load()`] reads glTF, Mitsuba XML or a built-in scene into plain data and
//!    says what it could not do; [`staging`] adds the camera and the light that the file leaves out. [`scene::Geometry`] flattens
//!    instances into world-space triangles.
//! 2. [`plan::FramePlan`] decides from facts of the scene, [`settings::Settings`] and the device's capabilities which passes
//!    run, with the reason, before anything is allocated. Skipped means no pass, no pipeline, no buffer.
//! 3. [`gpu_scene`] uploads; [`renderer::Renderer`] owns a [`frame::Frame`] and runs its iterations in batches. Lists that
//!    ran out of room grow, and the iteration is redone, so a finished picture has lost nothing.
//!    Where a method asks for it, [`acceleration`] builds what ray queries need from the same positions.
//! 4. [`film::Film`] is the linear image, [`tonemap`] shows it in 8 bits, [`metrics`] says how far two of them are apart.
//! 5. [`mod@reference`] renders the same scene on the CPU and shares no code with the above but the scene and the film.
//! 6. [`mod@bench`] lets all of them, and programs of others, render in turns and takes error against time; [`report`] shows it.
//!
//! # One iteration
//!
//! One light subpath and one direction for each bounce serve every pixel:
//!
//! | what | found by | in |
//! |---|---|---|
//! | z1, what the pixel sees | rasterizing from the camera | [`passes::gbuffer`], [`passes::eye_vertices`] |
//! | y0, a point on a light | the table of all lights ([`light_table`]), by power and, where there are many, by what each would give the view ([`passes::light_gifts`]) | [`passes::light_point`] |
//! | y1, y2, the VPLs | a direction from y0, drawn from its reflective shadow map where it has one ([`passes::rsm`]), then from y1, followed through the map around that vertex | [`passes::light_subpath`] |
//! | z2, z3, ... | the nearest triangle in front of the point in a ray-bundle's list | [`passes::extend`] |
//! | "do y and z see each other?" | the list of the texel of the map around y | [`passes::connect`], [`passes::light_pool`], [`passes::light_reuse`] |
//! | lists of bundles and maps | rasterizing every triangle, dilated, into each view | [`passes::view_setup`], [`passes::view_lists`] ([`passes::depth_maps`] in `fast`) |
//!
//! Each vertex found is joined with each vertex of the light subpath, light that a bundle runs into is added, and every path
//! is weighted against all other strategies that could have made it (multiple importance sampling, section 4.2).
//! [`passes::accumulate`] adds the iteration to the film. Where an error is asked for, [`convergence`]
//! estimates that of the picture, and parts that are near enough to the truth take no more of them
//! ([`tiles`]).
//!
//! # Few samples
//!
//! [`grid`] says which pixels share a light subpath: all, or, interleaved, those of a class, each of which has one and views of its own.
//! [`cost`] says how many classes there are, by a model of what views and pixels take.
//! Then the iteration fills layers instead of the film, and [`live`] makes a picture of them and of what frames before left:
//! [`passes::gradient`], [`passes::temporal`], [`passes::filter`], [`passes::outliers`], [`passes::compose`],
//! [`passes::antialias`].
//!
//! [`passes::list_lengths`] shows what look-ups cost, in place of light, where the viewer asks for it.
//!
//! # With ray queries
//!
//! `twin` is the same [`frame`] with no views rasterized: shaders/visibility has the same questions answered by lists and by rays,
//! so that the difference of two pictures of one seed is visibility error alone.
//!
//! [`path_renderer`] follows paths of each pixel on its own where the device has ray queries: path tracing, or bidirectional path
//! tracing with every strategy. [`passes::light_paths`] traces light subpaths and joins them to the camera,
//! [`passes::eye_paths`] traces eye subpaths and joins them to lights and light subpaths, [`passes::resolve`] adds both to the
//! film. Surfaces and their reflection are those of raster, mirrors and glass join them (shaders/lib/scatter); the weights of all
//! strategies come from one running number per subpath (shaders/lib/mis_subpaths). Surfaces choose lights down a tree
//! ([`light_tree`]); [`passes::reservoirs`] resamples them where the camera looks.
//!
//! # What moves
//!
//! A file that animates anything leaves a rig beside its scene at rest ([`scene::animation`]), and [`scene::Scene::at`] bakes the pose
//! of a time into a scene like any other. [`renderer::Renderer::pose`] goes on from one to the next: [`passes::deform`] morphs, skins
//! and places every vertex in the buffers that all passes and ray queries read; bounds and lights come from the CPU's pose.
//!
//! Meshes that are to be refined ([`scene::tessellation`]) are cut when the scene is flattened ([`scene::refine`]), by factors of edges that
//! the scene's camera decides once a frame; [`passes::tessellate`] puts the new vertices into the same buffers. [`posing`] has both passes, and
//! keeps which vertices and triangles there are as long as edges are cut alike.
//!
//! # Glossary
//!
//! - **light subpath** y0 y1 y2: y0 on the light. **Eye subpath** z0 z1 z2 ...: z0 the camera.
//! - **strategy (s, t)**: s light vertices and t eye vertices joined by one connection; s = 0: the eye subpath met light.
//! - **bounces**: indirect bounces; 0 is direct light only.
//! - **VPL**: virtual point light, a light vertex y1 or y2.
//! - **ray-bundle**: a parallel projection of the whole scene along one direction, each texel with the list of all triangles
//!   that touch it. A bundle serves its direction and the opposite one.
//! - **map**: the same in six perspective faces around a light vertex. Bundles and maps together are **views** ([`view`]).
//! - **node**: an entry of a list: a triangle and the next node.
//! - **exact** and **fast** visibility: lists hold every triangle that touches a texel, and the exact ray is intersected with
//!   them; or depth maps, and lists of triangles that cover the texel's centre, whose depths are compared.
//! - **`pdf_w`, `pdf_a`**: density per solid angle, per area; `pdf_a = pdf_w |cos| / d^2`.
//! - **`a_from_b`**: a transform that takes b to a, such as `world_from_camera`.
//! - **contender**: a method of ours or a **peer**, a program of others, in a benchmark.
//! - **iteration** or **sample** of `raster`: one light subpath and one set of bundles for every pixel. Of the others: one path,
//!   or one subpath of either side, for each pixel.
//!
//! # In a window
//!
//! `viewer` (cargo feature of that name, on by default) shows a scene while it is rendered: one thread renders what was ordered last, another
//! owns the window and never waits for it.
//!
//! # Under stress
//!
//! [`stress`] is a battery of odd scenes, sizes and values, each with what is right; [`gpu::NonFinite`] says which pass made a
//! value that is not finite.
//!
//! # Import rules
//!
//! [`scene`], [`gpu`], [`settings`], [`film`] import nothing of ours, [`metrics`] only the film. [`passes`] never import each
//! other: [`frame`] wires them. [`mod@reference`] never imports the GPU side. [`staging`] imports scene and reference. Only [`report`] imports [`mod@bench`]. Nothing imports
//! `viewer` or the command line, which is part of the program, not of this library. A shader of a pass imports `shaders/lib` and
//! `shaders/visibility`, never another pass.
//!
//! # Shaders
//!
//! WESL modules under `shaders/`, linked at run time by [`gpu::link`] with the flags that the plan chose. Bindings are declared
//! there and bound by name; structs that both sides read are in [`layouts`], and a test compares them with the linked shaders.

pub mod acceleration;
pub mod bench;
pub mod bundle_directions;
pub mod convergence;
pub mod cost;
pub mod film;
pub mod frame;
pub mod gpu;
pub mod gpu_scene;
pub mod grid;
pub mod iteration;
pub mod layouts;
pub mod light_table;
pub mod light_tree;
pub mod live;
pub mod metrics;
pub mod passes;
pub mod path_plan;
pub mod path_renderer;
pub mod pixels;
pub mod plan;
pub mod posing;
pub mod reference;
pub mod renderer;
pub mod report;
pub mod rest;
pub mod sampler;
pub mod scene;
pub mod settings;
pub mod staging;
pub mod stress;
pub mod tiles;
pub mod tonemap;
pub mod view;
#[cfg(feature = "viewer")]
pub mod viewer;
