//! Builds the passes and buffers of a plan.

use crate::gpu::{Flag, Gpu};
use crate::render::denoise::Denoiser;
use crate::render::layouts::classes::MOST_TOGETHER;
use crate::render::layouts::{self, FrameUniform};
use crate::render::lights::bundle_directions::BundleDirections;
use crate::render::shared::film_buffer::PixelBuffers;
use crate::render::shared::frame::Frame;
use crate::render::shared::passes::camera::borders::Borders;
use crate::render::shared::passes::camera::eye_vertices::EyeVertices;
use crate::render::shared::passes::camera::gbuffer::GBuffer;
use crate::render::shared::passes::camera::seen_light::SeenLight;
use crate::render::shared::passes::film::accumulate::Accumulate;
use crate::render::shared::passes::light::caustics::Caustics;
use crate::render::shared::passes::light::light_candidates::LightCandidates;
use crate::render::shared::passes::light::light_point::LightPoint;
use crate::render::shared::passes::light::light_reservoirs::LightReservoirs;
use crate::render::shared::passes::light::light_subpath::LightSubpath;
use crate::render::shared::passes::light::rsm::Rsm;
use crate::render::shared::passes::light::sky_guide::SkyGuide;
use crate::render::shared::passes::paths::connect::Connect;
use crate::render::shared::passes::paths::extend::Extend;
use crate::render::shared::passes::views::list_lengths::ListLengths;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::strategies::{Connection, Extension};
use crate::render::shared::plan::views::ViewRole;
use crate::render::shared::strategy_uniforms::StrategyUniforms;
use crate::render::shared::views::Views;
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::visibility::tracer::Tracing;
use crate::settings::{RestirBias, Settings};

/// A connection with its constants for each light. Direct light from candidates has no pass of its own.
pub struct ConnectionPass {
    /// The strategy.
    pub connection: Connection,
    /// Constants of the strategy for each light.
    pub strategies: StrategyUniforms,
    /// The pass.
    pub pass: Option<Connect>,
}

/// The passes of an iteration; None where the plan skips one.
pub struct Passes {
    /// y0 and the other light points.
    pub light_point: Option<LightPoint>,
    /// The reflective shadow map of y0.
    pub rsm: Option<Rsm>,
    /// Places where light of the sky comes in.
    pub sky_guide: Option<SkyGuide>,
    /// y1 and y2.
    pub light_subpath: Option<LightSubpath>,
    /// Light paths by way of mirrors and clear glass.
    pub caustics: Option<Caustics>,
    /// Triangles that pixels see, unless rays find them.
    pub gbuffer: Option<GBuffer>,
    /// Triangles whose sides pass near a pixel's ray.
    pub borders: Option<Borders>,
    /// Where the camera sees borders of lights.
    pub seen_light: Option<SeenLight>,
    /// z1.
    pub eye_vertices: EyeVertices,
    /// Connections in the plan's order.
    pub connections: Vec<ConnectionPass>,
    /// Direct light from candidates.
    pub light_candidates: Option<LightCandidates>,
    /// Reuse of the last iteration's candidates.
    pub light_reservoirs: Option<LightReservoirs>,
    /// Extensions in the plan's order, each with its constants.
    pub extensions: Vec<(StrategyUniforms, Extend)>,
    /// List lengths in place of light.
    pub list_lengths: Option<ListLengths>,
    /// The film.
    pub accumulate: Accumulate,
}

/// Flags by purpose.
struct FlagSets {
    /// Surfaces, layers and the distribution of bundles.
    base: Vec<Flag>,
    /// The reflective shadow map.
    rsm: &'static [Flag],
    /// The sky's guide.
    guide: &'static [Flag],
    /// The guide and the sky, for passes without the flags of lights.
    guided_sky: Vec<Flag>,
    /// Emission from y0: punctual lights and their patterns.
    emission: Vec<Flag>,
}

