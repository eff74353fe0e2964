//! Emitters: points, spots, parallel light and skies. Area lights belong to shapes and become their material's emission.

use glam::{DMat3, DMat4, Mat3, Vec3};

use super::Loader;
use super::spectra::Use;
use super::values::Plugin;
use super::xml::Element;
use crate::scene::{Color, Emission, Environment, EnvironmentMap, Light, LoadError, Rows, SpotFalloff};

impl<'a> Loader<'a> {
    /// Adds an emitter that is not part of a shape.
    pub(super) fn emitter(&mut self, element: &'a Element) -> Result<(), LoadError> {
        let plugin = self.plugin(element)?;
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
                if plugin.get("texture").is_some() {
                    self.warn(format!("{}: the projected texture is ignored", element.title()));
                }
                self.scene.lights.push(Light::Spot {
                    position: place.w_axis.truncate().as_vec3(),
                    direction: self.direction(element, place)?,
                    intensity,
                    inner_angle: beam.min(cutoff).to_radians(),
                    outer_angle: cutoff.to_radians(),
                    falloff: SpotFalloff::AngleLinear,
                });
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
            "sky" | "sun" | "sunsky" | "timed_sunsky" => {
                self.warn(format!(
                    "{}: the sky model is not supported; a constant sky of radiance 1 shines instead",
                    element.title()
                ));
                let environment =
                    Environment { radiance: Vec3::ONE, map: None, world_from_environment: Mat3::IDENTITY };
                self.sky(element, environment);
                return Ok(());
            }
            "area" => return Err(element.error("an area emitter has to stand inside a shape")),
            kind => {
                self.warn(format!("{}: emitters of type `{kind}` are not supported; it is left out", element.title()));
                return Ok(());
            }
        }
        self.finish(&plugin);
        Ok(())
    }

    /// What a shape's emitter adds to its material.
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

    /// A light's colour; Mitsuba takes 1 where there is none. 0.5's `scale` multiplies it.
    fn light_color(&self, plugin: &Plugin<'a>, name: &str) -> Result<Vec3, LoadError> {
        let color = plugin.color(name, Use::Radiance, &self.folders)?.unwrap_or(Vec3::ONE);
        Ok(color * plugin.float("scale")?.unwrap_or(1.0))
    }

    /// The world direction of an emitter's own +Z.
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
        let path = self.resolve(element, name)?;
        let mut map = EnvironmentMap::load(&path)?;
        map.rows = Rows::AtPoles;
        plugin.ignore(&["mis_compensation", "gamma", "cache", "samples"]);
        // Only the rotation counts: directions are looked up normalized.
        let linear = DMat3::from_mat4(to_world);
        let x = linear.x_axis.try_normalize();
        let y = x.and_then(|x| linear.y_axis.reject_from_normalized(x).try_normalize());
        let (Some(x), Some(y)) = (x, y) else {
            return Err(element.error("the envmap's to_world is singular"));
        };
        let z = x.cross(y) * linear.determinant().signum();
        let scale = plugin.float("scale")?.unwrap_or(1.0);
        if scale < 0.0 {
            return Err(element.error("the envmap's scale is negative"));
        }
        Ok(Environment {
            radiance: Vec3::splat(scale),
            map: Some(map),
            world_from_environment: DMat3::from_cols(x, y, z).as_mat3(),
        })
    }
}
