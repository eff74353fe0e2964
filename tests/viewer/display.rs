//! A display of its own, the viewer on it, and a user's hands and eyes: Xvfb, xdotool, xwd.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use image::{Rgb, RgbImage};

use super::xdnd::drop_file;

/// Longest that anything may take to happen.
const PATIENCE: Duration = Duration::from_secs(90);

/// An X server that nobody sees.
pub struct Display {
    server: Child,
    name: String,
    /// One at a time, so that tests do not take each other's processors.
    _alone: MutexGuard<'static, ()>,
}

impl Display {
    /// Starts one on a free number. Where the tools are missing, says so and gives none; where `REQUIRE_GPU`
    /// is 1, fails instead.
    pub fn open() -> Option<Self> {
        let missing = ["Xvfb", "xdotool", "xwd"].into_iter().find(|tool| {
            let asked = Command::new(tool).arg("-help").stdout(Stdio::null()).stderr(Stdio::null()).status();
            asked.is_err()
        });
        if let Some(tool) = missing {
            assert!(std::env::var("REQUIRE_GPU").as_deref() != Ok("1"), "REQUIRE_GPU is 1, but there is no {tool}");
            println!("skipped: no {tool}; scripts/setup.sh installs it");
            return None;
        }
        static ONE: Mutex<()> = Mutex::new(());
        let alone = ONE.lock().unwrap_or_else(PoisonError::into_inner);
        let arguments = ["-displayfd", "1", "-screen", "0", "1400x900x24", "-nolisten", "tcp"];
        let mut server =
            Command::new("Xvfb").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self { server, name: format!(":{}", number.trim()), _alone: alone })
    }

    fn tool(&self, name: &str) -> Command {
        let mut command = Command::new(name);
        command.env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY");
        command
    }

    /// Opens the viewer, in a folder.
    pub fn view(&self, folder: &Path, arguments: &[&str]) -> Viewer<'_> {
        let mut child = self
            .tool(env!("CARGO_BIN_EXE_lightsheaf"))
            .arg("view")
            .args(arguments)
            .current_dir(folder)
            // The layers speak, where they are installed, and everything that is amiss is heard.
            .env("WGPU_VALIDATION", "1")
            .env("RUST_LOG", "warn,lightsheaf::viewer=debug")
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let stderr = child.stderr.take().unwrap();
        let (send, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                if send.send((Instant::now(), line)).is_err() {
                    break;
                }
            }
        });
        let mut viewer = Viewer { display: self, child, lines, heard: Vec::new(), window: String::new() };
        viewer.wait_for("samples by");
        let found = viewer.xdotool(&["search", "--name", "Lightsheaf"]);
        viewer.window = found.lines().last().expect("a window").to_owned();
        viewer.xdotool(&["windowfocus", &viewer.window]);
        viewer
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// The viewer, running.
pub struct Viewer<'d> {
    display: &'d Display,
    child: Child,
    lines: Receiver<(Instant, String)>,
    heard: Vec<String>,
    window: String,
}

