//! Turns the layers of a frame, clear and indirect light of few samples, into a picture (paper section 6;
//! Boughida et al. 2017).
//!
//! Indirect light is divided by the reflectance of the diffuse base before anything is averaged, and
//! multiplied back at the end. The passes are shaders/denoise: `gradient` measures how much the light has
//! changed, `temporal` averages over time, `filter` over the pixels of a square, `firefly_clamp` bounds
//! outliers, `compose` adds up the frame's picture, and `antialias` averages pictures.

mod layers;
pub mod plan;

use std::array;

use glam::{Mat4, Vec3};

use crate::film::Film;
use crate::film::filtered::{FilteredFilm, Residual};
use crate::gpu::{Binding, Compute, Flag, Gpu, GpuError, read_back_async};
use crate::render::convergence::BiasFilms;
use crate::render::denoise::layers::Layers;
use crate::render::denoise::plan::DenoisePlan;
use crate::render::interleave::{Grid, Region};
use crate::render::layouts;
use crate::render::recording::Recording;
use crate::render::scene_flags::chosen;
use crate::render::state::FrameState;
use crate::render::upload::gpu_scene::GpuScene;

/// GGX width to which the roughness clamp widens narrow lobes of metals at normal incidence, for which a lobe
/// holds enough samples: alpha = sqrt(8 F G / (cos N)) (section 5.2), 0.35 with N = 64 / 16.
const CLAMPED_ALPHA: f32 = 0.7;

/// GGX width of lobes from which on the lights that they show are filtered, over the angle by which the view direction turns
/// from the middle of a square to its border: the flank of a highlight falls by a quarter there (docs/journal.md, "Few samples").
const SHARP_TURNS: f32 = 4.0;

/// Buffers of this frame and of the one before, which alternate.
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

/// The camera of the frame before.
struct Before {
    clip_from_world: [[f32; 4]; 4],
    jitter: [f32; 2],
}

/// A filter, and what it takes away from the frames (shaders/denoise/filter.wesl).
struct Filter {
    pass: Compute,
    /// The pass along rows before it, and what that leaves; none if one pass filters along both.
    across: Option<(Compute, wgpu::Buffer)>,
    filtered: wgpu::Buffer,
    residual: Option<wgpu::Buffer>,
}

/// The picture that measures the bias of the filter: the same frames filtered once more.
struct Bias {
    again: Filter,
    composed: wgpu::Buffer,
    pictures: Pair,
}

impl Filter {
    /// Records the pass and returns the filtered layers.
    fn record<'a>(
        &'a self,
        recording: &mut Recording,
        layer: [u32; 2],
        inputs: &[&[Binding]; 2],
        unfiltered: wgpu::BindingResource<'a>,
    ) -> wgpu::BindingResource<'a> {
        let whole = [("whole", unfiltered.clone())];
        let mut unfiltered = unfiltered;
        if let Some((pass, filtered)) = &self.across {
            let both = [("unfiltered", unfiltered), ("filtered", filtered.as_entire_binding())];
            recording.run(pass, layer, &[inputs[0], inputs[1], &both]);
            unfiltered = filtered.as_entire_binding();
        }
        let both = [("unfiltered", unfiltered), ("filtered", self.filtered.as_entire_binding())];
        let residual: Vec<_> = self.residual.iter().map(|all| ("residual", all.as_entire_binding())).collect();
        recording.run(&self.pass, layer, &[inputs[0], inputs[1], &both, &residual, &whole]);
        self.filtered.as_entire_binding()
    }
}

