//! The panel: all controls, and statistics of the picture.

use clap::ValueEnum as _;
use egui::{CollapsingHeader, ComboBox, DragValue, RichText, Slider, SliderClamping, Ui};
use glam::Vec3;

use super::canvas::layer_name;
use super::{Action, Interface, METHODS, report, settings};
use crate::exposure::Exposure;
use crate::scene::Light;
use crate::scene::load::endings;
use crate::settings::{OnlyStrategy, UNLIMITED};
use crate::tonemap::Tonemap;
use crate::viewer::outbox::Note;
use crate::viewer::request::Layer;
use crate::viewer::state::{Playback, State};

/// Range of the exposure slider, stops.
const STOPS: std::ops::RangeInclusive<f32> = -8.0..=8.0;
/// Largest number of bounces whose strategies are listed.
const LISTED: u32 = 4;

/// Starts or ends the comparison of two pictures.
pub fn compare(state: &mut State, on: bool) {
    state.compares = on;
    state.active = usize::from(on);
    if !on {
        state.sides[1].picture = None;
    }
}

/// Plays or pauses the animation; starts the first one if none is chosen.
pub fn play(state: &mut State) {
    let any = state.scene_info.as_ref().is_some_and(|scene_info| !scene_info.animations.is_empty());
    match &mut state.playback {
        Some(playback) => playback.playing = !playback.playing,
        None if any => state.playback = Some(Playback { index: 0, seconds: 0.0, playing: true }),
        None => {}
    }
}

fn section(ui: &mut Ui, name: &str, open: bool, add: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(RichText::new(name).strong()).default_open(open).show_unindented(ui, add);
}

impl Interface {
    pub(super) fn panel(&mut self, ui: &mut Ui, state: &mut State) {
        section(ui, "Method", true, |ui| self.method(ui, state));
        section(ui, "Display", true, |ui| self.display(ui, state));
        section(ui, "Settings", false, |ui| {
            let side = &mut state.sides[state.active];
            if settings::show(ui, &self.controls, &mut side.chosen) {
                side.validate();
            }
        });
        section(ui, "Camera", false, |ui| camera(ui, state));
        if state.scene_info.as_ref().is_some_and(|scene_info| !scene_info.animations.is_empty()) {
            section(ui, "Animation", true, |ui| animation(ui, state));
        }
        section(ui, "Lights", false, |ui| lights(ui, state));
        let picture = state.sides[state.active].picture.clone();
        if let Some(picture) = &picture {
            section(ui, "Time of passes", false, |ui| report::times(ui, picture));
            section(ui, "Counts", false, |ui| report::counts(ui, state, picture));
            section(ui, "Plan", false, |ui| report::plan(ui, picture));
        }
        section(ui, "Command line", false, |ui| command_line(ui, state));
        section(ui, "Scene", false, |ui| self.scene(ui, state));
        section(ui, "Keys", false, keys);
        if !state.notes.is_empty() {
            section(ui, "Messages", false, |ui| messages(ui, state));
        }
    }

