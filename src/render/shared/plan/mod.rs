//! Decides an iteration before anything is allocated: passes, shader flags, views, sizes and bytes, with the
//! reason for each.
//!
//! [`strategies`] chooses the strategies (s, t), [`views`] lists the views, [`ray_views`] chooses those that
//! rays answer, [`memory`] counts bytes, [`interleave`] chooses how many pixels share a light subpath by the model of [`cost`], and [`report`]
//! writes the rows that `lightsheaf plan` prints.

pub mod cost;
pub mod interleave;
pub mod memory;
pub mod ray_views;
pub mod report;
pub mod strategies;
pub mod views;

use crate::gpu::{Capabilities, Flag};
use crate::render::denoise::plan::DenoisePlan;
use crate::render::interleave::Grid;
use crate::render::layouts::classes::MOST_TOGETHER;
use crate::render::layouts::light_points::MOST_LIGHT_POINTS;
use crate::render::planned_pass::PlannedPass;
use crate::render::scene_flags::{chosen, light_flags, surface_flags};
use crate::render::shared::plan::cost::Cost;
use crate::render::shared::plan::ray_views::RayViews;
use crate::render::shared::plan::strategies::{Connection, Extension, StrategySet};
use crate::render::visibility::tracer::Tracing;
use crate::scene::model::stats::LEAST_SMOOTH;
use crate::scene::{Camera, SceneStats};
use crate::settings::{LightSampling, RestirBias, Settings, Strategies, Visibility, VisibilityFrom};

/// Scenes with at most this many light clusters use one light sample per iteration; others select direct
/// light from candidates.
const FEW_LIGHTS: usize = 16;

/// Most lights that can each have a light point, and a view around it, in every iteration.
pub const MOST_DIRECT_LIGHTS: usize = 4;

/// Samples that the light subpath counts as in MIS beside eye subpaths of each pixel's own, where light comes in from
/// outside and few light subpaths do. It errs alike in all pixels that share it, so that neither the filter nor the eye
/// averages its error over pixels, as they do with noise. Measured at equal samples (docs/journal.md, "What all pixels
/// share"): FLIP falls to 0.64 to 0.99, rel_mse lies between 0.71 and 1.14.
const SHARED_SAMPLES: f32 = 0.25;

/// Light points on the sky where it has a guide. Measured at 16 samples (docs/journal.md): with 4 an iteration
/// takes up to a tenth longer and has a fifth less error; with 8 a fifth longer and a quarter less.
const SKY_POINTS: u32 = 4;

/// Pixels per triangle from which sides of triangles are drawn exactly for the camera. In scenes of more triangles
/// neighbours lie close enough (Sponza on two drivers: rel_mse below 5e-7 without).
const PIXELS_OF_BORDERS: u64 = 64;

/// Pixels that a picture counts as having at least in that choice: sides of a few triangles cost nothing in any picture, and
/// in a small one they are much of it.
const MIN_PIXELS_OF_BORDERS: u64 = 1 << 12;

/// Light candidates of scenes with many lights, and of those with several that rays connect at little cost.
const CANDIDATES: u32 = 16;

/// Pixels of a band: as many as WebGPU's least binding holds eye vertices of. On a GPU many small bands take
/// longer, since each pass waits for the slowest ray of the pass before (H100, Sponza at 1920x1080: 82, 45 and 35 ms
/// for bands of 2^17, 2^19 and 2^22 pixels).
const BAND_PIXELS: u32 = 1 << 20;

/// Pixels of a band on a software driver, whose caches hold little. A picture of up to two bands is one band: two
/// took 8 % longer in cornell_point, while eight and sixteen are alike. The maps of light candidates are drawn for
/// each band, so there bands are large.
const SMALL_BAND_PIXELS: u32 = 1 << 17;
const TWO_SMALL_BANDS: u32 = 2 * SMALL_BAND_PIXELS;

/// The extents of a scene's lights.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LightExtents {
    /// True if lights with a position exist; their maps have six faces.
    pub local: bool,
    /// True if lights at infinity exist; their views have one direction at a time.
    pub infinite: bool,
}

/// Texels along a side of each kind of view.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Resolutions {
    bundle: u32,
    bundle_slabs: u32,
    light: u32,
    vpl: u32,
}