impl Viewer<'_> {
    /// Runs xdotool.
    pub fn xdotool(&self, arguments: &[&str]) -> String {
        let output = self.display.tool("xdotool").args(arguments).output().unwrap();
        String::from_utf8(output.stdout).unwrap()
    }

    /// Presses keys one after the other.
    pub fn keys(&self, keys: &[&str]) {
        self.xdotool(&[&["key"], keys].concat());
    }

    /// Clicks somewhere in the window.
    pub fn click(&self, x: i32, y: i32) {
        let [x, y] = [x, y].map(|n| n.to_string());
        self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "click", "1"]);
    }

    /// Drags from one place to another, in steps.
    pub fn drag(&self, button: &str, from: [i32; 2], to: [i32; 2]) {
        let at = |share: i32| [0, 1].map(|i| (from[i] + (to[i] - from[i]) * share / 8).to_string());
        let [x, y] = at(0);
        self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "mousedown", button]);
        for step in 1..=8 {
            let [x, y] = at(step);
            self.xdotool(&["mousemove", "--window", &self.window, &x, &y, "sleep", "0.02"]);
        }
        self.xdotool(&["mouseup", button]);
    }

    /// Drops a file on the window.
    pub fn drop_file(&self, path: &Path) {
        drop_file(&self.display.name, self.window.parse().unwrap(), path);
    }

    /// Gives the window another size.
    pub fn resize(&self, width: u32, height: u32) {
        self.xdotool(&["windowsize", &self.window, &width.to_string(), &height.to_string()]);
    }

    /// Takes the window off the display, or puts it back.
    pub fn show(&self, shown: bool) {
        self.xdotool(&[if shown { "windowmap" } else { "windowunmap" }, &self.window]);
        if shown {
            self.xdotool(&["windowfocus", &self.window]);
        }
    }

    /// Waits for a line of the log, and says when it came.
    pub fn wait_for(&mut self, part: &str) -> (Instant, String) {
        let began = Instant::now();
        loop {
            match self.lines.recv_timeout(PATIENCE.saturating_sub(began.elapsed())) {
                Ok((at, line)) => {
                    self.heard.push(line.clone());
                    if line.contains(part) {
                        return (at, line);
                    }
                }
                Err(e) => panic!("`{part}` does not come ({e}):\n{}", self.heard.join("\n")),
            }
        }
    }

    /// Reads the log for some time.
    pub fn listen(&mut self, time: Duration) {
        let began = Instant::now();
        loop {
            match self.lines.recv_timeout(time.saturating_sub(began.elapsed())) {
                Ok((_, line)) => self.heard.push(line),
                Err(RecvTimeoutError::Timeout) => return,
                Err(e) => panic!("the viewer has ended ({e}):\n{}", self.heard.join("\n")),
            }
        }
    }

    /// Lines of the log so far that have a part.
    pub fn heard<'a>(&'a self, part: &'a str) -> impl Iterator<Item = &'a String> {
        self.heard.iter().filter(move |line| line.contains(part))
    }

    /// The window's title.
    pub fn title(&self) -> String {
        self.xdotool(&["getwindowname", &self.window])
    }

    /// Takes a screenshot of the window.
    pub fn look(&self) -> RgbImage {
        let output = self.display.tool("xwd").args(["-silent", "-id", &self.window]).output().unwrap();
        from_xwd(&output.stdout)
    }

    /// Megabytes of memory that the program holds.
    pub fn megabytes(&self) -> f64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find(|line| line.starts_with("VmRSS")).unwrap();
        line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() / 1024.0
    }

    /// True if it still runs, and printed only the usual messages of a display without a desktop.
    pub fn is_well(&mut self) {
        assert!(self.child.try_wait().unwrap().is_none(), "it has ended:\n{}", self.heard.join("\n"));
        let usual = ["winit::", "unable to find layer", "InstanceFlags::VALIDATION", "opened anew"];
        let amiss = |line: &&String| {
            let loud = ["[WARN", "[ERROR", "panicked", "VALIDATION"].iter().any(|part| line.contains(part));
            loud && !usual.iter().any(|part| line.contains(part))
        };
        let amiss: Vec<_> = self.heard.iter().filter(amiss).collect();
        assert!(amiss.is_empty(), "{amiss:#?}");
    }
}

impl Drop for Viewer<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The picture of an X window dump (XWDFile.h): 32 bits a pixel, blue first.
fn from_xwd(dump: &[u8]) -> RgbImage {
    let word = |n: usize| u32::from_be_bytes(dump[4 * n..4 * n + 4].try_into().unwrap()) as usize;
    let (header, width, height, bits, stride, colors) = (word(0), word(4), word(5), word(11), word(12), word(19));
    assert_eq!(bits, 32);
    let pixels = &dump[header + 12 * colors..];
    RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let at = y as usize * stride + 4 * x as usize;
        Rgb([pixels[at + 2], pixels[at + 1], pixels[at]])
    })
}
