//! Makes a scene without a file and renders it: cargo run --example scene_in_code -- [PICTURE.png]

use std::error::Error;

use glam::{Affine3A, Vec3};
use lightsheaf::exposure::auto_exposure;
use lightsheaf::gpu::Gpu;
use lightsheaf::render;
use lightsheaf::scene::model::shapes;
use lightsheaf::scene::{Bsdf, Camera, FovAxis, Instance, Light, Material, Projection, Scene};
use lightsheaf::settings::Settings;
use lightsheaf::tonemap::{Grade, Tonemap};

fn main() -> Result<(), Box<dyn Error>> {
    let picture = std::env::args().nth(1).unwrap_or_else(|| "scene_in_code.png".to_owned());

    // The scene is a diffuse floor and a rough copper sphere, in metres, +Y up.
    let copper = Bsdf::MetallicRoughness {
        base_color: Vec3::new(0.95, 0.64, 0.54).into(),
        metallic: 1.0.into(),
        roughness: 0.6.into(),
        ior: 1.5,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: 0.0.into(),
    };
    let mut scene = Scene {
        name: "floor and sphere".to_owned(),
        materials: vec![
            Material::diffuse("floor", Vec3::splat(0.6)),
            Material { bsdf: copper, ..Material::diffuse("copper", Vec3::ONE) },
        ],
        lights: vec![Light::Point { position: Vec3::new(1.5, 3.0, 2.0), intensity: Vec3::splat(20.0) }],
        ..Scene::default()
    };
    let mut floor = shapes::rectangle();
    floor.material = 0;
    let mut sphere = shapes::icosphere(4);
    sphere.material = 1;
    scene.meshes = vec![floor, sphere];
    let lie_down = Affine3A::from_rotation_x(-std::f32::consts::FRAC_PI_2) * Affine3A::from_scale(Vec3::splat(4.0));
    scene.instances = vec![
        Instance { mesh: 0, world_from_local: lie_down },
        Instance { mesh: 1, world_from_local: Affine3A::from_translation(Vec3::Y) },
    ];
    // A camera looks along its -Z axis; `looking` orients it.
    let camera = Camera {
        name: "camera".to_owned(),
        world_from_camera: Affine3A::IDENTITY,
        projection: Projection::Perspective { fov: 45_f32.to_radians(), axis: FovAxis::Smaller },
        lens: None,
        film_size: None,
    };
    scene.cameras = camera.looking(Vec3::new(0.0, 2.0, 5.0), Vec3::new(0.0, 0.8, 0.0)).into_iter().collect();

    let settings = Settings { width: 256, height: 256, ..Settings::default() };
    let gpu = Gpu::new()?;
    let mut renderer = render::open(&gpu, &scene, &settings)?;
    renderer.render(32, &mut |_| true)?;
    let film = renderer.film()?;
    film.save_graded(&picture, &Grade { stops: auto_exposure(&film, None), tonemap: Tonemap::Agx })?;
    println!("{picture}");
    Ok(())
}
