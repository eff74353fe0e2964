//! A browser without a window, and the pages that it is served.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tiny_http::{Header, Method, Response, Server};

use super::folder::Folder;
use super::skip;

/// Time after which a page that has not posted all is given up.
const PATIENCE: Duration = Duration::from_secs(180);

/// Files by path, without the leading `/`.
pub type Site = BTreeMap<String, Vec<u8>>;

/// A browser with WebGPU on the CPU.
pub struct Browser(PathBuf);

impl Browser {
    /// Finds one. Without one, the test is skipped.
    pub fn find() -> Option<Self> {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let folders: Vec<_> = std::env::split_paths(&path).collect();
        let names = ["chromium", "chromium-browser", "google-chrome"];
        let found = names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
        let found = found.into_iter().find(|program| program.is_file());
        if found.is_none() {
            skip("REQUIRE_BROWSER", "there is no Chromium: scripts/setup.sh --tests installs it");
        }
        found.map(Self)
    }

    /// Opens a page, and returns what it posts, as often as `posts` says. Panics if it posts an error, which has
    /// the header `X-Error`, or takes too long.
    pub fn visit(&self, site: &Site, page: &str, posts: usize) -> Vec<Vec<u8>> {
        let server = Server::http("127.0.0.1:0").unwrap();
        let address = format!("http://localhost:{}/{page}", server.server_addr().to_ip().unwrap().port());
        let profile = Folder::new("browser");
        let log = std::fs::File::create(profile.0.join("log")).unwrap();
        let mut browser = Command::new(&self.0)
            .args(["--headless=new", "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"])
            // A test has no other hosts to reach, and no sandbox of the kernel in a container.
            .args(["--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update"])
            .args(["--disable-sync", "--disable-extensions", "--enable-logging=stderr"])
            .arg(format!("--user-data-dir={}", profile.0.join("profile").display()))
            .arg(&address)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .unwrap();
        let began = Instant::now();
        let mut posted = Vec::new();
        let mut wrong = None;
        while posted.len() < posts && wrong.is_none() {
            let left = PATIENCE.saturating_sub(began.elapsed());
            match server.recv_timeout(left).unwrap() {
                Some(request) => match answer(site, request) {
                    Some(Ok(body)) => posted.push(body),
                    Some(Err(error)) => wrong = Some(error),
                    None => {}
                },
                None => wrong = Some(format!("{} of {posts} answers came in {PATIENCE:?}", posted.len())),
            }
        }
        let _ = browser.kill();
        let _ = browser.wait();
        if let Some(wrong) = wrong {
            let log = profile.read("log");
            let console: Vec<_> = log.lines().filter(|line| line.contains("CONSOLE")).take(20).collect();
            panic!("{page}: {wrong}\n{}", console.join("\n"));
        }
        posted
    }
}

/// Answers a request; returns the body of a POST, as an error if it is one.
fn answer(site: &Site, mut request: tiny_http::Request) -> Option<Result<Vec<u8>, String>> {
    let mut posted = None;
    if *request.method() == Method::Post {
        let mut body = Vec::new();
        request.as_reader().read_to_end(&mut body).unwrap();
        let is_error = request.headers().iter().any(|header| header.field.equiv("X-Error"));
        posted = Some(if is_error { Err(String::from_utf8_lossy(&body).into_owned()) } else { Ok(body) });
    }
    let path = request.url().split('?').next().unwrap_or_default().trim_start_matches('/').to_owned();
    // A browser that has gone away meanwhile is no error.
    let _ = match site.get(&path) {
        _ if posted.is_some() => request.respond(Response::empty(204)),
        Some(bytes) => request.respond(Response::from_data(bytes.as_slice()).with_header(content_type(&path))),
        None => request.respond(Response::empty(404)),
    };
    posted
}

fn content_type(path: &str) -> Header {
    let value = match path.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    Header::from_bytes("Content-Type", value).unwrap()
}
