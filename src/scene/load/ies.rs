//! IES profiles: the measured intensity of a luminaire as a function of direction (ANSI/IES LM-63, 1986 to
//! 2019).
//!
//! Nadir, the photometric zero, is the lamp's axis -Z; the photometric horizontal is +X (LM-63-02, section
//! 3). Type C has planes of vertical angles, 0 at the nadir, at horizontal angles over a full, half or
//! quarter turn, or one plane for all. Types A and B measure the half space around the photometric horizontal
//! and around the nadir, or one half or quarter of it with symmetry; they are resampled to the same table.
//! Candelas are values times the multiplier and the ballast factor. The luminaire's size is not used.
//!
//! Tilt factors describe the loss of intensity when the luminaire is tilted out of its measured orientation.
//! Luminaires are rendered in the measured orientation, for which the factor is 1: a table of factors is
//! parsed and not used.

use std::path::Path;

use crate::scene::{LoadError, Mapping, Pattern};

/// Number of rows of the resampled table: one every half degree.
const ROWS: u32 = 361;
/// Number of columns, one every degree; a single column suffices for rotational symmetry.
const COLUMNS: u32 = 360;
/// Tolerance in degrees by which rounding may move angles of types A and B outside the measured range.
const SLACK: f64 = 1e-4;
/// Maximum number of vertical and of horizontal angles.
const MAX_ANGLES: usize = 1 << 14;

/// Parses a profile; `path` names it in errors. Returns factors up to 1 and the candelas of the factor 1.
///
/// # Errors
/// Text that is not a profile and angles that do not cover a valid range are errors; the message names the
/// line.
pub fn parse(text: &str, path: &Path) -> Result<(Pattern, f32), LoadError> {
    let mut lines = text.lines().enumerate();
    let Some((line, tilt)) = lines.by_ref().find(|(_, l)| l.trim_start().starts_with("TILT")) else {
        return Err(LoadError::new(path, "is no IES profile: it has no line that begins with TILT="));
    };
    let included = includes_tilt_table(tilt, line + 1, path)?;
    let separators = |c: char| c.is_whitespace() || c == ',';
    let tokens = lines.flat_map(|(line, text)| {
        text.split(separators).filter(|t| !t.is_empty()).map(move |token| (line + 1, token)).collect::<Vec<_>>()
    });
    let mut numbers = Numbers { tokens, path, line: line + 1 };
    if included {
        numbers.skip_tilt()?;
    }
    let measurement = numbers.measurement()?;
    if let Some((line, token)) = numbers.tokens.next() {
        return Err(LoadError::at(path, format!("line {line}"), format!("`{token}` follows the last candela value")));
    }

    let peak = measurement.values.iter().fold(0.0, |a: f32, &b| a.max(b));
    let candelas = peak * measurement.multiplier * measurement.ballast;
    if !candelas.is_finite() {
        return Err(numbers.error("the candelas overflow: check the multiplier"));
    }
    let columns = if measurement.horizontal.len() == 1 { 1 } else { COLUMNS };
    let texels = measurement.resample(columns, peak);
    let name = path.display().to_string();
    Ok((Pattern { name, mapping: Mapping::Sphere, width: columns, height: ROWS, texels }, candelas))
}

/// Parses the TILT line; returns true if a table of tilt factors follows it.
fn includes_tilt_table(tilt: &str, line: usize, path: &Path) -> Result<bool, LoadError> {
    match tilt.split_once('=').map_or("", |(_, value)| value.trim()) {
        "NONE" => Ok(false),
        "INCLUDE" => Ok(true),
        "" => {
            let cause = format!("`{}` is neither TILT=NONE, TILT=INCLUDE nor TILT= and a file", tilt.trim());
            Err(LoadError::at(path, format!("line {line}"), cause))
        }
        file => {
            log::warn!(
                "{}: the tilt factors of {file} are not read: the lamp is rendered in its measured orientation",
                path.display()
            );
            Ok(false)
        }
    }
}

/// The measured intensities of a luminaire.
struct Measurement {
    photometry: Photometry,
    /// Candela multiplier.
    multiplier: f32,
    /// Ballast factor.
    ballast: f32,
    /// Vertical angles, ascending, degrees.
    vertical: Vec<f32>,
    /// Horizontal angles, ascending, degrees.
    horizontal: Vec<f32>,
    /// Values of each horizontal angle by vertical angle.
    values: Vec<f32>,
}

