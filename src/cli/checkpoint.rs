//! Checkpoints of `render`: files from which a render goes on as if it had never stopped.
//!
//! A file is a line of text, the SHA-256 of the rest, the length of the head as 64 bits, the head in CBOR, and
//! the contents of the renderer's buffers one after the other.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow, bail};
use sha2::{Digest as _, Sha256};

use crate::film;
use crate::render::convergence::Convergence;
use crate::render::fingerprint;
use crate::render::state::RenderState;
use crate::scene::Scene;
use crate::settings::Settings;

/// First line of a file.
const MAGIC: &[u8] = b"lightsheaf checkpoint 1\n";

/// Bytes of the SHA-256 and of the length of the head.
const SUM: usize = 32;
const LENGTH: usize = 8;

/// What a picture depends on.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Identity {
    version: String,
    scene: String,
    scene_hash: String,
    settings: String,
    /// Target of the error, which decides where samples go.
    target_error: Option<f64>,
    device: String,
}

impl Identity {
    /// Returns that of a render on a device.
    pub fn new(scene: &Scene, scene_hash: &str, settings: &Settings, device: String) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            scene: scene.name.clone(),
            scene_hash: scene_hash.to_owned(),
            settings: fingerprint::settings_text(settings, None),
            target_error: settings.target_error,
            device,
        }
    }

    /// Names what differs from a render that goes on with this one; none if nothing does.
    fn difference(&self, now: &Self) -> Option<String> {
        if self.version != now.version {
            return Some(format!(
                "it is of version {}, and this is {}; render it with that version",
                self.version, now.version
            ));
        }
        let mut settings = fingerprint::differences(&self.settings, &now.settings);
        if self.target_error != now.target_error {
            let shown = |target: Option<f64>| target.map_or_else(|| "none".to_owned(), |target| target.to_string());
            settings.push(format!("target_error ({} and {})", shown(self.target_error), shown(now.target_error)));
        }
        if !settings.is_empty() {
            return Some(format!("it has other settings: {}; give those of the checkpoint", settings.join(", ")));
        }
        if self.scene_hash != now.scene_hash {
            let (then, now) = (&self.scene, &now.scene);
            return Some(format!("it is of the scene {then} as it was; {now} differs, so begin anew without --resume"));
        }
        None
    }
}

/// A render between two batches.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct Saved {
    /// Samples of the picture.
    pub samples: u64,
    /// Samples of all pixels together, without those of converged tiles.
    pub taken: u64,
    /// Seconds of rendering.
    pub seconds: f64,
    /// Factor of the radiance in the estimate of the error.
    pub error_scale: Option<f32>,
    /// The estimate of the error.
    pub convergence: Option<Convergence>,
    /// The picture.
    pub state: RenderState,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Head {
    identity: Identity,
    saved: Saved,
    /// Bytes of each buffer.
    buffers: Vec<u64>,
}

/// Returns the file of the checkpoints of a render: the first output with the extension `.checkpoint`.
pub fn path_of(output: &Path) -> PathBuf {
    output.with_extension("checkpoint")
}

/// Writes a file, which replaces an existing one only when it is complete.
pub fn write(path: &Path, identity: &Identity, saved: &Saved) -> Result<()> {
    let buffers = saved.state.buffers.iter().map(|buffer| buffer.len() as u64).collect();
    let mut head = Vec::new();
    ciborium::into_writer(&Head { identity: identity.clone(), saved: saved.clone(), buffers }, &mut head)?;
    let length = (head.len() as u64).to_le_bytes();
    let parts = || [length.as_slice(), &head].into_iter().chain(saved.state.buffers.iter().map(Vec::as_slice));
    let sum = parts().fold(Sha256::new(), |sum, part| sum.chain_update(part)).finalize();
    film::replace(path, &|temporary| {
        let mut file = std::fs::File::create(temporary).map_err(|e| e.to_string())?;
        let mut all = [MAGIC, sum.as_slice()].into_iter().chain(parts());
        all.try_for_each(|part| std::io::Write::write_all(&mut file, part)).map_err(|e| e.to_string())
    })
    .map_err(|e| anyhow!("{}", e.to_string().replace("the image", "the checkpoint")))
}

