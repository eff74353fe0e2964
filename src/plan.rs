//! What one iteration does, decided before anything is allocated, and why.

use std::fmt;

use crate::cost::{Cost, Work};
use crate::film;
use crate::gpu::Capabilities;
use crate::grid::Grid;
use crate::layouts;
use crate::scene::{Camera, SceneStats};
use crate::settings::{LightSampling, Method, RestirBias, Settings, Strategies, Visibility};
use crate::tiles;
use crate::view::{Answers, OUTLINE_BYTES, Texels};

/// Most light vertices: the light, y1 and y2.
const MOST_LIGHT_VERTICES: u32 = 3;

/// Where light comes from up to so many places, one light point an iteration is enough; beyond, direct light is chosen from a pool.
const FEW_LIGHTS: usize = 16;

/// Lights that can each have a light point in every iteration, and a view around it.
const MOST_DIRECT_LIGHTS: usize = 4;

/// Light points of the pool.
const POOL: u32 = 16;

/// Pixels that are followed at a time: enough to fill a large device. A picture of up to two bands is one: two took 8 % longer in
/// cornell_point, while eight and sixteen are alike. Where there is a pool of light points their maps are drawn for each band, so there
/// are fewer.
const BAND_PIXELS: u32 = 1 << 17;
const TWO_BANDS: u32 = 2 * BAND_PIXELS;
const POOL_BAND_PIXELS: u32 = 1 << 20;

/// Why nothing starts from a light.
const NO_LIGHT: &str = "no light that subpaths start from";

/// A pass of the iteration.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PlannedPass {
    /// Its name.
    pub name: &'static str,
    /// Runs per iteration; 0: skipped.
    pub runs: u32,
    /// Why.
    pub reason: String,
}

impl PlannedPass {
    /// Of any plan.
    #[must_use]
    pub fn tessellate(stats: &SceneStats) -> Self {
        let runs = u32::from(stats.tessellated_triangles > 0);
        let reason = if runs > 0 { "once a frame, before all else: finer meshes" } else { "no mesh is refined" };
        Self { name: "tessellate", runs, reason: reason.to_owned() }
    }
}

/// A connection of z_j with the light subpath's vertex s.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Connection {
    /// Light vertices of the strategy.
    pub s: u32,
    /// Index of the eye vertex that is joined; the strategy has j + 1 eye vertices.
    pub j: u32,
    /// Samples of s = 0, 1, 2, 3 that take part in MIS for paths of this length.
    pub samples: [u32; 4],
    /// Whether the geometry term is bounded (the paper's (2, 3)).
    pub clamped: bool,
}

impl Connection {
    /// Whether it joins what the camera sees to a light.
    #[must_use]
    pub fn is_direct(&self) -> bool {
        (self.s, self.j) == (1, 1)
    }
}

/// An extension of z_j along a bundle.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Extension {
    /// Index of the eye vertex that is extended.
    pub j: u32,
    /// Whether only light that it meets counts, and no vertex is made.
    pub last: bool,
    /// Whether light that it meets counts.
    pub meets: bool,
    /// Samples of s = 0, 1, 2, 3 that take part in MIS for paths that end in it.
    pub samples: [u32; 4],
}

/// From where light comes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct LitFrom {
    /// From places in the scene, around which there are six faces.
    pub near: bool,
    /// From infinitely far away: along one direction at a time.
    pub afar: bool,
}

