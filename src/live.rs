//! Frame after frame: layers of clear and indirect light, what is remembered of them, and the passes that make a picture of few samples
//! (paper section 6; Boughida et al. 2017).
//!
//! Indirect light is divided by the reflectance of the diffuse base before anything is averaged, and multiplied back at the end.
//! [`crate::passes::gradient`] says how much the light has changed, [`crate::passes::temporal`] averages over time,
//! [`crate::passes::filter`] over the pixels of a square, [`crate::passes::compose`] makes the frame's picture, and
//! [`crate::passes::antialias`] averages these.

use std::array;

use glam::{Mat4, Vec3};

use crate::convergence::BiasFilms;
use crate::film::Film;
use crate::gpu::{Gpu, GpuError, read_back};
use crate::gpu_scene::GpuScene;
use crate::grid::{Grid, Region};
use crate::layouts;
use crate::passes::antialias::Antialias;
use crate::passes::compose::Compose;
use crate::passes::filter::Filter;
use crate::passes::gradient::Gradient;
use crate::passes::outliers::Outliers;
use crate::passes::temporal::Temporal;
use crate::plan::FramePlan;

/// GGX width to which the roughness clamp widens narrow lobes of metals at normal incidence, where a lobe holds as many samples as it
/// should: alpha = sqrt(8 F G / (cos N)) (section 5.2), 0.35 with N = 64 / 16.
const CLAMPED_ALPHA: f32 = 0.7;

/// What two frames have: this one's and the one's before, which change places.
struct Pair([wgpu::Buffer; 2]);

impl Pair {
    fn new(gpu: &Gpu, label: &str, bytes: u64) -> Self {
        Self(array::from_fn(|_| gpu.storage(label, bytes)))
    }

    fn now(&self, frame: u64) -> &wgpu::Buffer {
        &self.0[(frame % 2) as usize]
    }

    fn before(&self, frame: u64) -> &wgpu::Buffer {
        &self.0[((frame + 1) % 2) as usize]
    }

    fn bytes(&self) -> u64 {
        2 * self.0[0].size()
    }
}

/// How the frame before was seen.
struct Before {
    clip_from_world: [[f32; 4]; 4],
    jitter: [f32; 2],
}

/// What tells the bias of the filter: the same frames unfiltered, and filtered twice.
struct Bias {
    filtered_twice: wgpu::Buffer,
    composed: wgpu::Buffer,
    /// Pictures of either.
    unfiltered: Pair,
    twice: Pair,
}

/// Layers, memory and passes of a moving picture.
pub struct Live {
    grid: Grid,
    history: u32,
    /// Samples that a lobe should hold ([`crate::settings::Settings::clamp_samples`]).
    clamp_samples: f32,
    /// Frames so far.
    frame: u64,
    /// Frames since anything changed.
    still: u64,
    before: Option<Before>,
    /// Where vertices were in the frame before, if they have moved since.
    positions_before: Option<wgpu::Buffer>,
    moved: bool,
    uniform: wgpu::Buffer,
    guides: Pair,
    /// Where layers are coarser than the image.
    layer_guides: Option<Pair>,
    clear: Pair,
    indirect: Pair,
    gradient: Option<(Gradient, wgpu::Buffer)>,
    temporal: Option<(Temporal, Pair)>,
    filter: Option<(Filter, wgpu::Buffer)>,
    bias: Option<Bias>,
    outliers: Option<(Outliers, wgpu::Buffer)>,
    compose: Compose,
    composed: wgpu::Buffer,
    antialias: Antialias,
    pictures: Pair,
}

