//! Image metrics against values derived by hand, and canaries that they must reject.

use crate::common;

use common::random::Random;
use lightsheaf::film::Film;
use lightsheaf::metrics::{CompareError, Comparison, compare, flip_exposure, heatmap, rel_mse_of_tiles};

fn film(width: u32, height: u32, value: impl Fn(usize) -> [f32; 3]) -> Film {
    Film { width, height, pixels: (0..(width * height) as usize).map(value).collect() }
}

fn close(actual: f64, expected: f64) {
    assert!((actual - expected).abs() <= 1e-6 * expected.abs().max(1e-3), "{actual} is not {expected}");
}

#[test]
fn values_derived_by_hand() {
    // Two pixels have r = 0.3 and 0, x = 0.4 and 0.1 in all channels.
    let reference = film(2, 1, |i| [[0.3; 3], [0.0; 3]][i]);
    let image = film(2, 1, |i| [[0.4; 3], [0.1; 3]][i]);
    let c = compare(&image, &reference).unwrap();
    close(c.mse, 0.01);
    // The two terms are 0.01 / (0.09 + 0.01) = 0.1 and 0.01 / 0.01 = 1.
    close(c.rel_mse, (0.1 + 1.0) / 2.0);
    // The bias is 0.5 / 0.3 - 1.
    close(c.mean_bias, 2.0 / 3.0);
    // Relative errors are 0.1 / 0.31 three times, then 0.1 / 0.01 = 10 three times; rank 0.999 * 5 lies among
    // the latter.
    close(c.p999, 10.0);
    assert_eq!(c.non_finite, 0);
    assert!(c.flip > 0.0 && c.flip <= 1.0);
}

#[test]
fn percentile_lies_between_ranks() {
    // 1001 grey pixels have |x - r| / (r + 0.01) = i / 3003 for value i of 3003, and the rank is 0.999 * 3002
    // = 2998.998.
    let reference = film(1001, 1, |_| [0.99; 3]);
    let image = film(1001, 1, |i| [0, 1, 2].map(|c| 0.99 + (3 * i + c) as f32 / 3003.0));
    let c = compare(&image, &reference).unwrap();
    assert!((c.p999 - 2998.998 / 3003.0).abs() < 1e-6, "{}", c.p999);
}

/// Two halves of a noisy picture estimate its error, and light that only one of them has found does not lower
/// it.
#[test]
fn halves_tell_the_error_of_their_mean() {
    let truth = film(64, 64, |_| [0.5; 3]);
    let mut random = Random(1);
    let mut pixels = || (0..64 * 64).map(|_| [random.between(0.4, 0.6); 3]).collect::<Vec<_>>();
    let (half, second) = (Film { pixels: pixels(), ..truth.clone() }, Film { pixels: pixels(), ..truth.clone() });
    let mean = |half: &Film, second: &Film| {
        film(64, 64, |i| [0, 1, 2].map(|c| 0.5 * (half.pixels[i][c] + second.pixels[i][c])))
    };
    let whole = mean(&half, &second);
    let of_all = |tiles: Vec<f64>| tiles.iter().sum::<f64>() / tiles.len() as f64;
    let told = of_all(rel_mse_of_tiles(&half, &whole, 16).unwrap());
    let real = compare(&whole, &truth).unwrap().rel_mse;
    assert!((told / real - 1.0).abs() < 0.1, "{told} and {real}");

    let mut second = film(64, 64, |_| [0.5; 3]);
    second.pixels[100] = [100.0; 3];
    let whole = mean(&half, &second);
    let told = rel_mse_of_tiles(&half, &whole, 16).unwrap();
    let real = compare(&whole, &truth).unwrap().rel_mse;
    assert!(of_all(told.clone()) > 0.3 * real && real > 1.0, "{told:?} and {real}");
    // The error belongs to the tile of the pixel.
    assert!(told.iter().enumerate().all(|(tile, &error)| (error > 1.0) == (tile == 2)), "{told:?}");
}

