//! Tests of the plan: the passes that run for a scene, and the reasons. Needs no GPU.

use lightsheaf::gpu::{Capabilities, Flag};
use lightsheaf::render::shared::plan::FramePlan;
use lightsheaf::render::shared::plan::strategies::Connection;
use lightsheaf::render::shared::plan::views::ViewRole;
use lightsheaf::render::visibility::tracer::Tracing;
use lightsheaf::scene::{Camera, Lens, SceneStats, builtin};
use lightsheaf::settings::{LightSampling, OnlyStrategy, Settings, Strategies, Technique, Visibility, VisibilityFrom};

fn capabilities() -> Capabilities {
    Capabilities {
        adapter: "none".to_owned(),
        software: true,
        compiles_late: false,
        ray_queries: false,
        timestamps: false,
        max_storage_bytes: 128 << 20,
        max_texture_side: 8192,
        max_texture_layers: 256,
    }
}

/// Returns the facts of a box of diffuse walls without any light.
fn dark() -> SceneStats {
    SceneStats {
        triangles: 32,
        vertices: 96,
        materials: 3,
        radius: 1.7,
        mean_triangle_size: 0.3,
        ..SceneStats::default()
    }
}

fn one_light() -> SceneStats {
    SceneStats { lights: 1, local_lights: true, ..dark() }
}

fn bounces(bounces: u32) -> Settings {
    Settings { bounces, ..Settings::plain() }
}

fn with(strategies: Strategies, bounces: u32) -> Settings {
    Settings { strategies, bounces, ..Settings::plain() }
}

/// Plans a scene with few lights.
fn plan(stats: &SceneStats, settings: &Settings) -> FramePlan {
    let plan = plan_of(stats, settings);
    // Rays connect all light points in one run, maps one point each.
    let by_rays = |s: u32| s == 1 && plan.ray_views.lights;
    let joined = plan.connections.iter().map(|c| if by_rays(c.s) { 1 } else { plan.points_connected(c) });
    assert_eq!(runs(&plan, "connect"), plan.grid.count_bands()[0] * joined.sum::<u32>());
    let others = plan.direct_lights.saturating_sub(1);
    // Vertices that draw directions of their own need no bundles.
    let bundles = if plan.own_directions { 0 } else { plan.extensions.len() as u32 };
    assert_eq!(plan.views().len() as u32, plan.light_vertices + bundles + others);
    plan
}

fn plan_of(stats: &SceneStats, settings: &Settings) -> FramePlan {
    let plan = FramePlan::new(stats, settings, &capabilities());
    let subpaths = plan.grid.subpaths();
    let counts =
        [subpaths * plan.light_vertices.saturating_sub(1), plan.grid.count_bands()[0] * plan.extensions.len() as u32];
    assert_eq!(["light_subpath", "extend"].map(|name| runs(&plan, name)), counts, "{plan}");
    assert!(plan.bytes > 0);
    let text = plan.to_string();
    for pass in &plan.passes {
        assert!(!pass.reason.is_empty(), "{} has no reason", pass.name);
        assert!(text.contains(pass.name) && text.contains(&pass.reason), "{text}");
    }
    plan
}

fn runs(plan: &FramePlan, name: &str) -> u32 {
    let passes: Vec<_> = plan.passes.iter().filter(|p| p.name == name).collect();
    assert_eq!(passes.len(), 1, "{name} is listed {} times", passes.len());
    passes[0].runs
}

/// Returns names and runs of all passes, skipped ones included.
fn table(plan: &FramePlan) -> Vec<(&'static str, u32)> {
    plan.passes.iter().map(|p| (p.name, p.runs)).collect()
}

/// Returns (s, t) of all connections.
fn strategies(plan: &FramePlan) -> Vec<(u32, u32)> {
    plan.connections.iter().map(|c| (c.s, c.j + 1)).collect()
}

/// Returns (j, last) of all extensions.
fn extensions(plan: &FramePlan) -> Vec<(u32, bool)> {
    plan.extensions.iter().map(|e| (e.j, e.last)).collect()
}

/// No surface reflects the light that there is.
#[test]
fn where_all_is_unlit_only_the_camera_looks() {
    let lit = SceneStats { emissive_triangles: 32, light_places: 8, environment: true, ..one_light() };
    let settings = Settings { interleave: None, ..bounces(4) };
    let [plan, lit] = [SceneStats { unlit: true, ..lit.clone() }, lit].map(|stats| plan_of(&stats, &settings));
    assert!(lit.light_vertices == 3 && lit.grid.side > 1 && !lit.extensions.is_empty());
    assert!(plan.camera_hits_emitters && !plan.starts_from_emitters && !plan.rsm);
    assert!(plan.connections.is_empty() && plan.extensions.is_empty() && plan.views().is_empty());
    assert_eq!((plan.light_vertices, plan.grid.side), (0, 1));
}

#[test]
fn without_light_only_the_camera_looks() {
    let plan = plan(&dark(), &bounces(2));
    let expected = [
        ("deform", 0),
        ("tessellate", 0),
        ("light_importance", 0),
        ("sky_guide", 0),
        ("light_point", 0),
        ("view_setup", 0),
        ("view_lists", 0),
        ("depth_maps", 0),
        ("rsm", 0),
        ("light_subpath", 0),
        ("caustics", 0),
        ("gbuffer", 1),
        ("borders", 1),
        ("seen_light", 0),
        ("eye_vertices", 1),
        ("list_lengths", 0),
        ("connect", 0),
        ("light_candidates", 0),
        ("light_reservoirs", 0),
        ("extend", 0),
        ("accumulate", 1),
        ("gradient", 0),
        ("temporal", 0),
        ("filter", 0),
        ("firefly_clamp", 0),
        ("compose", 0),
        ("antialias", 0),
    ];
    assert_eq!(table(&plan), expected);
    assert!(plan.views().is_empty() && plan.surface_flags.is_empty() && plan.light_flags.is_empty());
}

