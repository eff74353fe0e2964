//! The plan as `lightsheaf plan` prints it: a row for each pass, in the order in which passes run, with the
//! reason.

use std::fmt;

use crate::gpu::flag_names;
use crate::render::planned_pass::PlannedPass;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::ray_views::RayViews;
use crate::scene::SceneStats;
use crate::settings::Settings;

/// The reason of passes that need a light.
const NO_LIGHT: &str = "no light for light subpaths, or no surface that reflects it";

/// Numbers of views and bands of an iteration.
struct Counts {
    subpaths: u32,
    bands: u32,
    clear_bands: u32,
    maps: u32,
    bundles: u32,
}

fn row(name: &'static str, runs: u32, reason: impl Into<String>) -> PlannedPass {
    PlannedPass { name, runs, reason: reason.into() }
}

impl FramePlan {
    /// Returns one row per pass.
    pub(super) fn rows(&self, stats: &SceneStats, settings: &Settings) -> Vec<PlannedPass> {
        let counts = self.counts(stats);
        let mut rows = PlannedPass::of_upload(stats);
        rows.extend(self.light_rows(&counts, stats));
        rows.extend(self.view_rows(&counts));
        rows.extend(self.subpath_rows(&counts));
        rows.push(self.caustics_row(stats, settings));
        rows.extend(self.pixel_rows(&counts, settings));
        rows.extend(self.denoise().rows());
        rows
    }

    fn counts(&self, stats: &SceneStats) -> Counts {
        let subpaths = self.grid.subpaths();
        let [bands, clear_bands] = self.grid.count_bands();
        // Candidates share a view that is filled again for each band, unless each has one of its own.
        let candidates = if self.reuses() { 1 } else { bands } * (self.light_candidates - 1);
        let candidates = if self.has_candidates() { candidates } else { 0 };
        // Maps around lights without extent are kept.
        let others = self.direct_lights.saturating_sub(stats.sharp_lights as u32).saturating_sub(1);
        // Views that rays answer are not rasterized.
        let RayViews { lights, vpls, bundles: by_rays } = self.ray_views;
        let of_lights = if lights { 0 } else { subpaths * (self.light_vertices.min(1) + others) + candidates };
        let of_vpls = if vpls { 0 } else { self.light_vertices.saturating_sub(1) };
        let maps = of_lights + subpaths * of_vpls;
        Counts { subpaths, bands, clear_bands, maps, bundles: if by_rays { 0 } else { subpaths * self.bundles() } }
    }

