//! The render of a single picture, from its renderer to its files.

use std::cell::{OnceCell, RefCell};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};

use super::RenderArgs;
use super::clock::Stopwatch;
use super::frames::{Frame, numbered};
use super::progressive::{Keeper, ProgressiveRender};
use super::stats::{Ending, Seconds, Stats, device_name, two_digits};
use crate::cli::aov::SplitLight;
use crate::cli::checkpoint::{self, Saved};
use crate::cli::interrupt::Interrupt;
use crate::cli::light_groups::{self, GroupFilm};
use crate::cli::output;
use crate::cli::preview::Preview;
use crate::cli::progress::Reporter;
use crate::cli::reference_renderer::ReferenceRenderer;
use crate::exposure::{Backdrop, Exposure, auto_exposure};
use crate::film::exr::{Picture, Window};
use crate::film::filtered::FilteredFilm;
use crate::film::record::{Record, SampleRange};
use crate::film::{Film, has_extension};
use crate::gpu::Gpu;
use crate::reference::aov::Aovs;
use crate::render::convergence::Convergence;
use crate::render::fingerprint;
use crate::render::{self, RenderError, RenderStats, Renderer};
use crate::scene::Scene;
use crate::settings::{DEFAULT_BUDGET, DEFAULT_TARGET_ERROR, OnlyStrategy, Settings};
use crate::tonemap::Grade;

/// Render of a single picture.
pub(super) struct Job<'a> {
    pub(super) args: &'a RenderArgs,
    pub(super) interrupt: &'a Interrupt,
    /// Exposure and tone curve of .png files. With `--frames` all frames use the exposure of the first one.
    pub(super) grade: &'a OnceCell<Grade>,
    pub(super) preview: &'a RefCell<Option<Preview>>,
    /// Seconds that loading took.
    pub(super) load: f64,
    /// Start of the setup.
    pub(super) began: Instant,
    pub(super) scene: &'a Scene,
    /// The scene in the frame before, if there is one.
    pub(super) before: Option<&'a Scene>,
    pub(super) settings: &'a Settings,
    pub(super) animations: &'a [String],
    /// Frame of the animation, with `--frames`.
    pub(super) frame: Option<Frame>,
    /// Number of frames.
    pub(super) all: usize,
    pub(super) kept: &'a Kept,
}

/// What a picture has made that outlives a lost device.
#[derive(Default)]
pub(super) struct Kept {
    /// The render as it was last saved, from which it goes on.
    pub(super) saved: RefCell<Option<Saved>>,
    scene_hash: OnceCell<String>,
    aovs: OnceCell<Option<Aovs>>,
    light: RefCell<Option<SplitLight>>,
    /// The filtered picture, and what the filter took away, of a picture that may be merged with others.
    filtered: RefCell<Option<FilteredFilm>>,
    groups: RefCell<Vec<GroupFilm>>,
}

/// The renderers of the pictures of an animation.
#[derive(Default)]
pub(super) struct Renderers<'gpu> {
    picture: Option<Box<dyn Renderer + 'gpu>>,
    /// Renders light that is scattered at most once, if layers need it.
    light: Option<Box<dyn Renderer + 'gpu>>,
}

