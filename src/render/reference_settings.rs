//! The settings with which the reference renders the picture of a GPU renderer. They lie here since the reference, which judges the
//! renderers, imports nothing of theirs.

use crate::reference::ReferenceSettings;
use crate::settings::{Settings, UNLIMITED};

impl ReferenceSettings {
    /// Returns the settings of the same picture.
    #[must_use]
    pub fn of(settings: &Settings) -> Self {
        let Settings { width, height, samples, specular_bounces, seed, camera, .. } = *settings;
        let bounces = Some(settings.bounces).filter(|&bounces| bounces != UNLIMITED);
        Self { width, height, samples, bounces, specular_bounces, seed, camera }
    }
}
