//! Rows for all setting controls, each with a widget for its type of value, its help on hover and a button
//! that restores its default.

use egui::{ComboBox, DragValue, RichText, Ui};

use crate::viewer::setting_controls::{Chosen, Kind, SettingControl};

/// Shows all controls but the method's, which has buttons of its own. Returns true if a value has changed.
pub fn show(ui: &mut Ui, controls: &[SettingControl], chosen: &mut Chosen) -> bool {
    let mut changed = false;
    let mut heading = None;
    let mut sorted: Vec<&SettingControl> = controls.iter().filter(|control| control.name != "method").collect();
    sorted.sort_by_key(|control| control.heading.clone());
    for control in sorted {
        if control.heading != heading {
            heading.clone_from(&control.heading);
            ui.add_space(4.0);
            ui.label(RichText::new(heading.as_deref().unwrap_or_default()).weak().italics());
        }
        changed |= row(ui, control, chosen);
    }
    changed
}

fn row(ui: &mut Ui, control: &SettingControl, chosen: &mut Chosen) -> bool {
    let now = chosen.0.get(&control.name).or(control.default.as_ref()).cloned();
    let mut wanted = now.clone();
    ui.horizontal(|ui| {
        let name = RichText::new(control.name.replace('-', " "));
        let set = chosen.0.contains_key(&control.name);
        ui.label(if set { name.strong() } else { name }).on_hover_text(&control.help);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if set && ui.small_button("↺").on_hover_text("back to the default").clicked() {
                wanted.clone_from(&control.default);
                return;
            }
            match control.kind {
                Kind::Switch => {
                    let mut on = now.as_deref() == Some("true");
                    if ui.checkbox(&mut on, "").on_hover_text(&control.help).changed() {
                        wanted = on.then(|| "true".to_owned());
                    }
                }
                Kind::Choice => choice(ui, control, &mut wanted),
                Kind::Count | Kind::Number => match now.as_deref().and_then(|text| text.parse::<f64>().ok()) {
                    Some(value) => number(ui, control, value, &mut wanted),
                    None => {
                        let text = now.as_deref().unwrap_or("auto");
                        if ui.button(text).on_hover_text(format!("{}\nClick to choose.", control.help)).clicked() {
                            wanted = Some(first_value(control));
                        }
                    }
                },
                Kind::Text => {
                    let mut text = now.clone().unwrap_or_default();
                    let edit = egui::TextEdit::singleline(&mut text).desired_width(80.0);
                    if ui.add(edit).on_hover_text(&control.help).changed() {
                        wanted = Some(text).filter(|text| !text.is_empty());
                    }
                }
            }
        });
    });
    if wanted == now {
        return false;
    }
    match wanted.filter(|wanted| Some(wanted) != control.default.as_ref()) {
        Some(wanted) => chosen.0.insert(control.name.clone(), wanted),
        None => chosen.0.remove(&control.name),
    };
    true
}

fn choice(ui: &mut Ui, control: &SettingControl, wanted: &mut Option<String>) {
    let text = wanted.clone().unwrap_or_else(|| "auto".to_owned());
    let combo = ComboBox::from_id_salt(&control.name).selected_text(text);
    let response = combo.show_ui(ui, |ui| {
        if control.default.is_none() {
            ui.selectable_value(wanted, None, "auto");
        }
        for (name, help) in &control.choices {
            ui.selectable_value(wanted, Some(name.clone()), name).on_hover_text(help);
        }
    });
    response.response.on_hover_text(&control.help);
}

fn number(ui: &mut Ui, control: &SettingControl, value: f64, wanted: &mut Option<String>) {
    let mut value = value;
    let whole = control.kind == Kind::Count;
    let speed = if whole { (value.abs() * 0.01).max(0.1) } else { (value.abs() * 0.01).max(0.001) };
    let mut drag = DragValue::new(&mut value).speed(speed);
    if whole {
        drag = drag.range(0..=u32::MAX).max_decimals(0);
    }
    if ui.add(drag).on_hover_text(&control.help).changed() {
        *wanted = Some(if whole { (value.round() as u32).to_string() } else { (value as f32).to_string() });
    }
}

/// Returns the initial value of a number that was chosen from the scene: the first number in the help text,
/// which is the smallest permitted.
fn first_value(control: &SettingControl) -> String {
    let words = control.help.split([' ', ',', ':', ';']);
    words.map(|word| word.trim_end_matches('.')).find(|word| word.parse::<f32>().is_ok()).unwrap_or("1").to_owned()
}