/// A pure value: the iteration's passes, shader flags, sizes and bytes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FramePlan {
    /// Passes, run or skipped, in order.
    pub passes: Vec<PlannedPass>,
    /// Flags of shaders that read surfaces.
    pub surface_flags: Vec<&'static str>,
    /// Flags of light: of what has to be sampled, of its patterns, and of what eye subpaths can meet.
    pub light_flags: Vec<&'static str>,
    /// Light vertices that exist: 0 without lights, otherwise the light and up to two VPLs.
    pub light_vertices: u32,
    /// Light points that direct light is chosen from; the first is the light vertex.
    pub light_pool: u32,
    /// Lights that each have a light point for direct light in every iteration; 0: those of the pool are chosen, or y0's. Where the sky's
    /// and the sun's takes turns, sums of few iterations have too much of one of them (README, "Cost of an iteration").
    pub direct_lights: u32,
    /// How what pixels kept of the last iteration's pool is used again, if it is asked for.
    pub reuse: Option<RestirBias>,
    /// Whether lights are chosen for what they would give the view, or by power alone.
    pub lights_for_view: bool,
    /// Whether anything shines that is not infinitely far away, and whether anything does that is.
    pub lit_from: LitFrom,
    /// Whether light subpaths also start from lights that paths from the camera can meet.
    pub starts_from_met: bool,
    /// Whether bundles go where a map says that light comes from, eq. (2): only where nothing else finds it. Measured on
    /// cornell_env, 64 samples: alone, rel_mse falls from 0.21 to 0.012; beside light subpaths from the sky it rises from 0.0027 to
    /// 0.0044, since fewer bundles go between surfaces.
    pub sky_bundles: bool,
    /// Whether lights without extent have a table of what they shine at (pass rsm).
    pub rsm: bool,
    /// Connections in order.
    pub connections: Vec<Connection>,
    /// Extensions in order; each takes a bundle of its own.
    pub extensions: Vec<Extension>,
    /// Whether lengths of the first bundle's lists take the place of light.
    pub list_lengths: bool,
    /// Texels along a side of a bundle.
    pub bundle_resolution: u32,
    /// Slabs of depths that a texel of a bundle keeps lists for.
    pub bundle_slabs: u32,
    /// Texels along a side of a face around a light.
    pub light_resolution: u32,
    /// Texels along a side of a face around a VPL.
    pub vpl_resolution: u32,
    /// Whether light that the camera sees counts.
    pub camera_meets: bool,
    /// Whether two iterations share a G-buffer, where drawing triangles costs more than borders of things gain by more looks (README,
    /// "Cost of an iteration").
    pub shares_looks: bool,
    /// Whether lists are centre-sampled and depths compared.
    pub fast: bool,
    /// Whether ray queries answer instead of lists and maps.
    pub rays: bool,
    /// Room for nodes at the start, as a multiple of the usual guess.
    pub list_room: f32,
    /// Indirect bounces.
    pub bounces: u32,
    /// Which pixels share a light subpath, and which are followed at a time, so that what is kept per pixel is bounded.
    pub grid: Grid,
    /// Why its squares have the side that they have.
    pub interleave: String,
    /// What an iteration takes by the model that chooses the side.
    pub cost: Cost,
    /// Whether tiles of the picture take no more samples once they have settled.
    pub settles: bool,
    /// Whether direct light has no noise that a filter should take away.
    pub clear_light: bool,
    /// Whether the pixels of a square are joined by a filter.
    pub filtered: bool,
    /// Whether two more pictures tell the bias of the filter: one unfiltered, one filtered twice.
    pub measures_bias: bool,
    /// Whether outliers of the layers are given the brightness of those around them.
    pub tamed: bool,
    /// Frames that indirect light is averaged over; 0: none.
    pub history: u32,
    /// Bytes of buffers and textures beside the scene, at the start.
    pub bytes: u64,
}