impl Job<'_> {
    /// Renders and writes the picture; without a device, by the reference. The renderers are reused from frame to
    /// frame.
    pub(super) fn run<'gpu>(&self, gpu: Option<&'gpu Gpu>, renderers: &mut Renderers<'gpu>) -> Result<Picture> {
        light_groups::check(self.scene, &self.args.layers.light_groups)?;
        let Some(gpu) = gpu else { return self.reference() };
        let reporter = self.reporter();
        gpu.compilation.tell(reporter.on_compilation());
        let stopwatch = Stopwatch::from(self.began, Some(gpu));
        let renderer = self.posed(gpu, &mut renderers.picture, self.settings)?;
        if self.frame.is_some() && self.args.layers.renders_light() && renderer.is_denoised() {
            bail!("layers of light: filtered frames hold a part of those before; give --interleave 1");
        }
        let (film, stats, reporter) = self.progressive(Some(gpu), renderer.as_mut(), stopwatch, reporter)?;
        let (requests, plan) = (renderer.stats().requests, Some(renderer.plan_json()));
        let stats = Stats { requests, plan, ..stats };
        if self.args.sample_range.is_some() || stats.ended_by == Ending::Interrupt {
            *self.kept.filtered.borrow_mut() = renderer.filtered_film()?;
        }
        let (samples, end) = (stats.samples, renderer.samples());
        let range = end - samples..end;
        if self.args.layers.splits_light() {
            let settings = renderer.aligned(SplitLight::settings(self.settings));
            let light = self.posed(gpu, &mut renderers.light, &settings)?;
            self.split_light(&range, light.as_mut())?;
        }
        let settings = renderer.aligned(Settings { target_error: None, budget: None, ..self.settings.clone() });
        self.light_groups(&|scene| {
            let mut renderer = render::open(gpu, scene, &settings)?;
            Ok(self.render_samples(&range, renderer.as_mut())?)
        })?;
        let picture = self.finish(&film, stats, reporter)?;
        self.strategy_images(&mut |only| {
            renderer.set_only(Some(only))?;
            renderer.render(samples, &mut |_| !self.interrupt.requested())?;
            renderer.film()
        })?;
        Ok(picture)
    }

    /// Keeps the files of the picture if they are complete, and takes the exposure over. False if they are not.
    pub(super) fn skip(&self) -> bool {
        let files = self.files();
        let stats = self.args.stats.iter().map(|path| self.named(path));
        if !files.iter().cloned().chain(stats).all(|path| path.exists()) {
            return false;
        }
        let picture = files.iter().find(|path| has_extension(path, "exr")).and_then(|path| Picture::load(path).ok());
        let Some(picture) = picture.filter(|picture| self.is_complete(picture)) else { return false };
        self.grade.get_or_init(|| self.grade_of(&picture.film));
        if !self.args.quiet {
            eprintln!("{}: complete, and kept", shown_paths(&files));
        }
        self.reporter().end("existing", picture.record.map_or(0, |record| record.samples), 0.0);
        true
    }

    /// True if a picture is the one that this render would write.
    fn is_complete(&self, picture: &Picture) -> bool {
        let Some(record) = &picture.record else { return false };
        let all = u64::from(self.settings.samples);
        let range = self.args.sample_range.unwrap_or(SampleRange { first: 1, last: all });
        record.version == env!("CARGO_PKG_VERSION")
            && record.ranges == [range]
            && fingerprint::is_text_of(&record.settings, self.settings)
            && self.args.layers.are_in(picture)
            && record.scene_hash == self.scene_hash()
    }

    /// Returns the renderer of another frame in this pose, or opens one.
    fn posed<'r, 'gpu>(
        &self,
        gpu: &'gpu Gpu,
        renderer: &'r mut Option<Box<dyn Renderer + 'gpu>>,
        settings: &Settings,
    ) -> Result<&'r mut Box<dyn Renderer + 'gpu>, RenderError> {
        if let Some(renderer) = renderer {
            renderer.pose(self.scene)?;
        }
        match renderer {
            Some(renderer) => Ok(renderer),
            None => Ok(renderer.insert(render::open(gpu, self.scene, settings)?)),
        }
    }

    /// Renders the parts of the light with the samples of the picture, which are numbered from 0. A signal leaves them
    /// out.
    fn split_light(&self, samples: &Range<u64>, renderer: &mut dyn Renderer) -> Result<(), RenderError> {
        let bar = self.reporter();
        bar.count("direct light", 0, 1);
        let light = SplitLight::new(self.settings.technique, &mut |only| {
            renderer.set_only(only)?;
            self.render_samples(samples, renderer)
        })?;
        if light.is_none() {
            eprintln!("note: the layers emission, direct and indirect are left out, since they were interrupted");
        }
        *self.kept.light.borrow_mut() = light;
        Ok(())
    }

    /// Renders the light groups with the samples of the picture. A signal leaves them out.
    fn light_groups(&self, render: &dyn Fn(&Scene) -> Result<Option<Film>>) -> Result<()> {
        let wanted = &self.args.layers.light_groups;
        if wanted.is_empty() {
            return Ok(());
        }
        let (mut bar, mut done) = (self.reporter(), 0);
        let groups = light_groups::render(self.scene, wanted, &mut |scene| {
            bar.count("light groups", done, wanted.len() as u64 + 1);
            done += 1;
            render(scene)
        })?;
        bar.clear(None);
        if groups.is_none() {
            eprintln!("note: the layers of light groups are left out, since they were interrupted");
        }
        *self.kept.groups.borrow_mut() = groups.unwrap_or_default();
        Ok(())
    }

    /// Renders samples of the sequence; none if a signal ends the render before.
    fn render_samples(&self, samples: &Range<u64>, renderer: &mut dyn Renderer) -> Result<Option<Film>, RenderError> {
        if samples.start > 0 {
            renderer.begin_at(samples.start)?;
        }
        renderer.render(samples.end - samples.start, &mut |_| !self.interrupt.requested())?;
        if renderer.samples() < samples.end { Ok(None) } else { renderer.film().map(Some) }
    }

    /// Writes the image of each strategy of the method, with as many samples as the picture. A signal ends
    /// the series.
    fn strategy_images(&self, render: &mut dyn FnMut(OnlyStrategy) -> Result<Film, RenderError>) -> Result<()> {
        let Some(folder) = &self.args.strategy_images else { return Ok(()) };
        let all = [true, false].into_iter().flat_map(|weighted| OnlyStrategy::all(self.settings.bounces, weighted));
        let all: Vec<_> = all.filter(|only| self.settings.technique.has_strategy(only.s, only.t)).collect();
        let mut bar = self.reporter();
        for (n, only) in (0..).zip(&all) {
            if self.interrupt.requested() {
                break;
            }
            bar.count(&only.name(), n, all.len() as u64);
            let film = render(*only)?;
            if !self.interrupt.requested() {
                film.save(folder.join(only.name()).with_extension("exr"))?;
            }
        }
        bar.clear(None);
        Ok(())
    }

    /// Renders until the number of samples, the target error or the end of the budget is reached, or until a
    /// signal.
    fn progressive(
        &self,
        gpu: Option<&Gpu>,
        renderer: &mut dyn Renderer,
        stopwatch: Stopwatch,
        reporter: Reporter,
    ) -> Result<(Film, Stats<'_>, Reporter)> {
        if let Some(range) = self.args.sample_range {
            renderer.begin_at(range.first - 1)?;
        }
        let setup = stopwatch.elapsed().as_secs_f64();
        self.interrupt.begin();
        let keeper = Keeper::new(self, gpu);
        let saved = self.saved_before(&keeper)?;
        let mut progress = ProgressiveRender::new(self, renderer, (keeper, reporter), saved, gpu)?;
        let (film, ended_by) = loop {
            let ended = progress.render_to_checkpoint()?;
            let film = progress.renderer.film()?;
            if let Some(ending) = progress.ending(&film, ended)? {
                break (film, ending);
            }
        };
        let non_finite_after = gpu.map_or(Ok(Vec::new()), |gpu| gpu.non_finite.counts(gpu))?;
        progress.reporter.clear(progress.convergence.as_ref().and_then(Convergence::error));
        self.preview.borrow_mut().iter_mut().for_each(|preview| preview.show(&film));
        let render = progress.seconds();
        let compile = stopwatch.compiling().as_secs_f64();
        progress.close(ended_by)?;
        let region = self.settings.region();
        let all = progress.samples * u64::from(region.width) * u64::from(region.height);
        let RenderStats { bytes, scene_bytes, tracer_bytes, non_finite, lost_nodes, redone, passes, .. } =
            progress.renderer.stats();
        let stats = Stats {
            device: device_name(gpu),
            // A filtered frame continues the samples of the one before, which are not its own.
            samples: progress.samples,
            ended_by,
            estimated_error: progress.target.and(progress.convergence.as_ref()).and_then(Convergence::error),
            taken: progress.target.map(|_| progress.taken as f64 / all.max(1) as f64),
            seconds: Seconds { load: self.load, setup, compile, render },
            bytes,
            scene_bytes: scene_bytes + tracer_bytes,
            non_finite,
            non_finite_after,
            lost_nodes,
            redone,
            passes,
            ..self.empty_stats()
        };
        Ok((film, stats, progress.reporter))
    }

    /// Returns the factor by which radiance is multiplied before its error is estimated. By default dark
    /// pictures are brightened as for the display, since the 0.01 in rel_mse hides the noise of radiances far
    /// below 0.1.
    pub(super) fn error_scale(&self, film: &Film) -> f32 {
        let Settings { target_error, budget, .. } = *self.settings;
        let by_default = (target_error, budget) == (Some(DEFAULT_TARGET_ERROR), Some(DEFAULT_BUDGET));
        if by_default { auto_exposure(film, self.backdrop().as_ref()).max(0.0).exp2() } else { 1.0 }
    }

    /// Returns the exposure and the tone curve of a picture.
    pub(super) fn grade_of(&self, film: &Film) -> Grade {
        let (exposure, tonemap) = self.args.grade.chosen();
        Grade { stops: exposure.stops(film, || self.backdrop()), tonemap }
    }

    /// Returns what the camera sees of the environment.
    fn backdrop(&self) -> Option<Backdrop> {
        let Settings { width, height, crop, camera, .. } = *self.settings;
        Backdrop::new(self.scene, self.scene.cameras.get(camera)?, [width, height], crop)
    }

    /// Renders by the reference and writes the picture.
    fn reference(&self) -> Result<Picture> {
        let stopwatch = Stopwatch::from(self.began, None);
        let mut renderer = ReferenceRenderer::new(self.scene, self.settings);
        let (film, stats, reporter) = self.progressive(None, &mut renderer, stopwatch, self.reporter())?;
        let stats = Stats { rays: renderer.rounds.rays, ..stats };
        let end = renderer.samples();
        let samples = end - stats.samples..end;
        if self.args.layers.splits_light() {
            self.split_light(&samples, &mut renderer.of_direct_light())?;
        }
        self.light_groups(&|scene| {
            Ok(self.render_samples(&samples, &mut ReferenceRenderer::new(scene, self.settings))?)
        })?;
        self.finish(&film, stats, reporter)
    }

    /// Returns the statistics that are known before the render.
    fn empty_stats(&self) -> Stats<'_> {
        Stats {
            version: env!("CARGO_PKG_VERSION"),
            scene: &self.scene.name,
            device: String::new(),
            method: self.settings.technique.to_string(),
            size: [self.settings.region().width, self.settings.region().height],
            samples: 0,
            exposure_stops: None,
            tonemap: None,
            ended_by: Ending::Samples,
            estimated_error: None,
            taken: None,
            seconds: Seconds::default(),
            passes: BTreeMap::new(),
            bytes: 0,
            scene_bytes: 0,
            non_finite: 0,
            non_finite_after: Vec::new(),
            lost_nodes: 0,
            redone: 0,
            requests: Vec::new(),
            rays: 0,
            plan: None,
            frame: self.frame,
            animations: self.animations,
            warnings: &self.scene.warnings,
            notes: &self.scene.notes,
            settings: self.settings,
        }
    }

    /// Returns the name of a file of the frame.
    fn named(&self, path: &Path) -> PathBuf {
        self.frame.map_or_else(|| path.to_owned(), |frame| numbered(path, frame.number))
    }

    /// Returns the files of the picture.
    fn files(&self) -> Vec<PathBuf> {
        self.args.output.iter().map(|path| self.named(path)).collect()
    }

    /// Returns what shows the progress.
    pub(super) fn reporter(&self) -> Reporter {
        let prefix = self.frame.map(|frame| format!("frame {}, one of {} ", frame.number, self.all));
        Reporter::new(self.args.quiet, prefix.unwrap_or_default(), self.args.json_progress.then(|| self.files()))
    }

    /// Describes the number of samples and the end of the render for the closing line.
    fn outcome(&self, stats: &Stats) -> String {
        let samples = format!("{} {}", stats.samples, if stats.samples == 1 { "sample" } else { "samples" });
        let reached = stats.estimated_error.map(|error| format!(" at an estimated rel_mse of {}", two_digits(error)));
        match (stats.ended_by, stats.estimated_error) {
            (Ending::Interrupt, _) => format!("interrupted after {samples}{}", reached.unwrap_or_default()),
            (Ending::TargetError, Some(error)) => format!("estimated rel_mse {} after {samples}", two_digits(error)),
            (Ending::Budget, _) if self.settings.target_error.is_some() => {
                let time = match self.settings.budget {
                    Some(DEFAULT_BUDGET) => "five minutes".to_owned(),
                    seconds => format!("{} s", seconds.unwrap_or_default()),
                };
                let reached = reached.unwrap_or_else(|| " with too few samples for an estimate".to_owned());
                format!("stopped after {time}{reached}, {samples}")
            }
            _ => samples,
        }
    }

    /// Writes the image files and the statistics, prints the closing line, and returns the picture.
    fn finish(&self, film: &Film, mut stats: Stats, mut reporter: Reporter) -> Result<Picture> {
        if stats.non_finite > 0 {
            let first = stats.non_finite_after.iter().find(|(_, count)| *count > 0);
            let first = first.map(|(pass, _)| format!(", first after the pass {pass}")).unwrap_or_default();
            eprintln!(
                "warning: {} values are not finite{first}; please report the scene and the settings",
                stats.non_finite
            );
        }
        let paths = self.files();
        let picture = self.picture(film)?;
        let grade = self.grade.get_or_init(|| self.grade_of(&picture.film));
        // Hashing a large scene takes seconds, and only an .exr holds the record.
        let record = paths
            .iter()
            .any(|path| has_extension(path, "exr"))
            .then(|| self.record(stats.plan.as_ref(), stats.samples, stats.seconds.render, stats.device.clone()));
        let picture = Picture { record, ..picture };
        for path in &paths {
            save(path, &picture, grade)?;
        }
        if self.args.writes_png() {
            (stats.exposure_stops, stats.tonemap) = (Some(grade.stops), Some(grade.tonemap));
        }
        if let Some(path) = &self.args.stats {
            output::write(&self.named(path), &(serde_json::to_string_pretty(&stats)? + "\n"))?;
        }
        if !self.args.quiet {
            let Seconds { load, setup, compile, render } = stats.seconds;
            let compiling = if compile < 0.1 { String::new() } else { format!("compiling shaders {compile:.2} s, ") };
            let shown = match self.args.grade.chosen().0 {
                _ if !self.args.writes_png() => String::new(),
                Exposure::Auto => format!("; exposure {:+.2} stops (auto), {}", grade.stops, grade.tonemap),
                Exposure::Stops(stops) => format!("; exposure {stops:+} stops, {}", grade.tonemap),
            };
            eprintln!(
                "{}: {}x{}, {} by {} on {}{shown}; load {load:.2} s, setup {setup:.2} s, {compiling}render {render:.2} s",
                if paths.is_empty() { self.args.shown_name() } else { shown_paths(&paths) },
                film.width,
                film.height,
                self.outcome(&stats),
                stats.method,
                stats.device
            );
        }
        if stats.ended_by == Ending::Interrupt && !paths.is_empty() {
            eprintln!("{}", self.how_to_go_on(stats.samples));
        } else if self.args.checkpoint.is_some() {
            // The picture is complete. There is no checkpoint if the render ended before the first one.
            let _ = std::fs::remove_file(checkpoint::path_of(&self.args.output[0]));
        }
        reporter.end(stats.ended_by, stats.samples, stats.seconds.render);
        Ok(picture)
    }

    /// True if a viewer should see the picture as it is now.
    pub(super) fn preview_is_due(&self) -> bool {
        self.preview.borrow().as_ref().is_some_and(Preview::is_due)
    }

    /// Says how an interrupted render goes on.
    fn how_to_go_on(&self, samples: u64) -> String {
        let Settings { samples: all, target_error, budget, history, .. } = *self.settings;
        let first = self.args.sample_range.map_or(1, |range| range.first);
        let has_exr = self.args.output.iter().any(|path| has_extension(path, "exr"));
        // An interrupted picture lacks the parts of the light, and would not merge with the rest.
        let parts = has_exr && history == 0 && !self.args.layers.renders_light();
        if self.args.checkpoint.is_some() {
            let path = checkpoint::path_of(&self.args.output[0]);
            format!("to go on, give the same command with --resume {}", path.display())
        } else if parts && target_error.is_none() && budget.is_none() {
            let rest = SampleRange { first: first + samples, last: first + u64::from(all) - 1 };
            format!("to go on, render --sample-range {rest} to another .exr and join the two by `lightsheaf merge`")
        } else {
            "this render cannot go on; with --checkpoint SECONDS the next one can".to_owned()
        }
    }

    /// Returns the hash of the scene.
    pub(super) fn scene_hash(&self) -> &str {
        self.kept.scene_hash.get_or_init(|| fingerprint::scene_hash(self.scene))
    }

    /// Returns the picture with its layers.
    pub(super) fn picture(&self, film: &Film) -> Result<Picture> {
        let aovs = self.kept.aovs.get_or_init(|| self.args.layers.trace(self.scene, self.before, self.settings));
        let (light, groups) = (self.kept.light.borrow(), self.kept.groups.borrow());
        let Settings { width, height, crop, .. } = *self.settings;
        let window = crop.map(|crop| Window { crop, size: [width, height] });
        let mut picture = self.args.layers.picture(film, self.scene, aovs.as_ref(), light.as_ref(), &groups)?;
        picture.channels.extend(self.kept.filtered.borrow().iter().flat_map(FilteredFilm::channels));
        Ok(Picture { window, ..picture })
    }

    /// Returns the record of a picture.
    pub(super) fn record(
        &self,
        plan: Option<&serde_json::Value>,
        samples: u64,
        seconds: f64,
        device: String,
    ) -> Record {
        let mut settings = fingerprint::settings_text(self.settings, plan);
        if self.settings.is_adaptive() {
            // Tiles of such a picture have different numbers of samples.
            settings.insert_str(1, "\"adaptive\":true,");
        }
        let first = self.args.sample_range.map_or(1, |range| range.first);
        Record {
            command: output::command_line(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: self.scene.name.clone(),
            scene_hash: self.scene_hash().to_owned(),
            settings_hash: fingerprint::hash_of_text(&settings),
            settings,
            samples,
            seed: self.settings.seed,
            ranges: vec![SampleRange { first, last: first + samples.max(1) - 1 }],
            device,
            seconds,
        }
    }

    /// Returns what `--resume` goes on with, or what was saved before the device was lost.
    fn saved_before(&self, keeper: &Keeper) -> Result<Option<Saved>> {
        if let Some(saved) = self.kept.saved.borrow().clone() {
            return Ok(Some(saved));
        }
        let Some(path) = &self.args.resume else { return Ok(None) };
        let saved = checkpoint::read(path, &keeper.identity(self))?;
        let shown = path.display();
        let first = self.args.sample_range.map_or(0, |range| range.first - 1);
        if saved.state.first != first {
            bail!(
                "--resume {shown}: it begins with sample {}, not {}; give its --sample-range",
                saved.state.first + 1,
                first + 1
            );
        }
        let Settings { samples, target_error, budget, .. } = *self.settings;
        if target_error.is_none() && budget.is_none() && saved.samples > samples.into() {
            bail!(
                "--resume {shown}: it has {} samples already; give --samples {} or more",
                saved.samples,
                saved.samples
            );
        }
        Ok(Some(saved))
    }
}

/// Writes a picture: .exr with its layers and its record, .png with its exposure and tone curve.
pub(super) fn save(path: &Path, picture: &Picture, grade: &Grade) -> Result<()> {
    let saved = if has_extension(path, "exr") { picture.save(path) } else { picture.film.save_graded(path, grade) };
    Ok(saved?)
}

/// Lists files for a line of text.
fn shown_paths(paths: &[PathBuf]) -> String {
    paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
}
