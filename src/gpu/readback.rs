//! Read-back of buffers from the device.

use super::{Gpu, GpuError};

/// Label of staging buffers in the ledger.
pub(super) const LABEL: &str = "read back";

/// Copies the first `count` elements of a buffer to the CPU, after waiting for all submitted work.
///
/// # Errors
/// [`GpuError`] if the device fails.
pub fn read_back<T: bytemuck::Pod>(gpu: &Gpu, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
    let bytes = (count * size_of::<T>()) as u64;
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let padded = bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT);
    let staging = gpu.buffer(&wgpu::BufferDescriptor {
        label: Some(LABEL),
        size: padded,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, padded);
    gpu.queue.submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., |_| {});
    let polled = gpu.device.poll(wgpu::PollType::wait_indefinitely());
    gpu.check()?;
    polled.map_err(|e| GpuError::Device(e.to_string()))?;
    let view = staging.get_mapped_range(..bytes).map_err(|e| GpuError::Device(e.to_string()))?;
    Ok(bytemuck::pod_collect_to_vec(&view[..]))
}
