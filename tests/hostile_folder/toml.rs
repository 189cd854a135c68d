//! `capture.toml` and `truth/lights.toml` with one mistake each.

use super::{LIGHTS, TOML, good};
use captured::folder;

struct Case {
    /// Text of the file replaced …
    from: &'static str,
    to: &'static str,
    /// … and what the message must name.
    names: &'static [&'static str],
}

/// Reads a good capture whose `file` holds each case's mistake.
fn each_is_named(file: &str, good_text: &str, cases: &[Case]) {
    for Case { from, to, names } in cases {
        let dir = good();
        assert!(
            good_text.contains(from),
            "the case {from:?} changes nothing"
        );
        std::fs::write(dir.path().join(file), good_text.replacen(from, to, 1)).unwrap();
        let message = folder::read(dir.path()).expect_err(to).to_string();
        for name in *names {
            assert!(
                message.contains(name),
                "{to:?}: {message:?} does not name {name:?}"
            );
        }
        // A size that is wrong is named by the picture it contradicts.
        let names_a_file = message.contains(file) || message.contains(".png");
        assert!(
            names_a_file && message.contains(';'),
            "{message:?} names no file or remedy"
        );
    }
}

#[test]
fn every_mistake_in_capture_toml_names_file_field_and_remedy() {
    let cases = [
        Case {
            from: "format = 1",
            to: "format = 2",
            names: &["format is 2", "format = 1"],
        },
        Case {
            from: "format = 1",
            to: "",
            names: &["format"],
        },
        Case {
            from: "format = 1",
            to: "format = 1\nauthor = 3",
            names: &["author"],
        },
        Case {
            from: "cx = 3.5",
            to: "cx = 3.5\nskew = 0.0",
            names: &["skew"],
        },
        Case {
            from: "fx = 10.0",
            to: "",
            names: &["fx"],
        },
        Case {
            from: "fx = 10.0",
            to: "fx = -1.0",
            names: &["color.fx", "-1", "above zero"],
        },
        Case {
            from: "fy = 10",
            to: "fy = nan",
            names: &["color.fy", "NaN"],
        },
        Case {
            from: "cx = 3.5",
            to: "cx = inf",
            names: &["color.cx", "finite"],
        },
        Case {
            from: "width = 8",
            to: "width = 0",
            names: &["color.width", "16384"],
        },
        Case {
            from: "width = 8",
            to: "width = 20000",
            names: &["color.width", "20000"],
        },
        Case {
            from: "width = 8",
            to: "width = -8",
            names: &["width"],
        },
        Case {
            from: "width = 8",
            to: "width = 9",
            names: &["flash.png", "8×6", "9×6"],
        },
        Case {
            from: "height = 3",
            to: "height = 4",
            names: &["depth.png", "4×3", "4×4"],
        },
        Case {
            from: "\"linear\"",
            to: "\"gamut\"",
            names: &["transfer", "gamut"],
        },
        Case {
            from: "transfer = \"linear\"",
            to: "",
            names: &["transfer"],
        },
        Case {
            from: "\"linear\"",
            to: "{ gamma = 0.0 }",
            names: &["color.transfer.gamma"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nblack_level = 1.0",
            names: &["color.black_level"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nwhite_level = 1.5",
            names: &["color.white_level"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nblack_level = 0.5\nwhite_level = 0.4",
            names: &["color.white_level"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nflash_exposure = { seconds = 0.0, gain = 1.0 }",
            names: &["color.flash_exposure.seconds"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nambient_exposure = { seconds = 0.1, gain = 1.0 }",
            names: &["color.ambient_exposure", "both"],
        },
        Case {
            from: "\"linear\"",
            to: "\"linear\"\nflash_exposure = { seconds = 0.1, iso = 100 }",
            names: &["iso"],
        },
        Case {
            from: "\"none\"",
            to: "\"fisheye\"",
            names: &["fisheye"],
        },
        Case {
            from: "\"none\"",
            to: "\"none\", k1 = 0.1",
            names: &["k1"],
        },
        Case {
            from: "k6 = 0.0, ",
            to: "",
            names: &["k6"],
        },
        Case {
            from: "k1 = 0.1",
            to: "k1 = nan",
            names: &["depth.distortion", "finite"],
        },
        Case {
            from: "0.001",
            to: "0.0",
            names: &["depth.depth_unit_metres"],
        },
        Case {
            from: "[[1,0,0]",
            to: "[[1.01,0,0]",
            names: &["depth.rotation", "orthonormal"],
        },
        Case {
            from: "[[1,0,0]",
            to: "[[-1,0,0]",
            names: &["depth.rotation", "determinant"],
        },
        Case {
            from: "[[1,0,0]",
            to: "[[nan,0,0]",
            names: &["depth.rotation", "finite"],
        },
        Case {
            from: "[[1,0,0],",
            to: "[",
            names: &["rotation"],
        },
        Case {
            from: "[0.01, 0.0, 0.0]",
            to: "[0.01, inf, 0.0]",
            names: &["depth.translation_metres"],
        },
        Case {
            from: "[0.02, 0.0, 0.0]",
            to: "[0.02, nan, 0.0]",
            names: &["flash.position_metres"],
        },
        Case {
            from: "9.5",
            to: "0.0",
            names: &["flash.intensity"],
        },
        Case {
            from: "9.5",
            to: "\"bright\"",
            names: &["intensity"],
        },
        Case {
            from: "format = 1",
            to: "format = = 1",
            names: &["line 1"],
        },
    ];
    each_is_named("capture.toml", TOML, &cases);
}

#[test]
fn every_mistake_in_lights_toml_names_file_field_and_remedy() {
    let cases = [
        Case {
            from: "\"unknown\"",
            to: "\"maybe\"",
            names: &["scale", "maybe"],
        },
        Case {
            from: "scale",
            to: "scales",
            names: &["scales"],
        },
        Case {
            from: "[0.0, 0.6, 0.8]",
            to: "[0.0, 0.0, 0.0]",
            names: &["light[0].direction"],
        },
        Case {
            from: "[0.0, 0.6, 0.8]",
            to: "[nan, 0.0, 1.0]",
            names: &["light[0].direction"],
        },
        Case {
            from: "[0.0, 0.6, 0.8]",
            to: "[0.0, 1.0]",
            names: &["direction"],
        },
        Case {
            from: "[2.0, 1.0, 0.5]",
            to: "[2.0, 0.0, 0.5]",
            names: &["light[0].intensity"],
        },
        Case {
            from: "relit_000.png",
            to: "relit_001.png",
            names: &["relit_001.png", "light[0].image"],
        },
        Case {
            from: "relit_000.png",
            to: "../flash.png",
            names: &["light[0].image", "slashes"],
        },
        Case {
            from: "relit_000.png",
            to: "/etc/passwd",
            names: &["light[0].image", "slashes"],
        },
        Case {
            from: "relit_000.png",
            to: "..",
            names: &["light[0].image", "slashes"],
        },
        Case {
            from: "shadow_000.png",
            to: "",
            names: &["light[0].shadow"],
        },
        Case {
            from: "shadow =",
            to: "shade =",
            names: &["shade"],
        },
    ];
    each_is_named("truth/lights.toml", LIGHTS, &cases);
}
