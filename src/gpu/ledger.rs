//! What wgpu was really asked for: pipelines, buffers, textures and acceleration structures by label, draws and dispatches by
//! pass.
//!
//! Every request of ours to wgpu goes through here, so that a test can hold a plan against the device's own account of it, and a
//! regression guard can count work where clocks are not to be trusted.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

/// Work that one pass recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Recorded {
    /// Draws, direct and indirect.
    pub draws: u64,
    /// Dispatches.
    pub dispatches: u64,
    /// Workgroups of these dispatches.
    pub workgroups: u64,
}

/// Memory that was asked for under one label.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Allocated {
    /// Buffers or textures.
    pub count: u64,
    /// Their bytes together; textures count as many as their texels have.
    pub bytes: u64,
}

impl Allocated {
    fn add(&mut self, bytes: u64) {
        self.count += 1;
        self.bytes += bytes;
    }
}

/// Everything asked for since the device was opened or [`Ledger::reset`]. What was freed again stays counted.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Pipelines by label, with how often they were asked for; the device makes each once.
    pub pipelines: BTreeMap<String, u64>,
    /// Functions of the shaders that these pipelines were made from, by label.
    #[serde(skip)]
    pub functions: BTreeMap<String, BTreeSet<String>>,
    /// Passes by label.
    pub passes: BTreeMap<String, Recorded>,
    /// Buffers by label. Copies that the CPU reads are called `read back`.
    pub buffers: BTreeMap<String, Allocated>,
    /// Textures by label.
    pub textures: BTreeMap<String, Allocated>,
    /// Acceleration structures by label, with how many were created; their size is the driver's secret.
    pub acceleration_structures: BTreeMap<String, u64>,
}

impl Counts {
    /// Draws, dispatches and workgroups of all passes.
    #[must_use]
    pub fn recorded(&self) -> Recorded {
        self.passes.values().fold(Recorded::default(), |sum, pass| Recorded {
            draws: sum.draws + pass.draws,
            dispatches: sum.dispatches + pass.dispatches,
            workgroups: sum.workgroups + pass.workgroups,
        })
    }

    /// Bytes of all buffers and textures, but those that are made anew whenever the CPU reads something back.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let lasting = self.buffers.iter().filter(|(label, _)| *label != super::readback::LABEL);
        lasting.chain(&self.textures).map(|(_, allocated)| allocated.bytes).sum()
    }
}

/// Keeps [`Counts`].
#[derive(Default)]
pub struct Ledger(Mutex<Counts>);

impl Ledger {
    /// What was asked for so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.0.lock().map(|counts| counts.clone()).unwrap_or_default()
    }

    /// Forgets all of it.
    pub fn reset(&self) {
        self.write(|counts| *counts = Counts::default());
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

    pub(super) fn pipeline(&self, label: &str, functions: &BTreeSet<String>) {
        self.write(|counts| {
            *entry(&mut counts.pipelines, Some(label)) += 1;
            entry(&mut counts.functions, Some(label)).extend(functions.iter().cloned());
        });
    }

    pub(super) fn acceleration_structure(&self, label: Option<&str>) {
        self.write(|counts| *entry(&mut counts.acceleration_structures, label) += 1);
    }

    pub(super) fn draw(&self, label: &str) {
        self.write(|counts| entry(&mut counts.passes, Some(label)).draws += 1);
    }

    pub(super) fn dispatch(&self, label: &str, workgroups: [u32; 2]) {
        self.write(|counts| {
            let pass = entry(&mut counts.passes, Some(label));
            pass.dispatches += 1;
            pass.workgroups += u64::from(workgroups[0]) * u64::from(workgroups[1]);
        });
    }

    fn write(&self, change: impl FnOnce(&mut Counts)) {
        if let Ok(mut counts) = self.0.lock() {
            change(&mut counts);
        }
    }
}

fn entry<'a, T: Default>(map: &'a mut BTreeMap<String, T>, label: Option<&str>) -> &'a mut T {
    map.entry(label.unwrap_or("unnamed").to_owned()).or_default()
}