/// Classes have dispatches of their own where each has views, or a reflective shadow map that is not that of all.
#[test]
fn classes_that_rays_serve_are_rendered_together() {
    let base = Settings { interleave: Some(3), visibility_from: VisibilityFrom::Grid, ..bounces(2) };
    let glossy = SceneStats { glossy_triangles: 8, ..one_light() };
    let of = |stats: &SceneStats, settings: &Settings| {
        let plan = plan(stats, settings);
        (plan.grid.together, ["light_point", "eye_vertices", "accumulate"].map(|pass| runs(&plan, pass)))
    };
    assert_eq!(of(&glossy, &base), (9, [9, 1, 1]));
    assert_eq!(of(&glossy, &Settings { interleave: Some(5), ..base.clone() }), (16, [25, 2, 2]));
    let lists = Settings { visibility_from: VisibilityFrom::Lists, ..base.clone() };
    let two_lights = SceneStats { lights: 2, sharp_lights: 2, ..glossy.clone() };
    for (stats, settings) in [(&glossy, &lists), (&one_light(), &base), (&two_lights, &base)] {
        assert_eq!(of(stats, settings), (1, [9, 9, 9]), "{stats:?}");
    }
    assert_eq!(of(&glossy, &Settings { interleave: Some(1), ..base }), (1, [1, 1, 1]));
}

#[test]
fn a_point_light_by_number_of_bounces() {
    let direct = plan(&one_light(), &bounces(0));
    assert_eq!(strategies(&direct), [(1, 2)]);
    assert_eq!((direct.light_vertices, extensions(&direct)), (1, vec![]));
    assert_eq!(runs(&direct, "view_lists"), 1);

    let one = plan(&one_light(), &bounces(1));
    assert_eq!(strategies(&one), [(1, 2), (2, 2), (1, 3)]);
    assert_eq!((one.light_vertices, extensions(&one)), (2, vec![(1, false)]));

    let two = plan(&one_light(), &bounces(2));
    assert_eq!((two.light_vertices, extensions(&two)), (3, vec![(1, false), (2, false)]));
    assert_eq!(runs(&two, "view_setup"), 5);

    // Longer paths have the same three strategies each, with eye vertices further from the camera.
    let three = plan(&one_light(), &bounces(3));
    assert_eq!(strategies(&three), [(1, 2), (2, 2), (3, 2), (1, 3), (2, 3), (3, 3), (1, 4), (2, 4), (1, 5)]);
    assert_eq!((three.light_vertices, extensions(&three)), (3, vec![(1, false), (2, false), (3, false)]));

    let many = plan(&one_light(), &bounces(16));
    assert_eq!((many.light_vertices, many.extensions.len()), (3, 16));
    assert_eq!(many.connections.len(), 17 + 16 + 15);
    for k in 0..=16 {
        let of_length: Vec<_> = many.connections.iter().filter(|c| c.s + c.j - 2 == k).collect();
        assert_eq!(of_length.len() as u32, 3.min(k + 1), "bounces {k}");
        let samples = [0, 1, u32::from(k >= 1), u32::from(k >= 2)];
        assert!(of_length.iter().all(|c| c.samples == samples && !c.clamped), "{of_length:?}");
    }
}

#[test]
fn two_bounces_have_six_connections_under_mis() {
    let plan = plan(&one_light(), &bounces(2));
    let c = |s, j, samples| Connection { s, j, samples, narrow_only: false, clamped: false };
    let direct = [0, 1, 0, 0];
    let once = [0, 1, 1, 0];
    let twice = [0, 1, 1, 1];
    let expected = [c(1, 1, direct), c(2, 1, once), c(3, 1, twice), c(1, 2, once), c(2, 2, twice), c(1, 3, twice)];
    assert_eq!(plan.connections, expected);
    let reason = &plan.passes.iter().find(|p| p.name == "connect").unwrap().reason;
    assert!(reason.contains("(1, 2) (2, 2) (3, 2) (1, 3) (2, 3) (1, 4)"), "{reason}");
}

/// For all settings, every strategy that runs takes part in its own MIS, and every strategy that takes part
/// runs.
#[test]
fn masks_and_connections_agree() {
    let mut seen = 0;
    for strategy in [Strategies::All, Strategies::Vpl, Strategies::Bundle, Strategies::Paper] {
        for k in 0..=16 {
            let plan = plan(&one_light(), &with(strategy, k));
            for length in 0..=k {
                let of_length: Vec<_> = plan.connections.iter().filter(|c| c.s + c.j - 2 == length).collect();
                if strategy == Strategies::Paper && length > 2 {
                    assert!(of_length.is_empty(), "{of_length:?}");
                    continue;
                }
                assert!(!of_length.is_empty(), "{strategy:?}, {k}: nothing makes {length} bounces");
                for connection in &of_length {
                    let runs = |s: usize| of_length.iter().any(|c| c.s == s as u32);
                    let run: [u32; 4] = std::array::from_fn(|s| u32::from(runs(s)));
                    assert_eq!(connection.samples, run, "{strategy:?}, {k}: {of_length:?}");
                    seen += 1;
                }
            }
            // Exactly the eye vertices that are connected are made.
            let deepest = plan.connections.iter().map(|c| c.j).max().unwrap_or(1);
            assert_eq!(plan.extensions.len() as u32, deepest - 1);
            assert!(plan.extensions.iter().all(|e| !e.last));
            assert!(plan.connections.iter().all(|c| c.s <= plan.light_vertices));
        }
    }
    assert!(seen > 300, "{seen}");
}

