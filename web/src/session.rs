//! A scene, a renderer and their picture, by calls from JavaScript. A session does one call at a time.

use std::collections::HashMap;
use std::f32::consts::PI;

use lightsheaf::exposure::{Backdrop, Exposure, grey_card};
use lightsheaf::film::Film;
use lightsheaf::film::exr::Picture;
use lightsheaf::gpu::{Gpu, PassTime};
use lightsheaf::metrics;
use lightsheaf::render::{self, Renderer};
use lightsheaf::scene::{self, Camera, Geometry, Scene, builtin};
use lightsheaf::settings::{Method, Settings, Technique, Visibility};
use lightsheaf::staging::{self, OrbitCamera, Staging};
use lightsheaf::tonemap::{Grade, Tonemap};
use serde::Deserialize;
use wasm_bindgen::prelude::wasm_bindgen;

/// What the page shows of an error.
type Result<T> = std::result::Result<T, String>;

/// What the page's controls say.
#[derive(Deserialize)]
struct Wishes {
    method: Method,
    visibility: Visibility,
    width: u32,
    height: u32,
    bounces: u32,
    seed: u32,
}

impl Wishes {
    /// Returns the settings, which do not end by themselves: the page asks for batches as long as it wants.
    fn settings(&self) -> Result<Settings> {
        let Self { method, visibility, width, height, bounces, seed } = *self;
        let technique = Technique { method, visibility: Some(visibility) };
        let settings = Settings { technique, width, height, bounces, seed, ..Settings::default() };
        settings.check().map_err(|e| e.to_string())?;
        Ok(settings)
    }
}

/// A device, a scene, and the renderer of a picture.
#[wasm_bindgen]
pub struct Session {
    // A page has one device as long as it is open, so that renderers may borrow it.
    gpu: &'static Gpu,
    /// The scene as it was loaded, and where the user has moved the camera.
    scene: Option<Scene>,
    camera: Option<OrbitCamera>,
    /// Luminance of the scene's [`grey_card`].
    grey_card: f32,
    beside: HashMap<String, Vec<u8>>,
    seed: u32,
    renderer: Option<Box<dyn Renderer>>,
    film: Film,
    reference: Option<Film>,
    stops: f32,
    /// Samples of the picture that were taken before passes were timed; none if they are not timed.
    timed_from: Option<u64>,
}

/// Returns the names of the built-in scenes.
#[wasm_bindgen]
#[must_use]
pub fn scene_names() -> Vec<String> {
    builtin::names().map(|(name, _)| name.to_owned()).collect()
}

#[wasm_bindgen]
impl Session {
    /// Opens the browser's device.
    pub async fn start() -> Result<Self> {
        let gpu: &'static Gpu = Box::leak(Box::new(Gpu::new_async().await.map_err(text)?));
        Ok(Self {
            gpu,
            scene: None,
            grey_card: 0.0,
            camera: None,
            beside: HashMap::new(),
            seed: 0,
            renderer: None,
            film: Film::new(0, 0),
            reference: None,
            stops: 0.0,
            timed_from: None,
        })
    }

    /// Notes a file that the next [`Self::load_file`] may refer to. Pages know names of files, not their folders.
    pub fn add_file(&mut self, name: String, bytes: Vec<u8>) {
        self.beside.insert(name, bytes);
    }

    /// Loads a file and those beside it that it refers to. A camera that it lacks is placed for an image of this size.
    pub fn load_file(&mut self, name: &str, bytes: &[u8], width: u32, height: u32) -> Result<()> {
        let beside = std::mem::take(&mut self.beside);
        let resolve = |path: &str| beside.get(path.rsplit('/').next()?).cloned();
        let scene = scene::load_bytes(name, bytes, &resolve);
        self.set_scene(
            scene.map_err(|e| format!("{e}. Drop a file together with all that it refers to"))?,
            [width, height],
        )
    }

    /// Loads a built-in scene.
    pub fn load_builtin(&mut self, name: &str, width: u32, height: u32) -> Result<()> {
        self.set_scene(builtin::load(name).map_err(text)?, [width, height])
    }

    fn set_scene(&mut self, mut scene: Scene, size: [u32; 2]) -> Result<()> {
        staging::complete(&mut scene, &Staging { size, ..Staging::default() }).map_err(text)?;
        let camera = scene.cameras.first().ok_or("the scene has no camera")?;
        self.camera = Some(OrbitCamera::around(camera, Geometry::new(&scene).sphere()));
        self.grey_card = grey_card(&scene);
        (self.scene, self.renderer, self.reference) = (Some(scene), None, None);
        Ok(())
    }

    /// Returns what was repaired, left out or added: notes and warnings of the scene, then of the renderer.
    pub fn notes(&self) -> Vec<String> {
        let scene = self.scene.iter().flat_map(|scene| scene.notes.iter().chain(&scene.warnings));
        let renderer = self.renderer.iter().flat_map(|renderer| renderer.warnings());
        let mut notes: Vec<String> = scene.chain(renderer).cloned().collect();
        notes.dedup();
        notes
    }

    /// Opens a renderer of the scene with the settings, JSON.
    pub async fn open(&mut self, settings: &str) -> Result<()> {
        // The old renderer goes first: two may not fit.
        self.renderer = None;
        let settings = serde_json::from_str::<Wishes>(settings).map_err(text)?.settings()?;
        let Some(scene) = &self.scene else { return Err("there is no scene yet".to_owned()) };
        self.seed = settings.seed;
        self.renderer = Some(render::open_async(self.gpu, scene, &settings).await.map_err(text)?);
        self.move_camera().await
    }