    fn method(&mut self, ui: &mut Ui, state: &mut State) {
        ui.horizontal(|ui| {
            let mut on = state.compares;
            let hint = "Two pictures side by side; drag the line between them (C)";
            if ui.checkbox(&mut on, "compare").on_hover_text(hint).changed() {
                compare(state, on);
            }
            if state.compares {
                ui.selectable_value(&mut state.active, 0, "left");
                ui.selectable_value(&mut state.active, 1, "right");
            }
        });
        let methods = self.controls.iter().find(|control| control.name == "method");
        let chosen = state.sides[state.active].settings.technique;
        ui.horizontal_wrapped(|ui| {
            for (n, method) in METHODS.into_iter().enumerate() {
                let (name, estimator) = (method.to_string(), method.method.to_string());
                let help = methods.and_then(|control| control.choices.iter().find(|(choice, _)| *choice == estimator));
                let lacks = state.lacks(method).map(str::to_owned);
                let button = egui::Button::selectable(chosen == method, &name);
                let response = ui
                    .add_enabled(lacks.is_none(), button)
                    .on_hover_text(format!("{} ({})", help.map_or("", |(_, help)| help), n + 1))
                    .on_disabled_hover_text(lacks.unwrap_or_default());
                if response.clicked() {
                    state.sides[state.active].use_method(method);
                }
            }
        });
        if let Some(wrong) = &state.sides[state.active].wrong {
            ui.label(RichText::new(wrong).color(ui.visuals().warn_fg_color));
        }
        let side = &mut state.sides[state.active];
        let (method, bounces) = (side.settings.technique, side.settings.bounces);
        ui.horizontal(|ui| {
            ui.label("shows");
            ComboBox::from_id_salt("layer").width(150.0).selected_text(layer_name(side.layer)).show_ui(ui, |ui| {
                let all = [Layer::Light, Layer::Error, Layer::Distance, Layer::Normal, Layer::Albedo, Layer::Lists];
                for layer in all.into_iter().filter(|layer| layer.is_of(method)) {
                    ui.selectable_value(&mut side.layer, layer, layer_name(layer));
                }
                let deepest = if bounces == UNLIMITED { LISTED } else { bounces.min(LISTED) };
                for weighted in [true, false] {
                    for only in OnlyStrategy::all(deepest, weighted).filter(|o| method.has_strategy(o.s, o.t)) {
                        let layer = Layer::Strategy(only);
                        ui.selectable_value(&mut side.layer, layer, layer_name(layer));
                    }
                }
            });
        });
    }

    fn display(&mut self, ui: &mut Ui, state: &mut State) {
        ui.horizontal(|ui| {
            let mut auto = state.exposure == Exposure::Auto;
            let hint = "Exposure by the picture's log-average luminance; of two pictures, by that of the left one";
            let mut stops = state.display_tonemap().stops;
            if ui.checkbox(&mut auto, "auto").on_hover_text(hint).changed() {
                state.exposure = if auto { Exposure::Auto } else { Exposure::Stops(hundredths(stops)) };
            }
            let slider = Slider::new(&mut stops, STOPS).clamping(SliderClamping::Edits).fixed_decimals(2).text("stops");
            if ui.add(slider).on_hover_text("Exposure: values are multiplied by 2 to this").changed() {
                state.exposure = Exposure::Stops(hundredths(stops));
            }
        });
        ui.horizontal_wrapped(|ui| {
            for tonemap in Tonemap::ALL {
                let help = tonemap.to_possible_value().and_then(|value| value.get_help().map(ToString::to_string));
                ui.selectable_value(&mut state.tonemap, tonemap, tonemap.to_string())
                    .on_hover_text(help.unwrap_or_default());
            }
        });
        ui.checkbox(&mut state.marks_vpls, "mark VPLs")
            .on_hover_text("Light vertices y1 and y2 of the latest samples of raster and twin");
        ui.horizontal_wrapped(|ui| {
            for (extension, text, hint) in
                [("png", "save PNG", "As it is shown (P)"), ("exr", "save EXR", "Radiance as it was computed (X)")]
            {
                let (_, path, _) = super::file_of(state, extension);
                if ui.button(text).on_hover_text(format!("{hint}: {}", path.display())).clicked() {
                    self.actions.push(Action::Save(extension));
                }
            }
        });
    }

    fn scene(&mut self, ui: &mut Ui, state: &mut State) {
        if self.spec[1] != state.source.spec {
            self.spec = [(); 2].map(|()| state.source.spec.clone());
        }
        let text = &mut self.spec[0];
        let edit = egui::TextEdit::singleline(text).desired_width(f32::INFINITY);
        let entered = ui.add(edit).lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter));
        if ui.button("open").clicked() || entered {
            state.open(text.trim());
        }
        ui.label(format!("A file ({}) or builtin:NAME. A file can also be dropped on the window.", endings()));
        ui.horizontal_wrapped(|ui| {
            for (name, about) in crate::scene::builtin::names() {
                if ui.small_button(name).on_hover_text(about).clicked() {
                    state.open(&format!("builtin:{name}"));
                }
            }
        });
    }
}