/// The plan of an iteration: a pure value.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FramePlan {
    /// Passes, run or skipped, in the order in which they first run.
    pub passes: Vec<PlannedPass>,
    /// Flags of shaders that read surfaces or eye vertices.
    pub surface_flags: Vec<Flag>,
    /// Flags of shaders that sample or hit lights.
    pub light_flags: Vec<Flag>,
    /// Light vertices: 0 without lights, otherwise y0 and up to two VPLs.
    pub light_vertices: u32,
    /// Light points that direct light is selected from; the first is y0.
    pub light_candidates: u32,
    /// Lights that each have a light point for direct light in every iteration; 0 if direct light is selected
    /// from candidates or comes from y0. Without this, sums of few iterations have too much of the sky or of
    /// the sun (docs/journal.md, "Cost of an iteration").
    pub direct_lights: u32,
    /// Light points on the sky for direct light in every iteration, if light points are not candidates. The first of
    /// them may be y0.
    pub sky_points: u32,
    /// The weighting of reservoirs that are reused from the last iteration; None without reuse.
    pub reuse: Option<RestirBias>,
    /// True if lights are chosen by their unoccluded contribution to the view, false if by power alone.
    pub lights_for_view: bool,
    /// The extents of lights.
    pub light_extents: LightExtents,
    /// True if light subpaths start from emissive surfaces and the environment, which eye subpaths can hit.
    pub starts_from_emitters: bool,
    /// True if bundle directions follow the environment map, eq. (2): only if no other strategy samples it.
    /// Measured on cornell_env, 64 samples: alone, rel_mse falls from 0.21 to 0.012; beside light subpaths
    /// from the sky it rises from 0.0027 to 0.0044, since fewer bundles go between surfaces.
    pub sky_bundles: bool,
    /// True if lights without extent have a reflective shadow map that proposes directions (pass rsm).
    pub rsm: bool,
    /// True if light subpaths from the sky follow what the view has found (pass sky_guide): where the camera is
    /// inside the scene, unless lists or depth maps have to answer visibility.
    pub guides_sky: bool,
    /// True if the map around a light without extent is kept for the next iteration. Depth maps hold the
    /// decisions at blended surfaces, which have to be made anew; lists do not.
    pub keeps_maps: bool,
    /// Connections in order.
    pub connections: Vec<Connection>,
    /// Extensions in order; each takes a bundle of its own.
    pub extensions: Vec<Extension>,
    /// True if the film shows list lengths of the first bundle in place of light.
    pub list_lengths: bool,
    /// Texels along a side of a bundle.
    pub bundle_resolution: u32,
    /// Depth slabs of a bundle's texel, each with a list.
    pub bundle_slabs: u32,
    /// Texels along a side of a face around a light.
    pub light_resolution: u32,
    /// Texels along a side of a face around a VPL.
    pub vpl_resolution: u32,
    /// True if emitters that the camera sees count: strategy (0, 2).
    pub camera_hits_emitters: bool,
    /// True if pixels at the borders of these have several places.
    pub light_borders: bool,
    /// True if two iterations share a G-buffer, since rasterizing the triangles costs more than more pixel
    /// positions gain at edges (docs/journal.md, "Cost of an iteration").
    pub shares_gbuffer: bool,
    /// True if triangles whose sides pass within a pixel are drawn for exact rays.
    pub draws_borders: bool,
    /// True if lists are centre-sampled and depths compared (`--visibility fast`).
    pub fast: bool,
    /// The views whose queries rays answer in place of lists and maps.
    pub ray_views: RayViews,
    /// The reason for it.
    pub rays_reason: String,
    /// True if the camera's rays are traced, too, in place of a G-buffer: where `exact` traces any. The same
    /// holds for the other algorithms, so that all start from the same z1.
    pub traces_camera: bool,
    /// True if eye vertices draw directions of their own in place of the bundle's, since surfaces are glossy, and
    /// paths follow mirrors and glass.
    pub own_directions: bool,
    /// Samples that the light subpath counts as in MIS: less than 1 in rooms lit from outside whose eye subpaths are of each
    /// pixel's own.
    pub shared_samples: f32,
    /// True if light paths by way of smooth surfaces are connected to the camera, in the weights of the others.
    pub caustics: bool,
    /// True if these light paths are traced: unless another strategy alone counts.
    pub traces_caustics: bool,
    /// The algorithm that traces rays, if any are traced.
    pub tracing: Option<Tracing>,
    /// Node capacity at the start, as a multiple of the usual guess.
    pub list_room: f32,
    /// Most vertices of a path between camera and light, those included that count as no bounces.
    pub most_vertices: u32,
    /// Those of them on glass and mirrors that may count as no bounces.
    pub specular_bounces: u32,
    /// The division of the image into pixels that share a light subpath, and into bands that bound the memory
    /// per pixel.
    pub grid: Grid,
    /// The reason for the side of its squares.
    pub interleave: String,
    /// The cost of an iteration by the model that chooses the side.
    pub cost: Cost,
    /// True if converged tiles take no more samples.
    pub adaptive: bool,
    /// True if tiles that have converged, or that lie outside a crop, are left out.
    pub skips_tiles: bool,
    /// True if direct light has no noise, so that it bypasses the filter.
    pub clear_light: bool,
    /// True if a filter averages the pixels of a square.
    pub filtered: bool,
    /// True if two more pictures measure the bias of the filter: one unfiltered, one filtered twice.
    pub measures_bias: bool,
    /// True if fireflies of the layers are clamped to the brightness of their neighbours.
    pub clamps_fireflies: bool,
    /// Frames that indirect light is averaged over; 0 for none.
    pub history: u32,
    /// Bytes of buffers and textures beside the scene, at the start.
    pub bytes: u64,
}

