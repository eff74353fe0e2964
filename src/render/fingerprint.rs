//! Fingerprints of scenes and settings, by which parts of a picture are known to belong together.

use std::fmt::Write as _;

use sha2::{Digest as _, Sha256};

use crate::scene::Scene;
use crate::settings::Settings;

/// Settings that say when a render ends. Samples do not depend on them.
const ENDS: [&str; 3] = ["samples", "budget", "target_error"];

/// A SHA-256 that text is written to.
struct Hash(Sha256);

impl std::fmt::Write for Hash {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

impl Hash {
    fn hex(self) -> String {
        self.0.finalize().iter().fold(String::new(), |mut hex, byte| {
            let _ = write!(hex, "{byte:02x}");
            hex
        })
    }
}

/// Returns the SHA-256 of text as hexadecimal digits.
#[must_use]
pub fn hash_of_text(text: &str) -> String {
    let mut hash = Hash(Sha256::new());
    hash.0.update(text.as_bytes());
    hash.hex()
}

/// Returns the SHA-256 of a scene, as hexadecimal digits: of all that a picture depends on, without paths of
/// files, names of light groups, warnings and notes.
#[must_use]
pub fn scene_hash(scene: &Scene) -> String {
    // All fields are named, so that new ones are not forgotten.
    let Scene {
        name: _,
        meshes,
        instances,
        materials,
        textures,
        images,
        height_maps,
        lights,
        light_groups: _,
        patterns,
        environment,
        cameras,
        rig,
        pose,
        seconds,
        viewpoint,
        warnings: _,
        notes: _,
        says_its_light: _,
    } = scene;
    let mut hash = Hash(Sha256::new());
    for image in images {
        let _ = write!(hash, "{}x{}", image.width, image.height);
        hash.0.update(bytemuck::cast_slice::<[u8; 4], u8>(&image.texels));
    }
    // The debug output contains every field with every digit.
    let written = write!(
        hash,
        "{meshes:?}{instances:?}{materials:?}{textures:?}{height_maps:?}{lights:?}{patterns:?}{environment:?}{cameras:?}{rig:?}{pose:?}{seconds:?}{viewpoint:?}"
    );
    debug_assert!(written.is_ok(), "hashing cannot fail");
    hash.hex()
}

/// Returns the settings on which each sample depends, as JSON: without the end of the render, and with the
/// division of the image that the plan chose.
#[must_use]
pub fn settings_text(settings: &Settings, plan: Option<&serde_json::Value>) -> String {
    let mut value = serde_json::to_value(settings).unwrap_or_default();
    if let Some(fields) = value.as_object_mut() {
        ENDS.iter().for_each(|end| drop(fields.remove(*end)));
        if let Some(grid) = plan.and_then(|plan| plan.get("grid")) {
            fields.insert("grid".to_owned(), grid.clone());
        }
    }
    value.to_string()
}

/// Names the settings in which two texts of [`settings_text`] differ, with both values; empty if they agree.
#[must_use]
pub fn differences(one: &str, other: &str) -> Vec<String> {
    let fields = |text: &str| serde_json::from_str::<serde_json::Map<_, _>>(text).unwrap_or_default();
    let (one, other) = (fields(one), fields(other));
    let names: std::collections::BTreeSet<_> = one.keys().chain(other.keys()).collect();
    let shown = |fields: &serde_json::Map<String, serde_json::Value>, name: &str| {
        fields.get(name).map_or_else(|| "none".to_owned(), ToString::to_string)
    };
    names
        .into_iter()
        .filter(|name| one.get(*name) != other.get(*name))
        .map(|name| format!("{name} ({} and {})", shown(&one, name), shown(&other, name)))
        .collect()
}

/// True if a text of [`settings_text`] is that of these settings, whatever the plan chose.
#[must_use]
pub fn is_text_of(text: &str, settings: &Settings) -> bool {
    differences(text, &settings_text(settings, None)).iter().all(|difference| difference.starts_with("grid ("))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn a_scene_is_known_by_its_content() {
        let scene = builtin::load("cornell_point").unwrap();
        let hash = scene_hash(&scene);
        assert_eq!(hash.len(), 64);
        let moved = Scene { name: "elsewhere".to_owned(), warnings: vec!["a".to_owned()], ..scene.clone() };
        assert_eq!(scene_hash(&moved), hash);
        let mut other = scene;
        other.meshes[0].positions[0].x += 1e-6;
        assert_ne!(scene_hash(&other), hash);
    }

    #[test]
    fn settings_differ_by_name() {
        let text = |settings: &Settings| settings_text(settings, None);
        let settings = Settings::default();
        let longer = Settings { samples: 4, budget: Some(1.0), target_error: Some(0.1), ..settings.clone() };
        assert_eq!(text(&settings), text(&longer), "the end does not count");
        let other = Settings { seed: 7, ..settings.clone() };
        assert_eq!(differences(&text(&settings), &text(&other)), ["seed (1 and 7)"]);
        assert!(differences(&text(&settings), &text(&longer)).is_empty());
        let planned = settings_text(&settings, Some(&serde_json::json!({ "grid": 3 })));
        assert!(is_text_of(&planned, &settings) && !is_text_of(&planned, &other));
    }
}
