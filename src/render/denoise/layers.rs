//! The layers of a frame in one buffer: clear light, indirect light, and gradients (shaders/lib/pixels/denoise.wesl).

use crate::gpu::Binding;

/// Bytes of an element.
const ELEMENT: u64 = 16;

/// Bytes that parts of the buffer begin at multiples of.
const ALIGNMENT: u64 = 16 * ELEMENT;

/// The parts of the buffer, in bytes.
pub(super) struct Layers {
    indirect: u64,
    gradients: u64,
    end: u64,
}

impl Layers {
    /// Returns the parts for pixels of the image, pixels of the layers, and squares that have gradients.
    pub(super) fn new(image: u64, layer: u64, squares: u64) -> Self {
        let indirect = (image * ELEMENT).next_multiple_of(ALIGNMENT);
        let gradients = indirect + (layer * 2 * ELEMENT).next_multiple_of(ALIGNMENT);
        Self { indirect, gradients, end: gradients + squares * ELEMENT }
    }

    /// Returns the size of the buffer in bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.end
    }

    /// Returns the binding of clear light.
    pub(super) fn clear<'a>(&self, buffer: &'a wgpu::Buffer) -> Binding<'a> {
        ("clear", part(buffer, 0, self.indirect))
    }

    /// Returns the binding of indirect light under a name.
    pub(super) fn indirect<'a>(&self, name: &'a str, buffer: &'a wgpu::Buffer) -> Binding<'a> {
        (name, part(buffer, self.indirect, self.gradients - self.indirect))
    }
}

fn part(buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset, size: wgpu::BufferSize::new(bytes) })
}
