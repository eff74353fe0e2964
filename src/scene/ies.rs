//! IES profiles: how a luminaire's intensity depends on direction, as measured (ANSI/IES LM-63, 1986 to 2019).
//!
//! Type C photometry without tilt: planes of vertical angles, 0 on the axis, at horizontal angles over all, half or a quarter of
//! the turn, or one for all. Candelas are values times the multiplier and the ballast factor. The luminaire's size is not used.

use std::path::Path;

use super::{LoadError, Mapping, Pattern};

/// Rows of the table that a profile becomes: every half degree.
const ROWS: u32 = 361;
/// Columns, unless one will do: every degree.
const COLUMNS: u32 = 360;
/// Most angles of either kind.
const MAX_ANGLES: usize = 1 << 14;

/// Reads a profile; `path` names it in errors. Gives factors up to 1, and the candelas that 1 stands for.
///
/// # Errors
/// Text that is no profile, with the line; photometry of type A or B; a tilt; angles that do not cover what they have to.
pub fn parse(text: &str, path: &Path) -> Result<(Pattern, f32), LoadError> {
    let mut lines = text.lines().enumerate();
    let Some((line, tilt)) = lines.by_ref().find(|(_, l)| l.trim_start().starts_with("TILT")) else {
        return Err(LoadError::new(path, "is no IES profile: it has no line that begins with TILT="));
    };
    if tilt.split_once('=').map(|(_, value)| value.trim()) != Some("NONE") {
        let cause = format!("`{}` is not supported: profiles without tilt say TILT=NONE", tilt.trim());
        return Err(LoadError::at(path, format!("line {}", line + 1), cause));
    }
    let separators = |c: char| c.is_whitespace() || c == ',';
    let tokens = lines.flat_map(|(line, text)| {
        text.split(separators).filter(|t| !t.is_empty()).map(move |token| (line + 1, token)).collect::<Vec<_>>()
    });
    let mut numbers = Numbers { tokens, path, line: line + 1 };
    numbers.next("the number of lamps")?;
    numbers.next("the lumens per lamp")?;
    let multiplier = numbers.positive("the candela multiplier")?;
    let vertical = numbers.count("vertical")?;
    let horizontal = numbers.count("horizontal")?;
    match numbers.next("the photometric type")? {
        1.0 => {}
        2.0 | 3.0 => return Err(numbers.error("photometry of type A and B is not supported: convert it to type C")),
        other => return Err(numbers.error(format!("the photometric type is {other}; it has to be 1 (type C)"))),
    }
    for what in ["the type of unit", "the width", "the length", "the height"] {
        numbers.next(what)?;
    }
    let ballast = numbers.positive("the ballast factor")?;
    numbers.next("the number after the ballast factor")?;
    numbers.next("the input watts")?;

    let vertical = numbers.angles("vertical", vertical)?;
    let (low, high) = (vertical[0], vertical[vertical.len() - 1]);
    if !((low == 0.0 || low == 90.0) && (high == 90.0 || high == 180.0) && low < high) {
        return Err(numbers
            .error(format!("vertical angles run from {low} to {high}; they have to cover 0-90, 90-180 or 0-180")));
    }
    let horizontal = numbers.angles("horizontal", horizontal)?;
    let span = [horizontal[0], horizontal[horizontal.len() - 1]];
    if ![[0.0; 2], [0.0, 90.0], [0.0, 180.0], [0.0, 360.0], [90.0, 270.0]].contains(&span) {
        return Err(numbers.error(format!(
            "horizontal angles run from {} to {}; they have to be 0 alone or cover 0-90, 0-180, 90-270 or 0-360",
            span[0], span[1]
        )));
    }
    let mut values = Vec::with_capacity(vertical.len() * horizontal.len());
    for _ in 0..vertical.len() * horizontal.len() {
        let value = numbers.next("a candela value")?;
        if value < 0.0 {
            return Err(numbers.error(format!("the candela value {value} is negative")));
        }
        values.push(value);
    }
    if let Some((line, token)) = numbers.tokens.next() {
        return Err(LoadError::at(path, format!("line {line}"), format!("`{token}` follows the last candela value")));
    }

    let peak = values.iter().fold(0.0, |a: f32, &b| a.max(b));
    let candelas = peak * multiplier * ballast;
    if !candelas.is_finite() {
        return Err(numbers.error("the candelas overflow: check the multiplier"));
    }
    let columns = if horizontal.len() == 1 { 1 } else { COLUMNS };
    let texel = |i: u32| {
        let v = (i / columns) as f32 * (180.0 / (ROWS - 1) as f32);
        let h = fold((i % columns) as f32 * (360.0 / columns as f32), span);
        if v < low || v > high || peak == 0.0 {
            return [0.0; 3];
        }
        let (row, fv) = between(&vertical, v);
        let (plane, fh) = between(&horizontal, h);
        let at = |plane: usize, row: usize| {
            values[plane.min(horizontal.len() - 1) * vertical.len() + row.min(vertical.len() - 1)]
        };
        let along = |plane: usize| at(plane, row) * (1.0 - fv) + at(plane, row + 1) * fv;
        [(along(plane) * (1.0 - fh) + along(plane + 1) * fh) / peak; 3]
    };
    let texels = (0..ROWS * columns).map(texel).collect();
    let name = path.display().to_string();
    Ok((Pattern { name, mapping: Mapping::Sphere, width: columns, height: ROWS, texels }, candelas))
}

