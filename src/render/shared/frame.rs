//! The method on one page: one iteration of bidirectional path tracing with shared subpaths, in order.
//!
//! One light subpath y0 y1 y2 and one direction per bounce serve every pixel, or, interleaved, every pixel of
//! a class. Passes that the plan skips have no pipeline, no buffer and no call. [`super::build`] builds the
//! passes, [`super::views`] holds the views, and [`super::growth`] redoes iterations whose lists overflowed.

use std::f32::consts::TAU;
use std::ops::Range;

use crate::gpu::Gpu;
use crate::render::denoise::Denoiser;
use crate::render::frame_uniform::frame_uniform;
use crate::render::layouts::{self, FrameUniform};
use crate::render::lights::bundle_directions::BundleDirections;
use crate::render::lights::table::LightTable;
use crate::render::recording::Recording;
use crate::render::sampler::{Decision, Sampler, uniform_sphere};
use crate::render::shared::build::Passes;
use crate::render::shared::film_buffer::{Band, PixelBuffers};
use crate::render::shared::passes::film::accumulate::AccumulateInputs;
use crate::render::shared::plan::FramePlan;
use crate::render::shared::plan::views::ViewRole;
use crate::render::shared::views::Views;
use crate::render::upload::gpu_scene::GpuScene;
use crate::render::visibility::view::parallel;
use crate::scene::Camera;
use crate::settings::Settings;

/// Passes and buffers of an iteration.
pub struct Frame {
    pub(super) plan: FramePlan,
    pub(super) passes: Passes,
    /// The views of the light subpath and of its bundles.
    pub views: Views,
    /// Bundle directions, if they are not uniform.
    pub(super) directions: Option<BundleDirections>,
    /// The light points of the current class: y0, then those of the other lights or candidates. Empty without
    /// lights.
    pub(super) light_points: Vec<layouts::LightStart>,
    /// The light that the reflective shadow map was made for.
    pub(super) rsm_of: Option<u32>,
    /// Eye vertices, image and film.
    pub pixels: PixelBuffers,
    /// Turns layers into pictures, if iterations are denoised.
    pub denoiser: Option<Denoiser>,
    /// y1 and y2 of the last iteration, of each class that is rendered together.
    pub light_vertices: wgpu::Buffer,
    /// The camera that the G-buffer was made for.
    pub(super) gbuffer_camera: Option<[[f32; 4]; 4]>,
    /// The uniform of the last iteration.
    pub(super) uniform: FrameUniform,
    /// Counts of values that are not finite, bits of skipped iterations, then the requests of each slot.
    pub log: wgpu::Buffer,
}

/// An iteration to record.
#[derive(Clone, Copy)]
pub struct Iteration<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene on the device.
    pub scene: &'a GpuScene,
    /// The camera.
    pub camera: &'a Camera,
    /// The lights.
    pub lights: &'a LightTable,
    /// The settings.
    pub settings: &'a Settings,
    /// Its number, from 0.
    pub number: u64,
    /// Its number in the batch's log. None for an iteration that only restores history and is not
    /// accumulated.
    pub batch_index: Option<u32>,
}

impl Frame {
    /// Records and submits one iteration.
    pub fn iterate(&mut self, iteration: &Iteration) {
        let &Iteration { gpu, scene, camera, settings, number, .. } = iteration;
        self.swap_history(gpu, number > 0);
        // All classes of pixels share the camera and the place within the pixel.
        let camera_number = number / self.plan.iterations_per_gbuffer(camera);
        let of_camera = Sampler::new(settings.seed, camera_number);
        let batch_index = iteration.batch_index.unwrap_or(0);
        let mut uniform = frame_uniform(scene, camera, settings, &of_camera, number, batch_index);
        uniform.camera_number = camera_number as u32;
        if let Some(denoiser) = &self.denoiser {
            uniform.samples = denoiser.samples() / settings.samples_per_lobe();
            // Along shared directions narrow lobes are wider, and the same light is noise.
            if self.plan.own_directions {
                uniform.sharp_alpha = denoiser.sharp_alpha(&uniform);
            }
        }
        uniform.splat_scale = iteration.lights.splat_scale(scene.sphere().1);
        self.trace_caustics(iteration, &uniform);
        for (group, classes) in self.plan.grid.groups().into_iter().enumerate() {
            self.trace_classes(iteration, group, classes, &uniform);
        }
        if self.plan.grid.scale > 1 {
            self.trace_clear_light(iteration, &uniform);
        }
        self.uniform = uniform;
    }

