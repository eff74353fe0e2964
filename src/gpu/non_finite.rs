//! Finds the pass that wrote a value that is not finite: if enabled, a check scans the output of each compute
//! pass.
//!
//! The shader's declarations tell which words are floats, so passes need no code for the check. If it is
//! disabled, it has no pass, no pipeline and no buffer.

use std::collections::BTreeMap;
use std::sync::Mutex;

use super::{Compute, Gpu, GpuError, read_back_async};

/// Number of passes with a count of their own; further passes share the last one.
const SLOTS: usize = 64;

/// Most 32-bit words of an element, and the words of its bit mask.
const MOST_WORDS: u32 = 256;
const MASK_WORDS: usize = MOST_WORDS as usize / 32;

/// Most workgroups of a check; each scans elements in strides.
const MOST_GROUPS: u64 = 4096;

/// The words of an element that are floats.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Floats {
    words: u32,
    mask: [u32; MASK_WORDS],
}

impl Floats {
    /// Finds the floats of a storage variable's type. None if it has no floats, or elements of more than
    /// [`MOST_WORDS`].
    pub(super) fn of(module: &naga::Module, variable: naga::Handle<naga::Type>) -> Option<Self> {
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).ok()?;
        let (element, bytes) = match module.types[variable].inner {
            naga::TypeInner::Array { base, stride, .. } => (base, stride),
            _ => (variable, layouter[variable].to_stride()),
        };
        let mut found = Vec::new();
        mark(module, element, 0, &mut found);
        let words = bytes / 4;
        if found.is_empty() || words > MOST_WORDS {
            return None;
        }
        let mut mask = [0; MASK_WORDS];
        found.into_iter().for_each(|word| mask[word as usize / 32] |= 1 << (word % 32));
        Some(Self { words, mask })
    }
}

/// Collects the words of a type that are floats; the type begins at word `at`.
fn mark(module: &naga::Module, of: naga::Handle<naga::Type>, at: u32, found: &mut Vec<u32>) {
    let float = |scalar: naga::Scalar| scalar.kind == naga::ScalarKind::Float;
    match &module.types[of].inner {
        naga::TypeInner::Scalar(scalar) if float(*scalar) => found.push(at),
        naga::TypeInner::Vector { size, scalar } if float(*scalar) => found.extend(at..at + *size as u32),
        naga::TypeInner::Matrix { columns, rows, .. } => {
            let stride = if *rows == naga::VectorSize::Bi { 2 } else { 4 };
            (0..*columns as u32).for_each(|c| found.extend(at + c * stride..at + c * stride + *rows as u32));
        }
        naga::TypeInner::Struct { members, .. } => {
            members.iter().for_each(|m| mark(module, m.ty, at + m.offset / 4, found));
        }
        naga::TypeInner::Array { base, size: naga::ArraySize::Constant(count), stride } => {
            (0..count.get()).for_each(|i| mark(module, *base, at + i * stride / 4, found));
        }
        _ => {}
    }
}

/// The state of an enabled check.
struct Watch {
    pass: Compute,
    counts: wgpu::Buffer,
    /// Labels by slot.
    labels: Vec<&'static str>,
    /// Constants of the check of each binding, by label of the pass and by name of the binding.
    constants: BTreeMap<(&'static str, String), wgpu::Buffer>,
}

/// Counts values that are not finite, by pass.
#[derive(Default)]
pub struct NonFinite(Mutex<Option<Watch>>);

impl NonFinite {
    /// Enables the check of every compute pass from now on, with counts at zero, or disables it and drops the
    /// counts.
    pub fn watch(&self, gpu: &Gpu, on: bool) {
        let watch = on.then(|| Watch {
            pass: Compute::new(gpu, "gpu/non_finite", &[]),
            counts: gpu.storage("non_finite", 4 * SLOTS as u64),
            labels: Vec::new(),
            constants: BTreeMap::new(),
        });
        if let Ok(mut state) = self.0.lock() {
            *state = watch;
        }
    }