impl Measurement {
    /// Resamples the values, divided by `peak`, to the table of a sphere pattern.
    fn resample(&self, columns: u32, peak: f32) -> Vec<[f32; 3]> {
        let Self { vertical, horizontal, values, .. } = self;
        let spans = [ends(vertical), ends(horizontal)];
        let texel = |i: u32| {
            let polar = (i / columns) as f32 * (180.0 / (ROWS - 1) as f32);
            let azimuth = (i % columns) as f32 * (360.0 / columns as f32);
            let Some([v, h]) = self.photometry.measured(polar, azimuth, spans).filter(|_| peak > 0.0) else {
                return [0.0; 3];
            };
            let (row, fv) = between(vertical, v);
            let (plane, fh) = between(horizontal, h);
            let at = |plane: usize, row: usize| {
                values[plane.min(horizontal.len() - 1) * vertical.len() + row.min(vertical.len() - 1)]
            };
            let along = |plane: usize| at(plane, row) * (1.0 - fv) + at(plane, row + 1) * fv;
            [(along(plane) * (1.0 - fh) + along(plane + 1) * fh) / peak; 3]
        };
        (0..ROWS * columns).map(texel).collect()
    }
}

/// Returns the first and the last of a list of angles, which is not empty.
fn ends(angles: &[f32]) -> [f32; 2] {
    [angles[0], angles[angles.len() - 1]]
}

/// Coordinate systems of the measurement, degrees.
#[derive(Clone, Copy)]
enum Photometry {
    /// Horizontal angles turn clockwise around the vertical axis, vertical angles rise from the horizontal.
    A,
    /// Vertical angles turn around the horizontal axis perpendicular to the photometric horizontal, from the
    /// nadir to the photometric horizontal; horizontal angles are the elevation above the plane normal to
    /// that axis, clockwise.
    B,
    /// Horizontal angles turn counterclockwise around the vertical axis, vertical angles are measured from
    /// the nadir.
    C,
}

impl Photometry {
    /// Returns the valid ranges of vertical and horizontal angles.
    fn ranges(self) -> (&'static [[f32; 2]], &'static [[f32; 2]]) {
        const HALVES: &[[f32; 2]] = &[[0.0, 90.0], [-90.0, 90.0]];
        match self {
            Self::A | Self::B => (HALVES, HALVES),
            Self::C => (
                &[[0.0, 90.0], [90.0, 180.0], [0.0, 180.0]],
                &[[0.0; 2], [0.0, 90.0], [0.0, 180.0], [90.0, 270.0], [0.0, 360.0]],
            ),
        }
    }

    /// Returns the measured vertical and horizontal angle of a direction in coordinates of type C, or `None`
    /// outside the measured range. A measured span that begins at 0 is mirrored.
    fn measured(self, polar: f32, azimuth: f32, spans: [[f32; 2]; 2]) -> Option<[f32; 2]> {
        if matches!(self, Self::C) {
            let [[low, high], span] = spans;
            return (low..=high).contains(&polar).then(|| [polar, fold(azimuth, span)]);
        }
        let (sin, cos) = f64::from(polar).to_radians().sin_cos();
        let (across, forward) = f64::from(azimuth).to_radians().sin_cos();
        // Forward is the photometric horizontal.
        let [forward, right, up] = [sin * forward, -sin * across, -cos];
        let angles = match self {
            Self::A => [up.atan2(forward.hypot(right)), right.atan2(forward)],
            _ => [forward.atan2(-up), right.atan2(forward.hypot(up))],
        };
        let folded = [0, 1].map(|i| {
            let angle = angles[i].to_degrees();
            if spans[i][0] == 0.0 { angle.abs() } else { angle }
        });
        folded
            .iter()
            .all(|angle| angle.abs() <= 90.0 + SLACK)
            .then(|| folded.map(|angle| angle.clamp(-90.0, 90.0) as f32))
    }
}

fn out_of_range(kind: &str, [low, high]: [f32; 2], valid: &[[f32; 2]]) -> String {
    let range = |&[from, to]: &[f32; 2]| if from == to { format!("{from} alone") } else { format!("{from} to {to}") };
    let valid: Vec<String> = valid.iter().map(range).collect();
    format!("{kind} angles run from {low} to {high}; they have to cover {}", valid.join(", or "))
}

