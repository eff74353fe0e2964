//! Draws one picture, or two with a divider, and moves the camera with the mouse.

use std::sync::Arc;

use egui::{
    Color32, ColorImage, CursorIcon, FontId, PointerButton, Pos2, Rect, Sense, Stroke, TextureHandle, Ui, vec2,
};

use crate::film::Film;
use crate::tonemap::Grade;
use crate::viewer::render_thread::PANES;
use crate::viewer::request::{Layer, Picture};
use crate::viewer::state::State;

/// Rotation per point of mouse motion, radians.
const TURN: f32 = 0.008;
/// Relative change of the distance per point of wheel motion.
const WHEEL: f32 = 0.003;
/// Half the width of the divider's drag area, points.
const GRIP: f32 = 5.0;

/// A picture that was uploaded to the interface's device.
struct Shown {
    texture: TextureHandle,
    film: Arc<Film>,
    tonemap: Grade,
}

/// Draws the pictures and keeps their textures.
#[derive(Default)]
pub struct Canvas {
    shown: [Option<Shown>; PANES],
}

impl Canvas {
    /// Draws the pictures into the available space and handles mouse input.
    pub fn show(&mut self, ui: &mut Ui, state: &mut State) {
        let scale = ui.ctx().pixels_per_point();
        // The area is aligned to whole pixels, so that film pixels coincide with screen pixels.
        let rect = ui.max_rect();
        let rect = Rect::from_min_max((rect.min * scale).ceil() / scale, (rect.max * scale).floor() / scale);
        let pixels = rect.size() * scale;
        state.resize([pixels.x.round().max(1.0) as u32, pixels.y.round().max(1.0) as u32]);
        ui.painter().rect_filled(rect, 0.0, Color32::BLACK);
        let response = ui.allocate_rect(rect, Sense::click_and_drag());

        let divider = rect.left() + (state.divider * rect.width() * scale).round() / scale;
        for pane in 0..if state.compares { PANES } else { 1 } {
            let part = match (state.compares, pane) {
                (false, _) => rect,
                (true, 0) => Rect::from_min_max(rect.min, Pos2::new(divider, rect.bottom())),
                (true, _) => Rect::from_min_max(Pos2::new(divider, rect.top()), rect.max),
            };
            let Some(picture) = &state.sides[pane].picture else { continue };
            self.upload(ui, pane, picture, state.display_tonemap());
            let painter = ui.painter().with_clip_rect(part);
            if let Some(Shown { texture, .. }) = &self.shown[pane] {
                let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
                painter.image(texture.id(), rect, whole, Color32::WHITE);
            }
            for [x, y] in picture.vpls.iter().filter(|_| state.marks_vpls) {
                let at = rect.min + vec2(x * rect.width(), y * rect.height());
                painter.circle(at, 2.5, Color32::YELLOW, Stroke::new(1.0, Color32::BLACK));
            }
            if let Some(text) = caption(state, pane) {
                let left = part.left() + 8.0;
                let galley = painter.layout_no_wrap(text, FontId::proportional(12.0), Color32::WHITE);
                let place = Rect::from_min_size(Pos2::new(left, part.top() + 6.0), galley.size());
                painter.rect_filled(place.expand2(vec2(4.0, 2.0)), 3.0, Color32::from_black_alpha(150));
                painter.galley(place.min, galley, Color32::WHITE);
            }
        }
        if state.scene_info.is_none() {
            let text = match state.notes.last() {
                Some(_) => "no scene: drop a file here, or open one in the panel",
                None => "loading …",
            };
            let at = rect.center();
            ui.painter().text(at, egui::Align2::CENTER_CENTER, text, FontId::proportional(14.0), Color32::GRAY);
        }
        if state.compares {
            let grip =
                Rect::from_min_max(Pos2::new(divider - GRIP, rect.top()), Pos2::new(divider + GRIP, rect.bottom()));
            let handle = ui
                .interact(grip, ui.scope_id().with("divider"), Sense::drag())
                .on_hover_cursor(CursorIcon::ResizeHorizontal);
            let stroke = Stroke::new(if handle.hovered() || handle.dragged() { 3.0 } else { 1.0 }, Color32::WHITE);
            ui.painter().vline(divider, rect.y_range(), stroke);
            if let Some(pointer) = handle.interact_pointer_pos().filter(|_| handle.dragged()) {
                state.divider = ((pointer.x - rect.left()) / rect.width()).clamp(0.02, 0.98);
            }
        }
        steer(ui, &response, state, rect);
    }

