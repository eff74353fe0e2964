//! Decides a sample of `path` and `bdpt` before anything is allocated: passes, shader flags, sizes and bytes,
//! with the reasons.

use std::fmt;

use crate::film;
use crate::gpu::{Capabilities, Flag, flag_names};
use crate::render::adaptive_sampling;
use crate::render::layouts::{FirstHit, PathVertex};
use crate::render::planned_pass::PlannedPass;
use crate::render::scene_flags::{chosen, light_flags, surface_flags};
use crate::render::visibility::tracer::Tracing;
use crate::scene::{Light, Scene, SceneStats};
use crate::settings::{LightSampling, Method, Settings, UNLIMITED};

/// Bounces of unlimited paths, which Russian roulette ends much earlier.
const ENDLESS: u32 = 1 << 24;

/// Most subpaths of a dispatch: the number of workgroups that every adapter supports, of 64 threads each.
const MOST_OF_A_GROUP: u64 = 65_535 * 64;

/// The plan of a sample: a pure value.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PathPlan {
    /// Passes, run or skipped, in order.
    pub passes: Vec<PlannedPass>,
    /// The algorithm that traces rays.
    pub tracing: Tracing,
    /// Flags of the shaders.
    pub flags: Vec<Flag>,
    /// Most bounces of a path.
    pub bounces: u32,
    /// Choice of lights at surfaces.
    pub light_sampling: LightSampling,
    /// Pixels whose subpaths are traced together, so that their stored vertices fit a binding.
    pub group: u32,
    /// Bytes of the stored light subpaths.
    pub vertex_bytes: u64,
    /// Bytes of buffers beside the scene.
    pub bytes: u64,
}

