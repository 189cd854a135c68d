//! Lights on the command line: what is accepted, what is refused, what is warned about.

use crate::{capture::Capture, capturectl, names_in};

struct Case(&'static [&'static str], i32, &'static [&'static str]);

#[test]
fn lights_that_mean_nothing_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("good"));
    image::Rgb32FImage::from_pixel(8, 8, image::Rgb([1.0; 3]))
        .save(folder.path().join("good/square.hdr"))
        .unwrap();
    let cases = [
        Case(
            &[],
            2,
            &[
                "no light given",
                "--light x,y,z",
                "--lights",
                "--environment",
            ],
        ),
        Case(&["--light", "0,0,0"], 2, &["light 0", "0,0,1"]),
        Case(
            &["--light", "0,0,1", "--light", "nan,0,1"],
            2,
            &["light 1", "finite"],
        ),
        Case(&["--light", "1,2"], 2, &["\"1,2\"", "x,y,z"]),
        Case(
            &["--lights", "absent.toml"],
            3,
            &["absent.toml", "[[light]]"],
        ),
        Case(
            &["--lights", "good/capture.toml"],
            3,
            &["good/capture.toml", "[[light]]"],
        ),
        Case(&["--environment", "absent.hdr"], 3, &["absent.hdr"]),
        Case(
            &["--environment", "good/capture.toml"],
            3,
            &["good/capture.toml"],
        ),
        Case(
            &["--environment", "good/flash.png"],
            3,
            &["good/flash.png", "16-bit"],
        ),
        Case(
            &["--environment", "good/square.hdr"],
            3,
            &["square.hdr", "twice as wide"],
        ),
    ];
    for Case(lights, code, words) in cases {
        let arguments = [&["relight", "good", "--out", "relit"], lights].concat();
        capturectl(folder.path(), &arguments).refuses(code, words);
        assert_eq!(names_in(folder.path()), ["good"], "{lights:?}");
    }
}

#[test]
fn a_light_from_behind_is_answered_and_warned_about() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("good"));
    let arguments = [
        "--json",
        "relight",
        "good",
        "--light",
        "0.2,0.1,-1",
        "--out",
        "relit",
    ];
    let ran = capturectl(folder.path(), &arguments);
    ran.succeeds();
    assert!(ran.err.contains("behind"), "{ran:#?}");
    assert!(
        ran.json()["warnings"]
            .to_string()
            .contains("low confidence"),
        "{ran:#?}"
    );
    assert!(folder.path().join("relit/relit_000.exr").is_file());
}

#[test]
fn lights_of_a_file_come_after_those_of_the_command_line() {
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("good"));
    std::fs::write(
        folder.path().join("lights.toml"),
        "[[light]]\ndirection = [0, 0, 1]\nintensity = [0.5, 0.5, 0.5]\n\
         [[light]]\ndirection = [1, 0, 1]\n",
    )
    .unwrap();
    let arguments = [
        "relight",
        "good",
        "--lights",
        "lights.toml",
        "--light",
        "-1,0,1",
        "--out",
        "relit",
    ];
    capturectl(folder.path(), &arguments).succeeds();
    let names = names_in(&folder.path().join("relit"));
    for index in 0..3 {
        assert!(
            names.contains(&format!("relit_{index:03}.exr")),
            "{names:?}"
        );
        assert!(
            names.contains(&format!("shadow_{index:03}.png")),
            "{names:?}"
        );
    }
    assert!(!names.contains(&"relit_003.exr".to_owned()));
}

#[test]
fn an_environment_of_one_value_lights_an_open_wall_as_its_own_albedo() {
    // Under light 1 from everywhere an unshadowed matte surface sends back its albedo; here what
    // lies more than 20 degrees behind the scene is left out, so a little less arrives.
    let folder = tempfile::tempdir().unwrap();
    Capture::GOOD.write(&folder.path().join("good"));
    image::Rgb32FImage::from_pixel(64, 32, image::Rgb([1.0; 3]))
        .save(folder.path().join("white.hdr"))
        .unwrap();
    let arguments = [
        "--json",
        "relight",
        "good",
        "--environment",
        "white.hdr",
        "--out",
        "relit",
    ];
    let ran = capturectl(folder.path(), &arguments);
    let shot = ran.succeeds().json()["shot"].clone();
    assert_eq!(shot["lights"][0]["label"], "white");
    let found = &shot["report"]["environment"];
    let (lights, of) = (found["lights"].as_u64(), found["of"].as_u64());
    assert!(
        lights > Some(0) && lights <= of && of <= Some(256),
        "{found}"
    );
    assert!(
        found["rms_change"].as_f64() <= found["noise"].as_f64(),
        "{found}"
    );
    assert!(
        found["capped"].is_boolean() && found["change_95"].is_number(),
        "{found}"
    );
    let relit = image::open(folder.path().join("relit/relit_000.png"))
        .unwrap()
        .to_rgb8();
    let wall: Vec<u8> = (6..42).map(|y| relit.get_pixel(3, y).0[0]).collect();
    let mean = wall.iter().map(|value| f64::from(*value)).sum::<f64>() / wall.len() as f64;
    // sRGB 225 is 75 % of light.
    assert!(mean > 225.0, "{mean}: {wall:?}");
}
