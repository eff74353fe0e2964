//! A feature that a scene does not need has no pass, no pipeline, no byte and no code: according to the plan,
//! and to the ledger of wgpu's calls.

mod common;

use std::collections::BTreeSet;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use common::scenes::{add, emitter, floor, pinhole, quad, room};
use common::{gpu, gpu_with_ray_queries};
use glam::{Mat3, Vec3};
use lightsheaf::film::Film;
use lightsheaf::gpu::{Counts, Flag, Gpu};
use lightsheaf::render::renderer::Renderer as _;
use lightsheaf::render::shared::SharedRenderer;
use lightsheaf::render::subpaths::PathRenderer;
use lightsheaf::scene::{
    Bsdf, Displacement, EdgeFactor, Environment, EnvironmentMap, Filter, Geometry, Height, Image, Lens, Light, Mapping,
    Material, Opacity, Pattern, Rows, Scene, SceneStats, Tessellation, Texture, TextureRef, Wave, Wrap, builtin,
};
use lightsheaf::settings::{LightSampling, Settings, Strategies, Technique, VisibilityFrom};

/// All tests share the device's ledger and the machine's time, so that they take turns.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The flags and runs that a render planned, and the calls that it made.
struct Asked {
    flags: Vec<Flag>,
    runs: Vec<(&'static str, u32)>,
    counts: Counts,
}

impl Asked {
    /// Returns the names of everything that was created, recorded or compiled.
    fn names(&self) -> BTreeSet<String> {
        let Counts { pipelines, functions, passes, buffers, textures, .. } = &self.counts;
        let labels = [pipelines.keys().collect::<Vec<_>>(), passes.keys().collect()].concat();
        let labels = labels.into_iter().map(|label| format!("pass {label}"));
        let memory = buffers.keys().chain(textures.keys()).map(|label| format!("memory {label}"));
        let code = functions.values().flatten().map(|name| format!("code {name}"));
        let flags = self.flags.iter().map(|flag| format!("flag {}", flag.name()));
        labels.chain(memory).chain(code).chain(flags).collect()
    }

