//! The CPU reference as a progressive renderer.

use std::time::Instant;

use crate::crop::Crop;
use crate::film::Film;
use crate::reference::{Reference, ReferenceSettings, Rounds};
use crate::render::renderer::BatchSize;
use crate::render::state::RenderState;
use crate::render::{RenderError, RenderStats, Renderer};
use crate::scene::Scene;
use crate::settings::{OnlyStrategy, Settings};
use async_trait::async_trait;

/// Progressive renderer of the CPU reference.
pub struct ReferenceRenderer<'s> {
    reference: Reference<'s>,
    settings: ReferenceSettings,
    region: Crop,
    /// The samples so far.
    pub rounds: Rounds,
    batch_size: BatchSize,
}

impl<'s> ReferenceRenderer<'s> {
    /// Prepares the scene for ray tracing.
    pub fn new(scene: &'s Scene, settings: &Settings) -> Self {
        let region = settings.region();
        let settings = ReferenceSettings::of(settings);
        let rounds = Rounds::starting_at(settings, region, 0);
        Self { reference: Reference::new(scene), settings, region, rounds, batch_size: BatchSize::default() }
    }

    /// Turns to a picture of light that is scattered at most once, without samples.
    pub fn of_direct_light(mut self) -> Self {
        self.settings.bounces = Some(0);
        self.restart(self.settings.seed);
        self
    }

    /// Returns the number of the next sample.
    fn next(&self) -> u64 {
        self.rounds.range().end.into()
    }
}

#[async_trait(?Send)]
impl Renderer for ReferenceRenderer<'_> {
    async fn render_async(&mut self, samples: u64, progress: &mut dyn FnMut(u64) -> bool) -> Result<(), RenderError> {
        let end = self.next() + samples;
        while self.next() < end {
            let count = self.batch_size.next(end - self.next());
            let began = Instant::now();
            self.rounds.add(&self.reference, count as u32, &|_, _| ());
            self.batch_size.record(count, began.elapsed());
            if !progress(self.next()) {
                break;
            }
        }
        Ok(())
    }

    fn restart(&mut self, seed: u32) {
        self.settings.seed = seed;
        self.rounds = Rounds::starting_at(self.settings, self.region, 0);
    }

    fn begin_at(&mut self, first: u64) -> Result<(), RenderError> {
        self.rounds = Rounds::starting_at(self.settings, self.region, first as u32);
        Ok(())
    }

    async fn state_async(&self) -> Result<RenderState, RenderError> {
        let range = self.rounds.range();
        let sums: Vec<u8> = self.rounds.sums().iter().flatten().flat_map(|sum| sum.to_le_bytes()).collect();
        Ok(RenderState {
            first: range.start.into(),
            next: range.end.into(),
            non_finite: self.rounds.non_finite,
            buffers: vec![sums],
            ..RenderState::default()
        })
    }

    fn restore(&mut self, state: &RenderState) -> Result<(), RenderError> {
        let [sums] = state.buffers.as_slice() else { return Err(RenderError::foreign_state()) };
        let value = |bytes: &[u8]| bytes.try_into().map(f64::from_le_bytes).unwrap_or_default();
        let sums =
            sums.chunks_exact(24).map(|pixel| std::array::from_fn(|c| value(&pixel[8 * c..8 * c + 8]))).collect();
        let range = state.first as u32..state.next as u32;
        self.rounds =
            Rounds::from_sums(self.settings, self.region, range, sums).ok_or_else(RenderError::foreign_state)?;
        self.rounds.non_finite = state.non_finite;
        Ok(())
    }

    /// Of strategies, the reference has what the camera sees emit: (0, 2).
    fn set_only(&mut self, only: Option<OnlyStrategy>) -> Result<(), RenderError> {
        if only.is_some_and(|only| (only.s, only.t) != (0, 2)) {
            return Err(RenderError::Setting("the reference has no strategies; use another method".to_owned()));
        }
        self.reference.scatter(only.is_none());
        self.restart(self.settings.seed);
        Ok(())
    }

    fn mark_converged(&mut self, _: &[bool]) -> Result<(), RenderError> {
        Err(RenderError::Setting("the reference has no adaptive sampling".to_owned()))
    }

    fn is_adaptive(&self) -> bool {
        false
    }

    async fn film_async(&self) -> Result<Film, RenderError> {
        Ok(self.rounds.film())
    }

    fn samples(&self) -> u64 {
        self.next()
    }

    fn stats(&self) -> RenderStats {
        let non_finite = self.rounds.non_finite;
        RenderStats { samples: self.rounds.samples().into(), non_finite, ..RenderStats::default() }
    }
}
