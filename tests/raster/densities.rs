//! Samples of `raster` and `twin` follow their densities, and the weights of all strategies add up.

use crate::common;

use std::f32::consts::{PI, TAU};

use common::gpu;
use common::harness::{NONE, run};
use common::shaders::{self, AimDraw, LightDraw, PathWeights, SkyDraw};
use common::statistics::{chi_square_tail, p_value};
use glam::{Mat3, Vec3};
use lightsheaf::gpu::{Compute, Flag, Gpu, rows};
use lightsheaf::render::layouts::light_kind::{AREA, DIRECTIONAL, POINT, SKY, SPOT};
use lightsheaf::render::layouts::line_end::{AT_LATER, AT_Z1};
use lightsheaf::render::layouts::rsm_size::RSM_SIDE;
use lightsheaf::render::layouts::{FoundLine, LightPoint, Lighting};
use lightsheaf::render::lights::aims::Aims;
use lightsheaf::render::lights::bundle_directions::BundleDirections;
use lightsheaf::render::lights::sky_guide::{EXTENT, HEIGHT, SIDE, densities};
use lightsheaf::render::lights::table::{Hittable, LightTable};
use lightsheaf::render::sampler::{Decision, Sampler, uniform_sphere};
use lightsheaf::render::upload::gpu_scene::GpuScene;
use lightsheaf::scene::{self, Environment, EnvironmentMap, Geometry, Rows, versine};

/// Draws, and paths.
const MANY: u32 = 1 << 20;
/// Significance, Sidak-corrected for the number of tests.
const SIGNIFICANCE: f64 = 0.01;
/// A bit of LightPoint.traits (lib/lights/light.wesl).
const TWO_SIDED_LIGHT: u32 = 1;
/// Bins along two axes.
const BINS: [usize; 2] = [32, 32];
/// Rays along a side of a bin whose density is taken.
const RAYS: usize = 32;

/// Returns, for paths of one bounce and of two, the sum of the weights times their sample counts, and the
/// largest distance of a term from its share in the products of counts and densities.
fn weights(gpu: &Gpu, sample_counts: [f32; 4], beta: f32, kind: u32) -> Vec<[f32; 4]> {
    let pass = Compute::from_source(gpu, "path_weights", &shaders::PATH_WEIGHTS, &[]);
    let uniform = gpu.uniform::<PathWeights>("of_paths");
    gpu.queue.write_buffer(
        &uniform,
        0,
        bytemuck::bytes_of(&PathWeights { sample_counts, beta, kind, ..Default::default() }),
    );
    let sums = gpu.storage("weight_sums", u64::from(MANY) * 16);
    let bindings = [("of_paths", uniform.as_entire_binding()), ("weight_sums", sums.as_entire_binding())];
    run(gpu, &pass, &bindings, rows(MANY), (&sums, MANY as usize))
}

/// Sample counts of the strategies: all and subsets, a pool of 16 light candidates, and one sample per light,
/// which counts as 1 / p samples of a light that is chosen with p = 0.3. The plan has the latter two in
/// direct light, where s = 2 and 3 do not exist; the weights hold with them, too.
const SAMPLE_COUNTS: [[f32; 4]; 10] = [
    [1.0, 1.0, 1.0, 1.0],
    [1.0, 1.0, 1.0, 0.0],
    [0.0, 1.0, 1.0, 1.0],
    [1.0, 1.0, 0.0, 0.0],
    [1.0, 16.0, 0.0, 0.0],
    [1.0, 1.0 / 0.3, 0.0, 0.0],
    [1.0, 16.0, 1.0, 1.0],
    [0.0, 1.0 / 0.3, 1.0, 1.0],
    [1.0, 1.0, 0.25, 0.25],
    [0.0, 4.0 / 0.3, 0.25, 0.25],
];

#[test]
fn weights_sum_to_one() {
    let Some(gpu) = gpu() else { return };
    for (light, kind) in [("point", POINT), ("triangle", AREA), ("sky", SKY)] {
        for beta in [1.0, 2.0] {
            for sample_counts in SAMPLE_COUNTS {
                let sums = weights(gpu, sample_counts, beta, kind);
                let worst = |of: fn(&[f32; 4]) -> f32| sums.iter().map(of).fold(0.0, f32::max);
                let sum = worst(|s| (s[0] - 1.0).abs().max((s[2] - 1.0).abs()));
                let apart = worst(|s| s[1].max(s[3]));
                println!("{light}, {sample_counts:?}, beta {beta}: sums within {sum:e}, weights within {apart:e}");
                assert!(sum <= 1e-5 && apart <= 1e-5, "{light}, {sample_counts:?}, beta {beta}: {sum} {apart}");
            }
        }
    }
}