/// Maps an angle from 0 to 360 degrees into the measured span by symmetry: quarters and halves are mirrored.
fn fold(angle: f32, span: [f32; 2]) -> f32 {
    match span {
        [0.0, 0.0] => 0.0,
        [0.0, 90.0] => {
            let half = if angle > 180.0 { 360.0 - angle } else { angle };
            if half > 90.0 { 180.0 - half } else { half }
        }
        [0.0, 180.0] => {
            if angle > 180.0 {
                360.0 - angle
            } else {
                angle
            }
        }
        // This half is mirrored at the plane from 90 to 270 degrees.
        [90.0, 270.0] => match angle {
            a if a < 90.0 => 180.0 - a,
            a if a > 270.0 => 540.0 - a,
            a => a,
        },
        _ => angle,
    }
}

/// Returns the index of the last of the ascending angles that is not above `at`, and the interpolation weight
/// of the next one.
fn between(angles: &[f32], at: f32) -> (usize, f32) {
    let index = angles.partition_point(|&a| a <= at).max(1) - 1;
    match angles.get(index + 1) {
        Some(next) => (index, ((at - angles[index]) / (next - angles[index])).clamp(0.0, 1.0)),
        None => (index, 0.0),
    }
}

/// The numbers after the tilt line, independent of line breaks.
struct Numbers<'a, I> {
    tokens: I,
    path: &'a Path,
    line: usize,
}

