//! Contenders: our methods, each on a separate device, the CPU reference, and other programs
//! ([`super::peer`]).

use std::collections::BTreeMap;
use std::time::Instant;

use crate::film::Film;
use crate::gpu::{Gpu, GpuError, PassTime};
use crate::reference::{Reference, ReferenceSettings, Rounds};
use crate::render::{self, Renderer};
use crate::scene::Scene;
use crate::settings::{Method, Settings, Technique};

use super::BenchError;

/// Result of a rendering call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rendered {
    /// Number of samples in the picture.
    pub samples: u64,
    /// Seconds of this call, by the contender's clock.
    pub seconds: f64,
}

/// Description of a contender, with times of passes and memory.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Details {
    /// Program, version, device and driver.
    pub about: String,
    /// Device time and number of runs of each pass over all repeats, if known.
    pub passes: BTreeMap<&'static str, PassTime>,
    /// Bytes on the device, if known.
    pub bytes: Option<u64>,
}

/// Progressive renderer of a scene.
pub trait Contender {
    /// True if samples are added to the current picture. Otherwise each call of [`Self::render`] renders a
    /// picture from scratch, so that sampling patterns for a known number of samples are not truncated.
    fn grows(&self) -> bool;

    /// Begins a new picture with a seed.
    fn restart(&mut self, seed: u32);

    /// Renders about `samples` samples per pixel and waits until they are finished.
    ///
    /// # Errors
    /// Returns the error of the device or the program.
    fn render(&mut self, samples: u64) -> Result<Rendered, BenchError>;

    /// Returns the current picture.
    ///
    /// # Errors
    /// Returns an error if the device fails, or if a file cannot be read.
    fn film(&mut self) -> Result<Film, BenchError>;

    /// Returns the description, times of passes and memory.
    fn details(&self) -> Details;

    /// Resets the times of passes.
    fn forget(&mut self);
}

/// Opens a device for a technique. Returns none for the CPU reference.
///
/// # Errors
/// Returns [`GpuError`] if there is no such device.
pub fn device(technique: Technique) -> Result<Option<Gpu>, GpuError> {
    match technique.method {
        Method::Reference => Ok(None),
        _ => render::open_device(technique).map(Some),
    }
}

/// Creates a contender for one of our techniques on the device that [`device`] has opened for it.
///
/// # Errors
/// Returns the errors of [`render::open`].
pub fn ours<'a>(
    gpu: Option<&'a Gpu>,
    scene: &'a Scene,
    settings: &Settings,
) -> Result<Box<dyn Contender + 'a>, BenchError> {
    let Some(gpu) = gpu else { return Ok(Box::new(OnCpu::new(scene, settings))) };
    gpu.timings.measure(true);
    Ok(Box::new(OnDevice { gpu, renderer: render::open(gpu, scene, settings)? }))
}

/// Technique on a GPU.
struct OnDevice<'a> {
    gpu: &'a Gpu,
    renderer: Box<dyn Renderer + 'a>,
}

impl Contender for OnDevice<'_> {
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
        Ok(Rendered { samples: self.renderer.samples(), seconds })
    }

    fn film(&mut self) -> Result<Film, BenchError> {
        Ok(self.renderer.film()?)
    }

    fn details(&self) -> Details {
        let stats = self.renderer.stats();
        Details {
            about: format!("lightsheaf {}, {}", env!("CARGO_PKG_VERSION"), self.gpu.capabilities.adapter),
            passes: stats.passes,
            bytes: Some(stats.bytes + stats.scene_bytes + stats.tracer_bytes),
        }
    }

    fn forget(&mut self) {
        self.gpu.timings.reset();
    }
}

/// CPU reference.
struct OnCpu<'a> {
    reference: Reference<'a>,
    settings: ReferenceSettings,
    rounds: Rounds,
}

impl<'a> OnCpu<'a> {
    fn new(scene: &'a Scene, settings: &Settings) -> Self {
        let settings = ReferenceSettings::of(settings);
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
