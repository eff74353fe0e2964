//! The views of a light subpath: their roles, and the texels and data structures of each role.

use std::fmt;

use crate::render::shared::plan::FramePlan;
use crate::render::visibility::view::{Answers, Texels};

/// The purpose of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub enum ViewRole {
    /// The map around y0 (0), or around the VPL y1 or y2.
    LightVertex(u32),
    /// A ray-bundle; the first extends z1.
    Bundle(u32),
    /// The map around the point of a light that is not y0's, by the light's index from 1.
    Light(u32),
    /// The map around a light candidate other than y0. Without reuse all candidates take turns in the first
    /// one; with reuse each candidate of this iteration and of the last one has its own.
    Candidate(u32),
}

impl ViewRole {
    /// True for maps around points on lights and around VPLs, false for bundles.
    #[must_use]
    pub fn is_map(self) -> bool {
        !matches!(self, Self::Bundle(_))
    }
}

impl fmt::Display for ViewRole {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::LightVertex(0) => write!(f, "light"),
            Self::LightVertex(n) => write!(f, "vpl {n}"),
            Self::Bundle(n) => write!(f, "bundle {}", n + 1),
            Self::Light(n) => write!(f, "light {}", n + 1),
            Self::Candidate(_) => write!(f, "light candidate"),
        }
    }
}

/// A view before it is allocated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedView {
    /// The purpose.
    pub role: ViewRole,
    /// The resolution.
    pub texels: Texels,
}

impl FramePlan {
    /// Returns the views in the order of their buffers: light vertices, bundles, other lights or candidates.
    #[must_use]
    pub fn views(&self) -> Vec<PlannedView> {
        let light = Texels { faces: self.light_faces(), ..Texels::around(self.light_resolution) };
        let vpl = Texels::around(self.vpl_resolution);
        let bundle = Texels { resolution: self.bundle_resolution, faces: 1, slabs: self.bundle_slabs };
        let candidates = match (self.has_candidates(), self.reuses()) {
            (false, _) => 0,
            (true, false) => 1,
            (true, true) => 2 * self.light_candidates - 1,
        };
        let vertices = (0..self.light_vertices).map(|n| (ViewRole::LightVertex(n), if n == 0 { light } else { vpl }));
        let bundles = (0..self.bundles()).map(|n| (ViewRole::Bundle(n), bundle));
        let lights = (1..self.direct_lights).map(|n| (ViewRole::Light(n), light));
        let candidates = (0..candidates).map(|n| (ViewRole::Candidate(n), light));
        let views = vertices.chain(bundles).chain(lights).chain(candidates);
        views.map(|(role, texels)| PlannedView { role, texels }).collect()
    }

    /// Returns the view around the point on a light: the view of y0, or that of the light if each light has
    /// one.
    #[must_use]
    pub fn light_view(&self, light: u32) -> ViewRole {
        if self.direct_lights > 0 && light > 0 { ViewRole::Light(light) } else { ViewRole::LightVertex(0) }
    }

    /// Returns the view of each light candidate, y0's first; with reuse, those of the last iteration follow.
    /// Empty without candidates.
    #[must_use]
    pub fn candidate_views(&self) -> Vec<ViewRole> {
        if !self.has_candidates() {
            return Vec::new();
        }
        let count = self.light_candidates;
        let others = if self.reuses() { 2 * count - 1 } else { count - 1 };
        let own = |n: u32| if self.reuses() { n } else { 0 };
        let others = (0..others).map(|n| ViewRole::Candidate(own(n)));
        std::iter::once(ViewRole::LightVertex(0)).chain(others).collect()
    }

    /// Returns the number of triangles whose projections a view stores: all in a bundle. Connections to
    /// lights at infinity project the triangles that they need.
    #[must_use]
    pub fn projected_triangles(&self, role: ViewRole, triangles: u64) -> u64 {
        if self.ray_views.answer(role) || role.is_map() { 0 } else { triangles }
    }

    /// Returns the data structure that answers queries to a view.
    #[must_use]
    pub fn answers(&self, role: ViewRole) -> Answers {
        if self.ray_views.answer(role) {
            Answers::Rays
        } else if self.has_depth_maps() && role.is_map() {
            Answers::DepthMap
        } else {
            Answers::Lists { node_words: self.node_words() }
        }
    }

    /// True if any view has lists or a depth map.
    #[must_use]
    pub fn rasterizes_views(&self) -> bool {
        self.views().iter().any(|view| !self.ray_views.answer(view.role))
    }

    /// Returns the number of ray-bundles of a light subpath; none for paths with directions of their own.
    #[must_use]
    pub fn bundles(&self) -> u32 {
        let extended = if self.own_directions { 0 } else { self.extensions.len() as u32 };
        extended + u32::from(self.list_lengths)
    }

    /// True if light vertices have depth maps in place of lists.
    #[must_use]
    pub fn has_depth_maps(&self) -> bool {
        self.fast && self.light_vertices > 0
    }

    /// Returns the number of faces of a view around a light point.
    pub(super) fn light_faces(&self) -> u32 {
        if self.light_extents.local { 6 } else { 1 }
    }

    /// Returns the 32-bit words of a list node.
    #[must_use]
    pub fn node_words(&self) -> u64 {
        if self.fast { 3 } else { 2 }
    }
}