#[test]
fn strategies_choose_their_connections() {
    let of = |strategy| strategies(&plan(&one_light(), &with(strategy, 2)));
    assert_eq!(of(Strategies::All).len(), 6);
    assert_eq!(of(Strategies::Vpl), [(1, 2), (2, 2), (3, 2)]);
    assert_eq!(of(Strategies::Bundle), [(1, 2), (1, 3), (1, 4)]);
    assert_eq!(of(Strategies::Paper), [(1, 2), (2, 2), (1, 3), (2, 3)]);

    let bundle = plan(&one_light(), &with(Strategies::Bundle, 2));
    assert_eq!((bundle.light_vertices, runs(&bundle, "light_subpath"), runs(&bundle, "extend")), (1, 0, 2));
    let vpl = plan(&one_light(), &with(Strategies::Vpl, 2));
    assert_eq!((vpl.light_vertices, runs(&vpl, "light_subpath"), runs(&vpl, "extend")), (3, 2, 0));
    let paper = plan(&one_light(), &with(Strategies::Paper, 2));
    let clamped: Vec<_> = paper.connections.iter().filter(|c| c.clamped).map(|c| (c.s, c.j + 1)).collect();
    assert_eq!((paper.light_vertices, clamped), (2, vec![(2, 3)]));
    // The four plans have different texts.
    let texts = [Strategies::All, Strategies::Vpl, Strategies::Bundle, Strategies::Paper]
        .map(|s| plan(&one_light(), &with(s, 2)).to_string());
    assert!((0..4).all(|i| (0..i).all(|j| texts[i] != texts[j])));
}

#[test]
fn light_that_is_met_by_chance() {
    for stats in [
        SceneStats { environment: true, ..dark() },
        SceneStats { environment: true, environment_map: true, ..dark() },
        SceneStats { emissive_triangles: 2, ..dark() },
    ] {
        let flags: &[Flag] = match (stats.environment, stats.environment_map) {
            (true, true) => &[Flag::Environment, Flag::EnvironmentMap],
            (true, false) => &[Flag::Environment],
            _ => &[Flag::Emission],
        };
        for k in [0, 1, 2, 16] {
            let all = plan(&stats, &bounces(k));
            assert_eq!(all.light_flags, flags);
            // Emitters start light subpaths, too, without a reflective shadow map. Hits count for every path
            // but those of the last of several bounces.
            assert_eq!((all.light_vertices, runs(&all, "light_point"), runs(&all, "rsm")), (3.min(k + 1), 1, 0));
            assert_eq!(strategies(&all), strategies(&plan(&one_light(), &bounces(k))));
            let expected: Vec<_> = (1..=k + 1).map(|j| (j, j == k + 1)).collect();
            let met = if k > 1 { k } else { k + 1 };
            assert_eq!(extensions(&all), expected[..met as usize], "{k} bounces");
            for length in 0..=k {
                let samples = [u32::from(length < met), 1, u32::from(length >= 1), u32::from(length >= 2)];
                let joined = all.connections.iter().filter(|c| c.s + c.j - 2 == length).map(|c| c.samples);
                let met = all.extensions.iter().filter(|e| e.j == length + 1 && e.hits_emitter).map(|e| e.samples);
                assert_eq!(met.clone().count(), samples[0] as usize);
                assert!(joined.chain(met).all(|n| n == samples), "{length} of {k} bounces");
            }
            // The paper only hits emitters, and VPLs alone never do.
            let paper = plan(&stats, &with(Strategies::Paper, k));
            assert_eq!((paper.light_vertices, paper.connections.len()), (0, 0));
            assert!(paper.sky_bundles == stats.environment_map && !all.sky_bundles);
            assert!(
                extensions(&paper) == expected && paper.extensions.iter().all(|e| e.hits_emitter && e.samples[0] == 1)
            );
            let vpl = plan(&stats, &with(Strategies::Vpl, k));
            assert!(vpl.camera_hits_emitters && vpl.extensions.iter().all(|e| !e.hits_emitter));
            assert!(vpl.connections.iter().all(|c| c.samples[0] == 0));
        }
    }
    // With a point light as well, both kinds of strategies run.
    let both = plan(&SceneStats { environment: true, ..one_light() }, &bounces(2));
    assert_eq!((both.connections.len(), runs(&both, "rsm")), (6, 1));
    assert_eq!(extensions(&both), [(1, false), (2, false)]);
    let bundle = plan(&SceneStats { environment: true, ..one_light() }, &with(Strategies::Bundle, 2));
    assert_eq!(extensions(&bundle), [(1, false), (2, false), (3, true)], "VPLs are what finds it otherwise");
}

/// Views around local lights have six faces, those of infinite lights one; only bundles keep projected
/// triangles.
#[test]
fn views_have_what_light_needs() {
    let of = |local_lights, infinite_lights| {
        let plan = plan(&SceneStats { local_lights, infinite_lights, ..one_light() }, &bounces(2));
        let views = plan.views();
        let faces: Vec<_> = views.iter().map(|view| view.texels.faces).collect();
        let projected: Vec<_> = views.iter().map(|view| plan.projected_triangles(view.role, 32)).collect();
        (faces, projected, plan.bytes)
    };
    let (local, infinite, both) = (of(true, false), of(false, true), of(true, true));
    assert_eq!((local.0, local.1), (vec![6, 6, 6, 1, 1], vec![0, 0, 0, 32, 32]));
    assert_eq!((infinite.0, infinite.1), (vec![1, 6, 6, 1, 1], vec![0, 0, 0, 32, 32]));
    assert_eq!((both.0, both.1), (vec![6, 6, 6, 1, 1], vec![0, 0, 0, 32, 32]));
    assert!(local.2 == both.2 && infinite.2 < local.2);
}

