//! Renders frames of an animated scene with one renderer: cargo run --example animation -- [FILE [FOLDER]]

use std::error::Error;
use std::path::PathBuf;

use lightsheaf::exposure::{Backdrop, auto_exposure};
use lightsheaf::gpu::Gpu;
use lightsheaf::render::{self, Renderer};
use lightsheaf::settings::Settings;
use lightsheaf::staging::{self, Staging};
use lightsheaf::tonemap::{Grade, Tonemap};

const FRAMES: u32 = 4;
const FRAMES_PER_SECOND: f32 = 4.0;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or_else(|| "builtin:sea".to_owned());
    let folder = PathBuf::from(arguments.next().unwrap_or_else(|| "frames".to_owned()));
    std::fs::create_dir_all(&folder)?;

    let settings = Settings { width: 192, height: 108, ..Settings::default() };
    let staging = Staging { size: [settings.width, settings.height], ..Staging::default() };
    let at_rest = staging::load(&file, &staging)?;
    let gpu = Gpu::new()?;
    let mut renderer: Option<Box<dyn Renderer>> = None;
    for frame in 0..FRAMES {
        // `at` takes the index of the animation and the time in seconds.
        let pose = at_rest.at(0, frame as f32 / FRAMES_PER_SECOND)?;
        let renderer = match &mut renderer {
            Some(renderer) => {
                // The renderer keeps its pipelines and buffers.
                renderer.pose(&pose)?;
                renderer
            }
            None => renderer.insert(render::open(&gpu, &pose, &settings)?),
        };
        renderer.render(16, &mut |_| true)?;
        let film = renderer.film()?;
        let picture = folder.join(format!("frame_{frame:04}.png"));
        let backdrop = Backdrop::new(&pose, &pose.cameras[0], [settings.width, settings.height], None);
        let stops = auto_exposure(&film, backdrop.as_ref());
        film.save_graded(&picture, &Grade { stops, tonemap: Tonemap::Agx })?;
        println!("{}", picture.display());
    }
    Ok(())
}
