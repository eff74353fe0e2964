//! A model of the time of an iteration, and the side of the squares of interleaved sampling that follows from
//! it.
//!
//! With squares of n x n pixels an iteration has n^2 light subpaths, each with its own views, and the filter
//! reads n^2 pixels for each pixel. The time of an iteration is
//!
//!   T(n) = pixels + n^2 subpath.                                                                 (1)
//!
//! On smooth surfaces, k iterations have the same error as k n^2 light subpaths that all pixels share
//! (cornell_point, n = 1 and 2: equal to three digits). A picture of m light subpaths therefore takes m
//! (subpath + pixels / n^2), which falls with n until light subpaths dominate. Two limits bound n. Beyond n^2
//! subpath = `MOST` pixels the gain is small, and the filter averages few pixels of fine geometry. Further,
//! an iteration has one position within the pixel, so antialiased edges need about three iterations for any
//! n: with m = 30, a side beyond n = 3 only makes iterations longer.
//!
//! Pixels of a class lie n apart, so that their rays and look-ups touch more of a GPU's caches: there `pixels` grows
//! with n, too.
//!
//! Only ratios matter. The times of a unit of work were measured with Mesa's software driver on two cores and on an
//! H100 (`UnitTimes`). Nothing is measured during a render, so that the same scene, settings and device have the same
//! side.

/// Largest ratio of the time of all light subpaths of an iteration to the time of its pixels. With 2 the time
/// per light subpath of a picture is 1.5 times the minimum, with 1 it is 2 times.
const MOST: f64 = 2.0;

/// Largest side. A diffuse Cornell box has a rel_mse of 0.002 after 15 to 50 light subpaths, in least time
/// with a side of 3; a side of 4 takes 1.1 times as long in cornell_point and 1.17 times in cornell_area. For
/// a rel_mse of 0.0007 both sides take the same time.
const LARGEST: u32 = 3;

/// Largest side for metals with narrow lobes. These need about 240 light subpaths for a rel_mse of 0.02
/// (cornell_glossy), since the roughness clamp widens their lobes until there are enough samples.
const LARGEST_OF_METALS: u32 = 6;

/// Triangles of a Cornell box.
const FEW_TRIANGLES: u64 = 32;

/// The times of units of work on a kind of device, in nanoseconds.
///
/// [`UnitTimes::SOFTWARE`] was measured pass by pass; where pixels lie apart, a ray takes 1.4 times as long as
/// measured. [`UnitTimes::GPU`] is a fit, within a factor of 1.6, to iterations of six scenes with lists and grid, one to nine
/// light subpaths (docs/results.md, "A GPU").
struct UnitTimes {
    /// Per texel of a view, whose list is cleared. cornell_point, 512x512: 1.3 ms for the 82,000 texels of four views.
    texel: f64,
    /// Per triangle of a view, for setup and lists. Sponza, 262,000 triangles: 154 ms in five views, without their
    /// texels; `displaced_room` of 400,000 and 1,000,000 triangles: 137 ns.
    triangle: f64,
    /// Per view, for passes that wait for each other.
    view: f64,
    /// Per light subpath, for recording commands and starting passes.
    subpath: f64,
    /// Per pixel that the filter reads. cornell_point, 512x512, sides of 3 to 8: about 0.3 of the time of an extension.
    tap: f64,
    /// Per pixel, for G-buffer, eye vertex and film. cornell_point, 512x512: 13 ms.
    pixel: f64,
    /// Per connection. cornell_point: 47 ms for six.
    connection: f64,
    /// Per extension along a bundle. cornell_point: 22 ms for two.
    extension: f64,
    /// Per connection by which a ray through the grid takes longer than a look-up. cornell_point: 55, `displaced_room` of
    /// 60,000 triangles: 172, living-room: 260.
    traced_connection: f64,
    /// Per extension by which a ray through the grid takes longer than a look-up. cornell_point: 62, `displaced_room`:
    /// 187, living-room: 230; in Sponza they are alike.
    traced_extension: f64,
    /// Per connection by which a ray to infinity takes longer than a look-up. Sponza: 220, and 390 where pixels lie apart.
    traced_to_infinity: f64,
    /// Per pixel by which a ray of the camera takes longer than a pixel of the G-buffer. cornell_point: 38,
    /// `displaced_room`: 210, living-room: 340, Sponza: 520.
    traced_pixel: f64,
    /// Relative increase of these for each doubling of triangles beyond [`FEW_TRIANGLES`].
    traced_doubling: f64,
    /// Per triangle of making the grid, over the iterations that use it.
    grid: f64,
    /// Relative increase of the time of look-ups and hits for each doubling of triangles beyond [`FEW_TRIANGLES`].
    /// Measured: 0.29 in `displaced_room` of 10,000 to 1,000,000 triangles (3.1 to 5.3 times as long), 0.22 in Sponza,
    /// which is glossy as well (7.4 times).
    doubling: f64,
    /// Factor of the time of look-ups and hits on glossy surfaces. cornell_glossy against cornell_point: 226 and 119 ms.
    glossy: f64,
    /// Per triangle of the G-buffer. Sponza: 60 to 80 ms.
    drawn: f64,
    /// Relative increase of the time of pixels for each step of the side.
    spread: f64,
    /// Relative increase of the additional time of rays for each step of the side.
    traced_spread: f64,
}

