//! Heights for displacement: a map, noise, or waves, all of which may be animated.
//!
//! shaders/lib/height.wesl evaluates the same expressions in the same order. Neither uses a function whose
//! accuracy WGSL leaves open, such as `sin`, so both agree to rounding. Noise and waves are functions of the
//! rest position in the mesh's own space, before posing and placement, so that they stick to animated
//! surfaces.

use glam::{IVec2, IVec3, Vec2, Vec3};

use crate::scene::Wrap;

/// Maximum number of waves of a surface.
pub const MAX_WAVES: usize = 64;

/// Maximum number of octaves of noise.
pub const MAX_OCTAVES: u32 = 16;

/// A height function and its motion.
#[derive(Clone, Debug, PartialEq)]
pub enum Height {
    /// A height map, bilinear between texel centres, 0 to 1.
    Map {
        /// Index into the scene's height maps.
        map: usize,
        /// Texture coordinate set, 0 or 1.
        uv_set: u32,
        /// Motion of the image in units of uv per second.
        drift: Vec2,
    },
    /// A sum of value noise of doubling frequency and halving height, -1 to 1.
    Noise {
        /// Frequency of the first octave in cells per metre.
        frequency: f32,
        /// Number of octaves, 1 to [`MAX_OCTAVES`].
        octaves: u32,
        /// Seed of the hash.
        seed: u32,
        /// Motion of the noise in metres per second.
        drift: Vec3,
    },
    /// A sum of waves, metres.
    Waves(Vec<Wave>),
}

/// A sine wave along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave {
    /// Direction of propagation times cycles per metre.
    pub cycles: Vec3,
    /// Metres from the mean to a crest.
    pub amplitude: f32,
    /// Cycles per second.
    pub hertz: f32,
    /// Phase in cycles at time 0.
    pub phase: f32,
}

impl Wave {
    /// Returns a deep-water wave: crests `length` metres apart move at the speed sqrt(g length / 2 pi)
    /// (dispersion relation of gravity waves).
    #[must_use]
    pub fn on_water(direction: Vec3, length: f32, amplitude: f32) -> Self {
        let speed = (9.81 * length / std::f32::consts::TAU).sqrt();
        Self { cycles: direction.normalize_or_zero() / length, amplitude, hertz: speed / length, phase: 0.0 }
    }
}

/// A grid of heights.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightMap {
    /// Its name or path.
    pub name: String,
    /// Columns, at least 1.
    pub width: u32,
    /// Rows, at least 1.
    pub height: u32,
    /// Row-major, row 0 on top.
    pub texels: Vec<f32>,
    /// Wrap mode along u and v.
    pub wrap: [Wrap; 2],
}

impl HeightMap {
    /// Decodes the grey values of a PNG or another image, without colour conversion, to 0 to 1; 16-bit files
    /// keep their depth.
    ///
    /// # Errors
    /// Bytes that are not such an image are an error; the message is a sentence.
    pub fn decode(bytes: &[u8], name: &str, wrap: [Wrap; 2]) -> Result<Self, String> {
        let (decoded, _reserved) = crate::scene::Image::open(bytes, name, 6)?;
        let decoded = decoded.into_luma16();
        let (width, height) = decoded.dimensions();
        let texels = decoded.into_raw().into_iter().map(|v| f32::from(v) / 65535.0).collect();
        Ok(Self { name: name.to_owned(), width, height, texels, wrap })
    }

    /// Interpolates bilinearly between the four texel centres around a point.
    #[must_use]
    pub fn at(&self, uv: Vec2) -> f32 {
        let place = uv * Vec2::new(self.width as f32, self.height as f32) - 0.5;
        let cell = place.floor();
        let part = place - cell;
        let (x, y) = (cell.x as i32, cell.y as i32);
        let texel = |x: i32, y: i32| {
            let at = IVec2::new(wrapped(x, self.width, self.wrap[0]), wrapped(y, self.height, self.wrap[1]));
            self.texels[(at.y * self.width as i32 + at.x) as usize]
        };
        let upper = mix(texel(x, y), texel(x.wrapping_add(1), y), part.x);
        let lower = mix(texel(x, y.wrapping_add(1)), texel(x.wrapping_add(1), y.wrapping_add(1)), part.x);
        mix(upper, lower, part.y)
    }
}