#[test]
fn views_have_names() {
    let names = |stats: &SceneStats, settings: &Settings| -> Vec<_> {
        plan_of(stats, settings).views().iter().map(|view| view.role.to_string()).collect()
    };
    assert_eq!(names(&one_light(), &bounces(2)), ["light", "vpl 1", "vpl 2", "bundle 1", "bundle 2"]);
    let pool = Settings { light_pool: Some(4), ..bounces(2) };
    assert_eq!(names(&one_light(), &pool)[4..], ["bundle 2", "light candidate"]);
    let lamps = SceneStats { lights: 3, ..one_light() };
    assert_eq!(names(&lamps, &bounces(2))[4..], ["bundle 2", "light 2", "light 3"]);
    let bundle = with(Strategies::Bundle, 0);
    assert_eq!(names(&SceneStats { environment: true, ..dark() }, &bundle), ["light", "bundle 1"]);
}

/// Two iterations share a G-buffer if it costs much and no setting needs one for each.
#[test]
fn many_triangles_share_a_look() {
    let pinhole = builtin::load("cornell_point").unwrap().cameras.remove(0);
    let lens = Camera { lens: Some(Lens { radius: 0.1, focus: 1.0 }), ..pinhole.clone() };
    let looks = |triangles, settings: &Settings, camera: &Camera| {
        plan(&SceneStats { triangles, ..one_light() }, settings).iterations_per_gbuffer(camera)
    };
    let base = Settings { width: 64, height: 64, ..Settings::plain() };
    assert_eq!([1024, 1025].map(|triangles| looks(triangles, &base, &pinhole)), [1, 2]);
    assert_eq!(looks(1025, &base, &lens), 1);
    assert_eq!(looks(1025, &Settings { history: 2, ..base.clone() }, &pinhole), 1);
    assert_eq!(looks(1025, &Settings { width: 128, ..base }, &pinhole), 1);
}

/// Sides of triangles are drawn where they cost little, which is where silhouettes are long for the pixels' number.
#[test]
fn borders_are_drawn_of_few_triangles() {
    let borders = |triangles, settings: &Settings| {
        let plan = plan(&SceneStats { triangles, ..one_light() }, settings);
        (plan.draws_borders, runs(&plan, "borders"))
    };
    let base = Settings { width: 64, height: 64, ..Settings::plain() };
    assert_eq!([64, 65].map(|triangles| borders(triangles, &base)), [(true, 1), (false, 0)]);
    assert_eq!(borders(65, &Settings { width: 65, ..base }), (true, 1));
}

/// Two to four lights each have a light point in every iteration, unless their views cost too much.
#[test]
fn few_lights_have_a_point_each() {
    let of = |stats: SceneStats| plan(&stats, &bounces(2));
    let sized_local_lights = |lights, sharp_lights| SceneStats {
        lights,
        sharp_lights,
        sized_local_lights: lights - sharp_lights,
        ..one_light()
    };
    for (stats, direct, setups) in [
        (sized_local_lights(1, 1), 0, 5),
        (sized_local_lights(2, 2), 2, 5),
        (sized_local_lights(4, 4), 4, 5),
        (sized_local_lights(5, 5), 0, 5),
        (sized_local_lights(2, 1), 2, 5),
        (sized_local_lights(2, 0), 0, 5),
        (SceneStats { emissive_triangles: 2, ..sized_local_lights(2, 2) }, 0, 5),
        (SceneStats { environment: true, infinite_lights: true, ..sized_local_lights(1, 1) }, 2, 5),
        // These are a sun and a sky.
        (
            SceneStats {
                environment: true,
                infinite_lights: true,
                local_lights: false,
                sized_local_lights: 0,
                ..sized_local_lights(1, 0)
            },
            2,
            6,
        ),
        (SceneStats { environment: true, infinite_lights: true, ..dark() }, 0, 5),
    ] {
        let plan = of(stats.clone());
        assert_eq!((plan.direct_lights, runs(&plan, "view_setup")), (direct, setups), "{stats:?}");
        let direct = plan.connections.iter().filter(|c| c.is_direct()).map(|c| plan.points_connected(c));
        assert_eq!(direct.collect::<Vec<_>>(), [plan.direct_lights.max(1)]);
        let views: Vec<_> = (0..plan.direct_lights).map(|light| plan.light_view(light)).collect();
        assert!(views.iter().enumerate().all(|(n, &view)| view.is_map() && !views[..n].contains(&view)));
    }
    let power = Settings { light_sampling: Some(LightSampling::Power), ..bounces(2) };
    assert_eq!(plan(&sized_local_lights(2, 2), &power).direct_lights, 0, "one is chosen where that is asked for");
    assert_eq!(plan(&sized_local_lights(2, 2), &with(Strategies::Paper, 2)).direct_lights, 0);
    // Lights without extent have no noise for a filter to remove.
    assert!(
        of(sized_local_lights(2, 2)).clear_light
            && !of(sized_local_lights(2, 1)).clear_light
            && !plan(&sized_local_lights(2, 2), &power).clear_light
    );
}

/// A GPU is filled by one band where a software driver has many, as long as it can bind a band's vertices.
#[test]
fn bands_fill_the_device() {
    let of = |software, max_storage_bytes| {
        let device = Capabilities { software, max_storage_bytes, ..capabilities() };
        let large = Settings { width: 1024, height: 1024, interleave: Some(1), ..bounces(2) };
        let grid = FramePlan::new(&one_light(), &large, &device).grid;
        assert!(grid.largest() <= u64::from(grid.band_pixels));
        grid.count_bands()[0]
    };
    assert_eq!([of(false, 128 << 20), of(true, 128 << 20)], [1, 8]);
    assert!((8..64).contains(&of(false, 8 << 20)));
}