    fn runs(&self, pass: &str) -> u32 {
        self.runs.iter().find(|(name, _)| *name == pass).unwrap().1
    }
}

/// Builds a renderer and renders some iterations.
fn ask(gpu: &Gpu, scene: &Scene, settings: &Settings, iterations: u64) -> Asked {
    gpu.ledger.reset();
    let listed =
        |passes: &[lightsheaf::render::planned_pass::PlannedPass]| passes.iter().map(|p| (p.name, p.runs)).collect();
    let (flags, runs) = if settings.technique.shares_subpaths() {
        let mut renderer = SharedRenderer::new(gpu, scene, settings).unwrap();
        renderer.render(iterations, &mut |_| true).unwrap();
        let plan = renderer.plan();
        ([plan.surface_flags.as_slice(), &plan.light_flags].concat(), listed(&plan.passes))
    } else {
        let mut renderer = PathRenderer::new(gpu, scene, settings).unwrap();
        renderer.render(iterations, &mut |_| true).unwrap();
        (renderer.plan().flags.clone(), listed(&renderer.plan().passes))
    };
    Asked { flags, runs, counts: gpu.ledger.counts() }
}

/// True for what rays replace where surfaces draw directions of their own.
fn replaced(name: &str, present: &BTreeSet<String>) -> bool {
    let by_rays = [
        "code bundle_direction",
        "code bundle_pdf",
        "code nearest_along",
        "code rasterized",
        "memory borders",
        "memory gbuffer",
        "memory gbuffer depth",
        "pass borders",
        "pass gbuffer",
    ];
    // Light passes glass on either side, so that no view is rasterized.
    let no_views = present.contains("flag TRANSMISSION") && !present.contains("pass view_setup");
    present.contains("flag SPECULAR") && (no_views || by_rays.contains(&name))
}

/// Of a small picture, in which views are rasterized: the plan would leave them to a grid.
fn settings(technique: Technique) -> Settings {
    let lists = technique == Technique::RASTER;
    let visibility_from = if lists { VisibilityFrom::Lists } else { VisibilityFrom::Auto };
    Settings { technique, width: 8, height: 8, visibility_from, ..Settings::plain() }
}

/// Returns a room of grey walls with a point light: the minimum that any picture needs.
fn plain() -> Scene {
    let mut scene = Scene { cameras: vec![pinhole(Vec3::new(0.2, 0.1, 0.8), Vec3::NEG_Z, 1.0)], ..Scene::default() };
    add(&mut scene, room(), Material::diffuse("room", Vec3::splat(0.5)));
    scene.lights = vec![Light::Point { position: Vec3::new(0.1, 0.7, -0.2), intensity: Vec3::ONE }];
    scene
}

fn with(change: impl FnOnce(&mut Scene)) -> Scene {
    let mut scene = plain();
    change(&mut scene);
    scene
}

fn metal(transmission: f32) -> Material {
    let bsdf = Bsdf::MetallicRoughness {
        base_color: Vec3::splat(0.5).into(),
        metallic: (1.0 - transmission).into(),
        roughness: 0.5.into(),
        ior: 1.5,
        specular: 1.0.into(),
        specular_color: Vec3::ONE.into(),
        transmission: transmission.into(),
    };
    Material { bsdf, ..Material::diffuse("metal", Vec3::ONE) }
}

fn textured(scene: &mut Scene) -> TextureRef {
    scene.images = vec![Image { name: String::new(), width: 2, height: 2, texels: vec![[200, 100, 50, 255]; 4] }];
    scene.textures = vec![Texture { image: 0, wrap: [Wrap::Repeat; 2], filter: Filter::Linear, srgb: true }];
    TextureRef::new(0)
}

fn refined(displacement: Option<Displacement>) -> lightsheaf::scene::Mesh {
    let mut mesh = shelf();
    Tessellation { factor: EdgeFactor::Fixed(2), phong: 0.75, displacement }.refine(&mut mesh);
    mesh
}

fn waves() -> Option<Displacement> {
    let height = Height::Waves(vec![Wave::on_water(Vec3::X, 1.0, 0.05)]);
    Some(Displacement { height, scale: 1.0, bias: 0.0 })
}

fn shelf() -> lightsheaf::scene::Mesh {
    quad(Vec3::new(-0.4, -0.5, 0.2), Vec3::X * 0.8, Vec3::NEG_Z * 0.8)
}

fn sky(map: bool) -> Environment {
    let map = map.then(|| EnvironmentMap { width: 4, height: 2, texels: vec![[1.0; 3]; 8], rows: Rows::Centred });
    Environment { radiance: Vec3::ONE, map, world_from_environment: Mat3::IDENTITY }
}

/// A feature with the names that exist with it and not without it, by raster and by ray queries.
struct Feature {
    name: &'static str,
    with: Scene,
    without: Scene,
    raster: &'static [&'static str],
    rays: &'static [&'static str],
}