/// Returns draws of the sampler, or densities of given rays.
fn ask(gpu: &Gpu, y0: &LightPoint, table: &[f32], questions: &[LightDraw]) -> Vec<LightDraw> {
    let pass = Compute::from_source(gpu, "light_draws", &shaders::LIGHT_DRAWS, &[Flag::Rsm, Flag::Punctual]);
    let y0 = gpu.upload("y0", std::slice::from_ref(y0));
    let lighting = gpu.uniform::<Lighting>("lighting");
    gpu.queue.write_buffer(&lighting, 0, bytemuck::bytes_of(&Lighting { radius: 2.0, ..Default::default() }));
    let (table, draws) = (gpu.upload("rsm", table), gpu.upload("light_draws", questions));
    let bindings = [
        ("y0", y0.as_entire_binding()),
        ("lighting", lighting.as_entire_binding()),
        ("rsm", table.as_entire_binding()),
        ("light_draws", draws.as_entire_binding()),
    ];
    run(gpu, &pass, &bindings, rows(questions.len() as u32), (&draws, questions.len()))
}

/// True if rays come from infinity.
fn disc(kind: u32) -> bool {
    kind == DIRECTIONAL || kind == SKY
}

/// Returns cosine and azimuth about Y of a direction, or the place on the square around a disc of radius 2
/// across Y, in [0, 1]^2.
fn place(kind: u32, draw: &LightDraw) -> [f32; 2] {
    let (w, offset) = (Vec3::from(draw.w), Vec3::from(draw.offset));
    if disc(kind) {
        return [0.25 * offset.x + 0.5, 0.25 * offset.z + 0.5];
    }
    [0.5 * w.y + 0.5, w.z.atan2(w.x).rem_euclid(TAU) / TAU]
}

/// Returns the ray at a place.
fn ray(kind: u32, [x, y]: [f32; 2], axis: Vec3) -> LightDraw {
    if disc(kind) {
        let offset = Vec3::new(4.0 * x - 2.0, 0.0, 4.0 * y - 2.0);
        return LightDraw { w: axis.to_array(), offset: offset.to_array(), asked: 1, pdf: 0.0 };
    }
    let z = 2.0 * x - 1.0;
    let (sin, cos) = (TAU * y).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    LightDraw { w: [r * cos, z, r * sin], asked: 1, ..Default::default() }
}