/// Rounds stops to hundredths, the precision of the command line.
fn hundredths(stops: f32) -> f32 {
    (stops * 100.0).round() / 100.0
}

fn camera(ui: &mut Ui, state: &mut State) {
    let names: Vec<String> =
        state.scene_info.iter().flat_map(|scene_info| &scene_info.cameras).map(|c| c.name.clone()).collect();
    if names.len() > 1 {
        let selected = names.get(state.camera).cloned().unwrap_or_default();
        ComboBox::from_id_salt("camera").selected_text(selected).show_ui(ui, |ui| {
            for (index, name) in names.iter().enumerate() {
                if ui.selectable_value(&mut state.camera, index, name).clicked() {
                    state.orbit_camera = None;
                }
            }
        });
    }
    if let Some(mut orbit_camera) = state.current_orbit_camera() {
        let speed = f64::from(state.stride()) * 0.002;
        let mut changed = false;
        for (name, point) in [("eye", &mut orbit_camera.eye), ("target", &mut orbit_camera.target)] {
            changed |= point_row(ui, name, point, speed);
        }
        if changed {
            state.orbit_camera = Some(orbit_camera);
        }
    }
    ui.horizontal(|ui| {
        let mut own = state.fov.is_some();
        if ui.checkbox(&mut own, "angle of view").changed() {
            state.fov = own.then_some(45.0);
        }
        if let Some(fov) = &mut state.fov {
            ui.add(DragValue::new(fov).range(1.0..=170.0).suffix("°"));
        }
        if ui.button("reset").on_hover_text("Back to the scene's own camera (R)").clicked() {
            (state.orbit_camera, state.fov) = (None, None);
        }
    });
}

fn point_row(ui: &mut Ui, name: &str, point: &mut Vec3, speed: f64) -> bool {
    ui.horizontal(|ui| {
        ui.label(name);
        let mut changed = false;
        for part in [&mut point.x, &mut point.y, &mut point.z] {
            changed |= ui.add(DragValue::new(part).speed(speed).max_decimals(3)).changed();
        }
        changed
    })
    .inner
}

fn animation(ui: &mut Ui, state: &mut State) {
    let Some(scene_info) = &state.scene_info else { return };
    let mut playback = state.playback.unwrap_or(Playback { index: 0, seconds: 0.0, playing: false });
    let before = playback;
    let named = |index: usize| scene_info.animations.get(index).map_or(String::new(), |(name, _)| name.clone());
    ComboBox::from_id_salt("animation").selected_text(named(playback.index)).show_ui(ui, |ui| {
        for index in 0..scene_info.animations.len() {
            ui.selectable_value(&mut playback.index, index, named(index));
        }
    });
    let length = scene_info.animations.get(playback.index).map_or(0.0, |(_, seconds)| *seconds);
    ui.horizontal(|ui| {
        if ui.button(if playback.playing { "⏸" } else { "▶" }).on_hover_text("Play or stop (Space)").clicked() {
            playback.playing = !playback.playing;
        }
        ui.add(Slider::new(&mut playback.seconds, 0.0..=length).suffix(" s").fixed_decimals(2));
        if ui.small_button("↺").on_hover_text("The scene as it rests").clicked() {
            state.playback = None;
        }
    });
    if playback != before {
        state.playback = Some(playback);
    }
}