impl PathPlan {
    /// Decides from a scene, its statistics, the settings and the device.
    #[must_use]
    pub fn new(scene: &Scene, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> Self {
        let bidirectional = settings.method() == Method::Bdpt;
        let light_sampling = light_sampling(scene, stats, settings);
        let tracing = Tracing::of(settings.visibility());
        let bounces = if settings.bounces == UNLIMITED { ENDLESS } else { settings.bounces };
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        // The last light vertex is connected with the camera alone, and not stored.
        let stored = (bounces + specular_bounces(stats, settings)).max(1);
        let per_pixel = if bidirectional { u64::from(stored) * size_of::<PathVertex>() as u64 } else { 0 };
        let fitting = capabilities.max_storage_bytes.checked_div(per_pixel).unwrap_or(u64::MAX);
        let group = fitting.min(pixels).min(MOST_OF_A_GROUP);
        let runs = pixels.div_ceil(group.max(1)) as u32;
        let vertex_bytes = group * per_pixel;
        Self {
            passes: passes(stats, settings, light_sampling, runs),
            tracing,
            flags: [flags(stats, settings, light_sampling).as_slice(), tracing.flags()].concat(),
            bounces,
            light_sampling,
            group: group as u32,
            vertex_bytes,
            bytes: pixel_bytes(settings, light_sampling) + vertex_bytes,
        }
    }
}

/// Returns the number of vertices on glass and mirrors that may count as no bounces.
fn specular_bounces(stats: &SceneStats, settings: &Settings) -> u32 {
    if stats.specular { settings.specular_bounces } else { 0 }
}

/// Returns the light sampling of the settings; by default a light tree for several local lights or
/// emitters, otherwise power.
fn light_sampling(scene: &Scene, stats: &SceneStats, settings: &Settings) -> LightSampling {
    let is_local = |light: &&Light| !matches!(light, Light::Directional { .. } | Light::Sun { .. });
    let local = scene.lights.iter().filter(is_local).count();
    let usual = if local + stats.emissive_triangles > 1 { LightSampling::Tree } else { LightSampling::Power };
    settings.light_sampling.unwrap_or(usual)
}

/// Returns the flags of the shaders.
fn flags(stats: &SceneStats, settings: &Settings, light_sampling: LightSampling) -> Vec<Flag> {
    let glossy = stats.glossy_triangles > 0;
    let transmits = glossy && stats.transmits;
    let own = chosen([
        (Flag::Specular, glossy),
        (Flag::SpecularBounces, glossy && specular_bounces(stats, settings) > 0),
        (Flag::Transmission, transmits),
        (Flag::Disperses, transmits && stats.disperses),
        (Flag::DiffuseTransmission, transmits && stats.diffuse_transmission),
        (Flag::LightPaths, settings.method() == Method::Bdpt),
        (Flag::LightTree, light_sampling.has_tree()),
        (Flag::Reservoirs, light_sampling.resamples()),
        (Flag::Adaptive, settings.skips_tiles()),
    ]);
    [surface_flags(stats), light_flags(stats), own].concat()
}

/// Returns the rows of the passes; `runs` is the number of pixel groups.
fn passes(stats: &SceneStats, settings: &Settings, light_sampling: LightSampling, runs: u32) -> Vec<PlannedPass> {
    let bidirectional = settings.method() == Method::Bdpt;
    let row = |name, runs, reason: &str| PlannedPass { name, runs, reason: reason.to_owned() };
    let light_paths = if bidirectional {
        "a light subpath per pixel, connected with the camera and stored"
    } else {
        "path tracing has no light subpaths"
    };
    let reservoirs = match light_sampling {
        LightSampling::Restir => "direct light at first hits, resampled with the last sample's reservoirs".to_owned(),
        LightSampling::Ris => "direct light at first hits, resampled".to_owned(),
        other => format!("lights are chosen by {other} alone"),
    };
    let eye_paths = if bidirectional {
        "an eye subpath per pixel, connected with lights and with the light subpath"
    } else {
        "a path per pixel, connected with lights"
    };
    let film = match (settings.is_adaptive(), settings.skips_tiles()) {
        (true, _) => "film, except tiles that have converged",
        (_, true) => "film, except tiles outside the crop",
        _ => "film",
    };
    let mut passes = PlannedPass::of_upload(stats);
    passes.extend([
        row("light_paths", if bidirectional { runs } else { 0 }, light_paths),
        row("reservoirs", if light_sampling.resamples() { runs } else { 0 }, &reservoirs),
        row("eye_paths", runs, eye_paths),
        row("resolve", 1, film),
    ]);
    passes
}

/// Returns the bytes of the buffers per pixel: image, film, first hits, reservoirs, splats and converged
/// tiles.
fn pixel_bytes(settings: &Settings, light_sampling: LightSampling) -> u64 {
    let pixels = u64::from(settings.width) * u64::from(settings.height);
    let resampling = match light_sampling {
        LightSampling::Restir => 2 * size_of::<FirstHit>() as u64,
        LightSampling::Ris => size_of::<FirstHit>() as u64,
        _ => 0,
    };
    let splats = if settings.method() == Method::Bdpt { 24 } else { 0 };
    let converged = if settings.skips_tiles() { adaptive_sampling::bytes(settings.width, settings.height) } else { 0 };
    converged + pixels * (16 + film::DEVICE_BYTES + resampling + splats)
}

impl fmt::Display for PathPlan {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        PlannedPass::write_rows(&self.passes, f)?;
        let code = if self.flags.is_empty() { "diffuse only".to_owned() } else { flag_names(&self.flags) };
        writeln!(f, "{:<21}  {code}", "shader code")?;
        writeln!(f, "{:<21}  chosen by {}", "lights", self.light_sampling)?;
        let rays = match self.tracing {
            Tracing::RayQuery => "ray queries of the device",
            Tracing::Grid => "a grid of triangle lists, rasterized once per pose",
            Tracing::Bvh => "a bounding volume hierarchy, built on the CPU",
        };
        writeln!(f, "{:<21}  {rays}", "rays")?;
        writeln!(f, "{:<21}  {} pixels", "groups", self.group)?;
        write!(f, "{:<21}  {:.1} MB beside the scene", "memory", self.bytes as f64 * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Technique;

    fn plan(settings: &Settings) -> PathPlan {
        let capabilities = Capabilities {
            adapter: "none".to_owned(),
            software: true,
            compiles_late: false,
            ray_queries: true,
            timestamps: false,
            max_storage_bytes: 128 << 20,
            max_texture_side: 8192,
            max_texture_layers: 256,
        };
        PathPlan::new(&Scene::default(), &SceneStats::default(), settings, &capabilities)
    }

    fn runs(plan: &PathPlan, name: &str) -> u32 {
        plan.passes.iter().find(|pass| pass.name == name).unwrap().runs
    }

    #[test]
    fn light_vertices_of_a_group_fit_a_binding() {
        let small = plan(&Settings { technique: Technique::RAY_QUERY, width: 64, height: 64, ..Settings::default() });
        assert_eq!((small.group, runs(&small, "light_paths"), runs(&small, "eye_paths")), (64 * 64, 1, 1));
        assert_eq!(small.flags, [Flag::LightPaths]);
        let deep =
            Settings { technique: Technique::RAY_QUERY, width: 512, height: 512, bounces: 64, ..Settings::default() };
        let deep = plan(&deep);
        assert!(deep.vertex_bytes <= 128 << 20 && runs(&deep, "light_paths") == 7, "{deep}");
        assert_eq!(runs(&deep, "light_paths"), runs(&deep, "eye_paths"));
    }

    #[test]
    fn path_tracing_has_no_light_subpaths() {
        let path = plan(&Settings { technique: Technique::PATH, bounces: UNLIMITED, ..Settings::default() });
        assert_eq!((runs(&path, "light_paths"), path.vertex_bytes, runs(&path, "eye_paths")), (0, 0, 1));
        assert_eq!(path.flags, [Flag::Grid]);
        assert!(path.to_string().contains("skip"));
    }

    #[test]
    fn resampling_keeps_first_hits_and_reservoirs() {
        let of = |light_sampling| plan(&Settings { technique: Technique::PATH, light_sampling, ..Settings::default() });
        let (none, ris) = (of(None), of(Some(LightSampling::Ris)));
        let restir = of(Some(LightSampling::Restir));
        assert_eq!([&none, &ris, &restir].map(|p| runs(p, "reservoirs")), [0, 1, 1]);
        assert!(none.bytes < ris.bytes && ris.bytes < restir.bytes);
        assert_eq!(restir.flags, [Flag::LightTree, Flag::Reservoirs, Flag::Grid]);
    }
}