impl FramePlan {
    /// Decides from the statistics of a scene, the settings and the device.
    #[must_use]
    pub fn new(stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> Self {
        // Of several emitters a light point of the iteration is mostly one that is far from a pixel, or weak there.
        let several = stats.light_sources > 1
            && stats.emissive_triangles > 0
            && settings.strategies != Strategies::Paper
            && settings.light_sampling.is_none()
            && settings.light_pool.is_none();
        let many = stats.light_places > FEW_LIGHTS;
        if several && !many {
            let plan = Self::with_pool(stats, settings, capabilities, true);
            if plan.ray_views.lights {
                return plan;
            }
        }
        Self::with_pool(stats, settings, capabilities, many)
    }

    /// Decides it with direct light that is selected from candidates, unless the settings say otherwise, or without.
    fn with_pool(stats: &SceneStats, settings: &Settings, capabilities: &Capabilities, pool: bool) -> Self {
        let sampling = settings.light_sampling;
        let resamples = sampling.is_some_and(LightSampling::resamples);
        let mut strategies = StrategySet::new(stats, settings);
        let light_vertices = strategies.light_vertices;
        let pool = pool && light_vertices > 0;
        let usual = if pool || resamples { CANDIDATES } else { 1 };
        strategies.light_candidates = if light_vertices == 0 { 1 } else { settings.light_pool.unwrap_or(usual) };
        let light_candidates = strategies.light_candidates;
        let direct_lights = direct_lights(stats, settings, light_vertices);
        let connections = strategies.connections();
        let extensions = strategies.extensions(&connections);
        let reuse = (sampling == Some(LightSampling::Restir)).then_some(settings.restir_bias);
        let fast = settings.visibility() == Visibility::Fast;
        let own_directions = settings.draws_own_directions() && stats.glossy_triangles > 0;
        let caustics = own_directions
            && light_vertices > 1
            && stats.smooth_share >= LEAST_SMOOTH
            && settings.only.is_none_or(|only| only.weighted || only.t == 1);
        let sizes = resolutions(stats, settings, fast, light_candidates > 1 || reuse.is_some());
        let starts_from_emitters =
            strategies.emitters && light_vertices > 0 && settings.strategies != Strategies::Paper;
        let hits_sky = stats.environment_map && extensions.iter().any(|e: &Extension| e.hits_emitter);
        let lights = stats.lights + usize::from(stats.environment);
        let guides_sky = stats.environment
            && stats.camera_inside
            && starts_from_emitters
            && light_vertices > 1
            && !fast
            && settings.visibility_from != VisibilityFrom::Lists;
        let mut plan = Self {
            passes: Vec::new(),
            surface_flags: vertex_flags(stats, own_directions, caustics, strategies.specular_bounces > 0),
            light_flags: light_flags(stats),
            light_vertices,
            light_candidates,
            direct_lights,
            sky_points: 1,
            reuse,
            lights_for_view: pool && (sampling.is_none() || resamples),
            light_extents: LightExtents { local: stats.local_lights, infinite: stats.infinite_lights },
            starts_from_emitters,
            sky_bundles: hits_sky && !starts_from_emitters,
            rsm: stats.lights > 0 && light_vertices > 1,
            guides_sky,
            keeps_maps: !fast || stats.blended_triangles == 0,
            connections,
            extensions,
            list_lengths: settings.list_lengths,
            camera_hits_emitters: strategies.hits_emitter(0),
            light_borders: false,
            shares_gbuffer: false,
            draws_borders: false,
            bundle_resolution: sizes.bundle,
            bundle_slabs: sizes.bundle_slabs,
            light_resolution: sizes.light,
            vpl_resolution: sizes.vpl,
            fast,
            ray_views: RayViews::default(),
            rays_reason: String::new(),
            traces_camera: false,
            own_directions,
            shared_samples: shared_samples(own_directions && guides_sky, settings),
            caustics,
            traces_caustics: caustics && settings.only.is_none_or(|only| only.t == 1),
            tracing: None,
            list_room: settings.list_room,
            most_vertices: strategies.most_vertices(),
            specular_bounces: strategies.specular_bounces,
            grid: Grid::undivided([settings.width, settings.height], settings.upsample),
            interleave: String::new(),
            cost: Cost::default(),
            adaptive: false,
            skips_tiles: false,
            clear_light: stats.emissive_triangles == 0
                && stats.blended_triangles == 0
                && lights == stats.sharp_lights
                && light_candidates == 1
                && (lights == 1 || direct_lights > 0),
            filtered: false,
            measures_bias: false,
            clamps_fireflies: settings.tame_outliers,
            history: settings.history,
            bytes: 0,
        };
        plan.choose_ray_views(stats, settings, capabilities);
        plan.choose_sky_points(stats, settings);
        plan.divide_image(stats, settings, capabilities);
        plan.bytes = plan.count_bytes(stats, settings, capabilities);
        plan.passes = plan.rows(stats, settings);
        plan
    }

    /// Chooses the number of light points on the sky. Rays, which connect them at little cost, test what a guided sky
    /// lights.
    fn choose_sky_points(&mut self, stats: &SceneStats, settings: &Settings) {
        let alone = stats.lights == 0 && stats.emissive_triangles == 0;
        let pooled = self.light_candidates > 1 || self.reuse.is_some() || settings.light_sampling.is_some();
        if !self.guides_sky || pooled || !(alone || self.direct_lights > 0) {
            return;
        }
        self.sky_points = SKY_POINTS;
        if self.direct_lights == 0 {
            let connections = self.connections.iter_mut().filter(|c| c.is_direct()).map(|c| &mut c.samples);
            let extensions = self.extensions.iter_mut().filter(|e| e.j == 1).map(|e| &mut e.samples);
            connections.chain(extensions).for_each(|samples| samples[1] *= SKY_POINTS);
        }
    }

    /// Chooses the squares of interleaved sampling, the bands, and everything that depends on these.
    fn divide_image(&mut self, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) {
        (self.grid.side, self.interleave) = self.choose_side(stats, settings);
        let fitting = (MOST_LIGHT_POINTS / self.light_point_room()).clamp(1, MOST_TOGETHER);
        self.grid.together = if self.joins_classes(stats) { self.grid.subpaths().min(fitting) } else { 1 };
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        self.grid.layered = self.grid.side > 1 || settings.is_denoised();
        self.light_borders =
            self.camera_hits_emitters && self.traces_camera && self.grid.side > 1 && self.grid.scale == 1;
        self.filtered = self.grid.side > 1 && !settings.unfiltered;
        self.measures_bias = settings.target_error.is_some() && self.denoise().keeps_residual();
        self.skips_tiles = settings.skips_tiles() && !self.is_layered();
        self.adaptive = self.skips_tiles && settings.crop.is_none();
        self.shares_gbuffer = !self.traces_camera && !self.is_layered() && 4 * stats.triangles as u64 > pixels;
        let has_borders = PIXELS_OF_BORDERS * stats.triangles as u64 <= pixels.max(MIN_PIXELS_OF_BORDERS);
        self.draws_borders = !self.traces_camera && has_borders;
        let draws_candidates = self.has_candidates() && !self.reuses() && !self.ray_views.lights;
        let usual = if !capabilities.software || draws_candidates {
            BAND_PIXELS
        } else if pixels <= u64::from(TWO_SMALL_BANDS) {
            TWO_SMALL_BANDS
        } else {
            SMALL_BAND_PIXELS
        };
        let fitting = (capabilities.max_storage_bytes / self.eye_vertex_bytes()).max(1);
        self.grid.band_pixels = settings.band_pixels.unwrap_or(usual.min(u32::try_from(fitting).unwrap_or(u32::MAX)));
    }

    /// True if classes of pixels are rendered together: none has views of its own, nor a reflective shadow map that is not
    /// that of all.
    fn joins_classes(&self, stats: &SceneStats) -> bool {
        self.ray_views == RayViews::ALL && self.own_directions && (!self.rsm || stats.lights == 1)
    }

    /// Returns the number of light points for which a class has room: with their bytes a multiple of 256, so that those of
    /// a class can be bound.
    #[must_use]
    pub fn light_point_room(&self) -> u32 {
        self.light_points().max(1).next_multiple_of(4)
    }

    /// True if another plan has the same pipelines and buffers, for perhaps another number of triangles.
    #[must_use]
    pub fn same_pipelines(&self, other: &Self) -> bool {
        let Self { bytes, cost, ref interleave, ref rays_reason, .. } = *self;
        let (interleave, rays_reason) = (interleave.clone(), rays_reason.clone());
        *self == Self { bytes, cost, interleave, rays_reason, ..other.clone() }
    }

    /// Returns the number of iterations that share a G-buffer: the camera's position and the place within the
    /// pixel are the same. A lens, and frames of a denoised picture, have a G-buffer for each iteration.
    #[must_use]
    pub fn iterations_per_gbuffer(&self, camera: &Camera) -> u64 {
        let has_lens = camera.lens.is_some_and(|lens| lens.radius > 0.0);
        if self.shares_gbuffer && !has_lens { 2 } else { 1 }
    }

    /// True if direct light is selected from several light candidates.
    #[must_use]
    pub fn has_candidates(&self) -> bool {
        (self.light_candidates > 1 || self.reuse.is_some()) && self.connections.iter().any(Connection::is_direct)
    }

    /// True if pixels reuse the reservoirs of the last iteration.
    #[must_use]
    pub fn reuses(&self) -> bool {
        self.reuse.is_some() && self.has_candidates()
    }

    /// Returns the number of light points of an iteration: y0, and the others of direct light.
    #[must_use]
    pub fn light_points(&self) -> u32 {
        self.direct_lights.max(self.light_candidates) + self.sky_points - 1
    }

    /// Returns the number of lights whose points pass connect runs over. Candidates are those of pass
    /// light_candidates.
    #[must_use]
    pub fn lights_connected(&self, connection: &Connection) -> u32 {
        if connection.is_direct() { self.direct_lights.max(1) } else { 1 }
    }

    /// Returns the samples of s = 0, 1, 2, 3 as MIS counts them.
    #[must_use]
    pub fn sample_counts(&self, samples: [u32; 4]) -> [f32; 4] {
        let [s0, s1, s2, s3] = samples.map(|n| n as f32);
        [s0, s1, s2 * self.shared_samples, s3 * self.shared_samples]
    }

    /// Returns the number of light points that pass connect connects.
    #[must_use]
    pub fn points_connected(&self, connection: &Connection) -> u32 {
        self.lights_connected(connection) + if connection.is_direct() { self.sky_points - 1 } else { 0 }
    }

    /// Returns the number of runs of pass connect in a band: one for each light point with a map, one for all that
    /// rays connect.
    #[must_use]
    pub fn runs_of(&self, connection: &Connection) -> u32 {
        if self.connects_by_rays(connection) { 1 } else { self.points_connected(connection) }
    }

    /// True if rays test whether z_j sees light points.
    #[must_use]
    pub fn connects_by_rays(&self, connection: &Connection) -> bool {
        connection.s == 1 && self.ray_views.lights
    }

    /// True if a connection is made in a class of its own, at the resolution of the image.
    #[must_use]
    pub fn is_apart(&self, connection: &Connection) -> bool {
        self.grid.scale > 1 && self.is_clear(connection)
    }

    /// True if the light of a connection bypasses the filter.
    #[must_use]
    pub fn is_clear(&self, connection: &Connection) -> bool {
        self.clear_light && connection.is_direct()
    }

    /// True if an iteration's light goes to layers that are denoised, false if to the film.
    #[must_use]
    pub fn is_layered(&self) -> bool {
        self.grid.layered
    }

    /// Returns the flags of shaders that add light to pixels.
    #[must_use]
    pub fn layer_flags(&self) -> &'static [Flag] {
        if self.is_layered() { &[Flag::Layered] } else { &[] }
    }