    /// Returns the number of values that were not finite by pass, in the order in which the passes first ran.
    /// Passes propagate such values, so the first pass with a count above zero is their source. Empty if the
    /// check is disabled.
    ///
    /// # Errors
    /// [`GpuError::Device`] if the device fails.
    pub async fn counts_async(&self, gpu: &Gpu) -> Result<Vec<(&'static str, u64)>, GpuError> {
        let watched =
            self.0.lock().ok().and_then(|state| Some((state.as_ref()?.counts.clone(), state.as_ref()?.labels.clone())));
        let Some((counts, labels)) = watched else { return Ok(Vec::new()) };
        let counts: Vec<u32> = read_back_async(gpu, &counts, SLOTS).await?;
        Ok(labels.into_iter().zip(counts.into_iter().map(u64::from)).collect())
    }

    /// Waits for [`Self::counts_async`].
    ///
    /// # Errors
    /// As [`Self::counts_async`].
    #[cfg(not(target_family = "wasm"))]
    pub fn counts(&self, gpu: &Gpu) -> Result<Vec<(&'static str, u64)>, GpuError> {
        pollster::block_on(self.counts_async(gpu))
    }

    /// Records the check of all buffers that a pass wrote.
    pub(super) fn record(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        label: &'static str,
        written: &BTreeMap<String, Floats>,
        bindings: super::Bindings,
    ) {
        if written.is_empty() {
            return;
        }
        let Ok(mut state) = self.0.lock() else { return };
        let Some(watch) = state.as_mut() else { return };
        let slot = watch.labels.iter().position(|l| *l == label).unwrap_or_else(|| {
            watch.labels.push(label);
            watch.labels.len() - 1
        });
        for (name, floats) in written {
            let resource = bindings.iter().find(|(given, _)| given == name).map(|(_, resource)| resource);
            let Some(wgpu::BindingResource::Buffer(bound)) = resource else { continue };
            // Shaders with one label may differ in the layout of a binding.
            let key = (label, format!("{name} {floats:?}"));
            let constants = watch.constants.entry(key).or_insert_with(|| {
                let head = [floats.words, slot.min(SLOTS - 1) as u32];
                gpu.upload("non_finite constants", &[head.as_slice(), &floats.mask].concat())
            });
            let words = bound.size.map_or(bound.buffer.size() - bound.offset, u64::from) / 4;
            let groups = words.div_ceil(64 * 16).clamp(1, MOST_GROUPS) as u32;
            let bindings = [
                ("watch", constants.as_entire_binding()),
                ("words", wgpu::BindingResource::Buffer(bound.clone())),
                ("non_finite", watch.counts.as_entire_binding()),
            ];
            watch.pass.record(gpu, encoder, [64 * groups, 1], &bindings);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floats_are_found_by_their_declaration() {
        let source = "
            struct Inner { n: u32, v: vec2f }
            struct Outer { position: vec3f, id: u32, inner: array<Inner, 2>, turn: mat3x3f, end: f32 }
            @group(0) @binding(0) var<storage, read_write> outer: array<Outer>;
            @group(0) @binding(1) var<storage, read_write> ids: array<atomic<u32>>;
            @group(0) @binding(2) var<storage, read_write> one: Inner;
            @group(0) @binding(3) var<storage, read_write> pixels: array<vec4f>;";
        let module = naga::front::wgsl::parse_str(source).unwrap();
        let of = |name: &str| {
            let variable = module.global_variables.iter().find(|(_, v)| v.name.as_deref() == Some(name)).unwrap().1;
            Floats::of(&module, variable.ty).map(|f| {
                (f.words, (0..f.words).filter(|w| f.mask[*w as usize / 32] >> (w % 32) & 1 == 1).collect::<Vec<_>>())
            })
        };
        // Inner takes 4 words, and its vector begins at word 2. The matrix has columns of 4 words.
        assert_eq!(of("outer"), Some((28, vec![0, 1, 2, 6, 7, 10, 11, 12, 13, 14, 16, 17, 18, 20, 21, 22, 24])));
        assert_eq!(of("one"), Some((4, vec![2, 3])));
        assert_eq!(of("pixels"), Some((4, vec![0, 1, 2, 3])));
        assert_eq!(of("ids"), None);
    }
}
