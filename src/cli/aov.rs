//! What `render` writes beside the picture: coverage, AOVs, parts of the light, and the denoised picture.

use std::path::PathBuf;

use anyhow::{Result, bail};

use crate::film::Film;
use crate::film::cryptomatte;
use crate::film::exr::{Channel, Picture};
use crate::film::oidn::{self, Guides};
use crate::reference::aov::Aovs;
use crate::reference::{Reference, ReferenceSettings};
use crate::scene::Scene;
use crate::settings::{OnlyStrategy, Settings, Technique};

use super::light_groups::{self, GroupFilm};

/// Rays per pixel.
const RAYS: u32 = 32;

/// Names of the picture before it was denoised.
pub const NOISY: [&str; 3] = ["noisy.R", "noisy.G", "noisy.B"];

/// Names of the layer of light that was scattered more than once.
pub const INDIRECT: [&str; 3] = ["indirect.R", "indirect.G", "indirect.B"];

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
    /// Pixels by which what is at the pixel's centre has moved since the frame before of --frames or --turntable,
    /// X to the right and Y up; zero without one
    Motion,
    /// Light that comes without being scattered: what the camera sees emit, and the sky behind the scene
    Emission,
    /// Light that was scattered once
    Direct,
    /// Light that was scattered more than once
    Indirect,
    /// Objects and materials with their coverage, as Cryptomatte
    Id,
}

/// Options of `render` about layers.
#[derive(Clone, clap::Args)]
pub struct LayerArgs {
    /// Layers of the .exr beside R, G, B and A, separated by commas. The sum of emission, direct and indirect is
    /// the picture; the others are the same for all methods, and without noise of light
    #[arg(long, value_name = "LIST", value_delimiter = ',', help_heading = LAYERS)]
    pub aov: Vec<Aov>,
    /// Light groups with a layer of their own, light_NAME, separated by commas: names of lights, of emissive materials,
    /// or `environment`; the rest of the light is light_rest. Each takes the time of the picture
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = LAYERS)]
    pub light_groups: Vec<String>,
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

    /// True if a layer is a part of the light.
    pub fn splits_light(&self) -> bool {
        self.aov.iter().any(|aov| aov.is_light())
    }

    /// True if layers are rendered after the picture, by the method of the picture.
    pub fn renders_light(&self) -> bool {
        self.splits_light() || !self.light_groups.is_empty()
    }

    /// Checks that there is an .exr for the layers.
    pub fn check(&self, has_exr: bool, has_png: bool) -> Result<()> {
        if !self.aov.is_empty() && !has_exr {
            bail!("--aov: layers are written to an .exr; give one by -o");
        }
        if !self.light_groups.is_empty() && !has_exr {
            bail!("--light-groups: layers are written to an .exr; give one by -o");
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

    /// True if a picture has these layers, and is denoised and without the sky as asked for.
    pub fn are_in(&self, picture: &Picture) -> bool {
        let has = |start: &str| picture.channels.iter().any(|channel| channel.name.starts_with(start));
        let first = |aov: &Aov| match aov {
            Aov::Albedo => "albedo.",
            Aov::Normal => "normal.",
            Aov::Depth => "depth.",
            Aov::Position => "position.",
            Aov::Motion => "motion.",
            Aov::Emission => "emission.",
            Aov::Direct => "direct.",
            Aov::Indirect => "indirect.",
            Aov::Id => "CryptoObject",
        };
        // Only the command says whether the sky was taken out.
        let command = picture.record.as_ref().map_or("", |record| &record.command);
        self.aov.iter().all(|aov| has(first(aov)))
            && self.light_groups.iter().all(|group| has(&format!("{}.", light_groups::layer(group))))
            && self.denoise == has("noisy.")
            && self.transparent == command.contains("--transparent")
    }

    /// Traces the rays of the layers, if there are any. `before` is the scene in the frame before.
    pub fn trace(&self, scene: &Scene, before: Option<&Scene>, settings: &Settings) -> Option<Aovs> {
        let Settings { width, height, camera, .. } = *settings;
        let region = settings.region();
        let settings =
            ReferenceSettings { width, height, samples: RAYS, bounces: None, specular_bounces: 0, seed: 0, camera };
        self.any().then(|| Reference::new(scene).aovs_within(&settings, region, before))
    }

    /// Returns the picture with its layers, without those of light if that is not known.
    pub fn picture(
        &self,
        film: &Film,
        scene: &Scene,
        aovs: Option<&Aovs>,
        light: Option<&SplitLight>,
        groups: &[GroupFilm],
    ) -> Result<Picture> {
        let mut picture = Picture { film: film.clone(), ..Picture::default() };
        if let Some(aovs) = aovs {
            self.add_traced(&mut picture, film, scene, aovs)?;
        }
        // Denoising is not linear: what it changes belongs to no part.
        let sky = minus(film, if self.denoise { film } else { &picture.film });
        if let Some(light) = light {
            self.add_light(&mut picture, &Film { pixels: sky.clone(), ..*film }, film, light);
        }
        picture.channels.extend(light_groups::channels(groups, &sky));
        Ok(picture)
    }

    /// Adds the parts of the light, which sum to `film` without the sky that was taken out of it.
    fn add_light(&self, picture: &mut Picture, sky: &Film, film: &Film, light: &SplitLight) {
        let SplitLight { once, seen } = light;
        for aov in &self.aov {
            picture.channels.extend(match aov {
                Aov::Emission => three(["emission.R", "emission.G", "emission.B"], &minus(seen, sky)),
                Aov::Direct => three(["direct.R", "direct.G", "direct.B"], &minus(once, seen)),
                Aov::Indirect => three(INDIRECT, &minus(film, once)),
                _ => continue,
            });
        }
    }

    /// Denoises the picture, takes the sky out of it, and adds the layers that were traced.
    fn add_traced(&self, picture: &mut Picture, film: &Film, scene: &Scene, aovs: &Aovs) -> Result<()> {
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
                Aov::Motion => {
                    let axis = |name: &str, axis: usize| Channel {
                        name: name.to_owned(),
                        values: aovs.motion.iter().map(|pixels| pixels[axis]).collect(),
                    };
                    picture.channels.extend([axis("motion.X", 0), axis("motion.Y", 1)]);
                }
                Aov::Id => add_identifiers(picture, scene, aovs),
                Aov::Emission | Aov::Direct | Aov::Indirect => {}
            }
        }
        Ok(())
    }
}

