//! The method on one page: what one iteration of raster BDPT does, in order.
//!
//! One light subpath y0 y1 y2 and one direction per bounce serve every pixel, or, interleaved, every pixel of a class; among many
//! lights, direct light comes from a pool of light points beside y0, or from two, with that of the iteration before. Passes take their
//! inputs as arguments; what the plan skips has no pipeline, no buffer and no call here.

use std::cell::Cell;
use std::f32::consts::TAU;

use crate::bundle_directions::BundleDirections;
use crate::gpu::{Gpu, GpuError};
use crate::gpu_scene::GpuScene;
use crate::iteration::describe;
use crate::layouts::{self, LightRecord};
use crate::light_table::LightTable;
use crate::live::Live;
use crate::passes::accumulate::Accumulate;
use crate::passes::connect::Connect;
use crate::passes::depth_maps::DepthMaps;
use crate::passes::extend::Extend;
use crate::passes::eye_vertices::EyeVertices;
use crate::passes::gbuffer::GBuffer;
use crate::passes::light_gifts::LightGifts;
use crate::passes::light_point::LightPoint;
use crate::passes::light_pool::LightPool;
use crate::passes::light_reuse::LightReuse;
use crate::passes::light_subpath::LightSubpath;
use crate::passes::list_lengths::ListLengths;
use crate::passes::rsm::Rsm;
use crate::passes::view_lists::ViewLists;
use crate::passes::view_setup::ViewSetup;
use crate::pixels::{Band, PixelBuffers};
use crate::plan::{Connection, Extension, FramePlan};
use crate::sampler::{Decision, Sampler, uniform_sphere};
use crate::scene::Camera;
use crate::settings::{RestirBias, Settings};
use crate::view::{Answers, ViewBuffers, ViewScratch, parallel, room_for};

/// Pipelines and buffers of an iteration.
pub struct Frame {
    plan: FramePlan,
    view_setup: Option<ViewSetup>,
    view_lists: Option<ViewLists>,
    depth_maps: Option<DepthMaps>,
    light_point: Option<LightPoint>,
    light_pool: Option<LightPool>,
    light_reuse: Option<LightReuse>,
    rsm: Option<Rsm>,
    light_subpath: Option<LightSubpath>,
    gbuffer: GBuffer,
    eye_vertices: EyeVertices,
    /// In order, each with its constants for every light point that it joins; those that the pool makes have no pass.
    connections: Vec<(Connection, Vec<wgpu::Buffer>, Option<Connect>)>,
    extensions: Vec<(wgpu::Buffer, Extend)>,
    list_lengths: Option<ListLengths>,
    accumulate: Accumulate,
    /// Around the light vertices, then the bundles, then around other light points ([`FramePlan::light_view`],
    /// [`FramePlan::pool_views`]).
    views: Vec<ViewBuffers>,
    /// Of bundles, where they do not go everywhere alike.
    directions: Option<BundleDirections>,
    /// Where the last light subpath started, then what else direct light was chosen from; nothing where nothing shines.
    starts: Vec<layouts::LightStart>,
    /// For each view, the light without extent that it was made for.
    lights_in_views: Vec<Option<u32>>,
    /// The one that the table of pass rsm was made for.
    light_in_table: Option<u32>,
    /// The film, and what an iteration keeps per pixel.
    pub pixels: PixelBuffers,
    /// Where pictures are filtered frame by frame.
    pub live: Option<Live>,
    scratch: Option<ViewScratch>,
    /// y1 and y2 of the last iteration.
    pub light_vertices: wgpu::Buffer,
    /// The look that the G-buffer holds.
    looked: Cell<Option<[[f32; 4]; 4]>>,
    /// What the last iteration's camera saw.
    seen: layouts::Frame,
    demands: wgpu::Buffer,
    /// Non-finite values, bits of skipped iterations, then items and nodes that each view wanted.
    pub log: wgpu::Buffer,
}

