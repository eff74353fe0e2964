//! BSDFs of the reference: sampling against density (chi-square), reciprocity, energy, and agreement of the two.

use std::f64::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use lightsheaf::reference::bsdf::Bsdf;
use lightsheaf::reference::microfacet;
use lightsheaf::scene::Fresnel;

fn all() -> Vec<(String, Bsdf)> {
    let mut all = vec![("diffuse".to_owned(), Bsdf::Diffuse { albedo: Vec3::new(0.3, 0.6, 0.9) })];
    for alpha in [0.08, 0.3, 0.9] {
        all.push((
            format!("conductor {alpha}"),
            Bsdf::Conductor { alpha, fresnel: Fresnel::None, specular: Vec3::new(0.9, 0.7, 0.4) },
        ));
        let fresnel = Fresnel::Conductor { eta: Vec3::new(0.2, 0.9, 1.1), k: Vec3::new(3.9, 2.4, 2.2) };
        all.push((format!("gold {alpha}"), Bsdf::Conductor { alpha, fresnel, specular: Vec3::ONE }));
        let inner = microfacet::internal_diffuse_reflectance(1.5);
        let base = Vec3::new(0.2, 0.5, 0.9) / (2.25 * (1.0 - inner));
        all.push((format!("plastic {alpha}"), Bsdf::Plastic { alpha, base, specular: Vec3::ONE, eta: 1.5 }));
        for metallic in [0.0, 0.4, 1.0] {
            let (base, f0) = (Vec3::new(0.9, 0.5, 0.2), Vec3::splat(0.04));
            let bsdf = Bsdf::MetallicRoughness { base, metallic, alpha, f0, f90: 1.0 };
            all.push((format!("glTF {alpha} metallic {metallic}"), bsdf));
        }
    }
    all
}

fn observers() -> [Vec3; 3] {
    [(1.0, 0.0), (0.6, 1.0), (0.15, 4.0)].map(|(z, phi): (f32, f32)| {
        let s = (1.0 - z * z).sqrt();
        Vec3::new(s * phi.cos(), s * phi.sin(), z)
    })
}

