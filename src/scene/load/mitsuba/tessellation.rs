//! Tessellation and displacement of shapes, an extension of Mitsuba's format: parameters whose names begin
//! with `tessellation_` and `displacement`.

use glam::{Vec2, Vec3};

use super::Loader;
use super::textures::is_texture;
use super::values::{Plugin, numbers};
use super::xml::Element;
use crate::scene::model::tessellation::PHONG;
use crate::scene::{Displacement, EdgeFactor, Height, HeightMap, LoadError, Mesh, Tessellation, Wave};

impl<'a> Loader<'a> {
    /// Sets the tessellation of a shape's mesh from its parameters, if there are any.
    pub(super) fn tessellation(&mut self, plugin: &Plugin<'a>, mesh: &mut Mesh) -> Result<(), LoadError> {
        let element = plugin.element;
        let displacement = self.displacement(plugin, mesh)?;
        let phong = plugin.float("tessellation_phong")?;
        let factor = match (plugin.integer("tessellation_edges")?, plugin.float("tessellation_pixels")?) {
            (None, None) if displacement.is_none() && phong.is_none() => return Ok(()),
            // A number that does not fit becomes an invalid one, which the check below reports.
            (Some(parts), None) => EdgeFactor::Fixed(u32::try_from(parts).unwrap_or(0)),
            (None, Some(pixels)) => EdgeFactor::Pixels(pixels),
            _ => {
                let cause = "needs either `tessellation_edges`, into how many parts edges are cut, or `tessellation_pixels` of a part";
                return Err(element.error(format!("{} {cause}", element.title())));
            }
        };
        let tessellation = Tessellation { factor, phong: phong.unwrap_or(PHONG), displacement };
        tessellation.check().map_err(|cause| element.error(format!("{}: {cause}", element.title())))?;
        tessellation.refine(mesh);
        Ok(())
    }

    fn displacement(&mut self, plugin: &Plugin<'a>, mesh: &Mesh) -> Result<Option<Displacement>, LoadError> {
        let element = plugin.element;
        let drift = plugin.vector("displacement_drift")?.unwrap_or(Vec3::ZERO);
        let said = [plugin.get("displacement"), plugin.get("displacement_noise"), plugin.get("displacement_waves")];
        let height = match said {
            [None, None, None] => return Ok(None),
            [Some(texture), None, None] => {
                if mesh.uvs[0].is_empty() {
                    return Err(texture.error("the shape has no texture coordinates, by which it would be displaced"));
                }
                Height::Map { map: self.height_map(texture)?, uv_set: 0, drift: Vec2::new(drift.x, drift.y) }
            }
            [None, Some(_), None] => {
                let whole = |name: &str, missing: u32| -> Result<u32, LoadError> {
                    // A number that does not fit becomes an invalid one, which the check below reports.
                    Ok(plugin.integer(name)?.map_or(missing, |n| u32::try_from(n).unwrap_or(u32::MAX)))
                };
                Height::Noise {
                    frequency: plugin.float("displacement_noise")?.unwrap_or_default(),
                    octaves: whole("displacement_octaves", 6)?,
                    seed: whole("displacement_seed", 0)?,
                    drift,
                }
            }
            [None, None, Some(waves)] => Height::Waves(
                plugin.string("displacement_waves")?.map_or(Ok(Vec::new()), |text| parse_waves(waves, text))?,
            ),
            _ => {
                let cause = "has more than one of `displacement`, `displacement_noise` and `displacement_waves`";
                return Err(element.error(format!("{} {cause}", element.title())));
            }
        };
        let scale = match (&height, plugin.float("displacement_scale")?) {
            (_, Some(scale)) => scale,
            (Height::Waves(_), None) => 1.0,
            _ => return Err(element.error("a displacement needs `displacement_scale`, the metres of the height 1")),
        };
        Ok(Some(Displacement { height, scale, bias: plugin.float("displacement_bias")?.unwrap_or(0.0) }))
    }

    fn height_map(&mut self, element: &'a Element) -> Result<usize, LoadError> {
        if !is_texture(element) || element.plugin() != "bitmap" {
            return Err(element.error("a displacement has to be a texture of type `bitmap`"));
        }
        let plugin = self.plugin(element)?;
        let name = plugin.string("filename")?.ok_or_else(|| element.error("a bitmap needs a `filename`"))?;
        let (path, bytes) = self.search.read(element, name)?;
        let wrap = self.wrap_modes(&plugin)?;
        // Heights are the stored values, without colour conversion.
        plugin.ignore(&["raw", "gamma", "filter_type"]);
        self.finish(&plugin);
        let map = HeightMap::decode(&bytes, name, wrap).map_err(|cause| LoadError::new(&path, cause))?;
        let maps = &mut self.scene.height_maps;
        Ok(maps.iter().position(|known| *known == map).unwrap_or_else(|| {
            maps.push(map);
            maps.len() - 1
        }))
    }
}

/// Parses waves, separated by semicolons: direction x y z, length, amplitude and an optional phase.
fn parse_waves(element: &Element, text: &str) -> Result<Vec<Wave>, LoadError> {
    let wave = |text: &str| {
        match numbers(element, text)?.iter().map(|&v| v as f32).collect::<Vec<_>>()[..] {
        [x, y, z, length, amplitude] => Ok(Wave::on_water(Vec3::new(x, y, z), length, amplitude)),
        [x, y, z, length, amplitude, phase] => {
            Ok(Wave { phase, ..Wave::on_water(Vec3::new(x, y, z), length, amplitude) })
        }
        ref v => Err(element.error(format!(
            "a wave is x y z length amplitude and, if it begins elsewhere, phase, which are five or six numbers, not {}",
            v.len()
        ))),
    }
    };
    text.split(';').filter(|wave| !wave.trim().is_empty()).map(wave).collect()
}
