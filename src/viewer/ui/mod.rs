//! The interface: a panel, a status line and the picture. It depends only on egui, and needs no window.

mod canvas;
mod panel;
mod report;
mod settings;

use std::path::PathBuf;

use egui::{Align, CentralPanel, Context, Frame, Key, Layout, Margin, Panel, RichText, Ui};

use self::canvas::Canvas;
use super::outbox::Note;
use super::request::{Layer, Picture};
use super::setting_controls::{SettingControl, controls};
use super::state::State;
use crate::settings::Technique;
use crate::tonemap::Grade;

/// Width of the panel in points, and its largest fraction of the window's width.
const PANEL: f32 = 256.0;
const PANEL_SHARE: f32 = 0.38;
/// Methods in the order of their keys, 1 to 5.
const METHODS: [Technique; 5] =
    [Technique::RASTER, Technique::TWIN, Technique::RAY_QUERY, Technique::PATH, Technique::REFERENCE];

/// An action of the user that does not change the state.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Write the active side's picture to a file with this extension.
    Save(&'static str),
}

/// The interface and its own state.
pub struct Interface {
    controls: Vec<SettingControl>,
    canvas: Canvas,
    hides_panel: bool,
    /// Text in the scene field, and the scene that it was last filled in from.
    spec: [String; 2],
    actions: Vec<Action>,
}

impl Default for Interface {
    fn default() -> Self {
        Self {
            controls: controls(),
            canvas: Canvas::default(),
            hides_panel: false,
            spec: Default::default(),
            actions: Vec::new(),
        }
    }
}

/// Sets small fonts and spacings, so that many controls fit.
pub fn style(context: &Context) {
    context.set_theme(egui::Theme::Dark);
    context.all_styles_mut(|style| {
        for font in style.text_styles.values_mut() {
            font.size = (font.size * 0.92).round();
        }
        style.spacing.item_spacing = egui::vec2(5.0, 3.0);
        style.spacing.slider_width = 90.0;
        style.spacing.combo_width = 60.0;
        style.spacing.interact_size.y = 17.0;
        style.interaction.tooltip_delay = 0.3;
        // A blinking cursor would cause continuous redrawing.
        style.visuals.text_cursor.blink = false;
    });
}

impl Interface {
    /// Lays out one frame of the interface and applies the user's input to the state; `seconds` have passed
    /// since the last frame.
    pub fn show(&mut self, ui: &mut Ui, state: &mut State, seconds: f32) -> Vec<Action> {
        self.keys(ui.ctx(), state, seconds);
        let margin = Margin::symmetric(6, 3);
        let frame = Frame::new().inner_margin(margin).fill(ui.visuals().panel_fill);
        Panel::bottom("line").frame(frame).show(ui, |ui| line(ui, state));
        if !self.hides_panel {
            let width = PANEL.min(ui.available_width() * PANEL_SHARE);
            Panel::left("panel").frame(frame).exact_size(width).resizable(false).show(ui, |ui| {
                egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| self.panel(ui, state));
            });
        }
        CentralPanel::no_frame().show(ui, |ui| self.canvas.show(ui, state));
        std::mem::take(&mut self.actions)
    }

    /// Discards all textures, so that the pictures are uploaded again.
    pub fn forget_textures(&mut self) {
        self.canvas = Canvas::default();
    }

    fn keys(&mut self, context: &Context, state: &mut State, seconds: f32) {
        state.advance_animation(seconds);
        if state.playback.is_some_and(|p| p.playing) {
            context.request_repaint();
        }
        if context.egui_wants_keyboard_input() {
            return;
        }
        let pressed = |key| context.input(|i| i.modifiers.is_none() && i.key_pressed(key));
        for (key, method) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5].into_iter().zip(METHODS) {
            if pressed(key) && state.lacks(method).is_none() {
                state.sides[state.active].use_method(method);
            }
        }
        for (key, layer) in [
            (Key::L, Layer::Light),
            (Key::Z, Layer::Distance),
            (Key::N, Layer::Normal),
            (Key::B, Layer::Albedo),
            (Key::V, Layer::Error),
            (Key::T, Layer::Lists),
        ] {
            let side = &mut state.sides[state.active];
            if pressed(key) && layer.is_of(side.settings.technique) {
                side.layer = layer;
            }
        }
        if pressed(Key::H) {
            self.hides_panel = !self.hides_panel;
        }
        if pressed(Key::C) {
            panel::compare(state, !state.compares);
        }
        if pressed(Key::R) {
            (state.orbit_camera, state.fov) = (None, None);
        }
        if pressed(Key::Space) {
            panel::play(state);
        }
        if pressed(Key::P) {
            self.actions.push(Action::Save("png"));
        }
        if pressed(Key::X) {
            self.actions.push(Action::Save("exr"));
        }
        let steps = context.input(|i| {
            let axis = |more, less| f32::from(u8::from(i.key_down(more))) - f32::from(u8::from(i.key_down(less)));
            let speed = if i.modifiers.shift { 2.0 } else { 0.5 };
            let free = !i.modifiers.command && !i.modifiers.alt;
            free.then(|| [axis(Key::W, Key::S), axis(Key::D, Key::A), axis(Key::E, Key::Q)].map(|a| a * speed))
        });
        if let Some([ahead, right, up]) = steps.filter(|steps| *steps != [0.0; 3]) {
            let metres = state.stride() * seconds.min(0.1);
            state.move_camera(|orbit_camera| orbit_camera.fly(ahead * metres, right * metres, up * metres));
            context.request_repaint();
        }
    }
}