    fn why_guide(&self, stats: &SceneStats) -> &'static str {
        match () {
            () if self.guides_sky => "once, before the first iteration: places where light of the sky comes in",
            () if !stats.environment => "no sky",
            () if self.light_vertices < 2 || !self.starts_from_emitters => "no VPLs from the sky",
            () if !stats.camera_inside => "the camera is outside the scene, and light comes in everywhere",
            () => "lists or depth maps answer visibility",
        }
    }

    fn light_rows(&self, counts: &Counts, stats: &SceneStats) -> [PlannedPass; 3] {
        let importance = if self.lights_for_view {
            "once, before the first iteration: lights are chosen half by power, half by unoccluded contribution"
        } else {
            "few lights, or --light-sampling is given"
        };
        let on_sky = match self.sky_points {
            1 => String::new(),
            n => format!("; {n} points on the sky"),
        };
        let point = match (self.light_vertices, self.direct_lights) {
            (0, _) => NO_LIGHT.to_owned(),
            (_, 0) => format!("y0 of the light subpath{on_sky}"),
            (_, n) => format!("y0 of the light subpath; direct light from a point on each of {n} lights{on_sky}"),
        };
        [
            row("light_importance", u32::from(self.lights_for_view), importance),
            row("sky_guide", u32::from(self.guides_sky), self.why_guide(stats)),
            row("light_point", if self.light_vertices > 0 { counts.subpaths } else { 0 }, point),
        ]
    }

    fn view_rows(&self, counts: &Counts) -> [PlannedPass; 3] {
        let &Counts { maps, bundles, .. } = counts;
        let kept = "the view of a light without extent is reused while the light stays the same";
        let views = maps + bundles;
        let or_rays = |why: String| if views == 0 { "rays answer visibility".to_owned() } else { why };
        let depth =
            if self.fast { format!("around light vertices; {kept}") } else { "only with --visibility fast".to_owned() };
        [
            row(
                "view_setup",
                views,
                or_rays(format!("once per view: {maps} around light vertices, {bundles} bundles")),
            ),
            row("view_lists", views, or_rays(format!("once per view; {kept}"))),
            row("depth_maps", if self.has_depth_maps() { maps } else { 0 }, depth),
        ]
    }

    fn subpath_rows(&self, counts: &Counts) -> [PlannedPass; 2] {
        let rsm = match (self.rsm, self.light_vertices) {
            (true, _) => "once per point, spot or directional light: importance of VPL directions",
            (_, 0 | 1) => "no VPLs",
            _ => "no point, spot or directional light",
        };
        let vpls = match self.light_vertices {
            0 => NO_LIGHT.to_owned(),
            1 => "the strategies have no VPLs".to_owned(),
            n => format!("{} VPLs", n - 1),
        };
        [
            row("rsm", u32::from(self.rsm), rsm),
            row("light_subpath", counts.subpaths * self.light_vertices.saturating_sub(1), vpls),
        ]
    }

    fn caustics_row(&self, stats: &SceneStats, settings: &Settings) -> PlannedPass {
        let (runs, why) = match () {
            () if self.traces_caustics => (1, "a light path per pixel by way of mirrors and clear glass, (s, 1)"),
            () if settings.only.is_some() => (0, "another strategy alone counts"),
            () if !self.own_directions => (0, "paths do not follow mirrors or clear glass"),
            () if stats.smooth_share == 0.0 => (0, "no mirrors and no clear glass"),
            () if self.light_vertices > 1 => (0, "hardly any texel is smooth"),
            () => (0, "the strategies have no paths that light sends out"),
        };
        row("caustics", runs, why)
    }

    fn pixel_rows(&self, counts: &Counts, settings: &Settings) -> Vec<PlannedPass> {
        let &Counts { bands, clear_bands, .. } = counts;
        let shared =
            if self.shares_gbuffer { "; without a lens two iterations share it, since triangles are many" } else { "" };
        let connections = self.connections.iter().filter(|c| !(self.has_candidates() && c.is_direct()));
        let connections =
            connections.map(|c| self.runs_of(c) * if self.is_apart(c) { clear_bands } else { bands }).sum();
        let connect = if self.light_vertices == 0 {
            NO_LIGHT.to_owned()
        } else {
            format!("strategies (s, t): {}", self.strategy_names())
        };
        let to = match (self.is_layered(), self.adaptive, self.skips_tiles) {
            (true, ..) => "layers of the frame, which are denoised",
            (false, true, _) => "film, except tiles that have converged",
            (false, _, true) => "film, except tiles outside the crop",
            (false, ..) => "film",
        };
        let why_borders = match (self.draws_borders, self.traces_camera) {
            (true, _) => "triangles that hardware may miss: their sides pass within a pixel",
            (false, true) => "rays find z1",
            (false, false) => "triangles are many for the pixels: a neighbour is close enough",
        };
        let lengths = if self.list_lengths { "in place of light" } else { "not asked for" };
        vec![
            if self.traces_camera {
                row("gbuffer", 0, "rays find z1")
            } else {
                row("gbuffer", 1, format!("z1 of every pixel{shared}"))
            },
            row("borders", u32::from(self.draws_borders), why_borders),
            row("seen_light", u32::from(self.light_borders), self.why_seen_light()),
            row("eye_vertices", bands + clear_bands, "exact positions, and emission that the camera sees"),
            row("list_lengths", if self.list_lengths { bands } else { 0 }, lengths),
            row("connect", connections, connect),
            self.candidates_row(bands),
            self.reservoirs_row(bands),
            row("extend", bands * self.extensions.len() as u32, self.why_extend(settings)),
            row("accumulate", bands + clear_bands, to),
        ]
    }

    fn why_seen_light(&self) -> &'static str {
        match () {
            () if self.light_borders => "once, before the first iteration: borders of lights that the camera sees",
            () if !self.camera_hits_emitters => "the camera sees no light",
            () if !self.traces_camera => "the G-buffer holds what the camera sees",
            () => "only where pictures are interleaved, with layers of the size of the image",
        }
    }

    fn candidates_row(&self, bands: u32) -> PlannedPass {
        let tests = if self.ray_views.lights { 1 } else { self.light_candidates };
        let runs = if self.has_candidates() { bands * (tests + 1) } else { 0 };
        let why = match (self.light_candidates, self.light_vertices) {
            (_, 0) => NO_LIGHT.to_owned(),
            (1, _) if self.direct_lights > 0 => "few lights: each has a light point".to_owned(),
            (1, _) if !self.has_candidates() => "few lights: one light point per iteration".to_owned(),
            (n, _) => {
                format!("direct light, (1, 2): one of {n} light points per pixel, then a visibility test for each")
            }
        };
        row("light_candidates", runs, why)
    }

    fn reservoirs_row(&self, bands: u32) -> PlannedPass {
        let runs = if self.reuses() { bands * (2 * self.light_candidates + 1) } else { 0 };
        let why = match (self.light_vertices, self.reuse) {
            (0, _) => NO_LIGHT.to_owned(),
            (_, None) => "only with --light-sampling restir".to_owned(),
            _ if !self.reuses() => "the strategies have no direct light".to_owned(),
            (_, Some(bias)) => {
                format!("{bias}: reuse of the last iteration's reservoirs, then a visibility test for each light point")
            }
        };
        row("light_reservoirs", runs, why)
    }

    fn why_extend(&self, settings: &Settings) -> String {
        if self.extensions.iter().any(|e| e.hits_emitter) {
            let directions = match () {
                () if self.own_directions => "; each pixel draws directions of its own",
                () if self.sky_bundles => "; directions follow the environment map",
                () => "",
            };
            let beyond =
                if self.extensions.iter().any(|e| e.j == self.most_vertices) { "beyond them" } else { "between them" };
            let specular = match self.specular_bounces {
                0 => String::new(),
                most => format!(" and up to {most} more of glass and mirrors"),
            };
            format!("{} bounces{specular}, and hits on emitters {beyond}{directions}", settings.bounces)
        } else if self.extensions.is_empty() {
            "no connection, and no emitter beyond z1 that counts".to_owned()
        } else {
            "no emitters: the last vertex is the last that is connected".to_owned()
        }
    }

    fn strategy_names(&self) -> String {
        let names: Vec<_> = self.connections.iter().map(|c| format!("({}, {})", c.s, c.j + 1)).collect();
        names.join(" ")
    }
}