/// Inside a scene light of the sky is guided, whatever traces the rays; lists and depth maps have no guide.
#[test]
fn the_sky_of_a_room() {
    let stats = SceneStats { environment: true, infinite_lights: true, camera_inside: true, ..dark() };
    let of = |stats: &SceneStats, settings: &Settings| {
        let plan = plan(stats, settings);
        (plan.guides_sky, runs(&plan, "sky_guide"), plan.light_points(), plan.ray_views.lights)
    };
    let technique = |technique| Settings { technique, ..bounces(2) };
    let from = |visibility_from| Settings { visibility_from, ..bounces(2) };
    for settings in [bounces(2), technique(Technique::TWIN), from(VisibilityFrom::Grid)] {
        assert_eq!(of(&stats, &settings), (true, 1, 4, true));
        let inside = plan(&stats, &settings);
        let direct = inside.connections.iter().filter(|c| c.is_direct()).map(|c| c.samples[1]);
        assert!(direct.eq([4]) && inside.extensions[0].samples[1] == 4 && inside.extensions[1].samples[1] == 1);
    }
    assert_eq!(of(&stats, &technique(Technique::FAST)), (false, 0, 1, false));
    assert_eq!(of(&stats, &from(VisibilityFrom::Lists)), (false, 0, 1, false));
    let outside = SceneStats { camera_inside: false, ..stats.clone() };
    assert_eq!(of(&outside, &from(VisibilityFrom::Grid)), (false, 0, 1, true));
}

#[test]
fn many_lights_make_a_pool() {
    let many = SceneStats { lights: 1000, light_places: 400, ..dark() };
    let all = plan_of(&many, &bounces(2));
    // Direct light has sixteen candidates; all other paths start from the first one.
    assert!(all.light_candidates == 16 && all.has_candidates() && runs(&all, "light_candidates") == 17, "{all}");
    for c in &all.connections {
        assert_eq!(c.samples[1], if c.s + c.j == 2 { 16 } else { 1 }, "{c:?}");
    }
    assert_eq!((runs(&all, "view_setup"), all.views().len()), (3 + 2 + 15, 3 + 2 + 1));
    assert_eq!(all.views()[5].role, ViewRole::Candidate(0));
    assert!(all.lights_for_view && runs(&all, "light_importance") == 1);
    let power = Settings { light_sampling: Some(LightSampling::Power), ..bounces(2) };
    assert!(!plan_of(&many, &power).lights_for_view);
    let asked = |light_pool| plan_of(&many, &Settings { light_pool: Some(light_pool), ..bounces(2) });
    assert!(!asked(1).has_candidates() && asked(1).bytes < all.bytes && runs(&asked(4), "light_candidates") == 5);
    let meets = plan_of(&SceneStats { emissive_triangles: 1000, light_places: 17, ..dark() }, &bounces(1));
    assert_eq!(meets.extensions.iter().map(|e| e.samples[1]).collect::<Vec<_>>(), [16, 1]);
    // A lamp of many triangles does not count as many lights.
    let lamp = SceneStats { emissive_triangles: 1000, light_places: 4, ..dark() };
    assert!(!plan_of(&lamp, &bounces(2)).has_candidates());
}

/// Of several emitters, the one that an iteration chooses is mostly far from a pixel, or weak there.
#[test]
fn several_emitters_make_a_pool_where_rays_connect_them() {
    let lamps = SceneStats { light_sources: 3, emissive_triangles: 24, light_places: 3, ..dark() };
    let of = |stats: &SceneStats, settings: &Settings| {
        let plan = plan_of(stats, settings);
        (plan.light_candidates, plan.lights_for_view)
    };
    let from = |visibility_from| Settings { visibility_from, ..bounces(2) };
    assert_eq!(of(&lamps, &from(VisibilityFrom::Grid)), (16, true));
    // Lists have a map for each candidate.
    assert_eq!(of(&lamps, &from(VisibilityFrom::Lists)), (1, false));
    for one in [
        SceneStats { light_sources: 1, ..lamps.clone() },
        SceneStats { light_sources: 1, environment: true, ..lamps.clone() },
        SceneStats { lights: 3, emissive_triangles: 0, ..lamps.clone() },
    ] {
        assert_eq!(of(&one, &from(VisibilityFrom::Grid)), (1, false), "{one:?}");
    }
    let grid = from(VisibilityFrom::Grid);
    for (asked, candidates) in [
        (Settings { light_pool: Some(1), ..grid.clone() }, 1),
        (Settings { light_sampling: Some(LightSampling::Power), ..grid.clone() }, 1),
        (Settings { strategies: Strategies::Paper, ..grid }, 1),
    ] {
        assert_eq!(of(&lamps, &asked), (candidates, false));
    }
}