impl FlagSets {
    fn new(plan: &FramePlan, sky_bundles: bool) -> Self {
        let bundles: &[Flag] = if sky_bundles { &[Flag::SkyBundles] } else { &[] };
        let emission = plan.light_flags.iter().filter(|flag| matches!(flag, Flag::Punctual | Flag::Patterns));
        let guide: &[Flag] = if plan.guides_sky { &[Flag::SkyGuide] } else { &[] };
        let map = plan.light_flags.iter().filter(|flag| plan.guides_sky && matches!(flag, Flag::EnvironmentMap));
        Self {
            base: [plan.surface_flags.as_slice(), bundles, plan.layer_flags()].concat(),
            rsm: if plan.rsm { &[Flag::Rsm] } else { &[] },
            guide,
            guided_sky: guide.iter().chain(map).copied().collect(),
            emission: emission.copied().collect(),
        }
    }

    /// Returns the base flags and more.
    fn with(&self, more: &[&[Flag]]) -> Vec<Flag> {
        [self.base.clone(), more.concat()].concat()
    }
}

/// Returns the flags of shaders that trace rays.
fn ray_flags(tracing: Tracing) -> Vec<Flag> {
    [&[Flag::Rays], tracing.flags()].concat()
}

/// Returns the flags of shaders that put queries to a view.
fn view_flags(plan: &FramePlan, role: ViewRole) -> Vec<Flag> {
    if let Some(tracing) = plan.tracing.filter(|_| plan.ray_views.answer(role)) {
        return ray_flags(tracing);
    }
    let of_light = matches!(role, ViewRole::LightVertex(0) | ViewRole::Light(_) | ViewRole::Candidate(_));
    let flags = [
        (Flag::Fast, plan.fast),
        (Flag::Infinite, of_light && plan.light_extents.infinite),
        (Flag::Projected, !role.is_map()),
    ];
    flags.into_iter().filter(|(_, on)| *on).map(|(flag, _)| flag).collect()
}

impl Frame {
    /// Builds the passes and allocates the buffers of a plan.
    #[must_use]
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        plan: &FramePlan,
        settings: &Settings,
        directions: Option<BundleDirections>,
    ) -> Self {
        let views = Views::new(gpu, u64::from(scene.triangles), plan);
        let bundle_pdfs = directions.as_ref().map(|d| d.pdfs.as_slice());
        Self {
            passes: Passes::new(gpu, scene, plan, settings, directions.is_some()),
            pixels: PixelBuffers::new(gpu, plan, settings, bundle_pdfs),
            denoiser: plan.is_layered().then(|| Denoiser::new(gpu, &plan.denoise(), settings.samples_per_seen_lobe())),
            directions,
            light_points: Vec::new(),
            rsm_of: None,
            gbuffer_camera: None,
            uniform: FrameUniform::default(),
            light_vertices: gpu.storage(
                "light_vertices",
                u64::from(2 * MOST_TOGETHER) * layouts::LightVertex::bytes(&plan.surface_flags) as u64,
            ),
            log: gpu.storage("log", 8 + 8 * views.slots() as u64),
            views,
            plan: plan.clone(),
        }
    }

    /// Returns the bytes of all buffers and targets of the frame.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let Passes { caustics, gbuffer, borders, seen_light, light_candidates, light_reservoirs, .. } = &self.passes;
        self.pixels.bytes()
            + self.denoiser.as_ref().map_or(0, Denoiser::bytes)
            + if self.passes.sky_guide.is_some() { SkyGuide::BYTES } else { 0 }
            + caustics.as_ref().map_or(0, |caustics| caustics.splats.size())
            + gbuffer.as_ref().map_or(0, GBuffer::bytes)
            + borders.as_ref().map_or(0, Borders::bytes)
            + seen_light.as_ref().map_or(0, |pass| pass.seen.size())
            + self.views.bytes()
            + light_candidates.as_ref().map_or(0, LightCandidates::bytes)
            + light_reservoirs.as_ref().map_or(0, LightReservoirs::bytes)
    }
}

impl Passes {
    /// Returns the sky's guide, if there is one.
    pub(super) fn guide(&self) -> Option<&wgpu::TextureView> {
        self.sky_guide.as_ref().map(|guide| &guide.view)
    }

