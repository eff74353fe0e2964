//! Read-back of buffers from the device.

use std::sync::{Arc, Mutex};
use std::task::{Poll, Waker};

use super::{Gpu, GpuError};

/// Label of staging buffers in the ledger.
pub(super) const LABEL: &str = "read back";

/// Waits for [`read_back_async`].
///
/// # Errors
/// As [`read_back_async`].
#[cfg(not(target_family = "wasm"))]
pub fn read_back<T: bytemuck::Pod>(gpu: &Gpu, buffer: &wgpu::Buffer, count: usize) -> Result<Vec<T>, GpuError> {
    pollster::block_on(read_back_async(gpu, buffer, count))
}

/// Copies the first `count` elements of a buffer to the CPU, after all submitted work.
///
/// In a browser the future is woken when the copy is there. Elsewhere nothing wakes it: the first poll waits for
/// the device, and is the only one.
///
/// # Errors
/// [`GpuError`] if the device fails.
pub async fn read_back_async<T: bytemuck::Pod>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    count: usize,
) -> Result<Vec<T>, GpuError> {
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
    let mapping = Mapping::default();
    staging.map_async(wgpu::MapMode::Read, .., mapping.callback());
    let polled = gpu.device.poll(wgpu::PollType::wait_indefinitely());
    gpu.check()?;
    polled.map_err(|e| GpuError::Device(e.to_string()))?;
    let mapped = mapping.done().await;
    gpu.check()?;
    mapped.map_err(|e| GpuError::Device(e.to_string()))?;
    let view = staging.get_mapped_range(..bytes).map_err(|e| GpuError::Device(e.to_string()))?;
    let elements = bytemuck::pod_collect_to_vec(&view[..]);
    drop(view);
    // A browser would keep the memory until its next collection.
    staging.destroy();
    Ok(elements)
}

/// A buffer that is being mapped.
#[derive(Clone, Default)]
struct Mapping(Arc<Mutex<MappingState>>);

#[derive(Default)]
struct MappingState {
    result: Option<Result<(), wgpu::BufferAsyncError>>,
    waker: Option<Waker>,
}

impl Mapping {
    /// Returns what the device calls with the result.
    fn callback(&self) -> impl FnOnce(Result<(), wgpu::BufferAsyncError>) + wgpu::WasmNotSend + 'static {
        let this = self.clone();
        move |mapped| {
            let Ok(mut state) = this.0.lock() else { return };
            state.result = Some(mapped);
            if let Some(waker) = state.waker.take() {
                waker.wake();
            }
        }
    }

    /// Waits for the result.
    async fn done(&self) -> Result<(), wgpu::BufferAsyncError> {
        std::future::poll_fn(|context| {
            let Ok(mut state) = self.0.lock() else { return Poll::Ready(Err(wgpu::BufferAsyncError)) };
            match state.result.take() {
                Some(mapped) => Poll::Ready(mapped),
                None => {
                    state.waker = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }
}