    /// Traces light paths of their own to what mirrors and glass light up, and connects them to the camera:
    /// strategies (s, 1).
    fn trace_caustics(&self, iteration: &Iteration, uniform: &FrameUniform) {
        let Some(pass) = &self.passes.caustics else { return };
        self.pixels.write_uniform(iteration.gpu, 0, uniform);
        let mut recording = Recording::new(iteration.gpu, iteration.scene, "caustics");
        pass.record(&mut recording, &self.pixels.first(0), self.plan.grid.size, &self.log);
        recording.submit();
    }

    /// Traces the light subpaths of a group of classes, one after the other, then the eye subpaths of the pixels that share
    /// them.
    fn trace_classes(&mut self, iteration: &Iteration, group: usize, classes: Range<u32>, uniform: &FrameUniform) {
        let mut recording = Recording::new(iteration.gpu, iteration.scene, "iteration");
        for (n, class) in classes.enumerate() {
            // Classes take turns with the inputs of the passes that make a light subpath.
            if n > 0 {
                recording.flush();
            }
            self.trace_shared_subpaths(&mut recording, iteration, class, uniform);
        }
        for band in self.pixels.bands(group) {
            self.trace_eye_subpaths(&mut recording, &band);
            if iteration.batch_index.is_some() {
                self.accumulate(&mut recording, &band);
            }
        }
        recording.submit();
    }

    /// Traces what the pixels of a class share.
    fn trace_shared_subpaths(
        &mut self,
        recording: &mut Recording,
        iteration: &Iteration,
        class: u32,
        uniform: &FrameUniform,
    ) {
        let sampler = Sampler::new(iteration.settings.seed, self.random_numbers_of(iteration.number, class));
        let uniform = FrameUniform {
            y1_random: sampler.get2(Decision::Y1),
            y2_random: sampler.get2(Decision::Y2),
            noise: sampler.bits(),
            number: self.number_of(iteration.number, class) as u32,
            ..*uniform
        };
        self.pixels.write_uniform(iteration.gpu, class as usize, &uniform);
        self.views.write_noise(iteration.gpu, uniform.noise);
        // y0 and the other light points, y1 and y2, each with the map of everything that it sees (section
        // 4.1).
        self.sample_light_points(recording, class, iteration.lights, &sampler);
        self.trace_light_subpath(recording, class);
        // One ray-bundle per bounce (section 3.2), unless pixels draw directions of their own.
        self.rasterize_bundles(recording, &sampler);
        // What each pixel sees, where its path begins.
        if class == 0 {
            self.rasterize_gbuffer(recording, uniform.clip_from_world);
        }
    }

    /// Rasterizes every triangle into a parallel view for each bounce.
    fn rasterize_bundles(&self, recording: &mut Recording, sampler: &Sampler) {
        for (n, view) in self.views.bundles() {
            let numbers = sampler.get2(Decision::Bundle(n));
            let forward = self.directions.as_ref().map_or_else(|| uniform_sphere(numbers), |d| d.draw(numbers));
            let turn = TAU * sampler.get(Decision::Turn(n));
            let shift = self.plan.fast.then(|| sampler.get2(Decision::Shift(n)));
            let resolution = view.buffers.texels.resolution;
            let bundle = parallel(forward, recording.scene.bounds, turn, shift, resolution);
            view.buffers.write_view(recording.gpu, &bundle);
            self.views.rasterize(recording, view.role);
        }
    }

    /// Finds the triangle that each pixel sees, and those beside it, unless that is already known.
    pub(super) fn rasterize_gbuffer(&mut self, recording: &mut Recording, camera: [[f32; 4]; 4]) {
        let Some(gbuffer) = &self.passes.gbuffer else { return };
        if self.gbuffer_camera.replace(camera) != Some(camera) {
            let first = self.pixels.first(0);
            gbuffer.record(recording, first.frame());
            if let Some(borders) = &self.passes.borders {
                borders.record(recording, first.frame(), &gbuffer.depth);
            }
        }
    }

