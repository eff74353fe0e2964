//! Who takes part: our methods, each on a device of its own, the CPU reference, and programs of others ([`super::peer`]).

use std::collections::BTreeMap;
use std::time::Instant;

use crate::film::Film;
use crate::gpu::{Gpu, GpuError, PassTime};
use crate::path_renderer::PathRenderer;
use crate::reference::{Reference, ReferenceSettings, Rounds};
use crate::renderer::{Progressive, Renderer};
use crate::scene::Scene;
use crate::settings::{Method, Settings, UNLIMITED};

use super::BenchError;

/// What one call rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rendered {
    /// Samples in the picture now.
    pub samples: u64,
    /// Seconds that this call took, by the contender's own clock.
    pub seconds: f64,
}

/// What a contender says of itself in the end.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Details {
    /// Program, version, device and driver.
    pub about: String,
    /// Device time and runs per pass over all repeats, where it is known.
    pub passes: BTreeMap<&'static str, PassTime>,
    /// Bytes on the device, where they are known.
    pub bytes: Option<u64>,
}

/// Renders one scene progressively.
pub trait Contender {
    /// Whether samples are added to those of the picture so far. Otherwise each call of [`Self::render`] makes a picture anew, so
    /// that sampling patterns made for a known number of samples lose nothing.
    fn grows(&self) -> bool;

    /// Begins a picture with a seed.
    fn restart(&mut self, seed: u32);

    /// Renders about so many samples per pixel and waits for them.
    ///
    /// # Errors
    /// Whatever stops the device or the program.
    fn render(&mut self, samples: u64) -> Result<Rendered, BenchError>;

    /// The picture so far.
    ///
    /// # Errors
    /// Whatever stops the device, or a file that cannot be read.
    fn film(&mut self) -> Result<Film, BenchError>;

    /// What it is and did.
    fn details(&self) -> Details;

    /// Forgets the times of passes so far.
    fn forget(&mut self);
}

/// A device with what a method needs; none for the CPU reference.
///
/// # Errors
/// [`GpuError`].
pub fn device(method: Method) -> Result<Option<Gpu>, GpuError> {
    match method {
        Method::Reference => Ok(None),
        Method::Raster => Gpu::new().map(Some),
        Method::Twin | Method::RayQuery | Method::Path => Gpu::with_ray_queries().map(Some),
    }
}

/// One of our methods, on what [`device`] gave for it. Raster and its twin take a scene without glass ([`Scene::without_glass`]).
///
/// # Errors
/// As of the renderers.
pub fn ours<'a>(
    gpu: Option<&'a Gpu>,
    scene: &'a Scene,
    settings: &Settings,
) -> Result<Box<dyn Contender + 'a>, BenchError> {
    let Some(gpu) = gpu else { return Ok(Box::new(OnCpu::new(scene, settings))) };
    Ok(if settings.method.shares_subpaths() {
        Box::new(OnDevice { gpu, renderer: Renderer::new(gpu, scene, settings)? })
    } else {
        Box::new(OnDevice { gpu, renderer: PathRenderer::new(gpu, scene, settings)? })
    })
}

struct OnDevice<'a, R> {
    gpu: &'a Gpu,
    renderer: R,
}

impl<R: Progressive> Contender for OnDevice<'_, R> {
    fn grows(&self) -> bool {
        true
    }

    fn restart(&mut self, seed: u32) {
        self.renderer.restart(seed);
    }

    fn render(&mut self, samples: u64) -> Result<Rendered, BenchError> {
        let began = Instant::now();
        self.renderer.render(samples, &mut |_| true)?;
        let seconds = began.elapsed().as_secs_f64();
        Ok(Rendered { samples: self.renderer.stats().samples, seconds })
    }

    fn film(&mut self) -> Result<Film, BenchError> {
        Ok(self.renderer.film()?)
    }

    fn details(&self) -> Details {
        let stats = self.renderer.stats();
        Details {
            about: format!("lightsheaf {}, {}", env!("CARGO_PKG_VERSION"), self.gpu.capabilities.adapter),
            passes: stats.passes,
            bytes: Some(stats.bytes + stats.scene_bytes),
        }
    }

    fn forget(&mut self) {
        self.gpu.timings.reset();
    }
}

struct OnCpu<'a> {
    reference: Reference<'a>,
    settings: ReferenceSettings,
    rounds: Rounds,
}

impl<'a> OnCpu<'a> {
    fn new(scene: &'a Scene, settings: &Settings) -> Self {
        let settings = reference_settings(settings);
        Self { reference: Reference::new(scene), settings, rounds: Rounds::new(settings) }
    }
}

impl Contender for OnCpu<'_> {
    fn grows(&self) -> bool {
        true
    }

    fn restart(&mut self, seed: u32) {
        self.settings.seed = seed;
        self.rounds = Rounds::new(self.settings);
    }

    fn render(&mut self, samples: u64) -> Result<Rendered, BenchError> {
        let began = Instant::now();
        self.rounds.add(&self.reference, samples as u32, &|_, _| ());
        Ok(Rendered { samples: self.rounds.samples().into(), seconds: began.elapsed().as_secs_f64() })
    }

    fn film(&mut self) -> Result<Film, BenchError> {
        Ok(self.rounds.film())
    }

    fn details(&self) -> Details {
        let threads = rayon::current_num_threads();
        Details {
            about: format!("lightsheaf {}, CPU, {threads} threads", env!("CARGO_PKG_VERSION")),
            ..Details::default()
        }
    }

    fn forget(&mut self) {}
}

/// What the CPU reference takes of the settings.
pub(super) fn reference_settings(settings: &Settings) -> ReferenceSettings {
    let Settings { width, height, samples, seed, camera, .. } = *settings;
    let bounces = Some(settings.bounces).filter(|&b| b != UNLIMITED);
    ReferenceSettings { width, height, samples, bounces, seed, camera }
}
