//! The first vertex of each pixel.

pub mod borders;
pub mod eye_vertices;
pub mod gbuffer;

/// Format of the depth target, which the passes share.
const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// The value of pixels that show no triangle: all ones.
const NO_TRIANGLE: wgpu::Color =
    wgpu::Color { r: u32::MAX as f64, g: u32::MAX as f64, b: u32::MAX as f64, a: u32::MAX as f64 };
