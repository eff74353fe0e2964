//! Renders a scene file to a picture: cargo run --example render_file -- [FILE [PICTURE.png]]
//!
//! FILE is glTF, Mitsuba XML or builtin:NAME. Camera and light are added if the file has none.

use std::error::Error;

use lightsheaf::exposure::{Backdrop, auto_exposure};
use lightsheaf::gpu::Gpu;
use lightsheaf::render;
use lightsheaf::settings::Settings;
use lightsheaf::staging::{self, Staging};
use lightsheaf::tonemap::{Grade, Tonemap};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or_else(|| "builtin:cornell_glossy".to_owned());
    let picture = arguments.next().unwrap_or_else(|| "render_file.png".to_owned());

    let settings = Settings { width: 256, height: 256, ..Settings::default() };
    let staging = Staging { size: [settings.width, settings.height], ..Staging::default() };
    let scene = staging::load(&file, &staging)?;

    let gpu = Gpu::new()?;
    let mut renderer = render::open(&gpu, &scene, &settings)?;
    for warning in renderer.warnings() {
        eprintln!("warning: {warning}");
    }
    // The callback receives the number of samples. Returning false ends the render.
    renderer.render(32, &mut |_samples| true)?;

    let film = renderer.film()?;
    let backdrop = Backdrop::new(&scene, &scene.cameras[0], [settings.width, settings.height], None);
    let stops = auto_exposure(&film, backdrop.as_ref());
    film.save_graded(&picture, &Grade { stops, tonemap: Tonemap::Agx })?;
    println!("{picture}: {} samples on {}", renderer.samples(), gpu.capabilities.adapter);
    Ok(())
}
