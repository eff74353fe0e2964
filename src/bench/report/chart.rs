//! Charts of error against time as SVG: a line for the mean, a band from the lowest to the highest repeat, a
//! dot for each checkpoint. Both axes are logarithmic.

use std::ops::Range;

use plotters::coord::combinators::BindKeyPoints as _;
use plotters::prelude::{
    BLACK, ChartBuilder, Circle, Color as _, IntoDrawingArea as _, IntoLogRange as _, LineSeries, PathElement, Polygon,
    RGBColor, SVGBackend, SeriesLabelPosition, WHITE,
};

use crate::bench::BenchError;
use crate::bench::curve::{Point, error_at, log_spaced};

use super::drawing;
use super::text::short;

/// Width and height of a chart in pixels.
const SIZE: (u32, u32) = (760, 460);

/// Number of times at which repeats are averaged.
const PLACES: usize = 48;

/// Colours of the curves: the palette of Okabe and Ito, which is distinguishable with colour vision
/// deficiency, and five darker or more saturated colours. Black is reserved for the reference.
const COLORS: [RGBColor; 12] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(128, 112, 0),
    RGBColor(160, 0, 0),
    RGBColor(100, 60, 180),
    RGBColor(90, 200, 60),
    RGBColor(110, 70, 40),
    RGBColor(20, 60, 90),
];

/// Curves of a contender.
pub struct Curves<'a> {
    /// Name of the contender.
    pub name: &'a str,
    /// Curve of each repeat.
    pub repeats: Vec<Vec<Point>>,
}

/// Draws the curves of all contenders. `floor` is the reference's own error. Returns none if there are no
/// finite points.
///
/// # Errors
/// Returns [`BenchError::Report`] if drawing fails.
pub fn svg(all: &[Curves], unit: &str, floor: Option<f64>) -> Result<Option<String>, BenchError> {
    // Logarithmic axes cannot show zeros and values that are not finite.
    let drawable = |p: &&Point| p.error.is_finite() && p.error > 0.0;
    let points: Vec<&Point> = all.iter().flat_map(|c| c.repeats.iter().flatten()).filter(drawable).collect();
    let range = |value: fn(&Point) -> f64, more: Option<f64>| {
        let values = || points.iter().map(|p| value(p)).chain(more);
        let low = values().min_by(f64::total_cmp)?;
        let high = values().max_by(f64::total_cmp)?;
        Some(low / 1.3..high * 1.3)
    };
    let (Some(x), Some(y)) = (range(|p| p.seconds, None), range(|p| p.error, floor.filter(|f| *f > 0.0))) else {
        return Ok(None);
    };

    let mut out = String::new();
    {
        let root = SVGBackend::with_string(&mut out, SIZE).into_drawing_area();
        root.fill(&WHITE).map_err(|e| drawing(&e))?;
        let mut chart = ChartBuilder::on(&root)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(70)
            .build_cartesian_2d(
                x.clone().log_scale().with_key_points(ticks(&x)),
                y.clone().log_scale().with_key_points(ticks(&y)),
            )
            .map_err(|e| drawing(&e))?;
        chart
            .configure_mesh()
            .x_desc("seconds of rendering")
            .y_desc(unit)
            .x_label_formatter(&|x| short(*x))
            .y_label_formatter(&|y| short(*y))
            .label_style(("sans-serif", 14))
            .light_line_style(WHITE.mix(0.0))
            .bold_line_style(BLACK.mix(0.12))
            .draw()
            .map_err(|e| drawing(&e))?;
        if let Some(floor) = floor.filter(|f| *f > 0.0) {
            chart
                .draw_series(LineSeries::new([(x.start, floor), (x.end, floor)], BLACK.mix(0.6)))
                .map_err(|e| drawing(&e))?
                .label("error of the reference")
                .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], BLACK.mix(0.6)));
        }
        for (curves, color) in all.iter().zip(COLORS.iter().copied().cycle()) {
            let (middle, band) = over_repeats(&curves.repeats);
            chart.draw_series([Polygon::new(band, color.mix(0.15))]).map_err(|e| drawing(&e))?;
            chart
                .draw_series(LineSeries::new(middle, color.stroke_width(2)))
                .map_err(|e| drawing(&e))?
                .label(curves.name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
            let dots = curves.repeats.iter().flatten().filter(drawable);
            let dots = dots.map(|p| Circle::new((p.seconds, p.error), 2, color.mix(0.6).filled()));
            chart.draw_series(dots).map_err(|e| drawing(&e))?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerLeft)
            .label_font(("sans-serif", 14))
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK.mix(0.2))
            .draw()
            .map_err(|e| drawing(&e))?;
        root.present().map_err(|e| drawing(&e))?;
    }
    Ok(Some(out))
}