/// The measured angle with the same value as one from 0 to 360: quarters and halves are mirrored.
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
        // 90 to 270: mirrored at the plane from 90 to 270.
        [90.0, 270.0] => match angle {
            a if a < 90.0 => 180.0 - a,
            a if a > 270.0 => 540.0 - a,
            a => a,
        },
        _ => angle,
    }
}

/// Which of the ascending angles is the last below one, and how far the way to the next it is.
fn between(angles: &[f32], at: f32) -> (usize, f32) {
    let index = angles.partition_point(|&a| a <= at).max(1) - 1;
    match angles.get(index + 1) {
        Some(next) => (index, ((at - angles[index]) / (next - angles[index])).clamp(0.0, 1.0)),
        None => (index, 0.0),
    }
}

/// What follows the tilt: numbers, however they are spread over lines.
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
    use std::f32::consts::PI;

    /// A file with the given angles, and values that grow by one.
    fn file(vertical: &[f32], horizontal: &[f32]) -> String {
        let list =
            |values: &mut dyn Iterator<Item = f32>| values.map(|v| v.to_string()).collect::<Vec<_>>().join("\n ");
        let values = list(&mut (1..=vertical.len() * horizontal.len()).map(|v| v as f32));
        format!(
            "IESNA:LM-63-2002\n[TEST] none\n[MANUFAC] nobody\nTILT=NONE\n1 -1 2.0 {} {} 1 2 0.1 0.1 0\n0.5, 1 60\n{}\n{}\n{values}\n",
            vertical.len(),
            horizontal.len(),
            list(&mut vertical.iter().copied()),
            list(&mut horizontal.iter().copied()),
        )
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
        // Linear from 1 to 2 to 3 over theta; the integral of theta sin theta is sin theta - theta cos theta.
        let linear = |a: f32, b: f32, t0: f32, t1: f32| {
            let slope = (b - a) / (t1 - t0);
            let moment = (t1.sin() - t1 * t1.cos()) - (t0.sin() - t0 * t0.cos());
            (a - slope * t0) * (t0.cos() - t1.cos()) + slope * moment
        };
        let expected = 2.0 * PI * (linear(1.0, 2.0, 0.0, PI / 6.0) + linear(2.0, 3.0, PI / 6.0, PI / 2.0));
        let flux = pattern.flux(|_, _| 1.0).x * candelas;
        // And the half degree over which the table falls to 0.
        assert!((flux - expected).abs() < 0.005 * 3.0 * 2.0 * PI, "{flux} is not {expected}");
    }

    #[test]
    fn quarters_and_halves_are_mirrored() {
        let of = |horizontal: &[f32]| {
            let (pattern, candelas) = read(&file(&[0.0, 180.0], horizontal)).unwrap();
            assert_eq!(pattern.width, 360);
            move |azimuth: usize| pattern.texels[180 * 360 + azimuth][0] * candelas
        };
        // In the middle of the two vertical angles, plane i has 2 i + 1.5.
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
            ("TILT=NONE", "TILT=INCLUDE", "line 4: `TILT=INCLUDE` is not supported: profiles without tilt"),
            ("TILT=NONE\n", "", "has no line that begins with TILT="),
            ("2.0 2 1 1 2", "2.0 2 1 2 2", "line 5: photometry of type A and B is not supported: convert it to type C"),
            ("2.0 2 1 1 2", "2.0 2 1 7 2", "line 5: the photometric type is 7"),
            ("2.0 2 1 1 2", "0 2 1 1 2", "line 5: the candela multiplier is 0; it has to be above 0"),
            ("2.0 2 1 1 2", "2.0 1e9 1 1 2", "line 5: the number of vertical angles is 1000000000"),
            ("2.0 2 1 1 2", "2.0 2.5 1 1 2", "whole number"),
            ("0.5, 1 60", "half, 1 60", "line 6: the ballast factor is `half`, which is not a number"),
            ("0\n 90\n0", "0\n 80\n0", "vertical angles run from 0 to 80"),
            ("0\n 90\n0", "90\n 0\n0", "line 8: vertical angles have to increase, but 0 follows 90"),
            ("90\n0\n1", "90\n45\n1", "horizontal angles run from 45 to 45"),
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
