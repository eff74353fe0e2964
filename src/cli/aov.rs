//! What `render` writes beside light: coverage, AOVs, and the denoised picture.

use std::path::PathBuf;

use anyhow::{Result, bail};

use lightsheaf::film::Film;
use lightsheaf::film::cryptomatte;
use lightsheaf::film::exr::{Channel, Picture};
use lightsheaf::film::oidn::{self, Guides};
use lightsheaf::reference::aov::Aovs;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::scene::Scene;
use lightsheaf::settings::Settings;

/// Rays per pixel.
const RAYS: u32 = 32;

/// Names of the picture before it was denoised.
pub const NOISY: [&str; 3] = ["noisy.R", "noisy.G", "noisy.B"];

/// A layer of the .exr.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Aov {
    /// Directional albedo, mean over the pixel
    Albedo,
    /// Shading normal in world space, mean over the pixel
    Normal,
    /// Depth along the view direction at the pixel's centre in metres, 1e10 where nothing is hit
    Depth,
    /// Position in world space at the pixel's centre in metres
    Position,
    /// Radiance that seen surfaces emit, mean over the pixel
    Emission,
    /// Objects and materials with their coverage, as Cryptomatte
    Id,
}

/// Options of `render` about layers.
#[derive(Clone, clap::Args)]
pub struct LayerArgs {
    /// Layers of the .exr beside R, G, B and A, separated by commas. They are the same for all methods, and
    /// without noise of light
    #[arg(long, value_name = "LIST", value_delimiter = ',', help_heading = LAYERS)]
    pub aov: Vec<Aov>,
    /// Leave the environment behind the scene out of the .exr; A says how much of a pixel is covered
    #[arg(long, help_heading = LAYERS)]
    pub transparent: bool,
    /// Denoise the picture by Intel Open Image Denoise, with albedo and normals. The .exr keeps the original as
    /// the layer `noisy`
    #[arg(long, help_heading = LAYERS)]
    pub denoise: bool,
    /// Library of --denoise, or its folder [default: LIGHTSHEAF_OIDN, that of scripts/setup.sh --denoise, or the
    /// system's]
    #[arg(long, value_name = "PATH", requires = "denoise", help_heading = LAYERS)]
    pub oidn: Option<PathBuf>,
}

const LAYERS: &str = "Layers";

impl LayerArgs {
    /// True if rays have to be traced for the layers.
    fn any(&self) -> bool {
        !self.aov.is_empty() || self.transparent || self.denoise
    }

    /// Checks that there is an .exr for the layers.
    pub fn check(&self, has_exr: bool, has_png: bool) -> Result<()> {
        if !self.aov.is_empty() && !has_exr {
            bail!("--aov: layers are written to an .exr; give one by -o");
        }
        if self.transparent && (!has_exr || has_png) {
            bail!("--transparent: only an .exr holds coverage; give one by -o, and no .png");
        }
        if self.denoise {
            // A missing library is told before the render, not after it.
            oidn::denoise(&Film::new(4, 4), None, self.oidn.as_deref())?;
        }
        Ok(())
    }

    /// Traces the rays of the layers, if there are any.
    pub fn trace(&self, scene: &Scene, settings: &Settings) -> Option<Aovs> {
        let Settings { width, height, camera, .. } = *settings;
        let region = settings.region();
        let settings = ReferenceSettings { width, height, samples: RAYS, bounces: None, seed: 0, camera };
        self.any().then(|| Reference::new(scene).aovs_within(&settings, region))
    }

    /// Returns the picture with its layers.
    pub fn picture(&self, film: &Film, scene: &Scene, aovs: Option<&Aovs>) -> Result<Picture> {
        let mut picture = Picture { film: film.clone(), ..Picture::default() };
        let Some(aovs) = aovs else { return Ok(picture) };
        if self.denoise {
            let guides = Guides { albedo: &aovs.albedo, normal: &aovs.normal };
            picture.film = oidn::denoise(film, Some(guides), self.oidn.as_deref())?;
            picture.channels.extend(three(NOISY, &film.pixels));
        }
        if self.transparent {
            uncover(&mut picture.film, aovs);
        }
        picture.channels.push(Channel { name: "A".to_owned(), values: aovs.coverage.clone() });
        for aov in &self.aov {
            match aov {
                Aov::Albedo => picture.channels.extend(three(["albedo.R", "albedo.G", "albedo.B"], &aovs.albedo)),
                Aov::Normal => picture.channels.extend(three(["normal.X", "normal.Y", "normal.Z"], &aovs.normal)),
                Aov::Depth => {
                    picture.channels.push(Channel { name: "depth.Z".to_owned(), values: aovs.depth.clone() });
                }
                Aov::Position => {
                    picture.channels.extend(three(["position.X", "position.Y", "position.Z"], &aovs.position));
                }
                Aov::Emission => {
                    picture.channels.extend(three(["emission.R", "emission.G", "emission.B"], &aovs.emission));
                }
                Aov::Id => add_identifiers(&mut picture, scene, aovs),
            }
        }
        Ok(picture)
    }
}

/// Returns three channels.
pub fn three(names: [&str; 3], values: &[[f32; 3]]) -> [Channel; 3] {
    [0, 1, 2].map(|c| Channel { name: names[c].to_owned(), values: values.iter().map(|value| value[c]).collect() })
}

/// Takes the environment behind the scene out of a picture. What is left of pixels at edges is not negative.
fn uncover(film: &mut Film, aovs: &Aovs) {
    for ((pixel, behind), coverage) in film.pixels.iter_mut().zip(&aovs.background).zip(&aovs.coverage) {
        *pixel = std::array::from_fn(|c| if *coverage > 0.0 { (pixel[c] - behind[c]).max(0.0) } else { 0.0 });
    }
}

/// Adds the layers of objects and of materials.
fn add_identifiers(picture: &mut Picture, scene: &Scene, aovs: &Aovs) {
    let mesh =
        |(n, instance): (usize, &lightsheaf::scene::Instance)| format!("{}.{n}", scene.meshes[instance.mesh].name);
    let mut objects: Vec<String> = scene.instances.iter().enumerate().map(mesh).collect();
    objects.push("tessellated".to_owned());
    let materials: Vec<String> =
        scene.materials.iter().enumerate().map(|(n, material)| format!("{}.{n}", material.name)).collect();
    for (name, names, pixels) in
        [("CryptoObject", objects, &aovs.objects), ("CryptoMaterial", materials, &aovs.materials)]
    {
        let index = |&(id, coverage): &(u32, f32)| ((id as usize).min(names.len() - 1), coverage);
        let pixels: Vec<Vec<_>> = pixels.iter().map(|pixel| pixel.iter().map(index).collect()).collect();
        let (channels, attributes) = cryptomatte::layer(name, &names, &pixels);
        picture.channels.extend(channels);
        picture.attributes.extend(attributes);
    }
}
