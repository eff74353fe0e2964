//! Emitters: points, spots, projectors, directional lights and skies. Area lights belong to shapes and become
//! their material's emission.

use glam::{DMat3, DMat4, DVec3, Mat3, Vec2, Vec3};

use super::Loader;
use super::sensors;
use super::spectra::Use;
use super::textures::is_texture;
use super::values::Plugin;
use super::xml::Element;
use crate::scene::load::sky::ClearSky;
use crate::scene::model::texture::linear_from_srgb;
use crate::scene::{
    Color, Cone, Emission, Environment, EnvironmentMap, FovAxis, Lamp, Light, LoadError, Mapping, Pattern, Rows,
    SpotFalloff,
};

impl<'a> Loader<'a> {
    /// Adds an emitter that is not part of a shape.
    pub(super) fn emitter(&mut self, element: &'a Element) -> Result<(), LoadError> {
        let plugin = self.plugin(element)?;
        let first = self.scene.lights.len();
        plugin.ignore(&["sampling_weight"]);
        let to_world = plugin.transform("to_world")?;
        let place = to_world.unwrap_or(DMat4::IDENTITY);
        match element.plugin() {
            "point" => {
                let intensity = self.light_color(&plugin, "intensity")?;
                let position = plugin.vector("position")?.unwrap_or_else(|| place.w_axis.truncate().as_vec3());
                self.scene.lights.push(Light::Point { position, intensity });
            }
            "spot" => {
                let intensity = self.light_color(&plugin, "intensity")?;
                let cutoff = plugin.float("cutoff_angle")?.unwrap_or(20.0);
                let beam = plugin.float("beam_width")?.unwrap_or(cutoff * 0.75);
                if !(cutoff > 0.0 && cutoff <= 180.0 && beam >= 0.0) {
                    return Err(element.error("cutoff_angle has to lie between 0 and 180 degrees, beam_width above 0"));
                }
                let (inner_angle, outer_angle) = (beam.min(cutoff).to_radians(), cutoff.to_radians());
                let position = place.w_axis.truncate().as_vec3();
                let falloff = SpotFalloff::AngleLinear;
                let light = match plugin.get("texture").filter(|e| is_texture(e)) {
                    None => {
                        let direction = self.direction(element, place)?;
                        Light::Spot { position, direction, intensity, inner_angle, outer_angle, falloff }
                    }
                    Some(_) if cutoff >= 90.0 => {
                        return Err(element.error("a spot with a texture needs a cutoff_angle below 90 degrees"));
                    }
                    Some(texture) => {
                        // u grows along +X and v along +Y of the emitter, whose axis is +Z.
                        let half_extent = Vec2::splat(outer_angle.tan());
                        let turn = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0]);
                        let (pattern, world_from_lamp) =
                            self.image_pattern(texture, Mapping::Image { half_extent }, place, turn)?;
                        let cone = Some(Cone { inner_angle, outer_angle, falloff });
                        Light::Lamp(Lamp { position, world_from_lamp, radius: 0.0, intensity, cone, pattern })
                    }
                };
                self.scene.lights.push(light);
            }
            "projector" => {
                let light = self.projector(&plugin, place)?;
                self.scene.lights.push(light);
            }
            "directional" => {
                let irradiance = self.light_color(&plugin, "irradiance")?;
                let direction = match plugin.vector("direction")? {
                    None => self.direction(element, place)?,
                    Some(direction) => {
                        direction.try_normalize().ok_or_else(|| element.error("the light's direction is zero"))?
                    }
                };
                self.scene.lights.push(Light::Directional { direction, irradiance });
            }
            "constant" => {
                let radiance = self.light_color(&plugin, "radiance")?;
                self.sky(element, Environment { radiance, map: None, world_from_environment: Mat3::IDENTITY });
            }
            "envmap" => {
                let environment = self.environment_map(&plugin, place)?;
                self.sky(element, environment);
            }
            "sky" | "sun" | "sunsky" => self.clear_sky(&plugin, place)?,
            "timed_sunsky" => {
                self.warn(format!("{}: the sun does not move; it stands where it begins", element.title()));
                self.clear_sky(&plugin, place)?;
            }
            "area" => return Err(element.error("an area emitter has to stand inside a shape")),
            kind => {
                self.warn(format!("{}: emitters of type `{kind}` are not supported; it is left out", element.title()));
                return Ok(());
            }
        }
        self.scene.group_lights(first, element.attribute("id"));
        self.finish(&plugin);
        Ok(())
    }

    /// Converts a shape's emitter to its material's emission.
    pub(super) fn emission(&mut self, element: &'a Element) -> Result<Option<Emission>, LoadError> {
        let plugin = self.plugin(element)?;
        plugin.ignore(&["sampling_weight"]);
        if element.plugin() != "area" {
            self.warn(format!("{}: a shape's emitter has to be `area`; it is left out", element.title()));
            return Ok(None);
        }
        let radiance = match plugin.get("radiance") {
            Some(texture) if texture.tag == "texture" => self.color_texture(texture, Use::Radiance)?,
            _ => Color::from(self.light_color(&plugin, "radiance")?),
        };
        self.finish(&plugin);
        Ok(Some(Emission { radiance, two_sided: false }))
    }

    /// Adds the analytic sky, its sun, or both.
    fn clear_sky(&mut self, plugin: &Plugin<'a>, place: DMat4) -> Result<(), LoadError> {
        let element = plugin.element;
        let float = |name: &str, missing: f32| Ok::<f32, LoadError>(plugin.float(name)?.unwrap_or(missing));
        let Some((world, _)) = rotation(place) else {
            return Err(element.error("the sky's to_world is singular"));
        };
        // The map here has +Y up, as 0.5 has; version 3 has +Z up.
        let z_up = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
        let world_from_sky = if element.legacy { world } else { world * z_up };
        let towards_sun = match plugin.vector("sun_direction")? {
            Some(direction) => {
                let direction = direction.try_normalize();
                direction.ok_or_else(|| element.error("sun_direction is zero"))?.as_dvec3()
            }
            None => {
                let [zenith, azimuth] = sun_position(plugin)?;
                let (sin, cos) = azimuth.sin_cos();
                if element.legacy {
                    world * DVec3::new(sin * zenith.sin(), zenith.cos(), -cos * zenith.sin())
                } else {
                    // +X is south and +Y is west.
                    world * DVec3::new(-cos * zenith.sin(), -sin * zenith.sin(), zenith.cos())
                }
            }
        };
        let albedo = plugin.color("albedo", Use::Reflectance, &self.search)?;
        let scale = float("scale", 1.0)?;
        let missing = ClearSky::default();
        let sky = ClearSky {
            towards_sun: (world_from_sky.transpose() * towards_sun).as_vec3().normalize(),
            turbidity: float("turbidity", missing.turbidity)?,
            ground: false,
            albedo: albedo.unwrap_or(if element.legacy { Vec3::splat(0.15) } else { missing.albedo }),
            sky_scale: scale * float("sky_scale", 1.0)?,
            sun_scale: scale * float("sun_scale", 1.0)?,
            sun_angle: match plugin.float("sun_aperture")? {
                Some(degrees) => 0.5 * degrees.to_radians(),
                None => missing.sun_angle * float("sun_radius_scale", 1.0)?,
            },
        };
        if !(1.0..=10.0).contains(&sky.turbidity) || sky.sky_scale < 0.0 || sky.sun_scale < 0.0 {
            return Err(element.error("the turbidity has to be 1 to 10, and no scale negative"));
        }
        if !(sky.sun_angle > 0.0 && sky.sun_angle < std::f32::consts::FRAC_PI_2) {
            return Err(element.error("the sun's aperture has to lie between 0 and 180 degrees"));
        }
        plugin.ignore(&["resolution", "stretch", "extend", "samples"]);
        if sky.towards_sun.y < 0.0 {
            self.warn(format!("{}: the sun is below the horizon, and the sky is black", element.title()));
        }
        let kind = element.plugin();
        if kind != "sky"
            && sky.sun_scale > 0.0
            && let Light::Sun { direction, irradiance, angle, of_sky } = sky.sun()
        {
            let direction = world_from_sky.as_mat3() * direction;
            self.scene.lights.push(Light::Sun { direction, irradiance, angle, of_sky });
        }
        if kind != "sun" {
            let world_from_environment = world_from_sky.as_mat3();
            self.sky(element, Environment { radiance: Vec3::ONE, map: Some(sky.map()), world_from_environment });
        }
        Ok(())
    }

    /// Converts a projector: an image across the view of a pinhole, as irradiance at distance 1 over pi.
    fn projector(&mut self, plugin: &Plugin<'a>, place: DMat4) -> Result<Light, LoadError> {
        let element = plugin.element;
        let scale = plugin.float("scale")?.unwrap_or(1.0);
        if scale < 0.0 {
            return Err(element.error("the projector's scale is negative"));
        }
        // The orientation is that of a camera image: u grows along -X and v along -Y of the emitter, whose
        // axis is +Z.
        let turn = DMat3::from_cols_array(&[-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0]);
        let mapping = Mapping::Projection { half_extent: Vec2::ONE };
        let (pattern, world_from_lamp) = match plugin.get("irradiance").filter(|e| is_texture(e)) {
            Some(texture) => self.image_pattern(texture, mapping, place, turn)?,
            None => {
                let Some((world, _)) = rotation(place) else {
                    return Err(element.error("to_world is singular: the light has no direction"));
                };
                let factor = plugin.color("irradiance", Use::Radiance, &self.search)?.unwrap_or(Vec3::ONE);
                let texels = vec![factor.to_array()];
                self.scene.patterns.push(Pattern { name: element.title(), mapping, width: 1, height: 1, texels });
                (Some(self.scene.patterns.len() - 1), (world * turn).as_mat3())
            }
        };
        let (fov, axis) = sensors::field_of_view(plugin)?;
        if let Some(pattern) = pattern.map(|p| &mut self.scene.patterns[p]) {
            let half = (0.5 * fov).tan();
            let (width, height) = (pattern.width as f32, pattern.height as f32);
            let side = match axis {
                FovAxis::X => width,
                FovAxis::Y => height,
                FovAxis::Diagonal => width.hypot(height),
                FovAxis::Smaller => width.min(height),
                FovAxis::Larger => width.max(height),
            };
            pattern.mapping = Mapping::Projection { half_extent: Vec2::new(width, height) * (half / side) };
        }
        let position = place.w_axis.truncate().as_vec3();
        let intensity = Vec3::splat(scale * std::f32::consts::PI);
        Ok(Light::Lamp(Lamp { position, world_from_lamp, radius: 0.0, intensity, cone: None, pattern }))
    }

    /// Adds a texture as a pattern; returns its index and the lamp's rotation. `turn` maps the lamp's own
    /// space to the emitter's. Borders are clamped in every wrap mode, so that opposite ones do not blend.
    fn image_pattern(
        &mut self,
        texture: &'a Element,
        mapping: Mapping,
        place: DMat4,
        turn: DMat3,
    ) -> Result<(Option<usize>, Mat3), LoadError> {
        let Some((world, mirrored)) = rotation(place) else {
            return Err(texture.error("to_world is singular: the light has no direction"));
        };
        let Color { factor, texture: Some(used) } = self.color_texture(texture, Use::Radiance)? else {
            return Err(texture.error("a light's texture has to be a bitmap or a checkerboard"));
        };
        if used.transform != glam::Affine2::IDENTITY {
            self.warn(format!("{}: `to_uv` is ignored where a light projects the texture", texture.title()));
        }
        let sampler = &self.scene.textures[used.texture];
        let image = &self.scene.images[sampler.image];
        let (name, width, height) = (image.name.clone(), image.width, image.height);
        let decode = |texel: &[u8; 4]| {
            let linear =
                |v: u8| if sampler.srgb { linear_from_srgb(f32::from(v) / 255.0) } else { f32::from(v) / 255.0 };
            (Vec3::new(linear(texel[0]), linear(texel[1]), linear(texel[2])) * factor).to_array()
        };
        let mut texels: Vec<[f32; 3]> = image.texels.iter().map(decode).collect();
        if mirrored {
            // The rotation has its X axis reversed.
            texels.chunks_exact_mut(width as usize).for_each(<[_]>::reverse);
        }
        self.scene.patterns.push(Pattern { name, mapping, width, height, texels });
        Ok((Some(self.scene.patterns.len() - 1), (world * turn).as_mat3()))
    }

    /// Returns a light's colour, whose default in Mitsuba is 1, times 0.5's `scale`.
    fn light_color(&self, plugin: &Plugin<'a>, name: &str) -> Result<Vec3, LoadError> {
        let color = plugin.color(name, Use::Radiance, &self.search)?.unwrap_or(Vec3::ONE);
        Ok(color * plugin.float("scale")?.unwrap_or(1.0))
    }

    /// Returns the world direction of an emitter's own +Z.
    fn direction(&self, element: &Element, to_world: DMat4) -> Result<Vec3, LoadError> {
        let direction = to_world.z_axis.truncate().try_normalize();
        direction.map(|d| d.as_vec3()).ok_or_else(|| element.error("to_world is singular: the light has no direction"))
    }

    fn sky(&mut self, element: &Element, environment: Environment) {
        if self.scene.environment.is_some() {
            self.warn(format!("{}: there is already a sky; this one is left out", element.title()));
        } else {
            self.scene.environment = Some(environment);
        }
    }

    fn environment_map(&mut self, plugin: &Plugin<'a>, to_world: DMat4) -> Result<Environment, LoadError> {
        let element = plugin.element;
        let name = plugin.string("filename")?.ok_or_else(|| element.error("an envmap needs a `filename`"))?;
        let map = if let Ok(path) = self.search.find(element, name) {
            let (map, warning) = EnvironmentMap::decode(&self.search.files.read(&path)?, &path)?;
            warning.into_iter().for_each(|warning| self.warn(warning));
            Some(EnvironmentMap { rows: Rows::AtPoles, ..map })
        } else {
            self.warn(format!("the sky's picture `{name}` is not there: an even sky is drawn instead"));
            None
        };
        plugin.ignore(&["mis_compensation", "gamma", "cache", "samples"]);
        // Only the rotation matters, because lookup directions are normalized.
        let Some((mut world, mirrored)) = rotation(to_world) else {
            return Err(element.error("the envmap's to_world is singular"));
        };
        if mirrored {
            world.x_axis = -world.x_axis;
        }
        let scale = plugin.float("scale")?.unwrap_or(1.0);
        if scale < 0.0 {
            return Err(element.error("the envmap's scale is negative"));
        }
        Ok(Environment { radiance: Vec3::splat(scale), map, world_from_environment: world.as_mat3() })
    }
}

