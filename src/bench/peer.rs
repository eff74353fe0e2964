//! Other programs as contenders. The command of a peer is started once per scene, and communicates by lines
//! of text.
//!
//! The arguments `--scene FILE --size WIDTHxHEIGHT --bounces N` (`unlimited` without a limit) are appended to
//! the command. The peer loads the scene, renders a warm-up sample, and writes one line to its standard
//! output:
//!
//! ```text
//!     ready DESCRIPTION              or   error REASON
//! ```
//!
//! It then answers each line of its standard input:
//!
//! ```text
//!     render SAMPLES SEED FILE.exr       done SAMPLES SECONDS   or   error REASON
//! ```
//!
//! The picture is written to FILE.exr: linear Rec. 709 RGB, row 0 at the top. SECONDS is the time of
//! rendering by the peer's clock, without writing the file. SAMPLES is the number of samples that were taken,
//! which differs from the request if the program does not support every number. Other lines of output are
//! ignored. Standard error is stored beside the report as NAME-SCENE.log. The peer exits at the end of its
//! input. The folder benches/peers has examples.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use crate::film::Film;
use crate::settings::{Settings, UNLIMITED};

use super::BenchError;
use super::contender::{Contender, Details, Rendered};

/// Time limit for loading a scene.
const PATIENCE: Duration = Duration::from_secs(600);

/// Name and command of a peer, on the command line `NAME=COMMAND`.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct PeerCommand {
    /// Name in the report.
    pub name: String,
    /// Program and arguments.
    pub command: Vec<String>,
}

impl std::str::FromStr for PeerCommand {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, command) = text.split_once('=').ok_or("a peer is NAME=COMMAND")?;
        let command: Vec<String> = shlex::Shlex::new(command).collect();
        if name.trim().is_empty() || command.is_empty() {
            return Err("a peer is NAME=COMMAND, and neither of them may be empty".to_owned());
        }
        Ok(Self { name: name.trim().to_owned(), command })
    }
}

/// Running process of a peer.
pub struct Peer {
    name: String,
    about: String,
    process: Child,
    input: Option<ChildStdin>,
    lines: Receiver<String>,
    picture: PathBuf,
    log: PathBuf,
    seed: u32,
    patience: Duration,
}

impl Peer {
    /// Starts a peer and waits until it is ready. Pictures are exchanged by a file in `folder`, which also
    /// holds the peer's messages. `patience` is the time limit of a picture.
    ///
    /// # Errors
    /// Returns [`BenchError::Peer`] if the peer cannot be started, refuses the scene, or is not ready after
    /// ten minutes.
    pub fn start(
        peer: &PeerCommand,
        scene: &str,
        settings: &Settings,
        folder: &Path,
        patience: Duration,
    ) -> Result<Self, BenchError> {
        let error = |cause: String| BenchError::Peer { name: peer.name.clone(), cause };
        let bounces = if settings.bounces == UNLIMITED { "unlimited".to_owned() } else { settings.bounces.to_string() };
        let words = [peer.name.as_str(), &Path::new(scene).file_stem().unwrap_or_default().to_string_lossy()].join("-");
        let log = folder.join(words.replace(|c: char| !c.is_alphanumeric() && c != '-', "_") + ".log");
        let messages = std::fs::File::create(&log).map_err(|e| error(format!("{}: {e}", log.display())))?;
        let mut process = Command::new(&peer.command[0])
            .args(&peer.command[1..])
            .args(["--scene", scene, "--size", &format!("{}x{}", settings.width, settings.height)])
            .args(["--bounces", &bounces])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(messages)
            .spawn()
            .map_err(|e| {
                let _ = std::fs::remove_file(&log);
                error(format!("{} cannot be started: {e}; see benches/peers/README.md", peer.command[0]))
            })?;
        let input = process.stdin.take();
        let (send, lines) = channel();
        if let Some(output) = process.stdout.take() {
            std::thread::spawn(move || {
                for line in BufReader::new(output).lines().map_while(Result::ok) {
                    // The receiver is dropped while the peer is being ended.
                    if send.send(line).is_err() {
                        break;
                    }
                }
            });
        }
        let file = format!("peer-{}-{}.exr", std::process::id(), process.id());
        let mut this = Self {
            name: peer.name.clone(),
            about: String::new(),
            process,
            input,
            lines,
            picture: folder.join(file),
            log,
            seed: settings.seed,
            patience: PATIENCE,
        };
        this.about = this.answer("ready")?;
        this.patience = patience;
        Ok(this)
    }

    fn error(&self, cause: String) -> BenchError {
        BenchError::Peer { name: self.name.clone(), cause }
    }

