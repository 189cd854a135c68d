//! Error measures against numbers made by `tests/golden/metrics.py` (numpy and scikit-image).

use super::*;
use drivers::Plane;
use glam::Vec3;
use proptest::prelude::*;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;

/// The two pictures of the script, by the same integer arithmetic.
fn pictures() -> (Plane<[f32; 3]>, Plane<[f32; 3]>) {
    let value = |x: usize, y: usize, c: usize| {
        ((x * 7 + y * 13 + c * 29 + (x * y) % 11) % 64) as f64 / 63.0
    };
    let a = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
        std::array::from_fn(|c| value(x, y, c) as f32)
    });
    let b = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
        let change = (((x * 5 + y * 3) % 17) as f64 - 8.0) / 60.0;
        std::array::from_fn(|c| (value(x, y, c) + change).clamp(0.0, 1.0) as f32)
    });
    (a, b)
}

fn everywhere() -> Plane<bool> {
    Plane::filled(WIDTH, HEIGHT, true)
}

fn disc() -> Plane<bool> {
    Plane::from_fn(WIDTH, HEIGHT, |x, y| {
        (x as i32 - 30).pow(2) + (y as i32 - 22).pow(2) < 300
    })
}

#[test]
fn light_error_agrees_with_numpy_and_scikit_image() {
    let (a, b) = pictures();
    let error = light_error(&b, &a, &everywhere()).unwrap().unwrap();
    assert!(
        (error.linear_mse - 0.006_146_775).abs() < 1e-8,
        "{}",
        error.linear_mse
    );
    assert!((error.linear_psnr_db.0 - 22.113_527).abs() < 1e-4);
    assert!(
        (error.srgb_mse - 0.007_684_426).abs() < 1e-8,
        "{}",
        error.srgb_mse
    );
    assert!((error.srgb_psnr_db.0 - 21.143_886).abs() < 1e-4);
    assert!((error.scale_invariant_mse - 0.006_090_089).abs() < 1e-8);
    // Sums of squares in single precision cost the fifth digit.
    assert!(
        (error.srgb_ssim.unwrap() - 0.936_647).abs() < 1e-4,
        "{:?}",
        error.srgb_ssim
    );
    assert_eq!((error.pixels, error.unanswered), (WIDTH * HEIGHT, 0));
    let mut fit = ScaleFit::default();
    fit.add_picture(&b, &a, &everywhere());
    assert!((fit.scale() - 0.987_059_314).abs() < 1e-7);
}

#[test]
fn outside_the_mask_nothing_has_a_say() {
    let (a, mut b) = pictures();
    for (light, inside) in b.samples_mut().iter_mut().zip(disc().samples()) {
        if !inside {
            *light = [f32::NAN; 3];
        }
    }
    let error = light_error(&b, &a, &disc()).unwrap().unwrap();
    assert_eq!((error.pixels, error.unanswered), (949, 0));
    assert!((error.linear_mse - 0.006_112_216).abs() < 1e-8);
    assert!(
        (error.srgb_ssim.unwrap() - 0.936_674).abs() < 1e-4,
        "{:?}",
        error.srgb_ssim
    );
}

#[test]
fn equal_pictures_have_infinite_psnr_which_json_can_carry() {
    let (a, _) = pictures();
    let error = light_error(&a, &a, &everywhere()).unwrap().unwrap();
    assert_eq!(error.linear_psnr_db.0, f64::INFINITY);
    assert_eq!(error.linear_psnr_db.to_string(), "inf");
    assert!((error.srgb_ssim.unwrap() - 1.0).abs() < 1e-6);
    let json = serde_json::to_value(error).unwrap();
    assert_eq!(json["linear_psnr_db"], "inf");
}

#[test]
fn an_empty_mask_gives_no_error_rather_than_zero() {
    let (a, b) = pictures();
    let nowhere = Plane::filled(WIDTH, HEIGHT, false);
    assert_eq!(light_error(&b, &a, &nowhere), Ok(None));
    let lit = Plane::filled(WIDTH, HEIGHT, 1.0);
    assert_eq!(ShadowTally::of(&lit, &lit, &nowhere).unwrap().error(), None);
    assert_eq!(roughness_error(&lit, &lit, &nowhere), Ok(None));
    let normal = Plane::filled(WIDTH, HEIGHT, Vec3::NEG_Z);
    assert_eq!(normal_error(&normal, &normal, &nowhere), Ok(None));
}

#[test]
fn unknown_answers_are_left_out_and_counted_and_unknown_truth_is_neither() {
    let (mut a, mut b) = pictures();
    b[(3, 4)] = [f32::NAN; 3];
    b[(5, 6)][1] = f32::INFINITY;
    a[(7, 8)] = [f32::NAN; 3];
    let error = light_error(&b, &a, &everywhere()).unwrap().unwrap();
    assert_eq!((error.pixels, error.unanswered), (WIDTH * HEIGHT - 3, 2));
    assert!(error.linear_mse.is_finite() && error.srgb_ssim.unwrap().is_finite());
}