fn features() -> Vec<Feature> {
    let lamp = |scene: &mut Scene| add(scene, floor(0.2, 0.9), emitter(0.5, Vec3::ONE, true));
    let feature = |name, with, raster, rays| Feature { name, with, without: plain(), raster, rays };
    vec![
        feature(
            "environment",
            with(|s| s.environment = Some(sky(false))),
            &["flag ENVIRONMENT", "code environment_radiance", "code sky_draw"],
            &["flag ENVIRONMENT", "code environment_radiance", "code sky_draw"],
        ),
        feature(
            "environment map",
            with(|s| s.environment = Some(sky(true))),
            &["flag ENVIRONMENT_MAP", "memory environment_map", "code sky_choice"],
            &["flag ENVIRONMENT_MAP", "memory environment_map", "code sky_choice"],
        ),
        feature(
            "area light",
            with(lamp),
            &["flag EMISSION", "code emitter_of", "code emitted_radiance", "code part_pdf"],
            &["flag EMISSION", "code emitter_of", "code emitted_radiance", "code part_pdf"],
        ),
        Feature {
            name: "punctual light",
            with: with(lamp),
            without: with(|s| {
                lamp(s);
                s.lights.clear();
            }),
            raster: &[
                "flag PUNCTUAL",
                "pass rsm",
                "memory rsm",
                "code spot_strength",
                "code spot_pdf",
                "code point_of_ball",
                "code square_of",
            ],
            rays: &["flag PUNCTUAL", "code spot_strength", "code spot_pdf", "code point_of_ball"],
        },
        Feature {
            name: "a surface that is lit",
            with: with(lamp),
            without: with(|s| {
                lamp(s);
                s.materials.iter_mut().for_each(|m| m.bsdf = Bsdf::Diffuse { reflectance: Vec3::ZERO.into() });
            }),
            raster: &[
                "pass light_point",
                "pass light_subpath",
                "pass connect_light",
                "pass connect_y1",
                "pass extend",
                "pass view_lists",
                "pass rsm",
                "memory rsm",
            ],
            rays: &[],
        },
        feature(
            "pattern of a light",
            with(|s| {
                let texels = vec![[1.0; 3]; 4];
                s.patterns =
                    vec![Pattern { name: String::new(), mapping: Mapping::Sphere, width: 2, height: 2, texels }];
                s.lights = vec![Light::Lamp(lightsheaf::scene::Lamp {
                    position: Vec3::new(0.1, 0.7, -0.2),
                    world_from_lamp: Mat3::IDENTITY,
                    radius: 0.0,
                    intensity: Vec3::ONE,
                    cone: None,
                    pattern: Some(0),
                })];
            }),
            &["flag PATTERNS", "code pattern_at", "code pattern_factor"],
            &["flag PATTERNS", "code pattern_at", "code pattern_factor"],
        ),
        feature(
            "glossy material",
            with(|s| add(s, shelf(), metal(0.0))),
            &["flag GLOSSY", "code ggx_d", "code glossy_eval", "code parts_of"],
            &["flag GLOSSY", "code ggx_d", "code glossy_eval", "code selection"],
        ),
        feature(
            "textures",
            with(|s| {
                let texture = Some(textured(s));
                let reflectance = lightsheaf::scene::Color { factor: Vec3::ONE, texture };
                add(
                    s,
                    shelf(),
                    Material { bsdf: Bsdf::Diffuse { reflectance }, ..Material::diffuse("painted", Vec3::ONE) },
                );
            }),
            &["flag TEXTURES", "memory texels", "code texture_use_at", "code sample_texture", "code tangent_from_uv"],
            &["flag TEXTURES", "memory texels", "code texture_use_at", "code sample_texture", "code tangent_from_uv"],
        ),
        feature(
            "tessellation",
            with(|s| add(s, refined(None), Material::diffuse("round", Vec3::ONE))),
            &["pass tessellate", "pass controls", "memory blends", "memory controls", "memory rest", "code projected"],
            &["pass tessellate", "pass controls", "memory blends", "memory controls", "memory rest", "code projected"],
        ),
        Feature {
            name: "displacement",
            with: with(|s| add(s, refined(waves()), Material::diffuse("water", Vec3::ONE))),
            without: with(|s| add(s, refined(None), Material::diffuse("water", Vec3::ONE))),
            raster: &["pass displaced_normals", "memory rings", "memory waves", "code wave_height", "code height_at"],
            rays: &["pass displaced_normals", "memory rings", "memory waves", "code wave_height", "code height_at"],
        },
        feature(
            "vertex colours",
            with(|s| s.meshes[0].colors = vec![Vec3::ONE.extend(1.0); s.meshes[0].positions.len()]),
            &["flag VERTEX_COLORS", "code interpolated_color"],
            &["flag VERTEX_COLORS", "code interpolated_color"],
        ),
        feature(
            "alpha",
            with(|s| {
                let opacity = Some(Opacity::CutOut { value: 0.7.into(), cutoff: 0.5 });
                add(s, shelf(), Material { opacity, ..Material::diffuse("leaf", Vec3::ONE) });
            }),
            &["flag MASKS", "code is_hole"],
            &["flag MASKS", "code is_hole"],
        ),
        feature(
            "transmission",
            with(|s| add(s, shelf(), metal(0.9))),
            &[],
            &["flag TRANSMISSION", "code passing_eval", "code bent_facet", "code transmittance"],
        ),
    ]
}

#[test]
fn what_a_scene_does_not_need_is_not_there() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let _alone = alone();
    for Feature { name, with, without, raster, rays: by_rays } in features() {
        for (gpu, technique, names) in [(gpu, Technique::RASTER, raster), (rays, Technique::RAY_QUERY, by_rays)] {
            let [present, absent] = [&with, &without].map(|scene| ask(gpu, scene, &settings(technique), 0).names());
            for wanted in names {
                assert!(present.contains(*wanted), "{name}, {technique}: no {wanted} with it; there is {present:#?}");
                assert!(!absent.contains(*wanted), "{name}, {technique}: {wanted} without it");
            }
            // No other name exists only without the feature.
            let more: Vec<_> = absent.difference(&present).filter(|name| !replaced(name, &present)).collect();
            assert!(more.is_empty(), "{name}, {technique}: {more:?} only without it");
        }
    }
    // Raster renders no transmission.
    let glass = with(|s| add(s, shelf(), metal(0.9))).without_glass();
    let names = ask(gpu, &glass, &settings(Technique::RASTER), 0).names();
    assert!(!names.iter().any(|n| n.contains(Flag::Transmission.name()) || n == "code passing_eval"), "{names:#?}");
    // Names of features that do not exist are absent.
    for scene in [plain(), glass] {
        let names = ask(gpu, &scene, &settings(Technique::RASTER), 0).names();
        assert!(!names.iter().any(|n| n.contains("anim") || n.contains("skin") || n.contains("denois")), "{names:#?}");
    }
}

