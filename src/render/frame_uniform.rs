//! The uniform that the passes of an iteration share: camera and random numbers
//! (shaders/lib/scene/frame.wesl).

use glam::{Mat4, Vec2, Vec3, Vec4};

use crate::render::layouts;
use crate::render::sampler::{Decision, Sampler};
use crate::render::upload::gpu_scene::GpuScene;
use crate::scene::{Camera, Projection};
use crate::settings::Settings;

/// Returns the uniform of an iteration.
#[must_use]
pub fn frame_uniform(
    scene: &GpuScene,
    camera: &Camera,
    settings: &Settings,
    sampler: &Sampler,
    iteration: u64,
    batch_index: u32,
) -> layouts::FrameUniform {
    let size = [settings.width, settings.height];
    let jitter = sampler.get2(Decision::Pixel);
    let on_lens = lens_point(camera, sampler);
    let mut out = layouts::FrameUniform {
        clip_from_world: clip_from_world(scene, camera, size, jitter, on_lens).to_cols_array_2d(),
        samples: (iteration + 1) as f32 / settings.samples_per_lobe(),
        number: iteration as u32,
        seed: settings.seed,
        jitter,
        iteration: batch_index,
        ..camera_uniform(camera, settings)
    };
    if let Some((shift, focus)) = on_lens {
        // The camera moves to the point on the lens; points in the plane of focus keep their pixel.
        let [position, forward] = [out.camera_position, out.camera_forward].map(Vec3::from);
        let shift = camera.world_from_camera.transform_vector3(shift.extend(0.0));
        out.camera_position = (position + shift).to_array();
        out.camera_forward = (forward - shift / focus).to_array();
    }
    out
}

/// Returns the part of the uniform that is the same in all iterations: the camera, and the exponent of the
/// power heuristic.
#[must_use]
pub fn camera_uniform(camera: &Camera, settings: &Settings) -> layouts::FrameUniform {
    let half = camera.half_extent(settings.width, settings.height);
    let world_from_camera = camera.world_from_camera;
    let [right, up, forward] =
        [Vec3::X * half.x, Vec3::Y * half.y, Vec3::NEG_Z].map(|v| world_from_camera.transform_vector3(v));
    layouts::FrameUniform {
        camera_position: Vec3::from(world_from_camera.translation).to_array(),
        orthographic: u32::from(matches!(camera.projection, Projection::Orthographic { .. })),
        camera_right: right.to_array(),
        width: settings.width,
        camera_up: up.to_array(),
        height: settings.height,
        camera_forward: forward.to_array(),
        beta: settings.beta(),
        bounces: settings.bounces,
        specular_bounces: settings.specular_bounces,
        ..Default::default()
    }
}

/// Samples the point on a thin lens that all pixels of an iteration share, in metres from the camera's axis,
/// and returns it with the distance of the plane of focus in metres. None without a lens.
fn lens_point(camera: &Camera, sampler: &Sampler) -> Option<(Vec2, f32)> {
    let lens = camera.lens.filter(|l| l.radius > 0.0 && matches!(camera.projection, Projection::Perspective { .. }))?;
    let [u, v] = sampler.get2(Decision::Lens);
    Some((Vec2::from_angle(std::f32::consts::TAU * v) * (u.sqrt() * lens.radius), lens.focus))
}

/// Returns the transform to clip space with reversed depth, offset so that pixel centres are the iteration's
/// sample positions.
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
        // A translation to the point on the lens, then a shear that leaves the plane of focus unchanged.
        let shear = Mat4::from_cols(Vec4::X, Vec4::Y, (-shift / focus).extend(1.0).extend(0.0), Vec4::W);
        camera_from_world = shear * Mat4::from_translation(-shift.extend(0.0)) * camera_from_world;
    }
    let clip_from_camera = match camera.projection {
        // The far plane is at infinity. With reversed floating-point depth a close near plane costs no
        // precision.
        Projection::Perspective { .. } => {
            let near = 1e-7 * radius;
            Mat4::from_cols_array_2d(&[
                [1.0 / half.x, 0.0, 0.0, 0.0],
                [0.0, 1.0 / half.y, 0.0, 0.0],
                [0.0, 0.0, 0.0, -1.0],
                [0.0, 0.0, near, 0.0],
            ])
        }
        // The depth range extends from the camera to the far side of the scene.
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
