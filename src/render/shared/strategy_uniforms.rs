//! Constants of a strategy on the device, for each light.

use crate::gpu::Gpu;
use crate::render::layouts;
use crate::render::shared::plan::MOST_DIRECT_LIGHTS;

/// Bytes from a light's constants to those of the next: a part of a uniform begins at a multiple of this.
const STRIDE: u64 = 256;

/// Uniforms of a strategy.
pub struct StrategyUniforms {
    buffer: wgpu::Buffer,
    lights: u64,
}

impl StrategyUniforms {
    /// Uploads the constants, the same for a number of lights.
    #[must_use]
    pub fn new(gpu: &Gpu, constants: &layouts::Strategy, lights: u32) -> Self {
        let buffer = gpu.storage("strategy", MOST_DIRECT_LIGHTS as u64 * STRIDE);
        let lights = u64::from(lights);
        (0..lights).for_each(|n| gpu.queue.write_buffer(&buffer, n * STRIDE, bytemuck::bytes_of(constants)));
        Self { buffer, lights }
    }

    /// Returns the constants for a light; all lights share the first ones if no more were asked for.
    #[must_use]
    pub fn of(&self, light: u32) -> wgpu::BindingResource<'_> {
        let offset = STRIDE * u64::from(light).min(self.lights - 1);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.buffer,
            offset,
            size: wgpu::BufferSize::new(STRIDE),
        })
    }

    /// Returns the constants for all lights.
    #[must_use]
    pub fn all(&self) -> wgpu::BindingResource<'_> {
        self.buffer.as_entire_binding()
    }

    /// Writes the samples of strategy s = 1 that MIS counts for a light.
    pub fn write_light_samples(&self, gpu: &Gpu, light: u32, samples: f32) {
        let at = std::mem::offset_of!(layouts::Strategy, sample_counts) + size_of::<f32>();
        if u64::from(light) < self.lights {
            gpu.queue.write_buffer(&self.buffer, STRIDE * u64::from(light) + at as u64, bytemuck::bytes_of(&samples));
        }
    }

    /// Writes the number of light points of an iteration, which dark lights do not have.
    pub fn write_light_points(&self, gpu: &Gpu, count: u32) {
        let at = std::mem::offset_of!(layouts::Strategy, light_points);
        gpu.queue.write_buffer(&self.buffer, at as u64, bytemuck::bytes_of(&count));
    }
}
