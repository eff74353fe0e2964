//! What one iteration shares between its passes (shaders/lib/frame.wesl): camera, light, random numbers.

use glam::{Mat4, Vec2, Vec3, Vec4};

use crate::gpu_scene::GpuScene;
use crate::layouts;
use crate::sampler::{Decision, Sampler};
use crate::scene::{Camera, Projection};
use crate::settings::Settings;

/// The uniform of one iteration.
#[must_use]
pub fn describe(
    scene: &GpuScene,
    camera: &Camera,
    settings: &Settings,
    sampler: &Sampler,
    iteration: u64,
    batch_index: u32,
) -> layouts::Frame {
    let size = [settings.width, settings.height];
    let jitter = sampler.get2(Decision::Pixel);
    let on_lens = lens_point(camera, sampler);
    let mut out = layouts::Frame {
        clip_from_world: clip_from_world(scene, camera, size, jitter, on_lens).to_cols_array_2d(),
        samples: (iteration + 1) as f32 / settings.clamp_samples,
        jitter,
        iteration: batch_index,
        ..describe_camera(camera, settings)
    };
    if let Some((shift, focus)) = on_lens {
        // Seen from the point of the lens, what is in focus stays where it is.
        let [position, forward] = [out.camera_position, out.camera_forward].map(Vec3::from);
        let shift = camera.world_from_camera.transform_vector3(shift.extend(0.0));
        out.camera_position = (position + shift).to_array();
        out.camera_forward = (forward - shift / focus).to_array();
    }
    out
}

/// The part of the uniform that no iteration changes: the camera, and the exponent of MIS.
#[must_use]
pub fn describe_camera(camera: &Camera, settings: &Settings) -> layouts::Frame {
    let half = camera.half_extent(settings.width, settings.height);
    let world_from_camera = camera.world_from_camera;
    let [right, up, forward] =
        [Vec3::X * half.x, Vec3::Y * half.y, Vec3::NEG_Z].map(|v| world_from_camera.transform_vector3(v));
    layouts::Frame {
        camera_position: Vec3::from(world_from_camera.translation).to_array(),
        orthographic: u32::from(matches!(camera.projection, Projection::Orthographic { .. })),
        camera_right: right.to_array(),
        width: settings.width,
        camera_up: up.to_array(),
        height: settings.height,
        camera_forward: forward.to_array(),
        beta: settings.beta(),
        ..Default::default()
    }
}

/// The point of a thin lens that all pixels of an iteration look through, in metres across the camera's axis, and the distance of
/// what is in focus.
fn lens_point(camera: &Camera, sampler: &Sampler) -> Option<(Vec2, f32)> {
    let lens = camera.lens.filter(|l| l.radius > 0.0 && matches!(camera.projection, Projection::Perspective { .. }))?;
    let [u, v] = sampler.get2(Decision::Lens);
    Some((Vec2::from_angle(std::f32::consts::TAU * v) * (u.sqrt() * lens.radius), lens.focus))
}

/// Clip space with reversed depth, moved so that pixel centres are the iteration's sample positions.
fn clip_from_world(
    scene: &GpuScene,
    camera: &Camera,
    size: [u32; 2],
    jitter: [f32; 2],
    on_lens: Option<(Vec2, f32)>,
) -> Mat4 {
    let half = camera.half_extent(size[0], size[1]);
    let (center, radius) = scene.sphere();
    let mut camera_from_world = Mat4::from(camera.world_from_camera.inverse());
    if let Some((shift, focus)) = on_lens {
        // To the point of the lens, then sheared so that what is in focus does not move.
        let shear = Mat4::from_cols(Vec4::X, Vec4::Y, (-shift / focus).extend(1.0).extend(0.0), Vec4::W);
        camera_from_world = shear * Mat4::from_translation(-shift.extend(0.0)) * camera_from_world;
    }
    let clip_from_camera = match camera.projection {
        // Infinite far plane; the near one as close as depth precision does not care about.
        Projection::Perspective { .. } => {
            let near = 1e-4 * radius;
            Mat4::from_cols_array_2d(&[
                [1.0 / half.x, 0.0, 0.0, 0.0],
                [0.0, 1.0 / half.y, 0.0, 0.0],
                [0.0, 0.0, 0.0, -1.0],
                [0.0, 0.0, near, 0.0],
            ])
        }
        // In front of the camera, up to the far side of the scene.
        Projection::Orthographic { .. } => {
            let far = camera_from_world.transform_point3(center).length() + 2.0 * radius;
            Mat4::from_cols_array_2d(&[
                [1.0 / half.x, 0.0, 0.0, 0.0],
                [0.0, 1.0 / half.y, 0.0, 0.0],
                [0.0, 0.0, 1.0 / far, 0.0],
                [0.0, 0.0, 1.0, 1.0],
            ])
        }
    };
    let shift = Vec3::new((1.0 - 2.0 * jitter[0]) / size[0] as f32, (2.0 * jitter[1] - 1.0) / size[1] as f32, 0.0);
    Mat4::from_translation(shift) * clip_from_camera * camera_from_world
}
