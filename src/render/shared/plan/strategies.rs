//! The strategies (s, t) of an iteration: connections of eye vertices with light vertices, and extensions
//! along bundles.

use crate::scene::SceneStats;
use crate::settings::{Settings, Strategies};

/// Most light vertices: y0, y1 and y2.
const MOST_LIGHT_VERTICES: u32 = 3;

/// A connection of z_j with the light vertex y_(s-1).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Connection {
    /// Light vertices of the strategy.
    pub s: u32,
    /// Index of the eye vertex; the strategy has j + 1 eye vertices.
    pub j: u32,
    /// Sample counts of s = 0, 1, 2, 3 in MIS for paths of this length; 0 for strategies that take no part.
    pub samples: [u32; 4],
    /// True if only narrow lobes hit emitters in paths of this length.
    pub narrow_only: bool,
    /// True if the geometry term is bounded (the paper's (2, 3)).
    pub clamped: bool,
}

impl Connection {
    /// True for (1, 2): the first eye vertex with a light.
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
    /// True if no vertex is written, since only hits on emitters count.
    pub last: bool,
    /// True if hits on emitters count: strategy (0, j + 2).
    pub hits_emitter: bool,
    /// Sample counts as in [`Connection::samples`].
    pub samples: [u32; 4],
    /// True if only narrow lobes are extended.
    pub narrow_only: bool,
}

/// The strategies that take part.
pub(super) struct StrategySet<'a> {
    settings: &'a Settings,
    /// True if no path has a bounce.
    unlit: bool,
    /// True if extensions can hit emitters: emissive surfaces or an environment.
    pub emitters: bool,
    /// Light vertices of the light subpath; 0 without lights.
    pub light_vertices: u32,
    /// Light points that direct light is selected from.
    pub light_candidates: u32,
    /// True if paths follow mirrors or clear glass.
    smooth: bool,
    /// Number of vertices on glass and mirrors that may count as no bounces.
    pub specular_bounces: u32,
}

impl<'a> StrategySet<'a> {
    /// Sets the number of light vertices; light candidates are 1.
    pub fn new(stats: &SceneStats, settings: &'a Settings) -> Self {
        let lists_only = settings.list_lengths;
        let emitters = !lists_only && (stats.environment || stats.emissive_triangles > 0);
        // In the paper, light subpaths do not start from emitters: bundles hit them.
        let starts = !lists_only && stats.lights > 0 || emitters && settings.strategies != Strategies::Paper;
        let starts = starts && !stats.unlit;
        let most = MOST_LIGHT_VERTICES.min(settings.bounces + 1);
        let light_vertices = match (starts, settings.strategies) {
            (false, _) => 0,
            (_, Strategies::Bundle) => 1,
            (_, Strategies::Paper) => most.min(2),
            _ => most,
        };
        let smooth = settings.draws_own_directions() && stats.smooth_share > 0.0;
        let follows = settings.draws_own_directions() && stats.specular && !stats.unlit;
        let specular_bounces = if follows { settings.specular_bounces } else { 0 };
        Self { settings, unlit: stats.unlit, emitters, light_vertices, light_candidates: 1, smooth, specular_bounces }
    }

    /// Returns the most vertices of a path between camera and light.
    pub fn most_vertices(&self) -> u32 {
        self.settings.bounces + 1 + self.specular_bounces
    }

    /// True unless another strategy is the only one that counts.
    fn counts(&self, s: u32, t: u32) -> bool {
        self.settings.only.is_none_or(|only| (only.s, only.t) == (s, t))
    }

    /// True if bundles do not look for emitters in paths of k bounces. After the last of several bounces that
    /// takes a bundle and a third of all look-ups, and light subpaths sample the same paths (docs/journal.md,
    /// "Cost of an iteration"). Light that a mirror reflects is found by s = 0 alone, so that narrow lobes go on
    /// by directions of their own where there are mirrors. Where vertices may count as no bounces, those pixels go on whose
    /// path has one, so that the last bounce is not the same for all.
    fn ends_bundles(&self, k: u32) -> bool {
        self.specular_bounces == 0
            && k > 1
            && k == self.settings.bounces
            && self.light_vertices > 1
            && self.settings.strategies == Strategies::All
    }

