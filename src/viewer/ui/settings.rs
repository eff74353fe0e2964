//! Rows for all knobs: each with what fits what it takes, its sentence on hover, and a way back to its default.

use egui::{ComboBox, DragValue, RichText, Ui};

use crate::viewer::knobs::{Chosen, Kind, Knob};

/// Shows all but the method, which has buttons of its own. Whether anything changed.
pub fn show(ui: &mut Ui, knobs: &[Knob], chosen: &mut Chosen) -> bool {
    let mut changed = false;
    let mut heading = None;
    let mut sorted: Vec<&Knob> = knobs.iter().filter(|knob| knob.name != "method").collect();
    sorted.sort_by_key(|knob| knob.heading.clone());
    for knob in sorted {
        if knob.heading != heading {
            heading.clone_from(&knob.heading);
            ui.add_space(4.0);
            ui.label(RichText::new(heading.as_deref().unwrap_or_default()).weak().italics());
        }
        changed |= row(ui, knob, chosen);
    }
    changed
}

fn row(ui: &mut Ui, knob: &Knob, chosen: &mut Chosen) -> bool {
    let now = chosen.0.get(&knob.name).or(knob.default.as_ref()).cloned();
    let mut wanted = now.clone();
    ui.horizontal(|ui| {
        let name = RichText::new(knob.name.replace('-', " "));
        let set = chosen.0.contains_key(&knob.name);
        ui.label(if set { name.strong() } else { name }).on_hover_text(&knob.help);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if set && ui.small_button("↺").on_hover_text("back to the default").clicked() {
                wanted.clone_from(&knob.default);
                return;
            }
            match knob.kind {
                Kind::Switch => {
                    let mut on = now.as_deref() == Some("true");
                    if ui.checkbox(&mut on, "").on_hover_text(&knob.help).changed() {
                        wanted = on.then(|| "true".to_owned());
                    }
                }
                Kind::Choice => choice(ui, knob, &mut wanted),
                Kind::Count | Kind::Number => match now.as_deref().and_then(|text| text.parse::<f64>().ok()) {
                    Some(value) => number(ui, knob, value, &mut wanted),
                    None => {
                        let text = now.as_deref().unwrap_or("auto");
                        if ui.button(text).on_hover_text(format!("{}\nClick to choose.", knob.help)).clicked() {
                            wanted = Some(first_value(knob));
                        }
                    }
                },
                Kind::Text => {
                    let mut text = now.clone().unwrap_or_default();
                    let edit = egui::TextEdit::singleline(&mut text).desired_width(80.0);
                    if ui.add(edit).on_hover_text(&knob.help).changed() {
                        wanted = Some(text).filter(|text| !text.is_empty());
                    }
                }
            }
        });
    });
    if wanted == now {
        return false;
    }
    match wanted.filter(|wanted| Some(wanted) != knob.default.as_ref()) {
        Some(wanted) => chosen.0.insert(knob.name.clone(), wanted),
        None => chosen.0.remove(&knob.name),
    };
    true
}

fn choice(ui: &mut Ui, knob: &Knob, wanted: &mut Option<String>) {
    let text = wanted.clone().unwrap_or_else(|| "auto".to_owned());
    let combo = ComboBox::from_id_salt(&knob.name).selected_text(text);
    let response = combo.show_ui(ui, |ui| {
        if knob.default.is_none() {
            ui.selectable_value(wanted, None, "auto");
        }
        for (name, help) in &knob.choices {
            ui.selectable_value(wanted, Some(name.clone()), name).on_hover_text(help);
        }
    });
    response.response.on_hover_text(&knob.help);
}

fn number(ui: &mut Ui, knob: &Knob, value: f64, wanted: &mut Option<String>) {
    let mut value = value;
    let whole = knob.kind == Kind::Count;
    let speed = if whole { (value.abs() * 0.01).max(0.1) } else { (value.abs() * 0.01).max(0.001) };
    let mut drag = DragValue::new(&mut value).speed(speed);
    if whole {
        drag = drag.range(0..=u32::MAX).max_decimals(0);
    }
    if ui.add(drag).on_hover_text(&knob.help).changed() {
        *wanted = Some(if whole { (value.round() as u32).to_string() } else { (value as f32).to_string() });
    }
}

/// Where to begin with a number that was chosen from the scene: the least that the sentence names.
fn first_value(knob: &Knob) -> String {
    let words = knob.help.split([' ', ',', ':', ';']);
    words.map(|word| word.trim_end_matches('.')).find(|word| word.parse::<f32>().is_ok()).unwrap_or("1").to_owned()
}