/// Lays out the status line.
fn line(ui: &mut Ui, state: &State) {
    ui.horizontal(|ui| {
        for side in state.sides.iter().take(if state.compares { 2 } else { 1 }) {
            let Some(picture) = &side.picture else {
                ui.label("…");
                continue;
            };
            ui.label(RichText::new(side.settings.technique.to_string()).strong());
            ui.label(summary(picture));
            ui.separator();
        }
        if let Some(before) = state.shaders {
            ui.label(format!("compiling shaders, which this driver keeps: {}", before + 1));
            ui.separator();
        }
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| match state.notes.last() {
            Some(Note::Done(text)) => _ = ui.add(egui::Label::new(text).truncate()),
            Some(Note::Wrong(text) | Note::NotLoaded(text)) => {
                let text = RichText::new(text).color(ui.visuals().warn_fg_color);
                ui.add(egui::Label::new(text).truncate());
            }
            None => {}
        });
    });
}

/// Returns the number of samples, the time of each and the size of a picture.
fn summary(picture: &Picture) -> String {
    let Picture { film, stats, batch: (count, seconds), .. } = picture;
    if picture.is_preview() {
        return "a preview, until the renderer is set up".to_owned();
    }
    let size = format!("{}x{}", film.width, film.height);
    if picture.layer.is_feature() {
        return size;
    }
    let millis = seconds * 1e3 / (*count).max(1) as f64;
    let samples = if stats.samples == 1 { "sample" } else { "samples" };
    format!("{} {samples}, {millis:.0} ms each, {size}", stats.samples)
}