/// Flags follow from the scene's lights, tables from their power: code must not need a table that is missing.
#[test]
fn lights_that_never_shine_leave_no_table_missing() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let _alone = alone();
    let black_map = EnvironmentMap { width: 4, height: 2, texels: vec![[0.0; 3]; 8], rows: Rows::Centred };
    let dark = |change: &dyn Fn(&mut Scene)| {
        with(|s| {
            s.lights.clear();
            change(s);
        })
    };
    let flat = |s: &mut Scene| {
        let mut mesh = floor(0.2, 0.9);
        mesh.triangles = vec![[0, 0, 1]];
        add(s, mesh, emitter(0.5, Vec3::ONE, true));
    };
    let scenes = [
        ("nothing", dark(&|_| ())),
        ("black map", dark(&|s| s.environment = Some(Environment { map: Some(black_map.clone()), ..sky(false) }))),
        ("black sky", dark(&|s| s.environment = Some(Environment { radiance: Vec3::ZERO, ..sky(false) }))),
        ("black point", dark(&|s| s.lights = vec![Light::Point { position: Vec3::ZERO, intensity: Vec3::ZERO }])),
        ("flat lamp", dark(&flat)),
    ];
    for (name, scene) in &scenes {
        for technique in [Technique::RASTER, Technique::TWIN, Technique::PATH, Technique::RAY_QUERY] {
            let gpu = if technique.needs_ray_queries() { rays } else { gpu };
            ask(gpu, scene, &settings(technique), 1);
            gpu.check().unwrap_or_else(|e| panic!("{name}, {technique}: {e}"));
        }
    }
    // The paper's set hits lamps and never starts from one.
    let lamp = with(|s| add(s, floor(0.2, 0.9), emitter(0.5, Vec3::ONE, true)));
    let paper = Settings { strategies: Strategies::Paper, ..settings(Technique::RASTER) };
    for scene in [lamp, scenes[1].1.clone()] {
        ask(gpu, &scene, &paper, 1);
        gpu.check().unwrap();
    }
}

/// The plan's runs are those that were recorded, and its views those that were allocated, for each number of
/// bounces.
#[test]
fn bounces_that_nobody_asks_for_are_not_there() {
    let Some(gpu) = gpu() else { return };
    let _alone = alone();
    let mut before = None;
    for bounces in 0..4 {
        let asked = ask(gpu, &plain(), &Settings { bounces, ..settings(Technique::RASTER) }, 2);
        let views = asked.counts.buffers["lists"].count;
        let lists = asked.counts.passes["view_lists"].dispatches;
        let extends = asked.counts.passes.get("extend").map_or(0, |p| p.dispatches);
        let vertices = asked.counts.passes.get("light_subpath").map_or(0, |p| p.dispatches);
        let planned = ["view_lists", "extend", "light_subpath"].map(|pass| u64::from(asked.runs(pass)));
        // Two iterations are rendered; the light's own view is rasterized once.
        assert_eq!([lists + 1, extends, vertices], planned.map(|n| 2 * n), "{bounces} bounces");
        assert_eq!(views, planned[0], "{bounces} bounces");
        assert_eq!((extends, vertices), (2 * u64::from(bounces), 2 * u64::from(bounces.min(2))));
        assert_eq!(asked.names().contains("pass extend"), bounces > 0);
        let bytes = asked.counts.bytes();
        assert!(before.is_none_or(|before| before < bytes), "{bounces} bounces: {bytes}");
        before = Some(bytes);
    }
    // Without a light nothing is connected, and only the camera's view is rasterized, and its borders.
    let dark = ask(gpu, &with(|s| s.lights.clear()), &settings(Technique::RASTER), 2);
    let passes: Vec<_> = dark.counts.passes.keys().collect();
    assert_eq!(passes, ["accumulate", "borders", "eye_vertices", "gbuffer"]);
    for pass in ["view_setup", "view_lists", "light_point", "rsm", "light_subpath", "connect", "extend"] {
        assert_eq!(dark.runs(pass), 0, "{pass}");
    }
    for label in ["lists", "projected_triangles", "items", "light_points", "rsm"] {
        assert!(!dark.counts.buffers.contains_key(label), "{label}");
    }
}