impl<'a, I: Iterator<Item = (usize, &'a str)>> Numbers<'a, I> {
    fn next(&mut self, what: &str) -> Result<f32, LoadError> {
        let Some((line, token)) = self.tokens.next() else {
            return Err(self.error(format!("the file ends before {what}")));
        };
        self.line = line;
        match token.parse::<f32>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.error(format!("{what} is `{token}`, which is not a number"))),
        }
    }

    fn positive(&mut self, what: &str) -> Result<f32, LoadError> {
        let value = self.next(what)?;
        if value > 0.0 { Ok(value) } else { Err(self.error(format!("{what} is {value}; it has to be above 0"))) }
    }

    fn count(&mut self, kind: &str) -> Result<usize, LoadError> {
        let what = format!("the number of {kind} angles");
        let value = self.next(&what)?;
        let count = value as usize;
        if value.fract() == 0.0 && (1..=MAX_ANGLES).contains(&count) {
            return Ok(count);
        }
        Err(self.error(format!("{what} is {value}; it has to be a whole number from 1 to {MAX_ANGLES}")))
    }

    /// Skips the tilt table: the lamp's geometry in the luminaire, the number of factors, their angles and
    /// the factors.
    fn skip_tilt(&mut self) -> Result<(), LoadError> {
        let geometry = self.next("the lamp's geometry in the luminaire")?;
        if ![1.0, 2.0, 3.0].contains(&geometry) {
            return Err(
                self.error(format!("the lamp's geometry in the luminaire is {geometry}; it has to be 1, 2 or 3"))
            );
        }
        let count = self.count("tilt")?;
        self.angles("tilt", count)?;
        for _ in 0..count {
            self.positive("a tilt factor")?;
        }
        Ok(())
    }

    /// Reads everything after the tilt table: photometry, angles and candela values.
    fn measurement(&mut self) -> Result<Measurement, LoadError> {
        self.next("the number of lamps")?;
        self.next("the lumens per lamp")?;
        let multiplier = self.positive("the candela multiplier")?;
        let vertical = self.count("vertical")?;
        let horizontal = self.count("horizontal")?;
        let photometry = match self.next("the photometric type")? {
            1.0 => Photometry::C,
            2.0 => Photometry::B,
            3.0 => Photometry::A,
            other => return Err(self.error(format!("the photometric type is {other}; it has to be 1, 2 or 3"))),
        };
        for what in ["the type of unit", "the width", "the length", "the height"] {
            self.next(what)?;
        }
        let ballast = self.positive("the ballast factor")?;
        self.next("the number after the ballast factor")?;
        self.next("the input watts")?;

        let (verticals, horizontals) = photometry.ranges();
        let vertical = self.angles("vertical", vertical)?;
        if !verticals.contains(&ends(&vertical)) {
            return Err(self.error(out_of_range("vertical", ends(&vertical), verticals)));
        }
        let horizontal = self.angles("horizontal", horizontal)?;
        if !horizontals.contains(&ends(&horizontal)) {
            return Err(self.error(out_of_range("horizontal", ends(&horizontal), horizontals)));
        }
        let mut values = Vec::with_capacity(vertical.len() * horizontal.len());
        for _ in 0..vertical.len() * horizontal.len() {
            let value = self.next("a candela value")?;
            if value < 0.0 {
                return Err(self.error(format!("the candela value {value} is negative")));
            }
            values.push(value);
        }
        Ok(Measurement { photometry, multiplier, ballast, vertical, horizontal, values })
    }

    fn angles(&mut self, kind: &str, count: usize) -> Result<Vec<f32>, LoadError> {
        let mut angles: Vec<f32> = Vec::with_capacity(count);
        for _ in 0..count {
            let angle = self.next(&format!("a {kind} angle"))?;
            if let Some(last) = angles.last().filter(|last| **last >= angle) {
                return Err(self.error(format!("{kind} angles have to increase, but {angle} follows {last}")));
            }
            angles.push(angle);
        }
        Ok(angles)
    }

    fn error(&self, cause: impl Into<String>) -> LoadError {
        LoadError::at(self.path, format!("line {}", self.line), cause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::f32::consts::{PI, TAU};

    /// Returns a file of type C with the given angles, and values that increase by one.
    fn file(vertical: &[f32], horizontal: &[f32]) -> String {
        let values: Vec<f32> = (1..=vertical.len() * horizontal.len()).map(|v| v as f32).collect();
        file_of(1, vertical, horizontal, &values)
    }

    fn file_of(photometry: u32, vertical: &[f32], horizontal: &[f32], values: &[f32]) -> String {
        let list = |values: &[f32]| values.iter().map(f32::to_string).collect::<Vec<_>>().join("\n ");
        format!(
            "IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] nobody\nTILT=NONE\n1 -1 2.0 {} {} {photometry} 2 0.1 0.1 0\n0.5, 1 60\n{}\n{}\n{}\n",
            vertical.len(),
            horizontal.len(),
            list(vertical),
            list(horizontal),
            list(values),
        )
    }

    /// Returns a file of a distribution over directions with the nadir at -Z and the photometric horizontal
    /// at +X, every five degrees.
    fn measure(photometry: u32, [low, high]: [i16; 2], [from, to]: [i16; 2], value: impl Fn(Vec3) -> f32) -> String {
        let angles = |from: i16, to: i16| (from..=to).step_by(5).map(f32::from).collect::<Vec<_>>();
        let (vertical, horizontal) = (angles(low, high), angles(from, to));
        let values =
            horizontal.iter().flat_map(|h| vertical.iter().map(move |v| [h, v].map(|a| a.to_radians().sin_cos())));
        let direction = |[(sin_h, cos_h), (sin_v, cos_v)]: [(f32, f32); 2]| match photometry {
            1 => Vec3::new(sin_v * cos_h, sin_v * sin_h, -cos_v),
            // Clockwise, seen from above, is towards -Y.
            2 => Vec3::new(cos_h * sin_v, -sin_h, -cos_h * cos_v),
            _ => Vec3::new(cos_v * cos_h, -cos_v * sin_h, sin_v),
        };
        let values: Vec<f32> = values.map(|angles| value(direction(angles))).collect();
        file_of(photometry, &vertical, &horizontal, &values)
    }

    /// Returns the candelas by the angle from the axis in steps of half a degree and the azimuth in degrees.
    fn candelas(text: &str) -> impl Fn(usize, usize) -> f32 + use<> {
        let (pattern, candelas) = read(text).unwrap();
        move |half_degrees, azimuth| pattern.texels[half_degrees * 360 + azimuth][0] * candelas
    }

    #[test]
    fn types_a_and_b_are_as_type_c() {
        type Case<'a> = (&'a dyn Fn(usize, usize) -> f32, String, fn(Vec3) -> bool);
        // The function has no symmetry.
        let value = |d: Vec3| 3.0 + d.x + 0.7 * d.y - 0.5 * d.z + 0.6 * d.x * d.y;
        let (below, ahead) = (|d: Vec3| d.z < -0.01, |d: Vec3| d.x > 0.01);
        let both = [-90, 90];
        let mirrored = |d: Vec3| value(Vec3::new(d.x.abs(), -d.y.abs(), d.z));
        let risen = |d: Vec3| value(Vec3::new(d.x, -d.y.abs(), d.z.abs()));
        let c = candelas(&measure(1, [0, 180], [0, 360], value));
        let c_mirrored = candelas(&measure(1, [0, 180], [0, 360], mirrored));
        let c_risen = candelas(&measure(1, [0, 180], [0, 360], risen));
        let cases: [Case; 4] = [
            (&c, measure(2, both, both, value), below),
            (&c, measure(3, both, both, value), ahead),
            // These are quarters of positive angles.
            (&c_mirrored, measure(2, [0, 90], [0, 90], value), below),
            (&c_risen, measure(3, [0, 90], [0, 90], value), ahead),
        ];
        for (expected, text, lit) in cases {
            let actual = candelas(&text);
            let mut compared = 0;
            for (half_degrees, azimuth) in (1..360).step_by(7).flat_map(|v| (0..360).step_by(11).map(move |h| (v, h))) {
                let (polar, around) = ((half_degrees as f32 * 0.5).to_radians(), (azimuth as f32).to_radians());
                let d = Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), -polar.cos());
                let (a, e) = (actual(half_degrees, azimuth), expected(half_degrees, azimuth));
                if lit(d) {
                    // Both are linear between angles five degrees apart.
                    assert!((a - e).abs() < 0.01, "{half_degrees} {azimuth}: {a} is not {e}");
                    compared += 1;
                } else if !lit(-d) {
                    continue;
                } else {
                    assert_eq!(a, 0.0, "{half_degrees} {azimuth}");
                }
            }
            assert!(compared > 700, "{compared}");
        }
    }

    #[test]
    fn even_light_stays_even() {
        for photometry in [2, 3] {
            for from in [-90, 0] {
                let (pattern, candelas) = read(&measure(photometry, [from, 90], [from, 90], |_| 2.0)).unwrap();
                assert_eq!(candelas, 2.0);
                assert!(pattern.texels.iter().flatten().all(|&v| v == 0.0 || (v - 1.0).abs() < 1e-6));
                // The flux is that of the half space plus half a degree in which the table falls to 0.
                let flux = pattern.flux(|_, _| 1.0).x;
                assert!((flux / TAU - 1.0).abs() < 0.01, "{photometry}, {from}: {flux}");
            }
        }
    }

    #[test]
    fn tilt_factors_are_read_over() {
        let plain = file(&[0.0, 30.0, 90.0], &[0.0]);
        let tilted = |tilt: &str| read(&plain.replacen("TILT=NONE", tilt, 1));
        let expected = read(&plain).unwrap();
        assert_eq!(tilted("TILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.9\n0.8").unwrap(), expected);
        assert_eq!(tilted("TILT=lamp.tlt").unwrap(), expected);
        for (tilt, says) in [
            ("TILT=", "line 4: `TILT=` is neither"),
            ("TILT=INCLUDE\n4\n1\n0\n1", "line 5: the lamp's geometry in the luminaire is 4"),
            ("TILT=INCLUDE\n1\n0\n0\n1", "line 6: the number of tilt angles is 0"),
            ("TILT=INCLUDE\n1\n2\n90 0\n1 1", "line 7: tilt angles have to increase, but 0 follows 90"),
            ("TILT=INCLUDE\n1\n1\n0\n-1", "line 8: a tilt factor is -1; it has to be above 0"),
            ("TILT=INCLUDE\n1\n1\n0\nx", "line 8: a tilt factor is `x`"),
        ] {
            let error = tilted(tilt).unwrap_err();
            assert!(error.contains(says), "{error}, not {says}");
        }
    }

    fn read(text: &str) -> Result<(Pattern, f32), String> {
        parse(text, Path::new("lamp.ies")).map_err(|e| e.to_string())
    }

    #[test]
    fn one_plane_is_all_around() {
        let (pattern, candelas) = read(&file(&[0.0, 30.0, 90.0], &[0.0])).unwrap();
        assert_eq!((pattern.width, pattern.height, candelas), (1, 361, 3.0 * 2.0 * 0.5));
        let at = |degrees: usize| pattern.texels[degrees * 2][0] * candelas;
        for (degrees, expected) in [(0, 1.0), (15, 1.5), (30, 2.0), (60, 2.5), (90, 3.0), (91, 0.0), (180, 0.0)] {
            assert!((at(degrees) - expected).abs() < 1e-5, "{degrees}: {}", at(degrees));
        }
        assert!((pattern.outer_angle().to_degrees() - 90.5).abs() < 0.01);
        // The intensity is linear from 1 to 2 to 3 over theta; the integral of theta sin theta is sin theta -
        // theta cos theta.
        let linear = |a: f32, b: f32, t0: f32, t1: f32| {
            let slope = (b - a) / (t1 - t0);
            let moment = (t1.sin() - t1 * t1.cos()) - (t0.sin() - t0 * t0.cos());
            (a - slope * t0) * (t0.cos() - t1.cos()) + slope * moment
        };
        let expected = 2.0 * PI * (linear(1.0, 2.0, 0.0, PI / 6.0) + linear(2.0, 3.0, PI / 6.0, PI / 2.0));
        let flux = pattern.flux(|_, _| 1.0).x * candelas;
        // The tolerance covers the half degree in which the table falls to 0.
        assert!((flux - expected).abs() < 0.005 * 3.0 * 2.0 * PI, "{flux} is not {expected}");
    }

    #[test]
    fn quarters_and_halves_are_mirrored() {
        let of = |horizontal: &[f32]| {
            let (pattern, candelas) = read(&file(&[0.0, 180.0], horizontal)).unwrap();
            assert_eq!(pattern.width, 360);
            move |azimuth: usize| pattern.texels[180 * 360 + azimuth][0] * candelas
        };
        // In the middle of the two vertical angles, plane i has the value 2 i + 1.5.
        let quarter = of(&[0.0, 90.0]);
        for (azimuth, expected) in [(0, 1.5), (45, 2.5), (90, 3.5), (135, 2.5), (180, 1.5), (270, 3.5), (315, 2.5)] {
            assert!((quarter(azimuth) - expected).abs() < 1e-4, "{azimuth}: {}", quarter(azimuth));
        }
        let half = of(&[0.0, 90.0, 180.0]);
        for (azimuth, expected) in [(0, 1.5), (90, 3.5), (135, 4.5), (180, 5.5), (225, 4.5), (270, 3.5), (359, 1.5)] {
            assert!((half(azimuth) - expected).abs() < 0.03, "{azimuth}: {}", half(azimuth));
        }
        let other = of(&[90.0, 180.0, 270.0]);
        for (azimuth, expected) in [(90, 1.5), (0, 3.5), (180, 3.5), (270, 5.5), (45, 2.5), (315, 4.5)] {
            assert!((other(azimuth) - expected).abs() < 1e-4, "{azimuth}: {}", other(azimuth));
        }
        let full = of(&[0.0, 90.0, 180.0, 270.0, 360.0]);
        for (azimuth, expected) in [(0, 1.5), (90, 3.5), (225, 6.5), (270, 7.5), (315, 8.5)] {
            assert!((full(azimuth) - expected).abs() < 1e-4, "{azimuth}: {}", full(azimuth));
        }
    }

    #[test]
    fn errors_name_line_and_cure() {
        let good = file(&[0.0, 90.0], &[0.0]);
        for (from, to, says) in [
            ("TILT=NONE\n", "", "has no line that begins with TILT="),
            (
                "2.0 2 1 1 2",
                "2.0 2 1 2 2",
                "line 9: horizontal angles run from 0 to 0; they have to cover 0 to 90, or -90 to 90",
            ),
            ("2.0 2 1 1 2", "2.0 2 1 7 2", "line 5: the photometric type is 7; it has to be 1, 2 or 3"),
            ("2.0 2 1 1 2", "0 2 1 1 2", "line 5: the candela multiplier is 0; it has to be above 0"),
            ("2.0 2 1 1 2", "2.0 1e9 1 1 2", "line 5: the number of vertical angles is 1000000000"),
            ("2.0 2 1 1 2", "2.0 2.5 1 1 2", "whole number"),
            ("0.5, 1 60", "half, 1 60", "line 6: the ballast factor is `half`, which is not a number"),
            ("0\n 90\n0", "0\n 80\n0", "vertical angles run from 0 to 80"),
            ("0\n 90\n0", "90\n 0\n0", "line 8: vertical angles have to increase, but 0 follows 90"),
            ("90\n0\n1", "90\n45\n1", "horizontal angles run from 45 to 45; they have to cover 0 alone, or 0 to 90"),
            ("\n1\n 2\n", "\n1\n -2\n", "line 11: the candela value -2 is negative"),
            ("\n1\n 2\n", "\n1\n inf\n", "which is not a number"),
            ("\n1\n 2\n", "\n1\n", "the file ends before a candela value"),
            ("\n1\n 2\n", "\n1\n 2\n3\n", "line 12: `3` follows the last candela value"),
        ] {
            let bad = good.replacen(from, to, 1);
            assert_ne!(bad, good, "{from}");
            let error = read(&bad).unwrap_err();
            assert!(error.contains(says) && error.starts_with("lamp.ies"), "{error}, not {says}");
        }
        let dark = read(&good.replace("\n1\n 2\n", "\n0\n 0\n")).unwrap();
        assert_eq!((dark.1, dark.0.flux(|_, _| 1.0).x), (0.0, 0.0));
    }
}
