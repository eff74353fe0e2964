//! The window's own device: draws the interface, and recovers from the loss of the surface or the device.
//!
//! This is the only module besides [`crate::gpu`] that calls wgpu, since egui has its own pipelines.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use egui_wgpu::{RendererOptions, ScreenDescriptor};
use winit::window::Window;

/// An error that prevents drawing to the window.
#[derive(Clone, Debug, thiserror::Error)]
#[error("the window cannot be drawn to: {0}")]
pub struct ScreenError(String);

/// Result of drawing a frame of the interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawn {
    /// The frame is presented.
    Shown,
    /// The window cannot be drawn to at present, for example because it is minimized.
    NotNow,
    /// The device is lost and a new screen is needed.
    Lost,
}

/// A frame of the interface.
pub struct Interface<'a> {
    /// Clipped triangle meshes.
    pub jobs: &'a [egui::ClippedPrimitive],
    /// Textures to create, update or free.
    pub textures: &'a mut egui::TexturesDelta,
    /// Pixels per point.
    pub pixels_per_point: f32,
}

/// The window's surface and device.
pub struct Screen {
    window: Arc<Window>,
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    device: wgpu::Device,
    queue: wgpu::Queue,
    config: wgpu::SurfaceConfiguration,
    renderer: egui_wgpu::Renderer,
    lost: Arc<AtomicBool>,
}

impl Screen {
    /// Opens a device that can present to the window.
    ///
    /// # Errors
    /// Returns the driver's message if there is no suitable device or surface.
    pub fn new(window: &Arc<Window>) -> Result<Self, ScreenError> {
        let failed = |e: &dyn std::fmt::Display| ScreenError(e.to_string());
        let descriptor = wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        };
        let instance = wgpu::Instance::new(descriptor.with_env());
        let surface = instance.create_surface(Arc::clone(window)).map_err(|e| failed(&e))?;
        let options = wgpu::RequestAdapterOptions { compatible_surface: Some(&surface), ..Default::default() };
        let adapter = pollster::block_on(instance.request_adapter(&options)).map_err(|e| failed(&e))?;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("interface"),
            required_limits: wgpu::Limits::default().using_resolution(adapter.limits()),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).map_err(|e| failed(&e))?;
        let lost = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            log::warn!("the window's device was lost ({reason:?}): {message}");
            flag.store(true, Ordering::Relaxed);
        });
        let flag = Arc::clone(&lost);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            log::error!("the window's device: {error}");
            flag.store(true, Ordering::Relaxed);
        }));
        let size = window.inner_size();
        let mut config = surface
            .get_default_config(&adapter, size.width.max(1), size.height.max(1))
            .ok_or_else(|| ScreenError("the adapter does not support it".to_owned()))?;
        let formats = surface.get_capabilities(&adapter).formats;
        // egui blends in encoded sRGB, so the format must not convert.
        let plain = [wgpu::TextureFormat::Bgra8Unorm, wgpu::TextureFormat::Rgba8Unorm];
        config.format = plain.into_iter().find(|f| formats.contains(f)).unwrap_or(config.format);
        config.present_mode = wgpu::PresentMode::AutoVsync;
        config.desired_maximum_frame_latency = 1;
        surface.configure(&device, &config);
        let renderer = egui_wgpu::Renderer::new(&device, config.format, RendererOptions::default());
        Ok(Self { window: Arc::clone(window), instance, surface, device, queue, config, renderer, lost })
    }

    /// Returns the largest width or height of a texture.
    #[must_use]
    pub fn max_texture_side(&self) -> usize {
        self.device.limits().max_texture_dimension_2d as usize
    }

    /// Draws the interface. A minimized or just resized window is not an error.
    pub fn draw(&mut self, interface: Interface) -> Drawn {
        for (id, deltas) in interface.textures.set.drain() {
            for delta in deltas {
                self.renderer.update_texture(&self.device, &self.queue, id, &delta);
            }
        }
        let drawn = self.draw_frame(&interface);
        for id in interface.textures.free.drain() {
            self.renderer.free_texture(&id);
        }
        if self.lost.load(Ordering::Relaxed) { Drawn::Lost } else { drawn }
    }

    fn draw_frame(&mut self, interface: &Interface) -> Drawn {
        let size = self.window.inner_size();
        if size.width == 0 || size.height == 0 {
            return Drawn::NotNow;
        }
        if (size.width, size.height) != (self.config.width, self.config.height) {
            (self.config.width, self.config.height) = (size.width, size.height);
            self.surface.configure(&self.device, &self.config);
        }
        let frame = match self.surface.get_current_texture() {
            wgpu::CurrentSurfaceTexture::Success(frame) => frame,
            wgpu::CurrentSurfaceTexture::Suboptimal(frame) => frame,
            wgpu::CurrentSurfaceTexture::Outdated => {
                self.surface.configure(&self.device, &self.config);
                return Drawn::NotNow;
            }
            wgpu::CurrentSurfaceTexture::Lost => {
                // Either only the surface is lost, or the device as well. In the second case the new surface
                // fails, too.
                match self.instance.create_surface(Arc::clone(&self.window)) {
                    Ok(surface) => self.surface = surface,
                    Err(_) => return Drawn::Lost,
                }
                self.surface.configure(&self.device, &self.config);
                return Drawn::NotNow;
            }
            wgpu::CurrentSurfaceTexture::Timeout
            | wgpu::CurrentSurfaceTexture::Occluded
            | wgpu::CurrentSurfaceTexture::Validation => return Drawn::NotNow,
        };
        let view = frame.texture.create_view(&Default::default());
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("interface") });
        let screen = ScreenDescriptor {
            size_in_pixels: [self.config.width, self.config.height],
            pixels_per_point: interface.pixels_per_point,
        };
        let more = self.renderer.update_buffers(&self.device, &self.queue, &mut encoder, interface.jobs, &screen);
        {
            let mut pass = encoder
                .begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("interface"),
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: &view,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations {
                            load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                            store: wgpu::StoreOp::Store,
                        },
                    })],
                    ..Default::default()
                })
                .forget_lifetime();
            self.renderer.render(&mut pass, interface.jobs, &screen);
        }
        self.queue.submit(more.into_iter().chain([encoder.finish()]));
        self.window.pre_present_notify();
        self.queue.present(frame);
        Drawn::Shown
    }
}
