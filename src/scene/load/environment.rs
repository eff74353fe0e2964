//! Replacement of a scene's environment at loading: an image, a clear sky, a studio or none.

use std::path::Path;

use glam::{Mat3, Vec3};

use crate::scene::load::files::{Disk, Files as _};
use crate::scene::load::sky::ClearSky;
use crate::scene::load::studio;
use crate::scene::model::environment::{Environment, EnvironmentMap};
use crate::scene::model::error::LoadError;
use crate::scene::model::light::Light;
use crate::scene::model::scene::Scene;

/// Changes to a scene's environment at loading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnvironmentChange {
    /// Replacement of the environment: an image as [`EnvironmentMap::decode`] reads it;
    /// `sky:ELEVATION[,TURBIDITY]`, a [`ClearSky`] with the sun that many degrees above the horizon in the
    /// direction of +Z; `studio`, a photographer's studio for a camera that looks along -Z ([`studio`]); or
    /// `none`.
    pub source: Option<String>,
    /// Factor of the radiance.
    pub scale: Option<f32>,
    /// Rotation about +Y, radians.
    pub rotate: Option<f32>,
}

impl EnvironmentChange {
    /// Returns true if the environment is removed, so that no light replaces it either.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.source.as_deref() == Some("none")
    }

    /// Applies the changes to the environment and to the sun that belongs to it.
    ///
    /// # Errors
    /// An image that cannot be read, a malformed `sky:`, and a scale or rotation of a scene without
    /// environment are errors.
    pub fn apply(&self, scene: &mut Scene) -> Result<(), LoadError> {
        if let Some(source) = &self.source {
            scene.retain_lights(&|_, light| !matches!(light, Light::Sun { of_sky: true, .. }));
            let (map, sun) = match (source.as_str(), source.strip_prefix("sky:")) {
                ("none", _) => (None, None),
                ("studio", _) => (Some(studio::map()), None),
                (_, Some(text)) => {
                    let sky = parse_sky(text).ok_or_else(|| {
                        LoadError::new(
                            source,
                            "is no sky: write sky:ELEVATION or sky:ELEVATION,TURBIDITY with the sun 0 to 90 degrees above the \
                             horizon and a turbidity of 1 to 10, such as sky:30,3",
                        )
                    })?;
                    (Some(sky.map()), Some(sky.sun()))
                }
                _ => {
                    let path = Path::new(source);
                    let (map, warning) = EnvironmentMap::decode(&Disk.read(path)?, path)?;
                    scene.warnings.extend(warning);
                    (Some(map), None)
                }
            };
            scene.lights.extend(sun);
            scene.environment = map.map(|map| Environment {
                radiance: Vec3::ONE,
                map: Some(map),
                world_from_environment: Mat3::IDENTITY,
            });
        }
        let (scale, turn) = (self.scale.unwrap_or(1.0), Mat3::from_rotation_y(self.rotate.unwrap_or(0.0)));
        match &mut scene.environment {
            Some(environment) => {
                environment.radiance *= scale;
                environment.world_from_environment = turn * environment.world_from_environment;
            }
            None if self.scale.is_some() || self.rotate.is_some() => {
                let cause = "has no environment to be scaled or rotated; `--env FILE` gives it one";
                return Err(LoadError::new(&scene.name, cause));
            }
            None => {}
        }
        for light in &mut scene.lights {
            if let Light::Sun { direction, irradiance, of_sky: true, .. } = light {
                *irradiance *= scale;
                *direction = turn * *direction;
            }
        }
        Ok(())
    }
}

/// Parses `ELEVATION[,TURBIDITY]`.
fn parse_sky(text: &str) -> Option<ClearSky> {
    let (elevation, turbidity) = text.split_once(',').unwrap_or((text, "3"));
    let [elevation, turbidity] = [elevation, turbidity].map(|number| number.trim().parse::<f32>().ok());
    let elevation = elevation.filter(|e| (0.0..=90.0).contains(e))?.to_radians();
    let turbidity = turbidity.filter(|t| (1.0..=10.0).contains(t))?;
    let towards_sun = Vec3::new(0.0, elevation.sin(), elevation.cos());
    Some(ClearSky { towards_sun, turbidity, ..ClearSky::default() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sun_goes_with_its_sky() {
        let sun = |of_sky| Light::Sun { direction: Vec3::NEG_Z, irradiance: Vec3::ONE, angle: 0.1, of_sky };
        let radiance = Vec3::splat(0.5);
        let sky = Environment { radiance, map: None, world_from_environment: Mat3::IDENTITY };
        let scene = Scene { lights: vec![sun(true), sun(false)], environment: Some(sky), ..Scene::default() };

        let mut turned = scene.clone();
        let quarter = Some(std::f32::consts::FRAC_PI_2);
        EnvironmentChange { source: None, scale: Some(3.0), rotate: quarter }.apply(&mut turned).unwrap();
        let Light::Sun { direction, irradiance, .. } = turned.lights[0] else { panic!() };
        // The rotation is counter-clockwise seen from above: -Z becomes -X.
        assert!(direction.abs_diff_eq(Vec3::NEG_X, 1e-6) && irradiance == Vec3::splat(3.0), "{direction}");
        assert_eq!((turned.lights[1], turned.environment.unwrap().radiance), (sun(false), 3.0 * radiance));

        let mut replaced = scene.clone();
        let change = EnvironmentChange { source: Some("sky:30".to_owned()), ..EnvironmentChange::default() };
        change.apply(&mut replaced).unwrap();
        assert_eq!((replaced.lights.len(), replaced.lights[0]), (2, sun(false)));
        let Light::Sun { direction, of_sky: true, .. } = replaced.lights[1] else { panic!() };
        assert!(direction.abs_diff_eq(-Vec3::new(0.0, 0.5, 0.75_f32.sqrt()), 1e-6), "{direction}");
        assert!(replaced.environment.is_some_and(|e| e.map.is_some()));

        let mut same = scene.clone();
        EnvironmentChange::default().apply(&mut same).unwrap();
        assert_eq!((same.lights, same.environment), (scene.lights, scene.environment));
    }
}
