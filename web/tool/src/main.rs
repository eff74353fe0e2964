//! Two steps of `scripts/web.sh`: `bind FILE.wasm FOLDER` writes the module and its JavaScript, and
//! `serve FOLDER PORT` serves the folder to this machine.

use std::path::Path;

use anyhow::{Context as _, bail};
use tiny_http::{Header, Response, Server};

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
        ["bind", module, folder] => bind(Path::new(module), Path::new(folder)),
        ["serve", folder, port] => serve(Path::new(folder), port.parse().context("the port is a number up to 65535")?),
        _ => bail!("there are `bind FILE.wasm FOLDER` and `serve FOLDER PORT`"),
    }
}

/// Writes the module as browsers load it, and the JavaScript that calls it. The crate that does so has the
/// version that the module was compiled with, since both are in one Cargo.lock.
fn bind(module: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut bindgen = wasm_bindgen_cli_support::Bindgen::new();
    bindgen
        .input_path(module)
        .web(true)?
        .typescript(false)
        .omit_default_module_path(false)
        .remove_name_section(true)
        .remove_producers_section(true);
    bindgen.generate(folder)
}

/// Serves the files of a folder until the program is stopped.
fn serve(folder: &Path, port: u16) -> anyhow::Result<()> {
    let root = folder.canonicalize().with_context(|| format!("{}: build it first", folder.display()))?;
    let failed = |cause| anyhow::anyhow!("port {port}: {cause}; choose another one: scripts/web.sh --port PORT");
    let server = Server::http(("127.0.0.1", port)).map_err(failed)?;
    println!("The page is at http://localhost:{port}/ (Ctrl-C ends it)");
    for request in server.incoming_requests() {
        let path = request.url().split(['?', '#']).next().unwrap_or_default().trim_start_matches('/');
        let path = root.join(if path.is_empty() { "index.html" } else { path });
        // A path that leads out of the folder is not there.
        let path = path.canonicalize().ok().filter(|path| path.starts_with(&root) && path.is_file());
        let answered = match path.and_then(|path| Some((mime(&path), std::fs::read(path).ok()?))) {
            Some((mime, bytes)) => request.respond(Response::from_data(bytes).with_header(mime)),
            None => request.respond(Response::empty(404)),
        };
        // A browser that goes away while it is answered is no error.
        drop(answered);
    }
    Ok(())
}

/// Returns the content type of a file; browsers compile a module while it arrives only under its own type.
fn mime(path: &Path) -> Header {
    let mime = match path.extension().and_then(|extension| extension.to_str()) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    };
    Header::from_bytes("Content-Type", mime).unwrap_or_else(|()| unreachable!("the types above are plain text"))
}