    fn renderer(&mut self) -> Result<&mut Box<dyn Renderer>> {
        self.renderer.as_mut().ok_or_else(|| "there is no renderer yet".to_owned())
    }

    /// Turns the camera about its target: by a half circle for the height of the picture.
    pub fn orbit(&mut self, right: f32, down: f32) {
        if let Some(camera) = &mut self.camera {
            camera.orbit(-right * PI, down * PI);
        }
    }

    /// Moves camera and target across the view, in heights of the picture.
    pub fn shift(&mut self, right: f32, down: f32) {
        if let Some(camera) = &mut self.camera {
            let metres = camera.distance();
            camera.fly(0.0, -right * metres, down * metres);
        }
    }

    /// Multiplies the distance to the target.
    pub fn approach(&mut self, factor: f32) {
        if let Some(camera) = &mut self.camera {
            camera.approach(factor);
        }
    }

    /// Begins the picture anew where the camera is now.
    pub async fn move_camera(&mut self) -> Result<()> {
        let (moved, seed) = (self.moved(), self.seed);
        if let Some(camera) = moved {
            let renderer = self.renderer()?;
            renderer.set_camera_async(&camera).await.map_err(text)?;
            // A filtered picture would go on from the view before.
            renderer.restart(seed);
        }
        self.gpu.timings.reset();
        self.timed_from = self.timed_from.map(|_| 0);
        Ok(())
    }

    /// Adds samples, and returns how many the picture has.
    pub async fn render(&mut self, samples: u32) -> Result<u32> {
        let renderer = self.renderer()?;
        renderer.render_async(samples.into(), &mut |_| true).await.map_err(text)?;
        let (samples, film) = (renderer.samples(), renderer.film_async().await.map_err(text)?);
        self.film = film;
        Ok(samples as u32)
    }

    /// Returns the picture for a canvas, four bytes a pixel, at an exposure in stops; without one at that which
    /// suits it.
    pub fn pixels(&mut self, stops: Option<f32>) -> Vec<u8> {
        let backdrop = || {
            Backdrop::with_card(
                self.scene.as_ref()?,
                self.grey_card,
                &self.moved()?,
                [self.film.width, self.film.height],
                None,
            )
        };
        self.stops = stops.map_or(Exposure::Auto, Exposure::Stops).stops(&self.film, backdrop);
        let grade = Grade { stops: self.stops, tonemap: Tonemap::default() };
        grade.picture(&self.film).chunks_exact(3).flat_map(|pixel| [pixel[0], pixel[1], pixel[2], 255]).collect()
    }

    /// Columns of the picture.
    #[wasm_bindgen(getter)]
    pub fn width(&self) -> u32 {
        self.film.width
    }

    /// Rows of the picture.
    #[wasm_bindgen(getter)]
    pub fn height(&self) -> u32 {
        self.film.height
    }

    /// Exposure of the newest [`Self::pixels`], stops.
    #[wasm_bindgen(getter)]
    pub fn stops(&self) -> f32 {
        self.stops
    }

    /// Name of the device.
    #[wasm_bindgen(getter)]
    pub fn adapter(&self) -> String {
        self.gpu.capabilities.adapter.clone()
    }

    /// Returns the plan of the renderer.
    pub fn plan(&self) -> String {
        self.renderer.as_ref().map(|renderer| renderer.plan_text()).unwrap_or_default()
    }

    /// Begins or ends to time passes.
    pub fn measure(&mut self, on: bool) {
        self.gpu.timings.measure(on);
        if self.timed_from.is_some() != on {
            self.gpu.timings.reset();
            self.timed_from = on.then(|| self.renderer.as_ref().map_or(0, |renderer| renderer.samples()));
        }
    }

    /// Returns name and milliseconds per sample of each pass that was timed, longest first, JSON.
    pub fn times(&self) -> String {
        let stats = self.renderer.as_ref().map(|renderer| renderer.stats()).unwrap_or_default();
        let samples = stats.samples.saturating_sub(self.timed_from.unwrap_or(0)).max(1);
        let milliseconds = |time: &PassTime| time.gpu_millis / samples as f64;
        let mut times: Vec<(&str, f64)> = stats.passes.iter().map(|(name, time)| (*name, milliseconds(time))).collect();
        // Not every browser lets pages measure.
        times.retain(|(_, milliseconds)| *milliseconds > 0.0);
        times.sort_by(|a, b| b.1.total_cmp(&a.1));
        serde_json::json!(times).to_string()
    }

    /// Returns the picture as OpenEXR.
    pub fn exr(&self) -> Result<Vec<u8>> {
        Picture { film: self.film.clone(), ..Picture::default() }.encode()
    }

    /// Later pictures are compared with this one.
    pub fn keep(&mut self) {
        self.reference = Some(self.film.clone());
    }

    /// Later pictures are compared with that of an .exr.
    pub fn compare_with(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        let picture = Picture::decode(bytes).map_err(|cause| format!("{name}: {cause}"))?;
        self.reference = Some(picture.film);
        Ok(())
    }

    /// Returns the rel_mse against the reference, if there is one of the picture's size.
    pub fn error(&self) -> Option<f64> {
        let comparison = metrics::compare(&self.film, self.reference.as_ref()?).ok()?;
        Some(comparison.rel_mse)
    }
}

impl Session {
    /// The scene's camera where the user has moved it.
    fn moved(&self) -> Option<Camera> {
        Some(self.camera?.camera(self.scene.as_ref()?.cameras.first()?))
    }
}

/// Returns what the page shows of an error.
fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}
