//! Changes that must not change a picture of `raster`, changes that must, and degenerate scenes.

use crate::common;

use common::scenes::{add, emitter, floor, pinhole, quad};
use common::{gpu, raster};
use glam::{Mat3, Vec3};
use lightsheaf::film::Film;
use lightsheaf::metrics::compare;
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::scene::{Environment, Light, Material, Mesh, Scene, builtin};
use lightsheaf::settings::{LightSampling, RestirBias, Settings, Technique, VisibilityFrom};

fn settings(width: u32, height: u32, samples: u32) -> Settings {
    Settings { width, height, samples, ..Settings::plain() }
}

fn cornell() -> Scene {
    builtin::load("cornell_point").unwrap()
}

/// Returns the largest difference of two pictures over the second's mean, and the relative difference of
/// their means.
fn apart(a: &Film, b: &Film) -> [f64; 2] {
    let mean = b.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * b.pixels.len()) as f64;
    let pairs = a.pixels.iter().flatten().zip(b.pixels.iter().flatten());
    let most = pairs.map(|(x, y)| f64::from((x - y).abs())).fold(0.0, f64::max);
    [most / mean, compare(a, b).unwrap().mean_bias.abs()]
}

#[test]
fn a_seed_names_the_bytes() {
    let Some(gpu) = gpu() else { return };
    let of = |seed| raster(gpu, &cornell(), &Settings { seed, ..settings(32, 32, 12) }).0;
    let (one, again, two) = (of(1), of(1), of(2));
    assert!(one.pixels.as_ptr() != again.pixels.as_ptr());
    let bits = |film: &Film| film.pixels.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&one), bits(&again));
    assert_ne!(bits(&one), bits(&two));
    assert!(apart(&one, &two)[0] > 0.01, "another seed is another picture");
}

/// The division of an image into bands changes nothing, in scenes with one light point, with candidates and
/// with reuse.
#[test]
fn bands_leave_the_picture_as_it_is() {
    let Some(gpu) = gpu() else { return };
    // Only the sums over the image that lights are chosen by depend on the order of bands, by rounding.
    for (name, sampling) in [
        ("cornell_glossy", None),
        ("point_hall:40", Some(LightSampling::Power)),
        // The lights are in few clusters, so that they are chosen by power.
        ("cornell_area", Some(LightSampling::Restir)),
    ] {
        let scene = builtin::load(name).unwrap();
        let of = |band_pixels, seed| {
            let settings =
                Settings { band_pixels, seed, light_pool: Some(3), light_sampling: sampling, ..settings(40, 33, 4) };
            let bands = SharedRenderer::new(gpu, &scene, &settings).unwrap().plan().grid.count_bands()[0];
            let (film, _) = raster(gpu, &scene, &settings);
            (film.pixels.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>(), bands)
        };
        let (whole, one) = of(None, 1);
        assert_eq!(one, 1);
        // Bands have two rows, with one row in the last band, or one row, since no band is narrower.
        for (pixels, bands) in [(80, 17), (1, 33)] {
            let cut = of(Some(pixels), 1);
            assert_eq!(cut.1, bands);
            assert!(cut.0 == whole, "{name}: bands of {pixels} pixels");
        }
        assert_ne!(of(None, 2).0, whole, "another seed is another picture");
    }
}

/// In exact mode resolutions only change the speed: the mean is within 0.1 %, and so are nine pixels of ten,
/// relative to the mean.
#[test]
fn resolution_does_not_change_an_exact_picture() {
    let Some(gpu) = gpu() else { return };
    let of = |bundle, light, vpl| {
        let settings = Settings {
            bundle_resolution: Some(bundle),
            light_resolution: Some(light),
            vpl_resolution: Some(vpl),
            ..settings(32, 32, 16)
        };
        raster(gpu, &cornell(), &settings).0
    };
    let expected = of(128, 128, 128);
    for [bundle, light, vpl] in [[64, 64, 64], [256, 256, 256], [512, 512, 512], [64, 512, 256], [512, 64, 64]] {
        let film = of(bundle, light, vpl);
        let [most, mean] = apart(&film, &expected);
        println!("bundle {bundle}, light {light}, vpl {vpl}: at most {most:.1e}, mean {mean:.1e}");
        assert!(mean < 1e-3 && most < 1e-3, "bundle {bundle}, light {light}, vpl {vpl}: {most}, mean {mean}");
    }
    // Canary: the picture of the fast mode depends on them.
    let fast = |resolution| {
        let settings = Settings {
            technique: Technique::FAST,
            bundle_resolution: Some(resolution),
            light_resolution: Some(resolution),
            vpl_resolution: Some(resolution),
            ..settings(32, 32, 16)
        };
        raster(gpu, &cornell(), &settings).0
    };
    let [most, _] = apart(&fast(64), &fast(256));
    assert!(most > 1e-3, "{most}");
}