#[test]
fn reuse_keeps_two_pools() {
    let of = |light_sampling, light_pool| {
        plan_of(&one_light(), &Settings { light_sampling: Some(light_sampling), light_pool, ..bounces(2) })
    };
    let (ris, restir) = (of(LightSampling::Ris, None), of(LightSampling::Restir, None));
    // Both resampling modes have candidates, however few lights there are; only one of them reuses
    // reservoirs.
    for plan in [&ris, &restir] {
        assert!(plan.has_candidates() && plan.light_candidates == 16 && runs(plan, "light_candidates") == 17, "{plan}");
        assert!(!plan.lights_for_view, "{plan}");
    }
    assert_eq!([ris.reuses(), restir.reuses()], [false, true]);
    assert_eq!([runs(&ris, "light_reservoirs"), runs(&restir, "light_reservoirs")], [0, 33]);
    // Each light point has a view, which lasts for two iterations; no view is rasterized more often than
    // without reuse.
    assert_eq!([ris.views().len(), restir.views().len()], [5 + 1, 5 + 31]);
    let y0 = ViewRole::LightVertex(0);
    assert_eq!(ris.candidate_views(), [[y0].as_slice(), &[ViewRole::Candidate(0); 15]].concat());
    let own = (0..31).map(ViewRole::Candidate);
    assert_eq!(restir.candidate_views(), std::iter::once(y0).chain(own).collect::<Vec<_>>());
    assert_eq!([runs(&ris, "view_setup"), runs(&restir, "view_setup")], [3 + 2 + 15; 2]);
    assert!(ris.bytes < restir.bytes);
    // Since maps are not rasterized for each band, bands are as small as without candidates.
    let large = |light_sampling| {
        let settings = Settings { width: 1024, height: 1024, light_sampling: Some(light_sampling), ..bounces(2) };
        plan_of(&one_light(), &settings)
    };
    let (ris, restir) = (large(LightSampling::Ris), large(LightSampling::Restir));
    assert_eq!([ris.grid.count_bands()[0], restir.grid.count_bands()[0]], [1, 8]);
    assert_eq!([runs(&ris, "view_setup"), runs(&restir, "view_setup")], [20; 2]);
    // A pool of one candidate has that one and the last iteration's.
    let one = of(LightSampling::Restir, Some(1));
    assert_eq!(one.candidate_views(), [y0, ViewRole::Candidate(0)]);
    assert_eq!((runs(&one, "light_candidates"), runs(&one, "light_reservoirs")), (2, 3));
    let many = SceneStats { lights: 1000, light_places: 400, ..dark() };
    assert!(plan_of(&many, &Settings { light_sampling: Some(LightSampling::Restir), ..bounces(2) }).lights_for_view);
    let unlit = plan_of(&dark(), &Settings { light_sampling: Some(LightSampling::Restir), ..bounces(2) });
    assert!(!unlit.reuses() && runs(&unlit, "light_reservoirs") == 0);
}

#[test]
fn flags_follow_the_scene() {
    let flags = |stats: &SceneStats| plan(stats, &bounces(2)).surface_flags;
    assert!(flags(&one_light()).is_empty());
    assert_eq!(flags(&SceneStats { texels: 16, ..one_light() }), [Flag::Textures]);
    assert_eq!(flags(&SceneStats { vertex_colors: true, ..one_light() }), [Flag::VertexColors]);
    let glossy = SceneStats { glossy_triangles: 1, ..one_light() };
    assert_eq!(flags(&glossy), [Flag::Glossy, Flag::Specular]);
    let clear = SceneStats { transmits: true, smooth_share: 1.0, ..glossy.clone() };
    assert_eq!(flags(&clear), [Flag::Glossy, Flag::Specular, Flag::Transmission, Flag::Caustics]);
    // Vertices on glass count as no bounces where that is wanted.
    let glass = SceneStats { specular: true, ..clear.clone() };
    let counting = [Flag::Glossy, Flag::Specular, Flag::SpecularBounces, Flag::Transmission, Flag::Caustics];
    assert_eq!(flags(&glass), counting);
    let of = |specular_bounces| plan(&glass, &Settings { specular_bounces, ..bounces(2) });
    assert_eq!(of(0), plan(&clear, &Settings { specular_bounces: 0, ..bounces(2) }));
    assert_eq!([of(0), of(4)].map(|plan| (plan.most_vertices, plan.cost)), [(3, of(0).cost), (7, of(0).cost)]);
    // Longer paths have strategies s = 0 and 1.
    let longest = |plan: &FramePlan, s| plan.connections.iter().filter(|c| c.s == s).map(|c| c.j).max().unwrap();
    assert_eq!([1, 2, 3].map(|s| longest(&of(4), s)), [7, 2, 1]);
    // A few smooth texels are not worth light paths, and those of a strategy alone are not splatted.
    let speckled = SceneStats { smooth_share: 0.01, ..clear.clone() };
    assert_eq!(flags(&speckled), [Flag::Glossy, Flag::Specular, Flag::Transmission]);
    let only = |s, t| Settings { only: Some(OnlyStrategy { s, t, weighted: true }), ..bounces(2) };
    let traced = |settings: Settings| runs(&plan(&clear, &settings), "caustics");
    assert_eq!([bounces(2), only(0, 4), only(4, 1)].map(traced), [1, 0, 1]);
    assert_eq!(runs(&plan(&clear, &bounces(0)), "caustics"), 0);
    // Neither the roughness clamp nor depth maps leave room for directions of a pixel's own.
    let clamped = Settings { clamp_samples: Some(16.0), ..bounces(2) };
    let fast = Settings { technique: Technique::FAST, ..bounces(2) };
    for settings in [clamped, fast, with(Strategies::Paper, 2)] {
        assert_eq!(plan(&glossy, &settings).surface_flags, [Flag::Glossy]);
    }
    assert_eq!(flags(&SceneStats { masked_triangles: 1, ..one_light() }), [Flag::Masks]);
    let mitsuba = SceneStats { conductors: true, plastics: true, ..glossy };
    assert_eq!(flags(&mitsuba), [Flag::Glossy, Flag::Specular, Flag::Conductors, Flag::Plastics]);
    let all = SceneStats { texels: 16, vertex_colors: true, glossy_triangles: 1, masked_triangles: 1, ..one_light() };
    let names = [Flag::Textures, Flag::VertexColors, Flag::Glossy, Flag::Masks, Flag::Specular];
    assert_eq!(flags(&all), names);
    let fast = |technique| plan(&one_light(), &Settings { technique, ..Settings::plain() });
    assert!(fast(Technique::FAST).fast && !fast(Technique::RASTER).fast);
    assert!(fast(Technique::FAST).node_words() > fast(Technique::RASTER).node_words());
    assert!(fast(Technique::FAST).has_depth_maps() && !fast(Technique::RASTER).has_depth_maps());
}