    /// Returns the flags of shaders that skip converged tiles.
    #[must_use]
    pub fn adaptive_flags(&self) -> &'static [Flag] {
        if self.skips_tiles { &[Flag::Adaptive] } else { &[] }
    }

    /// True if shaders have code for lobes beside the diffuse one.
    #[must_use]
    pub fn glossy(&self) -> bool {
        self.surface_flags.contains(&Flag::Glossy)
    }

    /// True if light passes surfaces.
    #[must_use]
    pub fn transmits(&self) -> bool {
        self.surface_flags.contains(&Flag::Transmission)
    }

    /// Returns the plan of the denoiser.
    #[must_use]
    pub fn denoise(&self) -> DenoisePlan {
        DenoisePlan {
            grid: self.grid,
            history: self.history,
            filtered: self.filtered,
            measures_bias: self.measures_bias,
            clamps_fireflies: self.clamps_fireflies,
            glossy: self.glossy(),
            mixes: self.surface_flags.contains(&Flag::Mixes),
        }
    }
}

/// Returns the number of lights that each have a light point in every iteration; 0 if there are too many. At
/// most one of them may be local with an extent, since its six faces are rasterized in every iteration.
fn direct_lights(stats: &SceneStats, settings: &Settings, light_vertices: u32) -> u32 {
    let lights = stats.lights + usize::from(stats.environment);
    let each = (2..=MOST_DIRECT_LIGHTS).contains(&lights)
        && stats.emissive_triangles == 0
        && stats.sized_local_lights <= 1
        && light_vertices > 0
        && settings.strategies != Strategies::Paper
        && settings.light_sampling.is_none()
        && settings.light_pool.is_none();
    if each { lights as u32 } else { 0 }
}