impl Live {
    /// Builds what the plan asks for.
    #[must_use]
    pub fn new(gpu: &Gpu, plan: &FramePlan, clamp_samples: f32) -> Self {
        let grid = plan.grid;
        let [image, layer] = [grid.size, grid.layer()].map(|[w, h]| u64::from(w) * u64::from(h));
        let guide = size_of::<layouts::Guide>() as u64;
        let glossy: &[&str] = if plan.glossy() { &["GLOSSY"] } else { &[] };
        let upsample: &[&str] = if grid.scale > 1 { &["UPSAMPLE"] } else { &[] };
        let squares: u64 = grid.squares().iter().map(|&side| u64::from(side)).product();
        Self {
            grid,
            history: plan.history,
            clamp_samples,
            frame: 0,
            still: 0,
            before: None,
            positions_before: None,
            moved: false,
            uniform: gpu.uniform::<layouts::Live>("live"),
            guides: Pair::new(gpu, "guides", image * guide),
            layer_guides: (grid.scale > 1).then(|| Pair::new(gpu, "layer_guides", layer * guide)),
            clear: Pair::new(gpu, "clear", image * 16),
            indirect: Pair::new(gpu, "indirect", layer * 32),
            gradient: plan.has_gradients().then(|| (Gradient::new(gpu), gpu.storage("gradients", squares * 8))),
            temporal: (plan.history > 0).then(|| (Temporal::new(gpu), Pair::new(gpu, "history", layer * 32))),
            filter: plan.filtered.then(|| (Filter::new(gpu, glossy), gpu.storage("filtered", layer * 32))),
            bias: plan.measures_bias.then(|| Bias {
                filtered_twice: gpu.storage("filtered", layer * 32),
                composed: gpu.storage("composed", image * 16),
                unfiltered: Pair::new(gpu, "picture", image * 16),
                twice: Pair::new(gpu, "picture", image * 16),
            }),
            outliers: plan.tamed.then(|| (Outliers::new(gpu), gpu.storage("tamed", layer * 32))),
            compose: Compose::new(gpu, upsample),
            composed: gpu.storage("composed", image * 16),
            antialias: Antialias::new(gpu),
            pictures: Pair::new(gpu, "picture", image * 16),
        }
    }