#[test]
fn an_image_equals_itself() {
    let image = film(16, 16, |i| [i as f32, 0.5, 0.0]);
    let c = compare(&image, &image.clone()).unwrap();
    let zero = Comparison {
        width: 16,
        height: 16,
        mse: 0.0,
        rel_mse: 0.0,
        mean_bias: 0.0,
        p999: 0.0,
        flip: 0.0,
        non_finite: 0,
    };
    assert_eq!(c, zero);
}

#[test]
fn canary_a_different_image_is_rejected_by_every_figure() {
    let reference = film(32, 32, |i| [0.2 + (i % 7) as f32 * 0.1; 3]);
    let image = film(32, 32, |i| [(0.2 + (i % 7) as f32 * 0.1) * 1.05; 3]);
    let c = compare(&image, &reference).unwrap();
    close(c.mean_bias, 0.05);
    // Only the rounding of the input to f32 may differ in the other direction.
    assert!(c.mse > 1e-4 && c.rel_mse > 1e-4 && c.p999 > 0.04 && c.flip > 0.005, "{c:?}");
    let back = compare(&reference, &image).unwrap();
    close(back.mean_bias, 1.0 / 1.05 - 1.0);
}

#[test]
fn holes_are_counted_and_pass_no_threshold() {
    let reference = film(4, 4, |_| [1.0; 3]);
    let mut image = reference.clone();
    image.pixels[5] = [f32::NAN, f32::INFINITY, 1.0];
    let c = compare(&image, &reference).unwrap();
    assert_eq!(c.non_finite, 2);
    for figure in [c.mse, c.rel_mse, c.mean_bias, c.p999, c.flip] {
        assert!(figure.is_nan(), "{c:?}");
    }
    let json = serde_json::to_string(&c).unwrap();
    assert!(json.contains("\"rel_mse\":null"), "{json}");
    assert!(serde_json::from_str::<Comparison>(&json).unwrap().flip.is_nan());
    assert_eq!(compare(&reference, &image), Err(CompareError::Reference(2)));
}

#[test]
fn sizes_must_match() {
    let error = compare(&Film::new(2, 3), &Film::new(3, 2)).unwrap_err();
    assert_eq!(error.to_string(), "the image is 2x3, the reference 3x2; render one of them at the other's size");
    assert_eq!(compare(&Film::new(0, 0), &Film::new(0, 0)), Err(CompareError::Empty));
}

#[test]
fn heatmap_is_signed() {
    let reference = film(4, 1, |_| [0.99; 3]);
    let image = film(4, 1, |i| [[1.49; 3], [0.49; 3], [0.99; 3], [f32::NAN; 3]][i]);
    let map = heatmap(&image, &reference).unwrap();
    let [bright, dark, equal, hole] = [0, 1, 2, 3].map(|i| map.pixels[i]);
    assert!((bright[0] - 0.5).abs() < 1e-6 && bright[2] == 0.0);
    assert!((dark[2] - 0.5).abs() < 1e-6 && dark[0] == 0.0);
    assert_eq!(equal, [0.0; 3]);
    assert_eq!(hole, [1.0; 3]);
}

#[test]
fn the_exposure_of_flip_is_the_one_that_the_references_were_measured_with() {
    let Some(folder) = common::references() else { return };
    let mut checked = 0;
    for name in ["cornell_point_d4", "cornell_env", "corner_spikes_d4"] {
        let json = std::fs::read_to_string(folder.join(format!("{name}.json"))).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let film = Film::load(folder.join(format!("{name}.exr"))).unwrap();
        let expected = json["flip_exposure"].as_f64().unwrap();
        let actual = flip_exposure(&film);
        // The image is stored in half floats, which have 11 bits.
        assert!((actual / expected - 1.0).abs() < 1e-3, "{name}: {actual} is not {expected}");
        let mean = film.pixels.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (film.pixels.len() * 3) as f64;
        assert!((mean / json["mean"].as_f64().unwrap() - 1.0).abs() < 1e-3, "{name}: mean {mean}");
        checked += 1;
    }
    assert_eq!(checked, 3);
}