impl UnitTimes {
    /// Mesa's software driver on two cores.
    const SOFTWARE: Self = Self {
        texel: 16.0,
        triangle: 120.0,
        view: 0.0,
        subpath: 500_000.0,
        tap: 13.0,
        pixel: 50.0,
        connection: 30.0,
        extension: 42.0,
        traced_connection: 77.0,
        traced_extension: 87.0,
        traced_to_infinity: 105.0,
        traced_pixel: 126.0,
        traced_doubling: 0.2,
        grid: 20.0,
        doubling: 0.22,
        glossy: 1.9,
        drawn: 250.0,
        spread: 0.0,
        traced_spread: 0.0,
    };

    /// An NVIDIA H100.
    const GPU: Self = Self {
        texel: 0.1,
        triangle: 0.2,
        view: 60_000.0,
        subpath: 380_000.0,
        tap: 0.015,
        pixel: 0.42,
        connection: 0.08,
        extension: 0.28,
        traced_connection: 0.005,
        traced_extension: 0.014,
        traced_to_infinity: 0.0055,
        traced_pixel: 0.024,
        traced_doubling: 2.0,
        grid: 4.4,
        doubling: 0.03,
        glossy: 2.4,
        drawn: 1.2,
        spread: 0.15,
        traced_spread: 1.75,
    };
}

/// Least pixels of a class that occupy a software device: 24 workgroups.
const FILLS_SOFTWARE: u64 = 24 * 64;

/// Least pixels of a class that occupy a GPU. An H100 runs 270,000 threads, most others fewer than 100,000.
const FILLS_GPU: u64 = 1 << 16;

/// The amount of work of an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Work {
    /// Triangles of the scene.
    pub triangles: u64,
    /// Views that are rasterized for a light subpath.
    pub views: u64,
    /// Texels of these views.
    pub texels: u64,
    /// Pixels with eye subpaths.
    pub pixels: u64,
    /// Connections per pixel.
    pub connections: u64,
    /// Extensions per pixel.
    pub extensions: u64,
    /// Connections of these that rays answer.
    pub traced_connections: u64,
    /// Connections of these to lights, where some lights are at infinity.
    pub traced_to_infinity: u64,
    /// Extensions of these that rays answer.
    pub traced_extensions: u64,
    /// True if the camera's rays are traced, in place of a G-buffer.
    pub traces_camera: bool,
    /// True if surfaces have lobes other than the diffuse one.
    pub glossy: bool,
    /// True if metals with narrow lobes exist.
    pub narrow_metals: bool,
    /// True if the filter averages the pixels of a square.
    pub filtered: bool,
    /// True if the device is a software driver.
    pub software: bool,
}

/// The modelled time of an iteration, in nanoseconds of the kind of device (`UnitTimes`).
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Cost {
    /// Time per light subpath: its views, and the additional pixels that the filter reads.
    pub subpath: f64,
    /// Time of all pixels, for one light subpath.
    pub pixels: f64,
    /// Increase of the time of all pixels for each step of the side.
    pub spread: f64,
    /// Largest side whose classes occupy the device.
    pub fills: u32,
    /// Largest side that shortens a render.
    pub gains: u32,
}