/// Reads a file and checks that it is of the same render.
pub fn read(path: &Path, now: &Identity) -> Result<Saved> {
    let shown = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("--resume {shown}: cannot be read"))?;
    let Some(rest) = bytes.strip_prefix(MAGIC) else {
        bail!("--resume {shown}: is no checkpoint of this version; give a file that `render --checkpoint` wrote");
    };
    let damaged = || anyhow!("--resume {shown}: is damaged; begin anew without --resume");
    let (sum, rest) = rest.split_at_checked(SUM).ok_or_else(damaged)?;
    if Sha256::digest(rest).as_slice() != sum {
        return Err(damaged());
    }
    let (length, rest) = rest.split_at_checked(LENGTH).ok_or_else(damaged)?;
    let length = length.try_into().map(u64::from_le_bytes).map_err(|_| damaged())?;
    let (head, mut rest) = usize::try_from(length).ok().and_then(|n| rest.split_at_checked(n)).ok_or_else(damaged)?;
    let Head { identity, mut saved, buffers } = ciborium::from_reader(head).map_err(|_| damaged())?;
    for length in buffers {
        let (buffer, after) =
            usize::try_from(length).ok().and_then(|n| rest.split_at_checked(n)).ok_or_else(damaged)?;
        saved.state.buffers.push(buffer.to_vec());
        rest = after;
    }
    if let Some(difference) = identity.difference(now) {
        bail!("--resume {shown}: {difference}");
    }
    if identity.device != now.device {
        eprintln!("warning: --resume {shown}: it is of {}; another device may round differently", identity.device);
    }
    Ok(saved)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_is_whole_or_refused() {
        let folder = std::env::temp_dir().join(format!("lightsheaf-checkpoint-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.checkpoint");
        let scene = crate::scene::load("builtin:cornell_point").unwrap();
        let settings = Settings::default();
        let identity = |scene: &Scene, settings: &Settings| {
            Identity::new(scene, &fingerprint::scene_hash(scene), settings, "CPU".to_owned())
        };
        let own = identity(&scene, &settings);
        let state = RenderState { next: 7, buffers: vec![vec![1, 2, 3], vec![], vec![9; 5]], ..RenderState::default() };
        let mut convergence = Convergence::new(20, 20);
        convergence.update(4, &crate::film::Film::new(20, 20), None);
        let convergence = Some(convergence);
        let saved = Saved { samples: 7, taken: 0, seconds: 1.5, error_scale: Some(0.1), convergence, state };
        write(&path, &own, &saved).unwrap();
        let back = read(&path, &own).unwrap();
        assert_eq!(format!("{back:?}"), format!("{saved:?}"), "infinities of tiles included");

        let refused = |now: &Identity, what: &str| {
            let text = read(&path, now).unwrap_err().to_string();
            assert!(text.contains(what), "{what}: {text}");
        };
        refused(&identity(&scene, &Settings { bounces: 1, ..settings.clone() }), "bounces (2 and 1)");
        refused(
            &identity(&scene, &Settings { target_error: Some(0.1), ..settings.clone() }),
            "target_error (none and 0.1)",
        );
        let longer = identity(&scene, &Settings { samples: 9, ..settings.clone() });
        assert!(read(&path, &longer).is_ok(), "it may go on for longer");
        let other = crate::scene::load("builtin:cornell_area").unwrap();
        refused(&identity(&other, &settings), "builtin:cornell_area differs");
        refused(&Identity { version: "9.9.9".to_owned(), ..own.clone() }, "this is 9.9.9");

        let bytes = std::fs::read(&path).unwrap();
        for cut in [0, 10, MAGIC.len(), MAGIC.len() + 31, MAGIC.len() + 36, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            refused(&own, if cut < MAGIC.len() { "is no checkpoint" } else { "is damaged" });
        }
        let mut flipped = bytes.clone();
        *flipped.last_mut().unwrap() ^= 1;
        std::fs::write(&path, flipped).unwrap();
        refused(&own, "is damaged");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
