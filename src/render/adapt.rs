//! Adapts a scene to the settings: applies the lens to the camera, and removes glass for methods without
//! transmission.

use std::borrow::Cow;

use crate::render::renderer::RenderError;
use crate::scene::{Material, Scene};
use crate::settings::Settings;

/// Returns the scene as it is rendered. It is cloned only if something changes; [`Scene::warnings`] lists the
/// omissions.
///
/// # Errors
/// [`RenderError::Setting`] if the camera cannot have the lens.
pub fn adapted<'a>(scene: &'a Scene, settings: &Settings) -> Result<Cow<'a, Scene>, RenderError> {
    let mut out = Cow::Borrowed(scene);
    if settings.shares_all_directions() && scene.transmits() {
        out = Cow::Owned(scene.clone().without_glass());
    }
    if let (true, Some(camera)) = (settings.has_lens(), scene.cameras.get(settings.camera)) {
        let camera = camera.clone().with_lens(settings.aperture, settings.focus).map_err(|cause| {
            let option = if settings.aperture.is_some() { "--aperture" } else { "--focus" };
            RenderError::Setting(format!("{option}: {cause}"))
        })?;
        if camera != scene.cameras[settings.camera] {
            out.to_mut().cameras[settings.camera] = camera;
        }
    }
    Ok(out)
}

/// Returns the warnings of an adapted scene with the settings, each once.
#[must_use]
pub fn warnings(scene: &Scene, settings: &Settings) -> Vec<String> {
    let widened = widened_lobes(scene, settings).filter(|warning| !scene.warnings.contains(warning));
    scene.warnings.iter().cloned().chain(widened).collect()
}

/// Most materials that a warning names.
const NAMED: usize = 3;

/// Names the materials whose lobes the roughness clamp still widens in the last sample: alpha below sqrt(m' F
/// G / (2 cos N)) at normal incidence, 0.35 for a metal with N = 64 samples and m' = 16 (section 5.2;
/// docs/limits.md). None for methods without it.
///
/// Materials with a roughness texture are not considered.
fn widened_lobes(scene: &Scene, settings: &Settings) -> Option<String> {
    if !settings.shares_all_directions() {
        return None;
    }
    let used = |index: usize| scene.instances.iter().any(|i| scene.meshes[i.mesh].material == index);
    let needed = |material: &Material| {
        let samples = |(alpha, fresnel): (f32, f32)| {
            (0.5 * settings.samples_per_lobe() * fresnel / (alpha * alpha).max(1e-6)).ceil()
        };
        material.lobes().map(samples).reduce(f32::max)
    };
    let few = settings.samples as f32;
    let materials = scene.materials.iter().enumerate().filter_map(|(index, m)| Some((index, m, needed(m)?)));
    let widened: Vec<_> = materials.filter(|&(index, _, needed)| needed > few && used(index)).collect();
    let most = widened.iter().map(|&(.., needed)| needed).reduce(f32::max)?;
    let mut names: Vec<_> = widened.iter().take(NAMED).map(|(_, m, _)| format!("`{}`", m.name)).collect();
    if widened.len() > NAMED {
        names.push(format!("{} more", widened.len() - NAMED));
    }
    let names = names.join(", ");
    Some(format!(
        "highlights of {names} are blurred below {most} samples (roughness clamp, docs/limits.md); `--strategies all` without --clamp-samples, and with exact visibility, keeps them sharp"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Bsdf, builtin};
    use crate::settings::Technique;

    #[test]
    fn the_clamp_names_what_it_widens() {
        let metal = |alpha: f32| {
            let mut scene = builtin::load("single_triangle").unwrap();
            scene.materials[0].name = "metal".to_owned();
            scene.materials[0].bsdf = Bsdf::MetallicRoughness {
                base_color: glam::Vec3::ONE.into(),
                metallic: 1.0.into(),
                roughness: alpha.sqrt().into(),
                ior: 1.5,
                specular: 1.0.into(),
                specular_color: glam::Vec3::ONE.into(),
                transmission: 0.0.into(),
            };
            scene
        };
        let plain = Settings { clamp_samples: Some(16.0), ..Settings::default() };
        assert_eq!(widened_lobes(&metal(0.01), &Settings::default()), None);
        // sqrt(16 / (2 64)) = 0.3536 with the default of 64 samples.
        assert!(widened_lobes(&metal(0.34), &plain).is_some_and(|text| text.contains("`metal`")));
        assert_eq!(widened_lobes(&metal(0.36), &plain), None);
        let technique = Technique::PATH;
        assert_eq!(widened_lobes(&metal(0.01), &Settings { technique, ..plain }), None);
    }
}