impl Aov {
    /// True for parts of the light, which are rendered by the method of the picture.
    fn is_light(self) -> bool {
        matches!(self, Self::Emission | Self::Direct | Self::Indirect)
    }
}

/// The picture of light that was scattered at most once, with the samples of the picture, and the part of it that
/// was not scattered. What the picture has more was scattered more than once.
pub struct SplitLight {
    once: Film,
    seen: Film,
}

impl SplitLight {
    /// Renders the two pictures. `render` makes one of all strategies, or of one; it returns none if it was
    /// interrupted.
    pub fn new<E>(
        technique: Technique,
        render: &mut dyn FnMut(Option<OnlyStrategy>) -> Result<Option<Film>, E>,
    ) -> Result<Option<Self>, E> {
        let Some(once) = render(None)? else { return Ok(None) };
        let mut seen = Film::new(once.width, once.height);
        // Emission is hit from the camera, and in some methods also connected with the camera.
        for s in (0..=1).filter(|&s| s == 0 || technique.has_strategy(s, 2 - s)) {
            let Some(film) = render(Some(OnlyStrategy { s, t: 2 - s, weighted: true }))? else { return Ok(None) };
            let sums = seen.pixels.iter_mut().flatten().zip(film.pixels.iter().flatten());
            sums.for_each(|(sum, value)| *sum += value);
        }
        Ok(Some(Self { once, seen }))
    }

    /// Returns the settings of light that is scattered at most once.
    pub fn settings(settings: &Settings) -> Settings {
        Settings { bounces: 0, specular_bounces: 0, target_error: None, budget: None, ..settings.clone() }
    }
}

/// Returns the difference of two films.
fn minus(a: &Film, b: &Film) -> Vec<[f32; 3]> {
    a.pixels.iter().zip(&b.pixels).map(|(a, b)| std::array::from_fn(|c| a[c] - b[c])).collect()
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
    let mesh = |(n, instance): (usize, &crate::scene::Instance)| format!("{}.{n}", scene.meshes[instance.mesh].name);
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
