//! What one sample of the path methods does, decided before anything is allocated, and why.

use std::fmt;

use crate::film;
use crate::gpu::Capabilities;
use crate::layouts::{FirstHit, PathVertex, Reservoir};
use crate::plan::PlannedPass;
use crate::scene::{Light, Scene, SceneStats};
use crate::settings::{LightSampling, Method, Settings, UNLIMITED};
use crate::tiles;

/// Bounces that nothing reaches: roulette ends paths long before.
const ENDLESS: u32 = 1 << 24;

/// Subpaths of a dispatch at most: the workgroups that every adapter has, of 64 each.
const MOST_OF_A_GROUP: u64 = 65_535 * 64;

/// A pure value: the sample's passes, shader flags, sizes and bytes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PathPlan {
    /// Passes, run or skipped, in order.
    pub passes: Vec<PlannedPass>,
    /// Flags of the shaders.
    pub flags: Vec<&'static str>,
    /// Bounces of a path at most.
    pub bounces: u32,
    /// How surfaces choose their lights.
    pub light_sampling: LightSampling,
    /// Pixels whose subpaths are traced together, so that what is stored of them can be bound.
    pub group: u32,
    /// Bytes of the stored light subpaths.
    pub vertex_bytes: u64,
    /// Bytes of buffers beside the scene.
    pub bytes: u64,
}