/// Returns the ticks of a logarithmic axis: 1, 2 and 5 times each power of ten over at most four decades,
/// otherwise powers of ten.
fn ticks(range: &Range<f64>) -> Vec<f64> {
    let [first, last] = [range.start, range.end].map(|end| end.log10().floor() as i32);
    let steps: &[f64] = if last - first <= 4 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let all = (first..=last).flat_map(|power| steps.iter().map(move |step| step * 10_f64.powi(power)));
    all.filter(|tick| range.contains(tick)).collect()
}

type Line = Vec<(f64, f64)>;

/// Returns the mean of the repeats over the time that all of them cover, and the outline of the band from the
/// lowest to the highest repeat.
fn over_repeats(repeats: &[Vec<Point>]) -> (Line, Line) {
    let ends = |pick: fn(&Vec<Point>) -> Option<&Point>| repeats.iter().filter_map(pick).map(|p| p.seconds);
    let first = ends(|r| r.first()).max_by(f64::total_cmp);
    let last = ends(|r| r.last()).min_by(f64::total_cmp);
    let (Some(first), Some(last)) = (first, last) else { return Default::default() };
    let (mut middle, mut low, mut high) = (Line::new(), Line::new(), Line::new());
    for seconds in log_spaced(first, last, PLACES) {
        // Rounding may move the ends slightly outside the interval.
        let seconds = seconds.clamp(first.min(last), last.max(first));
        let errors: Option<Vec<f64>> = repeats.iter().map(|r| error_at(r, seconds).filter(|e| e.is_finite())).collect();
        let Some(errors) = errors.filter(|errors| !errors.is_empty()) else { continue };
        middle.push((seconds, errors.iter().sum::<f64>() / errors.len() as f64));
        low.push((seconds, errors.iter().copied().fold(f64::INFINITY, f64::min)));
        high.push((seconds, errors.iter().copied().fold(0.0, f64::max)));
    }
    low.extend(high.into_iter().rev());
    (middle, low)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(scale: f64) -> Vec<Point> {
        [1.0, 2.0, 8.0].map(|t| Point { seconds: t, error: scale / t }).to_vec()
    }

    #[test]
    fn the_mean_lies_between_the_repeats() {
        let (middle, band) = over_repeats(&[curve(1.0), curve(3.0)]);
        assert_eq!((middle.len(), band.len()), (PLACES, 2 * PLACES));
        for (&(t, mean), &(_, low)) in middle.iter().zip(&band) {
            assert!((mean * t - 2.0).abs() < 1e-9 && (low * t - 1.0).abs() < 1e-9, "{t} {mean} {low}");
        }
        assert_eq!(over_repeats(&[]), Default::default());
    }

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        let shown: Vec<String> = ticks(&(0.03..1.3)).into_iter().map(short).collect();
        assert_eq!(shown, ["0.050", "0.10", "0.20", "0.50", "1.0"]);
        assert_eq!(ticks(&(1e-5..50.0)).len(), 7);
    }

    #[test]
    fn a_chart_names_its_curves() {
        let all = [
            Curves { name: "one", repeats: vec![curve(1.0), curve(1.5)] },
            Curves { name: "with holes", repeats: vec![vec![Point { seconds: 1.0, error: f64::NAN }]] },
        ];
        let svg = svg(&all, "rel_mse", Some(0.01)).unwrap().unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("one") && svg.contains("with holes"), "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(super::svg(&all[1..], "rel_mse", None).unwrap().is_none(), "nothing to draw");
    }
}
