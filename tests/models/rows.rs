//! Networks as rows of the table, asked about a shot of the synthetic desk.

use super::{network, paper};
use captured::{
    config::Config,
    develop::{Development, Options, develop},
    eval::{
        learned::{ThreeNetworks, WithRoomLight, WithoutDepth},
        methods::{DepthGiven, Method, Subject},
    },
    folder::Capture,
    relight::{Lamp, networks::Variant},
    session,
};

/// A shot, as a capture that was developed.
fn desk() -> (Capture, Development) {
    let mut device = drivers::open::open("synthetic:desk").unwrap();
    let shot = session::take(device.as_mut(), &Config::default().capture, None)
        .unwrap()
        .shot;
    let development = develop(&shot, &Options::default(), &mut |_| {}).unwrap();
    let capture = Capture {
        name: "desk".to_owned(),
        shot,
        truth: None,
    };
    (capture, development)
}

fn subject<'a>((capture, development): &'a (Capture, Development)) -> Subject<'a> {
    Subject {
        capture,
        development,
        depth: DepthGiven::Clean,
    }
}

fn lamp() -> Lamp {
    Lamp::from_person([0.6, 0.5, 0.62]).unwrap()
}

/// Green of every pixel with an answer.
fn known(plane: &drivers::Plane<[f32; 3]>) -> Vec<f32> {
    let greens = plane.samples().iter().map(|pixel| pixel[1]);
    greens.filter(|green| !green.is_nan()).collect()
}

#[test]
fn the_three_networks_answer_as_a_row_what_they_answer_as_a_tier() {
    let desk = desk();
    let row = ThreeNetworks(paper());
    assert_eq!(row.row(), 4);
    let mut study = row.study(subject(&desk)).unwrap();
    let answer = study.relight(0, &lamp()).unwrap().unwrap();
    let (capture, development) = &desk;
    assert_eq!(answer.light.size(), capture.shot.flash.pixels.size());
    let paper = paper();
    let feed = development.feed(&capture.shot, Variant::Clean);
    let scene = paper.decompose(&feed).unwrap();
    let tier = development.finish_fed(&feed, paper.relight(&feed, &scene, &lamp()).unwrap());
    let mut compared = 0;
    for (row, tier) in answer.light.samples().iter().zip(tier.light.0.samples()) {
        // Beside unknown depth the row mixes what is known alone.
        if row[0] == tier[0] {
            compared += 1;
        }
    }
    assert!(compared > answer.light.len() / 2, "{compared}");
    let shadow = answer.shadow.unwrap();
    assert!(shadow.samples().iter().any(|lit| *lit > 0.0 && *lit < 1.0));
}

#[test]
fn the_env_row_sees_the_rooms_light_and_says_nothing_about_lamps() {
    let desk = desk();
    let (with_room, alone) = (
        WithRoomLight(Box::new(network("decompose", "env"))),
        WithoutDepth(Box::new(network("decompose", "sips"))),
    );
    let mut study = with_room.study(subject(&desk)).unwrap();
    assert!(study.relight(0, &lamp()).unwrap().is_none());
    let brightness = |study: &dyn captured::eval::methods::Study| {
        let albedo = known(&study.surfaces().albedo.unwrap());
        albedo.iter().sum::<f32>() / albedo.len() as f32
    };
    // Both tiny networks halve the light they are given.
    let ratio =
        brightness(study.as_ref()) / brightness(alone.study(subject(&desk)).unwrap().as_ref());
    assert!(ratio > 1.02, "{ratio}");
}

#[test]
fn surfaces_without_depth_are_shaded_without_casting_shadows() {
    let desk = desk();
    let row = WithoutDepth(Box::new(network("decompose", "sips")));
    assert_eq!(row.row(), 5);
    let mut study = row.study(subject(&desk)).unwrap();
    let answer = study.relight(0, &lamp()).unwrap().unwrap();
    assert!(answer.shadow.is_none());
    let light = known(&answer.light);
    assert!(light.iter().all(|value| *value >= 0.0) && light.iter().any(|value| *value > 0.0));
    // From behind, nothing that faces the camera is lit.
    let behind = Lamp::from_person([0.0, 0.0, -1.0]).unwrap();
    let dark = study.relight(0, &behind).unwrap().unwrap();
    assert!(known(&dark.light).iter().all(|value| *value == 0.0));
}