impl PathPlan {
    /// Decides.
    #[must_use]
    pub fn new(scene: &Scene, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> Self {
        let both_sides = settings.method == Method::RayQuery;
        let glossy = stats.glossy_triangles > 0;
        let somewhere =
            scene.lights.iter().filter(|l| !matches!(l, Light::Directional { .. } | Light::Sun { .. })).count();
        let light_sampling = settings.light_sampling.unwrap_or(if somewhere + stats.emissive_triangles > 1 {
            LightSampling::Tree
        } else {
            LightSampling::Power
        });
        let flags = [
            ("TEXTURES", stats.texels > 0),
            ("VERTEX_COLORS", stats.vertex_colors),
            ("GLOSSY", glossy),
            ("SPECULAR", glossy),
            ("TRANSMISSION", glossy && scene.materials.iter().any(|m| m.bsdf.transmits())),
            ("MASKS", stats.masked_triangles > 0),
            ("PUNCTUAL", stats.lights > 0),
            ("PATTERNS", stats.patterns),
            ("EMISSION", stats.emissive_triangles > 0),
            ("ENVIRONMENT", stats.environment),
            ("ENVIRONMENT_MAP", stats.environment_map),
            ("LIGHT_PATHS", both_sides),
            ("LIGHT_TREE", light_sampling.has_tree()),
            ("RESERVOIRS", light_sampling.resamples()),
            ("SETTLES", settings.settles()),
        ];
        let flags = flags.iter().filter(|(_, on)| *on).map(|(flag, _)| *flag).collect();

        let bounces = if settings.bounces == UNLIMITED { ENDLESS } else { settings.bounces };
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        let limit = capabilities.max_storage_bytes;
        // The last vertex is joined to the camera alone, and not stored.
        let per_pixel = if both_sides { u64::from(bounces.max(1)) * size_of::<PathVertex>() as u64 } else { 0 };
        let group = limit.checked_div(per_pixel).unwrap_or(u64::MAX).min(pixels).min(MOST_OF_A_GROUP);
        let runs = pixels.div_ceil(group.max(1)) as u32;
        let film = if settings.settles() { "film, but for tiles that have settled" } else { "film" };
        let passes = vec![
            PlannedPass::tessellate(stats),
            PlannedPass {
                name: "light_paths",
                runs: if both_sides { runs } else { 0 },
                reason: if both_sides {
                    "a light subpath per pixel, joined to the camera and stored".to_owned()
                } else {
                    "paths start at the camera alone".to_owned()
                },
            },
            PlannedPass {
                name: "reservoirs",
                runs: if light_sampling.resamples() { runs } else { 0 },
                reason: match light_sampling {
                    LightSampling::Restir => "light of what pixels see, resampled with what was kept before".to_owned(),
                    LightSampling::Ris => "light of what pixels see, resampled".to_owned(),
                    other => format!("lights are chosen by {other} alone"),
                },
            },
            PlannedPass {
                name: "eye_paths",
                runs,
                reason: if both_sides {
                    "an eye subpath per pixel, joined to lights and to the light subpath".to_owned()
                } else {
                    "a path per pixel, joined to lights".to_owned()
                },
            },
            PlannedPass { name: "resolve", runs: 1, reason: film.to_owned() },
        ];
        let vertex_bytes = group * per_pixel;
        // Image, film, what resampling keeps and, where light subpaths meet the camera, splats.
        let kept = match light_sampling {
            LightSampling::Restir => 2 * (size_of::<FirstHit>() + size_of::<Reservoir>()) as u64,
            LightSampling::Ris => size_of::<FirstHit>() as u64,
            _ => 0,
        };
        let settled = if settings.settles() { tiles::bytes(settings.width, settings.height) } else { 0 };
        let bytes =
            settled + pixels * (16 + film::DEVICE_BYTES + kept + if both_sides { 24 } else { 0 }) + vertex_bytes;
        Self { passes, flags, bounces, light_sampling, group: group as u32, vertex_bytes, bytes }
    }
}

impl fmt::Display for PathPlan {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "{:<14} {:>4}  why", "pass", "runs")?;
        for p in &self.passes {
            let runs = if p.runs == 0 { "skip".to_owned() } else { p.runs.to_string() };
            writeln!(f, "{:<14} {:>4}  {}", p.name, runs, p.reason)?;
        }
        let code = if self.flags.is_empty() { "diffuse only".to_owned() } else { self.flags.join(" ") };
        writeln!(f, "shader code    {code}")?;
        writeln!(f, "lights         chosen by {}", self.light_sampling)?;
        writeln!(f, "groups         {} pixels", self.group)?;
        write!(f, "memory         {:.1} MB beside the scene", self.bytes as f64 * 1e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(settings: &Settings) -> PathPlan {
        let capabilities = Capabilities {
            adapter: "none".to_owned(),
            software: true,
            ray_queries: true,
            timestamps: false,
            max_storage_bytes: 128 << 20,
            max_texture_side: 8192,
            max_texture_layers: 256,
        };
        PathPlan::new(&Scene::default(), &SceneStats::default(), settings, &capabilities)
    }

    #[test]
    fn light_subpaths_are_stored_in_groups_that_can_be_bound() {
        let small = plan(&Settings { method: Method::RayQuery, width: 64, height: 64, ..Settings::default() });
        assert_eq!((small.group, small.passes[1].runs, small.passes[3].runs), (64 * 64, 1, 1));
        assert_eq!(small.flags, ["LIGHT_PATHS"]);
        let deep = Settings { method: Method::RayQuery, width: 512, height: 512, bounces: 64, ..Settings::default() };
        let deep = plan(&deep);
        assert!(deep.vertex_bytes <= 128 << 20 && deep.passes[1].runs == 7, "{deep}");
        assert_eq!(deep.passes[1].runs, deep.passes[3].runs);
    }

    #[test]
    fn path_tracing_has_no_light_subpaths() {
        let path = plan(&Settings { method: Method::Path, bounces: UNLIMITED, ..Settings::default() });
        assert_eq!((path.passes[1].runs, path.vertex_bytes, path.passes[3].runs), (0, 0, 1));
        assert!(path.flags.is_empty() && path.to_string().contains("skip"));
    }

    #[test]
    fn what_is_resampled_is_kept() {
        let of = |light_sampling| plan(&Settings { method: Method::Path, light_sampling, ..Settings::default() });
        let (none, ris) = (of(None), of(Some(LightSampling::Ris)));
        let restir = of(Some(LightSampling::Restir));
        assert_eq!([&none, &ris, &restir].map(|p| p.passes[2].runs), [0, 1, 1]);
        assert_eq!(none.passes[2].name, "reservoirs");
        assert!(none.bytes < ris.bytes && ris.bytes < restir.bytes);
        assert_eq!(restir.flags, ["LIGHT_TREE", "RESERVOIRS"]);
    }
}