impl Frame {
    /// Builds what the plan asks for.
    #[must_use]
    pub fn new(
        gpu: &Gpu,
        scene: &GpuScene,
        plan: &FramePlan,
        settings: &Settings,
        directions: Option<BundleDirections>,
    ) -> Self {
        let size = plan.grid.size;
        let surface = plan.surface_flags.clone();
        let layered = plan.layer_flags();
        let bundles: &[&str] = if directions.is_some() { &["SKY_BUNDLES"] } else { &[] };
        let with = |more: &[&'static str]| [surface.as_slice(), bundles, layered, more].concat();
        let visibility: &[&str] = match (plan.rays, plan.fast) {
            (true, _) => &["RAY_QUERY"],
            (false, true) => &["FAST"],
            (false, false) => &[],
        };
        let afar: &[&str] = if plan.lit_from.afar && !plan.rays { &["AFAR"] } else { &[] };
        let along: &[&str] = if plan.rays { &[] } else { &["OUTLINES"] };

        let strategy = |samples: [u32; 4], s, j, clear: bool| {
            let uniform = gpu.uniform::<layouts::Strategy>("strategy");
            let strategy = layouts::Strategy {
                allowed: samples.map(|n| n as f32),
                s,
                j,
                clear: u32::from(clear),
                clamp_distance: settings.paper_clamp * 2.0 * scene.sphere().1,
            };
            gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&strategy));
            uniform
        };
        // What depends on the way from y0.
        let sent = plan.light_flags.iter().filter(|flag| matches!(**flag, "PUNCTUAL" | "PATTERNS"));
        let sent: &[&str] = &sent.copied().collect::<Vec<_>>();
        let rsm: &[&str] = if plan.rsm { &["RSM"] } else { &[] };
        let connect = |c: &Connection| {
            let from_y0 = if c.s == 1 { [rsm, sent, afar].concat() } else { Vec::new() };
            Connect::new(gpu, &with(&[visibility, &from_y0].concat()), c.s, c.clamped)
        };
        let pooled = |c: &Connection| plan.has_pool() && c.is_direct();
        let connections = plan.connections.iter();
        let connections = connections.map(|c| {
            let constants = (0..plan.points_joined(c)).map(|_| strategy(c.samples, c.s, c.j, plan.is_clear(c)));
            (*c, constants.collect(), (!pooled(c)).then(|| connect(c)))
        });
        let extend = |e: &Extension| {
            let flags = with(&[if e.meets { plan.light_flags.as_slice() } else { &[] }, visibility, along].concat());
            Extend::new(gpu, &flags, e.last)
        };
        let extensions = plan.extensions.iter().map(|e| (strategy(e.samples, 0, e.j, false), extend(e)));
        let limit = gpu.capabilities.max_storage_bytes;
        let views: Vec<_> = plan
            .views()
            .iter()
            .enumerate()
            .map(|(n, &texels)| {
                let room = plan.node_room(u64::from(scene.triangles), texels, limit);
                ViewBuffers::new(gpu, plan.outlines(n, u64::from(scene.triangles)), texels, room, plan.answers(n))
            })
            .collect();
        let bundle_pdfs = directions.as_ref().map_or(&[][..], |d| &d.pdfs);
        let pixels = PixelBuffers::new(gpu, &plan.grid, plan.glossy(), bundle_pdfs, plan.settles);
        let choices = plan.grid.largest() * layouts::Choice::bytes(plan.is_live() && plan.glossy(), plan.reuses());
        let reuse: &[&str] = if plan.reuses() { &["REUSE"] } else { &[] };
        // One for each time that a view is filled.
        let fills = plan.pool_view().map_or(views.len(), |first| first + plan.light_pool as usize - 1).max(1);
        let demands = gpu.storage("demands", (fills * size_of::<layouts::Demand>()) as u64);
        let met: &[_] = if plan.camera_meets { &plan.light_flags } else { &[] };
        let rasterized = !plan.rays && !views.is_empty();
        let frame = Self {
            view_setup: rasterized.then(|| ViewSetup::new(gpu, plan.fast)),
            view_lists: rasterized.then(|| ViewLists::new(gpu, plan.fast)),
            depth_maps: plan.has_depth_maps().then(|| DepthMaps::new(gpu, &surface)),
            light_point: (plan.light_vertices > 0).then(|| {
                LightPoint::new(
                    gpu,
                    &with(&plan.light_flags),
                    plan.light_points(),
                    plan.light_resolution,
                    plan.direct_lights > 1,
                )
            }),
            light_pool: plan.has_pool().then(|| {
                let (choosing, testing) = (with(&[sent, reuse].concat()), with(&[visibility, afar, reuse].concat()));
                LightPool::new(gpu, &choosing, &testing, plan.pool_views().len() as u32, choices)
            }),
            light_reuse: plan.reuse.filter(|_| plan.reuses()).map(|bias| {
                let (points, pixels) = (plan.light_pool, u64::from(size[0]) * u64::from(size[1]));
                LightReuse::new(
                    gpu,
                    &with(sent),
                    &with(&[visibility, afar].concat()),
                    points,
                    pixels,
                    bias == RestirBias::Biased,
                )
            }),
            rsm: plan.rsm.then(|| Rsm::new(gpu, &with(&[visibility, sent].concat()))),
            light_subpath: (plan.light_vertices > 1)
                .then(|| LightSubpath::new(gpu, &with(&[visibility, rsm, sent].concat()))),
            gbuffer: GBuffer::new(gpu, &surface, size[0], size[1]),
            eye_vertices: EyeVertices::new(gpu, &with(&[met, plan.settle_flags()].concat())),
            connections: connections.collect(),
            extensions: extensions.collect(),
            list_lengths: plan.list_lengths.then(|| ListLengths::new(gpu, &with(&[visibility, along].concat()))),
            accumulate: Accumulate::new(gpu, &[layered, plan.settle_flags()].concat()),
            live: plan.is_live().then(|| Live::new(gpu, plan, settings.clamp_samples)),
            directions,
            starts: Vec::new(),
            lights_in_views: vec![None; views.len()],
            light_in_table: None,
            looked: Cell::new(None),
            seen: layouts::Frame::default(),
            pixels,
            scratch: rasterized.then(|| {
                let triangles = u64::from(scene.triangles);
                ViewScratch::new(gpu, plan.item_room(triangles, limit), plan.scratch_words(triangles, limit))
            }),
            light_vertices: gpu.storage("light_vertices", 2 * size_of::<layouts::LightVertex>() as u64),
            log: gpu.storage("log", 8 + 8 * fills as u64),
            demands,
            views,
            plan: plan.clone(),
        };
        frame.write_rooms(gpu);
        frame
    }

    /// Makes what the light and the camera see anew: something has moved.
    pub fn forget_looks(&mut self) {
        self.forget_lights();
        self.looked.set(None);
    }

    fn forget_lights(&mut self) {
        self.lights_in_views.fill(None);
        self.light_in_table = None;
    }

    /// What each light would give the picture, in any unit, if nothing stood between.
    ///
    /// # Errors
    /// [`GpuError`] where the device fails.
    pub fn light_gifts(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        camera: &Camera,
        lights: &LightTable,
        settings: &Settings,
    ) -> Result<Vec<f32>, GpuError> {
        let flags = [self.plan.surface_flags.as_slice(), &self.plan.light_flags, self.plan.layer_flags()].concat();
        let pass = LightGifts::new(gpu, &flags, lights.count());
        let uniform = describe(scene, camera, settings, &Sampler::new(settings.seed, 0), 0, 0);
        self.pixels.describe(gpu, 0, &uniform);
        let strategy = gpu.uniform::<layouts::Strategy>("strategy");
        let alone = layouts::Strategy { allowed: [0.0, 1.0, 0.0, 0.0], s: 1, j: 1, ..Default::default() };
        gpu.queue.write_buffer(&strategy, 0, bytemuck::bytes_of(&alone));
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        self.gbuffer.record(gpu, &mut encoder, scene, self.pixels.first(0).frame);
        self.looked.set(Some(uniform.clip_from_world));
        for band in self.pixels.bands(0) {
            self.meet(gpu, &mut encoder, scene, &band);
            pass.record(gpu, &mut encoder, scene, &band, &strategy);
        }
        gpu.queue.submit([encoder.finish()]);
        pass.read(gpu)
    }

    /// Records and submits one iteration; `batch_index` names it in the log. Without one it is made only for what the next looks back at.
    pub fn iterate(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        camera: &Camera,
        lights: &LightTable,
        settings: &Settings,
        iteration: u64,
        batch_index: Option<u32>,
    ) {
        self.turn(gpu, iteration > 0);
        // What the camera sees of the scene is the same for all classes of pixels.
        let look = Sampler::new(settings.seed, iteration / self.plan.iterations_a_look(camera));
        let seen = describe(scene, camera, settings, &look, iteration, batch_index.unwrap_or(0));
        let samples = self.live.as_ref().map_or(seen.samples, |live| live.samples() / settings.clamp_samples);
        let seen = layouts::Frame { samples, ..seen };
        for class in 0..self.plan.grid.subpaths() {
            let sampler = Sampler::new(settings.seed, self.number(iteration, class));
            let uniform = with_numbers(&seen, &sampler);
            self.pixels.describe(gpu, class as usize, &uniform);
            self.subpath(gpu, scene, lights, &sampler, class as usize, uniform.clip_from_world, batch_index.is_some());
        }
        if self.plan.grid.scale > 1 {
            self.clear_light(gpu, scene, &seen);
        }
        self.seen = seen;
    }

    /// Begins an iteration that looks back at the one before it, if there is any: the views and light points of its pool are kept.
    fn turn(&mut self, gpu: &Gpu, has_past: bool) {
        let (Some(reuse), Some(light_point)) = (&mut self.light_reuse, &mut self.light_point) else { return };
        reuse.turn(gpu, has_past, &mut light_point.points);
        let views = self.plan.pool_views();
        let (now, past) = views.split_at(views.len() / 2);
        now.iter().zip(past).for_each(|(&now, &past)| self.views.swap(now, past));
        self.forget_lights();
    }

    /// Makes a picture of what the last iteration brought, where pictures are filtered frame by frame.
    pub fn advance(&mut self, gpu: &Gpu, scene: &GpuScene) {
        if let Some(live) = &mut self.live {
            live.advance(gpu, scene, &self.seen);
        }
    }

    /// Which random numbers a class of pixels has. A class takes turns with the others, so that each finds all of them in the end.
    fn number(&self, iteration: u64, class: u32) -> u64 {
        let classes = u64::from(self.plan.grid.subpaths());
        let again = self.live.as_ref().and_then(Live::repeated) == Some(class);
        let iteration = if again { iteration.saturating_sub(1) } else { iteration };
        iteration * classes + (u64::from(class) + iteration) % classes
    }

    /// Records and submits a light subpath, the bundles beside it, and the eye subpaths of a class of pixels, which these serve.
    /// `look`: where the camera looks from and at; `counts`: whether what they bring is kept.
    fn subpath(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        lights: &LightTable,
        sampler: &Sampler,
        class: usize,
        look: [[f32; 4]; 4],
        counts: bool,
    ) {
        let mut commands =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("iteration") });
        let encoder = &mut commands;
        let light_vertices = self.plan.light_vertices as usize;

        // y0 and the other light points; what each can see, kept while a light without extent stays the same.
        self.starts = light_starts(lights, sampler, &self.plan);
        let started = self.light_point.as_ref().filter(|_| !self.starts.is_empty());
        let rsm = self.rsm.as_ref().map(|pass| &pass.table);
        let mut y0_view = 0;
        if let Some(pass) = started {
            let y0 = self.starts[0].light;
            if self.starts.len() > 1 || self.lights_in_views[0] != Some(y0) {
                pass.record(gpu, encoder, scene, &self.starts);
            }
            let with_view = if self.plan.direct_lights > 0 { &self.starts[..] } else { &self.starts[..1] };
            for (n, &layouts::LightStart { light, .. }) in with_view.iter().enumerate() {
                let (view, record) = (self.plan.light_view(light), &lights.records[light as usize]);
                if self.lights_in_views[view] != Some(light) {
                    pass.look(encoder, n as u32, &self.views[view]);
                    self.fill(gpu, encoder, scene, view, view);
                    self.lights_in_views[view] = record.is_fixed().then_some(light);
                }
            }
            y0_view = self.plan.light_view(y0);
            let is_fixed = lights.records[y0 as usize].is_fixed();
            if let Some(rsm) = self.rsm.as_ref().filter(|_| is_fixed && self.light_in_table != Some(y0)) {
                rsm.record(gpu, encoder, scene, &pass.points, &self.views[y0_view]);
                self.light_in_table = Some(y0);
            }
            if self.plan.direct_lights > 0 {
                self.count_lights(gpu, lights);
            }
            if self.light_reuse.is_some() {
                (1..self.starts.len()).for_each(|n| self.look_around(gpu, encoder, scene, pass, n));
            }
        }

        // y1, y2: VPLs, and everything that each can see (section 4.1).
        if let (Some(pass), Some(LightPoint { points, .. })) = (&self.light_subpath, started) {
            for vertex in 1..light_vertices {
                let from = &self.views[if vertex == 1 { y0_view } else { vertex - 1 }];
                let next = &self.views[vertex];
                let vertices = &self.light_vertices;
                pass.record(
                    gpu,
                    encoder,
                    scene,
                    &self.pixels.first(class),
                    points,
                    rsm,
                    vertex as u32,
                    from,
                    vertices,
                    next,
                );
                self.fill(gpu, encoder, scene, vertex, vertex);
            }
        }

        // One ray-bundle per bounce (section 3.2), each in a direction of its own.
        for (n, view) in self.views.iter().enumerate().skip(light_vertices).take(self.plan.bundles()) {
            let n_bundle = (n - light_vertices) as u32;
            let numbers = sampler.get2(Decision::Bundle(n_bundle));
            let forward = self.directions.as_ref().map_or_else(|| uniform_sphere(numbers), |d| d.draw(numbers));
            let turn = TAU * sampler.get(Decision::Turn(n_bundle));
            let shift = self.plan.fast.then(|| sampler.get2(Decision::Shift(n_bundle)));
            view.look(gpu, &parallel(forward, scene.bounds, turn, shift, view.texels.resolution));
            self.fill(gpu, encoder, scene, n, n);
        }

        // What each pixel sees; then its paths, band by band.
        if class == 0 && self.looked.replace(Some(look)) != Some(look) {
            self.gbuffer.record(gpu, encoder, scene, self.pixels.first(0).frame);
        }
        for band in self.pixels.bands(class) {
            self.follow(gpu, encoder, scene, &band, started);
            if counts {
                self.keep(gpu, encoder, &band);
            }
        }
        gpu.queue.submit([commands.finish()]);
    }

    /// Light that needs no filter, for every pixel of an image that is finer than its layers.
    fn clear_light(&self, gpu: &Gpu, scene: &GpuScene, seen: &layouts::Frame) {
        let class = self.plan.grid.subpaths() as usize;
        self.pixels.describe(gpu, class, seen);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let started = self.light_point.as_ref().filter(|_| !self.starts.is_empty());
        for band in self.pixels.bands(class) {
            self.meet(gpu, &mut encoder, scene, &band);
            for (connection, strategies, pass) in self.connections.iter().filter(|(c, ..)| self.plan.is_apart(c)) {
                self.join(gpu, &mut encoder, scene, &band, (connection, strategies, pass.as_ref()), started);
            }
            self.keep(gpu, &mut encoder, &band);
        }
        gpu.queue.submit([encoder.finish()]);
    }

    /// z1, and what the camera sees shining: (0, 2).
    fn meet(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, scene: &GpuScene, band: &Band) {
        let guides = self.live.as_ref().map(|live| live.guides(band.region));
        self.eye_vertices.record(gpu, encoder, scene, band, &self.gbuffer.triangles, guides);
    }

    /// Where each light has a point in every iteration, direct light counts in MIS as often as that light would have to be chosen for that.
    fn count_lights(&self, gpu: &Gpu, lights: &LightTable) {
        let write = |strategy: &wgpu::Buffer, samples: [u32; 4], light: &LightRecord| {
            let at = std::mem::offset_of!(layouts::Strategy, allowed) + size_of::<f32>();
            let count = samples[1] as f32 / light.probability;
            gpu.queue.write_buffer(strategy, at as u64, bytemuck::bytes_of(&count));
        };
        for (connection, strategies, _) in self.connections.iter().filter(|(c, ..)| c.is_direct()) {
            let of_lights = strategies.iter().zip(&lights.records);
            of_lights.for_each(|(strategy, light)| write(strategy, connection.samples, light));
        }
        // All that can be met there is the sky.
        if let (Some((strategy, _)), Some(sky)) = (self.extensions.first(), lights.sky()) {
            write(strategy, self.plan.extensions[0].samples, sky);
        }
    }

    /// z_j joined to a vertex of the light subpath, or to the point of each light.
    fn join(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        (connection, strategies, pass): (&Connection, &[wgpu::Buffer], Option<&Connect>),
        started: Option<&LightPoint>,
    ) {
        let (Some(pass), Some(light_point)) = (pass, started) else { return };
        let rsm = self.rsm.as_ref().map(|pass| &pass.table);
        for (n, start) in self.starts.iter().enumerate().take(strategies.len()) {
            let view = if connection.s == 1 { self.plan.light_view(start.light) } else { connection.s as usize - 1 };
            let (view, point) = (&self.views[view], light_point.point(encoder, n));
            let strategy = if strategies.len() > 1 { &strategies[start.light as usize] } else { &strategies[0] };
            pass.record(gpu, encoder, scene, band, strategy, view, point, &self.light_vertices, rsm);
        }
    }

    /// The film or the frame's layers, unless a list ran out of room.
    fn keep(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, band: &Band) {
        let layers = self.live.as_ref().map(|live| live.layers(band.region));
        let layers = layers.as_ref().map_or(&[][..], |layers| layers);
        self.accumulate.record(gpu, encoder, band, &self.demands, &self.log, layers);
    }

    /// The eye subpaths of a band, joined to the light subpath, which has `started` where there are lights.
    fn follow(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        started: Option<&LightPoint>,
    ) {
        self.meet(gpu, encoder, scene, band);
        if let Some(pass) = &self.list_lengths {
            return pass.record(gpu, encoder, scene, band, &self.views[0]);
        }

        // z_j: joined to the light and its VPLs, (1, j + 1) to (3, j + 1), then extended along bundle j, (0, j + 2).
        for j in 1..=self.plan.bounces + 1 {
            let connections = self.connections.iter().filter(|(c, ..)| c.j == j && !self.plan.is_apart(c));
            for (connection, strategies, pass) in connections {
                match (pass, &self.light_pool, started) {
                    (None, Some(pool), Some(light_point)) => {
                        self.shine(gpu, encoder, scene, band, light_point, pool, &strategies[0]);
                    }
                    _ => self.join(gpu, encoder, scene, band, (connection, strategies, pass.as_ref()), started),
                }
            }
            let Some((strategy, pass)) = self.extensions.get(j as usize - 1) else { continue };
            let bundle = &self.views[self.plan.light_vertices as usize + j as usize - 1];
            pass.record(gpu, encoder, scene, band, strategy, bundle);
        }
    }

    /// What the n-th light point of the pool, which is not y0, can see.
    fn look_around(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        light_point: &LightPoint,
        n: usize,
    ) {
        let (views, Some(first)) = (self.plan.pool_views(), self.plan.pool_view()) else { return };
        light_point.look(encoder, n as u32, &self.views[views[n]]);
        self.fill(gpu, encoder, scene, views[n], first + n - 1);
    }

    /// Direct light from the pool: what each light point can see, one after the other. With reuse that is known already, and what each
    /// pixel keeps competes with what was kept of the last pool.
    fn shine(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        scene: &GpuScene,
        band: &Band,
        light_point: &LightPoint,
        pool: &LightPool,
        strategy: &wgpu::Buffer,
    ) {
        let (views, reuse) = (self.plan.pool_views(), self.light_reuse.as_ref());
        let sites = reuse.map(|reuse| &reuse.sites);
        pool.choose(gpu, encoder, scene, band, strategy, &light_point.points, sites);
        for (n, &view) in views.iter().enumerate().take(self.starts.len()) {
            if n > 0 && reuse.is_none() {
                self.look_around(gpu, encoder, scene, light_point, n);
            }
            pool.test(gpu, encoder, scene, band, n, &self.views[view], sites);
        }
        let Some(reuse) = reuse else { return };
        reuse.choose(gpu, encoder, scene, band, strategy, &light_point.points, &pool.choices);
        for (index, &view) in pool.indices.iter().zip(&views) {
            reuse.test(gpu, encoder, scene, band, index, &self.views[view], &pool.choices);
        }
    }

    /// What answers for a view: set up once per triangle, then rasterized (DESIGN section 3, "Exact visibility"). Nothing where ray
    /// queries answer. What it wanted is the `demand`-th.
    fn fill(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, scene: &GpuScene, view: usize, demand: usize) {
        let view = &self.views[view];
        let (Some(setup), Some(lists), Some(scratch)) = (&self.view_setup, &self.view_lists, &self.scratch) else {
            return;
        };
        view.reset(encoder, scratch);
        setup.record(gpu, encoder, scene, view, scratch);
        lists.record(gpu, encoder, scene, view, scratch);
        if let Some(map) = self.depth_maps.as_ref().filter(|_| view.answers == Answers::DepthMap) {
            map.record(gpu, encoder, scene, view, scratch);
        }
        let at = (demand * size_of::<layouts::Demand>()) as u64;
        encoder.copy_buffer_to_buffer(&scratch.tally, 0, &self.demands, at, 4 * ViewScratch::WANTED);
    }

    /// Times that views are filled in an iteration, at least 1: demands that the log holds.
    #[must_use]
    pub fn fills(&self) -> usize {
        (self.demands.size() / size_of::<layouts::Demand>() as u64) as usize
    }

    /// What each view wanted at most, of what each fill wanted.
    #[must_use]
    pub fn of_views(&self, fills: &[[u32; 2]]) -> Vec<[u32; 2]> {
        let Some(first) = self.plan.pool_view() else { return fills[..self.views.len()].to_vec() };
        let (own, pool) = fills.split_at(first);
        // With reuse, y0's view takes turns with one that was of the last iteration.
        let pool = pool.iter().chain(own.first().filter(|_| self.plan.reuses()));
        let most = pool.fold([0; 2], |most, wanted| [0, 1].map(|i| most[i].max(wanted[i])));
        let mut views = own.to_vec();
        views.resize(self.views.len(), most);
        if self.plan.reuses() {
            views[0] = most;
        }
        views
    }

    /// Makes room where a batch wanted more; `needed` holds items and nodes per view.
    pub fn grow(&mut self, gpu: &Gpu, scene: &GpuScene, needed: &[[u32; 2]]) {
        let Some(scratch) = &mut self.scratch else { return };
        let (mut item_room, mut list_words) = (scratch.item_room, scratch.list_words);
        let mut grown = false;
        for (n, (view, &[items, nodes])) in self.views.iter_mut().zip(needed).enumerate() {
            let (items, nodes) = (u64::from(items), u64::from(nodes));
            if items > item_room {
                item_room = room_for(items);
            }
            if nodes <= view.node_room {
                continue;
            }
            grown = true;
            if view.answers == Answers::DepthMap {
                view.node_room = room_for(nodes);
                list_words = list_words.max(self.plan.list_words(view.texels, view.node_room));
            } else {
                let outlines = self.plan.outlines(n, u64::from(scene.triangles));
                *view = ViewBuffers::new(gpu, outlines, view.texels, room_for(nodes), view.answers);
            }
        }
        if [item_room, list_words] != [scratch.item_room, scratch.list_words] {
            *scratch = ViewScratch::new(gpu, item_room, list_words);
            grown = true;
        }
        if grown {
            self.forget_lights();
        }
        self.write_rooms(gpu);
    }

    /// Bytes of all buffers and targets of the frame.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let views: u64 = self.views.iter().map(ViewBuffers::bytes).sum();
        let pool = self.light_pool.as_ref().map_or(0, LightPool::bytes);
        let reuse = self.light_reuse.as_ref().map_or(0, LightReuse::bytes);
        let live = self.live.as_ref().map_or(0, Live::bytes);
        self.pixels.bytes()
            + live
            + self.gbuffer.bytes()
            + self.scratch.as_ref().map_or(0, ViewScratch::bytes)
            + views
            + pool
            + reuse
    }

    /// Largest number of nodes that any view has room for.
    #[must_use]
    pub fn node_room(&self) -> Vec<u64> {
        self.views.iter().map(|v| v.node_room).collect()
    }

    fn write_rooms(&self, gpu: &Gpu) {
        // The last view is the one that is filled several times, where there is one; those of a pool are alike.
        let rooms: Vec<_> = (0..self.fills())
            .filter_map(|n| self.views.get(n).or(self.views.last()))
            .map(|v| layouts::Demand {
                item_room: self.scratch.as_ref().map_or(0, |scratch| scratch.item_room) as u32,
                node_room: v.node_room as u32,
                ..Default::default()
            })
            .collect();
        if !rooms.is_empty() {
            gpu.queue.write_buffer(&self.demands, 0, bytemuck::cast_slice(&rooms));
        } else {
            gpu.queue.write_buffer(&self.demands, 0, bytemuck::bytes_of(&layouts::Demand::default()));
        }
    }
}