    /// Returns the text after `word` on the next line that begins with it.
    fn answer(&self, word: &str) -> Result<String, BenchError> {
        let until = Instant::now() + self.patience;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let line = self.lines.recv_timeout(left).map_err(|e| {
                self.error(match e {
                    RecvTimeoutError::Timeout => format!("no `{word}` within {} s", self.patience.as_secs()),
                    RecvTimeoutError::Disconnected => {
                        format!("it ended before it said `{word}`; see {}", self.log.display())
                    }
                })
            })?;
            match line.split_once(' ') {
                Some((first, rest)) if first == word => return Ok(rest.trim().to_owned()),
                Some(("error", rest)) => return Err(self.error(rest.trim().to_owned())),
                _ => log::debug!("{}: {line}", self.name),
            }
        }
    }
}

impl Contender for Peer {
    fn grows(&self) -> bool {
        false
    }

    fn restart(&mut self, seed: u32) {
        self.seed = seed;
    }

    fn render(&mut self, samples: u64) -> Result<Rendered, BenchError> {
        let request = format!("render {samples} {} {}\n", self.seed, self.picture.display());
        let sent = match &mut self.input {
            Some(input) => input.write_all(request.as_bytes()).and_then(|()| input.flush()),
            None => Ok(()),
        };
        sent.map_err(|e| self.error(format!("its input is closed: {e}")))?;
        let answer = self.answer("done")?;
        let numbers = answer.split_once(' ').and_then(|(a, b)| Some((a.parse().ok()?, b.trim().parse().ok()?)));
        match numbers {
            Some((samples, seconds)) if samples > 0 && seconds > 0.0 => Ok(Rendered { samples, seconds }),
            _ => Err(self.error(format!("`done {answer}` is not `done SAMPLES SECONDS`"))),
        }
    }

    fn film(&mut self) -> Result<Film, BenchError> {
        Ok(Film::load(&self.picture)?)
    }

    fn details(&self) -> Details {
        Details { about: self.about.clone(), ..Details::default() }
    }

    fn forget(&mut self) {}
}

impl Drop for Peer {
    fn drop(&mut self) {
        // A peer exits at the end of its input. One that hangs is killed after five seconds.
        self.input = None;
        let until = Instant::now() + Duration::from_secs(5);
        while Instant::now() < until && matches!(self.process.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
        let _ = std::fs::remove_file(&self.picture);
        if std::fs::metadata(&self.log).is_ok_and(|log| log.len() == 0) {
            let _ = std::fs::remove_file(&self.log);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peers_are_a_name_and_a_command() {
        let peer: PeerCommand = "mitsuba=python 'my peers/mitsuba.py' --integrator path".parse().unwrap();
        assert_eq!(peer.name, "mitsuba");
        assert_eq!(peer.command, ["python", "my peers/mitsuba.py", "--integrator", "path"]);
        for bad in ["", "mitsuba", "=python", "mitsuba=", " = "] {
            assert!(bad.parse::<PeerCommand>().is_err(), "{bad}");
        }
    }

    fn shell(script: &str) -> PeerCommand {
        PeerCommand { name: "shell".to_owned(), command: vec!["sh".into(), "-c".into(), script.into(), "sh".into()] }
    }

    fn start(script: &str) -> Result<Peer, BenchError> {
        let patience = Duration::from_secs(20);
        Peer::start(&shell(script), "scene.xml", &Settings::default(), &std::env::temp_dir(), patience)
    }

    #[cfg(unix)]
    #[test]
    fn a_peer_is_spoken_to_by_lines() {
        let script =
            "echo noise; echo ready $@; read a n seed file; echo more noise; echo done $n 0.5; read a; echo done x";
        let mut peer = start(script).unwrap();
        assert_eq!(peer.details().about, "--scene scene.xml --size 512x512 --bounces 2");
        assert_eq!(peer.render(16).unwrap(), Rendered { samples: 16, seconds: 0.5 });
        assert!(peer.render(16).unwrap_err().to_string().contains("`done x` is not"));
        assert!(peer.render(16).unwrap_err().to_string().contains("shell"), "it has ended");
    }

    #[cfg(unix)]
    #[test]
    fn a_peer_that_cannot_says_why() {
        let refused = start("echo error no such lobe").err().unwrap().to_string();
        assert!(refused.contains("shell") && refused.contains("no such lobe"), "{refused}");
        assert!(start("true").err().unwrap().to_string().contains("ended before"));
        let missing = PeerCommand { name: "none".into(), command: vec!["no-such-program-of-ours".into()] };
        let folder = std::env::temp_dir();
        let error = Peer::start(&missing, "a.xml", &Settings::default(), &folder, PATIENCE).err().unwrap().to_string();
        assert!(error.contains("cannot be started") && error.contains("benches/peers"), "{error}");
    }
}
