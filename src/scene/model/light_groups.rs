//! Light groups: names by which lights have layers of their own.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::scene::Light;
use crate::scene::model::scene::Scene;

/// Group of the environment and of the sun that belongs to it.
pub const ENVIRONMENT: &str = "environment";

/// Groups that a file names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LightGroups {
    /// Groups of the scene's first lights; empty for lights without one.
    pub lights: Vec<String>,
    /// Groups of emissive materials; those of other materials are their names.
    pub materials: BTreeMap<usize, String>,
}

impl Scene {
    /// Puts all lights from the index `first` on into a group.
    pub fn group_lights(&mut self, first: usize, group: Option<&str>) {
        let groups = &mut self.light_groups.lights;
        groups.resize(first, String::new());
        groups.resize(self.lights.len(), group.unwrap_or_default().to_owned());
    }

    /// Keeps the lights for which `keep`, called with the index and the light, is true.
    pub fn retain_lights(&mut self, keep: &dyn Fn(usize, &Light) -> bool) {
        let kept: Vec<bool> = self.lights.iter().enumerate().map(|(i, light)| keep(i, light)).collect();
        let at = |i: usize| kept.get(i).copied().unwrap_or_default();
        retain(&mut self.lights, &at);
        retain(&mut self.light_groups.lights, &at);
        // Attached lights are the first lights of the scene.
        if let Some(rig) = &mut self.rig
            && kept.contains(&false)
        {
            retain(&mut Arc::make_mut(rig).lights, &at);
        }
    }

    /// Returns the names of all groups that emit light, sorted.
    #[must_use]
    pub fn light_group_names(&self) -> Vec<String> {
        let lights = (0..self.lights.len()).filter(|&i| !self.lights[i].is_black(&self.patterns));
        let materials = self.instances.iter().map(|instance| self.meshes[instance.mesh].material);
        let emissive = materials.filter(|&i| self.materials[i].emission.is_some());
        let environment = self.environment.iter().map(|_| ENVIRONMENT);
        let names = lights.map(|i| self.group_of_light(i)).chain(emissive.map(|i| self.group_of_material(i)));
        let mut names: Vec<String> = names.chain(environment).map(str::to_owned).collect();
        names.sort();
        names.dedup();
        names
    }

    /// Returns the scene with the lights alone of whose groups `is_lit` is true. Lights without a group are of the
    /// group "".
    #[must_use]
    pub fn lit_by(&self, is_lit: &dyn Fn(&str) -> bool) -> Self {
        let mut out = self.clone();
        out.retain_lights(&|i, _| is_lit(self.group_of_light(i)));
        for (i, material) in out.materials.iter_mut().enumerate() {
            material.emission = material.emission.take().filter(|_| is_lit(self.group_of_material(i)));
        }
        out.environment = out.environment.filter(|_| is_lit(ENVIRONMENT));
        out
    }

    fn group_of_light(&self, index: usize) -> &str {
        match self.lights[index] {
            Light::Sun { of_sky: true, .. } => ENVIRONMENT,
            _ => self.light_groups.lights.get(index).map_or("", String::as_str),
        }
    }

    fn group_of_material(&self, index: usize) -> &str {
        self.light_groups.materials.get(&index).unwrap_or(&self.materials[index].name)
    }
}

/// Keeps the elements for whose index `keep` is true.
fn retain<T>(all: &mut Vec<T>, keep: &dyn Fn(usize) -> bool) {
    let mut index = 0..;
    all.retain(|_| index.next().is_some_and(keep));
}