/// The uniform of a class of pixels: random numbers of its own.
fn with_numbers(seen: &layouts::Frame, sampler: &Sampler) -> layouts::Frame {
    layouts::Frame {
        y1_random: sampler.get2(Decision::Y1),
        y2_random: sampler.get2(Decision::Y2),
        noise: sampler.bits(),
        ..*seen
    }
}

/// Where the iteration's light points lie; nowhere if nothing shines. y0's light is chosen; of the others each has one, or, in a pool,
/// they are chosen at even steps from there.
fn light_starts(lights: &LightTable, sampler: &Sampler, plan: &FramePlan) -> Vec<layouts::LightStart> {
    let first = sampler.get(Decision::Light);
    let start =
        |n: u32, light: u32| layouts::LightStart { light, random: sampler.get2(Decision::LightPoint(n)), pad: 0 };
    let chosen = |n: u32| lights.choose((first + n as f32 / plan.light_pool as f32).fract());
    let pool = (0..plan.light_pool).filter_map(|n| Some(start(n, chosen(n)?)));
    if plan.direct_lights == 0 {
        return pool.collect();
    }
    // What they give is summed, so they may share their numbers.
    let shine = |&light: &u32| lights.records[light as usize].probability > 0.0;
    let others = (0..lights.count()).filter(|&light| Some(light) != chosen(0)).filter(shine);
    pool.chain(others.map(|light| start(0, light))).collect()
}