impl FramePlan {
    /// Decides.
    #[must_use]
    pub fn new(stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> Self {
        let bounces = settings.bounces;
        // Whether a strategy counts, where only one does.
        let counts = |s, t| settings.only.is_none_or(|only| (only.s, only.t) == (s, t));
        let unweighted = settings.only.is_some_and(|only| !only.weighted);
        let paper = settings.strategies == Strategies::Paper;
        let list_lengths = settings.list_lengths;
        let shines = !list_lengths && (stats.environment || stats.emissive_triangles > 0);
        // The paper meets such lights by bundles alone.
        let starts_from_met = shines && !paper;
        let light_vertices = match (!list_lengths && stats.lights > 0 || starts_from_met, settings.strategies) {
            (false, _) => 0,
            (_, Strategies::Bundle) => 1,
            (_, Strategies::Paper) => MOST_LIGHT_VERTICES.min(bounces + 1).min(2),
            _ => MOST_LIGHT_VERTICES.min(bounces + 1),
        };
        let many_lights = light_vertices > 0 && stats.light_places > FEW_LIGHTS;
        let sampling = settings.light_sampling;
        let resamples = sampling.is_some_and(LightSampling::resamples);
        let usual = if many_lights || resamples { POOL } else { 1 };
        let light_pool = if light_vertices == 0 { 1 } else { settings.light_pool.unwrap_or(usual) };
        // At most one of which is somewhere and needs its six faces drawn in every iteration.
        let lights = stats.lights + usize::from(stats.environment);
        let one_each = (2..=MOST_DIRECT_LIGHTS).contains(&lights)
            && stats.emissive_triangles == 0
            && stats.lamps <= 1
            && light_vertices > 0
            && !paper
            && sampling.is_none()
            && settings.light_pool.is_none();
        let direct_lights = if one_each { lights as u32 } else { 0 };
        // Light that is met after the last of several bounces takes a bundle and a third of all look-ups for what light subpaths find as well
        // (README, "Cost of an iteration").
        let unmet = |k: u32| k > 1 && k == bounces && light_vertices > 1 && settings.strategies == Strategies::All;
        // A path of k bounces has strategies s = 0 ... min(light vertices, k + 1).
        let allowed = |k: u32| -> [u32; 4] {
            let most = light_vertices.min(k + 1);
            std::array::from_fn(|i| {
                let s = i as u32;
                let takes_part = s <= most
                    && (s > 0 || shines && !unmet(k))
                    && match settings.strategies {
                        Strategies::All | Strategies::Bundle => true,
                        Strategies::Vpl => s == most,
                        Strategies::Paper => s == 0 || k < 2 || (k == 2 && s == 2),
                    };
                match (takes_part, s, k) {
                    (false, ..) => 0,
                    (true, 1, 0) => light_pool,
                    _ => 1,
                }
            })
        };
        // One that counts alone, with all of what it makes.
        let alone = |s: u32, samples: [u32; 4]| {
            if unweighted { std::array::from_fn(|i| if i as u32 == s { samples[i] } else { 0 }) } else { samples }
        };
        let connections: Vec<_> = (1..=bounces + 1)
            .flat_map(|j| (1..=light_vertices).map(move |s| (j, s)))
            .filter(|(j, s)| s + j - 2 <= bounces)
            .map(|(j, s)| Connection { s, j, samples: allowed(s + j - 2), clamped: paper && s + j - 2 == 2 })
            .filter(|c| c.samples[c.s as usize] > 0 && counts(c.s, c.j + 1))
            .map(|c| Connection { samples: alone(c.s, c.samples), ..c })
            .collect();
        // What the camera sees no other strategy makes.
        let meets = |j: u32| shines && counts(0, j + 2) && (j == 0 || allowed(j - 1)[0] > 0);
        // z_(j+1) is needed where something joins it or light can be met beyond.
        let deepest = connections.iter().map(|c| c.j).max().unwrap_or(1);
        let farthest = (1..=bounces + 1).rev().find(|&j| meets(j)).unwrap_or(0).max(deepest - 1);
        let extensions: Vec<_> = (1..=farthest)
            .map(|j| Extension { j, last: j == bounces + 1, meets: meets(j), samples: alone(0, allowed(j - 1)) })
            .collect();

        let mut surface_flags = Vec::new();
        let mut flag = |name, on: bool| {
            if on {
                surface_flags.push(name);
            }
        };
        flag("TEXTURES", stats.texels > 0);
        flag("VERTEX_COLORS", stats.vertex_colors);
        flag("GLOSSY", stats.glossy_triangles > 0);
        flag("MASKS", stats.masked_triangles > 0);
        let mut light_flags = Vec::new();
        if stats.lights > 0 {
            light_flags.push("PUNCTUAL");
        }
        if stats.patterns {
            light_flags.push("PATTERNS");
        }
        if stats.emissive_triangles > 0 {
            light_flags.push("EMISSION");
        }
        if stats.environment {
            light_flags.push("ENVIRONMENT");
        }
        if stats.environment_map {
            light_flags.push("ENVIRONMENT_MAP");
        }

        // Measured (README, "Resolution"): look-ups are fastest where a texel holds a few triangles, rasterization where there
        // are few texels; both are shallow around a texel of about the triangles' size.
        let fitting = |coarsest: u32, finest: u32, texels_per_unit: f32| {
            let wanted = texels_per_unit / stats.mean_triangle_size.max(1e-4);
            (wanted as u32).next_power_of_two().clamp(coarsest, finest)
        };
        let fast = settings.visibility == Visibility::Fast;
        let bundle_resolution = settings.bundle_resolution.unwrap_or_else(|| fitting(128, 512, 2.0));
        // Where there are about as many triangles as texels, lists are long, and worth taking apart by depth; not those of `fast`, which are
        // half as long.
        let bundle_texels = bundle_resolution as usize * bundle_resolution as usize;
        let bundle_slabs =
            if fast { 1 } else { (4 * stats.triangles / bundle_texels).clamp(1, 16).next_power_of_two() as u32 };
        let vpl_resolution = settings.vpl_resolution.unwrap_or_else(|| fitting(64, 256, 1.0));
        // Of a pool of light points each is asked by few pixels, and its map made for them alone. Exact answers stay the same.
        let reuse = (sampling == Some(LightSampling::Restir)).then_some(settings.restir_bias);
        let finest = if (light_pool > 1 || reuse.is_some()) && !fast { 64 } else { 512 };
        let light_resolution = settings.light_resolution.unwrap_or_else(|| fitting(64, finest, 1.5));

        let rays = settings.method == Method::Twin;
        let mut plan = Self {
            passes: Vec::new(),
            surface_flags,
            light_flags,
            light_vertices,
            light_pool,
            direct_lights,
            reuse,
            lights_for_view: many_lights && (sampling.is_none() || resamples),
            lit_from: LitFrom { near: stats.near_lights, afar: stats.far_lights },
            starts_from_met,
            sky_bundles: stats.environment_map && !starts_from_met && extensions.iter().any(|e: &Extension| e.meets),
            rsm: stats.lights > 0 && light_vertices > 1,
            connections,
            extensions,
            list_lengths,
            camera_meets: meets(0),
            shares_looks: false,
            bundle_resolution,
            bundle_slabs,
            light_resolution,
            vpl_resolution,
            fast,
            rays,
            list_room: settings.list_room,
            bounces,
            grid: Grid {
                size: [settings.width, settings.height],
                layered: false,
                side: 1,
                scale: settings.upsample,
                band_pixels: 0,
            },
            interleave: String::new(),
            cost: Cost::default(),
            settles: false,
            clear_light: stats.emissive_triangles == 0
                && lights == stats.sharp_lights
                && light_pool == 1
                && (lights == 1 || one_each),
            filtered: false,
            measures_bias: false,
            tamed: settings.tame_outliers,
            history: settings.history,
            bytes: 0,
        };
        plan.cost = Cost::new(&plan.work(stats, settings, capabilities));
        (plan.grid.side, plan.interleave) = plan.choose_side(stats, settings);
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        plan.grid.layered = plan.grid.side > 1 || settings.is_live();
        plan.filtered = plan.grid.side > 1 && !settings.unfiltered;
        plan.measures_bias =
            settings.target_error.is_some() && plan.filtered && !settings.tame_outliers && settings.upsample == 1;
        plan.settles = settings.target_error.is_some() && !plan.is_live();
        plan.shares_looks = !plan.is_live() && 4 * stats.triangles as u64 > pixels;
        let usual = if plan.has_pool() && !plan.reuses() {
            POOL_BAND_PIXELS
        } else if pixels <= u64::from(TWO_BANDS) {
            TWO_BANDS
        } else {
            BAND_PIXELS
        };
        plan.grid.band_pixels = settings.band_pixels.unwrap_or(usual);
        plan.bytes = plan.count_bytes(stats, settings, capabilities);
        plan.passes = plan.explain(stats, settings);
        plan
    }

    /// The side of the squares whose pixels have light subpaths of their own, and why.
    fn choose_side(&self, stats: &SceneStats, settings: &Settings) -> (u32, String) {
        if let Some(side) = settings.interleave {
            return (side, "as asked for".to_owned());
        }
        let noisy = self.connections.iter().any(|c| !self.is_clear(c)) || !self.extensions.is_empty();
        let one = match () {
            () if self.list_lengths => "lengths of lists have no filter",
            () if settings.only.is_some() => "a strategy alone is not filtered",
            () if settings.strategies != Strategies::All => "only all strategies together are filtered unasked",
            () if self.reuse.is_some() => "--light-sampling restir looks back at pictures that are not filtered",
            () if settings.aperture.map_or(stats.lens, |radius| radius > 0.0) => {
                "a lens needs many iterations, each of which looks through one point of it"
            }
            () if !noisy => "nothing has noise that a filter would take away",
            () => "",
        };
        if !one.is_empty() {
            return (1, format!("auto: {one}"));
        }
        let Cost { fills, gains, .. } = self.cost;
        let (side, share) = (self.cost.side(), 100.0 * self.cost.share());
        let bound = match side {
            _ if side == gains => "; more gains little, since edges need some iterations",
            _ if side == fills => "; pixels are few",
            _ => "",
        };
        (side, format!("auto: by the model a light subpath takes {share:.1} % of what all pixels take{bound}"))
    }

    /// What an iteration does, as the model of its cost asks. The twin's is that of raster, so that both have the same random numbers.
    fn work(&self, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> Work {
        // Views around lights without extent are kept, if each light has its own.
        let (alone, others) = (stats.lights == 1 && !self.starts_from_met, self.other_lights_view());
        let kept = |n: usize| match self.direct_lights {
            0 => n == 0 && alone && stats.sharp_lights == 1,
            _ => (n == 0 || n >= others) && n.saturating_sub(others - 1) < stats.sharp_lights,
        };
        let around_pool = if self.has_pool() { u64::from(self.light_pool - 1) } else { 0 };
        let times = |n: usize| if self.pool_view() == Some(n) { around_pool } else { 1 };
        let filled: Vec<_> =
            self.views().iter().enumerate().filter(|&(n, _)| !kept(n)).map(|(n, t)| (times(n), t.count())).collect();
        Work {
            // Steps of an eighth where they vary with the view, so that frames of an animation have the same side.
            triangles: stats.triangle_room() as u64,
            views: filled.iter().map(|(times, _)| times).sum(),
            texels: filled.iter().map(|(times, texels)| times * texels).sum(),
            pixels: self.grid.layer().iter().map(|&side| u64::from(side)).product(),
            connections: self.connections.iter().map(|c| u64::from(self.points_joined(c))).sum::<u64>() + around_pool,
            extensions: self.extensions.len() as u64,
            glossy: self.glossy(),
            narrow_metals: stats.narrow_metals,
            filtered: !settings.unfiltered,
            software: capabilities.software,
        }
    }

    /// Whether it asks for the same as another plan, if for other numbers of triangles.
    #[must_use]
    pub fn does_as(&self, other: &Self) -> bool {
        let Self { bytes, cost, ref interleave, .. } = *self;
        *self == Self { bytes, cost, interleave: interleave.clone(), ..other.clone() }
    }

    /// Iterations that look from the same point through the same place of each pixel, and so share a G-buffer. A lens, and frames of a
    /// moving picture, have a look for each.
    #[must_use]
    pub fn iterations_a_look(&self, camera: &Camera) -> u64 {
        let has_lens = camera.lens.is_some_and(|lens| lens.radius > 0.0);
        if self.shares_looks && !has_lens { 2 } else { 1 }
    }

    /// Texels of each view: the light, the VPLs, the bundles, then one for each further light that has a point of its own, or one for the
    /// pool of light points, or, with reuse, one for each of this iteration's pool and of the last one's.
    #[must_use]
    pub fn views(&self) -> Vec<Texels> {
        let mut views = Vec::new();
        let light = Texels { faces: self.light_faces(), ..Texels::around(self.light_resolution) };
        views
            .extend((0..self.light_vertices).map(|s| if s == 0 { light } else { Texels::around(self.vpl_resolution) }));
        let bundle = Texels { resolution: self.bundle_resolution, faces: 1, slabs: self.bundle_slabs };
        views.extend((0..self.bundles()).map(|_| bundle));
        views.extend((1..self.direct_lights).map(|_| light));
        if self.has_pool() {
            let count = if self.reuses() { 2 * self.light_pool as usize - 1 } else { 1 };
            views.extend((0..count).map(|_| light));
        }
        views
    }

    /// Bundles of a light subpath.
    #[must_use]
    pub fn bundles(&self) -> usize {
        self.extensions.len() + usize::from(self.list_lengths)
    }

    /// Whether direct light comes from a pool of light points.
    #[must_use]
    pub fn has_pool(&self) -> bool {
        (self.light_pool > 1 || self.reuse.is_some()) && self.connections.iter().any(Connection::is_direct)
    }

    /// Whether pixels look back at what was kept of the last iteration's pool.
    #[must_use]
    pub fn reuses(&self) -> bool {
        self.reuse.is_some() && self.has_pool()
    }

    /// Faces of a view around a light point.
    fn light_faces(&self) -> u32 {
        if self.lit_from.near { 6 } else { 1 }
    }

    /// Light points of an iteration: y0, and what else gives direct light.
    #[must_use]
    pub fn light_points(&self) -> u32 {
        self.direct_lights.max(self.light_pool)
    }

    /// Light points that a connection joins one after the other; those of a pool are another pass's.
    #[must_use]
    pub fn points_joined(&self, connection: &Connection) -> u32 {
        if connection.is_direct() { self.direct_lights.max(1) } else { 1 }
    }

    /// The view of the point on a light, if it is y0 or each light has one.
    #[must_use]
    pub fn light_view(&self, light: u32) -> usize {
        if self.direct_lights > 0 && light > 0 { self.other_lights_view() + light as usize - 1 } else { 0 }
    }

    /// The first view that is there for light points other than y0.
    fn other_lights_view(&self) -> usize {
        self.light_vertices as usize + self.bundles()
    }

    /// The first view that is there for the pool's light points alone.
    #[must_use]
    pub fn pool_view(&self) -> Option<usize> {
        self.has_pool().then(|| self.other_lights_view())
    }

    /// Which view each light point of the pool has; with reuse, then those of the last iteration's. The first is y0's; without reuse the
    /// others share one.
    #[must_use]
    pub fn pool_views(&self) -> Vec<usize> {
        let Some(first) = self.pool_view() else { return Vec::new() };
        let count = self.light_pool as usize;
        if self.reuses() {
            std::iter::once(0).chain(first..first + 2 * count - 1).collect()
        } else {
            (0..count).map(|n| if n == 0 { 0 } else { first }).collect()
        }
    }

    /// Items that views start with room for; it grows where a frame needs more.
    #[must_use]
    pub fn item_room(&self, triangles: u64, limit: u64) -> u64 {
        // Lists need none for small triangles.
        if self.rays || self.views().is_empty() { 0 } else { (triangles / 4 + 1024).min(limit / 16) }
    }

    /// Nodes that a view starts with room for; it grows likewise.
    #[must_use]
    pub fn node_room(&self, triangles: u64, texels: Texels, limit: u64) -> u64 {
        if self.rays {
            return 0;
        }
        // Seen in Sponza (bundles 0.5 to 9 nodes a triangle, maps from inside 0.5 to 8) and the Cornell box (1.6 and 1.3 a texel).
        let count = texels.count();
        let guess = match (self.fast, texels.faces) {
            (false, 1) => 2 * count + 8 * triangles,
            (false, _) => 3 * count / 2 + 6 * triangles,
            // Only what covers a centre.
            (true, _) => 2 * count + 4 * triangles,
        };
        let guess = (guess as f64 * f64::from(self.list_room)) as u64;
        guess.max(1).min((limit / 4 - texels.lists()) / self.node_words())
    }

    /// Words of lists with room for so many nodes.
    #[must_use]
    pub fn list_words(&self, texels: Texels, nodes: u64) -> u64 {
        Answers::Lists { node_words: self.node_words() }.words(texels, nodes)
    }

    /// Words of the lists that depth maps are made of, one after the other.
    #[must_use]
    pub fn scratch_words(&self, triangles: u64, limit: u64) -> u64 {
        let views = self.views();
        let maps = views.iter().enumerate().filter(|&(n, _)| self.answers(n) == Answers::DepthMap);
        maps.map(|(_, &texels)| self.list_words(texels, self.node_room(triangles, texels, limit))).max().unwrap_or(0)
    }

    /// 32-bit words of a node.
    #[must_use]
    pub fn node_words(&self) -> u64 {
        if self.fast { 3 } else { 2 }
    }

    /// Whether light vertices have depth maps instead of lists.
    #[must_use]
    pub fn has_depth_maps(&self) -> bool {
        self.fast && self.light_vertices > 0
    }

    /// Whether the n-th view is that of a light vertex or another light point.
    #[must_use]
    pub fn is_around_light(&self, n: usize) -> bool {
        n < self.light_vertices as usize || n >= self.other_lights_view()
    }

    /// What the n-th view is there for.
    #[must_use]
    pub fn view_name(&self, n: usize) -> String {
        let light_vertices = self.light_vertices as usize;
        match n {
            0 if light_vertices > 0 => "light".to_owned(),
            n if n < light_vertices => format!("vpl {n}"),
            n if !self.is_around_light(n) => format!("bundle {}", n - light_vertices + 1),
            _ if self.has_pool() => "light pool".to_owned(),
            n => format!("light {}", n - self.other_lights_view() + 2),
        }
    }

    /// Outlines that the n-th view keeps of so many triangles: of all, if it is a bundle. Connections to light from infinitely far away,
    /// one for a pixel, make those that they need.
    #[must_use]
    pub fn outlines(&self, n: usize, triangles: u64) -> u64 {
        if self.rays || self.is_around_light(n) { 0 } else { triangles }
    }

    /// What answers for the n-th view.
    #[must_use]
    pub fn answers(&self, n: usize) -> Answers {
        if self.rays {
            Answers::Rays
        } else if self.has_depth_maps() && self.is_around_light(n) {
            Answers::DepthMap
        } else {
            Answers::Lists { node_words: self.node_words() }
        }
    }

    /// Whether a connection is made where clear light is alone, in layers of their own resolution.
    #[must_use]
    pub fn is_apart(&self, connection: &Connection) -> bool {
        self.grid.scale > 1 && self.is_clear(connection)
    }

    /// Whether what a connection brings needs no filter.
    #[must_use]
    pub fn is_clear(&self, connection: &Connection) -> bool {
        self.clear_light && connection.is_direct()
    }

    /// Whether an iteration's light is kept in layers that are filtered.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.grid.layered
    }

    /// Flags of shaders that add light to pixels.
    #[must_use]
    pub fn layer_flags(&self) -> &'static [&'static str] {
        if self.is_live() { &["LAYERED"] } else { &[] }
    }

