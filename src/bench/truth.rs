//! References: a file, or a picture that is rendered once and stored under a hash of scene and settings.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::film::Film;
use crate::gpu::Gpu;
use crate::metrics;
use crate::reference::{Reference, ReferenceSettings, Rounds};
use crate::render;
use crate::scene::Scene;
use crate::settings::{Settings, Technique};

use super::BenchError;

/// Seeds of the two halves. Contenders use other seeds.
const SEEDS: [u32; 2] = [0x5eed_0001, 0x5eed_0002];

/// Version of the renderers of references. It is incremented whenever their results change.
const GENERATION: u32 = 1;

/// Reference picture with its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Reference picture.
    pub film: Film,
    /// Origin of the picture.
    pub origin: Origin,
}

/// Origin of a reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Description for the report.
    pub how: String,
    /// rel_mse of the reference itself, if known. With the halves a and b of the picture r it is the mean of
    /// (a - b)^2 / (r^2 + 0.01) / 4.
    pub own_rel_mse: Option<f64>,
    /// Samples per pixel; 0 if unknown.
    pub samples: u64,
    /// Seconds of rendering.
    pub seconds: f64,
}

impl Truth {
    /// Loads a reference from a file, with its rel_mse if the caller knows it.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or if values are not finite.
    pub fn from_file(path: &Path, own_rel_mse: Option<f64>) -> Result<Self, BenchError> {
        let film = Film::load(path)?;
        if film.non_finite() > 0 {
            let cause = format!("{} values of {} are not finite", film.non_finite(), path.display());
            return Err(BenchError::Truth(format!("{cause}; render it again")));
        }
        let how = format!("the file {}", path.file_name().unwrap_or_default().to_string_lossy());
        Ok(Self { film, origin: Origin { how, own_rel_mse, samples: 0, seconds: 0.0 } })
    }

    /// Returns the stored reference of this scene and these settings. If there is none, renders two halves of
    /// `seconds / 2` each by `settings.method` (`reference`, or on a device `path` or `ray-query`) and stores
    /// their mean in `cache`. `progress` receives the finished share, 0 to 1.
    ///
    /// # Errors
    /// Returns the error of the renderer, or an error if the cache cannot be written.
    pub fn cached(
        gpu: Option<&Gpu>,
        scene: &Scene,
        settings: &Settings,
        seconds: f64,
        cache: &Path,
        progress: &dyn Fn(f64),
    ) -> Result<Self, BenchError> {
        let key = key(scene, settings, seconds);
        let [picture, about] = ["exr", "json"].map(|extension| cache.join(&key).with_extension(extension));
        if let (Ok(film), Ok(text)) = (Film::load(&picture), std::fs::read_to_string(&about))
            && let Ok(origin) = serde_json::from_str(&text)
        {
            return Ok(Self { film, origin });
        }
        std::fs::create_dir_all(cache).map_err(|e| unwritable(cache, &e))?;
        let truth = Self::halves(gpu, scene, settings, seconds, progress)?;
        truth.film.save(&picture)?;
        let text = serde_json::to_string_pretty(&truth.origin).map_err(|e| BenchError::Truth(e.to_string()))?;
        std::fs::write(&about, text + "\n").map_err(|e| unwritable(&about, &e))?;
        Ok(truth)
    }

    /// Renders two halves and their mean.
    fn halves(
        gpu: Option<&Gpu>,
        scene: &Scene,
        settings: &Settings,
        seconds: f64,
        progress: &dyn Fn(f64),
    ) -> Result<Self, BenchError> {
        let began = Instant::now();
        let (halves, samples) = match gpu {
            None => halves_by_reference(scene, settings, seconds, progress),
            Some(gpu) => halves_by_device(gpu, scene, settings, seconds, progress)?,
        };
        let [a, b] = halves;
        let mean = |a: f32, b: f32| 0.5 * (a + b);
        let pixels = a.pixels.iter().zip(&b.pixels).map(|(a, b)| std::array::from_fn(|c| mean(a[c], b[c]))).collect();
        let film = Film { pixels, ..a.clone() };
        // a - r = (a - b) / 2, and (a - b)^2 / 4 is an estimate of the variance of the mean r.
        let own = metrics::compare(&a, &film)?.rel_mse;
        if !own.is_finite() {
            let cause = format!("{} has values that are not finite", settings.technique);
            return Err(BenchError::Truth(format!("{cause}; report the scene, and use --reference FILE")));
        }
        let device = gpu.map_or_else(|| "CPU".to_owned(), |gpu| gpu.capabilities.adapter.clone());
        let how = format!("{} on {device}, two halves", settings.technique);
        let seconds = began.elapsed().as_secs_f64();
        Ok(Self { film, origin: Origin { how, own_rel_mse: Some(own), samples, seconds } })
    }
}

fn unwritable(path: &Path, cause: &std::io::Error) -> BenchError {
    BenchError::Truth(format!("{}: cannot be written ({cause}); choose another folder with --cache", path.display()))
}