    /// Traces z1, z2, ... of a band. Each z_j is connected with the light and its VPLs, (1, j + 1) to (3, j +
    /// 1), then extended along bundle j or a direction of its own, (0, j + 2).
    fn trace_eye_subpaths(&self, recording: &mut Recording, band: &Band) {
        self.begin_eye_subpaths(recording, band);
        if let Some(pass) = &self.passes.list_lengths {
            return pass.record(recording, band, self.views.get(ViewRole::Bundle(0)));
        }
        for j in 1..=self.plan.most_vertices {
            let connections = self.passes.connections.iter().filter(|c| c.connection.j == j);
            for pass in connections.filter(|c| !self.plan.is_apart(&c.connection)) {
                self.connect(recording, band, pass);
            }
            if let Some((strategy, pass)) = self.passes.extensions.get(j as usize - 1) {
                let bundle = (!self.plan.own_directions).then(|| self.views.get(ViewRole::Bundle(j - 1)));
                pass.record(recording, band, strategy.of(0), bundle, self.guides(band), self.passes.guide());
            }
        }
    }

    /// Computes z1, and adds the emission that the camera sees: (0, 2).
    pub(super) fn begin_eye_subpaths(&self, recording: &mut Recording, band: &Band) {
        let borders = self.passes.borders.as_ref().map(|borders| &borders.triangles);
        let gbuffer = self.passes.gbuffer.as_ref().map(|gbuffer| &gbuffer.triangles);
        let rasterized: Vec<_> = gbuffer.into_iter().chain(borders).collect();
        let seen = self.passes.seen_light.as_ref().map(|pass| &pass.seen);
        self.passes.eye_vertices.record(recording, band, &rasterized, self.guides(band), seen);
    }

    /// Returns the guides of a band, if frames are denoised.
    fn guides(&self, band: &Band) -> Option<&wgpu::Buffer> {
        self.denoiser.as_ref().map(|denoiser| denoiser.guides(band.region))
    }

    /// Adds the light that needs no filter to every pixel of an image that is finer than its layers.
    fn trace_clear_light(&self, iteration: &Iteration, uniform: &FrameUniform) {
        self.pixels.write_clear_uniform(iteration.gpu, uniform);
        let mut recording = Recording::new(iteration.gpu, iteration.scene, "clear light");
        for band in self.pixels.bands(self.pixels.clear()) {
            self.begin_eye_subpaths(&mut recording, &band);
            for pass in self.passes.connections.iter().filter(|c| self.plan.is_apart(&c.connection)) {
                self.connect(&mut recording, &band, pass);
            }
            self.accumulate(&mut recording, &band);
        }
        recording.submit();
    }

    /// Adds a band to the film or to the layers of the frame, unless a list overflowed.
    fn accumulate(&self, recording: &mut Recording, band: &Band) {
        let layers = self.denoiser.as_ref().map(|denoiser| denoiser.layers(band.region));
        let layers = layers.as_ref().map_or(&[][..], |layers| layers);
        let splats = self.passes.caustics.as_ref().map(|caustics| &caustics.splats);
        let inputs = AccumulateInputs { requests: &self.views.requests, log: &self.log, splats, layers };
        self.passes.accumulate.record(recording, band, &inputs);
    }

    /// Returns the index of the random numbers of a class. Classes rotate, so that each pixel uses all
    /// sequences over time.
    fn random_numbers_of(&self, iteration: u64, class: u32) -> u64 {
        let classes = u64::from(self.plan.grid.subpaths());
        let iteration = self.number_of(iteration, class);
        iteration * classes + (u64::from(class) + iteration) % classes
    }

    /// Returns the iteration whose random numbers a class takes: the last one for the class that repeats it.
    fn number_of(&self, iteration: u64, class: u32) -> u64 {
        let repeats = self.denoiser.as_ref().and_then(Denoiser::repeated) == Some(class);
        if repeats { iteration.saturating_sub(1) } else { iteration }
    }

    /// Denoises the last iteration's layers to a picture, if iterations are denoised.
    pub fn denoise(&mut self, gpu: &Gpu, scene: &GpuScene) {
        if let Some(denoiser) = &mut self.denoiser {
            denoiser.advance(gpu, scene, &self.uniform);
        }
    }
}