#[test]
fn bytes_grow_with_what_is_asked_for() {
    let bytes = |settings: &Settings| plan(&one_light(), settings).bytes;
    let lists = VisibilityFrom::Lists;
    let base = Settings { bundle_resolution: Some(128), visibility_from: lists, ..Settings::plain() };
    let small = bytes(&base);
    let image = |width, height| bytes(&Settings { width, height, ..base.clone() });
    // Buffers hold two bands' pixels; beyond, only the film, the G-buffer and the borders grow.
    assert!(image(256, 512) < small && image(512, 513) < small);
    assert_eq!(image(1024, 1024) - image(1024, 512), 1024 * 512 * 36);
    assert_eq!(plan(&one_light(), &Settings { width: 1024, height: 1024, ..base.clone() }).grid.count_bands(), [8, 0]);
    assert_eq!(plan(&one_light(), &base).grid.count_bands(), [1, 0]);
    assert!(bytes(&Settings { bundle_resolution: Some(256), ..base.clone() }) > small);
    assert!(bytes(&Settings { light_resolution: Some(512), ..base.clone() }) > small);
    assert!(bytes(&Settings { vpl_resolution: Some(512), ..base.clone() }) > small);
    assert!(bytes(&Settings { bounces: 3, ..base.clone() }) > small);
    let fast = Settings { technique: Technique::FAST, visibility_from: VisibilityFrom::Auto, ..base.clone() };
    assert_ne!(bytes(&fast), small);
    let grid = Settings { visibility_from: VisibilityFrom::Grid, ..base.clone() };
    assert!(bytes(&grid) < small, "views without lists");
    assert!(bytes(&Settings { strategies: Strategies::Bundle, ..base.clone() }) < small);
    let more = plan(&SceneStats { triangles: 100_000, ..one_light() }, &base).bytes;
    assert!(more > small);
    // A finer scene has finer views, within bounds.
    let resolution = |mean_triangle_size| {
        let plan = plan(&SceneStats { mean_triangle_size, ..one_light() }, &Settings::plain());
        [plan.bundle_resolution, plan.light_resolution, plan.vpl_resolution]
    };
    let (coarse, fine, finest) = (resolution(0.5), resolution(0.01), resolution(0.0));
    assert!(
        (0..3).all(|i| coarse[i] < fine[i] && fine[i] <= finest[i] && finest[i] <= 1024),
        "{coarse:?} {fine:?} {finest:?}"
    );
    // The maps of candidates, each queried by few pixels, are finer only if their resolution is part of the
    // answer.
    let pooled = |settings: Settings| {
        let stats = SceneStats { mean_triangle_size: 0.0, ..one_light() };
        plan_of(&stats, &Settings { light_pool: Some(8), ..settings }).light_resolution
    };
    let fast = Settings { technique: Technique::FAST, ..Settings::plain() };
    assert_eq!([pooled(Settings::plain()), pooled(fast)], [64, finest[1]]);
    // Settings override the plan's choice.
    assert_eq!(plan(&one_light(), &base).bundle_resolution, 128);
    assert_eq!(pooled(Settings { light_resolution: Some(256), ..Settings::plain() }), 256);
}

/// In a room lit from outside a light subpath that all pixels share counts less than the pixels' own subpaths, unless a
/// strategy is rendered alone.
#[test]
fn what_all_pixels_share_counts_less_than_what_is_their_own() {
    let glossy = SceneStats { glossy_triangles: 10, ..one_light() };
    let room = SceneStats { environment: true, camera_inside: true, ..glossy.clone() };
    let counts =
        |stats: &SceneStats, only| plan_of(stats, &Settings { only, ..bounces(2) }).sample_counts([0, 1, 1, 1]);
    assert_eq!(counts(&one_light(), None), [0.0, 1.0, 1.0, 1.0]);
    assert_eq!(counts(&glossy, None), [0.0, 1.0, 1.0, 1.0]);
    assert_eq!(counts(&room, None), [0.0, 1.0, 0.25, 0.25]);
    let only = |weighted| Some(OnlyStrategy { s: 2, t: 2, weighted });
    assert_eq!(counts(&room, only(true)), [0.0, 1.0, 0.25, 0.25]);
    assert_eq!(counts(&room, only(false)), [0.0, 1.0, 1.0, 1.0]);
}

/// Returns the side of the squares of interleaved sampling at 512x512, and its reason.
fn interleave(stats: &SceneStats, settings: &Settings) -> (u32, String) {
    let plan = plan_of(stats, settings);
    let row = plan.to_string().lines().find(|line| line.starts_with("interleave")).unwrap().to_owned();
    assert!(row.contains(&plan.interleave) && row.contains(&format!(" {} ", plan.grid.side)), "{row}");
    assert_eq!(plan.is_layered(), plan.grid.side > 1 || settings.history > 0);
    assert_eq!(plan.filtered, plan.grid.side > 1);
    (plan.grid.side, plan.interleave)
}

#[test]
fn the_side_of_squares_follows_from_what_views_and_pixels_cost() {
    let auto = Settings::default();
    let lamp = SceneStats { sharp_lights: 1, ..one_light() };
    let (side, why) = interleave(&lamp, &auto);
    assert!(side == 3 && why.starts_with("auto: by the model a light subpath takes 6."), "{side} {why}");
    let metals = SceneStats { glossy_triangles: 10, narrow_metals: true, ..lamp.clone() };
    assert_eq!(interleave(&metals, &auto).0, 3);
    assert_eq!(interleave(&metals, &Settings { clamp_samples: Some(16.0), ..auto.clone() }).0, 6);
    let lists = Settings { visibility_from: VisibilityFrom::Lists, ..auto.clone() };
    let sized = |triangles, mean_triangle_size| SceneStats { triangles, mean_triangle_size, ..lamp.clone() };
    let sponza = SceneStats {
        environment: true,
        environment_map: true,
        infinite_lights: true,
        local_lights: false,
        glossy_triangles: 1,
        ..sized(262_000, 0.004)
    };
    // Without rasterization in each iteration, light subpaths cost little.
    assert_eq!(interleave(&sponza, &auto).0, 3);
    let fine = sized(2_000_000, 0.001);
    assert_eq!([&auto, &lists].map(|settings| interleave(&fine, settings).0), [3, 1]);
    let (side, why) = interleave(&lamp, &Settings { width: 64, height: 64, ..auto.clone() });
    assert!(side == 1 && why.contains("pixels are few"), "{side} {why}");
    // The twin uses the random numbers of raster.
    assert_eq!(interleave(&lamp, &Settings { technique: Technique::TWIN, ..auto }).0, 3);
}