/// Renders both halves alternately in rounds that double, so that both have the same number of samples: the
/// most that fit into the time.
fn halves_by_reference(scene: &Scene, settings: &Settings, seconds: f64, progress: &dyn Fn(f64)) -> ([Film; 2], u64) {
    let began = Instant::now();
    let reference = Reference::new(scene);
    let mut halves = SEEDS.map(|seed| Rounds::new(ReferenceSettings::of(&Settings { seed, ..settings.clone() })));
    let mut round = 1;
    loop {
        for half in &mut halves {
            half.add(&reference, round, &|_, _| ());
        }
        let (used, samples) = (began.elapsed().as_secs_f64(), halves[0].samples());
        progress((used / seconds).min(1.0));
        // A round has at least a quarter of the samples so far, so that sequences are rarely truncated. The
        // last round ends with the budget.
        let fit = ((seconds - used) * f64::from(samples) / used) as u32;
        if fit < samples.div_ceil(4) {
            break;
        }
        round = fit.min(samples);
    }
    let samples = 2 * u64::from(halves[0].samples());
    (halves.map(|half| half.film()), samples)
}

/// Renders the halves on a device: the first for half of the time, the second with the same number of
/// samples.
fn halves_by_device(
    gpu: &Gpu,
    scene: &Scene,
    settings: &Settings,
    seconds: f64,
    progress: &dyn Fn(f64),
) -> Result<([Film; 2], u64), BenchError> {
    let mut renderer = render::open(gpu, scene, settings)?;
    renderer.restart(SEEDS[0]);
    let began = Instant::now();
    let half = seconds / 2.0;
    renderer.render(u64::MAX / 2, &mut |_| {
        let used = began.elapsed().as_secs_f64();
        progress((used / seconds).min(0.5));
        used < half
    })?;
    let (first, samples) = (renderer.film()?, renderer.stats().samples);
    renderer.restart(SEEDS[1]);
    renderer.render(samples, &mut |done| {
        progress(0.5 + 0.5 * done as f64 / samples as f64);
        true
    })?;
    Ok(([first, renderer.film()?], 2 * samples))
}

/// Returns the name of a stored reference: a hash of everything on which the picture depends.
fn key(scene: &Scene, settings: &Settings, seconds: f64) -> String {
    let mut hash = Hash(Sha256::new());
    // The debug output of a scene contains every field with every digit, so that new fields are included
    // automatically.
    let written = write!(hash, "{GENERATION} {seconds} {:?} {settings:?}\n{scene:?}", ReferenceSettings::of(settings));
    debug_assert!(written.is_ok(), "hashing cannot fail");
    hash.0.finalize().iter().take(16).fold(String::new(), |mut hex, byte| {
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}

/// Writer that hashes text.
struct Hash(Sha256);

impl std::fmt::Write for Hash {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

/// Returns the default folder of references: `lightsheaf/references` in the user's cache folder.
#[must_use]
pub fn default_cache() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let base = set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")).or_else(|| Some(set("HOME")?.join(".cache")));
    base.unwrap_or_else(std::env::temp_dir).join("lightsheaf").join("references")
}

/// Returns the default method for references with its device: `path` on a GPU with ray queries, otherwise the
/// CPU reference.
#[must_use]
pub fn best_method() -> (Technique, Option<Gpu>) {
    match Gpu::with_ray_queries() {
        Ok(gpu) if !gpu.capabilities.software => (Technique::PATH, Some(gpu)),
        _ => (Technique::REFERENCE, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn the_key_follows_scene_and_settings() {
        let scene = builtin::load("cornell_point").unwrap();
        let settings = Settings { technique: Technique::REFERENCE, ..Settings::default() };
        let base = key(&scene, &settings, 10.0);
        assert_eq!(base, key(&scene.clone(), &settings.clone(), 10.0));
        assert_eq!(base.len(), 32);
        let mut moved = scene.clone();
        moved.meshes[0].positions[0].x += 1e-6;
        let mut brighter = scene.clone();
        brighter.materials[0].sides = crate::scene::Sides::OneCulled;
        let changed = [
            key(&moved, &settings, 10.0),
            key(&brighter, &settings, 10.0),
            key(&scene, &settings, 11.0),
            key(&scene, &Settings { bounces: 3, ..settings.clone() }, 10.0),
            key(&scene, &Settings { width: 511, ..settings.clone() }, 10.0),
            key(&scene, &Settings { technique: Technique::PATH, ..settings }, 10.0),
        ];
        for (i, key) in changed.iter().enumerate() {
            assert!(*key != base && !changed[..i].contains(key), "{i}");
        }
    }

    #[test]
    fn a_reference_is_made_once_and_knows_its_own_error() {
        let folder = std::env::temp_dir().join(format!("lightsheaf-truth-{}", std::process::id()));
        // Light without extent, which no path hits: its error has no rare large parts, so that two halves tell it.
        let scene = builtin::load("cornell_point").unwrap();
        let settings = Settings { technique: Technique::REFERENCE, width: 32, height: 32, ..Settings::default() };
        let truth = Truth::cached(None, &scene, &settings, 0.5, &folder, &|_| ()).unwrap();
        let again = Truth::cached(None, &scene, &settings, 0.5, &folder, &|_| panic!("rendered twice")).unwrap();
        assert!(truth.film == again.film, "the same bytes");
        let [own, kept] = [&truth, &again].map(|t| t.origin.own_rel_mse.unwrap());
        assert!((own / kept - 1.0).abs() < 1e-12, "{own} {kept}");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 2);
        // The error against a much better picture equals the estimate from the halves, within noise.
        let better = Settings { samples: 8 * truth.origin.samples as u32, ..settings };
        let better = Reference::new(&scene).render(&ReferenceSettings::of(&better), &|_, _| ()).film;
        let real = metrics::compare(&truth.film, &better).unwrap().rel_mse;
        assert!((0.5..2.0).contains(&(own / real)), "{own} {real}, {} samples", truth.origin.samples);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
