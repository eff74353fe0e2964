//! connect: connects z_j of every pixel with one light vertex (eq. (3)-(8)); one run per strategy. Rays connect it with
//! the points of all lights in one run.
//!
//! Reads: the eye vertices, the light vertices and the map around the one that is connected; the guide of the sky, by
//! which each vertex draws directions of its own. Writes: the
//! iteration's image. Skipped when: there are no lights; light candidates make direct light.

use crate::gpu::{Compute, Flag, Gpu};
use crate::render::recording::Recording;
use crate::render::shared::film_buffer::Band;
use crate::render::visibility::view::ViewBuffers;

/// The pass, for one number of light vertices.
pub struct Connect(Compute);

/// The inputs beside the band's pixels.
pub struct ConnectInputs<'a> {
    /// The strategy's constants; by rays for all lights.
    pub strategy: wgpu::BindingResource<'a>,
    /// The map around the light vertex, unless rays connect light points.
    pub view: Option<&'a ViewBuffers>,
    /// The light point; by rays all of them, of all classes.
    pub y0: wgpu::BindingResource<'a>,
    /// The VPLs y1 and y2 of each class.
    pub light_vertices: &'a wgpu::Buffer,
    /// The reflective shadow map of y0, if its light has one.
    pub rsm: Option<&'a wgpu::Buffer>,
    /// Places where light of the sky comes in.
    pub guide: Option<&'a wgpu::TextureView>,
}

impl Connect {
    /// Builds the pipeline for strategies with `s` light vertices. `clamped` bounds the geometry term as the
    /// paper does.
    #[must_use]
    pub fn new(gpu: &Gpu, flags: &[Flag], s: u32, clamped: bool) -> Self {
        let label = ["connect_light", "connect_y1", "connect_y2"][s as usize - 1];
        let mut flags = flags.to_vec();
        if s == 1 {
            flags.push(Flag::Light);
        }
        if clamped {
            flags.push(Flag::Clamped);
        }
        Self(Compute::labelled(gpu, label, "shared/paths/connect", &flags))
    }

    /// Records the pass.
    pub fn record(&self, recording: &mut Recording, band: &Band, inputs: &ConnectInputs) {
        let buffers = [
            ("strategy", inputs.strategy.clone()),
            ("strategies", inputs.strategy.clone()),
            ("y0", inputs.y0.clone()),
            ("light_points", inputs.y0.clone()),
            ("light_vertices", inputs.light_vertices.as_entire_binding()),
        ];
        let view = inputs.view.map(ViewBuffers::bindings);
        let view = view.as_ref().map_or(&[][..], |view| view);
        let rsm: Vec<_> = inputs.rsm.iter().map(|table| ("rsm", table.as_entire_binding())).collect();
        let guide: Vec<_> =
            inputs.guide.map(|guide| ("sky_guide", wgpu::BindingResource::TextureView(guide))).into_iter().collect();
        recording.run_layers(&self.0, band.size, band.classes, &[view, &band.bindings(), &buffers, &rsm, &guide]);
    }
}
