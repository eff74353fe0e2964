//! The picture, or two with a divider, and the camera under the mouse.

use std::sync::Arc;

use egui::{
    Color32, ColorImage, CursorIcon, FontId, PointerButton, Pos2, Rect, Sense, Stroke, TextureHandle, Ui, vec2,
};

use crate::film::Film;
use crate::tonemap::Grade;
use crate::viewer::order::{Layer, Picture};
use crate::viewer::state::State;
use crate::viewer::studio::PANES;

/// Radians that a point of the mouse turns.
const TURN: f32 = 0.008;
/// Share of the distance that a point of the wheel goes.
const WHEEL: f32 = 0.003;
/// Points on either side of the divider where it can be taken.
const GRIP: f32 = 5.0;

/// A picture on the interface's device.
struct Shown {
    texture: TextureHandle,
    film: Arc<Film>,
    grade: Grade,
}

/// What has been shown last.
#[derive(Default)]
pub struct Canvas {
    shown: [Option<Shown>; PANES],
}

impl Canvas {
    /// Shows the pictures in all of the space, and moves the camera.
    pub fn show(&mut self, ui: &mut Ui, state: &mut State) {
        let scale = ui.ctx().pixels_per_point();
        // Whole pixels, so that one of the picture is one of the screen.
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
            self.upload(ui, pane, picture, state.grade());
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
        if state.card.is_none() {
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

    fn upload(&mut self, ui: &Ui, pane: usize, picture: &Picture, grade: Grade) {
        let grade = if picture.layer.is_radiance() { grade } else { Grade::PLAIN };
        let same = |shown: &Shown| Arc::ptr_eq(&shown.film, &picture.film) && shown.grade == grade;
        if self.shown[pane].as_ref().is_some_and(same) {
            return;
        }
        let size = [picture.film.width, picture.film.height].map(|side| side as usize);
        let image = ColorImage::from_rgb(size, &grade.picture(&picture.film));
        let film = Arc::clone(&picture.film);
        match &mut self.shown[pane] {
            Some(shown) => {
                shown.texture.set(image, egui::TextureOptions::LINEAR);
                (shown.film, shown.grade) = (film, grade);
            }
            empty => {
                let texture = ui.ctx().load_texture(format!("picture {pane}"), image, egui::TextureOptions::LINEAR);
                *empty = Some(Shown { texture, film, grade });
            }
        }
    }
}

/// What a pane shows, where that does not go without saying.
fn caption(state: &State, pane: usize) -> Option<String> {
    let side = &state.sides[pane];
    let picture = side.picture.as_ref()?;
    let layer = match picture.layer {
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
        (true, Layer::Light) => Some(side.settings.method.to_string()),
        (true, _) => Some(format!("{}: {layer}", side.settings.method)),
        (false, _) => Some(layer),
    }
    .map(|text| compared.map_or(text.clone(), |compared| format!("{text}\n{compared}")))
}

/// What a layer is called.
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

/// The mouse: orbit, look around, shift, come closer.
fn steer(ui: &Ui, response: &egui::Response, state: &mut State, rect: Rect) {
    let delta = response.drag_delta();
    let shift = ui.input(|i| i.modifiers.shift);
    if delta != egui::Vec2::ZERO {
        if response.dragged_by(PointerButton::Middle) || (shift && response.dragged_by(PointerButton::Primary)) {
            state.walk(|stand| {
                let metres = stand.distance() / rect.height();
                stand.fly(0.0, -delta.x * metres, delta.y * metres);
            });
        } else if response.dragged_by(PointerButton::Primary) {
            state.walk(|stand| stand.orbit(-delta.x * TURN, delta.y * TURN));
        } else if response.dragged_by(PointerButton::Secondary) {
            state.walk(|stand| stand.turn(-0.5 * delta.x * TURN, -0.5 * delta.y * TURN));
        }
    }
    let wheel = ui.input(|i| i.smooth_scroll_delta.y);
    if response.hovered() && wheel != 0.0 {
        state.walk(|stand| stand.approach((-wheel * WHEEL).exp()));
    }
}