    fn new(gpu: &Gpu, scene: &GpuScene, plan: &FramePlan, settings: &Settings, sky_bundles: bool) -> Self {
        let flags = FlagSets::new(plan, sky_bundles);
        let FlagSets { rsm, guide, guided_sky, emission, .. } = &flags;
        let [of_light, of_vpl, of_bundle] = [ViewRole::LightVertex(0), ViewRole::LightVertex(1), ViewRole::Bundle(0)]
            .map(|role| view_flags(plan, role));
        let [width, height] = plan.grid.size;
        let of_camera = plan.tracing.filter(|_| plan.traces_camera).map_or_else(Vec::new, ray_flags);
        let with = |more: &[&[Flag]]| flags.with(more);
        let clamp_distance = settings.paper_clamp * 2.0 * scene.sphere().1;
        let emitters: &[Flag] = if plan.camera_hits_emitters { &plan.light_flags } else { &[] };
        let borders: &[Flag] = if plan.draws_borders { &[Flag::Borders] } else { &[] };
        let light_borders: &[Flag] = if plan.light_borders { &[Flag::LightBorders] } else { &[] };
        let pixels = u64::from(width) * u64::from(height);
        let caustics = plan.tracing.filter(|_| plan.traces_caustics).map(|tracing| {
            let flags = with(&[&plan.light_flags, &ray_flags(tracing), plan.adaptive_flags()]);
            let weighted = settings.only.is_none_or(|only| only.weighted);
            let s = settings.only.map_or(0, |only| only.s);
            let counts = [f32::from(u8::from(weighted)), 0.0, 0.0, 0.0];
            let constants = layouts::Strategy { sample_counts: counts, s, ..Default::default() };
            Caustics::new(gpu, &flags, StrategyUniforms::new(gpu, &constants, 1), pixels)
        });
        let after_light: &[Flag] = if caustics.is_some() { &[Flag::Caustics] } else { &[] };
        let (light_candidates, light_reservoirs) = candidate_passes(gpu, plan, &flags);
        Self {
            light_point: (plan.light_vertices > 0).then(|| {
                let one_by_one = plan.direct_lights > 1 && !plan.ray_views.lights;
                let counts = [plan.light_points(), plan.light_point_room()];
                LightPoint::new(gpu, &with(&[&plan.light_flags, guide]), counts, plan.light_resolution, one_by_one)
            }),
            rsm: plan.rsm.then(|| Rsm::new(gpu, &with(&[&of_light, emission]))),
            sky_guide: plan.tracing.filter(|_| plan.guides_sky).map(|tracing| {
                SkyGuide::new(
                    gpu,
                    &[plan.surface_flags.as_slice(), &plan.light_flags, plan.layer_flags(), &ray_flags(tracing)]
                        .concat(),
                )
            }),
            light_subpath: (plan.light_vertices > 1).then(|| {
                LightSubpath::new(gpu, &with(&[&of_light, rsm, guided_sky, emission]), &with(&[&of_vpl, rsm, emission]))
            }),
            caustics,
            gbuffer: (!plan.traces_camera).then(|| GBuffer::new(gpu, &plan.surface_flags, width, height)),
            borders: plan.draws_borders.then(|| Borders::new(gpu, plan.grid.size)),
            seen_light: plan.light_borders.then(|| SeenLight::new(gpu, &with(&[emitters, &of_camera]), plan.grid.size)),
            eye_vertices: EyeVertices::new(
                gpu,
                &with(&[emitters, plan.adaptive_flags(), &of_camera, borders, light_borders]),
            ),
            connections: plan.connections.iter().map(|c| connection(gpu, plan, &flags, c, clamp_distance)).collect(),
            light_candidates,
            light_reservoirs,
            extensions: plan.extensions.iter().map(|e| extension(gpu, plan, &flags, e, clamp_distance)).collect(),
            list_lengths: plan.list_lengths.then(|| ListLengths::new(gpu, &with(&[&of_bundle]))),
            accumulate: Accumulate::new(gpu, &[plan.layer_flags(), plan.adaptive_flags(), after_light].concat()),
        }
    }
}

