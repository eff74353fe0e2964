//! The method on one page: what one iteration of raster BDPT does, in order.
//!
//! One light subpath y0 y1 y2 and one direction per bounce serve every pixel. Passes take their inputs as arguments; what the
//! plan skips has no pipeline, no buffer and no call here.

use std::f32::consts::TAU;

use crate::bundle_directions::BundleDirections;
use crate::gpu::Gpu;
use crate::gpu_scene::GpuScene;
use crate::iteration::describe;
use crate::layouts;
use crate::light_table::LightTable;
use crate::passes::accumulate::Accumulate;
use crate::passes::connect::Connect;
use crate::passes::depth_maps::DepthMaps;
use crate::passes::extend::Extend;
use crate::passes::eye_vertices::EyeVertices;
use crate::passes::gbuffer::GBuffer;
use crate::passes::light_point::LightPoint;
use crate::passes::light_subpath::LightSubpath;
use crate::passes::rsm::Rsm;
use crate::passes::view_lists::ViewLists;
use crate::passes::view_setup::ViewSetup;
use crate::pixels::PixelBuffers;
use crate::plan::{Connection, Extension, FramePlan};
use crate::sampler::{Decision, Sampler, uniform_sphere};
use crate::scene::Camera;
use crate::settings::Settings;
use crate::view::{ViewBuffers, parallel};

