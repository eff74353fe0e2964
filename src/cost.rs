//! What an iteration of raster takes, by a model, and the side of the squares of interleaved sampling that follows from it.
//!
//! With squares of n x n pixels an iteration has n^2 light subpaths, each with views of its own, and the filter reads n^2 pixels for each:
//!
//! T(n) = pixels + n^2 subpath                                                                                            (1)
//!
//! Where surfaces are plain, k iterations have the error of k n^2 light subpaths that all pixels share (cornell_point, n = 1 and 2: the
//! same to three digits). So a picture of m light subpaths takes m (subpath + pixels / n^2), which falls with n until light subpaths are
//! most of it. Two things end that. Beyond n^2 subpath = `MOST` pixels little is left to gain, and where geometry is fine the filter
//! joins few pixels. And the edges of things have one place within each pixel an iteration, so that a picture needs some three iterations
//! whatever n: with m = 30, beyond n = 3 an iteration only takes longer.
//!
//! Only ratios matter. The constants are of Mesa's software driver on two cores; no figures of discrete GPUs exist. Nothing is measured
//! while a picture is made: the same scene, settings and device have the same side.

/// Times that all light subpaths of an iteration may take what its pixels take. With 2 rather than 1 a light subpath takes 1.5 rather than
/// 2 times of what it takes at best.
const MOST: f64 = 2.0;

/// Largest side: a Cornell box of diffuse walls has a rel_mse of 0.002 after 15 to 50 light subpaths, in least time with a side of 3 (4 takes
/// 1.1 times as long in cornell_point and 1.17 times in cornell_area), and as soon as with 4 one of 0.0007. Metals with narrow lobes need some 240 for 0.02, since lobes are widened until enough samples
/// have come (cornell_glossy).
const LARGEST: u32 = 3;
const LARGEST_OF_METALS: u32 = 6;

/// Nanoseconds of a texel of a view: its list is emptied. cornell_point, 512x512: 1.3 ms for the 82,000 texels of four views.
const TEXEL: f64 = 16.0;

/// Nanoseconds of a triangle in a view: set up and put into lists. Sponza, 262,000 triangles: 154 ms in five views, beside their texels;
/// `displaced_room` of 400,000 and 1,000,000: 137 ns.
const TRIANGLE: f64 = 120.0;

/// Nanoseconds of what is recorded for a light subpath, whatever its size.
const SUBPATH: f64 = 500_000.0;

/// Nanoseconds of a pixel that the filter reads. cornell_point, 512x512, sides of 3 to 8: about 0.3 of an extension.
const TAP: f64 = 13.0;

/// Nanoseconds of a pixel: what it sees and where its light is kept. cornell_point, 512x512: 13 ms.
const PIXEL: f64 = 50.0;

/// Nanoseconds of a connection. cornell_point: 47 ms for six.
const CONNECTION: f64 = 30.0;

/// Nanoseconds of an extension along a bundle. cornell_point: 22 ms for two.
const EXTENSION: f64 = 42.0;

/// How much longer look-ups and hits take for each doubling of triangles beyond those of a Cornell box. Between `displaced_room` of 10,000
/// to 1,000,000 triangles (3.1 to 5.3 times as long: 0.29) and Sponza, which has lobes as well (7.4 times: 0.22).
const DOUBLING: f64 = 0.22;
const FEW_TRIANGLES: u64 = 32;

/// How much longer they take where surfaces have lobes. cornell_glossy against cornell_point: 226 and 119 ms.
const GLOSSY: f64 = 1.9;

/// Nanoseconds of a triangle in the G-buffer, beside views. Sponza: 60 to 80 ms.
const DRAWN: f64 = 250.0;

/// Pixels of a class that fill a software device, and a GPU (an H100 runs 270,000 threads, most others fewer than 100,000).
const FILLS_SOFTWARE: u64 = 1 << 12;
const FILLS_GPU: u64 = 1 << 16;

