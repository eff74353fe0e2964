//! What an iteration of raster takes, by a model, and the side of the squares of interleaved sampling that follows from it.
//!
//! With squares of n x n pixels an iteration has n^2 light subpaths, each with views of its own, and the filter reads n^2 pixels for each:
//!
//! T(n) = pixels + n^2 subpath                                                                                                        (1)
//!
//! The error of k iterations is that of k n^2 light subpaths that all pixels share (cornell_point, n = 1 and 2: the same to three digits),
//! so that a light subpath takes T(n) / n^2 = subpath + pixels / n^2. That falls with n for ever, but a picture also needs some four
//! iterations for the edges of things, which have one place within each pixel an iteration. n = sqrt(pixels / subpath) is
//! between the two: light subpaths take twice of what they would take at best, iterations twice of what they take without interleaving.
//!
//! Only ratios matter. The constants are of Mesa's software driver; no figures of discrete GPUs exist. Nothing is measured while a picture
//! is made: the same scene, settings and device have the same side.

/// Nanoseconds of a texel of a view: its list is emptied. cornell_point, 512x512: 1.3 ms for the 82,000 texels of four views.
const TEXEL: f64 = 16.0;

/// Nanoseconds of a triangle in a view: set up and put into lists. Sponza, 262,000 triangles: 154 ms in five views, beside their texels;
/// `displaced_room` of 400,000 and 1,000,000: 137 ns.
const TRIANGLE: f64 = 120.0;

/// Nanoseconds of what is recorded for a light subpath, whatever its size.
const SUBPATH: f64 = 500_000.0;

/// Nanoseconds of a pixel that the filter reads. cornell_point, 512x512, sides of 3 to 8: 0.12 to 0.16 of an extension.
const TAP: f64 = 13.0;

/// Nanoseconds of a pixel: what it sees and where its light is kept. cornell_point, 512x512: 13 ms.
const PIXEL: f64 = 50.0;

/// Nanoseconds of a connection. cornell_point: 47 ms for six.
const CONNECTION: f64 = 30.0;

/// Nanoseconds of an extension along a bundle. cornell_point: 22 ms for two.
const EXTENSION: f64 = 42.0;

/// How much longer look-ups and hits take for each doubling of triangles beyond those of a Cornell box. `displaced_room` of 10,000 to
/// 1,000,000 triangles: 3.1 to 5.3 times as long.
const DOUBLING: f64 = 0.3;
const FEW_TRIANGLES: u64 = 32;

/// How much longer they take where surfaces have textures (Sponza) and lobes (cornell_glossy).
const TEXTURED: f64 = 1.5;
const GLOSSY: f64 = 1.9;

/// Nanoseconds of a triangle in the G-buffer, beside views. Sponza: 60 to 80 ms.
const DRAWN: f64 = 250.0;

/// Pixels of a class that fill a software device, and a GPU (an H100 runs 270,000 threads, most others fewer than 100,000).
const FILLS_SOFTWARE: u64 = 1 << 12;
const FILLS_GPU: u64 = 1 << 16;

/// Largest side that is chosen.
const LARGEST: u32 = 8;

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
    /// Whether surfaces have textures.
    pub textured: bool,
    /// Whether surfaces have lobes.
    pub glossy: bool,
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
        slower *= if work.textured { TEXTURED } else { 1.0 };
        slower *= if work.glossy { GLOSSY } else { 1.0 };
        let pixel = PIXEL + CONNECTION * count(work.connections) + EXTENSION * count(work.extensions);
        let filling = if work.software { FILLS_SOFTWARE } else { FILLS_GPU };
        Self {
            subpath: SUBPATH + views + taps,
            pixels: slower * pixel * count(work.pixels) + DRAWN * count(work.triangles),
            fills: count(work.pixels / filling).sqrt().clamp(1.0, LARGEST.into()) as u32,
        }
    }

    /// The side with which light subpaths and pixels take about as long, if its classes fill the device.
    #[must_use]
    pub fn side(&self) -> u32 {
        let even = (self.pixels / self.subpath).sqrt().round().clamp(1.0, LARGEST.into());
        (even as u32).min(self.fills)
    }

    /// Of a light subpath, as a share of that of all pixels.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.subpath / self.pixels
    }
}