    fn upload(&mut self, ui: &Ui, pane: usize, picture: &Picture, tonemap: Grade) {
        let tonemap = if picture.layer.is_radiance() { tonemap } else { Grade::PLAIN };
        let same = |shown: &Shown| Arc::ptr_eq(&shown.film, &picture.film) && shown.tonemap == tonemap;
        if self.shown[pane].as_ref().is_some_and(same) {
            return;
        }
        let size = [picture.film.width, picture.film.height].map(|side| side as usize);
        let image = ColorImage::from_rgb(size, &tonemap.picture(&picture.film));
        let film = Arc::clone(&picture.film);
        match &mut self.shown[pane] {
            Some(shown) => {
                shown.texture.set(image, egui::TextureOptions::LINEAR);
                (shown.film, shown.tonemap) = (film, tonemap);
            }
            empty => {
                let texture = ui.ctx().load_texture(format!("picture {pane}"), image, egui::TextureOptions::LINEAR);
                *empty = Some(Shown { texture, film, tonemap });
            }
        }
    }
}

/// Returns the caption of a pane; none for a single picture, which needs none.
fn caption(state: &State, pane: usize) -> Option<String> {
    let side = &state.sides[pane];
    let picture = side.picture.as_ref()?;
    let layer = match picture.layer {
        _ if picture.is_preview() => "preview".to_owned(),
        Layer::Error => "error: red is too bright, blue too dark".to_owned(),
        Layer::Lists => "list entries that a look-up walks: blue 1, green 8, red 64 or more".to_owned(),
        layer => layer_name(layer),
    };
    let compared = picture.error.as_ref().map(|(error, samples)| {
        format!(
            "rel_mse {:.2e}, FLIP {:.3}, mean {:+.1} %; reference: {samples} samples",
            error.rel_mse,
            error.flip,
            error.mean_bias * 100.0
        )
    });
    match (state.compares, picture.layer) {
        (false, Layer::Light) => None,
        (true, Layer::Light) => Some(side.settings.technique.to_string()),
        (true, _) => Some(format!("{}: {layer}", side.settings.technique)),
        (false, _) => Some(layer),
    }
    .map(|text| compared.map_or(text.clone(), |compared| format!("{text}\n{compared}")))
}

/// Returns the displayed name of a layer.
pub fn layer_name(layer: Layer) -> String {
    match layer {
        Layer::Light => "picture".to_owned(),
        Layer::Strategy(only) => {
            format!("strategy ({}, {}){}", only.s, only.t, if only.weighted { "" } else { ", unweighted" })
        }
        Layer::Error => "error".to_owned(),
        Layer::Distance => "distance".to_owned(),
        Layer::Normal => "normals".to_owned(),
        Layer::Albedo => "albedo".to_owned(),
        Layer::Lists => "list lengths".to_owned(),
    }
}

/// Applies mouse input to the camera: orbit, look around, pan, zoom.
fn steer(ui: &Ui, response: &egui::Response, state: &mut State, rect: Rect) {
    let delta = response.drag_delta();
    let shift = ui.input(|i| i.modifiers.shift);
    if delta != egui::Vec2::ZERO {
        if response.dragged_by(PointerButton::Middle) || (shift && response.dragged_by(PointerButton::Primary)) {
            state.move_camera(|orbit_camera| {
                let metres = orbit_camera.distance() / rect.height();
                orbit_camera.fly(0.0, -delta.x * metres, delta.y * metres);
            });
        } else if response.dragged_by(PointerButton::Primary) {
            state.move_camera(|orbit_camera| orbit_camera.orbit(-delta.x * TURN, delta.y * TURN));
        } else if response.dragged_by(PointerButton::Secondary) {
            state.move_camera(|orbit_camera| orbit_camera.turn(-0.5 * delta.x * TURN, -0.5 * delta.y * TURN));
        }
    }
    let wheel = ui.input(|i| i.smooth_scroll_delta.y);
    if response.hovered() && wheel != 0.0 {
        state.move_camera(|orbit_camera| orbit_camera.approach((-wheel * WHEEL).exp()));
    }
}
