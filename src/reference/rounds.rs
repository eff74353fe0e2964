//! A picture by the reference that grows round by round.

use super::{Reference, ReferenceSettings};
use crate::film::Film;

/// The mean of all samples so far: the same bytes, but for rounding, as of one round of as many.
pub struct Rounds {
    settings: ReferenceSettings,
    sum: Vec<[f64; 3]>,
    samples: u32,
    /// Paths whose radiance was not finite.
    pub non_finite: u64,
    /// Rays traced.
    pub rays: u64,
}

impl Rounds {
    /// A picture without samples. `settings.samples` has no meaning here.
    #[must_use]
    pub fn new(settings: ReferenceSettings) -> Self {
        let pixels = settings.width as usize * settings.height as usize;
        Self { settings, sum: vec![[0.0; 3]; pixels], samples: 0, non_finite: 0, rays: 0 }
    }

    /// Samples of each pixel so far.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Adds samples to each pixel. `progress` hears how many of how many pixels are done, from any thread.
    pub fn add(&mut self, reference: &Reference, samples: u32, progress: &(dyn Fn(u64, u64) + Sync)) {
        let output = reference.render_range(&self.settings, self.samples..self.samples + samples, progress);
        for (sum, pixel) in self.sum.iter_mut().zip(&output.film.pixels) {
            (0..3).for_each(|c| sum[c] += f64::from(pixel[c]) * f64::from(samples));
        }
        self.samples += samples;
        self.non_finite += output.non_finite;
        self.rays += output.rays;
    }

    /// The picture so far; black where there are no samples.
    #[must_use]
    pub fn film(&self) -> Film {
        let count = f64::from(self.samples.max(1));
        let pixels = self.sum.iter().map(|s| s.map(|v| (v / count) as f32)).collect();
        Film { width: self.settings.width, height: self.settings.height, pixels }
    }
}