/// The hardware snaps corners to its subpixel grid. The exact camera ray then selects among the triangles at and
/// around a pixel, so that silhouettes are those of traced rays.
#[test]
fn silhouettes_of_the_rasterizer_are_those_of_rays() {
    let Some(gpu) = gpu() else { return };
    for name in ["cornell_point", "corner_spikes"] {
        let scene = builtin::load(name).unwrap();
        let of =
            |visibility_from, seed| raster(gpu, &scene, &Settings { visibility_from, seed, ..settings(96, 96, 4) }).0;
        let traced = of(VisibilityFrom::Grid, 1);
        let rasterized = compare(&of(VisibilityFrom::Lists, 1), &traced).unwrap();
        println!("{name}: rel_mse {:.1e}", rasterized.rel_mse);
        assert!(rasterized.rel_mse < 1e-10, "{name}: {}", rasterized.rel_mse);
        assert!(compare(&of(VisibilityFrom::Lists, 2), &traced).unwrap().rel_mse > 1e-4, "other seeds differ");
    }
}

/// The near plane cuts nothing: a card is seen from a millionth of the scene's radius.
#[test]
fn a_surface_right_before_the_camera_is_seen() {
    let Some(gpu) = gpu() else { return };
    for distance in [1e-3, 1e-4, 1e-6] {
        let mut scene = Scene { cameras: vec![pinhole(Vec3::ZERO, Vec3::NEG_Z, 1.0)], ..Scene::default() };
        let corner = Vec3::new(-2.0, -2.0, -1.0);
        let card = quad(corner * distance, Vec3::X * 4.0 * distance, Vec3::Y * 4.0 * distance);
        add(&mut scene, card, emitter(0.0, Vec3::ONE, true));
        add(&mut scene, floor(1.0, -0.5), Material::diffuse("floor", Vec3::splat(0.5)));
        let film = raster(gpu, &scene, &settings(16, 16, 1)).0;
        assert!(film.pixels.iter().all(|p| *p == [1.0; 3]), "from {distance}: {:?}", film.pixels[0]);
    }
}

#[test]
fn lists_without_room_grow_and_lose_nothing() {
    let Some(gpu) = gpu() else { return };
    for technique in [Technique::RASTER, Technique::FAST] {
        let of = |list_room| raster(gpu, &cornell(), &Settings { list_room, technique, ..settings(32, 32, 12) });
        let (tight, ample) = (of(0.001), of(16.0));
        assert!(tight.1.redone > 0, "nothing had to be redone: {:?}", tight.1);
        assert_eq!((tight.1.lost_nodes, ample.1.redone), (0, 0));
        // Sums in another order may round differently.
        let [most, _] = apart(&tight.0, &ample.0);
        assert!(most < 1e-5, "{technique}: {most}");
    }
}

/// Reuse reads the iteration before, for any division into batches, and after redone iterations.
#[test]
fn reuse_looks_back_at_the_same_iteration_wherever_lists_overflow() {
    let Some(gpu) = gpu() else { return };
    let scene = builtin::load("emitter_hall:100").unwrap();
    let of = |list_room, restir_bias| {
        let light_sampling = Some(LightSampling::Restir);
        let visibility_from = VisibilityFrom::Lists;
        let settings = Settings {
            list_room,
            light_sampling,
            restir_bias,
            light_pool: Some(4),
            visibility_from,
            ..settings(32, 32, 20)
        };
        // Later lists of this seed are longer as well.
        raster(gpu, &scene, &Settings { seed: 2, ..settings })
    };
    let (tight, ample) = (of(0.001, RestirBias::Unbiased), of(16.0, RestirBias::Unbiased));
    // The first iteration is alone, so that more than one is redone.
    assert!(tight.1.redone > 4, "too little had to be redone: {:?}", tight.1);
    assert_eq!((tight.1.lost_nodes, ample.1.redone), (0, 0));
    let [most, _] = apart(&tight.0, &ample.0);
    assert!(most < 1e-5, "{most}");
    let [most, _] = apart(&of(16.0, RestirBias::Biased).0, &ample.0);
    assert!(most > 0.01, "the biased variant is another picture: {most}");
    // A picture that goes on, or begins anew, equals one that is rendered at once.
    let settings = Settings { light_sampling: Some(LightSampling::Restir), ..settings(32, 32, 5) };
    let mut renderer = SharedRenderer::new(gpu, &scene, &settings).unwrap();
    renderer.render(5, &mut |_| true).unwrap();
    renderer.restart(settings.seed);
    let parts = [2, 3].map(|samples| common::picture(&mut renderer, samples));
    let whole = raster(gpu, &scene, &settings).0;
    assert!(parts[1].pixels == whole.pixels && parts[0].pixels != whole.pixels);
}

#[test]
fn values_that_are_not_finite_are_counted_and_kept() {
    let Some(gpu) = gpu() else { return };
    let mut scene = cornell();
    let settings = settings(16, 16, 4);
    assert_eq!(raster(gpu, &scene, &settings).1.non_finite, 0);
    scene.materials[0] = emitter(0.5, Vec3::new(1.0, f32::NAN, 1.0), true);
    let (film, stats) = raster(gpu, &scene, &settings);
    assert!(stats.non_finite > 0 && film.non_finite() > 0, "emission: {}", stats.non_finite);
    for value in [f32::NAN, f32::INFINITY] {
        let mut scene = cornell();
        scene.lights = vec![Light::Point { position: Vec3::Y * 1.5, intensity: Vec3::new(1.0, value, 1.0) }];
        let (film, stats) = raster(gpu, &scene, &settings);
        assert!(stats.non_finite > 0 && film.non_finite() > 0, "intensity {value}: {}", stats.non_finite);
    }
}

