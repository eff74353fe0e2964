//! What one iteration shares between its passes (shaders/lib/frame.wesl): camera, light, random numbers.

use glam::{Mat4, Vec3};

use crate::gpu_scene::GpuScene;
use crate::layouts;
use crate::lights::{ChosenLight, Lights};
use crate::sampler::{Decision, Sampler};
use crate::scene::{Camera, Projection};
use crate::settings::Settings;

/// The uniform of one iteration.
#[must_use]
pub fn describe(
    scene: &GpuScene,
    camera: &Camera,
    lights: &Lights,
    light: Option<&ChosenLight>,
    settings: &Settings,
    sampler: &Sampler,
    iteration: u64,
    batch_index: u32,
) -> layouts::Frame {
    let size = [settings.width, settings.height];
    let jitter = sampler.get2(Decision::Pixel);
    let mut out = layouts::Frame {
        clip_from_world: clip_from_world(scene, camera, size, jitter).to_cols_array_2d(),
        samples: (iteration + 1) as f32,
        jitter,
        y2_random: sampler.get2(Decision::Y2),
        iteration: batch_index,
        ..describe_camera_and_sky(scene, camera, settings)
    };
    if let Some(light) = light {
        out.light_kind = light.kind;
        out.light_pdf_w = light.pdf;
        out.light_position = light.position.to_array();
        out.light_direction = light.direction.to_array();
        out.light_intensity = light.intensity.to_array();
        [out.light_cos_inner, out.light_cos_outer] = light.cosines;
        out.light_falloff = light.falloff;
        out.sample_direction = lights.sample_direction(light, sampler.get2(Decision::Y1)).to_array();
        out.sample_pdf = light.pdf;
    }
    out
}

/// The part of the uniform that no iteration changes: camera, environment, and the exponent of MIS.
#[must_use]
pub fn describe_camera_and_sky(scene: &GpuScene, camera: &Camera, settings: &Settings) -> layouts::Frame {
    let half = camera.half_extent(settings.width, settings.height);
    let world_from_camera = camera.world_from_camera;
    let [right, up, forward] =
        [Vec3::X * half.x, Vec3::Y * half.y, Vec3::NEG_Z].map(|v| world_from_camera.transform_vector3(v));
    let environment = scene.environment;
    let columns = environment.map_or(glam::Mat3::IDENTITY, |e| e.environment_from_world).to_cols_array_2d();
    layouts::Frame {
        camera_position: Vec3::from(world_from_camera.translation).to_array(),
        orthographic: u32::from(matches!(camera.projection, Projection::Orthographic { .. })),
        camera_right: right.to_array(),
        width: settings.width,
        camera_up: up.to_array(),
        height: settings.height,
        camera_forward: forward.to_array(),
        light_kind: 3,
        environment: environment.map_or([0.0; 3], |e| e.radiance.to_array()),
        environment_rows_at_poles: u32::from(environment.is_some_and(|e| e.rows_at_poles)),
        environment_from_world: columns.map(|[x, y, z]| [x, y, z, 0.0]),
        beta: settings.beta(),
        ..Default::default()
    }
}

/// Clip space with reversed depth, moved so that pixel centres are the iteration's sample positions.
fn clip_from_world(scene: &GpuScene, camera: &Camera, size: [u32; 2], jitter: [f32; 2]) -> Mat4 {
    let half = camera.half_extent(size[0], size[1]);
    let (center, radius) = scene.sphere();
    let camera_from_world = Mat4::from(camera.world_from_camera.inverse());
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