/// Layers, histories and passes of a picture that is denoised frame by frame.
pub struct Denoiser {
    grid: Grid,
    history: u32,
    /// Samples that a lobe should hold that the camera sees
    /// ([`crate::settings::Settings::samples_per_seen_lobe`]).
    clamp_samples: f32,
    /// Frames so far.
    frame: u64,
    /// Frames since anything changed.
    still: u64,
    /// Frames of these that precede the picture's first.
    first: u64,
    before: Option<Before>,
    /// Vertex positions of the frame before, if they have moved since.
    positions_before: Option<wgpu::Buffer>,
    moved: bool,
    uniform: wgpu::Buffer,
    guides: Pair,
    /// Guides of the layers, if these are coarser than the image.
    layer_guides: Option<Pair>,
    /// Clear light, indirect light and gradients.
    layers: Pair,
    parts: Layers,
    gradient: Option<Compute>,
    temporal: Option<(Compute, Pair)>,
    /// The filters of a square and, if what they take away is kept, of squares around it. Each filters what the one
    /// before has filtered.
    filters: Vec<Filter>,
    bias: Option<Bias>,
    firefly_clamp: Option<(Compute, wgpu::Buffer)>,
    compose: Compute,
    composed: wgpu::Buffer,
    antialias: Compute,
    pictures: Pair,
}

impl Denoiser {
    /// Builds the passes and buffers of a plan.
    #[must_use]
    pub fn new(gpu: &Gpu, plan: &DenoisePlan, clamp_samples: f32) -> Self {
        let grid = plan.grid;
        let [image, layer] = [grid.size, grid.layer()].map(|[w, h]| u64::from(w) * u64::from(h));
        let guide = size_of::<layouts::Guide>() as u64;
        let kinds = chosen([(Flag::Glossy, plan.glossy), (Flag::Mixes, plan.mixes)]);
        let upsample: &[Flag] = if grid.scale > 1 { &[Flag::Upsample] } else { &[] };
        let squares: u64 = grid.squares().iter().map(|&side| u64::from(side)).product();
        let parts = Layers::new(image, layer, if plan.has_gradients() { squares } else { 0 });
        let pass = |shader, flags: &[Flag]| Compute::new(gpu, shader, flags);
        let filtered = || gpu.storage("filtered", layer * 32);
        let filter_pass = |flags: &[Flag]| pass("denoise/filter", &[&kinds[..], flags].concat());
        let filter = |flags: &[Flag]| Filter {
            pass: filter_pass(flags),
            across: flags.contains(&Flag::Coarse).then(|| (filter_pass(&[Flag::Coarse, Flag::Across]), filtered())),
            filtered: filtered(),
            residual: flags.contains(&Flag::Residual).then(|| gpu.storage("residual", image * 16)),
        };
        let filters: &[&[Flag]] = match (plan.filtered, plan.keeps_residual()) {
            (false, _) => &[],
            (true, false) => &[&[Flag::Fades]],
            (true, true) => &[&[Flag::Residual], &[Flag::Residual, Flag::Coarse]],
        };
        Self {
            grid,
            history: plan.history,
            clamp_samples,
            frame: 0,
            still: 0,
            first: 0,
            before: None,
            positions_before: None,
            moved: false,
            uniform: gpu.uniform::<layouts::DenoiseUniform>("denoise"),
            guides: Pair::new(gpu, "guides", image * guide),
            layer_guides: (grid.scale > 1).then(|| Pair::new(gpu, "layer_guides", layer * guide)),
            layers: Pair::new(gpu, "layers", parts.bytes()),
            parts,
            gradient: plan.has_gradients().then(|| pass("denoise/gradient", &[])),
            temporal: (plan.history > 0)
                .then(|| (pass("denoise/temporal", &[]), Pair::new(gpu, "history", layer * 32))),
            filters: filters.iter().map(|flags| filter(flags)).collect(),
            bias: plan.measures_bias.then(|| Bias {
                again: filter(&[Flag::Coarse]),
                composed: gpu.storage("composed", image * 16),
                pictures: Pair::new(gpu, "picture", image * 16),
            }),
            firefly_clamp: plan
                .clamps_fireflies
                .then(|| (pass("denoise/firefly_clamp", &[]), gpu.storage("clamped_layers", layer * 32))),
            compose: pass("denoise/compose", upsample),
            composed: gpu.storage("composed", image * 16),
            antialias: pass("denoise/antialias", &[]),
            pictures: Pair::new(gpu, "picture", image * 16),
        }
    }