/// Extracts the rotation of a transform that may also scale, keeping the directions of Y and Z; the second
/// value is true if the transform mirrors, so that the rotation's X axis is reversed.
fn rotation(place: DMat4) -> Option<(DMat3, bool)> {
    let linear = DMat3::from_mat4(place);
    let z = linear.z_axis.try_normalize()?;
    let y = linear.y_axis.reject_from_normalized(z).try_normalize()?;
    let x = y.cross(z);
    Some((DMat3::from_cols(x, y, z), x.dot(linear.x_axis) < 0.0))
}

/// Returns the zenith angle of the sun and its azimuth from north through east, in radians, at the place and
/// time of a sky element (Blanco-Muriel et al., "Computing the solar vector", Solar Energy 70(5), 2001).
fn sun_position(plugin: &Plugin) -> Result<[f64; 2], LoadError> {
    let float = |name: &str, missing: f32| Ok::<f64, LoadError>(f64::from(plugin.float(name)?.unwrap_or(missing)));
    // The defaults are Mitsuba's: an afternoon in Tokyo.
    let (latitude, longitude) = (float("latitude", 35.6894)?.to_radians(), float("longitude", 139.6917)?);
    let hours =
        float("hour", 15.0)? - float("timezone", 9.0)? + float("minute", 0.0)? / 60.0 + float("second", 0.0)? / 3600.0;
    let [year, month, day] = [("year", 2010), ("month", 7), ("day", 10)].map(|(name, missing)| {
        let value = plugin.integer(name)?.unwrap_or(missing);
        if value.abs() > 100_000 {
            return Err(plugin.element.error(format!("`{name}` is {value}")));
        }
        Ok(value)
    });
    let (year, month, day) = (year?, month?, day?);
    let january = (month - 14) / 12;
    let julian_day = 1461 * (year + 4800 + january) / 4 + 367 * (month - 2 - 12 * january) / 12
        - 3 * ((year + 4900 + january) / 100) / 4
        + day
        - 32075;
    let days = julian_day as f64 - 0.5 + hours / 24.0 - 2_451_545.0;

    let omega = 2.1429 - 0.001_039_459_4 * days;
    let mean_longitude = 4.895_063 + 0.017_202_791_698 * days;
    let anomaly = 6.240_06 + 0.017_201_969_9 * days;
    let ecliptic = mean_longitude + 0.033_416_07 * anomaly.sin() + 0.000_348_94 * (2.0 * anomaly).sin()
        - 0.000_113_4
        - 0.000_020_3 * omega.sin();
    let obliquity = 0.409_092_8 - 6.214e-9 * days + 0.000_039_6 * omega.cos();
    let ascension = (obliquity.cos() * ecliptic.sin()).atan2(ecliptic.cos());
    let declination = (obliquity.sin() * ecliptic.sin()).asin();
    let sidereal = (6.697_424_324_2 + 0.065_709_828_3 * days + hours) * 15.0 + longitude;
    let hour_angle = sidereal.to_radians() - ascension;
    let cos = latitude.cos() * hour_angle.cos() * declination.cos() + declination.sin() * latitude.sin();
    let zenith = cos.clamp(-1.0, 1.0).acos();
    let azimuth = (-hour_angle.sin()).atan2(declination.tan() * latitude.cos() - latitude.sin() * hour_angle.cos());
    // The parallax is the earth's radius over the distance.
    Ok([zenith + 6371.01 / 149_597_890.0 * zenith.sin(), azimuth])
}