/// Builds the pass of a connection.
fn connection(gpu: &Gpu, plan: &FramePlan, flags: &FlagSets, c: &Connection, clamp_distance: f32) -> ConnectionPass {
    let from_candidates = plan.has_candidates() && c.is_direct();
    let constants = layouts::Strategy {
        sample_counts: plan.sample_counts(c.samples),
        s: c.s,
        j: c.j,
        clear: u32::from(plan.is_clear(c)),
        clamp_distance,
        narrow_only: u32::from(c.narrow_only),
        light_points: if from_candidates { plan.light_candidates } else { plan.points_connected(c) },
        lights: plan.lights_connected(c),
        ..Default::default()
    };
    let from_y0: &[&[Flag]] = if c.s == 1 { &[flags.rsm, &flags.guided_sky, &flags.emission] } else { &[] };
    let of_view = view_flags(plan, ViewRole::LightVertex(c.s - 1));
    let roulette: &[Flag] = if plan.grid.side > 1 && of_view.contains(&Flag::Rays) { &[Flag::Roulette] } else { &[] };
    let shader = flags.with(&[&[of_view.as_slice(), roulette], from_y0].concat());
    ConnectionPass {
        connection: *c,
        strategies: StrategyUniforms::new(gpu, &constants, plan.lights_connected(c)),
        pass: (!from_candidates).then(|| Connect::new(gpu, &shader, c.s, c.clamped)),
    }
}

/// Builds the pass of an extension.
fn extension(
    gpu: &Gpu,
    plan: &FramePlan,
    flags: &FlagSets,
    e: &Extension,
    clamp_distance: f32,
) -> (StrategyUniforms, Extend) {
    let sample_counts = plan.sample_counts(e.samples);
    let narrow_only = u32::from(e.narrow_only);
    let own_sky = u32::from(plan.guides_sky && !(e.j == 1 && plan.has_candidates()));
    let constants =
        layouts::Strategy { sample_counts, j: e.j, clamp_distance, narrow_only, own_sky, ..Default::default() };
    let emitters: &[Flag] = if e.hits_emitter { &plan.light_flags } else { &[] };
    let guide = if e.hits_emitter { flags.guide } else { &[] };
    // Several classes are alike, so that a software driver's threads have equal work.
    let swizzled: &[Flag] = if gpu.capabilities.software && plan.grid.together == 1 { &[Flag::Swizzled] } else { &[] };
    let shader = flags.with(&[emitters, guide, &view_flags(plan, ViewRole::Bundle(e.j - 1)), swizzled]);
    (StrategyUniforms::new(gpu, &constants, 1), Extend::new(gpu, &shader, e.last))
}

/// Builds the passes of light candidates and of their reuse.
fn candidate_passes(
    gpu: &Gpu,
    plan: &FramePlan,
    flags: &FlagSets,
) -> (Option<LightCandidates>, Option<LightReservoirs>) {
    let FlagSets { emission, .. } = flags;
    let of_light = view_flags(plan, ViewRole::LightVertex(0));
    let reuse: &[Flag] = if plan.reuses() { &[Flag::Reuse] } else { &[] };
    let candidates = plan.has_candidates().then(|| {
        let select = flags.with(&[emission, reuse]);
        let test = flags.with(&[&of_light, reuse]);
        let demodulated = plan.is_layered() && plan.glossy();
        let bytes = plan.grid.largest() * layouts::SelectedLight::bytes(demodulated, plan.reuses());
        LightCandidates::new(gpu, &select, &test, plan.candidate_views().len() as u32, bytes)
    });
    let reservoirs = plan.reuse.filter(|_| plan.reuses()).map(|bias| {
        let pixels = plan.grid.size.iter().map(|&side| u64::from(side)).product();
        let (select, test) = (flags.with(&[emission]), flags.with(&[&of_light]));
        LightReservoirs::new(gpu, &select, &test, pixels, bias == RestirBias::Biased)
    });
    (candidates, reservoirs)
}