/// Returns the pane, the file name and the tone map for saving the active side's picture.
#[must_use]
pub fn file_of(state: &State, extension: &str) -> (usize, PathBuf, Grade) {
    (if state.compares { state.active } else { 0 }, state.free_file(extension), state.display_tonemap())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Instant;

    use super::*;
    use crate::exposure::Exposure;
    use crate::film::Film;
    use crate::render::renderer::RenderStats;
    use crate::scene::builtin;
    use crate::settings::Settings;
    use crate::staging::Staging;
    use crate::tonemap::Tonemap;
    use crate::viewer::outbox::Outbox;
    use crate::viewer::request::{Machine, SceneInfo};
    use crate::viewer::state::Launch;

    /// The interface without a window.
    struct Desktop {
        context: Context,
        interface: Interface,
        state: State,
        size: egui::Vec2,
    }

    impl Desktop {
        fn new() -> Self {
            let context = Context::default();
            style(&context);
            let mut state = State::new(Launch {
                spec: "builtin:cornell_point".to_owned(),
                staging: Staging::default(),
                settings: Settings::default(),
                orbit_camera: None,
                fov: None,
                animation: None,
                at: None,
                exposure: Exposure::Auto,
                tonemap: Tonemap::Agx,
            });
            let scene = builtin::load("cornell_point").unwrap();
            let scene_info = SceneInfo {
                spec: "builtin:cornell_point".to_owned(),
                cameras: scene.cameras,
                lights: scene.lights,
                animations: vec![("walk".to_owned(), 2.0)],
                sphere: (glam::Vec3::ZERO, 2.0),
                ..SceneInfo::default()
            };
            let picture = Picture {
                request: 1,
                film: Arc::new(Film::new(8, 6)),
                layer: Layer::Light,
                auto_stops: Some(1.5),
                coarseness: 1,
                stats: RenderStats { samples: 3, ..RenderStats::default() },
                batch: (1, 0.01),
                plan: "plan".into(),
                vpls: vec![[0.5, 0.5]],
                error: None,
                finished: false,
            };
            let outbox = Outbox { scene_info: Some(scene_info), pictures: [Some(picture), None], ..Outbox::default() };
            state.accept(outbox, Instant::now());
            Self { context, interface: Interface::default(), state, size: egui::vec2(640.0, 360.0) }
        }

        fn frame(&mut self, events: Vec<egui::Event>) -> Vec<Action> {
            let screen_rect = Some(egui::Rect::from_min_size(egui::Pos2::ZERO, self.size));
            let input = egui::RawInput { screen_rect, events, ..egui::RawInput::default() };
            let (interface, state, mut actions) = (&mut self.interface, &mut self.state, Vec::new());
            let mut output = self.context.run_ui(input, |ui| actions.extend(interface.show(ui, state, 0.02)));
            output.textures_delta.clear();
            actions
        }

        fn key(&mut self, key: Key) -> Vec<Action> {
            let event = |pressed| egui::Event::Key {
                key,
                physical_key: None,
                pressed,
                repeat: false,
                modifiers: egui::Modifiers::NONE,
            };
            let actions = self.frame(vec![event(true)]);
            self.frame(vec![event(false)]);
            actions
        }
    }

    #[test]
    fn keys_choose() {
        let mut desktop = Desktop::new();
        desktop.frame(Vec::new());
        for (key, method) in
            [(Key::Num4, Technique::PATH), (Key::Num5, Technique::REFERENCE), (Key::Num1, Technique::RASTER)]
        {
            desktop.key(key);
            assert_eq!(desktop.state.sides[0].settings.technique, method);
        }
        desktop.state.machine = Machine { no_rays: Some("no rays".to_owned()), ..Machine::default() };
        desktop.key(Key::Num2);
        assert_eq!(desktop.state.sides[0].settings.technique, Technique::RASTER, "the machine has no twin");
        desktop.key(Key::N);
        assert_eq!(desktop.state.sides[0].layer, Layer::Normal);
        desktop.key(Key::W);
        assert!(desktop.state.orbit_camera.is_some());
        desktop.key(Key::R);
        assert!(desktop.state.orbit_camera.is_none());
        desktop.key(Key::C);
        assert_eq!((desktop.state.compares, desktop.state.active), (true, 1));
        desktop.key(Key::C);
        desktop.key(Key::Space);
        assert!(desktop.state.playback.is_some_and(|p| p.playing));
        assert_eq!(desktop.key(Key::P), [Action::Save("png")]);
        assert_eq!(desktop.key(Key::X), [Action::Save("exr")]);
    }

    #[test]
    fn every_size_and_layer_is_laid_out() {
        let mut desktop = Desktop::new();
        for size in [[320.0, 200.0], [640.0, 360.0], [1280.0, 720.0], [1.0, 1.0], [4000.0, 100.0]] {
            desktop.size = size.into();
            for layer in [Layer::Light, Layer::Error, Layer::Albedo, Layer::Lists] {
                desktop.state.sides[0].layer = layer;
                desktop.state.compares = layer == Layer::Error;
                desktop.state.marks_vpls = true;
                desktop.frame(Vec::new());
            }
            let request = desktop.state.request(Instant::now()).unwrap();
            let settings = &request.panes[0].settings;
            assert!(settings.width >= 1 && f64::from(settings.width) <= f64::from(size[0]).max(1.0));
            assert_eq!(settings.check(), Ok(()));
        }
    }
}