impl Cost {
    /// Evaluates the model.
    #[must_use]
    pub fn new(work: &Work) -> Self {
        let unit = if work.software { UnitTimes::SOFTWARE } else { UnitTimes::GPU };
        let count = |n: u64| n as f64;
        let pixels = count(work.pixels);
        let taps = if work.filtered { unit.tap * pixels } else { 0.0 };
        let views =
            count(work.views) * (unit.view + unit.triangle * count(work.triangles)) + unit.texel * count(work.texels);
        let doublings = f64::from((work.triangles / FEW_TRIANGLES).max(1).ilog2());
        let slower = (1.0 + unit.doubling * doublings) * if work.glossy { unit.glossy } else { 1.0 };
        let looked_up =
            unit.pixel + unit.connection * count(work.connections) + unit.extension * count(work.extensions);
        let looked_up = slower * looked_up * pixels;
        let traced = unit.traced_connection * count(work.traced_connections - work.traced_to_infinity)
            + unit.traced_to_infinity * count(work.traced_to_infinity)
            + unit.traced_extension * count(work.traced_extensions)
            + if work.traces_camera { unit.traced_pixel } else { 0.0 };
        let traced = (1.0 + unit.traced_doubling * doublings) * traced * pixels;
        let of_scene = if work.traces_camera { unit.grid } else { unit.drawn } * count(work.triangles);
        let filling = if work.software { FILLS_SOFTWARE } else { FILLS_GPU };
        Self {
            subpath: unit.subpath + views + taps,
            pixels: looked_up + traced + of_scene,
            spread: unit.spread * looked_up + unit.traced_spread * traced,
            fills: count(work.pixels / filling).sqrt().max(1.0) as u32,
            gains: if work.narrow_metals { LARGEST_OF_METALS } else { LARGEST },
        }
    }

    /// Returns the time of all pixels with squares of a side.
    fn pixels_apart(&self, side: u32) -> f64 {
        self.pixels + self.spread * f64::from(side - 1)
    }

    /// Returns the time per light subpath of an iteration with squares of a side.
    #[must_use]
    pub fn per_subpath(&self, side: u32) -> f64 {
        self.subpath + self.pixels_apart(side) / f64::from(side * side)
    }

    /// Returns the side of the squares.
    #[must_use]
    pub fn side(&self) -> u32 {
        let gains = |&side: &u32| f64::from(side * side) * self.subpath <= MOST * self.pixels_apart(side);
        (2..=self.fills.min(self.gains)).rev().find(gains).unwrap_or(1)
    }

    /// Returns the ratio of the time of a light subpath to that of all pixels.
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
        traced_connections: 0,
        traced_to_infinity: 0,
        traced_extensions: 0,
        traces_camera: false,
        glossy: false,
        narrow_metals: false,
        filtered: true,
        software: true,
    };

    #[test]
    fn the_model_is_near_the_measurements() {
        let near = |model: f64, millis: f64| (0.7..1.4).contains(&(model / (1e6 * millis)));
        let cost = Cost::new(&BOX);
        assert!(near(cost.pixels, 85.0) && near(cost.subpath, 5.2), "{cost:?}");
        let sponza = Work { triangles: 262_000, views: 5, texels: 1_570_000, connections: 7, glossy: true, ..BOX };
        let cost = Cost::new(&sponza);
        assert!(near(cost.pixels, 640.0) && near(cost.subpath, 180.0), "{cost:?}");
    }

    /// An H100: cornell_point by lists and by rays, sides of 1 and 3.
    #[test]
    fn the_model_is_near_the_measurements_of_a_gpu() {
        let lists = Work { software: false, ..BOX };
        let rays =
            Work { views: 0, texels: 0, traced_connections: 6, traced_extensions: 2, traces_camera: true, ..lists };
        for (work, millis) in [(lists, [1.0, 5.55]), (rays, [0.70, 4.35])] {
            for (side, millis) in [1, 3].into_iter().zip(millis) {
                let model = f64::from(side * side) * Cost::new(&work).per_subpath(side);
                assert!((0.75..1.33).contains(&(model / (1e6 * millis))), "{work:?}, {side}: {model} for {millis} ms");
            }
        }
    }

    #[test]
    fn sides_follow_the_times_of_views_and_pixels() {
        let side = |work: Work| Cost::new(&work).side();
        assert_eq!(side(BOX), 3);
        assert_eq!(side(Work { glossy: true, narrow_metals: true, ..BOX }), 6);
        let fine = [1_000, 100_000, 1_000_000].map(|triangles| side(Work { triangles, ..BOX }));
        assert_eq!(fine, [3, 3, 1]);
        let small = [16, 64, 128, 192].map(|n| side(Work { pixels: n * n, ..BOX }));
        assert_eq!(small, [1, 1, 2, 3]);
        // Without views, light subpaths cost little in small pictures, too.
        assert_eq!(side(Work { views: 0, texels: 0, glossy: true, pixels: 160 * 96, ..BOX }), 3);
        // A GPU needs more pixels, since each light subpath starts passes.
        let small = [128, 256, 512, 1024].map(|n| side(Work { pixels: n * n, software: false, ..BOX }));
        assert_eq!(small, [1, 1, 1, 2]);
    }
}