#[test]
fn light_subpaths_start_as_their_density_says() {
    let Some(gpu) = gpu() else { return };
    let down = Vec3::NEG_Y;
    let light = |name, kind, direction: Vec3| {
        let outer_versine = if kind == SPOT { versine(0.9) } else { 2.0 };
        (name, LightPoint { kind, direction: direction.to_array(), p: 1.0, outer_versine, ..Default::default() })
    };
    let tilted = Vec3::new(0.6, 0.0, 0.8);
    let mut two_sided = light("triangle, two sides", AREA, tilted);
    two_sided.1.traits = TWO_SIDED_LIGHT;
    let lights = [
        light("point", POINT, Vec3::Z),
        light("spot", SPOT, tilted),
        light("directional", DIRECTIONAL, down),
        light("triangle", AREA, tilted),
        two_sided,
        light("sky", SKY, down),
    ];
    // Importances differ by up to a hundred times from cell to cell, with a mean of 1.
    let cells = (RSM_SIDE * RSM_SIDE) as usize;
    let sampler = |i: usize| Sampler::new(7, i as u64).get(Decision::Light);
    let table: Vec<f32> = (0..cells).map(|i| 0.1 + 10.0 * sampler(i).powi(3)).collect();
    let mean = table.iter().sum::<f32>() / cells as f32;
    let table: Vec<f32> = table.iter().map(|v| v / mean).collect();
    for (name, light) in lights {
        let drawn = ask(gpu, &light, &table, &vec![LightDraw::default(); MANY as usize]);
        let mut counts = vec![0_u64; BINS[0] * BINS[1]];
        for draw in &drawn {
            let [x, y] = place(light.kind, draw);
            let bin = |x: f32, bins: usize| ((x * bins as f32) as usize).min(bins - 1);
            counts[bin(x, BINS[0]) * BINS[1] + bin(y, BINS[1])] += 1;
        }
        // The density of a draw is the one that MIS uses, but for rounding at the borders of cells.
        let again: Vec<_> = drawn.iter().map(|d| LightDraw { asked: 1, ..*d }).collect();
        let again = ask(gpu, &light, &table, &again);
        let differ = drawn.iter().zip(&again).filter(|(a, b)| (a.pdf / b.pdf - 1.0).abs() > 1e-3).count();
        assert!(differ < drawn.len() / 1000, "{name}: {differ} densities differ");

        let at = |bin: usize, sub: usize, bins: usize| (bin as f32 + (sub as f32 + 0.5) / RAYS as f32) / bins as f32;
        let questions: Vec<_> = (0..BINS[0] * BINS[1] * RAYS * RAYS)
            .map(|i| {
                let (bin, sub) = (i / (RAYS * RAYS), i % (RAYS * RAYS));
                let x = at(bin / BINS[1], sub / RAYS, BINS[0]);
                ray(light.kind, [x, at(bin % BINS[1], sub % RAYS, BINS[1])], down)
            })
            .collect();
        let measure = if disc(light.kind) { 16.0 } else { 4.0 * PI } / questions.len() as f32;
        let bins = |light: &LightPoint, table: &[f32], factor: fn(f32) -> f32| -> Vec<f64> {
            let answers = ask(gpu, light, table, &questions);
            // MIS uses only points within the scene's sphere.
            let shade = |d: &LightDraw| {
                let r = Vec3::from(d.offset).length();
                if disc(light.kind) && r > 2.0 { 0.0 } else { f64::from(d.pdf * factor(r) * measure) }
            };
            let bins = answers.chunks_exact(RAYS * RAYS);
            bins.map(|bin| bin.iter().map(shade).sum::<f64>() * f64::from(MANY)).collect()
        };
        let expected = bins(&light, &table, |_| 1.0);
        let mass = expected.iter().sum::<f64>() / f64::from(MANY);
        assert!((mass - 1.0).abs() < 2e-3, "{name}: the density integrates to {mass}");
        // The quadrature has an error at the borders of cells, which is smaller in larger bins.
        let pool = |values: &mut dyn Iterator<Item = f64>| {
            let all: Vec<f64> = values.collect();
            let side = 8;
            (0..BINS[0] / side * (BINS[1] / side))
                .map(|i| {
                    let (row, column) = (i / (BINS[1] / side) * side, i % (BINS[1] / side) * side);
                    (0..side * side).map(|k| all[(row + k / side) * BINS[1] + column + k % side]).sum()
                })
                .collect::<Vec<f64>>()
        };
        let expected = pool(&mut expected.iter().map(|e| e / mass));
        let counts = pool(&mut counts.iter().map(|&c| c as f64));
        let counts: Vec<u64> = counts.iter().map(|&c| c as u64).collect();
        let p = p_value(&counts, &expected);
        println!("{name}: p {p:.3}, mass {mass:.5}");
        assert!(p > 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / 6.0), "{name}: p {p}");
        // A wrong density is found: one without the table, a uniform one, or one that grows outwards.
        let has_table = light.kind <= DIRECTIONAL;
        let even = LightPoint { kind: if has_table || disc(light.kind) { light.kind } else { POINT }, ..light };
        let flat = bins(&even, &vec![1.0; cells], if light.kind == SKY { |r| 0.75 * r } else { |_| 1.0 });
        assert!(p_value(&counts, &pool(&mut flat.into_iter())) < 1e-6, "{name}: a wrong density was not noticed");
    }
}

/// Half the extent of the scene's box, in a sphere of radius 2.
const HALF: [f32; 3] = [1.5, 1.0, 0.8];

