//! Sensors: perspective cameras, with or without a thin lens, and orthographic ones, with their film size.
//!
//! Mitsuba's camera looks along its own +Z with +X to the left; [`Camera`] looks along -Z with +X to the
//! right, so both axes are reversed.

use glam::{Affine3A, DMat4, DVec3, Vec2};

use super::Loader;
use super::values::Plugin;
use super::xml::Element;
use crate::scene::{Camera, FovAxis, Lens, LoadError, Projection};

impl<'a> Loader<'a> {
    /// Adds a sensor's camera; one of an unknown kind is dropped with a warning.
    pub(super) fn sensor(&mut self, element: &'a Element) -> Result<(), LoadError> {
        let plugin = self.plugin(element)?;
        let kind = element.plugin();
        if !matches!(kind, "perspective" | "thinlens" | "orthographic" | "perspective_rdist") {
            self.warn(format!("{}: sensors of type `{kind}` are not supported; it is left out", element.title()));
            return Ok(());
        }
        if kind == "perspective_rdist" {
            self.warn(format!("{}: the lens is drawn without distortion", element.title()));
        }
        let (width, height) = self.film(&plugin)?;
        let to_world = plugin.transform("to_world")?.unwrap_or(DMat4::IDENTITY);
        let camera_frame = self.camera_frame(element, to_world)?;
        let projection = if kind == "orthographic" {
            let half_width = to_world.x_axis.truncate().length() as f32;
            Projection::Orthographic { half_extent: Vec2::new(half_width, half_width * height as f32 / width as f32) }
        } else {
            let (fov, axis) = field_of_view(&plugin)?;
            Projection::Perspective { fov, axis }
        };
        let lens = if kind == "thinlens" { lens(&plugin)? } else { None };
        plugin.ignore(&["near_clip", "far_clip", "focus_distance", "kc", "shutter_open", "shutter_close"]);
        plugin.nested("sampler");
        self.finish(&plugin);
        let name =
            element.attribute("id").map_or_else(|| format!("sensor {}", self.scene.cameras.len()), str::to_owned);
        self.scene.cameras.push(Camera {
            name,
            world_from_camera: camera_frame,
            projection,
            lens,
            film_size: Some((width, height)),
        });
        Ok(())
    }

    /// Returns the film's size, whose default in Mitsuba is 768 x 576.
    fn film(&mut self, sensor: &Plugin<'a>) -> Result<(u32, u32), LoadError> {
        let Some(element) = sensor.only("film")? else { return Ok((768, 576)) };
        let film = self.plugin(element)?;
        let side = |name: &str, missing: u32| match film.integer(name)? {
            None => Ok(missing),
            // GPUs render to at most 2^14 pixels a side.
            Some(pixels) if (1..=16384).contains(&pixels) => Ok(pixels as u32),
            Some(pixels) => Err(element.error(format!("the film's {name} is {pixels}; it has to be 1 to 16384"))),
        };
        let size = (side("width", 768)?, side("height", 576)?);
        let crops = ["crop_width", "crop_height", "crop_offset_x", "crop_offset_y"];
        if crops.map(|name| film.get(name)).iter().any(Option::is_some) {
            self.warn(format!("{}: the film's crop window is ignored; the whole picture is drawn", element.title()));
        }
        Ok(size)
    }

    /// Returns a rigid frame from a matrix that may scale; a mirroring one is corrected with a warning.
    fn camera_frame(&mut self, element: &Element, to_world: DMat4) -> Result<Affine3A, LoadError> {
        let axis = |v: glam::DVec4| v.truncate();
        let ahead = axis(to_world.z_axis).try_normalize();
        let up = ahead.and_then(|ahead| axis(to_world.y_axis).reject_from_normalized(ahead).try_normalize());
        let (Some(ahead), Some(up)) = (ahead, up) else {
            return Err(element.error("the sensor's to_world is singular: it needs a view and an up direction"));
        };
        let left = up.cross(ahead);
        if left.dot(axis(to_world.x_axis)) < 0.0 {
            self.warn(format!("{}: to_world mirrors the picture; it is drawn unmirrored", element.title()));
        }
        let columns: [DVec3; 4] = [-left, up, -ahead, axis(to_world.w_axis)];
        let [x, y, z, w] = columns.map(|v| v.as_vec3a());
        Ok(Affine3A::from_cols(x, y, z, w))
    }
}

/// Returns the lens of a `thinlens`, or `None` for a radius of zero. Mitsuba's default focus is the far
/// plane.
fn lens(sensor: &Plugin) -> Result<Option<Lens>, LoadError> {
    let error = |cause: String| Err(sensor.element.error(cause));
    let Some(radius) = sensor.float("aperture_radius")? else {
        return error("a thin lens needs an aperture_radius".to_owned());
    };
    let focus = match sensor.float("focus_distance")? {
        Some(focus) => focus,
        None => sensor.float("far_clip")?.unwrap_or(1e4),
    };
    if radius < 0.0 || focus <= 0.0 {
        return error(format!("aperture_radius is {radius}, focus_distance {focus}; they have to be positive"));
    }
    Ok((radius > 0.0).then_some(Lens { radius, focus }))
}

/// Returns `fov` along `fov_axis`, or the angle of a 35 mm `focal_length`, which spans the diagonal of 36 x
/// 24 mm.
pub(super) fn field_of_view(sensor: &Plugin) -> Result<(f32, FovAxis), LoadError> {
    let error = |cause: &str| Err(sensor.element.error(cause));
    let axis = match sensor.string("fov_axis")?.map(str::to_ascii_lowercase).as_deref() {
        None | Some("x") => FovAxis::X,
        Some("y") => FovAxis::Y,
        Some("diagonal") => FovAxis::Diagonal,
        Some("smaller") => FovAxis::Smaller,
        Some("larger") => FovAxis::Larger,
        Some(other) => return error(&format!("fov_axis is `{other}`; it has to be x, y, diagonal, smaller or larger")),
    };
    if let Some(degrees) = sensor.float("fov")? {
        if !(degrees > 0.0 && degrees < 180.0) {
            return error(&format!("fov is {degrees} degrees; it has to lie between 0 and 180"));
        }
        return Ok((degrees.to_radians(), axis));
    }
    let text = sensor.string("focal_length")?.unwrap_or("50mm");
    match text.trim().trim_end_matches("mm").trim().parse::<f32>() {
        Ok(millis) if millis > 0.0 && millis.is_finite() => {
            let diagonal = 36.0_f32.hypot(24.0);
            Ok((2.0 * (diagonal / (2.0 * millis)).atan(), FovAxis::Diagonal))
        }
        _ => error(&format!("focal_length is `{text}`; it has to be of the form 50mm")),
    }
}