/// Applies the wrap mode to a texel index, which may lie outside 0 to n - 1.
fn wrapped(i: i32, n: u32, wrap: Wrap) -> i32 {
    let n = n as i32;
    match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirror => {
            let i = i.rem_euclid(2 * n);
            i.min(2 * n - 1 - i)
        }
        Wrap::Clamp => i.clamp(0, n - 1),
    }
}

fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// Returns the sine of an angle given in turns, by its Taylor series on [-1/4, 1/4] turns; the error is at
/// most 4e-6.
#[must_use]
pub fn sine_of_turns(turns: f32) -> f32 {
    let t = turns - (turns + 0.5).floor();
    // Reflecting at a quarter turn maps t to [-1/4, 1/4] without changing the sine.
    let folded = if t.abs() > 0.25 { 0.5_f32.copysign(t) - t } else { t };
    let x = folded * std::f32::consts::TAU;
    let x2 = x * x;
    x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0 + x2 * (1.0 / 362_880.0)))))
}

/// Returns a random value in [0, 1) for a lattice point: the first component of pcg3d (Jarzynski and Olano,
/// "Hash Functions for GPU Rendering", 2020).
fn corner(cell: IVec3, seed: u32) -> f32 {
    let mut v = [cell.x as u32, cell.y as u32, (cell.z as u32) ^ seed]
        .map(|v| v.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    for _ in 0..2 {
        v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[2]));
        v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
        v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
        v = v.map(|v| v ^ v >> 16);
    }
    (v[0] >> 8) as f32 / 16_777_216.0
}

/// Evaluates value noise in [0, 1] with continuous second derivatives (Perlin's fade of 2002).
#[must_use]
pub fn noise(place: Vec3, seed: u32) -> f32 {
    let floor = place.floor();
    let t = place - floor;
    let fade = t * t * t * (t * (t * 6.0 - Vec3::splat(15.0)) + Vec3::splat(10.0));
    let cell = floor.as_ivec3();
    let at = |x: i32, y: i32, z: i32| corner(cell.wrapping_add(IVec3::new(x, y, z)), seed);
    let along_x = |y: i32, z: i32| mix(at(0, y, z), at(1, y, z), fade.x);
    mix(mix(along_x(0, 0), along_x(1, 0), fade.y), mix(along_x(0, 1), along_x(1, 1), fade.y), fade.z)
}

/// Sums octaves of noise at a position in cells of the first octave.
fn octaves(mut place: Vec3, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut height, mut total) = (0.0, 1.0, 0.0);
    for octave in 0..octaves {
        sum += height * (2.0 * noise(place, seed.wrapping_add(octave)) - 1.0);
        total += height;
        height *= 0.5;
        place *= 2.0;
    }
    sum / total
}