/// Asks for samples or densities of the sky's guide, under an even sky around a sphere of radius 2.
fn ask_sky(gpu: &Gpu, guide: &[f32], questions: &[SkyDraw]) -> Vec<SkyDraw> {
    let pass = Compute::from_source(gpu, "sky_draws", &shaders::SKY_DRAWS, &[Flag::Environment, Flag::SkyGuide]);
    let lighting = gpu.uniform::<Lighting>("lighting");
    gpu.queue.write_buffer(
        &lighting,
        0,
        bytemuck::bytes_of(&Lighting { radius: 2.0, half_extent: HALF, ..Default::default() }),
    );
    let size = wgpu::Extent3d { width: SIDE, height: HEIGHT, depth_or_array_layers: 1 };
    let texels = gpu.texture(&wgpu::TextureDescriptor {
        label: Some("sky_guide"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(SIDE * 4), rows_per_image: None };
    gpu.queue.write_texture(texels.as_image_copy(), bytemuck::cast_slice(guide), layout, size);
    let view = texels.create_view(&Default::default());
    let draws = gpu.upload("sky_draws", questions);
    let bindings = [
        ("lighting", lighting.as_entire_binding()),
        ("sky_guide", wgpu::BindingResource::TextureView(&view)),
        ("sky_draws", draws.as_entire_binding()),
    ];
    run(gpu, &pass, &bindings, rows(questions.len() as u32), (&draws, questions.len()))
}

/// Directions to the sky, and lines along one of them, are as frequent as the densities of MIS say, for a guide of
/// light that comes from about one direction through one place.
#[test]
fn light_of_the_sky_follows_its_guide() {
    const EVEN_STEPS: usize = 1 << 10;
    const RUNS: usize = 10;
    let Some(gpu) = gpu() else { return };
    let sampler = |i: u32| Sampler::new(3, u64::from(i));
    // Light that comes from about `middle` through a place beside the scene's centre.
    let middle = Vec3::new(-0.4, 0.4, 0.2).normalize();
    let line = |i: u32, middle: Vec3| {
        let ([x, y], [u, v]) = (sampler(i).get2(Decision::Y1), sampler(i).get2(Decision::Y2));
        let w = (middle + 0.2 * (Vec3::new(x, y, u) - 0.5)).normalize();
        let offset = Vec3::new(0.3, 0.5, 0.0) + 0.1 * Vec3::new(u, v, x);
        let vertex = if i.is_multiple_of(3) { AT_Z1 } else { AT_LATER };
        FoundLine { w: w.to_array(), value: 1.0 + x, offset: offset.to_array(), vertex }
    };
    let around = |middle: Vec3| (0..4096).map(|i| line(i, middle)).collect::<Vec<_>>();
    let found = around(middle);
    let half = Vec3::from(HALF) / (2.0 * EXTENT);
    let densities = |found: &[FoundLine]| densities(found, half);
    let guide = densities(&found);
    // A fifth of the density is even.
    let halved: Vec<f32> = guide.iter().map(|density| 1.125 * density - 0.125).collect();
    // Densities that are told but not drawn from.
    let planted = [
        ("an even one", densities(&[])),
        ("one of the first 16 finds", densities(&found[..16])),
        ("one that is a cell of directions off", densities(&around(middle + Vec3::new(0.0, 0.0, 0.1)))),
        ("one with half of the even part", halved),
    ];
    let bin = |x: f32| ((x * 16.0) as usize).min(15);
    let check = |name: &str,
                 drawn: Vec<SkyDraw>,
                 asked: u32,
                 place: &dyn Fn(&SkyDraw) -> [f32; 2],
                 all: Vec<SkyDraw>,
                 planted: &[(&str, Vec<f32>)]| {
        let again: Vec<_> = drawn.iter().map(|d| SkyDraw { asked, ..*d }).collect();
        let again = ask_sky(gpu, &guide, &again);
        let differ = drawn.iter().zip(&again).filter(|(a, b)| (a.pdf / b.pdf - 1.0).abs() > 1e-3).count();
        assert!(differ < drawn.len() / 1000, "{name}: {differ} densities differ");
        let mut runs = vec![vec![0_u64; 256]; RUNS];
        for (i, [x, y]) in drawn.iter().map(place).enumerate() {
            runs[i % RUNS][bin(y) * 16 + bin(x)] += 1;
        }
        let counts: Vec<u64> = (0..256).map(|bin| runs.iter().map(|run| run[bin]).sum()).collect();
        let expected = |guide: &[f32]| {
            let mut bins = vec![0.0; 256];
            let answers = ask_sky(gpu, guide, &all);
            for ([x, y], answer) in all.iter().map(place).zip(answers) {
                bins[bin(y) * 16 + bin(x)] += f64::from(answer.pdf) * f64::from(all[0].pdf);
            }
            bins
        };
        let right = expected(&guide);
        let mass: f64 = right.iter().sum();
        let counted = |bins: &[f64], draws: f64| bins.iter().map(|b| b / mass * draws).collect::<Vec<_>>();
        let p = p_value(&counts, &counted(&right, f64::from(MANY)));
        let noticed = |bins: &[f64]| {
            let expected = counted(bins, f64::from(MANY) / RUNS as f64);
            runs.iter().filter(|run| p_value(run, &expected) < SIGNIFICANCE / RUNS as f64).count()
        };
        println!("{name}: p {p:.3}, mass {mass:.5}");
        assert!((mass - 1.0).abs() < 2e-3, "{name}: the density integrates to {mass}");
        assert!(p > 0.5 * SIGNIFICANCE, "{name}: p {p}");
        assert_eq!(noticed(&right), 0, "{name}: the right density");
        for (what, guide) in planted {
            let noticed = noticed(&expected(guide));
            println!("{name}: {what} in place of the density is noticed in {noticed} of {RUNS} runs");
            assert!(noticed + 1 >= RUNS, "{name}: {what}, noticed in {noticed} of {RUNS} runs");
        }
    };
    // Steps are jittered, so that the borders of cells do not fall between them in a row.
    let steps = || {
        (0..EVEN_STEPS * EVEN_STEPS).map(|i| {
            let [u, v] = Sampler::new(11, i as u64).get2(Decision::Y2);
            [((i % EVEN_STEPS) as f32 + u) / EVEN_STEPS as f32, ((i / EVEN_STEPS) as f32 + v) / EVEN_STEPS as f32]
        })
    };
    let total = (EVEN_STEPS * EVEN_STEPS) as f32;
    // Bins of the sphere: height and azimuth, in which steps of equal area are even.
    let directions = steps().map(|[x, y]| {
        let (z, (sin, cos)) = (2.0 * y - 1.0, (TAU * x).sin_cos());
        let r = (1.0 - z * z).max(0.0).sqrt();
        SkyDraw { w: [r * cos, r * sin, z], asked: 1, pdf: 4.0 * PI / total, ..Default::default() }
    });
    let drawn = ask_sky(gpu, &guide, &vec![SkyDraw::default(); MANY as usize]);
    let on_sphere = |d: &SkyDraw| [d.w[1].atan2(d.w[0]).rem_euclid(TAU) / TAU, 0.5 * d.w[2] + 0.5];
    check("directions", drawn, 1, &on_sphere, directions.clone().collect(), &planted);
    // Lines along the middle of what was found; a line is where it meets the plane through the centre across it.
    let w = middle;
    let (right, up) = w.any_orthonormal_pair();
    let side = 4.4;
    let lines = steps().map(|[x, y]| {
        let offset = right * (side * (x - 0.5)) + up * (side * (y - 0.5)) + w * 0.3;
        SkyDraw { w: w.to_array(), offset: offset.to_array(), asked: 3, pdf: side * side / total }
    });
    let drawn = ask_sky(gpu, &guide, &vec![SkyDraw { w: w.to_array(), asked: 2, ..Default::default() }; MANY as usize]);
    let across = |d: &SkyDraw| [right, up].map(|axis| Vec3::from(d.offset).dot(axis) / side + 0.5);
    check("lines", drawn, 3, &across, lines.collect(), &planted);
    // Directions at a point that the light passes, of which none are even.
    let offset = (2.0 * EXTENT * Vec3::new(0.35, 0.55, 0.05)).to_array();
    let directions = directions.map(|d| SkyDraw { offset, asked: 5, ..d });
    let drawn = ask_sky(gpu, &guide, &vec![SkyDraw { offset, asked: 4, ..Default::default() }; MANY as usize]);
    check("directions at a point", drawn, 5, &on_sphere, directions.collect(), &planted[..3]);
}

#[test]
fn bundles_go_everywhere_alike() {
    for bundle in [0, 1, 2, 63] {
        let mut counts = vec![0_u64; BINS[0] * BINS[1]];
        for seed in 0..MANY {
            // One point of each of many sequences gives independent numbers.
            let w = uniform_sphere(Sampler::new(seed, 5).get2(Decision::Bundle(bundle)));
            let bin = |x: f32, bins: usize| ((x * bins as f32) as usize).min(bins - 1);
            counts[bin(0.5 * w.z + 0.5, BINS[0]) * BINS[1] + bin(w.y.atan2(w.x).rem_euclid(TAU) / TAU, BINS[1])] += 1;
        }
        let expected = vec![f64::from(MANY) / counts.len() as f64; counts.len()];
        let p = p_value(&counts, &expected);
        println!("bundle {bundle}: p {p:.3}");
        assert!(p > 1.0 - (1.0 - SIGNIFICANCE).powf(0.25), "bundle {bundle}: p {p}");
    }
}

/// Under a sky with a map, bundle directions follow eq. (2): their frequency is that of the table, which
/// integrates to 1 over a hemisphere.
#[test]
fn bundles_go_where_the_sky_is_bright() {
    let texels: Vec<[f32; 3]> = (0..64 * 32).map(|i| [if i % 64 < 3 { 30.0 } else { i as f32 * 1e-4 }; 3]).collect();
    for rows in [Rows::Centred, Rows::AtPoles] {
        let map = EnvironmentMap { width: 64, height: 32, texels: texels.clone(), rows };
        let turned = Mat3::from_rotation_x(0.7) * Mat3::from_rotation_y(2.0);
        let sky = Environment { radiance: Vec3::ONE, map: Some(map), world_from_environment: turned };
        let directions = BundleDirections::new(&sky).unwrap();
        let [height, width] = [BundleDirections::ROWS, BundleDirections::COLUMNS];
        let cell = |w: Vec3| {
            let row = ((0.5 - 0.5 * w.y) * height as f32) as usize;
            row.min(height - 1) * width
                + ((w.z.atan2(w.x).rem_euclid(TAU) / TAU * width as f32) as usize).min(width - 1)
        };
        let pool = |counts: &[f64]| -> Vec<f64> {
            let block = |i: usize| {
                let (row, column) = (i / 16 * 8, i % 16 * 16);
                (0..128).map(|k| counts[(row + k / 16) * width + column + k % 16]).sum()
            };
            (0..256).map(block).collect()
        };
        let mut counts = vec![0.0; height * width];
        for seed in 0..MANY {
            counts[cell(directions.draw(Sampler::new(seed, 5).get2(Decision::Bundle(0))))] += 1.0;
        }
        let solid_angle = 4.0 * PI / (height * width) as f32;
        // Each of w and -w has half of it.
        let masses: Vec<f64> = directions.pdfs.iter().map(|p| f64::from(0.5 * p * solid_angle)).collect();
        let mass: f64 = masses.iter().sum();
        assert!((mass - 1.0).abs() < 1e-4, "{mass}");
        let counts: Vec<u64> = pool(&counts).iter().map(|&c| c as u64).collect();
        let expected: Vec<f64> = pool(&masses).iter().map(|m| m * f64::from(MANY)).collect();
        let p = p_value(&counts, &expected);
        println!("{rows:?}: p {p:.3}");
        assert!(p > 0.5 * SIGNIFICANCE, "{rows:?}: p {p}");
        let even = vec![f64::from(MANY) / 256.0; 256];
        assert!(p_value(&counts, &even) < 1e-6, "an even density was not noticed");
        // Directions towards bright parts of the sky are denser, and so are the opposite ones.
        let bright = turned * Vec3::new(0.1, 0.0, -1.0).normalize();
        let dark = turned * Vec3::X;
        let at = |w: Vec3| directions.pdfs[cell(w)];
        assert!(at(bright) > 3.0 * at(dark) && at(-bright) > 3.0 * at(dark), "{} {}", at(bright), at(dark));
    }
    let black = EnvironmentMap { width: 2, height: 1, texels: vec![[0.0; 3]; 2], rows: Rows::Centred };
    let black = Environment { radiance: Vec3::ONE, map: Some(black), world_from_environment: Mat3::IDENTITY };
    assert!(BundleDirections::new(&black).is_none());
}

#[test]
fn the_distribution_of_chi_square_is_right() {
    // Tables say that 3.841 at 1, 18.307 at 10 and 124.342 at 100 degrees of freedom have a tail of 5 %, and
    // 23.209 at 10 of 1 %.
    for (x, dof, p) in
        [(3.841, 1.0, 0.05), (18.307, 10.0, 0.05), (124.342, 100.0, 0.05), (23.209, 10.0, 0.01), (5.0, 20.0, 0.9997)]
    {
        let actual = chi_square_tail(x, dof);
        assert!((actual / p - 1.0).abs() < 0.01, "{x} at {dof}: {actual}");
    }
}

/// Light paths are aimed at triangles as often as the density there says, and evenly within each. Densities of two
/// materials that are wrong by a tenth are noticed.
#[test]
fn aims_are_drawn_as_their_density_says() {
    let Some(gpu) = gpu() else { return };
    let scene = scene::load("builtin:cornell_spheres").unwrap();
    let geometry = Geometry::new(&scene);
    let table = LightTable::new(&scene, &geometry, Hittable::All);
    let lights = LightTable { aims: Aims::new(&scene, &geometry), ..table };
    let uploaded = GpuScene::new(gpu, &scene, &geometry, &lights, &[]).unwrap();
    let pass = Compute::from_source(gpu, "aim_draws", &shaders::AIM_DRAWS, &[]);
    let ask = |questions: &[AimDraw]| -> Vec<AimDraw> {
        let draws = gpu.upload("aim_draws", questions);
        let bindings = uploaded.with(&[("aim_draws", draws.as_entire_binding())]);
        run(gpu, &pass, &bindings, rows(questions.len() as u32), (&draws, questions.len()))
    };
    let triangles = geometry.triangles.len();
    let all: Vec<_> =
        (0..triangles as u32).map(|triangle| AimDraw { triangle, asked: 1, ..Default::default() }).collect();
    let normal = |t: usize| {
        let [a, b, c] = geometry.positions(t);
        (b - a).cross(c - a)
    };
    // Triangles by material and size, since spheres have thousands, and draws without an aim.
    let bin_of = |t: usize| geometry.materials[t] as usize * 64 + t % 64;
    let bins = 64 * scene.materials.len() + 1;
    let (mut expected, mut counts) = (vec![0.0; bins], vec![0_u64; bins]);
    for (t, answer) in ask(&all).iter().enumerate() {
        expected[bin_of(t)] += f64::from(answer.pdf_a) * 0.5 * f64::from(normal(t).length()) * f64::from(MANY);
    }
    let aimed: f64 = expected.iter().sum();
    assert!((aimed / f64::from(MANY) - 0.5).abs() < 1e-4, "half of the paths are aimed: {aimed}");
    expected[bins - 1] = f64::from(MANY) - aimed;
    let mut evens = [0_u64; 64];
    for draw in ask(&vec![AimDraw::default(); MANY as usize]) {
        if draw.triangle == NONE {
            counts[bins - 1] += 1;
            continue;
        }
        let t = draw.triangle as usize;
        counts[bin_of(t)] += 1;
        // For points uniform over the area, the weight w of a corner has a uniform 1 - (1 - w)^2.
        let ([_, b, c], x, normal) = (geometry.positions(t), Vec3::from(draw.position), normal(t));
        let weight = ((b - x).cross(c - x).dot(normal) / normal.length_squared()).clamp(0.0, 1.0);
        evens[((1.0 - (1.0 - weight).powi(2)) * 64.0).min(63.0) as usize] += 1;
    }
    let drawn: u64 = evens.iter().sum();
    let even = p_value(&evens, &[drawn as f64 / 64.0; 64]);
    let p = p_value(&counts, &expected);
    println!(
        "triangles: p {p:.4}; points within: p {even:.4}; {} of {triangles} triangles",
        lights.aims.triangles.len()
    );
    assert!(p >= SIGNIFICANCE / 8.0 && even >= SIGNIFICANCE / 8.0, "{p} {even}");
    let mut wrong = expected.clone();
    let of_materials: Vec<_> = (0..bins - 1).step_by(64).filter(|&first| wrong[first] > 0.0).take(2).collect();
    for (first, factor) in of_materials.into_iter().zip([1.1, 0.9]) {
        wrong[first..first + 64].iter_mut().for_each(|expected| *expected *= factor);
    }
    assert!(p_value(&counts, &wrong) < 1e-6, "a wrong density is not noticed");
}