    /// True if only narrow lobes hit emitters in paths of k bounces.
    fn is_narrow_only(&self, k: u32) -> bool {
        self.smooth && self.ends_bundles(k)
    }

    /// Returns the sample counts of s = 0, 1, 2, 3 for paths of k + 1 vertices, which have strategies s = 0 ...
    /// min(light vertices, k + 1). Those that are longer than the bounces pass glass and mirrors: VPLs take no part.
    fn sample_counts(&self, k: u32) -> [u32; 4] {
        let most = if k > self.settings.bounces { 1 } else { k + 1 }.min(self.light_vertices);
        std::array::from_fn(|i| {
            let s = i as u32;
            let takes_part = s <= most
                && (s > 0 || self.emitters && (self.smooth || !self.ends_bundles(k)))
                && match self.settings.strategies {
                    Strategies::All | Strategies::Bundle => true,
                    Strategies::Vpl => s == most,
                    Strategies::Paper => s == 0 || k < 2 || (k == 2 && s == 2),
                };
            match (takes_part, s, k) {
                (false, ..) => 0,
                (true, 1, 0) => self.light_candidates,
                _ => 1,
            }
        })
    }

    /// Sets the counts of all strategies but s to 0 if one strategy is rendered unweighted.
    fn unweighted(&self, s: u32, samples: [u32; 4]) -> [u32; 4] {
        let alone = self.settings.only.is_some_and(|only| !only.weighted);
        if alone { std::array::from_fn(|i| if i as u32 == s { samples[i] } else { 0 }) } else { samples }
    }

    /// Returns the connections by eye vertex, then by light vertex.
    pub fn connections(&self) -> Vec<Connection> {
        let paper = self.settings.strategies == Strategies::Paper;
        let most = self.most_vertices();
        (1..=most)
            .flat_map(|j| (1..=self.light_vertices).map(move |s| (j, s)))
            .filter(|(j, s)| s + j - 1 <= most)
            .map(|(j, s)| {
                let k = s + j - 2;
                let (samples, narrow_only) = (self.sample_counts(k), self.is_narrow_only(k));
                Connection { s, j, samples, narrow_only, clamped: paper && k == 2 }
            })
            .filter(|c| c.samples[c.s as usize] > 0 && self.counts(c.s, c.j + 1))
            .map(|c| Connection { samples: self.unweighted(c.s, c.samples), ..c })
            .collect()
    }

    /// True if hits on emitters from z_j count: (0, j + 2). No other strategy samples emission that the
    /// camera sees (j = 0).
    pub fn hits_emitter(&self, j: u32) -> bool {
        let is_reached = j == 0 || (!self.unlit && self.sample_counts(j - 1)[0] > 0);
        self.emitters && is_reached && self.counts(0, j + 2)
    }

    /// Returns the extensions by eye vertex. z_(j+1) exists if a connection needs it or a later extension can
    /// hit an emitter.
    pub fn extensions(&self, connections: &[Connection]) -> Vec<Extension> {
        let most = self.most_vertices();
        let deepest = connections.iter().map(|c| c.j).max().unwrap_or(1);
        let farthest = (1..=most).rev().find(|&j| self.hits_emitter(j)).unwrap_or(0).max(deepest - 1);
        (1..=farthest)
            .map(|j| Extension {
                j,
                last: j == most && self.specular_bounces == 0,
                hits_emitter: self.hits_emitter(j),
                samples: self.unweighted(0, self.sample_counts(j - 1)),
                narrow_only: self.hits_emitter(j) && self.is_narrow_only(j - 1),
            })
            .collect()
    }
}
