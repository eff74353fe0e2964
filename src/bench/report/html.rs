//! Report as a self-contained HTML page with embedded styles, pictures and charts.

use std::fmt::Write as _;
use std::io::Cursor;

use base64::Engine as _;

use crate::bench::{BenchError, Checkpoint};
use crate::film::Film;
use crate::metrics;

use super::chart::{self, Curves};
use super::text::{method, pass_table, reference, short, table};
use super::{EntryReport, Report, SceneReport, drawing};

const STYLE: &str = "
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1200px; margin: 2em auto; padding: 0 1em; color: #222; }
h1, h2 { font-weight: 600; } h2 { margin-top: 2em; border-top: 1px solid #ccc; padding-top: 0.6em; }
pre { background: #f4f4f4; padding: 0.6em 0.8em; overflow-x: auto; white-space: pre-wrap; }
table { border-collapse: collapse; margin: 1em 0; display: block; overflow-x: auto; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25em 0.8em; text-align: right; border-bottom: 1px solid #ddd; } th:first-child, td:first-child { text-align: left; }
.charts, .pictures { display: flex; flex-wrap: wrap; gap: 1em; align-items: flex-start; }
figure { margin: 0; } figcaption { font-size: 13px; color: #555; max-width: 260px; }
.pictures img { width: 260px; image-rendering: auto; display: block; } .pair { display: flex; gap: 2px; }
svg { max-width: 100%; height: auto; }
";

/// Returns the page.
pub fn page(report: &Report) -> Result<String, BenchError> {
    let machine = &report.machine;
    let load = machine.load.as_ref().map(|load| format!("; load averages at the start {load}")).unwrap_or_default();
    let about = format!("{}, {} threads; {}{load}", machine.cpu, machine.threads, machine.system);
    let how: String = method(report).iter().map(|text| format!("<p>{}</p>\n", escape(text))).collect();
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>Run time against error</title>\n\
         <style>{STYLE}</style>\n</head>\n<body>\n<h1>Run time against error</h1>\n\
         <p>lightsheaf {}; {}.</p>\n<pre>{}</pre>\n{how}",
        report.version,
        escape(&about),
        escape(&report.command),
    );
    for scene in &report.scenes {
        out += &section(report, scene)?;
    }
    out += "</body>\n</html>\n";
    Ok(out)
}

/// Returns the section of a scene.
fn section(report: &Report, scene: &SceneReport) -> Result<String, BenchError> {
    let title = format!("{}, {}x{}", scene.name, scene.width, scene.height);
    let mut out = format!("<h2>{}</h2>\n<p>{}</p>\n", escape(&title), escape(&reference(scene)));
    let notes = scene.entries.iter().filter_map(|e| Some(format!("{} ended early: {}", e.name, e.failure.as_ref()?)));
    let refused = scene.refusals.iter().map(|(name, why)| format!("{name} did not take part: {why}"));
    for note in notes.chain(refused) {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "<p><strong>{}</strong></p>", escape(&note));
    }

    let error = curves(scene, |c| c.error);
    let flip = curves(scene, |c| c.comparison.flip);
    out += "<div class=\"charts\">\n";
    for chart in [chart::svg(&error, "rel_mse", scene.reference.own_rel_mse)?, chart::svg(&flip, "mean FLIP", None)?] {
        out += &chart.unwrap_or_default();
    }
    out += "</div>\n";

    out += &html_table(&table(report, scene));
    let about: String =
        scene.entries.iter().map(|e| format!("<li>{}: {}</li>\n", escape(&e.name), escape(&e.details.about))).collect();
    let _ = writeln!(out, "<ul>\n{about}</ul>");

    let passes = pass_table(scene);
    if !passes.is_empty() {
        out += "<p>Device time in milliseconds per sample:</p>\n";
        out += &html_table(&passes);
    }

    let exposure = metrics::flip_exposure(&scene.truth) as f32;
    let _ = writeln!(
        out,
        "<p>Last pictures of the first repeat at exposure {}, and their signed relative error: red is too bright, blue is too \
         dark, saturated at 100 %.</p>\n<div class=\"pictures\">",
        short(exposure.into())
    );
    let truth = picture(&scene.truth, exposure, "the reference")?;
    let _ = writeln!(out, "<figure>{truth}<figcaption>the reference</figcaption></figure>");
    for entry in &scene.entries {
        out += &figure(entry, scene, exposure)?;
    }
    out += "</div>\n";
    Ok(out)
}

/// Returns the curves of a metric for all contenders.
fn curves<'a>(scene: &'a SceneReport, figure: fn(&Checkpoint) -> f64) -> Vec<Curves<'a>> {
    let repeats = |entry: &EntryReport| entry.runs.iter().map(|run| run.curve(figure)).collect();
    scene.entries.iter().map(|e| Curves { name: &e.name, repeats: repeats(e) }).collect()
}

/// Returns the last picture of a contender with its error map and caption.
fn figure(entry: &EntryReport, scene: &SceneReport, exposure: f32) -> Result<String, BenchError> {
    let last = entry.runs.first().and_then(|run| run.checkpoints.last());
    let (Some(film), Some(last)) = (&entry.picture, last) else { return Ok(String::new()) };
    let image = picture(film, exposure, &entry.name)?;
    let error = picture(&metrics::heatmap(film, &scene.truth)?, 1.0, "error")?;
    let c = &last.comparison;
    let caption = format!(
        "{}: {} samples in {} s; rel_mse {}, mean {:+.2} %, FLIP {}",
        entry.name,
        last.samples,
        short(last.seconds),
        short(c.rel_mse),
        100.0 * c.mean_bias,
        short(c.flip)
    );
    Ok(format!(
        "<figure><div class=\"pair\">{image}{error}</div><figcaption>{}</figcaption></figure>\n",
        escape(&caption)
    ))
}

/// Returns an image element with the picture as an embedded PNG.
fn picture(film: &Film, exposure: f32, about: &str) -> Result<String, BenchError> {
    let image = image::RgbImage::from_raw(film.width, film.height, film.to_srgb8(exposure));
    let mut png = Cursor::new(Vec::new());
    let image = image.ok_or_else(|| drawing(&"a picture without pixels"))?;
    image.write_to(&mut png, image::ImageFormat::Png).map_err(|e| drawing(&e))?;
    let data = base64::engine::general_purpose::STANDARD.encode(png.into_inner());
    Ok(format!("<img alt=\"{}\" src=\"data:image/png;base64,{data}\">", escape(about)))
}

/// Returns a table whose first row is the header.
fn html_table(rows: &[Vec<String>]) -> String {
    let line = |cells: &[String], tag: &str| {
        let cells: String = cells.iter().map(|c| format!("<{tag}>{}</{tag}>", escape(c))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let Some((heads, rows)) = rows.split_first() else { return String::new() };
    let rows: String = rows.iter().map(|row| line(row, "td")).collect();
    format!("<table>\n{}{rows}</table>\n", line(heads, "th"))
}

/// Escapes text for HTML.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped() {
        assert_eq!(escape("<a href=\"x\">&"), "&lt;a href=&quot;x&quot;&gt;&amp;");
        assert_eq!(
            html_table(&[vec!["a".into()], vec!["<".into()]]),
            "<table>\n<tr><th>a</th></tr>\n<tr><td>&lt;</td></tr>\n</table>\n"
        );
    }
}