/// Shows colour, strength and position of lights and emissive materials.
fn lights(ui: &mut Ui, state: &mut State) {
    let Some(scene_info) = &state.scene_info else { return };
    if scene_info.lights.is_empty() && scene_info.emissions.is_empty() {
        ui.label("Nothing here can be changed.");
    }
    let speed = f64::from(state.stride()) * 0.002;
    for (index, &own) in scene_info.lights.iter().enumerate() {
        let mut light = state.edits.lights.get(&index).copied().unwrap_or(own);
        let (kind, position, power) = match &mut light {
            Light::Point { position, intensity } => ("point", Some(position), intensity),
            Light::Spot { position, intensity, .. } => ("spot", Some(position), intensity),
            Light::Lamp(lamp) => ("lamp", Some(&mut lamp.position), &mut lamp.intensity),
            Light::Directional { irradiance, .. } => ("directional", None, irradiance),
            Light::Sun { irradiance, .. } => ("sun", None, irradiance),
        };
        let mut changed = emission_row(ui, &format!("{kind} {index}"), power);
        if let Some(position) = position {
            changed |= point_row(ui, "at", position, speed);
        }
        if changed {
            state.edits.lights.insert(index, light);
        }
    }
    for (index, name, own) in &scene_info.emissions {
        let mut radiance = state.edits.emissions.get(index).copied().unwrap_or(*own);
        let name = if name.is_empty() { format!("material {index}") } else { name.clone() };
        if emission_row(ui, &name, &mut radiance) {
            state.edits.emissions.insert(*index, radiance);
        }
    }
    if !state.edits.is_empty() && ui.button("as in the file").clicked() {
        state.edits = Default::default();
    }
}

fn emission_row(ui: &mut Ui, name: &str, power: &mut Vec3) -> bool {
    ui.horizontal(|ui| {
        let mut strength = power.max_element().max(0.0);
        let mut color = if strength > 0.0 { (*power / strength).to_array() } else { [1.0; 3] };
        let speed = f64::from(strength * 0.01).max(0.001);
        let mut changed = ui.color_edit_button_rgb(&mut color).changed();
        changed |= ui.add(DragValue::new(&mut strength).range(0.0..=1e9).speed(speed)).changed();
        ui.label(name);
        if changed {
            *power = Vec3::from(color) * strength;
        }
        changed
    })
    .inner
}

fn command_line(ui: &mut Ui, state: &State) {
    let (_, path, _) = super::file_of(state, "png");
    let (line, left_out) = state.command_line(&path);
    ui.add(egui::Label::new(RichText::new(&line).monospace().size(10.0)).wrap());
    ui.horizontal(|ui| {
        if ui.button("copy").clicked() {
            ui.ctx().copy_text(line.clone());
        }
        if !left_out.is_empty() {
            ui.label(RichText::new(format!("without {}", left_out.join(", "))).small().weak());
        }
    });
}

fn keys(ui: &mut Ui) {
    let rows = [
        ("drag", "orbit"),
        ("right drag", "look around"),
        ("middle, Shift drag", "shift"),
        ("wheel", "closer, farther"),
        ("W A S D Q E", "fly; Shift: faster"),
        ("1 to 5", "method"),
        ("L V Z N B", "picture, error, distance, normals, albedo"),
        ("C", "compare"),
        ("R", "the scene's camera"),
        ("Space", "play, stop"),
        ("P, X", "save PNG, EXR"),
        ("H", "hide the panel"),
    ];
    egui::Grid::new("keys").num_columns(2).show(ui, |ui| {
        for (key, what) in rows {
            ui.label(RichText::new(key).small().strong());
            ui.label(RichText::new(what).small());
            ui.end_row();
        }
    });
}

fn messages(ui: &mut Ui, state: &State) {
    for said in state.notes.iter().rev() {
        let (text, color) = match said {
            Note::Done(text) => (text, ui.visuals().text_color()),
            Note::Wrong(text) | Note::NotLoaded(text) => (text, ui.visuals().warn_fg_color),
        };
        ui.label(RichText::new(text).small().color(color));
    }
}
