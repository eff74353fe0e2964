//! The views whose queries rays answer: those that are cheaper to trace than to rasterize.
//!
//! Lists are rasterized for each light subpath and answer along a view's own rays alone; a grid is rasterized
//! once per pose and answers any ray, for more time each. So rays win where triangles are many, pixels few, or
//! light subpaths many.

use std::fmt;

use crate::gpu::Capabilities;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::cost::Cost;
use crate::render::shared::plan::views::ViewRole;
use crate::render::visibility::tracer::Tracing;
use crate::scene::SceneStats;
use crate::settings::{Settings, Visibility, VisibilityFrom};

/// The kinds of views whose queries rays answer, in place of lists and depth maps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct RayViews {
    /// Points of lights: y0, those of other lights, and light candidates.
    pub lights: bool,
    /// VPLs.
    pub vpls: bool,
    /// Ray-bundles.
    pub bundles: bool,
}

impl RayViews {
    /// All views.
    pub const ALL: Self = Self { lights: true, vpls: true, bundles: true };

    /// Returns all combinations, none first.
    pub fn combinations() -> impl Iterator<Item = Self> {
        let bit = |bits: u32, n: u32| bits >> n & 1 == 1;
        (0..8).map(move |bits| Self { lights: bit(bits, 0), vpls: bit(bits, 1), bundles: bit(bits, 2) })
    }

    /// True if rays answer the queries of a view.
    #[must_use]
    pub fn answer(self, role: ViewRole) -> bool {
        match role {
            ViewRole::LightVertex(0) | ViewRole::Light(_) | ViewRole::Candidate(_) => self.lights,
            ViewRole::LightVertex(_) => self.vpls,
            ViewRole::Bundle(_) => self.bundles,
        }
    }
}

impl FramePlan {
    /// Chooses the views that rays answer, and the cost of an iteration that follows. With `--visibility
    /// ray-query` or `bvh` the cost stays that of the choice for `exact`, so that all have the same random
    /// numbers.
    pub(super) fn choose_ray_views(&mut self, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) {
        let (visibility, from) = (settings.visibility(), settings.visibility_from);
        let possible = |views: &RayViews| match (visibility, from) {
            (Visibility::Fast, _) => *views == RayViews::default(),
            (_, VisibilityFrom::Grid) => *views == RayViews::ALL,
            // Paths take directions of their own from glossy surfaces, and light passes glass on either side.
            _ if self.transmits() => *views == RayViews::ALL,
            (_, VisibilityFrom::Lists) => *views == RayViews { bundles: self.own_directions, ..Default::default() },
            // Paths that look for the sky are traced, and so is what its guide says.
            _ if self.guides_sky && !views.lights => false,
            _ if self.own_directions => views.bundles,
            _ => !(self.list_lengths && views.bundles),
        };
        let mut best = (f64::INFINITY, RayViews::default(), Cost::default());
        for views in RayViews::combinations().filter(possible).collect::<Vec<_>>() {
            self.ray_views = views;
            self.traces_camera = views != RayViews::default();
            self.cost = Cost::new(&self.work(stats, settings, capabilities));
            let (side, _) = self.choose_side(stats, settings);
            let time = self.cost.per_subpath(side);
            if time < best.0 {
                best = (time, views, self.cost);
            }
        }
        (_, self.ray_views, self.cost) = best;
        self.traces_camera = self.ray_views != RayViews::default();
        let why = |asked: VisibilityFrom| if from == asked { "as asked for" } else { "by the model" };
        self.rays_reason = match visibility {
            Visibility::RayQuery => "ray queries of the device, as asked for".to_owned(),
            Visibility::Bvh => "a bounding volume hierarchy, as asked for".to_owned(),
            Visibility::Fast => "none: depth maps and lists".to_owned(),
            Visibility::Exact if self.guides_sky && from == VisibilityFrom::Auto => {
                format!("a grid made once answers {}: light of the sky is guided into the room", self.ray_views)
            }
            Visibility::Exact if self.traces_camera => {
                format!("a grid made once is cheaper for {}, {}", self.ray_views, why(VisibilityFrom::Grid))
            }
            Visibility::Exact => {
                format!("none: lists made in each iteration are cheaper, {}", why(VisibilityFrom::Lists))
            }
        };
        if matches!(visibility, Visibility::RayQuery | Visibility::Bvh) {
            self.ray_views = RayViews::ALL;
        }
        self.tracing = (self.ray_views != RayViews::default()).then(|| Tracing::of(visibility));
    }
}

impl fmt::Display for RayViews {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let all = [(self.lights, "lights"), (self.vpls, "VPLs"), (self.bundles, "bundles")];
        let names: Vec<_> = all.into_iter().filter(|(on, _)| *on).map(|(_, name)| name).collect();
        f.write_str(&names.join(" and "))
    }
}