/// Sides of few triangles are drawn exactly; of many, or where rays find what the camera sees, they have no pass,
/// no byte and no code.
#[test]
fn borders_are_drawn_of_few_triangles_only() {
    let Some(gpu) = gpu() else { return };
    let _alone = alone();
    let six = with(|s| (0..5).for_each(|_| add(s, room(), Material::diffuse("room", Vec3::splat(0.5)))));
    let of = |scene: &Scene, visibility_from| {
        let settings = Settings { visibility_from, ..settings(Technique::RASTER) };
        let names = ask(gpu, scene, &settings, 1).names();
        ["pass borders", "memory borders"].map(|name| names.contains(name))
    };
    // Twelve triangles, and 72.
    assert_eq!(of(&plain(), VisibilityFrom::Lists), [true; 2]);
    assert_eq!(of(&six, VisibilityFrom::Lists), [false; 2]);
    assert_eq!(of(&plain(), VisibilityFrom::Grid), [false; 2]);
}

/// Iterations of one camera share a G-buffer.
#[test]
fn looks_are_drawn_once() {
    let Some(gpu) = gpu() else { return };
    let _alone = alone();
    let draws = |side, scene: &Scene| {
        let settings = Settings { width: side, height: side, ..settings(Technique::RASTER) };
        ask(gpu, scene, &settings, 5).counts.passes["gbuffer"].draws
    };
    let lens = with(|s| s.cameras[0].lens = Some(Lens { radius: 0.01, focus: 1.0 }));
    assert_eq!([draws(4, &plain()), draws(8, &plain()), draws(4, &lens)], [3, 5, 5]);
}

/// Pictures that are only summed have no denoising passes, and denoised pictures have only those that were
/// asked for.
#[test]
fn frames_are_filtered_only_where_asked() {
    let Some(gpu) = gpu() else { return };
    let _alone = alone();
    let of = |settings: Settings| ask(gpu, &plain(), &settings, 2);
    let base = settings(Technique::RASTER);
    let summed = of(base.clone()).names();
    let has = |names: &BTreeSet<String>, parts: &[&str]| {
        let parts = parts.iter().filter(|part| names.contains(**part));
        parts.map(|part| (*part).to_owned()).collect::<Vec<_>>()
    };
    let all = ["pass gradient", "pass temporal", "pass filter", "pass firefly_clamp", "pass compose", "pass antialias"];
    let kept = ["memory guides", "memory layers", "memory history", "memory filtered"];
    let code = ["code guide_of", "code are_alike", "code layer_index"];
    assert!(has(&summed, &[&all[..], &kept, &code].concat()).is_empty(), "{summed:?}");
    assert!(summed.contains("memory film"));

    let filtered = of(Settings { interleave: Some(2), ..base.clone() }).names();
    assert_eq!(has(&filtered, &all), ["pass filter", "pass compose", "pass antialias"]);
    assert_eq!(has(&filtered, &kept), ["memory guides", "memory layers", "memory filtered"]);
    assert!(!filtered.contains("memory film"));
    let remembered = of(Settings { history: 8, ..base.clone() }).names();
    assert_eq!(has(&remembered, &all), ["pass temporal", "pass compose", "pass antialias"]);
    let unfiltered = of(Settings { interleave: Some(2), unfiltered: true, ..base.clone() }).names();
    assert_eq!(has(&unfiltered, &all), ["pass compose", "pass antialias"]);
    let both = of(Settings { interleave: Some(2), history: 8, upsample: 2, tame_outliers: true, ..base });
    // Nothing has changed yet, so that no gradient is measured.
    assert!(!both.counts.passes.contains_key("gradient"));
    let both = both.names();
    assert_eq!(has(&both, &all), all);
    assert!(both.contains("memory layer_guides") && !filtered.contains("memory layer_guides"));
}

