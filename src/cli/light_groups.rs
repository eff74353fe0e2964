//! Layers of `render` for light groups: the picture by the light of each group alone.

use anyhow::{Result, bail};

use crate::film::Film;
use crate::film::exr::Channel;
use crate::scene::Scene;
use crate::scene::model::light_groups::ENVIRONMENT;

use super::aov::three;

/// Layer of all light that is in none of the groups asked for.
const REST: &str = "rest";

/// The picture by the light of a group alone.
pub struct GroupFilm {
    layer: String,
    film: Film,
    /// True if the sky is in it.
    has_sky: bool,
}

/// Checks that a scene has the groups asked for.
pub fn check(scene: &Scene, wanted: &[String]) -> Result<()> {
    let names = scene.light_group_names();
    match wanted.iter().find(|name| name.is_empty() || !names.contains(name)) {
        None => Ok(()),
        Some(missing) => {
            let known: Vec<_> = names.iter().filter(|name| !name.is_empty()).map(|name| format!("`{name}`")).collect();
            let known = if known.is_empty() { "no group with a name".to_owned() } else { known.join(", ") };
            bail!("--light-groups {missing}: emits no light in the scene, which has {known}")
        }
    }
}

/// Renders the groups asked for, and the rest if any light is left. `render` returns none if it was interrupted.
pub fn render(
    scene: &Scene,
    wanted: &[String],
    render: &mut dyn FnMut(&Scene) -> Result<Option<Film>>,
) -> Result<Option<Vec<GroupFilm>>> {
    let names = scene.light_group_names();
    let is_wanted = |name: &str| wanted.iter().any(|wanted| wanted == name);
    let mut films = Vec::new();
    let mut add = |name: &str, is_lit: &dyn Fn(&str) -> bool| {
        let Some(film) = render(&scene.lit_by(is_lit))? else { return Ok::<_, anyhow::Error>(false) };
        films.push(GroupFilm { layer: layer(name), film, has_sky: is_lit(ENVIRONMENT) });
        Ok(true)
    };
    for group in names.iter().filter(|name| is_wanted(name)) {
        if !add(group, &|name| name == group)? {
            return Ok(None);
        }
    }
    if names.iter().any(|name| !is_wanted(name)) && !add(REST, &|name| !is_wanted(name))? {
        return Ok(None);
    }
    Ok(Some(films))
}

/// Returns the channels of the groups. `sky` is what was taken out of the picture.
pub fn channels(groups: &[GroupFilm], sky: &[[f32; 3]]) -> Vec<Channel> {
    let shown = |group: &GroupFilm| -> Vec<[f32; 3]> {
        let pixels = group.film.pixels.iter().zip(sky);
        pixels.map(|(lit, sky)| if group.has_sky { [0, 1, 2].map(|c| lit[c] - sky[c]) } else { *lit }).collect()
    };
    let of = |group: &GroupFilm| {
        let names = ["R", "G", "B"].map(|channel| format!("{}.{channel}", group.layer));
        three([0, 1, 2].map(|c| names[c].as_str()), &shown(group))
    };
    groups.iter().flat_map(of).collect()
}

/// Returns the name of the layer of a group. Dots separate layers from channels.
pub fn layer(group: &str) -> String {
    let word = group.chars().map(|c| if c.is_alphanumeric() || "-_ ".contains(c) { c } else { '_' });
    format!("light_{}", word.collect::<String>())
}
