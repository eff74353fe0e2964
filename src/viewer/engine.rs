//! A method at work on one picture, whichever it is.

use glam::Vec3;

use crate::film::Film;
use crate::gpu::Gpu;
use crate::path_renderer::PathRenderer;
use crate::reference::{Reference, ReferenceSettings, Rounds};
use crate::renderer::{Progressive as _, RenderError, RenderStats, Renderer};
use crate::scene::{Camera, Scene};
use crate::settings::{Method, Settings, UNLIMITED};

/// What renders.
pub enum Engine<'gpu> {
    /// `raster` and `twin`.
    Raster(Box<Renderer<'gpu>>),
    /// `ray-query` and `path`.
    Paths(Box<PathRenderer<'gpu>>),
    /// `reference`.
    Judge(Rounds),
}

impl<'gpu> Engine<'gpu> {
    /// Makes it ready; its camera is one of the scene's.
    ///
    /// # Errors
    /// What the settings, the scene or the device are not fit for.
    pub fn new(gpu: Option<&'gpu Gpu>, scene: &Scene, settings: &Settings) -> Result<Self, RenderError> {
        if settings.method == Method::Reference {
            settings.check().map_err(|e| RenderError::Setting(e.to_string()))?;
            return Ok(Self::Judge(Rounds::new(judge_settings(settings))));
        }
        let gpu = gpu.ok_or_else(|| RenderError::Setting("there is no graphics device".to_owned()))?;
        Ok(if settings.method.shares_subpaths() {
            Self::Raster(Box::new(Renderer::new(gpu, scene, settings)?))
        } else {
            Self::Paths(Box::new(PathRenderer::new(gpu, scene, settings)?))
        })
    }

    /// Begins anew in another pose of the scene, or with other lights.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn pose(&mut self, scene: &Scene, settings: &Settings) -> Result<(), RenderError> {
        match self {
            Self::Raster(renderer) => renderer.pose(scene),
            Self::Paths(renderer) => renderer.pose(scene),
            Self::Judge(rounds) => {
                *rounds = Rounds::new(judge_settings(settings));
                Ok(())
            }
        }
    }

    /// Begins anew from elsewhere; the reference itself has to look there, too.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn look(&mut self, camera: &Camera, settings: &Settings) -> Result<(), RenderError> {
        match self {
            Self::Raster(renderer) => renderer.look(camera)?,
            Self::Paths(renderer) => renderer.look(camera),
            Self::Judge(rounds) => *rounds = Rounds::new(judge_settings(settings)),
        }
        Ok(())
    }

    /// Adds samples.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn render<'r, 's: 'r>(
        &mut self,
        samples: u64,
        judge: impl FnOnce() -> &'r Reference<'s>,
    ) -> Result<(), RenderError> {
        match self {
            Self::Raster(renderer) => renderer.render(samples, &mut |_| true),
            Self::Paths(renderer) => renderer.render(samples, &mut |_| true),
            Self::Judge(rounds) => {
                rounds.add(judge(), samples as u32, &|_, _| ());
                Ok(())
            }
        }
    }

    /// The picture so far.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn film(&self) -> Result<Film, RenderError> {
        match self {
            Self::Raster(renderer) => renderer.film(),
            Self::Paths(renderer) => renderer.film(),
            Self::Judge(rounds) => Ok(rounds.film()),
        }
    }

    /// Counts so far.
    #[must_use]
    pub fn stats(&self) -> RenderStats {
        match self {
            Self::Raster(renderer) => renderer.stats(),
            Self::Paths(renderer) => renderer.stats(),
            Self::Judge(rounds) => RenderStats {
                samples: rounds.samples().into(),
                non_finite: rounds.non_finite,
                ..RenderStats::default()
            },
        }
    }

    /// The VPLs of the last sample, where all pixels share them.
    ///
    /// # Errors
    /// [`RenderError`].
    pub fn vpls(&self) -> Result<Vec<Vec3>, RenderError> {
        match self {
            Self::Raster(renderer) => renderer.vpls(),
            Self::Paths(_) | Self::Judge(_) => Ok(Vec::new()),
        }
    }

    /// What each sample does and why, as `lightsheaf plan` prints it.
    #[must_use]
    pub fn plan(&self) -> String {
        match self {
            Self::Raster(renderer) => renderer.plan().to_string(),
            Self::Paths(renderer) => renderer.plan().to_string(),
            Self::Judge(_) => "A CPU path tracer; it does the same for every scene, and has no plan.".to_owned(),
        }
    }
}

/// The reference's settings for the same picture.
#[must_use]
pub fn judge_settings(settings: &Settings) -> ReferenceSettings {
    let Settings { width, height, samples, seed, camera, .. } = *settings;
    let bounces = Some(settings.bounces).filter(|&bounces| bounces != UNLIMITED);
    ReferenceSettings { width, height, samples, bounces, seed, camera }
}