/// What an iteration has to do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Triangles of the scene.
    pub triangles: u64,
    /// Views that a light subpath fills, and their texels.
    pub views: u64,
    /// See [`Self::views`].
    pub texels: u64,
    /// Pixels that are followed.
    pub pixels: u64,
    /// Connections of a pixel.
    pub connections: u64,
    /// Extensions of a pixel.
    pub extensions: u64,
    /// Whether surfaces have lobes.
    pub glossy: bool,
    /// Whether metals have narrow ones.
    pub narrow_metals: bool,
    /// Whether pixels of a square are joined by the filter.
    pub filtered: bool,
    /// Whether the device is a software driver.
    pub software: bool,
}

/// What it takes, in nanoseconds of Mesa's software driver on two cores.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Cost {
    /// For each light subpath: its views, and the pixels that filters read more.
    pub subpath: f64,
    /// For all pixels, whatever the number of light subpaths.
    pub pixels: f64,
    /// Largest side whose classes fill the device.
    pub fills: u32,
    /// Largest side that a picture gains by.
    pub gains: u32,
}

impl Cost {
    /// By the model.
    #[must_use]
    pub fn new(work: &Work) -> Self {
        let count = |n: u64| n as f64;
        let taps = if work.filtered { TAP * count(work.pixels) } else { 0.0 };
        let views = TEXEL * count(work.texels) + TRIANGLE * count(work.triangles * work.views);
        let doublings = (work.triangles / FEW_TRIANGLES).max(1).ilog2();
        let mut slower = 1.0 + DOUBLING * f64::from(doublings);
        slower *= if work.glossy { GLOSSY } else { 1.0 };
        let pixel = PIXEL + CONNECTION * count(work.connections) + EXTENSION * count(work.extensions);
        let filling = if work.software { FILLS_SOFTWARE } else { FILLS_GPU };
        Self {
            subpath: SUBPATH + views + taps,
            pixels: slower * pixel * count(work.pixels) + DRAWN * count(work.triangles),
            fills: count(work.pixels / filling).sqrt().max(1.0) as u32,
            gains: if work.narrow_metals { LARGEST_OF_METALS } else { LARGEST },
        }
    }

    /// The side of squares.
    #[must_use]
    pub fn side(&self) -> u32 {
        let even = (MOST * self.pixels / self.subpath).sqrt();
        (even as u32).min(self.fills).min(self.gains).max(1)
    }

    /// Of a light subpath, as a share of that of all pixels.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.subpath / self.pixels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// cornell_point, 512x512.
    const BOX: Work = Work {
        triangles: 32,
        views: 4,
        texels: 2 * 6 * 64 * 64 + 2 * 128 * 128,
        pixels: 512 * 512,
        connections: 6,
        extensions: 2,
        glossy: false,
        narrow_metals: false,
        filtered: true,
        software: true,
    };

    #[test]
    fn the_model_is_what_was_measured() {
        let near = |model: f64, millis: f64| (0.7..1.4).contains(&(model / (1e6 * millis)));
        let cost = Cost::new(&BOX);
        assert!(near(cost.pixels, 85.0) && near(cost.subpath, 5.2), "{cost:?}");
        let sponza = Work { triangles: 262_000, views: 5, texels: 1_570_000, connections: 7, glossy: true, ..BOX };
        let cost = Cost::new(&sponza);
        assert!(near(cost.pixels, 640.0) && near(cost.subpath, 180.0), "{cost:?}");
    }

    #[test]
    fn sides_follow_what_views_and_pixels_take() {
        let side = |work: Work| Cost::new(&work).side();
        assert_eq!(side(BOX), 3);
        assert_eq!(side(Work { glossy: true, narrow_metals: true, ..BOX }), 6);
        let fine = [1_000, 100_000, 1_000_000].map(|triangles| side(Work { triangles, ..BOX }));
        assert_eq!(fine, [3, 3, 1]);
        let small = [16, 64, 128, 192].map(|n| side(Work { pixels: n * n, ..BOX }));
        assert_eq!(small, [1, 1, 2, 3]);
        // A GPU is filled by more.
        let small = [128, 256, 512, 1024].map(|n| side(Work { pixels: n * n, software: false, ..BOX }));
        assert_eq!(small, [1, 1, 2, 3]);
    }
}