/// Upper tail of the chi-square distribution as a standard normal deviate (Wilson and Hilferty 1931).
fn deviate(statistic: f64, freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    ((statistic / freedom).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Chi-square statistic of 200,000 samples against the density in bins of equal solid angle, and how many bins there were.
/// Samples that leave below the surface make one more bin. `scale` falsifies the density.
fn chi_square(bsdf: &Bsdf, wo: Vec3, seed: u64, scale: f64) -> (f64, f64) {
    let (nz, np, fine, count) = (24, 48, 24, 200_000);
    let mut expected = vec![0.0; nz * np];
    for (bin, expected) in expected.iter_mut().enumerate() {
        for i in 0..fine * fine {
            let z = ((bin / np) as f64 + (f64::from(i / fine) + 0.5) / f64::from(fine)) / nz as f64;
            let phi = ((bin % np) as f64 + (f64::from(i % fine) + 0.5) / f64::from(fine)) / np as f64 * TAU;
            let s = (1.0 - z * z).sqrt();
            let wi = Vec3::new((s * phi.cos()) as f32, (s * phi.sin()) as f32, z as f32);
            *expected += f64::from(bsdf.evaluate(wo, wi).1);
        }
        *expected *= TAU / (nz * np) as f64 / f64::from(fine * fine) * f64::from(count) * scale;
    }
    let below = (f64::from(count) - expected.iter().sum::<f64>()).max(0.0);
    let mut met = vec![0.0; nz * np];
    let mut lost = 0.0;
    let mut random = seed;
    let mut next = || {
        // PCG with a permuted output (XSH-RR).
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let shifted = (((random >> 18) ^ random) >> 27) as u32;
        (shifted.rotate_right((random >> 59) as u32) >> 8) as f32 / (1 << 24) as f32
    };
    for _ in 0..count {
        let Some(sample) = bsdf.sample(wo, Vec2::new(next(), next())) else {
            lost += 1.0;
            continue;
        };
        assert!((sample.wi.length() - 1.0).abs() < 1e-4);
        let phi = f64::from(sample.wi.y.atan2(sample.wi.x)).rem_euclid(TAU);
        let (i, j) = ((f64::from(sample.wi.z) * nz as f64) as usize, (phi / TAU * np as f64) as usize);
        met[i.min(nz - 1) * np + j.min(np - 1)] += 1.0;
    }
    // Bins of fewer than 8 are pooled.
    let (mut statistic, mut freedom, mut pool) = (0.0, -1.0, (lost, below));
    for (&met, &expected) in met.iter().zip(&expected) {
        if expected < 8.0 {
            pool = (pool.0 + met, pool.1 + expected);
        } else {
            statistic += (met - expected) * (met - expected) / expected;
            freedom += 1.0;
        }
    }
    if pool.1 >= 8.0 {
        statistic += (pool.0 - pool.1) * (pool.0 - pool.1) / pool.1;
        freedom += 1.0;
    } else {
        assert!(pool.0 < 30.0, "{} samples where {} were expected", pool.0, pool.1);
    }
    assert!(freedom >= 3.0, "the test has something to test");
    (statistic, freedom)
}

#[test]
fn samples_follow_their_density() {
    // One test of significance 1 % over all pairs (Sidak): with 66 of them, 0.015 % each, a deviate of 3.6.
    let mut tests = 0;
    for (name, bsdf) in all() {
        for (i, wo) in observers().into_iter().enumerate() {
            let (statistic, freedom) = chi_square(&bsdf, wo, 17 + i as u64, 1.0);
            let z = deviate(statistic, freedom);
            assert!(
                z < 3.6,
                "{name}, wo {wo}: chi-square {statistic:.0} with {freedom} degrees of freedom, deviate {z:.1}"
            );
            tests += 1;
        }
    }
    assert_eq!(tests, 57);
}

#[test]
fn canary_a_density_that_is_off_is_rejected() {
    for (name, bsdf) in all() {
        let (statistic, freedom) = chi_square(&bsdf, observers()[1], 3, 0.97);
        assert!(deviate(statistic, freedom) > 5.0, "{name}: {statistic:.0} with {freedom}");
    }
}

#[test]
fn reciprocity() {
    let directions: Vec<Vec3> = (1..20).map(|i| f32_direction(i as f32 * 0.05, i as f32 * 2.4)).collect();
    for (name, bsdf) in all() {
        let mut positive = 0;
        for &a in &directions {
            for &b in &directions {
                let forth = bsdf.evaluate(a, b).0 / b.z;
                let back = bsdf.evaluate(b, a).0 / a.z;
                let size = forth.max_element().max(1e-6);
                assert!((forth - back).abs().max_element() < 1e-4 * size, "{name} {a} {b}: {forth} {back}");
                positive += u32::from(forth.min_element() > 0.0);
            }
        }
        assert!(positive > 300, "{name}: {positive}");
    }
}

fn f32_direction(z: f32, phi: f32) -> Vec3 {
    let s = (1.0 - z * z).sqrt();
    Vec3::new(s * phi.cos(), s * phi.sin(), z)
}

/// What is reflected by sampling equals what is reflected by quadrature, and is never more than what came in, except by glTF's
/// dielectric: it weighs base against coat by Fresnel's term at the half vector, and at grazing angles both get too much.
#[test]
fn energy() {
    for (name, bsdf) in all() {
        for wo in observers() {
            let mut sampled = [0.0_f64; 3];
            let count = 1 << 14;
            for i in 0..count {
                let [x, y, ..] = sobol_burley::sample_4d(i, 0, 9);
                if let Some(sample) = bsdf.sample(wo, Vec2::new(x, y)) {
                    (0..3).for_each(|c| sampled[c] += f64::from(sample.weight[c]) / f64::from(count));
                }
            }
            let mut integrated = [0.0_f64; 3];
            let n = 600;
            for i in 0..n * n {
                let (z, phi) = ((f64::from(i / n) + 0.5) / f64::from(n), f64::from(i % n) / f64::from(n) * TAU);
                let value = bsdf.evaluate(wo, f32_direction(z as f32, phi as f32)).0;
                (0..3).for_each(|c| integrated[c] += f64::from(value[c]) * TAU / f64::from(n * n));
            }
            for c in 0..3 {
                assert!((sampled[c] - integrated[c]).abs() < 5e-3, "{name} {wo}: {sampled:?} {integrated:?}");
                let limit = if name.starts_with("glTF") { 1.2 } else { 1.001 };
                assert!(sampled[c] <= limit, "{name} {wo}: {sampled:?}");
                assert!(sampled[c] > 0.05, "{name} {wo}: {sampled:?}");
            }
        }
    }
}

/// A lobe as narrow as is allowed is a mirror: it reflects Fresnel's share into a thousandth of a radian.
#[test]
fn the_narrowest_lobe_is_a_mirror() {
    let bsdf = Bsdf::Conductor { alpha: microfacet::MIN_ALPHA, fresnel: Fresnel::None, specular: Vec3::splat(0.8) };
    for wo in observers() {
        let mirror = Vec3::new(-wo.x, -wo.y, wo.z);
        let (mut sum, mut near) = (0.0, 0);
        for i in 0..4096 {
            let [x, y, ..] = sobol_burley::sample_4d(i, 0, 2);
            let sample = bsdf.sample(wo, Vec2::new(x, y)).unwrap();
            sum += sample.weight.x / 4096.0;
            near += u32::from(sample.wi.distance(mirror) < 0.01 / wo.z);
            // Both techniques of MIS must see the same density.
            let again = bsdf.evaluate(wo, sample.wi).1;
            assert!((again / sample.pdf_w - 1.0).abs() < 1e-3, "{again} {}", sample.pdf_w);
        }
        assert!((sum - 0.8).abs() < 2e-3, "{wo}: {sum}");
        assert!(near > 3700, "{wo}: {near}");
    }
}

/// Head on, with everything at its peak, against a value worked out by hand: f = F D / 4 with D = 1 / (pi alpha^2), G = 1.
#[test]
fn values_at_the_peak() {
    let alpha = 0.5;
    let peak = 1.0 / (PI * 0.25 * 4.0);
    let metal = Bsdf::Conductor { alpha, fresnel: Fresnel::None, specular: Vec3::ONE };
    assert!((f64::from(metal.evaluate(Vec3::Z, Vec3::Z).0.x) - peak).abs() < 1e-5);
    let gltf =
        Bsdf::MetallicRoughness { base: Vec3::splat(0.6), metallic: 0.0, alpha, f0: Vec3::splat(0.04), f90: 1.0 };
    let expected = 0.04 * peak + 0.96 * 0.6 / PI;
    assert!((f64::from(gltf.evaluate(Vec3::Z, Vec3::Z).0.x) - expected).abs() < 1e-5);
    let inner = f64::from(microfacet::internal_diffuse_reflectance(1.5));
    let base = 0.6 / (2.25 * (1.0 - inner));
    let plastic = Bsdf::Plastic { alpha, base: Vec3::splat(base as f32), specular: Vec3::ONE, eta: 1.5 };
    let expected = 0.04 * peak + 0.96 * 0.96 * base / PI;
    assert!((f64::from(plastic.evaluate(Vec3::Z, Vec3::Z).0.x) - expected).abs() < 1e-5);
}
