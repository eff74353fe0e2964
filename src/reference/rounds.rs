//! Progressive rendering with the reference.

use std::ops::Range;

use super::{Reference, ReferenceSettings};
use crate::crop::Crop;
use crate::film::Film;

/// The mean of all samples so far, bit for bit the same as if they were rendered in one round.
pub struct Rounds {
    settings: ReferenceSettings,
    /// The pixels of the image that are rendered.
    region: Crop,
    sum: Vec<[f64; 3]>,
    /// Number of the first sample in the sequence, and of the next one.
    range: Range<u32>,
    /// Number of paths whose radiance was not finite.
    pub non_finite: u64,
    /// Number of rays traced.
    pub rays: u64,
}

impl Rounds {
    /// Creates a picture without samples. `settings.samples` is not used.
    #[must_use]
    pub fn new(settings: ReferenceSettings) -> Self {
        Self::starting_at(settings, Crop::whole(settings.width, settings.height), 0)
    }

    /// Creates a picture of a part of the image without samples that begins with the sample `first` of the sequence,
    /// from 0.
    #[must_use]
    pub fn starting_at(settings: ReferenceSettings, region: Crop, first: u32) -> Self {
        let pixels = region.width as usize * region.height as usize;
        Self { settings, region, sum: vec![[0.0; 3]; pixels], range: first..first, non_finite: 0, rays: 0 }
    }

    /// Creates the picture of the samples `range`, whose sum of each pixel is known. None if there is another
    /// number of pixels.
    #[must_use]
    pub fn from_sums(settings: ReferenceSettings, region: Crop, range: Range<u32>, sum: Vec<[f64; 3]>) -> Option<Self> {
        let whole = sum.len() == region.width as usize * region.height as usize;
        whole.then_some(Self { settings, region, sum, range, non_finite: 0, rays: 0 })
    }

    /// Returns the sum of each pixel's samples.
    #[must_use]
    pub fn sums(&self) -> &[[f64; 3]] {
        &self.sum
    }

    /// Returns the samples of the sequence in the picture.
    #[must_use]
    pub fn range(&self) -> Range<u32> {
        self.range.clone()
    }

    /// Returns the number of samples per pixel so far.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.range.end - self.range.start
    }

    /// Adds samples to each pixel. `progress` receives the numbers of finished and of all pixels, from any
    /// thread.
    pub fn add(&mut self, reference: &Reference, samples: u32, progress: &(dyn Fn(u64, u64) + Sync)) {
        let range = self.range.end..self.range.end + samples;
        let [non_finite, rays] = reference.add_range(&self.settings, self.region, &range, &mut self.sum, progress);
        self.range.end = range.end;
        self.non_finite += non_finite;
        self.rays += rays;
    }

    /// Returns the picture so far; black without samples.
    #[must_use]
    pub fn film(&self) -> Film {
        let count = f64::from(self.samples().max(1));
        let pixels = self.sum.iter().map(|s| s.map(|v| (v / count) as f32)).collect();
        Film { width: self.region.width, height: self.region.height, pixels }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn rounds_are_the_picture_of_all_their_samples() {
        let scene = builtin::load("cornell_area").unwrap();
        let reference = Reference::new(&scene);
        let settings = ReferenceSettings {
            width: 12,
            height: 8,
            samples: 7,
            bounces: Some(2),
            specular_bounces: 8,
            seed: 3,
            camera: 0,
        };
        let whole = reference.render(&settings, &|_, _| ());
        let mut rounds = Rounds::new(settings);
        assert_eq!(rounds.film(), Film::new(12, 8));
        for samples in [1, 2, 4] {
            rounds.add(&reference, samples, &|_, _| ());
        }
        assert_eq!((rounds.samples(), rounds.rays), (7, whole.rays));
        assert_eq!(rounds.film(), whole.film, "sums have one order");
        let region = Crop { x: 5, y: 2, width: 4, height: 3 };
        let mut part = Rounds::starting_at(settings, region, 0);
        part.add(&reference, 7, &|_, _| ());
        assert_eq!(part.film(), whole.film.clone().cropped(Some(region)), "a part has the pixels of the whole");
        let other = reference.render(&ReferenceSettings { seed: 4, ..settings }, &|_, _| ());
        assert_ne!(other.film, whole.film, "samples do differ");
    }
}
