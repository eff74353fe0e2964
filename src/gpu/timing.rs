//! Measures device time per pass with timestamp queries, when asked to. Times stay zero if the adapter has none.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Gpu, GpuError, Ledger, read_back_async};

/// Most runs of passes that can be timed between two collections.
const CAPACITY: u32 = 2048;

/// Device time and runs of one pass.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct PassTime {
    /// Milliseconds on the device, summed over timed runs.
    pub gpu_millis: f64,
    /// Number of runs.
    pub runs: u64,
}

/// The query set and the indices of a pass's two timestamps.
pub struct Writes {
    pub(super) set: wgpu::QuerySet,
    pub(super) begin: u32,
    pub(super) end: u32,
}

struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    millis_per_tick: f64,
}

#[derive(Default)]
struct State {
    pending: Vec<&'static str>,
    totals: BTreeMap<&'static str, PassTime>,
}

/// Collects the device times of passes.
pub struct Timings {
    queries: Option<Queries>,
    asked: AtomicBool,
    state: Mutex<State>,
}

impl Timings {
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue, ledger: &Ledger, available: bool) -> Self {
        let queries = available.then(|| Queries {
            set: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timings"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * CAPACITY,
            }),
            resolved: ledger.buffer(
                device,
                &wgpu::BufferDescriptor {
                    label: Some("timings"),
                    size: 16 * u64::from(CAPACITY),
                    usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                },
            ),
            millis_per_tick: f64::from(queue.get_timestamp_period()) * 1e-6,
        });
        Self { queries, asked: AtomicBool::new(false), state: Mutex::default() }
    }

    /// Begins or ends to time passes. It is off at first: between two timestamps a device finishes a pass before the
    /// next begins, and the times are read after each batch. Runs are counted all the time.
    pub fn measure(&self, on: bool) {
        self.asked.store(on, Ordering::Relaxed);
    }

    /// Counts a run of a pass and returns the indices of its timestamps, or None if passes are not timed or
    /// the query set is full.
    pub(super) fn begin(&self, label: &'static str) -> Option<Writes> {
        let mut state = self.state.lock().ok()?;
        state.totals.entry(label).or_default().runs += 1;
        let queries = self.queries.as_ref().filter(|_| self.asked.load(Ordering::Relaxed))?;
        let index = state.pending.len() as u32;
        if index == CAPACITY {
            return None;
        }
        state.pending.push(label);
        Some(Writes { set: queries.set.clone(), begin: 2 * index, end: 2 * index + 1 })
    }

    /// Reads the timestamps of all submitted passes and adds their times to the totals.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails.
    pub async fn collect(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let Some(queries) = &self.queries else { return Ok(()) };
        let pending = self.state.lock().map(|mut s| std::mem::take(&mut s.pending)).unwrap_or_default();
        if pending.is_empty() {
            return Ok(());
        }
        let count = 2 * pending.len();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.resolve_query_set(&queries.set, 0..count as u32, &queries.resolved, 0);
        gpu.queue.submit([encoder.finish()]);
        let ticks: Vec<u64> = read_back_async(gpu, &queries.resolved, count).await?;
        if let Ok(mut state) = self.state.lock() {
            for (label, pair) in pending.iter().zip(ticks.chunks_exact(2)) {
                state.totals.entry(label).or_default().gpu_millis +=
                    pair[1].saturating_sub(pair[0]) as f64 * queries.millis_per_tick;
            }
        }
        Ok(())
    }

    /// Returns the totals by pass since the device was opened or since [`Self::reset`].
    #[must_use]
    pub fn totals(&self) -> BTreeMap<&'static str, PassTime> {
        self.state.lock().map(|s| s.totals.clone()).unwrap_or_default()
    }

    /// Sets all totals to zero.
    pub fn reset(&self) {
        if let Ok(mut state) = self.state.lock() {
            state.totals.clear();
        }
    }
}