    /// Flags of shaders that begin pixels and of those that sum them.
    #[must_use]
    pub fn settle_flags(&self) -> &'static [&'static str] {
        if self.settles { &["SETTLES"] } else { &[] }
    }

    /// Whether a frame says how much the light changed since the one before.
    #[must_use]
    pub fn has_gradients(&self) -> bool {
        self.history > 1 && self.grid.side > 1
    }

    /// Whether shaders have code for lobes beside the diffuse one.
    #[must_use]
    pub fn glossy(&self) -> bool {
        self.surface_flags.contains(&"GLOSSY")
    }

    fn count_bytes(&self, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> u64 {
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        let (triangles, limit) = (stats.triangle_room() as u64, capabilities.max_storage_bytes);
        let live = self.is_live();
        let shared = live && self.glossy();
        let pool = if self.has_pool() { layouts::Choice::bytes(shared, self.reuses()) } else { 0 };
        let radiance = if live { 48 } else { 16 };
        let kept = pool + layouts::EyeVertex::bytes(shared) + layouts::Shading::bytes(self.glossy()) + radiance;
        let film = if live { self.live_bytes() } else { pixels * film::DEVICE_BYTES };
        let settled = if self.settles { tiles::bytes(settings.width, settings.height) } else { 0 };
        let looked_back = if self.reuses() { 2 * size_of::<layouts::PoolSite>() as u64 } else { 0 };
        // The film or what stands for it, the G-buffer with its depth, and what the next iteration looks back at.
        let image = film + settled + pixels * (8 + looked_back) + self.grid.largest() * kept;
        let views: u64 = self
            .views()
            .iter()
            .enumerate()
            .map(|(n, &texels)| {
                let nodes = self.node_room(triangles, texels, limit);
                self.outlines(n, triangles) * OUTLINE_BYTES + 4 * self.answers(n).words(texels, nodes)
            })
            .sum();
        image + views + 16 * self.item_room(triangles, limit) + 4 * self.scratch_words(triangles, limit)
    }

    /// Bytes of layers, guides, histories and pictures.
    #[must_use]
    pub fn live_bytes(&self) -> u64 {
        let [image, layer] = [self.grid.size, self.grid.layer()].map(|[w, h]| u64::from(w) * u64::from(h));
        let guide = size_of::<layouts::Guide>() as u64;
        let of_image = 2 * (guide + 16) + 16 + 32 + if self.measures_bias { 16 + 2 * 32 } else { 0 };
        let mut of_layer = 2 * 32;
        of_layer += if self.grid.scale > 1 { 2 * guide } else { 0 };
        of_layer += if self.filtered { 32 } else { 0 } + if self.measures_bias { 32 } else { 0 };
        of_layer += if self.tamed { 32 } else { 0 };
        of_layer += if self.history > 0 { 2 * 32 } else { 0 };
        let squares: u64 = self.grid.squares().iter().map(|&side| u64::from(side)).product();
        image * of_image + layer * of_layer + if self.has_gradients() { 8 * squares } else { 0 }
    }

    fn explain(&self, stats: &SceneStats, settings: &Settings) -> Vec<PlannedPass> {
        let mut out = vec![PlannedPass::tessellate(stats)];
        let mut pass = |name, runs: u32, reason: String| out.push(PlannedPass { name, runs, reason });
        let subpaths = self.grid.subpaths();
        let [bands, clear_bands] = self.grid.regions();
        // Of the pool's light points, whose view is filled again for each band, unless each has one of its own.
        let around_pool = if self.reuses() { 1 } else { bands } * (self.light_pool - 1);
        let around_pool = if self.has_pool() { around_pool } else { 0 };
        // Those without extent are kept.
        let around_others = (self.direct_lights.saturating_sub(stats.sharp_lights as u32)).saturating_sub(1);
        let around_lights = subpaths * (self.light_vertices + around_others) + around_pool;
        let views = if self.rays { 0 } else { around_lights + subpaths * self.bundles() as u32 };
        let maps = if self.has_depth_maps() { around_lights } else { 0 };
        pass(
            "view_setup",
            views,
            if self.rays {
                "ray queries answer".to_owned()
            } else {
                let bundles = subpaths as usize * self.bundles();
                format!("once per view: {around_lights} around light vertices, {bundles} bundles")
            },
        );
        pass(
            "view_lists",
            views,
            if self.rays {
                "ray queries answer"
            } else {
                "each view; a light's own is kept while a light without extent stays the same"
            }
            .to_owned(),
        );
        pass(
            "depth_maps",
            maps,
            if self.fast {
                "around light vertices; a light's own is kept while a light without extent stays the same"
            } else {
                "only `fast` has them"
            }
            .to_owned(),
        );
        pass(
            "light_point",
            if self.light_vertices > 0 { subpaths } else { 0 },
            match (self.light_vertices, self.direct_lights) {
                (0, _) => NO_LIGHT.to_owned(),
                (_, 0) => "where the light subpath starts".to_owned(),
                (_, n) => format!("where the light subpath starts; {n} lights, each with a point for direct light"),
            },
        );
        pass(
            "rsm",
            u32::from(self.rsm),
            match (self.rsm, self.light_vertices) {
                (true, _) => "once per point, spot or directional light: where it is worth sending VPLs",
                (_, 0 | 1) => "no VPLs",
                _ => "no point, spot or directional light",
            }
            .to_owned(),
        );
        pass(
            "light_subpath",
            subpaths * self.light_vertices.saturating_sub(1),
            match self.light_vertices {
                0 => NO_LIGHT.to_owned(),
                1 => "the strategies ask for no VPLs".to_owned(),
                n => format!("{} VPLs", n - 1),
            },
        );
        let shared =
            if self.shares_looks { "; without a lens two iterations share it, since triangles are many" } else { "" };
        pass("gbuffer", 1, format!("z1 of every pixel{shared}"));
        pass("eye_vertices", bands + clear_bands, "exact positions, and light that the camera sees".to_owned());
        pass(
            "connect",
            self.connections
                .iter()
                .filter(|c| !(self.has_pool() && c.is_direct()))
                .map(|c| self.points_joined(c) * if self.is_apart(c) { clear_bands } else { bands })
                .sum(),
            if self.light_vertices == 0 {
                NO_LIGHT.to_owned()
            } else {
                format!("strategies (s, t): {}", self.strategy_names())
            },
        );
        let meets = self.extensions.iter().any(|e| e.meets);
        pass(
            "light_gifts",
            u32::from(self.lights_for_view),
            if self.lights_for_view {
                "once, before the first iteration: lights are chosen half by power, half by what they give the view"
            } else {
                "lights are few, or chosen as asked for"
            }
            .to_owned(),
        );
        pass(
            "light_pool",
            if self.has_pool() { bands * (self.light_pool + 1) } else { 0 },
            match (self.light_pool, self.light_vertices) {
                (_, 0) => NO_LIGHT.to_owned(),
                (1, _) if self.direct_lights > 0 => "few lights: each has a light point".to_owned(),
                (1, _) if !self.has_pool() => "few lights: one light point an iteration".to_owned(),
                (n, _) => format!("direct light, (1, 2): a choice among {n} light points, then a test for each"),
            },
        );
        pass(
            "light_reuse",
            if self.reuses() { bands * (2 * self.light_pool + 1) } else { 0 },
            match (self.light_vertices, self.reuse) {
                (0, _) => NO_LIGHT.to_owned(),
                (_, None) => "only --light-sampling restir looks back".to_owned(),
                _ if !self.reuses() => "the strategies ask for no direct light".to_owned(),
                (_, Some(bias)) => {
                    format!("{bias}: what was kept of this and the last iteration's light points, then a test for each")
                }
            },
        );
        pass(
            "extend",
            bands * self.extensions.len() as u32,
            if meets {
                let directions = if self.sky_bundles { ", along directions from where the sky is bright" } else { "" };
                let beyond = if self.extensions.iter().any(|e| e.last) { "beyond them" } else { "between them" };
                format!("{} bounces and the light {beyond}{directions}", settings.bounces)
            } else if self.extensions.is_empty() {
                "nothing joins or is met beyond z1".to_owned()
            } else {
                "nothing shines by itself, so the last vertex is the last that is joined".to_owned()
            },
        );
        pass(
            "list_lengths",
            if self.list_lengths { bands } else { 0 },
            if self.list_lengths { "in place of light" } else { "not asked for" }.to_owned(),
        );
        let to = match (self.is_live(), self.settles) {
            (true, _) => "the frame's layers, which are filtered",
            (false, true) => "film, but for tiles that have settled",
            (false, false) => "film",
        };
        pass("accumulate", bands + clear_bands, to.to_owned());
        self.explain_live(&mut pass);
        out
    }

    fn explain_live(&self, pass: &mut dyn FnMut(&'static str, u32, String)) {
        let all = "pictures are summed as they are";
        let mut row = |name, runs: bool, why: String, why_not: &str| {
            let reason = if runs { why } else { if self.is_live() { why_not } else { all }.to_owned() };
            let runs = match name {
                // What measures the filter's bias is filtered once more, and makes two more pictures.
                "filter" if self.measures_bias => 2,
                "compose" | "antialias" if self.measures_bias => 3,
                _ => u32::from(runs),
            };
            pass(name, runs, reason);
        };
        let Grid { side, scale, .. } = self.grid;
        row(
            "gradient",
            self.has_gradients(),
            format!("how much the light changed, by one pixel in {} that repeats its random numbers", side * side),
            "needs --interleave, and --history of more than a frame",
        );
        let history = self.history;
        row("temporal", history > 0, format!("indirect light of up to {history} frames"), "no --history");
        row(
            "filter",
            self.filtered,
            format!("joins the {} light subpaths of a square", side * side),
            if side > 1 { "--unfiltered" } else { "no --interleave" },
        );
        row("outliers", self.tamed, "as asked for".to_owned(), "not asked for");
        let upsampled = format!("layers, {scale} times finer, into a picture");
        row("compose", self.is_live(), if scale > 1 { upsampled } else { "layers into a picture".to_owned() }, "");
        row("antialias", self.is_live(), "the mean of frames".to_owned(), "");
    }

    fn strategy_names(&self) -> String {
        let names: Vec<_> = self.connections.iter().map(|c| format!("({}, {})", c.s, c.j + 1)).collect();
        names.join(" ")
    }
}

impl fmt::Display for FramePlan {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{:<14} {:>4}  why", "pass", "runs")?;
        for p in &self.passes {
            let runs = if p.runs == 0 { "skip".to_owned() } else { p.runs.to_string() };
            writeln!(f, "{:<14} {:>4}  {}", p.name, runs, p.reason)?;
        }
        writeln!(f, "{:<14} {:>4}  {}", "interleave", self.grid.side, self.interleave)?;
        writeln!(
            f,
            "surface code   {}",
            if self.surface_flags.is_empty() { "diffuse only".to_owned() } else { self.surface_flags.join(" ") }
        )?;
        writeln!(
            f,
            "light code     {}",
            if self.light_flags.is_empty() { "none".to_owned() } else { self.light_flags.join(" ") }
        )?;
        writeln!(
            f,
            "views          bundles {}^2 x {}, light {} x {}^2, VPLs 6 x {}^2, {}",
            self.bundle_resolution,
            self.bundle_slabs,
            self.light_faces(),
            self.light_resolution,
            self.vpl_resolution,
            if self.rays {
                "answered by ray queries, whatever their resolution"
            } else if self.fast {
                "depth maps and centre-sampled lists (fast)"
            } else {
                "conservative with exact intersection (exact)"
            }
        )?;
        write!(f, "memory         {:.1} MB beside the scene", self.bytes as f64 * 1e-6)
    }
}
