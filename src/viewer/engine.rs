//! One interface to the renderers of all methods.

use glam::Vec3;

use crate::film::Film;
use crate::gpu::Gpu;
use crate::reference::{Reference, ReferenceSettings, Rounds};
use crate::render::{self, RenderError, RenderStats, Renderer};
use crate::scene::{Camera, Scene};
use crate::settings::{Method, Settings};

/// The renderer of a method.
pub enum Engine<'gpu> {
    /// A renderer on the device.
    Device(Box<dyn Renderer + 'gpu>),
    /// `reference`.
    Reference(Rounds),
}

impl<'gpu> Engine<'gpu> {
    /// Creates the renderer. Its camera is one of the scene's.
    ///
    /// # Errors
    /// Returns an error if the settings are invalid, or the scene or the device does not support them.
    pub fn new(gpu: Option<&'gpu Gpu>, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        if settings.method() == Method::Reference {
            settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
            return Ok(Self::Reference(Rounds::new(ReferenceSettings::of(settings))));
        }
        let gpu = gpu.ok_or_else(|| RenderError::Setting("there is no graphics device".to_owned()))?;
        Ok(Self::Device(render::open(gpu, scene, settings)?))
    }

    /// Restarts with another pose of the scene or with other lights.
    ///
    /// # Errors
    /// Returns [`RenderError`] if the device fails or the scene does not fit into its limits.
    pub fn pose(&mut self, scene: &Scene, settings: &Settings) -> Result<(), RenderError> {
        match self {
            Self::Device(renderer) => renderer.pose(scene),
            Self::Reference(rounds) => {
                *rounds = Rounds::new(ReferenceSettings::of(settings));
                Ok(())
            }
        }
    }

    /// Restarts with another camera. For `reference`, the caller also sets the camera of the [`Reference`].
    ///
    /// # Errors
    /// Returns [`RenderError`] if the device fails.
    pub fn set_camera(&mut self, camera: &Camera, settings: &Settings) -> Result<(), RenderError> {
        match self {
            Self::Device(renderer) => renderer.set_camera(camera)?,
            Self::Reference(rounds) => *rounds = Rounds::new(ReferenceSettings::of(settings)),
        }
        Ok(())
    }

    /// Adds samples; `reference` is called only for the method `reference`.
    ///
    /// # Errors
    /// Returns [`RenderError`] if the device fails.
    pub fn render<'r, 's: 'r>(
        &mut self,
        samples: u64,
        reference: impl FnOnce() -> &'r Reference<'s>,
    ) -> Result<(), RenderError> {
        match self {
            Self::Device(renderer) => renderer.render(samples, &mut |_| true),
            Self::Reference(rounds) => {
                rounds.add(reference(), samples as u32, &|_, _| ());
                Ok(())
            }
        }
    }

    /// Returns the picture of the samples so far.
    ///
    /// # Errors
    /// Returns [`RenderError`] if the device fails.
    pub fn film(&self) -> Result<Film, RenderError> {
        match self {
            Self::Device(renderer) => renderer.film(),
            Self::Reference(rounds) => Ok(rounds.film()),
        }
    }

    /// Returns the statistics of the samples so far.
    #[must_use]
    pub fn stats(&self) -> RenderStats {
        match self {
            Self::Device(renderer) => renderer.stats(),
            Self::Reference(rounds) => RenderStats {
                samples: rounds.samples().into(),
                non_finite: rounds.non_finite,
                ..RenderStats::default()
            },
        }
    }

    /// Returns the positions of the last sample's VPLs, world space; none for methods whose pixels do not
    /// share VPLs.
    ///
    /// # Errors
    /// Returns [`RenderError`] if the device fails.
    pub fn vpls(&self) -> Result<Vec<Vec3>, RenderError> {
        match self {
            Self::Device(renderer) => renderer.vpls(),
            Self::Reference(_) => Ok(Vec::new()),
        }
    }

    /// Returns the plan as `lightsheaf plan` prints it: passes with their reasons.
    #[must_use]
    pub fn plan(&self) -> String {
        match self {
            Self::Device(renderer) => renderer.plan_text(),
            Self::Reference(_) => "A CPU path tracer; it does the same for every scene, and has no plan.".to_owned(),
        }
    }
}
