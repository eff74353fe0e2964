//! Statistics of the active side's picture: plan, time of each pass, counts.

use egui::{Color32, RichText, Ui};
use egui_plot::{AxisHints, Bar, BarChart, GridMark, Plot};

use crate::viewer::request::Picture;
use crate::viewer::state::State;

/// Shows the plan: passes with their reasons.
pub fn plan(ui: &mut Ui, picture: &Picture) {
    egui::ScrollArea::horizontal().id_salt("plan").show(ui, |ui| {
        let text = RichText::new(&*picture.plan).monospace().size(9.5);
        ui.add(egui::Label::new(text).extend());
    });
}

/// Shows the device time of each pass, milliseconds per sample.
pub fn times(ui: &mut Ui, picture: &Picture) {
    let samples = picture.batch.0.max(1) as f64;
    let each = |(name, time): (&&'static str, &crate::gpu::PassTime)| (*name, time.gpu_millis / samples);
    let passes: Vec<(&'static str, f64)> =
        picture.stats.passes.iter().map(each).filter(|(_, millis)| *millis > 0.0).collect();
    let total: f64 = passes.iter().map(|(_, millis)| millis).sum();
    if total == 0.0 {
        ui.label("No pass was timed: the device has no clock, or the CPU renders.");
        return;
    }
    ui.label(format!("{total:.2} ms a sample on the device"));
    let mut sorted = passes;
    sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
    let bars = sorted
        .iter()
        .enumerate()
        .map(|(n, (name, millis))| Bar::new(n as f64, *millis).name(format!("{name}: {millis:.3} ms")).width(0.7));
    let chart = BarChart::new("passes", bars.collect()).horizontal().color(Color32::from_rgb(90, 160, 230));
    let count = sorted.len();
    let marks = move |_| (0..count).map(|n| GridMark { value: n as f64, step_size: 1.0 }).collect();
    let names: Vec<&'static str> = sorted.iter().map(|(name, _)| *name).collect();
    let name =
        move |mark: GridMark, _: &_| names.get(mark.value as usize).map_or(String::new(), |&name| name.to_owned());
    let axis = AxisHints::new_y().formatter(name).label_spacing(4.0..=8.0).min_thickness(78.0);
    Plot::new("times")
        .height(26.0 + 15.0 * count as f32)
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .show_grid([true, false])
        .show_x(false)
        .show_y(false)
        .include_x(0.0)
        .custom_y_axes(vec![axis])
        .y_grid_spacer(marks)
        .show(ui, |plot| plot.bar_chart(chart));
}

/// Shows counts and memory.
pub fn counts(ui: &mut Ui, state: &State, picture: &Picture) {
    let megabytes = |bytes: u64| format!("{:.1} MB", bytes as f64 * 1e-6);
    let stats = &picture.stats;
    let mut rows = vec![
        ("samples", stats.samples.to_string()),
        ("pictures a second", format!("{:.1}", state.pictures_a_second)),
        ("film", format!("{}x{}", picture.film.width, picture.film.height)),
        ("on the device", megabytes(stats.bytes)),
        ("scene on the device", megabytes(stats.scene_bytes + stats.tracer_bytes)),
        ("redone for capacity", stats.redone.to_string()),
        ("not finite", stats.non_finite.to_string()),
    ];
    if let Some(scene_info) = &state.scene_info {
        rows.push(("triangles", scene_info.triangles.to_string()));
    }
    egui::Grid::new("counts").num_columns(2).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(name);
            ui.label(value);
            ui.end_row();
        }
    });
    if !stats.requests.is_empty() {
        ui.label("Most list nodes requested by each view").on_hover_text("In the plan's order: lights, VPLs, bundles.");
        let nodes: Vec<String> = stats.requests.iter().map(|request| request.nodes.to_string()).collect();
        ui.label(RichText::new(nodes.join("  ")).monospace().small());
    }
    ui.label(RichText::new(&state.machine.device).small().weak());
}