/// Pipelines and buffers of an iteration.
pub struct Frame {
    plan: FramePlan,
    view_setup: Option<ViewSetup>,
    view_lists: Option<ViewLists>,
    depth_maps: Option<DepthMaps>,
    light_point: Option<LightPoint>,
    rsm: Option<Rsm>,
    light_subpath: Option<LightSubpath>,
    gbuffer: GBuffer,
    eye_vertices: EyeVertices,
    connections: Vec<(Connection, wgpu::Buffer)>,
    connects: Vec<((u32, bool), Connect)>,
    extensions: Vec<(Extension, wgpu::Buffer)>,
    extends: Vec<(Extension, Extend)>,
    accumulate: Accumulate,
    /// Around the light vertices, then the bundles.
    views: Vec<ViewBuffers>,
    /// Of bundles, where they do not go everywhere alike.
    directions: Option<BundleDirections>,
    /// The light without extent that `views[0]` was made for.
    light_in_view: Option<u32>,
    pixels: PixelBuffers,
    empty_draw: wgpu::Buffer,
    light_vertices: wgpu::Buffer,
    demands: wgpu::Buffer,
    /// Sum and compensation per pixel.
    pub film: wgpu::Buffer,
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
        let size = [settings.width, settings.height];
        let surface = plan.surface_flags.clone();
        let bundles: &[&str] = if directions.is_some() { &["SKY_BUNDLES"] } else { &[] };
        let with = |more: &[&'static str]| [surface.as_slice(), bundles, more].concat();
        let visibility: &[&str] = match (plan.rays, plan.fast) {
            (true, _) => &["RAY_QUERY"],
            (false, true) => &["FAST"],
            (false, false) => &[],
        };

        let strategy = |allowed: [bool; 4], s, j| {
            let uniform = gpu.uniform::<layouts::Strategy>("strategy");
            let strategy = layouts::Strategy {
                allowed: allowed.map(|a| f32::from(u8::from(a))),
                s,
                j,
                clamp_distance: settings.paper_clamp * 2.0 * scene.sphere().1,
                ..Default::default()
            };
            gpu.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&strategy));
            uniform
        };
        let connections: Vec<_> = plan.connections.iter().map(|c| (*c, strategy(c.allowed, c.s, c.j))).collect();
        let extensions: Vec<_> = plan.extensions.iter().map(|e| (*e, strategy(e.allowed, 0, e.j))).collect();
        // What depends on the way from y0.
        let pattern: &[&str] = if plan.light_flags.contains(&"PATTERNS") { &["PATTERNS"] } else { &[] };
        let rsm: &[&str] = if plan.rsm { &["RSM"] } else { &[] };
        let mut connects: Vec<((u32, bool), Connect)> = Vec::new();
        for c in &plan.connections {
            if !connects.iter().any(|(key, _)| *key == (c.s, c.clamped)) {
                let from_y0 = if c.s == 1 { [rsm, pattern].concat() } else { Vec::new() };
                let flags = with(&[visibility, &from_y0].concat());
                connects.push(((c.s, c.clamped), Connect::new(gpu, &flags, c.s, c.clamped)));
            }
        }
        let mut extends: Vec<(Extension, Extend)> = Vec::new();
        for e in &plan.extensions {
            if !extends.iter().any(|(other, _)| other.same_code(e)) {
                let flags = with(&[if e.meets { plan.light_flags.as_slice() } else { &[] }, visibility].concat());
                extends.push((*e, Extend::new(gpu, &flags, e.last)));
            }
        }
        let limit = gpu.capabilities.max_binding_bytes.min(gpu.capabilities.max_buffer_bytes);
        let views: Vec<_> = plan
            .views()
            .iter()
            .enumerate()
            .map(|(n, &(resolution, faces))| {
                let room = plan.room(u64::from(scene.triangles), resolution, faces, limit);
                let records = if plan.rays { 0 } else { scene.triangles };
                ViewBuffers::new(gpu, records, resolution, faces, room, plan.answers(n))
            })
            .collect();
        let largest = views.iter().map(ViewBuffers::atlas).fold([1, 1], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
        let bundle_pdfs = directions.as_ref().map_or(&[][..], |d| &d.pdfs);
        let pixels = PixelBuffers::new(gpu, size, plan.glossy(), bundle_pdfs);
        let demands = gpu.storage("demands", (views.len().max(1) * size_of::<layouts::Demand>()) as u64);
        let frame = Self {
            view_setup: (!plan.rays).then(|| ViewSetup::new(gpu)),
            view_lists: (!plan.rays).then(|| ViewLists::new(gpu, plan.fast, largest)),
            depth_maps: plan.has_depth_maps().then(|| DepthMaps::new(gpu, &surface)),
            light_point: (plan.light_vertices > 0).then(|| LightPoint::new(gpu, &with(&plan.light_flags))),
            rsm: plan.rsm.then(|| Rsm::new(gpu, &with(&[visibility, pattern].concat()))),
            light_subpath: (plan.light_vertices > 1)
                .then(|| LightSubpath::new(gpu, &with(&[visibility, rsm, pattern].concat()))),
            gbuffer: GBuffer::new(gpu, &surface, size[0], size[1]),
            eye_vertices: EyeVertices::new(gpu, &with(if plan.camera_meets { &plan.light_flags } else { &[] })),
            connections,
            connects,
            extensions,
            extends,
            accumulate: Accumulate::new(gpu),
            directions,
            light_in_view: None,
            pixels,
            empty_draw: gpu.upload("empty draw", &[0_u32, 1, 0, 0]),
            light_vertices: gpu.storage("light_vertices", 2 * size_of::<layouts::LightVertex>() as u64),
            film: gpu.storage("film", u64::from(size[0]) * u64::from(size[1]) * 32),
            log: gpu.storage("log", 8 + 8 * views.len().max(1) as u64),
            demands,
            views,
            plan: plan.clone(),
        };
        frame.write_rooms(gpu);
        frame
    }

    /// Records and submits one iteration; `batch_index` names it in the log.
    pub fn iterate(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        camera: &Camera,
        lights: &LightTable,
        settings: &Settings,
        iteration: u64,
        batch_index: u32,
    ) {
        let sampler = Sampler::new(settings.seed, iteration);
        let light = lights.choose(sampler.get(Decision::Light));
        let uniform = describe(scene, camera, light.unwrap_or(0), settings, &sampler, iteration, batch_index);
        gpu.queue.write_buffer(&self.pixels.frame, 0, bytemuck::bytes_of(&uniform));
        let mut commands =
            gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("iteration") });
        let encoder = &mut commands;
        let light_vertices = self.plan.light_vertices as usize;

        // y0, and everything that it can see; kept while a light without extent stays the same.
        let rsm = self.rsm.as_ref().map(|pass| &pass.table);
        let started = self.light_point.as_ref().zip(light);
        if let Some((pass, light)) = started.filter(|(_, light)| self.light_in_view != Some(*light)) {
            let record = &lights.records[light as usize];
            self.views[0].looks(if record.is_infinite() { 1 } else { 6 });
            pass.record(gpu, encoder, scene, &self.pixels.frame, &self.views[0]);
            self.fill(gpu, encoder, scene, 0);
            if let Some(rsm) = self.rsm.as_ref().filter(|_| record.is_fixed()) {
                rsm.record(gpu, encoder, scene, &pass.y0, &self.views[0]);
            }
            self.light_in_view = record.is_fixed().then_some(light);
        }

        // y1, y2: VPLs, and everything that each can see (section 4.1).
        if let (Some(pass), Some((LightPoint { y0, .. }, _))) = (&self.light_subpath, started) {
            for vertex in 1..light_vertices {
                let (from, next) = (&self.views[vertex - 1], &self.views[vertex]);
                let vertices = &self.light_vertices;
                pass.record(gpu, encoder, scene, &self.pixels, y0, rsm, vertex as u32, from, vertices, next);
                self.fill(gpu, encoder, scene, vertex);
            }
        }

        // One ray-bundle per bounce (section 3.2), each in a direction of its own.
        for (n, view) in self.views.iter().enumerate().skip(light_vertices) {
            let n_bundle = (n - light_vertices) as u32;
            let numbers = sampler.get2(Decision::Bundle(n_bundle));
            let forward = self.directions.as_ref().map_or_else(|| uniform_sphere(numbers), |d| d.draw(numbers));
            let turn = TAU * sampler.get(Decision::Turn(n_bundle));
            let shift = self.plan.fast.then(|| sampler.get2(Decision::Shift(n_bundle)));
            view.look(gpu, &parallel(forward, scene.bounds, turn, shift, view.resolution));
            self.fill(gpu, encoder, scene, n);
        }

        // z1, and what the camera sees shining: (0, 2).
        self.gbuffer.record(gpu, encoder, scene, &self.pixels.frame);
        self.eye_vertices.record(gpu, encoder, scene, &self.pixels, &self.gbuffer.triangles);

        // z_j: joined to the light and its VPLs, (1, j + 1) to (3, j + 1), then extended along bundle j, (0, j + 2).
        for j in 1..=settings.bounces + 1 {
            for (connection, strategy) in self.connections.iter().filter(|(c, _)| c.j == j) {
                let pass = self.connects.iter().find(|(key, _)| *key == (connection.s, connection.clamped));
                let (Some((_, pass)), Some((LightPoint { y0, .. }, _))) = (pass, started) else { continue };
                let view = &self.views[connection.s as usize - 1];
                pass.record(gpu, encoder, scene, &self.pixels, strategy, view, y0, &self.light_vertices, rsm);
            }
            let Some((extension, strategy)) = self.extensions.get(j as usize - 1) else { continue };
            let Some((_, pass)) = self.extends.iter().find(|(other, _)| other.same_code(extension)) else { continue };
            let bundle = &self.views[light_vertices + j as usize - 1];
            pass.record(gpu, encoder, scene, &self.pixels, strategy, bundle);
        }

        // The film, unless a list ran out of room.
        for (n, view) in self.views.iter().enumerate() {
            let at = (n * size_of::<layouts::Demand>()) as u64;
            encoder.copy_buffer_to_buffer(&view.draw, 0, &self.demands, at, 4);
            encoder.copy_buffer_to_buffer(&view.node_count, 0, &self.demands, at + 4, 4);
        }
        self.accumulate.record(gpu, encoder, &self.pixels, &self.demands, &self.film, &self.log);
        gpu.queue.submit([commands.finish()]);
    }

    /// What answers for a view: set up once per triangle, then rasterized (DESIGN section 3, "Exact visibility"). Nothing where ray
    /// queries answer.
    fn fill(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, scene: &GpuScene, view: usize) {
        let view = &self.views[view];
        let (Some(setup), Some(lists)) = (&self.view_setup, &self.view_lists) else { return };
        view.reset(encoder, &self.empty_draw);
        setup.record(gpu, encoder, scene, view);
        match (&view.depth_map, &self.depth_maps) {
            (Some(map), Some(pass)) => pass.record(gpu, encoder, scene, view, map),
            _ => lists.record(gpu, encoder, view),
        }
    }

    /// Makes room where a batch wanted more; `needed` holds items and nodes per view.
    pub fn grow(&mut self, gpu: &Gpu, scene: &GpuScene, needed: &[[u32; 2]]) {
        for (n, (view, &[items, nodes])) in self.views.iter_mut().zip(needed).enumerate() {
            let (items, nodes) = (u64::from(items), u64::from(nodes));
            if items > view.item_room || nodes > view.node_room {
                let more = |wanted: u64, room: u64| if wanted > room { wanted + wanted / 2 } else { room };
                let room = [more(items, view.item_room), more(nodes, view.node_room)];
                let answers = self.plan.answers(n);
                *view = ViewBuffers::new(gpu, scene.triangles, view.resolution, view.faces, room, answers);
                self.light_in_view = None;
            }
        }
        self.write_rooms(gpu);
    }

    /// Bytes of all buffers and targets of the frame.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let pixels = u64::from(self.pixels.size[0]) * u64::from(self.pixels.size[1]);
        let buffers = self.pixels.bytes() + self.film.size();
        buffers + pixels * 8 + self.views.iter().map(ViewBuffers::bytes).sum::<u64>()
    }

    /// Largest number of nodes that any view has room for.
    #[must_use]
    pub fn node_room(&self) -> Vec<u64> {
        self.views.iter().map(|v| v.node_room).collect()
    }

    fn write_rooms(&self, gpu: &Gpu) {
        let rooms: Vec<_> = self
            .views
            .iter()
            .map(|v| layouts::Demand {
                item_room: v.item_room as u32,
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
