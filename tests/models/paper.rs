//! The paper's tier from a shot to a folder, with tiny networks.

use super::paper;
use captured::{config::Config, session};
use captured::{
    darkroom::{self, Answering, Order, Source},
    develop::{Options, develop},
    output::{Destination, Disk, Existing, Manifest},
    relight::{Lamp, Luminaire, networks::Variant},
};
use drivers::open::open;

fn taken(address: &str) -> session::Taken {
    let mut device = open(address).unwrap();
    session::take(device.as_mut(), &Config::default().capture, None).unwrap()
}

#[test]
fn a_folder_of_the_papers_tier_says_which_networks_made_it() {
    let taken = taken("synthetic:desk");
    let answering = Answering::Paper(paper());
    let lamps = [[0.6, 0.5, 0.62], [-0.3, 0.0, 0.9]]
        .map(|l| Luminaire::Distant(Lamp::from_person(l).unwrap()));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let order = Order {
        shot: &taken.shot,
        source: Source {
            name: "synthetic:desk",
            drops: None,
            burst: None,
        },
        lamps: &lamps,
        environment: None,
        answering: &answering,
        warnings: Vec::new(),
        attachments: &[],
    };
    let to = Destination {
        disk: &Disk,
        folder: &out,
        existing: Existing::Refuse,
    };
    darkroom::print(&order, &to, &mut |_| {}).unwrap();
    let manifest = Manifest::verify(&out).unwrap();
    assert_eq!(manifest.report["tier"], "paper");
    let networks = manifest.report["networks"].as_array().unwrap();
    let runs: Vec<_> = networks
        .iter()
        .map(|n| n["runs"].as_u64().unwrap())
        .collect();
    assert_eq!(runs, [1, 2, 2]);
    for network in networks {
        assert_eq!(network["blake3"].as_str().unwrap().len(), 64);
        assert!(network["milliseconds"].as_f64().unwrap() > 0.0);
        assert!(network["backend"].is_string());
    }
    let stages: Vec<_> = manifest
        .timings_ms
        .iter()
        .map(|(name, _)| name.as_str())
        .collect();
    assert!(stages.contains(&"decompose") && stages.contains(&"relight"));
}

#[test]
fn networks_answer_at_the_photographs_size_and_what_they_say() {
    let taken = taken("synthetic:desk");
    let development = develop(&taken.shot, &Options::default(), &mut |_| {}).unwrap();
    let feed = development.feed(&taken.shot, Variant::Clean);
    let paper = paper();
    let scene = paper.decompose(&feed).unwrap();
    // The tiny network halves the flash's light.
    let (albedo, flash) = (scene.albedo(), feed.flash.channel(0));
    for (albedo, flash) in albedo.samples().iter().zip(flash) {
        assert!((albedo[0] - (flash / 2.0).min(1.0)).abs() < 1e-6);
    }
    let lamp = Lamp::from_person([0.3, 0.2, 0.9]).unwrap();
    let red = lamp.with_color([2.0, 0.0, 0.0]).unwrap();
    let [white, red] = [lamp, red].map(|lamp| paper.relight(&feed, &scene, &lamp).unwrap());
    for (white, red) in white.light.0.samples().iter().zip(red.light.0.samples()) {
        assert_eq!([2.0 * white[0], 0.0, 0.0], *red);
    }
    let full = development.finish_fed(&feed, white);
    assert_eq!(full.light.0.size(), taken.shot.flash.pixels.size());
    assert_eq!(full.shadow.size(), taken.shot.flash.pixels.size());
}

#[test]
fn many_lamps_at_once_are_the_sum_of_each() {
    let taken = taken("synthetic:wall");
    let development = develop(&taken.shot, &Options::default(), &mut |_| {}).unwrap();
    let feed = development.feed(&taken.shot, Variant::Noisy);
    let paper = paper();
    let scene = paper.decompose(&feed).unwrap();
    let lamps = [[0.0, 0.4, 0.9], [0.5, 0.0, 0.8]].map(|l| Lamp::from_person(l).unwrap());
    let mut begun = Vec::new();
    let sum = paper
        .superposed(&feed, &scene, lamps.iter(), &mut |number| {
            begun.push(number)
        })
        .unwrap();
    let each = lamps.map(|lamp| paper.relight(&feed, &scene, &lamp).unwrap());
    for index in (0..sum.shadow.len()).step_by(97) {
        let [a, b] = each.each_ref().map(|one| one.light.0.samples()[index][1]);
        assert!((sum.light.0.samples()[index][1] - a - b).abs() < 1e-6);
        let [a, b] = each.each_ref().map(|one| one.shadow.samples()[index]);
        assert!((sum.shadow.samples()[index] - (a + b) / 2.0).abs() < 1e-6);
    }
    assert_eq!(begun, [0, 1]);
}