impl Height {
    /// Validates all values except the map's index.
    ///
    /// A value out of range is an error; the message names the valid range.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::Map { drift, .. } if !drift.is_finite() => {
                Err(format!("the drift {drift} of the height map has to be two finite numbers"))
            }
            Self::Noise { frequency, drift, .. } if !(drift.is_finite() && *frequency > 0.0 && *frequency <= 1e6) => {
                Err(format!(
                    "noise of {frequency} cells a metre that moves by {drift}: the first has to be above 0 and at most 1000000, the \
                     second finite"
                ))
            }
            Self::Noise { octaves, .. } if !(1..=MAX_OCTAVES).contains(octaves) => {
                Err(format!("noise cannot have {octaves} octaves: 1 to {MAX_OCTAVES} are possible"))
            }
            Self::Waves(waves) if !(1..=MAX_WAVES).contains(&waves.len()) => {
                Err(format!("there are {} waves: 1 to {MAX_WAVES} are possible", waves.len()))
            }
            Self::Waves(waves) => {
                let fine = |w: &Wave| {
                    let numbers = w.cycles.to_array().into_iter().chain([w.amplitude, w.hertz, w.phase]);
                    numbers.into_iter().all(|v| v.abs() <= 1e6)
                };
                match waves.iter().position(|w| !fine(w)) {
                    Some(i) => {
                        Err(format!("wave {i}: its length has to be above 0, and all its values at most 1000000"))
                    }
                    None => Ok(()),
                }
            }
            _ => Ok(()),
        }
    }

    /// Returns the index of the height map, if this is one.
    #[must_use]
    pub fn map(&self) -> Option<usize> {
        if let Self::Map { map, .. } = self { Some(*map) } else { None }
    }

    /// Returns true if the height changes with time.
    #[must_use]
    pub fn moves(&self) -> bool {
        match self {
            Self::Map { drift, .. } => *drift != Vec2::ZERO,
            Self::Noise { drift, .. } => *drift != Vec3::ZERO,
            Self::Waves(waves) => waves.iter().any(|w| w.hertz != 0.0),
        }
    }

    /// Freezes the animation at a time in seconds: returns the same height function without motion.
    #[must_use]
    pub fn at(&self, seconds: f32) -> Self {
        // The fraction is taken in f64, before precision is lost.
        let turned = |rate: f32| (f64::from(rate) * f64::from(seconds)).rem_euclid(1.0) as f32;
        match self {
            Self::Map { map, uv_set, drift } => {
                Self::Map { map: *map, uv_set: *uv_set, drift: Vec2::new(turned(drift.x), turned(drift.y)) }
            }
            Self::Noise { frequency, octaves, seed, drift } => Self::Noise {
                frequency: *frequency,
                octaves: *octaves,
                seed: *seed,
                drift: *drift * seconds * *frequency,
            },
            Self::Waves(waves) => {
                Self::Waves(waves.iter().map(|w| Wave { phase: w.phase - turned(w.hertz), hertz: 0.0, ..*w }).collect())
            }
        }
    }

    /// Evaluates a height that [`Self::at`] returned, at a rest position in the mesh's own space and its
    /// texture coordinates.
    #[must_use]
    pub fn height(&self, maps: &[HeightMap], rest: Vec3, uvs: [Vec2; 2]) -> f32 {
        match self {
            Self::Map { map, uv_set, drift } => maps[*map].at(uvs[*uv_set as usize & 1] - *drift),
            Self::Noise { frequency, octaves: count, seed, drift } => {
                octaves(rest * *frequency - *drift, *count, *seed)
            }
            Self::Waves(waves) => {
                let mut sum = 0.0;
                for w in waves {
                    let turns = w.cycles.x * rest.x + w.cycles.y * rest.y + w.cycles.z * rest.z + w.phase;
                    sum += w.amplitude * sine_of_turns(turns);
                }
                sum
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_are_sines() {
        for i in -1000..1000 {
            let turns = i as f32 * 0.00377;
            let expected = (f64::from(turns) * std::f64::consts::TAU).sin();
            assert!((f64::from(sine_of_turns(turns)) - expected).abs() < 6e-6, "{turns}");
        }
    }

    #[test]
    fn noise_goes_through_its_corners_without_steps() {
        let (mut least, mut most) = (1.0_f32, 0.0_f32);
        for i in 0..2000 {
            let place = Vec3::new(0.013, 0.0071, -0.0093) * i as f32;
            let here = noise(place, 3);
            assert!((here - noise(place + Vec3::splat(1e-3), 3)).abs() < 1e-2);
            (least, most) = (least.min(here), most.max(here));
        }
        assert!(least >= 0.0 && most <= 1.0 && most - least > 0.5, "{least} {most}");
        assert_eq!(noise(Vec3::new(3.0, -2.0, 7.0), 5), corner(IVec3::new(3, -2, 7), 5));
        assert_ne!(noise(Vec3::splat(0.5), 5), noise(Vec3::splat(0.5), 6));
    }

    #[test]
    fn maps_are_bilinear_and_wrapped() {
        let map =
            |wrap| HeightMap { name: String::new(), width: 2, height: 1, texels: vec![0.0, 1.0], wrap: [wrap; 2] };
        for (wrap, at) in [(Wrap::Clamp, [0.0, 1.0]), (Wrap::Repeat, [0.5, 0.5]), (Wrap::Mirror, [0.0, 1.0])] {
            let map = map(wrap);
            assert_eq!([0.0, 1.0].map(|u| map.at(Vec2::new(u, 0.3))), at, "{wrap:?}");
            assert_eq!([0.25, 0.5, 0.75].map(|u| map.at(Vec2::new(u, 0.3))), [0.0, 0.5, 1.0], "{wrap:?}");
        }
    }
}
