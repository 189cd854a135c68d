//! A sound model answers what its weights say, by hand.

use super::{network, paper, pictures};
use captured::relight::networks::Network;

const SIZE: (usize, usize) = (64, 32);

#[test]
fn a_tiny_decompose_network_answers_what_its_weights_say() {
    let (flash, near) = (pictures(3, SIZE, 1), pictures(1, SIZE, 2));
    let network = network("decompose", "clean");
    let wanted = ["roughness", "albedo", "normal"];
    let given = [("near", &near), ("flash", &flash)];
    let answers = network.answer(&given, &wanted).unwrap();
    let [roughness, albedo, normal] = answers.as_slice() else {
        panic!("{} answers", answers.len());
    };
    for pixel in 0..SIZE.0 * SIZE.1 {
        let n = near.samples[pixel];
        let slant = (n * n + 1.0).sqrt();
        let expected = [
            (roughness.channel(0), 1.0 / (1.0 + (-2.0 * n).exp())),
            (albedo.channel(1), flash.channel(1)[pixel] / 2.0),
            (normal.channel(0), n / slant),
            (normal.channel(1), 0.0),
            (normal.channel(2), 1.0 / slant),
        ];
        for (index, (found, expected)) in expected.into_iter().enumerate() {
            // Weights and answers are exact in these bits; the exponential is not quite.
            let found = found[pixel];
            assert!(
                (found - expected).abs() < 1e-5,
                "{index}: {found} ≠ {expected}"
            );
        }
    }
    assert_eq!((albedo.size, albedo.count), (SIZE, 3));
}

#[test]
fn the_order_in_which_inputs_are_given_does_not_matter() {
    let (flash, near) = (pictures(3, SIZE, 1), pictures(1, SIZE, 2));
    let network = network("decompose", "clean");
    let ask = |given: [(&str, _); 2]| network.answer(&given, &["albedo"]).unwrap();
    let one = ask([("near", &near), ("flash", &flash)]);
    assert_eq!(one, ask([("flash", &flash), ("near", &near)]));
}

#[test]
fn pictures_of_another_size_are_answered_by_the_same_network() {
    let network = network("shadow", "clean");
    for size in [(32, 32), (96, 64), (32, 32)] {
        let cloud = pictures(3, size, 3);
        let answer = network.answer(&[("cloud", &cloud)], &["shadow"]).unwrap();
        let pixel = |channel: usize| cloud.channel(channel)[70];
        let sum = pixel(0) - pixel(1) + pixel(2) / 2.0;
        assert!((answer[0].samples[70] - 1.0 / (1.0 + (-sum).exp())).abs() < 1e-5);
        assert_eq!(answer[0].size, size);
    }
    let record = network.record();
    assert_eq!((record.runs, record.name.as_str()), (3, "shadow"));
    assert!(record.milliseconds > 0.0);
}

#[test]
fn inputs_that_the_manifest_does_not_state_are_refused_by_name() {
    let network = network("decompose", "clean");
    let (flash, near) = (pictures(3, SIZE, 1), pictures(1, SIZE, 2));
    let small = pictures(1, (32, 32), 2);
    let refusals = [
        (vec![("flash", &flash)], "\"near\" is not given"),
        (
            vec![("flash", &near), ("near", &near)],
            "\"flash\" has 1 channels, not 3",
        ),
        (
            vec![("flash", &flash), ("near", &small)],
            "\"near\" is 32×32, the others 64×32",
        ),
        (
            vec![("flash", &flash), ("near", &near), ("mask", &near)],
            "\"mask\" is none of its inputs",
        ),
    ];
    for (given, words) in refusals {
        let error = network.answer(&given, &["albedo"]).unwrap_err().to_string();
        assert!(
            error.contains(words) && error.contains("decompose"),
            "{error}"
        );
    }
    let given = [("flash", &flash), ("near", &near)];
    let error = network.answer(&given, &["colour"]).unwrap_err().to_string();
    assert!(
        error.contains("colour") && error.contains("--tier closed"),
        "{error}"
    );
}

#[test]
fn the_paper_keeps_a_record_of_what_each_network_cost() {
    let records = paper().records();
    let names = records.each_ref().map(|record| record.name.as_str());
    assert_eq!(names, ["decompose", "shadow", "synthesis"]);
    assert!(
        records
            .iter()
            .all(|record| record.blake3.len() == 64 && record.runs == 0)
    );
}
