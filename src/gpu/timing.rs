//! Measures device time per pass with timestamp queries, when asked to. Times stay zero if the adapter has none.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{Gpu, GpuError, read_back_async};

/// Runs of passes that a query set times: two timestamps each, of at most 4096 (WebGPU's limit).
const RUNS_OF_SET: usize = 2048;

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

#[derive(Default)]
struct State {
    /// Query sets, as many as a batch has needed so far.
    sets: Vec<wgpu::QuerySet>,
    /// Runs that were timed since the last collection, in the order of the sets' queries.
    pending: Vec<&'static str>,
    totals: BTreeMap<&'static str, PassTime>,
}

/// Collects the device times of passes.
pub struct Timings {
    /// Makes query sets, if the adapter has timestamps.
    device: Option<wgpu::Device>,
    millis_per_tick: f64,
    asked: AtomicBool,
    state: Mutex<State>,
}

impl Timings {
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue, available: bool) -> Self {
        Self {
            device: available.then(|| device.clone()),
            millis_per_tick: f64::from(queue.get_timestamp_period()) * 1e-6,
            asked: AtomicBool::new(false),
            state: Mutex::default(),
        }
    }

    /// Begins or ends to time passes. It is off at first: between two timestamps a device finishes a pass before the
    /// next begins, and the times are read after each batch. Runs are counted all the time.
    pub fn measure(&self, on: bool) {
        self.asked.store(on, Ordering::Relaxed);
    }

    /// Counts a run of a pass and returns the indices of its timestamps, or None if passes are not timed.
    pub(super) fn begin(&self, label: &'static str) -> Option<Writes> {
        let mut guard = self.state.lock().ok()?;
        let State { sets, pending, totals } = &mut *guard;
        totals.entry(label).or_default().runs += 1;
        let device = self.device.as_ref().filter(|_| self.asked.load(Ordering::Relaxed))?;
        let (set, index) = (pending.len() / RUNS_OF_SET, pending.len() % RUNS_OF_SET);
        if set == sets.len() {
            sets.push(device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timings"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * RUNS_OF_SET as u32,
            }));
        }
        pending.push(label);
        let begin = 2 * index as u32;
        Some(Writes { set: sets[set].clone(), begin, end: begin + 1 })
    }

    /// Reads the timestamps of all submitted passes and adds their times to the totals.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails.
    pub async fn collect(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let taken = self.state.lock().map(|mut s| (std::mem::take(&mut s.pending), s.sets.clone()));
        let Ok((pending, sets)) = taken else { return Ok(()) };
        for (labels, set) in pending.chunks(RUNS_OF_SET).zip(&sets) {
            let count = 2 * labels.len();
            let resolved = gpu.ledger.buffer(
                &gpu.device,
                &wgpu::BufferDescriptor {
                    label: Some("timings"),
                    size: 8 * count as u64,
                    usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                },
            );
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            encoder.resolve_query_set(set, 0..count as u32, &resolved, 0);
            gpu.queue.submit([encoder.finish()]);
            let ticks: Vec<u64> = read_back_async(gpu, &resolved, count).await?;
            if let Ok(mut state) = self.state.lock() {
                for (label, pair) in labels.iter().zip(ticks.chunks_exact(2)) {
                    let millis = pair[1].saturating_sub(pair[0]) as f64 * self.millis_per_tick;
                    state.totals.entry(label).or_default().gpu_millis += millis;
                }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A GPU finishes thousands of runs between two collections.
    #[test]
    fn every_run_of_a_long_batch_is_timed() {
        let Ok(gpu) = Gpu::new() else {
            assert!(std::env::var_os("REQUIRE_GPU").is_none());
            return println!("skipped: no device");
        };
        gpu.timings.measure(true);
        for run in 0..2 * RUNS_OF_SET + 1 {
            let writes = gpu.timings.begin("pass");
            assert_eq!(writes.is_some(), gpu.capabilities.timestamps);
            assert!(writes.is_none_or(|w| (w.begin, w.end) == (2 * (run % RUNS_OF_SET) as u32, w.begin + 1)));
        }
    }
}