/// Tiles converge only if an error is asked for, and never in denoised pictures.
#[test]
fn tiles_settle_only_where_an_error_is_asked_for() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let _alone = alone();
    let brought = ["memory converged", "code is_converged"];
    for technique in [Technique::RASTER, Technique::TWIN, Technique::RAY_QUERY, Technique::PATH] {
        let gpu = if technique.needs_ray_queries() { rays } else { gpu };
        let asked = |target_error| ask(gpu, &plain(), &Settings { target_error, ..settings(technique) }, 2);
        let (with, without) = (asked(Some(0.01)).names(), asked(None).names());
        let more: Vec<_> = with.difference(&without).filter(|name| !name.starts_with("flag ")).collect();
        assert!(brought.iter().all(|name| with.contains(*name) && !without.contains(*name)), "{technique}: {with:?}");
        assert!(
            more.iter().all(|name| brought.contains(&name.as_str()) || *name == "code place_of"),
            "{technique}: {more:?}"
        );
        assert!(without.is_subset(&with), "{technique}");
    }
    let live = Settings { target_error: Some(0.01), history: 8, ..settings(Technique::RASTER) };
    let live = ask(gpu, &plain(), &live, 2).names();
    assert!(brought.iter().all(|name| !live.contains(*name)), "{live:?}");
}

/// Light points of two iterations and the reservoirs of pixels exist only with reuse.
#[test]
fn what_was_kept_is_there_only_for_reuse() {
    let Some(gpu) = gpu() else { return };
    let _alone = alone();
    let of = |light_sampling| ask(gpu, &plain(), &Settings { light_sampling, ..settings(Technique::RASTER) }, 3);
    let names = |asked: &Asked| {
        let all = asked.names();
        [
            "pass light_candidates",
            "pass light_reservoirs",
            "pass light_reservoirs_test",
            "memory selected_lights",
            "memory pixel_reservoirs",
        ]
        .map(|name| all.contains(name))
    };
    let restir = of(Some(LightSampling::Restir));
    assert_eq!(names(&of(None)), [false; 5]);
    assert_eq!(names(&of(Some(LightSampling::Ris))), [true, false, false, true, false]);
    assert_eq!(names(&restir), [true; 5]);
    // Three iterations rasterize the views of their own pool once each and query those of two.
    let dispatches = |pass| restir.counts.passes[pass].dispatches;
    assert_eq!(
        dispatches("light_reservoirs") + dispatches("light_reservoirs_test"),
        3 * u64::from(restir.runs("light_reservoirs"))
    );
    assert_eq!(dispatches("view_lists"), 3 * u64::from(restir.runs("view_lists")));
}

/// The plan's bytes beside the scene are those that were allocated, within 5 %.
#[test]
fn memory_is_what_the_plan_says() {
    let (Some(gpu), Some(rays)) = (gpu(), gpu_with_ray_queries()) else { return };
    let _alone = alone();
    let base = Settings { width: 256, height: 144, ..Settings::plain() };
    let mut checked = 0;
    for name in ["cornell_point", "cornell_glossy", "cornell_env", "displaced_room:5000", "point_hall:100", "furnace"] {
        let scene = builtin::load(name).unwrap();
        for settings in [
            base.clone(),
            Settings { technique: Technique::FAST, ..base.clone() },
            Settings { bounces: 0, ..base.clone() },
            Settings { width: 1024, height: 512, list_room: 0.5, ..base.clone() },
            Settings { interleave: Some(4), history: 16, upsample: 2, ..base.clone() },
            Settings { technique: Technique::TWIN, ..base.clone() },
            Settings { light_sampling: Some(LightSampling::Restir), light_pool: Some(4), ..base.clone() },
            Settings { technique: Technique::PATH, ..base.clone() },
            Settings { technique: Technique::RAY_QUERY, bounces: 4, ..base.clone() },
        ] {
            let gpu = if settings.technique.needs_ray_queries() { rays } else { gpu };
            gpu.ledger.reset();
            let (planned, stats) = if settings.technique.shares_subpaths() {
                let renderer = SharedRenderer::new(gpu, &scene, &settings).unwrap();
                (renderer.plan().bytes, renderer.stats())
            } else {
                let renderer = PathRenderer::new(gpu, &scene, &settings).unwrap();
                (renderer.plan().bytes, renderer.stats())
            };
            let asked = gpu.ledger.counts();
            // What rays are traced through, and what that is built from, belong to the scene.
            let of_rays = ["indices", "first_triangles", "grid", "along", "grid_rows", "counts", "distances", "totals"];
            let building: u64 = of_rays.iter().filter_map(|l| asked.buffers.get(*l)).map(|b| b.bytes).sum();
            let real = asked.bytes() - stats.scene_bytes - building;
            let off = |a: u64| (a as f64 / real as f64 - 1.0).abs();
            println!("{name}, {}: planned {planned}, said {}, asked for {real}", settings.technique, stats.bytes);
            assert!(off(planned) < 0.05, "{name}, {settings:?}: {planned} planned, {real} asked for");
            assert!(off(stats.bytes) < 0.05, "{name}, {settings:?}: {} said, {real} asked for", stats.bytes);
            checked += 1;
        }
    }
    assert_eq!(checked, 54);
}