#[test]
fn values_are_clipped_to_the_unit_range_before_they_are_compared() {
    let bright = Plane::filled(12, 12, [3.0; 3]);
    let dark = Plane::filled(12, 12, [-0.5; 3]);
    let white = Plane::filled(12, 12, [1.0; 3]);
    let on = Plane::filled(12, 12, true);
    assert_eq!(
        light_error(&bright, &white, &on)
            .unwrap()
            .unwrap()
            .linear_mse,
        0.0
    );
    assert_eq!(
        light_error(&dark, &white, &on).unwrap().unwrap().linear_mse,
        1.0
    );
}

#[test]
fn planes_of_different_size_are_refused() {
    let (a, _) = pictures();
    let small = Plane::filled(WIDTH, HEIGHT - 1, true);
    let refused = light_error(&a, &a, &small).unwrap_err();
    assert_eq!(refused.truth, (WIDTH, HEIGHT - 1));
}

#[test]
fn normal_error_agrees_with_numpy() {
    let tilted = Plane::from_fn(WIDTH, HEIGHT, |x, y| {
        let angle = (((x * 3 + y) % 31) as f32).to_radians();
        Vec3::new(angle.sin(), 0.0, -angle.cos())
    });
    let facing = Plane::filled(WIDTH, HEIGHT, Vec3::NEG_Z);
    let error = normal_error(&tilted, &facing, &everywhere())
        .unwrap()
        .unwrap();
    assert!(
        (error.signed_mse - 0.030_326_174).abs() < 1e-7,
        "{}",
        error.signed_mse
    );
    assert!((error.unsigned_mse - 0.030_326_174 / 4.0).abs() < 1e-7);
    assert!((error.mean_degrees - 14.939_128).abs() < 1e-4);
    assert!((error.median_degrees - 15.0).abs() < 1e-4);
}

#[test]
fn shadow_error_agrees_with_numpy() {
    let found = Plane::from_fn(WIDTH, HEIGHT, |x, y| ((x + y) % 10) as f32 / 9.0);
    let truth = Plane::from_fn(WIDTH, HEIGHT, |x, y| f32::from((x + 2 * y) % 7 > 2));
    let error = ShadowTally::of(&found, &truth, &everywhere())
        .unwrap()
        .error()
        .unwrap();
    assert!((error.mse - 0.351_727_270).abs() < 1e-7);
    assert!((error.iou.unwrap() - 0.299_908_842).abs() < 1e-9);
    assert!((error.balanced_error_rate.unwrap() - 0.500_047_375).abs() < 1e-9);
}

#[test]
fn a_picture_without_any_shadow_has_no_iou() {
    let lit = Plane::filled(4, 4, 1.0);
    let error = ShadowTally::of(&lit, &lit, &Plane::filled(4, 4, true))
        .unwrap()
        .error()
        .unwrap();
    assert_eq!(
        (error.iou, error.balanced_error_rate, error.mse),
        (None, None, 0.0)
    );
}

#[test]
fn percentiles_agree_with_numpy() {
    let runs: Vec<f64> = (0..40).map(|i| f64::from(i * 37 % 101)).collect();
    let cost = Cost::of(runs).unwrap();
    assert!((cost.median_ms - 48.5).abs() < 1e-9 && (cost.p95_ms - 94.15).abs() < 1e-9);
    assert_eq!(Cost::of(Vec::new()), None);
}

proptest! {
    #[test]
    fn scale_invariant_mse_does_not_change_with_the_scale_of_the_answer(scale in 1e-2_f32..1e2) {
        let (a, b) = pictures();
        let plain = light_error(&b, &a, &everywhere()).unwrap().unwrap();
        let scaled = b.map(|light| light.map(|value| value * scale));
        let scaled = light_error(&scaled, &a, &everywhere()).unwrap().unwrap();
        let difference = (plain.scale_invariant_mse - scaled.scale_invariant_mse).abs();
        prop_assert!(difference < 1e-6 * plain.scale_invariant_mse);
    }

    #[test]
    fn tallies_of_two_halves_add_up_to_the_tally_of_the_whole(
        values in proptest::collection::vec((0.0_f32..1.0, 0.0_f32..1.0), 64),
        cut in 1_usize..63,
    ) {
        let found = Plane::from_fn(64, 1, |x, _| values[x].0);
        let truth = Plane::from_fn(64, 1, |x, _| values[x].1);
        let whole = ShadowTally::of(&found, &truth, &Plane::filled(64, 1, true)).unwrap();
        let mut sum = ShadowTally::default();
        for left in [true, false] {
            let half = Plane::from_fn(64, 1, |x, _| (x < cut) == left);
            sum.add(&ShadowTally::of(&found, &truth, &half).unwrap());
        }
        let (whole, sum) = (whole.error().unwrap(), sum.error().unwrap());
        prop_assert!((whole.mse - sum.mse).abs() < 1e-12);
        prop_assert_eq!(whole.iou, sum.iou);
        prop_assert_eq!(whole.balanced_error_rate, sum.balanced_error_rate);
    }
}
