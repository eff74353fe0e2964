//! Lightsheaf in a web page: a [`Session`](session::Session) that page.js drives. `scripts/web.sh` builds it.
#![cfg(target_arch = "wasm32")]

mod session;

use wasm_bindgen::prelude::wasm_bindgen;

/// Sends panics and warnings to the browser's console.
#[wasm_bindgen(start)]
fn start() {
    console_error_panic_hook::set_once();
    // A page that starts twice has a logger already.
    let _ = console_log::init_with_level(log::Level::Warn);
}
