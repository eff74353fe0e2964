//! Compares two methods with the CPU reference on one scene: cargo run --example two_methods -- [FILE]

use std::error::Error;

use lightsheaf::gpu::Gpu;
use lightsheaf::metrics;
use lightsheaf::reference::{Reference, ReferenceSettings};
use lightsheaf::render;
use lightsheaf::settings::{Settings, Technique};
use lightsheaf::staging::{self, Staging};

fn main() -> Result<(), Box<dyn Error>> {
    let file = std::env::args().nth(1).unwrap_or_else(|| "builtin:cornell_point".to_owned());
    let scene = staging::load(&file, &Staging::default())?;

    // The CPU path tracer shares no estimator code with the renderers on the device.
    let [width, height] = [64, 64];
    let reference =
        ReferenceSettings { width, height, samples: 256, bounces: Some(2), specular_bounces: 8, seed: 7, camera: 0 };
    let truth = Reference::new(&scene).render(&reference, &|_, _| ()).film;

    let gpu = Gpu::new()?;
    for technique in [Technique::RASTER, Technique::FAST] {
        // In plain settings all pixels share one light subpath, and iterations are averaged without a filter.
        let settings = Settings { technique, width, height, bounces: 2, ..Settings::plain() };
        let mut renderer = render::open(&gpu, &scene, &settings)?;
        for samples in [16, 48] {
            renderer.render(samples, &mut |_| true)?;
            let error = metrics::compare(&renderer.film()?, &truth)?;
            println!("{technique:<12} {:>3} samples  rel_mse {:.4}", renderer.samples(), error.rel_mse);
        }
    }
    Ok(())
}