    /// Returns the bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let pairs = [&self.guides, &self.layers, &self.pictures];
        let pairs = pairs.into_iter().chain(&self.layer_guides).chain(self.temporal.as_ref().map(|(_, pair)| pair));
        let filters = self.filters.iter().chain(self.bias.iter().map(|bias| &bias.again));
        let of_filters = filters.flat_map(|filter| {
            let across = filter.across.iter().map(|(_, filtered)| filtered);
            std::iter::once(&filter.filtered).chain(&filter.residual).chain(across)
        });
        let clamped = self.firefly_clamp.iter().map(|(_, layers)| layers);
        let buffers = of_filters.chain(clamped).chain([&self.composed]).chain(&self.positions_before);
        let bias = self.bias.as_ref().map_or(0, |bias| bias.composed.size() + bias.pictures.bytes());
        pairs.map(Pair::bytes).sum::<u64>() + buffers.map(wgpu::Buffer::size).sum::<u64>() + bias
    }

    /// Discards all frames.
    pub fn restart(&mut self) {
        (self.before, self.still, self.first, self.moved) = (None, 0, 0, false);
    }

    /// Begins with the frame `first` of a still picture, without those before.
    pub fn begin_at(&mut self, first: u64) {
        self.restart();
        (self.frame, self.still, self.first) = (first, first, first);
    }

    /// Returns the counts that the next frame depends on.
    #[must_use]
    pub fn state(&self) -> FrameState {
        let before = self.before.as_ref().map(|before| (before.clip_from_world, before.jitter));
        FrameState { frame: self.frame, still: self.still, first: self.first, before }
    }

    /// Takes over the counts of [`Self::state`].
    pub fn restore(&mut self, state: &FrameState) {
        let before = state.before.map(|(clip_from_world, jitter)| Before { clip_from_world, jitter });
        (self.frame, self.still, self.first) = (state.frame, state.still, state.first);
        (self.before, self.moved) = (before, false);
    }

    /// Returns the buffers that the next frame reads: the average of the frames, and histories.
    pub fn state_buffers(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        let bias = self.bias.iter().map(|bias| &bias.pictures);
        let layers = [&self.guides, &self.layers];
        let layers = layers.into_iter().chain(&self.layer_guides).filter(|_| self.history > 0);
        let history = self.temporal.iter().map(|(_, history)| history);
        let all = std::iter::once(&self.pictures).chain(bias).chain(layers).chain(history);
        all.map(|pair| pair.before(self.frame)).chain(self.filters.iter().filter_map(|filter| filter.residual.as_ref()))
    }

    /// Begins the average of still frames anew, since the camera has moved.
    pub fn camera_moved(&mut self) {
        (self.still, self.first) = (0, 0);
    }

    /// Prepares for a change of lights or vertices, and copies the present positions for reprojection.
    pub fn scene_moves(&mut self, gpu: &Gpu, scene: &GpuScene) {
        (self.still, self.first) = (0, 0);
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

    /// Returns the number of light subpaths per pixel since anything changed, including this frame's: N of
    /// eq. (14)-(16).
    #[must_use]
    pub fn samples(&self) -> f32 {
        (self.still + 1) as f32 * self.grid.subpaths() as f32
    }

    /// Returns the class of pixels that repeats the random numbers of the frame before, which separates
    /// changes of light from noise. Each frame takes another class.
    #[must_use]
    pub fn repeated(&self) -> Option<u32> {
        let changed = self.gradient.is_some() && self.before.is_some() && self.still == 0;
        changed.then(|| (self.frame * 7 % u64::from(self.grid.subpaths())) as u32)
    }

    /// Returns the guides of a region's pixels.
    #[must_use]
    pub fn guides(&self, region: &Region) -> &wgpu::Buffer {
        match &self.layer_guides {
            Some(guides) if region.scale > 1 => guides.now(self.frame),
            _ => self.guides.now(self.frame),
        }
    }

    /// Returns the bindings of the layers that a region writes.
    #[must_use]
    pub fn layers(&self, region: &Region) -> [Binding<'_>; 3] {
        [
            ("guides", self.guides(region).as_entire_binding()),
            self.parts.clear(self.layers.now(self.frame)),
            self.parts.indirect("indirect", self.layers.now(self.frame)),
        ]
    }

    /// Denoises the frame's layers to a picture and begins the next frame. `camera` is the frame's uniform.
    pub fn advance(&mut self, gpu: &Gpu, scene: &GpuScene, camera: &layouts::FrameUniform) {
        let uniform = self.uniform_of(camera);
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let mut recording = Recording::new(gpu, scene, "denoise");
        self.record(&mut recording, uniform.repeats != 0);
        recording.submit();

        self.before = Some(Before { clip_from_world: camera.clip_from_world, jitter: camera.jitter });
        (self.frame, self.still, self.moved) = (self.frame + 1, self.still + 1, false);
    }

    /// Records the passes from layers to pictures.
    fn record(&self, recording: &mut Recording, repeats: bool) {
        let (frame, layer) = (self.frame, self.grid.layer());
        let layer_guides = self.layer_guides.as_ref().unwrap_or(&self.guides);
        let positions_before = self.positions_before.as_ref().unwrap_or(&recording.scene.positions);
        let layers = self.layers.now(frame);
        let shared = bindings([("denoise", &self.uniform), ("positions_before", positions_before)]);
        let both = bindings([("layers", layers), ("layers_before", self.layers.before(frame))]);
        let clear = [self.parts.clear(layers)];
        let guides = bindings([("guides", layer_guides.now(frame)), ("guides_before", layer_guides.before(frame))]);

        if let Some(pass) = self.gradient.as_ref().filter(|_| repeats) {
            recording.run(pass, self.grid.squares(), &[&shared, &guides, &both]);
        }
        let mut unfiltered = self.parts.indirect("indirect", layers).1;
        if let Some((pass, history)) = &self.temporal {
            let (now, before) = (history.now(frame), history.before(frame));
            let inputs = bindings([("history", now), ("history_before", before)]);
            recording.run(pass, layer, &[&shared, &guides, &both, &inputs]);
            unfiltered = now.as_entire_binding();
        }
        let mut light = unfiltered;
        for filter in &self.filters {
            light = filter.record(recording, layer, &[&shared, &guides], light);
        }
        if let Some((pass, clamped_layers)) = &self.firefly_clamp {
            let inputs = [("filtered", light), ("clamped_layers", clamped_layers.as_entire_binding())];
            recording.run(pass, layer, &[&shared, &guides, &inputs]);
            light = clamped_layers.as_entire_binding();
        }
        let mut pictures = vec![(light, &self.composed, &self.pictures)];
        if let (Some(last), Some(bias)) = (self.filters.last(), &self.bias) {
            let twice = bias.again.record(recording, layer, &[&shared, &guides], last.filtered.as_entire_binding());
            pictures.push((twice, &bias.composed, &bias.pictures));
        }
        for (light, composed, pictures) in pictures {
            let inputs = bindings([
                ("guides", self.guides.now(frame)),
                ("layer_guides", layer_guides.now(frame)),
                ("composed", composed),
                ("picture", pictures.now(frame)),
                ("picture_before", pictures.before(frame)),
            ]);
            let light = [("filtered", light)];
            recording.run(&self.compose, self.grid.size, &[&shared, &clear, &light, &inputs]);
            recording.run(&self.antialias, self.grid.size, &[&shared, &inputs]);
        }
    }

    /// Returns the metres across a layer's pixel; per metre of distance in a perspective view.
    fn footprint(&self, camera: &layouts::FrameUniform) -> f32 {
        let Grid { size, scale, .. } = self.grid;
        2.0 * Vec3::from(camera.camera_right).length() / size[0] as f32 * scale as f32
    }

    /// Returns the GGX width of lobes from which on the lights that they show are filtered. All are, and it is 0, where frames
    /// are averaged over time, where light that needs no filter has a class of its own, and where all view directions are alike.
    #[must_use]
    pub fn sharp_alpha(&self, camera: &layouts::FrameUniform) -> f32 {
        if self.filters.is_empty() || self.history > 0 || self.grid.scale > 1 || camera.orthographic != 0 {
            return 0.0;
        }
        SHARP_TURNS * 0.5 * self.grid.side as f32 * self.footprint(camera)
    }

    /// Returns the uniform that the passes share.
    fn uniform_of(&self, camera: &layouts::FrameUniform) -> layouts::DenoiseUniform {
        let Grid { size, side, scale, .. } = self.grid;
        let before = self.before.as_ref();
        let jitter = before.map_or(camera.jitter, |before| before.jitter);
        let repeated = self.repeated();
        layouts::DenoiseUniform {
            clip_before: before.map_or(Mat4::IDENTITY.to_cols_array_2d(), |before| before.clip_from_world),
            camera_position: camera.camera_position,
            footprint: self.footprint(camera),
            jitter_shift: array::from_fn(|i| jitter[i] - camera.jitter[i]),
            image: size,
            layer: self.grid.layer(),
            repeated: repeated.map_or([0; 2], |class| [class % side, class / side]),
            scale,
            side,
            orthographic: camera.orthographic,
            has_before: u32::from(before.is_some()),
            still: u32::from(before.is_some() && self.still > 0),
            moved: u32::from(self.moved),
            repeats: u32::from(repeated.is_some()),
            // A still picture may converge.
            history: u64::from(self.history).max(self.still + 1) as f32,
            odd: (self.frame % 2) as u32,
            clamped_alpha: CLAMPED_ALPHA / (self.samples() / self.clamp_samples).sqrt(),
            frames: (self.still - self.first + 1) as f32,
            averages: if self.temporal.is_some() { 2.0 } else { 1.0 },
        }
    }

    /// Reads the picture of the last frame, averaged with those before it, with what the filter took away from it
    /// and should not have.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn film(&self, gpu: &Gpu) -> Result<Film, GpuError> {
        Ok(match self.filtered(gpu).await? {
            Some(filtered) => filtered.picture(),
            None => self.read(gpu, self.pictures.before(self.frame)).await?.0,
        })
    }

    /// Reads the filtered picture with what the filter took away, if the plan keeps it.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn filtered(&self, gpu: &Gpu) -> Result<Option<FilteredFilm>, GpuError> {
        let [fine, coarse] = &self.filters[..] else { return Ok(None) };
        let (Some(fine), Some(coarse)) = (&fine.residual, &coarse.residual) else { return Ok(None) };
        let (film, _) = self.read(gpu, self.pictures.before(self.frame)).await?;
        let residual = async |buffer| self.read(gpu, buffer).await.map(|(mean, square)| Residual { mean, square });
        let (fine, coarse) = (residual(fine).await?, residual(coarse).await?);
        Ok(Some(FilteredFilm { film, fine, coarse, frames: self.still - self.first, side: self.grid.side }))
    }

    /// Reads the same frames filtered, unfiltered and filtered twice, if the plan measures the bias of the filter.
    ///
    /// # Errors
    /// [`GpuError`] if the device fails.
    pub async fn bias_films(&self, gpu: &Gpu) -> Result<Option<BiasFilms>, GpuError> {
        let (Some(bias), Some(filtered)) = (&self.bias, self.filtered(gpu).await?) else { return Ok(None) };
        let twice = self.read(gpu, bias.pictures.before(self.frame)).await?.0;
        let (unfiltered, left) = (filtered.unfiltered(), filtered.bias_left());
        Ok(Some(BiasFilms { side: self.grid.side, filtered: filtered.film, unfiltered, twice, left }))
    }

    /// Reads a buffer of an image: three values for each pixel, and a fourth one.
    async fn read(&self, gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<(Film, Vec<f32>), GpuError> {
        let [width, height] = self.grid.size;
        let values: Vec<[f32; 4]> = read_back_async(gpu, buffer, (width * height) as usize).await?;
        let pixels = values.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        Ok((Film { width, height, pixels }, values.into_iter().map(|[.., w]| w).collect()))
    }
}

/// Returns bindings of whole buffers.
fn bindings<'a, const N: usize>(buffers: [(&'a str, &'a wgpu::Buffer); N]) -> [Binding<'a>; N] {
    buffers.map(|(name, buffer)| (name, buffer.as_entire_binding()))
}