/// Returns the facts of a scene that has everything.
fn everything(scene: &Scene) -> SceneStats {
    let stats = SceneStats::new(scene, &Geometry::new(scene));
    SceneStats {
        patterns: true,
        local_lights: true,
        infinite_lights: true,
        emissive_triangles: 1,
        environment: true,
        environment_map: true,
        glossy_triangles: 1,
        masked_triangles: 1,
        blended_triangles: 1,
        texels: 1,
        vertex_colors: true,
        ..stats
    }
}

/// Returns the seconds of the fastest of several runs of each renderer, in turns.
fn seconds(renderers: &mut [SharedRenderer], samples: u64, turns: u32) -> Vec<f64> {
    let mut least = vec![f64::INFINITY; renderers.len()];
    for _ in 0..turns {
        for (renderer, least) in renderers.iter_mut().zip(&mut least) {
            let began = Instant::now();
            renderer.render(samples, &mut |_| true).unwrap();
            *least = least.min(began.elapsed().as_secs_f64());
        }
    }
    least
}

/// A diffuse scene with one light gives the same picture with all features forced on.
#[test]
fn skipping_changes_no_picture() {
    skipped_and_forced();
}

/// Skipping saves time. The test is run on demand, since other work on the machine can hide it.
#[test]
#[ignore = "a matter of the clock"]
fn skipping_saves_time() {
    if let Some([skipped, forced]) = skipped_and_forced() {
        assert!(forced > 1.5 * skipped, "{skipped} s and {forced} s");
    }
}

/// Returns the seconds of both renderers, whose pictures have to be the same.
fn skipped_and_forced() -> Option<[f64; 2]> {
    let gpu = gpu()?;
    let _alone = alone();
    let scene = builtin::load("cornell_point").unwrap();
    // One edge in some ten millions passes a border so closely that rounding, which differs between shaders,
    // decides; with this seed there is none.
    // With the roughness clamp, so that no surface draws directions of its own.
    let (visibility_from, clamp_samples) = (VisibilityFrom::Lists, Some(16.0));
    let settings =
        Settings { width: 192, height: 192, bounces: 1, seed: 2, visibility_from, clamp_samples, ..Settings::plain() };
    let mut renderers = [
        SharedRenderer::new(gpu, &scene, &settings).unwrap(),
        SharedRenderer::forced(gpu, &scene, &settings, everything(&scene)).unwrap(),
    ];
    let forced = renderers[1].plan();
    for flag in [Flag::Textures, Flag::VertexColors, Flag::Glossy, Flag::Masks] {
        assert!(forced.surface_flags.contains(&flag) && !renderers[0].plan().surface_flags.contains(&flag));
    }
    assert_eq!(
        forced.light_flags,
        [Flag::Punctual, Flag::Patterns, Flag::Emission, Flag::Environment, Flag::EnvironmentMap]
    );
    assert_eq!(renderers[0].plan().light_flags, [Flag::Punctual]);
    let times = seconds(&mut renderers, 4, 8);
    let films: Vec<Film> = renderers.iter().map(|r| r.film().unwrap()).collect();
    let mean = films[0].pixels.iter().flatten().sum::<f32>() / (3 * films[0].pixels.len()) as f32;
    let pairs = films[0].pixels.iter().flatten().zip(films[1].pixels.iter().flatten());
    let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / mean;
    println!("{:.1} and {:.1} ms an iteration, worst pixel {worst:.1e}", times[0] * 250.0, times[1] * 250.0);
    assert!(worst < 1e-4 && films[0].pixels.as_ptr() != films[1].pixels.as_ptr(), "{worst}");
    Some([times[0], times[1]])
}
