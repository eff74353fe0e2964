//! A photographer's studio as an environment: a uniform grey room with three soft boxes.
//!
//! For a camera that looks along -Z, the key light stands to the left of the camera, the fill light to its
//! right, the rim light behind the subject. Their strengths follow the usual three-point lighting; the grey
//! room fills shadows and is visible in reflections.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::scene::{EnvironmentMap, Rows};

/// Texels of the map: the soft boxes' edges are ten degrees wide.
const SIZE: [u32; 2] = [256, 128];

/// A round soft box.
struct SoftBox {
    /// Azimuth from +Z towards +X and elevation, degrees.
    at: [f32; 2],
    /// Angles from the centre, in degrees, between which the radiance falls to zero.
    radius: [f32; 2],
    /// Radiance.
    radiance: f32,
}

const BOXES: [SoftBox; 3] = [
    SoftBox { at: [-45.0, 45.0], radius: [20.0, 35.0], radiance: 7.0 },
    SoftBox { at: [65.0, 20.0], radius: [15.0, 40.0], radiance: 1.6 },
    SoftBox { at: [170.0, 55.0], radius: [10.0, 30.0], radiance: 4.0 },
];

/// Radiance of the room in the zenith, at the horizon and in the nadir.
const CEILING: f32 = 0.8;
const WALLS: f32 = 0.22;
const FLOOR: f32 = 0.14;

/// Bakes the studio into a map of white light; the irradiance on a surface that faces the camera is about pi.
#[must_use]
pub fn map() -> EnvironmentMap {
    let [width, height] = SIZE;
    let texel = |i: u32| {
        let theta = PI * ((i / width) as f32 + 0.5) / height as f32;
        let phi = TAU * ((i % width) as f32 + 0.5) / width as f32;
        let towards = Vec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin());
        [radiance(towards); 3]
    };
    EnvironmentMap { width, height, texels: (0..width * height).map(texel).collect(), rows: Rows::Centred }
}

fn radiance(towards: Vec3) -> f32 {
    let end = if towards.y < 0.0 { FLOOR } else { CEILING };
    let room = WALLS + (end - WALLS) * smoothstep(0.0, 0.8, towards.y.abs());
    let boxes: f32 = BOXES
        .iter()
        .map(|soft_box| {
            let [azimuth, elevation] = soft_box.at.map(f32::to_radians);
            let middle = Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
            let [inner, outer] = soft_box.radius;
            soft_box.radiance * (1.0 - smoothstep(inner, outer, towards.angle_between(middle).to_degrees()))
        })
        .sum();
    room + boxes
}

/// Returns 0 below `from`, 1 above `to`, and a cubic in between.
fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three-point lighting has its key light on the left. The values are the irradiance over pi of surfaces
    /// that face the camera, the sides, up and down.
    #[test]
    fn the_key_is_on_the_left_and_shadows_are_open() {
        let map = map();
        let irradiance = |normal: Vec3| {
            let [width, height] = SIZE;
            let mut sum = 0.0;
            for (i, texel) in map.texels.iter().enumerate() {
                let theta = PI * ((i as u32 / width) as f32 + 0.5) / height as f32;
                let phi = TAU * ((i as u32 % width) as f32 + 0.5) / width as f32;
                let towards = Vec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin());
                let solid_angle = theta.sin() * (PI / height as f32) * (TAU / width as f32);
                sum += texel[0] * towards.dot(normal).max(0.0) * solid_angle;
            }
            sum / PI
        };
        let [front, left, right, up, down] = [Vec3::Z, Vec3::NEG_X, Vec3::X, Vec3::Y, Vec3::NEG_Y].map(irradiance);
        assert!((0.7..1.6).contains(&front), "{front}");
        assert!(left > 1.2 * right, "{left} {right}");
        assert!(up > left && down > 0.12 && right > 0.4, "{up} {down} {right}");
        assert!(map.texels.iter().flatten().all(|v| v.is_finite() && *v > 0.0));
    }
}