/// Lists are rasterized where triangles are few and pixels many; where a grid is cheaper, nothing is.
#[test]
fn views_are_rasterized_only_where_that_is_cheaper() {
    let views = |stats: &SceneStats, settings: &Settings| {
        let plan = plan_of(stats, settings);
        assert_eq!(plan.tracing.is_some(), plan.traces_camera, "{plan}");
        assert!(!(plan.traces_camera && plan.draws_borders), "{plan}");
        assert_eq!(plan.tracing.is_some(), runs(&plan, "gbuffer") == 0, "{plan}");
        plan
    };
    let auto = Settings { interleave: Some(1), ..Settings::default() };
    let lamp = SceneStats { sharp_lights: 1, ..one_light() };
    let few = views(&lamp, &auto);
    assert!(few.tracing.is_none() && few.rays_reason.contains("cheaper, by the model"), "{few}");
    let many = views(&SceneStats { triangles: 2_000_000, mean_triangle_size: 0.001, ..lamp.clone() }, &auto);
    assert_eq!(many.tracing, Some(Tracing::Grid));
    // The map around the lamp is kept, and costs nothing in later iterations.
    assert!(many.ray_views.bundles && many.ray_views.vpls && !many.ray_views.lights, "{many}");
    for (from, tracing) in [(VisibilityFrom::Lists, None), (VisibilityFrom::Grid, Some(Tracing::Grid))] {
        let asked = Settings { visibility_from: from, ..auto.clone() };
        let plan = views(&lamp, &asked);
        assert!(plan.tracing == tracing && plan.rays_reason.contains("as asked for"), "{plan}");
    }
    // Mirrors and glass need rays in any direction; diffuse surfaces do not.
    let glossy = SceneStats { glossy_triangles: 1, ..lamp.clone() };
    assert!(views(&glossy, &auto).ray_views.bundles && !views(&glossy, &auto).transmits());
    let glass = views(&SceneStats { transmits: true, ..glossy }, &auto);
    assert!(glass.transmits() && !glass.rasterizes_views());
    // Random numbers do not depend on the algorithm.
    for visibility in [Visibility::RayQuery, Visibility::Bvh] {
        let technique = Technique { visibility: Some(visibility), ..Technique::RASTER };
        let plan = plan_of(&lamp, &Settings { technique, ..Settings::default() });
        assert_eq!(plan.grid.side, plan_of(&lamp, &Settings::default()).grid.side);
        assert!(!plan.rasterizes_views());
    }
}

#[test]
fn the_side_is_one_where_nothing_is_to_be_filtered() {
    let lamp = SceneStats { sharp_lights: 1, ..one_light() };
    let auto = Settings::default();
    let only = OnlyStrategy { s: 1, t: 2, weighted: true };
    for (settings, what) in [
        (Settings { light_sampling: Some(LightSampling::Restir), ..auto.clone() }, "restir"),
        (Settings { only: Some(only), ..auto.clone() }, "alone"),
        (Settings { list_lengths: true, ..auto.clone() }, "lists"),
        (Settings { strategies: Strategies::Paper, ..auto.clone() }, "strategies"),
        (Settings { strategies: Strategies::Vpl, ..auto.clone() }, "strategies"),
        (Settings { aperture: Some(0.1), ..auto.clone() }, "lens"),
        (Settings { bounces: 0, ..auto.clone() }, "noise"),
    ] {
        settings.check().unwrap();
        let (side, why) = interleave(&lamp, &settings);
        assert!(side == 1 && why.starts_with("auto: ") && why.contains(what), "{side} {why}");
    }
    // These are a camera's own lens, and one with radius 0.
    let lens = SceneStats { lens: true, ..lamp.clone() };
    assert_eq!(interleave(&lens, &auto).0, 1);
    assert_eq!(interleave(&lens, &Settings { aperture: Some(0.0), ..auto.clone() }).0, 3);
    // Direct light alone has no noise here.
    let area = SceneStats { emissive_triangles: 2, ..dark() };
    assert_eq!(interleave(&area, &Settings { bounces: 0, ..auto.clone() }).0, 3);
    // Settings override the plan's choice.
    for side in 1..=8 {
        let asked = Settings { interleave: Some(side), strategies: Strategies::Vpl, ..auto.clone() };
        assert_eq!(interleave(&lens, &asked), (side, "as asked for".to_owned()));
    }
}

#[test]
fn tiles_settle_where_pictures_are_not_filtered() {
    let target = Settings { target_error: Some(0.01), ..Settings::default() };
    assert!(!plan_of(&one_light(), &target).adaptive);
    assert!(plan_of(&one_light(), &Settings { interleave: Some(1), ..target.clone() }).adaptive);
    assert!(plan_of(&one_light(), &Settings { width: 64, height: 64, ..target }).adaptive);
}

/// Another number of triangles alone gives the same plan as long as it does not change the side.
#[test]
fn poses_of_an_animation_have_the_same_side() {
    let at = |triangles| SceneStats { triangles, triangles_vary: true, ..one_light() };
    let plans = [60_000, 60_500].map(|triangles| plan_of(&at(triangles), &Settings::default()));
    assert!(plans[0].grid.side > 1 && plans[0].same_pipelines(&plans[1]));
}