impl fmt::Display for FramePlan {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let or = |names: String, none: &str| if names.is_empty() { none.to_owned() } else { names };
        PlannedPass::write_rows(&self.passes, f)?;
        let together = if self.grid.together > 1 { "; classes are rendered together" } else { "" };
        writeln!(f, "{:<16} {:>4}  {}{together}", "interleave", self.grid.side, self.interleave)?;
        writeln!(f, "{:<21}  {}", "surface code", or(flag_names(&self.surface_flags), "diffuse only"))?;
        writeln!(f, "{:<21}  {}", "light code", or(flag_names(&self.light_flags), "none"))?;
        let visibility = if !self.rasterizes_views() {
            "by rays, for any resolution"
        } else if self.fast {
            "depth maps and centre-sampled lists (fast)"
        } else {
            "conservative with exact intersection (exact)"
        };
        let Self { bundle_resolution, bundle_slabs, light_resolution, vpl_resolution, .. } = self;
        let bundles = if self.own_directions {
            String::new()
        } else {
            format!("bundles {bundle_resolution}^2 x {bundle_slabs}, ")
        };
        let faces = self.light_faces();
        writeln!(
            f,
            "{:<21}  {bundles}light {faces} x {light_resolution}^2, VPLs 6 x {vpl_resolution}^2, {visibility}",
            "views"
        )?;
        writeln!(f, "{:<21}  {}", "rays", self.rays_reason)?;
        write!(f, "{:<21}  {:.1} MB beside the scene", "memory", self.bytes as f64 * 1e-6)
    }
}
