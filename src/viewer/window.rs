//! The window: passes winit's events to egui and requests to the render thread, and displays its pictures.
//!
//! No call waits for a picture. Each turn of the event loop handles the pending events, draws the interface
//! once and sleeps.

use std::sync::Arc;
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::{LogicalSize, PhysicalSize};
use winit::event::{ElementState, MouseButton, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::{Window, WindowId};

use super::render_thread::{RenderThread, open};
use super::request::Command;
use super::screen::{Drawn, Interface as Painting, Screen};
use super::state::{Launch, State};
use super::ui::{Action, Interface, file_of, style};

/// Minimum size of the window, points.
const LEAST: LogicalSize<f64> = LogicalSize::new(320.0, 200.0);
/// Delay before drawing to a window is tried again after a failure.
const AGAIN: Duration = Duration::from_millis(100);

/// An error that prevents a window.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// No display is available, or it reported an error.
    #[error("no window can be opened: {0}; `lightsheaf render` needs none")]
    Display(String),
}

/// Event that announces new results in the render thread's outbox.
#[derive(Debug)]
struct Wake;

/// Opens a window of the given size in pixels and returns after it is closed.
///
/// # Errors
/// Returns [`WindowError`] if there is no display.
pub fn run(launch: Launch, size: [u32; 2]) -> Result<(), WindowError> {
    let failed = |e: &dyn std::fmt::Display| WindowError::Display(e.to_string());
    let events = EventLoop::<Wake>::with_user_event().build().map_err(|e| failed(&e))?;
    let proxy = events.create_proxy();
    let mut app = App::new(launch, size, &proxy);
    events.run_app(&mut app).map_err(|e| failed(&e))?;
    log::info!("longest wait of an input: {:.1} ms", app.waits.longest.as_secs_f64() * 1e3);
    app.failed.map_or(Ok(()), |cause| Err(WindowError::Display(cause)))
}

/// Measures the latency from an input event to the frame that shows its effect.
#[derive(Default)]
struct Waits {
    /// Earliest time at which events that the loop now handles can have arrived.
    since: Option<Instant>,
    /// Time at which the loop last polled for events.
    looked: Option<Instant>,
    /// Arrival time and kind of the oldest input that is not displayed yet.
    oldest: Option<(Instant, &'static str)>,
    longest: Duration,
}

impl Waits {
    /// Records that the loop polls for events after it slept since `slept`. If it slept less than a
    /// millisecond or not at all, the events may have arrived at any time since the previous poll.
    fn poll(&mut self, slept: Option<Instant>) {
        let now = Instant::now();
        let awake = slept.is_none_or(|slept| now - slept < Duration::from_millis(1));
        self.since = if awake { self.looked.or(Some(now)) } else { Some(now) };
        self.looked = Some(now);
    }

    fn input(&mut self, what: &'static str) {
        let since = self.since.unwrap_or_else(Instant::now);
        self.oldest.get_or_insert((since, what));
    }

    /// Records that a frame is displayed, from the times that its layout and its drawing took.
    fn shown(&mut self, laid_out: Duration, drawn: Duration) {
        if let Some((since, what)) = self.oldest.take() {
            let wait = since.elapsed();
            let [wait_millis, laid_out, drawn] = [wait, laid_out, drawn].map(|time| time.as_secs_f64() * 1e3);
            log::debug!("laid out in {laid_out:.1} ms, drawn in {drawn:.1} ms, {what} shown after {wait_millis:.1} ms");
            self.longest = self.longest.max(wait);
        }
    }
}

/// The open window with its device and egui.
struct View {
    window: Arc<Window>,
    screen: Option<Screen>,
    context: egui::Context,
    input: egui_winit::State,
}

struct App {
    size: [u32; 2],
    state: State,
    interface: Interface,
    render_thread: RenderThread,
    view: Option<View>,
    waits: Waits,
    drawn: Option<Instant>,
    /// Time at which the interface is to be redrawn without input.
    due: Option<Instant>,
    samples: u64,
    failed: Option<String>,
}

impl App {
    fn new(launch: Launch, size: [u32; 2], proxy: &EventLoopProxy<Wake>) -> Self {
        let proxy = proxy.clone();
        // Sending fails only after the event loop has ended.
        let wake = move || _ = proxy.send_event(Wake);
        Self {
            size,
            state: State::new(launch),
            interface: Interface::default(),
            render_thread: RenderThread::new(open, wake),
            view: None,
            waits: Waits::default(),
            drawn: None,
            due: None,
            samples: 0,
            failed: None,
        }
    }

    fn open_window(&mut self, events: &ActiveEventLoop) -> Result<View, String> {
        let attributes = Window::default_attributes()
            .with_title("Lightsheaf")
            .with_inner_size(PhysicalSize::new(self.size[0], self.size[1]))
            .with_min_inner_size(LEAST);
        let window = Arc::new(events.create_window(attributes).map_err(|e| e.to_string())?);
        let screen = Screen::new(&window).map_err(|e| e.to_string())?;
        let (context, input) = interface_of(&window, &screen, None);
        Ok(View { window, screen: Some(screen), context, input })
    }