    /// Bytes of all that is kept.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let pairs = [&self.guides, &self.clear, &self.indirect, &self.pictures];
        let pairs = pairs.into_iter().chain(&self.layer_guides).chain(self.temporal.as_ref().map(|(_, pair)| pair));
        let more = [&self.composed].into_iter().chain(self.gradient.as_ref().map(|(_, buffer)| buffer));
        let more = more.chain(self.filter.as_ref().map(|(_, buffer)| buffer));
        let more = more.chain(self.outliers.as_ref().map(|(_, buffer)| buffer)).chain(&self.positions_before);
        let of_bias = |bias: &Bias| {
            let buffers = [&bias.filtered_twice, &bias.composed].map(wgpu::Buffer::size);
            buffers.iter().sum::<u64>() + bias.unfiltered.bytes() + bias.twice.bytes()
        };
        let bias = self.bias.as_ref().map_or(0, of_bias);
        pairs.map(Pair::bytes).sum::<u64>() + more.map(wgpu::Buffer::size).sum::<u64>() + bias
    }

    /// Forgets all frames.
    pub fn restart(&mut self) {
        (self.before, self.still, self.moved) = (None, 0, false);
    }

    /// The camera has moved.
    pub fn look(&mut self) {
        self.still = 0;
    }

    /// Something is about to change: lights, or vertices, whose places are kept.
    pub fn change(&mut self, gpu: &Gpu, scene: &GpuScene) {
        self.still = 0;
        if self.before.is_none() || self.moved {
            return;
        }
        let bytes = scene.positions.size();
        if self.positions_before.as_ref().is_none_or(|there| there.size() != bytes) {
            self.positions_before = Some(gpu.storage("positions_before", bytes));
        }
        if let Some(there) = &self.positions_before {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(&scene.positions, 0, there, 0, bytes);
            gpu.queue.submit([encoder.finish()]);
        }
        self.moved = true;
    }

    /// Light subpaths that each pixel has seen since anything changed, with this frame's: N of eq. (14)-(16).
    #[must_use]
    pub fn samples(&self) -> f32 {
        (self.still + 1) as f32 * self.grid.subpaths() as f32
    }

    /// Which class of pixels repeats the random numbers of the frame before, so that it tells changes from noise.
    #[must_use]
    pub fn repeated(&self) -> Option<u32> {
        let changed = self.gradient.is_some() && self.before.is_some() && self.still == 0;
        // Another one each time, so that none falls behind.
        changed.then(|| (self.frame * 7 % u64::from(self.grid.subpaths())) as u32)
    }

    /// What a region tells filters of its pixels.
    #[must_use]
    pub fn guides(&self, region: &Region) -> &wgpu::Buffer {
        match &self.layer_guides {
            Some(guides) if region.scale > 1 => guides.now(self.frame),
            _ => self.guides.now(self.frame),
        }
    }

    /// What a region's light is put into.
    #[must_use]
    pub fn layers(&self, region: &Region) -> [(&str, wgpu::BindingResource<'_>); 3] {
        [
            ("guides", self.guides(region).as_entire_binding()),
            ("clear", self.clear.now(self.frame).as_entire_binding()),
            ("indirect", self.indirect.now(self.frame).as_entire_binding()),
        ]
    }

    /// Records what makes a picture of the frame's layers, submits it and goes on to the next frame.
    pub fn advance(&mut self, gpu: &Gpu, scene: &GpuScene, seen: &layouts::Frame) {
        let live = self.describe(seen);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&live));
        let frame = self.frame;
        let layer_guides = self.layer_guides.as_ref().unwrap_or(&self.guides);
        let positions_before = self.positions_before.as_ref().unwrap_or(&scene.positions);
        let shared = [
            ("live", &self.uniform),
            ("positions_before", positions_before),
            ("clear", self.clear.now(frame)),
            ("clear_before", self.clear.before(frame)),
            ("indirect", self.indirect.now(frame)),
            ("indirect_before", self.indirect.before(frame)),
        ];
        let of_layer = [("guides", layer_guides.now(frame)), ("guides_before", layer_guides.before(frame))];
        let mut commands = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("live") });
        let encoder = &mut commands;
        let layer = self.grid.layer();

        if let Some((pass, gradients)) = self.gradient.as_ref().filter(|_| live.repeats != 0) {
            let more = [of_layer.as_slice(), &[("gradients", gradients)]].concat();
            pass.record(gpu, encoder, self.grid.squares(), &bindings(scene, &shared, &more));
        }
        let mut unfiltered = self.indirect.now(frame);
        if let Some((pass, history)) = &self.temporal {
            // Without gradients nothing reads them.
            let gradients = self.gradient.as_ref().map_or(self.indirect.now(frame), |(_, gradients)| gradients);
            let more =
                [("gradients", gradients), ("history", history.now(frame)), ("history_before", history.before(frame))];
            let more = [of_layer.as_slice(), &more].concat();
            pass.record(gpu, encoder, layer, &bindings(scene, &shared, &more));
            unfiltered = history.now(frame);
        }
        let mut light = unfiltered;
        if let Some((pass, filtered)) = &self.filter {
            let more = [of_layer.as_slice(), &[("unfiltered", unfiltered), ("filtered", filtered)]].concat();
            pass.record(gpu, encoder, layer, &bindings(scene, &shared, &more));
            light = filtered;
        }
        if let Some((pass, tamed)) = &self.outliers {
            let more = [of_layer.as_slice(), &[("filtered", light), ("tamed", tamed)]].concat();
            pass.record(gpu, encoder, layer, &bindings(scene, &shared, &more));
            light = tamed;
        }
        // Each with the light that it is made of.
        let mut pictures = vec![(light, &self.composed, &self.pictures)];
        if let (Some((pass, filtered)), Some(bias)) = (&self.filter, &self.bias) {
            let more = [("unfiltered", filtered), ("filtered", &bias.filtered_twice)];
            let more = [of_layer.as_slice(), &more].concat();
            pass.record(gpu, encoder, layer, &bindings(scene, &shared, &more));
            pictures.push((unfiltered, &bias.composed, &bias.unfiltered));
            pictures.push((&bias.filtered_twice, &bias.composed, &bias.twice));
        }
        for (light, composed, pictures) in pictures {
            let of_image = [
                ("guides", self.guides.now(frame)),
                ("layer_guides", layer_guides.now(frame)),
                ("filtered", light),
                ("composed", composed),
                ("picture", pictures.now(frame)),
                ("picture_before", pictures.before(frame)),
            ];
            let all = bindings(scene, &shared, &of_image);
            self.compose.record(gpu, encoder, self.grid.size, &all);
            self.antialias.record(gpu, encoder, self.grid.size, &all);
        }
        gpu.queue.submit([commands.finish()]);

        self.before = Some(Before { clip_from_world: seen.clip_from_world, jitter: seen.jitter });
        (self.frame, self.still, self.moved) = (frame + 1, self.still + 1, false);
    }

    fn describe(&self, seen: &layouts::Frame) -> layouts::Live {
        let Grid { size, side, scale, .. } = self.grid;
        let before = self.before.as_ref();
        let jitter = before.map_or(seen.jitter, |before| before.jitter);
        let repeated = self.repeated();
        layouts::Live {
            clip_before: before.map_or(Mat4::IDENTITY.to_cols_array_2d(), |before| before.clip_from_world),
            camera_position: seen.camera_position,
            footprint: 2.0 * Vec3::from(seen.camera_right).length() / size[0] as f32 * scale as f32,
            jitter_shift: array::from_fn(|i| jitter[i] - seen.jitter[i]),
            image: size,
            layer: self.grid.layer(),
            repeated: repeated.map_or([0; 2], |class| [class % side, class / side]),
            scale,
            side,
            orthographic: seen.orthographic,
            has_before: u32::from(before.is_some()),
            still: u32::from(before.is_some() && self.still > 0),
            moved: u32::from(self.moved),
            repeats: u32::from(repeated.is_some()),
            // What stands still may converge.
            history: u64::from(self.history).max(self.still + 1) as f32,
            odd: (self.frame % 2) as u32,
            clamped_alpha: CLAMPED_ALPHA / (self.samples() / self.clamp_samples).sqrt(),
            frames: (self.still + 1) as f32,
            averages: if self.temporal.is_some() { 2.0 } else { 1.0 },
        }
    }

    /// The picture of the last frame, averaged with those before it.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails.
    pub fn film(&self, gpu: &Gpu) -> Result<Film, GpuError> {
        self.read(gpu, &self.pictures)
    }

    /// The same frames unfiltered, and filtered twice, where the plan measures the bias of the filter.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails.
    pub fn bias_films(&self, gpu: &Gpu) -> Result<Option<BiasFilms>, GpuError> {
        let Some(bias) = &self.bias else { return Ok(None) };
        let [unfiltered, twice] = [&bias.unfiltered, &bias.twice].map(|pictures| self.read(gpu, pictures));
        Ok(Some(BiasFilms { side: self.grid.side, unfiltered: unfiltered?, twice: twice? }))
    }

    fn read(&self, gpu: &Gpu, pictures: &Pair) -> Result<Film, GpuError> {
        let [width, height] = self.grid.size;
        let pixels: Vec<[f32; 4]> = read_back(gpu, pictures.before(self.frame), (width * height) as usize)?;
        Ok(Film { width, height, pixels: pixels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect() })
    }
}

/// The scene's bindings, then buffers by name.
fn bindings<'a>(
    scene: &'a GpuScene,
    shared: &[(&'a str, &'a wgpu::Buffer)],
    more: &[(&'a str, &'a wgpu::Buffer)],
) -> Vec<(&'a str, wgpu::BindingResource<'a>)> {
    let own: Vec<_> = shared.iter().chain(more).map(|(name, buffer)| (*name, buffer.as_entire_binding())).collect();
    scene.with(&own)
}