#[test]
fn scenes_and_sizes_at_the_edge() {
    let Some(gpu) = gpu() else { return };
    let camera = pinhole(Vec3::Y, Vec3::NEG_Z, 0.3);
    let lamp = Light::Point { position: Vec3::new(0.0, 2.0, -1.0), intensity: Vec3::ONE };
    let empty = Scene { cameras: vec![camera.clone()], lights: vec![lamp], ..Scene::default() };
    let sky = Environment { radiance: Vec3::new(0.1, 0.2, 0.3), map: None, world_from_environment: Mat3::IDENTITY };
    let mut triangle = empty.clone();
    let corners = vec![Vec3::new(-1.0, 0.0, -3.0), Vec3::new(1.0, 0.0, -3.0), Vec3::new(0.0, 2.0, -3.0)];
    let mesh = Mesh { positions: corners, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    add(&mut triangle, mesh, Material::diffuse("triangle", Vec3::splat(0.5)));
    let mut behind = empty.clone();
    add(&mut behind, quad(Vec3::new(-1.0, 0.0, 3.0), Vec3::X, Vec3::Y), Material::diffuse("behind", Vec3::ONE));
    let mut flat = triangle.clone();
    flat.meshes[0].positions[2] = Vec3::new(0.0, 0.0, -3.0);
    let mut unlit = triangle.clone();
    unlit.lights.clear();
    let under_sky = |scene: &Scene| Scene { environment: Some(sky.clone()), ..scene.clone() };
    let black = |p: &[f32; 3]| *p == [0.0; 3];
    for (width, height) in [(1, 1), (17, 5), (16, 16)] {
        for bounces in [0, 2] {
            for technique in [Technique::RASTER, Technique::FAST] {
                let of = |scene: &Scene| {
                    let settings = Settings { bounces, technique, ..settings(width, height, 3) };
                    let (film, stats) = raster(gpu, scene, &settings);
                    assert_eq!((film.pixels.len(), stats.non_finite), ((width * height) as usize, 0));
                    film
                };
                assert!(of(&empty).pixels.iter().all(black));
                assert!(of(&behind).pixels.iter().all(black), "what lies behind the camera is not seen");
                assert!(of(&flat).pixels.iter().all(black), "a triangle without area");
                assert!(of(&unlit).pixels.iter().all(black));
                assert!(of(&triangle).pixels.iter().any(|p| p[0] > 0.0), "{width}x{height}, {bounces}, {technique}");
                if bounces == 0 && technique == Technique::RASTER {
                    for p in of(&under_sky(&empty)).pixels {
                        assert!((Vec3::from(p) - sky.radiance).abs().max_element() < 1e-6, "{p:?}");
                    }
                }
            }
        }
    }
    // A scene without a camera is an error that says so.
    let none = Scene { cameras: Vec::new(), ..triangle };
    let error =
        lightsheaf::render::shared::SharedRenderer::new(gpu, &none, &settings(4, 4, 1)).err().map(|e| e.to_string());
    assert!(error.as_deref().is_some_and(|e| e.contains("camera")), "{error:?}");
    gpu.check().unwrap();
}

/// Pictures of all sizes show the same view: an odd size has the mean of an even one.
#[test]
fn sizes_that_no_workgroup_divides_show_the_whole_view() {
    let Some(gpu) = gpu() else { return };
    let mut scene = Scene { cameras: vec![pinhole(Vec3::Y, Vec3::NEG_Y, 0.6)], ..Scene::default() };
    add(&mut scene, floor(10.0, 0.0), Material::diffuse("floor", Vec3::ONE));
    scene.lights = vec![Light::Directional { direction: Vec3::NEG_Y, irradiance: Vec3::splat(std::f32::consts::PI) }];
    for (width, height) in [(1, 1), (17, 5), (9, 31), (33, 8)] {
        let (film, _) = raster(gpu, &scene, &Settings { bounces: 0, ..settings(width, height, 2) });
        assert!(film.pixels.iter().flatten().all(|v| (v - 1.0).abs() < 1e-5), "{width}x{height}");
    }
}

/// The visibility error of the fast mode on the Cornell box changes the mean by less than half a percent.
#[test]
fn fast_is_within_half_a_percent() {
    let Some(gpu) = gpu() else { return };
    let of = |technique| raster(gpu, &cornell(), &Settings { technique, ..settings(64, 64, 128) }).0;
    let bias = compare(&of(Technique::FAST), &of(Technique::RASTER)).unwrap().mean_bias;
    println!("fast against exact, the same random numbers: mean_bias {bias}");
    assert!(bias != 0.0 && bias.abs() < 0.005, "{bias}");
}