/// Returns the resolutions of views, unless the settings set them. Look-ups are fastest if a texel holds a
/// few triangles, rasterization if there are few texels; both change little around a texel of about the
/// triangles' size (docs/journal.md, "Resolution").
fn resolutions(stats: &SceneStats, settings: &Settings, fast: bool, many_maps: bool) -> Resolutions {
    let fitting = |coarsest: u32, finest: u32, texels_per_unit: f32| {
        let fitting = texels_per_unit / stats.mean_triangle_size.max(1e-4);
        (fitting as u32).next_power_of_two().clamp(coarsest, finest)
    };
    let bundle = settings.bundle_resolution.unwrap_or_else(|| fitting(128, 512, 2.0));
    // Lists are long if there are about as many triangles as texels; then depth slabs shorten them. Lists of
    // `fast` are half as long.
    let texels = bundle as usize * bundle as usize;
    let bundle_slabs = if fast { 1 } else { (4 * stats.triangles / texels).clamp(1, 16).next_power_of_two() as u32 };
    // The map of a light candidate is rasterized for the few pixels that selected it. Exact answers do not
    // depend on it.
    let finest = if many_maps && !fast { 64 } else { 512 };
    Resolutions {
        bundle,
        bundle_slabs,
        light: settings.light_resolution.unwrap_or_else(|| fitting(64, finest, 1.5)),
        vpl: settings.vpl_resolution.unwrap_or_else(|| fitting(64, 256, 1.0)),
    }
}

/// Returns the samples that the light subpath counts as. A strategy that is rendered alone counts in full.
fn shared_samples(lit_from_outside: bool, settings: &Settings) -> f32 {
    let weighted = settings.only.is_none_or(|only| only.weighted);
    if lit_from_outside && weighted { SHARED_SAMPLES } else { 1.0 }
}

/// Returns the flags of shaders that read surfaces or eye vertices.
fn vertex_flags(stats: &SceneStats, own_directions: bool, caustics: bool, specular_bounces: bool) -> Vec<Flag> {
    let own = chosen([
        (Flag::Specular, own_directions),
        (Flag::SpecularBounces, specular_bounces),
        (Flag::Transmission, own_directions && stats.transmits),
        (Flag::Disperses, own_directions && stats.disperses),
        (Flag::DiffuseTransmission, own_directions && stats.diffuse_transmission),
        (Flag::Caustics, caustics),
    ]);
    let mut flags = [surface_flags(stats), own].concat();
    flags.sort();
    flags
}
