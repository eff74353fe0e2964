//! Capacities of lists at the start, and the bytes that a plan takes on the device.

use crate::film;
use crate::gpu::Capabilities;
use crate::render::adaptive_sampling;
use crate::render::layouts;
use crate::render::shared::passes::camera::borders::Borders;
use crate::render::shared::passes::camera::seen_light::SeenLight;
use crate::render::shared::passes::light::caustics::Caustics;
use crate::render::shared::passes::light::sky_guide::SkyGuide;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::views::PlannedView;
use crate::render::visibility::view::{Answers, PROJECTED_TRIANGLE_BYTES, Texels};
use crate::scene::SceneStats;
use crate::settings::Settings;

impl FramePlan {
    /// Returns the initial capacity for draw items; it grows if an iteration requests more.
    #[must_use]
    pub fn item_capacity(&self, triangles: u64, limit: u64) -> u64 {
        // Small triangles go to lists without items.
        if !self.rasterizes_views() { 0 } else { (triangles / 4 + 1024).min(limit / 16) }
    }

    /// Returns the initial capacity of a view for list nodes, which grows likewise.
    #[must_use]
    pub fn node_capacity(&self, triangles: u64, texels: Texels, limit: u64) -> u64 {
        // Measured in Sponza (bundles 0.5 to 9 nodes a triangle, maps from inside 0.5 to 8) and the Cornell
        // box (1.6 and 1.3 a texel).
        let count = texels.count();
        let guess = match (self.fast, texels.faces) {
            (false, 1) => 2 * count + 8 * triangles,
            (false, _) => 3 * count / 2 + 6 * triangles,
            // Centre-sampled lists hold only triangles that cover a texel's centre.
            (true, _) => 2 * count + 4 * triangles,
        };
        let guess = (guess as f64 * f64::from(self.list_room)) as u64;
        guess.max(1).min((limit / 4 - texels.lists()) / self.node_words())
    }

    /// Returns the 32-bit words of lists with capacity for a number of nodes.
    #[must_use]
    pub fn list_words(&self, texels: Texels, nodes: u64) -> u64 {
        Answers::Lists { node_words: self.node_words() }.words(texels, nodes)
    }

    /// Returns the 32-bit words of the lists that are reduced to depth maps, one map after the other.
    #[must_use]
    pub fn scratch_words(&self, triangles: u64, limit: u64) -> u64 {
        let maps = self.views().into_iter().filter(|view| self.answers(view.role) == Answers::DepthMap);
        maps.map(|v| self.list_words(v.texels, self.node_capacity(triangles, v.texels, limit))).max().unwrap_or(0)
    }

    /// Returns the bytes of an eye vertex with its surface, in a buffer of its own.
    pub(super) fn eye_vertex_bytes(&self) -> u64 {
        layouts::EyeVertex::bytes(self.is_demodulated(), self.transmits(), self.caustics)
            + layouts::Shading::bytes(&self.surface_flags)
    }

    /// True if layers are kept without the colour of surfaces.
    fn is_demodulated(&self) -> bool {
        self.is_layered() && self.glossy()
    }

    /// Returns the initial bytes of all buffers and textures beside the scene.
    pub(super) fn count_bytes(&self, stats: &SceneStats, settings: &Settings, capabilities: &Capabilities) -> u64 {
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        let (triangles, limit) = (stats.triangle_room() as u64, capabilities.max_storage_bytes);
        let layered = self.is_layered();
        let demodulated = self.is_demodulated();
        let selected =
            if self.has_candidates() { layouts::SelectedLight::bytes(demodulated, self.reuses()) } else { 0 };
        let radiance = if layered { 48 } else { 16 };
        let per_band_pixel = selected + self.eye_vertex_bytes() + radiance;
        let film = if layered { self.denoise().bytes() } else { pixels * film::DEVICE_BYTES };
        let converged = if self.skips_tiles { adaptive_sampling::bytes(settings.width, settings.height) } else { 0 };
        let reservoirs = if self.reuses() { 2 * size_of::<layouts::PixelReservoir>() as u64 } else { 0 };
        // The G-buffer takes 8 bytes a pixel, with its depth.
        let gbuffer =
            if self.traces_camera { 0 } else { 8 } + if self.draws_borders { Borders::BYTES_PER_PIXEL } else { 0 };
        let seen = if self.light_borders { SeenLight::BYTES } else { 0 };
        let splats = if self.traces_caustics { Caustics::BYTES } else { 0 };
        let image =
            film + converged + pixels * (gbuffer + reservoirs + splats + seen) + self.grid.largest() * per_band_pixel;
        let view = |PlannedView { role, texels }: PlannedView| {
            let nodes = self.node_capacity(triangles, texels, limit);
            self.projected_triangles(role, triangles) * PROJECTED_TRIANGLE_BYTES
                + 4 * self.answers(role).words(texels, nodes)
        };
        let views: u64 = self.views().into_iter().map(view).sum();
        let guide = if self.guides_sky { SkyGuide::BYTES } else { 0 };
        guide + image + views + 16 * self.item_capacity(triangles, limit) + 4 * self.scratch_words(triangles, limit)
    }
}
