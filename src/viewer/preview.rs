//! A first look at a scene while its renderer is set up, which takes long where a driver has to compile shaders.

use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use glam::Vec3;

use super::outbox::SharedOutbox;
use super::render_thread::PaneView;
use super::request::{Layer, Picture};
use crate::film::Film;
use crate::reference::{Features, Reference, ReferenceSettings};
use crate::render::RenderStats;

/// Time after which setting up a renderer takes long.
const LONG: Duration = Duration::from_millis(700);

/// Sets up a pane's renderer and renders its first batch. If that takes long, a preview is left in the outbox meanwhile.
pub(super) fn meanwhile<T>(outbox: &SharedOutbox, view: &PaneView, render: impl FnOnce() -> T) -> T {
    thread::scope(|scope| {
        let (rendered, rendering) = channel::<()>();
        scope.spawn(move || {
            if rendering.recv_timeout(LONG) == Err(RecvTimeoutError::Timeout) {
                // The usual threads are busy with shaders.
                let threads = rayon::ThreadPoolBuilder::new().build();
                let preview = threads.map(|threads| threads.install(|| preview(view)));
                outbox.add(|outbox| outbox.previews[view.pane] = preview.ok());
            }
        });
        let result = render();
        drop(rendered);
        result
    })
}

/// Returns the colours of surfaces, which are darker where they turn away from the camera: one ray per pixel, on the CPU.
fn preview(view: &PaneView) -> Picture {
    let mut reference = Reference::new(view.scene);
    reference.look(view.camera.clone());
    let Features { normal, albedo, .. } = reference.features(&ReferenceSettings::of(&view.settings));
    let back = Vec3::from(view.camera.world_from_camera.z_axis);
    let shade = |(color, normal): (&[f32; 3], &[f32; 3])| {
        (Vec3::from(*color) * (0.4 + 0.6 * back.dot(Vec3::from(*normal)).abs())).to_array()
    };
    let film = Film { pixels: albedo.pixels.iter().zip(&normal.pixels).map(shade).collect(), ..albedo };
    Picture {
        request: view.request,
        film: Arc::new(film),
        layer: Layer::Albedo,
        auto_stops: None,
        coarseness: view.coarseness,
        stats: RenderStats::default(),
        batch: (0, 0.0),
        plan: "A preview, by one ray through the middle of each pixel on the CPU: the renderer is being set up.".into(),
        vpls: Vec::new(),
        error: None,
        finished: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;
    use crate::settings::Settings;

    #[test]
    fn what_takes_long_has_a_preview_meanwhile() {
        let scene = builtin::load("cornell_point").unwrap();
        let view = PaneView {
            request: 7,
            pane: 1,
            layer: Layer::Light,
            moving: false,
            coarseness: 2,
            settings: Settings { width: 40, height: 30, ..Settings::default() },
            posed_scene: 1,
            scene: &scene,
            grey_card: 0.0,
            camera: scene.cameras[0].clone(),
        };
        let outbox = SharedOutbox::new(|| ());
        assert_eq!(meanwhile(&outbox, &view, || 3), 3);
        assert!(outbox.take().previews.iter().all(Option::is_none));

        meanwhile(&outbox, &view, || thread::sleep(2 * LONG));
        let [None, Some(preview)] = outbox.take().previews else { panic!("no preview, or that of another pane") };
        assert_eq!((preview.request, preview.film.width, preview.film.height), (7, 40, 30));
        // Red on the left, green on the right, as the walls are.
        let at = |x: usize, y: usize| Vec3::from(preview.film.pixels[y * 40 + x]);
        let (left, right) = (at(5, 15), at(34, 15));
        assert!(left.x > 2.0 * left.y && right.y > 2.0 * right.x, "{left} {right}");
    }
}
