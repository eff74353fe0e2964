//! Counts all requests to wgpu: pipelines, buffers, textures and acceleration structures by label, draws and
//! dispatches by pass.
//!
//! Every request of this program to wgpu passes through the ledger. Tests compare a plan with it, and
//! regression tests count work instead of measuring time.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};

use super::pipelines::Functions;

/// Work that was recorded by one pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Recorded {
    /// Draws, direct and indirect.
    pub draws: u64,
    /// Dispatches.
    pub dispatches: u64,
    /// Workgroups of these dispatches together.
    pub workgroups: u64,
}

/// Memory that was allocated under one label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Allocated {
    /// Buffers or textures.
    pub count: u64,
    /// Their bytes together; for textures the bytes of their texels.
    pub bytes: u64,
}

impl Allocated {
    fn add(&mut self, bytes: u64) {
        self.count += 1;
        self.bytes += bytes;
    }
}

/// All requests since the device was opened or since [`Ledger::reset`]. Freed resources stay counted.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Number of requests for each pipeline by label; the device creates each pipeline once.
    pub pipelines: BTreeMap<String, u64>,
    /// Functions of these pipelines' shaders, by label, as far as they are linked.
    #[serde(skip)]
    pub functions: BTreeMap<String, BTreeSet<String>>,
    /// Recorded work by label of the pass.
    pub passes: BTreeMap<String, Recorded>,
    /// Buffers by label. Staging buffers that the CPU reads are labelled `read back`.
    pub buffers: BTreeMap<String, Allocated>,
    /// Textures by label.
    pub textures: BTreeMap<String, Allocated>,
    /// Number of acceleration structures by label. Drivers do not report their size.
    pub acceleration_structures: BTreeMap<String, u64>,
}

impl Counts {
    /// Sums the draws, dispatches and workgroups of all passes.
    #[must_use]
    pub fn recorded(&self) -> Recorded {
        self.passes.values().fold(Recorded::default(), |sum, pass| Recorded {
            draws: sum.draws + pass.draws,
            dispatches: sum.dispatches + pass.dispatches,
            workgroups: sum.workgroups + pass.workgroups,
        })
    }

    /// Sums the bytes of all buffers and textures except staging buffers of read-back, which are temporary.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let lasting = self.buffers.iter().filter(|(label, _)| *label != super::readback::LABEL);
        lasting.chain(&self.textures).map(|(_, allocated)| allocated.bytes).sum()
    }
}

/// The counts of a device, which several threads may update.
#[derive(Default)]
pub struct Ledger(Mutex<State>);

#[derive(Default)]
struct State {
    /// All counts but the functions.
    counts: Counts,
    /// Functions of the pipelines, by label.
    functions: BTreeMap<String, Vec<Functions>>,
}

impl Ledger {
    /// Returns the counts so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let Ok(state) = self.0.lock() else { return Counts::default() };
        let linked = |all: &Vec<Functions>| all.iter().filter_map(|f| f.get()).flatten().cloned().collect();
        let functions = state.functions.iter().map(|(label, all)| (label.clone(), linked(all))).collect();
        Counts { functions, ..state.counts.clone() }
    }

    /// Sets all counts to zero.
    pub fn reset(&self) {
        if let Ok(mut state) = self.0.lock() {
            *state = State::default();
        }
    }

    pub(super) fn buffer(&self, device: &wgpu::Device, descriptor: &wgpu::BufferDescriptor) -> wgpu::Buffer {
        self.write(|counts| entry(&mut counts.buffers, descriptor.label).add(descriptor.size));
        device.create_buffer(descriptor)
    }

    pub(super) fn texture(&self, device: &wgpu::Device, descriptor: &wgpu::TextureDescriptor) -> wgpu::Texture {
        let levels = (0..descriptor.mip_level_count).filter_map(|level| descriptor.mip_level_size(level));
        let bytes = levels.map(|size| descriptor.format.theoretical_memory_footprint(size)).sum();
        self.write(|counts| entry(&mut counts.textures, descriptor.label).add(bytes));
        device.create_texture(descriptor)
    }

    pub(super) fn pipeline(&self, label: &str, functions: &Functions) {
        let Ok(mut state) = self.0.lock() else { return };
        *entry(&mut state.counts.pipelines, Some(label)) += 1;
        let all = entry(&mut state.functions, Some(label));
        if !all.iter().any(|known| Arc::ptr_eq(known, functions)) {
            all.push(Arc::clone(functions));
        }
    }

    pub(super) fn acceleration_structure(&self, label: Option<&str>) {
        self.write(|counts| *entry(&mut counts.acceleration_structures, label) += 1);
    }

    pub(super) fn draw(&self, label: &str) {
        self.write(|counts| entry(&mut counts.passes, Some(label)).draws += 1);
    }

    pub(super) fn dispatch(&self, label: &str, workgroups: [u32; 3]) {
        self.write(|counts| {
            let pass = entry(&mut counts.passes, Some(label));
            pass.dispatches += 1;
            pass.workgroups += workgroups.map(u64::from).iter().product::<u64>();
        });
    }

    fn write(&self, change: impl FnOnce(&mut Counts)) {
        if let Ok(mut state) = self.0.lock() {
            change(&mut state.counts);
        }
    }
}

fn entry<'a, T: Default>(map: &'a mut BTreeMap<String, T>, label: Option<&str>) -> &'a mut T {
    map.entry(label.unwrap_or("unnamed").to_owned()).or_default()
}