    /// Draws a frame of the interface.
    fn draw(&mut self) {
        let Some(view) = &mut self.view else { return };
        let now = Instant::now();
        if view.screen.is_none() {
            // The device was lost: a new one needs all textures again.
            match Screen::new(&view.window) {
                Ok(screen) => {
                    (view.context, view.input) = interface_of(&view.window, &screen, Some(&view.context));
                    self.interface.forget_textures();
                    view.screen = Some(screen);
                }
                Err(error) => {
                    log::warn!("{error}");
                    self.due = Some(now + AGAIN);
                    return;
                }
            }
        }
        let Some(screen) = &mut view.screen else { return };
        let seconds = self.drawn.map_or(0.0, |drawn| (now - drawn).as_secs_f32());
        self.drawn = Some(now);
        let input = view.input.take_egui_input(&view.window);
        let (interface, state) = (&mut self.interface, &mut self.state);
        let mut actions = Vec::new();
        let mut output = view.context.run_ui(input, |ui| actions.extend(interface.show(ui, state, seconds)));
        view.input.handle_platform_output(&view.window, output.platform_output);
        for Action::Save(extension) in actions {
            let (pane, path, tonemap) = file_of(state, extension);
            self.render_thread.send(Command::Save { pane, path, tonemap });
        }
        // The request is sent before the interface is drawn, so that the render thread works meanwhile.
        if let Some(request) = state.request(now) {
            self.render_thread.send(Command::Show(Box::new(request)));
        }
        let laid_out = now.elapsed();
        let jobs = view.context.tessellate(output.shapes, output.pixels_per_point);
        let painting =
            Painting { jobs: &jobs, textures: &mut output.textures_delta, pixels_per_point: output.pixels_per_point };
        match screen.draw(painting) {
            Drawn::Shown => self.waits.shown(laid_out, now.elapsed() - laid_out),
            Drawn::NotNow => self.due = Some(now + AGAIN),
            Drawn::Lost => {
                view.screen = None;
                view.window.request_redraw();
            }
        }
        let delay = output.viewport_output.values().map(|viewport| viewport.repaint_delay).min();
        let own = delay.filter(|delay| *delay < Duration::from_secs(3600)).map(|delay| now + delay);
        self.due = [self.due.filter(|due| *due > now), own, self.state.rests_at()].into_iter().flatten().min();
    }

    fn redraw(&self) {
        if let Some(view) = &self.view {
            view.window.request_redraw();
        }
    }
}

/// Creates egui's context for a screen that has none of its textures, with the memory of the earlier context.
fn interface_of(
    window: &Arc<Window>,
    screen: &Screen,
    earlier: Option<&egui::Context>,
) -> (egui::Context, egui_winit::State) {
    let context = egui::Context::default();
    style(&context);
    if let Some(earlier) = earlier {
        let memory = earlier.memory(Clone::clone);
        context.memory_mut(|there| *there = memory);
    }
    let scale = Some(window.scale_factor() as f32);
    let side = Some(screen.max_texture_side());
    let input = egui_winit::State::new(context.clone(), egui::ViewportId::ROOT, window, scale, None, side);
    (context, input)
}

impl ApplicationHandler<Wake> for App {
    fn new_events(&mut self, _: &ActiveEventLoop, cause: StartCause) {
        self.waits.poll(match cause {
            StartCause::WaitCancelled { start, .. } | StartCause::ResumeTimeReached { start, .. } => Some(start),
            StartCause::Init | StartCause::Poll => None,
        });
    }

    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.view.is_none() {
            match self.open_window(events) {
                Ok(view) => self.view = Some(view),
                Err(cause) => {
                    self.failed = Some(cause);
                    events.exit();
                }
            }
        }
        self.redraw();
    }

    fn user_event(&mut self, _: &ActiveEventLoop, Wake: Wake) {
        let outbox = self.render_thread.take();
        if outbox.previews[0].is_some() {
            log::debug!("a preview until the renderer is set up");
        }
        if let Some(picture) = &outbox.pictures[0] {
            log::debug!("picture of {} samples at 1/{}", picture.stats.samples, picture.coarseness);
            if picture.coarseness == 1 && picture.stats.samples.max(1).ilog2() != self.samples.max(1).ilog2() {
                log::info!("{} samples by {}", picture.stats.samples, self.state.sides[0].settings.technique);
            }
            self.samples = picture.stats.samples;
        }
        if let (Some(scene_info), Some(view)) = (&outbox.scene_info, &self.view) {
            view.window.set_title(&format!("{} - Lightsheaf", scene_info.spec));
        }
        self.state.accept(outbox, Instant::now());
        self.redraw();
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match &event {
            WindowEvent::CloseRequested => return events.exit(),
            WindowEvent::RedrawRequested => return self.draw(),
            WindowEvent::DroppedFile(path) => {
                self.state.open(&path.to_string_lossy());
                self.waits.input("drop");
            }
            WindowEvent::KeyboardInput { event, .. } if event.state == ElementState::Pressed => self.waits.input("key"),
            WindowEvent::MouseInput { button: MouseButton::Left | MouseButton::Right, .. } => {
                self.waits.input("button")
            }
            WindowEvent::CursorMoved { .. } => self.waits.input("motion"),
            WindowEvent::MouseWheel { .. } => self.waits.input("wheel"),
            WindowEvent::Resized(_) => self.waits.input("size"),
            _ => {}
        }
        // egui takes a button event to occur at the pointer's position at the end of a frame. A frame
        // therefore ends when a button is pressed, and another one before it is released, however slow frames
        // are.
        let button = if let WindowEvent::MouseInput { state, .. } = event { Some(state) } else { None };
        if button == Some(ElementState::Released) {
            self.draw();
        }
        let Some(view) = &mut self.view else { return };
        let response = view.input.on_window_event(&view.window, &event);
        if button == Some(ElementState::Pressed) {
            self.draw();
        } else if response.repaint || matches!(event, WindowEvent::DroppedFile(_)) {
            view.window.request_redraw();
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        let now = Instant::now();
        match self.due {
            Some(due) if due <= now => {
                self.due = None;
                self.redraw();
                events.set_control_flow(ControlFlow::Wait);
            }
            Some(due) => events.set_control_flow(ControlFlow::WaitUntil(due)),
            None => events.set_control_flow(ControlFlow::Wait),
        }
    }
}
